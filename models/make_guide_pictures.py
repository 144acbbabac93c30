"""
Render pictures of the guides: ``python models/make_guide_pictures.py [FOLDER]``.

``qualities.png``: a part of one scene in the four named qualities, enlarged, for
``docs/guides/accuracy.md``. ``primitives.png``: lines, a triangle, a circle and a curve, enlarged,
for ``docs/guides/classics.md``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from make_accuracy import make_scene
from PIL import Image, ImageDraw, ImageFont

import rasterjit as rj

PICTURES = Path(__file__).parent / "pictures"

SIZE = (480, 360)
PART = (150, 175, 290, 305)
"""Left, top, right and bottom of what is enlarged, pixels."""

TIMES, GAP, BAR = 2, 8, 24
"""How many times as large it is shown; what lies between parts, and the height of their names."""

NAMES = ("draft", "standard", "high", "reference")


def draw_qualities() -> Image.Image:
    """Return parts of the scene in all named qualities, side by side."""
    scene, camera = make_scene()
    width, height = ((PART[2] - PART[0]) * TIMES, (PART[3] - PART[1]) * TIMES)
    sheet = Image.new("RGB", (len(NAMES) * (width + GAP) - GAP, height + BAR), "white")
    draw = ImageDraw.Draw(sheet)
    for n, name in enumerate(NAMES):
        quality = getattr(rj.Quality, name)()
        color = rj.render(scene, camera, size=SIZE, quality=quality).color
        part = Image.fromarray(color[:, :, :3]).crop(PART)
        place = n * (width + GAP)
        sheet.paste(part.resize((width, height), Image.Resampling.NEAREST), (place, BAR))
        draw.text((place, 4), name, "black", font=ImageFont.load_default(15))
    return sheet


def draw_primitives() -> Image.Image:
    """Return classic primitives, so large that their pixels are seen."""
    canvas = rj.Framebuffer(160, 100)
    canvas.clear((24, 26, 32))
    corners = ((255, 0, 0), (0, 255, 0), (0, 0, 255))
    canvas.fill_triangle((6, 92), (50, 12), (86, 80), corners)
    canvas.draw_circle((118, 34), 26, (255, 255, 255))
    canvas.draw_bezier([(60, 90), (90, 10), (120, 140), (154, 60)], (255, 255, 0))
    for n in range(7):
        canvas.draw_line((92, 96), (154, 96 - 7 * n), (255, 80, 0), end_color=(0, 120, 255))
    large = np.repeat(np.repeat(canvas.color[:, :, :3], 4, axis=0), 4, axis=1)
    return Image.fromarray(large)


def main(folder: Path) -> None:
    """Draw and write."""
    draw_qualities().quantize(128, dither=Image.Dither.NONE).save(folder / "qualities.png")
    draw_primitives().save(folder / "primitives.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURES)
