"""
trimesh's off-screen path for the whole job: ``Scene.save_image``, from a scene to a PNG's bytes.

It opens a hidden window with pyglet, so it needs a display (``xvfb-run`` starts one) and
``apt-get install xvfb libgl1 libglu1-mesa``. The window is opened, the mesh uploaded, drawn
with trimesh's own lights, read back, packed and unpacked at every picture: there is no other way
in, and that is the whole job. Of its lit picture only the coverage is compared.
"""

from __future__ import annotations

import io
import math
import os
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import refusal
from benchmarks.contestants.open3d_ import pinhole
from benchmarks.contestants.screen import all_faces, model_vertices
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "trimesh (pyglet)"

UNABLE = {
    "lighting": "its lights are its own",
    "lines": "it draws meshes",
    "edges": "it draws no edges alone",
    "views": "it opens a window for every picture",
}

BACKGROUND = (0, 0, 0, 255)
SQUARE = 1e-6
"""How far the sides of a pixel may differ, as a share: more than the rounding of a matrix."""


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    if find_spec("trimesh") is None:
        return "the package trimesh is not installed"
    if find_spec("pyglet") is None:
        return 'the package pyglet is not installed (pip install ".[bench]")'
    if not os.environ.get("DISPLAY"):
        return "no display: DISPLAY is not set, and trimesh draws in a hidden window"
    try:
        from trimesh.viewer import windowed  # noqa: F401
    except Exception as error:  # pyglet's own types, for a display it cannot connect to
        return f"pyglet opens no window: {error}"
    return None


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {
        "LP_NUM_THREADS": "0" if threads == 1 else str(threads),
        "LIBGL_ALWAYS_SOFTWARE": "true",
    }


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    reason = refusal(scene, UNABLE)
    if reason is not None or isinstance(scene, LineScene):
        return reason
    if not scene.clip_from_model[3, :3].any():
        return "its camera has to have an eye"
    intrinsic, _ = pinhole(scene.clip_from_model, scene.size)
    is_square = math.isclose(intrinsic[0, 0], intrinsic[1, 1], rel_tol=SQUARE)
    return None if is_square else "its pixels have to be square"


def alike(scene: Scene) -> tuple[float, ...]:
    """
    Return the shares of pixels alike that its rules allow for: multisampled borders.

    Small instances are nearly all border; what is covered is still next to what should be.
    """
    if isinstance(scene, TriangleScene) and scene.instances is not None:
        return 0.93, 0.0, 0.999
    return 0.98, 0.0


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        raise ValueError(UNABLE["lines"])
    return Picture(scene)


class Picture:
    """A ``trimesh.Scene`` of one mesh."""

    def __init__(self, scene: TriangleScene) -> None:
        import trimesh

        count = 1 if scene.instances is None else len(scene.instances)
        colors = None if scene.colors is None else np.tile(scene.colors, (count, 1))
        mesh = trimesh.Trimesh(
            model_vertices(scene), all_faces(scene), vertex_colors=colors, process=False
        )
        intrinsic, extrinsic = pinhole(scene.clip_from_model, scene.size)
        halves = np.degrees(np.arctan2(scene.size, 2.0 * np.diag(intrinsic)[:2]))
        near, far = depth_range(scene.clip_from_model)
        camera = trimesh.scene.Camera(
            resolution=scene.size, fov=2.0 * halves, z_near=near, z_far=far
        )
        world_from_view = np.linalg.inv(np.diag([1.0, -1.0, -1.0, 1.0]) @ extrinsic)
        self._scene = trimesh.Scene(mesh, camera=camera, camera_transform=world_from_view)
        self._size = scene.size
        self._flags = {"cull": scene.cull == "back"}

    def draw(self) -> None:
        """Open a window, draw, and pack the picture."""
        self._png = self._scene.save_image(
            resolution=self._size, visible=False, background=BACKGROUND, flags=self._flags
        )

    def read(self) -> dict[str, NDArray[Any]]:
        """Unpack the picture."""
        from PIL import Image

        return {"color": np.asarray(Image.open(io.BytesIO(self._png)))}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return {"covered": self.read()["color"][:, :, :3].any(axis=2)}


def depth_range(clip_from_world: NDArray[np.float64]) -> tuple[float, float]:
    """Return the distances of the near and far plane of a perspective."""
    forward = clip_from_world[3, :3]
    slope = float(clip_from_world[2, :3] @ forward)
    offset = float(clip_from_world[2, 3] - slope * clip_from_world[3, 3])
    return -offset / (slope + 1.0), math.inf if slope == 1.0 else -offset / (slope - 1.0)
