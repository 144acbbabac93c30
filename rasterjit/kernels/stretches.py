"""
Gather a stretch of a row whose neighbours show different faces of one object.

Nothing is set up: the stretch is cut into patches of a few samples that show one face, and what the
vertices of their faces hold is gathered, for every sample anew. Gathering does nothing else, so
that the CPU waits for many vertices at once; the arithmetic is done for several samples at once,
each with a face of its own.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels.attributes import (
    material_tint,
    normal_at,
    note_textured,
    point_at,
    stand_in_places,
    write_answers,
)
from rasterjit.kernels.interpolation import (
    held_edges,
    interpolate,
    matrix_of,
    normal_of_points,
    place,
    ratios_at,
    seen_from_behind,
    shifted_weights,
    weights_from_edges,
)
from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.patches import (
    AX,
    AY,
    BEHIND,
    BX,
    BY,
    COLUMN,
    CX,
    CY,
    FIRST,
    ROW,
    UNSURE,
    A,
    B,
    C,
    gather_codes,
    gather_corners,
    gather_light,
    gather_screen,
    gather_values,
    list_patches,
    number_pixels,
    turn_corners,
    whole_vectors,
)
from rasterjit.kernels.records import FLAT, GOURAUD, MATERIAL_MODEL, PBR, PHONG
from rasterjit.kernels.setup import narrow_edge
from rasterjit.kernels.texture_places import note_stretch


@disjoint_stage
def weigh(
    ax, ay, bx, by, cx, cy, wa, wb, wc, columns, rows, shift, count, bits, reach, w, unsure, second,
    third,
):  # fmt: skip
    """
    Write the weights of ``count`` samples, each of a face of its own.

    Takes their pixels, and their way from there to the pixels' centres on the sub-pixel grid.
    Return whether any of them takes another way: its face was clipped, or its weights are doubtful.
    """
    half, found = np.int32(1) << (bits - 1), np.int32(0)
    for n in range(ax.shape[0]):
        px = np.int32((columns[n] << bits) + half - shift[0])
        py = np.int32((rows[n] << bits) + half - shift[1])
        edges = (
            narrow_edge(bx[n], by[n], cx[n], cy[n], px, py),
            narrow_edge(cx[n], cy[n], ax[n], ay[n], px, py),
            narrow_edge(ax[n], ay[n], bx[n], by[n], px, py),
        )
        right = by[n] - cy[n], cy[n] - ay[n], ay[n] - by[n]
        down = cx[n] - bx[n], ax[n] - cx[n], bx[n] - ax[n]
        edges = held_edges(edges, right, down, reach)
        ratios = ratios_at(wa, wb, wc, n, w)
        second[n], third[n], doubtful = weights_from_edges(*edges, ratios, w)
        unsure[n] |= np.int32(doubtful)
        found |= unsure[n] if n < count else np.int32(0)
    return found


@disjoint_stage
def find_sides(ax, ay, bx, by, cx, cy, front_turn, behind):
    """Write whether the back of each face is seen, by its turn on the screen."""
    for n in range(ax.shape[0]):
        turn = narrow_edge(ax[n], ay[n], bx[n], by[n], cx[n], cy[n])
        behind[n] = np.int32(np.float64(turn) * front_turn < 0.0)


@stage
def note_sides(size, owner, whole, placement, lighting):
    """Note whose back is seen; it makes no difference where there is no light."""
    if lighting is None:
        return
    find_sides(
        whole[AX, :size], whole[AY, :size], whole[BX, :size], whole[BY, :size], whole[CX, :size],
        whole[CY, :size], placement.front_turns[owner], whole[BEHIND, :size],
    )  # fmt: skip


@stage
def note_side(i, a, b, c, owner, whole, geometry, placement, lighting):
    """Note whether the back of one face is seen, clipped or not."""
    if lighting is None:
        return
    whole[BEHIND, i] = seen_from_behind(a, b, c, owner, geometry, placement)


@stage
def weigh_exactly(
    weights, start, patches, shift, owner, whole, geometry, placement, lighting
):  # fmt: skip
    """Write the weights, and the side seen, of the samples that `weigh` can not tell."""
    for r in range(patches):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        for i in range(whole[FIRST, r], whole[FIRST, r + np.uintp(1)]):
            if whole[UNSURE, i] != 0:
                exact = shifted_weights(a, b, c, whole[COLUMN, i], whole[ROW, i], shift, geometry)
                weights[0, start + i], weights[1, start + i] = exact[1], exact[2]
                note_side(i, a, b, c, owner, whole, geometry, placement, lighting)


@disjoint_stage
def fill_three(first, second, third, values):
    """Fill three rows with a value each."""
    for n in range(first.shape[0]):
        first[n], second[n], third[n] = values


@stage
def start_tints(samples, run, faces, tint, face_colors):
    """Write the tint of each sample: the object's, times the face's colour if there is one."""
    start, stop = run
    fill_three(
        samples[lit.RED, start:stop], samples[lit.GREEN, start:stop],
        samples[lit.BLUE, start:stop], tint,
    )  # fmt: skip
    if face_colors is None:
        return
    for i in range(np.uintp(faces.shape[0])):
        for k in range(3):
            samples[lit.RED + k, np.uintp(start) + i] *= face_colors[np.uintp(faces[i]), k]


@disjoint_stage
def multiply_colors(
    red, green, blue, ra, ga, ba, rb, gb, bb, rc, gc, bc, second, third
):  # fmt: skip
    """Multiply colours by those of the vertices, interpolated."""
    for n in range(red.shape[0]):
        weights = (0.0, second[n], third[n])
        r = interpolate(weights, np.float64(ra[n]), np.float64(rb[n]), np.float64(rc[n]))
        g = interpolate(weights, np.float64(ga[n]), np.float64(gb[n]), np.float64(gc[n]))
        b = interpolate(weights, np.float64(ba[n]), np.float64(bb[n]), np.float64(bc[n]))
        red[n] *= np.float32(r)
        green[n] *= np.float32(g)
        blue[n] *= np.float32(b)


@stage
def apply_colors(samples, run, weights, rows):
    """Multiply tints by the colours that were gathered."""
    start, stop = run
    size = stop - start
    multiply_colors(
        samples[lit.RED, start:stop], samples[lit.GREEN, start:stop],
        samples[lit.BLUE, start:stop], rows[0, :size], rows[1, :size], rows[2, :size],
        rows[3, :size], rows[4, :size], rows[5, :size], rows[6, :size], rows[7, :size],
        rows[8, :size], weights[0, start:stop], weights[1, start:stop],
    )  # fmt: skip


@stage
def gather_light_colors(samples, run, weights, patches, faces, model, whole, single, lit_vertices):
    """Write the light on the vertices of an object shaded by Gouraud; return whether it is."""
    if lit_vertices is None:
        return False
    if model != GOURAUD:
        return False
    one = np.float32(1.0)
    start_tints(samples, run, faces, (one, one, one), None)
    gather_light(patches, lit_vertices, whole, single)
    apply_colors(samples, run, weights, single)
    return True


@stage
def gather_vertex_colors(samples, run, weights, patches, whole, single, vertex_colors):
    """Multiply the tints by the colours of vertices, if they have any."""
    if vertex_colors is None:
        return
    gather_values(patches, vertex_colors, whole, single)
    apply_colors(samples, run, weights, single)


@stage
def gather_colors(samples, run, weights, patches, faces, owner, model, whole, single, surface):
    """Write the base colours, or the light on the vertices if the object is shaded by Gouraud."""
    is_lit = gather_light_colors(
        samples, run, weights, patches, faces, model, whole, single, surface.lit_vertices
    )
    if not is_lit:
        tint = material_tint(surface.materials, owner)
        start_tints(samples, run, faces, tint, surface.face_colors)
        gather_vertex_colors(samples, run, weights, patches, whole, single, surface.vertex_colors)


@disjoint_stage
def write_smooth_normals(
    nx, ny, nz, xa, ya, za, xb, yb, zb, xc, yc, zc, second, third, behind, turn
):  # fmt: skip
    """Write interpolated vertex normals in world axes."""
    for n in range(nx.shape[0]):
        normals = (
            (np.float64(xa[n]), np.float64(ya[n]), np.float64(za[n])),
            (np.float64(xb[n]), np.float64(yb[n]), np.float64(zb[n])),
            (np.float64(xc[n]), np.float64(yc[n]), np.float64(zc[n])),
        )
        toward = 1.0 - 2.0 * np.float64(behind[n])
        nx[n], ny[n], nz[n] = normal_at(second[n], third[n], (normals, turn, toward))


@disjoint_stage
def write_face_normals(
    nx, ny, nz, xa, ya, za, xb, yb, zb, xc, yc, zc, second, third, behind, owner, matrices, mirrored
):  # fmt: skip
    """Write the faces' own normals."""
    unit = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    for n in range(nx.shape[0]):
        own = normal_of_points(
            place(xa[n], ya[n], za[n], owner, matrices),
            place(xb[n], yb[n], zb[n], owner, matrices),
            place(xc[n], yc[n], zc[n], owner, matrices),
            mirrored,
        )
        toward = 1.0 - 2.0 * np.float64(behind[n])
        nx[n], ny[n], nz[n] = normal_at(second[n], third[n], ((own, own, own), unit, toward))


