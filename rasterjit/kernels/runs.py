"""
Gather a long run of a row: many neighbours that show one face.

What belongs to the face (vertices, edge functions, colours ...) is worked out once for the runs
that show it in some rows, and kept in a small table, found by a hash of the face's number. A face
that finds another one in its place takes it. Weights and attributes are interpolated along the run.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels import texture_places
from rasterjit.kernels.attributes import (
    color_at,
    face_tint,
    material_tint,
    normal_at,
    note_textured,
    point_at,
    stand_in_places,
    write_answers,
)
from rasterjit.kernels.interpolation import (
    face_normal,
    lowest_first,
    matrix_of,
    place_sample,
    place_vertex,
    sample_weights,
    seen_from_behind,
    vertex_normal,
    weights_along_run,
)
from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.records import FLAT, GOURAUD, MATERIAL_MODEL, PBR, PHONG
from rasterjit.kernels.setup import CLIPPED, edge

SLOT_BITS = 7
SLOTS = 1 << SLOT_BITS
"""Faces in the table: more than have long runs in a row of 1920 pixels."""

HASH = np.uint32(2654435769)
"""2**32 over the golden ratio: spreads numbers that are multiples of anything."""

FACE, IS_CLIPPED, OWNER, BEHIND = 0, 1, 2, 3
"""Columns of whole numbers: face, not 0 if it was cut, object, not 0 if its back is seen."""
CORNERS = 4
"""Three columns: vertices, the lowest number first."""
EDGE, ACROSS, DOWN = 7, 10, 13
"""Three columns each: edge functions at the first pixel, what they gain by a column and a row."""
WHOLE_COLUMNS = 16

RATIO = 0
"""Three columns of real numbers: the smallest w over each."""
CHANNELS, TINT = 3, 12
"""Columns of real numbers: red of three vertices, green, blue; and what they are multiplied by."""
NORMALS, TURN, POINT = 15, 24, 33
"""Columns of real numbers: three normals, the matrix that turns them, a point, two ways from it."""
REAL_COLUMNS = 42

NO_FACE = -1

LANES = 16
"""Samples compared at once: face numbers in a 512-bit register."""


@stage
def forget_faces(whole):
    """Empty the table."""
    for slot in range(SLOTS):
        whole[slot, FACE] = NO_FACE


@stage
def slot_of(face):
    """Return where in the table a face is kept."""
    return np.uintp(np.uint32(np.uint32(face) * HASH) >> np.uint32(32 - SLOT_BITS))


@stage
def put_edge(ax, ay, bx, by, k, bits, row):
    """Write the edge function of a -> b."""
    half = np.int64(1) << (bits - 1)
    row[EDGE + k] = edge(ax, ay, bx, by, half, half)
    row[ACROSS + k] = (ay - by) << bits
    row[DOWN + k] = (bx - ax) << bits


@stage
def put_ratios(a, b, c, w, real):
    """Write the smallest w of a face over each; 1 without w."""
    if w is None:
        real[RATIO], real[RATIO + 1], real[RATIO + 2] = 1.0, 1.0, 1.0
        return
    smallest = min(w[a], min(w[b], w[c]))
    real[RATIO], real[RATIO + 1], real[RATIO + 2] = (
        smallest / w[a],
        smallest / w[b],
        smallest / w[c],
    )


@stage
def put_corners(face, geometry, whole, real):
    """Write vertices, edge functions and ratios of a face into its rows; return the vertices."""
    a, b, c = lowest_first(geometry.faces, np.uintp(face))
    xy, bits = geometry.xy, geometry.viewport.grid_bits
    ax, ay = np.int64(xy[a, 0]), np.int64(xy[a, 1])
    bx, by = np.int64(xy[b, 0]), np.int64(xy[b, 1])
    cx, cy = np.int64(xy[c, 0]), np.int64(xy[c, 1])
    put_edge(bx, by, cx, cy, 0, bits, whole)
    put_edge(cx, cy, ax, ay, 1, bits, whole)
    put_edge(ax, ay, bx, by, 2, bits, whole)
    put_ratios(a, b, c, geometry.w, real)
    whole[FACE] = face
    whole[IS_CLIPPED] = (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & CLIPPED
    whole[CORNERS], whole[CORNERS + 1], whole[CORNERS + 2] = a, b, c
    return a, b, c


@stage
def row_start(whole, real, column, row):
    """Return what `interpolation.weights_along_row` takes, from a pixel on."""
    return (
        (
            whole[EDGE] + column * whole[ACROSS] + row * whole[DOWN],
            whole[EDGE + 1] + column * whole[ACROSS + 1] + row * whole[DOWN + 1],
            whole[EDGE + 2] + column * whole[ACROSS + 2] + row * whole[DOWN + 2],
        ),
        (whole[ACROSS], whole[ACROSS + 1], whole[ACROSS + 2]),
        (whole[DOWN], whole[DOWN + 1], whole[DOWN + 2]),
        (real[RATIO], real[RATIO + 1], real[RATIO + 2]),
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
        if model in (PHONG, PBR):
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
def gather_many(samples, weights, run, stands_in, colors, normal, point):
    """Interpolate along a run whose weights are known; the colours alone if something stands in."""
    start, stop = run
    second, third = weights[0, start:stop], weights[1, start:stop]
    write_colors(
        samples[lit.RED, start:stop], samples[lit.GREEN, start:stop],
        samples[lit.BLUE, start:stop], second, third, colors,
    )  # fmt: skip
    if not stands_in:
        gather_places(samples, run, second, third, normal, point)


@stage
def back_is_seen(a, b, c, owner, geometry, placement, lighting):
    """Return whether the back of a face is seen; it makes no difference where there is no light."""
    if lighting is None:
        return False
    return seen_from_behind(a, b, c, owner, geometry, placement)


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
    a, b, c = put_corners(face, geometry, whole, real)
    model = np.int64(surface.materials[owner, MATERIAL_MODEL])
    behind = back_is_seen(a, b, c, owner, geometry, placement, lighting)
    whole[OWNER], whole[BEHIND] = owner, behind
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
    side = 1.0 - 2.0 * np.float64(whole[BEHIND])
    matrix = matrix_of(placement.relative_from_model, whole[OWNER])
    first, second, third = (
        three_at(real, POINT),
        three_at(real, POINT + 3),
        three_at(real, POINT + 6),
    )
    return (normals, turn, side), (first, second, third, matrix)


@stage
def note_run(
    places, weights, run, column, row, corners, owner, behind, whole, real, samples, geometry,
    surface,
):  # fmt: skip
    """Note what it takes to texture a run; nothing if there are no textures."""
    if places is None:
        return
    a, b, c = corners
    note_textured(places, run, weights, a, b, c, behind, owner, samples, surface)
    texture_places.note_run(
        places, weights, run, column, row, corners, owner, whole[IS_CLIPPED] != 0,
        row_start(whole, real, column, row), surface.textures, geometry,
    )  # fmt: skip


@stage
def gather_run(
    samples, weights, places, n, count, column, row, whole, real, geometry, placement,
    surface, lighting,
):  # fmt: skip
    """Interpolate everything that shading needs along one run of a face that is set up."""
    run, owner = (n, n + count), whole[OWNER]
    model = np.int64(surface.materials[owner, MATERIAL_MODEL])
    colors = colors_at(real)
    normal, point = places_at(whole, real, placement, lighting)
    write_answers(samples, run, model, owner, surface, lighting)
    doubtful = whole[IS_CLIPPED]
    if not doubtful:
        doubtful = weights_along_run(
            weights[0, n : n + count], weights[1, n : n + count],
            row_start(whole, real, column, row), geometry.viewport.reach, geometry.w,
        )  # fmt: skip
    a, b, c = whole[CORNERS], whole[CORNERS + 1], whole[CORNERS + 2]
    if doubtful:
        for i in range(count):
            exact = sample_weights(a, b, c, column + i, row, geometry)
            weights[0, n + i], weights[1, n + i] = exact[1], exact[2]
    stands_in = stand_in_places(samples, run, model, surface.lit_vertices, lighting)
    gather_many(samples, weights, run, stands_in, colors, normal, point)
    behind = whole[BEHIND] != 0
    note_run(
        places, weights, run, column, row, (a, b, c), owner, behind, whole, real, samples, geometry,
        surface,
    )  # fmt: skip


@stage
def differences(faces, face):
    """Return 0 if some samples all show one face."""
    found = np.int32(0)
    for i in range(faces.shape[0]):
        found |= np.int32(faces[i] ^ face)
    return found


@stage
def run_end(faces, column):
    """Return the first column that shows another face than this one."""
    end, face = column + 1, faces[np.uintp(column)]
    size = faces.shape[0]
    while end < size and faces[np.uintp(end)] == face:
        end += 1
        if end - column >= LANES:
            while end + LANES <= size and differences(faces[end : end + LANES], face) == 0:
                end += LANES
    return end
