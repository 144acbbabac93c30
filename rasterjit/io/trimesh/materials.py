"""
Convert trimesh's colours, materials and pictures to a mesh's colours, uv, `Material` and textures.

`TextureReader` turns the pictures of trimesh's materials into textures. Where it is in doubt,
trimesh drops what MTL files [1]_ say about pictures, so `MtlPictures` reads it from these files.

References
----------
.. [1] Wavefront Technologies, "Object Files (.obj)" and "MTL material format", version 4.2, 1995.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.pictures import image_pixels, picture_pixels, resized, take_texels
from rasterjit.io.resources import RefusedFileError, Resources, shown_name
from rasterjit.io.skipped import LeftOut, reason_of
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.material import BRIGHTEST_EMISSION, Material
from rasterjit.scene.memory import MemoryBudget
from rasterjit.scene.texture import Texture

_TRIMESH_GREY = (102, 102, 102, 255)
"""The colour that trimesh gives a material whose file names none."""

TEXTURES = {
    "base_color_texture": ("baseColorTexture", "srgb"),
    "normal_texture": ("normalTexture", "linear"),
    "metallic_roughness_texture": ("metallicRoughnessTexture", "linear"),
    "occlusion_texture": ("occlusionTexture", "linear"),
    "emissive_texture": ("emissiveTexture", "srgb"),
}
"""What a field of `Material` is called by trimesh, and what the numbers of its picture are."""

ALPHA_MODES = {"MASK": "mask", "BLEND": "blend"}

_DIELECTRIC = 0.04
"""Reflectance of a non-metal seen head-on, as glTF 2.0 fixes it (appendix B)."""

_MOST_SHININESS = 1000.0
"""Largest exponent: a highlight of about two degrees, which pixels still resolve."""

_PLACEHOLDER = (100, 100, 100, 255)
"""The colour of the 2×2 pixels that trimesh puts where a material has no picture."""

_STATEMENT = re.compile(rb"^[ \t]*(mtllib|usemtl)[ \t]+(.*?)[ \t\r]*$", re.MULTILINE)

_MAPS = ("map_kd", "map_d")
"""Pictures that are shown: of the colour, and of the opacity."""

_COMMENT_LENGTH = 400
"""Characters of an MTL file among which its writer is named."""

_OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-bm": 1, "-boost": 1,
    "-texres": 1, "-mm": 2, "-o": 3, "-s": 3, "-t": 3,
}  # fmt: skip
"""Options before the name of a picture, and how many words follow each at most."""


def material_from_trimesh(
    material: Any,
    is_gltf: bool,
    left_out: LeftOut,
    textures: TextureReader | None = None,
    pictures: MtlPictures | None = None,
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
    pictures : MtlPictures, optional
        Those of an OBJ file, which then count instead of trimesh's.

    Returns
    -------
    Material or None
        None for a kind that says nothing.
    """
    kind = type(material).__name__
    textures = TextureReader(left_out) if textures is None else textures
    label = f"material {material.name!r}"
    if kind == "SimpleMaterial":
        if pictures is not None:
            has_opacity = pictures.has_opacity(material.name)
            return _from_simple(
                material, pictures.texture(material.name), has_opacity, left_out,
                pictures.tr_is_opacity,
            )  # fmt: skip
        texture = textures.read(material.image, f"base_color_texture of {label}")
        return _from_simple(material, texture, False, left_out)
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
    return rgba


