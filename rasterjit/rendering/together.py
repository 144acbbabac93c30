"""
Draw views of one scene in groups, in machine code from the first view of a group to its last.

What all views have in common is planned once for each kind of plan (`Common`). Each thread has
memory of its own, in which the kernels and stages of such a plan find what they read (`Desk`); of
each view its matrices, lights and the like are prepared with NumPy for the whole group (`Prepared`)
and loaded there before it is drawn (``pipeline/views.py``).

Only plans whose stages read nothing else of a view are drawn so: opaque faces without holes, one
sample a pixel, lights without shadows, ranges and cones; see `can_share`. The others are for the
caller to draw one by one.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs import fill
from rasterjit.outputs.table import is_attribute
from rasterjit.pipeline import encode
from rasterjit.pipeline import views as drawing_views
from rasterjit.pipeline.geometry import barycentric, binning, clipping, projection, setup
from rasterjit.pipeline.lighting.blinn_phong import LIGHT_COLUMNS
from rasterjit.pipeline.records import (
    Faces,
    Lighting,
    Objects,
    Placement,
    ScreenVertices,
    Surface,
    Viewport,
)
from rasterjit.pipeline.views import BETWEEN, RATIO, SCALED
from rasterjit.pipeline.visibility import draw, nearest
from rasterjit.pipeline.visibility.tile_depths import find_tile_depths
from rasterjit.rendering import notices, shade, stage_list
from rasterjit.rendering.kept import MOST_KINDS, Kept
from rasterjit.rendering.notices import NOTHING_IN_VIEW, Told
from rasterjit.rendering.stage_list import BLOCK, Shading
from rasterjit.rendering.stream import Options
from rasterjit.rendering.views import plan_views
from rasterjit.runtime import jit
from rasterjit.runtime.driver import StageList, block_memory
from rasterjit.runtime.jit import Bound
from rasterjit.runtime.state import WORD
from rasterjit.runtime.threads import Memory
from rasterjit.scene import transforms
from rasterjit.scene.camera import (
    Camera,
    MatrixCamera,
    OrthographicCamera,
    PerspectiveCamera,
    planes_of,
    settled,
    usual_far,
    usual_near,
)
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, PointLight
from rasterjit.scene.mesh import ATTRIBUTE
from rasterjit.scene.scene import Scene
from rasterjit.scene.vectors import length
from rasterjit.survey.cache import SceneCache
from rasterjit.survey.clip_planes import CLEARANCE, look_at_planes, margins_of
from rasterjit.survey.contents import Contents
from rasterjit.survey.effect import Active, Effect
from rasterjit.survey.lights import FARTHEST_LIGHT, HEADLIGHT_DIRECTION, headlight, lighting_of
from rasterjit.survey.many_views import (
    ManyViews,
    are_between,
    boxes_around,
    place_many,
    view_many,
)
from rasterjit.survey.placement import (
    Boxes,
    Extents,
    Measures,
    Places,
    culled_turns,
    measure_boxes,
)
from rasterjit.survey.plan import RenderPlan

Float64 = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]

KNOWN_CAMERAS = (PerspectiveCamera, OrthographicCamera, MatrixCamera)
"""Those whose depth is measured in machine code; not cameras that are made of them."""

BY_KERNEL = (
    "color", "linear", "depth", "distance", "face_id", "object_id", "instance_id", "material_id",
    "barycentric", "uv", "normal", "geometric_normal", "position", "object_position",
)  # fmt: skip
"""Outputs of which NumPy does nothing view by view; attributes of vertices, too."""

COUNTED = ("triangles_in", "outside", "culled", "degenerate", "unsampled", "invalid", "drawn",
           "clipped", "pixels_covered")  # fmt: skip
"""What is counted of each view: names of ``Stats``."""

LEAST_SHARE = 1e-30
"""Near planes that are a smaller share of the farthest distance are looked at view by view: the
depth format may not hold what is far."""

MOST_CUT = 1024
"""Most faces of a view that are cut in machine code, besides one in 16."""

MOST_PROJECTIONS = 256
"""Most projection matrices that are remembered."""

MOST_SETS = 4096
"""Most sets of objects in view that are remembered."""


def shared_lights(scene: Scene) -> list[Light]:
    """Return the lights that a row in ``Lighting.lights`` is for, whatever is seen."""
    return [
        light
        for light in scene.lights
        if not isinstance(light, AmbientLight) and light.intensity != 0.0 and any(light.color)
    ]


def can_share(plan: RenderPlan, scene: Scene, cache: SceneCache) -> bool:
    """Tell whether views of a plan like this one are drawn in groups."""
    facts = plan.facts
    if facts.contents.primitives:
        return False
    if plan.layers is not None or plan.pictures != 1 or plan.reads_depth or plan.surfaces:
        return False
    if facts.needs_alpha_tests or facts.contents.see_through or facts.contents.blended:
        return False
    if not facts.finds_faces or (facts.is_colored and not facts.draws_faces):
        return False
    if not plan.depth_format.is_standard or not plan.quality.renormalize:
        return False
    if facts.background_image is not None or plan.keeps_clip_positions or plan.keeps_lists:
        return False
    for planned in plan.planned:
        effect = type(planned.effect)
        # Others prepare something for each picture, or act on what changes with the view.
        if not {"pixel", "mixed"}.issuperset(effect.places) or effect.prepare is not Effect.prepare:
            return False
    kinds = AmbientLight, DirectionalLight, PointLight
    for light in scene.lights:
        if type(light) not in kinds or getattr(light, "shadow", None) is not None:
            return False
        if getattr(light, "range", None) is not None:
            return False
    rows = [light for light in facts.lights.lights if not isinstance(light, AmbientLight)]
    if facts.is_lit and not facts.has_headlight and rows != shared_lights(scene):
        return False
    return all(name in BY_KERNEL or is_attribute(name) for name in plan.outputs) and all(
        cache.shapes.attribute(name.removeprefix(ATTRIBUTE), attribute)[1] is None
        for name, attribute in facts.attributes.items()
    )


class Projections:
    """
    The projection matrices of cameras for one size of picture; few of many cameras differ there.

    Parameters
    ----------
    size : (int, int)
        Width and height, pixels.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._known: dict[tuple, Float64] = {}

    def of(self, camera: Camera) -> Float64:
        """Return ``camera.projection_matrix(size)``, not to be changed."""
        if type(camera) is not PerspectiveCamera:
            return camera.projection_matrix(self._size)
        key = camera.fov_y, camera.near, camera.far, camera.min_aspect
        found = self._known.get(key)
        if found is None:
            found = camera.projection_matrix(self._size)
            if len(self._known) < MOST_PROJECTIONS:
                self._known[key] = found
        return found


