"""
Show a viewer in a terminal: the picture, what is told of it, and which keys there are.

Terminals that know kitty's graphics or sixels get every pixel, others half blocks. Help, numbers
and explanations are text of the terminal.
"""

from __future__ import annotations

import base64
import contextlib
import io
import os
import re
import select
import signal
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.runtime.progress import show_progress_by
from rasterjit.scene.validation import needs_extra, one_of
from rasterjit.viewer.canvas import CanvasDriver, DrawCancelled, is_at_terminal
from rasterjit.viewer.controls import MOVE_KEYS, TURN_KEYS, Event, Fly
from rasterjit.viewer.overlay import Row
from rasterjit.viewer.viewer import HELP_ROWS, Viewer

KITTY_CHUNK = 4096
"""Characters of a picture in one command of kitty's, at most."""

SIXEL_COLORS = 256
"""Of a picture in sixels, at most."""

SIXEL_BAND = 6
"""Rows of pixels in one row of sixels."""

FIRST_SIXEL = 63
"""Code of the character for a column of a band without any pixel."""

SIXEL_COLOR_SCALE = 100
"""Sixels take colours as whole percents."""

MIN_SIXEL_RUN = 4
"""Equal sixels from which on their number is shorter than they are."""

CUBE_SIDE, FIRST_OF_CUBE = 6, 16
"""Steps of red, green and blue among the 256 numbered colours, and the number of black."""

CUBE_LEVELS = np.array([0, 95, 135, 175, 215, 255])
FIRST_GREY, GREY_LEVELS = 232, np.arange(8, 239, 10)
"""Of the numbered colours as xterm has them, sRGB; and the number of the darkest grey."""

CUBE_BORDERS, GREY_BORDERS = ((some[1:] + some[:-1]) / 2.0 for some in (CUBE_LEVELS, GREY_LEVELS))
"""Between levels: what lies below is nearer to the darker one."""

HALF_BLOCK = "▄"


def encode_kitty(picture: NDArray[np.uint8], number: int, cells: tuple[int, int]) -> str:
    """
    Return the Kitty commands that show a picture below the text, from the cursor on.

    Parameters
    ----------
    picture : (H, W, 3) uint8, sRGB
    number : int
        What the terminal calls the picture, above 0.
    cells : (int, int)
        Columns and rows that it covers.
    """
    height, width = picture.shape[:2]
    data = base64.b64encode(zlib.compress(picture.tobytes(), 1)).decode()
    chunks = [data[start : start + KITTY_CHUNK] for start in range(0, len(data), KITTY_CHUNK)]
    last = len(chunks) - 1
    # Transmit and show (a=T) RGB (f=24), packed (o=z), without an answer (q=2), below the text
    # (z=-1), without moving the cursor (C=1).
    head = f"a=T,f=24,o=z,q=2,z=-1,C=1,i={number},s={width},v={height},c={cells[0]},r={cells[1]},"
    return "".join(
        f"\x1b_G{'' if k else head}m={int(k < last)};{chunk}\x1b\\"
        for k, chunk in enumerate(chunks)
    )


def delete_kitty(number: int) -> str:
    """Return the Kitty command that deletes a picture."""
    return f"\x1b_Ga=d,d=I,q=2,i={number}\x1b\\"


