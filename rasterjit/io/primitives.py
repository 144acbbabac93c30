"""Turn line sets and point clouds of files into `Lines` and `Points`; check attributes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
from rasterjit.io.resources import MAX_NAME_LENGTH
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.lines import Lines, split_into_segments
from rasterjit.scene.material import Material
from rasterjit.scene.memory_limits import MemoryBudget
from rasterjit.scene.mesh import Mesh, OnInvalid, set_face_scalars, set_face_values, value_rows
from rasterjit.scene.points import Points
from rasterjit.scene.warning import REPAIRED_NORMALS, silence_warnings

_MAX_SAGITTA_SHARE = 1e-4
"""Largest distance of segments from an arc, as a share of the drawing: .4 pixels of 4096."""

_MAX_SEGMENT_RADIANS = 0.08
"""Most radians of a segment: circles that are small in their drawing may be looked at closely."""

_MIN_SEGMENTS = 4
"""Fewest segments of an arc."""

_STRAIGHT_SINE = 1e-7
"""Sine of the angle at which an arc is a line: its middle is seen nowhere else, and its centre lies
so far away that points around it are no longer exact."""


class Arc(NamedTuple):
    """
    An arc of a circle, in two or three dimensions.

    Parameters
    ----------
    center : (D,) float
    radius : float
    x_axis, y_axis : (D,) float
        Unit vectors at right angles: towards where the arc begins, and where it goes from there.
    span : float
        Radians, up to 2 pi.
    """

    center: NDArray[np.float64]
    radius: float
    x_axis: NDArray[np.float64]
    y_axis: NDArray[np.float64]
    span: float

    def compute_points(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points, (N, D), at angles from the beginning."""
        along = np.cos(angles)[:, None] * self.x_axis + np.sin(angles)[:, None] * self.y_axis
        return self.center + self.radius * along

    def bounds(self) -> NDArray[np.float64]:
        """Return the corners of the box around the arc, (2, D)."""
        # Along each axis it reaches farthest where it begins or ends, or turns back.
        extremes = np.arctan2(self.y_axis, self.x_axis)
        angles = np.concatenate([extremes, extremes + np.pi]) % (2.0 * np.pi)
        points = self.compute_points(np.append(angles[angles <= self.span], [0.0, self.span]))
        return np.array([points.min(axis=0), points.max(axis=0)])

    def count_segments(self, scale: float) -> int:
        """Return the number of segments for the arc in a drawing of a given extent."""
        sagitta = min(_MAX_SAGITTA_SHARE * scale / self.radius, 1.0)
        step = min(4.0 * math.asin(math.sqrt(0.5 * sagitta)), _MAX_SEGMENT_RADIANS)
        return max(math.ceil(self.span / step), _MIN_SEGMENTS)

    def sample(
        self, segments: int, control: NDArray[np.float64], is_closed: bool
    ) -> NDArray[np.float64]:
        """Return points along the arc, (segments + 1, D), with the ends exactly as given."""
        points = self.compute_points(np.linspace(0.0, self.span, segments + 1))
        points[0] = control[0]
        points[-1] = control[0 if is_closed else -1]
        return points


def make_arc(points: NDArray[np.float64], is_closed: bool) -> Arc | None:
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
    if area <= _STRAIGHT_SINE * lengths:
        if is_closed:
            raise ValueError(f"a circle's points must not lie on a line, got {points.tolist()}")
        return None
    across = (end @ end) * np.cross(normal, middle) - (middle @ middle) * np.cross(normal, end)
    center = across / (2.0 * area * area)
    radius = math.hypot(*center)
    x_axis = -center / radius
    y_axis = np.cross(normal / area, x_axis)
    to_end = end - center
    angle = math.atan2(to_end @ y_axis, to_end @ x_axis) % (2.0 * math.pi)
    span = 2.0 * math.pi if is_closed else angle
    axes = points.shape[1]
    return Arc(points[0] + size * center[:axes], size * radius, x_axis[:axes], y_axis[:axes], span)


