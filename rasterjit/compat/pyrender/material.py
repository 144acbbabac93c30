"""Metallic-roughness materials and their textures, as glTF has them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.compat.pyrender.constants import GLTF
from rasterjit.io.pictures import image_pixels
from rasterjit.scene import material
from rasterjit.scene.texture import Texture as SceneTexture
from rasterjit.scene.validation import bounded_number, finite_array, in_short, one_of

_WRAPS = {GLTF.REPEAT: "repeat", GLTF.CLAMP_TO_EDGE: "clamp", GLTF.MIRRORED_REPEAT: "mirror"}


class Sampler:
    """
    How a texture is read; takes glTF's codes.

    Parameters
    ----------
    name : str, optional
    magFilter, minFilter : int, optional
        ``GLTF.NEAREST`` for both shows texels; all else is filtered trilinearly.
    wrapS, wrapT : int

    Raises
    ------
    ValueError
        If a code is unknown.
    """

    def __init__(
        self,
        name: str | None = None,
        magFilter: int | None = None,
        minFilter: int | None = None,
        wrapS: int = GLTF.REPEAT,
        wrapT: int = GLTF.REPEAT,
    ) -> None:
        self.name = name
        self.magFilter, self.minFilter = magFilter, minFilter
        self.wrapS = one_of("wrapS", int(wrapS), [int(code) for code in _WRAPS])
        self.wrapT = one_of("wrapT", int(wrapT), [int(code) for code in _WRAPS])

    def _options(self) -> dict[str, Any]:
        """Return what RasterJIT's textures take."""
        is_nearest = self.magFilter == GLTF.NEAREST and self.minFilter in (None, GLTF.NEAREST)
        return {
            "wrap": (_WRAPS[GLTF(self.wrapS)], _WRAPS[GLTF(self.wrapT)]),
            "filter": "nearest" if is_nearest else "trilinear",
        }


class Texture:
    """
    A picture and how it is read.

    Parameters
    ----------
    name : str, optional
    sampler : Sampler, optional
    source : (H, W) or (H, W, C) array_like or PIL.Image
        Floats in 0..1 or bytes.
    source_channels : str, optional
        Such as ``"RGB"``; ``"R"`` and ``"GB"`` say which channels two maps are in.
    width, height : int, optional
        Taken and without effect: the source has a size.

    Raises
    ------
    ValueError
        If the source is no picture.
    """

    def __init__(
        self,
        name: str | None = None,
        sampler: Sampler | None = None,
        source: Any = None,
        source_channels: str | None = None,
        width: int | None = None,
        height: int | None = None,
    ) -> None:
        self.name = name
        self.sampler = Sampler() if sampler is None else sampler
        self.source_channels = source_channels
        self.source = source

    @property
    def source(self) -> NDArray[Any]:
        """(H, W) or (H, W, C) uint8: the picture."""
        return self._source

    @source.setter
    def source(self, value: Any) -> None:
        self._source = _pixels(value)
        self._drawn: dict[str, SceneTexture] = {}

    def drawn(self) -> SceneTexture:
        """Return the texture as RasterJIT has it; made once."""
        return self._made("as is", self.source)

    def drawn_as_facets(self) -> SceneTexture:
        """Return it with roughness and metallic, its first two channels, where glTF has them."""
        pixels = self.source
        if self.source_channels in (None, "GB") and pixels.shape[2:] in ((3,), (4,)):
            return self.drawn()
        pixels = pixels[..., None] if pixels.ndim == 2 else pixels
        rough, metal = pixels[..., 0], pixels[..., min(1, pixels.shape[2] - 1)]
        return self._made("as facets", np.dstack([np.zeros_like(rough), rough, metal]))

    def _made(self, how: str, pixels: NDArray[Any]) -> SceneTexture:
        if how not in self._drawn:
            self._drawn[how] = SceneTexture(pixels, color_space="linear", **self.sampler._options())
        return self._drawn[how]


class Material:
    """
    What all materials have.

    Parameters
    ----------
    name : str, optional
    normalTexture, occlusionTexture, emissiveTexture : Texture, array_like or PIL.Image, optional
    emissiveFactor : (3,) array_like, optional
        Linear RGB; default none.
    alphaMode : {"OPAQUE", "MASK", "BLEND"}
    alphaCutoff : float, optional
        Default 0.5.
    doubleSided : bool
        Whether back faces are drawn.
    smooth : bool
        Taken for meshes' sake and without effect by itself.
    wireframe : bool
        Whether edges are drawn in place of faces.

    Raises
    ------
    ValueError
        Naming what is wrong.
    """

    def __init__(
        self,
        name: str | None = None,
        normalTexture: Any = None,
        occlusionTexture: Any = None,
        emissiveTexture: Any = None,
        emissiveFactor: ArrayLike | None = None,
        alphaMode: str | None = None,
        alphaCutoff: float | None = None,
        doubleSided: bool = False,
        smooth: bool = True,
        wireframe: bool = False,
    ) -> None:
        self.name = name
        self.normalTexture = _texture(normalTexture)
        self.occlusionTexture = _texture(occlusionTexture)
        self.emissiveTexture = _texture(emissiveTexture)
        self.emissiveFactor = color_of(
            "emissiveFactor", np.zeros(3) if emissiveFactor is None else emissiveFactor, 3
        )
        self.alphaMode = one_of(
            "alphaMode", "OPAQUE" if alphaMode is None else alphaMode, ("OPAQUE", "MASK", "BLEND")
        )
        self.alphaCutoff = bounded_number(
            "alphaCutoff", 0.5 if alphaCutoff is None else alphaCutoff, 0.0, 1.0
        )
        self.doubleSided = bool(doubleSided)
        self.smooth, self.wireframe = smooth, wireframe


