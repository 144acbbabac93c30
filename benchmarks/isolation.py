"""
Measure what having packages of others work in a process of its own costs.

``python -m benchmarks.isolation`` loads files that they read (LAZ, VTU, DAE), a 3MF file, which
RasterJIT reads itself, a GLB file packed by Draco, and 12 GLB files with pictures, which
``isolate="all"`` decodes there: with the process and without it, by turns. It starts the process a
few times. Seconds are of the processor, those of all processes together.
"""

from __future__ import annotations

import io
import json
import os
import statistics
import struct
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

import rasterjit as rj
from rasterjit.io.foreign import isolation

TURNS = 5
FILES = 12
"""Files with pictures."""
SIDE = 1024
"""Of each picture, pixels."""


def surface(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and triangles of a bent square."""
    rows, columns = np.indices((side, side)).reshape(2, -1)
    heights = np.random.default_rng(1).random(side * side)
    first = (side * np.arange(side - 1)[:, None] + np.arange(side - 1)).reshape(-1, 1)
    faces = first + np.array([0, 1, side + 1, 0, side + 1, side])
    return np.stack([columns, rows, heights], axis=1).astype(np.float64), faces.reshape(-1, 3)


def laz(path: Path, size: int) -> None:
    """Write points."""
    import laspy

    file = laspy.create(point_format=3, file_version="1.2")
    file.x, file.y, file.z = np.random.default_rng(1).random((3, int(size / 5.3))) * 100.0
    file.write(path)


def vtu(path: Path, size: int) -> None:
    """Write triangles."""
    import meshio

    points, faces = surface(int((size / 30) ** 0.5))
    meshio.Mesh(points, [("triangle", faces)]).write(path)


def exported(path: Path, size: int) -> None:
    """Write triangles as trimesh does."""
    import trimesh

    per_vertex = 20 if path.suffix == ".3mf" else 110
    points, faces = surface(int((size / per_vertex) ** 0.5))
    trimesh.Trimesh(points, faces, process=False).export(path)


def draco(path: Path, size: int) -> None:
    """Write triangles that Draco packs."""
    import DracoPy

    points, faces = surface(int((size / 3.6) ** 0.5))
    stream = DracoPy.encode(points.astype(np.float32), faces.astype(np.uint32))
    packed = {"bufferView": 0, "attributes": {"POSITION": 0}}
    primitive = {"attributes": {"POSITION": 0}, "indices": 1,
                 "extensions": {"KHR_draco_mesh_compression": packed}}  # fmt: skip
    header = {
        "asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"],
        "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}], "buffers": [{"byteLength": len(stream)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(stream)}],
        "accessors": [{"componentType": 5126, "type": "VEC3", "count": len(points)},
                      {"componentType": 5125, "type": "SCALAR", "count": faces.size}],
    }  # fmt: skip
    chunks = b"".join(
        struct.pack("<I4s", len(data) + -len(data) % 4, kind) + data + filler * (-len(data) % 4)
        for data, kind, filler in ((json.dumps(header).encode(), b"JSON", b" "),
                                   (stream, b"BIN\0", b"\0"))
    )  # fmt: skip
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def textured(path: Path, number: int) -> None:
    """Write a few triangles with a picture, PNG and JPEG by turns."""
    import trimesh
    from PIL import Image

    points, faces = surface(30)
    waves = np.sin(np.indices((SIDE, SIDE)) / (7.0 + number)) * 100.0 + 128.0
    pixels = np.dstack([*waves, waves[0]]).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG" if number % 2 else "PNG")
    visual = trimesh.visual.TextureVisuals(points[:, :2] / 29.0, image=Image.open(file))
    trimesh.Trimesh(points, faces, visual=visual, process=False).export(path)


WRITERS: dict[str, Callable[[Path, int], None]] = {
    "laz": laz, "vtu": vtu, "dae": exported, "3mf": exported, "glb": draco,
}  # fmt: skip


def processor() -> float:
    """Return the processor time of this process and those that it keeps, seconds."""
    spent = time.process_time()
    for one in isolation._ALL_READERS:
        said = Path(f"/proc/{one._process.pid}/stat").read_text().rpartition(")")[2].split()
        # Its own, in user and system mode, and that of its copies.
        spent += sum(map(int, said[11:15])) / os.sysconf("SC_CLK_TCK")
    return spent


def seconds_of(paths: Sequence[Path], isolate: Any) -> float:
    """Return the processor time that loading files takes."""
    start = processor()
    for path in paths:
        rj.load(path, isolate=isolate)
    return processor() - start


def compare(name: str, paths: Sequence[Path], isolate: Any) -> None:
    """Print what loading files takes with the process and without it."""
    size = sum(path.stat().st_size for path in paths)
    seconds_of(paths, isolate)
    turns = [[seconds_of(paths, how) for how in (isolate, False)] for _ in range(TURNS)]
    with_it, without = map(statistics.median, zip(*turns, strict=True))
    print(
        f"{name}, {size / 1e6:.1f} MB: {with_it:.3f} s with, {without:.3f} s without, ratio "
        f"{with_it / without:.2f}"
    )


@click.command()
@click.option("--megabytes", type=click.FloatRange(0.01), default=10.0, show_default=True)
def main(megabytes: float) -> None:
    """Print ratios of times with the process to times without it, and what starting it takes."""
    starts = []
    for _ in range(TURNS):
        start = time.perf_counter()
        reader = isolation._ReaderProcess()
        starts.append((time.perf_counter() - start, processor() - time.process_time()))
        reader.end()
    clock, spent = map(statistics.median, zip(*starts, strict=True))
    print(f"starting the process: {clock:.3f} s by the clock, {spent:.2f} s of the processor")
    with tempfile.TemporaryDirectory() as folder:
        for kind, write in WRITERS.items():
            path = Path(folder, f"a.{kind}")
            write(path, int(megabytes * 1e6))
            compare(kind, [path], True)
        paths = [Path(folder, f"{number}.glb") for number in range(FILES)]
        for number, path in enumerate(paths):
            textured(path, number)
        compare(f"{FILES} glb with pictures", paths, "all")


if __name__ == "__main__":
    main()
