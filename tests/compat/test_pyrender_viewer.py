"""pyrender's viewer: in a thread, live, with its flags, keys and camera, in a page and a window."""

from __future__ import annotations

import importlib.util
import json
import math
import os
import re
import shutil
import subprocess
import sys
import threading
import time
import urllib.request
from contextlib import contextmanager

import chromium
import numpy as np
import pytest
import trimesh
from PIL import Image

from rasterjit.compat.pyrender import camera as cameras
from rasterjit.compat.pyrender import light as lights
from rasterjit.compat.pyrender import mesh as meshes
from rasterjit.compat.pyrender import node as nodes
from rasterjit.compat.pyrender import scene as pyrender
from rasterjit.compat.pyrender import viewer as viewers
from rasterjit.compat.pyrender.live_view import LiveView, scenes_look_alike
from rasterjit.scene.camera import MatrixCamera, PerspectiveCamera
from rasterjit.viewer import browser, browser_session, notebook, show, terminal, window_probe

PATIENCE = 60.0
"""Seconds for a picture on a loaded machine."""

BOX = trimesh.creation.box()


def at(x=0.0, y=0.0, z=0.0):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def box_scene(**options):
    scene = pyrender.Scene(**options)
    node = scene.add(meshes.Mesh.from_trimesh(BOX), name="box")
    return scene, node


def wait_until(is_so):
    limit = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < limit
        time.sleep(0.01)


class Page:
    """Stands for the server: it shows what it is given until it is stopped, as one page would."""

    def __init__(self):
        self.live_view = None
        self.is_stopped = threading.Event()
        self.events = []
        self.pictures = []
        self.draws = False

    def serve(self, live_view, *, port, on_start):
        self.live_view = live_view
        on_start(self.is_stopped.set)
        while not self.is_stopped.wait(0.01):
            for event in self.events:
                live_view.handle(event)
            self.events.clear()
            live_view.advance(0.01)
            if self.draws and self.stamp != live_view.stamp:
                self.stamp = live_view.stamp
                self.pictures.append(live_view.draw())

    stamp = None


@pytest.fixture
def page(monkeypatch):
    """Show viewers to a page that is not there, and close those that a test leaves."""
    made = Page()
    monkeypatch.setattr(show, "choose_backend", lambda backend: "browser")
    monkeypatch.setattr(browser, "serve", made.serve)
    # Nothing is to wait at the end of the tests.
    monkeypatch.setattr(threading, "_register_atexit", lambda function: None, raising=False)
    yield made
    made.is_stopped.set()


@contextmanager
def viewing(scene, **options):
    """Show a scene in a thread."""
    viewer = viewers.Viewer(scene, run_in_thread=True, **{"viewport_size": (64, 48), **options})
    try:
        yield viewer
    finally:
        viewer.close_external()


def press(viewer, key):
    """Press a key as a canvas tells it."""
    viewer._live_view.handle({"event_type": "key_down", "key": key, "modifiers": ()})


def pose_of(viewer):
    """Return where the viewer's camera is."""
    with viewer.render_lock:
        viewer.capture(viewer.viewport_size)
    return viewer.scene.get_pose(viewer.scene.main_camera_node)


def test_in_a_thread_it_returns_and_is_active_until_it_is_closed(page):
    scene, _ = box_scene()
    prior = scene.add(cameras.PerspectiveCamera(yfov=1.0), pose=at(z=3))
    viewer = viewers.Viewer(scene, (64, 48), run_in_thread=True, use_raymond_lighting=True)
    assert (viewer.is_active, viewer.run_in_thread, viewer.viewport_size) == (True, True, (64, 48))
    assert viewer.scene is scene
    assert scene.main_camera_node is not prior
    wait_until(lambda: len(scene.light_nodes) == 3)
    viewer.close_external()
    assert not viewer.is_active
    assert scene.main_camera_node is prior
    assert (len(scene.nodes), len(scene.light_nodes)) == (2, 0)
    # Twice is no matter.
    viewer.close_external()
    viewer.close()


def test_without_a_thread_it_returns_when_it_is_closed(page):
    scene, _ = box_scene()
    closer = threading.Thread(
        target=lambda: (wait_until(lambda: page.live_view), page.is_stopped.set())
    )
    closer.start()
    viewer = viewers.Viewer(scene, viewport_size=(64, 48))
    closer.join()
    assert not viewer.is_active
    assert len(scene.nodes) == 1


