"""
Draw slow references for effects: the exact results that effects approximate.

Each returns the light of every pixel in the standard quality, with the exact effect.

References
----------
.. [1] P. Debevec, "A Median Cut Algorithm for Light Probe Sampling", SIGGRAPH 2005 posters.
.. [2] M. Cohen, D. Greenberg, "The Hemi-Cube: A Radiosity Solution for Complex Environments",
   SIGGRAPH 1985.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.ambient_occlusion import get_radius
from rasterjit.effects.environment import LIGHT
from rasterjit.rendering.batch import render_batch
from rasterjit.rendering.view_warnings import ViewWarning
from rasterjit.scene import transforms
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.environment import Environment, Panorama
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, PointLight, Shadow
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.warning import silence_warnings
from rasterjit.survey.effect import with_field
from rasterjit.survey.material_features import with_materials

if TYPE_CHECKING:
    from rasterjit.accuracy.study import Studio

Float64 = NDArray[np.float64]

MIN_SHADOW_POINTS, MAX_SHADOW_POINTS = 16, 64
"""Limits of the number of points on a light whose hard shadows are averaged."""

MIN_MAP_SIZE, SHARP_MAP_SIZE = 2048, 4096
"""Texels along a side of shadow maps: at least those of averaged hard shadows; those of the
reference of hard or filtered shadows."""

MAX_DOME_LIGHTS, LIGHTS_PER_PICTURE = 256, 64
"""Most lights that represent an environment, and number of those in one picture."""

GRADIENT_ROWS = 128
"""Rows of texels that a sky with a gradient is sampled at."""

MAX_OCCLUSION_POINTS = 100
"""Most points whose ambient occlusion is measured."""

CUBE_MAP_SIDE = 32
"""Side of the cube map around a point, pixels."""

NEAR_OFFSET_RADII = 2e-3
"""Offset of a point above its surface, and near plane of its views, in radii."""


class LightReference(NamedTuple):
    """Reference light that an effect is measured against."""

    light: Float64
    """(H, W, 3), linear."""
    is_known: NDArray[np.bool_] | None = None
    """(H, W): pixels at which the light is known; None for all."""
    share: float = 1.0
    """Share of all pixels that these represent; in the others the effect has no error."""
    prepare_scene: Callable[[Scene], Scene] = lambda scene: scene
    """Returns a scene with only the features that the reference shows."""

    def difference(self, light: Float64) -> Float64:
        """Return the absolute difference of light, (H, W, 3), or (1, N, 3) of the known pixels."""
        difference = np.abs(light - self.light)
        return difference if self.is_known is None else difference[self.is_known][np.newaxis]


STANDARD_QUALITY = Quality.standard()


def is_soft(light: Light) -> bool:
    """Tell whether a light has a soft shadow."""
    shadow = getattr(light, "shadow", None)
    return shadow is not None and shadow.filter == "soft"


def average_hard_shadows(studio: Studio, scene: Scene, seconds: float) -> LightReference:
    """Average hard shadows from points spread over each light."""
    middle, _ = scene.bounding_sphere()
    begin = time.perf_counter()
    total: Any = 0.0
    for count, (x, y) in enumerate(spread_over_disk(MAX_SHADOW_POINTS), 1):
        lights = [_sample_light(light, x, y, np.asarray(middle)) for light in scene.lights]
        total = total + studio.draw_light(STANDARD_QUALITY, with_field(scene, "lights", lights))
        if count >= MIN_SHADOW_POINTS and time.perf_counter() - begin > seconds:
            break
    return LightReference(total / count)


def spread_over_disk(count: int) -> Float64:
    """Return points of the unit disk, (count, 2), of which any first ones are spread evenly."""
    # The plastic number's powers: the generalized golden ratio in two dimensions.
    turns = (np.arange(count)[:, np.newaxis] * (0.7548776662466927, 0.5698402909980532) + 0.5) % 1.0
    sines = np.array([transforms.sine_cosine(360.0 * turn) for turn in turns[:, 1]])
    return np.sqrt(turns[:, :1]) * sines[:, ::-1]


def _sample_light(light: Any, x: float, y: float, middle: Float64) -> Any:
    """Return the hard light at (x, y) of a soft light's unit disk, which faces the scene."""
    if not is_soft(light):
        return light
    shadow = light.shadow
    hard = Shadow(max(shadow.size, MIN_MAP_SIZE), "hard", bias=shadow.bias)
    if isinstance(light, DirectionalLight):
        axis = np.array(light.direction)
        sine, cosine = transforms.sine_cosine(0.5 * shadow.light_size)
        u, v = _find_perpendiculars(axis)
        return replace(light, direction=axis + (sine / cosine) * (x * u + y * v), shadow=hard)
    position = np.array(light.position)
    axis = middle - position if isinstance(light, PointLight) else np.array(light.direction)
    u, v = _find_perpendiculars(axis)
    position = position + 0.5 * shadow.light_size * (x * u + y * v)
    return replace(light, position=position, shadow=hard)


