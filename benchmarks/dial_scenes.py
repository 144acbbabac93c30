"""
Thirty-two pictures of many kinds and sizes whose errors ``python -m benchmarks.dial`` bounds.

Smooth meshes, many small triangles, slivers and wires, textures of high frequency, sharp
highlights, alpha masks, shadows, glass, points and lines; from 64 x 64 to 640 x 480 pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import rasterjit as rj
from rasterjit import accuracy, transforms

MODELS = Path(__file__).parents[1] / "models"

QUAD = ((0, 1, 2), (0, 2, 3))
"""Faces of four corners, given counter-clockwise."""

UV = np.array(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)))
"""Texture coordinates of these corners."""

SEED = 5
"""Of what is random."""


@dataclass(frozen=True)
class Picture:
    """A scene to draw in a size."""

    name: str
    make: Callable[[], tuple[rj.Scene, Any]]
    """Returns the scene, and its camera; ``None``: one that fits the scene."""
    size: tuple[int, int]

    def __str__(self) -> str:
        return f"{self.name} {self.size[0]}x{self.size[1]}"

    def scene_and_camera(self) -> tuple[rj.Scene, Any]:
        """Return what to draw, and from where."""
        scene, camera = self.make()
        if camera is None:
            camera = rj.fit_camera(scene, aspect=self.size[0] / self.size[1])
        return scene, camera


def model(file: str, zoom: float = 1.0) -> Callable[[], tuple[rj.Scene, Any]]:
    """Return what loads a model and looks at it, from nearer if zoomed."""

    def make() -> tuple[rj.Scene, Any]:
        scene = rj.load(MODELS / file)
        camera = None if zoom == 1.0 else rj.fit_camera(scene, zoom=zoom)
        return scene, scene.camera or camera

    return make


def made(name: str) -> Callable[[], tuple[rj.Scene, Any]]:
    """Return what makes one of `rasterjit.accuracy`'s scenes."""

    def make() -> tuple[rj.Scene, Any]:
        one = accuracy.make(name)
        return one.scene, one.camera

    return make


def ball(rows: int, columns: int, **options: Any) -> rj.Mesh:
    """Return a ball of radius 1 whose rows run from pole to pole."""
    polar, around = np.mgrid[0 : rows + 1, 0 : columns + 1]
    polar, around = np.pi * polar / rows, 2.0 * np.pi * around / columns
    positions = np.stack(
        [np.sin(polar) * np.cos(around), np.cos(polar), -np.sin(polar) * np.sin(around)], axis=-1
    ).reshape(-1, 3)
    corner = (np.arange(rows)[:, np.newaxis] * (columns + 1) + np.arange(columns)).ravel()
    below = corner + columns + 1
    faces = np.concatenate(
        [np.stack([corner, below, below + 1], 1), np.stack([corner, below + 1, corner + 1], 1)]
    )
    uv = np.stack([around / (2.0 * np.pi), 1.0 - polar / np.pi], axis=-1).reshape(-1, 2)
    return rj.Mesh(positions, faces, uv=uv, **options)


def shiny_ball(material: rj.Material) -> Callable[[], tuple[rj.Scene, Any]]:
    """Return what makes a smooth ball in the light of two lamps."""

    def make() -> tuple[rj.Scene, Any]:
        scene = rj.Scene()
        scene.add(ball(60, 120, material=material))
        scene.lights += [
            rj.AmbientLight(intensity=0.1), rj.DirectionalLight((-0.4, -1.0, -0.6)),
            rj.PointLight((2.0, 1.0, 2.5), "orange", 4.0),
        ]  # fmt: skip
        return scene, None

    return make


def noisy_ball() -> tuple[rj.Scene, Any]:
    """Return a ball of 80,000 small faces, each of a colour of its own."""
    rows, columns = 160, 250
    even = ball(rows, columns)
    random = np.random.default_rng(SEED)
    corners = even.vertices[even.faces.ravel()] * random.uniform(
        0.97, 1.0, (len(even.faces) * 3, 1)
    )
    colors = random.uniform(0.0, 1.0, (len(even.faces), 3)).repeat(3, axis=0)
    scene = rj.Scene()
    faces = np.arange(len(corners)).reshape(-1, 3)
    scene.add(rj.Mesh(corners, faces, colors=colors, material=rj.Material("flat", "white")))
    return scene, None


