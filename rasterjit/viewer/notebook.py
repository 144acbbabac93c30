"""
What a notebook shows of a viewer: a widget, or the last view and what is missing.

A widget turns while the notebook runs where its front end is installed. It is in ``widget``, which
needs packages; where they are missing, the picture says which.
"""

from __future__ import annotations

from typing import Any

from rasterjit.viewer.saved_view import Saved
from rasterjit.viewer.viewer import Viewer

FIRST_STEPS = 2
"""Of a viewer: after them its picture has standard quality."""

NO_PACKAGES = (
    'This view does not turn: run pip install "rasterjit[notebook]" in the environment of this '
    "kernel, and restart it ({reason}). If Jupyter's server has another environment, that needs "
    "ipywidgets and anywidget."
)


class Still:
    """
    A viewer that nobody moves, and the reason: the last line of a cell shows its picture.

    Parameters
    ----------
    viewer : Viewer
    reason : str
    """

    def __init__(self, viewer: Viewer, reason: str) -> None:
        self._saved, self._reason = Saved(viewer), reason

    def __repr__(self) -> str:
        return f"Still({self._saved.description})"

    def _ipython_display_(self) -> None:
        """Show it in a notebook."""
        self._saved.show({"text/plain": NO_PACKAGES.format(reason=self._reason)}, {})


def widget(viewer: Viewer, *, is_needed: bool = True) -> Any:
    """
    Return a widget that shows a viewer: the last line of a cell displays it.

    Parameters
    ----------
    viewer : Viewer
    is_needed : bool
        Whether nothing else will do.

    Returns
    -------
    ViewWidget or Still
        The latter where packages are missing and something else will do.

    Raises
    ------
    ImportError
        If what it needs is not installed, naming what to install.
    """
    try:
        from rasterjit.viewer.widget import ViewWidget
    except ImportError as error:
        if is_needed:
            raise ImportError(
                f'a widget needs packages: pip install "rasterjit[notebook]" ({error})'
            ) from error
        _prepare(viewer)
        return Still(viewer, str(error))
    _prepare(viewer)
    return ViewWidget(viewer)


def _prepare(viewer: Viewer) -> None:
    """Compile what a viewer needs before it stands there, not answering; improve its picture."""
    viewer.draw()
    for _ in range(FIRST_STEPS):
        viewer.step()
