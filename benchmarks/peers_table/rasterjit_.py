"""RasterJIT itself."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import shapes

import rasterjit as rj

DISTRIBUTIONS = ("rasterjit",)


def camera(eye: Any = (0, 0, 0), target: Any = (0, 0, -1)) -> rj.PerspectiveCamera:
    """Return the camera."""
    return rj.PerspectiveCamera(eye, target, fov_y=shapes.FOV_Y, near=shapes.NEAR, far=shapes.FAR)


def scene_of(*parts: Any, **material: Any) -> rj.Scene:
    """Return a scene of rectangles."""
    scene = rj.Scene()
    for vertices in parts:
        scene.add(rj.Mesh(vertices, shapes.QUAD, material=rj.Material(**material)))
    return scene


def draw(scene: rj.Scene, **options: Any) -> rj.Frame:
    """Return a frame."""
    return rj.render(scene, camera(), size=shapes.SIZE, **{"background": "black", **options})


def megabytes(measure: Any) -> dict[str, Any]:
    """Return the size of what is installed, or of the sources where it is not copied."""
    found = dict(measure(DISTRIBUTIONS))
    if found["of"]["rasterjit"] < 100_000:
        own = [each for each in Path(rj.__file__).parent.rglob("*") if each.suffix != ".pyc"]
        found["bytes"] += sum(each.stat().st_size for each in own if each.is_file())
    return found


def picture(folder: Path) -> Any:
    """Draw the teapot."""
    scene = rj.load(folder / "teapot.obj")
    view = camera(shapes.EYE, shapes.TARGET)
    threads = int(os.environ.get("PEER_THREADS", "0")) or None
    return rj.render(scene, view, size=shapes.SIZE, threads=threads).color


def depth(folder: Path) -> float:
    """Return the error of depth."""
    return shapes.depth_error(draw(scene_of(shapes.WALL), outputs=("depth",)).depth)


def two() -> rj.Scene:
    """Return two rectangles."""
    return scene_of(shapes.UPRIGHT, shapes.UPRIGHT * (1, 1, 2) + (0, 1, 0))


def face_id(folder: Path) -> bool:
    """Find face numbers."""
    frame = draw(scene_of(shapes.UPRIGHT), outputs=("face_id",))
    return set(np.unique(frame.face_id)) == {-1, 0, 1}


def masks(folder: Path) -> bool:
    """Find objects."""
    frame = draw(two(), outputs=("object_id",))
    return len(frame.masks()) == 2


def normals(folder: Path) -> bool:
    """Find normals."""
    frame = draw(scene_of(shapes.UPRIGHT), outputs=("normal", "face_id"))
    return bool(np.allclose(frame.normal[frame.face_id >= 0], (0, 0, 1), atol=1e-6))


def motion(folder: Path) -> bool:
    """Find motion."""
    before = rj.PreviousView(camera=camera((0.1, 0, 0), (0.1, 0, -1)))
    frame = draw(scene_of(shapes.UPRIGHT), outputs=("motion",), previous=before)
    expected = 0.1 / 4.0 * shapes.focal()
    return bool(np.isclose(np.nanmedian(frame.motion[..., 0]), expected, atol=0.01))


def lens(folder: Path) -> bool:
    """Draw through two lenses."""
    plain, bent, wide = (
        draw(two(), lens=lens).color
        for lens in (None, rj.PinholeDistortion(k1=0.1), rj.FisheyeLens())
    )
    return shapes.differ(plain, bent) and shapes.differ(plain, wide)


def antialiasing(folder: Path) -> bool:
    """Draw a rectangle."""
    scene = scene_of(shapes.UPRIGHT, shading="unlit")
    return shapes.is_smooth(draw(scene, quality=rj.Quality(samples=4)).color)


def shadows(folder: Path) -> bool:
    """Draw a plate above a floor, with shadows and without."""
    pictures = []
    for shadow in (None, rj.Shadow(filter="soft", light_size=2.0)):
        scene = scene_of(shapes.FLOOR, shapes.BLOCKER)
        scene.lights.append(rj.DirectionalLight(-shapes.TO_LIGHT, shadow=shadow))
        pictures.append(draw(scene).color)
    return shapes.differ(*pictures)


def transparency(folder: Path) -> bool:
    """Draw crossing panes in both orders."""
    pictures = [draw(rj.load(folder / f"panes_{order}.glb")).color for order in ("ab", "ba")]
    return shapes.crosses(*pictures)


def metallic(folder: Path) -> bool:
    """Draw metal and plastic."""
    pictures = [draw(rj.load(folder / f"{name}.glb")).color for name in ("metal", "plastic")]
    return shapes.differ(*pictures)


def animation(folder: Path) -> bool:
    """Draw a character at two times."""
    scene = rj.load(folder / "figure.glb")
    view = camera((0, 1, 3), (0, 1, 0))
    pictures = [
        rj.render(scene.at(time), view, size=shapes.SIZE, background="black").color
        for time in (0.1, 0.5)
    ]
    return shapes.differ(*pictures)


def points(folder: Path) -> bool:
    """Draw points."""
    scene = rj.Scene()
    scene.add(rj.Points(np.load(folder / "points.npy"), size=3))
    return bool((draw(scene).color[..., :3].max(axis=2) > 60).sum() > 500)


def rays(folder: Path) -> bool:
    """Find none that are cast at a mesh: ``Camera.rays`` are directions."""
    return shapes.absent("rasterjit", "ray_?cast|cast_ray|intersects|ray_?trac")


def window(folder: Path) -> bool:
    """Open a window of a moment; a toolkit is in the extra ``viewer``."""
    from rasterjit.viewer import window_probe

    return bool(window_probe.choose_toolkit())
