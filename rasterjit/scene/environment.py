"""Environments: light from all around the scene, which is also the background."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.forks import cached_property
from rasterjit.scene import validation as check
from rasterjit.scene.arrays import HoldsArrays
from rasterjit.scene.attribute_guard import store, suggests_replace
from rasterjit.scene.color import RGB, ColorLike, linear_color, rgb
from rasterjit.scene.hdr_image import read_hdr_image
from rasterjit.scene.light import MAX_RADIANCE
from rasterjit.scene.memory_limits import DEFAULT_MAX_BYTES, FileSizeError, MemoryBudget
from rasterjit.scene.texture import check_texels
from rasterjit.scene.warning import warn_caller

MAX_INVALID_SHARE = 0.001
"""Largest share of a sky's texels that may be NaN or infinite; one always may."""


@suggests_replace
@dataclass(frozen=True, eq=False)
class Panorama(HoldsArrays):
    """
    A picture of everything around, equirectangular: columns are longitudes, rows latitudes.

    Seen from inside, with y up: the middle of the picture lies towards +x, its left and right edge
    meet towards -x, +z is a quarter of the width right of the middle, and row 0 is overhead (+y).
    That is how glTF viewers and three.js lay it out. Texel (column i, row j) of W times H has its
    centre at the longitude ``360 ((i + 0.5) / W - 0.5)`` from +x towards +z, and the latitude
    ``180 (0.5 - (j + 0.5) / H)``.

    Parameters
    ----------
    image : (H, W, 3) array_like of float
        Linear light in 0..1e30; stored as float32, read-only. Usually W is 2 H. What is below 0
        becomes 0; so do NaN, and infinity the most that is finite, in one texel of a thousand.

    Raises
    ------
    ValueError
        If the image has another shape or type, is empty, larger than 65536 on a side or has more
        than 2**27 texels, or holds a number above 1e30, or more that is NaN or infinite.

    Warns
    -----
    UserWarning
        If texels were changed, with their number.
    """

    image: NDArray[np.float32]

    if TYPE_CHECKING:

        def __init__(self, image: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        store(self, image=_linear_panorama(self.image))

    @cached_property
    def brightest(self) -> float:
        """The largest number of all texels."""
        return float(self.image.max())

    @property
    def is_black(self) -> bool:
        """Whether no texel holds any light."""
        return self.brightest == 0.0

    def __repr__(self) -> str:
        height, width = self.image.shape[:2]
        return f"Panorama({width}×{height})"


@suggests_replace
@dataclass(frozen=True)
class SkyGradient:
    """
    A sky of three colours, each linear RGB.

    Towards a direction whose height is y (the sine of its elevation) it shows
    ``horizon + y (zenith - horizon)`` above the horizon, and ``horizon - y (ground - horizon)``
    below. Three equal colours are one colour everywhere.
    """

    zenith: RGB
    horizon: RGB
    ground: RGB


@suggests_replace
@dataclass(frozen=True, eq=False)
class Environment:
    """
    Light from all around: it lights every surface, is mirrored by metals, and seen as background.

    Make one from a picture with the class itself or `from_file`, without a picture with `constant`
    or `gradient`. A scene that has one gets no headlight. It casts no shadows.

    Parameters
    ----------
    sky : (H, W, 3) array_like of float, Panorama or SkyGradient
        What is around. An array is an equirectangular picture of linear light, laid out as
        `Panorama` says: its middle towards +x. Environments that share one `Panorama` share what
        is prepared from it.
    intensity : float
        Factor on all of its light, in 0..1e30; with it no light may be above 1e30.
    rotation : float, degrees
        Turns what is around about the y axis, counter-clockwise as seen from above: what lay
        towards +x comes from +z at -90 and from -z at 90.
    background : bool
        Whether it is seen where no face is, unless the render is given a background of its own.

    Raises
    ------
    ValueError
        If ``sky`` is none of these (see `Panorama`), the intensity is not in 0..1e30, the rotation
        not a finite number, or ``background`` neither True nor False.
    """

    sky: Panorama | SkyGradient
    intensity: float = 1.0
    rotation: float = 0.0
    background: bool = True

    if TYPE_CHECKING:
        # Reading gives a sky; the constructor takes what can be made one.
        def __init__(
            self,
            sky: ArrayLike | Panorama | SkyGradient,
            intensity: float = 1.0,
            rotation: float = 0.0,
            background: bool = True,
        ) -> None: ...

    def __post_init__(self) -> None:
        if not isinstance(self.sky, (Panorama, SkyGradient)):
            store(self, sky=Panorama(self.sky))
        intensity = check.bounded_number("intensity", self.intensity, 0.0, MAX_RADIANCE)
        if isinstance(self.sky, Panorama) and intensity * self.sky.brightest > MAX_RADIANCE:
            raise ValueError(
                f"intensity must be at most {MAX_RADIANCE / self.sky.brightest:g} for a sky whose "
                f"brightest light is {self.sky.brightest:g}, got {self.intensity!r}"
            )
        store(self, intensity=intensity, rotation=check.finite_number("rotation", self.rotation))
        check.boolean("background", self.background)

    @classmethod
    def constant(
        cls, color: ColorLike = "white", *, intensity: float = 1.0, background: bool = True
    ) -> Environment:
        """
        Make one that has the same colour everywhere.

        Parameters
        ----------
        color : str or array_like
            Any colour, as `types.ColorLike` has it; alpha is dropped.
        intensity, background
            As `Environment` takes them.

        Raises
        ------
        ValueError
            If the colour is not one, or as `Environment` says.
        """
        light = linear_color("color", color)
        return cls.gradient(light, light, light, intensity=intensity, background=background)

    @classmethod
    def gradient(
        cls,
        zenith: ColorLike = "#3a6fb0",
        horizon: ColorLike = "#cfe0ee",
        ground: ColorLike = "#57503f",
        *,
        intensity: float = 1.0,
        background: bool = True,
    ) -> Environment:
        """
        Make a sky from the colours overhead, at the horizon and underfoot; see `SkyGradient`.

        Parameters
        ----------
        zenith, horizon, ground : str or array_like
            Any colours, as `types.ColorLike` has them; alpha is dropped.
        intensity, background
            As `Environment` takes them.

        Raises
        ------
        ValueError
            If a colour is not one, or as `Environment` says.
        """
        colors_by_name = {"zenith": zenith, "horizon": horizon, "ground": ground}
        colors = [rgb(*item) for item in colors_by_name.items()]
        return cls(SkyGradient(*colors), intensity, 0.0, background)

    @classmethod
    def from_file(
        cls,
        path: str | os.PathLike[str],
        *,
        intensity: float = 1.0,
        rotation: float = 0.0,
        background: bool = True,
        max_bytes: int = DEFAULT_MAX_BYTES,
    ) -> Environment:
        """
        Read an equirectangular picture.

        Parameters
        ----------
        path : str or path-like
            ``.hdr`` or ``.pic`` (Radiance), ``.exr`` (needs OpenEXR, ``rasterjit[exr]``), or a
            picture as `Texture.from_file` reads it, which is decoded from sRGB.
        intensity, rotation, background
            As `Environment` takes them.
        max_bytes : int
            Memory that reading it may take, told from its header. Default: 8 GiB.

        Raises
        ------
        ValueError
            If the file is missing, needs more than that, or holds no such picture; the message
            names it.
        """
        # A wrong budget is not the file's fault.
        MemoryBudget(str(path), max_bytes)
        try:
            sky = Panorama(_clamp_light(read_hdr_image(path, max_bytes), os.fspath(path)))
        except FileSizeError:
            raise
        except ValueError as error:
            if not isinstance(path, (str, os.PathLike)) or repr(os.fspath(path)) in str(error):
                raise
            reason = f"path must be a picture of light, but {os.fspath(path)!r} is not"
            raise ValueError(f"{reason}: {error}") from error
        return cls(sky, intensity, rotation, background)

    @property
    def lights(self) -> bool:
        """Whether any light comes from it."""
        if isinstance(self.sky, Panorama):
            return self.intensity > 0.0 and not self.sky.is_black
        sky = self.sky
        return self.intensity > 0.0 and any(sky.zenith + sky.horizon + sky.ground)

    @property
    def brightest(self) -> float:
        """The largest part of all of its light, linear."""
        if isinstance(self.sky, Panorama):
            return self.intensity * self.sky.brightest
        return self.intensity * max(self.sky.zenith + self.sky.horizon + self.sky.ground)

    @property
    def described(self) -> str:
        """Description of the sky in words."""
        if isinstance(self.sky, Panorama):
            height, width = self.sky.image.shape[:2]
            return f"a picture of {width}×{height} texels"
        sky = self.sky
        return "one colour" if sky.zenith == sky.horizon == sky.ground else "a sky gradient"


def _linear_panorama(value: Any) -> NDArray[np.float32]:
    """Return a picture as (H, W, 3) float32, linear, read-only, or raise ``ValueError``."""
    image = check.unmasked_array("sky", value, *check.ROWS_WORDING)
    if image.dtype.kind != "f":
        raise ValueError(
            f"sky must hold floats, which are linear light, got {image.dtype}; "
            "Environment.from_file decodes the codes of 8-bit pictures"
        )
    if image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"sky must have shape (H, W, 3), got {image.shape}")
    height, width = image.shape[:2]
    check_texels("sky", width, height)
    return check.read_only(np.array(_clamp_light(image, "sky"), np.float32, order="C"))


