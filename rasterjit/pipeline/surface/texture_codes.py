"""
Read textures of unlit objects as 8-bit sRGB codes, by float32 coordinates.

Where ``Quality.texture_mixing`` is ``"srgb8"``: the four texels around a place are mixed in fixed
point, two channels in one 32-bit number, with weights of 8 bits; base colours multiply codes.
Coordinates are interpolated from edge functions as in ``uv_interpolation``, but in float32, and for
clipped faces and very wide ones in float64. A sample's code depends on its face and pixel alone.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.setup import CLIPPED
from rasterjit.pipeline.lighting.light_stages import read_interval
from rasterjit.pipeline.records import CodedTextures, Geometry
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.barycentric_weights import may_have_wide_faces
from rasterjit.pipeline.surface.float32_colors import evaluate_edges_along_row
from rasterjit.pipeline.surface.float32_weights import is_wide
from rasterjit.pipeline.surface.gather_samples import (
    get_patch_vertices,
    get_pixel,
    round_up_to_vectors,
)
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.surface.texture_filters import (
    CLAMP,
    MIRROR,
    NEAREST,
    REPEAT,
    read_vertex_uvs,
)
from rasterjit.pipeline.surface.texture_lookup import TAP_U, TAP_V, U, V
from rasterjit.pipeline.surface.uv_interpolation import (
    interpolate_clipped_uv,
    interpolate_uv_exactly,
    multiply_other_ws,
)
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int64, uint32

FIRST_TEXEL, WIDTH, HEIGHT, WRAP_U, WRAP_V, FILTER, FACTOR = range(7)
"""Columns of ``CodedTextures.table``."""
TABLE_COLUMNS = 7

CODES = 0
"""Row of ``lookup_ints``: the codes of samples."""
PLACE_U, PLACE_V = 0, 1
"""Rows of ``floats``: texture coordinates."""

OPAQUE = np.uint32(0xFF000000)
PAIR = np.uint32(0x00FF00FF)
"""Two channels of a code, with room for 8 bits above each."""
WHITE = 0xFFFFFF

MAX_W_RATIO = 2.0**60
"""Ratio of products of w, up to which float32 holds the sums of weights all over a face."""


@disjoint_helper
def interpolate_float32_uv(u, v, edges, steps, factors, uv_first, differences):
    """
    Write texture coordinates of neighbouring samples of one face.

    Takes the edge functions of the first sample and their steps to the right, exact in float64; a
    factor for each; the coordinates of the first vertex, and the differences of the others to it.
    """
    for n in range(u.shape[0]):
        k = np.float64(np.int32(n))
        first = np.float32(edges[0] + k * steps[0]) * factors[0]
        second = np.float32(edges[1] + k * steps[1]) * factors[1]
        third = np.float32(edges[2] + k * steps[2]) * factors[2]
        over = np.float32(1.0) / (first + second + third)
        s, t = second * over, third * over
        u[n] = uv_first[0] + (s * differences[0] + t * differences[2])
        v[n] = uv_first[1] + (s * differences[1] + t * differences[3])


@disjoint_helper
def round_places(doubles, shift, places):
    """Write coordinates, less a shift, in float32."""
    for n in range(places.shape[0]):
        places[n] = np.float32(doubles[n] - shift)


@helper
def encode_wrap(wrap):
    """
    Return the numbers that encode how a wrap mode brings a coordinate into 0..1.

    Bounds; scale before whole periods are subtracted, the periods, scale after; where it is folded.
    """
    one, zero, many = np.float32(1.0), np.float32(0.0), np.float32(1e30)
    if wrap == CLAMP:
        return zero, one, one, zero, one, many
    if wrap == MIRROR:
        two = np.float32(2.0)
        return -many, many, np.float32(0.5), one, two, two
    return -many, many, one, one, one, many


@helper
def find_position(u, size, rule):
    """Return where a wrapped coordinate lies, texels, 0..size; 0 for NaN."""
    lowest, highest, before, periods, after, fold = rule
    scaled = before * min(max(u, lowest), highest)
    reduced = after * (scaled - periods * np.floor(scaled))
    position = min(reduced, fold - reduced) * size
    position = position if position > np.float32(0.0) else np.float32(0.0)
    return position if position < size else size


@disjoint_helper
def read_nearest_codes(u, v, texels, image, rules, codes):
    """Write the codes of the texels that hold the places."""
    first, width, height = image
    one, across, down = np.int32(1), np.float32(width), np.float32(height)
    for n in range(u.shape[0]):
        column = min(np.int32(find_position(u[n], across, rules[0])), np.int32(width - one))
        row = min(np.int32(find_position(v[n], down, rules[1])), np.int32(height - one))
        # Rows of texels run down.
        row = np.int32(np.int32(height - one) - row)
        texel = np.uint32(first + np.int32(np.int32(row * width) + column))
        codes[n] = np.int32(texels[np.uintp(texel)])


@helper
def mix_codes(low, high, weight):
    """Mix two codes, by a weight of 0..256 of the second."""
    rest, half = np.uint32(np.uint32(256) - weight), np.uint32(0x00800080)
    even = np.uint32(np.uint32((low & PAIR) * rest) + np.uint32((high & PAIR) * weight))
    odd = np.uint32(
        np.uint32(((low >> np.uint32(8)) & PAIR) * rest)
        + np.uint32(((high >> np.uint32(8)) & PAIR) * weight)
    )
    even, odd = np.uint32(even + half), np.uint32(odd + half)
    return np.uint32(((even >> np.uint32(8)) & PAIR) | (odd & np.uint32(~PAIR)))


@disjoint_helper
def read_mixed_codes(u, v, texels, image, rules, ends, codes):
    """
    Write the codes mixed of the four texels around the places.

    ``ends``: the column before the first one and the one behind the last, and such rows.
    """
    first, width, height = image
    one, zero, half, steps = np.int32(1), np.int32(0), np.float32(0.5), np.float32(256.0)
    across, down = np.float32(width), np.float32(height)
    bottom = np.int32(first + np.int32(np.int32(height - one) * width))
    for n in range(u.shape[0]):
        x = find_position(u[n], across, rules[0]) - half
        y = find_position(v[n], down, rules[1]) - half
        column, row = np.floor(x), np.floor(y)
        right_weight = np.uint32((x - column) * steps + half)
        upper_weight = np.uint32((y - row) * steps + half)
        left, low = np.int32(column), np.int32(row)
        right, high = np.int32(left + one), np.int32(low + one)
        left, right = left if left >= zero else ends[0], right if right < width else ends[1]
        low, high = low if low >= zero else ends[2], high if high < height else ends[3]
        # Rows of texels run down.
        low, high = np.int32(bottom - low * width), np.int32(bottom - high * width)
        below = mix_codes(
            texels[np.uintp(np.uint32(low + left))], texels[np.uintp(np.uint32(low + right))],
            right_weight,
        )  # fmt: skip
        above = mix_codes(
            texels[np.uintp(np.uint32(high + left))], texels[np.uintp(np.uint32(high + right))],
            right_weight,
        )  # fmt: skip
        codes[n] = np.int32(mix_codes(below, above, upper_weight))


@helper
def multiply_channel(code, factor, shift):
    """Return the product of a channel of two codes, shares of 255, in its place."""
    channel = np.uint32(np.uint32(code >> shift) & np.uint32(255))
    scale = np.uint32(np.uint32(factor >> shift) & np.uint32(255))
    product = np.uint32(np.uint32(channel * scale) + np.uint32(128))
    product = np.uint32(np.uint32(product + np.uint32(product >> np.uint32(8))) >> np.uint32(8))
    return np.uint32(product << shift)


@disjoint_helper
def multiply_codes(codes, factor):
    """Multiply codes by that of the base colour."""
    for n in range(codes.shape[0]):
        code = np.uint32(codes[n])
        codes[n] = np.int32(
            multiply_channel(code, factor, np.uint32(0))
            | multiply_channel(code, factor, np.uint32(8))
            | multiply_channel(code, factor, np.uint32(16))
        )


@helper
def find_ends(size, wrap):
    """Return which texel stands before the first, and which behind the last."""
    last = np.int32(size - np.int32(1))
    if wrap == REPEAT:
        return last, np.int32(0)
    # The neighbour of a mirrored end is that end again.
    return np.int32(0), last


@helper
def read_patch_codes(start, stop, row, block, textures):
    """Write the codes of samples whose places are known."""
    image = np.int32(row[FIRST_TEXEL]), np.int32(row[WIDTH]), np.int32(row[HEIGHT])
    rules = encode_wrap(row[WRAP_U]), encode_wrap(row[WRAP_V])
    u, v = part(block.floats, PLACE_U, start, stop), part(block.floats, PLACE_V, start, stop)
    codes = part(block.lookup_ints, CODES, start, stop)
    if row[FILTER] == NEAREST:
        read_nearest_codes(u, v, textures.texels, image, rules, codes)
    else:
        ends = (*find_ends(image[1], row[WRAP_U]), *find_ends(image[2], row[WRAP_V]))
        read_mixed_codes(u, v, textures.texels, image, rules, ends, codes)
    if row[FACTOR] != WHITE:
        multiply_codes(codes, np.uint32(row[FACTOR]))


@helper
def transform_vertex_uv(uv, transform):
    """Return texture coordinates after the texture's transform."""
    return (
        transform[0] * uv[0] + transform[1] * uv[1] + transform[2],
        transform[3] * uv[0] + transform[4] * uv[1] + transform[5],
    )


