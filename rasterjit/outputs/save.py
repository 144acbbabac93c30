"""
Write a frame's outputs to files that other programs read.

A 16-bit PNG holds whole numbers from 0 to 65535. Text entries have their meaning: the value is
``code * scale + offset``, in ``unit``, and ``zero`` is the meaning of code 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io import images
from rasterjit.io.atomic_write import atomic_file
from rasterjit.outputs.output_table import find_row, is_attribute
from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Bool, Float64

FORMATS = (".npz", ".npy", ".exr", ".png")
"""Extensions that ``save_outputs`` writes."""

LAYER_FORMATS = (".npz", ".npy", ".exr")
"""Extensions that ``save_layers`` writes."""

MAX_CODE = 65535
"""Largest 16-bit code."""

BACKGROUND_NOTE = "nothing is there"
"""Meaning of code 0 in files."""

_CHANNEL_NAMES = {1: ("",), 2: ("X", "Y"), 3: ("X", "Y", "Z"), 4: ("R", "G", "B", "A")}
"""Endings of an output's channel names in an EXR file, by their number."""

_FLOW_SCALE, _FLOW_OFFSET = 1.0 / 64.0, -512.0
"""Scale and offset of motion, as the KITTI benchmark stores flow: 64 codes a pixel, 0 at 2**15."""


@dataclass(frozen=True)
class Codes:
    """
    An output in 16-bit codes, with their meaning.

    Attributes
    ----------
    pixels : (H, W) or (H, W, 3) uint16
    scale, offset : float
        A value is ``code * scale + offset``.
    unit : str
    zero : str
        Meaning of code 0: of several channels, all of them 0, or ``blue`` where two are used.
    """

    pixels: NDArray[np.uint16]
    scale: float
    offset: float
    unit: str
    zero: str = BACKGROUND_NOTE

    def png_texts(self, name: str) -> dict[str, str]:
        """Return the text entries of the file."""
        return {
            "Title": name,
            "Description": "value = code * scale + offset",
            "scale": repr(self.scale),
            "offset": repr(self.offset),
            "unit": self.unit,
            "zero": self.zero,
        }


def save_outputs(
    path: str | Path, arrays: Mapping[str, NDArray[Any]], *, scale: float | None = None
) -> None:
    """
    Write outputs to a file; the format follows the extension.

    Parameters
    ----------
    path : str or Path
        ``.npz`` and ``.exr`` hold any number of outputs, ``.npy`` and ``.png`` one.
    arrays : mapping of str to (H, W) or (H, W, C) array
        Outputs by name; unknown names are written by their type and shape.
    scale : float, optional
        PNG of floats only: units a code; see `encode_output`.

    Raises
    ------
    ValueError
        If the extension is unknown, the folder does not exist, there is no output or more than the
        format holds, or an output does not fit the format. Nothing is written.
    ImportError
        If an EXR is asked for and OpenEXR is not installed.
    OSError
        If the file cannot be written; an existing one is left as it was.
    """
    target = images.check_save_path(path, FORMATS)
    suffix = target.suffix.lower()
    _check_count(suffix, arrays)
    if scale is not None and suffix != ".png":
        raise ValueError(f"scale must be None for {suffix}, which holds the values, got {scale!r}")
    for name, array in arrays.items():
        if array.ndim not in (2, 3) or array.size == 0:
            raise ValueError(f"outputs must be (H, W) or (H, W, C), got {name} {array.shape}")
    if suffix == ".npz":
        images.save_arrays(target, **arrays)
    elif suffix == ".exr":
        images.write_exr(target, make_exr_channels(arrays), _describe_outputs(arrays))
    else:
        ((name, array),) = arrays.items()
        if suffix == ".npy":
            _save_array(target, array)
        else:
            _save_png(target, name, array, scale)


