"""Sound glTF files whose meshes or pictures are packed by codecs, and files of things that move."""

from __future__ import annotations

import json
import runpy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fuzz_files.samples import Files, coordinates, glb_of, grid
from benchmarks.pairing import ROOT

_COMPONENTS = {"uint8": 5121, "uint16": 5123, "uint32": 5125, "float32": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

DRACO = "KHR_draco_mesh_compression"
MESHOPT = {"glb": "EXT_meshopt_compression", "gltf": "KHR_meshopt_compression"}
"""Each of the two names that the codec has, in one kind of file."""

PICTURES = {"glb": "ETC1S", "gltf": "UASTC"}
"""Each of the two codecs of KTX 2, in one kind of file."""


class _Draft:
    """A file that is filled piece by piece."""

    def __init__(self, *required: str) -> None:
        self.header: dict[str, Any] = {"asset": {"version": "2.0"}, "buffers": [{}]}
        if required:
            self.header |= {"extensionsUsed": [*required], "extensionsRequired": [*required]}
        self._buffer = b""

    def add(self, section: str, **entry: Any) -> int:
        """Append an entry to a list of the header; return its number."""
        self.header.setdefault(section, []).append(entry)
        return len(self.header[section]) - 1

    def store(self, content: bytes) -> dict[str, int]:
        """Append bytes to the buffer; return where they are."""
        place = {"buffer": 0, "byteOffset": len(self._buffer), "byteLength": len(content)}
        self._buffer += content + bytes(-len(content) % 4)
        return place

    def accessor(self, rows: NDArray[Any], view: int | None = None, stored: bool = True) -> int:
        """Append an accessor of rows, with their bytes, those of a view, or none."""
        if stored:
            view = self.add("bufferViews", **self.store(rows.tobytes()))
        place = {} if view is None else {"bufferView": view}
        width = 1 if rows.ndim == 1 else rows.shape[1]
        bounds = {}
        if rows.dtype == np.float32 and width == 3:
            bounds = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self.add(
            "accessors", **place, componentType=_COMPONENTS[str(rows.dtype)], count=len(rows),
            type=_TYPES[width], **bounds,
        )  # fmt: skip

    def show(self, primitive: dict[str, Any], mesh: dict[str, Any] | None = None) -> None:
        """Show a mesh of one primitive."""
        number = self.add("meshes", primitives=[primitive], **(mesh or {}))
        self.header["scenes"] = [{"nodes": [self.add("nodes", mesh=number)]}]

    def files(self, kind: str) -> Files:
        """Return the file, of a kind ``"glb"``, or ``"gltf"`` with its buffer beside it."""
        self.header["buffers"][0]["byteLength"] = len(self._buffer)
        if kind == "glb":
            return {"a.glb": glb_of(json.dumps(self.header).encode(), self._buffer)}
        self.header["buffers"][0]["uri"] = "skin.bin"
        # What is packed comes first: it is what is changed mostly.
        return {"skin.bin": self._buffer, "a.gltf": json.dumps(self.header).encode()}


def _arrays() -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
    """Return positions, normals and corners of the grid."""
    vertices, faces = grid()
    normals = np.tile(np.float32([0.0, 0.6, 0.8]), (len(vertices), 1))
    return vertices.astype(np.float32), normals, faces.reshape(-1).astype(np.uint32)


def draco(kind: str) -> Files:
    """Return a file whose mesh Draco packs."""
    import DracoPy

    positions, normals, corners = _arrays()
    stream = DracoPy.encode(positions, corners.reshape(-1, 3), normals=normals.astype(np.float64))
    places = {one["attribute_type"]: one["unique_id"] for one in DracoPy.decode(stream).attributes}
    draft = _Draft(DRACO)
    packed = {"bufferView": draft.add("bufferViews", **draft.store(stream)),
              "attributes": {"POSITION": places[0], "NORMAL": places[1]}}  # fmt: skip
    attributes = {
        name: draft.accessor(rows, stored=False)
        for name, rows in (("POSITION", positions), ("NORMAL", normals))
    }
    draft.show({"attributes": attributes, "indices": draft.accessor(corners, stored=False),
                "extensions": {DRACO: packed}})  # fmt: skip
    return draft.files(kind)


def meshopt(kind: str) -> Files:
    """Return a file whose arrays meshoptimizer packs."""
    from meshopt import encode_gltf_buffer

    name = MESHOPT[kind]
    draft = _Draft(name)
    spare = draft.add("buffers", byteLength=0, extensions={name: {"fallback": True}})

    def pack(rows: NDArray[Any], mode: str) -> int:
        """Append a packed array; return the number of its accessor."""
        size = rows[0].nbytes
        content = rows if mode != "ATTRIBUTES" else rows.view(np.uint8).reshape(len(rows), -1)
        version = [int(name.startswith("KHR"))] if mode == "ATTRIBUTES" else []
        packed = {**draft.store(encode_gltf_buffer(content, mode, *version)),
                  "count": len(rows), "byteStride": size, "mode": mode}  # fmt: skip
        begin = draft.header["buffers"][spare]["byteLength"]
        draft.header["buffers"][spare]["byteLength"] += rows.nbytes
        strided = {"byteStride": size} if mode == "ATTRIBUTES" else {}
        view = draft.add(
            "bufferViews", buffer=spare, byteOffset=begin, byteLength=rows.nbytes, **strided,
            extensions={name: packed},
        )  # fmt: skip
        return draft.accessor(rows, view, stored=False)

    positions, normals, corners = _arrays()
    attributes = {"POSITION": pack(positions, "ATTRIBUTES"), "NORMAL": pack(normals, "ATTRIBUTES")}
    draft.show({"attributes": attributes, "indices": pack(corners, "TRIANGLES")})
    return draft.files(kind)


def ktx2(kind: str) -> Files:
    """Return a file with a picture of KTX 2."""
    pictures = runpy.run_path(str(ROOT / "tests" / "io" / "ktx2_samples.py"))
    draft, name = _Draft("KHR_texture_basisu"), "KHR_texture_basisu"
    view = draft.add("bufferViews", **draft.store(pictures[PICTURES[kind]]))
    image = draft.add("images", bufferView=view, mimeType="image/ktx2")
    texture = draft.add("textures", extensions={name: {"source": image}})
    color = {"baseColorTexture": {"index": texture}}
    positions, normals, corners = _arrays()
    attributes = {
        "POSITION": draft.accessor(positions), "NORMAL": draft.accessor(normals),
        "TEXCOORD_0": draft.accessor(coordinates().astype(np.float32)),
    }  # fmt: skip
    draft.show({"attributes": attributes, "indices": draft.accessor(corners),
                "material": draft.add("materials", pbrMetallicRoughness=color)})  # fmt: skip
    return draft.files(kind)


def moving() -> Files:
    """Return a file of a mesh with a skin, a morph target and an animation."""
    positions, normals, corners = _arrays()
    draft, count = _Draft(), len(positions)
    weights = np.zeros((count, 4), np.float32)
    weights[:, 0] = positions[:, 0] / positions[:, 0].max()
    weights[:, 1] = 1.0 - weights[:, 0]
    attributes = {
        "POSITION": draft.accessor(positions), "NORMAL": draft.accessor(normals),
        "JOINTS_0": draft.accessor(np.tile(np.uint8([0, 1, 0, 0]), (count, 1))),
        "WEIGHTS_0": draft.accessor(weights),
    }  # fmt: skip
    target = {"POSITION": draft.accessor(normals * np.float32(0.2))}
    draft.show({"attributes": attributes, "indices": draft.accessor(corners),
                "targets": [target]}, {"weights": [0.3]})  # fmt: skip
    bound = draft.accessor(np.tile(np.eye(4, dtype=np.float32).reshape(1, 16), (2, 1)))
    joints = [draft.add("nodes", name="root", children=[2]), draft.add("nodes", name="tip")]
    draft.header["nodes"][0]["skin"] = draft.add(
        "skins", joints=joints, inverseBindMatrices=bound, skeleton=joints[0]
    )
    draft.header["scenes"][0]["nodes"].append(joints[0])
    times = draft.accessor(np.float32([0.0, 0.5, 1.0]))
    turns = draft.accessor(np.float32([[0, 0, 0, 1], [0, 0, 0.6, 0.8], [0, 0, 0, 1]]))
    samplers = [
        {"input": times, "output": turns},
        {"input": times, "output": draft.accessor(np.float32([0.0, 1.0, 0.5])),
         "interpolation": "STEP"},
    ]  # fmt: skip
    channels = [
        {"sampler": 0, "target": {"node": joints[1], "path": "rotation"}},
        {"sampler": 1, "target": {"node": 0, "path": "weights"}},
    ]
    draft.add("animations", name="wave", samplers=samplers, channels=channels)
    return draft.files("glb")


SAMPLES = {
    **{f"{codec.__name__} {kind}": lambda codec=codec, kind=kind: codec(kind)
       for codec in (draco, meshopt, ktx2) for kind in ("glb", "gltf")},
    "glb moving": moving,
}  # fmt: skip
"""What makes each sample."""

PACKAGES = {"draco": "DracoPy", "meshopt": "meshopt", "ktx2": "opengl_basisu"}
"""What each codec needs, by the first word of its samples."""
