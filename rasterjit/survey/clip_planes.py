"""
Choose near and far planes that a camera leaves open, and report what given planes clip.

Bounding volumes settle most frames: boxes of objects, then, for an object that may reach a plane,
its sphere, and boxes of some hundred faces each. For the faces in the remaining boxes, the depth
range of the part inside the four sides of the frustum is found in float64. Open planes include
points and lines, each as large as the largest of its object. Points and lines clipped by given
planes are not reported.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.geometry import depth_range
from rasterjit.pipeline.geometry.depth_range import DEPTH_ROW, RELATIVE_ERROR, SIDES
from rasterjit.pipeline.passes import KernelRow, Rows
from rasterjit.scene import transforms
from rasterjit.scene.camera import MAX_PLANE_STEPS, Camera, NearFar, OrthographicCamera, near_far
from rasterjit.scene.lines import Lines
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node, meshes_of
from rasterjit.scene.points import Points
from rasterjit.scene.quality import Quality
from rasterjit.scene.vectors import cross, dot, length
from rasterjit.survey.depth_format import REVERSED_TYPES, min_resolved_depth
from rasterjit.survey.object_transforms import Boxes, dot_planes, is_between
from rasterjit.survey.packed_scene import writable

Float64 = NDArray[np.float64]

PLANE_MARGIN = 2.0**-7
"""Relative margin of an open near plane before all that is visible, and of a far plane beyond it:
more than float32 rounding of vertices."""

VIEW_MARGIN = 1.0 + 2.0**-10
"""Factor by which the view is widened, since snapping moves vertices."""

MAX_UNBOXED = 1 << 13
"""Most faces of a mesh that are tested without boxes: it takes no longer."""

MAX_CACHED = 256
"""Most cached results of a mesh: one for each of its objects and cameras."""

VERTICES_PER_CHUNK = 1 << 16
"""Vertices processed together, so that they stay in the cache."""

_SAFETY = 1.01
"""Factor that makes a bound safe when printed with three digits."""


class PlaneCut(NamedTuple):
    """Faces in view that a given near or far plane clips, whole or in part."""

    name: str
    """``"near"`` or ``"far"``."""
    faces: int
    plane: float
    """Distance of the plane, scene units."""
    needed: float
    """The distance at which it would clip nothing."""

    def merge(self, other: PlaneCut) -> PlaneCut:
        """Merge the clipping of two parts of a picture."""
        choose = min if self.name == "near" else max
        return self._replace(
            faces=self.faces + other.faces, needed=choose(self.needed, other.needed)
        )

    def __str__(self) -> str:
        faces = f"{self.faces} face{'s' if self.faces != 1 else ''}"
        if self.name == "near":
            enough = f"at most {self.needed / _SAFETY:.3g}" if self.needed > 0.0 else "no plane"
        else:
            enough = f"at least {self.needed * _SAFETY:.3g}"
        return f"cuts {faces} in view, whole or in part; {enough} cuts nothing"


class PlaneNeeds(NamedTuple):
    """Steps that open near and far planes need for depths in view, and clipping by given ones."""

    near_steps: int = 0
    """How often an open near plane must be halved to clip nothing."""
    max_near_steps: int = MAX_PLANE_STEPS
    """Most times that it may be halved."""
    far_steps: int = 0
    """How often an open far plane must be doubled to clip nothing."""
    cut: tuple[PlaneCut, ...] = ()
    """Clipping by given planes."""

    @property
    def steps(self) -> tuple[int, int]:
        """Arguments of `settled`."""
        return min(self.near_steps, self.max_near_steps), self.far_steps

    def merge(self, other: PlaneNeeds) -> PlaneNeeds:
        """Merge the needs of two views, or parts of one, that share near and far planes."""
        cuts: dict[str, PlaneCut] = {}
        for one in (*self.cut, *other.cut):
            cuts[one.name] = one.merge(cuts[one.name]) if one.name in cuts else one
        return PlaneNeeds(
            max(self.near_steps, other.near_steps),
            min(self.max_near_steps, other.max_near_steps),
            max(self.far_steps, other.far_steps),
            tuple(cuts.values()),
        )


NO_PLANE_NEEDS = PlaneNeeds()


def merge_needs(needs: Sequence[PlaneNeeds]) -> PlaneNeeds:
    """Merge the needs of views that share near and far planes."""
    return reduce(PlaneNeeds.merge, needs, NO_PLANE_NEEDS)


def find_plane_needs(
    camera: Camera,
    boxes: Boxes,
    nodes: Sequence[Node],
    clip_from_relative: Float64,
    quality: Quality,
) -> PlaneNeeds:
    """
    Find the depths in view outside a camera's planes.

    Parameters
    ----------
    camera : Camera
        An open plane counts where it is before any step.
    boxes : Boxes
        Around the objects.
    nodes : sequence of Node
        The objects.
    clip_from_relative : (4, 4) float64
    quality : Quality
        Its depth format says how near the near plane may come.
    """
    margins = find_clip_margins(camera, clip_from_relative)
    if margins is None:
        return NO_PLANE_NEEDS
    planes, row, (near, far) = margins.planes, margins.row, margins.ends
    max_steps = _count_max_near_steps(planes, boxes, quality) if planes.is_near_open else 0
    # Test the box around all objects.
    is_open = planes.is_near_open or planes.is_far_open
    uneven = find_uneven_spheres(nodes, boxes.relative_from_model) if is_open else []
    if not uneven and boxes.are_between(row.tolist(), near if near > 0.0 else -math.inf, far):
        return PlaneNeeds(max_near_steps=max_steps)
    # Test the box of each.
    crosses = boxes.may_cross(*margins.inside)
    if crosses.any() and not isinstance(camera, OrthographicCamera):
        # Where the far plane is many times as far as the near one, w is more precise than z.
        lows, highs, _ = boxes.compute_w_ranges(row, crosses)
        crosses[crosses] = ~((lows >= near) & (highs <= far))
    crosses[uneven] = True
    if not crosses.any():
        return PlaneNeeds(max_near_steps=max_steps)
    # Test the boxes of faces, and the faces.
    rows = np.concatenate((_frustum_sides(clip_from_relative), row[np.newaxis]))
    ranges = [EMPTY_RANGE]
    for k in np.flatnonzero(crosses).tolist():
        mesh, matrix = nodes[k].mesh, boxes.relative_from_model[k]
        if mesh.primitive == "triangles":
            ranges.append(_find_mesh_depths(mesh, rows, matrix, (near, far)))
        elif is_open and isinstance(mesh, Points | Lines):
            wide = np.concatenate(
                (_frustum_sides(boxes.widen_projection(clip_from_relative)), row[np.newaxis])
            )
            ranges.append(_find_primitive_depths(mesh, wide, matrix, (near, far)))
    nearest, farthest, before, beyond = (
        combine(values)
        for combine, values in zip((min, max, sum, sum), zip(*ranges, strict=True), strict=True)
    )
    return PlaneNeeds(
        _count_near_steps(planes, nearest) if planes.is_near_open else 0,
        max_steps,
        _count_far_steps(planes, farthest) if planes.is_far_open else 0,
        tuple(
            PlaneCut(name, int(count), *ends)
            for name, count, is_open, *ends in (
                ("near", before, planes.is_near_open, planes.near, nearest),
                ("far", beyond, planes.is_far_open, planes.far, farthest),
            )
            if count and not is_open
        ),
    )


def find_uneven_spheres(nodes: Sequence[Node], matrices: Float64) -> list[int]:
    """
    Return the numbers of objects that are spheres and may reach beyond their boxes.

    Non-uniform scales in the matrices, (O, 4, 4), scale the boxes, but spheres stay round.
    """
    return [
        k
        for k, mesh in enumerate(meshes_of(nodes))
        if isinstance(mesh, Points)
        and mesh.shape == "sphere"
        and _is_uneven(matrices[k, :3, :3].T.tolist())
    ]


def _is_uneven(columns: list[list[float]]) -> bool:
    """Tell whether axes, (3, 3), differ in length, or are not orthogonal."""
    x, y, z = columns
    a, b, c = dot(x, x), dot(y, y), dot(z, z)
    longest = max(a, b, c)
    skew = max(longest - min(a, b, c), abs(dot(x, y)), abs(dot(y, z)), abs(dot(z, x)))
    # NaN counts as unsure.
    return not skew <= PLANE_MARGIN * PLANE_MARGIN * longest


class ClipMargins(NamedTuple):
    """The depth range within which near and far planes clip nothing."""

    planes: NearFar
    row: Float64
    """(4,): its product with a point relative to the eye is the depth, scene units."""
    ends: tuple[float, float]
    """Least and greatest depth."""
    inside: tuple[float, float]
    """Their distance inside the near and the far plane, clip space; -inf -> anywhere."""


def find_clip_margins(camera: Camera, clip_from_relative: Float64) -> ClipMargins | None:
    """Return the depths between which a camera's planes clip nothing; ``None`` without planes."""
    planes = near_far(camera)
    # Planes chosen by rendering clip only what they must.
    if planes is None or planes.near_steps is not None or planes.far_steps is not None:
        return None
    near = planes.near / (1.0 - PLANE_MARGIN) if planes.is_near_open else max(planes.near, 0.0)
    far = planes.far * (1.0 - PLANE_MARGIN) if planes.is_far_open else planes.far
    row, distances = _depth_row(camera, planes, clip_from_relative)
    inside = (
        -math.inf if near <= 0.0 else distances[0] * (near / planes.near - 1.0),
        -math.inf if far == math.inf else distances[1] * (1.0 - far / planes.far),
    )
    return ClipMargins(planes, row, (near, far), inside)


