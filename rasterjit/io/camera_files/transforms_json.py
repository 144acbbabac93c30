"""
``transforms.json`` of nerfstudio and instant-ngp, and the JSON of NeRF's synthetic scenes.

A pose is world from camera, x right, y up, z back; the principal point is counted from the corner
of the first pixel. What Blender's exporters write for NeRF's synthetic scenes has the same shape
with ``camera_angle_x``, radians, alone.

References
----------
.. [1] nerfstudio documentation, "Data conventions".
.. [2] instant-ngp, ``docs/nerf_dataset_tips.md`` and ``src/nerf_loader.cu``: the keys of its files.
.. [3] B. Mildenhall et al., "NeRF", ECCV 2020: ``load_blender.py`` of the published program.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from rasterjit.io.atomic_write import write_text
from rasterjit.io.camera_files import calibration
from rasterjit.io.camera_files.calibration import CalibratedCamera, Intrinsics, NoLensError
from rasterjit.io.cameras import view_from_pose
from rasterjit.io.gltf.json_checks import get_integer, get_list, get_number, get_numbers, require
from rasterjit.io.load_warnings import LeftOut
from rasterjit.io.resources import Resources
from rasterjit.scene import transforms
from rasterjit.scene.lens import Equirectangular, FisheyeLens, PinholeDistortion
from rasterjit.scene.validation import image_size

FORMAT = "transforms.json"
BLENDER = "Blender's JSON"

PERSPECTIVE = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
FISHEYE = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
PANORAMA = "EQUIRECTANGULAR"
"""Values of ``camera_model`` that a lens here stands for."""

RADIAL_AND_TANGENTIAL = ("k1", "k2", "k3", "p1", "p2")
FOURTH = "k4, of the eighth power,"
"""What nerfstudio's ``k4`` is where no fisheye is meant; OpenCV's is another."""

OTHER_PROJECTIONS = ("ftheta_p0", "latlong", "equirectangular")
"""Keys of instant-ngp's that choose a projection which no lens here stands for."""

INTRINSIC_KEYS = (
    "camera_model", "is_fisheye", "w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x",
    "camera_angle_y", "x_fov", "y_fov", "k1", "k2", "k3", "k4", "p1", "p2", "distortion_params",
)  # fmt: skip
FRAME_KEYS = ("file_path", "transform_matrix")

DEFAULT_SUFFIX = ".png"
"""Suffix of images whose names have none, as those of NeRF's synthetic scenes."""


def read_transforms(
    file: Path, size: tuple[int, int] | None, left_out: LeftOut
) -> list[CalibratedCamera]:
    """Return the cameras of all frames."""
    with calibration.reading(file, FORMAT):
        document = json.loads(file.read_text("utf-8"))
        if not isinstance(document, dict) or "frames" not in document:
            raise ValueError("frames is missing")
        _note_keys(document, (*INTRINSIC_KEYS, "frames"), left_out)
        resources, found = Resources(file), []
        for number, frame in enumerate(get_list(document, "frames")):
            if not isinstance(frame, dict):
                raise ValueError(f"frame {number} must be an object, got {frame!r}")
            _note_keys(frame, (*INTRINSIC_KEYS, *FRAME_KEYS), left_out)
            try:
                found.append(_read_frame({**document, **frame}, resources, size))
            except NoLensError as error:
                left_out.note(f"frame of a camera without a lens here, {error}")
            except ValueError as error:
                raise ValueError(f"frame {number}: {error}") from None
        return calibration.check_any(found, left_out)


def _note_keys(values: dict[str, Any], known: Sequence[str], left_out: LeftOut) -> None:
    """Note the keys of an object that are not read."""
    for key in values.keys() - set(known):
        left_out.note(key)


def _read_frame(
    values: dict[str, Any], resources: Resources, size: tuple[int, int] | None
) -> CalibratedCamera:
    """Return the camera of a frame, given its own values and those of the file."""
    name = require(values, "file_path")
    if not isinstance(name, str):
        raise ValueError(f"file_path must be a string, got {name!r}")
    if "fl_x" not in values and not PurePosixPath(name).suffix:
        name += DEFAULT_SUFFIX
    if "w" in values or "h" in values:
        size = image_size("w and h", (get_integer(values, "w"), get_integer(values, "h")))
    elif size is None:
        size = calibration.image_file_size(name, resources)
    rows = get_list(values, "transform_matrix")
    matrix = [get_numbers({"row": row}, "row", (0.0,) * 4) for row in rows]
    if len(matrix) not in (3, 4):
        raise ValueError(f"transform_matrix must have 4 rows, got {len(matrix)}")
    pose = np.vstack([matrix, np.eye(4)[len(matrix) :]])
    view = view_from_pose(pose, "transform_matrix")
    intrinsics = _read_intrinsics(values, size)
    return calibration.join_camera(intrinsics, transforms.compose(calibration.FLIP_YZ, view), name)


def _read_intrinsics(values: dict[str, Any], size: tuple[int, int]) -> Intrinsics:
    """Return the intrinsics of a frame."""
    model = values.get("camera_model", "OPENCV")
    if model == PANORAMA:
        return calibration.make_panorama(size, model)
    if model not in PERSPECTIVE + FISHEYE:
        raise NoLensError(f"camera_model {model!r}")
    for key in OTHER_PROJECTIONS:
        if key in values:
            raise NoLensError(key)
    focals = [_read_focal(values, axis, side) for axis, side in zip("xy", size, strict=True)]
    fx, fy = (other if one is None else one for one, other in (focals, focals[::-1]))
    if fx is None or fy is None:
        raise ValueError("fl_x or camera_angle_x is missing")
    cx = get_number(values, "cx", size[0] / 2.0)
    cy = get_number(values, "cy", size[1] / 2.0)
    k1, k2, k3, k4, p1, p2 = get_numbers(
        values,
        "distortion_params",
        tuple(get_number(values, key, 0.0) for key in ("k1", "k2", "k3", "k4", "p1", "p2")),
    )
    # For instant-ngp a fisheye without coefficients is none.
    if model in FISHEYE or (values.get("is_fisheye") is True and any((k1, k2, k3, k4))):
        lens = calibration.make_lens(FisheyeLens, calibration.EQUIDISTANT, (k1, k2, k3, k4), model)
    else:
        names = (*RADIAL_AND_TANGENTIAL, FOURTH)
        lens = calibration.make_lens(PinholeDistortion, names, (k1, k2, k3, p1, p2, k4), model)
    return Intrinsics(size, fx, fy, 0.0, cx, cy, lens)


