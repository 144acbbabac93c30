"""
Compute positions and normals of samples on points: squares, discs and spheres.

A sphere is intersected again with the pixel's ray, as in ``point_coverage``. Other points have the
normals that they were given, flipped to the visible side; without any they face the viewer.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import find_object, place_vertex
from rasterjit.pipeline.records import Placement, Viewport
from rasterjit.pipeline.surface import samples as row
from rasterjit.pipeline.surface.samples import (
    COLUMN,
    COLUMN_OF,
    END_PATCH,
    FACE,
    FIRST,
    FIRST_PATCH,
    IS_LIT,
    KIND,
    NORMAL,
    OWNER,
    POINT,
    ROW,
    ROW_OF,
    SEGMENTS,
    SPAN,
    START,
    A,
    Block,
)
from rasterjit.pipeline.visibility.point_coverage import (
    NOT_POINTS,
    SPHERE,
    PointRows,
    Sight,
    depth_on_sphere,
    meet_sphere,
    ndc_of,
    radius_of,
)
from rasterjit.runtime.jit import helper, kernel, stage
from rasterjit.runtime.state import float32, float64, int32, int64


@helper
def pixel_of(n, segment, whole):
    """Return the column and the row of a sample."""
    if segment[KIND] == SPAN:
        return np.int64(segment[COLUMN_OF]) + (n - segment[START]), np.int64(segment[ROW_OF])
    return np.int64(whole[COLUMN, n]), np.int64(whole[ROW, n])


@helper
def way_on_sphere(face, vertex, owner, pixel, points, sight, placement, viewport):
    """Return a sphere's centre, relative to the eye, and the offset from it to a pixel's hit."""
    centre = place_vertex(vertex, owner, placement)
    radius = radius_of(points, owner, face - placement.face_starts[owner])
    ndc = ndc_of(pixel[0], pixel[1], viewport)
    offset, _ = meet_sphere(centre, radius, ndc, sight)
    return centre, offset


@helper
def toward_viewer(point, placement):
    """Return the direction from a point to the viewer, any length."""
    v = placement.toward_viewer
    return v[0] - v[3] * point[0], v[1] - v[3] * point[1], v[2] - v[3] * point[2]


@helper
def turned_to(normal, way):
    """Return a normal flipped to the side of a direction; the direction if there is no normal."""
    side = normal[0] * way[0] + normal[1] * way[1] + normal[2] * way[2]
    if normal[0] == 0.0 and normal[1] == 0.0 and normal[2] == 0.0:
        return way
    if side < 0.0:
        return -normal[0], -normal[1], -normal[2]
    return normal


@helper
def unit(x, y, z):
    """Return a vector of length one; scaled first, so that no square overflows or vanishes."""
    largest = max(abs(x), max(abs(y), abs(z)))
    shrink = 1.0 / largest if largest > 0.0 else 0.0
    x, y, z = x * shrink, y * shrink, z * shrink
    length = np.sqrt(x * x + y * y + z * z)
    scale = 1.0 / length if length > 0.0 else 0.0
    return x * scale, y * scale, z * scale


@helper
def put_three(rows, first, n, values):
    """Write three numbers of a sample."""
    for k in range(3):
        rows[first + k, n] = rows.dtype.type(values[k])


@stage
def find_point_shapes(
    block: Block, count, points: PointRows, sight: Sight, viewport: Viewport, placement: Placement
):
    """Write points and normals of the samples of spheres, and normals of other points."""
    samples, whole = block.samples, block.whole
    for k in range(block.counts[SEGMENTS]):
        segment = block.segments[k]
        owner = np.int64(segment[OWNER])
        shape = points.shapes[owner, 0]
        if shape == NOT_POINTS:
            continue
        for r in range(np.uintp(segment[FIRST_PATCH]), np.uintp(segment[END_PATCH])):
            face, vertex = np.int64(whole[FACE, r]), np.uintp(whole[A, r])
            for n in range(np.uintp(whole[FIRST, r]), np.uintp(whole[FIRST, r + np.uintp(1)])):
                if shape == SPHERE:
                    pixel = pixel_of(n, segment, whole)
                    centre, normal = way_on_sphere(
                        face, vertex, owner, pixel, points, sight, placement, viewport
                    )
                    point = centre[0] + normal[0], centre[1] + normal[1], centre[2] + normal[2]
                    put_three(samples, row.POINT_X, n, point)
                else:
                    point = (
                        np.float64(samples[row.POINT_X, n]), np.float64(samples[row.POINT_Y, n]),
                        np.float64(samples[row.POINT_Z, n]),
                    )  # fmt: skip
                    normal = (
                        np.float64(samples[row.NORMAL_X, n]), np.float64(samples[row.NORMAL_Y, n]),
                        np.float64(samples[row.NORMAL_Z, n]),
                    )  # fmt: skip
                seen = turned_to(normal, toward_viewer(point, placement))
                put_three(samples, row.NORMAL_X, n, unit(seen[0], seen[1], seen[2]))


@stage
def find_point_receivers(
    block: Block, count, points: PointRows, sight: Sight, viewport: Viewport, placement: Placement
):
    """
    Write shadow receivers on points: their normals, and positions of samples on spheres.

    Right behind `receivers.find_receivers`.
    """
    samples, whole, r = block.samples, block.whole, block.receivers
    if block.counts[IS_LIT] == 0:
        return
    for k in range(block.counts[SEGMENTS]):
        segment = block.segments[k]
        owner = np.int64(segment[OWNER])
        shape = points.shapes[owner, 0]
        if shape == NOT_POINTS:
            continue
        for p in range(np.uintp(segment[FIRST_PATCH]), np.uintp(segment[END_PATCH])):
            face, vertex = np.int64(whole[FACE, p]), np.uintp(whole[A, p])
            for n in range(np.uintp(whole[FIRST, p]), np.uintp(whole[FIRST, p + np.uintp(1)])):
                if shape == SPHERE:
                    pixel = pixel_of(n, segment, whole)
                    centre, way = way_on_sphere(
                        face, vertex, owner, pixel, points, sight, placement, viewport
                    )
                    point = centre[0] + way[0], centre[1] + way[1], centre[2] + way[2]
                    put_three(r, POINT, n, point)
                    put_three(r, NORMAL, n, way)
                else:
                    normal = (
                        np.float64(samples[row.NORMAL_X, n]), np.float64(samples[row.NORMAL_Y, n]),
                        np.float64(samples[row.NORMAL_Z, n]),
                    )  # fmt: skip
                    put_three(r, NORMAL, n, normal)


@kernel
def fill_sphere_positions(
    face_id: int32[:, ::1], rows: (int64, int64), faces: int32[:, ::1], points: PointRows,
    sight: Sight, viewport: Viewport, placement: Placement, matrices: float64[:, :, ::1],
    from_world: float64[:, :, ::1], position: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the position of each sample of a sphere.

    Parameters
    ----------
    face_id : (H, W) int32
    rows : (int, int)
        First row, and one past the last.
    faces : (F, 3) int32, vertex numbers
    points, sight, viewport, placement : records
    matrices : (O, 3, 4) float64
        What takes centres, model space, to the space of the positions.
    from_world : (O, 3, 3) float64
        What takes ways in world axes there.
    position : (H, W, 3) float32
        Written where spheres are.
    """
    p, m, t = placement.positions, matrices, from_world
    owner = np.int64(0)
    for y in range(rows[0], rows[1]):
        for x in range(face_id.shape[1]):
            face = np.int64(face_id[y, x])
            if face < 0:
                continue
            owner = find_object(face, placement.face_starts, owner)
            if points.shapes[owner, 0] != SPHERE:
                continue
            v = np.uintp(faces[face, 0])
            _, way = way_on_sphere(face, v, owner, (x, y), points, sight, placement, viewport)
            for k in range(3):
                centre = (
                    m[owner, k, 0] * p[v, 0] + m[owner, k, 1] * p[v, 1] + m[owner, k, 2] * p[v, 2]
                    + m[owner, k, 3]
                )  # fmt: skip
                position[y, x, k] = centre + (
                    t[owner, k, 0] * way[0] + t[owner, k, 1] * way[1] + t[owner, k, 2] * way[2]
                )


