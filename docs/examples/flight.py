"""
Fly a camera through a furnished room, along a spline, and write an MP4.

``python flight.py -o flight.mp4 --seconds 8``; needs ``pip install "rasterjit[video,animation]"``.
Before the first frame, a panorama of distances at each time checks that the eye keeps clear of
everything. ``--blur 4`` averages four moments of each frame's open shutter, in linear light.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

import rasterjit as rj
from rasterjit import animation
from rasterjit.io.images import save_image

Flight = Callable[[float], rj.PerspectiveCamera]
ROUTE = [(-3.1, 1.5, 2.1), (-1.5, 1.3, 1.3), (-0.2, 1.5, 0.9), (1.6, 1.3, 1.5), (3.0, 1.4, 0.2),
         (2.0, 1.7, -1.5), (0.1, 1.9, -1.7), (-2.2, 1.7, -1.5), (-3.2, 1.6, 0.3)]  # fmt: skip
"""Places that the camera flies through, metres; y is up."""
SHUTTER = 0.5
"""Share of a frame's time that the shutter is open."""


def pattern(kind: str, size: int = 256) -> rj.Texture:
    """Return what a metre of a surface looks like: planks, bricks or plaster."""
    random = np.random.default_rng(len(kind))
    y, x = np.mgrid[:size, :size] / size
    noise = random.random((size, size))
    if kind == "planks":
        row = np.floor(6 * y).astype(int)
        grain = 0.05 * np.sin(40 * y + 5 * np.sin(2 * np.pi * x) + 9 * row)
        gap = (6 * y % 1 < 0.03) | ((x + 0.37 * row) % 1 < 0.006)
        color, value = (
            (172, 122, 78),
            np.where(gap, 0.4, 0.85 + 0.2 * random.random(6)[row] + grain),
        )
    elif kind == "bricks":
        row = np.floor(12 * y).astype(int)
        column = np.floor(4 * x + 0.5 * row).astype(int) % 4
        gap = (12 * y % 1 < 0.1) | ((4 * x + 0.5 * row) % 1 < 0.04)
        tone = 0.85 + 0.3 * random.random((12, 4))[row, column]
        color, value = (168, 92, 72), np.where(gap, 1.3, tone + 0.06 * noise)
    else:
        color, value = (226, 219, 204), 0.96 + 0.04 * noise
    image = np.clip(value[..., None] * color, 0, 255).astype(np.uint8)
    return rj.Texture(image, anisotropy=8)


def add_panel(
    scene: rj.Scene, corner: Sequence[float], right: Sequence[float], up: Sequence[float],
    material: rj.Material,
) -> None:  # fmt: skip
    """Add a rectangle with texture coordinates in metres."""
    a, u, v = np.array(corner, float), np.array(right, float), np.array(up, float)
    w, h = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    uv = [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)]
    mesh = rj.Mesh([a, a + u, a + u + v, a + v], [(0, 1, 2), (0, 2, 3)], uv=uv, material=material)
    scene.add(mesh)


def add_box(
    scene: rj.Scene, low: Sequence[float], high: Sequence[float], material: rj.Material
) -> None:
    """Add a box that is seen from outside."""
    (x, y, z), (w, h, d) = low, np.subtract(high, low)
    add_panel(scene, (x, y, z + d), (w, 0, 0), (0, h, 0), material)
    add_panel(scene, (x + w, y, z), (-w, 0, 0), (0, h, 0), material)
    add_panel(scene, (x + w, y, z + d), (0, 0, -d), (0, h, 0), material)
    add_panel(scene, (x, y, z), (0, 0, d), (0, h, 0), material)
    add_panel(scene, (x, y + h, z + d), (w, 0, 0), (0, 0, -d), material)
    add_panel(scene, (x, y, z), (w, 0, 0), (0, 0, d), material)


