"""The viewer in a terminal: pixels where it has them, else half blocks, coloured as they are."""

from __future__ import annotations

import base64
import fcntl
import os
import pty
import re
import select
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import termios
import time
import zlib
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES
from viewing import PATIENCE, VIEW

import rasterjit as rj
from rasterjit.viewer.terminal import (
    KEY_RELEASE_SECONDS,
    QUIT_KEY,
    InputReader,
    Screen,
    TerminalGraphics,
    encode_half_blocks,
    encode_sixels,
    format_panel,
    query_terminal,
)
from rasterjit.viewer.viewer import HELP_ROWS

pytestmark = pytest.mark.takes_long

if not os.environ.get("CI"):
    pytest.importorskip("blessed")

COLUMNS, LINES, TEXTS = 40, 15, 2
CELL = (9, 18)
"""Width and height of a cell of a terminal that shows pixels."""

"""Seconds for pictures to come, on a loaded machine."""

PLACE = re.compile(rb"\x1b\[(\d+);(\d+)H")
COLOR = re.compile(rb"\x1b\[(38|48);2;(\d+);(\d+);(\d+)m")
BLOCK = "▄".encode()

PLAIN = {b"\x1b[6n": b"\x1b[1;1R", b"\x1b[c": b"\x1b[?62;22c"}
"""What a terminal answers that shows text alone."""

PIXELS = {**PLAIN, b"\x1b[16t": b"\x1b[6;%d;%dt" % CELL[::-1]}
KITTY = {**PIXELS, b"\x1b_Gi=31,s=1,v=1,a=q": b"\x1b_Gi=31;OK\x1b\\"}
SIXEL = {**PIXELS, b"\x1b[c": b"\x1b[?62;4;22c"}

WHOLE_KITTY = re.compile(
    rb"\x1b_Ga=T,f=24,o=z,[^;]*?s=(\d+),v=(\d+),c=40,r=13,.*?m=0;.*?\x1b\\", re.S
)
KITTY_PART = re.compile(rb"\x1b_G[^;]*;([^\x1b]*)\x1b\\")
WHOLE_SIXEL = re.compile(rb"\x1bPq.*?\x1b\\", re.S)


def without_screen():
    """Return the environment without a display, and without the size of another terminal."""
    size = ("COLUMNS", "LINES")
    return {k: v for k, v in os.environ.items() if "DISPLAY" not in k and k not in size}


class Terminal:
    """A terminal of 40 x 15 characters in which a cube is viewed, or a program runs."""

    def __init__(self, folder, answers, program=""):
        self.path = folder / "cube.obj"
        lines = [f"v {x} {y} {z}" for x, y, z in CUBE_VERTICES]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in CUBE_FACES]
        self.path.write_text("\n".join(lines) + "\n")
        self._answers, self.said = answers, b""
        self._end, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", LINES, COLUMNS, 0, 0))
        view = ["-c", VIEW, "view", str(self.path), "--backend", "terminal", "--quiet"]
        variables = {"TERM": "xterm-256color", "COLORTERM": "truecolor"}
        self.process = subprocess.Popen(
            [sys.executable, *(["-c", program, str(self.path)] if program else view)],
            stdin=theirs, stdout=theirs, stderr=subprocess.PIPE, start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
            env={**without_screen(), **variables},
        )  # fmt: skip
        os.close(theirs)

    def wanted(self, size, quality):
        """Return the picture of the cube, (H, W, 3)."""
        frame = rj.render(rj.load(self.path), size=size, quality=quality)
        return frame.color[:, :, :3].astype(int)

    def read(self):
        """Read what the viewer says, and answer it; False if that is over."""
        if not select.select([self._end], [], [], 0.2)[0]:
            return True
        try:
            new = os.read(self._end, 1 << 16)
        except OSError:
            return False
        self.said += new
        for question, answer in self._answers.items():
            os.write(self._end, answer * new.count(question))
        return bool(new)

    def read_until(self, wanted):
        limit = time.monotonic() + PATIENCE
        while time.monotonic() < limit and self.read():
            if wanted(self.said):
                return
        pytest.fail(f"{len(self.said)} bytes, the last {self.said[-300:]!r}")

    def type(self, text):
        os.write(self._end, text)

    def ends(self):
        """Wait until the viewer has ended, and return what it said on standard error."""
        limit = time.monotonic() + PATIENCE
        # The terminal is gone when the last who holds it is.
        while self.process.poll() is None and time.monotonic() < limit:
            self.read()
        assert self.process.poll() is not None
        while self.read() and select.select([self._end], [], [], 0.1)[0]:
            pass
        return self.process.stderr.read().decode()

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()
        os.close(self._end)