def grass() -> tuple[rj.Scene, Any]:
    """Return thousands of blades that are thinner than pixels."""
    random = np.random.default_rng(SEED)
    count = 4000
    foot = random.uniform(-2.0, 2.0, (count, 3)) * (1.0, 0.0, 1.0)
    lean = random.normal(0.0, 0.15, (count, 3)) + (0.0, 0.6, 0.0)
    side = random.normal(0.0, 0.006, (count, 3)) * (1.0, 0.0, 1.0)
    corners = np.stack([foot - side, foot + side, foot + lean], axis=1).reshape(-1, 3)
    colors = random.uniform(0.1, 0.9, (count, 3)).repeat(3, axis=0) * (0.5, 1.0, 0.3)
    scene = rj.Scene()
    faces = np.arange(len(corners)).reshape(-1, 3)
    scene.add(rj.Mesh(corners, faces, colors=colors, material=rj.Material("unlit", "white")))
    return scene, None


def checkered(image: Any, tiles: float, **options: Any) -> Callable[[], tuple[rj.Scene, Any]]:
    """Return what makes a floor under a picture that repeats, up to the horizon."""

    def make() -> tuple[rj.Scene, Any]:
        corners = 30.0 * np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)])
        material = rj.Material("unlit", base_color_texture=rj.Texture(image), **options)
        scene = rj.Scene()
        scene.add(rj.Mesh(corners, QUAD, uv=tiles * UV, material=material))
        return scene, rj.PerspectiveCamera((1.0, 2.0, 4.0), (0.0, 0.0, -3.0))

    return make


def checks() -> Any:
    """Return black and white squares, (2, 2, 3)."""
    return np.array([[(0,) * 3, (255,) * 3], [(255,) * 3, (0,) * 3]], np.uint8)


def noise(channels: int) -> Any:
    """Return random texels, (128, 128, channels)."""
    return np.random.default_rng(SEED).integers(0, 256, (128, 128, channels), np.uint8)


def textured_ball() -> tuple[rj.Scene, Any]:
    """Return a ball under fine random texels."""
    scene = rj.Scene()
    texture = rj.Texture(noise(3), scale=(4.0, 2.0))
    scene.add(ball(40, 80, material=rj.Material(base_color="white", base_color_texture=texture)))
    return scene, None


def leaves() -> tuple[rj.Scene, Any]:
    """Return leaves that stand in each other's way, cut out of squares by alpha."""
    rows, columns = np.mgrid[-1:1:64j, -1:1:64j]
    image = np.zeros((64, 64, 4), np.uint8)
    image[:, :, 1], image[:, :, 0] = 160, 60
    image[:, :, 3] = 255 * (np.abs(columns) < 0.8 * (1.0 - rows**2) * np.abs(np.cos(9.0 * rows)))
    material = rj.Material("unlit", base_color_texture=rj.Texture(image), alpha_mode="mask")
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float64)
    random, scene = np.random.default_rng(SEED), rj.Scene()
    mesh = rj.Mesh(corners, QUAD, uv=UV, material=material)
    for _ in range(60):
        turn = transforms.rotate(random.normal(size=3), random.uniform(0.0, 360.0))
        place = transforms.translate(random.uniform(-3.0, 3.0, 3))
        scene.add(mesh, transforms.compose(place, turn))
    return scene, None


def pillars() -> tuple[rj.Scene, Any]:
    """Return balls over a ground, with soft-edged shadows of two lamps."""
    scene = rj.Scene()
    corners = 4.0 * np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)])
    scene.add(rj.Mesh(corners, QUAD, material=rj.Material(base_color="#c0b090", specular=0.0)))
    mesh = ball(24, 48, material=rj.Material(base_color="firebrick"))
    for number in range(7):
        scene.add(mesh, transforms.compose(
            transforms.translate((1.1 * (number - 3), 0.5, 0.8 * (-1) ** number)),
            transforms.scale((0.4, 0.5 + 0.1 * number, 0.4)),
        ))  # fmt: skip
    scene.lights += [
        rj.AmbientLight(intensity=0.1),
        rj.DirectionalLight((-0.5, -1.0, -0.3), intensity=0.7, shadow=rj.Shadow()),
        rj.DirectionalLight((0.8, -0.7, -0.4), "skyblue", 0.3, shadow=rj.Shadow(512)),
    ]
    return scene, None


