"""Nodes: what stands where, and what moves with it."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rasterjit.scene.arrays import Float64, HoldsArrays
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.decomposed_transform import TRS, matrix_of, parts_of
from rasterjit.scene.label import Label, check_label
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.skin import Placed, Skin, check_morph_weights, check_skin
from rasterjit.scene.transforms import compose, inverse, product_of
from rasterjit.scene.validation import finite_array, in_short, read_only

if TYPE_CHECKING:
    from rasterjit.scene.scene import Scene

LAST_ROW_ROUNDING = 1e-9
"""How far a transform's last row may be from 0, 0, 0, 1, as left by products and inverses."""

_IDENTITY = read_only(np.eye(4))
_IDENTITY_ROWS = _IDENTITY.tolist()
_LAST_ROW = _IDENTITY[3].tobytes()


class Node(HoldsArrays, Placed, Guarded):
    """
    A place in a scene: a mesh that stands there, or none, and further nodes that move with it.

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

    Raises
    ------
    ValueError
        If ``mesh`` is not a `Mesh`, ``parent`` not a `Node`, ``label`` not a `Label`, both
        transforms are given, or one is not 4×4, finite and affine, or has no finite product with
        those above; if ``skin`` or ``weights`` do not fit the mesh.
    AttributeError
        If anything else is assigned than ``mesh``, ``transform``, ``world_from_model``, ``name``,
        ``parent``, ``label``, ``skin`` and ``weights``.

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
    )  # fmt: skip
    _INSTEAD = "assign world_from_model, or transform, to move it, and a child's parent to hang it"

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
    _trs: TRS | None = None
    """What ``_transform`` was made of, where that is known."""
    _posed: Any = None
    """What it was drawn as in its last pose, and what that follows from: `survey.deformation`."""
    _cut: Any = None
    """What a section left of it when it was last cut, and what that follows from."""
    _cut_scene: Any = None
    """Of a scene's first object: what was left of all of them."""

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
    ) -> None:
        # All at once, past the check of each that is assigned.
        self.__dict__.update(
            _mesh=None if mesh is None else _checked_mesh(mesh), _transform=_IDENTITY,
            _world_from_model=_IDENTITY, name=name, _parent=None, _children=[], _scene=None,
            _label=check_label(label),
        )  # fmt: skip
        if skin is not None:
            self._skin = check_skin(skin, self._mesh)
        if weights is not None:
            self._weights = check_morph_weights(weights, self._mesh)
        if world_from_model is not None:
            if transform is not None:
                raise ValueError("transform must be None where world_from_model is not")
            self._place(_leading_to(world_from_model, self, _checked_parent(parent)), None)
        elif transform is not None:
            self._place(_affine("transform", transform), None)
        if parent is not None:
            self._hang(_checked_parent(parent), is_new=True)

    @property
    def mesh(self) -> Mesh:
        """What stands there, ``None`` for a group; another, or none, may be assigned."""
        return self._mesh

    @mesh.setter
    def mesh(self, value: Mesh | None) -> None:
        was_drawn = self._mesh is not None
        mesh = None if value is None else _checked_mesh(value)
        if self._skin is not None or self._weights is not None:
            check_skin(self._skin, mesh)
            check_morph_weights(self._weights, mesh)
        self._mesh = mesh
        scene = scene_of(self)
        if scene is not None and was_drawn != (value is not None):
            (scene._drop if was_drawn else scene._take)(self)

    @property
    def label(self) -> Label | None:
        """The text at the node, or ``None``; another, or none, may be assigned."""
        return self._label

    @label.setter
    def label(self, value: Label | None) -> None:
        self._label = check_label(value)
        scene = scene_of(self)
        if scene is not None:
            scene._know_label(self)

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
    def trs(self) -> TRS:
        """
        What ``transform`` is the product of: translation, rotation and scale.

        As `set_trs` was given them; of a matrix that was assigned, those that come nearest: what
        shears has none that are the same.
        """
        return parts_of(self._transform) if self._trs is None else self._trs

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
        self.transform = matrix_of(trs)
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
        self._place(_affine("transform", value), self._parent)

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
        self._place(_leading_to(value, self, self._parent), self._parent)

    @property
    def parent(self) -> Node | None:
        """
        What the node moves with, or ``None``; another, or none, may be assigned.

        The node keeps its ``transform``, which from then on is relative to the new parent. To keep
        the place instead, assign ``world_from_model`` as it was. Nodes in a scene stay in it; a
        node that is hung into a scene is added to it with all below it.
        """
        return self._parent

    @parent.setter
    def parent(self, value: Node | None) -> None:
        if _checked_parent(value) is not self._parent:
            self._hang(value)

    @property
    def children(self) -> tuple[Node, ...]:
        """The nodes whose ``parent`` this is, in the order in which they became so."""
        return tuple(self._children)

    def _hang(self, parent: Node | None, is_new: bool = False) -> None:
        """Move to another parent, or raise ``ValueError``; what is new is in no scene's list."""
        # What has nothing below it lies above nothing: chains grow without a look at all of them.
        above, scene = parent if self._children or parent is self else None, scene_of(self)
        while above is not None:
            if above is self:
                raise ValueError(
                    f"parent must not lie below the node, got {parent!r} for {self.name!r}"
                )
            above = above._parent
        joined = scene if parent is None else scene_of(parent) or scene
        if scene is not None and joined is not scene:
            raise ValueError(
                f"parent must be in the node's scene, but {self.name!r} is in one and "
                f"{parent!r} in another; scene.remove takes a node out"
            )
        self._place(self._transform, parent)
        if self._parent is not None:
            self._parent._children.remove(self)
        self.__dict__["_parent"] = parent
        if parent is not None:
            parent._children.append(self)
        if joined is not None:
            joined._take(self, is_new)

    def _place(self, transform: Float64, parent: Node | None) -> None:
        """Move with all below to a transform below a parent; if it cannot be, nothing moves."""
        if self._trs is not None and transform is not self._transform:
            self._trs = None
        if parent is None and not self._children:
            self.__dict__.update(_transform=transform, _world_from_model=transform)
            return
        above = None if parent is None else parent._world_from_model
        moved = [(self, _placed(self, transform, above))]
        for node, place in moved:
            moved += [(child, _placed(child, child._transform, place)) for child in node._children]
        self.__dict__["_transform"] = transform
        for node, place in moved:
            node.__dict__["_world_from_model"] = place

    def __getstate__(self) -> dict[str, Any]:
        """Return what is copied or pickled: a node of its own at the same place, in no scene."""
        alone: dict[str, Any] = {"_parent": None, "_children": [], "_scene": None}
        if self._trs is not None and self._parent is not None:
            alone["_trs"] = None
        state = {**self.__dict__, **alone, "_transform": self._world_from_model}
        for name in ("_posed", "_cut", "_cut_scene"):
            state.pop(name, None)
        return state

    def _link(self, parent: Node, transform: Float64, trs: TRS | None = None) -> None:
        """Hang a copied node, which stands at its place, below the copy of its parent."""
        self._parent, self._transform = parent, read_only(transform)
        parent._children.append(self)
        if trs is not None:
            self._trs = trs

    def __repr__(self) -> str:
        held = f"{len(self._children)} children" if self._mesh is None else repr(self._mesh)
        said = "" if self._label is None else f", label {self._label.text!r}"
        return f"Node({self.name!r}, {held}{said})"


