"""
Draw parts of a picture: each has the bits that the whole picture has there.

Vertices are snapped, and faces cut, as the whole picture does it; then they are moved by whole
pixels. What a pixel shows follows from integers relative to the pixel, so the move changes none.
Shadow maps, which are fitted to all that is seen, are fitted to the whole: its depth is surveyed
part by part first.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from rasterjit import passes, shadow_cells, supersampling
from rasterjit.arguments import choose_camera
from rasterjit.frame import Frame
from rasterjit.kernels.setup import TILE_SIZE
from rasterjit.plan import Region, RenderPlan
from rasterjit.render import Renderer, StageClock, placement_of
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.supersampling import Accumulation
from rasterjit.validation import MAX_SIZE, thread_count, whole_size

Survey = tuple[shadow_cells.SeenDepth, ...]
"""What the depth of a region tells: at the centres of pixels, then at each sample beside them."""


class RegionRenderer(Renderer):
    """
    Renders parts of one picture, which may be larger than one frame can be.

    The scene must stay as it is as long as parts are drawn.

    Parameters
    ----------
    what, camera, outputs, background, cull
        As `rasterjit.render` takes them.
    size : (int, int)
        Width and height of the whole picture, pixels, each in 1..131072, or less with more than 9
        sub-pixel bits.
    quality : Quality, optional
        Default ``Quality.standard()``.
    threads : int, optional
        Default: all processors.

    Raises
    ------
    ValueError
        Naming the argument that is wrong, or the effect that looks beyond the edges of a region:
        ambient occlusion, outlines, and see-through surfaces with 2 to 16 samples.
    """

    def __init__(
        self,
        what: Any,
        camera: Any = None,
        *,
        size: tuple[int, int] = (1280, 720),
        quality: Quality | None = None,
        outputs: Sequence[str] = ("color",),
        background: Any = None,
        cull: str = "none",
        threads: int | None = None,
    ) -> None:
        quality = check_quality(quality)
        whole = whole_size("size", size, quality.subpixel_bits)
        super().__init__((1, 1), quality=quality, threads=thread_count("threads", threads))
        self.size = whole
        scene = self._scene(what)
        camera = choose_camera(scene, camera, whole)
        self._planned = self._plan(quality, scene, camera, outputs, background, cull, False, None)
        _refuse_neighbours(self._planned.plan)

    @property
    def plan(self) -> RenderPlan:
        """What was decided for the whole picture."""
        return self._planned.plan

    @property
    def needs_surveys(self) -> bool:
        """Whether shadow maps wait for all of the picture to be surveyed."""
        plan = self.plan
        return plan.needs_color and plan.casts_shadows and plan.shadow_maps is None

    def survey(self, region: Region) -> Survey:
        """
        Find what the depth of a region tells of where shadows may be seen.

        Parameters
        ----------
        region : Region

        Returns
        -------
        tuple of SeenDepth
            For `take_surveys`.
        """
        plan, prepared, views, _ = self._planned
        region = check_region(region, plan.size)
        part = replace(plan, region=region)
        find = functools.partial(self._find_faces, prepared=prepared, clock=_no_clock)
        self._workers.memory.next_frame()
        middle = find(part, views=views)
        found = [
            passes.see_receivers(plan, middle.coverage, middle.placement, self._workers),
        ]
        found += [
            shadow_cells.see_depth(
                find(supersampling.moved(part, offset)).coverage, self._workers
            )
            for step in self._steps()
            for offset in step
        ]  # fmt: skip
        return tuple(found)

    def take_surveys(self, surveys: Mapping[Region, Survey]) -> None:
        """
        Draw the shadow maps, given the surveys of regions that make up the whole picture.

        Parameters
        ----------
        surveys : mapping of Region to what `survey` returns
        """
        plan, prepared, views, _ = self._planned
        corners = [(region[0], region[1]) for region in surveys]
        middle, *beside = [
            shadow_cells.join_depths(plan.size, list(zip(corners, depths, strict=True)))
            for depths in zip(*surveys.values(), strict=True)
        ]
        placement = passes.placement_to_light(plan, placement_of(prepared.shapes.arrays, views))
        rest = iter(beside)
        maps = []
        for step in self._steps() or [[]]:
            depths = [next(rest) for _ in step]
            cells = supersampling.cells_beside(plan, step, depths)
            maps.append(
                passes.find_shadows(plan, prepared, placement, middle, self._workers, cells)
            )
        self._planned = self._planned._replace(plan=replace(plan, shadow_maps=tuple(maps)))

    def render_region(self, region: Region) -> Frame:
        """
        Render a part of the picture.

        Parameters
        ----------
        region : Region
            Its first column and row must be multiples of 64; it is at most 16384 pixels wide and
            high. Pass what `regions_of` returns.

        Returns
        -------
        Frame
            Of the region's size: the pixels of the whole picture, bit for bit.

        Raises
        ------
        ValueError
            If the region is not such a part of the picture.
        RuntimeError
            If shadows fall on the picture, and it has not been surveyed.
        """
        plan = self._planned.plan
        region = check_region(region, plan.size)
        if self.needs_surveys:
            raise RuntimeError("shadows need all regions to be surveyed first: see take_surveys")
        part = replace(plan, region=region)
        return self._draw(self._planned._replace(plan=part), StageClock(), Accumulation())

    def render_regions(self, tile: int) -> Iterator[tuple[Region, Frame]]:
        """
        Render the whole picture, one square tile after the other, surveyed first where needed.

        Yields
        ------
        (Region, Frame)
        """
        regions = regions_of(self.size, tile)
        if self.needs_surveys:
            self.take_surveys({region: self.survey(region) for region in regions})
        for region in regions:
            yield region, self.render_region(region)

    def _steps(self) -> list[list[supersampling.Offset]]:
        """Return the offsets of each step of pictures; none if the frame is the picture."""
        return supersampling.step_offsets(self.plan) if self.plan.pictures > 1 else []


def regions_of(size: tuple[int, int], tile: int) -> list[Region]:
    """
    Cut a picture into square tiles, row by row; the last ones may be smaller.

    Parameters
    ----------
    size : (int, int)
        Width and height, pixels.
    tile : int
        Side of the tiles, pixels: a multiple of 64 up to 16384.

    Raises
    ------
    ValueError
        If the side is not such a number.
    """
    tile = check_tile(tile)
    width, height = size
    return [
        Region(left, top, min(tile, width - left), min(tile, height - top))
        for top in range(0, height, tile)
        for left in range(0, width, tile)
    ]


def check_tile(tile: Any) -> int:
    """Return the side of tiles, or raise ``ValueError``."""
    try:
        side = _whole(tile)
    except TypeError:
        side = 0
    if not 0 < side <= MAX_SIZE:
        raise ValueError(f"tile must be a multiple of {TILE_SIZE} in 64..{MAX_SIZE}, got {tile!r}")
    if side % TILE_SIZE:
        raise ValueError(f"tile must be a multiple of {TILE_SIZE} pixels, got {tile!r}")
    return side


def check_region(region: Any, size: tuple[int, int]) -> Region:
    """Return a part of a picture, or raise ``ValueError`` saying what is wrong with it."""
    try:
        left, top, width, height = map(_whole, region)
    except (TypeError, ValueError):
        raise ValueError(
            f"region must be (left, top, width, height) in pixels, got {region!r}"
        ) from None
    if left % TILE_SIZE or top % TILE_SIZE:
        raise ValueError(f"region must begin at multiples of {TILE_SIZE} pixels, got {region!r}")
    if not (1 <= width <= MAX_SIZE and 1 <= height <= MAX_SIZE):
        raise ValueError(f"region must be 1..{MAX_SIZE} pixels wide and high, got {region!r}")
    if min(left, top) < 0 or left + width > size[0] or top + height > size[1]:
        raise ValueError(f"region must lie in the picture of {size} pixels, got {region!r}")
    return Region(left, top, width, height)


def _whole(value: Any) -> int:
    """Return a whole number, also one of NumPy, or raise ``TypeError``."""
    if isinstance(value, bool):
        raise TypeError
    return operator.index(value)


def _refuse_neighbours(plan: RenderPlan) -> None:
    """Raise ``ValueError`` if an effect looks at pixels beyond the edges of a region."""
    for name in ("ambient_occlusion", "outline"):
        if getattr(plan, name) is not None:
            raise ValueError(
                f"scene.{name} must be None where a picture is drawn in regions: it looks at "
                "neighbouring pixels, which other regions hold"
            )
    layers = plan.layers
    if layers is not None and layers.has_blended and layers.samples != 1:
        # A row of tiles without anything see-through is mixed face by face, another one sample by
        # sample: the last bit of a pixel depends on what the whole row shows.
        raise ValueError(
            "quality.samples must be 1, 64 or 256 where a picture that shows see-through surfaces "
            f"is drawn in regions, got {plan.quality.samples!r}: the last bit of what 2 to 16 "
            "samples are mixed to depends on other regions"
        )


def _no_clock(stage: str) -> None:
    """Note nothing."""
