"""Colour bars: every colour at its value's height, round ticks, and what is meant is clear."""

from __future__ import annotations

import re
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

import rasterjit as rj
from rasterjit.outputs.ticks import find_ticks, format_ticks, make_ticks

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = [[0, 1, 2], [0, 2, 3]]
SIZE = (64, 240)
BANDS = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0]], np.uint8)


def field(scalars=(0, 1, 2, 4), **options):
    return rj.Mesh(SQUARE, FACES, scalars=scalars, **options)


def frame(*meshes, size=SIZE):
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh)
    return rj.render(scene, size=size, threads=1)


def bar_of(picture):
    """Return the colours of a bar from below, (L, 3): the column inside its frame."""
    column = picture[:, max(10, len(picture) // 30) + 2, :3].astype(int)
    inside = np.flatnonzero(np.ptp(column, axis=1) > 0)
    return column[inside][::-1]


def test_the_bar_has_the_colors_of_its_map_from_below():
    bar = bar_of(frame(field(colormap=BANDS)).colorbar())
    length = len(bar)
    assert length > 200
    places = (np.arange(length) + 0.5) / length
    assert np.array_equal(bar, BANDS[np.floor(4 * places).astype(int)])


@pytest.mark.parametrize(("low", "high"), [(0, 4), (-1, 1), (1e-30, 3e-30), (1e9, 1e9 + 2), (0, 0)])
def test_ticks_are_where_their_values_are(low, high):
    picture = frame(field([low, high, high, low], range=(low, high))).colorbar()
    assert picture.shape[0] == SIZE[1]
    assert picture.dtype == np.uint8
    assert (picture[..., 3] == 255).all()
    # Right of the bar's frame: black rows are ticks.
    size = 10
    right = size + 12
    marks = np.flatnonzero((picture[:, right + 2, :3] == 0).all(axis=1))
    ticks, length = find_ticks(low, high, 220 // 30), 220
    if format_ticks(ticks)[1]:
        length -= 2 * size
        ticks = find_ticks(low, high, length // 30)
    assert (picture[-size - length : -size, right, :3] == 0).all()
    shares = [(tick - low) / (high - low) if high > low else 0.5 for tick in ticks]
    wanted = sorted(SIZE[1] - size - 1 - round(share * (length - 1)) for share in shares)
    assert marks.tolist() == wanted


@pytest.mark.parametrize(
    ("low", "high", "most", "texts", "note"),
    [
        (0.0, 1.0, 5, ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"], ""),
        (0.0, 10.0, 5, ["0", "2", "4", "6", "8", "10"], ""),
        (-3.0, 3.0, 3, ["-2", "0", "2"], ""),
        (0.13, 0.97, 4, ["0.2", "0.4", "0.6", "0.8"], ""),
        (0.0, 2e5, 2, ["0", "100000", "200000"], ""),
        (1e-4, 2.5e-4, 4, ["0.00010", "0.00015", "0.00020", "0.00025"], ""),
        (1e-7, 3e-7, 4, ["1.0", "1.5", "2.0", "2.5", "3.0"], "1e-7"),
        (-1e30, 1e30, 4, ["-1.0", "-0.5", "0.0", "0.5", "1.0"], "1e30"),
        (0.0, 3e-9, 3, ["0", "1", "2", "3"], "1e-9"),
        (1e9, 1e9 + 5.0, 5, ["0", "1", "2", "3", "4", "5"], "+1e9"),
        (-1e9 - 2.0, -1e9, 2, ["-2", "-1", "0"], "-1e9"),
        (1234567.0, 1234571.0, 4, ["7", "8", "9", "10", "11"], "+1.23456e6"),
        (0.0, 1e6, 2, ["0.0", "0.5", "1.0"], "1e6"),
        (1.0, 1.0 + 3e-9, 3, ["0", "1", "2", "3"], "1e-9+1"),
        (-1.0 - 3e-9, -1.0, 3, ["-3", "-2", "-1", "0"], "1e-9-1"),
        (5.0, 5.0, 4, ["5"], ""),
        (1.0, 1.0 + 2.0**-52, 4, ["0", "2"], "1e-16+1"),
        (0.0, 5e-324, 4, ["0"], ""),
        (123.456, 123.456, 4, ["123.456"], ""),
    ],
)
def test_ticks_are_round_and_told_apart(low, high, most, texts, note):
    ticks = find_ticks(low, high, most)
    assert format_ticks(ticks) == (texts, note)
    assert all(low <= tick <= high for tick in ticks)
    assert len(ticks) <= most + 1


def told(text, note):
    """Return the number that a label and the note above the bar mean."""
    power, added = re.fullmatch(r"(1e-?\d+)?([+-].+)?", note).groups()
    return Fraction(text) * Fraction(power or 1) + Fraction(added or 0)


def test_a_great_many_ranges_have_ticks():
    rng = np.random.default_rng(5)
    for _ in range(3000):
        low = float(rng.normal() * 10.0 ** rng.uniform(-30, 30))
        high = low + float(10.0 ** rng.uniform(-30, 30))
        most = int(rng.integers(1, 12))
        ticks = find_ticks(low, high, most)
        texts, note = format_ticks(ticks)
        assert 1 <= len(ticks) <= most + 1
        assert all(low <= tick <= high for tick in ticks)
        assert len(set(texts)) == len(texts)
        assert len(ticks) == 1 or max(map(len, texts)) <= 9
        for tick, text in zip(ticks, texts, strict=True):
            assert float(told(text, note)) == pytest.approx(tick, rel=1e-5, abs=0.0)
        # Also the differences, of which little is in the digits of all.
        for (one, other), pair in zip(pairwise(ticks), pairwise(texts), strict=True):
            found = told(pair[1], note) - told(pair[0], note)
            wanted, least = float(Fraction(other) - Fraction(one)), float(np.spacing(abs(other)))
            assert float(found) == pytest.approx(wanted, rel=1e-3, abs=least)


def test_a_note_stands_above_the_bar():
    plain, noted = (
        frame(field(low + np.arange(4), range=(low, low + 5))).colorbar("h") for low in (0.0, 1e9)
    )
    first = [
        int(np.flatnonzero((picture[:, 22 + 2, :3] == 0).all(axis=1))[0])
        for picture in (plain, noted)
    ]
    assert first[1] - first[0] == 20
    assert (noted[30:40, 10:60, :3] < 128).any()


def test_contours_are_lines_across_the_bar():
    levels = rj.Contours([0.5, 2.0, 9.0], color="#ff00ff")
    drawn = frame(field(contours=levels)).colorbar()
    bare = frame(field()).colorbar()
    changed = (drawn != bare).any(axis=2)
    rows = np.flatnonzero(changed.any(axis=1))
    # The bar goes from 0 to 4, from its lowest to its highest row; 9 is beyond it.
    assert rows.tolist() == sorted(SIZE[1] - 10 - 1 - round(level / 4 * 219) for level in (0.5, 2))
    assert (drawn[rows, 10:22, :3] == (255, 0, 255)).all()
    assert not changed[:, :10].any()
    assert not changed[:, 22:].any()


def test_the_bar_of_several_has_the_lines_of_all():
    first, second = (field(contours=[level], range=(0, 4)) for level in (1.0, 3.0))
    both = frame(first, second)
    alone = [both.colorbar(node=n) for n in (0, 1)]
    lines = [np.flatnonzero((bar != frame(field()).colorbar()).any(axis=(1, 2))) for bar in alone]
    found = np.flatnonzero((both.colorbar() != frame(field()).colorbar()).any(axis=(1, 2)))
    assert sorted(found) == sorted(np.concatenate(lines))
    assert len(found) == 2


def test_nan_is_shown_if_there_is_any_and_titles_stand_above():
    plain = frame(field()).colorbar()
    nan = frame(field([0, 1, 2, np.nan], nan_color="#102030")).colorbar()
    assert (nan[:, 12, :3] == [0x10, 0x20, 0x30]).all(axis=1).sum() == 9
    assert not (plain[..., :3] == [0x10, 0x20, 0x30]).all(axis=2).any()
    titled = frame(field()).colorbar("Temperature of the surface in K")
    assert titled.shape[1] > plain.shape[1]
    assert (titled[8:24] < 128).any()
    assert (plain[:4] == 255).all()
    # Of colours that are seen through, what they are on paper.
    clear = np.array([[255, 0, 0, 0], [255, 0, 0, 255]], np.uint8)
    column = frame(field(colormap=clear)).colorbar()[:, 12, :3]
    assert (column == [255, 0, 0]).all(axis=1).sum() == 110


def test_a_bar_without_room_for_round_numbers_says_where_it_ends():
    picture = frame(field([0.25, 7.5, 1.0, 2.0]), size=(4, 44)).colorbar()
    right = 10 + 12
    marks = np.flatnonzero((picture[:, right + 2, :3] == 0).all(axis=1))
    assert marks.tolist() == [10, 44 - 10 - 1]


@pytest.mark.parametrize("height", [1, 5, 24, 100, 900])
def test_any_height_has_a_bar(height):
    picture = frame(field([0, 1, 2, np.nan]), size=(4, height)).colorbar("x")
    assert picture.shape[0] == height
    if height >= 100:
        assert len(bar_of(picture)) > height / 3


def test_a_bar_is_saved_beside_the_picture(tmp_path):
    shown = frame(field())
    for name in ("a.png", "a.webp"):
        shown.save(tmp_path / name, colorbar=True)
    saved = np.array(Image.open(tmp_path / "a.png").convert("RGBA"))
    bar = shown.colorbar()
    assert saved.shape == (SIZE[1], SIZE[0] + bar.shape[1], 4)
    assert np.array_equal(saved[:, : SIZE[0]], shown.color)
    assert np.array_equal(saved[:, SIZE[0] :], bar)
    shown.save(tmp_path / "c.png", colorbar="Height, m")
    titled = np.array(Image.open(tmp_path / "c.png").convert("RGBA"))
    assert np.array_equal(titled[:, SIZE[0] :], shown.colorbar("Height, m"))
    assert np.array_equal(shown.colorbar("Height", unit="m"), shown.colorbar("Height (m)"))
    for name, outputs in (("b.npz", None), ("b.png", "depth")):
        depth = rj.render(field(), size=SIZE, outputs=("color", "depth"), threads=1)
        with pytest.raises(ValueError, match="colorbar must be False"):
            depth.save(tmp_path / name, outputs, colorbar=True)
    with pytest.raises(ValueError, match="colorbar must be True, False or a title"):
        shown.save(tmp_path / "b.png", colorbar=1)
    layers = rj.render_layers(field(), None, k=2, size=(8, 8), outputs=("depth",))
    with pytest.raises(ValueError, match="colorbar must be False"):
        layers.save(tmp_path / "b.npz", colorbar=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a.webp", "c.png"]


def test_several_fields_have_one_bar_if_they_are_alike():
    alike = field(range=(0, 5)), field([3, np.nan, 1, 1], range=(0, 5)), rj.Mesh(SQUARE, FACES)
    both = frame(*alike)
    assert np.array_equal(both.colorbar(), both.colorbar(node=1))
    assert not np.array_equal(both.colorbar(), both.colorbar(node=0))
    assert np.array_equal(frame(field([1, 2], range=(0, 5))).colorbar(), both.colorbar(node=0))
    frame(field(range=(0, 5), norm="linear"), field(range=(0, 5))).colorbar()
    other = frame(field(), field(range=(0, 5)), field(colormap="gray"))
    assert not np.array_equal(other.colorbar(node=0), other.colorbar(node=2))
    for shown, options, words in (
        (other, {}, "node must say whose colour bar"), (both, {"node": 2}, "node must be one"),
        (both, {"node": 3}, "node"), (frame(alike[2]), {}, "no mesh of the scene has scalars"),
        (both, {"title": 3}, "title must be a string"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            shown.colorbar(**options)


def test_bounds_beyond_the_map_have_the_color_above_it():
    colors = pytest.importorskip("matplotlib.colors")
    table = rj.Colormap("viridis", over="red")
    bar = bar_of(
        frame(field(colormap=table, norm=colors.BoundaryNorm([0, 1, 2, 3], 300))).colorbar()
    )
    assert bar[-1].tolist() == [255, 0, 0]
    assert bar[0].tolist() == table.codes[0, :3].tolist()


@pytest.mark.parametrize(
    ("count", "range", "most", "names"),
    [
        (2, None, 5, ["0", "1"]), (2, (0, 0.5), 5, ["0"]), (3, (0.5, 9.5), 5, ["1", "2"]),
        (60, None, 5, ["0", "5", "10", "15", "20", "25", "30", "35", "40", "45"]),
        (2, (0.2, 0.8), 5, ["0.2", "0.4", "0.6", "0.8"]), (1, (0, 0), 5, ["0"]),
    ],
)  # fmt: skip
def test_names_stand_in_the_range_without_overlap(count, range, most, names):
    table = rj.Colormap({str(n): "red" for n in np.arange(count)})
    shown = field([0, 0, 0, 0], colormap=table, range=range)
    assert make_ticks(shown.field.scale, most).texts[:10] == names
    frame(shown).colorbar()
