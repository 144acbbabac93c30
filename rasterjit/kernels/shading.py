"""
Shade each visible sample once: base colour and normal first, then light, row by row.

A row's covered samples are gathered into scratch memory (``gathering``), one row for each quantity,
and lit together by loops that vectorize. What no object of the frame has (vertex colours, textures,
normals, lights ...) is ``None`` and compiled out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.kernels import (
    environments,
    fogging,
    patches,
    runs,
    texture_rows,
    texturing,
)
from rasterjit.kernels import lighting as lit
from rasterjit.kernels.alpha import alpha_at, alpha_row, find_alphas
from rasterjit.kernels.attributes import material_tint
from rasterjit.kernels.gathering import gather_row
from rasterjit.kernels.interpolation import place_vertex, smooth_normal
from rasterjit.kernels.jit import disjoint_stage, kernel, stage
from rasterjit.kernels.maps import add_emission_row, occlusion_of, read_maps
from rasterjit.kernels.microfacets import add_facet_lights, kinds_shown, start_facet_row
from rasterjit.kernels.records import (
    GOURAUD,
    MATERIAL_MODEL,
    MATERIAL_SHININESS,
    MATERIAL_SPECULAR,
    Encoding,
    Geometry,
    Lighting,
    Placement,
    Surface,
)
from rasterjit.kernels.resolve import encode_channels, encode_pixel, encode_span
from rasterjit.kernels.setup import last_at_most
from rasterjit.kernels.shadow_receivers import WEIGHT_ROWS, find_receivers, note_vertex
from rasterjit.kernels.shadowing import SHADOW_ROWS, shadow_row, vertex_shadow_row
from rasterjit.kernels.tone_mapping import toned

PADDING = patches.VECTOR
"""
Columns of scratch memory that hold no sample, but what a last vector writes beyond it.

Without them the rows would lie a power of two apart, and push each other out of L1.
"""

BLOCK_COLUMNS = 128
"""Columns gathered at once: 16 quantities of that many samples, 8 KiB, stay in L1."""


@stage
def vertex_tint(vertex, vertex_colors, tint):
    """Return the tint times the colour of a vertex; the tint itself if there are none."""
    if vertex_colors is None:
        return tint
    return (
        tint[0] * vertex_colors[vertex, 0],
        tint[1] * vertex_colors[vertex, 1],
        tint[2] * vertex_colors[vertex, 2],
    )


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
def matt_part(color, matts, n):
    """Return the part of a colour that a texture absorbs light from; all of it without others."""
    if matts is None:
        return color
    return np.float32(matts[n])


@disjoint_stage
def absorb_row(colors, texels, matts):
    """Multiply one channel of the base colours by what the textures show."""
    for n in range(colors.shape[0]):
        color = colors[n]
        colors[n] = absorb(color, np.float32(texels[n]), matt_part(color, matts, n))


@stage
def matt_row(scratch, k, count, matt_vertices):
    """Return one channel of the colours without highlights; None if no vertex has any."""
    if matt_vertices is None:
        return None
    return scratch[texture_rows.MATT + k, :count]


@stage
def apply_textures(samples, count, scratch, matt_vertices):
    """Multiply the gathered base colours by what the textures show."""
    for k in range(3):
        absorb_row(
            samples[lit.RED + k, :count], scratch[texture_rows.SHOWN + k, :count],
            matt_row(scratch, k, count, matt_vertices),
        )  # fmt: skip


@stage
def texture_row(samples, lookup, count, scratch, textures, matt_vertices):
    """Apply the textures to the gathered samples of a row; nothing if there are none."""
    if textures is None:
        return
    texture_rows.read_textures(scratch, lookup, count, texturing.BASE_COLOR, textures)
    apply_textures(samples, count, scratch, matt_vertices)


@stage
def held_occlusion(samples, n, maps):
    """Return the light from all around that a sample's own map lets through; all without maps."""
    if maps is None:
        return np.float32(1.0)
    return samples[lit.OCCLUSION, n]


@stage
def occlude(samples, faces, left, row, occlusion, maps):
    """Write how much ambient light reaches the gathered samples; nothing if all of it does."""
    if occlusion is None:
        return
    n = np.uintp(0)
    for at in range(np.uintp(faces.shape[0])):
        if faces[at] >= 0:
            own = held_occlusion(samples, n, maps)
            samples[lit.OCCLUSION, n] = own * occlusion[row, left + np.int64(at)]
            n += np.uintp(1)


