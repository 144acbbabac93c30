"""
A pool of renderers: draw frames of one scene in several threads, small ones in groups.

`views_at_once` chooses the size of groups after the first frame, whose plan tells whether views of
the scene are eligible. Groups are drawn by recorded calls (``batch_scheduler.py``). Other views are
drawn one by one, and so is a group in which anything fails: an error is raised for its view, after
the frames before it.
"""

from __future__ import annotations

import math
import os
import queue
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.rendering import batch, batch_scheduler, view_warnings
from rasterjit.rendering.batch import FRAMES_AHEAD_PER_WORKER, Pace, scene_at
from rasterjit.rendering.batch_scheduler import (
    BatchCache,
    BatchScheduler,
    GroupRenderer,
    can_batch,
)
from rasterjit.rendering.planning import FrameRequest, make_plan
from rasterjit.rendering.renderer import Renderer
from rasterjit.runtime.clocks import StageClock
from rasterjit.scene.camera import Camera
from rasterjit.scene.scene import Scene
from rasterjit.survey import object_transforms
from rasterjit.survey.cache import SceneCache, update_cache
from rasterjit.survey.plan import RenderPlan

MAX_GROUP_BYTES = 1 << 23
"""Most memory for the outputs of a group."""


def may_pay(scene: Scene, options: FrameRequest, threads: int, max_at_once: int) -> bool:
    """Tell, without a plan, whether groups of views may pay: see `views_at_once`."""
    is_eligible = threads == 1 and max_at_once > 1 and batch_scheduler.may_batch(options)
    return is_eligible and batch.is_small_view(options.size, scene)


def views_at_once(
    plan: RenderPlan,
    scene: Scene,
    cache: SceneCache,
    options: FrameRequest,
    threads: int,
    max_at_once: int,
) -> int:
    """
    Return how many views a thread draws as one group; 1: each is drawn alone.

    Views are drawn alone if they are ineligible (`can_batch`), if several threads draw each of
    them, or if they are so large that a group would take long or much memory, and gain nothing.

    Parameters
    ----------
    plan : RenderPlan
        Of one view.
    scene : Scene
    cache : SceneCache
        Of the scene.
    options : FrameRequest
    threads : int
        Threads for each view.
    max_at_once : int
        Most views of a group.
    """
    if not may_pay(scene, options, threads, max_at_once) or not can_batch(plan, scene, cache):
        return 1
    most = min(max_at_once, batch.MAX_VIEWS_PER_GROUP)
    return limit_views(scene, options, most, batch.MAX_WORK_PER_STREAM_GROUP)


