"""
Run the geometry and visibility stages: allocate, split the work among threads, call kernels.

Tasks write to disjoint memory, assigned before any of them starts, so the result has the same
bits for any number of threads and any order of completion.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import records
from rasterjit.pipeline.geometry import (
    binning,
    clipping,
    projection,
    setup,
    triangle_batches,
)
from rasterjit.pipeline.geometry.setup import GUARD_PIXELS
from rasterjit.pipeline.passes import KernelRow, Rows, rows_where
from rasterjit.pipeline.visibility import alpha_test, line_pass, point_pass, tile_rasterizer
from rasterjit.pipeline.visibility import primitive_expansion as expansion
from rasterjit.pipeline.visibility.hierarchical_z import find_tile_depths
from rasterjit.pipeline.visibility.point_pass import PicturePoints
from rasterjit.pipeline.visibility.primitive_expansion import (
    Expand,
    Primitive,
    Primitives,
    Projected,
)
from rasterjit.runtime.threads import FrameCache, Memory, Workers, choose_task_size, split_range

FACES_PER_TASK = 65536
"""Most faces set up by one task: enough to hide the cost of a task, few enough to balance."""

MIN_FACES_PER_TASK = 2048
"""Fewest faces set up by one task, if there are several threads."""

MIN_CLIPPED_PER_TASK = 256
"""Fewest faces clipped by one task, if there are several threads."""

VERTICES_PER_TASK = 65536
"""Most vertices projected by one task; they may belong to several objects."""

MIN_VERTICES_PER_TASK = 4096
"""Fewest vertices projected by one task, if there are several threads."""

TASKS_PER_THREAD = 4
"""Tasks per thread for work of even cost: faces to set up, vertices."""

TILES_PER_TASK = 4
"""Tiles that a thread takes at a time, if there are several threads."""

SPARE_VERTICES = 1024
"""Spare capacity for vertices made by clipping, before arrays have to be copied."""

EXPANDERS: dict[str, Expand] = {
    "lines": line_pass.expand_lines,
    "points": point_pass.expand_squares,
}
"""Functions that expand segments and points into triangles, by kind of object."""


class Totals(NamedTuple):
    """Counts of faces by outcome; they add up to ``faces_in``."""

    faces_in: int
    outside: int
    """Wholly outside the view volume."""
    degenerate: int
    """Zero area after snapping."""
    culled: int
    """Back-facing, with culling on."""
    unsampled: int
    """Between the pixel centres, or beside the image."""
    invalid: int
    """With a vertex that is NaN, infinite or too large."""
    drawn: int
    clipped: int
    """Cut at the near or far plane or the guard band; counted by their outcome as well."""


class TileLists(NamedTuple):
    """Which triangles each tile drew, in order."""

    starts: NDArray[np.int64]
    """(tiles + 1,): tile ``k`` drew ``binned[starts[k]:starts[k + 1]]``."""
    binned: NDArray[np.int32]
    """(M,): below F a face, ``F + p`` piece p."""
    faces: records.Faces
    objects: records.Objects | None = None
    skipped: Sequence[tuple[int, int]] = ()
    """Runs of faces that are in no list."""
    sample_radius: int = 0
    """As ``Viewport.sample_radius``: how far from pixel centres the lists' samples may lie."""


class ModelVertices(NamedTuple):
    """The vertices of all objects and their transforms to clip space."""

    positions: NDArray[np.float64] | NDArray[np.float32]
    """(V, 3), model space. Their type is that of the arithmetic that projects them."""
    vertex_starts: NDArray[np.int64]
    """(O+1,): object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``."""
    relative_from_model: NDArray[np.float64]
    """(O, 4, 4): to world axes with the origin at the eye."""
    clip_from_relative: NDArray[np.float64]
    """(4, 4)."""
    unused: tuple[tuple[int, int], ...] = ()
    """Runs of vertices that no drawn face uses, ascending: the first, and one past the last."""


