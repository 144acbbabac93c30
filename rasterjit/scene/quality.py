"""Accuracy settings of rendering, and presets of them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from rasterjit.scene import validation as check
from rasterjit.scene.attribute_guard import store, suggests_replace

SubpixelBits: TypeAlias = Literal[0, 4, 8, 12]
Samples: TypeAlias = Literal[1, 2, 4, 8, 16, "area", 64, 256]
Interpolation: TypeAlias = Literal["affine", "perspective"]
DepthFormat: TypeAlias = Literal["unorm16", "unorm24", "float32", "float32-reversed", "float64"]
Precision: TypeAlias = Literal["float32", "float64"]
FinestShading: TypeAlias = Literal["face", "vertex", "pixel"]
TextureFilter: TypeAlias = Literal[
    "nearest", "bilinear", "trilinear", "anisotropic2", "anisotropic4", "anisotropic8",
    "anisotropic16",
]  # fmt: skip
ShadowTaps: TypeAlias = Literal[1, 9]
TransparencyLayers: TypeAlias = Literal[1, 2, 4, 8, "all"]
Blending: TypeAlias = Literal["srgb8", "linear"]
TextureMixing: TypeAlias = Literal["srgb8", "linear"]
Lines: TypeAlias = Literal["bresenham", "coverage"]
InterpolationPrecision: TypeAlias = Literal["adaptive", "float64"]

LEVELS: dict[str, tuple[Any, ...]] = {
    "subpixel_bits": get_args(SubpixelBits),
    "samples": get_args(Samples),
    "interpolation": get_args(Interpolation),
    "depth_format": get_args(DepthFormat),
    "precision": get_args(Precision),
    "shading": get_args(FinestShading),
    "renormalize": (False, True),
    "texture_filter": get_args(TextureFilter),
    "shadow_size": (256, 512, 1024, 2048, 4096, 8192),
    "shadow_taps": get_args(ShadowTaps),
    "transparency_layers": get_args(TransparencyLayers),
    "blending": get_args(Blending),
    "texture_mixing": get_args(TextureMixing),
    "lines": get_args(Lines),
    "interpolation_precision": get_args(InterpolationPrecision),
}
"""The settings of `Quality`, each with its levels, from the least accurate one on."""

SUPERSAMPLED = (64, 256)
"""Numbers of samples that are drawn as several whole pictures and averaged."""

MIN_SHADOW, MAX_SHADOW = 16, 8192
"""Side of a shadow map, texels."""


@suggests_replace
@dataclass(frozen=True)
class Quality:
    """
    How accurately to render; ``dataclasses.replace`` changes single settings.

    Parameters
    ----------
    subpixel_bits : {0, 4, 8, 12}
        Vertices are rounded to ``2**-subpixel_bits`` pixel. 8 is what Direct3D requires and what
        Mesa's rasterizer uses; 0 rounds to whole pixels, as in the classic exercise.
    samples : {1, 2, 4, 8, 16, "area", 64, 256}
        What smooths edges: the nearest faces at so many places of each pixel, those that Direct3D
        and Vulkan fix, or ``"area"``, the exact limit of ever more of them: the areas that faces
        show of it. Each face is shaded once in a pixel, at its centre, or on the face where the
        centre lies beside it. With 64 and 256 every sample is shaded by itself: whole pictures
        are drawn, moved by parts of a pixel, and averaged; textures are filtered for the distance
        of samples, not of pixels. Colour is mixed in linear light, before
        tone mapping; all other outputs come from the pixel centre. ``"area"`` is not for scenes
        that show blended materials (``alpha_mode`` "blend" with an alpha below 1): rendering them
        raises ``ValueError``, naming an object that has one. Edges of the holes of an alpha mask
        are smoothed as all others with 2 to 16 samples, each of which has its own alpha; with
        ``"area"`` a face has one alpha in a pixel, at its centre, so they stay hard.
    interpolation : {"affine", "perspective"}
        What lies between the vertices of a face: linear on the screen, as consoles without a
        divider drew it, or linear on the face. Faces that cross the near or far plane, or reach
        far beside the image, are interpolated on the face always. Depth and shadow maps are not
        touched by it.
    depth_format : {"unorm16", "unorm24", "float32", "float32-reversed", "float64"}
        What the depths of faces are rounded to before they are compared: 16 or 24 bits, or a
        float, of the depth from 0 at the near plane to 1 at the far one; a float of the reversed
        depth, which falls with distance and so keeps its digits; or such a float64. What comes out
        equal shows the face with the lower number. The depth output has the steps of the format;
        shadows, ambient occlusion, eye-dome lighting, outlines and hidden lines take the depth of
        the face that was found. Shadow maps are float32 always, and the areas of
        ``samples="area"`` are those of depths that were not rounded.
    precision : {"float32", "float64"}
        Arithmetic that takes vertices from model space to the screen, by way of the eye; the
        matrices are found in float64. In float32 the vertices take half the memory, and those
        beyond 1e18 in clip space are left out. Shadow maps keep float64, and points that are no
        triangles are taken there in float64 from positions rounded to float32.
    shading : {"face", "vertex", "pixel"}
        The finest unit that is lit by itself: materials that ask for more are shaded like
        ``"flat"`` or ``"gouraud"`` ones. Metallic-roughness is lit by the pixel always.
    renormalize : bool
        Whether interpolated normals are scaled to length one at every pixel. If not, they are too
        short between vertices that differ, and lit less. Under normal maps, and where an object
        in view is scaled unevenly, they are scaled all the same.
    texture_filter : str, optional
        ``"nearest"``, ``"bilinear"``, ``"trilinear"``, ``"anisotropic2"`` .. ``"anisotropic16"``,
        for all textures. Default: what each texture says.
    shadow_size : int, optional
        Side of all shadow maps, texels, 16..8192. Default: what each light says.
    shadow_taps : {1, 9}, optional
        Comparisons with a shadow map: one, or 3 x 3 filtered ones. Default: what each light says.
    transparency_layers : {1, 2, 4, 8, "all"}
        How many of the nearest transparent surfaces are seen at a sample, by depth: those behind
        them are not shaded, and what is opaque is seen through them. With ``"all"`` more than 4096
        behind each other are an error.
    blending : {"srgb8", "linear"}
        What transparent surfaces, samples and smooth lines are mixed in: 8-bit sRGB
        codes, as old programs do it, or light. With codes every colour is tone mapped and rounded
        to 8 bits by itself, alpha as well, and so is what comes of laying one over another; the
        output ``"linear"`` is then what the codes stand for. Where a frame mixes nothing it has
        the same bits either way.
    texture_mixing : {"srgb8", "linear"}
        What textures are mixed in on unlit objects that are opaque all over, without holes, and
        have no colours of vertices, faces or scalars: 8-bit sRGB codes, as old programs do it, or
        light. With codes texture coordinates are float32, texels are mixed with weights of 8 bits,
        and the base colour multiplies codes; light above 1 is cut off. Textures with mip levels,
        and all other objects, take light always.
    lines : {"bresenham", "coverage"}
        Edges of a wireframe, outlines and section lines: whole pixels, those of a wireframe one
        after the other between the pixels that hold the vertices; or smooth, by the area of each
        pixel that a line covers, at any number of samples.
    interpolation_precision : {"adaptive", "float64"}
        Arithmetic that finds colours between those of vertices. ``"adaptive"`` takes float32 in
        scenes of unlit objects alone, with no texture and none blended, in view or not, with 1, 64
        or 256 ``samples``: it moves each colour by at most a millionth of itself. All else takes
        float64 always.

    visible_alpha : float
        Where the alpha of a blended surface is below this, 0..1, the surface is not hit: depth,
        ids, normals, coverage and all outputs but the colours show what lies behind it. Default 0:
        the nearest surface counts, however clear. Colours stay what they are. Alpha is that of
        material, colours and texture; that of a colour map of scalars does not count.

    Raises
    ------
    ValueError
        If a setting is not one of its levels, or a number out of range.
    """

    subpixel_bits: SubpixelBits = 8
    samples: Samples = 1
    interpolation: Interpolation = "perspective"
    depth_format: DepthFormat = "float32-reversed"
    precision: Precision = "float64"
    shading: FinestShading = "pixel"
    renormalize: bool = True
    texture_filter: TextureFilter | None = None
    shadow_size: int | None = None
    shadow_taps: ShadowTaps | None = None
    transparency_layers: TransparencyLayers = "all"
    blending: Blending = "linear"
    texture_mixing: TextureMixing = "linear"
    lines: Lines = "bresenham"
    interpolation_precision: InterpolationPrecision = "adaptive"
    visible_alpha: float = 0.0

    def __post_init__(self) -> None:
        store(
            self, visible_alpha=check.bounded_number("visible_alpha", self.visible_alpha, 0.0, 1.0)
        )
        for name in LEVELS:
            store(self, **{name: _check_level(name, getattr(self, name))})
        if self.samples != 1 and self.subpixel_bits == 0:
            raise ValueError(
                f"samples must be 1 where subpixel_bits is 0, got {self.samples!r}: vertices on "
                "whole pixels leave nothing to smooth"
            )

    def __str__(self) -> str:
        """Name the nearest preset, and the settings that differ from it."""
        name = min(PRESETS, key=lambda name: len(differences(self, PRESETS[name]())))
        changes = differences(self, PRESETS[name]())
        return " ".join([name, *(f"{setting}={level}" for setting, level in changes.items())])

    @classmethod
    def draft(cls) -> Quality:
        """Return the fastest settings, for drafts."""
        return cls(
            shading="vertex", texture_filter="nearest", shadow_size=512, shadow_taps=1,
            transparency_layers=2, texture_mixing="srgb8",
        )  # fmt: skip

    @classmethod
    def standard(cls) -> Quality:
        """Return the default settings."""
        return cls()

    @classmethod
    def high(cls) -> Quality:
        """Return accurate settings, for final pictures."""
        return cls(
            samples=8, subpixel_bits=12, texture_filter="anisotropic8", shadow_size=2048,
            shadow_taps=9, lines="coverage",
        )  # fmt: skip

    @classmethod
    def reference(cls) -> Quality:
        """Return the most accurate settings, which errors are measured against."""
        return cls(
            samples=256, subpixel_bits=12, depth_format="float64", texture_filter="anisotropic16",
            shadow_size=4096, shadow_taps=1, lines="coverage", interpolation_precision="float64",
        )  # fmt: skip


PRESETS = {name: getattr(Quality, name) for name in ("draft", "standard", "high", "reference")}
"""The named qualities, from the fastest on."""

_OPTIONAL = ("texture_filter", "shadow_size", "shadow_taps")
"""Settings that may be None, which leaves them to the scene."""


def _check_level(name: str, value: Any) -> Any:
    """Return a setting's value, or raise ``ValueError`` naming it."""
    if value is None and name in _OPTIONAL:
        return None
    if name == "shadow_size":
        size = check.bounded_number(name, value, MIN_SHADOW, MAX_SHADOW)
        if size != int(size) or isinstance(value, bool):
            raise ValueError(f"{name} must be a whole number of texels, got {value!r}")
        return int(size)
    levels = LEVELS[name]
    if name == "renormalize":
        return check.boolean(name, value)
    level = check.one_of(name, value, levels)
    # One of the levels itself: 8.0 and numpy's 8 are 8.
    return levels[levels.index(level)]


