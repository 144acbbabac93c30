"""
Slow, obvious twins of the kernels.

What decides which pixel shows which face is exact: Python ints and ``fractions.Fraction``, no
NumPy floats. Colour is float64 with the math library's own functions. Screen space is y down, the
centre of pixel (column i, row j) is at (i + 1/2, j + 1/2).
"""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np

HALF = Fraction(1, 2)


# --- the sub-pixel grid ---------------------------------------------------------------------------


def snap(value, bits=8):
    """Return a screen coordinate in units of 2**-bits pixel, rounded half to even."""
    return round(Fraction(value) * (1 << bits))


def screen_from_clip(position, size):
    """Return the exact screen position of a clip position (floats are taken at their value)."""
    x, y, _, w = (Fraction(float(c)) for c in position)
    width, height = size
    return (x / w + 1) * width / 2, (1 - y / w) * height / 2


def clip_from_screen(points, size, z=0.0, w=1.0):
    """
    Return clip positions, (N, 4) float64, that land exactly on screen points.

    Exact as long as the points are dyadic and the sizes and w are powers of two; asserted.
    """
    points = [(Fraction(float(x)), Fraction(float(y))) for x, y in points]
    zs, ws = np.broadcast_to(z, len(points)), np.broadcast_to(w, len(points))
    positions = np.empty((len(points), 4))
    for n, (x, y) in enumerate(points):
        ndc_x, ndc_y = 2 * x / size[0] - 1, 1 - 2 * y / size[1]
        at_w = float(ws[n])
        positions[n] = float(ndc_x) * at_w, float(ndc_y) * at_w, float(zs[n]) * at_w, at_w
        assert screen_from_clip(positions[n], size) == (x, y), "not exact: use dyadic input"
    return positions


# --- coverage -------------------------------------------------------------------------------------


def edge(a, b, p):
    """Return the edge function: positive where a, b, p run clockwise as seen on the screen."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def is_top_or_left(a, b):
    """Tell whether an edge of a clockwise triangle is a top or a left one."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    return dy < 0 or (dy == 0 and dx > 0)


def covers(triangle, point):
    """Tell whether a triangle owns a point, by the top-left rule; integers or fractions."""
    a, b, c = triangle
    area = edge(a, b, c)
    if area == 0:
        return False
    if area < 0:
        b, c = c, b
    for start, end in ((a, b), (b, c), (c, a)):
        value = edge(start, end, point)
        if value < 0 or (value == 0 and not is_top_or_left(start, end)):
            return False
    return True


def centre(column, row, bits=8):
    """Return a pixel's centre in units of 2**-bits pixel."""
    return (column + HALF) * (1 << bits), (row + HALF) * (1 << bits)


def snapped(triangle, bits=8):
    return tuple((snap(x, bits), snap(y, bits)) for x, y in triangle)


