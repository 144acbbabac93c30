"""PyVista, and of VTK what it hands on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapes
from numpy.typing import NDArray

DISTRIBUTIONS = ("pyvista",)


def plotter(eye: Any = (0, 0, 0), target: Any = (0, 0, -1)) -> Any:
    """Return a plotter with a camera."""
    import pyvista

    found = pyvista.Plotter(off_screen=True, window_size=list(shapes.SIZE))
    found.set_background("black")
    camera = found.camera
    camera.position, camera.focal_point, camera.up = eye, target, (0, 1, 0)
    camera.view_angle = shapes.FOV_Y
    return found


def draw(found: Any) -> NDArray[np.uint8]:
    """Return its picture."""
    found.camera.clipping_range = (shapes.NEAR, shapes.FAR)
    found.show(auto_close=False, interactive=False)
    return np.asarray(found.screenshot(return_img=True))


def mesh_of(vertices: Any) -> Any:
    """Return a mesh."""
    import pyvista

    return pyvista.PolyData.from_regular_faces(np.asarray(vertices, float), shapes.QUAD)


def with_mesh(vertices: Any, **options: Any) -> Any:
    """Return a plotter with a mesh."""
    found = plotter()
    found.add_mesh(mesh_of(vertices), color="white", reset_camera=False, **options)
    return found


def picture(folder: Path) -> Any:
    """Draw the teapot."""
    import pyvista

    found = plotter(shapes.EYE, shapes.TARGET)
    found.add_mesh(pyvista.read(folder / "teapot.obj"), color="white", reset_camera=False)
    return draw(found)


def depth(folder: Path) -> float:
    """Return the error of depth."""
    found = with_mesh(shapes.WALL)
    found.disable_anti_aliasing()
    draw(found)
    found.camera.clipping_range = (shapes.NEAR, shapes.FAR)
    found.render()
    return shapes.depth_error(
        -np.asarray(found.get_image_depth(reset_camera_clipping_range=False), np.float64)
    )


def selected(folder: Path) -> list[tuple[int, int]]:
    """Return object and face at pixels across two rectangles, by VTK's selector."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkSelectionNode
    from vtkmodules.vtkRenderingCore import vtkHardwareSelector

    found = with_mesh(shapes.UPRIGHT)
    found.add_mesh(mesh_of(shapes.UPRIGHT * (1, 1, 2) + (0, 1, 0)), reset_camera=False)
    draw(found)
    selector = vtkHardwareSelector()
    selector.SetRenderer(found.renderer)
    selector.SetArea(0, 0, shapes.SIZE[0] - 1, shapes.SIZE[1] - 1)
    selector.SetFieldAssociation(vtkDataObject.FIELD_ASSOCIATION_CELLS)
    if not selector.CaptureBuffers():
        raise RuntimeError("no buffers")
    pixels = []
    for x in range(0, shapes.SIZE[0], 16):
        for y in range(0, shapes.SIZE[1], 16):
            chosen = selector.GenerateSelection(x, y, x, y)
            for number in range(chosen.GetNumberOfNodes()):
                node = chosen.GetNode(number)
                prop = node.GetProperties().Get(vtkSelectionNode.PROP_ID())
                pixels += [(prop, int(k)) for k in vtk_to_numpy(node.GetSelectionList())]
    return pixels


def face_id(folder: Path) -> str:
    """Find face numbers by VTK's selector."""
    assert {face for _, face in selected(folder)} == {0, 1}
    return "selector"


def masks(folder: Path) -> str:
    """Find objects by VTK's selector."""
    assert len({prop for prop, _ in selected(folder)}) == 2
    return "selector"


def normals(folder: Path) -> bool:
    """Find no picture of normals."""
    return shapes.absent("pyvista.plotting.plotter", "normal_?(image|buffer|map|pass)|image_normal")


def motion(folder: Path) -> bool:
    """Find no motion vectors."""
    return shapes.absent("pyvista.plotting.plotter", "motion_?vec|velocity|optical_?flow")


def lens(folder: Path) -> bool:
    """Draw through a distorted camera."""
    pictures = []
    for coefficients in (None, (0.1, 0.0, 0.0, 0.0)):
        found = with_mesh(shapes.UPRIGHT)
        if coefficients is not None:
            found.enable_camera_distortion(coefficients)
        pictures.append(draw(found))
    return shapes.differ(*pictures)


def antialiasing(folder: Path) -> bool:
    """Draw a rectangle."""
    found = with_mesh(shapes.UPRIGHT, lighting=False)
    found.enable_anti_aliasing("msaa", multi_samples=8)
    return shapes.is_smooth(draw(found))


def shadows(folder: Path) -> bool:
    """Draw a plate above a floor, with shadows and without."""
    import pyvista

    pictures = []
    for is_on in (False, True):
        found = with_mesh(shapes.FLOOR)
        found.add_mesh(mesh_of(shapes.BLOCKER), color="red", reset_camera=False)
        found.remove_all_lights()
        place = shapes.TO_LIGHT * 12 + (0, 0, -6)
        light = pyvista.Light(position=place, focal_point=(0, -1, -6), cone_angle=40)
        light.positional = True
        found.add_light(light)
        if is_on:
            found.enable_shadows()
        pictures.append(draw(found))
    return shapes.differ(*pictures)


def transparency(folder: Path) -> bool:
    """Draw crossing panes in both orders."""
    pictures = []
    for order in (0, 1), (1, 0):
        found = plotter()
        found.enable_depth_peeling(8)
        found.disable_anti_aliasing()
        for number in order:
            mesh, color = mesh_of(shapes.turned((30, -30)[number])), ("red", "blue")[number]
            found.add_mesh(mesh, color=color, opacity=0.5, lighting=False, reset_camera=False)
        pictures.append(draw(found))
    return shapes.crosses(*pictures)


def metallic(folder: Path) -> bool:
    """Draw metal and plastic."""
    pictures = []
    for name in ("metal", "plastic"):
        found = plotter()
        found.import_gltf(folder / f"{name}.glb", set_camera=False)
        pictures.append(draw(found))
    return shapes.differ(*pictures)


def animation(folder: Path) -> bool:
    """Find no time of an animation; VTK's importer, without PyVista, is not tried."""
    return shapes.absent("pyvista.plotting.plotter", "load_time|keyframe|gltf_anim|play_anim")


def points(folder: Path) -> bool:
    """Draw points."""
    found = plotter()
    found.add_points(
        np.load(folder / "points.npy"), color="white", lighting=False, reset_camera=False
    )
    return bool((draw(found).max(axis=2) > 100).sum() > 500)


def rays(folder: Path) -> bool:
    """Cast a ray."""
    _, faces = mesh_of(shapes.UPRIGHT).ray_trace((0, 0, 0), (0, 0, -10))
    return len(faces) > 0


def window(folder: Path) -> bool:
    """Open a window for a moment."""
    import pyvista

    found = pyvista.Plotter(off_screen=False, window_size=list(shapes.SIZE))
    found.add_mesh(mesh_of(shapes.UPRIGHT))
    found.show(interactive_update=True, auto_close=False)
    is_open = found.iren is not None and found.iren.initialized
    found.close()
    return bool(is_open)
