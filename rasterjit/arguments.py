"""Decide which camera a frame is seen with, and which earlier view it is compared with."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rasterjit import motion
from rasterjit import plan as planning
from rasterjit.io.meshes import as_scene
from rasterjit.plan import RenderPlan, Stock
from rasterjit.plan_views import Views
from rasterjit.scene.camera import Camera, check_camera, fit_camera
from rasterjit.scene.scene import Scene
from rasterjit.scene.view import View
from rasterjit.validation import in_short


def choose_camera(scene: Scene, camera: Camera | None, size: tuple[int, int]) -> Camera:
    """Return the camera given, else the scene's own, else one that fits the scene."""
    planning.check_scene(scene)
    if camera is None:
        camera = scene.camera
    if camera is None:
        return fit_camera(scene, aspect=size[0] / size[1])
    return check_camera("camera", camera)


def find_earlier(
    previous: View | None, plan: RenderPlan, scene: Scene
) -> tuple[Scene, Camera] | None:
    """
    Return the scene and the camera that a frame is compared with, ``None`` if it is with none.

    Raises
    ------
    ValueError
        Naming what is wrong with ``previous``, or that it is missing.
    """
    if previous is not None and not isinstance(previous, View):
        raise ValueError(f"previous must be a View or None, got {in_short(previous)}")
    if not plan.compares_views:
        return None
    if previous is None:
        wanted = next(name for name in plan.outputs if name in planning.MOTION_OUTPUTS)
        raise ValueError(
            f"previous must be a View where outputs has {wanted!r}, which tells what has changed "
            "since; got None"
        )
    earlier, camera = scene, plan.camera
    if previous.scene is not None:
        with naming("previous.scene"):
            earlier = as_scene(previous.scene)
            planning.check_scene(earlier)
        motion.check_same_objects(scene.nodes, earlier.nodes)
    if previous.camera is not None:
        with naming("previous.camera"):
            camera = choose_camera(earlier, previous.camera, plan.size)
    return earlier, camera


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Let an error about an argument begin with the name that the caller knows it by."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def plan_earlier(
    plan: RenderPlan, scene: Scene, camera: Camera, *known: Stock | Views
) -> RenderPlan:
    """Return the plan of an earlier view: which faces were seen, as now they are."""
    return planning.plan_render(
        scene, camera, plan.size, plan.quality, ("face_id",), None, plan.cull, False, *known
    )
