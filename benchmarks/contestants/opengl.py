"""
OpenGL on a CPU: Mesa's llvmpipe through EGL and moderngl.

Needs ``apt-get install libegl1 libgl1-mesa-dri libgl1``.

``LP_NUM_THREADS=0`` makes llvmpipe rasterize in the calling thread; with 1 it starts a second
thread and its CPU time is spread over two, so 0 is what counts as one thread here. Colours are
written to a linear RGBA8 target, which asks for no sRGB encoding; a scene without colours writes
the number of the face to a 32-bit integer. Lines and edges have no depth buffer to clear.

The vertex shader negates y, which is exact, so OpenGL's bottom row is the picture's top row; faces
turn over with it, which ``front_face`` makes up for.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import EDGE_COLOR, needs
from benchmarks.contestants.screen import eye_of, find_unique_edges, matrices
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "Mesa llvmpipe"

DRIVER = "llvmpipe"

VERTEX_SHADER = """
uniform mat4 clip_from_world;
in vec3 position;
#ifdef INSTANCES
in mat4 world_from_model;
#endif
#ifdef COLORS
in vec4 color;
out vec4 mixed;
#endif
#ifdef LIGHTING
in vec3 normal;
out vec3 mixed_normal;
out vec3 world;
#endif
#ifdef TEXTURE
in vec2 uv;
out vec2 place;
#endif
void main() {
    vec4 placed = vec4(position, 1.0);
#ifdef INSTANCES
    placed = world_from_model * placed;
#endif
    vec4 clip = clip_from_world * placed;
    gl_Position = vec4(clip.x, -clip.y, clip.zw);
#ifdef COLORS
    mixed = color;
#endif
#ifdef LIGHTING
    mixed_normal = normal;
    world = placed.xyz;
#endif
#ifdef TEXTURE
    place = uv;
#endif
}
"""

FACE_SHADER = """
out int face;
void main() { face = gl_PrimitiveID + 1; }
"""

ONE_COLOR_SHADER = """
uniform vec4 one_color;
out vec4 seen;
void main() { seen = one_color; }
"""

SMOOTH_SHADER = """
in vec4 mixed;
out vec4 seen;
void main() { seen = mixed; }
"""

TEXTURE_SHADER = """
uniform sampler2D picture;
in vec2 place;
out vec4 seen;
void main() { seen = vec4(texture(picture, place).rgb, 1.0); }
"""

SRGB = 0x8C41
"""OpenGL's name of a texture format whose bytes are decoded from sRGB, ``GL_SRGB8``."""

LIT_SHADER = """
uniform vec3 to_light;
uniform vec3 eye;
uniform float ambient;
uniform float specular;
uniform float shininess;
in vec3 mixed_normal;
in vec3 world;
#ifdef COLORS
in vec4 mixed;
#else
const vec4 mixed = vec4(1.0);
#endif
out vec4 seen;
void main() {
    vec3 normal = normalize(gl_FrontFacing ? mixed_normal : -mixed_normal);
    float facing = max(dot(normal, to_light), 0.0);
    vec3 middle = normalize(to_light + normalize(eye - world));
    float shine = facing > 0.0 ? specular * pow(max(dot(normal, middle), 0.0), shininess) : 0.0;
    seen = vec4(mixed.rgb * (ambient + facing) + shine, 1.0);
}
"""

