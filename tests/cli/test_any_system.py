"""
What works alike on every system: names, ends of lines, long paths, Ctrl-C, full folders, processes.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from contextlib import suppress
from pathlib import Path

import pytest
from PIL import Image

from rasterjit.runtime import jit

pytestmark = pytest.mark.takes_long

TRIANGLE = "mtllib a.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
MATERIAL = "newmtl red\nKd 1 0 0\n"

FULL_FOLDER = "FULL_FOLDER"
"""Environment variable that names a folder of a file system with little room."""

MAX_SECONDS = 300.0

CONSOLE = """
import ctypes, signal, subprocess, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
time.sleep(PAUSE)
assert process.poll() is None, process.communicate()
assert ctypes.windll.kernel32.GenerateConsoleCtrlEvent(0, 0)
out, said = process.communicate()
sys.stderr.buffer.write(said)
sys.exit(process.returncode)
"""
"""Runs a program in a console of its own, and presses Ctrl-C there: so it comes on Windows."""


def run(*words, **environment):
    """Run the command line as a program; return what it did."""
    return subprocess.run(
        [sys.executable, "-m", "rasterjit", *map(str, words)], capture_output=True, check=False,
        env={**os.environ, **environment}, timeout=MAX_SECONDS,
    )  # fmt: skip


def write_model(folder, name="a.obj", end="\n"):
    """Write a red triangle with its material; return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in (("a.mtl", MATERIAL), (name, TRIANGLE)):
        (folder / file).write_bytes(text.replace("\n", end).encode())
    return folder / name


@pytest.mark.parametrize("name", ["two words", "größe", "Мир", "猫", "שלום", "e\u0301"])
def test_any_name_is_read_and_written(tmp_path, name):
    model = write_model(tmp_path / name, f"{name}.obj")
    picture = tmp_path / name / f"{name}.png"
    # As a pipe of Windows has it, whose code page lacks most letters.
    done = run("render", model, "-o", picture, "--size", "16x16", PYTHONIOENCODING="cp1252")
    assert (done.returncode, done.stderr) == (0, b"")
    with Image.open(picture) as image:
        assert image.size == (16, 16)


def test_ends_of_lines_change_no_pixel(tmp_path):
    pictures = []
    for number, end in enumerate(("\n", "\r\n")):
        folder = tmp_path / str(number)
        model, picture = write_model(folder, end=end), folder / "a.png"
        assert run("render", model, "-o", picture, "--size", "16x16").returncode == 0
        pictures.append(picture.read_bytes())
    assert pictures[0] == pictures[1]


def test_a_path_of_more_than_260_letters_is_read_and_written(tmp_path):
    folder = tmp_path
    while len(str(folder)) < 300:
        folder = folder / ("long" * 10)
    try:
        model = write_model(folder)
    except OSError:
        pytest.skip("this system is not set to allow such paths")
    assert run("render", model, "-o", folder / "a.png", "--size", "16x16").returncode == 0
    assert (folder / "a.png").stat().st_size > 0


def test_ctrl_c_leaves_no_file(tmp_path):
    model, film = write_model(tmp_path), tmp_path / "a.gif"
    command = [sys.executable, "-m", "rasterjit", "turntable", str(model), "-o", str(film)]
    command += ["--size", "512x512", "--frames", "3600", "--quiet"]
    pause = 6.0
    if sys.platform == "win32":
        console = [sys.executable, "-c", CONSOLE.replace("PAUSE", str(pause)), *command]
        flags = subprocess.CREATE_NEW_CONSOLE
        done = subprocess.run(console, creationflags=flags, stderr=subprocess.PIPE, check=False)
        status, said = done.returncode, done.stderr
    else:
        with subprocess.Popen(command, stderr=subprocess.PIPE) as running:
            time.sleep(pause)
            running.send_signal(signal.SIGINT)
            _, said = running.communicate(timeout=MAX_SECONDS)
        status = running.returncode
    assert (status, said.strip()) == (130, b"error: interrupted")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mtl", "a.obj"]


def test_processes_of_a_data_set_write_what_one_does(tmp_path):
    for name in ("one", "two"):
        write_model(tmp_path / "meshes", f"{name}.obj")
    found = []
    for workers in (1, 2):
        folder = tmp_path / str(workers)
        done = run(
            "dataset", tmp_path / "meshes", "-o", folder, "--views", 2, "--size", 16, "-q",
            "--workers", workers,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, b"")
        paths = [path for path in sorted(folder.rglob("*.png"))]
        found.append({path.relative_to(folder): path.read_bytes() for path in paths})
    assert found[0] == found[1]
    assert len(found[0]) > 4


LINES = """
import rasterjit as rj
from rasterjit.runtime import store
picture = rj.Framebuffer(32, 32)
picture.draw_line((1, 2), (30, 20), (255, 0, 0), end_color=(0, 0, 255))
print(picture.color.tobytes().hex(), len(store.USED_KERNELS.compiled))
"""


@pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="nothing is kept")
def test_two_processes_fill_one_store(tmp_path):
    # No wheel has code for this CPU.
    environment = {**os.environ, "RASTERJIT_CACHE_DIR": str(tmp_path), "NUMBA_CPU_NAME": "generic"}
    environment["NUMBA_CPU_FEATURES"] = ""

    def start():
        command = [sys.executable, "-c", LINES]
        return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)

    together = [start(), start()]
    said = [process.communicate(timeout=MAX_SECONDS)[0].split() for process in together]
    picture, _ = said[0]
    assert [pictures for pictures, _ in said] == [picture, picture]
    assert start().communicate(timeout=MAX_SECONDS)[0].split() == [picture, "0"]


def test_the_page_of_a_view_answers(tmp_path):
    command = [sys.executable, "-m", "rasterjit", "view", str(write_model(tmp_path))]
    command += ["--backend", "browser", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as serving:
        try:
            lines = (line.decode() for line in serving.stdout)
            address = next(filter(None, (re.search(r"http://\S+", line) for line in lines)))[0]
            with urllib.request.urlopen(address, timeout=MAX_SECONDS) as answer:
                assert b"<canvas" in answer.read()
        finally:
            serving.kill()


def fill(path):
    """Write a file that leaves its file system no room."""
    with path.open("wb", buffering=0) as file, suppress(OSError):
        while file.write(bytes(4096)) == 4096:
            pass


@pytest.mark.skipif(FULL_FOLDER not in os.environ, reason=f"{FULL_FOLDER} names no such folder")
def test_a_full_folder_is_told_and_holds_no_half_of_a_file(tmp_path):
    folder = Path(os.environ[FULL_FOLDER])
    kernels = folder / "kernels"
    kernels.mkdir(exist_ok=True)
    filler = folder / "filler"
    fill(filler)
    try:
        model, picture = write_model(tmp_path), folder / "a.png"
        done = run(
            "render", model, "-o", picture, "--size", "640x480", RASTERJIT_CACHE_DIR=str(kernels)
        )
        assert done.returncode == 1
        said = done.stderr.decode().splitlines()
        assert said[-1] == f"error: {picture}: No space left on device"
        assert [path.name for path in folder.iterdir() if path.is_file()] == ["filler"]
        assert list(kernels.iterdir()) == []
    finally:
        filler.unlink()