def is_box_between(low: Float64, high: Float64, camera: Camera) -> bool:
    """Tell whether a box, corners (3,) in world space, lies between the open planes of a camera."""
    planes = near_far(camera)
    if planes is None or not (planes.is_near_open or planes.is_far_open):
        return True
    near = planes.near / (1.0 - PLANE_MARGIN) if planes.is_near_open else -math.inf
    far = planes.far * (1.0 - PLANE_MARGIN) if planes.is_far_open else math.inf
    depths = np.negative(camera.view_matrix()[2]).tolist()
    return is_between(low.tolist(), high.tolist(), depths, near, far)


def _depth_row(
    camera: Camera, planes: NearFar, clip_from_relative: Float64
) -> tuple[Float64, tuple[float, float]]:
    """
    Return the row that gives a point's depth, and the planes' distances in clip space.

    Returns
    -------
    row : (4,) float64
        Times a point relative to the eye: its distance along the viewing axis, scene units.
    distances : (float, float)
        Of the near and the far plane from the eye.
    """
    z, w = clip_from_relative[2], clip_from_relative[3]
    distances = abs(float(w[3] + z[3])), abs(float(w[3] - z[3]))
    if not isinstance(camera, OrthographicCamera):
        return w, distances
    half = (planes.far - planes.near) / 2.0
    row = half * z
    row[3] += planes.near + half
    return row, distances


