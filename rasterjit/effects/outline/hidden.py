"""
Hidden lines: draw the edges that outlines follow dashed where surfaces hide them.

Edges are those of faces: where a surface ends, turns away, or bends. Dashes run on from one edge to
the next, so that a curve of many short edges is dashed like one line. They are drawn below the
outlines, by coverage.
"""

from __future__ import annotations

import functools
import operator
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.outline import feature_edges
from rasterjit.effects.outline.stage import EDGE_BITS
from rasterjit.effects.wireframe import (
    blending_space,
    describe_lines,
    find_light,
    find_occluding_depth,
)
from rasterjit.effects.wireframe import stage as wireframe_stage
from rasterjit.effects.wireframe.coverage import BAND_ROWS, blend_lines, project_lines
from rasterjit.effects.wireframe.strokes import HIDDEN, REACH_PX, make_scratch, stroke_lines
from rasterjit.pipeline.passes import KernelRow, Rows, rows_where
from rasterjit.pipeline.records import Viewport
from rasterjit.pipeline.srgb_encoding import make_encoding_table
from rasterjit.runtime.threads import split_range
from rasterjit.scene import transforms
from rasterjit.scene.color import opaque_codes
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.outline import Outline
from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import FrameContext, ScreenEffect, with_field
from rasterjit.survey.facts import Facts
from rasterjit.survey.plan import RenderPlan

Float64 = NDArray[np.float64]

FACES_PER_TASK = 1 << 14

WIDTH_SHARE = 0.5
"""Width of hidden lines, as a share of that of outlines."""


