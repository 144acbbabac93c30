"""The viewer without a window: events in, pictures out."""

from __future__ import annotations

import importlib.util
import inspect
import math
import re
import threading
import time

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.cli.commands import program
from rasterjit.inspect import pixel
from rasterjit.rendering import quality_selection
from rasterjit.rendering import renderer as rendering
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.rendering.quality_selection import LADDER
from rasterjit.rendering.renderer import Renderer
from rasterjit.runtime.clocks import COMPILE_CLOCK
from rasterjit.viewer import effect_switches
from rasterjit.viewer import viewer as viewing
from rasterjit.viewer.controls import Fly
from rasterjit.viewer.overlay import as_rows, mark_pixel, to_picture, write_panel
from rasterjit.viewer.viewer import HELP_ROWS, MAX_STEP_SECONDS, Viewer

SIZE = (40, 30)
BOTH = "color", "depth"
DRAFT, REFERENCE = viewing.PREVIEW, rj.Quality.reference()


@pytest.fixture(autouse=True)
def _patient(monkeypatch):
    """No picture takes too long, however loaded the machine is."""
    monkeypatch.setattr(viewing, "MAX_OVERRUN", math.inf)


@pytest.fixture
def viewer(cube, monkeypatch):
    """A viewer whose dial never comes to know anything: what moves is a draft."""
    monkeypatch.setattr(quality_selection.FrameTimes, "calibrate", lambda *_: iter(()))
    viewer = Viewer(cube, size=SIZE)
    yield viewer
    viewer.close()


def key(viewer, name):
    for kind in ("key_down", "key_up"):
        viewer.handle({"event_type": kind, "key": name})


def pointer(viewer, kind, x, y):
    viewer.handle({"event_type": f"pointer_{kind}", "x": x, "y": y, "button": 1, "modifiers": ()})


def drag(viewer):
    pointer(viewer, "down", 5, 5)
    pointer(viewer, "move", 15, 9)
    viewer.advance(0.02)


def settle(viewer):
    while viewer.is_moving:
        viewer.advance(0.05)


def rendered(viewer, quality):
    return rj.render(viewer.shown, viewer.camera, size=viewer.size, quality=quality).color


def test_moving_is_a_draft_and_rest_ends_in_the_reference(viewer):
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, DRAFT))
    drag(viewer)
    assert viewer.is_moving
    assert not viewer.step()
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, DRAFT))
    settle(viewer)
    steps = 0
    while viewer.step():
        steps += 1
        assert not viewer.is_done
    assert steps == 5
    assert viewer.is_done
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, REFERENCE))


def test_dragging_shows_what_the_controls_foretell(viewer):
    foretold = viewer.controls
    for kind, x, y in (("down", 5, 5), ("move", 12, 8), ("up", 12, 8)):
        pointer(viewer, kind, x, y)
        event = {"event_type": f"pointer_{kind}", "x": x, "y": y, "button": 1}
        foretold = foretold.handle(event, SIZE)
    settle(viewer)
    assert viewer.camera == foretold.at_rest().camera()
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, DRAFT))


def test_what_moves_ends_the_step_that_runs(viewer, monkeypatch):
    viewer.draw()
    assert viewer.step()
    assert viewer.step()
    find = rendering.find_visible
    drawn = []

    def moving(*arguments, **options):
        drawn.append(1)
        if len(drawn) == 1:
            key(viewer, "ArrowLeft")
            viewer.version += 1
        return find(*arguments, **options)

    monkeypatch.setattr(rendering, "find_visible", moving)
    before = viewer.draw().copy()
    drawn.clear()
    assert not viewer.step()
    assert len(drawn) == 1
    assert not viewer.is_done
    viewer._frame_version = viewer.version
    np.testing.assert_array_equal(viewer.draw(), before)


