"""Summarize a study in plain sentences: the answer, and one for each setting."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rasterjit.accuracy.choice import SAME_ERROR, choose, find_uncertainty, is_measured, is_slower
from rasterjit.accuracy.results import CPU, STANDARD, Study, Trial, list_front_trials
from rasterjit.scene.quality import LEVELS, PRESETS, SUPERSAMPLED, differences

if TYPE_CHECKING:
    from rasterjit.accuracy.choice import Choice
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
    "texture_mixing": "textures mixed in {}",
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

MORE_TIME_ADVICE = "give the study more seconds"
"""Advice where times are not measured well enough."""

MIN_ROUGH_RATIO = 1.5
"""Least ratio to the standard's time, or its inverse, at which a rough time is reported."""

MIN_PRINTED_UNCERTAINTY = 0.05
"""Relative uncertainty above which a factor has a range."""


def sentences(study: Study) -> dict[str, str]:
    """Return a sentence for each setting that was studied, in the order of `Quality`."""
    texts = {}
    for setting in LEVELS:
        trials = study.of(setting)
        if setting in study.without_effect:
            texts[setting] = f"{setting} changes nothing here: {study.without_effect[setting]}."
        elif trials:
            texts[setting] = _describe_level(find_key_level(trials, study.standard), study.standard)
    return texts


def answer(study: Study) -> str:
    """
    Summarize a study: the quality to take, how sure that is, and the alternatives.

    The alternatives are qualities on the front whose times differ measurably from the standard's.
    """
    return f"{describe_choice(study)} {describe_certainty(study)} {describe_alternatives(study)}"


def describe_choice(study: Study) -> str:
    """Return the quality to take, its time and its error, in a sentence."""
    choice, standard, max_error = choose(study), study.standard, study.max_error
    trial = choice.trial
    failure = "" if choice.holds else f"Nothing that was tried has an error of {max_error:.3g}. "
    time = f"{format_duration(trial.median)}{_clock_note(study)} a frame"
    error = f"error {trial.errors.rmse:.3g}"
    if trial.setting == STANDARD:
        return f"{failure}Take the standard quality: {time}, {error}."
    factor = f"{'' if is_measured(trial) else 'about '}{format_factor(trial.ratio)}×"
    return (
        f"{failure}Take {describe_quality(trial, standard)}: {factor} the time of standard ({time} "
        f"instead of {format_duration(standard.median)}) for {compare_errors(trial, standard)} "
        f"({error} instead of {standard.errors.rmse:.3g})."
    )


def describe_certainty(study: Study) -> str:
    """Return how sure the choice is, and why, in a sentence or two."""
    choice = choose(study)
    reference = f"a reference of {study.reference_samples} samples"
    if study.reference_error > 0.0:
        reference += f", for which there was time and which errs by {study.reference_error:.2g}"
    errors = f"errors are exact, against {reference}"
    if not study.trials:
        return f"A guess: nothing else was tried; {MORE_TIME_ADVICE}."
    if not choice.holds:
        return f"Sure: {errors}."
    clock = ""
    if study.clock == CPU:
        clock = "times are processor times, as the machine is busy with something else, "
    gain = _describe_possible_gain(choice, study.max_error)
    texts = [
        f"{_capitalize(choice.sureness)}: {errors}; {clock}and nothing else that was tried can be "
        f"better{gain}."
    ]
    if study.left_out:
        count = len(study.left_out)
        qualities = "1 quality was" if count == 1 else f"{count} qualities were"
        reason = "the study was interrupted" if study.interrupted else "there was no time"
        texts.append(f"{qualities} not tried: {reason}.")
    if study.asked_size is not None:
        texts.append(
            f"It was measured at {study.size[0]} × {study.size[1]} pixels, not at "
            f"{study.asked_size[0]} × {study.asked_size[1]}: there was no time for more."
        )
    return " ".join(texts)


