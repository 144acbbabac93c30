"""
Wireframes: draw the edges of faces as lines over the colour, shared among threads.

A frame has edges where the scene has a wireframe and colour is shown in 8 bits; over the faces,
with hidden lines removed, or alone. Each edge is drawn once, whichever faces share it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.wireframe import coverage as line_coverage
from rasterjit.effects.wireframe import stage as wireframe_stage
from rasterjit.effects.wireframe import strokes
from rasterjit.effects.wireframe.coverage import BAND_ROWS
from rasterjit.pipeline.geometry import binning
from rasterjit.pipeline.passes import KernelRow, Rows, rows_where
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.srgb_encoding import make_encoding_table
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.runtime.threads import Workers, fill_rows, split_range
from rasterjit.scene.color import decoding_table, opaque_codes
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.wireframe import Wireframe
from rasterjit.survey.effect import FrameContext, ModalEffect, ScreenEffect, with_field
from rasterjit.survey.facts import Facts
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.transparency import describe_blending

EDGES_PER_TASK = 1 << 14
"""Edges of a wireframe drawn by one task: their ends, 640 KiB, stay in a core's own cache."""


def find_occluding_depth(
    hidden_by: tuple[NDArray[np.int32], NDArray[np.float32]] | None,
    geometry: Geometry,
    depth_coefficients: tuple[float, float, float],
    workers: Workers,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the stored depth that occludes edges and its slack, (H, W); (1, W) if nothing does."""
    if hidden_by is None:
        row = 1, geometry.viewport.width
        return np.full(row, -np.inf, np.float32), np.zeros(row, np.float32)
    face_id, depth = hidden_by
    slack = workers.memory.empty(depth.shape, np.float32)
    arguments = depth, geometry, depth_coefficients, slack
    fill_rows(wireframe_stage.fill_slack, face_id, arguments, workers)
    return depth, slack


def draw_edges(
    edges: NDArray[np.int32],
    geometry: Geometry,
    depth_coefficients: tuple[float, float, float],
    rgba: NDArray[np.uint8],
    color: NDArray[np.uint8],
    hidden_by: tuple[NDArray[np.int32], NDArray[np.float32]] | None,
    workers: Workers,
) -> None:
    """
    Draw edges as Bresenham lines into the colour.

    All edges have one colour and none hides another. So tasks may draw them in any order, and
    even meet in a pixel: both write the same value.

    Parameters
    ----------
    edges : (N, 2) int32, vertex numbers
    geometry : Geometry
    depth_coefficients : (float, float, float)
    rgba : (4,) uint8
    color : (H, W, 4) uint8
        Written.
    hidden_by : (face_id (H, W) int32, depth (H, W) float32) or None
        The surfaces that hide edges; ``None`` draws all of them.
    workers : Workers
    """
    depth, slack = find_occluding_depth(hidden_by, geometry, depth_coefficients, workers)
    count, empty = len(geometry.clip_positions), workers.memory.empty
    pixels = empty((count, 2), np.int32)
    vertices = geometry.clip_positions, geometry.codes, pixels
    workers.run(
        wireframe_stage.find_pixels,
        [
            (part, *vertices[:2], geometry.viewport, pixels)
            for part in split_range(count, visibility_pass.VERTICES_PER_TASK)
        ],
    )
    target = color.view(np.uint32)[:, :, 0]

    def draw_batch(first: int) -> None:
        batch = edges[first : first + EDGES_PER_TASK]
        ends = np.empty((len(batch), 4), np.int32)
        depths = np.empty((0 if hidden_by is None else len(batch), 2), np.float64)
        visible = wireframe_stage.project_edges(
            batch, vertices, depth_coefficients, geometry.viewport, ends, depths
        )
        wireframe_stage.draw_edges(target, depth, slack, ends[:visible], depths[:visible], rgba)

    workers.run(draw_batch, [(n,) for n in range(0, len(edges), EDGES_PER_TASK)])


def cover_edges(
    edges: NDArray[np.int32],
    geometry: Geometry,
    depth_coefficients: tuple[float, float, float],
    rgba: NDArray[np.uint8],
    color: NDArray[np.uint8],
    hidden_by: tuple[NDArray[np.int32], NDArray[np.float32]] | None,
    width: float,
    light: NDArray[np.float32],
    workers: Workers,
) -> None:
    """
    Blend edges over the colour by their coverage of each pixel.

    Takes what `draw_edges` takes, and

    width : float
        Of the lines, pixels. Those of one pixel have flat ends, all others round ones.
    light : (256,) or (0,) float32
        As `find_light` returns it.
    """
    depth, slack = find_occluding_depth(hidden_by, geometry, depth_coefficients, workers)
    viewport, empty = geometry.viewport, workers.memory.empty
    ends = empty((len(edges), 4), np.int32)
    depths = empty((0 if hidden_by is None else len(edges), 2), np.float64)
    # A line of one pixel reaches less than that beyond its ends.
    pixels = 1 if width == 1.0 else math.ceil(0.5 * width + strokes.REACH_PX)
    starts, lists = list_lines_by_band(
        edges, geometry, depth_coefficients, pixels << viewport.grid_bits, ends, depths, workers
    )
    target, table = color.view(np.uint32)[:, :, 0], make_encoding_table()

    def cover_band(band: int) -> None:
        rows = band * BAND_ROWS, min((band + 1) * BAND_ROWS, viewport.height)
        band_lines = lists[starts[band] : starts[band + 1]]
        coverage = empty((rows[1] - rows[0], viewport.width), np.float32)
        lines = band_lines, ends, depths, rows, viewport, depth, slack
        if width == 1.0:
            line_coverage.cover_lines(*lines, coverage)
        else:
            nearest = strokes.make_scratch(len(coverage), viewport.width)
            strokes.stroke_lines(*lines, 0.5 * width, strokes.VISIBLE, nearest, coverage)
        pixels = target[rows[0] : rows[1]]
        line_coverage.blend_lines(coverage, rgba.view(np.uint32), light, table, pixels)

    workers.run(cover_band, [(band,) for band in range(len(starts) - 1)])


def blend_covered(
    covered: list[tuple[tuple[int, int], NDArray[np.float32]]],
    rgba: NDArray[np.uint32],
    target: NDArray[np.uint32],
    quality: Quality,
    workers: Workers,
) -> None:
    """
    Blend one colour over rows of a picture by their coverage.

    Parameters
    ----------
    covered : list of ((int, int), (R, W) float32)
        Rows, the first and one past the last, and the share of each of their pixels.
    rgba : (1,) uint32
    target : (H, W) uint32
        Written.
    quality : Quality
        Tells whether light or codes are mixed.
    workers : Workers
    """
    light, table = find_light(quality), make_encoding_table()
    calls = [(area, rgba, light, table, target[rows[0] : rows[1]]) for rows, area in covered]
    workers.run(line_coverage.blend_lines, calls)


def find_light(quality: Quality) -> NDArray[np.float32]:
    """Return the linear light of each code, (256,), or (0,) where codes are mixed, not light."""
    return np.empty(0, np.float32) if quality.blending == "srgb8" else decoding_table().copy()


def blending_space(quality: Quality) -> str:
    """Return what lines are mixed in: codes or light."""
    return "codes" if quality.blending == "srgb8" else "light"


def is_smooth(wireframe: Wireframe, quality: Quality) -> bool:
    """Tell whether edges are blended by coverage: as asked for, or not one pixel wide."""
    return quality.lines == "coverage" or wireframe.width != 1.0


def describe_lines(quality: Quality, is_smooth: bool) -> str:
    """Say that lines are smooth, and what they are mixed in; nothing if they are not smooth."""
    return f", by coverage{describe_blending(quality)}" if is_smooth else ""


def list_lines_by_band(
    edges: NDArray[np.int32],
    geometry: Geometry,
    depth_coefficients: tuple[float, float, float],
    reach: int,
    ends: NDArray[np.int32],
    depths: NDArray[np.float64],
    workers: Workers,
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """
    Project edges and list them by the bands of rows that they may touch.

    They reach ``reach`` units of the sub-pixel grid beyond their ends at most.

    Writes ends and depths as ``coverage.project_lines`` does; returns the start of each band's
    list, (bands + 1,), and the lists, numbers of lines.
    """
    viewport = geometry.viewport
    bands = -(-viewport.height // BAND_ROWS)
    firsts = range(0, len(edges), EDGES_PER_TASK)
    counts = np.zeros((len(firsts), bands + 1), np.int32)
    lines = workers.run(
        line_coverage.project_lines,
        [
            (
                edges[first : first + EDGES_PER_TASK], first, geometry, depth_coefficients, reach,
                ends, depths, counts[n],
            )
            for n, first in enumerate(firsts)
        ],
    )  # fmt: skip
    starts, cursors = np.empty(bands + 1, np.int64), np.empty((len(firsts), bands), np.int64)
    binning.start_lists(counts, starts, cursors)
    lists = workers.memory.empty((int(starts[-1]),), np.int32)
    workers.run(
        line_coverage.list_lines,
        [
            ((first, first + lines[n]), ends, reach, viewport, cursors[n], lists)
            for n, first in enumerate(firsts)
        ],
    )
    return starts, lists


def list_smooth_rows(widths: list[float], condition: str, quality: Quality) -> list[KernelRow]:
    """Return the kernels that `cover_edges` calls for lines of some widths."""
    kernels = {1.0: line_coverage.cover_lines}
    covering = dict.fromkeys(kernels.get(width, strokes.stroke_lines) for width in widths)
    return [
        KernelRow(line_coverage.project_lines, condition),
        KernelRow(binning.start_lists),
        KernelRow(line_coverage.list_lines),
        *(KernelRow(kernel, condition) for kernel in covering),
        KernelRow(line_coverage.blend_lines, blending_space(quality)),
    ]


class Edges(ScreenEffect, ModalEffect):
    """Draw the edges of faces over the finished picture."""

    name = "wireframe"
    field = "wireframe"
    key = "g"
    modes: ClassVar = {"overlay": "over the faces", "only": "alone"}
    scope = "sample"
    joins_faces = True
    is_explained = True
    settings = ("lines",)
    reads_clip_positions = True
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why no edges are drawn: they need colour in 8 bits."""
        return "" if "color" in facts.outputs else "no output shows colour in 8 bits"

    def describe(self, facts: Facts) -> str:
        """Say how edges are drawn."""
        wireframe = facts.fields[self.field]
        width = "" if wireframe.width == 1.0 else f", {wireframe.width:g} wide"
        smooth = describe_lines(facts.quality, is_smooth(wireframe, facts.quality))
        return f"mode {wireframe.mode}{width}{smooth}"

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that draw the edges."""
        condition = "hidden lines removed" if plan.facts.draws_faces else ""
        rows = rows_where("", wireframe_stage.fill_slack) if plan.facts.draws_faces else []
        wireframe = plan.facts.fields[self.field]
        if is_smooth(wireframe, plan.quality):
            return {"overlay": rows + list_smooth_rows([wireframe.width], condition, plan.quality)}
        rows.insert(0, KernelRow(wireframe_stage.find_pixels))
        kernels = wireframe_stage.project_edges, wireframe_stage.draw_edges
        return {"overlay": rows + [KernelRow(kernel, condition) for kernel in kernels]}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the image of slacks."""
        if not plan.facts.draws_faces:
            return []
        return [("slack of hidden lines", 1, "float32", plan.size)]

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Tell whether faces hide edges."""
        return plan.facts.draws_faces

    def mode_of(self, scene: Scene) -> str | None:
        """Return the mode of a scene's wireframe; ``None`` without one."""
        return None if scene.wireframe is None else scene.wireframe.mode

    def with_mode(self, scene: Scene, mode: str | None) -> Scene:
        """Return the scene with its wireframe, or a new one, in a mode."""
        old = scene.wireframe
        if mode is None:
            return with_field(scene, self.field, None)
        changed = Wireframe(mode=mode) if old is None else replace(old, mode=mode)
        return with_field(scene, self.field, changed)

    @staticmethod
    def draw_over(wireframe: Wireframe, context: FrameContext, color: NDArray[np.uint8]) -> None:
        """Draw the edges over the colour, (H, W, 4)."""
        plan, cache, _, workers = context[:4]
        geometry, coverage = context.seen.geometry, context.seen.coverage
        hidden_by = (coverage.face_id, coverage.reversed_depth) if plan.facts.draws_faces else None
        coefficients = plan.camera.depth_coefficients()
        rgba = opaque_codes(wireframe.color)
        lines = cache.edges, geometry, coefficients, rgba, color, hidden_by
        if is_smooth(wireframe, plan.quality):
            cover_edges(*lines, wireframe.width, find_light(plan.quality), workers)
        else:
            draw_edges(*lines, workers)

    places: ClassVar = {"overlay": draw_over}


WIREFRAME = Edges()
