"""Render scenes to arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.pyrender.constants import RenderFlags
from rasterjit.compat.pyrender.drawing import (
    Drawing,
    background_codes,
    camera_of,
    check_flags,
    convert,
)
from rasterjit.compat.pyrender.fields import Field, number
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.platforms import Platform
from rasterjit.compat.pyrender.scene import Scene
from rasterjit.outputs.frame import Frame
from rasterjit.outputs.table import TABLE
from rasterjit.rendering.renderer import Renderer as Engine
from rasterjit.scene.camera import MatrixCamera
from rasterjit.scene.validation import image_size, in_short, one_of, positive_number

if TYPE_CHECKING:
    from rasterjit.compat.pyrender import renderer

EXTRA_OUTPUTS = (
    "normal", "normal_camera", "geometric_normal", "position", "position_camera", "distance",
)  # fmt: skip
"""What `OffscreenRenderer.render` can return beside colour and depth."""


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
        self._platform = Platform(self.viewport_width, self.viewport_height)
        self._engine: Engine | None = None

    viewport_width = Field(int, "int: width of the picture, pixels.")
    viewport_height = Field(int, "int: height of the picture, pixels.")
    point_size = Field(number, "float: side of points, pixels.")

    @property
    def _renderer(self) -> renderer.Renderer:
        """The renderer below it, for programs that reach for pyrender's."""
        from rasterjit.compat.pyrender.renderer import Renderer as Below

        return Below._of(self)

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
            Only with ``outputs``: an array each, (H, W, C) or (H, W) float32, of the nearest
            surface at the middle of each pixel. Where nothing is, normals are 0, positions NaN and
            distances infinite.

        Raises
        ------
        ValueError
            If the scene has no camera, or something cannot be drawn.
        """
        if not isinstance(scene, Scene):
            raise ValueError(f"scene must be a Scene of this module, got {in_short(scene)}")
        wanted = check_flags(flags)
        extra = _names(outputs)
        size = image_size(
            "viewport_width, viewport_height", (self.viewport_width, self.viewport_height)
        )
        camera = camera_of(scene, size)
        points = camera, size, positive_number("point_size", self.point_size)
        if wanted & RenderFlags.SEG:
            found = self._segmented(scene, camera, wanted, dict(seg_node_map or {}), points)
        elif wanted & RenderFlags.DEPTH_ONLY:
            drawing = convert(scene, wanted, shapes_alone=True, points=points)
            found = None, _depth(self._draw(drawing, camera, ("depth",)), size)
        else:
            found = self._colored(scene, camera, wanted, points)
        color, depth = found
        arrays = (depth,) if wanted & RenderFlags.DEPTH_ONLY else (color, depth)
        if extra:
            only = set(seg_node_map or {}) if wanted & RenderFlags.SEG else None
            arrays += (self._extra(scene, camera, wanted, only, points, extra),)
        return arrays if len(arrays) > 1 else depth

    def delete(self) -> None:
        """Let threads and memory go; a later render takes them again."""
        if self._engine is not None:
            self._engine.close()
            self._engine = None

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
        frame = self._draw(drawing, camera, outputs, codes)
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
        for row, node in enumerate(drawing.owners):
            table[row] = _seg_color(colors[node])
        if frame is None:
            return np.zeros((size[1], size[0], 3), np.uint8), _depth(None, size)
        # Nothing is number -1: the last row, black.
        return table[frame.object_id], _depth(frame, size)

    def _extra(
        self,
        scene: Scene,
        camera: MatrixCamera,
        flags: RenderFlags,
        only: set[Node] | None,
        points: Any,
        names: tuple[str, ...],
    ) -> dict[str, NDArray[Any]]:
        """Render what else was asked for."""
        solid = convert(
            scene, flags | RenderFlags.ALL_SOLID, only=only, shapes_alone=True, points=points
        )
        frame = self._draw(solid, camera, names)
        if frame is not None:
            return {name: getattr(frame, name) for name in names}
        empty, size = {}, (self.viewport_height, self.viewport_width)
        for name, row in TABLE.items():
            if name in names:
                shape = size if row.channels == 1 else (*size, row.channels)
                empty[name] = np.full(shape, row.empty, row.dtype)
        return empty

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
        if self._engine is None or self._engine.size != size:
            self.delete()
            self._engine = Engine(size)
        return self._engine.render(drawing.scene, camera, outputs=outputs, background=background)


def _depth(frame: Frame | None, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return the depth with 0 where nothing is."""
    if frame is None:
        return np.zeros((size[1], size[0]), np.float32)
    depth = frame.depth
    return np.where(np.isfinite(depth), depth, np.float32(0.0))


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
        raise ValueError(f"seg_node_map must hold numbers or (3,) colors, got {in_short(value)}")
    return np.clip(np.rint(np.nan_to_num(np.ravel(given).astype(np.float64))), 0.0, 255.0)
