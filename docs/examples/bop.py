"""
Write a data set for 6-DoF pose estimation in the BOP format.

``python bop.py MESH ... -o FOLDER``; bop_check.py beside it checks the files by reprojection.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import rasterjit as rj
from rasterjit.dataset import bop, render_objects

COLORS = "#3d7ea6", "#d9822b", "#8aa84a", "#be465a"


def make_model(source: Path, color: str, diagonal: float = 160.0) -> rj.Mesh:
    """Return a mesh as BOP asks for: millimetres, z up, the box's centre at the origin."""
    read = rj.load(source).nodes[0].mesh.split_creases()
    turn = rj.transforms.rotate_x(90.0)  # from y up
    vertices = rj.transforms.apply(turn, read.vertices)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    vertices = (vertices - (low + high) / 2) * diagonal / np.linalg.norm(high - low)
    normals = rj.transforms.apply(turn, read.vertex_normals())
    return rj.Mesh(vertices, read.faces, normals=normals, material=rj.Material(base_color=color))


def place(models: dict[int, bop.ObjectModel], random: np.random.Generator) -> rj.Scene:
    """Return a table with the objects standing in a ring on it, z up, in millimetres."""
    scene = rj.Scene()
    for k, model in enumerate(models.values()):
        angle = 2.0 * np.pi * (k + 0.4 * random.random()) / len(models)
        x, y = (40.0 + 20.0 * len(models)) * np.array([np.cos(angle), np.sin(angle)])
        at = rj.transforms.translate((x, y, -model.info["min_z"]))
        scene.add(model.mesh, at @ rj.transforms.rotate_z(random.uniform(0.0, 360.0)))
    corners = [(-900, -900, 0), (900, -900, 0), (900, 900, 0), (-900, 900, 0)]
    wood = rj.Material("pbr", "#b9a58c", roughness=0.8)
    # The table comes last: the objects have the places 0, 1, 2 ...
    scene.add(rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=wood), name="table")
    key = rj.DirectionalLight(
        (-0.6, 0.5, -1.0), intensity=0.85, shadow=rj.Shadow(2048, "soft", 4.0)
    )
    scene.lights += [rj.AmbientLight(intensity=0.3), key]
    return scene


def look_around(
    count: int, size: tuple[int, int], random: np.random.Generator
) -> list[rj.MatrixCamera]:
    """Return cameras of one K that look at the middle of the table."""
    w, h = size
    K = [[1.2 * w, 0.0, w / 2 - 0.5], [0.0, 1.2 * w, h / 2 - 0.5], [0.0, 0.0, 1.0]]
    cameras, up = [], (0.0, 0.0, 1.0)
    for _ in range(count):
        away = rj.orbit_direction(random.uniform(0.0, 360.0), random.uniform(15.0, 50.0), up=up)
        eye = random.uniform(550.0, 750.0) * np.asarray(away) + (0.0, 0.0, 40.0)
        # OpenCV's camera: y down, z ahead.
        turn = np.diag([1.0, -1.0, -1.0, 1.0])
        view = turn @ rj.transforms.look_at(eye, (0.0, 0.0, 40.0), up)
        cameras.append(rj.cameras.from_opencv(K, size, camera_from_world=view))
    return cameras


def main(arguments: list[str] | None = None) -> None:
    """Write one scene of a data set, and its models."""
    parser = argparse.ArgumentParser(description=__doc__)
    sources = [Path("models") / name for name in ("teapot.obj", "torus_knot.obj", "cube.ply")]
    parser.add_argument("meshes", nargs="*", type=Path, default=sources, help="mesh files, y up")
    parser.add_argument("-o", "--output", type=Path, default=Path("bop"), help="a new folder")
    parser.add_argument("--images", type=int, default=8)
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480), metavar=("W", "H"))
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    random, size = np.random.default_rng(chosen.seed), tuple(chosen.size)

    models = {
        number: make_model(source, COLORS[(number - 1) % len(COLORS)])
        for number, source in enumerate(chosen.meshes, 1)
    }
    bop.write_models(chosen.output / "models", models)
    scene = place(bop.read_models(chosen.output / "models"), random)  # as others will read them
    views = render_objects(
        scene, look_around(chosen.images, size, random), size=size, ids=[*models, None],
        quality=rj.Quality(samples=4), delta=None,
    )  # fmt: skip
    folder = chosen.output / "train" / "000000"
    print(f"{bop.write_scene(folder, views)} images in {folder}")


if __name__ == "__main__":
    main()
