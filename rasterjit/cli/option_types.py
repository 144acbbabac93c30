"""Types of option values: functions that parse a text, each wrapped as a click type."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

from rasterjit.cli.help import CHOICE_SYNONYMS, suggest_words
from rasterjit.outputs.output_table import MOTION_OUTPUTS, OUTPUTS, check_outputs
from rasterjit.scene.colormap import Colormap
from rasterjit.scene.norm import parse_percent
from rasterjit.scene.quality import parse_setting

if TYPE_CHECKING:
    from rasterjit.io.camera_files.calibration import CalibratedCamera
    from rasterjit.scene.background import BackgroundImage
    from rasterjit.scene.camera import MatrixCamera
    from rasterjit.scene.contours import Contours
    from rasterjit.scene.lens import Lens
    from rasterjit.scene.scene import Scene

Vector = tuple[float, float, float]

LIGHT_NAMES = ("headlight", "sun", "ambient")
"""Lights by name: the default headlight, one from above, and ambient."""


class TextType(click.ParamType):
    """
    A click type from a parsing function; its ``ValueError`` becomes a usage error.

    Parameters
    ----------
    name : str
        How the help names a value.
    read : callable
        From a text to the value. What is no text is a value already.
    """

    def __init__(self, name: str, read: Callable[[str], Any]) -> None:
        self.name, self.read = name, read

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> Any:
        """Return the value, or raise click's usage error."""
        if not isinstance(value, str):
            return value
        try:
            return self.read(value)
        except ValueError as error:
            self.fail(str(error), parameter, context)


def text_type(name: str) -> Callable[[Callable[[str], Any]], TextType]:
    """Return a decorator that makes a `TextType` of a function that reads a text."""
    return partial(TextType, name)


class FiniteNumberType(click.types.FloatParamType):
    """A finite number."""

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> float:
        """Return the number, or raise click's usage error."""
        number = super().convert(value, parameter, context)
        if not math.isfinite(number):
            self.fail(f"{value!r} must be finite", parameter, context)
        return number


class FiniteType(FiniteNumberType, click.FloatRange):
    """A finite number in a range."""


def parse_numbers(text: str, count: int, expected: str) -> tuple[float, ...]:
    """
    Return the comma-separated finite numbers of a text.

    Raises
    ------
    ValueError
        There are not so many, or not all are finite; it says what was expected.
    """
    try:
        numbers = tuple(float(part) for part in text.split(","))
        if len(numbers) != count:
            raise ValueError
    except ValueError:
        raise ValueError(f"{text!r} is {expected}") from None
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"{text!r} must be finite")
    return numbers


@text_type("size")
def size_type(text: str) -> tuple[int, int]:
    """Return width and height of ``640x480``."""
    from rasterjit.scene.validation import image_size

    sides = re.fullmatch(r"([0-9]{1,9})x([0-9]{1,9})", text.strip().lower())
    if sides is None:
        raise ValueError(f"{text!r} is not WIDTHxHEIGHT, such as 1280x720")
    try:
        return image_size("size", (int(sides[1]), int(sides[2])))
    except ValueError:
        raise ValueError(f"{text!r}: both sides must be in 1..16384 pixels") from None


@text_type("format")
def format_type(text: str) -> str:
    """Return the suffix of a picture format: ``".png"`` for ``png``."""
    from rasterjit.io.images import IMAGE_FORMATS

    suffix = f".{text.strip().lower().removeprefix('.')}"
    if suffix not in IMAGE_FORMATS:
        raise ValueError(f"{text!r} is none of {', '.join(one[1:] for one in IMAGE_FORMATS)}")
    return suffix


@text_type("X,Y")
def pixel_type(text: str) -> tuple[int, int]:
    """Return column and row of a pixel, ``320,240``."""
    place = re.fullmatch(r"([0-9]{1,9}),([0-9]{1,9})", text.replace(" ", ""))
    if place is None:
        raise ValueError(f"{text!r} is not X,Y, a column and a row such as 320,240")
    return int(place[1]), int(place[2])


