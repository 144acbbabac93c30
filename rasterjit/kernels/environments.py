"""
Look up the environment: what it sheds on a surface, what a surface mirrors of it, what is behind.

The light that falls on a surface from all sides is a polynomial of its normal [1]_. What it mirrors
is looked up once in a picture filtered for its roughness, and weighted by the share of the light
that its facets send on at once [2]_; what they send on after several bounces [3]_ comes from all
sides. A white surface under white light is white, however rough and however metallic.

Directions become longitude and latitude by a polynomial of our own, whose bits are the same on
every CPU.

References
----------
.. [1] R. Ramamoorthi, P. Hanrahan, "An Efficient Representation for Irradiance Environment Maps",
   SIGGRAPH 2001.
.. [2] B. Karis, "Real Shading in Unreal Engine 4", SIGGRAPH 2013 courses: the split sum.
.. [3] C. Fdez-Agüera, "A Multiple-Scattering Microfacet Model for Real-Time Image-Based Lighting",
   Journal of Computer Graphics Techniques 8(1), 2019.
.. [4] S. Lagarde, C. de Rousiers, "Moving Frostbite to Physically Based Rendering", SIGGRAPH 2014
   courses: where the lobe of a rough surface points.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.lighting import log2, occlusion_share, unit_scale
from rasterjit.kernels.microfacets import DIELECTRIC, bounces, reflected_shares

IRRADIANCE_TERMS = 9
"""Of the polynomial: 1, x, y, z, xy, yz, zx, 3y² - 1, x² - z²."""

ZENITH, HORIZON, GROUND = 0, 1, 2
"""Rows of ``Environment.gradient``."""

FIRST_TEXEL, LEVEL_WIDTH, LEVEL_HEIGHT = 0, 1, 2
"""Columns of ``Reflections.levels``."""

ROUGH_LEVELS = 8
"""Filtered levels; from each to the next the roughness grows by sqrt(2), up to 1 for the last."""

LEAST_ROUGHNESS = np.float32(0.08838835)
"""Of the first filtered level, 2**-3.5; a smoother surface mirrors a mix of it and the picture."""

TANGENT_OF_EIGHTH = np.float32(0.41421357)
"""Of 22.5 degrees: above, a ratio is turned back by 45 degrees."""


@stage
def turns(y, x):
    """
    Return the angle of (x, y) from the x axis in whole turns, -1/2..1/2, to 6e-8; float32.

    Multiples of 45 degrees are exact. The arc tangent of a ratio up to tan(22.5 degrees), over 2 pi
    turns, is a polynomial with an error of 1.8e-8. No direction at all gives 0.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    ax, ay = abs(x), abs(y)
    low, high = min(ax, ay), max(ax, ay)
    ratio = low / high if high > zero else zero
    is_steep = ratio > TANGENT_OF_EIGHTH
    t = (ratio - one) / (ratio + one) if is_steep else ratio
    s = t * t
    series = np.float32(-0.01715644) * s + np.float32(0.03116409)
    series = series * s + np.float32(-0.05302115)
    series = series * s + np.float32(0.15915456)
    angle = t * series + (np.float32(0.125) if is_steep else zero)
    angle = np.float32(0.25) - angle if ay > ax else angle
    angle = np.float32(0.5) - angle if x < zero else angle
    return -angle if y < zero else angle


@stage
def held(value, least, most):
    """Return a float32 held in least..most; NaN gives the least."""
    value = value if value > least else least
    return value if value < most else most


@stage
def place_of(x, y, z):
    """Return where a direction of any length lies on a picture: shares of width and height."""
    half = np.float32(0.5)
    across = turns(z, x) + half
    down = half - np.float32(2.0) * turns(y, np.sqrt(x * x + z * z))
    return held(across, np.float32(0.0), np.float32(1.0)), held(
        down, np.float32(0.0), np.float32(1.0)
    )


@stage
def turned(x, z, turn):
    """Return x and z of a direction as the picture has them, which is turned about y."""
    return turn[0] * x - turn[1] * z, turn[1] * x + turn[0] * z


@stage
def blend3(one, other, share):
    """Return the colour between two; equal ones give exactly themselves."""
    return (
        one[0] + share * (other[0] - one[0]),
        one[1] + share * (other[1] - one[1]),
        one[2] + share * (other[2] - one[2]),
    )


@stage
def texel_at(texels, n):
    """Return one texel, linear RGB."""
    n = np.uintp(n)
    return texels[n, 0], texels[n, 1], texels[n, 2]


