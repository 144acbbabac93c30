"""
Read and write OpenCV's calibrations of one camera or two as YAML; read ROS's ``camera_info``.

The centre of the first pixel is at (0, 0); x points right, y down, z forward.

References
----------
.. [1] OpenCV 4, "Camera calibration With OpenCV" and ``samples/cpp/stereo_calib.cpp``: the keys of
   their files. "Camera Calibration and 3D Reconstruction": what they mean.
.. [2] ROS, ``camera_calibration_parsers``: YAML of camera_info.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rasterjit.io.atomic_write import write_text
from rasterjit.io.camera_files import calibration
from rasterjit.io.camera_files.calibration import CalibratedCamera, Intrinsics, NoLensError
from rasterjit.io.camera_files.yaml_files import format_numbers, get_matrix, quote_yaml, read_yaml
from rasterjit.io.cameras import intrinsic_matrix
from rasterjit.io.gltf.json_checks import get_integer, get_list
from rasterjit.io.load_warnings import LeftOut
from rasterjit.scene import transforms
from rasterjit.scene.arrays import Float64
from rasterjit.scene.decomposed_transform import decompose
from rasterjit.scene.lens import FisheyeLens, PinholeDistortion
from rasterjit.scene.transforms import Matrix
from rasterjit.scene.validation import image_size
from rasterjit.scene.vectors import length

FORMAT = "OpenCV's YAML"

COEFFICIENTS = (
    "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"
)  # fmt: skip
COEFFICIENT_COUNTS = (0, 4, 5, 8, 12, 14)
"""How many coefficients of a lens OpenCV allows."""

MONO_KEYS = ("camera_matrix", "distortion_coefficients")
STEREO_KEYS = (
    (("M1", "D1"), ("M2", "D2")),
    (("K1", "D1"), ("K2", "D2")),
    (("cameraMatrix1", "distCoeffs1"), ("cameraMatrix2", "distCoeffs2")),
)
"""Keys of the matrix K and of the lens's coefficients: of one camera, and, in several spellings, of
two."""

FISHEYE_MODELS = ("equidistant", "fisheye")
"""Names that ROS gives the model of `FisheyeLens`."""

READ_KEYS = {
    *MONO_KEYS, *(key for pair in STEREO_KEYS for keys in pair for key in keys), "R", "T",
    "image_width", "image_height", "imageSize",
    "fisheye_model", "distortion_model", "extrinsic_parameters", "camera_name", "image_names",
}  # fmt: skip


def read_opencv(
    file: Path, document: dict[str, Any], size: tuple[int, int] | None, left_out: LeftOut
) -> list[CalibratedCamera]:
    """Return the camera of each view of a calibration, or both of a stereo pair."""
    # Keys: OpenCV 2 began words with capitals.
    lower = {key: str(key).lower() for key in document}
    document = {lower[key] if lower[key] in READ_KEYS else key: document[key] for key in document}
    for key in document.keys() - READ_KEYS:
        left_out.note(str(key))
    # Size.
    if "image_width" in document:
        sides = get_integer(document, "image_width"), get_integer(document, "image_height")
        size = image_size("image_width and image_height", sides)
    elif "imageSize" in document:
        size = image_size("imageSize", get_list(document, "imageSize"))
    if size is None:
        raise ValueError("give size: the file does not tell the size of its images")
    # Cameras.
    stereo_keys = next((keys for keys in STEREO_KEYS if keys[0][0] in document), None)
    try:
        if stereo_keys is None:
            intrinsics = [_read_intrinsics(document, *MONO_KEYS, size)]
            poses = _read_poses(document)
            intrinsics *= len(poses)
        else:
            intrinsics = [_read_intrinsics(document, *keys, size) for keys in stereo_keys]
            poses = [transforms.identity(), _read_stereo_pose(file, document, left_out)]
    except NoLensError as error:
        raise ValueError(f"no lens of RasterJIT models {error}") from None
    names = _read_names(document, len(poses))
    return [calibration.join_camera(*parts) for parts in zip(intrinsics, poses, names, strict=True)]


def _read_names(document: dict[str, Any], count: int) -> list[str]:
    """Return the names of ``count`` cameras."""
    if "image_names" in document:
        names = [str(name) for name in get_list(document, "image_names")]
        if len(names) != count:
            raise ValueError(f"image_names must be {count}, got {len(names)}")
        return names
    return [str(document.get("camera_name", ""))] * count


def _read_intrinsics(
    document: dict[str, Any], k_key: str, coefficients_key: str, size: tuple[int, int]
) -> Intrinsics:
    """Return a camera's intrinsics, given the keys of K and of the lens's coefficients."""
    (fx, skew, cx), (_, fy, cy), _ = intrinsic_matrix(k_key, get_matrix(document, k_key)).tolist()
    values: list[float] = []
    if document.get(coefficients_key) is not None:
        values = get_matrix(document, coefficients_key).ravel().tolist()
    is_fisheye = document.get("distortion_model") in FISHEYE_MODELS
    if is_fisheye or document.get("fisheye_model") in (1, True):
        if len(values) != len(calibration.EQUIDISTANT):
            raise ValueError(
                f"{coefficients_key} of a fisheye must be 4 numbers, got {len(values)}"
            )
        lens = calibration.make_lens(FisheyeLens, calibration.EQUIDISTANT, values, FORMAT)
    elif len(values) not in COEFFICIENT_COUNTS:
        raise ValueError(f"{coefficients_key} must be 4, 5, 8, 12 or 14 numbers, got {len(values)}")
    else:
        lens = calibration.make_lens(PinholeDistortion, COEFFICIENTS[: len(values)], values, FORMAT)
    # OpenCV has the first pixel's centre at (0, 0), we its corner.
    return Intrinsics(size, fx, fy, skew, cx + 0.5, cy + 0.5, lens)


def _read_poses(document: dict[str, Any]) -> list[Matrix]:
    """Return the pose ``camera_from_world`` of each view; the identity if the file has none."""
    if document.get("extrinsic_parameters") is None:
        return [transforms.identity()]
    rows = get_matrix(document, "extrinsic_parameters")
    if rows.shape[1] != 6 or not len(rows):
        raise ValueError(f"extrinsic_parameters must have shape (n, 6), got {rows.shape}")
    return [_make_pose(row[:3], row[3:]) for row in rows]


def _read_stereo_pose(file: Path, document: dict[str, Any], left_out: LeftOut) -> Matrix:
    """Return second from first camera: R and T of this file or of ``extrinsics.yml`` beside it."""
    if "R" in document:
        return _make_stereo_pose(document)
    extrinsics_file = file.with_name(file.name.replace("intrinsics", "extrinsics"))
    if extrinsics_file == file or not extrinsics_file.exists():
        raise ValueError("R and T, from the first camera to the second, are missing")
    with calibration.reading(extrinsics_file, FORMAT):
        document = read_yaml(extrinsics_file)
        for key in document.keys() - {"R", "T"}:
            left_out.note(str(key))
        return _make_stereo_pose(document)


def _make_stereo_pose(document: dict[str, Any]) -> Matrix:
    """Return the pose of a file's R and T, or raise ``ValueError``."""
    rotation, translation = get_matrix(document, "R"), get_matrix(document, "T")
    if rotation.shape != (3, 3) and rotation.size != 3:
        raise ValueError(f"R must have shape (3, 3) or 3 numbers, got {rotation.shape}")
    if translation.size != 3:
        raise ValueError(f"T must have 3 numbers, got shape {translation.shape}")
    return _make_pose(rotation, translation.ravel())


