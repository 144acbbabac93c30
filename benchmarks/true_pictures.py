"""
Draw a picture from many points of each pixel, in NumPy and float64: what levels are held against.

This shares no code with the engine's shading: it takes vertices, colours and the like as the scene
describes them, and does all else by itself, in another way. Faces lie where their corners do, not
on a grid. At each point of the screen a face has three weights that are linear there, the inverse
of the matrix of its corners (x, y, w); their sum is one over the depth [1]_. Textures are not
filtered but for the mix of the four texels around a place. Shadows have exact edges: a point is
dark where a face lies between it and the light. Lines are rectangles one pixel wide, as they are
described: the largest part of a pixel that one of them covers is drawn over its mean.

References
----------
.. [1] M. Olano, T. Greer, "Triangle Scan Conversion using 2D Homogeneous Coordinates", Graphics
   Hardware 1997.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rasterjit as rj
from rasterjit.scene.scene import EFFECT_FIELDS
from rasterjit.survey.object_counts import find_base_color

Floats = NDArray[np.float64]

SIDE = 16
"""Points lie on a grid of so many a side of each pixel, as those of the reference do."""

BAND_POINTS = 1 << 20
"""Points that are looked at together, at most, unless a row of pixels has more."""

HALF_WIDTH = 0.5
"""Of a line, pixels, and how far it goes on behind its ends."""

HEADLIGHT, HEADLIGHT_INTENSITY, HEADLIGHT_AMBIENT = (-0.3, -0.5, -1.0), 0.9, 0.1
"""What shines where a scene has no lights: which way, in the camera's axes, and how brightly."""

ON_THE_SURFACE = 1e-3
"""Share of the depth by which a line may lie behind the face that is seen beside it."""

IN_FRONT = 1e-6
"""Share of the scene's size by which a face must lie nearer to the light to cast a shadow."""


NEAREST = 1e-9
"""Scene units from the eye; what is nearer is not seen."""


@dataclass(frozen=True)
class Soup:
    """
    All faces of a scene, each with its own corners; positions are relative to the eye.

    Attributes
    ----------
    points : (F, 3, 3)
        World axes.
    clip : (F, 3, 3)
        x and y times w, and w: x and y are -1..1 in the picture, y up; w is the depth.
    colors : (F, 3, 4)
        Linear RGBA.
    normals : (F, 3, 3)
        World axes, of length one.
    uv : (F, 3, 2)
    materials : list of Material
        One for each object.
    owners : (F,) int64
        The object of each face.
    inverse : (F, 3, 3)
        Row k times (x, y, 1) is the weight of corner k, times one over the depth.
    lights : list of AmbientLight and DirectionalLight
    """

    points: Floats
    clip: Floats
    colors: Floats
    normals: Floats
    uv: Floats
    materials: list[rj.Material]
    owners: NDArray[np.int64]
    inverse: Floats
    lights: list[Any]

    @property
    def is_blended(self) -> NDArray[np.bool_]:
        """Which faces are seen through."""
        blended = np.array([material.alpha_mode == "blend" for material in self.materials])
        return blended[self.owners]


