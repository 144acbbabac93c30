"""
Draw the picture behind glass: the same view without all that transmits and all that is blended.

It is drawn as any picture, with the lights, shadows, fog and background of the frame, in linear
light; at as many samples as the frame has. Its shadow maps are its own, fitted to what it shows, so
that glass changes no bit of what is seen beside it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rasterjit.pipeline.visibility.draw import Seen
from rasterjit.rendering import shade
from rasterjit.survey.effect import FrameContext, Planned, SeesThrough
from rasterjit.survey.plan import RenderPlan


def effect_of(plan: RenderPlan) -> Planned | None:
    """Return the effect that shows what lies behind glass; ``None`` where a frame has none."""
    return next((one for one in plan.planned if isinstance(one.effect, SeesThrough)), None)


def plan_behind(plan: RenderPlan, own: Planned) -> RenderPlan:
    """Return the plan of the picture behind what transmits, given the effect that shows it."""
    layers, hidden = plan.layers, own.effect.hidden(plan.facts)
    if layers is not None and layers.has_blended:
        hidden = hidden | (layers.is_blended > 0)
    if layers is not None:
        opaque = np.zeros_like(layers.is_blended)
        layers = layers._replace(is_blended=opaque, has_blended=False, mixes_codes=False)
        layers = None if layers.samples == 1 else layers
    drawn = None if plan.drawn_behind is None else (plan.drawn_behind,)

    def is_behind(planned: Planned) -> bool:
        places = planned.effect.places
        return planned is not own and "overlay" not in places and "mixed" not in places

    return plan.with_(is_behind, outputs=("linear",), layers=layers, hidden=hidden, drawn=drawn)


def draw_behind(
    context: FrameContext, own: Planned, find: Callable[[RenderPlan], Seen]
) -> FrameContext:
    """Return the picture behind what transmits, as far as visibility."""
    plan = plan_behind(context.plan, own)
    return FrameContext(plan, context.cache, *find(plan)[2:], context.workers)


def look_behind(context: FrameContext, find: Callable[[RenderPlan], Seen]) -> FrameContext:
    """
    Return a picture that knows what is seen through glass; itself where there is none.

    Parameters
    ----------
    context : FrameContext
    find : callable
        Returns what the picture of another plan shows.
    """
    plan = context.plan
    own = effect_of(plan)
    if own is None:
        return context
    (done,) = plan.drawn or ({},)
    if own.name in done:
        record = own.effect.of_part(done[own.name], plan.corner)
        return context._replace(plan=plan.with_(drawn=({**done, own.name: record},)))
    linear = shade.shade_faces(draw_behind(context, own, find))["linear"]
    record = own.effect.prepare(context, own.data, [(plan.camera, linear)])
    return context._replace(plan=plan.with_(drawn=({**done, own.name: record},)))
