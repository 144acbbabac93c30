"""
Decide what the depths of faces are rounded to before they are compared.

A vertex's stored depth is ``(c0 + c1 z + c2 w) / w`` of its clip position, and greater is nearer,
in every format; formats differ in the coefficients and in the type of the arrays that hold it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.geometry.setup import LARGEST_COORDINATE
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera, PerspectiveCamera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Node
from rasterjit.survey.placement import Boxes

Float64 = NDArray[np.float64]

UNORM_BITS = {"unorm16": 16, "unorm24": 24}

REVERSED_TYPES = {"float32-reversed": np.float32, "float64": np.float64}
"""Formats that hold the reversed depth of the camera as it is."""

INFINITE = 1e-12
"""A far plane with less than this share of the near plane's reversed depth has none: it is what
rounding left of that of an infinite one."""


class DepthFormat(NamedTuple):
    """What depths are rounded to, and what they mean."""

    name: str
    kind: Any
    """Type of the arrays: float32, float64, or int32, which cuts off what is behind the point."""
    coefficients: tuple[float, float, float]
    """Of the stored depth."""
    largest: int
    """Whole number that stands for the near plane; 0 if depths are not whole numbers."""
    ends: tuple[float, float] | None
    """Reversed depth on the near and on the far plane; ``None`` if stored depth is reversed."""
    tilt: tuple[float, float]
    """What NDC x and y add to it: nothing unless the near plane is tilted."""

    @property
    def is_reversed(self) -> bool:
        """Whether the stored depth is the camera's reversed one."""
        return self.ends is None

    @property
    def is_standard(self) -> bool:
        """Whether it is the format that all passes read."""
        return self.ends is None and self.kind is np.float32

    def reversed_depth(self, stored: NDArray[Any], x: Float64, y: Float64) -> Float64:
        """
        Return the reversed depth that stored depths stand for, as the camera understands it.

        Parameters
        ----------
        stored : (N,)
        x, y : (N,) float64, NDC
            Where they were found.
        """
        if self.ends is None:
            return np.asarray(stored, np.float64)
        stored = np.asarray(stored, np.float64)
        # 1 at the near plane and 0 at the far one.
        nearness = stored / self.largest if self.largest else 1.0 + stored
        farness = 1.0 - nearness if self.largest else -stored
        across, up = self.tilt
        return (self.ends[0] * nearness + self.ends[1] * farness) + (across * x + up * y)


def depth_format(name: str, camera: Camera, size: tuple[int, int]) -> DepthFormat:
    """
    Return a format as it is for a camera.

    Parameters
    ----------
    name : str
        As ``Quality.depth_format`` has it.
    camera : Camera
    size : (int, int)
        Width and height, pixels.

    Raises
    ------
    ValueError
        If the camera's clip-space z, which this format holds, does not tell depths apart.
    """
    if name in REVERSED_TYPES:
        return _reversed_format(name, camera.depth_coefficients())
    c0, c1, c2 = camera.depth_coefficients()
    per_w = np.zeros(4)
    if c0 != 0.0:
        try:
            # One over w, from NDC x, y, z and 1.
            per_w = transforms.inverse(camera.projection_matrix(size))[3]
        except ValueError:
            raise ValueError(_refusal(name)) from None
    across, up, deeper, rest = (c0 * per_w + (0.0, 0.0, c1, c2)).tolist()
    near, far = rest - deeper, rest + deeper
    if not deeper < 0.0:
        raise ValueError(_refusal(name))
    if c0 != 0.0 and abs(far) < INFINITE * abs(near):
        far = 0.0
    return _ranged_format(name, -1.0, (near, far), (across, up))


