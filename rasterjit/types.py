"""
Names of the types that arguments have, for annotations.

What is chosen from a list is a ``Literal`` of its names, so that a type checker finds a misspelt
one. Written where it is used a choice needs no more; one that comes by a variable needs its type:

>>> from rasterjit.types import OutputName, Shading
>>> outputs: list[OutputName] = ["color", "depth"]
>>> shading: Shading = "flat"

Names that are not known beforehand are marked: ``AttributeName("attribute:heat")``.
"""

from rasterjit.animation.tracks import Interpolation as KeyInterpolation
from rasterjit.classics.framebuffer import EdgeRule, FillMethod
from rasterjit.dataset.recipe import Layout, RecipeOutput
from rasterjit.hidden_lines.edges import LineKind
from rasterjit.io.camera_files import CameraFormat
from rasterjit.io.cameras import BlenderType, ScreenSpace, SensorFit
from rasterjit.io.meshes import OnDamage
from rasterjit.outputs.output_table import AttributeName, IdOutput, OutputName, Outputs
from rasterjit.rendering.batch import Progress
from rasterjit.rendering.rasterize import DepthMode
from rasterjit.scene.arrows import ArrowUnit
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera
from rasterjit.scene.camera_fitting import Projection
from rasterjit.scene.color import ColorLike
from rasterjit.scene.colormap import ColormapLike
from rasterjit.scene.contours import ContoursLike
from rasterjit.scene.fog import FogMode
from rasterjit.scene.joints import JointKind
from rasterjit.scene.keyframes import ChannelInterpolation, ChannelPath
from rasterjit.scene.label import Anchor
from rasterjit.scene.light import Light, ShadowFilter
from rasterjit.scene.material import AlphaMode, Shading
from rasterjit.scene.mesh import OnInvalid
from rasterjit.scene.norm import NormLike, RangeLike
from rasterjit.scene.outline import EdgeKind, HiddenLines
from rasterjit.scene.quality import (
    Blending,
    DepthFormat,
    FinestShading,
    Interpolation,
    InterpolationPrecision,
    Lines,
    Precision,
    Samples,
    ShadowTaps,
    SubpixelBits,
    TextureFilter,
    TransparencyLayers,
)
from rasterjit.scene.section import CapColoring
from rasterjit.scene.texture import Anisotropy, ColorSpace, Filter, UVSet, Wrap
from rasterjit.scene.tone_map import Curve
from rasterjit.scene.transforms import ViewportConvention
from rasterjit.scene.validation import VectorLike
from rasterjit.scene.wireframe import WireframeMode
from rasterjit.survey.plan import Cull
from rasterjit.viewer.show import Backend

__all__ = [
    "AlphaMode",
    "Anchor",
    "Anisotropy",
    "ArrowUnit",
    "AttributeName",
    "Backend",
    "Background",
    "BlenderType",
    "Blending",
    "Camera",
    "CameraFormat",
    "CapColoring",
    "ChannelInterpolation",
    "ChannelPath",
    "ColorLike",
    "ColorSpace",
    "ColormapLike",
    "ContoursLike",
    "Cull",
    "Curve",
    "DepthFormat",
    "DepthMode",
    "EdgeKind",
    "EdgeRule",
    "FillMethod",
    "Filter",
    "FinestShading",
    "FogMode",
    "HiddenLines",
    "IdOutput",
    "Interpolation",
    "InterpolationPrecision",
    "JointKind",
    "KeyInterpolation",
    "Layout",
    "Light",
    "LineKind",
    "Lines",
    "NormLike",
    "OnDamage",
    "OnInvalid",
    "OutputName",
    "Outputs",
    "Precision",
    "Progress",
    "Projection",
    "RangeLike",
    "RecipeOutput",
    "Samples",
    "ScreenSpace",
    "SensorFit",
    "Shading",
    "ShadowFilter",
    "ShadowTaps",
    "SubpixelBits",
    "TextureFilter",
    "TransparencyLayers",
    "UVSet",
    "VectorLike",
    "ViewportConvention",
    "WireframeMode",
    "Wrap",
]