def _frustum_sides(clip_from_relative: Float64) -> Float64:
    """Return planes that are >= 0 inside each side of the frustum: right, top, left, bottom."""
    x, y, w = clip_from_relative[0], clip_from_relative[1], VIEW_MARGIN * clip_from_relative[3]
    return np.stack((w - x, w - y, w + x, w + y))


def _count_near_steps(planes: NearFar, min_depth: float) -> int:
    """Return how often the near plane must be halved not to clip a depth."""
    max_plane, steps = min_depth * (1.0 - PLANE_MARGIN), 0
    while steps < MAX_PLANE_STEPS and planes.near / (1 << steps) > max_plane:
        steps += 1
    return steps


def _count_max_near_steps(planes: NearFar, boxes: Boxes, quality: Quality) -> int:
    """Return how often the near plane may be halved, limited by float64 and the depth format."""
    is_reversed = quality.depth_format in REVERSED_TYPES
    if is_reversed and planes.far == math.inf:
        return MAX_PLANE_STEPS
    min_plane = 2.0 * transforms.MIN_NEAR * planes.far if planes.far < math.inf else 0.0
    if not is_reversed:
        resolved = min_resolved_depth(quality.depth_format, quality.precision)
        min_plane = max(min_plane, 2.0 * resolved * min(boxes.compute_max_w(), planes.far))
    steps = 0
    while steps < MAX_PLANE_STEPS and planes.near / (2 << steps) >= min_plane:
        steps += 1
    return steps


