"""Warn of what a picture does not show: nothing is in view, planes cut faces away, all is white."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import Frame, Stats
from rasterjit.scene.warning import warn_caller
from rasterjit.survey.clip_planes import Look
from rasterjit.survey.lights import most_light
from rasterjit.survey.plan import RenderPlan

NOTHING_IN_VIEW = "nothing is in view: the picture shows only the background"


STRONG = 2.0
"""Light that common surfaces are not burnt out by."""

WHITE = 254
"""Codes from here on show nothing any more."""

LOOKED_AT = 64
"""Rows and columns of a picture that are looked at, of as many as there are."""


class ViewWarning(UserWarning):
    """
    Nothing is in view, a plane that was given cuts away what else were, or all of it is white.

    That is: light burns out more than half of what is seen.
    """


class Told:
    """What there is to warn of of many views: of each kind, the first that it is said of."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[int, str]] = {}

    def add(self, number: int, notices: dict[str, str]) -> None:
        """Add what there is to warn of of a view."""
        for kind, text in notices.items():
            if kind not in self._found or number < self._found[kind][0]:
                self._found[kind] = number, text

    def of(self, number: int) -> dict[str, str]:
        """Return what a view is the first of to warn of, by kind."""
        return {kind: text for kind, (first, text) in self._found.items() if first == number}

    def join(self, other: Told) -> None:
        """Add what there is to warn of of other views."""
        for kind, (number, text) in other._found.items():
            self.add(number, {kind: text})

    def named(self) -> dict[str, str]:
        """Return what there is to warn of, by kind, with the camera of the view."""
        return {kind: f"{text} (cameras[{number}])" for kind, (number, text) in self._found.items()}


def shows_anything(plan: RenderPlan, stats: Stats) -> bool:
    """Tell whether a face covers a sample or, of edges alone, whether any may be in view."""
    if not plan.facts.finds_faces:
        return stats.drawn + stats.unsampled + stats.degenerate > 0
    # Faces with holes may be holes everywhere.
    return stats.drawn > 0 and (not plan.facts.tests_hits or stats.pixels_covered > 0)


def notices_of(plan: RenderPlan, stats: Stats | None = None) -> dict[str, str]:
    """
    Return what there is to warn of, by kind.

    Parameters
    ----------
    plan : RenderPlan
    stats : Stats, optional
        Of the whole frame. Default: it is not drawn yet, and only objects out of view tell that
        nothing is in view.
    """
    found = cuts_of(plan.look)
    is_empty = not plan.facts.in_view.any() if stats is None else not shows_anything(plan, stats)
    if is_empty and not found:
        found["view"] = NOTHING_IN_VIEW
    return found


def notices_of_frame(frame: Frame) -> dict[str, str]:
    """Return what there is to warn of a frame that is drawn, by kind."""
    found = notices_of(frame.plan, frame.stats)
    most = strong_light(frame.plan)
    if most:
        found |= notice_of_white(frame.plan, most, frame.color, frame.stats.pixels_covered)
    return found


def strong_light(plan: RenderPlan) -> float:
    """Return the most light of a scene where that may burn out colours, else 0."""
    facts = plan.facts
    has_own = facts.has_lights or facts.environment is not None
    # Most scenes have none, and pay nothing.
    if not (has_own and facts.is_lit and "color" in facts.outputs):
        return 0.0
    most = most_light(facts.lights.lights, facts.environment)
    return most if most > STRONG else 0.0


def notice_of_white(
    plan: RenderPlan, most: float, color: NDArray[np.uint8], covered: int
) -> dict[str, str]:
    """
    Return what there is to warn of a picture that is mostly white, by kind.

    Parameters
    ----------
    plan : RenderPlan
    most : float
        What `strong_light` returns.
    color : (H, W, 4) uint8
    covered : int
        Pixels with faces.
    """
    share = white_share(plan, color, covered)
    if share <= 0.5:
        return {}
    stops = "below 0" if math.isinf(most) else f"of about {-math.log2(most):.1f} stops"
    return {
        "white": f"{share:.0%} of what is seen is white: the light is too strong to be shown; give "
        f"the scene a ToneMap with an exposure {stops}, or let styles.studio choose it"
    }


def white_share(plan: RenderPlan, color: NDArray[np.uint8], covered: int) -> float:
    """Return the share of the pixels with faces that are white, from a part of all; 0..1."""
    height, width = color.shape[:2]
    step = max(1, min(height, width) // LOOKED_AT)
    red, green, blue = (color[::step, ::step, n] for n in range(3))
    is_white = np.minimum(np.minimum(red, green), blue) >= WHITE
    white = np.count_nonzero(is_white) / is_white.size * height * width
    facts = plan.facts
    if facts.background_image is None:
        # A sky may be white all over.
        sky = not facts.has_background and facts.environment is not None
        if sky or plan.background[:3].min() >= 1.0:
            white -= height * width - covered
    return white / covered if covered else 0.0


def cuts_of(look: Look) -> dict[str, str]:
    """Return what there is to warn of planes that cut something, by kind."""
    return {cut.name: f"camera.{cut.name} = {cut.plane:.6g} {cut}" for cut in look.cut}


def warn(notices: dict[str, str], told: set[str]) -> None:
    """Warn of what is of no kind that was told, and add that."""
    for kind in notices.keys() - told:
        warn_caller(notices[kind], ViewWarning)
    told.update(notices)
