"""
Schedule batches: group views by kind, prepare their arrays, and draw them from recorded calls.

A plan depends on the camera in three ways only: the kinds of objects in view (not which), the
lights that reach them, and effects that depend on the view, such as fog that begins at a distance.
These are the kind of a view (`kinds_of`), and views of one kind share a plan. Each thread has
recorded calls with their memory (``command_buffer.py``); matrices, lights and the like are computed
with NumPy for the whole group (`Prepared`), and copied there view by view
(``pipeline/batch_driver.py``).

Only plans whose stages read nothing else of a view are eligible: no shadows, no effects that
analyse the picture by more than kernels; see `can_batch`. The caller draws other views one by one.

Results are cached until the scene is gone, or other scenes need the memory (`MAX_KEPT`), and
reused as far as a new plan confirms that they are valid (`serves`).
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rasterjit import forks
from rasterjit.outputs.output_table import is_attribute
from rasterjit.pipeline import batch_driver as drawing_views
from rasterjit.pipeline.batch_driver import BETWEEN, RATIO, SCALED
from rasterjit.rendering import view_warnings
from rasterjit.rendering.command_buffer import CommandBuffer, memory_of, view_fields, words_of
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.rendering.planning import FrameRequest, plan_views
from rasterjit.rendering.view_warnings import NOTHING_IN_VIEW, WarningsOfViews
from rasterjit.runtime import jit
from rasterjit.scene import transforms
from rasterjit.scene.camera import (
    Camera,
    MatrixCamera,
    OrthographicCamera,
    PerspectiveCamera,
    default_far,
    default_near,
    move_planes,
    near_far,
)
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, PointLight, SpotLight
from rasterjit.scene.mesh import ATTRIBUTE, Mesh
from rasterjit.scene.points import Points
from rasterjit.scene.scene import Scene
from rasterjit.scene.vectors import length
from rasterjit.survey.batched_views import (
    BatchTransforms,
    ViewGroup,
    are_boxes_between,
    compute_scene_bounds,
    transform_batched_objects,
    transform_to_views,
)
from rasterjit.survey.cache import SceneCache
from rasterjit.survey.clip_planes import (
    PLANE_MARGIN,
    find_clip_margins,
    find_plane_needs,
    find_uneven_spheres,
)
from rasterjit.survey.effect import BatchedEffect, ScreenEffect
from rasterjit.survey.light_culling import (
    HEADLIGHT_DIRECTION,
    MAX_LIGHT_DISTANCE,
    find_reaching_lights,
    pack_headlight,
    pack_lights,
)
from rasterjit.survey.object_counts import ObjectCounts
from rasterjit.survey.object_transforms import (
    Boxes,
    BoxMeasures,
    Extents,
    ObjectTransforms,
    compute_projection,
    measure_boxes,
)
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.transparency import PixelLayers

Float64 = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]

KNOWN_CAMERAS = (PerspectiveCamera, OrthographicCamera, MatrixCamera)
"""Cameras whose depth is measured in machine code; not subclasses."""

COUNTED = ("triangles_in", "outside", "culled", "degenerate", "unsampled", "invalid", "drawn",
           "clipped", "pixels_covered")  # fmt: skip
"""What is counted of each view: names of ``FrameStats``."""

MIN_SHARE = 1e-30
"""Least ratio of near plane to farthest distance; smaller ones are checked view by view, as the
depth format may not resolve the far end."""

MAX_SETS = 4096
"""Most sets of objects in view that are remembered."""


BY_KERNEL = (
    "color", "linear", "depth", "distance", "face_id", "object_id", "instance_id", "material_id",
    "barycentric", "uv", "normal", "geometric_normal", "position", "object_position",
)  # fmt: skip
"""Outputs that kernels fill without NumPy work per view; vertex attributes, too."""

BATCHED_EFFECTS = tuple(one for one in EFFECTS if isinstance(one, BatchedEffect))
"""Effects that views in groups may have."""

VIEW_DEPENDENT = tuple(
    one for one in BATCHED_EFFECTS if type(one).decide_views is not BatchedEffect.decide_views
)
"""Effects of groups that depend on more than facts and contents of a view."""

LIGHTS = AmbientLight, DirectionalLight, PointLight, SpotLight
"""Kinds of lights whose rows are found for many views at once."""

MAX_BYTES = 1 << 29
"""Most memory of all threads; beyond it views are drawn one by one."""

MAX_KEPT = 1 << 26
"""Most memory cached between calls, of all scenes, bytes."""

MAX_KINDS = 8
"""Most kinds of plans that are kept."""


class Prepared(NamedTuple):
    """The per-view arrays of a group."""

    fields: dict[str, NDArray[np.int64]]
    """The words of each array that commands read: (N, words), or (1, words) if all views have the
    same."""
    lights: NDArray[np.float32]
    """(N, L, 13): the rows of all lights."""
    kinds: list[tuple | None]
    """The kind of each view; None: it must be drawn alone."""
    cuts: dict[int, dict[str, str]]
    """Warnings of views in which a given plane clips something, by index."""


class BatchScheduler:
    """
    State shared by the threads that draw views of a scene.

    Parameters
    ----------
    scene : Scene
    kept : BatchCache
        What earlier batches of the scene prepared, and the plan of the first view; changed.
    options : FrameRequest
    arrays : dict
        (N, H, W, ...) of each output: where views are written.
    scene_of : callable
        Returns the scene as it is in a view, given its number.
    """

    def __init__(
        self, scene: Scene, kept: BatchCache, options: FrameRequest, arrays: Arrays,
        scene_of: Callable[[int], Scene],
    ) -> None:  # fmt: skip
        self.scene, self.cache, self.options = scene, kept.cache, options
        self._kept, self._arrays = kept, arrays
        self._scene_of = scene_of
        self.lights = shared_lights(scene)
        self.is_colored = not {"color", "linear"}.isdisjoint(options.outputs)
        self.has_headlight = not scene.lights and scene.environment is None
        self._plans: dict[tuple, RenderPlan | None] = {}
        self._lock = forks.lock()
        boxes, places = self.cache.shapes.boxes, self.cache.transforms.world_from_model
        self._whole = compute_scene_bounds(boxes, places[np.newaxis])

    def acquire_commands(self, kind: tuple, number: int, camera: Camera) -> CommandBuffer | None:
        """
        Return memory for a kind of views, of which one is given.

        None: they share too little, or there is no room.
        """
        plan = self._plan_of(kind, number, camera)
        if plan is None:
            return None
        commands = self._kept.take(kind)
        if commands is None:
            if not self._kept.reserve(memory_of(plan, self.cache)):
                return None
            commands = CommandBuffer(plan, self.cache, self._rows_of(plan))
        commands.write_to(self._arrays)
        return commands

    def _rows_of(self, plan: RenderPlan) -> list[int]:
        """Return the rows of lights that shine in views of a plan, of those that are prepared."""
        if plan.facts.has_headlight:
            return [0]
        return [row for row, n in enumerate(self.lights) if n in plan.facts.lights.numbers]

    def give_back(self, kind: tuple, commands: CommandBuffer) -> None:
        """Take back what `acquire_commands` returned."""
        self._kept.give_back(kind, commands)

    def _plan_of(self, kind: tuple, number: int, camera: Camera) -> RenderPlan | None:
        """Return the plan of a kind of views, of which one is given; None: they share none."""
        with self._lock:
            if kind not in self._plans and len(self._plans) < MAX_KINDS:
                plan = self._kept.first
                if plan is None or kind_of_plan(plan) != kind:
                    scene, known = self._scene_of(number), self._kept.plan_of(kind)
                    plan = plan_views(self.options, scene, camera, self.cache, known).plan
                fits = kind_of_plan(plan) == kind and can_batch(plan, self.scene, self.cache)
                self._plans[kind] = self._kept.use(kind, plan) if fits else None
            return self._plans.get(kind)

    def prepare(
        self, numbers: Sequence[int], cameras: Sequence[Camera], places: Float64 | None
    ) -> Prepared:
        """Prepare some views, with the places of objects, (N, O, 4, 4), if these move."""
        known, extents = self.cache.transforms, self.cache.extents
        if places is not None:
            known = transform_batched_objects(exact_last_rows(places))
            extents = Extents(self.cache.shapes.boxes, known.world_from_model)
        else:
            known = ObjectTransforms(*(part[np.newaxis] for part in known))
        seen, cuts = list(cameras), {}
        view = np.array([camera.view_matrix() for camera in seen], np.float64)
        eyes = np.array([camera.eye_position() for camera in seen], np.float64)
        projection = np.array([compute_projection(camera, self.options.size) for camera in seen])
        views = transform_to_views(known.world_from_model, eyes, view, projection)
        measures = measure_boxes(extents, views.relative_from_model, views.clip_from_relative)
        # Place open planes where they clip nothing in view.
        is_sure, far = self._are_between(seen, view, known, places is not None)
        beyond_boxes = np.broadcast_to(self._are_spheres_beyond(known), len(seen))
        asked = (~is_sure | beyond_boxes) & views.is_finite
        moved = []
        for n in self._find_crossed(seen, asked, beyond_boxes, views, measures):
            of_all = measures.select_views(n)
            relative, clip = views.relative_from_model[n], views.clip_from_relative[n]
            own = self.cache.extents
            if places is not None:
                own = Extents(self.cache.shapes.boxes, known.world_from_model[n])
            beyond = self.cache.tables.inventory.pixel_overhang(self.options.size)
            boxes = Boxes(own, eyes[n], relative, clip, of_all, beyond)
            look = find_plane_needs(seen[n], boxes, self.scene.nodes, clip, self.options.quality)
            if look.cut:
                cuts[n] = view_warnings.cuts_of(look)
            if any(look.steps):
                seen[n] = move_planes(seen[n], *look.steps)
                projection[n] = compute_projection(seen[n], self.options.size)
                moved.append(n)
        if moved:
            views = transform_to_views(known.world_from_model, eyes, view, projection)
            measures = measure_boxes(extents, views.relative_from_model, views.clip_from_relative)
        # Decide which views are drawn together.
        coefficients = np.array([camera.depth_coefficients() for camera in seen])
        near = coefficients[:, 0]
        farthest = np.where(np.isinf(far), 0.0, transforms.MIN_NEAR * far)
        is_held = (near >= MIN_SHARE * measures.compute_max_w()) & (near >= farthest)
        is_plain = views.is_finite & ((near <= 0.0) | is_held)
        seen_of = [self._contents(in_view) for in_view in measures.in_view]
        group = ViewGroup(
            seen, self.options.size, eyes, views, measures.in_view, self.cache.shapes.boxes,
            lambda: [self._scene_of(n) for n in (numbers if places is not None else numbers[:1])],
        )  # fmt: skip
        kinds = kinds_of(
            self.scene, group, [own for own, _ in seen_of], self.is_colored,
            [is_lit for _, is_lit in seen_of],
        )  # fmt: skip
        kinds = [
            kind if plain and type(camera) in KNOWN_CAMERAS else None
            for kind, plain, camera in zip(kinds, is_plain, seen, strict=True)
        ]
        fields = self._fields(seen, known, views, view)
        for effect in BATCHED_EFFECTS if self.is_colored else ():
            fields |= effect.compute_view_arrays(self.scene, group)
        fields["coefficients"] = coefficients
        words = {name: words_of(values) for name, values in fields.items()}
        return Prepared(words, self._light_rows(seen[0], view, eyes), kinds, cuts)

    def _are_spheres_beyond(self, places: ObjectTransforms) -> NDArray[np.bool_]:
        """Tell in which views, (N,) or (1,) for all, spheres reach beyond their boxes."""
        count = len(places.world_from_model)
        if not any(isinstance(node.mesh, Points) for node in self.scene.nodes):
            return np.zeros(count, np.bool_)
        found = [
            bool(find_uneven_spheres(self.scene.nodes, own)) for own in places.world_from_model
        ]
        return np.array(found, np.bool_).reshape(count)

    def _are_between(
        self, cameras: Sequence[Camera], view: Float64, places: ObjectTransforms, are_moved: bool
    ) -> tuple[NDArray[np.bool_], Float64]:
        """Tell of which cameras, (N,), no plane surely cuts anything, and where far planes are."""
        near, far = np.full(len(cameras), -np.inf), np.full(len(cameras), np.inf)
        for n, camera in enumerate(cameras):
            planes = near_far(camera)
            if planes is None or planes.near_steps is not None or planes.far_steps is not None:
                continue
            near[n] = planes.near / (1.0 - PLANE_MARGIN) if planes.is_near_open else planes.near
            far[n] = planes.far * (1.0 - PLANE_MARGIN) if planes.is_far_open else planes.far
        own = far.copy()
        near[near <= 0.0] = -np.inf
        low, high = (
            compute_scene_bounds(self.cache.shapes.boxes, places.world_from_model)
            if are_moved
            else self._whole
        )
        return are_boxes_between(low, high, view, near, far), own

    def _find_crossed(
        self, cameras: Sequence[Camera], is_asked: NDArray[np.bool_],
        beyond_boxes: NDArray[np.bool_], views: BatchTransforms, measures: BoxMeasures,
    ) -> list[int]:  # fmt: skip
        """Return the views, of those asked for, where an object may reach over a plane."""
        asked = [
            (n, margins.inside)
            for n in np.flatnonzero(is_asked).tolist()
            if (margins := find_clip_margins(cameras[n], views.clip_from_relative[n])) is not None
        ]
        if not asked:
            return []
        numbers = [n for n, _ in asked]
        near, far = np.array([inside for _, inside in asked]).T[..., np.newaxis]
        some = measures.select_views(numbers)
        crossed = some.may_cross(near, far).any(axis=1) | beyond_boxes[numbers]
        return [n for n, is_crossed in zip(numbers, crossed, strict=True) if is_crossed]

    def _contents(self, in_view: NDArray[np.bool_]) -> tuple[tuple | None, bool]:
        """Return what is in view, `kind_of`, None for nothing, and whether light falls on it."""
        key, kinds = in_view.tobytes(), self._kept.kinds
        if key in kinds:
            return kinds[key]
        contents = self.cache.tables.inventory.count_chosen(in_view)
        own = kind_of(contents) if contents.objects else None
        found = own, contents.unlit < contents.objects
        if len(kinds) < MAX_SETS:
            kinds[key] = found
        return found

    def _light_rows(self, camera: Camera, view: Float64, eyes: Float64) -> NDArray[np.float32]:
        """Return the rows of all lights in each view, (N, L, 13)."""
        if self.has_headlight:
            return headlight_rows(camera, view)
        return light_rows([self.scene.lights[n] for n in self.lights], camera, eyes)

    def _fields(
        self,
        cameras: Sequence[Camera],
        places: ObjectTransforms,
        views: BatchTransforms,
        view: Float64,
    ) -> dict[str, NDArray[Any]]:
        """Return all arrays of a view but those of lights and effects, (N, ...) or (1, ...)."""
        cache, options = self.cache, self.options
        fields = view_fields(
            views, places, places.world_from_model, views.screen_winding[:, np.newaxis],
            options.cull, cache.tables.is_single_sided, view[:, 2, :3],
        )  # fmt: skip
        kind = cache.shapes.positions(options.quality.precision).dtype
        kinds: dict[str, Any] = {
            "relative_from_model": kind, "clip_from_relative": kind, "viewer": np.float32,
            "is_parallel": np.int64,
        }  # fmt: skip
        with np.errstate(over="ignore"):
            for name, kind in kinds.items():
                fields[name] = fields[name].astype(kind, copy=False)
        if "depth" in self.options.outputs:
            ways = [depth_conversion(camera) for camera in cameras]
            fields["depth_conversion"] = np.array([[way] for way, *_ in ways], np.int64)
            fields["depth_factors"] = np.array([factors for _, *factors in ways])
        return fields


def exact_last_rows(places: Float64) -> Float64:
    """Return a copy of affine matrices with exact last rows, as those of nodes are."""
    places = places.copy()
    places[..., 3, :] = 0.0, 0.0, 0.0, 1.0
    return places


def depth_conversion(camera: Any) -> tuple[int, float, float, float]:
    """Return how a stored depth becomes metric, as `measure_depths` takes it."""
    if isinstance(camera, PerspectiveCamera):
        return RATIO, default_near(camera.near, camera.far), 1.0, 0.0
    if isinstance(camera, OrthographicCamera):
        return BETWEEN, camera.near, default_far(camera.far, camera.near), 0.0
    z_row, w_row = camera.clip_from_view[2:].tolist()
    if any(w_row[:3]):
        return RATIO, camera.depth_coefficients()[0], length(w_row[:3]), 0.0
    return SCALED, w_row[3], z_row[3], length(z_row[:3])


def light_rows(lights: Sequence[Light], camera: Camera, eyes: Float64) -> NDArray[np.float32]:
    """Return the lights of each view, (N, L, 13), relative to its eye; see `light_culling`."""
    rows = np.repeat(pack_lights(lights, camera, 0).lights[np.newaxis], len(eyes), axis=0)
    for n, light in enumerate(lights):
        if isinstance(light, PointLight | SpotLight):
            place = np.array(light.position) - eyes
            rows[:, n, :3] = np.clip(place, -MAX_LIGHT_DISTANCE, MAX_LIGHT_DISTANCE)
    return rows


def headlight_rows(camera: Camera, view_from_world: Float64) -> NDArray[np.float32]:
    """Return the light of each view of a scene that has none, (N, 1, 13): `pack_headlight`."""
    rows = np.repeat(pack_headlight(camera, 0).lights[np.newaxis], len(view_from_world), axis=0)
    matrices = transforms.normal_matrices(view_from_world)
    x, y, z = HEADLIGHT_DIRECTION
    along = (matrices[:, 0] * x + matrices[:, 1] * y) + matrices[:, 2] * z
    along /= np.abs(along).max(axis=1, keepdims=True)
    a, b, c = along.T
    rows[:, 0, :3] = -(along / np.sqrt((a * a + b * b) + c * c)[:, np.newaxis])
    return rows


class GroupResult(NamedTuple):
    """Counts and warnings of a group's views."""

    counts: NDArray[np.int64]
    """(N, 9): ``COUNTED`` of each; anything of those that were not drawn."""
    is_drawn: NDArray[np.bool_]
    """(N,): False for those that must be drawn alone."""
    told: WarningsOfViews
    """Warnings of those that were drawn."""


