"""What is said of the parts of pyrender that RasterJIT has not: those of OpenGL."""

from __future__ import annotations

_INSTEAD = (
    "is a part of OpenGL, and RasterJIT draws without. In place of own shaders, "
    "OffscreenRenderer.render(scene, outputs=...) returns normals and positions "
    '("normal_camera", "position" ...), RenderFlags.SEG colours nodes and RenderFlags.FLAT leaves '
    "light out"
)


class NoOpenGLError(AttributeError):
    """A part of pyrender was asked for that belongs to OpenGL; ``hasattr`` says that it is not."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what} {_INSTEAD}")
