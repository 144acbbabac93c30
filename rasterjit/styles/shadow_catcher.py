"""
Draw a scene's shadow on an invisible ground, as a background image: a shadow catcher.

The ground is the plane under the lowest point. As nothing lies below it, a point of it is in shadow
of a direction of light if the scene's silhouette along that direction covers it; ``silhouettes``
counts the directions. They come from the key light, a disk in the sky, and from all of the sky. No
depths are compared, so there is no bias.

The shadow is only part of the background: depths, ids, masks and coverage do not have it.
"""

from __future__ import annotations

import math
from contextlib import closing
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.geometry import projection
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.rendering.planning import cut_by_section
from rasterjit.rendering.renderer import Renderer
from rasterjit.runtime.jit import Bound
from rasterjit.runtime.threads import Memory, Workers
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera, MatrixCamera
from rasterjit.scene.camera_fitting import rotate_y_to
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.vectors import dot
from rasterjit.styles import ground_light, silhouettes
from rasterjit.survey.cache import SceneCache, update_cache
from rasterjit.survey.deformation import pose_scene
from rasterjit.survey.object_transforms import cull_objects, transform_to_view
from rasterjit.survey.packed_scene import SceneArrays

Vector = tuple[float, float, float]
Float64 = NDArray[np.float64]

MAP_SIDE = 384
"""Texels along each side of the map of the ground."""

KEY_DIRECTIONS, SKY_DIRECTIONS = 32, 64
"""Most directions of light: of the key light, and of the sky."""

BLUR_RADII = 2, 5, 10
"""
Radii of the blur, texels: of the key light and of sky light from overhead first.

Light from low in the sky makes wide penumbras, in which few directions show as steps.
"""

MIN_DIRECTIONS = 12
"""Least directions of key light and sky each, for scenes of many faces."""

MAX_FACES_DRAWN = 24_000_000
"""Most faces drawn for all directions together, about."""

KEY_RADIUS = 0.16
"""Radius of the key light's disk over its distance: a penumbra of 18 degrees."""

MAX_SKY_SINE = 0.82
"""Largest sine of the angle between the vertical and a direction of sky light."""

MAX_SHADOW_LENGTH = 2.5
"""Longest shadow of the key light, in heights of the scene."""

SKY_SHADOW_WIDTH = 0.9
"""Width of the sky's shadow around the scene, in heights of the scene."""

MIN_HEIGHT = 1e-6
"""Least height of a scene that is not flat, in sides of the ground under it."""

FADE_SHARE = 0.2
"""Share of the map, at each border, over which the shadow fades out."""

GOLDEN_ANGLE = 137.50776405003785
"""Angle from one direction to the next, degrees."""

MIN_FLOOR_SHARE = 0.7
"""Least share of the ground under a scene that faces cover for it to have a floor."""

MAX_FLOOR_HEIGHT = 0.05
"""Largest height of a floor, in heights of the scene."""


class Ground(NamedTuple):
    """A map of the missing light on the plane under a scene."""

    frame: Float64
    """(3, 3), a row each: world-space directions of the map's columns, its rows, and up."""
    height: float
    """Height of the plane along up, scene units."""
    above: float
    """Height of the scene, scene units."""
    slope: tuple[float, float] | None
    """Horizontal offset of the key light for each unit down; None if it is not above."""
    corner: tuple[float, float]
    """Corner of the map, along its columns and rows, scene units."""
    extent: float
    """Side of the map, scene units."""
    shade: NDArray[np.float32]
    """(MAP_SIDE, MAP_SIDE): share of the light that is missing, 0..1."""


