"""Options that commands share: read them, check them, make camera, look and effects of them."""

from __future__ import annotations

import dataclasses
import math
import os
import re
from abc import abstractmethod
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import click
import numpy as np
from click.core import ParameterSource
from numpy.typing import NDArray

from rasterjit.cli.advice import CHOICES_MEANT, question
from rasterjit.cli.pinhole import CONVENTIONS, IntrinsicsType, PoseType
from rasterjit.cli.report import warn
from rasterjit.outputs.table import MOTION_OUTPUTS, OUTPUTS, check_outputs
from rasterjit.scene.colormap import COLORMAPS, REVERSED, Colormap
from rasterjit.scene.eye_dome import STRONGEST, EyeDome
from rasterjit.scene.material import SHADINGS, Material
from rasterjit.scene.memory import DEFAULT_MAX_BYTES
from rasterjit.scene.quality import LEVELS, PRESETS, Quality
from rasterjit.scene.tone_map import CURVES, MOST_STOPS

if TYPE_CHECKING:
    from rasterjit.io.foreign.codecs import Isolation
    from rasterjit.scene.background import BackgroundImage
    from rasterjit.scene.camera import MatrixCamera, OrthographicCamera, PerspectiveCamera
    from rasterjit.scene.contours import Contours
    from rasterjit.scene.framing import AnyCamera
    from rasterjit.scene.keyframes import Animation
    from rasterjit.scene.lens import Lens
    from rasterjit.scene.light import Light
    from rasterjit.scene.scene import Scene
    from rasterjit.scene.section import SectionPlane
    from rasterjit.styles.style import Style

    FittedCamera = PerspectiveCamera | OrthographicCamera

Vector = tuple[float, float, float]
Options = TypeVar("Options", bound=tuple)

OUTPUTS_HELP = (
    "What to write, separated by commas: "
    f"{', '.join(name for name in OUTPUTS if name not in MOTION_OUTPUTS)}, attribute:NAME."
)

DEFAULT_DIRECTION = (-0.4, 0.6, 1.0)
"""From the scene towards the camera, for y up: that of ``fit_camera``."""
DEFAULT_AZIMUTH, DEFAULT_ELEVATION = -22.0, 29.0
"""The same in whole degrees, for when one of the two is given."""
DEFAULT_FOV, PLACED_FOV = 28.0, 45.0
"""Degrees: of cameras that fit the scene, and of those whose position or pose is given."""

SAMPLES = tuple(str(level) for level in LEVELS["samples"])
"""Choices of ``Quality.samples``."""

SKY = "sky"
"""What stands for the default gradient where a picture of the environment is asked for."""

SUN_DIRECTION = (-0.6, -1.0, -0.5)
SUN_INTENSITY = 0.9
FILL_INTENSITY = 0.15
"""The sun that casts shadows in a scene without lights, and the ambient light beside it."""

AMBIENT_INTENSITY = 1.0
"""Of the ambient light that is asked for by name: alone, it shows colours as they are."""

LIGHTS = ("headlight", "sun", "ambient")
"""Lights with a name: the default one, over the viewer's shoulder; one from above; all around."""


STYLES = ("studio", "plain", "clay", "technical", "xray", "depth", "normals", "wireframe")
"""Names of ``rasterjit.styles``, the default first."""

OF_QUALITY = ("preset", "changes", "samples")
"""Options that say how accurately to render."""

PAINTED = STYLES[2:]
"""Those with colours of their own."""

WITH_LAMP = ("studio", "clay")
"""Those that bring a lamp, whose shadow is always there, to scenes without light."""

OF_PAINT = ("color", "scalars", "shading")
"""Options of colours that these replace."""

READING = ("on_invalid", "on_damage", "resource_root", "max_bytes", "isolate")
"""Options of how files are read."""

OF_SCALARS = ("colormap", "scalar_range", "contours")
"""Options that say how scalars are shown."""

OF_COLOR = (
    "style",
    "background",
    "color",
    *OF_SCALARS,
    "light",
    "shading",
    "shadows",
    "environment",
    "ambient_occlusion",
    "eye_dome",
)
"""Options that act on colour alone, in light or codes."""

OF_CODES = (
    "tone_map", "exposure", "outline", "vignette", "wireframe", "wireframe_color", "section_lines",
)  # fmt: skip
"""Options that act on 8-bit colour alone."""


class SizeType(click.ParamType):
    """Width and height, ``640x480``."""

    name = "size"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> tuple[int, int]:
        """Return (width, height), or raise click's usage error."""
        from rasterjit.scene.validation import image_size

        if isinstance(value, tuple):
            return value
        sides = re.fullmatch(r"([0-9]{1,9})x([0-9]{1,9})", value.strip().lower())
        if sides is None:
            self.fail(f"{value!r} is not WIDTHxHEIGHT, such as 1280x720", parameter, context)
        try:
            return image_size("size", (int(sides[1]), int(sides[2])))
        except ValueError:
            self.fail(f"{value!r}: both sides must be in 1..16384 pixels", parameter, context)


class FormatType(click.ParamType):
    """A format of pictures, ``png``."""

    name = "format"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> str:
        """Return the suffix, ``".png"``, or raise click's usage error."""
        from rasterjit.io.images import IMAGE_FORMATS

        suffix = f".{value.strip().lower().removeprefix('.')}"
        if suffix not in IMAGE_FORMATS:
            known = ", ".join(one[1:] for one in IMAGE_FORMATS)
            self.fail(f"{value!r} is none of {known}", parameter, context)
        return suffix


class PixelType(click.ParamType):
    """Column and row of a pixel, ``320,240``."""

    name = "X,Y"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> tuple[int, int]:
        """Return (column, row), or raise click's usage error."""
        if isinstance(value, tuple):
            return value
        place = re.fullmatch(r"([0-9]{1,9}),([0-9]{1,9})", value.replace(" ", ""))
        if place is None:
            self.fail(
                f"{value!r} is not X,Y, a column and a row such as 320,240", parameter, context
            )
        return int(place[1]), int(place[2])


