"""
Define texture filtering: wrap modes, mip level and anisotropic footprint of a sample.

Coordinate u runs right and v up. They are reduced to one period in float64 before they are scaled
to texels, so nothing is lost far from 0 but what float32 coordinates have lost already. Texels lie
row by row from the top of the picture, as linear RGBA, or as codes of 8 bits that become linear
light by a table.

The level of detail is ``log2 rho``; rho is the longer of the two steps on the picture, in texels,
that one pixel to the right and one pixel down make. They are the exact derivatives of the
perspective-correct coordinates at the pixel's centre: with weights ``W_k / sum W`` whose parts are
linear on the screen, ``u = sum W_k u_k / sum W`` has the derivative ``sum W_k' (u_k - u) / sum W``.
Where each sample of a pixel is shaded (supersampling), a step is ``Viewport.spacing`` pixels long,
the distance between samples; else their mean would be blurred twice. A texture's transform applies
to steps too. Affine coordinates have constant derivatives on a face: those of its edge functions
over their sum.

Anisotropic filtering divides the footprint of a pixel along its longer step. With the lengths of
both steps, the shorter counted as one texel at least, and ``parts = min(longer / shorter,
anisotropy)``, the level of detail is ``log2 (longer / parts)``, and ``N = ceil(parts)`` trilinear
taps lie along the longer step, at ``i / (N + 1) - 1/2`` of it for i in 1..N [3]_. Their mean is
found one by one, so that equal taps give exactly theirs. One tap is the trilinear filter, bit for
bit.

References
----------
.. [1] L. Williams, "Pyramidal Parametrics", SIGGRAPH 1983.
.. [2] The Khronos Group, "Vulkan 1.4 Specification", section 16.5.8, "Level of Detail Operation".
.. [3] The Khronos Group, "EXT_texture_filter_anisotropic", and section 16.6.1 of [2]_, "Texel
   Anisotropic Filtering".
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.setup import whole_size
from rasterjit.runtime.float_math import log2
from rasterjit.runtime.jit import helper

BASE_COLOR, NORMAL, METALLIC_ROUGHNESS, OCCLUSION, EMISSIVE = 0, 1, 2, 3, 4
"""Kinds of texture, as ``Textures.table`` numbers them."""
CORE_KINDS = 5
CLEARCOAT, CLEARCOAT_ROUGHNESS, CLEARCOAT_NORMAL = 5, 6, 7
SHEEN_COLOR, SHEEN_ROUGHNESS, SPECULAR_FACTOR, SPECULAR_COLOR = 8, 9, 10, 11
TRANSMISSION, THICKNESS = 12, 13
"""Kinds of material extensions; the table leaves them out where no object has one."""
KINDS = 14

REPEAT, CLAMP, MIRROR = 0, 1, 2
"""Wrap modes, as ``Textures.table`` numbers them."""

NEAREST, BILINEAR, TRILINEAR = 0, 1, 2
"""Filters, as ``Textures.table`` numbers them."""

PLAIN, WEIGHTED, MASK = 0, 1, 2
"""Uses of alpha, as ``Textures.table`` numbers them; see ``mip_levels``."""

FIRST_LEVEL, LEVEL_COUNT, WRAP_U, WRAP_V, FILTER, ANISOTROPY, ALPHA_USE = range(7)
CODE_CHANNELS, FIRST_CODE, CODE_CURVE = 7, 8, 9
"""Columns of ``Textures.table``."""
TABLE_COLUMNS = 10

SRGB, SHARES, OPAQUE = 0, 1, 2
"""Rows of ``Textures.curves``: sRGB; shares of 1, as codes of alpha are; 1 for any code."""

FIRST_TEXEL, LEVEL_WIDTH, LEVEL_HEIGHT = 0, 1, 2
"""Columns of ``Textures.levels``."""

TEXEL_STEPS = 2.0**24
"""
Positions are rounded to 1/TEXEL_STEPS texel.

