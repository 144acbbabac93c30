"""
Render many frames of one scene: on this machine, or on the machines of a cluster.

`render_many` chooses between the two. For a cluster, `FrameFarm` is the client's side: it sends the
scene to the workers, submits frames and collects them. `draw_frames` is the worker's side.
"""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.distributed.clusters import (
    SentTask,
    SharedScene,
    TaskFarm,
    check_client,
    check_pickles,
    count_threads,
)
from rasterjit.io.atomic_write import atomic_file, atomic_folder
from rasterjit.io.images import check_save_path
from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.outputs.output_table import Outputs
from rasterjit.pipeline.visibility.visibility_pass import Region
from rasterjit.rendering import batch, planning, view_warnings
from rasterjit.rendering.planning import Cull, FrameRequest
from rasterjit.rendering.regions import RegionRenderer, Survey, regions_of
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
from rasterjit.scene.validation import brief, needs_extra, one_of, thread_count

if TYPE_CHECKING:
    from distributed import Client
    from typing_extensions import TypeVar

    Result = TypeVar("Result", default=Frame)

Then: TypeAlias = Callable[[Frame], Any]
"""What is made of each frame where it was drawn."""

FrameData = tuple[dict[str, NDArray[Any]], FrameStats, "int | None"]
"""A frame as a worker returns it: arrays, statistics and number."""


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
    progress: batch.Progress = "none",
    client: Client | None = None,
    then: Callable[[Frame], Result] | None = None,
) -> Iterator[Result]:
    """
    Render one frame for each camera, in order, as an iterator.

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
    stages"``: the same share for each; their plans are made when they are asked for. With a client
    up to 128 small views of a sequence are one task, also those that are drawn alone.

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
    then : callable, optional
        Called with each frame where it was drawn; what it returns comes in place of the frame. So
        workers write files, crop pictures or count pixels, and whole frames do not travel from a
        cluster. ``frame.number`` is the index of its camera. No copy is made for it: it may change
        the frame, keep it, or return a part of its arrays. Without a client several threads call
        it at once. With a client it and what it returns must pickle; functions of the program
        itself and lambdas do, with cloudpickle.

    Returns
    -------
    iterator of Frame, or of what ``then`` returns

    Raises
    ------
    ValueError
        Naming the argument that is wrong, at once; an item of ``cameras`` that are no sequence, but
        come as they are asked for, after the frames before it. So does a view that cannot be drawn,
        by its camera: ``cameras[3]``.
    RuntimeError
        If ``then`` fails, naming the camera and the error, after what comes before it; without a
        client that error is its ``__cause__``. If frames are taken in a forked process from an
        iterator that its parent began.
    ConnectionError
        If the client's scheduler is lost while frames are taken.
    """
    if workers is not None and client is not None:
        raise ValueError(f"workers must be None where a client is given, got {workers!r}")
    scene, options = batch.check_arguments(what, size, quality, outputs, background, cull)
    batch.check_cameras(cameras)
    one_of("progress", progress, batch.PROGRESS)
    if then is not None and not callable(then):
        raise ValueError(f"then must be a function of a frame, got {brief(then)}")
    if client is not None:
        return _render_on_cluster(
            scene, cameras, options, threads, prefetch, progress, client, then
        )
    count, threads_each = batch.share_threads(threads, workers)
    pace = GrowingPace(
        scene, options, count, threads_each, batch.check_prefetch(prefetch), count_cameras(cameras)
    )
    pool = RendererPool(scene, options, count, threads_each, pace, then)
    settled = batch.share_clip_planes_of_frames(scene, cameras, options)
    return batch.show_progress_bar(batch.yield_frames(pool, settled), cameras, progress)


def count_cameras(cameras: Iterable[Camera]) -> int | None:
    """Return the number of cameras; ``None`` if they are no sequence."""
    return len(cameras) if isinstance(cameras, Sequence) else None


class RemoteFrame(LazyFrame):
    """A frame that a worker drew; its plan is made by this process, on first use."""

    def __init__(self, raw: FrameData, scene: Scene, camera: Camera, options: FrameRequest) -> None:
        self._scene = scene
        outputs, stats, number = raw
        super().__init__(outputs, partial(planning.make_plan, options, scene, camera), stats)
        self.number = number

    def _find_first_faces(self) -> NDArray[np.int64]:
        """Return the number of each object's first face, (O+1,)."""
        return np.cumsum([0, *(len(node.mesh.faces) for node in self._scene.nodes)])


