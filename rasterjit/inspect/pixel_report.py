"""Define the explanation of a pixel that `explain_pixel` returns, and print it as tables."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.notebook_preview import TextReport

if TYPE_CHECKING:
    from fractions import Fraction

    from rich.table import Table

PAGE_WIDTH = 160
"""Largest width of the tables, columns; most need fewer than 100."""

MAX_FACES = 12
"""Most faces that the table lists."""

SIGNIFICANT_DIGITS = 6
"""Significant digits of the largest coordinate in a table."""

MIN_PIXEL_DECIMALS = 4
"""Least decimals of pixels, to show a step of the finest grid, 1/4096 pixel."""

MIN_DEPTH_DECIMALS = 9
"""Least decimals of stored depth, to tell neighbouring float32 numbers in 0.03..1 apart."""

MIN_FIXED, MAX_FIXED = 1e-3, 1e6
"""Limits of the largest coordinate that is printed without a power of ten."""

NOT_DRAWN = ("culled", "cut out")
"""Standings of faces that are not drawn at a pixel."""

SEEN_THROUGH, SEEN_BESIDE = "seen through the above", "seen beside the above"
"""Standings of further visible faces."""

MIN_LISTED_LIGHT = 5e-6
"""Least light in the table: less would print as zero."""


NEAREST_ONLY_KINDS = ("disc", "sphere")
"""Kinds of points of which only the nearest is found."""


@dataclass(frozen=True, eq=False)
class PrimitiveAtPixel:
    """Position and size of a point or a segment in the picture."""

    kind: str
    """``"square"``, ``"disc"``, ``"sphere"`` or ``"segment"``."""
    place: NDArray[np.float64]
    """(2,), pixels, before snapping: the centre of a point, or what of a segment is nearest to the
    pixel's centre; NaN if it is not in front of the eye."""
    size: NDArray[np.float64]
    """(2,), pixels, before snapping, across and down: of a point, of a sphere at the depth of its
    centre; or the width of a segment, twice, at the place."""
    offset: NDArray[np.float64]
    """(2,), pixels, to the right and down: from the place to the pixel's centre."""


@dataclass(frozen=True, eq=False)
class FaceAtPixel:
    """One face that covers the pixel's centre, with its numbers in every space."""

    standing: str
    """``"visible"``, ``"seen through the above"`` (all faces before it are transparent),
    ``"seen beside the above"`` (at other samples of the pixel), ``"hidden"``, ``"tied"`` (as near,
    but with a higher number), ``"culled"``, or ``"cut out"`` (alpha is below the cutoff of its
    mask)."""
    face: int
    """As ``Frame.face_id`` counts, through all objects."""
    object_number: int
    object_name: str
    mesh_face: int
    """Row of ``Mesh.faces``; -1 of the cap of a section."""
    mesh_vertices: tuple[int, int, int]
    """Rows of ``Mesh.vertices``: the face's three vertices; -1 of those that a section made. All
    arrays below are in their order."""
    model: NDArray[np.float64]
    """(3, 3), model space, scene units."""
    world: NDArray[np.float64]
    """(3, 3), world space, scene units."""
    view: NDArray[np.float64]
    """(3, 3), view space, scene units: the camera looks down its -z."""
    clip: NDArray[np.float64]
    """(3, 4), clip space."""
    ndc: NDArray[np.float64]
    """(3, 3), -1..1 in the view volume; NaN for a vertex that is not in front of the eye."""
    screen: NDArray[np.float64]
    """(3, 2), pixels, before snapping; NaN as in ``ndc``."""
    outcodes: tuple[tuple[str, ...], ...]
    """For each vertex, what it lies outside of: left, right, bottom, top, near, far, guard."""
    clipped: bool
    """Whether the face was cut, so that pieces of it were drawn."""
    snapped: NDArray[np.int64]
    """(3, 2), whole steps of 2**-grid_bits pixel: the vertices of the triangle that was drawn, the
    face itself or the piece of it that holds the pixel."""
    grid_bits: int
    """Steps of the grid in a pixel, as a power of two."""
    edges: tuple[int, int, int]
    """Exact edge functions of that triangle opposite its vertices at the pixel's centre, square
    steps of the grid, turned so that they are positive inside."""
    biases: tuple[int, int, int]
    """0 on a top or left edge, else -1: the centre is covered where every edge + bias is >= 0."""
    affine_weights: tuple[Fraction, Fraction, Fraction]
    """Exact weights of that triangle's vertices, linear on the screen; depth is mixed by them."""
    weights: tuple[Fraction, Fraction, Fraction]
    """Exact perspective-correct weights of the face's own vertices; colours, normals and all else
    are mixed by them."""
    stored_depth: float
    """As the depth test compared it, float32, no unit; greater is nearer."""
    depth: float
    """Scene units along the viewing axis, as ``Frame.depth`` holds it."""
    alpha: float | None = None
    """Share of what lies behind that the face covers, 0..1; None if the pixel shows one face."""
    primitive: PrimitiveAtPixel | None = None
    """Of a point or a segment, which is drawn as pieces: ``clipped`` is true, and ``snapped``,
    ``edges``, ``biases`` and ``affine_weights`` are those of a piece, or, of discs and spheres,
    which have none, say nothing."""

    @property
    def position(self) -> list[float]:
        """Position at the pixel's centre: x, y and z, world space, scene units."""
        return [
            sum(float(w) * v for w, v in zip(self.weights, self.world[:, k].tolist(), strict=True))
            for k in range(3)
        ]

    @property
    def kind(self) -> str:
        """``"face"``, or the kind of the point or segment."""
        return "face" if self.primitive is None else self.primitive.kind

    @property
    def distinct(self) -> int:
        """Number of different vertices: three, of a segment two, of a point one."""
        return 3 if self.primitive is None else 2 if self.kind == "segment" else 1


