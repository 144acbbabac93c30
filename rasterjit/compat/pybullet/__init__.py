"""
Pictures of PyBullet's worlds: `getCameraImage` takes PyBullet's arguments and returns its tuple.

After ``rasterjit.compat.pybullet.install()``, ``pybullet.getCameraImage`` is that of this module.
From the import on, calls of PyBullet that tell of textures and vertices, such as ``loadTexture``,
are noted as they pass: PyBullet does not tell of them later.
"""

from __future__ import annotations

try:
    import pybullet as _pybullet
except ImportError as error:
    raise ImportError(
        f'pictures of worlds need PyBullet: pip install "rasterjit[pybullet]" ({error})'
    ) from error

from rasterjit.compat.pybullet.camera_image import getCameraImage
from rasterjit.compat.pybullet.noted_calls import note_calls

__all__ = ["getCameraImage", "install"]

note_calls()


def install() -> None:
    """Let ``pybullet.getCameraImage`` be that of this module."""
    _pybullet.getCameraImage = getCameraImage