@disjoint_stage
def write_points(
    px, py, pz, xa, ya, za, xb, yb, zb, xc, yc, zc, second, third, owner, matrices, matrix
):  # fmt: skip
    """Write where the samples lie."""
    for n in range(px.shape[0]):
        point = (
            place(xa[n], ya[n], za[n], owner, matrices),
            (xb[n] - xa[n], yb[n] - ya[n], zb[n] - za[n]),
            (xc[n] - xa[n], yc[n] - ya[n], zc[n] - za[n]),
            matrix,
        )
        px[n], py[n], pz[n] = point_at(second[n], third[n], point)


@disjoint_stage
def write_middles(
    px, py, pz, xa, ya, za, xb, yb, zb, xc, yc, zc, second, third, owner, matrices, matrix
):  # fmt: skip
    """Write the middles of the faces."""
    m, share, nowhere = matrix, 1.0 / 3.0, (0.0, 0.0, 0.0)
    for n in range(px.shape[0]):
        first = place(xa[n], ya[n], za[n], owner, matrices)
        x = share * (xb[n] - xa[n]) + share * (xc[n] - xa[n])
        y = share * (yb[n] - ya[n]) + share * (yc[n] - ya[n])
        z = share * (zb[n] - za[n]) + share * (zc[n] - za[n])
        middle = (
            first[0] + (m[0] * x + m[1] * y + m[2] * z),
            first[1] + (m[3] * x + m[4] * y + m[5] * z),
            first[2] + (m[6] * x + m[7] * y + m[8] * z),
        )
        point = middle, nowhere, nowhere, matrix
        px[n], py[n], pz[n] = point_at(second[n], third[n], point)


