"""
COLMAP's models: ``cameras`` and ``images``, as text or binary.

The centre of the first pixel is at (0.5, 0.5); a pose is camera from world, x right, y down, z
forward, its rotation a quaternion w, x, y, z.

References
----------
.. [1] COLMAP documentation, "Output Format" and "Camera Models"; the order of coefficients is that
   of ``src/colmap/sensor/models.h``.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from rasterjit.io.atomic_write import atomic_file
from rasterjit.io.camera_files.calibration import (
    EQUIDISTANT,
    RADTAN,
    CalibratedCamera,
    Intrinsics,
    NoLensError,
    check_any,
    join_camera,
    lens_coefficients,
    make_lens,
    make_panorama,
    naming,
    reading,
    refuse,
    refuse_skew,
    split_camera,
)
from rasterjit.io.load_warnings import LeftOut
from rasterjit.scene.decomposed_transform import TRS, compose_trs, decompose
from rasterjit.scene.lens import Equirectangular, FisheyeLens, PinholeDistortion

FORMAT = "COLMAP"

Kind = type[PinholeDistortion | FisheyeLens]


class Model(NamedTuple):
    """A camera model: its number, focal lengths, lens, and coefficients after cx and cy."""

    number: int
    focals: int
    kind: Kind
    coefficients: tuple[str, ...] = ()

    @property
    def parameter_count(self) -> int:
        """How many parameters it has."""
        return self.focals + 2 + len(self.coefficients)


FULL = (*RADTAN, "k3", "k4", "k5", "k6")

_PINHOLE, _FISHEYE = PinholeDistortion, FisheyeLens

MODELS = {
    "SIMPLE_PINHOLE": Model(0, 1, _PINHOLE),
    "PINHOLE": Model(1, 2, _PINHOLE),
    "SIMPLE_RADIAL": Model(2, 1, _PINHOLE, ("k1",)),
    "RADIAL": Model(3, 1, _PINHOLE, ("k1", "k2")),
    "OPENCV": Model(4, 2, _PINHOLE, RADTAN),
    "OPENCV_FISHEYE": Model(5, 2, _FISHEYE, EQUIDISTANT),
    "FULL_OPENCV": Model(6, 2, _PINHOLE, FULL),
    "FOV": Model(7, 2, _PINHOLE, ("omega",)),
    "SIMPLE_RADIAL_FISHEYE": Model(8, 1, _FISHEYE, ("k1",)),
    "RADIAL_FISHEYE": Model(9, 1, _FISHEYE, ("k1", "k2")),
    "THIN_PRISM_FISHEYE": Model(10, 2, _FISHEYE, (*RADTAN, "k3", "k4", "sx1", "sy1")),
    "RAD_TAN_THIN_PRISM_FISHEYE": Model(
        11, 2, _FISHEYE, (*EQUIDISTANT, "k5", "k6", "p0", "p1", "s0", "s1", "s2", "s3")
    ),
    "SIMPLE_DIVISION": Model(12, 1, _PINHOLE, ("k",)),
    "DIVISION": Model(13, 2, _PINHOLE, ("k",)),
    "SIMPLE_FISHEYE": Model(14, 1, _FISHEYE),
    "FISHEYE": Model(15, 2, _FISHEYE),
    "EUCM": Model(16, 2, _PINHOLE, ("alpha", "beta")),
    "EQUIRECTANGULAR": Model(17, 0, _PINHOLE),  # Width and height once more.
}
"""A camera with a coefficient that its lens does not have, and that is not 0, has no lens here."""

FILES = ("cameras", "images", "points3D")
OTHER_FILES = ("rigs", "frames")
"""Names of the files of a model, without the suffix ``.txt`` or ``.bin``."""


class ImageRecord(NamedTuple):
    """An image: its pose, the number of its camera, its name, and how many points it saw."""

    quaternion: tuple[float, ...]
    translation: tuple[float, ...]
    camera: int
    name: str
    points: int


CameraRecord = tuple[str, tuple[int, int], tuple[float, ...]]
"""Model, size and parameters of a camera."""


def read_colmap(folder: Path, suffix: str, left_out: LeftOut) -> list[CalibratedCamera]:
    """Return the cameras of all images of a model, ``.txt`` or ``.bin``, in the file's order."""
    readers = _TEXT_READERS if suffix == ".txt" else _BINARY_READERS
    file = folder / f"cameras{suffix}"
    with reading(file, FORMAT):
        intrinsics: dict[int, Intrinsics | str] = {}
        for number, record in readers[0](file):
            if number in intrinsics:
                raise ValueError(f"it must have each camera once, got two of number {number}")
            intrinsics[number] = read_intrinsics(*record)
    file = folder / f"images{suffix}"
    with reading(file, FORMAT):
        return _join_images(readers[1](file), intrinsics, left_out)


