"""Contact sheets: each picture whole, in its cell, with its text under it."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

import rasterjit as rj

RED, BLUE = np.full((4, 6, 3), (255, 0, 0), np.uint8), np.full((2, 3, 3), (0, 0, 255), np.uint8)


def test_pictures_stand_in_the_middle_of_equal_cells():
    sheet = np.asarray(rj.grid([RED, BLUE, RED], 2, gap=1, background="black"))
    assert sheet.shape == (2 * 4 + 3, 2 * 6 + 3, 3)
    wanted = np.zeros_like(sheet)
    wanted[1:5, 1:7] = wanted[6:10, 1:7] = 255, 0, 0
    wanted[2:4, 9:12] = 0, 0, 255
    np.testing.assert_array_equal(sheet, wanted)


def test_frames_arrays_and_pictures_are_taken(cube):
    frame = rj.render(cube, size=(20, 10), background="transparent", threads=1)
    seen = frame.color[..., 3] == 255
    assert 0 < seen.sum() < seen.size
    forms = [frame, frame.color, Image.fromarray(frame.color)]
    sheet = np.asarray(rj.grid(forms, 3, gap=0, background="#204060"))
    for part in np.split(sheet, 3, axis=1):
        np.testing.assert_array_equal(part[seen], frame.color[seen][:, :3])
        assert (part[~seen] == (0x20, 0x40, 0x60)).all()
    grey = np.arange(24, dtype=np.uint8).reshape(4, 6)
    np.testing.assert_array_equal(np.asarray(rj.grid([grey], gap=0))[..., 1], grey)


def test_labels_take_a_line_under_each_picture():
    plain = np.asarray(rj.grid([RED, RED], 2, gap=0))
    told = np.asarray(rj.grid([RED, RED], 2, gap=0, labels=["", "|"]))
    np.testing.assert_array_equal(told[:4], plain)
    left, right = told[4:, :6], told[4:, 6:]
    assert left.shape[0] == 20
    assert (left == 255).all()
    assert right.min() < 128
    dark = np.asarray(rj.grid([RED, RED], 2, gap=0, labels=["", "|"], background="black"))
    assert dark[4:, 6:].max() > 128


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (2, 2), (4, 2), (9, 3), (10, 4), (16, 4)])
def test_sheet_is_nearly_square(count, columns):
    square = np.zeros((10, 10), np.uint8)
    sheet = rj.grid([square] * count, gap=0)
    assert sheet.size == (10 * columns, 10 * -(-count // columns))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (dict(pictures=[]), "pictures must hold at least one"),
        (dict(pictures=Image.new("RGB", (4, 3))), "pictures must be a sequence of pictures, got"),
        (dict(pictures=["a.png"]), r"pictures\[0\] must be a frame"),
        (dict(pictures=[RED, RED / 255.0]), r"pictures\[1\] must be a frame"),
        (dict(pictures=[RED], labels=["a", "b"]), "labels must be 1, one a picture, got 2"),
        (dict(pictures=[RED], labels=[3]), "each of labels must be a string, got 3"),
        (dict(pictures=[RED, RED], labels="ab"), "labels must be a sequence, got 'ab'"),
        (dict(pictures=[RED], columns=0), "columns must be at least 1, got 0"),
        (dict(pictures=[RED], gap=-1), "gap must be a whole number"),
        (dict(pictures=[RED], background="greenish"), "background"),
        (dict(pictures=[RED], unit=3), "unit must be a string, got 3"),
        (dict(pictures=[RED], unit="m"), "unit must be '' where there is no colorbar, got 'm'"),
    ],
)
def test_bad_argument_is_named(given, told):
    with pytest.raises(ValueError, match=told):
        rj.grid(**given)


def colored(scalars, **options):
    mesh = rj.Mesh(np.eye(3), [[0, 1, 2]], scalars=scalars, **options)
    return rj.render(mesh, size=(40, 90), threads=1)


def test_small_multiples_have_one_bar():
    frames = [colored([0, n, 4], range=(0, 3)) for n in range(4)]
    plain = np.asarray(rj.grid(frames, 2, labels=list("abcd")))
    barred = np.asarray(rj.grid(frames, 2, labels=list("abcd"), colorbar="Heat", unit="K"))
    np.testing.assert_array_equal(barred[:, : plain.shape[1]], plain)
    bar = barred[:, plain.shape[1] :]
    assert bar.shape[1] > 20
    # Its colours are those of the map, below the arrow for what is above 3.
    column = bar[:, 13 + 5].astype(int)
    inside = column[np.ptp(column, axis=1) > 0]
    assert np.abs(inside[-1] - rj.Colormap("viridis").codes[0, :3]).max() < 3
    for wrong, words in (
        ([*frames, colored([0, 1, 2], range=(0, 2))], "one colormap, norm and"),
        ([colored([1, 2, 3]).color], "colorbar must be False but for frames"),
    ):
        with pytest.raises(ValueError, match=words):
            rj.grid(wrong, colorbar=True)
    with pytest.raises(ValueError, match="colorbar must be True, False or a title"):
        rj.grid(frames, colorbar=3)
