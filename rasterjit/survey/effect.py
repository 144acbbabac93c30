"""
Define the interface of effects: whether a frame needs one, its data, and the passes it adds.

An effect is a folder of ``effects/``; its ``__init__.py`` defines one object for each of its rows
in ``explain``. ``rendering/effect_registry.py`` lists all of them, in the order of these rows. A
frame decides on each once (`Effect.decide`), unless the decision of an earlier frame still holds.
Those needed prepare a record for every picture (`Effect.prepare`), and the functions in
`Effect.places` turn that record into passes. Overlays prepare nothing: their record is the plan's
data.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, TypeAlias

from numpy.typing import NDArray

from rasterjit.pipeline.passes import Rows
from rasterjit.pipeline.records import Placement
from rasterjit.pipeline.visibility.visibility_pass import RasterizedView
from rasterjit.runtime.threads import Workers
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
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
- sample: ``(record, needs) -> passes`` on the colours of all shaded samples, which then have
  positions.
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


ViewArrays: TypeAlias = Callable[[str, tuple[int, ...], Any], NDArray[Any]]
"""``view_arrays(name, shape, dtype)`` returns an array that recorded calls find filled, in each
view, with what `BatchedEffect.compute_view_arrays` returns under that name."""


class Planning(NamedTuple):
    """Inputs of planning a frame, beside `Facts`."""

    scene: Scene
    camera: Camera
    boxes: Boxes
    """The boxes around the objects, seen from the eye."""


class FrameContext(NamedTuple):
    """The picture that effects are prepared for, or draw over."""

    plan: RenderPlan
    cache: SceneCache
    placement: Placement
    workers: Workers
    picture: RasterizedView | None = None
    """Its visible faces; ``None`` where it is drawn in regions."""
    view_arrays: ViewArrays | None = None
    """Returns per-view arrays for recorded calls; ``None``: calls are not recorded."""

    @property
    def seen(self) -> RasterizedView:
        """Its visible faces; raises ``RuntimeError`` where they are not known."""
        if self.picture is None:
            raise RuntimeError("the visible faces of this picture are not known as a whole")
        return self.picture

    def per_view(self, name: str, values: NDArray[Any]) -> NDArray[Any]:
        """Return values of this picture, or, for recorded calls, an array for those of views."""
        if self.view_arrays is None:
            return values
        return self.view_arrays(name, values.shape, values.dtype)


def context_of(
    plan: RenderPlan, cache: SceneCache, seen: RasterizedView, workers: Workers
) -> FrameContext:
    """Return the context of a picture whose visible faces are known."""
    return FrameContext(plan, cache, seen.placement, workers, seen)


@dataclass(repr=False)
class UnusedEffect:
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
class UsedEffect(UnusedEffect):
    """An effect that a frame needs."""

    used: ClassVar[bool] = True
    data: Any = None
    """The plan's data for it: a description, or the record that stages read."""


class Calls(Protocol):
    """Object that calls kernels at once, or records the calls for a batch."""

    def call(self, kernel: Any, *arguments: Any) -> None:
        """Call a kernel."""


