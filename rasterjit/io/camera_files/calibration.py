"""A camera as calibrations have it: intrinsics, a lens, a pose, and the name of its image."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rasterjit.io.cameras import from_opencv, to_opencv
from rasterjit.io.load_warnings import LeftOut, reason_of
from rasterjit.io.resources import Resources, quote_name
from rasterjit.scene.arrays import Float64
from rasterjit.scene.attribute_guard import store, suggests_replace
from rasterjit.scene.camera import Camera, check_camera
from rasterjit.scene.lens import (
    Equirectangular,
    FisheyeLens,
    Lens,
    PinholeDistortion,
    check_lens,
)
from rasterjit.scene.transforms import Matrix, apply, scale
from rasterjit.scene.validation import image_size, number_array, string

RADTAN = ("k1", "k2", "p1", "p2")
EQUIDISTANT = ("k1", "k2", "k3", "k4")
"""Coefficients of the two lenses that most formats know."""

FLIP_YZ = scale((1.0, -1.0, -1.0))
"""OpenCV's axes of a camera to ours, and back."""

IDENTITY_TOLERANCE = 1e-12
"""By how much a pose may miss the identity and be it."""


@suggests_replace
@dataclass(frozen=True)
class CalibratedCamera:
    """
    A camera with the size of its image, its lens, and the name of its image.

    ``rj.render(scene, one.camera, size=one.size, lens=one.lens)`` draws what it sees.

    Parameters
    ----------
    camera : Camera
        A perspective without distortion.
    size : (int, int)
        Width and height of the image, pixels.
    lens : PinholeDistortion, FisheyeLens or Equirectangular, optional
        Default: no distortion.
    name : str
        Of the image, as a file has it: mostly its path from a folder of images. Default: none.

    Raises
    ------
    ValueError
        Naming the argument that is wrong, or that the camera does not take such a size.
    """

    camera: Camera
    size: tuple[int, int]
    lens: Lens | None = None
    name: str = ""

    def __post_init__(self) -> None:
        check_camera("camera", self.camera).projection_matrix(image_size("size", self.size))
        if self.lens is not None:
            check_lens("lens", self.lens)
        store(self, size=image_size("size", self.size), name=string("name", self.name))

    def project(self, points: ArrayLike) -> Float64:
        """
        Return where points are in the image, through the lens.

        Parameters
        ----------
        points : (..., 3) array_like, world space

        Returns
        -------
        (..., 2) float64
            Pixels, x right, y down; the centre of the pixel in column i and row j is at
            (i + 0.5, j + 0.5). NaN for points that the camera does not see in any direction.

        Raises
        ------
        ValueError
            If ``points`` has another shape or is not of numbers, or the camera is no pinhole along
            its own axis, or its view scales.
        """
        if self.lens is None:
            return self.camera.project(points, self.size).pixels  # type: ignore[attr-defined]
        intrinsics, camera_from_world = split_camera(self)
        directions = apply(camera_from_world, number_array("points", points))
        places = self.lens.project(directions)
        if isinstance(self.lens, Equirectangular):
            width, height = self.size
            return places * (width / (2.0 * math.pi), height / math.pi) + (width / 2, height / 2)
        x = intrinsics.fx * places[..., 0] + intrinsics.skew * places[..., 1] + intrinsics.cx
        return np.stack((x, intrinsics.fy * places[..., 1] + intrinsics.cy), axis=-1)


class Intrinsics(NamedTuple):
    """What cameras of several images may share; all but the lens in pixels."""

    size: tuple[int, int]
    fx: float
    fy: float
    skew: float
    cx: float
    """Of the principal point; the first pixel's corner is at (0, 0)."""
    cy: float
    lens: Lens | None

    @property
    def is_centered(self) -> bool:
        """Whether the principal point is the middle of the image."""
        width, height = self.size
        return math.isclose(self.cx, width / 2.0) and math.isclose(self.cy, height / 2.0)


class NoLensError(ValueError):
    """A model of a camera that no lens here stands for; the message names it."""


def split_camera(camera: CalibratedCamera) -> tuple[Intrinsics, Matrix]:
    """Return intrinsics and OpenCV's ``camera_from_world``, or raise ``ValueError``."""
    found = to_opencv(camera.camera, camera.size)
    if isinstance(camera.lens, Equirectangular):
        return make_panorama(camera.size, "a panorama"), found.camera_from_world
    (fx, skew, cx), (_, fy, cy), _ = found.intrinsics.tolist()
    inner = Intrinsics(camera.size, fx, fy, skew, cx + 0.5, cy + 0.5, camera.lens)
    return inner, found.camera_from_world


