"""
Explain one pixel: the faces that cover it, the visible one, and the terms of its colour.

The numbers are those of a frame: the same stages transform, clip, snap, bin, draw and shade the
pixel. Where they round, the oracle adds the exact value.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.inspect.pixel_color import (
    VisibleScene,
    find_color_parts,
    find_light_terms,
    find_object,
    find_surface,
)
from rasterjit.inspect.pixel_report import (
    NOT_DRAWN,
    SEEN_BESIDE,
    SEEN_THROUGH,
    ColorPart,
    FaceAtPixel,
    PixelExplanation,
    PrimitiveAtPixel,
)
from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.geometry import setup
from rasterjit.pipeline.records import Faces, Objects
from rasterjit.pipeline.visibility import tile_rasterizer, visibility_pass
from rasterjit.pipeline.visibility.alpha_test import make_empty_queue
from rasterjit.pipeline.visibility.primitive_expansion import PointRule, collect_primitives
from rasterjit.rendering import frame_shading, planning, supersample
from rasterjit.rendering.planning import Cull, check_request, choose_camera, cut_by_section
from rasterjit.rendering.renderer import find_visible, render
from rasterjit.runtime.background_compile import compile_in_background
from rasterjit.runtime.threads import Workers
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.transforms import transform_points
from rasterjit.scene.validation import image_size, index_below
from rasterjit.survey import object_transforms
from rasterjit.survey.cache import update_cache
from rasterjit.survey.deformation import pose_input
from rasterjit.survey.effect import with_field
from rasterjit.survey.plan import RenderPlan

if TYPE_CHECKING:
    from fractions import Fraction

OUTCODE_NAMES = {
    setup.LEFT: "left", setup.RIGHT: "right", setup.BOTTOM: "bottom", setup.TOP: "top",
    setup.NEAR: "near", setup.FAR: "far", setup.GUARD: "guard band",
}  # fmt: skip

EMPTY_MESH = Mesh([(0.0, 0.0, 0.0)] * 3, [(0, 1, 2)])
"""A mesh without area, which no pixel shows."""

Weights = tuple["Fraction", "Fraction", "Fraction"]


def explain_pixel(
    what: Any,
    camera: Camera | None,
    size: tuple[int, int],
    x: int,
    y: int,
    *,
    quality: Quality | None = None,
    cull: Cull = "none",
    background: Background = None,
) -> PixelExplanation:
    """
    Explain the faces and the colour of one pixel, stage by stage.

    Parameters
    ----------
    what : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene
    camera : Camera or None
        None takes the scene's own camera, else one that fits the scene.
    size : (int, int)
        Width and height of the image, pixels.
    x, y : int
        Column from the left and row from the top.
    quality, cull, background
        As `render` takes them.

    Returns
    -------
    PixelExplanation
        Prints as tables; its numbers are those of the frame that `render` makes of the same
        arguments.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    size = image_size("size", size)
    x, y = index_below("x", x, size[0]), index_below("y", y, size[1])
    scene = pose_input(what)
    camera, scene = choose_camera(scene, camera, size), cut_by_section(scene)
    request = check_request(size, quality, ("color", "linear"), background, cull)
    plan = planning.make_plan(request, scene, camera)
    with compile_in_background(partial(planning.list_compile_tasks, plan)):
        return _explain(scene, plan, background, x, y)