class Coverage(NamedTuple):
    """The visibility buffer and the geometry that it points into."""

    depth: NDArray[Any]
    """(H, W), stored depth: greater is nearer; ``get_empty_depth`` where nothing is; (H, 0) if not
    kept."""
    face_id: NDArray[np.int32]
    """(H, W), -1 where nothing is."""
    screen: records.ScreenVertices
    clip_positions: NDArray[np.float64]
    """(V, 4), clip space; (0, 4) where no vertex has a ``CLIPPED`` code and none are requested."""
    totals: Totals
    lists: TileLists | None
    """``None`` unless requested."""
    alpha_tests: records.AlphaTests | None = None
    """With its geometry; ``None`` if no object is alpha-tested."""
    reversed_depth: NDArray[np.float32] | None = None
    """(H, W), reversed depth of the faces seen, -inf where nothing is, for the passes that follow;
    ``None`` if none reads it."""
    reversed_vertex_depth: NDArray[np.float64] | None = None
    """(V+E,), reversed depth of the vertices."""
    points: PicturePoints | None = None
    """The points of the picture; ``None`` if no object is of points."""
    covered: int | None = None
    """Number of pixels that show a face; ``None`` if not counted."""
    first_depth: NDArray[Any] | None = None
    """(H, W), depth at the first of several samples, which replaces ``depth`` in the output, or
    ``None``."""


def transform_to_clip(
    positions: NDArray[np.float64],
    vertex_starts: NDArray[np.int64],
    relative_from_model: NDArray[np.float64],
    clip_from_relative: NDArray[np.float64],
    workers: Workers,
    runs: Sequence[tuple[int, int]] | None = None,
) -> NDArray[np.float64]:
    """
    Transform every object's vertices to clip space, by way of eye-relative world coordinates.

    Large coordinates are subtracted while exact, so a scene far from the origin loses no precision.

    Parameters
    ----------
    positions : (V, 3) float64 or float32, model space
    vertex_starts : (O+1,) int64
        Object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``.
    relative_from_model : (O, 4, 4) float64
        To world axes with the origin at the eye.
    clip_from_relative : (4, 4) float64
    workers : Workers
    runs : sequence of (int, int), optional
        Runs of vertices to transform: the first, and one past the last. Default: all.

    Returns
    -------
    (V, 4) float64, clip space
        Computed in the positions' type.
    """
    count, kind = len(positions), positions.dtype
    per_task = _choose_per_task(count, MIN_VERTICES_PER_TASK, VERTICES_PER_TASK, workers)
    clip_positions = workers.memory.empty((count, 4), np.float64)
    objects = vertex_starts, _convert_matrices(relative_from_model, kind)
    matrix = _convert_matrices(clip_from_relative, kind)

    shared = positions, objects, matrix, clip_positions
    workers.call(
        projection.transform_positions,
        [
            (part, *shared, projection.allocate_scratch(kind))
            for first, end in ([(0, count)] if runs is None else runs)
            for part in split_range(end, per_task, first)
        ],
    )
    return clip_positions


def _choose_per_task(count: int, least: int, most: int, workers: Workers) -> int:
    """Choose the number of items of a task: see `choose_task_size`; at most ``most``."""
    return min(choose_task_size(count, least, workers, TASKS_PER_THREAD), most)


def _convert_matrices(matrices: NDArray[np.float64], kind: Any) -> NDArray[Any]:
    """Convert matrices to the type of the vertices that they transform."""
    if kind == np.float64:
        return np.ascontiguousarray(matrices)
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(matrices, kind)


def project_to_screen(
    clip_positions: NDArray[np.float64],
    depth_coefficients: tuple[float, float, float],
    viewport: records.Viewport,
    workers: Workers,
    precision: Any = np.float64,
) -> tuple[records.ScreenVertices, int]:
    """
    Project all vertices from clip space to the screen.

    Parameters
    ----------
    clip_positions : (V, 4) float64, clip space
    depth_coefficients : (float, float, float)
    viewport : Viewport
    workers : Workers
    precision : dtype
        Type of the arithmetic: float64 or float32.

    Returns
    -------
    ScreenVertices
        With spare capacity for ``SPARE_VERTICES`` after the V.
    int
        The outcode bits set for any vertex.
    """
    arguments, count = (clip_positions, depth_coefficients, viewport), len(clip_positions)
    return _fill_screen(projection.project_vertices, count, arguments, workers, precision)


def transform_and_project(
    vertices: ModelVertices,
    depth_coefficients: tuple[float, float, float],
    viewport: records.Viewport,
    workers: Workers,
    frame_cache: FrameCache | None = None,
    runs: Sequence[tuple[int, int]] | None = None,
) -> tuple[records.ScreenVertices, int]:
    """
    Project all vertices from model space to the screen.

    The same bits as `transform_to_clip` then `project_to_screen`, without storing clip positions.

    Parameters
    ----------
    vertices : ModelVertices
    depth_coefficients : (float, float, float)
    viewport : Viewport
    workers : Workers
    frame_cache : FrameCache, optional
        Memory of the previous picture.
    runs : sequence of (int, int), optional
        Runs of vertices to transform: the first, and one past the last. Default: all.

    Returns
    -------
    ScreenVertices
        With spare capacity for ``SPARE_VERTICES`` after the V.
    int
        The outcode bits set for any vertex.
    """
    count, kind = len(vertices.positions), vertices.positions.dtype
    objects = vertices.vertex_starts, _convert_matrices(vertices.relative_from_model, kind)
    matrix = _convert_matrices(vertices.clip_from_relative, kind)
    arguments = vertices.positions, objects, matrix, depth_coefficients, viewport
    runs = [(0, count)] if runs is None else runs
    return _fill_screen(
        projection.transform_vertices, count, arguments, workers, kind, frame_cache, runs
    )


