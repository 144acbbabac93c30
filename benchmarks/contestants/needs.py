"""What a scene asks of those who draw it, in words, and what a contestant that cannot says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.scenes import LineScene, Scene

EDGE_COLOR = (255, 255, 255, 255)
"""RGBA of the edges of a wireframe."""


def needs(scene: Scene) -> list[str]:
    """
    Return what a scene asks for.

    ``lines``; or ``edges``; or ``triangles`` with one of ``faces`` (the number of the face at every
    pixel), ``colors``, ``texture``, ``values`` and ``lighting``; and any of ``instances``,
    ``views``, ``culling``.
    """
    if isinstance(scene, LineScene):
        return ["lines"]
    found = ["triangles"]
    if scene.mode == "edges":
        found = ["edges"]
    elif scene.normals is not None:
        found.append("lighting")
    elif scene.values is not None:
        found.append("values")
    elif scene.texture is not None:
        found.append("texture")
    else:
        found.append("faces" if scene.colors is None else "colors")
    for need, present in (
        ("instances", scene.instances is not None),
        ("views", scene.views is not None),
        ("culling", scene.cull != "none"),
    ):
        if present:
            found.append(need)
    return found


NOT_GIVEN = {
    "texture": "it is given no textures here",
    "values": "it is given no values here",
}
"""What all refuse who do not say that they draw it."""


def refusal(scene: Scene, unable: Mapping[str, str], *, draws: Sequence[str] = ()) -> str | None:
    """
    Return why a scene cannot be drawn; ``None`` if it can.

    Takes what cannot be met, and what of ``NOT_GIVEN`` is.
    """
    unable = {need: why for need, why in NOT_GIVEN.items() if need not in draws} | dict(unable)
    reasons = [unable[need] for need in needs(scene) if need in unable]
    return "; ".join(reasons) if reasons else None


TAKES_PIXELS = {
    "lighting": "no per-pixel lighting",
    "instances": "it takes pixels, not places in a world",
    "views": "it takes pixels, not cameras",
    "culling": "it takes pixels, not faces that may lie behind the eye",
}
"""What those refuse that draw on the screen, in two dimensions."""


def painted_picture(pixels: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return what is compared of faces painted one by one: numbers from 1, or one colour each."""
    if pixels.ndim == 2:
        return {"covered": pixels > 0, "face_id": pixels.astype(np.int32) - 1}
    return {"covered": pixels[:, :, 3] > 0}