def _count_far_steps(planes: NearFar, max_depth: float) -> int:
    """Return how often the far plane must be doubled not to clip a depth."""
    steps = 0
    while steps < MAX_PLANE_STEPS and planes.far * (1 << steps) * (1.0 - PLANE_MARGIN) < max_depth:
        steps += 1
    return steps


DepthRange = tuple[float, float, float, float]
"""Least and greatest visible depth of faces that reach a plane, inf and -inf for none; numbers of
those before the near plane and beyond the far one."""

EMPTY_RANGE = (math.inf, -math.inf, 0.0, 0.0)

CORNERS = {"triangles": 3, "lines": 2, "points": 1}
"""Corners of a face, by kind of object."""


def _find_primitive_depths(
    mesh: Points | Lines, rows: Float64, relative_from_model: Float64, planes: tuple[float, float]
) -> DepthRange:
    """
    Find the depth range of visible points or lines that reach a plane; counts none.

    Takes what `_find_mesh_depths` does, for a view widened by sizes in pixels.
    """
    if isinstance(mesh, Points) and mesh.shape == "sphere":
        return _find_sphere_depths(mesh, rows, relative_from_model, planes)
    # All but spheres have the depth of their centre.
    radius = _max_half_size(mesh, relative_from_model)
    rows = rows.copy()
    rows[:DEPTH_ROW, 3] += radius * _gradient_lengths(rows[:DEPTH_ROW])
    nearest, farthest, *_ = _find_mesh_depths(mesh, rows, relative_from_model, planes)
    return nearest, farthest, 0.0, 0.0


def _find_sphere_depths(
    mesh: Points, rows: Float64, relative_from_model: Float64, planes: tuple[float, float]
) -> DepthRange:
    """Find the depth range of visible spheres that reach a plane; counts none."""
    radius = _max_half_size(mesh, relative_from_model)
    gradients = _gradient_lengths(rows)
    depth_radius = float(radius * gradients[DEPTH_ROW])
    inner = planes[0] + depth_radius, planes[1] - depth_radius
    if _is_between(_find_bounding_sphere(mesh), rows[DEPTH_ROW], relative_from_model, inner):
        return EMPTY_RANGE
    matrix = np.ascontiguousarray(relative_from_model[:3])
    cache, key = _range_cache.setdefault(mesh, {}), (rows.tobytes() + matrix.tobytes(), planes)
    cached = cache.get(key)
    if cached is None:
        # All inside the sides, and before the near or beyond the far depth, may reach a plane.
        widened = rows.copy()
        widened[:, 3] += radius * gradients
        safe_depths = planes[0] + 2.0 * depth_radius, planes[1]
        with np.errstate(all="ignore"):
            widened = dot_planes(widened, matrix) + widened[:, 3:] * (0.0, 0.0, 0.0, 1.0)
            nearest, farthest = math.inf, -math.inf
            cosine = _compute_min_cosine(rows)
            box_numbers = _find_boxes_outside(mesh, widened, safe_depths)
            count = VERTICES_PER_CHUNK // depth_range.FACES_PER_BOX
            for first in range(0, len(box_numbers), count):
                starts = box_numbers[first : first + count, np.newaxis] * depth_range.FACES_PER_BOX
                indices = (starts + np.arange(depth_range.FACES_PER_BOX)).ravel()
                indices = indices[indices < len(mesh)]
                distances = dot_planes(widened, mesh.vertices[indices].T) + widened[:, 3:]
                depths = distances[DEPTH_ROW]
                may_reach = (distances[:DEPTH_ROW] >= 0.0).all(axis=0) & (depths > 0.0)
                numbers = indices[
                    may_reach & ((depths < safe_depths[0]) | (depths > safe_depths[1]))
                ]
                if len(numbers):
                    low, high = _find_visible_depths(mesh, numbers, rows, matrix, radius, cosine)
                    is_outside = (low < planes[0]) | (high > planes[1])
                    nearest = min(nearest, float(low.min(where=is_outside, initial=np.inf)))
                    farthest = max(farthest, float(high.max(where=is_outside, initial=-np.inf)))
        if len(cache) >= MAX_CACHED:
            cache.clear()
        cached = cache[key] = nearest, farthest, 0.0, 0.0
    return cached


