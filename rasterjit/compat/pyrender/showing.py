"""Show a scene that a program changes meanwhile, through a camera that the program has."""

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
from rasterjit.viewer.effect_switches import MODAL
from rasterjit.viewer.overlay import Row, write_panel


class Window:
    """
    A window that shows nothing by itself, for programs that place theirs or bring it forward.

    It is where it was put and as large as the viewer says; what else is done to it has no effect.
    """

    viewport_size: Any

    _place = (0, 0)
    _caption: str | None = None

    @property
    def _window(self) -> int:
        """A number that stands for it: programs wait until it is not None."""
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
        """Its title, as it was set."""
        return self._caption

    def get_size(self) -> tuple[int, int]:
        """Return width and height of the picture, pixels."""
        return self.width, self.height

    def get_location(self) -> tuple[int, int]:
        """Return x and y as they were set, pixels; at first 0."""
        return self._place

    def set_location(self, x: int, y: int) -> None:
        """Keep x and y, pixels."""
        self._place = x, y

    def set_caption(self, caption: str) -> None:
        """Keep a title."""
        self._caption = caption

    def set_size(self, width: int, height: int) -> None:
        """Do nothing: whoever looks chooses the size."""

    def set_fullscreen(self, fullscreen: bool = True, *_: Any, **__: Any) -> None:
        """Do nothing: whoever looks chooses the size."""

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

PATIENCE = 0.1
"""Seconds to wait for a program that changes its scene, before the last picture stays."""

SETTLED = 0.2
"""Seconds without a change after which pictures become better."""

MIN_SHARE = 4.0
"""A look at the scene is followed by so many times its own length without one."""

ARRAYS = (
    "vertices", "faces", "normals", "vertex_colors", "face_colors", "uv", "sizes", "widths"
)  # fmt: skip
"""What meshes, points and lines are made of."""

