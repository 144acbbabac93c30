"""Scenes: which meshes stand where, what lights them, and who looks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene.ambient_occlusion import AmbientOcclusion
from rasterjit.scene.assigning import Guarded
from rasterjit.scene.environment import Environment
from rasterjit.scene.fog import Fog
from rasterjit.scene.light import Light
from rasterjit.scene.mesh import Mesh, Previewed
from rasterjit.scene.outline import Outline
from rasterjit.scene.tone_map import ToneMap
from rasterjit.scene.transforms import transform_instances
from rasterjit.scene.validation import finite_array, read_only
from rasterjit.scene.vignette import Vignette
from rasterjit.scene.wireframe import Wireframe

if TYPE_CHECKING:
    from rasterjit.scene.camera import MatrixCamera, OrthographicCamera, PerspectiveCamera

_CHUNK = 1 << 18
"""Vertices transformed at once while measuring a scene."""

_LAST_ROW_ROUNDING = 1e-9
"""How far a transform's last row may be from 0, 0, 0, 1, as left by products and inverses."""


EFFECT_FIELDS: dict[str, tuple[type, str]] = {
    "wireframe": (Wireframe, "a Wireframe"),
    "ambient_occlusion": (AmbientOcclusion, "an AmbientOcclusion"),
    "outline": (Outline, "an Outline"),
    "environment": (Environment, "Environment"),
    "fog": (Fog, "Fog"),
    "tone_map": (ToneMap, "ToneMap"),
    "vignette": (Vignette, "a Vignette"),
}
"""The fields of a scene that ask for effects: what they hold if not None, and that in words."""


