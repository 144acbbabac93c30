"""What our readers find, and the scene that it becomes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.io import primitives
from rasterjit.io.load_warnings import LeftOut, MeshFileError
from rasterjit.io.resources import LONGEST_NAME
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.light import Light
from rasterjit.scene.material import TEXTURE_FIELDS, Material, with_textures
from rasterjit.scene.mesh import Mesh, with_face_scalars, with_face_values
from rasterjit.scene.node import Node, tops_of
from rasterjit.scene.scene import Scene

COLORS_BESIDE = "colours beside a material or texture coordinates"
"""What is not shown, as trimesh's readers do not bring it."""


_MESH_BYTES, _VERTEX_BYTES = 4096, 80
"""What a mesh takes besides its arrays, and what a vertex does, as it is read and in the mesh."""

POLYGON_CORNER_BYTES = 24
"""What a corner of a polygon takes, before its polygon is cut into faces."""

_VALUE_BYTES = 12
"""What a value of an attribute takes, in the mesh and while it is split."""

_FACE_BYTES, _SPLIT_FACE_BYTES = 64, 160
"""What a face takes, of a mesh with normals and of one that gets them."""


@dataclass(frozen=True)
class Part:
    """
    A mesh as a file has it.

    Parameters
    ----------
    name : str
        Of its node.
    vertices : (V, 3) float64
    faces : (F, 3) int
    normals : (V, 3) float, optional
    bare : (F,) bool, optional
        Faces of which a corner has no normal, whatever stands there: they get made ones.
    uv : (V, 2) float, optional
    colors : (V, 4) or (F, 4) float32, optional
        Linear RGBA.
    material : Material, optional
    attributes, face_attributes : dict of str to (V, D) and (F, D) array
        Values of one's own.
    scalars, face_scalars : (V,) and (F,) array, optional
        One of them, in the place of colours.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[Any] | None = None
    uv: NDArray[Any] | None = None
    colors: NDArray[np.float32] | None = None
    material: Material | None = None
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    face_attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    scalars: NDArray[Any] | None = None
    face_scalars: NDArray[Any] | None = None
    bare: NDArray[np.bool_] | None = None


Thing: TypeAlias = Part | primitives.Cloud | primitives.LineDrawing
"""What a reader finds."""


def scene_of_parts(parts: Iterable[Thing], reading: primitives.Reading) -> Scene:
    """Return a scene with a node for each thing, or raise `MeshFileError`, naming it."""
    scene = Scene()
    for part in parts:
        scene.add(thing_mesh(part, reading), name=part.name or None)
    return scene


def thing_mesh(thing: Thing, reading: primitives.Reading) -> Mesh:
    """Return a thing as a mesh with normals, points or lines, or raise `MeshFileError`."""
    if isinstance(thing, primitives.Cloud):
        return primitives.points_of(thing, reading)
    if isinstance(thing, primitives.LineDrawing):
        return primitives.lines_of(thing, reading)
    return mesh_of_part(thing, reading)


def mesh_of_part(part: Part, reading: primitives.Reading) -> Mesh:
    """Return a mesh with normals, or raise `MeshFileError`, naming the source and its name."""
    left_out = reading.left_out
    each = _FACE_BYTES if part.normals is not None else _SPLIT_FACE_BYTES
    needed = _MESH_BYTES + _VERTEX_BYTES * len(part.vertices) + each * len(part.faces)
    own = (*part.attributes.values(), *part.face_attributes.values())
    needed += _VALUE_BYTES * sum(values.size for values in own)
    reading.take(f"the mesh {part.name[:LONGEST_NAME]!r}", needed)
    uv, material = _finite_uv(part.uv, left_out), part.material
    if uv is None and material is not None:
        material = without_textures(part.name, material, left_out)
    try:
        mesh = primitives.mesh_of(
            f"mesh {part.name[:LONGEST_NAME]!r}", left_out, vertices=part.vertices,
            faces=part.faces, normals=primitives.finite_normals(part.normals, left_out), uv=uv,
            material=material, colors=part.colors if part.face_scalars is None else None,
            on_invalid=reading.on_invalid, scalars=part.scalars if part.colors is None else None,
            attributes=primitives.usable_attributes(part.attributes, len(part.vertices), left_out),
        )  # fmt: skip
        of_faces = primitives.usable_attributes(part.face_attributes, len(part.faces), left_out)
        with_face_values(mesh, mesh.face_colors, of_faces)
        if part.face_scalars is not None:
            with_face_scalars(mesh, part.face_scalars)
        return _with_all_normals(mesh, part.bare, reading)
    except ValueError as error:
        raise MeshFileError(f"{reading.source}: mesh {part.name!r}: {error}") from error


def _with_all_normals(
    mesh: Mesh, bare: NDArray[np.bool_] | None, reading: primitives.Reading
) -> Mesh:
    """Return a mesh in which faces with a corner without a normal have made ones."""
    if mesh.normals is None:
        return mesh.split_creases(reading.crease_angle)
    if bare is None or not bare.any():
        return mesh
    made = mesh.split_creases(reading.crease_angle)
    faces = np.where(bare[:, np.newaxis], made.faces + len(mesh.vertices), mesh.faces)
    used, which = np.unique(faces, return_inverse=True)

    def of_both(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        """Return the rows in use of two arrays of vertices."""
        return np.concatenate([one, other])[used]

    def if_given(one: NDArray[Any] | None, other: NDArray[Any] | None) -> NDArray[Any] | None:
        """Return the same, or None if the mesh has no such values."""
        return None if one is None or other is None else of_both(one, other)

    attributes = {
        name: of_both(values, made.vertex_attributes[name])
        for name, values in mesh.vertex_attributes.items()
    }
    both = Mesh(
        of_both(mesh.vertices, made.vertices), which.reshape(-1, 3),
        normals=if_given(mesh.normals, made.normals), uv=if_given(mesh.uv, made.uv),
        colors=if_given(mesh.vertex_colors, made.vertex_colors), attributes=attributes,
        material=mesh.material, on_invalid=reading.on_invalid,
    )  # fmt: skip
    return with_face_values(both, mesh.face_colors, mesh.face_attributes)


def _finite_uv(values: NDArray[Any] | None, left_out: LeftOut) -> NDArray[Any] | None:
    """Return texture coordinates, or None with a note if one is not finite."""
    if values is not None and not np.isfinite(values).all():
        left_out.note("uv with NaN or infinity")
        return None
    return values


def without_textures(name: str, material: Material, left_out: LeftOut) -> Material:
    """Return a material for a mesh without texture coordinates: without textures."""
    fields = [field for field in TEXTURE_FIELDS if getattr(material, field) is not None]
    if not fields:
        return material
    left_out.note(f"texture image without texture coordinates, of mesh {name!r}")
    return with_textures(material, dict.fromkeys(fields))


def meant_names(names: Sequence[str], groups: Iterable[Sequence[str]]) -> list[str]:
    """
    Return names, in small letters those of groups that are there whole, written in whatever case.

    Parameters
    ----------
    names : sequence of str
        Of the values of a row, each once.
    groups : iterable of sequence of str
        Names in small letters that mean something together.

    Examples
    --------
    >>> meant_names(["X", "Y", "z", "T"], [("x", "y", "z"), ("s", "t")])
    ['x', 'y', 'z', 'T']
    """
    found = {name.lower(): name for name in reversed(names)}
    found |= {name: name for name in names if name == name.lower()}
    whole = (group for group in groups if all(one in found for one in group))
    meant = {found[one]: one for group in whole for one in group}
    return [meant.get(name, name) for name in names]


def linear_rgba(colors: NDArray[Any], is_linear: bool) -> NDArray[np.float32]:
    """
    Return colours, (N, 3|4), as linear RGBA.

    Whole numbers count to the largest of their type. Bytes are sRGB unless ``is_linear``.
    """
    rgba = np.ones((len(colors), 4), dtype=np.float32)
    if colors.dtype == np.uint8 and not is_linear:
        rgba[:, :3] = srgb_to_linear(colors[:, :3])
        rgba[:, 3 : colors.shape[1]] = colors[:, 3:] / np.float32(255.0)
    else:
        most = 1.0 if colors.dtype.kind == "f" else float(np.iinfo(colors.dtype).max)
        rgba[:, : colors.shape[1]] = np.clip(np.nan_to_num(colors / most), 0.0, 1.0)
    return rgba


def srgb_bytes(colors: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours, of which floats count from 0 to 1, as bytes."""
    if colors.dtype.kind == "f":
        finite = np.where(np.isfinite(colors), colors, 0.0)
        return (np.clip(finite, 0.0, 1.0) * 255.0).round().astype(np.uint8)
    if colors.dtype == np.uint16:
        return (colors >> 8).astype(np.uint8)
    return np.clip(colors, 0, 255).astype(np.uint8)


