"""
Antialiasing: several samples per pixel, exact area coverage, or averaged pictures.

A frame is antialiased where the quality asks for more than one sample and something has edges.
Faces are shaded once a pixel and mixed by coverage (2 to 16, areas), or pictures are averaged (64
and more).
"""

from __future__ import annotations

from dataclasses import replace

from rasterjit.scene.quality import Quality
from rasterjit.survey.effect import QualityEffect
from rasterjit.survey.facts import Facts
from rasterjit.survey.transparency import describe_blending

SAMPLES_TO_TRY = 4
"""Samples per pixel suggested where edges are aliased."""


class Antialiasing(QualityEffect):
    """Average the samples of a pixel."""

    name = "anti-aliasing"
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why each pixel has one sample."""
        if facts.antialiases:
            return ""
        return "quality.samples is 1" if facts.quality.samples == 1 else "nothing is shaded"

    def describe(self, facts: Facts) -> str:
        """Say how edges are smoothed."""
        samples, note = facts.quality.samples, describe_blending(facts.quality)
        if facts.pictures > 1:
            note = "" if samples == facts.supersamples else f" for {samples!r}: discs, spheres"
            count = facts.supersamples
            return f"{count} pictures, moved by parts of a pixel, each shaded by itself{note}"
        if samples == "area":
            return f"exact areas, shaded once per face and pixel{note}"
        return f"{samples} samples a pixel, shaded once per face and pixel{note}"

    def quality_without(self, quality: Quality) -> Quality:
        """Return the quality with one sample a pixel."""
        return replace(quality, samples=1)

    def quality_with(self, quality: Quality) -> tuple[str, Quality | None]:
        """Return the quality with 4 samples a pixel, where vertices lie between pixels."""
        can_add_samples = quality.samples == 1 and quality.subpixel_bits > 0
        more = replace(quality, samples=SAMPLES_TO_TRY) if can_add_samples else None
        return f"{SAMPLES_TO_TRY} samples", more


ANTIALIASING = Antialiasing()
