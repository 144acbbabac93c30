"""
Random triangulations that cover an image, in whole steps of the sub-pixel grid.

Vertices are integers from the start, so rounding moves none of them and the tiling is exact: every
point of the image lies in one triangle, or on the boundary of some. All of them reach beyond the
image on every side.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

SUBPIXEL_BITS = (0, 4, 8, 12)
"""The grids that an image can be drawn on: vertices at multiples of ``2**-bits`` pixel."""

MAX_SIDE = 400
"""Pixels; most sides are no multiple of a tile's 64."""

SIDES_BEYOND = 20
"""How many times the image's shorter side a fan may reach beyond it: 8000 pixels, nearly the 8192
of the guard band."""


class Tiling(NamedTuple):
    """Triangles without gaps or overlaps, over the whole image."""

    name: str
    xy: NDArray[np.int64]
    """(V, 2), screen, units of ``2**-subpixel_bits`` pixel."""
    faces: NDArray[np.int64]
    """(F, 3), vertex numbers."""
    subpixel_bits: int
    size: tuple[int, int]
    """Width and height of the image, pixels."""

    @property
    def shared_edges(self) -> int:
        """Count the edges with a triangle on either side, by Euler's formula for a disk."""
        return 2 * len(self.faces) - len(self.xy) + 1


Image = tuple[NDArray[np.int64], int]
"""Width and height, in grid steps, and the logarithm of the steps in a pixel."""


def jittered_grid(rng: Any, image: Image, count: int) -> tuple[Any, Any]:
    """
    Return the vertices and faces of a grid whose points are moved by less than half its pitch.

    Parameters
    ----------
    rng : numpy.random.Generator
    image : ((2,) int64, int)
        The image's width and height in steps, and the logarithm of the steps in a pixel.
    count : int
        About how many triangles; fewer where there are not as many grid points.

    Returns
    -------
    ((V, 2) int64, (F, 3) int64)
        Vertices in steps from the top left corner, and faces.
    """
    extent, _ = image
    stretch = 10.0 ** rng.uniform(-1, 1)
    wanted = np.sqrt(count / 2 * np.array([stretch, 1 / stretch]))
    pitch = np.maximum(extent // np.maximum(wanted, 1.0), 1).astype(np.int64)
    columns, rows = -(-extent // pitch) + 3
    xy = np.stack(np.meshgrid(np.arange(columns) - 1, np.arange(rows) - 1), axis=-1) * pitch
    reach = (pitch - 1) // 2
    xy = xy.reshape(-1, 2) + rng.integers(-reach, reach + 1, (columns * rows, 2))
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    quads = np.stack([a, a + 1, a + columns + 1, a + columns], axis=1)
    one, other = quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [0, 1, 3, 1, 2, 3]]
    # A quad may have a reflex corner; then only one of its diagonals lies inside.
    least = [
        np.minimum(doubled_area(xy, halves[:, :3]), doubled_area(xy, halves[:, 3:]))
        for halves in (one, other)
    ]
    either = rng.random(len(quads)) < 0.5
    first = np.where((least[0] >= 0) & (least[1] >= 0), either, least[0] >= 0)
    return xy, np.where(first[:, None], one, other).reshape(-1, 3)


def fan(rng: Any, image: Image, count: int) -> tuple[Any, Any]:
    """Return a fan around one point, with its ring on a box; see `jittered_grid`."""
    extent, _ = image
    margin = int(rng.choice([1, extent.min(), SIDES_BEYOND * extent.min()]))
    sides = extent + 2 * margin
    perimeter = int(2 * sides.sum())
    if rng.random() < 0.5:
        along = rng.integers(0, perimeter, count)
    else:  # bunches, as thin as the grid allows
        middles = rng.integers(0, perimeter, 12)
        along = (rng.choice(middles, count) + rng.integers(0, count, count)) % perimeter
    corners = np.cumsum([0, sides[0], sides[1], sides[0]])
    along = np.unique(np.concatenate([along, corners]))
    side = np.searchsorted(corners, along, side="right") - 1
    t = along - corners[side]
    x = np.choose(side, [t, sides[0], sides[0] - t, 0])
    y = np.choose(side, [0, t, sides[1], sides[1] - t])
    hub = rng.integers(0, extent + 1) if rng.random() < 0.7 else rng.integers(1, sides) - margin
    xy = np.concatenate([[hub], np.stack([x, y], axis=1) - margin])
    ring = np.arange(1, len(xy))
    return xy, np.stack([np.zeros_like(ring), ring, np.roll(ring, -1)], axis=1)


def near_misses(rng: Any, image: Image, count: int) -> tuple[Any, Any]:
    """
    Return a fan whose spokes pass as close to a pixel's centre as the grid allows, or through it.

    Their edge functions there are -1, 0 or 1: the least a division or a rounding can get wrong.
    See `jittered_grid`; needs a grid of at least two steps to the pixel.
    """
    extent, bits = image
    hub = rng.integers(0, extent + 1) | [1, 0]  # odd, else all divisors are even
    pixels = rng.integers(0, extent >> bits, (count, 2))
    x, y = ((2 * pixels + 1) << (bits - 1)).T - hub[:, None]
    divisor, s, t = bezout(x, y)
    x, y, s, t = (values[divisor == 1] for values in (x, y, s, t))
    # From s x + t y = 1: the direction (v t, -v s) + k (x, y) leaves (x, y) by v.
    miss = rng.integers(-1, 2, len(x))
    reach = 4 * int(extent.sum())
    k = reach // np.maximum(abs(x), abs(y)) + 1
    spokes = np.stack([miss * t + k * x, -miss * s + k * y], axis=1)
    square = np.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)])
    spokes = np.concatenate([reach * square, np.unique(spokes, axis=0)])
    spokes = spokes[np.argsort(np.arctan2(spokes[:, 1], spokes[:, 0]), kind="stable")]
    ring = np.arange(1, len(spokes) + 1)
    faces = np.stack([np.zeros_like(ring), ring, np.roll(ring, -1)], axis=1)
    return np.concatenate([[hub], hub + spokes]), faces


