"""
Explain one pixel: which faces cover it, which of them is seen, and how its colour came about.

The numbers are the engine's own: the same stages transform, clip, snap, bin, draw and shade, asked
for one pixel. Where the engine rounds, the exact value is shown beside it, from the oracle.
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
    color_parts,
    find_surface,
    light_terms,
    object_of,
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
from rasterjit.outputs.ground_truth import add_reversed_depth
from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.geometry import setup
from rasterjit.pipeline.records import Faces, Objects
from rasterjit.pipeline.visibility import tile_rasterizer, visibility_pass
from rasterjit.pipeline.visibility.alpha_test import no_holes
from rasterjit.pipeline.visibility.primitive_expansion import PointRule, primitives_of
from rasterjit.rendering import frame_shading, planning, supersample
from rasterjit.rendering.planning import Cull, check_request, choose_camera, cut_open
from rasterjit.rendering.renderer import render
from rasterjit.runtime.background_compile import beside
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
from rasterjit.survey.packed_scene import make_placement
from rasterjit.survey.plan import RenderPlan

if TYPE_CHECKING:
    from fractions import Fraction

OUTCODE_WORDS = {
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
    Say what happened at one pixel, stage by stage.

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
    camera, scene = choose_camera(scene, camera, size), cut_open(scene)
    request = check_request(size, quality, ("color", "linear"), background, cull)
    plan = planning.plan_frame(request, scene, camera)
    with beside(partial(planning.list_tasks, plan)):
        return _explain(scene, plan, background, x, y)


def _explain(scene: Scene, plan: RenderPlan, background: Any, x: int, y: int) -> PixelExplanation:
    """Draw a planned frame as far as visibility, and explain one pixel."""
    drawn = _draw(scene, plan)
    faces = tuple(_find_faces(drawn, x, y))
    light, linear, look, parts = None, plan.background, None, ()
    if drawn.seen.coverage.face_id[y, x] >= 0 and plan.facts.draws_faces:
        look = find_surface(drawn)
        light, linear = light_terms(drawn, *look, x, y)
    plain = seen = np.array([srgb_encoding.code_of(linear, plan.facts.encoding)], np.uint32).view(
        np.uint8
    )
    if not all(planned.effect.is_explained for planned in plan.planned):
        plain, seen_linear = _seen_without_edges(scene, plan, background, x, y)
        if plan.facts.draws_faces and (light is not None or plan.layers is not None):
            look = look or find_surface(drawn)
            parts = color_parts(drawn, *look, linear, seen_linear, x, y)
            faces = tuple(_mark(faces, parts))
        seen, linear = plain, seen_linear
    if any(one.effect.is_explained for one in plan.effects_at("overlay")):
        frame = render(
            scene, plan.camera, size=plan.size, quality=plan.quality, background=background,
            cull=plan.cull, threads=1,
        )  # fmt: skip
        seen = frame.color[y, x]
    faces, parts = _unsplit(drawn, faces), _unsplit_parts(drawn, parts)
    reasons = () if drawn.seen.coverage.face_id[y, x] >= 0 else _why_empty(drawn, faces, x, y)
    return PixelExplanation(
        x, y, plan.size, faces, reasons, light, parts, linear, seen, not np.array_equal(plain, seen)
    )


def _unsplit(drawn: VisibleScene, faces: tuple[FaceAtPixel, ...]) -> tuple[FaceAtPixel, ...]:
    """Return faces renumbered to the scene before a section cut it."""
    cut = drawn.cache.cut
    if cut is None:
        return faces
    found = []
    for face in faces:
        number, owner = cut.original_numbers(face.face, face.object_number)
        is_cap = number >= cut.face_starts[-1]
        found.append(
            replace(
                face,
                face=number,
                object_number=owner,
                mesh_face=-1 if is_cap else number - int(cut.face_starts[owner]),
                mesh_vertices=cut.vertices_of(face.object_number, face.mesh_vertices),
            )
        )
    return tuple(found)


def _unsplit_parts(drawn: VisibleScene, parts: tuple[ColorPart, ...]) -> tuple[ColorPart, ...]:
    """Return the parts of a colour renumbered to the scene before a section cut it."""
    cut = drawn.cache.cut
    if cut is None:
        return parts
    return tuple(
        part if part.face is None else replace(part, face=int(cut.face_numbers[part.face]))
        for part in parts
    )


def _mark(faces: tuple[FaceAtPixel, ...], parts: tuple[ColorPart, ...]) -> Iterator[FaceAtPixel]:
    """Yield the faces, marking those that are visible through or beside the first."""
    alphas = {part.face: part.alpha for part in parts if part.share > 0.0}
    is_open = True
    for face in faces:
        if face.standing in NOT_DRAWN:
            yield face
            continue
        standing = face.standing
        if standing != "visible" and face.face in alphas:
            standing = SEEN_THROUGH if is_open else SEEN_BESIDE
        is_open &= alphas.get(face.face, 1.0) < 1.0
        yield replace(face, standing=standing, alpha=alphas.get(face.face))


def _seen_without_edges(
    scene: Scene, plan: RenderPlan, background: Any, x: int, y: int
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the colour of one pixel, as codes (4,) and linear (4,), before edges are drawn."""
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


