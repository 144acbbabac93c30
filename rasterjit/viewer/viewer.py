"""
The viewer, without a window: events and time go in, pictures come out.

`Viewer.draw` returns a picture at once: while something moves, in the quality that
``quality_selection`` chooses for the time there is, or in draft quality until the times of the
scene are known. When nothing moves, each `Viewer.step` makes the picture more accurate, or measures
more times, and may run in another thread: whatever moves meanwhile ends it. ``canvas`` makes
windows, notebooks and terminals of these two, ``browser_session`` pages.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.inspect.pixel import explain_pixel
from rasterjit.inspect.pixel_report import PixelExplanation
from rasterjit.io.meshes import as_scene
from rasterjit.outputs.frame import Frame
from rasterjit.rendering import quality_selection
from rasterjit.rendering.planning import Cull, choose_camera
from rasterjit.rendering.renderer import Renderer, explain
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera, PerspectiveCamera
from rasterjit.scene.camera_fitting import BoundingSphere, default_camera
from rasterjit.scene.color import linear_color
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import image_size, one_of, positive_number
from rasterjit.survey.deformation import check_lists
from rasterjit.viewer import effect_switches
from rasterjit.viewer.controls import Event, Fly, Orbit
from rasterjit.viewer.overlay import OUTPUTS_OF, Row, as_rows, mark_pixel, to_picture, write_panel

KIND_KEYS = {"1": "color", "2": "depth", "3": "normal", "4": "object_id", "5": "face_id"}
"""Kind of picture by the key that shows it."""

KIND_NAMES = {
    "color": "colour", "depth": "depth", "normal": "normals", "object_id": "objects",
    "face_id": "faces",
}  # fmt: skip
"""Display names of the kinds."""

MAX_CLICK_PIXELS = 3.0
"""Largest distance of the pointer between press and release of a click, pixels."""

MAX_STEP_SECONDS = 0.1
"""Longest time by which a camera advances at once, beside that of drawing a picture: after a pause
it does not jump."""

FRAME_BUDGET_SECONDS = 0.012
"""Time to draw a picture while something moves: about half of a frame at 45 Hz. Encoding it, and
decoding it in a page on the same machine, takes the other half."""

PREVIEW = replace(Quality.draft(), shading="pixel")
"""Lowest quality: that of moving pictures until times are known."""

FIRST_QUALITY = Quality(samples=4)
"""Quality of the first picture at rest: fast, with smooth edges."""

MAX_OVERRUN = 1.5
"""Ratio to the budget above which moving pictures are drawn with half as many pixels a side, about
four times faster; they are so until four times their time is below the ratio again."""

SHRINK = 2
"""Factor by which the sides of coarse pictures are smaller."""

MIN_COMPILE_SHARE = 0.1
"""Share of compiling in a picture's time above which the status line mentions it."""

HELP_ROWS: tuple[Row, ...] = (
    ("drag", "turn (look around, when flying)"),
    ("right drag, Shift drag", "pan"),
    ("wheel", "zoom to the cursor (speed, when flying)"),
    ("arrows, + -", "turn, zoom"),
    ("C", "orbit or fly: W A S D, Q E down and up, Shift faster"),
    ("F  R", "fit the scene, return to the start"),
    ("1 2 3 4 5", "colour, depth, normals, objects, faces"),
    *effect_switches.make_help_rows(),
    ("M", "what the effects cost"),
    ("click", "explain a pixel; Escape closes that, and help"),
    ("I  H", "hide or show the line below, this help"),
)


class _OutdatedError(Exception):
    """The version that is being rendered is outdated."""


