"""Decide which camera a frame is seen with, what it needs, and what it is compared with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from rasterjit.io.meshes import as_scene
from rasterjit.outputs import motion, table
from rasterjit.rendering.plan import FrameRequest, Known, plan_frame
from rasterjit.scene.camera import Camera, check_camera, planes_of, settled, steps_of
from rasterjit.scene.framing import fit_upright
from rasterjit.scene.node import Node
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import in_short
from rasterjit.scene.view import PreviousView
from rasterjit.survey import contents
from rasterjit.survey import placement as placing
from rasterjit.survey.cache import SceneCache, prepare
from rasterjit.survey.clip_planes import (
    BesidePlanes,
    is_surely_between,
    join,
    look_at_planes,
    spheres_beyond,
)
from rasterjit.survey.depth_format import REVERSED_TYPES
from rasterjit.survey.placement import Boxes, Views
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.posing import posed_scene


class PlannedFrame(NamedTuple):
    """A frame that is decided on."""

    plan: RenderPlan
    cache: SceneCache
    views: Views
    earlier: PlannedFrame | None = None
    """What it is compared with; ``None`` -> nothing."""
    scene: Scene | None = None
    """What is drawn; of an earlier frame ``None``."""


def plan_views(
    request: FrameRequest,
    scene: Scene,
    camera: Camera | None,
    known: SceneCache | None = None,
    last: RenderPlan | None = None,
) -> PlannedFrame:
    """
    Check the arguments of a frame, and decide what it needs, with all that it is drawn from.

    Parameters
    ----------
    request : FrameRequest
    scene, camera
        As `rasterjit.render` takes them.
    known : SceneCache, optional
        What an earlier frame of the scene was drawn from; what has not changed is taken from there.
    last : RenderPlan, optional
        Of an earlier frame, which may have been another one altogether: what was decided by facts
        that still hold is taken from there.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    size, quality = request.size, request.quality
    camera, scene = choose_camera(scene, camera, size), cut_open(scene)
    cache = prepare(scene.nodes, known, quality, scene.environment is not None)
    views = placing.view_places(cache.places, camera, size)
    plan = plan_frame(request, scene, camera, cache.inventory, views, last)
    if any(plan.look.steps) and _are_moved(camera, plan.camera):
        views = placing.view_again(views, plan.camera, size)
    earlier = find_earlier(request.previous, plan, scene, camera)
    if earlier is None:
        return PlannedFrame(plan, cache, views, None, scene)
    earlier = cut_alike(earlier[0], scene), earlier[1]
    old = prepare(earlier[0].nodes, cache, quality, earlier[0].environment is not None)
    old_views = placing.view_places(old.places, earlier[1], size)
    old_plan = plan_earlier(plan, *earlier, old.inventory, old_views)
    if earlier[1] is camera:
        # One camera has its planes in one place.
        if _are_moved(plan.camera, old_plan.camera):
            both = settled(camera, *map(max, steps_of(plan.camera), steps_of(old_plan.camera)))
            return plan_views(request, scene, both, cache, last)
        old_plan = old_plan.with_(camera=plan.camera)
    if _are_moved(earlier[1], old_plan.camera):
        old_views = placing.view_again(old_views, old_plan.camera, size)
    before = PlannedFrame(old_plan, old, old_views)
    return PlannedFrame(plan.with_(previous=old_plan), cache, views, before, scene)


def settle_together(
    scene: Scene,
    cameras: Sequence[Camera],
    size: tuple[int, int],
    quality: Quality,
    known: SceneCache | None = None,
) -> list[Camera]:
    """
    Return cameras of one scene, those planes that they leave open all in one place.

    Parameters
    ----------
    scene : Scene
    cameras : sequence of Camera
    size, quality
        As `rasterjit.render` takes them.
    known : SceneCache, optional
        What is known of the scene.
    """
    if not any(map(needs_settling, cameras)):
        return list(cameras)
    cache = prepare(scene.nodes, known, quality, scene.environment is not None)
    # Most batches look from outside of all that is there.
    low, high = placing.box_around(cache.shapes.boxes, cache.places.world_from_model)
    beyond = spheres_beyond(scene.nodes, cache.places.world_from_model)
    near_by = [
        camera
        for camera in cameras
        if (beyond and needs_settling(camera)) or not is_surely_between(low, high, camera)
    ]
    if near_by and quality.depth_format not in REVERSED_TYPES:
        # How near a plane may come is for all to say.
        near_by = [camera for camera in cameras if needs_settling(camera)]
    looks = [look_from(scene, camera, size, quality, cache) for camera in near_by]
    steps = join(looks).steps
    return [settled(camera, *steps) for camera in cameras]


