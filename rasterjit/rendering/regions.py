"""
Render regions of a picture, with the bits that the whole picture has there.

Vertices are snapped, and faces clipped, as in the whole; then they are moved by whole pixels, which
changes no integer relative to a pixel. Shadow maps are fitted to the whole picture, whose depth is
surveyed first, region by region. For effects that read a bounded neighbourhood, a larger region is
drawn and cropped.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from rasterjit.outputs.frame import Frame, crop_frame
from rasterjit.outputs.output_table import Outputs
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.visibility.visibility_pass import Region
from rasterjit.rendering import frame_shading, supersample
from rasterjit.rendering.planning import Cull, check_request, plan_frame
from rasterjit.rendering.renderer import draw_frame, find_visible
from rasterjit.runtime.threads import Workers
from rasterjit.scene.background import Background
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.validation import MAX_SIZE, thread_count, tiled_size
from rasterjit.survey.deformation import pose_input
from rasterjit.survey.effect import FrameContext, OpaquePassEffect, context_of, list_screen_effects
from rasterjit.survey.packed_scene import make_placement
from rasterjit.survey.plan import RenderPlan

OPAQUE_PASS_TILE = 1024
"""Side of the regions in which the opaque pass of transmission is drawn, pixels."""

Survey = tuple[dict[str, Any], ...]
"""What each effect reads of a region: at the centres of pixels, then at each other sample."""


class RegionRenderer:
    """
    Renders parts of one picture, which may be larger than the largest frame.

    The scene must not change while parts are drawn.

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
        Naming the argument that is wrong, or the effect that looks beyond the edges of a region
        (`ScreenEffect`).
    """

    def __init__(
        self,
        what: Any,
        camera: Any = None,
        *,
        size: tuple[int, int] = (1280, 720),
        quality: Quality | None = None,
        outputs: Outputs = ("color",),
        background: Background = None,
        cull: Cull = "none",
        threads: int | None = None,
    ) -> None:
        quality = check_quality(quality)
        whole = tiled_size("size", size, quality.subpixel_bits)
        self._workers = Workers(thread_count("threads", threads))
        self.size = whole
        scene = pose_input(what)
        request = check_request(whole, quality, outputs, background, cull)
        self._planned = plan_frame(request, scene, camera)
        self._margin = _find_margin(self._planned.plan)

    def __enter__(self) -> RegionRenderer:
        return self

    def __exit__(self, *error: Any) -> None:
        self.close()

    def close(self) -> None:
        """Stop the threads; a later render starts them again."""
        self._workers.close()

    @property
    def plan(self) -> RenderPlan:
        """The plan of the whole picture."""
        return self._planned.plan

    @property
    def needs_surveys(self) -> bool:
        """Whether the whole picture must be surveyed first, for effects that read all of it."""
        return self.plan.facts.is_colored and bool(self.plan.effects_to_analyse)

    def survey(self, region: Region) -> Survey:
        """
        Collect what effects that read the whole picture need of a region.

        Parameters
        ----------
        region : Region

        Returns
        -------
        tuple of dict
            For `take_surveys`.
        """
        plan, cache, views = self._planned[:3]
        region = check_region(region, plan.size)
        part = plan.for_picture(region=region)
        plans = [part]
        for step in self._surveyed_steps():
            plans += [supersample.offset_plan(part, offset) for offset in step]
        found = []
        with self._workers.frame():
            for one in plans:
                known_views = views if one is part else None
                seen = find_visible(one, cache, self._workers, _no_clock, known_views)
                found.append(supersample.see_for_whole(context_of(one, cache, seen, self._workers)))
        return tuple(found)

    def take_surveys(self, surveys: Mapping[Region, Survey]) -> None:
        """
        Prepare effects that read the whole picture, given the surveys of all its regions.

        Parameters
        ----------
        surveys : mapping of Region to what `survey` returns
        """
        plan, cache, views = self._planned[:3]
        corners = [(region[0], region[1]) for region in surveys]
        center, *samples = [
            {
                effect.name: effect.merge_parts(
                    plan.size,
                    [(at, seen[effect.name]) for at, seen in zip(corners, sights, strict=True)],
                )
                for effect, _ in plan.effects_to_analyse
            }
            for sights in zip(*surveys.values(), strict=True)
        ]
        placement = frame_shading.adjust_placement(plan, make_placement(cache.shapes.arrays, views))
        context = FrameContext(plan, cache, placement, self._workers)
        rest, records = iter(samples), []
        for step in self._surveyed_steps() or [[]]:
            sights = [center, *(next(rest) for _ in step)]
            records.append(supersample.prepare_from_sights(context, step, sights))
        self._planned = self._planned._replace(plan=plan.for_picture(drawn=tuple(records)))

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
            Of the region's size: the pixels of the whole picture, bit for bit. Where an effect
            looks at neighbours, ``stats`` counts the faces of a larger part.

        Raises
        ------
        ValueError
            If the region is not such a part of the picture, or is too large for the neighbours that
            an effect looks at.
        RuntimeError
            If an effect looks at the whole picture, and it has not been surveyed.
        """
        plan = self._planned.plan
        region = check_region(region, plan.size)
        if self.needs_surveys:
            names = " and ".join(one.name for one, _ in self.plan.effects_to_analyse)
            raise RuntimeError(f"all regions must be surveyed first, for {names}: see take_surveys")
        self._draw_opaque_pass()
        return self._draw(self._planned.plan, region)

    def _draw(self, plan: RenderPlan, region: Region) -> Frame:
        """Draw a region with a margin, and crop it."""
        expanded = check_expanded(_expand(region, self._margin, plan.size), region)
        part = plan.for_picture(region=expanded)
        frame = draw_frame(self._planned._replace(plan=part), self._workers)[0]
        return frame if expanded == region else _crop(frame, expanded, region)

    def _draw_opaque_pass(self) -> None:
        """Draw the whole opaque pass that transmission reads, if any, once."""
        plan, cache, views = self._planned[:3]
        found = frame_shading.find_transmission(plan)
        if found is None:
            return
        transmission, data = found
        (records,) = plan.drawn or ({},)
        if transmission.name in records:
            return
        other = frame_shading.plan_opaque_pass(plan, transmission)
        linear = np.empty((plan.size[1], plan.size[0], 4), np.float32)
        for region in regions_of(plan.size, OPAQUE_PASS_TILE):
            left, top, width, height = region
            linear[top : top + height, left : left + width] = self._draw(other, region).linear
        placement = make_placement(cache.shapes.arrays, views)
        context = FrameContext(plan, cache, placement, self._workers)
        record = transmission.prepare(context, data, [(plan.camera, linear)])
        drawn = ({**records, transmission.name: record},)
        self._planned = self._planned._replace(plan=plan.for_picture(drawn=drawn))

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

    def _surveyed_steps(self) -> list[list[supersample.Offset]]:
        """Return the offsets of pictures to survey, by steps; none for a frame of one picture."""
        if self.plan.pictures == 1:
            return []
        steps = supersample.list_step_offsets(self.plan)
        return steps if supersample.needs_all_pictures(self.plan) else [[] for _ in steps]


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
        side = _as_whole_number(tile)
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
        left, top, width, height = map(_as_whole_number, region)
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