def _find_visible_depths(
    mesh: Points, numbers: NDArray[np.int64], rows: Float64, matrix: Float64, radius: float,
    cosine: float,
) -> tuple[Float64, Float64]:  # fmt: skip
    """
    Return the depth range in which spheres may be visible, (N,) each: inf and -inf if not.

    Parameters
    ----------
    mesh : Points
    numbers : (N,) int64
        Of the spheres.
    rows : (5, 4) float64
        As `_find_mesh_depths` takes them.
    matrix : (3, 4) float64
        From model space, relative to the eye.
    radius : float
        Of the largest sphere of the mesh, scene units.
    cosine : float
        What `_compute_min_cosine` returns.
    """
    sizes = mesh.sizes if len(mesh.sizes) == 1 else mesh.sizes[numbers]
    radii = sizes / mesh.sizes.max() * radius
    centers = dot_planes(matrix, mesh.vertices[numbers].T) + matrix[:, 3:]
    distances = dot_planes(rows, centers) + rows[:, 3:]
    plane_radii = _gradient_lengths(rows)[:, np.newaxis] * radii
    depths, depth_radii = distances[DEPTH_ROW], plane_radii[DEPTH_ROW]
    is_visible = (distances[:DEPTH_ROW] + plane_radii[:DEPTH_ROW] >= 0.0).all(axis=0) & (
        depths + depth_radii > 0.0
    )
    low = np.maximum(depths - depth_radii, 0.0)
    if cosine > 0.0:
        x, y, z = centers
        distance = np.sqrt((x * x + y * y) + z * z)
        # No ray hits a sphere nearer than its surface is to the eye.
        low = np.maximum(low, cosine * (np.abs(distance - radii) - RELATIVE_ERROR * distance))
        # Spheres outside a cone around the view are not visible.
        sine = np.minimum(radii / distance, 1.0)
        min_cosine = cosine * np.sqrt(1.0 - sine * sine) - math.sqrt(1.0 - cosine * cosine) * sine
        is_visible &= (distance <= radii) | (depths >= (min_cosine - RELATIVE_ERROR) * distance)
    return np.where(is_visible, low, np.inf), np.where(is_visible, depths + depth_radii, -np.inf)


def _compute_min_cosine(rows: Float64) -> float:
    """Return the least depth per distance along rays in view; 0 if rays do not meet."""
    # Depth is 0, and all sides meet, at the eye.
    if (np.abs(rows[:, 3]) > RELATIVE_ERROR * _gradient_lengths(rows)).any():
        return 0.0
    normals, depth, cosines = rows[:DEPTH_ROW, :3].tolist(), rows[DEPTH_ROW, :3].tolist(), []
    for k in range(SIDES):
        edge = cross(normals[k], normals[(k + 1) % SIDES])
        cosines.append(abs(dot(edge, depth)) / (length(edge) or 1.0))
    return min(1.0, *cosines)


