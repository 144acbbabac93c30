"""Options that commands share: classes whose fields they set, and scenes and cameras from them."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import click
import numpy as np
from click.core import ParameterSource
from numpy.typing import NDArray

from rasterjit.cli import option_types
from rasterjit.cli.help import suggest_words
from rasterjit.cli.report import collect_warnings, warn
from rasterjit.outputs.output_table import MOTION_OUTPUTS, OUTPUTS
from rasterjit.scene.colormap import COLORMAPS, REVERSED_SUFFIX, Colormap
from rasterjit.scene.eye_dome import MAX_STRENGTH, EyeDome
from rasterjit.scene.material import SHADINGS, Material
from rasterjit.scene.memory_limits import DEFAULT_MAX_BYTES
from rasterjit.scene.norm import NORMS, NormName, RangeLike, make_norm
from rasterjit.scene.quality import LEVELS, PRESETS, Quality
from rasterjit.scene.tone_map import CURVES, MAX_STOPS
from rasterjit.scene.validation import MAX_LINE_WIDTH, MIN_LINE_WIDTH, suggest

if TYPE_CHECKING:
    from rasterjit.io.camera_files.calibration import CalibratedCamera
    from rasterjit.io.foreign.codecs import Isolation
    from rasterjit.scene.camera import MatrixCamera, OrthographicCamera, PerspectiveCamera
    from rasterjit.scene.camera_fitting import AnyCamera
    from rasterjit.scene.contours import Contours
    from rasterjit.scene.keyframes import Animation
    from rasterjit.scene.light import Light
    from rasterjit.scene.scene import Scene
    from rasterjit.scene.section import SectionPlane
    from rasterjit.styles.style import Style

    FittedCamera = PerspectiveCamera | OrthographicCamera

Options = TypeVar("Options")

OUTPUTS_HELP = (
    "What to write, separated by commas: "
    f"{', '.join(name for name in OUTPUTS if name not in MOTION_OUTPUTS)}, attribute:NAME."
)

DEFAULT_DIRECTION = (-0.4, 0.6, 1.0)
"""Direction from the scene to the camera, y up: the default of ``fit_camera``."""
DEFAULT_AZIMUTH, DEFAULT_ELEVATION = -22.0, 29.0
"""That direction in whole degrees, for when one of the two is given."""
DEFAULT_FOV, POSITIONED_FOV = 28.0, 45.0
"""Vertical field of view, degrees: of cameras fitted to the scene; with a position or pose."""

SAMPLE_CHOICES = tuple(str(level) for level in LEVELS["samples"])
"""Choices of ``Quality.samples``."""

SKY = "sky"
"""Value of ``--environment`` for the default gradient, in place of a picture."""

SUN_DIRECTION = (-0.6, -1.0, -0.5)
SUN_INTENSITY = 0.9
FILL_INTENSITY = 0.15
"""Intensities of the sun that casts shadows in a scene without lights, and of its ambient light."""

AMBIENT_INTENSITY = 1.0
"""Intensity of ``--light ambient``: alone, it shows base colours unchanged."""

STYLES = ("studio", "plain", "clay", "technical", "xray", "depth", "normals", "wireframe")
"""Names of ``rasterjit.styles``, the default first."""

CAMERA_KEY = "rasterjit.camera"
"""Key of the camera of ``--camera`` in what click keeps for a command."""

QUALITY_OPTIONS = ("preset", "changes", "samples")
"""Options of accuracy."""

STYLES_WITH_COLORS = STYLES[2:]
"""Styles with their own colours."""

STYLES_WITH_OUTLINES = ("technical",)
"""Styles with outlines, of which options change what they name."""

STYLES_WITH_LAMP = ("studio", "clay")
"""Styles that add a light with a shadow to scenes without lights."""

PAINT_OPTIONS = ("color", "scalars", "shading")
"""Options of colours that those styles replace."""

READING_OPTIONS = ("on_invalid", "on_damage", "resource_root", "max_bytes", "isolate")
"""Options of reading files."""

SCALAR_OPTIONS = ("colormap", "scalar_range", "norm", "contours")
"""Options of scalar fields."""

COLOR_OPTIONS = (
    "style",
    "background",
    "color",
    *SCALAR_OPTIONS,
    "light",
    "shading",
    "shadows",
    "environment",
    "ambient_occlusion",
    "eye_dome",
)
"""Options that act on colour alone, linear or encoded."""

CODE_OPTIONS = (
    "tone_map", "exposure", "outline", "outline_width", "hidden_lines", "vignette", "wireframe",
    "wireframe_color", "section_lines",
)  # fmt: skip
"""Options that act on 8-bit colour alone."""


def option(
    kind: Any, *spelled: str, default: Any = None, help: str | None = None, **settings: Any
) -> Any:
    """
    Return a dataclass field for an option; `add_options` makes the option.

    Parameters
    ----------
    kind : type of click's
    *spelled : str
        As on the command line; as the field, if not given.
    default
    help : str, optional
        What the class's docstring says of the field, if not given.
    **settings
        Others of `click.option`.
    """
    settings |= {"spelled": spelled, "type": kind, "help": help}
    return dataclasses.field(default=default, metadata=settings)


def flag(*spelled: str) -> Any:
    """Return a dataclass field for a flag."""
    return option(None, *spelled, default=False, is_flag=True)


def add_options(
    kind: type, names: Iterable[str] | None = None, **words: str
) -> Callable[[Callable], Callable]:
    """
    Return a decorator that adds the options of a class's fields to a command, in order.

    Parameters
    ----------
    kind : dataclass
        Its fields are an `option` or `flag` each, or set by other means.
    names : iterable of str, optional
        Of the fields; default: all.
    **words : str
        Help in place of that of fields.
    """
    listed = inspect.cleandoc(kind.__doc__ or "")
    said = dict(re.findall(r"^(\w+) : .*\n((?:    .*\n?)+)", listed, re.MULTILINE)) | words

    def decorate(command: Callable) -> Callable:
        for field in reversed(dataclasses.fields(kind)):
            if field.metadata and (names is None or field.name in names):
                settings = {"default": field.default, **field.metadata}
                spelled = settings.pop("spelled") or (f"--{field.name.replace('_', '-')}",)
                settings["help"] = settings["help"] or " ".join(said.get(field.name, "").split())
                is_told = field.default is not False and isinstance(
                    field.default, (str, float, int)
                )
                settings.setdefault("show_default", is_told)
                command = click.option(*spelled, field.name, **settings)(command)
        return command

    return decorate


def check_lights(
    context: click.Context,
    parameter: click.Parameter,
    chosen: tuple[option_types.Vector | str, ...],
) -> tuple[option_types.Vector | str, ...]:
    """Return the values of ``--light``, or raise click's usage error."""
    for number, one in enumerate(chosen):
        if one in chosen[:number]:
            said = one if isinstance(one, str) else ",".join(f"{part:g}" for part in one)
            raise click.BadOptionUsage("--light", f"--light: {said} is given twice")
    if "headlight" in chosen and len(chosen) > 1:
        raise click.BadOptionUsage("--light", "--light: the headlight shines alone")
    return chosen


