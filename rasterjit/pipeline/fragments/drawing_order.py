"""
Leave out what a depth buffer would not have let through, faces being drawn one after the other.

OpenGL lays a transparent face over what was drawn before it, and writes its depth. So a face that
lies behind another is seen through that only if it was drawn first. Faces are drawn in the order
of their numbers.
"""

from __future__ import annotations

from rasterjit.pipeline.visibility.nearest import NOTHING
from rasterjit.runtime.jit import kernel
from rasterjit.runtime.state import int32


@kernel
def keep_drawn(transparent: int32[:, :, :, :]):
    """
    Leave out faces behind others that were drawn before them.

    Parameters
    ----------
    transparent : (N, K, R, W) int32
        Changed: the transparent faces at each sample, nearest first, -1 behind the last.
    """
    samples, levels, height, width = transparent.shape
    for sample in range(samples):
        for row in range(height):
            for i in range(width):
                if transparent[sample, 0, row, i] < 0:
                    continue
                first, kept = transparent[sample, 0, row, i], 1
                for level in range(1, levels):
                    face = transparent[sample, level, row, i]
                    transparent[sample, level, row, i] = NOTHING
                    if 0 <= face < first:
                        transparent[sample, kept, row, i] = first = face
                        kept += 1
