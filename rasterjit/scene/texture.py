"""Textures: pictures laid over a surface, decoded once, with their mip chain."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.forks import cached_property
from rasterjit.scene import mip_levels
from rasterjit.scene import validation as check
from rasterjit.scene.arrays import HoldsArrays
from rasterjit.scene.attribute_guard import store, suggests_replace
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.picture_codes import read_codes
from rasterjit.scene.transforms import sine_cosine
from rasterjit.scene.warning import warn_caller

if TYPE_CHECKING:
    from PIL import Image

Wrap: TypeAlias = Literal["repeat", "clamp", "mirror"]
WRAPS: tuple[Wrap, ...] = get_args(Wrap)
"""Wrap modes outside 0..1: repeat the picture; its border texels; repeat it, mirrored each time."""

Filter: TypeAlias = Literal["nearest", "bilinear", "trilinear"]
FILTERS: tuple[Filter, ...] = get_args(Filter)
"""Filters: one texel; four texels, mixed by distance; the same on the two nearest mip levels."""

ColorSpace: TypeAlias = Literal["srgb", "linear"]
COLOR_SPACES: tuple[ColorSpace, ...] = get_args(ColorSpace)
"""Meaning of a picture's integers: sRGB codes of colours; linear values, as in normal maps."""

Anisotropy: TypeAlias = Literal[1, 2, 4, 8, 16]
ANISOTROPIES: tuple[Anisotropy, ...] = get_args(Anisotropy)
"""Largest numbers of parts that the footprint of a pixel is divided into."""

WEIGHTED = "weighted"
AlphaUse: TypeAlias = Literal["weighted"] | float | None
"""
How alpha changes the stored texels of a texture; see ``mip_levels``.

None: nothing; "weighted"; or a number, of a mask: texels of less alpha are holes.
"""

MAX_CACHED_CHAINS = 4
"""Largest number of cached mip chains of a picture, one for each use of alpha."""

UV_NAMES = ("uv", "uv1")
"""Names of a mesh's sets of texture coordinates."""

UVSet: TypeAlias = Literal[0, 1]
UV_SETS: tuple[UVSet, ...] = get_args(UVSet)
"""Numbers of a mesh's sets of texture coordinates."""

MAX_UV_OFFSET = 1e6
"""Largest offset or scale of a texture: float64 keeps a position on it to 1/1000 texel."""

MAX_LIGHT = 1e6
"""Largest value of a texel, linear: its product with the brightest light fits float32."""

MAX_SIDE = 65536
"""Most texels in a row or column: positions along it keep their fraction."""

MAX_TEXELS = 1 << 27
"""Most texels of a picture: .4 GB of RGB codes, 2.1 GB of floats; .7 GB more with mip levels."""

MAX_FLOAT_TEXELS = 1 << 20
"""
Pictures of 8-bit codes of up to so many texels are kept as floats, larger ones as codes.

Floats take 16 bytes a texel, and codes 1 to 4, but a pixel that mixes four of them takes 4 ns more.
"""

_MAX_DISTINCT_VALUES = 16
"""Most different whole numbers up to 254 that a picture of floats has without a warning."""

_NEWTON_STEPS = 12
"""From ``base**2``, at most 3.3 times too large, 8 reach the last bit of float32; 12 leave room."""

PICTURE_FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP", "TGA", "GIF")
"""
Formats of pictures that are opened, by Pillow's names; the content decides.

Others are refused: Pillow knows fifty, among them some that start programs, such as PostScript.
"""


NO_TEXELS = check.read_only(np.empty((0, 4), np.float32))


class PictureSizeError(ValueError):
    """Raised for a picture that is empty or too large."""


