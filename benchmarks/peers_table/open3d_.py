"""Open3D: Filament for pictures, and its rays."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import shapes

DISTRIBUTIONS = ("open3d",)

if "DISPLAY" not in os.environ:
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")


class Place:
    """A renderer; a second one in the same process ends it, so all pictures share it."""

    renderer: Any = None


def stage(eye: Any = (0, 0, 0), target: Any = (0, 0, -1), shader: str = "defaultLit") -> Any:
    """Return the renderer, empty, with a camera, and a material."""
    import open3d

    rendering = open3d.visualization.rendering
    if Place.renderer is None:
        Place.renderer = rendering.OffscreenRenderer(*shapes.SIZE)
    found = Place.renderer
    found.scene.clear_geometry()
    found.scene.set_background(np.array([0.0, 0, 0, 1]))
    found.setup_camera(
        shapes.FOV_Y, np.array(target, np.float32), np.array(eye, np.float32), [0, 1, 0],
        shapes.NEAR, shapes.FAR,
    )  # fmt: skip
    material = rendering.MaterialRecord()
    material.shader = shader
    return found, material


def mesh_of(vertices: Any) -> Any:
    """Return a mesh."""
    import open3d

    found = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(np.asarray(vertices, float)),
        open3d.utility.Vector3iVector(shapes.QUAD),
    )
    found.compute_vertex_normals()
    return found


def picture(folder: Path) -> Any:
    """Draw the teapot."""
    import open3d

    found, material = stage(shapes.EYE, shapes.TARGET)
    mesh = open3d.io.read_triangle_mesh(str(folder / "teapot.obj"))
    mesh.compute_vertex_normals()
    found.scene.add_geometry("teapot", mesh, material)
    return np.asarray(found.render_to_image())


def depth(folder: Path) -> float:
    """Return the error of depth."""
    found, material = stage(shader="defaultUnlit")
    found.scene.add_geometry("wall", mesh_of(shapes.WALL), material)
    image = found.render_to_depth_image(z_in_view_space=True)
    return shapes.depth_error(np.asarray(image, np.float64))


def cast() -> Any:
    """Cast a ray through each pixel's centre at two rectangles."""
    import open3d

    held = open3d.t.geometry.RaycastingScene()
    for vertices in (shapes.UPRIGHT, shapes.UPRIGHT * (1, 1, 2) + (0, 1, 0)):
        held.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(mesh_of(vertices)))
    directions = shapes.rays().reshape(-1, 3)
    both = np.hstack([np.zeros_like(directions), directions]).astype(np.float32)
    return held.cast_rays(open3d.core.Tensor(both))


def face_id(folder: Path) -> str:
    """Find face numbers by rays."""
    found = cast()
    hit = np.isfinite(found["t_hit"].numpy())
    assert set(np.unique(found["primitive_ids"].numpy()[hit])) == {0, 1}
    return "rays"


def masks(folder: Path) -> str:
    """Find objects by rays."""
    found = cast()
    hit = np.isfinite(found["t_hit"].numpy())
    assert set(np.unique(found["geometry_ids"].numpy()[hit])) == {0, 1}
    return "rays"


def normals(folder: Path) -> str:
    """Find normals by rays."""
    found = cast()
    hit = np.isfinite(found["t_hit"].numpy())
    assert np.allclose(np.abs(found["primitive_normals"].numpy()[hit]), (0, 0, 1), atol=1e-5)
    return "rays"


def motion(folder: Path) -> bool:
    """Find no motion vectors."""
    return shapes.absent("open3d.visualization.rendering", "motion_?vec|velocity|optical_?flow")


def lens(folder: Path) -> bool:
    """Find no lens."""
    return shapes.absent("open3d.visualization.rendering", "distort|fisheye")


def antialiasing(folder: Path) -> bool:
    """Draw a rectangle."""
    found, material = stage(shader="defaultUnlit")
    found.scene.view.set_antialiasing(True)
    found.scene.view.set_sample_count(4)
    found.scene.add_geometry("one", mesh_of(shapes.UPRIGHT), material)
    return shapes.is_smooth(np.asarray(found.render_to_image()))


def shadows(folder: Path) -> bool:
    """Draw a plate above a floor, with shadows and without."""
    found, material = stage()
    material.base_color = (0.8, 0.8, 0.8, 1)
    found.scene.add_geometry("floor", mesh_of(shapes.FLOOR), material)
    plate = mesh_of(shapes.BLOCKER)
    found.scene.add_geometry("plate", plate, material)
    profile = found.scene.LightingProfile
    pictures = []
    for look in (profile.NO_SHADOWS, profile.HARD_SHADOWS):
        found.scene.set_lighting(look, -shapes.TO_LIGHT.astype(np.float32))
        pictures.append(np.asarray(found.render_to_image()).copy())
    return shapes.differ(*pictures)


def transparency(folder: Path) -> bool:
    """Draw crossing panes in both orders."""
    pictures = []
    for order in (0, 1), (1, 0):
        found, _ = stage()
        for number in order:
            mesh = mesh_of(shapes.turned((30, -30)[number]))
            found.scene.add_geometry(f"pane {number}", mesh, pane_material(number))
        pictures.append(np.asarray(found.render_to_image()).copy())
    return shapes.crosses(*pictures)


def pane_material(number: int) -> Any:
    """Return the material of a pane."""
    import open3d

    material = open3d.visualization.rendering.MaterialRecord()
    material.shader = "defaultLitTransparency"
    material.base_color = ((1, 0, 0, 0.5), (0, 0, 1, 0.5))[number]
    material.has_alpha = True
    return material


def metallic(folder: Path) -> bool:
    """Draw metal and plastic, with what the files say of them."""
    import open3d

    pictures = []
    for name in ("metal", "plastic"):
        found, material = stage()
        model = open3d.io.read_triangle_model(str(folder / f"{name}.glb"))
        read = model.materials[0]
        material.base_color = read.base_color
        material.base_metallic, material.base_roughness = read.base_metallic, read.base_roughness
        found.scene.add_geometry("knot", model.meshes[0].mesh, material)
        pictures.append(np.asarray(found.render_to_image()).copy())
    return shapes.differ(*pictures)


def animation(folder: Path) -> bool:
    """Find no characters."""
    return shapes.absent("open3d.visualization.rendering", "skin|joint|skelet|animat|keyframe")


def points(folder: Path) -> bool:
    """Draw points."""
    import open3d

    found, material = stage(shader="defaultUnlit")
    places = open3d.utility.Vector3dVector(np.load(folder / "points.npy"))
    cloud = open3d.geometry.PointCloud(places)
    cloud.paint_uniform_color((1, 1, 1))
    material.point_size = 4.0
    found.scene.add_geometry("cloud", cloud, material)
    return bool((np.asarray(found.render_to_image()).max(axis=2) > 100).sum() > 500)


def rays(folder: Path) -> bool:
    """Cast rays."""
    return bool(np.isfinite(cast()["t_hit"].numpy()).any())


def window(folder: Path) -> bool:
    """Open a window for a moment."""
    import open3d

    viewer = open3d.visualization.Visualizer()
    is_open = viewer.create_window(width=shapes.SIZE[0], height=shapes.SIZE[1])
    viewer.add_geometry(mesh_of(shapes.UPRIGHT))
    viewer.poll_events()
    viewer.destroy_window()
    return bool(is_open)
