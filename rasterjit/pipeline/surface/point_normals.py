"""
Compute positions and normals of samples on points: squares, discs and spheres.

A sphere is intersected again with the pixel's ray, as in ``point_rasterizer``. Other points have
the normals that they were given, flipped to the visible side; without any they face the viewer.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import (
    find_object,
    normalize,
    point_to_viewer,
    transform_vertex,
)
from rasterjit.pipeline.records import Placement, Viewport
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import get_patch_samples, get_pixel
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.visibility import point_rasterizer
from rasterjit.pipeline.visibility.point_rasterizer import PointRows, PointView
from rasterjit.runtime.jit import helper, kernel, stage
from rasterjit.runtime.state_block import float32, float64, int32, int64


@helper
def intersect_sphere(face, vertex, owner, pixel, points, eye, placement, viewport):
    """Return a sphere's centre, relative to the eye, and the offset to what a pixel hits."""
    centre = transform_vertex(vertex, owner, placement)
    radius = point_rasterizer.get_radius(points, owner, face - placement.face_starts[owner])
    ndc = point_rasterizer.get_ndc(pixel[0], pixel[1], viewport)
    offset, _ = point_rasterizer.intersect_ray_with_sphere(centre, radius, ndc, eye)
    return centre, offset


@helper
def find_sphere_point(face, vertex, owner, pixel, points, eye, placement, viewport):
    """Return the point of a sphere that a pixel hits, relative to the eye, and its normal."""
    c, offset = intersect_sphere(face, vertex, owner, pixel, points, eye, placement, viewport)
    return (c[0] + offset[0], c[1] + offset[1], c[2] + offset[2]), offset


@helper
def flip_toward(normal, direction):
    """Return a normal, flipped to the side of a direction; the direction if the normal is zero."""
    cosine = normal[0] * direction[0] + normal[1] * direction[1] + normal[2] * direction[2]
    if normal[0] == 0.0 and normal[1] == 0.0 and normal[2] == 0.0:
        return direction
    if cosine < 0.0:
        return -normal[0], -normal[1], -normal[2]
    return normal


@helper
def load_vector(array, first, n):
    """Read a sample's vector from three rows."""
    x, y, z = array[first, n], array[first + 1, n], array[first + 2, n]
    return np.float64(x), np.float64(y), np.float64(z)


@helper
def store_vector(array, first, n, values):
    """Write a sample's vector to three rows."""
    for k in range(3):
        array[first + k, n] = array.dtype.type(values[k])


@stage
def find_point_normals(
    block: Block, count, points: PointRows, eye: PointView, viewport: Viewport, placement: Placement
):
    """Write points and normals of the samples of spheres, and normals of other points."""
    samples, ints = block.samples, block.ints
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.int64(segment[rows.OWNER])
        shape = points.shapes[owner, 0]
        if shape == point_rasterizer.NOT_POINTS:
            continue
        for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
            face, vertex = np.int64(ints[rows.FACE, r]), np.uintp(ints[rows.A, r])
            start, end = get_patch_samples(ints, r)
            for n in range(start, end):
                point = load_vector(samples, rows.POINT_X, n)
                normal = load_vector(samples, rows.NORMAL_X, n)
                if shape == point_rasterizer.SPHERE:
                    pixel = get_pixel(n, segment, ints)
                    point, normal = find_sphere_point(
                        face, vertex, owner, pixel, points, eye, placement, viewport
                    )
                    store_vector(samples, rows.POINT_X, n, point)
                facing = flip_toward(normal, point_to_viewer(point, placement))
                store_vector(samples, rows.NORMAL_X, n, normalize(facing[0], facing[1], facing[2]))


@stage
def find_point_receivers(
    block: Block, count, points: PointRows, eye: PointView, viewport: Viewport, placement: Placement
):
    """
    Write shadow receivers on points: normals, and positions of samples on spheres.

    Right after `receivers.find_receivers`.
    """
    samples, ints, receivers = block.samples, block.ints, block.receivers
    if block.counts[rows.IS_LIT] == 0:
        return
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.int64(segment[rows.OWNER])
        shape = points.shapes[owner, 0]
        if shape == point_rasterizer.NOT_POINTS:
            continue
        for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
            face, vertex = np.int64(ints[rows.FACE, r]), np.uintp(ints[rows.A, r])
            start, end = get_patch_samples(ints, r)
            for n in range(start, end):
                normal = load_vector(samples, rows.NORMAL_X, n)
                if shape == point_rasterizer.SPHERE:
                    pixel = get_pixel(n, segment, ints)
                    point, normal = find_sphere_point(
                        face, vertex, owner, pixel, points, eye, placement, viewport
                    )
                    store_vector(receivers, rows.RECEIVER_POINT, n, point)
                store_vector(receivers, rows.RECEIVER_NORMAL, n, normal)


