"""What a page says goes into its own viewer, and pictures come out, also where none is shown."""

from __future__ import annotations

import gc
import io
import math
import struct
import threading
import time
import weakref
from collections import deque
from concurrent.futures import Future

import numpy as np
import pytest
from own_threads import own_threads
from PIL import Image
from viewing import PATIENCE

import rasterjit as rj
from rasterjit.io.images import encode_png
from rasterjit.viewer import browser_session, protocol
from rasterjit.viewer.browser_session import MAX_IN_FLIGHT, MAX_QUEUED, BrowserSession, add_event
from rasterjit.viewer.protocol import format_camera_code
from rasterjit.viewer.viewer import Viewer

pytest.importorskip("simplejpeg")

RESIZE = {"type": "resize", "pwidth": 80, "pheight": 60, "ratio": 1.0}


class Page:
    """Stands for a page: keeps what it is told, and says what it has shown."""

    def __init__(self, viewer, first=None, shows=True):
        self.pictures, self.said, self.shows, self.number = [], {}, shows, 0
        if first is None:
            first = Future()
            first.set_result(None)
        self.tab = BrowserSession(viewer, first, self.hear)

    def hear(self, told):
        if isinstance(told, dict):
            self.said[told["type"]] = told
            return
        self.pictures.append(told[4:])
        (self.number,) = struct.unpack(">I", told[:4])
        if self.shows:
            self.tab.queue_message({"type": "shown", "number": self.number})

    def say(self, kind, /, **fields):
        self.tab.queue_message({"type": kind, **fields})

    def wait(self, is_there):
        limit = time.monotonic() + PATIENCE
        while not is_there(self):
            assert time.monotonic() < limit, (self.said.get("state"), len(self.pictures))
            time.sleep(0.01)

    @property
    def state(self):
        return self.said.get("state", {})

    @property
    def picture(self):
        return np.asarray(Image.open(io.BytesIO(self.pictures[-1])))

    def settle(self):
        """Wait for the picture that becomes no better."""
        self.wait(lambda page: page.state.get("is_done") and page.state["number"] == page.number)
        assert self.pictures[-1][:1] == b"\x89"


@pytest.fixture
def pair(cube):
    scene = rj.Scene()
    for name, x in (("left", -1.5), ("right", 1.5)):
        scene.add(cube, rj.transforms.translate((x, 0.0, 0.0)), name=name)
    return scene


@pytest.fixture
def page(pair):
    viewer = Viewer(pair, size=(8, 6))
    page = Page(viewer.twin())
    page.tab.queue_message(RESIZE)
    page.settle()
    yield page
    page.tab.close()
    viewer.close()


def test_at_rest_the_picture_is_the_reference(page, pair):
    camera = page.tab._viewer.camera
    wanted = rj.render(pair, camera, size=(80, 60), quality=rj.Quality.reference()).color
    np.testing.assert_array_equal(page.picture, wanted[:, :, :3])
    assert page.said["welcome"]["count"] == 2
    assert [one["name"] for one in page.said["welcome"]["objects"]] == ["left", "right"]


def test_pages_have_sizes_and_views_of_their_own(pair):
    viewer = Viewer(pair, size=(8, 6))
    first, second = Page(viewer.twin()), Page(viewer.twin())
    first.tab.queue_message(RESIZE)
    second.tab.queue_message({**RESIZE, "pwidth": 50, "ratio": 2.0})
    first.settle()
    second.settle()
    view = second.state["view"]
    first.say("key_down", key="+", modifiers=[])
    first.wait(lambda page: page.state["view"] != view)
    first.settle()
    assert first.picture.shape == (60, 80, 3)
    assert second.picture.shape == (60, 50, 3)
    assert second.state["view"] == view
    for page in (first, second):
        page.tab.close()
    viewer.close()


def test_nothing_is_drawn_before_the_first_picture_and_no_event_is_lost(cube):
    """Some 60 moves a second come: the release must not be lost behind them."""
    viewer, quick = (Viewer(cube, size=(80, 60)) for _ in range(2))
    first = Future()
    page = Page(viewer, first)
    page.tab.queue_message(RESIZE)
    place = {"button": 1, "buttons": [1], "modifiers": [], "y": 30.0}
    moves = [10.0 + 0.01 * n for n in range(2 * MAX_QUEUED)]
    events = [("pointer_down", {**place, "x": 10.0})]
    events += [("pointer_move", {**place, "x": x}) for x in moves]
    events += [("pointer_up", {**place, "x": 30.0})]
    events += [("wheel", {"x": 40.0, "y": 30.0, "dx": 0.0, "dy": 0.01, "modifiers": []})] * 2000
    for kind, fields in events:
        page.say(kind, **fields)
        quick.handle({"event_type": kind, **fields})
    assert len(page.tab._messages) == 5
    assert not page.pictures
    first.set_result(None)
    page.settle()
    assert not viewer.controls.drag
    for name in ("azimuth", "elevation", "distance"):
        expected = getattr(quick.controls.goal, name)
        assert getattr(viewer.controls.goal, name) == pytest.approx(expected, rel=1e-6), name
    page.tab.close()


