"""
Draw up the table against peers: what they have and have not, each cell checked by running it.

``python -m benchmarks.peers_table --python pyvista=ENV/bin/python --python f3d=...``

Each cell is a process of its own, in the environment that ``--python`` names for a peer (may be
repeated; without it, this one), with no display: ``check.py`` runs the function that a peer's file
has for the row. What the table calls "no GL or Vulkan library" is tried with those of the system
replaced by empty files; windows open under ``xvfb-run``. A row says what is done: what is not
built in counts as ``–``, also where one could build it. Prints the table in Markdown, a line with
what all have, then each cell without an answer and its reason; ``--results`` writes all that was
found. About 8 minutes.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

import rasterjit as rj
from benchmarks import report
from benchmarks.pairing import ROOT
from benchmarks.peers_table import shapes

PROGRAMS = Path(__file__).parent
PEERS = {
    "rasterjit": "RasterJIT", "pyrender": "pyrender", "pyvista": "PyVista", "trimesh": "trimesh",
    "open3d": "Open3D", "moderngl": "moderngl", "f3d": "F3D",
}  # fmt: skip
ROWS = {
    "headless": "Renders without a display",
    "alone": "Works without OpenGL and Vulkan libraries",
    "threads": "Same bits in repeated runs, 1 and 2 threads",
    "depth": "Relative depth error at 988 units (near plane 0.1)",
    "face_id": "Face IDs",
    "masks": "Object masks",
    "normals": "Normals as floats",
    "motion": "Motion vectors",
    "lens": "Lens distortion",
    "antialiasing": "Anti-aliasing",
    "shadows": "Shadows",
    "transparency": "Order-independent transparency",
    "metallic": "glTF metallic-roughness materials",
    "animation": "glTF skinned animation",
    "points": "Point clouds",
    "window": "Interactive window",
    "gpu": "Uses a GPU",
    "rays": "Ray casting",
    "megabytes": "Installed with dependencies, MB",
    "first": "Process start to first image, s",
}
"""Keys of the rows, and their names in the table."""
HIDDEN = (
    "libGL.so.1", "libEGL.so.1", "libGLX.so.0", "libOpenGL.so.0", "libGLdispatch.so.0",
    "libGLESv2.so.2", "libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so", "libvulkan.so.1",
    "libEGL.so", "libGL.so", "libEGL_mesa.so.0", "libGLX_mesa.so.0", "libgbm.so.1",
)  # fmt: skip
UNSET = (
    "DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR", "PYTHONPATH", "PYTHONDONTWRITEBYTECODE",
)  # fmt: skip
"""Variables that checks do not get. A clone without bytecode would be compiled by each of them."""

THREADS = (
    {"LP_NUM_THREADS": "0", "PEER_THREADS": "1"},
    {"LP_NUM_THREADS": "2", "PEER_THREADS": "2"},
    {"LP_NUM_THREADS": "2", "PEER_THREADS": "2"},
)
TIMED = 7
YES, NO, UNKNOWN = "✓", "–", "?"


def make_files(folder: Path) -> None:
    """Write what is drawn."""
    shutil.copy(ROOT / "models" / "teapot.obj", folder)
    shutil.copy(ROOT / "models" / "figure.glb", folder)
    teapot = rj.load(folder / "teapot.obj").nodes[0].mesh
    normals = teapot.normals if teapot.normals is not None else np.zeros_like(teapot.vertices)
    np.savez(folder / "teapot.npz", vertices=teapot.vertices, normals=normals, faces=teapot.faces)
    knot = rj.load(ROOT / "models" / "torus_knot.obj").nodes[0].mesh
    for name, metallic in (("metal", 1.0), ("plastic", 0.0)):
        look = rj.Material("pbr", "#e0a040", metallic=metallic, roughness=0.3)
        mesh = rj.Mesh(knot.vertices, knot.faces, normals=knot.normals, material=look)
        scene = rj.Scene()
        scene.add(mesh, rj.transforms.translate((0, 0, -7)))
        scene.save(folder / f"{name}.glb")
    panes = [
        rj.Mesh(
            shapes.turned(angle), shapes.QUAD,
            material=rj.Material("pbr", color, alpha_mode="blend", double_sided=True),
        )
        for angle, color in ((30, (1, 0, 0, 0.5)), (-30, (0, 0, 1, 0.5)))
    ]  # fmt: skip
    for name, order in (("ab", panes), ("ba", panes[::-1])):
        scene = rj.Scene()
        for mesh in order:
            scene.add(mesh)
        scene.save(folder / f"panes_{name}.glb")
    random = np.random.default_rng(1)
    points = random.uniform((-2, -1.5, -5), (2, 1.5, -4), (4000, 3))
    np.save(folder / "points.npy", points)
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in points)
    (folder / "points.ply").write_text(head + rows)
    hidden = folder / "hidden"
    hidden.mkdir()
    for name in HIDDEN:
        (hidden / name).touch()


def ask(
    python: str, peer: str, row: str, folder: Path, more: dict[str, str] | None = None,
    with_display: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Run one check; return ``value`` or ``reason``, and ``seconds`` from start to answer."""
    environment = {name: value for name, value in os.environ.items() if name not in UNSET}
    environment |= {"LIBGL_ALWAYS_SOFTWARE": "true", **(more or {})}
    if peer == "rasterjit":
        environment["PYTHONPATH"] = str(ROOT)
    line = [python, str(PROGRAMS / "check.py"), f"{peer}_", row, str(folder)]
    if with_display:
        line = ["xvfb-run", "-a", *line]
    started = time.perf_counter()
    try:
        done = subprocess.run(
            line, env=environment, capture_output=True, text=True, timeout=200, check=False
        )
    except subprocess.TimeoutExpired:
        return {"reason": "no answer in 200 s"}
    seconds = time.perf_counter() - started
    for text in reversed(done.stdout.splitlines()):
        if text.startswith("{"):
            found: dict[str, Any] = json.loads(text)
            return found | {"seconds": seconds}
    said = (done.stderr.strip().splitlines() or ["nothing said"])[-1]
    return {"reason": f"ended with status {done.returncode}: {said[:300]}"}