def select_finite(
    attributes: Mapping[Any, Any], count: int, left_out: LeftOut
) -> dict[str, NDArray[np.float32]]:
    """
    Return the attributes that are finite numbers, as rows of float32.

    Parameters
    ----------
    attributes : mapping of str to (count, ...) array
        Rows of several axes are laid out in one.
    count : int
        Vertices or faces of the mesh.
    left_out : LeftOut
        Notes all other attributes.

    Returns
    -------
    dict of str to (count, D) float32
    """
    usable = {}
    for name, values in attributes.items():
        label, array = f"attribute {str(name)[:MAX_NAME_LENGTH]!r}", np.asarray(values)
        is_numbers = array.dtype.kind in "buif" and array.shape[:1] == (count,) and array.size > 0
        if not (is_numbers and isinstance(name, str) and name):
            left_out.note(f"{label}, which is not a number for each vertex or face")
            continue
        rows = array.reshape(count, -1)
        try:
            usable[name] = value_rows(label, rows.astype(np.uint8) if rows.dtype == bool else rows)
        except ValueError:
            left_out.note(f"{label} with NaN, infinity or what no float32 holds")
    return usable


def make_mesh(label: str, left_out: LeftOut, **arrays: Any) -> Mesh:
    """Make a `Mesh`, and note how many zero normals it replaced by those of faces."""
    with silence_warnings(REPAIRED_NORMALS):
        mesh = Mesh(**arrays)
    if mesh._repaired_normals:
        left_out.note(f"normals of length 0 of {label}: made from faces", mesh._repaired_normals)
    return mesh


_MEMORY_PER_LINE_POINT, _MEMORY_PER_SEGMENT, _MEMORY_PER_VALUE = 96, 64, 12
"""Memory of a point and of a segment without attributes, and of a value of an attribute."""

_MEMORY_PER_SAMPLE = 64
"""Memory of a sampled point of a curve: itself, its number and a segment."""

_SAMPLES_PER_POINT = 20
"""Sampled points for each control point of a curve."""

_JOIN_TOLERANCE = 1e-9
"""Largest distance between a curve's end and its point, as a share of the drawing's extent."""


class Context(NamedTuple):
    """The settings of one load, its budget, and the notes of what is left out."""

    source: str
    """What messages call the file or object."""
    on_invalid: OnInvalid
    """What to do about NaN or infinite vertices, as in `Mesh`."""
    crease_angle: float
    """Degrees in 0..180, for meshes without normals."""
    left_out: LeftOut
    """Notes what the file has and the scene has not."""
    budget: MemoryBudget | None = None
    """None for an object that is in memory already."""

    def take(self, what: str, count: int) -> None:
        """Count bytes of memory, if there is a budget."""
        if self.budget is not None:
            self.budget.take(what, count)


