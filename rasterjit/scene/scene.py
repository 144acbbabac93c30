"""Scenes: nodes with meshes, lights, effects and perhaps a camera."""

from __future__ import annotations

import copy
import difflib
import itertools
import os
import weakref
from collections.abc import Iterable, Iterator, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import validation as check
from rasterjit.scene.ambient_occlusion import AmbientOcclusion
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.decomposed_transform import TRS, compose_trs
from rasterjit.scene.environment import Environment
from rasterjit.scene.eye_dome import EyeDome
from rasterjit.scene.fog import Fog
from rasterjit.scene.hooks import call_higher_level
from rasterjit.scene.joints import Joint, Joints, copy_joints, with_leaders
from rasterjit.scene.keyframes import Animation
from rasterjit.scene.label import Label
from rasterjit.scene.light import Light
from rasterjit.scene.lines import Lines
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node, root_of, roots_of, scene_of, subtree
from rasterjit.scene.notebook_preview import PicturePreview
from rasterjit.scene.outline import Outline
from rasterjit.scene.point_bounds import bound_points, bound_points_by_sphere
from rasterjit.scene.points import Points
from rasterjit.scene.reference_shader import ReferenceShading
from rasterjit.scene.section import SectionPlane, check_section
from rasterjit.scene.skin import Deformable, Skin
from rasterjit.scene.tone_map import ToneMap
from rasterjit.scene.transforms import transform_instances, unit_triple
from rasterjit.scene.vignette import Vignette
from rasterjit.scene.wireframe import Wireframe

if TYPE_CHECKING:
    import trimesh

    from rasterjit.scene.camera import MatrixCamera, OrthographicCamera, PerspectiveCamera

_VERTICES_PER_CHUNK = 1 << 18
"""Vertices transformed at once while measuring a scene."""

EFFECT_FIELDS: dict[str, type] = {
    "wireframe": Wireframe,
    "ambient_occlusion": AmbientOcclusion,
    "outline": Outline,
    "environment": Environment,
    "eye_dome": EyeDome,
    "fog": Fog,
    "tone_map": ToneMap,
    "vignette": Vignette,
    "section": SectionPlane,
}
"""Effect fields of a scene, and the class that each holds; ``section`` may be a tuple."""


def _check_effect(name: str, value: Any) -> Any:
    """Return what a field of ``EFFECT_FIELDS`` is to hold, or raise ``ValueError``."""
    kind = EFFECT_FIELDS[name]
    if value is not None and not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        got = check.short_repr(value)
        raise ValueError(f"scene.{name} must be {article} {kind.__name__} or None, got {got}")
    return value


