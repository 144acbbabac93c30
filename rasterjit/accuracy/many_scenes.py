"""Study many scenes, and choose one quality for all of them."""

from __future__ import annotations

import math
import os
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from rasterjit.accuracy.choice import INVISIBLE, SAME_ERROR, Choice, choose, choose_among, is_timed
from rasterjit.accuracy.report.files import write_report
from rasterjit.accuracy.report.many_scenes_page import write_folder_report
from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Study, Trial, front_trials
from rasterjit.accuracy.settings_to_try import TRIED_PRESETS, Attempt
from rasterjit.accuracy.study import SIZE, StudyRun, begin_study, check_options
from rasterjit.accuracy.timing import Progress
from rasterjit.io.meshes import load, mesh_files
from rasterjit.scene.lens import Lens
from rasterjit.scene.quality import PRESETS, Quality, differences
from rasterjit.scene.validation import existing_folder

STUDIED_SHARE = 0.8
"""Share of a scene's seconds for its own study; the rest is for candidates of other scenes."""

RATIO_STEPS = 9
"""Number of quantiles that represent the times of a scene."""

Loader = Callable[[], Any]
"""Returns a scene, or a pair of a scene and the camera that looks at it."""


@dataclass(frozen=True)
class FolderStudy:
    """
    Result of studying many scenes: one quality for all of them.

    Attributes
    ----------
    name : str
        Of the folder.
    studies : dict of Study
        Of each scene, by its name, without pictures and without ``effects``.
    candidates : dict of tuple
        Of each quality that was tried on all scenes its trials, in the order of ``studies``; the
        standard is among them.
    totals : tuple of Trial
        Of each of those but the standard, one that stands for all scenes: its ratio is the
        geometric mean; its error the largest where an error was asked for, else the geometric mean.
    standard : Trial
        The same of the standard.
    take : Choice
        The quality for all scenes: it holds the error that was asked for on all of them, or is
        nowhere less accurate than the standard.
    max_error : float or None
        What was asked for.
    failures : dict of str
        Why scenes could not be studied, by name.
    """

    name: str
    studies: dict[str, Study]
    candidates: dict[str, tuple[Trial, ...]]
    totals: tuple[Trial, ...]
    standard: Trial
    take: Choice
    max_error: float | None
    failures: dict[str, str]

    def __repr__(self) -> str:
        """Name the folder and the chosen quality."""
        return f"FolderStudy({self.name!r}, {len(self.studies)} scenes, {self.take.trial.label!r})"