def encode_sixel(picture: NDArray[np.uint8]) -> str:
    """
    Return the sixel command that shows a picture from the cursor on, in its 256 best colours.

    Parameters
    ----------
    picture : (H, W, 3) uint8, sRGB
    """
    from PIL import Image

    image = Image.fromarray(picture).quantize(
        SIXEL_COLORS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
    palette = np.frombuffer(image.palette.tobytes(), dtype=np.uint8).reshape(-1, 3)
    return encode_sixels(np.asarray(image), palette)


def encode_sixels(numbers: NDArray[np.uint8], palette: NDArray[np.uint8]) -> str:
    """
    Encode a picture of palette indices as sixels.

    Parameters
    ----------
    numbers : (H, W) uint8
    palette : (C, 3) uint8, sRGB
    """
    height, width = numbers.shape
    # Each pixel sets a bit of the sixel of its band, colour and column. Sorted by that, sixels
    # without a pixel are not there at all.
    rows, columns = np.divmod(np.arange(height * width), width)
    bands, bits = np.divmod(rows, SIXEL_BAND)
    positions = (bands * SIXEL_COLORS + numbers.ravel()) * width + columns
    order = np.argsort(positions, kind="stable")
    positions, bits = positions[order], bits[order]
    firsts = np.flatnonzero(np.r_[True, positions[1:] != positions[:-1]])
    sixels = np.add.reduceat(1 << bits, firsts)
    positions = positions[firsts]
    # Join equal neighbours to runs.
    lines, columns = np.divmod(positions, width)
    is_first = (
        (lines[1:] != lines[:-1]) | (columns[1:] != columns[:-1] + 1) | (sixels[1:] != sixels[:-1])
    )
    firsts = np.flatnonzero(np.r_[True, is_first])
    counts = np.diff(np.r_[firsts, len(positions)])
    runs = zip(
        *(one[firsts].tolist() for one in (lines, columns, sixels)), counts.tolist(), strict=True
    )
    used = np.unique(numbers)
    parts = [f'\x1bPq"1;1;{width};{height}']
    parts += [_define_color(int(number), palette[number]) for number in used]
    band, line, end = 0, -1, 0
    for run_line, start, bits_set, count in runs:
        if run_line != line:
            line, end = run_line, 0
            parts.append("-" * (line // SIXEL_COLORS - band) or "$")
            band = line // SIXEL_COLORS
            parts.append(f"#{line % SIXEL_COLORS}")
        if start > end:
            parts.append(_encode_run(0, start - end))
        parts.append(_encode_run(bits_set, count))
        end = start + count
    return "".join([*parts, "\x1b\\"])


def _define_color(number: int, color: NDArray[np.uint8]) -> str:
    """Return the sixel command that defines a colour."""
    red, green, blue = ((int(code) * 2 * SIXEL_COLOR_SCALE + 255) // 510 for code in color)
    return f"#{number};2;{red};{green};{blue}"


@lru_cache(maxsize=4096)
def _encode_run(bits: int, count: int) -> str:
    """Return a run of equal sixels."""
    character = chr(FIRST_SIXEL + bits)
    return character * count if count < MIN_SIXEL_RUN else f"!{count}{character}"


def encode_half_blocks(picture: NDArray[np.uint8], is_true: bool = True) -> list[str]:
    """
    Return lines of half blocks, two rows of pixels in each.

    Parameters
    ----------
    picture : (H, W, 3) uint8, sRGB
        ``H`` is even.
    is_true : bool
        Whether the terminal knows all colours; else the nearest of 6 x 6 x 6 and of 24 greys.
    """
    if not is_true:
        return _encode_indexed_blocks(picture)
    pairs = np.concatenate([picture[::2], picture[1::2]], axis=2)
    is_new = np.ones(pairs.shape[:2], dtype=bool)
    is_new[:, 1:] = (pairs[:, 1:] != pairs[:, :-1]).any(axis=2)
    lines = []
    for row, first in zip(pairs, is_new, strict=True):
        starts = np.flatnonzero(first)
        counts = np.diff(np.r_[starts, len(row)]).tolist()
        lines.append(
            "".join(
                f"\x1b[48;2;{a};{b};{c}m\x1b[38;2;{d};{e};{f}m{HALF_BLOCK * count}"
                for (a, b, c, d, e, f), count in zip(row[starts].tolist(), counts, strict=True)
            )
            + "\x1b[0m"
        )
    return lines


def _find_nearest_colors(picture: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the palette indices of the nearest colours, (H, W), of the cube and of the greys."""
    target = picture.astype(np.int64)
    steps = np.searchsorted(CUBE_BORDERS, target, side="right")
    red, green, blue = np.moveaxis(steps, 2, 0)
    grey = np.searchsorted(GREY_BORDERS, target.mean(axis=2), side="right")
    cube_error = np.square(CUBE_LEVELS[steps] - target).sum(axis=2)
    grey_error = np.square(GREY_LEVELS[grey][:, :, None] - target).sum(axis=2)
    cube = FIRST_OF_CUBE + (red * CUBE_SIDE + green) * CUBE_SIDE + blue
    return np.where(grey_error < cube_error, FIRST_GREY + grey, cube)


def _encode_indexed_blocks(picture: NDArray[np.uint8]) -> list[str]:
    """Return lines of half blocks in palette colours."""
    numbers = _find_nearest_colors(picture)
    return [
        "".join(
            f"\x1b[48;5;{top}m\x1b[38;5;{bottom}m{HALF_BLOCK}"
            for top, bottom in zip(*pair.tolist(), strict=True)
        )
        + "\x1b[0m"
        for pair in numbers.reshape(-1, 2, picture.shape[1])
    ]


MAX_FRAME_RATE = 30.0
"""Most pictures a second: a terminal takes long to show one."""

RESIZE_CHECK_SECONDS = 0.1
"""Seconds between checks of the terminal's size, at rest."""

PROTOCOL_VARIABLE = "RASTERJIT_TERMINAL"
"""Environment variable that names the graphics protocol, in place of asking the terminal."""

PROTOCOLS = ("kitty", "sixel", "blocks")

ANSWER_TIMEOUT_SECONDS = 1.0
"""Seconds to wait for a terminal's answers; those far away answer within a quarter."""

TERMINAL_QUERIES = "\x1b_Gi=31,s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\\x1b[16t\x1b[c"
"""Does it know kitty's graphics; how many pixels has a cell; what else can it do. All terminals
answer the last one, so that nobody waits for an answer to the others."""

ATTRIBUTES_ANSWER = re.compile(rb"\x1b\[\?([\d;]+)c")
CELL_ANSWER = re.compile(rb"\x1b\[6;(\d+);(\d+)t")
KITTY_ANSWER = b"\x1b_Gi=31;OK"
SIXEL_ATTRIBUTE = b"4"

DEFAULT_CELL = (8, 16)
"""Default width and height of a cell, pixels; events count in these."""

MAX_PICTURE_PIXELS = 1_000_000
"""Most pixels of a picture; larger terminals get coarser ones."""

KEY_RELEASE_SECONDS = 0.12
"""Seconds after which a key counts as released where terminals do not tell: those that repeat it
have done so."""

TRUE_COLORS = 1 << 24
"""Number of colours of terminals with 24-bit colour."""

FLY_KEY_NAMES = {"KEY_PGUP": "e", "KEY_PGDOWN": "q"}
"""Keys that fly up and down: Q ends the viewer."""

QUIT_KEY = "end"
"""Name of the event of Q and Ctrl-C."""

HELD_KEYS = {*TURN_KEYS, *MOVE_KEYS}
"""Keys that act as long as they are down; others act each time they are pressed."""

WHEEL_UNITS_PER_SCROLL = 100.0
"""Wheel units of one scroll event."""

MIN_WRAP_COLUMNS = 12
"""Least columns of a wrapped cell; in smaller terminals it is cut off."""

COLUMN_GAP = 2
"""Columns between the cells of a panel."""

KEY_NAMES = {
    "KEY_UP": "ArrowUp", "KEY_DOWN": "ArrowDown", "KEY_LEFT": "ArrowLeft",
    "KEY_RIGHT": "ArrowRight", "KEY_HOME": "Home", "KEY_ESCAPE": "Escape",
}  # fmt: skip
"""Names of keys in events."""

TERMINAL_HELP_ROWS: tuple[Row, ...] = (
    ("Page up, down", "fly up, down"),
    ("Q", "ends it, as Escape does"),
)
"""Rows of the help that only terminals have."""

ORBIT_KEYS = (
    "Q end", "H help", "arrows turn", "+ - zoom", "F fit", "R return", "C fly", "1-5 kinds",
)  # fmt: skip
FLY_KEYS = (
    "Q end", "H help", "W A S D fly", "arrows fly", "PgUp PgDn up, down", "R return", "C orbit",
)  # fmt: skip
"""Status lines of keys, the most important first; what does not fit is left out."""

NORMAL, PANEL, STATUS = "\x1b[0m", "\x1b[0;48;2;24;26;30;38;2;240;240;236m", "\x1b[0;7m"
"""Escape codes for normal text, for panels and for the last lines."""

BEGIN, END = "\x1b[?2026h", "\x1b[?2026l"
"""Escape codes around a synchronized update, where terminals can do that."""


class TerminalGraphics(NamedTuple):
    """Graphics that a terminal supports."""

    protocol: str
    """Graphics protocol: one of ``PROTOCOLS``."""
    cell: tuple[int, int]
    """Width and height of a cell, pixels."""


def query_terminal(reading: int, write: Callable[[str], None]) -> TerminalGraphics:
    """
    Ask a terminal for its graphics protocol and cell size; it must be in cbreak mode.

    Parameters
    ----------
    reading : int
        The file descriptor of its answers.
    write : callable
        Takes questions.

    Raises
    ------
    ValueError
        If the environment variable ``RASTERJIT_TERMINAL`` is set to what is no way.
    """
    forced = os.environ.get(PROTOCOL_VARIABLE)
    if forced:
        one_of(PROTOCOL_VARIABLE, forced, PROTOCOLS)
    if forced == "blocks":
        return TerminalGraphics("blocks", DEFAULT_CELL)
    write(TERMINAL_QUERIES)
    answer, limit = b"", time.monotonic() + ANSWER_TIMEOUT_SECONDS
    while (rest := limit - time.monotonic()) > 0.0 and not ATTRIBUTES_ANSWER.search(answer):
        if select.select([reading], [], [], rest)[0]:
            part = os.read(reading, 1 << 12)
            if not part:
                break
            answer += part
    attributes, cell = ATTRIBUTES_ANSWER.search(answer), CELL_ANSWER.search(answer)
    size = (int(cell[2]), int(cell[1])) if cell else DEFAULT_CELL
    can_sixel = attributes is not None and SIXEL_ATTRIBUTE in attributes[1].split(b";")
    detected = "kitty" if KITTY_ANSWER in answer else "sixel" if can_sixel else "blocks"
    return TerminalGraphics(forced or detected, size if min(size) > 0 else DEFAULT_CELL)


class Screen:
    """
    A terminal as a canvas for `CanvasDriver`, with lines of text at the bottom.

    Parameters
    ----------
    abilities : Abilities
    write : callable
        Takes what the terminal is told.
    measure : callable
        Returns the columns and lines of the terminal.
    is_true : bool
        Whether the terminal knows all colours; else half blocks have the nearest it knows.
    """

    def __init__(
        self,
        abilities: TerminalGraphics,
        write: Callable[[str], None],
        measure: Callable[[], tuple[int, int]],
        is_true: bool = True,
    ) -> None:
        self.abilities = abilities
        self.text_rows = 1
        self.cells = 1, 1
        self._write, self._measure, self._is_true = write, measure, is_true
        self._handlers: dict[str, list[Callable[[Event], None]]] = {}
        self._draw: Callable[[], None] | None = None
        self._is_due, self._drawn_at = False, 0.0
        self._shown = 0
        self._lines: list[str] = []
        self._panel_lines: list[str] = []
        self._last_lines: list[str] = []
        self.update_size()

    # What a connection calls.

    def get_bitmap_context(self) -> Screen:
        """Return the object that takes pictures: this one."""
        return self

    def add_event_handler(self, handle: Callable[[Event], None], *kinds: str) -> None:
        """Register a handler of some types of events."""
        for kind in kinds:
            self._handlers.setdefault(kind, []).append(handle)

    def request_draw(self, draw: Callable[[], None] | None = None) -> None:
        """Request a draw, by a function or by the one before."""
        self._draw, self._is_due = draw or self._draw, True

    def get_physical_size(self) -> tuple[int, int]:
        """Return the width and height of pictures, pixels."""
        columns, lines = self.picture_cells
        if self.abilities.protocol == "blocks":
            return columns, 2 * lines
        width, height = self.abilities.cell
        scale = self._pixel_scale
        return max(columns * width // scale, 1), max(lines * height // scale, 1)

    def get_pixel_ratio(self) -> float:
        """Return the pixels of a picture for one that events count in."""
        return self.get_physical_size()[0] / (self.picture_cells[0] * DEFAULT_CELL[0])

    def set_bitmap(self, picture: NDArray[np.uint8]) -> None:
        """Show a picture, (H, W, 4) uint8."""
        colors = np.ascontiguousarray(picture[:, :, :3])
        if self.abilities.protocol == "blocks":
            lines = encode_half_blocks(colors, self._is_true)
            text = "".join(
                _at(row) + line
                for row, line in enumerate(lines)
                if row >= len(self._lines) or self._lines[row] != line
            )
            self._lines = lines
        elif self.abilities.protocol == "sixel":
            scale = self._pixel_scale
            text = _at(0) + encode_sixel(colors.repeat(scale, axis=0).repeat(scale, axis=1))
        else:
            before, self._shown = self._shown, 2 if self._shown == 1 else 1
            text = _at(0) + encode_kitty(colors, self._shown, self.picture_cells)
            text += delete_kitty(before) if before else ""
        # A picture goes over the panel.
        self._write(BEGIN + text + "".join(map(_format_line, enumerate(self._panel_lines))) + END)

    # What else there is.

    @property
    def picture_cells(self) -> tuple[int, int]:
        """Columns and lines of the picture."""
        columns, lines = self.cells
        return columns, max(lines - self.text_rows, 1)

    @property
    def _pixel_scale(self) -> int:
        """Width of a picture's pixel, in pixels of the terminal."""
        columns, lines = self.picture_cells
        pixels = columns * self.abilities.cell[0] * lines * self.abilities.cell[1]
        return int(np.ceil(np.sqrt(pixels / MAX_PICTURE_PIXELS)))

    def update_size(self, text_rows: int | None = None) -> None:
        """Update the size of the terminal, and the number of text lines below."""
        columns, lines = self._measure()
        size = (max(columns, 1), max(lines, 1)), self.text_rows if text_rows is None else text_rows
        if size != (self.cells, self.text_rows):
            self.cells, self.text_rows = size
            self.clear()
            self.request_draw()

    def clear(self) -> None:
        """Clear the terminal."""
        self._lines, self._panel_lines, self._last_lines = [], [], []
        self._write(f"{NORMAL}\x1b[2J" + (delete_kitty(self._shown) if self._shown else ""))
        self._shown = 0

    def submit(self, event: Event) -> None:
        """Pass an event to its handlers."""
        for handle in self._handlers.get(event["event_type"], ()):
            handle(event)

    @property
    def pause(self) -> float:
        """Seconds until a picture is due."""
        if not self._is_due:
            return RESIZE_CHECK_SECONDS
        return max(0.0, self._drawn_at + 1.0 / MAX_FRAME_RATE - time.monotonic())

    def draw(self) -> None:
        """Draw and show the picture that is due, if any."""
        if self._is_due and self._draw is not None:
            self._is_due, self._drawn_at = False, time.monotonic()
            with contextlib.suppress(DrawCancelled):
                self._draw()

    def write_text(self, panel: Sequence[Row], last: Sequence[str]) -> bool:
        """
        Write a panel over the picture, and the last lines.

        Returns
        -------
        bool
            Whether the picture must be shown again, because a panel that lay over it is smaller.
        """
        columns, lines = self.cells
        rows = format_panel(panel, columns, lines - self.text_rows) if panel else []
        panel_rows = [f"{PANEL}{row}{NORMAL}" for row in rows]
        bottom = [
            f"{_at(lines - len(last) + k)}{STATUS}{text[:columns].ljust(columns)[:columns]}{NORMAL}"
            for k, text in enumerate(last)
        ]
        text = (
            "".join(map(_format_line, enumerate(panel_rows)))
            if panel_rows != self._panel_lines
            else ""
        )
        text += "".join(bottom) if bottom != self._last_lines else ""
        uncovers = len(self._panel_lines) > len(panel_rows) or (
            panel_rows != self._panel_lines and bool(self._panel_lines)
        )
        self._panel_lines, self._last_lines = panel_rows, bottom
        if text:
            self._write(text)
        if uncovers:
            self._lines = []
            if self.abilities.protocol == "kitty":
                # Text lies over the picture until it is taken away.
                uncovered = range(len(rows), lines - self.text_rows)
                self._write(NORMAL + "".join(f"{_at(k)}\x1b[2K" for k in uncovered))
        return uncovers


def _at(line: int) -> str:
    """Return the escape code that moves the cursor to the beginning of a line."""
    return f"\x1b[{line + 1};1H"


def _format_line(numbered: tuple[int, str]) -> str:
    return _at(numbered[0]) + numbered[1]


def format_panel(rows: Sequence[Row], columns: int, lines: int) -> list[str]:
    """
    Format rows of cells as lines of text of one width that fit the terminal.

    Parameters
    ----------
    rows : sequence of tuple of str
        Columns are as wide as their widest cell; one that is alone in its row is a heading.
    columns, lines : int
        The room there is.
    """
    count = max(map(len, rows))
    widths = [
        max((len(row[k]) for row in rows if k < len(row) > 1), default=0) + COLUMN_GAP
        for k in range(count)
    ]
    output = []
    for *cells, last in rows:
        start = " " + "".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=False))
        folded = wrap(last, max(columns - len(start) - 1, MIN_WRAP_COLUMNS)) or [""]
        output.append(start + folded[0])
        output += [" " * len(start) + more for more in folded[1:]]
    width = min(max(map(len, output)) + 1, columns)
    if len(output) > lines:
        output = [*output[: lines - 1], " ..."] if lines > 0 else []
    return [text.ljust(width) if len(text) <= width else text[: width - 1] + "…" for text in output]


def format_key_line(viewer: Viewer, columns: int) -> str:
    """Return the most important keys, as many as fit."""
    keys: tuple[str, ...] = ("Q end", f"{viewer.help_key} help")
    if viewer.has_usual_keys:
        keys = FLY_KEYS if isinstance(viewer.controls, Fly) else ORBIT_KEYS
    line = ""
    for key in keys:
        longer = f"{line}  {key}" if line else f" {key}"
        if len(longer) > columns:
            break
        line = longer
    return line


class InputReader:
    """
    Converts keystrokes and mouse reports to events.

    Parameters
    ----------
    screen : Screen
        Takes the events.
    sends_releases : bool
        Whether the terminal tells when a key is released.
    """

    def __init__(self, screen: Screen, sends_releases: bool) -> None:
        self._screen, self._sends_releases = screen, sends_releases
        self._down: dict[str, float] = {}
        self._place = 0.0, 0.0

    def read(self, stroke: Any) -> str:
        """Read a keystroke of ``blessed``; return the key that went down, or an empty string."""
        name = stroke.name or ""
        if name.startswith("MOUSE_"):
            self._read_mouse(name, *stroke.mouse_xy)
            return ""
        key = (
            KEY_NAMES.get(name)
            or KEY_NAMES.get(stroke.key_name or "")
            or str(stroke.value or stroke)
        )
        if name == "KEY_CTRL_C" or key in ("\x03", "q", "Q"):
            return "" if stroke.released else QUIT_KEY
        key = FLY_KEY_NAMES.get(name) or FLY_KEY_NAMES.get(stroke.key_name or "") or key
        if len(key) != 1 and key not in KEY_NAMES.values():
            return ""
        if stroke.released:
            self._release(key)
            return ""
        if key.lower() not in HELD_KEYS and key not in HELD_KEYS:
            return "" if stroke.repeated else key
        is_new = key not in self._down
        self._down[key] = time.monotonic()
        return key if is_new else ""

    def press(self, key: str) -> None:
        """Submit the event of a key that went down."""
        self._screen.submit({"event_type": "key_down", "key": key, "modifiers": ()})

    def release_stale(self) -> None:
        """Release keys that were not repeated, if the terminal does not report releases."""
        if not self._sends_releases:
            now = time.monotonic()
            for key in [
                key for key, since in self._down.items() if now - since > KEY_RELEASE_SECONDS
            ]:
                self._release(key)

    def _release(self, key: str) -> None:
        if self._down.pop(key, None) is not None:
            self._screen.submit({"event_type": "key_up", "key": key, "modifiers": ()})

    def _read_mouse(self, name: str, column: int, line: int) -> None:
        """Submit the event of the mouse in a cell."""
        width, height = self._screen.get_physical_size()
        columns, lines = self._screen.picture_cells
        ratio = self._screen.get_pixel_ratio()
        x = (column + 0.5) * width / columns / ratio
        y = (line + 0.5) * height / lines / ratio
        point = {"x": x, "y": y, "modifiers": ("Shift",) if "SHIFT" in name else ()}
        if "SCROLL" in name:
            notch = -WHEEL_UNITS_PER_SCROLL if "UP" in name else WHEEL_UNITS_PER_SCROLL
            self._screen.submit({"event_type": "wheel", "dx": 0.0, "dy": notch, **point})
            return
        kind = "move" if "MOTION" in name else "up" if "RELEASED" in name else "down"
        button = 2 if "RIGHT" in name else 3 if "MIDDLE" in name else 1
        event = {"event_type": f"pointer_{kind}", "button": button, "buttons": (button,), **point}
        self._screen.submit(event)


def run_in_terminal(viewer: Viewer, title: str) -> None:
    """
    Show a viewer in the terminal until Q, Escape or Ctrl-C; the terminal then is as it was.

    Raises
    ------
    ImportError
        If what it needs is not installed, naming what to install.
    ValueError
        If standard input or output is no terminal.
    """
    if not is_at_terminal():
        raise ValueError(
            "backend must not be 'terminal' where standard input or output is none, but a file or "
            "a pipe"
        )
    with needs_extra("terminal", "the terminal needs a package"):
        import blessed
    viewer.writes_text = False
    # What has to be compiled is compiled before the terminal changes.
    viewer.draw()
    terminal = blessed.Terminal(stream=sys.__stdout__)
    with _capture_output(), _take_over(terminal) as sends_releases:
        _run_loop(viewer, terminal, sends_releases, title)


@contextlib.contextmanager
def _capture_output() -> Iterator[None]:
    """Hold back what is printed; errors and warnings are written afterwards."""
    errors = io.StringIO()
    try:
        # No line of progress is written across the picture.
        with (
            show_progress_by(lambda progress: None),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(errors),
        ):
            yield
    finally:
        sys.stderr.write(errors.getvalue())


@contextlib.contextmanager
def _take_over(terminal: Any) -> Iterator[bool]:
    """Take over the whole terminal; yield whether it reports key releases."""

    def end(number: int, frame: Any) -> None:
        raise SystemExit(128 + number)

    # Only the main thread is told of signals.
    is_main = threading.current_thread() is threading.main_thread()
    old_handler = signal.signal(signal.SIGTERM, end) if is_main else None
    try:
        with (
            terminal.fullscreen(), terminal.hidden_cursor(), terminal.cbreak(),
            terminal.enable_kitty_keyboard(
                report_events=True, report_all_keys=True, timeout=ANSWER_TIMEOUT_SECONDS
            ),
            terminal.mouse_enabled(report_drag=True, timeout=ANSWER_TIMEOUT_SECONDS),
        ):  # fmt: skip
            try:
                state = terminal.get_kitty_keyboard_state(timeout=ANSWER_TIMEOUT_SECONDS)
                yield bool(state is not None and state.report_events)
            finally:
                # Answers that are still on their way would stand at the prompt.
                while terminal.inkey(timeout=0):
                    pass
    finally:
        if is_main:
            signal.signal(signal.SIGTERM, old_handler)


def _run_loop(viewer: Viewer, terminal: Any, sends_releases: bool, title: str) -> None:
    """Run the event loop until a key ends it."""
    stream = terminal.stream

    def write(text: str) -> None:
        stream.write(text)
        stream.flush()

    abilities = TerminalGraphics("blocks", DEFAULT_CELL)
    if sys.platform != "win32":
        abilities = query_terminal(sys.__stdin__.fileno(), write)
    is_true = terminal.number_of_colors >= TRUE_COLORS
    screen = Screen(abilities, write, _make_size_getter(terminal), is_true)
    reader = InputReader(screen, sends_releases)
    write(f"\x1b]2;{title}\x07")
    CanvasDriver(viewer, screen)
    try:
        # Some terminals send Ctrl-C as a key, others interrupt.
        with contextlib.suppress(KeyboardInterrupt):
            while _run_step(viewer, screen, reader, terminal):
                pass
    finally:
        screen.submit({"event_type": "close"})
        screen.clear()


def _make_size_getter(terminal: Any) -> Callable[[], tuple[int, int]]:
    """Return a function that returns the columns and lines of a terminal."""
    return lambda: (terminal.width, terminal.height)


def _run_step(viewer: Viewer, screen: Screen, reader: InputReader, terminal: Any) -> bool:
    """Wait for keys until a picture is due and draw it; False to quit."""
    stroke = terminal.inkey(timeout=screen.pause, esc_delay=KEY_RELEASE_SECONDS)
    while stroke:
        key = reader.read(stroke)
        if key == QUIT_KEY:
            return False
        if key == "Escape" and not viewer.panel_rows:
            return False
        if key:
            reader.press(key)
        stroke = terminal.inkey(timeout=0, esc_delay=KEY_RELEASE_SECONDS)
    reader.release_stale()
    screen.update_size(1 + viewer.shows_line)
    status = [f" {viewer.line}"] if viewer.shows_line else []
    if screen.write_text(get_panel(viewer), [*status, format_key_line(viewer, screen.cells[0])]):
        screen.set_bitmap(viewer.draw())
    screen.draw()
    return True


def get_panel(viewer: Viewer) -> Sequence[Row]:
    """Return the rows of the panel: help, the explanation of a pixel, or costs."""
    rows = viewer.panel_rows
    return (*rows, *TERMINAL_HELP_ROWS) if rows is HELP_ROWS else rows