def _fill_screen(
    kernel: Callable[..., int], count: int, arguments: tuple, workers: Workers, precision: Any,
    frame_cache: FrameCache | None = None, runs: Sequence[tuple[int, int]] | None = None,
) -> tuple[records.ScreenVertices, int]:  # fmt: skip
    """Fill the screen vertices, all or some runs; return them and the bits of their outcodes."""
    frame_cache = frame_cache or FrameCache(workers.memory, is_enabled=False)
    screen = frame_cache.get_or_make(
        "screen", allocate_screen, count + SPARE_VERTICES, workers.memory
    )
    per_task = _choose_per_task(count, MIN_VERTICES_PER_TASK, VERTICES_PER_TASK, workers)

    calls = []
    for start, end in [(0, count)] if runs is None else runs:
        for part in split_range(end, per_task, start):
            if not calls:
                scratch = frame_cache.get_or_make(
                    "projecting", projection.allocate_scratch, precision
                )
            else:
                scratch = projection.allocate_scratch(precision)
            calls.append((part, *arguments, screen, scratch))
    all_codes = 0
    for bits in workers.call(kernel, calls):
        all_codes |= bits
    return screen, all_codes


def clip_faces(
    clip_positions: NDArray[np.float64],
    faces: NDArray[np.int32],
    depth_coefficients: tuple[float, float, float],
    viewport: records.Viewport,
    screen: records.ScreenVertices,
    workers: Workers,
    primitives: Primitives | None = None,
) -> tuple[records.Faces, records.ScreenVertices, int]:
    """
    Clip the faces that cross the near or far plane or the guard band.

    Parameters
    ----------
    clip_positions : (V, 4) float64, clip space
    faces : (F, 3) int32, vertex numbers
    depth_coefficients : (float, float, float)
    viewport : Viewport
    screen : ScreenVertices
        The V vertices snapped, as `project_to_screen` returns them.
    workers : Workers
    primitives : Primitives, optional
        The objects whose faces are not triangles, and not clipped.

    Returns
    -------
    Faces
        All F faces, and the pieces of those that were clipped.
    ScreenVertices
        The V vertices, followed by those that clipping made.
    int
        Number of clipped faces.
    """
    # Find the faces to clip.
    codes = screen.codes[: clip_positions.shape[0]]
    if primitives is None:
        cut = _find_clipped_faces(faces, codes, workers)
    else:
        runs = expansion.find_gaps([one.faces for one in primitives.objects], len(faces))
        cut = np.concatenate(
            [np.empty(0, np.int32)]
            + [_find_clipped_faces(faces[a:b], codes, workers) + np.int32(a) for a, b in runs]
        )
    # Count the vertices of each, and clip.
    counts = np.zeros(len(cut), np.int64)
    edges = _split_into_tasks(len(cut), MIN_CLIPPED_PER_TASK, FACES_PER_TASK, workers)
    parts = [slice(first, end) for first, end in itertools.pairwise(edges)]
    scratches = [np.empty((2, clipping.MAX_VERTICES, 4), np.float64) for _ in parts]
    workers.call(
        clipping.count_clipped_vertices,
        [
            (cut[part], faces, clip_positions, viewport, counts[part], scratch)
            for part, scratch in zip(parts, scratches, strict=True)
        ],
    )
    vertex_starts = np.concatenate(([0], np.cumsum(counts)))
    piece_starts = np.concatenate(([0], np.cumsum(np.maximum(counts - 2, 0))))
    positions = np.empty((vertex_starts[-1], 4), np.float64)
    pieces = np.empty((piece_starts[-1], 3), np.int32)
    piece_faces = np.empty(piece_starts[-1], np.int32)
    workers.call(
        clipping.clip_faces,
        [
            (
                cut[part], faces, clip_positions, viewport,
                (vertex_starts[part.start :], piece_starts[part.start :]),
                (positions, pieces, piece_faces), scratch,
            )
            for part, scratch in zip(parts, scratches, strict=True)
        ],
    )  # fmt: skip
    first = clip_positions.shape[0]
    if first + len(positions) > len(screen.codes):
        larger = allocate_screen(first + len(positions), workers.memory)
        for old, new in zip(screen, larger, strict=True):
            new[:first] = old[:first]
        screen = larger
    workers.call(
        projection.project_clipped_vertices,
        [
            (
                (cut[part], faces, vertex_starts[part.start :], clip_positions),
                positions, depth_coefficients, viewport, first, screen,
            )
            for part in parts
        ],
    )  # fmt: skip
    return records.Faces(faces, pieces, piece_faces), screen, len(cut)