@contextmanager
def terminal(folder, answers, program=""):
    one = Terminal(folder, answers, program)
    try:
        yield one
    finally:
        one.close()


def picture_in(said):
    """Return the last whole picture that a terminal was told to show, (H, W, 3); else None."""
    rows = {}
    for match in PLACE.finditer(said):
        end = PLACE.search(said, match.end())
        text = said[match.end() : end.start() if end else len(said)]
        if text.count(BLOCK) >= COLUMNS // 2:
            rows[int(match[1]) - 1] = text
    if set(rows) != set(range(LINES - TEXTS)):
        return None
    picture = np.full((2 * (LINES - TEXTS), COLUMNS, 3), -1)
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


def kitty_picture_in(said):
    """Return the last whole picture that kitty was told to show, (H, W, 3); else None."""
    whole = list(WHOLE_KITTY.finditer(said))
    if not whole:
        return None
    found = whole[-1]
    data = b"".join(part[1] for part in KITTY_PART.finditer(found[0]))
    pixels = np.frombuffer(zlib.decompress(base64.b64decode(data)), dtype=np.uint8)
    return pixels.reshape(int(found[2]), int(found[1]), 3).astype(int)


@pytest.mark.parametrize("key", [b"q", b"\x1b", b"\x03"])
def test_terminal_shows_the_picture_and_ends(tmp_path, key):
    with terminal(tmp_path, PLAIN) as one:
        wanted = one.wanted((COLUMNS, 2 * (LINES - TEXTS)), rj.Quality.reference())

        def is_shown(said):
            picture = picture_in(said)
            return picture is not None and (picture == wanted).all()

        one.read_until(is_shown)
        assert b" Q end  H help" in one.said
        one.type(key)
        assert one.ends() == ""
        assert one.process.returncode == 0
        # The screen is the one before, and nothing is written on it.
        behind = one.said.rpartition(b"\x1b[?1049l")[2]
        assert one.said.count(b"\x1b[?1049h") == one.said.count(b"\x1b[?1049l") == 1
        assert not re.sub(rb"\x1b(\[[?>=<\d;]*[A-Za-z]|[78=>])", b"", behind).strip()


def test_terminal_is_as_it_was_when_the_viewer_is_told_to_end(tmp_path):
    with terminal(tmp_path, PLAIN) as one:
        one.read_until(lambda said: b" Q end  H help" in said)
        one.process.terminate()
        one.ends()
        assert one.process.returncode == 128 + signal.SIGTERM
        assert one.said.count(b"\x1b[?1049l") == 1


def test_terminal_with_pixels_is_shown_each_of_them(tmp_path):
    with terminal(tmp_path, KITTY) as one:
        size = COLUMNS * CELL[0], (LINES - TEXTS) * CELL[1]
        wanted = one.wanted(size, rj.Quality.reference())

        def is_shown(said):
            picture = kitty_picture_in(said)
            return picture is not None and np.array_equal(picture, wanted)

        one.read_until(is_shown)
        assert BLOCK not in one.said
        one.type(b"q")
        assert one.ends() == ""
        assert b"a=d,d=I" in one.said.rpartition(b"a=T")[2]


def test_terminal_with_sixels_is_shown_nearly_each_pixel(tmp_path):
    with terminal(tmp_path, SIXEL) as one:
        size = COLUMNS * CELL[0], (LINES - TEXTS) * CELL[1]
        wanted = one.wanted(size, rj.Quality.reference())

        def is_shown(said):
            found = WHOLE_SIXEL.findall(said)
            picture = decoded(found[-1].decode()) if found else None
            if picture is None or picture.shape != wanted.shape:
                return False
            return np.abs(picture - wanted).max() < 1.5

        one.read_until(is_shown)
        assert BLOCK not in one.said
        one.type(b"q")
        assert one.ends() == ""