def test_start_may_wait(page):
    scene, _ = box_scene()
    with viewing(scene, auto_start=False) as viewer:
        assert viewer.is_active
        time.sleep(0.1)
        assert page.live_view is None
        viewer.start()
        viewer.start()
        wait_until(lambda: page.live_view is not None)
    assert not viewer.is_active
    never = viewers.Viewer(scene, (64, 48), auto_start=False)
    never.close_external()
    assert (never.is_active, len(scene.nodes)) == (False, 1)


def test_what_belongs_to_opengl_is_not_there_and_said(page):
    scene, _ = box_scene()
    with viewing(scene) as viewer:
        assert not hasattr(viewer, "_renderer")
        with pytest.raises(AttributeError, match="OffscreenRenderer"):
            viewer._renderer.read_color_buf()


def test_flags_are_those_of_pyrender_by_mapping_or_keyword(page):
    scene, _ = box_scene()
    with viewing(
        scene, render_flags={"all_wireframe": True}, viewer_flags={"rotate_rate": 2.0},
        cull_faces=False, lighting_intensity=5.0, window_title="mine", unknown=3,
    ) as viewer:  # fmt: skip
        assert viewer.render_flags == {
            "flip_wireframe": False, "all_wireframe": True, "all_solid": False, "shadows": False,
            "vertex_normals": False, "face_normals": False, "cull_faces": False, "point_size": 1.0,
        }  # fmt: skip
        flags = viewer.viewer_flags
        assert (flags["rotate_rate"], flags["lighting_intensity"]) == (2.0, 5.0)
        assert (flags["window_title"], flags["refresh_rate"]) == ("mine", 30.0)
        assert flags["rotate_axis"].tolist() == [0.0, 0.0, 1.0]
        assert "unknown" not in flags
        viewer.render_flags = {**viewer.render_flags, "all_wireframe": False}
        wait_until(lambda: page.live_view is not None and page.live_view.scene.wireframe is None)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(("scene",), "scene must be a Scene"), ((None, (0, 4)), "scene must be")],
)
def test_what_is_no_scene_is_refused(page, arguments, message):
    with pytest.raises(ValueError, match=message):
        viewers.Viewer(*arguments)


def test_size_that_is_none_is_refused_and_the_scene_stays(page):
    scene, _ = box_scene()
    with pytest.raises(ValueError, match="viewport_size"):
        viewers.Viewer(scene, viewport_size=(0, 48))
    assert len(scene.nodes) == 1


def test_picture_follows_the_program(page):
    scene, box = box_scene(ambient_light=[1.0, 1.0, 1.0], bg_color=[0.0, 0.0, 0.0])
    scene.add(cameras.PerspectiveCamera(yfov=1.0), pose=at(z=5))
    page.draws = True

    def middle():
        """Return the mean column of what is brighter than the background."""
        lit = page.pictures[-1][:, :, 0] > 40 if page.pictures else np.zeros((1, 1), bool)
        return np.nonzero(lit)[1].mean() if lit.any() else math.nan

    with viewing(scene) as viewer:
        wait_until(lambda: abs(middle() - 31.5) < 1.5)
        with viewer.render_lock:
            scene.set_pose(box, at(x=1.0))
        wait_until(lambda: middle() > 36.0)
        with viewer.render_lock:
            scene.remove_node(box)
        # A scene of nothing is shown, too.
        wait_until(lambda: math.isnan(middle()))
        with viewer.render_lock:
            scene.add(meshes.Mesh.from_trimesh(BOX), pose=at(x=-1.0))
        wait_until(lambda: middle() < 27.0)
        with viewer.render_lock:
            scene.bg_color = [1.0, 0.0, 0.0]
        wait_until(lambda: page.pictures[-1][0, 0].tolist() == [255, 0, 0, 255])


def test_nothing_is_drawn_anew_where_nothing_changes(page):
    scene, _ = box_scene()
    scene.add(meshes.Mesh.from_points(BOX.vertices))
    with viewing(scene) as viewer:
        wait_until(lambda: page.live_view is not None)
        live_view = page.live_view
        wait_until(lambda: not live_view.is_moving)
        version = live_view.version
        time.sleep(0.3)
        assert live_view.version == version
        first, second = viewer.capture((64, 48)), viewer.capture((64, 48))
        # Points are made anew for each snapshot.
        assert first.scene.nodes[1].mesh is not second.scene.nodes[1].mesh
        assert scenes_look_alike(first.scene, second.scene)