def pictures(python: str, peer: str, folder: Path, with_display: bool) -> dict[str, Any]:
    """Return the rows that follow from pictures of the teapot."""
    draws = [ask(python, peer, "picture", folder, more, with_display) for more in THREADS]
    hashes = {each.get("value", {}).get("hash") for each in draws}
    first = draws[0]
    if None in hashes:
        return {row: {"reason": first.get("reason")} for row in ("threads", "gpu")}
    return {
        "threads": {"value": len(hashes) == 1},
        "gpu": {"value": bool(first["value"]["libraries"]), "of": first["value"]["libraries"]},
    }


def check_peer(python: str, peer: str, folder: Path, rows: Sequence[str]) -> dict[str, Any]:
    """Return what was found of a peer, row by row."""
    headless = ask(python, peer, "picture", folder)
    with_display = "value" not in headless
    found: dict[str, Any] = {"headless": {**headless, "value": not with_display}}
    alone = ask(python, peer, "picture", folder, {"LD_LIBRARY_PATH": str(folder / "hidden")})
    found["alone"] = {**alone, "value": "value" in alone}
    if {"threads", "gpu"} & set(rows):
        found |= pictures(python, peer, folder, with_display)
    for row in rows:
        if row not in found and row != "first":
            needs_display = row == "window" or with_display
            found[row] = ask(python, peer, row, folder, None, needs_display)
            click.echo(f"{peer} {row}: {found[row]}"[:200], err=True)
    return found


def time_pictures(pythons: dict[str, str], found: dict[str, Any], folder: Path) -> None:
    """Add the least seconds from starting Python to a picture; the peers take turns."""
    times: dict[str, list[float]] = {peer: [] for peer in pythons}
    for _ in range(TIMED):
        for peer, python in pythons.items():
            with_display = not found[peer]["headless"]["value"]
            one = ask(python, peer, "picture", folder, None, with_display)
            if "value" in one:
                times[peer].append(one["seconds"])
    for peer, seconds in times.items():
        found[peer]["first"] = (
            {"value": min(seconds), "all": seconds} if seconds else {"reason": "no picture"}
        )


