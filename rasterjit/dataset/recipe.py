"""Define a data set: its outputs and cameras; render the views of a mesh."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import random
import shutil
import uuid
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from rasterjit.animation.tracks import DEGREES_PER_TURN, measure_sphere
from rasterjit.io import images
from rasterjit.io.atomic_write import atomic_file, write_text
from rasterjit.io.meshes import ON_DAMAGE, OnDamage, load
from rasterjit.outputs import masks
from rasterjit.outputs.frame import Frame
from rasterjit.outputs.output_table import MOTION_OUTPUTS, OUTPUTS, OutputName
from rasterjit.rendering.batch import check_arguments, share_threads
from rasterjit.rendering.renderer_pool import draw_in_turns
from rasterjit.rendering.view_warnings import ViewWarning
from rasterjit.scene import transforms, validation
from rasterjit.scene.attribute_guard import suggests_replace
from rasterjit.scene.camera import Bounded, PerspectiveCamera
from rasterjit.scene.camera_fitting import fit_camera, orbit_direction, rotate_y_to
from rasterjit.scene.color import ColorLike, linear_color
from rasterjit.scene.memory_limits import DEFAULT_MAX_BYTES, MemoryBudget
from rasterjit.scene.mesh import ON_INVALID, OnInvalid
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import VectorLike
from rasterjit.scene.warning import gather_warnings, warn_caller

Layout: TypeAlias = Literal["sphere", "random", "ring"]
LAYOUTS: tuple[Layout, ...] = get_args(Layout)
"""Layouts of the cameras."""

MAX_VIEWS = 10_000
"""Most views of one mesh: their file names have four digits."""

RecipeOutput: TypeAlias = OutputName | Literal["mask", "coco"]
RecipeOutputs: TypeAlias = RecipeOutput | Sequence[RecipeOutput] | Set[RecipeOutput]

DERIVED_FROM: dict[str, OutputName] = {"mask": "object_id", "coco": "object_id"}
"""Outputs of a data set that no frame has, each with the frame's output that it is made from."""

OUTPUT_CHOICES = tuple(
    name
    for name in dict.fromkeys(("color", "depth", "normal", "mask", "coco", *OUTPUTS))
    if name not in MOTION_OUTPUTS
)
"""Outputs that a data set can hold: all but motion, which needs an earlier view."""

Direction = tuple[float, float, float]

GOLDEN_ANGLE = DEGREES_PER_TURN / 2.0 * (3.0 - math.sqrt(5.0))
"""Angle from one point of the lattice to the next, degrees."""


