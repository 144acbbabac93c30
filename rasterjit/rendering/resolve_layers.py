"""
Shade and resolve frames with several faces per pixel: multisampling, areas, transparency.

Each thread works on a band, rows of one row of tiles: it finds the layers (images of face numbers),
shades each like a visibility buffer, and composites them. So it needs memory for the layers of one
band only. A band whose layers take more than ``MAX_BYTES`` is split.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.fragments import (
    compositing,
    constant_colors,
    coverage_resolve,
    drawing_order,
    fragment_bands,
    srgb_compositing,
)
from rasterjit.pipeline.fragments.fragment_bands import (
    MAX_BYTES,
    Band,
    Finder,
    PartitionedLists,
    find_areas,
    find_layers,
    make_sampled_finder,
    split_tile_lists,
)
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.passes import KernelRow, Rows, ShadingNeeds, rows_where
from rasterjit.pipeline.records import (
    AlphaTests,
    Geometry,
    Lighting,
    Placement,
    PyrenderObjects,
    Surface,
)
from rasterjit.pipeline.visibility.visibility_pass import Coverage
from rasterjit.rendering.pass_runner import IMMEDIATE, AnyCalls, Shading, Sharing, no_color
from rasterjit.runtime.threads import Kept, Memory, ReusedMemory, Workers
from rasterjit.scene.reference_shader import decode_codes
from rasterjit.survey.effect import ActiveEffect, is_backdrop, select_acting
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.transparency import PixelLayers

ROWS_AT_ONCE = 16
"""Rows of a band that are shaded and resolved together: their colours stay in L2."""

ROWS_MIXED_AT_ONCE = 32
"""The same of opaque faces: few pixels show more than one or two."""

PIXELS_MIXED_AT_ONCE = 1 << 14
"""The same in pixels, for pictures so narrow that these are more rows."""

AnyMemory = Memory | ReusedMemory

SEVERAL = "a pixel shows several faces"
"""Condition of the kernels that resolve several faces."""


BYTES_PER_COLOR = 4
"""Codes of red, green, blue and alpha."""


class Shader(NamedTuple):
    """Everything needed to shade an image of face numbers."""

    needs: ShadingNeeds
    geometry: Geometry
    placement: Placement
    surface: Surface
    lighting: Lighting | None
    background: NDArray[np.float32]
    """(4,) linear."""
    effects: tuple[ActiveEffect, ...] = ()
    alpha_tests: AlphaTests | None = None
    """The alpha-tested objects."""
    has_codes: bool = False
    """Whether colours are blended as codes; else in linear light."""
    encoding: srgb_encoding.Encoding = "srgb"
    """Transfer function of codes."""
    plain: tuple[NDArray[np.uint32], int] | None = None
    """The constant code of each object, (O,), and of the background; ``None`` -> shade."""
    stages: Shading | None = None
    """Made by `ready` when nothing above changes any more."""

    @property
    def shading(self) -> Shading:
        """The stages; raises ``RuntimeError`` before they are made."""
        if self.stages is None:
            raise RuntimeError("the stages of a shader are made by ready()")
        return self.stages

    @property
    def finder(self) -> Finder:
        """What finds the faces of an image."""
        return Finder(self.geometry, self.alpha_tests)

    def of_plain_codes(self) -> Shader:
        """Return this shader for constant-colour objects over an opaque background colour."""
        red, green, blue = srgb_encoding.encode_values(
            self.surface.materials[:, :3], self.encoding
        ).T
        codes = red | green << 8 | blue << 16 | np.uint32(255 << 24)
        return self._replace(
            plain=(codes, srgb_encoding.encode_color(self.background, self.encoding))
        )

    def ready(self, kept: Kept | None = None, viewer: NDArray[np.float32] | None = None) -> Shader:
        """
        Return this shader with its stages made, or with those of the picture before.

        ``viewer`` is what `Shading` takes.
        """
        read = self.needs, self.geometry, self.placement, self.surface, self.lighting, self.effects
        encoding, background = self.encoding, self.background
        if kept is None or not kept.lasts:
            return self._replace(stages=Shading(*read, encoding, background, viewer))
        lighting = self.lighting
        if lighting is not None:
            # Lights lie relative to the eye.
            lighting = lighting._replace(
                lights=kept.copied("light rows", lighting.lights),
                ambient=kept.copied("light from all around", lighting.ambient),
                pyrender=_kept_imitated(lighting.pyrender, kept),
            )
        stages = kept.made(
            "stages", Shading, *read[:4], lighting, self.effects, encoding,
            kept.made("color behind", _color_of, background.tobytes()),
            kept.copied("viewer", self.placement.toward_viewer, np.float32),
        )  # fmt: skip
        return self._replace(stages=stages)

    @property
    def has_behind(self) -> bool:
        """Whether the background is more than one colour."""
        return bool(select_acting(self.effects, "background"))

    def show_behind(
        self, calls: AnyCalls, faces: NDArray[np.int32], first_row: int,
        linear: NDArray[np.float32], color: NDArray[np.uint32],
    ) -> None:  # fmt: skip
        """Write the background where no face is, if it is not one colour."""
        for one in select_acting(self.effects, "background"):
            one.call_at("background", calls, faces, first_row, linear, color)

    def backdrop(
        self, calls: AnyCalls, shape: tuple[int, int], first_row: int, memory: AnyMemory
    ) -> NDArray[np.float32]:
        """
        Return the background of some rows, (R, W, 4), or (1, 1, 4) if uniform.

        Linear, or codes, 0..255 with alpha of 0..1, where codes are blended.
        """
        if self.has_codes:
            color = memory.empty(shape if self.has_behind else (1, 1), np.uint32)
            self.code_backdrop(first_row, color)
            codes = color.view(np.uint8).reshape(*color.shape, 4)
            backdrop = codes.astype(np.float32)
            backdrop[:, :, 3] /= np.float32(255.0)
            return backdrop
        if not self.has_behind:
            return self.background.reshape(1, 1, 4)
        linear = memory.empty((*shape, 4), np.float32)
        self.show_behind(calls, np.full(shape, -1, np.int32), first_row, linear, no_color(linear))
        return linear

    def code_backdrop(self, first_row: int, color: NDArray[np.uint32]) -> None:
        """Write the background of some rows, (R, W), in RGBA codes."""
        color[:] = srgb_encoding.encode_color(self.background, self.encoding)
        nothing = np.full(color.shape, -1, np.int32)
        self.show_behind(IMMEDIATE, nothing, first_row, no_linear(color), color)

    def code(self, faces: NDArray[np.int32], first_row: int, color: NDArray[np.uint32]) -> None:
        """Write faces, (R, W) or (J, R, W), alone, in RGBA codes; 0 where no face is."""
        nothing = np.zeros(4, np.float32), 0
        self.shading.shade(faces, first_row, no_linear(color), color, nothing)

    def code_last(
        self, faces: NDArray[np.int32], first_row: int, color: NDArray[np.uint32]
    ) -> None:
        """Write an image of faces, (R, W), and the background where no face is."""
        self.shading.shade(faces, first_row, no_linear(color), color)
        self.show_behind(IMMEDIATE, faces, first_row, no_linear(color), color)


class Tones(NamedTuple):
    """Tone mapping of resolved rows, and the background that is not tone mapped."""

    effect: ActiveEffect
    background: NDArray[np.float32]
    """(4,) linear: composited behind, after tone mapping."""
    given: Sequence[ActiveEffect] = ()
    """Effects that draw the background instead; see `is_backdrop`."""

    def show(
        self, calls: AnyCalls, linear: NDArray[np.float32], first_row: int, memory: AnyMemory
    ) -> NDArray[np.float32]:
        """Return tone-mapped rows over the background, (R, W, 4) linear with straight alpha."""
        behind, shown = self.background, memory.empty(linear.shape, np.float32)
        if self.given:
            behind = shown
            nothing = np.full(linear.shape[:2], -1, np.int32)
            for one in self.given:
                one.call_at("background", calls, nothing, first_row, behind, no_color(behind))
        self.effect.call_at("mixed", calls, linear, behind, shown)
        return shown


def before_tones(shader: Shader) -> tuple[Shader, Tones | None]:
    """
    Return a shader for colours before tone mapping, and the tone mapping after resolving.

    The background is then composited at the end, without tone mapping.
    """
    mixed = select_acting(shader.effects, "mixed")
    if not mixed:
        return shader, None
    given = [one for one in shader.effects if is_backdrop(one.effect)]
    toned = tuple(one for one in shader.effects if not is_backdrop(one.effect))
    tones = Tones(mixed[0], shader.background, given)
    return shader._replace(background=np.zeros(4, np.float32), effects=toned), tones


def _kept_imitated(imitated: PyrenderObjects | None, kept: Kept) -> PyrenderObjects | None:
    """Return what pyrender's shader is given, where that of the picture before lay."""
    if imitated is None:
        return None
    faces_viewer, are_squares = imitated.faces_viewer, imitated.are_squares
    if faces_viewer is not None:
        faces_viewer = kept.copied("facing the viewer", faces_viewer)
    if are_squares is not None:
        are_squares = kept.copied("squares", are_squares)
    gains = imitated.gains
    if gains is not None:
        gains = kept.copied("gains", gains)
    taken = kept.copied("who takes what", imitated.falls_on)
    own = taken, faces_viewer, are_squares, gains
    return kept.made("imitated", PyrenderObjects, *own, imitated.maps)


