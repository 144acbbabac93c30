"""
Cross sections: report the planes, and draw section lines.

The cut itself is geometry, made before planning (``survey/cross_sections.py``). Section lines are
drawn over the finished picture, in 8-bit colour: like edges of a wireframe, occluded by nearer
surfaces and by the cut solid, each pixel widened to a disc like those of outlines.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.outline import make_disc_rows
from rasterjit.effects.outline.stage import dilate_marks
from rasterjit.effects.section import tracing
from rasterjit.effects.wireframe import (
    cover_edges,
    describe_lines,
    draw_edges,
    find_light,
    list_smooth_rows,
)
from rasterjit.effects.wireframe import stage as wireframe_stage
from rasterjit.effects.wireframe.strokes import round_width
from rasterjit.pipeline.geometry.setup import NEAR
from rasterjit.pipeline.passes import KernelRow, Rows, rows_where
from rasterjit.pipeline.records import Geometry
from rasterjit.runtime.threads import split_into_bands
from rasterjit.scene.color import opaque_codes
from rasterjit.scene.normals import dot_rows
from rasterjit.scene.scene import Scene
from rasterjit.scene.section import SectionPlane, planes_in, replace_planes
from rasterjit.survey.effect import (
    FrameContext,
    ModalEffect,
    Planning,
    ScreenEffect,
    TracedEffect,
    with_field,
)
from rasterjit.survey.facts import Facts
from rasterjit.survey.plan import RenderPlan

MARK_RGBA = np.array([255, 255, 255, 255], np.uint8)
"""Colour that marks the pixels of lines before they are widened."""


class Sections(ScreenEffect, ModalEffect):
    """Report the planes that cut a scene."""

    name = "section"
    field = "section"
    key = "p"
    modes: ClassVar = {"own": "the scene's own, or across z", "x": "across x", "y": "across y"}
    scope = "sample"
    joins_faces = True
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why the scene is not cut."""
        return "" if planes_in(facts.fields[self.field]) else "scene.section is None"

    def plan_data(self, facts: Facts, planning: Planning) -> tuple[SectionPlane, ...]:
        """Return the planes."""
        return planes_in(facts.fields[self.field])

    def describe(self, facts: Facts) -> str:
        """Say by how many planes the scene is cut."""
        planes = planes_in(facts.fields[self.field])
        cutting = f"{len(planes)} planes" if len(planes) > 1 else "one plane"
        capped = len([plane for plane in planes if plane.cap])
        some = f" of {capped}" if 0 < capped < len(planes) else ""
        return f"{cutting}, {f'closed meshes have caps{some}' if capped else 'without caps'}"

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that fill caps."""
        if not any(plane.cap for plane in planes_in(plan.facts.fields[self.field])):
            return {}
        anew = "a closed mesh is cut anew"
        from rasterjit.pipeline.geometry.cap_triangulation import fill_outlines, find_contacts

        return {"prepare": rows_where(anew, find_contacts, fill_outlines)}

    def mode_of(self, scene: Scene) -> str | None:
        """Return "own" if the scene is cut, else ``None``."""
        return None if scene.section is None else "own"

    def with_mode(self, scene: Scene, mode: str | None) -> Scene:
        """Return the scene cut by its own planes, or through its middle across an axis."""
        if mode is None or (mode == "own" and scene.section is not None):
            return scene if mode == "own" else with_field(scene, self.field, None)
        try:
            center, _ = scene.bounding_sphere()
        except ValueError:
            return scene
        if not np.isfinite(center).all():
            return scene
        normal = tuple(float(axis == mode.replace("own", "z")) for axis in "xyz")
        return with_field(scene, self.field, SectionPlane(tuple(center.tolist()), normal))


class SectionLines(TracedEffect):
    """Draw the lines along which planes cut over the finished picture."""

    name = "section lines"
    field = "section"
    reads_clip_positions = True
    needs_facts_only = True
    settings = ("lines",)

    def unused_reason(self, facts: Facts) -> str:
        """Say why no lines are drawn: they need faces and colour in 8 bits."""
        planes = planes_in(facts.fields[self.field])
        if not any(plane.lines for plane in planes):
            return "no plane has lines" if planes else "scene.section is None"
        if "color" not in facts.outputs:
            return "no output shows colour in 8 bits"
        return "" if facts.draws_faces else "only the wireframe is drawn"

    def plan_data(self, facts: Facts, planning: Planning) -> tuple[SectionPlane, ...]:
        """Return the planes."""
        return planes_in(facts.fields[self.field])

    def describe(self, facts: Facts) -> str:
        """Say the widths of the lines."""
        planes = planes_in(facts.fields[self.field])
        widths = [f"{plane.line_width:g}" for plane in planes if plane.lines]
        smooth = describe_lines(facts.quality, facts.quality.lines == "coverage")
        return f"{', '.join(dict.fromkeys(widths))} wide{smooth}"

    def refusal(self) -> str:
        """Say what the scene must have where lines cannot be drawn."""
        return "lines of scene.section's planes must be False"

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Return True: faces hide lines, by their depth."""
        return True

    def read_radius(self, data: tuple[SectionPlane, ...]) -> int:
        """Return the largest width of a line, whole pixels."""
        return max(math.ceil(plane.line_width) for plane in data if plane.lines)

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that draw lines."""
        hiding = "hidden lines removed"
        if plan.quality.lines == "coverage":
            planes = planes_in(plan.facts.fields[self.field])
            widths = [plane.line_width for plane in planes if plane.lines]
            slack = rows_where("", wireframe_stage.fill_slack)
            return {"overlay": slack + list_smooth_rows(widths, hiding, plan.quality)}
        return {
            "overlay": [
                *rows_where("", wireframe_stage.find_pixels, wireframe_stage.fill_slack),
                KernelRow(wireframe_stage.project_edges, hiding),
                KernelRow(wireframe_stage.draw_edges, hiding),
                KernelRow(dilate_marks),
            ]
        }

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the images of slack and of marked lines."""
        slack = "slack of hidden lines", 1, "float32", plan.size
        if plan.quality.lines == "coverage":
            return [slack]
        return [slack, ("marks of section lines", 4, "uint8", plan.size)]

    def without(self, scene: Scene) -> Scene:
        """Return the scene cut without lines."""
        return with_field(scene, "section", replace_planes(scene.section, lines=False))

    @staticmethod
    def draw_over(
        planes: tuple[SectionPlane, ...], context: FrameContext, color: NDArray[np.uint8]
    ) -> None:
        """Draw the lines over the colour, (H, W, 4)."""
        geometry, coverage = context.seen.geometry, context.seen.coverage
        hidden_by = coverage.face_id, coverage.reversed_depth
        for plane, edges, _ in _list_lines(planes, context):
            _draw_lines(plane, edges, geometry, hidden_by, context, color)

    def trace(
        self, planes: tuple[SectionPlane, ...], context: FrameContext
    ) -> list[NDArray[np.float64]]:
        """Return the visible pieces of the lines of each plane."""
        geometry, coverage = context.seen.geometry, context.seen.coverage
        hidden_by = coverage.face_id, coverage.reversed_depth
        pieces = [np.zeros((0, 2, 3))] * len(planes)
        for plane, edges, owners in _list_lines(planes, context):
            marks = _mark_edges(edges, geometry, hidden_by, context) > 0
            ends = tracing.place_edges(edges, owners, context)
            number = next(n for n, one in enumerate(planes) if one is plane)
            pieces[number] = tracing.keep_visible(ends, marks, context)
        return pieces

    def draw_traced(
        self, planes: tuple[SectionPlane, ...], pieces: list[NDArray[np.float64]],
        context: FrameContext, color: NDArray[np.uint8],
    ) -> None:  # fmt: skip
        """Draw the lines of each plane through a lens."""
        size, viewport = context.plan.size, context.seen.geometry.viewport
        for plane, lines in zip(planes, pieces, strict=True):
            if len(lines):
                edges, geometry = tracing.make_lines(lines, size, viewport)
                _draw_lines(plane, edges, geometry, None, context, color)

    places: ClassVar = {"overlay": draw_over}


