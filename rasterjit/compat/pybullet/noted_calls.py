"""Note what programs tell PyBullet and PyBullet does not tell again: textures and vertices."""

from __future__ import annotations

import functools
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pybullet
from numpy.typing import NDArray

from rasterjit.compat.unit_shapes import make_grid_faces

CHANGE_NAMES = (
    "objectUniqueId", "linkIndex", "shapeIndex", "textureUniqueId", "rgbaColor", "specularColor",
    "flags", "physicsClientId",
)  # fmt: skip
SHAPE_NAMES = (
    "shapeType", "radius", "halfExtents", "length", "fileName", "meshScale", "planeNormal",
    "flags", "rgbaColor", "specularColor", "visualFramePosition", "visualFrameOrientation",
    "vertices", "indices", "normals", "uvs", "physicsClientId",
)  # fmt: skip
SHAPE_ARRAY_NAMES = (
    "shapeTypes", "radii", "halfExtents", "lengths", "fileNames", "meshScales", "planeNormals",
    "flags", "rgbaColors", "specularColors", "visualFramePositions", "visualFrameOrientations",
    "vertices", "indices", "normals", "uvs", "physicsClientId",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class GivenMesh:
    """A mesh that a program gave as arrays."""

    positions: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[np.float64] | None
    uv: NDArray[np.float64] | None
    """With v up."""


class Notes:
    """What is known of one client beyond what PyBullet tells."""

    def __init__(self) -> None:
        self.search_path = ""
        self.textures: dict[int, Any] = {}
        """By unique id: the path of a file, or an (H, W, 3) uint8 array."""
        self.shapes: dict[int, list[tuple[GivenMesh | None, int]]] = {}
        """By unique id of a visual shape: mesh and flags of each of its parts."""
        self.fields: dict[int, GivenMesh] = {}
        """Height fields by the unique id of their collision shapes."""
        self.field_bodies: dict[int, int] = {}
        """Unique id of the collision shape of a body's base."""
        self.bodies: dict[tuple[int, int], int] = {}
        """Unique id of the visual shape of a body's link."""
        self.overrides: dict[tuple[int, int, int], int] = {}
        """Texture given to a body's link and shape; -1 for all shapes of the link."""
        self.flags: dict[tuple[int, int, int], int] = {}
        """Flags, likewise."""
        self.ends: dict[int, dict[str, list[NDArray[np.float64] | None]]] = {}
        """Of bodies of MJCF files, by the names of links: the two ends of each shape, (2, 3), or
        None for one that has a pose."""
        self.version = 0
        """Counts what may change pictures of all bodies that are drawn already."""
        self.versions = Counter[int]()
        """Likewise, of single bodies."""

    def forget_bodies(self, body: int | None = None) -> None:
        """Forget one body, or all and the shapes that they were made of."""
        tables: tuple[dict[Any, int], ...] = self.bodies, self.overrides, self.flags
        for table in tables:
            for key in [key for key in table if body is None or key[0] == body]:
                del table[key]
        if body is None:
            for all_of in (self.shapes, self.fields, self.field_bodies, self.ends):
                all_of.clear()
            self.version += 1
        else:
            self.ends.pop(body, None)
            self.field_bodies.pop(body, None)
            self.versions[body] += 1

    def find_file(self, name: str) -> Path:
        """Return the path of a file that PyBullet read by this name."""
        path = Path(name)
        return path if path.exists() or not self.search_path else Path(self.search_path) / name


NOTES: dict[int, Notes] = {}
"""By client."""


def get_notes(client: int) -> Notes:
    """Return the notes of a client, perhaps empty ones."""
    notes = NOTES.get(client)
    if notes is None:
        notes = NOTES[client] = Notes()
    return notes


def note_calls() -> None:
    """Let PyBullet's functions of `NOTED` note what they are given; do it once."""
    for name, (note, names) in NOTED.items():
        function = getattr(pybullet, name)
        if not hasattr(function, "__wrapped__"):
            setattr(pybullet, name, _wrap(function, names, note))


def _wrap(
    function: Callable[..., Any], names: Sequence[str], note: Callable[..., None]
) -> Callable[..., Any]:
    """Return a function that does the same and then notes arguments and result."""

    @functools.wraps(function)
    def noting(*arguments: Any, **named: Any) -> Any:
        result = function(*arguments, **named)
        given = {**dict(zip(names, arguments, strict=False)), **named}
        note(get_notes(int(given.get("physicsClientId", 0))), given, result)
        return result

    return noting


def _note_path(notes: Notes, given: Mapping[str, Any], _: Any) -> None:
    notes.search_path = os.fspath(given["path"])


def _note_texture(notes: Notes, given: Mapping[str, Any], number: int) -> None:
    if number >= 0:
        notes.textures[number] = notes.find_file(given["textureFilename"]).absolute()


def _note_texels(notes: Notes, given: Mapping[str, Any], _: Any) -> None:
    height, width = given["height"], given["width"]
    texels = np.array([*given["pixels"]][: 3 * height * width], np.uint8)
    notes.textures[given["textureUniqueId"]] = texels.reshape(height, width, 3)
    notes.version += 1


def _note_change(notes: Notes, given: Mapping[str, Any], _: Any) -> None:
    place = given["objectUniqueId"], given["linkIndex"], given.get("shapeIndex", -1)
    for name, table, least in (("textureUniqueId", notes.overrides, -1), ("flags", notes.flags, 0)):
        if given.get(name, -2) >= least:
            # For all shapes of a link: in place of what single ones had.
            for key in [key for key in table if place[2] < 0 and key[:2] == place[:2]]:
                del table[key]
            table[place] = given[name]
            notes.versions[place[0]] += 1


def _note_shape(notes: Notes, given: Mapping[str, Any], number: int) -> None:
    notes.shapes[number] = [(_get_given_mesh(given), given.get("flags", 0))]


def _note_shapes(notes: Notes, given: Mapping[str, Any], number: int) -> None:
    parts = []
    for n in range(len(given["shapeTypes"])):
        part = {
            name: given[name][n]
            for name in ("vertices", "indices", "normals", "uvs", "flags")
            if given.get(name) is not None and n < len(given[name])
        }
        parts.append((_get_given_mesh(part), part.get("flags", 0)))
    notes.shapes[number] = parts


def _note_field(notes: Notes, given: Mapping[str, Any], number: int) -> None:
    heights = np.array([*given.get("heightfieldData", ())], np.float64)
    if not heights.size:
        return
    columns, rows = int(given["numHeightfieldRows"]), int(given["numHeightfieldColumns"])
    share_x, share_y = np.meshgrid(np.linspace(0.0, 1.0, columns), np.linspace(0.0, 1.0, rows))
    # The middle between the lowest and the highest point is at 0.
    z = heights[: rows * columns] - 0.5 * (heights.min() + heights.max())
    x, y = (share_x - 0.5) * (columns - 1), (share_y - 0.5) * (rows - 1)
    positions = np.stack([x.ravel(), y.ravel(), z], axis=1) * given.get("meshScale", (1, 1, 1))
    uv = np.stack([1.0 - share_x.ravel(), 1.0 - share_y.ravel()], axis=1)
    faces = make_grid_faces(rows, columns)
    replaced = given.get("replaceHeightfieldIndex", -1)
    notes.fields[number if replaced < 0 else replaced] = GivenMesh(positions, faces, None, uv)
    notes.version += 1


def _note_bodies(notes: Notes, given: Mapping[str, Any], result: Any) -> None:
    base = given.get("baseCollisionShapeIndex", -1)
    shapes = given.get("baseVisualShapeIndex", -1), *given.get("linkVisualShapeIndices", ())
    for body in result if isinstance(result, tuple) else (result,):
        notes.field_bodies[body] = base
        notes.versions[body] += 1
        notes.bodies.update({(body, link - 1): shape for link, shape in enumerate(shapes)})


def _note_removal(notes: Notes, given: Mapping[str, Any], _: Any) -> None:
    notes.forget_bodies(given["bodyUniqueId"])


def _note_reset(notes: Notes, _given: Mapping[str, Any], _: Any) -> None:
    # PyBullet goes on counting textures where it was.
    notes.forget_bodies()


def _note_end(_notes: Notes, given: Mapping[str, Any], _: Any) -> None:
    NOTES.pop(int(given.get("physicsClientId", 0)), None)


def _note_mjcf(notes: Notes, given: Mapping[str, Any], result: Any) -> None:
    ends = _read_ends(notes.find_file(given["mjcfFileName"]))
    notes.ends.update({body: ends for body in result or ()})
    notes.versions.update(result or ())


def _read_ends(path: Path) -> dict[str, list[NDArray[np.float64] | None]]:
    """Return the ends of the geoms of each body of an MJCF file, by its name; twice given: none."""
    found: dict[str, list[NDArray[np.float64] | None]] = {}
    try:
        bodies = [*ElementTree.parse(path).iter("body")]
    except (OSError, ElementTree.ParseError):
        return found
    for body in bodies:
        ends: list[NDArray[np.float64] | None] = []
        for geom in body.findall("geom"):
            words = geom.get("fromto", "").split()
            ends.append(np.array(words, np.float64).reshape(2, 3) if len(words) == 6 else None)
        name = body.get("name", "")
        found[name] = [] if name in found else ends
    return found


def _get_given_mesh(given: Mapping[str, Any]) -> GivenMesh | None:
    """Return the mesh that arguments give as vertices, if they do."""
    if not len(given.get("vertices", ())):
        return None
    positions = np.array(given["vertices"], np.float64).reshape(-1, 3)
    faces = np.array(given.get("indices", ()), np.int64).reshape(-1, 3)
    normals, uv = (
        np.array(given[name], np.float64).reshape(-1, width) if len(given.get(name, ())) else None
        for name, width in (("normals", 3), ("uvs", 2))
    )
    return GivenMesh(positions, faces, normals, uv)


NOTED: dict[str, tuple[Callable[..., None], Sequence[str]]] = {
    "setAdditionalSearchPath": (_note_path, ("path", "physicsClientId")),
    "loadTexture": (_note_texture, ("textureFilename", "physicsClientId")),
    "changeTexture": (_note_texels, (
        "textureUniqueId", "pixels", "width", "height", "physicsClientId",
    )),
    "changeVisualShape": (_note_change, CHANGE_NAMES),
    "resetVisualShapeData": (_note_change, CHANGE_NAMES),
    "createVisualShape": (_note_shape, SHAPE_NAMES),
    "createVisualShapeArray": (_note_shapes, SHAPE_ARRAY_NAMES),
    "createCollisionShape": (_note_field, (
        "shapeType", "radius", "halfExtents", "height", "fileName", "meshScale", "planeNormal",
        "flags", "collisionFramePosition", "collisionFrameOrientation", "vertices", "indices",
        "heightfieldTextureScaling", "heightfieldData", "numHeightfieldRows",
        "numHeightfieldColumns", "replaceHeightfieldIndex", "physicsClientId",
    )),
    "createMultiBody": (_note_bodies, (
        "baseMass", "baseCollisionShapeIndex", "baseVisualShapeIndex", "basePosition",
        "baseOrientation", "baseInertialFramePosition", "baseInertialFrameOrientation",
        "linkMasses", "linkCollisionShapeIndices", "linkVisualShapeIndices", "linkPositions",
        "linkOrientations", "linkInertialFramePositions", "linkInertialFrameOrientations",
        "linkParentIndices", "linkJointTypes", "linkJointAxis", "useMaximalCoordinates", "flags",
        "batchPositions", "physicsClientId",
    )),
    "loadMJCF": (_note_mjcf, ("mjcfFileName", "flags", "physicsClientId")),
    "removeBody": (_note_removal, ("bodyUniqueId", "physicsClientId")),
    "resetSimulation": (_note_reset, ("flags", "physicsClientId")),
    "disconnect": (_note_end, ("physicsClientId",)),
}  # fmt: skip
"""Of each function whose calls are noted: what notes it, and its arguments in their order."""
