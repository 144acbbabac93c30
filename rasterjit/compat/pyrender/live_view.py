"""Show a scene that a program changes meanwhile, through the program's camera."""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.camera import MatrixCamera, PerspectiveCamera
from rasterjit.scene.node import Node
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.viewer import viewer
from rasterjit.viewer.controls import Event
from rasterjit.viewer.effect_switches import MODAL_EFFECTS
from rasterjit.viewer.overlay import Row, write_panel


class Window:
    """
    A window by pyglet's interface that shows nothing, for programs that move or raise theirs.

    It keeps its position and caption and is as large as the viewer says; all else has no effect.
    """

    viewport_size: Any

    _location = (0, 0)
    _caption: str | None = None

    @property
    def _window(self) -> int:
        """A number: programs wait until it is not None."""
        return id(self)

    @property
    def width(self) -> int:
        """Width of the picture, pixels."""
        return int(self.viewport_size[0])

    @property
    def height(self) -> int:
        """Height of the picture, pixels."""
        return int(self.viewport_size[1])

    @property
    def caption(self) -> str | None:
        """The title as it was set."""
        return self._caption

    def get_size(self) -> tuple[int, int]:
        """Return width and height of the picture, pixels."""
        return self.width, self.height

    def get_location(self) -> tuple[int, int]:
        """Return x and y as they were set, pixels; 0 by default."""
        return self._location

    def set_location(self, x: int, y: int) -> None:
        """Keep x and y, pixels."""
        self._location = x, y

    def set_caption(self, caption: str) -> None:
        """Keep a title."""
        self._caption = caption

    def set_size(self, width: int, height: int) -> None:
        """Do nothing: the backend chooses the size."""

    def set_fullscreen(self, fullscreen: bool = True, *_: Any, **__: Any) -> None:
        """Do nothing: the backend chooses the size."""

    def set_visible(self, visible: bool = True) -> None:
        """Do nothing."""

    def set_mouse_visible(self, visible: bool = True) -> None:
        """Do nothing."""

    def activate(self) -> None:
        """Do nothing."""

    def minimize(self) -> None:
        """Do nothing."""

    def maximize(self) -> None:
        """Do nothing."""

    def switch_to(self) -> None:
        """Do nothing: there is no context of OpenGL."""

    def flip(self) -> None:
        """Do nothing: what was drawn is shown at once."""

    def clear(self) -> None:
        """Do nothing: what was drawn goes with the next picture."""

    def dispatch_events(self) -> None:
        """Do nothing: events come by themselves."""


Camera = PerspectiveCamera | MatrixCamera

LOCK_TIMEOUT_SECONDS = 0.1
"""Time to wait for a program that holds its scene before the last picture stays."""

SETTLE_SECONDS = 0.2
"""Time without a change after which pictures are refined."""

MIN_PAUSE_RATIO = 4.0
"""Least ratio of the pause after a snapshot to the time that the snapshot took."""

GEOMETRY_ARRAYS = (
    "vertices", "faces", "normals", "vertex_colors", "face_colors", "uv", "sizes", "widths"
)  # fmt: skip
"""Arrays of meshes, points and lines."""

HELP_ROWS: tuple[Row, ...] = (
    ("drag", "turn"),
    ("Ctrl drag", "roll"),
    ("Shift or middle drag", "pan"),
    ("wheel, right drag", "zoom"),
    ("A", "turn by itself"),
    ("C  H  W", "back faces, shadows, wireframe"),
    ("I  M  N", "axes, normals of faces and vertices"),
    ("L  O", "light, orthographic"),
    ("R  S", "record a GIF, save a picture"),
    ("F  Z", "fit the scene, return to the start"),
    ("Q", "close"),
    ("1 2 3 4 5", "colour, depth, normals, objects, faces"),
    ("?", "hide this help"),
)