def _draw(scene: Scene, plan: RenderPlan) -> VisibleScene:
    """Run the stages of `render` up to visibility."""
    workers = Workers(1)
    cache = update_cache(scene.nodes, None, plan.quality, scene.environment is not None)
    arrays = cache.shapes.arrays
    views = object_transforms.transform_nodes_to_view(scene.nodes, plan.camera, plan.size)
    viewport = visibility_pass.viewport_of(plan.size, plan.quality.subpixel_bits)
    objects = object_transforms.cull_objects(
        plan.cull, views.screen_winding, views.mirrored, arrays.face_starts,
        cache.tables.is_single_sided, arrays.primitive_numbers,
    )  # fmt: skip
    vertices = visibility_pass.ModelVertices(
        cache.shapes.positions(plan.quality.precision), arrays.vertex_starts,
        views.relative_from_model, views.clip_from_relative,
    )  # fmt: skip
    alpha_tests = frame_shading.find_hit_tests(plan, cache)
    primitives = primitives_of(
        arrays.primitives, views.relative_from_model, vertices.positions,
        views.clip_from_relative, plan.size,
    )  # fmt: skip
    drawable = visibility_pass.Drawable(
        vertices, arrays.faces, objects, plan.depth_format.coefficients, viewport,
        alpha_tests=alpha_tests, primitives=primitives, is_affine=plan.is_affine,
    )  # fmt: skip
    wanted = visibility_pass.VisibilityOptions(
        lists=True, clip_positions=True, depth_type=plan.depth_format.kind
    )
    coverage = visibility_pass.run_visibility(drawable, wanted, workers, lambda _: None)
    lists = coverage.lists
    if objects.culled_windings.any():
        # List the culled faces as well.
        everything = Objects(objects.face_starts, np.zeros_like(objects.culled_windings))
        starts, binned, _, _ = visibility_pass.set_up_and_bin(
            lists.faces, everything, coverage.screen, viewport, workers
        )
        lists = visibility_pass.TileLists(starts, binned, lists.faces)
    # Colours are those of one sample of many; what is seen at the centres is that of any quality.
    if plan.pictures > 1:
        viewport = viewport._replace(spacing=supersample.sample_spacing(plan.facts.supersamples))
    geometry = visibility_pass.geometry_of(
        arrays.faces, coverage.screen, coverage.clip_positions, viewport, plan.is_affine
    )
    placed = make_placement(arrays, views)
    coverage = add_reversed_depth(
        plan.depth_format, plan.camera, geometry, coverage, workers, placed
    )
    placement = frame_shading.placement_to_light(plan, placed)
    seen = visibility_pass.Seen(
        objects, plan.depth_format.coefficients, geometry, placement, coverage
    )
    return VisibleScene(scene, cache, plan, arrays, seen, lists, primitives)


def _corners(triangles: NDArray[np.int32], faces: Faces) -> NDArray[np.int32]:
    """Return the vertex numbers, (N, 3), of faces and pieces as the lists number them."""
    count = len(faces.faces)
    own = faces.faces[np.minimum(triangles, count - 1)]
    if not len(faces.pieces):
        return own
    pieces = faces.pieces[np.maximum(triangles - count, 0)]
    return np.where((triangles < count)[:, np.newaxis], own, pieces)


