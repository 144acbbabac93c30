"""
Project vertices to the screen: transform, outcode, divide by w, snap to the sub-pixel grid.

A vertex is rounded to the grid once, half to even. Vertices are processed in blocks, as rows of
scratch memory, one per coordinate (structure of arrays), so that the arithmetic is vectorized;
only loading and storing go vertex by vertex.

Every matrix product is ((m0 x + m1 y) + m2 z) + m3 with each operation rounded once, first to the
eye's axes, then to clip space, as `transforms.transform_points` does it: both give the same bits.

All of it is float64, or float32 where the positions and the scratch memory are, but for the last
step: a vertex is rounded to the grid in float64, which resolves the grid in any image.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.pipeline.geometry import setup
from rasterjit.pipeline.records import ScreenVertices, Viewport
from rasterjit.runtime.intrinsics import part, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float64, int32, int64, real

MAX_FLOAT32 = 1e18
"""`MAX_COORDINATE` of float32: products of two stay finite there."""

VERTICES_PER_BLOCK = 256
"""Vertices of a block: their rows of scratch memory, 15 KiB, stay in L1."""

ROUNDING_OFFSET = 6755399441055744.0
"""1.5 * 2**52: adding and subtracting it rounds a float64 below 2**51 half to even."""

X, Y, Z, W, DEPTH = 0, 1, 2, 3, 4
"""Rows of the float scratch: a position, in place, from the eye's axes to clip space; depth."""
SNAPPED_X, SNAPPED_Y, CODE = 0, 1, 2
"""Rows of the integer scratch."""


def allocate_scratch(precision: Any = np.float64) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Allocate the scratch memory of this file's kernels, for float64 or float32 arithmetic."""
    kind = np.dtype(precision)
    largest = setup.MAX_COORDINATE if kind == np.float64 else MAX_FLOAT32
    return (
        np.empty((5, VERTICES_PER_BLOCK), kind),
        np.empty((3, VERTICES_PER_BLOCK), np.int32),
        np.full(1, largest, kind),
    )


@helper
def compute_outcode(x, y, z, w, guard_x, guard_y, largest):
    """Return the outcode of one clip position, without a branch."""
    valid = (
        (abs(x) <= largest) & (abs(y) <= largest) & (abs(z) <= largest) & (abs(w) <= largest)
    )  # fmt: skip
    inside = (w > 0.0) & (abs(x) <= guard_x * w) & (abs(y) <= guard_y * w)
    code = np.int32(setup.LEFT) if x < -w else np.int32(0)
    code |= np.int32(setup.RIGHT) if x > w else np.int32(0)
    code |= np.int32(setup.BOTTOM) if y < -w else np.int32(0)
    code |= np.int32(setup.TOP) if y > w else np.int32(0)
    code |= np.int32(setup.NEAR) if z < -w else np.int32(0)
    code |= np.int32(setup.FAR) if z > w else np.int32(0)
    code |= np.int32(0) if inside else np.int32(setup.GUARD)
    return code if valid else np.int32(setup.INVALID)


@helper
def get_half_extents(rows, viewport):
    """Return 1, and half the width and height of the whole picture, pixels, in the rows' type."""
    kind = rows.dtype.type
    width, height = setup.get_picture_size(viewport)
    return kind(1.0), kind(0.5 * width), kind(0.5 * height)


@helper
def snap(coordinate, one, half_extent, viewport):
    """Return an NDC coordinate in sub-pixel units: ``(coordinate + 1) * half_extent``, rounded."""
    pixels = np.float64((coordinate + one) * half_extent)
    steps = pixels * np.float64(1 << viewport.subpixel_bits)
    rounded = (steps + ROUNDING_OFFSET) - ROUNDING_OFFSET
    return np.int32(rounded) << np.int32(viewport.grid_bits - viewport.subpixel_bits)


@helper
def snap_vertex(ndc_x, ndc_y, extents, viewport):
    """Return the snapped screen position of a vertex; takes `get_half_extents`."""
    one, half_width, half_height = extents
    left = np.int32(viewport.left) << np.int32(viewport.grid_bits)
    top = np.int32(viewport.top) << np.int32(viewport.grid_bits)
    return (
        np.int32(snap(ndc_x, one, half_width, viewport) - left),
        np.int32(snap(-ndc_y, one, half_height, viewport) - top),
    )


@helper
def compute_stored_depth(z, w, depth_coefficients):
    """Return the stored depth of a clip position."""
    c0, c1, c2 = depth_coefficients
    return (c0 + c1 * z + c2 * w) / w


