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

from rasterjit.runtime.progress import told_to
from rasterjit.scene.validation import one_of
from rasterjit.viewer.canvas import CanvasDriver, DrawCancelled, at_terminal
from rasterjit.viewer.controls import MOVES, TURNS, Event, Fly
from rasterjit.viewer.overlay import Row
from rasterjit.viewer.viewer import HELP, Viewer

CHUNK = 4096
"""Characters of a picture in one command of kitty's, at most."""

COLORS = 256
"""Of a picture in sixels, at most."""

BAND = 6
"""Rows of pixels in one row of sixels."""

FIRST_SIXEL = 63
"""Code of the character for a column of a band without any pixel."""

PERCENT = 100
"""Sixels take colours as whole percents."""

SHORTEST_RUN = 4
"""Equal sixels from which on their number is shorter than they are."""

CUBE_SIDE, FIRST_OF_CUBE = 6, 16
"""Steps of red, green and blue among the 256 numbered colours, and the number of black."""

CUBE_LEVELS = np.array([0, 95, 135, 175, 215, 255])
FIRST_GREY, GREY_LEVELS = 232, np.arange(8, 239, 10)
"""Of the numbered colours as xterm has them, sRGB; and the number of the darkest grey."""

CUBE_BORDERS, GREY_BORDERS = ((some[1:] + some[:-1]) / 2.0 for some in (CUBE_LEVELS, GREY_LEVELS))
"""Between levels: what lies below is nearer to the darker one."""

HALF_BLOCK = "▄"


def kitty(picture: NDArray[np.uint8], number: int, cells: tuple[int, int]) -> str:
    """
    Return the commands that show a picture below the text, from where the cursor is.

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
    chunks = [data[start : start + CHUNK] for start in range(0, len(data), CHUNK)]
    last = len(chunks) - 1
    # Transmit and show (a=T) RGB (f=24), packed (o=z), without an answer (q=2), below the text
    # (z=-1), without moving the cursor (C=1).
    head = f"a=T,f=24,o=z,q=2,z=-1,C=1,i={number},s={width},v={height},c={cells[0]},r={cells[1]},"
    return "".join(
        f"\x1b_G{'' if k else head}m={int(k < last)};{chunk}\x1b\\"
        for k, chunk in enumerate(chunks)
    )


def forget_kitty(number: int) -> str:
    """Return the command that takes a picture away."""
    return f"\x1b_Ga=d,d=I,q=2,i={number}\x1b\\"


def sixel(picture: NDArray[np.uint8]) -> str:
    """
    Return the command that shows a picture from where the cursor is, in its 256 best colours.

    Parameters
    ----------
    picture : (H, W, 3) uint8, sRGB
    """
    from PIL import Image

    image = Image.fromarray(picture).quantize(
        COLORS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
    palette = np.frombuffer(image.palette.tobytes(), dtype=np.uint8).reshape(-1, 3)
    return encode_sixels(np.asarray(image), palette)


def encode_sixels(numbers: NDArray[np.uint8], palette: NDArray[np.uint8]) -> str:
    """
    Return the command that shows a picture of numbered colours.

    Parameters
    ----------
    numbers : (H, W) uint8
    palette : (C, 3) uint8, sRGB
    """
    height, width = numbers.shape
    # Each pixel sets a bit of the sixel of its band, colour and column. Sorted by that, sixels
    # without a pixel are not there at all.
    rows, columns = np.divmod(np.arange(height * width), width)
    bands, bits = np.divmod(rows, BAND)
    places = (bands * COLORS + numbers.ravel()) * width + columns
    order = np.argsort(places, kind="stable")
    places, bits = places[order], bits[order]
    firsts = np.flatnonzero(np.r_[True, places[1:] != places[:-1]])
    sixels = np.add.reduceat(1 << bits, firsts)
    places = places[firsts]
    # Join equal neighbours to runs.
    lines, columns = np.divmod(places, width)
    is_first = (
        (lines[1:] != lines[:-1]) | (columns[1:] != columns[:-1] + 1) | (sixels[1:] != sixels[:-1])
    )
    firsts = np.flatnonzero(np.r_[True, is_first])
    counts = np.diff(np.r_[firsts, len(places)])
    runs = zip(
        *(one[firsts].tolist() for one in (lines, columns, sixels)), counts.tolist(), strict=True
    )
    used = np.unique(numbers)
    parts = [f'\x1bPq"1;1;{width};{height}']
    parts += [_color(int(number), palette[number]) for number in used]
    band, line, end = 0, -1, 0
    for run_line, start, bits_set, count in runs:
        if run_line != line:
            line, end = run_line, 0
            parts.append("-" * (line // COLORS - band) or "$")
            band = line // COLORS
            parts.append(f"#{line % COLORS}")
        if start > end:
            parts.append(_repeated(0, start - end))
        parts.append(_repeated(bits_set, count))
        end = start + count
    return "".join([*parts, "\x1b\\"])


def _color(number: int, color: NDArray[np.uint8]) -> str:
    """Return what gives a number its colour."""
    red, green, blue = ((int(code) * 2 * PERCENT + 255) // 510 for code in color)
    return f"#{number};2;{red};{green};{blue}"


@lru_cache(maxsize=4096)
def _repeated(bits: int, count: int) -> str:
    """Return equal sixels."""
    character = chr(FIRST_SIXEL + bits)
    return character * count if count < SHORTEST_RUN else f"!{count}{character}"


def half_blocks(picture: NDArray[np.uint8], is_true: bool = True) -> list[str]:
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
        return _indexed_blocks(picture)
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


def _nearest_numbers(picture: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the numbers of the nearest colours, (H, W), of the cube and of the greys."""
    wanted = picture.astype(np.int64)
    steps = np.searchsorted(CUBE_BORDERS, wanted, side="right")
    red, green, blue = np.moveaxis(steps, 2, 0)
    grey = np.searchsorted(GREY_BORDERS, wanted.mean(axis=2), side="right")
    far = np.square(CUBE_LEVELS[steps] - wanted).sum(axis=2)
    grey_far = np.square(GREY_LEVELS[grey][:, :, None] - wanted).sum(axis=2)
    cube = FIRST_OF_CUBE + (red * CUBE_SIDE + green) * CUBE_SIDE + blue
    return np.where(grey_far < far, FIRST_GREY + grey, cube)


