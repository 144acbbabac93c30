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
from rasterjit.pipeline.fragments.fragment_bands import Band, Finder, PartitionedLists
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
from rasterjit.rendering.pass_runner import (
    IMMEDIATE,
    AnyCalls,
    CoverageArguments,
    Shading,
    empty_color,
)
from rasterjit.runtime.threads import FrameCache, Memory, ReusedMemory, Workers, split_range
from rasterjit.scene.reference_shader import decode_codes
from rasterjit.survey.effect import ActiveEffect, is_backdrop, select_acting
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.transparency import PixelLayers

MAX_LAYERED_ROWS = 16
"""Most rows of a band, with layers, that are resolved together: their colours stay in L2."""

MAX_OPAQUE_ROWS = 32
"""Most rows of opaque faces: few pixels show more than one or two."""

MAX_OPAQUE_PIXELS = 1 << 14
"""Pixels of opaque faces that are resolved together even if in more rows."""

AnyMemory = Memory | ReusedMemory

WHERE_SEVERAL_FACES = "a pixel shows several faces"
"""Condition of the kernels that resolve several faces."""


BYTES_PER_CODE = 4
"""Red, green, blue and alpha."""


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
    constant_codes: tuple[NDArray[np.uint32], int] | None = None
    """The constant code of each object, (O,), and of the background; ``None`` -> shade."""
    stages: Shading | None = None
    """Set by `prepare_stages`, when the fields above are final."""

    @property
    def shading(self) -> Shading:
        """The prepared stages; raises ``RuntimeError`` before."""
        if self.stages is None:
            raise RuntimeError("the stages of a shader are made by prepare_stages()")
        return self.stages

    @property
    def finder(self) -> Finder:
        """The `Finder` of the faces of an image."""
        return Finder(self.geometry, self.alpha_tests)

    def with_constant_codes(self) -> Shader:
        """Return this shader with one code per object, for unlit objects before one colour."""
        red, green, blue = srgb_encoding.encode_values(
            self.surface.materials[:, :3], self.encoding
        ).T
        codes = red | green << 8 | blue << 16 | np.uint32(255 << 24)
        return self._replace(
            constant_codes=(codes, srgb_encoding.encode_color(self.background, self.encoding))
        )

    def prepare_stages(
        self, frame_cache: FrameCache | None = None, viewer: NDArray[np.float32] | None = None
    ) -> Shader:
        """
        Return this shader with its stages, cached ones if their inputs are the same.

        ``viewer`` is what `Shading` takes.
        """
        inputs = (
            self.needs,
            self.geometry,
            self.placement,
            self.surface,
            self.lighting,
            self.effects,
        )
        encoding, background = self.encoding, self.background
        if frame_cache is None or not frame_cache.is_enabled:
            return self._replace(stages=Shading(*inputs, encoding, background, viewer))
        lighting = self.lighting
        if lighting is not None:
            # Positions of lights are relative to the eye: they change with the camera.
            lighting = lighting._replace(
                lights=frame_cache.copy_into("light rows", lighting.lights),
                ambient=frame_cache.copy_into("ambient light", lighting.ambient),
                pyrender=_copy_pyrender_objects(lighting.pyrender, frame_cache),
            )
        stages = frame_cache.get_or_make(
            "stages", Shading, *inputs[:4], lighting, self.effects, encoding,
            frame_cache.get_or_make("background color", _color_from_bytes, background.tobytes()),
            frame_cache.copy_into("viewer", self.placement.toward_viewer, np.float32),
        )  # fmt: skip
        return self._replace(stages=stages)

    @property
    def has_background_effects(self) -> bool:
        """Whether effects draw the background, such as an image: it is not one colour."""
        return bool(select_acting(self.effects, "background"))

    def draw_background(
        self, calls: AnyCalls, faces: NDArray[np.int32], first_row: int,
        linear: NDArray[np.float32], color: NDArray[np.uint32],
    ) -> None:  # fmt: skip
        """Write the background of effects, if there are any, where no face is."""
        for active in select_acting(self.effects, "background"):
            active.call_at("background", calls, faces, first_row, linear, color)

    def make_background_rows(
        self, calls: AnyCalls, shape: tuple[int, int], first_row: int, memory: AnyMemory
    ) -> NDArray[np.float32]:
        """
        Return the background of some rows, (R, W, 4), or (1, 1, 4) if uniform.

        Linear; or, where codes are blended, codes of 0..255 with alpha of 0..1.
        """
        if self.has_codes:
            color = memory.empty(shape if self.has_background_effects else (1, 1), np.uint32)
            self.write_background_codes(first_row, color)
            codes = color.view(np.uint8).reshape(*color.shape, 4)
            background = codes.astype(np.float32)
            background[:, :, 3] /= np.float32(255.0)
            return background
        if not self.has_background_effects:
            return self.background.reshape(1, 1, 4)
        linear = memory.empty((*shape, 4), np.float32)
        self.draw_background(
            calls, np.full(shape, -1, np.int32), first_row, linear, empty_color(linear)
        )
        return linear

    def write_background_codes(self, first_row: int, color: NDArray[np.uint32]) -> None:
        """Write the background of some rows, (R, W), in RGBA codes."""
        color[:] = srgb_encoding.encode_color(self.background, self.encoding)
        nothing = np.full(color.shape, -1, np.int32)
        self.draw_background(IMMEDIATE, nothing, first_row, empty_linear(color), color)

    def write_codes(
        self, faces: NDArray[np.int32], first_row: int, color: NDArray[np.uint32]
    ) -> None:
        """Write the RGBA codes of faces, (R, W) or (J, R, W); 0 where no face is."""
        nothing = np.zeros(4, np.float32), 0
        self.shading.shade(faces, first_row, empty_linear(color), color, nothing)

    def write_codes_over_background(
        self, faces: NDArray[np.int32], first_row: int, color: NDArray[np.uint32]
    ) -> None:
        """Write the RGBA codes of faces, (R, W), and of the background where no face is."""
        self.shading.shade(faces, first_row, empty_linear(color), color)
        self.draw_background(IMMEDIATE, faces, first_row, empty_linear(color), color)