class Pyramid:
    """
    The texels of a picture and its mip levels, which are computed on first use.

    Parameters
    ----------
    picture : (H, W, 1..4) uint8 or (H, W, 4) float32
        Codes, which are stored and decoded where they are read; or linear light.
    color_space : {"srgb", "linear"}
        What codes of colours are.
    buffer : (N, 4) float32, optional
        Texels of a picture of linear light, followed by space for its levels.
    """

    def __init__(
        self,
        picture: NDArray[Any],
        color_space: ColorSpace = "srgb",
        buffer: NDArray[np.float32] | None = None,
    ) -> None:
        self.size = picture.shape[1], picture.shape[0]
        self.color_space = color_space
        self.codes: NDArray[np.uint8] | None = picture if picture.dtype == np.uint8 else None
        """The picture as codes, (H, W, 1..4), read-only; None if stored as linear light."""
        self._texels = NO_TEXELS if self.codes is not None else picture.reshape(-1, 4)
        self._buffer = buffer
        self._prepared: dict[tuple[AlphaUse, bool], NDArray[np.float32]] = {}

    @property
    def picture(self) -> NDArray[Any]:
        """The picture as stored, read-only: codes, (H, W, 1..4), or (H, W, 4) float32."""
        return self.image if self.codes is None else self.codes

    @property
    def image(self) -> NDArray[np.float32]:
        """The picture as linear light, (H, W, 4) float32, read-only; of codes, made anew."""
        width, height = self.size
        if self.codes is not None:
            return check.read_only(self._decode_rows(slice(0, height)))
        return self._texels[: width * height].reshape(height, width, 4)

    def _decode_rows(self, rows: slice) -> NDArray[np.float32]:
        """Return some rows of the image."""
        if self.codes is None:
            return self.image[rows]
        return decode_texels(self.codes[rows], self.color_space)

    @cached_property
    def lowest_alpha(self) -> float:
        """The least alpha of any texel."""
        return float(self._alphas().min())

    def min_alpha_above(self, cutoff: float) -> float | None:
        """Return the least alpha of at least a cutoff; None if all texels are below it."""
        alphas = self._alphas()
        solid = alphas[alphas >= np.float32(cutoff)]
        return float(solid.min()) if solid.size else None

    def _alphas(self) -> NDArray[np.float32]:
        """Return the alphas of texels; of codes the distinct ones."""
        if self.codes is None:
            return self.image[:, :, 3]
        if not has_alpha(self.codes):
            return np.ones(1, np.float32)
        return np.unique(self.codes[:, :, -1]).astype(np.float32) / np.float32(255.0)

    def levels(self) -> list[NDArray[np.float32]]:
        """Return all levels, (h, w, 4) float32 each, read-only."""
        sizes = mip_levels.level_sizes(*self.size)
        if self.codes is None:
            return mip_levels.split_levels(self._linear_texels(True), sizes)
        return [self.image, *mip_levels.split_levels(self._linear_texels(True), sizes[1:])]

    def _linear_texels(self, has_levels: bool) -> NDArray[np.float32]:
        """Return the texels stored as linear light: all, or the levels below a picture of codes."""
        sizes = mip_levels.level_sizes(*self.size)
        stored_sizes = sizes if self.codes is None else sizes[1:]
        count = sum(width * height for width, height in stored_sizes)
        if not has_levels:
            return NO_TEXELS if self.codes is not None else self.image.reshape(-1, 4)
        if len(self._texels) < count:
            buffer = self._buffer
            if buffer is None:
                buffer = mip_levels.allocate_levels(stored_sizes)
                buffer[: len(self._texels)] = self._texels
            levels = mip_levels.split_levels(buffer, stored_sizes)
            # A picture of linear light is kept once: at the head of its levels.
            mip_levels.fill_levels(
                levels if self.codes is None else [self.codes, *levels], self._decode_rows
            )
            self._texels, self._buffer = check.read_only(buffer), None
        return self._texels

    def prepare_chain(self, alpha: AlphaUse, has_levels: bool) -> NDArray[np.float32]:
        """
        Return the texels that kernels read as linear light, (N, 4) float32, read-only, row by row.

        Parameters
        ----------
        alpha : AlphaUse
            If None, a picture of codes is read from these, and only its mip levels are returned.
        has_levels : bool
            Whether the mip levels are read.
        """
        if alpha is None:
            return self._linear_texels(has_levels)
        chain = self._prepared.pop((alpha, has_levels), None)
        if chain is None:
            is_weighted = alpha == WEIGHTED
            chain = (
                mip_levels.compute_weighted_levels(self.image, has_levels)
                if is_weighted
                else mip_levels.compute_mask_levels(self.image, float(alpha), has_levels)
            )
        # The latest are cached: an animated alpha needs ever new cutoffs.
        self._prepared[alpha, has_levels] = chain
        while len(self._prepared) > MAX_CACHED_CHAINS:
            self._prepared.pop(next(iter(self._prepared)))
        return chain


