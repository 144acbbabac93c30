"""Build the matrix that unprojects a pixel with its stored depth; see ``unproject``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera
from rasterjit.scene.pixel_projection import screen_from_relative

SNAP_SLACK = 2.0
"""
Sub-pixel units by which depths of one plane may be displaced on the screen.

A vertex is rounded by up to half a unit in x and in y, and so is the depth between vertices; two
depths are compared: one unit. Twice that, for rounding.
"""


def lens_of(camera: Camera, size: tuple[int, int], unit: float) -> NDArray[np.float32]:
    """
    Return the unprojection matrix of a camera; see ``unproject``.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Width and height, pixels.
    unit : float, scene units
        What lengths are measured in.

    Returns
    -------
    (4, 4) float32
        Rows: what a column, a row, a unit of stored depth, and 1 add to the homogeneous point.
    """
    width, height = size
    # Rows of the inverse: x, y, z, w; columns: clip x, y, stored depth and 1, all over w.
    inverse = transforms.inverse(screen_from_relative(camera, size))
    right, up, deeper, rest = inverse.T
    lens = np.array(
        [
            right * (2.0 / width),
            up * (-2.0 / height),
            deeper,
            rest + right * (1.0 / width - 1.0) + up * (1.0 - 1.0 / height),
        ]
    )
    lens[:, :3] /= unit
    # Homogeneous points may have any scale: so that float32 holds them.
    return (lens / np.abs(lens[:, :3]).max()).astype(np.float32)
