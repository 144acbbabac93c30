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

from rasterjit.accuracy.choice import ALIKE, INVISIBLE, Choice, choose, choose_among, is_timed
from rasterjit.accuracy.report.files import write_report
from rasterjit.accuracy.report.many_scenes_page import write_together
from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Study, Trial, front_trials
from rasterjit.accuracy.settings_to_try import TRIED_PRESETS, Attempt
from rasterjit.accuracy.study import SIZE, Course, begin, checked
from rasterjit.accuracy.timing import Progress
from rasterjit.io.meshes import load, mesh_files
from rasterjit.scene.lens import Lens
from rasterjit.scene.quality import PRESETS, Quality, differences
from rasterjit.scene.validation import existing_folder

STUDIED_SHARE = 0.8
"""Share of a scene's seconds for its own study; the rest is for qualities that others brought."""

STEPS_OF_RATIOS = 9
"""Evenly spaced times that stand for those of a scene."""

Loader = Callable[[], Any]
"""Returns a scene, or a pair of a scene and the camera that looks at it."""


@dataclass(frozen=True)
class FolderStudy:
    """
    What studies of many scenes found together.

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
        """Name the folder and the quality to take."""
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
    options = checked(size, knobs, budget, max_error, threads, output)
    courses: dict[str, Course] = {}
    studies: dict[str, Study] = {}
    failures: dict[str, str] = {}
    for number, (scene_name, loader) in enumerate(loaders.items()):
        told = _told(progress, f"{number + 1} of {len(loaders)}, {scene_name}: ")
        try:
            course = begin(_loaded(loader), options, STUDIED_SHARE, lens, told)
            with course.studio:
                course.run()
        except (ValueError, OSError) as error:
            failures[scene_name] = str(error)
            continue
        found = course.result(scene_name, options.max_error)
        if options.folder is not None:
            write_report(found, options.folder / scene_name)
        courses[scene_name], studies[scene_name] = course, _bare(found)
        if course.interrupted:
            break
    if not studies:
        why = "; ".join(f"{name}: {error}" for name, error in failures.items())
        raise ValueError(f"folder must hold scenes, got {title!r}, which has none to study: {why}")
    # What is worth choosing on any of them, tried on all.
    wanted = _wanted(studies, options.knobs)
    candidates: dict[str, list[Trial]] = {label: [] for label in wanted}
    for scene_name, course in courses.items():
        seconds = (1.0 - STUDIED_SHARE) * options.seconds
        for label, trial in _all_trials(course, studies[scene_name], wanted, seconds).items():
            candidates[label].append(trial)
    whole = {
        label: tuple(trials) for label, trials in candidates.items() if len(trials) == len(studies)
    }
    # The quality that suits all.
    floor = max(INVISIBLE, *(found.reference_error for found in studies.values()))
    totals = {
        label: _total(label, wanted[label], trials, whole[STANDARD], options.max_error, floor)
        for label, trials in whole.items()
    }
    usual = totals.pop(STANDARD)
    fit = [one for one in totals.values() if options.max_error or _is_nowhere_worse(one, whole)]
    take = choose_among(usual, fit, options.max_error, floor)
    left = sum(len(trials) < len(studies) for trials in candidates.values())
    take = take._replace(untried=left / len(candidates))
    # The result, and the page of all.
    found_together = FolderStudy(
        title, studies, whole, tuple(totals.values()), usual, take, options.max_error, failures
    )
    if options.folder is not None:
        write_together(found_together, options.folder)
    return found_together


def _loaders(folder: str | Path | Mapping[str, Any]) -> tuple[dict[str, Loader], str]:
    """Return what loads each scene, by name, and the name of all."""
    if isinstance(folder, Mapping):
        if not folder:
            raise ValueError("folder must hold scenes, got an empty mapping")
        # Each scene has a folder of its name for its report.
        for name in map(str, folder):
            place = PurePath(name)
            if place.is_absolute() or not place.parts or ".." in place.parts:
                raise ValueError(f"folder must have names of scenes without '..', got {name!r}")
        return {str(name): _held(scene) for name, scene in folder.items()}, "scenes"
    place = existing_folder("folder", folder).resolve()
    files = mesh_files(place)
    if not files:
        raise ValueError(f"folder must hold mesh files, got {os.fspath(folder)!r}, without any")
    return {file.relative_to(place).as_posix(): _of_file(file) for file in files}, place.name


def _held(scene: Any) -> Loader:
    return scene if callable(scene) else lambda: scene


def _of_file(file: Path) -> Loader:
    return lambda: load(file, isolate="all")


def _loaded(loader: Loader) -> tuple[Any, Any]:
    """Return a scene and its camera."""
    found = loader()
    return found if isinstance(found, tuple) else (found, None)


def _told(progress: Progress | None, prefix: str) -> Progress | None:
    """Return what tells of one scene of many."""
    if progress is None:
        return None
    return lambda text, done, count: progress(prefix + text, done, count)


def _bare(study: Study) -> Study:
    """Return a study without what has pictures: of many scenes they take much memory."""
    none = np.zeros((0, 0, 3), np.uint8)

    def bare(trial: Trial) -> Trial:
        return replace(trial, color=none, error_map=none[:, :, 0].astype(np.float32))

    trials = tuple(map(bare, study.trials))
    return replace(
        study, standard=bare(study.standard), trials=trials, effects=(), reference_color=none
    )


def _wanted(studies: Mapping[str, Study], knobs: Sequence[str]) -> dict[str, Quality]:
    """Return the qualities that are compared on all scenes: presets, and what any is best with."""
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
    course: Course, study: Study, wanted: Mapping[str, Quality], seconds: float
) -> dict[str, Trial]:
    """Return a trial of each quality on a scene, as far as there is time to draw what lacks."""
    known = {trial.quality: trial for trial in (study.standard, *study.trials)}
    standard, found = Quality.standard(), {}
    end = time.perf_counter() + seconds
    for label, quality in wanted.items():
        idle = {name: getattr(standard, name) for name in study.without_effect}
        same = replace(quality, **idle)
        if same not in known and time.perf_counter() < end:
            attempt = Attempt(COMBINATIONS, label, same)
            if course.studio.refusal(attempt) is None:
                one = course.studio.prepare(attempt, course.reference)
                known[same] = one.trial(course.standard, study.clock)
        if same in known:
            found[label] = replace(known[same], quality=quality)
    course.studio.close()
    return found


def _is_nowhere_worse(total: Trial, candidates: Mapping[str, Sequence[Trial]]) -> bool:
    """Tell whether a quality is on no scene less accurate than the standard."""
    pairs = zip(candidates[total.label], candidates[STANDARD], strict=True)
    return all(one.errors.rmse <= ALIKE * usual.errors.rmse for one, usual in pairs)


def _total(
    label: str,
    quality: Quality,
    trials: Sequence[Trial],
    standards: Sequence[Trial],
    max_error: float | None,
    floor: float,
) -> Trial:
    """Return one trial that stands for those of all scenes."""
    errors = [one.errors.rmse for one in trials]
    rmse = max(errors) if max_error is not None else _geometric_mean(max(e, floor) for e in errors)
    ratios = [
        _geometric_mean(step) for step in zip(*(_steps(one.ratios) for one in trials), strict=True)
    ]
    if not all(is_timed(one) for one in trials):
        # As many as there are of what was timed worst.
        ratios = [statistics.median(ratios)]

    def excess(name: str) -> float:
        """Return by how much an error is larger than the standard's, where it is so most."""
        pairs = zip(trials, standards, strict=True)
        known = [[getattr(each.errors, name) or 0.0 for each in pair] for pair in pairs]
        return max(max(0.0, one - usual) for one, usual in known)

    worst = trials[int(np.argmax(errors))]
    found = worst.errors._replace(
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
    seconds = (_geometric_mean(one.median for one in trials),)
    return replace(
        worst, setting=setting, level=level, quality=quality, seconds=seconds,
        ratios=tuple(ratios), stages={}, errors=found, dominated_by=None,
    )  # fmt: skip


def _steps(ratios: Sequence[float]) -> list[float]:
    """Return evenly spaced quantiles of some times."""
    shares = (np.arange(STEPS_OF_RATIOS) + 0.5) / STEPS_OF_RATIOS
    return np.quantile(np.asarray(ratios), shares).tolist()


def _geometric_mean(values: Iterable[float]) -> float:
    """Return the geometric mean of numbers of at least 0."""
    return math.exp(statistics.fmean(math.log(max(value, 1e-30)) for value in values))
