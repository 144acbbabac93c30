"""The figure shows the field by the colours of its bar, with lines where the bar has them."""

from __future__ import annotations

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

import rasterjit as rj


@pytest.fixture
def module(program):
    mpl.use("agg")
    yield program("figure")
    plt.close("all")


def test_colors_are_those_of_the_bar(module):
    mesh = module.surface(contours=False)
    mesh.material = rj.Material("unlit")
    frame = rj.render(mesh, size=(160, 120), outputs=("color", "scalar"))
    seen = np.isfinite(frame.scalar)
    shown = frame.color[seen][:, :3].astype(int)
    bar = module.COLORMAP((frame.scalar[seen].astype(float) + 1.0) / 2.0, bytes=True)[:, :3]
    # float32 of the scalar may fall into the next of 256 entries.
    assert np.abs(shown - bar).max() <= 6
    assert (shown == bar).all(axis=1).mean() > 0.99


def test_lines_lie_at_the_levels(module):
    mesh = module.surface(contours=True)
    mesh.material = rj.Material("unlit")
    frame = rj.render(mesh, size=(320, 240), outputs=("color", "scalar"))
    dark = frame.color[..., :3].max(axis=2) < 40
    off = np.abs(frame.scalar[dark][:, None] - module.LEVELS).min(axis=1)
    assert dark.sum() > 500
    rows, columns = np.gradient(np.nan_to_num(frame.scalar))
    slope = np.hypot(rows, columns)[dark]
    inside = slope < 0.2  # the outline has none
    assert (off[inside] < 1.5 * slope[inside] + 0.01).mean() > 0.98


def test_the_field_is_the_harmonic(module):
    unit, faces = module.sphere(24)
    field = module.vibration(unit)
    assert np.abs(field).max() == pytest.approx(1.0, abs=0.01)
    assert faces.max() == len(unit) - 1
    a, b, c = (unit[faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    assert np.linalg.norm(area, axis=1).sum() / 2.0 == pytest.approx(4.0 * np.pi, rel=0.01)
    assert ((area * (a + b + c)).sum(axis=1) >= 0.0).all()  # counter-clockwise from outside


def test_both_files_are_written(module):
    module.main(["--dpi", "60"])
    with Image.open("figure.png") as picture:
        assert picture.size == (540, 204)
        pixels = np.array(picture.convert("RGB")).astype(int)
    flat = pixels[:, 180:360]
    red, blue = flat[..., 0] - flat[..., 2] > 80, flat[..., 2] - flat[..., 0] > 80
    assert min(red.sum(), blue.sum()) > 300
    with open("figure.pdf", "rb") as file:
        text = file.read()
    assert text.startswith(b"%PDF")
    assert text.count(b"/Subtype /Image") >= 2
