"""
Check a data set in the BOP format by reprojection, and draw an overview of it.

``python bop_check.py FOLDER -o overview.png``. Each pixel of a visible mask goes back through its
depth, K and the inverse of the object's pose to the model: how far is it from the model's surface?
Uses the files alone, nothing of the program that wrote them.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

COLORS = (61, 126, 166), (217, 130, 43), (138, 168, 74), (190, 70, 90)
NEAREST_FACES = 16
"""Faces of a model that are compared with each point."""


def distances(points: NDArray[np.float64], model: trimesh.Trimesh) -> NDArray[np.float64]:
    """Return how far points, (N, 3), are from the faces whose centres are nearest."""
    count = min(NEAREST_FACES, len(model.faces))
    near = cKDTree(model.triangles_center).query(points, count)[1]
    every = np.repeat(points, count, axis=0)
    feet = trimesh.triangles.closest_point(model.triangles[near.ravel()], every)
    return np.linalg.norm(feet - every, axis=1).reshape(-1, count).min(axis=1)


def reproject(models: Path, scene: Path) -> dict[tuple[int, int], float]:
    """Return the largest distance, mm, of the visible pixels of each (image, object)."""
    cameras: dict[str, Any] = json.loads((scene / "scene_camera.json").read_text())
    truths: dict[str, Any] = json.loads((scene / "scene_gt.json").read_text())
    found = {}
    for image, poses in truths.items():
        K = np.reshape(cameras[image]["cam_K"], (3, 3))
        codes = imageio.imread(scene / f"depth/{int(image):06d}.png")
        for k, pose in enumerate(poses):
            ys, xs = imageio.imread(scene / f"mask_visib/{int(image):06d}_{k:06d}.png").nonzero()
            depth = codes[ys, xs] * cameras[image]["depth_scale"]
            rays = np.stack([xs, ys, np.ones(len(xs))], axis=1) @ np.linalg.inv(K).T
            R, t = np.reshape(pose["cam_R_m2c"], (3, 3)), np.array(pose["cam_t_m2c"])
            on_model = (rays * depth[:, None] - t) @ R  # the inverse of x -> R x + t
            model = trimesh.load_mesh(models / f"obj_{pose['obj_id']:06d}.ply")
            found[int(image), k] = float(distances(on_model, model).max(initial=0.0))
    return found


def overview(scene: Path, images: int = 2) -> NDArray[np.uint8]:
    """Return views of a scene below each other: the picture, its depth, and the visible masks."""
    rows = []
    for path in sorted((scene / "rgb").glob("*.png"))[:images]:
        color, codes = imageio.imread(path), imageio.imread(scene / "depth" / path.name)
        near, far = np.percentile(codes[codes > 0], (0.1, 90))
        grey = np.clip(1.0 - 0.8 * (codes - near) / (far - near), 0.1, 1.0) * (codes > 0)
        masks = np.full_like(color, 255)
        for k, mask in enumerate(sorted((scene / "mask_visib").glob(f"{path.stem}_*.png"))):
            masks[imageio.imread(mask) > 0] = COLORS[k % len(COLORS)]
        rows.append(np.hstack([color, np.uint8(255 * np.stack([grey] * 3, axis=2)), masks]))
    return np.vstack(rows)


def main(arguments: list[str] | None = None) -> None:
    """Check every scene of a data set."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("bop"))
    parser.add_argument("-o", "--output", type=Path, default=Path("overview.png"))
    parser.add_argument("--most", type=float, default=1.0, help="millimetres that may be wrong")
    chosen = parser.parse_args(arguments)
    scenes = sorted(path.parent for path in chosen.folder.rglob("scene_gt.json"))
    if not scenes:
        raise SystemExit(f"{chosen.folder} holds no scene_gt.json")
    for scene in scenes:
        off = reproject(chosen.folder / "models", scene)
        print(f"{scene}: {len(off)} objects, at most {max(off.values()):.3f} mm off")
        if max(off.values()) > chosen.most:
            raise SystemExit(f"more than {chosen.most} mm: {max(off, key=off.__getitem__)}")
    imageio.imwrite(chosen.output, overview(scenes[0]))


if __name__ == "__main__":
    main()
