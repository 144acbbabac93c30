"""
Who draws, each in a file of its own with the same five names.

``NAME``
    What the table calls it.
``available()``
    ``None``, or the reason why it cannot draw here.
``draws(scene)``
    ``None``, or the reason why it cannot draw this scene.
``environment(threads)``
    Environment variables that its process must start with.
``prepare(scene, threads)``
    A ``Prepared``: the scene uploaded, everything compiled that can be.

Where a contestant has other rules for what a pixel shows, it has a sixth:

``alike(scene)``
    What its pictures share with the reference at least: the share of all pixels that both cover or
    both do not, and the share of the pixels covered by both whose colours are alike. Maybe a third:
    the share of either's covered pixels within one pixel of which the other covers one.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any, Protocol

from numpy.typing import NDArray

from benchmarks.scenes import Scene

MODULES = {
    "rasterjit": "rasterjit_",
    "rasterjit_batch": "rasterjit_batch",
    "float_edges": "float_edges",
    "single_vertices": "single_vertices",
    "standard_depth": "standard_depth",
    "checked_bounds": "checked_bounds",
    "opengl": "opengl",
    "opengl_color": "opengl_color",
    "tinydisplay": "tinydisplay",
    "lavapipe": "lavapipe",
    "embreex": "embreex_",
    "datashader": "datashader_",
    "opencv": "opencv",
    "pillow": "pillow",
    "scikit_image": "scikit_image",
    "pyvista": "pyvista_",
    "open3d": "open3d_",
    "trimesh": "trimesh_offscreen",
    "numpy": "numpy_",
    "pure_python": "pure_python",
    "full_screen": "full_screen",
}
"""The key of a contestant, and its file."""

OF_EFFECTS = {
    "rasterjit_effects": "rasterjit_effects",
    "opengl_effects": "opengl_effects",
    "opengl_sorted": "opengl_sorted",
}
"""Those who draw an `benchmarks.effects_scenes.EffectScene`, and nothing else."""


class Prepared(Protocol):
    """A scene that is ready to be drawn again and again."""

    def draw(self) -> None:
        """
        Clear and draw; return when the picture is complete.

        Of a scene with views all pictures are drawn, and read back, one after the other.
        """

    def read(self) -> dict[str, NDArray[Any]]:
        """
        Return the picture in NumPy arrays, row 0 on top or at the bottom as ``draw`` left it.

        Of the keys ``face_id`` (H, W) int32, ``color`` (H, W, 3|4) uint8, ``depth`` (H, W), or
        what else the contestant draws. Of a scene with views it is the last one.
        """

    def picture(self) -> dict[str, NDArray[Any]]:
        """
        Return the same for comparing, row 0 on top; not timed.

        ``covered`` (H, W) bool and, if known, ``face_id`` (H, W), -1 where nothing is, and
        ``color_linear`` (H, W, 3) uint8, linear light.
        """


class Contestant(Protocol):
    """What a contestant's module offers."""

    NAME: str

    def available(self) -> str | None:
        """Return ``None``, or the reason why it cannot draw here."""

    def draws(self, scene: Scene) -> str | None:
        """Return ``None``, or the reason why it cannot draw this scene."""

    def environment(self, threads: int) -> dict[str, str]:
        """Return the environment variables that its process must start with."""

    def prepare(self, scene: Scene, threads: int) -> Prepared:
        """Upload the scene."""


def contestant(key: str) -> ModuleType:
    """Return a contestant's module; its own packages are imported when it prepares."""
    return import_module(f"benchmarks.contestants.{(MODULES | OF_EFFECTS)[key]}")
