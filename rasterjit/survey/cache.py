"""Cache what the frames of a scene share: joined arrays, tables and boxes."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.pipeline.records import (
    AlphaTests,
    CodedTextures,
    Layers,
    Maps,
    Microfacets,
    Placement,
    Surface,
    Textures,
    TransmissionRows,
    VertexScalars,
)
from rasterjit.pipeline.visibility.primitive_expansion import find_gaps
from rasterjit.scene.edge_twins import NO_TWIN
from rasterjit.scene.first_corners import corner_offsets
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node, check_no_groups, matrices_of, meshes_of
from rasterjit.scene.quality import Quality
from rasterjit.survey import object_transforms, packed_scene
from rasterjit.survey.object_counts import SMOOTH, Attribute, Inventory
from rasterjit.survey.object_transforms import ObjectTransforms, compute_mesh_boxes
from rasterjit.survey.packed_scene import SceneArrays
from rasterjit.survey.quality_overrides import override_key, override_meshes

if TYPE_CHECKING:
    from rasterjit.survey.cross_sections import Cut


def find_unique_edges(faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return every edge of the faces once, (N, 2), lower vertex number first, ascending."""
    keys = np.empty((3, len(faces)), np.int64)
    for k in range(3):
        # One number for each edge, its lower vertex in the upper half.
        a, b = faces[:, k], faces[:, (k + 1) % 3]
        np.minimum(a, b, out=keys[k])
        keys[k] <<= 32
        keys[k] |= np.maximum(a, b)
    ascending = np.sort(keys, axis=None)
    is_new = np.append(True, ascending[1:] != ascending[:-1])
    edges = ascending[is_new[: len(ascending)]]
    return np.stack([edges >> 32, edges & 0xFFFFFFFF], axis=1).astype(np.int32)


