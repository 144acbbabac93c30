"""The viewer as a widget of a notebook."""

from __future__ import annotations

import sys
from typing import Any

from rasterjit.viewer import Viewer
from rasterjit.viewer_canvas import FRAME_RATE, Connection


def in_notebook() -> bool:
    """Tell whether this process is the kernel of a notebook."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    return running is not None and getattr(running, "kernel", None) is not None


def widget(viewer: Viewer) -> Any:
    """
    Return a widget that shows a viewer: the last line of a cell displays it.

    Raises
    ------
    ImportError
        If what it needs is not installed, naming what to install.
    """
    try:
        from rendercanvas.anywidget import RenderCanvas
    except ImportError as error:
        raise ImportError(
            f'a widget needs packages: pip install "rasterjit[notebook]" ({error})'
        ) from error
    # What has to be compiled is compiled before a widget stands there, not answering.
    viewer.draw()
    canvas = RenderCanvas(size=viewer.size, max_fps=FRAME_RATE)
    Connection(viewer, canvas)
    return canvas