class LateToneMapping(NamedTuple):
    """Tone mapping of resolved rows, and the background that is not tone mapped."""

    effect: ActiveEffect
    background: NDArray[np.float32]
    """(4,) linear: composited behind, after tone mapping."""
    background_effects: Sequence[ActiveEffect] = ()
    """Effects that draw the background instead; see `is_backdrop`."""

    def apply(
        self, calls: AnyCalls, linear: NDArray[np.float32], first_row: int, memory: AnyMemory
    ) -> NDArray[np.float32]:
        """Return tone-mapped rows over the background, (R, W, 4) linear with straight alpha."""
        behind, shown = self.background, memory.empty(linear.shape, np.float32)
        if self.background_effects:
            behind = shown
            nothing = np.full(linear.shape[:2], -1, np.int32)
            for active in self.background_effects:
                active.call_at("background", calls, nothing, first_row, behind, empty_color(behind))
        self.effect.call_at("mixed", calls, linear, behind, shown)
        return shown


def split_tone_mapping(shader: Shader) -> tuple[Shader, LateToneMapping | None]:
    """
    Split a shader into one without tone mapping, and the tone mapping of resolved colours.

    The background is then composited at the end, without tone mapping.
    """
    mixed = select_acting(shader.effects, "mixed")
    if not mixed:
        return shader, None
    given = [active for active in shader.effects if is_backdrop(active.effect)]
    toned = tuple(active for active in shader.effects if not is_backdrop(active.effect))
    tone_mapping = LateToneMapping(mixed[0], shader.background, given)
    return shader._replace(background=np.zeros(4, np.float32), effects=toned), tone_mapping


