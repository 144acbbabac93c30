"""
Shade each visible sample once: base colour and normal first, then light, row by row.

A row's covered samples are gathered into scratch memory, one row for each quantity (``lighting``),
interpolated one by one, and lit together by loops that vectorize. What no object of the frame has
(vertex colours, textures, normals, lights ...) is ``None`` and compiled out.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels import texturing
from rasterjit.kernels.interpolation import (
    face_normal,
    find_object,
    interpolate,
    lowest_first,
    place_sample,
    place_vertex,
    sample_weights,
    seen_from_behind,
    smooth_normal,
)
from rasterjit.kernels.jit import kernel, stage
from rasterjit.kernels.records import Geometry, Lighting, Placement, Surface

UNLIT, FLAT, GOURAUD, PHONG = 0, 1, 2, 3
"""Shading models, as ``Surface.materials`` numbers them."""

MATERIAL_SPECULAR, MATERIAL_SHININESS, MATERIAL_MODEL = 4, 5, 6
"""Columns of ``Surface.materials`` behind the base colour."""


@stage
def material_tint(materials, owner):
    """Return the base colour of an object's material."""
    return materials[owner, 0], materials[owner, 1], materials[owner, 2], materials[owner, 3]


@stage
def mixed(weights, value0, value1, value2):
    """Return an interpolated float32, rounded once."""
    return np.float32(
        interpolate(weights, np.float64(value0), np.float64(value1), np.float64(value2))
    )


@stage
def vertex_tint(weights, a, b, c, vertex_colors, tint):
    """Return the tint times the interpolated vertex colour; the tint itself if there are none."""
    if vertex_colors is None:
        return tint
    return (
        tint[0] * mixed(weights, vertex_colors[a, 0], vertex_colors[b, 0], vertex_colors[c, 0]),
        tint[1] * mixed(weights, vertex_colors[a, 1], vertex_colors[b, 1], vertex_colors[c, 1]),
        tint[2] * mixed(weights, vertex_colors[a, 2], vertex_colors[b, 2], vertex_colors[c, 2]),
        tint[3] * mixed(weights, vertex_colors[a, 3], vertex_colors[b, 3], vertex_colors[c, 3]),
    )


@stage
def face_tint(face, face_colors, tint):
    """Return the tint times the face's colour; the tint itself if there are none."""
    if face_colors is None:
        return tint
    return (
        tint[0] * face_colors[face, 0],
        tint[1] * face_colors[face, 1],
        tint[2] * face_colors[face, 2],
        tint[3] * face_colors[face, 3],
    )


@stage
def shading_normal(weights, a, b, c, model, normals, owner, placement):
    """Return the normal to shade with: the face's own unless the object is smooth."""
    if normals is None:
        return face_normal(a, b, c, owner, placement)
    if model == PHONG:
        return smooth_normal(weights, a, b, c, normals, placement.normal_matrices, owner)
    return face_normal(a, b, c, owner, placement)


@stage
def gouraud_light(weights, a, b, c, behind, model, lit_vertices, tint):
    """Return the colour with the light of the vertices, if the object is shaded by Gouraud."""
    if lit_vertices is None:
        return tint
    if model != GOURAUD:
        return tint
    side = 1 if behind else 0
    lit_a, lit_b, lit_c = lit_vertices[a, side], lit_vertices[b, side], lit_vertices[c, side]
    return (
        mixed(weights, lit_a[0], lit_b[0], lit_c[0]),
        mixed(weights, lit_a[1], lit_b[1], lit_c[1]),
        mixed(weights, lit_a[2], lit_b[2], lit_c[2]),
        tint[3],
    )


@stage
def note_matt_light(scratch, n, weights, a, b, c, behind, model, matt_vertices, tint):
    """Write the colour without the highlights of vertices, if any lies over a texture."""
    if matt_vertices is None:
        return
    matt = gouraud_light(weights, a, b, c, behind, model, matt_vertices, tint)
    for k in range(3):
        scratch[texturing.MATT + k, n] = matt[k]