def true_light(
    scene: rj.Scene, camera: rj.PerspectiveCamera, size: tuple[int, int], side: int = SIDE
) -> Floats:
    """
    Return the mean light of each pixel, (H, W, 3) linear, before a white background.

    Parameters
    ----------
    scene : Scene
    camera : PerspectiveCamera
    size : (int, int)
        Width and height, pixels.
    side : int
        A pixel is the mean of ``side * side`` points.

    Raises
    ------
    ValueError
        If the scene has something that this program cannot draw.
    """
    _refuse(scene, camera)
    soup = _soup_of(scene, camera, size)
    width, height = size
    light = np.empty((height, width, 3))
    rows = max(BAND_POINTS // (width * side * side), 1)
    x = 2.0 * (np.arange(width * side) + 0.5) / (width * side) - 1.0
    for first in range(0, height, rows):
        stop = min(first + rows, height)
        row = np.arange(first * side, stop * side) + 0.5
        grid = x, 1.0 - 2.0 * row / (height * side)
        shown, faces = _draw_points(soup, camera, grid)
        mean = shown.reshape(stop - first, side, width, side, 3).mean(axis=(1, 3))
        if scene.wireframe is not None:
            part = _line_parts(soup, size, side, grid, faces)[..., np.newaxis]
            mean = (1.0 - part) * mean + part * scene.wireframe.color[:3]
        light[first:stop] = mean
    return light


def _refuse(scene: rj.Scene, camera: rj.PerspectiveCamera) -> None:
    """Raise ``ValueError`` for what is beyond this program."""
    if not isinstance(camera, rj.PerspectiveCamera):
        raise ValueError(f"camera must be a PerspectiveCamera, got {type(camera).__name__}")
    for name in EFFECT_FIELDS:
        if name != "wireframe" and getattr(scene, name) is not None:
            raise ValueError(f"scene.{name} must be None, got {getattr(scene, name)!r}")
    for light in scene.lights:
        if not isinstance(light, (rj.AmbientLight, rj.DirectionalLight)):
            raise ValueError(f"lights must be ambient or directional, got {light!r}")
    for node in scene.nodes:
        material = node.mesh.material
        if material.shading not in ("unlit", "phong"):
            raise ValueError(f"shading must be 'unlit' or 'phong', got {material.shading!r}")
        if material.alpha_mode == "mask" or material.emits:
            raise ValueError(f"there must be no mask and no emission on {node.name!r}")
        if any(texture is not None for texture in material.textures_read()[1:]):
            raise ValueError(f"there must be no texture but for the base colour on {node.name!r}")
        texture = material.base_color_texture
        if texture is not None and texture.filter == "nearest":
            raise ValueError(f"the texture of {node.name!r} must not have filter 'nearest'")


# Where the faces are


def _soup_of(scene: rj.Scene, camera: rj.PerspectiveCamera, size: tuple[int, int]) -> Soup:
    """Return the faces of a scene as a camera sees them."""
    eye, axes = np.array(camera.eye, np.float64), camera.view_matrix()[:3, :3]
    focal = 1.0 / math.tan(math.radians(camera.fov_y) / 2.0)
    lists: dict[str, list[Any]] = {name: [] for name in ("points", "colors", "normals", "uv")}
    owners = []
    for number, node in enumerate(scene.nodes):
        mesh, matrix = node.mesh, np.asarray(node.world_from_model, np.float64)
        faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices, np.float64)
        # What is far from the origin loses nothing before the eye is taken off.
        points = vertices @ matrix[:3, :3].T + (matrix[:3, 3] - eye)
        colors = np.tile(np.array(find_base_color(mesh)), (*faces.shape, 1))
        if mesh.vertex_colors is not None:
            colors *= np.asarray(mesh.vertex_colors, np.float64)[faces]
        if mesh.face_colors is not None:
            colors *= np.asarray(mesh.face_colors, np.float64)[:, np.newaxis]
        normals = mesh.normals
        if normals is None:
            normals = _mean_normals(vertices, faces)
        normals = _unit(np.asarray(normals, np.float64) @ np.linalg.inv(matrix[:3, :3]))
        texture = mesh.material.base_color_texture
        uv = np.zeros((len(vertices), 2))
        if texture is not None:
            uv = np.asarray(mesh.uv_sets[texture.uv_set], np.float64)
        corners = points[faces], colors, normals[faces], uv[faces]
        for name, values in zip(lists, corners, strict=True):
            lists[name].append(values)
        owners += [number] * len(faces)
    found = {name: np.concatenate(parts) for name, parts in lists.items()}
    seen = found["points"] @ axes.T
    clip = np.stack(
        [seen[..., 0] * focal * size[1] / size[0], seen[..., 1] * focal, -seen[..., 2]], axis=-1
    )
    # Faces without an area, or seen from the side, show nothing.
    flat = np.abs(np.linalg.det(clip)) < 1e-300
    inverse = np.full_like(clip, np.nan)
    # Corners are the rows of ``clip``: the weights are the columns of its inverse.
    inverse[~flat] = np.swapaxes(np.linalg.inv(clip[~flat]), 1, 2)
    materials = [node.mesh.material for node in scene.nodes]
    lights = list(scene.lights) or [
        rj.AmbientLight(intensity=HEADLIGHT_AMBIENT),
        rj.DirectionalLight(np.array(HEADLIGHT) @ axes, intensity=HEADLIGHT_INTENSITY),
    ]
    return Soup(
        **found, clip=clip, materials=materials, owners=np.array(owners), inverse=inverse,
        lights=lights,
    )  # fmt: skip


