"""Decide which camera a frame is seen with, what it needs, and what it is compared with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from rasterjit.io.meshes import as_scene
from rasterjit.outputs import motion, table
from rasterjit.rendering.plan import Known, plan_frame
from rasterjit.scene.camera import Camera, check_camera
from rasterjit.scene.framing import fit_camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import in_short
from rasterjit.scene.view import View
from rasterjit.survey import contents
from rasterjit.survey import placement as placing
from rasterjit.survey.cache import SceneCache, prepare
from rasterjit.survey.placement import Views
from rasterjit.survey.plan import RenderPlan


class PlannedFrame(NamedTuple):
    """A frame that is decided on."""

    plan: RenderPlan
    cache: SceneCache
    views: Views
    earlier: PlannedFrame | None = None
    """What it is compared with; ``None`` -> nothing."""


def plan_views(
    size: tuple[int, int],
    quality: Quality,
    scene: Scene,
    camera: Camera | None,
    outputs: Sequence[str],
    background: Any,
    cull: str,
    diagnose: bool,
    previous: View | None,
    known: SceneCache | None = None,
) -> PlannedFrame:
    """
    Check the arguments of a frame, and decide what it needs, with all that it is drawn from.

    Parameters
    ----------
    size, quality, scene, camera, outputs, background, cull, diagnose, previous
        As `rasterjit.render` takes them.
    known : SceneCache, optional
        What an earlier frame of the scene was drawn from; what has not changed is taken from there.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    camera = choose_camera(scene, camera, size)
    cache = prepare(scene.nodes, known, quality, scene.environment is not None)
    views = placing.view_places(cache.places, camera, size)
    plan = plan_frame(
        scene, camera, size, quality, outputs, background, cull, diagnose, cache.inventory, views
    )
    earlier = find_earlier(previous, plan, scene)
    if earlier is None:
        return PlannedFrame(plan, cache, views)
    old = prepare(earlier[0].nodes, cache, quality, earlier[0].environment is not None)
    old_views = placing.view_places(old.places, earlier[1], size)
    old_plan = plan_earlier(plan, *earlier, old.inventory, old_views)
    before = PlannedFrame(old_plan, old, old_views)
    return PlannedFrame(plan.with_(previous=old_plan), cache, views, before)


def choose_camera(scene: Scene, camera: Camera | None, size: tuple[int, int]) -> Camera:
    """Return the camera given, else the scene's own, else one that fits the scene."""
    contents.check_scene(scene)
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
    if set(table.MOTION_OUTPUTS).isdisjoint(plan.outputs):
        return None
    if previous is None:
        wanted = next(name for name in plan.outputs if name in table.MOTION_OUTPUTS)
        raise ValueError(
            f"previous must be a View where outputs has {wanted!r}, which tells what has changed "
            "since; got None"
        )
    earlier, camera = scene, plan.camera
    if previous.scene is not None:
        with naming("previous.scene"):
            earlier = as_scene(previous.scene)
            contents.check_scene(earlier)
        motion.check_same_objects(scene.nodes, earlier.nodes)
    if previous.camera is not None:
        with naming("previous.camera"):
            camera = choose_camera(earlier, previous.camera, plan.size)
            camera.projection_matrix(plan.size)
    return earlier, camera


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Let an error about an argument begin with the name that the caller knows it by."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def plan_earlier(
    plan: RenderPlan, scene: Scene, camera: Camera, *known: Known | Views
) -> RenderPlan:
    """Return the plan of an earlier view: which faces were seen, as now they are."""
    return plan_frame(
        scene, camera, plan.size, plan.quality, ("face_id",), None, plan.cull, False, *known
    )