class PosedCamera(MatrixCamera):
    """A camera of any projection, with the position, axes and angle that pages show."""

    @property
    def eye(self) -> NDArray[np.float64]:
        """Position, (3,), world space."""
        return self._pose[:3, 3]

    @property
    def target(self) -> NDArray[np.float64]:
        """A point one unit in front of the eye, (3,), world space."""
        return self._pose[:3, 3] - self._pose[:3, 2]

    @property
    def up(self) -> NDArray[np.float64]:
        """Upward axis of the picture, (3,), world space."""
        return self._pose[:3, 1]

    @property
    def fov_y(self) -> float:
        """Vertical field of view of a pinhole with the same vertical scale, degrees."""
        return 2.0 * math.degrees(math.atan(1.0 / abs(float(self.clip_from_view[1, 1]))))

    @property
    def _pose(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.inv(self.view_from_world), np.float64)


class Snapshot(NamedTuple):
    """The scene, camera and background at one moment."""

    scene: Scene
    camera: Camera
    background: NDArray[Any]
    """(4,), opaque: sRGB codes or linear light."""


class LiveView(viewer.Viewer):
    """
    A viewer of a source whose scene and camera change by themselves.

    Parameters
    ----------
    source : Viewer
        Has the scene, and a lock that is held while it is read or changed.
    size : (int, int)
        Width and height of the pictures, pixels.
    name : str
        Name in the status line.
    ends_source : bool
        Whether closing this viewer ends the source.

    Raises
    ------
    ValueError
        If something cannot be drawn.
    """

    is_live = True
    help_rows = HELP_ROWS
    help_key = "?"

    def __init__(
        self, source: Any, size: tuple[int, int], name: str, ends_source: bool = True
    ) -> None:
        self._source, self._ends_source = source, ends_source
        with source.render_lock:
            snapshot = source.capture(size)
        if snapshot is None:
            raise ValueError("source must be active, got one that has ended")
        self._snapshot = snapshot
        self._due = self._changed_at = 0.0
        super().__init__(self._snapshot.scene, self._snapshot.camera, size=size, name=name)
        self._options["background"] = self._snapshot.background
        self._is_fitted, self._shows_line = False, False

    def twin(self) -> LiveView:
        """Return another viewer of the same source, whose size changes apart from this one's."""
        return LiveView(self._source, self.size, self.name, ends_source=False)

    def close(self) -> None:
        """Stop rendering, and end the source if it belongs to this viewer."""
        super().close()
        if self._ends_source:
            self._source.end()

    @property
    def camera(self) -> Any:
        """The source's camera at the last snapshot."""
        return self._snapshot.camera

    @property
    def line(self) -> str:
        """The status line, after the source's message."""
        message = self._source.message
        return f"{message}   {super().line}" if message else super().line

    @property
    def shows_line(self) -> bool:
        """Whether to show the status line beside pictures: always; it is never drawn on them."""
        return True

    @property
    def is_moving(self) -> bool:
        """Whether the scene or the camera changed within the last ``SETTLE_SECONDS``."""
        return self._source.is_rotating or time.monotonic() - self._changed_at < SETTLE_SECONDS

    def resize(self, size: tuple[int, int], ratio: float = 1.0) -> None:
        """Change the size of the pictures; ``ratio``: picture pixels for one of an event's."""
        before = self.size
        super().resize(size, ratio)
        if self.size != before:
            self._source.apply_picture_size(self.size)
            self._update()

    def handle(self, event: Event) -> None:
        """Pass an event to the source, else handle the keys of pictures and help."""
        width, height = self.size
        try:
            is_known = self._source.handle_event(event, (width / self.ratio, height / self.ratio))
        except Exception as error:
            self._source.fail(error)
            return
        if is_known:
            self._update()
        elif event.get("event_type") == "key_down":
            key = str(event.get("key", ""))
            if key in viewer.KIND_KEYS or key == "Escape":
                self._handle_key(key)
            elif key == "?":
                self._shows_help = not self._shows_help

    def advance(self, seconds: float) -> None:
        """Update from the source if an update is due."""
        if time.monotonic() >= self._due:
            self._update()

    def look_from(self, camera: Any) -> None:
        """Move the source's camera to the pose of another."""
        self._source.set_camera_pose(np.linalg.inv(camera.view_matrix()))
        self._update()

    def _update(self) -> None:
        """Show the scene as it is now, unless the program holds it for long."""
        source, began = self._source, time.monotonic()
        if not source.render_lock.acquire(timeout=LOCK_TIMEOUT_SECONDS):
            return
        try:
            snapshot = source.capture(self.size)
            is_new = snapshot is not None and self._apply_snapshot(snapshot)
        except Exception as error:
            source.fail(error)
            return
        finally:
            source.render_lock.release()
        now = time.monotonic()
        self._due = max(began + source.refresh_interval, now + MIN_PAUSE_RATIO * (now - began))
        if is_new:
            self._changed_at = now
            self._invalidate()

    def _apply_snapshot(self, snapshot: Snapshot) -> bool:
        """Show a snapshot; tell whether it differs from the one before."""
        before = self._snapshot
        is_same_view = _is_same_camera(before.camera, snapshot.camera)
        is_same_scene = scenes_look_alike(before.scene, snapshot.scene)
        is_same_background = np.array_equal(before.background, snapshot.background)
        if is_same_view and is_same_scene and is_same_background:
            return False
        self._snapshot = snapshot if not is_same_view else snapshot._replace(camera=before.camera)
        self._options["background"] = snapshot.background
        if is_same_scene:
            return True
        self.scene = self._visible = snapshot.scene
        self._modes = {key: one.mode_of(snapshot.scene) for key, one in MODAL_EFFECTS.items()}
        if self._switched or self._hidden:
            # The measured times still hold about.
            times = self._times
            self._rebuild()
            self._times = times
        return True

    def _draw_overlay(self, picture: NDArray[np.uint8]) -> None:
        """Draw the usual overlay and the source's message."""
        super()._draw_overlay(picture)
        if self.writes_text and (message := self._source.message):
            write_panel(picture, [(message,)], "bottom right", self.ratio)

    @property
    def stamp(self) -> tuple[Any, ...]:
        """A key of the picture: while it is equal, so is what `draw` returns."""
        return *super().stamp, self._source.message


