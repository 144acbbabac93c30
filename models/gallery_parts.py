"""What the pictures of the gallery are built from: shapes, patterns, and rows of pictures."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from surfaces import CUBE_CORNERS, CUBE_SIDES, QUAD, grid_faces

import rasterjit as rj

MODELS = Path(__file__).parent
PLACE = rj.transforms
Size = tuple[int, int]
Picture = NDArray[np.uint8]
"""(H, W, 3) uint8, sRGB."""

GAP = 2
"""Pixels between the pictures of a sheet."""


@functools.cache
def model(name: str) -> rj.Mesh:
    """Load one of the models beside this file."""
    return rj.load(MODELS / name).nodes[0].mesh


def dressed(mesh: rj.Mesh, material: rj.Material, **changed: Any) -> rj.Mesh:
    """Return a mesh of the same shape in another material."""
    parts = {"normals": mesh.normals, "uv": mesh.uv, **changed}
    return rj.Mesh(mesh.vertices, mesh.faces, material=material, **parts)


def ball(rows: int = 48, columns: int = 72) -> rj.Mesh:
    """Return a sphere of radius 1 with normals and uv, a seam at the back."""
    down, around = np.mgrid[0 : rows + 1, 0 : columns + 1].reshape(2, -1)
    polar, turn = np.pi * down / rows, 2.0 * np.pi * around / columns
    points = np.stack(
        [-np.sin(polar) * np.sin(turn), np.cos(polar), -np.sin(polar) * np.cos(turn)], axis=1
    )
    uv = np.stack([around / columns, 1.0 - down / rows], axis=1)
    return rj.Mesh(points, grid_faces(rows + 1, columns + 1), normals=points, uv=uv)


def panel(width: float, height: float, repeat: float = 1.0) -> rj.Mesh:
    """Return an upright rectangle that faces +z, its middle at the origin."""
    x, y = width / 2.0, height / 2.0
    corners = [(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)]
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * repeat
    return rj.Mesh(corners, QUAD, normals=[(0.0, 0.0, 1.0)] * 4, uv=uv)


def box(width: float, height: float, depth: float) -> rj.Mesh:
    """Return a box that stands on the ground, each side with normals and uv of its own."""
    corners = CUBE_CORNERS[CUBE_SIDES].reshape(-1, 3) * np.array([width, height, depth]) / 2.0
    faces = np.concatenate([QUAD + 4 * side for side in range(6)])
    normals = np.repeat([(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)], 4, 0)
    uv = np.tile([(0, 0), (1, 0), (1, 1), (0, 1)], (6, 1))
    return rj.Mesh(corners + (0.0, height / 2.0, 0.0), faces, normals=normals, uv=uv)


def floor(half: float, material: rj.Material, repeat: float = 1.0) -> rj.Mesh:
    """Return a square ground of this half width."""
    lying = panel(2.0 * half, 2.0 * half, repeat)
    turned = PLACE.apply(PLACE.rotate_x(-90), lying.vertices)
    return rj.Mesh(turned, QUAD, normals=[(0.0, 1.0, 0.0)] * 4, uv=lying.uv, material=material)


def checks(count: int = 8, side: int = 256, dark: int = 60, light: int = 230) -> Picture:
    """Return a chess board."""
    rows, columns = np.mgrid[0:side, 0:side] * count // side
    grey = np.where((rows + columns) % 2, dark, light).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def arrows() -> Picture:
    """Return a picture with an up, a left and colours, to see how it is laid."""
    rows, columns = np.mgrid[0:128, 0:128]
    picture = np.stack([60 + columns * 3 // 2, 230 - rows, np.full_like(rows, 110)], axis=2)
    is_head = (rows > 14) & (rows < 60) & (abs(columns - 64) < (rows - 14) * 0.8)
    is_shaft = (rows >= 60) & (rows < 112) & (abs(columns - 64) < 14)
    picture[is_head | is_shaft] = 250
    picture[(rows < 5) | (rows > 122) | (columns < 5) | (columns > 122)] = 40
    return picture.astype(np.uint8)


def leaf() -> NDArray[np.uint8]:
    """Return a leaf with alpha around it, (256, 256, 4)."""
    y, x = (np.mgrid[0:256, 0:256] - 127.5) / 127.5
    tip = np.clip(1.0 - (y + 0.05) ** 2, 0.0, 1.0)
    waves = 0.06 * np.cos(22.0 * y)
    is_leaf = abs(x) < 0.62 * tip + waves * (abs(y) < 0.9)
    is_stem = (abs(x) < 0.03) & (y > 0.5)
    is_vein = (abs(x) < 0.025) | (abs((y + abs(x) * 0.7) % 0.3 - 0.15) < 0.02)
    color = np.empty((256, 256, 4), np.uint8)
    color[..., :3] = np.where(is_vein[..., None], (150, 175, 80), (74, 128, 48))
    color[..., 3] = 255 * (is_leaf | is_stem)
    return color


def bricks() -> tuple[Picture, Picture]:
    """Return the colour of a brick wall and the normals of its surface, (256, 256, 3)."""
    y, x = np.mgrid[0:256, 0:256]
    course = y // 32
    across, down = (x + 32 * (course % 2)) % 64, y % 32
    edge = np.minimum.reduce([across, 63 - across, down * 1.0, 31.0 - down])
    height = np.clip(edge / 5.0, 0.0, 1.0) * 5.0
    grain = np.sin(x * 0.9) * np.sin(y * 1.3 + course) * 0.25 * (height > 4.9)
    fall = height + grain
    slope_x = (np.roll(fall, -1, 1) - np.roll(fall, 1, 1)) / 2.0
    slope_y = (np.roll(fall, -1, 0) - np.roll(fall, 1, 0)) / 2.0
    normal = np.stack([-slope_x, slope_y, np.ones_like(slope_x)], axis=2)
    normal /= np.sqrt((normal * normal).sum(axis=2, keepdims=True))
    number = ((x + 32 * (course % 2)) // 64 * 7 + course * 13) % 5
    red = np.array([(158, 84, 62), (171, 96, 70), (146, 76, 58), (163, 92, 74), (150, 88, 66)])
    color = np.where((edge < 2.5)[..., None], (168, 160, 150), red[number])
    return color.astype(np.uint8), np.floor(127.5 * normal + 128.0).astype(np.uint8)


@functools.cache
def studio() -> rj.Environment:
    """Return a dim room with a window, a strip light and a warm lamp, as a panorama."""
    rows = np.mgrid[0:128, 0:256][0]
    up = np.cos(np.pi * (rows + 0.5) / 128)
    image = np.empty((128, 256, 3), np.float32)
    image[:] = (0.16, 0.17, 0.19) + np.clip(up, 0, 1)[..., None] * np.array([0.30, 0.33, 0.38])
    image[up < 0.0] = (0.13, 0.11, 0.10)
    lamps = (
        (30, 62, 28, 58, (9.0, 9.6, 10.5)),
        (22, 34, 120, 196, (7.0, 6.6, 6.2)),
        (44, 60, 216, 230, (14.0, 8.5, 4.0)),
    )
    for top, low, left, right, color in lamps:
        image[top:low, left:right] = color
    image[45:47, 28:58] = image[30:62, 42:44] = 0.3
    return rj.Environment(image)


def shown(scene: rj.Scene, camera: Any, size: Size, **options: Any) -> Picture:
    """Render a picture."""
    options.setdefault("background", "#e9e6e0")
    return np.ascontiguousarray(rj.render(scene, camera, size=size, **options).color[..., :3])


def in_row(pictures: Sequence[Picture]) -> Picture:
    """Put pictures side by side, white between them."""
    white = np.full((pictures[0].shape[0], GAP, 3), 255, np.uint8)
    parts = [part for picture in pictures for part in (white, picture)]
    return np.hstack(parts[1:])


def in_rows(pictures: Sequence[Picture], columns: int) -> Picture:
    """Put pictures in rows of so many."""
    rows = [in_row(pictures[n : n + columns]) for n in range(0, len(pictures), columns)]
    white = np.full((GAP, rows[0].shape[1], 3), 255, np.uint8)
    parts = [part for row in rows for part in (white, row)]
    return np.vstack(parts[1:])


def part_of(size: Size, columns: int, rows: int = 1) -> Size:
    """Return the size of one of so many pictures in a sheet of this size."""
    return (size[0] - GAP * (columns - 1)) // columns, (size[1] - GAP * (rows - 1)) // rows


def grown(picture: Picture, factor: int) -> Picture:
    """Show every pixel as a square of pixels."""
    return np.repeat(np.repeat(picture, factor, axis=0), factor, axis=1)
