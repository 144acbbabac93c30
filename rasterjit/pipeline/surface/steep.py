"""
Find samples that lie where light jumps, or changes more steeply than bounds by slopes allow.

Bounds of ``survey.precision`` take it that a highlight moves by a share of itself as normal, light
and viewer turn. With the cosines ``n_l``, ``n_v`` and ``n_h`` of the normal with the directions of
a light ``l``, of the viewer ``v`` and halfway between, that does not hold

- where ``n_l`` is 0: Blinn's highlight ends there, whatever it is (glossy materials alone);
- where ``n_h`` is 0 and ``n_v`` below 0: facets of GGX end there, which face backwards;
- where ``n_l`` or ``n_v`` are so small that Smith's term changes by more of itself than the rest
  does: ``n_l`` times it is ``n_l / 2 (n_v s(n_l) + n_l s(n_v))``, which moves, over both cosines,
  by at most ``(alpha + n_l) / (alpha**2 (n_l + n_v))``;
- where ``l + v`` is so short that what lies halfway turns by more than both do.

With ``e``, what ``n_l`` and ``n_v`` may be off by together, a sample that is lit takes float64

- within ``e`` of a jump, unless it is darker than a share of a code, `STEEP_SHARE`;
- where a cosine is below `SHARES` times ``e`` and what Smith's term may move, of all lights
  together, is above that share;
- where ``l + v`` is shorter than 1, and than what errors of points come to over what they may.

That depends on the face of a sample, on its pixel and on the lights that reach it. Of faces that
surely hold no such sample (`is_calm`) none is looked at.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.lighting.blinn_phong import light_at, unit_scale
from rasterjit.pipeline.lighting.pbr import LEAST_COSINE, grazing
from rasterjit.pipeline.surface.lamps import CODES_PER_SHARE, ROUNDING, SLOPE, square
from rasterjit.runtime.jit import disjoint_helper, helper

GLOSS, SHOWN, SHINE = 9, 10, 11
"""
Elements of limits: see ``survey.precision.limits_of``.

The width of facets, `BLINN` for another highlight, or `MATT`; what facets mirror at least, or the
least cosine of Blinn's highlight that shows; by how much a highlight moves with the direction
halfway, over what it may.
"""

MATT, BLINN = np.float32(-1.0), np.float32(0.0)

EXPOSED = np.float32(2.0)
"""What light is multiplied by at most before it is shown."""

STEEP_SHARE = 1.0 / 128.0
"""Of a code that jumps and steep places may come to."""

MOST_STEEP = np.float32(0.5 * STEEP_SHARE)
"""Of a code that Smith's term may come to by itself; as much is left to shares of what is seen."""

SHARES = np.float32(2.0 * CODES_PER_SHARE / (0.5 * STEEP_SHARE))
"""Cosines above this times their error change by shares of themselves that come to the rest."""

ROUNDED = np.float32(8.0 * ROUNDING)
"""Roundings of a cosine with a direction, and of the direction."""

SHORTEST = np.float32(2.0**-20)
"""Squared sums of two directions below this are nothing but rounding."""

JUMP = np.float32(1e9)
"""Stands for what a jump comes to."""

WIDER = np.float32(1.0 + 2.0**-10)
"""Bounds of faces times this are above those of their samples, however they are rounded."""

USUAL = np.float32(2.0**-42)
"""Squared share of itself that normals and points are mostly off by at most: `note_steep`."""

CLEAR, APART = np.float32(0.0144), np.float32(2.0**-34)
"""
Squared cosines above which a sample that is usual is clear of what is steep, and of a jump.

Three errors of the root of `USUAL`, and what cosines are rounded by, are 1.91e-6: a quarter of the
root of the second, and, times `SHARES`, 0.11.
"""

QUARTER = np.float32(0.24)
"""Squared cosine of two directions below which their sum is longer than 1, somewhat rounded."""

NORMAL_ROUNDINGS, BENT_ROUNDINGS = np.float32(5.0 * ROUNDING), np.float32(17.0 * ROUNDING)
POINT_ROUNDINGS, WAY_ROUNDINGS = np.float32(3.0 * ROUNDING), np.float32(23.0 * ROUNDING)
"""What normals and points are off by, see ``survey.precision``: over the first and the ways."""


@helper
def normal_error(first, bent):
    """Return what a normal is off by, given squared lengths of the first and the longer way."""
    return NORMAL_ROUNDINGS * np.sqrt(first) + BENT_ROUNDINGS * np.sqrt(bent)


