"""Arrows are closed, as long as their vectors, and as large as they say."""

from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pytest

import rasterjit as rj

POSITIONS = np.array([[0.0, 0.0, 0.0], [3.0, 1.0, -2.0], [-4.0, 2.0, 1.0], [0.5, 7.0, 2.0]])
VECTORS = np.array([[2.0, 0.0, 0.0], [0.0, 0.0, -0.5], [1.0, 2.0, 2.0], [-3.0, 4.0, 0.0]])
LENGTHS = np.array([2.0, 0.5, 3.0, 5.0])


def parts_of(arrows):
    """The triangles of each arrow, (N, faces, 3, 3)."""
    corners = arrows.vertices[arrows.faces]
    return corners.reshape(len(arrows), arrows.faces_per_arrow, 3, 3)


def volumes(arrows):
    """The signed volume of each arrow, above 0 where faces turn outward."""
    parts = parts_of(arrows) - POSITIONS[: len(arrows), np.newaxis, np.newaxis]
    a, b, c = np.moveaxis(parts, 2, 0)
    return (a * np.cross(b, c)).sum(axis=2).sum(axis=1) / 6.0


def expected_volume(sides, length, shaft, head, long):
    """Prism and pyramid over regular polygons."""
    polygon = sides / 2.0 * math.sin(2.0 * math.pi / sides)
    return polygon * (shaft * shaft * (length - long) + head * head * long / 3.0)


@pytest.mark.parametrize("sides", [3, 16, 25])
def test_volumes_are_those_of_shaft_and_cone(sides):
    arrows = rj.Arrows(POSITIONS, VECTORS, sides=sides)
    wanted = [expected_volume(sides, n, 0.04 * n, 0.1 * n, 0.3 * n) for n in LENGTHS]
    assert np.allclose(volumes(arrows), wanted, rtol=1e-12)


def test_each_arrow_is_closed_with_every_edge_shared_by_two_faces_that_turn_alike():
    arrows = rj.Arrows(POSITIONS, VECTORS, sides=7)
    assert arrows.is_closed()
    for part in parts_of(arrows):
        edges = set()
        for a, b, c in part.tolist():
            for one, other in ((a, b), (b, c), (c, a)):
                edge = tuple(one), tuple(other)
                assert edge not in edges
                edges.add(edge)
        assert {(b, a) for a, b in edges} == edges


def test_foot_and_tip_lie_where_the_vector_begins_and_ends():
    scale = 0.75
    arrows = rj.Arrows(POSITIONS, VECTORS, scale=scale)
    for part, position, vector, length in zip(
        parts_of(arrows), POSITIONS, VECTORS, LENGTHS, strict=True
    ):
        along = (part.reshape(-1, 3) - position) @ (vector / length)
        assert along.min() == pytest.approx(0.0, abs=1e-12)
        assert along.max() == pytest.approx(scale * length, rel=1e-12)
        assert (part.reshape(-1, 3) == position + scale * vector).all(axis=1).any()
        assert (part.reshape(-1, 3) == position).all(axis=1).any()


def test_radii_are_shares_of_the_length():
    (part,) = parts_of(rj.Arrows([[0, 0, 0]], [[0, 0, 10]], head_radius=0.2, head_length=0.5))
    x, y, z = part.reshape(-1, 3).T
    radius = np.hypot(x, y)
    assert radius[z == 5.0].max() == pytest.approx(2.0)
    assert radius[z == 0.0].max() == pytest.approx(0.4)


def test_sizes_in_scene_units_are_the_same_for_all_but_arrows_shorter_than_two_heads():
    options = {"shaft_radius": 0.1, "head_radius": 0.3, "head_length": 1.0, "unit": "world"}
    arrows = rj.Arrows(POSITIONS, VECTORS, **options)
    shrunk = np.array([1.0, 0.25, 1.0, 1.0])
    wanted = [
        expected_volume(16, n, 0.1 * k, 0.3 * k, k) for n, k in zip(LENGTHS, shrunk, strict=True)
    ]
    assert np.allclose(volumes(arrows), wanted, rtol=1e-12)


def test_normals_are_of_length_one_and_outward_smooth_around_and_sharp_at_edges():
    arrows = rj.Arrows(POSITIONS, VECTORS)
    normals = arrows.normals[arrows.faces]
    corners = arrows.vertices[arrows.faces]
    a, b, c = np.moveaxis(corners, 1, 0)
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1)[:, np.newaxis]
    assert np.allclose(np.linalg.norm(arrows.normals, axis=1), 1.0, atol=1e-6)
    # Half a side's turn at most; at the tip of the cone as well.
    cosines = (normals * flat[:, np.newaxis]).sum(axis=2)
    assert cosines.min() > math.cos(math.radians(360.0 / 16 / 2)) - 1e-6
    # Foot and base are flat.
    assert np.isclose(cosines.min(axis=1), 1.0, atol=1e-6).sum() == 4 * 3 * 16


