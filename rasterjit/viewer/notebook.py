"""
The output of a viewer in a notebook: a widget, or a picture and what is missing.

A widget turns while the notebook runs where its front end is installed. It is in ``widget``, which
needs packages; where they are missing, the picture says which.
"""

from __future__ import annotations

from typing import Any

from rasterjit.viewer.saved_view import SavedView
from rasterjit.viewer.viewer import Viewer

INITIAL_STEPS = 2
"""Steps of a viewer before it is displayed: its picture then has standard quality."""

MISSING_PACKAGES = (
    'This view does not turn: run pip install "rasterjit[notebook]" in the environment of this '
    "kernel, and restart it ({reason}). If Jupyter's server has another environment, that needs "
    "ipywidgets and anywidget."
)


class StillView:
    """
    The picture of a viewer that cannot run as a widget, and the reason.

    Parameters
    ----------
    viewer : Viewer
    reason : str
    """

    def __init__(self, viewer: Viewer, reason: str) -> None:
        self._saved, self._reason = SavedView(viewer), reason

    def __repr__(self) -> str:
        return f"Still({self._saved.description})"

    def _ipython_display_(self) -> None:
        """Display the picture in a notebook."""
        self._saved.show({"text/plain": MISSING_PACKAGES.format(reason=self._reason)}, {})


def make_widget(viewer: Viewer, *, is_needed: bool = True) -> Any:
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
        return StillView(viewer, str(error))
    _prepare(viewer)
    return ViewWidget(viewer)


def _prepare(viewer: Viewer) -> None:
    """Compile the kernels of a viewer and refine its picture, before it is displayed."""
    viewer.draw()
    for _ in range(INITIAL_STEPS):
        viewer.step()
