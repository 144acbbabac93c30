"""Random skeletons, weights, morph targets and keys of all types are posed by the equations."""

from __future__ import annotations

import numpy as np
import pytest
from naive_animation import NaiveGltf
from sample_models import Channel, GlbFile

import rasterjit as rj

FLOAT64_ROUNDING = 1e-12
"""Greatest error of positions, in largest coordinates."""
FLOAT32_ROUNDING = 1e-6
"""Greatest error of unit normals: they are read and kept in float32, and blended axes lean."""
MAX = {np.uint8: 255, np.uint16: 65535, np.int8: 127, np.int16: 32767}


def quaternion(random, largest):
    """Return a rotation by at most so many degrees, of either sign."""
    axis = random.normal(size=3)
    half = np.radians(random.uniform(0.0, largest)) / 2.0
    turn = np.append(np.sin(half) * axis / np.linalg.norm(axis), np.cos(half))
    return turn * random.choice([-1.0, 1.0])


def placed(random, mirrors=False):
    """Return the properties of a node: parts of a transform, some of them, or a matrix."""
    scale = random.uniform(0.7, 1.4, 3)
    if mirrors:
        scale[random.integers(3)] *= -1.0
    entry = {
        "translation": random.uniform(-1.0, 1.0, 3).tolist(),
        "rotation": quaternion(random, 40.0).tolist(),
        "scale": scale.tolist(),
    }
    if not mirrors:
        for name in list(entry):
            if random.random() < 0.25:
                del entry[name]
    return entry


def shares(random, rows, sets, kind):
    """Return weights that sum to 1, (rows, 4 * sets), of a type."""
    drawn = random.uniform(0.0, 1.0, (rows, 4 * sets)) * (random.random((rows, 4 * sets)) < 0.7)
    drawn[:, 0] += 0.1
    drawn /= drawn.sum(axis=1, keepdims=True)
    if kind is np.float32:
        return drawn.astype(np.float32)
    whole = np.floor(drawn * MAX[kind]).astype(int)
    whole[:, 0] += MAX[kind] - whole.sum(axis=1)
    return whole.astype(kind)


def channel(random, node, path, targets):
    """Return a channel of random keys, held, joined or smooth, of floats or normalised."""
    count = int(random.integers(1, 6))
    kind = random.choice(["STEP", "LINEAR", "CUBICSPLINE"]) if count > 1 else "STEP"
    times = np.cumsum(random.uniform(0.1, 0.6, count)).astype(np.float32)
    width = {"translation": 3, "rotation": 4, "scale": 3, "weights": targets}[path]
    if path == "rotation":
        keys = np.array([quaternion(random, 170.0) for _ in range(count)])
    elif path == "scale":
        keys = random.uniform(0.7, 1.4, (count, 3))
    else:
        keys = random.uniform(0.0, 1.0, (count, width))
    if kind == "CUBICSPLINE":
        slopes = random.normal(scale=0.3, size=(2, count, width))
        keys = np.stack([slopes[0], keys, slopes[1]], axis=1).reshape(-1, width)
    values = keys.astype(np.float32)
    if path in ("rotation", "weights") and kind != "CUBICSPLINE" and random.random() < 0.5:
        one = random.choice([np.int8, np.int16] if path == "rotation" else [np.uint8, np.uint16])
        values = np.round(keys * MAX[one]).astype(one)
    return Channel(node, path, times, values.reshape(-1) if path == "weights" else values, kind)


