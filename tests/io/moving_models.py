"""Write small glTF files number by number, of things that move, right or wrong."""

import base64
import json

import numpy as np

COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Gltf:
    """A file that is filled piece by piece; ``document`` may be changed at will."""

    def __init__(self):
        self.bytes = b""
        self.document = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [],
            "accessors": [], "bufferViews": [], "meshes": [],
        }  # fmt: skip

    def view(self, array):
        """Add the bytes of an array; return the number of their view."""
        self.bytes += b"\0" * (-len(self.bytes) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": array.nbytes}
        self.bytes += array.tobytes()
        return self.append("bufferViews", entry)

    def array(self, values, kind="f4", **said):
        """Add rows of numbers; return the number of their accessor."""
        array = np.ascontiguousarray(values, f"<{kind}")
        rows = array.reshape(len(array), -1)
        entry = {
            "bufferView": self.view(array), "componentType": COMPONENTS[kind],
            "count": len(rows), "type": KINDS[rows.shape[1]], **said,
        }  # fmt: skip
        return self.append("accessors", entry)

    def sparse(self, count, places, values):
        """Add three columns that are 0 but for some rows; return the number of their accessor."""
        sparse = {
            "count": len(places),
            "indices": {"bufferView": self.view(np.array(places, "<u2")), "componentType": 5123},
            "values": {"bufferView": self.view(np.array(values, "<f4"))},
        }
        entry = {"componentType": 5126, "count": count, "type": "VEC3", "sparse": sparse}
        return self.append("accessors", entry)

    def append(self, section, entry):
        """Add an entry to a list of the document; return its number."""
        entries = self.document.setdefault(section, [])
        entries.append(entry)
        return len(entries) - 1

    def save(self, path):
        """Write the file, and return its path."""
        content = base64.b64encode(self.bytes).decode()
        uri = f"data:application/octet-stream;base64,{content}"
        document = {**self.document, "buffers": [{"byteLength": len(self.bytes), "uri": uri}]}
        path.write_text(json.dumps(document))
        return path


STRIP = np.float32([(x, y, 0.1 * x * y) for y in range(5) for x in (-0.5, 0.5)])
"""Vertices of a strip along y."""

STRIP_FACES = [(n, n + 1, n + 3) for n in range(0, 8, 2)] + [
    (n, n + 3, n + 2) for n in range(0, 8, 2)
]

JOINTS = np.zeros((10, 4), int)
JOINTS[:] = (0, 1, 2, 0)
WEIGHTS = np.float32(
    [
        (max(0, 1 - y / 2), min(y / 2, 2 - y / 2), max(0, y / 2 - 1), 0)
        for y in range(5)
        for _ in "ab"
    ]
)
"""Of three joints at y = 0, 2 and 4."""


def arm(kinds=("u1", "f4"), normals=True, weights=WEIGHTS, joints=JOINTS, **said):
    """
    Return a strip on three joints: nodes 1, 2 and 3; its own node 0 is turned and moved.

    Of an integer kind, weights are normalized. The animation ``"bend"`` turns joints 2 and 3, moves
    1 and stretches 3.
    """
    model = Gltf()
    stored = np.asarray(weights)
    if kinds[1] != "f4":
        stored = np.round(stored * np.iinfo(kinds[1]).max)
    attributes = {
        "POSITION": model.array(STRIP),
        "JOINTS_0": model.array(joints, kinds[0]),
        "WEIGHTS_0": model.array(stored, kinds[1], normalized=kinds[1] != "f4"),
    }
    if normals:
        raw = np.float32([(0.3 * x, 0.1, 1) for x, _, _ in STRIP])
        attributes["NORMAL"] = model.array(raw / np.linalg.norm(raw, axis=1)[:, None])
    indices = model.array(np.ravel(STRIP_FACES), "u2")
    model.append("meshes", {"primitives": [{"attributes": attributes, "indices": indices}]})
    model.document["nodes"] = [
        {"mesh": 0, "skin": 0, "translation": [7, 0, 0], "rotation": [1, 0, 0, 0]},
        {"name": "root", "children": [2], "translation": [0.25, 0, 0]},
        {"name": "elbow", "children": [3], "translation": [0, 2, 0], "rotation": [0, 0, 0.6, 0.8]},
        {"name": "hand", "translation": [0, 2, 0], "scale": [1, 1.5, 2]},
    ]
    model.document["scenes"] = [{"nodes": [0, 1]}]
    binds = np.tile(np.eye(4), (3, 1, 1))
    binds[:, 1, 3] = 0, -2, -4
    model.document["skins"] = [
        {
            "joints": [1, 2, 3], "skeleton": 1,
            "inverseBindMatrices": model.array(binds.transpose(0, 2, 1)), **said,
        }
    ]  # fmt: skip
    return model


def animate(model, target, path, times, values, interpolation="LINEAR", kind="f4", number=0):
    """Add a channel to an animation of a model."""
    animations = model.document.setdefault("animations", [])
    while len(animations) <= number:
        animations.append({"channels": [], "samplers": [], "name": f"move {len(animations)}"})
    animation = animations[number]
    values = np.asarray(values)
    shaped = values.reshape(-1, values.shape[-1]) if path != "weights" else values.reshape(-1, 1)
    animation["samplers"].append(
        {
            "input": model.array(times), "interpolation": interpolation,
            "output": model.array(shaped, kind, normalized=kind != "f4"),
        }
    )  # fmt: skip
    animation["channels"].append(
        {"sampler": len(animation["samplers"]) - 1, "target": {"node": target, "path": path}}
    )
    return model
