"""
Kalibr's ``camchain.yaml``.

The world is the first camera, x right, y down, z forward; ``T_cn_cnm1`` takes points from a camera
to the next one. The centre of the first pixel is at (0, 0).

References
----------
.. [1] Kalibr wiki, "yaml formats" and "Supported models".
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rasterjit.io.atomic_write import write_text
from rasterjit.io.camera_files import calibration
from rasterjit.io.camera_files.calibration import CalibratedCamera, Intrinsics, NoLensError
from rasterjit.io.camera_files.yaml_files import format_numbers, quote_yaml
from rasterjit.io.gltf.json_checks import get_list, get_numbers, quote, require
from rasterjit.io.load_warnings import LeftOut
from rasterjit.scene.lens import FisheyeLens, PinholeDistortion
from rasterjit.scene.transforms import compose, identity, inverse
from rasterjit.scene.validation import finite_array, image_size

FORMAT = "Kalibr"

DISTORTIONS = {
    "radtan": (PinholeDistortion, calibration.RADTAN),
    "equidistant": (FisheyeLens, calibration.EQUIDISTANT),
    "fov": (PinholeDistortion, ("w",)),
    "none": (PinholeDistortion, ()),
}
"""Lens and coefficients of each ``distortion_model``."""

READ_KEYS = {
    "camera_model", "intrinsics", "distortion_model", "distortion_coeffs", "resolution",
    "T_cn_cnm1", "rostopic", "cam_overlaps",
}  # fmt: skip
"""Keys of a camera; which cameras see the same is no loss."""


def list_names(document: dict[str, Any]) -> list[str]:
    """Return the names of the cameras of a chain, in order."""
    names = [name for name in document if re.fullmatch(r"cam[0-9]+", str(name))]
    return sorted(names, key=lambda name: int(name[3:]))


def read_kalibr(document: dict[str, Any], left_out: LeftOut) -> list[CalibratedCamera]:
    """Return the cameras of a chain."""
    for key in document.keys() - set(list_names(document)):
        left_out.note(str(key))
    pose = identity()
    found = []
    for number, name in enumerate(list_names(document)):
        values = document[name]
        try:
            if not isinstance(values, dict):
                raise ValueError(f"it must have keys and values, got {quote(values)}")
            for key in values.keys() - READ_KEYS:
                left_out.note(str(key))
            if number:
                step = finite_array("T_cn_cnm1", require(values, "T_cn_cnm1"), (4, 4))
                pose = compose(step, pose)
            topic = values.get("rostopic", name)
            found.append(calibration.join_camera(_read_intrinsics(values), pose, str(topic)))
        except NoLensError as error:
            left_out.note(f"camera without a lens here, {error}")
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
    return calibration.check_any(found, left_out)


def _read_intrinsics(values: dict[str, Any]) -> Intrinsics:
    """Return the intrinsics of a camera."""
    model, distortion = require(values, "camera_model"), values.get("distortion_model", "none")
    if model != "pinhole":
        raise NoLensError(f"camera_model {model!r}")
    if distortion not in tuple(DISTORTIONS):
        raise NoLensError(f"distortion_model {distortion!r}")
    kind, names = DISTORTIONS[distortion]
    require(values, "intrinsics")
    fx, fy, cx, cy = get_numbers(values, "intrinsics", (0.0,) * 4)
    coefficients = get_numbers(values, "distortion_coeffs", (0.0,) * len(names)) if names else ()
    size = image_size("resolution", get_list(values, "resolution"))
    lens = calibration.make_lens(kind, names, coefficients, f"distortion_model {distortion!r}")
    return Intrinsics(size, fx, fy, 0.0, cx + 0.5, cy + 0.5, lens)


def write_kalibr(file: Path, cameras: Sequence[CalibratedCamera]) -> None:
    """Write a chain, or raise ``ValueError``."""
    lines, before = [], identity()
    for number, camera in enumerate(cameras):
        with calibration.naming(camera):
            intrinsics, pose = calibration.split_camera(camera)
            calibration.refuse_skew(intrinsics, FORMAT)
            if not number:
                calibration.refuse_moved(pose, FORMAT)
            size, fx, fy, _, cx, cy, lens = intrinsics
            model = "equidistant" if isinstance(lens, FisheyeLens) else "radtan"
            coefficients = calibration.lens_coefficients(lens, DISTORTIONS[model][1], FORMAT)
            name = quote_yaml(camera.name)
        lines += [
            f"cam{number}:",
            "  camera_model: pinhole",
            f"  intrinsics: {format_numbers([fx, fy, cx - 0.5, cy - 0.5])}",
            f"  distortion_model: {model}",
            f"  distortion_coeffs: {format_numbers(coefficients)}",
            f"  resolution: {list(size)}",
        ]
        if number:
            rows = compose(pose, inverse(before)).tolist()
            lines += ["  T_cn_cnm1:", *(f"  - {format_numbers(row)}" for row in rows)]
        if camera.name not in ("", f"cam{number}"):
            lines.append(f"  rostopic: {name}")
        before = pose
    write_text(file, "\n".join([*lines, ""]))