def _indexed_blocks(picture: NDArray[np.uint8]) -> list[str]:
    """Return lines of half blocks in numbered colours."""
    numbers = _nearest_numbers(picture)
    return [
        "".join(
            f"\x1b[48;5;{top}m\x1b[38;5;{bottom}m{HALF_BLOCK}"
            for top, bottom in zip(*pair.tolist(), strict=True)
        )
        + "\x1b[0m"
        for pair in numbers.reshape(-1, 2, picture.shape[1])
    ]


FRAME_RATE = 30.0
"""Most pictures a second: a terminal takes long to show one."""

PAUSE = 0.1
"""Seconds after which the size of the terminal is looked at again, at rest."""

SETTING = "RASTERJIT_TERMINAL"
"""The environment variable that says how pictures are shown, in place of asking the terminal."""

WAYS = ("kitty", "sixel", "blocks")

PATIENCE = 1.0
"""Seconds in which a terminal says what it can; those far away answer within a quarter."""

QUESTIONS = "\x1b_Gi=31,s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\\x1b[16t\x1b[c"
"""Does it know kitty's graphics; how many pixels has a cell; what else can it do. All terminals
answer the last one, so that nobody waits for an answer to the others."""

ATTRIBUTES = re.compile(rb"\x1b\[\?([\d;]+)c")
CELL = re.compile(rb"\x1b\[6;(\d+);(\d+)t")
KITTY_ANSWER = b"\x1b_Gi=31;OK"
SIXEL_ATTRIBUTE = b"4"

USUAL_CELL = (8, 16)
"""Width and height of a cell where a terminal does not tell, pixels; also what events count in."""

MAX_PIXELS = 1_000_000
"""Of a picture; larger terminals get coarser ones."""

HELD = 0.12
"""Seconds after which a key counts as released where terminals do not tell: those that repeat it
have done so."""

TRUE_COLORS = 1 << 24
"""Of terminals that show each colour as it is."""

FLYING = {"KEY_PGUP": "e", "KEY_PGDOWN": "q"}
"""Keys that fly up and down: Q ends the viewer."""

END_KEY = "end"
"""What Q and Ctrl-C are called."""

HELD_KEYS = {*TURNS, *MOVES}
"""Keys that do something as long as they are down; another one acts each time it is pressed."""

