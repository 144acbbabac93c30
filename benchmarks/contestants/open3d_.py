"""
Open3D's off-screen path for the whole job: an ``OffscreenRenderer`` and the image it gives.

Its engine, Filament, draws with Vulkan, here Mesa's lavapipe. Needs ``apt-get install
mesa-vulkan-drivers libegl1 libgl1 libusb-1.0-0``, and is in no extra of RasterJIT: it is 900 MB
large and brings Dash, whose pytest plugin warns. Anti-aliasing, post-processing, shadows and light
are off. The renderer and what it has uploaded stay between frames; drawing and reading are one call
there, which counts as drawing. Filament starts threads of its own whatever is asked for.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import refusal
from benchmarks.contestants.screen import all_faces, matrices, model_vertices
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "Open3D (Filament)"

UNABLE = {
    "lighting": "its materials are physically based",
    "lines": "it draws meshes",
    "edges": "it draws no edges of meshes",
    "culling": "its unlit material draws back faces",
    "faces": "without vertex colours its pictures say nothing",
}


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    if find_spec("open3d") is None:
        return "the package open3d is not installed (pip install open3d)"
    try:
        import_open3d()
    except ImportError as error:  # names the shared library that is missing
        return f"open3d cannot be imported: {error}"
    return None


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {
        "LP_NUM_THREADS": "0" if threads == 1 else str(threads),
        "EGL_PLATFORM": "surfaceless",
        "LIBGL_ALWAYS_SOFTWARE": "true",
    }


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    reason = refusal(scene, UNABLE)
    if reason is None and not isinstance(scene, LineScene):
        is_seen_from_a_point = scene.clip_from_model[3, :3].any()
        reason = None if is_seen_from_a_point else "its camera has to have an eye"
    return reason


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        raise ValueError(UNABLE["lines"])
    return Rendering(scene)


def import_open3d() -> Any:
    """Return the package, which looks for a display unless it is told not to."""
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")
    import open3d

    return open3d


class Rendering:
    """A renderer that holds one mesh; a second one in the same process ends it."""

    def __init__(self, scene: TriangleScene) -> None:
        open3d = import_open3d()
        rendering = open3d.visualization.rendering
        self._size = scene.size
        self._renderer = rendering.OffscreenRenderer(*scene.size)
        mesh = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(model_vertices(scene).astype(np.float64)),
            open3d.utility.Vector3iVector(all_faces(scene)),
        )
        count = 1 if scene.instances is None else len(scene.instances)
        colors = np.tile(scene.colors[:, :3] / 255.0, (count, 1))
        mesh.vertex_colors = open3d.utility.Vector3dVector(colors)
        material = rendering.MaterialRecord()
        material.shader = "defaultUnlit"
        held = self._renderer.scene
        held.add_geometry("mesh", mesh, material)
        held.set_background(np.array([0.0, 0.0, 0.0, 0.0]))
        held.view.set_antialiasing(False)
        held.view.set_post_processing(False)
        held.view.set_shadowing(False)
        self._cameras = [pinhole(matrix, scene.size) for matrix in matrices(scene)]

    def draw(self) -> None:
        """Render all views, each to an image."""
        for intrinsic, extrinsic in self._cameras:
            self._renderer.setup_camera(intrinsic, extrinsic, *self._size)
            self._image = self._renderer.render_to_image()

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the last image, (H, W, 3)."""
        return {"color": np.asarray(self._image)}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared; the depth tells where something is."""
        depth = np.asarray(self._renderer.render_to_depth_image())
        return {"covered": depth < 1.0, "color_linear": self.read()["color"].copy()}


def pinhole(
    clip_from_world: NDArray[np.float64], size: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Take a perspective apart into what a calibrated camera is given by.

    Returns
    -------
    intrinsic : (3, 3) float64
        Focal lengths and principal point, pixels.
    extrinsic : (4, 4) float64
        Camera from world; y down, z forward.
    """
    half = 0.5 * np.array(size)
    scale = np.linalg.norm(clip_from_world[:2, :3], axis=1)
    intrinsic = np.diag([*(scale * half), 1.0])
    intrinsic[:2, 2] = half
    extrinsic = np.eye(4)
    extrinsic[0] = clip_from_world[0] / scale[0]
    extrinsic[1] = -clip_from_world[1] / scale[1]
    extrinsic[2] = clip_from_world[3]
    return intrinsic, extrinsic
