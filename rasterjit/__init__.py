"""
Meshes to pictures and exact ground-truth buffers on a CPU, with nothing but pip packages.

>>> import rasterjit as rj
>>> scene = rj.load("models/teapot.obj")
>>> camera = rj.PerspectiveCamera(eye=(4, 5, 9), target=(0, 1.5, 0), fov_y=40.0)
>>> frame = rj.render(scene, camera, size=(640, 480), outputs=("color", "depth", "face_id"))
>>> frame.save("teapot.png")

The names, by what they are for; ``help(rj.render)`` and so on tell the rest.

What is drawn
    `load` reads any mesh file; `Mesh`, `Points`, `Lines`, `Node` and `Scene` hold what it had, or
    what you make; nodes move with those that they hang below, and may carry a `Label`. `Arrow` and
    `Arrows` are meshes of vectors. `Scene.save` writes glTF, and a `SaveWarning` names what that
    has no word for. A `Skin` lets a mesh follow nodes, `MorphTargets` bend it by weights; an
    `Animation` of `Channel` moves nodes, and ``scene.at(time)`` is the scene at a time of it.
    `Axes`, `BoundingBox`, `Grid` and `Frustum` (of a camera) are `Lines` that are made for you.
    `Material` and `Texture` are what surfaces look like, `Colormap` and `Contours` what scalars do;
    `AmbientLight`, `DirectionalLight`, `PointLight` and `SpotLight`, each with a `Shadow` or
    without, and an `Environment` light them. `Fog`, `AmbientOcclusion`, `EyeDome`, `Outline`,
    `Wireframe`, `ToneMap` and `Vignette` are effects of a whole scene, which a `SectionPlane` cuts
    open.
From where
    `PerspectiveCamera`, `OrthographicCamera`, `MatrixCamera`, each with ``project``, ``unproject``
    and ``rays``; `fit_camera` and `orbit_direction` place one; `PinholeDistortion`, `FisheyeLens`
    or `Equirectangular` is its lens. `cameras` converts those of OpenCV, OpenGL, PyTorch3D, Blender
    and trimesh. `transforms` has the matrices.
Pictures and ground truth
    `render` draws one `Frame`: colour, and any of the buffers that `Frame` describes, of motion
    since a `PreviousView` as well. `Renderer` keeps what frames have in common; `render_many`
    draws a stream of them, `render_batch` thousands of small ones into one array (`Batch`);
    `render_layers` finds the surfaces behind the nearest one (`LayeredFrame`). `Frame.save` writes
    and `Frame.show` shows them; `grid` lays them out on a contact sheet; `masks` makes COCO
    annotations of them; `Frame.pick` tells which face a pixel shows, and where (`PickedPixel`).
    `styles` has looks that are ready made, such as ``rj.styles.studio(scene).render()``.
Moving pictures, data sets, clusters
    `animation` has keys, turntables, morphs and GIF, APNG, WebP and MP4; `dataset` renders folders
    of meshes from all sides; `distributed` draws on a Dask cluster what one machine has no time,
    or no memory, for.
To look at
    `show` opens a window, a page, a notebook's widget or a terminal; `mpl` draws scenes into
    matplotlib's axes. Frames, scenes and meshes show themselves in notebooks.
How accurate, how fast, and why
    `Quality` has every setting of accuracy; `accuracy` measures what each costs and buys.
    `explain` tells the `RenderPlan` of a frame, `profile` what its parts take (`FrameProfile`),
    `explain_pixel` how one pixel came about (`PixelExplanation`); `FrameStats`, `QualityChoice` and
    `Diagnostics` belong to a frame. `oracle` is the slow, exact reference to check any of it with.
The parts alone
    `Framebuffer` draws lines, triangles, circles and curves into an array; `ClassicPipeline` is one
    object's chain of transforms; `rasterize` finds the visible faces of geometry of your own
    (`RasterizedFaces`). ``rasterjit.compat.pyrender`` runs scripts that were written for pyrender.
    `types` has the types of arguments, for annotations.

Invalid arguments raise `ValueError`, which names the argument, before anything is drawn; files that
cannot be read raise `MeshFileError`, one of them. Reading an output that was not asked for raises
`OutputNotRequestedError`. A `LoadWarning` names what of a file was left out, a `CalibrationWarning`
says that a time budget had to be learnt first, a `ViewWarning` that nothing is in view, that a near
or far plane that was given cuts away what else were, or that light burns out most of what is seen.

World space is right-handed, y up; angles are degrees, colours in and out sRGB where they are 8-bit
and linear where they are floats; row 0 of a picture is on top.
"""

