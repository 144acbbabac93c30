"""
Labels: texts at points of the scene, over the finished picture.

A frame has them where colour is 8-bit. Texts are rasterized and blended in NumPy, without kernels.
A label is occluded by the face at its anchor's pixel; parts of a picture ask the part that holds
this pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.text_layout import (
    PADDING_SHARE,
    Float64,
    lay_out,
    rasterize_text,
    warn_of_missing,
)
from rasterjit.pipeline.srgb_encoding import BUCKET_BITS, make_encoding_table
from rasterjit.scene.camera import near_far
from rasterjit.scene.color import decoding_table
from rasterjit.scene.label import Label
from rasterjit.scene.pixel_projection import clip_from_relative, project
from rasterjit.scene.scene import Scene, with_labels
from rasterjit.survey.effect import (
    FrameContext,
    LensEffect,
    Planning,
    ScreenEffect,
    UnusedEffect,
    UsedEffect,
)
from rasterjit.survey.facts import Facts
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.transparency import describe_blending

ANCHORS = {"left": 0.0, "right": 1.0, "top": 0.0, "bottom": 1.0}
"""Anchor's place in a box, as a share of its width or height; 0.5 for all others."""

MAX_ANCHOR_PX = 1e9
"""Distance from the picture's corner beyond which an anchor is not visible."""

INTERPOLATED_BITS = (1 << BUCKET_BITS) - 1
"""Bits of a float32 that are interpolated within a bucket of the encoding table."""

VISIBLE, HIDDEN, OUTSIDE = 1, 0, -1
"""Visibility of a label in a picture or a part of one."""


class Texts(NamedTuple):
    """The labels of a scene, and their world positions."""

    labels: tuple[Label, ...]
    points: Float64
    """(N, 3), world space."""
    anchors: Float64 | None = None
    """(N, 2), pixels of the whole picture; ``None`` -> where the camera sees the points."""


class Box(NamedTuple):
    """The pixels of a text and its background."""

    left: int
    top: int
    """Row of the first pixel, as ``left`` is its column, in the whole picture."""
    width: int
    height: int
    padding: int
    """Pixels around the text."""


def find_box(label: Label, anchor: Sequence[float]) -> Box:
    """Return the box of a label, given its anchor in pixels of the whole picture."""
    layout = lay_out(label.text, label.size, _find_side(label, "left", "right"), label.font)
    padding = 0 if label.background is None else math.floor(PADDING_SHARE * label.size + 0.5)
    width, height = layout.width + 2 * padding, layout.height + 2 * padding
    corner = []
    for axis, sides, length in ((0, ("left", "right"), width), (1, ("top", "bottom"), height)):
        fraction = ANCHORS.get(_find_side(label, *sides), 0.5)
        corner.append(math.floor(anchor[axis] + label.offset[axis] - fraction * length + 0.5))
    return Box(corner[0], corner[1], width, height, padding)


def _find_side(label: Label, first: str, last: str) -> str:
    """Return which of two sides a label is anchored at, else "center"."""
    return next((side for side in (first, last) if side in label.anchor), "center")


def draw_label(
    label: Label,
    anchor: Sequence[float],
    corner: tuple[int, int],
    color: NDArray[np.uint8],
    in_codes: bool,
) -> None:
    """
    Draw a label over a picture, or a part of one.

    Parameters
    ----------
    label : Label
    anchor : (float, float)
        Pixels of the whole picture.
    corner : (int, int)
        First column and row of the part, in the whole picture.
    color : (H, W, 4) uint8
        Changed where the label is.
    in_codes : bool
        Whether to mix sRGB codes, not linear light.
    """
    box, (height, width) = find_box(label, anchor), color.shape[:2]
    left, top = max(box.left - corner[0], 0), max(box.top - corner[1], 0)
    right = min(box.left - corner[0] + box.width, width)
    bottom = min(box.top - corner[1] + box.height, height)
    if left >= right or top >= bottom:
        return
    layout = lay_out(label.text, label.size, _find_side(label, "left", "right"), label.font)
    warn_of_missing(layout)
    first = (
        left + corner[0] - box.left - box.padding,
        top + corner[1] - box.top - box.padding,
    )
    coverage = rasterize_text(layout, label.size, (*first, right - left, bottom - top))
    layers = [] if label.background is None else [(np.ones_like(coverage), label.background)]
    composite_layers(color[top:bottom, left:right], [*layers, (coverage, label.color)], in_codes)


