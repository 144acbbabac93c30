"""What readers find of a drawing, and the `Lines` that it becomes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.arcs import Arc, arc_through
from rasterjit.io.attributes import usable_attributes
from rasterjit.io.resources import LONGEST_NAME
from rasterjit.io.skipped import LeftOut, MeshFileError, reason_of
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.lines import Lines, strip_segments
from rasterjit.scene.material import Material
from rasterjit.scene.memory import MemoryBudget
from rasterjit.scene.mesh import OnInvalid, with_face_scalars, with_face_values

_POINT_BYTES, _SEGMENT_BYTES, _VALUE_BYTES = 96, 64, 12
"""What a point and a segment take besides attributes, and what a value of these does."""

_CUT_BYTES = 64
"""What a point of a curve takes while the curve is cut: itself, its number and a segment."""

_OF_EACH_POINT = 20
"""Points of a curve for each of those that it follows."""

_SAME_PLACE = 1e-9
"""Share of a drawing's extent by which the end of a curve may lie beside its point."""


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


def lines_of(
    drawing: LineDrawing,
    source: str,
    on_invalid: OnInvalid,
    left_out: LeftOut,
    budget: MemoryBudget | None = None,
) -> Lines:
    """Return a drawing as `Lines`, or raise `MeshFileError`, naming ``source``."""
    name = drawing.name[:LONGEST_NAME]
    points, segments = len(drawing.points), len(drawing.segments)
    if budget is not None:
        own = (*drawing.attributes.values(), *drawing.segment_attributes.values())
        needed = _POINT_BYTES * points + _SEGMENT_BYTES * segments
        budget.take(f"the lines {name!r}", needed + _VALUE_BYTES * sum(one.size for one in own))
    of_points, material = None if drawing.by_segment else drawing.colors, drawing.material
    is_colored = drawing.colors is not None or drawing.segment_scalars is not None
    if material is None and is_colored:
        # Those without colours are drawn in ink.
        material = Material("unlit")
    try:
        lines = Lines(
            drawing.points, drawing.segments, material=material, on_invalid=on_invalid,
            attributes=usable_attributes(drawing.attributes, points, left_out),
            colors=of_points, scalars=drawing.scalars if drawing.colors is None else None,
        )  # fmt: skip
        of_segments = usable_attributes(drawing.segment_attributes, segments, left_out)
        with_face_values(lines, drawing.colors if drawing.by_segment else None, of_segments)
        if drawing.segment_scalars is not None:
            with_face_scalars(lines, drawing.segment_scalars)
    except ValueError as error:
        raise MeshFileError(f"{source}: lines {name!r}: {error}") from error
    return lines


def drawing_of_path(
    name: str,
    path: Any,
    source: str,
    on_invalid: OnInvalid,
    left_out: LeftOut,
    budget: MemoryBudget | None = None,
) -> LineDrawing | None:
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
    source : str
        What messages call the file.
    on_invalid : {"raise", "drop"}
        What to do about curves with NaN or infinite points; those of lines are left as they are.
    left_out : LeftOut
        Notes texts, and entities that are damaged.
    budget : MemoryBudget, optional

    Raises
    ------
    MeshFileError
        If a curve has NaN or infinite points: it names the entity.
    """
    vertices = np.asarray(path.vertices, np.float64)
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
            if isinstance(error, _InvalidError) and on_invalid == "raise":
                raise MeshFileError(
                    f"{source}: {kind} {number} of the drawing {name!r}: {error}; "
                    "on_invalid='drop' leaves it out"
                ) from None
            reason = f": {reason_of(error)}"
            left_out.note(f"{kind} of a drawing that cannot be followed", reason=reason)
    if not curves:
        return None
    bounds = [vertices[entity.points] if arc is None else arc.bounds() for entity, arc in curves]
    scale = extent(np.concatenate(bounds))
    counts = [_points_of(entity, arc, scale) for entity, arc in curves]
    if budget is not None:
        budget.take(f"the curves of the drawing {name[:LONGEST_NAME]!r}", _CUT_BYTES * sum(counts))
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
