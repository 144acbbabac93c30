"""Cameras of files see a point where the formulas of their formats put it."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
import struct
import zlib

import numpy as np
import pytest
import yaml
from PIL import Image

import rasterjit as rj
from rasterjit.io.camera_files import colmap

SIZE = W, H = (640, 480)
POINTS = np.random.default_rng(7).normal(size=(40, 3)) * 0.6

OPENCV = rj.PinholeDistortion(-0.12, 0.03, 1e-3, -2e-3)
BROWN = rj.PinholeDistortion(-0.12, 0.03, 1e-3, -2e-3, 0.004)
RATIONAL = rj.PinholeDistortion(0.12, 0.03, 1e-3, -2e-3, 0.004, 0.3, 0.02, 1e-3)
ALL = rj.PinholeDistortion(
    0.1, 0.02, 1e-3, 2e-3, 0.003, 0.2, 0.01, 1e-3, 1e-3, 2e-3, 3e-3, 4e-3, 0.1
)
RADIAL = rj.PinholeDistortion(-0.12, 0.03)
FISHEYE = rj.FisheyeLens(0.02, -0.003, 1e-3, -1e-4)
PANORAMA = rj.Equirectangular()


def random_cameras(lens=None, *, count=3, size=SIZE, focals=(500.0, 520.0), center=None, at=None):
    """Return cameras that see the points, of images named in a folder."""
    rng = np.random.default_rng(3)
    cx, cy = (size[0] * 0.47, size[1] * 0.55) if center is None else center
    found = []
    for number in range(count):
        eye = rng.normal(size=3)
        view = rj.transforms.look_at(
            5 * eye / np.linalg.norm(eye), rng.normal(size=3) / 5, eye[::-1]
        )
        if at is not None and number == 0:
            view = at
        camera = rj.MatrixCamera.from_intrinsics(*focals, cx, cy, size, view_from_world=view)
        found.append(rj.CalibratedCamera(camera, size, lens, f"images/{number}.png"))
    return found


AS_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""View of a camera at the world's origin, x right, y down, z forward."""

CENTERED = {"focals": (500.0, 500.0), "center": (W / 2, H / 2)}

ROUND_TRIPS = [
    ("colmap", "model", None, {}),
    ("colmap", "model", OPENCV, {}),
    ("colmap", "model/images.bin", RATIONAL, {}),
    ("colmap", "model", FISHEYE, {}),
    ("colmap", "model", PANORAMA, {"size": (640, 320)}),
    ("colmap-text", "model/cameras.txt", RATIONAL, {}),
    ("colmap-text", "model", FISHEYE, {}),
    ("nerfstudio", "transforms.json", None, {}),
    ("nerfstudio", "transforms.json", BROWN, {}),
    ("nerfstudio", "transforms.json", FISHEYE, {}),
    ("nerfstudio", "transforms.json", PANORAMA, {"size": (640, 320)}),
    ("blender", "transforms_train.json", None, CENTERED),
    ("bundler", "bundle.out", RADIAL, CENTERED),
    ("bundler", "some.bundle.rd.out", None, CENTERED),
    ("bundler", "some.out", None, CENTERED),
    ("opencv", "calibration.yaml", None, {}),
    ("opencv", "calibration.yml", ALL, {}),
    ("opencv", "calibration.yml", FISHEYE, {}),
    ("opencv", "one.yml", RATIONAL, {"count": 1}),
    ("kalibr", "camchain.yaml", OPENCV, {"at": AS_OPENCV}),
    ("kalibr", "camchain.yaml", FISHEYE, {"at": AS_OPENCV}),
]


@pytest.mark.parametrize(("file_format", "name", "lens", "made"), ROUND_TRIPS)
def test_what_is_written_reads_as_the_same_cameras(tmp_path, file_format, name, lens, made):
    cameras = random_cameras(lens, **made)
    path = tmp_path / name
    if "/" in name:
        path.parent.mkdir()
    rj.save_cameras(path, cameras, format=file_format)
    size = made.get("size", SIZE) if file_format in ("blender", "bundler") else None
    found = rj.load_cameras(path, size=size)
    assert [one.name for one in found] == [one.name for one in cameras]
    for one, other in zip(found, cameras, strict=True):
        assert (one.size, one.lens) == (other.size, other.lens)
        np.testing.assert_allclose(one.project(POINTS), other.project(POINTS), rtol=0, atol=1e-9)
    assert np.isfinite(found[-1].project(POINTS)).any()


@pytest.mark.parametrize("file_format", ["colmap", "colmap-text", "nerfstudio", "opencv", "kalibr"])
def test_cameras_that_differ_keep_their_own_intrinsics(tmp_path, file_format):
    first, second = random_cameras(OPENCV, count=2, at=AS_OPENCV)
    (other,) = random_cameras(None, count=1, focals=(450.0, 470.0), center=(300.0, 250.0))
    cameras = [first, dataclasses.replace(other, name=second.name)]
    path = tmp_path / {"nerfstudio": "a.json", "opencv": "a.yml", "kalibr": "a.yml"}.get(
        file_format, "a"
    )
    rj.save_cameras(path, cameras, format=file_format)
    for one, made in zip(rj.load_cameras(path), cameras, strict=True):
        assert (one.name, one.lens) == (made.name, made.lens)
        np.testing.assert_allclose(one.project(POINTS), made.project(POINTS), rtol=0, atol=1e-9)


def test_lists_of_images_are_named_as_other_programs_name_them(tmp_path):
    for name in ("bundle.out", "a.bundle.rd.out", "b.out"):
        rj.save_cameras(tmp_path / name, random_cameras(**CENTERED))
    lists = {path.name for path in tmp_path.glob("*.txt")}
    assert lists == {"list.txt", "a.list.rd.txt", "b.list.txt"}