def _find_clipped_faces(
    faces: NDArray[np.int32], codes: NDArray[np.uint8], workers: Workers
) -> NDArray[np.int32]:
    """Find the numbers of the faces that have to be clipped, ascending."""
    edges = _split_into_tasks(len(faces), MIN_FACES_PER_TASK, FACES_PER_TASK, workers)
    parts = [faces[first:end] for first, end in itertools.pairwise(edges)]
    lists = [np.empty(min(len(part), SPARE_VERTICES), np.int32) for part in parts]
    rows = list(zip(parts, itertools.repeat(codes), lists))
    counts = workers.call(clipping.find_clipped_faces, rows)
    for n, count in enumerate(counts):
        if count > len(lists[n]):
            lists[n] = np.empty(count, np.int32)
            clipping.find_clipped_faces(parts[n], codes, lists[n])
    if len(lists) == 1:
        return lists[0][: counts[0]]
    return np.concatenate(
        [ids[:count] + first for ids, count, first in zip(lists, counts, edges, strict=False)],
        dtype=np.int32,
    )


def _split_into_tasks(count: int, least: int, most: int, workers: Workers) -> list[int]:
    """Split ``count`` items into tasks; return each start, and the end of the last."""
    return [*range(0, count, _choose_per_task(count, least, most, workers)), count]


class Drawable(NamedTuple):
    """The geometry that a picture is drawn from."""

    vertices: ModelVertices | NDArray[np.float64]
    """Model space; or (V, 4) float64, clip space."""
    faces: NDArray[np.int32]
    """(F, 3)."""
    objects: records.Objects
    depth_coefficients: tuple[float, float, float]
    """The stored depth is ``(c0 + c1 z + c2 w) / w``; greater is nearer."""
    viewport: records.Viewport
    alpha_tests: records.AlphaTests | None = None
    """The alpha-tested objects, for any picture: its geometry is filled in."""
    primitives: Primitives | None = None
    """The objects whose faces are segments or points; ``None`` -> all are triangles."""
    hidden: Sequence[tuple[int, int]] = ()
    """Runs of faces, ascending, those of whole objects, that are not drawn."""
    is_affine: bool = False
    """Whether the alpha test interpolates affinely, in screen space."""


class VisibilityOptions(NamedTuple):
    """The results of a picture to keep, and options of drawing."""

    depth: bool = True
    faces: bool = True
    """Whether the face at each pixel is kept; else ``face_id`` is (H, 0)."""
    lists: bool = False
    """Whether the tiles' lists of triangles are kept."""
    clip_positions: bool = False
    """Whether clip positions are computed even if no vertex has a ``CLIPPED`` code."""
    draws: bool = True
    """Whether depth or faces are read; else all pixels are empty."""
    depth_type: Any = np.float32
    """Type that depths are rounded to before they are compared: float32, float64, or int32, which
    truncates."""
    precision: Any = np.float64
    """Type of the arithmetic that projects clip positions; model positions have their own type."""
    sample_radius: int = 0
    """``Viewport.sample_radius`` of the samples that the lists are for; 0 for drawing pictures."""