def test_explanation_of_a_picture_that_is_gone_is_not_shown(viewer, monkeypatch):
    explain = pixel.explain_pixel
    meanwhile = []

    def slow(*arguments, **options):
        told = explain(*arguments, **options)
        meanwhile.pop()()
        return told

    def drag():
        pointer(viewer, "down", 5, 5)
        pointer(viewer, "move", 25, 9)
        pointer(viewer, "up", 25, 9)
        settle(viewer)

    monkeypatch.setattr(viewing, "explain_pixel", slow)
    viewer.pick(20, 15)
    meanwhile[:] = [drag]
    assert viewer.step()
    assert viewer.explanation is None
    while viewer.step():
        pass
    assert viewer.explanation is None
    # Where only the work begins anew, the same pixel is explained after all.
    viewer.pick(20, 15)
    meanwhile[:] = [lambda: None, lambda: key(viewer, "m")]
    assert viewer.step()
    assert viewer.explanation is None
    assert viewer.step()
    assert (viewer.explanation.x, viewer.explanation.y) == (20, 15)


def test_question_at_rest_leaves_the_picture_as_good_as_it_was(viewer):
    for _ in range(4):
        assert viewer.step()
    half = viewer._frame.plan.pictures
    assert half > 1
    viewer.pick(20, 15)
    while viewer.explanation is None:
        assert viewer.step()
    while viewer.step():
        assert viewer._frame.plan.pictures >= half
    assert viewer.is_done
    reference = rendered(viewer, REFERENCE)
    np.testing.assert_array_equal(viewer.picture(), reference)
    # What is as good as it gets is not drawn again.
    frame = viewer._frame
    viewer.pick(5, 5)
    assert not viewer.is_done
    assert viewer.step()
    assert (viewer.explanation.x, viewer.explanation.y) == (5, 5)
    assert not viewer.step()
    assert viewer.is_done
    key(viewer, "m")
    assert viewer.step()
    assert viewer.costs
    assert not viewer.step()
    assert viewer._frame is frame
    # What changes is drawn anew.
    key(viewer, "+")
    settle(viewer)
    while viewer.step():
        pass
    np.testing.assert_array_equal(viewer.picture(), rendered(viewer, REFERENCE))
    assert not np.array_equal(viewer.picture(), reference)


def test_costs_are_measured_whatever_is_shown(viewer):
    key(viewer, "2")
    key(viewer, "m")
    while viewer.step():
        pass
    assert viewer.is_done
    assert "frame" in viewer.costs


def test_view_of_an_address_returns_to_where_the_scene_fits(cube):
    for fly in (False, True):
        viewer, other = Viewer(cube, size=SIZE), Viewer(cube, size=(20, 60))
        if fly:
            key(viewer, "c")
        eye = 1.0, 2.0, 3.0
        viewer.look_from(rj.PerspectiveCamera(eye, (0, 0, 0), fov_y=30.0))
        viewer.resize((20, 60))
        assert viewer.camera.eye == pytest.approx(eye)
        key(viewer, "r")
        settle(viewer)
        assert viewer.camera.eye == pytest.approx(other.camera.eye)
        viewer.close()
        other.close()


def test_costs_of_a_scene_that_is_gone_are_not_shown(viewer, monkeypatch):
    measure = effect_switches.measure_costs

    def slow(*arguments):
        monkeypatch.setattr(effect_switches, "measure_costs", measure)
        found = measure(*arguments)
        key(viewer, "k")
        return found

    key(viewer, "m")
    monkeypatch.setattr(effect_switches, "measure_costs", slow)
    while effect_switches.measure_costs is slow:
        assert viewer.step()
    assert viewer.costs is None
    while viewer.step():
        pass
    assert set(viewer.costs) == {"frame", "outline"}


def test_frame_of_a_picture_that_is_gone_never_takes_the_place_of_another(cube):
    class Watched(Viewer):
        """Has another thread change and draw the picture between looking and keeping."""

        other = None

        @property
        def version(self):
            seen = self._seen_version
            if self.other is not None and threading.current_thread() is not self.other:
                other, self.other = self.other, None
                other.start()
                other.join(0.3)
            return seen

        @version.setter
        def version(self, value):
            self._seen_version = value

    def change():
        key(viewer, "3")
        viewer.draw()

    viewer = Watched(cube, size=SIZE)
    old = rj.render(cube, viewer.camera, size=SIZE, quality=DRAFT)
    viewer.other = other = threading.Thread(target=change)
    viewer._store_frame(old, 0, 0.1)
    other.join()
    assert viewer.version == viewer._frame_version == 1
    viewer.close()


