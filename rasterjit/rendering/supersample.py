"""
Supersample: draw whole pictures with sub-pixel offsets (jitter), and average them.

The mean is taken in linear light or in codes. Every sample is rasterized and shaded: pictures share
only shadow maps. These are drawn once per step, of which there are at most four: the first 4
pictures, the rest of the first 16, and so on. Each step first runs visibility of all its pictures,
and fits the maps to them.

The samples are the centres of the cells of a grid over the pixel, ordered so that the first 4, 16,
64 ... are spread evenly: one in each quarter, in each quarter of a quarter, and so on. Within its
quarter, a sample lies in the smaller quarter that a turn by 90 degrees leads to: so the first
samples form rotated grids [1]_, centred on the pixel.

Mip levels are chosen by the distance of samples, not pixels, for the final number of samples.

References
----------
.. [1] T. Akenine-Möller, E. Haines, N. Hoffman and others, "Real-Time Rendering", 4th edition,
   2018, section 5.4.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.fragments import coverage_resolve, fragment_bands, srgb_compositing
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.passes import KernelRow, Rows, rows_where
from rasterjit.pipeline.visibility.visibility_pass import RasterizedView
from rasterjit.rendering import frame_shading, resolve_layers
from rasterjit.rendering.lens_views import DerivedCamera, PictureCamera
from rasterjit.rendering.pass_runner import IMMEDIATE
from rasterjit.runtime.progress import PICTURE_COUNTERS
from rasterjit.runtime.threads import Workers, split_into_bands, split_range
from rasterjit.scene.camera import Camera
from rasterjit.scene.reference_shader import decode_codes
from rasterjit.scene.transforms import Matrix
from rasterjit.survey.effect import ActiveEffect, FrameContext, UsedEffect, context_of, is_backdrop
from rasterjit.survey.plan import RenderPlan

Offset = tuple[float, float]
"""From the centre of a pixel to the right and down, pixels."""

QUARTER_ORDER = ((0, 0), (1, 1), (1, 0), (0, 1))
"""Column and row of the quarters of a square, in sampling order."""


class Accumulation:
    """
    The sum of a frame's pictures so far.

    Attributes
    ----------
    count : int
        Pictures in ``sums``.
    sums : (H, W, 4) float64 or None
        The sum of their linear colours, or codes, times alpha, and of alpha; ``None`` before the
        first.
    counted_pictures : int
        Pictures in ``covered_counts``.
    covered_counts : (H, W) int32 or None
        In how many pictures a face covers each pixel; ``None`` before the first.
    """

    def __init__(self) -> None:
        self.count = 0
        self.sums: NDArray[np.float64] | None = None
        self.counted_pictures = 0
        self.covered_counts: NDArray[np.int32] | None = None


@dataclass(frozen=True)
class MovedCamera(DerivedCamera):
    """
    A camera with a sub-pixel offset of the projection (jitter).

    Parameters
    ----------
    camera : Camera
    offset : (float, float)
        To the right and down, pixels.
    spacing : float
        Distance of the samples whose mean a pixel is, pixels, for which textures are filtered. A
        power of two.
    """

    offset: Offset
    spacing: float = 1.0

    def projection_matrix(self, size: tuple[int, int]) -> Matrix:
        """Return ``clip_from_view``, shifted across the screen by the offset."""
        matrix = self.camera.projection_matrix(size).copy()
        (x, y), (width, height) = self.offset, size
        matrix[0] -= (2.0 * x / width) * matrix[3]
        matrix[1] += (2.0 * y / height) * matrix[3]
        return matrix


@dataclass(frozen=True)
class SweptCamera(MovedCamera):
    """
    A camera whose sample position varies over the picture, sweeping over the pixel.

    Parameters
    ----------
    is_transposed : bool
        Whether samples move to the right from row to row, and down from column to column; else to
        the right from column to column, and down from row to row.
    """

    is_transposed: bool = False

    def projection_matrix(self, size: tuple[int, int]) -> Matrix:
        """Return ``clip_from_view``, enlarged or sheared by a pixel from side to side."""
        matrix = super().projection_matrix(size)
        right, down = (1, 0) if self.is_transposed else (0, 1)
        matrix[:2] += matrix[[right, down]] / np.array(size)[:, np.newaxis]
        return matrix


def sample_offsets(samples: int) -> list[Offset]:
    """
    Return the offsets of a pixel's samples, ordered so that the first ones are spread evenly.

    Parameters
    ----------
    samples : int
        A power of 4.

    Examples
    --------
    >>> sample_offsets(4)
    [(-0.25, -0.25), (0.25, 0.25), (0.25, -0.25), (-0.25, 0.25)]
    """
    levels = _count_halvings(samples)
    side, offsets = 1 << levels, []
    for number in range(samples):
        column, row, rotation = 0, 0, (0, 0)
        for level in range(levels):
            # Digits of the number choose the quarters, the first one the largest.
            x, y = QUARTER_ORDER[number >> 2 * level & 3]
            x, y = x ^ rotation[0], y ^ rotation[1]
            column, row, rotation = 2 * column + x, 2 * row + y, (1 - y, x)
        offsets.append(((column + 0.5) / side - 0.5, (row + 0.5) / side - 0.5))
    return offsets


def _count_halvings(samples: int) -> int:
    """Return how often the side of a pixel is halved for a number of samples, a power of 4."""
    return (samples.bit_length() - 1) // 2


def split_into_steps(plan: RenderPlan) -> list[RenderPlan]:
    """Return the plans of a frame after each step: of 4 pictures, of 16 ..., and of all."""
    return [plan.for_picture(pictures=count) for count in _step_counts(plan.pictures)]


def _step_counts(pictures: int) -> list[int]:
    """Return how many pictures there are after each step: 4, 16, 64 ..."""
    counts = [pictures]
    while counts[0] > 4:
        counts.insert(0, counts[0] // 4)
    return counts


def shade_faces(
    context: FrameContext,
    accumulation: Accumulation,
    find: Callable[[RenderPlan], RasterizedView],
    clock: Callable[[str], None],
) -> dict[str, NDArray[Any]]:
    """
    Draw the pictures of the plan that are missing, and average all into the colour outputs.

    Parameters
    ----------
    context : FrameContext
        At the centres of pixels.
    accumulation : Accumulation
        The sum of the pictures drawn so far for this frame; those that are missing are added.
    find : callable
        Returns the visible faces for another plan.
    clock : callable
        Called with a stage's name when it ends.
    """
    plan, workers = context.plan, context.workers
    offsets = sample_offsets(plan.facts.supersamples or 1)
    has_codes = plan.facts.blends_srgb8
    add, finish = (_add_codes, _average_codes) if has_codes else (_add_picture, _average)
    sums = accumulation.sums
    if sums is None:
        sums = workers.memory.empty((*context.seen.coverage.face_id.shape, 4), np.float64)
        sums.fill(0.0)
        accumulation.sums = sums
    # Steps do not depend on the number of pictures: those of one step share shadow maps.
    counts = _step_counts(plan.pictures)
    for count in counts:
        missing = offsets[accumulation.count : count]
        records: dict[str, Any] = {}
        if plan.drawn is not None:
            records = plan.drawn[counts.index(count)]
        elif missing and needs_all_pictures(plan):
            records = _prepare_from_all_pictures(context, missing, find)
            clock("shade, resolve")
        picture = plan_picture(plan, records)
        found = frame_shading.find_transmission(plan)
        if found is not None and missing and needs_all_pictures(plan):
            opaque_context = frame_shading.find_opaque_pass(context, found[0], find)
            picture = picture.for_picture(
                drawn_behind=_prepare_from_all_pictures(opaque_context, missing, find)
            )
        for offset in missing:
            picture_colors = _draw_picture(offset_plan(picture, offset), context, find)
            clock("shade, resolve")
            add(picture_colors, sums, workers)
            # Free its memory for the next picture.
            del picture_colors
            accumulation.count += 1
            clock("average")
            if PICTURE_COUNTERS:
                PICTURE_COUNTERS[-1](accumulation.count, plan.pictures)
    result = finish(context, sums, accumulation.count)
    clock("average")
    return result


def kernels_of(plan: RenderPlan) -> Rows:
    """Return the kernels that average pictures, if there are several."""
    if plan.pictures == 1:
        return []
    # Where pixels show several faces, `resolve_layers` lists the last kernels.
    is_new = plan.layers is None
    if plan.facts.blends_srgb8:
        rows = rows_where("", srgb_compositing.add_codes, srgb_compositing.write_mean_codes)
        if is_new and "linear" in plan.outputs:
            rows.append(KernelRow(srgb_compositing.decode_rows))
        return rows
    rows = rows_where("", coverage_resolve.add_picture, coverage_resolve.write_mean)
    if is_new:
        rows += plan.kernels_at("mixed")
    if is_new and "color" in plan.outputs:
        rows.append(KernelRow(srgb_encoding.encode_rows))
    return rows


def coverage_kernels(plan: RenderPlan) -> Rows:
    """Return the kernels that `measure_coverage` calls within one picture."""
    if "coverage" not in plan.outputs or plan.facts.supersamples is not None:
        return []
    samples = plan.quality.samples
    return [] if samples == 1 else fragment_bands.list_kernels(samples, plan.depth_format.kind)


def measure_coverage(
    context: FrameContext, accumulation: Accumulation, find: Callable[[RenderPlan], RasterizedView]
) -> NDArray[np.float32]:
    """
    Return each pixel's coverage by faces, (H, W): the share of its samples or of its area.

    Takes what `shade_faces` takes; counts the pictures of the plan, if fewer than all samples.
    """
    plan, seen = context.plan, context.seen
    samples = plan.facts.supersamples
    if samples is None:
        finder = fragment_bands.Finder(
            seen.geometry, frame_shading.find_hit_tests(plan, context.cache)
        )
        return _measure_sample_coverage(plan.quality.samples, seen, finder, context.workers)
    if accumulation.covered_counts is None:
        accumulation.covered_counts = np.zeros(seen.coverage.face_id.shape, np.int32)
    count = plan.pictures if plan.pictures > 1 else samples
    picture = plan.for_picture(
        lambda planned: False, outputs=("face_id",), layers=None, lighting=None, pictures=1
    )
    for offset in sample_offsets(samples)[accumulation.counted_pictures : count]:
        accumulation.covered_counts += find(offset_plan(picture, offset)).coverage.face_id >= 0
        accumulation.counted_pictures += 1
    return (accumulation.covered_counts / accumulation.counted_pictures).astype(np.float32)


def _draw_picture(
    plan: RenderPlan, context: FrameContext, find: Callable[[RenderPlan], RasterizedView]
) -> NDArray[Any]:
    """Return the linear colour of one picture, or its codes, (H, W, 4)."""
    picture = context_of(plan, context.cache, find(plan), context.workers)
    picture = frame_shading.with_opaque_pass(picture, find)
    return frame_shading.shade_faces(picture)[plan.outputs[0]]


def sample_spacing_of_camera(camera: Camera) -> float:
    """Return the distance of a camera's samples, pixels."""
    return camera.spacing if isinstance(camera, MovedCamera) else 1.0