def run_visibility(
    drawable: Drawable,
    options: VisibilityOptions,
    workers: Workers,
    clock: Callable[[str], None],
    *,
    depth: NDArray[np.float32] | None = None,
    face_id: NDArray[np.int32] | None = None,
    frame_cache: FrameCache | None = None,
) -> Coverage:
    """
    Run transform, projection, clipping, set-up, binning and visibility.

    Parameters
    ----------
    drawable : Drawable
    options : VisibilityOptions
    workers : Workers
    clock : callable
        Called with a stage's name when it ends.
    depth : (H, W) float32, optional
        Output: depth.
    face_id : (H, W) int32, optional
        Output: the face at each pixel, if it outlives the drawing.
    frame_cache : FrameCache, optional
        Memory of the previous picture, which all results but depth and face use. Default: none.
    """
    vertices, faces, objects, depth_coefficients, viewport, alpha_tests = drawable[:6]
    primitives, hidden, is_affine = drawable[6:]
    sample_radius, depth_type = options.sample_radius, options.depth_type
    frame_cache = frame_cache or FrameCache(workers.memory, is_enabled=False)
    point_objects: list[Primitive] = []
    if primitives is not None:
        point_objects = [
            one
            for one in primitives.objects
            if point_pass.is_drawn_as_points(one, options.lists, alpha_tests)
        ]
    # Transform and project vertices.
    if isinstance(vertices, ModelVertices):
        runs, unused = None, list(vertices.unused)
        if not (options.lists or options.clip_positions):
            # Points are projected when they are drawn.
            unused += [one.vertices for one in point_objects]
        if unused:
            runs = list(expansion.find_gaps(sorted(unused), len(vertices.positions)))
        screen, all_codes = transform_and_project(
            vertices, depth_coefficients, viewport, workers, frame_cache, runs
        )
        clip_positions = frame_cache.get_or_allocate("no clip positions", (0, 4), np.float64)
        if options.clip_positions or all_codes & setup.CLIPPED or primitives is not None:
            clip_positions = transform_to_clip(*vertices[:4], workers, runs)
    else:
        clip_positions = vertices
        screen, all_codes = project_to_screen(
            clip_positions, depth_coefficients, viewport, workers, options.precision
        )
    clock("transform")
    # Clip faces.
    clipped = 0
    all_faces = frame_cache.get_or_make("faces", make_unclipped_faces, faces)
    if all_codes & setup.CLIPPED:
        all_faces, screen, clipped = clip_faces(
            clip_positions, faces, depth_coefficients, viewport, screen, workers, primitives
        )
    clock("clip")
    # Expand segments and points into triangles.
    if primitives is not None:
        codes = screen.codes[: len(clip_positions)]
        projected = Projected(faces, clip_positions, codes, depth_coefficients, viewport)
        allocate = partial(allocate_screen, memory=workers.memory)
        numbers = {one.number for one in point_objects}
        expanded = tuple([one for one in primitives.objects if one.number not in numbers])
        all_faces, screen = expansion.expand_primitives(
            primitives._replace(objects=expanded), EXPANDERS, projected, all_faces, screen,
            allocate, workers,
        )  # fmt: skip
        for one in point_objects:
            screen.codes[slice(*one.vertices)] = setup.GUARD
        all_codes |= setup.GUARD
        clock("lines, points")
    if alpha_tests is not None:
        geometry = make_geometry(faces, screen, clip_positions, viewport, is_affine)
        alpha_tests = alpha_tests._replace(geometry=geometry)
    lists = None
    skipped = [one.faces for one in point_objects]
    if hidden:
        skipped = sorted({*skipped, *hidden})
        point_objects = [one for one in point_objects if one.faces not in hidden]
    # Set up and bin triangles.
    if options.draws or options.lists:
        starts, binned, tile_depths, sums = set_up_and_bin(
            all_faces, objects, screen,
            viewport._replace(sample_radius=sample_radius) if sample_radius else viewport, workers,
            alpha_tests, depth_type, frame_cache, all_codes, skipped,
        )  # fmt: skip
        if options.lists:
            lists = TileLists(
                starts, binned[: starts[-1]], all_faces, objects, hidden, sample_radius
            )
    else:
        sums = set_up(
            all_faces, objects, screen, viewport, workers, frame_cache, all_codes, skipped
        ).sums
    clock("set up, bin")
    # Draw triangles, then points.
    has_points = options.draws and bool(point_objects)
    if depth is None:
        width = viewport.width * (options.depth or has_points)
        depth = workers.memory.empty((viewport.height, width), depth_type)
    if face_id is None:
        width = viewport.width * (options.faces or has_points)
        face_id = workers.memory.empty((viewport.height, width), np.int32)
    points = None
    if primitives is not None and "points" in primitives.kinds:
        view = vertices.clip_from_relative, depth_coefficients, viewport
        points = point_pass.collect_points(
            primitives, objects.face_starts, vertices.vertex_starts, *view
        )
    covered = None
    if options.draws:
        frame = depth, face_id
        covered = draw_tiles(
            starts, binned, tile_depths, all_faces, screen, viewport, frame, workers, alpha_tests,
            frame_cache,
        )  # fmt: skip
        if has_points:
            covered = None
            cloud = point_pass.DrawnPoints(
                vertices.positions, vertices.relative_from_model,
                point_pass.select_points(points.rows, point_objects), points.view,
                depth_coefficients,
            )  # fmt: skip
            target = frame
            if options.lists:
                # Transparent surfaces may lie in front of points, or behind.
                shape = viewport.height, viewport.width
                target = np.empty(shape, depth_type), np.empty(shape, np.int32)
                point_pass.clear_pictures(target)
                points = points._replace(picture=target)
            sums = sums + point_pass.count_skipped(
                point_pass.draw_all_points(cloud, viewport, target, workers)
            )
            if options.lists:
                point_pass.merge_into_frame(
                    (target[0][np.newaxis], target[1][np.newaxis]), frame, workers
                )
    else:
        depth.fill(tile_rasterizer.get_empty_depth(depth_type))
        face_id.fill(tile_rasterizer.NOTHING)
    clock("visibility")
    outside, degenerate, culled, unsampled, invalid = sums.tolist()
    drawn = len(faces) - (outside + degenerate + culled + unsampled + invalid)
    totals = Totals(len(faces), outside, degenerate, culled, unsampled, invalid, drawn, clipped)
    return Coverage(
        depth, face_id, screen, clip_positions, totals, lists, alpha_tests, points=points,
        covered=covered if face_id.shape[1] else None,
    )  # fmt: skip


