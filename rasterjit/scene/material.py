"""Materials: shading, colours and textures of surfaces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from rasterjit.scene import validation as check
from rasterjit.scene.attribute_guard import Converted, store, suggests_replace
from rasterjit.scene.color import RGB, RGBA, ColorLike, rgb, rgba
from rasterjit.scene.light import MAX_RADIANCE
from rasterjit.scene.texture import Texture

Shading: TypeAlias = Literal["unlit", "flat", "gouraud", "phong", "pbr"]
SHADINGS: tuple[Shading, ...] = get_args(Shading)
"""The ways to shade: no light; one normal a face; light per vertex; light per pixel; light per
pixel on microfacets."""

AlphaMode: TypeAlias = Literal["opaque", "mask", "blend"]
ALPHA_MODES: tuple[AlphaMode, ...] = get_args(AlphaMode)
"""Uses of alpha: none; cutting holes; blending with surfaces behind."""

CORE_TEXTURES = (
    "base_color_texture", "normal_texture", "metallic_roughness_texture", "occlusion_texture",
    "emissive_texture",
)  # fmt: skip
"""The textures of every kind of shading."""

LAYER_TEXTURES = (
    "clearcoat_texture", "clearcoat_roughness_texture", "clearcoat_normal_texture",
    "sheen_color_texture", "sheen_roughness_texture", "specular_factor_texture",
    "specular_color_texture", "transmission_texture", "thickness_texture",
)  # fmt: skip
"""Textures of glTF's extensions of metallic-roughness materials."""

TEXTURE_FIELDS = CORE_TEXTURES + LAYER_TEXTURES
"""The textures of a material."""

MAX_THICKNESS = 1e6
"""Largest ``thickness`` of a body, in units of the mesh."""

NUMBER_RANGES = {
    "metallic": (0.0, 1.0),
    "roughness": (0.0, 1.0),
    "normal_scale": (-1e3, 1e3),
    "occlusion_strength": (0.0, 1.0),
    "alpha_cutoff": (0.0, 1e6),
    "clearcoat": (0.0, 1.0),
    "clearcoat_roughness": (0.0, 1.0),
    "clearcoat_normal_scale": (-1e3, 1e3),
    "sheen_roughness": (0.0, 1.0),
    "specular_factor": (0.0, 1.0),
    "transmission": (0.0, 1.0),
    "thickness": (0.0, MAX_THICKNESS),
}
"""Limits of the fields that are numbers."""

MAPPED_SHADINGS = frozenset(("flat", "phong", "pbr"))
"""Ways of shading that read normal and occlusion maps: those that light every pixel."""

MAX_SPECULAR = 1e6
"""Largest strength of a highlight: its product with the brightest light fits float32."""

SHININESS_RANGE = (1e-6, 1e6)
"""Exponents of a highlight: from none to see, to one narrower than a float32 angle."""

LIGHT_GREY: RGBA = tuple(np.array([0.8, 0.8, 0.8, 1.0], np.float32).tolist())
"""Default colour of a surface, linear."""

BLACK = (0.0, 0.0, 0.0)

WHITE = (1.0, 1.0, 1.0, 1.0)
"""Linear white, which changes no colour that it multiplies."""

MAX_TINT = 1e6
"""Largest ``specular_color``; what it multiplies is held to 1."""

IOR, MAX_IOR = 1.5, 1e3
"""Default index of refraction of a surface, and the largest."""

CLEAR_TRANSMISSION = 0.5
"""Transmission above which a thin wall casts no shadow."""

NO_LAYER_TEXTURES = (None,) * len(LAYER_TEXTURES)


