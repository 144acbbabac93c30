"""Run the effects that look at the finished visibility buffer: ambient occlusion and outlines."""

from __future__ import annotations

import functools
import math
import operator

import numpy as np
from numpy.typing import NDArray

from rasterjit import stages, transforms
from rasterjit.kernels import ambient_occlusion, outlines
from rasterjit.kernels.records import Geometry, Placement
from rasterjit.scene.ambient_occlusion import AmbientOcclusion
from rasterjit.scene.camera import Camera, screen_from_relative
from rasterjit.scene.color import linear_to_srgb
from rasterjit.scene.outline import Outline

EDGE_BITS = {
    "silhouette": outlines.SILHOUETTE,
    "object": outlines.OBJECT,
    "crease": outlines.CREASE,
}


def lens_of(camera: Camera, size: tuple[int, int], unit: float) -> NDArray[np.float32]:
    """
    Return how the point at a pixel follows from its stored depth; see ``kernels.lenses``.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Width and height, pixels.
    unit : float, scene units
        What lengths are measured in.

    Returns
    -------
    (4, 4) float32
        Rows: what a column, a row, a unit of stored depth, and 1 add to the homogeneous point.
    """
    width, height = size
    # Rows of the inverse: x, y, z, w; columns: clip x, y, stored depth and 1, all over w.
    inverse = transforms.inverse(screen_from_relative(camera, size))
    right, up, deeper, rest = inverse.T
    lens = np.array(
        [
            right * (2.0 / width),
            up * (-2.0 / height),
            deeper,
            rest + right * (1.0 / width - 1.0) + up * (1.0 - 1.0 / height),
        ]
    )
    lens[:, :3] /= unit
    # Homogeneous points may have any scale: so that float32 holds them.
    return (lens / np.abs(lens[:, :3]).max()).astype(np.float32)


def find_occlusion(
    effect: AmbientOcclusion,
    camera: Camera,
    geometry: Geometry,
    placement: Placement,
    coverage: stages.Coverage,
    workers: stages.Workers,
) -> NDArray[np.float32]:
    """
    Return the share of ambient light that reaches each pixel, (H, W), 0..1.

    Parameters
    ----------
    effect : AmbientOcclusion
        With a radius.
    camera : Camera
    geometry, placement, coverage
        Of the visible faces; with its reversed depth.
    workers : Workers
    """
    face_id, depth, empty = coverage.face_id, coverage.reversed_depth, workers.memory.empty
    height, width = face_id.shape
    lens = lens_of(camera, (width, height), effect.radius)
    snap = math.ldexp(ambient_occlusion.SNAP_SLACK, -geometry.viewport.subpixel_bits)
    pattern = ambient_occlusion.screen_pattern()
    rough, tolerance = empty(face_id.shape, np.float32), empty(face_id.shape, np.float32)
    smooth = empty(face_id.shape, np.float32)
    per_task = stages.rows_per_task(face_id.shape, workers)
    bands = [((n, min(n + per_task, height)),) for n in range(0, height, per_task)]

    def find_band(rows: tuple[int, int]) -> None:
        ambient_occlusion.find_occlusion(
            face_id, rows, depth, geometry, placement, lens, snap, pattern, rough, tolerance,
            ambient_occlusion.scratch_memory(),
        )  # fmt: skip

    def smooth_band(rows: tuple[int, int]) -> None:
        scratch = np.empty((2, width), np.float32)
        ambient_occlusion.smooth_occlusion(rough, rows, -2, depth, tolerance, 1.0, smooth, scratch)

    def finish_band(rows: tuple[int, int]) -> None:
        scratch = np.empty((2, width), np.float32)
        ambient_occlusion.smooth_occlusion(
            smooth, rows, -1, depth, tolerance, effect.strength, rough, scratch
        )

    for task in (find_band, smooth_band, finish_band):
        workers.run(task, bands)
    return rough


def draw_outlines(
    effect: Outline,
    camera: Camera,
    geometry: Geometry,
    placement: Placement,
    coverage: stages.Coverage,
    color: NDArray[np.uint8],
    workers: stages.Workers,
) -> None:
    """
    Draw the edges of shapes over the colour.

    Parameters
    ----------
    effect : Outline
    camera : Camera
    geometry, placement, coverage
        Of the visible faces; with its reversed depth.
    color : (H, W, 4) uint8
        Written where there are edges, with alpha 255.
    workers : Workers
    """
    face_id, depth = coverage.face_id, coverage.reversed_depth
    height, width = face_id.shape
    lens = lens_of(camera, (width, height), 1.0)
    snap = math.ldexp(outlines.SNAP_SLACK, -geometry.viewport.subpixel_bits)
    kinds = functools.reduce(operator.or_, (EDGE_BITS[kind] for kind in effect.edges))
    _, least_cosine = transforms.sine_cosine(effect.crease_angle)
    marks = np.zeros(face_id.shape, np.uint8)
    encoded = linear_to_srgb(np.array(effect.color[:3]))
    rgba = np.append(np.floor(255.0 * encoded + 0.5), 255.0).astype(np.uint8).view(np.uint32)
    target, reach = color.view(np.uint32)[:, :, 0], disc_rows(effect.width)
    per_task = stages.rows_per_task(face_id.shape, workers)
    bands = [((n, min(n + per_task, height)),) for n in range(0, height, per_task)]

    def find_band(rows: tuple[int, int]) -> None:
        outlines.find_edges(
            face_id, rows, depth, coverage.reversed_vertex_depth, geometry, placement, lens, snap,
            kinds, least_cosine, marks, outlines.scratch_memory(width),
        )  # fmt: skip

    def draw_band(rows: tuple[int, int]) -> None:
        outlines.draw_marks(marks, rows, reach, rgba, target)

    workers.run(find_band, bands)
    workers.run(draw_band, bands)


def disc_rows(width: int) -> NDArray[np.int32]:
    """
    Return the rows of a disc whose diameter is a number of pixels, (D, 3) int32.

    Each as its distance from the middle, its first column and the one past its last, relative to
    the middle. A disc of even diameter has its middle between pixels, to the upper left.
    """
    offset = 0.0 if width % 2 else 0.5
    first = -(width // 2) + (1 - width % 2)
    rows = []
    for down in range(first, width // 2 + 1):
        room = (width / 2.0) * (width / 2.0) - (down - offset) * (down - offset)
        half = math.floor(math.sqrt(max(room, 0.0)) + offset)
        rows.append((down, -half + (1 - width % 2), half + 1))
    return np.array(rows, np.int32)
