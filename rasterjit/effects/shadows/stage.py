"""
Compute a light's visibility at each sample, by its shadow map.

A map holds the stored depth (greater is nearer to the light) of the first surface along rays from
the light, one for each texel's centre. Over a map the stored depth of a plane is linear: it is the
distance from the far side for a parallel light, and near / w for one that shines from a point. So
the plane of the sample's own face tells its depth at every texel near the sample, and a texel casts
a shadow where what it holds is nearer than that plane, by more than a bias. The plane lies in the
map as it was drawn, but for the rounding of its vertices to the sub-pixel grid, and the bias covers
that at every slope: it is some texels of depth times one plus the slope, up to a limit. Nothing of
this has a unit, so it holds at any scale.

A sample is taken to the light in three steps, each a stage: its point and the normal of its face
are found (``receivers``); for each light the point becomes texels and a depth, and the normal the
gain in depth by a texel right and down; then texels are compared (``filters``), and where surfaces
touch, the light that several comparisons let in is taken away (``light_leaks``).

References
----------
.. [1] L. Williams, "Casting Curved Shadows on Curved Surfaces", SIGGRAPH 1978.
"""

from __future__ import annotations

import numpy as np

from rasterjit.effects.shadows.filters import (
    DEPTH_ROUNDING,
    mark_shaded,
    read_hard,
    read_pcf,
    read_soft,
)
from rasterjit.effects.shadows.light_leaks import SNAP_ERROR_TEXELS, remove_contact_leaks
from rasterjit.pipeline.lighting.blinn_phong import aim_at_light
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import fill_row
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.intrinsics import part, six_parts, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, float64, int64

ORIGIN, FOCAL, CENTER = 9, 12, 14
"""
Columns of ``ShadowRecord.maps`` behind the axes of a map (across, down, away from the light; three
each, unit length): the light's position along them; texels per unit (over the depth, if the light
shines from a point), across and down; the texel below the origin, across and down.
"""
NEAR, FAR, SPAN, TEXEL_DEPTH = 16, 17, 18, 19
"""Columns: the stored depth is near / w, or (far - w) / span; stored depth that equals a texel's
width (times the stored depth, if the light shines from a point)."""
PARALLEL, BIAS_TEXELS, WIDENING = 20, 21, 22
"""Columns: 1 for a parallel light, else 0; bias in texels; a penumbra's radius, texels, per unit of
stored depth between the receiver and the blocker."""
MAP_COLUMNS = 23

FIRST_TEXEL, MAP_SIDE, FILTER, SIDES = 0, 1, 2, 3
"""Columns of ``ShadowRecord.layouts``: first texel of the light's maps, or -1 if it has none; side
of a map, texels; filter; 1 map, or 6 for the sides of a cube."""
LAYOUT_COLUMNS = 4

SAMPLES_PER_GROUP = 64
"""Samples searched together for penumbrae and contacts: the fewer, the closer together they lie,
and the smaller the common search."""

MAX_SLOPE = 4096.0
"""Largest slope of a face to the light: light that falls on a steeper one adds less than 1/4096."""

MAX_BIAS_SLOPE = 8.0
"""Slope up to which the bias grows with it: more would leak light through close occluders. Beyond
that, it grows by ``SNAP_ERROR_TEXELS``."""

MAX_COORDINATE = 2.0**30
"""Clamp for texel coordinates: far outside of any map, and within int32."""


@helper
def get_projection(row):
    """Return the columns of a row of ``ShadowRecord.maps`` that `project_plane` reads."""
    is_parallel = row[PARALLEL] != 0.0
    gain = -1.0 / row[SPAN] if is_parallel else row[NEAR]
    return (
        is_parallel, gain, row[NEAR], row[FAR], row[SPAN], row[FOCAL], row[FOCAL + 1], row[CENTER],
        row[CENTER + 1],
    )  # fmt: skip