def composite_layers(
    pixels: NDArray[np.uint8], layers: Sequence[tuple[Float64, Any]], in_codes: bool
) -> None:
    """
    Composite layers over pixels, bottom first.

    Parameters
    ----------
    pixels : (R, C, 4) uint8
        Changed where a colour has a share.
    layers : sequence of ((R, C) float64, colour)
        The share of each pixel that a linear RGBA colour covers.
    in_codes : bool
        Whether to mix sRGB codes, not linear light.
    """
    light = pixels[..., :3] / 255.0 if in_codes else decoding_table()[pixels[..., :3]].astype(float)
    alpha = pixels[..., 3] / 255.0
    is_touched = np.zeros(alpha.shape, bool)
    for coverage, (*rgb, opacity) in layers:
        values = np.array(rgb, np.float64)
        if in_codes:
            values = encode_srgb(values) / 255.0
        front = coverage * opacity
        back = (1.0 - front) * alpha
        total = front + back
        is_covered = front > 0.0
        weighted = front[..., np.newaxis] * values + back[..., np.newaxis] * light
        np.divide(weighted, total[..., np.newaxis], out=light, where=is_covered[..., np.newaxis])
        np.copyto(alpha, total, where=is_covered)
        is_touched |= is_covered
    codes = np.floor(255.0 * light + 0.5).astype(np.uint8) if in_codes else encode_srgb(light)
    np.copyto(pixels[..., :3], codes, where=is_touched[..., np.newaxis])
    np.copyto(pixels[..., 3], np.floor(255.0 * alpha + 0.5).astype(np.uint8), where=is_touched)


def encode_srgb(light: Float64) -> NDArray[np.uint8]:
    """Return sRGB codes of linear light, rounded half up."""
    # Interpolate as the kernels of `srgb_encoding` do.
    bits = light.astype(np.float32).view(np.int32)
    entries = make_encoding_table()[bits >> BUCKET_BITS] + (bits & INTERPOLATED_BITS)
    return (entries >> BUCKET_BITS).astype(np.uint8)


def find_states(texts: Texts, context: FrameContext) -> NDArray[np.int8]:
    """Return the visibility of each label in a picture, or a part of one: (N,), see ``VISIBLE``."""
    states = np.full(len(texts.labels), VISIBLE, np.int8)
    plan = context.plan
    if not plan.facts.draws_faces:
        return states
    face_id, (left, top) = context.seen.coverage.face_id, plan.corner
    height, width = face_id.shape
    anchors = project_anchors(texts, plan)
    for n, (label, anchor) in enumerate(zip(texts.labels, anchors, strict=True)):
        if not label.hidden:
            continue
        states[n] = OUTSIDE
        x, y = anchor.tolist()
        if abs(x) < MAX_ANCHOR_PX and abs(y) < MAX_ANCHOR_PX:
            column, row = math.floor(x) - left, math.floor(y) - top
            if 0 <= column < width and 0 <= row < height:
                face = int(face_id[row, column])
                is_hidden = face >= 0 and hides_point(face, texts.points[n], context)
                states[n] = HIDDEN if is_hidden else VISIBLE
    return states


def hides_point(face: int, point: Float64, context: FrameContext) -> bool:
    """
    Tell whether a face that is seen at a point's pixel lies in front of it, a pixel's width away.

    What counts is where the plane of the face meets the line from the viewer to the point: it goes
    through points on the face, wherever in the pixel they are. Where that is nearer than all of the
    face, as on one that is seen edge-on beside the point, its nearest corner counts, and the
    farthest of one without an area.
    """
    plan, placement, arrays = context.plan, context.placement, context.cache.shapes.arrays
    owner = int(np.searchsorted(placement.face_starts, face, side="right")) - 1
    matrix = placement.relative_from_model[owner]
    corners = [_transform(matrix, arrays.positions[vertex]) for vertex in arrays.faces[face]]
    relative = (point - plan.camera.eye_position()).tolist()
    x, y, z, w = placement.toward_viewer.tolist()
    toward = [x - w * relative[0], y - w * relative[1], z - w * relative[2]]
    length = math.sqrt(_dot(toward, toward))
    if not length > 0.0:
        return False
    ray = [value / length for value in toward]
    distances = [_dot(_subtract(corner, relative), ray) for corner in corners]
    normal = _cross(_subtract(corners[1], corners[0]), _subtract(corners[2], corners[0]))
    slope = _dot(normal, ray)
    distance = min(distances)
    if slope != 0.0:
        distance = min(_dot(normal, _subtract(corners[0], relative)) / slope, max(distances))
    return distance > compute_pixel_width(plan, length if w else 1.0)


def compute_pixel_width(plan: RenderPlan, distance: float) -> float:
    """Return a pixel's width, scene units, at a distance from the eye; 1 for a parallel view."""
    matrix = clip_from_relative(plan.camera, plan.size)
    across, depth = matrix[0, :3].tolist(), matrix[3, :3].tolist()
    per_distance = math.sqrt(_dot(depth, depth)) or 1.0
    return 2.0 * distance * per_distance / (math.sqrt(_dot(across, across)) * plan.size[0])


