"""Render many pictures of one scene: here, or on the machines of a cluster."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from rasterjit.frame import Frame
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.streams import (
    AHEAD,
    PROGRESS,
    RendererPool,
    check_arguments,
    check_cameras,
    check_prefetch,
    draw_all,
    share_threads,
    with_bar,
)
from rasterjit.validation import one_of

if TYPE_CHECKING:
    from distributed import Client


def render_many(
    what: Any,
    cameras: Iterable[Camera],
    *,
    size: tuple[int, int] = (1280, 720),
    quality: Quality | None = None,
    outputs: Sequence[str] = ("color",),
    background: Any = None,
    cull: str = "none",
    threads: int | None = None,
    workers: int | None = None,
    prefetch: int | None = None,
    progress: str = "none",
    client: Client | None = None,
) -> Iterator[Frame]:
    """
    Render one frame for each camera, in order, while they are taken.

    Each frame has the bits that `rasterjit.render` gives. Frames are drawn ahead of the one that is
    taken, ``prefetch`` of them and no more, so memory stays bounded however many cameras there
    are; cameras are asked for as they are needed, in the thread that takes the frames. Closing the
    iterator, or leaving the loop by an error or Ctrl-C, ends all threads as soon as the frames that
    are just drawn are done.

    Parameters
    ----------
    what : Scene, Mesh, trimesh.Trimesh or trimesh.Scene
        Must stay as it is while frames are taken.
    cameras : iterable of Camera
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
        each worker.
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
        come as they are asked for, after the frames before it.
    RuntimeError
        If frames are taken in a forked process from an iterator that its parent began.
    """
    if workers is not None and client is not None:
        raise ValueError(f"workers must be None where a client is given, got {workers!r}")
    scene, options = check_arguments(what, size, quality, outputs, background, cull)
    check_cameras(cameras)
    one_of("progress", progress, PROGRESS)
    if client is not None:
        from rasterjit.distributed.many import farm_out

        return farm_out(scene, cameras, options, threads, prefetch, progress, client)
    count, own = share_threads(threads, workers)
    most = check_prefetch(prefetch) or AHEAD * count
    pool = RendererPool(scene, options, count, own)
    return with_bar(draw_all(pool, cameras, most), cameras, progress)
