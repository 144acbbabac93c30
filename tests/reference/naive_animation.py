"""
Where the vertices of an animated glTF file are at a time, slowly, from the file and nothing else.

Reads the JSON and the buffers itself and follows the specification's equations with plain numbers
and matrices of float64. Shares no code with what it checks.

References
----------
Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022): 3.5.3 (transforms), 3.6.2 (accessors,
sparse ones, normalised integers), 3.7.2.2 (morph targets), 3.7.3.3 (skinned meshes), 3.11
(animations) and Appendix C (interpolation).
"""

from __future__ import annotations

import base64
import json
import math
import struct
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

import numpy as np

CODES = {5120: "b", 5121: "B", 5122: "h", 5123: "H", 5125: "I", 5126: "f"}
MAX = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TRIANGLES = 4
ROUNDED_SUM = 1e-5
"""How far from 1 weights may sum to by rounding."""


class Posed(NamedTuple):
    """A primitive of triangles where it is seen."""

    node: str
    positions: np.ndarray
    """(V,3) float64, world space"""
    normals: np.ndarray | None
    """(V,3) float64, of length 1; None if the file has none"""
    faces: np.ndarray
    """(F,3)"""


class NaiveGltf:
    """A glTF file, .glb or .gltf."""

    def __init__(self, path):
        data = Path(path).read_bytes()
        chunk = None
        if data[:4] == b"glTF":
            (length,) = struct.unpack_from("<I", data, 12)
            self.document = json.loads(data[20 : 20 + length])
            if len(data) > 28 + length:
                (size,) = struct.unpack_from("<I", data, 20 + length)
                chunk = data[28 + length : 28 + length + size]
        else:
            self.document = json.loads(data)
        self.buffers = [
            chunk if "uri" not in one else _fetched(one["uri"], Path(path).parent)
            for one in self.document.get("buffers", [])
        ]
        self._known = {}
        self.animations = [
            (one.get("name"), max(self._numbers(s["input"])[-1][0] for s in one["samplers"]))
            for one in self.document.get("animations", [])
        ]
        """Name (None if it has none) and time of the last key, seconds, of each animation."""

    def pose(self, time=None, animation=0):
        """Return every primitive of triangles, `Posed`, in the order of the nodes of the scene."""
        nodes = self._nodes_at(time, animation)
        worlds, order = {}, []
        chosen = self.document["scenes"][self.document.get("scene", 0)]
        waiting = [(root, np.eye(4)) for root in reversed(chosen["nodes"])]
        while waiting:
            number, above = waiting.pop()
            worlds[number] = above @ _local(nodes[number])
            order.append(number)
            below = nodes[number].get("children", [])
            waiting += [(child, worlds[number]) for child in reversed(below)]
        found = []
        for number in order:
            if "mesh" in nodes[number]:
                found += self._primitives(nodes[number], number, worlds)
        return found

    def key_times(self, animation=0):
        """Return all times of keys of an animation, ascending."""
        samplers = self.document["animations"][animation]["samplers"]
        return sorted({row[0] for one in samplers for row in self._numbers(one["input"])})

    def _nodes_at(self, time, animation):
        """Return the nodes with what an animation makes of them (3.11.1)."""
        nodes = [dict(node) for node in self.document["nodes"]]
        if time is None:
            return nodes
        entry = self.document["animations"][animation]
        for channel in entry["channels"]:
            number, path = channel["target"].get("node"), channel["target"]["path"]
            if number is None:
                continue
            sampler = entry["samplers"][channel["sampler"]]
            nodes[number][path] = self._value(sampler, path, time)
        return nodes

    def _value(self, sampler, path, time):
        """Return what a sampler says at a time (Appendix C)."""
        times = [row[0] for row in self._numbers(sampler["input"])]
        kind = sampler.get("interpolation", "LINEAR")
        rows = self._numbers(sampler["output"])
        if path == "weights":
            flat = [row[0] for row in rows]
            width = len(flat) // (len(times) * (3 if kind == "CUBICSPLINE" else 1))
            rows = [flat[k : k + width] for k in range(0, len(flat), width)]
        if kind == "CUBICSPLINE":
            before, values, after = rows[0::3], rows[1::3], rows[2::3]
        else:
            values = rows
        if time <= times[0]:
            return values[0]
        if time >= times[-1]:
            return values[-1]
        k = max(index for index, key in enumerate(times) if key <= time)
        length = times[k + 1] - times[k]
        t = (time - times[k]) / length
        if kind == "STEP":
            return values[k]
        if kind == "CUBICSPLINE":
            mixed = [
                (2 * t**3 - 3 * t**2 + 1) * v0
                + length * (t**3 - 2 * t**2 + t) * b0
                + (-2 * t**3 + 3 * t**2) * v1
                + length * (t**3 - t**2) * a1
                for v0, b0, v1, a1 in zip(
                    values[k], after[k], values[k + 1], before[k + 1], strict=True
                )
            ]
            return _unit(mixed) if path == "rotation" else mixed
        if path == "rotation":
            return _slerp(values[k], values[k + 1], t)
        return [(1 - t) * a + t * b for a, b in zip(values[k], values[k + 1], strict=True)]

    def _primitives(self, node, number, worlds):
        """Return the primitives of a node's mesh, morphed, then skinned or placed."""
        mesh = self.document["meshes"][node["mesh"]]
        found = []
        for primitive in mesh["primitives"]:
            if primitive.get("mode", TRIANGLES) != TRIANGLES:
                continue
            named = primitive["attributes"]
            positions = np.array(self._numbers(named["POSITION"]))
            normals = np.array(self._numbers(named["NORMAL"])) if "NORMAL" in named else None
            targets = primitive.get("targets", [])
            weights = node.get("weights", mesh.get("weights", [0.0] * len(targets)))
            for weight, target in zip(weights, targets, strict=True):
                if "POSITION" in target:
                    positions = positions + weight * np.array(self._numbers(target["POSITION"]))
                if "NORMAL" in target and normals is not None:
                    normals = normals + weight * np.array(self._numbers(target["NORMAL"]))
            matrices = np.broadcast_to(worlds[number], (len(positions), 4, 4))
            if "skin" in node:
                matrices = self._blended(self.document["skins"][node["skin"]], named, worlds)
            placed = np.einsum("vij,vj->vi", matrices[:, :3, :3], positions) + matrices[:, :3, 3]
            turned = None
            if normals is not None:
                turned = np.einsum("vij,vj->vi", _cofactors(matrices[:, :3, :3]), normals)
                lengths = np.linalg.norm(turned, axis=1, keepdims=True)
                turned = turned / np.where(lengths > 0.0, lengths, 1.0)
            count = len(positions)
            faces = np.arange(count)
            if "indices" in primitive:
                faces = np.array(self._numbers(primitive["indices"]), int)[:, 0]
            name = str(node.get("name", number))
            found.append(Posed(name, placed, turned, faces.reshape(-1, 3)))
        return found

    def _blended(self, skin, named, worlds):
        """Return the matrix of each vertex: the weighted sum of those of its joints (3.7.3.3)."""
        joints = skin["joints"]
        binds = [np.eye(4)] * len(joints)
        if "inverseBindMatrices" in skin:
            rows = self._numbers(skin["inverseBindMatrices"])
            binds = [np.array(row).reshape(4, 4).T for row in rows]
        matrices = [worlds[joint] @ bind for joint, bind in zip(joints, binds, strict=False)]
        blended = 0.0
        sets = range(sum(name.startswith("JOINTS_") for name in named))
        shares = [np.array(self._numbers(named[f"WEIGHTS_{k}"])) for k in sets]
        total = sum(one.sum(axis=1, keepdims=True) for one in shares)
        # They have to sum to 1: where they do not, they are scaled.
        total = np.where(np.abs(total - 1.0) <= ROUNDED_SUM, 1.0, total)
        for k in sets:
            numbers = np.array(self._numbers(named[f"JOINTS_{k}"]), int)
            for joint, weight in zip(numbers.T, (shares[k] / total).T, strict=True):
                blended = blended + weight[:, None, None] * np.array(matrices)[joint]
        return blended

    def _numbers(self, index):
        """Return the rows of an accessor as lists of float (3.6.2)."""
        if index not in self._known:
            self._known[index] = self._read(index)
        return self._known[index]

    def _read(self, index):
        accessor = self.document["accessors"][index]
        width, kind = WIDTHS[accessor["type"]], accessor["componentType"]
        count = accessor["count"]
        rows = [[0] * width for _ in range(count)]
        if "bufferView" in accessor:
            place = accessor.get("byteOffset", 0)
            rows = self._rows(accessor["bufferView"], place, count, width, kind)
        sparse = accessor.get("sparse")
        if sparse:
            where, what = sparse["indices"], sparse["values"]
            places = self._rows(
                where["bufferView"], where.get("byteOffset", 0), sparse["count"], 1,
                where["componentType"],
            )  # fmt: skip
            values = self._rows(
                what["bufferView"], what.get("byteOffset", 0), sparse["count"], width, kind
            )
            for (row,), value in zip(places, values, strict=True):
                rows[row] = value
        if accessor.get("normalized"):
            return [[max(x / MAX[kind], -1.0) for x in row] for row in rows]
        return [[float(x) for x in row] for row in rows]

    def _rows(self, view, offset, count, width, kind):
        """Return numbers of a buffer view as they are stored."""
        held = self.document["bufferViews"][view]
        layout = struct.Struct(f"<{width}{CODES[kind]}")
        stride = held.get("byteStride", layout.size)
        start = held.get("byteOffset", 0) + offset
        data = self.buffers[held["buffer"]]
        return [list(layout.unpack_from(data, start + stride * k)) for k in range(count)]


