"""
Write a data set for 6-DoF pose estimation in the BOP format.

``python bop.py MESH ... -o FOLDER``; bop_check.py beside it checks the files by reprojection.
Needs ``pip install "rasterjit[animation]"`` (SciPy).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

import rasterjit as rj
from rasterjit.io.images import save_image

COLORS = (61, 126, 166), (217, 130, 43), (138, 168, 74), (190, 70, 90)
DEPTH_SCALE = 0.1
"""Millimetres a code of the 16-bit depth images: they reach 6.5 m."""


def write_models(sources: list[Path], folder: Path, diagonal: float = 160.0) -> list[rj.Mesh]:
    """Write each mesh as BOP asks for: millimetres, z up, the box's centre at the origin."""
    folder.mkdir(parents=True)
    info, meshes = {}, []
    for number, source in enumerate(sources, 1):
        read = rj.load(source).nodes[0].mesh.split_creases()
        color = COLORS[(number - 1) % len(COLORS)]
        mesh = trimesh.Trimesh(
            read.vertices, read.faces, vertex_normals=read.normals, process=False,
            vertex_colors=np.tile(color, (len(read.vertices), 1)),
        )  # fmt: skip
        mesh.apply_transform(rj.transforms.rotate_x(90.0))  # from y up
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
        mesh.apply_scale(diagonal / np.linalg.norm(mesh.extents))
        path = folder / f"obj_{number:06d}.ply"
        mesh.export(path, encoding="ascii", vertex_normal=True)
        meshes.append(rj.load(path).nodes[0].mesh)  # what others will read
        info[number] = {"diameter": float(pdist(mesh.convex_hull.vertices).max())}
        for axis, low, size in zip("xyz", mesh.bounds[0], mesh.extents, strict=True):
            info[number] |= {f"min_{axis}": float(low), f"size_{axis}": float(size)}
    (folder / "models_info.json").write_text(json.dumps(info, indent=2))
    return meshes


def place(meshes: list[rj.Mesh], random: np.random.Generator) -> tuple[rj.Scene, list[rj.Node]]:
    """Return a table with the objects standing in a ring on it, z up, in millimetres."""
    scene, nodes = rj.Scene(), []
    for k, mesh in enumerate(meshes):
        angle = 2.0 * np.pi * (k + 0.4 * random.random()) / len(meshes)
        x, y = (40.0 + 20.0 * len(meshes)) * np.array([np.cos(angle), np.sin(angle)])
        at = rj.transforms.translate((x, y, -mesh.vertices[:, 2].min()))
        nodes.append(scene.add(mesh, at @ rj.transforms.rotate_z(random.uniform(0.0, 360.0))))
    corners = [(-900, -900, 0), (900, -900, 0), (900, 900, 0), (-900, 900, 0)]
    wood = rj.Material("pbr", "#b9a58c", roughness=0.8)
    # The table comes last, so that the objects have the numbers 0, 1, 2 ...
    scene.add(rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=wood), name="table")
    key = rj.DirectionalLight(
        (-0.6, 0.5, -1.0), intensity=0.85, shadow=rj.Shadow(2048, "soft", 4.0)
    )
    scene.lights += [rj.AmbientLight(intensity=0.3), key]
    return scene, nodes


def box(mask: NDArray[np.bool_], corner: tuple[int, int] = (0, 0)) -> list[int]:
    """Return (x, y, width, height) as the BOP toolkit does: from the first to the last pixel."""
    if not mask.any():
        return [-1, -1, -1, -1]
    ys, xs = mask.nonzero()
    return [int(xs.min()) - corner[0], int(ys.min()) - corner[1], int(np.ptp(xs)), int(np.ptp(ys))]


def silhouettes(
    node: rj.Node, cameras: list[rj.MatrixCamera], size: tuple[int, int]
) -> Iterator[NDArray[np.bool_]]:
    """Yield the pixels of an object that stands alone, (H, W), of each camera."""
    alone = rj.Scene()
    alone.add(node.mesh, node.transform)
    for frame in rj.render_many(alone, cameras, size=size, outputs="object_id"):
        yield frame.object_id >= 0


