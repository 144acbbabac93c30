"""
RasterJIT by its public names.

Pictures come from a ``Renderer`` that holds threads and mesh between frames, lines from
``Framebuffer.draw_lines``. A single mesh without colours is drawn by the stages of a render up to
the visibility buffer, which holds the face at every pixel and its depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import EDGE_COLOR, needs
from benchmarks.contestants.screen import matrices
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "RasterJIT"

SUBPIXEL_BITS = 8
"""OpenGL's grid in Mesa, and RasterJIT's default."""

NEARER_IS_LESS = (0.0, -1.0, 0.0)
"""Stored depth ``-z / w``: greater is nearer, as OpenGL's ``<`` has it."""


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    return None if find_spec("rasterjit") else "the package rasterjit is not installed"


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def draws(scene: Scene) -> str | None:
    """Return ``None``: it draws every scene."""
    return None


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw, its kernels compiled or loaded by a first picture."""
    if not isinstance(scene, LineScene) and needs(scene) != ["triangles", "faces"]:
        pictures = Pictures(scene, threads)
        pictures.draw_view(0)
        return pictures
    ready = Lines(scene, threads) if isinstance(scene, LineScene) else Visibility(scene, threads)
    ready.draw()
    return ready


def refuses_all_but_colors(scene: Scene) -> str | None:
    """Return ``None`` for a mesh with colours, or that nothing else is drawn."""
    has_colors = not isinstance(scene, LineScene) and "colors" in needs(scene)
    return None if has_colors else "it draws meshes with colours only"


def prepare_picture(scene: Scene, threads: int, **settings: Any) -> Prepared:
    """Return a mesh ready to draw with some settings of the quality, its kernels compiled."""
    if isinstance(scene, LineScene):
        raise ValueError("lines know no quality")
    ready = Pictures(scene, threads, **settings)
    ready.draw()
    return ready


class Visibility:
    """Transform, projection, clipping, set-up, binning and visibility."""

    def __init__(self, scene: TriangleScene, threads: int) -> None:
        from rasterjit.pipeline.records import Objects
        from rasterjit.pipeline.visibility import visibility_pass as drawing
        from rasterjit.runtime import threads as sharing

        self._stages = drawing
        self._positions = scene.positions.astype(np.float64)
        self._faces = scene.faces
        self._vertex_starts = np.array([0, len(scene.positions)], np.int64)
        self._objects = Objects(np.array([0, len(scene.faces)], np.int64), np.zeros(1, np.int8))
        self._relative_from_model = np.eye(4)[np.newaxis]
        self._clip_from_relative = scene.clip_from_model
        self._viewport = drawing.make_viewport(scene.size, SUBPIXEL_BITS)
        self._workers = sharing.Workers(threads)

    def draw(self) -> None:
        """Find the visible face and its depth at every pixel."""
        vertices = self._stages.ModelVertices(
            self._positions,
            self._vertex_starts,
            self._relative_from_model,
            self._clip_from_relative,
        )
        drawable = self._stages.Drawable(
            vertices, self._faces, self._objects, NEARER_IS_LESS, self._viewport
        )
        wanted = self._stages.VisibilityOptions()
        self._coverage = self._stages.run_visibility(
            drawable, wanted, self._workers, lambda stage: None
        )

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the face at every pixel; it is a NumPy array already."""
        return {"face_id": self._coverage.face_id}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        face_id = self._coverage.face_id
        return {"covered": face_id >= 0, "face_id": face_id}


