"""
Show the environment where no face is.

A ray through a pixel is where two planes meet: with the rows X, Y and W of ``clip_from_relative``,
points seen at (x, y) in normalized device coordinates have ``(X - x W) p = 0 = (Y - y W) p``. So
the ray is the cross product of the two, which is linear in x and y, and constant for a parallel
projection.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.environments import sharp_color, turned
from rasterjit.kernels.jit import kernel, stage
from rasterjit.kernels.records import Encoding, Environment
from rasterjit.kernels.resolve import encode_pixel
from rasterjit.kernels.tone_mapping import map_pixel


@stage
def ray_at(rays, x, y):
    """Return the direction seen at a place in normalized device coordinates, length about one."""
    rx = rays[0, 0] + x * rays[1, 0] + y * rays[2, 0]
    ry = rays[0, 1] + x * rays[1, 1] + y * rays[2, 1]
    rz = rays[0, 2] + x * rays[1, 2] + y * rays[2, 2]
    largest = max(abs(rx), max(abs(ry), abs(rz)))
    scale = 1.0 / largest if largest > 0.0 else 0.0
    return np.float32(rx * scale), np.float32(ry * scale), np.float32(rz * scale)


@stage
def color_along(ray, environment):
    """Return the light that comes from the environment against a ray."""
    x, z = turned(ray[0], ray[2], environment.turn)
    color = sharp_color(
        x, ray[1], z, environment.texels, environment.width, environment.height,
        environment.gradient,
    )  # fmt: skip
    intensity = environment.intensity
    return color[0] * intensity, color[1] * intensity, color[2] * intensity


@kernel
def show_environment(
    face_id, first, rays, size, environment: Environment, encoding: Encoding, linear, color
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
    environment, encoding : records
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
            red, green, blue = color_along(ray_at(rays, x, y), environment)
            if linear.shape[1] > 0:
                linear[row, column, 0] = red
                linear[row, column, 1] = green
                linear[row, column, 2] = blue
                linear[row, column, 3] = np.float32(1.0)
            if color.shape[1] > 0:
                red, green, blue = map_pixel(encoding.tone, red, green, blue)
                shown = red, green, blue, np.float32(1.0)
                color[row, column] = encode_pixel(shown, encoding.table)


@stage
def over(alpha, own, behind):
    """Return straight RGBA of a colour with straight alpha over another one."""
    one, none = np.float32(1.0), np.float32(0.0)
    if alpha >= one:
        return own[0], own[1], own[2], one
    if not alpha > none:
        return behind
    through = (one - alpha) * behind[3]
    total = alpha + through
    return (
        (own[0] * alpha + behind[0] * through) / total,
        (own[1] * alpha + behind[1] * through) / total,
        (own[2] * alpha + behind[2] * through) / total,
        total,
    )


@kernel
def show_over(linear, background, encoding: Encoding, color):
    """
    Map the tones of rows, and lay them over a background that is shown as it is.

    Parameters
    ----------
    linear : (R, W, 4) float32
        Straight alpha; changed: laid over the background in linear light.
    background : (4,) float32, linear
    encoding : Encoding
        With a tone map.
    color : (R, W) uint32
        Written: tones mapped, laid over the background, in sRGB codes.
    """
    behind = background[0], background[1], background[2], background[3]
    for row in range(linear.shape[0]):
        for column in range(linear.shape[1]):
            alpha = linear[row, column, 3]
            own = linear[row, column, 0], linear[row, column, 1], linear[row, column, 2]
            shown = map_pixel(encoding.tone, own[0], own[1], own[2])
            color[row, column] = encode_pixel(over(alpha, shown, behind), encoding.table)
            laid = over(alpha, own, behind)
            for k in range(4):
                linear[row, column, k] = laid[k]