@helper
def project_plane(s, t, w, ns, nt, nw, projection):
    """
    Project a plane to a map: return its texel, stored depth, and gain of depth by a texel.

    Parameters
    ----------
    s, t, w, ns, nt, nw : float64
        Along the axes of the map, from the light.
    projection : tuple
        See `get_projection`.
    """
    is_parallel, gain, near, far, span, focal_x, focal_y, center_x, center_y = projection
    # The plane is ns s + nt t + nw w = k; over the map, with s = S w and t = T w:
    # 1 / w = (ns S + nt T + nw) / k.
    inverse_w = 1.0 / (1.0 if is_parallel else w)
    k = -nw if is_parallel else ns * s + nt * t + nw * w
    inverse_k = 1.0 / (k if k != 0.0 else 1.0)
    inverse_k = inverse_k if k != 0.0 else 0.0
    gain *= inverse_k
    dz_du, dz_dv = gain * ns / focal_x, gain * nt / focal_y
    depth = (far - w) / span if is_parallel else near * inverse_w
    at_u, at_v = s * inverse_w * focal_x + center_x, t * inverse_w * focal_y + center_y
    return at_u, at_v, depth, dz_du, dz_dv


@helper
def clamp_slope(dz_du, dz_dv, texel):
    """Return gains clamped to `MAX_SLOPE`."""
    limit, slope = MAX_SLOPE * texel, abs(dz_du) + abs(dz_dv)
    scale = limit / (slope if slope > limit else limit)
    return dz_du * scale, dz_dv * scale


@helper
def compute_bias(texel, gain, texels):
    """Return the shadow bias of a plane, stored depth."""
    return texels * (texel + min(gain, MAX_BIAS_SLOPE * texel)) + SNAP_ERROR_TEXELS * gain


@disjoint_helper
def project_samples(px, py, pz, nx, ny, nz, row, u, v, depth, dz_du, dz_dv, bias):
    """Project samples to the map of a light, and write their planes and biases there."""
    projection, is_parallel = get_projection(row), row[PARALLEL] != 0.0
    unit, texels = row[TEXEL_DEPTH], row[BIAS_TEXELS]
    for i in range(px.shape[0]):
        x, y, z, a, b, c = px[i], py[i], pz[i], nx[i], ny[i], nz[i]
        s = row[0] * x + row[1] * y + row[2] * z - row[ORIGIN]
        t = row[3] * x + row[4] * y + row[5] * z - row[ORIGIN + 1]
        w = row[6] * x + row[7] * y + row[8] * z - row[ORIGIN + 2]
        ns = row[0] * a + row[1] * b + row[2] * c
        nt = row[3] * a + row[4] * b + row[5] * c
        nw = row[6] * a + row[7] * b + row[8] * c
        # Samples beside or behind the light are outside its map.
        is_in_front = is_parallel | (w > 0.0)
        w = w if is_in_front else 1.0
        texel_u, texel_v, d, right, below = project_plane(s, t, w, ns, nt, nw, projection)
        texel = unit * (1.0 if is_parallel else d)
        right, below = clamp_slope(right, below, texel)
        texel_u = clamped(texel_u if is_in_front else -1.0, -MAX_COORDINATE, MAX_COORDINATE)
        texel_v = clamped(texel_v, -MAX_COORDINATE, MAX_COORDINATE)
        u[i], v[i] = np.float32(texel_u), np.float32(texel_v)
        depth[i], dz_du[i], dz_dv[i] = np.float32(d), np.float32(right), np.float32(below)
        steps = compute_bias(texel, abs(right) + abs(below), texels)
        bias[i] = np.float32(steps) + DEPTH_ROUNDING * abs(depth[i])


@disjoint_helper
def project_samples_to_cube(px, py, pz, nx, ny, nz, row, size, u, v, depth, dz_du, dz_dv, bias):
    """
    Project samples to the six maps of a point light; see `project_samples`.

    The maps lie one below the other: +x, -x, +y, -y, +z, -z. A sample lies in the map of its
    longest coordinate; the other two coordinates, in cyclic order, run across and down.
    """
    projection, unit, texels = get_projection(row), row[TEXEL_DEPTH], row[BIAS_TEXELS]
    for i in range(px.shape[0]):
        x, y, z = px[i] - row[ORIGIN], py[i] - row[ORIGIN + 1], pz[i] - row[ORIGIN + 2]
        a, b, c = nx[i], ny[i], nz[i]
        is_x = (abs(x) >= abs(y)) & (abs(x) >= abs(z))
        is_y = (abs(y) >= abs(z)) & (not is_x)
        w, nw = (x if is_x else (y if is_y else z)), (a if is_x else (b if is_y else c))
        s, ns = (y if is_x else (z if is_y else x)), (b if is_x else (c if is_y else a))
        t, nt = (z if is_x else (x if is_y else y)), (c if is_x else (a if is_y else b))
        side = np.float32(0.0) if is_x else (np.float32(2.0) if is_y else np.float32(4.0))
        side += np.float32(1.0) if w < 0.0 else np.float32(0.0)
        nw, w = (-nw if w < 0.0 else nw), abs(w)
        is_in_front = w > 0.0
        w = w if is_in_front else 1.0
        texel_u, texel_v, d, right, below = project_plane(s, t, w, ns, nt, nw, projection)
        texel = unit * d
        right, below = clamp_slope(right, below, texel)
        texel_u = clamped(texel_u if is_in_front else -1.0, -MAX_COORDINATE, MAX_COORDINATE)
        texel_v = clamped(texel_v, -MAX_COORDINATE, MAX_COORDINATE)
        u[i], v[i] = np.float32(texel_u), np.float32(texel_v) + side * np.float32(size)
        depth[i], dz_du[i], dz_dv[i] = np.float32(d), np.float32(right), np.float32(below)
        steps = compute_bias(texel, abs(right) + abs(below), texels)
        bias[i] = np.float32(steps) + DEPTH_ROUNDING * abs(depth[i])