def summarize_folder(folder_study: FolderStudy) -> tuple[str, str]:
    """Return the quality to take for all scenes of a folder, and how sure that is, in words."""
    choice, max_error, count = folder_study.take, folder_study.max_error, len(folder_study.studies)
    scenes = "the one scene" if count == 1 else f"all {count} scenes"
    trials = folder_study.candidates[choice.trial.label]
    error = max(trial.errors.rmse for trial in trials)
    answer = "" if choice.holds else f"Nothing holds an error of {max_error:.3g} on {scenes}. "
    if choice.trial.setting == STANDARD:
        answer += f"Take the standard quality for {scenes}: error at most {error:.3g}."
    else:
        low, high = (format_factor(end(trial.ratio for trial in trials)) for end in (min, max))
        factor = f"{low}×" if low == high else f"{low}× to {high}×"
        standard_error = max(trial.errors.rmse for trial in folder_study.candidates[STANDARD])
        answer += (
            f"Take {describe_quality(choice.trial, folder_study.standard)} for {scenes}: {factor} "
            f"the time of standard, for an error of at most {error:.3g} instead of "
            f"{standard_error:.3g}."
        )
    certainty = (
        f"{_capitalize(choice.sureness)}: {len(folder_study.totals)} other qualities were tried on "
        f"{scenes}, and none can be better{_describe_possible_gain(choice, max_error)}."
    )
    return answer, certainty


def _describe_possible_gain(choice: Choice, max_error: float | None) -> str:
    """Return by how much, and in what, another quality may be better than the chosen one."""
    share = f" by more than {100.0 * choice.at_most:.0f} %" if choice.at_most >= 0.005 else ""
    return f"{share} in {'time × error' if max_error is None else 'time'}"


def _capitalize(text: str) -> str:
    return text[0].upper() + text[1:]


def _clock_note(study: Study) -> str:
    """Return a note on times that are not elapsed times."""
    return " of processor time" if study.clock == CPU else ""


def describe_alternatives(study: Study) -> str:
    """Return the standard, about twice its time, and about half, in a sentence."""
    standard = study.standard
    time = f"{format_duration(standard.median)}{_clock_note(study)}"
    text = f"On this scene standard is {time} with error {standard.errors.rmse:.3g}"
    front = [trial for trial in list_front_trials(study) if trial.setting != STANDARD]
    slower = [trial for trial in front if is_slower(trial, standard)]
    faster = [trial for trial in front if is_slower(standard, trial)]
    if not front:
        rough = _find_rough_front(study)
        slower = [trial for trial in rough if trial.ratio > MIN_ROUGH_RATIO]
        faster = [trial for trial in rough if trial.ratio < 1.0 / MIN_ROUGH_RATIO]
    parts = [
        f"for {_describe_rough_factor(trial)} the time you get {_describe_trade(trial, standard)}"
        for trial in (_find_nearest_time(slower, 2.0), _find_nearest_time(faster, 0.5))
        if trial is not None
    ]
    # On the front, a quality as fast as the standard replaces it.
    as_fast = [trial for trial in front if trial not in slower and trial not in faster]
    if as_fast:
        best = min(as_fast, key=lambda trial: trial.errors.rmse)
        parts.insert(0, f"for the same time you get {_describe_trade(best, standard)}")
    return f"{text}; {', '.join(parts) if parts else _explain_no_alternative(study)}."


def format_options(trial: Trial, standard: Trial) -> str:
    """Return the command-line options of a quality."""
    if trial.level in PRESETS and trial.quality == PRESETS[trial.level]():
        return f"--quality {trial.level}"
    changes = differences(trial.quality, standard.quality)
    return " ".join(f"--set {name}={level}" for name, level in changes.items())


def _find_rough_front(study: Study) -> list[Trial]:
    """Return the Pareto front of the trials, taking times as exact."""
    return [
        trial
        for trial in study.trials
        if not any(
            other.ratio <= trial.ratio and other.errors.rmse <= trial.errors.rmse * SAME_ERROR
            for other in (study.standard, *study.trials)
            if other is not trial
        )
    ]


