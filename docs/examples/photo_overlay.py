"""
Calibrate a camera from photographs of a chessboard, and lay a mesh over one of them.

``python photo_overlay.py PHOTO ... --mesh MESH -o overlay.png``. Without photographs it makes some,
by casting rays in NumPy: a bent wide-angle lens over a board of 9 x 6 squares.
Needs ``pip install opencv-python-headless``.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import cv2
import imageio.v3 as imageio
import numpy as np
from numpy.typing import NDArray

import rasterjit as rj

Array = NDArray[np.float64]
K = np.array([[410.0, 0.0, 322.4], [0.0, 412.0, 236.1], [0.0, 0.0, 1.0]])
BENT = np.array([-0.31, 0.12, 4e-4, -6e-4])
"""What the photographs are made with: k1, k2, p1, p2. The program has to find it out."""
VIEWS = [(5.5, 8.5, 5.0), (4.5, -4.0, 7.0), (1.0, -4.0, 6.0), (8.0, -4.0, 6.0), (-3.0, 2.0, 6.5),
         (10.0, 3.0, 6.5), (4.5, 3.0, 8.0), (0.0, 8.5, 5.5)]  # fmt: skip
"""Where they are taken from, in squares of the board; all look at its middle."""


class Calibration(NamedTuple):
    """What OpenCV finds: matrix, distortion, and a pose (camera from board) for each photograph."""

    K: Array
    distortion: Array
    poses: list[Array]
    error: float


def board_points(columns: int, rows: int) -> NDArray[np.float32]:
    """Return the inner corners, (N, 3), in squares; y goes down the board, z into it."""
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1).astype(np.float32)


def take_photograph(eye: tuple[float, float, float], size: tuple[int, int], fine: int = 3) -> Array:
    """Return a picture of the board, (H, W, 3) of 0..255, as the bent lens sees it."""
    w, h = size
    to_eye = np.array([eye[0], eye[1], -eye[2]])  # the board's z points away from the camera
    view = rj.transforms.look_at(to_eye, (3.5, 2.0, 0.0), (0.0, -1.0, -0.2))
    pose = np.diag([1.0, -1.0, -1.0, 1.0]) @ view
    places = (np.mgrid[0 : h * fine, 0 : w * fine][::-1].reshape(2, -1).T + 0.5) / fine - 0.5
    rays = cv2.undistortPoints(places[:, None], K * [[w / 640], [h / 480], [1]], BENT)[:, 0]
    directions = np.column_stack([rays, np.ones(len(rays))]) @ pose[:3, :3]
    on_board = to_eye + directions * (-to_eye[2] / directions[:, 2])[:, None]
    square = np.floor(on_board[:, :2]).astype(int)
    is_dark = square.sum(axis=1) % 2 == 0
    edge = np.maximum(on_board[:, :2] - (8.0, 5.0), -1.0 - on_board[:, :2]).max(axis=1)
    grain = 9.0 * np.sin(5.0 * on_board[:, 1] + 2.0 * np.sin(0.4 * on_board[:, 0]))
    light = 1.0 / (1.0 + 0.004 * ((on_board[:, :2] - (2.0, 0.0)) ** 2).sum(axis=1))
    board = np.where(is_dark, 35.0, 235.0)[:, None] * np.ones(3)
    table = np.array([150.0, 112.0, 78.0]) + grain[:, None]
    color = np.where((edge < 0.0)[:, None], board, np.where((edge < 0.5)[:, None], 235.0, table))
    lit = (color * light[:, None]).reshape(h, fine, w, fine, 3).mean(axis=(1, 3))
    return np.clip(lit + np.random.default_rng(7).normal(0.0, 2.0, lit.shape), 0.0, 255.0)


def calibrate(photos: list[Path], columns: int = 8, rows: int = 5) -> Calibration:
    """Find the board's inner corners in each photograph, and from them the camera."""
    found, size = [], (0, 0)
    for photo in photos:
        grey = cv2.imread(str(photo), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise SystemExit(f"{photo} is no picture")
        seen, corners = cv2.findChessboardCorners(grey, (columns, rows))
        if not seen:
            raise SystemExit(f"{photo} shows no board of {columns} x {rows} inner corners")
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
        found.append(cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), stop))
        size = grey.shape[1], grey.shape[0]
    points = [board_points(columns, rows)] * len(found)
    # k3 from so few photographs follows their noise, and may fold the picture at its corners.
    error, matrix, bent, turns, moves = cv2.calibrateCamera(
        points, found, size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
    )
    poses = []
    for turn, move in zip(turns, moves, strict=True):
        poses.append(np.eye(4))
        poses[-1][:3] = np.column_stack([cv2.Rodrigues(turn)[0], move])
    return Calibration(np.array(matrix, float), np.array(bent, float).ravel(), poses, error)


def overlay(photo: Path, mesh: Path, found: Calibration, number: int = 0) -> rj.Frame:
    """Return a photograph with the mesh standing on the board, and the board's lines drawn."""
    scene = rj.load(mesh)
    low, high = scene.bounds()
    size = 4.5 / float(np.linalg.norm((high - low)[[0, 2]]))
    foot = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    # From y up to the board, whose z points into the table.
    stand = rj.transforms.compose(
        rj.transforms.translate((3.5, 2.0, 0.0)), rj.transforms.rotate_x(-90.0),
        rj.transforms.rotate_y(25.0), rj.transforms.scale(size), rj.transforms.translate(-foot),
    )  # fmt: skip
    for node in scene.nodes:
        node.transform = stand @ node.transform
        node.mesh.material = rj.Material("pbr", "#d9822b", roughness=0.35)
    for x in range(8):
        scene.add(rj.Lines([(x, 0, 0), (x, 4, 0)], colors="#00b4ff", width=2.0))
    for y in range(5):
        scene.add(rj.Lines([(0, y, 0), (7, y, 0)], colors="#00b4ff", width=2.0))
    scene.lights = [
        rj.AmbientLight(intensity=0.4),
        rj.DirectionalLight((0.6, 0.5, 1.0), intensity=0.8),
    ]
    picture = imageio.imread(photo)
    size_of_picture = picture.shape[1], picture.shape[0]
    camera = rj.cameras.from_opencv(found.K, size_of_picture, camera_from_world=found.poses[number])
    return rj.render(
        scene, camera, size=size_of_picture, background=picture,
        lens=rj.PinholeDistortion(*found.distortion), quality=rj.Quality(samples=16),
    )  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Calibrate, and draw over the first photograph."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photos", nargs="*", type=Path, help="of a board of 9 x 6 squares")
    parser.add_argument("--mesh", type=Path, default=Path("models/teapot.obj"), help="y up")
    parser.add_argument("-o", "--output", type=Path, default=Path("overlay.png"))
    chosen = parser.parse_args(arguments)
    photos = chosen.photos
    if not photos:
        photos = [chosen.output.with_name(f"photo_{k}.jpg") for k in range(len(VIEWS))]
        for photo, eye in zip(photos, VIEWS, strict=True):
            picture = take_photograph(eye, (640, 480))[..., ::-1].astype(np.uint8)
            cv2.imwrite(str(photo), picture, [cv2.IMWRITE_JPEG_QUALITY, 95])
    found = calibrate(photos)
    print(f"K = {np.round(found.K, 1).tolist()}, distortion = {np.round(found.distortion, 3)}")
    print(f"corners are {found.error:.2f} pixels off (root of the mean square)")
    overlay(photos[0], chosen.mesh, found).save(chosen.output)


if __name__ == "__main__":
    main()
