"""Build a face whose features are morph targets: a smile and surprise."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from glb import Channel, GlbFile
from numpy.typing import NDArray
from pieces import (
    Piece,
    add_ground,
    add_material,
    attributes_of,
    ball,
    merged,
    smooth_normals,
    spline_keys,
    tube,
    turns,
)
from surfaces import Floats

RADIUS, HEIGHT = 1.0, 1.15
"""Of the head, and of its centre above the ground."""
YELLOW, DARK, RED, WHITE, BROWN = (
    (240, 150, 12), (16, 8, 4), (120, 8, 10), (235, 235, 235), (60, 22, 8),
)  # fmt: skip
"""Linear colours."""
LIP_SIDES, LIP_STEPS, LIP = 8, 36, 0.05
BROW_SIDES, BROW_STEPS = 8, 9
REST = (0.25, 0.0)
"""Weights of the two targets in the file's own pose."""


def _front(x: float, y: float, lift: float) -> tuple[float, float, float]:
    """Return the point above the front of the unit ball whose x and y are given."""
    length = math.sqrt(x * x + y * y)
    if length > 0.95:
        x, y = x * 0.95 / length, y * 0.95 / length
    z = math.sqrt(1.0 - x * x - y * y)
    return x * lift, y * lift, z * lift


def _head(smile: float) -> Piece:
    """Return the head, whose cheeks rise with a smile."""
    points, faces = ball((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 28, 40)
    x, y, z = points.T
    front = np.maximum(z, 0.0)
    cheeks = 0.0
    for side in (-1.0, 1.0):
        dx, dy = x - side * 0.5, y + 0.12
        near = np.maximum(0.0, 1.0 - (dx * dx + dy * dy) * 7.0)
        cheeks = cheeks + near * near * front
    nose_x, nose_y = x * 4.2, (y + 0.02) * 4.2
    nose = np.maximum(0.0, 1.0 - nose_x * nose_x - nose_y * nose_y)
    grown = points * (1.0 + 0.2 * nose * nose * front + 0.14 * smile * cheeks)[:, None]
    return Piece(grown, faces, np.array(YELLOW, np.uint8))


def _mouth(smile: float, surprise: float) -> list[Piece]:
    """Return the lips, a closed tube, and what is dark within."""
    wide = 0.3 + 0.16 * smile - 0.14 * surprise
    open_ = 0.035 + 0.12 * smile + 0.19 * surprise
    ring = []
    for j in range(LIP_STEPS):
        a = 2.0 * math.pi * j / LIP_STEPS
        x = wide * math.cos(a)
        bow = (x / wide) * (x / wide)
        upper = math.sin(a) * (1.0 - 0.75 * smile if math.sin(a) > 0.0 else 1.0)
        y = -0.42 - 0.12 * surprise + open_ * upper + 0.22 * smile * (bow - 0.5)
        ring.append((x, y))
    middle = (0.0, sum(y for _, y in ring) / LIP_STEPS)
    lips = []
    for j, (x, y) in enumerate(ring):
        (x0, y0), (x1, y1) = ring[j - 1], ring[(j + 1) % LIP_STEPS]
        along = math.sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0))
        out = ((y1 - y0) / along, -(x1 - x0) / along)
        for k in range(LIP_SIDES):
            b = 2.0 * math.pi * k / LIP_SIDES
            across, above = LIP * math.cos(b), LIP * math.sin(b)
            lips.append(_front(x + out[0] * across, y + out[1] * across, 1.01 + above))
    step, side = np.meshgrid(np.arange(LIP_STEPS), np.arange(LIP_SIDES), indexing="ij")
    a, b = step.ravel(), side.ravel()
    here, there = a * LIP_SIDES, (a + 1) % LIP_STEPS * LIP_SIDES
    up = (b + 1) % LIP_SIDES
    faces = np.concatenate(
        [
            np.column_stack([here + b, there + b, there + up]),
            np.column_stack([here + b, there + up, here + up]),
        ]
    )
    within = [_front(*middle, 1.012)]
    for scale in (0.5, 1.0):
        for x, y in ring:
            point = middle[0] + (x - middle[0]) * scale, middle[1] + (y - middle[1]) * scale
            within.append(_front(*point, 1.012))
    around = np.arange(LIP_STEPS)
    ahead = (around + 1) % LIP_STEPS
    fan = np.column_stack([np.zeros_like(around), around + 1, ahead + 1])
    outer = np.column_stack([around + 1, around + 1 + LIP_STEPS, ahead + 1 + LIP_STEPS])
    inner = np.column_stack([around + 1, ahead + 1 + LIP_STEPS, ahead + 1])
    return [
        Piece(np.array(lips), faces, np.array(RED, np.uint8)),
        Piece(np.array(within), np.concatenate([fan, outer, inner]), np.array(DARK, np.uint8)),
    ]