@stage
def project_to_map(block: Block, count, point: int64, row: float64[::1]):
    """
    Project samples to the map of a light, and find their planes and biases there.

    Parameters
    ----------
    block : Block
        After ``receivers.find_receivers``. Writes rows SHADOW_MAP_U.. to BIAS.
    count : int
    point : int
        First row of the points in ``receivers``, then normals: RECEIVER_POINT or OFFSET_POINT.
    row : (MAP_COLUMNS,) float64
        The light's, of ``ShadowRecord.maps``.
    """
    if block.counts[rows.IS_LIT] == 0:
        return
    s, r = block.samples, block.receivers[point:]
    project_samples(*six_parts(r, 0, 0, count), row, *six_parts(s, rows.SHADOW_MAP_U, 0, count))


@stage
def project_to_cube(block: Block, count, point: int64, row: float64[::1], size: int64):
    """Project samples to the six maps of a point light, whose sides have ``size`` texels."""
    if block.counts[rows.IS_LIT] == 0:
        return
    s, r = block.samples, block.receivers[point:]
    project_samples_to_cube(
        *six_parts(r, 0, 0, count), row, size, *six_parts(s, rows.SHADOW_MAP_U, 0, count)
    )


@helper
def remove_light_leaks(s, count, texels, size, sides):
    """Remove the light that a filter leaks where surfaces touch, a few samples at a time."""
    for a in range(0, count, SAMPLES_PER_GROUP):
        e = min(a + SAMPLES_PER_GROUP, count)
        remove_contact_leaks(
            *three_parts(s, rows.SHADOW_MAP_U, a, e), part(s, rows.DEPTH_RIGHT, a, e),
            part(s, rows.DEPTH_DOWN, a, e), texels, size, np.float32(sides),
            part(s, rows.BLOCKED_SHARE, a, e), part(s, rows.SHADOW, a, e),
        )  # fmt: skip


@stage
def filter_hard(
    block: Block, count, texels: float32[::1], size: int64, sides: int64, on_faces: int64
):  # fmt: skip
    """
    Find the visibility of a light at each sample, by the texel that the sample lies in.

    Parameters
    ----------
    block : Block
        After `project_to_map` or `project_to_cube`. Writes rows SHADOW and BLOCKED_SHARE.
    count : int
    texels : (sides * size**2,) float32
        Stored depth, of the light's maps, one below the other.
    size, sides : int
        Side of a map, texels; number of maps.
    on_faces : int
        0 if the samples are vertices, whose planes are not their faces': contacts are not searched.
    """
    if block.counts[rows.IS_LIT] == 0:
        return
    s = block.samples
    read_hard(
        *six_parts(s, rows.SHADOW_MAP_U, 0, count), texels, size, np.float32(sides),
        part(s, rows.SHADOW, 0, count),
    )  # fmt: skip
    remove_light_leaks(s, count * on_faces, texels, size, sides)


@stage
def filter_pcf(
    block: Block, count, texels: float32[::1], size: int64, sides: int64, on_faces: int64
):  # fmt: skip
    """Find the visibility of a light by 3 x 3 texels: percentage-closer filtering."""
    if block.counts[rows.IS_LIT] == 0:
        return
    s = block.samples
    read_pcf(
        *six_parts(s, rows.SHADOW_MAP_U, 0, count), texels, size, np.float32(sides),
        part(s, rows.SHADOW, 0, count),
    )  # fmt: skip
    remove_light_leaks(s, count * on_faces, texels, size, sides)


