"""Build the small glTF scene: instances, a texture, transparency, vertex colours, lights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from glb import GlbFile, encode_png
from numpy.typing import NDArray
from surfaces import CUBE_CORNERS, CUBE_SIDES, QUAD, grid_faces, unit

CHECKER_CELLS, CHECKER_CELL_PIXELS = 8, 8
BALL_ROWS, BALL_COLUMNS = 24, 48


def checkerboard() -> NDArray[np.uint8]:
    """
    Paint a checkerboard that shows which way up it is: red grows with x, green with y downwards.

    Returns
    -------
    ndarray (64,64,3) uint8, sRGB
    """
    size = CHECKER_CELLS * CHECKER_CELL_PIXELS
    cell = np.arange(size) // CHECKER_CELL_PIXELS
    row, column = cell[:, None], cell[None, :]
    ramp = 64 + 24 * cell
    tint = np.empty((size, size, 3), np.uint8)
    tint[..., 0], tint[..., 1], tint[..., 2] = ramp[None, :], ramp[:, None], 64
    is_light = (row + column) % 2 == 0
    return np.where(is_light[..., None], np.uint8(235), tint)


def box_arrays() -> tuple[dict[str, NDArray], NDArray[np.uint16]]:
    """Return a cube of side 2 with its own four vertices per side: positions, normals, uv."""
    corners = CUBE_SIDES.ravel()
    positions = CUBE_CORNERS[corners].astype(np.float32)
    sides = np.repeat(np.eye(3), 2, axis=0) * np.tile([-1.0, 1.0], 3)[:, None]
    uvs = np.tile([[0, 1], [1, 1], [1, 0], [0, 0]], (6, 1))  # glTF: v down
    faces = (np.arange(6)[:, None, None] * 4 + QUAD).reshape(-1, 3)
    attributes = {
        "POSITION": positions,
        "NORMAL": np.repeat(sides, 4, axis=0).astype(np.float32) + np.float32(0),
        "TEXCOORD_0": uvs.astype(np.float32),
    }
    return attributes, faces.astype(np.uint16)


def ball_arrays() -> tuple[dict[str, NDArray], NDArray[np.uint16]]:
    """Return the unit sphere on a grid of latitudes and longitudes: positions, normals."""
    points = []
    for i in range(BALL_ROWS + 1):
        polar = math.pi * i / BALL_ROWS
        for j in range(BALL_COLUMNS + 1):
            turn = 2.0 * math.pi * (j % BALL_COLUMNS) / BALL_COLUMNS
            ring = math.sin(polar) if 0 < i < BALL_ROWS else 0.0
            points.append((ring * math.sin(turn), math.cos(polar), ring * math.cos(turn)))
    positions = np.array(points, np.float32)
    faces = grid_faces(BALL_ROWS + 1, BALL_COLUMNS + 1)
    a, b, c = (positions[faces[:, k]] for k in range(3))
    has_area = (a != b).any(axis=1) & (b != c).any(axis=1) & (c != a).any(axis=1)
    return {"POSITION": positions, "NORMAL": positions}, faces[has_area].astype(np.uint16)


def turn(axis: Sequence[float], degrees: float) -> list[float]:
    """Return the unit quaternion (x, y, z, w) of a right-handed turn about a unit axis."""
    half = math.radians(degrees) / 2.0
    return [*(math.sin(half) * component for component in axis), math.cos(half)]


def aim(eye: Sequence[float], target: Sequence[float]) -> list[float]:
    """Return the column-major matrix that puts −z of a node at ``eye`` through ``target``, y up."""
    back = unit(np.array(eye) - np.array(target))
    right = unit(np.cross([0.0, 1.0, 0.0], back))
    columns = [(right, 0.0), (np.cross(back, right), 0.0), (back, 0.0), (np.array(eye), 1.0)]
    return [float(x) for column, last in columns for x in (*column.tolist(), last)]


def add_materials(glb: GlbFile) -> dict[str, int]:
    """Add the scene's four materials; return their numbers by name."""
    image = glb.add_image(encode_png(checkerboard()), "checkerboard")
    sampler = glb.add("samplers", {"wrapS": 10497, "wrapT": 10497})
    texture = glb.add("textures", {"source": image, "sampler": sampler})
    factors: dict[str, dict] = {
        "ground": {"baseColorFactor": [0.35, 0.35, 0.33, 1.0], "roughnessFactor": 0.95},
        "checker": {"baseColorTexture": {"index": texture}, "roughnessFactor": 0.6},
        "glass": {"baseColorFactor": [0.2, 0.45, 0.9, 0.4], "roughnessFactor": 0.1},
        "vertex_color": {"roughnessFactor": 0.5},
    }
    numbers = {}
    for name, factor in factors.items():
        material = {"name": name, "pbrMetallicRoughness": {"metallicFactor": 0.0, **factor}}
        if name == "glass":
            material["alphaMode"] = "BLEND"
        numbers[name] = glb.add("materials", material)
    return numbers