def _fetched(uri, folder):
    """Return the bytes that a URI names."""
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    return (folder / unquote(uri)).read_bytes()


def _local(node):
    """Return the matrix of a node beside its parent (3.5.3)."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    # Unit quaternions have the roundings of float32.
    x, y, z, w = _unit(node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _slerp(first, second, t):
    """Return the rotation between two, the shorter way (Appendix C.4)."""
    first, second = _unit(first), _unit(second)
    cosine = sum(a * b for a, b in zip(first, second, strict=True))
    sign = -1.0 if cosine < 0.0 else 1.0
    angle = math.acos(min(abs(cosine), 1.0))
    if angle < 1e-6:
        return _unit([(1 - t) * a + t * sign * b for a, b in zip(first, second, strict=True)])
    start = math.sin(angle * (1 - t)) / math.sin(angle)
    end = sign * math.sin(angle * t) / math.sin(angle)
    return _unit([start * a + end * b for a, b in zip(first, second, strict=True)])


def _unit(vector):
    """Scale numbers to length 1; zeros stay."""
    length = math.sqrt(sum(x * x for x in vector))
    return [x / length for x in vector] if length else list(vector)


def _cofactors(matrices):
    """Return what turns normals, (V,3,3): the inverse transposes, up to their size."""
    a, b, c = np.moveaxis(matrices, 2, 0)
    found = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=2)
    return found * np.where(np.linalg.det(matrices) < 0.0, -1.0, 1.0)[:, None, None]
