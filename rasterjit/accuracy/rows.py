"""Put the trials of a study in the order in which a report shows them."""

from __future__ import annotations

from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Study, Trial
from rasterjit.scene.quality import LEVELS

AS_THE_SCENE_SAYS = "as the scene says"
"""Level of a setting that the standard leaves to the scene."""


def settings_of(study: Study) -> list[str]:
    """Return the settings that were tried by themselves, in the order of their first trials."""
    tried = dict.fromkeys(trial.setting for trial in study.trials)
    return [setting for setting in tried if setting not in (STANDARD, COMBINATIONS)]


def standard_level(study: Study, setting: str) -> str:
    """Return the level of a setting in the standard quality."""
    level = getattr(study.standard.quality, setting, None)
    return AS_THE_SCENE_SAYS if level is None else str(level)


def with_standard(study: Study, setting: str) -> list[Trial]:
    """Return the trials of a setting and, at its place among their levels, the standard."""
    trials = study.of(setting)
    levels = [str(level).lower() for level in LEVELS.get(setting, ())]
    standard = standard_level(study, setting).lower()
    if standard not in levels:
        return [study.standard, *trials]
    below = levels[: levels.index(standard)]
    lower = [trial for trial in trials if trial.level.lower() in below]
    rest = [trial for trial in trials if trial.level.lower() not in below]
    return [*lower, study.standard, *rest]


def front_trials(study: Study) -> list[Trial]:
    """Return the trials on the Pareto front, from the fastest on."""
    wanted = set(study.front)
    found = [trial for trial in (study.standard, *study.trials) if trial.label in wanted]
    return sorted(found, key=lambda trial: (trial.ratio, trial.label))
