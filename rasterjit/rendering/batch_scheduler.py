"""
Schedule batches: group views by kind, prepare their arrays, and draw them from recorded calls.

A plan depends on the camera in three ways only: the kinds of objects in view (not which), the
lights that reach them, and effects that depend on the view, such as fog that begins at a distance.
These are the kind of a view (`find_kinds`), and views of one kind share a plan. Each thread has
recorded calls with their memory (``command_buffer.py``); matrices, lights and the like are computed
with NumPy for the whole group (`PreparedGroup`), and copied there view by view
(``pipeline/batch_driver.py``).

Only plans whose stages read nothing else of a view, but for records that effects fill in Python
(`BatchedEffect.fill_record`), are eligible; see `can_batch`. The caller draws other views one by
one.

Results are cached until the scene is gone, or other scenes need the memory (`MAX_CACHED_BYTES`),
and reused as far as a new plan confirms that they are valid (`is_reusable`).
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
from rasterjit.pipeline import batch_driver
from rasterjit.rendering import view_warnings
from rasterjit.rendering.command_buffer import (
    CommandBuffer,
    ViewContents,
    estimate_bytes,
    make_view_fields,
    pack_words,
)
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.rendering.planning import FrameRequest, plan_frame
from rasterjit.rendering.view_warnings import NOTHING_IN_VIEW, WarningsOfViews
from rasterjit.runtime import jit
from rasterjit.scene import transforms
from rasterjit.scene.camera import (
    Camera,
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
from rasterjit.survey import batched_views
from rasterjit.survey.batched_views import BatchTransforms, ViewGroup
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
    KNOWN_CAMERAS,
    Boxes,
    BoxMeasures,
    ObjectTransforms,
    compute_projection,
    measure_boxes,
)
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.transparency import PixelLayers

Float64 = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]

COUNTED = ("triangles_in", "outside", "culled", "degenerate", "unsampled", "invalid", "drawn",
           "clipped", "pixels_covered")  # fmt: skip
"""Counts of each view: names of ``FrameStats``."""

MIN_NEAR_RATIO = 1e-30
"""Least ratio of near plane to farthest distance; views with smaller ones are checked one by one,
as the depth format may not resolve the far end."""

MAX_CACHED_VISIBLE_SETS = 4096
"""Most sets of objects in view whose kinds are cached."""

BY_KERNEL = (
    "color", "linear", "depth", "distance", "face_id", "object_id", "instance_id", "material_id",
    "barycentric", "uv", "normal", "geometric_normal", "position", "object_position",
)  # fmt: skip
"""Outputs that kernels fill without NumPy work per view; vertex attributes, too."""

BATCHED_EFFECTS = tuple(one for one in EFFECTS if isinstance(one, BatchedEffect))
"""Effects that views in groups may have."""

VIEW_DEPENDENT_EFFECTS = tuple(
    one for one in BATCHED_EFFECTS if type(one).decide_views is not BatchedEffect.decide_views
)
"""Batched effects that depend on more than a view's facts."""

LIGHT_TYPES = AmbientLight, DirectionalLight, PointLight, SpotLight
"""Types of lights whose rows are computed for many views at once."""

MAX_COMMAND_BYTES = 1 << 29
"""Most memory of a scene's recorded calls; beyond it, views are drawn one by one."""

MAX_CACHED_BYTES = 1 << 26
"""Most memory cached between batches, for all scenes."""

MAX_KINDS = 8
"""Most kinds of views whose plans are cached."""


class PreparedGroup(NamedTuple):
    """The per-view arrays of a group."""

    fields: dict[str, NDArray[np.int64]]
    """The words of each array that commands read: (N, words), or (1, words) if all views have the
    same."""
    lights: NDArray[np.float32]
    """(N, L, 13): the rows of all lights."""
    kinds: list[tuple | None]
    """The kind of each view; None: it must be drawn alone."""
    contents: list[ViewContents]
    clip_warnings: dict[int, dict[str, str]]
    """Warnings of views in which a given plane clips something, by index."""