@stage
def gather_smooth_normals(
    samples, run, weights, patches, model, owner, whole, single, placement, normals
):  # fmt: skip
    """Write the interpolated normals of an object that is smooth; return whether it is."""
    if normals is None:
        return False
    if model not in (PHONG, PBR):
        return False
    start, stop = run
    size = stop - start
    gather_values(patches, normals, whole, single)
    write_smooth_normals(
        samples[lit.NORMAL_X, start:stop], samples[lit.NORMAL_Y, start:stop],
        samples[lit.NORMAL_Z, start:stop], single[0, :size], single[1, :size], single[2, :size],
        single[3, :size], single[4, :size], single[5, :size], single[6, :size], single[7, :size],
        single[8, :size], weights[0, start:stop], weights[1, start:stop], whole[BEHIND, :size],
        matrix_of(placement.normal_matrices, owner),
    )  # fmt: skip
    return True


@stage
def gather_places(
    samples, run, weights, patches, model, owner, whole, real, single, placement, surface,
    lighting,
):  # fmt: skip
    """Write normals and positions; nothing if there is no light."""
    if lighting is None:
        return
    if stand_in_places(samples, run, model, surface.lit_vertices, lighting):
        return
    start, stop = run
    size = stop - start
    is_smooth = gather_smooth_normals(
        samples, run, weights, patches, model, owner, whole, single, placement, surface.normals
    )
    gather_values(patches, placement.positions, whole, real)
    matrices = placement.relative_from_model
    if not is_smooth:
        write_face_normals(
            samples[lit.NORMAL_X, start:stop], samples[lit.NORMAL_Y, start:stop],
            samples[lit.NORMAL_Z, start:stop], real[0, :size], real[1, :size], real[2, :size],
            real[3, :size], real[4, :size], real[5, :size], real[6, :size], real[7, :size],
            real[8, :size], weights[0, start:stop], weights[1, start:stop], whole[BEHIND, :size],
            owner, matrices, placement.mirrored[owner],
        )  # fmt: skip
    if model == FLAT:
        write_middles(
            samples[lit.POINT_X, start:stop], samples[lit.POINT_Y, start:stop],
            samples[lit.POINT_Z, start:stop], real[0, :size], real[1, :size], real[2, :size],
            real[3, :size], real[4, :size], real[5, :size], real[6, :size], real[7, :size],
            real[8, :size], weights[0, start:stop], weights[1, start:stop],
            owner, matrices, matrix_of(matrices, owner),
        )  # fmt: skip
    else:
        write_points(
            samples[lit.POINT_X, start:stop], samples[lit.POINT_Y, start:stop],
            samples[lit.POINT_Z, start:stop], real[0, :size], real[1, :size], real[2, :size],
            real[3, :size], real[4, :size], real[5, :size], real[6, :size], real[7, :size],
            real[8, :size], weights[0, start:stop], weights[1, start:stop],
            owner, matrices, matrix_of(matrices, owner),
        )  # fmt: skip


