"""Iso-lines are where exact arithmetic has them, and nowhere else."""

from __future__ import annotations

import naive_contours as twin
import numpy as np
import pytest
import screen

import rasterjit as rj

SIZE = (32, 32)
POINTS = [(1, 2), (31, 5), (9, 30)]
FACE = [[0, 1, 2]]
TIE = 1e-9
"""Pixels: what is nearer to the border of a line may be on either side of it by rounding."""
PLAIN = {"colormap": [[1.0, 1.0, 1.0]], "nan_color": "white"}
"""All but the lines is white."""


def dark(mesh, camera, size=SIZE, **options):
    """Return the pixels of a mesh that are drawn, and those of its lines."""
    frame = rj.render(mesh, camera, size=size, outputs=("color", "face_id"), threads=1,
                      background="red", **options)  # fmt: skip
    return frame.face_id, (frame.color[..., :3] == 0).all(axis=2)


def hold_to_twin(face_id, lines, shares_of, scalars_of, levels, width):
    """Compare some pixels with the exact lines; return how many pixels of lines are drawn."""
    for row, column in np.argwhere(face_id >= 0)[::3].tolist():
        face, wanted, is_tie = int(face_id[row, column]), False, False
        for level in levels:
            away = twin.signed_distance(
                shares_of(face), scalars_of(face), float(level), column, row
            )
            if away is None:
                continue
            is_tie |= abs(abs(away) - width / 2) < TIE
            wanted |= -width / 2 < away <= width / 2
        assert is_tie or lines[row, column] == wanted, (column, row)
    return int(lines.sum())


@pytest.mark.parametrize("ws", [(1.0, 1.0, 1.0), (1.0, 4.0, 2.0), (1.0, 2.0**14, 64.0)])
@pytest.mark.parametrize(
    ("scalars", "levels", "width"),
    [
        ((0.0, 1.0, 0.4), [0.1, 0.25, 0.5, 0.75], 0.3),
        ((1e30, -1e30, 3e29), [-2e29, 0.0, 5e29], 1.0),
        ((1e-300, 3e-300, 2e-300), [1.7e-300, 2.5e-300], 2.5),
        ((0, 1000, 300), [17.0, 171.0, 600.0], 1.0), ((5.0, 5.0, 6.0), [5.0, 5.5, 6.0], 0.3),
    ],
)  # fmt: skip
def test_lines_are_the_exact_ones(ws, width, scalars, levels):
    contours = rj.Contours(levels, width)
    mesh = screen.mesh(POINTS, FACE, SIZE, ws, scalars=scalars, contours=contours, **PLAIN)
    face_id, lines = dark(mesh, screen.camera(min(ws)))
    shares = twin.snapped_shares(screen.corners(POINTS), ws)
    drawn = hold_to_twin(face_id, lines, lambda _: shares, lambda _: scalars, levels, width)
    assert drawn > 5


@pytest.mark.parametrize("samples", [1, 64])
def test_lines_on_clipped_faces_are_the_exact_ones(samples):
    corners = np.array([[-40, -1, 8], [40, -1, 8], [0, -1, -60], [3, 2, -5.0]])
    faces, scalars, levels = [[0, 1, 2], [1, 3, 2]], [0.0, 3.0, 8.0, 1.0], [0.5, 2.0, 5.0, 7.5]
    material = rj.Material("unlit")
    mesh = rj.Mesh(corners, faces, scalars=scalars, material=material,
                   contours=rj.Contours(levels, 1.5), **PLAIN)  # fmt: skip
    camera = rj.PerspectiveCamera((0.2, 0.3, 0.1), (0.1, -0.2, -1), near=0.25, fov_y=70.0)
    view, clip = camera.view_matrix(), camera.projection_matrix(SIZE)
    placed = np.column_stack([corners, np.ones(4)]) @ (clip @ view).T
    if samples == 64:
        # As gray as so many of the moved pictures show the line: black inside, white far off.
        frame = rj.render(mesh, camera, size=SIZE, quality=rj.Quality(samples=64), threads=1)
        assert len(np.unique(frame.color[..., 0])) > 20
        return
    face_id, lines = dark(mesh, camera)
    assert set(np.unique(face_id)) == {-1, 0, 1}
    drawn = hold_to_twin(
        face_id, lines, lambda face: twin.clipped_shares(placed[faces[face]], SIZE),
        lambda face: [scalars[vertex] for vertex in faces[face]], levels, 1.5,
    )  # fmt: skip
    assert drawn > 20


