"""
Define the interface of effects: is it needed, what data it prepares, which passes it adds.

An effect is a folder of ``effects/``; its ``__init__.py`` defines one object for each of its rows
in ``explain``. ``rendering/effect_registry.py`` lists all of them, in the order of these rows. Each
is asked once for a frame (`Effect.answer`), unless an earlier answer still holds. Those needed
prepare a record for every picture (`Effect.prepare`), and the functions in `Effect.places` turn
that record into passes. Overlays prepare nothing: their record is the plan's data.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, TypeAlias

from numpy.typing import NDArray

from rasterjit.pipeline.passes import Rows
from rasterjit.pipeline.records import Placement
from rasterjit.pipeline.visibility.visibility_pass import Seen
from rasterjit.runtime.threads import Workers
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.cache import SceneCache

if TYPE_CHECKING:
    from rasterjit.survey.batched_views import ViewGroup
    from rasterjit.survey.facts import Facts
    from rasterjit.survey.object_transforms import Boxes
    from rasterjit.survey.plan import RenderPlan

PLACES = (
    "rows", "light", "around", "seen", "sample", "pixel", "mixed", "background", "overlay",
)  # fmt: skip
"""
Where effects act, in order; what each function in `Effect.places` takes and returns:

- rows: ``(record, needs) -> passes`` before any light: writes rows from OCCLUSION on.
- light: ``(record, needs, n, of_vertices) -> passes`` before light ``n`` is added: row SHADOW.
- around: ``(record, needs) -> passes`` after the lights: ambient light.
- seen: ``(record, shown) -> passes`` on the three rows of final colours of samples, lit or not;
  does not by itself need lights or positions.
- sample: ``(record, needs) -> passes`` on the colours of lit samples, which have positions.
- pixel: ``(record, shown) -> (passes, shown)`` on the three rows that are encoded in 8 bits; one
  effect at most.
- mixed: ``(record, calls, linear, background, shown)``: the same on resolved rows of several faces,
  linear with straight alpha; composites them over the background, (4,) or (R, W, 4), and writes
  the final colours. It goes with "pixel".
- background: ``(record, calls, face_id, first_row, linear, color)``: writes pixels without a face.
- overlay: ``(record, context, color)``: draws over the finished 8-bit picture.

``calls`` are `Calls`: functions of `BatchedEffect` call kernels only by them or by
``context.workers.run``, so that batches can record the calls.

``passes`` is a list of `rasterjit.pipeline.passes.Pass`, ``needs`` are `ShadingNeeds`. Passes are
listed before a picture is prepared, too: ``record`` is then what the plan knows of the effect, and
only a pass's own function reads what `Effect.prepare` adds to that.
"""


Field: TypeAlias = Callable[[str, tuple[int, ...], Any], NDArray[Any]]
"""``field(name, shape, dtype)`` returns an array for per-view data; see `share`."""


class Planning(NamedTuple):
    """A frame being planned: inputs beside `Facts`."""

    scene: Scene
    camera: Camera
    boxes: Boxes
    """The boxes around the objects, seen from the eye."""


class FrameContext(NamedTuple):
    """A picture that is prepared or drawn over."""

    plan: RenderPlan
    cache: SceneCache
    placement: Placement
    workers: Workers
    picture: Seen | None = None
    """Its visible faces; ``None`` where it is drawn in regions."""
    field: Field | None = None
    """For recorded calls: returns an array in which each view finds what `BatchedEffect.differ`
    gives of it under that name."""

    @property
    def seen(self) -> Seen:
        """Its visible faces; raises ``RuntimeError`` where they are not known."""
        if self.picture is None:
            raise RuntimeError("the visible faces of this picture are not known as a whole")
        return self.picture

    def own(self, name: str, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of this picture, or, for recorded calls, an array for each view's."""
        return values if self.field is None else self.field(name, values.shape, values.dtype)


def context_of(plan: RenderPlan, cache: SceneCache, seen: Seen, workers: Workers) -> FrameContext:
    """Return the context of a picture whose visible faces are known."""
    return FrameContext(plan, cache, seen.placement, workers, seen)


@dataclass(repr=False)
class Absent:
    """An effect that a frame does not need."""

    used: ClassVar[bool] = False
    effect: Effect
    facts: Facts

    @property
    def name(self) -> str:
        """Name of its row in ``explain``."""
        return self.effect.name

    @property
    def reason(self) -> str:
        """Why the frame needs it or not."""
        return self.effect.reason(self.facts, self.used)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name}: {self.reason})"


@dataclass(repr=False)
class Planned(Absent):
    """An effect that a frame needs."""

    used: ClassVar[bool] = True
    data: Any = None
    """The plan's data for it: a description, or the record that stages read."""