def count_chosen(totals: NDArray[np.int64], faces: int) -> NDArray[np.int64]:
    """Return ``COUNTED`` of views, (N, 9), by the totals of `CommandBuffer.draw`."""
    lost = totals[:, : drawing_views.COVERED]
    outside, degenerate, culled, unsampled, invalid = lost.T
    of_all = np.full(len(totals), faces)
    return np.stack(
        (
            of_all, outside, culled, degenerate, unsampled, invalid, of_all - lost.sum(axis=1),
            totals[:, drawing_views.CUT], totals[:, drawing_views.COVERED],
        ),
        axis=1,
    )  # fmt: skip


class GroupRenderer:
    """
    Draws groups of views in one thread.

    Parameters
    ----------
    shared : BatchScheduler
    """

    def __init__(self, shared: BatchScheduler) -> None:
        self._shared = shared
        self._free_commands: dict[tuple, CommandBuffer] = {}

    def close(self) -> None:
        """Give back what it drew in."""
        for taken in self._free_commands.items():
            self._shared.give_back(*taken)
        self._free_commands.clear()

    def draw(
        self, numbers: range, cameras: Sequence[Camera], places: Float64 | None
    ) -> GroupResult:
        """
        Draw views; leave out those that must be drawn alone.

        Parameters
        ----------
        numbers : range
            Of the views, among all.
        cameras : sequence of Camera
            That of each.
        places : (N, O, 4, 4) float64, or None
            Where the objects stand in each; None: as in the scene.
        """
        prepared = self._shared.prepare(numbers, cameras, places)
        counts, told = np.zeros((len(numbers), len(COUNTED)), np.int64), WarningsOfViews()
        is_drawn = np.zeros(len(numbers), np.bool_)
        of_kinds: dict[tuple | None, list[int]] = {}
        for n, kind in enumerate(prepared.kinds):
            of_kinds.setdefault(kind, []).append(n)
        for kind, chosen in of_kinds.items():
            commands = (
                None
                if kind is None
                else self._commands(kind, numbers[chosen[0]], cameras[chosen[0]])
            )
            if commands is None:
                continue
            pairs = np.array([(n, numbers[n]) for n in chosen], np.int64)
            totals, is_drawn[chosen] = commands.draw(prepared.fields, prepared.lights, pairs)
            counts[chosen] = count_chosen(totals, self._faces)
            lit, white = (
                totals[:, drawing_views.LIT_PIXELS],
                totals[:, drawing_views.LIT_WHITE_PIXELS],
            )
            for n in np.flatnonzero(2 * white > lit).tolist():
                share = float(white[n] / lit[n])
                told.add(numbers[chosen[n]], view_warnings.burnt_out(commands.facts, share))
        # Collect warnings.
        is_empty = counts[:, COUNTED.index("drawn")] == 0
        for n in np.flatnonzero(is_drawn & is_empty).tolist():
            if n not in prepared.cuts:
                told.add(numbers[n], {"view": NOTHING_IN_VIEW})
        for n in np.flatnonzero(is_drawn).tolist() if prepared.cuts else ():
            told.add(numbers[n], prepared.cuts.get(n, {}))
        return GroupResult(counts, is_drawn, told)

    @property
    def _faces(self) -> int:
        return len(self._shared.cache.shapes.arrays.faces)

    def _commands(self, kind: tuple, number: int, camera: Camera) -> CommandBuffer | None:
        """Return the memory for a kind of views, of which one is given; None: there is none."""
        if kind not in self._free_commands:
            commands = self._shared.acquire_commands(kind, number, camera)
            if commands is None:
                return None
            self._free_commands[kind] = commands
        return self._free_commands[kind]


