"""
Draw a figure of a scalar field on a surface with Matplotlib, as PNG and PDF.

``python figure.py -o figure.png figure.pdf``; needs ``pip install "rasterjit[mpl]"``. The field is
a vibration of a sphere; both pictures and the colour bar share one scale.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import rasterjit as rj
from rasterjit.mpl import SceneArtist

COLORMAP = mpl.colormaps["coolwarm"]
LEVELS = np.linspace(-0.8, 0.8, 9)


def vibration(unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the displacement of points of the unit sphere, (N, 3), in -1..1: a real harmonic."""
    x, y, z = unit.T
    return 1.5 * np.sqrt(3.0) * (x * x - y * y) * z


def sphere(rows: int = 96) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a sphere of radius 1 whose vertices lie in rows of latitude, with its faces."""
    polar, turn = np.meshgrid(
        np.linspace(0.0, np.pi, rows + 1),
        np.linspace(0.0, 2.0 * np.pi, 2 * rows + 1),
        indexing="ij",
    )
    unit = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], -1)
    number = np.arange(unit[..., 0].size).reshape(polar.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    quads = np.stack([a, b, c, a, c, d], -1)
    return unit.reshape(-1, 3), quads.reshape(-1, 3)


def surface(contours: bool) -> rj.Mesh:
    """Return the sphere, moved out by a quarter of the field, which is its colour, too."""
    unit, faces = sphere()
    field = vibration(unit)
    return rj.Mesh(
        unit * (1.0 + 0.25 * field[:, None]), faces, scalars=field, colormap=COLORMAP,
        range=(-1.0, 1.0), contours=rj.Contours(LEVELS, width=1.2) if contours else None,
    )  # fmt: skip


def draw() -> tuple[Figure, SceneArtist]:
    """Return the figure, and its picture with contours."""
    figure = plt.figure(figsize=(9.0, 3.4), layout="constrained")
    spatial, flat, section = (
        figure.add_subplot(1, 3, 1, projection="3d"), figure.add_subplot(1, 3, 2),
        figure.add_subplot(1, 3, 3),
    )  # fmt: skip
    SceneArtist(spatial, surface(contours=False))
    spatial.set(title="in 3-D axes", xlabel="x", ylabel="y", zlabel="z", box_aspect=(1, 1, 1))
    scene = rj.Scene()
    scene.add(surface(contours=True))
    scene.lights = [
        rj.AmbientLight(intensity=0.5),
        rj.DirectionalLight((-1, 1, -2), intensity=0.55),
    ]
    direction = rj.orbit_direction(35.0, 30.0, up=(0, 0, 1))
    camera = rj.fit_camera(scene, direction, 30.0, up=(0, 0, 1), aspect=1.0)
    artist = SceneArtist(flat, scene, camera)
    flat.set(title="contours every 0.2", box_aspect=1.0)
    flat.set_axis_off()
    artist.colorbar("displacement", ax=[spatial, flat], location="bottom", shrink=0.5, aspect=30)
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    for latitude, color in ((15, "#999999"), (35, "#222222")):
        sine, cosine = np.sin(np.radians(latitude)), np.cos(np.radians(latitude))
        ring = np.stack([cosine * np.cos(angle), cosine * np.sin(angle), 0.0 * angle + sine], 1)
        section.plot(np.degrees(angle), vibration(ring), color=color, label=f"latitude {latitude}°")
    section.set(title="along two parallels", xlabel="longitude, degrees", ylim=(-1.1, 1.7))
    section.set_xticks([0, 90, 180, 270, 360])
    section.grid(alpha=0.3)
    section.legend(frameon=False, loc="upper center", fontsize="small")
    return figure, artist


def main(arguments: list[str] | None = None) -> None:
    """Write the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    files = [Path("figure.png"), Path("figure.pdf")]
    parser.add_argument("-o", "--output", type=Path, nargs="+", default=files)
    parser.add_argument("--dpi", type=int, default=150)
    chosen = parser.parse_args(arguments)
    mpl.use("agg")
    figure, _ = draw()
    for path in chosen.output:
        figure.savefig(path, dpi=chosen.dpi)
        print(f"wrote {path}")
    plt.close(figure)


if __name__ == "__main__":
    main()