def _gradient_lengths(rows: Float64) -> Float64:
    """Return the gradient length of each row, (N, 4), per scene unit, (N,)."""
    x, y, z = rows[:, :3].T
    return np.sqrt((x * x + y * y) + z * z)


def _max_half_size(mesh: Points | Lines, relative_from_model: Float64) -> float:
    """Return half the largest size of points or lines, scene units; 0 if sizes are in pixels."""
    if mesh.unit != "world":
        return 0.0
    sizes = mesh.sizes if isinstance(mesh, Points) else mesh.widths
    x, y, z = relative_from_model[:3, :3]
    # Sizes scale by the matrix's largest axis scale.
    square = float(((x * x + y * y) + z * z).max())
    return 0.5 * float(sizes.max(initial=0.0)) * math.sqrt(square)


def _find_mesh_depths(
    mesh: Mesh, rows: Float64, relative_from_model: Float64, planes: tuple[float, float]
) -> DepthRange:
    """
    Find the depth range of visible faces of an object that reach a plane.

    Parameters
    ----------
    mesh : Mesh
    rows : (5, 4) float64
        Four sides of the view, then depth, of points relative to the eye.
    relative_from_model : (4, 4) float64
    planes : (float, float)
        Depths of the near and the far plane.
    """
    if _is_between(_find_bounding_sphere(mesh), rows[DEPTH_ROW], relative_from_model, planes):
        return EMPTY_RANGE
    with np.errstate(all="ignore"):
        rows = dot_planes(rows, relative_from_model[:3]) + rows[:, 3:] * (0.0, 0.0, 0.0, 1.0)
    cache, key = _range_cache.setdefault(mesh, {}), (rows.tobytes(), planes)
    cached = cache.get(key)
    if cached is None:
        result = np.array(EMPTY_RANGE)
        box_numbers = _find_boxes_outside(mesh, rows, planes)
        if len(box_numbers):
            depth_range.find_visible_depths(
                writable(mesh.vertices), writable(mesh.faces), box_numbers, rows, planes,
                CORNERS[mesh.primitive], result, np.empty((8, 4)),
            )  # fmt: skip
        if len(cache) >= MAX_CACHED:
            cache.clear()
        cached = cache[key] = tuple(result.tolist())
    return cached


def _is_between(
    sphere: _MeshSphere, row: Float64, relative_from_model: Float64, planes: tuple[float, float]
) -> bool:
    """Tell whether a sphere lies between two planes, given the row of a point's depth."""
    a, b, c, d = row.tolist()
    columns = [a * x + b * y + c * z for x, y, z, _ in relative_from_model.T.tolist()]
    x, y, z, constant = columns
    depth = x * sphere.x + y * sphere.y + z * sphere.z + (constant + d)
    terms = abs(x * sphere.x) + abs(y * sphere.y) + abs(z * sphere.z) + (abs(constant) + abs(d))
    radius = sphere.radius * math.sqrt(x * x + y * y + z * z) + RELATIVE_ERROR * terms
    return depth - radius >= planes[0] and depth + radius <= planes[1]