def is_possible(options: FrameRequest) -> bool:
    """Tell whether there may be anything to draw in groups; not where kernels run in Python."""
    return not (jit.DISABLED or jit.CHECKED) and all(
        name in BY_KERNEL or is_attribute(name) for name in options.outputs
    )


def shared_lights(scene: Scene) -> list[int]:
    """Return the numbers of the lights that may have a row in ``Lighting.lights``."""
    return [
        n
        for n, light in enumerate(scene.lights)
        if not isinstance(light, AmbientLight) and light.intensity != 0.0 and any(light.color)
    ]


def can_batch(plan: RenderPlan, scene: Scene, cache: SceneCache) -> bool:
    """Tell whether views of a plan like this one are drawn in groups."""
    facts = plan.facts
    if facts.counts.primitives or scene.section is not None or facts.reference is not None:
        return False
    if plan.pictures != 1 or plan.surfaces:
        return False
    if plan.layers is not None and not _mixes_in_batches(plan.layers):
        return False
    if not facts.finds_faces or (facts.is_colored and not facts.draws_faces):
        return False
    if not plan.depth_format.is_standard or not plan.quality.renormalize:
        return False
    if facts.background_image is not None or plan.keeps_clip_positions or facts.diagnose:
        return False
    # Others prepare something for each picture, from what is seen there, by more than kernels.
    if not all(
        isinstance(one.effect, BatchedEffect)
        for one in plan.planned
        if one.effect.places or isinstance(one.effect, ScreenEffect)
    ):
        return False
    if not all(map(_is_shared, scene.lights)):
        return False
    return all(name in BY_KERNEL or is_attribute(name) for name in plan.outputs) and all(
        cache.shapes.attribute(name.removeprefix(ATTRIBUTE), attribute)[1] is None
        for name, attribute in facts.attributes.items()
    )


