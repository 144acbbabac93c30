"""
Interpolate what lighting needs of a sample: base colour, normal, position, highlight.

The formulas that runs and stretches of a row share, and that give each sample the same bits
whichever of the two it is gathered with.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels import texture_places, texture_rows
from rasterjit.kernels.interpolation import blend, interpolate
from rasterjit.kernels.jit import stage
from rasterjit.kernels.maps import write_emission
from rasterjit.kernels.microfacets import write_facets
from rasterjit.kernels.records import (
    FLAT,
    GOURAUD,
    MATERIAL_MODEL,
    MATERIAL_SHININESS,
    MATERIAL_SPECULAR,
    PBR,
    PHONG,
)


@stage
def material_tint(materials, owner):
    """Return the base colour of an object's material."""
    return materials[owner, 0], materials[owner, 1], materials[owner, 2]


@stage
def face_tint(face, face_colors, tint):
    """Return the tint times the face's colour; the tint itself if there are none."""
    if face_colors is None:
        return tint
    return (
        tint[0] * face_colors[face, 0],
        tint[1] * face_colors[face, 1],
        tint[2] * face_colors[face, 2],
    )


@stage
def matt_light(weights, a, b, c, behind, model, matt_vertices, tint):
    """Return the light of the vertices without highlights; the tint of what has no such light."""
    if model != GOURAUD:
        return tint
    side = 1 if behind else 0
    at_a, at_b, at_c = matt_vertices[a, side], matt_vertices[b, side], matt_vertices[c, side]
    return (
        np.float32(
            interpolate(weights, np.float64(at_a[0]), np.float64(at_b[0]), np.float64(at_c[0]))
        ),
        np.float32(
            interpolate(weights, np.float64(at_a[1]), np.float64(at_b[1]), np.float64(at_c[1]))
        ),
        np.float32(
            interpolate(weights, np.float64(at_a[2]), np.float64(at_b[2]), np.float64(at_c[2]))
        ),
    )


@stage
def note_matt_light(places, run, weights, a, b, c, behind, owner, samples, surface, matt_vertices):
    """Write the colours without the highlights of vertices, if any lies over a texture."""
    if matt_vertices is None:
        return
    model = np.int64(surface.materials[owner, MATERIAL_MODEL])
    for n in range(run[0], run[1]):
        at = (0.0, weights[0, n], weights[1, n])
        tint = samples[lit.RED, n], samples[lit.GREEN, n], samples[lit.BLUE, n]
        matt = matt_light(at, a, b, c, behind, model, matt_vertices, tint)
        for k in range(3):
            places[texture_rows.MATT + k, n] = matt[k]


@stage
def color_at(second, third, colors):
    """Return the tint times the interpolated colour, for the weights of two vertices."""
    (r, g, b), tint = colors
    weights = (0.0, second, third)
    return (
        tint[0] * np.float32(interpolate(weights, r[0], r[1], r[2])),
        tint[1] * np.float32(interpolate(weights, g[0], g[1], g[2])),
        tint[2] * np.float32(interpolate(weights, b[0], b[1], b[2])),
    )


@stage
def normal_at(second, third, normal):
    """Return the interpolated normal in world axes, on the side that is seen, not normalized."""
    (na, nb, nc), m, side = normal
    weights = (0.0, second, third)
    x = blend(weights, na[0], nb[0], nc[0])
    y = blend(weights, na[1], nb[1], nc[1])
    z = blend(weights, na[2], nb[2], nc[2])
    return (
        np.float32(side * (m[0] * x + m[1] * y + m[2] * z)),
        np.float32(side * (m[3] * x + m[4] * y + m[5] * z)),
        np.float32(side * (m[6] * x + m[7] * y + m[8] * z)),
    )


@stage
def point_at(second, third, point):
    """Return where a sample lies, as `place_sample` finds it."""
    first, ab, ac, m = point
    x = second * ab[0] + third * ac[0]
    y = second * ab[1] + third * ac[1]
    z = second * ab[2] + third * ac[2]
    return (
        np.float32(first[0] + (m[0] * x + m[1] * y + m[2] * z)),
        np.float32(first[1] + (m[3] * x + m[4] * y + m[5] * z)),
        np.float32(first[2] + (m[6] * x + m[7] * y + m[8] * z)),
    )


@stage
def stand_in_places(samples, run, model, lit_vertices, lighting):
    """
    Write any normals and positions along a run if nothing depends on them; return whether they do.

    They do not where the object is lit at its vertices and no fog lies over it: the light that is
    worked out with them counts for nothing, but it has to be a number.
    """
    if lighting is None:
        return False
    return stand_in_lit(samples, run, model, lit_vertices, lighting.fog)


@stage
def stand_in_lit(samples, run, model, lit_vertices, fog):
    """Do so where there are lit vertices and no fog."""
    if lit_vertices is None:
        return False
    if fog is not None:
        return False
    if model != GOURAUD:
        return False
    for n in range(np.uintp(run[0]), np.uintp(run[1])):
        samples[lit.NORMAL_X, n] = np.float32(0.0)
        samples[lit.NORMAL_Y, n] = np.float32(0.0)
        samples[lit.NORMAL_Z, n] = np.float32(1.0)
        samples[lit.POINT_X, n] = np.float32(0.0)
        samples[lit.POINT_Y, n] = np.float32(0.0)
        samples[lit.POINT_Z, n] = np.float32(0.0)
    return True


@stage
def write_highlight(samples, run, model, owner, materials, lighting):
    """Write strength and exponent of the highlight along a run, and whether light falls on it."""
    if lighting is None:
        return
    specular, shininess = materials[owner, MATERIAL_SPECULAR], materials[owner, MATERIAL_SHININESS]
    share = np.float32(1.0 if model in (FLAT, PHONG) else 0.0)
    for n in range(np.uintp(run[0]), np.uintp(run[1])):
        samples[lit.SPECULAR, n] = specular
        samples[lit.SHININESS, n] = shininess
        samples[lit.LIT, n] = share
    write_facets(samples, run, model == PBR, owner, lighting.microfacets)


@stage
def write_answers(samples, run, model, owner, surface, lighting):
    """Write how an object answers light along a run, and the light it sends out."""
    write_highlight(samples, run, model, owner, surface.materials, lighting)
    write_emission(samples, run, owner, surface.maps)


@stage
def note_textured(places, run, weights, a, b, c, behind, owner, samples, surface):
    """Note what samples of one face take to be textured, besides coordinates and steps."""
    note_matt_light(
        places, run, weights, a, b, c, behind, owner, samples, surface, surface.matt_vertices
    )
    texture_places.note_corners(places, run, a, b, c, surface.maps)
