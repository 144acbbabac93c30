"""
Joints of robots: a number for each turns or shifts a node, and all that hangs below it.

References
----------
.. [1] ROS, "URDF: joint element", https://wiki.ros.org/urdf/XML/joint: kinds, axes, limits, mimic.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike

from rasterjit.scene.arrays import Float64, HoldsArrays
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.node import Node, scene_of, subtree
from rasterjit.scene.portable_trig import sin_cos_degrees
from rasterjit.scene.transforms import product_of_each, unit_triple
from rasterjit.scene.validation import (
    brief,
    finite_array,
    finite_number,
    instance_of,
    number_array,
    one_of,
    string,
    suggest,
)
from rasterjit.scene.vectors import rotation_rows

if TYPE_CHECKING:
    from rasterjit.scene.scene import Scene

JointKind: TypeAlias = Literal["revolute", "continuous", "prismatic"]
JOINT_KINDS: tuple[JointKind, ...] = get_args(JointKind)

Number = TypeVar("Number", float, Float64)

LIMIT_ROUNDING = 1e-9
"""Degrees or scene units by which a value may be outside limits: what converting units rounds."""


class Follows(NamedTuple):
    """
    How a joint follows another one: at ``factor * joint.value + offset``.

    Parameters
    ----------
    joint : Joint
    factor, offset : float
        Values count in degrees or scene units.
    """

    joint: Joint
    factor: float = 1.0
    offset: float = 0.0


class UnknownJointError(KeyError, ValueError):
    """A scene has no joint of a name."""

    __str__ = ValueError.__str__


class Joint(HoldsArrays, Guarded):
    """
    A joint: turns a node about an axis, or shifts it along one, within limits.

    Assigning ``angle`` or ``position`` moves the node, all below it, and joints that follow.

    Parameters
    ----------
    node : Node
        What it moves. Its ``transform`` now is where it stands at value 0; it is moved to the limit
        nearest to that, or to where the joint that it follows has it.
    kind : {"revolute", "continuous", "prismatic"}
        Turns within limits, turns without any, shifts.
    axis : (3,) array_like
        Through the node's origin, in its own frame; of any length but 0.
    limits : (float, float), optional
        Least and greatest value: degrees, or scene units of a prismatic one. Default: none.
    follows : Follows or (Joint, float, float), optional
        Another joint, a factor and an offset: this one cannot be moved by itself.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene, arm = rj.Scene(), rj.Node(name="arm")
    >>> hand = rj.Node(None, rj.transforms.translate((2, 0, 0)), "hand", parent=arm)
    >>> group = scene.add(arm)
    >>> scene.joints.add("lift", rj.Joint(arm, "revolute", (0, 0, 1), limits=(-90, 90)))
    >>> scene.joints["lift"].angle = 90
    >>> hand.world_matrix[:3, 3].tolist()
    [0.0, 2.0, 0.0]
    """

    _ADVICE = "assign angle or position to move it, or make another Joint"

    def __init__(
        self,
        node: Node,
        kind: JointKind,
        axis: ArrayLike,
        limits: tuple[float, float] | None = None,
        follows: Follows | tuple[Joint, float, float] | None = None,
    ) -> None:
        self._node = instance_of("node", node, Node)
        self._kind = one_of("kind", kind, JOINT_KINDS)
        self._axis, self._origin = unit_triple("axis", axis), node.transform
        self._name = node.name
        self._limits = _check_limits(limits, self._kind)
        self._followers: list[Joint] = []
        self._follows: Follows | None = None
        low, high = self._limits
        value, self._value = min(max(0.0, low), high), 0.0
        if follows is not None:
            checked = _check_follows(follows)
            value = checked.factor * checked.joint.value + checked.offset
        if value:
            _move([(self, value)])
        if follows is not None:
            self._follow(checked)

    @property
    def name(self) -> str:
        """Its name in a scene, or that of its node."""
        return self._name

    @property
    def node(self) -> Node:
        """The node that it moves."""
        return self._node

    @property
    def kind(self) -> JointKind:
        """Whether it turns or shifts."""
        return self._kind

    @property
    def axis(self) -> tuple[float, float, float]:
        """What it turns about or shifts along, of unit length, in the node's frame."""
        return self._axis

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest value, degrees or scene units; infinite where there is none."""
        return self._limits

    @property
    def follows(self) -> Follows | None:
        """The joint that moves this one, if another does."""
        return self._follows

    @property
    def value(self) -> float:
        """The ``angle``, degrees, or of a prismatic joint the ``position``, scene units."""
        return self._value

    @value.setter
    def value(self, value: float) -> None:
        number = finite_number(f"joint {self._name!r}", value)
        self._check(np.array([number]))
        _move([(self, number)])

    @property
    def angle(self) -> float:
        """
        How far it is turned, degrees; another may be assigned.

        Raises
        ------
        ValueError
            If it is prismatic, follows another joint, or the angle is outside the limits.
        """
        self._check_kind("angle")
        return self._value

    @angle.setter
    def angle(self, value: float) -> None:
        self._check_kind("angle")
        self.value = value

    @property
    def position(self) -> float:
        """
        How far it is shifted, scene units; another may be assigned.

        Raises
        ------
        ValueError
            If it is not prismatic, follows another joint, or the position is outside the limits.
        """
        self._check_kind("position")
        return self._value

    @position.setter
    def position(self, value: float) -> None:
        self._check_kind("position")
        self.value = value

    def transforms(self, values: ArrayLike) -> Float64:
        """
        Return ``parent_from_node`` of the node at values of the joint; move nothing.

        Parameters
        ----------
        values : (N,) array_like
            Degrees or scene units, inside the limits or not.

        Returns
        -------
        (N, 4, 4) float64
        """
        amounts = finite_array("values", values, (None,))
        moved = np.broadcast_to(np.eye(4), (len(amounts), 4, 4)).copy()
        if self._kind == "prismatic":
            moved[:, :3, 3] = amounts[:, np.newaxis] * np.array(self._axis)
        else:
            sines, cosines = sin_cos_degrees(amounts)
            rows = rotation_rows(self._axis, sines, cosines)
            moved[:, :3, :3] = np.moveaxis(np.array(rows), -1, 0) + 0.0
        return product_of_each(np.broadcast_to(self._origin, moved.shape), moved)

    def _follow(self, follows: Follows) -> None:
        """Follow another joint from now on."""
        self._follows = follows
        follows.joint._followers.append(self)

    def _check_kind(self, name: str) -> None:
        """Raise ``ValueError`` if a joint of this kind has no such value."""
        fitting = "position" if self._kind == "prismatic" else "angle"
        if name != fitting:
            raise ValueError(
                f"joint {self._name!r} is {self._kind}: it has no {name} but {fitting}"
            )

    def _check(self, values: Float64) -> None:
        """Raise ``ValueError`` if the joint follows another, or a value is outside its limits."""
        if self._follows is not None:
            raise ValueError(
                f"joint {self._name!r} follows joint {self._follows.joint.name!r}: move that"
            )
        low, high = self._limits
        wrong = values[(values < low - LIMIT_ROUNDING) | (values > high + LIMIT_ROUNDING)]
        if len(wrong):
            unit = "scene units" if self._kind == "prismatic" else "degrees"
            raise ValueError(
                f"joint {self._name!r} must be in {low:g}..{high:g} {unit}, got {wrong[0]:g}"
            )

    def __getstate__(self) -> dict[str, Any]:
        """Return what is copied or pickled: a joint that follows none; a scene adds its leader."""
        return {**self.__dict__, "_follows": None, "_followers": []}

    def __repr__(self) -> str:
        return f"Joint({self._name!r}, {self._kind!r}, {self._value:g})"


class Joints(Guarded, Mapping[str, Joint]):
    """
    The joints of a scene by their names: ``scene.joints["elbow"].angle = 30``.

    Poses are rows of numbers, one for each joint of ``free``: degrees, or scene units of prismatic
    joints. `from_radians` makes them of what most robot software has.
    """

    _ADVICE = "add(name, joint) adds one, and assigning its angle or position moves it"

    def __init__(self, scene: Scene) -> None:
        if not isinstance(getattr(scene, "_joints", None), dict):
            raise ValueError(f"scene must be a Scene, got {brief(scene)}")
        self._scene, self._joints = scene, scene._joints

    def __getitem__(self, name: str) -> Joint:
        if name not in self:
            names = list(self._joints)
            known = f"one of {', '.join(map(repr, names))}" if names else "none, the scene has none"
            raise UnknownJointError(
                f"joint must be {known}, got {brief(name)}{suggest(name, names)}"
            )
        return self._joints[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._joints)

    def __len__(self) -> int:
        return len(self._joints)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self._joints

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the joints that follow no other: the columns of poses."""
        return tuple(name for name, one in self._joints.items() if one.follows is None)

    def add(self, name: str, joint: Joint) -> None:
        """
        Add a joint.

        Raises
        ------
        ValueError
            If it is none or has a name in a scene, its name is taken or no text, or its node is not
            in the scene.
        """
        instance_of("joint", joint, Joint)
        if string("name", name) in self._joints:
            raise ValueError(f"name must be that of no other joint, got {name!r}")
        if not self._scene._holds(joint.node):
            raise ValueError(f"joint must move a node of the scene, got {joint.node!r}")
        owners = (self._scene, scene_of(joint.node))
        if any(one is not None and one._joints.get(joint.name) is joint for one in owners):
            raise ValueError(f"joint must have no name in a scene yet, got {joint!r}")
        joint._name = name
        self._joints[name] = joint

    def from_radians(self, poses: ArrayLike) -> Float64:
        """
        Return poses in degrees: columns of prismatic joints stay as they are.

        Parameters
        ----------
        poses : (J,) or (N, J) array_like
            Radians, or scene units of prismatic joints; a column for each joint of ``free``.

        Returns
        -------
        (J,) or (N, J) float64
        """
        array = number_array("poses", poses)
        shape = (None, len(self.free))[array.ndim == 1 :]
        rows = finite_array("poses", array, shape)
        factors = [
            1.0 if self._joints[name].kind == "prismatic" else math.degrees(1.0)
            for name in self.free
        ]
        return rows * factors

    def move(self, pose: ArrayLike | Mapping[str, float]) -> None:
        """
        Move several joints at once, or none if a value is wrong.

        Parameters
        ----------
        pose : (J,) array_like, or mapping of str to float
            A value for each joint of ``free``; or for those that are named, while others stay.

        Raises
        ------
        ValueError
            Naming the joint, the value and what it may be.
        """
        if isinstance(pose, Mapping):
            names = self._check_names("pose", pose)
            values = [finite_number(f"pose of joint {name!r}", pose[name]) for name in names]
        else:
            names = self.free
            values = finite_array("pose", pose, (len(names),)).tolist()
        pairs = [(self._joints[name], value) for name, value in zip(names, values, strict=True)]
        for joint, value in pairs:
            joint._check(np.array([value]))
        _move(pairs)

    def transforms(self, poses: ArrayLike | Mapping[str, ArrayLike]) -> Float64:
        """
        Return where all objects stand in poses, as `rasterjit.render_batch` takes it; move nothing.

        Parameters
        ----------
        poses : (N, J) array_like, or mapping of str to (N,) array_like
            A row for each view, a column for each joint of ``free``; or columns by the names of
            joints, while others stay where they are.

        Returns
        -------
        (N, O, 4, 4) float64
            ``world_from_model`` of ``scene.nodes``, the same bits as by moving the joints.

        Raises
        ------
        ValueError
            Naming the joint, the value and what it may be.
        """
        if isinstance(poses, Mapping):
            names = self._check_names("poses", poses)
            columns = [
                finite_array(f"poses of joint {name!r}", poses[name], (None,)) for name in names
            ]
            count = len(columns[0]) if columns else 1
        else:
            names = self.free
            rows = finite_array("poses", poses, (None, len(names)))
            columns, count = list(rows.T), len(rows)
        counts = sorted({len(column) for column in columns})
        if len(counts) > 1:
            raise ValueError(f"poses must have as many values for each joint, got {counts}")
        pairs = [(self._joints[name], column) for name, column in zip(names, columns, strict=True)]
        for joint, column in pairs:
            joint._check(column)
        moved = {id(joint.node): matrices for joint, _, matrices in _with_followers(pairs)}
        return self._world_matrices(moved, count)

    def _world_matrices(self, moved: Mapping[int, Float64], count: int) -> Float64:
        """Return ``world_from_model`` of all objects, given the matrices of nodes by their ids."""
        world: dict[int, Float64] = {}
        for root in self._scene._all_roots():
            for node in subtree(root):
                parent = node.parent
                above = None if parent is None else world.get(id(parent))
                own = moved.get(id(node))
                if above is None and own is None:
                    continue
                if own is None:
                    own = np.broadcast_to(node.transform, (count, 4, 4))
                if parent is None:
                    world[id(node)] = own
                    continue
                if above is None:
                    above = np.broadcast_to(parent.world_matrix, own.shape)
                world[id(node)] = product_of_each(above, own)
        result = np.empty((count, len(self._scene.nodes), 4, 4))
        for number, node in enumerate(self._scene.nodes):
            result[:, number] = world.get(id(node), node.world_matrix)
        return result

    def _check_names(self, label: str, named: Mapping[str, Any]) -> tuple[str, ...]:
        """Return the names in a mapping, or raise ``ValueError`` if one is that of no joint."""
        for name in named:
            if name not in self._joints:
                try:
                    self[name]
                except UnknownJointError as error:
                    raise UnknownJointError(f"{label} must name joints: {error}") from None
        return tuple(named)

    def __repr__(self) -> str:
        return f"Joints({', '.join(map(repr, self._joints))})"