@dataclasses.dataclass(frozen=True)
class SceneOptions:
    """
    Options that change the scene, and say how its file is read.

    Parameters
    ----------
    color : str, optional
        Draw all objects in this colour; replaces their own colours and textures. Spelt as for
        --background.
    scalars : str, optional
        Show an attribute of the file in colours, such as the property quality of a PLY; rasterjit
        info lists attributes.
    colormap : Colormap, optional
    scalar_range : (float, float) or str, optional
        Values of the first and the last colour, or the share of the values to leave out at each
        end, 2%; default: the least and the greatest value.
    norm : {"linear", "log", "symlog"}, optional
        Spread the colours over the values, their logarithms, or logarithms of both signs.
    contours : Contours, optional
        Draw lines of equal --scalars: how many, 10, or at which values, 0.5,1.5.
    variant : str, optional
        Show this variant of a glTF file's materials; rasterjit info lists them.
    light : tuple
        Light from far away that shines along X,Y,Z (0,-1,0: down), or headlight, sun or ambient;
        replaces the scene's lights. There is dim light from all around as well, bright with
        ambient. May be repeated, each light once.
    shading : str, optional
        Shade all objects this way.
    wireframe : {"overlay", "only"}, optional
        Draw edges over the faces, or edges alone.
    wireframe_color : str, optional
        Colour of the edges, opaque; default: black. Without --wireframe they are drawn over the
        faces.
    on_invalid : {"raise", "drop"}
        Refuse a mesh with NaN or infinite vertices, or draw the rest.
    on_damage : {"error", "warn"}
        Refuse a file that is cut short or damaged (OBJ, PLY, STL, OFF, PCD, LAS or rows of points),
        or draw what there is.
    resource_root : str, optional
        Folder that textures and other files may be read from; default: the folder of the mesh.
    max_bytes : int
        Most memory that a mesh file and all that it names may take; default: 8 GiB.
    isolate : bool or str
        Have other packages read files, and of a folder decode pictures, in a process with limits.
    """

    color: str | None = option(option_types.color_type)
    scalars: str | None = option(None, metavar="NAME")
    colormap: Colormap | None = option(
        option_types.colormap_type, metavar="NAME",
        help=f"Colours of --scalars: {', '.join(COLORMAPS)}, each also reversed with "
        f"{REVERSED_SUFFIX} behind it; default: viridis.",
    )  # fmt: skip
    scalar_range: RangeLike | None = option(option_types.range_type, "--range")
    norm: NormName | None = option(click.Choice(NORMS))
    contours: Contours | None = option(option_types.contours_type)
    variant: str | None = option(None, metavar="NAME")
    light: tuple[option_types.Vector | str, ...] = option(
        option_types.light_type,
        default=(),
        multiple=True,
        metavar="X,Y,Z|NAME",
        callback=check_lights,
    )
    shading: str | None = option(click.Choice(SHADINGS))
    wireframe: str | None = option(click.Choice(["overlay", "only"]))
    wireframe_color: str | None = option(option_types.opaque_color_type)
    on_invalid: str = option(click.Choice(["raise", "drop"]), default="raise")
    on_damage: str = option(click.Choice(["error", "warn"]), default="error")
    resource_root: str | None = option(None, metavar="FOLDER")
    max_bytes: int = option(int, default=DEFAULT_MAX_BYTES, show_default=False)
    isolate: Isolation = option(None, "--isolate/--no-isolate", default=True)

    def check(self) -> None:
        """Raise click's usage error for options that need another, or that another rules out."""
        if self.scalars is None:
            refuse_unused([*SCALAR_OPTIONS, "colorbar"], "it is for --scalars")
        elif self.color is not None:
            raise click.BadOptionUsage("--color", "--color: --scalars have colours of their own")

    def of_folder(self) -> SceneOptions:
        """Return the options for files of a folder, which are read as untrusted."""
        return dataclasses.replace(self, isolate="all" if self.isolate else False)

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
        changes = self._get_changes()
        if changes:
            for mesh in {id(node.mesh): node.mesh for node in scene.nodes}.values():
                mesh.material = _change_material(mesh.material, **changes)
        if self.light:
            scene.lights = _make_lights(self.light)
        if self.wireframe is not None or self.wireframe_color is not None:
            scene.wireframe = Wireframe(
                self.wireframe_color or "black", self.wireframe or "overlay"
            )

    def _show_scalars(self, scene: Scene, name: str) -> None:
        """Colour the meshes by an attribute that they have, all by one range, without textures."""
        meshes = {id(node.mesh): node.mesh for node in scene.nodes}
        known = dict.fromkeys(one for mesh in meshes.values() for one in mesh.scalar_attributes)
        own = {key: mesh for key, mesh in meshes.items() if name in mesh.scalar_attributes}
        if not own:
            held = f"those with one number are {', '.join(known)}" if known else "there is none"
            raise ValueError(
                f"--scalars: no mesh has an attribute {name!r} of one number for each vertex or "
                f"face; {held}{suggest_words(name, list(known), {})}"
            )
        values = np.concatenate([mesh.with_scalars(name).field.values for mesh in own.values()])
        try:
            ends = make_norm(self.norm, self.scalar_range, values).range
        except ValueError as error:
            raise ValueError(f"--{error}") from error
        colormap = self.colormap or Colormap("viridis")
        shown = {}
        for key, mesh in own.items():
            try:
                made = mesh.with_scalars(
                    name, colormap, range=ends, norm=self.norm, contours=self.contours
                )
            except ValueError as error:
                said = re.sub(r"^contours must be None", "--contours must not be given", str(error))
                raise ValueError(said) from error
            plain = {"base_color": None, "base_color_texture": None, "alpha_mode": "opaque"}
            made.material = _change_material(mesh.material, **plain)
            shown[key] = made
        for node in scene.nodes:
            node.mesh = shown.get(id(node.mesh), node.mesh)

    def _get_changes(self) -> dict[str, Any]:
        """Return the material fields that options set."""
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