def test_a_draft_that_is_slower_than_a_step_is_not_shown(viewer, monkeypatch):
    draw = viewer._draw_moving

    def draw_slowly():
        frame = draw()
        while viewer.step():
            pass
        return frame

    monkeypatch.setattr(viewer, "_draw_moving", draw_slowly)
    key(viewer, "3")
    frame = rj.render(viewer.scene, viewer.camera, size=SIZE, outputs=("normal", "depth"))
    for _ in range(2):
        np.testing.assert_array_equal(viewer.draw(), to_picture(frame, "normal"))


def test_drawing_shows_its_own_frame_whatever_comes_meanwhile(viewer, monkeypatch):
    viewer.draw()
    old, keep = viewer._frame, viewer._store_frame

    def late(frame, version, *seconds, **options):
        kept = keep(frame, version, *seconds, **options)
        viewer._frame = old
        return kept

    monkeypatch.setattr(viewer, "_store_frame", late)
    key(viewer, "3")
    frame = rj.render(
        viewer.scene, viewer.camera, size=SIZE, quality=DRAFT, outputs=("normal", "depth")
    )
    np.testing.assert_array_equal(viewer.draw(), to_picture(frame, "normal"))


@pytest.mark.parametrize(
    ("name", "kind"),
    [("2", "depth"), ("3", "normal"), ("4", "object_id"), ("5", "face_id"), ("1", "color")],
)
def test_number_keys_show_the_buffers(viewer, name, kind):
    key(viewer, name)
    outputs = {"color", "depth", kind}
    frame = rj.render(viewer.scene, viewer.camera, size=SIZE, quality=DRAFT, outputs=tuple(outputs))
    np.testing.assert_array_equal(viewer.draw(), to_picture(frame, kind))


def test_buffers_are_told_apart(cube, camera):
    outputs = ("depth", "normal", "object_id", "face_id")
    frame = rj.render(cube, camera, size=SIZE, outputs=outputs)
    seen = frame.face_id >= 0
    depth = to_picture(frame, "depth")[:, :, 0].astype(int)
    order = np.argsort(frame.depth[seen])
    assert (np.diff(depth[seen][order]) <= 0).all()
    assert depth[seen].min() > depth[~seen].max()
    faces = to_picture(frame, "face_id")
    colors = {tuple(faces[frame.face_id == one][0]) for one in np.unique(frame.face_id[seen])}
    assert len(colors) == len(np.unique(frame.face_id[seen]))
    normal = to_picture(frame, "normal")[seen][:, :3].astype(float)
    np.testing.assert_allclose(normal / 127.5 - 1.0, frame.normal[seen], atol=0.01)
    empty = rj.render(cube, camera, size=(1, 1), outputs=("depth",))
    assert to_picture(empty, "depth").shape == (1, 1, 4)


def test_wireframe_key_goes_over_alone_and_off(viewer):
    modes = []
    for _ in range(3):
        key(viewer, "g")
        modes.append(getattr(viewer.shown.wireframe, "mode", None))
        np.testing.assert_array_equal(viewer.draw(), rendered(viewer, DRAFT))
    assert modes == ["overlay", "only", None]
    assert viewer.scene.wireframe is None


@pytest.mark.parametrize(
    ("name", "field"), [("o", "ambient_occlusion"), ("k", "outline"), ("t", "tone_map")]
)
def test_effect_key_switches_and_switches_back(viewer, name, field):
    first = viewer.shown
    key(viewer, name)
    assert getattr(viewer.shown, field) is not None
    assert getattr(viewer.scene, field) is None
    assert "on" in viewer.line
    key(viewer, name)
    assert viewer.shown is first


def test_effect_of_the_scene_is_switched_off(cube):
    scene = rj.Scene()
    scene.add(cube)
    scene.outline = rj.Outline()
    viewer = Viewer(scene, size=SIZE)
    key(viewer, "k")
    assert viewer.shown.outline is None
    assert "outline off" in viewer.line
    viewer.close()


