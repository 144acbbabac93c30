"""
Shade a frame whose pixels show more than one face, and put their colours together.

Each thread works on a band, rows of one row of tiles: it finds the layers, images of face numbers,
shades one after the other as any frame, and lays them over each other. So each thread needs memory
for the layers of one band only. A band whose layers take more than ``MOST_BYTES`` is cut into bands
with fewer rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import encode
from rasterjit.pipeline.fragments import bands, compositing, weights
from rasterjit.pipeline.fragments.bands import (
    MOST_BYTES,
    Band,
    Lists,
    at_samples,
    find_areas,
    find_layers,
    part_lists,
)
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.passes import KernelRow, Rows, ShadingNeeds, rows_where
from rasterjit.pipeline.records import (
    AlphaTests,
    Geometry,
    Imitated,
    Lighting,
    Placement,
    Surface,
)
from rasterjit.pipeline.visibility.draw import Coverage
from rasterjit.rendering.shading import Shading
from rasterjit.runtime.threads import Kept, Memory, Workers
from rasterjit.survey.blending import PixelLayers
from rasterjit.survey.effect import Active, acting, shown_as_given
from rasterjit.survey.plan import RenderPlan

ROWS_AT_ONCE = 16
"""Rows of a band that are shaded and put together at once: their colours stay in L2."""

ROWS_MIXED_AT_ONCE = 32
"""Rows of opaque faces at once: few of their pixels show more than one or two faces."""

PIXELS_MIXED_AT_ONCE = 1 << 14
"""Pixels of them in pictures that are so narrow that these are more rows."""

SEVERAL = "a pixel shows several faces"
"""When kernels that lay faces over each other are called."""


class Shader(NamedTuple):
    """Everything needed to shade an image of face numbers."""

    needs: ShadingNeeds
    geometry: Geometry
    placement: Placement
    surface: Surface
    lighting: Lighting | None
    background: NDArray[np.float32]
    """(4,) linear."""
    effects: tuple[Active, ...] = ()
    alpha_tests: AlphaTests | None = None
    """The objects that have holes."""
    has_codes: bool = False
    """Whether colours become codes before they are mixed; else light is mixed."""
    encoding: encode.Encoding = "srgb"
    """What codes show."""
    plain: tuple[NDArray[np.uint32], int] | None = None
    """The codes of each object, (O,), and of what is behind, where they follow from these alone."""
    shading: Shading | None = None
    """The stages, made by `ready` when nothing above changes any more."""

    def of_plain_codes(self) -> Shader:
        """Return this shader for objects of one colour each, before one that is opaque."""
        red, green, blue = encode.codes_of(self.surface.materials[:, :3], self.encoding).T
        codes = red | green << 8 | blue << 16 | np.uint32(255 << 24)
        return self._replace(plain=(codes, encode.code_of(self.background, self.encoding)))

    def ready(self, kept: Kept | None = None) -> Shader:
        """Return this shader with its stages made, or with those of the picture before."""
        read = self.needs, self.geometry, self.placement, self.surface, self.lighting, self.effects
        encoding, background = self.encoding, self.background
        if kept is None or not kept.lasts:
            return self._replace(shading=Shading(*read, encoding, background))
        lighting, viewer = self.lighting, self.placement.toward_viewer
        if lighting is not None:
            # Lights lie relative to the eye.
            lighting = lighting._replace(
                lights=kept.copied("light rows", lighting.lights),
                ambient=kept.copied("light from all around", lighting.ambient),
                imitated=_kept_imitated(lighting.imitated, kept),
            )
        shading = kept.made(
            "stages", Shading, *read[:4], lighting, self.effects, encoding,
            kept.made("color behind", _color_of, background.tobytes()),
            kept.copied("viewer", viewer, np.float32),
        )  # fmt: skip
        return self._replace(shading=shading)

    def shade(self, faces: NDArray[np.int32], first_row: int, linear: NDArray[np.float32]) -> None:
        """Write the linear colour of faces, (R, W) or (J, R, W), alone, as if in front of all."""
        self.shading.shade(faces, first_row, linear, np.empty((*linear.shape[:-2], 0), np.uint32))

    def shade_last(
        self, faces: NDArray[np.int32], first_row: int, linear: NDArray[np.float32]
    ) -> None:
        """Write that of an image of faces, (R, W), and what is seen where no face is."""
        self.shade(faces, first_row, linear)
        self.show_behind(faces, first_row, linear, np.empty((len(linear), 0), np.uint32))

    @property
    def has_behind(self) -> bool:
        """Whether the background is more than one colour."""
        return bool(acting(self.effects, "background"))

    def show_behind(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> None:
        """Write what is seen where no face is, if it is not a colour."""
        for one in acting(self.effects, "background"):
            one.at("background", faces, first_row, linear, color)

    def backdrop(
        self, shape: tuple[int, int], first_row: int, memory: Memory
    ) -> NDArray[np.float32]:
        """Return what is seen behind all faces of some rows, (R, 4, W), or (1, 4, W) if alike."""
        height, width = shape
        if self.has_codes:
            return self._coded_backdrop(shape, first_row, memory)
        if not self.has_behind:
            return np.repeat(self.background, width).reshape(1, 4, width)
        linear = memory.empty((*shape, 4), np.float32)
        nothing = np.full((height, width), -1, np.int32)
        no_color = np.empty((height, 0), np.uint32)
        self.show_behind(nothing, first_row, linear, no_color)
        return np.ascontiguousarray(linear.transpose(0, 2, 1))

    def _coded_backdrop(
        self, shape: tuple[int, int], first_row: int, memory: Memory
    ) -> NDArray[np.float32]:
        """Return the same in codes, 0..255, as float32; alpha is divided by 255."""
        color = memory.empty(shape if self.has_behind else (1, shape[1]), np.uint32)
        self.code_backdrop(first_row, color)
        codes = color.view(np.uint8).reshape(*color.shape, 4).transpose(0, 2, 1)
        codes = np.ascontiguousarray(codes, np.float32)
        codes[:, 3] /= np.float32(255.0)
        return codes

    def code_backdrop(self, first_row: int, color: NDArray[np.uint32]) -> None:
        """Write what is seen behind all faces of some rows, (R, W), in RGBA codes."""
        color[:] = encode.code_of(self.background, self.encoding)
        nothing = np.full(color.shape, -1, np.int32)
        self.show_behind(nothing, first_row, _no_linear(color), color)

    def code(self, faces: NDArray[np.int32], first_row: int, color: NDArray[np.uint32]) -> None:
        """Write faces, (R, W) or (J, R, W), alone, in RGBA codes; 0 where no face is."""
        nothing = np.zeros(4, np.float32), 0
        self.shading.shade(faces, first_row, _no_linear(color), color, nothing)

    def code_last(
        self, faces: NDArray[np.int32], first_row: int, color: NDArray[np.uint32]
    ) -> None:
        """Write an image of faces, (R, W), and what is seen behind all where no face is."""
        self.shading.shade(faces, first_row, _no_linear(color), color)
        self.show_behind(faces, first_row, _no_linear(color), color)


def _kept_imitated(imitated: Imitated | None, kept: Kept) -> Imitated | None:
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
    taken = kept.copied("who takes what", imitated.taken)
    own = taken, faces_viewer, are_squares, gains
    return kept.made("imitated", Imitated, *own, imitated.maps)


def _no_linear(color: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return an empty array in place of linear colour that is not wanted, for pixels (..., W)."""
    return np.empty((*color.shape[:-1], 0, 4), np.float32)