@suggests_replace
@dataclasses.dataclass(frozen=True)
class Recipe:
    """
    Views, outputs and options of every mesh of a data set.

    Parameters
    ----------
    views : int
        Pictures of each mesh, 1..10000.
    outputs : sequence of str
        ``"color"`` (PNG, RGBA), ``"depth"`` (16-bit PNG), ``"normal"`` (16-bit PNG, world space),
        ``"mask"`` (PNG, 255 where the mesh is), ``"coco"`` (one ``coco.json``, an annotation of
        every object in every view; with ``"color"`` only, whose pictures it names), and any other
        output of a frame but motion (``.npz``).
    size : (int, int)
        Width and height, pixels.
    layout : {"sphere", "random", "ring"}
        Cameras all around, evenly (a Fibonacci lattice); all around, at random; or evenly on a
        circle.
    seed : int
        Seed of the layout ``"random"``. The views of a mesh depend on the seed and its name.
    elevation : float, degrees
        Elevation of the layout ``"ring"``, in -90..90.
    fov_y : float, degrees
        Vertical field of view.
    up : (3,) array_like
        Which way is up in the meshes.
    background : color
        As in `rasterjit.render`.
    quality : Quality, optional
        Default ``Quality.standard()``.
    on_invalid : {"raise", "drop"}
        What to do about NaN or infinite vertices: to leave out the mesh, or the faces.
    on_damage : {"error", "warn"}
        What to do about damaged files, as `rasterjit.load` has it: to leave out the mesh, or to
        draw what there is.
    max_bytes : int
        Memory that a mesh file and all that it names may take, as `rasterjit.load` has it; a mesh
        that needs more is left out. It may change when a data set is resumed.
    isolate : bool
        Whether packages of others read files and decode pictures in a process with limits, as
        ``rasterjit.load(isolate="all")`` has it; a mesh that reaches one is left out. It may
        change when a data set is resumed.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """

    views: int = 24
    outputs: RecipeOutputs = ("color", "depth", "normal", "mask")
    size: tuple[int, int] = (512, 512)
    layout: Layout = "sphere"
    seed: int = 0
    elevation: float = 20.0
    fov_y: float = 45.0
    up: VectorLike = (0.0, 1.0, 0.0)
    background: ColorLike = "transparent"
    quality: Quality | None = None
    on_invalid: OnInvalid = "raise"
    on_damage: OnDamage = "error"
    max_bytes: int = DEFAULT_MAX_BYTES
    isolate: bool = True

    def __post_init__(self) -> None:
        transforms.focal_length(self.fov_y)
        transforms.unit_vector("up", self.up)
        MemoryBudget("", self.max_bytes)
        checked = {
            "isolate": validation.boolean("isolate", self.isolate),
            "views": validation.whole_number("views", self.views, 1, MAX_VIEWS),
            "outputs": _check_outputs(self.outputs),
            "size": validation.image_size("size", self.size),
            "layout": validation.one_of("layout", self.layout, LAYOUTS),
            "seed": validation.whole_number("seed", self.seed, 0, 2**63 - 1),
            "elevation": validation.bounded_number("elevation", self.elevation, -90.0, 90.0),
            "fov_y": float(self.fov_y),
            "up": validation.triple("up", self.up),
            "background": _check_color(self.background),
            "quality": check_quality(self.quality),
            "on_invalid": validation.one_of("on_invalid", self.on_invalid, ON_INVALID),
            "on_damage": validation.one_of("on_damage", self.on_damage, ON_DAMAGE),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def frame_outputs(self) -> tuple[str, ...]:
        """Return the outputs that each frame is rendered with."""
        return tuple(dict.fromkeys(DERIVED_FROM.get(name, name) for name in self.outputs))

    def describe(self) -> dict[str, Any]:
        """Return the options that the pictures depend on as JSON values."""
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in dataclasses.asdict(self).items()
            if key not in ("max_bytes", "isolate")
        }


def _check_outputs(names: Any) -> tuple[str, ...]:
    """Return names of outputs without repeats, or raise ``ValueError``."""
    choices = (names,) if isinstance(names, str) else names
    if not isinstance(choices, (list, tuple, set, frozenset)) or not choices:
        raise ValueError(f"outputs must name at least one output, got {validation.brief(names)}")
    for name in choices:
        validation.one_of("outputs", name, OUTPUT_CHOICES)
    if "coco" in choices and "color" not in choices:
        raise ValueError(
            "outputs must name color with coco, which annotates the pictures; got "
            + ", ".join(choices)
        )
    # Sets have no order.
    return tuple(name for name in OUTPUT_CHOICES if name in choices)


def _check_color(value: Any) -> Any:
    """Return a colour as a JSON value: a text, or a tuple of linear floats."""
    linear = linear_color("background", value)
    return value if isinstance(value, str) else tuple(linear.tolist())


def view_cameras(scene: Bounded, recipe: Recipe, name: str = "") -> list[PerspectiveCamera]:
    """
    Return the cameras of a mesh, all at one distance from the middle of its bounding box.

    The distance fits the bounding sphere into the picture, in the units of the mesh.

    Parameters
    ----------
    scene : Scene
    recipe : Recipe
    name : str
        Name of the mesh: random views depend on it and the recipe's seed.

    Raises
    ------
    ValueError
        If the scene has no extent that a camera fits.
    """
    validation.instance_of("recipe", recipe, Recipe)
    rotation = rotate_y_to(recipe.up)
    upward = transforms.apply(rotation, (0.0, 1.0, 0.0))
    sphere = measure_sphere(scene)
    return [
        fit_camera(
            sphere,
            transforms.apply(rotation, direction),
            recipe.fov_y,
            up=upward,
            aspect=recipe.size[0] / recipe.size[1],
        )
        for direction in _list_directions(recipe, name)
    ]


