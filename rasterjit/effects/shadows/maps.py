"""
Fit shadow maps to the visible part of the scene, draw them, and make soft shadow sample points.

The part of space that a map shows is found from the depth buffer [1]_: the cells of a grid over the
picture, each from its nearest to its farthest sample, are taken to the light's axes, and the map
reaches around them. Where the depth does not tell, behind glass and between the centres of pixels,
it reaches around the part in view of the objects that may be seen there.

A map begins at the nearest object between this space and the light, which can cast a shadow into
it, and ends behind the farthest point of this space. Then it is drawn like a picture, by the same
stages.

Soft shadows are looked up with tables made here: points around a sample, in a sunflower [2]_ or a
spiral, and cells of a map that tell how deep a sample must lie to be shaded from far away.

References
----------
.. [1] A. Lauritzen, M. Salvi, A. Lefohn, "Sample Distribution Shadow Maps", I3D 2011.
.. [2] H. Vogel, "A better way to construct the sunflower head", Mathematical Biosciences 44, 1979.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.shadows import filters
from rasterjit.effects.shadows import stage as shadows_stage
from rasterjit.effects.shadows.visible_cells import make_view_cells
from rasterjit.pipeline.records import AlphaTests, Objects, Placement
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.primitive_expansion import Primitive, collect_primitives
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime.threads import Workers
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera
from rasterjit.scene.light import DirectionalLight, Shadow
from rasterjit.survey.light_culling import (
    CastingLight,
    build_basis,
    compute_half_tangent,
    has_cube,
    project_on_axes,
)
from rasterjit.survey.object_transforms import transform_boxes

Float64 = NDArray[np.float64]

FILTERS = {"hard": filters.HARD, "pcf": filters.PCF, "soft": filters.SOFT}

BORDER_TEXELS = 3
"""Texels around the fitted part of a map: the reach of the 3 x 3 comparisons, and one."""

SOFT_BORDER = 1.0 / 16.0
"""Border of each of the six maps of a soft point light, as a share of a map's side."""

MIN_NEAR = 1e-5
"""Least near plane of a light's map, as a share of its far plane."""

WINDOW_SLACK = 1e-6
"""Widening of a map's window, as a share of its size: above the rounding of corners in float64
and of stored depths in float32, well below a texel."""

SUBPIXEL_BITS = 8
"""Binary digits of a texel to which vertices are rounded in a map."""

COMPARISON_COUNT = 32
"""Points of the disk where soft shadows are compared."""

SPIRAL_GROWTHS = (
    1.0905077326652577, 1.0442737824274138, 1.029302236643492, 1.0218971486541166,
    1.0174796921026863, 1.0145453349375237, 1.012454548098765, 1.0108892860517005,
)  # fmt: skip
"""Growth of the radius between two points of a spiral: eight to an octave, 16, 24 .. 64."""

SMOOTH_DEGREES = 8.0
"""Widest sun whose penumbra shows no bands at the least density."""

MAX_SAMPLE_DENSITY = len(SPIRAL_GROWTHS)
"""Most points that soft shadows take, as a multiple of the least."""

GOLDEN_ANGLE = 137.50776405003785
"""Degrees between the points of a sunflower: 180 (3 - sqrt 5)."""


class Scenery(NamedTuple):
    """Shadow casters, and the space that receives shadows; in world axes, relative to the eye."""

    vertices: visibility_pass.ModelVertices
    """The camera's; a light's takes another matrix to clip space."""
    faces: NDArray[np.int32]
    """(F, 3), of the casters."""
    face_starts: NDArray[np.int64]
    """(O+1,)."""
    boxes: Float64
    """(B, 8, 3): corners of the boxes around the casters."""
    cells: Float64
    """(N, 8, 3): corners of the cells that hold all visible surfaces."""
    alpha_tests: AlphaTests | None
    """Of the casters."""
    primitives: tuple[Primitive, ...]
    """The casters whose faces are segments or points."""
    right: tuple[float, ...]
    """The camera's x axis. Maps run along it as far as they can: they fit the view more closely,
    and neighbouring pixels read neighbouring texels."""


