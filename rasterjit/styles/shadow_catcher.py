"""
Shadow catcher: draw a scene's shadow on an invisible ground, as a background image.

The ground is the plane under the lowest point. Nothing lies below it, so what stands in the way of
a light is all that covers a point of the plane, looked at along the light: its silhouette from each
direction is enough, and a count of those that cover a point (``silhouettes``). Directions come from
the key light, a disk in the sky, and from all of the sky. No depth is compared: there is no bias.

The shadow is part of the background alone. Depths, numbers, masks and coverage know nothing of it.
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
from rasterjit.rendering.planning import cut_open
from rasterjit.rendering.renderer import Renderer
from rasterjit.runtime.jit import Bound
from rasterjit.runtime.threads import Memory, Workers
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera, MatrixCamera
from rasterjit.scene.camera_fitting import up_rotation
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

SIDE = 384
"""Texels along each side of the map of the ground."""

KEY_DIRECTIONS, SKY_DIRECTIONS = 32, 64
"""Directions that light comes from: of the key light, and of the sky."""

BLUR_RADII = 2, 5, 10
"""
Texels around each that are averaged, for the key light and what comes from overhead first.

Light from low in the sky makes wide penumbras, which few directions show as steps.
"""

MIN_DIRECTIONS = 12
"""Directions of each for scenes of many faces."""

MAX_FACES_DRAWN = 24_000_000
"""Faces drawn for all directions together, about; more would take most of a picture's time."""

KEY_RADIUS = 0.16
"""Radius of the key light's disk over its distance: a penumbra of 18 degrees."""

MAX_SKY_SINE = 0.82
"""Largest sine of the angle between the vertical and where sky light comes from."""

MAX_SHADOW_LENGTH = 2.5
"""Longest shadow of the key light, in heights of the scene."""

SKY_REACH = 0.9
"""Distance around the scene in which the sky's shadow is computed, in heights of the scene."""

MIN_HEIGHT = 1e-6
"""Least height of a scene that is not flat, in sides of the ground under it."""

FADE_SHARE = 0.2
"""Share of the map, at each border, over which the shadow fades out."""

GOLDEN_ANGLE = 137.50776405003785
"""Angle from one direction to the next, degrees: the golden one spreads them evenly."""

MIN_FLOOR_SHARE = 0.7
"""Least share of the ground under a scene that a floor covers."""

MAX_FLOOR_HEIGHT = 0.05
"""Largest height of a floor, in heights of the scene."""


class Ground(NamedTuple):
    """A map of the light that is missing on the plane under a scene."""

    frame: Float64
    """(3, 3): world axes along the map's columns, its rows, and up, one a row."""
    height: float
    """Height of the plane along up, scene units."""
    above: float
    """Height of the scene, scene units."""
    slope: tuple[float, float] | None
    """Horizontal offset of the key light for each unit down; None: it is not above."""
    low: tuple[float, float]
    """Corner of the map, along its columns and rows, scene units."""
    extent: float
    """Side of the map, scene units."""
    shade: NDArray[np.float32]
    """(SIDE, SIDE): share of the light that is missing, 0..1."""


def find_ground(scene: Scene, key: Vector | None) -> Ground | None:
    """
    Return the unshadowed plane under a scene; None if it has a floor or casts no shadow.

    Parameters
    ----------
    scene : Scene
        Posed.
    key : (3,) tuple of float or None
        Direction towards the key light, world space; None: there is none.
    """
    if _shadow_casters(scene) is None:
        return None
    frame = np.ascontiguousarray(up_rotation(scene.up or (0.0, 1.0, 0.0))[:3, :3].T[[0, 2, 1]])
    bounds = [_bounds_along(scene, axis) for axis in frame]
    (u0, u1), (v0, v1), (h0, h1) = bounds
    height, size = h1 - h0, max(u1 - u0, v1 - v0)
    if not (math.isfinite(height + size) and size > 0.0 and height > size * MIN_HEIGHT):
        return None
    if _has_floor(scene, frame, bounds):
        return None
    slope = _light_slope(frame, key)
    reach = SKY_REACH * min(height, size)
    shadow_tip = (0.0, 0.0) if slope is None else (slope[0] * height, slope[1] * height)
    ends = [
        (min(low - reach, low + along), max(high + reach, high + along))
        for (low, high), along in zip(bounds[:2], shadow_tip, strict=True)
    ]
    extent = max(high - low for low, high in ends) / (1.0 - FADE_SHARE)
    corner = tuple((low + high - extent) / 2.0 for low, high in ends)
    missing = np.zeros((SIDE, SIDE), np.float32)
    return Ground(frame, h0, height, slope, (corner[0], corner[1]), extent, missing)


