"""
Show scenes in a window, a page or a notebook, while the program goes on or until they are closed.

References
----------
pyrender 0.1.45, module ``viewer``: arguments, flags, keys and the way of the camera.
"""

from __future__ import annotations

import _thread
import contextlib
import copy
import math
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.animation.video import save_animation
from rasterjit.compat.pyrender import conversion
from rasterjit.compat.pyrender.camera import (
    Camera,
    IntrinsicsCamera,
    OrthographicCamera,
    PerspectiveCamera,
)
from rasterjit.compat.pyrender.constants import (
    DEFAULT_SCENE_SCALE,
    DEFAULT_Z_FAR,
    DEFAULT_Z_NEAR,
    RenderFlags,
)
from rasterjit.compat.pyrender.fields import Field, NoOpenGLError, keep_any
from rasterjit.compat.pyrender.light import DirectionalLight
from rasterjit.compat.pyrender.live_view import LiveView, PosedCamera, Snapshot, Window
from rasterjit.compat.pyrender.mesh import Mesh
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.scene import Scene
from rasterjit.compat.pyrender.trackball import Trackball
from rasterjit.rendering.renderer import Renderer
from rasterjit.scene import transforms
from rasterjit.scene.camera import PerspectiveCamera as MovableCamera
from rasterjit.scene.mesh import Mesh as DrawnMesh
from rasterjit.scene.scene import Scene as DrawnScene
from rasterjit.scene.validation import brief, image_size
from rasterjit.scene.vectors import length
from rasterjit.viewer import browser, canvas, notebook, show, terminal, window_probe
from rasterjit.viewer.controls import Event

DEFAULT_SIZE = 640, 480

LEFT_BUTTON, MIDDLE_BUTTON, RIGHT_BUTTON = 1, 2, 4
"""Mouse buttons by pyglet's numbers."""

PYGLET_BUTTONS = {1: LEFT_BUTTON, 2: RIGHT_BUTTON, 3: MIDDLE_BUTTON}
"""Pyglet's number of a button by that of an event."""

PYGLET_MODIFIERS = {"Shift": 1, "Control": 2, "Alt": 4}
"""Pyglet's bit of a modifier key by its name in events."""

WHEEL_UNITS_PER_CLICK = 100.0
"""Units of a wheel event for one click."""

ORTHOGRAPHIC_ZOOM_PER_CLICK = 0.95
"""Factor on the extent of a parallel camera for one click of the wheel."""

MIN_MAGNIFICATION = 1e-8

MESSAGE_SECONDS = 2.0
"""Time for which a message is shown."""

END_TIMEOUT_SECONDS = 1.0
"""Time that `Viewer.end` waits for a program that holds the scene."""

MAX_PICTURES_PER_SECOND = 50.0
"""Highest frame rate of saved animations: programs show no more."""

ORTHONORMAL_TOLERANCE = 1e-6
"""Largest error of the products of a rigid pose's axes."""

_RAYMOND_AZIMUTHS = (0.0, 120.0, 240.0)
_RAYMOND_TILT = 30.0
"""Directions of three lights around the camera; the tilt is from its backward axis. Degrees."""

_WINDOW_LOCK = threading.Lock()
"""Held by the viewer that has a window: a process has one event loop for windows."""

_DEFAULT_RENDER_FLAGS: dict[str, Any] = {
    "flip_wireframe": False,
    "all_wireframe": False,
    "all_solid": False,
    "shadows": False,
    "vertex_normals": False,
    "face_normals": False,
    "cull_faces": True,
    "point_size": 1.0,
}

_DEFAULT_VIEWER_FLAGS: dict[str, Any] = {
    "mouse_pressed": False,
    "rotate": False,
    "rotate_rate": math.pi / 3.0,
    "rotate_axis": (0.0, 0.0, 1.0),
    "view_center": None,
    "record": False,
    "use_raymond_lighting": False,
    "use_direct_lighting": False,
    "lighting_intensity": 3.0,
    "use_perspective_cam": True,
    "save_directory": None,
    "window_title": "Scene Viewer",
    "refresh_rate": 30.0,
    "fullscreen": False,
    "show_world_axis": False,
    "show_mesh_axes": False,
    "caption": None,
}

_KEY_METHODS = {
    "f": "_fit_view",
    "i": "_switch_axes",
    "l": "_switch_lighting",
    "o": "_switch_camera",
    "q": "on_close",
    "r": "_switch_recording",
    "s": "_save_image",
    "w": "_switch_wireframe",
    "z": "_reset_view",
}
"""Names of the methods that keys call."""

_FLAG_KEYS = {
    "a": ("rotate", "Rotation"),
    "c": ("cull_faces", "Cull Faces"),
    "h": ("shadows", "Shadows"),
    "m": ("face_normals", "Face Normals"),
    "n": ("vertex_normals", "Vert Normals"),
}
"""Keys that switch a flag: name and label of the flag."""


