"""Measure once the times and errors of qualities on this machine, for ``quality_selection``."""

from __future__ import annotations

import statistics
from pathlib import Path

from rasterjit.accuracy.settings_to_try import Attempt
from rasterjit.accuracy.study import Studio
from rasterjit.accuracy.test_scenes import make
from rasterjit.accuracy.timing import Progress, total
from rasterjit.rendering.quality_selection import (
    LADDER,
    Profile,
    QualityStep,
    front_of_steps,
    light_of,
    root_mean_square,
    save_profile,
)
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.quality import SUPERSAMPLED, Quality
from rasterjit.scene.validation import thread_count

SCENES_USED = ("highlights", "shadows", "glass", "floor")
"""Test scenes with different costs: light, shadows, layers, textures."""

ROUNDS = 7
"""Frames of each quality, by turns, that a time is the median of; of many pictures, one."""

LIGHT = ("color", "linear")
"""Outputs that errors are measured on."""


def calibrate(
    *, threads: int | None = None, progress: Progress | None = None
) -> tuple[Profile, Path]:
    """
    Draw made scenes in these qualities; keep their times and errors in the cache folder.

    What ``render(time_budget=...)`` chooses from are those qualities that no other is both faster
    and more accurate than.

    Parameters
    ----------
    threads : int, optional
        Default: all processors.
    progress : callable, optional
        Called with what is being done, how much of it is done, and how much there is.

    Returns
    -------
    Profile
    Path
        The file that it is kept in, whole.

    Raises
    ------
    ValueError
        If the number of threads is wrong, or the cache folder cannot be written.
    """
    thread_count("threads", threads)
    times: dict[Quality, list[float]] = {quality: [] for quality in LADDER}
    errors: dict[Quality, list[float]] = {quality: [] for quality in LADDER}
    for number, name in enumerate(SCENES_USED):
        if progress is not None:
            progress(f"drawing {name}", number, len(SCENES_USED))
        made = make(name)
        with Studio(made.scene, made.camera, made.size, threads) as studio:
            for quality, error in _errors(studio).items():
                errors[quality].append(error)
            for quality, time in _times(studio).items():
                times[quality].append(time)
    steps = [
        QualityStep(quality, statistics.median(times[quality]), statistics.median(errors[quality]))
        for quality in LADDER
    ]
    profile = Profile(front_of_steps(steps), threads or available_processors())
    return profile, save_profile(profile)


def _errors(studio: Studio) -> dict[Quality, float]:
    """Return the error of each quality over that of the standard; compiles what it takes."""
    reference = light_of(studio.draw(Quality.reference(), LIGHT))
    errors = {
        quality: root_mean_square(light_of(studio.draw(quality, LIGHT)) - reference)
        for quality in LADDER[:-1]
    }
    errors[LADDER[-1]] = 0.0
    base = errors[Quality.standard()]
    return {quality: error / base for quality, error in errors.items()}


def _times(studio: Studio) -> dict[Quality, float]:
    """Return the time of each quality over that of the standard, by turns."""
    ratios: dict[Quality, list[float]] = {quality: [] for quality in LADDER}
    for turn in range(ROUNDS):
        order = [quality for quality in LADDER if turn == 0 or not _is_supersampled(quality)]
        # Another one begins every round.
        first = turn % len(order)
        seconds = {quality: _seconds(studio, quality) for quality in order[first:] + order[:first]}
        base = seconds[Quality.standard()]
        for quality, time in seconds.items():
            ratios[quality].append(time / base)
    return {quality: statistics.median(values) for quality, values in ratios.items()}


def _is_supersampled(quality: Quality) -> bool:
    """Tell whether a quality averages whole pictures."""
    return quality.samples in SUPERSAMPLED


def _seconds(studio: Studio, quality: Quality) -> float:
    """Return the seconds of a frame that follows one of its own quality, or of many pictures."""
    attempt = Attempt("", str(quality), quality)
    if not _is_supersampled(quality):
        studio.seconds(attempt)
    return total(studio.seconds(attempt))