def _mixes_in_batches(layers: PixelLayers) -> bool:
    """Tell whether pixels have several samples, or transparency at one, in linear light."""
    if layers.mixes_codes or layers.samples == "area":
        return False
    return not layers.has_blended or (layers.samples == 1 and layers.most is None)


def _is_shared(light: Light) -> bool:
    """Tell whether what is read of a light follows from the camera: shadow maps are fitted."""
    return type(light) in LIGHTS and getattr(light, "shadow", None) is None


def kind_of(contents: ObjectCounts) -> tuple:
    """Return the kind of a view by its contents: whether any object has each property."""
    return tuple(
        tuple(count > 0 for count in part.values()) if isinstance(part, dict) else part > 0
        for part in contents
    )


def kind_of_plan(plan: RenderPlan) -> tuple:
    """Return the kind of the view that a plan is of."""
    facts = plan.facts
    told = tuple(plan.has(one.name) for one in VIEW_DEPENDENT)
    return kind_of(facts.visible), tuple(facts.lights.numbers), told


def kinds_of(
    scene: Scene, group: ViewGroup, contents: list[tuple | None], is_colored: bool,
    is_lit: list[bool],
) -> list[tuple | None]:  # fmt: skip
    """
    Return the kind of each view; None: nothing is in view.

    Parameters
    ----------
    scene : Scene
    group : ViewGroup
        The views.
    contents : list of (tuple or None)
        What is in view of each: see `kind_of`.
    is_colored : bool
        Whether any output shows colour.
    is_lit : list of bool
        Whether anything is that light falls on, in each.
    """
    count = len(contents)
    reached = np.zeros((count, 0), np.bool_)
    told: NDArray[Any] = np.zeros((count, len(VIEW_DEPENDENT)), np.bool_)
    if is_colored:
        reached = find_reaching_lights(scene.lights, group)
        for n, effect in enumerate(VIEW_DEPENDENT):
            told[:, n] = effect.decide_views(scene, group)
    return [
        None
        if own is None
        else (own, tuple(np.flatnonzero(lights).tolist()) if lit else (), tuple(answers))
        for own, lights, lit, answers in zip(contents, reached, is_lit, told.tolist(), strict=True)
    ]