def _describe_rough_factor(trial: Trial) -> str:
    """Return a time over the standard's, as about so much where it is not measured well."""
    return describe_factor(trial) if is_measured(trial) else f"about {format_factor(trial.ratio)}×"


def _describe_trade(trial: Trial, standard: Trial) -> str:
    """Return error and name of a quality, and its wrong pixels where there are more of them."""
    text = f"{compare_errors(trial, standard)} with {describe_quality(trial, standard)}"
    wrong, standard_wrong = trial.errors.wrong_faces, standard.errors.wrong_faces
    if wrong > standard_wrong:
        text += f" ({wrong:,} wrong pixels instead of {standard_wrong:,})"
    return text


def _explain_no_alternative(study: Study) -> str:
    """Return why there is no alternative to the standard."""
    if not study.trials:
        return "no other quality was tried"
    if not any(is_measured(trial) for trial in study.trials):
        return f"what other qualities cost is {NOT_MEASURED}: {MORE_TIME_ADVICE}"
    if not all(is_measured(trial) for trial in study.trials):
        noise = "nothing else is better by more than the noise"
        return f"{noise}, or it is {NOT_MEASURED}: {MORE_TIME_ADVICE}"
    return "nothing that was tried is faster or more accurate, as far as can be told"


def _find_nearest_time(trials: list[Trial], factor: float) -> Trial | None:
    """Return the trial whose time is nearest to ``factor`` times the standard's; None of none."""
    return min(trials, key=lambda trial: abs(math.log(trial.ratio / factor)), default=None)


def describe_factor(trial: Trial) -> str:
    """
    Return a time over the standard's: ``2.2×``, or ``2.2× (1.8 to 2.7)`` where it is uncertain.

    ``not measured well enough`` where the rounds are too few or their times differ too much.
    """
    if trial.setting == STANDARD:
        return "1×"
    if not is_measured(trial):
        return NOT_MEASURED
    uncertainty = find_uncertainty(trial)
    if uncertainty <= MIN_PRINTED_UNCERTAINTY * trial.ratio:
        return f"{format_factor(trial.ratio)}×"
    ends = (format_factor(max(trial.ratio + change, 0.0)) for change in (-uncertainty, uncertainty))
    return f"{format_factor(trial.ratio)}× ({' to '.join(ends)})"


def compare_errors(trial: Trial, standard: Trial) -> str:
    """Return an error over the standard's: ``2.5× less error``."""
    error, standard_error = trial.errors.rmse, standard.errors.rmse
    if _is_same_error(error, standard_error):
        return "the same error"
    if error == 0.0:
        return "no error"
    if standard_error == 0.0:
        return f"an error of {error:.2g}"
    low, high = sorted((error, standard_error))
    return f"{format_factor(high / low)}× {'the' if error > standard_error else 'less'} error"


def describe_quality(trial: Trial, standard: Trial) -> str:
    """Return the name of a quality: its preset, or its changes from the standard."""
    if trial.level in PRESETS:
        return f"quality {trial.level}"
    changes = differences(trial.quality, standard.quality)
    return " and ".join(_name_level(name, level) for name, level in changes.items()) or trial.label


def find_key_level(trials: list[Trial], standard: Trial) -> Trial:
    """
    Return the level of a setting that represents the setting best.

    Of levels more accurate than the standard, if any, the one that gains most accuracy for its
    time; else, of those that are not dominated if any, the one that saves most time for its error.
    """
    standard_error = standard.errors.rmse
    single = [trial for trial in trials if trial.quality.samples not in SUPERSAMPLED] or trials
    undominated = [trial for trial in single if trial.dominated_by is None]
    better = [trial for trial in undominated if trial.errors.rmse * SAME_ERROR < standard_error]
    candidates = better or undominated or single
    return max(candidates, key=lambda trial: _error_gain(trial, standard_error))


