"""Lenses point by point, as OpenCV's documentation writes them down, and the filter of pictures."""

from __future__ import annotations

import math

import numpy as np


def distort(point, coefficients):
    """Return where a point (x / z, y / z) is seen; ``coefficients`` in the order of distCoeffs."""
    x, y = point
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y = (
        *coefficients, *[0.0] * (14 - len(coefficients)),
    )  # fmt: skip
    r2 = x * x + y * y
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s1 * r2 + s2 * r2**2
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + s3 * r2 + s4 * r2**2
    about_y = np.array(
        [
            [math.cos(tau_y), 0, -math.sin(tau_y)],
            [0, 1, 0],
            [math.sin(tau_y), 0, math.cos(tau_y)],
        ]
    )
    about_x = np.array(
        [
            [1, 0, 0],
            [0, math.cos(tau_x), math.sin(tau_x)],
            [0, -math.sin(tau_x), math.cos(tau_x)],
        ]
    )
    turn = about_y @ about_x
    back = np.array([[turn[2, 2], 0, -turn[0, 2]], [0, turn[2, 2], -turn[1, 2]], [0, 0, 1]])
    a, b, c = back @ turn @ [u, v, 1.0]
    return a / c, b / c


def distort_fisheye(direction, coefficients):
    """Return where a direction (x, y, z) is seen by OpenCV's fisheye model."""
    x, y, z = direction
    r = math.hypot(x, y)
    theta = math.atan2(r, z)
    bent = theta + sum(k * theta ** (2 * n + 3) for n, k in enumerate(coefficients))
    return (x * bent / r, y * bent / r) if r else (0.0, 0.0)


def panorama(direction):
    """Return the longitude, and the latitude down, of a direction (x, y, z)."""
    x, y, z = direction
    return math.atan2(x, z), math.atan2(y, math.hypot(x, z))


def project(points, camera_from_world, matrix, coefficients):
    """Return the pixels, as OpenCV counts them, of world points: projectPoints, point by point."""
    found = []
    for point in points:
        x, y, z, _ = camera_from_world @ [*point, 1.0]
        u, v, _ = matrix @ [*distort((x / z, y / z), coefficients), 1.0]
        found.append((u, v))
    return np.array(found)


def bilinear(source, x, y):
    """Return a picture, (h, w, C), between the centres of its samples."""
    height, width = source.shape[:2]
    x, y = min(max(x - 0.5, 0.0), width - 1.0), min(max(y - 0.5, 0.0), height - 1.0)
    column, row = int(x), int(y)
    right, below = min(column + 1, width - 1), min(row + 1, height - 1)
    across, down = x - column, y - row
    upper = (1 - across) * source[row, column] + across * source[row, right]
    lower = (1 - across) * source[below, column] + across * source[below, right]
    return (1 - down) * upper + down * lower


def filtered(source, at, along, down):
    """Return the mean of what a pixel covers: its centre and its two sides, samples."""
    counts = [min(max(math.ceil(math.hypot(*side) - 1e-3), 1), 16) for side in (along, down)]
    total = 0.0
    for j in range(counts[1]):
        for i in range(counts[0]):
            u, v = (i + 0.5) / counts[0] - 0.5, (j + 0.5) / counts[1] - 0.5
            x, y = (at[k] + u * along[k] + v * down[k] for k in range(2))
            total = total + bilinear(source.astype(np.float64), x, y)
    return total / (counts[0] * counts[1])
