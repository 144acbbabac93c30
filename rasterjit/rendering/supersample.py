"""
Supersample: draw whole pictures with sub-pixel offsets (jitter), and average them.

The mean is taken in linear light or in codes. Every sample is rasterized and shaded: pictures share
only shadow maps. These are drawn once for each step: the first 4 pictures, the rest of the first
16, and so on, four steps at most. Each step first runs visibility of all its pictures, and fits the
maps to them.

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
from numpy.typing import ArrayLike, NDArray

from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.fragments import coverage_resolve, fragment_bands, srgb_compositing
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.passes import KernelRow, Rows, rows_where
from rasterjit.pipeline.visibility.visibility_pass import RasterizedView
from rasterjit.rendering import frame_shading, resolve_layers
from rasterjit.rendering.lens_views import PictureCamera
from rasterjit.rendering.pass_runner import IMMEDIATE
from rasterjit.runtime.progress import PICTURES
from rasterjit.runtime.threads import Workers, rows_per_task
from rasterjit.scene.camera import Camera
from rasterjit.scene.reference_shader import decode_codes
from rasterjit.scene.transforms import Matrix
from rasterjit.survey.effect import ActiveEffect, FrameContext, UsedEffect, context_of, is_backdrop
from rasterjit.survey.plan import RenderPlan

Offset = tuple[float, float]
"""From the centre of a pixel to the right and down, pixels."""

QUARTERS = ((0, 0), (1, 1), (1, 0), (0, 1))
"""Column and row of the quarters of a square, in sampling order."""


class Accumulation:
    """
    The sum of a frame's pictures so far.

    Attributes
    ----------
    count : int
        How many there are.
    sums : (H, W, 4) float64 or None
        The sum of their linear colours, or codes, times alpha, and of alpha; ``None`` before the
        first.
    covering : int
        How many of them have been looked at for what they cover.
    covered : (H, W) int32 or None
        How many of those a face covers; ``None`` before the first.
    """

    def __init__(self) -> None:
        self.count = 0
        self.sums: NDArray[np.float64] | None = None
        self.covering = 0
        self.covered: NDArray[np.int32] | None = None


@dataclass(frozen=True)
class MovedCamera:
    """
    A camera with a sub-pixel offset of the projection (jitter).

    Parameters
    ----------
    camera : Camera
    offset : (float, float)
        How far beside them: to the right and down, pixels.
    spacing : float
        How far apart the samples lie that a pixel is the mean of, pixels: what textures are
        filtered for. A power of two.
    """

    camera: Camera
    offset: Offset
    spacing: float = 1.0

    def view_matrix(self) -> Matrix:
        """Return ``view_from_world`` of the camera."""
        return self.camera.view_matrix()

    def projection_matrix(self, size: tuple[int, int]) -> Matrix:
        """Return ``clip_from_view``, moved across the screen by a multiple of w."""
        matrix = self.camera.projection_matrix(size).copy()
        (x, y), (width, height) = self.offset, size
        matrix[0] -= (2.0 * x / width) * matrix[3]
        matrix[1] += (2.0 * y / height) * matrix[3]
        return matrix

    def eye_position(self) -> NDArray[np.float64]:
        """Return the eye of the camera, world space."""
        return self.camera.eye_position()

    def depth_coefficients(self) -> tuple[float, float, float]:
        """Return those of the camera."""
        return self.camera.depth_coefficients()

    def view_depth(self, stored: ArrayLike) -> NDArray[np.float64]:
        """Return depths as the camera does."""
        return self.camera.view_depth(stored)


@dataclass(frozen=True)
class SweptCamera(MovedCamera):
    """
    A camera whose sample position varies over the picture, sweeping over the pixel.

    Parameters
    ----------
    is_turned : bool
        Whether they move to the right from row to row, and down from column to column; else to the
        right from column to column, and down from row to row.
    """

    is_turned: bool = False

    def projection_matrix(self, size: tuple[int, int]) -> Matrix:
        """Return ``clip_from_view``, enlarged or sheared by a pixel from side to side."""
        matrix = super().projection_matrix(size)
        right, down = (1, 0) if self.is_turned else (0, 1)
        matrix[:2] += matrix[[right, down]] / np.array(size)[:, np.newaxis]
        return matrix


def sample_offsets(samples: int) -> list[Offset]:
    """
    Return where the samples of a pixel lie, the first ones spread as evenly as all of them.

    Parameters
    ----------
    samples : int
        A power of 4.

    Examples
    --------
    >>> sample_offsets(4)
    [(-0.25, -0.25), (0.25, 0.25), (0.25, -0.25), (-0.25, 0.25)]
    """
    levels = _halvings(samples)
    side, offsets = 1 << levels, []
    for number in range(samples):
        column, row, turned = 0, 0, (0, 0)
        for level in range(levels):
            # Digits of the number choose the quarters, the first one the largest.
            x, y = QUARTERS[number >> 2 * level & 3]
            x, y = x ^ turned[0], y ^ turned[1]
            column, row, turned = 2 * column + x, 2 * row + y, (1 - y, x)
        offsets.append(((column + 0.5) / side - 0.5, (row + 0.5) / side - 0.5))
    return offsets


def _halvings(samples: int) -> int:
    """Return how often a side of a pixel is halved for so many samples, a power of 4."""
    return (samples.bit_length() - 1) // 2


def steps(plan: RenderPlan) -> list[RenderPlan]:
    """Return the plans of a frame of 4 pictures, of 16 ..., and of all; of one if that is all."""
    return [plan.for_picture(pictures=count) for count in _counts(plan.pictures)]


def _counts(pictures: int) -> list[int]:
    """Return the counts of pictures whose samples are spread evenly: 4, 16, 64 ..."""
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
    Make the colour outputs from as many pictures as the plan has.

    Parameters
    ----------
    context : FrameContext
        At the centres of pixels.
    accumulation : Accumulation
        Pictures of the same frame that are there already; changed: those that were missing.
    find : callable
        Returns what the picture of another plan shows.
    clock : callable
        Called with a stage's name when it ends.
    """
    plan, workers = context.plan, context.workers
    offsets = sample_offsets(plan.facts.supersamples or 1)
    has_codes = plan.facts.mixes_codes
    add, finish = (_add_codes, _average_codes) if has_codes else (_add_picture, _average)
    sums = accumulation.sums
    if sums is None:
        sums = workers.memory.empty((*context.seen.coverage.face_id.shape, 4), np.float64)
        sums.fill(0.0)
        accumulation.sums = sums
    # In the same steps for any number of pictures: those of one step share shadow maps.
    counts = _counts(plan.pictures)
    for count in counts:
        new = offsets[accumulation.count : count]
        drawn: dict[str, Any] = {}
        if plan.drawn is not None:
            drawn = plan.drawn[counts.index(count)]
        elif new and surveys_pictures(plan):
            drawn = _draw_whole(context, new, find)
            clock("shade, resolve")
        picture = plan_picture(plan, drawn)
        own = frame_shading.glass_of(plan)
        if own is not None and new and surveys_pictures(plan):
            other = frame_shading.draw_behind(context, own[0], find)
            picture = picture.for_picture(drawn_behind=_draw_whole(other, new, find))
        for offset in new:
            shown = _draw_picture(moved(picture, offset), context, find)
            clock("shade, resolve")
            add(shown, sums, workers)
            # So that the next picture takes its memory.
            del shown
            accumulation.count += 1
            clock("average")
            if PICTURES:
                PICTURES[-1](accumulation.count, plan.pictures)
    result = finish(context, sums, accumulation.count)
    clock("average")
    return result


