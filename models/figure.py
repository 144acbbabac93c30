"""Build a walking figure: one skinned mesh around a skeleton, with smooth weights."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from glb import Channel, GlbFile
from numpy.typing import NDArray
from pieces import (
    Piece,
    add_ground,
    add_material,
    after,
    attributes_of,
    ball,
    merged,
    smooth_normals,
    spline_keys,
    turn_slopes,
    turns,
)
from surfaces import Floats, Indices, unit

Field = Callable[[Floats], Floats]

SKELETON: dict[str, tuple[str | None, tuple[float, float, float]]] = {
    "hips": (None, (0.0, 0.93, 0.0)),
    "spine": ("hips", (0.0, 1.06, 0.0)),
    "chest": ("spine", (0.0, 1.22, 0.0)),
    "neck": ("chest", (0.0, 1.46, 0.0)),
    "head": ("neck", (0.0, 1.55, 0.0)),
    "eyes": ("head", (0.0, 1.765, 0.15)),
    "thigh.left": ("hips", (0.095, 0.90, 0.0)),
    "shin.left": ("thigh.left", (0.115, 0.51, 0.01)),
    "foot.left": ("shin.left", (0.13, 0.10, -0.02)),
    "thigh.right": ("hips", (-0.095, 0.90, 0.0)),
    "shin.right": ("thigh.right", (-0.115, 0.51, 0.01)),
    "foot.right": ("shin.right", (-0.13, 0.10, -0.02)),
    "arm.left": ("chest", (0.185, 1.385, 0.0)),
    "forearm.left": ("arm.left", (0.375, 1.195, 0.0)),
    "hand.left": ("forearm.left", (0.545, 1.025, 0.01)),
    "arm.right": ("chest", (-0.185, 1.385, 0.0)),
    "forearm.right": ("arm.right", (-0.375, 1.195, 0.0)),
    "hand.right": ("forearm.right", (-0.545, 1.025, 0.01)),
}
"""Each joint's parent and its place, metres, arms at 45 degrees; y up, +z forward, left is +x."""

NAMES = tuple(SKELETON)
SKIN, HAIR, SHIRT, TROUSERS, SHOES = (
    (190, 110, 74), (38, 16, 8), (16, 96, 130), (22, 26, 52), (120, 26, 16),
)  # fmt: skip
"""Linear colours."""


class Capsule(NamedTuple):
    """A round cone around a bone."""

    joint: str
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radii: tuple[float, float]
    color: tuple[int, int, int]


def _sides(
    joint: str,
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    radii: tuple[float, float],
    color: tuple[int, int, int],
) -> list[Capsule]:
    """Return a capsule of the left side and its mirror image."""
    (a, b, c), (d, e, f) = start, end
    left = Capsule(f"{joint}.left", start, end, radii, color)
    return [left, Capsule(f"{joint}.right", (-a, b, c), (-d, e, f), radii, color)]