class Window(NamedTuple):
    """Bounds of a map along its axes (divided by depth unless parallel)."""

    low: tuple[float, float]
    high: tuple[float, float]
    near: float
    far: float


class PlannedShadows(NamedTuple):
    """The shadow maps of all lights, before any is drawn."""

    layouts: NDArray[np.int64]
    """As in `ShadowRecord`, but the first texel is 0 for each light that may have maps."""


def plan_shadows(lights: Sequence[CastingLight]) -> PlannedShadows:
    """Return the layouts of the maps that lights, those of ``Lighting.lights``, may have."""
    layouts = np.full((len(lights), shadows_stage.LAYOUT_COLUMNS), -1, np.int64)
    for layout, light in zip(layouts, lights, strict=True):
        if light.shadow is not None:
            layout[:] = 0, 0, FILTERS[light.shadow.filter], 6 if has_cube(light) else 1
    return PlannedShadows(layouts)


def allocate_record(lights: Sequence[CastingLight]) -> ShadowRecord:
    """Return a record with memory for the maps of all lights that cast shadows."""
    layouts = plan_shadows(lights).layouts
    count = 0
    cells: list[NDArray[np.float32] | None] = [None] * len(lights)
    for n, light in enumerate(lights):
        if light.shadow is None:
            continue
        size, sides = light.shadow.size, int(layouts[n, shadows_stage.SIDES])
        layouts[n, shadows_stage.FIRST_TEXEL : shadows_stage.MAP_SIDE + 1] = count, size
        count += sides * size * size
        if light.shadow.filter == "soft":
            cells[n] = find_occlusion_limits(np.zeros((sides, size, size), np.float32), 1.0)
    rows = np.zeros((len(lights), shadows_stage.MAP_COLUMNS))
    texels = np.empty(count, np.float32)
    return ShadowRecord(rows, layouts, texels, [*map(find_density, lights)], cells)


class ShadowRecord(NamedTuple):
    """The shadow maps of all lights; see ``stage`` for the columns."""

    maps: Any
    """(L, 23) float64: projection of points to each light's maps."""
    layouts: Any
    """(L, 4) int64: first texel or -1 for no map, side, filter, number of maps."""
    texels: Any
    """(N,) float32, stored depth: greater is nearer to the light, -inf where nothing is."""
    densities: Any
    """L of int: `find_density` of each light."""
    cells: Any
    """L of (N,) float32: `find_occlusion_limits` of each soft light, or None."""


def draw_shadows(
    lights: Sequence[CastingLight],
    eye: Float64,
    scenery: Scenery,
    workers: Workers,
    record: ShadowRecord | None = None,
) -> ShadowRecord | None:
    """
    Draw the shadow maps of the lights that cast shadows on visible surfaces.

    Parameters
    ----------
    lights : sequence of Light
        Those of ``Lighting.lights``, in that order.
    eye : (3,) float64, world space
    scenery : Scenery
    workers : Workers
    record : ShadowRecord, optional
        Of `allocate_record`: its texels are written.

    Returns
    -------
    ShadowRecord or None
        ``None``: no light has a map, or not all that the record has.
    """
    rows = np.zeros((len(lights), shadows_stage.MAP_COLUMNS))
    layouts = np.zeros((len(lights), shadows_stage.LAYOUT_COLUMNS), np.int64)
    layouts[:, shadows_stage.FIRST_TEXEL] = -1
    drawings, count = [], 0
    for n, light in enumerate(lights):
        shadow = light.shadow
        if shadow is None:
            continue
        fitted = _fit_light(light, eye, scenery, rows[n])
        if any(matrix is not None for matrix in fitted):
            layouts[n] = count, shadow.size, FILTERS[shadow.filter], len(fitted)
            for k, matrix in enumerate(fitted):
                part = slice(count, count + shadow.size * shadow.size)
                drawings.append((n, k, shadow, part, matrix))
                count = part.stop
    has_map = layouts[:, shadows_stage.FIRST_TEXEL] >= 0
    expected = has_map if record is None else record.layouts[:, shadows_stage.FIRST_TEXEL] >= 0
    if not drawings or (has_map != expected).any():
        return None
    # Draw all maps into one array, and find the occlusion limits of soft ones.
    texels = workers.memory.empty((count,), np.float32) if record is None else record.texels
    for n, _, shadow, part, matrix in drawings:
        map_texels = texels[part].reshape(shadow.size, shadow.size)
        _draw_map(matrix, rows[n], map_texels, scenery, workers)
    cells: list[NDArray[np.float32] | None] = [None] * len(lights)
    for n, (first, size, kind, sides) in enumerate(layouts.tolist()):
        if first >= 0 and kind == filters.SOFT:
            light_texels = texels[first : first + sides * size * size].reshape(sides, size, size)
            cells[n] = find_occlusion_limits(light_texels, float(rows[n, shadows_stage.WIDENING]))
    return ShadowRecord(rows, layouts, texels, [*map(find_density, lights)], cells)