@dataclass(frozen=True, eq=False)
class LightTerm:
    """Light that one light, or an effect, adds to the colour of the visible face."""

    name: str
    """Kind of light and its number in ``Scene.lights``, ``"headlight"``, or of an effect, such as
    ``"environment"`` or ``"fog"`` (which takes light away as well)."""
    diffuse: NDArray[np.float32]
    """(3,), linear red, green, blue; the sum with specular where they are not told apart."""
    specular: NDArray[np.float32]
    """(3,), linear red, green, blue."""
    is_of_effect: bool = False
    """Whether an effect adds it."""
    is_told_apart: bool = True
    """Whether diffuse and specular are told apart: not for effects, nor for lights of pyrender's
    shader."""

    @property
    def label(self) -> str:
        """Label of ``diffuse`` in the table."""
        return f"{self.name}, diffuse" if self.is_told_apart else self.name


@dataclass(frozen=True, eq=False)
class LightTerms:
    """Terms that add up to the colour of the visible face."""

    shading: str
    """Shading model of the object's material."""
    base_color: NDArray[np.float32]
    """(3,), linear: material times vertex or face colour times texture."""
    texture: NDArray[np.float32] | None
    """(3,), linear: colour of the texture here; None if the material has none."""
    uv: NDArray[np.float32]
    """(2,): texture coordinates; NaN if the material has no texture."""
    ambient: NDArray[np.float32]
    """(3,), linear: ambient light on the base colour; zero if the material is unlit."""
    lights: tuple[LightTerm, ...]
    """Empty if the material is unlit."""
    emission: NDArray[np.float32]
    """(3,), linear: light that the surface emits."""
    scalar: float | None = None
    """The mesh's scalar here, as ``Frame.scalar`` has it: NaN where a corner of the face is; None
    if the mesh has none."""
    scalar_color: NDArray[np.float32] | None = None
    """(3,), linear: its colour in the colour map, or that of the contour here."""


@dataclass(frozen=True, eq=False)
class ColorPart:
    """Colour that one face, or the background, adds to a pixel that shows several."""

    name: str
    """The face and its object, ``"background"`` or ``"environment"``; or what else the colour
    differs by, where it is no sum of light."""
    face: int | None
    """As ``Frame.face_id`` counts; None for what lies behind all."""
    alpha: float
    """Share of what lies behind that it covers, 0..1."""
    share: float
    """Share of its own colour in that of the pixel, 0..1: its alpha, times what comes through those
    before it, times the part of the pixel that shows it."""
    color: NDArray[np.float32]
    """(3,), linear red, green, blue: its colour times the share."""


