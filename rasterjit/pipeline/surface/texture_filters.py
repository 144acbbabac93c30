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

from rasterjit.pipeline.geometry.setup import get_picture_size
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

SRGB, LINEAR, OPAQUE = 0, 1, 2
"""Rows of ``Textures.curves``: sRGB; code / 255, as for alpha; 1 for any code."""

FIRST_TEXEL, LEVEL_WIDTH, LEVEL_HEIGHT = 0, 1, 2
"""Columns of ``Textures.levels``."""

STEPS_PER_TEXEL = 2.0**24
"""
Positions are rounded to 1/STEPS_PER_TEXEL texel.

So fine a step fits float32 weights exactly, and is far above the rounding errors of interpolated
coordinates: a sample on the middle of a texel shows that texel alone, one on a border is on it.
"""

MAX_STEP_SQUARED = 1e30
"""Largest squared step, texels: beyond the coarsest level of any texture, and finite in float32."""


@helper
def get_level(levels, n):
    """Return first texel, width and height of a level."""
    return levels[n, FIRST_TEXEL], levels[n, LEVEL_WIDTH], levels[n, LEVEL_HEIGHT]


@helper
def differentiate_weights(inverse_sum, ratios, right, down):
    """
    Return the derivatives of weights to the right and down, from those of their edge functions.

    Takes one over the weights' sum, in the unit of the steps, and smallest w / w of each vertex.
    """
    p, q, r = ratios[0] * inverse_sum, ratios[1] * inverse_sum, ratios[2] * inverse_sum
    return (
        (p * right[0], q * right[1], r * right[2]),
        (p * down[0], q * down[1], r * down[2]),
    )


@helper
def differentiate_clipped_weights(a, b, c, column, row, clip, viewport):
    """
    Return the derivatives of a clipped face's weights at a pixel's centre, over their sum.

    Two times three numbers: per sample to the right, and down, for weights that are not normalized.
    """
    width, height = get_picture_size(viewport)
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
def differentiate_uv(weight_derivatives, uv, uv0, uv1, uv2):
    """Return the derivatives of u and v, given those of the weights."""
    d0, d1, d2 = weight_derivatives
    total = d0 + d1 + d2
    return (
        d1 * (uv1[0] - uv0[0]) + d2 * (uv2[0] - uv0[0]) - total * (uv[0] - uv0[0]),
        d1 * (uv1[1] - uv0[1]) + d2 * (uv2[1] - uv0[1]) - total * (uv[1] - uv0[1]),
    )


@helper
def square_length(step, width, height):
    """Return the squared length of a step, in texels of a level."""
    u, v = step[0] * width, step[1] * height
    return u * u + v * v


@helper
def level_of_detail(squared):
    """Return log2 of a step's length, given its square; 0 where a texel covers the pixel."""
    if not squared > 1.0:
        return np.float32(0.0)
    return np.float32(0.5) * log2(np.float32(min(squared, MAX_STEP_SQUARED)))


@helper
def read_vertex_uvs(uv, a, b, c):
    """Return the texture coordinates of a face's three vertices."""
    return (
        (np.float64(uv[a, 0]), np.float64(uv[a, 1])),
        (np.float64(uv[b, 0]), np.float64(uv[b, 1])),
        (np.float64(uv[c, 0]), np.float64(uv[c, 1])),
    )


@helper
def make_isotropic_footprint(right_squared, down_squared):
    """Return an isotropic footprint: the longer step's squared length, one tap, no axis."""
    return max(right_squared, down_squared), np.int64(1), (0.0, 0.0)


@helper
def make_anisotropic_footprint(right_squared, down_squared, right_step, down_step, max_parts):
    """
    Return an anisotropic footprint: a squared length, a number of taps, and their axis.

    The footprint is divided along its longer step into at most ``max_parts`` parts, each as long as
    the shorter step, or as a texel if that is shorter. Takes squared lengths in texels, and steps.
    """
    longer, shorter = max(right_squared, down_squared), max(min(right_squared, down_squared), 1.0)
    if not (longer > shorter and max_parts > 1):
        return make_isotropic_footprint(right_squared, down_squared)
    parts = min(np.sqrt(longer / shorter), np.float64(max_parts))
    axis = right_step if right_squared > down_squared else down_step
    return longer / (parts * parts), np.int64(np.ceil(parts)), axis


@helper
def split_level_of_detail(detail, count):
    """Split a level of detail into the finer mip level and the weight of the coarser one."""
    finer, last = np.int32(detail), count - np.int32(1)
    is_last = finer >= last
    return last if is_last else finer, np.float32(0.0) if is_last else detail - np.float32(finer)


@helper
def position_tap(uv, axis, tap, taps):
    """Return the position of tap ``tap`` of a footprint; a single one is centred."""
    if taps == 1:
        return uv
    shift = np.float64(2 * tap + 1 - taps) / np.float64(2 * taps + 2)
    return uv[0] + shift * axis[0], uv[1] + shift * axis[1]