@helper
def point_error(first, moved):
    """Return what a point is off by, given squared lengths of the first and the longer way."""
    return POINT_ROUNDINGS * np.sqrt(first) + WAY_ROUNDINGS * np.sqrt(moved)


@helper
def smith_slope(n_l, n_v, n_h, v_h, alpha, mirrored):
    """Return what a highlight of facets changes by over both cosines at most, of light of 1."""
    one, squared = np.float32(1.0), alpha * alpha
    lit, seen = max(n_l, np.float32(0.0)), max(n_v, LEAST_COSINE)
    near = min(max(n_h, np.float32(0.0)), one)
    spread = max(one - (one - squared) * (near * near), squared)
    facets = squared / (spread * spread)
    facets *= mirrored + (one - mirrored) * grazing(v_h)
    return facets * (alpha + lit) / (squared * (lit + seen))


@disjoint_helper
def add_steep(
    nx, ny, nz, px, py, pz, off_normal, off_point, steep, light, viewer, limits
):  # fmt: skip
    """
    Add what a light comes to at its jumps and steep places, codes.

    Parameters
    ----------
    nx, ny, nz, px, py, pz : (N,) float32
        Normals, any length, and points.
    off_normal, off_point : (N,) float32
        What they may be off by.
    steep : (N,) float32
        Added to.
    light, viewer : tuple of 13 and of 4 float32
    limits : (12,) float32
    """
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    alpha, shown, shine = limits[GLOSS], limits[SHOWN], limits[SHINE]
    bright = EXPOSED * max(light[4], max(light[5], light[6]))
    is_blinn = alpha == BLINN
    for i in range(nx.shape[0]):
        lx, ly, lz, share = light_at(light, px[i], py[i], pz[i])
        vx, vy, vz = (
            viewer[0] - viewer[3] * px[i], viewer[1] - viewer[3] * py[i],
            viewer[2] - viewer[3] * pz[i],
        )  # fmt: skip
        ax, ay, az = (
            light[0] - light[3] * px[i], light[1] - light[3] * py[i],
            light[2] - light[3] * pz[i],
        )  # fmt: skip
        over_n, over_v = unit_scale(nx[i], ny[i], nz[i]), unit_scale(vx, vy, vz)
        n_l = (nx[i] * lx + ny[i] * ly + nz[i] * lz) * over_n
        n_v = (nx[i] * vx + ny[i] * vy + nz[i] * vz) * (over_n * over_v)
        along = (lx * vx + ly * vy + lz * vz) * over_v
        turned = off_normal[i] * over_n
        moved = off_point[i] * (light[3] * unit_scale(ax, ay, az) + viewer[3] * over_v)
        error = turned + moved + ROUNDED
        long = two + two * along
        length = np.sqrt(max(long, SHORTEST))
        n_h = (n_l + n_v) / length
        is_lit = (n_l > -error) & (share * bright > zero)
        # Blinn's highlight ends where light does; facets end where they face backwards.
        is_short = ((moved * shine > length) & (length < one)) | (long <= SHORTEST)
        is_shown = n_h + two * error / length > shown
        ends = (abs(n_l) <= error) | is_short
        back = ((n_v <= error) & (abs(n_l + n_v) <= two * error)) | is_short
        v_h, width = np.float32(0.5) * length, one if is_blinn else alpha
        slope = smith_slope(n_l, n_v, n_h, v_h, width, shown)
        slope *= np.float32(SLOPE) * (bright * share) * error
        slope = slope if min(n_l, n_v) < SHARES * error else zero
        slope = JUMP if back else slope
        own = (JUMP if is_shown & ends else zero) if is_blinn else slope
        steep[i] += own if is_lit else zero


