"""
All effects: the rows of ``explain``, in its order. Where each acts, its ``places`` say.

No other file of ``rendering`` names one. Materials and lights have rows among them.
"""

from __future__ import annotations

from rasterjit.effects.ambient_occlusion import AMBIENT_OCCLUSION
from rasterjit.effects.antialiasing import ANTIALIASING
from rasterjit.effects.background_image import BACKGROUND_IMAGE
from rasterjit.effects.environment import BACKGROUND, LIGHT
from rasterjit.effects.eye_dome import EYE_DOME
from rasterjit.effects.fog import FOG
from rasterjit.effects.label import LABELS
from rasterjit.effects.outline import OUTLINE
from rasterjit.effects.outline.hidden import HIDDEN_EDGES
from rasterjit.effects.section import SECTION, SECTION_LINES
from rasterjit.effects.section.hatching import SECTION_HATCHING
from rasterjit.effects.shadows import SHADOWS
from rasterjit.effects.tone_map import TONE_MAPPING
from rasterjit.effects.transmission import TRANSMISSION
from rasterjit.effects.transparency import TRANSPARENCY
from rasterjit.effects.vignette import VIGNETTE
from rasterjit.effects.wireframe import WIREFRAME
from rasterjit.survey import material_features as rows
from rasterjit.survey.effect import (
    ActiveEffect,
    Effect,
    FrameContext,
    Planning,
    ScreenEffect,
    UnusedEffect,
    UsedEffect,
)
from rasterjit.survey.facts import Facts

EFFECTS: tuple[Effect, ...] = (
    rows.ShadingRow(),
    rows.LightsRow(),
    SHADOWS,
    rows.SmoothNormalsRow(),
    rows.TextureRow(),
    rows.ScalarFieldRow(),
    rows.AlphaMaskRow(),
    rows.MicrofacetRow(),
    rows.TextureMapRow("normal maps", "normal_texture"),
    rows.TextureMapRow("metallic-roughness maps", "metallic_roughness_texture"),
    rows.TextureMapRow("occlusion maps", "occlusion_texture"),
    rows.EmissionRow(),
    *rows.LAYER_ROWS,
    rows.SingleSidedRow(),
    LIGHT,
    BACKGROUND,
    BACKGROUND_IMAGE,
    EYE_DOME,
    FOG,
    TRANSMISSION,
    TONE_MAPPING,
    AMBIENT_OCCLUSION,
    VIGNETTE,
    HIDDEN_EDGES,
    OUTLINE,
    SECTION,
    SECTION_HATCHING,
    SECTION_LINES,
    TRANSPARENCY,
    ANTIALIASING,
    WIREFRAME,
    LABELS,
    rows.DiagnosticsRow(),
)


DECIDED_ANEW = tuple(n for n, effect in enumerate(EFFECTS) if not effect.needs_facts_only)
"""Numbers of effects that are decided anew for each frame."""


def effect_named(name: str) -> Effect:
    """Return the effect of a row."""
    return next(effect for effect in EFFECTS if effect.name == name)


def decide_effects(
    facts: Facts, planning: Planning, known: tuple[UsedEffect | UnusedEffect, ...] | None = None
) -> tuple[UsedEffect | UnusedEffect, ...]:
    """
    Decide for every effect, in order, whether a frame needs it.

    ``known`` are the answers of an earlier frame of the same facts: they themselves are returned
    where all still hold.
    """
    if known is None:
        return tuple([effect.decide(facts, planning) for effect in EFFECTS])
    changed = {}
    for n in DECIDED_ANEW:
        answer = EFFECTS[n].decide(facts, planning)
        if answer.used or known[n].used:
            changed[n] = answer
    if not changed:
        return known
    return tuple([changed.get(n, answer) for n, answer in enumerate(known)])


def prepare_effects(context: FrameContext) -> tuple[ActiveEffect, ...]:
    """Prepare the effects of a picture, except those already prepared for the whole."""
    plan, found = context.plan, []
    (done,) = plan.drawn or ({},)
    for planned in plan.planned:
        effect = planned.effect
        if not effect.places or "overlay" in effect.places:
            continue
        if planned.name in done:
            record = done[planned.name]
        else:
            own = effect.analyse(context) if isinstance(effect, ScreenEffect) else None
            seen = [(plan.camera, own)]
            record = effect.prepare(context, planned.data, seen)
        if record is not None:
            found.append(ActiveEffect(effect, record))
    return tuple(found)
