"""Sines and arc tangents of arrays are those of the math library, to the last bits."""

from __future__ import annotations

import math

import numpy as np

from rasterjit.scene import portable_trig


def test_sines_and_cosines():
    given = np.concatenate((np.linspace(-20, 20, 4001), [1e-300, 1e-9, math.pi, 1e4]))
    sine, cosine = portable_trig.sin_cos(given)
    assert max(abs(s - math.sin(a)) for s, a in zip(sine, given, strict=True)) < 5e-16
    assert max(abs(c - math.cos(a)) for c, a in zip(cosine, given, strict=True)) < 5e-16
    assert portable_trig.sin_cos(0.0) == (0.0, 1.0)


def test_arc_tangents_on_all_sides():
    turns = np.linspace(-math.pi, math.pi, 3001)[1:]
    for length in (1e-200, 1.0, 1e200):
        y, x = length * np.sin(turns), length * np.cos(turns)
        found = portable_trig.polar_angle(y, x)
        assert max(abs(f - math.atan2(*p)) for f, *p in zip(found, y, x, strict=True)) < 1e-15
    known = portable_trig.polar_angle([0, 0, 1, -1, 0, 2], [1, -1, 0, 0, 0, 2])
    np.testing.assert_allclose(known, np.array([0, 4, 2, -2, 0, 1]) * math.pi / 4, rtol=1e-16)


def test_no_angle_depends_on_its_neighbours():
    given = np.linspace(-7, 7, 1003)
    one_by_one = [portable_trig.sin_cos(a)[0] for a in given]
    assert portable_trig.sin_cos(given)[0].tolist() == one_by_one
    one_by_one = [float(portable_trig.polar_angle(a, 1.5)) for a in given]
    assert portable_trig.polar_angle(given, np.full(1003, 1.5)).tolist() == one_by_one