def kernels_of(plan: RenderPlan) -> Rows:
    """Return the kernels that average pictures, if there are several."""
    if plan.pictures == 1:
        return []
    # Where pixels show several faces the last steps are told with theirs.
    is_new = plan.layers is None
    if plan.facts.mixes_codes:
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


def covering_kernels(plan: RenderPlan) -> Rows:
    """Return the kernels that `cover_pixels` calls, but for those of whole pictures."""
    if "coverage" not in plan.outputs or plan.facts.supersamples is not None:
        return []
    samples = plan.quality.samples
    return [] if samples == 1 else fragment_bands.list_kernels(samples, plan.depth_format.kind)


def cover_pixels(
    context: FrameContext, accumulation: Accumulation, find: Callable[[RenderPlan], RasterizedView]
) -> NDArray[np.float32]:
    """
    Return each pixel's coverage by any face, (H, W): of its samples or area.

    Takes what `shade_faces` takes; of a frame of fewer pictures than the quality has samples it is
    the share of these.
    """
    plan, seen = context.plan, context.seen
    samples = plan.facts.supersamples
    if samples is None:
        finder = fragment_bands.Finder(
            seen.geometry, frame_shading.find_hit_tests(plan, context.cache)
        )
        return cover_samples(plan.quality.samples, seen, finder, context.workers)
    if accumulation.covered is None:
        accumulation.covered = np.zeros(seen.coverage.face_id.shape, np.int32)
    count = plan.pictures if plan.pictures > 1 else samples
    picture = plan.for_picture(
        lambda planned: False, outputs=("face_id",), layers=None, lighting=None, pictures=1
    )
    for offset in sample_offsets(samples)[accumulation.covering : count]:
        accumulation.covered += find(moved(picture, offset)).coverage.face_id >= 0
        accumulation.covering += 1
    return (accumulation.covered / accumulation.covering).astype(np.float32)