def add_meshes(glb: GlbFile) -> dict[str, int]:
    """Add the scene's four meshes; return their numbers by name."""
    materials = add_materials(glb)
    box, box_faces = box_arrays()
    ball, ball_faces = ball_arrays()
    half = 6.0
    ground = {
        "POSITION": np.array(
            [[-half, 0, half], [half, 0, half], [half, 0, -half], [-half, 0, -half]]
        ),
        "NORMAL": np.tile([0.0, 1.0, 0.0], (4, 1)),
    }
    ground = {name: data.astype(np.float32) for name, data in ground.items()}
    opaque = np.full(len(box["POSITION"]), 255)
    colors = np.column_stack([np.where(box["POSITION"] > 0, 255, 0), opaque]).astype(np.uint8)
    colored = {"POSITION": box["POSITION"], "NORMAL": box["NORMAL"], "COLOR_0": colors}
    return {
        "ground": glb.add_mesh("ground", ground, QUAD.astype(np.uint16), materials["ground"]),
        "crate": glb.add_mesh("crate", box, box_faces, materials["checker"]),
        "ball": glb.add_mesh("ball", ball, ball_faces, materials["glass"]),
        "color_cube": glb.add_mesh("color_cube", colored, box_faces, materials["vertex_color"]),
    }


def add_lights(glb: GlbFile) -> list[int]:
    """Add a white directional light from the upper left and a warm point light; return nodes."""
    sun = glb.add_light(
        {"name": "sun", "type": "directional", "color": [1.0, 1.0, 1.0], "intensity": 2.5}
    )
    lamp = glb.add_light(
        {"name": "lamp", "type": "point", "color": [1.0, 0.8, 0.6], "intensity": 12.0}
    )
    sun_matrix = aim((-3.0, 6.0, 4.0), (0.0, 0.0, 0.0))
    return [
        glb.add("nodes", {"name": "sun", "matrix": sun_matrix, "extensions": _light(sun)}),
        glb.add(
            "nodes", {"name": "lamp", "translation": [2.5, 3, 2.5], "extensions": _light(lamp)}
        ),
    ]


def _light(number: int) -> dict[str, dict[str, int]]:
    return {"KHR_lights_punctual": {"light": number}}


def make_scene(folder: Path) -> None:
    """
    Write a glTF scene: a ground, three crates that are one textured mesh, a transparent ball, a
    vertex-coloured cube behind it, a perspective camera, a directional and a point light.

    The crate on top hangs below the first crate, which hangs below a turned group: three levels of
    transforms. The third crate is scaled differently along each axis.
    """
    glb = GlbFile()
    meshes = add_meshes(glb)
    top = glb.add(
        "nodes",
        {
            "name": "crate_top",
            "mesh": meshes["crate"],
            "translation": [0, 1.6, 0],
            "rotation": turn((0, 1, 0), 25),
            "scale": [0.6, 0.6, 0.6],
        },
    )
    base = glb.add(
        "nodes",
        {
            "name": "crate_base",
            "mesh": meshes["crate"],
            "translation": [0, 0.75, 0],
            "scale": [0.75, 0.75, 0.75],
            "children": [top],
        },
    )
    objects = [
        {"name": "ground", "mesh": meshes["ground"]},
        {
            "name": "tower",
            "translation": [-1.5, 0, 0],
            "rotation": turn((0, 1, 0), 30),
            "children": [base],
        },
        {
            "name": "crate_flat",
            "mesh": meshes["crate"],
            "translation": [2.6, 0.3, -1.6],
            "rotation": turn((0, 1, 0), -20),
            "scale": [0.9, 0.3, 0.5],
        },
        {
            "name": "ball",
            "mesh": meshes["ball"],
            "translation": [1.2, 0.9, 1.3],
            "scale": [0.9] * 3,
        },
        {
            "name": "color_cube",
            "mesh": meshes["color_cube"],
            "translation": [0.9, 0.9, -0.9],
            "rotation": turn((0.6, 0, 0.8), 40),
            "scale": [0.55] * 3,
        },
    ]
    roots = [glb.add("nodes", node) for node in objects] + add_lights(glb)
    lens = {"yfov": math.radians(40), "aspectRatio": 1.5, "znear": 0.1, "zfar": 100}
    view = glb.add("cameras", {"name": "camera", "type": "perspective", "perspective": lens})
    matrix = aim((3.5, 3.2, 7.0), (0.3, 0.8, 0.0))
    roots.append(glb.add("nodes", {"name": "camera", "camera": view, "matrix": matrix}))
    glb.add("scenes", {"name": "scene", "nodes": roots})
    glb.save(folder / "scene.glb")
