"""
Define depth buffer formats, which round depths before the depth test.

A vertex's stored depth is ``(c0 + c1 z + c2 w) / w`` of its clip position, and greater is nearer,
in every format; formats differ in the coefficients and in the type of the arrays that hold it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.geometry.setup import MAX_COORDINATE
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera, PerspectiveCamera
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.quality import Quality
from rasterjit.survey.object_transforms import Boxes

Float64 = NDArray[np.float64]

UNORM_BITS = {"unorm16": 16, "unorm24": 24}

REVERSED_TYPES = {"float32-reversed": np.float32, "float64": np.float64}
"""Formats that store the reversed depth of the camera unchanged."""

MIN_FAR_DEPTH_RATIO = 1e-12
"""Least reversed depth of a finite far plane, relative to the near plane's: below is rounding."""

VERTICES_PER_BLOCK = 1 << 16
"""Vertices processed together, so that they stay in the cache."""


class DepthFormat(NamedTuple):
    """A depth buffer format for one camera."""

    name: str
    kind: Any
    """Type of the arrays: float32, float64, or int32, which truncates."""
    coefficients: tuple[float, float, float]
    """Coefficients of the stored depth."""
    largest: int
    """Integer depth of the near plane; 0 if depths are floats."""
    ends: tuple[float, float] | None
    """Reversed depth of the near and the far plane; ``None`` if stored depth is reversed."""
    tilt: tuple[float, float]
    """Derivatives of the reversed depth by NDC x and y: zero unless the near plane is tilted."""

    @property
    def is_reversed(self) -> bool:
        """Whether the stored depth is the camera's reversed one."""
        return self.ends is None

    @property
    def is_standard(self) -> bool:
        """Whether all passes read the format."""
        return self.ends is None and self.kind is np.float32

    def reversed_depth(self, stored: NDArray[Any], x: Float64, y: Float64) -> Float64:
        """
        Convert stored depths to the camera's reversed depth.

        Parameters
        ----------
        stored : (N,)
        x, y : (N,) float64, NDC
            Positions of the depths.
        """
        if self.ends is None:
            return np.asarray(stored, np.float64)
        stored = np.asarray(stored, np.float64)
        # 1 at the near plane and 0 at the far one.
        near_share = stored / self.largest if self.largest else 1.0 + stored
        far_share = 1.0 - near_share if self.largest else -stored
        x_tilt, y_tilt = self.tilt
        return (self.ends[0] * near_share + self.ends[1] * far_share) + (x_tilt * x + y_tilt * y)


def make_depth_format(name: str, camera: Camera, size: tuple[int, int]) -> DepthFormat:
    """
    Return the depth format of a camera.

    Parameters
    ----------
    name : str
        As ``Quality.depth_format`` has it.
    camera : Camera
    size : (int, int)
        Width and height, pixels.

    Raises
    ------
    ValueError
        If the camera's clip-space z does not grow with depth, and the format stores it.
    """
    if name in REVERSED_TYPES:
        return _reversed_format(name, camera.depth_coefficients())
    c0, c1, c2 = camera.depth_coefficients()
    inverse_w_row = np.zeros(4)
    if c0 != 0.0:
        try:
            # One over w, from NDC x, y, z and 1.
            inverse_w_row = transforms.inverse(camera.projection_matrix(size))[3]
        except ValueError:
            raise ValueError(_refusal_reason(name)) from None
    across, up, depth_rows, constant = (c0 * inverse_w_row + (0.0, 0.0, c1, c2)).tolist()
    near, far = constant - depth_rows, constant + depth_rows
    if not depth_rows < 0.0:
        raise ValueError(_refusal_reason(name))
    if c0 != 0.0 and abs(far) < MIN_FAR_DEPTH_RATIO * abs(near):
        far = 0.0
    return _ranged_format(name, -1.0, (near, far), (across, up))