class Scene(Guarded, PicturePreview):
    """
    A tree of nodes with meshes, with lights, effects and perhaps a camera.

    Attributes
    ----------
    nodes : list of Node
        Those that have a mesh, in the order they were added; a node's index is its object number.
        `add` and `remove` see to nodes that hang below others; of a list that is made otherwise,
        those that are in it are drawn.
    lights : list of AmbientLight, DirectionalLight, PointLight or SpotLight
        In any order and number; a light's index is the number that plans and explanations call it
        by. Their light adds up. Empty means that the renderer adds a headlight (a directional
        light over the viewer's right shoulder, and a little ambient light), unless there is an
        environment; a light of intensity 0 keeps it dark.
    camera : PerspectiveCamera, OrthographicCamera, MatrixCamera or None
        The camera a file brought, if any.
    up : (3,) tuple of float, or None
        Which way is up, world space, where a file says so; None for y. The camera that a picture
        without one is seen from follows it, and viewers turn about it; nothing else is turned.
    animations : list of Animation
        How its nodes can move; `at` says where they are at a time.
    wireframe : Wireframe or None
        Lines along the edges of all faces.
    environment : Environment or None
        Light from all around, seen behind all faces; with one there is no headlight.
    eye_dome : EyeDome or None
        How much darker is what lies behind something near to it on the screen.
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
    variant : str or None
        Which of ``variants`` is shown; None for what the meshes show by themselves.
    section : SectionPlane, tuple of SectionPlane or None
        What the scene is cut open by; lists of planes are kept as tuples.

    Raises
    ------
    AttributeError
        If anything else is assigned than these.
    ValueError
        If an effect, a section or a direction is assigned something that is none.
    """

    _FIELDS = ("nodes", "lights", "camera", "up", "animations", *EFFECT_FIELDS, "variant")
    _CHECKS = MappingProxyType(
        {
            **dict.fromkeys(EFFECT_FIELDS, _check_effect),
            "section": lambda _, value: check_section("section", value),
            "up": lambda name, value: None if value is None else unit_triple(name, value),
        }
    )

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.lights: list[Light] = []
        self.camera: PerspectiveCamera | OrthographicCamera | MatrixCamera | None = None
        self.up: tuple[float, float, float] | None = None
        self.animations: list[Animation] = []
        self.wireframe: Wireframe | None = None
        self.environment: Environment | None = None
        self.eye_dome: EyeDome | None = None
        self.fog: Fog | None = None
        self.tone_map: ToneMap | None = None
        self.ambient_occlusion: AmbientOcclusion | None = None
        self.outline: Outline | None = None
        self.vignette: Vignette | None = None
        self.section: SectionPlane | Sequence[SectionPlane] | None = None
        # Roots without a mesh (with or without meshes below); how many objects were removed, so
        # that default names stay apart.
        self._groups: dict[Node, None] = {}
        self._removed = 0
        # Nodes that carry a label, in the order in which they came.
        self._labelled: dict[Node, None] = {}
        # Shading as another program's shader does it, for `compat`.
        self._reference_shading: ReferenceShading | None = None
        # Names of variants that a file has, and the one that is shown.
        self._variants: tuple[str, ...] = ()
        self._variant: str | None = None
        self._joints: dict[str, Joint] = {}

    def __copy__(self) -> Scene:
        """Return a shallow copy, which shares all lists."""
        result = object.__new__(type(self))
        result.__dict__.update(self.__dict__)
        return result

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to copy or pickle, links of nodes to parents and of joints apart."""
        links = [
            (node, node.parent, node.transform, node._trs)
            for root in self._all_roots(
                itertools.chain(
                    (channel.node for one in self.animations for channel in one.channels),
                    (joint.node for joint in self._joints.values()),
                )
            )
            for node in subtree(root)
            if node.parent
        ]
        joints = with_leaders(self._joints.values())
        follows = [(one, one.follows) for one in joints if one.follows is not None]
        return {**self.__dict__, "links": links, "follows": follows}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copied or pickled scene, which owns its nodes."""
        state = dict(state)
        for node, parent, transform, trs in state.pop("links"):
            # Else its parent was restored by another scene that shares it.
            if node.parent is None:
                node._attach_copy(parent, transform, trs)
        for joint, follows in state.pop("follows"):
            if joint.follows is None:
                joint._follow(follows)
        self.__dict__.update(state)
        for node in self.every_node():
            node._scene = weakref.ref(self)

    def __repr__(self) -> str:
        counts = {"triangles": 0, "lines": 0, "points": 0}
        for mesh in (node.mesh for node in self.nodes if node.mesh is not None):
            counts[mesh.primitive] += len(mesh.faces)
        others = "".join(
            f"{counts[primitive]} {name}, "
            for primitive, name in (("lines", "segments"), ("points", "points"))
            if counts[primitive]
        )
        faces = counts["triangles"]
        return f"Scene({len(self.nodes)} objects, {faces} faces, {others}{len(self.lights)} lights)"

    def add(
        self,
        mesh: Any,
        transform: ArrayLike | None = None,
        name: str | None = None,
        *,
        parent: Node | None = None,
    ) -> Node:
        """
        Place something in the scene; adding a mesh again makes an instance that shares its arrays.

        Parameters
        ----------
        mesh : Mesh, Points, Lines, Label, Node, Scene, or an object of another package
            A `Label` is carried by a node without a mesh. A `Node` brings all that hangs below it.
            Of a scene, all nodes are copied, sharing their meshes, below the new node, with its
            animations and joints; lights, camera and effects are left out. Joints are then called
            ``"NAME/JOINT"``, or as before without a ``name``. Objects of trimesh, PyVista, Open3D
            and meshio bring what `load` takes of them.
        transform : (4, 4) array_like, optional
            Affine, for column vectors: ``world_from_model``, or, with a parent, relative to it.
            Default: the identity, or that of the `Node`.
        name : str, optional
            Default: ``"object <number>"``, as many as there are and have been removed; that of the
            `Node`; of a label, and of a scene but one mesh with the identity as transform, none.
        parent : Node, optional
            One of the scene's, with or without a mesh, that it moves with.

        Returns
        -------
        Node
            With the mesh, the last entry of ``nodes``; with the label; of a scene, the group of its
            nodes.

        Raises
        ------
        ValueError
            If ``mesh`` is none of these, is a node that hangs below another or is in a scene
            already, or a scene without faces; if the transform is not 4×4, finite and affine; or if
            the parent is not in the scene.

        Warns
        -----
        LoadWarning
            Once, naming what was left out.
        """
        if parent is not None:
            self._check_parent(parent)
        if isinstance(mesh, Node):
            return self._add_node(mesh, transform, name, parent)
        if isinstance(mesh, Mesh):
            if name is None:
                name = f"object {len(self.nodes) + self._removed}"
            node = Node(mesh, transform, str(name), parent=parent)
            if parent is None:
                node._scene = weakref.ref(self)
                self.nodes.append(node)
            return node
        if isinstance(mesh, Label):
            node = Node(None, transform, "" if name is None else str(name), label=mesh)
            return self._add_node(node, None, None, parent)
        added = call_higher_level("get_scene_to_add", mesh)
        if _is_single_mesh(added):
            return self.add(added.nodes[0].mesh, transform, name, parent=parent)
        prefix = "" if name is None else f"{name}/"
        names = [prefix + one for one in added._joints_in_scene()]
        taken = [one for one in names if one in self._joints]
        if taken:
            raise ValueError(
                f"name must keep joints apart, got {name!r}, and a joint {taken[0]!r} is there"
            )
        group, nodes, animations, joints = _copy_group(
            added, transform, "" if name is None else str(name), prefix
        )
        count = len(self.nodes)
        self._add_node(group, None, None, parent)
        self.nodes[count:] = nodes
        self.animations += animations
        self._joints |= joints
        return group

    def _add_node(
        self, node: Node, transform: ArrayLike | None, name: str | None, parent: Node | None
    ) -> Node:
        """Add a node with all below it."""
        if node.parent is not None:
            raise ValueError(
                f"mesh must be a node that hangs below no other, got {node!r} below "
                f"{node.parent!r}; its parent may be added, or set to None before"
            )
        if scene_of(node) is not None or self._holds(node):
            owner = "this" if self._holds(node) or scene_of(node) is self else "another"
            raise ValueError(
                f"mesh must be a node in no scene, got {node!r} of {owner} scene; scene.remove "
                "takes a node out"
            )
        old_transform = node.transform
        if transform is not None:
            node.transform = transform
        try:
            if parent is None:
                self._register(node)
            else:
                node.parent = parent
        except ValueError:
            node.transform = old_transform
            raise
        if name is not None:
            node.name = str(name)
        return node

    def remove(self, node: Node) -> None:
        """
        Take a node out of the scene, with all that hangs below it.

        Objects behind it in ``nodes`` move up: an object number is the index in ``nodes`` as it is,
        and instances of a mesh are counted anew; names stay. The node keeps what hangs below it,
        and its ``transform``, and may be added again, here or elsewhere. ``animations`` stay, too:
        what they move of nodes that are not in the scene is neither played nor saved. ``joints`` of
        what is taken out go, but for those that joints of the rest follow.

        Parameters
        ----------
        node : Node
            Of the scene, with or without a mesh.

        Raises
        ------
        ValueError
            If it is not in the scene.
        """
        check.instance_of("node", node, Node)
        if not self._holds(node):
            raise ValueError(f"node must be in the scene, got {node!r}")
        self._check_unshared("node", node)
        node.parent = None
        removed = set(subtree(node))
        remaining = [other for other in self.nodes if other not in removed]
        self._removed += len(self.nodes) - len(remaining)
        self.nodes[:] = remaining
        for other in removed:
            other._scene = None
            self._groups.pop(other, None)
            self._labelled.pop(other, None)
        for name in self._joints.keys() - self._joints_in_scene().keys():
            del self._joints[name]

    def find(self, name: str) -> Node:
        """
        Return the node of a name, with or without a mesh.

        Parameters
        ----------
        name : str

        Raises
        ------
        ValueError
            If no node has it, or several do.
        """
        check.string("name", name)
        nodes = self.every_node()
        matches = [node for node in nodes if node.name == name]
        if len(matches) == 1:
            return matches[0]
        if matches:
            raise ValueError(f"name must be that of one node, got {name!r} of {len(matches)}")
        similar = difflib.get_close_matches(name, [str(node.name) for node in nodes])
        hint = f"; near it are {', '.join(map(repr, similar))}" if similar else ""
        raise ValueError(f"name must be that of a node of the scene, got {name!r}{hint}")

    def save(self, path: str | os.PathLike[str]) -> None:
        """
        Write the scene to a glTF 2.0 file, whole or not at all.

        Nodes, their names and what hangs below what, meshes, colours, texture coordinates, normals,
        attributes of vertices, skins, morph targets, animations, textures, ``"pbr"`` and
        ``"unlit"`` materials, lights and the camera are kept, so that `load` draws the same again.
        Blinn-Phong materials become metallic-roughness ones with highlights of the same width;
        faces with colours of their own get vertices of their own. A ``base_color`` of None becomes
        what it is drawn as: white where the mesh has colours or the material a texture, else the
        light grey. Points and lines stay such, without their sizes, widths and dashes; points that
        are NaN or infinite are left out.

        glTF has float32: positions are rounded to it, and so are texture coordinates, whose v it
        counts from the top. Pictures get 8 bits a channel. Effects, shadows and ambient light have
        no place in it.

        Parameters
        ----------
        path : str or path-like
            Ends in ``.glb`` or ``.gltf``; the latter holds its buffers and pictures as text. An
            existing file is replaced.

        Raises
        ------
        ValueError
            If the path ends otherwise or its folder does not exist, the scene is empty, or a mesh
            has vertices that are not finite or do not fit float32.
        OSError
            If the file cannot be written; an existing one is left as it was.

        Warns
        -----
        SaveWarning
            Once, naming what the file has not, or has in another form.
        """
        call_higher_level("save_gltf", self, path)

    def to_trimesh(self) -> trimesh.Scene:
        """
        Return a ``trimesh.Scene`` with the nodes, meshes, lights and camera.

        Nodes hang together as they do here, and instances share a geometry. Those whose name
        another has, or that have none, get a number behind it. Meshes are as `Mesh.to_trimesh`
        makes them; lights lose range and shadow, and a camera has to be a perspective.

        Warns
        -----
        SaveWarning
            Once, naming what trimesh has no place for.
        """
        return call_higher_level("to_trimesh", self)

    def at(
        self,
        time: float,
        animation: str | int | Animation | Sequence[str | int | Animation] | None = None,
    ) -> Scene:
        """
        Return the scene as it is at a time of an animation.

        Parameters
        ----------
        time : float
            Seconds from the animation's beginning. Before its first key and after its last one it
            is as at these.
        animation : str, int, Animation or a sequence of them, optional
            Which of ``animations``, by its name, its number or itself; of several, what the later
            ones move they move in place of the earlier ones. Default: the first; of these, and of
            those of one name, the first that moves a node of the scene.

        Returns
        -------
        Scene
            A copy with nodes of its own, which shares meshes, lights, camera and effects. Nodes
            that no channel moves stand where they do here. It has the same animations, of its
            nodes.

        Raises
        ------
        ValueError
            If the time is not finite, there is no such animation, or it moves no node of the scene,
            as after `remove`.

        Examples
        --------
        >>> import rasterjit as rj
        >>> scene = rj.Scene()
        >>> node = scene.add(rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
        >>> keys = [[0, 0, 0, 1], [0, 0, 1, 0]]
        >>> turn = rj.Channel(node, "rotation", [0.0, 1.0], keys)
        >>> scene.animations.append(rj.Animation("turn", [turn]))
        >>> before, now = scene.at(0.4), scene.at(0.5)
        >>> view = rj.PreviousView(before)
        >>> frame = rj.render(now, size=(64, 48), outputs="motion", previous=view)
        """
        seconds = check.finite_number("time", time)
        animations = self._choose_animations(animation)
        values: dict[int, dict[str, Any]] = {}
        for chosen in animations:
            for channel in chosen.channels:
                values.setdefault(id(channel.node), {})[channel.path] = channel.at(seconds)
        return self._copy_with_values(values)

    def _choose_animations(self, animation: Any) -> list[Animation]:
        """Return the animations that an argument selects, or raise ``ValueError``."""
        if not isinstance(self.animations, list | tuple):
            raise ValueError(f"scene.animations must be a list, got {check.brief(self.animations)}")
        for number, item in enumerate(self.animations):
            check.instance_of(f"scene.animations[{number}]", item, Animation)
        if not self.animations:
            raise ValueError("animation must be one of the scene's, which has none")
        node_ids = set(map(id, self._all_nodes()))
        if animation is None:
            return [_first_moving(self.animations, node_ids)]
        if isinstance(animation, list | tuple):
            return [_first_moving(self._find_animations(item), node_ids) for item in animation]
        return [_first_moving(self._find_animations(animation), node_ids)]

    def _find_animations(self, which: Any) -> list[Animation]:
        """Return the animations of a name, a number or an `Animation`, or raise ``ValueError``."""
        names = [one.name for one in self.animations]
        if isinstance(which, str):
            matches = [one for one in self.animations if one.name == which]
            if not matches:
                known = ", ".join(map(repr, names))
                raise ValueError(
                    f"animation must be one of {known}, got {which!r}{check.suggest(which, names)}"
                )
            return matches
        if isinstance(which, Animation):
            if not any(one is which for one in self.animations):
                raise ValueError(f"animation must be one of the scene's, got {which!r}")
            return [which]
        return [self.animations[check.index_below("animation", which, len(names))]]

    def _animations_in_scene(self) -> list[Animation]:
        """Return the animations without channels of nodes that are not in the scene."""
        if not self.animations:
            return []
        node_ids = set(map(id, self._all_nodes()))
        animations = []
        for animation in self.animations:
            channels = [channel for channel in animation.channels if id(channel.node) in node_ids]
            if len(channels) == len(animation.channels):
                animations.append(animation)
            elif channels:
                animations.append(Animation(animation.name, channels))
        return animations

    @property
    def joints(self) -> Joints:
        """
        The joints of robots in the scene, by their names: ``scene.joints["elbow"].angle = 30``.

        `load` brings those of a URDF file; ``scene.joints.add`` adds others.
        """
        return Joints(self)

    def _joints_in_scene(self) -> dict[str, Joint]:
        """Return the joints that move nodes of the scene, with those that they follow."""
        node_ids = set(map(id, self._all_nodes())) if self._joints else ()
        moving = [one for one in self._joints.values() if id(one.node) in node_ids]
        kept = set(map(id, with_leaders(moving)))
        return {name: one for name, one in self._joints.items() if id(one) in kept}

    def posed(self) -> Scene:
        """
        Return the scene with all skins and weights of morph targets applied.

        Returns
        -------
        Scene
            The same objects, as they are drawn: nodes of their own, without skins, in the order of
            ``nodes``, each with its mesh as it is posed. The scene itself where nothing is posed.
        """
        return call_higher_level("pose_scene", self) if Deformable.any_made else self

    def _copy_with_values(self, changes: dict[int, dict[str, Any]]) -> Scene:
        """Return a copy that owns its nodes, with changed values by the ids of the old ones."""
        copies: dict[int, Node] = {}
        for node in self._all_nodes():
            parent = None if node.parent is None else copies[id(node.parent)]
            copies[id(node)] = _copy_node(node, parent, changes.get(id(node), {}))
        _set_skins(copies)
        copied = copy.copy(self)
        copied.nodes = [copies[id(node)] for node in self.nodes]
        copied.lights = list(self.lights)
        copied.animations = [animation._with_nodes(copies) for animation in self.animations]
        copied._joints = copy_joints(self._joints, copies)
        copied._groups = {copies[id(node)]: None for node in self._groups}
        copied._labelled = {copies[id(node)]: None for node in self._labelled}
        for node in copied.every_node():
            node._scene = weakref.ref(copied)
        return copied

    def _all_roots(self, others: Iterable[Node] = ()) -> list[Node]:
        """Return the roots of all trees, also those of joints and of other nodes."""
        roots = dict.fromkeys(roots_of((*self.nodes, *self._groups, *others)))
        pending = list(roots) if Deformable.any_made else []
        while pending:
            skins = [node._skin for root in pending for node in subtree(root)]
            joints = [one.joints for one in dict.fromkeys(skins) if one is not None]
            pending = [root for root in roots_of(itertools.chain(*joints)) if root not in roots]
            roots.update(dict.fromkeys(pending))
        return list(roots)

    def _all_nodes(self) -> Iterator[Node]:
        """Yield all nodes of the trees of `_all_roots`, each before those below it."""
        return itertools.chain.from_iterable(map(subtree, self._all_roots()))

    def every_node(self) -> list[Node]:
        """Return all nodes, with a mesh or without: tree by tree, each before those below it."""
        roots = roots_of((*self.nodes, *self._groups))
        return [node for root in roots for node in subtree(root)]

    @property
    def labelled(self) -> list[Node]:
        """
        The nodes that carry a label, in the order in which they came: later ones are drawn over.

        A new list; ``add`` and ``node.label = ...`` change which there are.
        """
        return list(self._labelled)

    @property
    def variants(self) -> tuple[str, ...]:
        """
        Names of the variants that the file has, then of those that only its meshes have.

        Each is a set of materials, as a shoe has for its colours; ``variant`` says which is shown.
        """
        meshes = {id(node.mesh): node.mesh for node in self.nodes if node.mesh is not None}
        mesh_names = (name for mesh in meshes.values() for name in mesh.variants)
        return tuple(dict.fromkeys((*self._variants, *mesh_names)))

    @property
    def variant(self) -> str | None:
        """
        Which of ``variants`` is shown, or None; another, or None, may be assigned.

        Assigning it changes the ``material`` of the meshes that are in the scene: to that of their
        variant, and where they have none of this name, to what it is without one. A mesh that
        other scenes show as well looks the same there.

        Raises
        ------
        ValueError
            If what is assigned is no name of the ``variants``.
        """
        return self._variant

    @variant.setter
    def variant(self, value: str | None) -> None:
        names = self.variants
        if value is not None and value not in names:
            listed = ", ".join(map(repr, names))
            known = f"one of {listed}, or None" if names else "None, as the scene has no variants"
            raise ValueError(
                f"variant must be {known}; got {check.brief(value)}{check.suggest(value, names)}"
            )
        for mesh in {id(node.mesh): node.mesh for node in self.nodes}.values():
            if mesh is not None:
                mesh.show_variant(value)
        self._variant = value

    def set_file_variants(self, names: Iterable[str]) -> None:
        """Put names first among ``variants``, before those that only meshes have."""
        self._variants = check.strings("names", names)

    def _update_label(self, node: Node) -> None:
        """Add a node to the labelled ones, or remove it, as its label says."""
        if node.label is None:
            self._labelled.pop(node, None)
        else:
            self._labelled[node] = None

    def _holds(self, node: Node) -> bool:
        """Tell whether a node was added to the scene, or is in ``nodes``."""
        if scene_of(node) is self:
            return True
        return node.mesh is not None and any(node is one for one in self.nodes)

    def _check_parent(self, parent: Any) -> None:
        """Raise ``ValueError`` unless a node is in the scene; register it if only in ``nodes``."""
        if not isinstance(parent, Node):
            raise ValueError(f"parent must be a Node or None, got {check.brief(parent)}")
        if not self._holds(parent):
            raise ValueError(f"parent must be a node of the scene, got {parent!r}")
        self._check_unshared("parent", parent)
        if scene_of(parent) is None:
            self._register(parent)

    def _check_unshared(self, name: str, node: Node) -> None:
        """Raise ``ValueError`` if a node belongs to another scene, as after ``copy.copy``."""
        if scene_of(node) not in (None, self):
            raise ValueError(
                f"{name} must be the scene's own, got {node!r}, which is another's as well; "
                "copy.deepcopy copies a scene with its nodes"
            )

    def _register(self, node: Node, is_new: bool = False) -> None:
        """
        Register a node's tree as this scene's, and list the nodes with a mesh.

        A new node is in no list yet.
        """
        parent = node.parent
        if parent is None or scene_of(parent) is not self:
            root = root_of(node)
            if scene_of(root) is not self:
                node = root
            if root.mesh is None:
                self._groups[root] = None
        with_mesh = []
        for member in subtree(node):
            member._scene = weakref.ref(self)
            if member.mesh is not None:
                with_mesh.append(member)
            if member.label is not None:
                self._labelled[member] = None
        listed = set(map(id, self.nodes)) if with_mesh and not is_new else ()
        self.nodes += [member for member in with_mesh if id(member) not in listed]

    def _unregister_mesh(self, node: Node) -> None:
        """Make a node that lost its mesh a group."""
        self.nodes[:] = [one for one in self.nodes if one is not node]
        self._register(node)

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return the smallest axis-parallel box around everything.

        Returns
        -------
        low, high : (3,) float64
            World-space corners, over the finite vertices that belong to a face; around points and
            lines of sizes in scene units, by half of those.

        Raises
        ------
        ValueError
            If there is no such vertex.
        """
        return bound_points(self._world_chunks)

    def bounding_sphere(self) -> tuple[NDArray[np.float64], float]:
        """
        Return a sphere that holds everything.

        Returns
        -------
        center : (3,) float64
            World-space middle of the scene's box.
        radius : float
            Distance of the farthest vertex from it, in scene units, and half the size of points and
            lines that are measured in these; 0 for a single vertex. Neither need be finite where
            coordinates are as large as float64 holds.

        Raises
        ------
        ValueError
            If no face has a finite vertex.
        """
        return bound_points_by_sphere(self._world_chunks)

    def _world_chunks(self) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64] | None]]:
        """
        Yield the used vertices of all nodes in world space, a bounded number at a time.

        Yields
        ------
        positions : (N, 3) float64
        radii : (N, 1) float64 or None
            Half the size of the point or line at each, scene units; ``None`` for faces, and for
            sizes in pixels.
        """
        matrices_by_mesh: dict[Mesh, list[NDArray[np.float64]]] = {}
        for node in self.posed().nodes:
            if node.mesh is None:
                # Rendering reports nodes without a mesh; skip here.
                continue
            matrices_by_mesh.setdefault(node.mesh, []).append(node.world_from_model)
        for mesh, matrices in matrices_by_mesh.items():
            used, vertex_radii = mesh.used_vertices(), _vertex_radii(mesh)
            instance_matrices = np.concatenate(matrices).reshape(-1, 4, 4)
            scales, uses_all_vertices = _max_scales(instance_matrices), bool(used.all())
            for start in range(0, len(used), _VERTICES_PER_CHUNK):
                chunk = slice(start, start + _VERTICES_PER_CHUNK)
                positions = mesh.vertices[chunk]
                if not uses_all_vertices:
                    positions = positions[used[chunk]]
                count = max(1, _VERTICES_PER_CHUNK // max(1, len(positions)))
                for first in range(0, len(instance_matrices) if len(positions) else 0, count):
                    chunk_matrices = instance_matrices[first : first + count]
                    radii = None
                    if vertex_radii is not None:
                        row = vertex_radii[chunk][used[chunk]]
                        radii = np.outer(scales[first : first + count], row).reshape(-1, 1)
                    yield transform_instances(chunk_matrices, positions).reshape(-1, 3), radii


def _vertex_radii(mesh: Mesh) -> NDArray[np.float64] | None:
    """Return half the size of points or lines at each vertex, (V,) float64; None if in pixels."""
    if not isinstance(mesh, Points | Lines) or mesh.unit != "world":
        return None
    sizes = mesh.sizes if isinstance(mesh, Points) else mesh.widths
    if len(sizes) == 1 or isinstance(mesh, Points):
        return np.broadcast_to(0.5 * sizes, len(mesh.vertices))
    # At a joint, that of the widest segment.
    max_radii = np.zeros(len(mesh.vertices))
    for end in mesh.segments.T:
        np.maximum.at(max_radii, end, 0.5 * sizes)
    return max_radii


def _max_scales(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest scale along an axis of each transform, (N, 4, 4), as (N,)."""
    x, y, z = matrices[:, :3, :3].swapaxes(0, 1)
    with np.errstate(over="ignore"):
        return np.sqrt((x * x + y * y) + z * z).max(axis=1)


