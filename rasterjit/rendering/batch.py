"""
Render many views of one scene, into batched arrays or as a stream of frames.

Views are split into groups, each drawn by one thread. A stream yields frames in order, a few drawn
ahead. With enough frames, one thread draws each frame: no thread waits at the end of a stage, or
for a serial one. ``benchmarks/many.py`` measures the gain.
"""

from __future__ import annotations

import itertools
import math
import operator
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, nullcontext
from functools import partial
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.outputs import output_table
from rasterjit.outputs.batch import Batch
from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.outputs.output_table import Outputs, find_array_spec, is_attribute
from rasterjit.rendering import batch_scheduler, planning, view_warnings
from rasterjit.rendering.batch_scheduler import (
    BATCH_CACHES,
    COUNTED,
    BatchScheduler,
    can_batch,
    renew_batch_cache,
)
from rasterjit.rendering.planning import Cull, FrameRequest
from rasterjit.rendering.renderer import Renderer
from rasterjit.rendering.view_warnings import WarningsOfViews
from rasterjit.runtime.background_compile import compile_in_background
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.background import Background, BackgroundImage, read_background
from rasterjit.scene.camera import Camera, check_camera
from rasterjit.scene.mesh import ATTRIBUTE
from rasterjit.scene.node import LAST_ROW_ROUNDING, Node
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene, with_labels
from rasterjit.scene.transforms import product_of_each
from rasterjit.scene.validation import brief, image_size, number_array, thread_count
from rasterjit.survey.cache import SceneCache, update_cache
from rasterjit.survey.deformation import pose_input
from rasterjit.survey.object_counts import find_attribute
from rasterjit.survey.object_transforms import KNOWN_CAMERAS, compute_projection

Arrays = dict[str, NDArray[Any]]
Frames = Generator[Any, None, None]
"""Frames, or what was made of them."""

MAX_VIEWS_PER_GROUP = 32
"""Most views of a group in streams and small batches."""

MAX_VIEWS_PER_LARGE_GROUP = 128
"""Most views of a group in large batches: a group has the fixed cost of 4 views of 64 x 64."""

MIN_GROUPS_PER_THREAD = 4
"""Fewest groups per thread in large batches, for load balance."""

MAX_WORK_PER_STREAM_GROUP = 1 << 21
"""Most faces and pixels, about, of a group of a stream."""

MAX_WORK_PER_BATCH_GROUP = 1 << 22
"""Most faces and pixels, about, of a group of a batch: far less than a second's work."""

MAX_WORK = 1 << 17
"""Most faces and pixels, about, of a view for which groups and caches pay."""

PIXEL_BYTES = 4
"""Required alignment of arrays, bytes: a pixel is written as one word."""

OBJECT_WORK = 64
"""Cost of an object's matrices, in faces."""

_GET_COUNTS = operator.attrgetter(*COUNTED)

FRAMES_AHEAD_PER_WORKER = 2
"""Frames begun for each worker before any is taken: one being drawn, one waiting."""

Progress: TypeAlias = Literal["none", "bar"]
PROGRESS: tuple[Progress, ...] = get_args(Progress)