def _from_simple(
    material: Any,
    texture: Texture | None,
    has_opacity: bool,
    left_out: LeftOut,
    tr_is_opacity: bool = False,
) -> Material:
    """
    Translate an OBJ-style material.

    ``Kd`` and ``Ks`` are sRGB, ``Ns`` is the Blinn-Phong exponent, where 1 or less is no highlight;
    the strength of the highlight is the mean of ``Ks``. What the file does not say keeps the
    engine's defaults.
    """
    said = material.kwargs
    default = Material(base_color_texture=texture)
    color = default.base_color
    if "kd" in said or tuple(material.diffuse) != _TRIMESH_GREY:
        rgb = srgb_to_linear(np.asarray(material.diffuse, dtype=np.uint8)[:3])
        color = (*rgb.tolist(), float(material.diffuse[3]) / 255.0)
    opacity = _opacity(said, tr_is_opacity)
    alpha = color[3] * opacity
    if texture is not None and not texture.is_opaque and not has_opacity:
        left_out.note(f"alpha of the map_Kd of material {material.name!r}, which has no map_d")
    specular, shininess = default.specular, default.shininess
    if "ks" in said:
        ks = np.asarray(material.specular, dtype=np.uint8)[:3]
        specular = float(srgb_to_linear(ks).mean())
    if "ns" in said:
        shininess = min(max(material.glossiness, 1.0), _MOST_SHININESS)
        if material.glossiness <= 1.0:
            # Exporters write 0 for no highlight; an exponent of 1 would wash over the whole object.
            specular = 0.0
    return Material(
        base_color=(*color[:3], alpha),
        alpha_mode="blend" if alpha < 1.0 or has_opacity else "opaque",
        specular=specular,
        shininess=shininess,
        name=material.name,
        base_color_texture=texture,
    )


def _opacity(said: dict[str, Any], tr_is_opacity: bool) -> float:
    """Return the opacity that ``d`` of an MTL file gives, or ``Tr``, which most write as 1 - d."""
    try:
        if "d" in said:
            opacity = float(said["d"][-1])
        elif "tr" in said:
            opacity = float(said["tr"][-1])
            opacity = opacity if tr_is_opacity else 1.0 - opacity
        else:
            return 1.0
    except (TypeError, ValueError, IndexError):
        return 1.0
    return min(max(opacity, 0.0), 1.0)


def _from_gltf(material: Any, textures: dict[str, Texture | None]) -> Material:
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
        emissive=np.clip(np.nan_to_num(np.asarray(emitted, np.float64)), 0.0, BRIGHTEST_EMISSION),
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