class Viewer:
    """
    Shows a scene whose camera the user moves: events and time go in, pictures come out.

    Parameters
    ----------
    what : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene
        Not changed, and not to be changed while it is shown.
    camera : Camera, optional
        The first view. Default: the scene's own camera, else one that fits the scene.
    size : (int, int)
        Width and height of the pictures, pixels.
    background : color, optional
        As `rasterjit.render` takes it, but no picture; what is transparent is shown before white.
    cull : {"none", "back", "front"}
        Faces that are not drawn.
    up : (3,) array_like, world space, optional
        Direction that stays up when the camera turns. Default: that of the scene, else y.
    time_budget : float
        Seconds for a picture while something moves, by which its quality is chosen. If all take
        longer, the fastest is; if that takes much longer, with half as many pixels a side. Times
        are measured at rest; until then, and always for depth, normals and numbers, the quality is
        ``Quality.draft()`` with light for each pixel.
    name : str
        Name of the scene in the status line.
    threads : int, optional
        Default: all processors.

    Attributes
    ----------
    controls : Orbit or Fly
        The controls that move the camera.
    is_hurried : bool
        Whether moving pictures are drawn with half as many pixels a side from the start, because
        the backend is slow.
    version : int
        Grows whenever the view or the scene changes.
    writes_text : bool
        Whether panels and the status line are drawn on the pictures.
    enlarges : bool
        Whether pictures with half as many pixels a side are enlarged; else the backend does so.
    is_live : bool
        Whether the scene may change by itself, when `advance` is called.
    help_rows : tuple of tuple of str
        Rows of the help.
    help_key : str
        Key that shows the help.

    Raises
    ------
    ValueError
        Naming the argument that is wrong, or if there is nothing to look at.
    """

    is_live = False
    help_rows: tuple[Row, ...] = HELP_ROWS
    help_key = "H"

    def __init__(
        self,
        what: Any,
        camera: Camera | None = None,
        *,
        size: tuple[int, int] = (640, 480),
        background: Background = None,
        cull: Cull = "none",
        up: Any = None,
        time_budget: float = FRAME_BUDGET_SECONDS,
        name: str = "",
        threads: int | None = None,
    ) -> None:
        self.scene: Scene = as_scene(what)
        check_lists(self.scene)
        self._arguments = {
            "camera": camera, "size": size, "background": background, "cull": cull, "up": up,
            "time_budget": time_budget, "name": name, "threads": threads,
        }  # fmt: skip
        self.writes_text = self.enlarges = True
        self.is_hurried = False
        self.size = image_size("size", size)
        self.ratio = 1.0
        self.name = name
        if background is not None:
            linear_color("background", background)
        self._options = {"background": background, "cull": cull}
        self._budget = positive_number("time_budget", time_budget)
        self._times = self._make_times()
        # A view that fits the scene is fitted again where the picture has another shape.
        self._is_fitted = camera is None and self.scene.camera is None
        self._first = choose_camera(self.scene, camera, self.size)
        if up is not None and self._is_fitted:
            self._first = default_camera(self.scene, self.size, up)
        self._ball = BoundingSphere.around(self.scene)
        upward = self.scene.up or (0.0, 1.0, 0.0) if up is None else up
        self.controls: Orbit | Fly = Orbit.from_camera(self._first, self._ball, upward, self.size)
        self._threads = threads
        # Held while a result of a version is stored, and while a new version begins.
        self._lock = threading.Lock()
        self.version = 0
        self.kind = "color"
        self._switched: list[str] = []
        self._modes = {
            key: one.mode_of(self.scene) for key, one in effect_switches.MODAL_EFFECTS.items()
        }
        self._hidden: frozenset[int] = frozenset()
        self._visible = self.scene
        self._message = ""
        self._shows_help, self._shows_line, self._shows_costs = False, True, False
        self._press_position: tuple[float, float] | None = None
        self._pixel_to_explain: tuple[int, int] | None = None
        self.explanation: PixelExplanation | None = None
        self.costs: dict[str, float] | None = None
        self._frame: Frame | None = None
        self._frame_version = -1
        self._seconds = self._drawing_seconds = 0.0
        self._has_compiled = False
        self._moving = _make_renderer(self.size, threads)
        # Draws moving pictures with half as many pixels a side, if a picture in full size takes too
        # many seconds even in the lowest quality: the shorter of the last two times, and the last.
        self._coarse: Renderer | None = None
        self._full_size_seconds = self._last_full_size_seconds = 0.0
        self._steps: Iterator[bool] = iter(())
        self._steps_version, self._finished = -1, False
        # The version whose picture is final.
        self._best_version = -1
        self._frame_count = 0
        # Raise now if the scene cannot be drawn.
        explain(self.scene, self.camera, size=self.size, **self._options)

    def close(self) -> None:
        """Stop rendering, and release threads and pictures."""
        with self._lock:
            self.version += 1
            self._frame = self.explanation = None
        self._steps = iter(())
        self._close_renderers()

    def twin(self) -> Viewer:
        """Return another viewer of the same scene, whose camera starts at the first view."""
        return Viewer(self.scene, **self._arguments)

    @property
    def camera(self) -> PerspectiveCamera:
        """The current camera."""
        return self.controls.camera()

    @property
    def look(self) -> tuple[str, tuple[str, ...], dict[str, str | None]]:
        """Kind of picture, names of switched effects, and modes by key, see `set_look`."""
        return self.kind, tuple(self._switched), dict(self._modes)

    @property
    def hidden(self) -> frozenset[int]:
        """Indices of the hidden objects."""
        return self._hidden

    @property
    def numbers(self) -> list[int]:
        """Indices of the visible objects in the scene."""
        return [n for n in range(len(self.scene.nodes)) if n not in self._hidden]

    @property
    def cost_rows(self) -> list[Row]:
        """Costs of the effects, as rows; none unless switched on."""
        return self._format_costs() if self._shows_costs else []

    @property
    def panel_rows(self) -> Sequence[Row]:
        """Rows of the panel over the picture: help, the explanation of a pixel, or costs."""
        if self._shows_help:
            return self.help_rows
        return as_rows(self.explanation) if self.explanation is not None else self.cost_rows

    @property
    def shows_line(self) -> bool:
        """Whether to show the status line."""
        return self._shows_line

    @property
    def shown(self) -> Scene:
        """The scene with effects switched and objects hidden."""
        return self._visible

    @property
    def is_moving(self) -> bool:
        """Whether the picture changes with time."""
        return not self.controls.is_resting

    @property
    def is_done(self) -> bool:
        """Whether the picture is final until the next event."""
        return (
            not self.is_moving
            and self._frame_version == self.version
            and self._steps_version == self.version
            and self._finished
        )

    @property
    def line(self) -> str:
        """The status line: what is shown, its quality and time."""
        width, height = self.size
        parts = [self.name] if self.name else []
        parts += [KIND_NAMES[self.kind], f"{width} x {height}"]
        if self._frame is not None:
            plan = self._frame.plan
            # The first two words are the most important: standard samples=4.
            words = str(plan.quality).split(" ")
            quality = " ".join([*words[:2], "..."] if len(words) > 2 else words)
            if plan.pictures > 1:
                quality += f" of {plan.pictures} pictures"
            if plan.size != self.size:
                quality += " at half the size"
            compiled = ", with compiling" if self._has_compiled else ""
            parts.append(f"{quality} in {_format_seconds(self._seconds)}{compiled}")
        parts += [self._message] if self._message else []
        if isinstance(self.controls, Fly):
            parts.append(f"flying at {self.controls.speed:.3g}/s")
        return "   ".join(parts)

    @property
    def has_usual_keys(self) -> bool:
        """Whether keys do what ``HELP_ROWS`` says."""
        return self.help_rows is HELP_ROWS

    @property
    def stamp(self) -> tuple[Any, ...]:
        """A key of the picture: while it is the same, so is what `draw` returns."""
        panels = self._shows_help, self._shows_line, self._shows_costs, self.costs is None
        content = self.version, self._frame_count, id(self.explanation), self._message
        return *content, *panels, self.is_done

    def fail(self, error: Exception) -> None:
        """Show an error of a step, and do not try the step again."""
        self._message, self._finished = f"{type(error).__name__}: {error}", True

    def resize(self, size: tuple[int, int], ratio: float = 1.0) -> None:
        """
        Change the size of the pictures.

        The view stays. Where it began with the whole scene in the picture, and stands there still,
        it does so in the new shape; where it was moved, it returns to that with R.

        Parameters
        ----------
        size : (int, int)
            Width and height, pixels.
        ratio : float
            Pixels of the picture for one that events count in.
        """
        size, ratio = image_size("size", size), positive_number("ratio", ratio)
        if (size, ratio) == (self.size, self.ratio):
            return
        self.size, self.ratio = size, ratio
        self._close_renderers()
        self._moving = _make_renderer(size, self._threads)
        self._times = self._make_times()
        if self._is_fitted:
            self._first = default_camera(self.scene, size, self.controls.up)
            at_home, home = self.controls.is_home, self._make_home(type(self.controls)).home
            self.controls = replace(self.controls, home=home)
            if at_home:
                self.controls = self.controls.at_home()
        self._invalidate()

    def _make_home(self, kind: type[Orbit] | type[Fly]) -> Orbit | Fly:
        """Return controls of a type at the first view."""
        up = self.controls.up
        if kind is Fly:
            return Fly.from_camera(self._first, self._ball, up)
        return Orbit.from_camera(self._first, self._ball, up, self.size)

    def handle(self, event: Event) -> None:
        """Handle an event, a dictionary of ``rendercanvas``; ignore unknown ones."""
        kind = event.get("event_type")
        if kind == "key_down" and self._handle_key(str(event.get("key", ""))):
            return
        if kind == "pointer_down":
            self._press_position = (event["x"], event["y"]) if event.get("button") == 1 else None
        elif kind == "pointer_up" and self._press_position is not None:
            position = event["x"], event["y"]
            if math.dist(position, self._press_position) <= MAX_CLICK_PIXELS:
                self.pick(int(position[0] * self.ratio), int(position[1] * self.ratio))
            self._press_position = None
        depth = self._get_depth_under(event) if kind == "wheel" else None
        width, height = self.size
        logical = width / self.ratio, height / self.ratio
        before = self.camera
        self.controls = self.controls.handle(event, logical, depth)
        if self.camera != before:
            self._invalidate()

    def advance(self, seconds: float) -> None:
        """Advance the camera by a time, seconds."""
        if not self.is_moving:
            return
        self.controls = self.controls.advance(
            min(seconds, MAX_STEP_SECONDS + self._drawing_seconds)
        )
        if self.controls.is_resting:
            self.controls = self.controls.at_rest()
        self._invalidate()

    def look_from(self, camera: Camera) -> None:
        """Look from a camera, without its roll."""
        orbit = Orbit.from_camera(camera, self._ball, self.controls.up, self.size)
        self.controls = replace(orbit, home=self._make_home(Orbit).home)
        self._invalidate()

    def set_look(self, kind: str, switched: Sequence[str], modes: Mapping[str, str | None]) -> None:
        """
        Set the kind of picture and the switched effects; ignore effects that the scene lacks.

        Parameters
        ----------
        kind : str
            A key of ``KIND_NAMES``.
        switched : sequence of str
            Names of the effects that are switched: off where the scene has them, else on.
        modes : mapping of str to str or None
            Mode of effects with several modes, by key; None is off. Other modes stay.

        Raises
        ------
        ValueError
            If a kind, an effect, a key or a mode is not known.
        """
        one_of("kind", kind, tuple(KIND_NAMES))
        for name in switched:
            one_of("switched", name, tuple(effect_switches.EFFECT_KEYS.values()))
        for key, mode in modes.items():
            one_of("modes", key, tuple(effect_switches.MODAL_EFFECTS))
            one_of(f"modes[{key!r}]", mode, (None, *effect_switches.MODAL_EFFECTS[key].modes))
        self.kind = kind
        self._switched = []
        self._set_modes(modes)
        for name in dict.fromkeys(switched):
            self._toggle(name)

    def set_hidden(self, numbers: Iterable[int]) -> None:
        """
        Hide objects, and show all others.

        Parameters
        ----------
        numbers : iterable of int
            Indices in ``scene.nodes``.

        Raises
        ------
        ValueError
            If the scene has no object of a number.
        """
        hidden = frozenset(numbers)
        count = len(self.scene.nodes)
        if not all(0 <= number < count for number in hidden):
            raise ValueError(f"numbers must lie in 0..{count - 1}, got {sorted(hidden)}")
        if hidden != self._hidden:
            before, self._hidden = self._hidden, hidden
            problem = self._rebuild()
            if problem is not None:
                self._hidden, self._message = before, problem

    def pick(self, column: int, row: int) -> None:
        """Request the explanation of a pixel, which a later `step` computes."""
        width, height = self.size
        if 0 <= column < width and 0 <= row < height:
            self._pixel_to_explain = column, row
            self._restart_steps()

    def draw(self) -> NDArray[np.uint8]:
        """
        Return the best picture that exists, (H, W, 4) uint8, sRGB, opaque, with its text.

        A missing one is drawn now, within the time budget. While something moves it may be half as
        high and wide, if `enlarges` is false.
        """
        picture = self.picture()
        self._draw_overlay(picture)
        return picture

    def picture(self) -> NDArray[np.uint8]:
        """Return the picture as `draw` does, without text."""
        with self._lock:
            frame, is_current = self._frame, self._frame_version == self.version
        if not is_current:
            version = self.version
            start = perf_counter()
            drawn = self._draw_moving()
            self._drawing_seconds = quality_selection.seconds_of(drawn)
            # A step may have stored a better frame meanwhile.
            frame = self._store_frame(drawn, version, perf_counter() - start, is_best=False)
        picture = to_picture(frame, self.kind, self.numbers if self._hidden else None)
        return self._enlarge(picture) if self.enlarges else picture

    def _draw_moving(self) -> Frame:
        """Draw a moving picture in the time budget; in draft quality until times are known."""
        scene, camera, outputs = self._visible, self.camera, OUTPUTS_OF[self.kind]

        def draw(quality: Quality, renderer: Renderer = self._moving) -> Frame:
            renderer.quality = quality
            return renderer.render(scene, camera, outputs=outputs, **self._options)

        is_known = self.kind == "color" and self._times.is_known
        if self.is_hurried or self._full_size_seconds > MAX_OVERRUN * self._budget:
            if self._coarse is None:
                self._coarse = _make_renderer(_halve(self.size), self._threads)
            frame = draw(PREVIEW, self._coarse)
            self._full_size_seconds = SHRINK * SHRINK * quality_selection.seconds_of(frame)
        elif is_known:
            frame = quality_selection.draw_by_known_times(self._budget, self._times, draw)
        else:
            frame = draw(PREVIEW)
        if frame.plan.size == self.size:
            # Only two slow ones in a row count: the first one may have allocated memory.
            seconds = quality_selection.seconds_of(frame) if frame.plan.quality == PREVIEW else 0.0
            self._full_size_seconds = min(seconds, self._last_full_size_seconds)
            self._last_full_size_seconds = seconds
        return frame

    def _enlarge(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Enlarge a picture of half the size to the full one, each pixel doubled."""
        width, height = self.size
        if picture.shape[1::-1] != _halve(self.size) or self.size == (1, 1):
            return picture
        return picture.repeat(SHRINK, axis=0).repeat(SHRINK, axis=1)[:height, :width].copy()

    def _close_renderers(self) -> None:
        """Close the renderers of moving pictures."""
        self._moving.close()
        if self._coarse is not None:
            self._coarse.close()
        self._coarse = None
        self._full_size_seconds = self._last_full_size_seconds = 0.0

    def _make_times(self) -> quality_selection.FrameTimes:
        """
        Return an empty record of the times of the scene in each quality.

        The machine's profile is not used: a quality that was never drawn could be chosen, and
        compiled, while something moves.
        """
        # Light for each vertex is hardly faster, but visibly worse.
        better = [one for one in quality_selection.get_ladder() if one.shading == "pixel"]
        return quality_selection.FrameTimes((PREVIEW, *better), {})

    def step(self) -> bool:
        """
        Do the next step that improves the picture or measures times; tell whether there was one.

        May run in another thread than all else, but not in two at a time.
        """
        if self.is_moving:
            return False
        if self._steps_version != self.version:
            self._steps_version, self._finished = self.version, False
            self._steps = self._refine(self.version)
        try:
            return next(self._steps)
        except (_OutdatedError, StopIteration) as end:
            if isinstance(end, StopIteration):
                self._finished, self._best_version = True, self._steps_version
            return False

    def _refine(self, version: int) -> Iterator[bool]:
        """Yield after each step of refinement, as long as nothing changes."""
        scene, camera, kind, times = self._visible, self.camera, self.kind, self._times
        is_best = self._best_version == version

        def check_version() -> None:
            if self.version != version:
                raise _OutdatedError

        with _make_renderer(self.size, self._threads) as renderer:
            renderer.on_picture = check_version
            if kind != "color" and not is_best:
                start, outputs = perf_counter(), OUTPUTS_OF[kind]
                frame = renderer.render(scene, camera, outputs=outputs, **self._options)
                self._store_frame(frame, version, perf_counter() - start)
                yield True
            if self._pixel_to_explain is not None:
                pixel, self._pixel_to_explain = self._pixel_to_explain, None
                explanation = explain_pixel(scene, camera, renderer.size, *pixel, **self._options)
                with self._lock:
                    if version == self.version:
                        self.explanation = explanation
                    elif self._pixel_to_explain is None and self.camera == camera:
                        # The view is the same: explain the pixel again.
                        self._pixel_to_explain = pixel
                yield True
            frames = (
                renderer.refine(
                    scene, camera, outputs=OUTPUTS_OF[kind], first=(FIRST_QUALITY,), **self._options
                )
                if kind == "color" and not is_best
                else iter(())
            )
            for number, (frame, seconds) in enumerate(_time_frames(frames)):
                self._store_frame(frame, version, seconds)
                yield True
                if number == 1 and self._needs_costs:
                    self._measure_costs(renderer, version, scene, camera)
                    yield True
                if number == 1:
                    draw = self._make_drawer(renderer, version, scene, camera)
                    for _ in times.calibrate(self._budget, draw):
                        yield True
            if self._needs_costs:
                self._measure_costs(renderer, version, scene, camera)
                yield True

    @property
    def _needs_costs(self) -> bool:
        """Whether costs are to be shown and not measured yet."""
        return self._shows_costs and self.costs is None

    def _measure_costs(
        self, renderer: Renderer, version: int, scene: Scene, camera: Camera
    ) -> None:
        """Measure the costs of the effects."""
        used = effect_switches.find_used_effects(scene, camera, renderer.size)
        names = effect_switches.list_switchable(scene, used)
        costs = effect_switches.measure_costs(renderer, scene, camera, names)
        with self._lock:
            if version == self.version:
                self.costs = costs

    def _make_drawer(
        self, renderer: Renderer, version: int, scene: Scene, camera: Camera
    ) -> quality_selection.Draw:
        """Return a function that draws a scene in a quality, to be timed."""

        def draw(quality: Quality) -> Frame:
            renderer.quality = quality
            frame = renderer.render(scene, camera, outputs=OUTPUTS_OF["color"], **self._options)
            # The time does not count: moving pictures shared the processors.
            if self.version != version:
                raise _OutdatedError
            return frame

        return draw

    def _store_frame(
        self, frame: Frame, version: int, seconds: float, is_best: bool = True
    ) -> Frame:
        """
        Store a frame and its time, unless a newer or better one is there.

        Returns
        -------
        Frame
            The frame to show.
        """
        with self._lock:
            if self._frame is not None and self._frame_version == version and not is_best:
                return self._frame
            if version == self.version and not self._has_better(frame):
                self._frame, self._frame_version = frame, version
                # Wall-clock time, unlike that of stages, which leaves out compiling.
                self._seconds = seconds
                self._has_compiled = frame.stats.seconds["compile"] > MIN_COMPILE_SHARE * seconds
                self._frame_count += 1
        return frame

    def _has_better(self, frame: Frame) -> bool:
        """Tell whether the stored frame has more pictures than another."""
        if self._frame is None or self._frame_version != self.version:
            return False
        return self._frame.plan.pictures > frame.plan.pictures

    def _invalidate(self) -> None:
        """Start a new version: the picture is outdated."""
        with self._lock:
            self.version += 1
            self.explanation = None

    def _restart_steps(self) -> None:
        """Start a new version whose picture stays valid."""
        with self._lock:
            is_current = self._frame_version == self.version
            is_best = self._best_version == self.version
            self.version += 1
            if is_current:
                self._frame_version = self.version
            if is_best:
                self._best_version = self.version

    def _handle_key(self, key: str) -> bool:
        """Handle a key of the viewer; tell whether it is one."""
        key = key.lower() if len(key) == 1 else key
        if key in KIND_KEYS:
            self.kind = KIND_KEYS[key]
            self._invalidate()
        elif key == "h":
            self._shows_help = not self._shows_help
        elif key == "i":
            self._shows_line = not self._shows_line
        elif key == "Escape":
            self._shows_help, self._shows_costs, self.explanation = False, False, None
        elif key == "m":
            self._shows_costs = not self._shows_costs
            self._restart_steps()
        elif key == "c":
            kind = Fly if isinstance(self.controls, Orbit) else Orbit
            controls = kind.from_camera(self.camera, self._ball, self.controls.up)
            self.controls = replace(controls, home=self._make_home(kind).home)
            self._invalidate()
        elif key in effect_switches.MODAL_EFFECTS:
            modes = None, *effect_switches.MODAL_EFFECTS[key].modes
            self._set_modes({key: modes[(modes.index(self._modes[key]) + 1) % len(modes)]})
        elif key in effect_switches.EFFECT_KEYS:
            self._toggle(effect_switches.EFFECT_KEYS[key])
        else:
            return False
        return True

    def _toggle(self, name: str) -> None:
        """Toggle an effect, if the scene allows it."""
        before = self._switched
        if name in before:
            self._switched = [one for one in before if one != name]
        else:
            self._switched = [*before, name]
        problem = self._rebuild()
        if problem is not None:
            self._switched, self._message = before, problem

    def _set_modes(self, modes: Mapping[str, str | None]) -> None:
        """Set the modes of effects, by key."""
        before = self._modes
        self._modes = {**before, **modes}
        problem = self._rebuild()
        if problem is not None:
            self._modes, self._message = before, problem

    def _rebuild(self) -> str | None:
        """Rebuild the visible scene; return the problem if it cannot be drawn, else None."""
        scene = self.scene
        if self._hidden:
            scene = copy(scene)
            nodes = [self.scene.nodes[number] for number in self.numbers]
            # A scene must not be empty: a face without area is never seen.
            scene.nodes = nodes or [Node(Mesh([self._ball.center] * 3, [[0, 1, 2]]))]
            if (shading := scene._reference_shading) is not None:
                # The reference shader holds rows of objects: keep those of visible ones.
                scene._reference_shading = shading.select_objects(self.numbers) if nodes else None
        used = effect_switches.find_used_effects(scene, self.camera, self.size)
        for name in self._switched:
            changed = effect_switches.toggle(scene, name, used)
            if changed is None:
                return f"the scene has nothing for {name}"
            scene = changed
        for key, mode in self._modes.items():
            effect = effect_switches.MODAL_EFFECTS[key]
            if mode != effect.mode_of(scene):
                scene = effect.with_mode(scene, mode)
        try:
            explain(scene, self.camera, size=self.size, **self._options)
        except ValueError as error:
            return str(error)
        self._visible = scene
        changes = [f"{name} {'off' if name in used else 'on'}" for name in self._switched]
        self._message, self._times = ", ".join(changes), self._make_times()
        self._invalidate()
        # Only after `_invalidate`: a running step must not store costs of the old scene.
        self.costs = None
        return None

    def _get_depth_under(self, event: Event) -> float | None:
        """Return the depth under the cursor, scene units; None where it is unknown."""
        frame = self._frame
        if frame is None or frame.plan.size not in (self.size, _halve(self.size)):
            return None
        column, row = (int(event[axis] * self.ratio) for axis in ("x", "y"))
        width, height = self.size
        if not (0 <= column < width and 0 <= row < height):
            return None
        if frame.plan.size != self.size:
            column, row = column // SHRINK, row // SHRINK
        depth = float(frame.depth[row, column])
        return depth if math.isfinite(depth) else None

    def _draw_overlay(self, picture: NDArray[np.uint8]) -> None:
        """Draw the mark, panels and status line on a picture."""
        explained = self.explanation
        if explained is not None and explained.size == picture.shape[1::-1]:
            mark_pixel(picture, explained.x, explained.y, self.ratio)
        if not self.writes_text:
            return
        if self._shows_help:
            write_panel(picture, self.help_rows, "top left", self.ratio)
        elif self.explanation is not None:
            write_panel(picture, as_rows(self.explanation), "top left", self.ratio)
        if self._shows_costs:
            write_panel(picture, self._format_costs(), "top right", self.ratio)
        if self._shows_line:
            line = f"{self.line}   {self.help_key} help"
            write_panel(picture, [(line,)], "bottom left", self.ratio)

    def _format_costs(self) -> list[Row]:
        """Return the costs of the effects, as rows."""
        if self.costs is None:
            return [("measuring ...",)]
        rows = [(name, f"{1e3 * seconds:+.2f} ms") for name, seconds in self.costs.items()]
        frame_row = ("frame", f"{1e3 * self.costs['frame']:.2f} ms")
        return [("standard quality",), frame_row, *rows[1:]]


def _time_frames(frames: Iterator[Frame]) -> Iterator[tuple[Frame, float]]:
    """Yield frames and their times, seconds; one made of earlier pictures includes theirs."""
    total, quality = 0.0, None
    start = perf_counter()
    for frame in frames:
        seconds = perf_counter() - start
        total = seconds + (total if frame.plan.quality == quality else 0.0)
        quality = frame.plan.quality
        yield frame, total
        start = perf_counter()


def _halve(size: tuple[int, int]) -> tuple[int, int]:
    """Return half of a size, rounded up."""
    width, height = size
    return -(-width // SHRINK), -(-height // SHRINK)


def _format_seconds(seconds: float) -> str:
    """Format a time with two digits or more."""
    if seconds >= 1.0:
        return f"{seconds:.1f} s"
    return f"{1e3 * seconds:.0f} ms" if seconds >= 0.01 else f"{1e3 * seconds:.1f} ms"


def _make_renderer(size: tuple[int, int], threads: int | None) -> Renderer:
    """Return a renderer without warnings."""
    renderer = Renderer(size, threads=threads)
    renderer.warned = None
    return renderer