@suggests_replace
@dataclass(frozen=True, eq=False)
class Texture(HoldsArrays):
    """
    A picture to be laid over a mesh by its texture coordinates.

    Coordinate u runs right, v **up**: (0, 0) is the lower left corner of the picture, (1, 1) the
    upper right one, as in OBJ files (glTF counts v from the top; loading turns it over). Texel
    (column i, row j) of a picture with w columns and h rows has its centre at
    u = (i + 0.5) / w, v = 1 - (j + 0.5) / h.

    Filtering happens in linear light. ``"trilinear"`` chooses its level from the longer side of
    the pixel's footprint in texels (that of a sample, of 64 or 256 in a pixel), so a surface seen
    at a grazing angle is blurred rather than aliased. With ``anisotropy`` the footprint is divided
    along its longer side, and the level follows the shorter one: such a surface stays sharp.

    The coordinates that a texture shows are ``offset + turn (scale (u, v))``, so that a scale of
    2 repeats it twice where it was once: see `with_transform`.

    Parameters
    ----------
    image : (H, W) or (H, W, 1..4) array_like
        Grey, grey and alpha, RGB or RGBA, row 0 on top. ``uint8`` and ``uint16`` are what
        ``color_space`` says; floats are linear, in 0..1e6. Alpha is linear in every form. Read as
        (H, W, 4) float32, linear, read-only. ``uint8`` of more than 2**20 texels is kept as it is,
        for memory, and decoded anew each time that ``image`` is read.
    wrap : {"repeat", "clamp", "mirror"} or a pair of them
        What coordinates outside 0..1 show; a pair gives u and v each their own. Stored as a pair.
    filter : {"trilinear", "bilinear", "nearest"}
        How texels become the colour of a pixel.
    color_space : {"srgb", "linear"}
        What integers are: sRGB codes of colours, or shares of 1 (``value / 255``, or 65535), as
        in maps of normals, roughness or occlusion.
    anisotropy : {1, 2, 4, 8, 16}
        Into how many parts a long footprint is divided, at most; above 1 with ``"trilinear"``
        only.
    offset : (float, float)
        Added to the coordinates last, in -1e6..1e6.
    rotation : float
        Degrees by which the coordinates turn about (0, 0), counter-clockwise: the picture is
        seen to turn clockwise.
    scale : (float, float)
        What the coordinates are multiplied by first, in -1e6..1e6.
    uv_set : {0, 1}
        By which coordinates of the mesh it is laid: 0 is ``uv``, 1 is ``uv1``.

    Raises
    ------
    ValueError
        If the image has another shape or type, is empty, larger than 65536 on a side or has more
        than 2**27 texels (16384 x 8192), holds a NaN, infinite or negative number or one above
        1e6, or if any option is unknown, not finite or out of range.

    Warns
    -----
    UserWarning
        If floats look like codes from 0 to 255: they are shown 255 times as bright.

    References
    ----------
    .. [1] The Khronos Group, "KHR_texture_transform".
    """

    image: NDArray[np.float32] = field(repr=False)
    wrap: Wrap | tuple[Wrap, Wrap] = field(default="repeat", kw_only=True)
    filter: Filter = field(default="trilinear", kw_only=True)
    color_space: ColorSpace = field(default="srgb", kw_only=True)
    anisotropy: Anisotropy = field(default=1, kw_only=True)
    offset: tuple[float, float] = field(default=(0.0, 0.0), kw_only=True)
    rotation: float = field(default=0.0, kw_only=True)
    scale: tuple[float, float] = field(default=(1.0, 1.0), kw_only=True)
    uv_set: UVSet = field(default=0, kw_only=True)

    if TYPE_CHECKING:
        # Reading gives an array; the constructor takes what can be made one.
        def __init__(
            self,
            image: ArrayLike,
            *,
            wrap: Wrap | tuple[Wrap, Wrap] = "repeat",
            filter: Filter = "trilinear",
            color_space: ColorSpace = "srgb",
            anisotropy: Anisotropy = 1,
            offset: tuple[float, float] = (0.0, 0.0),
            rotation: float = 0.0,
            scale: tuple[float, float] = (1.0, 1.0),
            uv_set: UVSet = 0,
        ) -> None: ...

    def __post_init__(self) -> None:
        wrap = (self.wrap, self.wrap) if isinstance(self.wrap, str) else self.wrap
        if not isinstance(wrap, (tuple, list)) or len(wrap) != 2:
            raise ValueError(f"wrap must be a name or a pair of names, got {self.wrap!r}")
        wrap = (check.one_of("wrap", wrap[0], WRAPS), check.one_of("wrap", wrap[1], WRAPS))
        self._set_filter(self.filter, self.anisotropy)
        check.one_of("color_space", self.color_space, COLOR_SPACES)
        check.one_of("uv_set", self.uv_set, UV_SETS)
        store(self, wrap=wrap)
        self._set_transform(self.offset, self.rotation, self.scale)
        # The pyramid stores the image, which copies share.
        image = self.__dict__.pop("image")
        store(self, pyramid=_make_pyramid(image, self.color_space))

    def _set_filter(self, filter: Any, anisotropy: Any) -> None:
        """Check and keep filter and anisotropy."""
        check.one_of("filter", filter, FILTERS)
        check.one_of("anisotropy", anisotropy, ANISOTROPIES)
        if anisotropy > 1 and filter != "trilinear":
            raise ValueError(
                f"anisotropy must be 1 unless filter is 'trilinear', got {anisotropy} with "
                f"{filter!r}"
            )
        store(self, filter=filter, anisotropy=anisotropy)

    def _set_transform(self, offset: Any, rotation: Any, scale: Any) -> None:
        """Check and keep offset, rotation and scale."""
        store(self, offset=_check_pair("offset", offset), scale=_check_pair("scale", scale))
        store(self, rotation=check.finite_number("rotation", rotation))

    def __getattr__(self, name: str) -> Any:
        """Return the image, as linear light."""
        if name == "image" and "pyramid" in self.__dict__:
            return self.pyramid.image
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __getstate__(self) -> dict[str, Any]:
        """Return what is copied or pickled: the image, and no mip levels."""
        state = dict(self.__dict__)
        del state["pyramid"]
        return {**state, "image": self.pyramid.picture}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Fill a copy, or what was pickled; its texels are read-only too."""
        state = dict(state)
        picture = check.read_only(state.pop("image"))
        self.__dict__["pyramid"] = Pyramid(picture, state["color_space"])
        self.__dict__.update(state)

    @classmethod
    def from_file(
        cls,
        path: str | os.PathLike[str],
        *,
        wrap: Wrap | tuple[Wrap, Wrap] = "repeat",
        filter: Filter = "trilinear",
        color_space: ColorSpace = "srgb",
        anisotropy: Anisotropy = 1,
        offset: tuple[float, float] = (0.0, 0.0),
        rotation: float = 0.0,
        scale: tuple[float, float] = (1.0, 1.0),
        uv_set: UVSet = 0,
    ) -> Texture:
        """
        Read a texture from a picture: PNG, JPEG, WebP, TIFF, BMP, TGA or GIF.

        Grey, RGB and RGBA pictures of 8 and 16 bits are taken as they are, with the holes of a
        colour key of a PNG file; others as RGBA.

        Parameters
        ----------
        path : str or path-like
            Of several pictures in a file, the first is taken.
        wrap, filter, color_space, anisotropy, offset, rotation, scale, uv_set
            As `Texture` takes them.

        Raises
        ------
        ValueError
            If the file is missing, holds no picture, or a picture that is larger than `Texture`
            takes; the message names it.
        """
        return cls(
            read_picture("path", check.existing_file("path", path)), wrap=wrap, filter=filter,
            color_space=color_space, anisotropy=anisotropy, offset=offset, rotation=rotation,
            scale=scale, uv_set=uv_set,
        )  # fmt: skip

    def with_transform(
        self,
        offset: tuple[float, float] = (0.0, 0.0),
        rotation: float = 0.0,
        scale: tuple[float, float] = (1.0, 1.0),
    ) -> Texture:
        """
        Return the texture with another transform; texels and mip levels are shared, not copied.

        Takes offset, rotation and scale as `Texture` does, in place of its own.
        """
        other = self._with()
        other._set_transform(offset, rotation, scale)
        return other

    def with_filter(self, filter: Filter, anisotropy: Anisotropy = 1) -> Texture:
        """
        Return the texture with another filter; texels and mip levels are shared, not copied.

        Takes filter and anisotropy as `Texture` does, in place of its own.
        """
        other = self._with()
        other._set_filter(filter, anisotropy)
        return other

    def with_uv_set(self, uv_set: UVSet) -> Texture:
        """
        Return the texture with another uv set; texels and mip levels are shared, not copied.

        Takes the number of the set as `Texture` does, in place of its own.
        """
        other = self._with()
        store(other, uv_set=check.one_of("uv_set", uv_set, UV_SETS))
        return other

    @property
    def transform(self) -> tuple[float, float, float, float, float, float] | None:
        """``u' = t0 u + t1 v + t2, v' = t3 u + t4 v + t5``; ``None`` if nothing changes."""
        (x, y), (across, up) = self.offset, self.scale
        if (x, y, self.rotation, across, up) == (0.0, 0.0, 0.0, 1.0, 1.0):
            return None
        sine, cosine = sine_cosine(self.rotation)
        return cosine * across, -sine * up, x, sine * across, cosine * up, y

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, texels."""
        return self.pyramid.size

    @property
    def is_opaque(self) -> bool:
        """Whether every texel has an alpha of 1 or more."""
        return self.lowest_alpha >= 1.0

    @property
    def lowest_alpha(self) -> float:
        """The least alpha of any texel: no filter shows less."""
        return self.pyramid.lowest_alpha

    @property
    def levels(self) -> tuple[NDArray[np.float32], ...]:
        """
        The mip chain, each level (h, w, 4) float32, linear, read-only; the first is the image.

        Each level halves the sides of the one before, rounded down but not below 1, until a single
        texel is left. Its texels are means, by area, of the texels below them, in float64: the
        mean of the image is kept on every level, and a constant stays itself.
        """
        return tuple(self.pyramid.levels())


