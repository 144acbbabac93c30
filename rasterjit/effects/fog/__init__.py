"""
Fog: what lies between the surfaces and the eye.

A frame has it where a face in view is shaded and the fog begins before the farthest of them. Each
sample is covered by its distance, after all light is added; costs about a tenth of shading.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.fog import stage as fog_stage
from rasterjit.pipeline.passes import Pass, ShadingNeeds
from rasterjit.pipeline.surface import attributes
from rasterjit.scene.camera import Camera
from rasterjit.scene.fog import Fog
from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import Absent, Effect, Field, InGroups, Planned, Planning
from rasterjit.survey.facts import DISTANCE_ROUNDING, Facts
from rasterjit.survey.many_views import Group
from rasterjit.survey.plan import RenderPlan

FOG_MODES = {
    "linear": fog_stage.LINEAR,
    "exp": fog_stage.EXPONENTIAL,
    "exp2": fog_stage.EXPONENTIAL_SQUARED,
}

HALVINGS = 1.4426950408889634
"""One over ln 2: the binary exponent of e."""

SQUARED_HALVINGS = 1.2011224087864498
"""Its square root: a density that is squared takes one of two equal factors."""

LARGEST = float(np.finfo(np.float32).max)


class FogRecord(NamedTuple):
    """What lies between the surfaces and the eye."""

    mode: int
    """See ``stage``."""
    color: Any
    """(3,) float32, linear."""
    end: Any
    """float32, scene units: distance that nothing is seen beyond."""
    per_range: Any
    """float32: one over the distance from where the fog begins to its end."""
    density: Any
    """float32: halvings a scene unit."""
    above: Any
    """(1,) float32, scene units: height of the eye over where the fog has its density."""
    falloff: Any
    """float32: halvings of the density a scene unit upwards; 0 for even density."""
    flat: Any
    """Number of ways of shading that light faces at their middles | None -> none."""


def fog_record(fog: Fog, camera: Camera, has_flat: bool = False) -> FogRecord:
    """Return fog as shading reads it, for a scene with or without objects shaded flat."""
    halvings = SQUARED_HALVINGS if fog.mode == "exp2" else HALVINGS
    start, end = fog.start or 0.0, fog.end or 0.0
    return FogRecord(
        FOG_MODES[fog.mode],
        np.array(fog.color, np.float32),
        np.float32(end),
        np.float32(1.0 / (end - start) if end > start else 0.0),
        np.float32((fog.density or 0.0) * halvings),
        _heights(fog, np.array(camera.eye_position()[1:2], np.float64)),
        np.float32((fog.falloff or 0.0) * HALVINGS),
        np.int64(1) if has_flat else None,
    )


def _heights(fog: Fog, eyes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return how high eyes, (N,), are above where the fog has its density."""
    return np.clip(eyes - (fog.height or 0.0), -LARGEST, LARGEST).astype(np.float32)


class FogEffect(InGroups):
    """Cover lit samples."""

    name = "fog"
    field = "fog"
    key = "n"

    def answer(self, facts: Facts, planning: Planning) -> Planned | Absent:
        """Say whether fog may cover a colour that is asked for."""
        if not facts.shades or facts.fog is None:
            return Absent(self, facts)
        return Planned(self, facts, fog_record(facts.fog, planning.camera, facts.seen.flat > 0))

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Say what fog there is, or why it covers nothing."""
        fog = facts.asked[self.field]
        if fog is None:
            return "scene.fog is None"
        if not facts.shades:
            return "no face is shaded"
        if not is_used:
            return "its density is 0" if fog.density == 0.0 else "it begins beyond everything"
        by_height = ", by height" if fog.height is not None else ""
        return f"mode {fog.mode}{by_height}"

    def answers(self, scene: Scene, group: Group) -> Any:
        """Tell which views the fog is in reach of: ``facts.is_fog_in_reach``."""
        fog = scene.fog
        if fog is None or fog.density == 0.0:
            return False
        if fog.mode != "linear" or fog.start == 0.0:
            return True
        return group.farthest() * DISTANCE_ROUNDING > fog.start

    def share(self, plan: RenderPlan, data: FogRecord, field: Field) -> FogRecord:
        """Return the fog, with the height of each view's eye."""
        return data._replace(above=field("height above fog", (1,), np.float32))

    def differ(self, scene: Scene, group: Group) -> dict[str, NDArray[np.float32]]:
        """Return the heights of the eyes."""
        fog = scene.fog
        return {} if fog is None else {"height above fog": _heights(fog, group.eyes[:, 1])}

    def neutral(self, record: FogRecord) -> FogRecord:
        """Return fog without density."""
        zero = np.float32(0.0)
        return record._replace(mode=fog_stage.EXPONENTIAL, density=zero, falloff=zero)

    @staticmethod
    def cover(fog: FogRecord, needs: ShadingNeeds) -> list[Pass]:
        """Return the passes that lay fog over what is seen."""
        passes = []
        if fog.flat is not None:
            # Find the points of what was lit at the middles of faces.
            passes = [
                Pass(attributes.gather_positions, lambda a: (a.placement.positions,)),
                Pass(attributes.find_points, lambda a: (a.placement, a.surface.materials, 1)),
            ]
        if fog.mode == fog_stage.LINEAR:
            own = fog.end, fog.per_range, fog.color
            return [*passes, Pass(fog_stage.cover_linearly, lambda a: (*own, a.viewer))]
        squares = np.float32(fog.mode == fog_stage.EXPONENTIAL_SQUARED)
        own = fog.density, squares, fog.above, fog.falloff, fog.color
        return [*passes, Pass(fog_stage.cover_exponentially, lambda a: (*own, a.viewer))]

    places: ClassVar = {"sample": cover}


FOG = FogEffect()
