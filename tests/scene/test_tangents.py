"""Tangents lie where u grows, whatever the picture does; degenerate faces have none."""

from __future__ import annotations

import naive_materials
import numpy as np
import pytest

from rasterjit.scene.mesh import Mesh
from rasterjit.scene.normals import vertex_tangents


def test_the_tangents_of_a_triangle_are_those_of_the_map_from_the_picture():
    rng = np.random.default_rng(1)
    for _ in range(50):
        corners, uv = rng.normal(size=(3, 3)), rng.normal(size=(3, 2)).astype(np.float32)
        along_u, along_v = naive_materials.tangent_frame(
            corners.tolist(), uv.astype(float).tolist()
        )
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        have = vertex_tangents(corners, np.array([[0, 1, 2]], np.int32), uv, 1.0)
        left = np.cross(normal, along_u) @ along_v > 0.0
        group = 0 if left else 1
        want = along_u / np.linalg.norm(along_u)
        assert have[:, group, :3] == pytest.approx(np.tile(want, (3, 1)), abs=1e-5)
        assert (have[:, 1 - group, :3] == 0.0).all()
        assert (have[:, 0, 3] == 1.0).all()
        assert (have[:, 1, 3] == -1.0).all()


def test_vertices_take_the_mean_by_area():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 3]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    uv = np.array([[0, 0], [1, 0], [0, 1], [1, 0.0]], np.float32)
    uv[3] = [-1, 0]
    have = vertex_tangents(vertices, faces, uv, 1.0)
    # The second face is three times as large, and u grows away from its third corner.
    want = np.array([1, 0, -3]) / np.sqrt(10.0)
    assert have[0, 0, :3] == pytest.approx(want, abs=1e-6)
    assert have[1, 0, :3].tolist() == [1, 0, 0]


@pytest.mark.parametrize("scale", [1e-300, 1e-6, 1.0, 1e6, 1e300])
def test_size_changes_nothing(scale):
    mesh = Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) * scale, [[0, 1, 2]],
        uv=[[0, 0], [1, 0], [0, 1]],
    )  # fmt: skip
    assert mesh.vertex_tangents()[:, 0].tolist() == [[1, 0, 0, 1]] * 3


def test_what_has_no_area_has_no_tangent_and_no_nan():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [np.nan, 0, 0], [2, 0, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]], np.int32)
    for uv in (np.zeros((5, 2)), np.column_stack([np.arange(5), np.arange(5)])):
        have = vertex_tangents(vertices, faces, uv.astype(np.float32), 1.0)
        assert (have[..., :3] == 0.0).all()
    uv = np.array([[0, 0], [1, 0], [0, 1], [5, 5], [0, 3]], np.float32)
    have = vertex_tangents(vertices, faces, uv, 1.0)
    assert np.isfinite(have).all()
    assert have[0, 0, :3].tolist() == [1, 0, 0]


def test_a_transform_of_the_picture_turns_the_tangents():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    faces, uv = np.array([[0, 1, 2]], np.int32), vertices[:, :2].astype(np.float32)
    turned = vertex_tangents(vertices, faces, uv, 1.0, (0.0, -1.0, 0.3, 1.0, 0.0, 0.2))
    assert turned[0, 0] == pytest.approx([0, -1, 0, 1])
    mirrored = vertex_tangents(vertices, faces, uv, 1.0, (-1.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    assert mirrored[0, 0] == pytest.approx([-1, 0, 0, -1])


def test_given_tangents_are_unit_and_of_both_groups():
    mesh = Mesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]],
        tangents=[[0, 0, 5, -3], [0, 0, 0, 1], [1e-300, 0, 0, 0]],
    )  # fmt: skip
    assert mesh.tangents.tolist() == [[0, 0, 1, -1], [0, 0, 0, 1], [1, 0, 0, 1]]
    assert np.array_equal(mesh.vertex_tangents()[:, 0], mesh.tangents)
    assert np.array_equal(mesh.vertex_tangents()[:, 1], mesh.tangents)
    assert not mesh.tangents.flags.writeable


def test_splitting_creases_keeps_tangents_with_their_vertices():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 1]], float)
    tangents = np.column_stack([np.eye(4)[:, :3], [1, 1, -1, -1]])
    mesh = Mesh(vertices, [[0, 1, 2], [1, 0, 3]], tangents=tangents)
    split = mesh.split_creases(10.0)
    assert len(split.vertices) > 4
    for vertex, tangent in zip(split.vertices, split.tangents, strict=True):
        (old,) = np.flatnonzero((vertices == vertex).all(axis=1))
        assert tangent.tolist() == mesh.tangents[old].tolist()


@pytest.mark.parametrize(
    ("tangents", "message"),
    [
        ([[1, 0, 0]] * 3, r"tangents must have shape \(3, 4\)"),
        ([[1, 0, 0, 1]] * 2, r"tangents must have shape \(3, 4\)"),
        ([[np.nan, 0, 0, 1]] * 3, "tangents must be finite, got 3 rows"),
    ],
)
def test_bad_tangents_are_refused_by_name(tangents, message):
    with pytest.raises(ValueError, match=message):
        Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], tangents=tangents)


def test_a_mesh_with_neither_uv_nor_tangents_has_none():
    with pytest.raises(ValueError, match="mesh must have uv or tangents"):
        Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).vertex_tangents()