def _find_perpendiculars(axis: Float64) -> tuple[Float64, Float64]:
    """Return two unit vectors at right angles to an axis, and to each other."""
    length = float(np.linalg.norm(axis))
    axis = axis / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    farthest_axis = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = np.cross(axis, farthest_axis)
    u /= np.linalg.norm(u)
    return u, np.cross(axis, u)


def draw_sharp_shadows(studio: Studio, scene: Scene, seconds: float) -> LightReference:
    """Draw hard shadows of large maps."""

    def sharpen(light: Any) -> Any:
        if getattr(light, "shadow", None) is None:
            return light
        return replace(light, shadow=replace(light.shadow, size=SHARP_MAP_SIZE, filter="hard"))

    lights = [sharpen(light) for light in scene.lights]
    return LightReference(studio.draw_light(STANDARD_QUALITY, with_field(scene, "lights", lights)))


def draw_dome_lights(studio: Studio, scene: Scene, seconds: float) -> LightReference:
    """Light diffuse surfaces by directional lights that represent an environment."""
    dark = LIGHT.without(remove_highlights(scene))
    light = studio.draw_light(STANDARD_QUALITY, dark)
    unlit = studio.draw_light(STANDARD_QUALITY, with_field(dark, "lights", []))
    lights = find_dome_lights(scene.environment)
    for first in range(0, len(lights), LIGHTS_PER_PICTURE):
        partly_lit = with_field(dark, "lights", lights[first : first + LIGHTS_PER_PICTURE])
        light += studio.draw_light(STANDARD_QUALITY, partly_lit) - unlit
    is_covered = studio.draw(STANDARD_QUALITY, ("face_id",)).face_id >= 0
    return LightReference(light, is_covered, float(is_covered.mean()), remove_highlights)


def remove_highlights(scene: Scene) -> Scene:
    """Return a scene whose surfaces have no highlights."""
    changes: dict[str, Any] = {
        "specular": 0.0, "metallic": 0.0, "specular_factor": 0.0, "clearcoat": 0.0,
        "sheen_color": "black", "transmission": 0.0,
    }  # fmt: skip
    return with_materials(scene, lambda material: replace(material, **changes))


def sample_sky(environment: Environment) -> tuple[Float64, Float64, Float64]:
    """Return light and directions of a sky's texels, (H, W, 3), and solid angles by row, (H,)."""
    sky = environment.sky
    image = np.asarray(sky.image, np.float64) if isinstance(sky, Panorama) else None
    height, width = (GRADIENT_ROWS, 2 * GRADIENT_ROWS) if image is None else image.shape[:2]
    edges = [transforms.sine_cosine(90.0 - 180.0 * row / height)[0] for row in range(height + 1)]
    solid_angles = -np.diff(edges) * 2.0 * math.pi / width
    elevations = [90.0 - 180.0 * (row + 0.5) / height for row in range(height)]
    azimuths = [360.0 * ((column + 0.5) / width - 0.5) for column in range(width)]
    sine, cosine = np.array([*map(transforms.sine_cosine, elevations)]).T[:, :, np.newaxis]
    z, x = np.array([*map(transforms.sine_cosine, azimuths)]).T[:, np.newaxis]
    directions = np.stack([cosine * x, sine + 0.0 * x, cosine * z], axis=2)
    if image is None:
        zenith, horizon, ground = np.array([sky.zenith, sky.horizon, sky.ground])
        y = directions[:, :, 1:2]
        image = horizon + np.maximum(y, 0.0) * (zenith - horizon)
        image = image + np.maximum(-y, 0.0) * (ground - horizon)
    rotation = transforms.rotate_y(environment.rotation)[:3, :3]
    return environment.intensity * image, directions @ rotation.T, solid_angles


