"""Render scenes to arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.opengl_camera import matrix_camera, upside_down
from rasterjit.compat.pyrender.constants import NORMALS, SHADOW_TEX_SZ, RenderFlags, TextAlign
from rasterjit.compat.pyrender.drawing import (
    Drawing,
    LightView,
    Seen,
    background_codes,
    background_light,
    camera_of,
    camera_of_light,
    casts_shadows,
    check_flags,
    convert,
)
from rasterjit.compat.pyrender.fields import Field, NoOpenGLError, number
from rasterjit.compat.pyrender.light import DirectionalLight, SpotLight
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.platforms import Platform
from rasterjit.compat.pyrender.scene import Scene
from rasterjit.outputs.frame import Frame
from rasterjit.outputs.output_table import TABLE
from rasterjit.pipeline.fragments.fragment_bands import SAMPLE_POSITIONS, STEPS_PER_PIXEL
from rasterjit.rendering.renderer import Renderer as Engine
from rasterjit.scene.camera import MatrixCamera
from rasterjit.scene.quality import Quality
from rasterjit.scene.validation import brief, image_size, one_of, positive_number

EXTRA_OUTPUTS = (
    "normal", "normal_camera", "geometric_normal", "position", "position_camera", "distance",
)  # fmt: skip
"""What `OffscreenRenderer.render` can return beside colour and depth."""

_PICTURE = Quality(samples=4, blending="srgb8", subpixel_bits=12)
"""How colour is drawn: the mean of four samples' codes."""

_SHAPES = Quality(subpixel_bits=12)
"""How depth and numbers are drawn: at one place of each pixel. Mesa rounds vertices to 1/256 of a
pixel, but finds depths by what was not rounded."""

_MAP = Quality(subpixel_bits=8)
"""How what lights see is drawn."""

_ROWS_AT_ONCE = 32
"""Rows whose numbers become colours at once."""

_X, _Y = SAMPLE_POSITIONS[4][0]
_FIRST_SAMPLE = _X / STEPS_PER_PIXEL, -_Y / STEPS_PER_PIXEL
"""Where the first sample lies, from the centre of a pixel to the right and down: its depth is the
pixel's."""

_AS_IS = (0.0, 1.0), (1.0, 0.0)
"""`Depths` that are told as they are."""

_SAME = 1e-9
"""Share by which factors may differ that are the same but for rounding."""

_NOTHING = np.float32(np.inf).view(np.uint32)
"""Depth where nothing is, as bits."""


_PASSES = (
    "_forward_pass", "_shadow_mapping_pass", "_normals_pass", "_bind_and_draw_primitive",
    "_bind_lighting", "_bind_texture", "_update_context", "_get_primitive_program",
    "_get_camera_matrices", "_sorted_mesh_nodes", "_configure_forward_pass_viewport",
    "_configure_main_framebuffer", "_read_main_framebuffer", "_compute_max_n_lights",
    "_forward_pass_no_reset", "_get_light_cam_matrices", "_sorted_nodes_by_distance",
)  # fmt: skip
"""Methods of pyrender's that subclasses replace; here nothing would call them."""

_PARTS = (
    "_program_cache", "_font_cache", "_main_fb", "_main_cb", "_main_db", "_main_fb_ms",
    "_main_cb_ms", "_main_db_ms", "_shadow_fb", "_meshes", "_mesh_textures", "_shadow_textures",
)  # fmt: skip
"""Attributes of pyrender's that programs set; here nothing would read them."""


