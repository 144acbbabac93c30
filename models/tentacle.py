"""Build a tentacle of eight joints, each vertex moved by up to four of them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from glb import Channel, GlbFile
from numpy.typing import NDArray
from pieces import Piece, add_ground, add_material, attributes_of, smooth_normals, tube, turns
from surfaces import Floats

JOINTS, LENGTH = 8, 4.0
RINGS, SIDES = 72, 20
BASE_RADIUS, TIP_RADIUS, FLARE = 0.42, 0.07, 0.3
SUCKERS, SUCKER_HEIGHT = 13, 0.16
SKIN, SPOTS, PALE = (92, 14, 60), (150, 36, 40), (235, 150, 120)
"""Linear colours of its back, of the rings on it, and of its suckers."""
KEYS, PERIOD = 8, 4.0
"""Keys, and seconds, of one swing."""


def _surface() -> tuple[Piece, Floats]:
    """Return the tentacle upright, its suckers at +z; and where each vertex is along it, 0..1."""
    along = 1.0 - np.arange(RINGS) / (RINGS - 1)
    rings, colors = [], []
    for s in along.tolist():
        flare = FLARE * max(0.0, 1.0 - 8.0 * s) * max(0.0, 1.0 - 8.0 * s)
        radius = TIP_RADIUS + (BASE_RADIUS - TIP_RADIUS) * (1.0 - s) + flare
        wave = 0.5 + 0.5 * math.cos(2.0 * math.pi * SUCKERS * s)
        for j in range(SIDES):
            angle = 2.0 * math.pi * j / SIDES
            front = max(0.0, math.cos(angle))
            front = front * front
            bump = radius * (1.0 + SUCKER_HEIGHT * (2.0 * wave - 1.0) * front)
            rings.append((bump * math.sin(angle), LENGTH * s, bump * math.cos(angle)))
            back = np.array(SKIN) + (np.array(SPOTS) - SKIN) * wave
            mix = min(1.0, 2.0 * front)
            colors.append(back * (1.0 - mix) + np.array(PALE) * mix * (0.6 + 0.4 * wave))
    points, faces = tube(np.array(rings).reshape(RINGS, SIDES, 3))
    ends = [colors[0], colors[-1]]
    piece = Piece(points, faces, np.round(np.array([*colors, *ends])).astype(np.uint8))
    return piece, np.concatenate([np.repeat(along, SIDES), [1.0, 0.0]])


def _influences(along: Floats) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """
    Return the joints and weights of vertices, (V,4) each: those of a uniform cubic B-spline.

    Where two of the four are one joint, at either end, it gets the sum.
    """
    joints = np.zeros((len(along), 4), np.uint16)
    weights = np.zeros((len(along), 4))
    for vertex, s in enumerate(along.tolist()):
        # The first joint alone holds the foot.
        place = s * JOINTS - 1.0
        start = min(math.floor(place), JOINTS - 2)
        t = place - start
        shares = (
            (1.0 - t) * (1.0 - t) * (1.0 - t) / 6.0,
            (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
            (-3.0 * t * t * t + 3.0 * t * t + 3.0 * t + 1.0) / 6.0,
            t * t * t / 6.0,
        )
        found: dict[int, float] = {}
        for k, share in enumerate(shares):
            joint = min(max(start - 1 + k, 0), JOINTS - 1)
            found[joint] = found.get(joint, 0.0) + share
        joints[vertex, : len(found)] = list(found)
        weights[vertex, : len(found)] = list(found.values())
    return joints, weights.astype(np.float32)


def _sway(nodes: list[int]) -> list[Channel]:
    """Return a slow swing: turned to and fro by 110 degrees, and waves that run up to the tip."""
    times = np.arange(KEYS + 1, dtype=np.float32) * np.float32(PERIOD / KEYS)
    # The middle key is the negative quaternion of the same turn: interpolation goes the short way.
    about = turns((0.0, 1.0, 0.0), [-55.0, 55.0, -55.0]) * np.array([[1.0], [-1.0], [1.0]])
    halves = np.array([0.0, PERIOD / 2.0, PERIOD], np.float32)
    channels = [Channel(nodes[0], "rotation", halves, about.astype(np.float32))]
    for number, node in enumerate(nodes[1:], start=1):
        phases = [2.0 * math.pi * key / KEYS - 0.8 * number for key in range(KEYS + 1)]
        bend = turns((1.0, 0.0, 0.0), [14.0 + 20.0 * math.sin(phase) for phase in phases])
        channels.append(Channel(node, "rotation", times, bend.astype(np.float32)))
    return channels


def _curl(nodes: list[int]) -> list[Channel]:
    """Return a curl to a spiral and back, of three keys."""
    times = np.array([0.0, 1.5, 3.0], np.float32)
    channels = []
    for number, node in enumerate(nodes[1:], start=1):
        bent = 18.0 + 8.0 * number
        keys = turns((1.0, 0.0, 0.0), [0.0, bent, 0.0]).astype(np.float32)
        channels.append(Channel(node, "rotation", times, keys))
    return channels


def make_tentacle(folder: Path) -> None:
    """
    Write a tentacle: one skinned mesh of eight joints in a chain, and a ground.

    Joints are uint16, weights float32. Animations: "sway", 4 seconds, and "curl", 3 seconds, both
    with LINEAR rotations; the first joint of "sway" turns by 110 degrees from key to key.
    """
    glb = GlbFile()
    piece, along = _surface()
    joints, weights = _influences(along)
    attributes = attributes_of(piece, smooth_normals(piece.points, piece.faces))
    attributes |= {"JOINTS_0": joints, "WEIGHTS_0": weights}
    material = add_material(glb, "skin", 0.35)
    mesh = glb.add_mesh("tentacle", attributes, piece.faces.astype(np.uint16), material)
    step = LENGTH / (JOINTS - 1)
    nodes = []
    for number in reversed(range(JOINTS)):
        entry = {"name": f"joint {number}", "translation": [0.0, step if number else 0.0, 0.0]}
        if nodes:
            entry["children"] = [nodes[-1]]
        nodes.append(glb.add("nodes", entry))
    nodes.reverse()
    binds = np.tile(np.eye(4, dtype=np.float32), (JOINTS, 1, 1))
    binds[:, 1, 3] = -step * np.arange(JOINTS)
    skin = glb.add_skin("tentacle", nodes, binds, nodes[0])
    body = glb.add("nodes", {"name": "tentacle", "mesh": mesh, "skin": skin})
    ground = add_ground(glb, 3.0, (0.5, 0.42, 0.3))
    glb.add_animation("sway", _sway(nodes))
    glb.add_animation("curl", _curl(nodes))
    glb.add("scenes", {"name": "scene", "nodes": [nodes[0], body, ground]})
    glb.save(folder / "tentacle.glb")