def _list_directions(recipe: Recipe, name: str) -> Iterator[Direction]:
    """Yield unit directions from the mesh to the cameras, y up."""
    count = recipe.views
    if recipe.layout == "ring":
        for number in range(count):
            yield orbit_direction(DEGREES_PER_TURN * number / count, recipe.elevation)
    elif recipe.layout == "sphere":
        for number in range(count):
            yield _point_on_sphere(1.0 - (2 * number + 1) / count, GOLDEN_ANGLE * number)
    else:
        # Python guarantees the same numbers for the same text on every machine.
        generator = random.Random(f"{recipe.seed}/{name}")
        for _ in range(count):
            height = 2.0 * generator.random() - 1.0
            yield _point_on_sphere(height, DEGREES_PER_TURN * generator.random())


def _point_on_sphere(height: float, azimuth: float) -> Direction:
    """Return a point of the unit sphere; equal steps of height have equal areas (Archimedes)."""
    sine, cosine = transforms.sine_cosine(azimuth)
    radius = math.sqrt(1.0 - height * height)
    return radius * sine, height, radius * cosine


MANIFEST_NAME = "transforms.json"
"""Name of the file that is written last: a mesh with it is done."""

PARTIAL_PREFIX = ".partial-"
"""Prefix of the names of unfinished folders."""

MAX_DEPTH_CODE = 65535
"""Largest code of a 16-bit PNG: that of the far plane."""

OUTPUT_FOLDERS = {"color": "images"}
"""Folders of outputs, where they differ from the output's name."""

PATH_KEYS = {
    "color": ("file_path",),
    "depth": ("depth_path", "depth_file_path"),
    "mask": ("mask_path",),
}
"""Keys of the files in the manifest; others are ``<output>_path``."""

BLACK, WHITE = np.uint8(0), np.uint8(255)
"""Codes of masks."""

MAX_REASON_LENGTH = 300
"""Most characters of the reason why a mesh has failed."""

JSON_DIGITS = 12
"""Significant digits of JSON numbers that no picture depends on."""


class MeshError(Exception):
    """A mesh cannot be read or rendered; the data set goes on without it."""


class Cancelled(Exception):  # noqa: N818
    """The work was cancelled between two views."""


def _ignore_cancel() -> None:
    """Never cancel the work."""


class MeshResult(NamedTuple):
    """Failure and warnings of a mesh file."""

    failure: str | None
    """Why it cannot be read or rendered, in one line; ``None`` when it is done."""
    warnings: tuple[str, ...]
    """Warnings of reading and rendering, a line each."""


