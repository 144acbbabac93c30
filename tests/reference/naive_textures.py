"""
Slow, obvious twins of texture lookup, and small scenes that show what the engine looks up.

Exact: texels, coordinates and weights are ``fractions.Fraction``. Images are lists of rows from
the top, each texel one number; u runs right and v up.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

import rasterjit as rj
from rasterjit.pipeline.surface import texture_lookup
from rasterjit.runtime.intrinsics import HALVES

HALF = Fraction(1, 2)

STEPS = 1 << 24
"""Positions on a texture are rounded to 1/STEPS texel, half up."""


def wrapped(i, size, wrap):
    """Return the texel that stands at any whole number."""
    if wrap == "clamp":
        return min(max(i, 0), size - 1)
    period = i // size
    within = i - period * size
    return size - 1 - within if wrap == "mirror" and period % 2 else within


def position(u, size, wrap):
    """Return where a coordinate lies, in steps of 1/STEPS texel."""
    if wrap == "clamp":
        u = min(max(u, 0), 1)
    above, below = u.as_integer_ratio()
    return (2 * above * size * STEPS + below) // (2 * below)


def texel(image, column, row, wraps):
    """Return the texel at any whole numbers; rows count from the bottom here."""
    height, width = len(image), len(image[0])
    return image[height - 1 - wrapped(row, height, wraps[1])][wrapped(column, width, wraps[0])]


def texels_around(level, u, v, wraps, offset):
    """Return the numbers of the four texels that the engine finds around a place, and shares."""
    (u, v), (firsts, widths, heights) = np.float64([[u], [v]]), np.int32(level)[:, np.newaxis]
    texels, shares = np.empty((6, 1), np.int32), np.empty((2, 1), np.float32)
    rules = tuple(texture_lookup.encode_coordinate_wrap(wrap) for wrap in wraps)
    with np.errstate(invalid="ignore"):
        texture_lookup.locate_texels(u, v, widths, heights, rules, offset, *texels[:2], *shares)
    rules = tuple(texture_lookup.encode_texel_wrap(wrap) for wrap in wraps)
    texture_lookup.find_corner_texels(*texels[:2], firsts, widths, heights, rules, *texels[2:])
    return tuple((texels[2:, 0] // HALVES).tolist()), shares[:, 0].tolist()


def repeated_around(level, u, v):
    """Return the same of a repeated picture, as the engine finds it where all share a level."""
    (u, v), texels = np.float64([[u], [v]]), np.empty((4, 1), np.int32)
    shares = np.empty((2, 1), np.float32)
    with np.errstate(invalid="ignore"):
        texture_lookup.find_repeated_corner_texels(u, v, tuple(np.int32(level)), *shares, *texels)
    return tuple((texels[:, 0] // HALVES).tolist()), shares[:, 0].tolist()


def repeated_at(level, u, v):
    """Return the texel of a repeated picture that the engine finds at a place."""
    (u, v), texels = np.float64([[u], [v]]), np.empty(1, np.int32)
    with np.errstate(invalid="ignore"):
        texture_lookup.find_repeated_texels(u, v, tuple(np.int32(level)), texels)
    return int(texels[0]) // HALVES


def nearest(image, u, v, wraps):
    x = position(u, len(image[0]), wraps[0])
    y = position(v, len(image), wraps[1])
    return texel(image, x // STEPS, y // STEPS, wraps)


def bilinear(image, u, v, wraps):
    left, right = divmod(position(u, len(image[0]), wraps[0]) - STEPS // 2, STEPS)
    low, high = divmod(position(v, len(image), wraps[1]) - STEPS // 2, STEPS)
    mix = sum(
        (STEPS - abs(right - n * STEPS)) * (STEPS - abs(high - m * STEPS))
        * texel(image, left + n, low + m, wraps)
        for n in (0, 1) for m in (0, 1)
    )  # fmt: skip
    return Fraction(mix, STEPS * STEPS)


def trilinear(levels, u, v, wraps, detail):
    """Return the mix of the two levels around a level of detail (a float)."""
    detail = min(max(detail, 0.0), len(levels) - 1.0)
    finer = math.floor(detail)
    share = Fraction(detail) - finer
    color = bilinear(levels[finer], u, v, wraps)
    if not share:
        return color
    return (1 - share) * color + share * bilinear(levels[finer + 1], u, v, wraps)


def halved_line(line):
    """Return the means by area of a line of texels in half as many, rounded down, at least one."""
    size = len(line)
    half = max(1, size // 2)
    width = Fraction(size, half)
    means = []
    for n in range(half):
        start, stop = n * width, (n + 1) * width
        parts = [max(Fraction(0), min(stop, k + 1) - max(start, k)) for k in range(size)]
        means.append(sum(p * t for p, t in zip(parts, line, strict=True)) / width)
    return means


def halved(image):
    """Return the next mip level."""
    rows = [halved_line(row) for row in image]
    columns = [halved_line(list(column)) for column in zip(*rows, strict=True)]
    return [list(row) for row in zip(*columns, strict=True)]


def mip_chain(image):
    """Return all levels of an image, from itself down to one texel."""
    levels = [image]
    while len(levels[-1]) > 1 or len(levels[-1][0]) > 1:
        levels.append(halved(levels[-1]))
    return levels


def exact_image(array):
    """Return a channel of an array as rows of fractions."""
    return [[Fraction(float(value)) for value in row] for row in array]


def planes_of(triangle, ws, uvs):
    """
    Return the planes of 1 / w, u / w and v / w on the screen, all times one number.

    Each is (a, b, c) in whole numbers: the value at a point is ``a x + b y + c``. They are what
    ``oracle.perspective_weights`` divides by each other.
    """
    planes = [[Fraction(0)] * 3 for _ in range(3)]
    for n, (w, uv) in enumerate(zip(ws, uvs, strict=True)):
        # The edge function of the other two vertices, as a plane.
        (px, py), (qx, qy) = triangle[n - 2], triangle[n - 1]
        edge = py - qy, qx - px, (qy - py) * px - (qx - px) * py
        for plane, value in zip(planes, (1, *uv), strict=True):
            plane[:] = [have + part * value / w for have, part in zip(plane, edge, strict=True)]
    times = math.lcm(*(part.denominator for plane in planes for part in plane))
    return tuple(tuple(int(part * times) for part in plane) for plane in planes)


def coordinates_at(point, planes):
    """Return the exact perspective-correct texture coordinates at a point of the screen."""
    (x, across), (y, down) = (number.as_integer_ratio() for number in point)
    below = math.lcm(across, down)
    x, y = x * (below // across), y * (below // down)
    w, u, v = (a * x + b * y + c * below for a, b, c in planes)
    return Fraction(u, w), Fraction(v, w)


DIFFERENCE = Fraction(1, 1 << 20)
"""Pixels by which coordinates are moved to find how fast they change."""


def steps_at(point, planes):
    """Return the steps (u, v) of a pixel to the right and down, from differences around it."""
    steps = []
    for dx, dy in ((DIFFERENCE, 0), (0, DIFFERENCE)):
        there = coordinates_at((point[0] + dx, point[1] + dy), planes)
        back = coordinates_at((point[0] - dx, point[1] - dy), planes)
        steps.append([(a - b) / (2 * DIFFERENCE) for a, b in zip(there, back, strict=True)])
    return steps


def length(step, size):
    """Return the length of a step in texels."""
    return math.sqrt(sum((part * n) ** 2 for part, n in zip(step, size, strict=True)))


def level_of_detail(point, planes, size):
    """Return log2 of the longer step of a pixel on a texture, from differences around it."""
    longest = max(length(step, size) for step in steps_at(point, planes))
    return math.log2(longest) if longest else -math.inf


def anisotropic(levels, wraps, footprint, limit):
    """
    Return the mean of taps along the longer step, and how far their number is from changing.

    The taps are those of the Khronos Group's EXT_texture_filter_anisotropic, along a straight line;
    the shorter step counts as a texel at least.
    """
    point, planes, size = footprint
    u, v = coordinates_at(point, planes)
    steps = steps_at(point, planes)
    longer, shorter = sorted((length(step, size), step) for step in steps)[::-1]
    ratio = longer[0] / max(shorter[0], 1.0)
    parts = max(1.0, min(ratio, limit))
    count = math.ceil(parts)
    detail = math.log2(longer[0] / parts) if longer[0] > 0 else -math.inf
    taps = []
    for n in range(1, count + 1):
        shift = Fraction(n, count + 1) - HALF
        place = u + shift * longer[1][0], v + shift * longer[1][1]
        taps.append(trilinear(levels, *place, wraps, detail))
    return sum(taps) / count, count, abs(parts - round(parts))


# --- what the engine shows ------------------------------------------------------------------------

FRONT = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=2.0, near=1.0, far=9.0)
"""Sees the square [-1, 1]**2 from its front; other aspects are stretched by ``draw``."""


def draw(mesh, size):
    """Return what an image of [-1, 1]**2 shows, (H, W, 4) float32, linear."""
    scene = rj.Scene()
    scene.add(mesh, rj.transforms.scale((size[0] / size[1], 1.0, 1.0)))
    return rj.render(scene, FRONT, size=size, outputs="linear", threads=1).linear


def square(texture, uv, **options):
    """Return the square [-1, 1]**2 with a texture; uv lower left, right, upper right, left."""
    material = rj.Material("unlit", "white", base_color_texture=texture)
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    return rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], uv=uv, material=material, **options)


def box(low, high):
    """Return the texture coordinates of a square's corners from those of two."""
    (u0, v0), (u1, v1) = low, high
    return [(u0, v0), (u1, v0), (u1, v1), (u0, v1)]


