"""
Measure the cost of each effect of a scene, and its error against its own reference.

`OPTIONS` is a table: a row says of an effect which levels it is drawn with besides the scene's own,
and what its reference is. An effect without a row is drawn without it, to see what it costs.
References are drawn in the standard quality but for the effect: what edges and textures lack of the
study's reference does not count as an error of the effect.
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

WITHOUT = "without"
"""Level name of an effect that is left out."""

LINES, LENS = "lines", "lens"
"""Names of lines and lenses, which are measured like effects."""

NO_REFERENCE = "none; what it changes in the picture"
"""Text for an effect without a reference."""


class Options(NamedTuple):
    """Levels of an effect that can be tried, and its reference: a row of `OPTIONS`."""

    effect: str
    settings: tuple[dict[str, Any], ...] = ()
    """Levels that a quality has: what each changes of the standard."""
    scenes: Callable[[Scene], dict[str, Scene]] = lambda scene: {}
    """Levels that the effect's description has, by name."""
    reference: Callable[[Studio, Scene, float], LightReference] | None = None
    """Takes what draws, the scene, and seconds that it may take."""
    said: str = NO_REFERENCE
    when: Callable[[Scene], bool] = lambda scene: True
    """Which scenes the row is for; the first that is counts."""


def has_soft_light(scene: Scene) -> bool:
    """Tell whether a light has a soft shadow."""
    return any(references.is_soft(light) for light in scene.lights)


def harder_shadows(scene: Scene) -> dict[str, Scene]:
    """Return a scene whose soft shadows have hard or filtered edges, by name."""
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


def evenly_lit(scene: Scene) -> dict[str, Scene]:
    """Return a scene whose environment is one colour: the mean of its light."""
    return {"one colour": references.with_even_environment(scene)}


OPTIONS: tuple[Options, ...] = (
    Options(
        "shadows",
        settings=({"shadow_size": 512}, {"shadow_size": 2048}),
        scenes=harder_shadows,
        reference=references.many_lights,
        said="the mean of up to 64 hard shadows, from places all over each light",
        when=has_soft_light,
    ),
    Options(
        "shadows",
        settings=({"shadow_size": 512}, {"shadow_size": 2048}, {"shadow_taps": 1}),
        reference=references.sharp_shadows,
        said="shadows of maps of 4096 texels, each lookup one comparison",
    ),
    Options(
        "environment light",
        scenes=evenly_lit,
        reference=references.dome_of_lights,
        said="matt surfaces lit by 256 lights of equal energy; what is mirrored is left out",
    ),
    Options(
        "ambient occlusion",
        reference=references.rays,
        said="pictures of the half space above 100 points, weighted by the cosine",
    ),
    Options(
        "wireframe",
        settings=({"lines": "coverage"},),
        reference=references.covered_lines,
        said="the area of each pixel that a line covers",
    ),
    Options(
        LINES,
        settings=({"samples": 4}, {"samples": 16}),
        reference=references.sampled_lines,
        said="64 samples, where lines are seen",
    ),
    Options(
        LENS,
        settings=({"samples": 4}, {"samples": 16}),
        reference=references.sampled_lens,
        said="64 samples of the pictures that it is resampled from",
    ),
)
"""Options to try for each effect; a new setting of one is a level in its row."""


class EffectTrial(NamedTuple):
    """An effect to be measured."""

    effect: str
    attempts: list[Attempt]
    knob: Options | None


class Measured(NamedTuple):
    """An effect whose error is measured; its levels are timed later."""

    effect: str
    levels: list[Contestant]
    rmse: float | None
    reference: str

    def cost(self, standard: Contestant, clock: str) -> EffectCost:
        """Return the costs measured by a clock."""
        levels = tuple(level.trial(standard, clock) for level in self.levels)
        return EffectCost(self.effect, levels, self.rmse, self.reference)


def effect_trials(scene: Scene, plan: RenderPlan, lens: Lens | None) -> list[EffectTrial]:
    """Return the effects of a scene to measure, those with a reference first."""
    found = {
        one.name: one.effect.without(scene)
        for one in plan.effects
        if one.used and "lines" not in one.name
    }
    without = {name: other for name, other in found.items() if other is not None}
    if references.has_lines(scene):
        without[LINES] = references.without_lines(scene)
    costs = [EffectTrial(name, [_without(name, other)], None) for name, other in without.items()]
    if lens is not None:
        costs.append(EffectTrial(LENS, [], None))
    rows = [(cost, _options_of(cost.effect, scene)) for cost in costs]
    known = [
        cost._replace(knob=knob, attempts=[*cost.attempts, *_levels(knob, scene)])
        for cost, knob in rows
        if knob is not None
    ]
    return [*known, *(cost for cost, knob in rows if knob is None)]


def _without(effect: str, scene: Scene) -> Attempt:
    """Return the standard of a scene that lacks an effect."""
    return Attempt(effect, WITHOUT, Quality.standard(), scene)


def _options_of(effect: str, scene: Scene) -> Options | None:
    """Return the row of an effect, if it has one."""
    return next((knob for knob in OPTIONS if knob.effect == effect and knob.when(scene)), None)


def _levels(knob: Options, scene: Scene) -> list[Attempt]:
    """Return the levels of a row."""
    standard = Quality.standard()
    settings = [
        Attempt(knob.effect, format_changes(changes), replace(standard, **changes), scene)
        for changes in knob.settings
    ]
    scenes = knob.scenes(scene).items()
    return [*settings, *(Attempt(knob.effect, name, standard, other) for name, other in scenes)]


def measure(studio: Studio, cost: EffectTrial, standard: Contestant, seconds: float) -> Measured:
    """
    Draw the levels of an effect and its reference.

    Parameters
    ----------
    studio : Studio
    cost : Cost
    standard : Contestant
        The scene as it is.
    seconds : float
        That the reference may take, about.
    """
    truth, said, knob = None, NO_REFERENCE, cost.knob
    if knob is not None and knob.reference is not None:
        truth, said = knob.reference(studio, studio.scene, seconds), knob.said
    own = studio.scene if truth is None else truth.compared(studio.scene)
    usual = studio.light(Quality.standard(), own)

    levels = []
    for attempt in cost.attempts:
        frame = studio.draw(attempt.quality, ("color", "linear"), attempt.scene)
        if truth is None:
            light = light_of(frame)[:, :, :3].astype(np.float64)
            difference = np.abs(light - usual)
        else:
            light = studio.light(attempt.quality, truth.compared(attempt.scene or studio.scene))
            difference = truth.difference(light)
        found = _errors(difference, 1.0 if truth is None else truth.share, standard)
        color = frame.color[:, :, :3].copy()
        error_map = difference.max(axis=2).astype(np.float32)
        levels.append(studio.contestant(attempt, found, color, error_map))
    if truth is None:
        return Measured(cost.effect, levels, None, said)
    rmse = math.sqrt(truth.share) * root_mean_square(truth.difference(usual))
    return Measured(cost.effect, levels, rmse, said)


def _errors(difference: NDArray[np.float64], share: float, standard: Contestant) -> Errors:
    """Return the errors of light; faces are those of the standard."""
    rmse = math.sqrt(share) * root_mean_square(difference)
    psnr = -20.0 * math.log10(rmse) if rmse > 0.0 else math.inf
    wrong = standard.errors.wrong_faces
    return Errors(rmse, float(difference.max(initial=0.0)), psnr, None, wrong, None, None, None)
