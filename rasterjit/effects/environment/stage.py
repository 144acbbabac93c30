"""
Shade with image-based lighting: diffuse irradiance, specular reflections, and the background.

Irradiance is a polynomial of the normal [1]_, plus a few small bright spots, treated as directional
lights: a polynomial of low degree cannot represent them. Reflections are one lookup in a map
prefiltered for the roughness, times the single-scattering albedo (split sum) [2]_; multiple
scattering [3]_ takes the irradiance. A white surface under white light is white, for any roughness
and metallic (white furnace).

Directions become longitude and latitude by a polynomial, whose bits are the same on every CPU.

The environment is shown where no face is. A ray through a pixel is where two planes meet: with the
rows X, Y and W of ``clip_from_relative``, points seen at (x, y) in normalized device coordinates
have ``(X - x W) p = 0 = (Y - y W) p``. So the ray is the cross product of the two, which is linear
in x and y, and constant for a parallel projection.

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

from typing import NamedTuple

import numpy as np

from rasterjit.effects.tone_map.stage import ToneRecord, map_pixel
from rasterjit.pipeline.lighting import pbr
from rasterjit.pipeline.lighting.blinn_phong import invert_length
from rasterjit.pipeline.srgb_encoding import encode_pixel
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.float_math import clamped, log2
from rasterjit.runtime.intrinsics import part, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, kernel, stage
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint32

IRRADIANCE_TERMS = 9
"""Terms of the polynomial: 1, x, y, z, xy, yz, zx, 3y² - 1, x² - z²."""

ZENITH, HORIZON, GROUND = 0, 1, 2
"""Rows of ``EnvironmentRecord.gradient``."""

FIRST_TEXEL, LEVEL_WIDTH, LEVEL_HEIGHT = 0, 1, 2
"""Columns of ``Reflections.levels``."""

ROUGH_LEVELS = 8
"""Filtered levels; from each to the next the roughness grows by sqrt(2), up to 1 for the last."""

MIN_ROUGHNESS = np.float32(0.08838835)
"""Roughness of the first filtered level, 2**-3.5; below, that level is mixed with the picture."""

DIRECTION, LEVEL, COSINE, UV = 0, 3, 4, 5
"""Rows of ``floats``: `find_reflections` writes them, three for a direction, and `find_uvs` two."""

IRRADIANCE = 3
"""First of three rows of ``colors`` that `compute_irradiance` writes."""

TANGENT_OF_EIGHTH = np.float32(0.41421357)
"""Tangent of 22.5 degrees: larger ratios are rotated back by 45 degrees."""


class Irradiance(NamedTuple):
    """Irradiance over pi by the normal: the sum of three parts, clamped to 0."""

    terms: float32[:, ::1]
    """(9, 3) float32: of the polynomial of degree 2."""
    bands: float32[:, ::1]
    """(2, 3) float32: of the Legendre polynomials of y of degree 4 and 6 | (0, 3): none."""
    spots: float32[:, ::1]
    """(N, 6) float32: direction, and irradiance over pi at normal incidence."""


class Reflections(NamedTuple):
    """The environment filtered for rough surfaces."""

    texels: float32[:, ::1]
    """(N, 3) float32, linear RGB: level by level, row by row from the top."""
    levels: int64[:, ::1]
    """(8, 3) int64: first texel, width, height | (0, 3): one colour, or no reflections."""


class EnvironmentRecord(NamedTuple):
    """An environment, as light and as background."""

    irradiance: Irradiance
    yaw: float32[::1]
    """(2,) float32: cosine and sine of the rotation about y."""
    intensity: float32
    """float32, factor on all of its light."""
    texels: float32[:, ::1]
    """(N, 3) float32, linear RGB: an equirectangular picture, row by row from the top."""
    width: int64
    """Width of the picture, texels; 0 if there is none."""
    height: int64
    gradient: float32[:, ::1]
    """(3, 3) float32, linear RGB: zenith, horizon and ground, where there is no picture."""
    reflections: Reflections


@helper
def compute_turns(y, x):
    """
    Return the angle of (x, y) from the x axis in whole turns, -1/2..1/2, to 6e-8; float32.

    Multiples of 45 degrees are exact. The arc tangent of a ratio up to tan(22.5 degrees), over 2 pi
    turns, is a polynomial with an error of 1.8e-8. A vector of length 0 gives 0.
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


@helper
def find_panorama_uv(x, y, z):
    """Return u and v of a direction of any length in an equirectangular picture, 0..1."""
    half = np.float32(0.5)
    u = compute_turns(z, x) + half
    v = half - np.float32(2.0) * compute_turns(y, np.sqrt(x * x + z * z))
    zero, one = np.float32(0.0), np.float32(1.0)
    return clamped(u, zero, one), clamped(v, zero, one)