class Prepared(NamedTuple):
    """Some views, as far as they differ."""

    fields: dict[str, NDArray[np.int64]]
    """The words of each array of a `Desk`: (N, words), or (1, words) if all views have the same."""
    kinds: list[tuple | None]
    """For each view what its plan follows from; None: it must be drawn alone."""
    cuts: dict[int, dict[str, str]]
    """Of views in which a given plane cuts something, by their place: what there is to warn of."""


class Together:
    """
    What the threads that draw views of a scene share.

    Parameters
    ----------
    scene : Scene
    kept : Kept
        What earlier batches of the scene prepared, and the plan of the first view; changed.
    options : Options
    arrays : dict
        (N, H, W, ...) of each output: where views are written.
    scene_of : callable
        Returns the scene as it is in a view, given its number.
    projections : Projections
    """

    def __init__(
        self, scene: Scene, kept: Kept, options: Options, arrays: Arrays,
        scene_of: Callable[[int], Scene], projections: Projections,
    ) -> None:  # fmt: skip
        self.scene, self.cache, self.options = scene, kept.cache, options
        self._kept, self._arrays = kept, arrays
        self._scene_of, self.projections = scene_of, projections
        self.lights = shared_lights(scene)
        self.has_headlight = not scene.lights and scene.environment is None
        self._plans: dict[tuple, RenderPlan | None] = {}
        self._lock = threading.Lock()
        boxes, places = self.cache.shapes.boxes, self.cache.places.world_from_model
        self._whole = boxes_around(boxes, places[np.newaxis])

    def take_desk(self, kind: tuple, number: int, camera: Camera) -> tuple[int, Desk] | None:
        """
        Return memory for a kind of views, of which one is given, and its size, bytes.

        None: they share too little, or there is no room.
        """
        plan = self._plan_of(kind, number, camera)
        if plan is None:
            return None
        taken = self._kept.take(kind)
        if taken is None:
            size = memory_of(plan, self.cache)
            if not self._kept.reserve(size):
                return None
            taken = size, Desk(plan, self.cache)
        taken[1].write_to(self._arrays)
        return taken

    def give_back(self, kind: tuple, size: int, desk: Desk) -> None:
        """Take back what `take_desk` returned."""
        self._kept.give_back(kind, size, desk)

    def _plan_of(self, kind: tuple, number: int, camera: Camera) -> RenderPlan | None:
        """Return the plan of a kind of views, of which one is given; None: they share none."""
        with self._lock:
            if kind not in self._plans and len(self._plans) < MOST_KINDS:
                size, quality, outputs, background, cull = self.options
                plan = self._kept.first
                if plan is None or kind_of(plan.facts.seen) != kind:
                    plan = plan_views(
                        size, quality, self._scene_of(number), camera, outputs, background, cull,
                        False, None, self.cache, self._kept.plan_of(kind),
                    ).plan  # fmt: skip
                fits = kind_of(plan.facts.seen) == kind and can_share(plan, self.scene, self.cache)
                self._plans[kind] = self._kept.use(kind, plan) if fits else None
            return self._plans.get(kind)

    def prepare(self, cameras: Sequence[Camera], places: Float64 | None) -> Prepared:
        """Prepare some views, with the places of objects, (N, O, 4, 4), if these move."""
        known, extents = self.cache.places, self.cache.extents
        if places is not None:
            known = place_many(exact_last_rows(places))
            extents = Extents(self.cache.shapes.boxes, known.world_from_model)
        else:
            known = Places(*(part[np.newaxis] for part in known))
        seen, cuts = list(cameras), {}
        view = np.array([camera.view_matrix() for camera in seen], np.float64)
        eyes = np.array([camera.eye_position() for camera in seen], np.float64)
        projection = np.array([self.projections.of(camera) for camera in seen])
        views = view_many(known.world_from_model, eyes, view, projection)
        measures = measure_boxes(extents, views.relative_from_model, views.clip_from_relative)
        # Put planes that are left open where they cut nothing in view.
        is_sure, far = self._are_between(seen, view, known, places is not None)
        moved = []
        for n in self._find_crossed(seen, ~is_sure & views.is_finite, views, measures):
            of_all = Measures(*(part[..., n, :] for part in measures))
            relative, clip = views.relative_from_model[n], views.clip_from_relative[n]
            own = self.cache.extents
            if places is not None:
                own = Extents(self.cache.shapes.boxes, known.world_from_model[n])
            boxes = Boxes(own, eyes[n], relative, clip, of_all)
            look = look_at_planes(seen[n], boxes, self.scene.nodes, clip, self.options.quality)
            if look.cut:
                cuts[n] = notices.cuts_of(look)
            if any(look.steps):
                seen[n] = settled(seen[n], *look.steps)
                projection[n] = self.projections.of(seen[n])
                moved.append(n)
        if moved:
            views = view_many(known.world_from_model, eyes, view, projection)
            measures = measure_boxes(extents, views.relative_from_model, views.clip_from_relative)
        # Decide which are drawn together.
        coefficients = np.array([camera.depth_coefficients() for camera in seen])
        near = coefficients[:, 0]
        farthest = np.where(np.isinf(far), 0.0, transforms.LEAST_NEAR * far)
        is_held = (near >= LEAST_SHARE * measures.largest_w()) & (near >= farthest)
        is_plain = views.is_finite & ((near <= 0.0) | is_held)
        kinds = [
            self._kind(in_view) if plain and type(camera) in KNOWN_CAMERAS else None
            for in_view, plain, camera in zip(measures.in_view, is_plain, seen, strict=True)
        ]
        fields = self._fields(seen, known, views, view, eyes)
        return Prepared(fields | {"coefficients": _words(coefficients)}, kinds, cuts)

    def _are_between(
        self, cameras: Sequence[Camera], view: Float64, places: Places, are_moved: bool
    ) -> tuple[NDArray[np.bool_], Float64]:
        """Tell of which cameras, (N,), no plane surely cuts anything, and where far planes are."""
        near, far = np.full(len(cameras), -np.inf), np.full(len(cameras), np.inf)
        for n, camera in enumerate(cameras):
            planes = planes_of(camera)
            if planes is None or planes.near_steps is not None or planes.far_steps is not None:
                continue
            near[n] = planes.near / (1.0 - CLEARANCE) if planes.is_near_open else planes.near
            far[n] = planes.far * (1.0 - CLEARANCE) if planes.is_far_open else planes.far
        own = far.copy()
        near[near <= 0.0] = -np.inf
        low, high = (
            boxes_around(self.cache.shapes.boxes, places.world_from_model)
            if are_moved
            else self._whole
        )
        return are_between(low, high, view, near, far), own

    def _find_crossed(
        self, cameras: Sequence[Camera], is_asked: NDArray[np.bool_], views: ManyViews,
        measures: Measures,
    ) -> list[int]:  # fmt: skip
        """Return the views, of those asked for, where an object may reach over a plane."""
        asked = [
            (n, margins.inside)
            for n in np.flatnonzero(is_asked).tolist()
            if (margins := margins_of(cameras[n], views.clip_from_relative[n])) is not None
        ]
        if not asked:
            return []
        numbers = [n for n, _ in asked]
        near, far = np.array([inside for _, inside in asked]).T[..., np.newaxis]
        some = Measures(*(part[..., numbers, :] for part in measures))
        crossed = some.may_cross(near, far).any(axis=1)
        return [n for n, is_crossed in zip(numbers, crossed, strict=True) if is_crossed]

    def _kind(self, in_view: NDArray[np.bool_]) -> tuple | None:
        """Return what the plan of a view follows from, given which objects are in view."""
        key, kinds = in_view.tobytes(), self._kept.kinds
        if key in kinds:
            return kinds[key]
        contents = self.cache.tables.inventory.contents_of(in_view)
        kind = kind_of(contents) if contents.objects else None
        if len(kinds) < MOST_SETS:
            kinds[key] = kind
        return kind

    def _fields(
        self, cameras: Sequence[Camera], places: Places, views: ManyViews, view: Float64,
        eyes: Float64,
    ) -> dict[str, NDArray[np.int64]]:  # fmt: skip
        """Return the words of all arrays of a desk."""
        cache, quality = self.cache, self.options.quality
        kind = cache.shapes.positions(quality.precision).dtype
        turn = views.screen_turn[:, np.newaxis]
        single = cache.tables.is_single_sided
        front_turns = -turn * places.mirrored
        culled = culled_turns(self.options.cull, turn, places.mirrored, single)
        relative, clip = views.relative_from_model, views.clip_from_relative
        with np.errstate(over="ignore"):
            fields = {
                "relative_from_model": relative.astype(kind, copy=False),
                "clip_from_relative": clip.astype(kind, copy=False),
                "relative_rows": relative[:, :, :3],
                "world_rows": places.world_from_model[:, :, :3],
                "normal_matrices": places.normal_matrices,
                "mirrored": places.mirrored,
                "front_turns": front_turns,
                "culled_turns": culled,
                "toward_viewer": views.toward_viewer,
                "viewer": views.toward_viewer.astype(np.float32),
            }
        if "depth" in self.options.outputs:
            ways = [depth_way(camera) for camera in cameras]
            fields["depth_way"] = np.array([[way] for way, *_ in ways], np.int64)
            fields["depth_factors"] = np.array([factors for _, *factors in ways])
        if "distance" in self.options.outputs:
            axis = view[:, 2, :3]
            x, y, z = axis.T
            sizes = np.sqrt((x * x + y * y) + z * z)
            fields["distance_axis"] = np.concatenate((axis, sizes[:, np.newaxis]), axis=1)
            fields["is_parallel"] = (views.toward_viewer[:, 3:] == 0.0).astype(np.int64)
        if self.has_headlight:
            fields["light_rows"] = headlight_rows(cameras[0], view)
        else:
            fields["light_rows"] = light_rows(self.lights, cameras[0], eyes)
        return {name: _words(values) for name, values in fields.items()}


