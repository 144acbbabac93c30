"""
Outlines: draw the edges of shapes over the colour.

A frame has outlines where faces are drawn in 8-bit colour. Edges are detected in screen space, from
depth, normals and object numbers of neighbouring pixels, once for the finished picture.
"""

from __future__ import annotations

import functools
import math
import operator
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.outline import stage as outline_stage
from rasterjit.effects.outline import tracing
from rasterjit.effects.wireframe import blend_covered, blending_space, describe_lines
from rasterjit.effects.wireframe.coverage import blend_lines
from rasterjit.effects.wireframe.strokes import make_scratch, round_width
from rasterjit.pipeline.geometry.unproject_matrix import SNAP_SLACK_UNITS, build_unprojection_matrix
from rasterjit.pipeline.passes import KernelRow, Rows, rows_where
from rasterjit.runtime.threads import split_into_bands
from rasterjit.scene import transforms
from rasterjit.scene.color import opaque_codes
from rasterjit.scene.outline import Outline
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.batched_views import ViewGroup
from rasterjit.survey.effect import BatchedEffect, FrameContext, ScreenEffect, add_to_field
from rasterjit.survey.facts import Facts
from rasterjit.survey.plan import RenderPlan

MATRIX, MARKS = "unprojection for outlines", "marks of outlines"
"""Keys of a view's arrays in recorded calls: see `Outlines.compute_view_arrays`."""


def draw_outlines(effect: Outline, context: FrameContext, color: NDArray[np.uint8]) -> None:
    """
    Draw the edges of shapes over the colour.

    Parameters
    ----------
    effect : Outline
    context : FrameContext
        With the visible faces, and their reversed depth.
    color : (H, W, 4) uint8
        Written where there are edges, with alpha 255.
    """
    geometry, coverage, workers = context.seen.geometry, context.seen.coverage, context.workers
    face_id, depth = coverage.face_id, coverage.reversed_depth
    height, width = face_id.shape
    matrix = context.per_view(
        MATRIX, build_unprojection_matrix(context.plan.camera, (width, height), 1.0)
    )
    snap_slack = math.ldexp(SNAP_SLACK_UNITS, -geometry.viewport.subpixel_bits)
    kinds = functools.reduce(operator.or_, (outline_stage.EDGE_BITS[kind] for kind in effect.edges))
    _, min_cosine = transforms.sine_cosine(effect.crease_angle)
    bands = split_into_bands(face_id.shape, workers)
    shared = coverage.reversed_vertex_depth, geometry, context.placement, matrix, snap_slack, kinds
    faces = [
        ((face_id, rows, depth, *shared, min_cosine), outline_stage.make_scratch(width))
        for rows in bands
    ]
    if context.plan.quality.lines == "coverage":
        cover_edges(effect, context, faces, color)
        return
    marks = context.per_view(MARKS, np.zeros(face_id.shape, np.uint8))
    rgba = opaque_codes(effect.color).view(np.uint32)
    target, disc = color.view(np.uint32)[:, :, 0], make_disc_rows(round_width(effect.width))
    edges = [(*arguments, marks, scratch) for arguments, scratch in faces]
    workers.run(outline_stage.find_edges, edges)
    workers.run(outline_stage.dilate_marks, [(marks, rows, disc, rgba, target) for rows in bands])


def cover_edges(
    effect: Outline, context: FrameContext, faces: list[tuple[Any, Any]], color: NDArray[np.uint8]
) -> None:
    """
    Blend smooth outlines over the colour.

    Parameters
    ----------
    effect : Outline
    context : FrameContext
    faces : list of (tuple, tuple)
        For each band of rows, the first arguments of kernels that find edges, and scratch memory.
    color : (H, W, 4) uint8
        Changed where there are edges.
    """
    workers, twins = context.workers, context.cache.shapes.edge_twins
    target = color.view(np.uint32)[:, :, 0]
    empty, bands = workers.memory.empty, [arguments[1] for arguments, _ in faces]
    crossings, area = empty((2, *target.shape), np.float32), empty(target.shape, np.float32)
    workers.run(
        tracing.find_crossings,
        [(*arguments, twins, crossings, scratch) for arguments, scratch in faces],
    )
    half_width, width = 0.5 * effect.width, target.shape[1]
    covered = [(rows, area[rows[0] : rows[1]]) for rows in bands]
    workers.run(
        tracing.cover_crossings,
        [
            (crossings, rows, half_width, make_scratch(len(part), width), part)
            for rows, part in covered
        ],
    )
    rgba = opaque_codes(effect.color).view(np.uint32)
    blend_covered(covered, rgba, target, context.plan.quality, workers)


def make_disc_rows(width: int) -> NDArray[np.int32]:
    """
    Return the rows of a disc whose diameter is a number of pixels, (D, 3) int32.

    Each row as its distance from the middle, its first column and the one past its last, relative
    to the middle. A disc of even diameter has its middle between pixels, to the upper left.
    """
    offset = 0.0 if width % 2 else 0.5
    first = -(width // 2) + (1 - width % 2)
    rows = []
    for down in range(first, width // 2 + 1):
        squared = (width / 2.0) * (width / 2.0) - (down - offset) * (down - offset)
        half = math.floor(math.sqrt(max(squared, 0.0)) + offset)
        rows.append((down, -half + (1 - width % 2), half + 1))
    return np.array(rows, np.int32)


class Outlines(ScreenEffect, BatchedEffect):
    """Draw the edges of shapes over the finished picture."""

    name = "outline"
    field = "outline"
    key = "k"
    joins_faces = True
    needs_facts_only = True
    settings = ("lines",)

    def unused_reason(self, facts: Facts) -> str:
        """Say why no outlines are drawn: they need faces and colour in 8 bits."""
        if "color" not in facts.outputs:
            return "no output shows colour in 8 bits"
        return "" if facts.draws_faces else "only the wireframe is drawn"

    def describe(self, facts: Facts) -> str:
        """Say which edges are drawn."""
        outline = facts.fields[self.field]
        smooth = describe_lines(facts.quality, facts.quality.lines == "coverage")
        return f"{', '.join(outline.edges)}, {outline.width:g} wide{smooth}"

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Return True: outlines read the depths around each pixel."""
        return True

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that find and draw edges."""
        if plan.quality.lines == "bresenham":
            return {"overlay": rows_where("", outline_stage.find_edges, outline_stage.dilate_marks)}
        rows = rows_where("", tracing.find_crossings, tracing.cover_crossings)
        return {"overlay": [*rows, KernelRow(blend_lines, blending_space(plan.quality))]}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the image of marked edges, or those of smooth lines."""
        if plan.quality.lines == "bresenham":
            return [("marks of outlines", 1, "uint8", plan.size)]
        return [
            ("crossings of outlines", 2, "float32", plan.size),
            ("distances to outlines", 3, "float32", plan.size),
            ("coverage by outlines", 1, "float32", plan.size),
        ]

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Return the scene with thin outlines."""
        return "on, one pixel wide", add_to_field(scene, self.field, Outline())

    def compute_view_arrays(self, scene: Scene, group: ViewGroup) -> dict[str, NDArray[Any]]:
        """Return the cameras' unprojection matrices, and an image without marks."""
        if scene.outline is None:
            return {}
        return {
            MATRIX: group.lens_matrices([1.0]),
            MARKS: np.zeros((1, *group.size[::-1]), np.uint8),
        }

    places: ClassVar = {"overlay": draw_outlines}


OUTLINE = Outlines()
