"""
Files of calibrated cameras: COLMAP, nerfstudio, instant-ngp, Blender, Bundler, OpenCV and Kalibr.

A file is told by its name, and YAML by what it holds.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from rasterjit.io.camera_files.calibration import CalibratedCamera, reading
from rasterjit.io.load_warnings import LeftOut
from rasterjit.scene.validation import brief, image_size, one_of, sequence, short_repr

CameraFormat: TypeAlias = Literal[
    "colmap", "colmap-text", "nerfstudio", "blender", "bundler", "opencv", "kalibr"
]
CAMERA_FORMATS: tuple[CameraFormat, ...] = get_args(CameraFormat)
"""Formats that cameras are written in."""

COLMAP_FILES = {
    f"{name}{suffix}": suffix for suffix in (".bin", ".txt") for name in ("cameras", "images")
}
"""Names of COLMAP's files of cameras, and their suffixes; binary ones are looked for first."""

TRANSFORMS = "transforms.json"

WRITERS: dict[CameraFormat, tuple[str, str]] = {
    "colmap": ("colmap", "write_binary"),
    "colmap-text": ("colmap", "write_text"),
    "nerfstudio": ("transforms_json", "write_transforms"),
    "blender": ("transforms_json", "write_blender"),
    "bundler": ("bundler", "write_bundler"),
    "opencv": ("opencv_yaml", "write_opencv"),
    "kalibr": ("kalibr", "write_kalibr"),
}
"""Module and function that write each format, imported on use."""

KNOWN_FILES = (
    "a folder of COLMAP's cameras and images, one of those files (.txt or .bin), or a file whose "
    "suffix is .json (nerfstudio, instant-ngp, Blender), .out (Bundler), .yaml or .yml (OpenCV, "
    "Kalibr)"
)


def load_cameras(
    path: str | os.PathLike[str], *, size: tuple[int, int] | None = None
) -> list[CalibratedCamera]:
    """
    Read the cameras of a file: their poses, lenses, sizes and the names of their images.

    It may be a folder of COLMAP (``cameras`` and ``images``, binary or text) or one of these files,
    ``transforms.json`` or a folder with it (nerfstudio, instant-ngp, NeRF's synthetic scenes made
    with Blender), Bundler's ``bundle.out``, or YAML of OpenCV, ROS or Kalibr, which needs
    ``pip install "rasterjit[cameras]"``. World axes and units stay those of the file.

    Parameters
    ----------
    path : str or path
    size : (int, int), optional
        Width and height of the images, pixels, for files that do not tell it (Bundler, Blender,
        OpenCV). Default: that of the images, if they lie where the file says, in its folder or
        below.

    Returns
    -------
    list of CalibratedCamera
        In the order of the file; of Kalibr in that of the chain. A `LoadWarning` names what the
        file has besides, such as points, and the cameras that no lens here stands for.

    Raises
    ------
    ValueError
        If the file is missing, damaged, of no known format, or holds no camera; naming it.

    Examples
    --------
    >>> import rasterjit as rj
    >>> camera = rj.PerspectiveCamera(eye=(4, 5, 9), target=(0, 1.5, 0), fov_y=40.0)
    >>> rj.save_cameras("transforms.json", [rj.CalibratedCamera(camera, (320, 240), name="a.png")])
    >>> [one] = rj.load_cameras("transforms.json")
    >>> scene = rj.load("models/teapot.obj")
    >>> frame = rj.render(scene, one.camera, size=one.size, lens=one.lens)
    """
    file = _find_file(_check_path(path))
    size = None if size is None else image_size("size", size)
    left_out = LeftOut()
    cameras = _read(file, size, left_out)
    left_out.warn(str(file))
    return cameras


def _find_file(file: Path) -> Path:
    """Return a file of cameras, also that of a folder, or raise ``ValueError``."""
    if file.is_dir():
        names = [name for name in (*COLMAP_FILES, TRANSFORMS) if (file / name).exists()]
        if not names:
            raise ValueError(f"path must be {KNOWN_FILES}, but {file} holds none of them")
        return file / names[0]
    if not file.exists():
        raise ValueError(f"path must be {KNOWN_FILES}, but {file} does not exist")
    return file


