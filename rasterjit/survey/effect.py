"""
What an effect is: it says whether a frame needs it, prepares what it reads, and gives its stages.

An effect is a folder of ``effects/``; its ``__init__.py`` defines one object for each of its rows
in ``explain``. ``rendering/effects.py`` lists all of them, in the order of these rows. A frame
asks each once (`Effect.answer`), but for those that answered an earlier one by facts that still
hold. Those that it needs prepare a record for every picture (`Effect.prepare`), and the functions
in `Effect.places` turn that record into stages. Overlays prepare nothing: their record is what the
plan knows of them.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

from numpy.typing import NDArray

from rasterjit.pipeline.passes import Rows
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.visibility.draw import Coverage
from rasterjit.runtime.threads import Workers
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.cache import SceneCache

if TYPE_CHECKING:
    from rasterjit.survey.facts import Facts
    from rasterjit.survey.many_views import Group
    from rasterjit.survey.placement import Boxes
    from rasterjit.survey.plan import RenderPlan

PLACES = (
    "rows", "light", "around", "seen", "sample", "pixel", "mixed", "background", "overlay",
)  # fmt: skip
"""
Where effects act, in order; what each function in `Effect.places` takes and returns:

- rows: ``(record, needs) -> passes`` before any light: shares of light, from OCCLUSION on.
- light: ``(record, needs, n, of_vertices) -> passes`` before light ``n`` is added: row SHADOW.
- around: ``(record, needs) -> passes`` after the lights: light that comes from all sides.
- seen: ``(record, shown) -> passes`` on the three rows of colours that samples show, lit or not:
  where it is alone no light and no point is found.
- sample: ``(record, needs) -> passes`` on the colours of lit samples, which have points.
- pixel: ``(record, shown) -> (passes, shown)`` on the three rows that are shown in 8 bits; one
  effect at most.
- mixed: ``(record, calls, linear, background, shown)``: the same on rows that are mixed of several
  faces, linear with straight alpha; lays them over the background, (4,) or (R, W, 4), and writes
  what is shown. It goes with "pixel".
- background: ``(record, calls, face_id, first_row, linear, color)``: writes where no face is.
- overlay: ``(record, context, color)``: draws over the finished 8-bit picture.

``calls`` are `Calls`: functions of `InGroups` call kernels by them, or by ``context.workers.run``,
and by nothing else. Then batches bind what frames call.

``passes`` is a list of `rasterjit.pipeline.passes.Pass`, ``needs`` are `ShadingNeeds`. Passes are
listed before a picture is prepared, too: ``record`` is then what the plan knows of the effect, and
only a pass's own function reads what `Effect.prepare` adds to that.
"""


Field: TypeAlias = Callable[[str, tuple[int, ...], Any], NDArray[Any]]
"""``field(name, shape, dtype)`` returns an array that holds what is a view's own; see `share`."""


class Planning(NamedTuple):
    """A frame that is being planned: what plain facts leave out."""

    scene: Scene
    camera: Camera
    boxes: Boxes
    """The boxes around the objects, seen from the eye."""


class FrameContext(NamedTuple):
    """A picture whose visible faces are known."""

    plan: RenderPlan
    cache: SceneCache
    geometry: Geometry | None
    placement: Placement
    coverage: Coverage | None
    workers: Workers


class Planned(NamedTuple):
    """An effect that a frame needs."""

    effect: Effect
    facts: Facts
    data: Any = None
    """What the plan knows of it: a description, or the record that stages read."""

    used = True

    @property
    def name(self) -> str:
        """Name of its row."""
        return self.effect.name

    @property
    def reason(self) -> str:
        """Why the frame needs it."""
        return self.effect.reason(self.facts, True)

    def __repr__(self) -> str:
        return f"Planned({self.name}: {self.reason})"


class Absent(NamedTuple):
    """An effect that a frame does not need."""

    effect: Effect
    facts: Facts

    used = False

    @property
    def name(self) -> str:
        """Name of its row."""
        return self.effect.name

    @property
    def reason(self) -> str:
        """Why the frame does not need it."""
        return self.effect.reason(self.facts, False)

    def __repr__(self) -> str:
        return f"Absent({self.name}: {self.reason})"


class Calls(Protocol):
    """Calls kernels at once, or binds them for machine code that calls them later."""

    def call(self, kernel: Any, *arguments: Any) -> None:
        """Call a kernel."""


