"""Measure the times and errors of qualities on this machine, for ``quality_selection``."""

from __future__ import annotations

import statistics
from pathlib import Path

from rasterjit.accuracy.results import PICTURE_OUTPUTS
from rasterjit.accuracy.settings_to_try import Attempt
from rasterjit.accuracy.study import Studio
from rasterjit.accuracy.test_scenes import make
from rasterjit.accuracy.timing import Progress, sum_stages
from rasterjit.rendering.quality_selection import (
    LADDER,
    Profile,
    QualityStep,
    light_of,
    pareto_front_of_steps,
    root_mean_square,
    save_profile,
)
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.quality import SUPERSAMPLED, Quality
from rasterjit.scene.validation import thread_count

SCENES_USED = ("highlights", "shadows", "glass", "floor")
"""Test scenes with different costs: light, shadows, layers, textures."""

ROUNDS = 7
"""Number of frames of each quality whose median time is taken; one of supersampled qualities."""


def calibrate(
    *, threads: int | None = None, progress: Progress | None = None
) -> tuple[Profile, Path]:
    """
    Draw test scenes in each quality; save times and errors in the cache folder.

    ``render(time_budget=...)`` chooses from the qualities on the Pareto front of time and error.

    Parameters
    ----------
    threads : int, optional
        Default: all processors.
    progress : callable, optional
        Called with a text, the amount done, and the total.

    Returns
    -------
    Profile
    Path
        The file of the profile.

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
        test_scene = make(name)
        with Studio(test_scene.scene, test_scene.camera, test_scene.size, threads) as studio:
            for quality, error in _measure_errors(studio).items():
                errors[quality].append(error)
            for quality, time in _measure_times(studio).items():
                times[quality].append(time)
    steps = [
        QualityStep(quality, statistics.median(times[quality]), statistics.median(errors[quality]))
        for quality in LADDER
    ]
    profile = Profile(pareto_front_of_steps(steps), threads or available_processors())
    return profile, save_profile(profile)


def _measure_errors(studio: Studio) -> dict[Quality, float]:
    """Return the error of each quality over that of the standard; compiles the kernels."""
    reference = light_of(studio.draw(Quality.reference(), PICTURE_OUTPUTS))
    errors = {
        quality: root_mean_square(light_of(studio.draw(quality, PICTURE_OUTPUTS)) - reference)
        for quality in LADDER[:-1]
    }
    errors[LADDER[-1]] = 0.0
    standard_error = errors[Quality.standard()]
    return {quality: error / standard_error for quality, error in errors.items()}


def _measure_times(studio: Studio) -> dict[Quality, float]:
    """Return the median time of each quality over that of the standard."""
    ratios: dict[Quality, list[float]] = {quality: [] for quality in LADDER}
    for number in range(ROUNDS):
        order = [quality for quality in LADDER if number == 0 or not _is_supersampled(quality)]
        # Each round begins with another quality.
        first = number % len(order)
        seconds = {q: _time_frame(studio, q) for q in order[first:] + order[:first]}
        standard_seconds = seconds[Quality.standard()]
        for quality, time in seconds.items():
            ratios[quality].append(time / standard_seconds)
    return {quality: statistics.median(values) for quality, values in ratios.items()}


def _is_supersampled(quality: Quality) -> bool:
    """Tell whether a quality averages whole pictures."""
    return quality.samples in SUPERSAMPLED


def _time_frame(studio: Studio, quality: Quality) -> float:
    """Return the seconds of a frame: of a second one, unless it is supersampled."""
    attempt = Attempt("", str(quality), quality)
    if not _is_supersampled(quality):
        studio.time_stages(attempt)
    return sum_stages(studio.time_stages(attempt))
