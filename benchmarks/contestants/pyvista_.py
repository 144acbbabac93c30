"""
PyVista's off-screen path for the whole job: a ``Plotter`` that holds the mesh, its window's pixels.

VTK draws with OpenGL, here Mesa's llvmpipe (``apt-get install libegl1 libgl1-mesa-dri libgl1``).
Anti-aliasing and lighting are off, vertex colours stay linear, instances are joined into one mesh
beforehand. The plotter and what it has uploaded stay between frames; a frame is ``render`` and the
window's pixels in a NumPy array.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared, opengl
from benchmarks.contestants.needs import EDGE_COLOR, refusal
from benchmarks.contestants.screen import all_faces, matrices, model_vertices
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "PyVista (VTK)"

UNABLE = {
    "lighting": "its highlight is Phong's, not Blinn's",
    "lines": "it draws meshes, and lines as a part of them",
}


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    if find_spec("pyvista") is None:
        return 'the package pyvista is not installed (pip install ".[bench-large]")'
    if find_spec("moderngl") is None:
        return None
    return opengl.available()


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return opengl.environment(threads)


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    return refusal(scene, UNABLE, draws=("values",))


def alike(scene: Scene) -> tuple[float, float]:
    """Return the shares of pixels alike that its rules allow for: those of OpenGL."""
    if not isinstance(scene, LineScene) and scene.mode == "edges":
        return 0.85, 0.0
    return opengl.alike(scene)


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        raise ValueError(UNABLE["lines"])
    return Plot(scene)


class Plot:
    """A plotter without decoration that holds one mesh."""

    def __init__(self, scene: TriangleScene) -> None:
        import pyvista
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        self._size = scene.size
        self._plotter = pyvista.Plotter(off_screen=True, window_size=list(scene.size))
        self._plotter.set_background("black")
        self._plotter.disable_anti_aliasing()
        self._plotter.render_window.SetMultiSamples(0)
        mesh = pyvista.PolyData.from_regular_faces(model_vertices(scene), all_faces(scene))
        look: dict[str, Any] = {"color": [c / 255 for c in EDGE_COLOR[:3]]}
        if scene.colors is not None and scene.mode == "fill":
            count = 1 if scene.instances is None else len(scene.instances)
            mesh["rgb"] = np.tile(scene.colors[:, :3], (count, 1))
            look = {"scalars": "rgb", "rgb": True}
        if scene.values is not None:
            mesh["values"] = scene.values
            look = {"scalars": "values", "clim": (0.0, 1.0), "cmap": linear_map(scene.texture[0])}
        self._plotter.add_mesh(
            mesh,
            lighting=False,
            style="wireframe" if scene.mode == "edges" else "surface",
            culling=scene.cull if scene.cull != "none" else None,
            show_scalar_bar=False,
            reset_camera=False,
            render=False,
            **look,
        )
        self._matrices = [as_vtk(matrix) for matrix in matrices(scene)]
        camera = self._plotter.camera
        camera.position, camera.focal_point, camera.up = (0, 0, 0), (0, 0, -1), (0, 1, 0)
        camera.SetExplicitProjectionTransformMatrix(self._matrices[0])
        camera.SetUseExplicitProjectionTransformMatrix(True)
        self._bytes = vtkUnsignedCharArray()
        self._plotter.show(auto_close=False, interactive=False)

    def draw(self) -> None:
        """Render; all views, each read back."""
        for matrix in self._matrices:
            self._plotter.camera.SetExplicitProjectionTransformMatrix(matrix)
            self._plotter.render()
            self._plotter.render_window.WaitForCompletion()
            if len(self._matrices) > 1:
                self.read()

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the last picture, RGB, bottom row first."""
        from vtkmodules.util.numpy_support import vtk_to_numpy

        width, height = self._size
        window = self._plotter.render_window
        window.GetPixelData(0, 0, width - 1, height - 1, 0, self._bytes, 0)
        pixels = vtk_to_numpy(self._bytes)
        return {"color": pixels.reshape(height, width, 3)}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared; the depth buffer, 1 where nothing is, tells what is covered."""
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkFloatArray

        width, height = self._size
        depth = vtkFloatArray()
        self._plotter.render_window.GetZbufferData(0, 0, width - 1, height - 1, depth)
        covered = vtk_to_numpy(depth).reshape(height, width)[::-1] < 1.0
        return {"covered": covered, "color_linear": self.read()["color"][::-1].copy()}


def linear_map(codes: NDArray[np.uint8]) -> Any:
    """Return colours, (N, 3) sRGB, as a map of linear light, which all pictures are compared in."""
    from matplotlib.colors import ListedColormap

    encoded = codes / 255.0
    low, high = encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4
    return ListedColormap(np.where(encoded <= 0.04045, low, high))


def as_vtk(matrix: NDArray[np.float64]) -> Any:
    """Return a matrix as VTK holds it."""
    from vtkmodules.vtkCommonMath import vtkMatrix4x4

    made = vtkMatrix4x4()
    made.DeepCopy(matrix.ravel().tolist())
    return made
