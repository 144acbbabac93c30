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
from rasterjit.compat.pyrender import drawing
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
from rasterjit.compat.pyrender.fields import Field, NoOpenGLError, anything
from rasterjit.compat.pyrender.light import DirectionalLight
from rasterjit.compat.pyrender.mesh import Mesh
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.scene import Scene
from rasterjit.compat.pyrender.showing import Lens, Look, Showing, Window
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

LEFT, MIDDLE, RIGHT = 1, 2, 4
"""Buttons of the mouse, as pyglet numbers them ..."""

BUTTONS = {1: LEFT, 2: RIGHT, 3: MIDDLE}
"""... and as events do."""

MODIFIERS = {"Shift": 1, "Control": 2, "Alt": 4}
"""Keys that are held, as pyglet numbers them."""

NOTCH = 100.0
"""Units of a wheel's event for a click."""

ORTHOGRAPHIC_CLICK = 0.95
"""Factor on what a parallel camera shows at each click of the wheel."""

MIN_MAGNIFICATION = 1e-8

MESSAGE_SECONDS = 2.0
"""How long a message is to be read."""

END_PATIENCE = 1.0
"""Seconds that the end waits for a program that holds the scene."""

FASTEST_GIF = 50.0
"""Pictures a second that programs show."""

ORTHONORMAL = 1e-6
"""How far the axes of a pose that only turns and moves may be off."""

_RAYMOND_AZIMUTHS = (0.0, 120.0, 240.0)
_RAYMOND_TILT = 30.0
"""Three lights around the viewer, each as far from where it looks from, degrees."""

_WINDOW = threading.Lock()
"""Held by the viewer that has a window: a process has one event loop for them."""

_RENDER_FLAGS: dict[str, Any] = {
    "flip_wireframe": False,
    "all_wireframe": False,
    "all_solid": False,
    "shadows": False,
    "vertex_normals": False,
    "face_normals": False,
    "cull_faces": True,
    "point_size": 1.0,
}

