"""
Meshes to pictures and exact ground-truth buffers on a CPU, with nothing but pip packages.

>>> import rasterjit as rj
>>> scene = rj.load("models/teapot.obj")
>>> camera = rj.PerspectiveCamera(eye=(4, 5, 9), target=(0, 1.5, 0), fov_y=40.0)
>>> frame = rj.render(scene, camera, size=(640, 480), outputs=("color", "depth", "face_id"))
>>> frame.save("teapot.png")

The names, by purpose; ``help(rj.render)`` and so on document each.

Scenes
    `load` reads any mesh file; a `Scene` has `Node` objects that place a `Mesh`, `Points` or
    `Lines`, from a file or made by you. Nodes move with their parents, and may have a `Label`.
    `Arrow` and `Arrows` are meshes of vectors. `Scene.save` writes glTF; a `SaveWarning` names what
    glTF cannot hold. A `Skin` deforms a mesh with nodes, `MorphTargets` by weights. An `Animation`
    of `Channel` moves nodes, and ``scene.at(time)`` is the scene at a time of it. A `Joint` of
    ``scene.joints`` (`Joints`) rotates or shifts a robot's link.
    `Axes`, `BoundingBox`, `Grid` and `Frustum` (of a camera) are ready-made `Lines`;
    `length_dimension`, `angle_dimension` and `radius_dimension` say what they measure.
    `Material` and `Texture` define how surfaces look, `Colormap` and `Contours` how scalars do.
    `AmbientLight`, `DirectionalLight`, `PointLight` and `SpotLight`, each with a `Shadow` or
    without, and an `Environment` light them. `Fog`, `AmbientOcclusion`, `EyeDome`, `Outline`,
    `Wireframe`, `ToneMap` and `Vignette` are effects of a whole scene. A `SectionPlane` cuts it
    open, `cross_section` measures the cut (`CrossSection`), `explode` moves parts apart.
Cameras
    `PerspectiveCamera`, `OrthographicCamera`, `MatrixCamera`, each with ``project``, ``unproject``
    and ``rays``; `fit_camera` and `orbit_direction` place one; `PinholeDistortion`, `FisheyeLens`
    or `Equirectangular` is its lens. `cameras` converts those of OpenCV, OpenGL, PyTorch3D, Blender
    and trimesh. `load_cameras` reads files of COLMAP, nerfstudio, Bundler and others as
    `CalibratedCamera` objects, and `save_cameras` writes them. `transforms` makes matrices.
Pictures and ground truth
    `render` draws a `Frame`: colour, and any of the buffers that `Frame` describes, such as motion
    since a `PreviousView`. `Renderer` reuses what frames have in common; `render_many` draws a
    stream of them, `render_batch` thousands of small ones into one array (`Batch`);
    `render_layers` finds the surfaces behind the nearest one (`LayeredFrame`). `Frame.save` writes
    and `Frame.show` shows frames; `grid` arranges them on a contact sheet; `masks` makes COCO
    annotations of them; `Frame.pick` tells which face a pixel shows, and where (`PickedPixel`);
    `Frame.to_pytorch3d` returns its triangles as PyTorch3D does (`PyTorch3DFragments`).
    `styles` has ready-made looks, such as ``rj.styles.studio(scene).render()``.
    `line_drawing` finds the visible edges and writes SVG and PDF (`LineDrawing`).
Animations, data sets, clusters
    `animation` has key frames, turntables, morphs, and GIF, APNG, WebP and MP4; `dataset` renders
    folders of meshes from all sides, and scenes with the visible and hidden part of each object;
    `distributed` draws on a Dask cluster what takes one machine too much time or memory.
Viewers
    `show` opens a window, a page, a notebook's widget or a terminal; `mpl` draws scenes into
    matplotlib's axes. Frames, scenes and meshes show themselves in notebooks.
Accuracy, speed and explanations
    `Quality` has all settings of accuracy; `accuracy` measures what each costs and gains.
    `explain` returns the `RenderPlan` of a frame, `profile` the time of its parts (`FrameProfile`),
    `explain_pixel` how a pixel came about (`PixelExplanation`); a frame has `FrameStats`,
    `QualityChoice` and `Diagnostics`. `oracle` is a slow, exact reference to check results with.
Single stages
    `Framebuffer` draws lines, triangles, circles and curves into an array; `ClassicPipeline` is one
    object's chain of transforms; `rasterize` finds the visible faces of geometry of your own
    (`RasterizedFaces`). ``rasterjit.compat.pyrender`` runs scripts that were written for pyrender.
    `types` has the types of arguments, for annotations.

Invalid arguments raise `ValueError`, which names the argument, before anything is drawn; files that
cannot be read raise its subclass `MeshFileError`. Reading an output that was not requested raises
`OutputNotRequestedError`. A `LoadWarning` names what of a file was left out. A `CalibrationWarning`
says that a time budget needed calibration first. A `ViewWarning` says that nothing is in view, that
a given near or far plane cuts off what would be, or that most of what is seen is overexposed.

World space is right-handed, y up; angles are degrees, colours in and out sRGB where they are 8-bit
and linear where they are floats; row 0 of a picture is on top.
"""

