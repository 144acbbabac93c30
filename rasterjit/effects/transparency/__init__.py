"""
Order-independent transparency of blended objects.

A frame has it where a blended object in view has an alpha below 1. The transparent faces of each
sample are sorted, shaded and composited; see ``rendering.resolve_layers``.
"""

from __future__ import annotations

from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import Effect
from rasterjit.survey.facts import Facts, describe_changed_settings
from rasterjit.survey.material_features import with_opaque_materials
from rasterjit.survey.transparency import describe_blending


class Blending(Effect):
    """Lay faces over what lies behind them."""

    name = "transparency"
    settings = ("transparency_layers", "visible_alpha")
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why nothing is seen through."""
        return "" if facts.transparency.used else facts.transparency.reason

    def describe(self, facts: Facts) -> str:
        """Say why anything is seen through, how much of it, and what it is mixed in."""
        transparency, quality = facts.transparency, facts.quality
        most = quality.transparency_layers
        nearest = "" if most == "all" else f", the nearest {most} at a sample"
        if most == 1:
            nearest = ", the nearest one at a sample"
        hits = describe_changed_settings(facts, "visible_alpha")
        return transparency.reason + nearest + describe_blending(quality) + hits

    def without(self, scene: Scene) -> Scene:
        """Return the scene with opaque materials."""
        return with_opaque_materials(scene)


TRANSPARENCY = Blending()
