"""Materials, as glTF has them."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.pyrender.constants import TexFlags
from rasterjit.compat.pyrender.fields import (
    Field,
    to_bool,
    to_share,
    to_share_or_one,
    to_text_or_none,
)
from rasterjit.compat.pyrender.texture import Texture
from rasterjit.compat.pyrender.utils import format_color_vector, format_texture_source
from rasterjit.scene import material

_ALPHA_MODES = ("OPAQUE", "MASK", "BLEND")

ColorField = Field[NDArray[np.float32]]


def _make_texture_field(channels: str) -> Field[Texture | None]:
    """Return the field of a texture, which is made of a picture if need be."""

    def checked(value: Any) -> Texture | None:
        if value is None or isinstance(value, Texture):
            return value
        pixels = format_texture_source(value, channels)
        return Texture(source=pixels, source_channels=channels)

    return Field(checked, f"Texture or None: a picture is made one, of channels {channels}.", None)


def _make_color_field(channels: int, default: float) -> Field[NDArray[np.float32]]:
    """Return the field of a colour; None is a default of all channels."""

    def checked(value: Any) -> NDArray[np.float32]:
        return format_color_vector(np.full(channels, default) if value is None else value, channels)

    return Field(checked, f"({channels},) float32: linear light.", None)


def _check_alpha_mode(value: Any) -> str:
    """Return a mode if it is one; None is OPAQUE."""
    value = "OPAQUE" if value is None else value
    if not isinstance(value, str) or value not in _ALPHA_MODES:
        raise ValueError(f"must be one of {', '.join(_ALPHA_MODES)}")
    return value


@dataclass(eq=False, repr=False)
class Material:
    """
    What all materials have.

    Parameters
    ----------
    name : str, optional
    normalTexture, occlusionTexture, emissiveTexture : Texture, array or PIL.Image, optional
    emissiveFactor : float or (3,) array_like, optional
        Linear RGB, whole numbers are shares of 255; default none.
    alphaMode : {"OPAQUE", "MASK", "BLEND"}
    alphaCutoff : float, optional
        In 0..1; default 0.5.
    doubleSided : bool
        Whether back faces are drawn.
    smooth : bool
        Kept and without effect: see `Mesh.from_trimesh`.
    wireframe : bool
        Whether edges are drawn in place of faces.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong.
    """

    name: Field[str | None] = Field(to_text_or_none, "str or None: the material's name.", None)
    normalTexture: Field[Texture | None] = _make_texture_field("RGB")
    occlusionTexture: Field[Texture | None] = _make_texture_field("R")
    emissiveTexture: Field[Texture | None] = _make_texture_field("RGB")
    emissiveFactor: ColorField = _make_color_field(3, 0.0)
    alphaMode: Field[str] = Field(_check_alpha_mode, "str: OPAQUE, MASK or BLEND.", None)
    alphaCutoff: Field[float] = Field(
        lambda value: 0.5 if value is None else to_share(value),
        "float: the least alpha that is seen under MASK.",
        None,
    )
    doubleSided: Field[bool] = Field(to_bool, "bool: whether back faces are drawn.", False)
    smooth: Field[bool] = Field(to_bool, "bool: as it was given.", True)
    wireframe: Field[bool] = Field(
        to_bool, "bool: whether edges are drawn in place of faces.", False
    )

    @property
    def is_transparent(self) -> bool:
        """Whether its alpha lets through what is behind; see `Texture.is_transparent`."""
        if self.alphaMode == "OPAQUE":
            return False
        least = 1.0 if self.alphaMode == "BLEND" else self.alphaCutoff
        color, picture = self._get_base()
        return bool(color[3] < least) or (picture is not None and picture.is_transparent(least))

    @property
    def least_alpha(self) -> float:
        """The least alpha of its base colour, in 0..1; 0 where a texture has some below 1."""
        color, picture = self._get_base()
        is_seen_through = picture is not None and not picture.is_opaque
        return 0.0 if is_seen_through else min(max(float(color[3]), 0.0), 1.0)

    @property
    def tex_flags(self) -> int:
        """Which textures it has, as ``TexFlags`` numbers them."""
        given = [flag for flag, texture in self._list_flagged() if texture is not None]
        return int(sum(given))

    @property
    def textures(self) -> set[Texture]:
        """Its textures."""
        return {texture for _, texture in self._list_flagged() if texture is not None}

    def _get_base(self) -> tuple[NDArray[np.float32], Texture | None]:
        """Return its colour, (4,), and the picture that this multiplies."""
        return np.ones(4, np.float32), None

    def _list_flagged(self) -> list[tuple[TexFlags, Texture | None]]:
        """Return all the textures that it may have, and their flags."""
        return [
            (TexFlags.NORMAL, self.normalTexture),
            (TexFlags.OCCLUSION, self.occlusionTexture),
            (TexFlags.EMISSIVE, self.emissiveTexture),
        ]

    def convert(
        self, *, has_uv: bool, is_lit: bool, is_culled: bool, least_alpha: float
    ) -> material.Material:
        """Return the material as RasterJIT has it, or raise ``TypeError`` if it is of no kind."""
        raise TypeError(
            f"material must be a MetallicRoughnessMaterial to be drawn, got {type(self).__name__}"
        )


@dataclass(eq=False, repr=False)
class MetallicRoughnessMaterial(Material):
    """
    A glTF 2.0 metallic-roughness material.

    Parameters
    ----------
    name, normalTexture, occlusionTexture, emissiveTexture, emissiveFactor, alphaMode, alphaCutoff,
    doubleSided, smooth, wireframe
        As `Material` takes them.
    baseColorFactor : float, (3,) or (4,) array_like, optional
        Linear RGBA, whole numbers are shares of 255; default white.
    baseColorTexture, metallicRoughnessTexture : Texture, array or PIL.Image, optional
    metallicFactor, roughnessFactor : float
        In 0..1.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong.
    """

    baseColorFactor: ColorField = _make_color_field(4, 1.0)
    baseColorTexture: Field[Texture | None] = _make_texture_field("RGBA")
    metallicFactor: Field[float] = Field(to_share_or_one, "float: share of metal.", 1.0)
    roughnessFactor: Field[float] = Field(to_share_or_one, "float: roughness.", 1.0)
    metallicRoughnessTexture: Field[Texture | None] = _make_texture_field("GB")

    def _get_base(self) -> tuple[NDArray[np.float32], Texture | None]:
        return self.baseColorFactor, self.baseColorTexture

    def _list_flagged(self) -> list[tuple[TexFlags, Texture | None]]:
        return [
            *super()._list_flagged(),
            (TexFlags.BASE_COLOR, self.baseColorTexture),
            (TexFlags.METALLIC_ROUGHNESS, self.metallicRoughnessTexture),
        ]

    def convert(
        self, *, has_uv: bool, is_lit: bool, is_culled: bool, least_alpha: float
    ) -> material.Material:
        """
        Return the material as RasterJIT has it.

        Parameters
        ----------
        has_uv : bool
            Whether the mesh has texture coordinates; without them there are no textures.
        is_lit : bool
            Whether light counts; without it only the base colour does, and nothing glows.
        is_culled : bool
            Whether back faces may be left out.
        least_alpha : float
            Of the mesh's colours.
        """
        maps = {"base_color_texture": self.baseColorTexture}
        if is_lit:
            maps |= {
                "normal_texture": self.normalTexture,
                "metallic_roughness_texture": self.metallicRoughnessTexture,
                "occlusion_texture": self.occlusionTexture,
                "emissive_texture": self.emissiveTexture,
            }
        # The factor counts twice, as in pyrender's shader.
        glow = np.square(np.asarray(self.emissiveFactor, np.float64)) if is_lit else np.zeros(3)
        # Codes are filtered as they are; what they stand for is found behind that.
        textures = {
            field: texture.convert(is_metallic_roughness=field == "metallic_roughness_texture")
            for field, texture in maps.items()
            if texture is not None and has_uv
        }
        picture = textures.get("base_color_texture")
        color = np.clip(np.asarray(self.baseColorFactor, np.float64), 0.0, 1.0)
        mode: material.AlphaMode = "blend" if self.alphaMode == "BLEND" else "opaque"
        is_opaque = color[3] * least_alpha >= 1.0 and (picture is None or picture.is_opaque)
        if mode == "opaque" or is_opaque:
            # What hides all behind it needs no layers.
            mode, color[3] = "opaque", 1.0
        look = _make_cached_material if not textures else _make_material
        return look(
            "pbr" if is_lit else "unlit", tuple(color.tolist()),
            float(self.metallicFactor), float(self.roughnessFactor),
            tuple(glow.tolist()), mode, self.doubleSided or not is_culled, **textures,
        )  # fmt: skip


def _make_material(
    shading: material.Shading, color: tuple[float, ...], metallic: float, roughness: float,
    emissive: tuple[float, ...], alpha_mode: material.AlphaMode, double_sided: bool,
    **textures: Any,
) -> material.Material:  # fmt: skip
    """Return a material as RasterJIT has it."""
    return material.Material(
        shading, color, metallic=metallic, roughness=roughness, emissive=emissive,
        alpha_mode=alpha_mode, double_sided=double_sided, **textures,
    )  # fmt: skip


_make_cached_material = functools.lru_cache(maxsize=1024)(_make_material)
"""Of what has no textures: scenes have many objects of few looks."""


@dataclass(eq=False, repr=False)
class SpecularGlossinessMaterial(Material):
    """
    A glTF material of the extension ``KHR_materials_pbrSpecularGlossiness``.

    It is drawn as a metallic-roughness material that is no metal, with the diffuse colour as its
    base colour and a roughness of 1 less the glossiness; pyrender 0.1.45 cannot draw it at all.

    Parameters
    ----------
    name, normalTexture, occlusionTexture, emissiveTexture, emissiveFactor, alphaMode, alphaCutoff,
    doubleSided, smooth, wireframe
        As `Material` takes them.
    diffuseFactor : float, (3,) or (4,) array_like, optional
        Linear RGBA, whole numbers are shares of 255; default white.
    specularFactor : float or (3,) array_like, optional
        Linear RGB; kept and without effect.
    glossinessFactor : float
        In 0..1.
    diffuseTexture, specularGlossinessTexture : Texture, array or PIL.Image, optional
        The latter is kept and without effect.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong.
    """

    diffuseFactor: ColorField = _make_color_field(4, 1.0)
    diffuseTexture: Field[Texture | None] = _make_texture_field("RGBA")
    specularFactor: ColorField = _make_color_field(3, 1.0)
    glossinessFactor: Field[float] = Field(to_share, "float: 1 less the roughness.", 1.0)
    specularGlossinessTexture: Field[Texture | None] = _make_texture_field("GB")

    def _get_base(self) -> tuple[NDArray[np.float32], Texture | None]:
        return self.diffuseFactor, self.diffuseTexture

    def _list_flagged(self) -> list[tuple[TexFlags, Texture | None]]:
        return [
            *super()._list_flagged(),
            (TexFlags.DIFFUSE, self.diffuseTexture),
            (TexFlags.SPECULAR_GLOSSINESS, self.specularGlossinessTexture),
        ]

    def convert(
        self, *, has_uv: bool, is_lit: bool, is_culled: bool, least_alpha: float
    ) -> material.Material:
        """Return the metallic-roughness material nearest to it, as RasterJIT has that."""
        alike = MetallicRoughnessMaterial(
            self.name, self.normalTexture, self.occlusionTexture, self.emissiveTexture,
            self.emissiveFactor, self.alphaMode, self.alphaCutoff, self.doubleSided, self.smooth,
            self.wireframe, self.diffuseFactor, self.diffuseTexture, metallicFactor=0.0,
            roughnessFactor=1.0 - self.glossinessFactor,
        )  # fmt: skip
        return alike.convert(
            has_uv=has_uv, is_lit=is_lit, is_culled=is_culled, least_alpha=least_alpha
        )
