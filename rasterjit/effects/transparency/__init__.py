"""
Order-independent transparency of blended objects.

A frame has transparency where a blended object in view has an alpha below 1. The transparent faces
of each sample are sorted, shaded and composited; see ``rendering.resolve_layers``.
"""

from __future__ import annotations

from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import Effect
from rasterjit.survey.facts import Facts, describe_changed_settings
from rasterjit.survey.material_features import with_opaque_materials
from rasterjit.survey.transparency import describe_blending


class Blending(Effect):
    """Composite transparent faces over those behind."""

    name = "transparency"
    settings = ("transparency_layers", "visible_alpha")
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why no face is transparent."""
        return "" if facts.transparency.used else facts.transparency.reason

    def describe(self, facts: Facts) -> str:
        """Say why faces are transparent, how many layers count, and what is blended."""
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