def test_program_that_holds_the_scene_is_not_waited_for(page):
    scene, _ = box_scene()
    with viewing(scene) as viewer:
        wait_until(lambda: page.live_view is not None)
        with viewer.render_lock:
            began = time.monotonic()
            done = []
            thread = threading.Thread(target=lambda: done.append(page.live_view._update()))
            thread.start()
            thread.join(PATIENCE)
            assert done == [None]
            assert time.monotonic() - began < PATIENCE / 2


def test_program_that_holds_the_scene_may_close_it(page):
    scene, _ = box_scene()
    with viewing(scene) as viewer, viewer.render_lock:
        viewer.close_external()
        assert not viewer.is_active
    assert len(scene.nodes) == 1


def test_lights_of_the_viewer_move_with_its_camera(page):
    scene, _ = box_scene()
    scene.add(cameras.PerspectiveCamera(yfov=1.0), pose=at(z=3))
    with viewing(scene, use_direct_lighting=True, lighting_intensity=4.0) as viewer:
        with viewer.render_lock:
            snapshot = viewer.capture((64, 48))
        (node,) = scene.light_nodes
        assert node.light.intensity == 4.0
        np.testing.assert_allclose(scene.get_pose(node), at(z=3), atol=1e-12)
        np.testing.assert_allclose(
            snapshot.scene.lights[-1].direction, [0.0, 0.0, -1.0], atol=1e-12
        )
        viewer.viewer_flags["use_raymond_lighting"] = True
        viewer.viewer_flags["use_direct_lighting"] = False
        with viewer.render_lock:
            snapshot = viewer.capture((64, 48))
        assert [one.light.intensity for one in scene.light_nodes] == [4.0 / 3.0] * 3
        found = np.array([light.direction for light in snapshot.scene.lights[-3:]])
        np.testing.assert_allclose(found[:, 2], -math.cos(math.pi / 6))


def test_scene_without_lights_has_a_headlight(page):
    scene, _ = box_scene()
    with viewing(scene) as viewer, viewer.render_lock:
        half = 1.0 / math.sqrt(2.0)
        *_, light = viewer.capture((64, 48)).scene.lights
        np.testing.assert_allclose(light.direction, [-half, 0.0, -half], atol=1e-12)
        scene.add(lights.DirectionalLight())
        (light,) = viewer.capture((64, 48)).scene.lights[1:]
        np.testing.assert_allclose(light.direction, [0.0, 0.0, -1.0], atol=1e-12)


def test_camera_begins_where_that_of_the_scene_is_and_has_its_lens(page):
    scene, _ = box_scene()
    scene.add(cameras.PerspectiveCamera(yfov=math.pi / 3, znear=0.2), pose=at(1.0, 2.0, 3.0))
    with viewing(scene) as viewer, viewer.render_lock:
        camera = viewer.capture((64, 48)).camera
        assert isinstance(camera, PerspectiveCamera)
        assert (tuple(camera.eye), camera.near) == ((1.0, 2.0, 3.0), 0.2)
        assert camera.fov_y == pytest.approx(60.0)


def test_camera_of_a_scene_without_one_stands_as_pyrenders(page):
    scene, _ = box_scene()
    with viewing(scene) as viewer:
        distance = math.sqrt(3.0) / (2.0 * math.tan(math.pi / 6.0))
        half = 1.0 / math.sqrt(2.0)
        expected = np.eye(4)
        expected[:3] = [
            [0.0, -half, half, distance], [1.0, 0.0, 0.0, 0.0], [0.0, half, half, distance]
        ]  # fmt: skip
        np.testing.assert_allclose(pose_of(viewer), expected, atol=1e-12)


@pytest.mark.parametrize(
    "camera",
    [cameras.OrthographicCamera(2.0, 1.0), cameras.IntrinsicsCamera(50.0, 50.0, 30.0, 20.0)],
)
def test_other_lenses_are_looked_through_as_they_are(page, camera):
    scene, _ = box_scene()
    scene.add(camera, pose=at(z=3))
    is_parallel = isinstance(camera, cameras.OrthographicCamera)
    with viewing(scene, use_perspective_cam=not is_parallel) as viewer, viewer.render_lock:
        found = viewer.capture((64, 48)).camera
        assert isinstance(found, MatrixCamera)
        np.testing.assert_array_equal(found.clip_from_view, camera.get_projection_matrix(64, 48))


