"""Switch effects of a scene on and off, and measure the cost of each."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from rasterjit.rendering.effect_registry import EFFECTS, effect_named
from rasterjit.rendering.quality_selection import seconds_of
from rasterjit.rendering.renderer import Renderer, explain
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import ModalEffect

FRAMES_PER_VARIANT = 3
"""Frames measured per variant; the median counts."""

MODAL_EFFECTS = {effect.key: effect for effect in EFFECTS if isinstance(effect, ModalEffect)}
"""Effects with several modes, by key."""

EFFECT_KEYS = {one.key: one.name for one in EFFECTS if one.key and one.key not in MODAL_EFFECTS}
"""Names of the effects that keys switch, by key."""

EFFECTS_PER_ROW = 3
"""Effects in a row of the help."""


def make_help_rows() -> list[tuple[str, str]]:
    """Return the rows of the help: keys and effects."""
    rows = [
        (key.upper(), f"{effect.name}: {', '.join(effect.modes.values())}, off")
        for key, effect in MODAL_EFFECTS.items()
    ]
    keys = list(EFFECT_KEYS)
    for n in range(0, len(keys), EFFECTS_PER_ROW):
        some = keys[n : n + EFFECTS_PER_ROW]
        rows.append((" ".join(some).upper(), ", ".join(EFFECT_KEYS[key] for key in some)))
    return rows


def find_used_effects(scene: Scene, camera: Camera, size: tuple[int, int]) -> set[str]:
    """Return the names of the effects that a picture uses."""
    plan = explain(scene, camera, Quality.standard(), size=size)
    return {planned.name for planned in plan.planned}


def toggle(scene: Scene, name: str, used: set[str]) -> Scene | None:
    """
    Return the scene with an effect switched on or off; None if it cannot be.

    Parameters
    ----------
    scene : Scene
        Stays as it is.
    name : str
        One of ``EFFECT_KEYS``.
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


def list_switchable(scene: Scene, used: set[str]) -> list[str]:
    """Return the names of the used effects that can be switched off."""
    return [
        effect.name
        for effect in EFFECTS
        if effect.name in used and effect.without(scene) is not None
    ]


def measure_costs(
    renderer: Renderer, scene: Scene, camera: Camera, names: Sequence[str]
) -> dict[str, float]:
    """
    Measure the cost of effects: by how much a frame is slower with each.

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
    for number in range(FRAMES_PER_VARIANT + 1):
        for name, one in scenes.items():
            seconds = seconds_of(renderer.render(one, camera))
            if number > 0:
                times[name].append(seconds)
    medians = {name: statistics.median(some) for name, some in times.items()}
    whole = medians["frame"]
    return {name: whole if name == "frame" else whole - own for name, own in medians.items()}