class BatchScheduler:
    """
    State shared by the threads that draw views of a scene.

    Parameters
    ----------
    scene : Scene
    batch_cache : BatchCache
        Of the scene, with the plan of the first view; updated.
    options : FrameRequest
    arrays : dict
        (N, H, W, ...) of each output: where views are written.
    scene_of : callable
        Returns the scene as it is in a view, given its number.
    """

    def __init__(
        self, scene: Scene, batch_cache: BatchCache, options: FrameRequest, arrays: Arrays,
        scene_of: Callable[[int], Scene],
    ) -> None:  # fmt: skip
        self.scene, self.cache, self.options = scene, batch_cache.cache, options
        self._batch_cache, self._arrays = batch_cache, arrays
        self._scene_of = scene_of
        self.lights = list_shared_lights(scene)
        self.is_colored = not {"color", "linear"}.isdisjoint(options.outputs)
        self.has_headlight = not scene.lights and scene.environment is None
        self._plans: dict[tuple, RenderPlan | None] = {}
        self._lock = forks.lock()

    def acquire_commands(self, kind: tuple, number: int, camera: Camera) -> CommandBuffer | None:
        """
        Return a command buffer for a kind of views, of which one is given.

        None: views of this kind cannot be batched, or memory does not suffice.
        """
        plan = self._find_plan(kind, number, camera)
        if plan is None:
            return None
        commands = self._batch_cache.acquire(kind)
        if commands is None:
            if not self._batch_cache.reserve(estimate_bytes(plan, self.cache)):
                return None
            commands = CommandBuffer(plan, self.cache, self._list_light_rows(plan))
        commands.write_to(self._arrays)
        return commands

    def _list_light_rows(self, plan: RenderPlan) -> list[int]:
        """Return which of the prepared rows of lights shine in views of a plan."""
        if plan.facts.has_headlight:
            return [0]
        return [row for row, n in enumerate(self.lights) if n in plan.facts.lights.numbers]

    def release(self, kind: tuple, commands: CommandBuffer) -> None:
        """Make a command buffer from `acquire_commands` available again."""
        self._batch_cache.release(kind, commands)

    def _find_plan(self, kind: tuple, number: int, camera: Camera) -> RenderPlan | None:
        """Return the plan of a kind of views, given one; None: they cannot be batched."""
        with self._lock:
            if kind not in self._plans and len(self._plans) < MAX_KINDS:
                plan = self._batch_cache.first
                if plan is None or kind_of_plan(plan) != kind:
                    scene, last_plan = self._scene_of(number), self._batch_cache.find_plan(kind)
                    plan = plan_frame(self.options, scene, camera, self.cache, last_plan).plan
                fits = kind_of_plan(plan) == kind and can_batch(plan, self.scene, self.cache)
                self._plans[kind] = self._batch_cache.choose_plan(kind, plan) if fits else None
            return self._plans.get(kind)

    def prepare(
        self, numbers: Sequence[int], cameras: Sequence[Camera], places: Float64 | None
    ) -> PreparedGroup:
        """Prepare a group of views, with ``world_from_model`` of moving objects, (N, O, 4, 4)."""
        # Transform the objects of all views.
        known, bounds = self.cache.transforms, self.cache.shapes.boxes
        if places is not None:
            known = batched_views.transform_batched_objects(set_exact_last_rows(places))
        else:
            known = ObjectTransforms(*(part[np.newaxis] for part in known))
        moved_cameras, clip_warnings = list(cameras), {}
        view = np.array([camera.view_matrix() for camera in cameras], np.float64)
        eyes = np.array([camera.eye_position() for camera in cameras], np.float64)
        projection = np.array([compute_projection(camera, self.options.size) for camera in cameras])
        views = batched_views.transform_to_views(known.world_from_model, eyes, view, projection)
        measures = measure_boxes(bounds, views.relative_from_model, views.clip_from_relative)
        # Place open planes where they clip nothing in view.
        is_clear, far = self._check_planes(cameras, view, measures.ends)
        beyond_boxes = np.broadcast_to(self._are_spheres_beyond(known), len(cameras))
        needs_check = (~is_clear | beyond_boxes) & views.is_finite
        has_moved = False
        for n in self._find_crossed_views(cameras, needs_check, beyond_boxes, views, measures):
            relative, clip = views.relative_from_model[n], views.clip_from_relative[n]
            beyond = self.cache.tables.inventory.pixel_overhang(self.options.size)
            boxes = Boxes(bounds, eyes[n], relative, clip, measures.select_views(n), beyond)
            needs = find_plane_needs(
                cameras[n], boxes, self.scene.nodes, clip, self.options.quality
            )
            if needs.cut:
                clip_warnings[n] = view_warnings.clip_warnings_of(needs)
            if any(needs.steps):
                moved_cameras[n] = move_planes(cameras[n], *needs.steps)
                projection[n] = compute_projection(moved_cameras[n], self.options.size)
                has_moved = True
        if has_moved:
            views = batched_views.transform_to_views(known.world_from_model, eyes, view, projection)
            measures = measure_boxes(bounds, views.relative_from_model, views.clip_from_relative)
        # Decide which views are drawn together.
        coefficients = np.array([camera.depth_coefficients() for camera in moved_cameras])
        near = coefficients[:, 0]
        min_near = np.where(np.isinf(far), 0.0, transforms.MIN_NEAR * far)
        has_depth = (near >= MIN_NEAR_RATIO * measures.compute_max_w()) & (near >= min_near)
        is_eligible = views.is_finite & ((near <= 0.0) | has_depth)
        visible = [self._kind_of_objects(in_view) for in_view in measures.in_view]
        group = ViewGroup(
            moved_cameras, self.options.size, eyes, views, measures.in_view,
            self.cache.shapes.boxes,
            lambda: [self._scene_of(n) for n in (numbers if places is not None else numbers[:1])],
            self.cache.tables.inventory,
        )  # fmt: skip
        kinds = find_kinds(
            self.scene, group, [kind for kind, _ in visible], self.is_colored,
            [is_lit for _, is_lit in visible],
        )  # fmt: skip
        kinds = [
            kind if eligible and type(camera) in KNOWN_CAMERAS else None
            for kind, eligible, camera in zip(kinds, is_eligible, moved_cameras, strict=True)
        ]
        # Pack what differs from view to view.
        fields = self._make_fields(moved_cameras, known, views, view)
        for effect in BATCHED_EFFECTS if self.is_colored else ():
            fields |= effect.compute_view_arrays(self.scene, group)
        fields["coefficients"] = coefficients
        words = {name: pack_words(values) for name, values in fields.items()}
        lights = self._light_rows(moved_cameras[0], view, eyes)
        contents = [*map(ViewContents, moved_cameras, measures.in_view)]
        return PreparedGroup(words, lights, kinds, contents, clip_warnings)

    def _are_spheres_beyond(self, places: ObjectTransforms) -> NDArray[np.bool_]:
        """Tell in which views, (N,), or (1,) for all alike, spheres extend beyond their boxes."""
        count = len(places.world_from_model)
        if not any(isinstance(node.mesh, Points) for node in self.scene.nodes):
            return np.zeros(count, np.bool_)
        return np.array(
            [bool(find_uneven_spheres(self.scene.nodes, each)) for each in places.world_from_model],
            np.bool_,
        )

    def _check_planes(
        self, cameras: Sequence[Camera], view: Float64, ends: Float64
    ) -> tuple[NDArray[np.bool_], Float64]:
        """Return which cameras' planes surely clip nothing, (N,), and their far planes, (N,)."""
        near, far = np.full(len(cameras), -np.inf), np.full(len(cameras), np.inf)
        for n, camera in enumerate(cameras):
            planes = near_far(camera)
            if planes is None or planes.near_steps is not None or planes.far_steps is not None:
                continue
            near[n] = planes.near / (1.0 - PLANE_MARGIN) if planes.is_near_open else planes.near
            far[n] = planes.far * (1.0 - PLANE_MARGIN) if planes.is_far_open else planes.far
        near[near <= 0.0] = -np.inf
        return batched_views.are_boxes_between(ends, view, near, far), far

    def _find_crossed_views(
        self, cameras: Sequence[Camera], needs_check: NDArray[np.bool_],
        beyond_boxes: NDArray[np.bool_], views: BatchTransforms, measures: BoxMeasures,
    ) -> list[int]:  # fmt: skip
        """Return which of the views to check have an object that may cross a plane."""
        margins_of_views = [
            (n, margins.inside)
            for n in np.flatnonzero(needs_check).tolist()
            if (margins := find_clip_margins(cameras[n], views.clip_from_relative[n])) is not None
        ]
        if not margins_of_views:
            return []
        numbers = [n for n, _ in margins_of_views]
        near, far = np.array([inside for _, inside in margins_of_views]).T[..., np.newaxis]
        may_cross = measures.select_views(numbers).may_cross(near, far)
        crossed = may_cross.any(axis=1) | beyond_boxes[numbers]
        return [n for n, is_crossed in zip(numbers, crossed, strict=True) if is_crossed]

    def _kind_of_objects(self, in_view: NDArray[np.bool_]) -> tuple[tuple | None, bool]:
        """Return the kind of the objects in view, None without any, and whether any is lit."""
        key, kinds = in_view.tobytes(), self._batch_cache.kinds
        if key in kinds:
            return kinds[key]
        contents = self.cache.tables.inventory.count_chosen(in_view)
        kind = kind_of(contents) if contents.objects else None
        result = kind, contents.unlit < contents.objects
        if len(kinds) < MAX_CACHED_VISIBLE_SETS:
            kinds[key] = result
        return result

    def _light_rows(self, camera: Camera, view: Float64, eyes: Float64) -> NDArray[np.float32]:
        """Return the rows of all lights in each view, (N, L, 13)."""
        if self.has_headlight:
            return make_headlight_rows(camera, view)
        return make_light_rows([self.scene.lights[n] for n in self.lights], camera, eyes)

    def _make_fields(
        self,
        cameras: Sequence[Camera],
        places: ObjectTransforms,
        views: BatchTransforms,
        view: Float64,
    ) -> dict[str, NDArray[Any]]:
        """Return the arrays of views but for lights and effects: (N, ...), or (1, ...) if alike."""
        cache, options = self.cache, self.options
        fields = make_view_fields(
            views, places, places.world_from_model, views.screen_winding[:, np.newaxis],
            options.cull, cache.tables.is_single_sided, view[:, 2, :3],
        )  # fmt: skip
        precision = cache.shapes.positions(options.quality.precision).dtype
        dtypes: dict[str, Any] = {
            "relative_from_model": precision, "clip_from_relative": precision,
            "viewer": np.float32, "is_parallel": np.int64,
        }  # fmt: skip
        with np.errstate(over="ignore"):
            for name, dtype in dtypes.items():
                fields[name] = fields[name].astype(dtype, copy=False)
        if "depth" in self.options.outputs:
            depths = [depth_conversion(camera) for camera in cameras]
            fields["depth_conversion"] = np.array(
                [[conversion] for conversion, *_ in depths], np.int64
            )
            fields["depth_factors"] = np.array([factors for _, *factors in depths])
        return fields