NOTCH = 100.0
"""What a wheel turns at once."""

MIN_WIDTH = 12
"""Columns in which a long cell is folded at least; in smaller terminals it is cut off."""

GAP = 2
"""Columns between two of a panel."""

NAMES = {
    "KEY_UP": "ArrowUp", "KEY_DOWN": "ArrowDown", "KEY_LEFT": "ArrowLeft",
    "KEY_RIGHT": "ArrowRight", "KEY_HOME": "Home", "KEY_ESCAPE": "Escape",
}  # fmt: skip
"""What keys are called in events."""

LAST_ROWS: tuple[Row, ...] = (("Page up, down", "fly up, down"), ("Q", "ends it, as Escape does"))
"""What the help of a terminal says besides."""

ORBIT_KEYS = (
    "Q end", "H help", "arrows turn", "+ - zoom", "F fit", "R return", "C fly", "1-5 kinds",
)  # fmt: skip
FLY_KEYS = (
    "Q end", "H help", "W A S D fly", "arrows fly", "PgUp PgDn up, down", "R return", "C orbit",
)  # fmt: skip
"""The last line, from what matters most on; what does not fit is left out."""

NORMAL, PANEL, STATUS = "\x1b[0m", "\x1b[0;48;2;24;26;30;38;2;240;240;236m", "\x1b[0;7m"
"""Text as it is, on panels and in the last lines."""

BEGIN, END = "\x1b[?2026h", "\x1b[?2026l"
"""What comes between is shown at once, where terminals can do that."""


class Abilities(NamedTuple):
    """What a terminal can do."""

    way: str
    """How it shows pictures: one of ``WAYS``."""
    cell: tuple[int, int]
    """Width and height of a character, pixels."""