@text_type("lens")
def lens_type(text: str) -> Lens:
    """Return a lens by its model and OpenCV's coefficients: ``fisheye:-0.02,0.003``."""
    from rasterjit.scene import lens

    models = {
        "opencv": (lens.PinholeDistortion, 14),
        "fisheye": (lens.FisheyeLens, 4),
        "panorama": (lens.Equirectangular, 0),
    }
    model, _, rest = text.partition(":")
    try:
        kind, most = models[model]
        numbers = [float(part) for part in rest.split(",")] if rest else []
    except (KeyError, ValueError):
        raise ValueError(
            f"{text!r} is not opencv:K1,K2,P1,P2,..., fisheye:K1,K2,K3,K4 or panorama"
        ) from None
    if len(numbers) > most:
        raise ValueError(f"{text!r}: {model} has at most {most} coefficients, got {len(numbers)}")
    try:
        return kind(*numbers)
    except ValueError as error:
        raise ValueError(f"{text!r}: {error}") from None


@text_type("X,Y,Z")
def vector_type(text: str) -> tuple[float, ...]:
    """Return three numbers, ``1,2.5,-3``."""
    return parse_numbers(text, 3, "not X,Y,Z, such as 1,2.5,-3")


@text_type("X,Y,Z|AXIS")
def up_type(text: str) -> tuple[float, ...]:
    """Return a direction of three numbers or an axis: ``0,0,1``, ``z``, ``-x``."""
    axis = re.fullmatch(r"([+-]?)([xyz])", text.replace(" ", "").lower())
    if axis is not None:
        length = -1.0 if axis[1] == "-" else 1.0
        return tuple(length if axis[2] == name else 0.0 for name in "xyz")
    if "," not in text:
        raise ValueError(f"{text!r} is neither an axis, such as z or -y, nor X,Y,Z")
    return vector_type.read(text)


@text_type("plane")
def plane_type(text: str) -> tuple[float, ...]:
    """Return point and normal of a plane, ``x=0.5``, ``-x=0.5`` or ``X,Y,Z,NX,NY,NZ``."""
    expected = "neither AXIS=PLACE, such as x=0.5 or -z=0, nor X,Y,Z,NX,NY,NZ"
    axis = re.fullmatch(r"(-?)([xyz])=(.+)", text.replace(" ", "").lower())
    if axis is None:
        numbers = parse_numbers(text, 6, expected)
    else:
        try:
            place = float(axis[3])
        except ValueError:
            raise ValueError(f"{text!r} is {expected}") from None
        if not math.isfinite(place):
            raise ValueError(f"{text!r} must be finite")
        normal = -1.0 if axis[1] else 1.0
        numbers = tuple(
            value if axis[2] == name else 0.0 for value in (place, normal) for name in "xyz"
        )
    if not any(numbers[3:]):
        raise ValueError(f"{text!r} must have a normal that is not zero")
    return numbers


@text_type("LOW,HIGH|P%")
def range_type(text: str) -> tuple[float, ...] | str:
    """Return two numbers, the lower one first, ``0,1.5``, or a share of the values, ``2%``."""
    if text.endswith("%"):
        parse_percent(text)
        return text
    low, high = parse_numbers(text, 2, "not LOW,HIGH, such as 0,1.5")
    if low > high:
        raise ValueError(f"{text!r} must be finite, the lower one first")
    return low, high


@text_type("NAME")
def colormap_type(text: str) -> Colormap:
    """Return the colour map of a name."""
    try:
        return Colormap(text)
    except ValueError as error:
        raise ValueError(str(error).removeprefix("colormap ")) from None


@text_type("N|VALUES")
def contours_type(text: str) -> Contours:
    """Return the number of contour lines, ``10``, or their values, ``0.5,1.5`` (one: ``0.5,``)."""
    from rasterjit.scene.contours import Contours

    try:
        if re.fullmatch(r"\s*[+-]?[0-9]+\s*", text):
            return Contours(int(text))
        return Contours([float(part) for part in text.removesuffix(",").split(",")])
    except ValueError as error:
        said = str(error).removeprefix("contours.")
        if not said.startswith("levels"):
            said = "expected a number of lines, 10, or their values, 0.5,1.5"
        raise ValueError(f"{text!r}: {said}") from None