def with_labels(scene: Scene, nodes: Iterable[Node]) -> Scene:
    """Return a copy of a scene that shows the labels of these nodes alone."""
    result = copy.copy(scene)
    result._labelled = dict.fromkeys(nodes)
    return result


def _copy_node(node: Node, parent: Node | None, values: dict[str, Any]) -> Node:
    """Return a copy of a node below a new parent, with changed transform parts or weights."""
    transform, trs = node._transform, node._trs
    parts = {path: value for path, value in values.items() if path != "weights"}
    if parts:
        trs = node.trs.with_(**parts)
        transform = compose_trs(trs)
    copied = Node(
        node._mesh, transform, node.name, parent=parent, label=node._label, section=node._section
    )
    if trs is not None:
        copied._trs = TRS(*trs)
    if node._skin is not None:
        copied._skin = node._skin
    weights = values.get("weights", node._weights)
    if weights is not None:
        copied.weights = weights
    return copied


def _is_single_mesh(scene: Scene) -> bool:
    """Tell whether a scene is one mesh, with the identity as transform."""
    if len(scene.nodes) != 1 or scene.labelled:
        return False
    (node,) = scene.nodes
    is_single = node.parent is None and not node.children and not scene.animations
    is_single = is_single and node._skin is None and node._weights is None
    is_single = is_single and not scene._joints_in_scene()
    return is_single and np.array_equal(node.transform, np.eye(4))