@disjoint_helper
def mark_facing(light, nx, ny, nz, px, py, pz, facing):
    """Write 1 for samples that `light_stages` light, else 0; a cosine of NaN counts as lit."""
    one, zero = np.float32(1.0), np.float32(0.0)
    if light[3] == zero:
        lx, ly, lz, _ = aim_at_light(light, zero, zero, zero)
        for i in range(facing.shape[0]):
            cosine = nx[i] * lx + ny[i] * ly + nz[i] * lz
            facing[i] = zero if cosine <= zero else one
    else:
        for i in range(facing.shape[0]):
            lx, ly, lz, _ = aim_at_light(light, px[i], py[i], pz[i])
            cosine = nx[i] * lx + ny[i] * ly + nz[i] * lz
            facing[i] = zero if cosine <= zero else one


@helper
def filter_penumbrae(block, count, texels, size, sides, widening, cells, pattern, spiral):
    """Write the visibility of samples: by penumbrae where row TURNED_AWAY is above 0, else 1."""
    s, gathered, indices, shaded = block.samples, block.floats, block.lookup_ints[0], np.int64(0)
    # Gather the samples with blockers.
    for a in range(0, count, SAMPLES_PER_GROUP):
        e = min(a + SAMPLES_PER_GROUP, count)
        mark_shaded(
            *six_parts(s, rows.SHADOW_MAP_U, a, e), texels, size, sides, widening, cells, spiral,
            part(s, rows.TURNED_AWAY, a, e), part(s, rows.BLOCKED_SHARE, a, e),
        )  # fmt: skip
    fill_row(part(s, rows.SHADOW, 0, count), np.float32(1.0))
    for n in range(np.uintp(count)):
        indices[np.uintp(shaded)] = n
        shaded += np.int64(s[rows.BLOCKED_SHARE, n] > np.float32(0.0))
    # Repeat the last sample until vectors are full.
    while shaded % rows.MAX_VECTOR_SAMPLES != 0:
        indices[np.uintp(shaded)] = indices[np.uintp(shaded - 1)]
        shaded += 1
    for k in range(6):
        for n in range(np.uintp(shaded)):
            gathered[k, n] = s[rows.SHADOW_MAP_U + k, np.uintp(indices[n])]
    # Filter the gathered samples.
    for a in range(0, shaded, SAMPLES_PER_GROUP):
        e = min(a + SAMPLES_PER_GROUP, shaded)
        read_soft(
            *six_parts(gathered, 0, a, e), texels, size, sides, widening, pattern, spiral,
            *three_parts(gathered, 6, a, e),
        )  # fmt: skip
    for n in range(np.uintp(shaded)):
        s[rows.SHADOW, np.uintp(indices[n])] = gathered[8, n]


@stage
def filter_soft(
    block: Block, count, texels: float32[::1], size: int64, sides: int64, on_faces: int64,
    row: float64[::1], cells: float32[::1], pattern: float32[:, ::1], spiral: float32[:, ::1],
    light: float32[::1],
):  # fmt: skip
    """
    Find the visibility of a light by a penumbra that widens with the distance to the blocker.

    Parameters
    ----------
    block, count, texels, size, sides, on_faces
        As `filter_hard` takes them.
    row : (23,) float64
        The light's row of ``ShadowRecord.maps``.
    cells, pattern, spiral : (N,), (P, 2) and (S, 2) float32
        As ``ShadowRecord`` has them.
    light : (LIGHT_COLUMNS,) float32, or (0,)
        See ``blinn_phong``: samples that turn away from the light are skipped, none if it is
        empty. Overwrites row TURNED_AWAY.
    """
    if block.counts[rows.IS_LIT] == 0:
        return
    s, widening = block.samples, np.float32(row[WIDENING])
    facing = part(s, rows.TURNED_AWAY, 0, count)
    fill_row(facing, np.float32(1.0))
    if light.shape[0] > 0:
        mark_facing(
            light, *three_parts(s, rows.NORMAL_X, 0, count),
            *three_parts(s, rows.POINT_X, 0, count), facing,
        )  # fmt: skip
    if sides == 1:
        # A single map saves the division that finds a sample's map at each point.
        filter_penumbrae(block, count, texels, size, None, widening, cells, pattern, spiral)
    else:
        float_sides = np.float32(sides)
        filter_penumbrae(block, count, texels, size, float_sides, widening, cells, pattern, spiral)
    remove_light_leaks(s, count * on_faces, texels, size, sides)
