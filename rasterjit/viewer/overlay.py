"""Convert outputs of a frame to pictures, and draw text panels and marks on them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.inspect.pixel_report import PixelExplanation
from rasterjit.io.text_layout import draw_text, lay_out, measure_text_width
from rasterjit.outputs.frame import Frame

OUTPUTS_OF = {
    "color": ("color", "depth"),
    "depth": ("depth",),
    "normal": ("normal", "depth"),
    "object_id": ("object_id", "depth"),
    "face_id": ("face_id", "depth"),
}
"""Outputs to render for each kind of picture; the depth is for zooming to the cursor."""

BACKGROUND_GREY = 40
"""Grey of the background."""

FARTHEST_GREY = 60
"""Grey of the farthest surface."""

HASH_FACTORS = np.array([0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D], dtype=np.uint32)
"""Odd factors of a multiplicative hash, about 2**32 over irrational numbers."""

HASH_SHIFT = 25
"""Bits of the hash that are dropped of 32: 0..127 stay, and are added to 128."""

FONT_SIZE = 13
"""Font size at a pixel ratio of 1, pixels."""

MARGIN = 6
"""Margin around text at a pixel ratio of 1, pixels."""

COLUMN_GAP = 14
"""Gap between columns at a pixel ratio of 1, pixels."""

PANEL_COLOR, TEXT_COLOR, FAINT_COLOR = (24, 26, 30), (240, 240, 236), (168, 172, 178)
"""Colours, sRGB: of panels, of their first column, and of the other columns."""

PANEL_OPACITY = 0.88
"""Opacity of panels."""

MARK_PIXELS = (3, 8)
"""Range of the lines around a pixel, from it, at a pixel ratio of 1, pixels."""

MARK_COLOR = (230, 40, 30)
"""Colour of those lines, sRGB."""

MIN_TEXT_HEIGHT = 120
"""Least height of a picture with text, pixels: text would cover a smaller one."""


Row = tuple[str, ...]
"""Cells of a row, from the left."""


def to_picture(frame: Frame, kind: str, numbers: Sequence[int] | None = None) -> NDArray[np.uint8]:
    """
    Convert an output of a frame to a picture, (H, W, 4) uint8, sRGB, opaque.

    Parameters
    ----------
    frame : Frame
        With the outputs ``OUTPUTS_OF[kind]``.
    kind : {"color", "depth", "normal", "object_id", "face_id"}
        Depths are brighter the nearer; normals are (n + 1) / 2, world x red, y green, z blue;
        numbers are colours that differ between neighbours, mostly.
    numbers : sequence of int, optional
        What to call the objects, which keep their colours where others are hidden. Default: as the
        frame does.
    """
    if kind == "color":
        return _blend_over_white(frame.color)
    depth = frame.depth
    visible = np.isfinite(depth)
    picture = np.full((*depth.shape, 4), 255, dtype=np.uint8)
    picture[~visible, :3] = BACKGROUND_GREY
    if not visible.any():
        return picture
    if kind == "depth":
        near, far = float(depth[visible].min()), float(depth[visible].max())
        share = (far - depth[visible]) / ((far - near) or 1.0)
        picture[visible, :3] = (FARTHEST_GREY + share * (255 - FARTHEST_GREY) + 0.5).astype(
            np.uint8
        )[:, None]
    elif kind == "normal":
        picture[visible, :3] = (frame.normal[visible] * 127.5 + 128.0).clip(0, 255).astype(np.uint8)
    else:
        ids = getattr(frame, kind)[visible]
        if kind == "object_id" and numbers is not None:
            ids = np.asarray(numbers, dtype=np.int64)[ids]
        picture[visible, :3] = pick_colors(ids)
    return picture


def pick_colors(numbers: NDArray[np.integer]) -> NDArray[np.uint8]:
    """Return a bright colour for each number, (N,) to (N, 3) uint8, sRGB."""
    spread = ((numbers.astype(np.uint32) + np.uint32(1))[:, None] * HASH_FACTORS) >> np.uint32(
        HASH_SHIFT
    )
    return spread.astype(np.uint8) + np.uint8(128)


def _blend_over_white(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Composite 8-bit colours over white; always a copy."""
    result = color.copy()
    if color[:, :, 3].min() < 255:
        alpha = color[:, :, 3:].astype(np.float32) / 255.0
        result[:, :, :3] = color[:, :, :3] * alpha + 255.0 * (1.0 - alpha) + 0.5
        result[:, :, 3] = 255
    return result


