"""
A pool of renderers: draw frames of one scene in several threads, small ones in groups.

`views_at_once` chooses the size of groups after the first frame: its plan tells whether views of
the scene are eligible. Groups are drawn by recorded calls (``batch_scheduler.py``), other views
alone, and so is a group in which anything fails: an error is raised for its view, after the frames
before it.
"""

from __future__ import annotations

import math
import os
import queue
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.rendering import batch, batch_scheduler, view_warnings
from rasterjit.rendering.batch import AHEAD, Pace, scene_at
from rasterjit.rendering.batch_scheduler import (
    COUNTED,
    BatchCache,
    BatchScheduler,
    GroupRenderer,
    can_batch,
)
from rasterjit.rendering.planning import FrameRequest, plan_frame
from rasterjit.rendering.renderer import Renderer
from rasterjit.runtime.clocks import StageClock
from rasterjit.scene.camera import Camera
from rasterjit.scene.scene import Scene
from rasterjit.survey import object_transforms
from rasterjit.survey.cache import SceneCache, update_cache
from rasterjit.survey.plan import RenderPlan

BYTES_AT_ONCE = 1 << 23
"""Most memory for the pictures of a group."""


def may_gain(scene: Scene, options: FrameRequest, threads: int, room: int) -> bool:
    """Tell, without a plan, whether views may be drawn in one go: see `views_at_once`."""
    is_small = batch.work_of(options.size, scene) <= batch.MAX_WORK
    return threads == 1 and room > 1 and is_small and batch_scheduler.is_possible(options)


def views_at_once(
    plan: RenderPlan,
    scene: Scene,
    cache: SceneCache,
    options: FrameRequest,
    threads: int,
    room: int,
) -> int:
    """
    Return how many views a thread draws in one go; 1: each is drawn alone.

    Alone are views that share too little (`can_batch`: see there), that several threads draw
    together, of which there is no room for some, or so large that a group of them would take long
    or much memory, and gain nothing.

    Parameters
    ----------
    plan : RenderPlan
        Of one of them.
    scene : Scene
    cache : SceneCache
        Of the scene.
    options : FrameRequest
    threads : int
        How many draw each view.
    room : int
        Most that may be drawn in one go.
    """
    if not may_gain(scene, options, threads, room) or not can_batch(plan, scene, cache):
        return 1
    work = batch.work_of(options.size, scene)
    shapes = batch.shapes_of(scene, 1, options).values()
    view_bytes = sum(math.prod(shape) * np.dtype(dtype).itemsize for shape, dtype in shapes)
    most = room, batch.VIEWS_PER_GROUP, batch.WORK_PER_GROUP // work, BYTES_AT_ONCE // view_bytes
    return max(1, min(most))


