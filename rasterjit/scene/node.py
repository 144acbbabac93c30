"""Nodes: meshes in the tree of a scene, each with a transform relative to its parent."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Float64, HoldsArrays
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.decomposed_transform import TRS, compose_trs, decompose
from rasterjit.scene.label import Label, check_label
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.skin import Skin, WorldObject, check_morph_weights, check_skin
from rasterjit.scene.transforms import compose, inverse, product_of
from rasterjit.scene.validation import brief, finite_array, read_only

if TYPE_CHECKING:
    from rasterjit.scene.scene import Scene

LAST_ROW_ROUNDING = 1e-9
"""How far a transform's last row may be from 0, 0, 0, 1, as left by products and inverses."""

_IDENTITY = read_only(np.eye(4))
_IDENTITY_ROWS = _IDENTITY.tolist()
_LAST_ROW = _IDENTITY[3].tobytes()


class Node(HoldsArrays, WorldObject, Guarded):
    """
    A node of a scene's tree: a transform, perhaps a mesh, and children that move with it.

    A node without a mesh groups others, such as the parts that hang at a joint. What is seen of a
    node stands at its ``world_matrix``: the product of the transforms of all nodes above it, from
    the topmost down, and its own. Turning a joint is assigning its ``transform``; all below it
    moves. Two nodes with the same mesh are instances of it.

    Lights and cameras are no nodes: they are values of a scene, in the world. To let one move with
    a node, make it anew from the node's ``world_matrix``.

    Parameters
    ----------
    mesh : Mesh, optional
        Default: none; the node is a group.
    transform : (4, 4) array_like, optional
        ``parent_from_node``: affine transform of column vectors, relative to the parent or, without
        one, to the world; it may mirror or flatten. Default: the identity.
    name : str, optional
        Default: empty. `Scene.find` finds nodes by their names.
    parent : Node, optional
        What the node moves with. Where the parent is in a scene, the node is then, too.
    world_from_model : (4, 4) array_like, optional
        Where the node stands in the world, in place of ``transform``.
    label : Label, optional
        A text at the node, whether it has a mesh or not.
    skin : Skin, optional
        The joints that the mesh follows, in place of the node's own place.
    weights : (T,) array_like, optional
        How strong the morph targets of the mesh are. Default: as the mesh says.
    section : bool
        Whether planes of ``scene.section`` cut it; ``False``: it stays whole, with all below it.

    Raises
    ------
    ValueError
        If ``mesh`` is not a `Mesh`, ``parent`` not a `Node`, ``label`` not a `Label`, both
        transforms are given, or one is not 4×4, finite and affine, or has no finite product with
        those above; if ``skin`` or ``weights`` do not fit the mesh, or ``section`` is no bool.
    AttributeError
        If anything else is assigned than ``mesh``, ``transform``, ``world_from_model``, ``name``,
        ``parent``, ``label``, ``skin``, ``weights`` and ``section``.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.Scene()
    >>> rod = rj.Mesh([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.1, 0.0]], [[0, 1, 2]])
    >>> upper = scene.add(rod, name="upper")
    >>> lower = scene.add(rod, rj.transforms.translate((1, 0, 0)), "lower", parent=upper)
    >>> upper.transform = rj.transforms.rotate_z(90.0)
    >>> lower.world_matrix[:3, 3].round(12).tolist()
    [0.0, 1.0, 0.0]
    """

    _FIELDS = (
        "mesh", "transform", "world_from_model", "name", "parent", "label", "skin", "weights",
        "section",
    )  # fmt: skip
    _ADVICE = "assign world_from_model, or transform, to move it, and a child's parent to hang it"

    name: str
    _mesh: Any
    _transform: Float64
    _world_from_model: Float64
    _parent: Node | None
    _label: Label | None
    _children: list[Node]
    _scene: weakref.ref[Scene] | None
    """The scene that it is in, as all above and below it, which it does not keep."""
    # Most nodes have none of them, and take no room for that.
    _skin: Skin | None = None
    _weights: Float64 | None = None
    _section: bool = True
    _trs: TRS | None = None
    """The translation, rotation and scale that ``_transform`` was made of, if any."""
    _pose_cache: Any = None
    """The node in its last pose, and what that follows from: `survey.deformation` reads it."""
    _section_cache: Any = None
    """The node as a section last cut it, and what that follows from."""
    _scene_section_cache: Any = None
    """All nodes as a section last cut them: kept by a scene's first object."""

    def __init__(
        self,
        mesh: Mesh | None = None,
        transform: ArrayLike | None = None,
        name: str = "",
        *,
        parent: Node | None = None,
        world_from_model: ArrayLike | None = None,
        label: Label | None = None,
        skin: Skin | None = None,
        weights: ArrayLike | None = None,
        section: bool = True,
    ) -> None:
        # All at once, past the check of each that is assigned.
        self.__dict__.update(
            _mesh=None if mesh is None else _check_mesh(mesh), _transform=_IDENTITY,
            _world_from_model=_IDENTITY, name=name, _parent=None, _children=[], _scene=None,
            _label=check_label(label),
        )  # fmt: skip
        if skin is not None:
            self._skin = check_skin(skin, self._mesh)
        if weights is not None:
            self._weights = check_morph_weights(weights, self._mesh)
        if section is not True:
            self.section = section
        if world_from_model is not None:
            if transform is not None:
                raise ValueError("transform must be None where world_from_model is not")
            self._move(
                _compute_local_transform(world_from_model, self, _check_parent(parent)), None
            )
        elif transform is not None:
            self._move(_check_affine("transform", transform), None)
        if parent is not None:
            self._set_parent(_check_parent(parent), is_new=True)

    @property
    def mesh(self) -> Mesh:
        """The mesh drawn at the node, ``None`` for a group; another, or none, may be assigned."""
        return self._mesh

    @mesh.setter
    def mesh(self, value: Mesh | None) -> None:
        was_drawn = self._mesh is not None
        mesh = None if value is None else _check_mesh(value)
        if self._skin is not None or self._weights is not None:
            check_skin(self._skin, mesh)
            check_morph_weights(self._weights, mesh)
        self._mesh = mesh
        scene = scene_of(self)
        if scene is not None and was_drawn != (value is not None):
            (scene._unregister_mesh if was_drawn else scene._register)(self)

    @property
    def label(self) -> Label | None:
        """The text at the node, or ``None``; another, or none, may be assigned."""
        return self._label

    @label.setter
    def label(self, value: Label | None) -> None:
        self._label = check_label(value)
        scene = scene_of(self)
        if scene is not None:
            scene._update_label(self)

    @property
    def skin(self) -> Skin | None:
        """The joints that the mesh follows, or ``None``; another, or none, may be assigned."""
        return self._skin

    @skin.setter
    def skin(self, value: Skin | None) -> None:
        self._skin = check_skin(value, self._mesh)

    @property
    def weights(self) -> Float64 | None:
        """
        How strong the morph targets of the mesh are, (T,) float64; ``None``: as the mesh says.

        Read-only: they are assigned whole, ``node.weights = [0.5, 0.0]``.
        """
        return self._weights

    @weights.setter
    def weights(self, value: ArrayLike | None) -> None:
        self._weights = check_morph_weights(value, self._mesh)

    @property
    def section(self) -> bool:
        """Whether the planes of ``scene.section`` cut it, if they cut all above it; assignable."""
        return self._section

    @section.setter
    def section(self, value: bool) -> None:
        self._section = check.boolean("section", value)

    @property
    def _is_cut(self) -> bool:
        """Whether planes cut it: no node from the topmost on is left whole."""
        node: Node | None = self
        while node is not None and node._section:
            node = node._parent
        return node is None

    def _with_mesh(self, mesh: Mesh) -> Node:
        """Return a topmost node with another mesh at the same place in the world."""
        node = Node(mesh, name=self.name, section=self._is_cut)
        node._move(self._world_from_model, None)
        return node

    @property
    def trs(self) -> TRS:
        """
        Translation, rotation and scale whose product ``transform`` is.

        As `set_trs` was given them; of a matrix that was assigned, those that come nearest: what
        shears has none that are the same.
        """
        return decompose(self._transform) if self._trs is None else self._trs

    def set_trs(
        self,
        translation: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
    ) -> None:
        """
        Move the node by parts of its transform; what is not given stays.

        Parameters
        ----------
        translation : (3,) array_like, optional
            In units of the parent.
        rotation : (4,) array_like, optional
            Quaternion x, y, z, w, of any length but 0.
        scale : (3,) array_like, optional
            Factors along the node's own axes; below 0 they mirror.

        Raises
        ------
        ValueError
            Naming the argument that has another shape, is not finite, or a rotation of 0.
        """
        trs = self.trs.with_(translation, rotation, scale)
        self.transform = compose_trs(trs)
        self._trs = trs

    @property
    def transform(self) -> Float64:
        """
        ``parent_from_node``, (4, 4) float64: where it stands below its parent.

        Read-only: it is assigned whole, ``node.transform = matrix``, never an entry of it.
        """
        return self._transform

    @transform.setter
    def transform(self, value: ArrayLike) -> None:
        self._move(_check_affine("transform", value), self._parent)

    @property
    def world_matrix(self) -> Float64:
        """
        ``world_from_model``, (4, 4) float64, read-only: the product from the topmost node on.

        To move the node, ``transform`` or ``world_from_model`` is assigned whole.
        """
        return self._world_from_model

    @property
    def world_from_model(self) -> Float64:
        """
        ``world_matrix`` by the name it has in products; assigning moves the node there.

        ``transform`` then becomes what leads there from the parent, so that the product is what was
        assigned up to rounding; without a parent they are the same.
        """
        return self._world_from_model

    @world_from_model.setter
    def world_from_model(self, value: ArrayLike) -> None:
        self._move(_compute_local_transform(value, self, self._parent), self._parent)

    @property
    def parent(self) -> Node | None:
        """
        The node that this one moves with, or ``None``; another, or none, may be assigned.

        The node keeps its ``transform``, which from then on is relative to the new parent. To keep
        the place instead, assign ``world_from_model`` as it was. Nodes in a scene stay in it; a
        node that is hung into a scene is added to it with all below it.
        """
        return self._parent

    @parent.setter
    def parent(self, value: Node | None) -> None:
        if _check_parent(value) is not self._parent:
            self._set_parent(value)

    @property
    def children(self) -> tuple[Node, ...]:
        """The nodes whose ``parent`` this is, in the order in which they became so."""
        return tuple(self._children)

    def _set_parent(self, parent: Node | None, is_new: bool = False) -> None:
        """Move to another parent, or raise ``ValueError``; a new node is in no scene's list."""
        # What has nothing below it lies above nothing: chains grow without a look at all of them.
        ancestor, scene = parent if self._children or parent is self else None, scene_of(self)
        while ancestor is not None:
            if ancestor is self:
                raise ValueError(
                    f"parent must not lie below the node, got {parent!r} for {self.name!r}"
                )
            ancestor = ancestor._parent
        new_scene = scene if parent is None else scene_of(parent) or scene
        if scene is not None and new_scene is not scene:
            raise ValueError(
                f"parent must be in the node's scene, but {self.name!r} is in one and "
                f"{parent!r} in another; scene.remove takes a node out"
            )
        self._move(self._transform, parent)
        if self._parent is not None:
            self._parent._children.remove(self)
        self.__dict__["_parent"] = parent
        if parent is not None:
            parent._children.append(self)
        if new_scene is not None:
            new_scene._register(self, is_new)

    def _move(self, transform: Float64, parent: Node | None) -> None:
        """Set transform and parent, and all world matrices below; or raise, changing nothing."""
        if self._trs is not None and transform is not self._transform:
            self._trs = None
        if parent is None and not self._children:
            self.__dict__.update(_transform=transform, _world_from_model=transform)
            return
        above = None if parent is None else parent._world_from_model
        poses = [(self, _compute_world_matrix(self, transform, above))]
        for node, pose in poses:
            for child in node._children:
                poses.append((child, _compute_world_matrix(child, child._transform, pose)))
        self.__dict__["_transform"] = transform
        for node, pose in poses:
            node.__dict__["_world_from_model"] = pose

    def __getstate__(self) -> dict[str, Any]:
        """Return what is copied or pickled: a node of its own at the same place, in no scene."""
        detached: dict[str, Any] = {"_parent": None, "_children": [], "_scene": None}
        if self._trs is not None and self._parent is not None:
            detached["_trs"] = None
        state = {**self.__dict__, **detached, "_transform": self._world_from_model}
        for name in ("_pose_cache", "_section_cache", "_scene_section_cache"):
            state.pop(name, None)
        return state

    def _attach_copy(self, parent: Node, transform: Float64, trs: TRS | None = None) -> None:
        """Attach a copied node to the copy of its parent, without moving it in the world."""
        self._parent, self._transform = parent, read_only(transform)
        parent._children.append(self)
        if trs is not None:
            self._trs = trs

    def __repr__(self) -> str:
        content = f"{len(self._children)} children" if self._mesh is None else repr(self._mesh)
        label = "" if self._label is None else f", label {self._label.text!r}"
        return f"Node({self.name!r}, {content}{label})"