def save_layers(path: str | Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """
    Write the layers of outputs to a file; the format follows the extension.

    Parameters
    ----------
    path : str or Path
        ``.npz`` and ``.exr`` hold any number of outputs, ``.npy`` one.
    arrays : mapping of str to (K, H, W) or (K, H, W, C) array
        Outputs by name, nearest layer first. An EXR names the channels of each layer
        ``layer0.Z``, ``layer1.normal.X`` and so on.

    Raises
    ------
    ValueError
        If the extension is another one, the folder does not exist, there is no output or more than
        the format holds, or an output does not fit the format. Nothing is written.
    ImportError
        If an EXR is asked for and OpenEXR is not installed.
    OSError
        If the file cannot be written; an existing one is left as it was.
    """
    target = images.check_save_path(path, dict.fromkeys((*FORMATS, *images.IMAGE_FORMATS)))
    suffix = target.suffix.lower()
    if suffix not in LAYER_FORMATS:
        raise ValueError(
            f"path {str(path)!r}: {suffix} holds one layer: choose one of "
            f"{', '.join(LAYER_FORMATS)}, or save what rasterjit.render returns, the first layer"
        )
    _check_count(suffix, arrays)
    if suffix == ".npz":
        images.save_arrays(target, **arrays)
    elif suffix == ".npy":
        (array,) = arrays.values()
        _save_array(target, array)
    else:
        channels: dict[str, NDArray[Any]] = {}
        count = len(next(iter(arrays.values())))
        for n in range(count):
            layer = make_exr_channels({name: array[n] for name, array in arrays.items()})
            channels |= {f"layer{n}.{channel}": plane for channel, plane in layer.items()}
        images.write_exr(
            target, channels, _describe_outputs({name: array[0] for name, array in arrays.items()})
        )


def _check_count(suffix: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Raise ``ValueError`` if there is no output, or more than a format holds."""
    if not arrays:
        raise ValueError("outputs must name at least one output, got none")
    if suffix in (".npy", ".png") and len(arrays) > 1:
        raise ValueError(
            f"outputs must name one output for {suffix}, got {', '.join(arrays)}; "
            ".npz and .exr hold several"
        )


def _save_array(path: Path, array: NDArray[Any]) -> None:
    """Write an array, whole or not at all."""
    with atomic_file(path) as temporary:
        np.save(temporary, array)


def _save_png(path: Path, name: str, array: NDArray[Any], scale: float | None) -> None:
    """Write one output: uint8 pictures and masks in 8 bits, all else in 16-bit codes."""
    is_mask = array.dtype == bool
    if scale is not None and (is_mask or array.dtype.kind != "f"):
        raise ValueError(f"scale must be None for {name}, which is {array.dtype}, got {scale!r}")
    if is_mask:
        images.save_image(path, np.where(array, np.uint8(255), np.uint8(0)))
    elif array.dtype == np.uint8 and array.shape[2:] in ((3,), (4,)):
        images.save_image(path, array)
    else:
        codes = encode_output(name, array, scale)
        data = images.encode_png(codes.pixels, codes.png_texts(name))
        with atomic_file(path) as temporary:
            temporary.write_bytes(data)


def encode_output(name: str, array: NDArray[Any], scale: float | None = None) -> Codes:
    """
    Encode an output in 16 bits; code 0 stands for the background.

    Parameters
    ----------
    name : str
    array : (H, W), (H, W, 1), (H, W, 2) or (H, W, 3) array
        Whole numbers of at least -1, or floats; what is infinite or NaN is nothing.
    scale : float, optional
        Units per code of floats, with offset 0, so that pictures of several frames can be compared.
        By default both come from the values of this picture: the offset is 0 and the largest value
        65535 if all are positive and the smallest is not lost, else the smallest value is 1 and
        the largest 65535.

    Returns
    -------
    Codes
        Whole numbers are one more than they were. Normals are ``32768 + 32767 n``, and 0, 0, 0
        where nothing is. Barycentric weights and normalized object coordinates go from 1 to 65535
        for 0 to 1, coverage from 0. Two channels are red and green, with blue 65535 where
        something is; motion is stored as in the KITTI flow benchmark, ``32768 + 64 pixels``, with
        blue 1.

    Raises
    ------
    ValueError
        If the values do not fit, or the array is no such output.

    References
    ----------
    M. Menze, A. Geiger, "Object Scene Flow for Autonomous Vehicles", CVPR 2015; its development
    kit for the format of flow.
    """
    if array.ndim == 3 and array.shape[2] == 1:
        # An attribute of one column.
        array = array[..., 0]
    channels = array.shape[2] if array.ndim == 3 else 1
    if array.ndim == 2 and array.dtype.kind in "iu":
        return _encode_integers(name, array)
    if array.dtype.kind != "f" or channels not in (1, 2, 3):
        raise ValueError(
            f"outputs must name one of 1 to 3 channels of floats, or of 1 of whole numbers, for a "
            f"16-bit .png; {name} is {array.shape} {array.dtype}: choose .exr or .npz"
        )
    values = array.astype(np.float64)
    valid = np.isfinite(values) if channels == 1 else np.all(np.isfinite(values), axis=2)
    row = find_row(name)
    unit, codes = row.unit, row.codes if row.channels == channels else "fitted"
    if codes == "vector":
        _refuse_scale(name, scale)
        valid &= np.any(values, axis=2)
        return _quantize_unit(values, valid, 1.0 / 32767, -32768.0 / 32767, unit)
    if codes == "cube":
        _refuse_scale(name, scale)
        # In the background all are NaN or all are 0.
        valid = valid & np.any(values, axis=2) if row.empty == 0 else valid
        step = 1.0 / (MAX_CODE - 1)
        return _quantize_unit(values, valid, step, -step, unit)
    if codes == "share":
        _refuse_scale(name, scale)
        step = 1.0 / MAX_CODE
        return Codes(_quantize(name, values, valid, step, 0.0, 0), step, 0.0, unit)
    if codes == "flow" and scale is None:
        scale, offset, valid_blue = _FLOW_SCALE, _FLOW_OFFSET, 1
    else:
        scale, offset = _fit_range(values[valid], scale)
        valid_blue = MAX_CODE
    pixels = _quantize(name, values, valid, scale, offset, 1)
    if channels == 2:
        blue = np.where(valid, np.uint16(valid_blue), np.uint16(0))
        pixels = np.dstack([pixels, blue])
        return Codes(pixels, scale, offset, unit, f"{BACKGROUND_NOTE}, where blue is 0")
    return Codes(pixels, scale, offset, unit)


def find_decimal_scale(values: NDArray[Any]) -> float | None:
    """
    Return the smallest power of ten that scales values to codes in 1..65535.

    Parameters
    ----------
    values : array
        Any shape; infinities and NaN are left out.

    Returns
    -------
    float or None
        ``None`` if no power of ten does, or there are no values.
    """
    finite = values[np.isfinite(values)].astype(np.float64)
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    if low <= 0.0:
        return None
    power = int(f"{high / MAX_CODE:e}".partition("e")[2])
    # The quotient may be rounded past a power of ten.
    scales = (float(f"1e{power + step}") for step in range(-1, 3))
    fitting = (s for s in scales if s > 0.0 and find_nearest_code(high, s) <= MAX_CODE)
    scale = next(fitting, math.inf)
    return scale if find_nearest_code(low, scale) >= 1.0 else None


def find_nearest_code(value: float, scale: float) -> float:
    """Return the nearest code of a value by a scale, half up; it may be out of range."""
    return math.floor(value / scale + 0.5)


def name_channels(name: str, count: int) -> tuple[str, ...]:
    """
    Return the names of an output's channels in an EXR file.

    Parameters
    ----------
    name : str
        ``linear`` is R, G, B, A; ``depth`` is Z; ``uv`` is uv.U and uv.V; a single channel has the
        name of its output; two and three are X, Y and Z, and four R, G, B, A of their layer. More
        columns of an attribute are numbered from 0: ``attribute:heat.0``.
    count : int
        How many there are, 1..4, of an attribute any.

    Raises
    ------
    ValueError
        If there are more.
    """
    names = find_row(name).exr
    if len(names) == count:
        return names
    if count not in _CHANNEL_NAMES and not is_attribute(name):
        raise ValueError(f"outputs must have 1 to 4 channels for .exr, got {count} in {name!r}")
    endings = _CHANNEL_NAMES.get(count) or map(str, range(count))
    return tuple(f"{name}.{part}" if part else name for part in endings)


def make_exr_channels(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """
    Return outputs as the channels of an EXR file.

    Parameters
    ----------
    arrays : mapping of str to (H, W) or (H, W, C) array
        Floats stay float32. Whole numbers become uint32, one more than they were, so that 0 is
        nothing; yes and no become float32 1 and 0. Colour is linear and multiplied by alpha: that
        of ``linear``, else of ``color``, whose sRGB is decoded.

    Returns
    -------
    dict of str to (H, W) float32 or uint32
    """
    channels: dict[str, NDArray[Any]] = {}
    for name, array in arrays.items():
        planes = np.moveaxis(_encode_exr_planes(name, array), 2, 0)
        layer = "linear" if name == "color" and "linear" not in arrays else name
        channels.update(zip(name_channels(layer, len(planes)), planes, strict=True))
    return channels


def _encode_exr_planes(name: str, array: NDArray[Any]) -> NDArray[Any]:
    """Return the channels of an output for an EXR file, (H, W, C)."""
    if array.dtype == np.uint8 and array.shape[2:] == (4,):
        from rasterjit.scene.color import srgb_to_linear

        light = srgb_to_linear(array[..., :3]).astype(np.float32)
        array = np.dstack([light, array[..., 3].astype(np.float32) / np.float32(255)])
    if name in ("color", "linear") and array.shape[2:] == (4,):
        array = np.dstack([array[..., :3] * array[..., 3:], array[..., 3]])
    planes = array if array.ndim == 3 else array[:, :, None]
    if planes.dtype.kind not in "iu":
        return planes.astype(np.float32)
    numbers = planes.astype(np.int64) + 1
    if numbers.min() < 0 or numbers.max() >= 1 << 32:
        raise ValueError(f"outputs must have whole numbers from -1 for .exr, got {name}")
    return numbers.astype(np.uint32)


def _describe_outputs(arrays: Mapping[str, NDArray[Any]]) -> dict[str, str]:
    """Return the header entries of an EXR file that describe each output."""
    entries = {"software": "RasterJIT"}
    for name, array in arrays.items():
        if array.dtype.kind in "iu" and array.ndim == 2:
            entries[f"rasterjit.{name}"] = f"number + 1; 0 where {BACKGROUND_NOTE}"
        elif name in ("color", "linear"):
            entries[f"rasterjit.{name}"] = "linear light, sRGB primaries, multiplied by alpha"
        elif find_row(name).unit:
            entries[f"rasterjit.{name}"] = find_row(name).unit
    return entries


def select_arrays(
    arrays: Mapping[str, NDArray[Any]], names: str | Iterable[str] | None
) -> dict[str, NDArray[Any]]:
    """
    Return the named outputs of a frame, in the order of the names.

    Parameters
    ----------
    arrays : mapping of str to array
    names : str or iterable of str, optional
        Default: all.

    Raises
    ------
    ValueError
        If ``names`` is something else, or names an output that the frame has not.
    """
    if names is None:
        return dict(arrays)
    try:
        selected = [names] if isinstance(names, str) else list(check.sequence("outputs", names))
    except TypeError:
        raise ValueError(f"outputs must be a name or names, got {check.brief(names)}") from None
    for name in selected:
        if not isinstance(name, str) or name not in arrays:
            raise ValueError(
                f"outputs must be among what was rendered ({', '.join(arrays)}), got {name!r}"
            )
    return {name: arrays[name] for name in selected}


def _encode_integers(name: str, array: NDArray[Any]) -> Codes:
    """Encode integers of at least -1, each plus one."""
    numbers = array.astype(np.int64) + 1
    low, high = int(numbers.min()), int(numbers.max())
    if low < 0 or high > MAX_CODE:
        raise ValueError(
            f"outputs must lie in -1..{MAX_CODE - 1} for a 16-bit .png, {name} has {low - 1}.."
            f"{high - 1}: choose .exr or .npz"
        )
    return Codes(numbers.astype(np.uint16), 1.0, -1.0, "number")


def _quantize_unit(values: Float64, valid: Bool, scale: float, offset: float, unit: str) -> Codes:
    """Encode vectors of a known range in codes from 1, clamped against rounding."""
    codes = np.floor((np.where(valid[..., None], values, 0.0) - offset) / scale + 0.5)
    pixels = np.where(valid[..., None], np.clip(codes, 1, MAX_CODE), 0).astype(np.uint16)
    return Codes(pixels, scale, offset, unit)


def _fit_range(values: Float64, scale: float | None) -> tuple[float, float]:
    """Return scale and offset that take finite values to codes in 1..65535."""
    if scale is not None:
        return check.positive_number("scale", scale), 0.0
    if not values.size:
        return 1.0, 0.0
    low, high = float(values.min()), float(values.max())
    scale = high / MAX_CODE
    if low >= scale > 0.0:
        return scale, 0.0
    scale = (high - low) / (MAX_CODE - 1)
    if scale <= 0.0:
        scale = 1.0
    return scale, low - scale


def _quantize(
    name: str, values: Float64, valid: Bool, scale: float, offset: float, min_code: int
) -> NDArray[np.uint16]:
    """Return the nearest codes, half up, and 0 for invalid values; raise if they do not fit."""
    rounded = np.floor((values[valid] - offset) / scale + 0.5)
    if rounded.size and not (min_code <= rounded.min() and rounded.max() <= MAX_CODE):
        fitting = find_decimal_scale(values[valid])
        choices = ".exr or .npz" if fitting is None else f"{fitting:g}, .exr or .npz"
        raise ValueError(
            f"scale must take {name} to codes in {min_code}..{MAX_CODE} of a 16-bit .png, got "
            f"{rounded.min():.0f}..{rounded.max():.0f} with scale={scale!r}; choose {choices}"
        )
    codes = np.zeros(values.shape, np.uint16)
    codes[valid] = rounded
    return codes


def _refuse_scale(name: str, scale: float | None) -> None:
    """Raise ``ValueError`` if an output of a known range is given a scale."""
    if scale is not None:
        raise ValueError(f"scale must be None for {name}, whose range is known, got {scale!r}")