def _change_material(material: Material, **changes: Any) -> Material:
    """Return a copy of a material with changed fields."""
    # One that nothing was said about is no longer one of that kind.
    said = {one.name: getattr(material, one.name) for one in dataclasses.fields(Material)}
    return Material(**{**said, **changes})


def _make_lights(chosen: tuple[option_types.Vector | str, ...]) -> list[Light]:
    """Return lights by directions and names; [] for the default headlight."""
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


@dataclasses.dataclass(frozen=True)
class CameraOptions:
    """
    Options that place the camera.

    Parameters
    ----------
    position : (float, float, float), optional
        Where the camera stands.
    target : (float, float, float), optional
        Point that it looks at; default: the middle of the scene.
    pose : (4, 4) float64, optional
        Position and rotation of the camera: a 4x4 or 3x4 matrix in a .npy, .json or text file, or
        its numbers, row by row.
    convention : str, optional
    intrinsics : (3, 3) float64, optional
        Focal lengths and principal point in pixels of --size, or a file with the matrix K; as in
        OpenCV, the first pixel's centre is 0,0.
    camera_file : str, optional
        A calibrated camera with its lens and size, of a file of COLMAP, nerfstudio, Blender,
        Bundler, OpenCV or Kalibr; of several that of an image, by its name or number.
    azimuth : float, optional
        Degrees around the scene: 0 is +z, 90 is +x (z up: -y, +x).
    elevation : float, optional
        Degrees above the scene.
    zoom : float, optional
        How many times larger to show the scene; without other options of the camera, the file's
        own is used.
    fov : float, optional
        Vertical field of view, degrees; default 28, with --position or --pose 45.
    projection : {"perspective", "orthographic"}, optional
        With perspective, or parallel; default: perspective.
    up : (float, float, float), optional
        Which way is up, such as z, where the file does not say so; glTF does.
    """

    position: option_types.Vector | None = option(option_types.vector_type)
    target: option_types.Vector | None = option(option_types.vector_type)
    pose: NDArray[np.float64] | None = option(option_types.pose_type, metavar="FILE|NUMBERS")
    convention: str | None = option(
        click.Choice(tuple(option_types.CONVENTIONS)),
        help="What --pose means. "
        f"{'. '.join(f'{name}: {text}' for name, text in option_types.CONVENTIONS.items())}.",
    )
    intrinsics: NDArray[np.float64] | None = option(
        option_types.intrinsics_type, metavar="FX,FY,CX,CY|FILE"
    )
    camera_file: str | None = option(None, "--camera", metavar="FILE[:IMAGE]")
    azimuth: float | None = option(option_types.FiniteNumberType(), metavar="DEG")
    elevation: float | None = option(option_types.FiniteType(-90.0, 90.0), metavar="DEG")
    zoom: float | None = option(option_types.FiniteType(0.0, min_open=True), metavar="FACTOR")
    fov: float | None = option(
        option_types.FiniteType(0.0, 180.0, min_open=True, max_open=True), metavar="DEG"
    )
    projection: str | None = option(click.Choice(["perspective", "orthographic"]))
    up: option_types.Vector | None = option(option_types.up_type)

    def check(self) -> None:
        """Raise click's usage error if options contradict each other."""
        self._check_camera_file()
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
            return dataclasses.replace(self, up=None).camera(scene, size)
        if all(value is None for value in vars(self).values()):
            return None
        if (calibrated := self.calibrated()) is not None:
            if calibrated.lens is not None and "lens" not in click.get_current_context().params:
                warn("--camera has a lens, which only render and accuracy draw", quiet=False)
            return calibrated.camera  # type: ignore[return-value]
        if self.up is not None and any(self.up) and scene.up is None:
            from rasterjit.scene.transforms import unit_vector

            x, y, z = unit_vector("up", self.up).tolist()
            scene.up = (x, y, z)
        if self.intrinsics is None and scene.camera is not None and not self._is_placed():
            return self._magnify_camera(scene.camera)
        if self.pose is not None or self.intrinsics is not None:
            return self._make_calibrated_camera(scene, size)
        if self.position is not None:
            return self._make_placed_camera(scene, size)
        return self._fit(scene, size)

    def calibrated(self) -> CalibratedCamera | None:
        """Return the camera of ``--camera``, or raise ``ValueError``."""
        if self.camera_file is None:
            return None
        context = click.get_current_context()
        size = context.params["size"] if is_given("size") else None
        # Read once.
        if CAMERA_KEY not in context.meta:
            with collect_warnings() as caught:
                context.meta[CAMERA_KEY] = option_types.load_camera(self.camera_file, size)
            for warning in caught:
                warn(str(warning.message), context.params.get("quiet", False))
        camera: CalibratedCamera = context.meta[CAMERA_KEY]
        return camera

    def find_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return the size of the picture: that of ``--camera`` unless ``--size`` is given."""
        calibrated = None if is_given("size") else self.calibrated()
        return size if calibrated is None else calibrated.size

    def _check_camera_file(self) -> None:
        """Raise click's usage error if ``--camera`` names none, or others place it as well."""
        try:
            calibrated = self.calibrated()
        except ValueError as error:
            raise click.BadOptionUsage("--camera", f"--camera: {error}") from None
        if calibrated is not None:
            names = ("lens", *(one.name for one in dataclasses.fields(self)))
            others = [name for name in names if name != "camera_file"]
            refuse_unused(others, "--camera has its own place, lens and intrinsics")

    def _is_placed(self) -> bool:
        """Tell whether an option sets the camera's position or kind."""
        placing = vars(self).keys() - {"zoom", "fov", "intrinsics"}
        return any(vars(self)[name] is not None for name in placing)

    def _magnify_camera(self, camera: AnyCamera) -> AnyCamera:
        """Return the file's camera with another field of view, and zoomed."""
        from rasterjit.scene.camera import PerspectiveCamera
        from rasterjit.scene.camera_fitting import zoom_camera

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
        """Raise click's usage error for options that contradict a calibrated camera."""
        if self.pose is None:
            if self.convention is not None:
                raise click.UsageError("--convention needs --pose")
        else:
            if self.convention is None:
                told = "; ".join(
                    f"{name} ({text})" for name, text in option_types.CONVENTIONS.items()
                )
                raise click.UsageError(f"--pose needs --convention, what it means: {told}")
            names = ("position", "target", "azimuth", "elevation", "up")
            refuse_unused(names, "--pose places the camera")
        if self.intrinsics is not None:
            refuse_unused(("fov", "zoom"), "--intrinsics tells what the camera shows")
            behind = click.get_current_context().params.get("background")
            if not is_given("size") and (behind is None or isinstance(behind, str)):
                raise click.UsageError("--intrinsics needs --size, of the picture that they are of")
        is_calibrated = self.pose is not None or self.intrinsics is not None
        if is_calibrated and self.projection == "orthographic":
            refuse_unused(["projection"], "--pose and --intrinsics are of perspective cameras")

    def _make_calibrated_camera(self, scene: Scene, size: tuple[int, int]) -> MatrixCamera:
        """Return the camera of ``--pose`` or ``--intrinsics`` or both."""
        from rasterjit.cli.option_types import convert_pose, make_camera, make_intrinsics
        from rasterjit.io.camera_files.calibration import FLIP_YZ
        from rasterjit.scene import transforms

        intrinsics = self.intrinsics
        if self.pose is not None:
            pose = convert_pose(self.pose, str(self.convention))
            if intrinsics is None:
                intrinsics = make_intrinsics(POSITIONED_FOV if self.fov is None else self.fov, size)
                intrinsics[[0, 1], [0, 1]] *= 1.0 if self.zoom is None else self.zoom
            return make_camera(intrinsics, pose, size, scene)
        if scene.camera is not None and not self._is_placed():
            placed = scene.camera
        else:
            focal = float(intrinsics[1, 1])
            fov_y = 2.0 * transforms.arc_tangent(size[1] / 2.0, focal)
            alike = dataclasses.replace(self, intrinsics=None, fov=fov_y)
            try:
                # The axis need not go through the middle of the picture: there is room around.
                placed = (
                    alike._fit(scene, size, steady=True)
                    if self.position is None
                    else alike._make_placed_camera(scene, size)
                )
            except ValueError as error:
                if "fov_y" not in str(error):
                    raise
                raise ValueError(
                    f"--intrinsics: the focal length {focal:g} of {size[1]} rows, a field of view "
                    f"of {fov_y:g} degrees, cannot be fitted to the scene; --pose places the camera"
                ) from error
        pose = transforms.compose(FLIP_YZ, placed.view_matrix())
        return make_camera(intrinsics, pose, size, scene)

    def turn(
        self, scene: Scene, size: tuple[int, int], animation: Animation | None = None
    ) -> Callable[[float], FittedCamera]:
        """
        Return the camera of a turntable as a function of the share of the turn, 0..1.

        It is always fitted: to the scene, or to all that an animation of it shows.
        """
        from rasterjit.animation.tracks import turntable

        azimuth, elevation = self._get_angles()
        return turntable(
            scene,
            azimuth=azimuth,
            elevation=elevation,
            animation=animation,
            **self._get_fit_arguments(scene, size),
        )

    def _get_fit_arguments(self, scene: Scene, size: tuple[int, int]) -> dict[str, Any]:
        """Return the arguments common to cameras that fit the scene."""
        usual = DEFAULT_FOV if self.position is None else POSITIONED_FOV
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
        from rasterjit.scene.camera_fitting import fit_camera, orbit_direction, rotate_y_to

        fitting = self._get_fit_arguments(scene, size)
        frame = rotate_y_to(fitting["up"])
        toward, upward = DEFAULT_DIRECTION, (0.0, 1.0, 0.0)
        if self.azimuth is not None or self.elevation is not None:
            azimuth, elevation = self._get_angles()
            toward = orbit_direction(azimuth, elevation)
            # Ninety degrees above the camera is up for it, at the poles as well.
            upward = orbit_direction(azimuth, elevation + 90.0)
        fitting["up"] = transforms.apply(frame, upward)
        return fit_camera(scene, transforms.apply(frame, toward), steady=steady, **fitting)

    def _get_angles(self) -> tuple[float, float]:
        """Return azimuth and elevation, degrees, given or default."""
        return (
            DEFAULT_AZIMUTH if self.azimuth is None else self.azimuth,
            DEFAULT_ELEVATION if self.elevation is None else self.elevation,
        )

    def _make_placed_camera(self, scene: Scene, size: tuple[int, int]) -> FittedCamera:
        """Return the camera at ``position``, its near and far plane around the scene."""
        import numpy as np

        from rasterjit.scene.camera_fitting import PLANE_MARGIN, choose_near_plane, rotate_y_to
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
            up = apply(rotate_y_to(up), (0.0, 0.0, math.copysign(1.0, x + y + z)))
        x, y, z = (center - eye).tolist()
        distance = math.sqrt(x * x + y * y + z * z)
        if self.projection == "orthographic":
            near, far = 0.0, (distance + radius) * (1.0 + PLANE_MARGIN) or 1.0
        else:
            near, far = choose_near_plane(distance, radius) or 1.0, math.inf
        return dataclasses.replace(fitted, eye=eye, target=target, up=up, near=near, far=far)


