"""
Slow references for effects: what each effect approximates.

Each returns the light of every pixel in the standard quality, with the effect as it ought to be.

References
----------
.. [1] P. Debevec, "A Median Cut Algorithm for Light Probe Sampling", SIGGRAPH 2005 posters.
.. [2] M. Cohen, D. Greenberg, "The Hemi-Cube: A Radiosity Solution for Complex Environments",
   SIGGRAPH 1985.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.ambient_occlusion import radius_of
from rasterjit.effects.environment import LIGHT
from rasterjit.rendering.batch import render_batch
from rasterjit.rendering.view_warnings import ViewWarning
from rasterjit.scene import transforms
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.environment import Environment, Panorama
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, PointLight, Shadow
from rasterjit.scene.material import Material
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import with_field
from rasterjit.survey.material_features import with_materials

if TYPE_CHECKING:
    from rasterjit.accuracy.study import Studio

Float64 = NDArray[np.float64]

MIN_LIGHTS, MAX_LIGHTS = 16, 64
"""Limits of the number of points on a light whose hard shadows are averaged."""

MIN_MAP_SIZE, SHARP_MAP_SIZE = 2048, 4096
"""Texels along a side of shadow maps: of those hard shadows, at least; of the reference of shadows
that are hard or filtered."""

MAX_DOME_LIGHTS, BATCH_LIGHTS = 256, 64
"""Number of lights that represent an environment, and of those in one picture."""

SKY_ROWS = 128
"""Rows of the sky that is cut into lights, at most; of a gradient, all."""

POINT_ROWS = 10
"""Rows and columns of the points whose ambient occlusion is measured."""

SIDE = 32
"""Side of the cube map around such a point, pixels."""

NEAR_RADII = 2e-3
"""Offset of a point above its surface, and near plane of its views, in radii."""


def unchanged(scene: Scene) -> Scene:
    """Return a scene."""
    return scene


class LightReference(NamedTuple):
    """Reference light that an effect is measured against."""

    light: Float64
    """(H, W, 3), linear."""
    where: NDArray[np.bool_] | None = None
    """(H, W): pixels at which it is known; None: at every one."""
    share: float = 1.0
    """Share of the picture's pixels that those stand for: in the others the effect has no error."""
    compared: Callable[[Scene], Scene] = unchanged
    """Returns a scene with only what the reference shows of it."""

    def difference(self, light: Float64) -> Float64:
        """Return the difference of other light, (H, W, 3), or (1, N, 3) of the known pixels."""
        apart = np.abs(light - self.light)
        return apart if self.where is None else apart[self.where][np.newaxis]


STANDARD = Quality.standard()


def is_soft(light: Light) -> bool:
    """Tell whether a light has a soft shadow."""
    shadow = getattr(light, "shadow", None)
    return shadow is not None and shadow.filter == "soft"


def many_lights(painter: Studio, scene: Scene, seconds: float) -> LightReference:
    """Average hard shadows from places all over each light."""
    middle, _ = scene.bounding_sphere()
    begin, count = time.perf_counter(), 0
    total: Any = None
    for x, y in disk(MAX_LIGHTS):
        lights = [_point_on_light(light, x, y, np.asarray(middle)) for light in scene.lights]
        light = painter.light(STANDARD, with_field(scene, "lights", lights))
        total = light if total is None else total + light
        count += 1
        if count >= MIN_LIGHTS and time.perf_counter() - begin > seconds:
            break
    return LightReference(total / count)


def disk(count: int) -> Float64:
    """Return points of the unit disk, (count, 2): however many of the first, they lie evenly."""
    # The plastic number's powers: the generalized golden ratio in two dimensions.
    turns = (np.arange(count)[:, np.newaxis] * (0.7548776662466927, 0.5698402909980532) + 0.5) % 1.0
    sines = np.array([transforms.sine_cosine(360.0 * turn) for turn in turns[:, 1]])
    return np.sqrt(turns[:, :1]) * sines[:, ::-1]