def _as_whole_number(value: Any) -> int:
    """Return an integer of Python or NumPy as ``int``, or raise ``TypeError``."""
    if isinstance(value, bool):
        raise TypeError
    return operator.index(value)


def check_expanded(expanded: Region, region: Region) -> Region:
    """Return a region with its margin, or raise ``ValueError`` if that is too large."""
    if max(expanded.width, expanded.height) > MAX_SIZE:
        raise ValueError(
            f"region must be {MAX_SIZE - 2 * TILE_SIZE} pixels wide and high at most where an "
            f"effect looks at the pixels around it, got {tuple(region)!r}"
        )
    return expanded


def _expand(region: Region, margin: int, size: tuple[int, int]) -> Region:
    """Add a margin of pixels to a region, within the picture."""
    left, top = max(region.left - margin, 0), max(region.top - margin, 0)
    right = min(region.left + region.width + margin, size[0])
    bottom = min(region.top + region.height + margin, size[1])
    return Region(left, top, right - left, bottom - top)


def _crop(frame: Frame, expanded: Region, region: Region) -> Frame:
    """Return the part of a frame that shows a region."""
    left, top = region.left - expanded.left, region.top - expanded.top
    part = np.s_[top : top + region.height, left : left + region.width]
    return crop_frame(frame, part, frame.plan.for_picture(region=region))


def _find_margin(plan: RenderPlan) -> int:
    """
    Return the margin that is drawn around a region, pixels: a multiple of 64.

    Raises
    ------
    ValueError
        If an effect looks at any pixels beyond the edges of a region.
    """
    max_radius = 0
    for effect, data in list_screen_effects(plan.planned):
        if effect.scope != "neighbours":
            continue
        radius = effect.read_radius(data)
        max_radius = max(max_radius, radius or 0)
        if (
            isinstance(effect, OpaquePassEffect)
            and plan.pictures == 1
            and not plan.effects_to_analyse
        ):
            # Its opaque pass is drawn whole.
            if max(plan.size) > MAX_SIZE:
                raise ValueError(
                    f"{effect.refusal()} where a picture is larger than {MAX_SIZE} pixels "
                    f"a side, got size {plan.size}"
                )
            continue
        if radius is None:
            raise ValueError(
                f"{effect.refusal()} where a picture is drawn in regions: "
                "it looks at neighbouring pixels, which other regions hold"
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
    return -(-max_radius // TILE_SIZE) * TILE_SIZE


def _no_clock(stage: str) -> None:
    """Do nothing, in place of a `StageClock`."""