@suggests_replace
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
        Any colour, as `types.ColorLike` has it; stored as a tuple of linear RGBA.
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
        Light that the surface sends out by itself: a colour, or three floats in 0..1e30, linear.
        The lit colour is added to it; nothing else is lit by it. Default: none, or white with an
        ``emissive_texture``.
    emissive_texture : Texture, optional
        Multiplies ``emissive``.
    alpha_mode : {"opaque", "mask", "blend"}
        Whether alpha does nothing, cuts holes where it is below ``alpha_cutoff``, or lets through
        what lies behind. What is blended receives shadows and casts none by default, unless its
        alpha is 1 all over: then it is opaque.
    alpha_cutoff : float
        In 0..1e6; what has at least this alpha is shown. Alpha is found at each sample of a pixel,
        but once a face and pixel with ``Quality(samples="area")``: there edges of holes stay hard.
    double_sided : bool
        Whether back faces are drawn.
    casts_shadow : bool, optional
        Whether it casts shadows, as dark as those of what is opaque. Default: None, what is opaque
        does, and what is blended, or thin and clear, does not. What is sized in pixels never does.
    clearcoat, clearcoat_roughness : float
        In 0..1, for ``"pbr"``: how much of a clear varnish lies on top, and how rough it is. It
        mirrors as glass does, 4 % straight on; what lies below is dimmed by as much.
    clearcoat_texture, clearcoat_roughness_texture : Texture, optional
        Red multiplies ``clearcoat``, green ``clearcoat_roughness``. Both are ``"linear"``.
    clearcoat_normal_texture : Texture, optional
        Normals of the varnish, as ``normal_texture`` has those below it. Default: those of the
        mesh, whatever the ``normal_texture``.
    clearcoat_normal_scale : float
        Factor on their x and y, in -1000..1000.
    sheen_color : str or array_like, optional
        A colour, linear, for ``"pbr"``: of the fibres that stand out of cloth, which shine where
        light or view graze it. What they take is missing below. Default: none, or white with a
        ``sheen_color_texture``.
    sheen_roughness : float
        In 0..1: how much the fibres lean.
    sheen_color_texture, sheen_roughness_texture : Texture, optional
        RGB (sRGB) multiplies ``sheen_color``, alpha ``sheen_roughness``.
    specular_factor : float
        In 0..1, for ``"pbr"``: how much of its mirrored light what is no metal shows. (``specular``
        is that of Blinn-Phong.)
    specular_factor_texture : Texture, optional
        Alpha multiplies it.
    specular_color : str or array_like, optional
        What is mirrored straight on is multiplied by it, and held to 1: a colour, or three floats
        in 0..1e6, linear. Default: white.
    specular_color_texture : Texture, optional
        RGB (sRGB) multiplies ``specular_color``.
    ior : float
        Index of refraction of what is no metal, for ``"pbr"``: in 1..1000, or 0, which mirrors all.
        Light straight on is mirrored by ``((ior - 1) / (ior + 1))**2``: 4 % for 1.5.
    transmission : float
        In 0..1, for ``"pbr"``: how much of the light that goes into the surface goes through it,
        and not back out again. Through it is seen, tinted by the base colour, what is opaque behind
        it; not what is blended, or transmits itself. Thin walls above 0.5 cast no shadow.
    transmission_texture : Texture, optional
        Red multiplies it.
    thickness : float
        In 0..1e6, in units of the mesh: how thick the body below the surface is, which bends what
        is seen through it by ``ior``; 0: its wall is thin, and bends nothing.
    thickness_texture : Texture, optional
        Green multiplies it.
    attenuation_distance : float
        Above 0, in units of the world: how far light goes in the body until it is of the
        ``attenuation_color``. Default: infinite.
    attenuation_color : str or array_like, optional
        A colour, linear. Default: white.

    Raises
    ------
    ValueError
        If the shading or the alpha mode is unknown, a colour or a texture is not one, or a number
        is out of range.

    Notes
    -----
    Normal and occlusion maps apply where every pixel is lit: not to ``"gouraud"`` and ``"unlit"``.
    What is for ``"pbr"`` changes nothing elsewhere.

    References
    ----------
    .. [1] J. F. Blinn, "Models of light reflection for computer synthesized pictures", SIGGRAPH
       1977.
    .. [2] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), section 3.9, and
       "KHR_materials_clearcoat", "_sheen", "_specular", "_ior", "_transmission", "_volume".
    """

    shading: Shading = "phong"
    base_color: Converted[ColorLike | None, RGBA | None] = Converted(None)
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
    emissive: Converted[ColorLike | None, RGB] = field(default=Converted(None), kw_only=True)
    emissive_texture: Texture | None = field(default=None, kw_only=True)
    alpha_mode: AlphaMode = field(default="opaque", kw_only=True)
    alpha_cutoff: float = field(default=0.5, kw_only=True)
    double_sided: bool = field(default=True, kw_only=True)
    casts_shadow: bool | None = field(default=None, kw_only=True)
    clearcoat: float = field(default=0.0, kw_only=True)
    clearcoat_roughness: float = field(default=0.0, kw_only=True)
    clearcoat_texture: Texture | None = field(default=None, kw_only=True)
    clearcoat_roughness_texture: Texture | None = field(default=None, kw_only=True)
    clearcoat_normal_texture: Texture | None = field(default=None, kw_only=True)
    clearcoat_normal_scale: float = field(default=1.0, kw_only=True)
    sheen_color: Converted[ColorLike | None, RGB] = field(default=Converted(None), kw_only=True)
    sheen_roughness: float = field(default=0.0, kw_only=True)
    sheen_color_texture: Texture | None = field(default=None, kw_only=True)
    sheen_roughness_texture: Texture | None = field(default=None, kw_only=True)
    specular_factor: float = field(default=1.0, kw_only=True)
    specular_factor_texture: Texture | None = field(default=None, kw_only=True)
    specular_color: Converted[ColorLike | None, RGB] = field(default=Converted(None), kw_only=True)
    specular_color_texture: Texture | None = field(default=None, kw_only=True)
    ior: float = field(default=IOR, kw_only=True)
    transmission: float = field(default=0.0, kw_only=True)
    transmission_texture: Texture | None = field(default=None, kw_only=True)
    thickness: float = field(default=0.0, kw_only=True)
    thickness_texture: Texture | None = field(default=None, kw_only=True)
    attenuation_distance: float = field(default=math.inf, kw_only=True)
    attenuation_color: Converted[ColorLike | None, RGB] = field(
        default=Converted(None), kw_only=True
    )

    def __post_init__(self) -> None:
        check.one_of("shading", self.shading, SHADINGS)
        specular = check.bounded_number("specular", self.specular, 0.0, MAX_SPECULAR)
        shininess = check.bounded_number("shininess", self.shininess, *SHININESS_RANGE)
        for name in TEXTURE_FIELDS:
            texture = getattr(self, name)
            if texture is not None and not isinstance(texture, Texture):
                raise ValueError(f"{name} must be a Texture or None, got {check.brief(texture)}")
        check.one_of("alpha_mode", self.alpha_mode, ALPHA_MODES)
        check.boolean("double_sided", self.double_sided)
        if self.casts_shadow is not None:
            check.boolean("casts_shadow", self.casts_shadow)
        for name, (low, high) in NUMBER_RANGES.items():
            value = getattr(self, name)
            if type(value) is not float or not low <= value <= high:
                object.__setattr__(self, name, check.bounded_number(name, value, low, high))
        if self.base_color is not None:
            store(self, base_color=rgba("base_color", self.base_color))
        if self.emissive is None:
            is_dark = self.emissive_texture is None
            store(self, emissive="black" if is_dark else "white")
        store(self, emissive=_hdr_color("emissive", self.emissive, MAX_RADIANCE))
        self._check_layers()
        store(self, specular=specular, shininess=shininess)

    def _check_layers(self) -> None:
        """Check and store the colours of layers, ``ior`` and ``attenuation_distance``."""
        sheen, tint, attenuation = self.sheen_color, self.specular_color, self.attenuation_color
        if sheen is None:
            sheen = BLACK if self.sheen_color_texture is None else WHITE[:3]
        else:
            sheen = rgb("sheen_color", sheen)
        tint = WHITE[:3] if tint is None else _hdr_color("specular_color", tint, MAX_TINT)
        attenuation = WHITE[:3] if attenuation is None else rgb("attenuation_color", attenuation)
        store(self, sheen_color=sheen, specular_color=tint, attenuation_color=attenuation)
        if self.ior is not IOR:
            ior = check.finite_number("ior", self.ior)
            if ior != 0.0 and not 1.0 <= ior <= MAX_IOR:
                raise ValueError(f"ior must be 0 or in 1..{MAX_IOR:g}, got {self.ior!r}")
            store(self, ior=ior)
        if not check.is_infinite(self.attenuation_distance):
            distance = check.positive_number("attenuation_distance", self.attenuation_distance)
            store(self, attenuation_distance=distance)

    @property
    def emits(self) -> bool:
        """Whether the surface sends out light."""
        return max(self.emissive) > 0.0

    @property
    def has_normal_map(self) -> bool:
        """Whether the surface or its clearcoat has a normal map."""
        return self.normal_texture is not None or self.clearcoat_normal_texture is not None

    @property
    def has_clearcoat(self) -> bool:
        """Whether a clearcoat lies on top."""
        return self.shading == "pbr" and self.clearcoat > 0.0

    @property
    def has_sheen(self) -> bool:
        """Whether the surface has sheen."""
        return self.shading == "pbr" and max(self.sheen_color) > 0.0

    @property
    def has_custom_specular(self) -> bool:
        """Whether dielectrics reflect other than 4 % of white light at normal incidence."""
        return self.shading == "pbr" and (
            self.ior != IOR
            or self.specular_factor != 1.0
            or self.specular_color != WHITE[:3]
            or self.specular_factor_texture is not None
            or self.specular_color_texture is not None
        )

    @property
    def transmits(self) -> bool:
        """Whether light goes through the surface, refracted."""
        return self.shading == "pbr" and self.transmission > 0.0

    @property
    def is_clear_pane(self) -> bool:
        """Whether the surface is thin and lets through more light than it keeps."""
        return self.transmits and self.thickness == 0.0 and self.transmission > CLEAR_TRANSMISSION

    def base_color_over(self, has_colors: bool) -> tuple[float, float, float, float]:
        """
        Return the factor on a mesh's colours and the texture, linear RGBA.

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
            return self.base_color
        return (
            WHITE
            if check.boolean("has_colors", has_colors) or self.base_color_texture is not None
            else LIGHT_GREY
        )

    def textures_read(self) -> tuple[Texture | None, ...]:
        """Return the textures that shading reads, in the order of ``TEXTURE_FIELDS``, or None."""
        is_mapped = self.shading in MAPPED_SHADINGS
        return (
            self.base_color_texture,
            self.normal_texture if is_mapped else None,
            self.metallic_roughness_texture if self.shading == "pbr" else None,
            self.occlusion_texture if is_mapped else None,
            self.emissive_texture if self.emits else None,
            *(self._layer_textures() if self.shading == "pbr" else NO_LAYER_TEXTURES),
        )

    def _layer_textures(self) -> tuple[Texture | None, ...]:
        """Return those of ``LAYER_TEXTURES`` that shading reads; None for others."""
        coat, sheen, reflects = (self.has_clearcoat, self.has_sheen, self.specular_factor > 0.0)
        is_tinted = reflects and any(part > 0.0 for part in self.specular_color)
        return (
            self.clearcoat_texture if coat else None,
            self.clearcoat_roughness_texture if coat else None,
            self.clearcoat_normal_texture if coat else None,
            self.sheen_color_texture if sheen else None,
            self.sheen_roughness_texture if sheen else None,
            self.specular_factor_texture if reflects else None,
            self.specular_color_texture if is_tinted else None,
            self.transmission_texture if self.transmits else None,
            self.thickness_texture if self.transmits and self.thickness > 0.0 else None,
        )


@suggests_replace
@dataclass(frozen=True)
class DefaultMaterial(Material):
    """
    The default material of glTF files, for surfaces without one.

    In a scene with an environment, a surface that still has it looks as glTF 2.0 says: a rough
    white metal, which would show little without one.
    """

    def in_environment(self) -> Material:
        """Return the material to shade with in a scene with an environment."""
        if self != DefaultMaterial():
            return self
        return Material(shading="pbr", base_color="white", metallic=1.0, roughness=1.0)


def with_textures(material: Material, textures: Mapping[str, Texture | None]) -> Material:
    """Return a material with other textures, by field."""
    changes: dict[str, Any] = dict(textures)
    return replace(material, **changes)


def _hdr_color(name: str, value: ColorLike, max_value: float) -> tuple[float, float, float]:
    """Return a colour as linear RGB with components up to ``max_value``, or raise."""
    if not isinstance(value, str) and check.unmasked_array(name, value).dtype != np.uint8:
        red, green, blue = (
            check.bounded_number(name, part, 0.0, max_value)
            for part in check.vector(name, value).tolist()
        )
        return red, green, blue
    return rgb(name, value)