def set_exact_last_rows(places: Float64) -> Float64:
    """Copy affine matrices, and make their last rows exact, as those of nodes are."""
    places = places.copy()
    places[..., 3, :] = 0.0, 0.0, 0.0, 1.0
    return places


def depth_conversion(camera: Any) -> tuple[int, float, float, float]:
    """Return the conversion of stored to metric depth, and its factors: see `measure_depths`."""
    if isinstance(camera, PerspectiveCamera):
        return batch_driver.RATIO, default_near(camera.near, camera.far), 1.0, 0.0
    if isinstance(camera, OrthographicCamera):
        return batch_driver.BETWEEN, camera.near, default_far(camera.far, camera.near), 0.0
    z_row, w_row = camera.clip_from_view[2:].tolist()
    if any(w_row[:3]):
        return batch_driver.RATIO, camera.depth_coefficients()[0], length(w_row[:3]), 0.0
    return batch_driver.SCALED, w_row[3], z_row[3], length(z_row[:3])


def make_light_rows(lights: Sequence[Light], camera: Camera, eyes: Float64) -> NDArray[np.float32]:
    """Return the lights of each view, (N, L, 13), relative to its eye; see `light_culling`."""
    rows = np.repeat(pack_lights(lights, camera, 0).lights[np.newaxis], len(eyes), axis=0)
    for n, light in enumerate(lights):
        if isinstance(light, PointLight | SpotLight):
            position = np.array(light.position) - eyes
            rows[:, n, :3] = np.clip(position, -MAX_LIGHT_DISTANCE, MAX_LIGHT_DISTANCE)
    return rows


