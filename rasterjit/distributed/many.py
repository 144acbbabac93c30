"""
Render many frames of one scene: on this machine, or on the machines of a cluster.

`render_many` chooses between the two. For a cluster, `Farm` is the client's side: it sends the
scene to the workers, submits frames and collects them. `draw_frames` is the worker's side.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.distributed.clusters import (
    SentTask,
    SharedScene,
    TaskFarm,
    check_client,
    count_threads,
)
from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.outputs.table import Outputs
from rasterjit.rendering import planning, view_warnings
from rasterjit.rendering.batch import (
    PROGRESS,
    Progress,
    check_arguments,
    check_cameras,
    check_prefetch,
    draw_all,
    settle_all,
    share_threads,
    with_bar,
)
from rasterjit.rendering.planning import Cull, FrameRequest
from rasterjit.rendering.renderer_pool import (
    GrowingPace,
    LazyFrame,
    PoolWorker,
    RendererPool,
    ViewResult,
)
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import one_of, thread_count

if TYPE_CHECKING:
    from distributed import Client

Drawn = tuple[dict[str, NDArray[Any]], FrameStats, dict[str, str]]
"""What a worker sends back of a frame: its arrays, statistics, and what there is to warn of."""


def render_many(
    what: Any,
    cameras: Iterable[Camera],
    *,
    size: tuple[int, int] = (1280, 720),
    quality: Quality | None = None,
    outputs: Outputs = ("color",),
    background: Background = None,
    cull: Cull = "none",
    threads: int | None = None,
    workers: int | None = None,
    prefetch: int | None = None,
    progress: Progress = "none",
    client: Client | None = None,
) -> Iterator[Frame]:
    """
    Render one frame for each camera, in order, while they are taken.

    Each frame has the bits that `rasterjit.render` gives. Frames are drawn ahead of the one that is
    taken, ``prefetch`` of them and no more, so memory stays bounded however many cameras there
    are; cameras are asked for as they are needed, in the thread that takes the frames. Closing the
    iterator, or leaving the loop by an error or Ctrl-C, ends all threads as soon as the frames that
    are just drawn are done.

    Small views that `rasterjit.render_batch` draws in machine code from view to view are drawn so
    here, too: several in one go, up to 32, where faces and pixels of a view are 131,072 together
    at most, as those of 256x256 with 60,000 faces, a thread draws each, and ``prefetch`` has room.
    Larger ones would gain nothing. The first frames are drawn alone, and tell whether it can be.
    The statistics of frames that were drawn in one go have one time beside compiling, ``"all
    stages"``: the same share for each; their plans are made when they are asked for.

    Parameters
    ----------
    what : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene
        Must stay as it is while frames are taken.
    cameras : iterable of Camera
        Near planes that they leave open are in one place for all of a sequence; of cameras that
        come as they are asked for, each has its own.
    size, quality, outputs, background, cull
        As `rasterjit.render` takes them, the same for all frames.
    threads : int, optional
        Threads of all workers together. Default: all processors, or ``workers`` if that is more.
        With a client: threads of each task, default 1.
    workers : int, optional
        How many frames are drawn at once, each by ``threads // workers`` threads; at most
        ``threads``. Default: as many as threads, which draws most frames a second; 1 draws the next
        frame soonest. With a client it must be None: its cluster has workers of its own.
    prefetch : int, optional
        Most frames that are drawn, or being drawn, ahead of the one taken last. Default: two for
        each worker; two groups for each, where views are drawn several in one go and ``cameras``
        is a sequence. Of cameras that come as they are asked for, with ``prefetch=128`` two
        workers have groups of 32.
    progress : {"none", "bar"}
        Whether a bar on standard error shows how many frames were taken.
    client : distributed.Client, optional
        A Dask cluster that draws the frames; see `rasterjit.distributed`.

    Returns
    -------
    iterator of Frame

    Raises
    ------
    ValueError
        Naming the argument that is wrong, at once; an item of ``cameras`` that are no sequence, but
        come as they are asked for, after the frames before it. So does a view that cannot be drawn,
        by its camera: ``cameras[3]``.
    RuntimeError
        If frames are taken in a forked process from an iterator that its parent began.
    ConnectionError
        If the client's scheduler is lost while frames are taken.
    """
    if workers is not None and client is not None:
        raise ValueError(f"workers must be None where a client is given, got {workers!r}")
    scene, options = check_arguments(what, size, quality, outputs, background, cull)
    check_cameras(cameras)
    one_of("progress", progress, PROGRESS)
    if client is not None:
        return farm_out(scene, cameras, options, threads, prefetch, progress, client)
    count, own = share_threads(threads, workers)
    pace = GrowingPace(scene, options, count, own, check_prefetch(prefetch), count_of(cameras))
    pool = RendererPool(scene, options, count, own, pace)
    settled = settle_all(scene, cameras, options)
    return with_bar(draw_all(pool, settled), cameras, progress)


def count_of(cameras: Iterable[Camera]) -> int | None:
    """Return how many cameras there are; ``None`` if they come as they are asked for."""
    return len(cameras) if isinstance(cameras, Sequence) else None


class FarFrame(LazyFrame):
    """A frame that a worker drew; its plan is made here, when it is first asked for."""

    def __init__(self, drawn: Drawn, scene: Scene, camera: Camera, options: FrameRequest) -> None:
        self._scene = scene
        make_plan = partial(planning.plan_frame, options, scene, camera)
        super().__init__(drawn[0], make_plan, drawn[1])

    def _first_faces(self) -> NDArray[np.int64]:
        """Return the number of each object's first face, (O+1,)."""
        return np.cumsum([0, *(len(node.mesh.faces) for node in self._scene.nodes)])