@disjoint_helper
def note_steep(
    nx, ny, nz, px, py, pz, off_normal, off_point, steep, light, viewer, limits
):  # fmt: skip
    """
    Write 1 where a light may jump or be steep, at little cost: without a root or a quotient.

    Takes what `add_steep` does. What is off by more than `USUAL` of itself may be.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    is_blinn = limits[GLOSS] == BLINN
    least = APART if is_blinn else CLEAR
    for i in range(nx.shape[0]):
        lx, ly, lz = (
            light[0] - light[3] * px[i], light[1] - light[3] * py[i],
            light[2] - light[3] * pz[i],
        )  # fmt: skip
        vx, vy, vz = (
            viewer[0] - viewer[3] * px[i], viewer[1] - viewer[3] * py[i],
            viewer[2] - viewer[3] * pz[i],
        )  # fmt: skip
        normal, far_l, far_v = (
            square(nx[i], ny[i], nz[i]), square(lx, ly, lz), square(vx, vy, vz)
        )  # fmt: skip
        n_l = nx[i] * lx + ny[i] * ly + nz[i] * lz
        n_v = nx[i] * vx + ny[i] * vy + nz[i] * vz
        off_n, off_p = off_normal[i] * off_normal[i], off_point[i] * off_point[i]
        is_usual = (off_n < USUAL * normal) & (light[3] * off_p < USUAL * far_l)
        is_usual &= viewer[3] * off_p < USUAL * far_v
        l_squared, v_squared = n_l * n_l, n_v * n_v
        along = lx * vx + ly * vy + lz * vz
        is_dark = (n_l < zero) & (l_squared > APART * (normal * far_l))
        is_clear = (n_l > zero) & (l_squared > least * (normal * far_l))
        is_clear &= is_blinn | ((n_v > zero) & (v_squared > least * (normal * far_v)))
        is_clear &= (along > zero) | (along * along < QUARTER * (far_l * far_v))
        steep[i] = steep[i] if is_usual & (is_dark | is_clear) else one


@helper
def is_calm(first, bent, point, way, errors, light, viewer, limits):
    """
    Return whether surely no sample of a face is at a jump or a steep place of a light.

    Parameters
    ----------
    first, point : tuple of 3 float32
        Normal and place of the first vertex.
    bent, way : float32
        Lengths of the longer ways from there to those of another.
    errors : tuple of 2 float32
        What normals and points may be off by.
    light, viewer : tuple of 13 and of 4 float32
    limits : (11,) float32
    """
    one, far_n = np.float32(1.0), np.sqrt(square(first[0], first[1], first[2]))
    lx, ly, lz = (
        light[0] - light[3] * point[0], light[1] - light[3] * point[1],
        light[2] - light[3] * point[2],
    )  # fmt: skip
    vx, vy, vz = (
        viewer[0] - viewer[3] * point[0], viewer[1] - viewer[3] * point[1],
        viewer[2] - viewer[3] * point[2],
    )  # fmt: skip
    far_l, far_v = np.sqrt(square(lx, ly, lz)), np.sqrt(square(vx, vy, vz))
    step_l, step_v = light[3] * way, viewer[3] * way
    least_n, least_l, least_v = far_n - bent, far_l - step_l, far_v - step_v
    size_l, size_v = (far_n + bent) * (far_l + step_l), (far_n + bent) * (far_v + step_v)
    rest_l = far_n * step_l + bent * (far_l + step_l)
    rest_v = far_n * step_v + bent * (far_v + step_v)
    along_l = first[0] * lx + first[1] * ly + first[2] * lz
    along_v = first[0] * vx + first[1] * vy + first[2] * vz
    is_told = min(least_n, min(least_l, least_v)) > np.float32(0.0)
    moved = WIDER * (errors[1] * (light[3] / least_l + viewer[3] / least_v))
    error = WIDER * (errors[0] / least_n + moved + ROUNDED)
    low_l, low_v = along_l - WIDER * rest_l, along_v - WIDER * rest_v
    is_dark = along_l + WIDER * rest_l < -error * size_l
    # Directions on one side of a face are as long together as their cosines.
    low_l, low_v = low_l / (WIDER * size_l), low_v / (WIDER * size_v)
    shortest = max(min(moved * limits[SHINE], one), np.float32(2.0**-9))
    if limits[GLOSS] != BLINN:
        is_clear = min(low_l, low_v) > WIDER * (SHARES * error)
        return is_told & (is_dark | (is_clear & (low_l + low_v > WIDER * shortest)))
    # Where light ends, a highlight is dark if the viewer is far enough from halfway.
    along = (lx * vx + ly * vy + lz * vz) / (far_l * far_v)
    turned = step_l / far_l + step_v / far_v
    long = np.float32(2.0) * along - np.float32(4.0) * turned + np.float32(1.99)
    high_v = (along_v + WIDER * rest_v) / (least_n * least_v)
    ends_dark = WIDER * (high_v + np.float32(4.0) * error) < limits[SHOWN] * np.sqrt(max(long, one))
    is_clear = (low_l > WIDER * error) & (low_l + low_v > WIDER * shortest)
    return is_told & (is_dark | is_clear | (ends_dark & (long > one)))