def _draw_map(
    matrix: Float64 | None,
    row: Float64,
    texels: NDArray[np.float32],
    scenery: Scenery,
    workers: Workers,
) -> None:
    """Draw one map; leave it empty without a matrix."""
    if matrix is None:
        texels.fill(-np.inf)
        return
    size = len(texels)
    no_culling = np.zeros(len(scenery.face_starts) - 1, np.int8)
    coefficients = (
        (0.5, -0.5, 0.0) if row[shadows_stage.PARALLEL] else (row[shadows_stage.NEAR], 0.0, 0.0)
    )
    drawable = visibility_pass.Drawable(
        scenery.vertices._replace(clip_from_relative=matrix), scenery.faces,
        Objects(scenery.face_starts, no_culling), tuple(map(float, coefficients)),
        make_viewport((size, size), SUBPIXEL_BITS), scenery.alpha_tests,
        collect_primitives(scenery.primitives, scenery.vertices.relative_from_model,
        scenery.vertices.positions, matrix, (size, size)),
    )  # fmt: skip
    visibility_pass.run_visibility(
        drawable,
        visibility_pass.VisibilityOptions(faces=False),
        workers,
        lambda _: None,
        depth=texels,
    )


def _fit_light(light: Any, eye: Float64, scenery: Scenery, row: Float64) -> list[Float64 | None]:
    """
    Fit a light's one or six maps; write its row; return ``clip_from_relative`` of each.

    ``None`` stands for a map without receivers, or without casters before them.
    """
    shadow = light.shadow
    row[shadows_stage.BIAS_TEXELS] = shadow.bias
    if isinstance(light, DirectionalLight):
        return [_fit_parallel(light, scenery, row)]
    point = np.array(light.position) - eye
    if not has_cube(light):
        return [_fit_spot(light, point, scenery, row)]
    return _fit_cube(light, point, scenery, row)


def _fit_parallel(light: Any, scenery: Scenery, row: Float64) -> Float64 | None:
    """Fit the map of a directional light."""
    axes, shadow = build_basis(light.direction, scenery.right), light.shadow
    cells, boxes = project_on_axes(axes, scenery.cells), project_on_axes(axes, scenery.boxes)
    if not len(cells) or not len(boxes):
        return None
    low, high = cells.min(axis=(0, 1)), cells.max(axis=(0, 1))
    box_low, box_high = boxes.min(axis=1), boxes.max(axis=1)
    nearest = float(box_low[:, 2].min())
    tangent = compute_half_tangent(shadow)
    # Make room for casters that shade from aside.
    margin = min(tangent * max(float(high[2]) - nearest, 0.0), float((high - low)[:2].max()) / 2.0)
    low[:2] -= margin
    high[:2] += margin
    between = (
        (box_high[:, :2] >= low[:2]).all(axis=1)
        & (box_low[:, :2] <= high[:2]).all(axis=1)
        & (box_low[:, 2] <= high[2])
    )
    if not between.any():
        return None
    nearest = min(float(box_low[between, 2].min()), float(low[2]))
    slack = WINDOW_SLACK * max(float((high - low).max()), float(high[2]) - nearest, 1e-300)
    window = Window(
        (float(low[0]) - slack, float(low[1]) - slack),
        (float(high[0]) + slack, float(high[1]) + slack),
        nearest - slack,
        float(high[2]) + slack,
    )
    _write_row(row, axes, (0.0, 0.0, 0.0), window, shadow, BORDER_TEXELS)
    span, focal = window.far - window.near, row[shadows_stage.FOCAL : shadows_stage.FOCAL + 2]
    row[shadows_stage.PARALLEL], row[shadows_stage.SPAN] = 1.0, span
    row[shadows_stage.TEXEL_DEPTH] = 1.0 / (float(focal.min()) * span)
    row[shadows_stage.WIDENING] = tangent * float(focal.min()) * span
    depth = (*(2.0 * axes[2] / span).tolist(), -(window.near + window.far) / span)
    return _make_clip_matrix(row, shadow.size, depth)