def render_batch(
    what: Any,
    cameras: Iterable[Camera],
    *,
    size: tuple[int, int],
    outputs: Outputs = ("color",),
    quality: Quality | None = None,
    background: Background = None,
    cull: Cull | None = None,
    transforms: ArrayLike | None = None,
    out: Mapping[str, NDArray[Any]] | None = None,
    threads: int | None = None,
) -> Batch:
    """
    Render many views of one scene into arrays that hold all of them.

    Each view has the bits that `rasterjit.render` gives of it alone. Made for thousands of small
    pictures: what views have in common is decided and prepared once, and views are shared among
    threads. They are drawn in machine code from view to view, with 1 to 16 samples a pixel, any
    lights, alpha masks, transparency (at one sample), fog, environments, tone curves, ambient
    occlusion, outlines and vignettes; only shadow maps are fitted by Python to what each view sees.
    Views with edges, a picture behind, exact areas or averaged pictures (``samples``), a bound on
    layers (``transparency_layers``) or colours mixed as codes (``blending``) are drawn one by one,
    as `render` draws them, in about its time. Memory beyond the result does not grow with the
    number of views. What is prepared is kept with a scene or a mesh, and used again by the next
    call as far as it and arguments are the same. Ctrl-C ends it when the views are done that
    threads are just drawing. There is no lens, max_error, diagnose or motion: `rasterjit.render`
    has them.

    Parameters
    ----------
    what : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene
    cameras : iterable of Camera
        One for each view. A camera may be there more than once.
    size : (int, int)
        Width and height of every view, pixels, each in 1..16384.
    outputs : sequence of str
        As `rasterjit.render` takes them, but for motion and motion_visible.
    quality, background
        As `rasterjit.render` takes them, the same for all views.
    cull : {"none", "back", "front"}, optional
        Faces that are dropped. Default: none.
    transforms : (N, O, 4, 4) array_like, optional
        Where the objects stand in each view: ``world_from_model``, affine, in the order of
        ``scene.nodes``. Default: where they stand in the scene, in all views. Objects with a skin
        are posed first, and then moved from where their joints put them: the identity leaves them.
        Near and far planes of `rasterjit.fit_camera` fit the scene as it stands, and may cut
        objects that are moved.
    out : dict of arrays, optional
        Where outputs are written, by their names: ``out["depth"]`` is an (N, H, W) float32 array,
        C-contiguous and writable. Outputs that are not in it get new arrays.
    threads : int, optional
        Default: all processors. The views have the same bits for any number.

    Returns
    -------
    Batch

    Raises
    ------
    ValueError
        Naming the argument that is wrong, before anything is drawn; if a near plane that was given
        is too near for the depth format in one of the views, when that is drawn; if there is no
        memory for an output of all views.

    Warns
    -----
    ViewWarning
        Once of each kind, naming the first of the views that were drawn: nothing is in view, a
        given plane cuts faces away, or light burns out more than half of the lit surfaces.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.load("models/teapot.obj")
    >>> angles = range(0, 360, 30)
    >>> eyes = [rj.fit_camera(scene, rj.orbit_direction(a, 20.0), steady=True) for a in angles]
    >>> batch = rj.render_batch(scene, eyes, size=(64, 64), outputs=("color", "depth"))
    >>> batch.color.shape, batch.depth.shape
    ((12, 64, 64, 4), (12, 64, 64))
    """
    started = time.perf_counter()
    # Check all arguments.
    cull = "none" if cull is None else cull
    scene, options = check_arguments(what, size, quality, outputs, background, cull)
    eyes = [*check_cameras(cameras)]
    is_lone = len(eyes) == 1
    if not is_lone:
        check_projections(eyes, options.size)
    places = check_transforms(transforms, len(eyes), scene)
    # A lone view has the arrays of its frame.
    arrays = {}
    if out is not None or not is_lone:
        arrays = check_out(out, find_output_shapes(scene, len(eyes), options), places)
    places = compose_with_posed(places, scene)
    thread_count("threads", threads)
    # Draw.
    views = BatchViews(scene, eyes, places, options, arrays)
    if is_lone:
        try:
            stats, warnings = _draw_only_view(what, views, threads)
        except ValueError:
            check_projections(eyes, options.size)
            raise
    else:
        totals, warnings = _draw_groups(what, views, threads)
        stats = make_stats(totals, {"all stages": time.perf_counter() - started})
    if warnings:
        view_warnings.warn(warnings.named(), set())
    return Batch(arrays, stats)


def make_stats(counts: NDArray[np.int64], seconds: dict[str, float]) -> FrameStats:
    """Return statistics of some views, given the counts of ``COUNTED``, (9,)."""
    *face_counts, covered = counts.tolist()
    return FrameStats(
        **dict(zip(COUNTED, face_counts, strict=False)), seconds=seconds, face_id=covered
    )


def check_projections(cameras: Sequence[Camera], size: tuple[int, int]) -> None:
    """Raise ``ValueError`` naming the camera whose projection is wrong."""
    for number, camera in enumerate(cameras):
        with planning.naming(f"cameras[{number}]"):
            compute_projection(camera, size)


