"""What all platforms have."""

from __future__ import annotations

from rasterjit.compat.pyrender.fields import Field


class Platform:
    """
    A place to draw, which nothing here needs: all its methods do nothing.

    Parameters
    ----------
    viewport_width, viewport_height : int, pixels
    """

    def __init__(self, viewport_width: int, viewport_height: int) -> None:
        self.viewport_width, self.viewport_height = viewport_width, viewport_height

    viewport_width = Field(int, "int: as it was given.")
    viewport_height = Field(int, "int: as it was given.")

    def init_context(self) -> None:
        """Do nothing."""

    def make_current(self) -> None:
        """Do nothing."""

    def make_uncurrent(self) -> None:
        """Do nothing."""

    def delete_context(self) -> None:
        """Do nothing."""

    def supports_framebuffers(self) -> bool:
        """Return True: pictures of any size can be drawn."""
        return True