@helper
def find_shift(coordinate, wrap):
    """Return the whole periods to subtract from a coordinate before it is rounded to float32."""
    return 0.0 if wrap == CLAMP else 2.0 * np.floor(0.5 * coordinate)


@helper
def have_accurate_sums(factors):
    """Return whether float32 sums of edge functions times the factors are accurate on the face."""
    least = min(factors[0], min(factors[1], factors[2]))
    return max(factors[0], max(factors[1], factors[2])) < MAX_W_RATIO * least


@helper
def find_run_places(u, v, corners, pixel, vertex_uvs, shift, factors, geometry):
    """Write the places of neighbouring samples of a face, by float32 weights."""
    (a, b, c), (at_a, at_b, at_c) = corners, vertex_uvs
    edges, steps = evaluate_edges_along_row(
        a, b, c, pixel[0], pixel[1], geometry.viewport.grid_bits, geometry.xy
    )
    scale = 1.0 / max(factors[0], max(factors[1], factors[2]))
    p, q, r = factors[0] * scale, factors[1] * scale, factors[2] * scale
    first = np.float32(at_a[0] - shift[0]), np.float32(at_a[1] - shift[1])
    second = np.float32(at_b[0] - at_a[0]), np.float32(at_b[1] - at_a[1])
    third = np.float32(at_c[0] - at_a[0]), np.float32(at_c[1] - at_a[1])
    interpolate_float32_uv(
        u, v, edges, steps, (np.float32(p), np.float32(q), np.float32(r)), first,
        (second[0], second[1], third[0], third[1]),
    )  # fmt: skip