def cast_shadow(
    ground: Ground, scene: Scene, shares: tuple[float, float], threads: int | None
) -> Ground:
    """
    Return the ground with the shadow of a scene.

    Parameters
    ----------
    ground : Ground
        That of `find_ground`.
    scene : Scene
    shares : (float, float)
        Of the light on the plane, those that the key light and the sky bring.
    threads : int or None
    """
    casters, slope = _shadow_casters(scene), ground.slope
    if casters is None:
        return ground
    faces = 0
    for node in casters.nodes:
        faces += len(node.mesh.faces)
    most = max(MIN_DIRECTIONS, MAX_FACES_DRAWN // max(faces, 1) // 2)
    # Directions that are blurred alike: rings of the sky, and the key light.
    sky = sky_slopes(min(SKY_DIRECTIONS, most))
    groups = [
        sky[n * len(sky) // len(BLUR_RADII) : (n + 1) * len(sky) // len(BLUR_RADII)]
        for n in range(len(BLUR_RADII))
    ]
    if slope is not None:
        groups.append(key_slopes(slope, min(KEY_DIRECTIONS, most)))
    counts = _count_hidden(casters, [_cameras(ground, slopes) for slopes in groups], threads)

    def hidden(n: int, blur: int, share: float) -> NDArray[np.float32]:
        """Return the share of light of a group that is kept off, times a factor."""
        return _blur(counts[n], blur, np.float32(share / len(groups[n])))

    missing = np.zeros((SIDE, SIDE), np.float32)
    for ring, blur in enumerate(BLUR_RADII):
        missing += hidden(ring, blur, 1.0 / len(BLUR_RADII))
    # Where little sky is left, what is near takes most of it: contacts are dark.
    missing *= np.float32(2.0) - missing
    missing *= np.float32(shares[1])
    if slope is not None:
        missing += hidden(len(BLUR_RADII), BLUR_RADII[0], shares[0])
    return ground._replace(shade=missing * _fade_mask())


def darken_fully(ground: Ground) -> Ground:
    """Return the ground without any light wherever a shadow may lie."""
    return ground._replace(shade=_fade_mask())


def _light_slope(frame: Float64, key: Vector | None) -> tuple[float, float] | None:
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


def _shadow_casters(scene: Scene) -> Scene | None:
    """Return a scene of the triangles that cast shadows, alone; None if there are none."""
    nodes = [
        node
        for node in scene.nodes
        if type(node.mesh) is Mesh and node.mesh.material.alpha_mode != "blend"
    ]
    if not nodes:
        return None
    result = Scene()
    result.section = scene.section
    result.nodes = nodes
    return result


def _bounds_along(scene: Scene, axis: Float64) -> tuple[float, float]:
    """Return the least and the greatest place of a scene along an axis, scene units."""
    low, high = math.inf, -math.inf
    x, y, z = axis.tolist()
    for positions, _ in scene._world_chunks():
        heights = positions[:, 0] * x + positions[:, 1] * y + positions[:, 2] * z
        low, high = min(low, float(heights.min())), max(high, float(heights.max()))
    return low, high


def _has_floor(scene: Scene, frame: Float64, bounds: list[tuple[float, float]]) -> bool:
    """Tell whether low, upward faces cover most of the ground under a scene."""
    (u0, u1), (v0, v1), (h0, h1) = bounds
    covered, most = 0.0, h0 + MAX_FLOOR_HEIGHT * (h1 - h0)
    for node in scene.nodes:
        if type(node.mesh) is not Mesh:
            continue
        matrix, positions = node.world_matrix, node.mesh.vertices
        axes = np.empty(positions.shape)
        columns = matrix[:3].T.tolist()
        # Vertices of no face may be infinite.
        with np.errstate(over="ignore", invalid="ignore"):
            for k, axis in enumerate(frame.tolist()):
                x, y, z, w = (dot(column, axis) for column in columns)
                axes[:, k] = (positions[:, 0] * x + positions[:, 1] * y + positions[:, 2] * z) + w
        is_low = axes[:, 2] <= most
        corners = axes[node.mesh.faces[is_low[node.mesh.faces].all(axis=1)]]
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        # Columns, rows and up are left-handed.
        areas = np.maximum(a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1], 0.0) / 2.0
        if len(areas):
            # A running sum: its order is fixed.
            covered += float(np.cumsum(areas)[-1])
    return covered >= MIN_FLOOR_SHARE * (u1 - u0) * (v1 - v0)


def _cameras(ground: Ground, slopes: list[tuple[float, float]]) -> tuple[Float64, Float64]:
    """
    Return ``view_from_world``, (4, 4), and ``clip_from_view``, (N, 4, 4), along light of N slopes.

    Each sees the ground as the map has it, and what stands before it there.
    """
    view, clips = np.eye(4), np.zeros((len(slopes), 4, 4))
    # Turned, not mirrored: columns, up, rows.
    view[:3, :3] = np.stack([ground.frame[0], -ground.frame[1], ground.frame[2]])
    scale = 2.0 / ground.extent
    for clip, slope in zip(clips, slopes, strict=True):
        clip[0] = scale, 0.0, scale * slope[0], 0.0
        clip[1] = 0.0, scale, -scale * slope[1], 0.0
        clip[0, 3] = -1.0 - scale * (ground.low[0] + slope[0] * ground.height)
        clip[1, 3] = 1.0 + scale * (ground.low[1] + slope[1] * ground.height)
        clip[2, 2] = -1.0 / ground.above
        clip[2, 3] = (ground.height + ground.above / 2.0) / ground.above
        clip[3, 3] = 1.0
    return view, clips


def _count_hidden(
    casters: Scene, groups: list[tuple[Float64, Float64]], threads: int | None
) -> list[NDArray[np.int32]]:
    """Return from how many directions of each group something stands before a texel, (S, S)."""
    scene, counts = pose_scene(casters), None
    cut = cut_open(scene)
    cache = update_cache(cut.nodes, None, Quality())
    if not cache.tables.inventory.contents.cut_out:
        camera = MatrixCamera(groups[0][0], groups[0][1][0])
        count = partial(_count_covered, cache, _edges(cache.shapes.arrays), camera)
        with closing(Workers(threads)) as workers:
            # Each group by a thread: there are few, of about as many directions.
            counts = workers.run(count, [(clips,) for _, clips in groups])
    if counts is not None and all(one is not None for one in counts):
        return counts
    # What has holes, or reaches beyond the guard band, is drawn.
    drawn_counts = []
    with Renderer((SIDE, SIDE), threads=threads) as renderer:
        renderer.warned = None
        for view, clips in groups:
            drawn_counts.append(np.zeros((SIDE, SIDE), np.int32))
            for clip in clips:
                frame = renderer.render(scene, MatrixCamera(view, clip), outputs=("face_id",))
                drawn_counts[-1] += frame.face_id >= 0
    return drawn_counts


def _edges(arrays: SceneArrays) -> NDArray[np.int32]:
    """Return the edges of a scene as `silhouettes` has them."""
    older = np.empty(arrays.faces.size, np.int32)
    edges = np.empty((arrays.faces.size, silhouettes.EDGE_COLUMNS), np.int32)
    newest = np.empty(len(arrays.positions), np.int32)
    return edges[: silhouettes.pair_edges(arrays.faces, newest, older, edges)]


def _count_covered(
    cache: SceneCache, edges: NDArray[np.int32], camera: MatrixCamera, clips: Float64
) -> NDArray[np.int32] | None:
    """
    Count the directions from which a scene covers each texel; None: faces must be clipped.

    ``camera`` is that of one of them: the others, by ``clip_from_view``, see from the same eye.
    """
    arrays, size = cache.shapes.arrays, (SIDE, SIDE)
    views = transform_to_view(cache.transforms, camera, size)
    # Matrices.
    moved, matrix = np.eye(4)[np.newaxis], np.empty((4, 4))
    moved[0, :3, 3] = camera.eye_position()
    moved = transforms.product_of_each(camera.view_matrix()[np.newaxis], moved)
    matrices = transforms.product_of_each(clips, np.repeat(moved, len(clips), axis=0))
    # Vertices to the map.
    positions, viewport = (
        arrays.positions,
        visibility_pass.viewport_of(size, Quality().subpixel_bits),
    )
    screen = visibility_pass.screen_arrays(len(positions), Memory())
    transform = Bound(
        projection.transform_vertices, (0, len(positions)), positions,
        (arrays.vertex_starts, views.relative_from_model), matrix, (0.0, 0.0, 0.0), viewport,
        screen, projection.scratch_memory(positions.dtype),
    )  # fmt: skip
    # Silhouettes, and what they cover.
    culled = cull_objects(
        "none", views.screen_winding, views.mirrored, arrays.face_starts,
        cache.tables.is_single_sided,
    )  # fmt: skip
    turns, layers = np.empty(len(arrays.faces) + 1, np.int8), np.zeros((SIDE, SIDE + 1), np.int32)
    ends, counts = (
        np.tile(np.array([SIDE + 1, -1], np.int32), (SIDE, 1)),
        np.zeros((SIDE, SIDE), np.int32),
    )
    is_whole = silhouettes.count_covered(
        matrices, matrix, transform.words, screen, viewport.grid_bits, arrays.faces, culled, edges,
        turns, layers, ends, counts,
    )  # fmt: skip
    return counts if is_whole else None


@lru_cache(max(KEY_DIRECTIONS, SKY_DIRECTIONS))
def _spiral_direction(number: int) -> tuple[float, float]:
    """Return sine and cosine of the angle of a direction."""
    return transforms.sine_cosine(number * GOLDEN_ANGLE)


def sky_slopes(count: int) -> list[tuple[float, float]]:
    """Return the slopes of ``count`` directions of sky light, weighted by cosine."""
    slopes = []
    for n in range(count):
        sine = MAX_SKY_SINE * math.sqrt((n + 0.5) / count)
        cosine = math.sqrt(1.0 - sine * sine)
        y, x = _spiral_direction(n)
        slopes.append((x * sine / cosine, y * sine / cosine))
    return slopes


def key_slopes(slope: tuple[float, float], count: int) -> list[tuple[float, float]]:
    """Return the slopes of ``count`` directions in a disk around the key light."""
    length = math.sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    along = (slope[0] / length, slope[1] / length) if length > 0.0 else (1.0, 0.0)
    slopes = []
    for n in range(count):
        radius = KEY_RADIUS * math.sqrt((n + 0.5) / count)
        y, x = _spiral_direction(n)
        # The plane cuts the cone of light aslant: longer along the light than across.
        along_offset = radius * x * (1.0 + length * length)
        across_offset = radius * y * math.sqrt(1.0 + length * length)
        slopes.append(
            (
                slope[0] + along[0] * along_offset - along[1] * across_offset,
                slope[1] + along[1] * along_offset + along[0] * across_offset,
            )
        )
    return slopes


def _blur(count: NDArray[np.int32], radius: int, weight: np.float32) -> NDArray[np.float32]:
    """Return the mean of counts around each texel, twice over a square, times a weight."""
    blurred = np.zeros(count.shape, np.float32)
    if not count.any():
        return blurred
    # Beyond this part, nothing is blurred.
    part = tuple(_widen(np.flatnonzero(count.any(axis=axis)), 2 * radius) for axis in (1, 0))
    inner = np.ascontiguousarray(count[part])
    sums, scratch = np.empty_like(inner), np.empty_like(inner)
    ground_light.blur(inner, radius, sums, scratch, scratch[0].copy())
    square = (2 * radius + 1) ** 2
    blurred[part] = sums.astype(np.float32) * (weight / np.float32(square**2))
    return blurred


def _widen(indices: NDArray[np.int64], by: int) -> slice:
    """Return the texels along a side of the map from some before the first place to the last's."""
    return slice(max(int(indices[0]) - by, 0), min(int(indices[-1]) + 1 + by, SIDE))


def _fade_mask() -> NDArray[np.float32]:
    """Return a mask, (SIDE, SIDE), that fades to 0 at the borders of the map."""
    position = (np.arange(SIDE) + 0.5) / SIDE
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
        What the ground looks like in the light, by the red codes.
    codes : (H, W) uint32
    """
    size = codes.shape[1], codes.shape[0]
    view, projection, up = camera.view_matrix(), camera.projection_matrix(size), ground.frame[2]
    # From places on the map to the screen, and back: a projective map of the plane.
    step = ground.extent
    origin = ground.frame[0] * ground.low[0] + ground.frame[1] * ground.low[1] + up * ground.height
    columns = [
        [*(ground.frame[0] * step).tolist(), 0.0],
        [*(ground.frame[1] * step).tolist(), 0.0],
        [*origin.tolist(), 1.0],
    ]
    clip = transforms.compose(projection, view)[[0, 1, 3]].tolist()
    rows = [[dot(row, column) + row[3] * column[3] for column in columns] for row in clip]
    inverse = _adjugate(rows)
    sign = math.copysign(1.0, dot(rows[0], [row[0] for row in inverse]))
    result, light = codes.copy(), np.empty((size[0], 4), np.float32)
    is_dark = ground_light.darken_picture(
        sign * np.array(inverse), ground.shade, palette, srgb_encoding.encoding_table(), result,
        light, np.empty(size[0]), np.empty(size[0], np.float32),
    )  # fmt: skip
    return result if is_dark else None


def _adjugate(m: list[list[float]]) -> list[list[float]]:
    """Return the adjugate of a matrix, 3x3: its inverse but for a factor."""
    return [
        [m[1][1] * m[2][2] - m[1][2] * m[2][1], m[0][2] * m[2][1] - m[0][1] * m[2][2],
         m[0][1] * m[1][2] - m[0][2] * m[1][1]],
        [m[1][2] * m[2][0] - m[1][0] * m[2][2], m[0][0] * m[2][2] - m[0][2] * m[2][0],
         m[0][2] * m[1][0] - m[0][0] * m[1][2]],
        [m[1][0] * m[2][1] - m[1][1] * m[2][0], m[0][1] * m[2][0] - m[0][0] * m[2][1],
         m[0][0] * m[1][1] - m[0][1] * m[1][0]],
    ]  # fmt: skip