@text_type("X,Y,Z|NAME")
def light_type(text: str) -> tuple[float, ...] | str:
    """Return the direction in which a light shines, ``1,-2,0.5``, or a name of `LIGHT_NAMES`."""
    if text in LIGHT_NAMES:
        return text
    if not set(text) & set("0123456789"):
        meant = suggest_words(text, list(LIGHT_NAMES), CHOICE_SYNONYMS)
        raise ValueError(f"{text!r} is neither X,Y,Z nor one of {', '.join(LIGHT_NAMES)}{meant}")
    direction = vector_type.read(text)
    if not any(direction):
        raise ValueError(f"{text!r} must not be 0,0,0")
    return direction


@text_type("color")
def color_type(text: str, is_opaque: bool = False) -> str:
    """Return a colour as it was written, checked; with ``is_opaque``, refuse transparency."""
    from rasterjit.scene.color import linear_color

    if linear_color("it", text)[3] < 1.0 and is_opaque:
        raise ValueError(f"{text!r} must be opaque")
    return text


opaque_color_type = TextType("color", partial(color_type.read, is_opaque=True))


@text_type("color|file")
def background_type(text: str) -> str | BackgroundImage:
    """Return a colour as it was written, or the picture in a file."""
    from rasterjit.scene.background import BackgroundImage, is_file_name

    return BackgroundImage.from_file(text) if is_file_name(text) else color_type.read(text)


def split_names(text: str) -> list[str]:
    """Return the comma-separated names of a text."""
    return [name.strip() for name in text.split(",")]


@text_type("names")
def outputs_type(text: str) -> tuple[str, ...]:
    """Return names of outputs, ``color,depth``."""
    from rasterjit.scene.validation import suggest as asked_of_names

    names = split_names(text)
    unknown = next((name for name in names if name and name not in OUTPUTS), None)
    try:
        outputs = check_outputs(names)
    except ValueError as error:
        if unknown is None:
            raise
        # Suggest by the names of other programs as well.
        meant = suggest_words(unknown, list(OUTPUTS), CHOICE_SYNONYMS)
        said = str(error).removesuffix(asked_of_names(unknown, OUTPUTS)) if meant else error
        raise ValueError(f"{said}{meant}") from None
    for name in MOTION_OUTPUTS:
        if name in outputs:
            raise ValueError(
                f"{name} is found against an earlier view, which rasterjit.render takes"
            )
    return outputs


setting_type = TextType("NAME=LEVEL", parse_setting)


@text_type("names")
def knobs_type(text: str) -> tuple[str, ...]:
    """Return names of accuracy settings, ``samples,shading``."""
    from rasterjit.accuracy.settings_to_try import check_knobs

    return check_knobs(split_names(text))


@text_type("name")
def made_scene_type(text: str) -> str:
    """Return the name of a built-in scene."""
    from rasterjit.accuracy.test_scenes import SCENES

    if text not in SCENES:
        raise ValueError(f"{text!r} is none of {', '.join(SCENES)}")
    return text


def file_type(kind: str) -> TextType:
    """Return the type of files of a kind to write: "image", "drawing", "depth", "mask" ...."""
    return TextType("file", partial(check_file, kind))


def check_file(kind: str, text: str) -> Path:
    """
    Return the path of a file to write.

    Raises
    ------
    ValueError
        The kind has no such format, or nothing can be written there.
    """
    place, formats = Path(text), list_formats(kind)
    if place.suffix.lower() not in formats:
        raise ValueError(f"{text!r} must end in one of {', '.join(formats)}")
    if not place.parent.is_dir():
        raise ValueError(f"the folder {str(place.parent)!r} does not exist")
    if not os.access(place.parent, os.W_OK):
        raise ValueError(f"the folder {str(place.parent)!r} is not writable")
    if place.is_dir():
        raise ValueError(f"{text!r} is a folder")
    if place.suffix.lower() == ".exr" and find_spec("OpenEXR") is None:
        raise ValueError('.exr needs OpenEXR; pip install "rasterjit[exr]"')
    return place


