"""Decide about fog, tone mapping and the sky behind all faces, and make what kernels read of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.kernels import fogging, records, tone_mapping
from rasterjit.plan_boxes import Boxes
from rasterjit.scene.camera import Camera, clip_from_relative
from rasterjit.scene.environment import Environment
from rasterjit.scene.fog import Fog
from rasterjit.scene.scene import Scene
from rasterjit.scene.tone_map import ToneMap

FOG_MODES = {
    "linear": fogging.LINEAR,
    "exp": fogging.EXPONENTIAL,
    "exp2": fogging.EXPONENTIAL_SQUARED,
}

CURVES = {
    "none": tone_mapping.NONE,
    "reinhard": tone_mapping.REINHARD,
    "aces": tone_mapping.ACES,
    "neutral": tone_mapping.NEUTRAL,
}

HALVINGS = 1.4426950408889634
"""One over ln 2: the binary exponent of e."""

SQUARED_HALVINGS = 1.2011224087864498
"""Its square root: a density that is squared takes one of two equal factors."""

DISTANCE_ROUNDING = 1.0 + 2.0**-20
"""Factor on the farthest distance, for the rounding of positions and distances in float32."""


def check_atmosphere(scene: Scene) -> None:
    """Raise ``ValueError`` if an environment, fog or tone map of the scene is something else."""
    for name, kind in (("environment", Environment), ("fog", Fog), ("tone_map", ToneMap)):
        value = getattr(scene, name)
        if value is not None and not isinstance(value, kind):
            raise ValueError(f"scene.{name} must be {kind.__name__} or None, got {value!r}")


def is_fog_in_reach(fog: Fog | None, boxes: Boxes) -> bool:
    """Tell whether fog may cover anything: not if it is empty or begins beyond all in view."""
    if fog is None or fog.density == 0.0:
        return False
    if fog.mode != "linear" or fog.start == 0.0:
        return True
    return boxes.farthest() * DISTANCE_ROUNDING > fog.start


def fog_record(
    fog: Fog, camera: Camera, has_flat: bool = False, powers: str = "polynomial"
) -> records.Fog:
    """
    Return fog as the kernels read it, for a scene with or without objects shaded flat.

    ``powers`` are what ``Quality.math`` says.
    """
    halvings = SQUARED_HALVINGS if fog.mode == "exp2" else HALVINGS
    start, end = fog.start or 0.0, fog.end or 0.0
    above = float(camera.eye_position()[1]) - (fog.height or 0.0)
    return records.Fog(
        FOG_MODES[fog.mode],
        np.array(fog.color, np.float32),
        np.float32(end),
        np.float32(1.0 / (end - start) if end > start else 0.0),
        np.float32((fog.density or 0.0) * halvings),
        np.float32(above),
        np.float32((fog.falloff or 0.0) * HALVINGS),
        np.int64(1) if has_flat else None,
        np.int64(1) if powers == "library" and fog.mode != "linear" else None,
    )


def tone_record(tone_map: ToneMap, powers: str = "polynomial") -> records.ToneMap:
    """
    Return a tone map as the kernels read it; ``powers`` are what ``Quality.math`` says.

    Whole powers of two are exact anyway.
    """
    asks = powers == "library" and not float(tone_map.exposure).is_integer()
    return records.ToneMap(
        CURVES[tone_map.curve],
        np.float32(tone_map.exposure),
        np.float32(1.0 / (tone_map.white * tone_map.white)),
        np.int64(1) if asks else None,
    )


def background_rays(camera: Camera, size: tuple[int, int]) -> NDArray[np.float64]:
    """
    Return the directions that a camera looks along, (3, 3) float64, in world axes.

    Row 0 is the direction at the middle of the frame, rows 1 and 2 its change with x and y in
    normalized device coordinates; see ``kernels.backgrounds``. Only their ratios matter.
    """
    clip = clip_from_relative(camera, size)
    rows = clip[:, :3] / np.abs(clip[[0, 1, 3], :3]).max()
    x, y, depth, w = rows.tolist()
    middle = _cross(x, y)
    if any(w):
        rays = [middle, _cross(y, w), _cross(w, x)]
        ahead = w
    else:
        # A parallel projection looks one way, the way that depth grows.
        rays = [middle, [0.0] * 3, [0.0] * 3]
        ahead = depth
    toward = (ahead[0] * middle[0] + ahead[1] * middle[1]) + ahead[2] * middle[2]
    return np.array(rays) * math.copysign(1.0, toward)


def _cross(a: Any, b: Any) -> list[float]:
    """Return the cross product."""
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
