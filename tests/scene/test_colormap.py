"""Colour maps: those of Matplotlib, code for code, and entries of one's own."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.colormap import COLORMAPS

VALUES = np.concatenate(
    [
        np.linspace(-0.2, 1.2, 4001), np.arange(257) / 256.0, np.nextafter(np.arange(257) / 256, 0),
        [np.inf, -np.inf, 1e300, -1e300, 5e-324, -0.0],
    ]
)  # fmt: skip


@pytest.mark.parametrize("name", [*COLORMAPS, *(f"{name}_r" for name in COLORMAPS)])
def test_maps_show_what_those_of_matplotlib_show(name):
    matplotlib = pytest.importorskip("matplotlib")
    theirs, ours = matplotlib.colormaps[name], rj.Colormap(name)
    assert len(ours) == theirs.N == 256
    assert np.array_equal(ours.codes, theirs(np.arange(256), bytes=True))
    assert np.array_equal(rj.Colormap(theirs).codes, ours.codes)
    assert np.array_equal(ours.codes[ours.entries(VALUES, 0.0, 1.0)], theirs(VALUES, bytes=True))


@pytest.mark.parametrize("ends", [(-3.0, 5.0), (1e-30, 3e-30), (7.0, 7.0), (-1e30, 1e38)])
def test_ranges_are_those_of_matplotlib(ends):
    colors = pytest.importorskip("matplotlib.colors")
    low, high = ends
    step = (high - low) or 1.0
    values = low + step * np.linspace(-0.25, 1.25, 5000)
    matplotlib = pytest.importorskip("matplotlib")
    shown = matplotlib.colormaps["turbo"](colors.Normalize(low, high)(values), bytes=True)
    own = rj.Colormap("turbo")
    assert np.array_equal(own.codes[own.entries(values, low, high)], shown)


def test_entries_begin_where_they_say():
    own = rj.Colormap([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    values = [-1, 0, 0.99, 1, 1.99, 2, 3, 3.99, 4, 100, np.inf, -np.inf, np.nan]
    assert own.entries(values, 0.0, 4.0).tolist() == [0, 0, 0, 1, 1, 2, 3, 3, 3, 3, 3, 0, 4]
    # No width: all values are the first, as in Matplotlib.
    assert own.entries([-1, 2, 3, np.nan], 2.0, 2.0).tolist() == [0, 0, 0, 4]
    # The narrowest range there is.
    tiny = np.nextafter(1.0, 2.0)
    assert own.entries([0.0, 1.0, tiny, 2.0], 1.0, tiny).tolist() == [0, 0, 3, 3]


def test_colors_of_ones_own():
    codes = np.array([[1, 2, 3], [200, 100, 50]], np.uint8)
    own = rj.Colormap(codes)
    assert own.codes.tolist() == [[1, 2, 3, 255], [200, 100, 50, 255]]
    assert np.array_equal(own.colors[:, :3], srgb_to_linear(codes))
    assert rj.Colormap(codes / 255.0).codes.tolist() == own.codes.tolist()
    clear = rj.Colormap([[1.0, 0.0, 0.0, 0.5]])
    assert clear.codes.tolist() == [[255, 0, 0, 127]]
    assert clear.colors[0].tolist() == [1.0, 0.0, 0.0, np.float32(127 / 255)]
    assert (repr(own), repr(rj.Colormap("gray_r"))) == (
        "Colormap of 2 entries", "Colormap('gray_r')",
    )  # fmt: skip
    assert rj.Colormap(own).codes is not None
    assert rj.Colormap([[0, 0, 1]]).codes.tolist() == [[0, 0, 255, 255]]


def test_entries_stay_as_they_are():
    given = np.zeros((3, 3), np.uint8)
    own = rj.Colormap(given)
    given[0] = 255
    assert (own.codes[:, :3] == 0).all()
    for one in (own, copy.deepcopy(own), pickle.loads(pickle.dumps(own))):
        assert np.array_equal(one.codes, own.codes)
        assert np.array_equal(one.colors, own.colors)
        for array in (one.codes, one.colors):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1
    with pytest.raises(AttributeError, match="codes"):
        own.codes = given


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("viridiss", ["'viridiss'", "did you mean 'viridis' or 'viridis_r'"]),
        ("Plasma", ["did you mean 'plasma'"]),
        ("xyzzy", ["must be one of cividis, coolwarm"]),
        ("", ["''"]),
        (None, ["must be a name", "got None"]),
        ([], ["shape (N, 3) or (N, 4)", "(0,)"]),
        (np.zeros((0, 3)), ["(0, 3)"]),
        (np.zeros((4, 2)), ["(4, 2)"]),
        ([1.0, 0.0, 0.0], ["(3,)"]),
        ([[1.0, 0.0, 1.5]], ["0..1", "1.5"]),
        ([[0.0, -0.1, 0.5]], ["-0.1"]),
        ([[0.0, np.nan, 0.5]], ["nan"]),
        ([[0, 128, 255]], ["uint8", "128", "int64"]),
        ([["a", "b", "c"]], ["must be a name"]),
        ([[1, 2, 3], [4]], ["must be a name"]),
        (np.ma.masked_array(np.zeros((2, 3)), [[1, 0, 0], [0, 0, 0]]), ["mask"]),
    ],
)
def test_what_is_no_map_is_refused_by_name(wrong, words):
    for call in (
        lambda: rj.Colormap(wrong),
        lambda: rj.Mesh(np.eye(3), [[0, 1, 2]], scalars=[1, 2, 3], colormap=wrong),
    ):
        with pytest.raises(ValueError, match="colormap") as error:
            call()
        for word in words:
            assert word in str(error.value)
