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
    renewed,
)
from rasterjit.rendering.planning import (
    Cull,
    FrameRequest,
    check_request,
    naming,
    plan_views,
    settle_cameras,
)
from rasterjit.rendering.renderer import Renderer
from rasterjit.rendering.view_warnings import WarningsOfViews
from rasterjit.runtime.background_compile import beside
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
Frames = Generator[Frame, None, None]

VIEWS_PER_GROUP = 32
"""Most views of a group, if there are few."""

VIEWS_PER_LARGE_GROUP = 128
"""Most if there are many: the fixed cost of a group is that of 4 views of 64 x 64."""

GROUPS_PER_THREAD = 4
"""Fewest large groups per thread, for load balance."""

WORK_PER_GROUP = 1 << 21
"""Faces and pixels, about, after which a group of a stream ends."""

WORK_PER_LARGE_GROUP = 1 << 22
"""The same of a batch: far less than a second's work."""

MAX_WORK = 1 << 17
"""Faces and pixels of a view, about, beyond which groups and caches no longer pay."""

PIXEL_BYTES = 4
"""Required alignment of arrays: a pixel is written as one word."""

MATRIX_WORK = 64
"""Cost of an object, in faces: its matrices are found for all views of a group at once."""


_COUNTS = operator.attrgetter(*COUNTED)

AHEAD = 2
"""Prefetch distance: frames begun for each worker before any is taken, one in work, one waiting."""

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
    lights without shadows, alpha masks, transparency (at one sample), fog, environments, tone
    curves, ambient occlusion, outlines and vignettes. Views with shadows, whose maps are fitted to
    what each view sees, and with edges, a picture behind, exact areas or averaged pictures
    (``samples``), a bound on layers (``transparency_layers``) or colours mixed as codes
    (``blending``) are drawn one by one, as `render` draws them, in about its time. Memory beyond
    the result does not grow with the number of views. What is prepared is kept with a scene or a
    mesh, and used again by the next call as far as it and arguments are the same. Ctrl-C ends it
    when the views are done that threads are just drawing. There is no lens, max_error, diagnose or
    motion: `rasterjit.render` has them.

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
        Naming the argument that is wrong, before any kernel runs; if a near plane that was given
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
    since = time.perf_counter()
    # Check everything.
    cull = "none" if cull is None else cull
    scene, options = check_arguments(what, size, quality, outputs, background, cull)
    eyes = [*check_cameras(cameras)]
    is_lone = len(eyes) == 1
    if not is_lone:
        check_projections(eyes, options.size)
    places = check_transforms(transforms, len(eyes), scene)
    # A lone view brings its own arrays.
    arrays = {}
    if out is not None or not is_lone:
        arrays = check_out(out, shapes_of(scene, len(eyes), options), places)
    places = from_posed(places, scene)
    thread_count("threads", threads)
    views = AllViews(scene, eyes, places, options, arrays)
    if is_lone:
        try:
            stats, told = _draw_one(what, views, threads)
        except ValueError:
            check_projections(eyes, options.size)
            raise
    else:
        totals, told = _draw_all(what, views, threads)
        *counts, covered = totals.tolist()
        named = dict(zip(COUNTED, counts, strict=False))
        seconds = {"all stages": time.perf_counter() - since}
        stats = FrameStats(**named, seconds=seconds, face_id=covered)
    if told:
        view_warnings.warn(told.named(), set())
    return Batch(arrays, stats)


def check_projections(cameras: Sequence[Camera], size: tuple[int, int]) -> None:
    """Raise ``ValueError`` naming the camera whose projection is wrong."""
    for number, camera in enumerate(cameras):
        with naming(f"cameras[{number}]"):
            compute_projection(camera, size)