CAPSULES = (
    Capsule("hips", (-0.05, 0.95, 0.0), (0.05, 0.95, 0.0), (0.13, 0.13), TROUSERS),
    Capsule("spine", (0.0, 1.08, 0.0), (0.0, 1.2, 0.0), (0.125, 0.13), SHIRT),
    Capsule("chest", (-0.03, 1.28, 0.0), (0.03, 1.28, 0.0), (0.14, 0.14), SHIRT),
    Capsule("chest", (-0.13, 1.375, 0.0), (0.13, 1.375, 0.0), (0.075, 0.075), SHIRT),
    Capsule("neck", (0.0, 1.44, 0.0), (0.0, 1.56, 0.0), (0.055, 0.05), SKIN),
    Capsule("head", (0.0, 1.72, 0.01), (0.0, 1.735, 0.0), (0.155, 0.165), SKIN),
    Capsule("head", (0.0, 1.80, -0.045), (0.0, 1.74, -0.06), (0.155, 0.135), HAIR),
    Capsule("head", (0.0, 1.715, 0.165), (0.0, 1.705, 0.18), (0.02, 0.024), SKIN),
    Capsule("head", (0.16, 1.73, 0.0), (0.17, 1.72, 0.0), (0.032, 0.03), SKIN),
    Capsule("head", (-0.16, 1.73, 0.0), (-0.17, 1.72, 0.0), (0.032, 0.03), SKIN),
    *_sides("thigh", (0.095, 0.89, 0.0), (0.115, 0.52, 0.01), (0.085, 0.066), TROUSERS),
    *_sides("shin", (0.115, 0.50, 0.01), (0.128, 0.15, -0.02), (0.064, 0.05), TROUSERS),
    *_sides("foot", (0.13, 0.07, -0.035), (0.137, 0.05, 0.13), (0.058, 0.05), SHOES),
    *_sides("arm", (0.185, 1.385, 0.0), (0.365, 1.205, 0.0), (0.062, 0.05), SHIRT),
    *_sides("forearm", (0.385, 1.185, 0.0), (0.53, 1.04, 0.008), (0.044, 0.036), SKIN),
    *_sides("hand", (0.565, 1.005, 0.012), (0.605, 0.965, 0.02), (0.046, 0.04), SKIN),
)
BLEND = 0.05
"""Metres over which two capsules flow into each other."""
CELL, LOW, HIGH = 0.026, (-0.7, -0.03, -0.3), (0.7, 2.0, 0.3)
"""Width of a cell of the grid on which the surface is found, and the grid's corners."""
NEWTON_STEPS, STEP = 4, 1e-4
SPREADINGS = 7
"""Times that each vertex takes half of the mean weights of those beside it."""

WALK, WAVE = 1.2, 2.0
"""Seconds."""
WALK_KEYS, WAVE_KEYS = 8, 12


def _distance(points: Floats, one: Capsule) -> Floats:
    """Return about how far points, (N,3), lie outside a capsule; negative inside."""
    start, end = np.array(one.start), np.array(one.end)
    axis = end - start
    x, y, z = (points - start).T
    t = np.clip((x * axis[0] + y * axis[1] + z * axis[2]) / (axis * axis).sum(), 0.0, 1.0)
    x, y, z = x - t * axis[0], y - t * axis[1], z - t * axis[2]
    return np.sqrt(x * x + y * y + z * z) - (one.radii[0] + t * (one.radii[1] - one.radii[0]))


def _body(points: Floats) -> Floats:
    """
    Return about how far points lie outside the figure.

    The smooth minimum of all capsules: Inigo Quilez, "Smooth minimum" (quadratic polynomial).
    """
    least = _distance(points, CAPSULES[0])
    for one in CAPSULES[1:]:
        other = _distance(points, one)
        blend = 0.4 * BLEND if one.color in (HAIR, SHOES) else BLEND
        near = np.maximum(blend - np.abs(least - other), 0.0) / blend
        least = np.minimum(least, other) - near * near * (blend / 4.0)
    return least


def _slope(points: Floats, field: Field) -> Floats:
    """Return the gradient of a field, (N,3), by central differences."""
    steps = np.eye(3) * STEP
    return np.column_stack(
        [(field(points + step) - field(points - step)) / (2.0 * STEP) for step in steps]
    )


