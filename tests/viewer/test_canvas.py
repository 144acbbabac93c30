"""A canvas shows what is new at once, and what is done at rest lets other threads go first."""

from __future__ import annotations

import os
import sys
import threading
import time

import pytest
from viewing import PATIENCE

from rasterjit.viewer import canvas
from rasterjit.viewer.viewer import Viewer


class Canvas:
    """Stands for a canvas: counts what is asked of it."""

    def __init__(self):
        self.asked, self.pictures, self.draw, self.handle = threading.Event(), [], None, None

    def get_bitmap_context(self):
        return self

    def set_bitmap(self, picture):
        self.pictures.append(picture)

    def add_event_handler(self, handle, *kinds):
        self.handle = self.handle or handle

    def request_draw(self, draw=None):
        self.draw = draw or self.draw
        self.asked.set()

    def get_physical_size(self):
        return 40, 30

    def get_pixel_ratio(self):
        return 1.0


def test_canvas_is_hardly_asked_to_draw_what_is_not_new(cube):
    shown, viewer = Canvas(), Viewer(cube, size=(40, 30))
    connection = canvas.CanvasDriver(viewer, shown)
    limit = time.monotonic() + PATIENCE
    cancelled = 0
    while not (viewer.is_done and connection._stamp == viewer.stamp):
        assert shown.asked.wait(limit - time.monotonic())
        shown.asked.clear()
        try:
            shown.draw()
        except canvas.DrawCancelled:
            cancelled += 1
    assert len(shown.pictures) == connection.frames > 3
    # What is found while a picture is drawn is told twice.
    assert cancelled <= connection.frames
    connection._close({})


@pytest.mark.skipif(sys.platform != "linux", reason="threads share the niceness of their process")
def test_what_low_priority_and_what_it_begins_is_nicer():
    def niceness():
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    def of_another():
        found = []
        thread = threading.Thread(target=lambda: found.append(niceness()))
        thread.start()
        thread.join()
        return found[0]

    own, found = niceness(), []
    for low_priority in (False, True):
        worker = canvas.Worker(low_priority=low_priority)
        found += [worker.submit(niceness).result(), worker.submit(of_another).result()]
        worker.close()
    later = min(own + canvas.ADDED_NICENESS, 19)
    assert found == [own, own, later, later]
    assert niceness() == own