def _point_on_light(light: Any, x: float, y: float, middle: Float64) -> Any:
    """Return a point of a soft light as a hard one; its disk faces the scene's middle."""
    if not is_soft(light):
        return light
    shadow = light.shadow
    hard = Shadow(max(shadow.size, MIN_MAP_SIZE), "hard", bias=shadow.bias)
    if isinstance(light, DirectionalLight):
        axis = np.array(light.direction)
        sine, cosine = transforms.sine_cosine(0.5 * shadow.light_size)
        u, v = _perpendiculars(axis)
        return replace(light, direction=axis + (sine / cosine) * (x * u + y * v), shadow=hard)
    place = np.array(light.position)
    axis = middle - place if isinstance(light, PointLight) else np.array(light.direction)
    u, v = _perpendiculars(axis)
    moved = place + 0.5 * shadow.light_size * (x * u + y * v)
    return replace(light, position=moved, shadow=hard)


def _perpendiculars(axis: Float64) -> tuple[Float64, Float64]:
    """Return two unit vectors at right angles to an axis, and to each other."""
    length = float(np.linalg.norm(axis))
    axis = axis / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    least = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = np.cross(axis, least)
    u /= np.linalg.norm(u)
    return u, np.cross(axis, u)


def sharp_shadows(painter: Studio, scene: Scene, seconds: float) -> LightReference:
    """Draw shadows of large maps."""

    def sharp(light: Any) -> Any:
        if getattr(light, "shadow", None) is None:
            return light
        return replace(light, shadow=replace(light.shadow, size=SHARP_MAP_SIZE, filter="hard"))

    lights = [sharp(light) for light in scene.lights]
    return LightReference(painter.light(STANDARD, with_field(scene, "lights", lights)))


def dome_of_lights(painter: Studio, scene: Scene, seconds: float) -> LightReference:
    """Light diffuse surfaces by directional lights that represent an environment."""
    dark = LIGHT.without(without_highlights(scene))
    truth = painter.light(STANDARD, dark)
    unlit = painter.light(STANDARD, with_field(dark, "lights", []))
    lights = dome_lights(scene.environment)
    for first in range(0, len(lights), BATCH_LIGHTS):
        some = with_field(dark, "lights", lights[first : first + BATCH_LIGHTS])
        truth += painter.light(STANDARD, some) - unlit
    covered = painter.draw(STANDARD, ("face_id",)).face_id >= 0
    return LightReference(truth, covered, float(covered.mean()), without_highlights)


def without_highlights(scene: Scene) -> Scene:
    """Return a scene whose surfaces have no highlights."""

    def dull(material: Material) -> Material:
        return replace(
            material, specular=0.0, metallic=0.0, specular_factor=0.0, clearcoat=0.0,
            sheen_color="black", transmission=0.0,
        )  # fmt: skip

    return with_materials(scene, dull)


def sky_arrays(environment: Environment) -> tuple[Float64, Float64, Float64]:
    """Return light of a sky, (H, W, 3), solid angle of a texel of each row, and directions."""
    sky, wide = environment.sky, 2 * SKY_ROWS
    image = np.asarray(sky.image, np.float64) if isinstance(sky, Panorama) else None
    height, width = (SKY_ROWS, wide) if image is None else image.shape[:2]
    edges = [transforms.sine_cosine(90.0 - 180.0 * row / height)[0] for row in range(height + 1)]
    areas = -np.diff(edges) * 2.0 * math.pi / width
    up = [transforms.sine_cosine(90.0 - 180.0 * (row + 0.5) / height) for row in range(height)]
    across = [transforms.sine_cosine(360.0 * ((n + 0.5) / width - 0.5)) for n in range(width)]
    sine, cosine = np.array(up).T[:, :, np.newaxis]
    z, x = np.array(across).T[:, np.newaxis]
    toward = np.stack([cosine * x, sine + 0.0 * x, cosine * z], axis=2)
    if image is None:
        zenith, horizon, ground = np.array([sky.zenith, sky.horizon, sky.ground])
        y = toward[:, :, 1:2]
        image = horizon + np.maximum(y, 0.0) * (zenith - horizon)
        image = image + np.maximum(-y, 0.0) * (ground - horizon)
    turn = transforms.rotate_y(environment.rotation)[:3, :3]
    return environment.intensity * image, areas, toward @ turn.T