def test_images_share_a_camera_where_they_can(tmp_path):
    rj.save_cameras(tmp_path / "model", random_cameras(OPENCV), format="colmap-text")
    lines = (tmp_path / "model/cameras.txt").read_text().splitlines()
    assert len([line for line in lines if not line.startswith("#")]) == 1
    rj.save_cameras(tmp_path / "transforms.json", random_cameras(OPENCV))
    document = json.loads((tmp_path / "transforms.json").read_text())
    assert document["w"] == W
    assert all(set(frame) == {"file_path", "transform_matrix"} for frame in document["frames"])


def test_points_are_drawn_where_a_lens_projects_them(tmp_path):
    (made,) = random_cameras(BROWN, count=1, size=(160, 120), focals=(90.0, 100.0))
    rj.save_cameras(tmp_path / "one.yml", [made])
    (one,) = rj.load_cameras(tmp_path / "one.yml")
    point = made.camera.unproject((130.0, 95.0), 5.0, made.size)
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = [[a, b, c] for a in (0, 1) for b in (2, 3) for c in (4, 5)]
    ball = rj.Mesh(point + 0.2 * corners, faces)
    frame = rj.render(ball, one.camera, size=one.size, lens=one.lens, outputs="face_id", threads=1)
    rows, columns = np.nonzero(frame.face_id >= 0)
    seen = columns.mean() + 0.5, rows.mean() + 0.5
    assert seen == pytest.approx(made.project(point), abs=0.7)
    assert np.abs(made.project(point) - made.camera.project(point, made.size).pixels).max() > 2.0


# Examples by the documentation of each format; what they show is computed by hand

COLMAP_CAMERAS = """# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
7 SIMPLE_RADIAL 640 480 500 320 240 0.1
"""
COLMAP_IMAGES = f"""# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME
3 {math.sqrt(0.5)} {math.sqrt(0.5)} 0 0 0 0 2 7 left/a b.jpg
1.5 2.5 -1 7 8 12
4 1 0 0 0 0 0 4 7 right/b.jpg

"""


def write_model(folder, cameras=COLMAP_CAMERAS, images=COLMAP_IMAGES):
    (folder / "cameras.txt").write_text(cameras)
    (folder / "images.txt").write_text(images)
    return folder


def test_a_model_of_colmap(tmp_path):
    """A quarter turn about x, (x, y, z) to (x, -z, y): (0.4, 2, -0.2) is at (0.4, 0.2, 4)."""
    with pytest.warns(rj.LoadWarning, match=r"left out point that an image saw \(2\)"):
        turned, straight = rj.load_cameras(write_model(tmp_path))
    assert (turned.name, straight.name) == ("left/a b.jpg", "right/b.jpg")
    # u = 0.1, v = 0.05, r^2 = 0.0125; the factor is 1 + 0.1 r^2 = 1.00125.
    expected = 320 + 500 * 0.1 * 1.00125, 240 + 500 * 0.05 * 1.00125
    assert turned.project((0.4, 2.0, -0.2)) == pytest.approx(expected, abs=1e-9)
    assert straight.project((0.4, 0.2, 0.0)) == pytest.approx(expected, abs=1e-9)


def binary_model(folder, count=1, tail=b""):
    """Write a binary model, number by number: FULL_OPENCV, one image that saw one point."""
    cameras = struct.pack("<Q", 1) + struct.pack("<IiQQ", 9, 6, 640, 480)
    cameras += struct.pack("<12d", 500, 400, 320, 240, 0.1, 0, 0.01, 0.02, 0, 0.2, 0, 0)
    images = struct.pack("<Q", count) + struct.pack("<I4d3dI", 5, 1, 0, 0, 0, 0, 0, 4, 9)
    images += b"c.png\0" + struct.pack("<Qddq", 1, 7.5, 8.5, -1) + tail
    (folder / "cameras.bin").write_bytes(cameras)
    (folder / "images.bin").write_bytes(images)
    return folder


def test_a_binary_model_of_colmap_which_goes_before_text(tmp_path):
    with pytest.warns(rj.LoadWarning, match=r"point that an image saw \(1\)"):
        (one,) = rj.load_cameras(binary_model(write_model(tmp_path)))
    ratio = (1 + 0.1 * 0.0125) / (1 + 0.2 * 0.0125)
    u = 0.1 * ratio + 2 * 0.01 * 0.1 * 0.05 + 0.02 * (0.0125 + 2 * 0.01)
    v = 0.05 * ratio + 0.01 * (0.0125 + 2 * 0.0025) + 2 * 0.02 * 0.1 * 0.05
    expected = 320 + 500 * u, 240 + 400 * v
    assert one.project((0.4, 0.2, 0.0)) == pytest.approx(expected, abs=1e-9)
    assert one.name == "c.png"


AT_4 = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
"""World from camera, x right, y up, z back: at (0, 0, 4), looking at the origin."""


def write_json(path, **document):
    path.write_text(json.dumps(document))
    return path


def frame(name="a.png", pose=AT_4, **values):
    return {"file_path": name, "transform_matrix": pose, **values}


def test_transforms_of_nerfstudio(tmp_path):
    """(0.4, 0.2, 0) is at (0.4, 0.2, -4): u = 0.1 to the right, v = 0.05 up."""
    path = write_json(
        tmp_path / "transforms.json", camera_model="OPENCV", w=640, h=480, fl_x=500, fl_y=400,
        cx=330, cy=250, k1=0.1, k2=0, p1=0, p2=0, applied_transform=AT_4[:3],
        frames=[frame(depth_file_path="d.png"), frame("b.png", cx=10.0)],
    )  # fmt: skip
    with pytest.warns(rj.LoadWarning) as warned:
        one, other = rj.load_cameras(tmp_path)
    assert warned[0].message.left_out == {"applied_transform": 1, "depth_file_path": 1}
    assert str(path) in str(warned[0].message)
    expected = np.array([330 + 500 * 0.1 * 1.00125, 250 - 400 * 0.05 * 1.00125])
    assert one.project((0.4, 0.2, 0.0)) == pytest.approx(expected, abs=1e-9)
    assert other.project((0.4, 0.2, 0.0)) == pytest.approx(expected - (320, 0), abs=1e-9)
    assert (one.name, other.name) == ("a.png", "b.png")