@contextmanager
def open_picture(name: str, source: Any, formats: tuple[str, ...] = ()) -> Iterator[Image.Image]:
    """
    Open a picture's file with Pillow, if it is no larger than `Texture` takes.

    Parameters
    ----------
    name : str
        What a message calls it.
    source : Path or binary file
    formats : tuple of str
        Formats that are opened besides ``PICTURE_FORMATS``, where Pillow knows them.

    Raises
    ------
    PictureSizeError
        If it has too many texels; the message says how many it may have.
    Exception
        Whatever Pillow raises about a picture that is damaged or of no known format.
    """
    from PIL import Image

    if formats:
        Image.init()
    extra_formats = tuple(name for name in formats if name in Image.OPEN)
    with warnings.catch_warnings():
        # Pillow warns at half the number of texels that it refuses: the limit here lies between.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        try:
            image = Image.open(source, formats=PICTURE_FORMATS + extra_formats)
        except Image.DecompressionBombError as error:
            raise PictureSizeError(
                f"{name} must have at most {MAX_TEXELS:,} texels; Pillow says: {error}"
            ) from error
        with image:
            check_texels(name, *image.size)
            yield image


def read_picture(name: str, file: Path, *, apply_exif: bool = False) -> NDArray[Any]:
    """
    Decode the first picture of a file, or raise ``ValueError`` naming the file.

    Parameters
    ----------
    name : str
        What the message calls the argument.
    file : Path
    apply_exif : bool
        Whether it is turned upright, as EXIF data say, with which cameras write what they held.
    """
    try:
        with open_picture(f"the picture {str(file)!r}", file) as image:
            return read_codes(image, apply_exif)
    except PictureSizeError:
        raise
    except Exception as error:
        # Pillow raises exceptions of any type for a damaged picture.
        reason = str(error) or type(error).__name__
        if type(error).__name__ == "UnidentifiedImageError":
            reason = f"it is none of {', '.join(PICTURE_FORMATS)}"
        raise ValueError(f"{name} must be a picture, but {str(file)!r} is not: {reason}") from error