def list_kernels(
    options: VisibilityOptions, has_alpha_tests: bool, kinds: Collection[str] = ()
) -> Rows:
    """
    List the kernels that `run_visibility` calls, each with its variant and condition.

    ``options.precision`` applies to model positions, too; ``kinds`` are those of primitives.
    """
    crossed = "a face crosses the near or far plane or the guard band"
    depth = name_depth_variant(options.depth_type)
    single = "float32 vertices" if np.dtype(options.precision) == np.float32 else ""
    moved = "" if options.clip_positions or kinds else crossed
    rows = [
        KernelRow(projection.transform_vertices, single),
        KernelRow(projection.transform_positions, single, moved),
        *rows_where(
            crossed, clipping.find_clipped_faces, clipping.count_clipped_vertices,
            clipping.clip_faces, projection.project_clipped_vertices,
        ),
        *(line_pass.kernel_rows() if "lines" in kinds else []),
        KernelRow(setup.set_up_triangles),
    ]  # fmt: skip
    if options.draws or options.lists:
        rows += [
            *rows_where("", binning.start_lists, binning.bin_triangles),
            KernelRow(find_tile_depths, depth, "a face covers whole tiles"),
        ]
    if options.draws:
        rows.append(KernelRow(tile_rasterizer.draw_tiles, depth))
    if options.draws or options.lists:
        batched = triangle_batches.set_up_batch, triangle_batches.order_triangles
        rows += [*rows_where("", *batched), KernelRow(tile_rasterizer.draw_batch, depth)]
    if options.draws and "points" in kinds:
        from rasterjit.pipeline.visibility import point_rasterizer

        rows += [
            KernelRow(point_rasterizer.draw_points, depth),
            KernelRow(point_rasterizer.merge_pictures, depth, "several threads draw points"),
        ]
    if options.draws and has_alpha_tests:
        rows += [KernelRow(alpha_test.queue_triangle, depth), KernelRow(alpha_test.find_alphas)]
    return rows


def name_depth_variant(depth_type: Any) -> str:
    """Name the kernel variant that compares depths of a type; empty for float32."""
    name = np.dtype(depth_type).name
    return "" if name == "float32" else f"{name} depth"


def make_geometry(
    faces: NDArray[np.int32],
    screen: records.ScreenVertices,
    clip_positions: NDArray[np.float64],
    viewport: records.Viewport,
    is_affine: bool = False,
) -> records.Geometry:
    """Make the geometry to interpolate on: perspective-correct, or affine on the screen."""
    w = np.empty(0) if is_affine else screen.w
    return records.Geometry(faces, screen.xy, screen.codes, w, clip_positions, viewport)


class SetUp(NamedTuple):
    """Triangles that survived culling, and their tiles."""

    triangles: NDArray[np.int32]
    """(F + P,): triangle numbers, packed at the start of each part."""
    boxes: NDArray[np.uint8]
    """(F + P, 4): inclusive tile columns and rows of each triangle."""
    parts: list[slice]
    """The range of each task's triangles."""
    counts: NDArray[np.int32]
    """(parts, tiles + 1): triangles of each tile; last, the number of large ones."""
    sums: NDArray[np.int64]
    """(5,): number of the other faces, by outcome."""