def cell(row: str, found: dict[str, Any]) -> str:
    """Return what the table has of a check."""
    value = found.get("value")
    if value is None:
        return UNKNOWN
    if row == "depth" and not isinstance(value, bool):
        return f"{value:.0e}".replace("e-0", "e-")
    if row == "megabytes":
        return f"{value['bytes'] / 1e6:.0f}"
    if row == "first":
        return f"{value:.1f}"
    if isinstance(value, str):
        return value
    return YES if value else NO


def had_by_all(results: dict[str, dict[str, Any]], rows: Sequence[str]) -> list[str]:
    """Return the rows that every peer has."""
    return [
        row for row in rows
        if all(cell(row, found.get(row, {})) == YES for found in results.values())
    ]  # fmt: skip


def table(results: dict[str, dict[str, Any]], rows: Sequence[str]) -> str:
    """Return the table in Markdown, of the rows that tell peers apart, and what all have."""
    shared = had_by_all(results, rows)
    heads = [f"{PEERS[peer]} {version(found)}".strip() for peer, found in results.items()]
    lines = [["", *heads], ["---", *["---"] * len(heads)]]
    for row in rows:
        cells = [cell(row, found.get(row, {})) for found in results.values()]
        if row in ROWS and row not in shared:
            lines.append([ROWS[row], *cells])
    text = "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
    names = [ROWS[row][0].lower() + ROWS[row][1:] for row in shared if row in ROWS]
    return text + (f"\nAll have: {'; '.join(names)}.\n" if names else "")


def version(found: dict[str, Any]) -> str:
    """Return a peer's version."""
    value = found.get("megabytes", {}).get("value") or {}
    return str(value.get("version", ""))


@click.command()
@click.option("--python", "given", multiple=True, metavar="PEER=PATH", help="A peer's Python.")
@click.option("--peer", "chosen", multiple=True, type=click.Choice(list(PEERS)), help="Only these.")
@click.option("--row", "rows", multiple=True, type=click.Choice(list(ROWS)), help="Only these.")
@click.option(
    "--results", default=report.RESULTS / "peers_table.json", show_default=False,
    type=click.Path(dir_okay=False, path_type=Path),
    help="All that was found; other peers and rows in it are kept.",
)  # fmt: skip
def main(
    given: tuple[str, ...], chosen: tuple[str, ...], rows: tuple[str, ...], results: Path
) -> None:
    """Check every cell and print the table."""
    pythons = dict.fromkeys(PEERS, sys.executable)
    for each in given:
        peer, separator, path = each.partition("=")
        if peer not in PEERS or not separator or not Path(path).is_file():
            raise click.BadParameter(
                f"{each!r} is not PEER=PATH of a Python, such as f3d=env/bin/python"
            )
        pythons[peer] = path
    found: dict[str, Any] = json.loads(results.read_text()) if results.exists() else {}
    with tempfile.TemporaryDirectory() as place:
        make_files(Path(place))
        for peer in chosen or PEERS:
            new = check_peer(pythons[peer], peer, Path(place), rows or list(ROWS))
            found[peer] = found.get(peer, {}) | new
            report.write_text(results, json.dumps(found, indent=1) + "\n")
        if "first" in (rows or ROWS):
            time_pictures({peer: pythons[peer] for peer in chosen or PEERS}, found, Path(place))
            report.write_text(results, json.dumps(found, indent=1) + "\n")
    ordered = {peer: found[peer] for peer in PEERS if peer in found}
    click.echo(table(ordered, list(ROWS)))
    for peer, cells in ordered.items():
        for row, one in cells.items():
            if row in ROWS and one.get("value") is None:
                click.echo(f"{peer}, {row}: {one.get('reason')}")


if __name__ == "__main__":
    main()