# First: so that Ctrl-C ends the command line while the rest is imported, and versions are checked.
from rasterjit import interrupts as interrupts
from rasterjit.runtime import versions as versions

# isort: split
import sys
from collections.abc import Iterator
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rasterjit.classics.framebuffer import Framebuffer
from rasterjit.classics.pipeline import ClassicPipeline
from rasterjit.distributed.many import render_many
from rasterjit.inspect.pixel import explain_pixel
from rasterjit.inspect.pixel_report import PixelExplanation
from rasterjit.inspect.profile import FrameProfile, profile
from rasterjit.io.gltf.writing import save_gltf
from rasterjit.io.meshes import LoadWarning, MeshFileError, as_scene, load, scene_to_add
from rasterjit.io.skipped import SaveWarning
from rasterjit.io.trimesh.writing import to_trimesh
from rasterjit.outputs.batch import Batch
from rasterjit.outputs.diagnostics import Diagnostics
from rasterjit.outputs.frame import (
    Frame,
    FrameStats,
    LayeredFrame,
    OutputNotRequestedError,
    PickedPixel,
    QualityChoice,
)
from rasterjit.outputs.grid import grid
from rasterjit.rendering.batch import render_batch
from rasterjit.rendering.budget import CalibrationWarning
from rasterjit.rendering.notices import ViewWarning
from rasterjit.rendering.peel import render_layers
from rasterjit.rendering.plan import RenderPlan
from rasterjit.rendering.rasterize import RasterizedFaces, rasterize
from rasterjit.rendering.renderer import Renderer, explain, render
from rasterjit.runtime import packing as packing
from rasterjit.scene import transforms
from rasterjit.scene.ambient_occlusion import AmbientOcclusion
from rasterjit.scene.arrows import Arrow, Arrows
from rasterjit.scene.camera import MatrixCamera, OrthographicCamera, PerspectiveCamera
from rasterjit.scene.colormap import Colormap
from rasterjit.scene.contours import Contours
from rasterjit.scene.environment import Environment
from rasterjit.scene.eye_dome import EyeDome
from rasterjit.scene.fog import Fog
from rasterjit.scene.framing import fit_camera, orbit_direction
from rasterjit.scene.guides import Axes, BoundingBox, Frustum, Grid
from rasterjit.scene.hooks import set_hooks
from rasterjit.scene.keyframes import Animation, Channel
from rasterjit.scene.label import Label
from rasterjit.scene.lens import Equirectangular, FisheyeLens, PinholeDistortion
from rasterjit.scene.light import AmbientLight, DirectionalLight, PointLight, Shadow, SpotLight
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.outline import Outline
from rasterjit.scene.points import Points
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.section import SectionPlane
from rasterjit.scene.skin import MorphTargets, Skin
from rasterjit.scene.texture import Texture
from rasterjit.scene.tone_map import ToneMap
from rasterjit.scene.view import PreviousView
from rasterjit.scene.vignette import Vignette
from rasterjit.scene.wireframe import Wireframe
from rasterjit.survey.posing import posed_scene

if TYPE_CHECKING:
    from rasterjit import accuracy, animation, cameras, dataset, distributed, masks, oracle, styles
    from rasterjit import mpl as mpl
    from rasterjit import types as types
    from rasterjit.viewer.show import show