def _clamp_light(image: NDArray[Any], label: str) -> NDArray[Any]:
    """Clamp a picture, (H, W, 3), to valid light and warn if that changes it, or raise."""
    # NaN lies nowhere.
    lowest, highest = float(image.min()), float(image.max())
    if lowest >= 0.0 and highest <= MAX_RADIANCE:
        return image
    is_finite = np.isfinite(image)
    invalid = int(np.count_nonzero(~is_finite.all(axis=2)))
    negative = int(np.count_nonzero((is_finite & (image < 0.0)).any(axis=2)))
    peak = float(image.max(where=is_finite, initial=0.0))
    texels = image.shape[0] * image.shape[1]
    if peak > MAX_RADIANCE or invalid > max(1.0, MAX_INVALID_SHARE * texels):
        raise ValueError(
            f"sky must hold linear light in 0..{MAX_RADIANCE:g}, got numbers up to {peak:g}, and "
            f"NaN or infinity in {invalid:,} of {texels:,} texels"
        )
    counts = (("below 0", negative), ("NaN or infinite", invalid))
    changes = " and ".join(f"{what} in {count:,}" for what, count in counts if count)
    warn_caller(f"{label}: light is {changes} of {texels:,} texels, and was clamped")
    return np.clip(np.nan_to_num(image, nan=0.0, posinf=peak), 0.0, peak)
