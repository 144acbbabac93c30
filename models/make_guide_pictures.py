"""
Render pictures of the guides: ``python models/make_guide_pictures.py [FOLDER]``.

``qualities.png``: a part of one scene in the four named qualities, enlarged, for
``docs/guides/accuracy.md``. ``primitives.png``: lines, a triangle, a circle and a curve, enlarged,
for ``docs/guides/classics.md``. ``materials/far_masks.png``: leaves and a fence from near to far,
with few samples and with 256, for ``docs/guides/materials.md``. ``line_drawing.svg``, in
``docs/pictures``: the teapot as lines, for ``docs/guides/effects.md``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from make_accuracy import make_scene
from PIL import Image, ImageDraw, ImageFont

import rasterjit as rj

PICTURES = Path(__file__).parent / "pictures"

DRAWING = Path(__file__).parents[1] / "docs" / "pictures" / "line_drawing.svg"
"""Beside the others it would count as a mesh file."""

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


FAR = (192, 96, 48, 24, 12)
"""How many pixels wide masks are shown, from near to far."""


def leaves() -> np.ndarray:
    """Return a picture of leaves on clear ground, (256, 256, 4) uint8, denser in the middle."""
    rng, side = np.random.default_rng(3), 256
    y, x = np.mgrid[:side, :side] + 0.5
    image = np.zeros((side, side, 4), np.uint8)
    for _ in range(170):
        middle, turn = rng.random(2) * side, rng.random() * np.pi
        if rng.random() < 0.9 * np.hypot(*(middle - side / 2)) / (side / 2):
            continue
        across, down = x - middle[0], y - middle[1]
        along = (across * np.cos(turn) + down * np.sin(turn)) / 18
        beside = (down * np.cos(turn) - across * np.sin(turn)) / 5
        alpha = np.clip(2.5 - 2.0 * (along**2 + beside**2), 0, 1)
        image[alpha > 0.02, :3] = 60 + 60 * rng.random(), 140 + 80 * rng.random(), 40
        image[..., 3] = np.maximum(image[..., 3], 255 * alpha)
    return image


def fence() -> np.ndarray:
    """Return a picture of crossing wires on clear ground, (256, 256, 4) uint8."""
    y, x = np.mgrid[:256, :256]
    wires = ((x + y) % 16 < 3) | ((x - y) % 16 < 3)
    return np.where(wires[..., np.newaxis], (110, 110, 120, 255), (0, 0, 0, 0)).astype(np.uint8)


def draw_far_masks() -> Image.Image:
    """Return masks from near to far, small ones enlarged, by samples of a pixel."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    height, rows = FAR[0] + GAP, []
    for image in (leaves(), fence()):
        material = rj.Material("unlit", base_color_texture=rj.Texture(image), alpha_mode="mask")
        uv = corners[:, :2] / 2 + 0.5
        mesh = rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], uv=uv, material=material)
        rows += [(mesh, samples) for samples in (1, 4, 256)]
    sheet = Image.new("RGB", (BAR + len(FAR) * height, len(rows) * height), "white")
    draw = ImageDraw.Draw(sheet)
    for n, (mesh, samples) in enumerate(rows):
        draw.text((0, n * height), str(samples), "black", font=ImageFont.load_default(12))
        for k, pixels in enumerate(FAR):
            camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=2.0)
            frame = rj.render(
                mesh, camera, size=(pixels, pixels), background="#d8e8ff",
                quality=rj.Quality(samples=samples),
            )  # fmt: skip
            shown = Image.fromarray(frame.color[:, :, :3])
            large = shown.resize((FAR[0], FAR[0]), Image.Resampling.NEAREST)
            sheet.paste(large, (BAR + k * height, n * height))
    return sheet


def draw_lines(path: Path) -> None:
    """Write the visible and hidden edges of the teapot."""
    scene = rj.load(Path(__file__).parent / "teapot.obj")
    scene.add(rj.Label((0, 3.25, 0), "lid", anchor="bottom", size=11.0))
    drawing = rj.line_drawing(scene, size=(300, 210))
    drawing.save(path, hidden="dashed", background="white")


def main(folder: Path) -> None:
    """Draw and write."""
    draw_lines(DRAWING)
    draw_qualities().quantize(128, dither=Image.Dither.NONE).save(folder / "qualities.png")
    draw_primitives().save(folder / "primitives.png")
    far = draw_far_masks().quantize(128, dither=Image.Dither.NONE)
    far.save(folder / "materials" / "far_masks.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURES)