@helper
def rotate_y(x, z, yaw):
    """Return x and z of a direction rotated about y to the axes of the picture."""
    return yaw[0] * x - yaw[1] * z, yaw[1] * x + yaw[0] * z


@helper
def lerp3(a, b, t):
    """Interpolate two colours; equal ones give exactly themselves."""
    return (
        a[0] + t * (b[0] - a[0]),
        a[1] + t * (b[1] - a[1]),
        a[2] + t * (b[2] - a[2]),
    )


@helper
def get_texel(texels, n):
    """Return one texel, linear RGB."""
    n = np.uintp(n)
    return texels[n, 0], texels[n, 1], texels[n, 2]


@helper
def average_row(texels, first, width):
    """Return the mean of a row of texels; equal ones give exactly themselves."""
    red, green, blue = 0.0, 0.0, 0.0
    for n in range(width):
        color = get_texel(texels, first + n)
        red += np.float64(color[0])
        green += np.float64(color[1])
        blue += np.float64(color[2])
    count = np.float64(width)
    return np.float32(red / count), np.float32(green / count), np.float32(blue / count)


@helper
def sample_bilinear(texels, first, width, height, uv):
    """
    Sample a picture bilinearly at u and v.

    Within half a texel of a pole, the colour fades into the mean of the last row.
    """
    half = np.float32(0.5)
    x, row_y = uv[0] * np.float32(width) - half, uv[1] * np.float32(height) - half
    y = clamped(row_y, np.float32(0.0), np.float32(height - 1))
    left, top = np.floor(x), np.floor(y)
    column, row = np.int64(left), np.int64(top)
    column0 = column if column >= 0 else width - 1
    column1 = column + 1 if column + 1 < width else np.int64(0)
    row0, row1 = first + row * width, first + min(row + 1, height - 1) * width
    fraction = x - left
    upper = lerp3(get_texel(texels, row0 + column0), get_texel(texels, row0 + column1), fraction)
    lower = lerp3(get_texel(texels, row1 + column0), get_texel(texels, row1 + column1), fraction)
    color = lerp3(upper, lower, y - top)
    beyond = abs(row_y - y)
    if beyond > np.float32(0.0):
        return lerp3(color, average_row(texels, row0, width), beyond + beyond)
    return color


@helper
def get_gradient_color(gradient, height):
    """Return the colour of a gradient where the sine of the elevation is ``height``."""
    side = ZENITH if height > np.float32(0.0) else GROUND
    fraction = clamped(abs(height), np.float32(0.0), np.float32(1.0))
    low = gradient[HORIZON, 0], gradient[HORIZON, 1], gradient[HORIZON, 2]
    return lerp3(low, (gradient[side, 0], gradient[side, 1], gradient[side, 2]), fraction)


@helper
def sample_sky(x, y, z, texels, width, height, gradient):
    """Return the colour of the sky along a direction of any length, in the axes of the picture."""
    if width == 0:
        return get_gradient_color(gradient, y * invert_length(x, y, z))
    return sample_bilinear(texels, np.int64(0), width, height, find_panorama_uv(x, y, z))


@helper
def find_level(roughness):
    """Return the level of a roughness in 0..1: 0 for the picture, above for filtered levels."""
    if roughness < MIN_ROUGHNESS:
        return roughness / MIN_ROUGHNESS
    level = np.float32(ROUGH_LEVELS) + np.float32(2.0) * log2(roughness)
    return clamped(level, np.float32(1.0), np.float32(ROUGH_LEVELS))


@helper
def sample_level(level, uv, height, environment, reflections):
    """Sample one level at u and v; level 0 is a picture, or a gradient at a height."""
    if level == 0 or reflections.levels.shape[0] == 0:
        if environment.width == 0:
            return get_gradient_color(environment.gradient, height)
        first, size = np.int64(0), (environment.width, environment.height)
        return sample_bilinear(environment.texels, first, size[0], size[1], uv)
    row = level - 1
    levels = reflections.levels
    return sample_bilinear(
        reflections.texels, levels[row, FIRST_TEXEL], levels[row, LEVEL_WIDTH],
        levels[row, LEVEL_HEIGHT], uv,
    )  # fmt: skip