def _make_pose(rotation: Float64, translation: Float64) -> Matrix:
    """Return the pose of a rotation, (3, 3) or OpenCV's rotation vector, and a translation."""
    if rotation.size == 3:
        vector = rotation.ravel().tolist()
        angle = math.degrees(length(vector))
        pose = transforms.rotate(vector, angle) if angle else transforms.identity()
    else:
        pose = transforms.identity()
        pose[:3, :3] = rotation
    pose[:3, 3] = translation
    return pose


def _rotation_vector(pose: Matrix) -> list[float]:
    """Return OpenCV's rotation vector of a pose: its axis, as long as the angle in radians."""
    *xyz, w = decompose(pose).rotation
    # The axis times the sine of half the angle, and the cosine of that.
    sine = length(xyz)
    if sine == 0.0:
        return [0.0, 0.0, 0.0]
    # With w below 0 the angle is above 180 degrees: rotate the other way by the rest of 360.
    angle = math.radians(2.0 * transforms.arc_tangent(sine, abs(w)))
    return [math.copysign(1.0, w) * part * angle / sine for part in xyz]


def write_opencv(file: Path, cameras: Sequence[CalibratedCamera]) -> None:
    """Write a calibration of one camera in several views, or of two, or raise ``ValueError``."""
    intrinsics, poses, names = [], [], []
    for camera in cameras:
        with calibration.naming(camera):
            one, pose = calibration.split_camera(camera)
            intrinsics.append(one)
            poses.append(pose)
            names.append(quote_yaml(camera.name))
            _check_same_kind(one, intrinsics[0])
    # Size and kind of lens.
    first = intrinsics[0]
    lines = ["%YAML:1.0", "---", f"image_width: {first.size[0]}", f"image_height: {first.size[1]}"]
    if isinstance(first.lens, FisheyeLens):
        lines.append("fisheye_model: 1")
    if all(one == first for one in intrinsics):
        # One camera in several views.
        lines += _format_intrinsics(first, *MONO_KEYS)
        if len(cameras) > 1 or (poses[0] != np.eye(4)).any():
            rows = [[*_rotation_vector(pose), *pose[:3, 3].tolist()] for pose in poses]
            lines += _format_matrix("extrinsic_parameters", rows)
    else:
        # Two cameras.
        calibration.refuse(
            len(cameras) != 2,
            f"cameras must have the same intrinsics, or be two, for {FORMAT}, got {len(cameras)}",
        )
        with calibration.naming(cameras[0]):
            calibration.refuse_moved(poses[0], FORMAT)
        for one, keys in zip(intrinsics, STEREO_KEYS[0], strict=True):
            lines += _format_intrinsics(one, *keys)
        second_from_first = transforms.compose(poses[1], transforms.inverse(poses[0]))
        lines += _format_matrix("R", second_from_first[:3, :3].tolist())
        lines += _format_matrix("T", second_from_first[:3, 3:].tolist())
    # Names.
    if any(camera.name for camera in cameras):
        lines += ["image_names:", *(f"   - {name}" for name in names)]
    write_text(file, "\n".join([*lines, ""]))