def dome_lights(environment: Environment) -> list[Light]:
    """Return directional lights that shed the light of an environment, by median cuts [1]_."""
    image, areas, toward = sky_arrays(environment)
    power = image * areas[:, np.newaxis, np.newaxis]
    energy = power.sum(axis=2)
    parts = [(0, energy.shape[0], 0, energy.shape[1])]
    while len(parts) < MAX_DOME_LIGHTS:
        cut = [half for part in parts for half in _halve(part, energy)]
        if len(cut) == len(parts):
            break
        parts = cut
    lights: list[Light] = []
    for top, bottom, left, right in parts:
        light = power[top:bottom, left:right].sum(axis=(0, 1))
        weights = energy[top:bottom, left:right, np.newaxis]
        direction = (weights * toward[top:bottom, left:right]).sum(axis=(0, 1))
        strength = float(light.max())
        if strength > 0.0:
            # Towards what faces all of a part, its mean direction sheds as much, if it is as long.
            length = float(np.linalg.norm(direction)) / float(weights.sum())
            color = tuple((light / strength).tolist())
            lights.append(DirectionalLight(-direction, color, length * strength / math.pi))
    return lights


def _halve(part: tuple[int, int, int, int], energy: Float64) -> list[tuple[int, int, int, int]]:
    """Return the parts of a sky that hold half the light of a part each, cut across its length."""
    top, bottom, left, right = part
    _, cosine = transforms.sine_cosine(90.0 - 90.0 * (top + bottom) / energy.shape[0])
    is_tall = bottom - top > (right - left) * cosine
    if max(bottom - top, right - left) == 1:
        return [part]
    if (is_tall and bottom - top > 1) or right - left == 1:
        middle = top + _median_index(energy[top:bottom, left:right].sum(axis=1))
        return [(top, middle, left, right), (middle, bottom, left, right)]
    middle = left + _median_index(energy[top:bottom, left:right].sum(axis=0))
    return [(top, bottom, left, middle), (top, bottom, middle, right)]


def _median_index(amounts: Float64) -> int:
    """Return the number of first amounts that make half of the sum, at least one and not all."""
    half = int(np.searchsorted(np.cumsum(amounts), 0.5 * amounts.sum()))
    return min(max(half, 1), len(amounts) - 1)


def with_even_environment(scene: Scene) -> Scene:
    """Return a scene with the mean light of its environment from everywhere."""
    image, areas, _ = sky_arrays(scene.environment)
    mean = (image * areas[:, np.newaxis, np.newaxis]).sum(axis=(0, 1)) / (4.0 * math.pi)
    strength = float(mean.max()) or 1.0
    color = tuple((mean / strength).tolist())
    even = Environment.constant(color, intensity=strength, background=scene.environment.background)
    return with_field(scene, "environment", even)


def rays(painter: Studio, scene: Scene, seconds: float) -> LightReference:
    """Measure ambient occlusion at some points by cube maps around them."""
    asked = scene.ambient_occlusion
    bright = painter.light(STANDARD, with_field(scene, "ambient_occlusion", None))
    dark = _without_ambient(scene)
    darkness = painter.light(STANDARD, dark)
    outputs = ("position", "geometric_normal", "face_id")
    frame = painter.draw(STANDARD, outputs)
    reached = np.abs(bright - darkness).max(axis=2) > 0.0
    rows, columns = np.nonzero(reached & (frame.face_id >= 0))
    known = np.zeros(reached.shape, bool)
    if len(rows) == 0:
        return LightReference(bright, known, 0.0)
    count = min(POINT_ROWS * POINT_ROWS, len(rows))
    taken = np.arange(count) * len(rows) // count
    rows, columns = rows[taken], columns[taken]
    positions = frame.position[rows, columns].astype(np.float64)
    normals = frame.geometric_normal[rows, columns].astype(np.float64)
    openness = 1.0 - asked.strength * occlusion(scene, positions, normals, radius_of(asked, scene))
    known[rows, columns] = True
    truth = darkness.copy()
    lit = bright[rows, columns] - darkness[rows, columns]
    truth[rows, columns] += openness[:, np.newaxis] * lit
    return LightReference(truth, known, float(reached.mean()))


