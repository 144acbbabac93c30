"""
Compute the normals and tangents of a mesh's vertices.

Normals are averaged over the faces around a vertex, or split along creases.

A tangent is the direction in which u grows on the surface: normal maps need it. A face has one if
it has an area in texture coordinates. A vertex has the mean tangent of the faces around it,
weighted by area. On one side of a seam the texture may be mirrored: there, u grows the other way.
So a vertex has two means: over the faces that show the texture as it is, and mirrored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.arrays import Bool, Float32, Float64, Int32, Int64
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.first_corners import rotate_corners
from rasterjit.scene.transforms import sine_cosine

_FACES_PER_CHUNK = 1 << 13
"""Faces or corners processed at once: large enough for NumPy, small beside a core's cache."""

_MAX_NEIGHBOURS = 512
"""Most faces at one creased position that are compared in pairs, which takes quadratic time."""

_COSINE_ROUNDING = 16.0 * float(np.finfo(np.float64).eps)
"""Bound on the rounding of the dot product of two unit normals: a face must match itself."""

_MAX_SAMPLED_VERTICES = 1 << 14
"""Most vertices whose edges are sampled to tell whether a mesh is creased."""

_FIRST_SAMPLED_VERTICES = 128
"""
Vertices sampled first: a mesh with less than half of the required creases there is smooth. For
5,120 faces this takes 0.6 times as long as smooth normals; sampling all took 2.7 times as long.
"""

_MIN_CREASES = 6
"""Least creases of a creased mesh: edges of a tetrahedron."""

_MIN_CREASED_SHARE = 0.05
"""Least share of creases: boxes have 0.67, cylinders of 32 sides 0.33, boxes of 768 faces 0.08."""

_MAX_HALF_CREASES = 0.5
"""
Most half creases, edges neither smooth nor creases, for each crease. Solids with flat sides have
few; scans whose noise makes creases have more than one.
"""

_MAX_CANCELLING_SHARE = 2.0**-30
"""Sums of area vectors up to this, relative to the largest vector, are tested for cancellation."""

_CANCELLATION_ROUNDING = 2.0**-40
"""Sums of area vectors up to this, relative to the sum of their sizes, are rounding alone: it is
that of thousands of faces."""

_TANGENT_FACES_PER_CHUNK = 1 << 18
"""Faces processed at once for tangents: large enough for NumPy, small beside the mesh."""

TANGENT_GROUPS = 2
"""Groups of faces with tangents of their own: the texture as it is, and mirrored."""


@dataclass(frozen=True)
class SplitVertices:
    """
    Vertices of a mesh after its creases were split.

    Parameters
    ----------
    faces : (F, 3) int32
        The same faces in the same order, numbering the new vertices.
    sources : (W,) int64
        The old vertex that each new vertex copies.
    normals : (W, 3) float32
        Unit normals of the new vertices; zero where no face with an area touches one.
    """

    faces: Int32
    sources: Int64
    normals: Float32


