"""
Panda3D's tinydisplay: a software rasterizer in C++, fixed-function, on one thread.

Its triangles have corners on whole pixels and colours that are mixed on the screen, without
perspective, so its pictures differ from exact ones at the borders of faces; a face whose corners
fall on one line of pixels is left out, and so are many slivers. Its lines are Bresenham's, but a
ramp starts with the colour of the wrong end and wraps around, so of lines only the pixels are
compared. A scene without colours is drawn in one colour.

Everything is set to the least work: vertices and indices are uploaded before, nothing is culled by
bounds, the picture is copied to memory by Panda3D itself (``RTM_copy_ram``) at the end of a frame,
and NumPy looks at that memory without another copy. Row 0 is the bottom row there, the bytes are
BGRA, and both stay so.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import EDGE_COLOR, refusal
from benchmarks.contestants.rasterjit_ import decode_srgb
from benchmarks.contestants.screen import find_unique_edges, matrices
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "Panda3D tinydisplay"

UNABLE = {"lighting": "no per-pixel lighting"}

QUIET = "audio-library-name null\nnotify-level-display fatal\nnotify-level-x11display fatal\n"
"""Configuration: no sound, and no complaint about a missing display, which is not needed."""

MAX_SHORT_INDEX = 65535


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    if find_spec("panda3d") is None:
        return 'the package panda3d is not installed (pip install ".[bench]")'
    try:
        open_pipe()
    except RuntimeError as error:
        return str(error)
    return None


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    return refusal(scene, UNABLE, draws=("texture",))


def alike(scene: Scene) -> tuple[float, float]:
    """
    Return the shares of pixels alike in coverage and in colour that its rules allow for.

    Rounding corners to pixels moves borders by up to half a pixel: little of a mesh, much of small
    objects, and nearly all of what is inside a sliver.
    """
    if isinstance(scene, LineScene):
        return 0.995, 0.0
    if scene.mode == "edges":
        return 0.85, 0.0
    if scene.instances is not None:
        return 0.88, 0.0
    faces_share_vertices = len(scene.positions) < 3 * len(scene.faces)
    if scene.views is not None or not faces_share_vertices:
        return 0.95, 0.0
    return 0.99, 0.5


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw, on one thread whatever is asked for."""
    return Frames(scene)


def open_pipe() -> Any:
    """Return the way to tinydisplay's off-screen buffers; without it raise ``RuntimeError``."""
    import panda3d.core as panda

    panda.load_prc_file_data("", QUIET)
    pipe = panda.GraphicsPipeSelection.get_global_ptr().make_module_pipe("p3tinydisplay")
    if pipe is None:
        raise RuntimeError("Panda3D has no p3tinydisplay")
    return pipe


