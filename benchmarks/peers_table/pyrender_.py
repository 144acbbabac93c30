"""pyrender with EGL."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import shapes
from numpy.typing import NDArray

DISTRIBUTIONS = ("pyrender",)

os.environ["PYOPENGL_PLATFORM"] = "egl"


def draw(
    meshes: list[Any], flags: str = "NONE", pose: Any = None, light: Any = None, **options: Any
) -> Any:
    """Draw meshes, and return what pyrender returns."""
    import pyrender

    scene = pyrender.Scene(bg_color=(0, 0, 0, 0), ambient_light=options.pop("ambient", (0.3,) * 3))
    nodes = [scene.add(mesh) for mesh in meshes]
    camera = pyrender.PerspectiveCamera(
        np.radians(shapes.FOV_Y), znear=shapes.NEAR, zfar=shapes.FAR
    )
    scene.add(camera, pose=np.eye(4) if pose is None else pose)
    lamp = pyrender.DirectionalLight(intensity=3.0)
    scene.add(lamp, pose=looking(TO_LAMP, (0, 0, 0)) if light is None else light)
    renderer = pyrender.OffscreenRenderer(*shapes.SIZE)
    bits = 0
    for name in flags.split("|"):
        bits |= getattr(pyrender.RenderFlags, name)
    numbered = {node: (number + 1,) * 3 for number, node in enumerate(nodes)}
    return renderer.render(scene, bits, seg_node_map=numbered)


TO_LAMP = tuple(5 * shapes.TO_LIGHT)


def looking(eye: Any, target: Any) -> NDArray[np.float64]:
    """Return the pose of what looks from a place at another."""
    back = np.subtract(eye, target) / np.linalg.norm(np.subtract(eye, target))
    right = np.cross((0, 1, 0), back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([right, np.cross(back, right), back]).T
    matrix[:3, 3] = eye
    return matrix


def mesh_of(vertices: Any, faces: Any = shapes.QUAD) -> Any:
    """Return a mesh of pyrender."""
    import pyrender
    import trimesh

    return pyrender.Mesh.from_trimesh(trimesh.Trimesh(vertices, faces, process=False), smooth=False)


def loaded(path: Path) -> list[Any]:
    """Return the meshes of a file."""
    import pyrender
    import trimesh

    found = trimesh.load(path)
    parts = found.dump() if hasattr(found, "geometry") else [found]
    return [pyrender.Mesh.from_trimesh(part) for part in parts]


def picture(folder: Path) -> Any:
    """Draw the teapot."""
    return draw(loaded(folder / "teapot.obj"), pose=looking(shapes.EYE, shapes.TARGET))[0]


def depth(folder: Path) -> float:
    """Return the error of depth, at the centres of pixels, where ``SEG`` takes it."""
    return shapes.depth_error(draw([mesh_of(shapes.WALL)], "SEG|SKIP_CULL_FACES")[1])


def face_id(folder: Path) -> bool:
    """Find no face numbers."""
    return shapes.absent("pyrender", "face_?id|triangle_?id|primitive_?id")


def masks(folder: Path) -> bool:
    """Number two objects."""
    parts = [mesh_of(shapes.UPRIGHT), mesh_of(shapes.UPRIGHT * (1, 1, 2) + (0, 1, 0))]
    return set(np.unique(draw(parts, "SEG|SKIP_CULL_FACES")[0])) == {0, 1, 2}


def normals(folder: Path) -> bool:
    """Find no picture of normals."""
    return shapes.absent("pyrender", "normal_?(image|buffer|map|pass)|render_?normal")


def motion(folder: Path) -> bool:
    """Find no motion vectors."""
    return shapes.absent("pyrender", "motion_?vec|velocity|flow")


def lens(folder: Path) -> bool:
    """Find no lens."""
    return shapes.absent("pyrender", "distort|fisheye")


def antialiasing(folder: Path) -> bool:
    """Draw a rectangle."""
    return shapes.is_smooth(draw([mesh_of(shapes.UPRIGHT)], "FLAT")[0])


def shadows(folder: Path) -> bool:
    """Draw a plate above a floor, with shadows and without."""
    parts = mesh_of(shapes.FLOOR), mesh_of(shapes.BLOCKER)
    pictures = [
        draw(list(parts), f"SKIP_CULL_FACES|{flag}")[0] for flag in ("NONE", "SHADOWS_DIRECTIONAL")
    ]
    return shapes.differ(*pictures)


def transparency(folder: Path) -> bool:
    """Draw crossing panes in both orders."""
    pictures = [draw(loaded(folder / f"panes_{o}.glb"), "SKIP_CULL_FACES")[0] for o in ("ab", "ba")]
    return shapes.crosses(*pictures)


def metallic(folder: Path) -> bool:
    """Draw metal and plastic."""
    pictures = [draw(loaded(folder / f"{name}.glb"))[0] for name in ("metal", "plastic")]
    return shapes.differ(*pictures)


def animation(folder: Path) -> bool:
    """Find no time of an animation."""
    return shapes.absent("pyrender", "load_time|set_time|keyframe|play_?anim")


def points(folder: Path) -> bool:
    """Draw points."""
    import pyrender

    places = np.load(folder / "points.npy")
    cloud = pyrender.Mesh.from_points(places, colors=np.full((len(places), 3), 255, np.uint8))
    return bool((draw([cloud], "FLAT")[0].max(axis=2) > 100).sum() > 500)


def rays(folder: Path) -> bool:
    """Find no rays."""
    return shapes.absent("pyrender", "ray_?cast|cast_ray|intersects|ray_?trac")


def window(folder: Path) -> bool:
    """Open the viewer for a second."""
    import time

    del os.environ["PYOPENGL_PLATFORM"]
    import pyrender

    scene = pyrender.Scene()
    scene.add(mesh_of(shapes.UPRIGHT))
    viewer = pyrender.Viewer(scene, run_in_thread=True)
    time.sleep(1.0)
    is_open = viewer.is_active
    viewer.close_external()
    return bool(is_open)