def _check_same_kind(intrinsics: Intrinsics, first: Intrinsics) -> None:
    """Raise ``ValueError`` unless two cameras have the same size and model, one of OpenCV's."""
    calibration.refuse(
        intrinsics.size != first.size, f"it must have the size of others for {FORMAT}"
    )
    is_fisheye, first_is_fisheye = (
        isinstance(lens, FisheyeLens) for lens in (intrinsics.lens, first.lens)
    )
    calibration.refuse(
        is_fisheye != first_is_fisheye, f"it must have a lens as others for {FORMAT}"
    )
    names = calibration.EQUIDISTANT if is_fisheye else COEFFICIENTS
    calibration.lens_coefficients(intrinsics.lens, names, FORMAT)


def _format_intrinsics(intrinsics: Intrinsics, matrix: str, coefficients: str) -> list[str]:
    """Return the lines of K and of the coefficients of a camera."""
    _, fx, fy, skew, cx, cy, lens = intrinsics
    k = [[fx, skew, cx - 0.5], [0.0, fy, cy - 0.5], [0.0, 0.0, 1.0]]
    names = calibration.EQUIDISTANT if isinstance(lens, FisheyeLens) else COEFFICIENTS
    values = calibration.lens_coefficients(lens, names, FORMAT)
    if not isinstance(lens, FisheyeLens):
        values = values[: next(n for n in COEFFICIENT_COUNTS[2:] if not any(values[n:]))]
    return _format_matrix(matrix, k) + _format_matrix(coefficients, [[value] for value in values])


def _format_matrix(key: str, rows: list[list[float]]) -> list[str]:
    """Return the lines of a matrix of float64, as OpenCV writes it."""
    data = format_numbers([float(value) for row in rows for value in row])
    return [
        f"{key}: !!opencv-matrix",
        f"   rows: {len(rows)}",
        f"   cols: {len(rows[0])}",
        "   dt: d",
        f"   data: {data}",
    ]
