"""Gather the parts of pictures that a page shows: of each quality, beside the reference."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rasterjit.accuracy.report import crops
from rasterjit.accuracy.report.crops import CROP_SIZES, Crop
from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Study, Trial, settings_of

MOST_BYTES = 1_500_000
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
    """Return the parts of a study's pictures, the largest that `MOST_BYTES` has room for."""
    for size in CROP_SIZES:
        album = _album(study, size)
        if bytes_of(album) <= MOST_BYTES:
            break
    return album


def bytes_of(album: Album) -> int:
    """Return how long the addresses of all pictures are."""
    return sum(
        len(group.reference) + sum(len(shot.color) + len(shot.error) for shot in group.shots)
        for group in album.groups
    )


def thumbnail(study: Study) -> str:
    """Return the reference, small, as an address."""
    return crops.webp_uri(crops.thumbnail(study.reference_color))


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
    crop = crops.choose_crop(errors, size)
    errors = [crop.of(error) for error in errors[1:]]
    top = crops.heat_top(errors)
    alike: dict[tuple[str, str], list[Trial]] = {}
    for trial, error in zip(trials, errors, strict=True):
        pictures = crop.of(trial.color), crops.heat(error, top)
        color, heat = (crops.webp_uri(picture) for picture in pictures)
        alike.setdefault((color, heat), []).append(trial)
    shots: list[Shot] = []
    names: dict[str, str] = {}
    for number, ((color, heat), sharing) in enumerate(alike.items(), count + 1):
        labels = [_caption(trial) for trial in sharing]
        shots.append(Shot(f"shot-{number}", "; ".join(labels), color, heat))
        names |= {trial.label: f"shot-{number}" for trial in sharing}
    reference = crops.webp_uri(crop.of(study.reference_color))
    return ShotGroup(title, crop, top, reference, shots), names


def _caption(trial: Trial) -> str:
    """Return what a trial is called below its picture."""
    return STANDARD if trial.setting == STANDARD else trial.label
