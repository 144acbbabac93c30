"""Draw the sheet; see the package."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path

import click
from PIL import Image, ImageDraw, ImageFont

from benchmarks.default_pictures.objects import ROOT, make_objects

OWN = "rasterjit"

CONTESTANTS = (OWN, "f3d", "pyvista")

SIZE = (960, 720)
"""Of each picture, pixels."""

CELL = (480, 360)
"""Of each on the sheet."""

LINE = 26
"""Height of a line of text, pixels."""


def draw(contestant: str, files: dict[str, Path], folder: Path, peers: str) -> dict[str, Path]:
    """Draw all objects as a contestant does by default; return the pictures by object."""
    pictures = {name: folder / f"{contestant}-{name}.png" for name in files}
    if contestant == OWN:
        size = f"{SIZE[0]}x{SIZE[1]}"
        for name, file in files.items():
            command = [sys.executable, "-m", "rasterjit", str(file), "-o", str(pictures[name])]
            subprocess.run([*command, "--size", size, "--quiet"], check=True, cwd=ROOT)
        return pictures
    pairs = [str(path) for name in files for path in (files[name], pictures[name])]
    script = Path(__file__).with_name("peers.py")
    command = [peers, str(script), contestant, *map(str, SIZE), *pairs]
    subprocess.run(command, check=True, capture_output=True)
    return pictures


def lay_out(rows: list[list[Path]], labels: list[list[str]]) -> Image.Image:
    """Return pictures as a sheet, with a line of text above each row."""
    width, height = CELL
    sheet = Image.new("RGB", (width * len(rows[0]), (height + LINE) * len(rows)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(16)
    for row, (pictures, texts) in enumerate(zip(rows, labels, strict=True)):
        for column, (picture, text) in enumerate(zip(pictures, texts, strict=True)):
            place = column * width, row * (height + LINE)
            pen.text((place[0] + 8, place[1] + 4), text, "black", font)
            with Image.open(picture) as image:
                small = image.convert("RGB").resize(CELL, Image.Resampling.LANCZOS)
            sheet.paste(small, (place[0], place[1] + LINE))
    return sheet


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--scans", type=click.Path(exists=True, path_type=Path), required=True,
              help="data.tar.gz of Debian's package libcgal-demo.")  # fmt: skip
@click.option("--peers", default=sys.executable, show_default=True,
              help="A Python that has f3d and pyvista.")  # fmt: skip
@click.option("--seed", "seeds", type=int, multiple=True, default=(1, 2, 3), show_default=True)
def main(folder: Path, scans: Path, peers: str, seeds: tuple[int, ...]) -> None:
    """Write the sheets into FOLDER."""
    files = make_objects(folder / "objects", scans)
    drawn = {name: draw(name, files, folder, peers) for name in CONTESTANTS}
    rows = [[drawn[one][name] for one in CONTESTANTS] for name in files]
    labels = [[f"{name}: {one}" for one in CONTESTANTS] for name in files]
    lay_out(rows, labels).save(folder / "sheet.png")
    for seed in seeds:
        draw_lots = random.Random(seed)
        orders = {name: draw_lots.sample(CONTESTANTS, len(CONTESTANTS)) for name in files}
        rows = [[drawn[one][name] for one in order] for name, order in orders.items()]
        labels = [[f"{n} {mark}" for mark in "ABC"] for n in range(1, len(rows) + 1)]
        lay_out(rows, labels).save(folder / f"sheet_{seed}.png")
        key = {f"{n} {name}": dict(zip("ABC", order, strict=True))
               for n, (name, order) in enumerate(orders.items(), 1)}  # fmt: skip
        (folder / f"key_{seed}.json").write_text(json.dumps(key, indent=1) + "\n")


if __name__ == "__main__":
    main()