def check_transforms(transforms: Any, count: int, scene: Scene) -> NDArray[np.float64] | None:
    """Return where the objects stand in each view, or raise ``ValueError``."""
    if transforms is None:
        return None
    shape = count, len(scene.nodes), 4, 4
    if isinstance(transforms, np.ndarray) and transforms.dtype.kind == "O":
        # Matrices of Python's numbers.
        transforms = transforms.tolist()
    found = number_array("transforms", transforms)
    if found.shape != shape:
        raise ValueError(
            f"transforms must have shape {shape}: cameras, objects of the scene, 4, 4; got "
            f"{found.shape}"
        )
    for number, matrices in enumerate(found):
        if not np.isfinite(matrices).all():
            raise ValueError(f"transforms must be finite, got NaN or infinity in view {number}")
        if (np.abs(matrices[:, 3] - (0.0, 0.0, 0.0, 1.0)) > LAST_ROW_ROUNDING).any():
            raise ValueError(
                "transforms must be affine, with the last rows 0, 0, 0, 1, got others in view "
                f"{number} (matrices multiply column vectors)"
            )
    return found


def from_posed(places: NDArray[np.float64] | None, scene: Scene) -> NDArray[np.float64] | None:
    """Return transforms of objects from where posed meshes are stored; see `survey.deformation`."""
    if places is None:
        return None
    for number, node in enumerate(scene.nodes):
        if node.mesh._is_in_world and not np.array_equal(node.world_from_model, np.eye(4)):
            stored = np.broadcast_to(node.world_from_model, (len(places), 4, 4))
            places = places.copy()
            places[:, number] = product_of_each(places[:, number], stored)
    return places