def write_scene(
    folder: Path, scene: rj.Scene, nodes: list[rj.Node], images: int, size: tuple[int, int],
    random: np.random.Generator,
) -> None:  # fmt: skip
    """Render the views of one scene, with poses, masks and visible fractions."""
    for name in ("rgb", "depth", "mask", "mask_visib"):
        (folder / name).mkdir(parents=True)
    w, h = size
    K = np.array([[1.2 * w, 0.0, w / 2 - 0.5], [0.0, 1.2 * w, h / 2 - 0.5], [0.0, 0.0, 1.0]])
    # Silhouettes may reach beyond the picture. BOP counts their pixels on one three times as large.
    wide_size, wide_K = (3 * w, 3 * h), K + [[0, 0, w], [0, 0, h], [0, 0, 0]]
    inside = np.s_[h : 2 * h, w : 2 * w]
    rows: dict[str, dict[int, Any]] = {"camera": {}, "gt": {}, "gt_info": {}}
    views, up = [], (0.0, 0.0, 1.0)
    for _ in range(images):
        away = rj.orbit_direction(random.uniform(0.0, 360.0), random.uniform(15.0, 50.0), up=up)
        eye = random.uniform(550.0, 750.0) * np.asarray(away) + (0.0, 0.0, 40.0)
        # OpenCV's camera: y down, z ahead.
        views.append(
            np.diag([1.0, -1.0, -1.0, 1.0]) @ rj.transforms.look_at(eye, (0.0, 0.0, 40.0), up)
        )
    frames = rj.render_many(
        scene, [rj.cameras.from_opencv(K, size, camera_from_world=view) for view in views],
        size=size, quality=rj.Quality(samples=4), outputs=("color", "depth", "object_id"),
    )  # fmt: skip
    wide = [rj.cameras.from_opencv(wide_K, wide_size, camera_from_world=view) for view in views]
    alone = [silhouettes(node, wide, wide_size) for node in nodes]
    for image, (view, frame, *wholes) in enumerate(zip(views, frames, *alone, strict=True)):
        save_image(folder / f"rgb/{image:06d}.png", frame.color[..., :3])
        frame.save(folder / f"depth/{image:06d}.png", "depth", scale=DEPTH_SCALE)
        R, t = view[:3, :3].ravel().tolist(), view[:3, 3].tolist()
        camera = {"cam_K": K.ravel().tolist(), "depth_scale": DEPTH_SCALE}
        rows["camera"][image] = camera | {"cam_R_w2c": R, "cam_t_w2c": t}
        rows["gt"][image], rows["gt_info"][image] = [], []
        for k, (node, whole) in enumerate(zip(nodes, wholes, strict=True)):
            visible = frame.object_id == k
            save_image(
                folder / f"mask/{image:06d}_{k:06d}.png", 255 * whole[inside].astype(np.uint8)
            )
            save_image(
                folder / f"mask_visib/{image:06d}_{k:06d}.png", 255 * visible.astype(np.uint8)
            )
            pose = view @ node.transform  # camera from model
            R, t = pose[:3, :3].ravel().tolist(), pose[:3, 3].tolist()
            rows["gt"][image].append({"cam_R_m2c": R, "cam_t_m2c": t, "obj_id": k + 1})
            rows["gt_info"][image].append({
                "bbox_obj": box(whole, size), "bbox_visib": box(visible),
                "px_count_all": int(whole.sum()), "px_count_visib": int(visible.sum()),
                "px_count_valid": int((whole[inside] & np.isfinite(frame.depth)).sum()),
                "visib_fract": float(visible.sum() / max(whole.sum(), 1)),
            })  # fmt: skip
    for name, row in rows.items():
        (folder / f"scene_{name}.json").write_text(json.dumps(row, indent=1))


def main(arguments: list[str] | None = None) -> None:
    """Write one scene of a data set, and its models."""
    parser = argparse.ArgumentParser(description=__doc__)
    models = [Path("models") / name for name in ("teapot.obj", "torus_knot.obj", "cube.ply")]
    parser.add_argument("meshes", nargs="*", type=Path, default=models, help="mesh files, y up")
    parser.add_argument("-o", "--output", type=Path, default=Path("bop"), help="a new folder")
    parser.add_argument("--images", type=int, default=8)
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480), metavar=("W", "H"))
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    random = np.random.default_rng(chosen.seed)
    scene, nodes = place(write_models(chosen.meshes, chosen.output / "models"), random)
    folder = chosen.output / "train" / "000000"
    write_scene(folder, scene, nodes, chosen.images, tuple(chosen.size), random)
    print(f"{chosen.images} images in {folder}")


if __name__ == "__main__":
    main()