def find_dome_lights(environment: Environment) -> list[Light]:
    """Return directional lights that represent an environment, by median cuts [1]_."""
    image, directions, solid_angles = sample_sky(environment)
    power = image * solid_angles[:, np.newaxis, np.newaxis]
    energy = power.sum(axis=2)
    regions = [(0, energy.shape[0], 0, energy.shape[1])]
    while len(regions) < MAX_DOME_LIGHTS:
        halves = [half for region in regions for half in _halve(region, energy)]
        if len(halves) == len(regions):
            break
        regions = halves
    lights: list[Light] = []
    for top, bottom, left, right in regions:
        light = power[top:bottom, left:right].sum(axis=(0, 1))
        weights = energy[top:bottom, left:right, np.newaxis]
        direction = (weights * directions[top:bottom, left:right]).sum(axis=(0, 1))
        strength = float(light.max())
        if strength > 0.0:
            # The mean direction, not normalized, gives surfaces that face the whole region the
            # same light as the region.
            length = float(np.linalg.norm(direction)) / float(weights.sum())
            color = tuple((light / strength).tolist())
            lights.append(DirectionalLight(-direction, color, length * strength / math.pi))
    return lights


def _halve(region: tuple[int, int, int, int], energy: Float64) -> list[tuple[int, int, int, int]]:
    """Return the two halves, by energy, of a region of the sky, cut across its longer side."""
    top, bottom, left, right = region
    _, cosine = transforms.sine_cosine(90.0 - 90.0 * (top + bottom) / energy.shape[0])
    is_tall = bottom - top > (right - left) * cosine
    if max(bottom - top, right - left) == 1:
        return [region]
    if (is_tall and bottom - top > 1) or right - left == 1:
        middle = top + _find_median(energy[top:bottom, left:right].sum(axis=1))
        return [(top, middle, left, right), (middle, bottom, left, right)]
    middle = left + _find_median(energy[top:bottom, left:right].sum(axis=0))
    return [(top, bottom, left, middle), (top, bottom, middle, right)]


def _find_median(amounts: Float64) -> int:
    """Return how many first amounts are half of the sum, at least one and not all."""
    half = int(np.searchsorted(np.cumsum(amounts), 0.5 * amounts.sum()))
    return min(max(half, 1), len(amounts) - 1)


def average_environment(scene: Scene) -> Scene:
    """Return a scene with an environment of one colour, the mean of its light."""
    image, _, solid_angles = sample_sky(scene.environment)
    mean = (image * solid_angles[:, np.newaxis, np.newaxis]).sum(axis=(0, 1)) / (4.0 * math.pi)
    strength = float(mean.max()) or 1.0
    color = tuple((mean / strength).tolist())
    even = Environment.constant(color, intensity=strength, background=scene.environment.background)
    return with_field(scene, "environment", even)


def trace_ambient_occlusion(studio: Studio, scene: Scene, seconds: float) -> LightReference:
    """Measure ambient occlusion at some points by cube maps around them."""
    effect = scene.ambient_occlusion
    # Separate the ambient light from the rest.
    open_light = studio.draw_light(STANDARD_QUALITY, with_field(scene, "ambient_occlusion", None))
    light = studio.draw_light(STANDARD_QUALITY, _remove_ambient_light(scene))
    has_ambient = np.abs(open_light - light).max(axis=2) > 0.0
    # Choose visible points spread over the picture.
    frame = studio.draw(STANDARD_QUALITY, ("position", "geometric_normal", "face_id"))
    rows, columns = np.nonzero(has_ambient & (frame.face_id >= 0))
    is_known = np.zeros(has_ambient.shape, bool)
    if len(rows) == 0:
        return LightReference(open_light, is_known, 0.0)
    count = min(MAX_OCCLUSION_POINTS, len(rows))
    chosen = np.arange(count) * len(rows) // count
    rows, columns = rows[chosen], columns[chosen]
    is_known[rows, columns] = True
    # Weaken their ambient light.
    positions = frame.position[rows, columns].astype(np.float64)
    normals = frame.geometric_normal[rows, columns].astype(np.float64)
    occlusion = measure_occlusion(scene, positions, normals, get_radius(effect, scene))
    openness = 1.0 - effect.strength * occlusion
    ambient = open_light[rows, columns] - light[rows, columns]
    light[rows, columns] += openness[:, np.newaxis] * ambient
    return LightReference(light, is_known, float(has_ambient.mean()))