@helper
def find_patch_places(first, end, corners, pixel, row, transform, has_wide, uv, block, geometry):
    """Write the places of the samples of a patch, the first at a pixel, on their texture."""
    (a, b, c), codes = corners, geometry.codes
    at_a, at_b, at_c = read_vertex_uvs(uv, a, b, c)
    at_a, at_b = transform_vertex_uv(at_a, transform), transform_vertex_uv(at_b, transform)
    vertex_uvs = at_a, at_b, transform_vertex_uv(at_c, transform)
    shift = find_shift(at_a[0], row[WRAP_U]), find_shift(at_a[1], row[WRAP_V])
    stop = first + round_up_to_vectors(end - first)
    u, v = part(block.floats, PLACE_U, first, stop), part(block.floats, PLACE_V, first, stop)
    factors = multiply_other_ws(a, b, c, geometry.w)
    is_clipped = np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED) != 0
    is_exact = (has_wide and is_wide(a, b, c, geometry.xy)) or not have_accurate_sums(factors)
    if not (is_clipped or is_exact):
        find_run_places(u, v, corners, pixel, vertex_uvs, shift, factors, geometry)
        return
    exact_u = part(block.uv_rows, TAP_U, first, stop)
    exact_v = part(block.uv_rows, TAP_V, first, stop)
    if is_clipped:
        interpolate_clipped_uv(
            exact_u, exact_v, corners, vertex_uvs, pixel[0], pixel[1], geometry.clip_positions,
            geometry.viewport,
        )  # fmt: skip
    else:
        interpolate_uv_exactly(
            exact_u, exact_v, end - first, corners, vertex_uvs, pixel[0], pixel[1], geometry
        )
    round_places(exact_u, shift[0], u)
    round_places(exact_v, shift[1], v)


