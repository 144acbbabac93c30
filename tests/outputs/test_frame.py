"""Frames hold what was asked for, say so when it was not, and can be saved."""

from __future__ import annotations

import imageio.v3 as iio
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.outputs.output_table import OUTPUTS, TABLE

SIZE = (24, 16)
TYPES = {
    "color": (np.uint8, (4,)), "linear": (np.float32, (4,)), "depth": (np.float32, ()),
    "face_id": (np.int32, ()), "object_id": (np.int32, ()), "barycentric": (np.float32, (3,)),
    "uv": (np.float32, (2,)), "normal": (np.float32, (3,)), "position": (np.float32, (3,)),
    "distance": (np.float32, ()), "object_position": (np.float32, (3,)), "nocs": (np.float32, (3,)),
    "geometric_normal": (np.float32, (3,)), "material_id": (np.int32, ()),
    "instance_id": (np.int32, ()), "coverage": (np.float32, ()), "motion": (np.float32, (2,)),
    "motion_visible": (np.bool_, ()), "normal_camera": (np.float32, (3,)),
    "position_camera": (np.float32, (3,)), "scalar": (np.float32, ()),
}  # fmt: skip
SAME = rj.PreviousView()
"""Nothing has moved."""


@pytest.fixture
def mesh(cube):
    scalars = cube.vertices[:, 2]
    return rj.Mesh(cube.vertices, cube.faces, uv=cube.vertices[:, :2], scalars=scalars)


@pytest.mark.parametrize("output", OUTPUTS)
def test_each_output_has_its_shape_and_type(mesh, camera, output):
    frame = rj.render(mesh, camera, size=SIZE, outputs=output, previous=SAME, threads=1)
    dtype, channels = TYPES[output]
    array = getattr(frame, output)
    assert array.dtype == dtype
    assert array.shape == (SIZE[1], SIZE[0], *channels)
    assert list(frame.arrays()) == [output]


@pytest.mark.parametrize("output", OUTPUTS)
def test_output_that_was_not_asked_for_is_named(mesh, camera, output):
    other = "depth" if output != "depth" else "color"
    frame = rj.render(mesh, camera, size=SIZE, outputs=other, threads=1)
    with pytest.raises(rj.OutputNotRequestedError, match=output) as error:
        getattr(frame, output)
    assert other in str(error.value)
    assert isinstance(error.value, ValueError)
    assert not hasattr(frame, output)


def test_one_output_does_not_change_another(mesh, camera):
    everything = rj.render(
        mesh, camera, size=SIZE, outputs=OUTPUTS, previous=SAME, threads=1
    ).arrays()
    for output in OUTPUTS:
        alone = rj.render(
            mesh, camera, size=SIZE, outputs=output, previous=SAME, threads=1
        ).arrays()
        assert alone[output].tobytes() == everything[output].tobytes()


def test_arrays_are_the_callers(mesh, camera):
    with rj.Renderer(SIZE, threads=1) as renderer:
        first = renderer.render(mesh, camera, outputs=OUTPUTS, previous=SAME)
        copies = {name: array.copy() for name, array in first.arrays().items()}
        for array in first.arrays().values():
            assert array.flags.writeable
        other = rj.PerspectiveCamera((0, 0, 9), (0, 0, 0))
        renderer.render(mesh, other, outputs=OUTPUTS, previous=SAME)
    for name, array in first.arrays().items():
        assert array.tobytes() == copies[name].tobytes()


def test_outputs_agree_about_what_is_covered(mesh, camera):
    frame = rj.render(
        mesh, camera, size=SIZE, outputs=OUTPUTS, background="transparent", previous=SAME, threads=1
    )
    hit = frame.face_id >= 0
    assert hit.any()
    assert not hit.all()
    assert (np.isfinite(frame.depth) == hit).all()
    assert ((frame.object_id == 0) == hit).all()
    assert ((frame.object_id == -1) == ~hit).all()
    assert ((frame.color[..., 3] == 255) == hit).all()
    assert (frame.color[~hit] == 0).all()
    for name in ("uv", "position", "position_camera", "object_position", "nocs", "motion"):
        assert (np.isfinite(getattr(frame, name)).all(axis=2) == hit).all(), name
    for name in ("distance", "depth", "scalar"):
        assert (np.isfinite(getattr(frame, name)) == hit).all(), name
    for name in ("material_id", "instance_id"):
        assert ((getattr(frame, name) >= 0) == hit).all(), name
    for name in ("coverage", "motion_visible"):
        assert (getattr(frame, name) == hit).all(), name
    assert frame.stats.pixels_covered == hit.sum()