_VIEWER_FLAGS: dict[str, Any] = {
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

_KEYS = {
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
"""Keys, and the method that each calls."""

_FLAG_KEYS = {
    "a": ("rotate", "Rotation"),
    "c": ("cull_faces", "Cull Faces"),
    "h": ("shadows", "Shadows"),
    "m": ("face_normals", "Face Normals"),
    "n": ("vertex_normals", "Vert Normals"),
}
"""Keys that switch a flag, and its name in words."""


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
        self._render_flags = {**_RENDER_FLAGS, **(render_flags or {})}
        self._viewer_flags = {
            **_VIEWER_FLAGS, "rotate_axis": np.array(_VIEWER_FLAGS["rotate_axis"]),
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
        # Programs count with them; a message stays as long as all others.
        self._ticks_till_fade = 2.0 / 3.0 * float(self._viewer_flags["refresh_rate"])
        self._message_opac = 1.0 + self._ticks_till_fade
        self._saved_frames: list[NDArray[np.uint8]] = []
        self._error: BaseException | None = None
        self._stop: Callable[[], Any] | None = None
        self._thread: threading.Thread | None = None
        drawing.check_flags(self._flags())
        self._enter()
        try:
            self._showing = Showing(self, self._viewport_size, self._viewer_flags["window_title"])
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
        """A reentrant lock: while a program holds it, the viewer does not look at the scene."""
        return self._render_lock

    @property
    def is_active(self) -> bool:
        """Whether it is shown, and not closed yet."""
        return self._is_active

    @property
    def run_in_thread(self) -> bool:
        """Whether it is shown while the program goes on."""
        return self._run_in_thread

    render_flags = Field[dict[str, Any]](
        anything, "dict: how the scene is drawn, by name; may be changed as it is shown."
    )
    viewer_flags = Field[dict[str, Any]](
        anything, "dict: how the viewer behaves, by name; likewise."
    )
    registered_keys = Field[dict[int, Any]](anything, "dict: what a key calls, by its number.")

    @property
    def _renderer(self) -> Any:
        """What programs look for that reach into pyrender's OpenGL."""
        raise NoOpenGLError("Viewer._renderer")

    def start(self) -> None:
        """Show it, where ``auto_start`` was False; a second time nothing happens."""
        if self._is_started or not self._is_active:
            return
        self._is_started = True
        try:
            self._start(self._choose_backend())
        except BaseException:
            self.end()
            raise

    def close(self) -> None:
        """Close it, from any thread, and do not wait for that."""
        self._should_close = True
        stop = self._stop
        if stop is not None:
            stop()
        elif not self._is_started:
            self.end()

    def close_external(self) -> None:
        """Close it from another thread, and wait until the scene is as it was."""
        self.close()
        while self._is_active and threading.current_thread() is not self._thread:
            time.sleep(self.looks_each)

    def save_gif(self, filename: str | Path | None = None) -> None:
        """
        Write what was recorded to a file, and forget it.

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
        path = self._new_file("recording.gif") if filename is None else Path(filename)
        self._viewer_flags["save_directory"] = str(path.parent)
        rate = min(max(float(self._viewer_flags["refresh_rate"]), 1.0), FASTEST_GIF)
        shape = pictures[-1].shape
        alike = (picture for picture in pictures if picture.shape == shape)
        save_animation(path, (_opaque(picture) for picture in alike), rate)
        self._say(f"{path} saved")

    def on_close(self) -> None:
        """Close it, and let the scene be as it was."""
        self.end()
        self.close()

    def on_draw(self) -> None:
        """
        Draw anew: it does so by itself, wherever the scene changed.

        It is called before each look at the scene, so subclasses can move things there.
        """

    def on_resize(self, width: int, height: int) -> None:
        """Take the size of the window, pixels."""
        self._viewport_size = width, height
        self._trackball.resize(self._viewport_size)

    def on_mouse_press(self, x: float, y: float, buttons: int, modifiers: int) -> None:
        """Begin a drag at a pixel, y up; buttons and modifiers are those of pyglet."""
        state = Trackball.STATE_ROTATE
        if buttons == LEFT:
            is_rolling, is_panning = modifiers & MODIFIERS["Control"], modifiers & 1
            if is_rolling:
                state = Trackball.STATE_ZOOM if is_panning else Trackball.STATE_ROLL
            elif is_panning:
                state = Trackball.STATE_PAN
        elif buttons == MIDDLE:
            state = Trackball.STATE_PAN
        elif buttons == RIGHT:
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
        """Turn the wheel by clicks, forward where ``dy`` is above 0."""
        camera = self._camera_node.camera
        if self._viewer_flags["use_perspective_cam"] or not isinstance(camera, OrthographicCamera):
            self._trackball.scroll(dy)
            return
        factor = ORTHOGRAPHIC_CLICK**dy
        shape = camera.ymag / camera.xmag
        camera.xmag = max(camera.xmag * factor, MIN_MAGNIFICATION)
        camera.ymag = camera.xmag * shape

    def on_key_press(self, symbol: int, modifiers: int) -> None:
        """Call what a key is registered for, or do what it does by itself."""
        registered = self._registered_keys.get(symbol)
        if registered is not None:
            _call(registered, self)
            return
        key = chr(symbol) if 0 <= symbol <= sys.maxunicode else ""
        if key in _FLAG_KEYS:
            self._switch_flag(*_FLAG_KEYS[key])
        elif key in _KEYS:
            getattr(self, _KEYS[key])()

    # What shows it asks for.

    @property
    def looks_each(self) -> float:
        """Time between two looks at the scene, seconds."""
        return 1.0 / min(max(float(self._viewer_flags["refresh_rate"]), 1.0), 120.0)

    @property
    def is_turning(self) -> bool:
        """Whether the camera turns by itself."""
        flags = self._viewer_flags
        return self._is_active and bool(flags["rotate"]) and not flags["mouse_pressed"]

    @property
    def message(self) -> str:
        """What is to be read for a while."""
        return self._message if time.monotonic() < self._message_until else ""

    def look(self, size: tuple[int, int]) -> Look | None:
        """Return the scene as it is, for a picture of a size; None if it is closed."""
        if not self._is_active:
            return None
        if self._is_started:
            self.on_draw()
        scene, flags = self._scene, drawing.check_flags(self._flags())
        self._camera_node.matrix = self._trackball.pose
        self._set_lights()
        matrices = drawing.camera_of(scene, size)
        node = scene.main_camera_node or self._camera_node
        pose = scene.get_pose(node)
        camera = movable_camera(node.camera, pose) or Lens(
            matrices.view_from_world, matrices.clip_from_view
        )
        seen = drawing.Seen(matrices, size, float(self._render_flags["point_size"]))
        drawn = drawing.convert(scene, flags, seen=seen).scene
        codes = drawing.background_codes(scene)
        codes[3] = 255
        if not drawn.nodes:
            # A scene is of something: a face without area, which is never seen.
            drawn = DrawnScene()
            drawn.add(DrawnMesh([self._trackball.pose[:3, 3]] * 3, [[0, 1, 2]]))
            return Look(drawn, camera, codes)
        if not scene.light_nodes and not scene.ambient_light.any():
            # A window that is black helps nobody.
            drawing.add_lights(drawn, [(DirectionalLight(intensity=math.pi), pose)])
        return Look(drawn, camera, drawing.background_light(codes, flags))

    def take(self, event: Event, size: tuple[float, float]) -> bool:
        """Take in an event of a canvas of a size, and tell whether it meant something."""
        kind = event.get("event_type")
        x, y = event.get("x", 0.0), size[1] - event.get("y", 0.0)
        held = sum(MODIFIERS.get(name, 0) for name in event.get("modifiers", ()))
        with self._render_lock:
            if not self._is_active:
                return False
            self._trackball.resize(size)
            if kind == "pointer_down":
                self.on_mouse_press(x, y, BUTTONS.get(event.get("button", 0), 0), held)
            elif kind == "pointer_move" and self._viewer_flags["mouse_pressed"]:
                self.on_mouse_drag(x, y, 0.0, 0.0, 0, held)
            elif kind == "pointer_up":
                self.on_mouse_release(x, y, BUTTONS.get(event.get("button", 0), 0), held)
            elif kind == "wheel":
                self.on_mouse_scroll(x, y, 0.0, -event.get("dy", 0.0) / NOTCH)
            elif kind == "key_down" and len(str(event.get("key", ""))) == 1:
                symbol = ord(event["key"].lower()[0])
                if symbol not in self._registered_keys and chr(symbol) not in {*_KEYS, *_FLAG_KEYS}:
                    return False
                self.on_key_press(symbol, held)
            else:
                return False
        return True

    def look_from(self, pose: NDArray[np.float64]) -> None:
        """Put the camera somewhere, (4, 4); it goes on to turn around the same point."""
        with self._render_lock:
            self._trackball = self._new_trackball(pose)

    def note_size(self, size: tuple[int, int]) -> None:
        """Take the size of the picture, pixels."""
        with self._render_lock:
            self.on_resize(*size)

    def fail(self, error: Exception) -> None:
        """Close it because of an error of the program, which is raised where it runs."""
        if self._error is None:
            self._error = error
        self.close()

    def end(self) -> None:
        """Take out of the scene what was added, and be active no more."""
        # A program that holds the lock may be waiting for this.
        is_held = self._render_lock.acquire(timeout=END_PATIENCE)
        try:
            if not self._is_active:
                return
            self._remove_axes()
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
        """Return where it is shown."""
        backend = show.choose_backend("auto")
        is_main = threading.current_thread() is threading.main_thread() and not self._run_in_thread
        is_fit = is_main or _may_open_in_a_thread()
        if backend == "window" and not (is_fit and _WINDOW.acquire(blocking=False)):
            return "browser"
        if backend == "terminal" and not is_main:
            raise ImportError('a viewer in a thread needs a page: pip install "rasterjit[browser]"')
        return backend

    def _enter(self) -> None:
        """Add what the viewer needs to the scene."""
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
        self._default_camera_pose = self._first_pose() if pose is None else pose
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
        self._trackball = self._new_trackball(self._default_camera_pose)
        self._is_active = True

    def _start(self, backend: str) -> None:
        """Show it, and return when it is closed, or at once if it is in a thread."""
        threading.Thread(target=self._keep_time, name="rasterjit-pyrender", daemon=True).start()
        if backend == "notebook":
            from IPython.display import display

            widget = notebook.widget(self._showing)
            display(widget)
            self._stop_with(lambda: (widget.close(), self.end()))
        elif self._run_in_thread:
            register = getattr(threading, "_register_atexit", None)
            self._thread = threading.Thread(
                target=self._run,
                args=(backend,),
                name="rasterjit-viewer",
                daemon=register is not None,
            )
            self._thread.start()
            if register is not None:
                # Before the pools of threads go that draw.
                register(self._wait)
        else:
            self._run(backend)

    def _run(self, backend: str) -> None:
        """Show it until it is closed."""
        title = str(self._viewer_flags["window_title"])
        try:
            if backend == "window":
                window, loop = canvas.window(self._showing, title)

                async def close_in_time() -> None:
                    await self._close_in_time(window)

                loop.add_task(close_in_time)
                loop.run()
            elif backend == "browser":
                browser.serve(self._showing, port=_free_port(), on_start=self._stop_with)
            else:
                self._stop_with(_thread.interrupt_main)
                terminal.run_in_terminal(self._showing, title)
        except KeyboardInterrupt:
            if not (backend == "terminal" and self._should_close):
                raise
        finally:
            if backend == "window":
                _WINDOW.release()
            self._stop = None
            self._showing.close()
            self.end()
        if self._error is not None:
            raise self._error

    async def _close_in_time(self, window: Any) -> None:
        """Close a window when that is asked for, in the thread that it is in."""
        from rendercanvas.utils.asyncs import sleep

        while not window.get_closed():
            if self._should_close:
                window.close()
            await sleep(self.looks_each)

    def _stop_with(self, stop: Callable[[], Any]) -> None:
        """Take what closes it, and close it at once if that was asked for before."""
        self._stop = stop
        if self._should_close:
            stop()

    def _wait(self) -> None:
        """Wait at the end of the program until it is closed; an error or Ctrl-C closes it."""
        try:
            while self._is_active and getattr(sys, "last_type", None) is None:
                time.sleep(self.looks_each)
        except KeyboardInterrupt:
            pass
        finally:
            self.close()
            if self._thread is not None:
                self._thread.join(MESSAGE_SECONDS)

    def _keep_time(self) -> None:
        """Turn the camera and record, as time passes."""
        recorder, last = _Recorder(self), time.monotonic()
        while self._is_active:
            time.sleep(self.looks_each)
            now = time.monotonic()
            if self.is_turning:
                with self._render_lock:
                    flags = self._viewer_flags
                    self._trackball.rotate(
                        flags["rotate_rate"] * (now - last), flags["rotate_axis"]
                    )
            if self._viewer_flags["record"]:
                picture = recorder.picture()
                if picture is not None:
                    # As many as there is time for, so that it lasts as long as it took.
                    count = round((time.monotonic() - recorder.since) / self.looks_each)
                    self._saved_frames += [picture] * max(0, count - recorder.count)
                    recorder.count = max(recorder.count, count)
            else:
                recorder.restart()
            last = now
        recorder.close()

    def _create_raymond_lights(self) -> list[Node]:
        """Return three new lights around the camera, which programs take; also of the class."""
        return [_light_node(azimuth) for azimuth in _RAYMOND_AZIMUTHS]

    def _create_direct_light(self) -> Node:
        """Return a new light of the camera's own direction; also of the class."""
        return Node(light=DirectionalLight(color=np.ones(3), intensity=1.0))

    # What keys do.

    @property
    def _message_text(self) -> str | None:
        """What is to be read, None without; functions of keys write it."""
        return self.message or None

    @_message_text.setter
    def _message_text(self, text: str | None) -> None:
        self._say("" if text is None else str(text))

    def _say(self, message: str) -> None:
        self._message, self._message_until = message, time.monotonic() + MESSAGE_SECONDS

    def _switch_flag(self, name: str, words: str) -> None:
        """Switch a flag, and say so; one that cannot be honoured stays off."""
        flags = self._viewer_flags if name in _VIEWER_FLAGS else self._render_flags
        flags[name] = not flags[name]
        try:
            drawing.check_flags(self._flags())
        except ValueError as error:
            flags[name] = False
            self._say(str(error))
            return
        self._say(f"{words} {'On' if flags[name] else 'Off'}")

    def _switch_axes(self) -> None:
        """Go on: no axes, the world's, those of meshes, all."""
        flags = self._viewer_flags
        now = bool(flags["show_world_axis"]), bool(flags["show_mesh_axes"])
        order = {
            (False, False): (True, False, "World Axis On"),
            (True, False): (False, True, "Mesh Axes On"),
            (False, True): (True, True, "All Axes On"),
            (True, True): (False, False, "All Axes Off"),
        }
        world, meshes, words = order[now]
        flags["show_world_axis"], flags["show_mesh_axes"] = world, meshes
        self._set_axes(world, meshes)
        self._say(words)

    def _switch_lighting(self) -> None:
        """Go on: the scene's lights, three around the camera, one at it."""
        flags = self._viewer_flags
        if flags["use_raymond_lighting"]:
            flags["use_raymond_lighting"], flags["use_direct_lighting"] = False, True
            self._say("Direct Lighting")
        elif flags["use_direct_lighting"]:
            flags["use_direct_lighting"] = False
            self._say("Default Lighting")
        else:
            flags["use_raymond_lighting"] = True
            self._say("Raymond Lighting")

    def _switch_camera(self) -> None:
        """Look through the other camera, from the same place."""
        is_perspective = not self._viewer_flags["use_perspective_cam"]
        self._viewer_flags["use_perspective_cam"] = is_perspective
        self._camera_node.camera = (
            self._default_persp_cam if is_perspective else self._default_orth_cam
        )
        self._say("Perspective View" if is_perspective else "Orthographic View")

    def _switch_wireframe(self) -> None:
        """Go on: as materials say, flipped, all edges, all faces."""
        flags = self._render_flags
        names = "flip_wireframe", "all_wireframe", "all_solid"
        words = ("Default Wireframe", "Flip Wireframe", "All Wireframe", "All Solid")
        now = next((number + 1 for number, name in enumerate(names) if flags[name]), 0)
        following = (now + 1) % len(words)
        for number, name in enumerate(names):
            flags[name] = number + 1 == following
        self._say(words[following])

    def _switch_recording(self) -> None:
        """Begin to record, or end it and write the file."""
        is_on = not self._viewer_flags["record"]
        self._viewer_flags["record"] = is_on
        if is_on:
            self._say("Recording")
        else:
            self.save_gif()

    def _save_image(self) -> None:
        """Write what is seen to a new file."""
        from PIL import Image

        path, recorder = self._new_file("view.png"), _Recorder(self)
        picture = recorder.picture()
        recorder.close()
        if picture is not None:
            Image.fromarray(picture).save(path)
            self._say(f"{path} saved")

    def _reset_view(self) -> None:
        """Return to where the camera was at first."""
        self._trackball = self._new_trackball(self._default_camera_pose)

    def _fit_view(self) -> None:
        """Show the whole scene, from where the camera looks."""
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
        pose[:3, 3] = self._center() + distance * pose[:3, 2]
        self._trackball = self._new_trackball(pose)

    # Smaller steps.

    def _flags(self) -> RenderFlags:
        """Return how the scene is drawn, in flags."""
        given, flags = self._render_flags, RenderFlags.NONE
        if given["flip_wireframe"]:
            flags |= RenderFlags.FLIP_WIREFRAME
        elif given["all_wireframe"]:
            flags |= RenderFlags.ALL_WIREFRAME
        elif given["all_solid"]:
            flags |= RenderFlags.ALL_SOLID
        if given["shadows"]:
            flags |= RenderFlags.SHADOWS_DIRECTIONAL | RenderFlags.SHADOWS_SPOT
        if given["vertex_normals"]:
            flags |= RenderFlags.VERTEX_NORMALS
        if given["face_normals"]:
            flags |= RenderFlags.FACE_NORMALS
        if not given["cull_faces"]:
            flags |= RenderFlags.SKIP_CULL_FACES
        return flags

    def _center(self) -> Any:
        """Return what the camera turns around, (3,)."""
        center = self._viewer_flags["view_center"]
        return self._scene.centroid if center is None else np.asarray(center, np.float64)

    def _new_trackball(self, pose: NDArray[np.float64]) -> Trackball:
        scale = self._scene.scale or DEFAULT_SCENE_SCALE
        return Trackball(pose, self._viewport_size, scale, self._center())

    def _first_pose(self) -> NDArray[np.float64]:
        """Return where the camera is if the scene has none: along x and z, with z up, (4, 4)."""
        half = 1.0 / math.sqrt(2.0)
        pose = np.eye(4)
        pose[:3, :3] = [[0.0, -half, half], [1.0, 0.0, 0.0], [0.0, half, half]]
        distance = 0.5 * math.sqrt(3.0) * (self._scene.scale or DEFAULT_SCENE_SCALE)
        pose[:3, 3] = distance * np.array([1.0, 0.0, 1.0]) + self._center()
        return pose

    def _set_lights(self) -> None:
        """Let the viewer's own lights be in the scene if they are on."""
        flags, scene = self._viewer_flags, self._scene
        intensity = float(flags["lighting_intensity"])
        is_raymond = bool(flags["use_raymond_lighting"])
        own = [(node, is_raymond, intensity / 3.0) for node in self._raymond_lights]
        own.append((self._direct_light, bool(flags["use_direct_lighting"]), intensity))
        for node, is_on, strength in own:
            if is_on and node.light is not None:
                node.light.intensity = strength
            if is_on and not scene.has_node(node):
                scene.add_node(node, parent_node=self._camera_node)
            elif not is_on and scene.has_node(node):
                scene.remove_node(node)

    def _set_axes(self, world: bool, meshes: bool) -> None:
        """Show axes of the world and of each mesh, or take them away."""
        scene, kept = self._scene, dict(self._axes)
        for of, node in kept.items():
            if not (world if of == "scene" else meshes) and scene.has_node(node):
                scene.remove_node(node)
                del self._axes[of]
        if world and "scene" not in self._axes:
            self._axes["scene"] = Node(mesh=_axis_mesh(), scale=np.ones(3) * scene.scale * 0.3)
            scene.add_node(self._axes["scene"])
        if not meshes:
            return
        shown = set(self._axes.values())
        for of in [node for node in scene._ordered() if node.mesh is not None]:
            if of not in shown and of not in self._axes and of.mesh is not None:
                low, high = of.mesh.bounds
                size = 0.5 * length(high - low)
                self._axes[of] = Node(mesh=_axis_mesh(), scale=np.ones(3) * size)
                scene.add_node(self._axes[of], parent_node=of)

    def _remove_axes(self) -> None:
        self._set_axes(False, False)

    def _new_file(self, name: str) -> Path:
        """Return a file that is not there yet, in the folder to save in."""
        folder = Path(self._viewer_flags["save_directory"] or ".")
        path, number = folder / name, 1
        while path.exists():
            path = folder / f"{Path(name).stem}-{number}{Path(name).suffix}"
            number += 1
        return path


class _Recorder:
    """Draws what a viewer shows, also where nobody looks."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer
        self._renderer: Renderer | None = None
        self.count = 0
        """Pictures that were recorded since it began."""
        self.since = 0.0

    def restart(self) -> None:
        """Begin anew with the next picture."""
        self.count, self.since = 0, 0.0

    def picture(self) -> NDArray[np.uint8] | None:
        """Return what is to be seen now, (H, W, 3); None while the program holds the scene."""
        viewer = self._viewer
        if not viewer.render_lock.acquire(timeout=viewer.looks_each):
            return None
        try:
            size = viewer.viewport_size
            look = viewer.look(size)
        except Exception as error:
            viewer.fail(error)
            return None
        finally:
            viewer.render_lock.release()
        if look is None:
            return None
        picture = self.drawn(look, size)
        self.since = self.since or time.monotonic() - viewer.looks_each
        return picture

    def drawn(self, look: Look, size: tuple[int, int]) -> NDArray[np.uint8]:
        """Return a picture, (H, W, 3) uint8."""
        if self._renderer is None or self._renderer.size != size:
            self.close()
            self._renderer = Renderer(size)
            self._renderer.warned = None
        frame = self._renderer.render(look.scene, look.camera, background=look.background)
        return np.ascontiguousarray(frame.color[:, :, :3])

    def close(self) -> None:
        """Let threads and memory go."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def movable_camera(camera: Any, pose: NDArray[np.float64]) -> MovableCamera | None:
    """Return a camera of the viewport's own shape with places and angles; None for others."""
    if type(camera) is not PerspectiveCamera or camera.aspectRatio is not None:
        return None
    turn = pose[:3, :3]
    products = [[float((turn[:, i] * turn[:, j]).sum()) for j in range(3)] for i in range(3)]
    if np.abs(np.array(products) - np.eye(3)).max() > ORTHONORMAL:
        return None
    eye, back, up = pose[:3, 3], pose[:3, 2], pose[:3, 1]
    far = math.inf if camera.zfar is None else camera.zfar
    fov_y = math.degrees(camera.yfov)
    return MovableCamera(eye, eye - back, up, fov_y=fov_y, near=camera.znear, far=far)


def _may_open_in_a_thread() -> bool:
    """Tell whether a window may be another thread's than the main one: of GLFW, but on macOS."""
    return sys.platform != "darwin" and window_probe.find_toolkit()[0] == "glfw"


def _free_port() -> int:
    """Return the usual port of pages, or 0 for any if it is taken."""
    with contextlib.suppress(ValueError), browser.bind(browser.DEFAULT_HOST, browser.DEFAULT_PORT):
        return browser.DEFAULT_PORT
    return 0


def _call(registered: Any, viewer: Viewer) -> None:
    """Call what a key is registered for."""
    if not isinstance(registered, (list, tuple, np.ndarray)):
        registered(viewer)
        return
    function, *rest = registered
    arguments = rest[0] if rest and rest[0] is not None else []
    options = rest[1] if len(rest) > 1 and rest[1] is not None else {}
    function(viewer, *arguments, **options)


def _light_node(azimuth: float) -> Node:
    """Return one of three lights around the camera, relative to it."""
    sine, cosine = transforms.sine_cosine(_RAYMOND_TILT)
    y, x = transforms.sine_cosine(azimuth)
    back = np.array([sine * x, sine * y, cosine])
    right = np.array([-y, x, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    return Node(light=DirectionalLight(color=np.ones(3), intensity=1.0), matrix=pose)


def _axis_mesh() -> Mesh:
    """Return three arrows: x red, y green, z blue."""
    import trimesh

    axes: Any = trimesh.creation.axis(origin_size=0.1, axis_radius=0.05, axis_length=1.0)
    return Mesh.from_trimesh(axes, smooth=False)


def _opaque(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture of three channels with a fourth, 255."""
    return np.dstack([picture, np.full(picture.shape[:2], 255, np.uint8)])
