"""Choose the settings and levels to try for a scene."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from rasterjit.accuracy.results import COMBINATIONS
from rasterjit.rendering.planning import RenderPlan
from rasterjit.scene.camera import OrthographicCamera
from rasterjit.scene.quality import LEVELS, PRESETS, SUPERSAMPLED, Quality, differences
from rasterjit.scene.scene import Scene
from rasterjit.survey.facts import explain_float64, explain_linear_textures, explain_unlit

TRIED_PRESETS = ("draft", "high")
"""Presets to try besides the standard and the reference, which are always drawn."""

COMBINED_LEVELS: dict[str, tuple[Any, ...]] = {
    "samples": (2, 4, 8, 16),
    "shading": ("vertex",),
    "texture_filter": ("nearest", "anisotropic8"),
    "shadow_size": (512, 2048),
    "transparency_layers": (2,),
    "lines": ("coverage",),
}
"""Levels to combine, besides the standard's: those that cost or save most time."""

MAX_COMBINATIONS = 24
"""Most combinations of settings to try; of more, an even selection."""


class Attempt(NamedTuple):
    """A quality to try, named as `Trial` is."""

    setting: str
    level: str
    quality: Quality
    scene: Scene | None = None
    """Scene to draw instead of the studied one, to measure one of its effects."""

    @property
    def label(self) -> str:
        """Name of the attempt."""
        return self.level if self.setting == COMBINATIONS else f"{self.setting}={self.level}"

    @property
    def passes(self) -> int:
        """Number of whole pictures that it draws."""
        samples = self.quality.samples
        return samples if samples in SUPERSAMPLED else 1


def check_knobs(knobs: Iterable[str] | None) -> tuple[str, ...]:
    """Return the named settings in order, all for None, or raise ``ValueError``."""
    if knobs is None:
        return tuple(LEVELS)
    if not isinstance(knobs, Iterable):
        raise ValueError(f"knobs must be names of settings, {', '.join(LEVELS)}; got {knobs!r}")
    names = (knobs,) if isinstance(knobs, str) else tuple(knobs)
    for name in names:
        if name not in tuple(LEVELS):
            raise ValueError(
                f"knobs has {name!r}, which is unknown; possible are {', '.join(LEVELS)}"
            )
    if not names:
        raise ValueError(f"knobs must name at least one of {', '.join(LEVELS)}; got none")
    return tuple(name for name in LEVELS if name in names)


def find_idle_settings(plan: RenderPlan, knobs: Sequence[str]) -> dict[str, str]:
    """Return the settings that change nothing in a frame, each with the reason in words."""
    facts = plan.facts
    if not facts.visible.objects:
        return dict.fromkeys(knobs, "no object is in view")
    reasons = {
        name: IDLE_REASONS[name](plan) if name in IDLE_REASONS else _find_effect_reason(plan, name)
        for name in knobs
    }
    return {name: reason for name, reason in reasons.items() if reason is not None}


def list_single_attempts(knobs: Sequence[str]) -> list[Attempt]:
    """Return an attempt for each level of some settings, all others as in the standard."""
    standard = Quality.standard()
    return [
        Attempt(name, str(level), replace(standard, **{name: level}))
        for name in knobs
        for level in LEVELS[name]
        if level != getattr(standard, name) and is_possible(standard, {name: level})
    ]


def is_combined(attempt: Attempt) -> bool:
    """Tell whether a level of one setting is among those that are combined."""
    return getattr(attempt.quality, attempt.setting) in COMBINED_LEVELS.get(attempt.setting, ())


def list_preset_attempts(knobs: Sequence[str]) -> list[Attempt]:
    """Return an attempt for each preset that changes more than one of some settings."""
    standard, attempts = Quality.standard(), []
    for preset in TRIED_PRESETS:
        changes = differences(PRESETS[preset](), standard)
        changes = {name: level for name, level in changes.items() if name in knobs}
        if len(changes) > 1:
            attempts.append(Attempt(COMBINATIONS, preset, replace(standard, **changes)))
    return attempts


def list_combined_attempts(knobs: Sequence[str], useless: Collection[str] = ()) -> list[Attempt]:
    """
    Return an attempt for each combination of two or more settings that is no preset.

    ``useless`` has labels of levels to leave out.
    """
    standard = Quality.standard()
    presets = [attempt.quality for attempt in list_preset_attempts(knobs)]
    products = [
        changes for changes in _list_products(knobs, useless) if is_possible(standard, changes)
    ]
    attempts = [
        Attempt(COMBINATIONS, format_changes(changes), replace(standard, **changes))
        for changes in pick_evenly(products, MAX_COMBINATIONS)
    ]
    return [attempt for attempt in attempts if attempt.quality not in presets]


