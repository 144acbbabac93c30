"""What a study found of each setting, in one plain sentence."""

from __future__ import annotations

from rasterjit.accuracy.ranking import is_slower, is_timed
from rasterjit.accuracy.results import Study, Trial
from rasterjit.scene.quality import LEVELS, SUPERSAMPLED

PHRASES = {
    "subpixel_bits": "{} sub-pixel bits",
    "samples": "{} samples",
    "interpolation": "{} interpolation",
    "depth_format": "{} depth",
    "precision": "{} vertices",
    "shading": "light by the {}",
    "renormalize": "normals of length one: {}",
    "texture_filter": "the {} texture filter",
    "shadow_size": "shadow maps of {} texels",
    "shadow_taps": "{} shadow comparisons",
    "transparency_layers": "{} transparent layers",
    "blending": "blending in {}",
    "lines": "{} lines",
    "interpolation_precision": "{} interpolation of colours",
}
"""What a level of each setting is called."""

SPECIAL = {
    ("samples", "1"): "1 sample",
    ("samples", "area"): "exact areas",
    ("shadow_taps", "1"): "1 shadow comparison",
    ("transparency_layers", "1"): "1 transparent layer",
    ("renormalize", "True"): "normals of length one",
    ("renormalize", "False"): "normals as they are mixed",
}
"""Levels with a name of their own."""

ALIKE = 1.005
"""Errors in a smaller ratio are not told apart: they print alike."""


def sentences(study: Study) -> dict[str, str]:
    """Return a sentence for each setting that was studied, in the order of `Quality`."""
    found = {}
    for setting in LEVELS:
        trials = study.of(setting)
        if setting in study.without_effect:
            found[setting] = f"{setting} changes nothing here: {study.without_effect[setting]}."
        elif trials:
            found[setting] = _sentence(most_telling(trials, study.standard), study.standard)
    return found


def most_telling(trials: list[Trial], standard: Trial) -> Trial:
    """
    Return the level of a setting that says most of it.

    Where more accuracy than the standard's is to be had, that is the level that buys most of it
    for the time. Elsewhere it is the one, of those worth their time if there are any, that saves
    most time for the accuracy.
    """
    standard_error = standard.errors.rmse
    tried = [trial for trial in trials if trial.quality.samples not in SUPERSAMPLED] or trials
    better = [
        trial
        for trial in tried
        if trial.dominated_by is None and trial.errors.rmse * ALIKE < standard_error
    ]
    if better:
        return max(better, key=lambda trial: _gain(trial, standard_error))
    worth = [trial for trial in tried if trial.dominated_by is None]
    return max(worth or tried, key=lambda trial: _gain(trial, standard_error))


def _gain(trial: Trial, standard_error: float) -> float:
    """Return how many times the error falls for each time that the frame takes longer."""
    if trial.errors.rmse == standard_error:
        return 1.0 / trial.ratio
    if trial.errors.rmse == 0.0:
        return float("inf")
    return standard_error / trial.errors.rmse / trial.ratio


def _sentence(trial: Trial, standard: Trial) -> str:
    """Return what a level costs and buys, against the standard's."""
    level, usual = (
        _phrase(trial.setting, getattr(one.quality, trial.setting)) for one in (trial, standard)
    )
    parts = [_time_in_words(trial, standard), _error_in_words(trial, standard)]
    wrong, true = trial.errors.wrong_faces, standard.errors.wrong_faces
    if wrong != true:
        parts.append(f"{wrong:,} wrong pixels instead of {true:,}")
    depth, usual_depth = trial.errors.depth_units, standard.errors.depth_units
    if depth is not None and usual_depth is not None:
        # What prints alike is alike.
        mine, other = f"{depth:.1g}", f"{usual_depth:.1g}"
        if mine != other:
            parts.append(f"depth wrong by up to {mine} units instead of {other}")
    text = f"{level} instead of {usual}: {', '.join(parts)}"
    if trial.dominated_by is not None:
        text += "; not worth it here"
    return text[0].upper() + text[1:] + "."


def _phrase(setting: str, level: object) -> str:
    """Return what to call a level."""
    if level is None:
        return "what the scene says"
    return SPECIAL.get((setting, str(level))) or PHRASES[setting].format(level)


def _time_in_words(trial: Trial, standard: Trial) -> str:
    """Return how much longer a frame takes."""
    if not is_slower(trial, standard) and not is_slower(standard, trial):
        if not is_timed(trial):
            return "a time that so few rounds do not tell"
        return "the same time within the noise"
    if trial.ratio >= 2.0:
        return f"{trial.ratio:.1f}× the time"
    change = 100.0 * (trial.ratio - 1.0)
    return f"{'+' if change > 0.0 else '−'}{abs(change):.0f} % time"


def _error_in_words(trial: Trial, standard: Trial) -> str:
    """Return how much larger or smaller the error is."""
    error, usual = trial.errors.rmse, standard.errors.rmse
    low, high = sorted((error, usual))
    if low == high:
        return "the same error"
    if low == 0.0:
        return "no error left" if error == 0.0 else f"error {error:.2g} instead of none"
    if _are_alike(low, high):
        return "nearly the same error"
    return f"error {_times(high / low)}× {'higher' if error > usual else 'lower'}"


def _are_alike(error: float, other: float) -> bool:
    """Tell whether two errors are not told apart."""
    low, high = sorted((error, other))
    return high <= low * ALIKE


def _times(factor: float) -> str:
    """Return a factor with two figures or all before the point."""
    return (
        f"{factor:.2f}" if factor < 1.1 else f"{factor:.1f}" if factor < 100 else f"{factor:,.0f}"
    )