@kernel
def fill_point_depths(
    face_id: int32[:, ::1], rows: (int64, int64), faces: int32[:, ::1], points: PointRows,
    sight: Sight, viewport: Viewport, placement: Placement,
    depth_coefficients: (float64, float64, float64), depth: float32[:, ::1],
):  # fmt: skip
    """
    Write the stored depth of each sample of a point.

    Parameters
    ----------
    face_id : (H, W) int32
    rows : (int, int)
    faces : (F, 3) int32, vertex numbers
    points, sight, viewport, placement : records
    depth_coefficients : (float, float, float)
        The stored depth is ``(c0 + c1 z + c2 w) / w``; greater is nearer.
    depth : (H, W) float32
        Written where points are.
    """
    owner = np.int64(0)
    for y in range(rows[0], rows[1]):
        for x in range(face_id.shape[1]):
            face = np.int64(face_id[y, x])
            if face < 0:
                continue
            owner = find_object(face, placement.face_starts, owner)
            shape = points.shapes[owner, 0]
            if shape == NOT_POINTS:
                continue
            v = np.uintp(faces[face, 0])
            centre, way = place_vertex(v, owner, placement), (0.0, 0.0, 0.0)
            if shape == SPHERE:
                centre, way = way_on_sphere(
                    face, v, owner, (x, y), points, sight, placement, viewport
                )
            depth[y, x] = depth_on_sphere(centre, way, sight, depth_coefficients)


@kernel
def fill_point_normals(
    face_id: int32[:, ::1], rows: (int64, int64), faces: int32[:, ::1], points: PointRows,
    sight: Sight, viewport: Viewport, placement: Placement, normal: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the unit normal of each sample of a point: see `find_point_shapes`.

    Parameters
    ----------
    face_id : (H, W) int32
    rows : (int, int)
    faces : (F, 3) int32, vertex numbers
    points, sight, viewport, placement : records
    normal : (H, W, 3) float32, world axes
        Changed where points are: read where they have normals, which are not zero.
    """
    owner = np.int64(0)
    for y in range(rows[0], rows[1]):
        for x in range(face_id.shape[1]):
            face = np.int64(face_id[y, x])
            if face < 0:
                continue
            owner = find_object(face, placement.face_starts, owner)
            shape = points.shapes[owner, 0]
            if shape == NOT_POINTS:
                continue
            v = np.uintp(faces[face, 0])
            if shape == SPHERE:
                centre, own = way_on_sphere(
                    face, v, owner, (x, y), points, sight, placement, viewport
                )
                point = centre[0] + own[0], centre[1] + own[1], centre[2] + own[2]
            else:
                point = place_vertex(v, owner, placement)
                own = (
                    np.float64(normal[y, x, 0]), np.float64(normal[y, x, 1]),
                    np.float64(normal[y, x, 2]),
                )  # fmt: skip
            seen = turned_to(own, toward_viewer(point, placement))
            seen = unit(seen[0], seen[1], seen[2])
            for k in range(3):
                normal[y, x, k] = seen[k]