def copy_joints(
    joints: Mapping[str, Joint], copies: Mapping[int, Node], prefix: str = ""
) -> dict[str, Joint]:
    """
    Return copies of joints for copied nodes, by the ids of the old ones, that follow one another.

    Those whose node is not copied, or that are followed only, move an empty node of their own.
    """
    new = {
        id(old): old._with(
            _node=copies.get(id(old.node)) or Node(None, old.node.transform, old.node.name),
            _followers=[],
        )
        for old in with_leaders(joints.values())
    }
    for joint in new.values():
        if joint._follows is not None:
            joint._follow(joint._follows._replace(joint=new[id(joint._follows.joint)]))
    copied = {prefix + name: new[id(old)] for name, old in joints.items()}
    for name, joint in copied.items():
        joint._name = name
    return copied


def with_leaders(joints: Iterable[Joint]) -> list[Joint]:
    """Return joints, and all that they follow, each once."""
    result = dict.fromkeys(joints)
    for joint in list(result):
        leader = joint._follows
        while leader is not None and leader.joint not in result:
            result[leader.joint] = None
            leader = leader.joint._follows
    return list(result)


def _with_followers(pairs: list[tuple[Joint, Number]]) -> list[tuple[Joint, Number, Float64]]:
    """Return joints and all that follow them, leaders first: values, and (N, 4, 4) of nodes."""
    result, pending = [], pairs[::-1]
    while pending:
        joint, value = pending.pop()
        result.append((joint, value, joint.transforms(np.atleast_1d(value))))
        for other in joint._followers:
            assert other.follows is not None
            pending.append((other, other.follows.factor * value + other.follows.offset))
    return result