def meshes_of(nodes: Sequence[Node]) -> list[Mesh]:
    """Return the mesh of each node; four times faster than by its property."""
    return [node._mesh for node in nodes]


def matrices_of(nodes: Sequence[Node]) -> list[Float64]:
    """Return ``world_from_model``, (4, 4) float64, of each node."""
    return [node._world_from_model for node in nodes]


def check_no_groups(nodes: Sequence[Node]) -> None:
    """Raise ``ValueError`` if one of a scene's objects has no mesh."""
    for number, node in enumerate(nodes):
        if node._mesh is None:
            raise ValueError(
                f"scene.nodes[{number}] must have a mesh, got {node!r}; scene.add takes groups"
            )


def root_of(node: Node) -> Node:
    """Return the root of the tree that a node is in, perhaps itself."""
    while node._parent is not None:
        node = node._parent
    return node


def roots_of(nodes: Iterable[Node]) -> list[Node]:
    """Return the roots of some nodes' trees, each once, in order."""
    root_by_node: dict[Node, Node] = {}
    roots: dict[Node, None] = {}
    for node in nodes:
        path = []
        while node not in root_by_node and node._parent is not None:
            path.append(node)
            node = node._parent
        root = root_by_node.setdefault(node, node)
        root_by_node.update(dict.fromkeys(path, root))
        roots[root] = None
    return list(roots)


