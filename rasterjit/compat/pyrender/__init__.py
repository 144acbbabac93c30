"""
Run scripts that were written for pyrender: the same classes and arguments, drawn by RasterJIT.

>>> import rasterjit.compat.pyrender as pyrender

Pictures come from a CPU, without OpenGL, EGL, OSMesa or a display. Light falls on materials as it
does there: intensities are divided by pi, which glTF's materials do and RasterJIT's lights do not.
Vectors, matrices, colours and angles (radians) are as there.

What differs: any number of lights counts, not the nearest four of a kind; point lights cast
shadows, and so do points, which are squares that face the camera; transparent surfaces are sorted
pixel by pixel. What cannot be drawn is refused with a ``ValueError``.

References
----------
pyrender 0.1.45, https://pyrender.readthedocs.io.
"""

from rasterjit.compat.pyrender.camera import (
    Camera,
    IntrinsicsCamera,
    OrthographicCamera,
    PerspectiveCamera,
)
from rasterjit.compat.pyrender.constants import GLTF, RenderFlags
from rasterjit.compat.pyrender.light import DirectionalLight, Light, PointLight, SpotLight
from rasterjit.compat.pyrender.material import (
    Material,
    MetallicRoughnessMaterial,
    Sampler,
    Texture,
)
from rasterjit.compat.pyrender.mesh import Mesh, Primitive
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.offscreen import OffscreenRenderer
from rasterjit.compat.pyrender.scene import Scene
from rasterjit.compat.pyrender.viewer import Viewer

__all__ = [
    "GLTF",
    "Camera",
    "DirectionalLight",
    "IntrinsicsCamera",
    "Light",
    "Material",
    "Mesh",
    "MetallicRoughnessMaterial",
    "Node",
    "OffscreenRenderer",
    "OrthographicCamera",
    "PerspectiveCamera",
    "PointLight",
    "Primitive",
    "RenderFlags",
    "Sampler",
    "Scene",
    "SpotLight",
    "Texture",
    "Viewer",
]