def _copy_group(
    scene: Scene, transform: ArrayLike | None, name: str, prefix: str
) -> tuple[Node, list[Node], list[Animation], dict[str, Joint]]:
    """
    Copy a scene's nodes into a group, in the same tree and order.

    Returns the group, the copies with a mesh, and the animations and joints of all.
    """
    group = Node(None, transform, name)
    drawn_ids = set(map(id, scene.nodes))
    copies: dict[int, Node] = {}
    for node in scene._all_nodes():
        parent = group if node.parent is None else copies[id(node.parent)]
        copied = copies[id(node)] = _copy_node(node, parent, {})
        if id(node) not in drawn_ids:
            copied._skin = copied._weights = copied._mesh = None
    _set_skins(copies)
    order = [copies[node_id] for node_id in dict.fromkeys(map(id, scene.nodes))]
    animations = [animation._with_nodes(copies) for animation in scene._animations_in_scene()]
    joints = copy_joints(scene._joints_in_scene(), copies, prefix)
    return group, [node for node in order if node.mesh is not None], animations, joints


def _first_moving(animations: Sequence[Animation], node_ids: set[int]) -> Animation:
    """Return the first animation that moves one of the nodes, given their ids, or raise."""
    for animation in animations:
        if any(id(channel.node) in node_ids for channel in animation.channels):
            return animation
    raise ValueError(
        f"animation must move a node of the scene, got {animations[0]!r}, whose nodes are not in it"
    )


def _set_skins(copies: dict[int, Node]) -> None:
    """Give copied nodes, by the ids of the old ones, skins with copied joints."""
    skins: dict[int, Skin] = {}
    for node in copies.values():
        skin = node._skin
        if skin is not None:
            if id(skin) not in skins:
                skins[id(skin)] = skin._with_joints([copies[id(one)] for one in skin.joints])
            node._skin = skins[id(skin)]