def set_up(
    faces: records.Faces, objects: records.Objects, screen: records.ScreenVertices,
    viewport: records.Viewport, workers: Workers, frame_cache: FrameCache | None = None,
    possible_codes: int = setup.ANY_CODE, skipped: Sequence[tuple[int, int]] = (),
) -> SetUp:  # fmt: skip
    """
    Cull faces, and find the tiles of the survivors.

    Takes the outcode bits of any vertex, and the runs of faces to skip.
    """
    frame_cache = frame_cache or FrameCache(workers.memory, is_enabled=False)
    columns, tiles = _count_tiles(viewport)
    face_count, piece_count = len(faces.faces), len(faces.pieces)
    per_task = _choose_per_task(face_count, MIN_FACES_PER_TASK, FACES_PER_TASK, workers)
    edges = [
        part
        for start, end in expansion.find_gaps(skipped, face_count)
        for part in split_range(end, per_task, start)
    ] or [(0, 0)]
    chunks = len(edges)
    piece_edges = [(0, 0)] * chunks
    if piece_count:
        piece_edges = [tuple(pair) for pair in faces.piece_faces.searchsorted(edges).tolist()]
    triangles = frame_cache.get_or_allocate("triangles", (face_count + piece_count,), np.int32)
    boxes = frame_cache.get_or_allocate("boxes", (face_count + piece_count, 4), np.uint8)
    counts = np.zeros((chunks, tiles + 1), np.int32)
    sums = np.zeros((chunks, 5), np.int64)
    batches = [frame_cache.get_or_allocate("batch", setup.BATCH_SHAPE, np.int32)]
    batches += [np.empty(setup.BATCH_SHAPE, np.int32) for _ in range(1, chunks)]
    ends = workers.call(
        setup.set_up_triangles,
        [
            (
                edges[n], piece_edges[n], faces, objects, screen, viewport, (triangles, boxes),
                (columns, counts[n], sums[n]), batches[n], possible_codes,
            )
            for n in range(chunks)
        ],
    )  # fmt: skip
    parts = [slice(edges[n][0] + piece_edges[n][0], ends[n]) for n in range(chunks)]
    return SetUp(triangles, boxes, parts, counts, sums[0] if chunks == 1 else sums.sum(axis=0))


def set_up_and_bin(
    faces: records.Faces,
    objects: records.Objects,
    screen: records.ScreenVertices,
    viewport: records.Viewport,
    workers: Workers,
    alpha_tests: records.AlphaTests | None = None,
    depth_type: Any = np.float32,
    frame_cache: FrameCache | None = None,
    possible_codes: int = setup.ANY_CODE,
    skipped: Sequence[tuple[int, int]] = (),
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[Any], NDArray[np.int64]]:
    """
    Return each tile's start in the list of triangles, the list, tile depths, and totals.

    The list is valid up to the last start.
    """
    frame_cache = frame_cache or FrameCache(workers.memory, is_enabled=False)
    triangles, boxes, parts, counts, sums = set_up(
        faces, objects, screen, viewport, workers, frame_cache, possible_codes, skipped
    )
    columns, tiles = _count_tiles(viewport)
    starts = frame_cache.get_or_allocate("starts", (tiles + 1,), np.int64)
    cursors = frame_cache.get_or_allocate("cursors", (len(parts), tiles), np.int64)
    binning.start_lists(counts, starts, cursors)
    binned = frame_cache.get_or_allocate_at_least("binned", int(starts[-1]), np.int32)
    workers.call(
        binning.bin_triangles,
        [
            (triangles[part], boxes[part], columns, faces, screen, viewport, cursors[n], binned)
            for n, part in enumerate(parts)
        ],
    )
    # A triangle that covers all pixel centres of a tile may miss other samples.
    with_large = [
        n for n in range(len(parts)) if viewport.sample_radius == 0 and counts[n, tiles] != 0
    ]
    if not with_large:
        return (
            starts,
            binned,
            frame_cache.get_or_make("depths", _make_empty_depths, tiles, depth_type),
            sums,
        )
    tile_depths = np.full((len(with_large), tiles), tile_rasterizer.get_empty_depth(depth_type))
    cutoffs = np.empty(0, np.int64), np.empty(0, np.float32)
    if alpha_tests is not None:
        cutoffs = alpha_tests.face_starts, alpha_tests.cutoffs
    workers.call(
        find_tile_depths,
        [
            (
                triangles[parts[n]], boxes[parts[n]], columns, faces, screen, viewport,
                tile_depths[row], cutoffs,
            )
            for row, n in enumerate(with_large)
        ],
    )  # fmt: skip
    return starts, binned, tile_depths.max(axis=0), sums