def check_transforms(transforms: Any, count: int, scene: Scene) -> NDArray[np.float64] | None:
    """Return ``world_from_model`` of the objects in each view, or raise ``ValueError``."""
    if transforms is None:
        return None
    shape = count, len(scene.nodes), 4, 4
    if isinstance(transforms, np.ndarray) and transforms.dtype.kind == "O":
        # Matrices of Python's numbers.
        transforms = transforms.tolist()
    matrices_of_views = number_array("transforms", transforms)
    if matrices_of_views.shape != shape:
        raise ValueError(
            f"transforms must have shape {shape}: cameras, objects of the scene, 4, 4; got "
            f"{matrices_of_views.shape}"
        )
    for number, matrices in enumerate(matrices_of_views):
        if not np.isfinite(matrices).all():
            raise ValueError(f"transforms must be finite, got NaN or infinity in view {number}")
        if (np.abs(matrices[:, 3] - (0.0, 0.0, 0.0, 1.0)) > LAST_ROW_ROUNDING).any():
            raise ValueError(
                "transforms must be affine, with the last rows 0, 0, 0, 1, got others in view "
                f"{number} (matrices multiply column vectors)"
            )
    return matrices_of_views


def compose_with_posed(
    places: NDArray[np.float64] | None, scene: Scene
) -> NDArray[np.float64] | None:
    """Return transforms that also undo the poses stored in meshes; see `survey.deformation`."""
    if places is None:
        return None
    for number, node in enumerate(scene.nodes):
        if node.mesh._is_in_world and not np.array_equal(node.world_from_model, np.eye(4)):
            stored = np.broadcast_to(node.world_from_model, (len(places), 4, 4))
            places = places.copy()
            places[:, number] = product_of_each(places[:, number], stored)
    return places


def find_output_shapes(
    scene: Scene, count: int, options: FrameRequest
) -> dict[str, tuple[tuple[int, ...], str]]:
    """Return the shape and the dtype of each output of all views."""
    attributes: dict[str, Any] = {
        name: find_attribute(scene.nodes, name.removeprefix(ATTRIBUTE))
        for name in options.outputs
        if is_attribute(name)
    }
    shapes = {name: find_array_spec(name, options.size, attributes) for name in options.outputs}
    return {name: ((count, *shape), dtype) for name, (shape, dtype) in shapes.items()}


def check_out(
    out: Any, shapes: Mapping[str, tuple[tuple[int, ...], str]], places: NDArray[Any] | None
) -> Arrays:
    """Return an array for each output, the caller's or a new one, or raise ``ValueError``."""
    given = {} if out is None else out
    if not isinstance(given, Mapping):
        raise ValueError(f"out must be a dict of arrays, got {brief(out)}")
    for name, array in given.items():
        if name not in shapes:
            raise ValueError(
                f"out has {brief(name)}, which outputs does not have: add it to outputs, which "
                f"has {', '.join(shapes)}"
            )
        (shape, dtype), what = shapes[name], f"out[{name!r}] must be a"
        if not isinstance(array, np.ndarray):
            raise ValueError(f"{what}n array, got {brief(array)}")
        if array.shape != shape or array.dtype != np.dtype(dtype) or not array.dtype.isnative:
            raise ValueError(f"{what} {shape} {dtype} array, got {array.shape} {array.dtype}")
        is_aligned = array.flags.aligned and array.ctypes.data % PIXEL_BYTES == 0
        if not (array.flags.c_contiguous and is_aligned and array.flags.writeable):
            raise ValueError(
                f"{what} C-contiguous and writable array at an address that is a multiple of "
                f"{PIXEL_BYTES}, got one that is not"
            )
    named = [(f"out[{name!r}]", array) for name, array in given.items()]
    named += [] if places is None else [("transforms", places)]
    for (name_a, a), (name_b, b) in itertools.combinations(named, 2):
        if np.may_share_memory(a, b):
            raise ValueError(f"{name_a} must not share memory with {name_b}")
    return {
        name: np.asarray(given[name]) if name in given else _new_array(name, shape, dtype)
        for name, (shape, dtype) in shapes.items()
    }


