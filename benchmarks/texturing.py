"""
Measure texture shading beside C: nanoseconds a pixel of both, in one process, by turns.

``python -m benchmarks.texturing [--side N] [--rounds N]``

A tilted plane fills the picture, one thread: RasterJIT's is of 2, 200 or 5,000 faces, that of
``texturing.c``, which gcc compiles for this machine, is a loop over pixels without faces, depth or
mip levels, in float32. Both read the same picture, repeated and not mipmapped, and encode sRGB.
RasterJIT's time is that of its shading, that of C of the whole. A row has the least of all rounds,
for whatever else the machine does only adds. Pictures must be alike before a time counts.
"""

from __future__ import annotations

import argparse
import ctypes
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rasterjit as rj
from benchmarks.report import machine
from rasterjit.pipeline.srgb_encoding import make_encoding_table

SOURCE = Path(__file__).with_name("texturing.c")
SIZE = (1280, 720)
CAMERA = rj.PerspectiveCamera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), fov_y=55.0)
HALF, TILT = (2.6, 1.9), 0.25
"""Half the plane's extent, and how far it rises away, for each unit up."""
FACES = (2, 200, 5000)
ZOOMS = {"texels of a pixel": 1.4, "magnified": 0.2}
"""Texels to a pixel, about, in the middle of the picture."""
ALIKE = 0.99
"""Share of pixels whose codes are at most 2 apart: places are float32 in C."""

Draw = Callable[[], tuple[NDArray[np.uint8], float]]
"""Draws a picture; returns its codes, (H, W, 3), and how many seconds shading took."""


def plane_matrix(zoom: float, side: int) -> NDArray[np.float64]:
    """Return the rows that give u, v, in texels and times w, and w, from a pixel's centre."""
    # Corners of the plane by u and v: x = u / scale, y = v / scale, z = TILT * y.
    scale = texels_of_unit(zoom) / side
    world = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, TILT, 0.0], [0.0, 0.0, 1.0]])
    clip = CAMERA.projection_matrix(SIZE) @ CAMERA.view_matrix() @ world
    width, height = SIZE
    to_pixels = np.array([[width / 2, 0.0, width / 2], [0.0, -height / 2, height / 2], [0, 0, 1]])
    pixels = to_pixels @ clip[[0, 1, 3]] @ np.diag([1.0 / scale, 1.0 / scale, 1.0])
    return np.diag([side, side, 1.0]) @ np.linalg.inv(pixels)


def texels_of_unit(zoom: float) -> float:
    """Return how many texels a unit of length shows."""
    height_in_view = 2.0 * 2.0 * np.tan(np.radians(55.0) / 2.0)
    return zoom * SIZE[1] / height_in_view


def mesh_of(faces: int, zoom: float, side: int, texture: rj.Texture) -> rj.Mesh:
    """Return the plane as a grid of squares, two triangles each."""
    cells = round((faces / 2) ** 0.5)
    x, y = np.meshgrid(*(np.linspace(-half, half, cells + 1) for half in HALF))
    vertices = np.stack([x, y, TILT * y], axis=-1).reshape(-1, 3)
    first = np.arange(cells * (cells + 1)).reshape(cells, cells + 1)[:, :-1].ravel()
    corners = first[:, np.newaxis] + [0, 1, cells + 2, 0, cells + 2, cells + 1]
    uv = vertices[:, :2] * texels_of_unit(zoom) / side
    material = rj.Material("unlit", base_color_texture=texture)
    return rj.Mesh(vertices, corners.reshape(-1, 3), uv=uv, material=material)


def by_rasterjit(mesh: rj.Mesh) -> Draw:
    """Draw with a kept renderer."""
    renderer = rj.Renderer(SIZE, threads=1)

    def draw() -> tuple[NDArray[np.uint8], float]:
        frame = renderer.render(mesh, CAMERA, background="black")
        seconds = sum(spent for name, spent in frame.stats.seconds.items() if "shade" in name)
        return frame.color[..., :3], seconds

    return draw


def by_c(library: Any, zoom: float, texture: rj.Texture) -> Draw:
    """Draw with the loop in C."""
    (side, _), is_smooth = texture.size, texture.filter != "nearest"
    plane = plane_matrix(zoom, side)
    plane[:2] -= (0.5 if is_smooth else 0.0) * plane[2]
    plane = np.ascontiguousarray(plane, np.float32)
    texels = np.ascontiguousarray(texture.image[::-1])
    pixels = np.empty(SIZE[::-1], np.uint32)
    table = make_encoding_table()

    def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
        return ctypes.c_void_p(array.ctypes.data)

    def draw() -> tuple[NDArray[np.uint8], float]:
        begun = time.perf_counter()
        library.fill(
            pointer(pixels), *SIZE, pointer(plane), pointer(texels), side, side, pointer(table),
            int(is_smooth),
        )  # fmt: skip
        return pixels.view(np.uint8).reshape(*pixels.shape, 4)[..., :3], time.perf_counter() - begun

    return draw


def compiled(folder: Path) -> Any:
    """Return the loop in C as a library; raise OSError or CalledProcessError without a compiler."""
    path = folder / "texturing.so"
    command = ["gcc", "-O3", "-march=native", "-shared", "-fPIC", "-o", str(path), str(SOURCE)]
    subprocess.run([*command, "-lm"], check=True)
    return ctypes.CDLL(str(path))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--side", type=int, default=1024)
    parser.add_argument("--rounds", type=int, default=15)
    options = parser.parse_args()
    print(machine())
    random = np.random.default_rng(0)
    picture = random.integers(0, 256, (options.side, options.side, 3), np.uint8)
    is_alike = True
    with tempfile.TemporaryDirectory() as folder:
        try:
            library = compiled(Path(folder))
        except (OSError, subprocess.CalledProcessError) as error:
            sys.exit(f"no C to compare with: {error}")
        print(f"{'':<36}{'C ns':>8}{'ns':>8}{'x C':>7}{'frame ns':>10}")
        for title, zoom in ZOOMS.items():
            for filter in ("bilinear", "nearest"):
                texture = rj.Texture(picture, filter=filter)
                draws = {0: by_c(library, zoom, texture)}
                for faces in FACES:
                    draws[faces] = by_rasterjit(mesh_of(faces, zoom, options.side, texture))
                is_alike &= measure(f"{title}, {filter}", draws, options.rounds)
    sys.exit(int(not is_alike))


def measure(title: str, draws: dict[int, Draw], rounds: int) -> bool:
    """Let all draw by turns and print their rows; tell whether pictures are alike."""
    least = dict.fromkeys(draws, np.inf)
    whole = dict.fromkeys(draws, np.inf)
    for draw in draws.values():
        draw()
    for _ in range(rounds):
        for faces, draw in draws.items():
            begun = time.perf_counter()
            least[faces] = min(least[faces], draw()[1])
            whole[faces] = min(whole[faces], time.perf_counter() - begun)
    wanted, is_alike = draws[0]()[0].astype(int), True
    each = 1e9 / (SIZE[0] * SIZE[1])
    for faces in FACES:
        share = (np.abs(draws[faces]()[0] - wanted).max(axis=2) <= 2).mean()
        is_alike &= bool(share >= ALIKE)
        row = f"{title}, {faces} faces"
        print(
            f"{row:<36}{least[0] * each:>8.2f}{least[faces] * each:>8.2f}"
            f"{least[faces] / least[0]:>7.2f}{whole[faces] * each:>10.2f}"
            f"{'' if share >= ALIKE else f'  OTHER PIXELS: {1.0 - share:.2%}'}"
        )
    return is_alike


if __name__ == "__main__":
    main()