def decoded(sixels):
    """Return the picture that a terminal draws of sixels, (H, W, 3)."""
    head = re.match(r'\x1bPq"1;1;(\d+);(\d+)', sixels)
    width, height = map(int, head.groups())
    picture = np.full((height + 5, width, 3), -1.0)
    colors, color, column, band = {}, None, 0, 0
    command = re.compile(r"#(\d+);2;(\d+);(\d+);(\d+)|#(\d+)|(?:!(\d+))?([?-~])|([$-])")
    for found in command.finditer(sixels[head.end() : -2]):
        if found[1]:
            colors[int(found[1])] = [2.55 * int(found[k]) for k in (2, 3, 4)]
        elif found[5]:
            color = colors[int(found[5])]
        elif found[8]:
            column, band = 0, band + (found[8] == "-")
        else:
            count = int(found[6] or 1)
            for bit in range(6):
                if (ord(found[7]) - 63) >> bit & 1:
                    picture[6 * band + bit, column : column + count] = color
            column += count
    return picture[:height]


@pytest.mark.parametrize("size", [(1, 1), (7, 5), (30, 12), (41, 26)])
def test_sixels_are_the_pixels_in_their_colours(size):
    random = np.random.default_rng(3)
    palette = random.integers(0, 256, (256, 3)).astype(np.uint8)
    numbers = random.integers(0, 256, size[::-1]).astype(np.uint8)
    numbers[:, size[0] // 2 :] //= 100
    drawn = decoded(encode_sixels(numbers, palette))
    # Colours are whole percents.
    assert np.abs(drawn - palette[numbers]).max() <= 1.3


def test_half_blocks_without_all_colours_are_the_nearest_numbered_ones():
    levels = 0, 95, 135, 175, 215, 255
    known = [(r, g, b) for r in levels for g in levels for b in levels]
    known = np.array(known + [(grey,) * 3 for grey in range(8, 239, 10)])
    random = np.random.default_rng(5)
    picture = random.integers(0, 256, (2, 400, 3)).astype(np.uint8)
    # Half of them nearly grey, as shaded things are.
    picture[:, 200:] = np.clip(picture[:, 200:, :1] + random.integers(0, 6, (2, 200, 3)), 0, 255)
    picture[:, -1] = [[255, 255, 255], [0, 0, 0]]
    (line,) = encode_half_blocks(picture, False)
    found = re.findall(r"\x1b\[48;5;(\d+)m\x1b\[38;5;(\d+)m", line)
    drawn = known[np.array(found, dtype=int).T - 16]
    far = np.square(picture[:, :, None] - known).sum(axis=3)
    np.testing.assert_array_equal(np.square(picture - drawn).sum(axis=2), far.min(axis=2))
    assert len({number for pair in found for number in pair if int(number) >= 232}) == 24


def test_panel_folds_what_is_too_wide_and_cuts_what_is_too_long():
    rows = [("heading",), ("a", "one two three four five six"), ("bcd", "x")]
    assert [line.rstrip() for line in format_panel(rows, 24, 9)] == [
        " heading", " a    one two three", "      four five six", " bcd  x",
    ]  # fmt: skip
    assert [line.rstrip() for line in format_panel(rows, 24, 2)] == [" heading", " ..."]
    assert len({len(line) for line in format_panel(rows, 24, 9)}) == 1


def test_way_of_the_environment_is_taken_unless_there_is_none(monkeypatch):
    monkeypatch.setenv("RASTERJIT_TERMINAL", "blocks")
    assert query_terminal(0, pytest.fail).protocol == "blocks"
    monkeypatch.setenv("RASTERJIT_TERMINAL", "tektronix")
    with pytest.raises(ValueError, match="RASTERJIT_TERMINAL"):
        query_terminal(0, pytest.fail)


def stroke(value="", name="", **more):
    fields = {"name": name, "key_name": name, "value": value, "released": False, "repeated": False}
    return SimpleNamespace(**{**fields, **more})


@pytest.mark.parametrize("tells_releases", [False, True])
def test_keys_are_held_or_act_each_time(tells_releases):
    screen = Screen(TerminalGraphics("blocks", (8, 16)), lambda text: None, lambda: (40, 15))
    events = []
    screen.add_event_handler(lambda event: events.append(tuple(event.values())[:2]), "key_up")
    hands = InputReader(screen, tells_releases)
    assert [hands.read(stroke("g")) for _ in range(2)] == ["g", "g"]
    assert [hands.read(stroke(name="KEY_LEFT")) for _ in range(2)] == ["ArrowLeft", ""]
    assert hands.read(stroke(name="KEY_PGDOWN")) == "q"
    assert [hands.read(one) for one in (stroke("q"), stroke("\x03"))] == [QUIT_KEY, QUIT_KEY]
    time.sleep(1.5 * KEY_RELEASE_SECONDS)
    hands.release_stale()
    released = [("key_up", "ArrowLeft"), ("key_up", "q")]
    assert events == ([] if tells_releases else released)
    if tells_releases:
        hands.read(stroke(name="KEY_LEFT", released=True))
        assert events == released[:1]


@pytest.fixture
def tmux(tmp_path):
    """A function that runs tmux with a server of its own."""
    if shutil.which("tmux") is None:
        assert not os.environ.get("CI")
        pytest.skip("no tmux")

    def run(*words):
        command = ["tmux", "-S", str(tmp_path / "socket"), "-f", "/dev/null", *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    yield run
    with suppress(subprocess.CalledProcessError):
        run("kill-server")


def test_help_fits_and_escape_closes_it_before_it_ends(tmux):
    def screen():
        return tmux("capture-pane", "-p").splitlines()

    def wait_for(wanted):
        limit = time.monotonic() + PATIENCE
        while time.monotonic() < limit:
            if wanted(screen()):
                return
            time.sleep(0.1)
        pytest.fail("\n".join(screen()))

    tmux("new-session", "-d", "-x", "80", "-y", "24", "env PS1='ready> ' sh")
    wait_for(lambda lines: any(line.startswith("ready>") for line in lines))
    model = Path(__file__).parents[2] / "models" / "teapot.obj"
    words = "-m", "rasterjit", "view", model, "--backend", "terminal", "--quiet"
    tmux("send-keys", "clear; " + shlex.join(map(str, (sys.executable, *words))), "Enter")
    wait_for(lambda lines: lines and "Q end  H help" in lines[-1])
    tmux("send-keys", "h")
    wait_for(lambda lines: any("ends it, as Escape does" in line for line in lines))
    text = " ".join(" ".join(line.replace("▄", "").split()) for line in screen())
    for cells in HELP_ROWS:
        assert " ".join(" ".join(cells).split()) in text
    assert "Q end  H help" in screen()[-1]
    tmux("send-keys", "Escape")
    wait_for(lambda lines: not any("as Escape does" in line for line in lines))
    assert "Q end  H help" in screen()[-1]
    tmux("send-keys", "Escape")
    wait_for(lambda lines: not any("▄" in line for line in lines))
    wait_for(lambda lines: ["", *filter(None, lines)][-1].strip() == "ready>")
    assert sum("ready>" in line for line in screen()) == 1


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


SHOW = """
import sys
import rasterjit as rj
rj.render(rj.load(sys.argv[1]), size=({size}), threads=1).show()
"""


@pytest.mark.parametrize("size", [(26, 12), (20, 9), (80, 60)])
def test_frame_shows_itself_in_half_blocks_no_larger_than_the_terminal(tmp_path, size):
    program = SHOW.replace("{size}", f"{size[0]}, {size[1]}")
    with terminal(tmp_path, PLAIN, program) as one:
        assert one.ends() == ""
        lines = one.said[one.said.index(b"\x1b[48;2") :].split(b"\r\n")
        shown = [line.count(BLOCK) for line in lines if BLOCK in line]
        scale = min(1.0, COLUMNS / size[0], 2 * (LINES - 1) / size[1])
        assert shown == [round(size[0] * scale)] * -(-round(size[1] * scale) // 2)
        if scale == 1.0:
            picture = one.wanted(size, None)
            tops = [tuple(map(int, COLOR.search(line)[0][7:-1].split(b";"))) for line in lines[:-1]]
            assert tops == [tuple(row[0]) for row in picture[::2]]


def test_frame_shows_each_pixel_where_the_terminal_has_them(tmp_path):
    with terminal(tmp_path, KITTY, SHOW.replace("{size}", "90, 60")) as one:
        assert one.ends() == ""
        whole = re.search(rb"\x1b_Ga=T.*?s=90,v=60,c=10,r=4,.*?m=0;.*?\x1b\\", one.said, re.S)
        data = b"".join(part[1] for part in KITTY_PART.finditer(whole[0]))
        pixels = np.frombuffer(zlib.decompress(base64.b64decode(data)), dtype=np.uint8)
        np.testing.assert_array_equal(pixels.reshape(60, 90, 3), one.wanted((90, 60), None))


def test_frame_that_cannot_be_shown_says_what_to_do(tmp_path, cube):
    path = tmp_path / "cube.obj"
    cube.to_trimesh().export(path)
    done = subprocess.run(
        [sys.executable, "-c", SHOW.replace("{size}", "8, 8"), path],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, env=without_screen(),
    )  # fmt: skip
    assert done.returncode == 1
    assert 'frame.save("picture.png")' in done.stderr.splitlines()[-1]