def test_save_as_arrays(mesh, camera, tmp_path):
    frame = rj.render(mesh, camera, size=SIZE, outputs=("color", "depth", "face_id"), threads=1)
    frame.save(tmp_path / "frame.npz")
    with np.load(tmp_path / "frame.npz") as stored:
        assert sorted(stored.files) == ["color", "depth", "face_id"]
        for name, array in frame.arrays().items():
            assert stored[name].dtype == array.dtype
            assert stored[name].tobytes() == array.tobytes()


def test_save_as_image(mesh, camera, tmp_path):
    frame = rj.render(mesh, camera, size=SIZE, background="transparent", threads=1)
    frame.save(tmp_path / "frame.png")
    stored = iio.imread(tmp_path / "frame.png")
    assert stored.tobytes() == frame.color.tobytes()
    frame.save(str(tmp_path / "again.png"))
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "frame.png").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again.png", "frame.png"]


def test_a_transparent_frame_is_no_jpeg(mesh, camera, tmp_path):
    scene = rj.Scene()
    scene.add(mesh)
    for background, is_refused in (("transparent", True), ((1, 1, 1, 0.5), True), ("white", False)):
        frame = rj.render(scene, camera, size=(32, 24), background=background, threads=1)
        if not is_refused:
            frame.save(tmp_path / "a.jpg")
            assert (iio.imread(tmp_path / "a.jpg")[0, 0] >= 250).all()
            continue
        with pytest.raises(ValueError, match=r"a\.jpg.*knows no transparency.*background='white'"):
            frame.save(tmp_path / "a.jpg")
        assert not list(tmp_path.iterdir())
        frame.save(tmp_path / "a.png")
        assert np.array_equal(iio.imread(tmp_path / "a.png"), frame.color)
        (tmp_path / "a.png").unlink()


def test_what_cannot_be_saved_is_an_error(mesh, camera, tmp_path):
    frame = rj.render(mesh, camera, size=SIZE, threads=1)
    with pytest.raises(ValueError, match="folder"):
        frame.save(tmp_path / "missing" / "frame.png")
    with pytest.raises(ValueError, match="xyz"):
        frame.save(tmp_path / "frame.xyz")
    depth = rj.render(mesh, camera, size=SIZE, outputs="depth", threads=1)
    with pytest.raises(ValueError, match="color"):
        depth.save(tmp_path / "frame.png")
    assert list(tmp_path.iterdir()) == []


def test_notebook_shows_the_colour(mesh, camera):
    frame = rj.render(mesh, camera, size=SIZE, threads=1)
    data = frame._repr_png_()
    assert data.startswith(b"\x89PNG")
    assert iio.imread(data).tobytes() == frame.color.tobytes()
    assert rj.render(mesh, camera, size=SIZE, outputs="depth", threads=1)._repr_png_() is None


def test_frame_says_what_it_is(mesh, camera):
    frame = rj.render(mesh, camera, size=SIZE, outputs=("color", "depth"), threads=1)
    assert repr(frame) == "Frame(24 x 16: color, depth)"


def test_stats_count_every_triangle(mesh, camera):
    stats = rj.render(mesh, camera, size=SIZE, cull="back", threads=1).stats
    parts = stats.outside, stats.culled, stats.degenerate, stats.unsampled, stats.invalid
    assert sum(parts) + stats.drawn == stats.triangles_in == 12
    assert stats.drawn == 6
    assert stats.culled == 6
    assert stats.clipped == 0
    assert all(seconds >= -1e-6 for seconds in stats.seconds.values())
    assert {"compile", "plan", "transform", "visibility", "shade, resolve"} <= set(stats.seconds)