class LensType(click.ParamType):
    """A lens by its model, and OpenCV's coefficients: ``fisheye:-0.02,0.003``."""

    name = "lens"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> Lens:
        """Return the lens, or raise click's usage error."""
        from rasterjit.scene import lens

        if not isinstance(value, str):
            return value
        models = {
            "opencv": (lens.PinholeDistortion, 14),
            "fisheye": (lens.FisheyeLens, 4),
            "panorama": (lens.Equirectangular, 0),
        }
        model, _, rest = value.partition(":")
        try:
            kind, most = models[model]
            numbers = [float(part) for part in rest.split(",")] if rest else []
        except (KeyError, ValueError):
            self.fail(
                f"{value!r} is not opencv:K1,K2,P1,P2,..., fisheye:K1,K2,K3,K4 or panorama",
                parameter, context,
            )  # fmt: skip
        if len(numbers) > most:
            self.fail(
                f"{value!r}: {model} has at most {most} coefficients, got {len(numbers)}",
                parameter, context,
            )  # fmt: skip
        try:
            return kind(*numbers)
        except ValueError as error:
            self.fail(f"{value!r}: {error}", parameter, context)


class VectorType(click.ParamType):
    """Three numbers, ``1,2.5,-3``."""

    name = "X,Y,Z"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> Vector:
        """Return the three numbers, or raise click's usage error."""
        if isinstance(value, tuple):
            return value
        try:
            x, y, z = (float(part) for part in value.split(","))
        except ValueError:
            self.fail(f"{value!r} is not X,Y,Z, such as 1,2.5,-3", parameter, context)
        if not all(map(math.isfinite, (x, y, z))):
            self.fail(f"{value!r} must be finite", parameter, context)
        return x, y, z


class UpType(VectorType):
    """A direction as three numbers, or an axis: ``0,0,1``, ``z``, ``-x``."""

    name = "X,Y,Z|AXIS"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> Vector:
        """Return the three numbers, or raise click's usage error."""
        text = value.replace(" ", "").lower() if isinstance(value, str) else ""
        axis = re.fullmatch(r"([+-]?)([xyz])", text)
        if axis is not None:
            length = -1.0 if axis[1] == "-" else 1.0
            x, y, z = (length if axis[2] == name else 0.0 for name in "xyz")
            return x, y, z
        if isinstance(value, str) and "," not in value:
            self.fail(f"{value!r} is neither an axis, such as z or -y, nor X,Y,Z", parameter,
                      context)  # fmt: skip
        return super().convert(value, parameter, context)


class PlaneType(click.ParamType):
    """A plane that cuts: ``x=0.5``, ``-x=0.5``, or a point and a normal, ``X,Y,Z,NX,NY,NZ``."""

    name = "plane"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> tuple[float, ...]:
        """Return the point and the normal, six numbers, or raise click's usage error."""
        if isinstance(value, tuple):
            return value
        text = value.replace(" ", "").lower()
        axis = re.fullmatch(r"(-?)([xyz])=(.+)", text)
        try:
            if axis is not None:
                place, number = "xyz".index(axis[2]), float(axis[3])
                numbers = [0.0] * 6
                numbers[place], numbers[3 + place] = number, -1.0 if axis[1] else 1.0
            else:
                numbers = [float(part) for part in text.split(",")]
                if len(numbers) != 6:
                    raise ValueError
        except ValueError:
            self.fail(
                f"{value!r} is neither AXIS=PLACE, such as x=0.5 or -z=0, nor X,Y,Z,NX,NY,NZ",
                parameter, context,
            )  # fmt: skip
        if not all(map(math.isfinite, numbers)):
            self.fail(f"{value!r} must be finite", parameter, context)
        if not any(numbers[3:]):
            self.fail(f"{value!r} must have a normal that is not zero", parameter, context)
        return tuple(numbers)


class RangeType(click.ParamType):
    """Two numbers, the lower one first, ``0,1.5``."""

    name = "LOW,HIGH"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> tuple[float, float]:
        """Return the two numbers, or raise click's usage error."""
        if isinstance(value, tuple):
            return value
        try:
            low, high = (float(part) for part in value.split(","))
        except ValueError:
            self.fail(f"{value!r} is not LOW,HIGH, such as 0,1.5", parameter, context)
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            self.fail(f"{value!r} must be finite, the lower one first", parameter, context)
        return low, high


class ColormapType(click.ParamType):
    """The name of a colour map."""

    name = "NAME"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> Colormap:
        """Return the map, or raise click's usage error."""
        if isinstance(value, Colormap):
            return value
        try:
            return Colormap(value)
        except ValueError as error:
            self.fail(str(error).removeprefix("colormap "), parameter, context)


class ContoursType(click.ParamType):
    """How many lines, ``10``, or their values, ``0.5,1.5``; of one line ``0.5,``."""

    name = "N|VALUES"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> Contours:
        """Return the contours, or raise click's usage error."""
        from rasterjit.scene.contours import Contours

        if isinstance(value, Contours):
            return value
        try:
            if re.fullmatch(r"\s*[+-]?[0-9]+\s*", value):
                return Contours(int(value))
            return Contours([float(part) for part in value.removesuffix(",").split(",")])
        except ValueError as error:
            said = str(error).removeprefix("contours.")
            if not said.startswith("levels"):
                said = "expected a number of lines, 10, or their values, 0.5,1.5"
            self.fail(f"{value!r}: {said}", parameter, context)


class LightType(VectorType):
    """The direction in which a light shines, ``1,-2,0.5``, or a name of `LIGHTS`."""

    name = "X,Y,Z|NAME"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> Vector | str:
        """Return the direction or the name, or raise click's usage error."""
        if value in LIGHTS:
            return value
        if isinstance(value, str) and not set(value) & set("0123456789"):
            names = ", ".join(LIGHTS)
            self.fail(
                f"{value!r} is neither X,Y,Z nor one of {names}"
                + question(value, list(LIGHTS), CHOICES_MEANT),
                parameter,
                context,
            )
        direction = super().convert(value, parameter, context)
        if direction == (0.0, 0.0, 0.0):
            self.fail(f"{value!r} must not be 0,0,0", parameter, context)
        return direction


