"""Render scenes to arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.pyrender.constants import RenderFlags
from rasterjit.compat.pyrender.drawing import (
    Drawing,
    background_codes,
    background_light,
    camera_of,
    check_flags,
    convert,
)
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.scene import Scene
from rasterjit.outputs.frame import Frame
from rasterjit.rendering.renderer import Renderer
from rasterjit.scene.camera import MatrixCamera
from rasterjit.scene.quality import Quality
from rasterjit.scene.validation import finite_array, image_size, in_short, positive_number

QUALITY = Quality(blending="srgb8")


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
    ValueError
        If a number is out of range.
    """

    def __init__(self, viewport_width: int, viewport_height: int, point_size: float = 1.0) -> None:
        self.viewport_width, self.viewport_height = image_size(
            "viewport_width, viewport_height", (viewport_width, viewport_height)
        )
        self.point_size = point_size
        self._renderer: Renderer | None = None

    def render(
        self,
        scene: Scene,
        flags: int = RenderFlags.NONE,
        seg_node_map: Mapping[Node, Any] | None = None,
    ) -> Any:
        """
        Render a scene through its main camera.

        Parameters
        ----------
        scene : Scene
        flags : int
            `RenderFlags`, combined.
        seg_node_map : mapping of Node to int or (3,) array_like, optional
            With ``RenderFlags.SEG``: the colour, bytes, of each node that is drawn.

        Returns
        -------
        color : (H, W, 3) uint8, or (H, W, 4) with ``RenderFlags.RGBA``
            Not with ``RenderFlags.DEPTH_ONLY``.
        depth : (H, W) float32, scene units
            Along the viewing axis; 0 where nothing is. In wireframes it is that of the faces.

        Raises
        ------
        ValueError
            If the scene has no camera, or something cannot be drawn.
        """
        if not isinstance(scene, Scene):
            raise ValueError(f"scene must be a Scene of this module, got {in_short(scene)}")
        wanted = check_flags(flags)
        size = image_size("viewport", (self.viewport_width, self.viewport_height))
        camera = camera_of(scene, size)
        points = camera, size, positive_number("point_size", self.point_size)
        if wanted & RenderFlags.SEG:
            found = self._segmented(scene, camera, wanted, dict(seg_node_map or {}), points)
        elif wanted & RenderFlags.DEPTH_ONLY:
            drawing = convert(scene, wanted, shapes_alone=True, points=points)
            return _depth(self._draw(drawing, camera, ("depth",)), size)
        else:
            found = self._colored(scene, camera, wanted, points)
        return found[1] if wanted & RenderFlags.DEPTH_ONLY else found

    def delete(self) -> None:
        """Let threads and memory go; a later render takes them again."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _colored(
        self, scene: Scene, camera: MatrixCamera, flags: RenderFlags, points: Any
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Render colour and depth."""
        codes = background_codes(scene)
        channels = 4 if flags & RenderFlags.RGBA else 3
        if channels == 3:
            codes[3] = 255
        size = (self.viewport_width, self.viewport_height)
        drawing = convert(scene, flags, points=points)
        # What is seen through has a depth in OpenGL's buffer, and none in ours.
        outputs = ("color",) if drawing.is_blended else ("color", "depth")
        frame = self._draw(drawing, camera, outputs, background_light(codes, flags))
        if frame is None:
            color = np.broadcast_to(codes, (size[1], size[0], 4))
        else:
            color = frame.color
        if drawing.is_blended:
            solid = convert(scene, flags, shapes_alone=True, points=points)
            frame = self._draw(solid, camera, ("depth",))
        return np.ascontiguousarray(color[..., :channels]), _depth(frame, size)

    def _segmented(
        self,
        scene: Scene,
        camera: MatrixCamera,
        flags: RenderFlags,
        colors: dict[Node, Any],
        points: Any,
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Render the nodes of a map in their colours, and their depth."""
        size = (self.viewport_width, self.viewport_height)
        drawing = convert(
            scene, flags | RenderFlags.ALL_SOLID, only=set(colors), shapes_alone=True,
            points=points,
        )  # fmt: skip
        frame = self._draw(drawing, camera, ("object_id", "depth"))
        table = np.zeros((len(drawing.owners) + 1, 3), np.uint8)
        for number, node in enumerate(drawing.owners):
            value = np.ravel(colors[node])
            color = finite_array("seg_node_map", np.repeat(value, 3) if len(value) == 1 else value,
                                 (3,))  # fmt: skip
            if color.min() < 0.0 or color.max() > 255.0:
                raise ValueError(f"seg_node_map must hold colors in 0..255, got {color.tolist()}")
            table[number] = color
        if frame is None:
            return np.zeros((size[1], size[0], 3), np.uint8), _depth(None, size)
        # Nothing is number -1: the last row, black.
        return table[frame.object_id], _depth(frame, size)

    def _draw(
        self,
        drawing: Drawing,
        camera: MatrixCamera,
        outputs: tuple[str, ...],
        background: Any = None,
    ) -> Frame | None:
        """Render, or return None if there is nothing to draw."""
        if not drawing.owners:
            return None
        size = (self.viewport_width, self.viewport_height)
        if self._renderer is None or self._renderer.size != size:
            self.delete()
            self._renderer = Renderer(size, quality=QUALITY)
        return self._renderer.render(drawing.scene, camera, outputs=outputs, background=background)


def _depth(frame: Frame | None, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return the depth with 0 where nothing is."""
    if frame is None:
        return np.zeros((size[1], size[0]), np.float32)
    depth = frame.depth
    return np.where(np.isfinite(depth), depth, np.float32(0.0))