def test_page_that_shows_nothing_gets_no_more_than_a_few(pair):
    page = Page(Viewer(pair, size=(8, 6)), shows=False)
    page.tab.queue_message(RESIZE)
    for key in "+-+-":
        page.say("key_down", key=key, modifiers=[])
        time.sleep(0.2)
    assert len(page.pictures) <= page.tab.sent <= MAX_IN_FLIGHT
    page.shows = True
    page.say("shown", number=page.tab.sent)
    page.settle()
    assert page.tab.sent > MAX_IN_FLIGHT
    page.tab.close()


def test_a_picture_is_coded_while_the_next_is_drawn(pair, monkeypatch):
    coding, release = threading.Event(), threading.Event()

    def encode(picture):
        coding.set()
        assert release.wait(PATIENCE)
        return encode_png(picture)

    monkeypatch.setattr(browser_session, "encode_jpeg", encode)
    viewer, drawn = Viewer(pair, size=(8, 6)), threading.Event()
    page = Page(viewer)
    draw = viewer.draw

    def draw_more():
        picture = draw()
        if coding.is_set():
            drawn.set()
        return picture

    monkeypatch.setattr(viewer, "draw", draw_more)
    page.tab.queue_message(RESIZE)
    assert drawn.wait(PATIENCE)
    assert not page.pictures
    release.set()
    page.settle()
    page.tab.close()


def test_view_looks_from_there_and_its_code_too(page, pair):
    view = {"eye": [3.0, 4.0, 9.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0], "fov_y": 30.0}
    page.say("view", **view)
    page.wait(lambda page: page.state["view"]["eye"] == view["eye"])
    page.settle()
    camera = eval(page.state["code"], {"rj": rj})
    assert camera.fov_y == 30.0
    wanted = rj.render(pair, camera, size=(80, 60), quality=rj.Quality.reference()).color
    far = np.abs(page.picture.astype(int) - wanted[:, :, :3])
    assert far.max() <= 2
    # Where it began is where R leads.
    assert page.state["view"]["target"] == view["target"]
    home = page.tab._viewer.controls.home
    page.say("key_down", key="r", modifiers=[])
    page.wait(lambda page: page.tab._viewer.controls.pose == home)
    page.settle()
    # Places that are no view change nothing.
    before = page.state["view"]
    page.say("view", **{**view, "eye": view["target"]})
    page.say("view", **{**view, "up": [0.0, 0.0, 0.0]})
    page.say("key_down", key="2", modifiers=[])
    page.wait(lambda page: page.state["kind"] == "depth")
    assert page.state["view"] == before


def test_look_is_set_as_a_whole(page):
    page.say("look", kind="normal", switched=["vignette", "outline"], modes={"g": "overlay"})
    page.wait(lambda page: page.state["kind"] == "normal")
    assert page.state["switched"] == ["vignette", "outline"]
    assert page.state["modes"]["g"] == "overlay"
    effects = {one["name"]: one for one in page.state["effects"]}
    assert effects["vignette"]["is_on"]
    assert effects["outline"]["is_on"]
    assert not effects["fog"]["is_possible"]
    page.say("look", kind="color", switched=["fog"], modes={"g": None})
    page.wait(lambda page: page.state["kind"] == "color")
    # The scene has no fog to switch on.
    assert page.state["switched"] == []
    assert page.state["modes"]["g"] is None
    page.settle()


def test_hidden_objects_are_neither_seen_nor_picked(page, pair):
    only = rj.Scene()
    only.add(pair.nodes[1].mesh, pair.nodes[1].world_from_model)
    camera = page.tab._viewer.camera
    wanted = rj.render(only, camera, size=(80, 60), quality=rj.Quality.reference()).color
    for shown in ({"hidden": [0, 77], "only": None}, {"hidden": [], "only": 1}):
        page.say("visibility", **shown)
        page.wait(lambda page: page.state["only"] == shown["only"])  # noqa: B023
        page.wait(lambda page: page.state["hidden"] == [0])
        page.settle()
        np.testing.assert_array_equal(page.picture, wanted[:, :, :3])
    rows, columns = np.nonzero((wanted[:, :, :3] < 250).any(axis=2))
    page.say("pick", x=float(columns.mean()), y=float(rows.mean()))
    page.wait(lambda page: page.state["picked"])
    assert page.state["picked"]["name"] == "right"
    assert page.state["picked"]["object"] == 1
    page.say("visibility", hidden=[0, 1], only=None)
    page.wait(lambda page: page.state["hidden"] == [0, 1])
    page.settle()
    assert page.picture.min() == 255