def _list_products(knobs: Sequence[str], useless: Collection[str]) -> list[dict[str, Any]]:
    """Return the combinations of levels that change two settings or more, few changes first."""
    axes = [
        (name, [level for level in COMBINED_LEVELS[name] if f"{name}={level}" not in useless])
        for name in COMBINED_LEVELS
        if name in knobs
    ]
    standard = Quality.standard()
    choices = [[(name, level) for level in (getattr(standard, name), *axis)] for name, axis in axes]
    products = []
    for choice in itertools.product(*choices):
        changes = {name: level for name, level in choice if level != getattr(standard, name)}
        if len(changes) > 1:
            products.append(changes)
    return sorted(products, key=len)


def pick_evenly(items: Sequence[Any], count: int) -> list[Any]:
    """Return ``count`` evenly spaced items, the first among them; all if there are fewer."""
    if len(items) <= count:
        return list(items)
    return [items[n * len(items) // count] for n in range(count)]


def format_changes(changes: dict[str, Any]) -> str:
    """Return changed settings in the form of the command line: ``samples=4 lines=coverage``."""
    return " ".join(f"{name}={level}" for name, level in changes.items())


def is_possible(quality: Quality, changes: dict[str, Any]) -> bool:
    """Tell whether a quality with some changes is valid."""
    try:
        replace(quality, **changes)
    except ValueError:
        return False
    return True


def _find_effect_reason(plan: RenderPlan, setting: str) -> str | None:
    """Return why no effect with a setting is used; None if one is, or none has the setting."""
    effects = [one for one in plan.effects if setting in one.effect.settings]
    if not effects or any(one.used for one in effects):
        return None
    return " and ".join(dict.fromkeys(one.reason for one in effects))


def _explain_interpolation(plan: RenderPlan) -> str | None:
    """Return why perspective-correct and affine interpolation are the same; None if not."""
    if isinstance(plan.camera, OrthographicCamera):
        return "the camera is orthographic: what is linear on a face is linear on the screen"
    facts = plan.facts
    if facts.is_lit or facts.needs_textures or plan.effects_at("sample") or facts.needs_alpha_tests:
        return None
    return _find_effect_reason(plan, "interpolation")


def _explain_shading(plan: RenderPlan) -> str | None:
    """Return why no material can be lit by the vertex instead of the pixel; None if one can."""
    if not plan.facts.is_lit:
        return explain_unlit(plan.facts)
    if not plan.facts.visible.shadings & {"gouraud", "phong"}:
        return "no material in view is gouraud or phong"
    return None


def _explain_renormalize(plan: RenderPlan) -> str | None:
    """Return why no normals are interpolated; None if some are."""
    if not plan.facts.is_lit:
        return explain_unlit(plan.facts)
    if not plan.facts.visible.shadings & {"phong", "pbr"}:
        return "no material in view is phong or pbr: no normals are interpolated"
    return None


def _explain_float32(plan: RenderPlan) -> str | None:
    """Return why colours are interpolated in float64 with any setting; None if they are not."""
    if not plan.facts.shades:
        return _find_effect_reason(plan, "interpolation_precision")
    return explain_float64(plan.facts)


def _explain_blending(plan: RenderPlan) -> str | None:
    """Return why no colours are blended; None if some are."""
    transparency = plan.facts.transparency
    if transparency.used:
        return None
    return f"{transparency.reason}, and the standard has one sample a pixel"


def _explain_texture_mixing(plan: RenderPlan) -> str | None:
    """Return why no texture is mixed in codes with any setting; None if one may be."""
    if not plan.facts.shades:
        return _find_effect_reason(plan, "texture_mixing")
    return explain_linear_textures(plan.facts)


IDLE_REASONS: dict[str, Callable[[RenderPlan], str | None]] = {
    "interpolation": _explain_interpolation,
    "shading": _explain_shading,
    "renormalize": _explain_renormalize,
    "blending": _explain_blending,
    "texture_mixing": _explain_texture_mixing,
    "interpolation_precision": _explain_float32,
}
"""Functions that return why a setting changes nothing in a frame; for others, effects say it."""
