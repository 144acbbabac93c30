"""
Describe a camera's view in words: pose, up axis, and share of the scene in view.

The description helps find wrong poses that are valid matrices: another program's convention,
degrees for radians, a transposed rotation. Points sampled on the surfaces are tested, not all
vertices, which takes milliseconds for any scene.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera
from rasterjit.scene.node import Node
from rasterjit.scene.pixel_projection import clip_from_relative

Float64 = NDArray[np.float64]
Row = tuple[str, str]

SAMPLE_POINTS = 4096
"""Number of sample points, distributed over the surfaces by area."""

MAX_MEASURED_FACES = 1 << 16
"""Most faces whose areas are measured; of larger scenes every n-th."""

MAX_SAMPLED_OBJECTS = 1024
"""Most objects sampled; of more every n-th."""

MIN_MEASURED_FACES = 16
"""Fewest faces measured of each object, if it has as many."""

R2_STEPS = 0.7548776662466927, 0.5698402909980532
"""Steps of the R2 low-discrepancy sequence, which places points on faces."""

MIN_AXIS_LENGTH = 0.02
"""Least projected length of a unit axis; shorter ones have no direction in the picture."""

AXES = ("y", 1), ("z", 2), ("x", 0)
"""World axes and their numbers, in order of preference for up."""


class LensProjection(NamedTuple):
    """Projection functions of a lens."""

    pixels: Callable[[Float64], Float64]
    """Projects points relative to the eye, (N, 3), to pixels (N, 2); NaN if not visible."""
    directions: Callable[[Float64, Float64], Float64]
    """Returns ray directions, (R, C, 3), at columns (C,) and rows (R,), of any length; zero or NaN
    beyond the field of view."""
    clips: tuple[Float64, ...]
    """`clip_from_relative` of each pinhole picture that the frame is resampled from."""


class CameraView(NamedTuple):
    """A camera's view of a scene; prints as text."""

    nodes: tuple[Node, ...]
    camera: Camera
    size: tuple[int, int]
    lens: LensProjection | None = None
    """``None`` -> no lens."""

    def rows(self) -> list[Row]:
        """Return rows of text: name and description."""
        clip = clip_from_relative(self.camera, self.size)
        rows = []
        try:
            axes = _find_picture_axes(clip)
            rows = [("camera", self._describe_pose(clip, axes)), ("up", _describe_up(axes))]
        except ValueError:
            rows = [("camera", "flattens space")]
        points = spread_points(self.nodes, self.camera.eye_position())
        if len(points):
            rows.append(("in view", self._describe_view(clip, points)))
        return rows

    def _describe_pose(self, clip: Float64, axes: Sequence[Float64]) -> str:
        """Describe the camera's position, direction and field of view."""
        eye, forward = _format_triple(self.camera.eye_position()), _format_triple(axes[2])
        pose = f"at {eye}, looks along {forward}"
        if not clip[3, :3].any():
            vertical = 2.0 * clip[3, 3] / np.dot(clip[1, :3], axes[1])
            return f"parallel, {pose}, {vertical:.4g} units from top to bottom"
        if self.lens is not None:
            across, down = 0.5 * self.size[0], float(self.size[1])
            rows = np.array([0.0, 0.5 * down, down])
            top, middle, bottom = self.lens.directions(np.array([across]), rows)[:, 0]
            vertical = math.degrees(_angle_between(top, middle) + _angle_between(middle, bottom))
            # Beyond its field of view a lens has no rays.
            angle = "" if math.isnan(vertical) else f", {vertical:.3g} degrees from top to bottom"
            return f"perspective, {pose}, through a lens{angle}"
        # The angle between the rays at the middles of the upper and the lower edge.
        angle = _angle_between(*_unproject_directions(clip, [(0.0, 1.0), (0.0, -1.0)]))
        return f"perspective, {pose}, {math.degrees(angle):.3g} degrees from top to bottom"

    def _describe_view(self, clip: Float64, points: Float64) -> str:
        """Describe the share of the surfaces in view, its size, and where the rest is."""
        width, height = self.size
        if self.lens is None:
            x, y, z, w = transforms.transform_points(clip, points).T
            is_away_by_reason = {
                "behind the camera": ~((w > 0.0) & (w < math.inf)),
                "beside the picture": ~((np.abs(x) <= w) & (np.abs(y) <= w)),
                "before the near plane": z < -w,
                "beyond the far plane": z > w,
            }
            with np.errstate(all="ignore"):
                positions = 0.5 * width * x / w, 0.5 * height * y / w
        else:
            is_away_by_reason, positions = self._locate_through_lens(self.lens, clip, points)
        is_left = np.ones(len(points), bool)
        shares = []
        for name, is_away in is_away_by_reason.items():
            count = int(np.count_nonzero(is_left & is_away))
            is_left &= ~is_away
            if count:
                shares.append(f"{_format_percent(count, len(points))} {name}")
        count = int(np.count_nonzero(is_left))
        text = f"{_format_percent(count, len(points))} of the surface"
        if not count:
            # Small objects between the sample points may be in view.
            text = f"none of {len(points)} points on the surface"
        else:
            width_px, height_px = (math.ceil(np.ptp(values[is_left])) for values in positions)
            pixels = f"{width_px} x {height_px}"
            text += f", over {pixels} of {width} x {height} pixels"
        return "; ".join([text, ", ".join(shares)] if shares else [text])

    def _locate_through_lens(
        self, lens: LensProjection, clip: Float64, points: Float64
    ) -> tuple[dict[str, NDArray[np.bool_]], tuple[Float64, Float64]]:
        """Return which points are out of view, by reason, and columns and rows of all points."""
        column, row = lens.pixels(points).T
        is_inside = (column >= 0.0) & (column <= self.size[0])
        is_inside &= (row >= 0.0) & (row <= self.size[1])
        is_there, is_drawn, is_near = np.zeros((3, len(points)), bool)
        for picture in lens.clips:
            x, y, z, w = transforms.transform_points(picture, points).T
            is_shown = (w > 0.0) & (np.abs(x) <= w) & (np.abs(y) <= w)
            is_there |= is_shown
            is_drawn |= is_shown & (np.abs(z) <= w)
            is_near |= is_shown & (z < -w)
        ahead = transforms.transform_points(clip, points)[:, 3]
        away = {
            "behind the camera": np.isnan(column) & ~(ahead > 0.0),
            "beside the picture": ~(is_inside & is_there),
            "before the near plane": ~is_drawn & is_near,
            "beyond the far plane": ~is_drawn,
        }
        return away, (column, row)