def no_linear(color: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return an empty array that stands for no linear output, for pixels (..., W)."""
    return np.empty((*color.shape[:-1], 0, 4), np.float32)


def _color_of(numbers: bytes) -> NDArray[np.float32]:
    """Return a colour, (4,), given its bytes."""
    return np.frombuffer(numbers, np.float32).copy()


class ColorRows(NamedTuple):
    """Some rows of the colour outputs; one that is not requested is empty."""

    linear: NDArray[np.float32]
    """(R, W, 4), or (R, 0, 4)."""
    color: NDArray[np.uint32]
    """(R, W), or (R, 0)."""


def parts_of(height: int, most: int) -> list[slice]:
    """Split rows into the parts that are shaded and resolved together."""
    return [slice(first, first + most) for first in range(0, height, most)]


def lay_faces(
    calls: AnyCalls, shader: Shader, images: Sequence[NDArray[np.int32]], first_row: int,
    depths: NDArray[np.int64], target: NDArray[np.float32], memory: AnyMemory,
) -> None:  # fmt: skip
    """
    Shade and composite layers of some rows, one sample a pixel, linear.

    Parameters
    ----------
    calls : AnyCalls
    shader : Shader
    images : sequence of (R, W) int32
        The transparent faces, nearest first, then the opaque ones.
    first_row : int
    depths : (1+,) int64
        The first says how many images of transparent faces there are, when this is called.
    target : (R, W, 4) float32
        Written.
    memory : Memory
    """
    *transparent, opaque = images
    most, has_any = len(transparent), (depths, 1, len(transparent))
    if transparent:
        colors, sums = (memory.empty(target.shape, np.float32) for _ in range(2))
        calls.call(compositing.start_sums, sums, when=has_any)
    for level, faces in enumerate(transparent):
        calls.shade(shader.shading, faces, first_row, colors, (depths, level + 1, most))
        for behind, when in (
            (images[level + 1], (depths, level + 2, most)),
            (opaque, (depths, level + 1, level + 1)),
        ):
            calls.call(compositing.composite_under, colors, faces, behind, sums, when=when)
    calls.shade(shader.shading, opaque, first_row, target)
    shader.show_behind(calls, opaque, first_row, target, no_color(target))
    if transparent:
        calls.call(compositing.finish_sums, sums, target, when=has_any)


def lay_layers(band: Band, shader: Shader, linear: NDArray[np.float32], memory: Memory) -> None:
    """Write the linear colour of some rows, (R, W, 4), one sample each: layers over each other."""
    depths = np.array(band.transparent.shape[1:2])
    for part in parts_of(len(linear), ROWS_AT_ONCE):
        images = [*band.transparent[0, :, part], band.opaque[0, part]]
        first, target = band.first_row + part.start, linear[part]
        lay_faces(IMMEDIATE, shader, images, first, depths, target, memory)


def mix_areas(
    rows: tuple[int, int],
    lists: PartitionedLists,
    shader: Shader,
    target: ColorRows,
    memory: Memory,
) -> None:
    """Resolve one row of tiles of opaque faces by exact area coverage."""
    faces, shares, rest = find_areas(rows, lists, shader.finder, memory)
    mixed = memory.empty((len(rest), 4, rest.shape[1]), np.float32)
    mixed[:] = shader.backdrop(IMMEDIATE, rest.shape, rows[0], memory).transpose(0, 2, 1)
    shader.shading.mix(faces, rows[0], shares, rest, mixed, shader.has_codes)
    finish_mixed(IMMEDIATE, shader, shares[0], rest, mixed, target)


def mix_opaque(band: Band, shader: Shader, target: ColorRows, memory: Memory) -> None:
    """Resolve some rows of opaque faces at several samples."""
    most = max(ROWS_MIXED_AT_ONCE, PIXELS_MIXED_AT_ONCE // band.opaque.shape[2])
    for part in parts_of(len(target.color), most):
        some = ColorRows(target.linear[part], target.color[part])
        rows = part.start, part.start + len(some.color)
        mix_samples(IMMEDIATE, shader, band.opaque, rows, band.first_row, some, memory)


def mix_samples(
    calls: AnyCalls, shader: Shader, opaque: NDArray[np.int32], rows: tuple[int, int],
    first_row: int, target: ColorRows, memory: AnyMemory,
) -> None:  # fmt: skip
    """
    Write the colour of some rows whose samples show opaque faces.

    Parameters
    ----------
    calls : AnyCalls
    shader : Shader
    opaque : (N, B, W) int32
        The faces at each sample of some rows.
    rows : (int, int)
        The first of them that is mixed, and one past the last.
    first_row : int
        Row of the frame in which the first of ``opaque`` lies.
    target : ColorRows
        Written.
    memory : Memory
    """
    (samples, _, width), height = opaque.shape, rows[1] - rows[0]
    shape, first = (samples, height, width), first_row + rows[0]
    shown, shares = memory.empty(shape, np.int32), memory.empty(shape, np.float32)
    rest, mixed = memory.empty(shape[1:], np.float32), memory.empty((height, 4, width), np.float32)
    others = memory.empty((2, coverage_resolve.COLUMNS_PER_BLOCK), np.int32)
    behind = shader.backdrop(calls, shape[1:], first, memory)
    sharing = Sharing(opaque, rows, shown, shares, rest, others)
    calls.mix(shader.shading, first, sharing, behind, mixed, shader.has_codes)
    finish_mixed(calls, shader, shares[0], rest, mixed, target)


def finish_mixed(
    calls: AnyCalls, shader: Shader, shares: NDArray[np.float32], rest: NDArray[np.float32],
    mixed: NDArray[np.float32], target: ColorRows,
) -> None:  # fmt: skip
    """Write the colour of resolved rows; see ``coverage_resolve.finish_light``."""
    if shader.has_codes:
        calls.call(coverage_resolve.finish_codes, shares, rest, mixed, target.color)
    else:
        table = srgb_encoding.make_encoding_table(shader.encoding)
        calls.call(coverage_resolve.finish_light, shares, rest, mixed, table, *target)


def mix_layers(band: Band, shader: Shader, linear: NDArray[np.float32], memory: Memory) -> None:
    """Write the linear colour of some rows, (R, W, 4), of layers at several samples."""
    samples, levels, _, width = band.transparent.shape
    # What is known of one face in one pixel: its number and its colour.
    per_row = samples * (levels + 1) * width * (4 + 16)
    rows = min(max(MAX_BYTES // 16 // per_row, 1), ROWS_AT_ONCE)
    for part in parts_of(len(linear), rows):
        first, target = band.first_row + part.start, linear[part]
        opaque = np.ascontiguousarray(band.opaque[:, part])
        transparent = np.ascontiguousarray(band.transparent[:, :, part])
        shown = memory.empty((samples * (levels + 1), *target.shape[:2]), np.int32)
        count = int(compositing.list_faces(opaque, transparent, shown))
        colors = memory.empty((count, *target.shape), np.float32)
        behind = memory.empty(target.shape, np.float32)
        if count > 0:
            IMMEDIATE.shade(shader.shading, shown[:count], first, colors)
        nothing = np.full(target.shape[:2], -1, np.int32)
        IMMEDIATE.shade(shader.shading, nothing, first, behind)
        shader.show_behind(IMMEDIATE, nothing, first, behind, no_color(behind))
        compositing.mix_samples(opaque, transparent, colors, behind, target)


def is_direct(layers: PixelLayers, has_mixed: bool) -> bool:
    """Return whether faces are resolved and encoded at once: opaque, no effects in between."""
    return layers.samples != 1 and not layers.has_blended and not has_mixed


def kernels_of(plan: RenderPlan) -> Rows:
    """Return the kernels that `shade` and `shade_codes` call besides stages."""
    layers = plan.layers
    if layers is None:
        return []
    rows, kernels = shared_kernels(plan, layers), []
    has_samples, codes = layers.samples != 1, layers.mixes_codes
    if layers.has_blended and codes:
        kernels = [srgb_compositing.mark_hidden, srgb_compositing.composite_codes]
        if has_samples:
            kernels = [compositing.list_faces, srgb_compositing.mix_codes]
        if layers.in_order:
            kernels = [drawing_order.drop_hidden, *kernels]
    elif layers.has_blended:
        kernels = [compositing.start_sums, compositing.composite_under, compositing.finish_sums]
        kernels += [compositing.list_faces, compositing.mix_samples] * has_samples
    rows += rows_where(SEVERAL, *kernels)
    if codes:
        return rows + [KernelRow(srgb_compositing.decode_rows)] * ("linear" in plan.outputs)
    rows += plan.kernels_at("mixed")
    if "color" in plan.outputs and not is_direct(layers, bool(plan.effects_at("mixed"))):
        rows.append(KernelRow(srgb_encoding.encode_rows))
    return rows


def shared_kernels(plan: RenderPlan, layers: PixelLayers) -> Rows:
    """Return the kernels that find the faces of pixels and resolve opaque ones."""
    rows = fragment_bands.list_kernels(layers.samples, plan.depth_format.kind)
    if layers.samples == 1:
        return rows
    if plan.mixes_plain_codes:
        from rasterjit.pipeline.fragments import constant_colors

        return [*rows, KernelRow(constant_colors.average_codes)]
    opaque = "a row of tiles is opaque" if layers.has_blended else ""
    if layers.samples != "area":
        rows.append(KernelRow(coverage_resolve.list_coverage, "", opaque))
    finish = coverage_resolve.finish_codes if layers.mixes_codes else coverage_resolve.finish_light
    return [*rows, KernelRow(finish, "", opaque)]


def shade(
    plan: PixelLayers,
    coverage: Coverage,
    shader: Shader,
    linear: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    workers: Workers,
) -> None:
    """
    Shade a frame whose pixels show several faces, over each other or beside each other.

    Parameters
    ----------
    plan : PixelLayers
    coverage : Coverage
        With its lists.
    shader : Shader
    linear : (H, W, 4) float32 or None
        Written, if the frame has it.
    color : (H, W, 4) uint8 or None
        Written, if the frame has it.
    workers : Workers

    Raises
    ------
    ValueError
        If a pixel has more layers than are sorted.
    """
    shader, tones = before_tones(make_sampled_finder(shader, plan.samples))
    viewport = shader.geometry.viewport
    lists = split_tile_lists(coverage, viewport, plan.is_blended, workers)
    shader, table = shader.ready(), srgb_encoding.make_encoding_table(shader.encoding)
    nothing = np.empty((viewport.height, 0), np.uint32)
    packed = nothing if color is None else color.view(np.uint32)[:, :, 0]
    at_once = is_direct(plan, tones is not None)

    def shade_tiles(first: int) -> None:
        last = min(first + TILE_SIZE, viewport.height)
        shape = last - first, viewport.width * (linear is not None or not at_once), 4
        rows = workers.memory.empty(shape, np.float32) if linear is None else linear[first:last]
        target = ColorRows(rows, (packed if at_once else nothing)[first:last])
        shade_rows((first, last), plan, lists, shader, target, workers.memory)
        if not at_once:
            shown = packed[first:last]
            show_rows(IMMEDIATE, tones, table, ColorRows(rows, shown), first, workers.memory)

    workers.run(shade_tiles, [(first,) for first in range(0, viewport.height, TILE_SIZE)])


def show_rows(
    calls: AnyCalls, tones: Tones | None, table: NDArray[np.int32], rows: ColorRows, first_row: int,
    memory: AnyMemory,
) -> None:  # fmt: skip
    """Encode the linear colour of some rows, where codes are requested."""
    if rows.color.shape[1]:
        linear = rows.linear
        if tones is not None:
            linear = tones.show(calls, linear, first_row, memory)
        calls.call(srgb_encoding.encode_rows, linear, table, rows.color)


def shade_rows(
    rows: tuple[int, int],
    plan: PixelLayers,
    lists: PartitionedLists,
    shader: Shader,
    target: ColorRows,
    memory: Memory,
) -> None:
    """Write the colour of one row of tiles: codes, light, or both if all faces are opaque."""
    if plan.samples == "area":
        mix_areas(rows, lists, shader, target, memory)
        return
    for band in find_layers(rows, lists, int(plan.samples), shader.finder, memory, plan.most):
        start, levels = band.first_row - rows[0], band.transparent.shape[1]
        rows_of_band = slice(start, start + band.opaque.shape[1])
        part = ColorRows(target.linear[rows_of_band], target.color[rows_of_band])
        if plan.in_order and levels > 1:
            drawing_order.drop_hidden(band.transparent)
        if plan.samples != 1 and shader.plain is not None:
            starts = shader.placement.face_starts
            constant_colors.average_codes(band.opaque, *shader.plain, starts, part.color)
        elif plan.samples != 1 and levels == 0:
            mix_opaque(band, shader, part, memory)
        elif shader.has_codes:
            lay_in_codes = composite_codes if plan.samples == 1 else mix_codes
            lay_in_codes(band, shader, part.color, memory)
        else:
            lay = lay_layers if plan.samples == 1 else mix_layers
            lay(band, shader, part.linear, memory)


def rows_at_once(images: int, width: int) -> int:
    """Return how many rows of so many images are held at once."""
    per_row = images * width * BYTES_PER_COLOR
    return min(max(MAX_BYTES // 16 // per_row, 1), ROWS_AT_ONCE)


def composite_codes(band: Band, shader: Shader, color: NDArray[np.uint32], memory: Memory) -> None:
    """Write the colour of some rows, (R, W), one sample each: layers over each other."""
    levels, width = band.transparent.shape[1], color.shape[1]
    for part in parts_of(len(color), rows_at_once(levels + 1, width)):
        first, target = band.first_row + part.start, color[part]
        images = [*band.transparent[0, :, part], band.opaque[0, part]]
        if levels == 0:
            shader.code_last(images[0], first, target)
            continue
        stack = memory.empty((levels + 1, *target.shape), np.uint32)
        # Front to back: nothing is shaded behind opaque layers.
        for level in range(levels):
            shader.code(images[level], first, stack[level])
            srgb_compositing.mark_hidden(stack, level, images[level + 1])
        shader.code_last(images[levels], first, stack[levels])
        srgb_compositing.composite_codes(stack, target)


def mix_codes(band: Band, shader: Shader, color: NDArray[np.uint32], memory: Memory) -> None:
    """Write the colour of some rows, (R, W), of layers at several samples."""
    samples, levels, _, width = band.transparent.shape
    most = samples * (levels + 1)
    # What is known of one face in one pixel: its number and its colour.
    for part in parts_of(len(color), rows_at_once(2 * most, width)):
        first, target = band.first_row + part.start, color[part]
        opaque = np.ascontiguousarray(band.opaque[:, part])
        transparent = np.ascontiguousarray(band.transparent[:, :, part])
        shown = memory.empty((most, *target.shape), np.int32)
        count = int(compositing.list_faces(opaque, transparent, shown))
        colors = memory.empty((count, *target.shape), np.uint32)
        behind = memory.empty(target.shape, np.uint32)
        if count > 0:
            shader.code(shown[:count], first, colors)
        shader.code_backdrop(first, behind)
        srgb_compositing.mix_codes(opaque, transparent, colors, behind, target)


def shade_codes(
    plan: PixelLayers,
    coverage: Coverage,
    shader: Shader,
    linear: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    workers: Workers,
) -> None:
    """
    Shade a frame whose pixels show several faces, over each other or beside each other.

    Takes what ``shade`` takes.

    Raises
    ------
    ValueError
        If a pixel has more layers than are sorted, and all are seen.
    """
    shader = shader._replace(has_codes=True)
    if shader.plain is not None:
        shader = fragment_bands.make_sampled_finder(shader, plan.samples)
    elif plan.at_centers:
        shader = fragment_bands.make_sampled_finder(shader.ready(), plan.samples)
    else:
        shader = fragment_bands.make_sampled_finder(shader, plan.samples).ready()
    viewport = shader.geometry.viewport
    lists = fragment_bands.split_tile_lists(coverage, viewport, plan.is_blended, workers)
    packed = None if color is None else color.view(np.uint32)[:, :, 0]
    light = decode_codes(shader.encoding).copy()

    def code_tiles(first: int) -> None:
        last = min(first + TILE_SIZE, viewport.height)
        if packed is None:
            rows = workers.memory.empty((last - first, viewport.width), np.uint32)
        else:
            rows = packed[first:last]
        target = ColorRows(no_linear(rows), rows)
        shade_rows((first, last), plan, lists, shader, target, workers.memory)
        if linear is not None:
            srgb_compositing.decode_rows(rows, light, linear[first:last])

    workers.run(code_tiles, [(first,) for first in range(0, viewport.height, TILE_SIZE)])
