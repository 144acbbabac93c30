"""Render scenes to arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.opengl_camera import flip_rows, make_matrix_camera
from rasterjit.compat.pyrender import conversion
from rasterjit.compat.pyrender.constants import NORMALS, SHADOW_TEX_SZ, RenderFlags, TextAlign
from rasterjit.compat.pyrender.conversion import ConvertedScene, LightView, Viewpoint
from rasterjit.compat.pyrender.fields import Field, NoOpenGLError, to_number
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
"""Outputs that `OffscreenRenderer.render` can return beside colour and depth."""

_COLOR_QUALITY = Quality(samples=4, blending="srgb8", subpixel_bits=12)
"""Quality of colour: the mean of four samples' codes."""

_SHAPE_QUALITY = Quality(subpixel_bits=12)
"""Quality of depth and numbers, at one position in each pixel. Mesa rounds vertices to 1/256 of a
pixel, but computes depths from unrounded ones."""

_SHADOW_QUALITY = Quality(subpixel_bits=8)
"""Quality of shadow maps."""

_ROWS_PER_BLOCK = 32
"""Rows of a picture whose numbers are converted to colours at once."""

_X, _Y = SAMPLE_POSITIONS[4][0]
_FIRST_SAMPLE = _X / STEPS_PER_PIXEL, -_Y / STEPS_PER_PIXEL
"""Offset of the first sample from the centre of a pixel, to the right and down: its depth is the
pixel's."""

_UNCHANGED_DEPTHS = (0.0, 1.0), (1.0, 0.0)
"""Fields of a `DepthFormat` that returns depths unchanged."""

_ROUNDING_TOLERANCE = 1e-9
"""Largest relative difference of factors that differ by rounding alone."""

_EMPTY_DEPTH_BITS = np.float32(np.inf).view(np.uint32)
"""Bits of the depth of empty pixels."""


_PYRENDER_PASSES = (
    "_forward_pass", "_shadow_mapping_pass", "_normals_pass", "_bind_and_draw_primitive",
    "_bind_lighting", "_bind_texture", "_update_context", "_get_primitive_program",
    "_get_camera_matrices", "_sorted_mesh_nodes", "_configure_forward_pass_viewport",
    "_configure_main_framebuffer", "_read_main_framebuffer", "_compute_max_n_lights",
    "_forward_pass_no_reset", "_get_light_cam_matrices", "_sorted_nodes_by_distance",
)  # fmt: skip
"""Methods of pyrender that subclasses override; here nothing would call them."""