class Node(Guarded):
    """
    One mesh at one place; two nodes with the same mesh are instances of it.

    Parameters
    ----------
    mesh : Mesh
    world_from_model : (4, 4) array_like
        Affine transform of column vectors; it may mirror or flatten the mesh. Assigning a new one
        moves the mesh.
    name : str

    Raises
    ------
    ValueError
        If ``mesh`` is not a `Mesh`, or the transform is not 4×4, finite and affine.
    AttributeError
        If anything else is assigned than these three.
    """

    _FIELDS = ("mesh", "world_from_model", "name")

    def __init__(self, mesh: Mesh, world_from_model: ArrayLike, name: str) -> None:
        self.mesh = mesh
        self.world_from_model = world_from_model
        self.name = name

    @property
    def mesh(self) -> Mesh:
        """What stands there; another may be assigned."""
        return self._mesh

    @mesh.setter
    def mesh(self, value: Mesh) -> None:
        if not isinstance(value, Mesh):
            raise ValueError(
                f"mesh must be a rasterjit Mesh, got {type(value).__name__}; rasterjit.load and "
                "rasterjit.render take files and trimesh objects"
            )
        self._mesh = value

    @property
    def world_from_model(self) -> NDArray[np.float64]:
        """Affine transform, (4, 4) float64, read-only, from the mesh's space to the world."""
        return self._world_from_model

    @world_from_model.setter
    def world_from_model(self, value: ArrayLike) -> None:
        self._world_from_model = _affine("transform", value)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Fill a copy, or what was pickled; its matrix is read-only too."""
        self.__dict__.update(state)
        self._world_from_model = read_only(self._world_from_model)

    def __repr__(self) -> str:
        return f"Node({self.name!r}, {self.mesh!r})"


def meshes_of(nodes: Sequence[Node]) -> list[Mesh]:
    """Return the mesh of each node; four times faster than by its property."""
    return [node._mesh for node in nodes]


def matrices_of(nodes: Sequence[Node]) -> list[NDArray[np.float64]]:
    """Return ``world_from_model``, (4, 4) float64, of each node."""
    return [node._world_from_model for node in nodes]


class Scene(Guarded, Previewed):
    """
    Meshes at their places, with lights and perhaps a camera.

    Attributes
    ----------
    nodes : list of Node
        In the order they were added; a node's index is its object number.
    lights : list of AmbientLight, DirectionalLight, PointLight or SpotLight
        In any order and number; a light's index is the number that plans and explanations call it
        by. Their light adds up. Empty means that the renderer adds a headlight (a directional
        light over the viewer's right shoulder, and a little ambient light), unless there is an
        environment; a light of intensity 0 keeps it dark.
    camera : PerspectiveCamera, OrthographicCamera, MatrixCamera or None
        The camera a file brought, if any.
    wireframe : Wireframe or None
        Lines along the edges of all faces.
    environment : Environment or None
        Light from all around, seen behind all faces; with one there is no headlight.
    fog : Fog or None
        What hides surfaces with their distance.
    tone_map : ToneMap or None
        How linear light becomes 8-bit colour; ``None`` cuts off what is above 1.
    ambient_occlusion : AmbientOcclusion or None
        How ambient light is dimmed in corners.
    outline : Outline or None
        Lines around shapes.
    vignette : Vignette or None
        How much darker the corners of the picture are.

    Raises
    ------
    AttributeError
        If anything else is assigned than these.
    """

    _FIELDS = ("nodes", "lights", "camera", *EFFECT_FIELDS)

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.lights: list[Light] = []
        self.camera: PerspectiveCamera | OrthographicCamera | MatrixCamera | None = None
        self.wireframe: Wireframe | None = None
        self.environment: Environment | None = None
        self.fog: Fog | None = None
        self.tone_map: ToneMap | None = None
        self.ambient_occlusion: AmbientOcclusion | None = None
        self.outline: Outline | None = None
        self.vignette: Vignette | None = None

    def __repr__(self) -> str:
        faces = sum(len(node.mesh.faces) for node in self.nodes)
        return f"Scene({len(self.nodes)} objects, {faces} faces, {len(self.lights)} lights)"

    def add(self, mesh: Mesh, transform: ArrayLike | None = None, name: str | None = None) -> Node:
        """
        Place a mesh in the scene; adding it again makes an instance that shares its arrays.

        Parameters
        ----------
        mesh : Mesh
        transform : (4, 4) array_like, optional
            ``world_from_model``, affine, for column vectors; default the identity.
        name : str, optional
            Default ``"object <number>"``.

        Returns
        -------
        Node
            The new last entry of ``nodes``.

        Raises
        ------
        ValueError
            If ``mesh`` is not a `Mesh`, or the transform is not 4×4, finite and affine.
        """
        place = np.eye(4) if transform is None else transform
        node = Node(mesh, place, f"object {len(self.nodes)}" if name is None else str(name))
        self.nodes.append(node)
        return node

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return the smallest axis-parallel box around everything.

        Returns
        -------
        low, high : (3,) float64
            World-space corners, over the finite vertices that belong to a face.

        Raises
        ------
        ValueError
            If there is no such vertex.
        """
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        with np.errstate(over="ignore", invalid="ignore"):
            for world_positions in self._world_chunks():
                np.minimum(low, world_positions.min(axis=0), out=low)
                np.maximum(high, world_positions.max(axis=0), out=high)
        if not (low <= high).all():
            raise ValueError("scene has no face with a finite vertex, so it has no bounds")
        return low, high

    def bounding_sphere(self) -> tuple[NDArray[np.float64], float]:
        """
        Return a sphere that holds everything.

        Returns
        -------
        center : (3,) float64
            World-space middle of the scene's box.
        radius : float
            Distance of the farthest vertex from it, in scene units; 0 for a single point. Neither
            need be finite where coordinates are as large as float64 holds.

        Raises
        ------
        ValueError
            If no face has a finite vertex.
        """
        low, high = self.bounds()
        with np.errstate(invalid="ignore"):
            center = low / 2.0 + high / 2.0
            scale = float((high / 2.0 - low / 2.0).max())
        if scale == 0.0:
            return center, 0.0
        largest = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for world_positions in self._world_chunks():
                # Measured in units of the box, so that squares neither overflow nor vanish.
                offset = (world_positions - center) / scale
                x, y, z = offset.T
                largest = max(largest, float((x * x + y * y + z * z).max()))
        return center, scale * math.sqrt(largest)

    def _world_chunks(self) -> Iterator[NDArray[np.float64]]:
        """Yield the used vertices of all nodes in world space, a bounded number at a time."""
        matrices_by_mesh: dict[Mesh, list[NDArray[np.float64]]] = {}
        for node in self.nodes:
            matrices_by_mesh.setdefault(node.mesh, []).append(node.world_from_model)
        for mesh, matrices in matrices_by_mesh.items():
            used = mesh.used_vertices()
            places = np.concatenate(matrices).reshape(-1, 4, 4)
            for start in range(0, len(used), _CHUNK):
                chunk = slice(start, start + _CHUNK)
                positions = mesh.vertices[chunk][used[chunk]]
                at_once = max(1, _CHUNK // max(1, len(positions)))
                for first in range(0, len(places) if len(positions) else 0, at_once):
                    some = places[first : first + at_once]
                    yield transform_instances(some, positions).reshape(-1, 3)


def _affine(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return a copy of an affine 4×4 matrix with an exact last row, or raise ``ValueError``."""
    matrix = finite_array(name, value, (4, 4)).copy()
    x, y, z, w = last_row = matrix[3].tolist()
    if max(abs(x), abs(y), abs(z), abs(w - 1.0)) > _LAST_ROW_ROUNDING:
        raise ValueError(
            f"{name} must be affine, with the last row 0, 0, 0, 1; got {last_row} "
            "(matrices multiply column vectors)"
        )
    matrix[3] = 0.0, 0.0, 0.0, 1.0
    return read_only(matrix)
