"""Habits of public programs that go beyond pyrender's documentation, in code of our own."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from rasterjit.compat import pyrender

SPHERE = trimesh.creation.icosphere(3, 0.5)


@pytest.fixture
def renderer():
    made = pyrender.OffscreenRenderer(64, 48)
    yield made
    made.delete()


def at(x=0.0, y=0.0, z=0.0):
    return trimesh.transformations.translation_matrix([x, y, z])


def seen(renderer, mesh, ambient=0.0, intensity=0.0, flags=pyrender.RenderFlags.NONE):
    scene = pyrender.Scene(bg_color=(0, 0, 0), ambient_light=float(ambient))
    scene.add(mesh)
    scene.add(pyrender.DirectionalLight(np.ones(3), intensity))
    scene.add(pyrender.PerspectiveCamera(yfov=1.0), pose=at(z=2.0))
    color, _ = renderer.render(scene, flags)
    return color


def colored(*rgb):
    return pyrender.Mesh([
        pyrender.Primitive(
            SPHERE.vertices, normals=SPHERE.vertex_normals, indices=SPHERE.faces,
            color_0=np.tile(np.float64(rgb), (len(SPHERE.vertices), 1)),
        )
    ])  # fmt: skip


def made_of(**options):
    material = pyrender.MetallicRoughnessMaterial(**options)
    return pyrender.Mesh.from_trimesh(SPHERE, material=material)


def test_float_colors_of_vertices_above_one_brighten_light(renderer):
    bright = seen(renderer, colored(4.0, 2.0, 0.5), ambient=0.05, intensity=0.5)
    scaled = [
        seen(renderer, colored(1.0, 1.0, 1.0), ambient=0.05 * gain, intensity=0.5 * gain)
        for gain in (4.0, 2.0, 0.5)
    ]
    expected = np.stack([scaled[k][..., k] for k in range(3)], axis=-1)
    assert np.abs(bright.astype(int) - expected).max() <= 1
    assert len(np.unique(bright)) > 20


def test_float_colors_of_points_may_reach_255(renderer):
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 3))
    shares = np.tile([1.0, 0.5, 0.0], (50, 1))
    bright = seen(renderer, pyrender.Mesh.from_points(points, colors=255.0 * shares), ambient=0.1)
    assert bright.any(axis=-1).sum() > 10
    # Each of the four samples of a pixel shows the point, or nothing.
    assert (bright[..., 0] == bright[..., 1]).all()
    assert (bright[..., 2] == 0).all()


def test_base_colors_above_one_brighten_ambient_light(renderer):
    bright = seen(renderer, made_of(baseColorFactor=(3.0, 1.5, 0.5, 1.0)), ambient=0.2)
    expected = np.round(255.0 * (0.2 * np.array([3.0, 1.5, 0.5])) ** (1.0 / 2.2))
    assert np.abs(bright[24, 32] - expected).max() <= 1.0


def test_base_colors_above_one_bend_what_metals_mirror(renderer):
    once, twice = (
        seen(renderer, made_of(baseColorFactor=(f, f, f, 1.0), metallicFactor=1.0), intensity=0.4)
        for f in (1.0, 2.0)
    )
    # A metal mirrors its base colour head on, which may be above 1.
    assert once[24, 32, 0] > 40
    assert abs(float(twice[24, 32, 0]) / once[24, 32, 0] - 2.0 ** (1.0 / 2.2)) < 0.03


def test_seen_through_faces_brighten_too(renderer):
    options = {"alphaMode": "BLEND", "doubleSided": True}
    whole = seen(renderer, made_of(baseColorFactor=(0.5, 0.5, 0.5, 0.5), **options), ambient=0.8)
    above = seen(renderer, made_of(baseColorFactor=(2.0, 2.0, 2.0, 0.5), **options), ambient=0.2)
    assert np.abs(whole.astype(int) - above).max() <= 1
    assert whole.any()


def test_nodes_taken_out_of_mesh_nodes_are_not_drawn(renderer):
    scene = pyrender.Scene(bg_color=(0, 0, 0), ambient_light=1.0)
    node = scene.add(pyrender.Mesh.from_trimesh(SPHERE))
    scene.add(pyrender.PerspectiveCamera(yfov=1.0), pose=at(z=2.0))
    assert renderer.render(scene)[1].any()
    scene.mesh_nodes.clear()
    assert not renderer.render(scene)[1].any()
    assert scene.has_node(node)
    assert not scene.bounds.any()
    other = scene.add(pyrender.Mesh.from_trimesh(SPHERE))
    assert renderer.render(scene)[1].any()
    scene.remove_node(other)
    assert not scene.mesh_nodes


def test_lights_of_the_viewer_are_taken_from_its_class(renderer):
    lights = pyrender.Viewer._create_raymond_lights(pyrender.Viewer)
    direct = pyrender.Viewer._create_direct_light(pyrender.Viewer)
    assert len(lights) == 3
    assert len({*lights, direct}) == 4
    scene = pyrender.Scene(bg_color=(0, 0, 0))
    scene.add(pyrender.Mesh.from_trimesh(SPHERE))
    camera = scene.add(pyrender.PerspectiveCamera(yfov=1.0), pose=at(z=2.0))
    for node in [*lights, direct]:
        node.light.intensity = 2.0
        scene.add_node(node, parent_node=camera)
    assert renderer.render(scene)[0][24, 32].min() > 50


def test_trackball_has_the_pose_of_the_moment_and_that_of_the_press():
    ball = pyrender.trackball.Trackball(at(z=2.0), (64, 48), 1.0)
    before = ball._pose
    ball.down([10, 10])
    ball.drag([30, 20])
    assert ball.pose is ball._n_pose
    np.testing.assert_array_equal(ball._pose, before)
    assert not np.array_equal(ball._n_pose, before)


class Mover(pyrender.Viewer):
    """Moves what it shows as it draws, and tells keys."""

    def on_draw(self):
        self.drawn = getattr(self, "drawn", 0) + 1
        super().on_draw()

    def on_key_press(self, symbol, modifiers):
        super().on_key_press(symbol, modifiers)
        self._message_text = f"key {symbol}"
        self._message_opac = 1.0 + self._ticks_till_fade


def test_subclasses_write_messages_and_draw():
    viewer = Mover(pyrender.Scene(), auto_start=False, viewport_size=(64, 48))
    assert viewer._message_text is None
    viewer.on_key_press(ord("7"), 0)
    assert viewer._message_text == viewer.message == "key 55"
    viewer._message_text = None
    assert viewer.message == ""
    assert not hasattr(viewer, "drawn")
    viewer._is_started = True
    viewer.capture((64, 48))
    assert viewer.drawn == 1
    viewer.close()


def test_viewers_take_what_windows_are_asked():
    viewer = pyrender.Viewer(pyrender.Scene(), auto_start=False, viewport_size=(64, 48))
    assert viewer.get_location() == (0, 0)
    viewer.set_location(7, 9)
    assert viewer.get_location() == (7, 9)
    viewer.set_caption("two")
    assert viewer.caption == "two"
    viewer.switch_to()
    viewer.set_fullscreen(True)
    assert (viewer.get_size(), viewer.width, viewer.height) == ((64, 48), 64, 48)
    assert viewer._window is not None
    viewer.close()
