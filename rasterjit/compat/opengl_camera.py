"""Cameras of programs for OpenGL: two matrices, and pictures whose first row is the lowest."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.camera import MatrixCamera

Float64 = NDArray[np.float64]


def make_matrix_camera(view: Float64, clip: Float64) -> MatrixCamera:
    """Return a camera of two matrices, (4, 4); for those of late the one that was made then."""
    return _make_cached_camera(view.tobytes(), clip.tobytes())


@functools.lru_cache(maxsize=64)
def _make_cached_camera(view: bytes, clip: bytes) -> MatrixCamera:
    """Return a camera, given the numbers of its matrices."""
    own, projection = (np.frombuffer(matrix).reshape(4, 4) for matrix in (view, clip))
    return MatrixCamera(own, projection)


def flip_rows(camera: MatrixCamera) -> MatrixCamera:
    """
    Return a camera whose first row of pixels is the lowest, as OpenGL's is.

    So the samples of a pixel, and edges through centres, lie where they lie there.
    """
    clip = camera.clip_from_view.copy()
    clip[1] = -clip[1]
    return make_matrix_camera(camera.view_from_world, clip)
