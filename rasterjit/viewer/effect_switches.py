"""Switch effects of a scene on and off, and tell what each one costs."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from rasterjit.rendering.effect_registry import EFFECTS, effect_named
from rasterjit.rendering.quality_selection import seconds_of
from rasterjit.rendering.renderer import Renderer, explain
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import HasModes

ROUNDS = 3
"""Frames of each kind; their median counts."""

MODED = {effect.key: effect for effect in EFFECTS if isinstance(effect, HasModes)}
"""What goes through the modes of which effect."""

KEYS = {one.key: one.name for one in EFFECTS if one.key and one.key not in MODED}
"""What switches which effect, by its name in the plan."""

TOLD_AT_ONCE = 3
"""Effects in a line of the help."""


def help_rows() -> list[tuple[str, str]]:
    """Return what keys switch, as rows: keys and effects."""
    rows = [
        (key.upper(), f"{effect.name}: {', '.join(effect.modes.values())}, off")
        for key, effect in MODED.items()
    ]
    keys = list(KEYS)
    for n in range(0, len(keys), TOLD_AT_ONCE):
        some = keys[n : n + TOLD_AT_ONCE]
        rows.append((" ".join(some).upper(), ", ".join(KEYS[key] for key in some)))
    return rows


def used_effects(scene: Scene, camera: Camera, size: tuple[int, int]) -> set[str]:
    """Return the names of the effects that a picture has."""
    plan = explain(scene, camera, Quality.standard(), size=size)
    return {planned.name for planned in plan.planned}


def switched(scene: Scene, name: str, used: set[str]) -> Scene | None:
    """
    Return the scene without an effect that it has, or with one that it has not.

    Parameters
    ----------
    scene : Scene
        Stays as it is.
    name : str
        One of ``KEYS``.
    used : set of str
        The effects that its picture has.

    Returns
    -------
    Scene or None
        None if the scene gives nothing to switch on: shadows need lights, fog needs its numbers.
    """
    effect = effect_named(name)
    if name in used:
        return effect.without(scene)
    return effect.add(scene, Quality.standard())[1]


def switchable(scene: Scene, used: set[str]) -> list[str]:
    """Return the names of the effects, of those that a picture has, that it could be without."""
    return [
        effect.name
        for effect in EFFECTS
        if effect.name in used and effect.without(scene) is not None
    ]


def costs(
    renderer: Renderer, scene: Scene, camera: Camera, names: Sequence[str]
) -> dict[str, float]:
    """
    Measure what effects cost: by how much a frame is slower than without each.

    Parameters
    ----------
    renderer : Renderer
        Its size and quality count.
    scene : Scene
    camera : Camera
    names : sequence of str
        Effects that the picture has, and could be without.

    Returns
    -------
    dict of float
        Seconds, by name; ``"frame"`` is the whole. Compiling is no part of them.
    """
    scenes = {"frame": scene, **{name: effect_named(name).without(scene) for name in names}}
    times: dict[str, list[float]] = {name: [] for name in scenes}
    # One round more, whose frames get memory.
    for number in range(ROUNDS + 1):
        for name, one in scenes.items():
            seconds = seconds_of(renderer.render(one, camera))
            if number > 0:
                times[name].append(seconds)
    medians = {name: statistics.median(some) for name, some in times.items()}
    whole = medians["frame"]
    return {name: whole if name == "frame" else whole - own for name, own in medians.items()}
