"""moderngl with EGL: OpenGL itself, and a shader of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapes
from numpy.typing import NDArray

DISTRIBUTIONS = ("moderngl", "numpy")

VERTEX = """#version 330
uniform mat4 clip_from_world; in vec3 place; in vec3 up; out vec3 normal;
void main() { gl_Position = clip_from_world * vec4(place, 1); normal = up; }"""
COLOR = """#version 330
in vec3 normal; out vec4 color;
void main() { color = vec4(vec3(0.2 + 0.8 * abs(normalize(normal).z)), 1); }"""
NUMBERS = """#version 330
in vec3 normal; out vec4 color; uniform float object;
void main() { color = vec4(float(gl_PrimitiveID), object, normal.xy); }"""


def perspective(near: float = shapes.NEAR, far: float = shapes.FAR) -> NDArray[np.float64]:
    """Return the projection of the camera at the origin."""
    f = 1 / np.tan(np.radians(shapes.FOV_Y / 2))
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = f * shapes.SIZE[1] / shapes.SIZE[0], f
    matrix[2, 2:], matrix[3, 2] = ((far + near) / (near - far), 2 * far * near / (near - far)), -1
    return matrix


def look(eye: Any, target: Any) -> NDArray[np.float64]:
    """Return the matrix from the world to a camera's space."""
    back = np.subtract(eye, target) / np.linalg.norm(np.subtract(eye, target))
    right = np.cross((0, 1, 0), back)
    right /= np.linalg.norm(right)
    turn = np.array([right, np.cross(back, right), back])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, -turn @ np.asarray(eye)
    return matrix


def draw(
    shader: str, parts: list[Any], view: Any = None, dtype: str = "f1", samples: int = 0,
    are_points: bool = False,
) -> tuple[NDArray[Any], NDArray[Any]]:  # fmt: skip
    """Draw vertices, normals and faces; return the colour and, without samples, the depth."""
    import moderngl

    context = moderngl.create_standalone_context(backend="egl")
    size = shapes.SIZE
    depth = context.depth_texture(size, samples=samples)
    target = context.framebuffer([context.texture(size, 4, dtype=dtype, samples=samples)], depth)
    target.use()
    context.enable(moderngl.DEPTH_TEST)
    target.clear(0, 0, 0, 0)
    program = context.program(VERTEX, shader)
    matrix = perspective() @ (np.eye(4) if view is None else view)
    program["clip_from_world"].write(np.array(matrix.T, np.float32).tobytes())
    for number, (vertices, normals, faces) in enumerate(parts):
        if "object" in program:
            program["object"].value = float(number)
        rows = np.hstack([vertices, normals]).astype(np.float32)
        inputs = [(context.buffer(rows.tobytes()), "3f 3f", "place", "up")]
        if "up" not in program:
            inputs = [(context.buffer(rows.tobytes()), "3f 12x", "place")]
        indices = context.buffer(np.asarray(faces, np.int32).tobytes())
        context.vertex_array(program, inputs, index_buffer=indices).render(
            moderngl.POINTS if are_points else moderngl.TRIANGLES
        )
    if samples:
        plain = context.framebuffer([context.texture(size, 4, dtype=dtype)])
        context.copy_framebuffer(plain, target)
        target = plain
    kind = {"f1": np.uint8, "f4": np.float32}[dtype]
    pixels = np.frombuffer(target.read(components=4, dtype=dtype), kind)
    depths = np.frombuffer(depth.read(), np.float32) if not samples else np.zeros(size)
    return pixels.reshape(size[1], size[0], 4)[::-1], depths.reshape(size[1], size[0])[::-1]


def facing(vertices: Any) -> tuple[Any, Any, Any]:
    """Return a rectangle with the normals of one that faces the eye."""
    return vertices, np.tile([0.0, 0, 1], (4, 1)), shapes.QUAD


def picture(folder: Path) -> Any:
    """Draw the teapot."""
    with np.load(folder / "teapot.npz") as mesh:
        parts = [(mesh["vertices"], mesh["normals"], mesh["faces"])]
    return draw(COLOR, parts, look(shapes.EYE, shapes.TARGET))[0]


def depth(folder: Path) -> float:
    """Return the error of depth."""
    stored = draw(COLOR, [facing(shapes.WALL)])[1].astype(float)
    n, f = shapes.NEAR, shapes.FAR
    return shapes.depth_error(2 * n * f / (f + n - (2 * stored - 1) * (f - n)))


def numbers(folder: Path) -> NDArray[Any]:
    """Return what the shader writes of two rectangles."""
    parts = [facing(shapes.UPRIGHT), facing(shapes.UPRIGHT * (1, 1, 2) + (0, 1, 0))]
    return draw(NUMBERS, parts, dtype="f4")[0]


def face_id(folder: Path) -> str:
    """Write face numbers by a shader."""
    assert set(np.unique(numbers(folder)[..., 0])) == {0, 1}
    return "shader"


def masks(folder: Path) -> str:
    """Write object numbers by a shader."""
    assert set(np.unique(numbers(folder)[..., 1])) == {0, 1}
    return "shader"


def normals(folder: Path) -> str:
    """Write normals by a shader."""
    vertices, _, faces = facing(shapes.UPRIGHT)
    found = draw(NUMBERS, [(vertices, np.tile([0.6, 0.0, 0.8], (4, 1)), faces)], dtype="f4")[0]
    assert found.dtype == np.float32
    assert {0.0, 0.6} == set(np.unique(found[..., 2].round(6).astype(float)).round(6))
    return "shader"


def antialiasing(folder: Path) -> bool:
    """Draw with four samples."""
    return shapes.is_smooth(draw(COLOR, [facing(shapes.UPRIGHT)], samples=4)[0])


def points(folder: Path) -> bool:
    """Draw points."""
    places = np.load(folder / "points.npy")
    parts = [(places, np.tile([0.0, 0, 1], (len(places), 1)), np.arange(len(places)))]
    return bool((draw(COLOR, parts, are_points=True)[0][..., :3].max(axis=2) > 60).sum() > 500)


def motion(folder: Path) -> bool:
    """Find no motion vectors."""
    return shapes.absent("moderngl", "motion|velocity|flow")


def lens(folder: Path) -> bool:
    """Find no lens."""
    return shapes.absent("moderngl", "distort|fisheye|lens")


def shadows(folder: Path) -> bool:
    """Find no shadows."""
    return shapes.absent("moderngl", "shadow|light")


def transparency(folder: Path) -> bool:
    """Find nothing that sorts."""
    return shapes.absent("moderngl", "peel|translucen|order_independent")


def metallic(folder: Path) -> bool:
    """Find no files."""
    return shapes.absent("moderngl", "gltf|material")


def animation(folder: Path) -> bool:
    """Find no characters."""
    return shapes.absent("moderngl", "gltf|skin|animat")


def rays(folder: Path) -> bool:
    """Find no rays."""
    return shapes.absent("moderngl", "ray_?cast|cast_ray|intersect|ray_?trac")


def window(folder: Path) -> bool:
    """Find no window of its own."""
    return shapes.absent("moderngl", "window|viewer")