So fine a step fits float32 weights exactly, and is far above the rounding errors of interpolated
coordinates: a sample on the middle of a texel shows that texel alone, one on a border is on it.
"""

MAX_STEP_SQUARED = 1e30
"""Largest squared step, texels: beyond the coarsest level of any texture, and finite in float32."""


@helper
def level_at(levels, n):
    """Return first texel, width and height of a level."""
    return levels[n, FIRST_TEXEL], levels[n, LEVEL_WIDTH], levels[n, LEVEL_HEIGHT]


@helper
def scaled_slopes(per_sum, ratios, across, down):
    """
    Return the derivatives of weights, given the steps of their edge functions right and down.

    Takes one over the weights' sum, in the unit of the steps, and smallest w / w of each vertex.
    """
    p, q, r = ratios[0] * per_sum, ratios[1] * per_sum, ratios[2] * per_sum
    return (
        (p * across[0], q * across[1], r * across[2]),
        (p * down[0], q * down[1], r * down[2]),
    )


@helper
def clipped_slopes(a, b, c, column, row, clip, viewport):
    """
    Return the derivatives of a clipped face's weights at a pixel's centre, over their sum.

    Two times three numbers: per sample to the right, and down, for weights that are not normalized.
    """
    width, height = whole_size(viewport)
    x = (2.0 * (viewport.left + column) + 1.0) / width - 1.0
    y = 1.0 - (2.0 * (viewport.top + row) + 1.0) / height
    wa, wb, wc = clip[a, 3], clip[b, 3], clip[c, 3]
    ax, bx, cx = clip[a, 0] - x * wa, clip[b, 0] - x * wb, clip[c, 0] - x * wc
    ay, by, cy = clip[a, 1] - y * wa, clip[b, 1] - y * wb, clip[c, 1] - y * wc
    total = (bx * cy - cx * by) + (cx * ay - ax * cy) + (ax * by - bx * ay)
    step = 2.0 * viewport.spacing
    right, down = step / width / total, -step / height / total
    return (
        (right * (wc * by - wb * cy), right * (wa * cy - wc * ay), right * (wb * ay - wa * by)),
        (down * (cx * wb - bx * wc), down * (ax * wc - cx * wa), down * (bx * wa - ax * wb)),
    )


@helper
def place_step(slopes, place, place0, place1, place2):
    """Return the change of u and v for the given derivatives of the weights."""
    rest = slopes[0] + slopes[1] + slopes[2]
    return (
        slopes[1] * (place1[0] - place0[0])
        + slopes[2] * (place2[0] - place0[0])
        - rest * (place[0] - place0[0]),
        slopes[1] * (place1[1] - place0[1])
        + slopes[2] * (place2[1] - place0[1])
        - rest * (place[1] - place0[1]),
    )


@helper
def length_squared(step, width, height):
    """Return the squared length of a step, in texels of a level."""
    u, v = step[0] * width, step[1] * height
    return u * u + v * v


@helper
def level_of_detail(squared):
    """Return log2 of the length of a step, given its square; 0 where a texel covers the pixel."""
    if not squared > 1.0:
        return np.float32(0.0)
    return np.float32(0.5) * log2(np.float32(min(squared, MAX_STEP_SQUARED)))


@helper
def vertex_place(uv, vertex):
    """Return the texture coordinates of a vertex."""
    return np.float64(uv[vertex, 0]), np.float64(uv[vertex, 1])


@helper
def plain_footprint(right, down):
    """Return an isotropic footprint: the longer step's squared length, one tap, no axis."""
    return max(right, down), np.int64(1), (0.0, 0.0)


@helper
def long_footprint(right, down, step_right, step_down, limit):
    """
    Return an anisotropic footprint: a squared length, a number of taps, and their axis.

    The footprint is divided along its longer step into at most ``limit`` parts, each as long as
    the shorter step, or as a texel if that is shorter. Takes squared lengths in texels, and steps.
    """
    longest, shortest = max(right, down), max(min(right, down), 1.0)
    if not (longest > shortest and limit > 1):
        return plain_footprint(right, down)
    parts = min(np.sqrt(longest / shortest), np.float64(limit))
    way = step_right if right > down else step_down
    return longest / (parts * parts), np.int64(np.ceil(parts)), way


@helper
def split_detail(detail, count):
    """Split a level of detail into the finer mip level and the weight of the coarser one."""
    finer, last = np.int32(detail), count - np.int32(1)
    is_last = finer >= last
    return last if is_last else finer, np.float32(0.0) if is_last else detail - np.float32(finer)


@helper
def tap_place(place, way, n, taps):
    """Return the position of tap ``n`` of a footprint; a single one is centred."""
    if taps == 1:
        return place
    shift = np.float64(2 * n + 1 - taps) / np.float64(2 * taps + 2)
    return place[0] + shift * way[0], place[1] + shift * way[1]