@stage
def occlude_row(samples, faces, left, row, lighting, maps):
    """Write how much ambient light reaches the gathered samples; nothing without light."""
    if lighting is None:
        return
    occlude(samples, faces, left, row, lighting.occlusion, maps)


@stage
def occlusion_row(samples, count, occlusion, maps):
    """Return the shares of ambient light that reach the gathered samples; None if it is all."""
    if occlusion is None:
        return occlusion_of(samples, count, maps)
    return samples[lit.OCCLUSION, :count]


@stage
def span_end(faces, column):
    """Return the first column that is covered unlike this one."""
    end = column + 1
    while end < faces.shape[0] and (faces[end] < 0) == (faces[column] < 0):
        end += 1
    return end


@stage
def viewer_of(placement):
    """Return the direction to the viewer as lighting takes it, float32."""
    viewer = placement.toward_viewer
    return (
        np.float32(viewer[0]),
        np.float32(viewer[1]),
        np.float32(viewer[2]),
        np.float32(viewer[3]),
    )


@stage
def add_light_row(
    samples, weights, faces, count, kinds, occlusion, geometry, placement, lighting, toward_viewer
):  # fmt: skip
    """Add what lights and environment show of gathered samples; ``kinds`` are `kinds_shown`."""
    shows_matt, shows_facets = kinds
    if lighting.renormalizes != 0:
        lit.scale_normals(samples, count)
    start_facet_row(samples, count, lighting, toward_viewer, occlusion, lighting.microfacets)
    # Add the lights, each with its shadows.
    find_receivers(weights, faces, geometry, placement, lighting.shadows)
    for n in range(lighting.lights.shape[0]):
        reached = shadow_row(
            samples, weights, count, faces, n, lighting, geometry, placement, lighting.shadows
        )
        if shows_matt:
            lit.add_lights(samples, count, n, lighting, toward_viewer, reached)
        if shows_facets:
            light = lighting.lights[n]
            add_facet_lights(samples, count, light, toward_viewer, reached, lighting.microfacets)
    # Add the environment.
    environments.add_environment(samples, count, occlusion, lighting.environment, toward_viewer)


@stage
def light_row(
    samples, weights, faces, count, row, geometry, placement, surface, lighting, toward_viewer
):  # fmt: skip
    """Turn the base colours of gathered samples into seen colours."""
    maps = surface.maps
    occlusion = occlusion_row(samples, count, lighting.occlusion, maps)
    lit.show_ambient(samples, count, lighting, occlusion)
    # Nothing more falls on what is unlit, or lit at its vertices.
    kinds = kinds_shown(samples, count, lighting.microfacets, surface.lit_vertices)
    if kinds[0] or kinds[1]:
        add_light_row(
            samples, weights, faces, count, kinds, occlusion, geometry, placement, lighting,
            toward_viewer,
        )  # fmt: skip
    # Add what the surfaces send out.
    add_emission_row(samples, count, lit.OUT_RED, maps)
    # Lay the fog over all.
    fogging.find_places(samples, weights, faces, geometry, placement, lighting.fog)
    fogging.cover_samples(samples, count, lighting.fog, toward_viewer)


@stage
def seen_colors(
    samples, weights, faces, count, row, geometry, placement, surface, lighting, toward_viewer
):  # fmt: skip
    """Light the gathered samples; return red, green and blue. Without light, the base colours."""
    if lighting is None:
        add_emission_row(samples, count, lit.RED, surface.maps)
        return samples[lit.RED], samples[lit.GREEN], samples[lit.BLUE]
    light_row(
        samples, weights, faces, count, row, geometry, placement, surface, lighting, toward_viewer
    )
    return samples[lit.OUT_RED], samples[lit.OUT_GREEN], samples[lit.OUT_BLUE]


@stage
def write_linear(colors, alphas, n, linear):
    """Write a span of linear colour and alpha."""
    for i in range(linear.shape[0]):
        for k in range(3):
            linear[i, k] = colors[k][n + i]
        linear[i, 3] = alpha_at(alphas, n + i)


@stage
def write_background(background, behind, linear, color):
    """Write a span that shows nothing."""
    for i in range(color.shape[0]):
        color[i] = behind
    for i in range(linear.shape[0]):
        for k in range(4):
            linear[i, k] = background[k]


