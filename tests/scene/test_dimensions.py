"""Dimensions measure what they say, and their lines lie where they measure."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj


def number(node):
    return float(node.label.text.strip("R °m"))


@pytest.mark.parametrize("seed", range(40))
def test_numbers_equal_exact_geometry(seed):
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=(3, 3)) * 10.0 ** rng.integers(-2, 3)
    node = rj.length_dimension(a, b, units="mm", scale=1000.0, decimals=9, offset=c)
    assert node.label.text.endswith(" mm")
    assert number(node) == pytest.approx(1000.0 * np.linalg.norm(b - a), abs=1e-8, rel=1e-12)
    radius = rj.radius_dimension(a, b, decimals=9)
    assert number(radius) == pytest.approx(np.linalg.norm(b - a), abs=1e-8, rel=1e-12)
    u, v = (a - b) / np.linalg.norm(a - b), (c - b) / np.linalg.norm(c - b)
    # Kahan's formula keeps its digits at any angle.
    true = 2.0 * np.degrees(np.arctan2(np.linalg.norm(u - v), np.linalg.norm(u + v)))
    assert number(rj.angle_dimension(a, b, c, decimals=9)) == pytest.approx(true, abs=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_lines_lie_where_they_measure(seed):
    rng = np.random.default_rng(seed)
    a, b, aside = rng.normal(size=(3, 3))
    node = rj.length_dimension(a, b, offset=aside)
    points = node.mesh.vertices
    for wanted in (a, b, a + aside, b + aside):
        assert np.abs(points - wanted).max(axis=1).min() < 1e-12
    np.testing.assert_allclose(node.label.position, (a + b) / 2 + aside, atol=1e-12)
    center, arms = rng.normal(size=3), rng.normal(size=(2, 3))
    node = rj.angle_dimension(center + arms[0], center, center + arms[1], radius=0.7)
    arc = node.mesh.vertices[:49] - center
    np.testing.assert_allclose(np.linalg.norm(arc, axis=1), 0.7, atol=1e-12)
    ways = arms / np.linalg.norm(arms, axis=1)[:, np.newaxis]
    np.testing.assert_allclose(arc[[0, -1]], 0.7 * ways, atol=1e-12)
    # The label stands halfway along the arc.
    middle = np.array(node.label.position) - center
    np.testing.assert_allclose(middle @ ways[0], middle @ ways[1], atol=1e-12)


def test_straight_and_level_angles_are_measured():
    for second, text in (((-2, 0, 0), "180.0°"), ((3, 0, 0), "0.0°"), ((0, -1, 0), "90.0°")):
        assert rj.angle_dimension((1, 0, 0), (0, 0, 0), second).label.text == text


def test_dimensions_are_drawn_and_left_whole_by_sections():
    scene = rj.Scene()
    scene.add(rj.Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]]))
    scene.add(rj.length_dimension((-1, -1, 0), (1, -1, 0), offset=(0, -0.4, 0), color="red"))
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0)
    frames = []
    for section in (None, rj.SectionPlane((0, -1.2, 0), (0, -1, 0))):
        scene.section = section
        frames.append(rj.render(
            scene, camera, size=(120, 90), threads=1, outputs=("color", "object_id")
        ))  # fmt: skip
    assert (frames[0].object_id == 1).sum() > 40
    assert (frames[0].color == frames[1].color).all()


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: rj.length_dimension((0, 0, 0), (0, 0, 0)), "end must differ from start"),
        (lambda: rj.length_dimension((0, 0), (0, 0, 1)), "start must"),
        (lambda: rj.length_dimension((0, 0, 0), (0, 0, 1), offset="up"), "offset must"),
        (lambda: rj.length_dimension((0, 0, 0), (0, 0, 1), scale=0), "scale must"),
        (lambda: rj.length_dimension((0, 0, 0), (0, 0, 1), decimals=13), "decimals must"),
        (lambda: rj.length_dimension((0, 0, 0), (0, 0, 1), units=5), "units must"),
        (lambda: rj.length_dimension((0, 0, 0), (0, 0, 1), size=0), "size must"),
        (lambda: rj.angle_dimension((0, 0, 0), (0, 0, 0), (1, 0, 0)), "first must differ"),
        (lambda: rj.angle_dimension((1, 0, 0), (0, 0, 0), (0, 0, 0)), "second must differ"),
        (lambda: rj.angle_dimension((1, 0, 0), (0, 0, 0), (0, 1, 0), radius=-1), "radius must"),
        (lambda: rj.radius_dimension((1, 0, 0), (1, 0, 0)), "point must differ from center"),
    ],
)
def test_what_is_wrong_is_named(make, match):
    with pytest.raises(ValueError, match=match):
        make()


def test_any_finite_length_is_measured():
    node = rj.radius_dimension((0, 0, 0), (0, 0, 1e-200), scale=1e200)
    assert node.label.text == "R 1.00"
    far = rj.length_dimension((0, 0, 0), (3e200, 4e200, 0), scale=1e-200)
    assert far.label.text == "5.00"
    tiny = rj.angle_dimension((1e-200, 0, 0), (0, 0, 0), (0, 1e-200, 0))
    assert tiny.label.text == "90.0°"


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: rj.length_dimension((-1e308, 0, 0), (1e308, 0, 0)), "end"),
        (lambda: rj.length_dimension((0, 0, 0), (1.7e308, 1.7e308, 0)), "end"),
        (lambda: rj.length_dimension((1e308, 0, 0), (0, 0, 0), offset=(1e308, 0, 0)), "offset"),
        (lambda: rj.length_dimension((0, 0, 0), (1e200, 0, 0), scale=1e200), "scale"),
        (lambda: rj.radius_dimension((-1e308, 0, 0), (1e308, 0, 0)), "point"),
        (lambda: rj.angle_dimension((1, 0, 0), (0, 0, 0), (0, 1, 0), radius=1.7e308), "radius"),
    ],
)
def test_what_is_too_large_is_named(make, name):
    with pytest.raises(ValueError, match=f"^{name} must"):
        make()