def study_folder(
    folder: str | Path | Mapping[str, Any],
    *,
    size: tuple[int, int] = SIZE,
    knobs: Iterable[str] | None = None,
    budget: float | None = None,
    max_error: float | None = None,
    lens: Lens | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    output: str | Path | None = None,
    name: str | None = None,
) -> FolderStudy:
    """
    Study every scene of a folder, and choose one quality for all of them.

    Each scene is studied as by `study`. What is worth choosing on any of them is then tried on all.

    Parameters
    ----------
    folder : str, Path or mapping
        A folder of mesh files; or scenes by their names, or functions that return them, each alone
        or in a pair with a camera. Names may have folders, but no "..".
    size, knobs, max_error, lens, threads, progress
        As `study` takes them.
    budget : float, optional
        Seconds for each scene. Default 75.
    output : str or Path, optional
        Folder for a report of all, and in it a folder for the report of each scene.
    name : str, optional
        What the report calls it. Default: the folder's name.

    Returns
    -------
    FolderStudy

    Raises
    ------
    ValueError
        Naming the argument that is wrong, or where no scene can be studied.
    KeyboardInterrupt
        On Ctrl-C before there is anything to compare.
    """
    # Each scene by itself, one after the other.
    loaders, named = _loaders(folder)
    title = named if name is None else name
    options = check_options(size, knobs, budget, max_error, threads, output)
    courses: dict[str, StudyRun] = {}
    studies: dict[str, Study] = {}
    failures: dict[str, str] = {}
    for number, (scene_name, loader) in enumerate(loaders.items()):
        notify = _prefixed(progress, f"{number + 1} of {len(loaders)}, {scene_name}: ")
        try:
            course = begin_study(_load(loader), options, STUDIED_SHARE, lens, notify)
            with course.studio:
                course.run()
        except (ValueError, OSError) as error:
            failures[scene_name] = str(error)
            continue
        found = course.result(scene_name, options.max_error)
        if options.folder is not None:
            write_report(found, options.folder / scene_name)
        courses[scene_name], studies[scene_name] = course, _without_pictures(found)
        if course.interrupted:
            break
    if not studies:
        why = "; ".join(f"{name}: {error}" for name, error in failures.items())
        raise ValueError(f"folder must hold scenes, got {title!r}, which has none to study: {why}")
    # What is worth choosing on any of them, tried on all.
    qualities = _candidates(studies, options.knobs)
    candidates: dict[str, list[Trial]] = {label: [] for label in qualities}
    for scene_name, course in courses.items():
        seconds = (1.0 - STUDIED_SHARE) * options.seconds
        for label, trial in _all_trials(course, studies[scene_name], qualities, seconds).items():
            candidates[label].append(trial)
    full = {
        label: tuple(trials) for label, trials in candidates.items() if len(trials) == len(studies)
    }
    # The quality that suits all.
    floor = max(INVISIBLE, *(found.reference_error for found in studies.values()))
    totals = {
        label: _total(label, qualities[label], trials, full[STANDARD], options.max_error, floor)
        for label, trials in full.items()
    }
    standard = totals.pop(STANDARD)
    usable = [one for one in totals.values() if options.max_error or _is_never_worse(one, full)]
    take = choose_among(standard, usable, options.max_error, floor)
    left = sum(len(trials) < len(studies) for trials in candidates.values())
    take = take._replace(untried=left / len(candidates))
    # The result, and the page of all.
    result = FolderStudy(
        title, studies, full, tuple(totals.values()), standard, take, options.max_error, failures
    )
    if options.folder is not None:
        write_folder_report(result, options.folder)
    return result


def _loaders(folder: str | Path | Mapping[str, Any]) -> tuple[dict[str, Loader], str]:
    """Return a loader for each scene, by name, and the name of the folder."""
    if isinstance(folder, Mapping):
        if not folder:
            raise ValueError("folder must hold scenes, got an empty mapping")
        # Each scene has a folder of its name for its report.
        for name in map(str, folder):
            path = PurePath(name)
            if path.is_absolute() or not path.parts or ".." in path.parts:
                raise ValueError(f"folder must have names of scenes without '..', got {name!r}")
        return {str(name): _scene_loader(scene) for name, scene in folder.items()}, "scenes"
    path = existing_folder("folder", folder).resolve()
    files = mesh_files(path)
    if not files:
        raise ValueError(f"folder must hold mesh files, got {os.fspath(folder)!r}, without any")
    return {file.relative_to(path).as_posix(): _file_loader(file) for file in files}, path.name


def _scene_loader(scene: Any) -> Loader:
    return scene if callable(scene) else lambda: scene


def _file_loader(file: Path) -> Loader:
    return lambda: load(file, isolate="all")


def _load(loader: Loader) -> tuple[Any, Any]:
    """Return a scene and its camera."""
    loaded = loader()
    return loaded if isinstance(loaded, tuple) else (loaded, None)


def _prefixed(progress: Progress | None, prefix: str) -> Progress | None:
    """Return a progress function that prefixes texts with the name of a scene."""
    if progress is None:
        return None
    return lambda text, done, count: progress(prefix + text, done, count)


def _without_pictures(study: Study) -> Study:
    """Return a study without its pictures, which would take much memory for many scenes."""
    none = np.zeros((0, 0, 3), np.uint8)

    def bare(trial: Trial) -> Trial:
        return replace(trial, color=none, error_map=none[:, :, 0].astype(np.float32))

    trials = tuple(map(bare, study.trials))
    return replace(
        study, standard=bare(study.standard), trials=trials, effects=(), reference_color=none
    )


