"""Poses and intrinsic matrices of the command line: read them, and make cameras of them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.cli.values import text_type

if TYPE_CHECKING:
    from rasterjit.scene.camera import MatrixCamera
    from rasterjit.scene.scene import Scene

Float64 = NDArray[np.float64]

CONVENTIONS = {
    "opencv": "camera from world; x right, y down, z forward: OpenCV's R|t, COLMAP",
    "opencv-c2w": "world from camera with these axes: ScanNet, TUM",
    "opengl": "camera from world; x right, y up, z back: a view matrix",
    "opengl-c2w": "world from camera with these axes: NeRF, Blender, pyrender",
}
"""What a pose leads from and to, and where the camera's axes point."""

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""From the axes of OpenCV's cameras to ours, and back."""

LONGEST_SCALE = 1e-3
"""How far the columns of a rotation may be from length 1, as where they were rounded."""

MOST_BYTES = 1 << 20
"""A file of a matrix is smaller."""


@text_type("pose")
def pose_type(text: str) -> Float64:
    """Return the pose of a camera, (4, 4): rows of a 4x4 or 3x4 matrix, or a file of them."""
    wanted = "the 16 or 12 numbers of a 4x4 or 3x4 matrix, row by row"
    numbers = _matrix_numbers(text, "pose", (16, 12), wanted)
    return np.vstack([numbers.reshape(-1, 4), np.eye(4)[len(numbers) // 4 :]])


@text_type("intrinsics")
def intrinsics_type(text: str) -> Float64:
    """Return the matrix K, (3, 3), of its numbers, of FX,FY,CX,CY, or of a file of either."""
    from rasterjit.io.cameras import intrinsic_matrix

    wanted = "FX,FY,CX,CY or the 9 numbers of a 3x3 matrix K"
    numbers = _matrix_numbers(text, "intrinsics", (9, 4), wanted)
    if numbers.size == 4:
        fx, fy, cx, cy = numbers.tolist()
        numbers = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
    try:
        return intrinsic_matrix("it", numbers.reshape(3, 3))
    except ValueError as error:
        raise ValueError(f"{text!r}: {error}") from None


def _matrix_numbers(text: str, key: str, counts: tuple[int, ...], wanted: str) -> Float64:
    """Return the finite numbers of a text or a file, as many as one of some counts."""
    try:
        numbers = _numbers(text)
        if numbers is None:
            numbers = _numbers_of_file(Path(text), key)
    except (ValueError, OSError) as error:
        raise ValueError(f"{text!r} must be {wanted}, or a file of them: {error}") from None
    if numbers.size not in counts:
        raise ValueError(f"{text!r} must be {wanted}, got {numbers.size} numbers")
    if not np.isfinite(numbers).all():
        raise ValueError(f"{text!r} must be finite")
    return numbers


def pose_from_world(pose: Float64, convention: str) -> Float64:
    """
    Return OpenCV's ``camera_from_world`` of a pose, (4, 4).

    Raises
    ------
    ValueError
        If the pose is not one of a camera: it mirrors, shears or scales.
    """
    from rasterjit.io.cameras import view_from_pose
    from rasterjit.scene.transforms import compose, inverse
    from rasterjit.scene.vectors import length

    lengths = [length(column) for column in pose[:3, :3].T.tolist()]
    if any(abs(one - 1.0) > LONGEST_SCALE for one in lengths):
        raise ValueError(
            "--pose must turn and move the camera, not scale: its first three columns have lengths "
            f"{', '.join(f'{one:.6g}' for one in lengths)}"
        )
    world_from_camera = pose if convention.endswith("-c2w") else inverse(pose)
    if convention.startswith("opencv"):
        world_from_camera = compose(world_from_camera, FLIP)
    return compose(FLIP, view_from_pose(world_from_camera, "--pose"))


def intrinsics_of(fov_y: float, size: tuple[int, int]) -> Float64:
    """Return K, (3, 3), of a camera without them, as OpenCV has it; ``fov_y`` in degrees."""
    from rasterjit.scene.transforms import focal_length

    width, height = size
    focal = focal_length(fov_y) * height / 2.0
    middle = (width - 1.0) / 2.0, (height - 1.0) / 2.0
    return np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])


def camera_of(
    intrinsics: Float64, camera_from_world: Float64, size: tuple[int, int], scene: Scene
) -> MatrixCamera:
    """Return the camera of K and a pose, both as OpenCV has them, its near plane before a scene."""
    from rasterjit.io.cameras import from_opencv
    from rasterjit.scene.framing import near_plane, triple_of
    from rasterjit.scene.transforms import apply
    from rasterjit.scene.vectors import length

    center, radius = scene.bounding_sphere()
    distance = length(triple_of(apply(camera_from_world, center)))
    near = near_plane(distance, radius) or 1.0
    try:
        return from_opencv(intrinsics, size, camera_from_world=camera_from_world, near=near)
    except ValueError as error:
        said = re.sub(r"\b(intrinsics|clip_from_view)\b", "--intrinsics", str(error))
        raise ValueError(said) from error


def _numbers(text: str) -> Float64 | None:
    """Return the numbers of a text, or None if it holds other things."""
    words = re.split(r"[\s,;\[\]]+", text.strip().strip("[]").strip())
    try:
        return np.array([float(word) for word in words if word], np.float64)
    except ValueError:
        return None


def _numbers_of_file(file: Path, key: str) -> Float64:
    """Return the numbers of a ``.npy``, ``.json`` or text file, or raise ``ValueError``."""
    if not file.is_file():
        raise ValueError("there is no such file")
    if file.stat().st_size > MOST_BYTES:
        raise ValueError(f"it has more than {MOST_BYTES} bytes")
    if file.suffix.lower() == ".npy":
        return np.asarray(np.load(file, allow_pickle=False), np.float64).ravel()
    text = file.read_text(encoding="utf-8")
    if file.suffix.lower() == ".json":
        return _numbers_of_json(json.loads(text), key)
    numbers = _numbers("\n".join(line.partition("#")[0] for line in text.splitlines()))
    if numbers is None:
        raise ValueError("it holds other things than numbers")
    return numbers


def _numbers_of_json(held: Any, key: str) -> Float64:
    """Return the numbers of a list of numbers or rows, or of an object with one under a name."""
    names = {
        "pose": ("pose", "transform_matrix", "extrinsics", "extrinsic", "matrix"),
        "intrinsics": ("intrinsics", "K", "camera_matrix", "intrinsic_matrix", "intrinsic"),
    }[key]
    if isinstance(held, dict):
        found = [name for name in names if name in held]
        if not found:
            raise ValueError(f"it has none of {', '.join(names)}")
        held = held[found[0]]
    try:
        return np.asarray(held, np.float64).ravel()
    except (TypeError, ValueError):
        raise ValueError("it is no list of numbers or rows of them") from None
