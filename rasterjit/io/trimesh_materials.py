"""Turn trimesh's colours and materials into a mesh's colours, uv and `Material`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.left_out import LeftOut
from rasterjit.io.trimesh_textures import TextureReader
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.material import Material
from rasterjit.scene.texture import Texture

_TRIMESH_GREY = (102, 102, 102, 255)
"""The colour that trimesh gives a material whose file names none."""

_UNREAD_TEXTURES = (
    "metallicRoughnessTexture",
    "normalTexture",
    "occlusionTexture",
    "emissiveTexture",
)
_DIELECTRIC = 0.04
"""Reflectance of a non-metal seen head-on, as glTF 2.0 fixes it (appendix B)."""

_MOST_SHININESS = 1000.0
"""Largest exponent: a highlight of about two degrees, which pixels still resolve."""


def material_from_trimesh(
    material: Any,
    linear_bytes: bool,
    unlit: set[str | None],
    left_out: LeftOut,
    textures: TextureReader | None = None,
) -> Material | None:
    """
    Translate a material as trimesh read it.

    Parameters
    ----------
    material : trimesh.visual.material.Material
    linear_bytes : bool
        Whether the factors of a PBR material are linear light, as in glTF, or sRGB, as in COLLADA.
    unlit : set of str or None
        Names of the materials to show without light.
    left_out : LeftOut
        Notes texture images of other kinds than base colour, transparency and emission, which are
        not shown.
    textures : TextureReader, optional
        Reads the base-colour textures; default: one that knows of no samplers.

    Returns
    -------
    Material or None
        None for a kind that says nothing.
    """
    kind = type(material).__name__
    images = [getattr(material, name, None) for name in _UNREAD_TEXTURES]
    left_out_images = sum(image is not None for image in images)
    if left_out_images:
        left_out.note("texture image", left_out_images)
    textures = TextureReader({}, left_out) if textures is None else textures
    if kind == "SimpleMaterial":
        texture = textures.read(material.image, material.name)
        return _from_simple(material, texture, left_out)
    if kind == "PBRMaterial":
        texture = textures.read(material.baseColorTexture, material.name)
        return _from_pbr(material, texture, linear_bytes, unlit, left_out)
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
        Notes transparency and colours whose number fits neither vertices nor faces.

    Returns
    -------
    (V, 4) or (F, 4) float32, or None
    """
    visual = mesh.visual
    if visual.kind in ("vertex", "face"):
        colors = np.asarray(getattr(visual, f"{visual.kind}_colors"))
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
    rgba = np.ones((len(colors), 4), dtype=np.float32)
    if colors.dtype == np.uint8 and not linear_bytes:
        rgba[:, :3] = srgb_to_linear(colors[:, :3])
        rgba[:, 3:] = colors[:, 3:] / np.float32(255.0)
    else:
        most = 1.0 if colors.dtype.kind == "f" else float(np.iinfo(colors.dtype).max)
        rgba[:, : colors.shape[1]] = np.clip(np.nan_to_num(colors / most), 0.0, 1.0)
    if rgba[:, 3].min() < 1.0:
        left_out.note("transparency of colours")
    return rgba


def _from_simple(material: Any, texture: Texture | None, left_out: LeftOut) -> Material:
    """
    Translate an OBJ-style material.

    ``Kd`` and ``Ks`` are sRGB, ``Ns`` is the Blinn-Phong exponent, where 1 or less is matt;
    the strength of the highlight is the mean of ``Ks``. What the file does not say keeps the
    engine's defaults.
    """
    said = material.kwargs
    default = Material(base_color_texture=texture)
    color = default.base_color
    if "kd" in said or tuple(material.diffuse) != _TRIMESH_GREY:
        rgb = srgb_to_linear(np.asarray(material.diffuse, dtype=np.uint8)[:3])
        color = (*rgb.tolist(), float(material.diffuse[3]) / 255.0)
    opacity = _opacity(said)
    if opacity < 1.0 or color[3] < 1.0:
        left_out.note("transparency of a material")
    if texture is not None and not texture.is_opaque:
        left_out.note("transparency of a texture image")
    specular, shininess = default.specular, default.shininess
    if "ks" in said:
        ks = np.asarray(material.specular, dtype=np.uint8)[:3]
        specular = float(srgb_to_linear(ks).mean())
    if "ns" in said:
        shininess = min(max(material.glossiness, 1.0), _MOST_SHININESS)
        if material.glossiness <= 1.0:
            # Exporters write 0 for matt; an exponent of 1 would wash over the whole object.
            specular = 0.0
    return Material(
        base_color=(*color[:3], color[3] * opacity),
        specular=specular,
        shininess=shininess,
        name=material.name,
        base_color_texture=texture,
    )


def _opacity(said: dict[str, Any]) -> float:
    """Return the opacity that an MTL's ``d`` (or its inverse ``Tr``) gives, 1 if none."""
    try:
        if "d" in said:
            opacity = float(said["d"][-1])
        else:
            opacity = 1.0 - float(said.get("tr", [0.0])[-1])
    except (TypeError, ValueError, IndexError):
        return 1.0
    return min(max(opacity, 0.0), 1.0)


def _from_pbr(
    material: Any,
    texture: Texture | None,
    linear_bytes: bool,
    unlit: set[str | None],
    left_out: LeftOut,
) -> Material:
    """
    Translate a metallic-roughness material to Blinn-Phong.

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
    factor = material.baseColorFactor
    rgba = (1.0, 1.0, 1.0, 1.0)
    if factor is not None:
        rgba = tuple((np.asarray(factor, dtype=np.float64) / 255.0).tolist())
        if not linear_bytes:
            rgb = srgb_to_linear(np.asarray(factor, dtype=np.uint8)[:3])
            rgba = (*rgb.tolist(), rgba[3])
    if material.alphaMode in (None, "OPAQUE"):
        rgba = (*rgba[:3], 1.0)
    if material.alphaMode in ("MASK", "BLEND"):
        left_out.note("transparency of a material")
    if material.emissiveFactor is not None and material.emissiveFactor.max() > 0.0:
        left_out.note("emission of a material")
    roughness = 1.0 if material.roughnessFactor is None else material.roughnessFactor
    metallic = 1.0 if material.metallicFactor is None else material.metallicFactor
    roughness, metallic = min(max(roughness, 0.0), 1.0), min(max(metallic, 0.0), 1.0)
    shininess = _MOST_SHININESS
    # A power is the math library's affair; products have the same bits everywhere.
    alpha = roughness * roughness
    if alpha * alpha > 0.0:
        shininess = min(max(2.0 / (alpha * alpha) - 2.0, 1.0), _MOST_SHININESS)
    mean = sum(rgba[:3]) / 3.0
    reflectance = _DIELECTRIC + (mean - _DIELECTRIC) * metallic * (1.0 - roughness)
    return Material(
        shading="unlit" if material.name in unlit else "phong",
        base_color=rgba,
        specular=min(1.0, max(0.0, reflectance) * (shininess + 8.0) / 8.0),
        shininess=shininess,
        name=material.name,
        base_color_texture=texture,
    )