def joined(numbers: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Number the different rows of a table, in their order.

    Parameters
    ----------
    numbers : (N, K) int64
        None below zero.

    Returns
    -------
    rows : (V,) int64
        A row of the table for each number.
    which : (N,) int64
        The number of each row.
    """
    which, rows = distinct_rows(*numbers.T)
    order = np.lexsort(numbers[rows].T[::-1])
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return rows[order], rank.take(which)


def triangles(
    counts: NDArray[np.int64], by_size: bool
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Cut polygons into triangles, as trimesh does.

    Parameters
    ----------
    counts : (F,) int64
        Corners of each polygon, at least 3; they stand one polygon after the other.
    by_size : bool
        Whether all triangles come first, then the first halves of all quadrangles, then the second
        ones, then fans of the rest; or each polygon's triangles where it stands.

    Returns
    -------
    corners : (T, 3) int64
        Numbers of corners.
    polygons : (T,) int64
        Of which polygon each triangle is.
    """
    begins = np.cumsum(counts) - counts
    if (counts == 3).all():
        return begins[:, np.newaxis] + np.arange(3), np.arange(len(counts))
    polygons = np.repeat(np.arange(len(counts)), counts - 2)
    first = np.cumsum(counts - 2) - (counts - 2)
    step = np.arange(len(polygons)) - first[polygons]
    begin = begins[polygons]
    corners = np.stack([begin, begin + step + 1, begin + step + 2], axis=1)
    second = (counts[polygons] == 4) & (step == 1)
    corners[second] = begin[second, np.newaxis] + [2, 3, 0]
    if by_size:
        rank = np.where(counts == 3, 0, np.where(counts == 4, 1, 3))[polygons] + second
        order = np.argsort(rank, kind="stable")
        corners, polygons = corners[order], polygons[order]
    return corners, polygons


def strip_triangles(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Cut strips into triangles, of which every second one is turned over.

    Parameters
    ----------
    counts : (S,) int64
        Corners of each strip, which stand one strip after the other; fewer than 3 are no triangle.

    Returns
    -------
    corners : (T, 3) int64
        Numbers of corners.
    strips : (T,) int64
        Of which strip each triangle is.
    """
    inside = np.maximum(counts - 2, 0)
    strips = np.repeat(np.arange(len(counts)), inside)
    step = np.arange(len(strips)) - (np.cumsum(inside) - inside)[strips]
    first, odd = (np.cumsum(counts) - counts)[strips] + step, step % 2
    return np.stack([first, first + 1 + odd, first + 2 - odd], axis=1), strips


def sound_polygons(
    corners: NDArray[Any],
    counts: NDArray[np.int64],
    there: NDArray[np.bool_],
    report: Callable[[int], None],
    left_out: LeftOut,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """
    Leave out polygons of fewer than 3 corners, and those that refer to no vertex.

    Parameters
    ----------
    corners : (N,) float or int
        Numbers of vertices, one polygon after the other.
    counts : (F,) int64
        How many of them each polygon has.
    there : (V,) bool
        Which vertices can be used.
    report : callable
        Told the number of each polygon that refers to none.
    left_out : LeftOut
        Notes those of fewer than 3 corners.

    Returns
    -------
    corners : (M,) int64
    counts, polygons : (G,) int64
        Corners and number of each polygon that is left.
    """
    kept = (corners >= 0) & (corners < len(there))
    whole = np.where(kept, corners, 0).astype(np.int64)
    if len(there):
        kept &= (whole == corners) & there[whole]
    of_corners = np.repeat(np.arange(len(counts)), counts)
    sound = np.ones(len(counts), bool)
    sound[of_corners[~kept]] = False
    for polygon in np.flatnonzero(~sound).tolist():
        report(polygon)
    few = sound & (counts < 3)
    if few.any():
        left_out.note("polygon of fewer than 3 corners", int(np.count_nonzero(few)))
    sound &= ~few
    return whole[sound[of_corners]], counts[sound], np.flatnonzero(sound)


class Names:
    """Give names, none of them twice."""

    def __init__(self) -> None:
        self._given: set[str] = set()
        self._next: dict[str, int] = {}

    def unique(self, name: str) -> str:
        """Return a name, with a number behind it if it is given already."""
        found = name
        if not name or name in self._given:
            stem, number = name or "geometry", 0
            parts = name.rsplit("_", 1)
            if len(parts) == 2 and parts[1].isdecimal() and len(parts[1]) < 10:
                stem, number = parts[0], int(parts[1])
            passed = []
            number += 1
            found = f"{stem}_{number}"
            while found in self._given:
                passed.append(found)
                number = self._next.get(found, number + 1)
                found = f"{stem}_{number}"
            # Who comes this way again goes on from here.
            self._next.update(dict.fromkeys(passed, number + 1))
        self._given.add(found)
        return found


@dataclass(frozen=True)
class Place:
    """
    A node.

    Parameters
    ----------
    name : str
    transform : (4, 4) float64
        Relative to the parent or, without one, to the world.
    parent, thing : int, optional
        Numbers of a place before it, and of what stands there.
    """

    name: str
    transform: NDArray[np.float64]
    parent: int | None = None
    thing: int | None = None


@dataclass(frozen=True)
class Assembly:
    """
    Things, and where each stands.

    Parameters
    ----------
    things : list of Part, Cloud or Drawing
    places : list of Place
    drawn : list of int
        Numbers of the places with a thing, in the order of the scene's objects.
    camera : PerspectiveCamera, optional
    lights : list of Light
    """

    things: list[Thing]
    places: list[Place]
    drawn: list[int]
    camera: PerspectiveCamera | None = None
    lights: list[Light] = field(default_factory=list)


def scene_of_assembly(found: Assembly, reading: primitives.Reading) -> Scene:
    """Return a scene of what a file or an object holds, or raise `MeshFileError`."""
    meshes = [thing_mesh(one, reading) for one in found.things]
    nodes: list[Node] = []
    for place in found.places:
        parent: Any = None if place.parent is None else nodes[place.parent]
        try:
            nodes.append(Node(None, place.transform, place.name, parent=parent))
        except ValueError as error:
            raise MeshFileError(f"{reading.source}: node {place.name!r}: {error}") from error
    drawn = [nodes[number] for number in found.drawn]
    for number, node in zip(found.drawn, drawn, strict=True):
        thing = found.places[number].thing
        node.mesh = None if thing is None else meshes[thing]
    scene = Scene()
    for top in tops_of(drawn):
        scene._take(top, is_new=True)
    # Objects are numbered as the file has them, whatever they hang below.
    scene.nodes[:] = drawn
    scene.camera = found.camera
    scene.lights += found.lights
    return scene