def _color_of(numbers: bytes) -> NDArray[np.float32]:
    """Return a colour, (4,), given its bytes."""
    return np.frombuffer(numbers, np.float32).copy()


class ColorRows(NamedTuple):
    """Some rows of the colour outputs; an output that is not wanted is empty."""

    linear: NDArray[np.float32]
    """(R, W, 4), or (R, 0, 4)."""
    color: NDArray[np.uint32]
    """(R, W), or (R, 0)."""


def parts_of(height: int, most: int) -> list[slice]:
    """Return the parts of some rows that are shaded and put together at once."""
    return [slice(first, first + most) for first in range(0, height, most)]


def lay_layers(band: Band, shader: Shader, linear: NDArray[np.float32], memory: Memory) -> None:
    """Write the linear colour of some rows, (R, W, 4), one sample each: layers over each other."""
    for part in parts_of(len(linear), ROWS_AT_ONCE):
        first, target = band.first_row + part.start, linear[part]
        images = [*band.transparent[0, :, part], band.opaque[0, part]]
        if len(images) == 1:
            shader.shade_last(images[0], first, target)
            continue
        colors, sums = (memory.empty(target.shape, np.float32) for _ in range(2))
        compositing.start_sums(sums)
        for faces, behind in pairwise(images):
            shader.shade(faces, first, colors)
            compositing.lay_under(colors, faces, behind, sums)
        shader.shade_last(images[-1], first, target)
        compositing.finish_sums(sums, target)