class FiniteNumberType(click.types.FloatParamType):
    """A number that is not infinite nor NaN."""

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> float:
        """Return the number, or raise click's usage error."""
        number = super().convert(value, parameter, context)
        if not math.isfinite(number):
            self.fail(f"{value!r} must be finite", parameter, context)
        return number


class FiniteType(FiniteNumberType, click.FloatRange):
    """Such a number, in a range."""


class ColorType(click.ParamType):
    """
    A colour, checked but kept as it was written.

    Parameters
    ----------
    is_opaque : bool
        Whether it has to be one that nothing is seen through.
    """

    name = "color"

    def __init__(self, is_opaque: bool = False) -> None:
        self.is_opaque = is_opaque

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> str:
        """Return the text, or raise click's usage error."""
        from rasterjit.scene.color import linear_color

        try:
            alpha = linear_color("it", value)[3]
        except ValueError as error:
            self.fail(str(error), parameter, context)
        if self.is_opaque and alpha < 1.0:
            self.fail(f"{value!r} must be opaque", parameter, context)
        return value


class BackgroundType(ColorType):
    """A colour, kept as it was written, or the picture that a file holds."""

    name = "color|file"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> str | BackgroundImage:
        """Return the text or the picture, or raise click's usage error."""
        from rasterjit.scene.background import BackgroundImage, is_file_name

        if not is_file_name(value):
            return (
                value
                if isinstance(value, BackgroundImage)
                else super().convert(value, parameter, context)
            )
        try:
            return BackgroundImage.from_file(value)
        except ValueError as error:
            self.fail(str(error), parameter, context)


class NamesType(click.ParamType):
    """Names between commas, each kind with a check of its own."""

    name = "names"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> tuple[str, ...]:
        """Return the names, or raise click's usage error."""
        if isinstance(value, tuple):
            return value
        try:
            return self.check([name.strip() for name in value.split(",")])
        except ValueError as error:
            self.fail(str(error), parameter, context)

    @abstractmethod
    def check(self, names: list[str]) -> tuple[str, ...]:
        """Return the names, or raise ``ValueError``."""


class OutputsType(NamesType):
    """Names of outputs, ``color,depth``."""

    def check(self, names: list[str]) -> tuple[str, ...]:
        """Return the names, or raise ``ValueError``."""
        from rasterjit.scene.validation import question as asked_of_names

        unknown = next((name for name in names if name and name not in OUTPUTS), None)
        try:
            outputs = check_outputs(names)
        except ValueError as error:
            if unknown is None:
                raise
            # The command line's question knows the names of other programs as well.
            meant = question(unknown, list(OUTPUTS), CHOICES_MEANT)
            said = str(error).removesuffix(asked_of_names(unknown, OUTPUTS)) if meant else error
            raise ValueError(f"{said}{meant}") from None
        for name in MOTION_OUTPUTS:
            if name in outputs:
                raise ValueError(
                    f"{name} is found against an earlier view, which rasterjit.render takes"
                )
        return outputs


class SettingType(click.ParamType):
    """An accuracy setting and its level, ``samples=8``."""

    name = "NAME=LEVEL"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> dict[str, Any]:
        """Return ``{name: level}``, or raise click's usage error."""
        from rasterjit.scene.quality import parse_setting

        if isinstance(value, dict):
            return value
        try:
            return parse_setting(value)
        except ValueError as error:
            self.fail(str(error), parameter, context)


class KnobsType(NamesType):
    """Names of accuracy settings, ``samples,shading``."""

    def check(self, names: list[str]) -> tuple[str, ...]:
        """Return the names, or raise ``ValueError``."""
        from rasterjit.accuracy.knobs import check_knobs

        return check_knobs(names)


class MadeSceneType(click.ParamType):
    """The name of a scene that is made, not read."""

    name = "name"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> str:
        """Return the name, or raise click's usage error."""
        from rasterjit.accuracy.scenes import SCENES

        if value not in SCENES:
            self.fail(f"{value!r} is none of {', '.join(SCENES)}", parameter, context)
        return value


class PlaceType(click.ParamType):
    """
    A file to write: its format is known and its folder can be written to.

    Parameters
    ----------
    kind : {"image", "depth", "mask", "animation"}
    """

    name = "file"

    def __init__(self, kind: str) -> None:
        self.kind = kind

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> Path:
        """Return the path, or raise click's usage error."""
        place, formats = Path(value), _formats(self.kind)
        if place.suffix.lower() not in formats:
            self.fail(f"{value!r} must end in one of {', '.join(formats)}", parameter, context)
        if not place.parent.is_dir():
            self.fail(f"the folder {str(place.parent)!r} does not exist", parameter, context)
        if not os.access(place.parent, os.W_OK):
            self.fail(f"the folder {str(place.parent)!r} is not writable", parameter, context)
        if place.is_dir():
            self.fail(f"{value!r} is a folder", parameter, context)
        if place.suffix.lower() == ".exr" and not _has_openexr():
            self.fail('.exr needs OpenEXR; pip install "rasterjit[exr]"', parameter, context)
        return place


def checked_place(name: str, place: Path, kind: str) -> Path:
    """Return the value of an option as `PlaceType` does, or raise click's usage error."""
    context = click.get_current_context()
    option = next(one for one in context.command.params if one.name == name)
    return PlaceType(kind).convert(str(place), option, context)


def is_picture(file: Path) -> bool:
    """Tell whether a name is one of pictures, or of buffers."""
    return file.suffix.lower() in _formats("image")


def refuse_picture(what: str, output: Path) -> None:
    """Raise click's usage error if several pictures are to go where a file's name is."""
    if is_picture(output) and not output.is_dir():
        raise click.BadOptionUsage(
            "--output",
            f"--output: {output} is the name of a file, and the pictures of {what} go into a "
            f"folder, such as {output.with_suffix('')}",
        )