def test_transforms_of_instant_ngp(tmp_path):
    """A point 45 degrees to the right is 100 pi / 4 (1 + 0.1 (pi / 4)^2) pixels from the middle."""
    path = write_json(
        tmp_path / "fisheye.json", is_fisheye=True, fl_x=100, w=640, h=480, k1=0.1,
        frames=[frame()],
    )  # fmt: skip
    (one,) = rj.load_cameras(path)
    angle = math.pi / 4
    expected = 320 + 100 * angle * (1 + 0.1 * angle**2), 240
    assert one.project((3.0, 0.0, 1.0)) == pytest.approx(expected, abs=1e-9)


def test_fields_of_view_of_instant_ngp(tmp_path):
    """90 degrees from top to bottom of 480 rows are a focal length of 240, of columns as well."""
    path = write_json(tmp_path / "t.json", y_fov=90, is_fisheye=True, k1=0, w=640, h=480,
                      frames=[frame(), frame(x_fov=60), frame(latlong=True)])  # fmt: skip
    with pytest.warns(rj.LoadWarning, match=r"without a lens here, latlong \(1\)"):
        one, other = rj.load_cameras(path)
    assert one.project((0.4, 0.2, 0.0)) == pytest.approx((344, 228), abs=1e-9)
    expected = 320 + 320 * math.sqrt(3) * 0.1, 228
    assert other.project((0.4, 0.2, 0.0)) == pytest.approx(expected, abs=1e-9)


def test_a_panorama_of_nerfstudio(tmp_path):
    """What is a quarter turn to the right is at three quarters of the width."""
    path = write_json(
        tmp_path / "t.json", camera_model="EQUIRECTANGULAR", fl_x=200, fl_y=200, cx=200, cy=100,
        w=400, h=200, frames=[frame()],
    )  # fmt: skip
    (one,) = rj.load_cameras(path)
    assert one.project((1.0, 0.0, 4.0)) == pytest.approx((300, 100), abs=1e-9)
    assert one.project((0.0, 1.0, 3.0)) == pytest.approx((200, 50), abs=1e-9)


def test_json_of_synthetic_scenes_made_with_blender(tmp_path):
    """At (0, -4, 0), z up: (0.5, 0, 0.25) is 0.5 right, 0.25 up, 4 away; the focal length is W."""
    pose = [[1, 0, 0, 0], [0, 0, -1, -4], [0, 1, 0, 0], [0, 0, 0, 1]]
    path = write_json(
        tmp_path / "transforms_train.json", camera_angle_x=2 * math.atan(0.5),
        frames=[frame("./train/r_0", pose, rotation=0.0125)],
    )  # fmt: skip
    with pytest.raises(
        ValueError, match=r"transforms_train\.json.*give size: .*r_0\.png' beside it is missing"
    ):
        rj.load_cameras(path)
    (tmp_path / "train").mkdir()
    Image.new("RGB", (800, 800)).save(tmp_path / "train/r_0.png")
    with pytest.warns(rj.LoadWarning, match="left out rotation"):
        (one,) = rj.load_cameras(path)
    assert (one.name, one.size) == ("./train/r_0.png", (800, 800))
    assert one.project((0.5, 0.0, 0.25)) == pytest.approx((500, 350), abs=1e-9)


@pytest.mark.parametrize("size", [(11000, 10000), (16000, 16000)])
def test_the_size_of_an_image_is_that_of_its_header_however_large(tmp_path, size):
    Image.new("L", (2, 2)).save(tmp_path / "a.png")
    content = bytearray((tmp_path / "a.png").read_bytes())
    content[16:24] = struct.pack(">2I", *size)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    (tmp_path / "a.png").write_bytes(content)
    path = write_json(tmp_path / "t.json", camera_angle_x=1.0, frames=[frame()])
    assert rj.load_cameras(path)[0].size == size