def dot_rows(a: Float64, b: Float64) -> Float64:
    """Return the dot products of (..., 3) vectors, summed in one order on every CPU."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def unit_rows(vectors: Float64) -> Float64:
    """
    Scale each row to unit length.

    Parameters
    ----------
    vectors : (n, 3) float64

    Returns
    -------
    (n, 3) float64
        Unit rows; rows that are zero, or hold NaN or infinity, become zero.
    """
    units = np.empty_like(vectors)
    for start in range(0, len(vectors), _FACES_PER_CHUNK):
        # Contiguous columns take a third of the time of rows of three.
        columns = np.array(vectors[start : start + _FACES_PER_CHUNK].T, order="C")
        units[start : start + _FACES_PER_CHUNK] = _normalize(columns).T
    return units


def _normalize(columns: Float64) -> Float64:
    """Scale vectors, (3, ...), to unit length in place, as `unit_rows` does; return them."""
    x, y, z = columns
    largest = np.maximum(np.maximum(np.abs(x), np.abs(y)), np.abs(z))
    is_invalid = ~((largest > 0.0) & (largest < np.inf))
    if is_invalid.any():
        columns[:, is_invalid], largest[is_invalid] = 0.0, 1.0
    # Scale first: squares of very long or very short vectors overflow or vanish.
    columns /= largest
    length = np.sqrt((x * x + y * y) + z * z)
    length[is_invalid] = 1.0
    columns /= length
    return columns


def compute_area_vectors(vertices: Float64, faces: Int32, scale: float) -> Float64:
    """
    Return the cross product of two edges of each face: its normal times twice its area.

    Parameters
    ----------
    vertices : (V, 3) float64
    faces : (F, 3) int32
    scale : float
        Factor on the vertices, from `safe_scale`.

    Returns
    -------
    (F, 3) float64
        Of the scaled vertices. Zero for faces without an area and for those that touch a NaN or
        infinite vertex.
    """
    faces = rotate_corners(vertices, faces)
    cross = np.empty((len(faces), 3))
    with np.errstate(invalid="ignore", over="ignore"):
        for start in range(0, len(faces), _FACES_PER_CHUNK):
            corners = faces[start : start + _FACES_PER_CHUNK].T
            a, b, c = (vertices.take(corner, axis=0).T * scale for corner in corners)
            edge_ab, edge_ac = b - a, c - a
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                part = edge_ab[j] * edge_ac[k] - edge_ab[k] * edge_ac[j]
                cross[start : start + _FACES_PER_CHUNK, i] = part
    finite = np.isfinite(cross)
    if not finite.all():
        cross[~finite.all(axis=1)] = 0.0
    return cross


def safe_scale(low: Float64, high: Float64) -> float:
    """Return the power of two that scales a box's largest coordinate to 0.5 .. 1."""
    largest = float(max(np.abs(low).max(), np.abs(high).max()))
    # Products with 2^±1000 neither overflow nor become subnormal.
    return math.ldexp(1.0, max(-1000, min(1000, -math.frexp(largest)[1])))


def compute_smooth_normals(
    vertices: Float64, faces: Int32, scale: float, groups: Int32 | None = None
) -> Float32:
    """
    Average the normals of the faces around every vertex, weighted by area.

    Parameters
    ----------
    vertices : (V, 3) float64
    faces : (F, 3) int32
    scale : float
        Factor on the vertices, from `safe_scale`.
    groups : (V,) int32, optional
        The number of each vertex's group: vertices of a group share the faces around them. Default:
        each vertex is a group.

    Returns
    -------
    (V, 3) float32
        Unit normals; zero where no face with an area touches the vertex. Where faces cancel, as
        those of a sheet with faces on both sides do, the normal of the first face's side. Sums run
        in face order, for the same bits on every run.
    """
    count = len(vertices) if groups is None else int(groups.max()) + 1
    sums, largest = np.zeros((3, count), dtype=np.float64), 0.0
    for start in range(0, len(faces), _FACES_PER_CHUNK):
        chunk = faces[start : start + _FACES_PER_CHUNK]
        vectors = compute_area_vectors(vertices, chunk, scale)
        largest = max(largest, float(vectors.max()), -float(vectors.min()))
        _add_at_corners(sums, chunk if groups is None else groups[chunk], vectors)
    sums_by_group = np.ascontiguousarray(sums.T)
    # Small sums may be of faces that cancel.
    is_small = np.abs(sums, out=sums).max(axis=0) <= _MAX_CANCELLING_SHARE * largest
    if is_small.any():
        vertex_groups = np.arange(count, dtype=np.int32) if groups is None else groups
        _replace_cancelling_sums(sums_by_group, is_small, vertices, faces, vertex_groups, scale)
    normals = unit_rows(sums_by_group).astype(np.float32)
    return normals if groups is None else normals[groups]


def repair_normals(
    normals: Float32, vertices: Float64, faces: Int32, scale: float
) -> tuple[Float32, int]:
    """
    Replace normals of length 0 by smooth ones.

    Parameters
    ----------
    normals : (V, 3) float32
        Of unit or zero length; not changed.
    vertices, faces, scale
        As `compute_smooth_normals` takes them.

    Returns
    -------
    normals : (V, 3) float32
        Zero where no face with an area touches the vertex.
    count : int
        Number of vertices that were repaired.
    """
    is_zero = ~np.any(normals, axis=1)
    adjacent = faces[np.any(is_zero[faces], axis=1)]
    computed = compute_smooth_normals(vertices, adjacent, scale)
    is_zero &= computed.any(axis=1)
    return np.where(is_zero[:, np.newaxis], computed, normals), int(np.count_nonzero(is_zero))


