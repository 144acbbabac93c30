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
from rasterjit.survey.facts import explain_float64, explain_unlit

TRIED_PRESETS = ("draft", "high")
"""Presets that are tried besides the standard and the reference, which are drawn anyway."""

COMBINED_LEVELS: dict[str, tuple[Any, ...]] = {
    "samples": (2, 4, 8, 16),
    "shading": ("vertex",),
    "texture_filter": ("nearest", "anisotropic8"),
    "shadow_size": (512, 2048),
    "transparency_layers": (2,),
    "lines": ("coverage",),
}
"""Levels that are combined, besides the standard's: those whose price is highest."""

MAX_COMBINATIONS = 24
"""Most combinations of settings that are tried; of more, an even selection."""


class Attempt(NamedTuple):
    """A quality to be tried, named as `Trial` is."""

    setting: str
    level: str
    quality: Quality
    scene: Scene | None = None
    """Scene to draw in place of the studied one, to measure one of its effects; None: the same."""

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
    """Return the settings that are named, all for None, or raise ``ValueError``."""
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


def without_effect(plan: RenderPlan, knobs: Sequence[str]) -> dict[str, str]:
    """Return which of some settings change nothing in a frame, with the reason in words."""
    facts = plan.facts
    if not facts.visible.objects:
        return dict.fromkeys(knobs, "no object is in view")
    reasons = {
        name: REASONS[name](plan) if name in REASONS else _why_out(plan, name) for name in knobs
    }
    return {name: reason for name, reason in reasons.items() if reason is not None}


def single_attempts(knobs: Sequence[str]) -> list[Attempt]:
    """Return the levels of some settings, each changed from the standard alone."""
    standard = Quality.standard()
    return [
        Attempt(name, str(level), replace(standard, **{name: level}))
        for name in knobs
        for level in LEVELS[name]
        if level != getattr(standard, name) and is_possible(standard, {name: level})
    ]


def is_on_axis(attempt: Attempt) -> bool:
    """Tell whether a level of one setting is among those that are combined."""
    return getattr(attempt.quality, attempt.setting) in COMBINED_LEVELS.get(attempt.setting, ())


def preset_attempts(knobs: Sequence[str]) -> list[Attempt]:
    """Return the presets that change more than one of some settings."""
    standard, found = Quality.standard(), []
    for preset in TRIED_PRESETS:
        changes = differences(PRESETS[preset](), standard)
        changes = {name: level for name, level in changes.items() if name in knobs}
        if len(changes) > 1:
            found.append(Attempt(COMBINATIONS, preset, replace(standard, **changes)))
    return found


def combined_attempts(knobs: Sequence[str], useless: Collection[str] = ()) -> list[Attempt]:
    """
    Return products of some settings that change more than one of them, and are no preset.

    Labels of levels that are ``useless`` by themselves are in none.
    """
    standard = Quality.standard()
    known = [attempt.quality for attempt in preset_attempts(knobs)]
    products = [changes for changes in _products(knobs, useless) if is_possible(standard, changes)]
    found = [
        Attempt(COMBINATIONS, format_changes(changes), replace(standard, **changes))
        for changes in pick_evenly(products, MAX_COMBINATIONS)
    ]
    return [attempt for attempt in found if attempt.quality not in known]


def _products(knobs: Sequence[str], useless: Collection[str]) -> list[dict[str, Any]]:
    """Return all choices of levels from the axes that change two settings or more."""
    axes = [
        (name, [level for level in COMBINED_LEVELS[name] if f"{name}={level}" not in useless])
        for name in COMBINED_LEVELS
        if name in knobs
    ]
    standard = Quality.standard()
    choices = [[(name, level) for level in (getattr(standard, name), *axis)] for name, axis in axes]
    found = []
    for choice in itertools.product(*choices):
        changes = {name: level for name, level in choice if level != getattr(standard, name)}
        if len(changes) > 1:
            found.append(changes)
    return sorted(found, key=len)


def pick_evenly(items: Sequence[Any], count: int) -> list[Any]:
    """Return ``count`` of the items, from the first on and equally far apart, or all of fewer."""
    if len(items) <= count:
        return list(items)
    return [items[number * len(items) // count] for number in range(count)]


def format_changes(changes: dict[str, Any]) -> str:
    """Return changed settings as they are written on the command line."""
    return " ".join(f"{name}={level}" for name, level in changes.items())


def is_possible(quality: Quality, changes: dict[str, Any]) -> bool:
    """Tell whether a quality takes some changes."""
    try:
        replace(quality, **changes)
    except ValueError:
        return False
    return True


def _why_out(plan: RenderPlan, setting: str) -> str | None:
    """Return why the effects that a setting is for are out; None if one is in, or there is none."""
    asked = [one for one in plan.effects if setting in one.effect.settings]
    return asked[0].reason if asked and not any(one.used for one in asked) else None


def _not_interpolated(plan: RenderPlan) -> str | None:
    """Say why nothing is interpolated over a face."""
    if isinstance(plan.camera, OrthographicCamera):
        return "the camera is orthographic: what is linear on a face is linear on the screen"
    facts = plan.facts
    if facts.is_lit or facts.needs_textures or plan.effects_at("sample") or facts.needs_alpha_tests:
        return None
    return _why_out(plan, "interpolation")


def _not_lit_finely(plan: RenderPlan) -> str | None:
    """Say why no material is lit by the vertex or the pixel that could do with less."""
    if not plan.facts.is_lit:
        return explain_unlit(plan.facts)
    if not plan.facts.visible.shadings & {"gouraud", "phong"}:
        return "no material in view is gouraud or phong"
    return None


def _without_pixel_normals(plan: RenderPlan) -> str | None:
    """Say why no normals are interpolated."""
    if not plan.facts.is_lit:
        return explain_unlit(plan.facts)
    if not plan.facts.visible.shadings & {"phong", "pbr"}:
        return "no material in view is phong or pbr: no normals are interpolated"
    return None


def _not_in_float32(plan: RenderPlan) -> str | None:
    """Say why colours are interpolated in float64 whatever is asked for."""
    if not plan.facts.shades:
        return _why_out(plan, "interpolation_precision")
    return explain_float64(plan.facts)


def _not_blended(plan: RenderPlan) -> str | None:
    """Say why nothing is mixed."""
    transparency = plan.facts.transparency
    if transparency.used:
        return None
    return f"{transparency.reason}, and the standard has one sample a pixel"


REASONS: dict[str, Callable[[RenderPlan], str | None]] = {
    "interpolation": _not_interpolated,
    "shading": _not_lit_finely,
    "renormalize": _without_pixel_normals,
    "blending": _not_blended,
    "interpolation_precision": _not_in_float32,
}
"""Functions that say why a setting has no effect in a frame; effects say it of other settings."""
