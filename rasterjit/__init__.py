"""
Meshes to pictures and exact ground-truth buffers on a CPU, with nothing but pip packages.

>>> import rasterjit as rj
>>> scene = rj.load("models/teapot.obj")
>>> camera = rj.PerspectiveCamera(eye=(4, 5, 9), target=(0, 1.5, 0), fov_y=40.0)
>>> frame = rj.render(scene, camera, size=(640, 480), outputs=("color", "depth", "face_id"))
>>> frame.save("teapot.png")
"""

from importlib import import_module
from typing import Any

from rasterjit import transforms
from rasterjit.diagnostics import Diagnostics
from rasterjit.dial import CalibrationWarning
from rasterjit.explanation import PixelExplanation
from rasterjit.frame import Choice, Frame, LayeredFrame, OutputNotRequestedError, Stats
from rasterjit.framebuffer import Framebuffer
from rasterjit.io.meshes import load
from rasterjit.many import render_many
from rasterjit.measurement import Measurement, measure
from rasterjit.notebook import preview
from rasterjit.peeling import render_layers
from rasterjit.pipeline import Pipeline
from rasterjit.pixel import explain_pixel
from rasterjit.plan import RenderPlan
from rasterjit.rasterize import Visibility, rasterize
from rasterjit.render import Renderer, explain, render
from rasterjit.scene.ambient_occlusion import AmbientOcclusion
from rasterjit.scene.camera import (
    MatrixCamera,
    OrthographicCamera,
    PerspectiveCamera,
    fit_camera,
    orbit_direction,
)
from rasterjit.scene.environment import Environment
from rasterjit.scene.fog import Fog
from rasterjit.scene.light import (
    AmbientLight,
    DirectionalLight,
    PointLight,
    Shadow,
    SpotLight,
)
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.outline import Outline
from rasterjit.scene.preview import set_painter
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Node, Scene, Wireframe
from rasterjit.scene.texture import Texture
from rasterjit.scene.tone_map import ToneMap
from rasterjit.scene.view import View

set_painter(preview)
del preview, set_painter

__version__ = "0.1.0"

__all__ = [
    "AmbientLight",
    "AmbientOcclusion",
    "CalibrationWarning",
    "Choice",
    "Diagnostics",
    "DirectionalLight",
    "Environment",
    "Fog",
    "Frame",
    "Framebuffer",
    "LayeredFrame",
    "Material",
    "MatrixCamera",
    "Measurement",
    "Mesh",
    "Node",
    "OrthographicCamera",
    "Outline",
    "OutputNotRequestedError",
    "PerspectiveCamera",
    "Pipeline",
    "PixelExplanation",
    "PointLight",
    "Quality",
    "RenderPlan",
    "Renderer",
    "Scene",
    "Shadow",
    "SpotLight",
    "Stats",
    "Texture",
    "ToneMap",
    "View",
    "Visibility",
    "Wireframe",
    "accuracy",
    "animation",
    "cameras",
    "dataset",
    "distributed",
    "explain",
    "explain_pixel",
    "fit_camera",
    "load",
    "masks",
    "measure",
    "mpl",
    "oracle",
    "orbit_direction",
    "rasterize",
    "render",
    "render_layers",
    "render_many",
    "show",
    "transforms",
]

_MODULES = ("accuracy", "animation", "cameras", "dataset", "distributed", "masks", "mpl", "oracle")
"""Those that are loaded when they are first named."""


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    """Load what rendering needs nothing of when it is first named."""
    if name == "show":
        return import_module("rasterjit.viewer_show").show
    if name in _MODULES:
        return import_module(f"rasterjit.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
