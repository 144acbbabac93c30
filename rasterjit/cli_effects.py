"""Options that add effects to what is rendered."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from rasterjit.cli_options import ColorType, FiniteType, SettingType, add_options
from rasterjit.scene.quality import LEVELS, PRESETS, Quality

if TYPE_CHECKING:
    from rasterjit.scene.scene import Scene

SAMPLES = tuple(str(level) for level in LEVELS["samples"])
"""Choices of ``Quality.samples``."""

SKY = "sky"
"""What stands for the default gradient where a picture of the environment is asked for."""

SUN_DIRECTION = (-0.6, -1.0, -0.5)
SUN_INTENSITY = 0.9
FILL_INTENSITY = 0.15
"""The sun that casts shadows in a scene without lights, and the ambient light beside it."""


class Effects(NamedTuple):
    """Options that add effects."""

    shadows: bool
    environment: str | None
    ambient_occlusion: bool
    outline: str | None
    tone_map: str | None
    exposure: float | None
    samples: str | None = None
    preset: str = "standard"
    changes: tuple[dict[str, Any], ...] = ()

    def quality(self) -> Quality:
        """Return the quality that was asked for, or raise click's usage error."""
        changed: dict[str, Any] = {}
        if self.samples is not None:
            changed["samples"] = self.samples if self.samples == "area" else int(self.samples)
        for change in self.changes:
            for name, level in change.items():
                if changed.setdefault(name, level) != level:
                    raise click.UsageError(f"{name} is given twice: {changed[name]} and {level}")
        try:
            return dataclasses.replace(PRESETS[self.preset](), **changed)
        except ValueError as error:
            raise click.UsageError(str(error)) from None

    def apply(self, scene: Scene) -> None:
        """Add the effects to a scene."""
        from rasterjit.scene.ambient_occlusion import AmbientOcclusion
        from rasterjit.scene.environment import Environment
        from rasterjit.scene.outline import Outline
        from rasterjit.scene.tone_map import ToneMap

        if self.environment is not None:
            is_sky = self.environment == SKY
            scene.environment = (
                Environment.gradient() if is_sky else Environment.from_file(self.environment)
            )
        if self.shadows:
            _cast_shadows(scene)
        if self.ambient_occlusion:
            scene.ambient_occlusion = AmbientOcclusion()
        if self.outline is not None:
            scene.outline = Outline(self.outline)
        if self.tone_map is not None or self.exposure is not None:
            scene.tone_map = ToneMap(self.tone_map or "none", self.exposure or 0.0)


def _cast_shadows(scene: Scene) -> None:
    """Let all lights but ambient ones cast shadows; a scene without any gets a sun."""
    from rasterjit.scene.light import AmbientLight, DirectionalLight, Shadow

    if all(isinstance(light, AmbientLight) for light in scene.lights):
        if not scene.lights and scene.environment is None:
            scene.lights.append(AmbientLight(intensity=FILL_INTENSITY))
        scene.lights.append(DirectionalLight(SUN_DIRECTION, intensity=SUN_INTENSITY))
    scene.lights = [
        light
        if isinstance(light, AmbientLight) or light.shadow is not None
        else dataclasses.replace(light, shadow=Shadow())
        for light in scene.lights
    ]


def quality_options(command: Callable) -> Callable:
    """Add the options of `Effects` to a command that say how accurately to render."""
    settings = [
        click.option("--quality", "preset", type=click.Choice(tuple(PRESETS)), default="standard",
                     show_default=True, help="How accurately to render."),
        click.option("--set", "changes", type=SettingType(), multiple=True,
                     help="Change one accuracy setting, as shadow_size=2048; may be repeated."),
        click.option("--samples", type=click.Choice(SAMPLES),
                     help="Samples of each pixel against jagged edges; area is exact, slow. "
                          "Short for --set samples=..."),
    ]  # fmt: skip
    return add_options(settings, command)


def effect_options(command: Callable | None = None, *, quality: bool = True) -> Callable:
    """Add the options of `Effects` to a command, perhaps without those of quality."""
    if command is None:
        return lambda command: effect_options(command, quality=quality)
    command = add_options(
        [
            click.option("--shadows", is_flag=True,
                         help="Let the lights cast shadows; without lights, a sun."),
            click.option("--environment", metavar="FILE|sky",
                         help="Light from all around: an equirectangular picture, or a sky."),
            click.option("--ambient-occlusion", is_flag=True, help="Dim ambient light in corners."),
            click.option("--outline", type=ColorType(), help="Draw outlines in this colour."),
            click.option("--tone-map", type=click.Choice(["none", "reinhard", "aces", "neutral"]),
                         help="Curve from light to what the screen shows."),
            click.option("--exposure", metavar="STOPS", type=FiniteType(-32.0, 32.0),
                         help="Doublings of the light before the curve."),
        ],
        command,
    )  # fmt: skip
    return quality_options(command) if quality else command
