"""
Draw trimesh's scenes without a display, by the calls that scripts have.

>>> import rasterjit.compat.trimesh
>>> rasterjit.compat.trimesh.install()

From then on ``trimesh.Scene.save_image`` returns a PNG that RasterJIT drew, and ``show`` of scenes
and geometries opens its viewer. Both take the arguments of trimesh's ``SceneViewer``. Camera,
field of view, resolution, background, culling, wireframe, axes, grid, widths and four samples a
pixel are as there. Lights that somebody gave the scene are used; those that trimesh makes up are
replaced by a headlight.

References
----------
trimesh 5.2, ``trimesh.viewer.windowed``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from rasterjit.io import cameras
from rasterjit.io.images import encode_png
from rasterjit.io.meshes import from_trimesh
from rasterjit.rendering.renderer import render
from rasterjit.scene.guides import Axes, Grid
from rasterjit.scene.lines import Lines
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.points import Points, size_array
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import (
    boolean,
    brief,
    image_size,
    one_of,
    positive_number,
    read_only,
)
from rasterjit.scene.wireframe import Wireframe
from rasterjit.viewer.show import show as show_scene

__all__ = ["install", "save_image", "show"]

DEFAULT_FLAGS = {
    "cull": True,
    "wireframe": False,
    "axis": False,
    "grid": False,
    "fullscreen": False,
}
"""Names of flags, with their defaults."""

AXIS_CHOICES = ("world", "all", "without_world")
"""Where the flag ``axis`` puts axes: at the world's origin, there and at all frames, at frames."""

DEFAULT_COLOR = trimesh.visual.color.DEFAULT_COLOR
"""Of meshes without a colour, and of wires."""

OPTIONS = ("background", "smooth", "flags", "line_settings")
"""Options of trimesh's window that a picture follows."""

WINDOW_OPTIONS = (
    "visible", "fullscreen", "resizable", "start_loop", "caption", "window_conf", "offset_lines",
    "fixed", "vsync", "style", "display", "screen",
)  # fmt: skip
"""Options of trimesh's window, which are taken and change nothing."""


def install() -> None:
    """Let ``save_image`` and ``show`` of trimesh's scenes be those of this module."""
    for function in (save_image, show):
        setattr(trimesh.Scene, function.__name__, function)


def save_image(scene: trimesh.Scene, resolution: ArrayLike | None = None, **options: Any) -> bytes:
    """
    Return a picture of a trimesh scene as a PNG file.

    Parameters
    ----------
    scene : trimesh.Scene
        Drawn from its camera, which trimesh makes up for scenes without one.
    resolution : (int, int), optional
        Width and height, pixels; set in ``scene.camera``, as trimesh does. Default: the camera's.
    **options
        - ``background``: RGB or RGBA, codes 0..255 or floats 0..1. Default: white.
        - ``smooth``: bool. False: each face has one normal.
        - ``flags``: mapping of ``cull`` (default True), ``wireframe`` and ``grid`` to bool, and of
          ``axis`` to True or ``"world"``, ``"all"`` or ``"without_world"``.
        - ``line_settings``: mapping of ``line_width`` and ``point_size`` to pixels.
        - Those of a window, such as ``visible`` and ``offset_lines``, change nothing.

    Raises
    ------
    ValueError
        If an option is unknown or has a value that it cannot have, or the scene is empty.

    Warns
    -----
    LoadWarning
        Once, naming what of the scene is not drawn.
    """
    frame = render(
        **_make_render_arguments(scene, resolution, **options),
        quality=Quality(samples=4, blending="srgb8"),
    )
    return encode_png(frame.color)


def show(scene: trimesh.Scene, viewer: Any = None, **options: Any) -> Any:
    """
    Show a trimesh scene as `rasterjit.show` does: in a notebook, a window, a page or a terminal.

    Parameters
    ----------
    scene : trimesh.Scene
    viewer : callable or str, optional
        What is callable is called with the scene and the options, as trimesh does. Names of
        trimesh's viewers mean this one.
    **options
        ``resolution`` and the options of `save_image`.

    Raises
    ------
    ValueError
        As `save_image`.
    """
    if callable(viewer):
        return viewer(scene, **options)
    one_of("viewer", viewer or "gl", ("gl", "jupyter", "marimo"))
    title = options.get("caption") or "RasterJIT"
    return show_scene(
        **_make_render_arguments(scene, options.pop("resolution", None), **options), title=title
    )


