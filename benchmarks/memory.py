"""
Measure memory, each case in a process of its own that prints JSON, bytes.

``python -m benchmarks.memory frame SCENE`` renders one frame: its peak above what was in use with
the mesh already there. ``limited SCENE BYTES`` does so in an address space of so many bytes
(``RLIMIT_AS``: everything the process maps, its libraries too). ``frames FIRST LAST`` draws frame
after frame with one ``Renderer`` and says how much more is in use after the last than after the
first of the two counts. ``texture SIDE`` reads an RGB picture of so many columns and rows and draws
a square with it: what that takes at its peak, and what is kept.
"""

from __future__ import annotations

import gc
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.pairing import ROOT, WorkerError, package_environment
from benchmarks.scenes import TriangleScene, find_scene, small_images

STATUS = Path("/proc/self/status")
CLEAR_PEAK = Path("/proc/self/clear_refs")
RESET_PEAK = "5"
"""What the Linux manual (proc_pid_clear_refs) says to write to reset the peak."""

CASE_SECONDS = 600.0


def resident(field: str) -> int:
    """Return ``VmRSS`` (now), ``VmHWM`` (peak) or ``VmPeak`` (address space), bytes."""
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


def mesh_and_camera(scene: TriangleScene) -> tuple[Any, Any]:
    """Return a scene's mesh with its vertex colours, unlit, and its camera."""
    import rasterjit as rj

    colors = None if scene.colors is None else scene.colors / np.float32(255.0)
    material = rj.Material(shading="unlit", base_color="white")
    mesh = rj.Mesh(scene.positions, scene.faces, colors=colors, material=material)
    return mesh, rj.MatrixCamera(np.eye(4), scene.clip_from_model)


def frame(scene_name: str) -> dict[str, int]:
    """Render one frame of a scene whose kernels are compiled already."""
    import rasterjit as rj

    mesh, camera = mesh_and_camera(small_images(1))
    rj.render(mesh, camera, size=(64, 64))
    scene = find_scene(scene_name)
    if not isinstance(scene, TriangleScene):
        raise ValueError(f"{scene_name} has no triangles")
    mesh, camera = mesh_and_camera(scene)
    size, faces = scene.size, len(scene.faces)
    del scene
    gc.collect()
    reset_peak()
    before = resident("VmRSS")
    picture = rj.render(mesh, camera, size=size)
    arrays = (mesh.vertices, mesh.faces, mesh.vertex_colors)
    return {
        "above_mesh": resident("VmHWM") - before,
        "peak": resident("VmHWM"),
        "address_space": resident("VmPeak"),
        "mesh": sum(array.nbytes for array in arrays if array is not None),
        "faces": faces,
        "drawn": picture.stats.drawn,
    }


def limited(scene_name: str, limit: str) -> dict[str, int]:
    """Render one frame in an address space of ``limit`` bytes."""
    resource.setrlimit(resource.RLIMIT_AS, (int(limit), int(limit)))
    return frame(scene_name)


def frames(first: str, last: str) -> dict[str, int]:
    """Draw views of a small mesh, one after the other, with one renderer."""
    import rasterjit as rj

    scene = small_images()
    mesh, _ = mesh_and_camera(scene)
    views = scene.views if scene.views is not None else []
    used = []
    with rj.Renderer(scene.size) as renderer:
        for number in range(int(last)):
            camera = rj.MatrixCamera(np.eye(4), views[number % len(views)])
            renderer.render(mesh, camera, outputs=("color", "depth", "face_id"))
            if number + 1 in (int(first), int(last)):
                gc.collect()
                used.append(resident("VmRSS"))
    return {"first": used[0], "last": used[-1]}


def textured(texture: Any) -> Any:
    """Return a square with a texture, unlit."""
    import rasterjit as rj

    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    material = rj.Material(shading="unlit", base_color_texture=texture)
    vertices = np.column_stack([corners, np.zeros(4)])
    return rj.Mesh(vertices, [[0, 1, 2], [0, 2, 3]], uv=corners, material=material)


def texture(side: str) -> dict[str, int]:
    """Read a picture and draw a square with it, by kernels that are compiled already."""
    from PIL import Image

    import rasterjit as rj

    blocks = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    rj.render(textured(rj.Texture(blocks)), size=(64, 64))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "blocks.png")
        wide = Image.fromarray(blocks).resize((int(side), int(side)), Image.Resampling.NEAREST)
        wide.save(file, compress_level=1)
        del wide
        gc.collect()
        reset_peak()
        before = resident("VmRSS")
        mesh = textured(rj.Texture.from_file(file))
        rj.render(mesh, size=(64, 64))
        gc.collect()
        return {
            "peak": resident("VmHWM") - before,
            "kept": resident("VmRSS") - before,
            "texels": int(side) ** 2,
        }


CASES = {"frame": frame, "limited": limited, "frames": frames, "texture": texture}


def measure_memory(case: str, *arguments: str) -> dict[str, int]:
    """Return what a case prints, from a fresh process; raise `WorkerError` if it fails."""
    result = subprocess.run(
        [sys.executable, "-m", "benchmarks.memory", case, *arguments],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=package_environment({}),
        timeout=CASE_SECONDS,
    )
    if result.returncode != 0:
        raise WorkerError((result.stderr.strip().splitlines() or ["no message"])[-1])
    return json.loads(result.stdout)


if __name__ == "__main__":
    print(json.dumps(CASES[sys.argv[1]](*sys.argv[2:])))