def test_second_pick_measures_in_the_units_of_the_scene(page, pair):
    camera = page.tab._viewer.camera
    frame = rj.render(pair, camera, size=(80, 60), outputs=("object_id", "position"))
    places = []
    for number in (0, 1):
        rows, columns = np.nonzero(frame.object_id == number)
        places.append((int(columns[columns.size // 2]), int(rows[rows.size // 2])))
    for count, (column, row) in enumerate(places, 1):
        page.say("pick", x=column + 0.5, y=row + 0.5)
        page.wait(lambda page: (page.state["picked"] or {}).get("count") == count)  # noqa: B023
        picked = page.state["picked"]
        assert picked["position"] == pytest.approx(frame.position[row, column], abs=1e-4)
    apart = math.dist(*(frame.position[row, column] for column, row in places))
    assert picked["distance"] == pytest.approx(apart, rel=1e-4)
    page.say("pick", x=0.0, y=0.0)
    page.wait(lambda page: page.state["picked"]["count"] == 3)
    assert page.state["picked"]["name"] == "background"
    assert page.state["picked"]["distance"] is None
    page.say("key_down", key="Escape", modifiers=[])
    page.wait(lambda page: page.state["picked"] is None)


def test_error_is_told_and_the_page_goes_on(page, monkeypatch):
    viewer = page.tab._viewer
    draw = viewer.draw

    tries = []

    def fail():
        tries.append(viewer.version)
        raise MemoryError("too much")

    monkeypatch.setattr(viewer, "draw", fail)
    page.say("key_down", key="+", modifiers=[])
    page.wait(lambda page: "MemoryError: too much" in page.state["line"])
    page.wait(lambda page: not viewer.is_moving)
    time.sleep(0.3)
    # It is not tried without end.
    assert tries.count(viewer.version) <= 2
    monkeypatch.setattr(viewer, "draw", draw)
    page.say("key_down", key="2", modifiers=[])
    page.wait(lambda page: page.state["kind"] == "depth")
    page.settle()


def test_picture_that_cannot_be_coded_is_told_and_not_waited_for(page, monkeypatch):
    def fail(picture):
        raise MemoryError("no room")

    monkeypatch.setattr(browser_session, "encode_jpeg", fail)
    for key in "+-" * MAX_IN_FLIGHT:
        sent = page.tab.sent
        page.say("key_down", key=key, modifiers=[])
        page.wait(lambda page: page.tab.sent > sent)  # noqa: B023
    page.wait(lambda page: "MemoryError: no room" in page.state["line"])
    page.say("key_down", key="2", modifiers=[])
    page.wait(lambda page: page.state["kind"] == "depth")
    page.settle()


def test_what_cannot_be_told_does_not_end_the_page(page, monkeypatch):
    def fail(self):
        raise ValueError("no plan")

    monkeypatch.setattr(BrowserSession, "_list_effects", fail)
    page.say("key_down", key="2", modifiers=[])
    time.sleep(0.3)
    monkeypatch.undo()
    page.say("key_down", key="3", modifiers=[])
    page.wait(lambda page: page.state["kind"] == "normal")


def test_viewer_that_changes_by_itself_is_looked_at(pair):
    class Live(Viewer):
        is_live = True
        passed = 0

        def advance(self, seconds):
            self.passed += 1
            if self.passed == 10:
                self.set_hidden([0])

    page = Page(Live(pair, size=(8, 6)))
    page.tab.queue_message(RESIZE)
    page.wait(lambda page: page.state.get("hidden") == [0])
    page.settle()
    page.tab.close()


def test_closed_page_lets_its_threads_go(pair):
    before = own_threads()
    page = Page(Viewer(pair, size=(8, 6)))
    page.tab.queue_message(RESIZE)
    page.settle()
    page.tab.close()
    page.tab._thread.join(PATIENCE)
    assert not page.tab._thread.is_alive()
    page.wait(lambda page: own_threads() <= before)


@pytest.mark.parametrize("does", ["wait", "move", "rest"])
def test_closed_page_keeps_neither_pictures_nor_renderers(pair, does):
    """Also one from before the first picture; nothing waits for the collector of garbage."""
    first = Future()
    page = Page(Viewer(pair, size=(8, 6)), first)
    page.tab.queue_message(RESIZE)
    if does != "wait":
        first.set_result(None)
        page.settle()
        page.say("key_down", key="+", modifiers=[])
        page.wait(lambda page: page.tab._viewer.is_moving)
    if does == "rest":
        page.wait(lambda page: not page.tab._viewer.is_moving)
        page.settle()
    viewer = page.tab._viewer
    found = page.tab, viewer, viewer._moving, viewer._frame
    kept = [weakref.ref(one) for one in found if one is not None]
    assert len(kept) == (3 if does == "wait" else 4)
    del found, viewer
    gc.disable()
    try:
        page.tab.close()
        page.tab._thread.join(PATIENCE)
        del page.tab
        page.wait(lambda page: not any(one() for one in kept))
    finally:
        gc.enable()


def test_viewer_that_is_closed_keeps_no_picture(pair):
    viewer = Viewer(pair, size=(8, 6))
    viewer.draw()
    frame = weakref.ref(viewer._frame)
    viewer.close()
    gc.collect()
    assert frame() is None
    # It may be looked at again.
    assert viewer.draw().shape == (6, 8, 4)
    viewer.close()


def test_of_too_many_events_the_latest_are_kept():
    waiting = deque(maxlen=3)
    for key in "abcde":
        add_event(waiting, {"event_type": "key_up", "key": key})
    assert [event["key"] for event in waiting] == ["c", "d", "e"]


def drag(page, is_enough):
    """Move a pointer to and fro, until it is enough, on a page that shows each picture late."""
    place = {"button": 1, "buttons": [1], "modifiers": [], "y": 30.0}
    page.say("pointer_down", x=10.0, **place)
    limit = time.monotonic() + PATIENCE
    number = 0
    while not is_enough(page):
        assert time.monotonic() < limit
        number += 1
        page.say("pointer_move", x=10.0 + number % 60, **place)
        page.say("shown", number=min(number, page.tab.sent))
        time.sleep(2.0 * browser_session.SLOW_SECONDS)
    page.say("pointer_up", x=10.0, **place)


def sides_of(pictures):
    return {Image.open(io.BytesIO(data)).size for data in pictures}


def test_slow_page_gets_smaller_pictures_while_something_moves(pair, monkeypatch):
    monkeypatch.setattr(browser_session, "HALF_SIZE_SECONDS", 1000.0)
    page = Page(Viewer(pair, size=(8, 6), time_budget=1000.0), shows=False)
    page.tab.queue_message(RESIZE)
    drag(page, lambda page: (40, 30) in sides_of(page.pictures))
    page.shows = True
    page.say("shown", number=page.tab.sent)
    page.settle()
    assert page.picture.shape == (60, 80, 3)
    page.tab.close()


def test_page_is_tried_with_larger_pictures_again(pair, monkeypatch):
    monkeypatch.setattr(browser_session, "HALF_SIZE_SECONDS", 0.0)
    page = Page(Viewer(pair, size=(8, 6), time_budget=1000.0), shows=False)
    page.tab.queue_message(RESIZE)
    drag(page, lambda page: len(page.pictures) > 4 * browser_session.MAX_SLOW_FRAMES)
    assert sides_of(page.pictures) == {(80, 60)}
    page.tab.close()


def test_only_moves_with_the_same_buttons_and_keys_become_one():
    waiting = deque()
    for buttons, x in (([1], 1), ([1], 2), ([], 3), ([], 4), ([1], 5)):
        add_event(waiting, {"event_type": "pointer_move", "buttons": buttons, "x": x})
    assert [event["x"] for event in waiting] == [2, 4, 5]


def test_jpeg_is_near():
    ramp = np.linspace(0, 255, 64, dtype=np.uint8)
    picture = np.full((64, 64, 4), 255, dtype=np.uint8)
    picture[:, :, 0], picture[:, :, 1] = ramp, ramp[:, None]
    found = np.asarray(Image.open(io.BytesIO(protocol.encode_jpeg(picture))))
    assert np.abs(found.astype(int) - picture[:, :, :3]).max() <= 6


@pytest.mark.parametrize(
    ("eye", "text"),
    [
        ((1.0, 2.0, 3.0), "1, 2, 3"),
        ((1.0 / 3.0, -1e-17, 5e-9), "0.33333333, 0, 1e-08"),
        ((1e9 / 3.0, 1e-3, -2.0), "333333333, 0, -2"),
        ((-0.0, 0.0, 1e-12), "0, 0, 0"),
    ],
)
def test_code_of_a_camera_has_nine_digits(eye, text):
    camera = rj.PerspectiveCamera(eye, (9.0, 9.0, 9.0), fov_y=45.5)
    code = format_camera_code(camera)
    assert code == (
        f"rj.PerspectiveCamera(eye=({text}), target=(9, 9, 9), up=(0, 1, 0), fov_y=45.5)"
    )
    assert eval(code, {"rj": rj}).target == (9.0, 9.0, 9.0)
