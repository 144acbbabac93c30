"""F3D, by its Python package."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import f3d
import numpy as np
import shapes
from numpy.typing import NDArray

DISTRIBUTIONS = ("f3d",)


def engine(eye: Any = (0, 0, 0), target: Any = (0, 0, -1), *files: Path, **options: Any) -> Any:
    """Return an engine with files and a camera."""
    f3d.Engine.autoload_plugins()
    try:
        found = f3d.Engine.create_egl()
    except Exception:  # a type of its own
        found = f3d.Engine.create_osmesa()
    found.window.size = shapes.SIZE
    found.options.update({"render.background.color": (0.0, 0.0, 0.0), **options})
    for file in files:
        found.scene.add(str(file))
    camera = found.window.camera
    camera.position, camera.focal_point, camera.view_up = eye, target, (0, 1, 0)
    camera.view_angle = shapes.FOV_Y
    return found


def draw(found: Any) -> NDArray[np.uint8]:
    """Return a picture."""
    image = found.window.render_to_image()
    shape = image.height, image.width, image.channel_count
    return np.frombuffer(image.content, np.uint8).reshape(shape)[::-1]


def added(vertices: Any, **options: Any) -> Any:
    """Return an engine with a rectangle."""
    found = engine(**options)
    mesh = f3d.Mesh(
        np.asarray(vertices, float).ravel().tolist(), [], [], [3, 3], shapes.QUAD.ravel().tolist()
    )
    found.scene.add(mesh)
    camera = found.window.camera
    camera.position, camera.focal_point, camera.view_up = (0, 0, 0), (0, 0, -1), (0, 1, 0)
    camera.view_angle = shapes.FOV_Y
    return found


def settings() -> list[str]:
    """Return the names of all options."""
    engine = f3d.Engine.create_none()  # which the options live in
    return list(engine.options.keys())


def lacking(pattern: str) -> bool:
    """Return ``False`` if neither options nor names have a pattern."""
    import re

    found = [name for name in settings() if re.search(pattern, name)]
    if found:
        raise LookupError(f"f3d has the options {', '.join(found)}")
    return shapes.absent("f3d", pattern)


def picture(folder: Path) -> Any:
    """Draw the teapot."""
    return draw(engine(shapes.EYE, shapes.TARGET, folder / "teapot.obj"))


def depth(folder: Path) -> bool:
    """Find no depth but as a picture of 8 bits."""
    found = added(shapes.WALL, **{"render.effect.display_depth": True})
    kind = found.window.render_to_image().channel_type
    if kind != f3d.Image.ChannelType.BYTE:
        raise LookupError(f"f3d's pictures have {kind}")
    return False


def face_id(folder: Path) -> bool:
    """Find no face numbers."""
    return lacking("face_?id|cell_?id|primitive_?id|pick")


def masks(folder: Path) -> bool:
    """Find no numbers of objects."""
    return lacking("mask|segment|object_?id|node_?id")


def normals(folder: Path) -> bool:
    """Find no picture of normals but of 8 bits."""
    return lacking("normal_?(image|buffer|map|pass)|display_normal")


def motion(folder: Path) -> bool:
    """Find no motion vectors."""
    return lacking("motion|velocity|flow")


def lens(folder: Path) -> bool:
    """Find no lens."""
    return lacking("distort|fisheye|lens")


def antialiasing(folder: Path) -> bool:
    """Draw a rectangle."""
    options = {"render.effect.antialiasing.mode": "ssaa"}
    return shapes.is_smooth(draw(added(shapes.UPRIGHT, **options)))


def shadows(folder: Path) -> bool:
    """Find no shadows."""
    return lacking("shadow")


def transparency(folder: Path) -> bool:
    """Draw crossing panes in both orders."""
    options = {"render.effect.blending.mode": "ddp"}
    pictures = [
        draw(engine((0, 0, 0), (0, 0, -1), folder / f"panes_{order}.glb", **options))
        for order in ("ab", "ba")
    ]
    return shapes.crosses(*pictures)


def metallic(folder: Path) -> bool:
    """Draw metal and plastic."""
    pictures = [
        draw(engine((0, 0, 0), (0, 0, -1), folder / f"{name}.glb")) for name in ("metal", "plastic")
    ]
    return shapes.differ(*pictures)


def animation(folder: Path) -> bool:
    """Draw a character at two times."""
    found = engine((0, 1, 3), (0, 1, 0), folder / "figure.glb")
    pictures = []
    for time in (0.1, 0.5):
        found.scene.animation.load_time(time)
        pictures.append(draw(found).copy())
    return shapes.differ(*pictures)


def points(folder: Path) -> bool:
    """Draw points."""
    found = engine((0, 0, 0), (0, 0, -1), folder / "points.ply")
    return bool((draw(found).max(axis=2) > 60).sum() > 500)


def rays(folder: Path) -> bool:
    """Find no rays: those of its options are VTK's path tracer, which the package lacks."""
    if f3d.Engine.get_lib_info().modules["Raytracing"]:
        raise LookupError("f3d has ray tracing")
    return shapes.absent("f3d", "ray_?cast|cast_ray|intersect")


def window(folder: Path) -> bool:
    """Open a window for a moment."""
    f3d.Engine.autoload_plugins()
    found = f3d.Engine.create(False)
    found.scene.add(str(folder / "teapot.obj"))
    found.window.render()
    return not found.window.offscreen
