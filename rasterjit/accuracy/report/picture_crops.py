"""Crop the pictures that a page shows: of each quality, beside the reference."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Study, Trial, list_settings

CROP_SIZES = ((160, 120), (128, 96), (96, 72), (64, 48), (48, 36))
"""Columns and rows of a crop: the first is taken that keeps a page small."""

HEAT_COLORMAP = "inferno"
"""matplotlib's colour map of errors: dark is small; its brightness rises evenly."""

MAX_EXCESS = 1e-6
"""Share by which an error may exceed the end of the scale: float32 rounds 0.2 up."""

MAX_THUMBNAIL_SIDE = 160
"""Most columns and rows of the small picture that shows where crops lie."""


class Crop(NamedTuple):
    """A part of a picture, pixels."""

    column: int
    row: int
    width: int
    height: int

    def of(self, picture: NDArray) -> NDArray:
        """Return this part of an (H, W, ...) array."""
        rows = slice(self.row, self.row + self.height)
        return picture[rows, self.column : self.column + self.width]


def choose_crop(
    error_maps: Sequence[NDArray[np.float32]], size: tuple[int, int] = CROP_SIZES[0]
) -> Crop:
    """
    Return the part of a picture where the levels of a setting differ most.

    Parameters
    ----------
    error_maps : sequence of (H, W) float32
        Errors of its levels, at least one.
    size : (int, int)
        Columns and rows.

    Returns
    -------
    Crop
        Around the window of half its size over which the squared difference between the largest
        and the least error of a pixel adds up to most; where all levels have the same errors, the
        squared error. The uppermost, then leftmost of equal ones. Smaller than ``size`` where
        the picture is.
    """
    stack = np.stack(error_maps).astype(np.float64)
    ranges = stack.max(axis=0) - stack.min(axis=0)
    weights = (ranges if ranges.any() else stack.max(axis=0)) ** 2
    rows, columns = weights.shape
    width, height = min(size[0], columns), min(size[1], rows)
    inner_width, inner_height = (width + 1) // 2, (height + 1) // 2
    row, column = _find_heaviest_window(weights, inner_width, inner_height)
    row = min(max(row - (height - inner_height) // 2, 0), rows - height)
    column = min(max(column - (width - inner_width) // 2, 0), columns - width)
    return Crop(column, row, width, height)


def _find_heaviest_window(weights: NDArray[np.float64], width: int, height: int) -> tuple[int, int]:
    """Return row and column of the window with the largest sum, by a summed-area table."""
    sums = np.pad(weights.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    windows = (
        sums[height:, width:] - sums[:-height, width:]
        - sums[height:, :-width] + sums[:-height, :-width]
    )  # fmt: skip
    row, column = np.unravel_index(int(windows.argmax()), windows.shape)
    return int(row), int(column)


def round_up_largest_error(errors: Sequence[NDArray[np.float32]]) -> float:
    """Return the largest error, rounded up to 1, 2 or 5 times 10^n; 1 without errors."""
    largest = max(float(error.max()) for error in errors)
    if largest <= 0.0:
        return 1.0
    decade = math.floor(math.log10(largest))
    candidates = [float(f"{digit}e{decade}") for digit in (1, 2, 5, 10)]
    return next(end for end in candidates if largest <= end * (1.0 + MAX_EXCESS))


def heat_map(errors: NDArray[np.float32], max_error: float) -> NDArray[np.uint8]:
    """
    Return errors as colours, on a linear scale from 0 to ``max_error``.

    Parameters
    ----------
    errors : (H, W) float32
    max_error : float
        Error that is shown brightest, above 0.

    Returns
    -------
    (H, W, 3) uint8, sRGB
    """
    import matplotlib

    table = np.array(matplotlib.colormaps[HEAT_COLORMAP].colors)
    codes = np.floor(table * 255.0 + 0.5).astype(np.uint8)
    levels = np.clip(np.asarray(errors, np.float64) / max_error, 0.0, 1.0)
    return codes[np.floor(levels * (len(codes) - 1) + 0.5).astype(np.int64)]


def make_thumbnail(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an (H, W, 3) picture made small enough to show where a crop lies."""
    from PIL import Image

    image = Image.fromarray(picture)
    image.thumbnail((MAX_THUMBNAIL_SIDE, MAX_THUMBNAIL_SIDE))
    return np.asarray(image)


def encode_webp_uri(picture: NDArray[np.uint8]) -> str:
    """Return an (H, W, 3) uint8 picture as a ``data:`` address of a lossless WebP."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(buffer, "WEBP", lossless=True, method=4)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


MAX_ALBUM_BYTES = 1_500_000
"""Most bytes of all pictures of a page, which is meant to be sent by mail."""

MAX_SHOWN_ERROR = np.float32(1.0)
"""Error of linear light above which a screen shows white anyway: larger ones are shown as this."""


class Shot(NamedTuple):
    """A crop of a picture and of its errors, as addresses; equal pictures share one."""

    name: str
    caption: str
    color: str
    error: str


class ShotGroup(NamedTuple):
    """Qualities that are shown in the crop where they differ most."""

    title: str
    crop: Crop
    max_error: float
    """Error that is shown brightest."""
    reference: str
    shots: list[Shot]


class Album(NamedTuple):
    """The crops of all pictures of a page."""

    groups: list[ShotGroup]
    size: tuple[int, int]
    """Columns and rows of a crop."""
    ids: dict[str, str]
    """Name of each trial's shot, by label."""


def make_album(study: Study) -> Album:
    """Return the crops of a study's pictures, the largest that fit into `MAX_ALBUM_BYTES`."""
    for size in CROP_SIZES:
        album = _make_album(study, size)
        if count_bytes(album) <= MAX_ALBUM_BYTES:
            break
    return album


def count_bytes(album: Album) -> int:
    """Return the length of the addresses of all pictures."""
    return sum(
        len(group.reference) + sum(len(shot.color) + len(shot.error) for shot in group.shots)
        for group in album.groups
    )


def _make_album(study: Study, size: tuple[int, int]) -> Album:
    """Return the crops of a size: columns and rows."""
    groups: list[ShotGroup] = []
    ids: dict[str, str] = {}
    for title, trials in _group_trials(study):
        group, group_ids = _make_group(study, title, trials, size, len(ids))
        groups.append(group)
        ids.update(group_ids)
    crop = groups[0].crop
    return Album(groups, (crop.width, crop.height), ids)


def _group_trials(study: Study) -> Iterator[tuple[str, list[Trial]]]:
    """Yield title and trials of each group: the standard and the front, then each setting."""
    front = set(study.front)
    yield (
        "Worth choosing",
        [study.standard, *(trial for trial in study.trials if trial.label in front)],
    )
    for setting in (*list_settings(study), COMBINATIONS):
        rest = [trial for trial in study.of(setting) if trial.label not in front]
        if rest:
            yield setting, rest


def _make_group(
    study: Study, title: str, trials: list[Trial], size: tuple[int, int], count: int
) -> tuple[ShotGroup, dict[str, str]]:
    """Return a group, its shots numbered behind ``count``, and each trial's shot by label."""
    errors = [np.minimum(trial.error_map, MAX_SHOWN_ERROR) for trial in (study.standard, *trials)]
    crop = choose_crop(errors, size)
    errors = [crop.of(error) for error in errors[1:]]
    max_error = round_up_largest_error(errors)
    trials_by_picture: dict[tuple[str, str], list[Trial]] = {}
    for trial, error in zip(trials, errors, strict=True):
        pictures = crop.of(trial.color), heat_map(error, max_error)
        color, heat = (encode_webp_uri(picture) for picture in pictures)
        trials_by_picture.setdefault((color, heat), []).append(trial)
    shots: list[Shot] = []
    ids: dict[str, str] = {}
    for number, ((color, heat), same_trials) in enumerate(trials_by_picture.items(), count + 1):
        labels = [_caption(trial) for trial in same_trials]
        shots.append(Shot(f"shot-{number}", "; ".join(labels), color, heat))
        ids |= {trial.label: f"shot-{number}" for trial in same_trials}
    reference = encode_webp_uri(crop.of(study.reference_color))
    return ShotGroup(title, crop, max_error, reference, shots), ids


def _caption(trial: Trial) -> str:
    return STANDARD if trial.setting == STANDARD else trial.label
