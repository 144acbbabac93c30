"""
Gather what lighting needs of the samples of a row: base colour, normal, position, highlight.

Neighbours on one face form a run (``runs``): what belongs to the face is set up once, and the
weights and every attribute are interpolated along the run, into scratch memory with one row for
each quantity (``lighting``).
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels import runs, texturing
from rasterjit.kernels.interpolation import (
    blend,
    face_normal,
    find_object,
    interpolate,
    matrix_of,
    place_sample,
    place_vertex,
    sample_weights,
    seen_from_behind,
    vertex_normal,
    weights_along_row,
    weights_from_edges,
)
from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.records import (
    FLAT,
    GOURAUD,
    MATERIAL_MODEL,
    MATERIAL_SHININESS,
    MATERIAL_SPECULAR,
    PHONG,
)

CHANNELS, TINT = runs.REAL_COLUMNS, runs.REAL_COLUMNS + 9
"""Columns of a face: red of three vertices, green, blue; and what they are multiplied by."""
NORMALS, TURN, POINT = runs.REAL_COLUMNS + 12, runs.REAL_COLUMNS + 21, runs.REAL_COLUMNS + 30
"""Columns of a face: three normals, the matrix that turns them, a point and two ways from it."""
REAL_COLUMNS = runs.REAL_COLUMNS + 39

FEW = 8
"""Runs shorter than this are not worth a vector loop."""


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
def note_matt_light(places, n, weights, a, b, c, behind, model, matt_vertices, tint):
    """Write the colour without the highlights of vertices, if any lies over a texture."""
    if matt_vertices is None:
        return
    matt = matt_light(weights, a, b, c, behind, model, matt_vertices, tint)
    for k in range(3):
        places[texturing.MATT + k, n] = matt[k]


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


@disjoint_stage
def write_colors(red, green, blue, second, third, colors):
    """Write the colours along a run."""
    for i in range(red.shape[0]):
        red[i], green[i], blue[i] = color_at(second[i], third[i], colors)


@disjoint_stage
def write_places(nx, ny, nz, px, py, pz, second, third, normal, point):
    """Write the normals and the positions along a run."""
    for i in range(nx.shape[0]):
        nx[i], ny[i], nz[i] = normal_at(second[i], third[i], normal)
        px[i], py[i], pz[i] = point_at(second[i], third[i], point)


@stage
def color_values(a, b, c, k, colors):
    """Return one channel of three vertices, float64; ones if they have no colours."""
    if colors is None:
        return 1.0, 1.0, 1.0
    return np.float64(colors[a, k]), np.float64(colors[b, k]), np.float64(colors[c, k])


@stage
def light_values(a, b, c, k, side, lit_vertices, values):
    """Return one channel of the light on three vertices; the values given if there is none."""
    if lit_vertices is None:
        return values
    return (
        np.float64(lit_vertices[a, side, k]),
        np.float64(lit_vertices[b, side, k]),
        np.float64(lit_vertices[c, side, k]),
    )


@stage
def colors_of(face, a, b, c, behind, model, owner, surface):
    """
    Return the colours of three vertices, channel by channel, and the tint they are multiplied by.

    Vertex colours and material, or the light on the vertices if the object is shaded by Gouraud.
    """
    red = color_values(a, b, c, 0, surface.vertex_colors)
    green = color_values(a, b, c, 1, surface.vertex_colors)
    blue = color_values(a, b, c, 2, surface.vertex_colors)
    tint = face_tint(face, surface.face_colors, material_tint(surface.materials, owner))
    if model == GOURAUD and surface.lit_vertices is not None:
        side = 1 if behind else 0
        red = light_values(a, b, c, 0, side, surface.lit_vertices, red)
        green = light_values(a, b, c, 1, side, surface.lit_vertices, green)
        blue = light_values(a, b, c, 2, side, surface.lit_vertices, blue)
        tint = np.float32(1.0), np.float32(1.0), np.float32(1.0)
    return (red, green, blue), tint


@stage
def normals_of(a, b, c, model, owner, placement, normals):
    """
    Return the normals at three vertices and the matrix that turns them to world axes.

    The face's own normal three times, and the unit matrix, unless the object is smooth.
    """
    if normals is not None:  # noqa: SIM102 - absent normals are compiled out
        if model == PHONG:
            at = vertex_normal(normals, a), vertex_normal(normals, b), vertex_normal(normals, c)
            return at, matrix_of(placement.normal_matrices, owner)
    own = face_normal(a, b, c, owner, placement)
    return (own, own, own), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@stage
def points_of(a, b, c, model, owner, placement):
    """
    Return where the first vertex lies, and the ways to the others in model space.

    The middle of the face, and no ways, if it is shaded flat.
    """
    p = placement.positions
    if model == FLAT:
        middle = (1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0)
        nowhere = (0.0, 0.0, 0.0)
        return place_sample(middle, a, b, c, owner, placement), nowhere, nowhere
    return (
        place_vertex(a, owner, placement),
        (p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]),
        (p[c, 0] - p[a, 0], p[c, 1] - p[a, 1], p[c, 2] - p[a, 2]),
    )


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


@stage
def write_place(samples, n, second, third, normal, point):
    """Write normal and position of one sample; nothing if there is no light."""
    if normal is None:
        return
    nx, ny, nz = normal_at(second, third, normal)
    samples[lit.NORMAL_X, n], samples[lit.NORMAL_Y, n], samples[lit.NORMAL_Z, n] = nx, ny, nz
    px, py, pz = point_at(second, third, point)
    samples[lit.POINT_X, n], samples[lit.POINT_Y, n], samples[lit.POINT_Z, n] = px, py, pz


@stage
def gather_few(samples, weights, run, colors, normal, point, row_start):
    """Interpolate along a short run, sample by sample; return whether any weight is doubtful."""
    (e0, e1, e2), steps, ratios = row_start
    doubtful = np.int64(0)
    for n in range(np.uintp(run[0]), np.uintp(run[1])):
        second, third, is_doubtful = weights_from_edges(e0, e1, e2, ratios)
        doubtful |= is_doubtful
        weights[0, n], weights[1, n] = second, third
        red, green, blue = color_at(second, third, colors)
        samples[lit.RED, n], samples[lit.GREEN, n], samples[lit.BLUE, n] = red, green, blue
        write_place(samples, n, second, third, normal, point)
        e0 += steps[0]
        e1 += steps[1]
        e2 += steps[2]
    return doubtful


@stage
def gather_places(samples, run, second, third, normal, point):
    """Write normals and positions along a run; nothing if there is no light."""
    if normal is None:
        return
    start, stop = run
    write_places(
        samples[lit.NORMAL_X, start:stop], samples[lit.NORMAL_Y, start:stop],
        samples[lit.NORMAL_Z, start:stop], samples[lit.POINT_X, start:stop],
        samples[lit.POINT_Y, start:stop], samples[lit.POINT_Z, start:stop],
        second, third, normal, point,
    )  # fmt: skip


@stage
def gather_many(samples, weights, run, colors, normal, point):
    """Interpolate along a run whose weights are known."""
    start, stop = run
    second, third = weights[0, start:stop], weights[1, start:stop]
    write_colors(
        samples[lit.RED, start:stop], samples[lit.GREEN, start:stop],
        samples[lit.BLUE, start:stop], second, third, colors,
    )  # fmt: skip
    gather_places(samples, run, second, third, normal, point)


@stage
def back_is_seen(a, b, c, owner, geometry, placement, lighting):
    """Return whether the back of a face is seen; it makes no difference where there is no light."""
    if lighting is None:
        return False
    return seen_from_behind(a, b, c, owner, geometry, placement)


@stage
def note_textured(
    places, where, run, column, weights, a, b, c, behind, owner, samples, surface
):  # fmt: skip
    """Note what it takes to texture a run; nothing if there are no textures."""
    if places is None:
        return
    model = np.int64(surface.materials[owner, MATERIAL_MODEL])
    for n in range(run[0], run[1]):
        at = (0.0, weights[0, n], weights[1, n])
        where[n] = column + n - run[0]
        tint = samples[lit.RED, n], samples[lit.GREEN, n], samples[lit.BLUE, n]
        note_matt_light(places, n, at, a, b, c, behind, model, surface.matt_vertices, tint)
        texturing.note_place(places, n, at, a, b, c, owner, surface.textures)


@stage
def put_three(real, column, values):
    """Write three numbers into a row."""
    real[column], real[column + 1], real[column + 2] = values


@stage
def three_at(real, column):
    """Return three numbers of a row."""
    return real[column], real[column + 1], real[column + 2]


@stage
def put_places(a, b, c, behind, model, owner, placement, surface, lighting, real):
    """Write what normals and positions on a face are made of; nothing if there is no light."""
    if lighting is None:
        return
    (na, nb, nc), matrix = normals_of(a, b, c, model, owner, placement, surface.normals)
    point, second, third = points_of(a, b, c, model, owner, placement)
    put_three(real, NORMALS, na)
    put_three(real, NORMALS + 3, nb)
    put_three(real, NORMALS + 6, nc)
    for k in range(9):
        real[TURN + k] = matrix[k]
    put_three(real, POINT, point)
    put_three(real, POINT + 3, second)
    put_three(real, POINT + 6, third)


@stage
def set_up_face(face, owner, whole, real, geometry, placement, surface, lighting):
    """Write all that shading needs of a face into its rows of the table."""
    a, b, c = runs.put_corners(face, geometry, whole, real)
    model = np.int64(surface.materials[owner, MATERIAL_MODEL])
    behind = back_is_seen(a, b, c, owner, geometry, placement, lighting)
    whole[runs.OWNER], whole[runs.BEHIND] = owner, behind
    (red, green, blue), tint = colors_of(face, a, b, c, behind, model, owner, surface)
    put_three(real, CHANNELS, red)
    put_three(real, CHANNELS + 3, green)
    put_three(real, CHANNELS + 6, blue)
    put_three(real, TINT, tint)
    put_places(a, b, c, behind, model, owner, placement, surface, lighting, real)


@stage
def colors_at(real):
    """Return what `color_at` takes."""
    tint = np.float32(real[TINT]), np.float32(real[TINT + 1]), np.float32(real[TINT + 2])
    channels = three_at(real, CHANNELS), three_at(real, CHANNELS + 3), three_at(real, CHANNELS + 6)
    return channels, tint


@stage
def places_at(whole, real, placement, lighting):
    """Return what `normal_at` and `point_at` take; nothing if there is no light."""
    if lighting is None:
        return None, None
    normals = three_at(real, NORMALS), three_at(real, NORMALS + 3), three_at(real, NORMALS + 6)
    turn = (*three_at(real, TURN), *three_at(real, TURN + 3), *three_at(real, TURN + 6))
    side = 1.0 - 2.0 * np.float64(whole[runs.BEHIND])
    matrix = matrix_of(placement.relative_from_model, whole[runs.OWNER])
    first, second, third = (
        three_at(real, POINT),
        three_at(real, POINT + 3),
        three_at(real, POINT + 6),
    )
    return (normals, turn, side), (first, second, third, matrix)


@stage
def gather_run(
    samples, weights, places, where, n, count, column, row, whole, real, geometry, placement,
    surface, lighting,
):  # fmt: skip
    """Interpolate everything that shading needs along one run of a face that is set up."""
    run, owner = (n, n + count), whole[runs.OWNER]
    model = np.int64(surface.materials[owner, MATERIAL_MODEL])
    colors = colors_at(real)
    normal, point = places_at(whole, real, placement, lighting)
    write_highlight(samples, run, model, owner, surface.materials, lighting)
    # Find the weights; a short run is done with that, samples and all.
    doubtful, is_done = whole[runs.IS_CLIPPED], False
    if not doubtful:
        start = runs.row_start(whole, real, column, row)
        if count < FEW:
            doubtful = gather_few(samples, weights, run, colors, normal, point, start)
            is_done = not doubtful
        else:
            doubtful = weights_along_row(
                weights[0, n : n + count], weights[1, n : n + count], start
            )
    a, b, c = whole[runs.CORNERS], whole[runs.CORNERS + 1], whole[runs.CORNERS + 2]
    if doubtful:
        for i in range(count):
            exact = sample_weights(a, b, c, column + i, row, geometry)
            weights[0, n + i], weights[1, n + i] = exact[1], exact[2]
    if not is_done:
        gather_many(samples, weights, run, colors, normal, point)
    behind = whole[runs.BEHIND] != 0
    note_textured(places, where, run, column, weights, a, b, c, behind, owner, samples, surface)


@stage
def gather_row(
    faces, samples, weights, places, where, whole, real, left, row, geometry, placement, surface,
    lighting,
):  # fmt: skip
    """Gather the covered samples of a part of a row, which starts at ``left``; count them."""
    count, at, owner = np.int64(0), np.int64(0), np.int64(0)
    while at < faces.shape[0]:
        end = runs.run_end(faces, at)
        face = np.int64(faces[np.uintp(at)])
        if face >= 0:
            slot = runs.slot_of(face)
            if whole[slot, runs.FACE] != face:
                owner = find_object(face, placement.face_starts, owner)
                set_up_face(
                    face, owner, whole[slot], real[slot], geometry, placement, surface, lighting
                )
            gather_run(
                samples, weights, places, where, count, end - at, left + at, row, whole[slot],
                real[slot], geometry, placement, surface, lighting,
            )  # fmt: skip
            count += end - at
        at = end
    return count