def _copy_pyrender_objects(
    pyrender: PyrenderObjects | None, frame_cache: FrameCache
) -> PyrenderObjects | None:
    """Copy the inputs of pyrender's shading into cached arrays."""
    if pyrender is None:
        return None
    faces_viewer, are_squares = pyrender.faces_viewer, pyrender.are_squares
    if faces_viewer is not None:
        faces_viewer = frame_cache.copy_into("faces_viewer", faces_viewer)
    if are_squares is not None:
        are_squares = frame_cache.copy_into("are_squares", are_squares)
    gains = pyrender.gains
    if gains is not None:
        gains = frame_cache.copy_into("gains", gains)
    falls_on = frame_cache.copy_into("falls_on", pyrender.falls_on)
    parts = falls_on, faces_viewer, are_squares, gains
    return frame_cache.get_or_make("pyrender objects", PyrenderObjects, *parts, pyrender.maps)


def empty_linear(color: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return an empty array in place of a linear output, for pixels (..., W)."""
    return np.empty((*color.shape[:-1], 0, 4), np.float32)


def _color_from_bytes(numbers: bytes) -> NDArray[np.float32]:
    """Return a colour, (4,) float32, given its bytes."""
    return np.frombuffer(numbers, np.float32).copy()


class ColorRows(NamedTuple):
    """Some rows of the colour outputs; empty if not requested."""

    linear: NDArray[np.float32]
    """(R, W, 4), or (R, 0, 4)."""
    color: NDArray[np.uint32]
    """(R, W), or (R, 0)."""


def split_rows(height: int, max_rows: int) -> list[slice]:
    """Split rows into parts that are shaded and resolved together."""
    return [slice(first, first + max_rows) for first in range(0, height, max_rows)]


def composite_faces(
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
        ``depths[0]`` images of transparent faces are not empty, when the calls run.
    target : (R, W, 4) float32
        Written.
    memory : Memory
    """
    *transparent, opaque = images
    capacity, has_any = len(transparent), (depths, 1, len(transparent))
    if transparent:
        colors, sums = (memory.empty(target.shape, np.float32) for _ in range(2))
        calls.call(compositing.start_sums, sums, when=has_any)
    for level, faces in enumerate(transparent):
        calls.shade(shader.shading, faces, first_row, colors, (depths, level + 1, capacity))
        for behind, when in (
            (images[level + 1], (depths, level + 2, capacity)),
            (opaque, (depths, level + 1, level + 1)),
        ):
            calls.call(compositing.composite_under, colors, faces, behind, sums, when=when)
    calls.shade(shader.shading, opaque, first_row, target)
    shader.draw_background(calls, opaque, first_row, target, empty_color(target))
    if transparent:
        calls.call(compositing.finish_sums, sums, target, when=has_any)


def composite_layers(
    band: Band, shader: Shader, linear: NDArray[np.float32], memory: Memory
) -> None:
    """Composite the layers of some rows at one sample, (R, W, 4) linear."""
    depths = np.array(band.transparent.shape[1:2])
    for part in split_rows(len(linear), MAX_LAYERED_ROWS):
        images = [*band.transparent[0, :, part], band.opaque[0, part]]
        first, target = band.first_row + part.start, linear[part]
        composite_faces(IMMEDIATE, shader, images, first, depths, target, memory)


def resolve_areas(
    rows: tuple[int, int],
    lists: PartitionedLists,
    shader: Shader,
    target: ColorRows,
    memory: Memory,
) -> None:
    """Resolve one row of tiles of opaque faces by exact area coverage."""
    faces, shares, rest = fragment_bands.find_areas(rows, lists, shader.finder, memory)
    mixed = memory.empty((len(rest), 4, rest.shape[1]), np.float32)
    mixed[:] = shader.make_background_rows(IMMEDIATE, rest.shape, rows[0], memory).transpose(
        0, 2, 1
    )
    shader.shading.resolve(faces, rows[0], shares, rest, mixed, shader.has_codes)
    write_resolved(IMMEDIATE, shader, shares[0], rest, mixed, target)


def resolve_opaque(band: Band, shader: Shader, target: ColorRows, memory: Memory) -> None:
    """Resolve some rows of opaque faces at several samples."""
    max_rows = max(MAX_OPAQUE_ROWS, MAX_OPAQUE_PIXELS // band.opaque.shape[2])
    for part in split_rows(len(target.color), max_rows):
        part_target = ColorRows(target.linear[part], target.color[part])
        rows = part.start, part.start + len(part_target.color)
        resolve_samples(IMMEDIATE, shader, band.opaque, rows, band.first_row, part_target, memory)


def resolve_samples(
    calls: AnyCalls, shader: Shader, opaque: NDArray[np.int32], rows: tuple[int, int],
    first_row: int, target: ColorRows, memory: AnyMemory,
) -> None:  # fmt: skip
    """
    Write the colour of some rows of opaque faces at several samples.

    Parameters
    ----------
    calls : AnyCalls
    shader : Shader
    opaque : (N, B, W) int32
        The faces at each sample of some rows.
    rows : (int, int)
        The first of these that is resolved, and one past the last.
    first_row : int
        Row of the frame of the first row of ``opaque``.
    target : ColorRows
        Written.
    memory : Memory
    """
    (samples, _, width), height = opaque.shape, rows[1] - rows[0]
    shape, first = (samples, height, width), first_row + rows[0]
    shown, shares = memory.empty(shape, np.int32), memory.empty(shape, np.float32)
    rest, mixed = memory.empty(shape[1:], np.float32), memory.empty((height, 4, width), np.float32)
    scratch = memory.empty((2, coverage_resolve.COLUMNS_PER_BLOCK), np.int32)
    behind = shader.make_background_rows(calls, shape[1:], first, memory)
    coverage = CoverageArguments(opaque, rows, shown, shares, rest, scratch)
    calls.resolve(shader.shading, first, coverage, behind, mixed, shader.has_codes)
    write_resolved(calls, shader, shares[0], rest, mixed, target)


def write_resolved(
    calls: AnyCalls, shader: Shader, shares: NDArray[np.float32], rest: NDArray[np.float32],
    mixed: NDArray[np.float32], target: ColorRows,
) -> None:  # fmt: skip
    """Write the colour of resolved rows; see ``coverage_resolve.finish_light``."""
    if shader.has_codes:
        calls.call(coverage_resolve.finish_codes, shares, rest, mixed, target.color)
    else:
        table = srgb_encoding.make_encoding_table(shader.encoding)
        calls.call(coverage_resolve.finish_light, shares, rest, mixed, table, *target)


def resolve_layered_samples(
    band: Band, shader: Shader, linear: NDArray[np.float32], memory: Memory
) -> None:
    """Resolve the layers of some rows at several samples, (R, W, 4) linear."""
    samples, levels, _, width = band.transparent.shape
    # Per layer and pixel: a face number and a colour.
    per_row = samples * (levels + 1) * width * (4 + 16)
    max_rows = min(max(fragment_bands.MAX_BYTES // 16 // per_row, 1), MAX_LAYERED_ROWS)
    for part in split_rows(len(linear), max_rows):
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
        shader.draw_background(IMMEDIATE, nothing, first, behind, empty_color(behind))
        compositing.mix_samples(opaque, transparent, colors, behind, target)


def resolves_and_encodes_at_once(layers: PixelLayers, has_tone_mapping: bool) -> bool:
    """Tell whether one kernel resolves and encodes: opaque faces, no effects in between."""
    return layers.samples != 1 and not layers.has_blended and not has_tone_mapping


def kernels_of(plan: RenderPlan) -> Rows:
    """Return the kernels that `shade` and `shade_codes` call, without stages."""
    layers = plan.layers
    if layers is None:
        return []
    rows, kernels = shared_kernels(plan, layers), []
    has_samples, codes = layers.samples != 1, layers.blends_srgb8
    if layers.has_blended and codes:
        kernels = [srgb_compositing.mark_hidden, srgb_compositing.composite_codes]
        if has_samples:
            kernels = [compositing.list_faces, srgb_compositing.mix_codes]
        if layers.in_order:
            kernels = [drawing_order.drop_hidden, *kernels]
    elif layers.has_blended:
        kernels = [compositing.start_sums, compositing.composite_under, compositing.finish_sums]
        kernels += [compositing.list_faces, compositing.mix_samples] * has_samples
    rows += rows_where(WHERE_SEVERAL_FACES, *kernels)
    if codes:
        return rows + [KernelRow(srgb_compositing.decode_rows)] * ("linear" in plan.outputs)
    rows += plan.kernels_at("mixed")
    if "color" in plan.outputs and not resolves_and_encodes_at_once(
        layers, bool(plan.effects_at("mixed"))
    ):
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
    finish = coverage_resolve.finish_codes if layers.blends_srgb8 else coverage_resolve.finish_light
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
    Shade a frame whose pixels show several faces, in front of or beside each other.

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
    shader, tone_mapping = split_tone_mapping(
        fragment_bands.make_sampled_finder(shader, plan.samples)
    )
    viewport = shader.geometry.viewport
    lists = fragment_bands.split_tile_lists(coverage, viewport, plan.is_blended, workers)
    shader, table = shader.prepare_stages(), srgb_encoding.make_encoding_table(shader.encoding)
    nothing = np.empty((viewport.height, 0), np.uint32)
    packed = nothing if color is None else color.view(np.uint32)[:, :, 0]
    at_once = resolves_and_encodes_at_once(plan, tone_mapping is not None)

    def shade_tiles(first: int, last: int) -> None:
        shape = last - first, viewport.width * (linear is not None or not at_once), 4
        rows = workers.memory.empty(shape, np.float32) if linear is None else linear[first:last]
        target = ColorRows(rows, (packed if at_once else nothing)[first:last])
        shade_rows((first, last), plan, lists, shader, target, workers.memory)
        if not at_once:
            shown = packed[first:last]
            tone_map_and_encode(
                IMMEDIATE, tone_mapping, table, ColorRows(rows, shown), first, workers.memory
            )

    workers.run(shade_tiles, split_range(viewport.height, TILE_SIZE))


def tone_map_and_encode(
    calls: AnyCalls, tone_mapping: LateToneMapping | None, table: NDArray[np.int32],
    rows: ColorRows, first_row: int, memory: AnyMemory,
) -> None:  # fmt: skip
    """Tone map some rows, if required, and encode them, if codes are requested."""
    if rows.color.shape[1]:
        linear = rows.linear
        if tone_mapping is not None:
            linear = tone_mapping.apply(calls, linear, first_row, memory)
        calls.call(srgb_encoding.encode_rows, linear, table, rows.color)


def shade_rows(
    rows: tuple[int, int],
    plan: PixelLayers,
    lists: PartitionedLists,
    shader: Shader,
    target: ColorRows,
    memory: Memory,
) -> None:
    """Write the colours of one row of tiles: codes, linear, or both if all faces are opaque."""
    if plan.samples == "area":
        resolve_areas(rows, lists, shader, target, memory)
        return
    for band in fragment_bands.find_layers(
        rows, lists, int(plan.samples), shader.finder, memory, plan.most
    ):
        start, levels = band.first_row - rows[0], band.transparent.shape[1]
        rows_of_band = slice(start, start + band.opaque.shape[1])
        part = ColorRows(target.linear[rows_of_band], target.color[rows_of_band])
        if plan.in_order and levels > 1:
            drawing_order.drop_hidden(band.transparent)
        if plan.samples != 1 and shader.constant_codes is not None:
            starts = shader.placement.face_starts
            constant_colors.average_codes(band.opaque, *shader.constant_codes, starts, part.color)
        elif plan.samples != 1 and levels == 0:
            resolve_opaque(band, shader, part, memory)
        elif shader.has_codes:
            resolve_codes = composite_codes if plan.samples == 1 else resolve_code_samples
            resolve_codes(band, shader, part.color, memory)
        else:
            resolve = composite_layers if plan.samples == 1 else resolve_layered_samples
            resolve(band, shader, part.linear, memory)


def max_rows_at_once(images: int, width: int) -> int:
    """Return the most rows of so many images of codes that are held at once."""
    per_row = images * width * BYTES_PER_CODE
    return min(max(fragment_bands.MAX_BYTES // 16 // per_row, 1), MAX_LAYERED_ROWS)


def composite_codes(band: Band, shader: Shader, color: NDArray[np.uint32], memory: Memory) -> None:
    """Composite the layers of some rows at one sample, (R, W) codes."""
    levels, width = band.transparent.shape[1], color.shape[1]
    for part in split_rows(len(color), max_rows_at_once(levels + 1, width)):
        first, target = band.first_row + part.start, color[part]
        images = [*band.transparent[0, :, part], band.opaque[0, part]]
        if levels == 0:
            shader.write_codes_over_background(images[0], first, target)
            continue
        stack = memory.empty((levels + 1, *target.shape), np.uint32)
        # Front to back: nothing is shaded behind opaque layers.
        for level in range(levels):
            shader.write_codes(images[level], first, stack[level])
            srgb_compositing.mark_hidden(stack, level, images[level + 1])
        shader.write_codes_over_background(images[levels], first, stack[levels])
        srgb_compositing.composite_codes(stack, target)


def resolve_code_samples(
    band: Band, shader: Shader, color: NDArray[np.uint32], memory: Memory
) -> None:
    """Resolve the layers of some rows at several samples, (R, W) codes."""
    samples, levels, _, width = band.transparent.shape
    capacity = samples * (levels + 1)
    # Per layer and pixel: a face number and a code.
    for part in split_rows(len(color), max_rows_at_once(2 * capacity, width)):
        first, target = band.first_row + part.start, color[part]
        opaque = np.ascontiguousarray(band.opaque[:, part])
        transparent = np.ascontiguousarray(band.transparent[:, :, part])
        shown = memory.empty((capacity, *target.shape), np.int32)
        count = int(compositing.list_faces(opaque, transparent, shown))
        colors = memory.empty((count, *target.shape), np.uint32)
        behind = memory.empty(target.shape, np.uint32)
        if count > 0:
            shader.write_codes(shown[:count], first, colors)
        shader.write_background_codes(first, behind)
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
    Shade a frame as `shade` does, but blend codes.

    Raises
    ------
    ValueError
        If a pixel has more visible layers than are sorted.
    """
    shader = shader._replace(has_codes=True)
    if shader.constant_codes is not None:
        shader = fragment_bands.make_sampled_finder(shader, plan.samples)
    elif plan.at_centers:
        shader = fragment_bands.make_sampled_finder(shader.prepare_stages(), plan.samples)
    else:
        shader = fragment_bands.make_sampled_finder(shader, plan.samples).prepare_stages()
    viewport = shader.geometry.viewport
    lists = fragment_bands.split_tile_lists(coverage, viewport, plan.is_blended, workers)
    packed = None if color is None else color.view(np.uint32)[:, :, 0]
    light = decode_codes(shader.encoding).copy()

    def code_tiles(first: int, last: int) -> None:
        if packed is None:
            rows = workers.memory.empty((last - first, viewport.width), np.uint32)
        else:
            rows = packed[first:last]
        target = ColorRows(empty_linear(rows), rows)
        shade_rows((first, last), plan, lists, shader, target, workers.memory)
        if linear is not None:
            srgb_compositing.decode_rows(rows, light, linear[first:last])

    workers.run(code_tiles, split_range(viewport.height, TILE_SIZE))
