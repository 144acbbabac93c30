"""A data set in the BOP format says of its pixels what rays and OpenCV say."""

from __future__ import annotations

import json

import cv2
import imageio.v3 as imageio
import numpy as np
import pytest
import trimesh
from PIL import Image

SIZE = 160, 120
IMAGES = 3


@pytest.fixture
def made(program, tmp_path):
    """Return the program that checks, the folder of models and that of the scene."""
    size = [str(side) for side in SIZE]
    program("bop").main(["-o", "bop", "--images", str(IMAGES), "--seed", "2", "--size", *size])
    return program("bop_check"), tmp_path / "bop/models", tmp_path / "bop/train/000000"


def rows_of(scene, name):
    rows = json.loads((scene / f"scene_{name}.json").read_text())
    assert list(rows) == [str(k) for k in range(IMAGES)]
    return list(rows.values())


def mask_of(scene, folder, image, k):
    codes = imageio.imread(scene / f"{folder}/{image:06d}_{k:06d}.png")
    assert codes.shape == SIZE[::-1]
    assert set(np.unique(codes)) <= {0, 255}
    return codes > 0


def test_depth_goes_back_to_the_models(made):
    check, models, scene = made
    off = check.reproject(models, scene)
    assert len(off) == 3 * IMAGES
    # Half a code of depth, and half a step of the sub-pixel grid along faces that are seen edge-on.
    assert 0.0 < max(off.values()) < 0.5
    check.main(["bop", "-o", "overview.png"])
    with Image.open("overview.png") as picture:
        assert picture.size == (3 * SIZE[0], 2 * SIZE[1])


@pytest.mark.parametrize("name", ["cam_t_m2c", "cam_R_m2c"])
def test_a_wrong_pose_is_found(made, name):
    check, _, scene = made
    rows = json.loads((scene / "scene_gt.json").read_text())
    if name == "cam_t_m2c":
        rows["1"][2][name][2] += 2.0  # millimetres
    else:
        rows["1"][2][name] = np.reshape(rows["1"][2][name], (3, 3)).T.ravel().tolist()
    (scene / "scene_gt.json").write_text(json.dumps(rows))
    with pytest.raises(SystemExit, match=r"more than 1.0 mm: \(1, 2\)"):
        check.main(["bop"])


def test_masks_and_fractions_are_what_rays_see(made):
    _, models, scene = made
    infos, truths, cameras = (rows_of(scene, name) for name in ("gt_info", "gt", "camera"))
    fractions = []
    for image, (info, poses, camera) in enumerate(zip(infos, truths, cameras, strict=True)):
        K = np.reshape(camera["cam_K"], (3, 3))
        parts = []
        for pose in poses:
            mesh = trimesh.load_mesh(models / f"obj_{pose['obj_id']:06d}.ply", process=False)
            mesh.vertices = mesh.vertices @ np.reshape(pose["cam_R_m2c"], (3, 3)).T
            mesh.apply_translation(pose["cam_t_m2c"])
            parts.append(mesh)
        columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
        rays = np.stack([columns, rows, np.ones_like(rows)], -1).reshape(-1, 3) @ np.linalg.inv(K).T
        every = trimesh.util.concatenate(parts)
        owners = np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts])
        first = every.ray.intersects_first(np.zeros_like(rays), rays)
        seen = np.where(first < 0, -1, owners[first]).reshape(rows.shape)
        for k, (row, part) in enumerate(zip(info, parts, strict=True)):
            mask, visible = (mask_of(scene, name, image, k) for name in ("mask", "mask_visib"))
            assert not (visible & ~mask).any()
            whole = part.ray.intersects_any(np.zeros_like(rays), rays).reshape(rows.shape)
            # Rays through the very edge of a face may miss it.
            assert (whole != mask).sum() <= 3
            assert ((seen == k) != visible).sum() <= 3
            assert row["px_count_visib"] == visible.sum()
            assert row["px_count_all"] >= row["px_count_valid"] == mask.sum()
            assert row["visib_fract"] == visible.sum() / row["px_count_all"]
            ys, xs = visible.nonzero()
            assert row["bbox_visib"] == [xs.min(), ys.min(), np.ptp(xs), np.ptp(ys)]
            fractions.append(row["visib_fract"])
    assert min(fractions) < 0.95 < max(fractions) == 1.0


def test_boxes_hold_what_opencv_projects(made):
    _, models, scene = made
    infos, truths, cameras = (rows_of(scene, name) for name in ("gt_info", "gt", "camera"))
    info = json.loads((models / "models_info.json").read_text())
    for rows, poses, camera in zip(infos, truths, cameras, strict=True):
        for row, pose in zip(rows, poses, strict=True):
            mesh = trimesh.load_mesh(models / f"obj_{pose['obj_id']:06d}.ply", process=False)
            said = info[str(pose["obj_id"])]
            np.testing.assert_allclose(mesh.bounds[0], [said[f"min_{a}"] for a in "xyz"], atol=1e-6)
            np.testing.assert_allclose(mesh.extents, [said[f"size_{a}"] for a in "xyz"], atol=1e-6)
            assert max(mesh.extents) <= said["diameter"] <= np.linalg.norm(mesh.extents) + 1e-9
            R, t = np.reshape(pose["cam_R_m2c"], (3, 3)), np.array(pose["cam_t_m2c"])
            K = np.reshape(camera["cam_K"], (3, 3))
            pixels = cv2.projectPoints(mesh.vertices, cv2.Rodrigues(R)[0], t, K, None)[0][:, 0]
            x, y, w, h = row["bbox_obj"]
            low, high = pixels.min(axis=0) - 0.01, pixels.max(axis=0) + 0.01
            # Pixels whose centres are inside; a sharp tip may miss those of the last row.
            assert (low <= (x, y)).all()
            assert ((x, y) < low + 2.0).all()
            assert (high - 2.0 < (x + w, y + h)).all()
            assert ((x + w, y + h) <= high).all()