def find_lines(outline: Outline, context: FrameContext) -> tuple[NDArray[np.int32], Float64]:
    """
    Find the edges of faces that an outline follows, seen or not.

    Returns
    -------
    ends : (N, 4) int32
        x0, y0, x1, y1 on the sub-pixel grid.
    depths : (N, 2) float64
        Stored depth at both ends.
    """
    geometry, placement, workers = context.seen.geometry, context.placement, context.workers
    faces = geometry.faces
    sides, normals = np.empty(len(faces), np.int8), np.empty((len(faces), 3))
    workers.run(
        feature_edges.look_at_faces,
        [
            (part, geometry, placement, sides, normals)
            for part in split_range(len(faces), FACES_PER_TASK)
        ],
    )
    kinds = functools.reduce(operator.or_, (EDGE_BITS[kind] for kind in outline.edges))
    _, min_cosine = transforms.sine_cosine(outline.crease_angle)
    edges = np.empty((3 * len(faces), 2), np.int32)
    count = feature_edges.list_feature_edges(
        faces, placement.positions, context.cache.shapes.edge_twins, sides, normals, kinds,
        min_cosine, edges,
    )  # fmt: skip
    ends, depths = np.empty((count, 4), np.int32), np.empty((count, 2))
    bands = -(-geometry.viewport.height // BAND_ROWS)
    reach = find_reach(outline) << geometry.viewport.grid_bits
    count = project_lines(
        edges[:count], 0, geometry, context.plan.camera.depth_coefficients(), reach, ends, depths,
        np.zeros(bands + 1, np.int32),
    )  # fmt: skip
    return ends[:count], depths[:count]


def find_reach(outline: Outline) -> int:
    """Return how far hidden lines reach beyond their ends, whole pixels."""
    return int(np.ceil(0.5 * WIDTH_SHARE * outline.width + REACH_PX))


def split_into_dashes(
    ends: NDArray[np.int32], depths: Float64, dash: tuple[float, float], unit: int
) -> tuple[NDArray[np.int32], Float64]:
    """
    Return the dashes of lines, and the stored depth at their ends, as `find_lines` returns lines.

    ``dash`` is the length of dashes and of gaps, pixels of ``unit`` steps of the grid.
    """
    points = ends.reshape(-1, 2, 2) / unit
    along = points[:, 1] - points[:, 0]
    lengths = np.sqrt(along[:, 0] * along[:, 0] + along[:, 1] * along[:, 1])
    starts = _measure_along(ends, depths, lengths)
    first, turned = starts
    period = dash[0] + dash[1]
    # The dashes that each line meets.
    lowest = np.floor((first - dash[0]) / period).astype(np.int64) + 1
    counts = np.maximum(np.ceil((first + lengths) / period).astype(np.int64) - lowest, 0)
    counts[lengths == 0.0] = 0
    lines = np.repeat(np.arange(len(ends)), counts)
    numbers = np.arange(len(lines)) - np.repeat(np.cumsum(counts) - counts, counts) + lowest[lines]
    shares = np.stack([numbers * period, numbers * period + dash[0]], axis=1)
    shares -= first[lines, np.newaxis]
    shares /= lengths[lines, np.newaxis]
    shares = np.clip(shares, 0.0, 1.0)
    shares = np.where(turned[lines, np.newaxis] != 0, 1.0 - shares, shares)
    places = points[lines, 0][:, np.newaxis] + shares[..., np.newaxis] * along[lines][:, np.newaxis]
    rise = (depths[:, 1] - depths[:, 0])[lines, np.newaxis]
    found = np.rint(places * unit).astype(np.int32).reshape(-1, 4)
    return found, depths[lines, :1] + shares * rise


def _measure_along(
    ends: NDArray[np.int32], depths: Float64, lengths: Float64
) -> tuple[Float64, NDArray[np.uint8]]:
    """Return how far along its chain each line begins, and whether it runs against it."""
    corners = ends.reshape(-1, 2)
    nodes, _ = distinct_rows(corners[:, 0], corners[:, 1], depths.ravel())
    order = np.argsort(nodes, kind="stable")
    starts = np.searchsorted(nodes[order], np.arange(nodes.max(initial=-1) + 2))
    distances, turned = np.full(len(ends), -1.0), np.zeros(len(ends), np.uint8)
    feature_edges.measure_chains(
        nodes.reshape(-1, 2), lengths, starts.astype(np.int64), order // 2, distances, turned
    )
    return distances, turned


def list_by_band(
    ends: NDArray[np.int32], reach: int, viewport: Viewport
) -> list[NDArray[np.int32]]:
    """Return the numbers of the lines that may touch each band of rows."""
    tops, bottoms = (
        (np.minimum(ends[:, 1], ends[:, 3]) >> viewport.grid_bits) - reach,
        (np.maximum(ends[:, 1], ends[:, 3]) >> viewport.grid_bits) + reach,
    )
    return [
        np.flatnonzero((tops < row + BAND_ROWS) & (bottoms >= row)).astype(np.int32)
        for row in range(0, viewport.height, BAND_ROWS)
    ]


class DashedHiddenEdges(ScreenEffect):
    """Draw hidden edges of shapes over the finished picture, below its outlines."""

    name = "hidden lines"
    field = "outline"
    joins_faces = True
    reads_clip_positions = True
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why no hidden lines are drawn: they need faces and colour in 8 bits."""
        if facts.fields[self.field].hidden == "none":
            return "scene.outline leaves them out"
        if "color" not in facts.outputs:
            return "no output shows colour in 8 bits"
        return "" if facts.draws_faces else "only the wireframe is drawn"

    def describe(self, facts: Facts) -> str:
        """Say how they are drawn."""
        outline = facts.fields[self.field]
        dash, gap = outline.dash
        width = f"{WIDTH_SHARE * outline.width:g} wide"
        return f"dashes of {dash:g}, gaps of {gap:g}, {width}{describe_lines(facts.quality, True)}"

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Return True: faces hide lines, by their depth."""
        return True

    def without(self, scene: Scene) -> Scene:
        """Return the scene with outlines that leave hidden lines out."""
        outline = scene.outline
        return with_field(scene, self.field, outline and replace(outline, hidden="none"))

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that find and draw hidden lines."""
        rows = rows_where(
            "", feature_edges.look_at_faces, feature_edges.list_feature_edges, project_lines,
            feature_edges.measure_chains, wireframe_stage.fill_slack, stroke_lines,
        )  # fmt: skip
        return {"overlay": [*rows, KernelRow(blend_lines, blending_space(plan.quality))]}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the image of slacks."""
        return [("slack of hidden lines", 1, "float32", plan.size)]

    @staticmethod
    def draw_over(outline: Outline, context: FrameContext, color: NDArray[np.uint8]) -> None:
        """Draw the lines over the colour, (H, W, 4)."""
        geometry, coverage, workers = context.seen.geometry, context.seen.coverage, context.workers
        viewport, target = geometry.viewport, color.view(np.uint32)[:, :, 0]
        unit = 1 << viewport.grid_bits
        ends, depths = split_into_dashes(*find_lines(outline, context), outline.dash, unit)
        depth, slack = find_occluding_depth(
            (coverage.face_id, coverage.reversed_depth), geometry,
            context.plan.camera.depth_coefficients(), workers,
        )  # fmt: skip
        half_width, rgba = 0.5 * WIDTH_SHARE * outline.width, opaque_codes(outline.color)
        light, table = find_light(context.plan.quality), make_encoding_table()

        def cover_band(lines: NDArray[np.int32], row: int) -> None:
            rows = row, min(row + BAND_ROWS, viewport.height)
            area = np.empty((rows[1] - row, viewport.width), np.float32)
            stroke_lines(
                lines, ends, depths, rows, viewport, depth, slack, half_width, HIDDEN,
                make_scratch(len(area), viewport.width), area,
            )  # fmt: skip
            blend_lines(area, rgba.view(np.uint32), light, table, target[row : rows[1]])

        bands = list_by_band(ends, find_reach(outline), viewport)
        workers.run(cover_band, [(lines, n * BAND_ROWS) for n, lines in enumerate(bands)])

    places: ClassVar[dict[str, Any]] = {"overlay": draw_over}


HIDDEN_EDGES = DashedHiddenEdges()
