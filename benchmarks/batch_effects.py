"""
Measure what `render_batch` gains where scenes have effects: beside a loop of one `Renderer`.

``python -m benchmarks.batch_effects [--views N] [--sizes 64 128 256] [--rounds N] [--only NAME ...]
[--output FILE]``

Five thousand faces, or twice as many for glass, seen from N sides with one effect each, in one
thread. Both draw all views in turns, round by round; a row has the median time of a view, the
median of the rounds' ratios, and whether the views were drawn in groups. The pictures are compared
before a time counts. Half a minute.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import rasterjit as rj
from benchmarks.contestants.rasterjit_ import make_scene
from benchmarks.many import seconds_of
from benchmarks.pairing import paired_ratios
from benchmarks.report import machine
from benchmarks.scenes import find_scene
from rasterjit.rendering import batch

Effect = tuple[dict[str, Any], dict[str, Any]]
"""Fields of the scene, and of the quality."""

SUN = rj.DirectionalLight((-1.0, -2.0, -1.5))
EFFECTS: dict[str, Effect] = {
    "none": ({}, {}),
    "fog": ({"fog": rj.Fog((0.5, 0.5, 0.6), density=0.3)}, {}),
    "range": ({"lights": [rj.PointLight((3, 3, 3), range=20.0)]}, {}),
    "cone": ({"lights": [rj.SpotLight((3, 3, 3), (-1, -1, -1))]}, {}),
    "environment": ({"environment": rj.Environment.gradient(), "lights": []}, {}),
    "tone curve": ({"tone_map": rj.ToneMap()}, {}),
    "vignette": ({"vignette": rj.Vignette()}, {}),
    "alpha mask": ({}, {}),
    "2 samples": ({}, {"samples": 2}),
    "4 samples": ({}, {"samples": 4}),
    "16 samples": ({}, {"samples": 16}),
    "outline": ({"outline": rj.Outline()}, {}),
    "ambient occlusion": ({"ambient_occlusion": rj.AmbientOcclusion()}, {}),
    "glass": ({}, {}),
    "shadow": ({"lights": [replace(SUN, shadow=rj.Shadow(256))]}, {}),
}


def scene_with(name: str) -> rj.Scene:
    """Return the faces of ``benchmarks.batch``, lit, with an effect."""
    mesh = make_scene(find_scene("batch_64:8")).nodes[0].mesh
    material, made = rj.Material(base_color=(0.7, 0.6, 0.5)), rj.Scene()
    colors = None
    if name == "alpha mask":
        colors = np.random.default_rng(0).random((len(mesh.vertices), 4))
        material = replace(material, alpha_mode="mask")
    made.add(rj.Mesh(mesh.vertices, mesh.faces, colors=colors, material=material))
    if name == "glass":
        glass = replace(material, base_color=(0.5, 0.6, 0.9, 0.4), alpha_mode="blend")
        made.add(rj.Mesh(1.1 * mesh.vertices, mesh.faces, material=glass))
    made.lights = [SUN, rj.AmbientLight(intensity=0.2)]
    for field, value in EFFECTS[name][0].items():
        setattr(made, field, value)
    return made


def measure(name: str, side: int, views: int, rounds: int) -> dict[str, object]:
    """Time both ways to draw an effect; return a row."""
    scene, size = scene_with(name), (side, side)
    quality = replace(rj.Quality.standard(), **EFFECTS[name][1])
    angles = np.linspace(0.0, 360.0, views, endpoint=False).tolist()
    cameras = [rj.fit_camera(scene, rj.orbit_direction(angle, 20.0)) for angle in angles]
    renderer = rj.Renderer(size, quality=quality, threads=1)

    def in_batch() -> Any:
        return rj.render_batch(scene, cameras, size=size, quality=quality, threads=1)

    def one_by_one() -> list[rj.Frame]:
        return [renderer.render(scene, camera) for camera in cameras]

    alone = counted(in_batch)
    if not np.array_equal(in_batch().color, [frame.color for frame in one_by_one()]):
        raise SystemExit(f"{name}: pictures differ")
    seconds: dict[Callable[[], Any], list[float]] = {in_batch: [], one_by_one: []}
    for number in range(rounds):
        for way in (in_batch, one_by_one) if number % 2 else (one_by_one, in_batch):
            seconds[way].append(seconds_of(way))
    return {
        "name": name,
        "batch": 1e3 * statistics.median(seconds[in_batch]) / views,
        "renderer": 1e3 * statistics.median(seconds[one_by_one]) / views,
        "ratio": statistics.median(paired_ratios(seconds[one_by_one], seconds[in_batch])),
        "in groups": alone == 0,
    }


def counted(draw: Callable[[], Any]) -> int:
    """Draw a batch, and return how many of its views were drawn one by one."""
    numbers, call = [], batch.SingleViewDrawer.__call__

    def noted(self: Any, group: Any) -> Any:
        numbers.extend(group)
        return call(self, group)

    batch.SingleViewDrawer.__call__ = noted
    try:
        draw()
    finally:
        batch.SingleViewDrawer.__call__ = call
    return len(numbers)


def main() -> None:
    """Measure, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument("--views", type=int, default=48)
    parser.add_argument("--sizes", type=int, nargs="+", default=(64, 128))
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--only", nargs="+", choices=EFFECTS, default=tuple(EFFECTS))
    parser.add_argument("--output", type=Path, help="a JSON file")
    arguments = parser.parse_args()
    found: dict[int, list[dict[str, object]]] = {}
    for side in arguments.sizes:
        print(f"{arguments.views} views of {side} x {side}, one thread", flush=True)
        for name in arguments.only:
            row = measure(name, side, arguments.views, arguments.rounds)
            found.setdefault(side, []).append(row)
            how = "in groups" if row["in groups"] else "one by one"
            print(
                f"  {name:<18}{row['batch']:7.3f} ms a view, Renderer {row['renderer']:7.3f} ms: "
                f"{row['ratio']:5.2f} x, {how}",
                flush=True,
            )
    if arguments.output is not None:
        content = {"machine": machine(), "views": arguments.views, "found": found}
        arguments.output.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