def _new_array(name: str, shape: tuple[int, ...], dtype: str) -> NDArray[Any]:
    """Return an array for an output, or raise ``ValueError`` where there is no memory for it."""
    try:
        return np.empty(shape, dtype)
    except (MemoryError, ValueError):
        size = math.prod(shape) * np.dtype(dtype).itemsize
        raise ValueError(
            f"cameras and size must give outputs that fit into memory, got {shape[0]} views of "
            f"{shape[2]} x {shape[1]}: {name} alone takes {size} bytes; render fewer at a time"
        ) from None


class BatchViews(NamedTuple):
    """The views of a batch, and the arrays of their outputs."""

    scene: Scene
    cameras: Sequence[Camera]
    places: NDArray[np.float64] | None
    """(N, O, 4, 4): ``world_from_model`` in each view; ``None`` -> as in the scene."""
    options: FrameRequest
    arrays: Arrays
    """(N, H, W, ...) of each output."""

    def scene_of(self, number: int) -> Scene:
        """Return the scene as it is in a view."""
        return self.scene if self.places is None else scene_at(self.scene, self.places[number])


def scene_at(scene: Scene, places: NDArray[np.float64]) -> Scene:
    """
    Return a copy of a scene with other transforms of its objects, (O, 4, 4).

    Labels stay where they are.
    """
    labelled = [
        Node(world_from_model=node.world_matrix, label=node.label, section=node._is_cut)
        for node in scene.labelled
    ]
    changed = with_labels(scene, labelled)
    changed.nodes = [
        Node(node.mesh, name=node.name, world_from_model=matrix, section=node._is_cut)
        for node, matrix in zip(scene.nodes, places, strict=True)
    ]
    return changed


class BatchTotals(NamedTuple):
    """Statistics and warnings of some views."""

    totals: NDArray[np.int64]
    """(9,): the sums of ``COUNTED``."""
    warnings: WarningsOfViews

    def add(self, other: BatchTotals) -> None:
        """Add the statistics and warnings of other views."""
        self.totals[:] += other.totals
        self.warnings.join(other.warnings)


def _draw_only_view(
    what: Any, views: BatchViews, threads: int | None
) -> tuple[FrameStats, WarningsOfViews]:
    """Draw a lone view; if small, by a renderer that is cached for the next call."""
    batch_cache = BATCH_CACHES.acquire(what)
    size, quality = views.options.size, views.options.quality
    is_small = is_small_view(size, views.scene)
    renderer = batch_cache.renderer if batch_cache is not None and is_small else None
    if renderer is None or (renderer.size, renderer.quality) != (size, quality):
        renderer = Renderer(size, quality=quality, threads=1 if is_small else threads)
        renderer._scene_cache = None if batch_cache is None else batch_cache.cache
    try:
        frame = _draw_view(renderer, views, 0)
    finally:
        if not is_small:
            renderer.close()
    cache: Any = renderer._scene_cache
    batch_cache = renew_batch_cache(batch_cache, cache)
    if is_small:
        batch_cache.renderer = renderer
    # After an error, the cache is not put back.
    BATCH_CACHES.release(what, batch_cache)
    warnings = WarningsOfViews()
    warnings.add(0, view_warnings.warnings_of_frame(frame))
    return frame.stats, warnings


def _draw_view(renderer: Renderer, views: BatchViews, number: int) -> Frame:
    """Draw a view by a renderer, and copy it into the batch's arrays, if there are any."""
    frame = renderer._plan_and_draw(views.options, views.scene_of(number), views.cameras[number])
    for name, array in frame._outputs.items():
        if name in views.arrays:
            views.arrays[name][number] = array
        else:
            views.arrays[name] = array[np.newaxis]
    return frame