def strip(scalars, contours, **options):
    """Draw a screen-filling square with scalars at its left, left, right and right corners."""
    square = [(0, 0), (0, 32), (32, 32), (32, 0)]
    mesh = screen.mesh(square, [[0, 1, 2], [0, 2, 3]], SIZE, scalars=scalars, contours=contours,
                       **{**PLAIN, **options})  # fmt: skip
    return dark(mesh, screen.camera(1.0))[1]


def test_a_line_between_two_columns_shows_one_of_them():
    # The scalar is the x of the screen: a line of width 1 at x = 8 touches the centres 7.5 and 8.5.
    for ends, column in (([0, 0, 32, 32], 8), ([32, 32, 0, 0], 23)):
        lines = strip(ends, [8.0])
        assert (lines == (np.arange(32) == column)).all()
    assert (strip([0, 0, 32, 32], rj.Contours([8.5], 2.0)) == np.isin(np.arange(32), [8, 9])).all()
    # At the centres themselves.
    assert (strip([0, 0, 32, 32], rj.Contours([8.5], 0.01)) == (np.arange(32) == 8)).all()
    assert not strip([0, 0, 32, 32], rj.Contours([8.25], 0.01)).any()


def test_a_number_of_levels_lies_inside_the_range():
    lines = strip([0, 0, 32, 32], 3)
    assert (lines == np.isin(np.arange(32), [8, 16, 24])).all()
    lines = strip([0, 0, 32, 32], 1, range=(0, 8))
    assert (lines == (np.arange(32) == 4)).all()
    assert rj.Contours(3).level_values(2.0, 2.0).tolist() == []
    assert rj.Contours(3).level_values(1.0, np.nextafter(1.0, 2.0)).tolist() == []
    assert rj.Contours([3, 1, 3, 2]).level_values(0.0, 0.0).tolist() == [1.0, 2.0, 3.0]


def test_levels_lie_as_close_as_they_like():
    assert strip([0, 0, 32, 32], 4096).all()
    assert strip([0, 0, 32, 32], np.linspace(0, 32, 9000)).all()


def test_plateaus_and_nan_have_no_lines():
    assert not strip([2, 2, 2, 2], [2.0]).any()
    assert not strip([2, 2, 2, 2], 5).any()
    assert not strip([0, np.nan, 1, np.nan], 5).any()
    half = strip([0, 0, 32, np.nan], [8.0])
    assert half[16:, 8].all()
    assert half[16:].sum() == 16
    assert not strip([0, 0, 32, 32], [-1.0, 33.0, 1e30, -1e300]).any()


def test_faces_with_an_infinite_corner_have_no_lines():
    # Only the half with three finite corners has one.
    lines = strip([0, 0, np.inf, 32], rj.Contours([8.0], 1.0))
    finite = strip([0, 0, np.nan, 32], rj.Contours([8.0], 1.0))
    assert np.array_equal(lines, finite)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (0, ["1 to 4096", "got 0"]), (-3, ["-3"]), (4097, ["4097"]), (True, ["True"]),
        (2.5, ["2.5"]), ("many", ["'many'"]), ([], ["one or more"]), ([1.0, np.nan], ["finite"]),
        ([[1.0]], ["shape"]), ([np.inf], ["finite"]), (["a"], ["contours"]),
    ],
)  # fmt: skip
def test_bad_levels_are_refused_by_name(wrong, words):
    for call in (
        lambda: rj.Contours(wrong),
        lambda: rj.Mesh(np.eye(3), FACE, scalars=[1, 2, 3], contours=wrong),
    ):
        with pytest.raises(ValueError, match="contours") as error:
            call()
        for word in words:
            assert word in str(error.value)


def test_lines_need_scalars_of_vertices_a_width_and_a_color():
    square, faces = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), [[0, 1, 2], [0, 2, 3]]
    with pytest.raises(ValueError, match="contours must be None where scalars are those of faces"):
        rj.Mesh(square, faces, scalars=[1, 2], contours=3)
    with pytest.raises(ValueError, match="contours must be None where no scalars are given, got 3"):
        rj.Mesh(square, faces, contours=3)
    for name, value in (("colormap", "gray"), ("range", (0, 1)), ("nan_color", (1, 0, 0))):
        with pytest.raises(ValueError, match=f"{name} must be .* where no scalars are given"):
            rj.Mesh(square, faces, **{name: value})
    for options in ({"width": 0.0}, {"width": -1}, {"width": np.nan}, {"color": "blackish"}):
        with pytest.raises(ValueError, match=next(iter(options))):
            rj.Contours(3, **options)
    own = rj.Contours([2, 1], 2, "white")
    assert (own.levels, own.width, own.color) == ((2.0, 1.0), 2, (1.0, 1.0, 1.0, 1.0))
