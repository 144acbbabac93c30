"""
Run scripts that were written for pyrender: the same classes and arguments, drawn by RasterJIT.

>>> import rasterjit.compat.pyrender as pyrender

`install` makes ``import pyrender`` mean this package, and ``python -m rasterjit.compat.pyrender
SCRIPT ARGS...`` runs a program so, unedited, with the processes that it starts. Pictures come from
a CPU, without OpenGL, EGL, OSMesa or a display; the environment variable ``PYOPENGL_PLATFORM`` is
without effect. Vectors, matrices, colours and angles (radians) are as there, and so are pictures:
light falls on materials as the original's shader has it, of at most four lights of a kind, the
nearest; codes are those of its gamma of 2.2; faces are drawn in its order, and mixed as OpenGL
mixes them. `RenderFlags.FLAT` shows colours as they are. Colours are means of four samples a
pixel, depth is that of the first; without several samples, where `RenderFlags.SEG` asks for none,
lines are a pixel wide across them. Depth of cameras that are no pinholes, as parallel ones, is what
pyrender makes of it.

What differs: point lights cast shadows, which they cannot do there. Attributes take what they take
there; an error names the attribute, the value and what was expected.

What is missing on purpose is what OpenGL does: shaders (``shader_program``), text (``font`` and
`Renderer.render_text`) and the inner parts of `Renderer` can be named, and raise a `NoOpenGLError`
when they are used; it says what to use instead. `OffscreenRenderer.render` returns normals and
positions if its ``outputs`` ask for them.

References
----------
pyrender 0.1.45, https://pyrender.readthedocs.io.
"""

from rasterjit.compat.pyrender import font as font
from rasterjit.compat.pyrender import shader_program as shader_program
from rasterjit.compat.pyrender import trackball as trackball
from rasterjit.compat.pyrender.camera import (
    Camera,
    IntrinsicsCamera,
    OrthographicCamera,
    PerspectiveCamera,
)
from rasterjit.compat.pyrender.constants import GLTF, RenderFlags, TextAlign
from rasterjit.compat.pyrender.fields import NoOpenGLError as NoOpenGLError
from rasterjit.compat.pyrender.installation import install as install
from rasterjit.compat.pyrender.installation import share_names as _share
from rasterjit.compat.pyrender.light import DirectionalLight, Light, PointLight, SpotLight
from rasterjit.compat.pyrender.material import Material, MetallicRoughnessMaterial
from rasterjit.compat.pyrender.mesh import Mesh
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.offscreen import OffscreenRenderer
from rasterjit.compat.pyrender.primitive import Primitive
from rasterjit.compat.pyrender.renderer import Renderer
from rasterjit.compat.pyrender.sampler import Sampler
from rasterjit.compat.pyrender.scene import Scene
from rasterjit.compat.pyrender.texture import Texture
from rasterjit.compat.pyrender.version import __version__
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
    "Renderer",
    "Sampler",
    "Scene",
    "SpotLight",
    "TextAlign",
    "Texture",
    "Viewer",
    "__version__",
]

_share()