def scenes_look_alike(one: Scene, other: Scene) -> bool:
    """Tell whether two scenes give the same pictures."""
    return (
        len(one.nodes) == len(other.nodes)
        and one.lights == other.lights
        and _is_same_reference(one._reference_shading, other._reference_shading)
        and all(getattr(one, name) == getattr(other, name) for name in EFFECT_FIELDS)
        and all(_is_same_node(a, b) for a, b in zip(one.nodes, other.nodes, strict=True))
    )


def _is_same_reference(one: Any, other: Any) -> bool:
    return one is other or (one is not None and one.equals(other))


def _is_same_node(one: Node, other: Node) -> bool:
    return (
        one.name == other.name
        and np.array_equal(one.transform, other.transform)
        and (one.mesh is other.mesh or _is_same_mesh(one.mesh, other.mesh))
    )


def _is_same_mesh(one: Any, other: Any) -> bool:
    """Tell whether two meshes are equal: each snapshot has new `Points`."""
    if type(one) is not type(other) or one.material != other.material:
        return False
    return all(
        _is_same_array(getattr(one, name, None), getattr(other, name, None))
        for name in GEOMETRY_ARRAYS
    )


def _is_same_array(one: Any, other: Any) -> bool:
    return one is other or (one is not None and other is not None and np.array_equal(one, other))


def _is_same_camera(one: Camera, other: Camera) -> bool:
    if one is other:
        return True
    if isinstance(one, PerspectiveCamera) or isinstance(other, PerspectiveCamera):
        return bool(one == other)
    return np.array_equal(one.view_from_world, other.view_from_world) and np.array_equal(
        one.clip_from_view, other.clip_from_view
    )
