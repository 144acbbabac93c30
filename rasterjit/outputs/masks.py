"""
Find the masks of objects, their boxes and areas, and write COCO annotations of them.

COCO codes a mask as the lengths of its runs: pixels run column by column, from the top, and the
first run is outside, of length 0 if the first pixel is inside. Compressed, each length but the
first three is the difference to the one two before, in groups of five bits from the lowest, each a
printable character from ``"0"`` on, with the sixth bit set where more groups follow.

References
----------
.. [1] T.-Y. Lin et al., "Microsoft COCO: Common Objects in Context", ECCV 2014; cocodataset.org,
   "Data format".
.. [2] COCO API, ``common/maskApi``: the format of compressed masks.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.io.atomic_write import atomic_file
from rasterjit.io.images import check_save_path
from rasterjit.scene.validation import brief, sequence, unmasked_array

_GROUP_BITS, _GROUP_MASK, _SIGN_BIT, _CONTINUATION_BIT, _FIRST_CHARACTER = 5, 0x1F, 0x10, 0x20, 48
"""Compressed lengths: bits of a character, their mask, sign bit, continuation bit, code of "0"."""
_MAX_UINT16 = 65535
"""Largest uint16."""
_MAX_GROUPS = 13
"""Most characters of a 64-bit number."""
_MAX_LISTED = 8
"""Most objects that a message names."""
_INT64_LIMIT = 1 << 63
"""First number above int64."""


@dataclass(frozen=True, eq=False)
class ObjectMask:
    """
    The pixels of one object.

    Attributes
    ----------
    id : int
        Number of the object in the image.
    size : (int, int)
        Height and width of the image, pixels: COCO's order.
    counts : (N,) int64
        Lengths of the runs, column by column: outside, inside, outside ...
    box : (int, int, int, int)
        Left column, top row, width and height of the visible part, pixels.
    area : int
        Number of pixels inside.
    """

    id: int
    size: tuple[int, int]
    counts: NDArray[np.int64]
    box: tuple[int, int, int, int]
    area: int

    def __repr__(self) -> str:
        height, width = self.size
        return f"ObjectMask({self.id}: {self.area} of {width} x {height} pixels, box {self.box})"

    def array(self) -> NDArray[np.bool_]:
        """Return the mask, (H, W) bool."""
        return decode(self.rle())

    def rle(self) -> dict[str, Any]:
        """Return COCO's uncompressed code: ``{"size": [H, W], "counts": [int, ...]}``."""
        return {"size": list(self.size), "counts": self.counts.tolist()}

    def compressed_rle(self) -> dict[str, Any]:
        """Return COCO's compressed code: ``{"size": [H, W], "counts": str}``."""
        return {"size": list(self.size), "counts": compress(self.counts)}


def find(ids: ArrayLike, name: str = "ids") -> tuple[ObjectMask, ...]:
    """
    Return the mask of every object number in an image.

    Parameters
    ----------
    ids : (H, W) array_like of int
        Such as ``Frame.object_id``; negative numbers are nothing.
    name : str
        What errors call them.

    Raises
    ------
    ValueError
        If ``ids`` is not such an array.
    """
    id_image = unmasked_array(name, ids)
    if id_image.ndim != 2 or id_image.dtype.kind not in "iu" or id_image.size == 0:
        raise ValueError(f"{name} must be (H, W) whole numbers, not empty; got {brief(id_image)}")
    columns = np.ascontiguousarray(id_image.T).ravel()
    positions = np.flatnonzero(columns >= 0)
    if not len(positions):
        return ()
    ids_inside = columns[positions]
    if ids_inside.max() <= _MAX_UINT16:
        # NumPy sorts 16 bits by their digits, in half the time.
        ids_inside = ids_inside.astype(np.uint16)
    # Group the pixels by id; inside each, they stay column by column.
    order = np.argsort(ids_inside, kind="stable")
    positions, ids_inside = positions[order], ids_inside[order]
    starts = np.flatnonzero(np.diff(ids_inside.astype(np.int64), prepend=-1))
    return tuple(
        _make_mask(int(ids_inside[start]), pixels, id_image.shape)
        for start, pixels in zip(starts, np.split(positions, starts[1:]), strict=True)
    )


def encode(mask: ArrayLike) -> ObjectMask:
    """
    Return a mask as an `ObjectMask` with ``id`` 1.

    Parameters
    ----------
    mask : (H, W) array_like of bool
        It may be empty: then the box is 0, 0, 0, 0.

    Raises
    ------
    ValueError
        If ``mask`` is not such an array.
    """
    inside = unmasked_array("mask", mask)
    if inside.ndim != 2 or inside.dtype != bool or inside.size == 0:
        raise ValueError(f"mask must be (H, W) bool, not empty; got {brief(inside)}")
    return _make_mask(1, np.flatnonzero(np.ascontiguousarray(inside.T)), inside.shape)