class Frames:
    """A scene graph of one geometry, or of as many as there are instances, and its buffer."""

    def __init__(self, scene: Scene) -> None:
        import panda3d.core as panda

        self._panda = panda
        pipe = open_pipe()
        self._engine = panda.GraphicsEngine()
        wanted = panda.FrameBufferProperties()
        wanted.set_rgba_bits(8, 8, 8, 8)
        wanted.set_depth_bits(24)
        self._size = scene.size
        flags = panda.GraphicsPipe.BF_refuse_window | panda.GraphicsPipe.BF_fb_props_optional
        size = panda.WindowProperties.size(*scene.size)
        buffer = self._engine.make_output(pipe, "picture", 0, wanted, size, flags)
        if buffer is None:
            raise RuntimeError("Panda3D made no off-screen buffer")
        buffer.set_clear_color((0.0, 0.0, 0.0, 0.0))
        self._texture = panda.Texture()
        buffer.add_render_texture(self._texture, panda.GraphicsOutput.RTM_copy_ram)
        self._root = panda.NodePath("root")
        self._lens = panda.MatrixLens()
        self._lens.set_coordinate_system(panda.CS_yup_right)
        camera = self._root.attach_new_node(panda.Camera("camera", self._lens))
        camera.node().set_cull_bounds(panda.OmniBoundingVolume())
        buffer.make_display_region().set_camera(camera)
        self._draws_lines = isinstance(scene, LineScene)
        if isinstance(scene, LineScene):
            self._add_lines(scene)
        else:
            self._add_triangles(scene)

    def _add_lines(self, scene: LineScene) -> None:
        """Put all lines into one geometry, in clip space, pixel centres where they belong."""
        pixels = (scene.ends.reshape(-1, 2) + 0.5) / scene.size * 2.0 - 1.0
        positions = np.column_stack([pixels * (1.0, -1.0), np.zeros(len(pixels))])
        data = self._vertex_data(positions, scene.colors.reshape(-1, 4))
        lines = self._panda.GeomLines(self._panda.GeomEnums.UH_static)
        self._matrices = [np.eye(4)]
        self._add(data, lines, np.arange(len(positions)))
        self._root.set_depth_test(False)
        self._root.set_depth_write(False)

    def _add_triangles(self, scene: TriangleScene) -> None:
        """Put the mesh, or its edges, into the scene graph, once for each instance."""
        panda = self._panda
        is_edges = scene.mode == "edges"
        kind = panda.GeomLines if is_edges else panda.GeomTriangles
        colors = scene.colors
        if is_edges or colors is None:
            colors = np.array([EDGE_COLOR], np.uint8).repeat(len(scene.positions), axis=0)
        data = self._vertex_data(scene.positions, colors, scene.uv)
        if scene.texture is not None:
            self._root.set_texture(self._make_texture(scene.texture))
        self._writes_srgb = scene.texture is not None
        indices = find_unique_edges(scene.faces) if is_edges else scene.faces
        self._matrices = list(matrices(scene))
        self._add(data, kind(panda.GeomEnums.UH_static), indices, scene.instances)
        self._root.set_two_sided(scene.cull == "none")
        if is_edges:
            self._root.set_depth_test(False)
            self._root.set_depth_write(False)

    def _make_texture(self, image: NDArray[np.uint8]) -> Any:
        """Return the texture: its codes are filtered as they are, bilinear, repeated."""
        panda = self._panda
        texture = panda.Texture()
        height, width = image.shape[:2]
        texture.setup_2d_texture(width, height, panda.Texture.T_unsigned_byte, panda.Texture.F_rgb)
        texture.set_ram_image(np.ascontiguousarray(image[::-1, :, ::-1]).tobytes())
        texture.set_minfilter(panda.SamplerState.FT_linear)
        texture.set_magfilter(panda.SamplerState.FT_linear)
        texture.set_wrap_u(panda.SamplerState.WM_repeat)
        texture.set_wrap_v(panda.SamplerState.WM_repeat)
        return texture

    def _vertex_data(
        self,
        positions: NDArray[Any],
        colors: NDArray[np.uint8],
        uv: NDArray[np.float32] | None = None,
    ) -> Any:
        """Return vertices as Panda3D holds them."""
        panda, enums = self._panda, self._panda.GeomEnums
        layout = panda.GeomVertexArrayFormat("vertex", 3, enums.NT_float32, enums.C_point)
        layout.add_column("color", 4, enums.NT_uint8, enums.C_color)
        columns = [("position", "f4", 3), ("color", "u1", 4)]
        if uv is not None:
            layout.add_column("texcoord", 2, enums.NT_float32, enums.C_texcoord)
            columns.append(("uv", "f4", 2))
        layout = panda.GeomVertexFormat.register_format(panda.GeomVertexFormat(layout))
        vertices = np.empty(len(positions), columns)
        vertices["position"], vertices["color"] = positions, colors
        if uv is not None:
            vertices["uv"] = uv
        data = panda.GeomVertexData("vertices", layout, enums.UH_static)
        data.unclean_set_num_rows(len(vertices))
        memoryview(data.modify_array(0)).cast("B")[:] = vertices.tobytes()
        return data

    def _add(
        self,
        data: Any,
        primitive: Any,
        indices: NDArray[Any],
        instances: NDArray[np.float64] | None = None,
    ) -> None:
        """Add a geometry to the scene graph, with no bounds to cull it by."""
        panda, enums = self._panda, self._panda.GeomEnums
        is_short = len(indices) and indices.max() <= MAX_SHORT_INDEX
        primitive.set_index_type(enums.NT_uint16 if is_short else enums.NT_uint32)
        numbers = primitive.modify_vertices()
        numbers.unclean_set_num_rows(indices.size)
        packed = indices.astype(np.uint16 if is_short else np.uint32)
        memoryview(numbers).cast("B")[:] = packed.tobytes()
        geometry = panda.Geom(data)
        geometry.add_primitive(primitive)
        for matrix in np.eye(4)[np.newaxis] if instances is None else instances:
            node = panda.GeomNode("mesh")
            node.add_geom(geometry)
            node.set_bounds(panda.OmniBoundingVolume())
            node.set_final(True)
            self._root.attach_new_node(node).set_mat(panda.LMatrix4(*matrix.T.ravel()))

    def draw(self) -> None:
        """Clear and draw; all views, each left in memory that NumPy sees."""
        for number in range(len(self._matrices)):
            self.draw_view(number)

    def draw_view(self, number: int) -> None:
        """Clear and draw one view, left in memory that NumPy sees."""
        matrix = self._panda.LMatrix4(*self._matrices[number].T.ravel().tolist())
        self._lens.set_user_mat(matrix)
        self._engine.render_frame()
        self._pixels = np.frombuffer(self._texture.get_ram_image(), np.uint8)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the last picture, BGRA, bottom row first."""
        width, height = self._size
        return {"color": self._pixels.reshape(height, width, 4)}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared; lines leave alpha at 0, so any byte tells that one is there."""
        color = self.read()["color"][::-1]
        found = {"covered": color.any(axis=2)}
        if not self._draws_lines:
            codes = color[:, :, 2::-1].copy()
            found["color_linear"] = decode_srgb(codes) if self._writes_srgb else codes
        return found

    def close(self) -> None:
        """Let the scene and its buffer go."""
        self._engine.remove_all_windows()