def bezout(x: NDArray[np.int64], y: NDArray[np.int64]) -> tuple[Any, Any, Any]:
    """Return g, s and t with ``s x + t y = g``, the greatest common divisor of x and y."""
    old, new = (abs(x), np.sign(x), np.zeros_like(x)), (abs(y), np.zeros_like(y), np.sign(y))
    while new[0].any():
        going = new[0] > 0
        quotient = old[0] // np.maximum(new[0], 1)
        rest = tuple(a - quotient * b for a, b in zip(old, new, strict=True))
        old, new = (
            tuple(np.where(going, b, a) for a, b in zip(old, new, strict=True)),
            tuple(np.where(going, r, b) for r, b in zip(rest, new, strict=True)),
        )
    return old


def strips(rng: Any, image: Image, count: int) -> tuple[Any, Any]:
    """
    Return strips between parallel lines with random points on them; see `jittered_grid`.

    Either end of a triangle may be anywhere on its line, so most are long, slanted and thin.
    """
    extent, _ = image
    upright = rng.random() < 0.5
    width, height = extent[::-1] if upright else extent
    lines = min(int(rng.integers(2, 40)), int(height) + 1)
    y = np.unique(np.concatenate([[-1, height + 1], rng.integers(0, height + 1, lines - 2)]))
    each = max(count // (2 * len(y)), 2)
    xs = [np.unique(np.concatenate([[-1, width + 1], rng.integers(0, width + 1, each)])) for _ in y]
    starts = np.concatenate([[0], np.cumsum([len(x) for x in xs])])
    faces = []
    for k in range(len(y) - 1):
        # Walk along both lines at once; each step makes a triangle with the other line's point.
        above, below = len(xs[k]) - 1, len(xs[k + 1]) - 1
        keys = rng.random(above + below) * (1 if rng.random() < 0.7 else 0)
        is_above = (np.arange(above + below) < above)[np.argsort(keys, kind="stable")]
        i = np.cumsum(is_above) - is_above
        j = np.cumsum(~is_above) - ~is_above
        i, j = starts[k] + i, starts[k + 1] + j
        faces.append(np.stack([i, np.where(is_above, i + 1, j + 1), j], axis=1))
    xy = np.stack([np.concatenate(xs), np.repeat(y, np.diff(starts))], axis=1)
    return (xy[:, ::-1] if upright else xy), np.concatenate(faces)


def splits(rng: Any, image: Image, count: int) -> tuple[Any, Any]:
    """Return two triangles split again and again at points inside them; see `jittered_grid`."""
    width, height = image[0]
    xy = np.array([(-1, -1), (width + 1, -1), (width + 1, height + 1), (-1, height + 1)])
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    sharpness = rng.choice([0.3, 1.0, 5.0])
    while len(faces) < count:
        weights = rng.gamma(sharpness, size=(len(faces), 3)) + 1e-9  # never all zero
        weights /= weights.sum(axis=1, keepdims=True)
        points = np.rint((xy[faces] * weights[:, :, None]).sum(axis=1)).astype(np.int64)
        a, b, c = (xy[faces[:, n]] for n in range(3))
        inside = (edge(a, b, points) > 0) & (edge(b, c, points) > 0) & (edge(c, a, points) > 0)
        inside &= rng.random(len(faces)) < 0.9
        if inside.sum() < len(faces) // 100:
            break
        old, new = faces[inside], len(xy) + np.arange(inside.sum())
        parts = [np.stack([old[:, n], old[:, (n + 1) % 3], new], axis=1) for n in range(3)]
        faces = np.concatenate([faces[~inside], *parts])
        xy = np.concatenate([xy, points[inside]])
    return xy, faces


KINDS: dict[str, Callable[..., tuple[Any, Any]]] = {
    "jittered grid": jittered_grid,
    "fan": fan,
    "near misses": near_misses,
    "strips": strips,
    "splits": splits,
}


def random_tiling(rng: Any, kind: str, count: int, largest_side: int = MAX_SIDE) -> Tiling:
    """
    Return a random tiling of one kind.

    Half of them have their vertices at multiples of half or a whole pixel, so that edges run
    through many samples and vertices lie on them.
    """
    bits = int(rng.choice(SUBPIXEL_BITS))
    size = tuple(int(side) for side in rng.integers(largest_side // 8, largest_side + 1, 2))
    coarse = [n for n in (0, 1, 2, bits) if n <= bits]
    used = int(rng.choice(coarse[:-1] or coarse)) if rng.random() < 0.5 else bits
    if kind == "near misses":
        bits = used = max(bits, 4)
    xy, faces = KINDS[kind](rng, (np.array(size) << used, used), count)
    return Tiling(kind, xy << (bits - used), faces, bits, size)


def edge(a: NDArray[Any], b: NDArray[Any], p: NDArray[Any]) -> NDArray[Any]:
    """Return the edge function of a -> b at p, (..., 2) integers; positive to its right."""
    ab, ap = b - a, p - a
    return ab[..., 0] * ap[..., 1] - ab[..., 1] * ap[..., 0]


def doubled_area(xy: NDArray[np.int64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return twice the signed area of each face."""
    return edge(xy[faces[:, 0]], xy[faces[:, 1]], xy[faces[:, 2]])
