"""What a study found, in plain sentences: the answer, and one for each setting."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rasterjit.accuracy.choice import SAME_ERROR, choose, is_measured, is_slower, noise
from rasterjit.accuracy.results import CPU, STANDARD, Study, Trial, front_trials
from rasterjit.scene.quality import LEVELS, PRESETS, SUPERSAMPLED, differences

if TYPE_CHECKING:
    from rasterjit.accuracy.many_scenes import FolderStudy

LEVEL_NAMES = {
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
"""Names of the levels of each setting."""

SPECIAL_LEVEL_NAMES = {
    ("samples", "1"): "1 sample",
    ("samples", "area"): "exact areas",
    ("shadow_taps", "1"): "1 shadow comparison",
    ("transparency_layers", "1"): "1 transparent layer",
    ("renormalize", "True"): "normals of length one",
    ("renormalize", "False"): "normals as they are mixed",
}
"""Levels with a name of their own."""

NOT_MEASURED = "not measured well enough"
"""Text in place of a factor that is not measured well enough."""

ADVICE = "give the study more seconds"
"""Advice where times are not measured well enough."""

MIN_ROUGH_RATIO = 1.5
"""Least ratio to the standard's time, or its inverse, at which a rough time is reported."""

SHARP_SHARE = 0.05
"""Relative uncertainty below which a range is not printed."""


def sentences(study: Study) -> dict[str, str]:
    """Return a sentence for each setting that was studied, in the order of `Quality`."""
    found = {}
    for setting in LEVELS:
        trials = study.of(setting)
        if setting in study.without_effect:
            found[setting] = f"{setting} changes nothing here: {study.without_effect[setting]}."
        elif trials:
            found[setting] = _sentence(key_level(trials, study.standard), study.standard)
    return found


def answer(study: Study) -> str:
    """
    Summarize a study: the quality to take, how sure that is, and the alternatives.

    It names one in any case. Of the rest only qualities on the front are named, whose times are
    told apart from the standard's, with the factors that were measured.
    """
    return f"{recommendation(study)} {certainty(study)} {alternatives(study)}"


def recommendation(study: Study) -> str:
    """Return the quality to take, what it costs and what it buys, in a sentence."""
    found, standard = choose(study), study.standard
    trial, bound = found.trial, study.max_error
    missed = "" if found.holds else f"Nothing that was tried has an error of {bound:.3g}. "
    is_usual = trial.setting == STANDARD
    name = "the standard quality" if is_usual else quality_in_words(trial, standard)
    time = f"{time_in_words(trial.median)}{_of_clock(study)} a frame"
    error = f"error {trial.errors.rmse:.3g}"
    if is_usual:
        return f"{missed}Take {name}: {time}, {error}."
    factor = f"{'' if is_measured(trial) else 'about '}{digits(trial.ratio)}× the time of standard"
    return (
        f"{missed}Take {name}: {factor} ({time} instead of {time_in_words(standard.median)}) for "
        f"{error_against(trial, standard)} ({error} instead of {standard.errors.rmse:.3g})."
    )


def certainty(study: Study) -> str:
    """Return how sure the choice is, and why, in a sentence or two."""
    found = choose(study)
    what = "time × error" if study.max_error is None else "time"
    reference = f"a reference of {study.reference_samples} samples"
    if study.reference_error > 0.0:
        reference += f", for which there was time and which errs by {study.reference_error:.2g}"
    known = f"errors are exact, against {reference}"
    if not study.trials:
        return f"A guess: nothing else was tried; {ADVICE}."
    if not found.holds:
        return f"Sure: {known}."
    rest = f"and nothing else that was tried can be better{_percent_more(found.at_most)} in {what}"
    clock = "times are processor times, as the machine is busy with something else, "
    said = f"{known}; {clock if study.clock == CPU else ''}{rest}."
    notes = []
    if study.left_out:
        why = "the study was interrupted" if study.interrupted else "there was no time"
        notes.append(f"{_count(len(study.left_out))} not tried: {why}.")
    if study.asked_size is not None:
        notes.append(
            f"It was measured at {study.size[0]} × {study.size[1]} pixels, not at "
            f"{study.asked_size[0]} × {study.asked_size[1]}: there was no time for more."
        )
    sureness = found.sureness
    return " ".join([f"{sureness[0].upper()}{sureness[1:]}: {said}", *notes])