def cut_open(scene: Scene) -> Scene:
    """Return what a scene's section has left of it, the scene itself without one."""
    if scene.section is None:
        return scene
    from rasterjit.survey.sections import cut

    return cut(scene)


def cut_alike(earlier: Scene, scene: Scene) -> Scene:
    """Return an earlier scene, cut where a scene that `cut_open` returned is."""
    if scene.section is None:
        return earlier
    from rasterjit.survey import sections

    return sections.cut_alike(earlier, scene)


def needs_settling(camera: Camera | None) -> bool:
    """Tell whether a camera leaves a plane open."""
    planes = planes_of(camera)
    return planes is not None and (planes.is_near_open or planes.is_far_open)


def look_from(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    quality: Quality,
    cache: SceneCache | None = None,
    picture: Camera | None = None,
) -> BesidePlanes:
    """
    Return what a camera sees beside its planes, given what is known of the scene.

    ``picture`` has another part of its view, with the same planes.
    """
    shown = camera if picture is None else picture
    if cache is None:
        cache = prepare(scene.nodes, None, quality, scene.environment is not None)
    views = placing.view_places(cache.places, shown, size)
    boxes = Boxes(
        cache.extents, shown.eye_position(), views.relative_from_model,
        views.clip_from_relative, beyond=cache.tables.inventory.beyond(size),
    )  # fmt: skip
    return look_at_planes(camera, boxes, scene.nodes, views.clip_from_relative, quality)


def _are_moved(before: Camera, after: Camera) -> bool:
    """Tell whether the planes of a camera are elsewhere than they were."""
    return before is not after and planes_of(before)[:2] != planes_of(after)[:2]


def choose_camera(scene: Scene, camera: Camera | None, size: tuple[int, int]) -> Camera:
    """Return the camera given, else the scene's own, else one that fits the scene."""
    contents.check_scene(scene)
    if camera is None:
        camera = scene.camera
    if camera is None:
        return fit_upright(scene, size)
    return check_camera("camera", camera)


def find_earlier(
    previous: PreviousView | None, plan: RenderPlan, scene: Scene, camera: Camera
) -> tuple[Scene, Camera] | None:
    """
    Return the scene and the camera that a frame is compared with, ``None`` if it is with none.

    ``camera`` is the one that was asked for.

    Raises
    ------
    ValueError
        Naming what is wrong with ``previous``, or that it is missing.
    """
    if previous is not None and not isinstance(previous, PreviousView):
        raise ValueError(f"previous must be a PreviousView or None, got {in_short(previous)}")
    if set(table.MOTION_OUTPUTS).isdisjoint(plan.outputs):
        return None
    if previous is None:
        wanted = next(name for name in plan.outputs if name in table.MOTION_OUTPUTS)
        raise ValueError(
            f"previous must be a PreviousView where outputs has {wanted!r}, which tells what has "
            "changed since; got None"
        )
    earlier = scene
    if previous.scene is not None:
        with naming("previous.scene"):
            earlier = posed_scene(as_scene(previous.scene))
            contents.check_scene(earlier)
        motion.check_same_objects(_whole(scene), earlier.nodes)
    if previous.camera is not None:
        with naming("previous.camera"):
            camera = choose_camera(earlier, previous.camera, plan.size)
            camera.projection_matrix(plan.size)
    return earlier, camera


def _whole(scene: Scene) -> Sequence[Node]:
    """Return the objects of a scene as they were before a section cut them."""
    cut = getattr(scene.nodes, "cut", None)
    return scene.nodes if cut is None else cut.nodes


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
    request = FrameRequest(plan.size, plan.quality, ("face_id",), None, plan.cull)
    return plan_frame(request, scene, camera, *known)