def decode(rle: Mapping[str, Any]) -> NDArray[np.bool_]:
    """
    Decode a COCO run-length code to a mask, (H, W) bool.

    Parameters
    ----------
    rle : mapping
        ``size``: [H, W]; ``counts``: a list of int, or the compressed str or bytes.

    Raises
    ------
    ValueError
        If ``rle`` is no such mapping, or its counts do not add up to H W.
    """
    try:
        height, width = (int(side) for side in rle["size"])
        counts = rle["counts"]
        if isinstance(counts, (str, bytes)):
            counts = decompress(counts)
        lengths = unmasked_array("counts", counts)
        if lengths.size and lengths.dtype.kind not in "iu":
            raise TypeError
        lengths = lengths.astype(np.int64)
    except (KeyError, IndexError, TypeError, ValueError, OverflowError):
        raise ValueError(f"rle must hold size [H, W] and counts, got {brief(rle)}") from None
    if height < 0 or width < 0:
        raise ValueError(f"rle must have a size of at least 0, got {height} x {width}")
    if lengths.ndim != 1 or (lengths < 0).any() or sum(lengths.tolist()) != height * width:
        raise ValueError(f"rle must have counts that add up to {height} x {width} pixels")
    inside = np.arange(len(lengths)) % 2 == 1
    return np.ascontiguousarray(np.repeat(inside, lengths).reshape(width, height).T)


def compress(counts: ArrayLike) -> str:
    """
    Encode run lengths as COCO's compressed string.

    Parameters
    ----------
    counts : (N,) array_like of int

    Raises
    ------
    ValueError
        If ``counts`` are no whole numbers of at least 0.
    """
    lengths = unmasked_array("counts", counts)
    if lengths.ndim != 1 or lengths.dtype.kind not in "iu" or (lengths < 0).any():
        raise ValueError(f"counts must be whole numbers from 0, got {brief(counts)}")
    remaining = lengths.astype(np.int64)
    remaining[3:] -= lengths[1:-2].astype(np.int64)
    codes = np.zeros((len(remaining), _MAX_GROUPS), np.uint8)
    is_used = np.zeros(codes.shape, bool)
    is_active = np.ones(len(remaining), bool)
    for group in range(_MAX_GROUPS):
        is_used[:, group] = is_active
        bits = remaining & _GROUP_MASK
        remaining >>= _GROUP_BITS
        # The last group's sign bit stands for all higher bits.
        has_more = remaining != np.where(bits & _SIGN_BIT, -1, 0)
        codes[:, group] = bits + np.where(has_more, _CONTINUATION_BIT, 0) + _FIRST_CHARACTER
        is_active = is_active & has_more
        if not is_active.any():
            break
    return codes[is_used].tobytes().decode("ascii")


def decompress(text: str | bytes) -> NDArray[np.int64]:
    """
    Decode COCO's compressed string to run lengths, (N,) int64.

    Raises
    ------
    ValueError
        If ``text`` is no such string.
    """
    if not isinstance(text, (str, bytes, bytearray)):
        raise ValueError(f"text must be a compressed mask, got {brief(text)}")
    data = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else bytes(text)
    lengths: list[int] = []
    value = shift = 0
    for byte in data:
        code = byte - _FIRST_CHARACTER
        if not 0 <= code < 2 * _CONTINUATION_BIT or shift >= _MAX_GROUPS * _GROUP_BITS:
            raise ValueError(f"text must be a compressed mask, got {brief(text)}")
        value |= (code & _GROUP_MASK) << shift
        shift += _GROUP_BITS
        if code & _CONTINUATION_BIT:
            continue
        if code & _SIGN_BIT:
            value -= 1 << shift
        lengths.append(value + (lengths[-2] if len(lengths) > 2 else 0))
        value = shift = 0
        if not -_INT64_LIMIT <= lengths[-1] < _INT64_LIMIT:
            raise ValueError(f"text must be a compressed mask, got {brief(text)}")
    if shift:
        raise ValueError(f"text must be a whole compressed mask, got {brief(text)}")
    return np.array(lengths, np.int64)


