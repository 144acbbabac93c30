"""Build the matrix that unprojects a pixel with its stored depth; see ``unproject``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera
from rasterjit.scene.pixel_projection import screen_from_relative

SNAP_SLACK_UNITS = 2.0
"""
Sub-pixel units by which depths of one plane may be displaced on the screen.

A vertex is rounded by up to half a unit in x and in y, and so is the depth between vertices; two
depths are compared: one unit. Twice that, for rounding.
"""


def build_unprojection_matrix(
    camera: Camera, size: tuple[int, int], unit: float
) -> NDArray[np.float32]:
    """
    Build the unprojection matrix of a camera; see ``unproject``.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Width and height, pixels.
    unit : float
        Length of a unit of the points, scene units.

    Returns
    -------
    (4, 4) float32
        Rows: homogeneous points, to be multiplied by column, row, stored depth and 1, and added.
    """
    width, height = size
    # Rows of the inverse: x, y, z, w; columns: clip x, y, stored depth and 1, all over w.
    inverse = transforms.inverse(screen_from_relative(camera, size))
    right, up, deeper, origin = inverse.T
    rows = (
        right * (2.0 / width), up * (-2.0 / height), deeper,
        origin + right * (1.0 / width - 1.0) + up * (1.0 - 1.0 / height),
    )  # fmt: skip
    relative_from_pixel = np.array(rows)
    relative_from_pixel[:, :3] /= unit
    # Homogeneous points may have any scale; this one fits float32.
    return (relative_from_pixel / np.abs(relative_from_pixel[:, :3]).max()).astype(np.float32)
