"""
Keyframe animations of nodes.

A channel moves one thing of one node: its translation, rotation or scale, or the weights of its
morph targets. Before the first key and after the last one its value is that of the key.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), section 3.11 and
   Appendix C.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from rasterjit.scene import portable_trig
from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Float64, HoldsArrays
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.node import Node

ChannelPath: TypeAlias = Literal["translation", "rotation", "scale", "weights"]
PATHS: tuple[ChannelPath, ...] = get_args(ChannelPath)
"""Properties of a node that a channel animates."""

ChannelInterpolation: TypeAlias = Literal["LINEAR", "STEP", "CUBICSPLINE"]
INTERPOLATIONS: tuple[ChannelInterpolation, ...] = get_args(ChannelInterpolation)
"""Interpolations between keys, by glTF's names."""

VALUE_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
"""Number of components of a value; weights have one for each morph target."""

_MIN_SINE = 1e-8
"""Of the angle between two rotations: below, they are mixed along the straight line, which is the
arc to the last bit."""


class Channel(HoldsArrays, Guarded):
    """
    Keyframes of one property of a node.

    Parameters
    ----------
    node : Node
    path : {"translation", "rotation", "scale", "weights"}
        What of it: a part of its ``trs``, or ``weights``.
    times : (N,) array_like
        When the keys are, seconds, ascending.
    values : (N, W) array_like
        Of each key: (x, y, z) in scene units of the parent, a quaternion (x, y, z, w), three
        factors, or a weight for each morph target. With ``"CUBICSPLINE"`` (N, 3, W): the tangent
        that leads in, per second, the value, and the tangent that leads out.
    interpolation : {"LINEAR", "STEP", "CUBICSPLINE"}
        Between keys: straight, rotations along the shorter arc at even speed; held until the next
        key; or a cubic Hermite spline, rotations made of unit length.

    Raises
    ------
    ValueError
        Naming the argument that is wrong; if times do not ascend, or a rotation is 0.
    AttributeError
        If anything is assigned.
    """

    _ADVICE = "make another Channel"

    def __init__(
        self,
        node: Node,
        path: ChannelPath,
        times: ArrayLike,
        values: ArrayLike,
        interpolation: ChannelInterpolation = "LINEAR",
    ) -> None:
        self._node = check.instance_of("node", node, Node)
        self._path = check.one_of("path", path, PATHS)
        self._interpolation = check.one_of("interpolation", interpolation, INTERPOLATIONS)
        self._times = check.read_only(np.array(check.finite_array("times", times, (None,))))
        if not len(self._times):
            raise ValueError("times must have a key, got none")
        if not (np.diff(self._times) > 0.0).all():
            index = int(np.argmin(np.diff(self._times) > 0.0))
            raise ValueError(
                f"times must ascend, got {self._times[index]!s} before {self._times[index + 1]!s}"
            )
        width = VALUE_WIDTHS.get(self._path)
        if width is None and node.mesh is not None and node.mesh.morph_targets is not None:
            width = len(node.mesh.morph_targets)
        parts = (3,) if self._interpolation == "CUBICSPLINE" else ()
        shape = (len(self._times), *parts, width)
        self._values = check.read_only(
            np.array(check.finite_array("values", values, shape), order="C")
        )
        if self._values.shape[-1] == 0:
            raise ValueError(f"values must have a number for each key, got {self._values.shape}")
        if self._path == "rotation":
            keys = self._values[:, 1] if parts else self._values
            if not keys.any(axis=1).all():
                index = int(np.argmin(keys.any(axis=1)))
                raise ValueError(f"values must be quaternions that are not 0, got one at {index}")

    @property
    def node(self) -> Node:
        """The animated node."""
        return self._node

    @property
    def path(self) -> ChannelPath:
        """The animated property of the node."""
        return self._path

    @property
    def times(self) -> Float64:
        """(N,) float64, read-only: times of the keys, seconds."""
        return self._times

    @property
    def values(self) -> Float64:
        """(N, W) or (N, 3, W) float64, read-only: values of the keys."""
        return self._values

    @property
    def interpolation(self) -> ChannelInterpolation:
        """Interpolation between keys."""
        return self._interpolation

    def at(self, time: float) -> Float64:
        """
        Return the value at a time.

        Parameters
        ----------
        time : float
            Seconds; before the first key and after the last one, the key's value holds.

        Returns
        -------
        (W,) float64
            Rotations are of unit length.
        """
        seconds, times = check.finite_number("time", time), self._times
        is_spline = self._interpolation == "CUBICSPLINE"
        keys = self._values[:, 1] if is_spline else self._values
        number = int(np.searchsorted(times, seconds, side="right")) - 1
        if number < 0 or number >= len(times) - 1 or self._interpolation == "STEP":
            value = keys[min(max(number, 0), len(times) - 1)]
            return _normalize_quaternion(value) if self._path == "rotation" else value.copy()
        span = float(times[number + 1] - times[number])
        t = (seconds - float(times[number])) / span
        if is_spline:
            leaving, arriving = self._values[number, 2], self._values[number + 1, 0]
            value = _hermite(keys[number], span * leaving, keys[number + 1], span * arriving, t)
            return _normalize_quaternion(value) if self._path == "rotation" else value
        if self._path == "rotation":
            return slerp_rotation(keys[number], keys[number + 1], t)
        return (1.0 - t) * keys[number] + t * keys[number + 1]

    def _with_node(self, node: Node) -> Channel:
        """Return a copy of the channel for another node."""
        return self._with(_node=node)

    def __repr__(self) -> str:
        return f"Channel({self._node.name!r}, {self._path!r}, {len(self._times)} keys)"