@dataclasses.dataclass(frozen=True)
class TimeOptions:
    """
    Options that choose a time of an animation.

    Parameters
    ----------
    time : float, optional
        Time of the animation that is shown; after its end, as at the end. Default: as the file
        poses itself, or 0 with --animation.
    animation : str, optional
        Name or number of one of the file's animations; default: 0, the first. rasterjit info lists
        them.
    """

    time: float | None = option(option_types.FiniteType(0.0), metavar="SECONDS")
    animation: str | None = option(None, metavar="NAME|NUMBER")

    def apply(self, scene: Scene, file: Path) -> Scene:
        """Return the scene at that time; unchanged if no option was given."""
        if self.time is None and self.animation is None:
            return scene
        option = "--animation" if self.time is None else "--time"
        chosen = find_animation(scene, file, self.animation, option)
        return scene.at(0.0 if self.time is None else self.time, chosen)


def find_animation(scene: Scene, file: Path, asked: str | None, option: str) -> Animation:
    """
    Return an animation by its name or, if none has that name, its index.

    Raises
    ------
    click.BadOptionUsage
        If there is none, or not this one.
    """
    names = [one.name for one in scene.animations]
    if not names:
        raise click.BadOptionUsage(option, f"{option}: {file.name} has no animation")
    if asked is None:
        return scene.animations[0]
    if asked in names:
        return scene.animations[names.index(asked)]
    if asked.isdecimal() and int(asked) < len(names):
        return scene.animations[int(asked)]
    listed = ", ".join(f"{number}: {name!r}" for number, name in enumerate(names))
    raise click.BadOptionUsage(
        "--animation",
        f"--animation: {file.name} has no {asked!r}, but {listed}{suggest(asked, names)}",
    )


