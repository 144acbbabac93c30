"""Find how much of each pixel any face covers, of its samples or of its area."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.fragments import bands
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.passes import Rows
from rasterjit.pipeline.visibility.draw import Coverage
from rasterjit.runtime.threads import Workers


def kernels_of(samples: int | str, depth_type: Any) -> Rows:
    """Return the kernels that `cover_pixels` calls."""
    return [] if samples == 1 else bands.kernels_of(samples, depth_type)


def cover_pixels(
    samples: int | str, coverage: Coverage, finder: bands.Finder, workers: Workers
) -> NDArray[np.float32]:
    """
    Return the share of each pixel's samples that any face covers, (H, W), or of its area.

    Parameters
    ----------
    samples : int or str
        1 to 16, or ``"area"``.
    coverage : Coverage
        With its lists.
    finder : Finder
    workers : Workers
    """
    if samples == 1:
        return (coverage.face_id >= 0).astype(np.float32)
    finder = bands.at_samples(finder, samples)
    viewport = finder.geometry.viewport
    nothing = np.zeros(len(coverage.lists.objects.face_starts) - 1, np.uint8)
    lists = bands.part_lists(coverage, viewport, nothing, workers)
    covered = workers.memory.empty((viewport.height, viewport.width), np.float32)

    def cover_tiles(first: int) -> None:
        rows = first, min(first + TILE_SIZE, viewport.height)
        if samples == "area":
            _, _, rest = bands.find_areas(rows, lists, finder, workers.memory)
            np.subtract(np.float32(1.0), rest, out=covered[slice(*rows)])
            return
        for band in bands.find_layers(rows, lists, int(samples), finder, workers.memory):
            counts = np.count_nonzero(band.opaque >= 0, axis=0)
            target = covered[band.first_row : band.first_row + len(counts)]
            # The number of samples is a power of two.
            target[:] = counts / np.float32(samples)

    workers.run(cover_tiles, [(first,) for first in range(0, viewport.height, TILE_SIZE)])
    return covered
