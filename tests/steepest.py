"""
Walk through scenes to where float32 and float64 differ most: towards jumps and steep places.

Chance does not find a jump: it is as wide as a rounding. A walk does. Between two scenes of the
same faces that differ in normals, lights and material it halves the way, keeps the half on which
the code of some pixel moves more, and compares both precisions on what is left. From the worst
scene that was met so far it sets out anew, in another direction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from float32_faces import codes

import rasterjit as rj

SIZE = 20, 16
HALVINGS, FIRST_COMPARED = 30, 13
"""Steps of a walk, and the first after which precisions are compared: 1e-9 and 1e-4 of a way."""

LAMPS = "sun", "point", "spot", "range"
KINDS = (
    *(("phong", lamp) for lamp in LAMPS), *(("pbr", lamp) for lamp in LAMPS), ("pbr", "two"),
    ("phong", "two"),
)  # fmt: skip


class Found(NamedTuple):
    """The worst of a search."""

    codes: float
    """By which a channel differs, 8-bit codes in fractions."""
    kind: tuple[str, str]
    knobs: np.ndarray
    """What `Place.scene` makes the scene from."""


class Place:
    """Faces seen by a camera; what lights them is left open."""

    def __init__(self, kind: tuple[str, str], random: np.random.Generator) -> None:
        self.kind = kind
        self._squares = int(random.choice([1, 1, 2, 14]))
        side = self._squares + 1
        x, y = (v.ravel() for v in np.meshgrid(*[np.linspace(-1.0, 1.0, side)] * 2))
        lift = 10.0 ** random.uniform(-3.0, 0.3)
        points = np.stack([x, y, random.normal(0.0, lift, len(x))], axis=-1)
        points[:, :2] += random.normal(0.0, 0.15 / self._squares, (len(x), 2))
        a = (np.arange(self._squares)[:, None] * side + np.arange(self._squares)).ravel()
        self._faces = np.concatenate(
            [np.stack([a, a + 1, a + side], 1), np.stack([a + side, a + 1, a + side + 1], 1)]
        )
        turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        self._scale = 10.0 ** random.uniform(-3.0, 3.0)
        self._points = self._scale * points @ turn.T
        self._facing = turn[:, 2]
        near = 10.0 ** random.uniform(-0.7, 0.7)
        way = random.normal(size=3)
        eye = near * self._scale * 2.0 * way / np.linalg.norm(way)
        look = random.normal(0.0, 0.2, 3) * self._scale
        self.camera = rj.PerspectiveCamera(
            eye, look, fov_y=random.uniform(10.0, 80.0), near=1e-3 * self._scale,
            far=100.0 * self._scale,
        )  # fmt: skip
        if random.random() < 0.15:
            self.camera = rj.OrthographicCamera(
                eye, look, height=2.0 * self._scale, near=1e-3 * self._scale,
                far=100.0 * self._scale,
            )  # fmt: skip
        self.count = 3 * len(points) + 24

    def start(self, random: np.random.Generator) -> np.ndarray:
        """Return knobs at random, (count,)."""
        knobs = random.normal(size=self.count)
        spread = 10.0 ** random.uniform(-3.0, 0.3)
        toward = self._facing * random.choice([-1.0, 1.0])
        knobs[24:] = (
            toward + spread * knobs[24:].reshape(-1, 3) + random.normal(0.0, 0.3, 3)
        ).ravel()
        return knobs

    def scene(self, knobs: np.ndarray) -> rj.Scene:
        """Return a scene of knobs, (count,)."""
        shading, lamp = self.kind
        k = np.tanh(0.6 * knobs[:8])
        color = 0.5 + 0.5 * k[:3]
        if shading == "pbr":
            material = rj.Material(
                "pbr", color, roughness=0.55 + 0.44 * k[3], metallic=0.5 + 0.5 * k[4]
            )
        else:
            material = rj.Material(
                "phong", color, specular=1.0 + k[3], shininess=10.0 ** (1.4 + 1.6 * k[4])
            )
        scene = rj.Scene()
        mesh = rj.Mesh(
            self._points, self._faces, normals=knobs[24:].reshape(-1, 3), material=material
        )
        scene.add(mesh)
        scene.lights = [self._light(lamp if lamp != "two" else "sun", knobs[8:16], 10.0 ** k[5])]
        if lamp == "two":
            scene.lights.append(self._light("point", knobs[16:24], 10.0 ** k[6]))
        if k[7] > 0.5:
            scene.lights.append(rj.AmbientLight(intensity=10.0 * (k[7] - 0.5)))
        return scene

    def _light(self, kind: str, knobs: np.ndarray, power: float) -> rj.Light:
        """Return a light of a kind: eight knobs."""
        if kind == "sun":
            return rj.DirectionalLight(knobs[:3], intensity=power)
        place = 1.5 * self._scale * knobs[:3]
        power *= self._scale**2 * float(knobs[:3] @ knobs[:3])
        if kind == "spot":
            outer = 45.0 + 40.0 * np.tanh(knobs[6])
            return rj.SpotLight(
                place, -place + self._scale * knobs[3:6], intensity=power, outer_angle=outer,
                inner_angle=outer * (0.5 + 0.5 * np.tanh(knobs[7])),
            )  # fmt: skip
        reach = 2.0 * self._scale * np.exp(0.5 * knobs[7]) if kind == "range" else None
        return rj.PointLight(place, intensity=power, range=reach)


def difference(place: Place, knobs: np.ndarray, renderers: list[rj.Renderer]) -> float:
    """Return by how many codes a channel differs at most between precisions."""
    scene = place.scene(knobs)
    one, other = (
        codes(renderer.render(scene, place.camera, outputs=("linear",)).linear)
        for renderer in renderers
    )
    return float(np.abs(one - other).max())


def walk(
    place: Place, first: np.ndarray, last: np.ndarray, renderers: list[rj.Renderer]
) -> tuple[float, np.ndarray]:
    """Return the largest difference met on the way between two scenes, and the knobs there."""

    def look(at: float) -> np.ndarray:
        scene = place.scene(first + at * (last - first))
        return codes(renderers[1].render(scene, place.camera, outputs=("linear",)).linear)

    low, high = 0.0, 1.0
    below, above = look(low), look(high)
    most, worst = 0.0, first
    for step in range(HALVINGS):
        middle = 0.5 * (low + high)
        between = look(middle)
        parts = [np.abs(between - below).max(), np.abs(above - between).max()]
        if max(parts) == 0.0:
            break
        if parts[0] > parts[1]:
            high, above = middle, between
        else:
            low, below = middle, between
        if step >= FIRST_COMPARED:
            knobs = first + middle * (last - first)
            apart = difference(place, knobs, renderers)
            if apart > most:
                most, worst = apart, knobs
    return most, worst


def search(seed: int, walks: int, climbs: int = 6, kinds=KINDS) -> list[Found]:
    """Return the worst of each start, of so many walks, of which so many go on from the worst."""
    random = np.random.default_rng(seed)
    qualities = [rj.Quality(interpolation_precision=p) for p in ("adaptive", "float64")]
    found = []
    renderers = [rj.Renderer(SIZE, quality=quality, threads=1) for quality in qualities]
    for start in range(-(-walks // climbs)):
        place = Place(kinds[start % len(kinds)], random)
        best, knobs = 0.0, place.start(random)
        for _ in range(climbs):
            step = random.normal(size=place.count) * (random.random(place.count) < 0.5)
            step[24:] *= 10.0 ** random.uniform(-2.0, 0.0)
            most, worst = walk(place, knobs, knobs + step, renderers)
            if most > best:
                best, knobs = most, worst
            elif best == 0.0:
                knobs = knobs + step
        found.append(Found(best, place.kind, knobs))
    for renderer in renderers:
        renderer.close()
    return found
