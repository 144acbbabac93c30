"""The viewer in a terminal: two pixels a character."""

from __future__ import annotations

import sys

from rasterjit.viewer import Viewer
from rasterjit.viewer_canvas import Connection

FRAME_RATE = 20.0
"""Most pictures a second: a terminal takes long to show one."""

KEYS = "arrows turn, + - zoom, F fits, R returns, Ctrl-C ends"
"""What the title says: most terminals are too small for a help panel."""


def run_in_terminal(viewer: Viewer, title: str) -> None:
    """
    Show a viewer in the terminal until it is closed, by Ctrl-C or the cross on top.

    Raises
    ------
    ImportError
        If what it needs is not installed, naming what to install.
    ValueError
        If standard input or output is no terminal.
    """
    if not (sys.__stdout__ and sys.__stdout__.isatty() and sys.__stdin__.isatty()):
        raise ValueError(
            "backend must not be 'terminal' where standard input or output is none, but a file or "
            "a pipe"
        )
    try:
        from rendercanvas import terminal
    except ImportError as error:
        raise ImportError(
            f'the terminal needs a package: pip install "rasterjit[terminal]" ({error})'
        ) from error
    # What has to be compiled is compiled before the terminal changes.
    viewer.draw()
    canvas = terminal.RenderCanvas(title=f"{title}: {KEYS}", max_fps=FRAME_RATE)
    Connection(viewer, canvas)
    try:
        terminal.loop.run()
    finally:
        canvas.close()
