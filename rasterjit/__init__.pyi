from rasterjit import accuracy, animation, cameras, dataset, distributed, masks, oracle, styles
from rasterjit import mpl as mpl
from rasterjit import transforms as transforms
from rasterjit import types as types
from rasterjit.classics.framebuffer import Framebuffer
from rasterjit.classics.pipeline import ClassicPipeline
from rasterjit.distributed.frames import render_many
from rasterjit.hidden_lines.drawing import LineDrawing, line_drawing
from rasterjit.inspect.cross_section import CrossSection, cross_section
from rasterjit.inspect.exploded_view import explode
from rasterjit.inspect.pixel import explain_pixel
from rasterjit.inspect.pixel_report import PixelExplanation
from rasterjit.inspect.profile import FrameProfile, profile
from rasterjit.io.camera_files import load_cameras, save_cameras
from rasterjit.io.camera_files.calibration import CalibratedCamera
from rasterjit.io.load_warnings import SaveWarning
from rasterjit.io.meshes import LoadWarning, MeshFileError, load
from rasterjit.outputs.batch import Batch
from rasterjit.outputs.contact_sheet import grid
from rasterjit.outputs.diagnostics import Diagnostics
from rasterjit.outputs.frame import (
    Frame,
    FrameStats,
    LayeredFrame,
    OutputNotRequestedError,
    PickedPixel,
    QualityChoice,
)
from rasterjit.outputs.learning_tuples import PyTorch3DFragments
from rasterjit.rendering.batch import render_batch
from rasterjit.rendering.depth_peeling import render_layers
from rasterjit.rendering.planning import RenderPlan
from rasterjit.rendering.quality_selection import CalibrationWarning
from rasterjit.rendering.rasterize import RasterizedFaces, rasterize
from rasterjit.rendering.renderer import Renderer, explain, render
from rasterjit.rendering.view_warnings import ViewWarning
from rasterjit.scene.ambient_occlusion import AmbientOcclusion
from rasterjit.scene.arrows import Arrow, Arrows
from rasterjit.scene.camera import MatrixCamera, OrthographicCamera, PerspectiveCamera
from rasterjit.scene.camera_fitting import fit_camera, orbit_direction
from rasterjit.scene.colormap import Colormap
from rasterjit.scene.contours import Contours
from rasterjit.scene.dimensions import angle_dimension, length_dimension, radius_dimension
from rasterjit.scene.environment import Environment
from rasterjit.scene.eye_dome import EyeDome
from rasterjit.scene.fog import Fog
from rasterjit.scene.guides import Axes, BoundingBox, Frustum, Grid
from rasterjit.scene.joints import Joint, Joints
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
from rasterjit.scene.previous_view import PreviousView
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.section import SectionPlane
from rasterjit.scene.skin import MorphTargets, Skin
from rasterjit.scene.texture import Texture
from rasterjit.scene.tone_map import ToneMap
from rasterjit.scene.vignette import Vignette
from rasterjit.scene.wireframe import Wireframe
from rasterjit.viewer.show import show

__version__: str
__all__ = [
    "AmbientLight",
    "AmbientOcclusion",
    "Animation",
    "Arrow",
    "Arrows",
    "Axes",
    "Batch",
    "BoundingBox",
    "CalibratedCamera",
    "CalibrationWarning",
    "Channel",
    "ClassicPipeline",
    "Colormap",
    "Contours",
    "CrossSection",
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
    "Joint",
    "Joints",
    "Label",
    "LayeredFrame",
    "LineDrawing",
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
    "PyTorch3DFragments",
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
    "angle_dimension",
    "animation",
    "cameras",
    "cross_section",
    "dataset",
    "distributed",
    "explain",
    "explain_pixel",
    "explode",
    "fit_camera",
    "grid",
    "length_dimension",
    "line_drawing",
    "load",
    "load_cameras",
    "masks",
    "oracle",
    "orbit_direction",
    "profile",
    "radius_dimension",
    "rasterize",
    "render",
    "render_batch",
    "render_layers",
    "render_many",
    "save_cameras",
    "show",
    "styles",
    "transforms",
]