def exact_last_rows(places: Float64) -> Float64:
    """Return a copy of affine matrices with exact last rows, as those of nodes are."""
    places = places.copy()
    places[..., 3, :] = 0.0, 0.0, 0.0, 1.0
    return places


def kind_of(contents: Contents) -> tuple:
    """Return what a plan follows from: not how many objects are what, but whether any is."""
    return tuple(
        tuple(count > 0 for count in part.values()) if isinstance(part, dict) else part > 0
        for part in contents
    )


def memory_of(plan: RenderPlan, cache: SceneCache) -> int:
    """Return how much memory a desk takes, about, bytes."""
    arrays, (width, height) = cache.shapes.arrays, plan.size
    _, new_vertices = room_to_cut(len(arrays.faces))
    of_face, of_vertex, of_new, of_pixel = 24, 32 + 48 + 32, 32 + 32 + 48, 64
    return (
        of_face * len(arrays.faces) + of_vertex * len(arrays.positions) + of_new * new_vertices
        + of_pixel * width * height
    )  # fmt: skip


def room_to_cut(faces: int) -> tuple[int, int]:
    """Return for how many faces that are cut, of so many, and new vertices a desk has room."""
    cuts = min(faces, MOST_CUT + faces // 16)
    # Mostly one plane cuts a face, and leaves three or four vertices.
    return cuts, min(clipping.MOST_VERTICES * cuts, 5 * cuts + draw.SPARE_VERTICES)


def depth_way(camera: Any) -> tuple[int, float, float, float]:
    """Return how a stored depth becomes metric, as `measure_depths` takes it."""
    if isinstance(camera, PerspectiveCamera):
        return RATIO, usual_near(camera.near, camera.far), 1.0, 0.0
    if isinstance(camera, OrthographicCamera):
        return BETWEEN, camera.near, usual_far(camera.far, camera.near), 0.0
    z_row, w_row = camera.clip_from_view[2:].tolist()
    if any(w_row[:3]):
        return RATIO, camera.depth_coefficients()[0], length(w_row[:3]), 0.0
    return SCALED, w_row[3], z_row[3], length(z_row[:3])


def light_rows(lights: Sequence[Light], camera: Camera, eyes: Float64) -> NDArray[np.float32]:
    """Return the lights of each view, (N, L, 13), relative to its eye: `lights.lighting_of`."""
    rows = np.repeat(lighting_of(lights, camera, 0).lights[np.newaxis], len(eyes), axis=0)
    for n, light in enumerate(lights):
        if isinstance(light, PointLight):
            place = np.array(light.position) - eyes
            rows[:, n, :3] = np.clip(place, -FARTHEST_LIGHT, FARTHEST_LIGHT)
    return rows


def headlight_rows(camera: Camera, view_from_world: Float64) -> NDArray[np.float32]:
    """Return the light of each view of a scene that has none, (N, 1, 13): `lights.headlight`."""
    rows = np.repeat(
        lighting_of(headlight(camera), camera, 0).lights[np.newaxis], len(view_from_world), axis=0
    )
    matrices = transforms.normal_matrices(view_from_world)
    x, y, z = HEADLIGHT_DIRECTION
    along = (matrices[:, 0] * x + matrices[:, 1] * y) + matrices[:, 2] * z
    along /= np.abs(along).max(axis=1, keepdims=True)
    a, b, c = along.T
    rows[:, 0, :3] = -(along / np.sqrt((a * a + b * b) + c * c)[:, np.newaxis])
    return rows


def _words(values: NDArray[Any]) -> NDArray[np.int64]:
    """Return an array of each view as whole words, (N, words)."""
    flat = np.ascontiguousarray(values).reshape(len(values), -1)
    size = flat.shape[1] * flat.itemsize
    if size % WORD == 0 and size:
        return flat.view(np.int64)
    words = np.zeros((len(values), -(-size // WORD)), np.int64)
    words.view(np.uint8)[:, :size] = flat.view(np.uint8) if size else 0
    return words


class Desk:
    """
    The memory in which one thread draws views of one kind of plan.

    Parameters
    ----------
    plan : RenderPlan
        Of one of them.
    cache : SceneCache
    """

    def __init__(self, plan: RenderPlan, cache: SceneCache) -> None:
        self._plan, self._cache, self._kept = plan, cache, []
        self._places: list[tuple[str, int]] = []
        self._targets: list[tuple[str, int, int]] = []
        self._find()
        self._calls: list[tuple[int, int, int, int]] = []
        if plan.facts.is_colored:
            self._shade()
        self._fill()
        self._table = np.array(self._calls, np.int64).reshape(-1, 4)

    def write_to(self, outputs: Arrays) -> None:
        """Let what is drawn from now on be written to arrays of all views, (N, H, W, ...)."""
        for name, place in self._places:
            ctypes.c_int64.from_address(place).value = outputs[name].ctypes.data

    def draw(
        self, prepared: Prepared, chosen: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """
        Draw some of the prepared views.

        Parameters
        ----------
        prepared : Prepared
        chosen : (n, 2) int64
            Which of them, and the number of each among all views.

        Returns
        -------
        totals : (n, 7) int64
            As ``pipeline/views.py`` counts.
        is_drawn : (n,) bool
            False for those that must be drawn alone.
        """
        loads = []
        for name, target, size in self._targets:
            words = prepared.fields[name]
            if words.shape[1] != size:
                raise RuntimeError(f"{name} of a view must have {size} words, got {words.shape[1]}")
            step = words.strides[0] if len(words) > 1 else 0
            loads.append((words.ctypes.data, step, target, size))
        totals = np.zeros((len(chosen), drawing_views.TOTALS), np.int64)
        is_drawn = np.zeros(len(chosen), np.uint8)
        drawing_views.draw_views(
            chosen, np.array(loads, np.int64), self._finding, self._cutting,
            self._lengths, self._listing, self._tile_depths, self._face_id, self._table, totals,
            is_drawn,
        )  # fmt: skip
        return totals, is_drawn.astype(np.bool_)

    def _field(self, name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return an array that is loaded for each view."""
        kind, count = np.dtype(dtype), int(np.prod(shape))
        words = -(-count * kind.itemsize // WORD)
        room = np.zeros(max(words, 1), np.int64)
        self._targets.append((name, room.ctypes.data, words))
        self._kept.append(room)
        return room.view(kind)[:count].reshape(shape)

    def _bound(self, kernel: Any, *arguments: Any) -> Bound:
        """Return a kernel with its arguments, kept as long as the desk."""
        bound = Bound(kernel, *arguments)
        self._kept.append(bound)
        return bound

    def _find(self) -> None:
        """Bind what finds the faces."""
        plan, cache = self._plan, self._cache
        arrays = cache.shapes.arrays
        positions = cache.shapes.positions(plan.quality.precision)
        kind, count, objects = positions.dtype, len(positions), len(arrays.face_starts) - 1
        viewport = draw.viewport_of(plan.size, plan.quality.subpixel_bits)
        _, room = room_to_cut(len(arrays.faces))
        screen = draw.screen_arrays(count + room, Memory())
        clip_positions = np.empty((count, 4), np.float64)
        faces = Faces(arrays.faces, np.empty((room, 3), np.int32), np.empty(room, np.int32))
        relative = self._field("relative_from_model", (objects, 4, 4), kind)
        clip = self._field("clip_from_relative", (4, 4), kind)
        owned, scratch = (arrays.vertex_starts, relative), projection.scratch_memory(kind)
        transformed = self._bound(
            projection.transform_vertices, (0, count), positions, owned, clip, (0.0, 0.0, 0.0),
            viewport, screen, scratch,
        )  # fmt: skip
        placed = self._bound(
            projection.transform_positions, (0, count), positions, owned, clip, clip_positions,
            scratch,
        )  # fmt: skip
        self._targets.append(("coefficients", transformed.place_of(4), 3))
        clipped, *cut = self._cut(faces, clip_positions, screen, viewport, room)
        listed = self._list_and_draw(faces, screen, viewport)
        finding = transformed, clipped, placed, *cut, *listed
        self._finding = np.array([one.words for one in finding], np.int64)
        self._geometry = draw.geometry_of(
            arrays.faces, screen, clip_positions, viewport, plan.is_affine
        )
        self._placement = Placement(
            arrays.face_starts,
            arrays.positions,
            self._field("relative_rows", (objects, 3, 4), np.float64),
            self._field("normal_matrices", (objects, 3, 3), np.float64),
            self._field("mirrored", (objects,), np.float64),
            self._field("front_turns", (objects,), np.float64),
            self._field("toward_viewer", (4,), np.float64),
        )

    def _cut(
        self, faces: Faces, clip_positions: Float64, screen: ScreenVertices, viewport: Viewport,
        room: int,
    ) -> tuple[Bound, ...]:  # fmt: skip
        """
        Bind what cuts faces at planes.

        Parameters
        ----------
        faces : Faces
            With memory for the pieces.
        clip_positions : (V, 4) float64
            Of the vertices, when any are cut.
        screen : ScreenVertices
            With memory for new vertices.
        viewport : Viewport
        room : int
            How many new vertices there is memory for.
        """
        whole, count = faces[0], len(clip_positions)
        cuts, _ = room_to_cut(len(whole))
        cut, new_positions = np.empty(cuts, np.int32), np.empty((room, 4), np.float64)
        vertex_counts, starts = np.empty(cuts, np.int64), np.empty((2, cuts + 1), np.int64)
        polygons = np.empty((2, clipping.MOST_VERTICES, 4), np.float64)
        clipped = self._bound(clipping.find_clipped_faces, whole, screen.codes[:count], cut)
        counted = self._bound(
            clipping.count_clipped_vertices, cut, whole, clip_positions, viewport,
            vertex_counts, polygons,
        )  # fmt: skip
        in_pieces = self._bound(
            clipping.clip_faces, cut, whole, clip_positions, viewport,
            (starts[0], starts[1]), (new_positions, *faces[1:]), polygons,
        )  # fmt: skip
        projected = self._bound(
            projection.project_clipped_vertices, (cut, whole, starts[0], clip_positions),
            new_positions, (0.0, 0.0, 0.0), viewport, count, screen,
        )  # fmt: skip
        self._targets.append(("coefficients", projected.place_of(2), 3))
        # How many faces are cut is the length of their list.
        told = [one.place_of(0) + WORD for one in (counted, in_pieces, projected)]
        self._cutting = vertex_counts, starts[0], starts[1], np.array(told, np.int64), room
        self._kept += [cut, polygons]
        return clipped, counted, in_pieces, projected

    def _list_and_draw(
        self, faces: Faces, screen: ScreenVertices, viewport: Viewport
    ) -> tuple[Bound, ...]:
        """Bind what lists the faces of each tile, and what draws them there; see `_cut`."""
        arrays, (width, height) = self._cache.shapes.arrays, self._plan.size
        objects, number = len(arrays.face_starts) - 1, len(faces[0]) + len(faces[1])
        turns = self._field("culled_turns", (objects,), np.int8)
        columns = -(-width // setup.TILE_SIZE)
        tiles = columns * -(-height // setup.TILE_SIZE)
        listed = min(tiles * number, 4 * number + 65536)
        triangles, boxes = np.empty(number, np.int32), np.empty((number, 4), np.uint8)
        counts, sums = np.zeros((1, tiles + 1), np.int32), np.zeros(5, np.int64)
        set_up = self._bound(
            setup.set_up_triangles, (0, len(arrays.faces)), (0, 0), faces,
            Objects(arrays.face_starts, turns),
            screen, viewport, (triangles, boxes), (columns, counts[0], sums),
            np.empty(setup.BATCH_SHAPE, np.int32), setup.ANY_CODE,
        )  # fmt: skip
        list_starts, cursors = np.empty(tiles + 1, np.int64), np.empty((1, tiles), np.int64)
        started = self._bound(binning.start_lists, counts, list_starts, cursors)
        binned = np.empty(listed, np.int32)
        sorted_in = self._bound(
            binning.bin_triangles, triangles, boxes, columns, faces, screen, viewport, cursors[0],
            binned,
        )  # fmt: skip
        self._tile_depths = np.empty(tiles, np.float32)
        no_holes = np.empty(0, np.int64), np.empty(0, np.float32)
        raised = self._bound(
            find_tile_depths, triangles, boxes, columns, faces, screen, viewport,
            self._tile_depths, no_holes,
        )  # fmt: skip
        # Tiles.
        self._depth = np.empty((height, width * self._plan.needs_depth), np.float32)
        self._face_id = np.empty((height, width), np.int32)
        drawer = nearest.tile_drawer(binned, faces, screen, np.float32)
        self._kept.append(drawer)
        drawn = self._bound(
            nearest.draw_tiles, np.arange(tiles, dtype=np.int32), nearest.ALL, list_starts,
            self._tile_depths, viewport, (self._depth, self._face_id), *drawer[:3],
        )  # fmt: skip
        # How many triangles were listed is the length of both of their arrays.
        self._lengths = np.array(
            [one.place_of(k) + WORD for one in (sorted_in, raised) for k in (0, 1)], np.int64
        )
        self._listing = counts, sums, list_starts, listed, set_up.place_of(1) + WORD
        return set_up, started, sorted_in, raised, drawn

    def _shade(self) -> None:
        """Add the stages that make the colours."""
        plan, cache, (width, height) = self._plan, self._cache, self._plan.size
        viewer = self._field("viewer", (4,), np.float32)
        lighting = plan.lighting
        if lighting is not None:
            count = len(lighting.lights)
            lights = self._field("light_rows", (count, LIGHT_COLUMNS), np.float32)
            lighting = lighting._replace(lights=lights)
        effects = tuple(Active(one.effect, one.data) for one in plan.planned if one.effect.places)
        placement = shade.placement_to_light(plan, self._placement)
        block = block_memory(BLOCK)

        def light(surface: Surface, lighting: Lighting) -> NDArray[np.float32]:
            count = len(placement.positions)
            lit = np.zeros((count, 2, 3), np.float32)
            listed = (0, count), cache.shapes.arrays.vertex_starts
            self._run(
                StageList(
                    stage_list.vertex_steps(
                        listed, placement, surface, lighting, effects, lit, viewer
                    )
                ),
                block,
            )
            return lit

        surface = shade.light_surface(plan, shade.find_surface(plan, cache.tables), lighting, light)
        shading = Shading(
            self._geometry, placement, surface, lighting, effects, encode.encoding_table(),
            plan.background, viewer,
        )  # fmt: skip
        linear = np.empty((height, width * ("linear" in plan.outputs), 4), np.float32)
        color = np.empty((height, width * ("color" in plan.outputs)), np.uint32)
        self._kept.append(shading)
        self._run(shading.listed(self._face_id, 0, height, None, linear, color), block)
        for name, picture in (("linear", linear), ("color", color)):
            if name in plan.outputs:
                self._keep(name, picture)

    def _fill(self) -> None:
        """Add the kernels that make the other outputs."""
        plan, shapes, (width, height) = self._plan, self._cache.shapes, self._plan.size
        geometry, placement = self._geometry, self._placement
        count, of_all = len(shapes.meshes), (self._face_id, (0, height), geometry)

        def made(name: str, channels: int, kernel: Any, *arguments: Any) -> NDArray[np.float32]:
            """Add a kernel that fills a picture, which is kept if it is an output."""
            picture = np.empty((height, width, channels), np.float32)
            self._call(self._bound(kernel, *of_all, *arguments, picture))
            if name in plan.outputs:
                self._keep(name, picture)
            return picture

        if "face_id" in plan.outputs:
            self._keep("face_id", self._face_id)
        if "depth" in plan.outputs:
            self._write(
                "depth", drawing_views.measure_depths, self._field("depth_way", (1,), np.int64),
                self._field("depth_factors", (3,), np.float64), self._depth, self._face_id,
                np.empty((0, height, width), np.float32),
            )  # fmt: skip
        for name in ("object_id", "instance_id", "material_id"):
            if name in plan.outputs:
                numbers = shapes.object_numbers
                if name != "object_id":
                    of_objects = (
                        shapes.instance_numbers
                        if name == "instance_id"
                        else fill.material_numbers(shapes)
                    )
                    numbers = of_objects[numbers]
                self._write(
                    name, drawing_views.keep_numbers, self._face_id, numbers,
                    np.empty((0, height, width), np.int32),
                )  # fmt: skip
        if "barycentric" in plan.outputs:
            made("barycentric", 3, barycentric.fill_barycentric)
        if "uv" in plan.outputs:
            made("uv", 2, barycentric.fill_attribute, shapes.uv)
        for name, attribute in plan.facts.attributes.items():
            values, _ = shapes.attribute(name.removeprefix(ATTRIBUTE), attribute)
            made(name, attribute.columns, barycentric.fill_attribute, values)
        positions = barycentric.fill_positions
        if "position" in plan.outputs:
            world = self._field("world_rows", (count, 3, 4), np.float64)
            made("position", 3, positions, placement, world)
        if "object_position" in plan.outputs:
            own = np.tile(np.eye(3, 4), (count, 1, 1))
            made("object_position", 3, positions, placement, own)
        if "distance" in plan.outputs:
            relative = made("", 3, positions, placement, placement.relative_from_model)
            self._write(
                "distance", drawing_views.measure_distances,
                self._field("is_parallel", (1,), np.int64),
                self._field("distance_axis", (4,), np.float64), relative,
                np.empty((0, height, width), np.float32),
            )  # fmt: skip
        flat = np.zeros((1, 3), np.float32), np.zeros(count, np.uint8)
        if "normal" in plan.outputs:
            smooth = shapes.normals, np.ones(count, np.uint8)
            given = smooth if plan.facts.shows_normals else flat
            made("normal", 3, barycentric.fill_normals, placement, given)
        if "geometric_normal" in plan.outputs:
            made("geometric_normal", 3, barycentric.fill_normals, placement, flat)

    def _call(self, bound: Bound, number: int = 0) -> None:
        """Call a kernel, and tell it the view's number at an address."""
        address, state = bound.words.tolist()
        self._calls.append((address, state, 0, number))

    def _write(self, name: str, kernel: Any, *arguments: Any) -> None:
        """Call a kernel that takes the view's number first, and last where all views are."""
        bound = self._bound(kernel, 0, *arguments)
        self._call(bound, bound.place_of(0))
        self._places.append((name, bound.place_of(len(arguments))))

    def _keep(self, name: str, picture: NDArray[Any]) -> None:
        """Copy a picture to its place among those of all views."""
        words = picture.reshape(-1).view(np.uint32)
        self._write(name, drawing_views.keep_picture, words, np.empty((0, len(words)), np.uint32))

    def _run(self, stages: StageList, block: NDArray[np.int64]) -> None:
        """Run stages over an empty block."""
        bound = stages.bound(block)
        self._kept.append(bound)
        self._calls.append((*bound.words, 0))


class Outcome(NamedTuple):
    """What became of some views."""

    counts: NDArray[np.int64]
    """(N, 9): ``COUNTED`` of each; anything of those that were not drawn."""
    is_drawn: NDArray[np.bool_]
    """(N,): False for those that must be drawn alone."""
    told: Told
    """What there is to warn of of those that were drawn."""


def counts_of(totals: NDArray[np.int64], faces: int) -> NDArray[np.int64]:
    """Return ``COUNTED`` of views, (N, 9), given what `Desk.draw` counted; each has all faces."""
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


class Drawer:
    """
    Draws groups of views in one thread.

    Parameters
    ----------
    shared : Together
    """

    def __init__(self, shared: Together) -> None:
        self._shared = shared
        self._desks: dict[tuple, tuple[int, Desk]] = {}

    def close(self) -> None:
        """Give back what it drew in."""
        for kind, taken in self._desks.items():
            self._shared.give_back(kind, *taken)
        self._desks.clear()

    def draw(self, numbers: range, cameras: Sequence[Camera], places: Float64 | None) -> Outcome:
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
        prepared = self._shared.prepare(cameras, places)
        counts, told = np.zeros((len(numbers), len(COUNTED)), np.int64), Told()
        is_drawn = np.zeros(len(numbers), np.bool_)
        of_kinds: dict[tuple | None, list[int]] = {}
        for n, kind in enumerate(prepared.kinds):
            of_kinds.setdefault(kind, []).append(n)
        for kind, chosen in of_kinds.items():
            desk = (
                None if kind is None else self._desk(kind, numbers[chosen[0]], cameras[chosen[0]])
            )
            if desk is None:
                continue
            pairs = np.array([(n, numbers[n]) for n in chosen], np.int64)
            totals, is_drawn[chosen] = desk.draw(prepared, pairs)
            counts[chosen] = counts_of(totals, self._faces)
        # Note what there is to warn of.
        is_empty = counts[:, COUNTED.index("drawn")] == 0
        for n in np.flatnonzero(is_drawn & is_empty).tolist():
            if n not in prepared.cuts:
                told.add(numbers[n], {"view": NOTHING_IN_VIEW})
        for n in np.flatnonzero(is_drawn).tolist() if prepared.cuts else ():
            told.add(numbers[n], prepared.cuts.get(n, {}))
        return Outcome(counts, is_drawn, told)

    @property
    def _faces(self) -> int:
        return len(self._shared.cache.shapes.arrays.faces)

    def _desk(self, kind: tuple, number: int, camera: Camera) -> Desk | None:
        """Return the memory for a kind of views, of which one is given; None: there is none."""
        if kind not in self._desks:
            taken = self._shared.take_desk(kind, number, camera)
            if taken is None:
                return None
            self._desks[kind] = taken
        return self._desks[kind][1]


def is_possible(options: Options) -> bool:
    """Tell whether there may be anything to draw in groups; not where kernels run in Python."""
    return not (jit.DISABLED or jit.CHECKED) and all(
        name in BY_KERNEL or is_attribute(name) for name in options.outputs
    )