def join_camera(
    intrinsics: Intrinsics, camera_from_world: ArrayLike, name: str
) -> CalibratedCamera:
    """Return the camera of intrinsics and a pose, OpenCV's, or raise ``ValueError``."""
    size, fx, fy, skew, cx, cy, lens = intrinsics
    if not 0.0 < min(fx, fy) <= max(fx, fy) < math.inf:
        raise ValueError(f"focal lengths must be above 0, got {fx!r} and {fy!r}")
    k = [[fx, skew, cx - 0.5], [0.0, fy, cy - 0.5], [0.0, 0.0, 1.0]]
    try:
        camera = from_opencv(k, size, camera_from_world=camera_from_world)
    except ValueError as error:
        raise ValueError(str(error).replace("camera_from_world", "the pose")) from None
    return CalibratedCamera(camera, size, lens, name)


def make_panorama(size: tuple[int, int], model: str) -> Intrinsics:
    """Return the intrinsics of a panorama, or raise `NoLensError` if it is not of all around."""
    width, height = size
    if width != 2 * height:
        raise NoLensError(f"{model} of {width} x {height}, which is not twice as wide as high")
    return Intrinsics(size, height, height, 0.0, width / 2.0, height / 2.0, Equirectangular())


def make_lens(
    kind: type[PinholeDistortion | FisheyeLens],
    names: Iterable[str],
    values: Iterable[float],
    model: str,
) -> Lens | None:
    """
    Return the lens of named coefficients; ``None`` for a pinhole that distorts nothing.

    Raises
    ------
    NoLensError
        If a coefficient that the lens does not have is not 0.
    """
    given = dict(zip(names, values, strict=True))
    known = {field.name for field in fields(kind)}
    for name, value in given.items():
        if name not in known and value != 0.0:
            raise NoLensError(f"{model} with {name} = {value:g}")
    lens = kind(**{name: value for name, value in given.items() if name in known})
    return None if lens == PinholeDistortion() else lens


def lens_coefficients(lens: Lens | None, names: Sequence[str], file_format: str) -> list[float]:
    """Return the named coefficients of a lens; raise ``ValueError`` if it has others."""
    if lens is None:
        return [0.0] * len(names)
    if not isinstance(lens, (PinholeDistortion, FisheyeLens)):
        raise ValueError(f"lens must be none or of OpenCV's for {file_format}, got {lens!r}")
    for field in fields(lens):
        if field.name not in names and getattr(lens, field.name) != field.default:
            raise ValueError(
                f"lens must have no coefficients but {', '.join(names)} for {file_format}, got "
                f"{field.name} = {getattr(lens, field.name)!r}"
            )
    return [getattr(lens, name) for name in names]


@contextmanager
def naming(camera: CalibratedCamera) -> Iterator[None]:
    """Let errors of a writer name the image of a camera."""
    try:
        yield
    except UnicodeEncodeError:
        raise ValueError(f"camera {camera.name!r}: its name must be what UTF-8 can hold") from None
    except ValueError as error:
        raise ValueError(f"camera {camera.name!r}: {error}") from None


def refuse(condition: bool, message: str) -> None:
    """Raise ``ValueError`` if the condition holds."""
    if condition:
        raise ValueError(message)


def refuse_skew(intrinsics: Intrinsics, file_format: str) -> None:
    """Raise ``ValueError`` if a camera has skew, which few formats can hold."""
    is_skewed = abs(intrinsics.skew) > 1e-9 * intrinsics.fx
    refuse(is_skewed, f"it must have no skew for {file_format}, got {intrinsics.skew!r}")


def refuse_moved(pose: Matrix | Float64, file_format: str) -> None:
    """Raise ``ValueError`` if the first camera of a file is not where the world's origin is."""
    is_moved = np.abs(pose - np.eye(4)).max() > IDENTITY_TOLERANCE
    refuse(
        bool(is_moved),
        f"it must be where the world's origin is, x right, y down, z forward, for {file_format}, "
        "which only holds poses from one camera to the next",
    )


@contextmanager
def reading(file: Path, file_format: str) -> Iterator[None]:
    """Let errors of a reader name the file and what it was read as."""
    try:
        yield
    except FileNotFoundError:
        raise ValueError(f"{file} is missing") from None
    except (ValueError, LookupError, TypeError, OverflowError, RecursionError, OSError) as error:
        raise ValueError(f"{file} could not be read as {file_format}: {reason_of(error)}") from None


def check_any(cameras: list[CalibratedCamera], left_out: LeftOut) -> list[CalibratedCamera]:
    """Return cameras, or raise ``ValueError`` if there is none."""
    if not cameras:
        rest = str(left_out)
        raise ValueError(f"it holds no camera{f' but what is left out: {rest}' if rest else ''}")
    return cameras


def image_file_size(name: str, resources: Resources) -> tuple[int, int]:
    """Return width and height of a picture that a file names, or raise ``ValueError``."""
    from rasterjit.io.images import read_picture_size

    try:
        with resources.open(name) as file:
            return read_picture_size(file, quote_name(name))
    except ValueError as error:
        reason = str(error).partition("; resource_root")[0]
        raise ValueError(f"give size: the file has none, and {reason}") from None