LINE_VERTEX_SHADER = """
uniform vec2 size;
in vec2 pixel;
in vec4 color;
out vec4 mixed;
void main() {
    gl_Position = vec4(2.0 * (pixel + 0.5) / size - 1.0, 0.0, 1.0);
    mixed = color;
}
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


def draws(scene: Scene) -> str | None:
    """Return ``None``: it draws every scene."""
    return None


def alike(scene: Scene) -> tuple[float, float]:
    """
    Return the shares of pixels alike in coverage and in colour that its rules allow for.

    A line's last pixel is left out, by the diamond-exit rule; and edges run between points that
    were not rounded to pixels, so that many a pixel of theirs is another. Of a face smaller than a
    pixel, what float32 leaves of a place in its texture may be some texels beside.
    """
    if isinstance(scene, LineScene):
        return 0.995, 0.9
    if scene.mode == "edges":
        return 0.9, 0.0
    return (0.999, 0.95) if scene.texture is not None else (0.999, 0.99)


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        return Lines(scene)
    if scene.mode == "edges":
        return Triangles(scene, ONE_COLOR_SHADER)
    if scene.normals is not None:
        return Triangles(scene, LIT_SHADER)
    if scene.texture is not None:
        return Triangles(scene, TEXTURE_SHADER)
    return Triangles(scene, FACE_SHADER if scene.colors is None else SMOOTH_SHADER)


def places_of(scene: TriangleScene) -> NDArray[np.float32]:
    """Return where in its texture each vertex lies, (V, 2); a value lies along the row."""
    if scene.values is None:
        return scene.uv
    return np.stack([scene.values, np.full_like(scene.values, 0.5)], axis=1)


def open_context() -> Any:
    """Return an off-screen context; without a software driver its creation raises."""
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


def with_defines(shader: str, defines: list[str]) -> str:
    """Return a shader's text with its version and what is defined in it."""
    return "\n".join(["#version 330", *(f"#define {name.upper()}" for name in defines), shader])


class Target:
    """A picture off screen, of colours or of face numbers, with a depth buffer if asked for."""

    def __init__(self, size: tuple[int, int], holds: str, tests_depth: bool) -> None:
        self.context = open_context()
        shape = (size[1], size[0])
        if holds == "face_id":
            self._texture = self.context.texture(size, 1, dtype="i4")
            self._pixels: NDArray[Any] = np.empty(shape, np.int32)
        else:
            self._texture = self.context.texture(size, 4, dtype="f1")
            self._pixels = np.empty((*shape, 4), np.uint8)
        depth = self.context.depth_renderbuffer(size) if tests_depth else None
        self._framebuffer = self.context.framebuffer([self._texture], depth)
        self._framebuffer.use()
        self.context.viewport = (0, 0, *size)
        self.context.enable_only(self.context.DEPTH_TEST if tests_depth else self.context.NOTHING)
        self.context.depth_func = "<"

    def clear(self) -> None:
        """Set the picture to zeros and the depth, if any, to the far plane."""
        self._framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture, top row first, in the same array every time."""
        self._texture.read_into(self._pixels)
        return {"face_id" if self._pixels.ndim == 2 else "color": self._pixels}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared; face numbers count from 1 in the target."""
        self.read()
        if self._pixels.ndim == 2:
            return {"covered": self._pixels > 0, "face_id": self._pixels - 1}
        return {
            "covered": self._pixels[:, :, 3] > 0,
            "color_linear": self._pixels[:, :, :3].copy(),
        }


