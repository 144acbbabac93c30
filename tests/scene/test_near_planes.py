"""Near planes that are too small for a far plane or for a depth format are refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene import transforms

FARTHEST = 7.0


def square(distance):
    """Return a scene of a square across the view."""
    corners = [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]]
    scene = rj.Scene()
    scene.add(rj.Mesh(np.multiply(corners, distance), [[0, 1, 2], [0, 2, 3]]))
    return scene


def depth_of(scene, near, far=math.inf, name="float32-reversed"):
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), near=near, far=far)
    quality = rj.Quality(depth_format=name)
    frame = rj.render(scene, camera, size=(2, 2), quality=quality, outputs=("depth",), threads=1)
    return frame.depth


MAKERS = {
    "perspective": lambda near, far: rj.PerspectiveCamera(
        (0, 0, 0), (0, 0, -1), near=near, far=far
    ),
    "intrinsics": lambda near, far: rj.MatrixCamera.from_intrinsics(
        9, 9, 4, 4, (8, 8), near=near, far=far
    ),
    "matrix": lambda near, far: transforms.perspective(45.0, 1.0, near, far),
}


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_a_near_plane_too_small_for_the_far_one_is_refused_with_the_least(make):
    with pytest.raises(ValueError, match=r"^near must be .* far = 7\.0.*, got 7e-15$") as said:
        make(7e-15, FARTHEST)
    least = float(re.search("at least ([^ ]+) for", str(said.value))[1])
    make(least, FARTHEST)
    make(7e-15, math.inf)


def test_the_least_near_plane_still_finds_the_far_one():
    near = transforms.LEAST_NEAR * FARTHEST
    assert np.isfinite(depth_of(square(FARTHEST * 0.999), near, FARTHEST)).all()
    assert np.isinf(depth_of(square(FARTHEST * 1.001), near, FARTHEST)).all()


@pytest.mark.parametrize(
    ("name", "near"),
    [("float32-reversed", 1e-44), ("float32-reversed", 1e-46), ("float64", 1e-308)],
)
@pytest.mark.parametrize("distance", [1.0, 1000.0])
def test_a_near_plane_that_a_format_cannot_hold_is_refused_with_the_least(name, near, distance):
    scene = square(distance)
    with pytest.raises(ValueError, match=rf"^camera\.near .*{name}.* got {near!r}$") as said:
        depth_of(scene, near, name=name)
    least = float(re.search("at least ([^ ]+) for", str(said.value))[1])
    found = depth_of(scene, least, name=name)
    np.testing.assert_allclose(found, distance, rtol=2.0**-22)


def test_a_tiny_near_plane_is_taken_for_what_is_tiny():
    assert np.isfinite(depth_of(square(1e-20), 1e-40 * 1e3)).all()