@dataclasses.dataclass(frozen=True)
class Effects:
    """
    Options of effects and accuracy.

    Parameters
    ----------
    shadows : bool
        Let the lights cast shadows; a scene without lights gets a sun.
    environment : str, optional
        Light from all around: an equirectangular picture, or a sky.
    ambient_occlusion : bool
        Dim ambient light in corners.
    eye_dome : float, optional
        Darken what lies behind its neighbours, which shows depth without light; 1 is usual.
    outline : str, optional
        Draw outlines in this colour.
    outline_width : float, optional
        Width of outlines, pixels; for print, points * dots an inch / 72.
    hidden_lines : bool
        Dash the edges of faces that surfaces hide, in the colour of outlines.
    tone_map : str, optional
        Tone curve: from light to what a screen can show.
    exposure : float, optional
        Stops of exposure, doublings of the light before the curve.
    vignette : float, optional
        Darken the corners by this share of their light.
    section : tuple
        Cut away what lies in front of a plane: x=0.5 cuts away all x above 0.5, -x=0.5 all below;
        or a point and a normal, X,Y,Z,NX,NY,NZ. May be repeated.
    section_lines : str, optional
        Draw the outline of the cut in this colour.
    preset : str
        How accurately to render.
    changes : tuple of dict
        Change an accuracy setting, such as shadow_size=2048; may be repeated.
    samples : str, optional
        Samples of each pixel, for smooth edges; area is exact and slow. Short for --set
        samples=...
    style : str
        Of a command that has the option ``--style``.
    """

    shadows: bool = flag()
    environment: str | None = option(None, metavar="FILE|sky")
    ambient_occlusion: bool = flag()
    eye_dome: float | None = option(option_types.FiniteType(0.0, MAX_STRENGTH), metavar="STRENGTH")
    outline: str | None = option(option_types.opaque_color_type)
    outline_width: float | None = option(
        option_types.FiniteType(MIN_LINE_WIDTH, MAX_LINE_WIDTH), metavar="PIXELS"
    )
    hidden_lines: bool = flag()
    tone_map: str | None = option(click.Choice(CURVES))
    exposure: float | None = option(option_types.FiniteType(-MAX_STOPS, MAX_STOPS), metavar="STOPS")
    vignette: float | None = option(option_types.FiniteType(0.0, 1.0), metavar="SHARE")
    section: tuple[tuple[float, ...], ...] = option(
        option_types.plane_type, default=(), multiple=True, metavar="PLANE"
    )
    section_lines: str | None = option(option_types.opaque_color_type)
    preset: str = option(click.Choice(tuple(PRESETS)), "--quality", default="standard")
    changes: tuple[dict[str, Any], ...] = option(
        option_types.setting_type, "--set", default=(), multiple=True
    )
    samples: str | None = option(click.Choice(SAMPLE_CHOICES))
    style: str = "plain"

    def quality(self, of_style: Quality | None = None) -> Quality:
        """Return the quality, changed from a style's if one is given; or raise a usage error."""
        changed: dict[str, Any] = {}
        if self.samples is not None:
            changed["samples"] = self.samples if self.samples == "area" else int(self.samples)
        for change in self.changes:
            for name, level in change.items():
                if changed.setdefault(name, level) != level:
                    raise click.UsageError(f"{name} is given twice: {changed[name]} and {level}")
        try:
            return dataclasses.replace(of_style or PRESETS[self.preset](), **changed)
        except ValueError as error:
            raise click.UsageError(str(error)) from None

    def outline_changes(self) -> dict[str, Any]:
        """Return the fields of outlines that are given."""
        given = {
            "color": self.outline,
            "width": self.outline_width,
            "hidden": "dashed" if self.hidden_lines else None,
        }
        return {name: value for name, value in given.items() if value is not None}

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
        if self.shadows and (has_light or self.style not in STYLES_WITH_LAMP):
            _cast_shadows(scene)
        if self.ambient_occlusion:
            scene.ambient_occlusion = AmbientOcclusion()
        outlined = self.outline_changes()
        if outlined and self.style not in STYLES_WITH_OUTLINES:
            scene.outline = Outline(**outlined)
        if self.tone_map is not None or self.exposure is not None:
            scene.tone_map = ToneMap(self.tone_map or "none", self.exposure or 0.0)
        if self.vignette is not None:
            scene.vignette = Vignette(self.vignette)
        if self.eye_dome is not None:
            scene.eye_dome = EyeDome(self.eye_dome)
        if not self.section:
            refuse_unused(["section_lines"], "it is for --section")
        else:
            scene.section = _make_planes(self.section, self.section_lines)