class Triangles:
    """Indexed triangles, or their edges, uploaded."""

    def __init__(self, scene: TriangleScene, fragment_shader: str) -> None:
        self._is_edges = scene.mode == "edges"
        holds = "face_id" if fragment_shader == FACE_SHADER else "color"
        self._target = Target(scene.size, holds, tests_depth=not self._is_edges)
        context = self._target.context
        defines = [need for need in needs(scene) if need in ("lighting", "instances")]
        if fragment_shader in (SMOOTH_SHADER, LIT_SHADER) and scene.colors is not None:
            defines.append("colors")
        if scene.texture is not None and fragment_shader == TEXTURE_SHADER:
            defines.append("texture")
            self._texture = self._upload_texture(scene.texture, scene.values is not None)
        self._program = context.program(
            with_defines(VERTEX_SHADER, defines), with_defines(fragment_shader, defines)
        )
        self._set_uniforms(scene)
        self._array = context.vertex_array(
            self._program,
            self._attributes(scene, defines),
            index_buffer=context.buffer(
                find_unique_edges(scene.faces) if self._is_edges else scene.faces
            ),
        )
        self._instances = 1 if scene.instances is None else len(scene.instances)
        if scene.cull == "back":
            context.enable(context.CULL_FACE)
        context.cull_face, context.front_face = "back", "cw"
        self._matrices = [np.array(matrix.T, np.float32).tobytes() for matrix in matrices(scene)]
        self._eyes = [np.float32(eye_of(matrix)).tobytes() for matrix in matrices(scene)]

    def _set_uniforms(self, scene: TriangleScene) -> None:
        """Set what stays the same, where the shader has it."""
        values = {
            "to_light": scene.to_light,
            "ambient": scene.ambient,
            "specular": scene.specular,
            "shininess": scene.shininess,
            "one_color": np.array(EDGE_COLOR) / 255,
        }
        for name, value in values.items():
            if name in self._program:
                self._program[name].write(np.array(value, np.float32).tobytes())

    def _upload_texture(self, image: NDArray[np.uint8], is_map: bool) -> Any:
        """Return the texture, 8-bit sRGB as the driver keeps it: bilinear, repeated; or a map."""
        context = self._target.context
        height, width = image.shape[:2]
        rows = np.ascontiguousarray(image[::-1])
        texture = context.texture((width, height), 3, rows.tobytes(), internal_format=SRGB)
        texture.filter = (context.LINEAR, context.LINEAR)
        if is_map:
            texture.filter, texture.repeat_x = (context.NEAREST, context.NEAREST), False
        texture.use(0)
        return texture

    def _attributes(self, scene: TriangleScene, defines: list[str]) -> list[tuple[Any, str, str]]:
        """Return the vertex buffers, uploaded, as moderngl takes them."""
        buffer = self._target.context.buffer
        found = [(buffer(scene.positions), "3f", "position")]
        if "colors" in defines:
            found.append((buffer(scene.colors), "4f1", "color"))
        if "lighting" in defines:
            found.append((buffer(scene.normals), "3f", "normal"))
        if "texture" in defines:
            found.append((buffer(places_of(scene)), "2f", "uv"))
        if scene.instances is not None:
            columns = np.ascontiguousarray(scene.instances.transpose(0, 2, 1), np.float32)
            found.append((buffer(columns), "16f/i", "world_from_model"))
        return found

    def draw(self) -> None:
        """Clear, draw, and wait until llvmpipe has finished; all views, each read back."""
        for number in range(len(self._matrices)):
            self.draw_view(number)
            if len(self._matrices) > 1:
                self._target.read()

    def draw_view(self, number: int) -> None:
        """Clear, draw one view, and wait until llvmpipe has finished."""
        context = self._target.context
        self._program["clip_from_world"].write(self._matrices[number])
        if "eye" in self._program:
            self._program["eye"].write(self._eyes[number])
        self._target.clear()
        mode = context.LINES if self._is_edges else context.TRIANGLES
        self._array.render(mode, instances=self._instances)
        context.finish()

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the last picture."""
        return self._target.read()

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return self._target.picture()

    def close(self) -> None:
        """Let everything uploaded go."""
        self._target.context.release()


class Lines:
    """``GL_LINES`` with smooth colours, uploaded; a line's last pixel is not drawn by OpenGL."""

    def __init__(self, scene: LineScene) -> None:
        self._target = Target(scene.size, "color", tests_depth=False)
        context = self._target.context
        program = context.program(
            with_defines(LINE_VERTEX_SHADER, []), with_defines(SMOOTH_SHADER, [])
        )
        program["size"].value = scene.size
        pixels = scene.ends.reshape(-1, 2).astype(np.float32)
        self._array = context.vertex_array(
            program,
            [
                (context.buffer(pixels), "2f", "pixel"),
                (context.buffer(scene.colors), "4f1", "color"),
            ],
        )

    def draw(self) -> None:
        """Clear, draw, and wait until llvmpipe has finished."""
        self._target.clear()
        self._array.render(self._target.context.LINES)
        self._target.context.finish()

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture."""
        return self._target.read()

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return self._target.picture()