def folder_summary(found: FolderStudy) -> tuple[str, str]:
    """Return the quality to take for all scenes of a folder, and how sure that is, in words."""
    take, standard = found.take, found.standard
    trial, many = take.trial, len(found.studies)
    scenes = "the one scene" if many == 1 else f"all {many} scenes"
    name = (
        "the standard quality" if trial.setting == STANDARD else quality_in_words(trial, standard)
    )
    trials = found.candidates[trial.label]
    low, high = (digits(end(one.ratio for one in trials)) for end in (min, max))
    worst = max(one.errors.rmse for one in trials)
    usual = max(one.errors.rmse for one in found.candidates[STANDARD])
    factor = f"{low}×" if low == high else f"{low}× to {high}×"
    missed = "" if take.holds else f"Nothing holds an error of {found.max_error:.3g} on {scenes}. "
    if trial.setting == STANDARD:
        said = f"{missed}Take {name} for {scenes}: error at most {worst:.3g}."
    else:
        said = (
            f"{missed}Take {name} for {scenes}: {factor} the time of standard, for an error of at "
            f"most {worst:.3g} instead of {usual:.3g}."
        )
    what = "time × error" if found.max_error is None else "time"
    sureness = take.sureness
    sure = (
        f"{sureness[0].upper()}{sureness[1:]}: {len(found.totals)} other qualities were tried on "
        f"{scenes}, and none can be better{_percent_more(take.at_most)} in {what}."
    )
    return said, sure


def _percent_more(share: float) -> str:
    """Return a share in percent, or nothing where it prints as none."""
    return f" by more than {100.0 * share:.0f} %" if share >= 0.005 else ""


def _count(qualities: int) -> str:
    return "1 quality was" if qualities == 1 else f"{qualities} qualities were"


def _of_clock(study: Study) -> str:
    """Describe the clock of times, if it is not elapsed time."""
    return " of processor time" if study.clock == CPU else ""


def alternatives(study: Study) -> str:
    """Return the standard, about twice its time, and about half, in a sentence."""
    standard = study.standard
    said = (
        f"On this scene standard is {time_in_words(standard.median)}{_of_clock(study)} with error "
        f"{standard.errors.rmse:.3g}"
    )
    front = [trial for trial in front_trials(study) if trial.setting != STANDARD]
    slower = [trial for trial in front if is_slower(trial, standard)]
    faster = [trial for trial in front if is_slower(standard, trial)]
    if not front:
        rough = _rough_front(study)
        slower = [trial for trial in rough if trial.ratio > MIN_ROUGH_RATIO]
        faster = [trial for trial in rough if trial.ratio < 1.0 / MIN_ROUGH_RATIO]
    parts = [
        f"for {_factor_in_words(trial)} the time you get {_error_trade(trial, standard)}"
        for trial in (_nearest_time(slower, 2.0), _nearest_time(faster, 0.5))
        if trial is not None
    ]
    # Where such a one is on the front, the standard is not.
    alike = [trial for trial in front if trial not in slower and trial not in faster]
    if alike:
        best = min(alike, key=lambda trial: trial.errors.rmse)
        parts.insert(0, f"for the same time you get {_error_trade(best, standard)}")
    if not parts:
        return f"{said}; {_only_standard_reason(study)}."
    return f"{said}; {', '.join(parts)}."


def options_of(trial: Trial, standard: Trial) -> str:
    """Return the command-line options of a quality."""
    if trial.level in PRESETS and trial.quality == PRESETS[trial.level]():
        return f"--quality {trial.level}"
    changes = differences(trial.quality, standard.quality)
    return " ".join(f"--set {name}={level}" for name, level in changes.items())


def _rough_front(study: Study) -> list[Trial]:
    """Return the Pareto front of the trials, taking times as exact."""
    tried = [study.standard, *study.trials]
    return [
        one
        for one in study.trials
        if not any(
            other.ratio <= one.ratio and other.errors.rmse <= one.errors.rmse * SAME_ERROR
            for other in tried
            if other is not one
        )
    ]


def _factor_in_words(trial: Trial) -> str:
    """Return a time over the standard's, roughly where it is not measured well."""
    return factor_in_words(trial) if is_measured(trial) else f"about {digits(trial.ratio)}×"


def _error_trade(trial: Trial, standard: Trial) -> str:
    """Return the error of a quality, and its name; more wrong pixels are not passed over."""
    text = f"{error_against(trial, standard)} with {quality_in_words(trial, standard)}"
    wrong, usual = trial.errors.wrong_faces, standard.errors.wrong_faces
    return f"{text} ({wrong:,} wrong pixels instead of {usual:,})" if wrong > usual else text