def pixels_per_output_pixel(camera: Camera) -> float:
    """Return how many of a camera's pixels a pixel of the finished picture is wide."""
    while isinstance(camera, MovedCamera):
        camera = camera.camera
    return camera.samples_per_pixel if isinstance(camera, PictureCamera) else 1.0


def sample_spacing(samples: int) -> float:
    """Return the distance of the samples of a pixel, given their number, a power of 4: pixels."""
    return 1.0 / (1 << _count_halvings(samples))


def offset_plan(plan: RenderPlan, offset: Offset) -> RenderPlan:
    """Return a plan with a sub-pixel offset of the camera."""
    spacing = sample_spacing(plan.facts.supersamples or 1)
    return plan.for_picture(camera=MovedCamera(plan.camera, offset, spacing))


def _picture_background(plan: RenderPlan) -> NDArray[np.float32]:
    """Return the background colour of each picture, (4,) linear."""
    # With tone mapping, the background is added at the end, as given.
    return np.zeros(4, np.float32) if plan.effects_at("mixed") else plan.background


def plan_picture(plan: RenderPlan, records: dict[str, Any]) -> RenderPlan:
    """Return the plan of one picture: linear light or codes alone, with prepared records."""
    has_codes = plan.facts.blends_srgb8

    def is_of_pictures(planned: UsedEffect) -> bool:
        places = planned.effect.places
        if has_codes or not plan.effects_at("mixed"):
            return "overlay" not in places
        # With tone mapping, backgrounds that are shown as given are added at the end.
        is_late = "mixed" in places or is_backdrop(planned.effect)
        return "overlay" not in places and not is_late

    return plan.for_picture(
        is_of_pictures,
        outputs=("color",) if has_codes else ("linear",),
        background=plan.background if has_codes else _picture_background(plan),
        pictures=1,
        drawn=(records,),
    )


