"""Count the faces of a frame by fate, and bound the errors of its values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike

from rasterjit.outputs import diagnostics_stage
from rasterjit.outputs.ground_truth import find_metric_depth
from rasterjit.pipeline.geometry import setup
from rasterjit.pipeline.passes import KernelRow, Rows
from rasterjit.pipeline.records import Geometry, Objects
from rasterjit.pipeline.visibility import tile_rasterizer, visibility_pass
from rasterjit.runtime.threads import Workers, split_into_bands
from rasterjit.scene.arrays import Int32, Int64
from rasterjit.scene.camera import Camera
from rasterjit.scene.notebook_preview import TextReport
from rasterjit.survey.depth_format import DepthFormat

FLOAT32_ROUNDING = 2.0**-24
"""Largest relative error of rounding a value to float32."""


@dataclass(frozen=True, repr=False)
class Diagnostics(TextReport):
    """
    Exact counts of faces by fate, and error bounds of a frame's values; prints as a table.

    ``faces`` is the sum of ``visible``, ``hidden``, ``sub_pixel``, ``culled``, ``degenerate``,
    ``outside`` and ``invalid``.
    """

    faces: int
    visible: int
    """Visible at one pixel or more."""
    hidden: int
    """Cover the centre of a pixel, but are visible at none."""
    sub_pixel: int
    """With area inside the image, but at no pixel's centre: too small or too thin."""
    culled: int
    """Facing away from the viewer, with culling on."""
    degenerate: int
    """Without area once their vertices are snapped to the sub-pixel grid."""
    outside: int
    """Without a part inside the view volume and the image."""
    invalid: int
    """With one of ``invalid_vertices``; dropped."""
    invalid_vertices: int
    """Vertices that are NaN, infinite or beyond 1e150 in clip space, whether a face uses them or
    not."""
    clipped: int
    """Faces cut at the near or far plane or the guard band; counted by their fate as well."""
    samples: int
    """Pixel centres that faces cover, seen or not; those under two faces count twice."""
    pixels_covered: int
    """Pixels that show a face."""
    tied_pixels: int
    """Pixels where a hidden face has exactly the stored depth of the visible one."""
    depth_range: tuple[float, float] | None
    """Nearest and farthest visible depth, scene units along the viewing axis; None without any."""
    stored_depth_range: tuple[float, float] | None
    """Smallest and largest visible stored depth, no unit; greater is nearer. None without any."""
    interpolation_error: float
    """
    Bound of the error of an interpolated vertex value, before it is stored.

    No unit: at every visible pixel a value in float64 is within this times the largest magnitude of
    the face's three vertex values, compared with exact arithmetic on the snapped vertices (clip
    positions, where a face was clipped). Infinite if a clipped face is seen so exactly from its
    side that nothing is certain; 0 if no face is seen.
    """
    attribute_error: float
    """The same bound for a value stored as float32, as all outputs are."""

    @property
    def overdraw(self) -> float:
        """Mean number of faces over a covered pixel; 0 without covered pixels."""
        return self.samples / self.pixels_covered if self.pixels_covered else 0.0

    def rows(self) -> list[tuple[str, str]]:
        """Return names and values of the table; names of parts of a sum are indented."""
        counts = [
            ("faces", self.faces),
            ("  visible", self.visible),
            ("  hidden behind others", self.hidden),
            ("  smaller than the pixel grid", self.sub_pixel),
            ("  turned away", self.culled),
            ("  without area", self.degenerate),
            ("  outside the view", self.outside),
            ("  invalid", self.invalid),
            ("faces clipped", self.clipped),
            ("vertices invalid", self.invalid_vertices),
            ("pixels covered", self.pixels_covered),
            ("pixels with a tie in depth", self.tied_pixels),
        ]
        rows = [(name, f"{count:,}") for name, count in counts]
        rows.append(("faces over a covered pixel", f"{self.overdraw:.2f}"))
        rows.append(("depth, scene units", _format_range(self.depth_range)))
        rows.append(("stored depth", _format_range(self.stored_depth_range)))
        rows.append(("error of interpolation, relative", f"{self.interpolation_error:.1e}"))
        rows.append(("error as stored, relative", f"{self.attribute_error:.1e}"))
        return rows

    def __str__(self) -> str:
        rows = self.rows()
        name_width = max(len(name) for name, _ in rows)
        text_width = max(len(text) for _, text in rows)
        return "\n".join(f"{name:<{name_width}}  {text:>{text_width}}" for name, text in rows)


def kernels_of(depth_type: DTypeLike) -> Rows:
    """Return the kernels that `diagnose` calls, for a plan."""
    return [
        KernelRow(diagnostics_stage.find_fates),
        KernelRow(diagnostics_stage.count_samples, visibility_pass.name_depth_variant(depth_type)),
        KernelRow(diagnostics_stage.find_largest_error),
    ]


