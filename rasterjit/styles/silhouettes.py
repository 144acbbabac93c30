"""
Count the directions of light from which a scene covers each texel of a map, by its silhouettes.

Along a row, a triangle covers the texels between two of its edges: it adds a layer right of one and
removes it right of the other. So the layers over a texel are a sum over edges. An edge between two
faces of the same winding adds nothing, which leaves silhouettes and borders, few of all edges.
Columns are exact, as in ``visibility.tile_rasterizer``, and a centre on an edge belongs to the same
face: a texel has a layer where a picture of face numbers shows a face.

References
----------
.. [1] F. Crow, "Shadow Algorithms for Computer Graphics", SIGGRAPH 1977: silhouettes by faces.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.setup import CLIPPED, INVALID, find_first_pixel, get_winding
from rasterjit.pipeline.records import Objects, ScreenVertices
from rasterjit.runtime.intrinsics import call_bound
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float64, int8, int32, int64

MAX_COMPARED = 32
"""Most edges at a vertex that an edge is compared with; an unmatched edge is listed alone."""

FROM, TO, LEFT, RIGHT = range(4)
"""
Columns of edges: its vertices; the face that it runs around clockwise, if that is clockwise; and
the other face, ``~face`` if it runs the same way around that. The number of faces means no face.
"""
EDGE_COLUMNS = 4


@kernel
def pair_edges(faces: int32[:, ::1], newest: int32[::1], older: int32[::1], edges: int32[:, ::1]):
    """
    List the edges of all faces, most of them once with both their faces.

    Parameters
    ----------
    faces : (F, 3) int32
    newest : (V,) int32
        Written: the last edge listed at a vertex, the lower one of the edge.
    older : (3F,) int32
        Written: the edge listed before at that vertex.
    edges : (3F, 4) int32
        Written: see ``FROM``.

    Returns
    -------
    int
        Number of edges.
    """
    count, no_face = np.int64(0), np.int32(faces.shape[0])
    for v in range(newest.shape[0]):
        newest[v] = -1
    for face in range(faces.shape[0]):
        for k in range(3):
            a, b = faces[face, k], faces[face, (k + 1) % 3]
            if a == b:
                continue
            lower, is_same = min(a, b), False
            edge, compared = newest[lower], 0
            while edge >= 0 and compared < MAX_COMPARED:
                is_same = edges[edge, FROM] == a and edges[edge, TO] == b
                is_back = edges[edge, FROM] == b and edges[edge, TO] == a
                if (is_same or is_back) and edges[edge, RIGHT] == no_face:
                    break
                edge, compared = older[edge], compared + 1
            if edge >= 0 and compared < MAX_COMPARED:
                edges[edge, RIGHT] = np.int32(~face) if is_same else np.int32(face)
                continue
            edges[count, FROM], edges[count, TO] = a, b
            edges[count, LEFT], edges[count, RIGHT] = np.int32(face), no_face
            older[count], newest[lower] = newest[lower], np.int32(count)
            count += 1
    return count


@helper
def find_windings(faces, objects, screen, any_codes, windings):
    """Write the winding of each face, 0 if it is not drawn; return whether none is clipped."""
    xy, codes = screen.xy, screen.codes
    for owner in range(objects.face_starts.shape[0] - 1):
        culled = np.int32(objects.culled_windings[owner])
        for face in range(objects.face_starts[owner], objects.face_starts[owner + 1]):
            a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
            if any_codes & (CLIPPED | INVALID):
                bits = codes[a] | codes[b] | codes[c]
                if bits & INVALID:
                    windings[face] = 0
                    continue
                if bits & CLIPPED:
                    return False
            winding = get_winding((xy[a, 0], xy[a, 1]), (xy[b, 0], xy[b, 1]), (xy[c, 0], xy[c, 1]))
            windings[face] = np.int8(0 if winding == culled else winding)
    return True


@helper
def add_edge(xy, first, last, layers, bits, change, ends):
    """Add layers right of an edge that runs up, or remove them right of one that runs down."""
    ax, ay = np.int64(xy[first, 0]), np.int64(xy[first, 1])
    bx, by = np.int64(xy[last, 0]), np.int64(xy[last, 1])
    if ay < by:
        change = -change
    else:
        ax, ay, bx, by = bx, by, ax, ay
    top = max(find_first_pixel(ay, bits), np.int64(0))
    bottom = min(find_first_pixel(by, bits), np.int64(layers.shape[0]))
    if top >= bottom:
        return
    # The edge crosses a row at value / denominator texels; the half makes the floor exact.
    half, last_column = np.int64(1) << (bits - 1), np.float64(layers.shape[1] - 1)
    dx, dy = bx - ax, by - ay
    denominator = dy << bits
    value = np.float64((ax - half) * dy + ((top << bits) + half - ay) * dx + denominator - 1) + 0.5
    step, inverse_size = np.float64(dx << bits), 1.0 / np.float64(denominator)
    for row in range(np.uintp(top), np.uintp(bottom)):
        column = np.uintp(min(max(np.floor(value * inverse_size), 0.0), last_column))
        layers[row, column] += change
        ends[row, 0] = min(ends[row, 0], np.int32(column))
        ends[row, 1] = max(ends[row, 1], np.int32(column))
        value += step


@helper
def sweep_rows(layers, ends, counts):
    """Add 1 to the count of each texel with a layer; clear the layers."""
    for row in range(np.uintp(counts.shape[0])):
        if ends[row, 0] > ends[row, 1]:
            continue
        first, last, layer_sum = np.uintp(ends[row, 0]), np.uintp(ends[row, 1]), np.int32(0)
        for column in range(first, last):
            layer_sum += layers[row, column]
            layers[row, column] = 0
            counts[row, column] += np.int32(layer_sum != 0)
        layers[row, last] = 0
        ends[row, 0], ends[row, 1] = np.int32(layers.shape[1]), np.int32(-1)


@kernel
def count_covered(
    matrices: float64[:, :, ::1], matrix: float64[:, ::1], transform: int64[::1],
    screen: ScreenVertices, grid_bits: int64, faces: int32[:, ::1], objects: Objects,
    edges: int32[:, ::1], windings: int8[::1], layers: int32[:, ::1], ends: int32[:, ::1],
    counts: int32[:, ::1],
):  # fmt: skip
    """
    Count the directions from which each texel is covered.

    Parameters
    ----------
    matrices : (N, 4, 4) float64
        ``clip_from_relative`` of each direction.
    matrix : (4, 4) float64
        Read by the transform; overwritten for each direction.
    transform : (2,) int64
        The words of ``projection.transform_vertices``, bound.
    screen : ScreenVertices
        Written by the transform.
    grid_bits : int
    faces : (F, 3) int32
    objects : Objects
    edges : (E, 4) int32
        Of `pair_edges`.
    windings : (F+1,) int8
        Scratch memory.
    layers : (H, W+1) int32
        Scratch memory, zeros.
    ends : (H, 2) int32
        Scratch memory: W+1 and -1.
    counts : (H, W) int32
        Changed.

    Returns
    -------
    bool
        False if a face has to be clipped: then the counts are meaningless.
    """
    windings[faces.shape[0]] = 0
    for n in range(matrices.shape[0]):
        for row in range(4):
            for column in range(4):
                matrix[row, column] = matrices[n, row, column]
        any_codes = call_bound(transform)
        if not find_windings(faces, objects, screen, any_codes, windings):
            return False
        for k in range(np.uintp(edges.shape[0])):
            right = edges[k, RIGHT]
            change = np.int32(windings[np.uintp(edges[k, LEFT])])
            if right >= 0:
                change -= np.int32(windings[np.uintp(right)])
            else:
                change += np.int32(windings[np.uintp(~right)])
            if change != 0:
                first, last = np.uintp(edges[k, FROM]), np.uintp(edges[k, TO])
                add_edge(screen.xy, first, last, layers, grid_bits, change, ends)
        sweep_rows(layers, ends, counts)
    return True
