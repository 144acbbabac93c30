"""Batches of views: a scene, cameras around it, and the comparison with one render of each."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.outputs.table import MOTION_OUTPUTS, OUTPUTS
from rasterjit.runtime import jit

MODELS = Path(__file__).parents[2] / "models"
SIZE = (40, 28)
CAMERA = rj.PerspectiveCamera(eye=(0.0, 0.5, 4.0), target=(0.0, 0.0, 0.0))
ALL = tuple(name for name in OUTPUTS if name not in MOTION_OUTPUTS)
in_groups = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="needs machine code")
COUNTED = "triangles_in", "outside", "culled", "degenerate", "unsampled", "drawn", "clipped"


def around(count, distance=4.0):
    """Return cameras on a ring."""
    return [
        rj.PerspectiveCamera(
            (distance * math.cos(a), 1.0, distance * math.sin(a)), (0.1, 0.0, 0.0), fov_y=50.0
        )
        for a in np.linspace(0.0, 6.0, count).tolist()
    ]


def check(scene, cameras, transforms=None, **options):
    """Hold a batch against one render of each view, bit by bit, and return it."""
    options.setdefault("size", SIZE)
    batch = rj.render_batch(scene, cameras, transforms=transforms, **options)
    options.pop("threads", None)
    options.pop("out", None)
    sums = dict.fromkeys((*COUNTED, "pixels_covered"), 0)
    before = [node.world_from_model for node in scene.nodes]
    for n, camera in enumerate(cameras):
        if transforms is not None:
            for node, matrix in zip(scene.nodes, transforms[n], strict=True):
                node.world_from_model = matrix
        frame = rj.render(scene, camera, **options)
        for name, wanted in frame.arrays().items():
            found = batch.arrays()[name][n]
            assert found.dtype == wanted.dtype, name
            assert found.tobytes() == wanted.tobytes(), (n, name, camera)
        for name in sums:
            sums[name] += getattr(frame.stats, name)
    for node, matrix in zip(scene.nodes, before, strict=True):
        node.world_from_model = matrix
    assert {name: getattr(batch.stats, name) for name in sums} == sums
    return batch


def mixed_scene():
    """Return three objects: smooth, with colours of vertices, and with a texture."""
    made = rj.Scene()
    knot = rj.load(MODELS / "torus_knot.obj").nodes[0].mesh
    made.add(knot, rj.transforms.scale((0.4, 0.4, 0.4)))
    colors = np.random.default_rng(1).random((24, 3))
    cube = rj.load(MODELS / "cube.ply").nodes[0].mesh
    made.add(
        rj.Mesh(
            cube.vertices, cube.faces, colors=colors, material=rj.Material("unlit")
        ),
        rj.transforms.translate((1.4, 0.2, -0.3)),
    )  # fmt: skip
    texture = rj.Texture(np.random.default_rng(2).integers(0, 255, (4, 4, 3), np.uint8))
    quad = rj.Mesh(
        [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)],
        uv=[(0, 0), (1, 0), (1, 1), (0, 1)], material=rj.Material(base_color_texture=texture),
        scalars=[1, 2, 5, np.nan], contours=2,
    )  # fmt: skip
    made.add(quad, rj.transforms.translate((-1.2, 0.0, -1.0)))
    return made
