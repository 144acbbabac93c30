"""Settings of accuracy, and presets of them."""

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
"""The settings of `Quality`, each with its levels, from the least accurate to the most."""

SUPERSAMPLED = (64, 256)
"""Numbers of samples that are drawn as several whole pictures and averaged."""

MIN_SHADOW_SIZE, MAX_SHADOW_SIZE = 16, 8192
"""Range of the side of a shadow map, texels."""


@suggests_replace
@dataclass(frozen=True)
class Quality:
    """
    How accurately to render; ``dataclasses.replace`` changes single settings.

    Parameters
    ----------
    subpixel_bits : {0, 4, 8, 12}
        Vertices are rounded to multiples of ``2**-subpixel_bits`` pixels. Direct3D requires 8, and
        Mesa's rasterizer uses it; 0 rounds to whole pixels, as textbook rasterizers do.
    samples : {1, 2, 4, 8, 16, "area", 64, 256}
        Samples of each pixel, which smooth edges.

        With 2 to 16, the nearest face is found at that many positions of the pixel, those of
        Direct3D and Vulkan. ``"area"`` is their exact limit: each face counts by the area of the
        pixel that it covers. Each face is shaded once in a pixel, at its centre, or, if the face
        does not cover that, at a point on the face. With 64 and 256, each sample is shaded: whole
        pictures are drawn, moved by fractions of a pixel, and averaged; textures are filtered for
        the spacing of samples.

        Colours are averaged in linear light, before tone mapping; other outputs are those of the
        pixel's centre. With ``"area"``, scenes that show blended materials (``alpha_mode`` "blend"
        with an alpha below 1) raise ``ValueError``, naming an object that has one. The edges of
        holes of an alpha mask are smoothed with 2 to 16 samples, each with its own alpha; with
        ``"area"`` they stay hard, as a face has one alpha in a pixel, that at its centre.
    interpolation : {"affine", "perspective"}
        How values of vertices are interpolated over a face: linearly on the screen, as early
        consoles did, or linearly on the face. Faces that cross the near or far plane, or extend far
        beyond the image, are always interpolated on the face. Depth and shadow maps do not depend
        on it.
    depth_format : {"unorm16", "unorm24", "float32", "float32-reversed", "float64"}
        What the depths of faces are rounded to before they are compared. ``"unorm16"``,
        ``"unorm24"`` and ``"float32"``: the depth from 0 at the near plane to 1 at the far one, in
        16 bits, 24 bits or a float. ``"float32-reversed"`` and ``"float64"``: the reversed depth,
        which falls with distance and is more precise far away. Where depths are equal, the face
        with the lower number is seen. The depth output is rounded in the same way. Shadows, ambient
        occlusion, eye-dome lighting, outlines, hidden lines and the areas of ``samples="area"`` use
        depths that are not rounded to the format; shadow maps are always float32.
    precision : {"float32", "float64"}
        Arithmetic that transforms vertices from model space to the screen, relative to the eye; the
        matrices are computed in float64. In float32 the vertices take half the memory, and those
        beyond 1e18 in clip space are left out. Shadow maps always use float64; points and lines are
        transformed in float64, from positions rounded to float32.
    shading : {"face", "vertex", "pixel"}
        The finest unit that is lit: materials that ask for a finer one are shaded like ``"flat"``
        or ``"gouraud"`` ones. Metallic-roughness materials are always lit at each pixel.
    renormalize : bool
        Whether interpolated normals are scaled to length one at each pixel. If not, they are too
        short between vertices with different normals, which makes surfaces darker there. Normal
        maps, and an object in view with a non-uniform scale, always scale them.
    texture_filter : str, optional
        ``"nearest"``, ``"bilinear"``, ``"trilinear"``, ``"anisotropic2"`` .. ``"anisotropic16"``,
        for all textures. Default: what each texture says.
    shadow_size : int, optional
        Side of all shadow maps, texels, 16..8192. Default: what each light says.
    shadow_taps : {1, 9}, optional
        Comparisons with a shadow map: one, or 3 x 3 filtered ones. Default: what each light says.
    transparency_layers : {1, 2, 4, 8, "all"}
        How many of the nearest transparent surfaces are seen at a sample. Transparent surfaces
        behind them are left out; the opaque one is seen through them. With ``"all"``, more than
        4096 behind each other are an error.
    blending : {"srgb8", "linear"}
        What transparent surfaces, samples and smooth lines are blended in: 8-bit sRGB codes, as old
        programs do, or linear light. With codes, each colour is tone mapped and rounded to 8 bits,
        alpha too, and so is the result of each blend; the output ``"linear"`` is then the light
        that the codes stand for. A frame that blends nothing has the same bits with both.
    texture_mixing : {"srgb8", "linear"}
        What texels are filtered in on unlit objects that are opaque, without holes, and have no
        colours of vertices, faces or scalars: 8-bit sRGB codes, as old programs do, or linear
        light. With codes, texture coordinates are float32, texels are weighted in 8 bits, the base
        colour multiplies codes, and light above 1 is clipped. Textures with mip levels, and all
        other objects, are always filtered in linear light.
    lines : {"bresenham", "coverage"}
        Edges of a wireframe, outlines and section lines: whole pixels, those of a wireframe one
        after the other between the pixels that hold the vertices; or smooth, by the area of each
        pixel that a line covers, at any number of samples.
    interpolation_precision : {"adaptive", "float64"}
        Arithmetic that interpolates colours of vertices. ``"adaptive"`` uses float32 in scenes
        whose objects, in view or not, are all unlit, without textures and not blended, with 1, 64
        or 256 ``samples``: it changes each colour by at most a millionth of itself. All else always
        uses float64.
    visible_alpha : float
        Where the alpha of a blended surface is below this, 0..1, depth, ids, normals, coverage and
        all other outputs but the colours show what is behind it. Default 0: the nearest surface
        counts, however transparent. Colours do not depend on it. Alpha is that of material, colours
        and texture; that of a colour map of scalars does not count.

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
"""The presets, from the fastest to the most accurate."""

_OPTIONAL = ("texture_filter", "shadow_size", "shadow_taps")
"""Settings that may be None: then each texture or light has its own."""


def _check_level(name: str, value: Any) -> Any:
    """Return a setting's value, or raise ``ValueError`` naming it."""
    if value is None and name in _OPTIONAL:
        return None
    if name == "shadow_size":
        size = check.bounded_number(name, value, MIN_SHADOW_SIZE, MAX_SHADOW_SIZE)
        if size != int(size) or isinstance(value, bool):
            raise ValueError(f"{name} must be a whole number of texels, got {value!r}")
        return int(size)
    if name == "renormalize":
        return check.boolean(name, value)
    # Return the level itself: NumPy's 8 is equal to it.
    levels = LEVELS[name]
    return levels[levels.index(check.one_of(name, value, levels))]


def parse_setting(text: str) -> dict[str, Any]:
    """
    Return ``{name: level}`` for a text like ``"samples=8"``.

    Raises
    ------
    ValueError
        If the setting or the level is unknown; the message lists those that are possible.
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
