"""
Record all calls of a frame once (a command buffer), to replay them for views of the same kind.

Each kernel and stage is bound to fixed memory. For each view its arrays are copied there
(`CommandBuffer.draw`), then all are called by address (``pipeline/batch_driver.py``).
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs import ground_truth
from rasterjit.outputs.output_table import find_array_spec
from rasterjit.pipeline import batch_driver, srgb_encoding
from rasterjit.pipeline.fragments import a_buffer, fragment_bands
from rasterjit.pipeline.geometry import binning, clipping, projection, setup
from rasterjit.pipeline.geometry.setup import TILE_SIZE
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
from rasterjit.pipeline.visibility import tile_rasterizer, visibility_pass
from rasterjit.pipeline.visibility.hierarchical_z import find_tile_depths
from rasterjit.pipeline.visibility.visibility_pass import RasterizedView
from rasterjit.rendering import frame_shading, resolve_layers, view_warnings
from rasterjit.rendering.pass_runner import (
    RecordedCalls,
    RecordingWorkers,
    empty_color,
    list_vertex_steps,
)
from rasterjit.rendering.resolve_layers import ColorRows, LateToneMapping, Shader
from rasterjit.runtime.jit import Bound
from rasterjit.runtime.stage_runner import StageList
from rasterjit.runtime.state_block import WORD
from rasterjit.runtime.threads import Memory, ReusedMemory, Workers, split_range
from rasterjit.scene.camera import Camera
from rasterjit.survey.batched_views import BatchTransforms
from rasterjit.survey.cache import SceneCache
from rasterjit.survey.effect import (
    ActiveEffect,
    BatchedEffect,
    FrameContext,
    ScreenEffect,
    select_acting,
)
from rasterjit.survey.facts import Facts
from rasterjit.survey.object_transforms import (
    ObjectTransforms,
    ViewTransforms,
    find_culled_windings,
)
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.transparency import PixelLayers

Float64 = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]

LIGHT_ROWS = "light_rows"
"""Name of the field with the rows of all lights; a buffer loads those that reach its views."""

MAX_CUT = 1024
"""Capacity for clipped faces of a view, in addition to one in 16 of all."""

MAX_LAYERS = 8
"""Capacity for transparent layers of a pixel."""

FIRST_VIEW, NO_LOADS = np.zeros((1, 2), np.int64), np.zeros((0, 4), np.int64)


def estimate_bytes(plan: RenderPlan, cache: SceneCache) -> int:
    """Estimate the memory of a command buffer, bytes."""
    arrays, (width, height) = cache.shapes.arrays, plan.size
    _, new_vertices = clip_capacity(len(arrays.faces))
    per_face, per_vertex, per_new, per_pixel = 24, 32 + 48 + 32, 32 + 32 + 48, 64
    per_column = of_effects = 0
    if plan.layers is not None and plan.layers.has_blended:
        per_column = (8 * MAX_LAYERS + 4) * TILE_SIZE + 4 * 16 * resolve_layers.MAX_LAYERED_ROWS
    elif plan.layers is not None:
        per_sample = 4 * TILE_SIZE + 8 * resolve_layers.MAX_OPAQUE_ROWS
        per_column = int(plan.layers.samples) * per_sample + 52 * resolve_layers.MAX_OPAQUE_ROWS
    for planned in plan.planned:
        for _, channels, kind, (columns, rows) in planned.effect.buffers(plan):
            of_effects += channels * np.dtype(kind).itemsize * columns * rows
    return of_effects + (
        per_face * len(arrays.faces) + per_vertex * len(arrays.positions) + per_new * new_vertices
        + per_pixel * width * height + per_column * width
    )  # fmt: skip


def clip_capacity(faces: int) -> tuple[int, int]:
    """Return the capacity for clipped faces and for their new vertices."""
    cuts = min(faces, MAX_CUT + faces // 16)
    # A face clipped by one plane, as most are, has three or four vertices.
    return cuts, min(clipping.MAX_VERTICES * cuts, 5 * cuts + visibility_pass.SPARE_VERTICES)


def pack_words(values: NDArray[Any]) -> NDArray[np.int64]:
    """Pack the values of each view into 64-bit words, (N, words)."""
    flat = np.ascontiguousarray(values).reshape(len(values), -1)
    size = flat.shape[1] * flat.itemsize
    if size % WORD == 0 and size:
        return flat.view(np.int64)
    words = np.zeros((len(values), -(-size // WORD)), np.int64)
    words.view(np.uint8)[:, :size] = flat.view(np.uint8) if size else 0
    return words


def make_view_fields(
    views: ViewTransforms | BatchTransforms,
    object_matrices: ViewTransforms | ObjectTransforms,
    world_from_model: Float64,
    winding: Any,
    cull: str,
    is_single_sided: NDArray[np.bool_],
    axis: Float64,
) -> dict[str, NDArray[Any]]:
    """
    Return the arrays that a command buffer loads, of one view or of many: (N, ...) or (1, ...).

    Those of lights, effects and depth are missing. ``winding`` is ``screen_winding``, (N, 1) of
    many views; ``axis`` points from the scene to the camera, (..., 3).
    """
    relative = views.relative_from_model
    distance_axis = np.empty((*axis.shape[:-1], 4))
    distance_axis[..., :3] = axis
    x, y, z = axis[..., 0], axis[..., 1], axis[..., 2]
    distance_axis[..., 3] = np.sqrt((x * x + y * y) + z * z)
    return {
        "relative_from_model": relative,
        "clip_from_relative": views.clip_from_relative,
        "relative_rows": relative[..., :3, :],
        "world_rows": world_from_model[..., :3, :],
        "normal_matrices": object_matrices.normal_matrices,
        "mirrored": object_matrices.mirrored,
        "front_windings": -winding * object_matrices.mirrored,
        "culled_windings": find_culled_windings(
            cull, winding, object_matrices.mirrored, is_single_sided
        ),
        "toward_viewer": views.toward_viewer,
        "viewer": views.toward_viewer,
        "distance_axis": distance_axis,
        "is_parallel": views.toward_viewer[..., 3:] == 0.0,
    }


class ViewContents(NamedTuple):
    """What steps in Python know of a view."""

    camera: Camera
    """With near and far planes chosen."""
    in_view: NDArray[np.bool_]
    """(O,): which objects may be seen."""


class TileBins(NamedTuple):
    """Input and output arrays of binning."""

    faces: Faces
    screen: ScreenVertices
    objects: Objects
    triangles: NDArray[np.int32]
    """(T,)."""
    boxes: NDArray[np.uint8]
    """(T, 4)."""
    columns: int
    """Columns of tiles."""
    counts: NDArray[np.int32]
    """(1, tiles + 1)."""
    starts: NDArray[np.int64]
    """(tiles + 1,)."""
    binned: NDArray[np.int32]
    """(M,)."""


class CommandBuffer:
    """
    A frame's recorded calls with their memory: draws views of one kind of plan, in one thread.

    Parameters
    ----------
    plan : RenderPlan
        Of one of these views.
    cache : SceneCache
    lights : sequence of int
        Which rows of lights to load.
    """

    def __init__(self, plan: RenderPlan, cache: SceneCache, lights: Sequence[int]) -> None:
        self._plan, self._cache, self._calls = plan, cache, RecordedCalls()
        self.bytes = estimate_bytes(plan, cache)
        """Memory, about."""
        self._lights = list(lights)
        if plan.layers is not None:
            # Include objects that only other views show.
            is_blended = cache.tables.inventory.is_see_through.astype(np.uint8)
            plan = plan.for_picture(layers=plan.layers._replace(is_blended=is_blended))
            self._plan = plan
        self._output_addresses: list[tuple[str, int]] = []
        self._white_counts = np.zeros(2, np.int64)
        self._loaded_arrays: list[tuple[str, NDArray[Any], int, int]] = []
        self._steps: list[tuple[int, Callable[[ViewContents], bool]]] = []
        self._record_visibility()
        if plan.facts.is_colored:
            self._record_shading()
        self._record_outputs()
        table, self._limits = self._calls.table(), self._calls.limits()
        self._tables = np.split(table, [first for first, _ in self._steps])

    @property
    def facts(self) -> Facts:
        """The facts of the plan."""
        return self._plan.facts

    def write_to(self, outputs: Arrays) -> None:
        """Direct the outputs of the next views to batched arrays, (N, H, W, ...)."""
        for name, address in self._output_addresses:
            ctypes.c_int64.from_address(address).value = outputs[name].ctypes.data

    def draw(
        self, fields: Mapping[str, NDArray[np.int64]], lights: NDArray[np.float32],
        chosen: NDArray[np.int64], contents: Sequence[ViewContents],
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:  # fmt: skip
        """
        Draw some of the prepared views.

        Parameters
        ----------
        fields : dict of int64 arrays
            The words of each array, (N, words), or (1, words) if equal in all views.
        lights : (N, L, 13) float32
            The rows of all lights.
        chosen : (n, 2) int64
            The index of each view in ``fields``, and its number in the batch.
        contents : sequence of ViewContents
            Of each of the n views.

        Returns
        -------
        totals : (n, 9) int64
            As ``pipeline/batch_driver.py`` counts.
        is_drawn : (n,) bool
            False for those that must be drawn alone.
        """
        fields = {**fields, LIGHT_ROWS: pack_words(lights[:, self._lights])}
        loads = []
        for name, _, target, size in self._loaded_arrays:
            words = fields[name]
            if words.shape[1] != size:
                raise RuntimeError(f"{name} of a view must have {size} words, got {words.shape[1]}")
            step = words.strides[0] if len(words) > 1 else 0
            loads.append((words.ctypes.data, step, target, size))
        return self._draw(chosen, np.array(loads, np.int64), contents)

    def draw_one(
        self, values: Mapping[str, Any], contents: ViewContents
    ) -> NDArray[np.int64] | None:
        """Draw a view of given arrays; return its totals, (9,), None if it must be drawn alone."""
        # Some arrays are loaded as float32.
        with np.errstate(over="ignore"):
            for name, memory, _, _ in self._loaded_arrays:
                memory[...] = values[name]
        totals, is_drawn = self._draw(FIRST_VIEW, NO_LOADS, [contents])
        return totals[0] if is_drawn[0] else None

    def _draw(
        self, chosen: NDArray[np.int64], loads: NDArray[np.int64],
        contents: Sequence[ViewContents],
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:  # fmt: skip
        """Draw views, given the copies to make for each; return what `draw` does."""
        totals = np.zeros((len(chosen), batch_driver.TOTAL_COUNT), np.int64)
        is_drawn = np.zeros(len(chosen), np.uint8)
        # With steps in Python between the calls, draw view by view.
        count = 1 if self._steps else len(chosen)
        for n in range(0, len(chosen), count):
            part = slice(n, n + count)
            batch_driver.draw_views(
                chosen[part], loads, self._visibility_calls, self._clipping, self._binning,
                self._sample_binning, self._tile_depths, self._face_id, self._tables[0],
                self._limits[:0] if self._steps else self._limits, self._white_counts,
                totals[part], is_drawn[part],
            )  # fmt: skip
            if self._steps and is_drawn[n]:
                is_drawn[n] = self._finish_view(int(chosen[n, 1]), contents[n])
                totals[n, batch_driver.LIT_PIXELS :] = self._white_counts * is_drawn[n]
        return totals, is_drawn.astype(np.bool_)

    def _finish_view(self, number: int, contents: ViewContents) -> bool:
        """Make the steps in Python, and the calls behind each; return whether all is drawn."""
        for (_, step), table in zip(self._steps, self._tables[1:], strict=True):
            if not step(contents):
                return False
            limits = self._limits if table is self._tables[-1] else self._limits[:0]
            if not batch_driver.finish_view(number, table, limits):
                return False
        return True

    def _loaded_array(self, name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Allocate an array that is loaded for each view."""
        kind, count = np.dtype(dtype), int(np.prod(shape))
        words = -(-count * kind.itemsize // WORD)
        memory = np.zeros(max(words, 1), np.int64)
        field = memory.view(kind)[:count].reshape(shape)
        self._loaded_arrays.append((name, field, memory.ctypes.data, words))
        return field

    def _load_numbers(self, name: str, address: int, count: int) -> None:
        """Load float64 numbers of each view at an address."""
        numbers = np.ctypeslib.as_array((ctypes.c_double * count).from_address(address))
        self._loaded_arrays.append((name, numbers, address, count))

    def _record_visibility(self) -> None:
        """Record the geometry and visibility stages."""
        plan, cache = self._plan, self._cache
        arrays = cache.shapes.arrays
        positions = cache.shapes.positions(plan.quality.precision)
        kind, count, objects = positions.dtype, len(positions), len(arrays.face_starts) - 1
        viewport = visibility_pass.make_viewport(plan.size, plan.quality.subpixel_bits)
        _, capacity = clip_capacity(len(arrays.faces))
        screen = visibility_pass.allocate_screen(count + capacity, Memory())
        clip_positions = np.empty((count, 4), np.float64)
        faces = Faces(arrays.faces, np.empty((capacity, 3), np.int32), np.empty(capacity, np.int32))
        # Transform vertices to the screen.
        relative = self._loaded_array("relative_from_model", (objects, 4, 4), kind)
        clip = self._loaded_array("clip_from_relative", (4, 4), kind)
        model, scratch = (arrays.vertex_starts, relative), projection.allocate_scratch(kind)
        transformed = self._calls.bind(
            projection.transform_vertices, (0, count), positions, model, clip, (0.0, 0.0, 0.0),
            viewport, screen, scratch,
        )  # fmt: skip
        positioned = self._calls.bind(
            projection.transform_positions, (0, count), positions, model, clip, clip_positions,
            scratch,
        )  # fmt: skip
        self._load_numbers("coefficients", transformed.address_of(4), 3)
        # Clip, bin and rasterize faces.
        clipped, *clipping = self._record_clipping(
            faces, clip_positions, screen, viewport, capacity
        )
        self._geometry = visibility_pass.make_geometry(
            arrays.faces, screen, clip_positions, viewport, plan.is_affine
        )
        self._alpha_tests, self._hit_tests = (
            None if tests is None else tests._replace(geometry=self._geometry)
            for tests in (
                frame_shading.find_alpha_tests(plan, cache),
                frame_shading.find_hit_tests(plan, cache),
            )
        )
        rasterized = self._record_rasterization(faces, screen, viewport)
        calls = transformed, clipped, positioned, *clipping, *rasterized
        self._visibility_calls = np.array([call.words for call in calls], np.int64)
        # Keep the placement for shading.
        self._placement = Placement(
            arrays.face_starts,
            arrays.positions,
            self._loaded_array("relative_rows", (objects, 3, 4), np.float64),
            self._loaded_array("normal_matrices", (objects, 3, 3), np.float64),
            self._loaded_array("mirrored", (objects,), np.float64),
            self._loaded_array("front_windings", (objects,), np.float64),
            self._loaded_array("toward_viewer", (4,), np.float64),
        )

    def _record_clipping(
        self, faces: Faces, clip_positions: Float64, screen: ScreenVertices, viewport: Viewport,
        capacity: int,
    ) -> tuple[Bound, ...]:  # fmt: skip
        """
        Record clipping.

        Parameters
        ----------
        faces : Faces
            With memory for clipped pieces.
        clip_positions : (V, 4) float64
            Written if any face is clipped.
        screen : ScreenVertices
            With memory for new vertices.
        viewport : Viewport
        capacity : int
            New vertices that fit.
        """
        mesh, count = faces[0], len(clip_positions)
        cuts, _ = clip_capacity(len(mesh))
        clipped_faces, new_positions = np.empty(cuts, np.int32), np.empty((capacity, 4), np.float64)
        vertex_counts, starts = np.empty(cuts, np.int64), np.empty((2, cuts + 1), np.int64)
        polygons = np.empty((2, clipping.MAX_VERTICES, 4), np.float64)
        find_call = self._calls.bind(
            clipping.find_clipped_faces, mesh, screen.codes[:count], clipped_faces
        )
        count_call = self._calls.bind(
            clipping.count_clipped_vertices, clipped_faces, mesh, clip_positions, viewport,
            vertex_counts, polygons,
        )  # fmt: skip
        clip_call = self._calls.bind(
            clipping.clip_faces, clipped_faces, mesh, clip_positions, viewport,
            (starts[0], starts[1]), (new_positions, *faces[1:]), polygons,
        )  # fmt: skip
        project_call = self._calls.bind(
            projection.project_clipped_vertices, (clipped_faces, mesh, starts[0], clip_positions),
            new_positions, (0.0, 0.0, 0.0), viewport, count, screen,
        )  # fmt: skip
        self._load_numbers("coefficients", project_call.address_of(2), 3)
        # The number of clipped faces is the length of their list.
        lengths = [call.address_of(0) + WORD for call in (count_call, clip_call, project_call)]
        self._clipping = vertex_counts, starts[0], starts[1], np.array(lengths, np.int64), capacity
        self._calls.owners += [clipped_faces, polygons]
        return find_call, count_call, clip_call, project_call

    def _record_rasterization(
        self, faces: Faces, screen: ScreenVertices, viewport: Viewport
    ) -> tuple[Bound, ...]:
        """Record binning and rasterization; see `_record_clipping`."""
        arrays, (width, height) = self._cache.shapes.arrays, self._plan.size
        max_faces = len(faces[0]) + len(faces[1])
        columns = -(-width // setup.TILE_SIZE)
        tiles = columns * -(-height // setup.TILE_SIZE)
        lists = TileBins(
            faces, screen,
            Objects(
                arrays.face_starts,
                self._loaded_array("culled_windings", (len(arrays.face_starts) - 1,), np.int8),
            ),
            np.empty(max_faces, np.int32), np.empty((max_faces, 4), np.uint8), columns,
            np.zeros((1, tiles + 1), np.int32), np.empty(tiles + 1, np.int64),
            np.empty(min(tiles * max_faces, 4 * max_faces + 65536), np.int32),
        )  # fmt: skip
        # Find tile depths, then draw tiles.
        self._tile_depths = np.empty(tiles, np.float32)
        tests, holes = self._hit_tests, (np.empty(0, np.int64), np.empty(0, np.float32))
        if tests is not None:
            holes = tests.face_starts, tests.cutoffs
        depth_call = self._calls.bind(
            find_tile_depths, lists.triangles, lists.boxes, columns, faces, screen, viewport,
            self._tile_depths, holes,
        )  # fmt: skip
        self._depth = np.empty((height, width * self._plan.needs_depth), np.float32)
        self._face_id = np.empty((height, width), np.int32)
        tile_args = tile_rasterizer.make_tile_drawer(lists.binned, faces, screen, np.float32, tests)
        self._calls.owners.append(tile_args)
        draw_call = self._calls.bind(
            tile_rasterizer.draw_tiles, np.arange(tiles, dtype=np.int32),
            tile_rasterizer.NO_COUNTER,
            lists.starts, self._tile_depths, viewport, (self._depth, self._face_id), *tile_args[:3],
        )  # fmt: skip
        bin_calls, self._binning = self._record_binning(lists, viewport, depth_call)
        calls, self._sample_binning = (*bin_calls, depth_call, draw_call), self._binning
        layers = self._plan.layers
        if layers is not None and layers.samples != 1:
            # The lists for pixel centres are not read again.
            sample_viewport = fragment_bands.make_sampled_viewport(viewport, layers.samples)
            bin_calls, self._sample_binning = self._record_binning(lists, sample_viewport)
            calls = *calls, *bin_calls
        self._lists = lists
        return calls

    def _record_binning(
        self, lists: TileBins, viewport: Viewport, *readers: Bound
    ) -> tuple[tuple[Bound, ...], tuple[Any, ...]]:
        """
        Record binning.

        ``readers`` are calls whose first two arrays get their lengths from binning. Returns the
        calls, and the arguments that `draw_views` needs for them.
        """
        faces, screen, objects, triangles, boxes, columns, counts, starts, binned = lists
        sums = np.zeros(5, np.int64)
        setup_call = self._calls.bind(
            setup.set_up_triangles, (0, len(faces[0])), (0, 0), faces, objects, screen, viewport,
            (triangles, boxes), (columns, counts[0], sums), np.empty(setup.BATCH_SHAPE, np.int32),
            setup.ANY_CODE,
        )  # fmt: skip
        cursors = np.empty((1, len(starts) - 1), np.int64)
        start_call = self._calls.bind(binning.start_lists, counts, starts, cursors)
        bin_call = self._calls.bind(
            binning.bin_triangles, triangles, boxes, columns, faces, screen, viewport, cursors[0],
            binned,
        )  # fmt: skip
        lengths = [call.address_of(k) + WORD for call in (bin_call, *readers) for k in (0, 1)]
        arguments = (
            counts, sums, starts, len(binned), setup_call.address_of(1) + WORD,
            np.array(lengths, np.int64),
        )  # fmt: skip
        return (setup_call, start_call, bin_call), arguments

    def _record_shading(self) -> None:
        """Record the passes of shading."""
        plan, cache, (width, height) = self._plan, self._cache, self._plan.size
        viewer = self._loaded_array("viewer", (4,), np.float32)
        lighting = plan.lighting
        if lighting is not None:
            count = len(lighting.lights)
            lights = self._loaded_array(LIGHT_ROWS, (count, LIGHT_COLUMNS), np.float32)
            lighting = lighting._replace(lights=lights)
        placement = frame_shading.adjust_placement(plan, self._placement)
        coverage = visibility_pass.Coverage(
            self._depth, self._face_id, self._lists.screen, self._geometry.clip_positions,
            visibility_pass.Totals(*[0] * 8), None, reversed_depth=self._depth,
            reversed_vertex_depth=self._lists.screen.depth,
        )  # fmt: skip
        seen = RasterizedView(
            self._lists.objects, (0.0, 0.0, 0.0), self._geometry, placement, coverage
        )
        workers = RecordingWorkers(self._calls)
        context = FrameContext(plan, cache, placement, workers, seen, self._loaded_array)
        effects = tuple(self._prepare_effects(context))

        def light(surface: Surface, lighting: Lighting) -> NDArray[np.float32]:
            count = len(placement.positions)
            lit_vertices = np.zeros((count, 2, 3), np.float32)
            vertices = (0, count), cache.shapes.arrays.vertex_starts
            inputs = placement, surface, lighting, effects
            passes = list_vertex_steps(plan.shading, vertices, *inputs, lit_vertices, viewer)
            self._calls.run_stages(StageList(passes))
            return lit_vertices

        surface = frame_shading.light_surface(
            plan, frame_shading.find_surface(plan, cache.tables), lighting, light
        )
        shader = Shader(
            plan.shading, self._geometry, placement, surface, lighting, plan.background, effects,
            self._alpha_tests, encoding=plan.facts.encoding,
        )  # fmt: skip
        tone_mapping = None
        if plan.layers is not None:
            shader, tone_mapping = resolve_layers.split_tone_mapping(
                fragment_bands.make_sampled_finder(shader, plan.layers.samples)
            )
        shader = shader.prepare_stages(viewer=viewer)
        linear = np.empty((height, width * ("linear" in plan.outputs), 4), np.float32)
        color = self._face_id.view(np.uint32)
        if plan.keeps_faces:
            color = np.empty((height, width * ("color" in plan.outputs)), np.uint32)
        # Find lit pixels before colours overwrite the faces.
        step, lit = self._record_lit_pixels()
        rows = ColorRows(linear, color)
        if plan.layers is None:
            targets = self._face_id, 0, height, None, linear, color
            self._calls.run_stages(shader.shading.list_stages(*targets))
            shader.draw_background(self._calls, self._face_id, 0, linear, color)
        else:
            self._record_layers(plan.layers, shader, tone_mapping, rows)
        if lit is not None:
            self._calls.call(batch_driver.count_white, lit, step, color, self._white_counts)
        for active in select_acting(effects, "overlay"):
            active.call_at("overlay", context, color.view(np.uint8).reshape(height, width, 4))
        for name in ("linear", "color"):
            if name in plan.outputs:
                self._add_copy(name, getattr(rows, name))

    def _prepare_effects(self, context: FrameContext) -> Iterator[ActiveEffect]:
        """Record calls that prepare effects; yield the active effects."""
        for planned in self._plan.planned:
            if planned.effect.places and isinstance(planned.effect, BatchedEffect):
                effect = planned.effect
                record = effect.prepare_batch(self._plan, planned.data, self._loaded_array)
                if effect.fills_record:
                    step = partial(self._fill_record, effect, planned.data, record, context)
                    self._steps.append((self._calls.count, step))
                elif isinstance(effect, ScreenEffect):
                    record = effect.prepare(context, record, ())
                yield ActiveEffect(effect, record)

    def _fill_record(
        self, effect: BatchedEffect, data: Any, record: Any, context: FrameContext,
        contents: ViewContents,
    ) -> bool:  # fmt: skip
        """Fill an effect's record for a view whose faces are found."""
        camera, in_view = contents
        facts = replace(self._plan.facts, in_view=in_view)
        plan = self._plan.for_picture(camera=camera, facts=facts)
        workers = Workers(1)
        return effect.fill_record(
            context._replace(plan=plan, workers=workers, view_arrays=None), data, record
        )

    def _record_layers(
        self,
        layers: PixelLayers,
        shader: Shader,
        tone_mapping: LateToneMapping | None,
        picture: ColorRows,
    ) -> None:
        """
        Record shading and resolving of pixels with several faces.

        Either several samples of opaque faces, or one sample of transparent layers. Rows of tiles
        use the same memory, one after the other. The number of layers is known only when they are
        found: calls for missing layers are skipped, and a view with more than fit is drawn alone.
        """
        calls, lists = self._calls, self._lists
        viewport, samples = shader.geometry.viewport, int(layers.samples)
        # Partition the lists: opaque faces first.
        opaque_first, opaque_ends = lists.binned, lists.starts[1:]
        capacity = MAX_LAYERS * layers.has_blended
        if layers.has_blended:
            opaque_first = np.empty_like(lists.binned)
            opaque_ends = np.empty(len(lists.starts) - 1, np.int64)
            calls.call(
                a_buffer.split_lists, lists.starts, lists.binned, lists.faces,
                lists.objects.face_starts, layers.is_blended, opaque_first, opaque_ends,
            )  # fmt: skip
        tile_args, own_pixel = a_buffer.make_layer_drawer(
            tile_rasterizer.make_tile_drawer(
                opaque_first, lists.faces, lists.screen, np.float32, shader.alpha_tests
            )
        )
        points = fragment_bands.make_no_points(np.float32)
        shifts = fragment_bands.get_sample_shifts(samples, viewport.grid_bits)
        calls.owners += [tile_args, own_pixel, points, shader]
        encodes_at_once = resolve_layers.resolves_and_encodes_at_once(
            layers, tone_mapping is not None
        )
        table = srgb_encoding.make_encoding_table(shader.encoding)
        face_memory, part_memory = ReusedMemory(), ReusedMemory()
        max_rows = resolve_layers.MAX_LAYERED_ROWS if capacity else resolve_layers.MAX_OPAQUE_ROWS
        # Find the faces of a row of tiles, then shade some rows at once.
        for rows in split_range(viewport.height, TILE_SIZE):
            face_memory.begin()
            top, shape = rows[0], (samples, capacity, rows[1] - rows[0], viewport.width)
            stack = face_memory.empty(shape, np.float32), face_memory.empty(shape, np.int32)
            opaque = face_memory.empty((samples, *shape[2:]), np.int32)
            used, max_layers = np.empty((samples, lists.columns), np.int64), np.zeros(3, np.int64)
            calls.call(
                a_buffer.find_layers, rows, lists.starts, opaque_ends, points, viewport, shifts,
                opaque, points[0], stack, used, max_layers, *tile_args[:3], own_pixel,
            )  # fmt: skip
            if capacity:
                calls.add_limit(max_layers, capacity)
            for part in resolve_layers.split_rows(shape[2], max_rows):
                part_memory.begin()
                last = min(part.stop, shape[2])
                in_band, in_frame = slice(part.start, last), slice(top + part.start, top + last)
                linear, color = picture.linear[in_frame], picture.color[in_frame]
                if not (encodes_at_once or linear.shape[1]):
                    linear = part_memory.empty((last - part.start, viewport.width, 4), np.float32)
                if capacity:
                    images = [*stack[1][0, :, in_band], opaque[0, in_band]]
                    resolve_layers.composite_faces(
                        calls, shader, images, in_frame.start, max_layers, linear, part_memory
                    )
                else:
                    target = ColorRows(linear, color if encodes_at_once else empty_color(linear))
                    resolve_layers.resolve_samples(
                        calls, shader, opaque, (in_band.start, last), top, target, part_memory
                    )
                if not encodes_at_once:
                    resolve_layers.tone_map_and_encode(
                        calls,
                        tone_mapping,
                        table,
                        ColorRows(linear, color),
                        in_frame.start,
                        part_memory,
                    )

    def _record_lit_pixels(self) -> tuple[int, NDArray[np.int32] | None]:
        """Record a search for lit pixels, if any may be white; return their spacing, and them."""
        step = view_warnings.step_of(self._face_id.shape)
        lit_faces = view_warnings.lit_faces(self._plan.facts, self._cache)
        if lit_faces is None:
            return step, None
        lit = np.empty((1, *self._face_id[::step, ::step].shape), np.int32)
        self._calls.call(batch_driver.write_face_values, 0, self._face_id, step, lit_faces, lit)
        return step, lit

    def _record_outputs(self) -> None:
        """Record the kernels of the other outputs."""
        plan, cache, (width, height) = self._plan, self._cache, self._plan.size
        placement, world = self._placement, None
        if "face_id" in plan.outputs:
            self._add_copy("face_id", self._face_id)
        if "depth" in plan.outputs:
            self._add_call(
                "depth", batch_driver.measure_depths,
                self._loaded_array("depth_conversion", (1,), np.int64),
                self._loaded_array("depth_factors", (3,), np.float64), self._depth, self._face_id,
                np.empty((0, height, width), np.float32),
            )  # fmt: skip
        for name in ("object_id", "instance_id", "material_id"):
            if name in plan.outputs:
                numbers = ground_truth.list_object_ids(name, cache.shapes)[
                    cache.shapes.object_numbers
                ]
                self._add_call(
                    name, batch_driver.write_face_values, self._face_id, 1, numbers,
                    np.empty((0, height, width), np.int32),
                )  # fmt: skip
        if "position" in plan.outputs:
            world = self._loaded_array("world_rows", (len(cache.shapes.meshes), 3, 4), np.float64)
        for name, fill in ground_truth.list_fills(plan, cache, placement, world).items():
            picture = np.empty((height, width, *fill.channels), np.float32)
            arguments = self._face_id, (0, height), self._geometry, *fill.arguments, picture
            self._calls.call(fill.kernel, *arguments)
            if name != "distance":
                self._add_copy(name, picture)
                continue
            self._add_call(
                name, batch_driver.measure_distances,
                self._loaded_array("is_parallel", (1,), np.int64),
                self._loaded_array("distance_axis", (4,), np.float64), picture,
                np.empty((0, height, width), np.float32),
            )  # fmt: skip

    def _add_call(self, name: str, kernel: Any, *arguments: Any) -> None:
        """Record a kernel whose first argument is the view's number, its last the batched array."""
        call = self._calls.bind(kernel, 0, *arguments)
        self._calls.add(call, call.address_of(0))
        self._output_addresses.append((name, call.address_of(len(arguments))))

    def _add_copy(self, name: str, picture: NDArray[Any]) -> None:
        """Record the copy of an output into the batched array; it must have as many bytes."""
        shape, dtype = find_array_spec(name, self._plan.size, self._plan.facts.attributes)
        # Codes of colours are packed in words.
        is_same_type = picture.dtype == dtype or name == "color"
        if not is_same_type or picture.nbytes != math.prod(shape) * np.dtype(dtype).itemsize:
            raise RuntimeError(
                f"the output {name!r} must be {dtype} of shape {shape}, but its kernel fills "
                f"{picture.dtype} of shape {picture.shape}"
            )
        words = picture.reshape(-1).view(np.uint32)
        self._add_call(name, batch_driver.copy_picture, words, np.empty((0, len(words)), np.uint32))
