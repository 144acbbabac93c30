"""Gather the parts of pictures that a page shows: of each quality, beside the reference."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Study, Trial, settings_of

CROP_SIZES = ((160, 120), (128, 96), (96, 72), (64, 48), (48, 36))
"""Columns and rows of a crop, from the best on: the largest is taken that keeps a page small."""

HEAT_COLORS = "inferno"
"""matplotlib's colour map of errors: dark is small; its brightness rises evenly."""

SLACK = 1e-6
"""Share by which an error may exceed the top of the scale: float32 rounds 0.2 up."""

THUMBNAIL_WIDTH = 160
"""Columns, or rows where there are more of them, of the picture that shows where crops lie."""


class Crop(NamedTuple):
    """A part of a picture, pixels."""

    column: int
    row: int
    width: int
    height: int

    def of(self, picture: NDArray) -> NDArray:
        """Return that part of an (H, W, ...) array."""
        rows = slice(self.row, self.row + self.height)
        return picture[rows, self.column : self.column + self.width]


def choose_crop(
    error_maps: Sequence[NDArray[np.float32]], size: tuple[int, int] = CROP_SIZES[0]
) -> Crop:
    """
    Return where to look to see what a setting changes.

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
    differing = stack.max(axis=0) - stack.min(axis=0)
    weights = (differing if differing.any() else stack.max(axis=0)) ** 2
    rows, columns = weights.shape
    width, height = min(size[0], columns), min(size[1], rows)
    inner_width, inner_height = (width + 1) // 2, (height + 1) // 2
    row, column = _heaviest_window(weights, inner_width, inner_height)
    row = min(max(row - (height - inner_height) // 2, 0), rows - height)
    column = min(max(column - (width - inner_width) // 2, 0), columns - width)
    return Crop(column, row, width, height)


def _heaviest_window(weights: NDArray[np.float64], width: int, height: int) -> tuple[int, int]:
    """Return row and column of the window with the largest sum, by a summed-area table."""
    sums = np.pad(weights.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    windows = (
        sums[height:, width:] - sums[:-height, width:]
        - sums[height:, :-width] + sums[:-height, :-width]
    )  # fmt: skip
    row, column = np.unravel_index(int(windows.argmax()), windows.shape)
    return int(row), int(column)


def heat_top(errors: Sequence[NDArray[np.float32]]) -> float:
    """Return the error that is shown brightest: the largest, rounded up to 1, 2 or 5 times 10^n."""
    largest = max(float(error.max()) for error in errors)
    if largest <= 0.0:
        return 1.0
    decade = math.floor(math.log10(largest))
    tops = [float(f"{digit}e{decade}") for digit in (1, 2, 5, 10)]
    return next(top for top in tops if largest <= top * (1.0 + SLACK))


def heat_map(error: NDArray[np.float32], top: float) -> NDArray[np.uint8]:
    """
    Return errors as colours, on a linear scale from 0 to ``top``.

    Parameters
    ----------
    error : (H, W) float32
    top : float
        What is shown brightest, above 0.

    Returns
    -------
    (H, W, 3) uint8, sRGB
    """
    import matplotlib

    table = np.array(matplotlib.colormaps[HEAT_COLORS].colors)
    codes = np.floor(table * 255.0 + 0.5).astype(np.uint8)
    share = np.clip(np.asarray(error, np.float64) / top, 0.0, 1.0)
    return codes[np.floor(share * (len(codes) - 1) + 0.5).astype(np.int64)]


def thumbnail(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an (H, W, 3) picture made small enough to show where a crop lies."""
    from PIL import Image

    image = Image.fromarray(picture)
    image.thumbnail((THUMBNAIL_WIDTH, THUMBNAIL_WIDTH))
    return np.asarray(image)


def webp_uri(picture: NDArray[np.uint8]) -> str:
    """Return an (H, W, 3) uint8 picture as a WebP without loss, in a ``data:`` address."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(buffer, "WEBP", lossless=True, method=4)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


MAX_BYTES = 1_500_000
"""Of all pictures together: the page has some more, and is meant to be sent by mail."""

BRIGHTEST = np.float32(1.0)
"""Errors of linear light beyond it are not told apart: the screen shows both sides as white."""


class Shot(NamedTuple):
    """A part of a picture and its errors, as addresses; qualities that look alike share it."""

    name: str
    caption: str
    color: str
    error: str


class ShotGroup(NamedTuple):
    """Qualities that are shown at one place: where they differ most."""

    title: str
    crop: Crop
    top: float
    reference: str
    shots: list[Shot]


class Album(NamedTuple):
    """All groups, the columns and rows of a part, and the name of each trial's shot by label."""

    groups: list[ShotGroup]
    size: tuple[int, int]
    ids: dict[str, str]


def make_album(study: Study) -> Album:
    """Return the parts of a study's pictures, the largest that `MAX_BYTES` has room for."""
    for size in CROP_SIZES:
        album = _album(study, size)
        if bytes_of(album) <= MAX_BYTES:
            break
    return album


def bytes_of(album: Album) -> int:
    """Return how long the addresses of all pictures are."""
    return sum(
        len(group.reference) + sum(len(shot.color) + len(shot.error) for shot in group.shots)
        for group in album.groups
    )


def _album(study: Study, size: tuple[int, int]) -> Album:
    """Return the parts of so many columns and rows."""
    groups: list[ShotGroup] = []
    ids: dict[str, str] = {}
    for title, trials in _groups(study):
        group, names = _group(study, title, trials, size, len(ids))
        groups.append(group)
        ids.update(names)
    crop = groups[0].crop
    return Album(groups, (crop.width, crop.height), ids)


def _groups(study: Study) -> Iterator[tuple[str, list[Trial]]]:
    """Yield the standard with the front, then the others, setting by setting."""
    front = set(study.front)
    yield (
        "Worth choosing",
        [study.standard, *(trial for trial in study.trials if trial.label in front)],
    )
    for setting in (*settings_of(study), COMBINATIONS):
        rest = [trial for trial in study.of(setting) if trial.label not in front]
        if rest:
            yield setting, rest


def _group(
    study: Study, title: str, trials: list[Trial], size: tuple[int, int], count: int
) -> tuple[ShotGroup, dict[str, str]]:
    """Return a group, its shots numbered from ``count`` on, and which of them each trial has."""
    errors = [np.minimum(trial.error_map, BRIGHTEST) for trial in (study.standard, *trials)]
    crop = choose_crop(errors, size)
    errors = [crop.of(error) for error in errors[1:]]
    top = heat_top(errors)
    alike: dict[tuple[str, str], list[Trial]] = {}
    for trial, error in zip(trials, errors, strict=True):
        pictures = crop.of(trial.color), heat_map(error, top)
        color, heat = (webp_uri(picture) for picture in pictures)
        alike.setdefault((color, heat), []).append(trial)
    shots: list[Shot] = []
    names: dict[str, str] = {}
    for number, ((color, heat), sharing) in enumerate(alike.items(), count + 1):
        labels = [_caption(trial) for trial in sharing]
        shots.append(Shot(f"shot-{number}", "; ".join(labels), color, heat))
        names |= {trial.label: f"shot-{number}" for trial in sharing}
    reference = webp_uri(crop.of(study.reference_color))
    return ShotGroup(title, crop, top, reference, shots), names


def _caption(trial: Trial) -> str:
    """Return what a trial is called below its picture."""
    return STANDARD if trial.setting == STANDARD else trial.label