def test_page_is_told_where_any_lens_is(page):
    scene, _ = box_scene()
    scene.add(cameras.OrthographicCamera(2.0, 1.0), pose=at(1.0, 2.0, 3.0))
    with viewing(scene, use_perspective_cam=False) as viewer, viewer.render_lock:
        found = viewer.capture((64, 48)).camera
        places = [found.eye.tolist(), found.target.tolist(), found.up.tolist()]
        assert places == [[1.0, 2.0, 3.0], [1.0, 2.0, 2.0], [0.0, 1.0, 0.0]]
        assert found.fov_y == pytest.approx(90.0)
        viewer._live_view.look_from(PerspectiveCamera((0, 0, 5), (0, 0, 0)))
    np.testing.assert_allclose(viewer._trackball.pose, at(z=5.0), atol=1e-12)


def test_text_beside_pictures_says_the_keys_and_messages_of_pyrender(page):
    scene, _ = box_scene()
    with viewing(scene) as viewer:
        live_view = viewer._live_view
        live_view.writes_text = False
        told = browser_session.make_welcome_message(live_view)
        assert (told["help_key"], told["has_usual_keys"]) == ("?", False)
        assert terminal.format_key_line(live_view, 80) == " Q end  ? help"
        press(viewer, "?")
        assert terminal.get_panel(live_view) == live_view.help_rows
        press(viewer, "h")
        assert viewer.render_flags["shadows"]
        assert live_view.line.startswith("Shadows On   Scene Viewer")
        assert live_view.shows_line


def test_object_that_a_page_hides_takes_its_light_with_it(page):
    scene, box = box_scene(ambient_light=[0.5, 0.5, 0.5])
    scene.add(meshes.Mesh.from_trimesh(BOX), pose=at(x=2.0))
    scene.add(cameras.PerspectiveCamera(yfov=1.0), pose=at(z=5.0))
    with viewing(scene) as viewer:
        live_view = viewer._live_view.twin()
        names = [node.name for node in live_view.scene.nodes]
        live_view.set_hidden([names.index("box")])
        hidden = live_view.draw()
        with viewer.render_lock:
            scene.remove_node(box)
        live_view.set_hidden([])
        live_view._update()
        np.testing.assert_array_equal(live_view.draw(), hidden)
        live_view.close()


def test_effects_that_pyrender_does_not_have_are_refused_in_a_line(page):
    scene, _ = box_scene(ambient_light=[0.5, 0.5, 0.5])
    scene.add(cameras.PerspectiveCamera(yfov=1.0), pose=at(z=5.0))
    with viewing(scene) as viewer:
        live_view = viewer._live_view.twin()
        before, look = live_view.draw().copy(), live_view.look
        for changed in ({"switched": ("vignette",)}, {"modes": {"p": "x"}}):
            live_view.set_look(**{"kind": "color", "switched": (), "modes": {}, **changed})
            assert "as in pyrender" in live_view.line
            assert live_view.look == look
            np.testing.assert_array_equal(live_view.draw(), before)
        live_view.close()


def test_it_turns_by_itself_around_its_axis_at_its_rate(page):
    scene, _ = box_scene()
    scene.add(cameras.PerspectiveCamera(yfov=1.0), pose=at(z=3))
    axis = np.array([0.0, 1.0, 0.0])
    with viewing(scene, rotate=True, rotate_rate=1.0, rotate_axis=axis) as viewer:
        began = time.monotonic()
        wait_until(lambda: time.monotonic() - began > 0.5)
        x, y, z = pose_of(viewer)[:3, 3]
        turned, passed = math.atan2(x, z), time.monotonic() - began
        assert math.hypot(x, z) == pytest.approx(3.0)
        assert y == pytest.approx(0.0, abs=1e-9)
        assert 0.1 < turned < 1.5 * passed + 0.1
        viewer.viewer_flags["mouse_pressed"] = True
        time.sleep(0.1)
        still = pose_of(viewer)
        time.sleep(0.1)
        np.testing.assert_array_equal(pose_of(viewer), still)