def shapes_of(
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
    """Return the array of each output, those of the caller and new ones, or raise."""
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
    held = [(f"out[{name!r}]", array) for name, array in given.items()]
    others = held if places is None else [*held, ("transforms", places)]
    for (one, array), (other, beside_it) in itertools.combinations(others, 2):
        if np.may_share_memory(array, beside_it):
            raise ValueError(f"{one} must not share memory with {other}")
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


class AllViews(NamedTuple):
    """The views of a batch, and the arrays of their outputs."""

    scene: Scene
    cameras: Sequence[Camera]
    places: NDArray[np.float64] | None
    """(N, O, 4, 4): the objects' transforms in each view; ``None`` -> as in the scene."""
    options: FrameRequest
    arrays: Arrays
    """(N, H, W, ...) of each output."""

    def scene_of(self, number: int) -> Scene:
        """Return the scene as it is in a view."""
        return self.scene if self.places is None else scene_at(self.scene, self.places[number])


def scene_at(scene: Scene, places: NDArray[np.float64]) -> Scene:
    """
    Return a scene whose objects stand elsewhere, (O, 4, 4): ``world_from_model`` of each.

    Labels stand where they do.
    """
    labelled = [
        Node(world_from_model=node.world_matrix, label=node.label) for node in scene.labelled
    ]
    changed = with_labels(scene, labelled)
    changed.nodes = [
        Node(node.mesh, name=node.name, world_from_model=matrix)
        for node, matrix in zip(scene.nodes, places, strict=True)
    ]
    return changed


class ViewsDrawn(NamedTuple):
    """Statistics and warnings of some views."""

    totals: NDArray[np.int64]
    """(9,): the sums of ``COUNTED``."""
    told: WarningsOfViews
    """The warnings."""

    def add(self, others: ViewsDrawn) -> None:
        """Count others, too."""
        self.totals[:] += others.totals
        self.told.join(others.told)


def _draw_one(
    what: Any, views: AllViews, threads: int | None
) -> tuple[FrameStats, WarningsOfViews]:
    """Draw a lone view: a small one by a renderer that is kept for the next call."""
    kept, size, quality = BATCH_CACHES.take(what), views.options.size, views.options.quality
    is_small = work_of(size, views.scene) <= MAX_WORK
    renderer = kept.renderer if kept is not None and is_small else None
    if renderer is None or (renderer.size, renderer.quality) != (size, quality):
        renderer = Renderer(size, quality=quality, threads=1 if is_small else threads)
        renderer._cache = None if kept is None else kept.cache
    try:
        frame = _draw_alone(renderer, views, 0)
    finally:
        if not is_small:
            renderer.close()
    cache: Any = renderer._cache
    kept = renewed(kept, cache)
    if is_small:
        kept.renderer = renderer
    # After an error, nothing is kept.
    BATCH_CACHES.put(what, kept)
    told = WarningsOfViews()
    told.add(0, view_warnings.warnings_of_frame(frame))
    return frame.stats, told


def _draw_alone(renderer: Renderer, views: AllViews, number: int) -> Frame:
    """Draw a view as `rasterjit.render` does, into the arrays that there are, or its own."""
    frame = renderer._render(views.options, views.scene_of(number), views.cameras[number])
    for name, array in frame._outputs.items():
        if name in views.arrays:
            views.arrays[name][number] = array
        else:
            views.arrays[name] = array[np.newaxis]
    return frame


def _draw_all(what: Any, views: AllViews, threads: int | None) -> ViewsDrawn:
    """Draw all views, in groups that threads share."""
    total = ViewsDrawn(np.zeros(len(COUNTED), np.int64), WarningsOfViews())
    scene, cameras, _, options, arrays = views
    if not cameras:
        return total
    kept, has_environment = BATCH_CACHES.take(what), scene.environment is not None
    known = None if kept is None else kept.cache
    cache = update_cache(scene.nodes, known, options.quality, has_environment)
    kept = renewed(kept, cache)
    # Plan the first, which finds what is wrong with all of them.
    first = plan_views(options, views.scene_of(0), cameras[0], cache, kept.first).plan
    kept.first = first
    workers, own = share_threads(threads, None)
    by_work = WORK_PER_LARGE_GROUP // work_of(options.size, scene)
    most = max(1, min(views_per_group(len(cameras), workers), by_work))
    groups = [range(n, min(n + most, len(cameras))) for n in range(0, len(cameras), most)]
    make: Callable[[], Draws] = partial(SingleViews, views, cache)
    if batch_scheduler.is_possible(options) and can_batch(first, scene, cache):
        shared = BatchScheduler(scene, kept, options, arrays, views.scene_of)
        make = partial(GroupedViews, views, cache, shared)
    with beside(partial(planning.list_tasks, first), workers * own):
        for drawn in in_threads(make, groups, workers):
            total.add(drawn)
    # After an error, nothing is kept.
    BATCH_CACHES.put(what, kept)
    return total


def views_per_group(count: int, workers: int) -> int:
    """Return the most views of a group, of so many that threads share."""
    each = -(-count // workers)
    parts = 1 if workers == 1 else GROUPS_PER_THREAD
    return max(min(VIEWS_PER_GROUP, each), min(VIEWS_PER_LARGE_GROUP, -(-each // parts)))


def work_of(size: tuple[int, int], scene: Scene) -> int:
    """Return the faces and pixels of a view of a size in pixels, about; see ``WORK_PER_GROUP``."""
    faces = sum(len(node.mesh.faces) for node in scene.nodes)
    return math.prod(size) + faces + MATRIX_WORK * len(scene.nodes)


class Draws(Protocol):
    """Draws groups of views, one after the other, in one thread."""

    def __call__(self, group: range) -> ViewsDrawn:
        """Draw some views."""

    def close(self) -> None:
        """Release its resources."""


def in_threads(
    make: Callable[[], Draws], groups: Sequence[range], workers: int
) -> Iterable[ViewsDrawn]:
    """
    Draw groups of views in several threads; yield the result of each.

    Parameters
    ----------
    make : callable
        Makes what draws groups, one after the other: one for each thread.
    groups : sequence of range
    workers : int
        How many threads there are; with 1, it is the one that calls.
    """
    if workers == 1 or len(groups) == 1:
        with closing(make()) as drawer:
            yield from map(drawer, groups)
        return
    waiting, is_over = iter(groups), threading.Event()

    def draw() -> list[ViewsDrawn]:
        try:
            done = []
            with closing(make()) as drawer:
                while not is_over.is_set():
                    # One thread at a time takes the next.
                    group = next(waiting, None)
                    if group is None:
                        break
                    done.append(drawer(group))
            return done
        except BaseException:
            # What stops one stops all.
            is_over.set()
            raise

    with ThreadPoolExecutor(workers, thread_name_prefix="rasterjit-batch") as pool:
        tasks = [pool.submit(draw) for _ in range(min(workers, len(groups)))]
        try:
            for task in tasks:
                yield from task.result()
        finally:
            # If the caller ends early, threads end after the group that they draw.
            is_over.set()


class SingleViews:
    """
    Draws views one by one, each as `rasterjit.render` does.

    Parameters
    ----------
    views : AllViews
    cache : SceneCache
        Of the scene.
    """

    def __init__(self, views: AllViews, cache: SceneCache) -> None:
        self._views, options = views, views.options
        self._renderer = Renderer.timed(options.size, options.quality, 1, cache)

    def __call__(self, group: Iterable[int]) -> ViewsDrawn:
        """Draw some views."""
        drawn = ViewsDrawn(np.zeros(len(COUNTED), np.int64), WarningsOfViews())
        for number in group:
            with naming(f"cameras[{number}]"):
                frame = _draw_alone(self._renderer, self._views, number)
            drawn.totals[:] += _COUNTS(frame.stats)
            drawn.told.add(number, view_warnings.warnings_of_frame(frame))
        return drawn

    def close(self) -> None:
        """Let its threads go."""
        self._renderer.close()


class GroupedViews:
    """
    Draws groups of views by recorded calls, and ineligible views one by one.

    Parameters
    ----------
    views : AllViews
    cache : SceneCache
        Of the scene.
    shared : BatchScheduler
    """

    def __init__(self, views: AllViews, cache: SceneCache, shared: BatchScheduler) -> None:
        self._views = views
        self._drawer, self._alone = batch_scheduler.GroupRenderer(shared), SingleViews(views, cache)

    def __call__(self, group: range) -> ViewsDrawn:
        """Draw some views."""
        views, some = self._views, slice(group.start, group.stop)
        places = None if views.places is None else views.places[some]
        counts, is_drawn, told = self._drawer.draw(group, views.cameras[some], places)
        totals, others = self._alone([group[n] for n in np.flatnonzero(~is_drawn).tolist()])
        told.join(others)
        return ViewsDrawn(totals + counts[is_drawn].sum(axis=0), told)

    def close(self) -> None:
        """Give back what it drew in."""
        self._drawer.close()
        self._alone.close()


def check_arguments(
    what: Any,
    size: tuple[int, int],
    quality: Quality | None,
    outputs: Outputs,
    background: Any,
    cull: planning.Cull,
) -> tuple[Scene, FrameRequest]:
    """Return the scene and what all frames have in common, or raise ``ValueError``."""
    scene = pose_input(what)
    size = image_size("size", size)
    if background is not None:
        background = read_background(background)
    if isinstance(background, BackgroundImage):
        background.check_size(size)
    request = check_request(size, quality, outputs, background, cull)
    for name in request.outputs:
        if name in output_table.MOTION_OUTPUTS:
            raise ValueError(
                f"outputs has {name!r}, which needs an earlier view: see rasterjit.render"
            )
    return scene, request


def check_cameras(cameras: Any) -> Iterable[Camera]:
    """
    Return the cameras, or raise ``ValueError`` if it is not what they can be taken from.

    Those of a sequence are checked at once, others when they are taken.
    """
    if isinstance(cameras, (list, tuple)) and KNOWN_CAMERAS.issuperset(map(type, cameras)):
        return cameras
    if not isinstance(cameras, Iterable) or isinstance(cameras, (str, bytes, dict)):
        raise ValueError(
            f"cameras must be an iterable of cameras, got {type(cameras).__name__}: "
            "put a single one into a list"
        )
    checked = itertools.starmap(check_item, enumerate(cameras))
    return [*checked] if isinstance(cameras, Sequence) else checked


def check_prefetch(prefetch: Any) -> int | None:
    """Return the number of frames ahead, or raise ``ValueError``."""
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
    """Return how many renderers there are, and threads of each, or raise ``ValueError``."""
    asked, count = thread_count("threads", threads), thread_count("workers", workers)
    if asked is not None and count is not None and count > asked:
        raise ValueError(
            "workers must be at most threads, for each has one of its own; got "
            f"workers={count} and threads={asked}"
        )
    total = asked or max(available_processors(), count or 1)
    count = count or total
    return count, total // count


def settle_all(scene: Scene, cameras: Iterable[Camera], options: FrameRequest) -> Iterable[Camera]:
    """
    Yield the cameras of all frames, with common near and far planes where they leave them open.

    Cameras of an iterator get theirs one by one, when each frame is planned.
    """
    if isinstance(cameras, Sequence):
        cameras = settle_cameras(scene, cameras, options.size, options.quality)
    yield from cameras


class Pace:
    """
    How many views are begun.

    Parameters
    ----------
    at_once : int
        In one go.
    ahead : int
        Ahead of the one taken last, at most; at least ``at_once``.
    """

    def __init__(self, at_once: int, ahead: int) -> None:
        self.at_once, self.ahead = at_once, ahead


class Pool(Protocol):
    """Draws frames, several at once; to be entered before, and left after the last."""

    @property
    def pace(self) -> Pace:
        """It may change with each frame that is taken."""

    def __enter__(self) -> Any:
        """Begin."""

    def __exit__(self, *error: Any) -> None:
        """End."""

    def submit(self, cameras: list[Camera]) -> Any:
        """Begin the frames of some cameras."""

    def take(self, begun: Any) -> Frame:
        """Return the next of frames that were begun in one go, when it is done."""


def draw_all(pool: Pool, cameras: Iterable[Camera]) -> Frames:
    """Yield the frames of a pool; close it after the last."""
    with pool:
        yield from in_order(cameras, pool)


def in_order(cameras: Iterable[Camera], pool: Pool) -> Iterator[Frame]:
    """
    Yield frames in the order of the cameras, at the pool's pace.

    An invalid camera, or an error of the iterable, is raised after the frames before it.
    """
    source, pace = Source(cameras), pool.pace
    # What was begun in one go, and how many frames of it are still to be taken.
    begun: deque[list[Any]] = deque()
    ahead = taken = 0
    while True:
        while not source.is_over and ahead + pace.at_once <= pace.ahead:
            some = source.next(pace.at_once)
            if some:
                begun.append([pool.submit(some), len(some)])
                ahead += len(some)
        if not begun:
            break
        # What is wrong with the first may be wrong with all.
        with naming(f"cameras[{taken}]") if taken else nullcontext():
            frame = pool.take(begun[0][0])
        begun[0][1] -= 1
        if begun[0][1] == 0:
            begun.popleft()
        ahead, taken = ahead - 1, taken + 1
        yield frame
        # The frame is the caller's alone: no reference stays while the next one is waited for.
        del frame
    if source.failure is not None:
        raise source.failure


class Source:
    """
    Cameras that are asked for as they are needed.

    Parameters
    ----------
    cameras : iterable of Camera
    """

    def __init__(self, cameras: Iterable[Camera]) -> None:
        self._cameras = enumerate(cameras)
        self.is_over = False
        self.failure: Exception | None = None
        """What ended it; ``None`` -> nothing, or it came to its end."""

    def next(self, count: int) -> list[Camera]:
        """Return the next cameras, so many unless it ends."""
        found: list[Camera] = []
        try:
            while len(found) < count:
                found.append(check_item(*next(self._cameras)))
        except StopIteration:
            self.is_over = True
        except Exception as error:
            self.failure, self.is_over = error, True
        return found


def check_item(number: int, camera: Any) -> Camera:
    """Return one of the cameras, or raise ``ValueError`` naming its place."""
    if isinstance(camera, (tuple, list)):
        raise ValueError(
            f"cameras[{number}] must be a camera, got a {type(camera).__name__} of {len(camera)}: "
            "all frames have one size, which the argument size gives"
        )
    return check_camera(f"cameras[{number}]", camera)


def with_bar(frames: Frames, cameras: Iterable[Camera], progress: str) -> Iterator[Frame]:
    """Yield frames, with a bar that counts them where one is asked for."""
    if progress == "none":
        return frames
    return _counted(frames, operator.length_hint(cameras, 0) or None)


def _counted(frames: Frames, total: int | None) -> Iterator[Frame]:
    """Yield frames and count them on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = "Rendering", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with closing(frames), Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=total)
        for frame in frames:
            bar.advance(task)
            yield frame
