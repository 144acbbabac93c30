"""Compare what contestants drew, before their times count."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.scenes import Scene, TriangleScene

Picture = Mapping[str, NDArray[Any]]

COLOR_STEPS = 3
"""Of 255, in linear light: colours that differ by no more are alike."""


class Needed(NamedTuple):
    """What a picture must share with the reference."""

    covered: float
    """Share of all pixels that both cover or both leave empty."""
    colors: float
    """Share of the pixels covered by both whose colours are alike."""
    near: float = 0.0
    """Share of either's covered pixels within one pixel of which the other covers one."""


USUAL = Needed(0.999, 0.99)
EDGES_NEAR = 0.999
"""Of wireframes: edges begin at the pixel next to where OpenGL's begin, and may run beside them."""
EXACT = Needed(1.0, 1.0)


def needed(scene: Scene, contestant: ModuleType) -> Needed:
    """Return what a contestant's picture of a scene must reach, looser where its file says so."""
    usual = USUAL
    if hasattr(contestant, "alike"):
        usual = Needed(*contestant.alike(scene))
    if isinstance(scene, TriangleScene) and scene.mode == "edges":
        usual = usual._replace(near=EDGES_NEAR)
    return usual


def agreement(one: Picture, other: Picture) -> dict[str, float]:
    """
    Return the share of alike pixels for each array that both pictures have.

    ``covered``, ``face_id`` and ``color`` must be equal, over all pixels; ``color_linear`` within
    ``COLOR_STEPS``, over the pixels that both cover.
    """
    shares = {}
    for name in sorted(one.keys() & other.keys()):
        if one[name].shape != other[name].shape:
            shares[name] = 0.0
        elif name == "color_linear":
            both = one["covered"] & other["covered"]
            steps = np.maximum(one[name], other[name]) - np.minimum(one[name], other[name])
            alike = both & (steps <= COLOR_STEPS).all(axis=-1)
            count = np.count_nonzero(both)
            shares[name] = np.count_nonzero(alike) / count if count else 0.0
        else:
            equal = one[name] == other[name]
            # Nearly always all are, and a row of four is slow to look at.
            is_row = equal.ndim == 3 and not equal.all()
            shares[name] = float(equal.all(axis=-1).mean() if is_row else equal.mean())
    return shares


def nearness(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """Return the share of covered pixels, of the worse, that the other covers within one pixel."""
    if not one.any() or not other.any():
        return 0.0
    return float(min(widened(other)[one].mean(), widened(one)[other].mean()))


def widened(covered: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pixels that are covered or touch one that is, also by a corner."""
    rows, wide = covered.copy(), covered.copy()
    rows[1:] |= covered[:-1]
    rows[:-1] |= covered[1:]
    wide |= rows
    wide[:, 1:] |= rows[:, :-1]
    wide[:, :-1] |= rows[:, 1:]
    return wide


def differs(shares: Mapping[str, float], least: Needed) -> bool:
    """Return whether a picture shares too little with the reference."""
    if shares.get("covered", 0.0) < least.covered:
        return True
    if least == EXACT:
        return min(shares.values()) < 1.0
    if shares.get("near", 1.0) < least.near:
        return True
    return shares.get("color_linear", 1.0) < least.colors


def text_of(shares: Mapping[str, float]) -> str:
    """Return the shares in words."""
    names = {"color_linear": "colours", "face_id": "faces", "color": "bits"}
    return ", ".join(f"{names.get(name, name)} {share:.3%}" for name, share in shares.items())