HELP: tuple[Row, ...] = (
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


class Lens(MatrixCamera):
    """A camera of any lens, with the place and the angles that pages tell."""

    @property
    def eye(self) -> NDArray[np.float64]:
        """Where it is, (3,), world space."""
        return self._pose[:3, 3]

    @property
    def target(self) -> NDArray[np.float64]:
        """A point in front of it, (3,), world space."""
        return self._pose[:3, 3] - self._pose[:3, 2]

    @property
    def up(self) -> NDArray[np.float64]:
        """The picture's up, (3,), world space."""
        return self._pose[:3, 1]

    @property
    def fov_y(self) -> float:
        """Vertical field of view, degrees, of a pinhole about as wide."""
        return 2.0 * math.degrees(math.atan(1.0 / abs(float(self.clip_from_view[1, 1]))))

    @property
    def _pose(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.inv(self.view_from_world), np.float64)


class Look(NamedTuple):
    """What is to be seen at a moment."""

    scene: Scene
    camera: Camera
    background: NDArray[Any]
    """(4,): opaque, codes or linear light."""


class Showing(viewer.Viewer):
    """
    Shows what a source has, as it is at each moment.

    Parameters
    ----------
    source : Viewer
        What has a scene that changes, and a lock that is held by who looks at it or changes it.
    size : (int, int)
        Width and height of the pictures, pixels.
    name : str
        What is shown.
    ends : bool
        Whether the source ends with it.

    Raises
    ------
    ValueError
        If something cannot be drawn.
    """

    is_live = True
    help_rows = HELP
    help_key = "?"

    def __init__(self, source: Any, size: tuple[int, int], name: str, ends: bool = True) -> None:
        self._source, self._ends = source, ends
        with source.render_lock:
            look = source.look(size)
        if look is None:
            raise ValueError("source must be one that goes on, got one that has ended")
        self._look = look
        self._due = self._changed_at = 0.0
        super().__init__(self._look.scene, self._look.camera, size=size, name=name)
        self._options["background"] = self._look.background
        self._is_fitted, self._shows_line = False, False

    def twin(self) -> Showing:
        """Return another that shows the same source, in a size of its own."""
        return Showing(self._source, self.size, self.name, ends=False)

    def close(self) -> None:
        """End what is being rendered, and the source with it."""
        super().close()
        if self._ends:
            self._source.end()

    @property
    def camera(self) -> Any:
        """The camera as it stands: of the source."""
        return self._look.camera

    @property
    def line(self) -> str:
        """What is shown, and how, after what the source says."""
        message = self._source.message
        return f"{message}   {super().line}" if message else super().line

    @property
    def shows_line(self) -> bool:
        """Whether the line is to be read where text has a place of its own; on pictures never."""
        return True

    @property
    def is_moving(self) -> bool:
        """Whether the scene or the camera changed just now."""
        return self._source.is_turning or time.monotonic() - self._changed_at < SETTLED

    def resize(self, size: tuple[int, int], ratio: float = 1.0) -> None:
        """Make pictures of another size from now on; ``ratio``: pixels for one of an event's."""
        before = self.size
        super().resize(size, ratio)
        if self.size != before:
            self._source.note_size(self.size)
            self._look_now()

    def handle(self, event: Event) -> None:
        """Take an event in."""
        width, height = self.size
        try:
            is_known = self._source.take(event, (width / self.ratio, height / self.ratio))
        except Exception as error:
            self._source.fail(error)
            return
        if is_known:
            self._look_now()
        elif event.get("event_type") == "key_down":
            key = str(event.get("key", ""))
            if key in viewer.KINDS or key == "Escape":
                self._handle_key(key)
            elif key == "?":
                self._shows_help = not self._shows_help

    def advance(self, seconds: float) -> None:
        """Look at the scene, if it is time to."""
        if time.monotonic() >= self._due:
            self._look_now()

    def look_from(self, camera: Any) -> None:
        """Put the source's camera where another stands."""
        self._source.look_from(np.linalg.inv(camera.view_matrix()))
        self._look_now()

    def _look_now(self) -> None:
        """Show the scene as it is, unless the program holds it."""
        source, began = self._source, time.monotonic()
        if not source.render_lock.acquire(timeout=PATIENCE):
            return
        try:
            look = source.look(self.size)
            is_new = look is not None and self._take(look)
        except Exception as error:
            source.fail(error)
            return
        finally:
            source.render_lock.release()
        now = time.monotonic()
        self._due = max(began + source.looks_each, now + MIN_SHARE * (now - began))
        if is_new:
            self._changed_at = now
            self._invalidate()

    def _take(self, look: Look) -> bool:
        """Take what is to be seen, and tell whether it is something else than before."""
        before = self._look
        is_same_view = before.camera is look.camera or _same_camera(before.camera, look.camera)
        is_same_scene = same_scene(before.scene, look.scene)
        is_same_back = np.array_equal(before.background, look.background)
        if is_same_view and is_same_scene and is_same_back:
            return False
        self._look = look if not is_same_view else look._replace(camera=before.camera)
        self._options["background"] = look.background
        if is_same_scene:
            return True
        self.scene = self._visible = look.scene
        self._modes = {key: one.mode_of(look.scene) for key, one in MODAL.items()}
        if self._switched or self._hidden:
            # Times of pictures stay known, as near as they are.
            times = self._times
            self._rebuild()
            self._times = times
        return True

    def _draw_overlay(self, picture: NDArray[np.uint8]) -> None:
        """Write what is to be read on a picture."""
        super()._draw_overlay(picture)
        if self.writes_text and (message := self._source.message):
            write_panel(picture, [(message,)], "bottom right", self.ratio)

    @property
    def stamp(self) -> tuple[Any, ...]:
        """What the picture depends on."""
        return *super().stamp, self._source.message


def same_scene(one: Scene, other: Scene) -> bool:
    """Tell whether two scenes show the same."""
    return (
        len(one.nodes) == len(other.nodes)
        and one.lights == other.lights
        and (one._reference is other._reference or _same_light(one._reference, other._reference))
        and all(getattr(one, name) == getattr(other, name) for name in EFFECT_FIELDS)
        and all(_same_node(a, b) for a, b in zip(one.nodes, other.nodes, strict=True))
    )


def _same_light(one: Any, other: Any) -> bool:
    return one is not None and one.equals(other)


def _same_node(one: Node, other: Node) -> bool:
    return (
        one.name == other.name
        and np.array_equal(one.transform, other.transform)
        and (one.mesh is other.mesh or _same_mesh(one.mesh, other.mesh))
    )


def _same_mesh(one: Any, other: Any) -> bool:
    """Tell whether two meshes are: points are made anew for each look."""
    if type(one) is not type(other) or one.material != other.material:
        return False
    return all(_same_array(getattr(one, name, None), getattr(other, name, None)) for name in ARRAYS)


def _same_array(one: Any, other: Any) -> bool:
    return one is other or (one is not None and other is not None and np.array_equal(one, other))


def _same_camera(one: Camera, other: Camera) -> bool:
    if isinstance(one, PerspectiveCamera) or isinstance(other, PerspectiveCamera):
        return bool(one == other)
    return np.array_equal(one.view_from_world, other.view_from_world) and np.array_equal(
        one.clip_from_view, other.clip_from_view
    )