class Shapes:
    """
    Arrays that depend on the meshes alone; each is made on first use.

    Parameters
    ----------
    meshes : list of Mesh
        Of each object; their arrays never change.
    """

    def __init__(self, meshes: list[Mesh]) -> None:
        self.meshes = meshes
        self.distinct = list(dict.fromkeys(meshes))
        self._attributes: dict[str, tuple[NDArray[np.float32] | None, ...]] = {}
        self.cut_edges: tuple[Cut, NDArray[np.int32]] | None = None

    @cached_property
    def arrays(self) -> SceneArrays:
        """The joined geometry."""
        return packed_scene.join_geometry(self.meshes)

    @cached_property
    def corner_offsets(self) -> NDArray[np.uint8]:
        """Index of each face's first corner in its mesh's order, (F,): 0, 1, 2."""
        listed = np.concatenate([mesh.faces for mesh in self.meshes])
        starts = np.repeat(self.arrays.vertex_starts[:-1], np.diff(self.arrays.face_starts))
        return corner_offsets(listed + starts[:, np.newaxis], self.arrays.faces)

    def rotate_like(self, other: Shapes) -> NDArray[np.int32]:
        """Return the faces, (F, 3), rotated to begin at the same corners as in other shapes."""
        faces = self.arrays.faces
        pairs = zip(self.meshes, other.meshes, strict=True)
        if all(mesh._faces_to_draw() is original._faces_to_draw() for mesh, original in pairs):
            return faces
        rotations = (other.corner_offsets.astype(np.int64) - self.corner_offsets)[:, np.newaxis]
        return np.take_along_axis(faces, (rotations + np.arange(3)) % 3, axis=1)

    @cached_property
    def _single_positions(self) -> NDArray[np.float32]:
        """Vertices in float32, (V, 3), model space; infinite beyond its range."""
        with np.errstate(over="ignore"):
            return self.arrays.positions.astype(np.float32)

    def positions(self, precision: str) -> NDArray[Any]:
        """Return the vertices, (V, 3), model space, in ``"float32"`` or ``"float64"``."""
        return self._single_positions if precision == "float32" else self.arrays.positions

    @cached_property
    def uv(self) -> NDArray[np.float32]:
        """Texture coordinates, (V, 2); NaN where an object has none."""
        return packed_scene.join_uv(self.meshes)

    def attribute(self, name: str, attribute: Attribute) -> tuple[NDArray[np.float32] | None, ...]:
        """Return an attribute of vertices, (V, D), and of faces, (F+1, D): `join_attribute`."""
        if name not in self._attributes:
            self._attributes[name] = packed_scene.join_attribute(self.meshes, name, attribute)
        return self._attributes[name]

    @cached_property
    def scalars(self) -> tuple[NDArray[np.float64], NDArray[np.float32] | None]:
        """Scalars of vertices, (V,), and of faces, (F+1,), as `join_face_scalars` has them."""
        of_faces = packed_scene.join_face_scalars(self.meshes)
        return packed_scene.join_scalars(self.meshes), of_faces

    @cached_property
    def has_face_scalars(self) -> NDArray[np.bool_]:
        """Whether the mesh of each face has scalars of faces, (F+1,); False for face -1."""
        return np.append(
            np.repeat(
                [mesh.field is not None and mesh.field.of_faces for mesh in self.meshes],
                np.diff(self.arrays.face_starts),
            ),
            False,
        )

    @cached_property
    def normals(self) -> NDArray[np.float32]:
        """Vertex normals of all objects, (V, 3)."""
        return packed_scene.join_normals(self.meshes)

    @cached_property
    def boxes(self) -> NDArray[np.float64]:
        """Low and high corner of each object, (O, 2, 3), model space; NaN if it has none."""
        return compute_mesh_boxes(self.meshes)

    @cached_property
    def is_posed(self) -> bool:
        """Whether any mesh is posed."""
        return any(mesh._rest_mesh is not None for mesh in self.distinct)

    @cached_property
    def _rest_meshes(self) -> list[Mesh]:
        """The mesh of each object in its rest pose."""
        return [mesh if mesh._rest_mesh is None else mesh._rest_mesh for mesh in self.meshes]

    @cached_property
    def rest_boxes(self) -> NDArray[np.float64]:
        """The boxes of all objects in their rest pose."""
        return compute_mesh_boxes(self._rest_meshes) if self.is_posed else self.boxes

    def at_rest(self, placement: Placement) -> Placement:
        """Return a record with the vertices of all objects in their rest pose."""
        if not self.is_posed:
            return placement
        return placement._replace(positions=self._rest_positions)

    @cached_property
    def _rest_positions(self) -> NDArray[np.float64]:
        """(V, 3), model space."""
        return np.concatenate([mesh.vertices for mesh in self._rest_meshes])

    @cached_property
    def edges(self) -> NDArray[np.int32]:
        """Every edge of the triangles once, (N, 2)."""
        faces = self.arrays.faces
        if self.arrays.primitives:
            runs = find_gaps([primitive.faces for primitive in self.arrays.primitives], len(faces))
            faces = np.concatenate([faces[:0], *(faces[first:stop] for first, stop in runs)])
        return find_unique_edges(faces)

    @cached_property
    def edge_twins(self) -> NDArray[np.int32]:
        """The twin of each side of each triangle, (F, 3), as `find_twins` has it; -1 elsewhere."""
        starts = self.arrays.face_starts.tolist()
        twins = np.full((starts[-1], 3), NO_TWIN, np.int32)
        for mesh, first, stop in zip(self.meshes, starts[:-1], starts[1:], strict=True):
            if mesh.primitive == "triangles":
                own = mesh._twins_to_draw()
                twins[first:stop] = np.where(own == NO_TWIN, NO_TWIN, own + 3 * first)
        return twins

    @cached_property
    def object_numbers(self) -> NDArray[np.int32]:
        """Object of each face, (F+1,); the last, of face -1, is -1."""
        counts = np.append(np.diff(self.arrays.face_starts), 1)
        numbers = np.arange(len(counts), dtype=np.int32)
        numbers[-1] = -1
        return np.repeat(numbers, counts)

    @cached_property
    def instance_numbers(self) -> NDArray[np.int32]:
        """
        Number of each object among those that share its mesh, (O+1,), from 0 in their order.

        The last entry, which object -1 finds, is -1.
        """
        counts: dict[Mesh, int] = {}
        numbers = []
        for mesh in self.meshes:
            # A posed mesh counts as its rest mesh.
            shared = mesh if mesh._rest_mesh is None else mesh._rest_mesh
            numbers.append(counts.get(shared, 0))
            counts[shared] = numbers[-1] + 1
        return np.array([*numbers, -1], np.int32)