def _count_tiles(viewport: records.Viewport) -> tuple[int, int]:
    """Count the columns of tiles of a picture, and its tiles."""
    columns = -(-viewport.width // setup.TILE_SIZE)
    return columns, columns * -(-viewport.height // setup.TILE_SIZE)


def draw_tiles(
    starts: NDArray[np.int64],
    binned: NDArray[np.int32],
    tile_depths: NDArray[Any],
    faces: records.Faces,
    screen: records.ScreenVertices,
    viewport: records.Viewport,
    frame: tuple[NDArray[Any], NDArray[np.int32]],
    workers: Workers,
    alpha_tests: records.AlphaTests | None = None,
    frame_cache: FrameCache | None = None,
) -> int:
    """Rasterize all tiles, each by one thread; return how many pixels are covered."""
    frame_cache = frame_cache or FrameCache(workers.memory, is_enabled=False)
    tiles = frame_cache.get_or_make("tiles", _number_tiles, len(starts) - 1)
    per_task = len(tiles) if workers.threads == 1 else TILES_PER_TASK
    kind = frame[0].dtype
    # One drawer for each thread: making it takes longer than drawing a few tiles.
    drawers = frame_cache.get_or_make(
        "drawers", _make_no_drawers, binned, faces, screen, kind, alpha_tests
    )
    tasks = -(-len(tiles) // per_task)
    threads = min(workers.threads, tasks)
    while len(drawers) < threads:
        memory = (
            None
            if drawers
            else frame_cache.get_or_make("tile memory", tile_rasterizer.allocate_tile_memory, kind)
        )
        drawers.append(
            tile_rasterizer.make_tile_drawer(binned, faces, screen, kind, alpha_tests, memory)
        )
    counter = np.array([0, per_task], np.int64) if tasks > 1 else tile_rasterizer.NO_COUNTER
    shared = tiles, counter, starts, tile_depths, viewport, frame
    calls = [(*shared, *drawer[:3]) for drawer in drawers[:threads]]
    return int(sum(workers.call(tile_rasterizer.draw_tiles, calls)))


def make_unclipped_faces(faces: NDArray[np.int32]) -> records.Faces:
    """Make the `Faces` record of faces without clipped ones."""
    return records.Faces(faces, np.empty((0, 3), np.int32), np.empty(0, np.int32))


def _make_empty_depths(tiles: int, depth_type: Any) -> NDArray[Any]:
    """Make the depths of empty tiles."""
    return np.full(tiles, tile_rasterizer.get_empty_depth(depth_type))


def _make_no_drawers(*_: Any) -> list[Any]:
    """Make an empty list: each thread makes its drawer if there is none."""
    return []


def _number_tiles(count: int) -> NDArray[np.int32]:
    """Return the integers from 0 to ``count`` - 1."""
    return np.arange(count, dtype=np.int32)


def allocate_screen(count: int, memory: Memory) -> records.ScreenVertices:
    """Allocate screen vertices."""
    # A vertex's position and depth share a cache line.
    packed = memory.empty((count, 2), np.float64)
    return records.ScreenVertices(
        packed.view(np.int32)[:, :2],
        packed[:, 1],
        memory.empty((count,), np.uint8),
        memory.empty((count,), np.float64),
    )


class Region(NamedTuple):
    """A part of a picture, pixels."""

    left: int
    top: int
    width: int
    height: int


def make_viewport(
    size: tuple[int, int],
    subpixel_bits: int,
    region: Region | None = None,
    spacing: float = 1.0,
) -> records.Viewport:
    """Make the viewport record, with guard band, of an image (width, height) or a part of it."""
    width, height = size
    left, top, columns, rows = region or (0, 0, width, height)
    return records.Viewport(
        columns,
        rows,
        1.0 + 2.0 * GUARD_PIXELS / width,
        1.0 + 2.0 * GUARD_PIXELS / height,
        subpixel_bits,
        max(subpixel_bits, 1),
        left=left,
        top=top,
        right=width - left - columns,
        bottom=height - top - rows,
        spacing=spacing,
    )


class RasterizedView(NamedTuple):
    """A rasterized picture: its coverage, geometry and viewport."""

    objects: records.Objects
    depth_coefficients: tuple[float, float, float]
    geometry: records.Geometry
    placement: records.Placement
    coverage: Coverage
