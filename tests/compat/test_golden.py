"""The plug-in of pytest that compares pictures with recorded ones."""

import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from rasterjit.compat.golden import DIFFERENCE_COLOR, draw_side_by_side

CONFTEST = 'pytest_plugins = ["rasterjit.compat.golden"]\n'

TEST = """
import numpy as np
import pytest
import rasterjit as rj

FACE = rj.Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]])

def scene():
    camera = rj.PerspectiveCamera(eye=(2.0, 2.0, 3.0), target=(0.0, 0.0, 0.0))
    return rj.render(FACE, camera, size=(24, 16), outputs=("color", "depth"))

def test_face(golden):
    frame = scene()
    golden(frame)
    golden(frame.depth, "depth")
    golden(np.arange(6.0))

@pytest.mark.parametrize("side", ["a/b", "c d"])
def test_sides(golden, side):
    golden(np.full((4, 5, 3), {level}, np.uint8))

def test_names(golden):
    golden(np.zeros((2, 2), np.uint8), "twice")
    with pytest.raises(ValueError, match="once in a test, got 'test_names--twice' again"):
        golden(np.zeros((2, 2), np.uint8), "twice")
    with pytest.raises(ValueError, match="name must be letters"):
        golden(np.zeros((2, 2), np.uint8), "../up")
    with pytest.raises(ValueError, match="must be a Frame or an array"):
        golden(None)
"""


def run(folder, *options):
    """Run pytest in a folder and return what it says, and its status."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "xdist"]
    done = subprocess.run(
        [*command, *options], cwd=folder, capture_output=True, text=True,
        # The other plug-ins of these tests take longer to start than all that is tested here.
        env={**os.environ, "COLUMNS": "200", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
    )  # fmt: skip
    return done.stdout, done.returncode


@pytest.mark.needs_jit
def test_pictures_are_recorded_compared_and_shown_where_they_differ(tmp_path):
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_one.py").write_text(TEST.replace("{level}", "7"))
    said, status = run(tmp_path)
    assert status == 1
    assert said.count("run pytest --golden-update") >= 4

    said, status = run(tmp_path, "--golden-update", "-n", "2")
    assert status == 0, said
    folder = tmp_path / "golden" / "test_one"
    names = sorted(path.name for path in folder.iterdir())
    assert names == [
        "test_face--3.npy", "test_face--depth.npy", "test_face.png", "test_names--twice.png",
        "test_sides-a-b.png", "test_sides-c-d.png",
    ]  # fmt: skip
    assert all(f"golden: recorded {folder / name}" in said for name in names)

    # One bit of one pixel is enough.
    with Image.open(folder / "test_face.png") as image:
        pixels = np.array(image)
    pixels[3, 4, 1] ^= 1
    Image.fromarray(pixels).save(folder / "test_face.png")
    depth = np.load(folder / "test_face--depth.npy")
    assert not np.isfinite(depth).all()
    (tmp_path / "test_one.py").write_text(TEST.replace("{level}", "8"))
    said, status = run(tmp_path)
    assert status == 1
    assert "1 of 384 pixels differ, the first at row, column (3, 4)" in said
    assert "20 of 20 pixels differ, the first at row, column (0, 0)" in said
    assert said.count("3 failed, 1 passed") == 1
    with Image.open(tmp_path / "golden-failures" / "test_one-test_face.png") as image:
        sheet = np.array(image)
    assert sheet.shape == (16, 3 * 24 + 2 * 8, 4)
    assert np.argwhere((sheet[:, 64:, :3] == DIFFERENCE_COLOR).all(axis=2)).tolist() == [[3, 4]]

    said, status = run(tmp_path, "--golden-update")
    assert status == 0
    assert said.count("golden: recorded") == 3
    assert run(tmp_path)[1] == 0


COLLIDING = """
import numpy as np
import pytest

@pytest.mark.parametrize("name", ["a b", "a-b", "c"])
def test_cell(golden, name):
    golden(np.full((4, 4, 3), len(name), np.uint8))

class TestOne:
    def test_cell(self, golden):
        golden(np.zeros((4, 4, 3), np.uint8))

class TestTwo:
    def test_cell(self, golden):
        golden(np.ones((4, 4, 3), np.uint8))
"""


@pytest.mark.parametrize("workers", ["0", "2"])
def test_two_tests_never_share_a_file(tmp_path, workers):
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_one.py").write_text(COLLIDING)
    said, status = run(tmp_path, "--golden-update", "-n", workers)
    assert status == 1
    assert "2 failed, 3 passed" in said
    assert "test_cell[a b]" in said
    assert "both have test_cell-a-b: name one of them by pytest.param(..., id=...)" in said
    recorded = sorted(path.name for path in (tmp_path / "golden" / "test_one").iterdir())
    assert recorded == ["TestOne-test_cell.png", "TestTwo-test_cell.png", "test_cell-c.png"]


def test_differences_of_other_sizes_and_of_floats_are_shown():
    small, large = np.zeros((2, 3), np.uint8), np.full((4, 5, 3), 9, np.uint8)
    assert draw_side_by_side(small, large).shape == (4, 3 + 8 + 5, 4)
    assert draw_side_by_side(np.arange(3.0), np.arange(3.0)) is None
    depth = np.array([[1.0, np.inf], [np.nan, 3.0]])
    nearer = depth.copy()
    nearer[0, 0] = 2.0
    sheet = draw_side_by_side(depth, nearer)
    assert sheet[:, :2, 0].tolist() == [[0, 255], [0, 255]]
    assert sheet[:, 10:12, 0].tolist() == [[127, 255], [0, 255]]
    assert (sheet[:, 20:, :3] == DIFFERENCE_COLOR).all(axis=2).tolist() == [
        [True, False],
        [False, False],
    ]


def test_signs_of_zero_and_bits_of_nan_count(tmp_path):
    from rasterjit.compat.golden import _describe_difference

    assert "1 of 2 pixels" in _describe_difference(
        np.array([[0.0, np.nan]]), np.array([[-0.0, np.nan]])
    )
    assert _describe_difference(np.array([[0.0, np.nan]]), np.array([[0.0, np.nan]])) is None
    assert "float32" in _describe_difference(np.zeros((1, 1)), np.zeros((1, 1), np.float32))