def diagnose(
    coverage: visibility_pass.Coverage,
    objects: Objects,
    geometry: Geometry,
    camera: Camera,
    workers: Workers,
    depth_format: DepthFormat | None = None,
) -> Diagnostics:
    """
    Count the faces of a drawn frame by fate, and bound the errors of its values.

    Parameters
    ----------
    coverage : Coverage
        With the lists of its tiles.
    objects : Objects
    geometry : Geometry
    camera : Camera
    workers : Workers
    depth_format : DepthFormat, optional
        Format of the depths; default: the camera's reversed depth in float32.

    Raises
    ------
    ValueError
        If the coverage was drawn without keeping its lists.
    """
    if coverage.lists is None:
        raise ValueError("coverage must be drawn with VisibilityOptions(lists=True)")
    faces, viewport, face_id = coverage.lists.faces, geometry.viewport, coverage.face_id
    samples, tied_pixels = _count_samples(coverage, coverage.lists, geometry, workers)
    covered = face_id >= 0
    visible = np.zeros(len(faces.faces), np.uint8)
    visible[face_id[covered]] = 1
    fates = np.empty(len(faces.faces), np.uint8)
    view = coverage.screen, viewport, (samples, visible)
    diagnostics_stage.find_fates(faces, objects, *view, fates)
    counts = np.bincount(fates, minlength=diagnostics_stage.FATE_COUNT).tolist()
    codes = coverage.screen.codes[: len(geometry.clip_positions)]
    depths = _find_depth_ranges(coverage, camera, depth_format)
    error = _find_largest_error(face_id, geometry, workers)
    return Diagnostics(
        faces=len(fates),
        visible=counts[diagnostics_stage.VISIBLE],
        hidden=counts[diagnostics_stage.HIDDEN],
        sub_pixel=counts[diagnostics_stage.SUB_PIXEL],
        culled=counts[diagnostics_stage.CULLED],
        degenerate=counts[diagnostics_stage.DEGENERATE],
        outside=counts[diagnostics_stage.OUTSIDE],
        invalid=counts[diagnostics_stage.DROPPED],
        invalid_vertices=int(np.count_nonzero(codes & setup.INVALID)),
        clipped=coverage.totals.clipped,
        samples=int(samples.sum()),
        pixels_covered=int(np.count_nonzero(covered)),
        tied_pixels=tied_pixels,
        depth_range=depths[0],
        stored_depth_range=depths[1],
        interpolation_error=error,
        # Rounding acts on the value with its error.
        attribute_error=error + FLOAT32_ROUNDING * (1.0 + error) if error > 0.0 else 0.0,
    )


def _count_samples(
    coverage: visibility_pass.Coverage,
    lists: visibility_pass.TileLists,
    geometry: Geometry,
    workers: Workers,
) -> tuple[Int64, int]:
    """Return the samples of each triangle, faces before pieces, and the number of tied pixels."""
    starts, binned, faces = lists.starts, lists.binned, lists.faces
    viewport = geometry.viewport
    counts = np.zeros(len(binned), np.int32), np.zeros(len(starts) - 1, np.int64)

    def count_in_tiles(tiles: Int32) -> None:
        size = setup.TILE_SIZE
        drawer = tile_rasterizer.make_tile_drawer(
            binned, faces, coverage.screen, coverage.depth.dtype
        )
        frame, ties = (coverage.depth, coverage.face_id), np.zeros((size, size), np.uint8)
        diagnostics_stage.count_samples(
            tiles, starts, viewport, frame, drawer.scratch, drawer.drawing, ties, counts
        )

    tiles = np.arange(len(starts) - 1, dtype=np.int32)
    step = visibility_pass.TILES_PER_TASK
    workers.run(count_in_tiles, [(tiles[n : n + step],) for n in range(0, len(tiles), step)])
    samples = np.zeros(len(faces.faces) + len(faces.pieces), np.int64)
    np.add.at(samples, binned, counts[0])
    return samples, int(counts[1].sum())


def _find_depth_ranges(
    coverage: visibility_pass.Coverage, camera: Camera, depth_format: DepthFormat | None
) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
    """Return the ranges of metric depth, as the output has it, and of stored depth."""
    covered = coverage.face_id >= 0
    stored = coverage.depth[covered]
    if not len(stored):
        return None, None
    ends = np.array([stored.max(), stored.min()])
    if depth_format is None or depth_format.is_reversed:
        with np.errstate(over="ignore"):
            nearest, farthest = np.asarray(camera.view_depth(ends), np.float32).tolist()
    else:
        metric = find_metric_depth(depth_format, camera, coverage, covered.shape[::-1])[covered]
        nearest, farthest = float(metric.min()), float(metric.max())
    return (nearest, farthest), (float(ends[1]), float(ends[0]))


def _find_largest_error(face_id: Int32, geometry: Geometry, workers: Workers) -> float:
    """Return the largest error bound of a visible sample."""
    bands = split_into_bands(face_id.shape, workers)
    largest = np.zeros((len(bands), 1))
    workers.run(
        diagnostics_stage.find_largest_error,
        [(face_id, rows, geometry, own) for rows, own in zip(bands, largest, strict=True)],
    )
    return float(largest.max())


def _format_range(ends: tuple[float, float] | None) -> str:
    return "none" if ends is None else f"{ends[0]:.6g} to {ends[1]:.6g}"