def _show_frame(frame: Frame, color: Any, title: str) -> None:
    """Show a frame; what does so is loaded when it is first needed."""
    import_module("rasterjit.viewer.picture").show_picture(frame, color, title)


def _preview(what: Scene | Mesh) -> Frame | None:
    """Return a small picture; what draws it is loaded when it is first needed."""
    picture: Frame | None = import_module("rasterjit.styles.preview").preview(what)
    return picture


set_hooks(
    picture=_preview, show=_show_frame, as_scene=as_scene, scene_of_others=scene_to_add,
    save=save_gltf, to_trimesh=to_trimesh, posed=posed_scene,
)  # fmt: skip
del as_scene, posed_scene, save_gltf, scene_to_add, set_hooks, to_trimesh

__version__ = "0.1.0"

__all__ = [
    "AmbientLight",
    "AmbientOcclusion",
    "Animation",
    "Arrow",
    "Arrows",
    "Axes",
    "Batch",
    "BoundingBox",
    "CalibrationWarning",
    "Channel",
    "ClassicPipeline",
    "Colormap",
    "Contours",
    "Diagnostics",
    "DirectionalLight",
    "Environment",
    "Equirectangular",
    "EyeDome",
    "FisheyeLens",
    "Fog",
    "Frame",
    "FrameProfile",
    "FrameStats",
    "Framebuffer",
    "Frustum",
    "Grid",
    "Label",
    "LayeredFrame",
    "Lines",
    "LoadWarning",
    "Material",
    "MatrixCamera",
    "Mesh",
    "MeshFileError",
    "MorphTargets",
    "Node",
    "OrthographicCamera",
    "Outline",
    "OutputNotRequestedError",
    "PerspectiveCamera",
    "PickedPixel",
    "PinholeDistortion",
    "PixelExplanation",
    "PointLight",
    "Points",
    "PreviousView",
    "Quality",
    "QualityChoice",
    "RasterizedFaces",
    "RenderPlan",
    "Renderer",
    "SaveWarning",
    "Scene",
    "SectionPlane",
    "Shadow",
    "Skin",
    "SpotLight",
    "Texture",
    "ToneMap",
    "ViewWarning",
    "Vignette",
    "Wireframe",
    "accuracy",
    "animation",
    "cameras",
    "dataset",
    "distributed",
    "explain",
    "explain_pixel",
    "fit_camera",
    "grid",
    "load",
    "masks",
    "oracle",
    "orbit_direction",
    "profile",
    "rasterize",
    "render",
    "render_batch",
    "render_layers",
    "render_many",
    "show",
    "styles",
    "transforms",
]

_MODULES = (
    "accuracy", "animation", "cameras", "dataset", "distributed", "masks", "mpl", "oracle",
    "styles", "types",
)  # fmt: skip
"""
Those that are loaded when they are first named.

``from rasterjit import *`` leaves out two: ``mpl`` cannot be without matplotlib, and ``types`` is
the name of a standard module.
"""


class _Folder(list[str]):
    """The package's folder, in which pydoc alone finds nothing: ``help`` would list the inside."""

    def __iter__(self) -> Iterator[str]:
        caller = sys._getframe(1)
        asks = (frame.f_globals.get("__name__") for frame in (caller, caller.f_back) if frame)
        return iter(()) if tuple(asks) == ("pkgutil", "pydoc") else super().__iter__()


__path__ = _Folder(__path__)


def __dir__() -> list[str]:
    """Name what is public, which ``help`` and completion list; what is inside stays importable."""
    loaded = [name for name in _MODULES if name in globals()]
    facts = [name for name, value in globals().items() if name[:2] == "__" and not callable(value)]
    return sorted({*__all__, "types", *loaded, *facts})


if not TYPE_CHECKING:  # A type checker that saw this would let every name pass.

    def __getattr__(name: str) -> object:
        """Load what rendering needs nothing of when it is first named."""
        if name == "show":
            return import_module("rasterjit.viewer.show").show
        if name in _MODULES:
            return import_module(f"rasterjit.{name}")
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