def _faces_of(triangles: NDArray[np.int32], faces: Faces) -> NDArray[np.int32]:
    """Return the face that each triangle of the lists was cut from, or is."""
    count = len(faces.faces)
    numbers = np.append(np.arange(count, dtype=np.int32), faces.piece_faces)
    return numbers[triangles]


def _centre(x: int, y: int, grid_bits: int) -> tuple[int, int]:
    """Return a pixel's centre in steps of the grid."""
    half = 1 << (grid_bits - 1)
    return (x << grid_bits) + half, (y << grid_bits) + half


def _find_faces(drawn: VisibleScene, x: int, y: int) -> list[FaceAtPixel]:
    """Return the faces that cover a pixel's centre: seen, hidden by depth, culled, cut out."""
    lists = drawn.lists
    starts, binned, faces = lists.starts, lists.binned, lists.faces
    coverage, viewport = drawn.seen.coverage, drawn.seen.geometry.viewport._replace(spacing=1.0)
    columns = -(-viewport.width // setup.TILE_SIZE)
    tile = (y // setup.TILE_SIZE) * columns + x // setup.TILE_SIZE
    listed = binned[starts[tile] : starts[tile + 1]]
    # Keep those that the centre may be in: on the inner side of all edges, or on one.
    a, b, c = np.moveaxis(coverage.screen.xy[_corners(listed, faces)].astype(np.int64), 1, 0)
    point = np.array(_centre(x, y, viewport.grid_bits))
    sides = np.stack([_edges(b, c, point), _edges(c, a, point), _edges(a, b, point)])
    near = listed[(sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)]
    # Draw each alone: what it covers, and how deep it is there, is the engine's word.
    depth = np.empty((viewport.height, viewport.width), coverage.depth.dtype)
    face_id = np.empty((viewport.height, viewport.width), np.int32)
    one = np.empty(1, np.int32)
    drawer = tile_rasterizer.tile_drawer(
        one, faces, coverage.screen, depth.dtype, coverage.alpha_tests
    )
    bottomless = np.full(len(starts) - 1, tile_rasterizer.empty_depth(depth.dtype))
    alone = np.zeros(len(starts), np.int64)
    alone[tile + 1 :] = 1
    kept = set(coverage.lists.binned[coverage.lists.starts[tile] : coverage.lists.starts[tile + 1]])
    arguments = (
        np.array([tile], np.int32), tile_rasterizer.ALL, alone, bottomless, viewport,
        (depth, face_id), *drawer[:2],
    )  # fmt: skip
    found = []
    for triangle in near:
        one[0] = triangle
        tile_rasterizer.draw_tiles(*arguments, no_holes(depth.dtype))
        if face_id[y, x] < 0:
            continue
        entry = -float(depth[y, x]), int(face_id[y, x]), triangle
        lost = "" if triangle in kept else "culled"
        if not lost and coverage.alpha_tests is not None:
            tile_rasterizer.draw_tiles(*arguments, drawer.holes)
            lost = "" if face_id[y, x] >= 0 else "cut out"
        found.append((lost, *entry))
    points = None if coverage.points is None else coverage.points.picture
    if points is not None and points[1][y, x] >= 0:
        # Of discs and spheres the nearest is known.
        found.append(("", -float(points[0][y, x]), int(points[1][y, x]), points[1][y, x]))
    return [_face_at(drawn, x, y, *entry) for entry in sorted(found)]


def _edges(
    a: NDArray[np.int64], b: NDArray[np.int64], point: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the edge functions of many edges at one point."""
    along, away = b - a, point - a
    return along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0]


def _face_at(
    drawn: VisibleScene, x: int, y: int, lost: str, nearness: float, face: int, triangle: np.int32
) -> FaceAtPixel:
    """Collect all numbers of one face at one pixel."""
    arrays, geometry, coverage = drawn.arrays, drawn.seen.geometry, drawn.seen.coverage
    owner = object_of(drawn, face)
    node, first = drawn.scene.nodes[owner], int(drawn.cache.shapes.corner_offsets[face])
    # As the mesh lists them, like the weights of a frame.
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
        # What its vertices are outside of says nothing of a segment or a point.
        codes = [0, 0, 0]
    corners = _corners(np.array([triangle]), drawn.lists.faces)[0]
    if triangle == face:
        corners = vertices
    snapped = coverage.screen.xy[corners].astype(np.int64)
    point = _centre(x, y, geometry.viewport.grid_bits)
    edges, biases = _edge_functions(snapped.tolist(), point)
    affine, weights = _weights(
        snapped.tolist(), clip, clipped, point, (x, y), drawn.plan.size, vertices[1] == vertices[2]
    )
    stored = coverage.depth.dtype.type(-nearness)
    if drawn.plan.is_affine and not clipped:
        weights = affine
    standing = "hidden"
    if lost:
        standing = lost
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
            tuple(word for bit, word in OUTCODE_WORDS.items() if code & bit) for code in codes
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
        primitive=_primitive_at(drawn, owner, face, clip, weights, (x, y)),
    )


def _primitive_at(
    drawn: VisibleScene,
    owner: int,
    face: int,
    clip: NDArray[np.float64],
    weights: Weights,
    pixel: tuple[int, int],
) -> PrimitiveAtPixel | None:
    """Describe the position of a point or a segment in the picture; None for a triangle."""
    primitives = drawn.primitives
    found = None if primitives is None else primitives.find(owner)
    if primitives is None or found is None:
        return None
    own = found.sizes[(face - found.faces[0]) % len(found.sizes)]
    with np.errstate(over="ignore", invalid="ignore"):
        place = np.array([float(share) for share in weights]) @ clip
    size = np.array(drawn.plan.size, np.float64)
    # What lies behind the eye is nowhere in the picture, and has no size there.
    w = place[3] if place[3] > 0.0 else np.nan
    centre = (place[:2] / w * (1.0, -1.0) + 1.0) * (size / 2.0)
    across = np.ones(2)
    if found.is_world:
        is_point = isinstance(found.rule, PointRule)
        units = primitives.lengths if is_point else (primitives.units,) * 2
        across = np.array(units) * primitives.scales[owner] / w
    return PrimitiveAtPixel(
        kind=found.rule.shape if isinstance(found.rule, PointRule) else "segment",
        place=centre,
        size=own * across,
        offset=np.array(pixel) + 0.5 - centre,
    )


def _edge_functions(
    triangle: list[list[int]], point: tuple[int, int]
) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
    """Return the exact edge functions opposite the vertices, positive inside, and their biases."""
    from rasterjit.inspect import oracle

    a, b, c = triangle
    turn = 1 if oracle.edge(a, b, c) > 0 else -1
    edges, biases = [], []
    for start, end in ((b, c), (c, a), (a, b)):
        edges.append(turn * oracle.edge(start, end, point))
        dx, dy = turn * (end[0] - start[0]), turn * (end[1] - start[1])
        biases.append(0 if dy < 0 or (dy == 0 and dx > 0) else -1)
    return tuple(edges), tuple(biases)


def _weights(
    triangle: list[list[int]],
    clip: NDArray[np.float64],
    clipped: bool,
    point: tuple[int, int],
    pixel: tuple[int, int],
    size: tuple[int, int],
    is_segment: bool,
) -> tuple[Weights, Weights]:
    """Return the exact weights on the triangle drawn, and those of the face's own vertices."""
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
        return affine, _segment_weights(clip.tolist(), centre, size)
    try:
        shares = oracle.clip_weights(clip.tolist(), centre, size)
    except ValueError:
        # Seen exactly from its side: the engine takes the first vertex.
        return affine, (Fraction(1), Fraction(0), Fraction(0))
    # Snapping may put a sample on a piece that lies beside the face: held as the engine does.
    held = [max(share, Fraction(0)) for share in shares]
    return affine, tuple(share / sum(held) for share in held)


def _segment_weights(
    clip: list[list[float]], point: tuple[Fraction, Fraction], size: tuple[int, int]
) -> Weights:
    """Return the weights of a segment, or of a point, at the foot of the perpendicular on it."""
    from fractions import Fraction

    # How far each end lies from the sample, pixels times twice its w.
    (x0, y0, w0), (x1, y1, w1) = (
        (
            (Fraction(x) + Fraction(w)) * size[0] - 2 * point[0] * Fraction(w),
            (Fraction(w) - Fraction(y)) * size[1] - 2 * point[1] * Fraction(w),
            Fraction(w),
        )
        for x, y, _, w in clip[:2]
    )
    along, down = x1 * w0 - x0 * w1, y1 * w0 - y0 * w1
    first, second = x0 * along + y0 * down, x1 * along + y1 * down
    if first == second or (first >= 0 and w0 > 0):
        return Fraction(1), Fraction(0), Fraction(0)
    is_behind = second <= 0 and w1 > 0
    share = min(max(first / (first - second), Fraction(0)), Fraction(1))
    share = Fraction(1) if is_behind else share
    return 1 - share, share, Fraction(0)


def _why_empty(
    drawn: VisibleScene, faces: tuple[FaceAtPixel, ...], x: int, y: int
) -> tuple[str, ...]:
    """Say why no face is visible at a pixel."""
    reasons = []
    if faces:
        for lost in dict.fromkeys(face.standing for face in faces):
            names = ", ".join(str(face.face) for face in faces if face.standing == lost)
            reasons.append(f"{lost} faces cover it: {names}")
    else:
        reasons.append("no face covers the pixel's centre")
    totals = drawn.seen.coverage.totals
    nearest_drawn = _nearest_face(drawn, x, y)
    if nearest_drawn:
        face, distance = nearest_drawn
        reasons.append(f"the nearest face drawn is {face}, {distance:.3g} pixels away")
    fates = [
        (totals.outside, "outside the view"), (totals.culled, "turned away"),
        (totals.degenerate, "without area"), (totals.unsampled, "between pixel centres"),
        (totals.invalid, "invalid"), (totals.drawn, "drawn elsewhere"),
    ]  # fmt: skip
    shares = ", ".join(f"{count:,} {fate}" for count, fate in fates if count)
    reasons.append(f"of {totals.faces_in:,} faces: {shares}")
    return tuple(reasons)


def _nearest_face(drawn: VisibleScene, x: int, y: int) -> tuple[int, float] | None:
    """
    Return the drawn face nearest to a pixel's centre on the screen, and its distance, pixels.

    That of discs and spheres is how far the nearest pixel is that shows one. None: none is drawn.
    """
    found = [*_nearest_triangle(drawn, x, y), *_nearest_point(drawn, x, y)]
    return min(found, key=lambda one: one[1], default=None)


def _nearest_point(drawn: VisibleScene, x: int, y: int) -> Iterator[tuple[int, float]]:
    """Yield the disc or sphere at the nearest covered pixel, and its distance."""
    points = drawn.seen.coverage.points
    if points is not None and points.picture is not None:
        rows, columns = np.nonzero(points.picture[1] >= 0)
        if len(rows):
            gaps = np.hypot(rows - y, columns - x)
            n = int(gaps.argmin())
            yield int(points.picture[1][rows[n], columns[n]]), float(gaps[n])


def _nearest_triangle(drawn: VisibleScene, x: int, y: int) -> Iterator[tuple[int, float]]:
    """Yield the nearest face drawn as triangles, and its distance."""
    triangles = np.unique(drawn.seen.coverage.lists.binned)
    if not len(triangles):
        return
    unit = float(1 << drawn.seen.geometry.viewport.grid_bits)
    corners = drawn.seen.coverage.screen.xy[_corners(triangles, drawn.lists.faces)] / unit
    point = np.array([x + 0.5, y + 0.5])
    best = np.full(len(triangles), np.inf)
    for k in range(3):
        start, along = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        squared = np.maximum((along * along).sum(axis=1), 1.0 / unit**2)
        share = np.clip(((point - start) * along).sum(axis=1) / squared, 0.0, 1.0)
        gap = start + share[:, np.newaxis] * along - point
        best = np.minimum(best, np.hypot(gap[:, 0], gap[:, 1]))
    n = int(best.argmin())
    yield int(_faces_of(triangles, drawn.lists.faces)[n]), float(best[n])