@dataclass(frozen=True, eq=False, repr=False)
class PixelExplanation(TextReport):
    """Faces and colour of one pixel, stage by stage; prints as tables."""

    x: int
    """Column, from the left."""
    y: int
    """Row, from the top."""
    size: tuple[int, int]
    """Width and height of the image, pixels."""
    faces: tuple[FaceAtPixel, ...]
    """Every face that covers the pixel's centre: the visible one, those behind it from near to far,
    of which some may be seen, then culled ones and ones with a hole there."""
    reasons: tuple[str, ...]
    """Why no face is visible; empty if one is."""
    light: LightTerms | None
    """Of the visible face; None if there is none, or faces are not drawn."""
    parts: tuple[ColorPart, ...]
    """What ``linear`` is mixed from, the visible face first, where more is seen than that face:
    through it, or at other samples. They add up to ``linear``. Else empty, and ``light`` does."""
    linear: NDArray[np.float32]
    """(4,), linear red, green, blue and alpha, before rounding."""
    color: NDArray[np.uint8]
    """(4,), the pixel of ``Frame.color``: sRGB red, green, blue, and alpha."""
    under_wireframe: bool
    """Whether an edge of the wireframe was drawn over ``linear``."""

    @property
    def winner(self) -> FaceAtPixel | None:
        """The visible face; None where the background shows."""
        return self.faces[0] if self.faces and self.faces[0].standing not in NOT_DRAWN else None

    def __str__(self) -> str:
        tables: list[Any] = [_format_heading(self)]
        if self.faces:
            tables.append(_make_face_table(self))
        if self.winner is not None:
            tables.append(_make_position_table(self.winner))
            if self.winner.primitive is None:
                tables.append(_make_edge_table(self.winner))
                tables += [_make_weight_table(self.winner)] if self.winner.clipped else []
        tables.append(_make_color_table(self))
        return _print_as_text(tables)


def _format_heading(pixel: PixelExplanation) -> str:
    """Return lines on the pixel and its visible face."""
    width, height = pixel.size
    lines = [
        f"pixel ({pixel.x}, {pixel.y}) of {width} x {height}, sampled at its centre "
        f"({pixel.x + 0.5}, {pixel.y + 0.5})"
    ]
    face = pixel.winner
    if face is None:
        return "\n".join(lines + ["shows the background:"] + [f"- {r}" for r in pixel.reasons])
    if pixel.light is None:
        here = "one of its lines is" if pixel.under_wireframe else "the background is seen"
        lines.append(f"only the wireframe is drawn, and {here} here; of the faces,")
    shows = "shows" if pixel.light else "the nearest is"
    lines.append(
        f"{shows} face {face.face} ({face.kind} {face.mesh_face} of object {face.object_number} "
        f'"{face.object_name}"), {face.depth:.6g} scene units away'
    )  # fmt: skip
    if face.primitive is not None:
        lines += _format_primitive(face, face.primitive)
    elif face.clipped:
        lines.append("the face was clipped; the pixel lies in a piece of it")
    if any(other.kind in NEAREST_ONLY_KINDS for other in pixel.faces):
        lines.append("of discs and spheres the nearest alone is known; others may lie behind it")
    return "\n".join(lines)


def _format_primitive(face: FaceAtPixel, primitive: PrimitiveAtPixel) -> list[str]:
    """Return lines on the position and size of a point or a segment, and on the pixel in it."""
    width, height = (f"{side:.4g}" for side in primitive.size.tolist())
    right, down = primitive.offset.tolist()
    if primitive.kind == "segment":
        ends = " to ".join(_format_point(end) for end in face.screen[:2])
        first, last = (float(weight) for weight in face.weights[:2])
        return [
            f"a segment from {ends} on the screen, {width} pixels wide here",
            f"the pixel's centre lies {math.hypot(right, down):.4f} pixels from its middle line,",
            f"at {first:.6f} of vertex {face.mesh_vertices[0]} and {last:.6f} of vertex "
            f"{face.mesh_vertices[1]}",
        ]
    if math.isnan(right):
        return [f"a {primitive.kind}, its centre not in front of the eye"]
    size = f"{width} x {height} pixels"
    if primitive.kind != "square":
        size = f"{width if width == height else f'{width} x {height}'} pixels across"
        size += " at that depth" if primitive.kind == "sphere" else ""
    side, level = "right" if right >= 0.0 else "left", "below" if down >= 0.0 else "above"
    centre = _format_point(primitive.place)
    return [
        f"a {primitive.kind} with its centre at {centre} on the screen, {size}",
        f"the pixel's centre lies {abs(right):.4f} pixels {side} of that and {abs(down):.4f} "
        f"{level} it",
    ]


def _format_point(point: NDArray[np.float64]) -> str:
    """Return a point on the screen, pixels, as text."""
    if np.isnan(point).any():
        return "behind the eye"
    return f"({point[0]:.4f}, {point[1]:.4f})"