def share_scene(scene: Scene, options: FrameRequest, threads: int) -> SharedScene:
    """Return what all frames have in common; ``threads`` are those of each task."""
    return SharedScene(PoolWorker, scene, options, threads)


def draw_frames(shared: SharedScene, cameras: Sequence[Camera]) -> list[Drawn | Exception]:
    """
    Draw frames on a worker, which keeps what frames of one scene have in common.

    What there is to warn of goes to the caller; an error of another view than the first, too, in
    its place at the end.
    """
    with shared.renderer() as worker:
        begun = worker.draw(cameras)
    if isinstance(begun[0].result, Exception):
        raise begun[0].result
    return [as_drawn(one) for one in begun]


def as_drawn(one: ViewResult) -> Drawn | Exception:
    """Return what a worker sends back of a frame."""
    if isinstance(one.result, Exception):
        return one.result
    # Counted where the faces are: they do not travel for it.
    _ = one.result.stats.pixels_covered
    return one.result.arrays(), one.result.stats, one.notices


class FrameTask(NamedTuple):
    """Frames that a worker draws in one go."""

    task: SentTask
    cameras: list[Camera]
    """Of the frames that are not taken."""
    drawn: deque[Drawn | Exception]
    """What came back of those."""


class Farm:
    """
    The frames of one scene that a cluster draws.

    Parameters
    ----------
    client : Client
    scene : Scene
    options : FrameRequest
    threads : int
        Of each task.
    pace : GrowingPace
    """

    def __init__(
        self, client: Client, scene: Scene, options: FrameRequest, threads: int, pace: GrowingPace
    ) -> None:
        self.pace = pace
        self._scene, self._options = scene, options
        self._farm = TaskFarm(client, share_scene(scene, options, threads))
        self._begun: set[SentTask] = set()
        self._count = 0
        self._told: set[str] = set()

    def __enter__(self) -> Farm:
        return self

    def __exit__(self, *error: Any) -> None:
        self._farm.end(self._begun)
        self._begun.clear()

    def submit(self, cameras: list[Camera]) -> FrameTask:
        """Begin frames, in one task; those of earlier ones go first."""
        self._count += 1
        task = self._farm.begin(SentTask(draw_frames, list(cameras), priority=-self._count))
        self._begun.add(task)
        return FrameTask(task, cameras, deque())

    def take(self, begun: FrameTask) -> Frame:
        """Return the next frame of a task when it is done, wherever that is."""
        task, cameras, drawn = begun
        if task in self._begun:
            drawn += self._farm.result(task)
            self._begun.remove(task)
        one = drawn.popleft()
        if isinstance(one, Exception):
            raise one
        view_warnings.warn(one[2], self._told)
        frame = FarFrame(one, self._scene, cameras.pop(0), self._options)
        self.pace.see(frame, None)
        return frame


def farm_out(
    scene: Scene,
    cameras: Iterable[Camera],
    options: FrameRequest,
    threads: int | None,
    prefetch: int | None,
    progress: str,
    client: Client,
) -> Iterator[Frame]:
    """Yield frames in the order of the cameras; see `rasterjit.render_many`."""
    client = check_client(client)
    own = thread_count("threads", threads) or 1
    workers = count_threads(client)
    pace = GrowingPace(scene, options, workers, own, check_prefetch(prefetch), count_of(cameras))
    farm = Farm(client, scene, options, own, pace)
    settled = settle_all(scene, cameras, options)
    return with_bar(draw_all(farm, settled), cameras, progress)