def _draw_groups(what: Any, views: BatchViews, threads: int | None) -> BatchTotals:
    """Draw all views, in groups shared among threads."""
    total = BatchTotals(np.zeros(len(COUNTED), np.int64), WarningsOfViews())
    scene, cameras, _, options, arrays = views
    if not cameras:
        return total
    batch_cache, has_environment = BATCH_CACHES.acquire(what), scene.environment is not None
    last_cache = None if batch_cache is None else batch_cache.cache
    cache = update_cache(scene.nodes, last_cache, options.quality, has_environment)
    batch_cache = renew_batch_cache(batch_cache, cache)
    # Plan the first view, which finds errors that all of them share.
    first = planning.plan_frame(
        options, views.scene_of(0), cameras[0], cache, batch_cache.first
    ).plan
    batch_cache.first = first
    # Split the views into groups, and draw these.
    workers, threads_each = share_threads(threads, None)
    by_work = MAX_WORK_PER_BATCH_GROUP // estimate_work(options.size, scene)
    size = max(1, min(views_per_group(len(cameras), workers), by_work))
    groups = [range(n, min(n + size, len(cameras))) for n in range(0, len(cameras), size)]
    make_drawer: Callable[[], GroupDrawer] = partial(SingleViewDrawer, views, cache)
    if batch_scheduler.may_batch(options) and can_batch(first, scene, cache):
        scheduler = BatchScheduler(scene, batch_cache, options, arrays, views.scene_of)
        make_drawer = partial(GroupedViewDrawer, views, cache, scheduler)
    with compile_in_background(partial(planning.list_compile_tasks, first), workers * threads_each):
        for totals in draw_in_threads(make_drawer, groups, workers):
            total.add(totals)
    # After an error, the cache is not put back.
    BATCH_CACHES.release(what, batch_cache)
    return total