def _make_face_table(pixel: PixelExplanation) -> Table:
    """Return the faces at the pixel, nearest first."""
    faces = pixel.faces
    table = _make_table(
        "faces that cover the centre, nearest first", ("face", "object"),
        ("depth (scene units)", "stored depth"),
    )  # fmt: skip
    table.add_column("")
    depths = _format_rows(np.array([[face.depth] for face in faces]))
    stored = _format_rows(np.array([[face.stored_depth] for face in faces]), MIN_DEPTH_DECIMALS)
    listed = list(zip(faces, depths, stored, strict=True))
    for face, (depth,), (near,) in listed[:MAX_FACES]:
        owner = f"{face.object_number} {face.object_name}"
        standing = face.standing if pixel.light or face.standing in NOT_DRAWN else "not drawn"
        if face.alpha is not None and face.alpha < 1.0:
            standing += f", alpha {face.alpha:.4g}"
        table.add_row(str(face.face), owner, depth, near, standing)
    if len(listed) > MAX_FACES:
        table.add_row("...", f"and {len(listed) - MAX_FACES:,} more", "", "", "")
    return table


def _make_position_table(face: FaceAtPixel) -> Table:
    """Return the vertices in every space."""
    count = face.distinct
    points = {1: "centre", 2: "ends", 3: "vertices"}[count]
    title = f"the {points} of {face.kind} {face.face}"
    table = _make_table(title, ("space", "vertex"), ("x", "y", "z", "w"))
    table.add_column("outside of")
    outside = [", ".join(words) for words in face.outcodes]
    names = [str(vertex) for vertex in face.mesh_vertices]
    drawn = ["cut"] * 3 if face.clipped else names
    spaces = [
        ("model", names, face.model),
        ("world", names, face.world),
        ("view", names, face.view),
        ("clip", names, face.clip),
        ("NDC", names, face.ndc),
        ("screen, pixels", names, face.screen),
        ("snapped, pixels", drawn, face.snapped / 2.0**face.grid_bits),
        (f"snapped, 1/{1 << face.grid_bits} pixel", drawn, face.snapped),
    ]
    if face.primitive is not None:
        # Only its pieces are snapped.
        del spaces[-2:]
    for space, vertices, rows in spaces:
        decimals = MIN_PIXEL_DECIMALS if "pixels" in space else 0
        for n, row in enumerate(_format_rows(rows[:count], decimals)):
            cells = row + [""] * (4 - len(row))
            codes = outside[n] if space == "clip" else ""
            table.add_row(
                "" if n else space, vertices[n], *cells, codes, end_section=n == count - 1
            )
    return table


def _make_edge_table(face: FaceAtPixel) -> Table:
    """Return the edge functions and the weights of the triangle that was drawn."""
    step = f"1/{1 << face.grid_bits} pixel"
    table = _make_table(
        f"at the pixel's centre, edge functions in squares of {step}\n"
        "(covered where each, plus its bias, is 0 or more)",
        ("vertex",), ("edge opposite it", "bias"),
    )  # fmt: skip
    table.add_column("so the centre is")
    table.add_column("weight on screen", justify="right")
    if not face.clipped:
        table.add_column("with perspective", justify="right")
    for n in range(3):
        name = "cut" if face.clipped else str(face.mesh_vertices[n])
        side = "inside" if face.edges[n] else "on it, a top or left edge"
        weight = _format_weight(face.affine_weights[n])
        cells = [str(face.edges[n]), str(face.biases[n]), side, weight]
        table.add_row(name, *cells, *([] if face.clipped else [_format_weight(face.weights[n])]))
    return table


def _make_weight_table(face: FaceAtPixel) -> Table:
    """Return the weights of a clipped face's vertices."""
    table = _make_table("the weights of the whole face", ("vertex",), ("with perspective",))
    for vertex, weight in zip(face.mesh_vertices, face.weights, strict=True):
        table.add_row(str(vertex), _format_weight(weight))
    return table