@stage
def encode_shown(red, green, blue, alphas, first, stop, table, color):
    """Write a span of colours in codes, with the alpha of samples ``first`` to ``stop``."""
    if alphas is None:
        encode_span(red, green, blue, table, color)
        return
    encode_channels(red, green, blue, alphas[first:stop], table, color)


@stage
def write_span(colors, shown, alphas, first, count, encoding, linear, color):
    """Write a span of gathered samples, from number ``first`` on."""
    stop = first + count
    if color.shape[0] > 0:
        encode_shown(
            shown[0][first:stop], shown[1][first:stop], shown[2][first:stop], alphas, first, stop,
            encoding.table, color,
        )  # fmt: skip
    if linear.shape[0] > 0:
        write_linear(colors, alphas, first, linear)


@stage
def write_row(faces, count, colors, shown, alphas, background, encoding, linear, color):
    """
    Write a part of a row: its gathered samples in their places, background elsewhere.

    Takes the rows of linear colour, and those of the colour to show.
    """
    behind = encode_pixel(background, encoding.table)
    columns = faces.shape[0]
    if count == columns:
        write_span(colors, shown, alphas, 0, count, encoding, linear, color)
        return
    if count == 0:
        write_background(background, behind, linear, color)
        return
    n, at = np.int64(0), np.int64(0)
    while at < columns:
        end = span_end(faces, at)
        if faces[at] < 0:
            write_background(background, behind, linear[at:end], color[at:end])
        else:
            write_span(colors, shown, alphas, n, end - at, encoding, linear[at:end], color[at:end])
            n += end - at
        at = end


def sample_rows(surface: Surface, lighting: Lighting | None) -> int:
    """Return how many quantities of a sample are kept: more if an effect needs them."""
    needed = [surface.maps, surface.alphas]
    if lighting is not None and lighting.shadows is not None:
        return SHADOW_ROWS
    if lighting is not None:
        needed += [
            lighting.microfacets, lighting.environment, lighting.occlusion,
            lighting.fog,
        ]  # fmt: skip
    return lit.PLAIN_ROWS if all(record is None for record in needed) else lit.SAMPLE_ROWS


def scratch_memory(rows: int = lit.PLAIN_ROWS, has_textures: bool = False) -> tuple[Any, ...]:
    """Return the memory that a thread needs to shade a part of a row; ``rows`` of each sample."""
    room = BLOCK_COLUMNS + PADDING
    return (
        np.empty((rows, room), np.float32),
        np.empty((2 if rows < SHADOW_ROWS else WEIGHT_ROWS, room), np.float64),
        np.empty((texture_rows.SCRATCH_ROWS, room), np.float64) if has_textures else None,
        texture_rows.lookup_memory(room) if has_textures else None,
        np.empty((runs.SLOTS, runs.WHOLE_COLUMNS), np.int64),
        np.empty((runs.SLOTS, runs.REAL_COLUMNS), np.float64),
        (
            np.empty((patches.WHOLE_ROWS, room), np.int32),
            np.empty((patches.VERTEX_ROWS, room), np.float64),
            np.empty((patches.VERTEX_ROWS, room), np.float32),
        ),
    )


@stage
def shade_part(
    faces, left, row, geometry, placement, surface, lighting, toward_viewer, scratch
):  # fmt: skip
    """Shade the covered samples of a part of a row; return how many, and their colours."""
    samples, weights, places, lookup, whole, real, gathered = scratch
    count = gather_row(
        faces, samples, weights, places, whole, real, gathered, left, row, geometry, placement,
        surface, lighting,
    )  # fmt: skip
    texture_row(samples, lookup, count, places, surface.textures, surface.matt_vertices)
    read_maps(
        samples, weights, lookup, count, places, geometry, placement, surface, lighting,
        surface.maps,
    )  # fmt: skip
    occlude_row(samples, faces, left, row, lighting, surface.maps)
    # Find alpha.
    find_alphas(samples, weights, faces, places, geometry, placement, surface, surface.alphas)
    return count, seen_colors(
        samples, weights, faces, count, row, geometry, placement, surface, lighting, toward_viewer
    )


