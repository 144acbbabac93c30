"""
What batches of views prepare and keep from one call to the next.

One rule: what was prepared for a scene is kept until the scene is gone, or other scenes' takes its
room (`MOST_KEPT`). It is used again as far as a plan that is made anew says that it holds
(`serves`); else it is thrown away.
"""

from __future__ import annotations

import operator
import weakref
from typing import Any

from rasterjit import forks
from rasterjit.scene.scene import Scene
from rasterjit.survey.cache import SceneCache
from rasterjit.survey.plan import RenderPlan

MOST_BYTES = 1 << 29
"""Memory of all threads beyond which views are drawn one by one: it is no longer small beside
pictures."""

MOST_KEPT = 1 << 26
"""Memory to draw in that is kept between calls, of all scenes, at most, bytes."""

MOST_KINDS = 8
"""Most kinds of plans that are kept."""


class BatchCache:
    """
    What batches of one scene have prepared.

    Parameters
    ----------
    cache : SceneCache
        Of the scene, when it was drawn last.
    """

    def __init__(self, cache: SceneCache) -> None:
        self.cache = cache
        self.first: RenderPlan | None = None
        """The plan of the first view, of the batch at hand or the last."""
        self.kinds: dict[bytes, tuple[tuple | None, bool]] = {}
        """What is in view, and whether light falls on it, by which objects are in view."""
        self._plans: dict[tuple, RenderPlan] = {}
        self._desks: dict[tuple, list[tuple[int, Any]]] = {}
        """The size and the memory of those that nobody draws in, by what their plans follow from;
        those used last are last."""
        self._lock = forks.lock()
        self.bytes = 0
        """Of all desks, those in use included."""

    def holds(self, cache: SceneCache) -> bool:
        """Tell whether meshes and materials are still the same."""
        return cache.shapes is self.cache.shapes and cache.tables is self.cache.tables

    def plan_of(self, kind: tuple) -> RenderPlan | None:
        """Return the plan that the desks of a kind were made for, if there are any."""
        return self._plans.get(kind)

    def use(self, kind: tuple, plan: RenderPlan) -> RenderPlan:
        """Return the plan to make desks for: an earlier one, if what was made for it serves."""
        with self._lock:
            made = self._plans.pop(kind, None)
            if made is None or not serves(made, plan):
                self._drop(kind)
                made = plan
            self._plans[kind] = made
            for other in [*self._plans][:-MOST_KINDS]:
                self._drop(other)
                del self._plans[other]
            return made

    def take(self, kind: tuple) -> tuple[int, Any] | None:
        """Return a desk that nobody draws in, with its size; ``None`` if there is none."""
        with self._lock:
            free = self._desks.get(kind)
            return free.pop() if free else None

    def reserve(self, size: int) -> bool:
        """Tell whether there is room for another desk of so many bytes, which then is its own."""
        with self._lock:
            if self.bytes + size > MOST_BYTES:
                for kind in [*self._desks]:
                    self._drop(kind)
            has_room = self.bytes + size <= MOST_BYTES
            self.bytes += size * has_room
            return has_room

    def give_back(self, kind: tuple, size: int, desk: Any) -> None:
        """Take a desk back."""
        with self._lock:
            if kind in self._plans:
                self._desks.setdefault(kind, []).append((size, desk))
            else:
                self.bytes -= size

    def _drop(self, kind: tuple) -> None:
        """Let the desks of a kind go."""
        self.bytes -= sum(size for size, _ in self._desks.pop(kind, ()))


def serves(made: RenderPlan, asked: RenderPlan) -> bool:
    """Tell whether what was made for a plan is what another one of the same kind asks for."""
    one, other = made.facts, asked.facts
    return (
        made.size == asked.size
        # Meshes and materials are the same as long as their inventory is.
        and one.inventory is other.inventory
        and one.quality == other.quality
        and (one.outputs, one.is_uneven, one.attributes, one.lights, one.has_background)
        == (other.outputs, other.is_uneven, other.attributes, other.lights, other.has_background)
        and one.has_lights == other.has_lights
        and one.diagnose == other.diagnose
        and one.imitation is other.imitation
        and one.background_image is other.background_image
        and all(map(operator.is_, one.asked.values(), other.asked.values()))
        and made.background.tobytes() == asked.background.tobytes()
        and _lights(made) == _lights(asked)
        and _effects(made) == _effects(asked)
    )


def _effects(plan: RenderPlan) -> list[tuple[Any, int]]:
    """Return the effects, with what is known of them beyond what is a view's own."""
    return [(one.effect, id(one.data) * one.effect.follows_facts) for one in plan.planned]


def _lights(plan: RenderPlan) -> tuple[int, bytes] | None:
    """Return what of its lights the eye does not change."""
    if plan.lighting is None:
        return None
    return len(plan.lighting.lights), plan.lighting.ambient.tobytes()


class Shelf:
    """What was prepared for the scenes of the last batches."""

    def __init__(self) -> None:
        self._kept: dict[int, tuple[weakref.ref, BatchCache]] = {}
        self._lock = forks.reentrant_lock()

    def take(self, what: Any) -> BatchCache | None:
        """Return what is kept of a scene, which nobody else has then."""
        with self._lock:
            of, kept = self._kept.pop(id(what), (None, None))
            return kept if of is not None and of() is what else None

    def put(self, what: Any, kept: BatchCache) -> None:
        """Keep what was prepared for a scene; a mesh would be kept alive by it."""
        if not isinstance(what, Scene) or kept.bytes > MOST_KEPT:
            return
        number = id(what)

        def forget(gone: weakref.ref) -> None:
            with self._lock:
                if self._kept.get(number, (None,))[0] is gone:
                    del self._kept[number]

        with self._lock:
            self._kept[number] = weakref.ref(what, forget), kept
            while sum(one.bytes for _, one in self._kept.values()) > MOST_KEPT:
                del self._kept[next(iter(self._kept))]


SHELF = Shelf()
"""That of this process."""