def _error_gain(trial: Trial, standard_error: float) -> float:
    """Return the standard's error over the trial's, divided by their ratio of times."""
    if trial.errors.rmse == standard_error:
        return 1.0 / trial.ratio
    if trial.errors.rmse == 0.0:
        return float("inf")
    return standard_error / trial.errors.rmse / trial.ratio


def _describe_level(trial: Trial, standard: Trial) -> str:
    """Return a sentence on the time and the errors of a level, against the standard's."""
    level, find_standard_level = (
        _name_level(trial.setting, getattr(quality, trial.setting))
        for quality in (trial.quality, standard.quality)
    )
    parts = [_describe_time_change(trial, standard), _describe_error_change(trial, standard)]
    wrong, standard_wrong = trial.errors.wrong_faces, standard.errors.wrong_faces
    if wrong != standard_wrong:
        parts.append(f"{wrong:,} wrong pixels instead of {standard_wrong:,}")
    depths = trial.errors.depth_units, standard.errors.depth_units
    if None not in depths:
        depth, standard_depth = (f"{error:.1g}" for error in depths)
        if depth != standard_depth:
            parts.append(f"depth wrong by up to {depth} units instead of {standard_depth}")
    text = _capitalize(f"{level} instead of {find_standard_level}: {', '.join(parts)}")
    return f"{text}; not worth it here." if trial.dominated_by is not None else f"{text}."


def _name_level(setting: str, level: object) -> str:
    if level is None:
        return "what the scene says"
    return SPECIAL_LEVEL_NAMES.get((setting, str(level))) or LEVEL_NAMES[setting].format(level)


def _describe_time_change(trial: Trial, standard: Trial) -> str:
    """Return how much longer or shorter a frame takes."""
    if not is_slower(trial, standard) and not is_slower(standard, trial):
        if not is_measured(trial):
            return f"a time {NOT_MEASURED}"
        return "the same time within the noise"
    if not is_measured(trial):
        return f"{'more' if trial.ratio > 1.0 else 'less'} time, how much is {NOT_MEASURED}"
    if trial.ratio >= 2.0:
        return f"{describe_factor(trial)} the time"
    change = 100.0 * (trial.ratio - 1.0)
    return f"{'+' if change > 0.0 else '−'}{abs(change):.0f} % time"


def _describe_error_change(trial: Trial, standard: Trial) -> str:
    """Return how much larger or smaller the error is."""
    error, standard_error = trial.errors.rmse, standard.errors.rmse
    low, high = sorted((error, standard_error))
    if low == high:
        return "the same error"
    if low == 0.0:
        return "no error left" if error == 0.0 else f"error {error:.2g} instead of none"
    if _is_same_error(low, high):
        return "nearly the same error"
    return f"error {format_factor(high / low)}× {'higher' if error > standard_error else 'lower'}"


def _is_same_error(error: float, other: float) -> bool:
    """Tell whether two errors differ by too little to be reported."""
    low, high = sorted((error, other))
    return high <= low * SAME_ERROR


def format_number(value: float) -> str:
    """Return a number with three digits, or all before the point: ``0.0213``, ``1,234``."""
    if 999.5 <= abs(value) < 999_999.5:
        return f"{value:,.0f}"
    text = f"{value:.3g}"
    mantissa, letter, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}" if letter else text


def format_duration(seconds: float) -> str:
    """Return a time with its unit: ``12.3 ms``, ``3.04 s``."""
    if seconds < 0.9995:
        return f"{format_number(1000.0 * seconds)} ms"
    return f"{seconds:.3g} s" if seconds < 999.5 else f"{seconds:,.0f} s"


def format_factor(factor: float) -> str:
    """Return a factor with two digits or all before the point: ``1.04``, ``2.5``, ``120``."""
    return (
        f"{factor:.2f}" if factor < 1.1 else f"{factor:.1f}" if factor < 100 else f"{factor:,.0f}"
    )