class MaterialTables:
    """
    Arrays that depend on the meshes and their materials; each is made on first use.

    Parameters
    ----------
    shapes : Shapes
    materials : list of Material
        Of each of the distinct meshes, as they are now.
    quality : Quality
    has_environment : bool
        Whether the scene has one. Both decide, with the materials, which are in force.
    """

    def __init__(
        self, shapes: Shapes, materials: list[Any], quality: Quality, has_environment: bool
    ) -> None:
        self._shapes = shapes
        self.materials = materials
        self.meshes = override_meshes(shapes.meshes, quality, has_environment)
        self._alpha_tests: dict[bool, AlphaTests] = {}

    @cached_property
    def inventory(self) -> Inventory:
        """The properties of objects that decide which effects a frame needs."""
        return Inventory(self.meshes)

    @cached_property
    def surface(self) -> Surface:
        """Materials and colours, without normals, light or textures."""
        return packed_scene.join_surface(self.meshes, None)

    @cached_property
    def normals(self) -> NDArray[np.float32]:
        """Vertex normals of the objects shaded with them, (V, 3); zero for the others."""
        if all(mesh.material.shading in SMOOTH for mesh in self.meshes):
            return self._shapes.normals
        return packed_scene.join_normals(self.meshes, SMOOTH)

    @cached_property
    def textures(self) -> Textures:
        """The textures of all objects and their texture coordinates."""
        return packed_scene.join_textures(self.meshes)

    @cached_property
    def coded_textures(self) -> CodedTextures:
        """The textures that may be read as codes."""
        return packed_scene.join_coded_textures(self.meshes, self.inventory.is_coded)

    def alpha_tests(self, has_textures: bool) -> AlphaTests:
        """Return the inputs of the alpha test, with textures or without."""
        if has_textures not in self._alpha_tests:
            starts = self._shapes.arrays.face_starts
            textures = self.textures if has_textures else None
            self._alpha_tests[has_textures] = packed_scene.join_alpha_tests(
                self.meshes, starts, self.surface, textures
            )
        return self._alpha_tests[has_textures]

    @cached_property
    def microfacets(self) -> Microfacets:
        """Metallic and roughness of all objects."""
        return packed_scene.join_microfacets(self.meshes)

    @cached_property
    def transmission(self) -> TransmissionRows:
        """Transmission of all objects."""
        return packed_scene.join_transmission(self.meshes)

    @cached_property
    def layers(self) -> Layers:
        """Clearcoat, sheen and custom specular of all objects."""
        return packed_scene.join_layers(self.meshes)

    @cached_property
    def fields(self) -> VertexScalars:
        """The scalars of all objects' vertices, and the colour maps that show them."""
        return packed_scene.join_fields(self.meshes)

    @cached_property
    def maps(self) -> Maps:
        """Material maps of all objects besides base colour."""
        return packed_scene.join_maps(self.meshes, self.inventory.kinds_apart)

    @cached_property
    def is_single_sided(self) -> NDArray[np.bool_]:
        """Whether back faces of each object are culled, (O,)."""
        return packed_scene.find_single_sided(self.meshes)


class SceneCache(NamedTuple):
    """The analysed objects of a scene, shared by many frames."""

    shapes: Shapes
    tables: MaterialTables
    matrices: list[NDArray[np.float64]]
    """``world_from_model`` of each object."""
    transforms: ObjectTransforms
    all_tables: dict[Any, MaterialTables]
    """Tables by the settings of a quality that they depend on."""
    cut: Cut | None = None
    """Mapping to the original scene, if a section cut this one."""

    @property
    def inventory_and_boxes(self) -> tuple[Inventory, NDArray[np.float64]]:
        """The objects' properties and boxes, as planning takes them."""
        return self.tables.inventory, self.shapes.boxes

    @property
    def edges(self) -> NDArray[np.int32]:
        """Every edge of the faces once, (N, 2), without those that a section made inside a face."""
        if self.cut is None:
            return self.shapes.edges
        known = self.shapes.cut_edges
        if known is None or known[0] is not self.cut:
            known = self.shapes.cut_edges = self.cut, self.cut.edges_of(self.shapes)
        return known[1]

    @property
    def face_starts(self) -> NDArray[np.int64]:
        """(O+1,): first face of each object, as outputs number them."""
        return self.shapes.arrays.face_starts if self.cut is None else self.cut.face_starts


def update_cache(
    nodes: Sequence[Node], old: SceneCache | None, quality: Quality, has_environment: bool = False
) -> SceneCache:
    """
    Analyse the nodes of a scene, reusing what still holds.

    Parameters
    ----------
    nodes : sequence of Node
    old : SceneCache or None
        Of an earlier frame: what has not changed since is taken from there. Meshes, materials and
        transforms are immutable, so each is the same if it is the same object.
    quality : Quality
    has_environment : bool
        Whether the scene has one, which some materials depend on.
    """
    meshes, matrices = meshes_of(nodes), matrices_of(nodes)
    if old is None or not are_identical(old.shapes.meshes, meshes):
        check_no_groups(nodes)
        shapes, all_tables = Shapes(meshes), {}
    else:
        shapes, all_tables = old.shapes, old.all_tables
    materials = [mesh.material for mesh in shapes.distinct]
    key = override_key(quality, has_environment)
    if key not in all_tables or not are_identical(all_tables[key].materials, materials):
        all_tables[key] = MaterialTables(shapes, materials, quality, has_environment)
    transforms = _update_transforms(old, matrices)
    cut = getattr(nodes, "cut", None)
    return SceneCache(shapes, all_tables[key], matrices, transforms, all_tables, cut)


def _update_transforms(
    last: SceneCache | None, matrices: Sequence[NDArray[np.float64]]
) -> ObjectTransforms:
    """Return the transforms of objects, reusing those that have not changed."""
    if last is None or len(last.matrices) != len(matrices):
        return object_transforms.transform_objects(matrices)
    pairs = zip(last.matrices, matrices, strict=True)
    moved = [n for n, (old, new) in enumerate(pairs) if old is not new]
    if not moved:
        return last.transforms
    return object_transforms.move_objects(last.transforms, matrices, moved)


def are_identical(old: Sequence[Any], new: Sequence[Any]) -> bool:
    """Tell whether two sequences hold the same objects in the same order."""
    return len(old) == len(new) and all(map(operator.is_, old, new))