def _candidates(studies: Mapping[str, Study], knobs: Sequence[str]) -> dict[str, Quality]:
    """Return the qualities to compare on all scenes: presets, and the best of each scene."""
    found = {STANDARD: Quality.standard()}
    for preset in TRIED_PRESETS:
        changes = differences(PRESETS[preset](), Quality.standard())
        kept = {name: level for name, level in changes.items() if name in knobs}
        if len(kept) > 1:
            found[preset] = replace(Quality.standard(), **kept)
    for study in studies.values():
        for trial in (choose(study).trial, *front_trials(study)):
            if trial.quality not in found.values():
                found[trial.label] = trial.quality
    return found


def _all_trials(
    course: StudyRun, study: Study, wanted: Mapping[str, Quality], seconds: float
) -> dict[str, Trial]:
    """Return a trial of each candidate on a scene, drawing missing ones while there is time."""
    done = {trial.quality: trial for trial in (study.standard, *study.trials)}
    standard, trials = Quality.standard(), {}
    end = time.perf_counter() + seconds
    for label, quality in wanted.items():
        idle = {name: getattr(standard, name) for name in study.without_effect}
        match = replace(quality, **idle)
        if match not in done and time.perf_counter() < end:
            attempt = Attempt(COMBINATIONS, label, match)
            if course.studio.refusal(attempt) is None:
                contestant = course.studio.prepare(attempt, course.reference)
                done[match] = contestant.trial(course.standard, study.clock)
        if match in done:
            trials[label] = replace(done[match], quality=quality)
    course.studio.close()
    return trials


def _is_never_worse(total: Trial, candidates: Mapping[str, Sequence[Trial]]) -> bool:
    """Tell whether a quality is at least as accurate as the standard on every scene."""
    pairs = zip(candidates[total.label], candidates[STANDARD], strict=True)
    return all(one.errors.rmse <= SAME_ERROR * base.errors.rmse for one, base in pairs)


def _total(
    label: str,
    quality: Quality,
    trials: Sequence[Trial],
    standards: Sequence[Trial],
    max_error: float | None,
    floor: float,
) -> Trial:
    """Merge the trials of a quality on all scenes into one."""
    errors = [trial.errors.rmse for trial in trials]
    rmse = max(errors) if max_error is not None else _geometric_mean(max(e, floor) for e in errors)
    ratios = [
        _geometric_mean(step)
        for step in zip(*(_quantiles(one.ratios) for one in trials), strict=True)
    ]
    if not all(map(is_timed, trials)):
        # As many as there are of what was timed worst.
        ratios = [statistics.median(ratios)]

    def excess(name: str) -> float:
        """Return by how much an error is larger than the standard's, where it is so most."""
        pairs = zip(trials, standards, strict=True)
        numbers = [[getattr(one.errors, name) or 0.0 for one in pair] for pair in pairs]
        return max(max(0.0, error - base) for error, base in numbers)

    worst = trials[int(np.argmax(errors))]
    errors_of_worst = worst.errors._replace(
        rmse=rmse,
        wrong_faces=int(excess("wrong_faces")),
        depth_units=excess("depth_units"),
        uv_texels=excess("uv_texels"),
    )
    is_single = len(differences(quality, Quality.standard())) == 1
    setting, _, level = label.partition("=") if is_single else (COMBINATIONS, "", label)
    if label == STANDARD:
        setting = level = STANDARD
        ratios = [1.0] * len(ratios)
    seconds = (_geometric_mean(trial.median for trial in trials),)
    return replace(
        worst, setting=setting, level=level, quality=quality, seconds=seconds,
        ratios=tuple(ratios), stages={}, errors=errors_of_worst, dominated_by=None,
    )  # fmt: skip


def _quantiles(ratios: Sequence[float]) -> list[float]:
    """Return evenly spaced quantiles of ratios."""
    shares = (np.arange(RATIO_STEPS) + 0.5) / RATIO_STEPS
    return np.quantile(np.asarray(ratios), shares).tolist()


def _geometric_mean(values: Iterable[float]) -> float:
    """Return the geometric mean of numbers of at least 0."""
    return math.exp(statistics.fmean(math.log(max(value, 1e-30)) for value in values))
