"""Run the visibility stage alone, on clip positions, for custom geometry and shading."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.forks import cached_property
from rasterjit.outputs import ground_truth
from rasterjit.pipeline.geometry import barycentric as interpolation
from rasterjit.pipeline.records import Geometry, Objects
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.rendering.planning import CULL_MODES, Cull
from rasterjit.runtime.threads import Workers
from rasterjit.scene.first_corners import corner_offsets, rotate_corners
from rasterjit.scene.mesh import face_array, value_rows
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.validation import image_size, number_array, one_of, thread_count
from rasterjit.survey.depth_format import DepthFormat, make_ndc_format

DepthMode: TypeAlias = Literal["standard", "reversed"]
DEPTH_MODES: tuple[DepthMode, ...] = get_args(DepthMode)


class RasterizedFaces:
    """
    Which face each pixel shows, and where on it.

    Attributes
    ----------
    face_id : (H, W) int32
        -1 where nothing is.
    depth : (H, W) float32
        NDC z as given, z / w, as far as the depth format tells; ``inf`` where nothing is.
    totals : Totals
        What became of the faces.
    """

    def __init__(
        self,
        coverage: visibility_pass.Coverage,
        geometry: Geometry,
        vertex_count: int,
        listed: NDArray[np.int32],
        sign: float,
        depth_format: DepthFormat | None = None,
    ) -> None:
        self.face_id: NDArray[np.int32] = coverage.face_id
        self.totals = coverage.totals
        depth = coverage.depth
        if depth_format is not None and not depth_format.is_standard:
            nowhere = np.zeros(1)
            depth = depth_format.reversed_depth(depth, nowhere, nowhere).astype(np.float32)
        self.depth: NDArray[np.float32] = np.where(
            coverage.face_id >= 0, np.float32(sign) * depth, np.float32(np.inf)
        )
        self._geometry = geometry
        self._vertex_count = vertex_count
        self._listed = listed

    @cached_property
    def barycentric(self) -> NDArray[np.float32]:
        """
        Return the weights of the face's own three vertices, clipped or not.

        (H, W, 3) float32, perspective-correct (or affine, as ``quality`` says), 0 where nothing
        is. Computed when first read.
        """
        places = corner_offsets(self._listed, self._geometry.faces)
        return self._filled(ground_truth.FillCall(interpolation.fill_barycentric, (3,), (places,)))

    def interpolate(self, values: ArrayLike) -> NDArray[np.float32]:
        """
        Return values of the vertices at each pixel's centre.

        Parameters
        ----------
        values : (V, D) array_like of float, any D >= 1
            Taken as float32.

        Returns
        -------
        (H, W, D) float32
            Perspective-correct (or affine, as ``quality`` says), the numbers of the output
            ``attribute:NAME``; NaN where nothing is.

        Raises
        ------
        ValueError
            If the shape is another one, or a value is NaN, infinite or beyond float32.
        """
        rows = value_rows("values", values)
        if len(rows) != self._vertex_count:
            raise ValueError(
                f"values must have one row per vertex ({self._vertex_count}), got {len(rows)}"
            )
        return self._filled(
            ground_truth.FillCall(interpolation.fill_attribute, rows.shape[1:], (rows,))
        )

    def _filled(self, one: ground_truth.FillCall) -> NDArray[np.float32]:
        return one.run(self.face_id, self._geometry, Workers(1))


def rasterize(
    clip_positions: ArrayLike,
    faces: ArrayLike,
    size: tuple[int, int],
    *,
    cull: Cull = "none",
    depth: DepthMode = "standard",
    quality: Quality | None = None,
    threads: int | None = None,
) -> RasterizedFaces:
    """
    Find the visible face at every pixel.

    Parameters
    ----------
    clip_positions : (V, 4) array_like, clip space
        OpenGL's view volume ``-w <= x, y, z <= w``; y points up. Faces with a vertex that is NaN,
        infinite or beyond 1e150 are left out.
    faces : (F, 3) array_like of int, vertex numbers
    size : (int, int)
        Width and height, pixels, each in 1..16384.
    cull : {"none", "back", "front"}
        Counter-clockwise on the screen is the front.
    depth : {"standard", "reversed"}
        Whether the smaller or the larger z / w is nearer.
    quality : Quality, optional
        Default ``Quality.standard()``.
    threads : int, optional
        Default: all processors. The result has the same bits for any number.

    Returns
    -------
    RasterizedFaces

    Raises
    ------
    ValueError
        If an argument has a wrong shape or value, or a face points outside the vertices.
    """
    width_height = image_size("size", size)
    one_of("cull", cull, CULL_MODES)
    one_of("depth", depth, DEPTH_MODES)
    positions = _clip_array(clip_positions)
    listed = face_array(faces, len(positions))
    face_numbers = rotate_corners(positions, listed)
    quality = check_quality(quality)
    viewport = make_viewport(width_height, quality.subpixel_bits)
    workers = Workers(thread_count("threads", threads))
    turn = {"none": 0, "back": 1, "front": -1}[cull]
    objects = Objects(np.array([0, len(face_numbers)], np.int64), np.array([turn], np.int8))
    sign = -1.0 if depth == "standard" else 1.0
    depth_format = make_ndc_format(quality.depth_format, sign)
    try:
        coverage = visibility_pass.run_visibility(
            visibility_pass.Drawable(
                positions, face_numbers, objects, depth_format.coefficients, viewport
            ),
            visibility_pass.VisibilityOptions(
                depth_type=depth_format.kind, precision=quality.precision
            ),
            workers,
            lambda _: None,
        )
    finally:
        workers.close()
    is_affine = quality.interpolation == "affine"
    geometry = visibility_pass.make_geometry(
        face_numbers, coverage.screen, positions, viewport, is_affine
    )
    return RasterizedFaces(coverage, geometry, len(positions), listed, sign, depth_format)


def _clip_array(value: Any) -> NDArray[np.float64]:
    """Return clip positions as the kernels take them, or raise ``ValueError``."""
    positions = np.array(number_array("clip_positions", value, "uif"), order="C")
    if positions.ndim != 2 or positions.shape[1] != 4:
        raise ValueError(f"clip_positions must have shape (V, 4), got {positions.shape}")
    return positions