def _join_images(
    images: list[ImageRecord], intrinsics: dict[int, Intrinsics | str], left_out: LeftOut
) -> list[CalibratedCamera]:
    """Return the cameras of images."""
    found = []
    for image in images:
        if image.camera not in intrinsics:
            raise ValueError(f"image {image.name!r} names camera {image.camera}, which is missing")
        left_out.note("point that an image saw", image.points)
        inner = intrinsics[image.camera]
        if isinstance(inner, str):
            left_out.note(f"image of a camera without a lens here, {inner}")
            continue
        try:
            pose = compose_trs(TRS().with_(image.translation, image.quaternion))
            found.append(join_camera(inner, pose, image.name))
        except ValueError as error:
            raise ValueError(f"image {image.name!r}: {error}") from None
    unused = intrinsics.keys() - {image.camera for image in images}
    left_out.note("camera without an image", len(unused))
    return check_any(found, left_out)


def read_intrinsics(
    model: str, size: tuple[int, int], parameters: tuple[float, ...]
) -> Intrinsics | str:
    """Return the intrinsics of a camera, or its model if no lens here stands for it."""
    if not all(map(math.isfinite, parameters)):
        raise ValueError(f"{model} must have finite parameters, got {parameters}")
    try:
        if model == "EQUIRECTANGULAR":
            return make_panorama(size, model)
        _, focals, kind, names = MODELS[model]
        fx, fy = parameters[0], parameters[focals - 1]
        cx, cy, *coefficients = parameters[focals:]
        return Intrinsics(size, fx, fy, 0.0, cx, cy, make_lens(kind, names, coefficients, model))
    except NoLensError as error:
        return str(error)


def _check_model(model: str, parameters: int) -> str:
    """Return the name of a model if it has so many parameters, or raise ``ValueError``."""
    if model not in MODELS:
        raise ValueError(f"camera model must be one of COLMAP's, got {model}")
    if parameters != MODELS[model].parameter_count:
        raise ValueError(
            f"{model} must have {MODELS[model].parameter_count} parameters, got {parameters}"
        )
    return model


def _read_text_cameras(file: Path) -> Iterator[tuple[int, CameraRecord]]:
    """Yield the number and record of each camera of ``cameras.txt``."""
    for words in (line.split() for line in file.read_text("utf-8").splitlines()):
        if words and not words[0].startswith("#"):
            if len(words) < 4:
                raise ValueError(f"a camera must have a number, a model and a size, got {words}")
            number, model, width, height, *parameters = words
            _check_model(model, len(parameters))
            size = int(width), int(height)
            yield int(number), (model, size, tuple(map(float, parameters)))