def mix_areas(
    rows: tuple[int, int], lists: Lists, shader: Shader, target: ColorRows, memory: Memory
) -> None:
    """Write the colour of one row of tiles by the areas of opaque faces."""
    mix_faces(rows[0], find_areas(rows, lists, shader, memory), shader, target, memory)


def mix_opaque(band: Band, shader: Shader, target: ColorRows, memory: Memory) -> None:
    """Write the colour of some rows of opaque faces at several samples."""
    most = max(ROWS_MIXED_AT_ONCE, PIXELS_MIXED_AT_ONCE // band.opaque.shape[2])
    for part in parts_of(len(target.color), most):
        some = ColorRows(*(image[part] for image in target))
        rows = part.start, part.start + len(some.color)
        found = share_faces(band.opaque, rows, memory)
        mix_faces(band.first_row + part.start, found, shader, some, memory)


def share_faces(
    opaque: NDArray[np.int32], rows: tuple[int, int], memory: Memory
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """Return the faces that the samples of some rows show, their shares, and that of no face."""
    shape = len(opaque), rows[1] - rows[0], opaque.shape[2]
    shown, shares = memory.empty(shape, np.int32), memory.empty(shape, np.float32)
    rest = memory.empty(shape[1:], np.float32)
    others = np.empty((2, weights.BLOCK_COLUMNS), np.int32)
    count = int(weights.share_samples(opaque, rows, shown, shares, rest, others))
    return shown[:count], shares, rest


def mix_faces(
    first_row: int,
    found: tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]],
    shader: Shader,
    target: ColorRows,
    memory: Memory,
) -> None:
    """Write the colour of some rows whose pixels show shares of several opaque faces."""
    faces, shares, rest = found
    mixed = memory.empty((len(rest), 4, rest.shape[1]), np.float32)
    mixed[:] = shader.backdrop(rest.shape, first_row, memory)
    shader.shading.mix(faces, first_row, shares, rest, mixed, shader.has_codes)
    if shader.has_codes:
        weights.finish_codes(shares[0], rest, mixed, target.color)
    else:
        weights.finish_mix(shares[0], rest, mixed, encode.encoding_table(shader.encoding), *target)


