"""Grids of voxels: the faces between full and empty ones."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.io.binvox import list_voxel_faces
from rasterjit.io.load_warnings import MeshFileError


def save(path, full, head="translate 0 0 0\nscale 1\n"):
    """Write voxels, (X, Y, Z): each as a run of its own, y fastest, then z, then x."""
    x, y, z = full.shape
    pairs = b"".join(bytes([int(value), 1]) for value in full.transpose(0, 2, 1).ravel())
    path.write_bytes(f"#binvox 1\ndim {x} {z} {y}\n{head}data\n".encode() + pairs)
    return path


def slow_sides(full):
    """Return the sides of full voxels beside empty ones: voxel and direction."""
    found = set()
    for place in itertools.product(*map(range, full.shape)):
        for axis, step in itertools.product(range(3), (-1, 1)):
            beside = list(place)
            beside[axis] += step
            inside = 0 <= beside[axis] < full.shape[axis]
            if full[place] and not (inside and full[tuple(beside)]):
                found.add((*place, axis, step))
    return found


def test_the_faces_are_the_sides_beside_empty_voxels_and_look_out():
    full = np.random.default_rng(5).random((3, 4, 5)) < 0.6
    corners, faces = list_voxel_faces(full)
    a, b, c = corners[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    assert (np.abs(normals).sum(axis=1) == 1).all()
    centres = corners.reshape(-1, 4, 3).mean(axis=1)
    found = set()
    for centre, normal in zip(centres, normals[::2], strict=True):
        axis = int(np.abs(normal).argmax())
        voxel = np.floor(centre - 0.5 * normal).astype(int)
        found.add((*voxel.tolist(), axis, int(normal[axis])))
    assert found == slow_sides(full)
    assert len(found) == len(centres)
    assert (normals[::2] == normals[1::2]).all()


def test_a_file_is_placed_as_its_header_says(tmp_path):
    full = np.zeros((4, 2, 3), bool)
    full[3, 1, 0] = True
    scene = rj.load(save(tmp_path / "a.binvox", full, "translate 10 20 30\nscale 8\n"))
    low, high = scene.nodes[0].mesh.bounds()
    assert low.tolist() == [16.0, 22.0, 30.0]
    assert high.tolist() == [18.0, 24.0, 32.0]
    assert len(scene.nodes[0].mesh.faces) == 12


def test_runs_are_put_one_after_the_other(tmp_path):
    path = tmp_path / "A.BINVOX"
    path.write_bytes(b"#binvox 1\n\ndim 10 10 10\ndata\n" + bytes([0, 255, 1, 200, 0, 255, 0, 255])
                     + bytes([1, 35]))  # fmt: skip
    corners, _ = list_voxel_faces(np.array([0] * 255 + [1] * 200 + [0] * 510 + [1] * 35, bool)
                             .reshape(10, 10, 10).transpose(0, 2, 1))  # fmt: skip
    bounds = rj.load(path).nodes[0].mesh.bounds()
    np.testing.assert_allclose(bounds[0], corners.min(axis=0) / 10)
    np.testing.assert_allclose(bounds[1], corners.max(axis=0) / 10)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"\n", "does not begin with #binvox"),
        (b"voxels\ndim 1 1 1\ndata\n\1\1", "does not begin with #binvox"),
        (b"#binvox 1\ndim 1 1 1\n", "ends without the word data"),
        (b"#binvox 1\ndata\n\1\1", "dim must be 3 numbers, got ''"),
        (b"#binvox 1\ndim 1 x 1\ndata\n\1\1", "dim must be 3 numbers, got '1 x 1'"),
        (b"#binvox 1\ndim 1 1 0\ndata\n", r"dim must be three whole numbers in 1\.\."),
        (b"#binvox 1\ndim 1 1 9999999\ndata\n\1\1", r"dim must be three whole numbers in 1\.\."),
        (b"#binvox 1\ndim 1 1 1\nscale 0\ndata\n\1\1", r"scale must be above 0, got 0\.0"),
        (b"#binvox 1\ndim 1 1 1\ntranslate 0 nan 0\ndata\n\1\1", "translate must be 3 numbers"),
        (b"#binvox 1\ndim 9 9 9\ndata\n\1\2", "dim says 729 voxels, but the file holds 2"),
        (b"#binvox 1\ndim 1 1 1\ndata\n\1\1\1", "dim says 1 voxels"),
        (b"#binvox 1\ndim 1 1 1\ndata\n\0\1", "no full one, so no faces"),
    ],
)
def test_what_is_damaged_is_refused_with_this_reason(tmp_path, content, reason):
    path = tmp_path / "a.binvox"
    path.write_bytes(content)
    with pytest.raises(MeshFileError, match=rf"a\.binvox.*{reason}"):
        rj.load(path)
