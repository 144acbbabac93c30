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
from rasterjit.viewer.canvas import has_terminal, is_at_terminal
from rasterjit.viewer.terminal import (
    TerminalGraphics,
    encode_half_blocks,
    encode_kitty,
    encode_sixel,
)

KITTY_IMAGE_ID = 7919
"""Id of the picture in the Kitty graphics protocol; viewers use 1 and 2."""

BACKGROUND_GREY = 255
"""Grey level behind transparent pixels, in a terminal."""


def show_picture(frame: Any, color: NDArray[np.uint8], title: str) -> None:
    """
    Show a picture in a notebook, a window or the terminal, without blocking.

    Parameters
    ----------
    frame : Frame
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

        display(frame)
        return
    image = Image.fromarray(color)
    if window_probe.has_display() and ImageShow.show(image, title):
        return
    if not is_at_terminal():
        raise ValueError(
            "there is no notebook, no display with a picture viewer and no terminal to show the "
            'frame in: write it to a file with frame.save("picture.png")'
        )
    paper = Image.new("RGBA", image.size, (BACKGROUND_GREY, BACKGROUND_GREY, BACKGROUND_GREY, 255))
    _print_picture(Image.alpha_composite(paper, image).convert("RGB"))


def _print_picture(image: Image.Image) -> None:
    """Write a picture to the terminal, scaled down to fit."""
    stream = sys.__stdout__
    assert stream is not None  # `is_at_terminal` has looked.
    abilities = _query_terminal() if has_terminal() and sys.platform != "win32" else None
    protocol, cell = abilities or TerminalGraphics("blocks", terminal.DEFAULT_CELL)
    columns, lines = shutil.get_terminal_size()
    if protocol == "blocks":
        cell = (1, 2)
    # The prompt comes below.
    largest = columns * cell[0], max(lines - 1, 1) * cell[1]
    scale = min(1.0, largest[0] / image.width, largest[1] / image.height)
    width = max(1, round(image.width * scale))
    height = max(1, round(image.height * scale))
    pixels = np.asarray(image.resize((width, height), Image.Resampling.LANCZOS))
    rows = -(-height // cell[1])
    if protocol == "kitty":
        text = encode_kitty(pixels, KITTY_IMAGE_ID, (-(-width // cell[0]), rows)) + "\n" * rows
    elif protocol == "sixel":
        text = encode_sixel(pixels) + "\n"
    else:
        # A last row of one pixel is filled up with the background.
        whole = np.pad(pixels, ((0, height % 2), (0, 0), (0, 0)), constant_values=BACKGROUND_GREY)
        has_truecolor = os.environ.get("COLORTERM", "") in ("truecolor", "24bit")
        text = "".join(f"{line}\n" for line in encode_half_blocks(whole, has_truecolor))
    stream.write(text)
    stream.flush()


def _query_terminal() -> TerminalGraphics:
    """Ask the terminal what it can show."""
    import blessed

    term = blessed.Terminal(stream=sys.__stdout__)

    def write(text: str) -> None:
        term.stream.write(text)
        term.stream.flush()

    with term.cbreak():
        stdin = sys.__stdin__
        assert stdin is not None  # `is_at_terminal` has looked.
        return terminal.query_terminal(stdin.fileno(), write)