def _mean_normals(vertices: Floats, faces: NDArray[Any]) -> Floats:
    """Return the mean normal of the faces around each vertex, weighted by area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    # Twice the area is the length of the cross product.
    areas, normals = np.cross(b - a, c - a), np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], areas)
    return normals


def _unit(vectors: Floats) -> Floats:
    """Return vectors of length one; zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


# Which face each point shows


def _draw_points(
    soup: Soup, camera: rj.PerspectiveCamera, grid: tuple[Floats, Floats]
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the light at the points of a grid, (R, C, 3), and which opaque faces they show."""
    x, y = grid
    nearness = np.zeros((len(y), len(x)))
    faces = np.full(nearness.shape, -1)
    behind = np.ones((*nearness.shape, 3))
    blended = soup.is_blended
    for face, window, near in _covered(soup, camera, grid, np.flatnonzero(~blended)):
        is_nearer = near > nearness[window]
        nearness[window] = np.where(is_nearer, near, nearness[window])
        faces[window] = np.where(is_nearer, face, faces[window])
    shown = faces >= 0
    row, column = np.nonzero(shown)
    behind[shown] = _shade(soup, faces[shown], x[column], y[row])[:, :3]
    # Lay what is seen through over it, the farthest first.
    layers = np.zeros((np.count_nonzero(blended), *nearness.shape))
    numbers = np.flatnonzero(blended)
    for face, window, near in _covered(soup, camera, grid, numbers):
        layer = layers[np.searchsorted(numbers, face)]
        layer[window] = np.where(near > nearness[window], near, 0.0)
    order = np.argsort(layers, axis=0)
    for nth in order:
        near = np.take_along_axis(layers, nth[np.newaxis], 0)[0]
        row, column = np.nonzero(near > 0.0)
        over = _shade(soup, numbers[nth[row, column]], x[column], y[row])
        alpha = over[:, 3:]
        behind[row, column] = alpha * over[:, :3] + (1.0 - alpha) * behind[row, column]
    return behind, faces


def _covered(
    soup: Soup,
    camera: rj.PerspectiveCamera,
    grid: tuple[Floats, Floats],
    numbers: NDArray[Any],
) -> Iterator[tuple[int, tuple[slice, slice], Floats]]:
    """Yield each face that covers points: its number, a window around them, one over its depth."""
    x, y = grid
    # A near plane that is not given cuts nothing in view
    least = NEAREST if camera.near is None else camera.near
    for face in numbers.tolist():
        clip, inverse = soup.clip[face], soup.inverse[face]
        if np.isnan(inverse[0, 0]) or (clip[:, 2] < least).all():
            continue
        window = slice(0, len(y)), slice(0, len(x))
        if (clip[:, 2] >= least).all():
            places = clip[:, :2] / clip[:, 2:]
            left, bottom = places.min(axis=0)
            right, top = places.max(axis=0)
            columns = np.searchsorted(x, (left, right))
            rows = np.searchsorted(-y, (-top, -bottom))
            window = slice(*rows.tolist()), slice(*columns.tolist())
        across, down = x[window[1]], y[window[0], np.newaxis]
        weights = [row[0] * across + row[1] * down + row[2] for row in inverse]
        near = weights[0] + weights[1] + weights[2]
        inside = (near > 1.0 / camera.far) & (near <= 1.0 / least)
        for weight in weights:
            inside &= weight >= 0.0
        if inside.any():
            yield face, window, np.where(inside, near, 0.0)


def _line_parts(
    soup: Soup,
    size: tuple[int, int],
    side: int,
    grid: tuple[Floats, Floats],
    faces: NDArray[np.int64],
) -> Floats:
    """Return the largest part of each pixel that an edge covers where nothing hides it, (R, W)."""
    half = np.array(size) / 2.0
    x, y = (grid[0] + 1.0) * half[0], (1.0 - grid[1]) * half[1]
    found = np.zeros((len(y) // side, len(x) // side))
    # One over the depth of each face is linear on the screen, so also beside the face.
    planes = np.append(soup.inverse.sum(axis=1), np.zeros((1, 3)), axis=0)
    corners = [[tuple(corner) for corner in face] for face in soup.clip.tolist()]
    edges = {tuple(sorted((face[k], face[k - 1]))) for face in corners for k in range(3)}
    for start, end in np.array(sorted(edges)):
        if min(start[2], end[2]) <= 0.0:
            raise ValueError("lines must lie in front of the eye")
        a, b = ((1.0 + one[:2] / one[2] * (1.0, -1.0)) * half for one in (start, end))
        length = math.hypot(*(b - a))
        way = (b - a) / length if length > 0.0 else np.array([1.0, 0.0])
        # Take whole pixels: those that the line may reach.
        low, high = np.minimum(a, b) - 2.0 * HALF_WIDTH, np.maximum(a, b) + 2.0 * HALF_WIDTH
        pixels = [
            slice(np.searchsorted(at, first) // side, -(-np.searchsorted(at, last) // side))
            for at, first, last in zip((y, x), low[::-1], high[::-1], strict=True)
        ]
        rows, columns = (slice(side * one.start, side * one.stop) for one in pixels)
        right, down = x[columns] - a[0], y[rows, np.newaxis] - a[1]
        along, aside = right * way[0] + down * way[1], right * way[1] - down * way[0]
        covers = (np.abs(aside) <= HALF_WIDTH) & (
            np.abs(along - length / 2.0) <= length / 2.0 + HALF_WIDTH
        )
        share = np.clip(along / length if length > 0.0 else 0.0 * along, 0.0, 1.0)
        near = (1.0 - share) / start[2] + share / end[2]
        at_x, at_y = a[0] + share * (b - a)[0], a[1] + share * (b - a)[1]
        plane = planes[faces[rows, columns]]
        surface = (
            plane[..., 0] * (at_x / half[0] - 1.0) + plane[..., 1] * (1.0 - at_y / half[1])
            + plane[..., 2]
        )  # fmt: skip
        covers &= near >= surface * (1.0 - ON_THE_SURFACE)
        cells = covers.reshape(covers.shape[0] // side, side, covers.shape[1] // side, side)
        part = found[tuple(pixels)]
        np.maximum(part, cells.mean(axis=(1, 3)), out=part)
    return found


# What a face shows at a point


def _shade(soup: Soup, faces: NDArray[Any], x: Floats, y: Floats) -> Floats:
    """Return the light of points on faces, with their alpha, (n, 4)."""
    inverse = soup.inverse[faces]
    weights = inverse[..., 0] * x[:, np.newaxis] + inverse[..., 1] * y[:, np.newaxis]
    weights += inverse[..., 2]
    weights /= weights.sum(axis=1, keepdims=True)

    def between(values: Floats) -> Floats:
        return np.einsum("nk,nkc->nc", weights, values[faces])

    colors, owners = between(soup.colors), soup.owners[faces]
    for number, material in enumerate(soup.materials):
        own = owners == number
        if not own.any():
            continue
        if material.base_color_texture is not None:
            colors[own] *= _texture_at(material.base_color_texture, between(soup.uv)[own])
    is_lit = np.array([material.shading != "unlit" for material in soup.materials])[owners]
    if is_lit.any():
        lit = _light(soup, faces[is_lit], between(soup.points)[is_lit],
                     between(soup.normals)[is_lit], colors[is_lit, :3])  # fmt: skip
        colors[is_lit, :3] = lit
    return colors


def _texture_at(texture: rj.Texture, uv: Floats) -> Floats:
    """Return the mix of the four texels around each place, (n, 4) linear RGBA."""
    height, width, _ = texture.image.shape
    turn = math.radians(texture.rotation)
    u, v = (uv * texture.scale).T
    moved = (
        math.cos(turn) * u - math.sin(turn) * v + texture.offset[0],
        math.sin(turn) * u + math.cos(turn) * v + texture.offset[1],
    )
    across, down = moved[0] * width - 0.5, (1.0 - moved[1]) * height - 0.5
    left, top = np.floor(across), np.floor(down)
    shown = np.zeros((len(uv), 4))
    for right in (0, 1):
        for low in (0, 1):
            share = np.abs(1 - right - (across - left)) * np.abs(1 - low - (down - top))
            column = _wrapped(left + right, width, texture.wrap[0])
            row = _wrapped(top + low, height, texture.wrap[1])
            shown += share[:, np.newaxis] * texture.image[row, column]
    return shown


def _wrapped(texel: Floats, count: int, wrap: str) -> NDArray[np.int64]:
    """Return the texel that is shown at a place beside the picture, too."""
    number = texel.astype(np.int64)
    if wrap == "clamp":
        return np.clip(number, 0, count - 1)
    if wrap == "repeat":
        return number % count
    return np.minimum(number % (2 * count), 2 * count - 1 - number % (2 * count))


def _light(
    soup: Soup, faces: NDArray[Any], points: Floats, normals: Floats, base: Floats
) -> Floats:
    """Return the light that points reflect: ambient, Lambert's, and Blinn's highlight."""
    toward_eye, normals = _unit(-points), _unit(normals)
    corners = soup.points[faces]
    plane = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_back = (plane * toward_eye).sum(axis=1) < 0.0
    normals[is_back] *= -1.0
    own = [soup.materials[number] for number in range(len(soup.materials))]
    owners = soup.owners[faces]
    specular = np.array([material.specular for material in own])[owners]
    shininess = np.array([material.shininess for material in own])[owners]
    shown = np.zeros_like(base)
    for light in soup.lights:
        color = np.array(light.color) * light.intensity
        if isinstance(light, rj.AmbientLight):
            shown += base * color
            continue
        toward_light = -np.array(light.direction)
        facing = np.maximum(normals @ toward_light, 0.0)
        if light.shadow is not None:
            facing[_is_shadowed(soup, points, np.array(light.direction), facing > 0.0)] = 0.0
        half = _unit(toward_light + toward_eye)
        shine = np.maximum((normals * half).sum(axis=1), 0.0) ** shininess * specular
        shine[facing == 0.0] = 0.0
        shown += color * (base * facing[:, np.newaxis] + shine[:, np.newaxis])
    return shown


def _is_shadowed(
    soup: Soup, points: Floats, direction: Floats, asked: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return before which points another face lies, seen from a light infinitely far away."""
    # Two axes across the light, and how far its light has come.
    side = _unit(np.cross(direction, np.eye(3)[np.abs(direction).argmin()]))
    axes = np.stack([side, np.cross(direction, side), direction])
    places, found = points[asked] @ axes.T, np.zeros(np.count_nonzero(asked), np.bool_)
    apart = IN_FRONT * np.ptp(soup.points.reshape(-1, 3), axis=0).max()
    order = np.argsort(places[:, 0])
    sorted_places = places[order]
    for corners in soup.points[~soup.is_blended] @ axes.T:
        lowest, highest = corners.min(axis=0), corners.max(axis=0)
        start, stop = np.searchsorted(sorted_places[:, 0], (lowest[0], highest[0]))
        near = sorted_places[start:stop]
        asked_of = np.flatnonzero((near[:, 1] >= lowest[1]) & (near[:, 1] <= highest[1])
                                  & (near[:, 2] > lowest[2] + apart))  # fmt: skip
        matrix = np.append(corners[:, :2], np.ones((3, 1)), axis=1).T
        if len(asked_of) == 0 or abs(np.linalg.det(matrix)) < 1e-12:
            continue
        at = np.append(near[asked_of, :2], np.ones((len(asked_of), 1)), axis=1)
        weights = at @ np.linalg.inv(matrix).T
        covers = (weights >= 0.0).all(axis=1) & (
            weights @ corners[:, 2] < near[asked_of, 2] - apart
        )
        found[order[start:stop][asked_of[covers]]] = True
    result = asked.copy()
    result[asked] = found
    return result
