"""
The scenes, named by what they stress; every one is the same numbers on every machine.

Positions are float32, faces int32, as OpenGL takes them. Clip space is OpenGL's; screen rows run
down. ``SCENES`` lists them by name; a ``..._sample`` is a part small enough for plain Python.
``FAMILIES`` lists scenes of any size; ``find_scene("triangles:1000")`` makes one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import meshes
from benchmarks.meshes import SEED, look_at, perspective, torus

SIZE = (1920, 1080)
"""Width and height of the larger pictures, pixels."""
SMALLER_SIZE = (1280, 720)
SMALL_IMAGE = (128, 128)
SAMPLE_SIZE = (192, 108)

RINGS, SIDES = 1000, 500
"""Of the torus: twice their product is a million faces."""
MILLIONS_RINGS, MILLIONS_SIDES = 2500, 1000
"""Five million faces."""
MESH_RINGS, MESH_SIDES = 264, 133
"""Seventy thousand faces."""
SMALL_RINGS, SMALL_SIDES = 100, 25
"""Five thousand faces."""
PART = 5
"""One in so many views of a batch is in a part of it."""
INSTANCE_RINGS, INSTANCE_SIDES = 10, 5
"""A hundred faces."""
COARSE_RINGS, COARSE_SIDES = 20, 10
"""Four hundred faces."""
STRETCH = np.float32([1.6, 1.0, 1.0])
"""What the torus is scaled by, to fill a wide picture."""

QUADS = 20
FEWER_QUADS = 4
SHORT_LINES, SHORT_LENGTH = 1_000_000, 50
LONG_LINES, LONG_LENGTH = 20_000, 800
"""Lines, and pixels from end to end."""
SLIVERS, SLIVER_LENGTH = 200_000, 400.0
VIEWS, FEWER_VIEWS = 1000, 100
INSTANCES_A_SIDE = 100
SAMPLE_FACES, SAMPLE_LINES = 10_000, 2000

TEAPOT = Path(__file__).parent.parent / "models" / "teapot.obj"


@dataclass(frozen=True)
class TriangleScene:
    """Indexed triangles and the matrix that takes them to clip space; the nearer sample wins."""

    positions: NDArray[np.float32]
    """(V, 3), model space."""
    faces: NDArray[np.int32]
    """(F, 3), vertex numbers."""
    clip_from_model: NDArray[np.float64]
    """(4, 4); of the world, where there are ``instances``."""
    size: tuple[int, int]
    """Width and height, pixels."""
    work: int
    """How many units the scene holds: faces, depth-tested samples, or pictures."""
    unit: str
    colors: NDArray[np.uint8] | None = None
    """(V, 4), linear light; ``None``: the picture is the number of the face at every pixel."""
    normals: NDArray[np.float32] | None = None
    """(V, 3), unit; present: lit per pixel, by the fields from ``to_light`` on."""
    uv: NDArray[np.float32] | None = None
    """(V, 2), v up."""
    texture: NDArray[np.uint8] | None = None
    """(H, W, 3), sRGB, top row first, H and W powers of two; bilinear, repeated, no mip levels."""
    in_codes: bool = False
    """Whether RasterJIT mixes the texture in 8-bit codes."""
    values: NDArray[np.float32] | None = None
    """(V,), in 0..1: the texture is one row of colours, and that of the value is shown as it is."""
    instances: NDArray[np.float64] | None = None
    """(N, 4, 4), world from model: the mesh is drawn once with each."""
    views: NDArray[np.float64] | None = None
    """(K, 4, 4), clip from model: as many pictures, one after the other, all of them read."""
    cull: str = "none"
    """``"none"`` or ``"back"``: whether faces that are clockwise on the screen are left out."""
    mode: str = "fill"
    """``"fill"``, or ``"edges"``: every edge as a line of one colour, hidden or not."""
    to_light: NDArray[np.float64] | None = None
    """(3,), unit, world space: toward the one directional light, white, of intensity 1."""
    eye: NDArray[np.float64] | None = None
    """(3,), world space."""
    ambient: float = 0.1
    """White light from everywhere."""
    specular: float = 0.25
    shininess: float = 50.0
    """Strength and exponent of the white Blinn-Phong highlight."""

    def clip_positions(self) -> NDArray[np.float64]:
        """Return the vertices in clip space, (V, 4)."""
        points = np.column_stack([self.positions, np.ones(len(self.positions))])
        return points @ self.clip_from_model.T


@dataclass(frozen=True)
class LineScene:
    """Lines between pixels, drawn in order, each with a colour ramp."""

    ends: NDArray[np.int64]
    """(N, 4): x and y of the start, x and y of the end, pixels."""
    colors: NDArray[np.uint8]
    """(N, 2, 4): RGBA of the start and of the end."""
    size: tuple[int, int]
    work: int
    unit: str = "line"


Scene = TriangleScene | LineScene


def wide_camera(fov_y: float = 42.0) -> NDArray[np.float64]:
    """Return the camera, clip from model, (4, 4), that sees the whole stretched torus."""
    return perspective(fov_y, SIZE[0] / SIZE[1], 0.5, 20.0) @ look_at((0.4, -1.6, 3.3))


def visibility_1m() -> TriangleScene:
    """Return a torus of a million faces on 60 % of the screen, no colours, no culling."""
    positions, faces = torus(RINGS, SIDES)
    return TriangleScene(positions * STRETCH, faces, wide_camera(), SIZE, len(faces), "triangle")


def visibility_sample() -> TriangleScene:
    """Return ten thousand of the million faces, spread evenly over the torus."""
    whole = visibility_1m()
    faces = np.ascontiguousarray(whole.faces[:: len(whole.faces) // SAMPLE_FACES])
    return replace(whole, faces=faces, work=len(faces))


def filled(size: tuple[int, int] = SIZE) -> TriangleScene:
    """Return four hundred large faces, no colours; the work is the pixels of the picture."""
    positions, faces = torus(COARSE_RINGS, COARSE_SIDES)
    return TriangleScene(
        positions * STRETCH, faces, wide_camera(), size, size[0] * size[1], "pixel"
    )


def colored_torus(
    rings: int, sides: int, size: tuple[int, int] = SIZE, fov_y: float = 42.0
) -> TriangleScene:
    """Return the stretched torus with its normals as vertex colours."""
    positions, faces = torus(rings, sides)
    colors = meshes.direction_colors(meshes.torus_normals(rings, sides, STRETCH))
    return TriangleScene(
        positions * STRETCH, faces, wide_camera(fov_y), size, len(faces), "triangle", colors
    )


def mesh_70k() -> TriangleScene:
    """Return seventy thousand faces on 54 % of 1280x720."""
    return colored_torus(MESH_RINGS, MESH_SIDES, SMALLER_SIZE, 44.5)


def scalars_1m() -> TriangleScene:
    """Return a million faces with a value at each vertex, shown by 256 colours."""
    scene = colored_torus(RINGS, SIDES)
    x, y, z = scene.positions.T.astype(np.float64)
    values = 0.5 + 0.5 * np.sin(5.0 * x) * np.cos(3.0 * y + z)
    ramp = np.arange(256, dtype=np.uint8)
    row = np.stack([ramp, 255 - ramp, np.abs(128 - ramp.astype(np.int32)).astype(np.uint8)], axis=1)
    return replace(scene, colors=None, values=values.astype(np.float32), texture=row[np.newaxis])


def mesh_70k_phong() -> TriangleScene:
    """Return the same, lit per pixel."""
    return replace(
        mesh_70k(),
        normals=meshes.torus_normals(MESH_RINGS, MESH_SIDES, STRETCH),
        to_light=np.array([0.48, 0.6, 0.64]),
        eye=np.array([0.4, -1.6, 3.3]),
    )


def mesh_70k_texture() -> TriangleScene:
    """Return the same under an opaque texture, not lit."""
    scene = mesh_70k()
    texels = np.random.default_rng(SEED).integers(0, 256, (256, 256, 3), np.uint8)
    return replace(scene, colors=None, uv=2.0 * scene.positions[:, :2], texture=texels)


def wireframe() -> TriangleScene:
    """Return the edges of the seventy thousand faces."""
    return replace(mesh_70k(), colors=None, mode="edges")


def full_screen_quads(
    order: str, size: tuple[int, int] = SIZE, quads: int = QUADS
) -> TriangleScene:
    """Return depth-tested quads over the whole screen, ``back_to_front`` or ``front_to_back``."""
    depths = np.linspace(0.9, -0.9, quads)
    if order == "front_to_back":
        depths = depths[::-1]
    positions, faces = meshes.quads(depths)
    return TriangleScene(positions, faces, np.eye(4), size, quads * size[0] * size[1], "sample")


def smooth_quads(order: str, size: tuple[int, int] = SIZE, quads: int = QUADS) -> TriangleScene:
    """Return the same with a colour at every corner."""
    scene = full_screen_quads(order, size, quads)
    colors = meshes.random_colors(np.random.default_rng(SEED), len(scene.positions))
    return replace(scene, colors=colors)


def slivers(count: int = SLIVERS) -> TriangleScene:
    """Return long triangles less than a pixel wide, in any direction, at any depth."""
    positions, faces = meshes.slivers(count, SLIVER_LENGTH, SIZE)
    colors = meshes.random_colors(np.random.default_rng(SEED), len(positions))
    return TriangleScene(positions, faces, np.eye(4), SIZE, count, "triangle", colors)


def small_images(
    count: int = VIEWS, side: int = SMALL_IMAGE[0], around: int = VIEWS
) -> TriangleScene:
    """Return five thousand faces seen from ``count`` of some sides, each in a square picture."""
    positions, faces = torus(SMALL_RINGS, SMALL_SIDES)
    colors = meshes.direction_colors(meshes.torus_normals(SMALL_RINGS, SMALL_SIDES))
    camera = perspective(50.0, 1.0, 0.5, 20.0)
    turns = 2.0 * np.pi * np.arange(around) / around
    heights = np.sin(7.0 * turns)
    views = [
        camera @ look_at((3.2 * np.cos(turn), height, 3.2 * np.sin(turn)))
        for turn, height in zip(turns[:count], heights, strict=False)
    ]
    return TriangleScene(
        positions, faces, views[-1], (side, side), count, "image", colors, views=np.array(views)
    )


def batch_of(side: int, count: int) -> TriangleScene:
    """Return five thousand faces seen from so many sides, in square pictures of ``side`` pixels."""
    return small_images(count, side, count)


def part_of_batch(side: int, count: int) -> TriangleScene:
    """Return every fifth view of `batch_of`, so that the last is the same."""
    whole = batch_of(side, count)
    views = whole.views[PART - 1 :: PART] if count >= PART else whole.views[-1:]
    return replace(whole, views=np.ascontiguousarray(views), work=len(views))


def instances() -> TriangleScene:
    """Return ten thousand small tori of a hundred faces, each turned its own way, on a square."""
    positions, faces = torus(INSTANCE_RINGS, INSTANCE_SIDES)
    colors = meshes.direction_colors(meshes.torus_normals(INSTANCE_RINGS, INSTANCE_SIDES))
    side = INSTANCES_A_SIDE
    places = np.zeros((side * side, 4, 4))
    spread = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    x, y = np.meshgrid(1.7 * spread, spread)
    rotations = meshes.random_rotations(np.random.default_rng(SEED), side * side)
    places[:, :3, :3] = 0.009 * rotations
    places[:, 0, 3], places[:, 1, 3], places[:, 3, 3] = x.ravel(), y.ravel(), 1.0
    camera = perspective(38.0, 16 / 9, 0.5, 20.0) @ look_at((0.2, -0.6, 2.8))
    return TriangleScene(
        positions, faces, camera, SMALLER_SIZE, len(places) * len(faces), "triangle", colors,
        instances=places,
    )  # fmt: skip


def culled() -> TriangleScene:
    """Return a million faces of which nearly all lie outside the picture or face away."""
    scene = colored_torus(RINGS, SIDES)
    camera = perspective(15.0, SIZE[0] / SIZE[1], 0.05, 20.0)
    camera = camera @ look_at((0.0, -2.4, 2.4), (1.1, -1.0, 0.2))
    return replace(scene, clip_from_model=camera, cull="back")


def random_lines(count: int, length: int, whole: int) -> LineScene:
    """Return the first ``count`` of ``whole`` random lines of so many pixels, all inside."""
    random = np.random.default_rng(SEED)
    angles = random.uniform(0.0, 2.0 * np.pi, whole)
    steps = np.rint(length * np.column_stack([np.cos(angles), np.sin(angles)])).astype(np.int64)
    lowest = np.maximum(-steps, 0)
    starts = random.integers(lowest, np.array(SIZE) - np.maximum(steps, 0))
    colors = meshes.random_colors(random, 2 * whole).reshape(-1, 2, 4)
    ends = np.column_stack([starts, starts + steps])[:count]
    return LineScene(ends, np.ascontiguousarray(colors[:count]), SIZE, count)


def short_lines(count: int = SHORT_LINES) -> LineScene:
    """Return random fifty-pixel lines, all inside the picture."""
    return random_lines(count, SHORT_LENGTH, SHORT_LINES)


def long_lines(count: int = LONG_LINES) -> LineScene:
    """Return random lines of 800 pixels, all inside the picture."""
    return random_lines(count, LONG_LENGTH, LONG_LINES)


def teapot() -> TriangleScene:
    """Return the teapot at 640 by 480."""
    vertices, faces = [], []
    for line in TEAPOT.read_text().splitlines():
        kind, *values = line.split() or [""]
        if kind == "v":
            vertices.append([float(value) for value in values[:3]])
        elif kind == "f":
            faces.append([int(value.split("/")[0]) - 1 for value in values])
    positions, size = np.array(vertices, np.float32), (640, 480)
    positions -= (positions.min(axis=0) + positions.max(axis=0)) / 2
    camera = perspective(40.0, size[0] / size[1], 0.5, 50.0) @ look_at((3.0, 4.0, 8.0))
    return TriangleScene(positions, np.array(faces, np.int32), camera, size, len(faces), "triangle")


SCENES: dict[str, Callable[[], Scene]] = {
    "fill_back_to_front": partial(smooth_quads, "back_to_front"),
    "fill_front_to_back": partial(smooth_quads, "front_to_back"),
    "mesh_70k": mesh_70k,
    "mesh_70k_phong": mesh_70k_phong,
    "mesh_70k_texture": mesh_70k_texture,
    "mesh_1m": partial(colored_torus, RINGS, SIDES),
    "scalars_1m": scalars_1m,
    "mesh_5m": partial(colored_torus, MILLIONS_RINGS, MILLIONS_SIDES),
    "slivers": slivers,
    "short_lines": short_lines,
    "long_lines": long_lines,
    "small_images": small_images,
    "small_images_quick": partial(small_images, FEWER_VIEWS),
    "wireframe": wireframe,
    "instances_10k": instances,
    "culled": culled,
    "visibility_1m": visibility_1m,
    "visibility_sample": visibility_sample,
    "visibility_fill_back_to_front": partial(full_screen_quads, "back_to_front"),
    "visibility_fill_front_to_back": partial(full_screen_quads, "front_to_back"),
    "fill_sample": partial(full_screen_quads, "back_to_front", SAMPLE_SIZE, 3),
    "filled": filled,
    "filled_sample": partial(filled, SAMPLE_SIZE),
    "short_lines_sample": partial(short_lines, SAMPLE_LINES),
    "teapot": teapot,
}


def triangles_of(count: int) -> TriangleScene:
    """Return the coloured torus of about so many faces at 1920x1080."""
    return colored_torus(*meshes.torus_size(count))


def fill_of(side: int) -> TriangleScene:
    """Return smooth quads, back to front, over a square of so many pixels a side."""
    return smooth_quads("back_to_front", (side, side), FEWER_QUADS)


FAMILIES: dict[str, Callable[[int], Scene]] = {
    "batch_64": partial(batch_of, 64),
    "batch_128": partial(batch_of, 128),
    "part_of_batch_64": partial(part_of_batch, 64),
    "part_of_batch_128": partial(part_of_batch, 128),
    "triangles": triangles_of,
    "fill": fill_of,
}


def find_scene(name: str) -> Any:
    """Return the scene of a name in ``SCENES``, of ``family:number`` or of ``effect:variant``."""
    family, colon, number = name.partition(":")
    if family == "effect":
        from benchmarks.effects_scenes import find_variant

        return find_variant(number)
    return FAMILIES[family](int(number)) if colon else SCENES[name]()