def _read_text_images(file: Path) -> list[ImageRecord]:
    """Return the records of ``images.txt``: two lines each, of which the second may be empty."""
    found = []
    lines = iter(file.read_text("utf-8").splitlines())
    for line in lines:
        if not line.strip() or line.startswith("#"):
            continue
        # A name may hold spaces.
        words = line.strip().split(maxsplit=9)
        if len(words) < 10:
            raise ValueError(
                "an image must have a number, 4 of its rotation, 3 of its translation, that of its "
                f"camera and a name, got {line.strip()!r}"
            )
        numbers = tuple(map(float, words[1:8]))
        points = len(next(lines, "").split())
        if points % 3:
            raise ValueError(f"image {words[9]!r}: points must have 3 numbers each, got {points}")
        image = ImageRecord(numbers[:4], numbers[4:], int(words[8]), words[9], points // 3)
        found.append(_with_quaternion_of_ours(image))
    return found


class _BinaryFile:
    """The content of a little-endian file, read from its beginning on."""

    def __init__(self, file: Path) -> None:
        self._content, self._at = file.read_bytes(), 0

    def take(self, layout: str) -> tuple[Any, ...]:
        """Return the next numbers."""
        return struct.unpack_from(
            f"<{layout}", self._content, self.skip(struct.calcsize(f"<{layout}"))
        )

    def skip(self, count: int) -> int:
        """Move on by bytes; return where they begin, or raise ``ValueError`` if they lack."""
        start, self._at = self._at, self._at + count
        if self._at > len(self._content):
            raise ValueError(f"it ends after {len(self._content)} bytes, before all that it counts")
        return start

    def take_name(self) -> str:
        """Return the next text, which a zero byte ends."""
        end = self._content.find(b"\0", self._at)
        start = self.skip(max(end, len(self._content) if end < 0 else end) + 1 - self._at)
        return self._content[start : self._at - 1].decode("utf-8")

    def end(self) -> None:
        """Raise ``ValueError`` if there is more."""
        if self._at < len(self._content):
            raise ValueError(f"it has {len(self._content) - self._at} bytes more than it counts")


def _read_binary_cameras(file: Path) -> Iterator[tuple[int, CameraRecord]]:
    """Yield the number and record of each camera of ``cameras.bin``."""
    content = _BinaryFile(file)
    names = {model.number: name for name, model in MODELS.items()}
    for _ in range(content.take("Q")[0]):
        number, model, width, height = content.take("IiQQ")
        if model not in names:
            raise ValueError(f"camera model must be one of COLMAP's, got number {model}")
        parameters = content.take(f"{MODELS[names[model]].parameter_count}d")
        yield number, (names[model], (width, height), parameters)
    content.end()


def _read_binary_images(file: Path) -> list[ImageRecord]:
    """Return the records of ``images.bin``."""
    content = _BinaryFile(file)
    found = []
    for _ in range(content.take("Q")[0]):
        _, *numbers, camera = content.take("I7dI")
        name = content.take_name()
        (points,) = content.take("Q")
        content.skip(points * struct.calcsize("<ddq"))
        image = ImageRecord(tuple(numbers[:4]), tuple(numbers[4:]), camera, name, points)
        found.append(_with_quaternion_of_ours(image))
    content.end()
    return found


def _with_quaternion_of_ours(image: ImageRecord) -> ImageRecord:
    """Return a record whose quaternion ends with w, where COLMAP's begins with it."""
    return image._replace(quaternion=(*image.quaternion[1:], image.quaternion[0]))


_TEXT_READERS = _read_text_cameras, _read_text_images
_BINARY_READERS = _read_binary_cameras, _read_binary_images


def write_binary(path: Path, cameras: Sequence[CalibratedCamera]) -> None:
    """Write a model without points to a folder, or to that of a file, or raise ``ValueError``."""
    _write(path, ".bin", cameras)


def write_text(path: Path, cameras: Sequence[CalibratedCamera]) -> None:
    """Write a model as text, as `write_binary` does."""
    _write(path, ".txt", cameras)


def _write(path: Path, suffix: str, cameras: Sequence[CalibratedCamera]) -> None:
    """Write a model, ``.txt`` or ``.bin``, or raise ``ValueError``."""
    numbers: dict[Intrinsics, int] = {}
    rows, images = [], []
    for camera in cameras:
        with naming(camera):
            has_name = camera.name and not (set(camera.name) & {"\0", "\n", "\r"})
            refuse(not has_name, f"it must have the name of its image for {FORMAT}, in one line")
            is_plain = suffix != ".txt" or camera.name.split() == [camera.name]
            refuse(not is_plain, f"it must have a name without spaces for {FORMAT}'s text")
            name = camera.name.encode()
            intrinsics, pose = split_camera(camera)
            refuse_skew(intrinsics, FORMAT)
            if intrinsics not in numbers:
                numbers[intrinsics] = len(numbers) + 1
                rows.append((numbers[intrinsics], intrinsics.size, *_model_of(intrinsics)))
        translation, (x, y, z, w), _ = decompose(pose)
        images.append(((w, x, y, z), translation, numbers[intrinsics], name))
    folder = path.parent if path.stem in FILES[:2] and path.suffix in (".txt", ".bin") else path
    _refuse_other_model(folder, suffix)
    contents = _make_text(rows, images) if suffix == ".txt" else _make_binary(rows, images)
    folder.mkdir(exist_ok=True)
    with ExitStack() as stack:
        places = [stack.enter_context(atomic_file(folder / f"{name}{suffix}")) for name in FILES]
        for place, content in zip(places, contents, strict=True):
            place.write_bytes(content)


def _refuse_other_model(folder: Path, suffix: str) -> None:
    """Raise ``ValueError`` if a folder holds files that new ones would contradict."""
    other = ".bin" if suffix == ".txt" else ".txt"
    names = [f"{name}{other}" for name in FILES]
    names += [f"{name}{end}" for name in OTHER_FILES for end in (".txt", ".bin")]
    for file in (folder / name for name in names):
        if file.exists():
            raise ValueError(f"path must be a folder without {file.name}, but {file} is there")
    points = folder / f"points3D{suffix}"
    if points.exists() and points.read_bytes() not in (_NO_POINTS_TEXT, _NO_POINTS_BINARY):
        raise ValueError(f"path must be a folder without points, but {points} holds some")


def _model_of(intrinsics: Intrinsics) -> tuple[str, tuple[float, ...]]:
    """Return the model of intrinsics and its parameters, or raise ``ValueError``."""
    (width, height), fx, fy, _, cx, cy, lens = intrinsics
    if isinstance(lens, Equirectangular):
        return "EQUIRECTANGULAR", (float(width), float(height))
    if lens is None:
        model = "PINHOLE"
    elif isinstance(lens, FisheyeLens):
        model = "OPENCV_FISHEYE"
    else:
        rest = any((lens.k3, lens.k4, lens.k5, lens.k6))
        model = "FULL_OPENCV" if rest else "OPENCV"
    return model, (fx, fy, cx, cy, *lens_coefficients(lens, MODELS[model].coefficients, FORMAT))


_NO_POINTS_TEXT = b"# 3D point list with one line of data per point: none\n"
_NO_POINTS_BINARY = struct.pack("<Q", 0)


def _make_text(rows: list[Any], images: list[Any]) -> tuple[bytes, ...]:
    """Return the contents of the three files, as text."""
    cameras = ["# Camera list: CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"]
    for number, size, model, parameters in rows:
        cameras.append(f"{number} {model} {size[0]} {size[1]} {' '.join(map(repr, parameters))}")
    listed = ["# Image list: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then POINTS2D[]"]
    for count, (rotation, translation, camera, name) in enumerate(images, 1):
        numbers = " ".join(map(repr, (*rotation, *translation)))
        listed += [f"{count} {numbers} {camera} {name.decode()}", ""]
    return *("\n".join([*lines, ""]).encode() for lines in (cameras, listed)), _NO_POINTS_TEXT


def _make_binary(rows: list[Any], images: list[Any]) -> tuple[bytes, ...]:
    """Return the contents of the three files, as binary."""
    cameras = [struct.pack("<Q", len(rows))]
    for number, size, model, parameters in rows:
        layout = f"<IiQQ{len(parameters)}d"
        cameras.append(struct.pack(layout, number, MODELS[model].number, *size, *parameters))
    listed = [struct.pack("<Q", len(images))]
    for count, (rotation, translation, camera, name) in enumerate(images, 1):
        listed.append(struct.pack("<I7dI", count, *rotation, *translation, camera))
        listed.append(name + b"\0" + struct.pack("<Q", 0))
    return b"".join(cameras), b"".join(listed), _NO_POINTS_BINARY
