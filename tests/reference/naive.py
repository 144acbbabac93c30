"""
Slow, obvious twins of the kernels whose results are floats, and helpers of tests.

What decides which pixel shows which face is exact, and is ``rasterjit.oracle``. Colour is float64
with the math library's own functions.
"""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np

from rasterjit.inspect import oracle

HALF = Fraction(1, 2)


# --- the screen -----------------------------------------------------------------------------------


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
        assert oracle.screen_position(positions[n], size) == (x, y), "not exact: use dyadic input"
    return positions


def centre(column, row, bits=8):
    """Return a pixel's centre in units of 2**-bits pixel."""
    return (column + HALF) * (1 << bits), (row + HALF) * (1 << bits)


# --- clipping -------------------------------------------------------------------------------------


def clipped_screen_polygon(triangle, size, planes=oracle.VIEW_VOLUME):
    """Clip a triangle of clip positions; return its exact, unsnapped screen polygon."""
    return [oracle.screen_position(v, size) for v in oracle.clip_polygon(triangle, planes)]


def polygon_pixels(polygon, size, margin=Fraction(0)):
    """
    Sort the pixels of an unsnapped convex polygon by how sure they are.

    Returns (inside, unsure): pixels whose centre is inside, and those whose centre lies within
    ``margin`` pixels of the line through an edge.
    """
    inside, unsure = set(), set()
    area = sum(oracle.edge(polygon[0], a, b) for a, b in pairwise(polygon[1:]))
    if area < 0:
        polygon = polygon[::-1]
    lines = [(a, b) for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True) if a != b]
    for row in range(size[1]):
        for column in range(size[0]):
            point = (column + HALF, row + HALF)
            values = [oracle.edge(a, b, point) for a, b in lines]
            if all(value >= 0 for value in values):
                inside.add((column, row))
            for (a, b), value in zip(lines, values, strict=True):
                squared = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2
                if value * value <= margin * margin * squared:
                    unsure.add((column, row))
    return inside, unsure


def cut_segment(a, b, planes):
    """Return the exact part (start, end) of a homogeneous segment inside planes, or None."""
    first, last = Fraction(0), Fraction(1)
    for plane in planes:
        here, there = oracle.plane_distance(plane, a), oracle.plane_distance(plane, b)
        if here < 0 and there < 0:
            return None
        if here < 0:
            first = max(first, Fraction(here) / (here - there))
        elif there < 0:
            last = min(last, Fraction(here) / (here - there))
    if first > last:
        return None
    return tuple(tuple(oracle.interpolate((1 - t, t), (a, b))) for t in (first, last))


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

SHORTEST = math.sqrt(1e-29)
"""Vectors are taken to be at least this long before they are divided by their length."""

MAX_SQUARED = (2.0 - 2.0**-23) * 2.0**127
"""Of float32: the direction of a vector whose squared length is beyond this cannot be told."""


def dot(a, b):
    return math.fsum(p * q for p, q in zip(a, b, strict=True))


def is_told(vector):
    """Return whether float32 tells the direction of a vector: not if it is too long, or NaN."""
    return dot(vector, vector) <= MAX_SQUARED if all(map(math.isfinite, vector)) else False


def unit(vector):
    """Return a vector of length one; one of length zero stays zero."""
    length = max(math.sqrt(dot(vector, vector)), SHORTEST)
    return [c / length for c in vector]


def blinn_phong(color, normal, point, material, lights, ambient, viewer):
    """
    Return the seen colour of one sample, linear.

    Black are lights, and highlights, whose direction or viewer float32 cannot tell.

    Parameters
    ----------
    color, normal, point : three floats; the point is relative to the eye
    material : (specular, shininess)
    lights : rows x, y, z, w, red, green, blue; light comes along ``xyz - w point``; and, where
        they are longer, axis x, y, z, scale and offset of the cone, and one over the range squared
    ambient : three floats
    viewer : x, y, z, w; the point is seen along ``xyz - w point``
    """
    specular, shininess = material
    seen = [c * a for c, a in zip(color, ambient, strict=True)]
    if not (is_told(normal) and all(map(math.isfinite, point))):
        return seen
    normal = unit(normal)
    eye = [viewer[k] - viewer[3] * point[k] for k in range(3)]
    specular = specular if is_told(eye) else 0.0
    eye = unit(eye)
    for light in lights:
        toward = [light[k] - light[3] * point[k] for k in range(3)]
        if not is_told(toward):
            continue
        distance = max(math.sqrt(dot(toward, toward)), SHORTEST)
        falloff = 1.0 / (distance * distance) if light[3] else 1.0
        toward = unit(toward)
        if len(light) > 7:
            versine = 1.0 + dot(toward, light[7:10])
            falloff *= min(max(light[11] - versine * light[10], 0.0), 1.0) ** 2
            falloff *= min(max(1.0 - distance**4 * light[12] ** 2, 0.0), 1.0)
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


# --- colours in float32 ---------------------------------------------------------------------------


def float32_weights(corners, ws, point):
    """
    Return the weights of a face's vertices at a point, step by step in float32.

    Takes snapped corners and the point as whole numbers, starting from the vertex with the lowest
    number, and w: what ``float32_weights`` finds of faces that it is sure of.
    """
    float32 = np.float32
    edges = []
    for k in range(3):
        (ax, ay), (bx, by) = corners[(k + 1) % 3], corners[(k + 2) % 3]
        whole = (bx - ax) * (int(point[1]) - ay) - (by - ay) * (int(point[0]) - ax)
        edges.append(float32(whole))
    shares = [edges[0], *(edges[k] * float32(ws[0] / ws[k]) for k in (1, 2))]
    over = float32(1) / (shares[0] + shares[1] + shares[2])
    return [share * over for share in shares]