def _move(pairs: list[tuple[Joint, float]]) -> None:
    """Move joints to values, and all that follow them; or none, if a value overflows."""
    for joint, value, matrices in _with_followers(pairs):
        joint._node.transform, joint._value = matrices[0], value


def _check_limits(limits: Any, kind: str) -> tuple[float, float]:
    """Return the least and the greatest value of a joint, or raise ``ValueError``."""
    if limits is None:
        return -math.inf, math.inf
    if kind == "continuous":
        raise ValueError(f"limits must not be given for a continuous joint, got {brief(limits)}")
    ends = number_array("limits", limits)
    if ends.shape != (2,):
        raise ValueError(f"limits must be two numbers, got {brief(limits)}")
    low, high = ends.tolist()
    if not low <= high or math.inf in (low, -high):
        raise ValueError(f"limits must be the least and the greatest value, got {brief(limits)}")
    return low, high


def _check_follows(follows: Any) -> Follows:
    """Return what a joint follows, or raise ``ValueError``."""
    if not isinstance(follows, tuple) or len(follows) != 3 or not isinstance(follows[0], Joint):
        raise ValueError(f"follows must be a Joint, a factor and an offset, got {brief(follows)}")
    leader, factor, offset = follows
    label = "follows must hold numbers: its"
    return Follows(
        leader, finite_number(f"{label} factor", factor), finite_number(f"{label} offset", offset)
    )
