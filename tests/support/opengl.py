"""
Draw with real OpenGL, off screen: Mesa's software rasterizer, through EGL and moderngl.

The vertex shader negates y, which is exact. So row 0 of what is read back, OpenGL's bottom row,
is the top row of a picture with y down, and Mesa sees the very geometry, in the very orientation,
that RasterJIT sees: same sub-pixel grid, same side of every tie.
"""

from __future__ import annotations

import functools
import importlib
import os
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

FACE_SHADERS = (
    """
    #version 330
    in vec4 clip_position;
    in vec4 vertex_color;
    out vec4 mixed_color;
    void main() {
        gl_Position = vec4(clip_position.x, -clip_position.y, clip_position.zw);
        mixed_color = vertex_color;
    }
    """,
    """
    #version 330
    in vec4 mixed_color;
    layout(location = 0) out int face_id;
    layout(location = 1) out float depth;
    layout(location = 2) out vec4 color;
    void main() {
        face_id = gl_PrimitiveID;
        depth = gl_FragCoord.z;
        color = mixed_color;
    }
    """,
)


class Drawn(NamedTuple):
    """What OpenGL left in its buffers, row 0 on top."""

    face_id: NDArray[np.int32]  # (H, W), -1 where nothing is
    depth: NDArray[np.float64]  # (H, W), window z in 0..1 as interpolated in float32
    stored_depth: NDArray[np.float64]  # (H, W), window z in 0..1 as kept with 24 bits; 1 is empty
    color: NDArray[np.float32]  # (H, W, 4), 0 where nothing is


def skip_or_fail(reason: str) -> None:
    """Skip a test that lacks a tool; on continuous integration, where it is installed, fail."""
    if os.environ.get("CI"):
        pytest.fail(f"{reason}, and CI is set", pytrace=False)
    pytest.skip(reason)


def optional_module(name: str) -> Any:
    """Return a module of an optional extra; without it skip, or fail where CI is set."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        skip_or_fail(f"{name} is not installed ({error})")


@functools.cache
def _open_context() -> Any:
    """Return an off-screen context, or the reason why there is none."""
    os.environ.setdefault("LIBGL_ALWAYS_SOFTWARE", "true")
    try:
        import moderngl

        context = moderngl.create_standalone_context(backend="egl", require=330)
    except Exception as error:  # what is missing (package, libEGL, driver) sets its type
        return f"OpenGL is not available: {type(error).__name__}: {error}"
    renderer = context.info["GL_RENDERER"]
    if "llvmpipe" not in renderer:
        return f"OpenGL is not Mesa's software rasterizer llvmpipe but {renderer}"
    return context


def require_opengl() -> Any:
    """Return Mesa's context; without one skip the test, or fail it where CI is set."""
    context = _open_context()
    if isinstance(context, str):
        skip_or_fail(context)
    return context


@functools.cache
def _program(shaders: tuple[str, str]) -> Any:
    """Return a compiled pair of shaders; compiling takes longer than most drawings."""
    return require_opengl().program(*shaders)


def draw_faces(
    clip_positions: ArrayLike,
    faces: ArrayLike,
    size: tuple[int, int],
    colors: ArrayLike | None = None,
) -> Drawn:
    """
    Draw triangles with a depth test; the smaller z / w wins, the first of equal ones.

    Parameters
    ----------
    clip_positions : (V, 4) float32, clip space, y up
    faces : (F, 3) int
    size : (int, int)
        Width and height, pixels.
    colors : (V, 4) float32, optional
        Interpolated over the faces, perspective-correct.
    """
    positions = np.ascontiguousarray(clip_positions, np.float32)
    if colors is None:
        colors = np.ones((len(positions), 4))
    context = require_opengl()
    targets = [
        context.texture(size, 1, dtype="i4"),
        context.texture(size, 1, dtype="f4"),
        context.texture(size, 4, dtype="f4"),
    ]
    depth = context.depth_renderbuffer(size)
    buffer = context.framebuffer(targets, depth)
    program = _program(FACE_SHADERS)
    held = [
        context.buffer(positions),
        context.buffer(np.ascontiguousarray(colors, np.float32)),
        context.buffer(np.ascontiguousarray(faces, np.int32)),
    ]
    array = context.vertex_array(
        program,
        [(held[0], "4f", "clip_position"), (held[1], "4f", "vertex_color")],
        index_buffer=held[2],
    )
    buffer.use()
    context.viewport = (0, 0, *size)
    context.enable_only(context.DEPTH_TEST)
    context.depth_func = "<"
    buffer.clear(depth=1.0)
    array.render(context.TRIANGLES)
    shape = (size[1], size[0])
    bits = buffer.read(attachment=-1, components=1, dtype="f4")
    stored = np.frombuffer(bits, np.float32).reshape(shape)
    # Clearing fills the integer target with zeros, so what nothing covers is known by its depth.
    covered = stored < 1.0
    ids = np.frombuffer(targets[0].read(), np.int32).reshape(shape)
    drawn = Drawn(
        np.where(covered, ids, -1).astype(np.int32),
        np.frombuffer(targets[1].read(), np.float32).reshape(shape).astype(np.float64),
        stored.astype(np.float64),
        np.frombuffer(targets[2].read(), np.float32).reshape(*shape, 4).copy(),
    )
    for thing in (array, buffer, depth, *targets, *held):
        thing.release()
    return drawn


LINE_SHADERS = (
    """
    #version 330
    in vec4 clip_position;
    void main() {
        gl_Position = vec4(clip_position.x, -clip_position.y, clip_position.zw);
    }
    """,
    """
    #version 330
    out float drawn;
    void main() { drawn = 1.0; }
    """,
)


def draw_lines(
    clip_positions: ArrayLike, edges: ArrayLike, size: tuple[int, int]
) -> NDArray[np.bool_]:
    """
    Draw lines, one pixel wide, without a depth test; return the pixels drawn, (H, W), y down.

    Parameters
    ----------
    clip_positions : (V, 4) float32, clip space, y up
    edges : (N, 2) int
    size : (int, int)
        Width and height, pixels.
    """
    context = require_opengl()
    target = context.texture(size, 1, dtype="f4")
    buffer = context.framebuffer([target])
    program = _program(LINE_SHADERS)
    held = [
        context.buffer(np.ascontiguousarray(clip_positions, np.float32)),
        context.buffer(np.ascontiguousarray(edges, np.int32)),
    ]
    array = context.vertex_array(program, [(held[0], "4f", "clip_position")], index_buffer=held[1])
    buffer.use()
    context.viewport = (0, 0, *size)
    context.enable_only(context.NOTHING)
    buffer.clear()
    array.render(context.LINES)
    drawn = np.frombuffer(target.read(), np.float32).reshape(size[1], size[0]) > 0.5
    for thing in (array, buffer, target, *held):
        thing.release()
    return drawn