@helper
def multiply_row(m0, m1, m2, m3, x, y, z):
    """Return one row of a matrix times (x, y, z, 1)."""
    return m0 * x + m1 * y + m2 * z + m3


@helper
def is_translation(matrix):
    """Return whether a matrix is a pure translation."""
    return (
        (matrix[0, 0] == 1.0) & (matrix[0, 1] == 0.0) & (matrix[0, 2] == 0.0)
        & (matrix[1, 0] == 0.0) & (matrix[1, 1] == 1.0) & (matrix[1, 2] == 0.0)
        & (matrix[2, 0] == 0.0) & (matrix[2, 1] == 0.0) & (matrix[2, 2] == 1.0)
    )  # fmt: skip


@disjoint_helper
def load_translated(positions, matrix, x, y, z):
    """Load positions relative to the eye, translated only: no products by 0 and 1."""
    m03, m13, m23 = matrix[0, 3], matrix[1, 3], matrix[2, 3]
    for i in range(x.shape[0]):
        x[i] = positions[i, 0] + m03
        y[i] = positions[i, 1] + m13
        z[i] = positions[i, 2] + m23


@disjoint_helper
def load_transformed(positions, matrix, x, y, z):
    """Load positions relative to the eye."""
    m00, m01, m02, m03 = matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[0, 3]
    m10, m11, m12, m13 = matrix[1, 0], matrix[1, 1], matrix[1, 2], matrix[1, 3]
    m20, m21, m22, m23 = matrix[2, 0], matrix[2, 1], matrix[2, 2], matrix[2, 3]
    for i in range(x.shape[0]):
        px, py, pz = positions[i, 0], positions[i, 1], positions[i, 2]
        x[i] = multiply_row(m00, m01, m02, m03, px, py, pz)
        y[i] = multiply_row(m10, m11, m12, m13, px, py, pz)
        z[i] = multiply_row(m20, m21, m22, m23, px, py, pz)


@helper
def load_eye_relative(positions, first, stop, objects, owner, floats):
    """Load a block of positions, by their objects' matrices; return the last vertex's object."""
    vertex_starts, relative_from_model = objects
    start = first
    while start < stop:
        while start >= vertex_starts[np.uintp(owner + 1)]:
            owner += 1
        end = min(stop, vertex_starts[np.uintp(owner + 1)])
        matrix = relative_from_model[np.uintp(owner)]
        rows, i, j = positions[start:end], start - first, end - first
        x, y, z = three_parts(floats, X, i, j)
        if is_translation(matrix):
            load_translated(rows, matrix, x, y, z)
        else:
            load_transformed(rows, matrix, x, y, z)
        start = end
    return owner


@disjoint_helper
def transform_rows_to_clip(matrix, x, y, z, w):
    """Take rows of positions to clip space, in place."""
    m00, m01, m02, m03 = matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[0, 3]
    m10, m11, m12, m13 = matrix[1, 0], matrix[1, 1], matrix[1, 2], matrix[1, 3]
    m20, m21, m22, m23 = matrix[2, 0], matrix[2, 1], matrix[2, 2], matrix[2, 3]
    m30, m31, m32, m33 = matrix[3, 0], matrix[3, 1], matrix[3, 2], matrix[3, 3]
    for i in range(x.shape[0]):
        px, py, pz = x[i], y[i], z[i]
        x[i] = multiply_row(m00, m01, m02, m03, px, py, pz)
        y[i] = multiply_row(m10, m11, m12, m13, px, py, pz)
        z[i] = multiply_row(m20, m21, m22, m23, px, py, pz)
        w[i] = multiply_row(m30, m31, m32, m33, px, py, pz)


@disjoint_helper
def project_rows(
    depth_coefficients, viewport, largest, x, y, z, w, depth, snapped_x, snapped_y, codes
):
    """Write the depth, the snapped position and the outcode of rows of clip positions."""
    # In the type of the rows, or the loop is promoted to float64.
    kind = x.dtype.type
    guard_x, guard_y = kind(viewport.guard_x), kind(viewport.guard_y)
    c0, c1, c2 = depth_coefficients
    coefficients = kind(c0), kind(c1), kind(c2)
    zero, one, extents = kind(0.0), kind(1.0), get_half_extents(x, viewport)
    for i in range(x.shape[0]):
        code = compute_outcode(x[i], y[i], z[i], w[i], guard_x, guard_y, largest)
        # Divide without a branch: vertices that must not be divided get the image's centre.
        is_outside = (code & np.int32(setup.GUARD | setup.INVALID)) != 0
        divisor = one if is_outside else w[i]
        ndc_x = (zero if is_outside else x[i]) / divisor
        ndc_y = (zero if is_outside else y[i]) / divisor
        codes[i] = code
        depth[i] = compute_stored_depth(z[i], divisor, coefficients)
        snapped_x[i], snapped_y[i] = snap_vertex(ndc_x, ndc_y, extents, viewport)


