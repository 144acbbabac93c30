"""Show the environment as a background, where no face is."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit import stages
from rasterjit.kernels import backgrounds
from rasterjit.kernels.records import Encoding, Environment
from rasterjit.workers import Workers


class Sky(NamedTuple):
    """The environment as a background, as ``backgrounds.show_environment`` takes it."""

    rays: NDArray[np.float64]
    """(3, 3): direction at the middle of the frame, and its change with x and y."""
    size: tuple[int, int]
    """Width and height of the whole frame, pixels."""
    environment: Environment
    corner: tuple[int, int] = (0, 0)
    """Column and row of the first pixel that is drawn, in the whole frame."""

    def from_row(self, first_row: int) -> tuple[Any, ...]:
        """Return what the kernel takes to show it from a row of what is drawn on."""
        left, top = self.corner
        return (left, top + first_row), self.rays, self.size, self.environment


def show_environment(
    face_id: NDArray[np.int32],
    sky: Sky,
    encoding: Encoding,
    linear: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    workers: Workers,
) -> None:
    """
    Write the environment to the pixels without a face, in bands of rows.

    Parameters
    ----------
    face_id : (H, W) int32
    sky : Sky
    encoding : Encoding
    linear : (H, W, 4) float32 or None
    color : (H, W, 4) uint8 or None
        Written, if the frame has them.
    workers : Workers
    """
    height = len(face_id)
    packed = np.empty((height, 0), np.uint32) if color is None else color.view(np.uint32)[:, :, 0]
    if linear is None:
        linear = np.empty((height, 0, 4), np.float32)
    per_task = stages.rows_per_task(face_id.shape, workers)

    def show_band(first: int) -> None:
        band = slice(first, min(first + per_task, height))
        backgrounds.show_environment(
            face_id[band], *sky.from_row(first), encoding, linear[band], packed[band]
        )

    workers.run(show_band, [(first,) for first in range(0, height, per_task)])