@helper
def look_up_codes(block, uv, geometry, textures, has_wide, k):
    """Write the codes of a segment, patch by patch."""
    segment, ints = block.segments[k], block.ints
    owner = np.uintp(segment[rows.OWNER])
    row, transform = textures.table[owner], textures.transforms[owner]
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        first = np.int64(ints[rows.FIRST_SAMPLE, r])
        end = np.int64(ints[rows.FIRST_SAMPLE, r + np.uintp(1)])
        find_patch_places(
            first, end, get_patch_vertices(ints, r), get_pixel(first, segment, ints), row,
            transform, has_wide, uv, block, geometry,
        )  # fmt: skip
        read_patch_codes(first, first + round_up_to_vectors(end - first), row, block, textures)


@helper
def look_up_codes_beside(block, textures, k):
    """Write the codes of a segment whose samples lie beside their faces, by ``uv_rows``."""
    segment = block.segments[k]
    owner = np.uintp(segment[rows.OWNER])
    row, transform = textures.table[owner], textures.transforms[owner]
    start = np.int64(segment[rows.START])
    stop = start + round_up_to_vectors(segment[rows.STOP] - start)
    for n in range(np.uintp(start), np.uintp(stop)):
        u, v = transform_vertex_uv((block.uv_rows[U, n], block.uv_rows[V, n]), transform)
        block.floats[PLACE_U, n] = np.float32(u - find_shift(u, row[WRAP_U]))
        block.floats[PLACE_V, n] = np.float32(v - find_shift(v, row[WRAP_V]))
    read_patch_codes(start, stop, row, block, textures)


@stage
def decode_texture_codes(
    block: Block, count, uv: float32[:, ::1], geometry: Geometry, textures: CodedTextures,
    on_faces: int64, curve: float32[::1],
):  # fmt: skip
    """
    Write the base colours of objects whose textures are read as codes, in linear light.

    After the textures of all objects were read and multiplied.

    Parameters
    ----------
    block : Block
        Writes rows RED to BLUE of ``samples``.
    uv : (V, 2) float32; v runs up
    geometry : Geometry
    textures : CodedTextures
    on_faces : int
        Not 0 if samples lie on their faces, at pixel centres.
    curve : (256,) float32
        Linear light of sRGB codes.
    """
    has_wide = may_have_wide_faces(geometry.viewport)
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        if textures.table[np.uintp(segment[rows.OWNER]), FIRST_TEXEL] < 0:
            continue
        if on_faces != 0:
            look_up_codes(block, uv, geometry, textures, has_wide, k)
        else:
            look_up_codes_beside(block, textures, k)
        for n in range(np.uintp(segment[rows.START]), np.uintp(segment[rows.STOP])):
            code = np.uint32(block.lookup_ints[CODES, n])
            for channel in range(3):
                value = np.uint32(np.uint32(code >> np.uint32(8 * channel)) & np.uint32(255))
                block.samples[rows.RED + channel, n] = curve[np.uintp(value)]


@disjoint_helper
def copy_opaque(codes, color):
    """Write codes with alpha 255."""
    for n in range(color.shape[0]):
        color[n] = np.uint32(codes[n]) | OPAQUE


@stage
def write_texture_codes(
    block: Block, count, uv: float32[:, ::1], geometry: Geometry, textures: CodedTextures,
    color: uint32[:, ::1],
):  # fmt: skip
    """
    Write the codes of textures where all objects in view show nothing else.

    Parameters
    ----------
    block : Block
    uv : (V, 2) float32; v runs up
    geometry : Geometry
    textures : CodedTextures
    color : (R, W) uint32
        Writes opaque sRGB codes, RGBA bytes from the lowest up.
    """
    has_wide = may_have_wide_faces(geometry.viewport)
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        look_up_codes(block, uv, geometry, textures, has_wide, k)
    for k in range(block.counts[rows.INTERVAL_COUNT]):
        row, column, start, stop = read_interval(block, k)
        copy_opaque(
            part(block.lookup_ints, CODES, start, stop),
            color[row, column : column + stop - start],
        )  # fmt: skip
