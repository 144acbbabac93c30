"""Turn the meshes of glTF files into ours: one `Mesh` for each primitive of triangles."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.gltf_file import GltfFile
from rasterjit.io.gltf_materials import MaterialReader
from rasterjit.io.left_out import LeftOut, MeshFileError
from rasterjit.scene.material import TEXTURE_FIELDS, Material
from rasterjit.scene.mesh import Mesh

TRIANGLES, STRIP, FAN = 4, 5, 6
OTHER_MODES = {0: "points", 1: "lines", 2: "lines", 3: "lines"}
"""How the vertices of a primitive are joined, as OpenGL numbers it."""

_COMPRESSED = "KHR_draco_mesh_compression"


class MeshReader:
    """
    Read the meshes of a file, each once.

    Parameters
    ----------
    file : GltfFile
    source : str
        What messages call the file.
    materials : MaterialReader
    on_invalid : {"raise", "drop"}
    crease_angle : float
        Degrees in 0..180, for primitives without normals.
    left_out : LeftOut
        Notes what is not shown, by the name of the mesh.
    """

    def __init__(
        self,
        file: GltfFile,
        source: str,
        materials: MaterialReader,
        on_invalid: str,
        crease_angle: float,
        left_out: LeftOut,
    ) -> None:
        self._file = file
        self._source = source
        self._materials = materials
        self._on_invalid = on_invalid
        self._crease_angle = crease_angle
        self._left_out = left_out
        self._known: dict[Any, list[Mesh]] = {}
        self._plain: dict[Material, Material] = {}

    @property
    def is_empty(self) -> bool:
        """Whether no mesh of the file has faces, as far as they were asked for."""
        return not any(self._known.values())

    def read(self, number: Any) -> list[Mesh]:
        """Return the meshes that stand for one of the file; none if it cannot be read."""
        if number not in self._known:
            self._known[number] = []
            try:
                entry = self._file.entry("meshes", number)
                primitives = list(entry["primitives"])
            except (LookupError, TypeError, AttributeError):
                self._left_out.note(f"reference to mesh {number!r}, which the file has not")
                return []
            label = f"mesh {entry.get('name', number)!r}"
            found = (self._primitive(primitive, label) for primitive in primitives)
            self._known[number] = [mesh for mesh in found if mesh is not None]
        return self._known[number]

    def _primitive(self, primitive: dict[str, Any], label: str) -> Mesh | None:
        """Return a primitive of triangles as a mesh; None, with a note, for any other."""
        try:
            arrays = self._arrays(primitive, label)
        except (ValueError, TypeError, LookupError, AttributeError, OSError, MemoryError) as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            self._left_out.note(f"{label}, which cannot be read: {reason}")
            return None
        if arrays is None:
            return None
        try:
            mesh = Mesh(**arrays, on_invalid=self._on_invalid)
            return mesh if mesh.normals is not None else mesh.split_creases(self._crease_angle)
        except ValueError as error:
            raise MeshFileError(f"{self._source}: {label}: {error}") from error

    def _arrays(self, primitive: dict[str, Any], label: str) -> dict[str, Any] | None:
        """Return what `Mesh` takes; None, with a note, if the primitive has no triangles."""
        mode = primitive.get("mode", TRIANGLES)
        if mode in OTHER_MODES:
            self._left_out.note(f"{OTHER_MODES[mode]} of {label}")
            return None
        if _COMPRESSED in primitive.get("extensions", {}):
            self._left_out.note(f"{label}, which is compressed by {_COMPRESSED}")
            return None
        attributes = primitive["attributes"]
        vertices = self._file.array(attributes["POSITION"])
        if "indices" in primitive:
            corners = self._file.array(primitive["indices"])[:, 0].astype(np.int64)
        else:
            corners = np.arange(len(vertices))
        faces = join_corners(corners, mode)
        if not len(faces) or not len(vertices):
            self._left_out.note(f"{label}, which has no faces")
            return None
        if primitive.get("targets"):
            self._left_out.note("morph target", len(primitive["targets"]))
        count = len(vertices)
        material, uv_set = self._material(primitive)
        normals = self._rows(attributes, "NORMAL", count, (3,), label)
        uv = self._rows(attributes, f"TEXCOORD_{uv_set}", count, (2,), label)
        tangents = None
        if normals is not None and material is not None and material.normal_texture is not None:
            tangents = self._rows(attributes, "TANGENT", count, (4,), label)
        if uv is None and material is not None:
            material = self._without_textures(material, label)
        return {
            "vertices": vertices,
            "faces": faces,
            "normals": normals,
            "uv": None if uv is None else np.column_stack([uv[:, 0], 1.0 - uv[:, 1]]),
            "colors": self._colors(attributes, count, label),
            "tangents": tangents,
            "material": material,
        }

    def _material(self, primitive: dict[str, Any]) -> tuple[Material | None, int]:
        """Return the material of a primitive, if it names one, and its set of coordinates."""
        if primitive.get("material") is None:
            return None, 0
        return self._materials.read(primitive["material"])

    def _rows(
        self, attributes: dict[str, int], name: str, count: int, widths: tuple[int, ...], label: str
    ) -> NDArray[np.float64] | None:
        """Return a finite attribute of every vertex; None, with a note if it is no use."""
        if name not in attributes:
            return None
        values = self._file.array(attributes[name]).astype(np.float64)
        if len(values) != count or values.shape[1] not in widths:
            self._left_out.note(f"{name} of {label}, which does not fit the vertices")
            return None
        if not np.isfinite(values).all():
            self._left_out.note(f"{name} of {label}, which has NaN or infinity")
            return None
        return None if name == "NORMAL" and not values.any() else values

    def _colors(
        self, attributes: dict[str, int], count: int, label: str
    ) -> NDArray[np.float64] | None:
        """Return the colours of the vertices, linear."""
        colors = self._rows(attributes, "COLOR_0", count, (3, 4), label)
        return None if colors is None else np.clip(colors, 0.0, 1.0)

    def _without_textures(self, material: Material, label: str) -> Material:
        """Return a material for a mesh without texture coordinates: without textures."""
        fields = [field for field in TEXTURE_FIELDS if getattr(material, field) is not None]
        if not fields:
            return material
        self._left_out.note(f"textures of {label}, which has no coordinates for them")
        if material not in self._plain:
            self._plain[material] = replace(material, **dict.fromkeys(fields))
        return self._plain[material]


def join_corners(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """
    Return the triangles that a list of corners stands for, (F, 3).

    Parameters
    ----------
    corners : (N,) int
        Vertex numbers. Those of a last, incomplete triangle have no part.
    mode : int
        ``TRIANGLES``, ``STRIP`` or ``FAN``.

    Raises
    ------
    ValueError
        If the mode is none of these.
    """
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if mode not in (STRIP, FAN):
        raise ValueError(f"its mode is {mode!r}")
    steps = np.arange(max(len(corners) - 2, 0))
    if mode == FAN:
        return np.column_stack(
            [
                corners[steps + 1],
                corners[steps + 2],
                np.full(len(steps), corners[0] if len(corners) else 0),
            ]
        )
    # Every second triangle of a strip is turned over.
    odd = steps % 2
    return np.column_stack([corners[steps], corners[steps + 1 + odd], corners[steps + 2 - odd]])
