"""
Numbers with names: defaults, what to render, and glTF's codes.

References
----------
pyrender 0.1.45, module ``constants``.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

DEFAULT_Z_NEAR, DEFAULT_Z_FAR = 0.05, 100.0
"""Distances of the near and far plane where none are given, scene units."""

DEFAULT_SCENE_SCALE = 2.0
"""Diagonal of a scene without meshes, scene units."""

MAX_N_LIGHTS = 4
"""Most lights of a kind that light a mesh."""

SHADOW_TEX_SZ = 2048
"""Side of a shadow map, texels."""

TEXT_PADDING = 20
"""Distance of captions from the window's edge, pixels."""

TARGET_OPEN_GL_MAJOR, TARGET_OPEN_GL_MINOR = 4, 1
MIN_OPEN_GL_MAJOR, MIN_OPEN_GL_MINOR = 3, 3
"""Versions of OpenGL that pyrender asks for; without effect here."""

FLOAT_SZ, UINT_SZ = 4, 4
"""Bytes of a number in OpenGL's buffers; without effect here."""


class RenderFlags(IntFlag):
    """What to render and how; combine with ``|``."""

    NONE = 0
    DEPTH_ONLY = 1
    """Return the depth alone."""
    OFFSCREEN = 2
    """Taken and without effect: everything is."""
    FLIP_WIREFRAME = 4
    ALL_WIREFRAME = 8
    ALL_SOLID = 16
    """Taken and without effect, as in pyrender's renderer."""
    SHADOWS_DIRECTIONAL = 32
    SHADOWS_POINT = 64
    SHADOWS_SPOT = 128
    SHADOWS_ALL = 32 | 64 | 128
    VERTEX_NORMALS = 256
    """Draw normals as lines, in a viewer: in arrays they are not, as in pyrender's."""
    FACE_NORMALS = 512
    SKIP_CULL_FACES = 1024
    """Draw back faces, too."""
    RGBA = 2048
    """Return four channels."""
    FLAT = 4096
    """Show colours without light."""
    SEG = 8192
    """Show each node of ``seg_node_map`` in its colour."""


class TextAlign(IntEnum):
    """Where a caption of the viewer stands."""

    CENTER = 0
    CENTER_LEFT = 1
    CENTER_RIGHT = 2
    BOTTOM_LEFT = 3
    BOTTOM_RIGHT = 4
    BOTTOM_CENTER = 5
    TOP_LEFT = 6
    TOP_RIGHT = 7
    TOP_CENTER = 8


class GLTF(IntEnum):
    """Codes of glTF 2.0 for sampling and primitives."""

    POINTS = 0
    LINES = 1
    LINE_LOOP = 2
    LINE_STRIP = 3
    TRIANGLES = 4
    TRIANGLE_STRIP = 5
    TRIANGLE_FAN = 6
    NEAREST = 9728
    LINEAR = 9729
    NEAREST_MIPMAP_NEAREST = 9984
    LINEAR_MIPMAP_NEAREST = 9985
    NEAREST_MIPMAP_LINEAR = 9986
    LINEAR_MIPMAP_LINEAR = 9987
    REPEAT = 10497
    CLAMP_TO_EDGE = 33071
    MIRRORED_REPEAT = 33648


class BufFlags(IntFlag):
    """Which arrays a primitive has."""

    POSITION = 0
    NORMAL = 1
    TANGENT = 2
    TEXCOORD_0 = 4
    TEXCOORD_1 = 8
    COLOR_0 = 16
    JOINTS_0 = 32
    WEIGHTS_0 = 64


class TexFlags(IntFlag):
    """Which textures a material has."""

    NONE = 0
    NORMAL = 1
    OCCLUSION = 2
    EMISSIVE = 4
    BASE_COLOR = 8
    METALLIC_ROUGHNESS = 16
    DIFFUSE = 32
    SPECULAR_GLOSSINESS = 64


class ProgramFlags(IntFlag):
    """What pyrender's shaders draw; without effect here."""

    NONE = 0
    USE_MATERIAL = 1
    VERTEX_NORMALS = 2
    FACE_NORMALS = 4


NORMALS = RenderFlags.VERTEX_NORMALS | RenderFlags.FACE_NORMALS
"""Flags that draw normals as lines."""