class Viewer(Window):
    """
    A viewer of a scene, in a window if one opens here, else in a page, or in a notebook.

    It has the keys and the mouse of pyrender's; ? lists them. Where no window opens, a line says
    where the page is; it is served until the viewer is closed, by the program or with Q, or until
    Ctrl-C ends the program: also where nobody looks at it. An error that ends the program ends a
    viewer in a thread, too. In a thread windows are GLFW's: those of Qt, and all of macOS, are for
    the main thread of a program, so a page comes in their place.

    The viewer looks through a camera of its own, which is added to the scene while it is shown and
    begins where the scene's main camera is.

    Parameters
    ----------
    scene : Scene
        May be changed while it is shown: by a thread that holds `render_lock`, or by functions of
        ``registered_keys``.
    viewport_size : (int, int), optional
        Width and height at first, pixels; default 640 by 480.
    render_flags, viewer_flags : mapping, optional
        Those of pyrender. ``fullscreen`` and ``caption`` have no effect.
    registered_keys : mapping of str to (callable, list, dict), optional
        What a key calls: a function of this viewer, and further arguments, positional and by
        keyword; or a function alone.
    run_in_thread : bool
        Whether this returns at once. A notebook always goes on at once.
    **kwargs
        Flags by keyword, and ``auto_start``: False waits for `start`.

    Raises
    ------
    ValueError
        If the scene is none, or something cannot be drawn.
    ImportError
        If nothing is installed that could show it, naming the extra to install.
    """

    def __init__(
        self,
        scene: Scene,
        viewport_size: tuple[int, int] | None = None,
        render_flags: Mapping[str, Any] | None = None,
        viewer_flags: Mapping[str, Any] | None = None,
        registered_keys: Mapping[str, Any] | None = None,
        run_in_thread: bool = False,
        **kwargs: Any,
    ) -> None:
        if not isinstance(scene, Scene):
            raise ValueError(f"scene must be a Scene of this module, got {brief(scene)}")
        self._scene = scene
        self._viewport_size = image_size(
            "viewport_size", DEFAULT_SIZE if viewport_size is None else viewport_size
        )
        self._run_in_thread = bool(run_in_thread)
        starts = kwargs.pop("auto_start", True)
        self._render_lock = threading.RLock()
        self._is_active = self._should_close = self._is_started = False
        self._render_flags = {**_DEFAULT_RENDER_FLAGS, **(render_flags or {})}
        self._viewer_flags = {
            **_DEFAULT_VIEWER_FLAGS, "rotate_axis": np.array(_DEFAULT_VIEWER_FLAGS["rotate_axis"]),
            **(viewer_flags or {}),
        }  # fmt: skip
        for name, value in kwargs.items():
            for flags in (self._render_flags, self._viewer_flags):
                if name in flags:
                    flags[name] = value
                    break
        self._registered_keys = {
            ord(key.lower()): value for key, value in (registered_keys or {}).items()
        }
        self._message, self._message_until = "", 0.0
        # Programs read and write these two of pyrender's; they have no effect.
        self._ticks_till_fade = 2.0 / 3.0 * float(self._viewer_flags["refresh_rate"])
        self._message_opac = 1.0 + self._ticks_till_fade
        self._saved_frames: list[NDArray[np.uint8]] = []
        self._error: BaseException | None = None
        self._close_backend: Callable[[], Any] | None = None
        self._thread: threading.Thread | None = None
        conversion.check_flags(self._combine_render_flags())
        self._add_viewer_nodes()
        try:
            self._live_view = LiveView(
                self, self._viewport_size, self._viewer_flags["window_title"]
            )
        except BaseException:
            self.end()
            raise
        if starts:
            self.start()

    # What programs read and change.

    @property
    def scene(self) -> Scene:
        """The scene that is shown."""
        return self._scene

    @property
    def viewport_size(self) -> tuple[int, int]:
        """Width and height of the picture, pixels."""
        return self._viewport_size

    @property
    def render_lock(self) -> Any:
        """Reentrant lock: while a program holds it, the viewer does not read the scene."""
        return self._render_lock

    @property
    def is_active(self) -> bool:
        """Whether the viewer is open."""
        return self._is_active

    @property
    def run_in_thread(self) -> bool:
        """Whether the viewer runs in a thread while the program goes on."""
        return self._run_in_thread

    render_flags = Field[dict[str, Any]](
        keep_any, "dict: how the scene is drawn, by name; may be changed as it is shown."
    )
    viewer_flags = Field[dict[str, Any]](
        keep_any, "dict: how the viewer behaves, by name; likewise."
    )
    registered_keys = Field[dict[int, Any]](keep_any, "dict: what a key calls, by its number.")

    @property
    def _renderer(self) -> Any:
        """Raise `NoOpenGLError` where programs reach into pyrender's OpenGL."""
        raise NoOpenGLError("Viewer._renderer")

    def start(self) -> None:
        """Show the viewer if it was made with ``auto_start=False``; once shown, do nothing."""
        if self._is_started or not self._is_active:
            return
        self._is_started = True
        try:
            self._run_backend(self._choose_backend())
        except BaseException:
            self.end()
            raise

    def close(self) -> None:
        """Close the viewer from any thread, without waiting."""
        self._should_close = True
        stop = self._close_backend
        if stop is not None:
            stop()
        elif not self._is_started:
            self.end()

    def close_external(self) -> None:
        """Close the viewer from another thread, and wait until the scene is restored."""
        self.close()
        while self._is_active and threading.current_thread() is not self._thread:
            time.sleep(self.refresh_interval)

    def save_gif(self, filename: str | Path | None = None) -> None:
        """
        Write the recorded pictures to a file, and release them.

        With the flag ``record`` and in a thread, close the viewer first. Where nothing was
        recorded, nothing is written.

        Parameters
        ----------
        filename : str or Path, optional
            An animation of any kind that `rasterjit.animation.save` knows. Default: a new
            ``recording.gif`` in the folder of the flag ``save_directory``, else in the current one.

        Raises
        ------
        ValueError
            If the folder does not exist, or the extension is unknown.
        """
        pictures, self._saved_frames = self._saved_frames, []
        if not pictures:
            return
        path = self._unused_path("recording.gif") if filename is None else Path(filename)
        self._viewer_flags["save_directory"] = str(path.parent)
        rate = min(max(float(self._viewer_flags["refresh_rate"]), 1.0), MAX_PICTURES_PER_SECOND)
        shape = pictures[-1].shape
        alike = (picture for picture in pictures if picture.shape == shape)
        save_animation(path, (_add_opaque_alpha(picture) for picture in alike), rate)
        self._show_message(f"{path} saved")

    def on_close(self) -> None:
        """Restore the scene and close the viewer."""
        self.end()
        self.close()

    def on_draw(self) -> None:
        """Prepare the scene for a snapshot; called before each, does nothing unless overridden."""

    def on_resize(self, width: int, height: int) -> None:
        """Take the size of the window, pixels."""
        self._viewport_size = width, height
        self._trackball.resize(self._viewport_size)

    def on_mouse_press(self, x: float, y: float, buttons: int, modifiers: int) -> None:
        """Begin a drag at a pixel, y up; buttons and modifiers are pyglet's numbers."""
        state = Trackball.STATE_ROTATE
        if buttons == LEFT_BUTTON:
            is_rolling, is_panning = modifiers & PYGLET_MODIFIERS["Control"], modifiers & 1
            if is_rolling:
                state = Trackball.STATE_ZOOM if is_panning else Trackball.STATE_ROLL
            elif is_panning:
                state = Trackball.STATE_PAN
        elif buttons == MIDDLE_BUTTON:
            state = Trackball.STATE_PAN
        elif buttons == RIGHT_BUTTON:
            state = Trackball.STATE_ZOOM
        self._trackball.set_state(state)
        self._trackball.down(np.array([x, y]))
        self._viewer_flags["mouse_pressed"] = True

    def on_mouse_drag(
        self, x: float, y: float, dx: float, dy: float, buttons: int, modifiers: int
    ) -> None:
        """Drag to a pixel, y up."""
        self._trackball.drag(np.array([x, y]))

    def on_mouse_release(self, x: float, y: float, button: int, modifiers: int) -> None:
        """End a drag."""
        self._viewer_flags["mouse_pressed"] = False

    def on_mouse_scroll(self, x: float, y: float, dx: float, dy: float) -> None:
        """Zoom by clicks of the wheel, closer where ``dy`` is above 0."""
        camera = self._camera_node.camera
        if self._viewer_flags["use_perspective_cam"] or not isinstance(camera, OrthographicCamera):
            self._trackball.scroll(dy)
            return
        factor = ORTHOGRAPHIC_ZOOM_PER_CLICK**dy
        shape = camera.ymag / camera.xmag
        camera.xmag = max(camera.xmag * factor, MIN_MAGNIFICATION)
        camera.ymag = camera.xmag * shape

    def on_key_press(self, symbol: int, modifiers: int) -> None:
        """Call the function registered for a key, else the viewer's own."""
        registered = self._registered_keys.get(symbol)
        if registered is not None:
            _call_registered(registered, self)
            return
        key = chr(symbol) if 0 <= symbol <= sys.maxunicode else ""
        if key in _FLAG_KEYS:
            self._switch_flag(*_FLAG_KEYS[key])
        elif key in _KEY_METHODS:
            getattr(self, _KEY_METHODS[key])()

    # What `LiveView` calls.

    @property
    def refresh_interval(self) -> float:
        """Time between two snapshots of the scene, seconds."""
        return 1.0 / min(max(float(self._viewer_flags["refresh_rate"]), 1.0), 120.0)

    @property
    def is_rotating(self) -> bool:
        """Whether the camera rotates by itself now."""
        flags = self._viewer_flags
        return self._is_active and bool(flags["rotate"]) and not flags["mouse_pressed"]

    @property
    def message(self) -> str:
        """The current message; empty when its time is over."""
        return self._message if time.monotonic() < self._message_until else ""

    def capture(self, size: tuple[int, int]) -> Snapshot | None:
        """Return the scene as it is now, for a picture of a size; None if the viewer is closed."""
        if not self._is_active:
            return None
        if self._is_started:
            self.on_draw()
        scene, flags = self._scene, conversion.check_flags(self._combine_render_flags())
        self._camera_node.matrix = self._trackball.pose
        self._set_lights()
        matrices = conversion.make_camera(scene, size)
        node = scene.main_camera_node or self._camera_node
        pose = scene.get_pose(node)
        camera = _perspective_camera_at(node.camera, pose) or PosedCamera(
            matrices.view_from_world, matrices.clip_from_view
        )
        viewpoint = conversion.Viewpoint(matrices, size, float(self._render_flags["point_size"]))
        drawn = conversion.convert_scene(scene, flags, viewpoint=viewpoint).scene
        codes = conversion.quantize_background(scene)
        codes[3] = 255
        if not drawn.nodes:
            # A scene must not be empty: add a face without area, which is never seen.
            drawn = DrawnScene()
            drawn.add(DrawnMesh([self._trackball.pose[:3, 3]] * 3, [[0, 1, 2]]))
            return Snapshot(drawn, camera, codes)
        if not scene.light_nodes and not scene.ambient_light.any():
            # A window that is black helps nobody.
            conversion.add_lights(drawn, [(DirectionalLight(intensity=math.pi), pose)])
        return Snapshot(drawn, camera, conversion.decode_background(codes, flags))

    def handle_event(self, event: Event, size: tuple[float, float]) -> bool:
        """Handle an event of a canvas of a logical size; tell whether it had an effect."""
        kind = event.get("event_type")
        x, y = event.get("x", 0.0), size[1] - event.get("y", 0.0)
        held = sum(PYGLET_MODIFIERS.get(name, 0) for name in event.get("modifiers", ()))
        with self._render_lock:
            if not self._is_active:
                return False
            self._trackball.resize(size)
            if kind == "pointer_down":
                self.on_mouse_press(x, y, PYGLET_BUTTONS.get(event.get("button", 0), 0), held)
            elif kind == "pointer_move" and self._viewer_flags["mouse_pressed"]:
                self.on_mouse_drag(x, y, 0.0, 0.0, 0, held)
            elif kind == "pointer_up":
                self.on_mouse_release(x, y, PYGLET_BUTTONS.get(event.get("button", 0), 0), held)
            elif kind == "wheel":
                self.on_mouse_scroll(x, y, 0.0, -event.get("dy", 0.0) / WHEEL_UNITS_PER_CLICK)
            elif kind == "key_down" and len(str(event.get("key", ""))) == 1:
                symbol = ord(event["key"].lower()[0])
                if symbol not in self._registered_keys and chr(symbol) not in {
                    *_KEY_METHODS,
                    *_FLAG_KEYS,
                }:
                    return False
                self.on_key_press(symbol, held)
            else:
                return False
        return True

    def set_camera_pose(self, pose: NDArray[np.float64]) -> None:
        """Move the camera to a pose, (4, 4); it keeps the point that it rotates around."""
        with self._render_lock:
            self._trackball = self._make_trackball(pose)

    def apply_picture_size(self, size: tuple[int, int]) -> None:
        """Call `on_resize` with the new size of the picture, pixels."""
        with self._render_lock:
            self.on_resize(*size)

    def fail(self, error: Exception) -> None:
        """Close the viewer because of an error, which is raised where the viewer runs."""
        if self._error is None:
            self._error = error
        self.close()

    def end(self) -> None:
        """Restore the scene and become inactive."""
        # A program that holds the lock may be waiting for this.
        is_held = self._render_lock.acquire(timeout=END_TIMEOUT_SECONDS)
        try:
            if not self._is_active:
                return
            self._set_axes(False, False)
            for node in (*self._raymond_lights, self._direct_light, self._camera_node):
                if self._scene.has_node(node):
                    self._scene.remove_node(node)
            prior = self._prior_main_camera_node
            if prior is not None and self._scene.has_node(prior):
                self._scene.main_camera_node = prior
            self._is_active = False
        finally:
            if is_held:
                self._render_lock.release()

    # Begin and run.

    def _choose_backend(self) -> str:
        """Return the name of the backend to show in."""
        backend = show.choose_backend("auto")
        is_main = threading.current_thread() is threading.main_thread() and not self._run_in_thread
        is_fit = is_main or _can_open_window_in_thread()
        if backend == "window" and not (is_fit and _WINDOW_LOCK.acquire(blocking=False)):
            return "browser"
        if backend == "terminal" and not is_main:
            raise ImportError('a viewer in a thread needs a page: pip install "rasterjit[browser]"')
        return backend

    def _add_viewer_nodes(self) -> None:
        """Add the viewer's camera and axes to the scene, and make its lights."""
        scene = self._scene
        prior = scene.main_camera_node
        self._prior_main_camera_node = prior
        self._default_persp_cam: Camera | None = None
        self._default_orth_cam: Camera | None = None
        near, far, pose = None, None, None
        if prior is not None and prior.camera is not None:
            camera = copy.copy(prior.camera)
            near, far, pose = camera.znear, camera.zfar, scene.get_pose(prior)
            if isinstance(camera, (PerspectiveCamera, IntrinsicsCamera)):
                self._default_persp_cam = camera
            elif isinstance(camera, OrthographicCamera):
                self._default_orth_cam = camera
        scale = scene.scale
        if far is None:
            far = max(10.0 * scale, DEFAULT_Z_FAR)
        if not near:
            near = min(scale / 10.0, DEFAULT_Z_NEAR) if scale else DEFAULT_Z_NEAR
        if self._default_persp_cam is None:
            self._default_persp_cam = PerspectiveCamera(math.pi / 3.0, znear=near, zfar=far)
        if self._default_orth_cam is None:
            half = scale or 1.0
            self._default_orth_cam = OrthographicCamera(half, half, znear=near, zfar=far)
        self._default_camera_pose = self._default_pose() if pose is None else pose
        is_perspective = self._viewer_flags["use_perspective_cam"]
        self._camera_node = Node(
            matrix=self._default_camera_pose,
            camera=self._default_persp_cam if is_perspective else self._default_orth_cam,
        )
        self._raymond_lights = self._create_raymond_lights()
        self._direct_light = self._create_direct_light()
        self._axes: dict[Node | str, Node] = {}
        if self._viewer_flags["show_world_axis"]:
            self._set_axes(True, self._viewer_flags["show_mesh_axes"])
        scene.add_node(self._camera_node)
        scene.main_camera_node = self._camera_node
        self._trackball = self._make_trackball(self._default_camera_pose)
        self._is_active = True

    def _run_backend(self, backend: str) -> None:
        """Show the viewer; return when it is closed, or at once if it runs in a thread."""
        threading.Thread(
            target=self._rotate_and_record, name="rasterjit-pyrender", daemon=True
        ).start()
        if backend == "notebook":
            from IPython.display import display

            widget = notebook.make_widget(self._live_view)
            display(widget)
            self._set_stop(lambda: (widget.close(), self.end()))
        elif self._run_in_thread:
            register = getattr(threading, "_register_atexit", None)
            self._thread = threading.Thread(
                target=self._show_until_closed,
                args=(backend,),
                name="rasterjit-viewer",
                daemon=register is not None,
            )
            self._thread.start()
            if register is not None:
                # Called before the drawing thread pools shut down.
                register(self._wait_until_closed)
        else:
            self._show_until_closed(backend)

    def _show_until_closed(self, backend: str) -> None:
        """Run a backend until the viewer is closed; then restore the scene."""
        title = str(self._viewer_flags["window_title"])
        try:
            if backend == "window":
                window, loop = canvas.make_window(self._live_view, title)

                async def close_in_time() -> None:
                    await self._close_window_when_requested(window)

                loop.add_task(close_in_time)
                loop.run()
            elif backend == "browser":
                browser.serve(self._live_view, port=_choose_port(), on_start=self._set_stop)
            else:
                self._set_stop(_thread.interrupt_main)
                terminal.run_in_terminal(self._live_view, title)
        except KeyboardInterrupt:
            if not (backend == "terminal" and self._should_close):
                raise
        finally:
            if backend == "window":
                _WINDOW_LOCK.release()
            self._close_backend = None
            self._live_view.close()
            self.end()
        if self._error is not None:
            raise self._error

    async def _close_window_when_requested(self, window: Any) -> None:
        """Close a window in its own thread once closing is requested."""
        from rendercanvas.utils.asyncs import sleep

        while not window.get_closed():
            if self._should_close:
                window.close()
            await sleep(self.refresh_interval)

    def _set_stop(self, stop: Callable[[], Any]) -> None:
        """Set the function that stops the backend; call it if closing was requested before."""
        self._close_backend = stop
        if self._should_close:
            stop()

    def _wait_until_closed(self) -> None:
        """Wait at the program's end until the viewer is closed; an error or Ctrl-C closes it."""
        try:
            while self._is_active and getattr(sys, "last_type", None) is None:
                time.sleep(self.refresh_interval)
        except KeyboardInterrupt:
            pass
        finally:
            self.close()
            if self._thread is not None:
                self._thread.join(MESSAGE_SECONDS)

    def _rotate_and_record(self) -> None:
        """Rotate the camera and record pictures as time passes, until the viewer is closed."""
        recorder, last = _Recorder(self), time.monotonic()
        while self._is_active:
            time.sleep(self.refresh_interval)
            now = time.monotonic()
            if self.is_rotating:
                with self._render_lock:
                    flags = self._viewer_flags
                    self._trackball.rotate(
                        flags["rotate_rate"] * (now - last), flags["rotate_axis"]
                    )
            if self._viewer_flags["record"]:
                picture = recorder.render()
                if picture is not None:
                    # As many as there is time for, so that it lasts as long as it took.
                    count = round((time.monotonic() - recorder.started_at) / self.refresh_interval)
                    self._saved_frames += [picture] * max(0, count - recorder.count)
                    recorder.count = max(recorder.count, count)
            else:
                recorder.restart()
            last = now
        recorder.close()

    def _create_raymond_lights(self) -> list[Node]:
        """Return three new lights around the camera; ``self`` may be the class."""
        return [_make_raymond_light(azimuth) for azimuth in _RAYMOND_AZIMUTHS]

    def _create_direct_light(self) -> Node:
        """Return a new light along the camera's direction; ``self`` may be the class."""
        return Node(light=DirectionalLight(color=np.ones(3), intensity=1.0))

    # What keys do.

    @property
    def _message_text(self) -> str | None:
        """The current message or None; registered functions write it."""
        return self.message or None

    @_message_text.setter
    def _message_text(self, text: str | None) -> None:
        self._show_message("" if text is None else str(text))

    def _show_message(self, message: str) -> None:
        self._message, self._message_until = message, time.monotonic() + MESSAGE_SECONDS

    def _switch_flag(self, name: str, label: str) -> None:
        """Switch a flag and show a message; one that cannot be drawn stays off."""
        flags = self._viewer_flags if name in _DEFAULT_VIEWER_FLAGS else self._render_flags
        flags[name] = not flags[name]
        try:
            conversion.check_flags(self._combine_render_flags())
        except ValueError as error:
            flags[name] = False
            self._show_message(str(error))
            return
        self._show_message(f"{label} {'On' if flags[name] else 'Off'}")

    def _switch_axes(self) -> None:
        """Go to the next axes: none, the world's, those of meshes, all."""
        flags = self._viewer_flags
        current = bool(flags["show_world_axis"]), bool(flags["show_mesh_axes"])
        following = {
            (False, False): (True, False, "World Axis On"),
            (True, False): (False, True, "Mesh Axes On"),
            (False, True): (True, True, "All Axes On"),
            (True, True): (False, False, "All Axes Off"),
        }
        world, meshes, message = following[current]
        flags["show_world_axis"], flags["show_mesh_axes"] = world, meshes
        self._set_axes(world, meshes)
        self._show_message(message)

    def _switch_lighting(self) -> None:
        """Go to the next lights: the scene's, three around the camera, one at the camera."""
        flags = self._viewer_flags
        if flags["use_raymond_lighting"]:
            flags["use_raymond_lighting"], flags["use_direct_lighting"] = False, True
            self._show_message("Direct Lighting")
        elif flags["use_direct_lighting"]:
            flags["use_direct_lighting"] = False
            self._show_message("Default Lighting")
        else:
            flags["use_raymond_lighting"] = True
            self._show_message("Raymond Lighting")

    def _switch_camera(self) -> None:
        """Exchange the perspective and the parallel camera, at the same pose."""
        is_perspective = not self._viewer_flags["use_perspective_cam"]
        self._viewer_flags["use_perspective_cam"] = is_perspective
        self._camera_node.camera = (
            self._default_persp_cam if is_perspective else self._default_orth_cam
        )
        self._show_message("Perspective View" if is_perspective else "Orthographic View")

    def _switch_wireframe(self) -> None:
        """Go to the next mode: as materials say, flipped, all edges, all faces."""
        flags = self._render_flags
        names = "flip_wireframe", "all_wireframe", "all_solid"
        messages = ("Default Wireframe", "Flip Wireframe", "All Wireframe", "All Solid")
        current = next((number + 1 for number, name in enumerate(names) if flags[name]), 0)
        following = (current + 1) % len(messages)
        for number, name in enumerate(names):
            flags[name] = number + 1 == following
        self._show_message(messages[following])

    def _switch_recording(self) -> None:
        """Start recording, or stop it and write the file."""
        is_on = not self._viewer_flags["record"]
        self._viewer_flags["record"] = is_on
        if is_on:
            self._show_message("Recording")
        else:
            self.save_gif()

    def _save_image(self) -> None:
        """Write the current picture to a new file."""
        from PIL import Image

        path, recorder = self._unused_path("view.png"), _Recorder(self)
        picture = recorder.render()
        recorder.close()
        if picture is not None:
            Image.fromarray(picture).save(path)
            self._show_message(f"{path} saved")

    def _reset_view(self) -> None:
        """Move the camera back to its first pose."""
        self._trackball = self._make_trackball(self._default_camera_pose)

    def _fit_view(self) -> None:
        """Fit the whole scene into the picture, without turning the camera."""
        pose, camera = self._trackball.pose.copy(), self._camera_node.camera
        radius = 0.5 * (self._scene.scale or DEFAULT_SCENE_SCALE)
        projection = camera.get_projection_matrix(*self._viewport_size)
        slopes = [1.0 / abs(float(projection[axis, axis])) for axis in (0, 1)]
        # The sphere around the scene touches the nearest sides of the view.
        distance = radius * math.sqrt(1.0 + min(slopes) ** 2) / min(slopes)
        if isinstance(camera, OrthographicCamera):
            factor = radius / min(slopes)
            camera.xmag, camera.ymag = camera.xmag * factor, camera.ymag * factor
            distance = max(2.0 * radius, camera.znear + radius)
        pose[:3, 3] = self._view_center() + distance * pose[:3, 2]
        self._trackball = self._make_trackball(pose)

    # Helpers.

    def _combine_render_flags(self) -> RenderFlags:
        """Return the named render flags as `RenderFlags`."""
        by_name, flags = self._render_flags, RenderFlags.NONE
        if by_name["flip_wireframe"]:
            flags |= RenderFlags.FLIP_WIREFRAME
        elif by_name["all_wireframe"]:
            flags |= RenderFlags.ALL_WIREFRAME
        elif by_name["all_solid"]:
            flags |= RenderFlags.ALL_SOLID
        for is_on, flag in (
            (by_name["shadows"], RenderFlags.SHADOWS_DIRECTIONAL | RenderFlags.SHADOWS_SPOT),
            (by_name["vertex_normals"], RenderFlags.VERTEX_NORMALS),
            (by_name["face_normals"], RenderFlags.FACE_NORMALS),
            (not by_name["cull_faces"], RenderFlags.SKIP_CULL_FACES),
        ):
            flags |= flag if is_on else RenderFlags.NONE
        return flags

    def _view_center(self) -> Any:
        """Return the point that the camera rotates around, (3,), world space."""
        center = self._viewer_flags["view_center"]
        return self._scene.centroid if center is None else np.asarray(center, np.float64)

    def _make_trackball(self, pose: NDArray[np.float64]) -> Trackball:
        scale = self._scene.scale or DEFAULT_SCENE_SCALE
        return Trackball(pose, self._viewport_size, scale, self._view_center())

    def _default_pose(self) -> NDArray[np.float64]:
        """Return the camera's pose, (4, 4), for a scene without one: on the +x +z side, z up."""
        half = 1.0 / math.sqrt(2.0)
        pose = np.eye(4)
        pose[:3, :3] = [[0.0, -half, half], [1.0, 0.0, 0.0], [0.0, half, half]]
        distance = 0.5 * math.sqrt(3.0) * (self._scene.scale or DEFAULT_SCENE_SCALE)
        pose[:3, 3] = distance * np.array([1.0, 0.0, 1.0]) + self._view_center()
        return pose

    def _set_lights(self) -> None:
        """Add the viewer's lights that are on to the scene, and remove those that are off."""
        flags, scene = self._viewer_flags, self._scene
        intensity = float(flags["lighting_intensity"])
        is_raymond = bool(flags["use_raymond_lighting"])
        viewer_lights = [(node, is_raymond, intensity / 3.0) for node in self._raymond_lights]
        viewer_lights.append((self._direct_light, bool(flags["use_direct_lighting"]), intensity))
        for node, is_on, strength in viewer_lights:
            if is_on and node.light is not None:
                node.light.intensity = strength
            if is_on and not scene.has_node(node):
                scene.add_node(node, parent_node=self._camera_node)
            elif not is_on and scene.has_node(node):
                scene.remove_node(node)

    def _set_axes(self, world: bool, meshes: bool) -> None:
        """Show or remove the axes of the world and of each mesh."""
        scene = self._scene
        for owner, node in list(self._axes.items()):
            if not (world if owner == "scene" else meshes) and scene.has_node(node):
                scene.remove_node(node)
                del self._axes[owner]
        if world and "scene" not in self._axes:
            self._axes["scene"] = Node(mesh=_make_axis_mesh(), scale=np.ones(3) * scene.scale * 0.3)
            scene.add_node(self._axes["scene"])
        if not meshes:
            return
        shown = set(self._axes.values())
        for node in list(scene._list_nodes()):
            if node.mesh is not None and node not in shown and node not in self._axes:
                low, high = node.mesh.bounds
                size = 0.5 * length(high - low)
                self._axes[node] = Node(mesh=_make_axis_mesh(), scale=np.ones(3) * size)
                scene.add_node(self._axes[node], parent_node=node)

    def _unused_path(self, name: str) -> Path:
        """Return the path of a file that does not exist yet, in the folder to save in."""
        folder = Path(self._viewer_flags["save_directory"] or ".")
        path, number = folder / name, 1
        while path.exists():
            path = folder / f"{Path(name).stem}-{number}{Path(name).suffix}"
            number += 1
        return path