def coco(
    images: Iterable[tuple[str | PurePath, ArrayLike]],
    categories: Sequence[str | None] | Mapping[int, str | None],
    *,
    info: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """
    Return a COCO instance annotation of images, as its JSON file holds it.

    Parameters
    ----------
    images : iterable of (str or path, (H, W) array_like of int)
        File name and numbers of the objects, such as ``Frame.object_id``, of each image.
    categories : sequence of str or None, or mapping of int to str or None
        The category of each object that the images show, by its number; None leaves an object out:
        the floor, say.
    info : mapping, optional
        What the annotation says of itself.

    Returns
    -------
    dict
        ``info``, ``images``, ``annotations`` and ``categories``, numbered from 1. Segmentations are
        compressed run lengths, boxes [x, y, width, height], areas pixels; each annotation holds its
        object's number as ``object_id``, too.

    Raises
    ------
    ValueError
        If ``images`` or ``categories`` are no such things, or an image shows an object of which
        ``categories`` says nothing.
    """
    # Number the categories by first use.
    info = {} if info is None else info
    if not isinstance(info, Mapping):
        raise ValueError(f"info must be a mapping or None, got {brief(info)}")
    category_of = _check_categories(categories)
    names = dict.fromkeys(name for name in category_of.values() if name is not None)
    category_ids = {name: number for number, name in enumerate(names, 1)}
    document: dict[str, Any] = {
        "info": dict(info),
        "images": [],
        "annotations": [],
        "categories": [{"id": number, "name": name} for name, number in category_ids.items()],
    }
    # Add each image and the masks in it.
    for image_id, image in enumerate(sequence("images", images), 1):
        try:
            file_name, ids = image
        except (TypeError, ValueError):
            raise ValueError(
                f"images must be pairs of a file name and numbers, got {brief(image)}"
            ) from None
        if not isinstance(file_name, (str, PurePath)):
            raise ValueError(f"images must have file names, got {brief(file_name)}")
        file_name = file_name.as_posix() if isinstance(file_name, PurePath) else file_name
        masks = find(ids, f"images: the numbers of {file_name!r}")
        height, width = np.shape(ids)
        missing = [str(mask.id) for mask in masks if mask.id not in category_of]
        if missing:
            more = " ..." if missing[_MAX_LISTED:] else ""
            raise ValueError(
                f"categories must have an entry for each object that {file_name!r} shows, its "
                f"name, or None to leave it out; got none for "
                f"{', '.join(missing[:_MAX_LISTED])}{more}"
            )
        document["images"].append(
            {"id": image_id, "file_name": file_name, "width": width, "height": height}
        )
        pairs = ((mask, category_of[mask.id]) for mask in masks)
        annotated_masks = ((mask, category) for mask, category in pairs if category is not None)
        document["annotations"] += [
            {
                "id": len(document["annotations"]) + number,
                "image_id": image_id,
                "category_id": category_ids[category],
                "object_id": mask.id,
                "segmentation": mask.compressed_rle(),
                "bbox": list(mask.box),
                "area": mask.area,
                "iscrowd": 0,
            }
            for number, (mask, category) in enumerate(annotated_masks, 1)
        ]
    return document


def save_coco(
    path: str | Path,
    images: Iterable[tuple[str | PurePath, ArrayLike]],
    categories: Sequence[str | None] | Mapping[int, str | None],
    *,
    info: Mapping[str, Any] | None = None,
) -> None:
    """
    Write a COCO instance annotation atomically; takes the arguments of `coco`.

    Raises
    ------
    ValueError
        If the path does not end in ``.json``, its folder does not exist, or as for `coco`.
    OSError
        If the file cannot be written; an existing one is left as it was.
    """
    target = check_save_path(path, (".json",))
    text = json.dumps(coco(images, categories, info=info))
    with atomic_file(target) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _check_categories(categories: Any) -> dict[int, str | None]:
    """Return the category of each object by its number, or raise ``ValueError``."""
    if isinstance(categories, Mapping):
        category_of = dict(categories)
    elif isinstance(categories, Sequence) and not isinstance(categories, (str, bytes)):
        category_of = dict(enumerate(categories))
    else:
        raise ValueError(
            f"categories must be names by the objects' numbers, got {brief(categories)}"
        )
    for number, name in category_of.items():
        is_name = name is None or (isinstance(name, str) and name)
        if not isinstance(number, (int, np.integer)) or not is_name:
            raise ValueError(f"categories must be names by number, got {number!r}: {name!r}")
    return {int(number): name for number, name in category_of.items()}


def _make_mask(number: int, positions: NDArray[np.int64], shape: tuple[int, ...]) -> ObjectMask:
    """Return the mask of ascending positions, counted column by column."""
    height, width = shape
    # Split runs where the next position is not the next pixel.
    run_starts = np.flatnonzero(np.diff(positions, prepend=-2) != 1)
    run_ends = np.append(run_starts[1:], len(positions))[: len(run_starts)] - 1
    run_bounds = np.stack([positions[run_starts], positions[run_ends] + 1], axis=1).ravel()
    edges = np.concatenate([[0], run_bounds, [height * width]])
    counts = np.diff(edges)
    if len(counts) > 1 and counts[-1] == 0:
        counts = counts[:-1]
    box = (0, 0, 0, 0)
    if len(positions):
        columns, rows = np.divmod(positions, height)
        left, top = int(columns[0]), int(rows.min())
        box = (left, top, int(columns[-1]) - left + 1, int(rows.max()) - top + 1)
    return ObjectMask(number, (height, width), counts.astype(np.int64), box, len(positions))
