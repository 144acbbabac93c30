"""Find the edges of faces that outlines follow, seen or not, and how they continue each other."""

from __future__ import annotations

import numpy as np

from rasterjit.effects.outline.stage import CREASE, OBJECT, SILHOUETTE
from rasterjit.effects.outline.tracing import find_place
from rasterjit.pipeline.geometry.barycentric import compute_face_normal, find_object
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float64, int8, int32, int64, uint8

NO_SIDE = 0
"""Side of a face that the viewer sees, where a corner of it lies nowhere; else 1 or -1."""


@helper
def find_side(face, geometry):
    """Return which side of a face the viewer sees: 1 or -1 by its winding on the screen."""
    a = find_place(geometry.faces[face, 0], geometry)
    b = find_place(geometry.faces[face, 1], geometry)
    c = find_place(geometry.faces[face, 2], geometry)
    volume = (
        a[0] * (b[1] * c[2] - c[1] * b[2])
        - a[1] * (b[0] * c[2] - c[0] * b[2])
        + a[2] * (b[0] * c[1] - c[0] * b[1])
    )
    if volume != volume:
        return NO_SIDE
    return 1 if volume >= 0.0 else -1


@kernel
def look_at_faces(
    faces: (int64, int64), geometry: Geometry, placement: Placement, sides: int8[::1],
    normals: float64[:, ::1],
):  # fmt: skip
    """
    Find which side of faces the viewer sees, and their normals.

    Parameters
    ----------
    faces : (int, int)
        The first, and one past the last.
    geometry, placement : records
    sides : (F,) int8
        Writes 1 or -1 by the winding on the screen, `NO_SIDE` if a corner lies nowhere.
    normals : (F, 3) float64
        Writes unit normals, world axes.
    """
    owner = np.int64(0)
    for face in range(faces[0], faces[1]):
        owner = find_object(face, placement.face_starts, owner)
        a, b, c = geometry.faces[face, 0], geometry.faces[face, 1], geometry.faces[face, 2]
        x, y, z = compute_face_normal(a, b, c, owner, placement)
        normals[face, 0], normals[face, 1], normals[face, 2] = x, y, z
        sides[face] = np.int8(find_side(face, geometry))


@helper
def runs_opposite(face, side, other, other_side, faces, positions):
    """Return whether two faces run along a common edge in opposite directions, as they should."""
    start, end = faces[face, side], faces[other, (other_side + 1) % 3]
    return (
        positions[start, 0] == positions[end, 0]
        and positions[start, 1] == positions[end, 1]
        and positions[start, 2] == positions[end, 2]
    )


@kernel
def list_feature_edges(
    faces: int32[:, ::1], positions: float64[:, ::1], twins: int32[:, ::1], sides: int8[::1],
    normals: float64[:, ::1], kinds: int64, min_cosine: float64, edges: int32[:, ::1],
):  # fmt: skip
    """
    List the edges at which surfaces end, turn away from the viewer, or bend.

    Parameters
    ----------
    faces : (F, 3) int32
    positions : (V, 3) float64, model space
    twins : (F, 3) int32
        As `scene.edge_twins.find_twins` returns them. -1 at all sides of what is no triangle.
    sides, normals
        From `look_at_faces`.
    kinds : int
        The kinds of edges, as bits of ``stage``.
    min_cosine : float
        Of the angle between the normals of two faces: below it is a crease.
    edges : (3 F, 2) int32
        Writes the vertices of each edge.

    Returns
    -------
    int
        Number of edges written.
    """
    count = np.int64(0)
    for face in range(faces.shape[0]):
        if faces[face, 1] == faces[face, 2]:
            # A segment or a point.
            continue
        for side in range(3):
            own, twin = 3 * face + side, np.int64(twins[face, side])
            if twin < 0:
                is_edge = kinds & (SILHOUETTE | OBJECT) != 0
            elif twin < own and np.int64(twins[twin // 3, twin % 3]) == own:
                is_edge = False
            else:
                other = twin // 3
                sign = 1 if runs_opposite(face, side, other, twin % 3, faces, positions) else -1
                cosine = sign * (
                    normals[face, 0] * normals[other, 0]
                    + normals[face, 1] * normals[other, 1]
                    + normals[face, 2] * normals[other, 2]
                )
                turns = sides[face] * sides[other] * sign < 0
                is_edge = (turns and kinds & (SILHOUETTE | OBJECT) != 0) or (
                    cosine < min_cosine and kinds & CREASE != 0
                )
            if is_edge:
                edges[count, 0], edges[count, 1] = faces[face, side], faces[face, (side + 1) % 3]
                count += 1
    return count


@kernel
def measure_chains(
    nodes: int64[:, ::1], lengths: float64[::1], starts: int64[::1], incident: int64[::1],
    distances: float64[::1], turned: uint8[::1],
):  # fmt: skip
    """
    Measure how far along a chain of lines each of them begins.

    A chain goes on where just two lines meet.

    Parameters
    ----------
    nodes : (N, 2) int64
        Numbers of the places at both ends of each line.
    lengths : (N,) float64
    starts : (K + 1,) int64
        Where the list of each place begins in ``incident``.
    incident : (2 N,) int64
        The lines at each place, ascending.
    distances : (N,) float64
        Given as -1. Writes the length of the chain up to each line.
    turned : (N,) uint8
        Writes 1 for lines whose second end comes first.
    """
    # Chains with ends, then those that are closed.
    for closed in range(2):
        for line in range(nodes.shape[0]):
            if distances[line] >= 0.0:
                continue
            place = nodes[line, 0]
            if closed == 0 and starts[place + 1] - starts[place] == 2:
                place = nodes[line, 1]
                if starts[place + 1] - starts[place] == 2:
                    continue
            this, length = line, 0.0
            while distances[this] < 0.0:
                distances[this] = length
                turned[this] = 0 if nodes[this, 0] == place else 1
                length += lengths[this]
                place = nodes[this, 1] if nodes[this, 0] == place else nodes[this, 0]
                first = starts[place]
                if starts[place + 1] - first == 2:
                    this = incident[first] if incident[first] != this else incident[first + 1]