def test_labels_are_shown_and_switched_off_and_on(cube):
    scene = rj.Scene()
    scene.add(cube)
    scene.add(rj.Label((0, 0, 0), "text", background="red"))
    viewer = Viewer(scene, size=SIZE)
    pictures = []
    for _ in range(3):
        pictures.append(viewer.draw().copy())
        key(viewer, "j")
    assert not np.array_equal(pictures[0], pictures[1])
    np.testing.assert_array_equal(pictures[0], pictures[2])
    assert len(scene.labelled) == 1
    viewer.close()


def test_effect_that_cannot_be_is_said(viewer):
    version = viewer.version
    key(viewer, "l")
    assert viewer.shown is viewer.scene
    assert "nothing for shadows" in viewer.line
    assert viewer.version == version


def test_costs_are_those_of_the_effects_shown(viewer):
    key(viewer, "k")
    key(viewer, "m")
    while viewer.step():
        pass
    assert set(viewer.costs) == {"frame", "outline"}
    assert viewer.costs["frame"] > 0.0


def test_click_explains_the_pixel(viewer):
    pointer(viewer, "down", 20, 15)
    pointer(viewer, "up", 21, 15)
    settle(viewer)
    while viewer.explanation is None:
        assert viewer.step()
    told = viewer.explanation
    assert (told.x, told.y, told.size) == (21, 15, SIZE)
    frame = rj.render(
        viewer.scene, viewer.camera, size=SIZE, outputs=("color", "position", "face_id")
    )
    rows = dict(row for row in as_rows(told) if len(row) == 2)
    assert rows["face"].startswith(f"{frame.face_id[15, 21]} ")
    shown = [float(part) for part in rows["world position"].split()]
    np.testing.assert_allclose(shown, frame.position[15, 21], atol=1e-3)
    assert rows["sRGB"] == "  ".join(map(str, frame.color[15, 21, :3]))
    key(viewer, "Escape")
    assert viewer.explanation is None


def test_pixel_of_the_background_is_explained(viewer):
    viewer.pick(0, 0)
    assert viewer.step()
    assert ("shows", "the background") in as_rows(viewer.explanation)


def test_drag_is_no_click(viewer):
    pointer(viewer, "down", 20, 15)
    pointer(viewer, "move", 28, 15)
    pointer(viewer, "up", 28, 15)
    settle(viewer)
    viewer.step()
    assert viewer.explanation is None


def test_wheel_zooms_to_the_surface_under_the_cursor(viewer):
    viewer.draw()
    before = viewer.camera
    frame = rj.render(viewer.scene, before, size=SIZE, outputs=("position",), quality=DRAFT)
    point = frame.position[12, 17].astype(float)
    viewer.handle({"event_type": "wheel", "dx": 0, "dy": -300, "x": 17.5, "y": 12.5})
    settle(viewer)
    after = viewer.camera
    share = np.linalg.norm(np.subtract(after.eye, point)) / np.linalg.norm(point - before.eye)
    assert share == pytest.approx(np.exp(-0.3), rel=0.02)


def test_keys_fly(viewer):
    before = viewer.camera
    key(viewer, "c")
    assert isinstance(viewer.controls, Fly)
    np.testing.assert_allclose(viewer.camera.eye, before.eye, atol=1e-9)
    viewer.handle({"event_type": "key_down", "key": "w"})
    viewer.advance(10.0)
    travelled = np.linalg.norm(np.subtract(viewer.camera.eye, before.eye))
    assert 0.0 < travelled <= MAX_STEP_SECONDS * viewer.controls.speed
    pointer(viewer, "down", 3, 3)
    version = viewer.version
    pointer(viewer, "move", 9, 3)
    assert viewer.version > version


def test_held_key_moves_as_far_at_any_rate_of_frames(viewer, monkeypatch):
    key(viewer, "c")
    viewer.handle({"event_type": "key_down", "key": "w"})
    monkeypatch.setattr(quality_selection, "seconds_of", lambda frame: 0.4)
    viewer.draw()
    expected = viewer.controls.advance(0.4)
    viewer.advance(0.4)
    assert viewer.controls == expected
    # A pause is none of its steps.
    expected = viewer.controls.advance(0.4 + MAX_STEP_SECONDS)
    viewer.advance(60.0)
    assert viewer.controls == expected


