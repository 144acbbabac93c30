"""
OpenGL on a CPU: Mesa's llvmpipe through EGL and moderngl, writing the face at every pixel.

``LP_NUM_THREADS=0`` makes llvmpipe rasterize in the calling thread; with 1 it starts a second
thread and its CPU time is spread over two, so 0 is what counts as one thread here.

The shader negates y, which is exact, so OpenGL's bottom row is the picture's top row.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "Mesa llvmpipe"

DRIVER = "llvmpipe"

VERTEX_SHADER = """
#version 330
uniform mat4 clip_from_model;
in vec3 position;
void main() {
    vec4 clip = clip_from_model * vec4(position, 1.0);
    gl_Position = vec4(clip.x, -clip.y, clip.zw);
}
"""

FACE_SHADER = """
#version 330
out int face;
void main() { face = gl_PrimitiveID + 1; }
"""

LINE_VERTEX_SHADER = """
#version 330
uniform vec2 size;
in vec2 pixel;
in vec4 color;
out vec4 mixed;
void main() {
    gl_Position = vec4(2.0 * (pixel + 0.5) / size - 1.0, 0.0, 1.0);
    mixed = color;
}
"""

LINE_SHADER = """
#version 330
in vec4 mixed;
out vec4 color;
void main() { color = mixed; }
"""


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    if find_spec("moderngl") is None:
        return 'the package moderngl is not installed (pip install ".[bench]")'
    try:
        context = open_context()
    except Exception as error:  # what is missing (libEGL, driver) decides its type
        return f"no OpenGL through EGL: {error}"
    renderer = context.info["GL_RENDERER"]
    context.release()
    return None if DRIVER in renderer else f"OpenGL is {renderer}, not Mesa's {DRIVER}"


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {
        "LP_NUM_THREADS": "0" if threads == 1 else str(threads),
        "LIBGL_ALWAYS_SOFTWARE": "true",
    }


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        return Lines(scene)
    return Triangles(scene, FACE_SHADER, 1, "i4")


def open_context() -> Any:
    """Return an off-screen context."""
    os.environ.setdefault("LIBGL_ALWAYS_SOFTWARE", "true")
    import moderngl

    return moderngl.create_standalone_context(backend="egl", require=330)


def version() -> str | None:
    """Return what the driver calls itself, or ``None`` if there is none."""
    if available() is not None:
        return None
    context = open_context()
    text = f"{context.info['GL_RENDERER']}, {context.info['GL_VERSION']}"
    context.release()
    return text


class Target:
    """A picture and its depth buffer, both off screen."""

    def __init__(self, size: tuple[int, int], components: int, dtype: str) -> None:
        self.context = open_context()
        self._texture = self.context.texture(size, components, dtype=dtype)
        depth = self.context.depth_renderbuffer(size)
        self._framebuffer = self.context.framebuffer([self._texture], depth)
        self._framebuffer.use()
        self.context.viewport = (0, 0, *size)
        shape = (size[1], size[0])
        kind = np.int32 if dtype == "i4" else np.uint8
        self._pixels = np.empty(shape if components == 1 else (*shape, components), kind)

    def clear(self) -> None:
        """Set the picture to zeros and the depth to the far plane."""
        self._framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)

    def read(self) -> NDArray[Any]:
        """Return the picture, top row first."""
        self._texture.read_into(self._pixels)
        return self._pixels


class Triangles:
    """Indexed triangles, uploaded, with the depth test on."""

    def __init__(
        self, scene: TriangleScene, fragment_shader: str, components: int, dtype: str
    ) -> None:
        self._target = Target(scene.size, components, dtype)
        context = self._target.context
        self._program = context.program(VERTEX_SHADER, fragment_shader)
        matrix = np.ascontiguousarray(scene.clip_from_model.T, np.float32)
        self._program["clip_from_model"].write(matrix)
        self._array = context.vertex_array(
            self._program,
            [(context.buffer(scene.positions), "3f", "position")],
            index_buffer=context.buffer(scene.faces),
        )
        context.enable_only(context.DEPTH_TEST)
        context.depth_func = "<"

    def draw(self) -> None:
        """Clear, draw, and wait until llvmpipe has finished."""
        self._target.clear()
        self._array.render(self._target.context.TRIANGLES)
        self._target.context.finish()

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture; face numbers count from 1."""
        pixels = self._target.read()
        return {"face_id" if pixels.ndim == 2 else "color": pixels}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        pixels = self._target.read()
        if pixels.ndim == 3:
            return {"covered": pixels[:, :, 3] > 0}
        return {"covered": pixels > 0, "face_id": pixels - 1}


class Lines:
    """``GL_LINES`` with smooth colours, uploaded; a line's last pixel is not drawn by OpenGL."""

    def __init__(self, scene: LineScene) -> None:
        self._target = Target(scene.size, 4, "f1")
        context = self._target.context
        self._program = context.program(LINE_VERTEX_SHADER, LINE_SHADER)
        self._program["size"].value = scene.size
        pixels = scene.ends.reshape(-1, 2).astype(np.float32)
        self._array = context.vertex_array(
            self._program,
            [
                (context.buffer(pixels), "2f", "pixel"),
                (context.buffer(scene.colors), "4f1", "color"),
            ],
        )
        context.enable_only(context.NOTHING)

    def draw(self) -> None:
        """Clear, draw, and wait until llvmpipe has finished."""
        self._target.clear()
        self._array.render(self._target.context.LINES)
        self._target.context.finish()

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture."""
        return {"color": self._target.read()}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        color = self._target.read()
        return {"covered": color[:, :, 3] > 0, "color": color}
