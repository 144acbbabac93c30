"""
Draw a cloud of points with one library, and say how long each picture takes: for `points`.

``python point_worker.py LIBRARY POINTS THREADS``: prints ``ready`` or why not, then a number of
seconds and of covered pixels for each line that it reads. It needs no RasterJIT but to draw with
it, so that another environment's Python may run it.

All draw the same points of one pixel each, depth-tested, each of a colour of its own, 1920 by 1080
pixels, and end with the picture in a NumPy array. What does not change from one picture to the next
is uploaded before. datashader draws in two dimensions: it is given places on the screen, and keeps
the least depth, without colours.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

SIZE = 1920, 1080
EYE = (0.5, 0.3, 3.2)
FOV = 45.0
NEAR = 0.1

Draw = Callable[[], Any]
"""Draws a picture and returns it: red (H, W), 255 where nothing is, or depth, infinite there."""


def cloud(count: int) -> tuple[Any, Any]:
    """Return positions, (N, 3) float64, in a cube, and colours, (N, 3) uint8."""
    random = np.random.default_rng(1)
    return random.uniform(-1, 1, (count, 3)), random.integers(0, 250, (count, 3)).astype(np.uint8)


def view_from_world() -> Any:
    """Return the matrix of the camera, which looks from the eye to the origin."""
    eye = np.array(EYE)
    back = eye / np.linalg.norm(eye)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(back, right), back
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return matrix


def clip_from_view(far: float = 100.0) -> Any:
    """Return the perspective matrix."""
    focal = 1.0 / math.tan(math.radians(FOV) / 2.0)
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = focal * SIZE[1] / SIZE[0], focal
    matrix[2, 2], matrix[2, 3] = (far + NEAR) / (NEAR - far), 2.0 * far * NEAR / (NEAR - far)
    matrix[3, 2] = -1.0
    return matrix


def rasterjit(count: int, threads: int) -> Draw:
    """Draw with RasterJIT."""
    import rasterjit as rj

    positions, colors = cloud(count)
    points = rj.Points(positions, colors=colors, size=1.0)
    camera = rj.PerspectiveCamera(EYE, (0, 0, 0), (0, 1, 0), FOV, NEAR, 100.0)
    renderer = rj.Renderer(SIZE, threads=threads)

    def draw() -> Any:
        frame = renderer.render(points, camera, background="white")
        return frame.color[..., 0]

    return draw


def llvmpipe(count: int, threads: int) -> Draw:
    """Draw with OpenGL as Mesa does it on a CPU."""
    import moderngl

    context = moderngl.create_standalone_context(backend="egl", require=330)
    if "llvmpipe" not in context.info["GL_RENDERER"]:
        raise RuntimeError(f"OpenGL is {context.info['GL_RENDERER']}, not llvmpipe")
    program = context.program(
        """
        #version 330
        uniform mat4 matrix;
        in vec3 position;
        in vec3 color;
        flat out vec3 shown;
        void main() { gl_Position = matrix * vec4(position, 1.0); shown = color; }
        """,
        """
        #version 330
        flat in vec3 shown;
        out vec4 pixel;
        void main() { pixel = vec4(shown, 1.0); }
        """,
    )
    positions, colors = cloud(count)
    matrix = (clip_from_view() @ view_from_world()).T
    program["matrix"].write(np.ascontiguousarray(matrix, np.float32).tobytes())
    array = context.vertex_array(
        program,
        [
            (context.buffer(positions.astype(np.float32).tobytes()), "3f", "position"),
            (context.buffer(colors.tobytes()), "3f1", "color"),
        ],
    )
    target = context.framebuffer([context.renderbuffer(SIZE, 4)], context.depth_renderbuffer(SIZE))
    target.use()
    context.enable(moderngl.DEPTH_TEST)

    def draw() -> Any:
        target.clear(1.0, 1.0, 1.0, 1.0)
        array.render(moderngl.POINTS)
        picture = np.frombuffer(target.read(components=4), np.uint8).reshape(*SIZE[::-1], 4)
        return picture[..., 0]

    return draw


def datashader(count: int, threads: int) -> Draw:
    """Draw with datashader, from places on the screen."""
    import datashader as ds
    import pandas

    positions, _ = cloud(count)
    clip = np.column_stack([positions, np.ones(count)]) @ (clip_from_view() @ view_from_world()).T
    width, height = SIZE
    frame = pandas.DataFrame({
        "x": (clip[:, 0] / clip[:, 3] + 1.0) * width / 2.0,
        "y": (clip[:, 1] / clip[:, 3] + 1.0) * height / 2.0,
        "depth": clip[:, 3],
    })  # fmt: skip
    canvas = ds.Canvas(width, height, x_range=(0, width), y_range=(0, height))

    def draw() -> Any:
        return canvas.points(frame, "x", "y", ds.min("depth")).to_numpy()

    return draw


def open3d(count: int, threads: int) -> Draw:
    """Draw with Open3D's off-screen renderer."""
    import open3d as o3d

    positions, colors = cloud(count)
    held = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(positions))
    held.colors = o3d.utility.Vector3dVector(colors / 255.0)
    renderer = o3d.visualization.rendering.OffscreenRenderer(*SIZE)
    material = o3d.visualization.rendering.MaterialRecord()
    material.shader, material.point_size = "defaultUnlit", 1.0
    scene = renderer.scene
    scene.add_geometry("points", held, material)
    scene.set_background(np.array([1.0, 1.0, 1.0, 1.0]))
    scene.view.set_antialiasing(False)
    scene.view.set_post_processing(False)
    scene.view.set_shadowing(False)
    renderer.setup_camera(FOV, (0, 0, 0), EYE, (0, 1, 0), NEAR, 100.0)

    def draw() -> Any:
        return np.asarray(renderer.render_to_image())[..., 0]

    return draw


LIBRARIES = {
    "RasterJIT": rasterjit, "llvmpipe": llvmpipe, "datashader": datashader, "Open3D": open3d,
}  # fmt: skip


def main() -> None:
    """Make the cloud and wait for what is read."""
    name, count, threads = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    os.environ["LP_NUM_THREADS"] = "0" if threads == 1 else str(threads)
    os.environ |= {"EGL_PLATFORM": "surfaceless", "LIBGL_ALWAYS_SOFTWARE": "true"}
    if threads == 1:
        os.environ |= {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        draw = LIBRARIES[name](count, threads)
        draw()
    except (ImportError, RuntimeError, OSError) as error:
        print(json.dumps({"missing": f"{type(error).__name__}: {error}"}), flush=True)
        return
    print(json.dumps({"missing": ""}), flush=True)
    for _ in sys.stdin:
        draw()
        start = time.perf_counter()
        picture = draw()
        seconds = time.perf_counter() - start
        covered = int(np.count_nonzero(picture < 255))
        print(json.dumps({"seconds": seconds, "pixels": covered}), flush=True)


if __name__ == "__main__":
    main()