def check_near_plane(
    quality: Quality,
    camera: Camera,
    boxes: Boxes,
    nodes: Sequence[Node],
    clip_from_relative: Float64,
) -> None:
    """
    Raise ``ValueError`` if a near plane is too near for the depths that may be visible.

    Parameters
    ----------
    quality : Quality
    camera : Camera
    boxes : Boxes
        Around the objects.
    nodes : sequence of Node
        The objects.
    clip_from_relative : (4, 4) float64

    Raises
    ------
    ValueError
        If objects lie beyond a far plane that float64 loses; if the format cannot hold the depth of
        the farthest (reversed formats) or nearest vertex (others, which always lose far ones).
    """
    name, near_w = quality.depth_format, camera.depth_coefficients()[0]
    min_ratio = min_resolved_depth(name, quality.precision)
    has_planes = isinstance(camera, PerspectiveCamera)
    far = camera.far if has_planes else math.inf
    min_near_w = transforms.MIN_NEAR * far if far < math.inf else 0.0
    if not near_w > 0.0:
        return
    if near_w >= min_near_w and (
        near_w >= min_ratio * boxes.estimate_max_w() or near_w >= min_ratio * boxes.compute_max_w()
    ):
        return
    for nearest, farthest in _bound_w(boxes, nodes, clip_from_relative[3]):
        if nearest == math.inf:
            return
        depth = min(farthest, far) if name in REVERSED_TYPES else nearest
        if near_w >= min_ratio * depth and (near_w >= min_near_w or farthest <= far):
            return
    if near_w < min_near_w and farthest > far:
        raise ValueError(
            f"camera.near must be at least {transforms.rounded_up(min_near_w)}, or camera.far "
            f"math.inf: float64 cannot cut at camera.far = {far!r}, beyond which something lies; "
            f"got {near_w!r}"
        )
    raise ValueError(
        f"{'camera.near' if has_planes else 'w on the near plane of camera'} must be at least "
        f"{transforms.rounded_up(min_ratio * depth)}, so that quality.depth_format {name!r} holds "
        f"the depth of what lies {depth:.3g} away; got {near_w!r}"
    )


@cache
def min_resolved_depth(name: str, precision: str) -> float:
    """Return the least reversed depth (1 at the near plane, 0 far away) that a format resolves."""
    if name in REVERSED_TYPES:
        # Depths of vertices are computed in this precision before they are rounded.
        kind = REVERSED_TYPES[name] if precision == "float64" else np.float32
        return float(np.finfo(kind).tiny)
    # Half a step: smaller depths are rounded to the far plane, which float32 stores as -1.
    return 0.5 / ((1 << UNORM_BITS[name]) - 1) if name in UNORM_BITS else 2.0**-25


def _bound_w(boxes: Boxes, nodes: Sequence[Node], row: Float64) -> Iterator[tuple[float, float]]:
    """
    Yield upper bounds on the least and the greatest w of vertices of visible faces.

    Each pair takes longer to find, and the last is exact: inf and -inf for none.
    """
    # Bounds by boxes. Vertices beyond the range are not drawn, and need the exact test.
    lows, highs, is_inside = boxes.compute_w_ranges(row)
    is_drawn = (lows >= -MAX_COORDINATE) & (highs <= MAX_COORDINATE)
    lows, highs = np.where(is_drawn, lows, -np.inf), np.where(is_drawn, highs, np.inf)
    upper = float(highs.max(initial=-math.inf))
    yield float(np.where(is_drawn, is_inside, MAX_COORDINATE).min(initial=math.inf)), upper
    # Bounds by the vertices that were nearest in earlier searches.
    objects = [
        (nodes[number].mesh, _model_w_row(boxes, number, row))
        for number in np.flatnonzero(boxes.in_view)
    ]
    yield min(_reuse_nearest_vertex(*mesh_and_row) for mesh_and_row in objects), upper
    # All vertices of the objects whose boxes are undecided.
    nearest, farthest = math.inf, -math.inf
    for k in np.argsort(lows):
        if lows[k] >= nearest:
            break
        nearest = min(nearest, _cached_w_range(*objects[k]).nearest)
    for k in np.argsort(-highs):
        if highs[k] <= farthest:
            break
        farthest = max(farthest, _cached_w_range(*objects[k]).farthest)
    yield nearest, farthest


WRow = tuple[float, ...]
"""Row of a matrix: w from x, y, z and 1 in model space."""


class WRange(NamedTuple):
    """Range of clip-space w of a mesh's drawn vertices."""

    nearest: float
    """inf if there are none."""
    farthest: float
    """-inf if there are none."""
    nearest_vertex: Float64
    """(3,), model space."""


_w_range_cache: WeakKeyDictionary[Mesh, dict[WRow, WRange]] = WeakKeyDictionary()

MAX_CACHED = 256
"""Most cached ranges of a mesh: one for each of its objects and cameras."""