def flip_v(
    offset: tuple[float, float], rotation: float, scale: tuple[float, float]
) -> tuple[tuple[float, float], float, tuple[float, float]]:
    """
    Return offset, rotation and scale for v up, as `Texture` takes them, given those for v down.

    In glTF v runs down, and ``offset + turn (scale (u, v))`` is meant with v as it is there. With
    ``v = 1 - v'`` on both sides the scale stays, and so does the rotation, which is
    counter-clockwise as seen in both; the offset takes in where the corner (0, 1) goes.

    Parameters
    ----------
    offset, scale : (float, float)
    rotation : float
        Degrees (glTF writes radians), counter-clockwise as seen on the picture.

    References
    ----------
    .. [1] The Khronos Group, "KHR_texture_transform".
    """
    sine, cosine = sine_cosine(rotation)
    return (offset[0] + scale[1] * sine, 1.0 - offset[1] - scale[1] * cosine), rotation, scale


def _check_pair(name: str, value: Any) -> tuple[float, float]:
    """Return two numbers, each at most ``MAX_UV_OFFSET`` in size, or raise."""
    u, v = check.finite_array(name, value, (2,)).tolist()
    return (
        check.bounded_number(name, u, -MAX_UV_OFFSET, MAX_UV_OFFSET),
        check.bounded_number(name, v, -MAX_UV_OFFSET, MAX_UV_OFFSET),
    )