@stage
def filtered_texel(texels, first, width, height, place):
    """Return the bilinear mix of the four texels around a place; rows end at the poles."""
    half = np.float32(0.5)
    x = place[0] * np.float32(width) - half
    y = held(place[1] * np.float32(height) - half, np.float32(0.0), np.float32(height - 1))
    left, top = np.floor(x), np.floor(y)
    column, row = np.int64(left), np.int64(top)
    column0 = column if column >= 0 else width - 1
    column1 = column + 1 if column + 1 < width else np.int64(0)
    row0, row1 = first + row * width, first + min(row + 1, height - 1) * width
    share = x - left
    upper = blend3(texel_at(texels, row0 + column0), texel_at(texels, row0 + column1), share)
    lower = blend3(texel_at(texels, row1 + column0), texel_at(texels, row1 + column1), share)
    return blend3(upper, lower, y - top)


@stage
def gradient_color(gradient, height):
    """Return the colour of a sky without picture, where the sine of the elevation is ``height``."""
    side = ZENITH if height > np.float32(0.0) else GROUND
    share = min(abs(height), np.float32(1.0))
    low = gradient[HORIZON, 0], gradient[HORIZON, 1], gradient[HORIZON, 2]
    return blend3(low, (gradient[side, 0], gradient[side, 1], gradient[side, 2]), share)


@stage
def sharp_color(x, y, z, texels, width, height, gradient):
    """Return what is seen towards a direction of any length, which is turned already."""
    if width == 0:
        return gradient_color(gradient, y * unit_scale(x, y, z))
    return filtered_texel(texels, np.int64(0), width, height, place_of(x, y, z))


@stage
def level_at_roughness(roughness):
    """Return the level of a roughness in 0..1: 0 is the picture, then the filtered ones."""
    if roughness < LEAST_ROUGHNESS:
        return roughness / LEAST_ROUGHNESS
    level = np.float32(ROUGH_LEVELS) + np.float32(2.0) * log2(roughness)
    return held(level, np.float32(1.0), np.float32(ROUGH_LEVELS))


@stage
def level_color(level, direction, sharp, reflections):
    """Return one level towards a direction; level 0 is ``sharp``, a picture or a gradient."""
    x, y, z = direction
    texels, width, height, gradient = sharp
    if level == 0 or reflections.levels.shape[0] == 0:
        return sharp_color(x, y, z, texels, width, height, gradient)
    row = level - 1
    levels = reflections.levels
    return filtered_texel(
        reflections.texels, levels[row, FIRST_TEXEL], levels[row, LEVEL_WIDTH],
        levels[row, LEVEL_HEIGHT], place_of(x, y, z),
    )  # fmt: skip


@stage
def mirrored_color(direction, roughness, environment, reflections):
    """Return what a surface of this roughness, 0..1, mirrors from about a direction."""
    x, y, z = direction
    x, z = turned(x, z, environment.turn)
    sharp = environment.texels, environment.width, environment.height, environment.gradient
    level = level_at_roughness(roughness)
    finer = np.int64(level)
    share = level - np.float32(finer)
    color = level_color(finer, (x, y, z), sharp, reflections)
    if share > np.float32(0.0):
        coarser = level_color(finer + 1, (x, y, z), sharp, reflections)
        color = blend3(color, coarser, share)
    return color


@stage
def light_from_all_sides(x, y, z, terms, k):
    """Return the irradiance over pi of one channel, for a normal that is turned already."""
    one, three = np.float32(1.0), np.float32(3.0)
    total = terms[0, k] + terms[1, k] * x + terms[2, k] * y + terms[3, k] * z
    total += terms[4, k] * (x * y) + terms[5, k] * (y * z) + terms[6, k] * (z * x)
    total += terms[7, k] * (three * y * y - one) + terms[8, k] * (x * x - z * z)
    return max(total, np.float32(0.0))


@disjoint_stage
def add_irradiance(
    terms, turn, intensity, occlusion, nx, ny, nz, shares, red, green, blue, out_red, out_green,
    out_blue,
):  # fmt: skip
    """Add to each sample its share of the light from all sides, times its base colour."""
    for i in range(out_red.shape[0]):
        x, z = turn[0] * nx[i] - turn[1] * nz[i], turn[1] * nx[i] + turn[0] * nz[i]
        arriving = shares[i] * intensity * occlusion_share(occlusion, i)
        out_red[i] += arriving * (red[i] * light_from_all_sides(x, ny[i], z, terms, 0))
        out_green[i] += arriving * (green[i] * light_from_all_sides(x, ny[i], z, terms, 1))
        out_blue[i] += arriving * (blue[i] * light_from_all_sides(x, ny[i], z, terms, 2))