def parse_setting(text: str) -> dict[str, Any]:
    """
    Return ``{name: level}`` for a text like ``"samples=8"``.

    Raises
    ------
    ValueError
        Naming the setting or the level that is unknown, and listing those that are possible.
    """
    name, separator, value = text.partition("=")
    if name == "visible_alpha":
        try:
            return {name: check.bounded_number(name, float(value), 0.0, 1.0)}
        except ValueError:
            raise ValueError(f"{name} must be a number in 0..1; got {value!r}") from None
    if not separator or name not in LEVELS:
        raise ValueError(
            f"a setting must read NAME=LEVEL, with a name of {', '.join(LEVELS)}, visible_alpha; "
            f"got {text!r}"
        )
    for level in LEVELS[name]:
        if value.lower() == str(level).lower():
            return {name: level}
    if name == "shadow_size" and value.isdecimal():
        return {name: _check_level(name, int(value))}
    levels = ", ".join(str(level) for level in LEVELS[name])
    raise ValueError(f"{name} must be one of {levels}; got {value!r}")


def differences(quality: Quality, other: Quality) -> dict[str, Any]:
    """Return the settings of ``quality`` that differ from those of ``other``."""
    values = dataclasses.asdict(quality)
    return {name: value for name, value in values.items() if value != getattr(other, name)}


def check_quality(value: Quality | None, name: str = "quality") -> Quality:
    """Return ``value``, or the standard for ``None``; raise ``ValueError`` for anything else."""
    if value is None:
        return STANDARD
    if not isinstance(value, Quality):
        raise ValueError(f"{name} must be a rasterjit.Quality, got {type(value).__name__}")
    return value


STANDARD = Quality.standard()
"""The default quality."""