class Animation(HoldsArrays, Guarded):
    """
    Channels that belong together, such as a walk.

    Parameters
    ----------
    name : str
    channels : sequence of Channel
        No two may move the same of one node.

    Raises
    ------
    ValueError
        If there is no channel, one is none, or two move the same.
    AttributeError
        If anything else than ``name`` is assigned.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.Scene()
    >>> node = scene.add(rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), name="flag")
    >>> rise = rj.Channel(node, "translation", [0.0, 2.0], [[0, 0, 0], [0, 4, 0]])
    >>> scene.animations.append(rj.Animation("rise", [rise]))
    >>> scene.at(0.5).find("flag").world_matrix[:3, 3].tolist()
    [0.0, 1.0, 0.0]
    """

    _FIELDS = ("name",)
    _ADVICE = "make another Animation"

    def __init__(self, name: str, channels: Sequence[Channel]) -> None:
        self.name = name
        if isinstance(channels, (str, bytes)) or not isinstance(channels, Sequence):
            raise ValueError(f"channels must be a sequence of Channel, got {check.brief(channels)}")
        if not channels:
            raise ValueError("channels must have a Channel, got none")
        targets = set()
        for number, channel in enumerate(channels):
            check.instance_of(f"channels[{number}]", channel, Channel)
            if (id(channel.node), channel.path) in targets:
                raise ValueError(
                    f"channels must each move something else, got two for the {channel.path} of "
                    f"{channel.node!r}"
                )
            targets.add((id(channel.node), channel.path))
        self._channels = tuple(channels)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels of the animation."""
        return self._channels

    @property
    def duration(self) -> float:
        """Time of the last key of all channels, seconds."""
        return max(float(channel.times[-1]) for channel in self._channels)

    def _with_nodes(self, copies: dict[int, Node]) -> Animation:
        """
        Return a copy of the animation for copied nodes, by the ids of the old ones.

        Channels of nodes that were not copied stay as they are.
        """
        channels = (old._with_node(copies.get(id(old.node), old.node)) for old in self._channels)
        return self._with(_channels=tuple(channels))

    def __repr__(self) -> str:
        return f"Animation({self.name!r}, {len(self._channels)} channels, {self.duration:g} s)"


def slerp_rotation(start_rotation: Float64, end_rotation: Float64, t: float) -> Float64:
    """
    Interpolate two rotations along the shorter arc at even speed (slerp).

    Parameters
    ----------
    start_rotation, end_rotation : (4,) float64
        Quaternions, not 0; of another length than 1 they count as scaled to it.
    t : float
        In 0..1.

    Returns
    -------
    (4,) float64
        Of unit length.

    References
    ----------
    .. [1] The Khronos Group, "glTF 2.0 Specification", Appendix C.4.
    """
    start, end = (_normalize_quaternion(q).tolist() for q in (start_rotation, end_rotation))
    sign = -1.0 if _dot(start, end) < 0.0 else 1.0
    end = [sign * part for part in end]
    difference = [a - b for a, b in zip(start, end, strict=True)]
    total = [a + b for a, b in zip(start, end, strict=True)]
    # The arc cosine of what is near 1 has half its digits.
    angle = 2.0 * _small_arc_tangent(
        math.sqrt(_dot(difference, difference)), math.sqrt(_dot(total, total))
    )
    sine = _sine(angle)
    weights = 1.0 - t, t
    if sine >= _MIN_SINE:
        weights = _sine(angle * (1.0 - t)) / sine, _sine(angle * t) / sine
    low, high = weights
    return _normalize_quaternion(
        np.array([low * a + high * b for a, b in zip(start, end, strict=True)])
    )


def _small_arc_tangent(low: float, high: float) -> float:
    """Return the angle whose tangent is a quotient in 0..1, radians."""
    ratio = low / high
    step = math.floor(ratio * portable_trig.ARC_STEPS + 0.5)
    nearest = step / portable_trig.ARC_STEPS
    remainder = (ratio - nearest) / (1.0 + ratio * nearest)
    return portable_trig.ARCS[step] + remainder * portable_trig.polynomial(
        portable_trig.ARC_TERMS, remainder * remainder
    )


def _sine(radians: float) -> float:
    """Return the sine of an angle in 0..pi/2."""
    if radians > math.pi / 4.0:
        rest = (portable_trig.HALF_PI_HIGH - radians) + portable_trig.HALF_PI_LOW
        return portable_trig.polynomial(portable_trig.COSINE_TERMS, rest * rest)
    return radians * portable_trig.polynomial(portable_trig.SINE_TERMS, radians * radians)


def _hermite(
    first: Float64, out_tangent: Float64, second: Float64,
    in_tangent: Float64, t: float,
) -> Float64:  # fmt: skip
    """Return a cubic Hermite spline between two values with their tangents, t in 0..1."""
    square = t * t
    cube = square * t
    return (
        (2.0 * cube - 3.0 * square + 1.0) * first
        + (cube - 2.0 * square + t) * out_tangent
        + (3.0 * square - 2.0 * cube) * second
        + (cube - square) * in_tangent
    )


def _normalize_quaternion(quaternion: Float64) -> Float64:
    """Return a quaternion, (4,), of unit length; no rotation for one that is 0 or overflows."""
    parts = quaternion.tolist()
    largest = max(map(abs, parts))
    if not 0.0 < largest < math.inf:
        return np.array([0.0, 0.0, 0.0, 1.0])
    scaled = [part / largest for part in parts]
    length = math.sqrt(_dot(scaled, scaled))
    return np.array([part / length for part in scaled])


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the dot product of two quaternions, summed in one order on every CPU."""
    x, y, z, w = (p * q for p, q in zip(a, b, strict=True))
    return ((x + y) + z) + w