def _draw_picture(
    plan: RenderPlan, context: FrameContext, find: Callable[[RenderPlan], RasterizedView]
) -> NDArray[Any]:
    """Return the linear colour of one picture, or its codes, (H, W, 4)."""
    picture = context_of(plan, context.cache, find(plan), context.workers)
    picture = frame_shading.look_behind(picture, find)
    return frame_shading.shade_faces(picture)[plan.outputs[0]]


def spacing_of(camera: Camera) -> float:
    """Return how far apart the samples lie that a camera shows, pixels."""
    return camera.spacing if isinstance(camera, MovedCamera) else 1.0


def pixels_of(camera: Camera) -> float:
    """Return how many pixels of what a camera shows a pixel of the finished picture has, across."""
    while isinstance(camera, MovedCamera):
        camera = camera.camera
    return camera.pixels if isinstance(camera, PictureCamera) else 1.0


def sample_spacing(samples: int) -> float:
    """Return how far apart so many samples of a pixel lie, a power of 4: pixels."""
    return 1.0 / (1 << _halvings(samples))


def moved(plan: RenderPlan, offset: Offset) -> RenderPlan:
    """Return the plan of a picture that shows what lies beside the centres of pixels."""
    spacing = sample_spacing(plan.facts.supersamples or 1)
    return plan.for_picture(camera=MovedCamera(plan.camera, offset, spacing))


def _background(plan: RenderPlan) -> NDArray[np.float32]:
    """Return what lies behind the faces of each picture, (4,) linear."""
    # Where tones are mapped the background, which is shown as given, comes behind at the end.
    return np.zeros(4, np.float32) if plan.effects_at("mixed") else plan.background


def plan_picture(plan: RenderPlan, drawn: dict[str, Any]) -> RenderPlan:
    """Return the plan of one picture: its light or codes alone, from what is already drawn."""
    has_codes = plan.facts.mixes_codes

    def is_of_pictures(planned: UsedEffect) -> bool:
        places = planned.effect.places
        if has_codes or not plan.effects_at("mixed"):
            return "overlay" not in places
        # What is shown as given comes behind at the end, where tones are mapped.
        is_late = "mixed" in places or is_backdrop(planned.effect)
        return "overlay" not in places and not is_late

    return plan.for_picture(
        is_of_pictures,
        outputs=("color",) if has_codes else ("linear",),
        background=plan.background if has_codes else _background(plan),
        pictures=1,
        drawn=(drawn,),
    )


def _draw_whole(
    context: FrameContext, offsets: list[Offset], find: Callable[[RenderPlan], RasterizedView]
) -> dict[str, Any]:
    """Prepare the effects that look at whole pictures, with all that some pictures show."""
    sights = [see_whole(context)]
    for offset in offsets:
        plan = moved(context.plan, offset)
        sights.append(see_whole(context_of(plan, context.cache, find(plan), context.workers)))
    return prepare_whole(context, offsets, sights)


def surveys_pictures(plan: RenderPlan) -> bool:
    """Tell whether an effect looks at all pictures, not at the finished one alone."""
    return any("overlay" not in effect.places for effect, _ in plan.effects_to_analyse)


def see_whole(context: FrameContext) -> dict[str, Any]:
    """Return what the effects that look at the whole picture see of one, or a part of it."""
    return {effect.name: effect.analyse(context) for effect, _ in context.plan.effects_to_analyse}