def test_zero_vectors_are_dropped_and_counted_and_the_others_keep_their_numbers():
    vectors = VECTORS.copy()
    vectors[1] = 0.0
    arrows = rj.Arrows(POSITIONS, vectors)
    assert arrows.dropped == 1
    assert len(arrows) == 4
    areas = np.linalg.norm(np.cross(*np.diff(parts_of(arrows), axis=2).swapaxes(0, 2)), axis=-1)
    assert (areas[:, 1] == 0.0).all()
    camera = rj.PerspectiveCamera(eye=(0, 3, 20), target=(0, 3, 0))
    frame = rj.render(arrows, camera, size=(96, 64), outputs=("face_id",), threads=1)
    seen = np.unique(frame.face_id[frame.face_id >= 0] // arrows.faces_per_arrow)
    assert seen.tolist() == [0, 2, 3]
    assert frame.stats.degenerate >= arrows.faces_per_arrow


def test_colours_and_scalars_of_arrows_are_those_of_their_faces():
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9]], np.uint8)
    arrows = rj.Arrows(POSITIONS, VECTORS, colors=colors)
    own = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]] * 4, colors=colors).face_colors
    assert np.array_equal(arrows.face_colors, np.repeat(own, arrows.faces_per_arrow, axis=0))
    assert np.array_equal(
        rj.Arrows(POSITIONS, VECTORS, colors="red").face_colors[:, :3].min(axis=0), [1, 0, 0]
    )
    measured = rj.Arrows(POSITIONS, VECTORS, scalars=[1.0, 2.0, math.nan, 4.0])
    assert measured.field.range == (1.0, 4.0)
    assert len(np.unique(measured.face_colors, axis=0)) == 4


def test_bits_do_not_depend_on_the_other_arrows():
    arrows = rj.Arrows(POSITIONS, VECTORS)
    for n, part in enumerate(parts_of(arrows)):
        assert np.array_equal(
            parts_of(rj.Arrows(POSITIONS[n : n + 1], VECTORS[n : n + 1]))[0], part
        )


def test_one_arrow_goes_from_point_to_point():
    arrow = rj.Arrow((1, 2, 3), (1, 2, 7), color="navy")
    low, high = arrow.bounds()
    assert low[2] == 3.0
    assert high[2] == 7.0
    same = rj.Arrows([[1, 2, 3]], [[0, 0, 4]], colors="navy")
    assert np.array_equal(arrow.vertices, same.vertices)
    assert np.array_equal(arrow.face_colors, same.face_colors)
    assert repr(arrow) == "Arrow()"


def test_copies_and_pickles_are_arrows():
    arrows = rj.Arrows(POSITIONS, np.where([[True], [True], [True], [False]], VECTORS, 0.0))
    for other in (copy.copy(arrows), copy.deepcopy(arrows), pickle.loads(pickle.dumps(arrows))):
        assert repr(other) == "Arrows(4 arrows, 1 of them zero)"
        assert other.faces_per_arrow == 96
        assert np.array_equal(other.vertices, arrows.vertices)


def test_tiny_and_huge_vectors_have_directions():
    arrows = rj.Arrows(np.zeros((2, 3)), [[3e-200, 4e-200, 0.0], [3e200, 4e200, 0.0]])
    assert arrows.dropped == 0
    assert np.isfinite(arrows.vertices).all()
    assert np.allclose(np.linalg.norm(arrows.normals, axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"positions": np.zeros((0, 3))}, "positions must have one row or more, got none"),
        ({"positions": np.zeros((4, 2))}, r"positions must have shape \(n, 3\), got \(4, 2\)"),
        ({"vectors": VECTORS[:3]}, r"vectors must have one row per position \(4\), got 3"),
        ({"vectors": VECTORS * math.nan}, "vectors must be finite, got 12 NaN"),
        ({"vectors": VECTORS * 0.0}, "vectors must have one that is not zero, got 4 that are"),
        ({"vectors": VECTORS, "scale": 1e308}, "vectors times scale must reach finite places"),
        ({"scale": 0}, "scale must be above 0, got 0"),
        ({"sides": 2}, r"sides must be a whole number in 3\.\.256, got 2"),
        ({"sides": 8.0}, r"sides must be a whole number in 3\.\.256, got 8\.0"),
        ({"unit": "pixel"}, "unit must be one of 'length', 'world'; got 'pixel'"),
        ({"shaft_radius": 0.2}, r"head_radius must be at least shaft_radius, 0\.2, got 0\.1"),
        ({"head_length": 1.1}, r"head_length must be at most 1 of an arrow's length, got 1\.1"),
        ({"head_length": -1}, "head_length must be above 0, got -1"),
        ({"colors": np.zeros((3, 3))}, r"colors must be one colour or one per arrow \(4\), got 3"),
        ({"scalars": [1.0]}, r"scalars must be one number per arrow \(4\)"),
        ({"colors": "red", "scalars": [1, 2, 3, 4]}, "colors must be None where scalars are given"),
    ],
)
def test_what_is_wrong_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        rj.Arrows(**{"positions": POSITIONS, "vectors": VECTORS, **change})


def test_an_arrow_needs_two_points():
    with pytest.raises(ValueError, match=r"end must be another point than start, got \[1\.0"):
        rj.Arrow((1, 2, 3), (1, 2, 3))
    with pytest.raises(ValueError, match="start must be finite"):
        rj.Arrow((math.inf, 2, 3), (1, 2, 3))


def test_a_head_as_long_as_the_arrow_is_a_cone():
    cone = rj.Arrows([[1, 0, 0]], [[0, 0, 3]], head_length=1.0, head_radius=0.25, sides=256)
    solid = cone.to_trimesh()
    solid.update_faces(solid.area_faces > 0.0)
    solid.merge_vertices(merge_norm=True, merge_tex=True)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(np.pi * 0.75**2 * 3 / 3, rel=1e-3)