def share_scene(
    scene: Scene, options: FrameRequest, threads: int, then: Then | None = None
) -> SharedScene:
    """Return the arguments that all frames share; ``threads`` is the number for each task."""
    return SharedScene(PoolWorker, scene, options, threads, then or pack_frame)


def draw_frames(
    shared: SharedScene, cameras: Sequence[Camera], first: int = 0, group_size: int = 1
) -> list[ViewResult]:
    """
    Draw frames on a worker in groups, which caches what frames of one scene share.

    The last may be an error; that of the first view is raised.
    """
    views: list[ViewResult] = []
    with shared.renderer() as worker:
        for start in range(0, len(cameras), group_size):
            views += worker.draw(cameras[start : start + group_size], first + start)
            if views[-1].error is not None:
                break
    error = views[-1].error
    if error is not None:
        # It may not pickle.
        error.__cause__ = None
        if len(views) == 1:
            raise error
    return [view._replace(plan=None) for view in views]


def pack_frame(frame: Frame) -> FrameData:
    """Return what is sent of a frame."""
    # Counted here, so that faces need not be sent for it.
    _ = frame.stats.pixels_covered
    return frame.arrays(), frame.stats, frame.number


class FrameTask(NamedTuple):
    """Frames that a worker draws as one task."""

    task: SentTask
    cameras: list[Camera]
    """Cameras of the frames that are not yet taken."""
    drawn: deque[ViewResult]
    """Frames that are drawn and not yet taken."""


class FrameFarm:
    """
    Draws the frames of one scene on a cluster.

    Parameters
    ----------
    client : Client
    scene : Scene
    options : FrameRequest
    threads : int
        Number for each task.
    pace : GrowingPace
    then : callable, optional
        What is made of each frame. Default: the frame itself.
    """

    def __init__(
        self, client: Client, scene: Scene, options: FrameRequest, threads: int, pace: GrowingPace,
        then: Then | None = None,
    ) -> None:  # fmt: skip
        self.pace = pace
        self._scene, self._options, self._then = scene, options, then
        self._farm = TaskFarm(client, share_scene(scene, options, threads, then))
        self._tasks: set[SentTask] = set()
        self._warned: set[str] = set()

    def __enter__(self) -> FrameFarm:
        return self

    def __exit__(self, *error: Any) -> None:
        self._farm.end(self._tasks)
        self._tasks.clear()

    def submit(self, cameras: list[Camera], first: int) -> FrameTask:
        """Submit frames as one task; earlier tasks have priority."""
        arguments = list(cameras), first, self.pace.group_size
        task = self._farm.begin(SentTask(draw_frames, *arguments, priority=-first))
        self._tasks.add(task)
        return FrameTask(task, cameras, deque())

    def take(self, frame_task: FrameTask) -> Any:
        """Return the next frame of a task when the task is done, or what was made of it."""
        task, cameras, drawn = frame_task
        if task in self._tasks:
            try:
                drawn += self._farm.result(task)
            except TypeError as error:
                if self._then is None or task.future is None or task.future.status == "error":
                    raise
                # The task is done, and its results do not arrive.
                first, reason = task.arguments[1], str(error).strip().splitlines()[-1]
                raise RuntimeError(
                    "then must return what pickles, to come from a cluster, of cameras"
                    f"[{first}:{first + len(cameras)}]: {reason}"
                ) from None
            self._tasks.remove(task)
        result, camera = drawn.popleft().unwrap(self._warned), cameras.pop(0)
        if self._then is None:
            result = RemoteFrame(result, self._scene, camera, self._options)
        self.pace.adapt(partial(planning.make_plan, self._options, self._scene, camera), None)
        return result


def _render_on_cluster(
    scene: Scene,
    cameras: Iterable[Camera],
    options: FrameRequest,
    threads: int | None,
    prefetch: int | None,
    progress: str,
    client: Client,
    then: Then | None,
) -> Iterator[Any]:
    """Yield frames in the order of the cameras; see `rasterjit.render_many`."""
    client = check_client(client)
    check_pickles("then", then)
    threads_each = thread_count("threads", threads) or 1
    workers = count_threads(client)
    prefetch = batch.check_prefetch(prefetch)
    count = count_cameras(cameras)
    pace = GrowingPace(scene, options, workers, threads_each, prefetch, count, is_remote=True)
    farm = FrameFarm(client, scene, options, threads_each, pace, then)
    cameras_settled = batch.share_clip_planes_of_frames(scene, cameras, options)
    return batch.show_progress_bar(batch.yield_frames(farm, cameras_settled), cameras, progress)


PICTURE_FORMATS = (".tif", ".tiff", ".zarr")

