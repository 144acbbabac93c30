"""What a data set is made of, and from where its views are taken."""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Iterator, Sequence, Set
from typing import Any, Literal, TypeAlias, get_args

from rasterjit.animation.tracks import FULL_TURN, measured
from rasterjit.io.meshes import ON_DAMAGE, OnDamage
from rasterjit.outputs.table import MOTION_OUTPUTS, OUTPUTS, OutputName
from rasterjit.scene import transforms
from rasterjit.scene.assigning import says_replace
from rasterjit.scene.camera import Bounded, PerspectiveCamera
from rasterjit.scene.color import ColorLike, linear_color
from rasterjit.scene.framing import fit_camera, frame_of, orbit_direction
from rasterjit.scene.memory import DEFAULT_MAX_BYTES, MemoryBudget
from rasterjit.scene.mesh import ON_INVALID, OnInvalid
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.validation import (
    VectorLike,
    bounded_number,
    image_size,
    in_short,
    one_of,
    triple,
    whole_number,
)

Layout: TypeAlias = Literal["sphere", "random", "ring"]
LAYOUTS: tuple[Layout, ...] = get_args(Layout)
"""How cameras are placed."""

MOST_VIEWS = 10_000
"""Views of one mesh: their names have four digits."""

RecipeOutput: TypeAlias = OutputName | Literal["mask", "coco"]
RecipeOutputs: TypeAlias = RecipeOutput | Sequence[RecipeOutput] | Set[RecipeOutput]

MADE_OF: dict[str, OutputName] = {"mask": "object_id", "coco": "object_id"}
"""Outputs of a data set that no frame has, and what they are made of."""

CHOICES = tuple(
    name
    for name in dict.fromkeys(("color", "depth", "normal", "mask", "coco", *OUTPUTS))
    if name not in MOTION_OUTPUTS
)
"""Outputs that a data set can hold; motion needs an earlier view, which a mesh at rest has not."""

Direction = tuple[float, float, float]

GOLDEN_ANGLE = FULL_TURN / 2.0 * (3.0 - math.sqrt(5.0))
"""Degrees from one point of the lattice to the next: no two lie above each other."""


@says_replace
@dataclasses.dataclass(frozen=True)
class Recipe:
    """
    How each mesh of a data set is shown, and what is kept of it.

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
        Of ``"random"``. Each mesh has views of its own, which depend on the seed and its name.
    elevation : float, degrees
        Of ``"ring"``, in -90..90.
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
        that needs more is left out. Whoever goes on with a data set may say another number.
    isolate : bool
        Whether packages of others read files and decode pictures in a process with limits, as
        ``rasterjit.load(isolate="all")`` has it; a mesh that reaches one is left out. Whoever goes
        on with a data set may choose anew.

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
        if not isinstance(self.isolate, bool):
            raise ValueError(f"isolate must be True or False, got {in_short(self.isolate)}")
        checked = {
            "views": whole_number("views", self.views, 1, MOST_VIEWS),
            "outputs": _outputs(self.outputs),
            "size": image_size("size", self.size),
            "layout": one_of("layout", self.layout, LAYOUTS),
            "seed": whole_number("seed", self.seed, 0, 2**63 - 1),
            "elevation": bounded_number("elevation", self.elevation, -90.0, 90.0),
            "fov_y": float(self.fov_y),
            "up": triple("up", self.up),
            "background": _color(self.background),
            "quality": check_quality(self.quality),
            "on_invalid": one_of("on_invalid", self.on_invalid, ON_INVALID),
            "on_damage": one_of("on_damage", self.on_damage, ON_DAMAGE),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def frame_outputs(self) -> tuple[str, ...]:
        """Return the outputs that each frame is rendered with."""
        return tuple(dict.fromkeys(MADE_OF.get(name, name) for name in self.outputs))

    def describe(self) -> dict[str, Any]:
        """Return all that the pictures depend on in types of JSON: equal for equal recipes."""
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in dataclasses.asdict(self).items()
            if key not in ("max_bytes", "isolate")
        }


def _outputs(names: Any) -> tuple[str, ...]:
    """Return names of outputs without repeats, or raise ``ValueError``."""
    given = (names,) if isinstance(names, str) else names
    if not isinstance(given, (list, tuple, set, frozenset)) or not given:
        raise ValueError(f"outputs must name at least one output, got {in_short(names)}")
    for name in given:
        one_of("outputs", name, CHOICES)
    if "coco" in given and "color" not in given:
        raise ValueError(
            "outputs must name color with coco, which annotates the pictures; got "
            + ", ".join(given)
        )
    # One order, whatever that of a set is.
    return tuple(name for name in CHOICES if name in given)


def _color(value: Any) -> Any:
    """Return a colour as it can be compared and written: a text, or a tuple of floats."""
    linear = linear_color("background", value)
    return value if isinstance(value, str) else tuple(linear.tolist())


def view_cameras(scene: Bounded, recipe: Recipe, name: str = "") -> list[PerspectiveCamera]:
    """
    Return the cameras of a mesh, all at one distance from the middle of its bounding box.

    The distance fits the bounding sphere into the picture; the units are those of the mesh.

    Parameters
    ----------
    scene : Scene
    recipe : Recipe
    name : str
        Of the mesh: with the recipe's seed it decides about views at random.

    Raises
    ------
    ValueError
        If the scene has no extent that a camera fits.
    """
    if not isinstance(recipe, Recipe):
        raise ValueError(f"recipe must be a Recipe, got {in_short(recipe)}")
    frame = frame_of(recipe.up)
    upward = transforms.apply(frame, (0.0, 1.0, 0.0))
    sphere = measured(scene)
    return [
        fit_camera(
            sphere,
            transforms.apply(frame, direction),
            recipe.fov_y,
            up=upward,
            aspect=recipe.size[0] / recipe.size[1],
        )
        for direction in _directions(recipe, name)
    ]


def _directions(recipe: Recipe, name: str) -> Iterator[Direction]:
    """Yield where the cameras are, seen from the mesh, y up, of unit length."""
    count = recipe.views
    if recipe.layout == "ring":
        for number in range(count):
            yield orbit_direction(FULL_TURN * number / count, recipe.elevation)
    elif recipe.layout == "sphere":
        for number in range(count):
            yield _on_sphere(1.0 - (2 * number + 1) / count, GOLDEN_ANGLE * number)
    else:
        # Python promises the same numbers for the same text on every machine.
        source = random.Random(f"{recipe.seed}/{name}")
        for _ in range(count):
            height = 2.0 * source.random() - 1.0
            yield _on_sphere(height, FULL_TURN * source.random())


def _on_sphere(height: float, azimuth: float) -> Direction:
    """Return a point of the unit sphere; equal steps of height have equal areas (Archimedes)."""
    sine, cosine = transforms.sine_cosine(azimuth)
    radius = math.sqrt(1.0 - height * height)
    return radius * sine, height, radius * cosine
