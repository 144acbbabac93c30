"""Show objects in prompts and notebooks: pictures with an alternative text, reports as text."""

from __future__ import annotations

import base64
from html import escape
from typing import Any, TypeAlias

from rasterjit.scene.hooks import call_higher_level

Bundle: TypeAlias = tuple[dict[str, Any], dict[str, Any]]
"""Data and metadata, each by media type, as ``_repr_mimebundle_`` returns them."""


class TextReport:
    """Base class of reports, shown as their text, `str`, in prompts and notebooks."""

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        """Return the text with its columns."""
        return f"<pre>{escape(str(self))}</pre>"


class PicturePreview:
    """Base class of objects that notebooks show as a small picture."""

    def _repr_png_(self) -> bytes | None:
        """Return a small picture as PNG; None if there is nothing to see."""
        frame = self._picture()
        return None if frame is None else frame._repr_png_()

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Bundle:
        """Return the picture, its size and time under it, and an alternative text."""
        frame = self._picture()
        if frame is None:
            return {}, {}
        return mime_bundle(frame._repr_png_(), f"Picture of {self!r}", caption=frame.caption)

    def _picture(self) -> Any:
        """Return a small frame; None if there is nothing to see."""
        return call_higher_level("preview", self)


def mime_bundle(
    png: bytes | None, alt: str, size: tuple[int, int] | None = None, caption: str = ""
) -> Bundle:
    """
    Return the MIME bundle of a picture for notebooks.

    JupyterLab and nbconvert take no alternative text from metadata: it stands in HTML besides.

    Parameters
    ----------
    png : bytes or None
        A PNG file. None: nothing is shown.
    alt : str
        What it shows.
    size : (int, int), optional
        Width and height on the screen. Default: those of the picture.
    caption : str
        Stands under the picture.
    """
    if png is None:
        return {}, {}
    sizes = {} if size is None else {"width": size[0], "height": size[1]}
    attributes = "".join(f' {name}="{length}"' for name, length in sizes.items())
    source = base64.b64encode(png).decode()
    html = f'<img src="data:image/png;base64,{source}" alt="{escape(alt)}"{attributes}>'
    if caption:
        html += f'<div style="font-size: 85%; opacity: 0.75">{escape(caption)}</div>'
    return {"image/png": png, "text/html": html}, {"image/png": {"alt": alt, **sizes}}