@stage
def shares_of_channel(base, metallic, dielectric, shares):
    """
    Return the shares of one channel that are mirrored, and that come from all sides.

    A mix of a metal, which only mirrors, and a dielectric: what it does not mirror goes into the
    surface and comes back coloured.
    """
    once, often = bounces(base, shares)
    inside = np.float32(1.0) - (dielectric[0] + dielectric[1])
    return (
        dielectric[0] + metallic * (once - dielectric[0]),
        (dielectric[1] + inside * base) * (np.float32(1.0) - metallic) + metallic * often,
    )


@stage
def mirror_direction(samples, n, toward_viewer, alpha):
    """Return where most of the mirrored light comes from, any length, and the viewer's cosine."""
    nx, ny, nz = samples[lit.NORMAL_X, n], samples[lit.NORMAL_Y, n], samples[lit.NORMAL_Z, n]
    vx = toward_viewer[0] - toward_viewer[3] * samples[lit.POINT_X, n]
    vy = toward_viewer[1] - toward_viewer[3] * samples[lit.POINT_Y, n]
    vz = toward_viewer[2] - toward_viewer[3] * samples[lit.POINT_Z, n]
    scale = unit_scale(vx, vy, vz)
    vx, vy, vz = vx * scale, vy * scale, vz * scale
    facing = nx * vx + ny * vy + nz * vz
    # The rougher, the closer to the normal.
    smooth = np.float32(1.0) - alpha
    bend = smooth * (np.sqrt(smooth) + alpha)
    twice = np.float32(2.0) * facing
    direction = (
        nx + bend * (twice * nx - vx - nx),
        ny + bend * (twice * ny - vy - ny),
        nz + bend * (twice * nz - vz - nz),
    )
    return direction, held(facing, np.float32(0.0), np.float32(1.0))


@stage
def add_mirrored(samples, n, arriving, environment, reflections, toward_viewer):
    """Add what one sample of a surface of facets sheds of the environment, by split sum."""
    zero, one = np.float32(0.0), np.float32(1.0)
    roughness = held(samples[lit.ROUGHNESS, n], zero, one)
    metallic = held(samples[lit.METALLIC, n], zero, one)
    direction, facing = mirror_direction(samples, n, toward_viewer, roughness * roughness)
    mirrored = mirrored_color(direction, roughness, environment, reflections)
    shares = reflected_shares(facing, roughness)
    dielectric = bounces(DIELECTRIC, shares)
    nx, ny, nz = samples[lit.NORMAL_X, n], samples[lit.NORMAL_Y, n], samples[lit.NORMAL_Z, n]
    x, z = turned(nx, nz, environment.turn)
    for k in range(3):
        direct, around = shares_of_channel(samples[lit.RED + k, n], metallic, dielectric, shares)
        light = light_from_all_sides(x, ny, z, environment.irradiance, k)
        samples[lit.OUT_RED + k, n] += arriving * (direct * mirrored[k] + around * light)


@stage
def add_reflections(samples, count, occlusion, environment, reflections, toward_viewer):
    """Add the environment to the samples of microfacets; nothing if there are none."""
    if reflections is None:
        return
    for n in range(count):
        share = samples[lit.MICROFACET, n]
        if share > np.float32(0.0):
            arriving = share * environment.intensity * occlusion_share(occlusion, n)
            add_mirrored(samples, n, arriving, environment, reflections, toward_viewer)


@stage
def add_environment(samples, count, occlusion, environment, toward_viewer):
    """
    Add what the environment sheds on a row of samples; nothing without one.

    Parameters
    ----------
    samples : (SAMPLE_ROWS, N) float32
        Reads the rows up to LIT, normals as they are to be lit, and those of microfacets if
        anything mirrors the environment; adds to rows OUT_RED.. of the first ``count`` samples.
    count : int
    occlusion : (N,) float32 or None
        The share of light from all sides that reaches each sample; ``None``: all of it.
    environment : Environment or None
    toward_viewer : (4,) float32
        A point p, relative to the eye, is seen along ``xyz - w p``.
    """
    if environment is None:
        return
    add_irradiance(
        environment.irradiance, environment.turn, environment.intensity, occlusion,
        samples[lit.NORMAL_X, :count], samples[lit.NORMAL_Y, :count],
        samples[lit.NORMAL_Z, :count], samples[lit.LIT, :count], samples[lit.RED, :count],
        samples[lit.GREEN, :count], samples[lit.BLUE, :count], samples[lit.OUT_RED, :count],
        samples[lit.OUT_GREEN, :count], samples[lit.OUT_BLUE, :count],
    )  # fmt: skip
    add_reflections(samples, count, occlusion, environment, environment.reflections, toward_viewer)
