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
from rasterjit.io.resources import MAX_NAME_LENGTH, Resources
from rasterjit.scene.memory_limits import MemoryBudget
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import Scene

_MAX_HEADER_BYTES = 1 << 16
"""The word ``data`` must come within so many bytes."""

_MAX_SIDE = 4096
"""Most voxels along an axis of the grid."""

_MEMORY_PER_VOXEL, _MEMORY_PER_FACE = 5, 1500
"""Memory of a voxel, and of one of its faces as two triangles of a mesh."""

_HEADER_KEYS = {"#binvox", "dim", "translate", "scale"}
"""Keys of the header lines that are read."""

_SQUARE_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
"""Corners of a square, counter-clockwise, along the two axes after that of its normal."""


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
        content = resources.read_mesh_file(path)
        filled, scale, translate = read_voxels(content, resources.budget, left_out)
        resources.budget.take(
            "the sides of its voxels", count_exposed_faces(filled) * _MEMORY_PER_FACE
        )
    except (OSError, ValueError) as error:
        raise MeshFileError(f"{path} could not be read as .binvox: {reason_of(error)}") from error
    if not filled.any():
        raise MeshFileError(f"{path} holds {filled.size} voxels, no full one, so no faces")
    corners, faces = list_voxel_faces(filled)
    scene = Scene()
    try:
        # All axes have the scale of the longest: that of the file is the side of the whole grid.
        mesh = Mesh(corners * (scale / max(filled.shape)) + translate, faces).split_creases(0.0)
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
    filled : (X, Y, Z) bool
    scale : float
    translate : (3,) float64

    Raises
    ------
    ValueError
        If the header is none of binvox, or the voxels are fewer or more than it says.
    """
    words, start = _read_header(content)
    for key in words.keys() - _HEADER_KEYS:
        left_out.note(f"line {key[:MAX_NAME_LENGTH]!r} of its head")
    shape = _parse_numbers(words, "dim", 3, None)
    if any(side != int(side) or not 1 <= side <= _MAX_SIDE for side in shape):
        raise ValueError(f"dim must be three whole numbers in 1..{_MAX_SIDE}, got {shape}")
    depth, height, width = map(int, shape)
    translate = np.array(_parse_numbers(words, "translate", 3, [0.0, 0.0, 0.0]))
    (scale,) = _parse_numbers(words, "scale", 1, [1.0])
    if not scale > 0.0:
        raise ValueError(f"scale must be above 0, got {scale!r}")
    pairs = np.frombuffer(content, np.uint8, offset=start)
    values, counts = pairs[0 : len(pairs) // 2 * 2 : 2], pairs[1::2]
    total, expected = int(counts.sum(dtype=np.int64)), depth * height * width
    if total != expected or len(pairs) % 2:
        raise ValueError(f"dim says {expected} voxels, but the file holds {total}")
    budget.take(f"a grid of {expected} voxels", expected * _MEMORY_PER_VOXEL)
    # y runs fastest, then z, then x.
    filled = np.repeat(values != 0, counts).reshape(depth, height, width)
    return filled.transpose(0, 2, 1), scale, translate


def _read_header(content: bytes) -> tuple[dict[str, list[str]], int]:
    """Return the words after each key of the header, and where the voxels begin."""
    words: dict[str, list[str]] = {}
    at = 0
    while at < min(len(content), _MAX_HEADER_BYTES):
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


def _parse_numbers(
    words: dict[str, list[str]], key: str, count: int, default: list[float] | None
) -> list[float]:
    """Return the finite numbers after a key, or raise ``ValueError``."""
    if key not in words and default is not None:
        return default
    values = words.get(key, [])
    try:
        numbers = [float(word) for word in values]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(f"{key} must be {count} numbers, got {' '.join(values)[:80]!r}")
    return numbers


def count_exposed_faces(filled: NDArray[np.bool_]) -> int:
    """Count the faces of filled voxels towards empty ones."""
    # A row of full voxels has two ends, so there are as many upper sides as lower ones.
    return 2 * sum(
        int(np.count_nonzero(_mark_exposed_faces(filled, axis, True))) for axis in range(3)
    )


def _mark_exposed_faces(filled: NDArray[np.bool_], axis: int, is_upper: bool) -> NDArray[np.bool_]:
    """Mark the filled voxels, (X, Y, Z), whose neighbour along an axis is empty."""
    next_filled = np.zeros_like(filled)
    inner, outer = [slice(None)] * 3, [slice(None)] * 3
    inner[axis], outer[axis] = slice(0, -1), slice(1, None)
    if is_upper:
        next_filled[tuple(inner)] = filled[tuple(outer)]
    else:
        next_filled[tuple(outer)] = filled[tuple(inner)]
    return filled & ~next_filled


def list_voxel_faces(filled: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Return the faces of filled voxels towards empty ones as triangles, outside to the front.

    Parameters
    ----------
    filled : (X, Y, Z) bool

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
            at = np.argwhere(_mark_exposed_faces(filled, axis, is_upper))
            square = np.repeat(at[:, np.newaxis], 4, axis=1)
            steps = _SQUARE_CORNERS if is_upper else _SQUARE_CORNERS[::-1]
            square[:, :, across] += steps[:, 0]
            square[:, :, up] += steps[:, 1]
            square[:, :, axis] += is_upper
            squares.append(square)
    corners = np.concatenate(squares).reshape(-1, 3)
    first = np.arange(0, len(corners), 4)[:, np.newaxis]
    faces = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    return corners, faces