def ask(reading: int, write: Callable[[str], None]) -> Abilities:
    """
    Ask a terminal what it can do; it must not echo, nor wait for whole lines.

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
    chosen = os.environ.get(SETTING)
    if chosen:
        one_of(SETTING, chosen, WAYS)
    if chosen == "blocks":
        return Abilities("blocks", USUAL_CELL)
    write(QUESTIONS)
    said, limit = b"", time.monotonic() + PATIENCE
    while (rest := limit - time.monotonic()) > 0.0 and not ATTRIBUTES.search(said):
        if select.select([reading], [], [], rest)[0]:
            part = os.read(reading, 1 << 12)
            if not part:
                break
            said += part
    attributes, cell = ATTRIBUTES.search(said), CELL.search(said)
    size = (int(cell[2]), int(cell[1])) if cell else USUAL_CELL
    can_sixel = attributes is not None and SIXEL_ATTRIBUTE in attributes[1].split(b";")
    found = "kitty" if KITTY_ANSWER in said else "sixel" if can_sixel else "blocks"
    return Abilities(chosen or found, size if min(size) > 0 else USUAL_CELL)


class Screen:
    """
    What `CanvasDriver` takes for a canvas: a terminal whose last lines are text.

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
        abilities: Abilities,
        write: Callable[[str], None],
        measure: Callable[[], tuple[int, int]],
        is_true: bool = True,
    ) -> None:
        self.abilities = abilities
        self.texts = 1
        self.cells = 1, 1
        self._write, self._measure, self._is_true = write, measure, is_true
        self._handlers: dict[str, list[Callable[[Event], None]]] = {}
        self._draw: Callable[[], None] | None = None
        self._is_due, self._drawn_at = False, 0.0
        self._shown = 0
        self._lines: list[str] = []
        self._panel_lines: list[str] = []
        self._last: list[str] = []
        self.look()

    # What a connection calls.

    def get_bitmap_context(self) -> Screen:
        """Return what takes pictures."""
        return self

    def add_event_handler(self, handle: Callable[[Event], None], *kinds: str) -> None:
        """Have a function called with events of some kinds."""
        for kind in kinds:
            self._handlers.setdefault(kind, []).append(handle)

    def request_draw(self, draw: Callable[[], None] | None = None) -> None:
        """Have a picture drawn soon, by a function or by the one before."""
        self._draw, self._is_due = draw or self._draw, True

    def get_physical_size(self) -> tuple[int, int]:
        """Return the width and height of pictures, pixels."""
        columns, lines = self.picture_cells
        if self.abilities.way == "blocks":
            return columns, 2 * lines
        width, height = self.abilities.cell
        coarse = self._coarseness
        return max(columns * width // coarse, 1), max(lines * height // coarse, 1)

    def get_pixel_ratio(self) -> float:
        """Return the pixels of a picture for one that events count in."""
        return self.get_physical_size()[0] / (self.picture_cells[0] * USUAL_CELL[0])

    def set_bitmap(self, picture: NDArray[np.uint8]) -> None:
        """Show a picture, (H, W, 4) uint8."""
        colors = np.ascontiguousarray(picture[:, :, :3])
        if self.abilities.way == "blocks":
            lines = half_blocks(colors, self._is_true)
            told = "".join(
                _at(row) + line
                for row, line in enumerate(lines)
                if row >= len(self._lines) or self._lines[row] != line
            )
            self._lines = lines
        elif self.abilities.way == "sixel":
            coarse = self._coarseness
            told = _at(0) + sixel(colors.repeat(coarse, axis=0).repeat(coarse, axis=1))
        else:
            before, self._shown = self._shown, 2 if self._shown == 1 else 1
            told = _at(0) + kitty(colors, self._shown, self.picture_cells)
            told += forget_kitty(before) if before else ""
        # A picture goes over the panel.
        self._write(BEGIN + told + "".join(map(_placed, enumerate(self._panel_lines))) + END)

    # What else there is.

    @property
    def picture_cells(self) -> tuple[int, int]:
        """Columns and lines of the picture."""
        columns, lines = self.cells
        return columns, max(lines - self.texts, 1)

    @property
    def _coarseness(self) -> int:
        """How many pixels of the terminal one of the picture is large."""
        columns, lines = self.picture_cells
        pixels = columns * self.abilities.cell[0] * lines * self.abilities.cell[1]
        return int(np.ceil(np.sqrt(pixels / MAX_PIXELS)))

    def look(self, texts: int | None = None) -> None:
        """See how large the terminal is, and how many lines of text are wanted below."""
        columns, lines = self._measure()
        wanted = (max(columns, 1), max(lines, 1)), self.texts if texts is None else texts
        if wanted != (self.cells, self.texts):
            self.cells, self.texts = wanted
            self.clear()
            self.request_draw()

    def clear(self) -> None:
        """Take away all that is shown."""
        self._lines, self._panel_lines, self._last = [], [], []
        self._write(f"{NORMAL}\x1b[2J" + (forget_kitty(self._shown) if self._shown else ""))
        self._shown = 0

    def submit(self, event: Event) -> None:
        """Hand an event to who wants it."""
        for handle in self._handlers.get(event["event_type"], ()):
            handle(event)

    @property
    def pause(self) -> float:
        """Seconds until a picture is due."""
        if not self._is_due:
            return PAUSE
        return max(0.0, self._drawn_at + 1.0 / FRAME_RATE - time.monotonic())

    def draw(self) -> None:
        """Draw and show the picture that is due, if any."""
        if self._is_due and self._draw is not None:
            self._is_due, self._drawn_at = False, time.monotonic()
            with contextlib.suppress(DrawCancelled):
                self._draw()

    def say(self, panel: Sequence[Row], last: Sequence[str]) -> bool:
        """
        Write text: a panel over the picture, and the last lines.

        Returns
        -------
        bool
            Whether the picture must be shown again, because a panel that lay over it is smaller.
        """
        columns, lines = self.cells
        rows = panel_lines(panel, columns, lines - self.texts) if panel else []
        shown = [f"{PANEL}{row}{NORMAL}" for row in rows]
        below = [
            f"{_at(lines - len(last) + k)}{STATUS}{text[:columns].ljust(columns)[:columns]}{NORMAL}"
            for k, text in enumerate(last)
        ]
        told = "".join(map(_placed, enumerate(shown))) if shown != self._panel_lines else ""
        told += "".join(below) if below != self._last else ""
        uncovers = len(self._panel_lines) > len(shown) or (
            shown != self._panel_lines and bool(self._panel_lines)
        )
        self._panel_lines, self._last = shown, below
        if told:
            self._write(told)
        if uncovers:
            self._lines = []
            if self.abilities.way == "kitty":
                # Text lies over the picture until it is taken away.
                bare = range(len(rows), lines - self.texts)
                self._write(NORMAL + "".join(f"{_at(k)}\x1b[2K" for k in bare))
        return uncovers


def _at(line: int) -> str:
    """Return what moves the cursor to the beginning of a line."""
    return f"\x1b[{line + 1};1H"


def _placed(numbered: tuple[int, str]) -> str:
    return _at(numbered[0]) + numbered[1]


def panel_lines(rows: Sequence[Row], columns: int, lines: int) -> list[str]:
    """
    Return rows of cells as lines of text of one width, no more and no wider than there is room.

    Parameters
    ----------
    rows : sequence of tuple of str
        Columns are as wide as their widest cell; one that is alone in its row is a heading.
    columns, lines : int
        The room there is.
    """
    count = max(map(len, rows))
    widths = [
        max((len(row[k]) for row in rows if k < len(row) > 1), default=0) + GAP
        for k in range(count)
    ]
    texts = []
    for *cells, last in rows:
        start = " " + "".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=False))
        folded = wrap(last, max(columns - len(start) - 1, MIN_WIDTH)) or [""]
        texts.append(start + folded[0])
        texts += [" " * len(start) + more for more in folded[1:]]
    width = min(max(map(len, texts)) + 1, columns)
    if len(texts) > lines:
        texts = [*texts[: lines - 1], " ..."] if lines > 0 else []
    return [text.ljust(width) if len(text) <= width else text[: width - 1] + "…" for text in texts]