def project_anchors(texts: Texts, plan: RenderPlan) -> Float64:
    """Return the labels' anchors, (N, 2) pixels of the whole picture; NaN if not in view."""
    if texts.anchors is not None:
        return texts.anchors
    projected = project(plan.camera, texts.points, plan.size)
    planes = near_far(plan.camera)
    near, far = 0.0, math.inf
    if planes is not None:
        # Ignore clipping planes that the camera leaves open or fits to the scene.
        if not planes.is_near_open and planes.near_steps is None:
            near = planes.near
        if not planes.is_far_open and planes.far_steps is None:
            far = planes.far
    is_between = (projected.depth >= near) & (projected.depth <= far)
    return np.where(is_between[:, np.newaxis], projected.pixels, np.nan)


def _transform(matrix: Float64, position: Float64) -> list[float]:
    """Return a position transformed by a matrix, (3, 4)."""
    x, y, z = position.tolist()
    return [row[0] * x + row[1] * y + row[2] * z + row[3] for row in matrix.tolist()]


def _subtract(one: Sequence[float], other: Sequence[float]) -> list[float]:
    """Return the difference of two vectors."""
    return [a - b for a, b in zip(one, other, strict=True)]


def _dot(one: Sequence[float], other: Sequence[float]) -> float:
    """Return the dot product of two vectors."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def _cross(one: Sequence[float], other: Sequence[float]) -> list[float]:
    """Return the cross product of two vectors."""
    return [
        one[1] * other[2] - one[2] * other[1],
        one[2] * other[0] - one[0] * other[2],
        one[0] * other[1] - one[1] * other[0],
    ]


class Labels(ScreenEffect, LensEffect):
    """Draw texts over the finished picture."""

    name = "labels"
    key = "j"
    scope = "whole"

    def decide(self, facts: Facts, planning: Planning) -> UsedEffect | UnusedEffect:
        """Plan the labels where colour is requested in 8 bits."""
        nodes = planning.scene.labelled
        if not nodes or "color" not in facts.outputs:
            return UnusedEffect(self, facts)
        labels = tuple(node.label for node in nodes if node.label is not None)
        points = [
            _transform(node.world_matrix[:3], np.array(label.position))
            for node, label in zip(nodes, labels, strict=True)
        ]
        return UsedEffect(self, facts, Texts(labels, np.array(points)))

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Say why labels are drawn or not."""
        if "color" not in facts.outputs:
            return "no output shows colour in 8 bits"
        if not is_used:
            return "no node has a label"
        return f"over the finished picture{describe_blending(facts.quality)}"

    def analyses_picture(self, data: Texts) -> bool:
        """Return whether parts of a picture need the visibility found in others."""
        return any(label.hidden for label in data.labels)

    def distort(self, data: Texts, eye: Any, pixels: Callable[[Any], Any]) -> Texts:
        """Return the texts, with anchors where a lens shows their points."""
        # Points too far for floats are in no view.
        with np.errstate(all="ignore"):
            return data._replace(anchors=pixels(data.points - eye))

    def analyse(self, context: FrameContext) -> NDArray[np.int8]:
        """Return the visibility of each text in a picture, or a part of it."""
        return find_states(context.plan.data(self.name), context)

    def merge_parts(
        self, size: tuple[int, int], parts: Sequence[tuple[tuple[int, int], NDArray[np.int8]]]
    ) -> NDArray[np.int8]:
        """Return the visibility of each text in the picture, given those in its parts."""
        return np.maximum.reduce([states for _, states in parts])

    def prepare(
        self, context: FrameContext, data: Texts, seen: Sequence[tuple[Any, Any]]
    ) -> NDArray[np.int8]:
        """Return the visibility of the texts."""
        return seen[0][1]

    def without(self, scene: Scene) -> Scene:
        """Return the scene with nodes that carry no label."""
        return with_labels(scene, ())

    @staticmethod
    def draw_over(texts: Texts, context: FrameContext, color: NDArray[np.uint8]) -> None:
        """Draw the texts over the colour, (H, W, 4)."""
        plan = context.plan
        cached = {} if plan.drawn is None else plan.drawn[0]
        states = cached[LABELS.name] if LABELS.name in cached else find_states(texts, context)
        anchors = project_anchors(texts, plan)
        for label, anchor, state in zip(texts.labels, anchors, states, strict=True):
            x, y = anchor.tolist()
            if state == VISIBLE and abs(x) < MAX_ANCHOR_PX and abs(y) < MAX_ANCHOR_PX:
                draw_label(label, (x, y), plan.corner, color, plan.quality.blending == "srgb8")

    places: ClassVar = {"overlay": draw_over}


LABELS = Labels()
"""The row of labels."""