class BatchCache:
    """
    Cache of what batches of one scene have prepared.

    Parameters
    ----------
    cache : SceneCache
        Of the scene, when it was drawn last.
    """

    def __init__(self, cache: SceneCache) -> None:
        self.cache = cache
        self.first: RenderPlan | None = None
        """The plan of the first view, of the batch at hand or the last."""
        self.renderer: Any = None
        """What draws small batches of one view."""
        self.kinds: dict[bytes, tuple[tuple | None, bool]] = {}
        """What is in view, and whether light falls on it, by which objects are in view."""
        self._plans: dict[tuple, RenderPlan] = {}
        self._free_commands: dict[tuple, list[CommandBuffer]] = {}
        """Free command buffers by kind, least recently used first."""
        self._lock = forks.lock()
        self.bytes = 0
        """Of all command buffers, those in use included."""

    @property
    def size(self) -> int:
        """Memory of all that is kept, about, bytes."""
        return self.bytes + (0 if self.renderer is None else self.renderer.bytes_kept)

    def plan_of(self, kind: tuple) -> RenderPlan | None:
        """Return the plan that the command buffers of a kind were made for, if there are any."""
        return self._plans.get(kind)

    def use(self, kind: tuple, plan: RenderPlan) -> RenderPlan:
        """Return the plan to make command buffers for: an earlier one, if still valid."""
        with self._lock:
            made = self._plans.pop(kind, None)
            if made is None or not serves(made, plan):
                self._drop(kind)
                made = plan
            self._plans[kind] = made
            for other in [*self._plans][:-MAX_KINDS]:
                self._drop(other)
                del self._plans[other]
            return made

    def take(self, kind: tuple) -> CommandBuffer | None:
        """Return a command buffer that nobody draws in; ``None`` if there is none."""
        with self._lock:
            free = self._free_commands.get(kind)
            return free.pop() if free else None

    def reserve(self, size: int) -> bool:
        """Reserve memory for another command buffer; return whether there is enough."""
        with self._lock:
            if self.bytes + size > MAX_BYTES:
                for kind in [*self._free_commands]:
                    self._drop(kind)
            has_room = self.bytes + size <= MAX_BYTES
            self.bytes += size * has_room
            return has_room

    def give_back(self, kind: tuple, commands: CommandBuffer) -> None:
        """Take a command buffer back."""
        with self._lock:
            if kind in self._plans:
                self._free_commands.setdefault(kind, []).append(commands)
            else:
                self.bytes -= commands.bytes

    def _drop(self, kind: tuple) -> None:
        """Let the command buffers of a kind go."""
        self.bytes -= sum(commands.bytes for commands in self._free_commands.pop(kind, ()))


