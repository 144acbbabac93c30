"""
Measure the peak memory of one render, in a process of its own.

``python -m benchmarks.memory SCENE`` prints JSON, bytes. The peak counts from before the mesh
exists, with everything imported and compiled, so the mesh's own arrays are part of it.
"""

from __future__ import annotations

import gc
import json
import resource
import subprocess
import sys
from pathlib import Path

from benchmarks.pairing import ROOT, package_environment
from benchmarks.scenes import SCENES, TriangleScene

STATUS = Path("/proc/self/status")
CLEAR_PEAK = Path("/proc/self/clear_refs")
RESET_PEAK = "5"
"""What the Linux manual (proc_pid_clear_refs) says to write to reset the peak."""

BOUND_PER_MESH_BYTE, BOUND_PER_PIXEL = 3, 64


def resident(field: str) -> int:
    """Return ``VmRSS`` (now) or ``VmHWM`` (peak) of this process, bytes."""
    if STATUS.exists():
        for line in STATUS.read_text().splitlines():
            if line.startswith(field):
                return int(line.split()[1]) * 1024
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def reset_peak() -> None:
    """Make the peak start again from what is in use now, where the system allows it."""
    try:
        CLEAR_PEAK.write_text(RESET_PEAK)
    except OSError:
        return


def main(scene_name: str) -> None:
    """Render and print the figures."""
    import numpy as np

    import rasterjit as rj

    scene = SCENES[scene_name]()
    if not isinstance(scene, TriangleScene):
        raise ValueError(f"{scene_name} has no triangles")
    camera = rj.MatrixCamera(np.eye(4), scene.clip_from_model)
    rj.render(rj.Mesh(np.eye(3), [[0, 1, 2]]), size=(64, 64))
    gc.collect()
    reset_peak()
    before = resident("VmRSS")
    mesh = rj.Mesh(scene.positions.astype(np.float64), scene.faces.copy())
    with_mesh = resident("VmRSS")
    frame = rj.render(mesh, camera, size=scene.size)
    peak = resident("VmHWM")
    mesh_bytes = mesh.vertices.nbytes + mesh.faces.nbytes
    pixels = scene.size[0] * scene.size[1]
    print(
        json.dumps(
            {
                "peak_over_before": peak - before,
                "peak_over_mesh": peak - with_mesh,
                "mesh": mesh_bytes,
                "frame": frame.color.nbytes,
                "bound": BOUND_PER_MESH_BYTE * mesh_bytes + BOUND_PER_PIXEL * pixels,
            }
        )
    )


def measure_memory(scene_name: str) -> dict[str, int]:
    """Return what ``main`` prints, from a fresh process."""
    result = subprocess.run(
        [sys.executable, "-m", "benchmarks.memory", scene_name],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
        env=package_environment({}),
    )
    return json.loads(result.stdout)


if __name__ == "__main__":
    main(*sys.argv[1:])