class Effect:
    """
    Base class of effects, each a row of ``explain``; by default it does nothing.

    An effect has no state: its data of a frame is in the plan and in the record.

    Attributes
    ----------
    name : str
        Name of its row in ``explain``.
    field : str
        The field of `Scene` that requests it; empty: none does.
    key : str
        Key that switches it in the viewer; empty: none does.
    is_explained : bool
        Whether ``explain_pixel`` shows its part of a colour.
    term : str
        Name of that part in ``explain_pixel``; empty: that of the effect.
    settings : tuple of str
        The settings of `Quality` that matter only to frames that need it, or another one that names
        them too.
    needs_facts_only : bool
        Whether its decision depends on facts alone, and is reused while they hold.
    fills_record : bool
        Whether Python fills its record in recorded calls: see `BatchedEffect`.
    places : dict of function
        Its functions, by place; see ``PLACES``.
    """

    name = ""
    field = ""
    key = ""
    is_explained = False
    term = ""
    settings: tuple[str, ...] = ()
    needs_facts_only = False
    fills_record = False
    places: ClassVar[Mapping[str, Callable[..., Any]]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        """Raise ``ValueError`` for an unknown place, or a field that no scene has."""
        super().__init_subclass__(**options)
        if cls.field and cls.field not in EFFECT_FIELDS:
            raise ValueError(
                f"{cls.__name__}.field is {cls.field!r}; possible are {', '.join(EFFECT_FIELDS)}"
            )
        for place in cls.places:
            if place not in PLACES:
                raise ValueError(
                    f"{cls.__name__}.places has {place!r}; possible are {', '.join(PLACES)}"
                )

    def decide(self, facts: Facts, planning: Planning) -> UsedEffect | UnusedEffect:
        """Decide whether a frame needs the effect, and with which data."""
        if (self.field and facts.fields[self.field] is None) or self.unused_reason(facts):
            return UnusedEffect(self, facts)
        return UsedEffect(self, facts, self.plan_data(facts, planning))

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Say why a frame needs the effect or not."""
        if self.field and facts.fields[self.field] is None:
            return f"scene.{self.field} is None"
        return self.unused_reason(facts) or self.describe(facts)

    def unused_reason(self, facts: Facts) -> str:
        """Say why a frame that requests the effect does not need it; empty: it does."""
        raise NotImplementedError

    def describe(self, facts: Facts) -> str:
        """Describe how a frame uses the effect."""
        raise NotImplementedError

    def plan_data(self, facts: Facts, planning: Planning) -> Any:
        """Return the plan's data for the effect."""
        return facts.fields[self.field] if self.field else None

    def prepare(self, context: FrameContext, data: Any, seen: Sequence[tuple[Camera, Any]]) -> Any:
        """
        Return the record that the effect's stages read; None: the picture is not changed.

        Parameters
        ----------
        context : FrameContext
        data
            The plan's data for the effect.
        seen : sequence of (Camera, object)
            Results of `analyse` for the picture, and for others that are prepared with it.
        """
        return data

    def kernels(self, plan: RenderPlan) -> Mapping[str, Rows]:
        """
        Return the kernels that the effect calls besides its passes, for `list_kernels`.

        By where they are called: "prepare", or one of ``PLACES``.
        """
        return {}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the large arrays of the effect: name, channels, dtype, and (width, height)."""
        return []

    def neutral(self, record: Any) -> Any:
        """Return a record with which the effect changes nothing."""
        raise NotImplementedError

    def without(self, scene: Scene) -> Scene | None:
        """Return a scene without the effect; None: a scene cannot switch it off."""
        return None if not self.field else with_field(scene, self.field, None)

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Suggest the effect, or more of it: return a description and a changed scene, or None."""
        return "", None


class ModalEffect(Effect):
    """
    An effect with several modes, through which its key in the viewer goes.

    Attributes
    ----------
    modes : dict of str
        Description of each, in the order of the key.
    """

    modes: ClassVar[Mapping[str, str]]

    def mode_of(self, scene: Scene) -> str | None:
        """Return the mode that a scene requests; None: it does not request the effect."""
        raise NotImplementedError

    def with_mode(self, scene: Scene, mode: str | None) -> Scene:
        """Return a scene that requests the effect in a mode; None: one that does not request it."""
        raise NotImplementedError


UNDECIDED = 2
"""In `BatchedEffect.decide_views`: draw this view alone, by a plan of its own."""


class BatchedEffect(Effect):
    """
    An effect that batches and recorded frames run as recorded calls.

    Its record depends only on the plan (`prepare_batch`) and on arrays derived from the camera and
    the transforms of each view (`compute_view_arrays`). Of a `ScreenEffect`, `prepare` is
    recorded: it calls kernels alone, and gets per-view values by `FrameContext.per_view`; or,
    if ``fills_record``, Python fills the record between recorded calls (`fill_record`).
    """

    def decide_views(self, scene: Scene, group: ViewGroup) -> Any:
        """
        Return which of N views with shaded faces need the effect, (N,) bool, or one bool for all.

        For effects that depend on more than the facts and object counts of a view. `UNDECIDED`
        (then the array is int8) stands for views that only a plan of their own decides.
        """
        return True

    def fill_record(self, context: FrameContext, data: Any, record: Any) -> bool:
        """
        Fill the arrays of the record of `prepare_batch` for a view, from its visible faces.

        Returns
        -------
        bool
            Whether the view has a record of this kind; if not, it must be drawn alone.
        """
        raise NotImplementedError

    def prepare_batch(self, plan: RenderPlan, data: Any, view_arrays: ViewArrays) -> Any:
        """
        Return the record for all views of one plan, as `prepare` does for each of them.

        Parameters
        ----------
        plan : RenderPlan
            Of one of the views.
        data
            That plan's data for the effect.
        view_arrays : callable
            As `ViewArrays` says.
        """
        return data

    def compute_view_arrays(self, scene: Scene, group: ViewGroup) -> Mapping[str, NDArray[Any]]:
        """Return the arrays that `prepare_batch` requests, (N, ...), by name."""
        return {}


class ScreenEffect(Effect):
    """
    An effect that reads neighbouring pixels, or the whole picture.

    Attributes
    ----------
    scope : str
        What it reads: a "sample", its "neighbours" (see `read_radius`), or the "whole"
        picture, which is analysed before (`analyse`).
    joins_faces : bool
        Whether it depends on all faces of the scene together: parts of a scene lack it.
    reads_clip_positions : bool
        Whether it reads clip-space positions of vertices.
    """

    scope = "neighbours"
    joins_faces = False
    reads_clip_positions = False

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Tell whether the effect reads the depth of visible faces."""
        return False

    def analyses_picture(self, data: Any) -> bool:
        """
        Tell whether the effect analyses the whole picture before it acts, by `analyse`.

        ``data`` is the plan's data for the effect.
        """
        return self.scope == "whole"

    def refusal(self) -> str:
        """Return the message for pictures in which the effect cannot be drawn."""
        return f"scene.{self.field} must be None"

    def read_radius(self, data: Any) -> int | None:
        """Return the radius of the neighbourhood that is read, pixels; None: unbounded."""
        return None

    def analyse(self, context: FrameContext) -> Any:
        """Analyse a picture, or a part of one, before it is prepared; return the result."""
        return None

    def merge_parts(
        self, size: tuple[int, int], parts: Sequence[tuple[tuple[int, int], Any]]
    ) -> Any:
        """Merge the results of `analyse` over the parts of a picture, given their corners."""
        return None

    def crop_record(self, record: Any, corner: tuple[int, int]) -> Any:
        """Return the record of a whole picture, restricted to a part with the given first pixel."""
        return record


class TracedEffect(ScreenEffect):
    """
    An overlay of lines that a lens bends: traced in its pinholes, drawn over the finished picture.

    Attributes
    ----------
    tracer : ScreenEffect
        Its row in the plans of pinhole pictures: reads the same, and draws nothing.
    """

    tracer: ScreenEffect

    def trace(self, data: Any, context: FrameContext) -> list[NDArray[Any]]:
        """Return visible pieces of lines, (N, 2, 3) float64 for each kind: see `draw_traced`."""
        raise NotImplementedError

    def draw_traced(
        self, data: Any, pieces: list[NDArray[Any]], context: FrameContext, color: NDArray[Any]
    ) -> None:
        """
        Draw pieces of lines over the colour, (H, W, 4).

        ``pieces`` are those that `trace` returned, ends relative to the eye, projected by the lens:
        pixels, (N, 2, 2) float64 for each kind of line.
        """
        raise NotImplementedError


class OpaquePassEffect(ScreenEffect):
    """
    An effect that reads another picture of the same view, without some objects (an opaque pass).

    The opaque pass is drawn first, and passed to `Effect.prepare` as the result of `analyse`,
    (H, W, 4) float32, linear.
    """

    def hidden_objects(self, facts: Facts) -> NDArray[Any]:
        """Return which objects, (O,) bool, the opaque pass leaves out."""
        raise NotImplementedError


class QualityEffect(Effect):
    """An effect that the quality requests, not the scene."""

    def quality_without(self, quality: Quality) -> Quality:
        """Return a quality that does not request the effect."""
        raise NotImplementedError

    def quality_with(self, quality: Quality) -> tuple[str, Quality | None]:
        """Suggest the effect: return a description and a quality that requests it, or None."""
        raise NotImplementedError


class BackdropEffect(Effect):
    """An effect that draws behind all faces, without tone mapping."""


class LensEffect(Effect):
    """An effect whose planned data a lens distorts."""

    def distort(self, data: Any, eye: Any, pixels: Callable[[Any], Any]) -> Any:
        """
        Return the plan's data for the effect, distorted by a lens.

        Parameters
        ----------
        data
            As planned without the lens.
        eye : (3,) float64
            World space.
        pixels : callable
            Projects points relative to the eye, (N, 3), to pixels, (N, 2); NaN if not visible.
        """
        return data


def list_screen_effects(planned: Iterable[UsedEffect]) -> list[tuple[ScreenEffect, Any]]:
    """Return each `ScreenEffect` with the plan's data for it."""
    return [(used.effect, used.data) for used in planned if isinstance(used.effect, ScreenEffect)]


class ActiveEffect(NamedTuple):
    """An effect with its record for a picture."""

    effect: Effect
    record: Any

    def call_at(self, place: str, *arguments: Any) -> Any:
        """Call the effect's function for one of `PLACES`."""
        return self.effect.places[place](self.record, *arguments)


def select_acting(effects: Sequence[ActiveEffect], place: str) -> list[ActiveEffect]:
    """Return the effects that act at one of `PLACES`."""
    return [active for active in effects if place in active.effect.places]


def is_backdrop(effect: Effect) -> bool:
    """Tell whether an effect draws behind all faces, without tone mapping."""
    return isinstance(effect, BackdropEffect)


def with_field(scene: Scene, name: str, value: Any) -> Scene:
    """Return a copy of a scene with another value of a field."""
    changed = copy.copy(scene)
    setattr(changed, name, value)
    return changed


def add_to_field(scene: Scene, name: str, value: Any) -> Scene | None:
    """Return a copy of a scene with a value in a field; None if the field's value has an effect."""
    current = getattr(scene, name)
    if current is not None and not _is_neutral(current):
        return None
    return with_field(scene, name, value)


def _is_neutral(value: Any) -> bool:
    """Tell whether an effect's settings change nothing."""
    return getattr(value, "strength", 1.0) == 0.0 or getattr(value, "is_neutral", False)