@dataclass(frozen=True)
class LineSet:
    """
    Line segments as a file has them.

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


def make_lines(data: LineSet, context: Context) -> Lines:
    """Return a line set as `Lines`, or raise `MeshFileError`, naming its source."""
    name = data.name[:MAX_NAME_LENGTH]
    points, segments = len(data.points), len(data.segments)
    values = (*data.attributes.values(), *data.segment_attributes.values())
    memory = _MEMORY_PER_LINE_POINT * points + _MEMORY_PER_SEGMENT * segments
    context.take(
        f"the lines {name!r}", memory + _MEMORY_PER_VALUE * sum(one.size for one in values)
    )
    of_points, material = None if data.by_segment else data.colors, data.material
    is_colored = data.colors is not None or data.segment_scalars is not None
    if material is None and is_colored:
        # Those without colours are drawn in ink.
        material = Material("unlit")
    try:
        lines = Lines(
            data.points, data.segments, material=material, on_invalid=context.on_invalid,
            attributes=select_finite(data.attributes, points, context.left_out),
            colors=of_points, scalars=data.scalars if data.colors is None else None,
        )  # fmt: skip
        of_segments = select_finite(data.segment_attributes, segments, context.left_out)
        set_face_values(lines, data.colors if data.by_segment else None, of_segments)
        if data.segment_scalars is not None:
            set_face_scalars(lines, data.segment_scalars)
    except ValueError as error:
        raise MeshFileError(f"{context.source}: lines {name!r}: {error}") from error
    return lines


def convert_path(name: str, path: Any, context: Context) -> LineSet | None:
    """
    Return a trimesh ``Path2D`` or ``Path3D`` as a line set, its curves sampled; None if empty.

    How short they are follows from the extent of the drawing, and the memory for them is asked for
    before any curve is cut. trimesh's own bounds of arcs are not asked for: it cuts them into
    pieces of a fixed length.

    Parameters
    ----------
    name : str
    path : trimesh.path.Path
        Of two dimensions: it lies in the plane z = 0.
    context : Context
        Texts, and entities that are damaged, are noted. What it says of invalid points is for
        curves; those of lines are left as they are.

    Raises
    ------
    MeshFileError
        If a curve has NaN or infinite points: it names the entity.
    """
    vertices, left_out = np.asarray(path.vertices, np.float64), context.left_out
    curves = []
    for number, entity in enumerate(path.entities):
        kind = type(entity).__name__
        if kind == "Text":
            left_out.note("text of a drawing")
            continue
        try:
            control = vertices[np.asarray(entity.points, np.int64)]
            if kind != "Line" and not np.isfinite(control).all():
                raise _NonFiniteError(f"its points must be finite, got {control.tolist()}")
            curves.append((entity, make_arc(control, entity.closed) if kind == "Arc" else None))
        except (ValueError, IndexError, TypeError, ArithmeticError) as error:
            if isinstance(error, _NonFiniteError) and context.on_invalid == "raise":
                raise MeshFileError(
                    f"{context.source}: {kind} {number} of the drawing {name!r}: {error}; "
                    "on_invalid='drop' leaves it out"
                ) from None
            reason = f": {reason_of(error)}"
            left_out.note(f"{kind} of a drawing that cannot be followed", reason=reason)
    if not curves:
        return None
    bounds = [vertices[entity.points] if arc is None else arc.bounds() for entity, arc in curves]
    scale = measure_extent(np.concatenate(bounds))
    counts = [_count_points(entity, arc, scale) for entity, arc in curves]
    context.take(
        f"the curves of the drawing {name[:MAX_NAME_LENGTH]!r}", _MEMORY_PER_SAMPLE * sum(counts)
    )
    pieces, segments, colors = [vertices], [], []
    total = len(vertices)
    for (entity, arc), count in zip(curves, counts, strict=True):
        kind = type(entity).__name__
        try:
            if kind == "Line":
                strip = np.asarray(entity.points, np.int64)
            else:
                curve = _sample_curve(entity, arc, count, vertices, scale)
                # Where it begins and ends are points of the path, by which it may be joined.
                ends = np.asarray(entity.end_points, np.int64)
                gap = np.abs(vertices[ends] - curve[[0, -1]]).max()
                is_ring = bool(entity.closed) or np.array_equal(curve[0], curve[-1])
                is_joined = not is_ring and len(curve) > 2 and gap <= _JOIN_TOLERANCE * scale
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
        segments.append(split_into_segments(strip, np.array([len(strip)]))[0])
        colors.append((len(strip) - 1, entity.color))
    if not segments:
        return None
    points = np.concatenate(pieces)
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    return LineSet(name, points, np.concatenate(segments), _convert_entity_colors(colors), True)


class _NonFiniteError(ValueError):
    """A curve has NaN or infinite points."""


def measure_extent(points: NDArray[np.float64]) -> float:
    """Return the diagonal of the bounds of points, (N, D), that are finite; 0 without any."""
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return 0.0
    with np.errstate(over="ignore"):
        return math.hypot(*np.ptp(finite, axis=0).tolist())


def _count_points(entity: Any, arc: Arc | None, scale: float) -> int:
    """Return about how many points an entity is sampled at."""
    count = len(entity.points)
    if arc is not None:
        return arc.count_segments(scale) + 1
    return count if type(entity).__name__ == "Line" else _SAMPLES_PER_POINT * count


def _sample_curve(
    entity: Any, arc: Arc | None, count: int, vertices: NDArray[np.float64], scale: float
) -> NDArray[np.float64]:
    """Return the sampled points of a curve."""
    if arc is not None:
        return arc.sample(count - 1, vertices[entity.points], bool(entity.closed))
    if type(entity).__name__ in ("Bezier", "BSpline"):
        return np.asarray(entity.discrete(vertices, count=count), np.float64)
    if type(entity).__name__ == "Arc":
        # Three points on a line.
        return vertices[entity.points]
    return np.asarray(entity.discrete(vertices, scale=scale or 1.0), np.float64)


def _convert_entity_colors(colors: list[tuple[int, Any]]) -> NDArray[np.float32] | None:
    """Return the colours of segments, linear RGBA; None if no entity has one."""
    if all(color is None for _, color in colors):
        return None
    rows = np.zeros((len(colors), 4), np.uint8)
    rows[:, 3] = 255
    for number, (_, color) in enumerate(colors):
        code = np.asarray([] if color is None else color)
        if code.shape in ((3,), (4,)) and code.dtype.kind in "ui":
            rows[number, : len(code)] = np.clip(code, 0, 255)
    rgba = np.ones((len(rows), 4), np.float32)
    rgba[:, :3] = srgb_to_linear(rows[:, :3])
    rgba[:, 3] = rows[:, 3] / np.float32(255.0)
    return np.repeat(rgba, [count for count, _ in colors], axis=0)


INTENSITY = "intensity"
"""Name of the attribute that colours a cloud without colours."""

DEFAULT_POINT_SIZE, _MAX_POINT_SIZE = 3.0, 12.0
"""Point sizes in pixels: the default, and the largest, of clouds of a few points."""

_SPREAD_CUBED = 26.0 * 26.0 * 26.0
"""Cube of the size of a single point; sizes shrink as the distances between points do."""

_COVERED_PIXELS = 1e6
"""Total area in pixels that the points of a large cloud cover without overlap."""

_MEMORY_PER_POINT = 160
"""Memory of a point without its attributes."""

NAN_POINT = "point without a position (NaN)"
INFINITE_POINT = "point at infinity"


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


def choose_point_size(count: int) -> float:
    """
    Return the point size, pixels, for a cloud of ``count`` points.

    3, of large ones down to 1, of those of fewer than four hundred up to 12.
    """
    large = min(DEFAULT_POINT_SIZE, max(1.0, float(round(math.sqrt(_COVERED_PIXELS / count)))))
    # The largest whole size whose cube, times the points, does not pass that of the spread.
    size = _MAX_POINT_SIZE
    while size > large and (size - 0.5) * (size - 0.5) * (size - 0.5) * count > _SPREAD_CUBED:
        size -= 1.0
    return max(large, size)


def make_points(cloud: Cloud, context: Context) -> Points:
    """
    Return a cloud as `Points`, or raise `MeshFileError`, naming its source.

    All points keep their numbers; those that are NaN are there, but not drawn, and are noted. So
    are infinite ones if ``on_invalid`` is ``"drop"``. Clouds without colours and normals are shown
    by their intensity, if they have one.
    """
    name = cloud.name[:MAX_NAME_LENGTH]
    positions, count = cloud.positions, len(cloud.positions)
    source, left_out = context.source, context.left_out
    values = sum(one.size for one in cloud.attributes.values())
    context.take(f"the points of {name!r}", _MEMORY_PER_POINT * count + _MEMORY_PER_VALUE * values)
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
        if infinite and context.on_invalid == "raise":
            raise MeshFileError(
                f"{source}: points {name!r}: positions must be finite, or NaN where nothing was "
                f"measured, got {infinite} of {count} at infinity; on_invalid='drop' leaves them "
                "out"
            )
        left_out.note(NAN_POINT, count - int(np.count_nonzero(sound)) - infinite)
        left_out.note(INFINITE_POINT, infinite)
        # Points without a position have no other values either.
        attributes = {key: _zero_elsewhere(values, sound) for key, values in attributes.items()}
        normals = None if normals is None else _zero_elsewhere(normals, sound)
    usable = select_finite(attributes, count, left_out)
    normals = zero_infinite(normals, left_out)
    normals = normals if normals is not None and normals.any() else None
    scalars = cloud.scalars if cloud.colors is None else None
    if scalars is None and cloud.colors is None and normals is None and cloud.material is None:
        scalars = _find_intensity(usable)
    try:
        return Points(
            positions, colors=cloud.colors, normals=normals, attributes=usable,
            size=choose_point_size(count), scalars=scalars, material=cloud.material,
            on_invalid="drop",
        )  # fmt: skip
    except ValueError as error:
        raise MeshFileError(f"{source}: points {name!r}: {error}") from error


def _zero_elsewhere(values: NDArray[Any], rows: NDArray[np.bool_]) -> NDArray[Any]:
    """Return values with zeros outside some rows; values of another length unchanged."""
    if len(values) != len(rows) or values.dtype.kind != "f":
        return values
    result = np.array(values)
    result[~rows] = 0
    return result


def zero_infinite(values: NDArray[Any] | None, left_out: LeftOut) -> NDArray[Any] | None:
    """Return normals with zeros, and a note, where they are not finite."""
    if values is None:
        return None
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        left_out.note("normals with NaN or infinity")
        values = np.where(finite[:, np.newaxis], values, 0.0)
    return values


def _find_intensity(attributes: dict[str, NDArray[np.float32]]) -> NDArray[np.float32] | None:
    """Return the intensity of points, (N,), if it is one number that differs between them."""
    values = next((rows for key, rows in attributes.items() if key.lower() == INTENSITY), None)
    if values is None or values.shape[1] != 1 or values.min() == values.max():
        return None
    return values[:, 0]
