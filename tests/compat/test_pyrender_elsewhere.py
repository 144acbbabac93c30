"""A scene of the adapter's, however it is drawn, gives the same bits; what cannot is refused."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
import trimesh

import rasterjit as rj
import rasterjit.compat.pyrender as pyrender
from rasterjit.compat.pyrender.conversion import Viewpoint, convert_scene, make_camera
from rasterjit.pipeline import srgb_encoding
from rasterjit.scene.reference_shader import decode_codes

SIZE = 96, 72
QUALITIES = (rj.Quality(), rj.Quality(samples=4, blending="srgb8", subpixel_bits=12))
every_quality = pytest.mark.parametrize("quality", QUALITIES, ids=["one sample", "four"])


def place(x, y, z):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


@pytest.fixture
def scene():
    made = pyrender.Scene(ambient_light=[0.1, 0.1, 0.1])
    made.add(pyrender.Mesh.from_trimesh(trimesh.creation.icosphere(2)))
    made.add(pyrender.Mesh.from_trimesh(trimesh.creation.box()), pose=place(1.0, 0.3, 0.2))
    made.add(pyrender.DirectionalLight(intensity=3.0))
    made.add(pyrender.PointLight(color=[1.0, 0.2, 0.2], intensity=9.0), pose=place(2.0, 2.0, 2.0))
    made.add(pyrender.PerspectiveCamera(1.0, znear=0.1, zfar=20.0), pose=place(0.0, 0.0, 4.0))
    return made


@pytest.fixture
def camera(scene):
    return make_camera(scene, SIZE)


@pytest.fixture
def drawn(scene, camera):
    return convert_scene(
        scene, pyrender.RenderFlags.NONE, viewpoint=Viewpoint(camera, SIZE, 1.0)
    ).scene


@every_quality
def test_threads_and_copies_change_no_bit(drawn, camera, quality):
    first = rj.render(drawn, camera, size=SIZE, quality=quality, threads=1).color
    for other in (drawn, copy.deepcopy(drawn), pickle.loads(pickle.dumps(drawn))):
        color = rj.render(other, camera, size=SIZE, quality=quality, threads=3).color
        np.testing.assert_array_equal(color, first)
    assert len(np.unique(first[..., 0])) > 20


@every_quality
def test_views_of_a_batch_are_those_of_render(drawn, camera, quality):
    turned = rj.transforms.compose(camera.view_from_world, rj.transforms.rotate_y(30.0))
    cameras = [camera, rj.MatrixCamera(turned, camera.clip_from_view)]
    batch = rj.render_batch(drawn, cameras, size=SIZE, quality=quality, outputs=("color", "depth"))
    for n, one in enumerate(cameras):
        frame = rj.render(drawn, one, size=SIZE, quality=quality, outputs=("color", "depth"))
        np.testing.assert_array_equal(batch.color[n], frame.color)
        np.testing.assert_array_equal(batch.depth[n], frame.depth)


@every_quality
def test_tiles_are_parts_of_the_picture(drawn, camera, quality, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    path = tmp_path / "large.tif"
    rj.distributed.render_large(drawn, camera, SIZE, path, tile=64, quality=quality)
    whole = rj.render(drawn, camera, size=SIZE, quality=quality).color
    np.testing.assert_array_equal(tifffile.imread(path), whole)


@every_quality
def test_pixel_that_is_explained_has_the_code_that_is_seen(drawn, camera, quality):
    color = rj.render(drawn, camera, size=SIZE, quality=quality).color
    for x, y in ((48, 36), (30, 30), (70, 30), (2, 2)):
        told = rj.explain_pixel(drawn, camera, SIZE, x, y, quality=quality)
        assert told.color.tolist() == color[y, x].tolist()
        if told.light is not None:
            terms = told.light.lights
            assert [term.label for term in terms] == ["DirectionalLight 1", "PointLight 2"]
            assert not any(term.specular.any() for term in terms)


def test_mean_of_many_pictures_has_the_same_codes(drawn, camera):
    once = rj.render(drawn, camera, size=SIZE).color[36, 48].astype(int)
    for blending in ("linear", "srgb8"):
        quality = rj.Quality(samples=64, blending=blending)
        mean = rj.render(drawn, camera, size=SIZE, quality=quality).color
        assert abs(mean[36, 48] - once).max() <= 1
        assert mean[2, 2].tolist() == [255, 255, 255, 255]


def test_linear_light_is_what_codes_stand_for(drawn, camera):
    frame = rj.render(drawn, camera, size=SIZE, quality=QUALITIES[1], outputs=("color", "linear"))
    expected = (frame.color[..., :3] / 255.0) ** 2.2
    np.testing.assert_allclose(frame.linear[..., :3], expected, rtol=1e-6)


@pytest.mark.parametrize("encoding", ["srgb", "gamma 2.2", "as is"])
def test_codes_stand_for_what_is_encoded_as_them(encoding):
    light = decode_codes(encoding)
    codes = [
        srgb_encoding.encode_color(np.append(np.repeat(value, 3), 0.0), encoding) for value in light
    ]
    assert codes == [code | code << 8 | code << 16 for code in range(256)]


def test_scenes_that_changed_and_effects_are_refused(drawn, camera):
    changed = copy.deepcopy(drawn)
    changed.add(rj.Mesh([[0, 0, 2], [1, 0, 2], [0, 1, 2]], [[0, 1, 2]]))
    with pytest.raises(ValueError, match="scene must keep its 2 objects and 3 lights"):
        rj.render(changed, camera, size=SIZE)
    cut = copy.deepcopy(drawn)
    cut.section = rj.SectionPlane((1.0, 0.0, 0.0), (0.2, 0.0, 0.0))
    with pytest.raises(ValueError, match="scene must keep its 2 objects"):
        rj.render(cut, camera, size=SIZE)
    drawn.fog = rj.Fog(density=0.1)
    with pytest.raises(ValueError, match="fog must be None"):
        rj.render(drawn, camera, size=SIZE)
