"""Decide from two series of measurements whether a later version is slower."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.pairing import paired_ratios

LIMIT = 1.10
"""How many times as long the later version may take."""

FEW_WIDE = 16
"""Vector instructions below which a kernel has none to lose."""
KEPT_SHARE = 0.5
"""Share of its vector instructions that a kernel must keep."""


@dataclass
class Comparison:
    """One row: a figure of both versions."""

    what: str
    before: float | None = None
    after: float | None = None
    ratio: float | None = None
    """Of the later to the earlier; of times, the median of the paired ratios."""
    low: float | None = None
    high: float | None = None
    """Quartiles of the paired ratios."""
    is_worse: bool = False
    note: str = ""
    rounds: list[tuple[float, float]] = field(default_factory=list)
    """Both figures of every round."""


def judge_times(
    what: str, before: Sequence[float], after: Sequence[float], limit: float = LIMIT
) -> Comparison:
    """
    Compare two series of times, taken in turns.

    The later version is slower if the median of the ratios exceeds the limit and three quarters
    of them exceed 1, so that a few disturbed rounds decide nothing.
    """
    ratios = paired_ratios(after, before)
    low, ratio, high = np.quantile(ratios, (0.25, 0.5, 0.75)).tolist()
    return Comparison(
        what, statistics.median(before), statistics.median(after), ratio, low, high,
        ratio > limit and low > 1.0, rounds=list(zip(before, after, strict=True)),
    )  # fmt: skip


def judge_code(
    before: Mapping[str, Mapping[str, int]], after: Mapping[str, Mapping[str, int]]
) -> list[Comparison]:
    """
    Compare the instructions of kernels, and name those that lost their vectors.

    Takes counts of ``instructions`` and ``wide`` ones by kernel; the first row is their sum.
    """
    sums = [sum_of(before.values()), sum_of(after.values())]
    rows = [judge_kernel("all kernels", *sums)]
    for name in sorted(before.keys() | after.keys()):
        if name not in after or name not in before:
            note = "new" if name in after else "gone"
            rows.append(Comparison(name, note=note))
        else:
            rows.append(judge_kernel(name, before[name], after[name]))
    return rows


def sum_of(kernels: Sequence[Mapping[str, int]]) -> dict[str, int]:
    """Return the counts of all kernels together."""
    return {key: sum(kernel[key] for kernel in kernels) for key in ("instructions", "wide")}


def judge_kernel(name: str, before: Mapping[str, int], after: Mapping[str, int]) -> Comparison:
    """Compare one kernel's instructions; fewer than half its vector instructions is worse."""
    lost = before["wide"] >= FEW_WIDE and after["wide"] < KEPT_SHARE * before["wide"]
    note = f"vector instructions {before['wide']} -> {after['wide']}"
    return Comparison(
        name, before["instructions"], after["instructions"],
        after["instructions"] / before["instructions"] if before["instructions"] else None,
        is_worse=lost, note=f"lost its vectors: {note}" if lost else note,
    )  # fmt: skip