def test_window_of_another_shape_fits_the_scene_again(viewer, cube):
    viewer.resize((30, 60))
    assert viewer.draw().shape == (60, 30, 4)
    other = Viewer(cube, size=(30, 60))
    assert viewer.camera == other.camera
    placed = Viewer(cube, rj.PerspectiveCamera(eye=(3, 4, 9), target=(0, 0, 0)), size=SIZE)
    before = placed.camera
    placed.resize((30, 60))
    assert placed.camera == before
    for one in (other, placed):
        one.close()


def said(viewer):
    """Return how the picture was drawn, and in how many seconds by the line at the bottom."""
    found = re.search(r"(\w+(?: of \d+ pictures)?)(?: \S+)? in ([\d.]+) (m?s)", viewer.line)
    return found[1], float(found[2]) * (1e-3 if found[3] == "ms" else 1.0)


def test_line_tells_the_time_of_all_pictures_of_the_reference(viewer, monkeypatch):
    draw = Renderer._draw_step_by_step

    def slow(self, *arguments, **options):
        frame = draw(self, *arguments, **options)
        time.sleep(0.02)
        return frame

    monkeypatch.setattr(Renderer, "_draw_step_by_step", slow)
    viewer.draw()
    assert said(viewer)[0] == "draft"
    assert said(viewer)[1] >= 0.02
    told = {}
    while viewer.step():
        words, seconds = said(viewer)
        told[words] = seconds
    assert list(told) == [
        "standard", *(f"reference of {n} pictures" for n in (4, 16, 64, 256)),
    ]  # fmt: skip
    for number, seconds in enumerate(list(told.values())[1:], 1):
        assert seconds >= 0.02 * number


def test_line_tells_true_times_while_another_thread_compiles(viewer, monkeypatch):
    draw = Renderer._draw_step_by_step

    def slow(self, *arguments, **options):
        with COMPILE_CLOCK.running():
            time.sleep(0.02)
            return draw(self, *arguments, **options)

    monkeypatch.setattr(Renderer, "_draw_step_by_step", slow)
    frame = viewer._draw_moving()
    assert quality_selection.seconds_of(frame) < 0.02
    viewer.draw()
    assert said(viewer)[1] >= 0.02
    assert "with compiling" in viewer.line


def test_times_are_not_those_of_frames_during_which_anything_compiled(cube, camera):
    drawn = []

    def draw(quality):
        frame = rj.render(cube, camera, size=SIZE)
        frame.stats.seconds.update({"compile": 1.0 if not drawn else 0.0, "shade": 0.4})
        drawn.append(quality)
        return frame

    times = quality_selection.FrameTimes(LADDER[:1], {})
    list(times.calibrate(0.1, draw))
    assert len(drawn) == 2
    assert times.predict(LADDER[0]) >= 0.4


def test_scene_that_takes_too_long_moves_in_half_as_many_pixels_a_side(viewer, monkeypatch):
    viewer.resize((41, 31))
    seconds = [0.1]
    monkeypatch.setattr(quality_selection, "seconds_of", lambda frame: seconds[0])
    monkeypatch.setattr(viewing, "MAX_OVERRUN", 1.5)
    viewer.draw()
    drag(viewer)
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, DRAFT))
    viewer.advance(0.02)
    half = rj.render(viewer.scene, viewer.camera, size=(21, 16), quality=DRAFT, outputs=BOTH)
    larger = np.repeat(np.repeat(half.color, 2, axis=0), 2, axis=1)[:31, :41]
    np.testing.assert_array_equal(viewer.draw(), larger)
    assert "at half the size" in viewer.line
    viewer.enlarges = False
    np.testing.assert_array_equal(viewer.draw(), half.color)
    viewer.enlarges = True
    # What is under the cursor is known all the same.
    event = {"event_type": "wheel", "x": 20, "y": 15}
    assert viewer._get_depth_under(event) == half.depth[7, 10]
    # Four times its time would be little.
    seconds[0] = 0.002
    for is_half in (True, False):
        viewer.advance(0.001)
        picture = viewer.draw()
        assert ("at half the size" in viewer.line) == is_half
    np.testing.assert_array_equal(picture, rendered(viewer, DRAFT))