def _read_focal(values: dict[str, Any], axis: str, side: int) -> float | None:
    """Return the focal length of an axis, pixels, or ``None`` if there is none."""
    if (key := f"{axis}_fov") in values:
        angle = get_number(values, key)
    elif f"fl_{axis}" in values:
        return get_number(values, f"fl_{axis}")
    elif (key := f"camera_angle_{axis}") in values:
        angle = math.degrees(get_number(values, key))
    else:
        return None
    try:
        return transforms.focal_length(angle) * side / 2.0
    except ValueError as error:
        raise ValueError(str(error).replace("fov_y", key)) from None


def write_transforms(file: Path, cameras: Sequence[CalibratedCamera]) -> None:
    """Write ``transforms.json``, or raise ``ValueError``."""
    listed = [_split_frame(camera, FORMAT) for camera in cameras]
    inner = [intrinsics for _, intrinsics, _ in listed]
    models = {one["camera_model"] for one in inner}
    if len(models) > 1:
        raise ValueError(
            f"cameras must have lenses of one model for {FORMAT}, got {', '.join(sorted(models))}"
        )
    frames = [frame for *_, frame in listed]
    if all(one == inner[0] for one in inner):
        document = inner[0]
    else:
        document = {"camera_model": inner[0]["camera_model"]}
        for frame, one in zip(frames, inner, strict=True):
            frame |= {key: value for key, value in one.items() if key not in document}
    _write(file, {**document, "frames": frames})


def write_blender(file: Path, cameras: Sequence[CalibratedCamera]) -> None:
    """Write a JSON file as those of NeRF's synthetic scenes, or raise ``ValueError``."""
    listed = [_split_frame(camera, BLENDER) for camera in cameras]
    first, document, _ = listed[0]
    for camera, (intrinsics, _, frame) in zip(cameras, listed, strict=True):
        with calibration.naming(camera):
            is_plain = intrinsics.is_centered and math.isclose(intrinsics.fx, intrinsics.fy)
            calibration.refuse(
                not is_plain or intrinsics.lens is not None,
                "it must have square pixels, its principal point in the middle of the image and no "
                f"lens for {BLENDER}, got {intrinsics}",
            )
            is_same = intrinsics.size == first.size and math.isclose(intrinsics.fx, first.fx)
            calibration.refuse(
                not is_same, f"it must have the size and focal length of others for {BLENDER}"
            )
            stem = camera.name.removesuffix(DEFAULT_SUFFIX)
            calibration.refuse(
                stem == camera.name, f"it must have an image {DEFAULT_SUFFIX} for {BLENDER}"
            )
            calibration.refuse(
                bool(PurePosixPath(stem).suffix), f"it must have one suffix for {BLENDER}"
            )
            frame["file_path"] = stem
    angle = document["camera_angle_x"]
    _write(file, {"camera_angle_x": angle, "frames": [frame for *_, frame in listed]})


def _split_frame(
    camera: CalibratedCamera, file_format: str
) -> tuple[Intrinsics, dict[str, Any], dict[str, Any]]:
    """Return the intrinsics of a camera, those by their keys, and its frame, or raise."""
    with calibration.naming(camera):
        calibration.refuse(not camera.name, f"it must have the name of its image for {file_format}")
        intrinsics, _ = calibration.split_camera(camera)
        calibration.refuse_skew(intrinsics, file_format)
        pose = transforms.inverse(camera.camera.view_matrix()).tolist()
        frame = {"file_path": camera.name, "transform_matrix": pose}
        return intrinsics, list_intrinsics(intrinsics), frame


def list_intrinsics(intrinsics: Intrinsics) -> dict[str, Any]:
    """Return intrinsics by nerfstudio's keys, or raise ``ValueError``."""
    (width, height), fx, fy, _, cx, cy, lens = intrinsics
    angles = [transforms.arc_tangent(side, 2.0 * f) for side, f in ((width, fx), (height, fy))]
    document = {
        "camera_model": "OPENCV",
        "camera_angle_x": math.radians(2.0 * angles[0]),
        "camera_angle_y": math.radians(2.0 * angles[1]),
        "fl_x": fx,
        "fl_y": fy,
        "cx": cx,
        "cy": cy,
        "w": width,
        "h": height,
    }
    if isinstance(lens, Equirectangular):
        return document | {"camera_model": PANORAMA}
    if lens is None:
        return document
    names = calibration.EQUIDISTANT if isinstance(lens, FisheyeLens) else RADIAL_AND_TANGENTIAL
    document |= zip(names, calibration.lens_coefficients(lens, names, FORMAT), strict=True)
    if isinstance(lens, FisheyeLens):
        document |= {"camera_model": "OPENCV_FISHEYE", "is_fisheye": True}
    return document


def _write(file: Path, document: dict[str, Any]) -> None:
    """Write a JSON file."""
    write_text(file, json.dumps(document, indent=1, ensure_ascii=False) + "\n")