class Pictures:
    """``Renderer.render``, from a scene to sRGB or, without colours, to face numbers."""

    def __init__(self, scene: TriangleScene, threads: int, **settings: Any) -> None:
        import rasterjit as rj

        self._scene = make_scene(scene)
        self._cull = scene.cull
        self._output = "face_id" if "faces" in needs(scene) else "color"
        self._cameras = [rj.MatrixCamera(np.eye(4), matrix) for matrix in matrices(scene)]
        if scene.in_codes:
            settings = {**settings, "texture_mixing": "srgb8"}
        quality = rj.Quality(**settings)
        self._renderer = rj.Renderer(scene.size, quality=quality, threads=threads)
        self._size, self._quality, self._threads = scene.size, quality, threads
        self._together: dict[str, NDArray[Any]] = {}

    def draw(self) -> None:
        """Render every view; a frame's arrays are NumPy's, so that it is read back as well."""
        for number in range(len(self._cameras)):
            self.draw_view(number)

    def draw_view(self, number: int) -> None:
        """Render one view."""
        frame = self._renderer.render(
            self._scene, self._cameras[number], outputs=(self._output,), background="transparent",
            cull=self._cull,
        )  # fmt: skip
        self._picture, self._stats = getattr(frame, self._output), frame.stats

    def draw_batch(self, numbers: Sequence[int]) -> None:
        """Draw some views together, into the arrays of as many before, as peers reuse theirs."""
        import rasterjit as rj

        out = self._together
        if out and len(out[self._output]) != len(numbers):
            out = {}
        self._together = rj.render_batch(
            self._scene, [self._cameras[number] for number in numbers], size=self._size,
            outputs=(self._output,), quality=self._quality, background="transparent",
            cull=self._cull, out=out, threads=self._threads,
        ).arrays()  # fmt: skip

    def stages(self) -> dict[str, float]:
        """Return the seconds of each stage of the last picture."""
        return dict(self._stats.seconds)

    def close(self) -> None:
        """Let the threads go."""
        self._renderer.close()

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the last picture."""
        return {self._output: self._picture}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared: colours decoded from sRGB and, among ourselves, as they are."""
        if self._output == "face_id":
            return {"covered": self._picture >= 0, "face_id": self._picture}
        return {
            "covered": self._picture[:, :, 3] > 0,
            "color": self._picture,
            "color_linear": decode_srgb(self._picture[:, :, :3]),
        }


class Lines:
    """All lines in one call."""

    def __init__(self, scene: LineScene, threads: int) -> None:
        import rasterjit as rj

        self._scene = scene
        self._framebuffer = rj.Framebuffer(*scene.size, threads=threads)

    def draw(self) -> None:
        """Clear and draw."""
        self._framebuffer.clear((0, 0, 0, 0))
        self._framebuffer.draw_lines(self._scene.ends, self._scene.colors)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture; it is a NumPy array already."""
        return {"color": self._framebuffer.color}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared; a ramp between two colours is the same bytes in any space."""
        color = self._framebuffer.color
        return {"covered": color[:, :, 3] > 0, "color_linear": color[:, :, :3].copy()}


def make_scene(scene: TriangleScene) -> Any:
    """Return the ``rasterjit.Scene``: floats are linear light there, as the colours are."""
    import rasterjit as rj

    colors = None if scene.colors is None else scene.colors / np.float32(255)
    looks: dict[str, Any] = {"colors": colors, "normals": scene.normals, "uv": scene.uv}
    if scene.values is not None:
        looks = {"scalars": scene.values, "colormap": scene.texture[0], "range": (0.0, 1.0)}
    mesh = rj.Mesh(scene.positions, scene.faces, **looks)
    made = rj.Scene()
    for world_from_model in np.eye(4)[np.newaxis] if scene.instances is None else scene.instances:
        made.add(mesh, transform=world_from_model)
    if scene.mode == "edges":
        made.wireframe = rj.Wireframe(np.array(EDGE_COLOR) / 255, "only")
    picture = None
    if scene.texture is not None and scene.values is None:
        picture = rj.Texture(scene.texture, filter="bilinear")
    if scene.to_light is None:
        mesh.material = rj.Material("unlit", base_color="white", base_color_texture=picture)
    else:
        mesh.material = rj.Material(
            base_color="white", shading="phong", specular=scene.specular, shininess=scene.shininess
        )
        made.lights += [
            rj.AmbientLight(intensity=scene.ambient),
            rj.DirectionalLight(direction=-scene.to_light),
        ]
    return made


def decode_srgb(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return 8-bit sRGB in linear light, 8 bits as well."""
    encoded = np.arange(256) / 255.0
    low, high = encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4
    return np.rint(255.0 * np.where(encoded <= 0.04045, low, high)).astype(np.uint8)[color]