def _fit_spot(light: Any, point: Float64, scenery: Scenery, row: Float64) -> Float64 | None:
    """Fit the map of a spot light to the receivers inside its cone."""
    axes, shadow = build_basis(light.direction, scenery.right), light.shadow
    sine, cosine = transforms.sine_cosine(light.outer_angle)
    cells = project_on_axes(axes, scenery.cells - point)
    boxes = project_on_axes(axes, scenery.boxes - point)
    window = _find_window(cells, boxes, sine / cosine, light.range, shadow)
    if window is None:
        return None
    origin = tuple(project_on_axes(axes, point).tolist())
    _write_row(row, axes, origin, window, shadow, BORDER_TEXELS)
    _write_depth(row, window, shadow)
    return _make_clip_matrix(row, shadow.size, _make_depth_row(row, axes[2], window))


def _fit_cube(light: Any, point: Float64, scenery: Scenery, row: Float64) -> list[Float64 | None]:
    """Fit the six maps of a point light: the sides of a cube, a little larger each."""
    shadow, sides = light.shadow, []
    border = BORDER_TEXELS
    if shadow.filter == "soft":
        border = max(border, int(SOFT_BORDER * shadow.size))
    border = min(border, shadow.size // 4)
    tangent = shadow.size / (shadow.size - 2.0 * border)
    for k in range(3):
        for sign in (1.0, -1.0):
            axes = np.zeros((3, 3))
            axes[0, (k + 1) % 3] = axes[1, (k + 2) % 3] = 1.0
            axes[2, k] = sign
            cells = project_on_axes(axes, scenery.cells - point)
            boxes = project_on_axes(axes, scenery.boxes - point)
            sides.append((axes, _find_window(cells, boxes, tangent, light.range, shadow)))
    windows = [window for _, window in sides if window is not None]
    if not windows:
        return [None] * 6
    near, far = min(w.near for w in windows), max(w.far for w in windows)
    window = Window((-tangent, -tangent), (tangent, tangent), max(near, MIN_NEAR * far), far)
    _write_row(row, np.eye(3), tuple(point.tolist()), window, shadow, 0)
    _write_depth(row, window, shadow)
    matrices: list[Float64 | None] = []
    for axes, bounds in sides:
        side = row.copy()
        _write_row(side, axes, tuple(project_on_axes(axes, point).tolist()), window, shadow, 0)
        depth = _make_depth_row(side, axes[2], window)
        matrices.append(None if bounds is None else _make_clip_matrix(side, shadow.size, depth))
    return matrices


def _find_window(
    cells: Float64, boxes: Float64, tangent: float, end: float | None, shadow: Shadow
) -> Window | None:
    """
    Return the window of a map of a light at a point; ``None`` without receivers or casters.

    Parameters
    ----------
    cells, boxes : (N, 8, 3) and (B, 8, 3) float64
        Corners along the axes of the map, from the light: across, down, away.
    tangent : float
        Largest reach of the map aside, over the depth.
    end : float or None
        Range of the light, scene units.
    shadow : Shadow
    """
    low, high = _find_bounds(cells, tangent)
    end = math.inf if end is None else end
    is_seen = (low <= high).all(axis=1) & (low[:, 2] < end)
    if not is_seen.any():
        return None
    bounds = low[is_seen].min(axis=0), high[is_seen].max(axis=0)
    far = min(float(bounds[1][2]), end)
    box_low, box_high = _find_bounds(boxes, tangent)
    half = 0.0 if shadow.light_size is None else shadow.light_size / 2.0
    # Make room for casters that shade from aside: at most half of the window on each side.
    nearest = max(float(box_low[:, 2].min(initial=math.inf)), MIN_NEAR * far)
    margin = min(half / min(nearest, far), float((bounds[1] - bounds[0])[:2].max()) / 2.0)
    side_low = np.maximum(bounds[0][:2] - margin, -tangent)
    side_high = np.minimum(bounds[1][:2] + margin, tangent)
    between = (
        (box_low <= box_high).all(axis=1)
        & (box_high[:, :2] >= side_low).all(axis=1)
        & (box_low[:, :2] <= side_high).all(axis=1)
        & (box_low[:, 2] <= far)
    )
    if not between.any():
        return None
    near = min(float(box_low[between, 2].min()), float(bounds[0][2]))
    slack = WINDOW_SLACK * (1.0 + tangent)
    return Window(
        (float(side_low[0]) - slack, float(side_low[1]) - slack),
        (float(side_high[0]) + slack, float(side_high[1]) + slack),
        max(near * (1.0 - 1e-3), MIN_NEAR * far),
        far * (1.0 + 1e-3),
    )


def _find_bounds(corners: Float64, tangent: float) -> tuple[Float64, Float64]:
    """
    Return bounds, (N, 3), of boxes as a light sees them: aside over the depth, and the depth.

    A box that reaches behind the light has the widest bounds; for one all behind the light, or
    beside the map, a lower bound lies above an upper one.
    """
    depth = corners[..., 2]
    nearest, farthest = depth.min(axis=1), depth.max(axis=1)
    is_in_front = nearest > 0.0
    divisor = np.where(is_in_front[:, np.newaxis], depth, 1.0)
    low, high = np.empty((len(corners), 3)), np.empty((len(corners), 3))
    for k in range(2):
        aside = corners[..., k] / divisor
        low[:, k] = np.where(is_in_front, np.maximum(aside.min(axis=1), -tangent), -tangent)
        high[:, k] = np.where(is_in_front, np.minimum(aside.max(axis=1), tangent), tangent)
    low[:, 2], high[:, 2] = np.maximum(nearest, 0.0), np.where(farthest > 0.0, farthest, -1.0)
    return low, high


def _write_row(
    row: Float64,
    axes: Float64,
    origin: tuple[float, ...],
    window: Window,
    shadow: Shadow,
    border: int,
) -> None:
    """Write axes, origin and scale of a map."""
    row[:9] = axes.ravel()
    row[shadows_stage.ORIGIN : shadows_stage.ORIGIN + 3] = origin
    inner_size = shadow.size - 2.0 * border
    focal = [inner_size / (high - low) for low, high in zip(window.low, window.high, strict=True)]
    if shadow.filter == "soft":
        # A penumbra is round: texels are square.
        focal = [min(focal)] * 2
    row[shadows_stage.FOCAL : shadows_stage.FOCAL + 2] = focal
    for k in range(2):
        row[shadows_stage.CENTER + k] = border - focal[k] * window.low[k]
    row[shadows_stage.NEAR], row[shadows_stage.FAR] = window.near, window.far
    row[shadows_stage.SPAN] = 1.0


def _write_depth(row: Float64, window: Window, shadow: Shadow) -> None:
    """Write the depth of a texel and the widening, for a light at a point."""
    focal = float(row[shadows_stage.FOCAL : shadows_stage.FOCAL + 2].min())
    row[shadows_stage.TEXEL_DEPTH] = 1.0 / focal
    half = 0.0 if shadow.light_size is None else shadow.light_size / 2.0
    row[shadows_stage.WIDENING] = focal * half / window.near


def _make_depth_row(row: Float64, away: Float64, window: Window) -> tuple[float, ...]:
    """Return the z row of a perspective matrix."""
    scale = (window.far + window.near) / (window.far - window.near)
    offset = -2.0 * window.far * window.near / (window.far - window.near)
    return (*(scale * away).tolist(), offset - scale * float(row[shadows_stage.ORIGIN + 2]))


def _make_clip_matrix(row: Float64, size: int, depth: tuple[float, ...]) -> Float64:
    """Return ``clip_from_relative``, (4, 4), of the projection that ``stage`` applies."""
    axes, origin = row[:9].reshape(3, 3), row[shadows_stage.ORIGIN : shadows_stage.ORIGIN + 3]
    matrix = np.zeros((4, 4))
    if row[shadows_stage.PARALLEL]:
        matrix[3, 3] = 1.0
    else:
        matrix[3] = (*axes[2].tolist(), -float(origin[2]))
    for k, sign in ((0, 1.0), (1, -1.0)):
        scale = 2.0 / size
        focal, center = float(row[shadows_stage.FOCAL + k]), float(row[shadows_stage.CENTER + k])
        aside = np.array((*axes[k].tolist(), -float(origin[k])))
        matrix[k] = sign * (scale * focal * aside + (scale * center - 1.0) * matrix[3])
    matrix[2] = depth
    return matrix


class Casters(NamedTuple):
    """The objects of a scene as shadow casters."""

    vertices: visibility_pass.ModelVertices
    faces: NDArray[np.int32]
    """(F, 3)."""
    placement: Placement
    bounds: Float64
    """(O, 2, 3): low and high corner of each object, model space; NaN for an empty one."""
    casts: NDArray[np.bool_]
    """(O,): which objects cast shadows."""
    alpha_tests: AlphaTests | None = None
    """Of the objects with holes."""
    primitives: tuple[Primitive, ...] = ()
    """The objects whose faces are segments or points."""


def collect_scenery(
    casters: Casters,
    always_lit: NDArray[np.bool_],
    may_be_seen: NDArray[np.bool_],
    cells: Float64,
    camera: Camera,
    size: tuple[int, int],
) -> Scenery:
    """
    Return the casters of shadows, and the space that receives them.

    Parameters
    ----------
    casters : Casters
    always_lit : (O,) bool
        Which objects receive shadows everywhere, visible or not.
    may_be_seen : (O,) bool
        Which others may be visible where the depth buffer does not show them.
    cells : (N, 8, 3) float64
        Cells of the depth buffer's surfaces; see ``visible_cells``.
    camera : Camera
    size : (int, int)
        Width and height of the picture, pixels.
    """
    vertices, faces, placement, bounds, casts, alpha_tests, primitives = casters
    boxes = transform_boxes(bounds, placement.relative_from_model)
    finite = np.isfinite(boxes).all(axis=(1, 2))
    starts = placement.face_starts
    if not casts.all():
        counts = np.where(casts, np.diff(starts), 0)
        is_caster = np.repeat(casts, np.diff(starts))
        faces = np.ascontiguousarray(faces[is_caster])
        starts = np.concatenate(([0], np.cumsum(counts)))
        if alpha_tests is not None:
            colors = alpha_tests.face_colors
            colors = np.ascontiguousarray(colors[is_caster]) if len(colors) else colors
            alpha_tests = alpha_tests._replace(face_starts=starts, face_colors=colors)
        primitives = tuple(
            item._replace(faces=(int(starts[item.number]), int(starts[item.number + 1])))
            for item in primitives
            if casts[item.number]
        )
    may_be_seen_cells = make_view_cells(camera, size, boxes[finite & may_be_seen & ~always_lit])
    cells = np.concatenate([cells, boxes[finite & always_lit], may_be_seen_cells])
    return Scenery(
        vertices, faces, starts, boxes[finite & casts], cells, alpha_tests, primitives,
        _get_right_axis(camera),
    )  # fmt: skip


def _get_right_axis(camera: Camera) -> tuple[float, ...]:
    """Return the x axis of a camera in the world, unit length."""
    right = camera.view_matrix()[0, :3]
    return transforms.unit_triple("axis", right) if right.any() else (1.0, 0.0, 0.0)


def find_density(light: CastingLight) -> int:
    """Return how densely the shadow of a light is sampled, as a multiple: wide suns have bands."""
    shadow = light.shadow
    if shadow is None or shadow.light_size is None or not isinstance(light, DirectionalLight):
        return 1
    return max(1, min(MAX_SAMPLE_DENSITY, math.ceil(shadow.light_size / SMOOTH_DEGREES)))


@lru_cache(MAX_SAMPLE_DENSITY)
def make_disk_points(density: int = 1) -> NDArray[np.float32]:
    """
    Return points of the unit disk where soft shadows are compared, (N, 2), as in a sunflower [2]_.

    There are ``density * COMPARISON_COUNT`` points. The array is shared: do not write to it.
    """
    points, count = [], density * COMPARISON_COUNT
    for n in range(count):
        radius = math.sqrt((n + 0.5) / count)
        sine, cosine = transforms.sine_cosine(n * GOLDEN_ANGLE)
        points.append((radius * cosine, radius * sine))
    return np.array(points, np.float32)


@lru_cache(64)
def make_spiral(size: int, density: int = 1) -> NDArray[np.float32]:
    """
    Return points around a sample where soft shadows look for blockers, (S, 2), by a map's side.

    A spiral in texels, from the nearest on, with ``density`` times eight points to an octave.

    Points are the denser the nearer, so that close and distant blockers cover equal shares. The
    array is shared: do not write to it.
    """
    points, radius, growth = [], 1.0, SPIRAL_GROWTHS[density - 1]
    while radius <= float(filters.MAX_PENUMBRA_RADIUS) * size + 1.0:
        sine, cosine = transforms.sine_cosine(len(points) * GOLDEN_ANGLE)
        points.append((radius * cosine, radius * sine))
        radius *= growth
    return np.array(points, np.float32)


def find_occlusion_limits(texels: NDArray[np.float32], widening: float) -> NDArray[np.float32]:
    """
    Find the stored depths below which distant texels may shade samples.

    Parameters
    ----------
    texels : (M, S, S) float32
        The maps of a light, stored depth.
    widening : float
        Column WIDENING of the light's row.

    Returns
    -------
    (N,) float32
        Levels of square cells, of ``filters.CELL_TEXELS`` texels and then twice as many each time,
        for each map row by row; see `filters.count_cells`. Texels farther from a sample than two
        cells of the level before (for the first level, than ``filters.NEAR_RADIUS``) shade no
        sample whose stored depth is at least its cell's.
    """
    radius, side, levels = float(filters.NEAR_RADIUS), filters.CELL_TEXELS, []
    depths = _find_max_depths(texels, side)
    while not levels or radius <= float(filters.MAX_PENUMBRA_RADIUS) * texels.shape[-1] + 1.0:
        # A point reads the texel that it lies in, whose middle is less than one texel away.
        height = radius - 1.0 - float(filters.MIN_SEARCH_RADIUS)
        height = height / (float(filters.SEARCH_RATIO) * widening) if widening > 0.0 else math.inf
        count = depths.shape[-1]
        dilated = np.pad(depths, ((0, 0), (2, 2), (2, 2)), constant_values=-np.inf)
        dilated = reduce(np.maximum, [dilated[:, k : k + count] for k in range(5)])
        dilated = reduce(np.maximum, [dilated[:, :, k : k + count] for k in range(5)])
        levels.append(dilated - np.float32(height))
        radius, side, depths = 2.0 * side, 2 * side, _find_max_depths(depths, 2)
    # Texels beyond the next ring are also beyond this one.
    for near, far in zip(levels[-2::-1], levels[:0:-1], strict=True):
        count = near.shape[-1]
        np.maximum(near, far.repeat(2, 1).repeat(2, 2)[:, :count, :count], out=near)
    return np.concatenate([level.ravel() for level in levels])


def _find_max_depths(texels: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Return the greatest stored depth in cells of maps, (M, S, S), given a cell's side, texels."""
    rest = -texels.shape[-1] % side
    if rest:
        texels = np.pad(texels, ((0, 0), (0, rest), (0, rest)), constant_values=-np.inf)
    rows = texels.reshape(len(texels), -1, side, texels.shape[-1]).max(axis=2)
    return reduce(np.maximum, [rows[:, :, k::side] for k in range(side)])