@kernel
def shade_rows(
    face_id, first_row, geometry: Geometry, placement: Placement, surface: Surface,
    lighting: Lighting | None, background, encoding: Encoding, linear, color, scratch,
):  # fmt: skip
    """
    Write the colour of some rows of the frame.

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
    encoding : Encoding
    linear : (R, W, 4) float32
        Written: red, green, blue in linear light, and alpha (1 where there is a face, unless
        ``surface.alphas`` says less). Unless it is not wanted, then W is 0.
    color : (R, W) uint32
        Written: what is to be shown of it in sRGB codes, RGBA bytes from the lowest up. Or W is 0,
        too.
    scratch : tuple
        This thread's own, from `scratch_memory`.
    """
    rows, columns = face_id.shape
    samples, toward_viewer = scratch[0], viewer_of(placement)
    runs.forget_faces(scratch[4])
    for row in range(rows):
        for left in range(0, columns, BLOCK_COLUMNS):
            right = min(left + BLOCK_COLUMNS, columns)
            faces = face_id[row, left:right]
            count, colors = shade_part(
                faces, left, first_row + row, geometry, placement, surface, lighting,
                toward_viewer, scratch,
            )  # fmt: skip
            shown = toned(samples, count, colors, encoding.tone)
            write_row(
                faces, count, colors, shown, alpha_row(samples, surface.alphas), background,
                encoding, linear[row, left:right], color[row, left:right],
            )  # fmt: skip


@stage
def light_block(first, count, owner, placement, surface, lighting, lit_vertices, scratch):
    """Light some vertices of one object, for a viewer in front and one behind."""
    samples, weights = scratch[0], scratch[1]
    toward_viewer = viewer_of(placement)
    tint = material_tint(surface.materials, owner)
    only = (1.0, 0.0, 0.0)
    for side in range(2):
        toward = 1.0 - 2.0 * side
        for n in range(count):
            vertex = first + n
            point = place_vertex(vertex, owner, placement)
            normal = smooth_normal(
                only, vertex, vertex, vertex, surface.normals, placement.normal_matrices, owner
            )
            color = vertex_tint(vertex, surface.vertex_colors, tint)
            for k in range(3):
                samples[lit.RED + k, n] = color[k]
                samples[lit.NORMAL_X + k, n] = toward * normal[k]
                samples[lit.POINT_X + k, n] = point[k]
            samples[lit.SPECULAR, n] = surface.materials[owner, MATERIAL_SPECULAR]
            samples[lit.SHININESS, n] = surface.materials[owner, MATERIAL_SHININESS]
            samples[lit.LIT, n] = 1.0
            note_vertex(weights, n, point, normal, lighting.shadows)
        lit.start_light(samples, count, lighting, None)
        for n in range(lighting.lights.shape[0]):
            reached = vertex_shadow_row(samples, weights, count, n, lighting.shadows)
            lit.add_lights(samples, count, n, lighting, toward_viewer, reached)
        environments.add_environment(samples, count, None, lighting.environment, toward_viewer)
        for n in range(count):
            for k in range(3):
                lit_vertices[first + n, side, k] = samples[lit.OUT_RED + k, n]


@kernel
def light_vertices(
    vertices, vertex_starts, placement: Placement, surface: Surface, lighting: Lighting,
    lit_vertices, scratch,
):  # fmt: skip
    """
    Light the vertices of the objects shaded by Gouraud.

    Parameters
    ----------
    vertices : (int, int)
        The first, and one past the last; they may belong to several objects.
    vertex_starts : (O+1,) int64
        Object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``.
    placement, surface, lighting : records
        ``surface.normals`` is present; ``surface.face_colors`` has no part in it.
    lit_vertices : (V, 2, 3) float32
        Writes the linear colour of those vertices, for a viewer in front and one behind.
    scratch : tuple
        This thread's own, from `scratch_memory`.
    """
    owner = last_at_most(vertex_starts, vertices[0])
    first = vertices[0]
    while first < vertices[1]:
        while first >= vertex_starts[owner + 1]:
            owner += 1
        end = min(vertices[1], vertex_starts[owner + 1])
        if np.int64(surface.materials[owner, MATERIAL_MODEL]) == GOURAUD:
            for start in range(first, end, BLOCK_COLUMNS):
                count = min(end - start, BLOCK_COLUMNS)
                light_block(
                    start, count, owner, placement, surface, lighting, lit_vertices, scratch
                )
        first = end