def make_headlight_rows(camera: Camera, view_from_world: Float64) -> NDArray[np.float32]:
    """Return the headlight of each view, for a scene without lights, (N, 1, 13)."""
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
    """(N, 9): ``COUNTED`` of each view; undefined where it was not drawn."""
    is_drawn: NDArray[np.bool_]
    """(N,): False for views that must be drawn alone."""
    warnings: WarningsOfViews
    """Warnings of the views that were drawn."""


def count_chosen(totals: NDArray[np.int64], faces: int) -> NDArray[np.int64]:
    """Return ``COUNTED`` of views, (N, 9), by the totals of `CommandBuffer.draw`."""
    lost = totals[:, : batch_driver.COVERED]
    outside, degenerate, culled, unsampled, invalid = lost.T
    of_all = np.full(len(totals), faces)
    return np.stack(
        (
            of_all, outside, culled, degenerate, unsampled, invalid, of_all - lost.sum(axis=1),
            totals[:, batch_driver.CUT], totals[:, batch_driver.COVERED],
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
        """Release the command buffers."""
        for kind, commands in self._free_commands.items():
            self._shared.release(kind, commands)
        self._free_commands.clear()

    def draw(
        self, numbers: range, cameras: Sequence[Camera], places: Float64 | None
    ) -> GroupResult:
        """
        Draw views, except those that must be drawn alone.

        Parameters
        ----------
        numbers : range
            Of the views, among all.
        cameras : sequence of Camera
            One for each view.
        places : (N, O, 4, 4) float64, or None
            ``world_from_model`` of the objects in each view; None: as in the scene.
        """
        prepared = self._shared.prepare(numbers, cameras, places)
        counts, warnings = np.zeros((len(numbers), len(COUNTED)), np.int64), WarningsOfViews()
        is_drawn = np.zeros(len(numbers), np.bool_)
        views_by_kind: dict[tuple, list[int]] = {}
        for n, kind in enumerate(prepared.kinds):
            if kind is not None:
                views_by_kind.setdefault(kind, []).append(n)
        for kind, chosen in views_by_kind.items():
            commands = self._get_commands(kind, numbers[chosen[0]], cameras[chosen[0]])
            if commands is None:
                continue
            pairs = np.array([(n, numbers[n]) for n in chosen], np.int64)
            contents = [prepared.contents[n] for n in chosen]
            totals, is_drawn[chosen] = commands.draw(
                prepared.fields, prepared.lights, pairs, contents
            )
            counts[chosen] = count_chosen(totals, self._faces)
            lit, white = (
                totals[:, batch_driver.LIT_PIXELS],
                totals[:, batch_driver.LIT_WHITE_PIXELS],
            )
            for n in np.flatnonzero(2 * white > lit).tolist():
                share = float(white[n] / lit[n])
                warnings.add(numbers[chosen[n]], view_warnings.burnt_out(commands.facts, share))
        # Collect warnings.
        is_empty = counts[:, COUNTED.index("drawn")] == 0
        for n in np.flatnonzero(is_drawn & is_empty).tolist():
            if n not in prepared.clip_warnings:
                warnings.add(numbers[n], {"view": NOTHING_IN_VIEW})
        for n in np.flatnonzero(is_drawn).tolist() if prepared.clip_warnings else ():
            warnings.add(numbers[n], prepared.clip_warnings.get(n, {}))
        return GroupResult(counts, is_drawn, warnings)

    @property
    def _faces(self) -> int:
        return len(self._shared.cache.shapes.arrays.faces)

    def _get_commands(self, kind: tuple, number: int, camera: Camera) -> CommandBuffer | None:
        """Return the command buffer for a kind of views, of which one is given, if there is any."""
        if kind not in self._free_commands:
            commands = self._shared.acquire_commands(kind, number, camera)
            if commands is None:
                return None
            self._free_commands[kind] = commands
        return self._free_commands[kind]


def may_batch(options: FrameRequest) -> bool:
    """Tell, by its arguments alone, whether views of a batch may be drawn in groups."""
    return not (jit.DISABLED or jit.CHECKED) and all(
        name in BY_KERNEL or is_attribute(name) for name in options.outputs
    )


def list_shared_lights(scene: Scene) -> list[int]:
    """Return the numbers of the lights that may have a row in ``Lighting.lights``."""
    return [
        n
        for n, light in enumerate(scene.lights)
        if not isinstance(light, AmbientLight) and light.intensity != 0.0 and any(light.color)
    ]


def can_batch(plan: RenderPlan, scene: Scene, cache: SceneCache) -> bool:
    """Tell whether views of a plan like this one can be drawn in groups."""
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
    # Other effects prepare each picture in Python, from the faces that it shows.
    if not all(
        isinstance(one.effect, BatchedEffect)
        for one in plan.planned
        if one.effect.places or isinstance(one.effect, ScreenEffect)
    ):
        return False
    if not all(type(light) in LIGHT_TYPES for light in scene.lights):
        return False
    return all(name in BY_KERNEL or is_attribute(name) for name in plan.outputs) and all(
        cache.shapes.attribute(name.removeprefix(ATTRIBUTE), attribute)[1] is None
        for name, attribute in facts.attributes.items()
    )


def _mixes_in_batches(layers: PixelLayers) -> bool:
    """Tell whether pixels have several opaque samples, or one with transparency, linear."""
    if layers.blends_srgb8 or layers.samples == "area":
        return False
    return not layers.has_blended or (layers.samples == 1 and layers.most is None)


def kind_of(contents: ObjectCounts) -> tuple:
    """Return the kind of a view by its objects: whether any has each of their properties."""
    return tuple(
        tuple(count > 0 for count in part.values()) if isinstance(part, dict) else part > 0
        for part in contents
    )


def kind_of_plan(plan: RenderPlan) -> tuple:
    """Return the kind of the view that a plan was made for."""
    facts = plan.facts
    has_effects = tuple(plan.has(effect.name) for effect in VIEW_DEPENDENT_EFFECTS)
    return kind_of(facts.visible), tuple(facts.lights.numbers), has_effects


def find_kinds(
    scene: Scene, group: ViewGroup, contents: list[tuple | None], is_colored: bool,
    is_lit: list[bool],
) -> list[tuple | None]:  # fmt: skip
    """
    Return the kind of each view; None: nothing is in view.

    Parameters
    ----------
    scene : Scene
    group : Group
        The views.
    contents : list of (tuple or None)
        The kind of each view's objects: see `kind_of`.
    is_colored : bool
        Whether any output shows colour.
    is_lit : list of bool
        Whether any object in each view is lit.
    """
    count = len(contents)
    reached = np.zeros((count, 0), np.bool_)
    has_effects = np.zeros((count, len(VIEW_DEPENDENT_EFFECTS)), np.int8)
    if is_colored:
        reached = find_reaching_lights(scene.lights, group)
        for n, effect in enumerate(VIEW_DEPENDENT_EFFECTS):
            has_effects[:, n] = effect.decide_views(scene, group)
    return [
        None
        if objects is None
        else (objects, tuple(np.flatnonzero(lights).tolist()) if lit else (), tuple(effects))
        for objects, lights, lit, effects in zip(
            contents, reached, is_lit, has_effects.tolist(), strict=True
        )
    ]


class BatchCache:
    """
    Cached plans and command buffers of batches of one scene.

    Parameters
    ----------
    cache : SceneCache
        Of the scene, when it was last drawn.
    """

    def __init__(self, cache: SceneCache) -> None:
        self.cache = cache
        self.first: RenderPlan | None = None
        """The plan of the first view, in this batch or the last."""
        self.renderer: Any = None
        """The `Renderer` of small batches of one view."""
        self.kinds: dict[bytes, tuple[tuple | None, bool]] = {}
        """The kind of the objects in view, and whether any is lit, by the set of these objects."""
        self._plans: dict[tuple, RenderPlan] = {}
        self._free_commands: dict[tuple, list[CommandBuffer]] = {}
        """Free command buffers by kind, least recently used first."""
        self._lock = forks.lock()
        self.bytes = 0
        """Memory of all command buffers, those in use included."""

    @property
    def size(self) -> int:
        """Memory of the whole cache, about, bytes."""
        return self.bytes + (0 if self.renderer is None else self.renderer.cached_bytes)

    def find_plan(self, kind: tuple) -> RenderPlan | None:
        """Return the plan that command buffers of a kind were recorded for, if there are any."""
        return self._plans.get(kind)

    def choose_plan(self, kind: tuple, plan: RenderPlan) -> RenderPlan:
        """Return the plan to record command buffers for: the cached one, if still valid."""
        with self._lock:
            recorded = self._plans.pop(kind, None)
            if recorded is None or not is_reusable(recorded, plan):
                self._drop_commands(kind)
                recorded = plan
            self._plans[kind] = recorded
            for other in [*self._plans][:-MAX_KINDS]:
                self._drop_commands(other)
                del self._plans[other]
            return recorded

    def acquire(self, kind: tuple) -> CommandBuffer | None:
        """Return a free command buffer, for exclusive use; ``None`` if there is none."""
        with self._lock:
            free = self._free_commands.get(kind)
            return free.pop() if free else None

    def reserve(self, size: int) -> bool:
        """Reserve memory for another command buffer; return whether there is enough."""
        with self._lock:
            if self.bytes + size > MAX_COMMAND_BYTES:
                for kind in [*self._free_commands]:
                    self._drop_commands(kind)
            has_room = self.bytes + size <= MAX_COMMAND_BYTES
            self.bytes += size * has_room
            return has_room

    def release(self, kind: tuple, commands: CommandBuffer) -> None:
        """Make a command buffer available again."""
        with self._lock:
            if kind in self._plans:
                self._free_commands.setdefault(kind, []).append(commands)
            else:
                self.bytes -= commands.bytes

    def _drop_commands(self, kind: tuple) -> None:
        """Drop the free command buffers of a kind."""
        self.bytes -= sum(commands.bytes for commands in self._free_commands.pop(kind, ()))


def renew_batch_cache(batch_cache: BatchCache | None, cache: SceneCache) -> BatchCache:
    """Return a scene's batch cache, or a new one if meshes or materials have changed."""
    if (
        batch_cache is None
        or cache.shapes is not batch_cache.cache.shapes
        or cache.tables is not batch_cache.cache.tables
    ):
        return BatchCache(cache)
    batch_cache.cache = cache
    return batch_cache


def is_reusable(recorded: RenderPlan, planned: RenderPlan) -> bool:
    """Tell whether calls recorded for a plan are valid for another plan of the same kind."""
    one, other = recorded.facts, planned.facts
    return (
        recorded.size == planned.size
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
        and recorded.background.tobytes() == planned.background.tobytes()
        and _shared_lights(recorded) == _shared_lights(planned)
        and _shared_effects(recorded) == _shared_effects(planned)
    )


def _shared_effects(plan: RenderPlan) -> list[tuple[Any, int]]:
    """Return the effects, with the identity of data that all views share."""
    return [
        # What fills records reads nothing else than facts, such as lights, which are compared.
        (effect, id(data) * (effect.needs_facts_only and not effect.fills_record))
        for effect, data in ((one.effect, one.data) for one in plan.planned)
    ]


def _shared_lights(plan: RenderPlan) -> tuple[int, bytes] | None:
    """Return the properties of a plan's lights that do not depend on the camera."""
    if plan.lighting is None:
        return None
    return len(plan.lighting.lights), plan.lighting.ambient.tobytes()


class BatchCaches:
    """The batch caches of the last scenes and meshes, dropped with these."""

    def __init__(self) -> None:
        # Caches in use are not in it: a concurrent batch of the same scene gets a new one.
        self._caches: WeakKeyDictionary[Scene | Mesh, BatchCache] = WeakKeyDictionary()
        self._lock = forks.lock()

    def acquire(self, what: Any) -> BatchCache | None:
        """Take out the cache of a scene or a mesh, if any, for exclusive use."""
        if not isinstance(what, (Scene, Mesh)):
            return None
        with self._lock:
            return self._caches.pop(what, None)

    def release(self, what: Any, cache: BatchCache) -> None:
        """Put the cache of a scene or a mesh back; drop the oldest beyond `MAX_CACHED_BYTES`."""
        if not isinstance(what, (Scene, Mesh)) or cache.size > MAX_CACHED_BYTES:
            return
        with self._lock:
            caches = self._caches
            caches[what] = cache
            while len(caches) > 1 and sum(each.size for each in caches.values()) > MAX_CACHED_BYTES:
                del caches[next(iter(caches))]


BATCH_CACHES = BatchCaches()
"""The batch caches of this process."""
