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
from rasterjit.pipeline.geometry.unproject_matrix import SNAP_SLACK_UNITS, build_unprojection_matrix
from rasterjit.pipeline.passes import Rows, rows_where
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

EDGE_BITS = {
    "silhouette": outline_stage.SILHOUETTE,
    "object": outline_stage.OBJECT,
    "crease": outline_stage.CREASE,
}

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
    kinds = functools.reduce(operator.or_, (EDGE_BITS[kind] for kind in effect.edges))
    _, min_cosine = transforms.sine_cosine(effect.crease_angle)
    marks = context.per_view(MARKS, np.zeros(face_id.shape, np.uint8))
    rgba = opaque_codes(effect.color).view(np.uint32)
    target, disc = color.view(np.uint32)[:, :, 0], make_disc_rows(effect.width)
    bands = split_into_bands(face_id.shape, workers)
    shared = coverage.reversed_vertex_depth, geometry, context.placement, matrix, snap_slack, kinds
    edges = [
        (face_id, rows, depth, *shared, min_cosine, marks, outline_stage.make_scratch(width))
        for rows in bands
    ]
    workers.run(outline_stage.find_edges, edges)
    workers.run(outline_stage.dilate_marks, [(marks, rows, disc, rgba, target) for rows in bands])


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

    def unused_reason(self, facts: Facts) -> str:
        """Say why no outlines are drawn: they need faces and colour in 8 bits."""
        if "color" not in facts.outputs:
            return "no output shows colour in 8 bits"
        return "" if facts.draws_faces else "only the wireframe is drawn"

    def describe(self, facts: Facts) -> str:
        """Say which edges are drawn."""
        outline = facts.fields[self.field]
        return f"{', '.join(outline.edges)}, {outline.width} wide"

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Return True: outlines read the depths around each pixel."""
        return True

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that find and draw edges."""
        return {"overlay": rows_where("", outline_stage.find_edges, outline_stage.dilate_marks)}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the image of marked edges."""
        return [("marks of outlines", 1, "uint8", plan.size)]

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
