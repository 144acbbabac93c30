"""
Draw points, lines and a scalar field beside PyVista and Open3D, on one sheet to look at.

``python -m benchmarks.beside [SHEET.png]``

Rows are scenes, columns libraries; each draws in a process of its own, with one view, size and
background. A library that is not installed, or has no such thing, leaves its place empty and is
named. Below each picture of a peer stands the share of pixels that only one of it and RasterJIT
covers. Needs ``pip install pyvista open3d`` and, for Open3D, what ``contestants/open3d_.py`` says.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import rasterjit as rj
from benchmarks.meshes import torus

SIZE = 480, 360
EYE, TARGET, FOV_Y = (2.6, 1.9, 3.2), (0.0, 0.0, 0.0), 40.0
NEAR, FAR = 0.1, 100.0
POINT_SIZE, LINE_WIDTH = 5.0, 3.0
BAR = 36
"""Height of the line of text below each picture."""


class Shapes(NamedTuple):
    """What is drawn, world space."""

    points: NDArray[np.float64]
    """(N, 3)."""
    colors: NDArray[np.uint8]
    """(N, 3), sRGB."""
    path: NDArray[np.float64]
    """(M, 3), one strip."""
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    heat: NDArray[np.float64]
    """(V,)."""


def shapes() -> Shapes:
    """Return points of a torus, a path around it, and the torus with a value at each vertex."""
    vertices, faces = torus(200, 100)
    vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    vertices = vertices * (1.3 / np.abs(vertices).max())
    random = np.random.default_rng(24)
    points = vertices[random.permutation(len(vertices))[:6000]]
    span = points.max(axis=0) - points.min(axis=0)
    colors = (255.0 * (points - points.min(axis=0)) / span).astype(np.uint8)
    turn = np.linspace(0.0, 10.0 * np.pi, 600)
    path = np.stack([1.2 * np.cos(turn), turn / 15.0 - 1.0, 1.2 * np.sin(turn)], axis=1)
    heat = np.sin(4.0 * vertices[:, 0]) + vertices[:, 1]
    return Shapes(points, colors, path, vertices, faces, heat)


def rasterjit_draws(row: str, held: Shapes) -> NDArray[np.uint8]:
    """Return RasterJIT's picture, (H, W, 3) uint8."""
    scene = rj.Scene()
    if row == "points":
        scene.add(rj.Points(held.points, colors=held.colors, size=POINT_SIZE))
    elif row == "lines":
        scene.add(rj.Lines(held.path, width=LINE_WIDTH, material=unlit("black")))
    else:
        material = rj.Material("unlit")
        scene.add(rj.Mesh(held.vertices, held.faces, scalars=held.heat, material=material))
    camera = rj.PerspectiveCamera(eye=EYE, target=TARGET, fov_y=FOV_Y, near=NEAR, far=FAR)
    frame = rj.render(scene, camera, size=SIZE, quality=rj.Quality(samples=4))
    picture = frame.color[:, :, :3]
    if row == "scalar field":
        bar = np.asarray(Image.fromarray(frame.colorbar()).convert("RGB"))
        picture = picture.copy()
        high, wide = min(len(bar), len(picture)), bar.shape[1]
        picture[:high, -wide:] = bar[:high]
    return picture


def unlit(color: str) -> rj.Material:
    """Return a material of one colour."""
    return rj.Material("unlit", base_color=color)


