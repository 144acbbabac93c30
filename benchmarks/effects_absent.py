"""What effects cost a scene that has none: this engine beside one from before there were any."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.checkouts import RevisionError, checkouts
from benchmarks.compare import Tree, time_scene
from benchmarks.effects_fresh import fresh
from benchmarks.judging import Comparison
from benchmarks.pairing import Effort, WorkerError

BASELINE = "c3e18ef"
"""The last commit without effects: their code is physically absent from its kernels."""

PLAIN = {
    "mesh_70k": "70 k faces, vertex colours",
    "mesh_70k_phong": "70 k faces, Phong",
    "fill_back_to_front": "20 quads, 1920x1080",
}
"""Plain scenes, and what the table calls them."""
QUICK_PLAIN = ("mesh_70k_phong",)

EFFORT, QUICK_EFFORT = Effort(31, 20.0), Effort(5, 3.0)
LIMIT = 1.05
"""Times as long as without the effects' code that a plain scene may take."""
MEBI = float(1 << 20)


class HistoryAbsentError(RuntimeError):
    """The baseline cannot be checked out here."""


def measure_absent(threads: Sequence[int], is_quick: bool) -> list[Comparison]:
    """
    Compare plain scenes on the baseline and on the working tree, in turns.

    Raises
    ------
    HistoryAbsentError
        If there is no git history with the baseline in it.
    """
    effort = QUICK_EFFORT if is_quick else EFFORT
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            with checkouts((BASELINE, "."), folder) as versions:
                trees = [
                    Tree(label, place, folder / f"cache-{number}")
                    for number, (label, place) in enumerate(versions)
                ]
                rows = []
                for scene in QUICK_PLAIN if is_quick else PLAIN:
                    rows += compare_fresh(trees, scene)
                    for count in threads:
                        rows += compare_times(trees, scene, count, effort)
                return rows
        except (RevisionError, FileNotFoundError) as error:
            raise HistoryAbsentError(f"no git history with {BASELINE}: {error}") from error


def compare_times(
    trees: Sequence[Tree], scene: str, threads: int, effort: Effort
) -> list[Comparison]:
    """Time both, and the baseline against itself: what is noise here."""
    row = time_scene(trees, scene, threads, LIMIT, effort)
    noise = time_scene((trees[0], trees[0]), scene, threads, LIMIT, effort)
    named = f"{PLAIN[scene]}, {threads} thread{'s' if threads > 1 else ''}"
    row.what, noise.what = f"{named}, ms", f"{named}: the baseline twice, ms"
    return [row, noise]


def compare_fresh(trees: Sequence[Tree], scene: str) -> list[Comparison]:
    """Compare what a fresh process compiles, how long that takes, and memory once it has."""
    title, cache = PLAIN[scene], f"fresh-{scene}"
    try:
        compiling = [fresh(tree.folder, scene, tree.environment(cache)) for tree in trees]
        loading = [fresh(tree.folder, scene, tree.environment(cache)) for tree in trees]
    except WorkerError as error:
        return [Comparison(f"{title}: a fresh process", note=f"failed: {error}")]
    seconds = [each["seconds"] for each in compiling]
    peaks = [each["peak"] / MEBI for each in loading]
    return [
        two_figures(f"{title}: compiling in a fresh process, s", *seconds),
        two_figures(f"{title}: peak memory of a frame, MiB", *peaks),
    ]


def two_figures(what: str, before: float, after: float) -> Comparison:
    """Return the row of a figure that was taken once of each."""
    return Comparison(what, before, after, after / before if before else None)