def test_mouse_turns_pans_zooms_and_rolls(page):
    scene, _ = box_scene()
    scene.add(cameras.PerspectiveCamera(yfov=1.0), pose=at(z=3))

    def drag(button, *modifiers):
        held = {"button": button, "modifiers": modifiers}
        for kind, x, y in (("down", 32, 12), ("move", 42, 18), ("up", 42, 18)):
            live_view.handle({"event_type": f"pointer_{kind}", "x": x, "y": y, **held})
        found = pose_of(viewer)
        press(viewer, "z")
        np.testing.assert_allclose(pose_of(viewer), at(z=3), atol=1e-12)
        return found

    with viewing(scene) as viewer:
        live_view = viewer._live_view
        turned = drag(1)
        assert np.linalg.norm(turned[:3, 3]) == pytest.approx(3.0)
        # A drag to the right turns what is seen to the right.
        assert turned[0, 3] < -0.5
        for panned in (drag(3), drag(1, "Shift")):
            np.testing.assert_allclose(panned[:3, :3], np.eye(3), atol=1e-12)
            assert panned[0, 3] < -0.1
            assert panned[2, 3] == pytest.approx(3.0)
        zoomed = drag(2)
        assert zoomed[:2, 3].tolist() == [0.0, 0.0]
        assert zoomed[2, 3] != pytest.approx(3.0)
        rolled = drag(1, "Control")
        np.testing.assert_allclose(rolled[:3, 3], [0.0, 0.0, 3.0], atol=1e-12)
        assert abs(rolled[0, 1]) > 0.1
        live_view.handle({"event_type": "wheel", "x": 0, "y": 0, "dx": 0.0, "dy": -100.0})
        np.testing.assert_allclose(pose_of(viewer), at(z=2.7), atol=1e-12)


@pytest.mark.parametrize("is_perspective", [True, False])
def test_f_fits_the_scene(page, is_perspective):
    scene, _ = box_scene(ambient_light=[1.0, 1.0, 1.0], bg_color=[0.0, 0.0, 0.0])
    lens = cameras.PerspectiveCamera(1.0) if is_perspective else cameras.OrthographicCamera(9, 9)
    scene.add(lens, pose=at(x=20.0, z=30.0))
    with viewing(scene, use_perspective_cam=is_perspective) as viewer:
        press(viewer, "f")
        live_view = viewer._live_view.twin()
        lit = live_view.draw()[:, :, 0] > 40
        live_view.close()
        rows, columns = (np.nonzero(lit.any(axis=axis))[0] for axis in (1, 0))
        assert rows.min() > 0
        assert rows.max() < 47
        assert rows.max() - rows.min() > 20
        assert columns.mean() == pytest.approx(31.5, abs=1.0)
        np.testing.assert_array_equal(pose_of(viewer)[:3, :3], np.eye(3))


def test_registered_keys_call_their_functions(page):
    scene, _ = box_scene()
    called = []

    def note(viewer, *arguments, **options):
        called.append((viewer, arguments, options))

    keys = {"B": note, "t": (note, [1, 2]), "z": (note, [3], {"x": 4}), "y": [note]}
    with viewing(scene, registered_keys=keys) as viewer:
        assert set(viewer.registered_keys) == {ord(key) for key in "btzy"}
        for key in "btzyT":
            press(viewer, key)
        expected = [((), {}), ((1, 2), {}), ((3,), {"x": 4}), ((), {}), ((1, 2), {})]
        assert called == [(viewer, *one) for one in expected]
        # A function may change the scene.
        viewer.registered_keys = {
            ord("b"): lambda one: one.scene.set_pose(one.scene._list_nodes()[0], at(9))
        }
        press(viewer, "b")
        assert viewer._live_view.scene.nodes[0].transform[0, 3] == 9.0


def test_error_of_a_registered_key_ends_it_and_is_raised(page):
    scene, _ = box_scene()

    def fail(viewer):
        raise KeyError("mine")

    page.events.append({"event_type": "key_down", "key": "b", "modifiers": ()})
    with pytest.raises(KeyError, match="mine"):
        viewers.Viewer(scene, (64, 48), registered_keys={"b": fail})
    assert len(scene.nodes) == 1


def test_keys_switch_what_they_do_in_pyrender(page, tmp_path):
    scene, _ = box_scene()
    scene.add(cameras.PerspectiveCamera(yfov=1.0), pose=at(z=3))
    with viewing(scene, save_directory=str(tmp_path)) as viewer:
        render, view = viewer.render_flags, viewer.viewer_flags
        for key, flags, name in (
            ("a", view, "rotate"), ("c", render, "cull_faces"), ("h", render, "shadows"),
            ("o", view, "use_perspective_cam"),
        ):  # fmt: skip
            before = flags[name]
            press(viewer, key)
            assert flags[name] is not before
            press(viewer, key)
            assert flags[name] is before
        names = "flip_wireframe", "all_wireframe", "all_solid"
        seen = []
        for _ in range(4):
            press(viewer, "w")
            seen.append([render[name] for name in names])
        assert seen == [
            [True, False, False], [False, True, False], [False, False, True], [False] * 3
        ]  # fmt: skip
        for raymond, direct in ((True, False), (False, True), (False, False)):
            press(viewer, "l")
            found = view["use_raymond_lighting"], view["use_direct_lighting"]
            assert found == (raymond, direct)
        for world, each, count in ((1, 0, 2), (0, 1, 2), (1, 1, 3), (0, 0, 1)):
            press(viewer, "i")
            assert (view["show_world_axis"], view["show_mesh_axes"]) == (bool(world), bool(each))
            assert len(scene.mesh_nodes) == count
        press(viewer, "s")
        with Image.open(tmp_path / "view.png") as picture:
            assert picture.size == (64, 48)
        assert "saved" in viewer.message
        press(viewer, "q")
        assert not viewer.is_active
    assert len(scene.nodes) == 2