@stage
def absorb(color, texel, matt):
    """
    Return a colour times a texel, but for the highlight in it, which lies on top.

    That is what is left of the colour when the texel has absorbed its share of the light without
    highlights: exactly the colour itself if the texel is white.
    """
    if matt == color:
        return color * texel
    return max(color - matt * (np.float32(1.0) - texel), np.float32(0.0))


@stage
def apply_textures(samples, count, scratch, matt_vertices):
    """Multiply the gathered base colours by what the textures show."""
    for k in range(4):
        for n in range(count):
            color, texel = samples[lit.RED + k, n], np.float32(scratch[texturing.SHOWN + k, n])
            matt = color
            if matt_vertices is not None and k < 3:
                matt = np.float32(scratch[texturing.MATT + k, n])
            samples[lit.RED + k, n] = absorb(color, texel, matt)


@stage
def texture_row(samples, where, count, row, scratch, geometry, textures, matt_vertices):
    """Apply the textures to the gathered samples of a row; nothing if there are none."""
    if textures is None:
        return
    texturing.read_textures(scratch, where, count, row, textures, geometry)
    apply_textures(samples, count, scratch, matt_vertices)


@stage
def gather_normal(samples, n, weights, a, b, c, owner, geometry, placement, surface, lighting):
    """Write normal, position and highlight of one sample; nothing if there is no light."""
    if lighting is None:
        return False
    model = np.int64(surface.materials[owner, MATERIAL_MODEL])
    behind = seen_from_behind(a, b, c, owner, geometry, placement)
    side = -1.0 if behind else 1.0
    normal = shading_normal(weights, a, b, c, model, surface.normals, owner, placement)
    at = weights
    if model == FLAT:
        at = (1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0)
    samples[lit.NORMAL_X, n] = side * normal[0]
    samples[lit.NORMAL_Y, n] = side * normal[1]
    samples[lit.NORMAL_Z, n] = side * normal[2]
    point = place_sample(at, a, b, c, owner, placement)
    samples[lit.POINT_X, n] = point[0]
    samples[lit.POINT_Y, n] = point[1]
    samples[lit.POINT_Z, n] = point[2]
    samples[lit.SPECULAR, n] = surface.materials[owner, MATERIAL_SPECULAR]
    samples[lit.SHININESS, n] = surface.materials[owner, MATERIAL_SHININESS]
    samples[lit.LIT, n] = 1.0 if model in (FLAT, PHONG) else 0.0
    return behind


@stage
def gather_sample(
    samples, scratch, n, face, owner, column, row, geometry, placement, surface, lighting
):
    """Interpolate everything that shading one sample needs."""
    a, b, c = lowest_first(geometry.faces, face)
    weights = sample_weights(a, b, c, column, row, geometry)
    tint = material_tint(surface.materials, owner)
    tint = face_tint(face, surface.face_colors, tint)
    tint = vertex_tint(weights, a, b, c, surface.vertex_colors, tint)
    behind = gather_normal(
        samples, n, weights, a, b, c, owner, geometry, placement, surface, lighting
    )
    model = np.int64(surface.materials[owner, MATERIAL_MODEL])
    note_matt_light(scratch, n, weights, a, b, c, behind, model, surface.matt_vertices, tint)
    tint = gouraud_light(weights, a, b, c, behind, model, surface.lit_vertices, tint)
    texturing.note_place(scratch, n, weights, a, b, c, owner, surface.textures)
    samples[lit.RED, n] = tint[0]
    samples[lit.GREEN, n] = tint[1]
    samples[lit.BLUE, n] = tint[2]
    samples[lit.ALPHA, n] = tint[3]


@stage
def light_row(samples, lighting, toward_viewer):
    """Light the gathered samples; without light the base colour is what is seen."""
    if lighting is None:
        for k in range(3):
            for n in range(samples.shape[1]):
                samples[lit.OUT_RED + k, n] = samples[lit.RED + k, n]
    else:
        lit.light_samples(samples, lighting, toward_viewer)