def meshes_of(nodes: Sequence[Node]) -> list[Mesh]:
    """Return the mesh of each node; four times faster than by its property."""
    return [node._mesh for node in nodes]


def matrices_of(nodes: Sequence[Node]) -> list[Float64]:
    """Return ``world_from_model``, (4, 4) float64, of each node."""
    return [node._world_from_model for node in nodes]


def check_drawn(nodes: Sequence[Node]) -> None:
    """Raise ``ValueError`` if one of a scene's objects is a group."""
    for number, node in enumerate(nodes):
        if node._mesh is None:
            raise ValueError(
                f"scene.nodes[{number}] must have a mesh, got {node!r}; scene.add takes groups"
            )


def topmost(node: Node) -> Node:
    """Return the node above all others that a node hangs below, perhaps itself."""
    while node._parent is not None:
        node = node._parent
    return node


def tops_of(nodes: Iterable[Node]) -> list[Node]:
    """Return the topmost nodes above some, in order, passing each node on the way once."""
    tops: dict[Node, Node] = {}
    found: dict[Node, None] = {}
    for node in nodes:
        passed = []
        while node not in tops and node._parent is not None:
            passed.append(node)
            node = node._parent
        top = tops.setdefault(node, node)
        tops.update(dict.fromkeys(passed, top))
        found[top] = None
    return list(found)


def scene_of(node: Node) -> Scene | None:
    """Return the scene that a node was added to, ``None`` if it was to none."""
    kept = node._scene
    return None if kept is None else kept()


def with_all_below(node: Node) -> Iterator[Node]:
    """Yield a node and all below it, each before its children, in their order."""
    waiting = [node]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += reversed(node._children)


def _placed(node: Node, transform: Float64, world_from_parent: Float64 | None) -> Float64:
    """Return ``world_from_model`` of a node that stands at a transform below a parent, or none."""
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


def _leading_to(value: ArrayLike, node: Node, parent: Node | None) -> Float64:
    """Return the transform that takes a node below a parent to a place in the world."""
    transform = _affine("world_from_model", value)
    if parent is None:
        return transform
    try:
        return _affine("world_from_model", compose(inverse(parent._world_from_model), transform))
    except ValueError:
        raise ValueError(
            f"world_from_model of {node.name!r} must be within reach of its parent, "
            f"{parent.name!r}, whose world_matrix has no inverse that leads there; assign transform"
        ) from None


def _checked_parent(value: Any) -> Node | None:
    """Return a node or None, or raise ``ValueError``."""
    if value is not None and not isinstance(value, Node):
        raise ValueError(f"parent must be a Node or None, got {in_short(value)}")
    return value


def _checked_mesh(value: Any) -> Mesh:
    """Return a mesh, or raise ``ValueError``."""
    if not isinstance(value, Mesh):
        raise ValueError(
            f"mesh must be a rasterjit Mesh, got {type(value).__name__}; scene.add, rasterjit.load "
            "and rasterjit.render take trimesh objects"
        )
    return value


def _affine(name: str, value: ArrayLike) -> Float64:
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
