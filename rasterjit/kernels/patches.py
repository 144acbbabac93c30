"""
Cut a stretch of a row into patches, and gather what the vertices of their faces hold.

A patch is a few neighbouring samples that show one face. Gathering does nothing else, so that the
CPU waits for many vertices at once. What was gathered lies in small arrays, a row for each quantity
and a column for each sample.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.setup import CLIPPED
from rasterjit.kernels.vectors import LANES, spread

A, B, C, FIRST = 0, 1, 2, 3
"""Rows of whole numbers, for each patch: vertices, the lowest number first; its first sample."""
AX, AY, BX, BY, CX, CY = 4, 5, 6, 7, 8, 9
"""Rows of whole numbers: where the vertices lie on the sub-pixel grid."""
UNSURE, BEHIND = 10, 11
"""Rows of whole numbers: not 0 if the sample takes another way; 1 if the face's back is seen."""
COLUMN, ROW = 12, 13
"""Rows of whole numbers: the pixel of each sample."""
WHOLE_ROWS = 14

VERTEX_ROWS = 9
"""Rows of real numbers, float64 and float32: three for each vertex."""

VECTOR = 16
"""Samples of the longest vectors. Loops run over whole ones: what lies behind is overwritten."""


@stage
def whole_vectors(count):
    """Return a count rounded up to whole vectors."""
    return (np.int64(count) + (VECTOR - 1)) & -VECTOR


@stage
def list_patches(faces, whole):
    """List the first samples of the patches of a stretch, and its end; count the patches."""
    count, before = np.uintp(0), np.int32(-1)
    for i in range(np.uintp(faces.shape[0])):
        # Without a branch: the next overwrites what starts no patch.
        whole[FIRST, count] = i
        face = faces[i]
        starts = (face != before) | (i % np.uintp(LANES) == np.uintp(0))
        count += np.uintp(starts)
        before = face
    whole[FIRST, count] = faces.shape[0]
    return count


@stage
def gather_corners(count, faces, own, whole):
    """Gather the vertex numbers of each patch."""
    for r in range(count):
        face = np.uintp(faces[np.uintp(whole[FIRST, r])])
        whole[A, r], whole[B, r], whole[C, r] = own[face, 0], own[face, 1], own[face, 2]


@disjoint_stage
def number_pixels(columns, rows, column, row):
    """Write the pixels of a stretch, of which the first is given."""
    for n in range(columns.shape[0]):
        columns[n], rows[n] = column + n, row


@disjoint_stage
def turn_corners(a, b, c):
    """Rotate the vertices of each face so that the lowest number comes first."""
    for n in range(a.shape[0]):
        x, y, z = a[n], b[n], c[n]
        second, third = (y < x) & (y < z), (z < x) & (z < y)
        a[n] = y if second else (z if third else x)
        b[n] = z if second else (x if third else y)
        c[n] = x if second else (y if third else z)


@stage
def gather_w(a, b, c, n, w, real):
    """Gather w of one patch's vertices; nothing where interpolation is affine."""
    if w is None:
        return
    spread(real[0], n, w[a])
    spread(real[1], n, w[b])
    spread(real[2], n, w[c])


@stage
def gather_screen(count, geometry, whole, real):
    """Gather where the vertices of each sample's face lie on the screen, and w."""
    xy = geometry.xy
    for r in range(count):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        n = np.uintp(whole[FIRST, r])
        spread(whole[AX], n, xy[a, 0])
        spread(whole[AY], n, xy[a, 1])
        spread(whole[BX], n, xy[b, 0])
        spread(whole[BY], n, xy[b, 1])
        spread(whole[CX], n, xy[c, 0])
        spread(whole[CY], n, xy[c, 1])
        gather_w(a, b, c, n, geometry.w, real)


@stage
def gather_codes(count, size, geometry, whole):
    """Gather which samples show a face that was clipped."""
    codes = geometry.codes
    for n in range(size):
        whole[UNSURE, n] = 0
    if geometry.clip_positions.shape[0] == 0:
        return
    for r in range(count):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        n = np.uintp(whole[FIRST, r])
        spread(whole[UNSURE], n, np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED))


@stage
def gather_values(count, values, whole, rows):
    """Gather three numbers for each vertex of each sample's face."""
    for r in range(count):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        n = np.uintp(whole[FIRST, r])
        spread(rows[0], n, values[a, 0])
        spread(rows[1], n, values[a, 1])
        spread(rows[2], n, values[a, 2])
        spread(rows[3], n, values[b, 0])
        spread(rows[4], n, values[b, 1])
        spread(rows[5], n, values[b, 2])
        spread(rows[6], n, values[c, 0])
        spread(rows[7], n, values[c, 1])
        spread(rows[8], n, values[c, 2])


@stage
def gather_light(count, lit_vertices, whole, rows):
    """Gather the light on the vertices of each sample's face, on the side that is seen."""
    for r in range(count):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        n = np.uintp(whole[FIRST, r])
        side = np.uintp(whole[BEHIND, n])
        for k in range(3):
            spread(rows[k], n, lit_vertices[a, side, k])
            spread(rows[3 + k], n, lit_vertices[b, side, k])
            spread(rows[6 + k], n, lit_vertices[c, side, k])


@stage
def gather_coordinates(count, uv, whole, rows):
    """Gather the texture coordinates of each vertex of each sample's face."""
    for r in range(count):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        n = np.uintp(whole[FIRST, r])
        spread(rows[0], n, uv[a, 0])
        spread(rows[1], n, uv[a, 1])
        spread(rows[2], n, uv[b, 0])
        spread(rows[3], n, uv[b, 1])
        spread(rows[4], n, uv[c, 0])
        spread(rows[5], n, uv[c, 1])
