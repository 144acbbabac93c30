"""
Read ``.binvox`` files: a grid of voxels becomes the faces between full and empty ones.

References
----------
.. [1] P. Min, "binvox 3D mesh voxelizer: the .binvox file format", version 1.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
from rasterjit.io.resources import LONGEST_NAME, Resources
from rasterjit.scene.memory_limits import MemoryBudget
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import Scene

_LONGEST_HEADER = 1 << 16
"""Bytes among which the word ``data`` has to stand."""

_LONGEST_SIDE = 4096
"""Most voxels along an axis."""

_VOXEL_BYTES, _SIDE_BYTES = 5, 1500
"""What a voxel takes, and what its side does as two faces of a mesh."""

_KNOWN = {"#binvox", "dim", "translate", "scale"}
"""Lines of the head that are read."""

_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
"""Of a square, counter-clockwise, along the two axes after the one that it is square to."""


def load_binvox(path: Path, resources: Resources, left_out: LeftOut) -> Scene:
    """
    Read a ``.binvox`` file.

    Returns
    -------
    Scene
        One mesh of two triangles for each side of a full voxel that no other full one touches,
        outside to the front, in the coordinates that ``translate`` and ``scale`` of the file say.

    Raises
    ------
    MeshFileError
        If the file cannot be read or has no full voxel.
    """
    try:
        content = resources.read_itself(path)
        full, scale, translate = read_voxels(content, resources.budget, left_out)
        resources.budget.take("the sides of its voxels", count_sides(full) * _SIDE_BYTES)
    except (OSError, ValueError) as error:
        raise MeshFileError(f"{path} could not be read as .binvox: {reason_of(error)}") from error
    if not full.any():
        raise MeshFileError(f"{path} holds {full.size} voxels, no full one, so no faces")
    corners, faces = voxel_faces(full)
    scene = Scene()
    try:
        # All axes have the scale of the longest: that of the file is the side of the whole grid.
        mesh = Mesh(corners * (scale / max(full.shape)) + translate, faces).split_creases(0.0)
        scene.add(mesh, name=path.name)
    except ValueError as error:
        raise MeshFileError(f"{path}: {error}") from error
    return scene


def read_voxels(
    content: bytes, budget: MemoryBudget, left_out: LeftOut
) -> tuple[NDArray[np.bool_], float, NDArray[np.float64]]:
    """
    Return which voxels of a file are full, the side of the grid, and where it begins.

    Returns
    -------
    full : (X, Y, Z) bool
    scale : float
    translate : (3,) float64

    Raises
    ------
    ValueError
        If the header is none of binvox, or the voxels are fewer or more than it says.
    """
    words, start = _header(content)
    for key in words.keys() - _KNOWN:
        left_out.note(f"line {key[:LONGEST_NAME]!r} of its head")
    shape = _numbers(words, "dim", 3, None)
    if any(side != int(side) or not 1 <= side <= _LONGEST_SIDE for side in shape):
        raise ValueError(f"dim must be three whole numbers in 1..{_LONGEST_SIDE}, got {shape}")
    depth, height, width = map(int, shape)
    translate = np.array(_numbers(words, "translate", 3, [0.0, 0.0, 0.0]))
    (scale,) = _numbers(words, "scale", 1, [1.0])
    if not scale > 0.0:
        raise ValueError(f"scale must be above 0, got {scale!r}")
    pairs = np.frombuffer(content, np.uint8, offset=start)
    values, counts = pairs[0 : len(pairs) // 2 * 2 : 2], pairs[1::2]
    total, expected = int(counts.sum(dtype=np.int64)), depth * height * width
    if total != expected or len(pairs) % 2:
        raise ValueError(f"dim says {expected} voxels, but the file holds {total}")
    budget.take(f"a grid of {expected} voxels", expected * _VOXEL_BYTES)
    # y runs fastest, then z, then x.
    full = np.repeat(values != 0, counts).reshape(depth, height, width)
    return full.transpose(0, 2, 1), scale, translate


def _header(content: bytes) -> tuple[dict[str, list[str]], int]:
    """Return the words behind each key of the header, and where the voxels begin."""
    words: dict[str, list[str]] = {}
    at = 0
    while at < min(len(content), _LONGEST_HEADER):
        end = content.find(b"\n", at)
        line = content[at : end if end >= 0 else len(content)].decode("latin-1").split()
        if at == 0 and line[:1] != ["#binvox"]:
            raise ValueError("it does not begin with #binvox")
        at = end + 1 if end >= 0 else len(content)
        if line[:1] == ["data"]:
            return words, at
        if line:
            words[line[0]] = line[1:]
    raise ValueError("its header ends without the word data")


def _numbers(
    words: dict[str, list[str]], key: str, count: int, default: list[float] | None
) -> list[float]:
    """Return the finite numbers behind a key, or raise ``ValueError``."""
    if key not in words and default is not None:
        return default
    said = words.get(key, [])
    try:
        numbers = [float(word) for word in said]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(f"{key} must be {count} numbers, got {' '.join(said)[:80]!r}")
    return numbers


def count_sides(full: NDArray[np.bool_]) -> int:
    """Return the number of sides of full voxels that no other full one touches."""
    # A row of full voxels has two ends, so there are as many upper sides as lower ones.
    return 2 * sum(int(np.count_nonzero(_open_sides(full, axis, True))) for axis in range(3))


def _open_sides(full: NDArray[np.bool_], axis: int, is_upper: bool) -> NDArray[np.bool_]:
    """Tell of each voxel, (X, Y, Z), whether it is full and the next one along an axis is not."""
    beside = np.zeros_like(full)
    inner, outer = [slice(None)] * 3, [slice(None)] * 3
    inner[axis], outer[axis] = slice(0, -1), slice(1, None)
    if is_upper:
        beside[tuple(inner)] = full[tuple(outer)]
    else:
        beside[tuple(outer)] = full[tuple(inner)]
    return full & ~beside


def voxel_faces(full: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Return the sides of full voxels that no other full one touches, outside to the front.

    Parameters
    ----------
    full : (X, Y, Z) bool

    Returns
    -------
    corners : (4 N, 3) int64
        Of N squares, in voxels; voxel (0, 0, 0) reaches from 0 to 1.
    faces : (2 N, 3) int64
    """
    squares = []
    for axis in range(3):
        across, up = (axis + 1) % 3, (axis + 2) % 3
        for is_upper in (False, True):
            at = np.argwhere(_open_sides(full, axis, is_upper))
            square = np.repeat(at[:, np.newaxis], 4, axis=1)
            steps = _CORNERS if is_upper else _CORNERS[::-1]
            square[:, :, across] += steps[:, 0]
            square[:, :, up] += steps[:, 1]
            square[:, :, axis] += is_upper
            squares.append(square)
    corners = np.concatenate(squares).reshape(-1, 3)
    first = np.arange(0, len(corners), 4)[:, np.newaxis]
    faces = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    return corners, faces
