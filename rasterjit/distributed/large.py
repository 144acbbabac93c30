"""Draw pictures that are larger than one frame, and write them tile by tile."""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.distributed.clusters import (
    SentTask,
    SharedScene,
    TaskFarm,
    check_client,
    count_threads,
)
from rasterjit.io.images import checked_path
from rasterjit.io.whole import replacing, replacing_folder
from rasterjit.pipeline.visibility.draw import Region
from rasterjit.rendering import view_warnings
from rasterjit.rendering.planning import Cull
from rasterjit.rendering.regions import RegionRenderer, Survey, regions_of
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.validation import thread_count

if TYPE_CHECKING:
    from distributed import Client

FORMATS = (".tif", ".tiff", ".zarr")

AHEAD = 2
"""Tiles under way for each thread of a cluster."""

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
    Render a picture that is too large for one frame, and write it tile by tile.

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
    place = _checked_place(path)
    regions_of((1, 1), tile)
    write = _writer(place)
    arguments = {
        "camera": camera, "size": size, "quality": quality, "background": background, "cull": cull,
    }  # fmt: skip
    count = thread_count("threads", threads)
    own = None if client is None else check_client(client)
    renderer = RegionRenderer(what, threads=count, **arguments)
    view_warnings.warn(view_warnings.warnings_of(renderer.plan), set())
    with renderer:
        whole = renderer.size
        if own is None:
            tiles = _draw_here(renderer, tile)
        else:
            arguments["camera"] = renderer.plan.camera
            # A picture's file may be out of the workers' reach.
            arguments["background"] = renderer.plan.facts.background_image or background
            tiles = _draw_there(TileFarm(own, what, arguments, count or 1), renderer, tile)
        with closing(tiles):
            write(tiles, whole, tile)


def _draw_here(renderer: RegionRenderer, tile: int) -> Tiles:
    """Yield the tiles, row by row."""
    for region, frame in renderer.render_regions(tile):
        yield region, frame.color
        # Not held while the next one is drawn.
        del frame


class TileFarm:
    """
    The tiles of one picture that a cluster draws.

    Parameters
    ----------
    client : Client
    what : Scene or mesh
    arguments : dict
        Of `RegionRenderer`.
    threads : int
        Of each task.
    """

    def __init__(self, client: Client, what: Any, arguments: dict[str, Any], threads: int) -> None:
        self._client = client
        self._task: tuple[Any, ...] = what, arguments, threads

    def run(
        self, function: Callable[..., Any], regions: Sequence[Region], *more: Any
    ) -> Iterator[tuple[Region, Any]]:
        """Yield what a function gives of each region on a worker, in order, few ahead."""
        ahead = AHEAD * count_threads(self._client)
        farm = TaskFarm(self._client, SharedScene(_region_renderer, *self._task, *more))
        begun: deque[tuple[Region, SentTask]] = deque()
        waiting = iter(regions)
        try:
            while True:
                while len(begun) < ahead and (region := next(waiting, None)) is not None:
                    begun.append((region, farm.begin(SentTask(function, region))))
                if not begun:
                    return
                region, task = begun.popleft()
                yield region, farm.result(task)
                del task
        finally:
            farm.end(task for _, task in begun)


def _draw_there(farm: TileFarm, renderer: RegionRenderer, tile: int) -> Tiles:
    """Yield the tiles that a cluster draws, row by row; survey first where shadows need it."""
    regions = regions_of(renderer.size, tile)
    if not renderer.needs_surveys:
        yield from farm.run(_draw_tile, regions)
        return
    surveys = dict(farm.run(_survey_tile, regions))
    yield from farm.run(_draw_tile, regions, surveys)


def _region_renderer(
    what: Any, arguments: dict[str, Any], threads: int, *surveys: dict[Region, Survey]
) -> RegionRenderer:
    """Return a renderer on a worker."""
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


def _checked_place(path: Any) -> Path:
    """Return the path of the picture, or raise ``ValueError``; a Zarr array may be replaced."""
    if isinstance(path, (str, os.PathLike)) and str(path).lower().endswith(".zarr"):
        place = Path(path)
        if os.path.lexists(place) and not _is_array(place):
            raise ValueError(f"path {str(place)!r} is there, but is no Zarr array to be replaced")
        return checked_path(place.with_name(f"{place.name}.zarr"), FORMATS).with_name(place.name)
    return checked_path(path, FORMATS)


def _is_array(place: Path) -> bool:
    """Tell whether a folder is a Zarr array, not a group of them or anything else."""
    try:
        about = json.loads((place / "zarr.json").read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(about, dict) and about.get("node_type") == "array"


def _writer(place: Path) -> Callable[[Tiles, tuple[int, int], int], None]:
    """Return what writes tiles to a place, with the library that it needs there."""
    try:
        if place.suffix.lower() == ".zarr":
            import zarr

            return lambda tiles, size, tile: _write_zarr(zarr, place, tiles, size, tile)
        import tifffile

        return lambda tiles, size, tile: _write_tiff(tifffile, place, tiles, size, tile)
    except ImportError as error:
        raise ImportError(
            f'writing a {place.suffix} tile by tile needs: pip install "rasterjit[large]"'
        ) from error


def _write_tiff(tifffile: Any, place: Path, tiles: Tiles, size: tuple[int, int], tile: int) -> None:
    """Write tiles to a BigTIFF."""
    width, height = size

    def padded() -> Iterator[NDArray[np.uint8]]:
        for _, color in tiles:
            yield _squared(color, tile)
            # Not held while the next one is drawn.
            del color

    with replacing(place) as temporary, tifffile.TiffWriter(temporary, bigtiff=True) as file:
        file.write(
            padded(), shape=(height, width, 4), dtype=np.uint8, tile=(tile, tile),
            photometric="rgb", extrasamples=["unassalpha"], compression="zlib",
            software="RasterJIT",
            # With more workers it reads tiles ahead, up to 512 MiB of them.
            maxworkers=1,
        )  # fmt: skip


def _squared(color: NDArray[np.uint8], tile: int) -> NDArray[np.uint8]:
    """Return a whole tile, as those of a TIFF are; what lies beyond the picture is not shown."""
    height, width, _ = color.shape
    if height == width == tile:
        return color
    return np.pad(color, ((0, tile - height), (0, tile - width), (0, 0)))


def _write_zarr(zarr: Any, place: Path, tiles: Tiles, size: tuple[int, int], tile: int) -> None:
    """Write tiles to the chunks of a Zarr array."""
    width, height = size
    with replacing_folder(place) as temporary:
        with _naming(place):
            array = zarr.create_array(
                store=str(temporary), shape=(height, width, 4), chunks=(tile, tile, 4),
                dtype="uint8", dimension_names=("row", "column", "channel"),
            )  # fmt: skip
        for region, color in tiles:
            rows = slice(region.top, region.top + region.height)
            with _naming(place):
                array[rows, region.left : region.left + region.width] = color
            del color


@contextmanager
def _naming(place: Path) -> Iterator[None]:
    """Let an error of the system name the picture, not one of the files it is made of."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(place)) from error
