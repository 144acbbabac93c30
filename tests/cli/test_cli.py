import dataclasses
import json
import struct
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import click
import imageio.v3 as iio
import imageio_ffmpeg
import numpy as np
import pytest
from click.testing import CliRunner
from opengl import optional_module
from PIL import Image, ImageSequence

import rasterjit as rj
from rasterjit.cli import commands, help, option_types, report, warmup
from rasterjit.cli.option_types import LIGHT_NAMES
from rasterjit.cli.options import DEFAULT_DIRECTION, OUTPUTS_HELP, CameraOptions
from rasterjit.inspect import profile
from rasterjit.outputs import output_table
from rasterjit.pipeline.visibility import visibility_pass as drawing
from rasterjit.runtime import background_compile, jit, progress, store
from rasterjit.scene.camera_fitting import zoom_camera

MODELS = Path(__file__).parents[2] / "models"
CUBE = str(MODELS / "cube.ply")
KNOT = str(MODELS / "torus_knot.obj")
OUTPUTS = tuple(name for name in output_table.OUTPUTS if name not in output_table.MOTION_OUTPUTS)
SIZE = (48, 36)
SMALL = ("--size", "48x36", "--quiet")

needs_store = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="nothing is kept")

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


PLAIN = {"render": {"style": "plain"}, "explain": {"style": "plain"}}
"""The style in which the command line draws what the library draws."""


def run(*arguments, defaults=PLAIN):
    words = [str(argument) for argument in arguments]
    return CliRunner().invoke(commands.program, words, default_map=defaults)


def render(tmp_path, *options, file=CUBE):
    """Render a small picture that must succeed silently; return its pixels."""
    path = tmp_path / "out.png"
    result = run("render", file, "-o", path, *SMALL, *options)
    assert (result.exit_code, result.output) == (0, "")
    return iio.imread(path)


def rendered(camera=None, file=CUBE, scene=None, **options):
    """Render the same with the library."""
    return rj.render(rj.load(file) if scene is None else scene, camera, size=SIZE, **options)


def assert_one_line(result, *codes):
    assert result.exit_code in codes
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert "Traceback" not in result.output


def write(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return path


# Render


def test_a_file_becomes_a_picture_of_the_default_size(tmp_path):
    result = run("render", MODELS / "teapot.obj", "-o", tmp_path / "t.png")
    assert result.exit_code == 0, result.output
    picture = iio.imread(tmp_path / "t.png")
    assert picture.shape == (720, 1280, 4)
    assert (picture[:, :, :3].min(axis=2) < 250).mean() > 0.05
    assert [path.name for path in tmp_path.iterdir()] == ["t.png"]


def test_the_command_line_draws_what_the_library_draws(tmp_path):
    assert np.array_equal(render(tmp_path), rendered().color)


def test_the_table_accounts_for_every_triangle_and_stage(tmp_path):
    options = ("--size", "48x36", "--cull", "back", "--stats")
    result = run("render", CUBE, "-o", tmp_path / "t.png", *options)
    stats = rendered(cull="back").stats
    cells = {
        row[0].strip(): row[1].strip()
        for row in (line.strip("│").split("│") for line in result.stdout.splitlines())
        if len(row) == 2
    }
    shown = [
        "triangles in", "outside the view", "turned away", "without area",
        "between pixel centres", "invalid", "drawn", "clipped",
    ]  # fmt: skip
    counts = [
        stats.triangles_in, stats.outside, stats.culled, stats.degenerate,
        stats.unsampled, stats.invalid, stats.drawn, stats.clipped,
    ]  # fmt: skip
    assert [int(cells[name]) for name in shown] == counts
    assert cells["pixels covered"].startswith(f"{stats.pixels_covered} ")
    assert {"load", "compile, or load compiled", "visibility", "save", "total"} <= set(cells)
    assert f"wrote {tmp_path / 't.png'}  48x36  12 triangles" in result.stdout


def test_position_and_target_place_the_camera(tmp_path):
    camera = rj.PerspectiveCamera((2, 3, 5), (0, 0, 0), (0, 0, 1), fov_y=40.0)
    options = ("--position", "2,3,5", "--target", "0,0,0", "--up", "0,0,1", "--fov", 40)
    assert np.array_equal(render(tmp_path, *options), rendered(camera).color)


def test_a_placed_camera_looks_at_the_middle_unless_told(tmp_path):
    center, _ = rj.load(CUBE).bounding_sphere()
    camera = rj.PerspectiveCamera((-4, 1, 2), center)
    assert np.array_equal(render(tmp_path, "--position", "-4,1,2"), rendered(camera).color)


@pytest.mark.parametrize("eye", ["0,0,0", "0.5,0.4,0.3", "1000,0,1"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_placed_camera_cuts_nothing_off_that_it_sees(tmp_path, eye, projection):
    target = ("--target", "0.3,-7,2", "--projection", projection)
    picture = render(tmp_path, "--position", eye, *target, "--background", "transparent")
    assert picture[:, :, 3].any() or eye == "1000,0,1"


def test_azimuth_elevation_and_zoom_orbit_the_fitted_camera(tmp_path):
    scene = rj.load(CUBE)
    camera = rj.fit_camera(
        scene, rj.orbit_direction(120.0, 35.0), 30.0, zoom=1.5, aspect=SIZE[0] / SIZE[1]
    )
    options = ("--azimuth", 120, "--elevation", 35, "--zoom", 1.5, "--fov", 30)
    assert np.array_equal(render(tmp_path, *options), rendered(camera).color)


def test_zoom_keeps_the_camera_of_a_file(tmp_path):
    file = MODELS / "scene.glb"
    own = rj.load(file).camera
    fov = 2.0 * np.degrees(np.arctan(np.tan(np.radians(own.fov_y) / 2.0) / 2.0))
    with_zoom = render(tmp_path, "--zoom", 2, file=file)
    nearer = rendered(dataclasses.replace(own, fov_y=fov), file).color
    assert (with_zoom != nearer).mean() < 1e-3
    # Another option for the camera fits one to the scene.
    fitted = render(tmp_path, "--zoom", 2, "--azimuth", 31, file=file)
    assert not np.array_equal(with_zoom, fitted)


def test_a_field_of_view_and_intrinsics_keep_the_place_of_the_camera_of_a_file(tmp_path):
    file = MODELS / "scene.glb"
    own = rj.load(file).camera
    wider = dataclasses.replace(own, fov_y=70.0)
    assert np.array_equal(render(tmp_path, "--fov", 70, file=file), rendered(wider, file).color)
    both = render(tmp_path, "--fov", 70, "--zoom", 2, file=file)
    assert np.array_equal(both, rendered(zoom_camera(wider, 2.0), file).color)
    focal = SIZE[1] / 2.0 / np.tan(np.radians(35.0))
    k = f"{focal},{focal},{(SIZE[0] - 1) / 2},{(SIZE[1] - 1) / 2}"
    calibrated = render(tmp_path, "--intrinsics", k, file=file)
    assert np.abs(calibrated.astype(int) - rendered(wider, file).color).mean() < 0.2
    # Another option for the camera fits one to the scene.
    fitted = rj.fit_camera(rj.load(file), fov_y=70.0, aspect=SIZE[0] / SIZE[1])
    told = render(tmp_path, "--fov", 70, "--projection", "perspective", file=file)
    assert np.array_equal(told, rendered(fitted, file).color)


def test_a_camera_without_a_field_of_view_is_not_given_one(tmp_path):
    scene = rj.load(CUBE)
    scene.nodes[0].mesh.material = rj.Material(shading="pbr")
    scene.camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0)
    scene.save(tmp_path / "flat.glb")
    result = run("render", tmp_path / "flat.glb", "-o", tmp_path / "a.png", *SMALL, "--fov", 40)
    assert_one_line(result, 2)
    assert "--fov: the file's camera has no field of view: use --zoom" in result.stderr
    assert not (tmp_path / "a.png").exists()
    render(tmp_path, "--fov", 40, "--projection", "perspective", file=tmp_path / "flat.glb")


def test_zoom_enlarges_about_the_middle_of_every_kind_of_camera():
    points = np.random.default_rng(1).normal(size=(20, 3))
    eye, target = (3.0, 2.0, 5.0), (0.0, 0.0, 0.0)
    kinds = (
        rj.PerspectiveCamera(eye, target, fov_y=60.0, min_aspect=1.0),
        rj.OrthographicCamera(eye, target, height=4.0),
        rj.MatrixCamera.from_intrinsics(
            90, 80, 50, 45, (80, 100),
            view_from_world=rj.PerspectiveCamera(eye, target).view_matrix(),
        ),
    )  # fmt: skip
    for camera in kinds:
        plain, zoomed = (
            points_on_screen(one, points, (80, 100)) for one in (camera, zoom_camera(camera, 3.0))
        )
        np.testing.assert_allclose(zoomed, 3.0 * plain, rtol=1e-12, atol=1e-12)
        with pytest.raises(ValueError, match="zoom"):
            zoom_camera(camera, 0.0)


def points_on_screen(camera, points, size):
    """Return NDC x and y of points, (N, 2)."""
    matrix = camera.projection_matrix(size) @ camera.view_matrix()
    clip = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return clip[:, :2] / clip[:, 3:]


def test_default_direction_is_that_of_fit_camera():
    scene = rj.load(CUBE)
    fitted = CameraOptions(zoom=2.0).camera(scene, (10, 10))
    assert fitted == rj.fit_camera(scene, DEFAULT_DIRECTION, zoom=2.0)
    assert fitted == rj.fit_camera(scene, zoom=2.0)


def test_z_up_orbits_around_z_with_minus_y_in_front():
    scene = rj.load(CUBE)
    view = CameraOptions(azimuth=0.0, elevation=0.0, up=(0.0, 0.0, 1.0))
    camera = view.camera(scene, (10, 10))
    towards = np.subtract(camera.eye, camera.target)
    np.testing.assert_allclose(towards / np.linalg.norm(towards), (0, -1, 0), atol=1e-12)
    np.testing.assert_allclose(camera.up, (0, 0, 1), atol=1e-12)


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1), (1, 0, 0), (0, -1, 0), (1, -2, 3)])
@pytest.mark.parametrize("elevation", [-90.0, 20.0, 90.0])
def test_a_turn_keeps_its_distance_and_never_repeats(up, elevation):
    scene = rj.load(CUBE)
    view = CameraOptions(elevation=elevation, up=tuple(map(float, up)))
    turn = view.turn(scene, (10, 10))
    cameras = [turn(number / 7) for number in range(7)]
    eyes = np.array([camera.eye for camera in cameras])
    target = cameras[0].target
    assert {camera.target for camera in cameras} == {target}
    np.testing.assert_allclose(
        np.linalg.norm(eyes - target, axis=1), np.linalg.norm(eyes[0] - target), rtol=1e-12
    )
    height = (eyes - target) @ (np.array(up) / np.linalg.norm(up))
    np.testing.assert_allclose(height, height[0], atol=1e-12)
    matrices = {camera.view_matrix().round(6).tobytes() for camera in cameras}
    assert len(matrices) == 7