@helper
def sample_reflection(level, uv, height, environment, reflections):
    """Interpolate a reflection between two levels; black where `find_reflections` writes none."""
    if level < np.float32(0.0):
        return np.float32(0.0), np.float32(0.0), np.float32(0.0)
    finer = np.int64(level)
    fraction = level - np.float32(finer)
    color = sample_level(finer, uv, height, environment, reflections)
    if fraction > np.float32(0.0):
        coarser = sample_level(finer + 1, uv, height, environment, reflections)
        color = lerp3(color, coarser, fraction)
    return color


@helper
def evaluate_polynomial(x, y, z, terms, k):
    """Return one channel's irradiance over pi to degree 2, for a normal in the picture's axes."""
    one, three = np.float32(1.0), np.float32(3.0)
    total = terms[0, k] + terms[1, k] * x + terms[2, k] * y + terms[3, k] * z
    total += terms[4, k] * (x * y) + terms[5, k] * (y * z) + terms[6, k] * (z * x)
    total += terms[7, k] * (three * y * y - one) + terms[8, k] * (x * x - z * z)
    return total


@helper
def evaluate_legendre(y):
    """Return the Legendre polynomials of degree 4 and 6."""
    s = y * y
    four = (np.float32(35.0) * s - np.float32(30.0)) * s + np.float32(3.0)
    six = ((np.float32(231.0) * s - np.float32(315.0)) * s + np.float32(105.0)) * s
    return np.float32(0.125) * four, np.float32(0.0625) * (six - np.float32(5.0))


@disjoint_helper
def compute_irradiance(irradiance, yaw, nx, ny, nz, red, green, blue):
    """Write the irradiance of samples over pi."""
    zero = np.float32(0.0)
    terms, bands = irradiance.terms, irradiance.bands
    for i in range(red.shape[0]):
        x, z = rotate_y(nx[i], nz[i], yaw)
        red[i] = evaluate_polynomial(x, ny[i], z, terms, 0)
        green[i] = evaluate_polynomial(x, ny[i], z, terms, 1)
        blue[i] = evaluate_polynomial(x, ny[i], z, terms, 2)
    if bands.shape[0] > 0:
        for i in range(red.shape[0]):
            four, six = evaluate_legendre(ny[i])
            red[i] += bands[0, 0] * four + bands[1, 0] * six
            green[i] += bands[0, 1] * four + bands[1, 1] * six
            blue[i] += bands[0, 2] * four + bands[1, 2] * six
    for n in range(irradiance.spots.shape[0]):
        spot = irradiance.spots[n]
        # Rotate the spot to world axes, where normals are.
        y = spot[1]
        x, z = yaw[0] * spot[0] + yaw[1] * spot[2], yaw[0] * spot[2] - yaw[1] * spot[0]
        for i in range(red.shape[0]):
            cosine = max(zero, x * nx[i] + y * ny[i] + z * nz[i])
            red[i] += spot[3] * cosine
            green[i] += spot[4] * cosine
            blue[i] += spot[5] * cosine
    for i in range(red.shape[0]):
        red[i], green[i], blue[i] = max(zero, red[i]), max(zero, green[i]), max(zero, blue[i])


@disjoint_helper
def add_irradiance(
    intensity, occlusion, weights, light_red, light_green, light_blue, red, green, blue, out_red,
    out_green, out_blue,
):  # fmt: skip
    """Add irradiance times base colour to each sample."""
    for i in range(out_red.shape[0]):
        scale = weights[i] * intensity * occlusion[i]
        out_red[i] += scale * (red[i] * light_red[i])
        out_green[i] += scale * (green[i] * light_green[i])
        out_blue[i] += scale * (blue[i] * light_blue[i])


@helper
def compute_channel_weights(base, metallic, dielectric, brdf):
    """
    Return the weights of one channel: of the prefiltered reflection, and of irradiance.

    The material mixes a metal, which only reflects, and a dielectric, which diffuses the rest.
    The second weight includes multiple scattering.
    """
    single, multiple = pbr.scattering_albedos(base, brdf)
    inside = np.float32(1.0) - (dielectric[0] + dielectric[1])
    return (
        dielectric[0] + metallic * (single - dielectric[0]),
        (dielectric[1] + inside * base) * (np.float32(1.0) - metallic) + metallic * multiple,
    )


