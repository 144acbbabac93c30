"""Draw the curves, one PNG for each figure."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from benchmarks.curves import Curve

INCHES, DOTS_PER_INCH = (7.0, 4.5), 120


def missing() -> str | None:
    """Return why nothing can be plotted, or ``None``."""
    if find_spec("matplotlib") is None:
        return 'the package matplotlib is not installed (pip install ".[bench]")'
    return None


def plot(name: str, title: str, curves: Sequence[Curve], folder: Path) -> Path:
    """Draw the curves of one figure over each other, both axes logarithmic; return the file."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=INCHES, dpi=DOTS_PER_INCH, layout="constrained")
    for curve in curves:
        if curve.x:
            slope = "" if curve.exponent is None else f", exponent {curve.exponent:.2f}"
            axes.loglog(curve.x, curve.ms, marker="o", label=f"{curve.contestant}{slope}")
    axes.set_title(title)
    axes.set_xlabel(curves[0].axis)
    axes.set_ylabel("ms, read back")
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    figure.savefig(path)
    pyplot.close(figure)
    return path
