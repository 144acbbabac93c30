"""Make pictures of what a frame knows: its depth, normals and numbers, for the eye."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rasterjit.frame import Frame

OUTPUTS_OF = {
    "color": ("color", "depth"),
    "depth": ("depth",),
    "normal": ("normal", "depth"),
    "object_id": ("object_id", "depth"),
    "face_id": ("face_id", "depth"),
}
"""What is rendered for each kind of picture; the depth tells what is under the cursor."""

NOTHING = 40
"""Grey of pixels that show nothing."""

DARKEST = 60
"""Grey of the farthest surface: told apart from nothing."""

ODD = np.array([0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D], dtype=np.uint32)
"""Large odd numbers, about 2**32 over irrational ones: multiples of them spread well."""

BRIGHTNESS_BITS = 25
"""Bits that are dropped of 32: 0..127 stay, and lie on top of 128."""


def picture_of(frame: Frame, kind: str) -> NDArray[np.uint8]:
    """
    Return a picture of a frame, (H, W, 4) uint8, sRGB, opaque.

    Parameters
    ----------
    frame : Frame
        With the outputs ``OUTPUTS_OF[kind]``.
    kind : {"color", "depth", "normal", "object_id", "face_id"}
        Depths are brighter the nearer; normals are (n + 1) / 2, world x red, y green, z blue;
        numbers are colours that differ between neighbours, mostly.
    """
    if kind == "color":
        return _over_white(frame.color)
    depth = frame.depth
    seen = np.isfinite(depth)
    picture = np.full((*depth.shape, 4), 255, dtype=np.uint8)
    picture[~seen, :3] = NOTHING
    if not seen.any():
        return picture
    if kind == "depth":
        near, far = float(depth[seen].min()), float(depth[seen].max())
        share = (far - depth[seen]) / ((far - near) or 1.0)
        picture[seen, :3] = (DARKEST + share * (255 - DARKEST) + 0.5).astype(np.uint8)[:, None]
    elif kind == "normal":
        picture[seen, :3] = (frame.normal[seen] * 127.5 + 128.0).clip(0, 255).astype(np.uint8)
    else:
        numbers = getattr(frame, kind)[seen].astype(np.uint32) + np.uint32(1)
        spread = (numbers[:, None] * ODD) >> np.uint32(BRIGHTNESS_BITS)
        picture[seen, :3] = spread.astype(np.uint8) + 128
    return picture


def _over_white(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return 8-bit colours over white where they are transparent; always a copy."""
    shown = color.copy()
    if color[:, :, 3].min() < 255:
        alpha = color[:, :, 3:].astype(np.float32) / 255.0
        shown[:, :, :3] = color[:, :, :3] * alpha + 255.0 * (1.0 - alpha) + 0.5
        shown[:, :, 3] = 255
    return shown
