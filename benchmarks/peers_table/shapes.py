"""What all are asked to draw: shapes, a camera, and how pictures are judged. Needs NumPy alone."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from pkgutil import walk_packages
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

SIZE = 640, 480
FOV_Y, NEAR, FAR = 60.0, 0.1, 2000.0
"""Degrees and scene units of the camera, which stands at the origin and looks along -z."""
EYE, TARGET = (3.0, 5.0, 9.0), (0.0, 1.3, 0.0)
"""Where the teapot is seen from."""
QUAD = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
WALL_DEPTH = 987.654
WALL = np.array([(-2000.0, -1500, -1), (2000, -1500, -1), (2000, 1500, -1), (-2000, 1500, -1)])
WALL[:, 2] = -WALL_DEPTH
"""A plane that faces the eye and fills the picture."""
UPRIGHT = np.array([(-1.3, -0.9, -4.0), (1.1, -1.2, -4), (1.4, 0.8, -4), (-1.0, 1.1, -4)])
"""A tilted rectangle that faces the eye; its first face is the right one at the bottom."""
FLOOR = np.array([(-3.0, -1, -3), (3, -1, -3), (3, -1, -9), (-3, -1, -9)])
BLOCKER = np.array([(-1.0, 0.0, -5), (1, 0.0, -5), (1, 0.0, -7), (-1, 0.0, -7)])
"""A plate above the floor, which throws a shadow on it."""
TO_LIGHT = np.array([0.5, 1.0, 0.4]) / np.linalg.norm([0.5, 1.0, 0.4])


def rays() -> NDArray[np.float64]:
    """Return the direction to the centre of each pixel, (H, W, 3), with a depth of 1."""
    width, height = SIZE
    scale = np.tan(np.radians(FOV_Y / 2)) / (height / 2)
    x = (np.arange(width) + 0.5 - width / 2) * scale
    y = (height / 2 - np.arange(height) - 0.5) * scale
    return np.dstack([*np.broadcast_arrays(x[None, :], y[:, None], -1.0)])


def focal() -> float:
    """Return the focal length in pixels."""
    return float(SIZE[1] / 2 / np.tan(np.radians(FOV_Y / 2)))


def depth_error(depth: NDArray[Any]) -> float:
    """Return the largest relative error of the depth of `WALL`, (H, W)."""
    return float(np.max(np.abs(np.asarray(depth, np.float64) / WALL_DEPTH - 1.0)))


def is_smooth(picture: NDArray[np.uint8]) -> bool:
    """Return whether the edges of a bright shape before black have values between."""
    grey = picture[..., :3].max(axis=2) / max(int(picture.max()), 1)
    return bool(np.count_nonzero((grey > 0.2) & (grey < 0.8)) > 50)


def differ(first: NDArray[np.uint8], second: NDArray[np.uint8], least: float = 0.003) -> bool:
    """Return whether this share of two pictures' pixels differs by more than 12 codes."""
    apart = np.abs(first[..., :3].astype(int) - second[..., :3]).max(axis=2)
    return bool((apart > 12).mean() > least)


def crosses(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> bool:
    """
    Return whether two crossing panes are sorted, where the second has them in the other order.

    The pictures are the same, but for rounding; red is in front on the left, blue on the right, and
    the other is seen through it.
    """
    height, width = first.shape[:2]
    left, right = (first[height // 2, int(width * x), :3].astype(int) for x in (0.4, 0.6))
    is_sorted = left[0] > left[2] + 12 and right[2] > right[0] + 12
    shows_both = left[2] > 0.2 * left[0] and right[0] > 0.2 * right[2]
    return bool(is_sorted and shows_both) and not differ(first, second, 0.001)


def turned(angle: float) -> NDArray[np.float64]:
    """Return an upright rectangle at a depth of 4, turned about its vertical middle, (4, 3)."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    flat = np.array([(-1.5, -1.0), (1.5, -1), (1.5, 1), (-1.5, 1)])
    return np.column_stack([c * flat[:, 0], flat[:, 1], -4.0 - s * flat[:, 0]])


def absent(package: str, pattern: str) -> bool:
    """
    Return ``False`` if no public name of a package has a pattern in it.

    Raises ``LookupError``, which names what has it, otherwise.
    """
    found = sorted({name for name in names(import_module(package)) if re.search(pattern, name)})
    if found:
        raise LookupError(f"{package} has {', '.join(found[:8])}")
    return False


def names(package: ModuleType) -> Iterator[str]:
    """Yield the public names of a package, its modules, and their classes, in lower case."""
    modules = [package]
    for each in walk_packages(getattr(package, "__path__", ()), f"{package.__name__}."):
        if "._" in each.name or ".tests" in each.name or each.name.endswith("__main__"):
            continue
        try:
            modules.append(import_module(each.name))
        except BaseException:  # a module for another system, or with needs of its own
            yield each.name.lower()
    for module in modules:
        yield module.__name__.lower()
        for name, value in vars(module).items():
            if name.lower().startswith(("_", "gl_")):  # the latter are constants of OpenGL
                continue
            yield name.lower()
            if isinstance(value, type):
                yield from (inner.lower() for inner in dir(value) if not inner.startswith("_"))