@stage
def find_weights(
    weights, run, patches, shift, owner, whole, real, geometry, placement, lighting
):  # fmt: skip
    """
    Write the weights of samples whose vertices and pixels are known.

    Takes their way to the pixels' centres on the sub-pixel grid.
    """
    start, stop = run
    size = stop - start
    gather_screen(patches, geometry, whole, real)
    gather_codes(patches, size, geometry, whole)
    unsure = weigh(
        whole[AX, :size], whole[AY, :size], whole[BX, :size], whole[BY, :size], whole[CX, :size],
        whole[CY, :size], real[0, :size], real[1, :size], real[2, :size], whole[COLUMN, :size],
        whole[ROW, :size], shift, np.int64(whole[FIRST, patches]), geometry.viewport.grid_bits,
        geometry.viewport.reach, geometry.w, whole[UNSURE, :size], weights[0, start:stop],
        weights[1, start:stop],
    )  # fmt: skip
    note_sides(size, owner, whole, placement, lighting)
    if unsure != 0:
        weigh_exactly(weights, start, patches, shift, owner, whole, geometry, placement, lighting)


@stage
def find_patches(faces, own, whole):
    """List the patches of some samples, and gather their vertices, the lowest number first."""
    patches = list_patches(faces, whole)
    gather_corners(patches, faces, own, whole)
    size = whole_vectors(patches)
    turn_corners(whole[A, :size], whole[B, :size], whole[C, :size])
    return patches


@stage
def note_patches(
    places, start, patches, weights, owner, samples, whole, surface, matt_vertices, maps
):  # fmt: skip
    """Note what else each patch takes to be textured; nothing if no effect asks for it."""
    if places is None:
        return
    if matt_vertices is None and maps is None:
        return
    for r in range(patches):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        first, end = whole[FIRST, r], whole[FIRST, r + np.uintp(1)]
        behind = whole[BEHIND, first] != 0
        note_textured(
            places, (start + first, start + end), weights, a, b, c, behind, owner, samples, surface
        )


@stage
def gather_stretch(
    faces, samples, weights, places, n, column, row, owner, whole, real, single, geometry,
    placement, surface, lighting,
):  # fmt: skip
    """Gather the samples of one object that some neighbouring columns show."""
    run = n, n + whole_vectors(faces.shape[0])
    model = np.int64(surface.materials[owner, MATERIAL_MODEL])
    size = run[1] - n
    number_pixels(whole[COLUMN, :size], whole[ROW, :size], np.int32(column), np.int32(row))
    patches = find_patches(faces, geometry.faces, whole)
    centre = np.int32(0), np.int32(0)
    find_weights(weights, run, patches, centre, owner, whole, real, geometry, placement, lighting)
    write_answers(samples, run, model, owner, surface, lighting)
    gather_colors(samples, run, weights, patches, faces, owner, model, whole, single, surface)
    # As long as the vertices' w are there.
    note_stretch(
        places, run, patches, weights, owner, whole, real, single, geometry, surface.textures,
    )  # fmt: skip
    note_patches(
        places, n, patches, weights, owner, samples, whole, surface, surface.matt_vertices,
        surface.maps,
    )  # fmt: skip
    gather_places(
        samples, run, weights, patches, model, owner, whole, real, single, placement, surface,
        lighting,
    )  # fmt: skip