@helper
def store_rows(first, count, floats, ints, screen):
    """Store a block of vertices; return the bits set in any outcode."""
    all_codes = np.int32(0)
    for i in range(count):
        row, vertex = np.uintp(i), np.uintp(first + i)
        code = ints[CODE, row]
        all_codes |= code
        screen.xy[vertex, 0] = ints[SNAPPED_X, row]
        screen.xy[vertex, 1] = ints[SNAPPED_Y, row]
        screen.depth[vertex] = floats[DEPTH, row]
        screen.w[vertex] = floats[W, row]
        screen.codes[vertex] = np.uint8(code)
    return all_codes


@helper
def project_block(first, count, depth_coefficients, viewport, screen, scratch):
    """Take a block from clip space to the screen; return the bits set in any outcode."""
    floats, ints, largest = scratch
    project_rows(
        depth_coefficients, viewport, largest[0], *three_parts(floats, X, 0, count),
        part(floats, W, 0, count), part(floats, DEPTH, 0, count),
        *three_parts(ints, SNAPPED_X, 0, count),
    )  # fmt: skip
    return store_rows(first, count, floats, ints, screen)


@helper
def transform_block(first, count, positions, objects, owner, clip_from_relative, floats):
    """Take a block from model space to clip space; return the object of its last vertex."""
    owner = load_eye_relative(positions, first, first + count, objects, owner, floats)
    transform_rows_to_clip(
        clip_from_relative, *three_parts(floats, X, 0, count), part(floats, W, 0, count)
    )
    return owner


@kernel
def transform_vertices(
    vertices: (int64, int64), positions: real[:, ::1], objects: (int64[::1], real[:, :, ::1]),
    clip_from_relative: real[:, ::1], depth_coefficients: (float64, float64, float64),
    viewport: Viewport, screen: ScreenVertices, scratch: (real[:, ::1], int32[:, ::1], real[::1]),
):  # fmt: skip
    """
    Take vertices from model space to the screen.

    Parameters
    ----------
    vertices : (int, int)
        The first, and one past the last; they may belong to several objects.
    positions : (V, 3) float64 or float32, model space
    objects : (vertex_starts (O+1,) int64, relative_from_model (O, 4, 4) of the same type)
        Object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``; its matrix takes them
        to world axes with the origin at the eye.
    clip_from_relative : (4, 4) of the same type
    depth_coefficients : (float, float, float)
        The stored depth is ``(c0 + c1 z + c2 w) / w``; greater is nearer.
    viewport : Viewport
    screen : ScreenVertices
        Writes the rows of these vertices. Outside the guard band only the outcode counts: faces
        that use such a vertex are cut first.
    scratch : tuple
        From `allocate_scratch`, of the same type; not shared with other calls.

    Returns
    -------
    int
        The bits set in any of the outcodes.
    """
    all_codes = np.int32(0)
    owner = setup.find_last_at_most(objects[0], vertices[0])
    for first in range(vertices[0], vertices[1], VERTICES_PER_BLOCK):
        count = min(first + VERTICES_PER_BLOCK, vertices[1]) - first
        owner = transform_block(
            first, count, positions, objects, owner, clip_from_relative, scratch[0]
        )
        all_codes |= project_block(first, count, depth_coefficients, viewport, screen, scratch)
    return all_codes


@kernel
def transform_positions(
    vertices: (int64, int64), positions: real[:, ::1], objects: (int64[::1], real[:, :, ::1]),
    clip_from_relative: real[:, ::1], clip_positions: float64[:, ::1],
    scratch: (real[:, ::1], int32[:, ::1], real[::1]),
):  # fmt: skip
    """
    Take vertices from model space to clip space; the same bits as on the way to the screen.

    Parameters
    ----------
    vertices, positions, objects, clip_from_relative, scratch
        As `transform_vertices` takes them.
    clip_positions : (V, 4) float64, clip space
        Writes the rows of these vertices.
    """
    floats = scratch[0]
    owner = setup.find_last_at_most(objects[0], vertices[0])
    for first in range(vertices[0], vertices[1], VERTICES_PER_BLOCK):
        count = min(first + VERTICES_PER_BLOCK, vertices[1]) - first
        owner = transform_block(first, count, positions, objects, owner, clip_from_relative, floats)
        for i in range(count):
            row, vertex = np.uintp(i), np.uintp(first + i)
            for k in range(W + 1):
                clip_positions[vertex, np.uintp(k)] = floats[X + k, row]