def _from_pbr(material: Any, textures: dict[str, Texture | None], left_out: LeftOut) -> Material:
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
    shininess = _MOST_SHININESS
    # A power is the math library's affair; products have the same bits everywhere.
    alpha = roughness * roughness
    if alpha * alpha > 0.0:
        shininess = min(max(2.0 / (alpha * alpha) - 2.0, 1.0), _MOST_SHININESS)
    mean = sum(rgba[:3]) / 3.0
    reflectance = _DIELECTRIC + (mean - _DIELECTRIC) * metallic * (1.0 - roughness)
    return Material(
        base_color=rgba,
        specular=min(1.0, max(0.0, reflectance) * (shininess + 8.0) / 8.0),
        shininess=shininess,
        name=material.name,
        emissive=np.clip(np.nan_to_num(np.asarray(emitted, np.float64)), 0.0, BRIGHTEST_EMISSION),
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

    def read(self, image: Any, label: str, color_space: str = "srgb") -> Texture | None:
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
                reason = " ".join(str(error).split())[:200]
                self._left_out.note(f"{label} that cannot be read: {reason}")
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


class MtlPictures:
    """
    The pictures of an OBJ file's materials.

    Parameters
    ----------
    path : Path
        Of the OBJ file.
    resources : Resources
        The files that it may name.
    left_out : LeftOut
        Notes pictures that are missing or damaged, MTL files that may not be opened, and materials
        that no MTL file has.
    """

    def __init__(self, path: Path, resources: Resources, left_out: LeftOut) -> None:
        self._resources = resources
        self._left_out = left_out
        self._names: dict[str, dict[str, str]] = {}
        self._is_from_meshlab = False
        self._opacities: dict[str, dict[str, str]] = {}
        self._textures: dict[tuple[str | None, ...], Texture | None] = {}
        used: dict[str, None] = {}
        for kind, rest in _STATEMENT.findall(path.read_bytes()):
            text = rest.decode("utf-8", "replace")
            if kind == b"usemtl":
                used[text] = None
            else:
                self._read_library(text)
        for name in used:
            if name not in self._names:
                left_out.note(f"reference to material {name!r}, which no MTL file of it has")
        # MeshLab writes ``Tr 1`` for opaque surfaces, where others mean invisible ones. A file of
        # which nothing would be seen is taken as MeshLab's.
        said = [self._opacities.get(name, {}) for name in used]
        self.tr_is_opacity = self._is_from_meshlab or (
            bool(said) and all("d" not in one and _is_one(one.get("tr")) for one in said)
        )

    def _read_library(self, name: str) -> None:
        """Keep the names of pictures in an MTL file; one that is missing gives none."""
        try:
            text = self._resources.read(name).decode("utf-8", "replace")
        except RefusedFileError as error:
            self._left_out.note(f"MTL file: {reason_of(error)}")
            return
        except ValueError:
            return
        self._is_from_meshlab |= "meshlab" in text[:_COMMENT_LENGTH].lower()
        material: dict[str, str] = {}
        opacity: dict[str, str] = {}
        for line in text.splitlines():
            words = line.split()
            key = words[0].lower() if words else ""
            if key == "newmtl":
                name = " ".join(words[1:])
                material = self._names.setdefault(name, {})
                opacity = self._opacities.setdefault(name, {})
            elif key in _MAPS:
                material[key] = picture_name(words[1:])
            elif key in ("d", "tr"):
                opacity[key] = words[-1]

    def texture(self, material: str | None) -> Texture | None:
        """Return the texture of a material: colour and opacity in one; None if it has none."""
        names = self._names.get(material, {}) if material is not None else {}
        key = tuple(names.get(kind) for kind in _MAPS)
        if key not in self._textures:
            self._textures[key] = self._join(names, f"material {material!r}")
        return self._textures[key]

    def has_opacity(self, material: str | None) -> bool:
        """Return whether a picture says how opaque a material is."""
        return material is not None and "map_d" in self._names.get(material, {})

    def _join(self, names: dict[str, str], label: str) -> Texture | None:
        """Return a texture of the pictures that can be read."""
        color = self._pixels(names.get("map_kd"), "map_Kd", label)
        opacity = self._pixels(names.get("map_d"), "map_d", label)
        if opacity is None:
            return None if color is None else Texture(color)
        # Grey counts, or else alpha: a picture in colour with alpha is the same as map_Kd.
        alpha = opacity if opacity.ndim == 2 else opacity[..., -1 if opacity.shape[2] > 3 else 0]
        alpha = alpha if alpha.dtype == np.uint8 else (alpha >> 8).astype(np.uint8)
        if color is None:
            color = np.full((*alpha.shape, 3), 255, np.uint8)
        if color.dtype != np.uint8:
            color = (color >> 8).astype(np.uint8)
        color = color[..., np.newaxis] if color.ndim == 2 else color
        red_green_blue = color[..., :3] if color.shape[2] >= 3 else np.repeat(color[..., :1], 3, 2)
        alpha = resized(alpha, (color.shape[1], color.shape[0]))
        return Texture(np.dstack([red_green_blue, alpha]))

    def _pixels(self, name: str | None, key: str, label: str) -> NDArray[Any] | None:
        """Return a picture's pixels; None, with a note if it has a name and cannot be read."""
        if name is None:
            return None
        try:
            content = self._resources.read(name)
            return picture_pixels(content, f"picture {shown_name(name)}", self._resources.budget)
        except Exception as error:
            # Pillow raises what it likes about a damaged picture.
            self._left_out.note(
                f"{key} of {label}, {shown_name(name)}, that cannot be read: {reason_of(error)}"
            )
            return None


def _is_one(text: str | None) -> bool:
    """Tell the number 1 in an MTL file."""
    try:
        return text is not None and float(text) == 1.0
    except ValueError:
        return False


def picture_name(words: list[str]) -> str:
    """
    Return the name of a picture, which may have blanks, behind its options.

    An option takes up to three numbers; what is none belongs to the name.
    """
    at = 0
    while at < len(words) and words[at] in _OPTIONS:
        most, at = at + 1 + _OPTIONS[words[at]], at + 1
        while at < min(most, len(words) - 1) and _is_option_value(words[at]):
            at += 1
    return " ".join(words[at:])


def _is_option_value(word: str) -> bool:
    """Tell a number or a switch from the beginning of a name."""
    return word in ("on", "off", "r", "g", "b", "m", "l", "z") or bool(
        re.fullmatch(r"[-+]?[0-9.]+(e[-+]?[0-9]+)?", word)
    )