def list_formats(kind: str) -> tuple[str, ...]:
    """Return the extensions of a kind of file."""
    from rasterjit.animation import video
    from rasterjit.hidden_lines import graphics
    from rasterjit.io import images
    from rasterjit.outputs import save

    return {
        "image": (*images.IMAGE_FORMATS, ".npz", ".exr"),
        "drawing": graphics.FORMATS,
        "depth": save.FORMATS,
        "mask": (".png",),
        "animation": video.ANIMATION_FORMATS,
    }[kind]


Float64 = NDArray[np.float64]

CONVENTIONS = {
    "opencv": "camera from world; x right, y down, z forward: OpenCV's R|t, COLMAP",
    "opencv-c2w": "world from camera with these axes: ScanNet, TUM",
    "opengl": "camera from world; x right, y up, z back: a view matrix",
    "opengl-c2w": "world from camera with these axes: NeRF, Blender, pyrender",
}
"""Spaces that a pose maps between, and the axes of the camera."""

MAX_COLUMN_SCALE_ERROR = 1e-3
"""Tolerance of the lengths of a rotation's columns from 1, for rounded files."""

MAX_NAMES = 5
"""Most images that a message lists."""

MAX_MATRIX_FILE_BYTES = 1 << 20
"""Most bytes of a file of a matrix."""