def write_panel(
    picture: NDArray[np.uint8], rows: Sequence[Row], corner: str, ratio: float = 1.0
) -> None:
    """
    Draw rows of text on a picture, in a dark panel.

    Parameters
    ----------
    picture : (H, W, 4) uint8, sRGB
        Changed; as it is if it is too small for text. What does not fit is cut off.
    rows : sequence of tuple of str
        Columns are as wide as their widest cell.
    corner : {"top left", "top right", "bottom left", "bottom right"}
        Where the panel lies.
    ratio : float
        Pixels of the picture for one of the screen.
    """
    # In a terminal one pixel is as large as many of the screen.
    ratio = max(ratio, 1.0)
    if not rows or picture.shape[0] < MIN_TEXT_HEIGHT * ratio:
        return
    panel, opacity = _draw_panel(tuple(rows), float(ratio))
    height, width = (min(a, b) for a, b in zip(panel.shape, picture.shape[:2], strict=False))
    gap = min(round(MARGIN * ratio), picture.shape[0] - height, picture.shape[1] - width)
    top = gap if corner.startswith("top") else picture.shape[0] - height - gap
    left = gap if corner.endswith("left") else picture.shape[1] - width - gap
    area = picture[top : top + height, left : left + width]
    share = opacity[:height, :width]
    mixed = panel[:height, :width] * share + area[:, :, :3] * (1.0 - share)
    area[:, :, :3] = mixed + 0.5
    area[:, :, 3] = 255


def mark_pixel(picture: NDArray[np.uint8], column: int, row: int, ratio: float = 1.0) -> None:
    """
    Draw a mark of four short lines around a pixel.

    Parameters
    ----------
    picture : (H, W, 4) uint8, sRGB
        Changed.
    column, row : int
        Of the pixel.
    ratio : float
        Pixels of the picture for one of the screen.
    """
    near, far = (round(reach * max(ratio, 1.0)) for reach in MARK_PIXELS)
    for low, high in ((-far, 1 - near), (near, far + 1)):
        picture[row, max(column + low, 0) : max(column + high, 0), :3] = MARK_COLOR
        picture[max(row + low, 0) : max(row + high, 0), column, :3] = MARK_COLOR


@lru_cache(maxsize=64)
def _draw_panel(
    rows: tuple[Row, ...], ratio: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the colours of a panel, (H, W, 3) float32 in 0..255, and its opacity, (H, W, 1)."""
    em = FONT_SIZE * ratio
    margin, gap = MARGIN * ratio, COLUMN_GAP * ratio
    line = lay_out("x", em).height + round(ratio)
    columns = max(map(len, rows))
    # A cell that is alone in its row is a heading, and makes no column wider.
    widths = [
        max((measure_text_width(row[k], em) for row in rows if k < len(row) > 1), default=0)
        for k in range(columns)
    ]
    starts = [margin]
    for cells in widths[:-1]:
        starts.append(starts[-1] + cells + gap)
    ends = (starts[k] + measure_text_width(cell, em) for row in rows for k, cell in enumerate(row))
    width, height = round(max(ends) + margin), round(len(rows) * line + 2.0 * margin)
    panel = np.full((height, width, 3), PANEL_COLOR, np.uint8)
    for number, row in enumerate(rows):
        for k, (start, cell) in enumerate(zip(starts, row, strict=False)):
            position = start, margin + number * line
            draw_text(panel, cell, position, em, FAINT_COLOR if k else TEXT_COLOR)
    colors = panel.astype(np.float32)
    is_text = (colors != np.float32(PANEL_COLOR)).any(axis=2, keepdims=True)
    return colors, np.where(is_text, 1.0, PANEL_OPACITY).astype(np.float32)


def as_rows(explained: PixelExplanation) -> list[Row]:
    """Return the explanation of a pixel, as rows."""
    red, green, blue, _ = explained.color.tolist()
    face = explained.winner
    rows: list[Row] = [(f"pixel ({explained.x}, {explained.y})",)]
    if face is None:
        rows.append(("shows", "the background"))
        rows += [("", reason) for reason in explained.reasons]
    else:
        rows += [
            ("object", f"{face.object_number} {face.object_name}"),
            ("face", f"{face.face} (of the object: {face.mesh_face})"),
            ("depth", f"{face.depth:.6g}"),
            ("world position", "  ".join(f"{part:.5g}" for part in face.position)),
            ("weights", "  ".join(f"{float(weight):.4f}" for weight in face.weights)),
            ("faces here", str(len(explained.faces))),
        ]
    light = explained.light
    if light is not None:
        rows.append((f"base colour ({light.shading})", _format_numbers(light.base_color)))
        if light.lights:
            rows.append(("ambient", _format_numbers(light.ambient)))
        for term in light.lights:
            rows.append((term.label, _format_numbers(term.diffuse)))
            if term.specular.any():
                rows.append((f"{term.name}, specular", _format_numbers(term.specular)))
    rows.append(("linear", _format_numbers(explained.linear[:3])))
    return [*rows, ("sRGB", f"{red}  {green}  {blue}")]


def _format_numbers(values: Any) -> str:
    """Format numbers."""
    return "  ".join(f"{float(value):.3f}" for value in values)
