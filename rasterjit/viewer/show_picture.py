"""Show one finished picture: in a notebook, a window of the system, or the terminal."""

from __future__ import annotations

import os
import shutil
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageShow

from rasterjit.runtime import progress
from rasterjit.viewer import terminal, window_probe
from rasterjit.viewer.canvas import at_terminal, has_terminal
from rasterjit.viewer.terminal import Abilities, half_blocks, kitty, sixel

NUMBER = 7919
"""What a terminal calls the picture; viewers use 1 and 2."""

PAPER = 255
"""Grey level behind transparent pixels, in a terminal."""


def show_picture(picture: Any, color: NDArray[np.uint8], title: str) -> None:
    """
    Show a picture where the user is, and go on.

    Parameters
    ----------
    picture : Frame
        What a notebook displays.
    color : (H, W, 4) uint8
        Its sRGB colours and alpha.
    title : str
        Of the window.

    Raises
    ------
    ValueError
        If this is no notebook, and there is neither a display with a picture viewer nor a terminal.
    """
    if progress.in_notebook():
        from IPython.display import display

        display(picture)
        return
    image = Image.fromarray(color)
    if window_probe.has_display() and ImageShow.show(image, title):
        return
    if not at_terminal():
        raise ValueError(
            "there is no notebook, no display with a picture viewer and no terminal to show the "
            'frame in: write it to a file with frame.save("picture.png")'
        )
    paper = Image.new("RGBA", image.size, (PAPER, PAPER, PAPER, 255))
    _print(Image.alpha_composite(paper, image).convert("RGB"))


def _print(image: Image.Image) -> None:
    """Write a picture to the terminal, no larger than that."""
    stream = sys.__stdout__
    assert stream is not None  # `at_terminal` has looked.
    abilities = _ask() if has_terminal() and sys.platform != "win32" else None
    way, cell = abilities or Abilities("blocks", terminal.USUAL_CELL)
    columns, lines = shutil.get_terminal_size()
    if way == "blocks":
        cell = (1, 2)
    # The prompt comes below.
    largest = columns * cell[0], max(lines - 1, 1) * cell[1]
    share = min(1.0, largest[0] / image.width, largest[1] / image.height)
    width = max(1, round(image.width * share))
    height = max(1, round(image.height * share))
    pixels = np.asarray(image.resize((width, height), Image.Resampling.LANCZOS))
    rows = -(-height // cell[1])
    if way == "kitty":
        text = kitty(pixels, NUMBER, (-(-width // cell[0]), rows)) + "\n" * rows
    elif way == "sixel":
        text = sixel(pixels) + "\n"
    else:
        # A last row of one pixel stands on paper.
        whole = np.pad(pixels, ((0, height % 2), (0, 0), (0, 0)), constant_values=PAPER)
        is_true = os.environ.get("COLORTERM", "") in ("truecolor", "24bit")
        text = "".join(f"{line}\n" for line in half_blocks(whole, is_true))
    stream.write(text)
    stream.flush()


def _ask() -> Abilities:
    """Ask the terminal what it can show."""
    import blessed

    own = blessed.Terminal(stream=sys.__stdout__)

    def write(text: str) -> None:
        own.stream.write(text)
        own.stream.flush()

    with own.cbreak():
        stdin = sys.__stdin__
        assert stdin is not None  # `at_terminal` has looked.
        return terminal.ask(stdin.fileno(), write)