def _eyes(smile: float, surprise: float) -> list[Piece]:
    """Return eyes, pupils and brows."""
    pieces = []
    for side in (-1.0, 1.0):
        x, y = side * 0.34, 0.27 + 0.03 * surprise
        center = np.array(_front(x, y, 0.95))
        high = 0.22 - 0.06 * smile + 0.07 * surprise
        white, faces = ball(center.tolist(), (0.17 + 0.02 * surprise, high, 0.13), 10, 18)
        pieces.append(Piece(white, faces, np.array(WHITE, np.uint8)))
        place = (center + np.array((-0.005 * side, 0.0, 0.085))).tolist()
        small = 1.0 - 0.3 * surprise
        pupil, faces = ball(place, (0.085 * small, 0.1 * small * (high / 0.22), 0.07), 8, 14)
        pieces.append(Piece(pupil, faces, np.array(DARK, np.uint8)))
        pieces.append(_brow(side, smile, surprise))
    return pieces


def _brow(side: float, smile: float, surprise: float) -> Piece:
    """Return a brow, an arch that is thinner at its ends."""
    rings = []
    for step in range(BROW_STEPS):
        t = 2.0 * step / (BROW_STEPS - 1) - 1.0
        x = side * 0.36 - 0.21 * t
        y = 0.6 + 0.07 * smile + 0.17 * surprise - 0.07 * t * t + side * 0.012 * t
        thick = 0.045 * (1.0 - 0.6 * t * t)
        ring = []
        for k in range(BROW_SIDES):
            b = 2.0 * math.pi * k / BROW_SIDES
            ring.append(_front(x, y + thick * math.cos(b), 1.03 + 0.9 * thick * math.sin(b)))
        rings.append(ring)
    points, faces = tube(np.array(rings))
    return Piece(points, faces, np.array(BROWN, np.uint8))


def _face(smile: float, surprise: float) -> Piece:
    """Return the whole face; surprise makes it longer."""
    face = merged([_head(smile), *_mouth(smile, surprise), *_eyes(smile, surprise)])
    y = face.points[:, 1]
    y *= 1.0 + 0.12 * surprise * np.where(y < 0.0, 1.0, 0.4)
    return face


def _difference(smile: float, surprise: float, base: Piece, normals: Floats) -> dict[str, NDArray]:
    """Return what a morph target adds to positions and normals."""
    other = _face(smile, surprise)
    positions = (other.points - base.points).astype(np.float32)
    turned = smooth_normals(other.points, other.faces) - normals
    # A rounding of either normal is no change.
    turned[np.abs(turned) < 1e-6] = 0.0
    positions[np.abs(positions) < 1e-7] = 0.0
    return {"POSITION": positions, "NORMAL": turned.astype(np.float32)}


def make_face(folder: Path) -> None:
    """
    Write a face of two morph targets, "smile" and "surprise", which change positions and normals.

    Animations: "feelings", 4 seconds, LINEAR weights and a LINEAR rotation of the head; "nod", 2
    seconds, CUBICSPLINE weights and rotation. Without either it smiles a little: the mesh says so.
    """
    glb = GlbFile()
    base = _face(0.0, 0.0)
    normals = smooth_normals(base.points, base.faces)
    mesh = glb.add_mesh(
        "face",
        attributes_of(base, normals),
        base.faces.astype(np.uint16),
        add_material(glb, "enamel", 0.3),
        [_difference(1.0, 0.0, base, normals), _difference(0.0, 1.0, base, normals)],
        weights=list(REST),
        extras={"targetNames": ["smile", "surprise"]},
    )
    head = glb.add(
        "nodes", {"name": "face", "mesh": mesh, "translation": [0.0, HEIGHT * RADIUS, 0.0]}
    )
    ground = add_ground(glb, 2.2, (0.3, 0.34, 0.42))
    times = np.array([0.0, 0.8, 1.6, 2.4, 3.2, 4.0], np.float32)
    weights = np.float32([(0, 0), (1, 0), (1, 0), (0, 1), (0, 1), (0, 0)])
    looks = turns((0.0, 1.0, 0.0), [0.0, 22.0, -22.0, 0.0, 0.0, 0.0]).astype(np.float32)
    glb.add_animation(
        "feelings",
        [
            Channel(head, "weights", times, weights.reshape(-1)),
            Channel(head, "rotation", times, looks),
        ],
    )
    beats = np.array([0.0, 0.5, 1.0, 1.5, 2.0], np.float32)
    mood = spline_keys(
        np.array([(0.25, 0.0), (0.8, 0.0), (0.25, 0.6), (0.8, 0.0), (0.25, 0.0)]),
        np.array([(1.0, 0.0), (0.0, 0.5), (0.0, 0.0), (0.0, -0.5), (-1.0, 0.0)]),
    )
    nods = turns((1.0, 0.0, 0.0), [0.0, 18.0, -8.0, 18.0, 0.0])
    glb.add_animation(
        "nod",
        [
            Channel(head, "weights", beats, mood.reshape(-1), "CUBICSPLINE"),
            Channel(head, "rotation", beats, spline_keys(nods, np.zeros_like(nods)), "CUBICSPLINE"),
        ],
    )
    glb.add("scenes", {"name": "scene", "nodes": [head, ground]})
    glb.save(folder / "face.glb")