class GrowingPace(Pace):
    """
    Prefetch few single views at first, for latency; then groups, if the first frame allows it.

    Parameters
    ----------
    scene : Scene
    options : FrameRequest
    workers : int
        How many threads, or processes, draw views.
    threads : int
        How many draw each view with one of those.
    prefetch : int, optional
        Most frames that are drawn, or being drawn, ahead of the one taken last. Default: of each
        worker one in work, one waiting; or one group of each, where all cameras are known.
    count : int, optional
        How many cameras there are; ``None`` -> they come as they are asked for.
    """

    def __init__(
        self, scene: Scene, options: FrameRequest, workers: int, threads: int,
        prefetch: int | None = None, count: int | None = None,
    ) -> None:  # fmt: skip
        turns = AHEAD * workers
        super().__init__(1, min(prefetch or turns, turns))
        self._scene, self._options, self._threads = scene, options, threads
        self._turns, self._prefetch, self._count = turns, prefetch, count
        self._is_decided = False

    def see(self, first: Frame, cache: SceneCache | None) -> None:
        """Decide once, given the first frame, and what is known of its scene."""
        if self._is_decided:
            return
        self._is_decided = True
        begun, self.ahead = self.ahead, self._prefetch or self._turns
        room = self.ahead // self._turns
        if self._prefetch is None and self._count is not None:
            # All of them have their share of what is not begun.
            room = -(-(self._count - begun) // self._turns)
        scene, options = self._scene, self._options
        # The plan is made for it, if it is there late.
        if not may_gain(scene, options, self._threads, room):
            return
        cache = cache or prepare_for(scene, options)
        self.at_once = views_at_once(first.plan, scene, cache, options, self._threads, room)
        self.ahead = self._prefetch or self._turns * self.at_once


def prepare_for(scene: Scene, options: FrameRequest) -> SceneCache:
    """Return what views of a scene have in common."""
    return update_cache(scene.nodes, None, options.quality, scene.environment is not None)


class ViewResult(NamedTuple):
    """The result of a view: its frame and warnings, or an error."""

    result: Frame | Exception
    notices: dict[str, str]

    def taken(self, told: set[str]) -> Frame:
        """Return the frame and issue new warnings, or raise the error."""
        if isinstance(self.result, Exception):
            raise self.result
        view_warnings.warn(self.notices, told)
        return self.result


class Shared(NamedTuple):
    """State shared by the threads that draw groups of views."""

    kept: BatchCache
    moment: SceneSnapshot
    group_size: int
    """How many views are drawn in one go."""

    @classmethod
    def of(
        cls, scene: Scene, cache: SceneCache, options: FrameRequest, group_size: int,
        first: RenderPlan | None = None,
    ) -> Shared:  # fmt: skip
        """Return what it takes to draw groups of so many views, perhaps with the plan of one."""
        kept = BatchCache(cache)
        kept.first = first
        own = SceneSnapshot(scene, cache, options)
        return cls(kept, own, group_size)


class PoolWorker:
    """
    Draws views of a scene in one thread of the pool.

    Parameters
    ----------
    scene : Scene
    options : FrameRequest
    threads : int
        That draw each frame.
    cache : SceneCache, optional
        Of the scene.
    """

    def __init__(
        self, scene: Scene, options: FrameRequest, threads: int, cache: SceneCache | None = None
    ) -> None:
        cache = cache or prepare_for(scene, options)
        self._scene, self._options, self._cache = scene, options, cache
        self._renderer = Renderer.timed(options.size, options.quality, threads, cache)
        self._arrays: dict[str, NDArray[Any]] = {}
        self._group: tuple[GroupRenderer, Shared] | None = None

    def close(self) -> None:
        """Release its threads and its memory."""
        self._renderer.close()
        if self._group is not None:
            self._group[0].close()

    def draw(self, cameras: Sequence[Camera], shared: Shared | None = None) -> deque[ViewResult]:
        """
        Draw views until one fails.

        Parameters
        ----------
        cameras : sequence of Camera
        shared : Shared, optional
            Default: nothing is shared with other threads.
        """
        found: dict[int, ViewResult] = {}
        if len(cameras) > 1:
            try:
                found = self._draw_group(cameras, shared)
            except Exception:
                # Drawn alone, the view that it is of raises it, after those before it.
                found = {}
        begun: deque[ViewResult] = deque()
        for n, camera in enumerate(cameras):
            begun.append(found.pop(n) if n in found else self._draw_alone(camera))
            if isinstance(begun[-1].result, Exception):
                break
        return begun

    def _draw_alone(self, camera: Camera) -> ViewResult:
        """Draw a view as `rasterjit.render` does."""
        try:
            # The pool warns once, for all of them.
            frame = self._renderer._render(self._options, self._scene, camera)
        except Exception as error:
            return ViewResult(error, {})
        return ViewResult(frame, view_warnings.warnings_of_frame(frame))

    def _draw_group(
        self, cameras: Sequence[Camera], shared: Shared | None
    ) -> dict[int, ViewResult]:
        """Draw those views, by their numbers, that have a place in a group."""
        clock = StageClock()
        drawer, own = self._drawer_of(len(cameras), shared)
        counts, is_drawn, told = drawer.draw(range(len(cameras)), cameras, None)
        clock("all stages")
        drawn = np.flatnonzero(is_drawn).tolist()
        found, starts = {}, self._cache.shapes.arrays.face_starts
        for n in drawn:
            arrays = {name: array[n].copy() for name, array in self._arrays.items()}
            *counted, covered = counts[n].tolist()
            named = dict(zip(COUNTED, counted, strict=False))
            seconds = {stage: of_all / len(drawn) for stage, of_all in clock.seconds.items()}
            stats = FrameStats(**named, seconds=seconds, face_id=covered)
            plan = partial(own.moment.plan, cameras[n])
            found[n] = ViewResult(LazyFrame(arrays, plan, stats, starts), told.of(n))
        return found

    def _drawer_of(self, count: int, shared: Shared | None) -> tuple[GroupRenderer, Shared]:
        """Return what draws groups of so many views or fewer, and what it shares."""
        if self._group is not None and count > self._group[1].group_size:
            # A worker drew a smaller group before.
            self._group[0].close()
            self._group = None
        if self._group is None:
            shared = shared or Shared.of(self._scene, self._cache, self._options, count)
            self._group = self._make_drawer(shared), shared
        return self._group

    def _make_drawer(self, shared: Shared) -> GroupRenderer:
        """Return what draws groups, into memory of its own."""
        shapes = batch.shapes_of(self._scene, shared.group_size, self._options)
        self._arrays = {name: np.empty(*of_all) for name, of_all in shapes.items()}
        return GroupRenderer(
            BatchScheduler(
                self._scene, shared.kept, self._options, self._arrays, lambda _: self._scene
            )
        )  # fmt: skip


class RendererPool:
    """
    Draws frames of one scene, each alone or several in one go, in several threads.

    Parameters
    ----------
    scene : Scene
    options : FrameRequest
    workers : int
        How many threads draw views.
    threads : int
        How many draw each view with one of those.
    pace : GrowingPace
    """

    def __init__(
        self, scene: Scene, options: FrameRequest, workers: int, threads: int, pace: GrowingPace
    ) -> None:
        self._scene, self._options = scene, options
        self._workers, self._threads = workers, threads
        self.pace = pace
        self._process = os.getpid()
        self._idle: queue.SimpleQueue[PoolWorker] = queue.SimpleQueue()
        self._pool_workers: list[PoolWorker] = []
        self._told: set[str] = set()
        self._shared: Shared | None = None

    def __enter__(self) -> RendererPool:
        self._process = os.getpid()
        self._pool = ThreadPoolExecutor(self._workers, thread_name_prefix="rasterjit-many")
        # They share what follows from the scene alone.
        self._cache = prepare_for(self._scene, self._options)
        for _ in range(self._workers):
            pool_worker = PoolWorker(self._scene, self._options, self._threads, self._cache)
            self._pool_workers.append(pool_worker)
            self._idle.put(pool_worker)
        return self

    def __exit__(self, *error: Any) -> None:
        # A forked process has none of the threads, and must not wait for them.
        if self._process != os.getpid():
            return
        self._pool.shutdown(wait=True, cancel_futures=True)
        for pool_worker in self._pool_workers:
            pool_worker.close()

    def submit(self, cameras: list[Camera]) -> Future[deque[ViewResult]]:
        """Begin the frames of some cameras, in one go."""
        return self._pool.submit(self._draw, cameras)

    def take(self, begun: Future[deque[ViewResult]]) -> Frame:
        """Return the next of frames that were begun in one go, when they are done."""
        if self._process != os.getpid():
            raise RuntimeError(
                "frames cannot be taken from an iterator that was begun before the process was "
                "forked: its threads are in the parent; call render_many again here"
            )
        frame = begun.result().popleft().taken(self._told)
        self.pace.see(frame, self._cache)
        if self._shared is None and self.pace.at_once > 1:
            self._shared = Shared.of(
                self._scene, self._cache, self._options, self.pace.at_once, frame.plan
            )
        return frame

    def _draw(self, cameras: list[Camera]) -> deque[ViewResult]:
        """Draw frames in one go."""
        pool_worker = self._idle.get()
        try:
            return pool_worker.draw(cameras, self._shared)
        finally:
            self._idle.put(pool_worker)


def draw_in_turns(
    scene: Scene, cameras: Sequence[Camera], options: FrameRequest, threads: int
) -> Iterator[Frame]:
    """
    Yield one frame for each camera, in order; nothing is drawn while the caller has one.

    Each is drawn by all threads, or some are drawn in one go by each of them. As `render_many`
    draws them they are the same, without what is drawn ahead: the caller's work takes longer.
    """
    cache = prepare_for(scene, options)
    told: set[str] = set()
    with ExitStack() as stack:
        alone = stack.enter_context(closing(PoolWorker(scene, options, threads, cache)))
        first = alone.draw(cameras[:1]).popleft().taken(told)
        room = -(-(len(cameras) - 1) // threads)
        count = views_at_once(first.plan, scene, cache, options, 1, room)
        shared = Shared.of(scene, cache, options, count, first.plan)
        yield first
        pool_workers: list[PoolWorker] = [alone]
        each: Callable[..., Iterator[deque[ViewResult]]] = map
        if count > 1:
            pool_workers = [
                stack.enter_context(closing(PoolWorker(scene, options, 1, cache)))
                for _ in range(threads)
            ]
            if threads > 1:
                pool = ThreadPoolExecutor(threads, thread_name_prefix="rasterjit-turns")
                each = stack.enter_context(pool).map
        for start in range(1, len(cameras), count * len(pool_workers)):
            starts = range(start, start + count * len(pool_workers), count)
            groups = [cameras[n : n + count] for n in starts]
            drawn = each(lambda one, group: one.draw(group, shared), pool_workers, groups)
            for begun in list(drawn):
                while begun:
                    yield begun.popleft().taken(told)


class LazyFrame(Frame):
    """
    A frame whose plan is made when it is first asked for.

    Parameters
    ----------
    outputs : dict of arrays
    make_plan : callable
        Returns the plan.
    stats : FrameStats
    face_starts : (O+1,) int64, optional
        Number of each object's first face.
    """

    def __init__(
        self,
        outputs: dict[str, NDArray[Any]],
        make_plan: Callable[[], RenderPlan],
        stats: FrameStats,
        face_starts: NDArray[np.int64] | None = None,
    ) -> None:
        self._plan: RenderPlan | Callable[[], RenderPlan]
        # The setter takes what makes it as well.
        plan: Any = make_plan
        super().__init__(outputs, plan, stats, None, face_starts)

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled: the plan, not all that it is made from."""
        return {**self.__dict__, "_plan": self.plan}

    @property
    def plan(self) -> RenderPlan:
        """What was decided for this frame."""
        if not isinstance(self._plan, RenderPlan):
            # What makes it holds the scene: that is let go.
            self._plan = self._plan()
        return self._plan

    @plan.setter
    def plan(self, value: RenderPlan | Callable[[], RenderPlan]) -> None:
        self._plan = value


class SceneSnapshot:
    """
    A snapshot of a scene, to plan its frames lazily.

    Parameters
    ----------
    scene : Scene
        May change from now on.
    cache : SceneCache
        Of the scene.
    request : FrameRequest
    """

    def __init__(self, scene: Scene, cache: SceneCache, request: FrameRequest) -> None:
        self._scene = scene_at(scene, cache.transforms.world_from_model)
        self._scene.lights = list(scene.lights)
        self._cache, self._request = cache, request

    def plan(self, camera: Camera) -> RenderPlan:
        """Return the plan of a view."""
        views = object_transforms.transform_to_view(
            self._cache.transforms, camera, self._request.size
        )
        return plan_frame(
            self._request, self._scene, camera, self._cache.inventory_and_extents, views
        )