def _explain(scene: Scene, plan: RenderPlan, background: Any, x: int, y: int) -> PixelExplanation:
    """Draw a planned frame up to visibility, and explain one pixel."""
    drawn = _draw_visibility(scene, plan)
    faces = tuple(_find_faces(drawn, x, y))
    has_face = drawn.seen.coverage.face_id[y, x] >= 0
    # Shade the visible face.
    terms, linear, surface_and_light, parts = None, plan.background, None, ()
    if has_face and plan.facts.draws_faces:
        surface_and_light = find_surface(drawn)
        terms, linear = find_light_terms(drawn, *surface_and_light, x, y)
    codes = np.array([srgb_encoding.encode_color(linear, plan.facts.encoding)], np.uint32)
    color_without_edges = color = codes.view(np.uint8)
    # Render what one face does not explain: blending, samples, effects on the picture.
    if not all(planned.effect.is_explained for planned in plan.planned):
        color, pixel_linear = _render_without_edges(scene, plan, background, x, y)
        color_without_edges = color
        if plan.facts.draws_faces and (terms is not None or plan.layers is not None):
            surface_and_light = surface_and_light or find_surface(drawn)
            parts = find_color_parts(drawn, *surface_and_light, linear, pixel_linear, x, y)
            faces = tuple(_mark_visible(faces, parts))
        linear = pixel_linear
    if any(overlay.effect.is_explained for overlay in plan.effects_at("overlay")):
        frame = render(
            scene, plan.camera, size=plan.size, quality=plan.quality, background=background,
            cull=plan.cull, threads=1,
        )  # fmt: skip
        color = frame.color[y, x]
    # Number the faces as in the scene before a section cut it.
    faces, parts = _renumber_faces(drawn, faces), _renumber_parts(drawn, parts)
    reasons = () if has_face else _explain_background(drawn, faces, x, y)
    has_edge = not np.array_equal(color_without_edges, color)
    return PixelExplanation(x, y, plan.size, faces, reasons, terms, parts, linear, color, has_edge)


def _renumber_faces(drawn: VisibleScene, faces: tuple[FaceAtPixel, ...]) -> tuple[FaceAtPixel, ...]:
    """Return faces renumbered to the scene before a section cut it."""
    cut = drawn.cache.cut
    if cut is None:
        return faces
    renumbered = []
    for face in faces:
        number, owner = cut.original_numbers(face.face, face.object_number)
        is_cap = number >= cut.face_starts[-1]
        renumbered.append(
            replace(
                face,
                face=number,
                object_number=owner,
                mesh_face=-1 if is_cap else number - int(cut.face_starts[owner]),
                mesh_vertices=cut.vertices_of(face.object_number, face.mesh_vertices),
            )
        )
    return tuple(renumbered)


def _renumber_parts(drawn: VisibleScene, parts: tuple[ColorPart, ...]) -> tuple[ColorPart, ...]:
    """Return the parts of a colour renumbered to the scene before a section cut it."""
    cut = drawn.cache.cut
    if cut is None:
        return parts
    return tuple(
        part if part.face is None else replace(part, face=int(cut.face_numbers[part.face]))
        for part in parts
    )


def _mark_visible(
    faces: tuple[FaceAtPixel, ...], parts: tuple[ColorPart, ...]
) -> Iterator[FaceAtPixel]:
    """Yield the faces, marking those that are visible through or beside the first."""
    alphas = {part.face: part.alpha for part in parts if part.share > 0.0}
    is_see_through = True
    for face in faces:
        if face.standing in NOT_DRAWN:
            yield face
            continue
        standing = face.standing
        if standing != "visible" and face.face in alphas:
            standing = SEEN_THROUGH if is_see_through else SEEN_BESIDE
        is_see_through &= alphas.get(face.face, 1.0) < 1.0
        yield replace(face, standing=standing, alpha=alphas.get(face.face))