@pytest.mark.parametrize("outputs", [("color",), ("face_id", "color")])
def test_covered_pixels_are_those_of_the_frame_as_it_was_drawn(mesh, camera, outputs):
    with rj.Renderer(SIZE, threads=1) as renderer:
        frame = renderer.render(mesh, camera, outputs=outputs)
        expected = rj.render(mesh, camera, size=SIZE, outputs="face_id", threads=1).face_id >= 0
        # Neither another frame nor the caller changes what this one counts.
        renderer.render(mesh, rj.PerspectiveCamera((0, 0, 99), (0, 0, 0)))
        for array in frame.arrays().values():
            array[:] = 0
        assert frame.stats.pixels_covered == frame.stats.pixels_covered == expected.sum()
    assert f"clipped=0, pixels_covered={expected.sum()}, seconds=" in repr(frame.stats)


def test_outputs_are_saved_by_name(mesh, camera, tmp_path):
    names = ("color", "depth", "object_id", "normal")
    frame = rj.render(mesh, camera, size=SIZE, outputs=names, threads=1)
    frame.save(tmp_path / "some.npz", ("depth", "object_id"))
    with np.load(tmp_path / "some.npz") as stored:
        assert sorted(stored) == ["depth", "object_id"]
    frame.save(tmp_path / "depth.npy", "depth")
    assert np.array_equal(np.load(tmp_path / "depth.npy"), frame.depth)
    frame.save(tmp_path / "depth.png", "depth", scale=0.001)
    expected = np.where(np.isfinite(frame.depth), np.floor(frame.depth * 1e3 + 0.5), 0)
    assert abs(iio.imread(tmp_path / "depth.png") - expected).max() <= 1
    frame.save(tmp_path / "id.png", "object_id")
    assert np.array_equal(iio.imread(tmp_path / "id.png"), frame.object_id + 1)
    frame.save(tmp_path / "color.png", "color")
    assert np.array_equal(iio.imread(tmp_path / "color.png"), frame.color)
    frame.save(tmp_path / "color.tif", "color")
    assert np.array_equal(iio.imread(tmp_path / "color.tif"), frame.color)


@pytest.mark.parametrize(
    ("name", "outputs", "scale", "named"),
    [
        ("a.jpg", "depth", None, "depth"), ("a.png", "face_id", None, "face_id"),
        ("a.npz", 7, None, "outputs"), ("a.npz", (), None, "outputs"),
        ("a.jpg", None, 2.0, "scale"), ("a.png", None, 2.0, "scale"), ("a.png", [7], None, "7"),
    ],
)  # fmt: skip
def test_what_a_file_cannot_hold_is_an_error(mesh, camera, tmp_path, name, outputs, scale, named):
    frame = rj.render(mesh, camera, size=SIZE, outputs=("color", "depth"), threads=1)
    with pytest.raises(ValueError, match=named):
        frame.save(tmp_path / name, outputs, scale=scale)
    assert list(tmp_path.iterdir()) == []


def test_each_output_has_the_channels_type_and_empty_value_of_its_row(cube, camera):
    scene = rj.Scene()
    uv, scalars = cube.vertices[:, :2], cube.vertices[:, 2]
    mesh = rj.Mesh(cube.vertices, cube.faces, uv=uv, scalars=scalars)
    scene.add(mesh)
    frame = rj.render(
        scene, camera, size=(32, 24), outputs=OUTPUTS, previous=rj.PreviousView(),
        background=(0.0, 0.0, 0.0, 0.0), threads=1,
    )  # fmt: skip
    nothing = frame.face_id < 0
    assert nothing.any()
    assert not nothing.all()
    for name, row in TABLE.items():
        array = frame.arrays()[name]
        assert array.dtype == row.dtype
        assert array.shape == (24, 32) + ((row.channels,) if row.channels > 1 else ())
        empty = np.full((), row.empty).astype(row.dtype)
        np.testing.assert_array_equal(array[nothing], np.broadcast_to(empty, array[nothing].shape))