def find_ground(scene: Scene, key: Vector | None) -> Ground | None:
    """
    Return the unshadowed plane under a scene; None if it has a floor or casts no shadow.

    Parameters
    ----------
    scene : Scene
        Posed.
    key : (3,) tuple of float or None
        Direction towards the key light, world space, if there is one.
    """
    if _list_casters(scene) is None:
        return None
    frame = np.ascontiguousarray(rotate_y_to(scene.up or (0.0, 1.0, 0.0))[:3, :3].T[[0, 2, 1]])
    bounds = [_find_bounds(scene, axis) for axis in frame]
    (u0, u1), (v0, v1), (h0, h1) = bounds
    height, size = h1 - h0, max(u1 - u0, v1 - v0)
    if not (math.isfinite(height + size) and size > 0.0 and height > size * MIN_HEIGHT):
        return None
    if _has_floor(scene, frame, bounds):
        return None
    slope = _find_light_slope(frame, key)
    sky_width = SKY_SHADOW_WIDTH * min(height, size)
    shadow_tip = (0.0, 0.0) if slope is None else (slope[0] * height, slope[1] * height)
    ends = [
        (min(low - sky_width, low + offset), max(high + sky_width, high + offset))
        for (low, high), offset in zip(bounds[:2], shadow_tip, strict=True)
    ]
    extent = max(high - low for low, high in ends) / (1.0 - FADE_SHARE)
    corner = tuple((low + high - extent) / 2.0 for low, high in ends)
    missing = np.zeros((MAP_SIDE, MAP_SIDE), np.float32)
    return Ground(frame, h0, height, slope, (corner[0], corner[1]), extent, missing)


