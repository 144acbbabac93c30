"""Materials: how a mesh answers light."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias, cast, get_args

import numpy as np

from rasterjit.scene.assigning import says_replace
from rasterjit.scene.color import ColorLike, linear_color
from rasterjit.scene.texture import Texture
from rasterjit.scene.validation import bounded_number, in_short, one_of, vector

Shading: TypeAlias = Literal["unlit", "flat", "gouraud", "phong", "pbr"]
SHADINGS: tuple[Shading, ...] = get_args(Shading)
"""The ways to shade: no light; one normal a face; light per vertex; light per pixel; light per
pixel on microfacets."""

AlphaMode: TypeAlias = Literal["opaque", "mask", "blend"]
ALPHA_MODES: tuple[AlphaMode, ...] = get_args(AlphaMode)
"""What alpha does: nothing; it cuts holes; it lets through what lies behind."""

TEXTURE_FIELDS = (
    "base_color_texture", "normal_texture", "metallic_roughness_texture", "occlusion_texture",
    "emissive_texture",
)  # fmt: skip
"""The textures of a material."""

BRIGHTEST_EMISSION = 1e6
"""Largest emission, linear: as bright as a texel may be."""

NUMBERS = {
    "metallic": (0.0, 1.0),
    "roughness": (0.0, 1.0),
    "normal_scale": (-1e3, 1e3),
    "occlusion_strength": (0.0, 1.0),
    "alpha_cutoff": (0.0, 1e6),
}
"""Fields that are numbers, and their bounds."""

MAPPED = frozenset(("flat", "phong", "pbr"))
"""Ways of shading that read normal and occlusion maps: those that light every pixel."""

MOST_SPECULAR = 1e6
"""Largest strength of a highlight: its product with the brightest light fits float32."""

SHININESS_RANGE = (1e-6, 1e6)
"""Exponents of a highlight: from none to see, to one narrower than a float32 angle."""

LIGHT_GREY = tuple(np.float32([0.8, 0.8, 0.8, 1.0]).tolist())
"""The colour of a surface that nothing is said about, linear."""

WHITE = (1.0, 1.0, 1.0, 1.0)
"""What multiplies colours and leaves them as they are."""


@says_replace
@dataclass(frozen=True)
class Material:
    """
    Describe how a surface is shaded.

    A mesh's vertex or face colours and the texture are drawn as they are; a ``base_color`` that is
    given multiplies them.

    Parameters
    ----------
    shading : {"phong", "gouraud", "flat", "unlit", "pbr"}
        ``"phong"`` lights every pixel by its interpolated normal, ``"gouraud"`` every vertex,
        ``"flat"`` every face by its own plane; ``"unlit"`` shows the colour as it is. ``"pbr"``
        lights every pixel by glTF 2.0's metallic-roughness model.
    base_color : str or array_like, optional
        Any colour of `rasterjit.scene.color.linear_color`; stored as a tuple of linear RGBA.
        Default: None, which is a light grey where there are neither colours nor a
        ``base_color_texture``, and changes nothing where there are; see `base_color_over`.
    specular : float
        Strength of the white Blinn-Phong highlight, linear, in 0..1e6; 0 is none.
    shininess : float
        Exponent of the Blinn-Phong highlight, in 1e-6..1e6; larger is smaller and sharper.
    name : str, optional
        What the file called it.
    base_color_texture : Texture, optional
        Laid over the mesh by its ``uv``, which it then has to have, or by ``uv1`` as the texture's
        ``uv_set`` says. The highlight lies on top.
    metallic, roughness : float
        In 0..1, for ``"pbr"``: how much of the surface is metal, and how rough it is.
    normal_texture : Texture, optional
        Normals in tangent space, as glTF 2.0 defines them: ``2 rgb - 1`` is x along the tangent,
        where u grows, y where v grows, z along the normal. Its ``color_space`` is ``"linear"``.
    normal_scale : float
        Factor on their x and y, in -1000..1000.
    metallic_roughness_texture : Texture, optional
        Green multiplies ``roughness``, blue ``metallic``; for ``"pbr"``. ``"linear"`` as well.
    occlusion_texture : Texture, optional
        Red is the share of ambient and environment light that arrives. ``"linear"`` as well.
    occlusion_strength : float
        In 0..1: how much of that applies.
    emissive : str or array_like, optional
        Light that the surface sends out by itself: a colour, or three floats in 0..1e6, linear.
        The lit colour is added to it; nothing else is lit by it. Default: none, or white with an
        ``emissive_texture``.
    emissive_texture : Texture, optional
        Multiplies ``emissive``.
    alpha_mode : {"opaque", "mask", "blend"}
        Whether alpha does nothing, cuts holes where it is below ``alpha_cutoff``, or lets through
        what lies behind. What is blended receives shadows and casts none, unless its alpha is 1
        all over: then it is opaque.
    alpha_cutoff : float
        In 0..1e6; what has at least this alpha is shown. Alpha is found at each sample of a pixel,
        but once a face and pixel with ``Quality(samples="area")``: there edges of holes stay hard.
    double_sided : bool
        Whether back faces are drawn.

    Raises
    ------
    ValueError
        If the shading or the alpha mode is unknown, a colour or a texture is not one, or a number
        is out of range.

    Notes
    -----
    Normal and occlusion maps apply where every pixel is lit: not to ``"gouraud"`` and ``"unlit"``.

    References
    ----------
    .. [1] J. F. Blinn, "Models of light reflection for computer synthesized pictures", SIGGRAPH
       1977.
    .. [2] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), section 3.9.
    """

    shading: Shading = "phong"
    base_color: ColorLike | None = None
    specular: float = 0.25
    shininess: float = 50.0
    name: str | None = None
    base_color_texture: Texture | None = None
    metallic: float = 0.0
    roughness: float = 0.5
    normal_texture: Texture | None = field(default=None, kw_only=True)
    normal_scale: float = field(default=1.0, kw_only=True)
    metallic_roughness_texture: Texture | None = field(default=None, kw_only=True)
    occlusion_texture: Texture | None = field(default=None, kw_only=True)
    occlusion_strength: float = field(default=1.0, kw_only=True)
    emissive: ColorLike | None = field(default=None, kw_only=True)
    emissive_texture: Texture | None = field(default=None, kw_only=True)
    alpha_mode: AlphaMode = field(default="opaque", kw_only=True)
    alpha_cutoff: float = field(default=0.5, kw_only=True)
    double_sided: bool = field(default=True, kw_only=True)

    def __post_init__(self) -> None:
        one_of("shading", self.shading, SHADINGS)
        specular = bounded_number("specular", self.specular, 0.0, MOST_SPECULAR)
        shininess = bounded_number("shininess", self.shininess, *SHININESS_RANGE)
        for name in TEXTURE_FIELDS:
            texture = getattr(self, name)
            if texture is not None and not isinstance(texture, Texture):
                raise ValueError(f"{name} must be a Texture or None, got {in_short(texture)}")
        one_of("alpha_mode", self.alpha_mode, ALPHA_MODES)
        if not isinstance(self.double_sided, bool):
            raise ValueError(f"double_sided must be True or False, got {self.double_sided!r}")
        for name, (low, high) in NUMBERS.items():
            object.__setattr__(self, name, bounded_number(name, getattr(self, name), low, high))
        if self.base_color is not None:
            base_color = tuple(linear_color("base_color", self.base_color).tolist())
            object.__setattr__(self, "base_color", base_color)
        if self.emissive is None:
            dark = self.emissive_texture is None
            object.__setattr__(self, "emissive", "black" if dark else "white")
        object.__setattr__(self, "emissive", _emission(self.emissive))
        object.__setattr__(self, "specular", specular)
        object.__setattr__(self, "shininess", shininess)

    @property
    def emits(self) -> bool:
        """Whether the surface sends out light."""
        return any(part > 0.0 for part in self.emissive)

    def base_color_over(self, has_colors: bool) -> tuple[float, float, float, float]:
        """
        Return what multiplies a mesh's colours and the texture, linear RGBA.

        Parameters
        ----------
        has_colors : bool
            Whether the mesh has vertex or face colours.

        Returns
        -------
        tuple of four floats
            ``base_color`` if it is given; else white where there are colours or a
            ``base_color_texture``, and a light grey where there is neither.
        """
        if self.base_color is not None:
            return cast("tuple[float, float, float, float]", self.base_color)
        return WHITE if has_colors or self.base_color_texture is not None else LIGHT_GREY

    def textures_read(self) -> tuple[Texture | None, ...]:
        """Return the textures that make a difference, in the order of ``TEXTURE_FIELDS``."""
        is_mapped = self.shading in MAPPED
        return (
            self.base_color_texture,
            self.normal_texture if is_mapped else None,
            self.metallic_roughness_texture if self.shading == "pbr" else None,
            self.occlusion_texture if is_mapped else None,
            self.emissive_texture if self.emits else None,
        )


@says_replace
@dataclass(frozen=True)
class UnsaidMaterial(Material):
    """
    The default material, where a glTF file says nothing about a surface.

    In a scene with an environment, a surface that still has it looks as glTF 2.0 says: a rough
    white metal, which would show little without one.
    """

    def in_environment(self) -> Material:
        """Return the material that is in force in a scene with an environment."""
        if self != UnsaidMaterial():
            return self
        return Material(shading="pbr", base_color="white", metallic=1.0, roughness=1.0)


def _emission(value: ColorLike) -> tuple[float, float, float]:
    """Return light that is sent out as linear RGB, which may be brighter than white, or raise."""
    if not isinstance(value, str) and np.asarray(value).dtype != np.uint8:
        red, green, blue = (
            bounded_number("emissive", part, 0.0, BRIGHTEST_EMISSION)
            for part in vector("emissive", value).tolist()
        )
        return red, green, blue
    red, green, blue, _ = linear_color("emissive", value).tolist()
    return red, green, blue
