"""
Convert trimesh's colours, materials and pictures to a mesh's colours, uv, `Material` and textures.

`TextureReader` turns the pictures of trimesh's materials into textures.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.gltf.content import TEXTURES
from rasterjit.io.pictures import image_pixels, take_texels
from rasterjit.io.skipped import LeftOut, reason_of
from rasterjit.io.text.mtl import MOST_SHININESS, MtlMaterial, material_from_mtl
from rasterjit.io.text.parts import linear_rgba
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.light import BRIGHTEST
from rasterjit.scene.material import AlphaMode, Material
from rasterjit.scene.memory import MemoryBudget
from rasterjit.scene.texture import ColorSpace, Texture

ALPHA_MODES: dict[str, AlphaMode] = {"MASK": "mask", "BLEND": "blend"}

_DIELECTRIC = 0.04
"""Reflectance of a non-metal seen head-on, as glTF 2.0 fixes it (appendix B)."""

_PLACEHOLDER = (100, 100, 100, 255)
"""The colour of the 2×2 pixels that trimesh puts where a material has no picture."""


def material_from_trimesh(
    material: Any,
    is_gltf: bool,
    left_out: LeftOut,
    textures: TextureReader | None = None,
) -> Material | None:
    """
    Translate a material as trimesh has it.

    Parameters
    ----------
    material : trimesh.visual.material.Material
    is_gltf : bool
        Whether a PBR material is one as glTF has them, or, as in COLLADA, another model's values
        under its names: then its factors are sRGB, and it becomes Blinn-Phong.
    left_out : LeftOut
        Notes what is not shown.
    textures : TextureReader, optional

    Returns
    -------
    Material or None
        None for a kind that says nothing.
    """
    kind = type(material).__name__
    textures = TextureReader(left_out) if textures is None else textures
    label = f"material {material.name!r}"
    if kind == "SimpleMaterial":
        texture = textures.read(material.image, f"base_color_texture of {label}")
        said = MtlMaterial(
            material.name, material.diffuse, material.specular, material.glossiness, material.kwargs
        )
        return material_from_mtl(said, texture, False, left_out)
    if kind == "PBRMaterial":
        found = {
            field: textures.read(getattr(material, name, None), f"{field} of {label}", color_space)
            for field, (name, color_space) in TEXTURES.items()
        }
        return _from_gltf(material, found) if is_gltf else _from_pbr(material, found, left_out)
    left_out.note(kind)
    return None


def colors_from_trimesh(
    mesh: Any, linear_bytes: bool, left_out: LeftOut
) -> NDArray[np.float32] | None:
    """
    Return a trimesh's vertex or face colours as linear RGBA.

    Parameters
    ----------
    mesh : trimesh.Trimesh
    linear_bytes : bool
        Whether the bytes are linear light, as in glTF, or sRGB, as elsewhere.
    left_out : LeftOut
        Notes colours whose number fits neither vertices nor faces.

    Returns
    -------
    (V, 4) or (F, 4) float32, or None
    """
    visual = mesh.visual
    if visual.kind in ("vertex", "face"):
        colors = getattr(visual, f"{visual.kind}_colors")
        rows = len(mesh.vertices) if visual.kind == "vertex" else len(mesh.faces)
    else:
        attributes = getattr(visual, "vertex_attributes", None)
        colors = None if attributes is None else attributes.get("color")
        rows = len(mesh.vertices)
    if colors is None:
        return None
    colors = np.asarray(colors)
    if colors.ndim != 2 or colors.shape[0] != rows or colors.shape[1] not in (3, 4):
        left_out.note("colours that fit neither vertices nor faces")
        return None
    return linear_rgba(colors, linear_bytes)


def _from_gltf(material: Any, textures: dict[str, Any]) -> Material:
    """Return a metallic-roughness material of glTF as one of ours."""
    mode = ALPHA_MODES.get(material.alphaMode, "opaque")
    red, green, blue, alpha = _base_color(material, True)
    cutoff = 0.5 if material.alphaCutoff is None else material.alphaCutoff
    emitted = (0.0, 0.0, 0.0) if material.emissiveFactor is None else material.emissiveFactor
    return Material(
        shading="pbr",
        base_color=(red, green, blue, 1.0 if mode == "opaque" else alpha),
        metallic=_share(material.metallicFactor),
        roughness=_share(material.roughnessFactor),
        emissive=np.clip(np.nan_to_num(np.asarray(emitted, np.float64)), 0.0, BRIGHTEST),
        name=material.name,
        alpha_mode=mode,
        alpha_cutoff=min(max(float(cutoff), 0.0), 1.0),
        double_sided=bool(material.doubleSided),
        **textures,
    )


def _base_color(material: Any, linear_bytes: bool) -> tuple[float, float, float, float]:
    """Return the base colour of a PBR material, linear RGBA."""
    factor = material.baseColorFactor
    if factor is None:
        return (1.0, 1.0, 1.0, 1.0)
    rgba = (np.asarray(factor, dtype=np.float64) / 255.0).tolist()
    if not linear_bytes:
        rgba[:3] = srgb_to_linear(np.asarray(factor, dtype=np.uint8)[:3]).tolist()
    return tuple(rgba)


def _share(factor: float | None) -> float:
    """Return a factor of a PBR material, 1 where there is none, clamped to 0..1."""
    return 1.0 if factor is None else min(max(float(factor), 0.0), 1.0)


def _from_pbr(material: Any, textures: dict[str, Any], left_out: LeftOut) -> Material:
    """
    Translate a metallic-roughness material, its colours in sRGB, to Blinn-Phong.

    With roughness r, the microfacet width is α = r², the exponent n = 2/α² - 2, limited to
    1..1000. The strength is ``min(1, F0 (n + 8) / 8)``, the height of the normalised lobe over
    reflectance F0. That is 0.04, and for metals goes to the mean base colour as far as they are
    smooth: ``F0 = 0.04 + (mean - 0.04) metallic (1 - r)``. (A rough metal's lobe is so wide that
    Blinn-Phong would only wash its colour out.)

    References
    ----------
    B. Walter et al., "Microfacet models for refraction through rough surfaces", EGSR 2007.
    T. Akenine-Möller et al., "Real-Time Rendering", 4th edition, section 9.8.
    """
    rgba = _base_color(material, False)
    mode = ALPHA_MODES.get(material.alphaMode, "opaque")
    if mode == "opaque":
        rgba = (*rgba[:3], 1.0)
    emitted = (0.0, 0.0, 0.0) if material.emissiveFactor is None else material.emissiveFactor
    if textures["metallic_roughness_texture"] is not None:
        left_out.note(f"metallic_roughness_texture of material {material.name!r}")
    roughness, metallic = _share(material.roughnessFactor), _share(material.metallicFactor)
    shininess = MOST_SHININESS
    # A power is the math library's affair; products have the same bits everywhere.
    alpha = roughness * roughness
    if alpha * alpha > 0.0:
        shininess = min(max(2.0 / (alpha * alpha) - 2.0, 1.0), MOST_SHININESS)
    mean = sum(rgba[:3]) / 3.0
    reflectance = _DIELECTRIC + (mean - _DIELECTRIC) * metallic * (1.0 - roughness)
    return Material(
        base_color=rgba,
        specular=min(1.0, max(0.0, reflectance) * (shininess + 8.0) / 8.0),
        shininess=shininess,
        name=material.name,
        emissive=np.clip(np.nan_to_num(np.asarray(emitted, np.float64)), 0.0, BRIGHTEST),
        alpha_mode=mode,
        **{**textures, "metallic_roughness_texture": None},
    )


class TextureReader:
    """
    Read the pictures of trimesh's materials, each once for every use.

    They say nothing about sampling: they repeat, trilinear.

    Parameters
    ----------
    left_out : LeftOut
        Notes pictures that cannot be read.
    budget : MemoryBudget, optional
        Counts the texels of pictures that are yet to be decoded.
    """

    def __init__(self, left_out: LeftOut, budget: MemoryBudget | None = None) -> None:
        self._left_out = left_out
        self._budget = budget
        self._known: dict[tuple[int, str], Texture | None] = {}

    def read(self, image: Any, label: str, color_space: ColorSpace = "srgb") -> Texture | None:
        """Return a Pillow image as a texture; None if there is none to show."""
        if image is None or is_placeholder(image):
            return None
        key = id(image), color_space
        if key not in self._known:
            try:
                if self._budget is not None:
                    take_texels(image.size, label, self._budget)
                self._known[key] = Texture(image_pixels(image), color_space=color_space)
            except (OSError, SyntaxError, ValueError, AttributeError) as error:
                self._left_out.note(f"{label} that cannot be read: {reason_of(error)}")
                self._known[key] = None
        return self._known[key]


def is_placeholder(image: Any) -> bool:
    """Tell trimesh's stand-in for a missing image from a real one."""
    if getattr(image, "size", (2, 2)) != (2, 2):
        # Looking at it would decode it.
        return False
    try:
        pixels = np.asarray(image)
    except (OSError, SyntaxError):
        return False
    return pixels.shape == (2, 2, 4) and bool((pixels == _PLACEHOLDER).all())
