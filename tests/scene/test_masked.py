"""Masked arrays, and arrays where a number is wanted, are refused in words."""

from __future__ import annotations

import math
import re
import sys
import types

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene import transforms

FACES = [(0, 1, 2)]


def masked(array, count=1):
    """Return an array whose first entries are masked."""
    return np.ma.array(array, mask=np.arange(array.size).reshape(array.shape) < count)


TAKING = {
    "vertices": lambda value: rj.Mesh(value(np.eye(3)), FACES),
    "faces": lambda value: rj.Mesh(np.eye(3), value(np.array(FACES))),
    "uv": lambda value: rj.Mesh(np.eye(3), FACES, uv=value(np.zeros((3, 2)))),
    "colors": lambda value: rj.Mesh(np.eye(3), FACES, colors=value(np.ones((3, 3)))),
    "eye": lambda value: rj.PerspectiveCamera(eye=value(np.ones(3)), target=(0, 0, 0), fov_y=40),
    "color": lambda value: rj.AmbientLight(color=value(np.ones(3))),
    "image": lambda value: rj.Texture(value(np.zeros((4, 4, 3), np.uint8))),
    "sky": lambda value: rj.Environment(value(np.zeros((4, 8, 3), np.float32))),
    "ids": lambda value: rj.masks.find(value(np.zeros((4, 4), np.int32))),
}
"""What takes arrays, by the name of the argument."""


@pytest.mark.parametrize("name", TAKING)
def test_masked_entries_are_refused(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=rf"{name} must have no masked entries, got 2 of \d+"):
        TAKING[name](lambda array: masked(array, 2))
    TAKING[name](lambda array: masked(array, 0))


@pytest.mark.parametrize("value", [np.ma.masked, masked(np.ones(1))], ids=["one", "array"])
def test_a_masked_number_is_none(value):
    with pytest.raises(ValueError, match="fov_y must be a number"):
        rj.PerspectiveCamera(eye=(0, 0, 1), target=(0, 0, 0), fov_y=value)


@pytest.mark.parametrize("value", [masked(np.array([8, 8])), (8, np.ma.masked)])
def test_a_masked_size_is_none(value):
    with pytest.raises(ValueError, match=r"size must be \(width, height\) in pixels, got"):
        rj.Renderer(value)


@pytest.mark.parametrize("value", [np.ones(2), np.array([[1.0, math.inf]]), np.array(["a", "b"])])
def test_an_array_is_no_distance(value):
    with pytest.raises(ValueError, match=re.escape("far must be a number, got array(")):
        rj.PerspectiveCamera(eye=(0, 0, 1), target=(0, 0, 0), fov_y=40, far=value)
    with pytest.raises(ValueError, match="far must be a number"):
        transforms.perspective_depth(1.0, value)
    assert transforms.perspective_depth(1.0, np.float32(math.inf)) == (-1.0, -2.0)


def test_masked_arrays_that_another_thread_is_importing_are_none_yet(monkeypatch):
    monkeypatch.setitem(sys.modules, "numpy.ma", types.ModuleType("numpy.ma"))
    assert transforms.translate((1, 2, 3))[:3, 3].tolist() == [1.0, 2.0, 3.0]