class MetallicRoughnessMaterial(Material):
    """
    A glTF 2.0 metallic-roughness material.

    Parameters
    ----------
    name, normalTexture, occlusionTexture, emissiveTexture, emissiveFactor, alphaMode, alphaCutoff,
    doubleSided, smooth, wireframe
        As `Material` takes them.
    baseColorFactor : (3,) or (4,) array_like, optional
        Linear RGBA, floats in 0..1 or bytes; default white.
    baseColorTexture, metallicRoughnessTexture : Texture, array_like or PIL.Image, optional
    metallicFactor, roughnessFactor : float
        In 0..1.

    Raises
    ------
    ValueError
        Naming what is wrong.
    """

    def __init__(
        self,
        name: str | None = None,
        normalTexture: Any = None,
        occlusionTexture: Any = None,
        emissiveTexture: Any = None,
        emissiveFactor: ArrayLike | None = None,
        alphaMode: str | None = None,
        alphaCutoff: float | None = None,
        doubleSided: bool = False,
        smooth: bool = True,
        wireframe: bool = False,
        baseColorFactor: ArrayLike | None = None,
        baseColorTexture: Any = None,
        metallicFactor: float | None = 1.0,
        roughnessFactor: float | None = 1.0,
        metallicRoughnessTexture: Any = None,
    ) -> None:
        super().__init__(
            name, normalTexture, occlusionTexture, emissiveTexture, emissiveFactor, alphaMode,
            alphaCutoff, doubleSided, smooth, wireframe,
        )  # fmt: skip
        self.baseColorFactor = color_of(
            "baseColorFactor", np.ones(4) if baseColorFactor is None else baseColorFactor, 4
        )
        self.baseColorTexture = _texture(baseColorTexture)
        self.metallicRoughnessTexture = _texture(metallicRoughnessTexture)
        self.metallicFactor = _share("metallicFactor", metallicFactor)
        self.roughnessFactor = _share("roughnessFactor", roughnessFactor)

    def drawn(
        self, *, has_uv: bool, is_lit: bool, is_culled: bool, least_alpha: float
    ) -> material.Material:
        """
        Return the material as RasterJIT has it.

        Parameters
        ----------
        has_uv : bool
            Whether the mesh has texture coordinates; without them there are no textures.
        is_lit : bool
            Whether light counts.
        is_culled : bool
            Whether back faces may be left out.
        least_alpha : float
            Of the mesh's colours.
        """
        maps = {
            "base_color_texture": self.baseColorTexture,
            "normal_texture": self.normalTexture,
            "metallic_roughness_texture": self.metallicRoughnessTexture,
            "occlusion_texture": self.occlusionTexture,
            "emissive_texture": self.emissiveTexture,
        }
        # Codes are filtered as they are; what they stand for is found behind that.
        textures = {
            field: texture.drawn()
            for field, texture in maps.items()
            if texture is not None and has_uv
        }
        if "metallic_roughness_texture" in textures:
            textures["metallic_roughness_texture"] = self.metallicRoughnessTexture.drawn_as_facets()
        picture = textures.get("base_color_texture")
        color = np.clip(np.asarray(self.baseColorFactor, np.float64), 0.0, 1.0)
        mode = "blend" if self.alphaMode == "BLEND" else "opaque"
        is_opaque = color[3] * least_alpha >= 1.0 and (picture is None or picture.is_opaque)
        if mode == "opaque" or (mode == "blend" and is_opaque):
            # What hides all behind it needs no layers.
            mode, color[3] = "opaque", 1.0
        return material.Material(
            "pbr" if is_lit else "unlit",
            color.tolist(),
            metallic=_share("metallicFactor", self.metallicFactor),
            roughness=_share("roughnessFactor", self.roughnessFactor),
            # The factor counts twice, as in pyrender's shader.
            emissive=np.square(np.asarray(self.emissiveFactor, np.float64)).tolist(),
            alpha_mode=mode,
            double_sided=self.doubleSided or not is_culled,
            **textures,
        )


def color_of(name: str, value: ArrayLike, channels: int) -> NDArray[np.float64]:
    """
    Return a colour as floats: one number is that of all channels, channels that are missing are 1.

    Whole numbers are shares of 255, 1 as well; floats are taken as they are.
    """
    array = np.asarray(value)
    if array.dtype.kind in "iu":
        array = array / 255.0
    if array.ndim == 0:
        array = np.repeat(array, channels)
    color = np.ones(channels)
    given = array[:channels]
    color[: len(given)] = finite_array(name, given, (len(given),))
    if array.ndim != 1 or not len(array) or color.min() < 0.0:
        raise ValueError(f"{name} must be a colour, got {in_short(value)}")
    return color


def _share(name: str, value: float | None) -> float:
    """Return a factor in 0..1, 1 where there is none."""
    return 1.0 if value is None else bounded_number(name, value, 0.0, 1.0)


def _texture(value: Any) -> Texture | None:
    """Return a texture, made of a picture if need be."""
    return value if value is None or isinstance(value, Texture) else Texture(source=value)


def _pixels(source: Any) -> NDArray[Any]:
    """Return a picture as bytes, or raise ``ValueError``."""
    if hasattr(source, "mode") and hasattr(source, "convert"):
        return image_pixels(source)
    pixels = np.asarray(source)
    if pixels.ndim not in (2, 3) or pixels.dtype.kind not in "uif" or pixels.size == 0:
        raise ValueError(f"source must be a picture, got {in_short(source)}")
    if pixels.dtype.kind == "f":
        pixels = np.clip(np.nan_to_num(pixels), 0.0, 1.0) * 255.0
    pixels = pixels.astype(np.uint8)
    return pixels[..., 0] if pixels.shape[2:] == (1,) else pixels