def _make_planes(planes: tuple[tuple[float, ...], ...], lines: str | None) -> list[SectionPlane]:
    """Return planes of points and normals, with lines of a colour or without."""
    from rasterjit.scene.section import SectionPlane

    color = lines or "black"
    return [
        SectionPlane(plane[:3], plane[3:], lines=lines is not None, line_color=color)
        for plane in planes
    ]


def _cast_shadows(scene: Scene) -> None:
    """Let all lights but ambient ones cast shadows; add a sun if there is none."""
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


def apply_style(
    scene: Scene, camera: AnyCamera | None, look: SceneOptions, effects: Effects
) -> Style:
    """Return a scene in its style; options override the style."""
    from rasterjit import styles
    from rasterjit.scene.camera_fitting import default_camera
    from rasterjit.survey.light_culling import make_headlight

    if "headlight" in look.light and scene.nodes:
        seen_from = camera or scene.camera or default_camera(scene, (1, 1))
        scene.lights = make_headlight(seen_from)
    style = styles.STYLES[effects.style](scene, camera)
    if any(map(is_given, QUALITY_OPTIONS)):
        # Single settings change those of the style; a named quality replaces them.
        of_style = None if is_given("preset") else style.quality
        style = style.with_quality(effects.quality(of_style))
    if effects.style in STYLES_WITH_OUTLINES and style.scene.outline is not None:
        changes = effects.outline_changes()
        style.scene.outline = dataclasses.replace(style.scene.outline, **changes)
    return style