def _render_without_edges(
    scene: Scene, plan: RenderPlan, background: Any, x: int, y: int
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the colour of one pixel without edges, as sRGB codes, (4,), and linear, (4,)."""
    for overlay in plan.effects_at("overlay"):
        if overlay.effect.is_explained:
            scene = overlay.effect.without(scene)
    if not plan.facts.draws_faces:
        scene = with_field(scene, "nodes", [Node(EMPTY_MESH, np.eye(4), "nothing")])
    frame = render(
        scene, plan.camera, size=plan.size, quality=plan.quality, outputs=("color", "linear"),
        background=background, cull=plan.cull, threads=1,
    )  # fmt: skip
    return frame.color[y, x], frame.linear[y, x]


def _draw_visibility(scene: Scene, plan: RenderPlan) -> VisibleScene:
    """Run the stages of `render` up to visibility."""
    workers = Workers(1)
    cache = update_cache(scene.nodes, None, plan.quality, scene.environment is not None)
    arrays = cache.shapes.arrays
    views = object_transforms.transform_nodes_to_view(scene.nodes, plan.camera, plan.size)
    seen = find_visible(
        plan, cache, workers, lambda _: None, views, depth=True, draws=True, lists=True,
        clip_positions=True,
    )  # fmt: skip
    coverage, objects, geometry = seen.coverage, seen.objects, seen.geometry
    lists = coverage.lists
    if objects.culled_windings.any():
        # The faces that are turned away, too.
        unculled_objects = Objects(objects.face_starts, np.zeros_like(objects.culled_windings))
        starts, binned, _, _ = visibility_pass.set_up_and_bin(
            lists.faces, unculled_objects, coverage.screen, geometry.viewport, workers
        )
        lists = visibility_pass.TileLists(starts, binned, lists.faces)
    if plan.pictures > 1:
        spacing = supersample.sample_spacing(plan.facts.supersamples)
        geometry = geometry._replace(viewport=geometry.viewport._replace(spacing=spacing))
    placement = frame_shading.adjust_placement(plan, seen.placement)
    seen = seen._replace(geometry=geometry, placement=placement)
    primitives = collect_primitives(
        arrays.primitives, views.relative_from_model,
        cache.shapes.positions(plan.quality.precision), views.clip_from_relative, plan.size,
    )  # fmt: skip
    return VisibleScene(scene, cache, plan, arrays, seen, lists, primitives)


def _find_corners(triangles: NDArray[np.int32], faces: Faces) -> NDArray[np.int32]:
    """Return the vertex numbers, (N, 3), of triangles of the lists: faces, then pieces."""
    count = len(faces.faces)
    whole = faces.faces[np.minimum(triangles, count - 1)]
    if not len(faces.pieces):
        return whole
    pieces = faces.pieces[np.maximum(triangles - count, 0)]
    return np.where((triangles < count)[:, np.newaxis], whole, pieces)


def _find_source_faces(triangles: NDArray[np.int32], faces: Faces) -> NDArray[np.int32]:
    """Return the face of each triangle of the lists: itself, or the one that it is a piece of."""
    count = len(faces.faces)
    numbers = np.append(np.arange(count, dtype=np.int32), faces.piece_faces)
    return numbers[triangles]


def _snap_center(x: int, y: int, grid_bits: int) -> tuple[int, int]:
    """Return a pixel's centre in steps of the sub-pixel grid."""
    half = 1 << (grid_bits - 1)
    return (x << grid_bits) + half, (y << grid_bits) + half


def _find_faces(drawn: VisibleScene, x: int, y: int) -> list[FaceAtPixel]:
    """Return the faces that cover a pixel's centre: visible, hidden, culled, cut out."""
    lists = drawn.lists
    starts, binned, faces = lists.starts, lists.binned, lists.faces
    coverage, viewport = drawn.seen.coverage, drawn.seen.geometry.viewport._replace(spacing=1.0)
    columns = -(-viewport.width // setup.TILE_SIZE)
    tile = (y // setup.TILE_SIZE) * columns + x // setup.TILE_SIZE
    listed = binned[starts[tile] : starts[tile + 1]]
    # Keep triangles with the centre on one side of all edges, or on an edge.
    a, b, c = np.moveaxis(coverage.screen.xy[_find_corners(listed, faces)].astype(np.int64), 1, 0)
    point = np.array(_snap_center(x, y, viewport.grid_bits))
    sides = np.stack([_edges_at(b, c, point), _edges_at(c, a, point), _edges_at(a, b, point)])
    candidates = listed[(sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)]
    # Draw each alone, so that coverage and depth are those of a frame.
    depth = np.empty((viewport.height, viewport.width), coverage.depth.dtype)
    face_id = np.empty((viewport.height, viewport.width), np.int32)
    single = np.empty(1, np.int32)
    drawer = tile_rasterizer.make_tile_drawer(
        single, faces, coverage.screen, depth.dtype, coverage.alpha_tests
    )
    no_depth_bounds = np.full(len(starts) - 1, tile_rasterizer.get_empty_depth(depth.dtype))
    single_starts = np.zeros(len(starts), np.int64)
    single_starts[tile + 1 :] = 1
    unculled = coverage.lists.binned[coverage.lists.starts[tile] : coverage.lists.starts[tile + 1]]
    unculled = set(unculled)
    arguments = (
        np.array([tile], np.int32), tile_rasterizer.NO_COUNTER, single_starts, no_depth_bounds,
        viewport, (depth, face_id), *drawer[:2],
    )  # fmt: skip
    entries = []
    for triangle in candidates:
        single[0] = triangle
        tile_rasterizer.draw_tiles(*arguments, make_empty_queue(depth.dtype))
        if face_id[y, x] < 0:
            continue
        entry = -float(depth[y, x]), int(face_id[y, x]), triangle
        fate = "" if triangle in unculled else "culled"
        if not fate and coverage.alpha_tests is not None:
            tile_rasterizer.draw_tiles(*arguments, drawer.alpha_queue)
            fate = "" if face_id[y, x] >= 0 else "cut out"
        entries.append((fate, *entry))
    points = None if coverage.points is None else coverage.points.picture
    if points is not None and points[1][y, x] >= 0:
        # Only the nearest disc or sphere is known.
        entries.append(("", -float(points[0][y, x]), int(points[1][y, x]), points[1][y, x]))
    return [_describe_face(drawn, x, y, *entry) for entry in sorted(entries)]


def _edges_at(
    a: NDArray[np.int64], b: NDArray[np.int64], point: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the edge functions of many edges at one point."""
    edge, offset = b - a, point - a
    return edge[:, 0] * offset[:, 1] - edge[:, 1] * offset[:, 0]


def _describe_face(
    drawn: VisibleScene, x: int, y: int, fate: str, nearness: float, face: int, triangle: np.int32
) -> FaceAtPixel:
    """
    Collect all numbers of one face at one pixel.

    ``fate`` is "culled", "cut out" or ""; ``nearness`` the negated stored depth.
    """
    arrays, geometry, coverage = drawn.arrays, drawn.seen.geometry, drawn.seen.coverage
    owner = find_object(drawn, face)
    node, first = drawn.scene.nodes[owner], int(drawn.cache.shapes.corner_offsets[face])
    # Order the vertices as in the mesh, like the weights of a frame.
    vertices = np.roll(arrays.faces[face], first)
    model = arrays.positions[vertices]
    world = transform_points(node.world_from_model, model)[:, :3]
    clip = geometry.clip_positions[vertices]
    ndc = np.full((3, 3), np.nan)
    in_front = clip[:, 3] > 0.0
    ndc[in_front] = clip[in_front, :3] / clip[in_front, 3:]
    width, height = drawn.plan.size
    screen = (ndc[:, :2] * (1.0, -1.0) + 1.0) * (width / 2.0, height / 2.0)
    codes = [int(code) for code in geometry.codes[vertices]]
    clipped = any(code & setup.CLIPPED for code in codes)
    if vertices[1] == vertices[2]:
        # The outcodes of vertices have no meaning for a segment or a point.
        codes = [0, 0, 0]
    corners = _find_corners(np.array([triangle]), drawn.lists.faces)[0]
    if triangle == face:
        corners = vertices
    snapped = coverage.screen.xy[corners].astype(np.int64)
    point = _snap_center(x, y, geometry.viewport.grid_bits)
    edges, biases = _exact_edge_functions(snapped.tolist(), point)
    affine, weights = _exact_weights(
        snapped.tolist(), clip, clipped, point, (x, y), drawn.plan.size, vertices[1] == vertices[2]
    )
    stored = coverage.depth.dtype.type(-nearness)
    if drawn.plan.is_affine and not clipped:
        weights = affine
    standing = "hidden"
    if fate:
        standing = fate
    elif face == coverage.face_id[y, x]:
        standing = "visible"
    elif stored == coverage.depth[y, x]:
        standing = "tied"
    ndc_x, ndc_y = (2.0 * x + 1.0) / width - 1.0, 1.0 - (2.0 * y + 1.0) / height
    with np.errstate(over="ignore"):
        reversed_depth = drawn.plan.depth_format.reversed_depth(stored, ndc_x, ndc_y)
        depth = float(np.float32(drawn.plan.camera.view_depth(reversed_depth)))
    return FaceAtPixel(
        standing=standing,
        face=face,
        object_number=owner,
        object_name=node.name,
        mesh_face=face - int(arrays.face_starts[owner]),
        mesh_vertices=tuple((vertices - arrays.vertex_starts[owner]).tolist()),
        model=model,
        world=world,
        view=transform_points(drawn.plan.camera.view_matrix(), world)[:, :3],
        clip=clip,
        ndc=ndc,
        screen=screen,
        outcodes=tuple(
            tuple(word for bit, word in OUTCODE_NAMES.items() if code & bit) for code in codes
        ),
        clipped=clipped,
        snapped=snapped,
        grid_bits=geometry.viewport.grid_bits,
        edges=edges,
        biases=biases,
        affine_weights=affine,
        weights=weights,
        stored_depth=float(stored),
        depth=depth,
        primitive=_describe_primitive(drawn, owner, face, clip, weights, (x, y)),
    )


def _describe_primitive(
    drawn: VisibleScene,
    owner: int,
    face: int,
    clip: NDArray[np.float64],
    weights: Weights,
    pixel: tuple[int, int],
) -> PrimitiveAtPixel | None:
    """Return position and size of a point or a segment in the picture; None for a triangle."""
    primitives = drawn.primitives
    group = None if primitives is None else primitives.find(owner)
    if primitives is None or group is None:
        return None
    size = group.sizes[(face - group.faces[0]) % len(group.sizes)]
    with np.errstate(over="ignore", invalid="ignore"):
        position = np.array([float(weight) for weight in weights]) @ clip
    picture_size = np.array(drawn.plan.size, np.float64)
    # Behind the eye there is no position and no size in the picture.
    w = position[3] if position[3] > 0.0 else np.nan
    centre = (position[:2] / w * (1.0, -1.0) + 1.0) * (picture_size / 2.0)
    pixels_per_unit = np.ones(2)
    if group.is_world:
        is_point = isinstance(group.rule, PointRule)
        units = primitives.lengths if is_point else (primitives.units,) * 2
        pixels_per_unit = np.array(units) * primitives.scales[owner] / w
    return PrimitiveAtPixel(
        kind=group.rule.shape if isinstance(group.rule, PointRule) else "segment",
        place=centre,
        size=size * pixels_per_unit,
        offset=np.array(pixel) + 0.5 - centre,
    )


def _exact_edge_functions(
    triangle: list[list[int]], point: tuple[int, int]
) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
    """Return the exact edge functions opposite the vertices, positive inside, and their biases."""
    from rasterjit.inspect import oracle

    a, b, c = triangle
    winding = 1 if oracle.edge(a, b, c) > 0 else -1
    edges, biases = [], []
    for start, end in ((b, c), (c, a), (a, b)):
        edges.append(winding * oracle.edge(start, end, point))
        dx, dy = winding * (end[0] - start[0]), winding * (end[1] - start[1])
        biases.append(0 if dy < 0 or (dy == 0 and dx > 0) else -1)
    return tuple(edges), tuple(biases)


def _exact_weights(
    triangle: list[list[int]],
    clip: NDArray[np.float64],
    clipped: bool,
    point: tuple[int, int],
    pixel: tuple[int, int],
    size: tuple[int, int],
    is_segment: bool,
) -> tuple[Weights, Weights]:
    """Return the exact affine weights on the triangle drawn, and those of the face's vertices."""
    from fractions import Fraction

    from rasterjit.inspect import oracle

    if triangle[0] == triangle[1] == triangle[2]:
        # A disc or a sphere is at its centre.
        return (Fraction(1), Fraction(0), Fraction(0)), (Fraction(1), Fraction(0), Fraction(0))
    affine = oracle.affine_weights(triangle, point)
    if not clipped:
        return affine, oracle.perspective_weights(triangle, clip[:, 3].tolist(), point)
    centre = (Fraction(2 * pixel[0] + 1, 2), Fraction(2 * pixel[1] + 1, 2))
    if is_segment:
        return affine, _exact_segment_weights(clip.tolist(), centre, size)
    try:
        weights = oracle.clip_weights(clip.tolist(), centre, size)
    except ValueError:
        # Seen exactly from its side: frames take the first vertex.
        return affine, (Fraction(1), Fraction(0), Fraction(0))
    # Snapping may put a sample on a piece that lies beside the face: clamp as frames do.
    clamped = [max(weight, Fraction(0)) for weight in weights]
    return affine, tuple(weight / sum(clamped) for weight in clamped)


def _exact_segment_weights(
    clip: list[list[float]], point: tuple[Fraction, Fraction], size: tuple[int, int]
) -> Weights:
    """Return the weights of a segment, or of a point, at the foot of the perpendicular on it."""
    from fractions import Fraction

    # Offset of each end from the sample, in pixels times twice its w.
    (x0, y0, w0), (x1, y1, w1) = (
        (
            (Fraction(x) + Fraction(w)) * size[0] - 2 * point[0] * Fraction(w),
            (Fraction(w) - Fraction(y)) * size[1] - 2 * point[1] * Fraction(w),
            Fraction(w),
        )
        for x, y, _, w in clip[:2]
    )
    dx, dy = x1 * w0 - x0 * w1, y1 * w0 - y0 * w1
    first, second = x0 * dx + y0 * dy, x1 * dx + y1 * dy
    if first == second or (first >= 0 and w0 > 0):
        return Fraction(1), Fraction(0), Fraction(0)
    is_beyond_end = second <= 0 and w1 > 0
    weight = min(max(first / (first - second), Fraction(0)), Fraction(1))
    weight = Fraction(1) if is_beyond_end else weight
    return 1 - weight, weight, Fraction(0)


def _explain_background(
    drawn: VisibleScene, faces: tuple[FaceAtPixel, ...], x: int, y: int
) -> tuple[str, ...]:
    """Return why no face is visible at a pixel, in words."""
    reasons = []
    if faces:
        for standing in dict.fromkeys(face.standing for face in faces):
            numbers = ", ".join(str(face.face) for face in faces if face.standing == standing)
            reasons.append(f"{standing} faces cover it: {numbers}")
    else:
        reasons.append("no face covers the pixel's centre")
    totals = drawn.seen.coverage.totals
    nearest = _find_nearest_face(drawn, x, y)
    if nearest:
        face, distance = nearest
        reasons.append(f"the nearest face drawn is {face}, {distance:.3g} pixels away")
    fates = [
        (totals.outside, "outside the view"), (totals.culled, "turned away"),
        (totals.degenerate, "without area"), (totals.unsampled, "between pixel centres"),
        (totals.invalid, "invalid"), (totals.drawn, "drawn elsewhere"),
    ]  # fmt: skip
    counts = ", ".join(f"{count:,} {fate}" for count, fate in fates if count)
    reasons.append(f"of {totals.faces_in:,} faces: {counts}")
    return tuple(reasons)


def _find_nearest_face(drawn: VisibleScene, x: int, y: int) -> tuple[int, float] | None:
    """
    Return the drawn face nearest to a pixel's centre on the screen, and its distance, pixels.

    The distance of a disc or sphere is that of the nearest pixel that shows it. None without faces.
    """
    candidates = [*_find_nearest_triangle(drawn, x, y), *_find_nearest_point(drawn, x, y)]
    return min(candidates, key=lambda candidate: candidate[1], default=None)


def _find_nearest_point(drawn: VisibleScene, x: int, y: int) -> Iterator[tuple[int, float]]:
    """Yield the disc or sphere at the nearest covered pixel, and its distance."""
    points = drawn.seen.coverage.points
    if points is not None and points.picture is not None:
        rows, columns = np.nonzero(points.picture[1] >= 0)
        if len(rows):
            distances = np.hypot(rows - y, columns - x)
            n = int(distances.argmin())
            yield int(points.picture[1][rows[n], columns[n]]), float(distances[n])


def _find_nearest_triangle(drawn: VisibleScene, x: int, y: int) -> Iterator[tuple[int, float]]:
    """Yield the nearest face drawn as triangles, and its distance."""
    triangles = np.unique(drawn.seen.coverage.lists.binned)
    if not len(triangles):
        return
    steps_per_pixel = float(1 << drawn.seen.geometry.viewport.grid_bits)
    numbers = _find_corners(triangles, drawn.lists.faces)
    corners = drawn.seen.coverage.screen.xy[numbers] / steps_per_pixel
    point = np.array([x + 0.5, y + 0.5])
    distances = np.full(len(triangles), np.inf)
    for k in range(3):
        start, edge = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        squared = np.maximum((edge * edge).sum(axis=1), 1.0 / steps_per_pixel**2)
        parameter = np.clip(((point - start) * edge).sum(axis=1) / squared, 0.0, 1.0)
        offset = start + parameter[:, np.newaxis] * edge - point
        distances = np.minimum(distances, np.hypot(offset[:, 0], offset[:, 1]))
    n = int(distances.argmin())
    yield int(_find_source_faces(triangles, drawn.lists.faces)[n]), float(distances[n])
