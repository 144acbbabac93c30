"""
Time worlds of PyBullet drawn by TinyRenderer and by ``rasterjit.compat.pybullet``, in one run.

``python -m benchmarks.pybullet_beside``, with what the extra ``bench`` brings. Each world is a
model on a plane; a step of the simulation lies between pictures, and is not timed. Processor time
of all threads, by turns; a ratio is the median of the rounds' ratios. `tests/compat` compares the
pictures, `benchmarks.programs_beside` those of public programs.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

from benchmarks.pairing import paired_ratios

MODELS = {
    "kuka_iiwa": ("kuka_iiwa/model.urdf", 1.0), "franka_panda": ("franka_panda/panda.urdf", 1.0),
    "racecar": ("racecar/racecar.urdf", 2.0), "r2d2": ("r2d2.urdf", 1.0),
    "humanoid": ("humanoid/humanoid.urdf", 0.25),
}  # fmt: skip
"""Files of models, and what they are scaled by."""

SIZES = (84, 84), (320, 240)

FRAMES = 10
"""Of a round."""

WARM_FRAMES = 5


def measure(draw: Callable[[], Any]) -> float:
    """Return the processor time of a picture, milliseconds."""
    import pybullet

    taken = 0.0
    for _ in range(FRAMES):
        pybullet.stepSimulation()
        started = time.process_time()
        draw()
        taken += time.process_time() - started
    return 1e3 * taken / FRAMES


def compare(model: str, size: tuple[int, int], rounds: int) -> tuple[float, float]:
    """Return how many times as long TinyRenderer takes, and our milliseconds a picture."""
    import pybullet
    import pybullet_data

    from rasterjit.compat.pybullet import getCameraImage

    pybullet.connect(pybullet.DIRECT)
    pybullet.setAdditionalSearchPath(pybullet_data.getDataPath())
    pybullet.setGravity(0, 0, -1)
    path, scale = MODELS[model]
    pybullet.loadURDF("plane.urdf")
    pybullet.loadURDF(path, [0, 0, 0.5], globalScaling=scale)
    camera = (
        pybullet.computeViewMatrix([1.5, -1.5, 1.5], [0, 0, 0.5], [0, 0, 1]),
        pybullet.computeProjectionMatrixFOV(60, size[0] / size[1], 0.1, 20),
    )
    contestants = [
        lambda function=function: function(*size, *camera)
        for function in (pybullet.getCameraImage, getCameraImage)
    ]
    for draw in contestants * WARM_FRAMES:
        pybullet.stepSimulation()
        draw()
    theirs, ours = [], []
    for turn in range(rounds):
        for one in (0, 1) if turn % 2 else (1, 0):
            (theirs, ours)[one].append(measure(contestants[one]))
    pybullet.disconnect()
    return statistics.median(paired_ratios(theirs, ours)), statistics.median(ours)


def main(given: Sequence[str] | None = None) -> int:
    """Print the table of ``docs/coming_from/pybullet.md``."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.pybullet_beside", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--rounds", type=int, default=9)
    asked = parser.parse_args(given)
    warnings.simplefilter("ignore")
    print("| | " + " | ".join(f"{w}x{h}" for w, h in SIZES) + " | ms here |\n" + "|---" * 4 + "|")
    for model in MODELS:
        found = [compare(model, size, asked.rounds) for size in SIZES]
        times = " and ".join(f"{own:.1f}" for _, own in found)
        row = " | ".join(f"{ratio:.1f}" for ratio, _ in found)
        print(f"| `{model}` | {row} | {times} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