@helper
def find_mirror_direction(normal, point, toward_viewer, alpha):
    """
    Return the dominant reflection direction, any length, and the viewer's cosine.

    The direction is NaN where the distance to the viewer is beyond float32.
    """
    nx, ny, nz = normal
    vx = toward_viewer[0] - toward_viewer[3] * point[0]
    vy = toward_viewer[1] - toward_viewer[3] * point[1]
    vz = toward_viewer[2] - toward_viewer[3] * point[2]
    scale = invert_length(vx, vy, vz)
    scale = scale if scale > np.float32(0.0) else np.float32(np.nan)
    vx, vy, vz = vx * scale, vy * scale, vz * scale
    facing = nx * vx + ny * vy + nz * vz
    # Bend the direction toward the normal, the more the rougher.
    smooth = np.float32(1.0) - alpha
    bend = smooth * (np.sqrt(smooth) + alpha)
    twice = np.float32(2.0) * facing
    direction = (
        nx + bend * (twice * nx - vx - nx),
        ny + bend * (twice * ny - vy - ny),
        nz + bend * (twice * nz - vz - nz),
    )
    return direction, clamped(facing, np.float32(0.0), np.float32(1.0))


@disjoint_helper
def find_reflections(
    yaw, toward_viewer, nx, ny, nz, px, py, pz, roughness, x, y, z, level, facing
):  # fmt: skip
    """
    Write the samples' reflection directions, in the picture's axes, and levels to read.

    ``facing`` is the viewer's cosine. The level is -1 where the direction is NaN.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(x.shape[0]):
        rough = clamped(roughness[i], zero, one)
        normal, point = (nx[i], ny[i], nz[i]), (px[i], py[i], pz[i])
        (dx, dy, dz), facing[i] = find_mirror_direction(normal, point, toward_viewer, rough * rough)
        is_valid = abs(dx) + abs(dy) + abs(dz) < np.float32(np.inf)
        x[i], z[i] = rotate_y(dx, dz, yaw)
        y[i] = dy
        rough_level = find_level(rough)
        level[i] = rough_level if is_valid else np.float32(-1.0)


@disjoint_helper
def find_uvs(x, y, z, u, v):
    """Write u and v of directions."""
    for i in range(x.shape[0]):
        u[i], v[i] = find_panorama_uv(x[i], y[i], z[i])


@disjoint_helper
def find_elevations(x, y, z):
    """Replace y by the sine of the elevation of each direction."""
    for i in range(x.shape[0]):
        y[i] *= invert_length(x[i], y[i], z[i])


@disjoint_helper
def read_reflections(
    environment, reflections, microfacet, u, v, height, level, red, green, blue
):  # fmt: skip
    """Write the reflections of samples of microfacets."""
    for i in range(red.shape[0]):
        if microfacet[i] > np.float32(0.0):
            red[i], green[i], blue[i] = sample_reflection(
                level[i], (u[i], v[i]), height[i], environment, reflections
            )


@disjoint_helper
def add_split_sum(
    intensity, occlusion, light, metallic, roughness, microfacet, facing, base, reflection, out
):  # fmt: skip
    """Write one channel of shaded light, by split sum, over the reflection's."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(out.shape[0]):
        brdf = pbr.approximate_env_brdf(facing[i], clamped(roughness[i], zero, one))
        dielectric = pbr.scattering_albedos(pbr.DIELECTRIC_F0, brdf)
        metal = clamped(metallic[i], zero, one)
        direct, around = compute_channel_weights(base[i], metal, dielectric, brdf)
        scale = microfacet[i] * intensity * occlusion[i]
        reflection[i] = out[i] + scale * (direct * reflection[i] + around * light[i])


@stage
def add_sky(block: Block, count, irradiance: Irradiance, yaw: float32[::1], intensity: float32):
    """
    Add irradiance to all samples except microfacet ones.

    Parameters
    ----------
    block : Block
        Reads normals of length one, base colours and rows LIT and OCCLUSION; adds to rows
        OUT_RED...
    count : int
    irradiance, yaw, intensity
        As ``EnvironmentRecord`` has them.
    """
    s = block.samples
    if pbr.is_any_above_zero(s[rows.LIT, :count]):
        light = three_parts(block.colors, IRRADIANCE, 0, count)
        compute_irradiance(irradiance, yaw, *three_parts(s, rows.NORMAL_X, 0, count), *light)
        add_irradiance(
            intensity, part(s, rows.OCCLUSION, 0, count), part(s, rows.LIT, 0, count), *light,
            *three_parts(s, rows.RED, 0, count), *three_parts(s, rows.OUT_RED, 0, count),
        )  # fmt: skip