def render_mesh_file(
    source: Path,
    name: str,
    output: Path,
    recipe: Recipe,
    threads: int | None,
    check: Callable[[], None] = _ignore_cancel,
) -> MeshResult:
    """
    Render all views of a mesh file into ``output / name``, whole or not at all.

    Parameters
    ----------
    source : Path
        The mesh file.
    name : str
        Name of its folder.
    output : Path
        Folder of the data set.
    recipe : Recipe
    threads : int or None
    check : callable
        Called before each view; what it raises ends the work.

    Returns
    -------
    MeshResult

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    failure = None
    with gather_warnings() as gathered:
        try:
            with atomic_folder(output, name) as folder:
                with _as_mesh_error(source, name):
                    scene = load(
                        source, on_invalid=recipe.on_invalid, on_damage=recipe.on_damage,
                        max_bytes=recipe.max_bytes, isolate="all" if recipe.isolate else False,
                    )  # fmt: skip
                render_views(scene, folder, recipe, name=name, threads=threads, check=check)
        except MeshError as error:
            failure = str(error)
    # Replace the path, so that messages do not depend on where the meshes are.
    messages = (_unwrap(warning).replace(str(source), name) for warning in gathered)
    return MeshResult(failure, tuple(dict.fromkeys(messages)))


def render_views(
    scene: Scene,
    folder: str | Path,
    recipe: Recipe,
    *,
    name: str = "",
    threads: int | None = None,
    check: Callable[[], None] = _ignore_cancel,
) -> None:
    """
    Render all views of a scene into a folder, and write ``transforms.json`` last.

    Parameters
    ----------
    scene : Scene
    folder : str or Path
        An existing folder; files of the same names are replaced.
    recipe : Recipe
    name : str
        Name of the mesh, for random views.
    threads : int, optional
        Default: all processors. The files are the same for any number.
    check : callable
        Called before each view; what it raises ends the work.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    MeshError
        If the scene cannot be rendered.
    OSError
        If a file cannot be written.
    """
    target = _check_arguments(scene, folder, recipe, name, check)
    count, _ = share_threads(threads, None)
    with _as_mesh_error(target, name):
        cameras = view_cameras(scene, recipe, name)
        depth_scale = max(camera.far for camera in cameras) / MAX_DEPTH_CODE
    views: list[dict[str, Any]] = []
    annotation: dict[str, Any] = {}
    for output in recipe.outputs:
        if output != "coco":
            (target / _name_folder(output)).mkdir(exist_ok=True)
    with _as_mesh_error(target, name):
        checked_scene, options = check_arguments(
            scene, recipe.size, recipe.quality, recipe.frame_outputs(), recipe.background, "none"
        )
    with closing(draw_in_turns(checked_scene, cameras, options, count)) as drawn_frames:
        for number, camera in enumerate(cameras):
            check()
            with _as_mesh_error(target, name):
                frame = _take_frame(drawn_frames, number)
            try:
                paths = _write_view(frame, target, number, recipe, depth_scale)
            except ValueError as error:
                # For example, a depth that no code stands for.
                raise MeshError(_unwrap(error)) from error
            views.append({**paths, "transform_matrix": _find_pose(camera)})
            if "coco" in recipe.outputs:
                with _as_mesh_error(target, name):
                    _add_annotation(annotation, paths["file_path"], frame.object_id, scene)
    if annotation:
        with atomic_file(target / "coco.json") as temporary:
            temporary.write_text(json.dumps(annotation), encoding="utf-8")
    with _as_mesh_error(target, name):
        document = _list_intrinsics(cameras[0], recipe.size) | _find_unit_cube(scene)
    if "depth" in recipe.outputs:
        document |= {"enable_depth_loading": True, "integer_depth_scale": depth_scale}
    write_json(target / MANIFEST_NAME, {**document, "frames": views})


def write_json(path: Path, document: Any) -> None:
    """Write a JSON file atomically."""
    write_text(path, json.dumps(document, indent=1, ensure_ascii=False) + "\n")


@contextmanager
def atomic_folder(output: Path, name: str) -> Iterator[Path]:
    """Yield a folder to build in; move it to ``output / name`` on success, else remove it."""
    partial = output / f"{PARTIAL_PREFIX}{uuid.uuid4().hex}"
    partial.mkdir()
    try:
        yield partial
        target = output / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.is_dir():
            shutil.rmtree(target)
        os.replace(partial, target)
    except OSError as error:
        # Name the final path, not that of the unfinished folder.
        final_path = str(error.filename or "").replace(str(partial), str(output / name))
        error.filename = final_path or str(output / name)
        raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def _as_mesh_error(source: Path, name: str) -> Iterator[None]:
    """Turn errors of reading and rendering into `MeshError`."""
    try:
        yield
    except MemoryError:
        raise MeshError("not enough memory") from None
    except Exception as error:
        # Replace the path, so that messages do not depend on where the meshes are.
        raise MeshError(_unwrap(error).replace(str(source), name)[:MAX_REASON_LENGTH]) from error


def _check_arguments(scene: Any, folder: Any, recipe: Any, name: Any, check: Any) -> Path:
    """Check all arguments; return the folder to render into, or raise ``ValueError``."""
    validation.instance_of("scene", scene, Scene)
    target = validation.existing_folder("folder", folder)
    validation.instance_of("recipe", recipe, Recipe)
    validation.string("name", name)
    if not callable(check):
        raise ValueError(f"check must be a function, got {validation.brief(check)}")
    return target


def _take_frame(frames: Iterator[Frame], view: int) -> Frame:
    """Return the next frame; put the number of the view in front of its warnings."""
    with gather_warnings() as gathered:
        frame = next(frames)
    for one in gathered:
        warn_caller(ViewWarning(f"view {view}: {one}") if isinstance(one, ViewWarning) else one)
    return frame


def _unwrap(error: Exception | Warning | str) -> str:
    """Return the message of an error as one line."""
    return " ".join(str(error).split()) or type(error).__name__


def _name_folder(output: str) -> str:
    """Return the name of the folder of an output."""
    return OUTPUT_FOLDERS.get(output, output)


def _write_view(
    frame: Frame, target: Path, number: int, recipe: Recipe, depth_scale: float
) -> dict[str, str]:
    """Write the files of one view; return their paths by `PATH_KEYS`."""
    paths: dict[str, str] = {}
    for output in recipe.outputs:
        if output == "coco":
            continue
        is_picture = output in ("color", "depth", "normal", "mask")
        path = f"{_name_folder(output)}/{number:04d}{'.png' if is_picture else '.npz'}"
        if output == "mask":
            images.save_image(target / path, np.where(frame.object_id >= 0, WHITE, BLACK))
        else:
            scale = depth_scale if output == "depth" else None
            frame.save(target / path, output, scale=scale)
        paths |= dict.fromkeys(PATH_KEYS.get(output, (f"{output}_path",)), path)
    return paths


def _add_annotation(
    annotation: dict[str, Any], path: str, ids: NDArray[np.int32], scene: Scene
) -> None:
    """Add one view to a COCO annotation, which may be empty."""
    names = [str(node.name) or f"object {number}" for number, node in enumerate(scene.nodes)]
    view = masks.coco([(path, ids)], names)
    if not annotation:
        annotation.update(view)
        return
    image_id, count = len(annotation["images"]) + 1, len(annotation["annotations"])
    annotation["images"] += [image | {"id": image_id} for image in view["images"]]
    annotation["annotations"] += [
        mask | {"id": count + mask["id"], "image_id": image_id} for mask in view["annotations"]
    ]


def _find_pose(camera: PerspectiveCamera) -> list[list[float]]:
    """Return the pose of the camera, ``world_from_view``: x right, y up, z backwards."""
    return transforms.inverse(camera.view_matrix()).tolist()


def _list_intrinsics(camera: PerspectiveCamera, size: tuple[int, int]) -> dict[str, Any]:
    """Return the intrinsics of all views; pixel centres lie at halves."""
    from rasterjit.io.camera_files.calibration import Intrinsics
    from rasterjit.io.camera_files.transforms_json import list_intrinsics

    width, height = size
    focal = transforms.focal_length(camera.fov_y) * height / 2.0
    return list_intrinsics(
        Intrinsics(size, focal, focal, 0.0, width / 2.0, height / 2.0, lens=None)
    )


def _find_unit_cube(scene: Scene) -> dict[str, Any]:
    """Return instant-ngp's transform of the scene to its unit cube: ``scale * x + offset``."""
    center, radius = scene.bounding_sphere()
    scale = _round_for_json(0.5 / radius) if radius > 0.0 else 1.0
    offset = [_round_for_json(0.5 - scale * x) for x in center.tolist()]
    return {"aabb_scale": 1, "scale": scale, "offset": offset}


def _round_for_json(value: float) -> float:
    """Return a number rounded to `JSON_DIGITS`."""
    return float(f"{value:.{JSON_DIGITS}g}")
