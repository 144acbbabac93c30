"""The adapter's pictures are those that pyrender 0.1.45 draws."""

from __future__ import annotations

import copy
import itertools
import json
import pickle

import numpy as np
import pyrender_scenes
import pytest

import rasterjit as rj
from rasterjit.compat import pyrender
from rasterjit.compat.pyrender import conversion
from rasterjit.compat.pyrender.constants import RenderFlags
from rasterjit.rendering.planning import describe
from rasterjit.rendering.renderer import Renderer
from rasterjit.scene.quality import Quality

RECORDED = json.loads(pyrender_scenes.RECORDED.read_text())


@pytest.fixture(scope="module")
def pictures():
    return pyrender_scenes.drawn(pyrender)


@pytest.mark.parametrize("name", pyrender_scenes.SCENES)
def test_colors_and_depths_are_those_of_the_original(pictures, name):
    color, depth = (np.asarray(part)[::3, ::3] for part in pictures[name])
    want, deep = np.array(RECORDED[name]["color"]), np.array(RECORDED[name]["depth"])
    assert color.shape == want.shape
    off = np.abs(color.astype(int) - want)
    # The original rounds texels' shares, and mixes, to fewer bits.
    assert off.max() <= 3
    assert off.mean() <= 0.2
    np.testing.assert_array_equal(depth > 0.0, deep > 0.0)
    np.testing.assert_allclose(depth, deep, rtol=2e-5)


def test_recorded_pictures_are_not_of_nothing():
    assert {*RECORDED} == {*pyrender_scenes.SCENES}
    for rows in RECORDED.values():
        assert (np.array(rows["depth"]) > 0.0).mean() > 0.1


def drawn_scene(name):
    scene, flags = pyrender_scenes.SCENES[name](pyrender)
    camera = conversion.make_camera(scene, pyrender_scenes.SIZE)
    return conversion.convert_scene(scene, RenderFlags(flags)).scene, camera


QUALITY = Quality(samples=4, blending="srgb8")


def color_of(scene, camera, threads=1):
    with Renderer(pyrender_scenes.SIZE, quality=QUALITY, threads=threads) as renderer:
        return renderer.render(scene, camera, background="black").color


@pytest.mark.parametrize("name", ["all_maps", "glass", "colors_of_vertices"])
def test_bits_do_not_depend_on_threads_and_copies(name):
    scene, camera = drawn_scene(name)
    one = color_of(scene, camera)
    np.testing.assert_array_equal(color_of(scene, camera, threads=3), one)
    np.testing.assert_array_equal(color_of(pickle.loads(pickle.dumps(scene)), camera), one)
    np.testing.assert_array_equal(color_of(copy.deepcopy(scene), camera), one)


def test_a_scene_that_does_not_ask_for_it_is_as_ever():
    scene, camera = drawn_scene("glossy")
    size = pyrender_scenes.SIZE
    asked = describe(rj.explain(scene, camera, size=size))
    assert "as pyrender's shader does" in asked
    assert "pyrender.add_lights_as_pyrender" in asked
    before = color_of(scene, camera)
    scene._reference_shading = None
    plain = describe(rj.explain(scene, camera, size=size))
    assert "pyrender" not in plain
    assert (color_of(scene, camera) != before).any()


def test_what_changed_between_frames_is_seen():
    scene = pyrender_scenes.empty(pyrender, sun=0.0)
    light = pyrender.DirectionalLight(color=np.ones(3), intensity=1.0)
    scene.add(light, pose=pyrender_scenes.at(z=3.0))
    mesh = pyrender_scenes.ball(pyrender)
    node = scene.add(mesh)
    renderer = pyrender.OffscreenRenderer(*pyrender_scenes.SIZE)
    middle = pyrender_scenes.SIZE[1] // 2, pyrender_scenes.SIZE[0] // 2
    seen = [renderer.render(scene)[0][middle].tolist()]
    for change in (
        lambda: setattr(light, "intensity", 2.0),
        lambda: setattr(light, "color", [1.0, 0.5, 0.2]),
        lambda: setattr(scene, "ambient_light", [0.3, 0.3, 0.3]),
        lambda: setattr(mesh.primitives[0].material, "baseColorFactor", [0.9, 0.1, 0.1, 1.0]),
        lambda: scene.set_pose(node, pyrender_scenes.at(x=0.5)),
    ):
        change()
        seen.append(renderer.render(scene)[0][middle].tolist())
    renderer.delete()
    assert all(one != other for one, other in itertools.pairwise(seen))