def scene_of(node: Node) -> Scene | None:
    """Return the scene that a node was added to, ``None`` if it was to none."""
    reference = node._scene
    return None if reference is None else reference()


def subtree(node: Node) -> Iterator[Node]:
    """Yield a node and all below it, each before its children, in their order."""
    stack = [node]
    while stack:
        node = stack.pop()
        yield node
        stack += reversed(node._children)


def _compute_world_matrix(
    node: Node, transform: Float64, world_from_parent: Float64 | None
) -> Float64:
    """Return ``world_from_model`` of a node, given its transform and its parent's matrix."""
    if world_from_parent is None or transform is _IDENTITY:
        # No product, which would lose the signs of zeros.
        return transform if world_from_parent is None else world_from_parent
    try:
        # Both are finite, and copied.
        rows = product_of(_IDENTITY_ROWS, world_from_parent.tolist(), transform.tolist())
        return read_only(np.array(rows))
    except ValueError as error:
        raise ValueError(
            f"transform of {node.name!r} must have a finite product with those above it: {error}"
        ) from None


def _compute_local_transform(value: ArrayLike, node: Node, parent: Node | None) -> Float64:
    """Return the transform below a parent that gives a node this ``world_from_model``."""
    transform = _check_affine("world_from_model", value)
    if parent is None:
        return transform
    try:
        return _check_affine(
            "world_from_model", compose(inverse(parent._world_from_model), transform)
        )
    except ValueError:
        raise ValueError(
            f"world_from_model of {node.name!r} must be within reach of its parent, "
            f"{parent.name!r}, whose world_matrix has no inverse that leads there; assign transform"
        ) from None


