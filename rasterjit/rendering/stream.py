"""
Draw a stream of frames in order, several at once, a few ahead of the caller.

With as many frames as threads, one thread draws each frame: none waits for the slowest part of a
stage, or for a stage that only one thread runs. ``benchmarks/many.py`` measures the gain.
"""

from __future__ import annotations

import operator
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, nullcontext
from typing import Any, Literal, Protocol, TypeAlias, get_args

from rasterjit.io.meshes import as_scene
from rasterjit.outputs import table
from rasterjit.outputs.frame import Frame
from rasterjit.rendering import plan
from rasterjit.rendering.plan import FrameRequest
from rasterjit.rendering.views import naming, settle_together
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.background import BackgroundImage, read_background
from rasterjit.scene.camera import Camera, check_camera
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import image_size, one_of, thread_count
from rasterjit.survey import contents
from rasterjit.survey.posing import posed_scene

AHEAD = 2
"""Frames begun for each worker before any is taken: one in work, one waiting."""

Progress: TypeAlias = Literal["none", "bar"]
PROGRESS: tuple[Progress, ...] = get_args(Progress)


def check_arguments(
    what: Any,
    size: tuple[int, int],
    quality: Quality | None,
    outputs: Sequence[str],
    background: Any,
    cull: str,
) -> tuple[Scene, FrameRequest]:
    """Return the scene and what all frames have in common, or raise ``ValueError``."""
    scene = posed_scene(as_scene(what))
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
    return scene, FrameRequest(size, check_quality(quality), names, background, cull)


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


def settle_all(scene: Scene, cameras: Iterable[Camera], options: FrameRequest) -> Iterable[Camera]:
    """
    Yield the cameras of all frames, with planes that they leave open in one place for all.

    Cameras that come as they are asked for have theirs one by one, when each frame is planned.
    """
    if isinstance(cameras, Sequence):
        cameras = settle_together(scene, cameras, options.size, options.quality)
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

    pace: Pace
    """It may change with each frame that is taken."""

    def __enter__(self) -> Any:
        """Begin."""

    def __exit__(self, *error: Any) -> None:
        """End."""

    def submit(self, cameras: list[Camera]) -> Any:
        """Begin the frames of some cameras."""

    def take(self, begun: Any) -> Frame:
        """Return the next of frames that were begun in one go, when it is done."""


def draw_all(pool: Pool, cameras: Iterable[Camera]) -> Iterator[Frame]:
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