def last_line(viewer: Viewer, columns: int) -> str:
    """Return the keys that matter most, as many as there is room for."""
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


class Hands:
    """
    Turns what is typed, and what the mouse does, into events.

    Parameters
    ----------
    screen : Screen
        Takes the events.
    tells_releases : bool
        Whether the terminal tells when a key is released.
    """

    def __init__(self, screen: Screen, tells_releases: bool) -> None:
        self._screen, self._tells = screen, tells_releases
        self._held: dict[str, float] = {}
        self._place = 0.0, 0.0

    def take(self, stroke: Any) -> str:
        """Take a keystroke of ``blessed``; return the key that went down, or an empty string."""
        name = stroke.name or ""
        if name.startswith("MOUSE_"):
            self._point(name, *stroke.mouse_xy)
            return ""
        key = NAMES.get(name) or NAMES.get(stroke.key_name or "") or str(stroke.value or stroke)
        if name == "KEY_CTRL_C" or key in ("\x03", "q", "Q"):
            return "" if stroke.released else END_KEY
        key = FLYING.get(name) or FLYING.get(stroke.key_name or "") or key
        if len(key) != 1 and key not in NAMES.values():
            return ""
        if stroke.released:
            self._release(key)
            return ""
        if key.lower() not in HELD_KEYS and key not in HELD_KEYS:
            return "" if stroke.repeated else key
        is_new = key not in self._held
        self._held[key] = time.monotonic()
        return key if is_new else ""

    def press(self, key: str) -> None:
        """Hand on that a key went down."""
        self._screen.submit({"event_type": "key_down", "key": key, "modifiers": ()})

    def pass_time(self) -> None:
        """Release keys that were not repeated, where the terminal does not tell."""
        if not self._tells:
            now = time.monotonic()
            for key in [key for key, since in self._held.items() if now - since > HELD]:
                self._release(key)

    def _release(self, key: str) -> None:
        if self._held.pop(key, None) is not None:
            self._screen.submit({"event_type": "key_up", "key": key, "modifiers": ()})

    def _point(self, name: str, column: int, line: int) -> None:
        """Hand on what the mouse does in a cell."""
        width, height = self._screen.get_physical_size()
        columns, lines = self._screen.picture_cells
        ratio = self._screen.get_pixel_ratio()
        x = (column + 0.5) * width / columns / ratio
        y = (line + 0.5) * height / lines / ratio
        place = {"x": x, "y": y, "modifiers": ("Shift",) if "SHIFT" in name else ()}
        if "SCROLL" in name:
            turn = -NOTCH if "UP" in name else NOTCH
            self._screen.submit({"event_type": "wheel", "dx": 0.0, "dy": turn, **place})
            return
        kind = "move" if "MOTION" in name else "up" if "RELEASED" in name else "down"
        button = 2 if "RIGHT" in name else 3 if "MIDDLE" in name else 1
        event = {"event_type": f"pointer_{kind}", "button": button, "buttons": (button,), **place}
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
    if not at_terminal():
        raise ValueError(
            "backend must not be 'terminal' where standard input or output is none, but a file or "
            "a pipe"
        )
    try:
        import blessed
    except ImportError as error:
        raise ImportError(
            f'the terminal needs a package: pip install "rasterjit[terminal]" ({error})'
        ) from error
    viewer.writes_text = False
    # What has to be compiled is compiled before the terminal changes.
    viewer.draw()
    terminal = blessed.Terminal(stream=sys.__stdout__)
    with _quiet(), _prepared(terminal) as tells_releases:
        _run(viewer, terminal, tells_releases, title)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep what is printed off the picture; what errors and warnings said comes afterwards."""
    said = io.StringIO()
    try:
        # No line of progress is written across the picture.
        with (
            told_to(lambda progress: None),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(said),
        ):
            yield
    finally:
        sys.stderr.write(said.getvalue())


@contextlib.contextmanager
def _prepared(terminal: Any) -> Iterator[bool]:
    """Give the whole terminal, with keys as they come; yield whether it tells of releases."""

    def end(number: int, frame: Any) -> None:
        raise SystemExit(128 + number)

    # Only the main thread is told of signals.
    is_main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGTERM, end) if is_main else None
    try:
        with (
            terminal.fullscreen(), terminal.hidden_cursor(), terminal.cbreak(),
            terminal.enable_kitty_keyboard(
                report_events=True, report_all_keys=True, timeout=PATIENCE
            ),
            terminal.mouse_enabled(report_drag=True, timeout=PATIENCE),
        ):  # fmt: skip
            try:
                state = terminal.get_kitty_keyboard_state(timeout=PATIENCE)
                yield bool(state is not None and state.report_events)
            finally:
                # Answers that are still on their way would stand at the prompt.
                while terminal.inkey(timeout=0):
                    pass
    finally:
        if is_main:
            signal.signal(signal.SIGTERM, before)


def _run(viewer: Viewer, terminal: Any, tells_releases: bool, title: str) -> None:
    """Draw, and do what keys ask for, until one of them ends it."""
    stream = terminal.stream

    def write(text: str) -> None:
        stream.write(text)
        stream.flush()

    abilities = Abilities("blocks", USUAL_CELL)
    if sys.platform != "win32":
        abilities = ask(sys.__stdin__.fileno(), write)
    is_true = terminal.number_of_colors >= TRUE_COLORS
    screen = Screen(abilities, write, _size_of(terminal), is_true)
    hands = Hands(screen, tells_releases)
    write(f"\x1b]2;{title}\x07")
    CanvasDriver(viewer, screen)
    try:
        # Some terminals send Ctrl-C as a key, others interrupt.
        with contextlib.suppress(KeyboardInterrupt):
            while _go_on(viewer, screen, hands, terminal):
                pass
    finally:
        screen.submit({"event_type": "close"})
        screen.clear()


def _size_of(terminal: Any) -> Callable[[], tuple[int, int]]:
    """Return what tells the columns and lines of a terminal."""
    return lambda: (terminal.width, terminal.height)


def _go_on(viewer: Viewer, screen: Screen, hands: Hands, terminal: Any) -> bool:
    """Wait for keys until a picture is due, draw it, and tell whether to go on."""
    stroke = terminal.inkey(timeout=screen.pause, esc_delay=HELD)
    while stroke:
        key = hands.take(stroke)
        if key == END_KEY:
            return False
        if key == "Escape" and not viewer.panel_rows:
            return False
        if key:
            hands.press(key)
        stroke = terminal.inkey(timeout=0, esc_delay=HELD)
    hands.pass_time()
    screen.look(1 + viewer.shows_line)
    told = [f" {viewer.line}"] if viewer.shows_line else []
    if screen.say(panel_of(viewer), [*told, last_line(viewer, screen.cells[0])]):
        screen.set_bitmap(viewer.draw())
    screen.draw()
    return True


def panel_of(viewer: Viewer) -> Sequence[Row]:
    """Return what is to be read over the picture: help, or what is known of a pixel, or costs."""
    rows = viewer.panel_rows
    return (*rows, *LAST_ROWS) if rows is HELP else rows