def _formats(kind: str) -> tuple[str, ...]:
    """Return the extensions of a kind of file."""
    from rasterjit.animation import video
    from rasterjit.io import images
    from rasterjit.outputs import save

    return {
        "image": (*images.IMAGE_FORMATS, ".npz", ".exr"),
        "depth": save.FORMATS,
        "mask": (".png",),
        "animation": video.ANIMATION_FORMATS,
    }[kind]


def _has_openexr() -> bool:
    """Tell whether the extra for EXR files is installed."""
    import importlib.util

    return importlib.util.find_spec("OpenEXR") is not None


class SceneOptions(NamedTuple):
    """Options that change the scene."""

    on_invalid: str
    on_damage: str
    shading: str | None
    wireframe: str | None
    wireframe_color: str | None
    resource_root: str | None
    max_bytes: int = DEFAULT_MAX_BYTES
    isolate: Isolation = True
    color: str | None = None
    light: tuple[Vector | str, ...] = ()
    scalars: str | None = None
    colormap: Colormap | None = None
    scalar_range: tuple[float, float] | None = None
    contours: Contours | None = None
    variant: str | None = None

    def check(self) -> None:
        """Raise click's usage error for options that say nothing without others, or of others."""
        if self.scalars is None:
            refuse_idle([*OF_SCALARS, "colorbar"], "it is for --scalars")
        elif self.color is not None:
            raise click.BadOptionUsage("--color", "--color: --scalars have colours of their own")

    def of_folder(self) -> SceneOptions:
        """Return the options for files of a folder, which may come from strangers."""
        return self._replace(isolate="all" if self.isolate else False)

    def apply(self, scene: Scene) -> None:
        """Change the scene's colours, materials, lights and wireframe."""
        from rasterjit.scene.wireframe import Wireframe

        if self.variant is not None:
            if not scene.variants:
                raise ValueError(
                    f"--variant must be left out: no material has variants, got {self.variant!r}"
                )
            try:
                scene.variant = self.variant
            except ValueError as error:
                raise ValueError(re.sub(r"^variant\b", "--variant", str(error))) from error
        if self.scalars is not None:
            self._show_scalars(scene, self.scalars)
        if self.color is not None:
            plain = {id(node.mesh): node.mesh.without_colors() for node in scene.nodes}
            for node in scene.nodes:
                node.mesh = plain[id(node.mesh)]
        changes = self._changes()
        if changes:
            for mesh in {id(node.mesh): node.mesh for node in scene.nodes}.values():
                mesh.material = _changed(mesh.material, **changes)
        if self.light:
            scene.lights = _lights_of(self.light)
        if self.wireframe is not None or self.wireframe_color is not None:
            scene.wireframe = Wireframe(
                self.wireframe_color or "black", self.wireframe or "overlay"
            )

    def _show_scalars(self, scene: Scene, name: str) -> None:
        """Show the meshes that have an attribute by it, all by one range, without textures."""
        meshes = {id(node.mesh): node.mesh for node in scene.nodes}
        known = dict.fromkeys(one for mesh in meshes.values() for one in mesh.scalar_attributes)
        own = {key: mesh for key, mesh in meshes.items() if name in mesh.scalar_attributes}
        if not own:
            held = f"those with one number are {', '.join(known)}" if known else "there is none"
            raise ValueError(
                f"--scalars: no mesh has an attribute {name!r} of one number for each vertex or "
                f"face; {held}{question(name, list(known), {})}"
            )
        ends = self.scalar_range
        if ends is None:
            ranges = [mesh.with_scalars(name).field.range for mesh in own.values()]
            lows, highs = zip(*ranges, strict=True)
            ends = min(lows), max(highs)
        colormap = self.colormap or Colormap("viridis")
        shown = {}
        for key, mesh in own.items():
            try:
                made = mesh.with_scalars(name, colormap, range=ends, contours=self.contours)
            except ValueError as error:
                said = re.sub(r"^contours must be None", "--contours must not be given", str(error))
                raise ValueError(said) from error
            plain = {"base_color": None, "base_color_texture": None, "alpha_mode": "opaque"}
            made.material = _changed(mesh.material, **plain)
            shown[key] = made
        for node in scene.nodes:
            node.mesh = shown.get(id(node.mesh), node.mesh)

    def _changes(self) -> dict[str, Any]:
        """Return the fields of all materials that options set."""
        changes: dict[str, Any] = {} if self.shading is None else {"shading": self.shading}
        if self.color is not None:
            from rasterjit.scene.color import linear_color

            is_opaque = linear_color("--color", self.color)[3] == 1.0
            changes |= {
                "base_color": self.color,
                "base_color_texture": None,
                "alpha_mode": "opaque" if is_opaque else "blend",
            }
        return changes


def _changed(material: Material, **changes: Any) -> Material:
    """Return a material with other fields."""
    # One that nothing was said about is no longer one of that kind.
    said = {one.name: getattr(material, one.name) for one in dataclasses.fields(Material)}
    return Material(**{**said, **changes})


def check_lights(
    context: click.Context, parameter: click.Parameter, chosen: tuple[Vector | str, ...]
) -> tuple[Vector | str, ...]:
    """Return what ``--light`` is given, or raise click's usage error."""
    for number, one in enumerate(chosen):
        if one in chosen[:number]:
            said = one if isinstance(one, str) else ",".join(f"{part:g}" for part in one)
            raise click.BadOptionUsage("--light", f"--light: {said} is given twice")
    if "headlight" in chosen and len(chosen) > 1:
        raise click.BadOptionUsage("--light", "--light: the headlight shines alone")
    return chosen


def _lights_of(chosen: tuple[Vector | str, ...]) -> list[Light]:
    """Return lights by directions and names; none for the headlight, which is the default."""
    from rasterjit.scene.light import AmbientLight, DirectionalLight

    if "headlight" in chosen:
        return []
    around = AMBIENT_INTENSITY if "ambient" in chosen else FILL_INTENSITY
    lights: list[Light] = [AmbientLight(intensity=around)]
    for one in chosen:
        if one != "ambient":
            direction = SUN_DIRECTION if one == "sun" else one
            lights.append(DirectionalLight(direction, intensity=SUN_INTENSITY))
    return lights


