"""Classes of shaders, which can be named and not made: RasterJIT draws without OpenGL."""

from __future__ import annotations

from typing import Any

from rasterjit.compat.pyrender.fields import NoOpenGLError


class ShaderProgram:
    """
    A shader, which cannot be made here.

    Raises
    ------
    NoOpenGLError
        Always; it says what to use instead.
    """

    def __init__(
        self,
        vertex_shader: str,
        fragment_shader: str,
        geometry_shader: str | None = None,
        defines: Any = None,
    ) -> None:
        raise NoOpenGLError("ShaderProgram")


class ShaderProgramCache:
    """
    A folder of shaders, which cannot be made here.

    Raises
    ------
    NoOpenGLError
        Always; it says what to use instead.
    """

    def __init__(self, shader_dir: str | None = None) -> None:
        raise NoOpenGLError("ShaderProgramCache")
