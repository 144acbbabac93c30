"""Classes of letters, which can be named and not made: captions are drawn with Pillow, say."""

from __future__ import annotations

from rasterjit.compat.pyrender.fields import NoOpenGLError


class FontCache:
    """
    A folder of fonts, which cannot be made here.

    Raises
    ------
    NoOpenGLError
        Always.
    """

    def __init__(self, font_dir: str | None = None) -> None:
        raise NoOpenGLError("FontCache")


class Font:
    """
    Textures of letters, which cannot be made here.

    Raises
    ------
    NoOpenGLError
        Always.
    """

    def __init__(self, font_file: str, font_pt: int = 40) -> None:
        raise NoOpenGLError("Font")


class Character:
    """
    A letter's texture, which cannot be made here.

    Raises
    ------
    NoOpenGLError
        Always.
    """

    def __init__(self, texture: object, size: object, bearing: object, advance: object) -> None:
        raise NoOpenGLError("Character")