def test_moved_view_stays_when_the_picture_changes_its_shape(cube):
    viewer = Viewer(cube, size=SIZE)
    viewer.controls = viewer.controls.turn(40.0, 10.0).at_rest()
    for name in "cc":
        key(viewer, name)
    before = viewer.camera
    viewer.resize((60, 20))
    assert viewer.camera == before
    viewer.close()


@pytest.mark.parametrize("presses", ["", "c", "cc"])
@pytest.mark.parametrize("is_placed", [False, True])
def test_r_returns_to_the_first_view_whatever_was_pressed(cube, presses, is_placed):
    camera = rj.PerspectiveCamera(eye=(3, 4, 9), target=(0, 0, 0)) if is_placed else None
    viewer = Viewer(cube, camera, size=SIZE)
    first = viewer.camera
    viewer.controls = viewer.controls.turn(40.0, 10.0).at_rest()
    for name in presses:
        key(viewer, name)
    drag(viewer)
    pointer(viewer, "up", 15, 9)
    key(viewer, "r")
    settle(viewer)
    np.testing.assert_allclose(viewer.camera.eye, first.eye, atol=1e-9)
    np.testing.assert_allclose(viewer.camera.view_matrix(), first.view_matrix(), atol=1e-9)
    viewer.close()


def test_r_returns_to_the_whole_scene_in_the_shape_that_the_picture_has_by_then(viewer, cube):
    viewer.controls = viewer.controls.turn(40.0, 10.0).at_rest()
    viewer.resize((30, 60))
    key(viewer, "r")
    settle(viewer)
    other = Viewer(cube, size=(30, 60))
    assert viewer.camera == other.camera
    other.close()


def test_scene_with_z_up_turns_about_z(cube):
    scene = rj.Scene()
    scene.add(cube)
    scene.up = (0, 0, 2)
    viewer, told = Viewer(scene, size=SIZE), Viewer(cube, size=SIZE, up=(0, 0, 1))
    assert viewer.camera == told.camera
    before = viewer.camera
    viewer.handle({"event_type": "key_down", "key": "ArrowLeft"})
    for _ in range(9):
        viewer.advance(0.1)
    after = viewer.camera
    assert after.eye[2] == pytest.approx(before.eye[2])
    assert np.linalg.norm(np.subtract(after.eye, before.eye)[:2]) > 1.0
    np.testing.assert_allclose(viewer.draw(), rendered(viewer, DRAFT))
    np.testing.assert_allclose(rj.render(scene, size=SIZE).plan.camera.eye, before.eye)
    for one in (viewer, told):
        one.close()


def test_events_count_in_screen_pixels(cube):
    viewer, dense = Viewer(cube, size=SIZE), Viewer(cube, size=SIZE)
    dense.resize((80, 60), 2.0)
    for one in (viewer, dense):
        pointer(one, "down", 5, 5)
        pointer(one, "up", 18, 9)
        settle(one)
        one.close()
    assert viewer.camera == dense.camera


def test_text_changes_only_its_corner():
    picture = np.full((200, 300, 4), 255, np.uint8)
    write_panel(picture, [("one",), ("two", "three")], "bottom left")
    rows, columns = np.nonzero((picture != 255).any(axis=2))
    assert rows.min() > 140
    assert columns.max() < 120
    assert picture[rows.min() : rows.max(), columns.min() : columns.max(), 0].min() < 40
    small = np.full((30, 40, 4), 255, np.uint8)
    write_panel(small, [("much too long for it",)], "top right")
    assert (small == 255).all()


@pytest.mark.parametrize(("column", "row"), [(0, 0), (39, 29), (20, 15)])
def test_mark_lies_around_the_pixel(column, row):
    picture = np.full((30, 40, 4), 255, np.uint8)
    mark_pixel(picture, column, row)
    rows, columns = np.nonzero((picture != 255).any(axis=2))
    away = np.abs(rows - row) + np.abs(columns - column)
    assert ((rows == row) | (columns == column)).all()
    assert away.min() == 3
    assert away.max() <= 8


