"""
Gather vertices for Gouraud shading into blocks, and store their lit colours.

Vertices are lit by the stages that light samples, each twice: front and back.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline import records
from rasterjit.pipeline.geometry.barycentric import interpolate_normal, transform_vertex
from rasterjit.pipeline.geometry.setup import find_last_at_most
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import MAX_SAMPLES, Block
from rasterjit.runtime.jit import stage
from rasterjit.runtime.state_block import float32, int64


@stage
def gather_vertices(
    block: Block, count, first_vertex: int64, vertex_end: int64, vertex_starts: int64[::1],
    placement: records.Placement, materials: float32[:, ::1], vertex_colors: float32[:, ::1],
    normals: float32[:, ::1],
):  # fmt: skip
    """
    Gather the next vertices of Gouraud-shaded objects into a block, as samples.

    Parameters
    ----------
    block : Block
        ``counts`` is 0 at first. Writes everything that light on a plain sample depends on, and
        shadow receivers: a vertex lies in the plane of its normal. COLUMN of ``ints`` is the
        vertex, element NEXT_SIDE of ``counts`` the side: 0 is the front.
    count : int
        Not read.
    first_vertex, vertex_end : int
        The first vertex, and one past the last.
    vertex_starts : (O+1,) int64
        Object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``.
    placement : Placement
    materials : (O, 7) float32
    vertex_colors : (V, 4) float32, linear, or (0, 4)
    normals : (V, 3) float32, model space

    Returns
    -------
    int
        Number of samples; -1 after the last one.
    """
    counts, samples, receivers, ints = block.counts, block.samples, block.receivers, block.ints
    side, vertex = counts[rows.NEXT_SIDE], first_vertex + counts[rows.NEXT_VERTEX]
    one = np.float32(1.0)
    # After the last vertex's front, the first one's back.
    if vertex >= vertex_end:
        side, vertex = side + 1, first_vertex
    n = np.int64(0)
    while n == 0 and side < 2:
        # Each pass lists vertices of one object.
        owner = find_last_at_most(vertex_starts, vertex)
        sign = 1.0 - 2.0 * side
        while vertex < vertex_end and n < MAX_SAMPLES:
            while vertex >= vertex_starts[owner + 1]:
                owner += 1
            object_end = min(vertex_end, vertex_starts[owner + 1])
            if np.int64(materials[owner, records.MATERIAL_MODEL]) != records.GOURAUD:
                vertex = object_end
                continue
            red, green, blue = materials[owner, 0], materials[owner, 1], materials[owner, 2]
            specular = materials[owner, records.MATERIAL_SPECULAR]
            shininess = materials[owner, records.MATERIAL_SHININESS]
            for index in range(vertex, min(object_end, vertex + MAX_SAMPLES - n)):
                v = np.uintp(index)
                point = transform_vertex(v, owner, placement)
                normal = interpolate_normal(
                    (1.0, 0.0, 0.0), v, v, v, normals, placement.normal_matrices, owner
                )
                r, g, b = red, green, blue
                if vertex_colors.shape[0] > 0:
                    r, g = r * vertex_colors[v, 0], g * vertex_colors[v, 1]
                    b = b * vertex_colors[v, 2]
                samples[rows.RED, n], samples[rows.GREEN, n], samples[rows.BLUE, n] = r, g, b
                for k in range(3):
                    samples[rows.NORMAL_X + k, n] = np.float32(sign * normal[k])
                    samples[rows.POINT_X + k, n] = np.float32(point[k])
                    receivers[rows.RECEIVER_POINT + k, n] = point[k]
                    receivers[rows.RECEIVER_NORMAL + k, n] = normal[k]
                samples[rows.SPECULAR, n], samples[rows.SHININESS, n] = specular, shininess
                samples[rows.LIT, n], samples[rows.OCCLUSION, n] = one, one
                samples[rows.SHADOW, n] = one
                ints[rows.COLUMN, n] = np.int32(index)
                n += 1
                vertex = index + 1
        if n == 0:
            side, vertex = side + 1, first_vertex
    counts[rows.NEXT_SIDE], counts[rows.NEXT_VERTEX] = side, vertex - first_vertex
    counts[rows.IS_LIT] = 1
    return n if n > 0 else np.int64(-1)


@stage
def store_lit_vertices(block: Block, count, lit_vertices: float32[:, :, ::1]):
    """Write the colours of lit vertices: (V, 2, 3), linear, front and back."""
    samples, side = block.samples, np.uintp(block.counts[rows.NEXT_SIDE])
    for n in range(np.uintp(count)):
        vertex = np.uintp(block.ints[rows.COLUMN, n])
        for k in range(3):
            lit_vertices[vertex, side, k] = samples[rows.OUT_RED + k, n]