def test_orthographic_projection(tmp_path):
    camera = rj.fit_camera(rj.load(CUBE), projection="orthographic", aspect=SIZE[0] / SIZE[1])
    picture = render(tmp_path, "--projection", "orthographic")
    assert np.array_equal(picture, rendered(camera).color)


@pytest.mark.parametrize("background", ["transparent", "#204060", "red", "#12345678"])
def test_background(tmp_path, background):
    picture = render(tmp_path, "--background", background)
    assert np.array_equal(picture, rendered(background=background).color)


def photograph(tmp_path, size=SIZE, channels=3):
    """Write a picture of noise; return its path and pixels."""
    pixels = np.random.default_rng(1).integers(0, 256, (*size[::-1], channels)).astype(np.uint8)
    path = tmp_path / "photo.png"
    iio.imwrite(path, pixels)
    return path, pixels


@pytest.mark.parametrize("size", [(), ("--size", "48x36")])
def test_a_photograph_behind_sets_the_size(tmp_path, size):
    path, pixels = photograph(tmp_path)
    out = tmp_path / "a.jpg"
    options = ("--background", path, "-q", *size)
    assert run("render", CUBE, "-o", out, *options).exit_code == 0
    assert run("render", CUBE, "-o", tmp_path / "a.png", *options).exit_code == 0
    expected = rendered(background=pixels).color
    assert np.array_equal(iio.imread(tmp_path / "a.png"), expected)
    assert iio.imread(out).shape == (*SIZE[::-1], 3)
    told = run("explain", CUBE, "--background", path)
    assert "48 x 36 pixels" in told.stdout
    assert "background image" in told.stdout


def test_a_photograph_of_another_size_or_none_is_wrong_usage(tmp_path):
    path, _ = photograph(tmp_path, channels=4)
    out = tmp_path / "a.png"
    result = run("render", CUBE, "-o", out, "--background", path, "--size", "50x36")
    assert_one_line(result, 2)
    assert "48x36" in result.stderr
    result = run("render", CUBE, "-o", tmp_path / "a.jpg", "--background", path)
    assert_one_line(result, 2)
    for name in ("nowhere.png", CUBE):
        result = run("render", CUBE, "-o", out, "--background", name)
        assert_one_line(result, 2)
        assert name in result.stderr
    assert_one_line(run("view", CUBE, "--background", path), 2)
    assert not out.exists()


@pytest.mark.parametrize("mode", ["overlay", "only"])
def test_wireframe(tmp_path, mode):
    scene = rj.load(CUBE)
    scene.wireframe = rj.Wireframe("blue", mode)
    picture = render(tmp_path, "--wireframe", mode, "--wireframe-color", "blue")
    assert np.array_equal(picture, rendered(scene=scene).color)
    assert (picture == (0, 0, 255, 255)).all(axis=2).any()


@pytest.mark.parametrize("cull", ["none", "back", "front"])
def test_cull(tmp_path, cull):
    assert np.array_equal(render(tmp_path, "--cull", cull), rendered(cull=cull).color)


def test_shading_overrides_every_material(tmp_path):
    scene = rj.load(KNOT)
    for node in scene.nodes:
        node.mesh.material = rj.Material("flat", node.mesh.material.base_color)
    flat = render(tmp_path, "--shading", "flat", file=KNOT)
    assert np.array_equal(flat, rendered(scene=scene).color)
    assert not np.array_equal(flat, render(tmp_path, file=KNOT))


def test_any_number_of_threads_draws_the_same(tmp_path):
    one, three = (render(tmp_path, "--threads", n, file=KNOT) for n in (1, 3))
    assert np.array_equal(one, three)


def test_other_outputs_are_written_beside_the_picture(tmp_path):
    names = ("depth", "face_id", "barycentric", "normal")
    picture = render(tmp_path, "--outputs", "color," + ",".join(names))
    frame = rendered(outputs=("color", *names))
    assert np.array_equal(picture, frame.color)
    assert_arrays(tmp_path / "out.npz", frame, names)


def test_an_npz_holds_every_output_and_no_more(tmp_path):
    path = tmp_path / "all.npz"
    names = [name for name in OUTPUTS if name != "scalar"]
    assert run("render", KNOT, "-o", path, *SMALL, "--outputs", ",".join(names)).exit_code == 0
    assert_arrays(path, rendered(file=KNOT, outputs=names), names)
    assert run("render", KNOT, "-o", path, *SMALL, "--outputs", "depth").exit_code == 0
    assert_arrays(path, rendered(file=KNOT, outputs=("depth",)), ("depth",))
    assert [place.name for place in tmp_path.iterdir()] == ["all.npz"]


def assert_arrays(path, frame, names):
    with np.load(path) as arrays:
        assert sorted(arrays) == sorted(names)
        for name in names:
            assert arrays[name].tobytes() == getattr(frame, name).tobytes(), name


# Calibrated cameras, colours, lights, masks

K = np.array([[52.0, 0.0, 21.3], [0.0, 50.5, 17.9], [0.0, 0.0, 1.0]])
MARKS = np.array([(0.4, 0.3, 0.2), (-0.5, 0.1, 0.4), (0.1, -0.6, -0.3)])


def extrinsics():
    """OpenCV's camera from world of a camera that is turned about all axes, and looks at 0."""
    back = rj.transforms.look_at((1.5, 2.0, 4.0), (0.1, 0.0, -0.1), (0.2, 1.0, 0.1))
    return np.diag([1.0, -1.0, -1.0, 1.0]) @ back


def poses():
    """The same camera in each convention."""
    camera_from_world = extrinsics()
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    return {
        "opencv": camera_from_world,
        "opencv-c2w": np.linalg.inv(camera_from_world),
        "opengl": flip @ camera_from_world,
        "opengl-c2w": np.linalg.inv(camera_from_world) @ flip,
    }