class OffscreenRenderer:
    """
    Renders scenes of one size.

    Parameters
    ----------
    viewport_width, viewport_height : int, pixels
    point_size : float, pixels
        Side of points.

    Raises
    ------
    TypeError, ValueError
        If a value is no number. A size out of range is refused when a scene is rendered.
    """

    def __init__(self, viewport_width: int, viewport_height: int, point_size: float = 1.0) -> None:
        self.viewport_width, self.viewport_height = viewport_width, viewport_height
        self.point_size = point_size
        self._below: Renderer | None = None
        self._platform = Platform(self.viewport_width, self.viewport_height)
        self._engines: dict[Quality, Engine] = {}

    viewport_width = Field(int, "int: width of the picture, pixels.")
    viewport_height = Field(int, "int: height of the picture, pixels.")
    point_size = Field(number, "float: side of points, pixels.")

    @property
    def _renderer(self) -> Renderer:
        """The renderer below it, for programs that reach for pyrender's."""
        if self._below is None:
            self._below = Renderer._of(self)
        return self._below

    def render(
        self,
        scene: Scene,
        flags: int = RenderFlags.NONE,
        seg_node_map: Mapping[Node, Any] | None = None,
        *,
        outputs: str | Sequence[str] | None = None,
    ) -> Any:
        """
        Render a scene through its main camera.

        Parameters
        ----------
        scene : Scene
        flags : int
            `RenderFlags`, combined.
        seg_node_map : mapping of Node to int or (3,) array_like, optional
            With ``RenderFlags.SEG``: the colour, 0..255, of each node that is drawn. Colours below
            are 0, those above 255.
        outputs : str or sequence of str, optional
            What else to return, which pyrender has not: ``"normal"``, ``"geometric_normal"`` (of
            the faces) and ``"position"`` in the world's space, ``"normal_camera"`` and
            ``"position_camera"`` in the camera's, ``"distance"`` from the camera.

        Returns
        -------
        color : (H, W, 3) uint8, or (H, W, 4) with ``RenderFlags.RGBA``
            Not with ``RenderFlags.DEPTH_ONLY``.
        depth : (H, W) float32, scene units
            Along the viewing axis; 0 where nothing is. In wireframes it is that of the faces.
        extra : dict of str to array
            Only with ``outputs``: an array each, (H, W, C) or (H, W) float32, of the surface that
            the depth is of; where edges are drawn, of the faces. Where nothing is, normals are 0,
            positions NaN and distances infinite.

        Raises
        ------
        ValueError
            If the scene has no camera, or something cannot be drawn.
        """
        if not isinstance(scene, Scene):
            raise ValueError(f"scene must be a Scene of this module, got {brief(scene)}")
        # Offscreen pyrender draws normals too late for its picture.
        wanted = check_flags(flags) & ~NORMALS
        extra = _names(outputs)
        size = image_size(
            "viewport_width, viewport_height", (self.viewport_width, self.viewport_height)
        )
        seen = Seen(camera_of(scene, size), size, positive_number("point_size", self.point_size))
        depths = Depths.of(seen.camera, scene)
        if wanted & RenderFlags.SEG:
            found = self._segmented(scene, seen, wanted, dict(seg_node_map or {}), depths)
        elif wanted & RenderFlags.DEPTH_ONLY:
            drawing = convert(scene, wanted, shapes_alone=True, seen=seen)
            shapes = self._draw_shapes(drawing, seen, ("depth",), _FIRST_SAMPLE)
            found = None, depths.read(shapes, size)
        else:
            found = self._colored(scene, seen, wanted, depths)
        color, depth = found
        arrays = (depth,) if wanted & RenderFlags.DEPTH_ONLY else (color, depth)
        if extra:
            only = set(seg_node_map or {}) if wanted & RenderFlags.SEG else None
            arrays += (self._extra(scene, seen, wanted, only, extra),)
        return arrays if len(arrays) > 1 else depth

    def delete(self) -> None:
        """Let threads and memory go; a later render takes them again."""
        for engine in self._engines.values():
            engine.close()
        self._engines.clear()

    def _colored(
        self, scene: Scene, seen: Seen, flags: RenderFlags, depths: Depths
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Render colour and depth."""
        codes = background_codes(scene)
        has_alpha = bool(flags & RenderFlags.RGBA)
        views = self._views_of_lights(scene, flags, seen.point_size)
        drawing = convert(scene, flags, seen=seen, views=views)
        behind = codes.copy()
        # Where alpha is wanted what is behind comes in afterwards, for its codes count as they are.
        behind[3] = 0 if has_alpha and not drawing.fades else 255
        light = background_light(behind, flags)
        frame = self._draw(drawing, seen, ("color", "depth"), _PICTURE, light)
        if frame is None:
            channels = 4 if has_alpha else 3
            color = np.tile(codes[:channels], (seen.size[1], seen.size[0], 1))
        elif has_alpha and drawing.fades:
            color = frame.color[::-1].copy()
            color[..., 3] = self._alphas(scene, seen, flags, codes[3])
        elif has_alpha:
            color = _over(frame.color[::-1], codes)
        else:
            color = _opaque(frame.color[::-1])
        return color, depths.read(frame, seen.size)

    def _views_of_lights(
        self, scene: Scene, flags: RenderFlags, point_size: float
    ) -> dict[Node, LightView]:
        """Return what those lights see that cast shadows, but for point lights."""
        views: dict[Node, LightView] = {}
        if flags & RenderFlags.FLAT:
            return views
        for node in scene._ordered():
            light = node.light
            if not isinstance(light, DirectionalLight | SpotLight):
                continue
            if not casts_shadows(light, flags) or not scene.scale > 0.0:
                continue
            camera, size = camera_of_light(scene, node), (SHADOW_TEX_SZ, SHADOW_TEX_SZ)
            seen = Seen(camera, size, point_size)
            shapes = convert(scene, RenderFlags.DEPTH_ONLY, shapes_alone=True, seen=seen)
            frame = self._draw(shapes, seen, ("depth",), _MAP)
            if frame is not None:
                views[node] = LightView(camera, frame.depth)
        return views

    def _alphas(
        self, scene: Scene, seen: Seen, flags: RenderFlags, behind: int
    ) -> NDArray[np.uint8]:
        """
        Return the alpha, (H, W), that is left where some is below 1.

        OpenGL mixes alphas as it mixes colours, by themselves: as greys would be mixed.
        """
        greys = convert(scene, flags, alphas_alone=True, seen=seen)
        codes = np.array([behind, behind, behind, 255], np.uint8)
        light = background_light(codes, RenderFlags.FLAT)
        frame = self._draw(greys, seen, ("color",), _PICTURE, light)
        return frame.color[::-1, :, 0]

    def _segmented(
        self,
        scene: Scene,
        seen: Seen,
        flags: RenderFlags,
        colors: dict[Node, Any],
        depths: Depths,
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Render the nodes of a map in their colours, and their depth."""
        drawing = convert(scene, flags, only=set(colors), shapes_alone=True, seen=seen)
        # Multisampling is off there, so both are those of the centres of pixels.
        frame = self._draw_shapes(drawing, seen, ("object_id", "depth"), (0.0, 0.0))
        table = np.zeros((len(drawing.owners) + 1, 4), np.uint8)
        table[:, 3] = 255
        for row, node in enumerate(drawing.owners):
            table[row, :3] = _seg_color(colors[node])
        channels = 4 if flags & RenderFlags.RGBA else 3
        color = np.empty((seen.size[1], seen.size[0], channels), np.uint8)
        if frame is None:
            color[:] = table[-1, :channels]
            return color, depths.read(frame, seen.size)
        packed, numbers = table.view(np.uint32)[:, 0], frame.object_id[::-1]
        # Few rows at once stay in the cache, and take no memory from the system.
        for first in range(0, len(color), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            # Nothing is number -1: the last row, black.
            codes = packed.take(numbers[rows], mode="wrap").view(np.uint8)
            codes = codes.reshape(*numbers[rows].shape, 4)
            for channel in range(channels):
                color[rows, :, channel] = codes[..., channel]
        return color, depths.read(frame, seen.size)

    def _draw_shapes(
        self, drawing: Drawing, seen: Seen, outputs: tuple[str, ...], place: tuple[float, float]
    ) -> Frame | None:
        """Render what is seen at a place of each pixel, from its centre to the right and down."""
        camera = seen.camera
        if place != (0.0, 0.0):
            camera = _moved(camera, seen.size, place)
        return self._draw(drawing, seen._replace(camera=camera), outputs, _SHAPES)

    def _extra(
        self,
        scene: Scene,
        seen: Seen,
        flags: RenderFlags,
        only: set[Node] | None,
        names: tuple[str, ...],
    ) -> dict[str, NDArray[Any]]:
        """Render what else was asked for, at the place of each pixel that its depth is of."""
        place = (0.0, 0.0) if flags & RenderFlags.SEG else _FIRST_SAMPLE
        solid = flags | RenderFlags.ALL_SOLID
        drawing = convert(scene, solid, only=only, shapes_alone=True, seen=seen)
        frame = self._draw_shapes(drawing, seen, names, place)
        if frame is not None:
            return {name: getattr(frame, name)[::-1].copy() for name in names}
        empty, size = {}, (self.viewport_height, self.viewport_width)
        for name, row in TABLE.items():
            if name in names:
                shape = size if row.channels == 1 else (*size, row.channels)
                empty[name] = np.full(shape, row.empty, row.dtype)
        return empty

    def _draw(
        self,
        drawing: Drawing,
        seen: Seen,
        outputs: tuple[str, ...],
        quality: Quality,
        background: Any = None,
    ) -> Frame | None:
        """Render upside down, or return None if there is nothing to draw."""
        if not drawing.owners:
            return None
        engine = self._engines.get(quality)
        if engine is None or engine.size != seen.size:
            if engine is not None:
                engine.close()
            engine = self._engines[quality] = Engine(seen.size, quality=quality)
            # A program that sees nothing hears nothing of it there.
            engine.warned = None
        camera = upside_down(seen.camera)
        return engine.render(drawing.scene, camera, outputs=outputs, background=background)


def _below(name: str, doc: str) -> Any:
    """Return an attribute that is that of the `OffscreenRenderer`."""
    return property(
        lambda self: getattr(self._offscreen, name),
        lambda self, value: setattr(self._offscreen, name, value),
        doc=doc,
    )


class Renderer:
    """
    Renders scenes of one size, as `OffscreenRenderer` does.

    Parameters
    ----------
    viewport_width, viewport_height : int, pixels
    point_size : float, pixels
        Side of points.

    Raises
    ------
    NoOpenGLError
        Of subclasses that replace a pass of OpenGL; whenever such a part is read or set.
    """

    dpscale = 1
    """Pixels of a picture for one of the viewport."""

    def __init__(self, viewport_width: int, viewport_height: int, point_size: float = 1.0) -> None:
        self._use(OffscreenRenderer(viewport_width, viewport_height, point_size))

    @classmethod
    def _of(cls, offscreen: OffscreenRenderer) -> Renderer:
        """Return the renderer below another."""
        made = cls.__new__(cls)
        made._use(offscreen)
        return made

    def _use(self, offscreen: OffscreenRenderer) -> None:
        replaced = [name for name in _PASSES if hasattr(type(self), name)]
        if replaced:
            raise NoOpenGLError(f"{type(self).__name__}.{replaced[0]}")
        self._offscreen = offscreen
        self._color: NDArray[np.uint8] | None = None
        self._depth: NDArray[np.float32] | None = None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") and not name.startswith("__"):
            raise NoOpenGLError(f"{type(self).__name__}.{name}")
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _PARTS or name in _PASSES:
            raise NoOpenGLError(f"{type(self).__name__}.{name}")
        super().__setattr__(name, value)

    viewport_width = _below("viewport_width", "Width of the picture, pixels.")
    viewport_height = _below("viewport_height", "Height of the picture, pixels.")
    point_size = _below("point_size", "Side of points, pixels.")

    def render(
        self, scene: Scene, flags: int, seg_node_map: Mapping[Node, Any] | None = None
    ) -> Any:
        """
        Render a scene, as `OffscreenRenderer.render` does.

        Returns
        -------
        What that returns, with ``RenderFlags.OFFSCREEN``; without it None, and `read_color_buf`
        and `read_depth_buf` return the arrays.
        """
        drawn = self._offscreen.render(scene, flags, seg_node_map)
        if flags & RenderFlags.DEPTH_ONLY:
            self._depth = drawn
        else:
            self._color, self._depth = drawn
        return drawn if flags & RenderFlags.OFFSCREEN else None

    def render_text(
        self,
        text: str,
        x: int,
        y: int,
        font_name: str = "OpenSans-Regular",
        font_pt: int = 40,
        color: Any = None,
        scale: float = 1.0,
        align: int = TextAlign.BOTTOM_LEFT,
    ) -> None:
        """Raise `NoOpenGLError`: text is drawn over a picture with Pillow, say."""
        raise NoOpenGLError("Renderer.render_text")

    def read_color_buf(self) -> NDArray[np.uint8]:
        """
        Return the last picture, (H, W, 3) uint8.

        Raises
        ------
        ValueError
            If none was drawn.
        """
        if self._color is None:
            raise ValueError("render must come before read_color_buf, got no picture")
        return self._color[..., :3]

    def read_depth_buf(self) -> NDArray[np.float32]:
        """
        Return the last depth, (H, W) float32.

        Raises
        ------
        ValueError
            If none was drawn.
        """
        if self._depth is None:
            raise ValueError("render must come before read_depth_buf, got no picture")
        return self._depth

    def delete(self) -> None:
        """Let threads and memory go; a later render takes them again."""
        self._offscreen.delete()


class Depths(NamedTuple):
    """
    How depths are told: as pyrender reads them from OpenGL's depth buffer.

    It takes any projection for that of a perspective with the camera's planes. Others, such as
    parallel ones, get what that makes of their NDC z; see its ``Renderer``.
    """

    numerator: tuple[float, float]
    """Constant and factor of our depth d, of what is divided by ..."""
    denominator: tuple[float, float]
    """... the same below it."""

    @classmethod
    def of(cls, camera: MatrixCamera, scene: Scene) -> Depths:
        """Return how depths of the main camera are told."""
        planes = scene.main_camera_node.camera
        near, far = planes.znear, planes.zfar
        (*z_across, z_scale, z_offset), (*w_across, w_scale, w_offset) = camera.clip_from_view[2:]
        if any(z_across) or any(w_across):
            # Not along the viewing axis: told as it is.
            return cls(*_AS_IS)
        # NDC z is (a + b d) / (e + g d), of our depth d.
        if w_scale != 0.0:
            # Depth is w over its slope.
            slope = abs(w_scale)
            a, b = z_offset - z_scale * w_offset / w_scale, z_scale * slope / w_scale
            e, g = 0.0, slope
        else:
            a, b, e, g = z_offset, abs(z_scale), w_offset, 0.0
        top, total, difference = 2.0 * near, 1.0, 1.0
        if far is not None:
            top, total, difference = 2.0 * near * far, far + near, far - near
        constant, slope = total * e - difference * a, total * g - difference * b
        reach = near if far is None else far
        is_same = e == 0.0 and abs(constant - top * g) <= _SAME * constant
        if is_same and abs(slope) * reach <= _SAME * constant:
            return cls(*_AS_IS)
        return cls((top * e, top * g), (constant, slope))

    def read(self, frame: Frame | None, size: tuple[int, int]) -> NDArray[np.float32]:
        """Return the depth, (H, W) float32, 0 where nothing is, of a frame drawn upside down."""
        if frame is None:
            return np.zeros((size[1], size[0]), np.float32)
        depth = frame.depth[::-1].copy()
        bits = depth.view(np.uint32)
        is_seen = bits != _NOTHING
        if self != _AS_IS:
            (a, b), (e, g) = self
            exact = depth.astype(np.float64)
            with np.errstate(divide="ignore", invalid="ignore"):
                depth[:] = (a + b * exact) / (e + g * exact)
        bits *= is_seen
        return depth


def _moved(camera: MatrixCamera, size: tuple[int, int], place: tuple[float, float]) -> MatrixCamera:
    """Return a camera that sees at the centres of pixels what lies at another place of them."""
    clip = camera.clip_from_view.copy()
    clip[0] -= 2.0 * place[0] / size[0] * clip[3]
    clip[1] += 2.0 * place[1] / size[1] * clip[3]
    return matrix_camera(camera.view_from_world, clip)


def _opaque(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return three of four channels, (H, W, 3) uint8: one after the other, four times as fast."""
    found = np.empty((*color.shape[:2], 3), np.uint8)
    for channel in range(3):
        found[..., channel] = color[..., channel]
    return found


def _over(color: NDArray[np.uint8], codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture with straight alpha, (H, W, 4) uint8, over a background as samples mix."""
    found = np.ascontiguousarray(color)
    alpha = found[..., 3]
    rows, columns = np.nonzero((alpha != 255) & (alpha != 0))
    # Where nothing is its colour is there.
    alpha[alpha == 0] = codes[3]
    pixels = found[rows, columns].astype(np.float64)
    share = pixels[:, 3:] / 255.0
    pixels[:, 3] = 255.0
    found[rows, columns] = np.floor(share * pixels + (1.0 - share) * codes + 0.5)
    return found


def _names(outputs: str | Sequence[str] | None) -> tuple[str, ...]:
    """Return names of extra outputs, or raise ``ValueError`` of one that is unknown."""
    if outputs is None:
        return ()
    names = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    return tuple(one_of("outputs", name, EXTRA_OUTPUTS) for name in names)


def _seg_color(value: Any) -> NDArray[np.float64]:
    """Return a node's colour, (3,) in 0..255, rounded to whole numbers."""
    given = np.asarray(value)
    if given.dtype.kind not in "buif" or given.size not in (1, 3):
        raise ValueError(f"seg_node_map must hold numbers or (3,) colors, got {brief(value)}")
    return np.clip(np.rint(np.nan_to_num(np.ravel(given).astype(np.float64))), 0.0, 255.0)
