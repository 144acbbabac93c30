"""Measure the time of a frame: of its stages, of its effects, and of effects it could have."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from rasterjit.outputs.frame import Frame
from rasterjit.outputs.output_table import Outputs
from rasterjit.rendering import planning
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.rendering.planning import Cull, FrameRequest, choose_camera, make_plan
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
"""Default and largest number of frames of each kind whose median time is taken."""


class Change(NamedTuple):
    """Time of a frame with one change."""

    name: str
    what: str
    """``"off"``, or the change in words."""
    seconds: float
    """Median time of the frame with the change."""
    difference: float
    """This time less that of the unchanged frame."""


@dataclass(frozen=True, repr=False)
class FrameProfile(TextReport):
    """
    Stages, effects and times of a frame; prints as a table.

    Attributes
    ----------
    plan : RenderPlan
    threads : int
    rounds : int
        Number of frames whose median each time is.
    stages : dict of float
        Seconds of each stage, in order, without compiling.
    changes : tuple of Change
        The frame without each effect that it uses, and with each that it could use.
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
        name_width = max(len(name) for name, _ in rows)
        times = "\n".join(f"  {name:<{name_width}}  {text}" for name, text in rows)
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
    Time a frame, also without each effect that it uses, and with each that it could use.

    It could use what needs no more than the scene has: samples, mip levels, shadows of its lights,
    ambient occlusion, an outline, a tone curve, a vignette. The frames take turns, so that a
    machine that slows down slows all of them. Kernels are compiled before.

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
    unchanged = FrameKind("", "as it is", scene, quality, Renderer.timed(size, quality, threads))
    with unchanged.renderer:
        plan = unchanged.draw(camera, options).plan
        kinds = [unchanged]
        try:
            for name, change, changed, changed_quality in list_variations(plan, scene, quality):
                renderer = Renderer.timed(size, changed_quality, threads)
                # The unchanged frame has warned already.
                renderer.warned = None
                kinds.append(FrameKind(name, change, changed, changed_quality, renderer))
            frames = _draw_rounds(kinds, camera, options, rounds)
        finally:
            for kind in kinds[1:]:
                kind.renderer.close()
    stage_seconds = [frame.stats.seconds for frame in frames[0]]
    stages = {
        stage: statistics.median(seconds[stage] for seconds in stage_seconds)
        for stage in stage_seconds[0]
        if stage != "compile"
    }
    times = [statistics.median(map(seconds_of, frames_of_kind)) for frames_of_kind in frames]
    changes = tuple(
        Change(kind.name, kind.change, time, time - times[0])
        for kind, time in zip(kinds[1:], times[1:], strict=True)
    )
    threads = available_processors() if threads is None else threads
    return FrameProfile(plan, threads, rounds, stages, times[0], changes)


class FrameKind(NamedTuple):
    """One kind of frame to time."""

    name: str
    change: str
    scene: Scene
    quality: Quality
    renderer: Renderer

    def draw(self, camera: Camera, options: dict[str, Any]) -> Frame:
        """Render one frame of this kind."""
        return self.renderer.render(self.scene, camera, **options)


def _draw_rounds(
    kinds: Sequence[FrameKind], camera: Camera, options: dict[str, Any], rounds: int
) -> list[list[Frame]]:
    """Return the frames of each kind, drawn in turns, after one of each to compile."""
    for kind in kinds:
        kind.draw(camera, options)
    by_round = [[kind.draw(camera, options) for kind in kinds] for _ in range(rounds)]
    return [list(frames) for frames in zip(*by_round, strict=True)]


Variation = tuple[str, str, Scene, Quality]
"""Name of the effect, the change, and the resulting scene and quality."""

OFF = "off"


def list_variations(plan: RenderPlan, scene: Scene, quality: Quality) -> list[Variation]:
    """Return the scene without each effect that is used, and with each that could be."""
    variations: list[Variation] = []
    for planned in plan.planned:
        changed = planned.effect.without(scene)
        if changed is not None:
            variations.append((planned.name, OFF, changed, quality))
    for effect in EFFECTS:
        description, changed = effect.add(scene, quality)
        if changed is not None and _is_used(effect.name, plan, changed, quality):
            variations.append((effect.name, description, changed, quality))
    for planned in plan.planned:
        if isinstance(planned.effect, QualityEffect):
            variations.append((planned.name, OFF, scene, planned.effect.quality_without(quality)))
    for effect in EFFECTS:
        if not isinstance(effect, QualityEffect):
            continue
        description, changed_quality = effect.quality_with(quality)
        if changed_quality is not None and _is_used(effect.name, plan, scene, changed_quality):
            variations.append((effect.name, description, scene, changed_quality))
    return variations


def _is_used(name: str, plan: RenderPlan, scene: Scene, quality: Quality) -> bool:
    """Tell whether an effect is used in a frame with another scene or quality."""
    background = plan.background if plan.facts.has_background else None
    if plan.facts.background_image is not None:
        background = plan.facts.background_image
    request = FrameRequest(plan.size, quality, plan.outputs, background, plan.cull)
    return make_plan(request, scene, plan.camera).has(name)