class Effect:
    """
    One row of ``explain``; a subclass says what is different from a row that does nothing.

    An effect has no state: what it knows of a frame is in the plan and in the record.

    Attributes
    ----------
    name : str
        Of its row.
    field : str
        The field of `Scene` that asks for it; empty: none does.
    key : str
        What switches it in the viewer; empty: nothing does.
    modes : dict of str
        What the key goes through before it is off, with a word for each; empty: on and off.
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
    modes: Mapping[str, str] = {}
    is_explained = False
    term = ""
    settings: tuple[str, ...] = ()
    follows_facts = False
    places: Mapping[str, Callable[..., Any]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        """Raise ``ValueError`` for a place that there is not: nothing would ever act there."""
        super().__init_subclass__(**options)
        for place in cls.places:
            if place not in PLACES:
                raise ValueError(
                    f"{cls.__name__}.places has {place!r}; possible are {', '.join(PLACES)}"
                )

    def answer(self, facts: Facts, planning: Planning) -> Planned | Absent:
        """Say whether a frame needs it, and with what data."""
        if self._against(facts):
            return Absent(self, facts)
        return Planned(self, facts, self.decide(facts, planning))

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Say why a frame needs it or not."""
        return self._against(facts) or self.describe(facts)

    def _against(self, facts: Facts) -> str:
        if self.field and facts.asked[self.field] is None:
            return f"scene.{self.field} is None"
        return self.why_not(facts)

    def why_not(self, facts: Facts) -> str:
        """Say why a frame that asks for it does not need it; empty: it does."""
        raise NotImplementedError

    def describe(self, facts: Facts) -> str:
        """Say how a frame has it."""
        raise NotImplementedError

    def decide(self, facts: Facts, planning: Planning) -> Any:
        """Return what the plan knows of it."""
        return facts.asked[self.field] if self.field else None

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
        Return the kernels that it calls besides stages, as `list_kernels` tells them.

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
        """Return a scene without it; None: a scene cannot do without it alone."""
        return None if not self.field else with_field(scene, self.field, None)

    def mode_of(self, scene: Scene) -> str | None:
        """Return the mode in which a scene asks for it; None: it does not."""
        return None

    def with_mode(self, scene: Scene, mode: str | None) -> Scene:
        """Return a scene that asks for it in a mode, else as before; None: that does not."""
        raise NotImplementedError

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Say what it could be in a scene that has none, with such a scene; None: nothing."""
        return "", None

    def extend(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Say what more a scene that has it could have of it, with such a scene; None: nothing."""
        return self.add(scene, quality)

    def quality_without(self, quality: Quality) -> Quality | None:
        """Return a quality that does not ask for it; None: qualities do not."""
        return None

    def quality_with(self, quality: Quality) -> tuple[str, Quality | None]:
        """Say what a quality that does not ask for it could, with such a quality; None: nothing."""
        return "", None


class InGroups(Effect):
    """
    An effect that batches and bound frames draw, without Python in between.

    What it reads follows from the plan (`share`), but for arrays that follow from the camera and
    where objects are (`differ`). Others must be prepared for each picture.
    """

    def answers(self, scene: Scene, group: Group) -> Any:
        """
        Tell which of many views in which faces are shaded need it, (N,) bool, or of all the same.

        Asked only of those that do not follow from facts.
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

    def differ(self, scene: Scene, group: Group) -> Mapping[str, NDArray[Any]]:
        """Return the arrays that `share` asks for, (N, ...), of the dtypes asked for."""
        return {}


class LooksAround(Effect):
    """
    An effect that reads more of a picture than the sample that it acts on.

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
        Tell whether it looks at the whole picture before it acts, as `see` says.

        ``data`` is what the plan knows of it.
        """
        return self.looks == "whole"

    def refusal(self) -> str:
        """Say what must be otherwise where it cannot be drawn."""
        return f"scene.{self.field} must be None"

    def reach(self, data: Any) -> int | None:
        """Return how many pixels away the neighbours are that it looks at; None: any number."""
        return None

    def see(self, context: FrameContext) -> Any:
        """Return what it must know of a picture, or of a part of one, before it is prepared."""
        return None

    def join(self, size: tuple[int, int], parts: Sequence[tuple[tuple[int, int], Any]]) -> Any:
        """Return what it would see of a picture, given what it sees of its parts and where."""
        return None

    def of_part(self, record: Any, corner: tuple[int, int]) -> Any:
        """Return the record of a whole picture for a part of it, whose first pixel is given."""
        return record


class SeesThrough(LooksAround):
    """
    An effect that shows another picture of the same view, without some objects.

    That is drawn before, and handed to `Effect.prepare` as what it sees, (H, W, 4) float32, linear.
    """

    def hidden(self, facts: Facts) -> NDArray[Any]:
        """Return which objects, (O,) bool, the picture leaves out that is drawn before."""
        raise NotImplementedError


class Backdrop(Effect):
    """An effect that shows something behind all faces that no tone curve touches."""


class Bends(Effect):
    """An effect of which a lens moves what the plan knows."""

    def bent(self, data: Any, eye: Any, pixels: Callable[[Any], Any]) -> Any:
        """
        Return what the plan knows of it where a lens bends the picture.

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


def look_around(planned: Iterable[Planned]) -> list[Planned]:
    """Return those of some effects that look around: see `LooksAround`."""
    return [one for one in planned if isinstance(one.effect, LooksAround)]


class Active(NamedTuple):
    """An effect in a picture, prepared."""

    effect: Effect
    record: Any

    def at(self, place: str, *arguments: Any) -> Any:
        """Return what it does at a place where it acts."""
        return self.effect.places[place](self.record, *arguments)


def acting(effects: Sequence[Active], place: str) -> list[Active]:
    """Return those effects that act at a place."""
    return [active for active in effects if place in active.effect.places]


def shown_as_given(effect: Effect) -> bool:
    """Tell whether an effect shows something behind all faces that no tone curve touches."""
    return isinstance(effect, Backdrop)


def with_field(scene: Scene, name: str, value: Any) -> Scene:
    """Return a copy of a scene with another value of a field."""
    changed = copy.copy(scene)
    setattr(changed, name, value)
    return changed


def add_to_field(scene: Scene, name: str, value: Any) -> Scene | None:
    """Return a copy of a scene with a value in a field; None if one there does something."""
    held = getattr(scene, name)
    if held is not None and not _does_nothing(held):
        return None
    return with_field(scene, name, value)


def _does_nothing(value: Any) -> bool:
    """Tell whether an effect that a scene asks for leaves it as it is."""
    return getattr(value, "strength", 1.0) == 0.0 or getattr(value, "is_neutral", False)