def check_near(
    quality: Quality,
    camera: Camera,
    boxes: Boxes,
    nodes: Sequence[Node],
    clip_from_relative: Float64,
) -> None:
    """
    Refuse a perspective whose near plane is too small for what may be seen.

    Parameters
    ----------
    quality : Quality
    camera : Camera
    boxes : Boxes
        Around the objects.
    nodes : sequence of Node
        The objects.
    clip_from_relative : (4, 4) float64

    Raises
    ------
    ValueError
        If something lies beyond a far plane that float64 loses; if the depth of what is farthest
        (reversed formats) or nearest (the others, which always lose what is far) is not held.
    """
    name, near = quality.depth_format, camera.depth_coefficients()[0]
    held = _least_held(name, quality.precision)
    has_planes = isinstance(camera, PerspectiveCamera)
    far = camera.far if has_planes else math.inf
    least = transforms.LEAST_NEAR * far if far < math.inf else 0.0
    if not near > 0.0 or (near >= least and near >= held * boxes.largest_w()):
        return
    # Look at all vertices first, then at those of faces alone.
    for only_used in (False, True):
        nearest, farthest = _span(boxes, nodes, clip_from_relative[3], only_used)
        if nearest == math.inf:
            return
        reach = min(farthest, far) if name in REVERSED_TYPES else nearest
        if near >= held * reach and (near >= least or farthest <= far):
            return
    if near < least and farthest > far:
        raise ValueError(
            f"camera.near must be at least {transforms.rounded_up(least)}, or camera.far math.inf: "
            f"float64 cannot cut at camera.far = {far!r}, beyond which something lies; got "
            f"{near!r}"
        )
    raise ValueError(
        f"{'camera.near' if has_planes else 'w on the near plane of camera'} must be at least "
        f"{transforms.rounded_up(held * reach)}, so that quality.depth_format {name!r} holds the "
        f"depth of what lies {reach:.3g} away; got {near!r}"
    )


def _least_held(name: str, precision: str) -> float:
    """Return the least depth, 1 on the near plane and 0 far away, that is held, by a precision."""
    if name in REVERSED_TYPES:
        # The depths of vertices are found by their precision before they are rounded.
        kind = REVERSED_TYPES[name] if precision == "float64" else np.float32
        return float(np.finfo(kind).tiny)
    # Half a step, below which all is rounded to the far plane: float32 goes from -1 there to 0.
    return 0.5 / ((1 << UNORM_BITS[name]) - 1) if name in UNORM_BITS else 2.0**-25


def _span(
    boxes: Boxes, nodes: Sequence[Node], row: Float64, only_used: bool
) -> tuple[float, float]:
    """Return the least and the greatest w of vertices that may be seen; inf and -inf for none."""
    nearest, farthest = math.inf, -math.inf
    x, y, z, rest = row.tolist()
    for number in np.flatnonzero(boxes.in_view):
        mesh, m = nodes[number].mesh, boxes.relative_from_model[number]
        vertices = mesh.vertices[np.unique(mesh.faces)] if only_used else mesh.vertices
        with np.errstate(all="ignore"):
            a, b, c, d = (x * m[0] + y * m[1]) + z * m[2]
            w = a * vertices[:, 0] + b * vertices[:, 1] + c * vertices[:, 2] + (d + rest)
        # What is farther, or is not a number, is not drawn.
        w = w[np.abs(w) <= LARGEST_COORDINATE]
        nearest = min(nearest, float(w.min(initial=math.inf)))
        farthest = max(farthest, float(w.max(initial=-math.inf)))
    return nearest, farthest


def ndc_format(name: str, sign: float) -> DepthFormat:
    """
    Return a format for clip positions alone, as if ``sign * z / w`` were the reversed depth.

    Parameters
    ----------
    name : str
        As ``Quality.depth_format`` has it.
    sign : float
        1 or -1: where a greater or a smaller z / w is nearer.
    """
    if name in REVERSED_TYPES:
        return _reversed_format(name, (0.0, sign, 0.0))
    return _ranged_format(name, sign, (1.0, -1.0), (0.0, 0.0))


def _reversed_format(name: str, coefficients: tuple[float, float, float]) -> DepthFormat:
    """Return a format that holds the reversed depth."""
    return DepthFormat(name, REVERSED_TYPES[name], coefficients, 0, None, (0.0, 0.0))


def _ranged_format(
    name: str, sign: float, ends: tuple[float, float], tilt: tuple[float, float]
) -> DepthFormat:
    """Return a format that holds the depth from the near plane to the far one, turned round."""
    if name in UNORM_BITS:
        largest = (1 << UNORM_BITS[name]) - 1
        # The half rounds: what is behind the point is cut off.
        coefficients = 0.0, sign * largest / 2.0, largest / 2.0 + 0.5
        return DepthFormat(name, np.int32, coefficients, largest, ends, tilt)
    return DepthFormat(name, np.float32, (0.0, sign * 0.5, -0.5), 0, ends, tilt)


def _refusal(name: str) -> str:
    """Say why a camera has no depths in a format."""
    return (
        "quality.depth_format must be float32-reversed or float64 for a camera whose clip-space z "
        f"does not grow with the distance, got {name!r}"
    )