class _Recorder:
    """Draws pictures of a viewer apart from its backend, for files."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer
        self._renderer: Renderer | None = None
        self.count = 0
        """Pictures recorded since ``started_at``."""
        self.started_at = 0.0

    def restart(self) -> None:
        """Begin a new recording with the next picture."""
        self.count, self.started_at = 0, 0.0

    def render(self) -> NDArray[np.uint8] | None:
        """Return the current picture, (H, W, 3) uint8; None while the program holds the scene."""
        viewer = self._viewer
        if not viewer.render_lock.acquire(timeout=viewer.refresh_interval):
            return None
        try:
            size = viewer.viewport_size
            snapshot = viewer.capture(size)
        except Exception as error:
            viewer.fail(error)
            return None
        finally:
            viewer.render_lock.release()
        if snapshot is None:
            return None
        if self._renderer is None or self._renderer.size != size:
            self.close()
            self._renderer = Renderer(size)
            self._renderer.warned = None
        frame = self._renderer.render(
            snapshot.scene, snapshot.camera, background=snapshot.background
        )
        self.started_at = self.started_at or time.monotonic() - viewer.refresh_interval
        return np.ascontiguousarray(frame.color[:, :, :3])

    def close(self) -> None:
        """Release threads and memory."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def _perspective_camera_at(camera: Any, pose: NDArray[np.float64]) -> MovableCamera | None:
    """Return a perspective camera at a rigid pose; None if the camera or the pose is another."""
    if type(camera) is not PerspectiveCamera or camera.aspectRatio is not None:
        return None
    axes = pose[:3, :3].T
    products = [[float((one * other).sum()) for other in axes] for one in axes]
    if np.abs(np.array(products) - np.eye(3)).max() > ORTHONORMAL_TOLERANCE:
        return None
    eye, back, up = pose[:3, 3], pose[:3, 2], pose[:3, 1]
    far = math.inf if camera.zfar is None else camera.zfar
    fov_y = math.degrees(camera.yfov)
    return MovableCamera(eye, eye - back, up, fov_y=fov_y, near=camera.znear, far=far)


