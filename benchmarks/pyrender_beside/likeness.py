"""How far the adapter's picture is from the original's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.pictures import widened

Picture = Mapping[str, NDArray[Any]]
Bools = NDArray[np.bool_]

COLOR_CODES, MASK_SHARE, DEPTH_ERROR = 2.0, 1.0 / 200.0, 1e-5
"""The marks: mean difference inside objects, share of a mask's pixels, relative error of depth."""
DEPTH_BITS, PIXEL_STEPS = 24, 256
"""Of the original's buffer; of the grid to which it snaps vertices, in a pixel."""
DEPTH_SHARE = 1.0 / 200.0
"""Share of pixels whose depth may lie beyond the mark and a step of both."""

MIN_INSIDE = 100
"""Pixels; a picture that has fewer of them inside objects, of lines alone, counts all it covers."""


class Likeness(NamedTuple):
    """What `compare` found; nan where there is nothing to count."""

    inside: float
    """Mean difference of colours, codes, over the pixels that both cover with all beside them; of a
    picture that has next to none, such as a wireframe, over all that either covers."""
    worst: float
    """The 99th percentile of the same."""
    edges: float
    """Mean difference over the other pixels that either covers."""
    outside: float
    """Largest difference where neither covers a pixel or one beside it."""
    alpha: float
    """Mean difference of alpha over the pixels of `inside`, nan if there is none."""
    outline: float
    """Share of differing ones among the mask's pixels within a pixel of the original's outline."""
    far: float
    """Pixels whose mask differs and that lie farther than that from it, in shares of the pixels
    that the original covers."""
    depth: float
    """Relative error of depth, median over pixels of `inside` without a step of depth."""
    depth_99: float
    """The 99th percentile of the same."""
    beyond: float
    """Share of the same pixels that err by more than the mark, a step of the original's buffer and
    what its depth changes in a step of its grid."""

    def failures(self, color: float = COLOR_CODES, outline: float = MASK_SHARE) -> list[str]:
        """Return the marks that are missed, in words; some pictures have their own."""
        found = []
        if self.inside > color:
            found.append(f"colour {self.inside:.1f}")
        if self.alpha > COLOR_CODES:
            found.append(f"alpha {self.alpha:.1f}")
        if self.outside > COLOR_CODES:
            found.append(f"background {self.outside:.0f}")
        if self.outline > outline or self.far > MASK_SHARE:
            found.append(f"mask {self.outline:.2%}, {self.far:.2%}")
        if self.depth > DEPTH_ERROR or self.beyond > DEPTH_SHARE:
            found.append(f"depth {self.depth:.1e}, {self.beyond:.1%} beyond")
        return found


def compare(theirs: Picture, ours: Picture) -> Likeness:
    """
    Compare two pictures of a scene.

    Parameters
    ----------
    theirs, ours : Picture
        The original's and the adapter's: ``depth`` (H, W), 0 where nothing is, ``color``
        (H, W, 3 or 4) uint8, both or neither, and the camera's ``near`` and ``far``.
    """
    their_mask, our_mask = theirs["depth"] > 0.0, ours["depth"] > 0.0
    either = their_mask | our_mask
    inside = inner(their_mask & our_mask)
    counted = inside if np.count_nonzero(inside) >= MIN_INSIDE else either
    colors = worst = edges = outside = alpha = math.nan
    if "color" in theirs:
        off = np.abs(theirs["color"].astype(float) - ours["color"])
        tint = off[..., :3].mean(axis=-1)
        colors, worst = mean(tint[counted]), percentile(tint[counted], 99.0)
        edges = mean(tint[either & ~counted])
        # Lines and the original's four samples reach over the edge of a mask.
        away = ~widened(widened(either))
        outside = float(off[away].max()) if away.any() else math.nan
        if off.shape[-1] == 4:
            alpha = mean(off[..., 3][counted])
    outline = widened(their_mask) & widened(~their_mask)
    differ = their_mask != our_mask
    covered = max(np.count_nonzero(their_mask), 1)
    near = np.count_nonzero(outline)
    steady = inside & ~stepped(theirs["depth"]) & ~stepped(ours["depth"])
    true = theirs["depth"][steady].astype(np.float64)
    error = np.abs(ours["depth"][steady] / true - 1.0)
    near_and_far = 1.0 / theirs["near"] - 1.0 / theirs["far"]
    moves = slope(ours["depth"])[steady] / PIXEL_STEPS
    allowed = DEPTH_ERROR + true * near_and_far * 2.0**-DEPTH_BITS + moves / true
    return Likeness(
        colors, worst, edges, outside, alpha,
        np.count_nonzero(differ & outline) / near if near else math.nan,
        np.count_nonzero(differ & ~outline) / covered,
        percentile(error, 50.0), percentile(error, 99.0),
        mean(error > allowed),
    )  # fmt: skip


def inner(covered: Bools) -> Bools:
    """Return the pixels that are covered with all eight beside them."""
    return ~widened(~covered)


def stepped(depth: NDArray[np.float32]) -> Bools:
    """Return the pixels beside which depth changes by more than a fiftieth."""
    found = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        one, other = np.moveaxis(depth, axis, 0)[:-1], np.moveaxis(depth, axis, 0)[1:]
        step = np.abs(one - other) > 0.02 * np.maximum(one, other)
        rows = np.moveaxis(found, axis, 0)
        rows[:-1] |= step
        rows[1:] |= step
    return widened(found)


def slope(depth: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return by how much depth changes from pixel to pixel, (H, W)."""
    down, right = np.gradient(depth.astype(np.float64))
    return np.abs(down) + np.abs(right)


def mean(values: NDArray[Any]) -> float:
    """Return the mean, nan of nothing."""
    return float(values.mean()) if values.size else math.nan


def percentile(values: NDArray[Any], share: float) -> float:
    """Return a percentile, nan of nothing."""
    return float(np.percentile(values, share)) if values.size else math.nan