def _prepare_from_all_pictures(
    context: FrameContext, offsets: list[Offset], find: Callable[[RenderPlan], RasterizedView]
) -> dict[str, Any]:
    """Prepare the effects that read whole pictures, from all pictures of a step."""
    sights = [see_for_whole(context)]
    for offset in offsets:
        plan = offset_plan(context.plan, offset)
        sights.append(see_for_whole(context_of(plan, context.cache, find(plan), context.workers)))
    return prepare_from_sights(context, offsets, sights)


def needs_all_pictures(plan: RenderPlan) -> bool:
    """Tell whether an effect reads each picture, not only the finished one."""
    return any("overlay" not in effect.places for effect, _ in plan.effects_to_analyse)


def see_for_whole(context: FrameContext) -> dict[str, Any]:
    """Return what effects that read whole pictures see of one picture, or of a part of it."""
    return {effect.name: effect.analyse(context) for effect, _ in context.plan.effects_to_analyse}


def prepare_from_sights(
    context: FrameContext, offsets: Sequence[Offset], sights: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """
    Prepare the effects that read whole pictures.

    Parameters
    ----------
    context : FrameContext
    offsets : sequence of (float, float)
        Offsets of the other pictures that are shaded with the same records, pixels.
    sights : sequence of dict
        What `see_for_whole` returns for the picture itself, then for those.
    """
    plan = context.plan
    cameras = [plan.camera, *(offset_plan(plan, offset).camera for offset in offsets)]
    return {
        effect.name: effect.prepare(
            context, data,
            [(camera, sight[effect.name]) for camera, sight in zip(cameras, sights, strict=True)],
        )
        for effect, data in plan.effects_to_analyse
    }  # fmt: skip


def list_step_offsets(plan: RenderPlan) -> list[list[Offset]]:
    """Return the offsets of the pictures of each step, which share shadow maps."""
    offsets = sample_offsets(plan.facts.supersamples or 1)
    counts = _step_counts(plan.pictures)
    return [offsets[a:b] for a, b in zip([0, *counts[:-1]], counts, strict=True)]


def _add_picture(linear: NDArray[np.float32], sums: NDArray[np.float64], workers: Workers) -> None:
    """Add the linear colour of a picture to the sums, both (H, W, 4)."""
    bands = [slice(*rows) for rows in split_into_bands(linear.shape, workers)]
    workers.run(coverage_resolve.add_picture, [(linear[band], sums[band]) for band in bands])


def _add_codes(color: NDArray[np.uint8], sums: NDArray[np.float64], workers: Workers) -> None:
    """Add the codes of a picture to the sums, both (H, W, 4)."""
    packed = color.view(np.uint32)[:, :, 0]
    bands = [slice(*rows) for rows in split_into_bands(color.shape, workers)]
    workers.run(srgb_compositing.add_codes, [(packed[band], sums[band]) for band in bands])


def _average_codes(
    context: FrameContext, sums: NDArray[np.float64], count: int
) -> dict[str, NDArray[Any]]:
    """Return the colour outputs: the mean of the codes of all pictures."""
    plan, workers = context.plan, context.workers
    light = decode_codes(plan.facts.encoding).copy()
    shape = sums.shape[:2]
    color = workers.memory.empty((*shape, 4), np.uint8)
    has_linear = "linear" in plan.outputs
    linear = workers.memory.empty((*shape, 4), np.float32) if has_linear else None
    packed = color.view(np.uint32)[:, :, 0]
    behind = np.array(
        [[srgb_encoding.encode_color(plan.background, plan.facts.encoding)]], np.uint32
    )

    def write_band(*rows: int) -> None:
        band = slice(*rows)
        srgb_compositing.write_mean_codes(sums[band], count, behind, packed[band])
        if linear is not None:
            srgb_compositing.decode_rows(packed[band], light, linear[band])

    workers.run(write_band, split_into_bands(sums.shape, workers))
    return _select_outputs(plan, linear, color)


def _average(
    context: FrameContext, sums: NDArray[np.float64], count: int
) -> dict[str, NDArray[Any]]:
    """Return the colour outputs: the linear mean of all pictures."""
    plan, workers = context.plan, context.workers
    behind = _picture_background(plan)
    background_effects = [
        ActiveEffect(planned.effect, planned.effect.prepare(context, planned.data, ()))
        for planned in plan.effects_at("background")
        if is_backdrop(planned.effect)
    ]
    tone_mapping = None
    for planned in plan.effects_at("mixed"):
        tone_mapping = resolve_layers.LateToneMapping(
            ActiveEffect(planned.effect, planned.data), plan.background, background_effects
        )
    height, width, _ = sums.shape
    table = srgb_encoding.make_encoding_table(plan.facts.encoding)
    linear = workers.memory.empty((height, width, 4), np.float32)
    color = workers.memory.empty((height, width, 4), np.uint8) if "color" in plan.outputs else None
    packed = np.empty((height, 0), np.uint32) if color is None else color.view(np.uint32)[:, :, 0]

    def write_band(*rows: int) -> None:
        band = slice(*rows)
        coverage_resolve.write_mean(sums[band], count, behind, linear[band])
        colors = resolve_layers.ColorRows(linear[band], packed[band])
        resolve_layers.tone_map_and_encode(
            IMMEDIATE, tone_mapping, table, colors, rows[0], workers.memory
        )

    workers.run(write_band, split_into_bands(sums.shape, workers))
    return _select_outputs(plan, linear, color)


def _select_outputs(
    plan: RenderPlan, linear: NDArray[np.float32] | None, color: NDArray[np.uint8] | None
) -> dict[str, NDArray[Any]]:
    """Return the requested colour outputs by name."""
    pictures = (("linear", linear), ("color", color))
    return {
        name: picture for name, picture in pictures if picture is not None and name in plan.outputs
    }


def _measure_sample_coverage(
    samples: int | str, seen: RasterizedView, finder: fragment_bands.Finder, workers: Workers
) -> NDArray[np.float32]:
    """
    Return the share of each pixel's samples, or of its area, that faces cover, (H, W).

    Parameters
    ----------
    samples : int or str
        1 to 16, or ``"area"``.
    seen : Seen
        With the lists of its coverage.
    finder : Finder
    workers : Workers
    """
    coverage = seen.coverage
    if samples == 1:
        return (coverage.face_id >= 0).astype(np.float32)
    finder = fragment_bands.make_sampled_finder(finder, samples)
    viewport = finder.geometry.viewport
    nothing = np.zeros(len(seen.objects.face_starts) - 1, np.uint8)
    lists = fragment_bands.split_tile_lists(coverage, viewport, nothing, workers)
    covered = workers.memory.empty((viewport.height, viewport.width), np.float32)

    def cover_tiles(first: int, last: int) -> None:
        rows = first, last
        if samples == "area":
            _, _, rest = fragment_bands.find_areas(rows, lists, finder, workers.memory)
            np.subtract(np.float32(1.0), rest, out=covered[slice(*rows)])
            return
        for band in fragment_bands.find_layers(rows, lists, int(samples), finder, workers.memory):
            counts = np.count_nonzero(band.opaque >= 0, axis=0)
            target = covered[band.first_row : band.first_row + len(counts)]
            # The number of samples is a power of two.
            target[:] = counts / np.float32(samples)

    workers.run(cover_tiles, split_range(viewport.height, TILE_SIZE))
    return covered