def limit_views(scene: Scene, options: FrameRequest, most: int, max_work: int) -> int:
    """Return how many views, at least 1, have so much work at most, and fit a group's memory."""
    work = batch.estimate_work(options.size, scene)
    shapes = batch.find_output_shapes(scene, 1, options).values()
    view_bytes = sum(math.prod(shape) * np.dtype(dtype).itemsize for shape, dtype in shapes)
    return max(1, min(most, max_work // work, MAX_GROUP_BYTES // view_bytes))


class GrowingPace(Pace):
    """
    Prefetches single views at first, for low latency; then groups, if the first frame allows it.

    Parameters
    ----------
    scene : Scene
    options : FrameRequest
    workers : int
        Threads or processes that draw views.
    threads : int
        Threads of each worker.
    prefetch : int, optional
        Most frames begun and not yet taken. Default: for each worker one being drawn, one waiting;
        or one group of each, if the number of cameras is known.
    count : int, optional
        Number of cameras, if known.
    is_remote : bool
        Whether workers are on a cluster, which has small views as few tasks: also those that are
        drawn alone, and several groups.
    """

    def __init__(
        self, scene: Scene, options: FrameRequest, workers: int, threads: int,
        prefetch: int | None = None, count: int | None = None, is_remote: bool = False,
    ) -> None:  # fmt: skip
        tasks_ahead = FRAMES_AHEAD_PER_WORKER * workers
        super().__init__(1, min(prefetch or tasks_ahead, tasks_ahead))
        self._scene, self._options, self._threads = scene, options, threads
        self._tasks_ahead, self._prefetch, self._count = tasks_ahead, prefetch, count
        self._is_remote, self._is_decided = is_remote, False
        self.group_size = 1
        """Views that are drawn as one group."""

    def adapt(self, plan_first: Callable[[], RenderPlan], cache: SceneCache | None) -> None:
        """Decide the size of groups once, given the first view's plan and its scene's cache."""
        if self._is_decided:
            return
        self._is_decided = True
        begun, self.ahead = self.ahead, self._prefetch or self._tasks_ahead
        max_at_once = self.ahead // self._tasks_ahead
        if self._prefetch is None and self._count is not None:
            # Share the views that are not yet begun evenly among the tasks.
            max_at_once = -(-(self._count - begun) // self._tasks_ahead)
        scene, options = self._scene, self._options
        # Only now read the plan, which is made for it after a cluster has drawn the view.
        if may_pay(scene, options, self._threads, max_at_once):
            cache, plan = cache or prepare_scene(scene, options), plan_first()
            self.group_size = views_at_once(plan, scene, cache, options, self._threads, max_at_once)
        self.at_once = self.group_size
        if self._is_remote and batch.is_small_view(options.size, scene):
            most = min(max_at_once, batch.MAX_VIEWS_PER_LARGE_GROUP)
            self.at_once = limit_views(scene, options, most, batch.MAX_WORK_PER_BATCH_GROUP)
        self.ahead = self._prefetch or self._tasks_ahead * self.at_once


def prepare_scene(scene: Scene, options: FrameRequest) -> SceneCache:
    """Analyse the nodes of a scene, for all views."""
    return update_cache(scene.nodes, None, options.quality, scene.environment is not None)


class ViewResult(NamedTuple):
    """What became of a view, with its warnings, or its error."""

    result: Any
    """The frame, or what a function made of it."""
    warnings: dict[str, str]
    plan: RenderPlan | None = None
    """Of a view that was drawn alone."""
    error: Exception | None = None

    def unwrap(self, warned: set[str]) -> Any:
        """Return the result and issue warnings of kinds not in ``warned``, or raise the error."""
        if self.error is not None:
            raise self.error
        view_warnings.warn(self.warnings, warned)
        return self.result

    def apply(self, then: Callable[[Frame], Any], number: int) -> ViewResult:
        """Return what a function makes of the frame; ``number`` is that of the view."""
        self.result.number = number
        try:
            return self._replace(result=then(self.result))
        except Exception as error:
            # Named here: what comes from another process has neither cause nor place.
            place = traceback.extract_tb(error.__traceback__)[-1]
            failure = RuntimeError(
                f"then failed for cameras[{number}]: {type(error).__name__}: {error} "
                f"({Path(place.filename).name}, line {place.lineno})"
            )
            failure.__cause__ = error
            return self._replace(result=None, error=failure)


class GroupState(NamedTuple):
    """State shared by the threads that draw groups of views."""

    batch_cache: BatchCache
    snapshot: SceneSnapshot
    group_size: int
    """Views of a group."""

    @classmethod
    def of(
        cls, scene: Scene, cache: SceneCache, options: FrameRequest, group_size: int,
        first: RenderPlan | None = None,
    ) -> GroupState:  # fmt: skip
        """Create the state for groups of a size, given the plan of a view, if there is one."""
        batch_cache = BatchCache(cache)
        batch_cache.first = first
        return cls(batch_cache, SceneSnapshot(scene, cache, options), group_size)


class PoolWorker:
    """
    Draws views of a scene in one thread of the pool.

    Parameters
    ----------
    scene : Scene
    options : FrameRequest
    threads : int
        Threads for each frame.
    then : callable, optional
        What is made of each frame. Default: the frame itself.
    cache : SceneCache, optional
        Of the scene.
    """

    def __init__(
        self, scene: Scene, options: FrameRequest, threads: int,
        then: Callable[[Frame], Any] | None = None, cache: SceneCache | None = None,
    ) -> None:  # fmt: skip
        cache = cache or prepare_scene(scene, options)
        self._scene, self._options, self._cache = scene, options, cache
        self._then = then or (lambda frame: frame)
        self._renderer = Renderer.timed(options.size, options.quality, threads, cache)
        self._arrays: dict[str, NDArray[Any]] = {}
        self._group: tuple[GroupRenderer, GroupState] | None = None

    def close(self) -> None:
        """Stop the threads, and release the memory."""
        self._renderer.close()
        if self._group is not None:
            self._group[0].close()

    def draw(
        self, cameras: Sequence[Camera], first: int = 0, group_state: GroupState | None = None
    ) -> deque[ViewResult]:
        """
        Draw views until one fails.

        Parameters
        ----------
        cameras : sequence of Camera
        first : int
            Number of the first view.
        group_state : GroupState, optional
            Default: not shared with other threads.
        """
        of_group: dict[int, ViewResult] = {}
        if len(cameras) > 1:
            # After an error all views are drawn alone: the one that causes it raises it again.
            with suppress(Exception):
                of_group = self._draw_group(cameras, group_state)
        results: deque[ViewResult] = deque()
        for n, camera in enumerate(cameras):
            view = of_group.pop(n) if n in of_group else self._draw_alone(camera)
            results.append(view if view.error else view.apply(self._then, first + n))
            if results[-1].error:
                break
        return results

    def _draw_alone(self, camera: Camera) -> ViewResult:
        """Draw a view as `rasterjit.render` does."""
        try:
            # The pool warns once, for all of them.
            frame = self._renderer._plan_and_draw(self._options, self._scene, camera)
        except Exception as error:
            return ViewResult(None, {}, error=error)
        return ViewResult(frame, view_warnings.warnings_of_frame(frame), frame.plan)

    def _draw_group(
        self, cameras: Sequence[Camera], group_state: GroupState | None
    ) -> dict[int, ViewResult]:
        """Draw the eligible views as a group; return their results by index."""
        clock = StageClock()
        drawer, state = self._get_drawer(len(cameras), group_state)
        counts, is_drawn, warnings = drawer.draw(range(len(cameras)), cameras, None)
        clock("all stages")
        drawn = np.flatnonzero(is_drawn).tolist()
        results, starts = {}, self._cache.shapes.arrays.face_starts
        for n in drawn:
            arrays = {name: array[n].copy() for name, array in self._arrays.items()}
            seconds = {stage: total / len(drawn) for stage, total in clock.seconds.items()}
            stats = batch.make_stats(counts[n], seconds)
            plan = partial(state.snapshot.plan, cameras[n])
            results[n] = ViewResult(LazyFrame(arrays, plan, stats, starts), warnings.of(n))
        return results

    def _get_drawer(
        self, count: int, group_state: GroupState | None
    ) -> tuple[GroupRenderer, GroupState]:
        """Return the drawer of groups of up to ``count`` views, and its state."""
        if self._group is not None and count > self._group[1].group_size:
            # The worker drew smaller groups before.
            self._group[0].close()
            self._group = None
        if self._group is None:
            group_state = group_state or GroupState.of(
                self._scene, self._cache, self._options, count
            )
            self._group = self._make_drawer(group_state), group_state
        return self._group

    def _make_drawer(self, group_state: GroupState) -> GroupRenderer:
        """Create a drawer of groups, with memory for their outputs."""
        shapes = batch.find_output_shapes(self._scene, group_state.group_size, self._options)
        self._arrays = {name: np.empty(*of_all) for name, of_all in shapes.items()}
        return GroupRenderer(
            BatchScheduler(
                self._scene, group_state.batch_cache, self._options, self._arrays,
                lambda _: self._scene,
            )
        )  # fmt: skip


class RendererPool:
    """
    Draws frames of one scene, alone or in groups, in several threads.

    Parameters
    ----------
    scene : Scene
    options : FrameRequest
    workers : int
        Threads that draw views.
    threads : int
        Threads of each worker.
    pace : GrowingPace
    then : callable, optional
        As `PoolWorker` takes it.
    """

    def __init__(
        self, scene: Scene, options: FrameRequest, workers: int, threads: int, pace: GrowingPace,
        then: Callable[[Frame], Any] | None = None,
    ) -> None:  # fmt: skip
        self._scene, self._options, self._then = scene, options, then
        self._workers, self._threads = workers, threads
        self.pace = pace
        self._process = os.getpid()
        self._idle_workers: queue.SimpleQueue[PoolWorker] = queue.SimpleQueue()
        self._pool_workers: list[PoolWorker] = []
        self._warned: set[str] = set()
        self._group_state: GroupState | None = None

    def __enter__(self) -> RendererPool:
        self._process = os.getpid()
        self._pool = ThreadPoolExecutor(self._workers, thread_name_prefix="rasterjit-many")
        # The workers share the scene's cache.
        self._cache = prepare_scene(self._scene, self._options)
        for _ in range(self._workers):
            pool_worker = PoolWorker(
                self._scene, self._options, self._threads, self._then, self._cache
            )
            self._pool_workers.append(pool_worker)
            self._idle_workers.put(pool_worker)
        return self

    def __exit__(self, *error: Any) -> None:
        # A forked process has none of the threads, and must not wait for them.
        if self._process != os.getpid():
            return
        self._pool.shutdown(wait=True, cancel_futures=True)
        for pool_worker in self._pool_workers:
            pool_worker.close()

    def submit(self, cameras: list[Camera], first: int) -> Future[deque[ViewResult]]:
        """Begin the frames of some cameras, as one task; ``first`` is the number of the first."""
        return self._pool.submit(self._draw, cameras, first)

    def take(self, task: Future[deque[ViewResult]]) -> Any:
        """Wait for the next frame of a task, and return it, or what was made of it."""
        if self._process != os.getpid():
            raise RuntimeError(
                "frames cannot be taken from an iterator that was begun before the process was "
                "forked: its threads are in the parent; call render_many again here"
            )
        view = task.result().popleft()
        result, plan = view.unwrap(self._warned), view.plan
        if plan is not None:
            self.pace.adapt(lambda: plan, self._cache)
        if self._group_state is None and self.pace.at_once > 1:
            self._group_state = GroupState.of(
                self._scene, self._cache, self._options, self.pace.at_once, plan
            )
        return result

    def _draw(self, cameras: list[Camera], first: int) -> deque[ViewResult]:
        """Draw the frames of a task by a free worker."""
        pool_worker = self._idle_workers.get()
        try:
            return pool_worker.draw(cameras, first, self._group_state)
        finally:
            self._idle_workers.put(pool_worker)


def draw_in_turns(
    scene: Scene, cameras: Sequence[Camera], options: FrameRequest, threads: int
) -> Iterator[Frame]:
    """
    Yield one frame for each camera, in order, as `render_many` does, but without prefetching.

    All threads draw one frame after the other, or each thread a group. For callers whose own work
    on a frame takes longer.
    """
    cache = prepare_scene(scene, options)
    warned: set[str] = set()
    with ExitStack() as stack:
        alone = stack.enter_context(closing(PoolWorker(scene, options, threads, cache=cache)))
        first = alone.draw(cameras[:1]).popleft().unwrap(warned)
        max_at_once = -(-(len(cameras) - 1) // threads)
        count = views_at_once(first.plan, scene, cache, options, 1, max_at_once)
        group_state = GroupState.of(scene, cache, options, count, first.plan)
        yield first
        pool_workers: list[PoolWorker] = [alone]
        each: Callable[..., Iterator[deque[ViewResult]]] = map
        if count > 1:
            pool_workers = [
                stack.enter_context(closing(PoolWorker(scene, options, 1, cache=cache)))
                for _ in range(threads)
            ]
            if threads > 1:
                pool = ThreadPoolExecutor(threads, thread_name_prefix="rasterjit-turns")
                each = stack.enter_context(pool).map
        for start in range(1, len(cameras), count * len(pool_workers)):
            starts = range(start, start + count * len(pool_workers), count)
            groups = [cameras[n : n + count] for n in starts]
            drawn = each(
                lambda worker, group: worker.draw(group, 0, group_state), pool_workers, groups
            )
            for results in list(drawn):
                while results:
                    yield results.popleft().unwrap(warned)


class LazyFrame(Frame):
    """
    A frame whose plan is made when first read.

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
        # The setter takes a function as well.
        plan: Any = make_plan
        super().__init__(outputs, plan, stats, None, face_starts)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to pickle: with the plan, without the scene that it is made from."""
        return {**self.__dict__, "_plan": self.plan}

    @property
    def plan(self) -> RenderPlan:
        """The plan of this frame, made on first use."""
        if not isinstance(self._plan, RenderPlan):
            # This also releases the scene that `make_plan` holds.
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
        return make_plan(self._request, self._scene, camera, self._cache.inventory_and_boxes, views)
