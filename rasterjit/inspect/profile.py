"""Measure the time of a frame: of its stages, its effects, and some it could have."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from rasterjit.outputs.frame import Frame
from rasterjit.outputs.output_table import Outputs
from rasterjit.rendering import planning
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.rendering.planning import Cull, FrameRequest, choose_camera, plan_frame
from rasterjit.rendering.quality_selection import seconds_of
from rasterjit.rendering.renderer import Renderer
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera
from rasterjit.scene.notebook_preview import TextReport
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import image_size, short_repr
from rasterjit.survey.deformation import pose_input
from rasterjit.survey.effect import QualityEffect
from rasterjit.survey.plan import RenderPlan

ROUNDS, MAX_ROUNDS = 7, 1_000_000
"""Default and largest number of frames of each kind, of which the median counts."""


class Change(NamedTuple):
    """Time of a frame with one change."""

    name: str
    what: str
    """``"off"``, or in words what was tried."""
    seconds: float
    """Median time of such a frame."""
    difference: float
    """By how much it is slower than the frame as it is; below 0 if it is faster."""


@dataclass(frozen=True, repr=False)
class FrameProfile(TextReport):
    """
    Stages, effects and times of a frame; prints as a table.

    Attributes
    ----------
    plan : RenderPlan
    threads : int
    rounds : int
        How many frames each time is the median of.
    stages : dict of float
        Seconds of each stage, in order; compiling is no part of them.
    changes : tuple of Change
        The same frame without each effect that is in, and with what it could have besides.
    """

    plan: RenderPlan
    threads: int
    rounds: int
    stages: dict[str, float]
    total: float
    changes: tuple[Change, ...]

    def __str__(self) -> str:
        rows = [(stage, f"{1e3 * seconds:9.2f} ms") for stage, seconds in self.stages.items()]
        rows.append(("frame", f"{1e3 * self.total:9.2f} ms"))
        rows += [
            (f"{change.name}: {change.what}", f"{1e3 * change.difference:+9.2f} ms")
            for change in self.changes
        ]
        widest = max(len(name) for name, _ in rows)
        times = "\n".join(f"  {name:<{widest}}  {text}" for name, text in rows)
        heading = f"times (median of {self.rounds} frames, {self.threads} threads)"
        return f"{planning.describe(self.plan)}\n\n{heading}\n{times}"


def profile(
    what: Any,
    camera: Camera | None = None,
    quality: Quality | None = None,
    *,
    size: tuple[int, int] = (1280, 720),
    outputs: Outputs = ("color",),
    background: Background = None,
    cull: Cull = "none",
    threads: int | None = None,
    rounds: int = ROUNDS,
) -> FrameProfile:
    """
    Render a frame some times, without each effect that it uses, and with what it could use besides.

    What it could use is what needs no more than the scene has: samples, mip levels, shadows of its
    lights, ambient occlusion, an outline, a tone curve, a vignette. The frames take turns, so that
    a machine that slows down slows all of them. Whatever has to be compiled is compiled before.

    Parameters
    ----------
    what, camera, quality, size, outputs, background, cull, threads
        As `rasterjit.render` takes them.
    rounds : int
        Frames of each kind, 1 to a million.

    Returns
    -------
    FrameProfile

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    if isinstance(rounds, bool) or not isinstance(rounds, int) or not 1 <= rounds <= MAX_ROUNDS:
        raise ValueError(
            f"rounds must be a whole number above 0, at most {MAX_ROUNDS}, got {short_repr(rounds)}"
        )
    scene, quality = pose_input(what), check_quality(quality)
    size = image_size("size", size)
    camera = choose_camera(scene, camera, size)
    options = {"outputs": outputs, "background": background, "cull": cull}
    first = Subject("", "as it is", scene, quality, Renderer.timed(size, quality, threads))
    with first.renderer:
        plan = first.draw(camera, options).plan
        subjects = [first]
        try:
            for name, label, changed, other in variations(plan, scene, quality):
                renderer = Renderer.timed(size, other, threads)
                # The first one has told it.
                renderer.warned = None
                subjects.append(Subject(name, label, changed, other, renderer))
            frames = _run_rounds(subjects, camera, options, rounds)
        finally:
            for subject in subjects[1:]:
                subject.renderer.close()
    names = [frame.stats.seconds for frame in frames[0]]
    stages = {
        stage: statistics.median(seconds[stage] for seconds in names)
        for stage in names[0]
        if stage != "compile"
    }
    times = [statistics.median(seconds_of(frame) for frame in some) for some in frames]
    changes = tuple(
        Change(subject.name, subject.what, time, time - times[0])
        for subject, time in zip(subjects[1:], times[1:], strict=True)
    )
    effects = available_processors() if threads is None else threads
    return FrameProfile(plan, effects, rounds, stages, times[0], changes)


class Subject(NamedTuple):
    """One kind of frame that is measured."""

    name: str
    what: str
    scene: Scene
    quality: Quality
    renderer: Renderer

    def draw(self, camera: Camera, options: dict[str, Any]) -> Frame:
        """Render it once."""
        return self.renderer.render(self.scene, camera, **options)


def _run_rounds(
    subjects: Sequence[Subject], camera: Camera, options: dict[str, Any], rounds: int
) -> list[list[Frame]]:
    """Draw every kind of frame in turn, round by round, after one of each to compile."""
    for subject in subjects:
        subject.draw(camera, options)
    frames: list[list[Frame]] = [[] for _ in subjects]
    for _ in range(rounds):
        for subject, taken in zip(subjects, frames, strict=True):
            taken.append(subject.draw(camera, options))
    return frames


Variation = tuple[str, str, Scene, Quality]
"""Name of the effect, the change, and the resulting scene and quality."""

OFF = "off"


def variations(plan: RenderPlan, scene: Scene, quality: Quality) -> list[Variation]:
    """Return the scene without each effect that is in, and with each that it could have."""
    result: list[Variation] = []
    for planned in plan.planned:
        changed = planned.effect.without(scene)
        if changed is not None:
            result.append((planned.name, OFF, changed, quality))
    for effect in EFFECTS:
        description, changed = effect.add(scene, quality)
        if changed is not None and _is_used(effect.name, plan, changed, quality):
            result.append((effect.name, description, changed, quality))
    for planned in plan.planned:
        if isinstance(planned.effect, QualityEffect):
            result.append((planned.name, OFF, scene, planned.effect.quality_without(quality)))
    for effect in EFFECTS:
        if not isinstance(effect, QualityEffect):
            continue
        description, other = effect.quality_with(quality)
        if other is not None and _is_used(effect.name, plan, scene, other):
            result.append((effect.name, description, scene, other))
    return result


def _is_used(name: str, plan: RenderPlan, scene: Scene, quality: Quality) -> bool:
    """Tell whether another scene or quality would have an effect in a frame that is else alike."""
    background = plan.background if plan.facts.has_background else None
    if plan.facts.background_image is not None:
        background = plan.facts.background_image
    request = FrameRequest(plan.size, quality, plan.outputs, background, plan.cull)
    return plan_frame(request, scene, plan.camera).has(name)