def views_per_group(count: int, workers: int) -> int:
    """Return the most views of a group, if ``count`` views are shared among workers."""
    per_worker = -(-count // workers)
    groups = 1 if workers == 1 else MIN_GROUPS_PER_THREAD
    large = min(MAX_VIEWS_PER_LARGE_GROUP, -(-per_worker // groups))
    return max(min(MAX_VIEWS_PER_GROUP, per_worker), large)


def estimate_work(size: tuple[int, int], scene: Scene) -> int:
    """Return the faces and pixels, about, of a view of a size in pixels."""
    faces = sum(len(node.mesh.faces) for node in scene.nodes)
    return math.prod(size) + faces + OBJECT_WORK * len(scene.nodes)


def is_small_view(size: tuple[int, int], scene: Scene) -> bool:
    """Tell whether a view is so small that groups, caches and shared tasks pay."""
    return estimate_work(size, scene) <= MAX_WORK


class GroupDrawer(Protocol):
    """Draws groups of views in one thread."""

    def __call__(self, group: range) -> BatchTotals:
        """Draw a group of views, given their numbers."""

    def close(self) -> None:
        """Release its resources."""


def draw_in_threads(
    make_drawer: Callable[[], GroupDrawer], groups: Sequence[range], workers: int
) -> Iterable[BatchTotals]:
    """
    Draw groups of views in several threads; yield the result of each.

    Parameters
    ----------
    make_drawer : callable
        Makes the drawer of a thread.
    groups : sequence of range
    workers : int
        Threads; 1: that of the caller.
    """
    if workers == 1 or len(groups) == 1:
        with closing(make_drawer()) as drawer:
            yield from map(drawer, groups)
        return
    waiting, is_over = iter(groups), threading.Event()

    def draw() -> list[BatchTotals]:
        try:
            results = []
            with closing(make_drawer()) as drawer:
                while not is_over.is_set() and (group := next(waiting, None)) is not None:
                    results.append(drawer(group))
            return results
        except BaseException:
            # An error in one thread stops all.
            is_over.set()
            raise

    with ThreadPoolExecutor(workers, thread_name_prefix="rasterjit-batch") as pool:
        tasks = [pool.submit(draw) for _ in range(min(workers, len(groups)))]
        try:
            for task in tasks:
                yield from task.result()
        finally:
            # If the caller stops early, threads end after their current group.
            is_over.set()


class SingleViewDrawer:
    """
    Draws views one by one, as `rasterjit.render` does.

    Parameters
    ----------
    views : AllViews
    cache : SceneCache
        Of the scene.
    """

    def __init__(self, views: BatchViews, cache: SceneCache) -> None:
        self._views, options = views, views.options
        self._renderer = Renderer.timed(options.size, options.quality, 1, cache)

    def __call__(self, group: Iterable[int]) -> BatchTotals:
        """Draw a group of views, given their numbers."""
        result = BatchTotals(np.zeros(len(COUNTED), np.int64), WarningsOfViews())
        for number in group:
            with planning.naming(f"cameras[{number}]"):
                frame = _draw_view(self._renderer, self._views, number)
            result.totals[:] += _GET_COUNTS(frame.stats)
            result.warnings.add(number, view_warnings.warnings_of_frame(frame))
        return result

    def close(self) -> None:
        """Stop the renderer's threads."""
        self._renderer.close()


class GroupedViewDrawer:
    """
    Draws groups of views by recorded calls, and ineligible views one by one.

    Parameters
    ----------
    views : AllViews
    cache : SceneCache
        Of the scene.
    scheduler : BatchScheduler
    """

    def __init__(self, views: BatchViews, cache: SceneCache, scheduler: BatchScheduler) -> None:
        self._views = views
        self._group_renderer = batch_scheduler.GroupRenderer(scheduler)
        self._single_drawer = SingleViewDrawer(views, cache)

    def __call__(self, group: range) -> BatchTotals:
        """Draw a group of views, given their numbers."""
        views, part = self._views, slice(group.start, group.stop)
        places = None if views.places is None else views.places[part]
        counts, is_drawn, warnings = self._group_renderer.draw(group, views.cameras[part], places)
        ineligible = [group[n] for n in np.flatnonzero(~is_drawn).tolist()]
        totals, single_warnings = self._single_drawer(ineligible)
        warnings.join(single_warnings)
        return BatchTotals(totals + counts[is_drawn].sum(axis=0), warnings)

    def close(self) -> None:
        """Release the command buffers, and stop the threads."""
        self._group_renderer.close()
        self._single_drawer.close()


def check_arguments(
    what: Any,
    size: tuple[int, int],
    quality: Quality | None,
    outputs: Outputs,
    background: Any,
    cull: planning.Cull,
) -> tuple[Scene, FrameRequest]:
    """Return the posed scene and the arguments of all frames, or raise ``ValueError``."""
    scene = pose_input(what)
    size = image_size("size", size)
    if background is not None:
        background = read_background(background)
    if isinstance(background, BackgroundImage):
        background.check_size(size)
    request = planning.check_request(size, quality, outputs, background, cull)
    for name in request.outputs:
        if name in output_table.MOTION_OUTPUTS:
            raise ValueError(
                f"outputs has {name!r}, which needs an earlier view: see rasterjit.render"
            )
    return scene, request


def check_cameras(cameras: Any) -> Iterable[Camera]:
    """
    Return the cameras, or raise ``ValueError`` if the argument is no iterable of cameras.

    Cameras of a sequence are checked at once, others when they are taken.
    """
    if isinstance(cameras, (list, tuple)) and KNOWN_CAMERAS.issuperset(map(type, cameras)):
        return cameras
    if not isinstance(cameras, Iterable) or isinstance(cameras, (str, bytes, dict)):
        raise ValueError(
            f"cameras must be an iterable of cameras, got {type(cameras).__name__}: "
            "put a single one into a list"
        )
    checked = itertools.starmap(check_camera_at, enumerate(cameras))
    return [*checked] if isinstance(cameras, Sequence) else checked


def check_prefetch(prefetch: Any) -> int | None:
    """Return the number of frames to prefetch, or raise ``ValueError``."""
    if prefetch is None:
        return None
    try:
        count = 0 if isinstance(prefetch, bool) else operator.index(prefetch)
    except TypeError:
        count = 0
    if count < 1:
        raise ValueError(f"prefetch must be a whole number of at least 1, got {prefetch!r}")
    return count


def share_threads(threads: Any, workers: Any) -> tuple[int, int]:
    """Return the number of renderers, and of threads of each, or raise ``ValueError``."""
    limit, count = thread_count("threads", threads), thread_count("workers", workers)
    if limit is not None and count is not None and count > limit:
        raise ValueError(
            "workers must be at most threads, for each has one of its own; got "
            f"workers={count} and threads={limit}"
        )
    total = limit or max(available_processors(), count or 1)
    count = count or total
    return count, total // count


def share_clip_planes_of_frames(
    scene: Scene, cameras: Iterable[Camera], options: FrameRequest
) -> Iterable[Camera]:
    """
    Yield the cameras of all frames, with common near and far planes where they leave them open.

    Cameras of an iterator get their planes one by one, when each frame is planned.
    """
    if isinstance(cameras, Sequence):
        cameras = planning.share_clip_planes(scene, cameras, options.size, options.quality)
    yield from cameras


class Pace:
    """
    How many frames a pool begins before they are taken.

    Parameters
    ----------
    at_once : int
        Frames begun together, as one task.
    ahead : int
        Most frames begun and not yet taken; at least ``at_once``.
    """

    def __init__(self, at_once: int, ahead: int) -> None:
        self.at_once, self.ahead = at_once, ahead


class Pool(Protocol):
    """Draws frames, several at once, within a ``with`` block."""

    @property
    def pace(self) -> Pace:
        """May change with each frame that is taken."""

    def __enter__(self) -> Any:
        """Start the workers."""

    def __exit__(self, *error: Any) -> None:
        """Stop the workers."""

    def submit(self, cameras: list[Camera], first: int) -> Any:
        """Begin the frames of some cameras, numbered from ``first``, as one task; return it."""

    def take(self, task: Any) -> Any:
        """Wait for the next frame of a task, and return it, or what was made of it."""


def yield_frames(pool: Pool, cameras: Iterable[Camera]) -> Frames:
    """Yield the frames of a pool, or what it made of them; close it after the last."""
    with pool:
        yield from yield_in_order(cameras, pool)


def yield_in_order(cameras: Iterable[Camera], pool: Pool) -> Iterator[Any]:
    """
    Yield frames in the order of the cameras, at the pool's pace.

    An invalid camera, or an error of the iterable, is raised after the frames before it.
    """
    source, pace = CameraSource(cameras), pool.pace
    # Each task, and how many of its frames are still to be taken.
    tasks: deque[list[Any]] = deque()
    ahead = taken = 0
    while True:
        while not source.is_over and ahead + pace.at_once <= pace.ahead:
            batch = source.next(pace.at_once)
            if batch:
                tasks.append([pool.submit(batch, taken + ahead), len(batch)])
                ahead += len(batch)
        if not tasks:
            break
        # An error of the first frame may concern all of them: it names no camera.
        with planning.naming(f"cameras[{taken}]") if taken else nullcontext():
            frame = pool.take(tasks[0][0])
        tasks[0][1] -= 1
        if tasks[0][1] == 0:
            tasks.popleft()
        ahead, taken = ahead - 1, taken + 1
        yield frame
        # Hold no reference to the caller's frame while waiting for the next one.
        del frame
    if source.failure is not None:
        raise source.failure


class CameraSource:
    """
    Takes cameras from an iterable as they are needed.

    Parameters
    ----------
    cameras : iterable of Camera
    """

    def __init__(self, cameras: Iterable[Camera]) -> None:
        self._cameras = enumerate(cameras)
        self.is_over = False
        self.failure: Exception | None = None
        """The error that ended the iterable, if any."""

    def next(self, count: int) -> list[Camera]:
        """Return the next ``count`` cameras, or fewer at the end."""
        cameras: list[Camera] = []
        try:
            while len(cameras) < count:
                cameras.append(check_camera_at(*next(self._cameras)))
        except StopIteration:
            self.is_over = True
        except Exception as error:
            self.failure, self.is_over = error, True
        return cameras


def check_camera_at(number: int, camera: Any) -> Camera:
    """Return a camera, or raise ``ValueError`` naming its index."""
    if isinstance(camera, (tuple, list)):
        raise ValueError(
            f"cameras[{number}] must be a camera, got a {type(camera).__name__} of {len(camera)}: "
            "all frames have one size, which the argument size gives"
        )
    return check_camera(f"cameras[{number}]", camera)


def show_progress_bar(frames: Frames, cameras: Iterable[Camera], progress: str) -> Iterator[Any]:
    """Yield frames, with a progress bar if requested."""
    if progress == "none":
        return frames
    return _with_progress_bar(frames, operator.length_hint(cameras, 0) or None)


def _with_progress_bar(frames: Frames, total: int | None) -> Iterator[Any]:
    """Yield frames, with a progress bar on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = "Rendering", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with closing(frames), Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=total)
        for frame in frames:
            bar.advance(task)
            yield frame