def gather_options(kind: type[Options], options: dict[str, Any]) -> Options:
    """Return the options of one class out of all those of a command."""
    names = [field.name for field in dataclasses.fields(kind) if field.name in options]
    return kind(**{name: options[name] for name in names})


class RenderOptions(NamedTuple):
    """The options of a picture: camera, scene, effects and time."""

    view: CameraOptions
    look: SceneOptions
    effects: Effects
    moment: TimeOptions


def gather_render_options(options: dict[str, Any]) -> RenderOptions:
    """Return the options of a picture, checked, or raise click's usage error."""
    made = RenderOptions(
        *(
            gather_options(kind, options)
            for kind in (CameraOptions, SceneOptions, Effects, TimeOptions)
        )
    )
    made.view.check()
    made.look.check()
    if made.effects.style in STYLES_WITH_COLORS:
        refuse_unused(PAINT_OPTIONS, f"--style {made.effects.style} has colours of its own")
    return made


def is_given(name: str) -> bool:
    """Tell whether the command line gives an option of the command that runs."""
    source = click.get_current_context().get_parameter_source(name)
    defaults = ParameterSource.DEFAULT, ParameterSource.DEFAULT_MAP, ParameterSource.ENVIRONMENT
    return source not in (None, *defaults)


def refuse_unused(names: Iterable[str], why: str) -> None:
    """Raise click's usage error for the first given option that has no effect."""
    options = {one.name: one for one in click.get_current_context().command.params}
    for name in names:
        if is_given(name):
            spelled = max(options[name].opts, key=len)
            raise click.BadOptionUsage(spelled, f"{spelled} has no effect here: {why}")


