"""Scenes: a tree of nodes, a background and ambient light."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.compat.pyrender.camera import Camera
from rasterjit.compat.pyrender.fields import Field, to_text_or_none
from rasterjit.compat.pyrender.light import DirectionalLight, Light, PointLight, SpotLight
from rasterjit.compat.pyrender.mesh import Mesh
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.primitive import Bounded
from rasterjit.compat.pyrender.utils import format_color_vector
from rasterjit.scene import transforms
from rasterjit.scene.validation import brief

if TYPE_CHECKING:
    import trimesh


class Scene(Bounded):
    """
    What is drawn.

    Parameters
    ----------
    nodes : iterable of Node, optional
    bg_color : float, (3,) or (4,) array_like, optional
        Background as the picture shows it: floats in 0..1 or whole numbers in 0..255; default
        white.
    ambient_light : float or (3,) array_like, optional
        Linear RGB; default none.
    name : str, optional

    Raises
    ------
    ValueError
        If a colour is none, or a node has two parents.
    """

    def __init__(
        self,
        nodes: Iterable[Node] | None = None,
        bg_color: ArrayLike | None = None,
        ambient_light: ArrayLike | None = None,
        name: str | None = None,
    ) -> None:
        self.name = name
        self.bg_color = 1.0 if bg_color is None else bg_color
        self.ambient_light = 0.0 if ambient_light is None else ambient_light
        self._parents: dict[Node, Node | None] = {}
        self._mesh_nodes: set[Node] = set()
        self._main_camera_node: Node | None = None
        given = list(nodes or ())
        below = [child for node in given for child in node.children]
        if len(set(below)) < len(below):
            raise ValueError("nodes must have one parent each, got one that has two")
        for node in given:
            if node not in below:
                self.add_node(node)

    name = Field(to_text_or_none, "str or None: the scene's name.")
    bg_color = Field(
        lambda value: np.ones(4) if value is None else format_color_vector(value, 4),
        "(4,) float32: background as the picture shows it, and alpha; None is white.",
    )
    ambient_light = Field(
        lambda value: np.zeros(3) if value is None else format_color_vector(value, 3),
        "(3,) float32: linear RGB; None is none.",
    )

    @property
    def nodes(self) -> set[Node]:
        """All nodes."""
        return set(self._parents)

    @property
    def mesh_nodes(self) -> set[Node]:
        """
        Nodes that held a mesh when they were added.

        As in pyrender it is no copy: nodes that are taken out of it are not drawn any more.
        """
        return self._mesh_nodes

    @property
    def camera_nodes(self) -> set[Node]:
        """Nodes that hold a camera."""
        return self._select_nodes(lambda node: node.camera is not None)

    @property
    def light_nodes(self) -> set[Node]:
        """Nodes that hold a light."""
        return self._select_nodes(lambda node: node.light is not None)

    @property
    def directional_lights(self) -> set[DirectionalLight]:
        """All directional lights."""
        return _collect_lights(self.directional_light_nodes)

    @property
    def spot_lights(self) -> set[SpotLight]:
        """All spot lights."""
        return _collect_lights(self.spot_light_nodes)

    @property
    def point_lights(self) -> set[PointLight]:
        """All point lights."""
        return _collect_lights(self.point_light_nodes)

    @property
    def directional_light_nodes(self) -> set[Node]:
        """Nodes that hold a directional light."""
        return self._select_nodes(lambda node: isinstance(node.light, DirectionalLight))

    @property
    def spot_light_nodes(self) -> set[Node]:
        """Nodes that hold a spot light."""
        return self._select_nodes(lambda node: isinstance(node.light, SpotLight))

    @property
    def point_light_nodes(self) -> set[Node]:
        """Nodes that hold a point light."""
        return self._select_nodes(lambda node: isinstance(node.light, PointLight))

    @property
    def meshes(self) -> set[Mesh]:
        """All meshes."""
        return {node.mesh for node in self.mesh_nodes if node.mesh is not None}

    @property
    def lights(self) -> set[Light]:
        """All lights."""
        return _collect_lights(self.light_nodes)

    @property
    def cameras(self) -> set[Camera]:
        """All cameras."""
        return {node.camera for node in self.camera_nodes if node.camera is not None}

    @property
    def main_camera_node(self) -> Node | None:
        """The node of the camera that is looked through: at first the first that was added."""
        return self._main_camera_node

    @main_camera_node.setter
    def main_camera_node(self, value: Node) -> None:
        if value not in self._parents:
            raise ValueError(f"main_camera_node must be in the scene, got {value}")
        self._main_camera_node = value

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64: corners of a box around all meshes, 0 if there are none."""
        corners = [
            transforms.apply(self.get_pose(node), _list_corners(node.mesh.bounds))
            for node in self._list_drawn_nodes()
            if np.isfinite(node.mesh.bounds).all()
        ]
        if not corners:
            return np.zeros((2, 3))
        points = np.concatenate(corners)
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def add(
        self,
        obj: Mesh | Light | Camera,
        name: str | None = None,
        pose: ArrayLike | None = None,
        parent_node: Node | None = None,
        parent_name: str | None = None,
    ) -> Node:
        """
        Place a mesh, a light or a camera, and return its new node.

        Parameters
        ----------
        obj : Mesh, Light or Camera
        name : str, optional
            Of the node.
        pose : (4, 4) array_like, optional
            Relative to the parent; default the identity. Shears and mirrors are lost, as
            `Node` says.
        parent_node : Node, optional
            Default: none.
        parent_name : str, optional
            The same by its name.

        Raises
        ------
        TypeError
            If ``obj`` is something else.
        ValueError
            If the parent is not in the scene, or not one.
        """
        node = Node(name=name, matrix=pose)
        if isinstance(obj, Mesh):
            node.mesh = obj
        elif isinstance(obj, Light):
            node.light = obj
        elif isinstance(obj, Camera):
            node.camera = obj
        else:
            raise TypeError(f"obj must be a Mesh, a Light or a Camera, got {brief(obj)}")
        if parent_node is None and parent_name is not None:
            named = self.get_nodes(name=parent_name)
            if len(named) != 1:
                raise ValueError(f"parent_name must be one node's, {parent_name!r} is {len(named)}")
            (parent_node,) = named
        self.add_node(node, parent_node)
        return node

    def add_node(self, node: Node, parent_node: Node | None = None) -> None:
        """
        Add a node and all below it.

        Raises
        ------
        ValueError
            If it is in the scene already, or its parent is not.
        """
        if node in self._parents:
            raise ValueError(f"node must not be in the scene, got {node}")
        if parent_node is not None:
            if parent_node not in self._parents:
                raise ValueError(f"parent_node must be in the scene, got {parent_node}")
            if node not in parent_node.children:
                parent_node.children.append(node)
        self._parents[node] = parent_node
        if node.mesh is not None:
            self._mesh_nodes.add(node)
        if node.camera is not None and self._main_camera_node is None:
            self._main_camera_node = node
        for child in node.children:
            self.add_node(child, node)

    def has_node(self, node: Node) -> bool:
        """Tell whether a node is in the scene."""
        return node in self._parents

    def get_nodes(
        self,
        node: Node | None = None,
        name: str | None = None,
        obj: Any = None,
        obj_name: str | None = None,
    ) -> set[Node]:
        """Return the nodes that match all that is given."""

        def matches(one: Node) -> bool:
            held = [thing for thing in (one.mesh, one.light, one.camera) if thing is not None]
            return (
                (node is None or one is node)
                and (name is None or one.name == name)
                and (obj is None or any(thing is obj for thing in held))
                and (obj_name is None or any(thing.name == obj_name for thing in held))
            )

        return self._select_nodes(matches)

    def remove_node(self, node: Node) -> None:
        """
        Take a node and all below it out of the scene.

        Raises
        ------
        ValueError
            If it is not in the scene.
        """
        if node not in self._parents:
            raise ValueError(f"node must be in the scene, got {node}")
        parent = self._parents[node]
        if parent is not None:
            parent.children.remove(node)
        self._unregister(node)

    def get_pose(self, node: Node) -> NDArray[np.float64]:
        """
        Return a node's pose in the world, (4, 4) float64; NaN if one on the way is not finite.

        Raises
        ------
        ValueError
            If it is not in the scene.
        """
        if node not in self._parents:
            raise ValueError(f"node must be in the scene, got {node}")
        chain, above = [node.matrix], self._parents[node]
        while above is not None:
            chain.append(above.matrix)
            above = self._parents[above]
        if not all(np.isfinite(pose).all() for pose in chain):
            return np.full((4, 4), np.nan)
        return transforms.compose(*reversed(chain))

    def set_pose(self, node: Node, pose: ArrayLike) -> None:
        """
        Move a node: its pose relative to its parent becomes ``pose``, (4, 4), whatever it is.

        As in pyrender the array is kept, not copied, and the node's ``rotation``, ``scale`` and
        ``translation`` stay as they were.

        Raises
        ------
        ValueError
            If it is not in the scene, or the pose is none.
        """
        if node not in self._parents:
            raise ValueError(f"node must be in the scene, got {node}")
        node._set_pose(pose)

    def clear(self) -> None:
        """Take all nodes out."""
        self._parents.clear()
        self._mesh_nodes.clear()
        self._main_camera_node = None

    @staticmethod
    def from_trimesh_scene(
        trimesh_scene: trimesh.Scene,
        bg_color: ArrayLike | None = None,
        ambient_light: ArrayLike | None = None,
    ) -> Scene:
        """
        Return the meshes of a trimesh scene, where they stand; other arguments as `Scene`.

        Those with face colours are flat, all others smooth.
        """
        smooth = {
            name: Mesh.from_trimesh(one, smooth=one.visual.kind != "face")
            for name, one in trimesh_scene.geometry.items()
        }
        scene = Scene(bg_color=bg_color, ambient_light=ambient_light)
        for node in trimesh_scene.graph.nodes_geometry:
            pose, name = trimesh_scene.graph[node]
            scene.add(smooth[name], pose=pose)
        return scene

    def _select_nodes(self, matches: Callable[[Node], bool]) -> set[Node]:
        return {node for node in self._parents if matches(node)}

    def _list_drawn_nodes(self) -> list[Node]:
        """Return the nodes whose meshes are drawn, in the order in which they were added."""
        return [
            node for node in self._parents if node in self._mesh_nodes and node.mesh is not None
        ]

    def _list_nodes(self) -> list[Node]:
        """Return all nodes in the order in which they were added, which sets do not have."""
        return list(self._parents)

    def _unregister(self, node: Node) -> None:
        for child in node.children:
            self._unregister(child)
        del self._parents[node]
        self._mesh_nodes.discard(node)
        if self._main_camera_node is node:
            cameras = [one for one in self._parents if one.camera is not None]
            self._main_camera_node = cameras[0] if cameras else None


def _list_corners(bounds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the eight corners of a box, (8, 3)."""
    return np.array([[x, y, z] for x in bounds[:, 0] for y in bounds[:, 1] for z in bounds[:, 2]])


def _collect_lights(nodes: set[Node]) -> set[Any]:
    """Return the lights of nodes."""
    return {node.light for node in nodes if node.light is not None}