def _make_render_arguments(
    scene: trimesh.Scene, resolution: ArrayLike | None, background: Any = None,
    smooth: bool = True, flags: Mapping[str, Any] | None = None,
    line_settings: Mapping[str, float] | None = None, **window: Any,
) -> dict[str, Any]:  # fmt: skip
    """Return the arguments by which a scene is drawn."""
    for name in window:
        one_of("option", name, (*OPTIONS, *WINDOW_OPTIONS))
    wanted = scene.camera.resolution if resolution is None else resolution
    size = image_size("resolution", wanted.tolist() if isinstance(wanted, np.ndarray) else wanted)
    switches = _merge_options("flags", flags, DEFAULT_FLAGS)
    for name in ("cull", "wireframe", "grid", "fullscreen"):
        boolean(f"flags[{name!r}]", switches[name])
    # OpenGL draws nothing thinner than a pixel.
    widths = {"point_size": max(1.0, max(size) / 200), "line_width": max(1.0, max(size) / 400)}
    drawn = from_trimesh(scene)
    for name, width in _merge_options("line_settings", line_settings, widths).items():
        widths[name] = positive_number(f"line_settings[{name!r}]", width)
    _set_appearance(drawn, boolean("smooth", smooth), **widths)
    _add_helpers(drawn, scene, switches)
    if switches["wireframe"]:
        drawn.wireframe = Wireframe(DEFAULT_COLOR, "only")
    color = "white" if background is None else _check_color("background", background)
    scene.camera.resolution = size
    pose = np.asarray(scene.camera_transform, dtype=np.float64)
    return {
        "what": drawn, "size": size, "cull": "back" if switches["cull"] else "none",
        # OpenGL's pixels are square, whatever both fields of view say.
        "camera": replace(cameras.perspective_from_trimesh(scene.camera, pose), pixel_aspect=1.0),
        "background": color,
    }  # fmt: skip


def _merge_options(
    name: str, given: Mapping[str, Any] | None, defaults: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the defaults with what is given; raise if it is no mapping of their keys."""
    if given is not None and not isinstance(given, Mapping):
        raise ValueError(f"{name} must be a mapping, got {brief(given)}")
    for key in given or {}:
        one_of(f"key of {name}", key, tuple(defaults))
    return {**defaults, **(given or {})}


def _check_color(name: str, value: Any) -> NDArray[np.uint8]:
    """Return a colour as trimesh reads it, (4,) codes, or raise ``ValueError``."""
    try:
        color = np.asarray(trimesh.visual.to_rgba(value))
    except (TypeError, ValueError):
        color = np.zeros(0)
    if color.shape != (4,):
        raise ValueError(
            f"{name} must be RGB or RGBA, codes 0..255 or floats 0..1, got {brief(value)}"
        )
    return color


def _set_appearance(scene: Scene, smooth: bool, point_size: float, line_width: float) -> None:
    """Set widths, flat shading, the grey of meshes without a colour, and blending by alpha."""
    for mesh in {id(node.mesh): node.mesh for node in scene.every_node()}.values():
        if isinstance(mesh, Points):
            mesh._sizes = read_only(size_array("point_size", point_size, len(mesh), "pixel"))
        elif isinstance(mesh, Lines):
            mesh._widths = read_only(size_array("line_width", line_width, len(mesh), "pixel"))
        elif isinstance(mesh, Mesh):
            colors = mesh.face_colors if mesh.vertex_colors is None else mesh.vertex_colors
            material = mesh.material
            has_color = material.base_color is not None or material.base_color_texture is not None
            if colors is None and not has_color:
                material = replace(material, base_color=DEFAULT_COLOR)
            elif colors is not None and np.any(colors[:, 3] < 1.0):
                material = replace(material, alpha_mode="blend")
            mesh.material = material if smooth else replace(material, shading="flat")


def _add_helpers(drawn: Scene, scene: trimesh.Scene, flags: Mapping[str, Any]) -> None:
    """Add the axes and the grid that flags ask for, of trimesh's sizes."""
    where = flags["axis"]
    if not isinstance(where, bool):
        one_of("flags['axis']", where, AXIS_CHOICES)
    poses: list[NDArray[Any]] = []
    if where in (True, "world", "all"):
        poses.append(np.eye(4))
    if where in ("all", "without_world"):
        poses += [scene.graph[name][0] for name in scene.graph.nodes_geometry]
    for pose in poses:
        drawn.add(Axes(scene.scale / 10), pose)
    if flags["grid"]:
        low, high = scene.bounds
        extents, center = high - low, (low + high) / 2
        center[2] = low[2] - extents[2] / 100
        drawn.add(Grid(2 * max(extents[:2]), 8, plane="xy", center=center, color="black"))