def mix_layers(band: Band, shader: Shader, linear: NDArray[np.float32], memory: Memory) -> None:
    """Write the linear colour of some rows, (R, W, 4), of layers at several samples."""
    samples, levels, _, width = band.transparent.shape
    # What is known of one face in one pixel: its number and its colour.
    per_row = samples * (levels + 1) * width * (4 + 16)
    rows = min(max(MOST_BYTES // 16 // per_row, 1), ROWS_AT_ONCE)
    for part in parts_of(len(linear), rows):
        first, target = band.first_row + part.start, linear[part]
        opaque = np.ascontiguousarray(band.opaque[:, part])
        transparent = np.ascontiguousarray(band.transparent[:, :, part])
        shown = memory.empty((samples * (levels + 1), *target.shape[:2]), np.int32)
        count = int(compositing.list_faces(opaque, transparent, shown))
        colors = memory.empty((count, *target.shape), np.float32)
        behind = memory.empty(target.shape, np.float32)
        if count > 0:
            shader.shade(shown[:count], first, colors)
        shader.shade_last(np.full(target.shape[:2], -1, np.int32), first, behind)
        compositing.mix_samples(opaque, transparent, colors, behind, target)


def is_direct(layers: PixelLayers, has_mixed: bool) -> bool:
    """Return whether faces are mixed and encoded at once: opaque ones, shown as they are."""
    return layers.samples != 1 and not layers.has_blended and not has_mixed


def kernels_of(plan: RenderPlan) -> Rows:
    """Return the kernels that `shade` calls besides stages."""
    layers, rows, kernels = plan.layers, shared_kernels(plan), []
    if layers.has_blended:
        kernels += [compositing.start_sums, compositing.lay_under, compositing.finish_sums]
        kernels += [compositing.list_faces, compositing.mix_samples] if layers.samples != 1 else []
    rows += rows_where(SEVERAL, *kernels)
    rows += plan.kernels_at("mixed")
    if "color" in plan.outputs and not is_direct(layers, bool(plan.at("mixed"))):
        rows.append(KernelRow(encode.encode_rows))
    return rows


def shared_kernels(plan: RenderPlan) -> Rows:
    """Return the kernels that find what pixels show and mix what is opaque, in light or codes."""
    layers = plan.layers
    rows = bands.kernels_of(layers.samples, plan.depth_format.kind)
    if layers.samples == 1:
        return rows
    if plan.mixes_plain_codes:
        from rasterjit.pipeline.fragments import plain_codes

        return [*rows, KernelRow(plain_codes.mix_plain_codes)]
    opaque = "a row of tiles is opaque" if layers.has_blended else ""
    if layers.samples != "area":
        rows.append(KernelRow(weights.share_samples, "", opaque))
    finish = weights.finish_codes if layers.mixes_codes else weights.finish_mix
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
    behind, mixed = shader.background, acting(shader.effects, "mixed")
    shader = at_samples(shader, plan.samples)
    viewport = shader.geometry.viewport
    lists = part_lists(coverage, viewport, plan.is_blended, workers)
    given = [one for one in shader.effects if shown_as_given(one.effect)] if mixed else []
    if mixed:
        # Where tones are mapped the background, which is shown as given, comes behind at the end.
        toned = tuple(one for one in shader.effects if not shown_as_given(one.effect))
        shader = shader._replace(background=np.zeros(4, np.float32), effects=toned)
    shader = shader.ready()

    nothing = np.empty((viewport.height, 0), np.uint32)
    packed = nothing if color is None else color.view(np.uint32)[:, :, 0]
    at_once = is_direct(plan, bool(mixed))

    def shade_tiles(first: int) -> None:
        last = min(first + TILE_SIZE, viewport.height)
        shape = last - first, viewport.width * (linear is not None or not at_once), 4
        rows = workers.memory.empty(shape, np.float32) if linear is None else linear[first:last]
        target = ColorRows(rows, (packed if at_once else nothing)[first:last])
        shade_rows((first, last), plan, lists, shader, target, workers.memory)
        if mixed:
            shown = workers.memory.empty(shape, np.float32)
            given_rows = behind_rows(behind, given, first, rows.shape, workers.memory)
            mixed[0].at("mixed", rows, given_rows, shown)
            rows = shown
        if color is not None and not at_once:
            encode.encode_rows(rows, encode.encoding_table(shader.encoding), packed[first:last])

    workers.run(shade_tiles, [(first,) for first in range(0, viewport.height, TILE_SIZE)])


def behind_rows(
    color: NDArray[np.float32],
    given: Sequence[Active],
    first_row: int,
    shape: tuple[int, ...],
    memory: Memory,
) -> NDArray[np.float32]:
    """
    Return what is shown as given behind rows of mixed faces.

    Parameters
    ----------
    color : (4,) float32, linear
    given : sequence of Active
        Effects that show something else there; see `shown_as_given`.
    first_row : int
    shape : (int, int, 4)
        Of the rows.
    memory : Memory

    Returns
    -------
    (4,) or (R, W, 4) float32, linear
    """
    if not given:
        return color
    linear = memory.empty(shape, np.float32)
    nothing = np.full(shape[:2], -1, np.int32)
    for one in given:
        one.at("background", nothing, first_row, linear, np.empty((shape[0], 0), np.uint32))
    return linear


def shade_rows(
    rows: tuple[int, int],
    plan: PixelLayers,
    lists: Lists,
    shader: Shader,
    target: ColorRows,
    memory: Memory,
) -> None:
    """Write the linear colour of one row of tiles; encoded as well if none is see-through."""
    if plan.samples == "area":
        mix_areas(rows, lists, shader, target, memory)
        return
    for band in find_layers(rows, lists, int(plan.samples), shader, memory, plan.most):
        start = band.first_row - rows[0]
        part = ColorRows(*(image[start : start + band.opaque.shape[1]] for image in target))
        if plan.samples == 1:
            lay_layers(band, shader, part.linear, memory)
        elif band.transparent.shape[1] == 0:
            mix_opaque(band, shader, part, memory)
        else:
            mix_layers(band, shader, part.linear, memory)