@stage
def add_reflections(
    block: Block, count, environment: EnvironmentRecord, toward_viewer: float32[::1]
):
    """
    Add specular and diffuse environment light to microfacet samples.

    Parameters
    ----------
    block : Block
        Reads the rows up to LIT, normals of length one, and METALLIC to OCCLUSION; adds to rows
        OUT_RED...
    count : int
    environment : EnvironmentRecord
    toward_viewer : (4,) float32
        A point p, relative to the eye, is seen along ``xyz - w p``.
    """
    s, r, c = block.samples, block.floats, block.colors
    microfacet = part(s, rows.MICROFACET, 0, count)
    if not pbr.is_any_above_zero(microfacet):
        return
    normals, roughness = three_parts(s, rows.NORMAL_X, 0, count), part(s, rows.ROUGHNESS, 0, count)
    x, y, z = three_parts(r, DIRECTION, 0, count)
    level, facing = part(r, LEVEL, 0, count), part(r, COSINE, 0, count)
    u, v = part(r, UV, 0, count), part(r, UV + 1, 0, count)
    find_reflections(
        environment.yaw, toward_viewer, *normals, *three_parts(s, rows.POINT_X, 0, count),
        roughness, x, y, z, level, facing,
    )  # fmt: skip
    find_uvs(x, y, z, u, v)
    if environment.width == 0:
        find_elevations(x, y, z)
    read_reflections(
        environment, environment.reflections, microfacet, u, v, y, level,
        *three_parts(c, 0, 0, count),
    )  # fmt: skip
    light = three_parts(c, IRRADIANCE, 0, count)
    compute_irradiance(environment.irradiance, environment.yaw, *normals, *light)
    for k in range(3):
        reflection, out = part(c, k, 0, count), part(s, rows.OUT_RED + k, 0, count)
        add_split_sum(
            environment.intensity, part(s, rows.OCCLUSION, 0, count), light[k],
            part(s, rows.METALLIC, 0, count), roughness, microfacet, facing,
            part(s, rows.RED + k, 0, count), reflection, out,
        )  # fmt: skip
        pbr.write_microfacets(reflection, microfacet, out)


@helper
def compute_ray(rays, x, y):
    """Return the direction at a point in normalized device coordinates, length about one."""
    rx = rays[0, 0] + x * rays[1, 0] + y * rays[2, 0]
    ry = rays[0, 1] + x * rays[1, 1] + y * rays[2, 1]
    rz = rays[0, 2] + x * rays[1, 2] + y * rays[2, 2]
    largest = max(abs(rx), max(abs(ry), abs(rz)))
    scale = 1.0 / largest if largest > 0.0 else 0.0
    return np.float32(rx * scale), np.float32(ry * scale), np.float32(rz * scale)


@helper
def sample_environment(ray, environment):
    """Return the light of the environment along a ray."""
    x, z = rotate_y(ray[0], ray[2], environment.yaw)
    color = sample_sky(
        x, ray[1], z, environment.texels, environment.width, environment.height,
        environment.gradient,
    )  # fmt: skip
    intensity = environment.intensity
    return color[0] * intensity, color[1] * intensity, color[2] * intensity


@kernel
def show_environment(
    face_id: int32[:, ::1], first: (int64, int64), rays: float64[:, ::1], size: (int64, int64),
    environment: EnvironmentRecord, tone: ToneRecord, table: int32[::1],
    linear: float32[:, :, ::1], color: uint32[:, ::1],
):  # fmt: skip
    """
    Write the environment to the pixels of some rows that show no face.

    Parameters
    ----------
    face_id : (R, W) int32
        The visible faces of these rows.
    first : (int, int)
        Column and row of the first pixel in the whole frame.
    rays : (3, 3) float64
        Direction, in world axes, at the middle of the frame, and its change with x and y in
        normalized device coordinates.
    size : (int, int)
        Width and height of the whole frame, pixels.
    environment : EnvironmentRecord
    tone : ToneRecord
    table : (65536,) int32
        `srgb_encoding.make_encoding_table`.
    linear : (R, W, 4) float32
        Written: linear red, green, blue, and alpha 1. Or W is 0.
    color : (R, W) uint32
        Written: the same, tone mapped, in sRGB codes. Or W is 0.
    """
    for row in range(face_id.shape[0]):
        y = 1.0 - (2.0 * (first[1] + row) + 1.0) / size[1]
        for column in range(face_id.shape[1]):
            if face_id[row, column] >= 0:
                continue
            x = (2.0 * (first[0] + column) + 1.0) / size[0] - 1.0
            red, green, blue = sample_environment(compute_ray(rays, x, y), environment)
            if linear.shape[1] > 0:
                linear[row, column, 0] = red
                linear[row, column, 1] = green
                linear[row, column, 2] = blue
                linear[row, column, 3] = np.float32(1.0)
            if color.shape[1] > 0:
                red, green, blue = map_pixel(tone, red, green, blue)
                display = red, green, blue, np.float32(1.0)
                color[row, column] = encode_pixel(display, table)
