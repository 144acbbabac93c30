"""Choose the exposure of a picture from what it shows, as a light meter does."""

from __future__ import annotations

import math

import numpy as np

from rasterjit.rendering.renderer import render
from rasterjit.rendering.view_warnings import STRONG
from rasterjit.scene.camera import Camera
from rasterjit.scene.scene import Scene
from rasterjit.scene.tone_map import MOST_STOPS
from rasterjit.scene.warning import EACH_FRAME, told_elsewhere
from rasterjit.survey.lights import most_light

SIZE = (96, 96)
"""Of the picture that is looked at, pixels."""

BRIGHT_SHARE, SHOWN = 0.95, 0.8
"""Share of what is seen that is at most as bright, and the light, linear, that it is shown at."""


QUARTER_BELOW, THREE_QUARTERS_BELOW = 0.8408964152537145, 0.5946035575013605
"""2 to the power of -1/4 and of -3/4."""


def metered_exposure(scene: Scene, camera: Camera | None) -> float:
    """
    Return the exposure, stops, that strong lights of a scene call for; 0 if they are not.

    Parameters
    ----------
    scene : Scene
        Without a tone map; whose lights are its own.
    camera : Camera, optional
        Default: as `rasterjit.render` has it.
    """
    if most_light(scene.lights, scene.environment) <= STRONG:
        return 0.0
    with told_elsewhere(EACH_FRAME):
        frame = render(scene, camera, size=SIZE, outputs=("linear",), background="transparent")
    seen = frame.linear[frame.linear[:, :, 3] > 0.5]
    if not len(seen):
        return 0.0
    levels = np.sort(seen[:, :3].max(axis=1))
    level = float(levels[int(BRIGHT_SHARE * (len(levels) - 1))])
    if level <= STRONG:
        return 0.0
    # To half a stop: with no logarithm, which may differ from machine to machine.
    share, stops = math.frexp(level / SHOWN)
    lacking = 0.0 if share >= QUARTER_BELOW else 0.5 if share >= THREE_QUARTERS_BELOW else 1.0
    return max(lacking - stops, -MOST_STOPS)
