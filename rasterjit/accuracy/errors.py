"""How far a picture and its buffers are from those of the reference."""

from __future__ import annotations

import importlib.util
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.accuracy.results import REFERENCE_SAMPLES, Errors
from rasterjit.outputs.frame import Frame
from rasterjit.rendering.quality_selection import CODES, light_of, root_mean_square
from rasterjit.scene.scene import Scene

PICTURE_OUTPUTS = ("color", "linear")
"""What the colour of two frames is compared by."""


class ReferenceFrame(NamedTuple):
    """What frames are compared with."""

    picture: Frame
    """Its colour and linear light."""
    buffers: Frame
    """Its depth and faces, and texture coordinates where the scene has some."""
    texels: NDArray[np.float64]
    """Of each object, from `texels_of`."""
    face_starts: NDArray[np.int64]
    """First face of each object, (O+1,)."""
    samples: int = REFERENCE_SAMPLES
    seconds: float = 0.0
    """What its pictures took."""
    error: float = 0.0
    """How far it is from one of all samples, about."""


def reference_of(scene: Scene, picture: Frame, buffers: Frame) -> ReferenceFrame:
    """Return the reference of a scene, given the picture and the frame that holds its buffers."""
    counts = [0] + [len(node.mesh.faces) for node in scene.nodes]
    return ReferenceFrame(picture, buffers, texels_of(scene), np.cumsum(counts))


def texels_of(scene: Scene) -> NDArray[np.float64]:
    """Return the texels that a unit of u and of v spans on each object, (O, 2); NaN on none."""
    rows = np.full((len(scene.nodes), 2), np.nan)
    for row, node in zip(rows, scene.nodes, strict=True):
        texture = node.mesh.material.base_color_texture
        # Output uv is the first set of coordinates.
        if texture is not None and texture.uv_set == 0 and node.mesh.uv is not None:
            height, width, _ = texture.image.shape
            row[:] = np.abs(texture.scale) * (width, height)
    return rows


def buffers_of(scene: Scene) -> tuple[str, ...]:
    """Return the outputs besides colour that frames of a scene are compared by."""
    is_laid = any(node.mesh.uv is not None for node in scene.nodes)
    return ("depth", "face_id", "uv") if is_laid else ("depth", "face_id")


def compare(frame: Frame, reference: ReferenceFrame) -> tuple[Errors, NDArray[np.float32]]:
    """
    Return the errors of a frame.

    Parameters
    ----------
    frame : Frame
        With the outputs ``PICTURE_OUTPUTS`` and those of `buffers_of`.
    reference : ReferenceFrame

    Returns
    -------
    Errors
        Without FLIP, which takes longer than all else: `with_flip` adds it.
    (H, W) float32
        Largest difference of the linear channels at each pixel.
    """
    difference = np.abs(light_of(frame).astype(np.float64) - light_of(reference.picture))
    rmse = root_mean_square(difference)
    faces, true_faces = frame.face_id, reference.buffers.face_id
    is_same = (faces == true_faces) & (faces >= 0)
    ulp, units = None, None
    if "depth" in frame.plan.outputs:
        ulp, units = _depth_errors(frame.depth[is_same], reference.buffers.depth[is_same])
    errors = Errors(
        rmse=rmse,
        largest=float(difference.max()),
        psnr=-20.0 * math.log10(rmse) if rmse > 0.0 else math.inf,
        flip=None,
        wrong_faces=int(np.count_nonzero(faces != true_faces)),
        depth_ulp=ulp,
        depth_units=units,
        uv_texels=_uv_error(frame, reference, is_same),
    )
    largest = np.maximum(difference[:, :, 0], difference[:, :, 1])
    return errors, np.maximum(largest, difference[:, :, 2]).astype(np.float32)


def with_flip(errors: Errors, color: NDArray[np.uint8], reference: ReferenceFrame) -> Errors:
    """Return errors with the FLIP of a picture, where ``flip-evaluator`` is installed."""
    return errors._replace(flip=mean_flip(reference.picture.color, color))


def _depth_errors(
    depth: NDArray[np.float32], true: NDArray[np.float32]
) -> tuple[float | None, float | None]:
    """Return the largest difference of depths, (n,) each: float32 ulp, and scene units."""
    if len(depth) == 0:
        return None, None
    units = np.abs(depth.astype(np.float64) - true)
    return float((units / np.spacing(np.abs(true))).max()), float(units.max())


def _uv_error(frame: Frame, reference: ReferenceFrame, is_same: NDArray[np.bool_]) -> float | None:
    """Return the largest difference of texture coordinates, texels; None where nothing has any."""
    if "uv" not in frame.plan.outputs:
        return None
    owners = np.searchsorted(reference.face_starts, frame.face_id[is_same], side="right") - 1
    # Caps of sections, which have no texture coordinates, come behind all faces.
    owners = np.minimum(owners, len(reference.texels) - 1)
    difference = np.abs(
        frame.uv[is_same].astype(np.float64) - reference.buffers.uv[is_same]
    ) * np.take(reference.texels, owners, axis=0)
    known = difference[np.isfinite(difference)]
    return float(known.max()) if len(known) else None


def has_flip() -> bool:
    """Tell whether NVIDIA's ``flip-evaluator`` is installed."""
    return importlib.util.find_spec("flip_evaluator") is not None


def mean_flip(true: NDArray[np.uint8], color: NDArray[np.uint8]) -> float | None:
    """
    Return the mean LDR-FLIP error, 0..1, of sRGB pictures, (H, W, 3 or 4); None if not installed.

    References
    ----------
    .. [1] P. Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", Proceedings
       of the ACM on Computer Graphics and Interactive Techniques 3 (2), 2020.
    """
    if not has_flip():
        return None
    import flip_evaluator

    pair = [
        np.ascontiguousarray(picture[:, :, :3], np.float32) / np.float32(CODES)
        for picture in (true, color)
    ]
    # Its own mean is summed by several threads, in any order.
    errors, _, _ = flip_evaluator.evaluate(
        *pair, "LDR", applyMagma=False, computeMeanError=False, parameters={}
    )
    return float(np.mean(errors, dtype=np.float64))
