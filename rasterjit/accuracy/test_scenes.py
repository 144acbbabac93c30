"""Small test scenes, each for an accuracy setting that matters much in it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene import transforms
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.light import AmbientLight, DirectionalLight, Shadow
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import Scene
from rasterjit.scene.texture import Texture
from rasterjit.scene.validation import one_of
from rasterjit.scene.wireframe import Wireframe

SIZE = (480, 360)
"""Width and height of the pictures, pixels."""

QUAD = np.array([(0, 1, 2), (0, 2, 3)])
"""Faces of four corners, given counter-clockwise."""

OPPOSITE_QUAD = np.array([(0, 1, 3), (1, 2, 3)])
"""Faces of four corners, cut along the other diagonal."""

RING_PARTS = 90
"""Number of parts of a ring."""

Points = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MadeScene:
    """
    A test scene with its camera and size.

    Attributes
    ----------
    scene : Scene
    camera : PerspectiveCamera
    size : (int, int)
        Pixels.
    """

    scene: Scene
    camera: PerspectiveCamera
    size: tuple[int, int] = SIZE


def make(name: str) -> MadeScene:
    """
    Make one of ``SCENES``.

    Raises
    ------
    ValueError
        Naming the scene that is unknown, and listing those that are possible.
    """
    return SCENES[one_of("scene", name, tuple(SCENES))]()


def make_floor() -> MadeScene:
    """Return a tiled floor of large triangles, seen at a grazing angle up to the horizon."""
    texels = np.full((64, 64, 3), 225, np.uint8)
    texels[:32, :32] = texels[32:, 32:] = (60, 80, 120)
    texels[::16] = texels[:, ::16] = (200, 60, 30)
    # No face reaches behind the eye: clipped faces would not be interpolated on the screen.
    rows, columns = 9, 6
    z, x = np.mgrid[0 : rows + 1, 0 : columns + 1] * 10.0
    vertices = np.stack([x - 30.0, 0.0 * x, -1.2 - z], axis=-1).reshape(-1, 3)
    uv = 0.5 * np.stack([x, z], axis=-1).reshape(-1, 2)
    material = Material(shading="unlit", base_color_texture=Texture(texels, rotation=20.0))
    scene = Scene()
    mesh = Mesh(vertices, _make_grid_faces(rows, columns), uv=uv, material=material)
    scene.add(mesh, name="floor")
    return MadeScene(scene, PerspectiveCamera((0.0, 1.6, 0.0), (0.0, 0.0, -9.0), fov_y=50.0))


def make_wires() -> MadeScene:
    """Return wires much thinner than a pixel, straight and round."""
    scene = Scene()
    dark = Material(shading="unlit", base_color=(0.02, 0.03, 0.08))
    for number in range(48):
        sine, cosine = transforms.sine_cosine(7.5 * number + 1.3)
        ray = np.array([cosine, sine, 0.0])
        scene.add(Mesh(*_make_strip(0.25 * ray, 1.4 * ray, 0.0022), material=dark), name="spoke")
    red = Material(shading="unlit", base_color=(0.5, 0.03, 0.02))
    for radius in (0.25, 0.55, 0.85, 1.15):
        scene.add(Mesh(*_make_ring(radius, 0.002), material=red), name="ring")
    return MadeScene(scene, PerspectiveCamera((0.013, 0.007, 3.0), (0.013, 0.007, 0.0)))


def make_slivers() -> MadeScene:
    """Return slivers a few pixels wide with a smooth pattern, which shows how they are snapped."""
    rows, columns = 4, 240
    y, x = np.mgrid[0 : rows + 1, 0 : columns + 1].astype(np.float64)
    vertices = np.stack([x / columns - 0.5, y / rows - 0.5, 0.0 * x], axis=-1).reshape(-1, 3)
    red = _wave(vertices[:, 0] * 9.0 + vertices[:, 1])
    green = _wave(vertices[:, 0] * 7.0 - 2.0 * vertices[:, 1])
    colors = np.stack([red, green, 0.5 * (red + green)], axis=1)
    material = Material(shading="unlit", base_color="white")
    scene = Scene()
    mesh = Mesh(vertices, _make_grid_faces(rows, columns), colors=colors, material=material)
    scene.add(
        mesh,
        transforms.compose(transforms.rotate_z(7.0), transforms.scale((4.0, 3.3, 1.0))),
        name="slivers",
    )
    return MadeScene(scene, PerspectiveCamera((0.0, 0.0, 2.5), (0.0, 0.0, 0.0)))


def make_near_and_far() -> MadeScene:
    """Return orange plates from 0.3 to 300 m away, each 1 mm in front of a blue one."""
    scene = Scene()
    front = Material(shading="unlit", base_color=(0.85, 0.35, 0.05))
    behind = Material(shading="unlit", base_color=(0.05, 0.15, 0.6))
    corners = 0.11 * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    tilted = transforms.apply(transforms.rotate((1.0, 0.7, 0.0), 35.0), corners)
    for number, distance in enumerate((0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)):
        column, row = number % 4, number // 4
        position = np.array([0.26 * (column - 1.5) + 0.13 * row, 0.2 - 0.4 * row, -1.0])
        # From the eye, at the origin, one plate covers the other exactly; the blue one comes first,
        # so that it is visible where their depths are rounded to the same.
        for depth, material in ((distance + 0.001, behind), (distance, front)):
            plate = Mesh((tilted + position) * depth, QUAD, material=material)
            scene.add(plate, name=f"plate at {depth:g} m")
    camera = PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), near=0.1, far=1000.0)
    return MadeScene(scene, camera)


def make_far_from_origin() -> MadeScene:
    """Return a bumpy ground a thousand kilometres from the origin of its coordinates, in metres."""
    origin = np.array([1.0e6 + 0.3, 3.7, -2.0e6 + 0.1])
    squares = 48
    vertices, faces = _make_bumps(squares, 6.0, 0.35)
    row, column = np.divmod(np.arange(squares * squares), squares)
    is_light = np.tile((row // 4 + column // 4) % 2 == 1, 2)[:, np.newaxis]
    colors = np.where(is_light, (0.7, 0.7, 0.5), (0.2, 0.3, 0.15))
    scene = Scene()
    material = Material(base_color="white", specular=0.2, shininess=30.0)
    mesh = Mesh(vertices + origin, faces, colors=colors, material=material)
    scene.add(mesh, name="ground")
    scene.lights += [AmbientLight(intensity=0.15), DirectionalLight((-1.0, -0.8, -0.4))]
    return MadeScene(scene, PerspectiveCamera(origin + (0.3, 2.2, 4.0), origin))


def make_coplanar() -> MadeScene:
    """Return sheets a hundredth of a millimetre apart, each rotated differently, 10 m away."""
    scene = Scene()
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float64)
    tilt = transforms.rotate((1.0, 0.3, 0.0), 50.0)
    for number in range(8):
        hue = _wave(number / 8.0 + np.array([0.0, 0.33, 0.66]))
        material = Material(shading="unlit", base_color=tuple(hue.tolist()))
        spin = transforms.rotate_z(11.0 * number)
        sheet = transforms.apply(spin, corners * (3.4 - 0.35 * number)) + (0.0, 0.0, 1e-5 * number)
        faces = QUAD if number % 2 else OPPOSITE_QUAD
        scene.add(Mesh(transforms.apply(tilt, sheet), faces, material=material), name="sheet")
    eye, target = (0.0, 0.0, 10.0), (0.0, 0.0, 0.0)
    camera = PerspectiveCamera(eye, target, fov_y=30.0, near=0.1, far=100.0)
    return MadeScene(scene, camera)


def make_highlights() -> MadeScene:
    """Return a coarse mesh with smooth normals and sharp highlights, which fills the picture."""
    vertices, faces = _make_bumps(10, 6.0, 0.5)
    scene = Scene()
    material = Material(base_color=(0.08, 0.14, 0.3), specular=0.9, shininess=200.0)
    scene.add(Mesh(vertices, faces, material=material), name="coarse")
    scene.lights += [
        AmbientLight(intensity=0.2),
        DirectionalLight((-0.3, -1.0, -0.25), intensity=0.8),
        DirectionalLight((0.5, -0.8, -0.4), color=(1.0, 0.6, 0.3), intensity=0.5),
    ]
    return MadeScene(scene, PerspectiveCamera((0.2, 3.1, 1.6), (0.0, 0.0, 0.0)))


def make_shadows() -> MadeScene:
    """Return a fence that casts a shadow on a ground so wide that shadow maps are coarse."""
    scene = Scene()
    ground = Material(base_color=(0.7, 0.68, 0.6), specular=0.0)
    corners = [(-60.0, 0.0, 6.0), (60.0, 0.0, 6.0), (60.0, 0.0, -60.0), (-60.0, 0.0, -60.0)]
    scene.add(Mesh(corners, QUAD, material=ground), name="ground")
    wood = Material(base_color=(0.35, 0.18, 0.08), specular=0.0)
    for number in range(14):
        x = 1.1 * (number - 6.5)
        post = Mesh(*_make_box((x, 0.9, -3.0), (0.09, 0.9, 0.05)), material=wood)
        scene.add(post.split_creases(), name="post")
    for height in (0.6, 1.4):
        rail = Mesh(*_make_box((0.0, height, -3.0), (7.6, 0.06, 0.05)), material=wood)
        scene.add(rail.split_creases(), name="rail")
    light = DirectionalLight((0.55, -0.8, 0.75), intensity=0.9, shadow=Shadow())
    scene.lights += [AmbientLight(intensity=0.12), light]
    return MadeScene(scene, PerspectiveCamera((1.0, 2.0, 1.5), (0.0, 0.3, -2.0)))


def make_glass() -> MadeScene:
    """Return panes of coloured glass, up to sixteen behind each other."""
    scene = Scene()
    wall = Material(shading="unlit", base_color=(0.9, 0.9, 0.85))
    scene.add(Mesh(_make_plate((0.0, 0.0, -9.0), 9.0, 7.0), QUAD, material=wall), name="wall")
    for number in range(16):
        hue = 0.9 * _wave(number / 5.0 + np.array([0.0, 0.33, 0.66]))
        material = Material(shading="unlit", base_color=(*hue.tolist(), 0.5), alpha_mode="blend")
        sine, cosine = transforms.sine_cosine(137.5 * number)
        corners = _make_plate((0.6 * cosine, 0.45 * sine, -0.2 * number), 1.0, 0.75)
        scene.add(Mesh(corners, QUAD, material=material), name="pane")
    return MadeScene(scene, PerspectiveCamera((0.0, 0.0, 3.2), (0.0, 0.0, 0.0)))


def make_wireframe() -> MadeScene:
    """Return a bumpy ground with its edges drawn."""
    vertices, faces = _make_bumps(16, 6.0, 0.4)
    scene = Scene()
    material = Material(base_color=(0.75, 0.75, 0.7), specular=0.0)
    scene.add(Mesh(vertices, faces, material=material), name="ground")
    scene.wireframe = Wireframe("black")
    return MadeScene(scene, PerspectiveCamera((0.6, 3.4, 4.0), (0.0, 0.0, 0.0)))


def make_gradients() -> MadeScene:
    """Return an unlit bumpy ground with vertex colours that run from dark to light."""
    vertices, faces = _make_bumps(12, 6.0, 0.5)
    waves = _wave(vertices[:, [0]] * 0.31 + vertices[:, [2]] * 0.17 + np.array([0.0, 0.3, 0.6]))
    scene = Scene()
    material = Material(shading="unlit", base_color="white")
    scene.add(Mesh(vertices, faces, colors=waves * waves * waves, material=material), name="ground")
    return MadeScene(scene, PerspectiveCamera((0.2, 2.1, 3.6), (0.0, 0.0, 0.0)))


def make_poster() -> MadeScene:
    """Return an unlit picture of strong colours, whose texels are larger than pixels."""
    rows, columns = np.mgrid[0:24, 0:32]
    texels = np.full((24, 32, 3), (250, 240, 40), np.uint8)
    texels[(rows // 3 + columns // 3) % 2 == 0] = (20, 60, 200)
    texels[(rows - 12) ** 2 + (columns - 16) ** 2 < 50] = (210, 20, 30)
    vertices = np.array([[-2.0, -1.5, 0.0], [2.0, -1.5, 0.0], [2.0, 1.5, -1.0], [-2.0, 1.5, -1.0]])
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    texture = Texture(texels, filter="bilinear")
    material = Material(shading="unlit", base_color_texture=texture)
    scene = Scene()
    scene.add(Mesh(vertices, [[0, 1, 2], [0, 2, 3]], uv=uv, material=material), name="poster")
    return MadeScene(scene, PerspectiveCamera((0.3, 0.2, 2.6), (0.0, 0.0, -0.5)))


SCENES: dict[str, Callable[[], MadeScene]] = {
    function.__name__.removeprefix("make_").replace("_", "-"): function
    for function in (
        make_floor, make_wires, make_slivers, make_near_and_far, make_far_from_origin,
        make_coplanar, make_highlights, make_shadows, make_glass, make_wireframe, make_gradients,
        make_poster,
    )
}  # fmt: skip
"""Functions that make the scenes, by their names on the command line."""

MADE_FOR = {
    "subpixel_bits": "slivers",
    "samples": "wires",
    "interpolation": "floor",
    "depth_format": "near-and-far",
    "precision": "far-from-origin",
    "shading": "highlights",
    "renormalize": "highlights",
    "texture_filter": "floor",
    "shadow_size": "shadows",
    "shadow_taps": "shadows",
    "transparency_layers": "glass",
    "blending": "glass",
    "texture_mixing": "poster",
    "lines": "wireframe",
    "interpolation_precision": "gradients",
}
"""The scene that each setting matters most to."""


def _wave(x: Points) -> Points:
    """Return a smooth wave from 0 to 1 with period 1, of two parabolas."""
    phase = x - np.floor(x)
    half_phase = np.where(phase < 0.5, phase, phase - 0.5)
    parabola = 16.0 * half_phase * (0.5 - half_phase)
    return 0.5 + 0.5 * np.where(phase < 0.5, parabola, -parabola)


def _make_grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Return the faces of a grid of squares, whose vertices run row by row."""
    first = (np.arange(rows)[:, np.newaxis] * (columns + 1) + np.arange(columns)).ravel()
    above = first + columns + 1
    lower = np.stack([first, first + 1, above + 1], axis=1)
    return np.concatenate([lower, np.stack([first, above + 1, above], axis=1)])