def _describe_up(axes: Sequence[Float64]) -> str:
    """Describe the world axis that is up in the picture, and whether the picture is mirrored."""
    right, up, ahead = axes
    candidates = []
    for order, (name, axis) in enumerate(AXES):
        for sign in "+-":
            x, y = (float(f"{sign}1") * float(direction[axis]) for direction in (right, up))
            if math.hypot(x, y) > MIN_AXIS_LENGTH:
                tilt = round(abs(math.degrees(math.atan2(x, y))), 1)
                candidates.append((tilt, order, f"{sign}{name}", "right" if x > 0.0 else "left"))
    tilt, _, name, side = min(candidates)
    text = f"{name} of the world" + (f", {tilt:g} degrees to the {side}" if tilt else "")
    # Right, up and backward are right-handed unless the picture is mirrored.
    return text + ("; mirrored" if np.dot(np.cross(right, up), ahead) > 0.0 else "")


def spread_points(nodes: Sequence[Node], eye: Float64) -> Float64:
    """Sample points on the surfaces of objects by area, (N, 3), relative to the eye."""
    nodes = nodes[:: -(-len(nodes) // MAX_SAMPLED_OBJECTS) or 1]
    max_faces = max(MIN_MEASURED_FACES, MAX_MEASURED_FACES // max(1, len(nodes)))
    triangles, weights = [np.empty((0, 3, 3))], [np.empty(0)]
    for node in nodes:
        faces = node.mesh.faces
        step = -(-len(faces) // max_faces) or 1
        corners = np.asarray(node.mesh.vertices, np.float64)[faces[::step]]
        world = transforms.transform_points(node.world_from_model, corners.reshape(-1, 3))[:, :3]
        with np.errstate(over="ignore", invalid="ignore"):
            corners = (world - eye).reshape(-1, 3, 3)
        corners = corners[np.isfinite(corners).all(axis=(1, 2))]
        triangles.append(corners)
        weights.append(step * _double_areas(corners))
    corners, areas = np.concatenate(triangles), np.concatenate(weights)
    if not len(corners):
        return corners[:, 0]
    largest = areas.max()
    # Lines and points have no area: all have the same weight.
    ends = np.cumsum(areas / largest if 0.0 < largest < math.inf else np.ones(len(areas)))
    count = np.arange(SAMPLE_POINTS)
    chosen = np.searchsorted(ends, (count + 0.5) / SAMPLE_POINTS * ends[-1]).clip(0, len(ends) - 1)
    u, v = ((0.5 + step * count) % 1.0 for step in R2_STEPS)
    folded = u + v > 1.0
    u, v = np.where(folded, 1.0 - u, u)[:, np.newaxis], np.where(folded, 1.0 - v, v)[:, np.newaxis]
    a, b, c = corners[chosen].transpose(1, 0, 2)
    with np.errstate(over="ignore", invalid="ignore"):
        return a + u * (b - a) + v * (c - a)


def _double_areas(corners: Float64) -> Float64:
    """Return twice the areas of triangles, (N, 3, 3)."""
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.nan_to_num(np.sqrt(np.square(sides).sum(axis=1)), nan=0.0, posinf=0.0)


def _unproject_directions(clip: Float64, positions: Sequence[tuple[float, float]]) -> list[Float64]:
    """Return unit ray directions of a perspective at positions in NDC, (3,) each."""
    inverse = transforms.inverse(np.vstack([clip[[0, 1, 3]], (0.0, 0.0, 0.0, 1.0)]))
    right, up, ahead = inverse[:3, :3].T
    return [transforms.unit_vector("way", x * right + y * up + ahead) for x, y in positions]


def _angle_between(a: Float64, b: Float64) -> float:
    """Return the angle between vectors, radians; NaN if one has no direction."""
    across = math.sqrt(np.square(np.cross(a, b)).sum())
    along = float(np.dot(a, b))
    return math.atan2(across, along) if across or along else math.nan


def _find_picture_axes(clip: Float64) -> list[Float64]:
    """Return unit vectors right, up and ahead at the centre of a picture, (3,) each."""
    if clip[3, :3].any():
        (ahead,) = _unproject_directions(clip, [(0.0, 0.0)])
    else:
        # The direction in which x and y are constant, and z grows.
        x, y, z = (transforms.unit_vector("row", row) for row in clip[:3, :3])
        ahead = transforms.unit_vector("way", np.cross(x, y))
        ahead = ahead if np.dot(ahead, z) >= 0.0 else -ahead
    axes = []
    for row in clip[:2, :3]:
        # The gradient of x or y, perpendicular to the line of sight.
        gradient = transforms.unit_vector("row", row)
        axes.append(transforms.unit_vector("axis", gradient - np.dot(gradient, ahead) * ahead))
    return [*axes, ahead]


def _format_triple(values: Float64) -> str:
    """Format three numbers."""
    return "(" + ", ".join(f"{value + 0.0:.4g}" for value in np.round(values, 12).tolist()) + ")"


def _format_percent(count: int, whole: int) -> str:
    """Format a percentage; never 0 for a few nor 100 for nearly all."""
    share = 100.0 * count / whole
    if 0 < count < whole and not 1.0 <= share <= 99.0:
        return "under 1 %" if share < 1.0 else "over 99 %"
    return f"{share:.0f} %"