def _read(file: Path, size: tuple[int, int] | None, left_out: LeftOut) -> list[CalibratedCamera]:
    """Return the cameras of a file, or raise ``ValueError``."""
    # A format is imported when it is read.
    if file.name in COLMAP_FILES:
        from rasterjit.io.camera_files import colmap

        return colmap.read_colmap(file.parent, COLMAP_FILES[file.name], left_out)
    suffix = file.suffix.lower()
    if suffix == ".json":
        from rasterjit.io.camera_files import transforms_json

        return transforms_json.read_transforms(file, size, left_out)
    if suffix == ".out":
        from rasterjit.io.camera_files import bundler

        return bundler.read_bundler(file, size, left_out)
    if suffix in (".yaml", ".yml"):
        from rasterjit.io.camera_files import kalibr, opencv_yaml, yaml_files

        with reading(file, "YAML"):
            document = yaml_files.read_yaml(file)
        if kalibr.list_names(document):
            with reading(file, kalibr.FORMAT):
                return kalibr.read_kalibr(document, left_out)
        with reading(file, opencv_yaml.FORMAT):
            return opencv_yaml.read_opencv(file, document, size, left_out)
    raise ValueError(f"path must be {KNOWN_FILES}, got {str(file)!r}")


def save_cameras(
    path: str | os.PathLike[str],
    cameras: Iterable[CalibratedCamera],
    *,
    format: CameraFormat | None = None,
) -> None:
    """
    Write cameras to a file of another program, which `load_cameras` reads as well.

    Near and far planes are no part of a calibration, and are not written.

    Parameters
    ----------
    path : str or path
        A file; of COLMAP's model a folder, which is made, or one of its files. Bundler's file gets
        its list of images beside it.
    cameras : iterable of CalibratedCamera
    format : {"colmap", "colmap-text", "nerfstudio", "blender", "bundler", "opencv", "kalibr"}, \
optional
        Default: by the name: without a suffix ``"colmap"``, which is binary; ``cameras.txt`` or
        ``images.txt`` ``"colmap-text"``; ``.json`` ``"nerfstudio"``; ``.out`` ``"bundler"``; YAML
        ``"kalibr"`` if ``camchain`` is in the name, else ``"opencv"``.

    Raises
    ------
    ValueError
        If the format cannot hold a camera, its lens, its name or pose: naming the camera and what
        it has; or if an argument is wrong.
    OSError
        If a file cannot be written.
    """
    file = _check_path(path)
    listed = sequence("cameras", cameras)
    for one in listed:
        if not isinstance(one, CalibratedCamera):
            raise ValueError(f"cameras must be of type CalibratedCamera, got {brief(one)}")
    if not listed:
        raise ValueError("cameras must not be empty")
    chosen = _choose_format(file) if format is None else one_of("format", format, CAMERA_FORMATS)
    module, writer = WRITERS[chosen]
    getattr(import_module(f"{__name__}.{module}"), writer)(file, listed)


def _choose_format(file: Path) -> CameraFormat:
    """Return the format of a file name, or raise ``ValueError``."""
    if file.is_dir() or not file.suffix:
        return "colmap"
    if file.name in COLMAP_FILES:
        return "colmap" if COLMAP_FILES[file.name] == ".bin" else "colmap-text"
    suffix = file.suffix.lower()
    if suffix in (".yaml", ".yml"):
        return "kalibr" if "camchain" in file.name else "opencv"
    formats: dict[str, CameraFormat] = {".json": "nerfstudio", ".out": "bundler"}
    if suffix not in formats:
        raise ValueError(f"path must be {KNOWN_FILES}, got {str(file)!r}")
    return formats[suffix]


def _check_path(path: Any) -> Path:
    """Return a path, or raise ``ValueError``."""
    if not isinstance(path, (str, os.PathLike)):
        raise ValueError(f"path must be the name of a file or folder, got {short_repr(path)}")
    return Path(path).expanduser()
