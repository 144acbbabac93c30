"""trimesh: its viewer for pictures, and its rays."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import shapes
from numpy.typing import NDArray

DISTRIBUTIONS = ("trimesh", "pyglet", "scipy")
"""What its viewer needs; rays need ``embreex`` besides, or ``rtree``."""


def scene_of(path: Path | None = None, vertices: Any = None) -> Any:
    """Return a scene, seen from the eye."""
    import trimesh

    if path is not None:
        scene = trimesh.load_scene(path)
    else:
        scene = trimesh.Scene(trimesh.Trimesh(vertices, shapes.QUAD, process=False))
    width, height = shapes.SIZE
    fov_x = 2 * np.degrees(np.arctan(np.tan(np.radians(shapes.FOV_Y / 2)) * width / height))
    scene.camera = trimesh.scene.Camera(
        resolution=shapes.SIZE, fov=(fov_x, shapes.FOV_Y), z_near=shapes.NEAR, z_far=shapes.FAR
    )
    scene.camera_transform = np.eye(4)
    return scene


def draw(scene: Any, **options: Any) -> NDArray[np.uint8]:
    """Draw a scene in its hidden window."""
    from PIL import Image

    data = scene.save_image(resolution=shapes.SIZE, visible=False, **options)
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def picture(folder: Path) -> Any:
    """Draw the teapot."""
    scene = scene_of(folder / "teapot.obj")
    back = np.subtract(shapes.EYE, shapes.TARGET)
    back = back / np.linalg.norm(back)
    right = np.cross((0, 1, 0), back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.array([right, np.cross(back, right), back]).T, shapes.EYE
    scene.camera_transform = pose
    return draw(scene)


def cast(vertices: Any) -> tuple[Any, NDArray[Any]]:
    """Cast a ray through each pixel's centre; return the mesh and the first face, (H, W)."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, shapes.QUAD, process=False)
    directions = shapes.rays().reshape(-1, 3)
    first = mesh.ray.intersects_first(np.zeros_like(directions), directions)
    return mesh, first.reshape(shapes.SIZE[::-1])


def depth(folder: Path) -> float:
    """Return the error of depth, by rays."""
    import trimesh

    mesh = trimesh.Trimesh(shapes.WALL, shapes.QUAD, process=False)
    directions = shapes.rays().reshape(-1, 3)
    places, hit, _ = mesh.ray.intersects_location(
        np.zeros_like(directions), directions, multiple_hits=False
    )
    found = np.full(len(directions), np.inf)
    found[hit] = -places[:, 2]
    return shapes.depth_error(found.reshape(shapes.SIZE[::-1]))


def face_id(folder: Path) -> str:
    """Find face numbers by rays."""
    assert set(np.unique(cast(shapes.UPRIGHT)[1])) == {-1, 0, 1}
    return "rays"


def masks(folder: Path) -> bool:
    """Find no numbers of objects."""
    return shapes.absent("trimesh", "instance_ids?$|object_ids?$|geometry_ids?$|segmentation")


def normals(folder: Path) -> str:
    """Find normals by rays."""
    mesh, first = cast(shapes.UPRIGHT)
    assert np.allclose(mesh.face_normals[first[first >= 0]], (0, 0, 1))
    return "rays"


def motion(folder: Path) -> bool:
    """Find no motion vectors."""
    return shapes.absent("trimesh", "motion_?vec|velocity|optical_?flow")


def lens(folder: Path) -> bool:
    """Find no lens."""
    return shapes.absent("trimesh", "undistort|distortion|fisheye")


def antialiasing(folder: Path) -> bool:
    """Ask its window how many samples it has; whether they count is the X server's affair."""
    from pyglet import gl

    viewer = scene_of(vertices=shapes.UPRIGHT).show(start_loop=False)
    viewer.switch_to()
    samples = gl.GLint()
    gl.glGetIntegerv(gl.GL_SAMPLES, samples)
    return int(samples.value) >= 4


def shadows(folder: Path) -> bool:
    """Find no shadows."""
    return shapes.absent("trimesh", "shadow")


def transparency(folder: Path) -> bool:
    """Draw crossing panes in both orders."""
    pictures = [draw(scene_of(folder / f"panes_{o}.glb")) for o in ("ab", "ba")]
    return shapes.crosses(*pictures)


def metallic(folder: Path) -> bool:
    """Draw metal and plastic."""
    pictures = [draw(scene_of(folder / f"{name}.glb")) for name in ("metal", "plastic")]
    return shapes.differ(*pictures)


def animation(folder: Path) -> bool:
    """Find no characters."""
    return shapes.absent("trimesh", "skin|skelet|keyframe")


def points(folder: Path) -> bool:
    """Draw points."""
    import trimesh

    scene = scene_of(vertices=shapes.UPRIGHT + (0, 0, 100))
    cloud = trimesh.PointCloud(np.load(folder / "points.npy"), colors=[255, 0, 0, 255])
    scene.add_geometry(cloud)
    found = draw(scene, background=[0, 0, 0, 255])
    return bool((found.max(axis=2) > 100).sum() > 500)


def rays(folder: Path) -> bool:
    """Cast rays."""
    return bool((cast(shapes.UPRIGHT)[1] >= 0).any())


def window(folder: Path) -> bool:
    """Open the viewer for a moment."""
    import pyglet

    scene = scene_of(vertices=shapes.UPRIGHT)
    viewer = scene.show(start_loop=False)
    pyglet.clock.tick()
    return viewer.context is not None
