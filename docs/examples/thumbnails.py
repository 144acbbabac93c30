"""
Draw a thumbnail of every mesh below a folder, and one sheet of them all.

``python thumbnails.py FOLDER -o thumbnails``. A file that cannot be read stops nothing: its
cell of the sheet says why, and the exit status is 1 in the end.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import rasterjit as rj
from rasterjit.io.images import save_image

SUFFIXES = {".obj", ".ply", ".stl", ".off", ".glb", ".gltf", ".3mf", ".dae"}
CAPTION = 34
"""Height of the words under a thumbnail, pixels."""


class Thumbnail(NamedTuple):
    """One file: its picture, and how many faces it has, or no picture, and why."""

    name: str
    picture: np.ndarray | None
    words: str


def light(scene: rj.Scene) -> None:
    """Give scenes without lights of their own a key light and a sky."""
    if not scene.lights and scene.environment is None:
        scene.environment = rj.Environment.gradient(
            zenith=(0.5, 0.53, 0.6), horizon=(0.4, 0.4, 0.4), ground=(0.2, 0.18, 0.16)
        )
        scene.lights = [rj.DirectionalLight((-0.5, -1.0, -0.7), intensity=0.55)]
        scene.ambient_occlusion = rj.AmbientOcclusion()


def draw(folder: Path, renderer: rj.Renderer) -> Iterator[Thumbnail]:
    """Yield a thumbnail for each mesh file below a folder, in the order of their names."""
    for path in sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES):
        if path.is_dir():
            continue
        name = path.relative_to(folder).as_posix()
        try:
            with warnings.catch_warnings(record=True) as notices:
                warnings.simplefilter("always")
                scene = rj.load(path)
                light(scene)
                direction = rj.orbit_direction(30.0, 22.0)
                camera = rj.fit_camera(scene, direction, 35.0, aspect=1.0)
                frame = renderer.render(scene, camera, background="#e8ebef")
        except (ValueError, OSError, MemoryError, ImportError) as error:
            yield Thumbnail(name, None, str(error).replace(f"{path} ", ""))
            continue
        faces = sum(len(node.mesh.faces) for node in scene.nodes if isinstance(node.mesh, rj.Mesh))
        is_cloud = all(isinstance(node.mesh, rj.Points) for node in scene.nodes)
        words = f"{faces:,} {'points' if is_cloud else 'faces'}" + (
            f", {len(notices)} warnings" if notices else ""
        )
        yield Thumbnail(name, frame.color, words)


def sheet(thumbnails: list[Thumbnail], side: int, columns: int) -> Image.Image:
    """Return all thumbnails with their captions; broken files are red cells with the reason."""
    rows = math.ceil(len(thumbnails) / columns)
    picture = Image.new("RGB", (columns * side, rows * (side + CAPTION)), "white")
    pen = ImageDraw.Draw(picture)
    font, small = ImageFont.load_default(13), ImageFont.load_default(11)
    for number, one in enumerate(thumbnails):
        x, y = number % columns * side, number // columns * (side + CAPTION)
        words = one.words
        if one.picture is None:
            pen.rectangle((x, y, x + side - 1, y + side - 1), "#f6dcdc")
            letters = max(8, side // 7)
            lines = [
                words[k : k + letters] for k in range(0, min(len(words), 6 * letters), letters)
            ]
            pen.multiline_text((x + 8, y + 8), "\n".join(lines), "#a02020", small)
            words = "cannot be drawn"
        else:
            picture.paste(Image.fromarray(one.picture[..., :3]), (x, y))
        pen.text((x + 6, y + side + 2), one.name[-side // 7 :], "black", font)
        pen.text((x + 6, y + side + 17), words, "#606060", small)
    return picture


def main(arguments: list[str] | None = None) -> None:
    """Draw the thumbnails of a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("models"))
    parser.add_argument("-o", "--output", type=Path, default=Path("thumbnails"))
    parser.add_argument("--side", type=int, default=200, help="of a thumbnail, pixels")
    parser.add_argument("--columns", type=int, default=4)
    chosen = parser.parse_args(arguments)
    thumbnails = []
    with rj.Renderer((chosen.side, chosen.side), quality=rj.Quality(samples=8)) as renderer:
        for one in draw(chosen.folder, renderer):
            thumbnails.append(one)
            print(f"{one.name}: {one.words}")
            if one.picture is not None:
                path = chosen.output / f"{one.name}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                save_image(path, one.picture)
    if not thumbnails:
        raise SystemExit(f"{chosen.folder} holds no meshes")
    chosen.output.mkdir(parents=True, exist_ok=True)
    sheet(thumbnails, chosen.side, chosen.columns).save(chosen.output / "sheet.png")
    broken = [one.name for one in thumbnails if one.picture is None]
    if broken:
        raise SystemExit(
            f"{len(broken)} of {len(thumbnails)} could not be drawn: {', '.join(broken)}"
        )


if __name__ == "__main__":
    main()