def _make_pyramid(value: Any, color_space: ColorSpace) -> Pyramid:
    """Return a copy of an image, without its levels, or raise ``ValueError``."""
    # An array of a type that says what its numbers are.
    expected = "image must be an array of uint8, uint16 (sRGB) or float (linear light)"
    if isinstance(value, (str, os.PathLike)):
        raise ValueError(f"{expected}, got {check.brief(value)}; Texture.from_file reads pictures")
    image = check.unmasked_array("image", value, *check.ROWS_WORDING)
    if image.dtype not in (np.uint8, np.uint16) and image.dtype.kind != "f":
        got = check.brief(value) if image.dtype == object else f"one of {image.dtype}"
        raise ValueError(f"{expected}, got {got}")
    # Its shape: grey or colours, with or without alpha.
    shape = image.shape
    if len(shape) == 2:
        image = image[:, :, np.newaxis]
    if image.ndim != 3 or image.shape[2] not in (1, 2, 3, 4):
        raise ValueError(f"image must have shape (H, W) or (H, W, 1..4), got {shape}")
    height, width, channels = image.shape
    check_texels("image", width, height)
    if image.dtype == np.uint8 and width * height > MAX_FLOAT_TEXELS:
        is_opaque = has_alpha(image) and bool((image[:, :, -1] == 255).all())
        codes = image[:, :, :-1] if is_opaque else image
        return Pyramid(check.read_only(np.array(codes, order="C")), color_space)
    # Untouched space for levels takes no memory.
    buffer = mip_levels.allocate_levels(mip_levels.level_sizes(width, height))
    texels = buffer[:]
    linear = texels[: height * width].reshape(height, width, 4)
    if image.dtype.kind == "f":
        colors = channels - 1 if has_alpha(image) else channels
        _check_light(image[:, :, :colors], "linear light", MAX_LIGHT)
        _check_light(image[:, :, colors:], "alpha", 1.0)
        if _look_like_bytes(image[:, :, :colors]):
            warn_caller(
                f"image holds floats that are whole numbers up to {float(image.max()):g}: floats "
                "are linear light, of which 1 is white; codes from 0 to 255 must be uint8, as "
                "image.astype(numpy.uint8)"
            )
        linear[:, :, :3] = image[:, :, :colors]
        linear[:, :, 3:] = image[:, :, colors:] if has_alpha(image) else 1.0
    else:
        for rows in mip_levels.split_bands(height, width):
            linear[rows] = decode_texels(image[rows], color_space)
    texels.setflags(write=False)
    return Pyramid(check.read_only(linear), color_space, buffer)