class SectionTracer(SectionLines):
    """Section lines in the pinhole pictures of a lens: they are traced there, not drawn."""

    places: ClassVar = {}


SectionLines.tracer = SectionTracer()


def _list_lines(
    planes: tuple[SectionPlane, ...], context: FrameContext
) -> Iterator[tuple[SectionPlane, NDArray[np.int32], NDArray[np.int32]]]:
    """Yield each plane with lines, the edges that its solids do not hide, and their objects."""
    cut = context.cache.cut
    if cut is None:
        return
    for number, plane in enumerate(planes):
        edges, sides = cut.edges[number], cut.sides[number]
        if not plane.lines or not len(edges):
            continue
        if context.plan.cull != "front":
            is_seen = ~_are_behind_solids(plane, edges, sides, context)
            edges, sides = np.ascontiguousarray(edges[is_seen]), sides[is_seen]
        yield plane, edges, sides[:, 1]


def _draw_lines(
    plane: SectionPlane, edges: NDArray[np.int32], geometry: Geometry,
    hidden_by: Any, context: FrameContext,
    color: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Draw edges as the lines of a plane over the colour, (H, W, 4)."""
    plan, workers = context.plan, context.workers
    width, rgba = plane.line_width, opaque_codes(plane.line_color)
    if plan.quality.lines == "coverage":
        coefficients, light = plan.camera.depth_coefficients(), find_light(plan.quality)
        cover_edges(edges, geometry, coefficients, rgba, color, hidden_by, width, light, workers)
        return
    marks, disc = (
        _mark_edges(edges, geometry, hidden_by, context),
        make_disc_rows(round_width(width)),
    )
    target, code = color.view(np.uint32)[:, :, 0], rgba.view(np.uint32)
    bands = split_into_bands(target.shape, workers)
    workers.run(dilate_marks, [(marks, rows, disc, code, target) for rows in bands])


def _mark_edges(
    edges: NDArray[np.int32], geometry: Geometry,
    hidden_by: Any, context: FrameContext,
) -> NDArray[np.uint8]:  # fmt: skip
    """Return the pixels that visible edges pass, (H, W) uint8: 255, others 0."""
    canvas = np.zeros((geometry.viewport.height, geometry.viewport.width, 4), np.uint8)
    coefficients = context.plan.camera.depth_coefficients()
    draw_edges(edges, geometry, coefficients, MARK_RGBA, canvas, hidden_by, context.workers)
    return canvas[:, :, 0].copy()


def _are_behind_solids(
    plane: SectionPlane, edges: NDArray[np.int32], sides: NDArray[np.int32], context: FrameContext
) -> NDArray[np.bool_]:
    """
    Return which edges of a cut are hidden by the solid that is cut, (E,) bool.

    There, both the solid's face and the cut are back-facing. Depth alone does not decide this along
    the silhouette.
    """
    geometry, placement = context.seen.geometry, context.placement
    result = np.zeros(len(edges), bool)
    x, y, z, w = placement.toward_viewer.tolist()
    for owner in np.unique(sides[sides[:, 0] >= 0, 1]).tolist():
        rows = np.flatnonzero((sides[:, 1] == owner) & (sides[:, 0] >= 0))
        corners = np.column_stack([edges[rows], sides[rows, 0]])
        matrix = placement.relative_from_model[owner]
        positions = placement.positions[corners]
        points = np.stack([dot_rows(positions, line[:3]) + line[3] for line in matrix], axis=-1)
        a, b, c = np.moveaxis(points, 1, 0)
        toward = np.array([x, y, z]) - w * a
        facing = sides[rows, 2] * dot_rows(np.cross(b - a, c - a), toward)
        hidden = rows[(facing < 0.0) & (dot_rows(toward, np.array(plane.normal)) < 0.0)]
        first, last = placement.face_starts[owner : owner + 2].tolist()
        # A viewer inside the solid sees them.
        if len(hidden) and not (geometry.codes[geometry.faces[first:last]] & NEAR).any():
            result[hidden] = True
    return result


SECTION = Sections()
SECTION_LINES = SectionLines()
