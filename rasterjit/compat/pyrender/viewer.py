"""Show scenes in a window."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.pyrender.camera import PerspectiveCamera
from rasterjit.compat.pyrender.constants import RenderFlags
from rasterjit.compat.pyrender.drawing import (
    add_lights,
    background_codes,
    background_light,
    camera_of,
    check_flags,
    convert,
)
from rasterjit.compat.pyrender.light import DirectionalLight
from rasterjit.compat.pyrender.scene import Scene
from rasterjit.scene import transforms
from rasterjit.scene.camera import PerspectiveCamera as MovableCamera
from rasterjit.scene.framing import fit_camera
from rasterjit.scene.scene import Scene as DrawnScene
from rasterjit.scene.validation import image_size, in_short

_RAYMOND_AZIMUTHS = (0.0, 120.0, 240.0)
_RAYMOND_TILT = 30.0
"""Degrees: three lights around the viewer, each 30 from where it looks from."""

_FLAGS = {
    "flip_wireframe": RenderFlags.FLIP_WIREFRAME,
    "all_wireframe": RenderFlags.ALL_WIREFRAME,
    "all_solid": RenderFlags.ALL_SOLID,
    "shadows": RenderFlags.SHADOWS_DIRECTIONAL | RenderFlags.SHADOWS_SPOT,
    "vertex_normals": RenderFlags.VERTEX_NORMALS,
    "face_normals": RenderFlags.FACE_NORMALS,
}
"""Options that are flags."""


class Viewer:
    """
    A window that shows a scene, with RasterJIT's own viewer and its keys.

    Parameters
    ----------
    scene : Scene
        Shown through its main camera, or whole if it has none. Points are left out.
    viewport_size : (int, int), optional
        Width and height, pixels; default 640 by 480.
    render_flags, viewer_flags : mapping, optional
        Of pyrender: ``shadows``, ``all_wireframe``, ``all_solid``, ``cull_faces``,
        ``use_raymond_lighting`` and ``use_direct_lighting`` count; others have no effect.
    registered_keys
        Taken and without effect.
    run_in_thread : bool
        Refused but in a notebook, which goes on at once: elsewhere this returns when the window is
        closed.
    **kwargs
        The same by keyword.

    Raises
    ------
    ValueError
        If the scene is none, something cannot be drawn, or it is to run in a thread.
    ImportError
        If nothing is installed that could show it, naming the extra to install.
    """

    def __init__(
        self,
        scene: Scene,
        viewport_size: tuple[int, int] | None = None,
        render_flags: Mapping[str, Any] | None = None,
        viewer_flags: Mapping[str, Any] | None = None,
        registered_keys: Any = None,
        run_in_thread: bool = False,
        **kwargs: Any,
    ) -> None:
        if not isinstance(scene, Scene):
            raise ValueError(f"scene must be a Scene of this module, got {in_short(scene)}")
        from rasterjit.viewer import show

        is_notebook = show.choose_backend("auto") == "notebook"
        if run_in_thread and not is_notebook:
            raise ValueError(
                "run_in_thread must be False, got True: the window runs until it is closed; to go "
                "on meanwhile, show it in a process of its own (multiprocessing) or in a notebook"
            )
        size = image_size("viewport_size", (640, 480) if viewport_size is None else viewport_size)
        options = {**(render_flags or {}), **(viewer_flags or {}), **kwargs}
        self.scene, self.viewport_size = scene, size
        shown = scene_to_show(scene, size, options)
        behind = background_light(background_codes(scene), flags_of(options))
        shown_in = show.show(shown, size=size, background=behind)
        if is_notebook and shown_in is not None:
            from IPython.display import display

            # Wherever in its cell: the other windows, too, open when they are made.
            display(shown_in)


def scene_to_show(scene: Scene, size: tuple[int, int], options: Mapping[str, Any]) -> DrawnScene:
    """Return what the viewer shows: the scene with its camera, and the lights asked for."""
    drawn = convert(scene, flags_of(options)).scene
    if scene.main_camera_node is not None:
        pose = scene.get_pose(scene.main_camera_node)
        drawn.camera = _movable(scene.main_camera_node.camera, pose) or camera_of(scene, size)
    else:
        drawn.camera = fit_camera(drawn, aspect=size[0] / size[1])
        pose = np.eye(4)
        pose[:3, :3] = drawn.camera.view_matrix()[:3, :3].T
    added = []
    if options.get("use_raymond_lighting"):
        added += [transforms.compose(pose, turn) for turn in _raymond_turns()]
    if options.get("use_direct_lighting"):
        added.append(pose)
    lights = [(DirectionalLight(), place) for place in added]
    if not scene.light_nodes and not added and not scene.ambient_light.any():
        # A window that is black helps nobody.
        lights.append((DirectionalLight(intensity=math.pi), pose))
    add_lights(drawn, lights)
    return drawn


def flags_of(options: Mapping[str, Any]) -> RenderFlags:
    """Return the flags that the options of a viewer ask for."""
    flags = RenderFlags.NONE if options.get("cull_faces", True) else RenderFlags.SKIP_CULL_FACES
    for name, flag in _FLAGS.items():
        if options.get(name):
            flags |= flag
    return check_flags(flags)


def _movable(camera: Any, pose: NDArray[np.float64]) -> MovableCamera | None:
    """Return a camera of the viewport's own shape as one that a hand can move."""
    if not isinstance(camera, PerspectiveCamera) or camera.aspectRatio is not None:
        return None
    eye, back, up = pose[:3, 3], pose[:3, 2], pose[:3, 1]
    far = math.inf if camera.zfar is None else camera.zfar
    fov_y = math.degrees(camera.yfov)
    return MovableCamera(eye, eye - back, up, fov_y=fov_y, near=camera.znear, far=far)


def _raymond_turns() -> list[NDArray[np.float64]]:
    """Return where the three lights stand, (4, 4) each, relative to the camera."""
    return [
        transforms.compose(transforms.rotate_z(around), transforms.rotate_y(_RAYMOND_TILT))
        for around in _RAYMOND_AZIMUTHS
    ]
