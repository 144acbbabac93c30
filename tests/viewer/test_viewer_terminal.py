"""The viewer in a terminal: half blocks, coloured as the picture is."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time
from contextlib import suppress

import numpy as np
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES

import rasterjit as rj

pytestmark = pytest.mark.takes_long

if not os.environ.get("CI"):
    pytest.importorskip("blessed")

COLUMNS, LINES = 40, 15
PATIENCE = 60.0
"""Seconds for pictures to come, on a loaded machine."""

PLACE = re.compile(rb"\x1b\[(\d+);(\d+)H")
COLOR = re.compile(rb"\x1b\[(38|48);2;(\d+);(\d+);(\d+)m")
BLOCK = "▄".encode()


def read_until(end, wanted):
    """Be a terminal, and read until what was read is what is wanted."""
    limit, said = time.monotonic() + PATIENCE, b""
    while time.monotonic() < limit:
        ready, _, _ = select.select([end], [], [], 0.5)
        if ready:
            try:
                new = os.read(end, 1 << 16)
            except OSError:
                break
            said += new
            # All that this terminal can tell is where its cursor is.
            os.write(end, b"\x1b[1;1R" * new.count(b"\x1b[6n"))
        if wanted(said):
            return said
    pytest.fail(f"{len(said)} bytes, the last {said[-300:]!r}")


def picture_in(said):
    """Return the last whole picture that a terminal was told to show, (H, W, 3); else None."""
    rows = {}
    for match in PLACE.finditer(said):
        row, column = int(match[1]) - 1, int(match[2]) - 1
        line = said[match.end() :].split(b"\x1b[", 1)[0] if column else None
        if line is None:
            end = PLACE.search(said, match.end())
            text = said[match.end() : end.start() if end else len(said)]
            if text.count(BLOCK) >= COLUMNS // 2:
                rows[row] = text
    if set(rows) != set(range(LINES)):
        return None
    picture = np.full((2 * LINES, COLUMNS, 3), -1)
    for row, text in rows.items():
        column, colors = 0, {b"48": (0, 0, 0), b"38": (0, 0, 0)}
        for part in re.split(rb"(\x1b\[[0-9;]*m)", text):
            code = COLOR.fullmatch(part)
            if code:
                colors[code[1]] = tuple(map(int, code.groups()[1:]))
            elif not part.startswith(b"\x1b"):
                for _ in range(part.count(BLOCK)):
                    picture[2 * row : 2 * row + 2, column] = colors[b"48"], colors[b"38"]
                    column += 1
    return picture


def test_terminal_shows_the_picture_and_ends(tmp_path):
    path = tmp_path / "cube.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE_VERTICES]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in CUBE_FACES]
    path.write_text("\n".join(lines) + "\n")
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", LINES, COLUMNS, 0, 0))
    process = subprocess.Popen(
        [sys.executable, "-m", "rasterjit", "view", str(path), "--backend", "terminal",
         "--quiet"],
        stdin=theirs, stdout=theirs, stderr=subprocess.PIPE, start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        env={**os.environ, "TERM": "xterm-256color", "COLORTERM": "truecolor"},
    )  # fmt: skip
    os.close(theirs)
    try:
        scene = rj.load(path)
        size = (COLUMNS, 2 * LINES)
        frame = rj.render(scene, size=size, quality=rj.Quality.reference())
        wanted = frame.color[:, :, :3].astype(int)

        def is_shown(said):
            picture = picture_in(said)
            # Two buttons lie over the first line.
            return picture is not None and (picture[2:] == wanted[2:]).all()

        read_until(ours, is_shown)
        os.write(ours, b"\x03")
        limit = time.monotonic() + PATIENCE
        while process.poll() is None and time.monotonic() < limit:
            # The terminal is gone when the last who holds it is.
            with suppress(OSError):
                if select.select([ours], [], [], 0.1)[0]:
                    os.read(ours, 1 << 16)
        assert process.poll() is not None
        assert b"Traceback" not in process.stderr.read()
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()
        os.close(ours)


def test_pipe_is_no_terminal(tmp_path, cube):
    path = tmp_path / "face.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    done = subprocess.run(
        [sys.executable, "-m", "rasterjit", "view", str(path), "--backend", "terminal"],
        capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL, timeout=PATIENCE,
    )  # fmt: skip
    assert done.returncode == 1
    assert "error: --backend must not be 'terminal' where standard input or output" in done.stderr


def test_missing_package_is_one_line(tmp_path):
    path = tmp_path / "face.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    code = (
        "import sys; sys.modules['uvicorn'] = None; from rasterjit.cli.commands import main; "
        f"sys.argv = ['rasterjit', 'view', {str(path)!r}, '--backend', 'browser', '--quiet']; "
        "main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=PATIENCE
    )
    assert done.returncode == 1
    assert done.stderr.startswith('error: the browser needs a server: pip install "rasterjit[')
    assert done.stderr.count("\n") == 1