def _make_bumps(squares: int, side: float, height: float) -> tuple[Points, NDArray[np.int64]]:
    """Return vertices and faces of a wavy ground with ``squares`` per side, y up."""
    z, x = np.mgrid[0 : squares + 1, 0 : squares + 1] / squares - 0.5
    y = height * (_wave(1.9 * x + 0.2) + _wave(1.6 * z - 0.35 * x) - 1.0)
    # Rows run away from the viewer, so that the faces' fronts are above.
    vertices = np.stack([side * x, y, -side * z], axis=-1).reshape(-1, 3)
    return vertices, _make_grid_faces(squares, squares)


def _make_plate(center: tuple[float, float, float], half_x: float, half_y: float) -> Points:
    """Return the corners of a rectangle that faces +z."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float64)
    return corners * (half_x, half_y, 0.0) + center


def _make_box(
    center: tuple[float, float, float], half_sizes: tuple[float, float, float]
) -> tuple[Points, NDArray[np.int64]]:
    """Return the corners and faces of a box."""
    corner = np.arange(8)
    signs = np.stack([corner & 1, corner >> 1 & 1, corner >> 2], axis=1) * 2.0 - 1.0
    sides = [(0, 4, 6, 2), (5, 1, 3, 7), (0, 1, 5, 4), (6, 7, 3, 2), (1, 0, 2, 3), (4, 5, 7, 6)]
    faces = np.array([np.take(side, triangle) for side in sides for triangle in QUAD])
    return signs * half_sizes + center, faces


def _make_strip(start: Points, end: Points, half_width: float) -> tuple[Points, NDArray[np.int64]]:
    """Return corners and faces of a flat strip between two points of equal z."""
    x, y, _ = end - start
    side = np.array([-y, x, 0.0]) * (half_width / math.sqrt(x * x + y * y))
    return np.array([start - side, end - side, end + side, start + side]), QUAD


def _make_ring(radius: float, half_width: float) -> tuple[Points, NDArray[np.int64]]:
    """Return vertices and faces of a flat ring around the z axis."""
    angles = [360.0 * n / RING_PARTS for n in range(RING_PARTS + 1)]
    circle = np.array([(*transforms.sine_cosine(angle)[::-1], 0.0) for angle in angles])
    vertices = np.concatenate([circle * (radius + half_width), circle * (radius - half_width)])
    return vertices, _make_grid_faces(1, RING_PARTS)