@kernel
def project_vertices(
    vertices: (int64, int64), clip_positions: float64[:, ::1],
    depth_coefficients: (float64, float64, float64), viewport: Viewport, screen: ScreenVertices,
    scratch: (real[:, ::1], int32[:, ::1], real[::1]),
):  # fmt: skip
    """
    Take vertices from clip space to the screen.

    Parameters
    ----------
    vertices : (int, int)
        The first, and one past the last.
    clip_positions : (V, 4) float64, clip space
    depth_coefficients : (float, float, float)
    viewport : Viewport
    screen : ScreenVertices
        Written as by `transform_vertices`.
    scratch : tuple
        From `allocate_scratch`, of the type to compute in; not shared with other calls.

    Returns
    -------
    int
        The bits set in any of the outcodes.
    """
    floats = scratch[0]
    all_codes = np.int32(0)
    for first in range(vertices[0], vertices[1], VERTICES_PER_BLOCK):
        count = min(first + VERTICES_PER_BLOCK, vertices[1]) - first
        for i in range(count):
            row, vertex = np.uintp(i), np.uintp(first + i)
            floats[X, row], floats[Y, row] = clip_positions[vertex, 0], clip_positions[vertex, 1]
            floats[Z, row], floats[W, row] = clip_positions[vertex, 2], clip_positions[vertex, 3]
        all_codes |= project_block(first, count, depth_coefficients, viewport, screen, scratch)
    return all_codes


@helper
def find_depth_range(corners, clip_positions, depth_coefficients):
    """Return a face's lowest and highest stored depth; -inf and inf if it goes behind the eye."""
    lowest, highest = np.inf, -np.inf
    for n in range(3):
        z, w = clip_positions[corners[n], 2], clip_positions[corners[n], 3]
        if not w > 0.0:
            return -np.inf, np.inf
        depth = compute_stored_depth(z, w, depth_coefficients)
        lowest, highest = min(lowest, depth), max(highest, depth)
    return lowest, highest


@kernel
def project_clipped_vertices(
    cut: (int32[::1], int32[:, ::1], int64[::1], float64[:, ::1]), clip_positions: float64[:, ::1],
    depth_coefficients: (float64, float64, float64), viewport: Viewport, first: int64,
    screen: ScreenVertices,
):  # fmt: skip
    """
    Project the vertices that clipping made: divide by w, map to the screen, snap.

    Clamped to the guard band, to near and far, and to the depth range of their face, which rounding
    may leave.

    Parameters
    ----------
    cut : (clipped_faces (C,) int32, faces (F, 3) int32, starts (C+1,) int64, positions (V, 4))
        The faces that were cut; where the new vertices of each start; the clip positions of the
        faces' own vertices, float64.
    clip_positions : (E, 4) float64, clip space
        The new vertices, all with ``w > 0``.
    depth_coefficients : (float, float, float)
    viewport : Viewport
    first : int
    screen : ScreenVertices
        Writes rows ``first .. first + E``.
    """
    clipped_faces, faces, starts, face_positions = cut
    extents = get_half_extents(clip_positions, viewport)
    for n in range(clipped_faces.shape[0]):
        lowest, highest = find_depth_range(
            faces[clipped_faces[n]], face_positions, depth_coefficients
        )
        for e in range(starts[n], starts[n + 1]):
            w = clip_positions[e, 3]
            z = min(max(clip_positions[e, 2], -w), w)
            x = min(max(clip_positions[e, 0] / w, -viewport.guard_x), viewport.guard_x)
            y = min(max(clip_positions[e, 1] / w, -viewport.guard_y), viewport.guard_y)
            depth = compute_stored_depth(z, w, depth_coefficients)
            screen.codes[first + e] = 0
            screen.xy[first + e, 0], screen.xy[first + e, 1] = snap_vertex(x, y, extents, viewport)
            screen.depth[first + e] = min(max(depth, lowest), highest)
            screen.w[first + e] = w