def refuse_without_color(outputs: tuple[str, ...]) -> None:
    """Raise click's usage error for options of colour if no output shows colour."""
    shown = f"the outputs are {', '.join(outputs)}"
    if "color" not in outputs:
        refuse_unused(CODE_OPTIONS, f"it acts on the output color alone, and {shown}")
    if not {"color", "linear"} & set(outputs):
        refuse_unused(COLOR_OPTIONS, f"no output shows colour: {shown}")
        if "scalar" not in outputs:
            refuse_unused(["scalars"], f"no output shows colour or scalar: {shown}")
        if "coverage" not in outputs:
            refuse_unused(["samples"], f"each pixel has one sample of what is no colour: {shown}")


def check_place(name: str, place: Path, kind: str) -> Path:
    """Return the value of an option that names a file to write, or raise click's usage error."""
    context = click.get_current_context()
    option = next(one for one in context.command.params if one.name == name)
    return option_types.file_type(kind).convert(str(place), option, context)


def is_picture(file: Path) -> bool:
    """Tell whether a file name is that of a picture or of buffers."""
    return file.suffix.lower() in option_types.list_formats("image")


def is_drawing(file: Path) -> bool:
    """Tell whether a file name is that of a line drawing; meshes may have such names, too."""
    return file.suffix.lower() in option_types.list_formats("drawing")


def refuse_picture(what: str, output: Path) -> None:
    """Raise click's usage error if several pictures share one output file."""
    if (is_picture(output) or is_drawing(output)) and not output.is_dir():
        raise click.BadOptionUsage(
            "--output",
            f"--output: {output} is the name of a file, and the pictures of {what} go into a "
            f"folder, such as {output.with_suffix('')}",
        )


look_options = add_options(SceneOptions)
reading_options = add_options(SceneOptions, READING_OPTIONS)
view_options = add_options(CameraOptions)
orbit_options = add_options(
    CameraOptions, ("azimuth", "elevation", "zoom", "fov", "projection", "up"),
    azimuth="Degrees around the scene of the first frame: 0 is +z, 90 is +x (z up: -y, +x).",
    zoom="How many times larger to show the scene.",
)  # fmt: skip
moment_options = add_options(TimeOptions)
effect_options = add_options(Effects)
quality_options = add_options(Effects, QUALITY_OPTIONS)
unsettled_options = add_options(
    Effects, {one.name for one in dataclasses.fields(Effects)} - set(QUALITY_OPTIONS)
)