def _without_ambient(scene: Scene) -> Scene:
    """Return a scene without light from all around."""
    lights: list[Light] = [one for one in scene.lights if not isinstance(one, AmbientLight)]
    # Of a scene that is left without any light nobody may take the place.
    lights = lights or [AmbientLight(intensity=0.0)]
    dark = with_field(with_field(scene, "lights", lights), "ambient_occlusion", None)
    return dark if scene.environment is None else LIGHT.without(dark)


def occlusion(scene: Scene, positions: Float64, normals: Float64, radius: float) -> Float64:
    """
    Return the share of light from all around that surfaces within a radius block, by [2]_.

    Parameters
    ----------
    positions, normals : (N, 3) float64
        World space; normals of length one, towards the open side.
    radius : float, scene units
    """
    cameras, axes = [], []
    for position, normal in zip(positions, normals, strict=True):
        eye = position + NEAR_RADII * radius * normal
        u, v = _perpendiculars(normal)
        for toward, up in ((normal, u), (u, normal), (-u, normal), (v, normal), (-v, normal)):
            cameras.append(
                PerspectiveCamera(
                    eye, eye + radius * toward, up=up, fov_y=90.0, near=NEAR_RADII * radius,
                    far=2.0 * radius,
                )
            )  # fmt: skip
            # Right, up and ahead of the picture; which of them is the normal, and how much.
            axes.append((float(up @ normal), float(toward @ normal)))
    with warnings.catch_warnings():
        # What is near is seen from within, and what is far is cut off, on purpose.
        warnings.simplefilter("ignore", ViewWarning)
        distances = render_batch(scene, cameras, size=(SIDE, SIDE), outputs=("distance",)).distance
    at = (np.arange(SIDE) + 0.5) * (2.0 / SIDE) - 1.0
    x, y = np.meshgrid(at, -at)
    length = np.sqrt(x * x + y * y + 1.0)
    shares = np.zeros(len(cameras) // 5)
    weight = np.zeros_like(shares)
    for number, (along_up, along_toward) in enumerate(axes):
        height = np.maximum(y * along_up + along_toward, 0.0)
        # The cosine, over the square of the distance of a pixel and its slope.
        form = height / length**4
        shares[number // 5] += (form * (distances[number] <= radius)).sum()
        weight[number // 5] += form.sum()
    return shares / weight


def has_lines(scene: Scene) -> bool:
    """Tell whether a scene has lines that are no edges."""
    return any(node.mesh is not None and node.mesh.primitive == "lines" for node in scene.nodes)


def without_lines(scene: Scene) -> Scene:
    """Return a scene without its lines."""
    kept = [node for node in scene.nodes if node.mesh.primitive != "lines"]
    return with_field(scene, "nodes", kept)


def sampled_lines(painter: Studio, scene: Scene, seconds: float) -> LightReference:
    """Draw lines with many samples, and mark their pixels."""
    bare = without_lines(scene)
    fine, rough = replace(STANDARD, samples=64), replace(STANDARD, samples=16)
    seen = [painter.light(quality) != painter.light(quality, bare) for quality in (STANDARD, rough)]
    where = (seen[0] | seen[1]).any(axis=2)
    return LightReference(painter.light(fine), where, float(where.mean()))


def sampled_lens(painter: Studio, scene: Scene, seconds: float) -> LightReference:
    """Draw a lens with many samples."""
    return LightReference(painter.light(replace(STANDARD, samples=64)))


def covered_lines(painter: Studio, scene: Scene, seconds: float) -> LightReference:
    """Draw edges by the areas that they cover."""
    return LightReference(painter.light(replace(STANDARD, lines="coverage")))
