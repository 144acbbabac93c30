"""
A fresh process that draws one plain scene by the package ``rasterjit`` of another folder.

``python -m benchmarks.effects_fresh FOLDER SCENE`` prints JSON: the seconds of its first picture,
which compiles or loads kernels; and the most memory that this and a second picture took above what
was in use with the scene already there, bytes.
"""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.compare_worker import use_package
from benchmarks.memory import reset_peak, resident
from benchmarks.pairing import ROOT, WorkerError
from benchmarks.public_api import drawer
from benchmarks.scenes import find_scene

FRESH_SECONDS = 300.0


def draw_twice(folder: str, scene: str) -> dict[str, Any]:
    """Draw a scene twice."""
    use_package(folder)
    draw = drawer(find_scene(scene), 1)
    gc.collect()
    reset_peak()
    before, started = resident("VmRSS"), time.perf_counter()
    draw()
    seconds = time.perf_counter() - started
    draw()
    return {"seconds": seconds, "peak": resident("VmHWM") - before}


def fresh(folder: Path, scene: str, environment: dict[str, str]) -> dict[str, Any]:
    """Return what such a process prints; raise `WorkerError` if it fails."""
    result = subprocess.run(
        [sys.executable, "-m", "benchmarks.effects_fresh", str(folder), scene],
        capture_output=True, text=True, cwd=ROOT, env=environment, timeout=FRESH_SECONDS,
    )  # fmt: skip
    if result.returncode != 0:
        raise WorkerError((result.stderr.strip().splitlines() or ["no message"])[-1])
    return json.loads(result.stdout.splitlines()[-1])


if __name__ == "__main__":
    print(json.dumps(draw_twice(*sys.argv[1:])))
