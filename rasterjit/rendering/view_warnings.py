"""Warn of suspicious pictures: nothing in view, near or far plane clips faces, overexposure."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.pipeline.batch_driver import MIN_WHITE_CODE
from rasterjit.scene.warning import REPEATED, warn_caller
from rasterjit.survey.cache import SceneCache
from rasterjit.survey.clip_planes import PlaneNeeds
from rasterjit.survey.facts import Facts
from rasterjit.survey.light_culling import max_reflected_light
from rasterjit.survey.plan import RenderPlan

NOTHING_IN_VIEW = "nothing is in view: the picture shows only the background"


STRONG = 2.0
"""Largest light that does not overexpose common surfaces."""

LOOKED_AT = 64
"""Fewest rows and columns of a picture that are sampled, if it has as many."""


class ViewWarning(UserWarning):
    """
    Nothing is in view, a plane that was given cuts away what else were, or all of it is white.

    That is: light burns out more than half of the lit surfaces that are seen.
    """


class WarningsOfViews:
    """Warnings of many views: for each kind, the first view that has it."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[int, str]] = {}

    def add(self, number: int, notices: dict[str, str]) -> None:
        """Add the warnings of a view."""
        for kind, text in notices.items():
            if kind not in self._found or number < self._found[kind][0]:
                self._found[kind] = number, text

    def __bool__(self) -> bool:
        return bool(self._found)

    def of(self, number: int) -> dict[str, str]:
        """Return the warnings that a view is the first to have, by kind."""
        return {kind: text for kind, (first, text) in self._found.items() if first == number}

    def join(self, other: WarningsOfViews) -> None:
        """Add the warnings of other views."""
        for kind, (number, text) in other._found.items():
            self.add(number, {kind: text})

    def named(self) -> dict[str, str]:
        """Return the warnings by kind, with the number of the camera."""
        return {kind: f"{text} (cameras[{number}])" for kind, (number, text) in self._found.items()}


def shows_anything(plan: RenderPlan, stats: FrameStats) -> bool:
    """Tell whether a face covers a sample or, of edges alone, whether any may be in view."""
    if not plan.facts.finds_faces:
        return stats.drawn + stats.unsampled + stats.degenerate > 0
    # Alpha-tested faces may fail the test everywhere.
    return stats.drawn > 0 and (not plan.facts.tests_alpha or stats.pixels_covered > 0)


def warnings_of(plan: RenderPlan, stats: FrameStats | None = None) -> dict[str, str]:
    """
    Return the warnings of a picture, by kind.

    Parameters
    ----------
    plan : RenderPlan
    stats : FrameStats, optional
        Of the whole frame. Default: it is not drawn yet, and only objects out of view tell that
        nothing is in view.
    """
    found = clip_warnings_of(plan.plane_needs)
    is_empty = not plan.facts.in_view.any() if stats is None else not shows_anything(plan, stats)
    if is_empty and not found:
        found["view"] = NOTHING_IN_VIEW
    return found


def warnings_of_frame(frame: Frame) -> dict[str, str]:
    """Return the warnings of a drawn frame, by kind."""
    found = warnings_of(frame.plan, frame.stats)
    return found | burnt_out(frame.plan.facts, frame._white_share)


def light_shown(facts: Facts) -> float:
    """Return what a white surface shows at most in the light of a scene's own; 0 without any."""
    has_own = facts.has_lights or facts.environment is not None
    if not (has_own and facts.is_lit and "color" in facts.outputs):
        return 0.0
    return max_reflected_light(facts.lights.lights, facts.environment)


def lit_faces(facts: Facts, cache: SceneCache) -> NDArray[np.int32] | None:
    """
    Return of each face whether it shows how strong the light is, (F+1,); the last is of none.

    Unlit surfaces do not, nor do those that show what lies behind. ``None`` if no light is so
    strong that anything may be burnt out: most scenes have none, and pay nothing.
    """
    if light_shown(facts) <= STRONG:
        return None
    of_objects = cache.tables.inventory.shows_light.astype(np.int32)
    lit = of_objects[cache.shapes.object_numbers]
    lit[-1] = 0
    return lit


def step_of(shape: tuple[int, ...]) -> int:
    """Return the sampling step of a picture's rows and columns, (H, W, ...)."""
    return max(1, min(shape[:2]) // LOOKED_AT)


def lit_pixels(
    facts: Facts, cache: SceneCache, face_id: NDArray[np.int32]
) -> NDArray[np.bool_] | None:
    """
    Tell which of the sampled pixels show a face of `lit_faces`, or return its ``None``.

    Parameters
    ----------
    facts : Facts
    cache : SceneCache
    face_id : (H, W) int32
        -1 where nothing is.
    """
    lit = lit_faces(facts, cache)
    if lit is None:
        return None
    step = step_of(face_id.shape)
    return lit[face_id[::step, ::step]] > 0


def white_share(lit: NDArray[np.bool_] | None, color: NDArray[np.uint8]) -> float:
    """Return the share of the lit pixels that are white in a picture, (H, W, 4); 0 without any."""
    if lit is None or not lit.any():
        return 0.0
    step = step_of(color.shape)
    return float((color[::step, ::step, :3].min(axis=-1)[lit] >= MIN_WHITE_CODE).mean())


def burnt_out(facts: Facts, share: float) -> dict[str, str]:
    """Return the overexposure warning, if any, for a white share of the lit surfaces, by kind."""
    if share <= 0.5:
        return {}
    most = light_shown(facts)
    stops = "below 0" if math.isinf(most) else f"of about {-math.log2(most):.1f} stops"
    text = (
        f"{share:.0%} of what is seen in the light is white: the light is too strong to be shown; "
        f"give the scene a ToneMap with an exposure {stops}, or let styles.studio choose it"
    )
    return {"white": text}


def clip_warnings_of(look: PlaneNeeds) -> dict[str, str]:
    """Return the warnings of planes that clip something, by kind."""
    return {cut.name: f"camera.{cut.name} = {cut.plane:.6g} {cut}" for cut in look.cut}


def warn(notices: dict[str, str], told: set[str]) -> None:
    """Issue the warnings of new kinds, and add these to ``told``."""
    for kind in notices.keys() - told:
        warn_caller(notices[kind], ViewWarning, REPEATED)
    told.update(notices)