TILES_PER_THREAD = 2
"""Most tiles that are drawn or waiting, for each thread of a cluster."""

Tiles = Generator[tuple[Region, NDArray[np.uint8]], None, None]


def render_large(
    what: Any,
    camera: Camera | None,
    size: tuple[int, int],
    path: str | Path,
    *,
    tile: int = 1024,
    quality: Quality | None = None,
    background: Background = None,
    cull: Cull = "none",
    threads: int | None = None,
    client: Client | None = None,
) -> None:
    """
    Render a picture that is too large for one frame, tile by tile into a file.

    Each tile has the bits that the whole picture has there. No more than two tiles, or with a
    cluster two for each of its threads, are held at a time. The scene must fit each machine.

    Parameters
    ----------
    what : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene
    camera : Camera or None
        None takes the scene's own camera, else one that fits the scene.
    size : (int, int)
        Width and height, pixels, each in 1..131072, or less with more than 9 sub-pixel bits.
    path : str or Path
        ``.tif`` or ``.tiff``: a tiled BigTIFF, RGBA, losslessly compressed. ``.zarr``: an array
        (H, W, 4) uint8 of format 3, a chunk for each tile; needs Python 3.11. Written whole or not
        at all; what was there before is replaced.
    tile : int
        Side of the tiles, pixels: a multiple of 64 up to 16384. Every tile takes all vertices to
        the screen, so small tiles of a large mesh cost time, and large ones memory.
    quality, background, cull
        As `rasterjit.render` takes them.
    threads : int, optional
        Default: all processors; with a client, 1 for each task.
    client : distributed.Client, optional
        A cluster that draws the tiles. Default: this process does.

    Raises
    ------
    ValueError
        Naming the argument that is wrong, or the effect that looks beyond the edges of a tile:
        ambient occlusion, outlines, and see-through surfaces with 2 to 16 samples.
    ImportError
        If what writes the file is not installed.
    OSError
        If the file cannot be written, as on a full disk; what was there before is kept.
    ConnectionError
        If the client's scheduler is lost.
    """
    target = _check_path(path)
    regions_of((1, 1), tile)
    write = _make_writer(target)
    arguments = {
        "camera": camera, "size": size, "quality": quality, "background": background, "cull": cull,
    }  # fmt: skip
    threads = thread_count("threads", threads)
    client = None if client is None else check_client(client)
    renderer = RegionRenderer(what, threads=threads, **arguments)
    view_warnings.warn(view_warnings.warnings_of(renderer.plan), set())
    with renderer:
        picture_size = renderer.size
        if client is None:
            tiles = _draw_locally(renderer, tile)
        else:
            arguments["camera"] = renderer.plan.camera
            # Workers may not be able to read the file of a background.
            arguments["background"] = renderer.plan.facts.background_image or background
            farm = TileFarm(client, what, arguments, threads or 1)
            tiles = _draw_on_cluster(farm, renderer, tile)
        with closing(tiles):
            write(tiles, picture_size, tile)


def _draw_locally(renderer: RegionRenderer, tile: int) -> Tiles:
    """Yield the tiles, row by row."""
    for region, frame in renderer.render_regions(tile):
        yield region, frame.color
        # Release the frame before the next one is drawn.
        del frame


class TileFarm:
    """
    Draws the tiles of one picture on a cluster.

    Parameters
    ----------
    client : Client
    what : Scene or mesh
    arguments : dict
        Of `RegionRenderer`.
    threads : int
        Number for each task.
    """

    def __init__(self, client: Client, what: Any, arguments: dict[str, Any], threads: int) -> None:
        self._client = client
        self._task: tuple[Any, ...] = what, arguments, threads

    def map_regions(
        self, function: Callable[..., Any], regions: Sequence[Region], *surveys: Any
    ) -> Iterator[tuple[Region, Any]]:
        """Yield each region and a function's result for it from a worker, in order, few ahead."""
        max_tasks = TILES_PER_THREAD * count_threads(self._client)
        farm = TaskFarm(self._client, SharedScene(_make_region_renderer, *self._task, *surveys))
        tasks: deque[tuple[Region, SentTask]] = deque()
        pending = iter(regions)
        try:
            while True:
                while len(tasks) < max_tasks and (region := next(pending, None)) is not None:
                    tasks.append((region, farm.begin(SentTask(function, region))))
                if not tasks:
                    return
                region, task = tasks.popleft()
                yield region, farm.result(task)
                del task
        finally:
            farm.end(task for _, task in tasks)


