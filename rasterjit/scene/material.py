"""Materials: how a mesh answers light."""

from __future__ import annotations

from dataclasses import dataclass

from rasterjit.scene.color import ColorLike, linear_color
from rasterjit.scene.texture import Texture
from rasterjit.validation import bounded_number, one_of

SHADINGS = ("unlit", "flat", "gouraud", "phong")
"""The ways to shade: no light; one normal a face; light per vertex; light per pixel."""

MOST_SPECULAR = 1e6
"""Largest strength of a highlight: its product with the brightest light fits float32."""

SHININESS_RANGE = (1e-6, 1e6)
"""Exponents of a highlight: from none to see, to one narrower than a float32 angle."""

LIGHT_GREY = (0.8, 0.8, 0.8, 1.0)
"""The colour of a surface that nothing is said about, linear."""


@dataclass(frozen=True)
class Material:
    """
    Describe how a surface is shaded.

    A mesh's vertex or face colours and the texture multiply ``base_color``.

    Parameters
    ----------
    shading : {"phong", "gouraud", "flat", "unlit"}
        ``"phong"`` lights every pixel by its interpolated normal, ``"gouraud"`` every vertex,
        ``"flat"`` every face by its own plane; ``"unlit"`` shows the colour as it is.
    base_color : str or array_like, optional
        Any colour of `rasterjit.scene.color.linear_color`; stored as a tuple of linear RGBA.
        Default: a light grey, or white with a texture.
    specular : float
        Strength of the white Blinn-Phong highlight, linear, in 0..1e6; 0 is matt.
    shininess : float
        Exponent of the Blinn-Phong highlight, in 1e-6..1e6; larger is smaller and sharper.
    name : str, optional
        What the file called it.
    base_color_texture : Texture, optional
        Laid over the mesh by its ``uv``, which it then has to have. The highlight lies on top.

    Raises
    ------
    ValueError
        If the shading is unknown, the colour or the texture is not one, or ``specular`` or
        ``shininess`` is out of range.

    References
    ----------
    J. F. Blinn, "Models of light reflection for computer synthesized pictures", SIGGRAPH 1977.
    """

    shading: str = "phong"
    base_color: ColorLike | None = None
    specular: float = 0.25
    shininess: float = 50.0
    name: str | None = None
    base_color_texture: Texture | None = None

    def __post_init__(self) -> None:
        one_of("shading", self.shading, SHADINGS)
        specular = bounded_number("specular", self.specular, 0.0, MOST_SPECULAR)
        shininess = bounded_number("shininess", self.shininess, *SHININESS_RANGE)
        texture = self.base_color_texture
        if texture is not None and not isinstance(texture, Texture):
            raise ValueError(f"base_color_texture must be a Texture or None, got {texture!r}")
        if self.base_color is None:
            object.__setattr__(self, "base_color", LIGHT_GREY if texture is None else "white")
        base_color = tuple(linear_color("base_color", self.base_color).tolist())
        object.__setattr__(self, "base_color", base_color)
        object.__setattr__(self, "specular", specular)
        object.__setattr__(self, "shininess", shininess)
