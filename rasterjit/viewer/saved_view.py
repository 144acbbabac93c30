"""What a notebook keeps of a viewer: the last view as a picture, its camera as code."""

from __future__ import annotations

import io
import uuid
from html import escape
from typing import Any

from PIL import Image, PngImagePlugin

from rasterjit.scene import notebook_preview
from rasterjit.viewer.protocol import format_camera_code
from rasterjit.viewer.viewer import Viewer

PICTURE_NAME = "rasterjit-view"
"""The text in a PNG file that tells a widget which picture is its own."""

_PREVIOUS = ".jp-OutputArea-child:has(+ .jp-OutputArea-child .rasterjit-camera) "
_NO_MODULE = (
    "The view does not turn. If anywidget is missing in the environment of the Jupyter server, run "
    "pip install anywidget there, then reload the page. What the page says:"
)
STYLE = (
    f"<style>{_PREVIOUS}> .jupyter-widgets.jp-OutputArea-output:not(:has(*)) {{display: none}} "
    f'{_PREVIOUS}.jupyter-widgets-error-widget::before {{content: "{_NO_MODULE}"}} '
    f"body.jp-Notebook {_PREVIOUS}> .jp-RenderedText {{display: none}} "
    "pre.rasterjit-camera.rasterjit-camera, .rasterjit-camera > code "
    "{word-break: normal; overflow-wrap: anywhere}</style>"
)
"""JupyterLab says that it does not find the widget of a notebook that does not run any more, and
shows an error where it cannot load the module of one. A page that nbconvert makes has no server.
Both break lines within numbers."""


class SavedView:
    """
    The outputs of a cell that a notebook keeps of a viewer.

    Parameters
    ----------
    viewer : Viewer

    Attributes
    ----------
    name : str
        Stands in the file of each picture.
    """

    def __init__(self, viewer: Viewer) -> None:
        self.name = uuid.uuid4().hex
        self._viewer = viewer
        self._pictures: list[Any] = []
        self._codes: list[Any] = []

    @property
    def description(self) -> str:
        """What the picture shows, for who does not see it."""
        return f"View of {self._viewer.scene!r}"

    def show(self, between: dict[str, Any], metadata: dict[str, Any]) -> None:
        """Show the picture, something else as a bundle of media types, and the camera."""
        from IPython.display import display

        data, info = self._make_picture_bundle()
        self._pictures.append(display(data, metadata=info, raw=True, display_id=True))
        display(between, metadata=metadata, raw=True)
        self._codes.append(display(self._make_code_bundle(), raw=True, display_id=True))

    def update(self) -> None:
        """Put the view as it is now in place of the last one, wherever it was shown."""
        data, metadata = self._make_picture_bundle()
        for handle in self._pictures:
            handle.update(data, metadata=metadata, raw=True)
        for handle in self._codes:
            handle.update(self._make_code_bundle(), raw=True)

    def _make_picture_bundle(self) -> notebook_preview.Bundle:
        """Return the picture, and what is told of it."""
        viewer, alt = self._viewer, self.description
        texts = PngImagePlugin.PngInfo()
        texts.add_text(PICTURE_NAME, self.name)
        data = io.BytesIO()
        picture = Image.fromarray(viewer.picture()[:, :, :3])
        picture.save(data, "PNG", pnginfo=texts)
        width, height = (round(side / viewer.ratio) for side in picture.size)
        bundle, metadata = notebook_preview.mime_bundle(data.getvalue(), alt, (width, height))
        return {**bundle, "text/plain": alt}, metadata

    def _make_code_bundle(self) -> dict[str, str]:
        """Return the camera, as text and as what hides an error of JupyterLab's besides."""
        code = format_camera_code(self._viewer.camera)
        html = f'{STYLE}<pre class="rasterjit-camera"><code>{escape(code)}</code></pre>'
        return {"text/plain": code, "text/html": html}