@kernel
def shade_rows(
    face_id, first_row, geometry: Geometry, placement: Placement, surface: Surface,
    lighting: Lighting | None, background, linear,
):  # fmt: skip
    """
    Write the linear colour of some rows of the frame.

    Parameters
    ----------
    face_id : (R, W) int32
        The visible faces of these rows.
    first_row : int
        Where they lie in the frame.
    geometry, placement, surface : records
    lighting : Lighting or None
        ``None``: every object shows its own colour.
    background : (4,) float32, linear
    linear : (R, W, 4) float32
        Written: red, green, blue in linear light, and alpha (1 where there is a face).
    """
    rows, columns = face_id.shape
    scratch = np.empty((lit.SAMPLE_ROWS, columns), np.float32)
    places = texturing.texture_scratch(surface.textures, columns)
    where = np.empty(columns, np.int32)
    toward_viewer = placement.toward_viewer.astype(np.float32)
    owner = np.int64(0)
    for row in range(rows):
        # List the covered samples of the row and gather what they need.
        count = 0
        for column in range(columns):
            face = np.int64(face_id[row, column])
            if face < 0:
                for k in range(4):
                    linear[row, column, k] = background[k]
                continue
            owner = find_object(face, placement.face_starts, owner)
            gather_sample(
                scratch, places, count, face, owner, column, first_row + row, geometry, placement,
                surface, lighting,
            )  # fmt: skip
            where[count] = column
            count += 1
        texture_row(
            scratch, where, count, first_row + row, places, geometry, surface.textures,
            surface.matt_vertices,
        )  # fmt: skip
        # Light them together and put them back in their places.
        samples = scratch[:, :count]
        light_row(samples, lighting, toward_viewer)
        for n in range(count):
            for k in range(3):
                linear[row, where[n], k] = samples[lit.OUT_RED + k, n]
            linear[row, where[n], 3] = 1.0


@kernel
def light_vertices(
    vertices, owner, placement: Placement, surface: Surface, lighting: Lighting, lit_vertices
):
    """
    Light the vertices of one object, for Gouraud shading.

    Parameters
    ----------
    vertices : (int, int)
        The object's first vertex, and one past its last.
    owner : int
        The object.
    placement, surface, lighting : records
        ``surface.normals`` is present; ``surface.face_colors`` has no part in it.
    lit_vertices : (V, 2, 3) float32
        Writes the linear colour of these vertices, for a viewer in front and one behind.
    """
    first, stop = vertices
    samples = np.empty((lit.SAMPLE_ROWS, stop - first), np.float32)
    toward_viewer = placement.toward_viewer.astype(np.float32)
    tint = material_tint(surface.materials, owner)
    for side in range(2):
        for n in range(stop - first):
            vertex = first + n
            only = (1.0, 0.0, 0.0)
            point = place_vertex(vertex, owner, placement)
            normal = smooth_normal(
                only, vertex, vertex, vertex, surface.normals, placement.normal_matrices, owner
            )
            toward = 1.0 - 2.0 * side
            color = vertex_tint(only, vertex, vertex, vertex, surface.vertex_colors, tint)
            for k in range(3):
                samples[lit.RED + k, n] = color[k]
                samples[lit.NORMAL_X + k, n] = toward * normal[k]
                samples[lit.POINT_X + k, n] = point[k]
            samples[lit.SPECULAR, n] = surface.materials[owner, MATERIAL_SPECULAR]
            samples[lit.SHININESS, n] = surface.materials[owner, MATERIAL_SHININESS]
            samples[lit.LIT, n] = 1.0
        lit.light_samples(samples, lighting, toward_viewer)
        for n in range(stop - first):
            for k in range(3):
                lit_vertices[first + n, side, k] = samples[lit.OUT_RED + k, n]