@pytest.mark.parametrize("size", [(125, 125), (900, 130)])
def test_help_fits_into_any_picture(cube, size):
    viewer = Viewer(cube, size=size)
    key(viewer, "i")
    without = viewer.draw()
    key(viewer, "h")
    assert (viewer.draw() != without).any()
    key(viewer, "h")
    np.testing.assert_array_equal(viewer.draw(), without)
    viewer.close()


def test_every_effect_key_is_known_and_told():
    names = {effect.name for effect in EFFECTS}
    assert effect_switches.EFFECT_KEYS == {
        "o": "ambient occlusion", "k": "outline", "t": "tone mapping", "l": "shadows",
        "b": "environment background", "v": "environment light", "n": "fog", "x": "textures",
        "z": "vignette", "j": "labels", "y": "eye-dome lighting",
    }  # fmt: skip
    assert set(effect_switches.EFFECT_KEYS.values()) <= names
    assert {key: effect.name for key, effect in effect_switches.MODAL_EFFECTS.items()} == {
        "g": "wireframe", "p": "section",
    }  # fmt: skip
    assert ("G", "wireframe: over the faces, alone, off") in HELP_ROWS
    assert ("P", "section: the scene's own, or across z, across x, across y, off") in HELP_ROWS
    rows = [(row[0].split(), row[1].split(", ")) for row in HELP_ROWS]
    told = [pair for keys, words in rows for pair in zip(keys, words, strict=False)]
    for one, name in effect_switches.EFFECT_KEYS.items():
        assert (one.upper(), name) in told
        assert [keys.count(one.upper()) for keys, _ in rows].count(1) == 1


def test_error_of_a_step_is_shown_once(viewer):
    viewer.draw()
    viewer.step()
    viewer.fail(MemoryError("too large"))
    assert "MemoryError: too large" in viewer.line
    assert viewer.is_done


def test_wrong_arguments_are_refused(cube):
    with pytest.raises(ValueError, match="background"):
        Viewer(cube, background="no colour")
    with pytest.raises(ValueError, match="time_budget must be above 0"):
        Viewer(cube, time_budget=0.0)
    with pytest.raises(ValueError, match="empty scene"):
        Viewer(rj.Scene())
    with pytest.raises(ValueError, match="backend must be one of 'auto'"):
        rj.show(cube, backend="paper")


MILLISECONDS = dict(
    zip((viewing.PREVIEW, *LADDER[1:]), (2, 4, 7, 11, 25, 40, 50, 300, 1200), strict=True)
)
"""What the qualities are said to take."""


@pytest.fixture
def timed(cube, monkeypatch):
    """A viewer that is said to draw in these times, and the qualities whose times it asked for."""
    asked = []

    def seconds_of(frame):
        asked.append(frame.plan.quality)
        return 1e-3 * MILLISECONDS[frame.plan.quality]

    monkeypatch.setattr(quality_selection, "load_profile", lambda: None)
    monkeypatch.setattr(quality_selection, "seconds_of", seconds_of)
    viewer = Viewer(cube, size=SIZE, time_budget=0.02)
    yield viewer, asked
    viewer.close()


def test_dial_chooses_the_moving_picture_once_it_knows_the_scene(timed):
    viewer, asked = timed
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, DRAFT))
    while viewer.step():
        pass
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, REFERENCE))
    drag(viewer)
    # 11 ms is the most that 20 leave room for; 40 was too much.
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, LADDER[3]))
    assert LADDER[5] in asked
    assert LADDER[6] not in asked
    # A scene with another effect is another scene, buffers show no more in a better quality.
    key(viewer, "k")
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, DRAFT))
    key(viewer, "k")
    settle(viewer)
    while viewer.step():
        pass
    key(viewer, "3")
    viewer.draw()
    assert viewer._frame.plan.quality == DRAFT


