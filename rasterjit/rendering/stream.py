"""
Draw a stream of frames in order, several at once, a few ahead of the caller.

With as many frames as threads, one thread draws each frame: none waits for the slowest part of a
stage, or for a stage that only one thread runs. ``benchmarks/many.py`` measures the gain.
"""

from __future__ import annotations

import operator
import os
import queue
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

from rasterjit.io.meshes import as_scene
from rasterjit.outputs import table
from rasterjit.outputs.frame import Frame
from rasterjit.rendering import notices, plan
from rasterjit.rendering.renderer import Renderer
from rasterjit.rendering.views import settle_together
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.background import BackgroundImage, read_background
from rasterjit.scene.camera import Camera, check_camera
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import image_size, one_of, thread_count
from rasterjit.survey import contents
from rasterjit.survey.cache import prepare

AHEAD = 2
"""Frames begun for each worker before any is taken: one in work, one waiting."""

Progress: TypeAlias = Literal["none", "bar"]
PROGRESS: tuple[Progress, ...] = get_args(Progress)


class Options(NamedTuple):
    """What all frames have in common."""

    size: tuple[int, int]
    quality: Quality
    outputs: tuple[str, ...]
    background: Any
    cull: str


def check_arguments(
    what: Any,
    size: tuple[int, int],
    quality: Quality | None,
    outputs: Sequence[str],
    background: Any,
    cull: str,
) -> tuple[Scene, Options]:
    """Return the scene and what all frames have in common, or raise ``ValueError``."""
    scene = as_scene(what)
    contents.check_scene(scene)
    size = image_size("size", size)
    if background is not None:
        background = read_background(background)
    if isinstance(background, BackgroundImage):
        background.check_size(size)
    one_of("cull", cull, plan.CULL_MODES)
    names = table.check_outputs(outputs)
    for name in names:
        if name in table.MOTION_OUTPUTS:
            raise ValueError(
                f"outputs has {name!r}, which needs an earlier view: see rasterjit.render"
            )
    return scene, Options(size, check_quality(quality), names, background, cull)


def check_cameras(cameras: Any) -> None:
    """Raise ``ValueError`` if nothing can be taken from it, or if a sequence has a wrong item."""
    if not isinstance(cameras, Iterable) or isinstance(cameras, (str, bytes, dict)):
        raise ValueError(
            f"cameras must be an iterable of cameras, got {type(cameras).__name__}: "
            "put a single one into a list"
        )
    if isinstance(cameras, Sequence):
        for number, camera in enumerate(cameras):
            check_item(number, camera)


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


class RendererPool:
    """
    Renderers of one scene, each drawing one frame at a time.

    Parameters
    ----------
    scene : Scene
    options : Options
    workers : int
        How many renderers there are.
    threads : int
        Of each renderer.
    """

    def __init__(self, scene: Scene, options: Options, workers: int, threads: int) -> None:
        self._scene, self._options = scene, options
        self._workers, self._threads = workers, threads
        self._process = os.getpid()
        self._idle: queue.SimpleQueue[Renderer] = queue.SimpleQueue()
        self._renderers: list[Renderer] = []
        self._pool: ThreadPoolExecutor | None = None
        self._told: set[str] = set()

    def __enter__(self) -> RendererPool:
        self._process = os.getpid()
        self._pool = ThreadPoolExecutor(self._workers, thread_name_prefix="rasterjit-many")
        # They share what follows from the scene alone.
        has_environment = self._scene.environment is not None
        cache = prepare(self._scene.nodes, None, self._options.quality, has_environment)
        for _ in range(self._workers):
            # The pool tells once, for all of them.
            renderer = Renderer.of_many(
                self._options.size, self._options.quality, self._threads, cache
            )
            self._renderers.append(renderer)
            self._idle.put(renderer)
        return self

    def __exit__(self, *error: Any) -> None:
        # A forked process has none of the threads, and must not wait for them.
        if self._process != os.getpid():
            return
        self._pool.shutdown(wait=True, cancel_futures=True)
        for renderer in self._renderers:
            renderer.close()

    def submit(self, camera: Camera) -> Future[Frame]:
        """Begin a frame."""
        return self._pool.submit(self._draw, camera)

    def take(self, frame: Future[Frame]) -> Frame:
        """Return a frame when it is done."""
        if self._process != os.getpid():
            raise RuntimeError(
                "frames cannot be taken from an iterator that was begun before the process was "
                "forked: its threads are in the parent; call render_many again here"
            )
        drawn = frame.result()
        notices.warn(notices.notices_of(drawn.plan, drawn.stats), self._told)
        return drawn

    def _draw(self, camera: Camera) -> Frame:
        """Draw one frame."""
        _, _, outputs, background, cull = self._options
        renderer = self._idle.get()
        try:
            return renderer.render(
                self._scene, camera, outputs=outputs, background=background, cull=cull
            )
        finally:
            self._idle.put(renderer)


def settle_all(scene: Scene, cameras: Iterable[Camera], options: Options) -> Iterable[Camera]:
    """
    Yield the cameras of all frames, with planes that they leave open in one place for all.

    Cameras that come as they are asked for have theirs one by one, when each frame is planned.
    """
    if isinstance(cameras, Sequence):
        cameras = settle_together(scene, cameras, options.size, options.quality)
    yield from cameras


def draw_all(pool: Any, cameras: Iterable[Camera], prefetch: int) -> Iterator[Frame]:
    """Yield the frames of a pool with the methods of `RendererPool`; close it after the last."""
    with pool:
        yield from in_order(cameras, pool.submit, pool.take, prefetch)


def in_order(
    cameras: Iterable[Camera],
    submit: Callable[[Camera], Any],
    take: Callable[[Any], Frame],
    prefetch: int,
) -> Iterator[Frame]:
    """
    Yield frames in the order of the cameras, with at most ``prefetch`` begun ahead.

    An invalid camera, or an error of the iterable, is raised after the frames before it.

    Parameters
    ----------
    cameras : iterable of Camera
    submit : callable
        Begins a frame.
    take : callable
        Returns the frame that was begun, when it is done.
    prefetch : int
    """
    source = enumerate(cameras)
    begun: deque[Any] = deque()
    failure: Exception | None = None
    is_over = False
    while True:
        while not is_over and len(begun) < prefetch:
            try:
                number, camera = next(source)
                begun.append(submit(check_item(number, camera)))
            except StopIteration:
                is_over = True
            except Exception as error:
                failure, is_over = error, True
        if not begun:
            break
        frame = take(begun.popleft())
        yield frame
        # The frame is the caller's alone: no reference stays while the next one is waited for.
        del frame
    if failure is not None:
        raise failure


def check_item(number: int, camera: Any) -> Camera:
    """Return one of the cameras, or raise ``ValueError`` naming its place."""
    if isinstance(camera, (tuple, list)):
        raise ValueError(
            f"cameras[{number}] must be a camera, got a {type(camera).__name__} of {len(camera)}: "
            "all frames have one size, which the argument size gives"
        )
    return check_camera(f"cameras[{number}]", camera)


def with_bar(frames: Iterator[Frame], cameras: Iterable[Camera], progress: str) -> Iterator[Frame]:
    """Yield frames, with a bar that counts them where one is asked for."""
    if progress == "none":
        return frames
    return _counted(frames, operator.length_hint(cameras, 0) or None)


def _counted(frames: Iterator[Frame], total: int | None) -> Iterator[Frame]:
    """Yield frames and count them on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = "Rendering", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with closing(frames), Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=total)
        for frame in frames:
            bar.advance(task)
            yield frame