def cloud() -> tuple[rj.Scene, Any]:
    """Return three thousand round points."""
    random, scene = np.random.default_rng(SEED), rj.Scene()
    places, colors = random.normal(size=(3000, 3)), random.uniform(size=(3000, 3))
    scene.add(rj.Points(places, colors=colors, size=0.06, unit="world", shape="disc"))
    return scene, None


def curves() -> tuple[rj.Scene, Any]:
    """Return thin curves around a centre."""
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    strips = [
        np.stack([np.cos(turn), np.sin(3.0 * turn + 0.2 * k), np.sin(turn) * (0.1 * k)], axis=1)
        for k in range(12)
    ]
    scene = rj.Scene()
    scene.add(rj.Lines(np.concatenate(strips), strips=np.split(np.arange(2400), 12), colors="navy"))
    return scene, None


def boxes() -> tuple[rj.Scene, Any]:
    """Return rectangles whose edges run along rows and columns of pixels, between their centres."""
    scene, random = rj.Scene(), np.random.default_rng(SEED)
    for number, (x, y) in enumerate(random.uniform(-0.8, 0.8, (12, 2))):
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * random.uniform(0.02, 0.2, 2)
        corners = np.column_stack([corners + (x, y), np.full(4, 0.01 * number)])
        color = tuple(random.uniform(0.0, 1.0, 3))
        scene.add(rj.Mesh(corners, QUAD, material=rj.Material("unlit", color)))
    return scene, rj.OrthographicCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), height=2.0)


GLOSSY = rj.Material(base_color="navy", specular=0.9, shininess=400.0)
GOLD = rj.Material("pbr", "gold", metallic=1.0, roughness=0.25)

PICTURES = (
    Picture("teapot", model("teapot.obj"), (160, 120)),
    Picture("teapot", model("teapot.obj"), (640, 480)),
    Picture("teapot", model("teapot.obj"), (64, 64)),
    Picture("teapot's spout", model("teapot.obj", 4.0), (320, 240)),
    Picture("scene", model("scene.glb"), (160, 120)),
    Picture("scene", model("scene.glb"), (480, 360)),
    Picture("face", model("face.glb"), (96, 96)),
    Picture("figure", model("figure.glb"), (240, 320)),
    Picture("torus knot", model("torus_knot.obj"), (320, 240)),
    Picture("tentacle", model("tentacle.glb"), (128, 96)),
    Picture("cube", model("cube.ply"), (64, 64)),
    Picture("glossy ball", shiny_ball(GLOSSY), (200, 200)),
    Picture("golden ball", shiny_ball(GOLD), (128, 128)),
    Picture("noisy ball", noisy_ball, (160, 120)),
    Picture("noisy ball", noisy_ball, (480, 360)),
    Picture("grass", grass, (320, 240)),
    Picture("checks", checkered(checks(), 30.0), (320, 240)),
    Picture("fine noise", checkered(noise(3), 20.0), (160, 120)),
    Picture("textured ball", textured_ball, (200, 150)),
    Picture("leaves", leaves, (240, 180)),
    Picture("holes", checkered(noise(4), 3.0, alpha_mode="mask"), (160, 120)),
    Picture("pillars", pillars, (160, 120)),
    Picture("pillars", pillars, (320, 240)),
    Picture("cloud", cloud, (160, 120)),
    Picture("curves", curves, (160, 120)),
    Picture("boxes", boxes, (100, 100)),
    Picture("wires", made("wires"), (320, 240)),
    Picture("slivers", made("slivers"), (128, 96)),
    Picture("shadows", made("shadows"), (240, 180)),
    Picture("highlights", made("highlights"), (160, 120)),
    Picture("glass", made("glass"), (160, 120)),
    Picture("wireframe", made("wireframe"), (160, 120)),
)  # fmt: skip