def test_images_are_opened_only_if_they_are_files_in_the_folder(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    Image.new("L", (8, 8)).save(tmp_path / "a.png")
    (folder / "b.png").write_text("no picture")
    cases = [("../a.png", "lies outside '[^;]*$"), (f"{tmp_path}/a.png", "is not a file beside")]
    cases.append(("b.png", "is no known picture"))
    if hasattr(os, "mkfifo"):
        os.mkfifo(folder / "c.png")
        # Whoever opened it to read would wait for one who writes.
        pipe = os.open(folder / "c.png", os.O_RDWR)
        os.write(pipe, (tmp_path / "a.png").read_bytes())
        cases.append(("c.png", "is no regular file"))
    for name, match in cases:
        path = write_json(folder / "t.json", camera_angle_x=1.0, frames=[frame(name)])
        with pytest.raises(
            ValueError, match=rf"t\.json.*give size: the file has none, and .*{match}"
        ):
            rj.load_cameras(path)
        assert rj.load_cameras(path, size=(64, 48))[0].size == (64, 48)
        (folder / "b.out").write_text(BUNDLE)
        (folder / "b.list.txt").write_text(f"{name}\nb.jpg\n")
        with pytest.raises(
            ValueError, match=rf"b\.out.*give size: the file has none, and .*{match}"
        ):
            rj.load_cameras(folder / "b.out")
    if hasattr(os, "mkfifo"):
        os.close(pipe)


BUNDLE = """# Bundle file v0.3
2 1
500 0.1 0
1 0 0
0 1 0
0 0 1
0 0 -4
0 0 0
0 0 0
0 0 0
0 0 0
0 0 0
0.1 0.2 0.3
255 0 10
1 0 17 -3.5 8.5
"""


def test_a_bundle(tmp_path):
    """P = X + t = (0.4, 0.2, -4); p = -P / P.z = (0.1, 0.05); from the middle, y up."""
    (tmp_path / "bundle.out").write_text(BUNDLE)
    (tmp_path / "list.txt").write_text("pictures/a.jpg 0 532.5\npictures/b.jpg\n")
    with pytest.warns(rj.LoadWarning) as warned:
        (one,) = rj.load_cameras(tmp_path / "bundle.out", size=SIZE)
    assert warned[0].message.left_out == {"point": 1, "camera without a pose": 1}
    assert one.name == "pictures/a.jpg"
    expected = 320 + 500 * 0.1 * 1.00125, 240 - 500 * 0.05 * 1.00125
    assert one.project((0.4, 0.2, 0.0)) == pytest.approx(expected, abs=1e-9)


def matrix(rows, columns, *data):
    return (
        f"!!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: {list(data)}\n"
    )


K = matrix(3, 3, 500.0, 0.0, 319.5, 0.0, 400.0, 239.5, 0.0, 0.0, 1.0)
OPENCV_FILE = (
    "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n"
    f"camera_matrix: {K}distortion_coefficients: {matrix(5, 1, 0.1, 0.0, 0.01, 0.02, 0.0)}"
)


def test_a_calibration_of_opencv(tmp_path):
    """As of COLMAP, at (0.4, 0.2, 4); the centre of the first pixel is at 0."""
    views = matrix(2, 6, math.pi / 2, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4.0)
    text = f"{OPENCV_FILE}extrinsic_parameters: {views}avg_reprojection_error: 0.25\n"
    (tmp_path / "a.yml").write_text(text)
    with pytest.warns(rj.LoadWarning, match="left out avg_reprojection_error"):
        turned, straight = rj.load_cameras(tmp_path / "a.yml")
    u = 0.1 * 1.00125 + 2 * 0.01 * 0.005 + 0.02 * (0.0125 + 2 * 0.01)
    v = 0.05 * 1.00125 + 0.01 * (0.0125 + 2 * 0.0025) + 2 * 0.02 * 0.005
    expected = 500 * u + 319.5 + 0.5, 400 * v + 239.5 + 0.5
    assert turned.project((0.4, 2.0, -0.2)) == pytest.approx(expected, abs=1e-9)
    assert straight.project((0.4, 0.2, 0.0)) == pytest.approx(expected, abs=1e-9)


def test_a_calibration_of_opencv_2(tmp_path):
    old = {"image_width": "image_Width", "image_height": "image_Height",
           "camera_matrix": "Camera_Matrix",
           "distortion_coefficients": "Distortion_Coefficients"}  # fmt: skip
    text = OPENCV_FILE.replace("---\n", "")
    for new, name in old.items():
        text = text.replace(new, name)
    (tmp_path / "new.yml").write_text(OPENCV_FILE)
    (tmp_path / "old.yml").write_text(text)
    (one,), (other,) = (rj.load_cameras(tmp_path / name) for name in ("old.yml", "new.yml"))
    assert (one.size, one.lens) == (other.size, other.lens)
    assert one.project((0.4, 0.2, 4.0)) == pytest.approx(other.project((0.4, 0.2, 4.0)))


TURN = matrix(3, 3, *np.eye(3).ravel().tolist())


def stereo(turn, move):
    return f"imageSize: [640, 480]\nM1: {K}M2: {K}R: {turn}T: {move}"


@pytest.mark.parametrize("parts", [1, 2])
def test_a_stereo_pair_of_opencv(tmp_path, parts):
    """The second camera is 0.1 to the right of the first: what is 2 ahead moves 25 pixels left."""
    none = matrix(1, 5, *[0.0] * 5)
    inner = f"%YAML:1.0\n---\nM1: {K}D1: {none}M2: {K}D2: {none}"
    outer = f"R: {TURN}T: {matrix(3, 1, -0.1, 0.0, 0.0)}"
    if parts == 2:
        (tmp_path / "extrinsics.yml").write_text(f"%YAML:1.0\n---\n{outer}")
    (tmp_path / "intrinsics.yml").write_text(inner + outer * (parts == 1))
    left, right = rj.load_cameras(tmp_path / "intrinsics.yml", size=SIZE)
    assert left.project((0.0, 0.0, 2.0)) == pytest.approx((320, 240), abs=1e-9)
    assert right.project((0.0, 0.0, 2.0)) == pytest.approx((295, 240), abs=1e-9)
    name = "extrinsics.yml" if parts == 2 else "intrinsics.yml"
    (tmp_path / name).write_text((tmp_path / name).read_text().replace("T: ", "t: "))
    with pytest.raises(ValueError, match=rf"{name} could not be read as OpenCV's YAML: T must be"):
        rj.load_cameras(tmp_path / "intrinsics.yml", size=SIZE)


def test_a_camera_of_ros(tmp_path):
    text = OPENCV_FILE.replace("!!opencv-matrix", "").replace(
        "%YAML:1.0\n---\n", "camera_name: head\n"
    )
    text = text.replace("0.1, 0.0, 0.01, 0.02, 0.0", "1e-1, 0, 0, 0").replace("rows: 5", "rows: 4")
    (tmp_path / "head.yaml").write_text(f"{text}distortion_model: equidistant\n")
    (one,) = rj.load_cameras(tmp_path / "head.yaml")
    assert (one.name, one.lens) == ("head", rj.FisheyeLens(0.1))


CHAIN = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [0.1, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [500.0, 400.0, 319.5, 239.5]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  timeshift_cam_imu: 0.01
  camera_model: pinhole
  distortion_coeffs: [0.2, 0.0, 0.0, 0.0]
  distortion_model: equidistant
  intrinsics: [500.0, 400.0, 319.5, 239.5]
  resolution: [640, 480]
  rostopic: /cam1/image_raw
cam2:
  T_cn_cnm1: [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  camera_model: pinhole
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [500.0, 400.0, 319.5, 239.5]
  resolution: [640, 480]
"""


def test_a_chain_of_kalibr(tmp_path):
    """Each camera is 0.1 to the right of the one before it, and looks the same way."""
    (tmp_path / "camchain.yaml").write_text(CHAIN)
    with pytest.warns(rj.LoadWarning, match="left out timeshift_cam_imu"):
        first, second, third = rj.load_cameras(tmp_path / "camchain.yaml")
    assert [one.name for one in (first, second, third)] == [
        "/cam0/image_raw", "/cam1/image_raw", "cam2",
    ]  # fmt: skip
    assert first.project((0.2, 0.0, 2.0)) == pytest.approx((320 + 500 * 0.1 * 1.001, 240), abs=1e-9)
    angle = math.atan(0.05)
    expected = 320 + 500 * angle * (1 + 0.2 * angle**2), 240
    assert second.project((0.2, 0.0, 2.0)) == pytest.approx(expected, abs=1e-9)
    assert third.project((0.2, 0.1, 2.0)) == pytest.approx((320, 260), abs=1e-9)


# Beside other programs


NAME = 'größe \\ 猫 "🦆".png'


@pytest.mark.parametrize("name", ["camchain.yaml", "a.yml"])
def test_numbers_and_names_of_ours_are_those_of_plain_yaml(tmp_path, name):
    (one,) = random_cameras(rj.PinholeDistortion(1e-5, -2e-16, 2.5e-7), count=1, at=AS_OPENCV)
    rj.save_cameras(tmp_path / name, [dataclasses.replace(one, name=NAME)])
    text = (tmp_path / name).read_text("utf-8").replace("%YAML:1.0", "").replace("!!opencv-", "!")
    loader = type("Loader", (yaml.SafeLoader,), {})
    loader.add_constructor("!matrix", lambda loader, node: loader.construct_mapping(node, True))
    document = yaml.load(text, loader)
    if name == "a.yml":
        found = document["distortion_coefficients"]["data"][:4], document["image_names"][0]
    else:
        found = document["cam0"]["distortion_coeffs"], document["cam0"]["rostopic"]
    assert found == ([1e-5, -2e-16, 2.5e-7, 0.0], NAME)
    for wrong in ("\x7f", "\0", "\ud83e"):
        with pytest.raises(ValueError, match=r"camera 'a.*': its name must have no '\\"):
            rj.save_cameras(tmp_path / name, [dataclasses.replace(one, name=f"a{wrong}")])


def test_opencv_reads_ours_and_we_read_its(tmp_path):
    cv2 = pytest.importorskip("cv2")
    ours = random_cameras(ALL)
    ours[0] = dataclasses.replace(ours[0], name=NAME)
    rj.save_cameras(tmp_path / "ours.yml", ours)
    assert rj.load_cameras(tmp_path / "ours.yml")[0].name == NAME
    storage = cv2.FileStorage(str(tmp_path / "ours.yml"), cv2.FILE_STORAGE_READ)
    k, distortion, views = (
        storage.getNode(key).mat()
        for key in ("camera_matrix", "distortion_coefficients", "extrinsic_parameters")
    )
    assert (storage.getNode("image_width").real(), storage.getNode("image_names").size()) == (W, 3)
    assert storage.getNode("image_names").at(0).string() == NAME
    for one, view in zip(ours, views, strict=True):
        expected, _ = cv2.projectPoints(POINTS, view[:3], view[3:], k, distortion)
        np.testing.assert_allclose(one.project(POINTS), expected[:, 0] + 0.5, rtol=0, atol=1e-9)
    storage = cv2.FileStorage(str(tmp_path / "its.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", W)
    storage.write("image_height", H)
    storage.write("camera_matrix", k)
    storage.write("distortion_coefficients", distortion)
    storage.write("extrinsic_parameters", views)
    storage.release()
    for one, made in zip(rj.load_cameras(tmp_path / "its.yml"), ours, strict=True):
        np.testing.assert_allclose(one.project(POINTS), made.project(POINTS), rtol=0, atol=1e-9)


def pose_of(image):
    """Return COLMAP's camera from world, (3, 4), of an image: a method since 3.12."""
    pose = image.cam_from_world
    return (pose() if callable(pose) else pose).matrix()


@pytest.mark.parametrize("suffix", [".bin", ".txt"])
@pytest.mark.parametrize("lens", [None, OPENCV, RATIONAL, FISHEYE])
def test_colmap_reads_ours(tmp_path, lens, suffix):
    pycolmap = pytest.importorskip("pycolmap")
    ours = random_cameras(lens)
    rj.save_cameras(tmp_path / f"cameras{suffix}", ours)
    model = pycolmap.Reconstruction(str(tmp_path))
    images = {image.name: image for image in model.images.values()}
    for one in ours:
        image = images[one.name]
        places = np.c_[POINTS, np.ones(len(POINTS))] @ pose_of(image).T
        expected = model.cameras[image.camera_id].img_from_cam(places)
        np.testing.assert_allclose(one.project(POINTS), expected, rtol=0, atol=1e-9)


WITH_LENS = {
    "SIMPLE_PINHOLE": [500, 300, 250],
    "PINHOLE": [500, 520, 300, 250],
    "SIMPLE_RADIAL": [500, 300, 250, -0.1],
    "RADIAL": [500, 300, 250, -0.1, 0.02],
    "OPENCV": [500, 520, 300, 250, -0.1, 0.02, 1e-3, 2e-3],
    "OPENCV_FISHEYE": [500, 520, 300, 250, -0.1, 0.02, 1e-3, 2e-3],
    "FULL_OPENCV": [500, 520, 300, 250, 0.1, 0.02, 1e-3, 2e-3, 0.01, 0.2, 0.03, 1e-3],
    "FOV": [500, 520, 300, 250, 0],
    "SIMPLE_RADIAL_FISHEYE": [500, 300, 250, -0.1],
    "RADIAL_FISHEYE": [500, 300, 250, -0.1, 0.02],
    "THIN_PRISM_FISHEYE": [500, 520, 300, 250, -0.1, 0.02, 0, 0, 1e-3, 2e-3, 0, 0],
    "RAD_TAN_THIN_PRISM_FISHEYE": [500, 520, 300, 250, -0.1, 0.02, 1e-3, 2e-3, *[0] * 8],
    "SIMPLE_DIVISION": [500, 300, 250, 0],
    "DIVISION": [500, 520, 300, 250, 0],
    "SIMPLE_FISHEYE": [500, 300, 250],
    "FISHEYE": [500, 520, 300, 250],
    "EQUIRECTANGULAR": [640, 320],
}
"""Parameters of each model that a lens here stands for."""


@pytest.mark.parametrize("name", WITH_LENS)
def test_models_of_colmap_project_as_ours(name):
    pycolmap = pytest.importorskip("pycolmap")
    parameters = tuple(map(float, WITH_LENS[name]))
    size = (640, 320) if name == "EQUIRECTANGULAR" else SIZE
    camera = pycolmap.Camera(model=name, width=size[0], height=size[1], params=parameters)
    assert int(camera.model.value) == colmap.MODELS[name].number
    assert len(parameters) == colmap.MODELS[name].parameter_count
    intrinsics = colmap.read_intrinsics(name, size, parameters)
    (made,) = random_cameras(intrinsics.lens, count=1, size=size, at=AS_OPENCV,
                             focals=intrinsics[1:3], center=intrinsics[4:6])  # fmt: skip
    places = np.c_[POINTS[:, :2], np.abs(POINTS[:, 2]) + 1.0]
    expected = camera.img_from_cam(places)
    np.testing.assert_allclose(made.project(places), expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("suffix", [".bin", ".txt"])
def test_we_read_what_colmap_writes(tmp_path, suffix):
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        camera_id=1, model="OPENCV", width=W, height=H, params=WITH_LENS["OPENCV"]
    )
    model.add_camera_with_trivial_rig(camera)
    ours = random_cameras(OPENCV)
    for number, one in enumerate(ours, 1):
        pose = rj.cameras.to_opencv(one.camera, SIZE).camera_from_world
        image = pycolmap.Image(name=one.name, camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
    write = model.write_binary if suffix == ".bin" else model.write_text
    write(str(tmp_path))
    found = {one.name: one for one in rj.load_cameras(tmp_path)}
    for image in model.images.values():
        places = np.c_[POINTS, np.ones(len(POINTS))] @ pose_of(image).T
        expected = camera.img_from_cam(places)
        np.testing.assert_allclose(found[image.name].project(POINTS), expected, rtol=0, atol=1e-8)


# What is left out, refused or damaged


def test_models_without_a_lens_are_left_out(tmp_path):
    cameras = "7 SIMPLE_RADIAL 640 480 500 320 240 0.1\n8 FOV 640 480 500 500 320 240 0.9\n"
    images = "1 1 0 0 0 0 0 4 7 a.png\n\n2 1 0 0 0 0 0 4 8 b.png\n\n"
    with pytest.warns(rj.LoadWarning, match=r"without a lens here, FOV with omega = 0\.9 \(1\)"):
        (one,) = rj.load_cameras(write_model(tmp_path, cameras, images))
    assert one.name == "a.png"
    write_model(tmp_path, cameras, "2 1 0 0 0 0 0 4 8 b.png\n\n")
    with pytest.raises(ValueError, match=r"images\.txt.*no camera but what is left out.*omega"):
        rj.load_cameras(tmp_path)


def test_models_of_other_files_without_a_lens_are_left_out(tmp_path):
    path = write_json(
        tmp_path / "t.json", fl_x=500, w=640, h=480,
        frames=[frame(), frame(camera_model="FISHEYE624"), frame(k4=0.1)],
    )  # fmt: skip
    with pytest.warns(rj.LoadWarning, match=r"FISHEYE624' \(1\).*k4, of the eighth power, = 0\.1"):
        assert len(rj.load_cameras(path)) == 1
    chain = CHAIN.replace("pinhole", "omni", 1).replace("  timeshift_cam_imu: 0.01\n", "")
    chain = chain.replace("equidistant", "[1]")
    (tmp_path / "camchain.yaml").write_text(chain)
    with pytest.warns(rj.LoadWarning, match=r"a lens here, .*'omni'.*distortion_model \[1\]"):
        (third,) = rj.load_cameras(tmp_path / "camchain.yaml")
    assert third.project((0.2, 0.1, 2.0)) == pytest.approx((320, 260), abs=1e-9)


TIGHT = rj.FisheyeLens(0.02, fov=180.0)
CANNOT_HOLD = [
    ("colmap", ALL, {}, "lens must have no coefficients but k1, .*COLMAP, got s1 = 0.001"),
    ("colmap", TIGHT, {}, r"got fov = 180\.0"),
    ("nerfstudio", RATIONAL, {}, "got k4 = 0.3"),
    ("nerfstudio", TIGHT, {}, r"got fov = 180\.0"),
    ("blender", None, {}, "square pixels.*Blender"),
    ("blender", RADIAL, CENTERED, "no lens for Blender"),
    ("bundler", None, {}, "principal point in the middle.*Bundler"),
    ("bundler", OPENCV, CENTERED, "got p1 = 0.001"),
    ("bundler", FISHEYE, CENTERED, "for Bundler, got k3"),
    ("opencv", TIGHT, {}, r"camera 'images/0.png': lens .*got fov = 180\.0"),
    ("opencv", PANORAMA, {"size": (640, 320)}, "lens must be none or of OpenCV's"),
    ("opencv", [None, FISHEYE], {}, "camera 'images/1.png': it must have a lens as others"),
    ("opencv", [None, OPENCV, None], {}, "the same intrinsics, or be two, for .*, got 3"),
    ("opencv", [None, OPENCV], {}, "must be where the world's origin is"),
    ("nerfstudio", [OPENCV, FISHEYE], {}, "lenses of one model .*, got OPENCV, OPENCV_FISHEYE"),
    ("kalibr", BROWN, {"at": AS_OPENCV}, "got k3 = 0.004"),
    ("kalibr", OPENCV, {}, "must be where the world's origin is"),
]


@pytest.mark.parametrize(("file_format", "lens", "made", "match"), CANNOT_HOLD)
def test_what_a_format_cannot_hold_is_refused(tmp_path, file_format, lens, made, match):
    lenses = lens if isinstance(lens, list) else [lens] * 2
    made = random_cameras(count=len(lenses), **made)
    cameras = [dataclasses.replace(one, lens=own) for one, own in zip(made, lenses, strict=True)]
    with pytest.raises(ValueError, match=match):
        rj.save_cameras(tmp_path / "out", cameras, format=file_format)
    assert not list(tmp_path.iterdir())


def test_names_that_a_format_cannot_hold_are_refused(tmp_path):
    (one,) = random_cameras(count=1, **CENTERED)
    for name, file_format, match in (
        ("", "colmap", "must have the name of its image"),
        ("", "nerfstudio", "must have the name of its image"),
        ("a b.png", "colmap-text", "without spaces"),
        ("a b.png", "bundler", "without spaces"),
        ("a\udcff.png", "colmap", r"camera 'a\\udcff\.png': its name must be"),
        ("a\udcff.png", "colmap-text", "its name must be"),
        ("a\udcff.png", "bundler", "its name must be"),
        ("a.jpg", "blender", r"an image \.png"),
        ("a.b.png", "blender", "one suffix"),
    ):
        camera = dataclasses.replace(one, name=name)
        with pytest.raises(ValueError, match=match):
            rj.save_cameras(tmp_path / "out", [camera], format=file_format)
    assert not list(tmp_path.iterdir())


def test_skew_is_held_by_opencv_alone(tmp_path):
    k = [[500.0, 3.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]
    one = rj.CalibratedCamera(rj.cameras.from_opencv(k, SIZE), SIZE, OPENCV, "a.png")
    rj.save_cameras(tmp_path / "a.yml", [one])
    (found,) = rj.load_cameras(tmp_path / "a.yml")
    places = np.c_[POINTS[:, :2], np.abs(POINTS[:, 2]) + 1.0]
    np.testing.assert_allclose(found.project(places), one.project(places), rtol=0, atol=1e-9)
    for file_format in ("colmap", "nerfstudio", "kalibr"):
        with pytest.raises(ValueError, match=r"camera 'a\.png': it must have no skew"):
            rj.save_cameras(tmp_path / "out", [one], format=file_format)


def test_a_model_does_not_replace_another(tmp_path):
    cameras = random_cameras()
    rj.save_cameras(tmp_path, cameras)
    rj.save_cameras(tmp_path, cameras)
    with pytest.raises(ValueError, match=r"without cameras\.bin"):
        rj.save_cameras(tmp_path, cameras, format="colmap-text")
    (tmp_path / "points3D.bin").write_bytes(struct.pack("<Q", 1) + bytes(43))
    with pytest.raises(ValueError, match=r"points3D\.bin holds some"):
        rj.save_cameras(tmp_path, cameras)


BOMB = "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}' if n else '1'] * 9)}]\n" for n in range(9))
"""Nine lists, each of nine times the one before it."""

MIRRORED = np.diag([1, 1, -1, 1]).tolist()

BROKEN = [
    ("cameras.txt", "1 PINHOLE 640 480 500 500 320", "PINHOLE must have 4 parameters, got 3"),
    ("cameras.txt", "1 PINHOLE 640", "must have a number, a model and a size"),
    ("cameras.txt", "1 MAGIC 640 480 1", "one of COLMAP's, got MAGIC"),
    ("cameras.txt", "1 PINHOLE 640 480 500 nan 320 240", "PINHOLE must have finite parameters"),
    ("cameras.txt", "7 PINHOLE 640 480 500 0 320 240", "focal lengths must be above 0"),
    ("cameras.txt", COLMAP_CAMERAS * 2, "got two of number 7"),
    ("images.txt", "1 1 0 0 0 0 0 4 7\n\n", "an image must have a number"),
    ("images.txt", "1 1 0 0 0 0 0 4 8 a.png\n\n", "'a.png' names camera 8, which is missing"),
    ("images.txt", "1 0 0 0 0 0 0 4 7 a.png\n\n", "'a.png'.*quaternion"),
    ("images.txt", "1 1 0 0 0 0 0 inf 7 a.png\n\n", "'a.png'.*finite"),
    ("images.txt", "1 1 0 0 0 0 0 4 7 a.png\n1 2\n", "points must have 3 numbers each, got 2"),
    ("images.txt", "", "no camera"),
    ("t.json", "{", "Expecting"),
    ("t.json", "[]", "frames is missing"),
    ("t.json", '{"frames": []}', "no camera"),
    ("t.json", '{"frames": [{"file_path": "a"}], "w": 6, "h": 4}', "frame 0.*matrix must have 4"),
    ("t.json", json.dumps({"w": 6, "h": 4, "frames": [frame()]}), "frame 0: fl_x or camera_angle"),
    ("t.json", json.dumps({"w": 6, "frames": [frame()]}), "frame 0: h is missing"),
    ("t.json", json.dumps({"w": 6, "h": 4, "fl_x": math.nan, "frames": [frame()]}), "fl_x.*finite"),
    ("t.json", json.dumps({"w": 6, "h": 4, "fl_x": 5, "frames": [frame(pose=MIRRORED)]}),
     "frame 0: transform_matrix must hold a rotation"),
    ("t.json", json.dumps({"w": 6, "h": 0, "frames": [frame()]}), "frame 0: w and h must be"),
    ("t.json", json.dumps({"w": 6, "h": 4, "camera_angle_x": 4, "frames": [frame()]}),
     "frame 0: camera_angle_x must be above 0"),
    ("t.json", json.dumps({"w": 6, "h": 4, "y_fov": 0, "frames": [frame()]}), "0: y_fov must be"),
    ("b.out", "hello", "its first line must be"),
    ("b.out", BUNDLE.replace("2 1", "3 1"), "must have 3 cameras, got 41 numbers"),
    ("b.out", BUNDLE.replace("2 1", "9 1"), "must have 9 cameras"),
    ("b.out", BUNDLE.replace("2 1", "2 -1"), "must have 2 cameras"),
    ("b.out", BUNDLE.replace("1 0 17", "-9 0 17"), "4 numbers more"),
    ("b.out", BUNDLE.replace("2 1", "2 2"), "it ends at point 1 of 2"),
    ("b.out", BUNDLE + "1", "1 numbers more"),
    ("b.out", BUNDLE.replace("500", "nan"), "camera 0: its numbers must be finite"),
    ("b.out", BUNDLE.replace("500", "many"), "many"),
    ("o.yml", OPENCV_FILE.replace("rows: 3", "rows: 2"), "camera_matrix: data must have shape"),
    ("o.yml", OPENCV_FILE.replace("500.0", ".Nan"), "camera_matrix: data must be"),
    ("o.yml", OPENCV_FILE.replace("500.0", "-500.0"), "focal lengths above 0"),
    ("o.yml", OPENCV_FILE.replace("image_height: 480\n", ""), "image_height is missing"),
    ("o.yml", OPENCV_FILE.replace("camera_matrix", "matrix"), "camera_matrix must be a matrix"),
    ("o.yml", OPENCV_FILE.replace("480", "0"), "image_width and image_height must be"),
    ("o.yml", "imageSize: [3]", r"imageSize must be \(width, height\)"),
    ("o.yml", stereo(TURN, matrix(1, 1, 5)), r"T must have 3 numbers, got shape \(1, 1\)"),
    ("o.yml", stereo(TURN, matrix(4, 1, 5, 0, 0, 1)), "T must have 3 numbers"),
    ("o.yml", stereo(matrix(1, 1, 1), matrix(3, 1, 5, 0, 0)), r"R must have shape \(3, 3\)"),
    ("o.yml", OPENCV_FILE + "fisheye_model: 1\n", "must be 4 numbers, got 5"),
    ("o.yml", "image_width: [1", "while parsing"),
    ("o.yml", "x: !!timestamp 5", "its values must be of their tags"),
    ("o.yml", "x: !!bool 5", "its values must be of their tags"),
    ("o.yml", "- 1", "keys and values"),
    ("o.yml", "a: &a [*a]", "at most 10000000 values"),
    ("o.yml", BOMB, "at most 10000000 values"),
    ("o.yml", "[" * 3000, "recursion"),
    ("camchain.yaml", CHAIN.replace("  T_cn_cnm1:\n", "  T:\n"), "cam1: T_cn_cnm1 is missing"),
    ("camchain.yaml", CHAIN.replace("[640, 480]", "[640]"), "cam0: resolution must be"),
    ("camchain.yaml", CHAIN.replace("239.5", "no"), "cam0: intrinsics must be 4 finite"),
    ("camchain.yaml", "cam0: 1", "cam0: it must have keys"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "match"), BROKEN)
def test_damaged_files_are_named(tmp_path, name, text, match):
    if name in ("cameras.txt", "images.txt"):
        write_model(tmp_path)
    (tmp_path / name).write_text(text)
    named = "images.txt" if "focal" in match and name == "cameras.txt" else name
    with pytest.raises(ValueError, match=rf"{re.escape(named)}(.|\n)*{match}"):
        rj.load_cameras(tmp_path / name, size=SIZE if name == "b.out" else None)


@pytest.mark.parametrize("cut", [1, 8, 25, 60, 87])
@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_truncated_models_are_named(tmp_path, name, cut):
    file = binary_model(tmp_path) / name
    file.write_bytes(file.read_bytes()[:-cut])
    with pytest.raises(ValueError, match=rf"{name}.*ends after"):
        rj.load_cameras(tmp_path)


def test_wrong_counts_of_models_are_named(tmp_path):
    with pytest.raises(ValueError, match=r"images\.bin.*ends after"):
        rj.load_cameras(binary_model(tmp_path, count=2))
    with pytest.raises(ValueError, match=r"images\.bin.*3 bytes more than it counts"):
        rj.load_cameras(binary_model(tmp_path, tail=b"abc"))


def test_what_is_no_file_of_cameras_is_refused(tmp_path):
    for name in ("missing.json", "model"):
        with pytest.raises(ValueError, match=f"{name} does not exist"):
            rj.load_cameras(tmp_path / name)
    (tmp_path / "a.obj").write_text("v 1 2 3")
    with pytest.raises(ValueError, match=r"path must be a folder of COLMAP's.*a\.obj"):
        rj.load_cameras(tmp_path / "a.obj")
    with pytest.raises(ValueError, match="holds none of them"):
        rj.load_cameras(tmp_path)
    (tmp_path / "cameras.txt").write_text(COLMAP_CAMERAS)
    with pytest.raises(ValueError, match=r"images\.txt is missing"):
        rj.load_cameras(tmp_path)
    with pytest.raises(ValueError, match="path must be"):
        rj.save_cameras(tmp_path / "a.obj", random_cameras())
    with pytest.raises(ValueError, match="cameras must not be empty"):
        rj.save_cameras(tmp_path / "a.json", [])
    with pytest.raises(ValueError, match="of type CalibratedCamera, got PerspectiveCamera"):
        rj.save_cameras(tmp_path / "a.json", [rj.PerspectiveCamera((0, 0, 4), (0, 0, 0))])
    with pytest.raises(ValueError, match="format must be"):
        rj.save_cameras(tmp_path / "a.json", random_cameras(), format="nerf")


def test_what_a_data_set_writes_is_read(tmp_path):
    from rasterjit.dataset import Recipe, render_views, view_cameras

    scene = rj.Scene()
    scene.add(rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]], [[0, 1, 2]]))
    recipe = Recipe(views=3, outputs=("color",), size=(32, 24))
    render_views(scene, tmp_path, recipe)
    with pytest.warns(rj.LoadWarning, match="left out .*offset"):
        found = rj.load_cameras(tmp_path)
    for one, made in zip(found, view_cameras(scene, recipe, ""), strict=True):
        expected = made.project(POINTS, recipe.size).pixels
        np.testing.assert_allclose(one.project(POINTS), expected, rtol=0, atol=1e-9)
        assert (tmp_path / one.name).exists()