def renewed(kept: BatchCache | None, cache: SceneCache) -> BatchCache:
    """Return what batches of a scene have prepared, or nothing, if meshes or materials changed."""
    if (
        kept is None
        or cache.shapes is not kept.cache.shapes
        or cache.tables is not kept.cache.tables
    ):
        return BatchCache(cache)
    kept.cache = cache
    return kept


def serves(made: RenderPlan, asked: RenderPlan) -> bool:
    """Tell whether command buffers made for a plan are valid for another one of the same kind."""
    one, other = made.facts, asked.facts
    return (
        made.size == asked.size
        # Meshes and materials are the same as long as their inventory is.
        and one.inventory is other.inventory
        and one.quality == other.quality
        and (one.outputs, one.has_uneven_scale, one.attributes, one.lights, one.has_background)
        == (
            other.outputs,
            other.has_uneven_scale,
            other.attributes,
            other.lights,
            other.has_background,
        )
        and one.has_lights == other.has_lights
        and one.diagnose == other.diagnose
        and one.reference is other.reference
        and one.background_image is other.background_image
        and all(map(operator.is_, one.fields.values(), other.fields.values()))
        and made.background.tobytes() == asked.background.tobytes()
        and _lights(made) == _lights(asked)
        and _effects(made) == _effects(asked)
    )