def has_alpha(image: NDArray[Any]) -> bool:
    """Tell whether the last channel of an image, (H, W, 1..4), is alpha."""
    return image.shape[2] in (2, 4)


def decode_texels(codes: NDArray[Any], color_space: ColorSpace) -> NDArray[np.float32]:
    """Return codes of 8 or 16 bits, (H, W, 1..4), as linear light, (H, W, 4)."""
    max_code = np.float32(np.iinfo(codes.dtype).max)
    decode = srgb_to_linear if codes.dtype == np.uint8 else _decode_srgb_16
    colors = codes[:, :, :-1] if has_alpha(codes) else codes
    linear = np.empty((*codes.shape[:2], 4), np.float32)
    linear[:, :, :3] = colors / max_code if color_space == "linear" else decode(colors)
    linear[:, :, 3] = codes[:, :, -1] / max_code if has_alpha(codes) else 1.0
    return linear


def _look_like_bytes(colors: NDArray[Any]) -> bool:
    """Tell whether floats, (H, W, C), look like bytes: many whole numbers up to 255."""
    highest = float(colors.max())
    if not 1.0 < highest <= 255.0 or not all((row == np.rint(row)).all() for row in colors):
        return False
    return highest == 255.0 or len(np.unique(colors)) > _MAX_DISTINCT_VALUES


def check_texels(name: str, width: int, height: int) -> None:
    """Raise `PictureSizeError` if a picture of that size is empty or too large."""
    if not (1 <= height <= MAX_SIDE and 1 <= width <= MAX_SIDE):
        raise PictureSizeError(
            f"{name} must be 1..{MAX_SIDE} texels wide and high, got {width}×{height}"
        )
    if width * height > MAX_TEXELS:
        raise PictureSizeError(
            f"{name} must have at most {MAX_TEXELS:,} texels, got {width}×{height}, which is "
            f"{width * height:,}"
        )


def _check_light(values: NDArray[Any], label: str, limit: float) -> None:
    """Raise ``ValueError`` unless all values lie in 0..limit; NaN does not."""
    if values.size == 0:
        return
    lowest, highest = float(values.min()), float(values.max())
    if lowest != lowest:
        count = int(np.isnan(values).sum())
        raise ValueError(
            f"image must hold {label} in 0..{limit:g}, got {count} NaN among its numbers"
        )
    if not (lowest >= 0.0 and highest <= limit):
        raise ValueError(
            f"image must hold {label} in 0..{limit:g}, got numbers from {lowest} to {highest}; "
            "8-bit codes need the dtype uint8"
        )


def _decode_srgb_16(codes: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Decode 16-bit sRGB codes to linear light through a table; 257 c is the 8-bit code c."""
    return _build_decoding_table_16()[codes]


@cache
def _build_decoding_table_16() -> NDArray[np.float32]:
    """
    Return the linear value of each of the 65536 codes.

    The curve's power of 12/5 is the fifth root r of ``base**12``. Newton's steps fall to it from
    ``base**2`` by sums, products and quotients alone, which have the same bits on every machine.
    """
    encoded = np.arange(65536, dtype=np.float64) / 65535.0
    base = (encoded + 0.055) / 1.055
    squared = base * base
    power = squared * squared * squared * (squared * squared * squared)
    root = squared
    for _ in range(_NEWTON_STEPS):
        fourth = (root * root) * (root * root)
        root = (4.0 * root + power / fourth) / 5.0
    table = np.where(encoded <= 0.04045, encoded / 12.92, root)
    table[-1] = 1.0
    return table.astype(np.float32)
