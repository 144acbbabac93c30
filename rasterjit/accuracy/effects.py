"""
Measure the cost of each effect of a scene, and its error against its own reference.

A row of `EFFECT_OPTIONS` has the levels that an effect is drawn with besides the scene's own, and
its reference. An effect without a row is only left out, to measure its time. References are drawn
in the standard quality but for the effect, so that errors of edges and textures do not count.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.accuracy import effect_references as references
from rasterjit.accuracy.effect_references import LightReference
from rasterjit.accuracy.results import EffectCost, Errors
from rasterjit.accuracy.settings_to_try import Attempt, format_changes
from rasterjit.accuracy.timing import Contestant
from rasterjit.rendering.quality_selection import light_of, root_mean_square
from rasterjit.scene.lens import Lens
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import with_field
from rasterjit.survey.plan import RenderPlan

if TYPE_CHECKING:
    from rasterjit.accuracy.study import Studio

WITHOUT_LEVEL = "without"
"""Level name of an effect that is left out."""

LINES_NAME, LENS_NAME = "lines", "lens"
"""Effect names of lines and lenses, which are measured like effects."""

NO_REFERENCE_NAME = "none; what it changes in the picture"
"""Name of the missing reference of an effect."""


class EffectOptions(NamedTuple):
    """Levels of an effect to try, and its reference: a row of `EFFECT_OPTIONS`."""

    effect: str
    settings: tuple[dict[str, Any], ...] = ()
    """Changes of the standard quality, one dict for each level."""
    make_scenes: Callable[[Scene], dict[str, Scene]] = lambda scene: {}
    """Returns the scene with each level of the effect's description, by name."""
    draw_reference: Callable[[Studio, Scene, float], LightReference] | None = None
    """Takes the studio, the scene, and the seconds that it may take."""
    reference_name: str = NO_REFERENCE_NAME
    applies_to: Callable[[Scene], bool] = lambda scene: True
    """Tells whether the row is for a scene; the first such row of an effect is used."""


def has_soft_light(scene: Scene) -> bool:
    """Tell whether a light has a soft shadow."""
    return any(references.is_soft(light) for light in scene.lights)


def harden_shadows(scene: Scene) -> dict[str, Scene]:
    """Return the scene with hard and with filtered edges of soft shadows, by name."""
    changes: dict[str, dict[str, Any]] = {
        "hard edges": {"filter": "hard", "light_size": None},
        "edges three texels wide": {"filter": "pcf", "light_size": None},
    }
    return {name: _with_shadows(scene, change) for name, change in changes.items()}


def _with_shadows(scene: Scene, changes: dict[str, Any]) -> Scene:
    """Return a scene with other soft shadows."""
    lights = [
        replace(light, shadow=replace(light.shadow, **changes))
        if references.is_soft(light)
        else light
        for light in scene.lights
    ]
    return with_field(scene, "lights", lights)


def light_evenly(scene: Scene) -> dict[str, Scene]:
    """Return the scene with an environment of one colour, the mean of its light, by name."""
    return {"one colour": references.average_environment(scene)}


EFFECT_OPTIONS: tuple[EffectOptions, ...] = (
    EffectOptions(
        "shadows",
        settings=({"shadow_size": 512}, {"shadow_size": 2048}),
        make_scenes=harden_shadows,
        draw_reference=references.average_hard_shadows,
        reference_name="the mean of up to 64 hard shadows, from places all over each light",
        applies_to=has_soft_light,
    ),
    EffectOptions(
        "shadows",
        settings=({"shadow_size": 512}, {"shadow_size": 2048}, {"shadow_taps": 1}),
        draw_reference=references.draw_sharp_shadows,
        reference_name="shadows of maps of 4096 texels, each lookup one comparison",
    ),
    EffectOptions(
        "environment light",
        make_scenes=light_evenly,
        draw_reference=references.draw_dome_lights,
        reference_name="diffuse surfaces lit by 256 lights of equal energy, without reflections",
    ),
    EffectOptions(
        "ambient occlusion",
        draw_reference=references.trace_ambient_occlusion,
        reference_name="pictures of the half space above 100 points, weighted by the cosine",
    ),
    EffectOptions(
        "wireframe",
        settings=({"lines": "coverage"},),
        draw_reference=references.draw_line_coverage,
        reference_name="the area of each pixel that a line covers",
    ),
    EffectOptions(
        LINES_NAME,
        settings=({"samples": 4}, {"samples": 16}),
        draw_reference=references.draw_sampled_lines,
        reference_name="64 samples, where lines are seen",
    ),
    EffectOptions(
        LENS_NAME,
        settings=({"samples": 4}, {"samples": 16}),
        draw_reference=references.draw_sampled_lens,
        reference_name="64 samples of the pictures that it is resampled from",
    ),
)
"""Options to try for each effect; a new setting of one is a level in its row."""


