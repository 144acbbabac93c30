"""Fill the outputs ``motion`` and ``motion_visible``: visible points in an earlier view."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs import motion_stage
from rasterjit.pipeline.records import Geometry
from rasterjit.runtime.threads import Workers, fill_rows
from rasterjit.scene.arrays import Bool, Float32, Float64, Int32, Int64
from rasterjit.scene.camera import Camera
from rasterjit.scene.node import Node
from rasterjit.survey.cache import Shapes
from rasterjit.survey.object_transforms import ViewTransforms


class Moment(NamedTuple):
    """The vertices of all objects at a time, and their matrices to the screen."""

    positions: Float64
    """(V, 3), model space."""
    faces: Int32
    """(F, 3), vertex numbers."""
    matrices: Float64
    """(O, 5, 4), see ``motion_stage``."""


class PreviousFaces(NamedTuple):
    """The faces that were visible in the previous view."""

    face_id: Int32
    """(H, W), -1 where nothing was."""
    culled_windings: NDArray[np.int8]
    """(O,), winding sign of the faces that were not drawn; see ``records.Objects``."""


class MomentPair(NamedTuple):
    """The moments of a frame and of its earlier view."""

    now: Moment
    before: Moment
    previous_faces: PreviousFaces | None
    """``None`` if ``motion_visible`` is not requested."""


def check_same_objects(now: Sequence[Node], before: Sequence[Node]) -> None:
    """Raise ``ValueError`` unless two scenes have as many objects, each with as many faces."""
    if len(now) != len(before):
        raise ValueError(
            f"previous.scene must have the same objects as the scene, {len(now)}; got {len(before)}"
        )
    for number, (new, old) in enumerate(zip(now, before, strict=True)):
        if len(new.mesh.faces) != len(old.mesh.faces):
            raise ValueError(
                f"previous.scene must have the same faces as the scene, {len(new.mesh.faces)} of "
                f"object {number} ({new.name!r}); got {len(old.mesh.faces)}"
            )


def make_moment(
    shapes: Shapes, now: Shapes, views: ViewTransforms, camera: Camera, size: tuple[int, int]
) -> Moment:
    """Return the vertices and matrices for a camera, with faces in the order of ``now``."""
    matrices = _make_screen_matrices(views, camera, size)
    return Moment(shapes.arrays.positions, shapes.rotate_like(now), matrices)


def _make_screen_matrices(views: ViewTransforms, camera: Camera, size: tuple[int, int]) -> Float64:
    """Return the matrices from objects to pixels and depth, (O, 5, 4); see ``motion_stage``."""
    x, y, z, w = views.clip_from_relative
    (width, height), (c0, c1, c2) = size, camera.depth_coefficients()
    # c0, a constant, stands in the column of translations.
    stored_depth = c1 * z + c2 * w + np.array([0.0, 0.0, 0.0, c0])
    rows = np.array([(x + w) * (0.5 * width), (w - y) * (0.5 * height), z, w, stored_depth])
    relative_from_model = views.relative_from_model
    matrices = np.zeros((len(relative_from_model), 5, 4))
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(4):
            matrices += rows[:, k, np.newaxis] * relative_from_model[:, np.newaxis, k]
    return matrices


def fill_motion(
    face_id: Int32, geometry: Geometry, face_starts: Int64, moments: MomentPair, workers: Workers
) -> Float32:
    """Return the motion of each pixel's point, (H, W, 2), pixels; NaN for the background."""
    motion = workers.memory.empty((*face_id.shape, 2), np.float32)
    now, before = moments.now, moments.before
    arguments = (
        geometry, face_starts, (now.positions, now.matrices),
        (before.positions, before.matrices, before.faces), motion,
    )  # fmt: skip
    fill_rows(motion_stage.fill_motion, face_id, arguments, workers)
    return motion


def fill_motion_visible(
    face_id: Int32,
    geometry: Geometry,
    face_starts: Int64,
    before: Moment,
    previous_faces: PreviousFaces,
    workers: Workers,
) -> Bool:
    """Return whether each pixel's point was visible before, (H, W); False for the background."""
    visible = workers.memory.empty(face_id.shape, np.bool_)
    previous_view = before.positions, before.matrices, before.faces, *previous_faces
    arguments = geometry, face_starts, previous_view, visible.view(np.uint8)
    fill_rows(motion_stage.fill_motion_visible, face_id, arguments, workers)
    return visible