class CameraOptions(NamedTuple):
    """Options that place the camera."""

    azimuth: float | None
    elevation: float | None
    zoom: float | None
    fov: float | None
    projection: str | None
    up: Vector | None
    position: Vector | None = None
    target: Vector | None = None
    pose: NDArray[np.float64] | None = None
    convention: str | None = None
    intrinsics: NDArray[np.float64] | None = None

    def check(self) -> None:
        """Raise click's usage error if options contradict each other."""
        self._check_pinhole()
        if self.position is None:
            if self.target is not None:
                raise click.UsageError("--target needs --position")
        elif self.azimuth is not None or self.elevation is not None:
            raise click.UsageError("--position excludes --azimuth and --elevation")
        if self.projection == "orthographic" and self.fov is not None:
            raise click.UsageError("--fov is for --projection perspective; use --zoom")
        if self.position is not None and self.position == self.target:
            raise click.UsageError("--position must differ from --target")
        if self.up == (0.0, 0.0, 0.0):
            raise click.UsageError("--up must not be 0,0,0")

    def camera(self, scene: Scene, size: tuple[int, int]) -> AnyCamera | None:
        """
        Return the camera; ``None``, for the renderer to choose, if no option was given.

        The scene gets ``--up``, so that the ground and the sky of a style follow it, unless its
        file says which way is up. Then it turns a camera with ``--position`` alone.
        """
        if self.up is not None and scene.up is not None and self.position is None:
            x, y, z = (f"{part:g}" for part in scene.up)
            quiet = click.get_current_context().params.get("quiet", False)
            warn(f"--up is for files that do not say which way is up; this says {x},{y},{z}", quiet)
            return self._replace(up=None).camera(scene, size)
        if all(option is None for option in self):
            return None
        if self.up is not None and any(self.up) and scene.up is None:
            from rasterjit.scene.transforms import unit_vector

            x, y, z = unit_vector("up", self.up).tolist()
            scene.up = (x, y, z)
        if self.intrinsics is None and scene.camera is not None and not self._is_placed():
            return self._magnified(scene.camera)
        if self.pose is not None or self.intrinsics is not None:
            return self._calibrated(scene, size)
        if self.position is not None:
            return self._placed(scene, size)
        return self._fit(scene, size)

    def _is_placed(self) -> bool:
        """Tell whether an option says where the camera is, or of which kind."""
        return any(one is not None for one in self._replace(zoom=None, fov=None, intrinsics=None))

    def _magnified(self, camera: AnyCamera) -> AnyCamera:
        """Return the file's camera with another field of view, and zoomed."""
        from rasterjit.scene.camera import PerspectiveCamera
        from rasterjit.scene.framing import zoom_camera

        if self.fov is not None:
            if not isinstance(camera, PerspectiveCamera):
                raise click.BadOptionUsage(
                    "--fov",
                    "--fov: the file's camera has no field of view: use --zoom, or "
                    "--projection perspective for a camera that fits the scene",
                )
            camera = dataclasses.replace(camera, fov_y=self.fov)
        return camera if self.zoom is None else zoom_camera(camera, self.zoom)

    def _check_pinhole(self) -> None:
        """Raise click's usage error if options contradict those of a calibrated camera."""
        if self.pose is None:
            if self.convention is not None:
                raise click.UsageError("--convention needs --pose")
        else:
            if self.convention is None:
                told = "; ".join(f"{name} ({text})" for name, text in CONVENTIONS.items())
                raise click.UsageError(f"--pose needs --convention, what it means: {told}")
            names = ("position", "target", "azimuth", "elevation", "up")
            refuse_idle(names, "--pose places the camera")
        if self.intrinsics is not None:
            refuse_idle(("fov", "zoom"), "--intrinsics tells what the camera shows")
            behind = click.get_current_context().params.get("background")
            if not is_given("size") and (behind is None or isinstance(behind, str)):
                raise click.UsageError("--intrinsics needs --size, of the picture that they are of")
        is_calibrated = self.pose is not None or self.intrinsics is not None
        if is_calibrated and self.projection == "orthographic":
            refuse_idle(["projection"], "--pose and --intrinsics are of perspective cameras")

    def _calibrated(self, scene: Scene, size: tuple[int, int]) -> MatrixCamera:
        """Return the camera of ``--pose`` or ``--intrinsics`` or both."""
        from rasterjit.cli.pinhole import FLIP, camera_of, intrinsics_of, pose_from_world
        from rasterjit.scene import transforms

        intrinsics = self.intrinsics
        if self.pose is not None:
            pose = pose_from_world(self.pose, str(self.convention))
            if intrinsics is None:
                intrinsics = intrinsics_of(PLACED_FOV if self.fov is None else self.fov, size)
                intrinsics[[0, 1], [0, 1]] *= 1.0 if self.zoom is None else self.zoom
            return camera_of(intrinsics, pose, size, scene)
        if scene.camera is not None and not self._is_placed():
            placed = scene.camera
        else:
            focal = float(intrinsics[1, 1])
            fov_y = 2.0 * transforms.arc_tangent(size[1] / 2.0, focal)
            alike = self._replace(intrinsics=None, fov=fov_y)
            try:
                # The axis need not go through the middle of the picture: there is room around.
                placed = (
                    alike._fit(scene, size, steady=True)
                    if self.position is None
                    else alike._placed(scene, size)
                )
            except ValueError as error:
                if "fov_y" not in str(error):
                    raise
                raise ValueError(
                    f"--intrinsics: the focal length {focal:g} of {size[1]} rows, a field of view "
                    f"of {fov_y:g} degrees, cannot be fitted to the scene; --pose places the camera"
                ) from error
        pose = transforms.compose(FLIP, placed.view_matrix())
        return camera_of(intrinsics, pose, size, scene)

    def turn(
        self, scene: Scene, size: tuple[int, int], animation: Animation | None = None
    ) -> Callable[[float], FittedCamera]:
        """
        Return the camera of one turn as a function of its share, 0..1.

        It is always fitted: to the scene, or to all that an animation of it shows.
        """
        from rasterjit.animation.tracks import turntable

        azimuth, elevation = self._angles()
        return turntable(
            scene,
            azimuth=azimuth,
            elevation=elevation,
            animation=animation,
            **self._fitting(scene, size),
        )

    def _fitting(self, scene: Scene, size: tuple[int, int]) -> dict[str, Any]:
        """Return what cameras that fit the scene have in common."""
        usual = DEFAULT_FOV if self.position is None else PLACED_FOV
        return {
            "fov_y": usual if self.fov is None else self.fov,
            "up": self.up or scene.up or (0.0, 1.0, 0.0),
            "zoom": 1.0 if self.zoom is None else self.zoom,
            "projection": self.projection or "perspective",
            "aspect": size[0] / size[1],
        }

    def _fit(self, scene: Scene, size: tuple[int, int], steady: bool = False) -> FittedCamera:
        """Return the camera that fits the scene, seen from the angles given or by default."""
        from rasterjit.scene import transforms
        from rasterjit.scene.framing import fit_camera, frame_of, orbit_direction

        fitting = self._fitting(scene, size)
        frame = frame_of(fitting["up"])
        toward, upward = DEFAULT_DIRECTION, (0.0, 1.0, 0.0)
        if self.azimuth is not None or self.elevation is not None:
            azimuth, elevation = self._angles()
            toward = orbit_direction(azimuth, elevation)
            # Ninety degrees above the camera is up for it, at the poles as well.
            upward = orbit_direction(azimuth, elevation + 90.0)
        fitting["up"] = transforms.apply(frame, upward)
        return fit_camera(scene, transforms.apply(frame, toward), steady=steady, **fitting)

    def _angles(self) -> tuple[float, float]:
        """Return azimuth and elevation, degrees, given or those of the default."""
        return (
            DEFAULT_AZIMUTH if self.azimuth is None else self.azimuth,
            DEFAULT_ELEVATION if self.elevation is None else self.elevation,
        )

    def _placed(self, scene: Scene, size: tuple[int, int]) -> FittedCamera:
        """Return the camera at ``position``, its near and far plane around the scene."""
        import numpy as np

        from rasterjit.scene.framing import CLEARANCE, frame_of, near_plane
        from rasterjit.scene.transforms import apply, are_parallel

        center, radius = scene.bounding_sphere()
        # What a parallel camera shows fits from all sides.
        fitted = self._fit(scene, size, steady=True)
        eye = np.array(self.position)
        target = center if self.target is None else np.array(self.target)
        if np.array_equal(eye, target):
            raise click.UsageError("--position is the middle of the scene: give --target as well")
        up = self.up or scene.up or (0.0, 1.0, 0.0)
        if self.up is None and are_parallel(up, target - eye):
            # Straight down or up: what is far in the default view is at the top.
            x, y, z = (up * (target - eye)).tolist()
            up = apply(frame_of(up), (0.0, 0.0, math.copysign(1.0, x + y + z)))
        x, y, z = (center - eye).tolist()
        distance = math.sqrt(x * x + y * y + z * z)
        if self.projection == "orthographic":
            near, far = 0.0, (distance + radius) * (1.0 + CLEARANCE) or 1.0
        else:
            near, far = near_plane(distance, radius) or 1.0, math.inf
        return dataclasses.replace(fitted, eye=eye, target=target, up=up, near=near, far=far)