def _make_color_table(pixel: PixelExplanation) -> Table:
    """Return the terms of the colour."""
    table = _make_table("colour, linear light", ("term",), ("red", "green", "blue"))
    light = pixel.light
    if light is not None:
        if light.texture is not None:
            u, v = light.uv
            table.add_row(f"texture at uv ({u:.6g}, {v:.6g})", *_format_color(light.texture))
        if light.scalar is not None and light.scalar_color is not None:
            table.add_row(f"scalar {light.scalar:.7g}", *_format_color(light.scalar_color))
        table.add_row(f"base colour ({light.shading})", *_format_color(light.base_color))
        table.add_section()
        if light.shading != "unlit":
            table.add_row("ambient", *_format_color(light.ambient))
        for term in light.lights:
            if term.is_of_effect and abs(term.diffuse).max() < MIN_LISTED_LIGHT:
                continue
            table.add_row(term.label, *_format_color(term.diffuse))
            if term.specular.max() >= MIN_LISTED_LIGHT:
                table.add_row(f"{term.name}, specular", *_format_color(term.specular))
        if light.emission.max() >= MIN_LISTED_LIGHT:
            table.add_row("emission", *_format_color(light.emission))
        table.add_section()
    for name, color in _list_mixture_rows(pixel):
        table.add_row(name, *_format_color(color))
    if pixel.parts:
        table.add_section()
    summed = pixel.parts or (light is not None and light.lights)
    name = "sum" if summed else "background" if light is None else "seen"
    table.add_row(name, *_format_color(pixel.linear[:3]))
    if pixel.under_wireframe:
        table.add_row("a line of the wireframe covers it", "", "", "")
    codes = [str(code) for code in pixel.color[:3].tolist()]
    alpha = "" if pixel.color[3] == 255 else f", alpha {pixel.color[3]}"
    table.add_row(f"8 bits, sRGB{alpha}", *codes)
    return table


def _list_mixture_rows(pixel: PixelExplanation) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Yield name and linear colour of each part of a pixel's colour."""
    through = {face.face for face in pixel.faces if face.standing == SEEN_THROUGH}
    parts = pixel.parts
    for n, part in enumerate(parts[:MAX_FACES]):
        name = f"all of this, face {part.face}"
        if n or pixel.winner is None:
            where = "through" if part.face in through else "beside"
            where = f"{where} it, " if pixel.winner else "beside the centre, "
            name = part.name if part.face is None else where + part.name
        alpha = "" if part.alpha == 1.0 else f", alpha {part.alpha:.4g}"
        yield f"{name}{alpha}: x {part.share:.4f}", part.color
    if len(parts) > MAX_FACES:
        unlisted = parts[MAX_FACES:]
        share = sum(part.share for part in unlisted)
        name = f"and {len(unlisted):,} more: x {share:.4f}"
        yield name, np.sum([part.color for part in unlisted], axis=0)


def _make_table(title: str, left: Iterable[str], right: Iterable[str]) -> Table:
    """Return a table that prints without colour, with columns on the left and on the right."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for column in left:
        table.add_column(column)
    for column in right:
        table.add_column(column, justify="right")
    return table


def _format_weight(share: Fraction) -> str:
    """Return an exact weight as a decimal."""
    return f"{float(share):.6f}"


def _format_color(values: NDArray[np.float32]) -> list[str]:
    """Return linear colour as text."""
    return [f"{value:.5f}" for value in values.tolist()]


def _format_rows(rows: NDArray[Any], decimals: int = 0) -> list[list[str]]:
    """
    Return coordinates as text, with decimals for six significant digits of the largest.

    ``decimals`` is their least number.
    """
    if rows.dtype.kind == "i":
        return [[str(value) for value in row] for row in rows.tolist()]
    known = np.abs(rows[np.isfinite(rows)])
    largest = float(known.max()) if len(known) else 0.0
    if MIN_FIXED <= largest < MAX_FIXED or largest == 0.0:
        whole = len(str(int(largest)))
        form = f".{max(SIGNIFICANT_DIGITS - whole, decimals)}f"
    else:
        form = f".{SIGNIFICANT_DIGITS - 1}e"
    return [
        ["-" if math.isnan(value) else format(value + 0.0, form) for value in row]
        for row in rows.tolist()
    ]


def _print_as_text(parts: Iterable[Any]) -> str:
    """Return headings and tables as plain text."""
    from rich.console import Console

    text = io.StringIO()
    console = Console(
        file=text, width=PAGE_WIDTH, color_system=None, highlight=False, markup=False, emoji=False
    )
    for part in parts:
        if not isinstance(part, str):
            # Print the title as a line: a table would fold it to its width.
            console.print(part.title)
            part.title = None
        console.print(part)
        console.print()
    # Plain ASCII rules print on any terminal and into any file.
    lines = text.getvalue().replace("\u2500", "-").splitlines()
    return "\n".join(line.rstrip() for line in lines).rstrip()