def _skin_of(field: Field) -> tuple[Floats, Indices]:
    """
    Return the surface on which a field is 0, closed and counter-clockwise from outside.

    Sarah Gibson, "Constrained elastic surface nets", MICCAI 1998: a vertex in each cell that the
    surface crosses, a quadrilateral for each edge of the grid that it crosses.
    """
    counts = [math.ceil((high - low) / CELL) for low, high in zip(LOW, HIGH, strict=True)]
    axes = [low + CELL * np.arange(count + 1) for low, count in zip(LOW, counts, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = field(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    inside = values < 0.0
    cells = [slice(0, -1), slice(1, None)]
    corners = [inside[cells[i], cells[j], cells[k]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    total = np.sum(corners, axis=0)
    crossed = (total > 0) & (total < 8)
    numbers = np.full(crossed.shape, -1)
    numbers[crossed] = np.arange(np.count_nonzero(crossed))
    points = grid[:-1, :-1, :-1][crossed] + CELL / 2.0
    quads = []
    for axis in range(3):
        ahead, beside = (axis + 1) % 3, (axis + 2) % 3
        first = inside.take(range(counts[axis]), axis)
        changes = first != inside.take(range(1, counts[axis] + 1), axis)
        place = np.argwhere(changes)
        place = place[(place[:, ahead] > 0) & (place[:, beside] > 0)]
        ring = []
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
            cell = place.copy()
            cell[:, ahead] -= 1 - a
            cell[:, beside] -= 1 - b
            ring.append(numbers[tuple(cell.T)])
        quad = np.column_stack(ring)
        leaves = first[tuple(place.T)]
        quads.append(np.where(leaves[:, None], quad, quad[:, ::-1]))
    corner = np.concatenate(quads)
    faces = np.concatenate([corner[:, [0, 1, 2]], corner[:, [0, 2, 3]]])
    for _ in range(NEWTON_STEPS):
        points = points - unit(_slope(points, field)) * field(points)[:, None]
    return points, faces


def _weights(points: Floats, faces: Indices) -> Floats:
    """
    Return how much each joint moves each vertex, (V,J), summing to 1.

    The nearest capsule's joint alone, then spread along the edges: what lies beside each other but
    is not connected, such as the legs, does not mix.
    """
    gaps = np.stack([_distance(points, one) for one in CAPSULES])
    nearest = np.array([NAMES.index(one.joint) for one in CAPSULES])[gaps.argmin(axis=0)]
    weights = np.eye(len(NAMES))[nearest]
    edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    degree = np.bincount(edges[:, 0], minlength=len(points))[:, None]
    for _ in range(SPREADINGS):
        beside = np.zeros_like(weights)
        np.add.at(beside, edges[:, 0], weights[edges[:, 1]])
        weights = 0.5 * weights + 0.5 * beside / degree
    return weights


def _influences(weights: Floats) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the four joints of most weight and their weights in 255ths that sum to 255."""
    joints = np.argsort(-weights, axis=1, kind="stable")[:, :4]
    kept = np.take_along_axis(weights, joints, axis=1)
    shares = np.floor(255.0 * kept / kept.sum(axis=1, keepdims=True)).astype(np.int64)
    shares[:, 0] += 255 - shares.sum(axis=1)
    return np.where(shares > 0, joints, 0).astype(np.uint8), shares.astype(np.uint8)


def _colors(points: Floats) -> NDArray[np.uint8]:
    """Return the colour of the nearest capsule, (V,3), mixed where two are about as near."""
    palette = sorted({one.color for one in CAPSULES})
    gaps = np.full((len(palette), len(points)), np.inf)
    for one in CAPSULES:
        row = palette.index(one.color)
        gaps[row] = np.minimum(gaps[row], _distance(points, one))
    shares = np.maximum(0.0, 1.0 - (gaps - gaps.min(axis=0)) / (0.4 * CELL))
    total = np.zeros((len(points), 3))
    for color, share in zip(palette, shares, strict=True):
        total += share[:, None] * np.array(color)
    return np.round(total / shares.sum(axis=0)[:, None]).astype(np.uint8)


def _details() -> list[Piece]:
    """Return what the head has: eyes, their pupils, a mouth."""
    pieces = []
    for x in (-0.06, 0.06):
        white, faces = ball((x, 1.765, 0.142), (0.036, 0.042, 0.03), 8, 14)
        pieces.append(Piece(white, faces, np.array((225, 225, 220), np.uint8)))
        pupil, faces = ball((x, 1.765, 0.16), (0.018, 0.022, 0.018), 6, 12)
        pieces.append(Piece(pupil, faces, np.array((6, 6, 8), np.uint8)))
    mouth, faces = ball((0.0, 1.655, 0.14), (0.045, 0.012, 0.02), 8, 14)
    # Its corners go up.
    mouth[:, 1] += 5.0 * mouth[:, 0] * mouth[:, 0]
    pieces.append(Piece(mouth, faces, np.array((96, 10, 14), np.uint8)))
    return pieces


def _cycle(
    keys: int, seconds: float, angle: Callable[[float], tuple[float, float]]
) -> tuple[list[float], list[float]]:
    """Return the angles and their slopes a second at keys; ``angle`` takes and is by the phase."""
    found = [angle(2.0 * math.pi * key / keys) for key in range(keys + 1)]
    return [a for a, _ in found], [b * 2.0 * math.pi / seconds for _, b in found]


def _swing(mean: float, size: float, lead: float) -> Callable[[float], tuple[float, float]]:
    """Return an angle that goes to and fro, and its slope by the phase."""
    return lambda p: (mean + size * math.sin(p + lead), size * math.cos(p + lead))


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class Motion:
    """Channels of one animation, as they are added."""

    def __init__(self, nodes: dict[str, int], seconds: float, keys: int) -> None:
        self.channels: list[Channel] = []
        self._nodes, self._seconds, self._keys = nodes, seconds, keys
        self._times = (np.arange(keys + 1) * (seconds / keys)).astype(np.float32)

    def turn(
        self,
        joint: str,
        axis: Sequence[float],
        angle: Callable[[float], tuple[float, float]],
        first: tuple[Sequence[float], float] | None = None,
    ) -> None:
        """Turn a joint by an angle of the phase, after a turn that does not change."""
        degrees, slopes = _cycle(self._keys, self._seconds, angle)
        values, rates = turns(axis, degrees), turn_slopes(axis, degrees, slopes)
        if first is not None:
            still = np.repeat(turns(first[0], [first[1]]), len(degrees), axis=0)
            values, rates = after(values, still), after(rates, still)
        self._add(joint, "rotation", spline_keys(values, rates))

    def move(self, joint: str, keys: Floats, slopes: Floats) -> None:
        """Move a joint through places, (K,3), beside its parent."""
        self._add(joint, "translation", spline_keys(keys, slopes))

    def blink(self, *times: float) -> None:
        """Shut the eyes for a moment at times, and open them again, at once."""
        moments, scales = [0.0], [(1.0, 1.0, 1.0)]
        for time in times:
            moments += [time, time + 0.12]
            scales += [(1.0, 0.08, 1.0), (1.0, 1.0, 1.0)]
        values = np.array(scales, np.float32)
        when = np.array(moments, np.float32)
        self.channels.append(Channel(self._nodes["eyes"], "scale", when, values, "STEP"))

    def _add(self, joint: str, path: str, values: NDArray[np.float32]) -> None:
        node = self._nodes[joint]
        self.channels.append(Channel(node, path, self._times, values, "CUBICSPLINE"))


def _walk(nodes: dict[str, int]) -> list[Channel]:
    """Return two steps on the spot."""
    walk = Motion(nodes, WALK, WALK_KEYS)
    phases = [2.0 * math.pi * key / WALK_KEYS for key in range(WALK_KEYS + 1)]
    rate = 2.0 * math.pi / WALK
    hips = SKELETON["hips"][1]
    walk.move(
        "hips",
        np.array([(0.012 * math.sin(p), hips[1] - 0.03 + 0.026 * math.cos(2 * p), 0.0)
                  for p in phases]),
        np.array([(0.012 * rate * math.cos(p), -0.052 * rate * math.sin(2 * p), 0.0)
                  for p in phases]),
    )  # fmt: skip
    walk.turn("hips", Y, _swing(0.0, -7.0, 0.0))
    walk.turn("chest", Y, _swing(0.0, 12.0, 0.0))
    walk.turn("neck", Y, _swing(0.0, -6.0, 0.0))
    for side, lead, sign in (("left", 0.0, 1.0), ("right", math.pi, -1.0)):
        # Forward is a turn by a negative angle about x; the knee bends while the leg comes forward.
        walk.turn(f"thigh.{side}", X, _swing(-4.0, -27.0, lead))
        walk.turn(f"shin.{side}", X, _swing(24.0, 22.0, lead + 0.5 * math.pi + 0.3))
        walk.turn(f"foot.{side}", X, _swing(-6.0, 13.0, lead + 0.5))
        walk.turn(f"arm.{side}", X, _swing(4.0, 26.0, lead), (Z, -36.0 * sign))
        walk.turn(f"forearm.{side}", X, _swing(-24.0, 12.0, lead))
    walk.blink(0.5)
    return walk.channels


def _wave(nodes: dict[str, int]) -> list[Channel]:
    """Return a greeting with the left arm."""
    wave = Motion(nodes, WAVE, WAVE_KEYS)
    wave.turn("arm.left", Z, _swing(88.0, 4.0, 0.0))
    wave.turn("forearm.left", Z, lambda p: (34.0 + 24.0 * math.sin(2 * p), 48.0 * math.cos(2 * p)))
    wave.turn(
        "hand.left", Z, lambda p: (14.0 * math.sin(2 * p - 0.8), 28.0 * math.cos(2 * p - 0.8))
    )
    wave.turn("arm.right", X, _swing(0.0, 5.0, 0.0), (Z, 34.0))
    wave.turn("forearm.right", X, _swing(-16.0, 4.0, 1.0))
    wave.turn("spine", Z, _swing(-2.0, 2.5, 0.0))
    wave.turn("head", Z, _swing(-5.0, 6.0, 0.5))
    wave.blink(0.6, 1.5)
    return wave.channels


def make_figure(folder: Path) -> None:
    """
    Write a figure: one skinned mesh of 18 joints, joints uint8, weights uint8 in 255ths.

    Animations: "walk", 1.2 seconds, and "wave", 2 seconds: CUBICSPLINE rotations and translations,
    and a STEP scale, which shuts the eyes. The node of the mesh hangs below one that moves and
    scales it, each axis differently: glTF has that ignored for what a skin moves.
    """
    glb = GlbFile()
    points, faces = _skin_of(_body)
    details = merged(_details())
    weights = np.zeros((len(details.points), len(NAMES)))
    lids = len(details.points) - len(_details()[-1].points)
    weights[:lids, NAMES.index("eyes")] = 1.0
    weights[lids:, NAMES.index("head")] = 1.0
    piece = merged([Piece(points, faces, _colors(points)), details])
    joints, shares = _influences(np.concatenate([_weights(points, faces), weights]))
    normals = np.concatenate(
        [unit(_slope(points, _body)), smooth_normals(details.points, details.faces)]
    )
    attributes = attributes_of(piece, normals) | {"JOINTS_0": joints, "WEIGHTS_0": shares}
    material = add_material(glb, "clay", 0.6)
    mesh = glb.add_mesh("figure", attributes, piece.faces.astype(np.uint16), material)
    nodes: dict[str, int] = {}
    for name in reversed(NAMES):
        parent, place = SKELETON[name]
        start = np.zeros(3) if parent is None else np.array(SKELETON[parent][1])
        entry = {"name": name, "translation": (np.array(place) - start).round(6).tolist()}
        below = [nodes[child] for child in NAMES if SKELETON[child][0] == name]
        nodes[name] = glb.add("nodes", {**entry, "children": below} if below else entry)
    binds = np.tile(np.eye(4, dtype=np.float32), (len(NAMES), 1, 1))
    binds[:, :3, 3] = -np.array([SKELETON[name][1] for name in NAMES])
    skin = glb.add_skin("figure", [nodes[name] for name in NAMES], binds, nodes["hips"])
    body = glb.add("nodes", {"name": "figure", "mesh": mesh, "skin": skin})
    stretched = {"name": "stretched", "translation": [3.0, 1.0, 0.0], "scale": [1.5, 0.5, 2.0]}
    above = glb.add("nodes", {**stretched, "children": [body]})
    ground = add_ground(glb, 1.1, (0.36, 0.38, 0.34))
    glb.add_animation("walk", _walk(nodes))
    glb.add_animation("wave", _wave(nodes))
    glb.add("scenes", {"name": "scene", "nodes": [nodes["hips"], above, ground]})
    glb.save(folder / "figure.glb")