def cast_shadow(
    ground: Ground, scene: Scene, shares: tuple[float, float], threads: int | None
) -> Ground:
    """
    Return the ground with the shadow of a scene.

    Parameters
    ----------
    ground : Ground
        Of `find_ground`.
    scene : Scene
    shares : (float, float)
        Shares of the light on the plane that the key light and the sky bring.
    threads : int or None
    """
    casters, slope = _list_casters(scene), ground.slope
    if casters is None:
        return ground
    face_count = sum(len(node.mesh.faces) for node in casters.nodes)
    max_directions = max(MIN_DIRECTIONS, MAX_FACES_DRAWN // max(face_count, 1) // 2)
    # Group the directions by blur: rings of the sky, and the key light.
    sky = list_sky_slopes(min(SKY_DIRECTIONS, max_directions))
    groups = [
        sky[n * len(sky) // len(BLUR_RADII) : (n + 1) * len(sky) // len(BLUR_RADII)]
        for n in range(len(BLUR_RADII))
    ]
    if slope is not None:
        groups.append(list_key_slopes(slope, min(KEY_DIRECTIONS, max_directions)))
    counts = _count_blocked(casters, [_place_maps(ground, slopes) for slopes in groups], threads)

    def blocked_light(group: int, radius: int, share: float) -> NDArray[np.float32]:
        """Return the blurred share of light of a group that is blocked, times a factor."""
        return _blur(counts[group], radius, np.float32(share / len(groups[group])))

    missing = np.zeros((MAP_SIDE, MAP_SIDE), np.float32)
    for ring, radius in enumerate(BLUR_RADII):
        missing += blocked_light(ring, radius, 1.0 / len(BLUR_RADII))
    # Darken contacts: nearby objects block most of the remaining sky.
    missing *= np.float32(2.0) - missing
    missing *= np.float32(shares[1])
    if slope is not None:
        missing += blocked_light(len(BLUR_RADII), BLUR_RADII[0], shares[0])
    return ground._replace(shade=missing * _make_fade_mask())


def darken_everywhere(ground: Ground) -> Ground:
    """Return the ground without light everywhere on its map."""
    return ground._replace(shade=_make_fade_mask())


def _find_light_slope(frame: Float64, key: Vector | None) -> tuple[float, float] | None:
    """Return the horizontal offset of the key light for each unit down; None if it is below."""
    if key is None:
        return None
    across, along, up = (dot(axis, key) for axis in frame.tolist())
    length = math.sqrt(across * across + along * along)
    if up <= 0.0:
        return None
    # A light near the horizon would need an endless map.
    down = max(up, length / MAX_SHADOW_LENGTH)
    return -across / down, -along / down


def _list_casters(scene: Scene) -> Scene | None:
    """Return a scene of only the triangles that cast shadows; None if there are none."""
    nodes = [
        node
        for node in scene.nodes
        if type(node.mesh) is Mesh and node.mesh.material.alpha_mode != "blend"
    ]
    if not nodes:
        return None
    casters = Scene()
    casters.section, casters.nodes = scene.section, nodes
    return casters


def _find_bounds(scene: Scene, axis: Float64) -> tuple[float, float]:
    """Return the least and the greatest coordinate of a scene along an axis, scene units."""
    low, high = math.inf, -math.inf
    x, y, z = axis.tolist()
    for positions, _ in scene._world_chunks():
        heights = positions[:, 0] * x + positions[:, 1] * y + positions[:, 2] * z
        low, high = min(low, float(heights.min())), max(high, float(heights.max()))
    return low, high


def _has_floor(scene: Scene, frame: Float64, bounds: list[tuple[float, float]]) -> bool:
    """Tell whether low, upward faces cover most of the ground under a scene."""
    (u0, u1), (v0, v1), (h0, h1) = bounds
    covered_area, max_height = 0.0, h0 + MAX_FLOOR_HEIGHT * (h1 - h0)
    for node in scene.nodes:
        if type(node.mesh) is not Mesh:
            continue
        matrix, positions = node.world_matrix, node.mesh.vertices
        map_positions = np.empty(positions.shape)
        columns = matrix[:3].T.tolist()
        # Vertices of no face may be infinite.
        with np.errstate(over="ignore", invalid="ignore"):
            for k, axis in enumerate(frame.tolist()):
                x, y, z, w = (dot(column, axis) for column in columns)
                weighted = positions[:, 0] * x + positions[:, 1] * y + positions[:, 2] * z
                map_positions[:, k] = weighted + w
        is_low = map_positions[:, 2] <= max_height
        corners = map_positions[node.mesh.faces[is_low[node.mesh.faces].all(axis=1)]]
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        # Columns, rows and up are left-handed.
        areas = np.maximum(a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1], 0.0) / 2.0
        if len(areas):
            # A running sum adds in a fixed order.
            covered_area += float(np.cumsum(areas)[-1])
    return covered_area >= MIN_FLOOR_SHARE * (u1 - u0) * (v1 - v0)


def _place_maps(ground: Ground, slopes: list[tuple[float, float]]) -> tuple[Float64, Float64]:
    """
    Return ``view_from_world``, (4, 4), and ``clip_from_view``, (N, 4, 4), along light of N slopes.

    They project the scene along the light on the map of the ground.
    """
    view, clips = np.eye(4), np.zeros((len(slopes), 4, 4))
    # Negated rows make the rotation right-handed.
    view[:3, :3] = np.stack([ground.frame[0], -ground.frame[1], ground.frame[2]])
    scale = 2.0 / ground.extent
    for clip, slope in zip(clips, slopes, strict=True):
        clip[0] = scale, 0.0, scale * slope[0], 0.0
        clip[1] = 0.0, scale, -scale * slope[1], 0.0
        clip[0, 3] = -1.0 - scale * (ground.corner[0] + slope[0] * ground.height)
        clip[1, 3] = 1.0 + scale * (ground.corner[1] + slope[1] * ground.height)
        clip[2, 2] = -1.0 / ground.above
        clip[2, 3] = (ground.height + ground.above / 2.0) / ground.above
        clip[3, 3] = 1.0
    return view, clips


def _count_blocked(
    casters: Scene, groups: list[tuple[Float64, Float64]], threads: int | None
) -> list[NDArray[np.int32]]:
    """Return how many directions of each group are blocked at each texel, (S, S) each."""
    scene, counts = pose_scene(casters), None
    cache = update_cache(cut_by_section(scene).nodes, None, Quality())
    if not cache.tables.inventory.contents.cut_out:
        camera = MatrixCamera(groups[0][0], groups[0][1][0])
        count = partial(_count_covered, cache, _pair_edges(cache.shapes.arrays), camera)
        with closing(Workers(threads)) as workers:
            # A thread for each group: they have about as many directions.
            counts = workers.run(count, [(clips,) for _, clips in groups])
    if counts is not None and all(group_counts is not None for group_counts in counts):
        return counts
    # Scenes with holes, or beyond the guard band, are rendered instead.
    drawn_counts = []
    with Renderer((MAP_SIDE, MAP_SIDE), threads=threads) as renderer:
        renderer.warned = None
        for view, clips in groups:
            drawn_counts.append(np.zeros((MAP_SIDE, MAP_SIDE), np.int32))
            for clip in clips:
                frame = renderer.render(scene, MatrixCamera(view, clip), outputs=("face_id",))
                drawn_counts[-1] += frame.face_id >= 0
    return drawn_counts


def _pair_edges(arrays: SceneArrays) -> NDArray[np.int32]:
    """Return the paired edges of a scene, (E, 4), as `silhouettes` takes them."""
    older = np.empty(arrays.faces.size, np.int32)
    edges = np.empty((arrays.faces.size, silhouettes.EDGE_COLUMNS), np.int32)
    newest = np.empty(len(arrays.positions), np.int32)
    return edges[: silhouettes.pair_edges(arrays.faces, newest, older, edges)]


def _count_covered(
    cache: SceneCache, edges: NDArray[np.int32], camera: MatrixCamera, clips: Float64
) -> NDArray[np.int32] | None:
    """
    Count the directions from which a scene covers each texel; None: faces must be clipped.

    ``camera`` is one of them; all share its view matrix and differ by ``clips``.
    """
    arrays, size = cache.shapes.arrays, (MAP_SIDE, MAP_SIDE)
    views = transform_to_view(cache.transforms, camera, size)
    # Multiply the matrices of each direction.
    view, matrix = np.eye(4)[np.newaxis], np.empty((4, 4))
    view[0, :3, 3] = camera.eye_position()
    view = transforms.product_of_each(camera.view_matrix()[np.newaxis], view)
    matrices = transforms.product_of_each(clips, np.repeat(view, len(clips), axis=0))
    # Bind the transform of vertices to the map.
    positions = arrays.positions
    viewport = visibility_pass.make_viewport(size, Quality().subpixel_bits)
    screen = visibility_pass.allocate_screen(len(positions), Memory())
    transform = Bound(
        projection.transform_vertices, (0, len(positions)), positions,
        (arrays.vertex_starts, views.relative_from_model), matrix, (0.0, 0.0, 0.0), viewport,
        screen, projection.allocate_scratch(positions.dtype),
    )  # fmt: skip
    # Count the directions whose silhouettes cover each texel.
    objects = cull_objects(
        "none", views.screen_winding, views.mirrored, arrays.face_starts,
        cache.tables.is_single_sided,
    )  # fmt: skip
    windings = np.empty(len(arrays.faces) + 1, np.int8)
    layers = np.zeros((MAP_SIDE, MAP_SIDE + 1), np.int32)
    ends = np.tile(np.array([MAP_SIDE + 1, -1], np.int32), (MAP_SIDE, 1))
    counts = np.zeros((MAP_SIDE, MAP_SIDE), np.int32)
    is_unclipped = silhouettes.count_covered(
        matrices, matrix, transform.words, screen, viewport.grid_bits, arrays.faces, objects, edges,
        windings, layers, ends, counts,
    )  # fmt: skip
    return counts if is_unclipped else None


@lru_cache(max(KEY_DIRECTIONS, SKY_DIRECTIONS))
def _spiral_direction(number: int) -> tuple[float, float]:
    """Return sine and cosine of the golden-angle azimuth of a direction."""
    return transforms.sine_cosine(number * GOLDEN_ANGLE)


def list_sky_slopes(count: int) -> list[tuple[float, float]]:
    """Return the slopes of ``count`` directions of sky light, weighted by cosine."""
    slopes = []
    for n in range(count):
        sine = MAX_SKY_SINE * math.sqrt((n + 0.5) / count)
        cosine = math.sqrt(1.0 - sine * sine)
        y, x = _spiral_direction(n)
        slopes.append((x * sine / cosine, y * sine / cosine))
    return slopes


def list_key_slopes(slope: tuple[float, float], count: int) -> list[tuple[float, float]]:
    """Return the slopes of ``count`` directions in a disk around the key light."""
    length = math.sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    u, v = (slope[0] / length, slope[1] / length) if length > 0.0 else (1.0, 0.0)
    slopes = []
    for n in range(count):
        radius = KEY_RADIUS * math.sqrt((n + 0.5) / count)
        y, x = _spiral_direction(n)
        # The plane cuts the cone of light obliquely: longer along the light than across.
        along = radius * x * (1.0 + length * length)
        across = radius * y * math.sqrt(1.0 + length * length)
        slopes.append((slope[0] + u * along - v * across, slope[1] + v * along + u * across))
    return slopes


def _blur(count: NDArray[np.int32], radius: int, weight: np.float32) -> NDArray[np.float32]:
    """Return counts blurred twice by a box filter, times a weight."""
    blurred = np.zeros(count.shape, np.float32)
    if not count.any():
        return blurred
    # Blur only the part around texels that are not 0.
    part = tuple(_widen_range(np.flatnonzero(count.any(axis=axis)), 2 * radius) for axis in (1, 0))
    inner = np.ascontiguousarray(count[part])
    sums, scratch = np.empty_like(inner), np.empty_like(inner)
    ground_light.blur(inner, radius, sums, scratch, scratch[0].copy())
    square = (2 * radius + 1) ** 2
    blurred[part] = sums.astype(np.float32) * (weight / np.float32(square**2))
    return blurred


def _widen_range(indices: NDArray[np.int64], margin: int) -> slice:
    """Return the slice of texels around ascending indices, with a margin, inside the map."""
    return slice(max(int(indices[0]) - margin, 0), min(int(indices[-1]) + 1 + margin, MAP_SIDE))


def _make_fade_mask() -> NDArray[np.float32]:
    """Return a mask, (MAP_SIDE, MAP_SIDE), that fades to 0 at the borders."""
    position = (np.arange(MAP_SIDE) + 0.5) / MAP_SIDE
    t = np.clip(np.minimum(position, 1.0 - position) / (FADE_SHARE / 2.0), 0.0, 1.0)
    t = t * t * (3.0 - 2.0 * t)
    return (t[:, None] * t[None, :]).astype(np.float32)


def is_above(ground: Ground, camera: Camera, size: tuple[int, int]) -> bool:
    """Tell whether a camera looks down on the ground."""
    up = ground.frame[2].tolist()
    if camera.projection_matrix(size)[3, :3].any():
        return dot(up, camera.eye_position().tolist()) > ground.height
    return dot(up, camera.view_matrix()[2, :3].tolist()) > 0.0


def darken_background(
    ground: Ground, camera: Camera, palette: NDArray[np.float32], codes: NDArray[np.uint32]
) -> NDArray[np.uint32] | None:
    """
    Return a picture with the ground's shadow, (H, W) codes; None if none is in view.

    Parameters
    ----------
    ground : Ground
    camera : Camera
        Above the ground.
    palette : (256, 4) float32, linear
        Colours of the lit ground, by their red codes.
    codes : (H, W) uint32
    """
    size = codes.shape[1], codes.shape[0]
    view, projection, up = camera.view_matrix(), camera.projection_matrix(size), ground.frame[2]
    # The projective transform from the map to the screen, and its inverse.
    u, v = ground.frame[0], ground.frame[1]
    origin = u * ground.corner[0] + v * ground.corner[1] + up * ground.height
    columns = [
        [*(u * ground.extent).tolist(), 0.0],
        [*(v * ground.extent).tolist(), 0.0],
        [*origin.tolist(), 1.0],
    ]
    clip = transforms.compose(projection, view)[[0, 1, 3]].tolist()
    rows = [[dot(row, column) + row[3] * column[3] for column in columns] for row in clip]
    inverse = _adjugate(rows)
    sign = math.copysign(1.0, dot(rows[0], [row[0] for row in inverse]))
    darkened, light = codes.copy(), np.empty((size[0], 4), np.float32)
    has_shadow = ground_light.darken_picture(
        sign * np.array(inverse), ground.shade, palette, srgb_encoding.make_encoding_table(),
        darkened, light, np.empty(size[0]), np.empty(size[0], np.float32),
    )  # fmt: skip
    return darkened if has_shadow else None


def _adjugate(m: list[list[float]]) -> list[list[float]]:
    """Return the adjugate of a 3x3 matrix: its inverse times its determinant."""
    return [
        [m[1][1] * m[2][2] - m[1][2] * m[2][1], m[0][2] * m[2][1] - m[0][1] * m[2][2],
         m[0][1] * m[1][2] - m[0][2] * m[1][1]],
        [m[1][2] * m[2][0] - m[1][0] * m[2][2], m[0][0] * m[2][2] - m[0][2] * m[2][0],
         m[0][2] * m[1][0] - m[0][0] * m[1][2]],
        [m[1][0] * m[2][1] - m[1][1] * m[2][0], m[0][1] * m[2][0] - m[0][0] * m[2][1],
         m[0][0] * m[1][1] - m[0][1] * m[1][0]],
    ]  # fmt: skip