def write(random, path):
    """Write a random file: a mesh with a skin or without, with morph targets or without."""
    glb = GlbFile()
    rows, is_skinned = int(random.integers(6, 30)), random.random() < 0.8
    count, targets = int(random.integers(2, 9)), int(random.integers(0, 4))
    attributes = {"POSITION": random.uniform(-1.0, 1.0, (rows, 3)).astype(np.float32)}
    has_normals = random.random() < 0.7
    if has_normals:
        normals = random.normal(size=(rows, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        attributes["NORMAL"] = normals.astype(np.float32)
    if is_skinned:
        sets, kind = int(random.integers(1, 3)), random.choice([np.float32, np.uint8, np.uint16])
        numbers = random.integers(0, count, (rows, 4 * sets))
        weights = shares(random, rows, sets, kind)
        whole = random.choice([np.uint8, np.uint16])
        for k in range(sets):
            columns = slice(4 * k, 4 * k + 4)
            attributes[f"JOINTS_{k}"] = np.ascontiguousarray(numbers[:, columns]).astype(whole)
            attributes[f"WEIGHTS_{k}"] = np.ascontiguousarray(weights[:, columns])
    moved = []
    for _ in range(targets):
        change = random.normal(scale=0.2, size=(rows, 3))
        change[random.random(rows) < random.choice([0.0, 0.8])] = 0.0
        one = {"POSITION": change.astype(np.float32)}
        if has_normals:
            one["NORMAL"] = random.normal(scale=0.1, size=(rows, 3)).astype(np.float32)
        moved.append(one)
    more = {}
    if targets and random.random() < 0.5:
        more["weights"] = random.uniform(0.0, 1.0, targets).tolist()
    faces = np.array([random.choice(rows, 3, replace=False) for _ in range(20)], np.uint16)
    material = glb.add("materials", {"name": "plain"})
    mesh = glb.add_mesh("mesh", attributes, faces, material, moved, **more)
    parents = [int(random.integers(-1, k)) if k else -1 for k in range(count)]
    mirrors = random.random() < 0.3
    for k in range(count):
        glb.add("nodes", {"name": f"joint {k}", **placed(random, mirrors and parents[k] < 0)})
    below = {"name": "shown", "mesh": mesh, **placed(random)}
    if targets and random.random() < 0.3:
        below["weights"] = random.uniform(0.0, 1.0, targets).tolist()
    if is_skinned:
        skin = {"joints": random.permutation(count).tolist()}
        if random.random() < 0.8:
            binds = np.tile(np.eye(4, dtype=np.float32), (count, 1, 1))
            binds[:, :3, :3] += random.normal(scale=0.1, size=(count, 3, 3)).astype(np.float32)
            binds[:, :3, 3] = random.normal(size=(count, 3))
            columns = binds.transpose(0, 2, 1).reshape(count, 16)
            skin["inverseBindMatrices"] = glb.add_accessor(columns)
        below["skin"] = glb.add("skins", skin)
    shown = glb.add("nodes", below)
    parents.append(int(random.integers(-1, count)))
    nodes = glb._document["nodes"]
    for k, parent in enumerate(parents):
        if parent >= 0:
            nodes[parent].setdefault("children", []).append(k)
    for number in range(int(random.integers(1, 3))):
        found = {
            (int(random.integers(count)), str(random.choice(["translation", "rotation", "scale"])))
            for _ in range(4)
        }
        if mirrors:
            found = {(node, one) for node, one in found if one != "scale"}
        if targets:
            found.add((shown, "weights"))
        found.add((0, "rotation"))
        channels = [channel(random, node, one, targets) for node, one in sorted(found)]
        glb.add_animation(f"animation {number}", channels)
    glb.add("scenes", {"nodes": [k for k, parent in enumerate(parents) if parent < 0]})
    glb.save(path)
    return path


@pytest.mark.parametrize("seed", range(60))
def test_random_files_are_posed_as_the_equations_say(seed, tmp_path):
    random = np.random.default_rng(seed)
    path = write(random, tmp_path / "random.glb")
    oracle, scene = NaiveGltf(path), rj.load(path)
    assert [one.name for one in scene.animations] == [name for name, _ in oracle.animations]
    moments = [(None, None)]
    for number, (_, duration) in enumerate(oracle.animations):
        keys = oracle.key_times(number)
        moments += [(float(time), number) for time in random.uniform(-0.2, duration + 0.2, 6)]
        moments += [(time, number) for time in keys[:3]]
    for time, number in moments:
        (expected,) = oracle.pose(time, number)
        shown = scene if number is None else scene.at(time, number)
        (node,) = shown.posed().nodes
        places = rj.transforms.apply(node.world_from_model, node.mesh.vertices)
        there = expected.positions[expected.faces]
        found = places[node.mesh.faces]
        rounding = FLOAT64_ROUNDING * max(1.0, np.abs(there).max())
        np.testing.assert_allclose(found, there, atol=rounding, rtol=0.0)
        if expected.normals is not None:
            axes = rj.transforms.inverse(node.world_from_model)[:3, :3]
            normals = node.mesh.normals.astype(float) @ axes
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            apart = np.abs(normals[node.mesh.faces] - expected.normals[expected.faces])
            assert apart.max() < FLOAT32_ROUNDING