def _remove_ambient_light(scene: Scene) -> Scene:
    """Return a scene without ambient lights, environment light and ambient occlusion."""
    lights: list[Light] = [one for one in scene.lights if not isinstance(one, AmbientLight)]
    # A scene without any light would get the default lights.
    lights = lights or [AmbientLight(intensity=0.0)]
    dark = with_field(with_field(scene, "lights", lights), "ambient_occlusion", None)
    return dark if scene.environment is None else LIGHT.without(dark)


def measure_occlusion(scene: Scene, positions: Float64, normals: Float64, radius: float) -> Float64:
    """
    Return the share of ambient light that surfaces within a radius block, (N,), by [2]_.

    Parameters
    ----------
    positions, normals : (N, 3) float64
        World space; normals of length one, towards the open side.
    radius : float, scene units
    """
    # Five faces of a cube map; cosines of the normal with each face's up and view directions.
    cameras, cosines = [], []
    for position, normal in zip(positions, normals, strict=True):
        eye = position + NEAR_OFFSET_RADII * radius * normal
        u, v = _find_perpendiculars(normal)
        for toward, up in ((normal, u), (u, normal), (-u, normal), (v, normal), (-v, normal)):
            cameras.append(
                PerspectiveCamera(
                    eye, eye + radius * toward, up=up, fov_y=90.0, near=NEAR_OFFSET_RADII * radius,
                    far=2.0 * radius,
                )
            )  # fmt: skip
            cosines.append((float(up @ normal), float(toward @ normal)))
    # Cameras are inside objects and cut distant ones off, on purpose.
    with silence_warnings(ViewWarning):
        size = CUBE_MAP_SIDE, CUBE_MAP_SIDE
        distances = render_batch(scene, cameras, size=size, outputs=("distance",)).distance
    centers = (np.arange(CUBE_MAP_SIDE) + 0.5) * (2.0 / CUBE_MAP_SIDE) - 1.0
    x, y = np.meshgrid(centers, -centers)
    length = np.sqrt(x * x + y * y + 1.0)
    blocked = np.zeros(len(cameras) // 5)
    total = np.zeros_like(blocked)
    for number, (up_cosine, toward_cosine) in enumerate(cosines):
        height = np.maximum(y * up_cosine + toward_cosine, 0.0)
        # Form factor of a pixel: the cosine, over the square of its distance and its slope.
        form_factor = height / length**4
        blocked[number // 5] += (form_factor * (distances[number] <= radius)).sum()
        total[number // 5] += form_factor.sum()
    return blocked / total


def has_lines(scene: Scene) -> bool:
    """Tell whether a scene has line primitives."""
    return any(node.mesh is not None and node.mesh.primitive == "lines" for node in scene.nodes)


def remove_lines(scene: Scene) -> Scene:
    """Return a scene without its lines."""
    nodes = [node for node in scene.nodes if node.mesh.primitive != "lines"]
    return with_field(scene, "nodes", nodes)


def draw_sampled_lines(studio: Studio, scene: Scene, seconds: float) -> LightReference:
    """Draw lines with many samples, and mark their pixels."""
    lineless = remove_lines(scene)
    shows_lines = [
        (studio.draw_light(quality) != studio.draw_light(quality, lineless)).any(axis=2)
        for quality in (STANDARD_QUALITY, replace(STANDARD_QUALITY, samples=16))
    ]
    is_known = shows_lines[0] | shows_lines[1]
    light = studio.draw_light(replace(STANDARD_QUALITY, samples=64))
    return LightReference(light, is_known, float(is_known.mean()))


def draw_sampled_lens(studio: Studio, scene: Scene, seconds: float) -> LightReference:
    """Draw a lens with many samples."""
    return LightReference(studio.draw_light(replace(STANDARD_QUALITY, samples=64)))


def draw_line_coverage(studio: Studio, scene: Scene, seconds: float) -> LightReference:
    """Draw wireframe lines by the areas that they cover."""
    return LightReference(studio.draw_light(replace(STANDARD_QUALITY, lines="coverage")))