def test_keys_of_our_viewer_that_pyrender_has_none_for_stay(page):
    scene, _ = box_scene()
    with viewing(scene) as viewer:
        press(viewer, "2")
        assert viewer._live_view.kind == "depth"
        press(viewer, "?")
        assert viewer._live_view._shows_help


def test_recording_lasts_as_long_as_it_took(page, tmp_path):
    scene, box = box_scene(ambient_light=[1.0, 1.0, 1.0], bg_color=[0.0, 0.0, 0.0])
    scene.add(cameras.PerspectiveCamera(yfov=1.0), pose=at(z=5))
    with viewing(scene, record=True, refresh_rate=20.0) as viewer:
        wait_until(lambda: viewer._saved_frames)
        began = time.monotonic()
        for step in range(8):
            with viewer.render_lock:
                scene.set_pose(box, at(x=0.25 * step))
            time.sleep(0.1)
        passed = time.monotonic() - began
    assert viewer._saved_frames[0].shape == (48, 64, 3)
    path = tmp_path / "turn.gif"
    viewer.save_gif(str(path))
    assert viewer._saved_frames == []
    with Image.open(path) as picture:
        length = picture.n_frames * picture.info["duration"] / 1000.0
        first = np.asarray(picture.convert("RGB"))
        picture.seek(picture.n_frames - 1)
        last = np.asarray(picture.convert("RGB"))
    assert 0.5 * passed < length < 2.0 * passed + 1.0
    columns = [np.nonzero(one[:, :, 0] > 40)[1].mean() for one in (first, last)]
    assert columns[1] > columns[0] + 5.0
    # Nothing was recorded since.
    viewer.save_gif(tmp_path / "none.gif")
    assert not (tmp_path / "none.gif").exists()


def test_recording_without_a_name_goes_to_a_new_file(page, tmp_path):
    scene, _ = box_scene()
    with viewing(scene, save_directory=str(tmp_path)) as viewer:
        for name in ("recording.gif", "recording-1.gif"):
            press(viewer, "r")
            wait_until(lambda: viewer._saved_frames)
            press(viewer, "r")
            assert (tmp_path / name).exists()


def test_pages_share_the_camera_and_have_their_own_size(page):
    scene, _ = box_scene()
    with viewing(scene) as viewer:
        twin = viewer._live_view.twin()
        assert isinstance(twin, LiveView)
        twin.resize((40, 30))
        assert (twin.draw().shape, viewer._live_view.draw().shape) == ((30, 40, 4), (48, 64, 4))
        twin.handle({"event_type": "wheel", "x": 0, "y": 0, "dx": 0.0, "dy": -100.0})
        viewer._live_view.advance(1.0)
        wait_until(lambda: viewer._live_view._update() or viewer._live_view.camera == twin.camera)
        twin.close()
        assert viewer.is_active


def test_notebook_goes_on_at_once_and_is_shown(monkeypatch):
    display = pytest.importorskip("IPython.display")
    scene, _ = box_scene()
    shown, closed = [], []

    class Widget:
        def close(self):
            closed.append("widget")

    monkeypatch.setattr(show, "choose_backend", lambda backend: "notebook")
    monkeypatch.setattr(
        notebook, "make_widget", lambda live_view: closed.append(live_view) or Widget()
    )
    monkeypatch.setattr(display, "display", shown.append)
    for run_in_thread in (False, True):
        viewer = viewers.Viewer(scene, (64, 48), run_in_thread=run_in_thread)
        assert viewer.is_active
        if run_in_thread:
            viewer.close_external()
            assert closed[-1] == "widget"
        else:
            closed[-1].close()
        assert not viewer.is_active
    assert [type(one) for one in shown] == [Widget, Widget]