@kernel
def fill_sphere_positions(
    face_id: int32[:, ::1], row_range: (int64, int64), faces: int32[:, ::1], points: PointRows,
    eye: PointView, viewport: Viewport, placement: Placement, matrices: float64[:, :, ::1],
    from_world: float64[:, :, ::1], position: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the position of each sample of a sphere.

    Parameters
    ----------
    face_id : (H, W) int32
    row_range : (int, int)
        First row, and one past the last.
    faces : (F, 3) int32, vertex numbers
    points, eye, viewport, placement : records
    matrices : (O, 3, 4) float64
        Transforms of centres from model space to the space of the positions.
    from_world : (O, 3, 3) float64
        Linear parts of the transforms from world axes to the space of the positions.
    position : (H, W, 3) float32
        Written where spheres are.
    """
    p, m, t = placement.positions, matrices, from_world
    owner = np.int64(0)
    for y in range(row_range[0], row_range[1]):
        for x in range(face_id.shape[1]):
            face = np.int64(face_id[y, x])
            if face < 0:
                continue
            owner = find_object(face, placement.face_starts, owner)
            if points.shapes[owner, 0] != point_rasterizer.SPHERE:
                continue
            v = np.uintp(faces[face, 0])
            _, hit = intersect_sphere(face, v, owner, (x, y), points, eye, placement, viewport)
            for k in range(3):
                centre = (
                    m[owner, k, 0] * p[v, 0] + m[owner, k, 1] * p[v, 1] + m[owner, k, 2] * p[v, 2]
                    + m[owner, k, 3]
                )  # fmt: skip
                position[y, x, k] = centre + (
                    t[owner, k, 0] * hit[0] + t[owner, k, 1] * hit[1] + t[owner, k, 2] * hit[2]
                )


@kernel
def fill_point_depths(
    face_id: int32[:, ::1], row_range: (int64, int64), faces: int32[:, ::1], points: PointRows,
    eye: PointView, viewport: Viewport, placement: Placement,
    depth_coefficients: (float64, float64, float64), depth: float32[:, ::1],
):  # fmt: skip
    """
    Write the stored depth of each sample of a point.

    Parameters
    ----------
    face_id : (H, W) int32
    row_range : (int, int)
    faces : (F, 3) int32, vertex numbers
    points, eye, viewport, placement : records
    depth_coefficients : (float, float, float)
        The stored depth is ``(c0 + c1 z + c2 w) / w``; greater is nearer.
    depth : (H, W) float32
        Written where points are.
    """
    owner = np.int64(0)
    for y in range(row_range[0], row_range[1]):
        for x in range(face_id.shape[1]):
            face = np.int64(face_id[y, x])
            if face < 0:
                continue
            owner = find_object(face, placement.face_starts, owner)
            shape = points.shapes[owner, 0]
            if shape == point_rasterizer.NOT_POINTS:
                continue
            v = np.uintp(faces[face, 0])
            centre, hit = transform_vertex(v, owner, placement), (0.0, 0.0, 0.0)
            if shape == point_rasterizer.SPHERE:
                centre, hit = intersect_sphere(
                    face, v, owner, (x, y), points, eye, placement, viewport
                )
            depth[y, x] = point_rasterizer.find_sphere_depth(centre, hit, eye, depth_coefficients)


@kernel
def fill_point_normals(
    face_id: int32[:, ::1], row_range: (int64, int64), faces: int32[:, ::1], points: PointRows,
    eye: PointView, viewport: Viewport, placement: Placement, normal: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the unit normal of each sample of a point: see `find_point_normals`.

    Parameters
    ----------
    face_id : (H, W) int32
    row_range : (int, int)
    faces : (F, 3) int32, vertex numbers
    points, eye, viewport, placement : records
    normal : (H, W, 3) float32, world axes
        Changed where points are; read where these have normals, which are not zero.
    """
    owner = np.int64(0)
    for y in range(row_range[0], row_range[1]):
        for x in range(face_id.shape[1]):
            face = np.int64(face_id[y, x])
            if face < 0:
                continue
            owner = find_object(face, placement.face_starts, owner)
            shape = points.shapes[owner, 0]
            if shape == point_rasterizer.NOT_POINTS:
                continue
            v = np.uintp(faces[face, 0])
            if shape == point_rasterizer.SPHERE:
                point, surface_normal = find_sphere_point(
                    face, v, owner, (x, y), points, eye, placement, viewport
                )
            else:
                point = transform_vertex(v, owner, placement)
                surface_normal = (
                    np.float64(normal[y, x, 0]), np.float64(normal[y, x, 1]),
                    np.float64(normal[y, x, 2]),
                )  # fmt: skip
            facing = flip_toward(surface_normal, point_to_viewer(point, placement))
            facing = normalize(facing[0], facing[1], facing[2])
            for k in range(3):
                normal[y, x, k] = facing[k]