def covered_pixels(triangle, size, bits=8, window=None):
    """
    Return the pixels (column, row) of a screen triangle, snapped first.

    ``window`` (left, top, right, bottom), right and bottom excluded, replaces the whole image.
    """
    corners = snapped(triangle, bits)
    left, top, right, bottom = window or (0, 0, *size)
    # Only pixels in the box of the triangle can be covered.
    scale = 1 << bits
    left = max(left, min(x for x, _ in corners) // scale - 1)
    right = min(right, max(x for x, _ in corners) // scale + 2)
    top = max(top, min(y for _, y in corners) // scale - 1)
    bottom = min(bottom, max(y for _, y in corners) // scale + 2)
    # Twice the grid, so that centres are whole numbers on every grid.
    doubled = tuple((2 * x, 2 * y) for x, y in corners)
    return {
        (i, j)
        for j in range(top, bottom)
        for i in range(left, right)
        if covers(doubled, ((2 * i + 1) * scale, (2 * j + 1) * scale))
    }


# --- depth and visibility -------------------------------------------------------------------------


def affine_weights(triangle, point):
    """Return the weights of the three vertices at a point, linear on the screen; exact."""
    a, b, c = triangle
    area = Fraction(edge(a, b, c))
    return edge(b, c, point) / area, edge(c, a, point) / area, edge(a, b, point) / area


def plane_depth(triangle, depths, point):
    """Return the depth at a point of the plane through three vertices; exact."""
    weights = affine_weights(triangle, point)
    return sum(w * Fraction(d) for w, d in zip(weights, depths, strict=True))


def visible(triangles, depths, size, bits=8):
    """
    Return {pixel: (face, exact depth)}: the smallest depth wins, the lower face wins a tie.

    ``triangles`` are screen triangles, ``depths`` three numbers for each.
    """
    shown = {}
    for face, triangle in enumerate(triangles):
        corners = snapped(triangle, bits)
        for pixel in covered_pixels(triangle, size, bits):
            depth = plane_depth(corners, depths[face], centre(*pixel, bits))
            if pixel not in shown or depth < shown[pixel][1]:
                shown[pixel] = (face, depth)
    return shown


def perspective_weights(triangle, ws, point):
    """Return the perspective-correct weights of the three vertices at a point; exact."""
    weights = affine_weights(triangle, point)
    shares = [b / Fraction(w) for b, w in zip(weights, ws, strict=True)]
    return tuple(share / sum(shares) for share in shares)


# --- clipping -------------------------------------------------------------------------------------


def view_planes(guard_x=1, guard_y=1):
    """Return the signed distances to near, far, left, right, bottom, top, as functions."""
    gx, gy = Fraction(guard_x), Fraction(guard_y)
    return [
        lambda v: v[3] + v[2],
        lambda v: v[3] - v[2],
        lambda v: gx * v[3] + v[0],
        lambda v: gx * v[3] - v[0],
        lambda v: gy * v[3] + v[1],
        lambda v: gy * v[3] - v[1],
    ]


def clip_polygon(polygon, planes):
    """Cut a convex polygon of homogeneous points to planes (Sutherland-Hodgman)."""
    polygon = [tuple(Fraction(float(c)) for c in vertex) for vertex in polygon]
    for distance in planes:
        kept = []
        for n, here in enumerate(polygon):
            there = polygon[(n + 1) % len(polygon)]
            inside, outside = distance(here), distance(there)
            if inside >= 0:
                kept.append(here)
            if inside * outside < 0:
                t = inside / (inside - outside)
                kept.append(tuple(a + t * (b - a) for a, b in zip(here, there, strict=True)))
        polygon = kept
    return polygon


def clipped_screen_polygon(triangle, size, guard=(1, 1)):
    """Clip a triangle of clip positions; return its exact, unsnapped screen polygon."""
    polygon = clip_polygon(triangle, view_planes(*guard))
    if len(polygon) < 3 or any(vertex[3] <= 0 for vertex in polygon):
        return []
    width, height = size
    return [((x / w + 1) * width / 2, (1 - y / w) * height / 2) for x, y, _, w in polygon]


def polygon_pixels(polygon, size, margin=Fraction(0)):
    """
    Sort the pixels of an unsnapped convex polygon by how sure they are.

    Returns (inside, unsure): pixels whose centre is inside, and those whose centre lies within
    ``margin`` pixels of the line through an edge.
    """
    inside, unsure = set(), set()
    area = sum(edge(polygon[0], a, b) for a, b in pairwise(polygon[1:]))
    if area < 0:
        polygon = polygon[::-1]
    lines = [(a, b) for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True) if a != b]
    for row in range(size[1]):
        for column in range(size[0]):
            point = (column + HALF, row + HALF)
            values = [edge(a, b, point) for a, b in lines]
            if all(value >= 0 for value in values):
                inside.add((column, row))
            for (a, b), value in zip(lines, values, strict=True):
                squared = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2
                if value * value <= margin * margin * squared:
                    unsure.add((column, row))
    return inside, unsure


def cut_segment(a, b, planes):
    """Return the exact part (start, end) of a homogeneous segment inside planes, or None."""
    a, b = (tuple(Fraction(float(c)) for c in end) for end in (a, b))
    first, last = Fraction(0), Fraction(1)
    for distance in planes:
        here, there = distance(a), distance(b)
        if here < 0 and there < 0:
            return None
        if here < 0:
            first = max(first, here / (here - there))
        elif there < 0:
            last = min(last, here / (here - there))
    if first > last:
        return None
    return tuple(tuple(p + t * (q - p) for p, q in zip(a, b, strict=True)) for t in (first, last))


# --- colour ---------------------------------------------------------------------------------------


def srgb_decode(encoded):
    """Return linear light of an encoded value in 0..1."""
    if encoded <= 0.04045:
        return encoded / 12.92
    return math.pow((encoded + 0.055) / 1.055, 2.4)


def srgb_encode(linear):
    """Return the encoded value of linear light in 0..1."""
    if linear <= 0.0031308:
        return 12.92 * linear
    return 1.055 * math.pow(linear, 1.0 / 2.4) - 0.055


def srgb_code(linear):
    """Return the 8-bit code of linear light: clamped, rounded half up; NaN is 0."""
    if not linear > 0.0:
        return 0
    return math.floor(255.0 * srgb_encode(min(linear, 1.0)) + 0.5)


# --- light ----------------------------------------------------------------------------------------

SHORTEST = 1e-15
"""Vectors are taken to be at least this long before they are divided by their length."""


def dot(a, b):
    return math.fsum(p * q for p, q in zip(a, b, strict=True))


def unit(vector):
    """Return a vector of length one; one of length zero stays zero."""
    length = max(math.sqrt(dot(vector, vector)), SHORTEST)
    return [c / length for c in vector]


def blinn_phong(color, normal, point, material, lights, ambient, viewer):
    """
    Return the seen colour of one sample, linear.

    Parameters
    ----------
    color, normal, point : three floats; the point is relative to the eye
    material : (specular, shininess)
    lights : rows x, y, z, w, red, green, blue; light comes along ``xyz - w point``
    ambient : three floats
    viewer : x, y, z, w; the point is seen along ``xyz - w point``
    """
    specular, shininess = material
    normal = unit(normal)
    seen = [c * a for c, a in zip(color, ambient, strict=True)]
    eye = unit([viewer[k] - viewer[3] * point[k] for k in range(3)])
    for light in lights:
        toward = [light[k] - light[3] * point[k] for k in range(3)]
        distance = max(math.sqrt(dot(toward, toward)), SHORTEST)
        falloff = 1.0 / (distance * distance) if light[3] else 1.0
        toward = unit(toward)
        facing = max(dot(normal, toward), 0.0)
        half = unit([t + e for t, e in zip(toward, eye, strict=True)])
        cosine = min(max(dot(normal, half), 0.0), 1.0)
        shine = specular * math.pow(cosine, shininess) if facing > 0.0 else 0.0
        for k in range(3):
            seen[k] += falloff * light[4 + k] * (color[k] * facing + shine)
    return seen


def face_normal(a, b, c):
    """Return the unit normal of a face that winds counter-clockwise."""
    u, v = [b[k] - a[k] for k in range(3)], [c[k] - a[k] for k in range(3)]
    return unit([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])


def blend(weights, values):
    """Return the weighted sum of three vectors."""
    return [
        math.fsum(float(w) * value[k] for w, value in zip(weights, values, strict=True))
        for k in range(len(values[0]))
    ]


def shade_sample(model, weights, corners, normals, colors, material, lights, ambient):
    """
    Return the linear colour of one sample of a face, by its shading model.

    Parameters
    ----------
    model : {"unlit", "flat", "gouraud", "phong"}
    weights : perspective-correct, of the three vertices
    corners, normals, colors : three vectors each; corners relative to the eye, in world axes
    material : (specular, shininess)
    lights, ambient : as `blinn_phong` takes them
    """
    color = blend(weights, colors)
    if model == "unlit":
        return color
    viewer = (0.0, 0.0, 0.0, 1.0)
    facing = face_normal(*corners)
    side = -1.0 if dot(facing, [-c for c in corners[0]]) < 0.0 else 1.0
    if model == "flat":
        middle = blend((1 / 3, 1 / 3, 1 / 3), corners)
        normal = [side * c for c in facing]
        return blinn_phong(color, normal, middle, material, lights, ambient, viewer)
    if model == "phong":
        normal = [side * c for c in blend(weights, normals)]
        point = blend(weights, corners)
        return blinn_phong(color, normal, point, material, lights, ambient, viewer)
    lit = [
        blinn_phong(colors[n], [side * c for c in normals[n]], corners[n], material, lights,
                    ambient, viewer)
        for n in range(3)
    ]  # fmt: skip
    return blend(weights, lit)