def pyvista_draws(row: str, held: Shapes) -> NDArray[np.uint8]:
    """Return PyVista's picture."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=SIZE)
    plotter.set_background("white")
    if row == "points":
        cloud = pyvista.PolyData(held.points)
        plotter.add_mesh(
            cloud, scalars=held.colors, rgb=True, point_size=POINT_SIZE, lighting=False
        )
    elif row == "lines":
        line = pyvista.lines_from_points(held.path)
        plotter.add_mesh(line, color="black", line_width=LINE_WIDTH, lighting=False)
    else:
        rows = np.column_stack([np.full(len(held.faces), 3), held.faces])
        mesh = pyvista.PolyData(held.vertices, rows.ravel())
        mesh["heat"] = held.heat
        plotter.add_mesh(mesh, cmap="viridis", lighting=False, scalar_bar_args={"vertical": True})
    plotter.enable_anti_aliasing("msaa", multi_samples=4)
    plotter.camera.position, plotter.camera.focal_point = EYE, TARGET
    plotter.camera.up, plotter.camera.view_angle = (0.0, 1.0, 0.0), FOV_Y
    plotter.camera.clipping_range = NEAR, FAR
    return np.asarray(plotter.screenshot(return_img=True))


def open3d_draws(row: str, held: Shapes) -> NDArray[np.uint8]:
    """Return Open3D's picture; of a scalar field it knows no map."""
    import open3d

    renderer = open3d.visualization.rendering.OffscreenRenderer(*SIZE)
    renderer.scene.set_background([1.0, 1.0, 1.0, 1.0])
    renderer.scene.view.set_post_processing(False)
    material = open3d.visualization.rendering.MaterialRecord()
    if row == "points":
        shape = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(held.points))
        shape.colors = open3d.utility.Vector3dVector(held.colors / 255.0)
        material.shader, material.point_size = "defaultUnlit", POINT_SIZE
    else:
        numbers = np.arange(len(held.path))
        shape = open3d.geometry.LineSet(
            open3d.utility.Vector3dVector(held.path),
            open3d.utility.Vector2iVector(np.stack([numbers[:-1], numbers[1:]], axis=1)),
        )
        material.shader, material.line_width = "unlitLine", LINE_WIDTH
        material.base_color = [0.0, 0.0, 0.0, 1.0]
    renderer.scene.add_geometry("shape", shape, material)
    vertical = open3d.visualization.rendering.Camera.FovType.Vertical
    renderer.scene.camera.set_projection(FOV_Y, SIZE[0] / SIZE[1], NEAR, FAR, vertical)
    renderer.scene.camera.look_at(TARGET, EYE, (0.0, 1.0, 0.0))
    return np.asarray(renderer.render_to_image())


ROWS = "points", "lines", "scalar field"
LIBRARIES: dict[str, tuple[str, Callable[[str, Shapes], NDArray[np.uint8]]]] = {
    "RasterJIT": ("rasterjit", rasterjit_draws),
    "PyVista": ("pyvista", pyvista_draws),
    "Open3D": ("open3d", open3d_draws),
}


def refusal(library: str, row: str) -> str | None:
    """Return why a library draws no such picture here; None: it does."""
    package, _ = LIBRARIES[library]
    if find_spec(package) is None:
        return f"{package} is not installed"
    if library == "Open3D" and row == "scalar field":
        return "no colour maps off screen"
    return None


def draw(task: tuple[str, str]) -> Any:
    """Return a picture, or why there is none; in a process that draws nothing else."""
    library, row = task
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")
    os.environ.setdefault("LIBGL_ALWAYS_SOFTWARE", "true")
    try:
        return LIBRARIES[library][1](row, shapes())
    except ImportError as error:
        return f"{type(error).__name__}: {error}"


def only_one_covers(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Return the share of pixels that are white in one of two pictures alone."""
    return float(np.mean((one < 250).any(axis=2) != (other < 250).any(axis=2)))


def make_sheet() -> Image.Image:
    """Return the sheet."""
    width, height = SIZE
    sheet = Image.new("RGB", (width * len(LIBRARIES), (height + BAR) * len(ROWS)), "white")
    text, font = ImageDraw.Draw(sheet), ImageFont.load_default(16)
    context = multiprocessing.get_context("spawn")
    for y, row in enumerate(ROWS):
        own = None
        for x, library in enumerate(LIBRARIES):
            found = refusal(library, row)
            if found is None:
                with context.Pool(1) as process:
                    found = process.map(draw, [(library, row)])[0]
            said = f"{library}, {row}"
            if isinstance(found, str):
                said = f"{said}: {found}"
            else:
                sheet.paste(Image.fromarray(found), (x * width, y * (height + BAR)))
                if own is not None:
                    share = only_one_covers(own, found)
                    said = f"{said}: {share:.2%} of pixels covered by one alone"
                own = found if own is None else own
            print(said)
            text.text((x * width + 8, y * (height + BAR) + height + 6), said, "black", font)
    return sheet


def main(arguments: list[str]) -> None:
    """Write the sheet."""
    parser = argparse.ArgumentParser("python -m benchmarks.beside", description=__doc__)
    parser.add_argument("sheet", nargs="?", default="beside.png")
    make_sheet().save(parser.parse_args(arguments).sheet)


if __name__ == "__main__":
    main(sys.argv[1:])
