"""Thumbnails of a folder: every mesh has one, and broken files stop nothing."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from PIL import Image

SIDE = 64


@pytest.fixture
def folder(program, tmp_path):
    (tmp_path / "meshes/more").mkdir(parents=True)
    shutil.copy("models/cube.ply", tmp_path / "meshes/cube.ply")
    shutil.copy("models/teapot.obj", tmp_path / "meshes/more/teapot.OBJ")
    (tmp_path / "meshes/a_broken.ply").write_text("ply\nformat ascii 1.0\n")
    (tmp_path / "meshes/notes.txt").write_text("no mesh")
    return tmp_path / "meshes"


def test_broken_files_are_named_and_the_others_drawn(program, folder, capsys):
    with pytest.raises(SystemExit, match=r"1 of 3 could not be drawn: a_broken\.ply"):
        program("thumbnails").main([str(folder), "--side", str(SIDE), "--columns", "2"])
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["a_broken.ply", "cube.ply", "more/teapot.OBJ"]
    assert "end_header" in lines[0]
    assert str(folder) not in lines[0]
    assert lines[2].endswith("7,656 faces")
    for name in ("cube.ply", "more/teapot.OBJ"):
        with Image.open(f"thumbnails/{name}.png") as picture:
            pixels = np.array(picture.convert("RGB"))
        assert pixels.shape == (SIDE, SIDE, 3)
        drawn = (pixels != pixels[0, 0]).any(axis=2)
        assert 0.15 < drawn.mean() < 0.9
    with Image.open("thumbnails/sheet.png") as sheet:
        assert sheet.size == (2 * SIDE, 2 * (SIDE + 34))
        cells = np.array(sheet.convert("RGB"))
    assert tuple(cells[2, 2]) == (0xF6, 0xDC, 0xDC)
    with Image.open("thumbnails/cube.ply.png") as picture:
        assert np.array_equal(cells[:SIDE, SIDE:], np.array(picture.convert("RGB")))


def test_a_whole_folder_exits_well_and_an_empty_one_does_not(program, folder, tmp_path):
    (folder / "a_broken.ply").unlink()
    module = program("thumbnails")
    module.main([str(folder), "--side", str(SIDE)])
    (tmp_path / "empty").mkdir()
    with pytest.raises(SystemExit, match="holds no meshes"):
        module.main([str(tmp_path / "empty")])
