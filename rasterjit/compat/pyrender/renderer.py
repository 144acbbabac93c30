"""The renderer below `OffscreenRenderer`, for programs that use it themselves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.pyrender.absent import NoOpenGLError
from rasterjit.compat.pyrender.constants import RenderFlags, TextAlign
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.offscreen import OffscreenRenderer
from rasterjit.compat.pyrender.scene import Scene

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

    @property
    def viewport_width(self) -> int:
        """Width of the picture, pixels."""
        return self._offscreen.viewport_width

    @viewport_width.setter
    def viewport_width(self, value: int) -> None:
        self._offscreen.viewport_width = value

    @property
    def viewport_height(self) -> int:
        """Height of the picture, pixels."""
        return self._offscreen.viewport_height

    @viewport_height.setter
    def viewport_height(self, value: int) -> None:
        self._offscreen.viewport_height = value

    @property
    def point_size(self) -> float:
        """Side of points, pixels."""
        return self._offscreen.point_size

    @point_size.setter
    def point_size(self, value: float) -> None:
        self._offscreen.point_size = value

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