def _check_parent(value: Any) -> Node | None:
    """Return a node or None, or raise ``ValueError``."""
    if value is not None and not isinstance(value, Node):
        raise ValueError(f"parent must be a Node or None, got {brief(value)}")
    return value


def _check_mesh(value: Any) -> Mesh:
    """Return a mesh, or raise ``ValueError``."""
    if not isinstance(value, Mesh):
        raise ValueError(
            f"mesh must be a rasterjit Mesh, got {type(value).__name__}; scene.add, rasterjit.load "
            "and rasterjit.render take trimesh objects"
        )
    return value


def _check_affine(name: str, value: ArrayLike) -> Float64:
    """Return a copy of an affine 4×4 matrix with an exact last row, or raise ``ValueError``."""
    matrix = finite_array(name, value, (4, 4)).copy()
    if matrix[3].tobytes() != _LAST_ROW:
        x, y, z, w = last_row = matrix[3].tolist()
        if max(abs(x), abs(y), abs(z), abs(w - 1.0)) > LAST_ROW_ROUNDING:
            raise ValueError(
                f"{name} must be affine, with the last row 0, 0, 0, 1; got {last_row} "
                "(matrices multiply column vectors)"
            )
        matrix[3] = 0.0, 0.0, 0.0, 1.0
    return read_only(matrix)