class EffectTrial(NamedTuple):
    """An effect to be measured."""

    effect: str
    attempts: list[Attempt]
    options: EffectOptions | None


class MeasuredEffect(NamedTuple):
    """An effect whose error is measured; its levels are timed later."""

    effect: str
    levels: list[Contestant]
    rmse: float | None
    reference: str
    """Name of the reference."""

    def cost(self, standard: Contestant, clock: str) -> EffectCost:
        """Return the costs measured by a clock."""
        levels = tuple(level.trial(standard, clock) for level in self.levels)
        return EffectCost(self.effect, levels, self.rmse, self.reference)


def list_effect_trials(scene: Scene, plan: RenderPlan, lens: Lens | None) -> list[EffectTrial]:
    """Return the effects of a scene to measure, those with a reference first."""
    without = {
        planned.name: planned.effect.without(scene)
        for planned in plan.effects
        if planned.used and "lines" not in planned.name
    }
    if references.has_lines(scene):
        without[LINES_NAME] = references.remove_lines(scene)
    attempts = {
        name: [Attempt(name, WITHOUT_LEVEL, Quality.standard(), other)]
        for name, other in without.items()
        if other is not None
    }
    if lens is not None:
        attempts[LENS_NAME] = []
    trials = []
    for name in attempts:
        options = _find_options(name, scene)
        levels = [] if options is None else _list_levels(options, scene)
        trials.append(EffectTrial(name, [*attempts[name], *levels], options))
    return sorted(trials, key=lambda trial: trial.options is None)


def _find_options(effect: str, scene: Scene) -> EffectOptions | None:
    """Return the row of an effect, if it has one."""
    rows = (row for row in EFFECT_OPTIONS if row.effect == effect and row.applies_to(scene))
    return next(rows, None)


def _list_levels(options: EffectOptions, scene: Scene) -> list[Attempt]:
    """Return an attempt for each level of a row."""
    effect, standard = options.effect, Quality.standard()
    settings = [
        Attempt(effect, format_changes(changes), replace(standard, **changes), scene)
        for changes in options.settings
    ]
    scenes = options.make_scenes(scene).items()
    return [*settings, *(Attempt(effect, name, standard, changed) for name, changed in scenes)]


def measure_effect(
    studio: Studio, trial: EffectTrial, standard: Contestant, seconds: float
) -> MeasuredEffect:
    """
    Draw the levels of an effect and its reference.

    Parameters
    ----------
    studio : Studio
    trial : EffectTrial
    standard : Contestant
        The unchanged scene.
    seconds : float
        Seconds that the reference may take.
    """
    reference, reference_name, options = None, NO_REFERENCE_NAME, trial.options
    if options is not None and options.draw_reference is not None:
        reference = options.draw_reference(studio, studio.scene, seconds)
        reference_name = options.reference_name
    compared_scene = studio.scene if reference is None else reference.prepare_scene(studio.scene)
    standard_light = studio.draw_light(Quality.standard(), compared_scene)
    levels = []
    for attempt in trial.attempts:
        frame = studio.draw(attempt.quality, ("color", "linear"), attempt.scene)
        if reference is None:
            light = light_of(frame)[:, :, :3].astype(np.float64)
            difference = np.abs(light - standard_light)
        else:
            compared_scene = reference.prepare_scene(attempt.scene or studio.scene)
            difference = reference.difference(studio.draw_light(attempt.quality, compared_scene))
        errors = _measure_errors(
            difference, 1.0 if reference is None else reference.share, standard
        )
        color = frame.color[:, :, :3].copy()
        error_map = difference.max(axis=2).astype(np.float32)
        levels.append(studio.make_contestant(attempt, errors, color, error_map))
    rmse = None
    if reference is not None:
        rmse = math.sqrt(reference.share) * root_mean_square(reference.difference(standard_light))
    return MeasuredEffect(trial.effect, levels, rmse, reference_name)


def _measure_errors(difference: NDArray[np.float64], share: float, standard: Contestant) -> Errors:
    """Return the errors of light over a share of the pixels; faces are those of the standard."""
    rmse = math.sqrt(share) * root_mean_square(difference)
    psnr = -20.0 * math.log10(rmse) if rmse > 0.0 else math.inf
    wrong = standard.errors.wrong_faces
    return Errors(rmse, float(difference.max(initial=0.0)), psnr, None, wrong, None, None, None)
