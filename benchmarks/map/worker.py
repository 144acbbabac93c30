"""
A process that holds one contestant, and draws one scene after the other when told to.

``python -m benchmarks.map.worker CONTESTANT THREADS PICTURE`` answers every line of JSON on
standard input with one line of JSON:

``{"prepare": [family, faces, look, size]}``
    Prepare a scene in place of the last, draw each view once if that takes little time, and answer
    with the ``seconds`` of a picture, or with what it is ``unable`` to draw.
``{"draw": [first, count, warm]}``
    Draw so many views and read each back, after drawing the first once more if asked to ``warm``
    up; answer with the ``seconds`` of each, the ``processor`` seconds of all, and of RasterJIT the
    seconds of its ``stages`` together.
``{"picture": view}``
    Save what a view shows, for comparing.
``{"batch": count}``
    Of RasterJIT: draw so many views by ``render_batch`` into the same arrays each time, once more
    the first time; answer with ``seconds``, or nothing if this version has none.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np

from benchmarks.contestants import contestant
from benchmarks.map.families import VIEWS, make_scene
from benchmarks.worker import answer_pipe

WARM_SECONDS = 0.3
"""After so long no view is drawn to warm up."""


class Holder:
    """A contestant and what it has prepared."""

    def __init__(self, key: str, threads: int, path: str) -> None:
        self._contestant, self._threads, self._path = contestant(key), threads, path
        self._prepared: Any = None
        self._has_batched = False

    def prepare(self, family: str, faces: int, look: str, size: list[int]) -> dict[str, Any]:
        """Prepare a scene and draw it until it is warm."""
        if self._prepared is not None:
            self._prepared.close()
            self._prepared, self._has_batched = None, False
        scene = make_scene(family, faces, look, (size[0], size[1]))
        reason = self._contestant.draws(scene)
        if reason is not None:
            return {"unable": reason}
        started = time.perf_counter()
        self._prepared = self._contestant.prepare(scene, self._threads)
        # What some views need and others do not is compiled or loaded here, not in a turn.
        seconds = [self._timed(0)]
        while len(seconds) < VIEWS and time.perf_counter() - started < WARM_SECONDS:
            seconds.append(self._timed(len(seconds)))
        return {"seconds": min(seconds)}

    def _timed(self, view: int) -> float:
        """Draw a view and read it back; return the seconds."""
        started = time.perf_counter()
        self._prepared.draw_view(view % VIEWS)
        self._prepared.read()
        return time.perf_counter() - started

    def draw(self, first: int, count: int, warm: bool) -> dict[str, Any]:
        """Draw some views."""
        if warm:
            self._timed(first)
        seconds, stages = [], {}
        started = time.process_time()
        for view in range(first, first + count):
            seconds.append(self._timed(view))
            if hasattr(self._prepared, "stages"):
                for name, value in self._prepared.stages().items():
                    stages[name] = stages.get(name, 0.0) + value
        processor = time.process_time() - started
        return {"seconds": seconds, "processor": processor, "stages": stages}

    def picture(self, view: int) -> dict[str, Any]:
        """Save what a view shows."""
        self._timed(view)
        np.savez(self._path, **self._prepared.picture())
        return {}

    def batch(self, count: int) -> dict[str, Any]:
        """Draw some views together."""
        if not hasattr(self._prepared, "draw_batch"):
            return {}
        views = [view % VIEWS for view in range(count)]
        if not self._has_batched:
            # Peers read into memory that they have touched before, and so does a batch.
            self._prepared.draw_batch(views)
            self._has_batched = True
        started = time.perf_counter()
        self._prepared.draw_batch(views)
        return {"seconds": time.perf_counter() - started}


def main(key: str, threads: str, path: str) -> None:
    """Serve until standard input ends."""
    answers = answer_pipe()
    holder = Holder(key, int(threads), path)
    tasks = {
        "prepare": lambda asked: holder.prepare(*asked),
        "draw": lambda asked: holder.draw(*asked),
        "picture": holder.picture,
        "batch": holder.batch,
    }
    for line in sys.stdin:
        ((task, asked),) = json.loads(line).items()
        print(json.dumps(tasks[task](asked)), file=answers, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