def test_what_shared_the_processors_with_what_moves_is_not_learned(timed, monkeypatch):
    viewer, asked = timed
    render = Renderer.render

    def disturbed(renderer, *arguments, **options):
        frame = render(renderer, *arguments, **options)
        if renderer.quality == LADDER[2]:
            monkeypatch.setattr(Renderer, "render", render)
            drag(viewer)
        return frame

    monkeypatch.setattr(Renderer, "render", disturbed)
    while viewer.step():
        pass
    assert viewer.is_moving
    assert LADDER[1] in asked
    assert LADDER[2] not in asked


def test_a_picture_of_another_size_is_measured_anew(timed):
    viewer, _ = timed
    while viewer.step():
        pass
    viewer.resize((60, 40))
    drag(viewer)
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, DRAFT))
    settle(viewer)
    while viewer.step():
        pass
    drag(viewer)
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, LADDER[3]))


def test_the_command_has_the_time_of_the_function():
    shown = inspect.signature(rj.show).parameters["time_budget"].default
    (option,) = [one for one in program.commands["view"].params if one.name == "time_budget"]
    assert option.default == shown


@pytest.mark.parametrize(
    ("backend", "extra"),
    [("window", "viewer")],
)
def test_without_a_canvas_the_extra_is_named(cube, monkeypatch, backend, extra):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "rendercanvas" else find(name)
    )
    with pytest.raises(ImportError, match=rf'pip install "rasterjit\[{extra}\]"'):
        rj.show(cube, backend=backend)


def test_what_moves_while_the_dial_learns_loses_nothing(timed, monkeypatch):
    viewer, asked = timed
    render = Renderer.render

    def moved(renderer, *arguments, **options):
        if renderer.quality == LADDER[2]:
            monkeypatch.setattr(Renderer, "render", render)
            drag(viewer)
        return render(renderer, *arguments, **options)

    monkeypatch.setattr(Renderer, "render", moved)
    while viewer.step():
        pass
    assert viewer.is_moving
    assert asked.count(LADDER[1]) == 1 + quality_selection.FRAMES_PER_QUALITY
    assert LADDER[2] not in asked
    # Of what it knows by now that is the best.
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, LADDER[1]))
    settle(viewer)
    asked.clear()
    while viewer.step():
        pass
    # Measured before.
    assert LADDER[1] not in asked
    assert asked.count(LADDER[2]) == 1 + quality_selection.FRAMES_PER_QUALITY
    drag(viewer)
    np.testing.assert_array_equal(viewer.draw(), rendered(viewer, LADDER[3]))


def test_twin_shows_the_same_and_goes_its_own_way(viewer):
    drag(viewer)
    twin = viewer.twin()
    assert twin.camera != viewer.camera
    key(viewer, "r")
    settle(viewer)
    assert twin.camera == viewer.camera
    np.testing.assert_array_equal(twin.draw(), rendered(viewer, DRAFT))
    key(twin, "2")
    assert viewer.look[0] == "color"
    twin.close()


@pytest.mark.parametrize(
    ("look", "message"),
    [
        (("colour", (), {}), "kind must be one of 'color', 'depth'"),
        (("color", ("mist",), {}), "switched must be one of .*; got 'mist'"),
        (("color", (), {"q": None}), "modes must be one of 'p', 'g'; got 'q'"),
        (
            ("color", (), {"g": "x"}),
            r"modes\['g'\] must be one of None, 'overlay', 'only'; got 'x'",
        ),
    ],
)
def test_look_that_is_none_is_refused(viewer, look, message):
    before = viewer.look
    with pytest.raises(ValueError, match=message):
        viewer.set_look(*look)
    assert viewer.look == before


@pytest.mark.parametrize("numbers", [[1], [-1], [0, 1]])
def test_object_that_is_not_there_is_not_hidden(viewer, numbers):
    with pytest.raises(ValueError, match=r"numbers must lie in 0\.\.0, got"):
        viewer.set_hidden(numbers)
    assert viewer.hidden == frozenset()


def test_text_is_written_on_the_picture_only_where_it_is_read_there(viewer):
    key(viewer, "h")
    bare = viewer.twin()
    bare.writes_text = False
    key(bare, "h")
    wanted = rendered(viewer, DRAFT)
    np.testing.assert_array_equal(bare.draw(), wanted)
    bare.close()