def probe(texture, places):
    """Return what each of some coordinates (u, v) shows, (N, 4) float32, linear."""
    count = len(places)
    left = np.linspace(-1.0, 1.0, count + 1)
    vertices, faces, uv = [], [], []
    for n, place in enumerate(places):
        a, b = left[n], left[n + 1]
        vertices += [(a, -1, 0), (b, -1, 0), (b, 1, 0), (a, 1, 0)]
        faces += [(4 * n, 4 * n + 1, 4 * n + 2), (4 * n, 4 * n + 2, 4 * n + 3)]
        uv += [place] * 4
    material = rj.Material("unlit", "white", base_color_texture=texture)
    return draw(rj.Mesh(vertices, faces, uv=uv, material=material), (count, 1))[0]


SIZE = (40, 32)
"""Width and height of the frames below."""

NOISE = np.random.default_rng(7).random((16, 16, 3)).astype(np.float32)

MIX_ROUNDINGS = 8 * 2.0**-24
"""Roundings of float32 in a bilinear mix of texels below 1."""

DETAIL_ERROR = 1e-6
"""Of the level of detail up to 3: float32 in its logarithm, 1.2e-7 (1 + 3), and its roundings."""

TRIANGLES = {
    "near and far": ([(2.25, 3.5), (37.5, 8.25), (11.75, 30.0)], [1.0, 8.0, 2.0], 1.0),
    "turned": ([(2.25, 3.5), (11.75, 30.0), (37.5, 8.25)], [3.0, 0.5, 64.0], 1.0),
    "cut by the near plane": ([(2.25, 3.5), (37.5, 8.25), (11.75, 30.0)], [0.03125, 4.0, 2.0], 4.0),
    "beside the picture": ([(-200.0, 10.0), (300.0, -50.0), (30.0, 300.0)], [4.0, 4.0, 1.0], 16.0),
}


def clip_camera():
    """Return a camera whose view space is clip space with w in the place of z."""
    clip_from_view = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, -0.25], [0, 0, -1, 0.0]])
    return rj.MatrixCamera(np.eye(4), clip_from_view)


def draw_triangle(points, ws, uv, texture, outputs=("linear", "face_id"), **options):
    """Return what a triangle shows that lands on screen points with the given w."""
    width, height = SIZE
    corners = [
        ((2 * x / width - 1) * w, (1 - 2 * y / height) * w, -w)
        for (x, y), w in zip(points, ws, strict=True)
    ]
    material = rj.Material("unlit", "white", base_color_texture=texture)
    mesh = rj.Mesh(corners, [(0, 1, 2)], uv=uv, material=material)
    return rj.render(mesh, clip_camera(), size=SIZE, outputs=outputs, threads=1, **options)
