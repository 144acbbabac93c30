"""Small glTF models of what the Khronos sample set tests, made with the writer of models/."""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[2] / "models"))

from glb import Channel, GlbFile, encode_png, png_chunk
from gltf_scene import ball_arrays

__all__ = ["Channel", "GlbFile", "Model", "ball_arrays", "blank_png", "encode_png", "quad"]

QUAD_FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint16)


def blank_png(width, height, bits=8):
    """Return a black picture, which packs into next to nothing, and is never there as a whole."""
    row, packer = bytes(1 + (bits * width + 7) // 8), zlib.compressobj()
    pixels = b"".join([packer.compress(row) for _ in range(height)]) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    chunks = (b"IHDR", header), (b"IDAT", pixels), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(png_chunk(kind, data) for kind, data in chunks)


def quad(left, bottom, right, top, z=0.0, uv=(0, 0, 1, 1), name="TEXCOORD_0"):
    """Return the attributes of an upright rectangle that faces +z; its uv runs right and down."""
    positions = [[left, bottom, z], [right, bottom, z], [right, top, z], [left, top, z]]
    u0, v0, u1, v1 = uv
    return {
        "POSITION": np.array(positions, np.float32),
        "NORMAL": np.tile(np.float32([0, 0, 1]), (4, 1)),
        name: np.array([[u0, v1], [u1, v1], [u1, v0], [u0, v0]], np.float32),
    }


class Model:
    """A glTF model of rectangles and balls, one node for each."""

    def __init__(self):
        self.glb = GlbFile()
        self.nodes = []

    def texture(self, pixels, **sampler):
        """Add a picture, (H, W, 3|4) uint8; return a use of it."""
        png = encode_png(np.asarray(pixels, np.uint8))
        return {"index": self.glb.add_texture(png, "picture", sampler or None)}

    def material(self, name="m", *, unlit=False, extensions=None, **fields):
        """Add a material; what belongs to pbrMetallicRoughness is put there."""
        inner = {
            key: fields.pop(key)
            for key in list(fields)
            if key.startswith(("base", "metallic", "roughness"))
        }
        entry = {"name": name, "pbrMetallicRoughness": inner, **fields}
        extensions = dict(extensions or {})
        if unlit:
            extensions["KHR_materials_unlit"] = {}
        for extension in extensions:
            self.glb.use(extension)
        if extensions:
            entry["extensions"] = extensions
        return self.glb.add("materials", entry)

    def add(self, attributes, material, faces=QUAD_FACES, **node):
        """Add a mesh and a node that shows it."""
        mesh = self.glb.add_mesh(f"mesh {len(self.nodes)}", attributes, faces, material)
        self.nodes.append(self.glb.add("nodes", {"mesh": mesh, **node}))

    def save(self, path, **header):
        """Write the file, with further keys in its header; return its path."""
        self.glb.add("scenes", {"nodes": self.nodes})
        self.glb._document.update(header)
        self.glb.save(path)
        return path