def _model_w_row(boxes: Boxes, number: int, row: Float64) -> WRow:
    """Return the row of an object, given that of points relative to the eye."""
    m = boxes.relative_from_model[number]
    with np.errstate(all="ignore"):
        *factors, rest = ((row[0] * m[0] + row[1] * m[1]) + row[2] * m[2]).tolist()
    return (*factors, rest + float(row[3]))


def _reuse_nearest_vertex(mesh: Mesh, factors: WRow) -> float:
    """Return the w of the vertex that was nearest in the last search; the maximum without one."""
    for last in tuple(_w_range_cache.get(mesh, {}).values())[-1:]:
        w = float(_compute_w(last.nearest_vertex, factors))
        if abs(w) <= MAX_COORDINATE and last.nearest < math.inf:
            return w
    return MAX_COORDINATE


def _cached_w_range(mesh: Mesh, factors: WRow) -> WRange:
    """Return the range of w of an object, cached."""
    cache = _w_range_cache.setdefault(mesh, {})
    w_range = cache.get(factors)
    if w_range is None:
        w_range = _find_w_range(mesh, factors)
        if len(cache) >= MAX_CACHED:
            cache.clear()
        cache[factors] = w_range
    return w_range


def _find_w_range(mesh: Mesh, factors: WRow) -> WRange:
    """Compute the range of w from all vertices of an object."""
    vertices, extremes = mesh.vertices, []
    for first in range(0, len(vertices), VERTICES_PER_BLOCK):
        w = _compute_w(vertices[first : first + VERTICES_PER_BLOCK], factors)
        # The first NaN counts as both.
        extremes += [(float(w[n]), first + int(n)) for n in (w.argmin(), w.argmax())]
    if all(abs(w) <= MAX_COORDINATE for w, _ in extremes):
        least, greatest = min(extremes), max(extremes)
        if all((mesh.faces == n).any() for _, n in (least, greatest)):
            return WRange(least[0], greatest[0], vertices[least[1]].copy())
    # Leave out vertices that are too far, NaN, or unused.
    w = _compute_w(vertices, factors)
    numbers = np.flatnonzero(mesh.used_vertices() & (np.abs(w) <= MAX_COORDINATE))
    if not len(numbers):
        return WRange(math.inf, -math.inf, vertices[0].copy())
    vertex = int(numbers[w[numbers].argmin()])
    return WRange(float(w[vertex]), float(w[numbers].max()), vertices[vertex].copy())


def _compute_w(points: Float64, factors: WRow) -> Float64:
    """Return w of points, (..., 3) in model space."""
    a, b, c, d = factors
    with np.errstate(all="ignore"):
        return a * points[..., 0] + b * points[..., 1] + c * points[..., 2] + d


def make_ndc_format(name: str, sign: float) -> DepthFormat:
    """
    Return a format for clip positions alone, as if ``sign * z / w`` were the reversed depth.

    Parameters
    ----------
    name : str
        As ``Quality.depth_format`` has it.
    sign : float
        1 or -1: where a greater or a smaller z / w is nearer.
    """
    if name in REVERSED_TYPES:
        return _reversed_format(name, (0.0, sign, 0.0))
    return _ranged_format(name, sign, (1.0, -1.0), (0.0, 0.0))


def _reversed_format(name: str, coefficients: tuple[float, float, float]) -> DepthFormat:
    """Return a format that holds the reversed depth."""
    return DepthFormat(name, REVERSED_TYPES[name], coefficients, 0, None, (0.0, 0.0))


def _ranged_format(
    name: str, sign: float, ends: tuple[float, float], tilt: tuple[float, float]
) -> DepthFormat:
    """Return a format that stores depth between the near and the far plane, reversed."""
    if name in UNORM_BITS:
        largest = (1 << UNORM_BITS[name]) - 1
        # The half makes truncation round.
        coefficients = 0.0, sign * largest / 2.0, largest / 2.0 + 0.5
        return DepthFormat(name, np.int32, coefficients, largest, ends, tilt)
    return DepthFormat(name, np.float32, (0.0, sign * 0.5, -0.5), 0, ends, tilt)


def _refusal_reason(name: str) -> str:
    """Return the message for a camera without depths in a format."""
    return (
        "quality.depth_format must be float32-reversed or float64 for a camera whose clip-space z "
        f"does not grow with the distance, got {name!r}"
    )