class Calls(Protocol):
    """Calls kernels at once, or records the calls for a batch."""

    def call(self, kernel: Any, *arguments: Any) -> None:
        """Call a kernel."""


class Effect:
    """
    Base class of effects, each a row of ``explain``; by default it does nothing.

    An effect has no state: its data of a frame is in the plan and in the record.

    Attributes
    ----------
    name : str
        Of its row.
    field : str
        The field of `Scene` that asks for it; empty: none does.
    key : str
        What switches it in the viewer; empty: nothing does.
    is_explained : bool
        Whether ``explain_pixel`` tells its part in a colour; else the colour is that of a frame.
    term : str
        What ``explain_pixel`` calls what it adds to a colour; empty: its name.
    settings : tuple of str
        The settings of `Quality` that matter only to frames that need it, or another one that names
        them too.
    follows_facts : bool
        Whether facts alone decide what it answers: it is not asked again while they hold.
    places : dict of function
        What it does, by place; see ``PLACES``.
    """

    name = ""
    field = ""
    key = ""
    is_explained = False
    term = ""
    settings: tuple[str, ...] = ()
    follows_facts = False
    places: ClassVar[Mapping[str, Callable[..., Any]]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        """Raise ``ValueError`` for an unknown place."""
        super().__init_subclass__(**options)
        for place in cls.places:
            if place not in PLACES:
                raise ValueError(
                    f"{cls.__name__}.places has {place!r}; possible are {', '.join(PLACES)}"
                )

    def answer(self, facts: Facts, planning: Planning) -> Planned | Absent:
        """Decide whether a frame needs it, and with what data."""
        if (self.field and facts.fields[self.field] is None) or self.why_not(facts):
            return Absent(self, facts)
        return Planned(self, facts, self.decide(facts, planning))

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Say why a frame needs it or not."""
        if self.field and facts.fields[self.field] is None:
            return f"scene.{self.field} is None"
        return self.why_not(facts) or self.describe(facts)

    def why_not(self, facts: Facts) -> str:
        """Say why a frame that asks for it does not need it; empty: it does."""
        raise NotImplementedError

    def describe(self, facts: Facts) -> str:
        """Describe how a frame uses it."""
        raise NotImplementedError

    def decide(self, facts: Facts, planning: Planning) -> Any:
        """Return the plan's data for it."""
        return facts.fields[self.field] if self.field else None

    def prepare(self, context: FrameContext, data: Any, seen: Sequence[tuple[Camera, Any]]) -> Any:
        """
        Return the record that its stages read; None: there is nothing to do.

        Parameters
        ----------
        context : FrameContext
        data
            What the plan knows of it.
        seen : sequence of (Camera, object)
            What it sees of the picture, and of others that it is prepared with (`see`).
        """
        return data

    def kernels(self, plan: RenderPlan) -> Mapping[str, Rows]:
        """
        Return the kernels that it calls besides its passes, for `list_kernels`.

        By where they are called: "prepare", or a place where it acts.
        """
        return {}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return its large arrays: name, channels, dtype, and (width, height)."""
        return []

    def neutral(self, record: Any) -> Any:
        """Return a record with which it changes nothing."""
        raise NotImplementedError

    def without(self, scene: Scene) -> Scene | None:
        """Return a scene without it; None: it cannot be switched off in the scene."""
        return None if not self.field else with_field(scene, self.field, None)

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Suggest it, or more of it: return a description and a scene that has it, or None."""
        return "", None


class HasModes(Effect):
    """
    An effect that is on in several ways: its key goes through them.

    Attributes
    ----------
    modes : dict of str
        A word for each, before it is off.
    """

    modes: ClassVar[Mapping[str, str]]

    def mode_of(self, scene: Scene) -> str | None:
        """Return the mode in which a scene asks for it; None: it does not."""
        raise NotImplementedError

    def with_mode(self, scene: Scene, mode: str | None) -> Scene:
        """Return a scene that asks for it in a mode, else as before; None: that does not."""
        raise NotImplementedError


class BatchedEffect(Effect):
    """
    An effect that batches and bound frames run as recorded calls, without Python in between.

    Its record depends on the plan (`share`), and per view on arrays derived from the camera and
    the transforms (`differ`) only. Of one that looks around, `prepare` is recorded: it calls
    kernels alone, and takes what differs by `FrameContext.own`.
    """

    def answers(self, scene: Scene, group: ViewGroup) -> Any:
        """
        Return which of many views with shaded faces need it, (N,) bool, or one answer for all.

        Only effects that depend on more than facts and contents of a view have it.
        """
        return True

    def share(self, plan: RenderPlan, data: Any, field: Field) -> Any:
        """
        Return the record for many views of one plan, as `prepare` does for each of them.

        Parameters
        ----------
        plan : RenderPlan
            Of one of the views.
        data
            What that plan knows of it.
        field : callable
            Returns an array in which each view finds what `differ` gives of it under that name.
        """
        return data

    def differ(self, scene: Scene, group: ViewGroup) -> Mapping[str, NDArray[Any]]:
        """Return the arrays that `share` asks for, (N, ...), of the dtypes asked for."""
        return {}


class LooksAround(Effect):
    """
    An effect that reads neighbouring pixels, or the whole picture.

    Attributes
    ----------
    looks : str
        How far: at a "sample", at its "neighbours", which parts of a picture do not have (but see
        `reach`), or at the "whole" picture, which is then looked through before (`see`).
    joins_faces : bool
        Whether it draws what all faces make together: no part of a scene has it alone.
    reads_clip_positions : bool
        Whether it reads where vertices lie before they are divided by w.
    """

    looks = "neighbours"
    joins_faces = False
    reads_clip_positions = False

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Tell whether it reads the depth of visible faces."""
        return False

    def looks_first(self, data: Any) -> bool:
        """
        Tell whether it analyses the whole picture before it acts, by `see`.

        ``data`` is the plan's data for it.
        """
        return self.looks == "whole"

    def refusal(self) -> str:
        """Return the message for pictures in which it cannot be drawn."""
        return f"scene.{self.field} must be None"

    def reach(self, data: Any) -> int | None:
        """Return the radius of its neighbourhood, pixels; None: unbounded."""
        return None

    def see(self, context: FrameContext) -> Any:
        """Analyse a picture, or a part of one, before it is prepared; return the result."""
        return None

    def join(self, size: tuple[int, int], parts: Sequence[tuple[tuple[int, int], Any]]) -> Any:
        """Merge the results of `see` over the parts of a picture, given their corners."""
        return None

    def of_part(self, record: Any, corner: tuple[int, int]) -> Any:
        """Return the record of a whole picture, restricted to a part with the given first pixel."""
        return record


class SeesThrough(LooksAround):
    """
    An effect that reads another picture of the same view, without some objects (an opaque pass).

    That is drawn first, and passed to `Effect.prepare` as the result of `see`, (H, W, 4) float32,
    linear.
    """

    def hidden(self, facts: Facts) -> NDArray[Any]:
        """Return which objects, (O,) bool, the first picture leaves out."""
        raise NotImplementedError


class QualityEffect(Effect):
    """An effect that the quality asks for, not the scene."""

    def quality_without(self, quality: Quality) -> Quality:
        """Return a quality that does not ask for it."""
        raise NotImplementedError

    def quality_with(self, quality: Quality) -> tuple[str, Quality | None]:
        """Suggest it for a quality without it: return a description and such a quality, or None."""
        raise NotImplementedError


class BackdropEffect(Effect):
    """An effect that draws behind all faces, without tone mapping."""


class Bends(Effect):
    """An effect whose planned data a lens distorts."""

    def bent(self, data: Any, eye: Any, pixels: Callable[[Any], Any]) -> Any:
        """
        Return its planned data, distorted by a lens.

        Parameters
        ----------
        data
            What the plan knows of it.
        eye : (3,) float64
            World space.
        pixels : callable
            Returns where points relative to the eye, (N, 3), are seen: (N, 2), NaN if not.
        """
        return data


def neighbourhood_effects(planned: Iterable[Planned]) -> list[tuple[LooksAround, Any]]:
    """Return the effects that are `LooksAround`, each with the plan's data for it."""
    return [(one.effect, one.data) for one in planned if isinstance(one.effect, LooksAround)]


class Active(NamedTuple):
    """An effect in a picture, prepared."""

    effect: Effect
    record: Any

    def at(self, place: str, *arguments: Any) -> Any:
        """Call its function for one of `PLACES`."""
        return self.effect.places[place](self.record, *arguments)


def acting(effects: Sequence[Active], place: str) -> list[Active]:
    """Return the effects that act at one of `PLACES`."""
    return [active for active in effects if place in active.effect.places]


def shown_as_given(effect: Effect) -> bool:
    """Tell whether an effect draws behind all faces, without tone mapping."""
    return isinstance(effect, BackdropEffect)


def with_field(scene: Scene, name: str, value: Any) -> Scene:
    """Return a copy of a scene with another value of a field."""
    changed = copy.copy(scene)
    setattr(changed, name, value)
    return changed


def add_to_field(scene: Scene, name: str, value: Any) -> Scene | None:
    """Return a copy of a scene with a value added to a field; None if one there has an effect."""
    value_there = getattr(scene, name)
    if value_there is not None and not _is_neutral(value_there):
        return None
    return with_field(scene, name, value)


def _is_neutral(value: Any) -> bool:
    """Tell whether an effect's settings change nothing."""
    return getattr(value, "strength", 1.0) == 0.0 or getattr(value, "is_neutral", False)
