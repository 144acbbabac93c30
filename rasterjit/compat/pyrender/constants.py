"""Numbers with names: what to render, and glTF's codes."""

from __future__ import annotations

from enum import IntEnum, IntFlag


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


NORMALS = RenderFlags.VERTEX_NORMALS | RenderFlags.FACE_NORMALS
"""Flags that draw normals as lines."""
