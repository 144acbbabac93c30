"""Hard cases of scalar fields: exact values, what is not finite, ranges without width."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
import screen

import rasterjit as rj
from rasterjit.inspect import oracle

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = [[0, 1, 2], [0, 2, 3]]
POINTS = [(0, 0), (16, 0), (0, 16)]
FACE = [[0, 1, 2]]
BANDS = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0]], np.uint8)
NEAR = Fraction(1, 10**12)
"""How far from the end of an entry a place is that rounding may put on its other side."""


def seen(scalars, w=1.0, outputs=("color", "scalar"), points=POINTS, faces=FACE, **options):
    """Draw screen points with scalars on 16 by 16 pixels."""
    shown = screen.mesh(points, faces, (16, 16), w, scalars=scalars, **options)
    near = min(np.broadcast_to(w, len(points)).tolist())
    return rj.render(shown, screen.camera(near), size=(16, 16), outputs=outputs, threads=1)


@pytest.mark.parametrize("ws", [(1.0, 1.0, 1.0), (1.0, 4.0, 2.0), (1.0, 2.0**14, 64.0)])
@pytest.mark.parametrize(
    ("values", "ends"),
    [
        ((0.0, 1.0, 2.0), None), ((-5.0, 40.0, 0.25), (0.0, 10.0)), ((1e30, -1e30, 3e29), None),
        ((1.0, 1.0 + 2.0**-50, 1.0 + 2.0**-51), None), ((1e-300, 3e-300, 2e-300), None),
        ((3, 7, 300), (5, 200)), ((False, True, True), None), ((1e9, 1e9 + 1, 1e9 + 2), None),
    ],
)  # fmt: skip
def test_colors_are_those_of_exact_values(ws, values, ends):
    frame = seen(values, ws, colormap="viridis", range=ends)
    codes = rj.Colormap("viridis").codes
    low, high = (Fraction(float(end)) for end in ends or (min(values), max(values)))
    exact = [Fraction(float(value)) for value in values]
    pixels = screen.covered(
        rj.render(
            screen.mesh(POINTS, FACE, (16, 16), ws),
            screen.camera(1.0),
            size=(16, 16),
            outputs="face_id",
        )
    )
    assert len(pixels) > 100
    for column, row in pixels:
        weights = oracle.perspective_weights(screen.corners(POINTS), ws, screen.centre(column, row))
        value = oracle.interpolate(weights, exact)
        place = 256 * (value - low) / (high - low)
        slack = 4096 * NEAR if values[0] == 1.0 else NEAR
        # Differences of values that are close have few digits: those of the range decide.
        slack = max(slack, Fraction(2.0**-50) * max(map(abs, exact)) * 256 / (high - low))
        lowest, highest = (
            min(max(int(np.floor(float(place + way))), 0), 255) for way in (-slack, slack)
        )
        allowed = codes[lowest : highest + 1].tolist()
        assert frame.color[row, column].tolist() in allowed
        assert screen.is_rounded(
            frame.scalar[row, column], value, abs(value) * 2 * screen.UNIT * 8 + Fraction(5e-324)
        )


def test_values_are_interpolated_before_the_color_is_looked_up():
    frame = seen((0.0, 4.0, 2.0), (8.0, 1.0, 2.0), colormap=BANDS, range=(0, 4))
    hit = np.isfinite(frame.scalar)
    wanted = BANDS[np.clip(np.floor(frame.scalar[hit].astype(float)).astype(int), 0, 3)]
    assert np.array_equal(frame.color[hit][:, :3], wanted)
    assert len(np.unique(frame.color[hit], axis=0)) == 4


def test_entries_are_the_exact_ones():
    rng = np.random.default_rng(3)
    own = rj.Colormap("viridis")
    for low, high in ((0.0, 1.0), (-3.0, 5.0), (1e-30, 4e-30), (0.0, 1e38), (2.0, 2.0)):
        values = low + (high - low) * rng.uniform(-0.2, 1.2, 300)
        found = own.entries(values, low, high)
        exact = [oracle.colormap_entry(value, low, high, 256) for value in values]
        # None of them lies so near to an entry's end that rounding would put it beyond.
        assert found.tolist() == exact
    assert [oracle.colormap_entry(value, 0, 4, 4) for value in (-1, 0, 1, 2, 4, 9)] == [
        0, 0, 1, 2, 3, 3,
    ]  # fmt: skip
    for wrong in ((np.nan, 0, 1, 4), (0, 1, 0, 4), (0, 0, np.inf, 4), (0, 0, 1, 0)):
        with pytest.raises(ValueError, match="must"):
            oracle.colormap_entry(*wrong)


def test_faces_have_one_color_each_though_they_share_vertices():
    square = [(0, 0), (16, 0), (16, 16), (0, 16)]
    values = [1.5, np.nan]
    frame = seen(
        values, points=square, faces=FACES, colormap=BANDS, range=(0, 4), nan_color="white"
    )
    face = rj.render(screen.mesh(square, FACES, (16, 16)), screen.camera(1.0), size=(16, 16),
                     outputs="face_id").face_id  # fmt: skip
    assert set(np.unique(face)) == {0, 1}
    assert (frame.color[face == 0] == [0, 255, 0, 255]).all()
    assert (frame.color[face == 1] == 255).all()
    assert (frame.scalar[face == 0] == 1.5).all()
    assert np.isnan(frame.scalar[face == 1]).all()
    # As many vertices as faces: those of vertices win.
    mesh = rj.Mesh(SQUARE, [*FACES, [0, 1, 3], [1, 2, 3]], scalars=[1, 2, 3, 4])
    assert not mesh.field.of_faces
    assert mesh.face_colors is None


def test_nan_and_infinity_have_their_colors():
    ends = {"colormap": BANDS, "range": (0, 4), "nan_color": "#123456"}
    for place, value in itertools.product(range(3), (np.nan, np.inf, -np.inf)):
        values = [1.0, 2.0, 3.0]
        # One corner is enough.
        values[place] = value
        frame = seen(values, **ends)
        hit = frame.color[..., 3] > 0
        hit &= (frame.color != 255).any(axis=2)
        assert (frame.color[hit] == [0x12, 0x34, 0x56, 255]).all()
        assert (np.isnan(frame.scalar) | (frame.scalar == value)).all()
    for value in (np.inf, -np.inf):
        frame = seen([value] * 3, **ends)
        assert (frame.color[1, 1] == [0x12, 0x34, 0x56, 255]).all()
        assert (frame.scalar[1:5, 1:5] == value).all()
        of_faces = seen([value], **ends)
        assert (of_faces.color[1, 1] == [0x12, 0x34, 0x56, 255]).all()
    # What is finite has an end's colour, however far it is.
    frame = seen([3e38] * 3, **ends)
    assert (frame.color[1, 1, :3] == BANDS[3]).all()
    # No finite value: any range does.
    assert rj.Mesh(SQUARE, FACES, scalars=[np.nan, np.inf, np.nan, np.nan]).field.range == (0, 1)


def test_a_constant_field_shows_the_first_entry():
    for value in (0.0, -3.5, 1e30, 7):
        frame = seen([value] * 3, colormap=BANDS)
        assert (frame.color[1:5, 1:5, :3] == BANDS[0]).all()
        assert (frame.scalar[1:5, 1:5] == np.float32(value)).all()
    # Of a range that does not hold it, the end that is nearer.
    assert (seen([9.0] * 3, colormap=BANDS, range=(0, 4)).color[1:5, 1:5, :3] == BANDS[3]).all()


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.int8, np.uint16, np.int64, bool])
def test_any_kind_of_number_is_its_value(dtype):
    values = np.array([0, 1, 1], dtype)
    found, wanted = seen(values), seen(values.astype(float))
    assert found.color.tobytes() == wanted.color.tobytes()
    assert found.scalar.tobytes() == wanted.scalar.tobytes()
