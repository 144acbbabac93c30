"""
Antialiasing: several samples per pixel, exact area coverage, or averaged pictures.

A frame is antialiased if the quality has more than one sample and something has edges. With 2 to 16
samples, or areas, faces are shaded once in a pixel and averaged by coverage; with 64 and more,
whole pictures are averaged.
"""

from __future__ import annotations

from dataclasses import replace

from rasterjit.scene.quality import Quality
from rasterjit.survey.effect import QualityEffect
from rasterjit.survey.facts import Facts
from rasterjit.survey.transparency import describe_blending

SAMPLES_TO_TRY = 4
"""Samples per pixel that are suggested to users whose edges are aliased."""


class Antialiasing(QualityEffect):
    """Average the samples of a pixel."""

    name = "anti-aliasing"
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why each pixel has one sample; an empty string if it has several."""
        if facts.antialiases:
            return ""
        return "quality.samples is 1" if facts.quality.samples == 1 else "nothing is shaded"

    def describe(self, facts: Facts) -> str:
        """Say how edges are smoothed."""
        samples, blending = facts.quality.samples, describe_blending(facts.quality)
        if facts.pictures > 1:
            is_replaced = samples != facts.supersamples
            reason = (
                f", in place of {samples!r} as discs or spheres are seen" if is_replaced else ""
            )
            return (
                f"{facts.supersamples} pictures, moved by fractions of a pixel, each shaded by "
                f"itself{reason}"
            )
        if samples == "area":
            return f"exact areas, shaded once per face and pixel{blending}"
        return f"{samples} samples a pixel, shaded once per face and pixel{blending}"

    def quality_without(self, quality: Quality) -> Quality:
        """Return the quality with one sample a pixel."""
        return replace(quality, samples=1)

    def quality_with(self, quality: Quality) -> tuple[str, Quality | None]:
        """Return the quality with 4 samples a pixel; None if vertices are on whole pixels."""
        can_add_samples = quality.samples == 1 and quality.subpixel_bits > 0
        more = replace(quality, samples=SAMPLES_TO_TRY) if can_add_samples else None
        return f"{SAMPLES_TO_TRY} samples", more


ANTIALIASING = Antialiasing()
