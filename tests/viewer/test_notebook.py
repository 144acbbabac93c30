"""Notebooks show frames, scenes and meshes as pictures, and a viewer as a widget."""

from __future__ import annotations

import base64
import io
import os

import numpy as np
import pytest
from PIL import Image

import rasterjit as rj
from rasterjit.rendering.preview import SIZE
from rasterjit.scene.hooks import HOOKS

pytestmark = pytest.mark.takes_long

PATIENCE = 240
"""Seconds for a cell, on a loaded machine."""


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGBA"))


def test_mesh_and_scene_show_themselves_fitted(cube):
    scene = rj.Scene()
    scene.add(cube)
    frame = rj.render(cube, size=SIZE)
    for thing in (cube, scene):
        np.testing.assert_array_equal(pixels(thing._repr_png_()), frame.color)
    np.testing.assert_array_equal(pixels(frame._repr_png_()), frame.color)


def test_nothing_to_see_shows_no_picture(cube):
    empty = rj.Scene()
    assert empty._repr_png_() is None
    line = rj.Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    assert line._repr_png_() is None
    wrong = rj.Scene()
    wrong.add(cube)
    wrong.fog = "thick"
    assert wrong._repr_png_() is None


def test_scenes_do_without_who_draws_them(cube, monkeypatch):
    monkeypatch.delitem(HOOKS, "picture")
    assert cube._repr_png_() is None


CELLS = (
    "import rasterjit as rj\n"
    "mesh = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])\n"
    "scene = rj.Scene(); node = scene.add(mesh)",
    "rj.render(mesh, size=(8, 6))",
    "mesh",
    "scene",
    "rj.Scene()",
    "rj.show(scene, size=(64, 48))",
)


def test_notebook_shows_all_of_them(tmp_path):
    if not os.environ.get("CI"):
        pytest.importorskip("nbclient")
        pytest.importorskip("anywidget")
    import nbclient
    import nbformat

    book = nbformat.v4.new_notebook()
    book.cells = [nbformat.v4.new_code_cell(text) for text in CELLS]
    nbclient.NotebookClient(book, timeout=PATIENCE, kernel_name="python3").execute()
    shown = [{} if not cell.outputs else cell.outputs[-1].data for cell in book.cells]
    _, frame, mesh, scene, empty, widget = shown
    mesh_here = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    for data, size in ((frame, (8, 6)), (mesh, SIZE), (scene, SIZE)):
        expected = rj.render(mesh_here, size=size).color
        np.testing.assert_array_equal(pixels(base64.b64decode(data["image/png"])), expected)
    assert "image/png" not in empty
    assert empty["text/plain"] == repr(rj.Scene())
    assert "application/vnd.jupyter.widget-view+json" in widget
