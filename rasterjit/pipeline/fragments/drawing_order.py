"""
Emulate OpenGL's unsorted blending with depth writes: drop fragments that fail the depth test.

OpenGL blends a transparent face over what was drawn before, and writes its depth. So a face behind
another is visible through it only if it was drawn first. Faces are drawn in order of their numbers.
"""

from __future__ import annotations

from rasterjit.pipeline.visibility.tile_rasterizer import NOTHING
from rasterjit.runtime.jit import kernel
from rasterjit.runtime.state_block import int32


@kernel
def drop_hidden(transparent: int32[:, :, :, :]):
    """
    Drop faces behind others that were drawn earlier.

    Parameters
    ----------
    transparent : (N, K, R, W) int32
        Changed: the transparent faces at each sample, nearest first, -1 after the last.
    """
    samples, levels, height, width = transparent.shape
    for sample in range(samples):
        for row in range(height):
            for i in range(width):
                if transparent[sample, 0, row, i] < 0:
                    continue
                first, count = transparent[sample, 0, row, i], 1
                for level in range(1, levels):
                    face = transparent[sample, level, row, i]
                    transparent[sample, level, row, i] = NOTHING
                    if 0 <= face < first:
                        transparent[sample, count, row, i] = first = face
                        count += 1
