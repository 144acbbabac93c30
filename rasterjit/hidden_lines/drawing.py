"""Draw the visible edges of a scene as lines, and write them to SVG and PDF files."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.label import Texts, project_anchors
from rasterjit.hidden_lines import graphics, helvetica, stage
from rasterjit.hidden_lines.edges import (
    DEFAULT_KINDS,
    KINDS,
    FeatureEdges,
    LineKind,
    collect_faces,
    find_edges,
    join_parts,
)
from rasterjit.hidden_lines.occlusion import (
    Triangles,
    find_hiding_triangles,
    hides_point,
    split_by_visibility,
)
from rasterjit.hidden_lines.piercings import find_intersections
from rasterjit.hidden_lines.text_outlines import trace_text
from rasterjit.inspect.cross_section import join_edges
from rasterjit.io.atomic_write import atomic_file
from rasterjit.io.images import check_save_path
from rasterjit.io.meshes import as_scene
from rasterjit.io.text_layout import PADDING_SHARE
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.visibility.visibility_pass import make_geometry, project_to_screen
from rasterjit.rendering.planning import PlannedFrame, check_request, plan_frame
from rasterjit.rendering.renderer import find_visible
from rasterjit.runtime.threads import Workers
from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Bool, Float64, Int32
from rasterjit.scene.camera import Camera
from rasterjit.scene.color import ColorLike, opaque_codes, rgba
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.label import Label
from rasterjit.scene.outline import HIDDEN_LINES, HiddenLines, Outline
from rasterjit.scene.pixel_projection import screen_from_relative
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.section import check_section, planes_in
from rasterjit.scene.transforms import transform_points
from rasterjit.scene.validation import read_only
from rasterjit.scene.warning import warn_caller
from rasterjit.survey.deformation import check_lists, pose_scene
from rasterjit.survey.effect import with_field

WIDTHS = {
    "section": 1.0, "boundary": 1.0, "silhouette": 1.0, "crease": 0.5, "intersection": 0.5,
    "line": 0.5, "wireframe": 0.25, "hidden": 0.35,
}  # fmt: skip
"""Widths of lines, points; outlines are twice as wide as the edges inside them, as ISO 128 asks."""

FROM_BEHIND: tuple[LineKind, ...] = (
    "wireframe", "line", "intersection", "crease", "boundary", "silhouette", "section",
)  # fmt: skip
"""Kinds of lines in the order in which they are drawn."""

SUBPIXEL_BITS: Literal[12] = 12
"""Of the grid that ends of edges and corners of faces are rounded to: 1/4096 pixel."""

JOIN_STEPS = 256.0
"""Steps to the pixel in which two ends are one: what hides less of a line leaves it whole."""

MIN_LENGTH = 0.001
"""Least width of a line, and length of a dash or a gap, points: numbers have three places."""

MAX_POINTS = 14400.0
"""Longest side of a page, points, that readers of PDF show."""


@dataclass(frozen=True, eq=False)
class LineDrawing:
    """
    The edges of a scene as lines on a page, as `line_drawing` returns them.

    Parameters
    ----------
    size : (int, int)
        Width and height, pixels.
    segments : (N, 2, 2) float64, read-only
        Both ends of each line, pixels: x right, y down, the centre of the pixel in column i and row
        j at (i + 0.5, j + 0.5). In the picture; in the order of edges, then along them.
    kinds : (N,) str
        ``"section"``, ``"boundary"``, ``"silhouette"``, ``"crease"``, ``"intersection"``,
        ``"line"`` or ``"wireframe"``.
    object_ids : (N,) int32
        Whose edges they are, as the output ``object_id`` numbers objects.
    visible : (N,) bool
        Whether nothing hides the line.
    labels : tuple of (Label, (x, y))
        The texts that are seen, and where their positions are, pixels.
    color : (4,) tuple of float
        Linear RGBA that lines are drawn in by default: the colour of the scene's outline, or black.
    """

    size: tuple[int, int]
    segments: Float64
    kinds: NDArray[np.str_]
    object_ids: Int32
    visible: Bool
    labels: tuple[tuple[Label, tuple[float, float]], ...] = ()
    color: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __repr__(self) -> str:
        """Return the numbers of lines."""
        width, height = self.size
        seen = int(np.count_nonzero(self.visible))
        hidden = len(self.visible) - seen
        return f"LineDrawing({width} x {height}, {seen} visible and {hidden} hidden lines)"

    def paths(self, kind: LineKind | None = None, visible: bool = True) -> list[Float64]:
        """
        Return lines joined where they continue.

        Ends less than about 1/256 pixel apart are one; lines shorter than that are left out.

        Parameters
        ----------
        kind : str, optional
            One kind of lines. Default: all, each kind joined by itself.
        visible : bool
            Whether to return those that are seen, or those that are hidden.

        Returns
        -------
        list of (K, 2) float64
            Pixels. A closed one ends with its first point.

        Raises
        ------
        ValueError
            If the kind is unknown.
        """
        check.boolean("visible", visible)
        if kind is not None:
            check.one_of("kind", kind, KINDS)
        kinds = KINDS if kind is None else (kind,)
        found = []
        for one in kinds:
            found += _join_segments(self.segments[(self.kinds == one) & (self.visible == visible)])
        return found

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        dpi: float = 72.0,
        width: float | Mapping[str, float] | None = None,
        color: ColorLike | Mapping[str, ColorLike] | None = None,
        hidden: HiddenLines = "none",
        dash: Sequence[float] = (3.0, 2.0),
        background: ColorLike | None = None,
    ) -> None:
        """
        Write the drawing as vector graphics; the format follows the extension.

        Texts of labels are texts: in SVG in the label's font or Helvetica, in PDF in Helvetica, or
        outlines of all their characters where that lacks one.
        Lines of one kind are a group in SVG, each line a path.

        Parameters
        ----------
        path : str or Path
            ``.svg`` or ``.pdf``.
        dpi : float
            Pixels to the inch: the page is ``72 / dpi`` points to the pixel. With 72, a pixel is a
            point.
        width : float or mapping of str to float, optional
            Of lines, points, 0.001..14400, whatever the ``dpi``: of all, or by their kind and
            ``"hidden"``. Default: 1 for outlines and sections, 0.5 for creases, less for what is
            hidden and for wireframes.
        color : colour or mapping of str to colour, optional
            Of lines, as ``width``; opaque. Default: that of the drawing.
        hidden : str
            ``"none"`` leaves hidden lines out, ``"dashed"`` dashes them.
        dash : (float, float)
            Lengths of dashes and gaps of hidden lines, points, 0.001..14400.
        background : colour, optional
            Of the page. Default: none.

        Raises
        ------
        ValueError
            Naming the argument that is wrong. Nothing is written.
        OSError
            If the file cannot be written; an existing one is left as it was.

        Warns
        -----
        UserWarning
            If no font has a character of a label, in PDF.
        """
        target = check_save_path(path, graphics.FORMATS)
        scale = 72.0 / check.positive_number("dpi", dpi)
        if not 0.0 < scale * max(self.size) <= MAX_POINTS:
            raise ValueError(
                f"dpi must leave a page at most {MAX_POINTS:g} points long, got {dpi!r}, which "
                f"makes {scale * max(self.size):g}"
            )
        pens = _Pens(self.color, width, color, dash)
        check.one_of("hidden", hidden, HIDDEN_LINES)
        strokes = []
        if hidden == "dashed":
            paths = [path for kind in FROM_BEHIND for path in self.paths(kind, visible=False)]
            strokes.append(pens.make_stroke("hidden", paths, scale))
        for kind in FROM_BEHIND:
            strokes.append(pens.make_stroke(kind, self.paths(kind), scale))
        page = graphics.Page(
            scale * self.size[0], scale * self.size[1],
            None if background is None else _to_codes(rgba("background", background)),
            [stroke for stroke in strokes if stroke.paths],
            [_place_text(label, place, scale) for label, place in self.labels],
        )  # fmt: skip
        content = _write_page(page, target)
        with atomic_file(target) as temporary:
            temporary.write_bytes(content)


class _Pens:
    """Widths and colours of lines by their kind, checked."""

    def __init__(self, ink: Any, width: Any, color: Any, dash: Any) -> None:
        names = (*KINDS, "hidden")
        self.widths = WIDTHS | {
            kind: _check_length(name, value)
            for kind, name, value in _by_kind("width", width, names)
        }
        self.colors = dict.fromkeys(names, _to_codes((*ink[:3], 1.0))) | {
            kind: _to_codes((*rgba(name, value)[:3], 1.0))
            for kind, name, value in _by_kind("color", color, names)
        }
        pair = check.sequence("dash", dash)
        if len(pair) != 2:
            raise ValueError(f"dash must be the lengths of a dash and a gap, got {dash!r}")
        first, second = (_check_length(f"dash[{n}]", value) for n, value in enumerate(pair))
        self.dash = first, second

    def make_stroke(self, kind: str, paths: list[Float64], scale: float) -> graphics.Stroke:
        """Return lines of a kind, given in pixels, on the page."""
        dash = self.dash if kind == "hidden" else None
        scaled = [scale * path for path in paths]
        return graphics.Stroke(kind, scaled, self.colors[kind], self.widths[kind], dash)


def _check_length(name: str, value: Any) -> float:
    """Return a length in points that files can hold, or raise ``ValueError``."""
    return check.bounded_number(name, value, MIN_LENGTH, MAX_POINTS)


def _by_kind(name: str, value: Any, kinds: Sequence[str]) -> list[tuple[str, str, Any]]:
    """Return what a value says of kinds: each, the name of its value, and that."""
    if value is None:
        return []
    if not isinstance(value, Mapping):
        return [(kind, name, value) for kind in kinds]
    for kind in value:
        check.one_of(f"{name}'s kinds", kind, kinds)
    return [(kind, f"{name}[{kind!r}]", one) for kind, one in value.items()]


def _to_codes(color: Sequence[float]) -> graphics.Codes:
    """Return a linear colour as sRGB codes, with its alpha."""
    red, green, blue, _ = opaque_codes(color).tolist()
    return red, green, blue, math.floor(255.0 * color[3] + 0.5)


def line_drawing(
    scene: Any,
    camera: Camera | None = None,
    size: tuple[int, int] = (640, 480),
    *,
    edges: Sequence[LineKind] = DEFAULT_KINDS,
    crease_angle: float | None = None,
    threads: int | None = None,
) -> LineDrawing:
    """
    Find the edges of a scene that are visible, as lines for figures in print.

    Each edge is cut where faces begin and end to hide it, and each piece is decided exactly, for
    ends of edges and corners of faces on a grid of 1/4096 pixel: no depth buffer is sampled. A face
    hides the part of an edge that it covers and is in front of, if its lead exceeds rounding
    somewhere there: that of the grid, and of float64. So it does not hide its own edges, and lines
    in its plane.

    What hides, and what is an edge:

    - Faces that are culled hide nothing, and where all faces at an edge are culled, it is hidden.
      Else both sides of faces hide.
    - Objects that blend (``alpha_mode="blend"`` with an alpha below 1) or transmit light hide
      nothing, but their own edges are drawn. Holes of alpha masks are not seen.
    - A section cuts the scene first; its caps hide as faces do. Where solids overlap in it, the
      outlines of both are drawn. Caps have no hatching.
    - Faces that pierce each other hide each other's edges from where they pierce. The line along
      which they do so is an edge; where solids touch by what float32 rounds, there is none, nor
      where surfaces coincide.
    - Points are not drawn, and `Lines` as lines of one width that hide nothing; a lens would bend
      lines, so there is none.

    Parameters
    ----------
    scene : Scene, Mesh or anything else that `rasterjit.render` takes
    camera : Camera, optional
        Default: the scene's own, else one that fits the scene.
    size : (int, int)
        Width and height, pixels; the shape of the page, as in `rasterjit.render`.
    edges : sequence of str
        Which edges; one of several kinds is of the first of them. ``"section"``: where a plane of
        the scene's section cuts faces. ``"boundary"``: with a face on one side alone.
        ``"silhouette"``: where the surface turns away. ``"crease"``: where two faces meet at an
        angle, or more than two. ``"intersection"``: where two faces pierce each other. ``"line"``:
        the lines of `Lines`. ``"wireframe"``: all other edges of faces; not by default.
    crease_angle : float, optional
        By how much a crease turns at least, degrees, 0..180. Default: that of the scene's
        `Outline`, or of any.
    threads : int, optional
        Default: all processors. The result has the same bits for any number.

    Returns
    -------
    LineDrawing

    Raises
    ------
    ValueError
        Naming the argument that is wrong.

    Warns
    -----
    UserWarning
        If the scene has points, or a plane of its section a hatch, which are not drawn.

    Examples
    --------
    >>> import rasterjit as rj
    >>> drawing = rj.line_drawing(rj.load("models/teapot.obj"), size=(480, 360))
    >>> drawing.save("teapot.svg", hidden="dashed")
    >>> drawing.segments.shape[1:], str(drawing.kinds[0])
    ((2, 2), 'boundary')
    """
    size = check.image_size("size", size)
    kinds = _check_kinds(edges)
    posed = _prepare(scene)
    outline = posed.outline or Outline()
    angle = outline.crease_angle
    if crease_angle is not None:
        angle = check.bounded_number("crease_angle", crease_angle, 0.0, 180.0)
    workers = Workers(check.thread_count("threads", threads))
    request = check_request(size, Quality(subpixel_bits=SUBPIXEL_BITS), ("face_id",), None, "none")
    planned = plan_frame(request, posed, camera)
    _warn_of_what_is_left_out(planned)
    try:
        return _draw(planned, workers, kinds, angle, outline.color)
    finally:
        workers.close()


def _prepare(source: Any) -> Scene:
    """Return what is drawn as a posed scene, whose section tells its lines."""
    scene = as_scene(source, "scene")
    check_lists(scene)
    posed = pose_scene(scene)
    if posed.section is None:
        return posed
    planes = planes_in(check_section("scene.section", posed.section))
    return with_field(posed, "section", tuple(replace(plane, lines=True) for plane in planes))


def _check_kinds(value: Any) -> tuple[str, ...]:
    """Return kinds of edges without repeats, or raise ``ValueError``."""
    kinds = (value,) if isinstance(value, str) else check.sequence("edges", value)
    if not kinds:
        raise ValueError(f"edges must name at least one of {', '.join(KINDS)}; got {value!r}")
    for kind in kinds:
        check.one_of("edges", kind, KINDS)
    return tuple(kind for kind in KINDS if kind in kinds)


def _warn_of_what_is_left_out(planned: PlannedFrame) -> None:
    """Warn if there are objects of points, or hatchings of a section."""
    primitives = planned.cache.shapes.arrays.primitives
    count = len([one for one in primitives if one.kind == "points"])
    if count:
        objects = "1 object" if count == 1 else f"{count} objects"
        warn_caller(f"scene has {objects} of points, which a line drawing leaves out")
    planes = planes_in(planned.scene.section) if planned.scene.section is not None else ()
    hatched = [str(n) for n, plane in enumerate(planes) if plane.hatch is not None and plane.cap]
    if hatched:
        which = f"plane{'s' if len(hatched) > 1 else ''} {', '.join(hatched)}"
        warn_caller(f"scene.section has a hatch in {which}, which a line drawing leaves out")


def _draw(
    planned: PlannedFrame, workers: Workers, kinds: tuple[str, ...], angle: float, color: Any
) -> LineDrawing:
    """Find the edges of a planned frame, and which parts of them are visible."""
    plan, cache = planned.plan, planned.cache
    # Project the scene, without drawing it.
    seen = find_visible(
        plan, cache, workers, lambda _: None, planned.views, depth=False, faces=False, draws=False,
        lists=True, clip_positions=True,
    )  # fmt: skip
    geometry, coverage = seen.geometry, seen.coverage
    assert coverage.lists is not None
    triangles = find_hiding_triangles(planned, coverage.lists.faces, seen.objects, coverage.screen)
    # Find the edges, and project them.
    faces = collect_faces(cache, geometry, seen.objects, seen.placement)
    edges = find_edges(cache, faces, kinds, angle)
    coefficients = plan.depth_format.coefficients
    ends, depths = project_edges(edges, geometry, coefficients)
    if "intersection" in kinds:
        piercings, points = find_intersections(faces, workers)
        more_ends, more_depths = project_edges(
            piercings, _project_points(points, planned, geometry, workers), coefficients
        )
        ends, depths = np.concatenate([ends, more_ends]), np.concatenate([depths, more_depths])
        edges = join_parts([edges, piercings])
    # Decide what is visible.
    turned = np.flatnonzero(edges.is_turned_away)
    others = np.flatnonzero(~edges.is_turned_away)
    extent = plan.size[0] << SUBPIXEL_BITS, plan.size[1] << SUBPIXEL_BITS
    pieces = split_by_visibility(ends[others], depths[others], triangles, extent, workers)
    numbers = np.concatenate([others[pieces.edges], turned])
    parts = np.concatenate([pieces.parts, np.tile((0.0, 1.0), (len(turned), 1))])
    is_hidden = np.concatenate([pieces.is_hidden, np.ones(len(turned), bool)])
    order = np.argsort(numbers, kind="stable")
    numbers, parts, is_hidden = numbers[order], parts[order], is_hidden[order]
    # Put the pieces on the page.
    starts, stops = (ends[numbers].reshape(-1, 2, 2)[:, k] / (1 << SUBPIXEL_BITS) for k in (0, 1))
    segments = starts[:, np.newaxis] + parts[:, :, np.newaxis] * (stops - starts)[:, np.newaxis]
    segments, is_inside = clip_to_page(segments, plan.size)
    numbers = numbers[is_inside]
    owners = edges.objects[numbers]
    if cache.cut is not None:
        owners = cache.cut.owners[owners]
    return LineDrawing(
        plan.size, read_only(segments[is_inside]), read_only(np.array(KINDS)[edges.kinds[numbers]]),
        read_only(owners.astype(np.int32)), read_only(~is_hidden[is_inside]),
        _find_labels(planned, triangles), color,
    )  # fmt: skip


def project_edges(
    edges: FeatureEdges, geometry: Geometry, coefficients: tuple[float, float, float]
) -> tuple[Int32, Float64]:
    """Return the ends of edges on the sub-pixel grid, (E, 4), and their stored depths, (E, 2)."""
    count = len(edges.vertices)
    ends, depths = np.zeros((count, 4), np.int32), np.zeros((count, 2))
    stage.project_segments(edges.vertices, geometry, coefficients, ends, depths)
    return ends, depths


def _project_points(
    points: Float64, planned: PlannedFrame, like: Geometry, workers: Workers
) -> Geometry:
    """Return points relative to the eye, (N, 3), projected as vertices are, without faces."""
    clip_positions = transform_points(planned.views.clip_from_relative, points)
    screen, _ = project_to_screen(
        clip_positions, planned.plan.depth_format.coefficients, like.viewport, workers
    )
    return make_geometry(like.faces[:0], screen, clip_positions, like.viewport)


def clip_to_page(segments: Float64, size: tuple[int, int]) -> tuple[Float64, Bool]:
    """Return segments, (N, 2, 2), clipped to a picture, and which have a length there."""
    low, high = np.zeros(len(segments)), np.ones(len(segments))
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    for axis in (0, 1):
        with np.errstate(divide="ignore", invalid="ignore"):
            at = (np.array([0.0, size[axis]]) - start[:, axis, np.newaxis]) / along[
                :, axis, np.newaxis
            ]
        is_beside = (along[:, axis] == 0.0) & (
            (start[:, axis] < 0.0) | (start[:, axis] > size[axis])
        )
        at[along[:, axis] == 0.0] = (0.0, 1.0)
        low, high = np.maximum(low, at.min(axis=1)), np.minimum(high, at.max(axis=1))
        high[is_beside] = -1.0
    clipped = segments.copy()
    is_cut = (low > 0.0) | (high < 1.0)
    for end, share in ((0, low), (1, high)):
        moved = start[is_cut] + share[is_cut, np.newaxis] * along[is_cut]
        clipped[is_cut, end] = np.clip(moved, 0.0, size)
    return clipped, (low < high) & np.any(clipped[:, 0] != clipped[:, 1], axis=1)


def _join_segments(segments: Float64) -> list[Float64]:
    """Return chains of segments, (K, 2) each; those shorter than a step are left out."""
    points = segments.reshape(-1, 2)
    if not len(points):
        return []
    numbers, firsts = distinct_rows(*np.rint(JOIN_STEPS * points).astype(np.int64).T)
    edges = numbers.reshape(-1, 2)
    chains = join_edges(edges[edges[:, 0] != edges[:, 1]])
    return [points[firsts[chain]] for chain in chains]


def _find_labels(
    planned: PlannedFrame, triangles: Triangles
) -> tuple[tuple[Label, tuple[float, float]], ...]:
    """Return the labels that are seen, and their positions, pixels."""
    placed = [(node.label, node.world_matrix) for node in planned.scene.labelled if node.label]
    if not placed:
        return ()
    plan, (width, height) = planned.plan, planned.plan.size
    labels = tuple(label for label, _ in placed)
    points = np.concatenate(
        [transform_points(matrix, np.array([label.position]))[:, :3] for label, matrix in placed]
    )
    anchors = project_anchors(Texts(labels, points), plan)
    screen = screen_from_relative(plan.camera, plan.size)
    rows = transform_points(screen, points - plan.camera.eye_position())
    found = []
    for label, (_, _, stored, w), (x, y) in zip(
        labels, rows.tolist(), anchors.tolist(), strict=True
    ):
        if not math.isfinite(x):
            continue
        if label.hidden:
            is_inside = 0.0 <= x <= width and 0.0 <= y <= height
            if not is_inside or hides_point(triangles, (x, y), stored / w, SUBPIXEL_BITS):
                continue
        found.append((label, (x, y)))
    return tuple(found)


def _place_text(label: Label, place: tuple[float, float], scale: float) -> graphics.Text:
    """Return a label on the page, given its position in pixels."""
    size, lines = scale * label.size, label.text.replace("\t", "    ").split("\n")
    widths = [size * helvetica.measure_width(line) for line in lines]
    pitch = size * helvetica.PITCH
    padding = 0.0 if label.background is None else PADDING_SHARE * size
    width, height = max(widths), size + (len(lines) - 1) * pitch
    x, y = (scale * (at + by) for at, by in zip(place, label.offset, strict=True))
    align = next((side for side in ("left", "right") if side in label.anchor), "center")
    x += {"left": padding, "center": 0.0, "right": -padding}[align]
    left = x - graphics.TEXT_SHIFTS[align] * width
    top = y - 0.5 * height
    if "top" in label.anchor:
        top = y + padding
    elif "bottom" in label.anchor:
        top = y - padding - height
    box = left - padding, top - padding, width + 2.0 * padding, height + 2.0 * padding
    first = top + helvetica.ASCENT * size
    return graphics.Text(
        list(zip(lines, widths, strict=True)), x, [first + n * pitch for n in range(len(lines))],
        size, align, _to_codes(label.color), None if label.background is None else box,
        (0, 0, 0, 0) if label.background is None else _to_codes(label.background),
        None if label.font is None else os.fspath(label.font),
    )  # fmt: skip


def _write_page(page: graphics.Page, target: Path) -> bytes:
    """Return the content of a file."""
    if target.suffix.lower() == ".svg":
        return graphics.write_svg(page).encode("utf-8")
    texts = [
        text
        if all(helvetica.has_characters(line) for line, _ in text.lines)
        else text._replace(outlines=trace_text(text))
        for text in page.texts
    ]
    return graphics.write_pdf(page._replace(texts=texts))