def gather(kind: type[Options], options: dict[str, Any]) -> Options:
    """Return the options of a kind out of all those of a command."""
    return kind(**{name: options[name] for name in kind._fields if name in options})


def is_given(name: str) -> bool:
    """Tell whether the command line gives an option of the command that runs."""
    source = click.get_current_context().get_parameter_source(name)
    defaults = ParameterSource.DEFAULT, ParameterSource.DEFAULT_MAP, ParameterSource.ENVIRONMENT
    return source not in (None, *defaults)


def refuse_idle(names: Iterable[str], why: str) -> None:
    """Raise click's usage error for the first of some options that is given, in vain."""
    options = {one.name: one for one in click.get_current_context().command.params}
    for name in names:
        if is_given(name):
            spelled = max(options[name].opts, key=len)
            raise click.BadOptionUsage(spelled, f"{spelled} has no effect here: {why}")


def refuse_without_color(outputs: tuple[str, ...]) -> None:
    """Raise click's usage error for options of what no output shows."""
    shown = f"the outputs are {', '.join(outputs)}"
    if "color" not in outputs:
        refuse_idle(OF_CODES, f"it acts on the output color alone, and {shown}")
    if not {"color", "linear"} & set(outputs):
        refuse_idle(OF_COLOR, f"no output shows colour: {shown}")
        if "scalar" not in outputs:
            refuse_idle(["scalars"], f"no output shows colour or scalar: {shown}")
        if "coverage" not in outputs:
            refuse_idle(["samples"], f"each pixel has one sample of what is no colour: {shown}")


def add_options(options: list[Callable], command: Callable) -> Callable:
    """Decorate a command with options, in their order in the help."""
    for option in reversed(options):
        command = option(command)
    return command


on_damage_option = click.option(
    "--on-damage", type=click.Choice(["error", "warn"]), default="error", show_default=True,
    help="Refuse a file that is cut short or damaged (OBJ, PLY, STL, OFF, PCD, LAS or rows of "
    "points), or draw what there is.",
)  # fmt: skip

max_bytes_option = click.option(
    "--max-bytes", type=int, default=DEFAULT_MAX_BYTES,
    help="Most memory that a mesh file and all that it names may take; default: 8 GiB.",
)  # fmt: skip


isolate_option = click.option(
    "--isolate/--no-isolate", default=True, show_default=True,
    help="Have other packages read files, and of a folder decode pictures, in a process with "
    "limits.",
)  # fmt: skip


def reading_options(command: Callable) -> Callable:
    """Add the options of how files are read to a command."""
    return add_options(
        [
            click.option("--on-invalid", type=click.Choice(["raise", "drop"]), default="raise",
                         show_default=True,
                         help="Refuse a mesh with NaN or infinite vertices, or draw the rest."),
            on_damage_option,
            click.option("--resource-root", metavar="FOLDER",
                         help="Folder that textures and other files may be read from; default: "
                              "the folder of the mesh."),
            max_bytes_option,
            isolate_option,
        ],
        command,
    )  # fmt: skip


