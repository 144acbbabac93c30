"""Draw the heat maps: a picture for each look, a panel for each set of instructions and threads."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from benchmarks.map.cells import SLIVERS, TITLES, Measured, faces_text, size_text
from benchmarks.map.marks import Verdict, on_map, verdicts

INCHES_A_PANEL, DOTS_PER_INCH = (7.4, 5.0), 110
SLOWER, EVEN, FASTER = "#c2410c", "#f5f5f4", "#0b5394"
"""Orange to white to blue, which all kinds of colour blindness tell apart."""
SMALL_COLOR = "#d6d3d1"
MAX = 4.0
"""The ratio, and its inverse, at which the colours end."""
NOTE = (
    "Large: how many times as long the faster of llvmpipe and tinydisplay takes, worst family of "
    "meshes; small: median family.\nOrange: slower than it. Grey: it takes under 1 ms; +: "
    "RasterJIT's overhead, ms a picture; together: the ratio of render_batch."
)


def missing() -> str | None:
    """Return why nothing can be drawn, or ``None``."""
    if find_spec("matplotlib") is None:
        return 'the package matplotlib is not installed (pip install ".[bench]")'
    return None


def draw(
    measured: Sequence[Measured],
    look: str,
    panels: Sequence[tuple[str, int, str]],
    machine: str,
    path: Path,
) -> Path:
    """
    Draw the map of a look and return its file.

    ``panels`` are titles, threads and instructions; two of them stand side by side.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import colors, pyplot

    across = min(len(panels), 2)
    down = math.ceil(len(panels) / across)
    figure, axes = pyplot.subplots(
        down, across, figsize=(INCHES_A_PANEL[0] * across, INCHES_A_PANEL[1] * down + 1.0),
        dpi=DOTS_PER_INCH, layout="constrained", squeeze=False,
    )  # fmt: skip
    hues = colors.LinearSegmentedColormap.from_list("ratio", [SLOWER, EVEN, FASTER])
    here = [
        each for each in measured if each.cell.look == look and each.cell.family != SLIVERS.family
    ]
    sizes = sorted({each.cell.size for each in here})
    counts = sorted({each.cell.faces for each in here})
    for place, (title, threads, instructions) in zip(axes.flat, panels, strict=False):
        found = verdicts(here, threads, instructions)
        draw_panel(place, hues, found, sizes, counts)
        place.set_title(title, fontsize=15, fontweight="bold")
    for place in list(axes.flat)[len(panels) :]:
        place.set_axis_off()
    figure.suptitle(f"{TITLES[look]}: RasterJIT against the faster peer; {machine}", fontsize=15)
    figure.supxlabel(NOTE, fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    pyplot.close(figure)
    return path


SUMMARY_NOTE = (
    "Speed-up over the faster of two CPU renderers, llvmpipe and tinydisplay, for the same image "
    "(above 1: RasterJIT is faster).\nLarge: median of nine scenes (three kinds of mesh, three "
    "materials), framed where RasterJIT is slower. Small: the worst scene.\nGrey: the other takes "
    "under 1 ms; the number is RasterJIT's fixed cost per call. Measured on "
)
SUMMARY_INCHES = (11.0, 4.9)


def draw_summary(
    measured: Sequence[Measured],
    panels: Sequence[tuple[str, int, str]],
    machine: str,
    path: Path,
) -> Path:
    """
    Draw all looks in one map and return its file.

    ``panels`` are titles, threads and instructions; all stand side by side.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import colors, pyplot

    figure, axes = pyplot.subplots(
        1, len(panels), figsize=SUMMARY_INCHES, dpi=DOTS_PER_INCH, layout="constrained",
        squeeze=False, sharey=True,
    )  # fmt: skip
    hues = colors.LinearSegmentedColormap.from_list("ratio", [SLOWER, EVEN, FASTER])
    here = [each for each in measured if each.cell.family != SLIVERS.family]
    sizes = sorted({each.cell.size for each in here})
    counts = sorted({each.cell.faces for each in here})
    for place, (title, threads, instructions) in zip(axes.flat, panels, strict=True):
        found = verdicts(here, threads, instructions)
        draw_panel(place, hues, found, sizes, counts, by_median=True)
        place.set_title(title, fontsize=13, fontweight="bold")
        place.tick_params(labelsize=9)
        place.set_xlabel("image size", fontsize=11)
    for place in axes.flat[1:]:
        place.set_ylabel("")
    figure.supxlabel(f"{SUMMARY_NOTE}{machine}.", fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    pyplot.close(figure)
    return path


def draw_panel(
    axes: Any,
    hues: Any,
    found: Sequence[Verdict],
    sizes: Sequence[tuple[int, int]],
    counts: Sequence[int],
    by_median: bool = False,
) -> None:
    """
    Draw a cell for each size, across, and number of faces, most on top.

    Colour and large number are the worst ratio, or the median one.
    """
    from matplotlib.patches import Rectangle

    for x, size in enumerate(sizes):
        for y, count in enumerate(counts):
            here = [e for e in found if e.cell.size == size and e.cell.faces == count]
            number, middle, color = describe(here, hues, by_median)
            is_slower = color is not None and number[:1].isdigit() and float(number) < 1.0
            axes.add_patch(
                Rectangle(
                    (x, y), 1, 1, facecolor=color or "white",
                    edgecolor="black" if is_slower else "white", linewidth=2.0,
                    zorder=2 if is_slower else 1,
                )
            )  # fmt: skip
            ink = "white" if color is not None and is_dark(color) else "black"
            weight = "bold" if number[:1].isdigit() else "normal"
            axes.text(x + 0.5, y + 0.58, number, ha="center", va="center", fontsize=17,
                      color=ink, fontweight=weight, zorder=3)  # fmt: skip
            axes.text(x + 0.5, y + 0.2, middle, ha="center", va="center", fontsize=10,
                      color=ink, zorder=3)  # fmt: skip
    axes.set(xlim=(0, len(sizes)), ylim=(0, len(counts)))
    axes.set_xticks([x + 0.5 for x in range(len(sizes))], map(size_text, sizes), fontsize=12)
    axes.set_yticks([y + 0.5 for y in range(len(counts))], map(faces_text, counts), fontsize=12)
    axes.set_ylabel("faces", fontsize=12)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)


def describe(here: Sequence[Verdict], hues: Any, by_median: bool = False) -> tuple[str, str, Any]:
    """Return a cell's number, the smaller one below it, and its colour, ``None`` without times."""
    judged = on_map(here)
    if judged:
        ratios = sorted(each.ratio for each in judged)
        numbers = ratios[0], statistics.median(ratios)
        first, second = numbers[::-1] if by_median else numbers
        share = 0.5 + 0.5 * math.log(first) / math.log(MAX)
        return two_digits(first), two_digits(second), hues(min(max(share, 0.0), 1.0))
    if here:
        from matplotlib import colors

        most = max(each.overhead_ms for each in here)
        together = [min(each.batch_ratios.values()) for each in here if each.batch_ratios]
        is_told = together and not by_median
        note = f"together {two_digits(min(together))}" if is_told else "ms"
        return f"+{most:.2f}", note, colors.to_rgba(SMALL_COLOR)
    return "", "", None


def two_digits(ratio: float) -> str:
    """Return a ratio as text; below 1 it is never rounded up to 1."""
    if ratio < 1.0:
        return f"{math.floor(100.0 * ratio) / 100.0:.2f}"
    return f"{ratio:.1f}" if ratio < 10.0 else f"{ratio:.0f}"


def is_dark(color: Any) -> bool:
    """Return whether white text is easier to read on a colour, RGBA from 0 to 1."""
    return 0.299 * color[0] + 0.587 * color[1] + 0.114 * color[2] < 0.55