_PYRENDER_ATTRIBUTES = (
    "_program_cache", "_font_cache", "_main_fb", "_main_cb", "_main_db", "_main_fb_ms",
    "_main_cb_ms", "_main_db_ms", "_shadow_fb", "_meshes", "_mesh_textures", "_shadow_textures",
)  # fmt: skip
"""Attributes of pyrender that programs set; here nothing would read them."""


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
    point_size = Field(to_number, "float: side of points, pixels.")

    @property
    def _renderer(self) -> Renderer:
        """A `Renderer` of this object, for programs that reach for pyrender's."""
        if self._below is None:
            self._below = Renderer._wrap(self)
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
            Further outputs, which pyrender lacks: ``"normal"``, ``"geometric_normal"`` (of
            the faces) and ``"position"`` in the world's space, ``"normal_camera"`` and
            ``"position_camera"`` in the camera's, ``"distance"`` from the camera.

        Returns
        -------
        color : (H, W, 3) uint8, or (H, W, 4) with ``RenderFlags.RGBA``
            Not with ``RenderFlags.DEPTH_ONLY``.
        depth : (H, W) float32, scene units
            Along the viewing axis; 0 in empty pixels. In wireframes it is that of the faces.
        extra : dict of str to array
            Only with ``outputs``: an array each, (H, W, C) or (H, W) float32, of the surface that
            the depth is of; where edges are drawn, of the faces. In empty pixels, normals are 0,
            positions NaN and distances infinite.

        Raises
        ------
        ValueError
            If the scene has no camera, or something cannot be drawn.
        """
        if not isinstance(scene, Scene):
            raise ValueError(f"scene must be a Scene of this module, got {brief(scene)}")
        # Offscreen pyrender draws normals too late for its picture.
        checked_flags = conversion.check_flags(flags) & ~NORMALS
        extra = _check_names(outputs)
        size = image_size(
            "viewport_width, viewport_height", (self.viewport_width, self.viewport_height)
        )
        viewpoint = Viewpoint(
            conversion.make_camera(scene, size),
            size,
            positive_number("point_size", self.point_size),
        )
        depths = DepthFormat.of(viewpoint.camera, scene)
        if checked_flags & RenderFlags.SEG:
            color, depth = self._render_segments(
                scene, viewpoint, checked_flags, dict(seg_node_map or {}), depths
            )
        elif checked_flags & RenderFlags.DEPTH_ONLY:
            converted = conversion.convert_scene(
                scene, checked_flags, shapes_alone=True, viewpoint=viewpoint
            )
            frame = self._draw_shapes(converted, viewpoint, ("depth",), _FIRST_SAMPLE)
            depth = depths.read(frame, size)
        else:
            color, depth = self._render_color(scene, viewpoint, checked_flags, depths)
        arrays = (depth,) if checked_flags & RenderFlags.DEPTH_ONLY else (color, depth)
        if extra:
            only = set(seg_node_map or {}) if checked_flags & RenderFlags.SEG else None
            arrays += (self._render_extra(scene, viewpoint, checked_flags, only, extra),)
        return arrays if len(arrays) > 1 else depth

    def delete(self) -> None:
        """Release threads and memory until the next render."""
        for engine in self._engines.values():
            engine.close()
        self._engines.clear()

    def _render_color(
        self, scene: Scene, viewpoint: Viewpoint, flags: RenderFlags, depths: DepthFormat
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Render colour and depth."""
        codes = conversion.quantize_background(scene)
        has_alpha = bool(flags & RenderFlags.RGBA)
        views = self._render_light_views(scene, flags, viewpoint.point_size)
        converted = conversion.convert_scene(scene, flags, viewpoint=viewpoint, views=views)
        background = codes.copy()
        # With alpha the background is blended in afterwards, by its codes.
        background[3] = 0 if has_alpha and not converted.fades else 255
        light = conversion.decode_background(background, flags)
        frame = self._draw(converted, viewpoint, ("color", "depth"), _COLOR_QUALITY, light)
        if frame is None:
            channels = 4 if has_alpha else 3
            color = np.tile(codes[:channels], (viewpoint.size[1], viewpoint.size[0], 1))
        elif has_alpha and converted.fades:
            color = frame.color[::-1].copy()
            color[..., 3] = self._render_alpha(scene, viewpoint, flags, codes[3])
        elif has_alpha:
            color = _blend_over(frame.color[::-1], codes)
        else:
            color = _drop_alpha(frame.color[::-1])
        return color, depths.read(frame, viewpoint.size)

    def _render_light_views(
        self, scene: Scene, flags: RenderFlags, point_size: float
    ) -> dict[Node, LightView]:
        """Return the shadow maps of the directional and spot lights that cast shadows."""
        views: dict[Node, LightView] = {}
        if flags & RenderFlags.FLAT:
            return views
        for node in scene._list_nodes():
            light = node.light
            if not isinstance(light, DirectionalLight | SpotLight):
                continue
            if not conversion.casts_shadows(light, flags) or not scene.scale > 0.0:
                continue
            camera, size = conversion.make_light_camera(scene, node), (SHADOW_TEX_SZ, SHADOW_TEX_SZ)
            viewpoint = Viewpoint(camera, size, point_size)
            shapes = conversion.convert_scene(
                scene, RenderFlags.DEPTH_ONLY, shapes_alone=True, viewpoint=viewpoint
            )
            frame = self._draw(shapes, viewpoint, ("depth",), _SHADOW_QUALITY)
            if frame is not None:
                views[node] = LightView(camera, frame.depth)
        return views

    def _render_alpha(
        self, scene: Scene, viewpoint: Viewpoint, flags: RenderFlags, background_alpha: int
    ) -> NDArray[np.uint8]:
        """
        Render the alpha of the picture, (H, W).

        OpenGL blends alphas as it blends colours: so they are drawn as greys.
        """
        greys = conversion.convert_scene(scene, flags, alphas_alone=True, viewpoint=viewpoint)
        codes = np.array([background_alpha] * 3 + [255], np.uint8)
        light = conversion.decode_background(codes, RenderFlags.FLAT)
        frame = self._draw(greys, viewpoint, ("color",), _COLOR_QUALITY, light)
        return frame.color[::-1, :, 0]

    def _render_segments(
        self,
        scene: Scene,
        viewpoint: Viewpoint,
        flags: RenderFlags,
        colors: dict[Node, Any],
        depths: DepthFormat,
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Render the nodes of a map in their colours, and their depth."""
        converted = conversion.convert_scene(
            scene, flags, only=set(colors), shapes_alone=True, viewpoint=viewpoint
        )
        # pyrender draws these without multisampling: at the centres of pixels.
        frame = self._draw_shapes(converted, viewpoint, ("object_id", "depth"), (0.0, 0.0))
        table = np.zeros((len(converted.owners) + 1, 4), np.uint8)
        table[:, 3] = 255
        for row, node in enumerate(converted.owners):
            table[row, :3] = _parse_segment_color(colors[node])
        channels = 4 if flags & RenderFlags.RGBA else 3
        color = np.empty((viewpoint.size[1], viewpoint.size[0], channels), np.uint8)
        if frame is None:
            color[:] = table[-1, :channels]
            return color, depths.read(frame, viewpoint.size)
        packed, numbers = table.view(np.uint32)[:, 0], frame.object_id[::-1]
        # Few rows at once stay in the processor's cache and allocate little.
        for first in range(0, len(color), _ROWS_PER_BLOCK):
            rows = slice(first, first + _ROWS_PER_BLOCK)
            # Empty pixels have index -1: the last row, black.
            codes = packed.take(numbers[rows], mode="wrap").view(np.uint8)
            codes = codes.reshape(*numbers[rows].shape, 4)
            for channel in range(channels):
                color[rows, :, channel] = codes[..., channel]
        return color, depths.read(frame, viewpoint.size)

    def _draw_shapes(
        self,
        converted: ConvertedScene,
        viewpoint: Viewpoint,
        outputs: tuple[str, ...],
        offset: tuple[float, float],
    ) -> Frame | None:
        """Render at an offset from the centre of each pixel, to the right and down."""
        camera = viewpoint.camera
        if offset != (0.0, 0.0):
            camera = _shift_camera(camera, viewpoint.size, offset)
        return self._draw(converted, viewpoint._replace(camera=camera), outputs, _SHAPE_QUALITY)

    def _render_extra(
        self,
        scene: Scene,
        viewpoint: Viewpoint,
        flags: RenderFlags,
        only: set[Node] | None,
        names: tuple[str, ...],
    ) -> dict[str, NDArray[Any]]:
        """Render extra outputs at the position in each pixel where its depth is taken."""
        offset = (0.0, 0.0) if flags & RenderFlags.SEG else _FIRST_SAMPLE
        solid = flags | RenderFlags.ALL_SOLID
        converted = conversion.convert_scene(
            scene, solid, only=only, shapes_alone=True, viewpoint=viewpoint
        )
        frame = self._draw_shapes(converted, viewpoint, names, offset)
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
        converted: ConvertedScene,
        viewpoint: Viewpoint,
        outputs: tuple[str, ...],
        quality: Quality,
        background: Any = None,
    ) -> Frame | None:
        """Render upside down; return None if there is nothing to draw."""
        if not converted.owners:
            return None
        engine = self._engines.get(quality)
        if engine is None or engine.size != viewpoint.size:
            if engine is not None:
                engine.close()
            engine = self._engines[quality] = Engine(viewpoint.size, quality=quality)
            # pyrender does not warn of empty pictures either.
            engine.warned = None
        camera = flip_rows(viewpoint.camera)
        return engine.render(converted.scene, camera, outputs=outputs, background=background)


def _forward_attribute(name: str, doc: str) -> Any:
    """Return a property that reads and sets an attribute of the `OffscreenRenderer`."""
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
        If a subclass overrides a pass of OpenGL, or such a part is read or set.
    """

    dpscale = 1
    """Pixels of a picture for one of the viewport."""

    def __init__(self, viewport_width: int, viewport_height: int, point_size: float = 1.0) -> None:
        self._use(OffscreenRenderer(viewport_width, viewport_height, point_size))

    @classmethod
    def _wrap(cls, offscreen: OffscreenRenderer) -> Renderer:
        """Return a renderer that uses an existing `OffscreenRenderer`."""
        renderer = cls.__new__(cls)
        renderer._use(offscreen)
        return renderer

    def _use(self, offscreen: OffscreenRenderer) -> None:
        replaced = [name for name in _PYRENDER_PASSES if hasattr(type(self), name)]
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
        if name in _PYRENDER_ATTRIBUTES or name in _PYRENDER_PASSES:
            raise NoOpenGLError(f"{type(self).__name__}.{name}")
        super().__setattr__(name, value)

    viewport_width = _forward_attribute("viewport_width", "Width of the picture, pixels.")
    viewport_height = _forward_attribute("viewport_height", "Height of the picture, pixels.")
    point_size = _forward_attribute("point_size", "Side of points, pixels.")

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
        """Release threads and memory until the next render."""
        self._offscreen.delete()


class DepthFormat(NamedTuple):
    """
    Converts depths to those that pyrender reads from OpenGL's depth buffer.

    pyrender inverts NDC z as if every projection were a perspective with the camera's planes; so
    parallel ones, for example, have other depths than ours.
    """

    numerator: tuple[float, float]
    """Constant and factor of our depth d."""
    denominator: tuple[float, float]
    """Constant and factor of our depth d."""

    @classmethod
    def of(cls, camera: MatrixCamera, scene: Scene) -> DepthFormat:
        """Return the format of depths of the main camera."""
        planes = scene.main_camera_node.camera
        near, far = planes.znear, planes.zfar
        (*z_across, z_scale, z_offset), (*w_across, w_scale, w_offset) = camera.clip_from_view[2:]
        if any(z_across) or any(w_across):
            # Not along the viewing axis: unchanged.
            return cls(*_UNCHANGED_DEPTHS)
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
        is_same = e == 0.0 and abs(constant - top * g) <= _ROUNDING_TOLERANCE * constant
        if is_same and abs(slope) * reach <= _ROUNDING_TOLERANCE * constant:
            return cls(*_UNCHANGED_DEPTHS)
        return cls((top * e, top * g), (constant, slope))

    def read(self, frame: Frame | None, size: tuple[int, int]) -> NDArray[np.float32]:
        """Return the converted depth of a frame drawn upside down, (H, W) float32; 0 if empty."""
        if frame is None:
            return np.zeros((size[1], size[0]), np.float32)
        depth = frame.depth[::-1].copy()
        bits = depth.view(np.uint32)
        is_seen = bits != _EMPTY_DEPTH_BITS
        if self != _UNCHANGED_DEPTHS:
            (a, b), (e, g) = self
            exact = depth.astype(np.float64)
            with np.errstate(divide="ignore", invalid="ignore"):
                depth[:] = (a + b * exact) / (e + g * exact)
        bits *= is_seen
        return depth


def _shift_camera(
    camera: MatrixCamera, size: tuple[int, int], offset: tuple[float, float]
) -> MatrixCamera:
    """Return a camera whose pixel centres lie at an offset from the original ones, pixels."""
    clip = camera.clip_from_view.copy()
    clip[0] -= 2.0 * offset[0] / size[0] * clip[3]
    clip[1] += 2.0 * offset[1] / size[1] * clip[3]
    return make_matrix_camera(camera.view_from_world, clip)


def _drop_alpha(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the first three channels, (H, W, 3) uint8."""
    rgb = np.empty((*color.shape[:2], 3), np.uint8)
    # Channel by channel: four times as fast as a copy of the slice.
    for channel in range(3):
        rgb[..., channel] = color[..., channel]
    return rgb


def _blend_over(color: NDArray[np.uint8], codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Blend a picture with straight alpha, (H, W, 4) uint8, over the codes of a background."""
    blended = np.ascontiguousarray(color)
    alpha = blended[..., 3]
    rows, columns = np.nonzero((alpha != 255) & (alpha != 0))
    # Empty pixels have the background's colour already, but not its alpha.
    alpha[alpha == 0] = codes[3]
    pixels = blended[rows, columns].astype(np.float64)
    share = pixels[:, 3:] / 255.0
    pixels[:, 3] = 255.0
    blended[rows, columns] = np.floor(share * pixels + (1.0 - share) * codes + 0.5)
    return blended


def _check_names(outputs: str | Sequence[str] | None) -> tuple[str, ...]:
    """Return names of extra outputs, or raise ``ValueError`` of one that is unknown."""
    if outputs is None:
        return ()
    names = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    return tuple(one_of("outputs", name, EXTRA_OUTPUTS) for name in names)


def _parse_segment_color(value: Any) -> NDArray[np.float64]:
    """Return a node's colour, (3,) in 0..255, rounded to whole numbers."""
    color = np.asarray(value)
    if color.dtype.kind not in "buif" or color.size not in (1, 3):
        raise ValueError(f"seg_node_map must hold numbers or (3,) colors, got {brief(value)}")
    return np.clip(np.rint(np.nan_to_num(np.ravel(color).astype(np.float64))), 0.0, 255.0)
