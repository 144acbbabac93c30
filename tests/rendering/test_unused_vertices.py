"""Vertices that no face uses are not taken to the screen, and change nothing."""

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.survey.packed_scene import MIN_SEARCHED_VERTICES, VERTICES_PER_BLOCK, join_geometry

OUTPUTS = "color", "linear", "depth", "face_id", "position", "normal", "barycentric"
CAMERA = rj.PerspectiveCamera(eye=(2.0, 1.5, 3.0), target=(0.0, 0.0, 0.0), near=2.9)


def among_others(mesh, before, behind):
    """The same faces, with vertices before and behind theirs that they do not use."""
    far = np.full((1, 3), 1e30)
    vertices = np.concatenate(
        [np.repeat(far, before, axis=0), mesh.vertices, np.repeat(far, behind, axis=0)]
    )
    return rj.Mesh(vertices, mesh.faces + before)


@pytest.fixture(scope="module")
def knot():
    """A mesh that the near plane cuts."""
    mesh = rj.load("models/torus_knot.obj").nodes[0].mesh
    return rj.Mesh(mesh.vertices * 0.4, mesh.faces)


def test_runs_of_unused_vertices_are_found(knot):
    count = len(knot.vertices)
    mesh = among_others(knot, 10 * VERTICES_PER_BLOCK, MIN_SEARCHED_VERTICES)
    arrays = join_geometry([knot, mesh, mesh])
    first, end = (
        10 * VERTICES_PER_BLOCK,
        10 * VERTICES_PER_BLOCK + -(-count // VERTICES_PER_BLOCK) * VERTICES_PER_BLOCK,
    )
    whole = len(mesh.vertices)
    assert arrays.unused == tuple(
        (count + number * whole + low, count + number * whole + high)
        for number in range(2)
        for low, high in ((0, first), (end, whole))
    )
    used = np.zeros(len(arrays.positions), bool)
    used[arrays.faces] = True
    assert not any(used[low:high].any() for low, high in arrays.unused)
    assert join_geometry([knot]).unused == ()


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("samples", [1, 4])
def test_unused_vertices_change_no_bit(knot, samples, threads):
    options = {
        "size": (96, 72), "outputs": OUTPUTS, "quality": rj.Quality(samples=samples),
        "threads": threads,
    }  # fmt: skip
    alone = rj.render(knot, CAMERA, **options)
    other = rj.render(
        among_others(knot, MIN_SEARCHED_VERTICES, VERTICES_PER_BLOCK + 17), CAMERA, **options
    )
    assert alone.stats.clipped > 0
    for name in OUTPUTS:
        assert getattr(alone, name).tobytes() == getattr(other, name).tobytes(), name
