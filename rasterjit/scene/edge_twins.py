"""Number the edges of faces, and pair the sides that meet in one, to walk over a surface."""

from __future__ import annotations

import numpy as np

from rasterjit.scene.arrays import Float64, Int32, Int64
from rasterjit.scene.distinct_rows import distinct_rows

NO_TWIN = -1
"""In place of a side's twin where no other face has the edge."""


def edge_keys(a: Int64, b: Int64) -> Int64:
    """Return one number for each edge, (N,), of two vertices each: the lower in the upper half."""
    return np.minimum(a, b) << 32 | np.maximum(a, b)


def find_twins(vertices: Float64, faces: Int32) -> Int32:
    """
    Find the side of another face along the same edge, for each side of each face.

    Side k of a face runs from its corner k to the next. Vertices at one place are one.

    Parameters
    ----------
    vertices : (V, 3) float64
    faces : (F, 3) int32

    Returns
    -------
    (F, 3) int32
        Three times the number of the face, plus its side; `NO_TWIN` where there is none. Where more
        than two faces share an edge, their sides follow each other in a ring.
    """
    places, _ = distinct_rows(*vertices.T)
    tails, heads = places[faces].ravel(), places[np.roll(faces, -1, axis=1)].ravel()
    keys = edge_keys(tails, heads)
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1])[: len(keys)])
    # The next of the same edge; the last of them is followed by the first.
    following = np.append(order[1:], order[:1])
    lasts = np.append(starts[1:], len(keys))[: len(starts)] - 1
    following[lasts] = order[starts]
    following[starts[starts == lasts]] = NO_TWIN
    twins = np.empty(faces.size, np.int32)
    twins[order] = following
    return twins.reshape(faces.shape)