def _effects(plan: RenderPlan) -> list[tuple[Any, int]]:
    """Return the effects with their data that is common to all views."""
    return [(one.effect, id(one.data) * one.effect.needs_facts_only) for one in plan.planned]


def _lights(plan: RenderPlan) -> tuple[int, bytes] | None:
    """Return the properties of its lights that do not depend on the camera."""
    if plan.lighting is None:
        return None
    return len(plan.lighting.lights), plan.lighting.ambient.tobytes()


class BatchCaches:
    """Caches of the scenes and meshes of the last batches, which go with them."""

    def __init__(self) -> None:
        # Without those of batches that are being drawn: others of the scene begin anew.
        self._kept: WeakKeyDictionary[Scene | Mesh, BatchCache] = WeakKeyDictionary()
        self._lock = forks.lock()

    def take(self, what: Any) -> BatchCache | None:
        """Take what is kept of a scene or a mesh out, for exclusive use."""
        if not isinstance(what, (Scene, Mesh)):
            return None
        with self._lock:
            return self._kept.pop(what, None)

    def put(self, what: Any, cache: BatchCache) -> None:
        """Put the cache of a scene or a mesh back, which it does not keep alive."""
        if not isinstance(what, (Scene, Mesh)) or cache.size > MAX_KEPT:
            return
        with self._lock:
            self._kept[what] = cache
            while len(self._kept) > 1 and sum(one.size for one in self._kept.values()) > MAX_KEPT:
                del self._kept[next(iter(self._kept))]


BATCH_CACHES = BatchCaches()
"""That of this process."""