def _replace_cancelling_sums(
    sums: Float64, is_small: Bool, vertices: Float64, faces: Int32, groups: Int32, scale: float
) -> None:
    """
    Replace sums of faces that cancel by the sum of one side, that of the first face.

    Parameters
    ----------
    sums : (G, 3) float64
        Changed.
    is_small : (G,) bool
        Which sums may be replaced.
    vertices, faces, groups, scale
        As `compute_smooth_normals` takes them, but groups are required.
    """
    # Corners of faces with an area, in groups with small sums.
    adjacent = faces[is_small[groups[faces]].any(axis=1)]
    vectors = compute_area_vectors(vertices, adjacent, scale)
    has_area = vectors.any(axis=1)
    corner_groups = groups[adjacent[has_area]].ravel()
    vectors = np.repeat(vectors[has_area], 3, axis=0)
    is_chosen = is_small[corner_groups]
    corner_groups, vectors = corner_groups[is_chosen], vectors[is_chosen]
    # Groups whose faces cancel, and their corners.
    total = np.zeros(len(sums))
    np.add.at(total, corner_groups, np.abs(vectors).max(axis=1))
    largest = np.abs(sums).max(axis=1, initial=0.0)
    is_cancelling = is_small & (total > 0.0) & (largest <= _CANCELLATION_ROUNDING * total)
    is_chosen = is_cancelling[corner_groups]
    corner_groups, vectors = corner_groups[is_chosen], vectors[is_chosen]
    # Sums over the side of the first face.
    group_ids, first = np.unique(corner_groups, return_index=True)
    side_normal = np.zeros_like(sums)
    side_normal[group_ids] = vectors[first]
    is_same_side = dot_rows(vectors, side_normal[corner_groups]) > 0.0
    sums[is_cancelling] = 0.0
    for axis in range(3):
        np.add.at(sums[:, axis], corner_groups[is_same_side], vectors[is_same_side, axis])


def number_normal_groups(vertices: Float64, normals: Float32) -> Int32:
    """Return the group, (V,) int32, of each vertex: those with the same position and normal."""
    return distinct_rows(*vertices.T, *normals.T)[0].astype(np.int32)


def is_creased(vertices: Float64, faces: Int32, scale: float) -> bool:
    """
    Tell whether a mesh has creases, which smooth normals would round off.

    An edge is smooth if its two faces meet at less than 20 degrees, and a crease at 60 to 135. A
    creased mesh has many creases, and few edges that are neither. Boxes, cylinders and parts of
    machines are creased; balls of few faces, scans and noisy surfaces are not. Of a large mesh, a
    sample of vertices and their edges is tested.

    Parameters
    ----------
    vertices : (V, 3) float64
    faces : (F, 3) int32
    scale : float
        Factor on the vertices, from `safe_scale`.
    """
    # A few vertices, with a tolerance, suffice for most smooth meshes; then all or many.
    for max_vertices, tolerance in ((_FIRST_SAMPLED_VERTICES, 2.0), (_MAX_SAMPLED_VERTICES, 1.0)):
        if max_vertices == _FIRST_SAMPLED_VERTICES and len(vertices) <= 2 * max_vertices:
            continue
        count, creases, half_creases = _count_edges(vertices, faces, scale, max_vertices)
        if (
            tolerance * creases < max(_MIN_CREASES, _MIN_CREASED_SHARE * count)
            or half_creases > tolerance * _MAX_HALF_CREASES * creases
        ):
            return False
    return True