def furnish(teapot: Path, knot: Path) -> rj.Scene:
    """Return a room of 8 by 5 metres, 2.8 high, with a table, a pedestal and a picture."""
    scene = rj.Scene()
    planks, bricks, plaster = (
        rj.Material("pbr", base_color_texture=pattern(kind), roughness=0.7)
        for kind in ("planks", "bricks", "plaster")
    )
    add_panel(scene, (-4, 0, 2.5), (8, 0, 0), (0, 0, -5), planks)
    add_panel(scene, (-4, 2.8, -2.5), (8, 0, 0), (0, 0, 5), plaster)
    add_panel(scene, (-4, 0, -2.5), (8, 0, 0), (0, 2.8, 0), bricks)
    add_panel(scene, (4, 0, 2.5), (-8, 0, 0), (0, 2.8, 0), plaster)
    add_panel(scene, (-4, 0, 2.5), (0, 0, -5), (0, 2.8, 0), plaster)
    add_panel(scene, (4, 0, -2.5), (0, 0, 5), (0, 2.8, 0), plaster)
    oak = rj.Material("pbr", "#7a5230", roughness=0.5)
    add_box(scene, (-0.9, 0.72, -0.6), (0.9, 0.78, 0.3), oak)
    for x in (-0.8, 0.72):
        for z in (-0.5, 0.12):
            add_box(scene, (x, 0, z), (x + 0.08, 0.72, z + 0.08), oak)
    add_box(scene, (2.5, 0, -2.2), (3.1, 0.9, -1.6), rj.Material("pbr", "#e6e6e6", roughness=0.6))
    for path, at, size, color in (
        (teapot, (0.0, 0.78, -0.15), 0.14, "#3d7ea6"),
        (knot, (2.8, 1.35, -1.9), 0.13, "#d9822b"),
    ):
        mesh = rj.load(path).nodes[0].mesh
        mesh.material = rj.Material("pbr", color, roughness=0.25)
        scene.add(mesh, rj.transforms.translate(at) @ rj.transforms.scale(size))
    lamp = rj.PointLight((0.4, 2.5, 0.6), color="#fff0d8", intensity=4.5, shadow=rj.Shadow(1024))
    scene.lights += [rj.AmbientLight(intensity=0.35), lamp]
    scene.ambient_occlusion = rj.AmbientOcclusion(radius=0.4)
    return scene


def spline_camera(route: Sequence[Sequence[float]], seconds: float) -> Flight:
    """Return a camera for each time: its eye on a spline, looking at where it soon will be."""
    points = np.array(route)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    keys = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    eye = CubicSpline(keys, points)

    def camera(time: float) -> rj.PerspectiveCamera:
        share = np.clip(time / seconds, 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)  # start and stop gently
        ahead = eye(share) + 0.5 * eye(share, 1) / np.linalg.norm(eye(share, 1))
        target = 0.6 * ahead + 0.4 * np.array([0.0, 0.9, -0.1])
        return rj.PerspectiveCamera(eye(share), target, fov_y=60.0, near=0.05)

    return camera


def clearance(scene: rj.Scene, camera: Flight, times: Sequence[float]) -> float:
    """Return how near the eye comes to a surface in any direction, metres."""
    nearest, lens = [], rj.Equirectangular()
    with rj.Renderer((64, 32)) as renderer:
        for time in times:
            frame = renderer.render(scene, camera(time), lens=lens, outputs="distance")
            nearest.append(float(frame.distance.min()))
    return min(nearest)


def blurred(frames: Iterator[rj.Frame], moments: int) -> Iterator[NDArray[np.uint8]]:
    """Yield the mean light of each few moments, as sRGB."""
    for first in frames:
        light = first.linear[..., :3].astype(float)
        for _ in range(moments - 1):
            light += next(frames).linear[..., :3]
        light = np.clip(light / moments, 0.0, 1.0)
        code = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        yield (255.0 * code + 0.5).astype(np.uint8)


def main(arguments: list[str] | None = None) -> None:
    """Check the route, write the film and a few stills of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("flight.mp4"))
    parser.add_argument("--stills", type=Path, default=Path("flight.png"))
    parser.add_argument("--models", type=Path, default=Path("models"))
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--fps", type=int, default=24)
    parser.add_argument("--size", type=int, nargs=2, default=(640, 360), metavar=("W", "H"))
    parser.add_argument("--samples", type=int, default=4, choices=(1, 2, 4, 8, 16))
    parser.add_argument("--blur", type=int, default=1, help="moments of each frame")
    chosen = parser.parse_args(arguments)
    scene = furnish(chosen.models / "teapot.obj", chosen.models / "torus_knot.obj")
    camera = spline_camera(ROUTE, chosen.seconds)
    times = np.arange(round(chosen.seconds * chosen.fps)) / chosen.fps
    near = clearance(scene, camera, times[:: max(1, len(times) // 100)])
    print(f"the eye keeps {near:.2f} m clear of everything")
    if near < 0.2:
        raise SystemExit("the route comes too near to a wall or to furniture")
    moments = times[:, None] + SHUTTER / chosen.fps * np.arange(chosen.blur) / chosen.blur
    quality = rj.Quality(samples=chosen.samples)
    with rj.Renderer(tuple(chosen.size), quality=quality) as renderer:
        frames = animation.frames(
            renderer, scene, moments.ravel().tolist(), camera=camera, outputs=("color", "linear")
        )
        pictures = list(blurred(frames, chosen.blur))
    animation.save(pictures, chosen.output, fps=chosen.fps)
    save_image(chosen.stills, np.hstack(pictures[len(pictures) // 8 :: max(1, len(pictures) // 4)]))
    print(f"{len(pictures)} frames, {len(pictures) / chosen.fps:.1f} s")


if __name__ == "__main__":
    main()