@pytest.mark.parametrize(
    ("toolkit", "platform", "expected"),
    [
        ("glfw", "linux", "window"), ("PySide6", "linux", "browser"), ("glfw", "darwin", "browser"),
    ],
)  # fmt: skip
def test_thread_has_windows_of_glfw_alone(monkeypatch, toolkit, platform, expected):
    scene, _ = box_scene()
    ran = []
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(show, "choose_backend", lambda backend: "window")
    monkeypatch.setattr(window_probe, "find_toolkit", lambda: (toolkit, ""))
    monkeypatch.setattr(viewers, "_WINDOW_LOCK", threading.Lock())
    monkeypatch.setattr(viewers.Viewer, "_run_backend", lambda self, backend: ran.append(backend))
    for run_in_thread in (True, False):
        viewer = viewers.Viewer(scene, (64, 48), run_in_thread=run_in_thread)
        wait_until(lambda: len(ran) == 2 - run_in_thread)  # noqa: B023
        viewer.end()
    # A second one beside a window is a page.
    assert ran == [expected, "browser" if expected == "window" else "window"]


def test_nodes_that_the_viewer_adds_are_its_own(page):
    scene, box = box_scene()
    child = nodes.Node(name="child")
    scene.add_node(child, box)
    with viewing(scene, show_world_axis=True, show_mesh_axes=True, use_direct_lighting=True):
        assert len(scene.nodes) >= 5
    assert scene.nodes == {box, child}
    assert box.children == [child]


PROGRAM = """
import sys, time
import numpy as np, trimesh
import rasterjit.compat.pyrender as pyrender

scene = pyrender.Scene(ambient_light=[1.0, 1.0, 1.0], bg_color=[0.0, 0.0, 0.0])
box = scene.add(pyrender.Mesh.from_trimesh(trimesh.creation.box()))
scene.add(pyrender.PerspectiveCamera(yfov=1.0), pose=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5.0],
                                                      [0, 0, 0, 1]])

def hit(viewer, *arguments):
    print("hit", *arguments, flush=True)
    pose = np.eye(4)
    pose[0, 3] = 1.5
    viewer.scene.set_pose(box, pose)

viewer = pyrender.Viewer(scene, (320, 240), run_in_thread=True, window_title="mine",
                         registered_keys={"b": (hit, [1, 2])})
print("goes on", flush=True)
"""

WAITS = PROGRAM + "while viewer.is_active: time.sleep(0.1)\nprint('closed', flush=True)\n"


