"""What programs ask of pyglet's window, which pyrender's viewer is and this one is not."""

from __future__ import annotations

from typing import Any


class Window:
    """
    A window that shows nothing by itself, for programs that place theirs or bring it forward.

    It is where it was put and as large as the viewer says; what else is done to it has no effect.
    """

    viewport_size: Any

    _place = (0, 0)
    _caption: str | None = None

    @property
    def _window(self) -> int:
        """A number that stands for it: programs wait until it is not None."""
        return id(self)

    @property
    def width(self) -> int:
        """Width of the picture, pixels."""
        return int(self.viewport_size[0])

    @property
    def height(self) -> int:
        """Height of the picture, pixels."""
        return int(self.viewport_size[1])

    @property
    def caption(self) -> str | None:
        """Its title, as it was set."""
        return self._caption

    def get_size(self) -> tuple[int, int]:
        """Return width and height of the picture, pixels."""
        return self.width, self.height

    def get_location(self) -> tuple[int, int]:
        """Return x and y as they were set, pixels; at first 0."""
        return self._place

    def set_location(self, x: int, y: int) -> None:
        """Keep x and y, pixels."""
        self._place = x, y

    def set_caption(self, caption: str) -> None:
        """Keep a title."""
        self._caption = caption

    def set_size(self, width: int, height: int) -> None:
        """Do nothing: whoever looks chooses the size."""

    def set_fullscreen(self, fullscreen: bool = True, *_: Any, **__: Any) -> None:
        """Do nothing: whoever looks chooses the size."""

    def set_visible(self, visible: bool = True) -> None:
        """Do nothing."""

    def set_mouse_visible(self, visible: bool = True) -> None:
        """Do nothing."""

    def activate(self) -> None:
        """Do nothing."""

    def minimize(self) -> None:
        """Do nothing."""

    def maximize(self) -> None:
        """Do nothing."""

    def switch_to(self) -> None:
        """Do nothing: there is no context of OpenGL."""

    def flip(self) -> None:
        """Do nothing: what was drawn is shown at once."""

    def clear(self) -> None:
        """Do nothing: what was drawn goes with the next picture."""

    def dispatch_events(self) -> None:
        """Do nothing: events come by themselves."""