def _can_open_window_in_thread() -> bool:
    """Tell whether a window can run outside the main thread: with GLFW, except on macOS."""
    return sys.platform != "darwin" and window_probe.find_toolkit()[0] == "glfw"


def _choose_port() -> int:
    """Return the usual port of pages, or 0 for any if it is taken."""
    with contextlib.suppress(ValueError), browser.bind(browser.DEFAULT_HOST, browser.DEFAULT_PORT):
        return browser.DEFAULT_PORT
    return 0


def _call_registered(registered: Any, viewer: Viewer) -> None:
    """Call the function registered for a key, alone or with its arguments."""
    if not isinstance(registered, (list, tuple, np.ndarray)):
        registered(viewer)
        return
    function, arguments, options = (*registered, None, None)[:3]
    function(viewer, *([] if arguments is None else arguments), **(options or {}))


def _make_raymond_light(azimuth: float) -> Node:
    """Return one of the three lights around the camera, in its space; azimuth in degrees."""
    sine, cosine = transforms.sine_cosine(_RAYMOND_TILT)
    y, x = transforms.sine_cosine(azimuth)
    back = np.array([sine * x, sine * y, cosine])
    right = np.array([-y, x, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    return Node(light=DirectionalLight(color=np.ones(3), intensity=1.0), matrix=pose)


def _make_axis_mesh() -> Mesh:
    """Return a mesh of three arrows: x red, y green, z blue."""
    import trimesh

    axes: Any = trimesh.creation.axis(origin_size=0.1, axis_radius=0.05, axis_length=1.0)
    return Mesh.from_trimesh(axes, smooth=False)


def _add_opaque_alpha(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an RGB picture with an alpha of 255."""
    return np.dstack([picture, np.full(picture.shape[:2], 255, np.uint8)])