def write_marks(tmp_path):
    """Write a file of small triangles around marks."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (0, 2, 0)]) * 0.02
    vertices = (MARKS[:, None] + corners).reshape(-1, 3)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    lines += ["f 1 2 3", "f 4 5 6", "f 7 8 9"]
    return write(tmp_path, "marks.obj", "\n".join(lines) + "\n")


@pytest.mark.parametrize("convention", sorted(poses()))
def test_a_pose_puts_what_is_seen_where_opencv_projects_it(tmp_path, convention):
    size = (480, 360)
    scale = np.diag([10.0, 10.0, 1.0])
    intrinsics, pose = scale @ K, poses()[convention]
    np.save(tmp_path / "k.npy", intrinsics)
    np.savetxt(tmp_path / "pose.txt", pose)
    result = run(
        "render", write_marks(tmp_path), "-o", tmp_path / "ids.npz", "-q", "--size", "480x360",
        "--outputs", "face_id", "--pose", tmp_path / "pose.txt", "--convention", convention,
        "--intrinsics", tmp_path / "k.npy",
    )  # fmt: skip
    assert (result.exit_code, result.output) == (0, "")
    face_id = np.load(tmp_path / "ids.npz")["face_id"]
    assert face_id.shape == size[::-1]
    camera = extrinsics()
    for number, mark in enumerate(MARKS):
        x, y, w = intrinsics @ (camera[:3, :3] @ mark + camera[:3, 3])
        rows, columns = np.nonzero(face_id == number)
        found = np.array([columns.mean(), rows.mean()])
        assert np.abs(found - (x / w, y / w)).max() < 0.4, (number, found)


def calibrated_cameras():
    """Return two cameras of the cube in one size, with a lens and names."""
    lens = rj.PinholeDistortion(-0.2, 0.05)
    views = [rj.transforms.look_at(eye, (0, 0, 0), (0, 1, 0)) for eye in ((3, 2, 4), (-3, 2, 4))]
    intrinsics = 55.0, 60.0, 30.0, 25.0, (64, 48)
    cameras = [rj.MatrixCamera.from_intrinsics(*intrinsics, view_from_world=one) for one in views]
    return [
        rj.CalibratedCamera(one, (64, 48), lens, name)
        for one, name in zip(cameras, ("a:b.png", "c.png"), strict=True)
    ]


@pytest.mark.parametrize("image", [":c.png", ":1", ""])
def test_a_camera_of_a_file_is_that_of_the_library(tmp_path, image):
    cameras = calibrated_cameras()
    rj.save_cameras(tmp_path / "t.json", cameras if image else cameras[1:])
    result = run(
        "render", CUBE, "-o", tmp_path / "a.npz", "-q", "--outputs", "face_id",
        "--camera", f"{tmp_path / 't.json'}{image}",
    )  # fmt: skip
    assert (result.exit_code, result.output) == (0, "")
    one = cameras[1]
    scene = rj.load(CUBE)
    expected = rj.render(scene, one.camera, size=one.size, lens=one.lens, outputs="face_id")
    assert (np.load(tmp_path / "a.npz")["face_id"] == expected.face_id).all()


def test_a_name_goes_before_a_number_and_what_shifts_numbers_is_told(tmp_path):
    cameras = [
        dataclasses.replace(one, name=name)
        for one, name in zip(calibrated_cameras() + calibrated_cameras(), "2011", strict=True)
    ]
    rj.save_cameras(tmp_path / "t.json", cameras)
    document = json.loads((tmp_path / "t.json").read_text())
    first = {**document["frames"][0], "file_path": "fov", "camera_model": "FOV"}
    document["frames"] = [first, *document["frames"]]
    (tmp_path / "t.json").write_text(json.dumps(document))
    with pytest.warns(rj.LoadWarning, match="frame of a camera without a lens here"):
        found = [option_types.load_camera(f"{tmp_path / 't.json'}:{n}", None) for n in "203"]
    assert [one.name for one in found] == ["2", "0", "1"]
    with (
        pytest.raises(ValueError, match="an image of 2, 0, 1, 1, or its number"),
        pytest.warns(rj.LoadWarning, match="left out"),
    ):
        option_types.load_camera(f"{tmp_path / 't.json'}:1", None)


def test_explain_says_that_it_has_no_lens_and_has_the_size_of_a_camera_of_a_file(tmp_path):
    rj.save_cameras(tmp_path / "t.json", calibrated_cameras()[:1])
    document = json.loads((tmp_path / "t.json").read_text())
    (tmp_path / "t.json").write_text(json.dumps({**document, "aabb_scale": 4}))
    result = run("explain", CUBE, "--camera", tmp_path / "t.json")
    assert result.exit_code == 0
    assert "64 x 48 pixels" in result.output
    assert "--camera has a lens, which only render and accuracy draw" in result.output
    assert f"warning: {tmp_path / 't.json'}: left out aabb_scale (1)" in result.output


@pytest.mark.parametrize(
    ("words", "match"),
    [
        (("t.json",), "must be FILE:IMAGE, an image of a:b.png, c.png, or its number"),
        (("t.json:d.png",), "must be FILE:IMAGE, an image of a:b.png, c.png"),
        (("u.json",), "u.json does not exist"),
        (("t.json:1", "--fov", "40"), "--fov has no effect here: --camera has its own"),
        (("t.json:1", "--lens", "fisheye"), "--lens has no effect here: --camera has its own"),
        (("t.json:1", "--size", "64x64"), "size must have the aspect of 64 x 48"),
    ],
)
def test_cameras_of_files_that_are_not_there_or_not_alone_are_refused(
    tmp_path, monkeypatch, words, match
):
    monkeypatch.chdir(tmp_path)
    rj.save_cameras("t.json", calibrated_cameras())
    result = run("render", CUBE, "-o", "a.png", "--camera", *words)
    assert result.exit_code in (1, 2)
    assert match in " ".join(result.output.replace("│", " ").split())


@pytest.mark.parametrize(
    ("words", "size", "lens"),
    [
        ("opencv:-0.2,0.05,0.001,-0.002,0.01", (64, 48), (-0.2, 0.05, 0.001, -0.002, 0.01)),
        ("fisheye:-0.01", (64, 48), rj.FisheyeLens(-0.01)),
        ("panorama", (64, 32), rj.Equirectangular()),
    ],
)
def test_a_lens_is_that_of_the_library(tmp_path, words, size, lens):
    lens = rj.PinholeDistortion(*lens) if isinstance(lens, tuple) else lens
    result = run(
        "render", CUBE, "-o", tmp_path / "a.npz", "-q", "--size", "{}x{}".format(*size),
        "--lens", words, "--outputs", "color,face_id", "--position", "1,2,3",
    )  # fmt: skip
    assert (result.exit_code, result.output) == (0, "")
    camera = rj.PerspectiveCamera((1, 2, 3), (0, 0, 0))
    frame = rj.render(
        rj.load(CUBE), camera, size=size, lens=lens, outputs=("color", "face_id"), threads=1
    )
    with np.load(tmp_path / "a.npz") as found:
        assert (found["face_id"] == frame.face_id).all()
        assert (found["color"] == frame.color).all()


def test_matrices_may_be_numbers_or_files_of_three_kinds(tmp_path):
    pose, size = poses()["opengl-c2w"], ("--size", "48x36")
    (tmp_path / "a.json").write_text(json.dumps({"transform_matrix": pose.tolist()}))
    (tmp_path / "k.json").write_text(json.dumps({"camera_matrix": K.tolist()}))
    np.save(tmp_path / "a.npy", pose[:3])
    lines = ["# camera", *(",".join(map(repr, row)) for row in pose.tolist())]
    (tmp_path / "a.txt").write_text("\n".join(lines))
    camera = rj.cameras.from_opencv(K, SIZE, camera_from_world=extrinsics())
    expected = rendered(camera).color
    numbers = ",".join(map(repr, pose.ravel().tolist()))
    for given in (tmp_path / "a.json", tmp_path / "a.npy", tmp_path / "a.txt", numbers):
        for k in (tmp_path / "k.json", "52,50.5,21.3,17.9"):
            words = ("--pose", given, "--convention", "opengl-c2w", "--intrinsics", k)
            picture = render(tmp_path, *words, *size)
            assert np.abs(picture.astype(int) - expected).mean() < 0.2, (given, k)


def test_a_pose_alone_has_the_field_of_view_and_intrinsics_alone_the_place(tmp_path):
    camera = rj.PerspectiveCamera((2, 3, 5), (0, 0, 0), fov_y=40.0)
    view = ",".join(map(repr, camera.view_matrix().ravel().tolist()))
    posed = render(tmp_path, "--pose", view, "--convention", "opengl", "--fov", 40)
    assert np.abs(posed.astype(int) - rendered(camera).color).mean() < 0.2
    focal = 18.0 / np.tan(np.radians(20.0))
    words = ("--intrinsics", f"{focal},{focal},23.5,17.5", "--position", "2,3,5")
    placed = render(tmp_path, *words, "--target", "0,0,0")
    assert np.abs(placed.astype(int) - rendered(camera).color).mean() < 0.2


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_a_pose_cuts_nothing_off_at_any_scale(tmp_path, scale):
    pose = extrinsics()
    pose[:3, 3] *= scale
    path = write(tmp_path, "small.off", (MODELS / "pyramid.off").read_text())
    mesh = rj.load(path).nodes[0].mesh
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (scale * mesh.vertices).tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    path = write(tmp_path, "scaled.obj", "\n".join(lines) + "\n")
    mask, numbers = tmp_path / "mask.png", ",".join(map(repr, pose.ravel().tolist()))
    words = ("--pose", numbers, "--convention", "opencv", "--mask", mask)
    render(tmp_path, *words, "--size", "48x36", file=path)
    assert 0.05 < (iio.imread(mask) == 255).mean() < 0.9
    reference = rj.cameras.from_opencv(
        np.array([[43.456, 0, 23.5], [0, 43.456, 17.5], [0, 0, 1]]), SIZE,
        camera_from_world=pose, near=1e-2 * scale,
    )  # fmt: skip
    covered = rj.render(rj.load(path), reference, size=SIZE, outputs=("coverage",)).coverage
    assert np.abs(iio.imread(mask) / 255 - covered).mean() < 2e-3


UNIT = "1,0,0,0,0,1,0,0,0,0,1,-4"


@pytest.mark.parametrize(
    "words",
    [
        ("--pose", UNIT),
        ("--convention", "opencv"),
        ("--convention", "blender", "--pose", UNIT),
        ("--pose", "1,2,3", "--convention", "opencv"),
        ("--pose", "nowhere.npy", "--convention", "opencv"),
        ("--pose", UNIT, "--convention", "opencv", "--position", "1,2,3"),
        ("--pose", UNIT, "--convention", "opencv", "--azimuth", "3"),
        ("--pose", UNIT, "--convention", "opencv", "--up", "0,0,1"),
        ("--pose", UNIT, "--convention", "opencv", "--projection", "orthographic"),
        ("--pose", UNIT.replace("1,0,0", "2,0,0", 1), "--convention", "opencv"),
        ("--pose", UNIT.replace("1,0,0", "-1,0,0", 1), "--convention", "opencv"),
        ("--pose", UNIT.replace("-4", "nan"), "--convention", "opencv"),
        ("--intrinsics", "50,50,24,18"),
        ("--intrinsics", "50,50,24", "--size", "48x36"),
        ("--intrinsics", "-50,50,24,18", "--size", "48x36"),
        ("--intrinsics", "50,0,24,18", "--size", "48x36"),
        ("--intrinsics", "50,-50,24,18", "--size", "48x36"),
        ("--intrinsics", "50,1e-30,24,18", "--size", "48x36"),
        ("--intrinsics", "50,1e300,24,18", "--size", "48x36"),
        ("--intrinsics", "1e-200,1e-10,24,18", "--size", "48x36"),
        ("--intrinsics", "50,0,24,1,50,18,0,0,1", "--size", "48x36"),
        ("--intrinsics", "50,0,24,0,50,18,0,0,2", "--size", "48x36"),
        ("--intrinsics", "50,50,24,18", "--size", "48x36", "--fov", "40"),
        ("--intrinsics", "50,50,24,18", "--size", "48x36", "--zoom", "2"),
        ("--lens", "barrel:0.1"),
        ("--lens", "opencv:0.1,x"),
        ("--lens", "fisheye:1,2,3,4,5"),
        ("--lens", "fisheye:nan"),
        ("--lens", "panorama:1"),
        ("--mask-of", "object_id"),
        ("--mask", "mask.jpg"),
        ("--mask", "a.png"),
        ("--color", "mauve-ish"),
        ("--light", "0,0,0"),
        ("--light", "moon"),
        ("--light", "headlight", "--light", "sun"),
        ("--light", "headlight", "--light", "headlight"),
        ("--light", "ambient", "--light", "ambient"),
        ("--light", "sun", "--light", "ambient", "--light", "sun"),
        ("--light", "1,0,0", "--light", "1.0,0,0"),
    ],
    ids=" ".join,
)
def test_a_bad_camera_light_or_mask_is_one_line(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    result = run("render", CUBE, "-o", "a.png", "-q", *words)
    assert_one_line(result, 1, 2)
    assert words[0] in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--pose", "1,0,0,0"), "of a 4x4 or 3x4 matrix, row by row, got 4 numbers"),
        (("--pose", "a.txt"), "of a 4x4 or 3x4 matrix, row by row, or a file of them: there is no"),
        (("--intrinsics", "500,500,320"), "the 9 numbers of a 3x3 matrix K, got 3 numbers"),
        (("--cull", "left"), "'none', 'back', 'front'"),
    ],
)
def test_a_message_says_what_it_got_and_ends_with_a_word(words, said):
    result = run("render", CUBE, "-o", "a.png", *words)
    assert_one_line(result, 2)
    assert said in result.stderr
    assert result.stderr.rstrip("\n")[-1] not in ".,;:"


def test_a_colour_takes_the_place_of_colours_and_textures(tmp_path):
    scene = rj.load(MODELS / "scene.glb")
    for node in scene.nodes:
        node.mesh = node.mesh.without_colors()
        assert node.mesh.vertex_colors is None
    for node in scene.nodes:
        material = node.mesh.material
        node.mesh.material = replace(
            material, base_color="teal", base_color_texture=None, alpha_mode="opaque"
        )
    file = MODELS / "scene.glb"
    picture = render(tmp_path, "--color", "teal", "--shading", "unlit", file=file)
    codes = {tuple(color) for color in picture.reshape(-1, 4).tolist()}
    assert (0, 128, 128, 255) in codes
    assert not {(color[0], color[1]) for color in codes} - {(0, 128), (255, 255)}
    assert np.array_equal(
        render(tmp_path, "--color", "teal", file=file), rendered(scene=scene).color
    )
    glass = render(tmp_path, "--color", "#00808080", "--shading", "unlit")
    assert (glass[..., 0] == 0).sum() < (picture[..., 0] == 0).sum()


def test_lights_by_direction_and_name(tmp_path):
    ambient = rj.AmbientLight(intensity=0.15)
    shining = {
        ("--light", "1,-2,0.5"): [ambient, rj.DirectionalLight((1, -2, 0.5), intensity=0.9)],
        ("--light", "sun"): [ambient, rj.DirectionalLight((-0.6, -1, -0.5), intensity=0.9)],
        ("--light", "ambient"): [rj.AmbientLight(intensity=1.0)],
        ("--light", "headlight"): [],
        ("--light", "1,0,0", "--light", "-1,0,0"): [
            ambient, *(rj.DirectionalLight((x, 0, 0), intensity=0.9) for x in (1, -1)),
        ],
        ("--light", "1,-2,0.5", "--light", "ambient"): [
            rj.AmbientLight(intensity=1.0), rj.DirectionalLight((1, -2, 0.5), intensity=0.9),
        ],
    }  # fmt: skip
    seen = set()
    for words, lights in shining.items():
        scene = rj.load(CUBE)
        scene.lights = lights
        picture = render(tmp_path, *words)
        assert np.array_equal(picture, rendered(scene=scene).color), words
        seen.add(picture.tobytes())
    assert len(seen) == len(shining)
    told = run("render", CUBE, "-o", tmp_path / "a.png", "--light", "headligt").stderr
    assert "did you mean headlight?" in told


@pytest.mark.parametrize("samples", [1, 8])
def test_a_mask_holds_the_share_of_each_pixel(tmp_path, samples):
    path = tmp_path / "mask.png"
    picture = render(tmp_path, "--mask", path, "--samples", samples)
    frame = rendered(outputs=("color", "coverage"), quality=rj.Quality(samples=samples))
    mask = iio.imread(path)
    assert mask.dtype == np.uint8
    assert np.array_equal(mask, np.floor(255 * frame.coverage + 0.5))
    assert (len(np.unique(mask)) > 2) == (samples > 1)
    assert np.array_equal(picture, frame.color)


@pytest.mark.parametrize("name", ["object_id", "face_id"])
def test_a_mask_of_numbers_has_one_more_than_they_are(tmp_path, name):
    path = tmp_path / "mask.png"
    render(tmp_path, "--mask", path, "--mask-of", name)
    numbers = getattr(rendered(outputs=(name,)), name)
    assert np.array_equal(np.array(Image.open(path)), numbers + 1)
    result = run("render", CUBE, "-o", tmp_path / "b.png", "--mask", path, "--scale", 2)
    assert_one_line(result, 2)


def depth_codes(path, units):
    """Return the codes of a depth map, which must say what they stand for."""
    depth = rendered(outputs=("depth",)).depth.astype(np.float64)
    with Image.open(path) as picture:
        assert (float(picture.text["scale"]), float(picture.text["offset"])) == (units, 0.0)
        codes = np.array(picture)
    seen = np.isfinite(depth)
    assert not codes[~seen].any()
    assert np.abs(codes[seen] * units - depth[seen]).max() <= 0.501 * units
    return codes


@pytest.mark.parametrize("units", [None, 0.01])
def test_depth_is_written_as_sixteen_bits_that_say_their_scale(tmp_path, units):
    path = tmp_path / "depth.png"
    render(tmp_path, "--depth", path, *([] if units is None else ["--scale", units]))
    depth_codes(path, units or 0.001)
    assert sorted(place.name for place in tmp_path.iterdir()) == ["depth.png", "out.png"]


def test_a_scale_is_that_of_frame_save_and_of_one_output_as_well(tmp_path):
    path = tmp_path / "depth.png"
    rendered(outputs=("depth",)).save(tmp_path / "saved.png", "depth", scale=0.002)
    result = run("render", CUBE, "-o", path, *SMALL, "--outputs", "depth", "--scale", 0.002)
    assert (result.exit_code, result.output) == (0, "")
    assert path.read_bytes() == (tmp_path / "saved.png").read_bytes()


def test_a_scale_that_loses_the_depth_is_refused(tmp_path):
    arguments = ("--depth", tmp_path / "depth.png", "--scale", 1000)
    result = run("render", CUBE, "-o", tmp_path / "a.png", *SMALL, *arguments)
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert "--scale must take depth to codes in 1..65535" in result.stderr
    assert "--scale 1000" in result.stderr
    assert result.stderr.endswith("; choose 0.001, .exr or .npz\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("size", "units"), [(1e-3, 1e-7), (0.1, 1e-5), (2.0, 0.001), (10.0, 0.001), (1000.0, 0.1)]
)
def test_a_scale_that_is_not_given_fits_the_depth_and_is_told(tmp_path, size, units):
    mesh = rj.load(CUBE).nodes[0].mesh
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (size / 2 * mesh.vertices).tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    file, path = write(tmp_path, "cube.obj", "\n".join(lines)), tmp_path / "depth.png"
    result = run("render", file, "-o", tmp_path / "a.png", "--size", "48x36", "--depth", path)
    assert (result.exit_code, result.stderr) == (0, "")
    told = f"16 bits, a code is {units:g} units (--scale {units:g}), 0 is nothing"
    assert f"wrote {path}  {told}\n" in result.stdout
    with Image.open(path) as picture:
        assert float(picture.text["scale"]) == units
        codes = np.array(picture).astype(np.float64)
    depth = rj.render(rj.load(file), size=SIZE, outputs=("depth",)).depth
    seen = np.isfinite(depth)
    assert np.array_equal(codes > 0, seen)
    assert np.abs(codes[seen] * units - depth[seen]).max() <= 0.501 * units
    assert np.ptp(codes[seen]) >= 255
    given = run("render", file, "-o", tmp_path / "a.png", "--depth", path, "--scale", units)
    assert f"wrote {path}\n" in given.stdout


def test_depths_that_no_scale_holds_and_numbers_beyond_16_bits_leave_no_file(tmp_path):
    near, far = (
        f"v -{s} -{s} {z}\nv {s} -{s} {z}\nv 0 {s} {z}\n" for s, z in ((3e5, -1), (9e5, -1e6))
    )
    file = write(tmp_path, "far.obj", f"{near}{far}f 1 2 3\nf 4 5 6\n")
    out = tmp_path / "out"
    out.mkdir()
    view = ("--projection", "orthographic", "--position", "0,0,0", "--target", "0,0,-1")
    result = run("render", file, "-o", out / "a.png", *SMALL, *view, "--depth", out / "d.png")
    assert_one_line(result, 1)
    assert f"no scale takes depths from 1 to 1e+06 to the 16-bit codes of {out / 'd.png'}" in (
        result.stderr
    )
    rows, columns = np.divmod(np.arange(33 * 2000), 2000)
    grid = np.stack([columns, rows], axis=1)
    corners = (grid[:, None] + ((0, 0), (0.9, 0), (0, 0.9))).reshape(-1, 2)
    lines = [f"v {x} {y} 0" for x, y in corners.tolist()]
    lines += [f"f {n} {n + 1} {n + 2}" for n in range(1, len(corners), 3)]
    file = write(tmp_path, "many.obj", "\n".join(lines))
    words = ("--size", "4000x80", "--mask", out / "m.png", "--mask-of", "face_id", "-q")
    result = run("render", file, "-o", out / "a.png", *words)
    assert_one_line(result, 1)
    assert "choose .exr or .npz" in result.stderr
    assert list(out.iterdir()) == []


QUALITY = np.array([0.5, 2.0, -1.25, 4.0])
STRESS = np.array([10, 30], np.int16)


@pytest.fixture(params=["ascii", "binary_little_endian", "binary_big_endian"])
def measured(request, tmp_path):
    """A PLY file of a square, with numbers of its vertices and faces."""
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    order = ">" if "big" in request.param else "<"
    head = (
        f"ply\nformat {request.param} 1.0\nelement vertex 4\nproperty float x\n"
        "property float y\nproperty float z\nproperty double quality\nproperty uchar kind\n"
        "element face 2\nproperty list uchar int vertex_indices\nproperty short stress\n"
        "end_header\n"
    )
    rows = zip(corners, QUALITY, range(4), strict=True)
    vertices = [(*corner, value, kind) for corner, value, kind in rows]
    faces = [(3, 0, 1, 2, STRESS[0]), (3, 0, 2, 3, STRESS[1])]
    if request.param == "ascii":
        body = "".join(f"{' '.join(map(str, row))}\n" for row in (*vertices, *faces)).encode()
    else:
        body = b"".join(struct.pack(f"{order}3fdB", *row) for row in vertices)
        body += b"".join(struct.pack(f"{order}B3ih", *row) for row in faces)
    path = tmp_path / "square.ply"
    path.write_bytes(head.encode() + body)
    return path


def shown_by(file, scalars, **options):
    """Return the scene of a file whose mesh is shown by scalars."""
    scene = rj.load(file)
    (node,) = scene.nodes
    node.mesh = rj.Mesh(
        node.mesh.vertices, node.mesh.faces, normals=node.mesh.normals, scalars=scalars,
        material=rj.Material(), **options,
    )  # fmt: skip
    return scene


def test_scalars_of_a_file_are_shown_by_colours(tmp_path, measured):
    found = render(tmp_path, "--scalars", "quality", file=measured)
    wanted = rendered(scene=shown_by(measured, QUALITY)).color
    assert np.array_equal(found, wanted[..., :3] if found.shape[2] == 3 else wanted)
    options = "--colormap", "coolwarm_r", "--range", "-2,2.5", "--contours", "3"
    found = render(tmp_path, "--scalars", "quality", *options, file=measured)
    scene = shown_by(measured, QUALITY, colormap="coolwarm_r", range=(-2, 2.5), contours=3)
    assert np.array_equal(found, rendered(scene=scene).color[..., : found.shape[2]])
    found = render(tmp_path, "--scalars", "quality", "--contours", "0.25,", file=measured)
    scene = shown_by(measured, QUALITY, contours=[0.25])
    assert np.array_equal(found, rendered(scene=scene).color[..., : found.shape[2]])
    found = render(
        tmp_path, "--scalars", "quality", "--range", "20%", "--norm", "symlog", file=measured
    )
    scene = shown_by(measured, QUALITY, range="20%", norm="symlog")
    assert np.array_equal(found, rendered(scene=scene).color[..., : found.shape[2]])
    found = render(tmp_path, "--scalars", "stress", file=measured)
    scene = shown_by(measured, STRESS)
    assert np.array_equal(found, rendered(scene=scene).color[..., : found.shape[2]])


def test_points_of_a_file_are_shown_by_colours_beside_their_bar(tmp_path):
    values = np.arange(6.0)
    xyz = np.random.default_rng(5).random((6, 3)).round(3)
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "quality"))
    rows = "".join(f"{x} {y} {z} {value}\n" for (x, y, z), value in zip(xyz, values, strict=True))
    head = f"ply\nformat ascii 1.0\nelement vertex 6\n{names}end_header\n"
    scan = write(tmp_path, "scan.ply", head + rows)
    scene = rj.load(scan)
    (node,) = scene.nodes
    node.mesh = node.mesh.with_scalars(values, "inferno")
    frame = rendered(scene=scene)
    wanted = np.concatenate([frame.color, frame.colorbar("quality")], axis=1)
    options = "--colormap", "inferno", "--colorbar"
    found = render(tmp_path, "--scalars", "quality", *options, file=scan)
    assert np.array_equal(found, wanted[..., : found.shape[2]])
    words = "--scalars", "quality", "--contours", "3", "-o", tmp_path / "b.png"
    assert_one_line(run("render", scan, *words), 1)


def test_a_colour_bar_stands_beside_the_picture(tmp_path, measured):
    found = render(tmp_path, "--scalars", "quality", "--contours", 4, "--colorbar", file=measured)
    frame = rendered(scene=shown_by(measured, QUALITY, contours=4))
    wanted = np.concatenate([frame.color, frame.colorbar("quality")], axis=1)
    assert np.array_equal(found, wanted[..., : found.shape[2]])


def test_scalars_are_an_output(tmp_path, measured):
    path = tmp_path / "out.npz"
    words = "--outputs", "scalar", "--scalars", "quality"
    result = run("render", measured, "-o", path, *SMALL, *words)
    assert (result.exit_code, result.output) == (0, "")
    frame = rendered(scene=shown_by(measured, QUALITY), outputs="scalar")
    assert np.array_equal(np.load(path)["scalar"], frame.scalar, equal_nan=True)


def test_all_meshes_have_one_range_and_no_textures(tmp_path):
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    faces, scene = [[0, 1, 2], [0, 2, 3]], rj.Scene()
    texture = rj.Texture(np.full((2, 2, 3), 64, np.uint8))
    material = rj.Material("unlit", "#404040", base_color_texture=texture)
    for n, heat in enumerate(([[0], [1], [2], [3]], [[5], [5], [5], [5]], None)):
        own = {} if heat is None else {"attributes": {"_HEAT": np.array(heat)}}
        mesh = rj.Mesh(square, faces, uv=square[:, :2], material=material, **own)
        scene.add(mesh, rj.transforms.translate((2.5 * n, 0, 0)))
    scene.save(tmp_path / "three.glb")
    found = render(tmp_path, "--scalars", "_HEAT", file=tmp_path / "three.glb")[..., :3]
    codes = rj.Colormap("viridis").codes[:, :3]
    assert (found == codes[-1]).all(axis=2).any()
    shown = {tuple(color) for color in found.reshape(-1, 3).tolist()}
    # From 0 to 3 of 5, and 5.
    assert shown & {tuple(color) for color in codes[:60].tolist()}
    assert not shown & {tuple(color) for color in codes[160:-1].tolist()}
    plain = rj.load(tmp_path / "three.glb")
    assert len(shown - {tuple(color) for color in codes.tolist()} - {(255, 255, 255)}) == 1
    assert plain.nodes[2].mesh.scalar_attributes == ()


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--scalars", "qualty"), 1, "those with one number are quality, kind, stress; did you"),
        (("--scalars", "stress", "--contours", 3), 1, "--contours must not be given where"),
        (("--scalars", "quality", "--colormap", "virdis"), 2, "did you mean 'viridis'"),
        (("--scalars", "quality", "--range", "1"), 2, "'1' is not LOW,HIGH"),
        (("--scalars", "quality", "--range", "2,1"), 2, "the lower one first"),
        (("--scalars", "quality", "--range", "0,inf"), 2, "must be finite"),
        (("--scalars", "quality", "--range", "70%"), 2, "below 50%"),
        (("--scalars", "quality", "--norm", "log", "--range", "-1,1"), 1, "--range must be above"),
        (("--scalars", "quality", "--contours", "0"), 2, "levels must be 1 to 4096 in number"),
        (("--scalars", "quality", "--contours", "a,b"), 2, "expected a number of lines"),
        (("--scalars", "quality", "--contours", "nan,1"), 2, "levels"),
    ],
)
@pytest.mark.parametrize("measured", ["ascii"], indirect=True)
def test_wrong_scalars_are_named(tmp_path, measured, options, code, words):
    result = run("render", measured, "-o", tmp_path / "a.png", *options)
    assert_one_line(result, code)
    assert words in result.stderr
    assert not (tmp_path / "a.png").exists()


def test_a_mesh_without_attributes_says_so(tmp_path):
    result = run("render", CUBE, "-o", tmp_path / "a.png", "--scalars", "quality")
    assert_one_line(result, 1)
    assert "there is none" in result.stderr


def test_pictures_of_a_folder_have_no_colour_bar(tmp_path, measured):
    folder = measured.parent
    result = run("render", folder, "-o", folder, "--scalars", "quality", "--colorbar")
    assert_one_line(result, 2)
    assert "--colorbar has no effect here" in result.stderr
    result = run("render", folder, "-o", folder, "--scalars", "quality", *SMALL)
    assert result.exit_code == 0, result.output
    found = iio.imread(folder / "square.ply.png")[..., :3]
    assert np.array_equal(found, rendered(scene=shown_by(measured, QUALITY)).color[..., :3])


@pytest.mark.parametrize(
    ("options", "planes"),
    [
        (["x=0.25"], [((0.25, 0, 0), (1, 0, 0))]),
        (["-y=1", "z = -0.5"], [((0, 1, 0), (0, -1, 0)), ((0, 0, -0.5), (0, 0, 1))]),
        (["1,2,3,0,0.6,-0.8"], [((1, 2, 3), (0, 0.6, -0.8))]),
    ],
)
def test_sections_are_options(tmp_path, options, planes):
    given = [word for text in options for word in ("--section", text)]
    found = render(tmp_path, *given, "--section-lines", "red", "--shading", "unlit")
    scene = rj.load(CUBE)
    scene.section = [rj.SectionPlane(*plane, lines=True, line_color="red") for plane in planes]
    for node in scene.nodes:
        node.mesh.material = rj.Material("unlit")
    assert np.array_equal(found[..., :3], rendered(scene=scene).color[..., :3])


@pytest.mark.parametrize("text", ["x", "w=1", "x=a", "1,2,3", "0,0,0,0,0,0", "x=inf"])
def test_bad_sections_are_wrong_usage(tmp_path, text):
    result = run("render", CUBE, "-o", tmp_path / "a.png", "--section", text)
    assert result.exit_code == 2
    assert "--section" in result.output


def test_eye_dome_lighting_is_an_option(tmp_path):
    found = render(tmp_path, "--eye-dome", "0.5", "--shading", "unlit")
    scene = rj.load(CUBE)
    scene.eye_dome = rj.EyeDome(0.5)
    for node in scene.nodes:
        node.mesh.material = rj.Material("unlit")
    assert np.array_equal(found[..., :3], rendered(scene=scene).color[..., :3])


IDLE = [
    ("render", "a.png", "--scale", 0.1),
    ("render", "a.png", "--depth", "a.npy", "--scale", 0.1),
    ("render", "a.png", "--outputs", "color,depth", "--scale", 0.1),
    ("render", "a.npz", "--outputs", "depth", "--background", "red"),
    ("render", "a.npz", "--outputs", "depth", "--shading", "flat"),
    ("render", "a.npz", "--outputs", "depth", "--shadows"),
    ("render", "a.npz", "--outputs", "depth", "--environment", "sky"),
    ("render", "a.npz", "--outputs", "depth", "--ambient-occlusion"),
    ("render", "a.npz", "--outputs", "depth", "--samples", 4),
    ("render", "a.npz", "--outputs", "linear", "--tone-map", "aces"),
    ("render", "a.npz", "--outputs", "linear", "--exposure", 1),
    ("render", "a.npz", "--outputs", "linear", "--outline", "red"),
    ("render", "a.npz", "--outputs", "linear", "--vignette", 0.5),
    ("render", "a.npz", "--outputs", "linear", "--section", "x=0", "--section-lines", "red"),
    ("render", "a.png", "--section-lines", "red"),
    ("render", "a.npz", "--outputs", "linear", "--wireframe", "overlay"),
    ("render", "a.npz", "--outputs", "linear", "--wireframe-color", "red"),
    ("render", "a.npz", "--outputs", "depth", "--scalars", "heat"),
    ("render", "a.npz", "--outputs", "depth", "--eye-dome", 1),
    ("render", "a.npz", "--outputs", "scalar", "--colormap", "gray"),
    ("render", "a.png", "--colormap", "gray"),
    ("render", "a.png", "--range", "0,1"),
    ("render", "a.png", "--norm", "log"),
    ("render", "a.png", "--contours", 5),
    ("render", "a.png", "--colorbar"),
    ("render", "a.exr", "--scalars", "heat", "--colorbar"),
    ("render", "a.png", "--scalars", "heat", "--color", "red"),
    ("turntable", "a.gif", "--contours", 5),
    ("turntable", "a.gif", "--projection", "orthographic", "--fov", 40),
    ("turntable", "a.gif", "--up", "0,0,0"),
    ("explain", None, "--pixel", "1,1", "--outputs", "depth"),
    ("explain", None, "--pixel", "1,1", "--threads", 1),
    ("explain", None, "--threads", 1),
    ("view", None, "--backend", "terminal", "--port", 80),
    ("view", None, "--backend", "window", "--host", "::1"),
    ("view", None, "--backend", "terminal", "--token", "a-token-that-is-kept"),
    ("dataset", "out", "--seed", 3),
    ("dataset", "out", "--cameras", "random", "--elevation", 3),
]


@pytest.mark.parametrize("words", IDLE, ids=lambda words: " ".join(map(str, words)))
def test_an_option_without_effect_is_wrong_usage(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    command, out, *options = words
    result = run(command, CUBE, *(["-o", out] if out else []), *options)
    assert_one_line(result, 2)
    assert any(str(word) in result.stderr for word in options if str(word).startswith("--"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("--wireframe-color", "color"), ("--tone-map", "color"), ("--samples", "coverage"),
        ("--background", "linear"),
    ],
)  # fmt: skip
def test_what_an_output_shows_is_no_option_without_effect(tmp_path, name, kept):
    values = {"--tone-map": "aces", "--samples": 4}
    arguments = (name, values.get(name, "red"), "--outputs", kept)
    assert run("render", CUBE, "-o", tmp_path / "a.npz", *SMALL, *arguments).exit_code == 0


def test_one_output_alone_is_a_picture_of_its_codes(tmp_path):
    path = tmp_path / "ids.png"
    assert run("render", CUBE, "-o", path, *SMALL, "--outputs", "object_id").exit_code == 0
    assert np.array_equal(
        np.array(Image.open(path)), rendered(outputs=("object_id",)).object_id + 1
    )
    assert [place.name for place in tmp_path.iterdir()] == ["ids.png"]


@pytest.mark.parametrize(
    ("name", "output", "formats"),
    [
        ("a.jpg", "depth", ".png, .npz, .exr"),
        ("a.tif", "object_id", ".png, .npz, .exr"),
        ("a.webp", "attribute:heat", ".png, .npz, .exr"),
        ("a.png", "linear", ".npz, .exr"),
        ("a.jpg", "linear", ".npz, .exr"),
    ],
)
def test_one_output_alone_in_a_file_that_cannot_hold_it_is_wrong_usage(
    tmp_path, name, output, formats
):
    result = run("render", CUBE, "-o", tmp_path / name, *SMALL, "--outputs", output)
    assert_one_line(result, 2)
    assert f"--outputs: {tmp_path / name} cannot hold {output} alone" in result.stderr
    assert f"end it in one of {formats}; " in result.stderr
    assert list(tmp_path.iterdir()) == []


def heated(tmp_path):
    """Write a cube whose vertices have an attribute, heat; return its path and the scene."""
    vertices, faces = (getattr(rj.load(CUBE).nodes[0].mesh, part) for part in ("vertices", "faces"))
    heat = np.linspace(0.0, 1.0, len(vertices))[:, None]
    material = rj.Material(shading="pbr")
    mesh = rj.Mesh(vertices, faces, material=material, attributes={"heat": heat})
    scene = rj.Scene()
    scene.add(mesh)
    scene.save(tmp_path / "h.glb")
    return tmp_path / "h.glb", rj.load(tmp_path / "h.glb")


@pytest.mark.parametrize("words", [(), ("--scale", 0.00002)])
def test_an_attribute_alone_is_a_picture_of_its_codes(tmp_path, words):
    file, scene = heated(tmp_path)
    arguments = (file, "-o", tmp_path / "heat.png", *SMALL, "--outputs", "attribute:heat", *words)
    result = run("render", *arguments)
    assert (result.exit_code, result.output) == (0, "")
    frame = rendered(scene=scene, outputs=("attribute:heat",))
    frame.save(tmp_path / "saved.png", "attribute:heat", scale=words[1] if words else None)
    assert (tmp_path / "heat.png").read_bytes() == (tmp_path / "saved.png").read_bytes()


def test_an_attribute_that_there_is_not_is_one_line_with_those_there_are(tmp_path):
    file, _ = heated(tmp_path)
    for outputs in ("attribute:haet", "color,attribute:haet"):
        result = run("render", file, "-o", tmp_path / "a.png", *SMALL, "--outputs", outputs)
        assert_one_line(result, 1)
        assert "--outputs has 'attribute:haet'" in result.stderr
        assert result.stderr.endswith("; its meshes have heat\n")
    assert [place.name for place in tmp_path.iterdir()] == ["h.glb"]


def test_an_exr_holds_every_output_and_light_for_colour(tmp_path):
    openexr = optional_module("OpenEXR")
    path = tmp_path / "all.exr"
    assert run("render", CUBE, "-o", path, *SMALL, "--outputs", "color,depth").exit_code == 0
    frame = rendered(outputs=("linear", "depth"))
    with openexr.File(str(path), separate_channels=True) as file:
        channels = {name: channel.pixels.copy() for name, channel in file.channels().items()}
    assert sorted(channels) == ["A", "B", "G", "R", "Z"]
    assert np.array_equal(channels["Z"], frame.depth)
    assert np.array_equal(channels["G"], frame.linear[..., 1])
    assert [place.name for place in tmp_path.iterdir()] == ["all.exr"]


def test_help_names_every_output():
    names = (
        OUTPUTS_HELP.removeprefix("What to write, separated by commas: ")
        .removesuffix(".")
        .split(", ")
    )
    assert sorted(names) == sorted([*OUTPUTS, "attribute:NAME"])


@pytest.mark.parametrize("name", output_table.MOTION_OUTPUTS)
def test_motion_needs_an_earlier_view_which_the_command_line_does_not_have(tmp_path, name):
    for arguments in (("render", CUBE, "-o", tmp_path / "a.npz"), ("explain", CUBE)):
        result = run(*arguments, "--outputs", f"depth,{name}")
        assert_one_line(result, 2)
        assert f"{name} is found against an earlier view" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_quiet_silences_warnings_and_otherwise_they_are_one_line_each(tmp_path):
    mesh = tmp_path / "lost.obj"
    mesh.write_text("mtllib lost.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl nowhere\nf 1 2 3\n")
    (tmp_path / "lost.mtl").write_text("newmtl here\nmap_Kd lost.png\n")
    arguments = ("render", mesh, "-o", tmp_path / "a.png", "--size", "48x36")
    loud, quiet = run(*arguments), run(*arguments, "--quiet")
    assert loud.exit_code == quiet.exit_code == 0
    assert loud.stderr.startswith("warning: ")
    assert loud.stderr.count("\n") == 1
    assert quiet.output == ""


@pytest.mark.filterwarnings("always::UserWarning")
def test_an_open_mesh_that_is_cut_is_warned_of_in_one_line(tmp_path):
    mesh = tmp_path / "open.obj"
    mesh.write_text("v 0 0 0\nv 2 0 0\nv 0 2 0\nf 1 2 3\n")
    arguments = ("render", mesh, "-o", tmp_path / "a.png", "--size", "48x36", "--section", "x=1")
    known = warnings.showwarning
    loud, quiet = run(*arguments), run(*arguments, "--quiet")
    assert loud.exit_code == quiet.exit_code == 0
    assert loud.stderr.splitlines() == [
        "warning: 'open.obj' is cut by a section, but its mesh is not closed: it is drawn without "
        "a cap"
    ]
    assert quiet.output == ""
    assert warnings.showwarning is known


def test_an_empty_view_is_warned_of(tmp_path):
    view = ("--position", "0,0,9", "--target", "0,0,99")
    result = run("render", CUBE, "-o", tmp_path / "a.png", "--size", "48x36", *view)
    assert result.exit_code == 0
    assert "warning: nothing is in view" in result.stderr


# Bad input

BAD_OPTIONS = [
    ("--size", "0x5"),
    ("--size", "5x16385"),
    ("--size", "-5x5"),
    ("--size", "99999999999x5"),
    ("--size", "wide"),
    ("--position", "1,2"),
    ("--position", "1,2,nan"),
    ("--position", "1,2,3", "--azimuth", "4"),
    ("--position", "0,9,0", "--target", "0,0,0", "--up", "0,1,0"),
    ("--position", "1,2,3", "--target", "1,2,3"),
    ("--target", "1,2,3"),
    ("--up", "0,0,0"),
    ("--fov", "0"),
    ("--fov", "180"),
    ("--fov", "nan"),
    ("--zoom", "0"),
    ("--azimuth", "inf"),
    ("--elevation", "91"),
    ("--projection", "fisheye"),
    ("--projection", "orthographic", "--fov", "40"),
    ("--background", "mauve-ish"),
    ("--wireframe", "maybe"),
    ("--wireframe-color", "#12"),
    ("--cull", "left"),
    ("--shading", "toon"),
    ("--outputs", "color,colour"),
    ("--outputs", ""),
    ("--outputs", "uv"),
    ("--threads", "0"),
    ("--scale", "0"),
    ("--scale", "inf"),
    ("--depth", "depth.jpg"),
    ("--depth", "nowhere/depth.png"),
    ("--on-invalid", "ignore"),
    ("--nonsense",),
]


@pytest.mark.parametrize("options", BAD_OPTIONS, ids=" ".join)
def test_a_bad_option_is_one_line_and_leaves_the_old_picture(tmp_path, options):
    path = tmp_path / "old.png"
    path.write_bytes(b"an old picture")
    assert_one_line(run("render", CUBE, "-o", path, "--size", "9x9", *options), 1, 2)
    assert path.read_bytes() == b"an old picture"
    assert [place.name for place in tmp_path.iterdir()] == ["old.png"]


@pytest.mark.parametrize("name", ["a.xyz", "a", "nowhere/a.png", "a.mp4"])
def test_a_bad_output_is_wrong_usage(tmp_path, name):
    assert_one_line(run("render", CUBE, "-o", tmp_path / name), 2)
    assert list(tmp_path.iterdir()) == []


def test_two_results_in_one_file_are_wrong_usage(tmp_path):
    path = tmp_path / "a.npz"
    assert_one_line(run("render", CUBE, "-o", path, "--depth", path), 2)


BAD_FILES = {
    "empty.obj": "",
    "no_vertices.obj": "# nothing but a name\no cube\n",
    "past_the_end.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n",
    "negative.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n",
    "nan.obj": TRIANGLE.replace("v 1", "v nan"),
    "infinite.obj": TRIANGLE.replace("v 1", "v inf"),
    "noise.ply": "ply\nnot really\n",
    "text.txt": "hello",
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_file_is_one_line_that_names_it(tmp_path, name):
    path = write(tmp_path, name, BAD_FILES[name])
    result = run("render", path, "-o", tmp_path / "a.png", "--size", "9x9")
    assert_one_line(result, 1)
    assert name in result.stderr
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize("command", ["render", "turntable", "explain"])
def test_a_missing_file_is_one_line_that_names_it(tmp_path, command):
    output = () if command == "explain" else ("-o", tmp_path / "a.gif")
    result = run(command, tmp_path / "missing.obj", *output)
    assert_one_line(result, 1)
    assert "missing.obj" in result.stderr


def test_a_folder_is_no_file(tmp_path):
    assert_one_line(run("render", tmp_path, "-o", tmp_path / "a.png"), 2)
    assert_one_line(run("info", tmp_path), 1)
    assert list(tmp_path.iterdir()) == []


def test_faces_with_nan_can_be_dropped(tmp_path):
    text = TRIANGLE + "v nan 0 0\nf 1 2 4\n"
    path = write(tmp_path, "some_nan.obj", text)
    result = run("render", path, "-o", tmp_path / "a.png", "--size", "9x9", "--on-invalid", "drop")
    assert result.exit_code == 0, result.output
    assert (iio.imread(tmp_path / "a.png")[:, :, 0] < 255).any()


@pytest.mark.parametrize("options", [[], ["--azimuth", "30"]])
def test_coordinates_beyond_what_cameras_reach_are_told_with_the_file(tmp_path, options):
    path = tmp_path / "far.obj"
    path.write_text("v 0 0 0\nv 1e308 0 0\nv 0 1e308 0\nf 1 2 3\n")
    result = run("render", path, "-o", tmp_path / "a.png", "--size", "9x9", *options)
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1].startswith(f"error: {path}: scene")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("command", ["render", "explain", "turntable"])
@pytest.mark.filterwarnings("error")
def test_coordinates_whose_distances_overflow_are_told_with_the_file(tmp_path, command):
    (tmp_path / "both.obj").write_text("v -1.7e308 0 0\nv 1.7e308 0 0\nv 0 1.7e308 0\nf 1 2 3\n")
    positions = np.array([(0, 0, 0), (3e38, 0, 0), (0, 3e38, 0)], np.float32)
    (tmp_path / "a.bin").write_bytes(positions.tobytes())
    document = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [1e300] * 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": "a.bin"}],
    }  # fmt: skip
    (tmp_path / "scaled.gltf").write_text(json.dumps(document))
    for name in ("both.obj", "scaled.gltf"):
        words = [] if command == "explain" else ["-o", tmp_path / "a.gif"]
        result = run(command, tmp_path / name, *words, "--size", "16x16")
        assert result.exit_code == 1
        assert result.stderr.startswith(f"error: {tmp_path / name}: scene's "), result.stderr


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (MemoryError(), 1, "not enough memory"),
        (OSError(28, "No space left on device", "a.png"), 1, "a.png: No space left on device"),
        (ValueError("two\nlines"), 1, "two lines"),
        (ZeroDivisionError("oops"), 1, "ZeroDivisionError: oops (--debug shows where)"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_whatever_happens_while_saving_the_old_picture_survives(
    tmp_path, monkeypatch, error, code, text
):
    def fail(*arguments):
        raise error

    path = tmp_path / "old.png"
    path.write_bytes(b"an old picture")
    monkeypatch.setattr("rasterjit.io.images._write_pixels", fail)
    result = run("render", CUBE, "-o", path, "--size", "9x9")
    assert result.exit_code == code
    assert result.stderr.splitlines()[-1] == f"error: {text}"
    assert path.read_bytes() == b"an old picture"
    assert [place.name for place in tmp_path.iterdir()] == ["old.png"]


@pytest.mark.parametrize("before", [True, False])
def test_debug_shows_the_traceback_wherever_it_stands(tmp_path, before):
    words = ["render", str(tmp_path / "missing.obj"), "-o", str(tmp_path / "a.png")]
    result = run(*(["--debug", *words] if before else [*words, "--debug"]))
    assert result.exit_code == 1
    assert isinstance(result.exception, ValueError)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("turntable", CUBE, "-o", "a.gif", "--fps", 60), "--fps must be in 1..50 for .gif"),
        (("turntable", CUBE, "-o", "a.mp4", "--size", "9x10"), "--size must have even sides"),
        (("render", MODELS / "scene.glb", "-o", "a.png", "--samples", "area"), "--samples must be"),
        (("render", CUBE, "-o", "a.png", "--outputs", "uv"), "--outputs has 'uv'"),
        (
            ("render", CUBE, "-o", "a.png", "--environment", "no.hdr"),
            "--environment must be a file",
        ),
        (("render", CUBE, "-o", "a.png", "--position", "1,2,3", "--target", "1,2,3"), "--position"),
        (("render", CUBE, "-o", "a.png", "--position", "0,0,0"), "--position is the middle"),
        (("render", CUBE, "-o", "a.png", "--position", "0,9,0", "--up", "0,1,0"), "--up must not"),
        (("render", CUBE, "-o", "a.png", "--wireframe-color", "transparent"), "--wireframe-color"),
        (("render", CUBE, "-o", "a.png", "--outline", "#ff000080"), "--outline"),
        (("view", CUBE, "--backend", "terminal"), "--backend must not be 'terminal'"),
        (("view", CUBE, "--backend", "terminal", "--size", "9x9"), "--size has no effect here"),
    ],
)
def test_errors_are_about_options_not_arguments(tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    result = run(*words)
    assert_one_line(result, 1, 2)
    assert said in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (("render", CUBE, "--transparent"), "--background transparent"),
        (("render", CUBE, "--width", "640"), "--size WxH"),
        (("render", CUBE, "--ortho"), "--projection orthographic"),
        (("render", CUBE, "--azimut", "3"), "--azimuth"),
        (("render", CUBE, "-w", "3"), "--size WxH"),
        (("render", CUBE, "--projection", "ortho"), "orthographic"),
        (("render", CUBE, "--shading", "phng"), "phong"),
        (("render", CUBE, "--outputs", "color,normals"), "normal"),
        (("render", CUBE, "--outputs", "dept"), "depth"),
        (("dataset", CUBE, "--cameras", "rign"), "ring"),
        (("rendr", CUBE), "render"),
        (("show", CUBE), "view"),
        (("version",), "--version"),
    ],
)
def test_what_may_have_been_meant_is_asked(words, meant):
    result = run(*words)
    assert_one_line(result, 2)
    before, asked, question = result.stderr.partition("; did you mean ")
    assert asked
    assert question == f"{meant}?\n"
    assert before[-1] not in ".,;:"


def test_an_option_of_another_command_is_told_and_nonsense_is_not():
    assert run("render", CUBE, "--fps", "3").stderr.endswith("; turntable has it\n")
    assert run("render", CUBE, "--qqqqqq").stderr == "error: No such option --qqqqqq\n"


def test_advice_names_options_that_there_are():
    commands_ = commands.program.commands.values()
    own = {name for command in commands_ for one in command.params for name in one.opts}
    for name, other in help.OPTION_SYNONYMS.items():
        assert name not in own, name
        assert not other.startswith("-") or other.split()[0] in own, other
    assert set(help.COMMAND_SYNONYMS) & set(commands.program.commands) == set()
    for other in help.COMMAND_SYNONYMS.values():
        assert other.startswith("--") or other in commands.program.commands


def test_another_name_for_a_choice_stands_for_one_where_it_is_none_itself():
    parameters = [one for command in commands.program.commands.values() for one in command.params]
    lists = [one.type.choices for one in parameters if isinstance(one.type, click.Choice)]
    lists += [LIGHT_NAMES, tuple(output_table.OUTPUTS)]
    for name, other in help.CHOICE_SYNONYMS.items():
        assert any(other in choices and name not in choices for choices in lists), name


CUT_SHORT = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2\n"


@pytest.mark.parametrize(
    ("text", "advice", "words"),
    [
        (CUT_SHORT, "--on-damage warn", ()),
        (TRIANGLE.replace("v 1", "v nan"), "--on-invalid drop", ("--on-damage", "warn")),
        (TRIANGLE, "--max-bytes 9", ("--max-bytes", 9)),
        (TRIANGLE, "--max-bytes must be a whole number above 0", ("--max-bytes", 0)),
        (TRIANGLE, "--resource-root must", ("--resource-root", "nowhere")),
    ],
)
def test_errors_name_options_where_the_library_names_arguments(tmp_path, text, advice, words):
    path = write(tmp_path, "a.obj", text)
    result = run("render", path, "-o", tmp_path / "a.png", "--size", "9x9", *words)
    assert_one_line(result, 1)
    assert advice in result.stderr
    for argument in ("on_damage", "on_invalid", "max_bytes", "resource_root"):
        assert argument not in result.stderr


# Turntable


@pytest.mark.parametrize("suffix", [".gif", ".webp", ".apng", ".mp4"])
def test_a_turntable_has_its_frames(tmp_path, suffix):
    path = tmp_path / f"turn{suffix}"
    result = run("turntable", KNOT, "-o", path, "--frames", 5, "--fps", 10, *SMALL)
    assert (result.exit_code, result.output) == (0, "")
    if suffix == ".mp4":
        assert imageio_ffmpeg.count_frames_and_secs(path) == (5, 0.5)
    else:
        with Image.open(path) as animation:
            assert (animation.n_frames, animation.size) == (5, SIZE)
            assert animation.info.get("loop") == 0
            shown = {frame.convert("RGB").tobytes() for frame in ImageSequence.Iterator(animation)}
        assert len(shown) == 5
    assert [place.name for place in tmp_path.iterdir()] == [path.name]


def test_a_webp_turntable_shows_what_a_steady_camera_shows(tmp_path):
    path = tmp_path / "turn.webp"
    run("turntable", CUBE, "-o", path, "--frames", 4, "--azimuth", 10, "--elevation", 5, *SMALL)
    with Image.open(path) as animation:
        animation.seek(1)
        second = np.array(animation.convert("RGB"))
    camera = rj.fit_camera(
        rj.load(CUBE), rj.orbit_direction(100.0, 5.0), up=rj.orbit_direction(100.0, 95.0),
        aspect=SIZE[0] / SIZE[1], steady=True,
    )  # fmt: skip
    assert np.array_equal(second, rendered(camera).color[:, :, :3])


def test_a_transparent_gif_is_transparent_around_the_mesh(tmp_path):
    path = tmp_path / "turn.gif"
    run("turntable", CUBE, "-o", path, "--frames", 3, "--background", "transparent", *SMALL)
    with Image.open(path) as animation:
        for frame in ImageSequence.Iterator(animation):
            alpha = np.array(frame.convert("RGBA"))[:, :, 3]
            assert set(np.unique(alpha)) == {0, 255}
            assert alpha[0, 0] == 0
            assert alpha[SIZE[1] // 2, SIZE[0] // 2] == 255


@pytest.mark.parametrize(
    "options",
    [
        ("-o", "a.png"),
        ("-o", "nowhere/a.gif"),
        ("-o", "a.gif", "--frames", "0"),
        ("-o", "a.gif", "--fps", "60"),
        ("-o", "a.mp4", "--size", "9x10"),
        ("-o", "a.mp4", "--background", "transparent"),
        ("-o", "a.gif", "--position", "1,2,3"),
    ],
    ids=" ".join,
)
def test_a_bad_turntable_is_one_line(tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    assert_one_line(run("turntable", CUBE, *options), 1, 2)
    assert list(tmp_path.iterdir()) == []


def test_mp4_without_ffmpeg_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    result = run("turntable", CUBE, "-o", tmp_path / "a.mp4")
    assert_one_line(result, 1)
    assert 'pip install "rasterjit[video]"' in result.stderr


@pytest.mark.parametrize("suffix", [".gif", ".webp", ".apng", ".mp4"])
def test_a_turntable_that_fails_leaves_the_old_animation(tmp_path, monkeypatch, suffix):
    calls = []

    def fail_later(*arguments, **options):
        calls.append(arguments)
        if len(calls) == 3:
            raise ValueError("no more")
        return original(*arguments, **options)

    original = rj.Renderer.render
    monkeypatch.setattr(rj.Renderer, "render", fail_later)
    path = tmp_path / f"old{suffix}"
    path.write_bytes(b"an old animation")
    assert_one_line(run("turntable", CUBE, "-o", path, *SMALL), 1)
    assert path.read_bytes() == b"an old animation"
    assert [place.name for place in tmp_path.iterdir()] == [path.name]


# The other commands


def test_explain_prints_the_plan():
    result = run("explain", CUBE, "--outputs", "depth", "--wireframe", "only")
    assert result.exit_code == 0
    assert "no output shows colour" in result.stdout
    assert "tile_rasterizer.draw_tiles" in result.stdout
    assert "output depth" in result.stdout


def test_explain_measures_stages_and_effects():
    view = ("--size", "48x36", "--wireframe", "overlay", "--threads", "1")
    result = run("explain", CUBE, *view, "--measure")
    assert result.exit_code == 0, result.output
    cells = [
        [cell.strip() for cell in line.strip("│┃").replace("┃", "│").split("│")]
        for line in result.stdout.splitlines()
    ]
    times = {row[0]: row[1] for row in cells if len(row) == 2}
    assert {"visibility", "shade, resolve", "wireframe", "frame"} <= set(times)
    changes = {tuple(row[:2]) for row in cells if len(row) == 4}
    assert {("wireframe", "off"), ("anti-aliasing", "4 samples")} <= changes
    assert_one_line(run("explain", CUBE, "--pixel", "3,4", "--measure"), 2)


def test_diagnose_prints_what_the_frame_says(tmp_path):
    plain = run("render", CUBE, "-o", tmp_path / "a.png", "--size", "48x36")
    asked = run("render", CUBE, "-o", tmp_path / "b.png", "--size", "48x36", "--diagnose")
    assert asked.exit_code == 0, asked.output
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    cells = [
        tuple(cell.strip() for cell in line.strip("│").split("│"))
        for line in asked.stdout.splitlines()
    ]
    rows = [(name.strip(), text) for name, text in rendered(diagnose=True).diagnostics.rows()]
    assert set(rows) <= set(cells)
    assert rows[-1][0] not in plain.stdout
    silent = run("render", CUBE, "-o", tmp_path / "c.png", *SMALL, "--diagnose")
    assert (silent.exit_code, silent.output) == (0, "")


def test_explain_pixel_prints_what_the_library_says():
    view = ("--size", "48x36", "--azimuth", "20", "--cull", "back", "--background", "#123456")
    result = run("explain", CUBE, "--pixel", "20,18", *view)
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("pixel (20, 18) of 48 x 36")
    assert "shows face" in result.stdout
    scene = rj.load(CUBE)
    camera = CameraOptions(azimuth=20.0).camera(scene, SIZE)
    told = rj.explain_pixel(scene, camera, SIZE, 20, 18, cull="back", background="#123456")
    assert result.stdout == f"{told}\n"


@pytest.mark.parametrize("pixel", ["48,0", "0,36", "-1,0", "1", "1,2,3", "a,b", "1.5,2"])
def test_a_pixel_outside_the_picture_is_wrong_usage(pixel):
    assert_one_line(run("explain", CUBE, "--size", "48x36", f"--pixel={pixel}"), 2)


# Compiling


def say_that_something_compiles():
    for tell in tuple(store.BEFORE_COMPILING):
        tell()


@pytest.fixture
def impatient(monkeypatch):
    """Compiling that is told of at once; every picture compiles."""
    monkeypatch.setattr(progress, "MIN_SECONDS", 0.0)
    run_visibility = drawing.run_visibility

    def compile_and_find(*arguments, **options):
        say_that_something_compiles()
        return run_visibility(*arguments, **options)

    monkeypatch.setattr(drawing, "run_visibility", compile_and_find)


@pytest.mark.parametrize("is_kept", [True, False])
def test_compiling_that_goes_on_is_told_once(impatient, monkeypatch, capsys, is_kept):
    monkeypatch.setattr(store, "kernel_folder", lambda: Path("/cache") if is_kept else None)
    monkeypatch.setattr(background_compile, "can_start_process", lambda: False)
    with report.show_compile_progress(quiet=False), background_compile.compile_in_background(list):
        say_that_something_compiles()
        say_that_something_compiles()
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == said.err.count("compiling kernels") == 1
    assert ("(kept on disk)" in said.err) == is_kept


def test_a_line_on_a_terminal_says_how_far_the_compiler_is(impatient, monkeypatch, capsys):
    used, said = store.UsedKernels([], []), []
    monkeypatch.setattr(store, "USED_KERNELS", used)
    monkeypatch.setattr(background_compile, "can_start_process", lambda: False)
    line = SimpleNamespace(status="Rendering", update=said.append)
    with (
        report.show_compile_progress(quiet=False, shown=line),
        background_compile.compile_in_background(list),
    ):
        say_that_something_compiles()
        used.compiled.append("a.b")
        say_that_something_compiles()
    counts = [text.partition(", ")[0] for text in said]
    assert counts == [
        "Rendering: compiling kernels .......... 0 of 0",
        "Rendering: compiling kernels ########## 1 of 1",
        "Rendering",
    ]
    assert capsys.readouterr() == ("", "")


def test_a_line_on_a_terminal_says_how_many_pictures_are_drawn(monkeypatch, tmp_path):
    clock, said = [0.0], []
    monkeypatch.setattr(report.time, "monotonic", lambda: clock[0])
    line = SimpleNamespace(status="Rendering", update=said.append)
    with report.show_compile_progress(quiet=False, shown=line):
        for done in (1, 2, 16):
            clock[0] += 1.0
            progress.PICTURE_COUNTERS[-1](done, 64)
        clock[0] += 1.0
        rj.render(rj.load(CUBE), size=(8, 6), quality=rj.Quality(samples=64), threads=1)
    assert said[0] == "Rendering: ##........ 16 of 64, 2 s, 6 s left"
    assert said[1:] == [f"Rendering: {progress.format_bar(n, 64, 3.0)}" for n in range(1, 65)]
    assert progress.PICTURE_COUNTERS == []
    with report.show_compile_progress(quiet=False):
        progress.PICTURE_COUNTERS[-1](1, 64)


def test_compiling_that_is_soon_done_is_not_told(monkeypatch, capsys):
    with report.show_compile_progress(quiet=False), background_compile.compile_in_background(list):
        say_that_something_compiles()
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("command", "is_told"),
    [
        (("render", CUBE, "-o", "a.png", "--size", "8x6"), True),
        (("render", CUBE, "-o", "a.png", "--size", "8x6", "--quiet"), False),
        (("turntable", CUBE, "-o", "a.gif", "--size", "8x6", "--frames", "2"), True),
        (("turntable", CUBE, "-o", "a.gif", "--size", "8x6", "--frames", "2", "-q"), False),
        (("explain", CUBE, "--size", "8x6", "--pixel", "4,3"), True),
        (("explain", CUBE, "--size", "8x6", "--measure"), True),
        (("explain", CUBE, "--size", "8x6"), False),
    ],
)
def test_every_command_that_renders_tells_of_compiling_unless_quiet(
    impatient, monkeypatch, tmp_path, command, is_told
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(profile, "list_variations", lambda *arguments: [])
    result = run(*command)
    assert result.exit_code == 0, result.output
    assert result.stderr.count("compiling kernels") == is_told
    assert "compiling" not in result.stdout


def test_version_and_help_and_unknown_commands():
    assert run("--version").stdout == f"rasterjit {rj.__version__}\n"
    assert run().stdout == run("--help").stdout
    for command in commands.program.commands:
        told = run(command, "--help")
        assert told.exit_code == 0
        assert "None]" not in told.output
    assert_one_line(run("frobnicate"), 2)
    assert_one_line(run("render"), 2)


def test_python_m_rasterjit_is_the_command_line():
    done = subprocess.run(
        [sys.executable, "-m", "rasterjit", "--version"],
        capture_output=True, text=True, check=True, cwd=MODELS.parent,
    )  # fmt: skip
    assert done.stdout == f"rasterjit {rj.__version__}\n"


@needs_store
def test_warmup_shows_progress_and_names_the_folder(monkeypatch):
    told = []
    monkeypatch.setattr(warmup, "compile_all", lambda tell: told.extend([tell(0, 2), tell(1, 2)]))
    result = run("warmup")
    assert result.exit_code == 0, result.output
    assert told == [None, None]
    assert result.stderr == "Compiling kernels (2 to do)\n"
    assert f"entries in {store.kernel_folder()}" in result.stdout
    assert run("warmup", "--quiet").output == ""


@pytest.mark.parametrize("variable", ["DISABLED", "CHECKED"])
def test_warmup_has_nothing_to_do_where_nothing_is_kept(monkeypatch, variable):
    monkeypatch.setattr(jit, variable, True)
    assert_one_line(run("warmup"), 1)


def test_warmup_without_a_folder_says_how_to_name_one(monkeypatch):
    monkeypatch.setattr(jit, "DISABLED", False)
    monkeypatch.setattr(jit, "CHECKED", False)
    monkeypatch.setattr(store, "kernel_folder", lambda: None)
    result = run("warmup")
    assert_one_line(result, 1)
    assert "RASTERJIT_CACHE_DIR" in result.stderr


def test_a_format_without_alpha_refuses_a_transparent_background(tmp_path):
    out = tmp_path / "a.jpg"
    result = run("render", CUBE, "-o", out, "--background", "transparent", "--size", "8x8")
    assert result.exit_code == 2
    assert "--background" in result.stderr
    assert not out.exists()


def test_a_view_straight_down_needs_no_up(tmp_path):
    out = tmp_path / "a.png"
    result = run("render", CUBE, "-o", out, "--position", "0,9,0", "--target", "0,0,0",
                 "--size", "16x12", "--quiet")  # fmt: skip
    assert result.exit_code == 0, result.stderr
    assert (iio.imread(out)[..., :3] != 255).any()


def test_a_wireframe_color_alone_draws_the_overlay(tmp_path):
    pictures = []
    for options in (("--wireframe-color", "red"), ("--wireframe", "overlay", "--wireframe-color",
                    "red"), ()):  # fmt: skip
        out = tmp_path / "a.png"
        assert run("render", CUBE, "-o", out, "--size", "24x16", *options).exit_code == 0
        pictures.append(iio.imread(out).tobytes())
    assert pictures[0] == pictures[1] != pictures[2]


STL = """solid one
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 0 1 0
endloop
endfacet
endsolid one
"""
OFF = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


@pytest.mark.parametrize("name", ["teapot.obj", "cube.ply", "scene.glb", "one.stl", "one.off"])
def test_a_command_imports_neither_a_compiler_nor_what_a_frame_does_not_need(tmp_path, name):
    file = Path(rj.__file__).parent.parent / "models" / name
    if name in ("one.stl", "one.off"):
        file = tmp_path / name
        file.write_text(STL if name == "one.stl" else OFF)
    arguments = ["render", str(file), "-o", str(tmp_path / "a.png"), "--size", "16x12"]
    # Whatever this picture needs is compiled now.
    assert run(*arguments).exit_code == 0
    (tmp_path / "a.png").unlink()
    unused = ("numba", "trimesh", "scipy", "networkx", "imageio", "matplotlib")
    script = (
        "import sys; from rasterjit.cli import main\n"
        "try: main()\n"
        f"finally: print([name for name in {unused} if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
    assert (tmp_path / "a.png").exists()