def _count_edges(
    vertices: Float64, faces: Int32, scale: float, max_vertices: int
) -> tuple[int, int, int]:
    """Count the shared edges at about ``max_vertices`` vertices: all, creases, half creases."""
    # Faces at sampled vertices.
    is_sampled = np.ones(len(vertices), bool)
    if len(vertices) > max_vertices:
        # Multiples of the golden ratio, modulo 1, are spread evenly over any run of vertices.
        hashes = np.arange(len(vertices), dtype=np.uint32) * np.uint32(2654435769)
        is_sampled = hashes < np.uint32((max_vertices << 32) // len(vertices))
        a, b, c = faces.T
        faces = faces[is_sampled[a] | is_sampled[b] | is_sampled[c]]
    directions = unit_rows(compute_area_vectors(vertices, faces, scale))
    has_area = directions.any(axis=1)
    faces, directions = faces[has_area], directions[has_area]
    # Pairs of faces that run along an edge in opposite directions.
    starts = faces.ravel().astype(np.int64)
    ends = np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    keys = np.minimum(starts, ends) * len(vertices) + np.maximum(starts, ends)
    order = np.flatnonzero(is_sampled[starts] | is_sampled[ends])
    order = order[np.argsort(keys[order], kind="stable")]
    first, second = order[:-1], order[1:]
    is_pair = (keys[first] == keys[second]) & (starts[first] != starts[second])
    # Their angles.
    cosines = dot_rows(directions[first[is_pair] // 3], directions[second[is_pair] // 3])
    smooth_cosine, crease_cosine, sharp_cosine = (
        sine_cosine(angle)[1] for angle in (20.0, 60.0, 135.0)
    )
    creases = np.count_nonzero(
        (cosines <= crease_cosine + _COSINE_ROUNDING) & (cosines >= sharp_cosine - _COSINE_ROUNDING)
    )
    half_creases = len(cosines) - creases - np.count_nonzero(cosines >= smooth_cosine)
    return len(cosines), int(creases), int(half_creases)


def _add_at_corners(sums: Float64, corners: NDArray[np.integer], vectors: Float64) -> None:
    """Add each face's vector, (F, 3), to the sums, (3, n), at its three corners, in face order."""
    indices = corners.ravel()
    for axis in range(3):
        np.add.at(sums[axis], indices, np.repeat(vectors[:, axis], 3))


def split_creases(
    vertices: Float64, faces: Int32, scale: float, angle: float, merge: bool
) -> SplitVertices:
    """
    Split vertices so that each corner gets the mean normal of the smooth surface around it.

    A face counts for a corner if its normal lies within ``angle`` of the normal of the corner's own
    face; it is weighted by its area. Positions are merged if their coordinates are the same bits.

    Parameters
    ----------
    vertices : (V, 3) float64
    faces : (F, 3) int32
    scale : float
        Factor on the vertices, from `safe_scale`.
    angle : float
        Crease angle, degrees in 0..180.
    merge : bool
        Whether vertices with the same position and normal become one vertex, for a mesh whose
        vertices hold nothing but their position; else each old vertex remains.

    Returns
    -------
    SplitVertices
    """
    # Mean normals of positions, and which of them are creased.
    position_of_vertex, first_of_position = distinct_rows(*vertices.T)
    positions = position_of_vertex.take(faces)
    areas = compute_area_vectors(vertices, faces, scale)
    sums = np.zeros((3, len(first_of_position)), dtype=np.float64)
    _add_at_corners(sums, positions, areas)
    means = unit_rows(np.ascontiguousarray(sums.T))
    directions = unit_rows(areas)
    has_area = dot_rows(directions, directions) > 0.0
    creased = _mark_creased_positions(positions, directions, has_area, means, angle)
    # Every vertex starts with the mean normal of its position.
    corner_vertices: NDArray[np.integer]
    if merge:
        corner_vertices, sources = positions, first_of_position
    else:
        corner_vertices, sources = faces, np.arange(len(vertices))
    normals = means.take(position_of_vertex[sources], axis=0).astype(np.float32) + np.float32(0.0)
    # Corners at creases get normals of their own, and further vertices where those differ.
    corners = np.flatnonzero(creased[positions.ravel()])
    corner_normals = _average_corner_normals(corners, positions.ravel(), areas, directions, angle)
    # A face without an area has no normal to compare: it takes the mean of its position.
    degenerate = np.flatnonzero(~has_area.take(corners // 3))
    corner_normals[degenerate] = means[positions.ravel()[corners[degenerate]]]
    corner_normals += np.float32(0.0)
    return _split_vertices(corner_vertices, sources, normals, corners, corner_normals)


def _mark_creased_positions(
    positions: Int64, directions: Float64, has_area: Bool, means: Float64, angle: float
) -> Bool:
    """
    Mark the positions where some face's normal is further than half the angle from the mean.

    Elsewhere all pairs of faces are within the angle of each other, so each corner's normal is the
    mean itself.
    """
    min_cosine = sine_cosine(angle / 2.0)[1] - _COSINE_ROUNDING
    creased = np.zeros(len(means), dtype=bool)
    for start in range(0, len(positions), _FACES_PER_CHUNK):
        stop = start + _FACES_PER_CHUNK
        direction = directions[start:stop]
        for k in range(3):
            corner = positions[start:stop, k]
            cosine = dot_rows(direction, means.take(corner, axis=0))
            creased[corner[(cosine < min_cosine) & has_area[start:stop]]] = True
    return creased


def _average_corner_normals(
    corners: Int64, position_of_corner: Int64, areas: Float64, directions: Float64, angle: float
) -> Float32:
    """
    Average, for each corner listed, the normals of faces at its position that match its own face's.

    Normals match within the angle. Where more than `_MAX_NEIGHBOURS` faces meet, as at the tip of a
    cone with many sides, each corner has the normal of its own face.
    """
    min_cosine = sine_cosine(angle)[1] - _COSINE_ROUNDING
    normals = np.empty((len(corners), 3), dtype=np.float32)
    position, own_face = position_of_corner.take(corners), corners // 3
    order = np.argsort(position, kind="stable")
    group_start = np.flatnonzero(np.diff(position.take(order), prepend=-1))
    group_size = np.diff(np.append(group_start, len(corners)))
    # Positions with the same number of corners are processed together, as (corner, group) blocks.
    for size in np.flatnonzero(np.bincount(group_size)).tolist():
        starts = group_start[group_size == size]
        groups_at_once = max(1, _FACES_PER_CHUNK // size)
        for g in range(0, len(starts), groups_at_once):
            group = order[starts[g : g + groups_at_once] + np.arange(size)[:, np.newaxis]]
            faces = own_face.take(group)
            x, y, z = direction = np.moveaxis(directions.take(faces, axis=0), 2, 0).copy()
            if size > _MAX_NEIGHBOURS:
                normals[group] = np.moveaxis(direction, 0, 2)
                continue
            area = np.moveaxis(areas.take(faces, axis=0), 2, 0).copy()
            sums = np.zeros_like(area)
            for k in range(size):
                is_near = (x * x[k] + y * y[k]) + z * z[k] >= min_cosine
                sums += is_near * area[:, k, np.newaxis]
            normals[group] = np.moveaxis(_normalize(sums), 0, 2)
    return normals


def _split_vertices(
    corner_vertices: NDArray[np.integer],
    sources: Int64,
    normals: Float32,
    corners: Int64,
    corner_normals: Float32,
) -> SplitVertices:
    """Give each distinct (vertex, normal) pair among the corners a vertex of its own."""
    faces = corner_vertices.astype(np.int32).ravel()
    if len(corners) == 0:
        return SplitVertices(faces.reshape(-1, 3), sources, normals)
    vertex = faces[corners]
    pair_ids, first = distinct_rows(vertex, *corner_normals.T)
    # The first normal at a vertex takes that vertex, the others get new ones.
    vertex = vertex[first]
    first_pair = np.empty(len(sources), dtype=np.int64)
    first_pair[vertex[::-1]] = np.arange(len(vertex))[::-1]
    is_new = first_pair[vertex] != np.arange(len(vertex))
    vertex_ids = np.where(is_new, len(sources) + np.cumsum(is_new) - 1, vertex)
    faces[corners] = vertex_ids[pair_ids]
    pair_normals = corner_normals[first]
    normals = np.concatenate([normals, pair_normals[is_new]])
    normals[vertex_ids[~is_new]] = pair_normals[~is_new]
    sources = np.concatenate([sources, sources[vertex[is_new]]])
    return SplitVertices(faces.reshape(-1, 3), sources, normals)


def vertex_tangents(
    vertices: Float64,
    faces: Int32,
    uv: Float32,
    scale: float,
    transform: tuple[float, ...] | None = None,
) -> Float32:
    """
    Return the tangents of each vertex, one for each of `TANGENT_GROUPS`.

    Parameters
    ----------
    vertices : (V, 3) float64, model space
    faces : (F, 3) int32
    uv : (V, 2) float32
        v runs up.
    scale : float
        Factor on the vertices, from `normals.safe_scale`.
    transform : six floats, optional
        As `Texture.transform` has it: tangents are those of the transformed coordinates.

    Returns
    -------
    (V, 2, 4) float32
        Unit tangents in model space, zero where no face of the group has one. The fourth number is
        1 where v grows to the left of the tangent, seen from the front of the face, and -1 where to
        the right. Whether a face is mirrored depends on ``uv`` before the transform.
    """
    sums = np.zeros((TANGENT_GROUPS, 3, len(vertices)), np.float64)
    for start in range(0, len(faces), _TANGENT_FACES_PER_CHUNK):
        chunk = faces[start : start + _TANGENT_FACES_PER_CHUNK]
        tangents, is_mirrored = _compute_face_tangents(vertices, chunk, uv, scale, transform)
        for group in range(TANGENT_GROUPS):
            in_group = is_mirrored == bool(group)
            corners = chunk[in_group].ravel()
            for axis in range(3):
                np.add.at(sums[group, axis], corners, np.repeat(tangents[in_group, axis], 3))
    result = np.empty((len(vertices), TANGENT_GROUPS, 4), np.float32)
    determinant = 1.0 if transform is None else _determinant(transform)
    for group in range(TANGENT_GROUPS):
        result[:, group, :3] = unit_rows(np.ascontiguousarray(sums[group].T))
        result[:, group, 3] = (-1.0 if determinant < 0.0 else 1.0) * (1.0 - 2.0 * group)
    return result


def _determinant(transform: tuple[float, ...]) -> float:
    """Return the determinant of a transform of texture coordinates; negative if it mirrors."""
    return transform[0] * transform[4] - transform[1] * transform[3]


def _compute_face_tangents(
    vertices: Float64, faces: Int32, uv: Float32, scale: float, transform: tuple[float, ...] | None
) -> tuple[Float64, Bool]:
    """Return each face's tangent times twice its area, (F, 3), and whether it is mirrored, (F,)."""
    a, b, c = (vertices[corner] * scale for corner in faces.T)
    with np.errstate(invalid="ignore", over="ignore"):
        edge_ab, edge_ac = b - a, c - a
        areas = compute_area_vectors(vertices, faces, scale)
        u, v = uv[:, 0].astype(np.float64), uv[:, 1].astype(np.float64)
        uv_ab, uv_ac = _uv_edges(faces, u, v, 1), _uv_edges(faces, u, v, 2)
        is_mirrored = uv_ab[0] * uv_ac[1] < uv_ac[0] * uv_ab[1]
        if transform is not None:
            uv_ab, uv_ac = _transform_uv(uv_ab, transform), _transform_uv(uv_ac, transform)
        uv_areas = uv_ab[0] * uv_ac[1] - uv_ac[0] * uv_ab[1]
        tangents = edge_ab * uv_ac[1][:, np.newaxis] - edge_ac * uv_ab[1][:, np.newaxis]
    sizes = np.sqrt(dot_rows(areas, areas)) * np.sign(uv_areas)
    tangents[~np.isfinite(tangents).all(axis=1) | ~np.isfinite(sizes)] = 0.0
    return unit_rows(tangents) * np.nan_to_num(sizes)[:, np.newaxis], is_mirrored


def _uv_edges(faces: Int32, u: Float64, v: Float64, corner: int) -> tuple[Float64, Float64]:
    """Return the differences of u and v, (F,) each, from the first corner of faces to another."""
    a, b = faces[:, 0], faces[:, corner]
    return u[b] - u[a], v[b] - v[a]


def _transform_uv(
    edges: tuple[Float64, Float64], transform: tuple[float, ...]
) -> tuple[Float64, Float64]:
    """Apply the linear part of a transform of texture coordinates to differences of u and v."""
    u, v = edges
    return transform[0] * u + transform[1] * v, transform[3] * u + transform[4] * v