@text_type("pose")
def pose_type(text: str) -> Float64:
    """Return the pose of a camera, (4, 4): rows of a 4x4 or 3x4 matrix, or a file of them."""
    wanted = "the 16 or 12 numbers of a 4x4 or 3x4 matrix, row by row"
    numbers = _read_matrix(text, "pose", (16, 12), wanted)
    return np.vstack([numbers.reshape(-1, 4), np.eye(4)[len(numbers) // 4 :]])


@text_type("intrinsics")
def intrinsics_type(text: str) -> Float64:
    """Return the matrix K, (3, 3), of its numbers, of FX,FY,CX,CY, or of a file of either."""
    from rasterjit.io.cameras import intrinsic_matrix

    wanted = "FX,FY,CX,CY or the 9 numbers of a 3x3 matrix K"
    numbers = _read_matrix(text, "intrinsics", (9, 4), wanted)
    if numbers.size == 4:
        fx, fy, cx, cy = numbers.tolist()
        numbers = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
    try:
        return intrinsic_matrix("it", numbers.reshape(3, 3))
    except ValueError as error:
        raise ValueError(f"{text!r}: {error}") from None


def load_camera(text: str, size: tuple[int, int] | None) -> CalibratedCamera:
    """Return the camera of ``FILE`` or ``FILE:IMAGE``; the size is for files that tell none."""
    from rasterjit.io.camera_files import load_cameras

    file, image = (text, "") if Path(text).exists() else text.rpartition(":")[::2]
    cameras = load_cameras(file or text, size=size)
    found = [one for one in cameras if not image or one.name == image]
    # Names go first: they may be numbers.
    found = found or [one for number, one in enumerate(cameras) if str(number) == image]
    if len(found) == 1:
        return found[0]
    names = ", ".join(one.name or str(number) for number, one in enumerate(cameras[:MAX_NAMES]))
    more = f" and {len(cameras) - MAX_NAMES} more" if len(cameras) > MAX_NAMES else ""
    raise ValueError(f"{text!r} must be FILE:IMAGE, an image of {names}{more}, or its number")


def _read_matrix(text: str, key: str, counts: tuple[int, ...], wanted: str) -> Float64:
    """Return the finite numbers of a text or a file, if their number is in ``counts``."""
    try:
        numbers = _try_parse_numbers(text)
        if numbers is None:
            numbers = _read_numbers(Path(text), key)
    except (ValueError, OSError) as error:
        raise ValueError(f"{text!r} must be {wanted}, or a file of them: {error}") from None
    if numbers.size not in counts:
        raise ValueError(f"{text!r} must be {wanted}, got {numbers.size} numbers")
    if not np.isfinite(numbers).all():
        raise ValueError(f"{text!r} must be finite")
    return numbers


def convert_pose(pose: Float64, convention: str) -> Float64:
    """
    Return OpenCV's ``camera_from_world`` of a pose, (4, 4).

    Raises
    ------
    ValueError
        If the pose is not one of a camera: it mirrors, shears or scales.
    """
    from rasterjit.io.camera_files.calibration import FLIP_YZ
    from rasterjit.io.cameras import view_from_pose
    from rasterjit.scene.transforms import compose, inverse
    from rasterjit.scene.vectors import length

    lengths = [length(column) for column in pose[:3, :3].T.tolist()]
    if any(abs(one - 1.0) > MAX_COLUMN_SCALE_ERROR for one in lengths):
        raise ValueError(
            "--pose must turn and move the camera, not scale: its first three columns have lengths "
            f"{', '.join(f'{one:.6g}' for one in lengths)}"
        )
    world_from_camera = pose if convention.endswith("-c2w") else inverse(pose)
    if convention.startswith("opencv"):
        world_from_camera = compose(world_from_camera, FLIP_YZ)
    return compose(FLIP_YZ, view_from_pose(world_from_camera, "--pose"))


def make_intrinsics(fov_y: float, size: tuple[int, int]) -> Float64:
    """Return K, (3, 3), of a camera without them, as OpenCV has it; ``fov_y`` in degrees."""
    from rasterjit.scene.transforms import focal_length

    width, height = size
    focal = focal_length(fov_y) * height / 2.0
    middle = (width - 1.0) / 2.0, (height - 1.0) / 2.0
    return np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])


def make_camera(
    intrinsics: Float64, camera_from_world: Float64, size: tuple[int, int], scene: Scene
) -> MatrixCamera:
    """Return the camera of OpenCV's K and pose, with near and far planes around a scene."""
    from rasterjit.io.cameras import from_opencv
    from rasterjit.scene.camera_fitting import choose_near_plane, to_triple
    from rasterjit.scene.transforms import apply
    from rasterjit.scene.vectors import length

    center, radius = scene.bounding_sphere()
    distance = length(to_triple(apply(camera_from_world, center)))
    near = choose_near_plane(distance, radius) or 1.0
    try:
        return from_opencv(intrinsics, size, camera_from_world=camera_from_world, near=near)
    except ValueError as error:
        said = re.sub(r"\b(intrinsics|clip_from_view)\b", "--intrinsics", str(error))
        raise ValueError(said) from error


def _try_parse_numbers(text: str) -> Float64 | None:
    """Return the numbers of a text, or None if any part is not a number."""
    words = re.split(r"[\s,;\[\]]+", text.strip().strip("[]").strip())
    try:
        return np.array([float(word) for word in words if word], np.float64)
    except ValueError:
        return None


def _read_numbers(file: Path, key: str) -> Float64:
    """Return the numbers of a ``.npy``, ``.json`` or text file, or raise ``ValueError``."""
    if not file.is_file():
        raise ValueError("there is no such file")
    if file.stat().st_size > MAX_MATRIX_FILE_BYTES:
        raise ValueError(f"it has more than {MAX_MATRIX_FILE_BYTES} bytes")
    if file.suffix.lower() == ".npy":
        return np.asarray(np.load(file, allow_pickle=False), np.float64).ravel()
    text = file.read_text(encoding="utf-8")
    if file.suffix.lower() == ".json":
        return _parse_json_numbers(json.loads(text), key)
    numbers = _try_parse_numbers("\n".join(line.partition("#")[0] for line in text.splitlines()))
    if numbers is None:
        raise ValueError("it holds other things than numbers")
    return numbers


def _parse_json_numbers(held: Any, key: str) -> Float64:
    """Return the numbers of a list (of rows), or of an object's value under a key."""
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