def look_options(command: Callable) -> Callable:
    """Add `SceneOptions` to a command."""
    modes = click.Choice(SHADINGS)
    return add_options(
        [
            click.option("--color", type=ColorType(),
                         help="Draw all objects in this colour; replaces their own colours and "
                              "textures. Spelt as for --background."),
            click.option("--scalars", metavar="NAME",
                         help="Show an attribute of the file in colours, such as the property "
                              "quality of a PLY; rasterjit info lists attributes."),
            click.option("--colormap", type=ColormapType(), metavar="NAME",
                         help=f"Colours of --scalars: {', '.join(COLORMAPS)}, each also reversed "
                              f"with {REVERSED} behind it; default: viridis."),
            click.option("--range", "scalar_range", type=RangeType(),
                         help="Values of the first and the last colour; default: the least and the "
                              "greatest value."),
            click.option("--contours", type=ContoursType(),
                         help="Draw lines of equal --scalars: how many, 10, or at which values, "
                              "0.5,1.5."),
            click.option("--variant", metavar="NAME",
                         help="Show this variant of a glTF file's materials; rasterjit info lists "
                              "them."),
            click.option("--light", type=LightType(), multiple=True, metavar="X,Y,Z|NAME",
                         callback=check_lights,
                         help="Light from far away that shines along X,Y,Z (0,-1,0: down), or "
                              f"{', '.join(LIGHTS[:-1])} or {LIGHTS[-1]}; replaces the scene's "
                              "lights. There is dim light from all around as well, bright with "
                              "ambient. May be repeated, each light once."),
            click.option("--shading", type=modes, help="Shade all objects this way."),
            click.option("--wireframe", type=click.Choice(["overlay", "only"]),
                         help="Draw edges over the faces, or edges alone."),
            click.option("--wireframe-color", type=ColorType(is_opaque=True),
                         help="Colour of the edges, opaque; default: black. Without --wireframe "
                              "they are drawn over the faces."),
        ],
        reading_options(command),
    )  # fmt: skip


def view_options(command: Callable | None = None, *, orbit: bool = False) -> Callable:
    """Add `CameraOptions` to a command; with ``orbit`` those of a fitted camera only."""
    if command is None:
        return lambda command: view_options(command, orbit=orbit)
    start = " of the first frame" if orbit else ""
    placing = [] if orbit else [
        click.option("--position", type=VectorType(), help="Where the camera stands."),
        click.option("--target", type=VectorType(),
                     help="Point that it looks at; default: the middle of the scene."),
        click.option("--pose", type=PoseType(), metavar="FILE|NUMBERS",
                     help="Position and rotation of the camera: a 4x4 or 3x4 matrix in a .npy, "
                          ".json or text file, or its numbers, row by row."),
        click.option("--convention", type=click.Choice(tuple(CONVENTIONS)),
                     help="What --pose means. "
                          f"{'. '.join(f'{name}: {text}' for name, text in CONVENTIONS.items())}."),
        click.option("--intrinsics", type=IntrinsicsType(), metavar="FX,FY,CX,CY|FILE",
                     help="Focal lengths and principal point in pixels of --size, or a file with "
                          "the matrix K; as in OpenCV, the first pixel's centre is 0,0."),
    ]  # fmt: skip
    fitting = [
        click.option("--azimuth", metavar="DEG", type=FiniteNumberType(),
                     help=f"Degrees around the scene{start}: 0 is +z, 90 is +x (z up: -y, +x)."),
        click.option("--elevation", metavar="DEG", type=FiniteType(-90.0, 90.0),
                     help="Degrees above the scene."),
        click.option("--zoom", metavar="FACTOR", type=FiniteType(0.0, min_open=True),
                     help="How many times larger to show the scene" + ("." if orbit else
                          "; without other options of the camera, the file's own is used.")),
        click.option("--fov", metavar="DEG",
                     type=FiniteType(0.0, 180.0, min_open=True, max_open=True),
                     help="Vertical field of view, degrees; default 28, "
                          "with --position or --pose 45."),
        click.option("--projection", type=click.Choice(["perspective", "orthographic"]),
                     help="With perspective, or parallel; default: perspective."),
        click.option("--up", type=UpType(),
                     help="Which way is up, such as z, where the file does not say so; glTF does."),
    ]  # fmt: skip
    return add_options(placing + fitting, command)


class Effects(NamedTuple):
    """Options that add effects."""

    shadows: bool
    environment: str | None
    ambient_occlusion: bool
    outline: str | None
    tone_map: str | None
    exposure: float | None
    vignette: float | None = None
    eye_dome: float | None = None
    section: tuple[tuple[float, ...], ...] = ()
    section_lines: str | None = None
    samples: str | None = None
    preset: str = "standard"
    changes: tuple[dict[str, Any], ...] = ()
    style: str = "plain"

    def quality(self) -> Quality:
        """Return the quality that was asked for, or raise click's usage error."""
        changed: dict[str, Any] = {}
        if self.samples is not None:
            changed["samples"] = self.samples if self.samples == "area" else int(self.samples)
        for change in self.changes:
            for name, level in change.items():
                if changed.setdefault(name, level) != level:
                    raise click.UsageError(f"{name} is given twice: {changed[name]} and {level}")
        try:
            return dataclasses.replace(PRESETS[self.preset](), **changed)
        except ValueError as error:
            raise click.UsageError(str(error)) from None

    def apply(self, scene: Scene) -> None:
        """Add the effects to a scene."""
        from rasterjit.scene.ambient_occlusion import AmbientOcclusion
        from rasterjit.scene.environment import Environment
        from rasterjit.scene.outline import Outline
        from rasterjit.scene.tone_map import ToneMap
        from rasterjit.scene.vignette import Vignette

        if self.environment is not None:
            try:
                scene.environment = (
                    Environment.gradient()
                    if self.environment == SKY
                    else Environment.from_file(self.environment)
                )
            except ValueError as error:
                raise ValueError(re.sub(r"^path\b", "--environment", str(error))) from error
        has_light = bool(scene.lights) or scene.environment is not None
        if self.shadows and (has_light or self.style not in WITH_LAMP):
            _cast_shadows(scene)
        if self.ambient_occlusion:
            scene.ambient_occlusion = AmbientOcclusion()
        if self.outline is not None:
            scene.outline = Outline(self.outline)
        if self.tone_map is not None or self.exposure is not None:
            scene.tone_map = ToneMap(self.tone_map or "none", self.exposure or 0.0)
        if self.vignette is not None:
            scene.vignette = Vignette(self.vignette)
        if self.eye_dome is not None:
            scene.eye_dome = EyeDome(self.eye_dome)
        if not self.section:
            refuse_idle(["section_lines"], "it is for --section")
        else:
            scene.section = _planes(self.section, self.section_lines)