def _find_boxes_outside(
    mesh: Mesh, rows: Float64, planes: tuple[float, float]
) -> NDArray[np.int64]:
    """Return the boxes of faces that may be visible outside the planes, by rows in model space."""
    if len(mesh.faces) <= MAX_UNBOXED:
        return np.arange(-(-len(mesh.faces) // depth_range.FACES_PER_BOX))
    boxes = _bound_face_boxes(mesh)
    with np.errstate(all="ignore"):
        centers = dot_planes(rows, boxes.middle) + rows[:, 3:]
        half_ranges = dot_planes(np.abs(rows), boxes.half)
        half_ranges += RELATIVE_ERROR * (
            dot_planes(np.abs(rows), np.abs(boxes.middle)) + np.abs(rows[:, 3:])
        )
        lows, highs = centers - half_ranges, centers + half_ranges
    # NaN counts as unsure.
    is_out = (highs[:DEPTH_ROW] < 0.0).any(axis=0) | (highs[DEPTH_ROW] <= 0.0)
    is_out |= (lows[DEPTH_ROW] >= planes[0]) & (highs[DEPTH_ROW] <= planes[1])
    return np.flatnonzero(~is_out)


class _MeshSphere(NamedTuple):
    """Bounding sphere of a mesh, model space."""

    x: float
    y: float
    z: float
    radius: float


class _FaceBoxes(NamedTuple):
    """Boxes around the faces of a mesh, model space."""

    middle: Float64
    """(3, B)."""
    half: Float64
    """Half the size of each, (3, B)."""


_range_cache: WeakKeyDictionary[Mesh, dict[tuple[bytes, tuple[float, float]], DepthRange]] = (
    WeakKeyDictionary()
)
_spheres: WeakKeyDictionary[Mesh, _MeshSphere] = WeakKeyDictionary()
_face_boxes: WeakKeyDictionary[Mesh, _FaceBoxes] = WeakKeyDictionary()


def _find_bounding_sphere(mesh: Mesh) -> _MeshSphere:
    """Return the bounding sphere of a mesh, centred on its box, cached."""
    sphere = _spheres.get(mesh)
    if sphere is None:
        low, high = mesh.bounds()
        center, max_square = low / 2.0 + high / 2.0, 0.0
        vertices, is_used = mesh.vertices, mesh.used_vertices()
        for first in range(0, len(vertices), VERTICES_PER_CHUNK):
            chunk = slice(first, first + VERTICES_PER_CHUNK)
            with np.errstate(over="ignore"):
                x, y, z = (vertices[chunk][is_used[chunk]] - center).T
                squares = (x * x + y * y) + z * z
            max_square = max(max_square, float(squares.max(initial=0.0)))
        sphere = _spheres[mesh] = _MeshSphere(*center.tolist(), math.sqrt(max_square))
    return sphere


def _bound_face_boxes(mesh: Mesh) -> _FaceBoxes:
    """Return the bounding boxes of faces of a mesh, cached."""
    boxes = _face_boxes.get(mesh)
    if boxes is None:
        low, high = np.empty((2, 3, -(-len(mesh.faces) // depth_range.FACES_PER_BOX)))
        depth_range.bound_faces(writable(mesh.vertices), writable(mesh.faces), low, high)
        boxes = _FaceBoxes(low / 2.0 + high / 2.0, high / 2.0 - low / 2.0)
        _face_boxes[mesh] = boxes
    return boxes


def kernels_of(camera: Camera) -> Rows:
    """Return the kernels that test faces against a camera's planes."""
    if near_far(camera) is None:
        return []
    reached = "an object may reach the near or far plane"
    return [
        KernelRow(depth_range.bound_faces, "", f"{reached} and has more than {MAX_UNBOXED} faces"),
        KernelRow(depth_range.find_visible_depths, "", reached),
    ]


def describe_planes(camera: Camera, clipped: Sequence[PlaneCut]) -> list[tuple[str, str]]:
    """Return rows of text about a camera's planes: where they are, why, and what they clip."""
    planes = near_far(camera)
    if planes is None:
        return []
    rows = []
    if planes.near > 0.0:
        rows.append(("near", _describe_plane(planes.near, planes.near_steps, "/")))
    if planes.far < math.inf:
        rows.append(("far", _describe_plane(planes.far, planes.far_steps, "*")))
    return [
        (name, "; ".join([text, *(str(item) for item in clipped if item.name == name)]))
        for name, text in rows
    ]


def _describe_plane(distance: float, steps: int | None, sign: str) -> str:
    """Describe the distance of a plane, and whether rendering chose it."""
    if steps is None:
        return f"{distance:.6g} (given)"
    default = distance * (1 << steps) if sign == "/" else distance / (1 << steps)
    return f"{distance:.6g} (chosen: {default:.6g} {sign} 2^k, k = {steps})"