def prepare_whole(
    context: FrameContext, offsets: Sequence[Offset], sights: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """
    Prepare the effects that look at the whole picture.

    Parameters
    ----------
    context : FrameContext
    offsets : sequence of (float, float)
        Where other pictures lie that are shaded with the same records, pixels.
    sights : sequence of dict
        What `see_whole` returns of the picture itself, then of those.
    """
    plan = context.plan
    cameras = [plan.camera, *(moved(plan, offset).camera for offset in offsets)]
    return {
        effect.name: effect.prepare(
            context, data,
            [(camera, sight[effect.name]) for camera, sight in zip(cameras, sights, strict=True)],
        )
        for effect, data in plan.effects_to_analyse
    }  # fmt: skip


def step_offsets(plan: RenderPlan) -> list[list[Offset]]:
    """Return where the pictures of each step lie, whose shadow maps are drawn together."""
    offsets = sample_offsets(plan.facts.supersamples or 1)
    counts = _counts(plan.pictures)
    return [offsets[a:b] for a, b in zip([0, *counts[:-1]], counts, strict=True)]


def _bands(shape: tuple[int, ...], workers: Workers) -> list[tuple[slice]]:
    """Return the bands of rows of a frame, (H, W, ...), that threads share."""
    per_task = rows_per_task(shape, workers)
    return [(slice(first, first + per_task),) for first in range(0, shape[0], per_task)]


def _add_picture(linear: NDArray[np.float32], sums: NDArray[np.float64], workers: Workers) -> None:
    """Add the linear colour of a picture to the sums, both (H, W, 4)."""

    def add_band(band: slice) -> None:
        coverage_resolve.add_picture(linear[band], sums[band])

    workers.run(add_band, _bands(linear.shape, workers))


def _add_codes(color: NDArray[np.uint8], sums: NDArray[np.float64], workers: Workers) -> None:
    """Add the codes of a picture to the sums, both (H, W, 4)."""
    packed = color.view(np.uint32)[:, :, 0]

    def add_band(band: slice) -> None:
        srgb_compositing.add_codes(packed[band], sums[band])

    workers.run(add_band, _bands(color.shape, workers))


def _average_codes(
    context: FrameContext, sums: NDArray[np.float64], count: int
) -> dict[str, NDArray[Any]]:
    """Return the colour outputs of the mean of the codes of all pictures."""
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

    def write_band(band: slice) -> None:
        srgb_compositing.write_mean_codes(sums[band], count, behind, packed[band])
        if linear is not None:
            srgb_compositing.decode_rows(packed[band], light, linear[band])

    workers.run(write_band, _bands(sums.shape, workers))
    return _wanted(plan, linear, color)


def _average(
    context: FrameContext, sums: NDArray[np.float64], count: int
) -> dict[str, NDArray[Any]]:
    """Return the colour outputs of the mean of all pictures."""
    plan, workers = context.plan, context.workers
    behind = _background(plan)
    given = [
        ActiveEffect(one.effect, one.effect.prepare(context, one.data, ()))
        for one in plan.effects_at("background")
        if is_backdrop(one.effect)
    ]
    tones = None
    for one in plan.effects_at("mixed"):
        tones = resolve_layers.Tones(ActiveEffect(one.effect, one.data), plan.background, given)
    height, width, _ = sums.shape
    table = srgb_encoding.make_encoding_table(plan.facts.encoding)
    linear = workers.memory.empty((height, width, 4), np.float32)
    color = workers.memory.empty((height, width, 4), np.uint8) if "color" in plan.outputs else None
    packed = np.empty((height, 0), np.uint32) if color is None else color.view(np.uint32)[:, :, 0]

    def write_band(band: slice) -> None:
        coverage_resolve.write_mean(sums[band], count, behind, linear[band])
        rows = resolve_layers.ColorRows(linear[band], packed[band])
        resolve_layers.show_rows(IMMEDIATE, tones, table, rows, band.start, workers.memory)

    workers.run(write_band, _bands(sums.shape, workers))
    return _wanted(plan, linear, color)


def _wanted(
    plan: RenderPlan, linear: NDArray[np.float32] | None, color: NDArray[np.uint8] | None
) -> dict[str, NDArray[Any]]:
    """Return the colour outputs of a frame by name."""
    made = (("linear", linear), ("color", color))
    return {name: one for name, one in made if one is not None and name in plan.outputs}


def cover_samples(
    samples: int | str, seen: RasterizedView, finder: fragment_bands.Finder, workers: Workers
) -> NDArray[np.float32]:
    """
    Return the share of each pixel's samples that any face covers, (H, W), or of its area.

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

    def cover_tiles(first: int) -> None:
        rows = first, min(first + TILE_SIZE, viewport.height)
        if samples == "area":
            _, _, rest = fragment_bands.find_areas(rows, lists, finder, workers.memory)
            np.subtract(np.float32(1.0), rest, out=covered[slice(*rows)])
            return
        for band in fragment_bands.find_layers(rows, lists, int(samples), finder, workers.memory):
            counts = np.count_nonzero(band.opaque >= 0, axis=0)
            target = covered[band.first_row : band.first_row + len(counts)]
            # The number of samples is a power of two.
            target[:] = counts / np.float32(samples)

    workers.run(cover_tiles, [(first,) for first in range(0, viewport.height, TILE_SIZE)])
    return covered
