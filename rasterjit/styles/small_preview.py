"""Render small previews of scenes and meshes, for notebooks."""

from __future__ import annotations

from rasterjit.outputs.frame import Frame
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import Scene
from rasterjit.styles import studio

SIZE = (320, 240)
"""Size of the picture, pixels."""


def preview(what: Scene | Mesh) -> Frame | None:
    """
    Return a small picture of a scene or mesh, in the style `studio`.

    Parameters
    ----------
    what : Scene or Mesh

    Returns
    -------
    Frame or None
        None if nothing is visible or the scene cannot be drawn: a notebook then shows ``repr``.
    """
    try:
        frame = studio(what).render(size=SIZE)
    except (ValueError, MemoryError):
        return None
    if frame.plan.facts.finds_faces and frame.stats.pixels_covered == 0:
        return None
    return frame
