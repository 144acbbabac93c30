"""
Bundler's ``bundle.out``.

Camera axes are ours: x right, y up, z back. Pixels count from the middle of the image, y up; the
file has neither their number nor names, which are those of the list of images beside it.

References
----------
.. [1] N. Snavely, "Bundler v0.4 User's Manual", section "Output format and scene representation".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from rasterjit.io.atomic_write import atomic_file
from rasterjit.io.camera_files import calibration
from rasterjit.io.camera_files.calibration import CalibratedCamera, Intrinsics
from rasterjit.io.load_warnings import LeftOut
from rasterjit.io.resources import Resources
from rasterjit.scene.arrays import Float64
from rasterjit.scene.lens import PinholeDistortion
from rasterjit.scene.transforms import compose

FORMAT = "Bundler"
HEADER = "# Bundle file v0.3"
HEADER_START = "# Bundle file"
BUNDLE, LIST = "bundle", "list"
"""Words in the names of a file and of its list of images: ``bundle.out``, ``list.txt``."""

RADIAL = ("k1", "k2")
NUMBERS_PER_CAMERA = 15
"""Focal length, two coefficients, nine of the rotation, three of the translation."""


def read_bundler(
    file: Path, size: tuple[int, int] | None, left_out: LeftOut
) -> list[CalibratedCamera]:
    """Return the cameras that have a pose."""
    with calibration.reading(file, FORMAT):
        header, _, rest = file.read_text("utf-8").partition("\n")
        if not header.startswith(HEADER_START):
            raise ValueError(f"its first line must be {HEADER!r}, got {header!r}")
        words = rest.split()
        if len(words) < 2:
            raise ValueError("the numbers of cameras and points are missing")
        count, points = int(words[0]), int(words[1])
        end = 2 + NUMBERS_PER_CAMERA * count
        if min(count, points) < 0 or end > len(words):
            raise ValueError(f"it must have {count} cameras, got {len(words) - 2} numbers")
        _check_points(words, end, points)
        rows = np.array(words[2:end], np.float64).reshape(count, NUMBERS_PER_CAMERA)
    names = _read_names(_list_beside(file), count)
    left_out.note("point", points)
    resources = Resources(file)
    with calibration.reading(file, FORMAT):
        found = []
        for number, (row, name) in enumerate(zip(rows, names, strict=True)):
            if row[0] == 0.0:
                left_out.note("camera without a pose")
                continue
            try:
                found.append(_read_camera(row, name, resources, size))
            except ValueError as error:
                raise ValueError(f"camera {number}: {error}") from None
        return calibration.check_any(found, left_out)


def _check_points(words: list[str], at: int, points: int) -> None:
    """Raise ``ValueError`` unless so many points are the rest of a file."""
    for number in range(points):
        # Position, colour, and four numbers for each view.
        if at + 6 >= len(words):
            raise ValueError(f"it ends at point {number} of {points}")
        at += 7 + 4 * max(int(words[at + 6]), 0)
    if at != len(words):
        raise ValueError(f"after {points} points it must end, got {len(words) - at} numbers more")


def _list_beside(file: Path) -> Path:
    """Return the path of a bundle's list of images: ``a.bundle.rd.out`` has ``a.list.rd.txt``."""
    name = file.stem.replace(BUNDLE, LIST) if BUNDLE in file.stem else f"{file.stem}.{LIST}"
    return file.with_name(f"{name}.txt")


def _read_names(file: Path, count: int) -> list[str]:
    """Return the names of images, each the first word of a line; empty ones without a list."""
    if not file.exists():
        return [""] * count
    with calibration.reading(file, "Bundler's list of images"):
        names = [line.split()[0] for line in file.read_text("utf-8").splitlines() if line.strip()]
        if len(names) != count:
            raise ValueError(f"it must name {count} images, got {len(names)}")
    return names


def _read_camera(
    row: Float64, name: str, resources: Resources, size: tuple[int, int] | None
) -> CalibratedCamera:
    """Return the camera of a row of numbers."""
    if not np.isfinite(row).all():
        raise ValueError(f"its numbers must be finite, got {row.tolist()}")
    focal, *coefficients = row[:3].tolist()
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = row[3:12].reshape(3, 3), row[12:]
    if size is None:
        size = calibration.image_file_size(name, resources)
    lens = calibration.make_lens(PinholeDistortion, RADIAL, coefficients, FORMAT)
    intrinsics = Intrinsics(size, focal, focal, 0.0, size[0] / 2.0, size[1] / 2.0, lens)
    return calibration.join_camera(intrinsics, compose(calibration.FLIP_YZ, view), name)


def write_bundler(file: Path, cameras: Sequence[CalibratedCamera]) -> None:
    """Write a bundle without points, and the list of its images, or raise ``ValueError``."""
    lines = [HEADER, f"{len(cameras)} 0"]
    has_names = any(camera.name for camera in cameras)
    for camera in cameras:
        with calibration.naming(camera):
            intrinsics, pose = calibration.split_camera(camera)
            lens = calibration.lens_coefficients(intrinsics.lens, RADIAL, FORMAT)
            calibration.refuse_skew(intrinsics, FORMAT)
            calibration.refuse(
                not (intrinsics.is_centered and math.isclose(intrinsics.fx, intrinsics.fy)),
                "it must have square pixels and its principal point in the middle of the image for "
                f"{FORMAT}, got {intrinsics}",
            )
            # Raise before anything is written.
            camera.name.encode()
            is_word = camera.name.split() == [camera.name]
            calibration.refuse(
                has_names and not is_word, f"it must have a name without spaces for {FORMAT}"
            )
        view = compose(calibration.FLIP_YZ, pose)
        for numbers in ([intrinsics.fx, *lens], *view[:3, :3].tolist(), view[:3, 3].tolist()):
            lines.append(" ".join(map(repr, numbers)))
    with ExitStack() as stack:
        texts = {file: lines}
        if has_names:
            texts[_list_beside(file)] = [camera.name for camera in cameras]
        places = {path: stack.enter_context(atomic_file(path)) for path in texts}
        for path, place in places.items():
            place.write_text("\n".join([*texts[path], ""]), "utf-8", newline="\n")