def _draw_on_cluster(farm: TileFarm, renderer: RegionRenderer, tile: int) -> Tiles:
    """Yield the tiles that a cluster draws, row by row; survey them first if shadows need it."""
    regions = regions_of(renderer.size, tile)
    if not renderer.needs_surveys:
        yield from farm.map_regions(_draw_tile, regions)
        return
    surveys = dict(farm.map_regions(_survey_tile, regions))
    yield from farm.map_regions(_draw_tile, regions, surveys)


def _make_region_renderer(
    what: Any, arguments: dict[str, Any], threads: int, *surveys: dict[Region, Survey]
) -> RegionRenderer:
    """Return a renderer of tiles on a worker, with the surveys of all tiles if given."""
    renderer = RegionRenderer(what, threads=threads, **arguments)
    if surveys:
        renderer.take_surveys(surveys[0])
    return renderer


def _survey_tile(shared: SharedScene, region: Region) -> Survey:
    """Survey a tile on a worker."""
    with shared.renderer() as renderer:
        return renderer.survey(region)


def _draw_tile(shared: SharedScene, region: Region) -> NDArray[np.uint8]:
    """Draw a tile on a worker; (h, w, 4)."""
    with shared.renderer() as renderer:
        return renderer.render_region(region).color


def _check_path(path: Any) -> Path:
    """Return the path to write to, or raise ``ValueError``; only a Zarr array may be replaced."""
    if isinstance(path, (str, os.PathLike)) and str(path).lower().endswith(".zarr"):
        target = Path(path)
        if os.path.lexists(target) and not _is_zarr_array(target):
            raise ValueError(f"path {str(target)!r} is there, but is no Zarr array to be replaced")
        absent = target.with_name(f"{target.name}.zarr")
        return check_save_path(absent, PICTURE_FORMATS).with_name(target.name)
    return check_save_path(path, PICTURE_FORMATS)


def _is_zarr_array(target: Path) -> bool:
    """Tell whether a folder is a Zarr array, not a group of them or anything else."""
    try:
        metadata = json.loads((target / "zarr.json").read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(metadata, dict) and metadata.get("node_type") == "array"


def _make_writer(target: Path) -> Callable[[Tiles, tuple[int, int], int], None]:
    """Return a function that writes tiles to a path, by the library for its format."""
    with needs_extra("large", f"writing a {target.suffix} tile by tile needs a package"):
        if target.suffix.lower() == ".zarr":
            import zarr

            return lambda tiles, size, tile: _write_zarr(zarr, target, tiles, size, tile)
        import tifffile
    return lambda tiles, size, tile: _write_tiff(tifffile, target, tiles, size, tile)


def _write_tiff(tifffile: Any, path: Path, tiles: Tiles, size: tuple[int, int], tile: int) -> None:
    """Write tiles to a BigTIFF."""
    width, height = size

    def pad_tiles() -> Iterator[NDArray[np.uint8]]:
        for _, color in tiles:
            yield _pad_tile(color, tile)
            # Release the tile before the next one is drawn.
            del color

    with atomic_file(path) as temporary, tifffile.TiffWriter(temporary, bigtiff=True) as file:
        file.write(
            pad_tiles(), shape=(height, width, 4), dtype=np.uint8, tile=(tile, tile),
            photometric="rgb", extrasamples=["unassalpha"], compression="zlib",
            software="RasterJIT",
            # With more workers it reads tiles ahead, up to 512 MiB of them.
            maxworkers=1,
        )  # fmt: skip


def _pad_tile(color: NDArray[np.uint8], tile: int) -> NDArray[np.uint8]:
    """Return a tile padded to its full size, as a TIFF needs it."""
    height, width, _ = color.shape
    if height == width == tile:
        return color
    return np.pad(color, ((0, tile - height), (0, tile - width), (0, 0)))


def _write_zarr(zarr: Any, target: Path, tiles: Tiles, size: tuple[int, int], tile: int) -> None:
    """Write tiles to the chunks of a Zarr array."""
    width, height = size
    with atomic_folder(target) as temporary:
        with _name_picture_in_errors(target):
            array = zarr.create_array(
                store=str(temporary), shape=(height, width, 4), chunks=(tile, tile, 4),
                dtype="uint8", dimension_names=("row", "column", "channel"),
            )  # fmt: skip
        for region, color in tiles:
            rows = slice(region.top, region.top + region.height)
            with _name_picture_in_errors(target):
                array[rows, region.left : region.left + region.width] = color
            del color


@contextmanager
def _name_picture_in_errors(target: Path) -> Iterator[None]:
    """Name the picture in errors of the system, instead of one of its files."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(target)) from error
