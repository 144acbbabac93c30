"""Parts of meshes for the tests of a cluster."""

from __future__ import annotations

import numpy as np


def blob(seed, count=60, at=(0.0, 0.0, 0.0)):
    """Return triangles in all directions, as vertices and faces."""
    random = np.random.default_rng(seed)
    middles = random.uniform(-1.0, 1.0, (count, 1, 3)) + at
    vertices = (middles + random.uniform(-0.3, 0.3, (count, 3, 3))).reshape(-1, 3)
    return vertices, np.arange(3 * count).reshape(-1, 3)


def joined(pairs):
    """Return the vertices and the faces of several parts together."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in pairs)])
    faces = [own + first for (_, own), first in zip(pairs, starts[:-1], strict=True)]
    return np.concatenate([vertices for vertices, _ in pairs]), np.concatenate(faces)