def _only_standard_reason(study: Study) -> str:
    """Say why there is no alternative to the standard."""
    if not study.trials:
        return "no other quality was tried"
    if not any(is_measured(trial) for trial in study.trials):
        return f"what other qualities cost is {NOT_MEASURED}: {ADVICE}"
    if not all(is_measured(trial) for trial in study.trials):
        return f"nothing else is better by more than the noise, or it is {NOT_MEASURED}: {ADVICE}"
    return "nothing that was tried is faster or more accurate, as far as can be told"


def _nearest_time(trials: list[Trial], factor: float) -> Trial | None:
    """Return the trial whose time is nearest to so many times the standard's, if there is one."""
    return min(trials, key=lambda trial: abs(math.log(trial.ratio / factor)), default=None)


def time_in_words(seconds: float) -> str:
    """Return a time with its unit: ``12.3 ms``, ``3.04 s``."""
    return f"{1e3 * seconds:.3g} ms" if seconds < 0.9995 else f"{seconds:.3g} s"


def factor_in_words(trial: Trial) -> str:
    """Return a time over the standard's: ``2.2×``, or ``2.2× (1.8 to 2.7)`` where it is not sharp.

    ``not measured well enough`` where the rounds are too few or lie too far apart.
    """
    if trial.setting == STANDARD:
        return "1×"
    if not is_measured(trial):
        return NOT_MEASURED
    unknown = noise(trial)
    if unknown <= SHARP_SHARE * trial.ratio:
        return f"{digits(trial.ratio)}×"
    ends = (digits(max(trial.ratio + change, 0.0)) for change in (-unknown, unknown))
    return f"{digits(trial.ratio)}× ({' to '.join(ends)})"


def error_against(trial: Trial, standard: Trial) -> str:
    """Return an error against another: ``2.5× less error``."""
    error, usual = trial.errors.rmse, standard.errors.rmse
    if _print_alike(error, usual):
        return "the same error"
    if error == 0.0:
        return "no error"
    if usual == 0.0:
        return f"an error of {error:.2g}"
    low, high = sorted((error, usual))
    return f"{digits(high / low)}× {'the' if error > usual else 'less'} error"


def quality_in_words(trial: Trial, standard: Trial) -> str:
    """Return what a quality is called: its preset, or what it changes."""
    if trial.level in PRESETS:
        return f"quality {trial.level}"
    changes = differences(trial.quality, standard.quality)
    return " and ".join(_level_name(name, level) for name, level in changes.items()) or trial.label


def key_level(trials: list[Trial], standard: Trial) -> Trial:
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
        if trial.dominated_by is None and trial.errors.rmse * SAME_ERROR < standard_error
    ]
    if better:
        return max(better, key=lambda trial: _error_gain(trial, standard_error))
    worth = [trial for trial in tried if trial.dominated_by is None]
    return max(worth or tried, key=lambda trial: _error_gain(trial, standard_error))


def _error_gain(trial: Trial, standard_error: float) -> float:
    """Return how many times the error falls for each time that the frame takes longer."""
    if trial.errors.rmse == standard_error:
        return 1.0 / trial.ratio
    if trial.errors.rmse == 0.0:
        return float("inf")
    return standard_error / trial.errors.rmse / trial.ratio


def _sentence(trial: Trial, standard: Trial) -> str:
    """Return a sentence on the cost and error of a level, against the standard's."""
    level, usual = (
        _level_name(trial.setting, getattr(one.quality, trial.setting)) for one in (trial, standard)
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


def _level_name(setting: str, level: object) -> str:
    """Return the name of a level."""
    if level is None:
        return "what the scene says"
    return SPECIAL_LEVEL_NAMES.get((setting, str(level))) or LEVEL_NAMES[setting].format(level)


def _time_in_words(trial: Trial, standard: Trial) -> str:
    """Return how much longer a frame takes."""
    if not is_slower(trial, standard) and not is_slower(standard, trial):
        if not is_measured(trial):
            return f"a time {NOT_MEASURED}"
        return "the same time within the noise"
    if not is_measured(trial):
        return f"{'more' if trial.ratio > 1.0 else 'less'} time, how much is {NOT_MEASURED}"
    if trial.ratio >= 2.0:
        return f"{factor_in_words(trial)} the time"
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
    if _print_alike(low, high):
        return "nearly the same error"
    return f"error {digits(high / low)}× {'higher' if error > usual else 'lower'}"


def _print_alike(error: float, other: float) -> bool:
    """Tell whether two errors print alike."""
    low, high = sorted((error, other))
    return high <= low * SAME_ERROR


def digits(factor: float) -> str:
    """Return a factor with two figures or all before the point: ``1.04``, ``2.5``, ``120``."""
    return (
        f"{factor:.2f}" if factor < 1.1 else f"{factor:.1f}" if factor < 100 else f"{factor:,.0f}"
    )