# First: Ctrl-C must end the command line while the rest is imported, and versions be checked.
from rasterjit import interrupts as interrupts
from rasterjit.runtime import versions as versions

# isort: split
import sys
from collections.abc import Iterator
from importlib import import_module

from rasterjit import forks

__version__ = "0.1.0"

_NAMES_BY_MODULE = {
    "classics.framebuffer": "Framebuffer",
    "classics.pipeline": "ClassicPipeline",
    "distributed.frames": "render_many",
    "hidden_lines.drawing": "LineDrawing line_drawing",
    "inspect.cross_section": "CrossSection cross_section",
    "inspect.exploded_view": "explode",
    "inspect.pixel": "explain_pixel",
    "inspect.pixel_report": "PixelExplanation",
    "inspect.profile": "FrameProfile profile",
    "io.camera_files": "load_cameras save_cameras",
    "io.camera_files.calibration": "CalibratedCamera",
    "io.meshes": "LoadWarning MeshFileError load",
    "io.load_warnings": "SaveWarning",
    "outputs.batch": "Batch",
    "outputs.diagnostics": "Diagnostics",
    "outputs.frame": (
        "Frame FrameStats LayeredFrame OutputNotRequestedError PickedPixel QualityChoice"
    ),
    "outputs.learning_tuples": "PyTorch3DFragments",
    "outputs.contact_sheet": "grid",
    "rendering.batch": "render_batch",
    "rendering.quality_selection": "CalibrationWarning",
    "rendering.view_warnings": "ViewWarning",
    "rendering.depth_peeling": "render_layers",
    "rendering.planning": "RenderPlan",
    "rendering.rasterize": "RasterizedFaces rasterize",
    "rendering.renderer": "Renderer explain render",
    "scene.ambient_occlusion": "AmbientOcclusion",
    "scene.arrows": "Arrow Arrows",
    "scene.camera": "MatrixCamera OrthographicCamera PerspectiveCamera",
    "scene.colormap": "Colormap",
    "scene.contours": "Contours",
    "scene.dimensions": "angle_dimension length_dimension radius_dimension",
    "scene.environment": "Environment",
    "scene.eye_dome": "EyeDome",
    "scene.fog": "Fog",
    "scene.camera_fitting": "fit_camera orbit_direction",
    "scene.guides": "Axes BoundingBox Frustum Grid",
    "scene.joints": "Joint Joints",
    "scene.keyframes": "Animation Channel",
    "scene.label": "Label",
    "scene.lens": "Equirectangular FisheyeLens PinholeDistortion",
    "scene.light": "AmbientLight DirectionalLight PointLight Shadow SpotLight",
    "scene.lines": "Lines",
    "scene.material": "Material",
    "scene.mesh": "Mesh",
    "scene.node": "Node",
    "scene.outline": "Outline",
    "scene.points": "Points",
    "scene.quality": "Quality",
    "scene.scene": "Scene",
    "scene.section": "SectionPlane",
    "scene.skin": "MorphTargets Skin",
    "scene.texture": "Texture",
    "scene.tone_map": "ToneMap",
    "scene.previous_view": "PreviousView",
    "scene.vignette": "Vignette",
    "scene.wireframe": "Wireframe",
    "viewer.show": "show",
}
"""The module of each public name. ``__init__.pyi`` tells type checkers the same."""

_MODULES = (
    "accuracy", "animation", "cameras", "dataset", "distributed", "masks", "mpl", "oracle",
    "styles", "transforms", "types",
)  # fmt: skip
"""
Public modules.

``from rasterjit import *`` leaves out two: ``mpl`` cannot be without matplotlib, and ``types`` is
the name of a standard module.
"""

_MODULE_OF = {name: module for module, names in _NAMES_BY_MODULE.items() for name in names.split()}

__all__ = sorted({*_MODULE_OF, *_MODULES} - {"mpl", "types"})


class _Folder(list[str]):
    """The package's folder; empty for pydoc, so that ``help`` lists no internal modules."""

    def __iter__(self) -> Iterator[str]:
        frame = sys._getframe(1)
        callers = [caller.f_globals.get("__name__") for caller in (frame, frame.f_back) if caller]
        return iter(()) if callers == ["pkgutil", "pydoc"] else super().__iter__()


__path__ = _Folder(__path__)


def __dir__() -> list[str]:
    """List the public names for ``help`` and completion; internal ones stay importable."""
    loaded = [name for name in _MODULES if name in globals()]
    special = [
        name for name, value in globals().items() if name[:2] == "__" and not callable(value)
    ]
    return sorted({*__all__, "types", *loaded, *special})


_IMPORT_LOCK = forks.hold_over_forks(forks.reentrant_lock())
"""Held while a name is imported: two threads cannot import NumPy at once."""


def __getattr__(name: str) -> object:
    """Import a public name when it is first needed."""
    if name not in _MODULES and name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with _IMPORT_LOCK:
        if name in _MODULES:
            return import_module(f"rasterjit.{name}")
        value = globals()[name] = getattr(import_module(f"rasterjit.{_MODULE_OF[name]}"), name)
        return value