def _planes(planes: tuple[tuple[float, ...], ...], lines: str | None) -> list[SectionPlane]:
    """Return planes of points and normals, with lines of a colour or without."""
    from rasterjit.scene.section import SectionPlane

    color = lines or "black"
    return [
        SectionPlane(plane[:3], plane[3:], lines=lines is not None, line_color=color)
        for plane in planes
    ]


def _cast_shadows(scene: Scene) -> None:
    """Let all lights but ambient ones cast shadows; a scene without any gets a sun."""
    from rasterjit.scene.light import AmbientLight, DirectionalLight, Shadow

    if all(isinstance(light, AmbientLight) for light in scene.lights):
        if not scene.lights and scene.environment is None:
            scene.lights.append(AmbientLight(intensity=FILL_INTENSITY))
        scene.lights.append(DirectionalLight(SUN_DIRECTION, intensity=SUN_INTENSITY))
    scene.lights = [
        light
        if isinstance(light, AmbientLight) or light.shadow is not None
        else dataclasses.replace(light, shadow=Shadow())
        for light in scene.lights
    ]


def style_option(command: Callable) -> Callable:
    """Add the option ``--style`` to a command."""
    return click.option(
        "--style", type=click.Choice(STYLES), default=STYLES[0], show_default=True, metavar="NAME",
        help=f"{', '.join(STYLES[:-1])} or {STYLES[-1]}. studio: a soft lamp, light from the sky, "
             "a shadow on the ground, grey behind, 4 samples; plain: a headlight, white behind, as "
             "rasterjit.render draws. FILE keeps its own lights and camera, and other options win "
             "over the style.",
    )(command)  # fmt: skip


def check_style(name: str) -> None:
    """Raise click's usage error for options of colours that a style replaces."""
    if name in PAINTED:
        refuse_idle(OF_PAINT, f"--style {name} has colours of its own")


def in_style(
    name: str, scene: Scene, camera: AnyCamera | None, look: SceneOptions, effects: Effects
) -> Style:
    """
    Return a scene in a style, but for what options say.

    Parameters
    ----------
    name : str
        Of `STYLES`.
    scene : Scene
        With what options ask for.
    camera : Camera or None
    look, effects : SceneOptions, Effects
    """
    from rasterjit import styles
    from rasterjit.scene.framing import fit_upright
    from rasterjit.survey.lights import headlight

    if "headlight" in look.light and scene.nodes:
        seen_from = camera or scene.camera or fit_upright(scene, (1, 1))
        scene.lights = headlight(seen_from)
    style = styles.STYLES[name](scene, camera)
    if any(map(is_given, OF_QUALITY)):
        style = style.with_quality(effects.quality())
    return style


def quality_options(command: Callable) -> Callable:
    """Add the options of `Effects` to a command that say how accurately to render."""
    settings = [
        click.option("--quality", "preset", type=click.Choice(tuple(PRESETS)), default="standard",
                     show_default=True, help="How accurately to render."),
        click.option("--set", "changes", type=SettingType(), multiple=True,
                     help="Change an accuracy setting, such as shadow_size=2048; may be repeated."),
        click.option("--samples", type=click.Choice(SAMPLES),
                     help="Samples of each pixel, for smooth edges; area is exact and slow. "
                          "Short for --set samples=..."),
    ]  # fmt: skip
    return add_options(settings, command)


def effect_options(command: Callable | None = None, *, quality: bool = True) -> Callable:
    """Add the options of `Effects` to a command, perhaps without those of quality."""
    if command is None:
        return lambda command: effect_options(command, quality=quality)
    command = add_options(
        [
            click.option("--shadows", is_flag=True,
                         help="Let the lights cast shadows; a scene without lights gets a sun."),
            click.option("--environment", metavar="FILE|sky",
                         help="Light from all around: an equirectangular picture, or a sky."),
            click.option("--ambient-occlusion", is_flag=True, help="Dim ambient light in corners."),
            click.option("--eye-dome", metavar="STRENGTH", type=FiniteType(0.0, STRONGEST),
                         help="Darken what lies behind its neighbours, which shows depth without "
                              "light; 1 is usual."),
            click.option("--outline", type=ColorType(is_opaque=True),
                         help="Draw outlines in this colour."),
            click.option("--tone-map", type=click.Choice(CURVES),
                         help="Tone curve: from light to what a screen can show."),
            click.option("--exposure", metavar="STOPS", type=FiniteType(-MOST_STOPS, MOST_STOPS),
                         help="Stops of exposure, doublings of the light before the curve."),
            click.option("--vignette", metavar="SHARE", type=FiniteType(0.0, 1.0),
                         help="Darken the corners by this share of their light."),
            click.option("--section", metavar="PLANE", type=PlaneType(), multiple=True,
                         help="Cut away what lies in front of a plane: x=0.5 cuts away all x above "
                              "0.5, -x=0.5 all below; or a point and a normal, X,Y,Z,NX,NY,NZ. "
                              "May be repeated."),
            click.option("--section-lines", type=ColorType(is_opaque=True),
                         help="Draw the outline of the cut in this colour."),
        ],
        command,
    )  # fmt: skip
    return quality_options(command) if quality else command
