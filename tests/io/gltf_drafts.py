"""Write glTF files with any extension, for tests: what they hold is said in JSON and arrays."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

COMPONENTS = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125,
              "float32": 5126}  # fmt: skip
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

CORNERS = np.uint16([0, 1, 2, 0, 2, 3])
POSITION = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
NORMAL = np.tile(np.float32([0, 0, 1]), (4, 1))
TEXCOORD = np.float32([[0, 1], [1, 1], [1, 0], [0, 0]])


def quad(*left_out):
    """Return the attributes of an upright square of side 2 that faces +z, without some."""
    whole = {"POSITION": POSITION, "NORMAL": NORMAL, "TEXCOORD_0": TEXCOORD}
    return {name: rows for name, rows in whole.items() if name not in left_out}


class Draft:
    """A glTF file in the making; its nodes are all at the top."""

    def __init__(self):
        self.binary = bytearray()
        self.header = {"asset": {"version": "2.0"}, "buffers": []}

    def add(self, section, **entry):
        """Append an entry to a list of the header; return its number."""
        self.header.setdefault(section, []).append(entry)
        return len(self.header[section]) - 1

    def use(self, *names, required=False):
        """List extensions as used, and as required."""
        keys = ["extensionsUsed"] + ["extensionsRequired"] * required
        for key in keys:
            listed = self.header.setdefault(key, [])
            listed += [name for name in names if name not in listed]
        return self

    def store(self, content):
        """Append bytes to the buffer; return where they are, as a buffer view says it."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        place = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content)}
        self.binary += content
        return place

    def view(self, content, **more):
        """Append a buffer view; return its number."""
        return self.add("bufferViews", **self.store(bytes(content)), **more)

    def say(self, rows, **more):
        """Append an accessor that says what an array is, without its bytes; return its number."""
        rows = rows if rows.ndim == 2 else rows[:, None]
        return self.add(
            "accessors", componentType=COMPONENTS[str(rows.dtype)], count=len(rows),
            type=TYPES[rows.shape[1]], **more,
        )  # fmt: skip

    def accessor(self, rows, **more):
        """Append an accessor, each row beginning at a multiple of four bytes; return its number."""
        if rows.ndim == 1:
            return self.say(rows, bufferView=self.view(rows.tobytes()), **more)
        width = rows[0].nbytes
        padded = np.zeros((len(rows), -(-width // 4) * 4), np.uint8)
        padded[:, :width] = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), -1)
        view = self.view(padded.tobytes(), byteStride=padded.shape[1])
        return self.say(rows, bufferView=view, **more)

    def mesh(self, attributes, corners=CORNERS, **primitive):
        """Append a mesh of one primitive; attributes are arrays or numbers of accessors."""
        primitive["attributes"] = {
            name: rows if isinstance(rows, int) else self.accessor(rows)
            for name, rows in attributes.items()
        }
        if corners is not None:
            primitive["indices"] = self.accessor(corners)
        return self.add("meshes", primitives=[primitive])

    def show(self, mesh, **node):
        """Append a node that shows a mesh; return its number."""
        return self.add("nodes", mesh=mesh, **node)

    def picture(self, content, kind="image/png"):
        """Append an image; return its number."""
        return self.add("images", bufferView=self.view(content), mimeType=kind)

    def textured(self, **texture):
        """Show a square with a texture of its base colour; return the file."""
        use = {"index": self.add("textures", **texture)}
        material = self.add("materials", pbrMetallicRoughness={"baseColorTexture": use},
                            extensions={"KHR_materials_unlit": {}})  # fmt: skip
        self.show(self.mesh(quad(), material=material))
        return self.use("KHR_materials_unlit")

    def save(self, path: Path):
        """Write a .glb file; return its path."""
        if not self.header["buffers"]:
            self.header["buffers"].append({})
        self.header["buffers"][0] = {"byteLength": len(self.binary)}
        header = dict(self.header)
        nodes = header.get("nodes", [])
        below = {child for node in nodes for child in node.get("children", [])}
        header["scenes"] = [{"nodes": [n for n in range(len(nodes)) if n not in below]}]
        text = json.dumps(header).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.binary) + b"\0" * (-len(self.binary) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        return path
