"""The platform for machines without a display: any device that is named is the CPU."""

from __future__ import annotations

from rasterjit.compat.pyrender.platforms.base import Platform


class EGLDevice:
    """
    The CPU.

    Parameters
    ----------
    display : optional
        Taken and without effect.
    """

    def __init__(self, display: object = None) -> None:
        self._display = display

    @property
    def name(self) -> str:
        """What draws."""
        return "CPU"

    def __repr__(self) -> str:
        return f"EGLDevice({self.name})"


class EGLPlatform(Platform):
    """
    A platform that does nothing, as `Platform` is.

    Parameters
    ----------
    viewport_width, viewport_height : int, pixels
    device : EGLDevice, optional
        Taken and without effect.
    """

    def __init__(
        self, viewport_width: int, viewport_height: int, device: EGLDevice | None = None
    ) -> None:
        super().__init__(viewport_width, viewport_height)


def query_devices() -> list[EGLDevice]:
    """Return the one device that there is."""
    return [EGLDevice()]


def get_default_device() -> EGLDevice:
    """Return the one device that there is."""
    return EGLDevice()


def get_device_by_index(device_id: int) -> EGLDevice:
    """Return the one device that there is, whatever its number."""
    return EGLDevice()
