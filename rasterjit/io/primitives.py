"""What readers find, as RasterJIT draws it: attributes of meshes, `Lines`, `Points`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
from rasterjit.io.resources import LONGEST_NAME
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.lines import Lines, strip_segments
from rasterjit.scene.material import Material
from rasterjit.scene.memory_limits import MemoryBudget
from rasterjit.scene.mesh import Mesh, OnInvalid, value_rows, with_face_scalars, with_face_values
from rasterjit.scene.points import Points
from rasterjit.scene.warning import MADE_NORMALS, told_elsewhere

_SAGITTA = 1e-4
"""Share of a drawing's extent by which segments may lie beside an arc: .4 pixels of 4096."""

_LONGEST_STEP = 0.08
"""Radians of a segment at most: of circles that are small in their drawing, but looked at."""

_MIN = 4
"""Segments of an arc."""

_STRAIGHT = 1e-7
"""Sine of the angle at which an arc is a line: its middle is seen nowhere else, and its centre lies
so far away that points around it are no longer exact."""


class Arc(NamedTuple):
    """
    An arc of a circle, in two or three dimensions.

    Parameters
    ----------
    center : (D,) float
    radius : float
    first, second : (D,) float
        Unit vectors at right angles: towards where the arc begins, and where it goes from there.
    span : float
        Radians, up to 2 pi.
    """

    center: NDArray[np.float64]
    radius: float
    first: NDArray[np.float64]
    second: NDArray[np.float64]
    span: float

    def at(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points, (N, D), at angles from the beginning."""
        along = np.cos(angles)[:, None] * self.first + np.sin(angles)[:, None] * self.second
        return self.center + self.radius * along

    def bounds(self) -> NDArray[np.float64]:
        """Return the corners of the box around the arc, (2, D)."""
        # Along each axis it reaches farthest where it begins or ends, or turns back.
        turns = np.arctan2(self.second, self.first)
        angles = np.concatenate([turns, turns + np.pi]) % (2.0 * np.pi)
        reached = self.at(np.append(angles[angles <= self.span], [0.0, self.span]))
        return np.array([reached.min(axis=0), reached.max(axis=0)])

    def segments(self, scale: float) -> int:
        """Return in how many segments it is cut in a drawing of an extent, which holds it."""
        beside = min(_SAGITTA * scale / self.radius, 1.0)
        step = min(4.0 * math.asin(math.sqrt(0.5 * beside)), _LONGEST_STEP)
        return max(math.ceil(self.span / step), _MIN)

    def points(
        self, segments: int, through: NDArray[np.float64], is_closed: bool
    ) -> NDArray[np.float64]:
        """Return points along it, (segments + 1, D), the ends just as they were given."""
        points = self.at(np.linspace(0.0, self.span, segments + 1))
        points[0] = through[0]
        points[-1] = through[0 if is_closed else -1]
        return points


def arc_through(points: NDArray[np.float64], is_closed: bool) -> Arc | None:
    """
    Return the arc from one point through a second to a third; None if they lie on a line.

    Parameters
    ----------
    points : (3, D) float
        Finite; D is 2 or 3.
    is_closed : bool
        The whole circle.

    Raises
    ------
    ValueError
        If there are not three points, they lie too far apart, or a circle's are on a line.
    """
    if len(points) != 3:
        raise ValueError(f"it must have 3 points, got {len(points)}")
    with np.errstate(over="ignore"):
        sides = points - points[0]
    size = float(np.abs(sides).max())
    if not math.isfinite(size):
        raise ValueError("its points lie too far apart")
    # Of size 1, no product is too large or too small for a float.
    flat = sides / size if size > 0.0 else sides
    middle, end = (np.append(side, 0.0)[:3] for side in flat[1:])
    normal = np.cross(middle, end)
    area, lengths = math.hypot(*normal), math.hypot(*middle) * math.hypot(*end)
    if area <= _STRAIGHT * lengths:
        if is_closed:
            raise ValueError(f"a circle's points must not lie on a line, got {points.tolist()}")
        return None
    across = (end @ end) * np.cross(normal, middle) - (middle @ middle) * np.cross(normal, end)
    center = across / (2.0 * area * area)
    radius = math.hypot(*center)
    first = -center / radius
    second = np.cross(normal / area, first)
    to_end = end - center
    angle = math.atan2(to_end @ second, to_end @ first) % (2.0 * math.pi)
    span = 2.0 * math.pi if is_closed else angle
    kept = points.shape[1]
    return Arc(points[0] + size * center[:kept], size * radius, first[:kept], second[:kept], span)


def usable_attributes(
    given: Mapping[Any, Any], count: int, left_out: LeftOut
) -> dict[str, NDArray[np.float32]]:
    """
    Return the attributes that are finite numbers.

    Parameters
    ----------
    given : mapping of str to (count, ...) array
        Rows of several axes are laid out in one.
    count : int
        Vertices or faces of the mesh.
    left_out : LeftOut
        Notes the others.

    Returns
    -------
    dict of str to (count, D) float32
    """
    usable = {}
    for name, values in given.items():
        said, array = f"attribute {str(name)[:LONGEST_NAME]!r}", np.asarray(values)
        is_numbers = array.dtype.kind in "buif" and array.shape[:1] == (count,) and array.size > 0
        if not (is_numbers and isinstance(name, str) and name):
            left_out.note(f"{said}, which is not a number for each vertex or face")
            continue
        rows = array.reshape(count, -1)
        try:
            usable[name] = value_rows(said, rows.astype(np.uint8) if rows.dtype == bool else rows)
        except ValueError:
            left_out.note(f"{said} with NaN, infinity or what no float32 holds")
    return usable


def mesh_of(label: str, left_out: LeftOut, **arrays: Any) -> Mesh:
    """Return the mesh of what `Mesh` takes, and note how many of its normals had to be made."""
    with told_elsewhere(MADE_NORMALS):
        mesh = Mesh(**arrays)
    if mesh._repaired_normals:
        left_out.note(f"normals of length 0 of {label}: made from faces", mesh._repaired_normals)
    return mesh


_LINE_POINT_BYTES, _SEGMENT_BYTES, _VALUE_BYTES = 96, 64, 12
"""What a point and a segment take besides attributes, and what a value of these does."""

_CUT_BYTES = 64
"""What a point of a curve takes while the curve is cut: itself, its number and a segment."""

_OF_EACH_POINT = 20
"""Points of a curve for each of those that it follows."""

_SAME_PLACE = 1e-9
"""Share of a drawing's extent by which the end of a curve may lie beside its point."""


class Reading(NamedTuple):
    """How what a file holds becomes meshes."""

    source: str
    """What messages call the file or object."""
    on_invalid: OnInvalid
    """What to do about NaN or infinite vertices, as in `Mesh`."""
    crease_angle: float
    """Degrees in 0..180, for meshes without normals."""
    left_out: LeftOut
    """Notes what the file has and the scene has not."""
    budget: MemoryBudget | None = None
    """None for what is in memory already: it has been paid for."""

    def take(self, what: str, count: int) -> None:
        """Ask for bytes of memory."""
        if self.budget is not None:
            self.budget.take(what, count)


@dataclass(frozen=True)
class LineDrawing:
    """
    Segments between points as a file has them.

    Parameters
    ----------
    name : str
        Of its node.
    points : (V, 3) float
    segments : (S, 2) int
        Within the points.
    colors : (V, 4) or (S, 4) float32, optional
        Linear RGBA; of segments if ``by_segment``.
    by_segment : bool
    attributes, segment_attributes : dict of str to (V,) or (V, D), and (S,) or (S, D) array
        Values of one's own.
    material : Material, optional
        An unlit one.
    scalars, segment_scalars : (V,) and (S,) array, optional
        One of them, in the place of colours.
    """

    name: str
    points: NDArray[Any]
    segments: NDArray[Any]
    colors: NDArray[np.float32] | None = None
    by_segment: bool = False
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    segment_attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    material: Material | None = None
    scalars: NDArray[Any] | None = None
    segment_scalars: NDArray[Any] | None = None


def lines_of(drawing: LineDrawing, reading: Reading) -> Lines:
    """Return a drawing as `Lines`, or raise `MeshFileError`, naming its source."""
    name = drawing.name[:LONGEST_NAME]
    points, segments = len(drawing.points), len(drawing.segments)
    own = (*drawing.attributes.values(), *drawing.segment_attributes.values())
    needed = _LINE_POINT_BYTES * points + _SEGMENT_BYTES * segments
    reading.take(f"the lines {name!r}", needed + _VALUE_BYTES * sum(one.size for one in own))
    of_points, material = None if drawing.by_segment else drawing.colors, drawing.material
    is_colored = drawing.colors is not None or drawing.segment_scalars is not None
    if material is None and is_colored:
        # Those without colours are drawn in ink.
        material = Material("unlit")
    try:
        lines = Lines(
            drawing.points, drawing.segments, material=material, on_invalid=reading.on_invalid,
            attributes=usable_attributes(drawing.attributes, points, reading.left_out),
            colors=of_points, scalars=drawing.scalars if drawing.colors is None else None,
        )  # fmt: skip
        of_segments = usable_attributes(drawing.segment_attributes, segments, reading.left_out)
        with_face_values(lines, drawing.colors if drawing.by_segment else None, of_segments)
        if drawing.segment_scalars is not None:
            with_face_scalars(lines, drawing.segment_scalars)
    except ValueError as error:
        raise MeshFileError(f"{reading.source}: lines {name!r}: {error}") from error
    return lines


def drawing_of_path(name: str, path: Any, reading: Reading) -> LineDrawing | None:
    """
    Return a trimesh ``Path2D`` or ``Path3D``, its curves in short segments; None if it is empty.

    How short they are follows from the extent of the drawing, and the memory for them is asked for
    before any curve is cut. trimesh's own bounds of arcs are not asked for: it cuts them into
    pieces of a fixed length.

    Parameters
    ----------
    name : str
    path : trimesh.path.Path
        Of two dimensions: it lies in the plane z = 0.
    reading : Reading
        Texts, and entities that are damaged, are noted. What it says of invalid points is for
        curves; those of lines are left as they are.

    Raises
    ------
    MeshFileError
        If a curve has NaN or infinite points: it names the entity.
    """
    vertices, left_out = np.asarray(path.vertices, np.float64), reading.left_out
    curves = []
    for number, entity in enumerate(path.entities):
        kind = type(entity).__name__
        if kind == "Text":
            left_out.note("text of a drawing")
            continue
        try:
            control = vertices[np.asarray(entity.points, np.int64)]
            if kind != "Line" and not np.isfinite(control).all():
                raise _InvalidError(f"its points must be finite, got {control.tolist()}")
            curves.append((entity, arc_through(control, entity.closed) if kind == "Arc" else None))
        except (ValueError, IndexError, TypeError, ArithmeticError) as error:
            if isinstance(error, _InvalidError) and reading.on_invalid == "raise":
                raise MeshFileError(
                    f"{reading.source}: {kind} {number} of the drawing {name!r}: {error}; "
                    "on_invalid='drop' leaves it out"
                ) from None
            reason = f": {reason_of(error)}"
            left_out.note(f"{kind} of a drawing that cannot be followed", reason=reason)
    if not curves:
        return None
    bounds = [vertices[entity.points] if arc is None else arc.bounds() for entity, arc in curves]
    scale = extent(np.concatenate(bounds))
    counts = [_points_of(entity, arc, scale) for entity, arc in curves]
    reading.take(f"the curves of the drawing {name[:LONGEST_NAME]!r}", _CUT_BYTES * sum(counts))
    pieces, segments, colors = [vertices], [], []
    total = len(vertices)
    for (entity, arc), count in zip(curves, counts, strict=True):
        kind = type(entity).__name__
        try:
            if kind == "Line":
                strip = np.asarray(entity.points, np.int64)
            else:
                curve = _cut(entity, arc, count, vertices, scale)
                # Where it begins and ends are points of the path, by which it may be joined.
                ends = np.asarray(entity.end_points, np.int64)
                gap = np.abs(vertices[ends] - curve[[0, -1]]).max()
                is_ring = bool(entity.closed) or np.array_equal(curve[0], curve[-1])
                is_joined = not is_ring and len(curve) > 2 and gap <= _SAME_PLACE * scale
                piece = curve[1:-1] if is_joined else curve
                strip = np.arange(total, total + len(piece))
                if is_joined:
                    strip = np.concatenate([ends[:1], strip, ends[-1:]])
                elif is_ring:
                    strip[-1] = strip[0]
                pieces.append(piece)
                total += len(piece)
        except (ValueError, IndexError, TypeError, ArithmeticError) as error:
            reason = f": {reason_of(error)}"
            left_out.note(f"{kind} of a drawing that cannot be followed", reason=reason)
            continue
        if len(strip) < 2:
            left_out.note(f"{kind} of a drawing of fewer than 2 points")
            continue
        segments.append(strip_segments(strip, np.array([len(strip)]))[0])
        colors.append((len(strip) - 1, entity.color))
    if not segments:
        return None
    points = np.concatenate(pieces)
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    return LineDrawing(name, points, np.concatenate(segments), _entity_colors(colors), True)


class _InvalidError(ValueError):
    """A curve has NaN or infinite points."""


def extent(points: NDArray[np.float64]) -> float:
    """Return the diagonal of the box around those of (N, D) points that are finite; 0 of none."""
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return 0.0
    with np.errstate(over="ignore"):
        return math.hypot(*np.ptp(finite, axis=0).tolist())


def _points_of(entity: Any, arc: Arc | None, scale: float) -> int:
    """Return in how many points an entity is cut, or about."""
    count = len(entity.points)
    if arc is not None:
        return arc.segments(scale) + 1
    return count if type(entity).__name__ == "Line" else _OF_EACH_POINT * count


def _cut(
    entity: Any, arc: Arc | None, count: int, vertices: NDArray[np.float64], scale: float
) -> NDArray[np.float64]:
    """Return the points of a curve."""
    if arc is not None:
        return arc.points(count - 1, vertices[entity.points], bool(entity.closed))
    if type(entity).__name__ in ("Bezier", "BSpline"):
        return np.asarray(entity.discrete(vertices, count=count), np.float64)
    if type(entity).__name__ == "Arc":
        # Three points on a line.
        return vertices[entity.points]
    return np.asarray(entity.discrete(vertices, scale=scale or 1.0), np.float64)


def _entity_colors(found: list[tuple[int, Any]]) -> NDArray[np.float32] | None:
    """Return the colours of segments, linear RGBA; None if no entity has one."""
    if all(color is None for _, color in found):
        return None
    rows = np.zeros((len(found), 4), np.uint8)
    rows[:, 3] = 255
    for number, (_, color) in enumerate(found):
        code = np.asarray([] if color is None else color)
        if code.shape in ((3,), (4,)) and code.dtype.kind in "ui":
            rows[number, : len(code)] = np.clip(code, 0, 255)
    rgba = np.ones((len(rows), 4), np.float32)
    rgba[:, :3] = srgb_to_linear(rows[:, :3])
    rgba[:, 3] = rows[:, 3] / np.float32(255.0)
    return np.repeat(rgba, [count for count, _ in found], axis=0)


INTENSITY = "intensity"
"""The attribute that shows a cloud without colours."""

USUAL_SIZE, _MAX_SIZE = 3.0, 12.0
"""Pixels of a point of a cloud, and of one of a few points."""

_SPREAD_CUBED = 26.0 * 26.0 * 26.0
"""Pixels of a lone point, but for the largest size; sizes shrink as distances between them do."""

_PIXELS = 1e6
"""How many pixels the points of a large cloud cover, as squares side by side."""

_POINT_BYTES = 160
"""What a point takes besides its attributes."""

NOT_MEASURED = "point without a position (NaN)"
INFINITE = "point at infinity"


@dataclass(frozen=True)
class Cloud:
    """
    A point cloud as a file has it.

    Parameters
    ----------
    name : str
        Of its node.
    positions : (N, 3) float
        NaN where nothing was measured.
    colors : (N, 4) float32, optional
        Linear RGBA.
    normals : (N, 3) float, optional
    attributes : dict of str to (N,) or (N, D) array
        Values of one's own.
    material : Material, optional
    scalars : (N,) array, optional
        In the place of colours.
    """

    name: str
    positions: NDArray[Any]
    colors: NDArray[np.float32] | None = None
    normals: NDArray[Any] | None = None
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    material: Material | None = None
    scalars: NDArray[Any] | None = None


def default_size(count: int) -> float:
    """
    Return the size in pixels of the points of a cloud of so many.

    3, of large ones down to 1, of those of fewer than four hundred up to 12.
    """
    large = min(USUAL_SIZE, max(1.0, float(round(math.sqrt(_PIXELS / count)))))
    # The largest whole size whose cube, times the points, does not pass that of the spread.
    size = _MAX_SIZE
    while size > large and (size - 0.5) * (size - 0.5) * (size - 0.5) * count > _SPREAD_CUBED:
        size -= 1.0
    return max(large, size)


def points_of(cloud: Cloud, reading: Reading) -> Points:
    """
    Return a cloud as `Points`, or raise `MeshFileError`, naming its source.

    All points keep their numbers; those that are NaN are there, but not drawn, and are noted. So
    are infinite ones if ``on_invalid`` is ``"drop"``. Clouds without colours and normals are shown
    by their intensity, if they have one.
    """
    name = cloud.name[:LONGEST_NAME]
    positions, count = cloud.positions, len(cloud.positions)
    source, left_out = reading.source, reading.left_out
    values = sum(one.size for one in cloud.attributes.values())
    reading.take(f"the points of {name!r}", _POINT_BYTES * count + _VALUE_BYTES * values)
    if not count:
        raise MeshFileError(f"{source} holds a point cloud of no points")
    sound = np.isfinite(positions).all(axis=1)
    if not sound.any():
        raise MeshFileError(
            f"{source} holds a point cloud of {count} points, none of which has a finite position"
        )
    attributes, normals = cloud.attributes, cloud.normals
    if not sound.all():
        infinite = int(np.count_nonzero(np.isinf(positions).any(axis=1)))
        if infinite and reading.on_invalid == "raise":
            raise MeshFileError(
                f"{source}: points {name!r}: positions must be finite, or NaN where nothing was "
                f"measured, got {infinite} of {count} at infinity; on_invalid='drop' leaves them "
                "out"
            )
        for what, number in (
            (NOT_MEASURED, count - int(np.count_nonzero(sound)) - infinite), (INFINITE, infinite),
        ):  # fmt: skip
            if number:
                left_out.note(what, number)
        # What was measured nowhere has no values either.
        attributes = {key: _held(values, sound) for key, values in attributes.items()}
        normals = None if normals is None else _held(normals, sound)
    usable = usable_attributes(attributes, count, left_out)
    normals = finite_normals(normals, left_out)
    normals = normals if normals is not None and normals.any() else None
    scalars = cloud.scalars if cloud.colors is None else None
    if scalars is None and cloud.colors is None and normals is None and cloud.material is None:
        scalars = _shown_intensity(usable)
    try:
        return Points(
            positions, colors=cloud.colors, normals=normals,
            attributes=usable, size=default_size(count), scalars=scalars, material=cloud.material,
            on_invalid="drop",
        )  # fmt: skip
    except ValueError as error:
        raise MeshFileError(f"{source}: points {name!r}: {error}") from error


def _held(values: NDArray[Any], rows: NDArray[np.bool_]) -> NDArray[Any]:
    """Return values that are zero beside some rows; values that fit no rows as they are."""
    if len(values) != len(rows) or values.dtype.kind != "f":
        return values
    held = np.array(values)
    held[~rows] = 0
    return held


def finite_normals(values: NDArray[Any] | None, left_out: LeftOut) -> NDArray[Any] | None:
    """Return normals, zero, with a note, where one is not finite."""
    if values is None:
        return None
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        left_out.note("normals with NaN or infinity")
        values = np.where(finite[:, np.newaxis], values, 0.0)
    return values


def _shown_intensity(attributes: dict[str, NDArray[np.float32]]) -> NDArray[np.float32] | None:
    """Return the intensity of points, (N,), if it is one number that differs between them."""
    values = next((rows for key, rows in attributes.items() if key.lower() == INTENSITY), None)
    if values is None or values.shape[1] != 1 or values.min() == values.max():
        return None
    return values[:, 0]