@contextmanager
def started(program, *under, **variables):
    """Run a program that shows a viewer."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", **variables}
    process = subprocess.Popen(
        [*under, sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, env=environment,
    )  # fmt: skip
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def line_with(process, what):
    """Return the next line that holds something."""
    for line in process.stdout:
        if what in line:
            return line
    raise AssertionError(what)


def lit_columns(picture):
    return np.nonzero((picture.min(axis=2) > 60) & (np.ptp(picture, axis=2) < 8))[1]


@pytest.mark.takes_long
@pytest.mark.needs_jit
def test_page_follows_the_program_and_its_keys(tmp_path):
    path = chromium.program()
    if path is None:
        assert not os.environ.get("CI")
        pytest.skip("no Chromium")
    nowhere = {"DISPLAY": "", "WAYLAND_DISPLAY": "", "XDG_CACHE_HOME": str(tmp_path / "cache")}
    with (
        started(WAITS, **nowhere) as process,
        chromium.chromium(path, tmp_path / "profile") as page,
    ):
        said = line_with(process, "http://")
        assert "Ctrl-C ends it" in said
        page.open(re.search(r"http://\S+/", said)[0], 640)

        def place():
            found = lit_columns(page.screenshot(tmp_path / "page.png")[100:700, 100:540])
            return found.mean() + 100.0 if len(found) > 500 else math.nan

        wait_until(lambda: abs(place() - 320.0) < 20.0)
        for kind in ("keyDown", "keyUp"):
            text = "b" if kind == "keyDown" else ""
            page.call("Input.dispatchKeyEvent", type=kind, key="b", text=text)
        assert line_with(process, "hit") == "hit 1 2\n"
        wait_until(lambda: place() > 340.0)
        # H is a key of pyrender's; the page takes it for help only where it is.
        for key, told in (("h", "Shadows On"), ("i", "World Axis On")):
            for kind in ("keyDown", "keyUp"):
                text = key if kind == "keyDown" else ""
                page.call("Input.dispatchKeyEvent", type=kind, key=key, text=text)
            line = "document.getElementById('line')"
            wait_until(lambda: told in page.evaluate(f"{line}.textContent"))  # noqa: B023
        assert page.evaluate("help.hidden && !line.hidden && window['measure-costs'].hidden")
        for kind in ("keyDown", "keyUp"):
            text = "q" if kind == "keyDown" else ""
            page.call("Input.dispatchKeyEvent", type=kind, key="q", text=text)
        assert line_with(process, "closed")
        assert process.wait(PATIENCE) == 0


@pytest.mark.takes_long
@pytest.mark.parametrize("ending", ["", "raise SystemError('mine')\n"])
def test_end_of_the_program_waits_for_ctrl_c_and_an_error_for_nothing(tmp_path, ending):
    nowhere = {"DISPLAY": "", "WAYLAND_DISPLAY": "", "XDG_CACHE_HOME": str(tmp_path)}
    with started(PROGRAM + ending, **nowhere) as process:
        line_with(process, "http://")
        if ending:
            assert process.wait(PATIENCE) == 1
        else:
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(2.0)
            process.send_signal(2)
            assert process.wait(PATIENCE) == 0


@pytest.mark.takes_long
def test_ctrl_c_ends_a_viewer_without_a_thread_and_the_program_goes_on(tmp_path):
    blocks = PROGRAM.replace("run_in_thread=True", "run_in_thread=False")
    nowhere = {"DISPLAY": "", "WAYLAND_DISPLAY": "", "XDG_CACHE_HOME": str(tmp_path)}
    with started(blocks, **nowhere) as process:
        address = re.search(r"http://\S+", line_with(process, "http://"))[0]
        # It listens before the server runs, which answers nobody until then.
        with urllib.request.urlopen(address, timeout=PATIENCE) as answer:
            assert answer.status == 200
        process.send_signal(2)
        said, error = process.communicate(timeout=PATIENCE)
    assert (process.returncode, said.splitlines()[-1], error) == (0, "goes on", "")


WINDOW = WAITS.replace(
    'print("goes on", flush=True)',
    """
import json, subprocess, threading
from PIL import ImageGrab

def xdotool(*arguments):
    return subprocess.run(["xdotool", *arguments], capture_output=True, text=True).stdout.split()

def column():
    found = np.asarray(ImageGrab.grab(xdisplay="").convert("RGB"))
    return np.nonzero(found.min(axis=2) > 60)[1]

def until(is_so):
    limit = time.monotonic() + 120.0
    while not is_so() and time.monotonic() < limit:
        time.sleep(0.1)

def act():
    until(lambda: xdotool("search", "--name", "mine"))
    window = xdotool("search", "--name", "mine")[0]
    until(lambda: len(column()) > 500)
    before = column().mean()
    xdotool("key", "--window", window, "b")
    until(lambda: column().mean() > before + 20)
    print(json.dumps([before, column().mean()]), flush=True)
    xdotool("mousemove", "--window", window, "160", "120")
    pose = scene.get_pose(scene.main_camera_node).copy()
    xdotool("mousedown", "1", "mousemove_relative", "40", "5", "mouseup", "1")
    until(lambda: abs(scene.get_pose(scene.main_camera_node) - pose).max() > 0.1)
    print(json.dumps(abs(scene.get_pose(scene.main_camera_node) - pose).max()), flush=True)
    xdotool("key", "--window", window, "q")

threading.Thread(target=act, daemon=True).start()
print("goes on", flush=True)
""",
)


@pytest.mark.takes_long
@pytest.mark.needs_jit
def test_window_in_a_thread_follows_the_program_its_keys_and_the_mouse(tmp_path):
    missing = [name for name in ("xvfb-run", "xdotool") if shutil.which(name) is None]
    if missing or importlib.util.find_spec("glfw") is None:
        assert not os.environ.get("CI"), missing
        pytest.skip(f"needs {missing or 'glfw'}")
    under = "xvfb-run", "-a", "-s", "-screen 0 400x300x24"
    with started(WINDOW, *under, XDG_CACHE_HOME=str(tmp_path)) as process:
        line_with(process, "goes on")
        assert line_with(process, "hit") == "hit 1 2\n"
        before, after = json.loads(line_with(process, "["))
        assert before == pytest.approx(160.0, abs=15.0)
        assert after > before + 20.0
        assert json.loads(next(process.stdout)) > 0.1
        assert line_with(process, "closed")
        assert process.wait(PATIENCE) == 0
