"""
Plan a frame: check its arguments, choose the camera, and decide which effects and passes it needs.

The scene is analysed once (`collect_facts`), and every effect decides once; a plan prints as a
table, with the kernels and buffers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs import diagnostics, ground_truth, motion, output_table
from rasterjit.outputs.output_table import (
    MIXED_OUTPUTS,
    AnyOutput,
    Outputs,
    check_outputs,
    find_row,
)
from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.fragments.fragment_bands import list_peeling_kernels
from rasterjit.pipeline.passes import KernelRow, Pass, Rows
from rasterjit.pipeline.records import Lighting
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.rendering import frame_shading, shading_passes, supersample
from rasterjit.rendering.effect_registry import decide_effects
from rasterjit.runtime import background_compile
from rasterjit.runtime.background_compile import Task
from rasterjit.scene.background import Backdrop, BackgroundImage, read_background
from rasterjit.scene.camera import Camera, check_camera, count_plane_steps, move_planes, near_far
from rasterjit.scene.camera_fitting import default_camera
from rasterjit.scene.node import Node
from rasterjit.scene.previous_view import PreviousView
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.reference_shader import ReferenceShading
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.scene.validation import boolean, brief, one_of
from rasterjit.survey import clip_planes, deformation, object_transforms
from rasterjit.survey.cache import SceneCache, update_cache
from rasterjit.survey.clip_planes import (
    PlaneNeeds,
    find_plane_needs,
    find_uneven_spheres,
    is_box_between,
    merge_needs,
)
from rasterjit.survey.deformation import pose_input
from rasterjit.survey.depth_format import REVERSED_TYPES, check_near_plane, make_depth_format
from rasterjit.survey.effect import ActiveEffect, Planning, UnusedEffect, UsedEffect
from rasterjit.survey.facts import Facts, collect_facts
from rasterjit.survey.light_culling import apply_reference_shading, pack_headlight, pack_lights
from rasterjit.survey.object_counts import (
    Inventory,
    check_masked_fields,
    check_textures,
    may_have_holes,
    take_inventory,
)
from rasterjit.survey.object_transforms import (
    Boxes,
    Extents,
    ViewTransforms,
    reproject_views,
    transform_nodes_to_view,
)
from rasterjit.survey.plan import Cull, RenderPlan
from rasterjit.survey.transparency import choose_pixel_layers

CULL_MODES: tuple[Cull, ...] = get_args(Cull)
"""Which faces are dropped: none; those that show their back; their front."""

BYTES = {"bool": 1, "uint8": 1, "int32": 4, "float32": 4, "float64": 8}

Known = tuple[Inventory, Extents]
"""Inventory of a scene's objects, and how far they reach."""


class FrameRequest(NamedTuple):
    """The arguments of a frame beside its scene and camera; see `check_request`."""

    size: tuple[int, int]
    quality: Quality
    outputs: tuple[AnyOutput, ...] = ("color",)
    background: Any = None
    cull: Cull = "none"
    diagnose: bool = False
    previous: PreviousView | None = None


def check_request(
    size: tuple[int, int],
    quality: Quality | None,
    outputs: Outputs,
    background: Any,
    cull: Cull,
    diagnose: bool = False,
    previous: PreviousView | None = None,
) -> FrameRequest:
    """
    Return the arguments of a frame, or raise ``ValueError``: a look at the scene may run kernels.

    The size is checked already; background and previous are checked when the frame is planned.
    """
    one_of("cull", cull, CULL_MODES)
    is_diagnosed, names = boolean("diagnose", diagnose), check_outputs(outputs)
    return FrameRequest(
        size, check_quality(quality), names, background, cull, is_diagnosed, previous
    )


def plan_frame(
    request: FrameRequest,
    scene: Scene,
    camera: Camera,
    known: Known | None = None,
    views: ViewTransforms | None = None,
    last: RenderPlan | None = None,
) -> RenderPlan:
    """
    Decide what a frame needs.

    ``known`` and ``views`` are those of the scene's nodes, where they are known already. ``last``
    is the plan of an earlier frame: what was decided by facts that still hold is taken from it.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    size, quality, outputs, background, cull, diagnose, _ = request
    # Analyse the scene.
    if known is None:
        known = take_inventory(scene.nodes, quality, scene.environment is not None)
    if views is None:
        views = transform_nodes_to_view(scene.nodes, camera, size)
    inventory, extents = known
    eye, relative_from_model = np.asarray(camera.eye_position()), views.relative_from_model
    boxes = Boxes(
        extents,
        eye,
        relative_from_model,
        views.clip_from_relative,
        overhang=inventory.pixel_overhang(size),
    )
    # Place open near and far planes where they clip nothing in view.
    beside = clip_planes.find_plane_needs(
        camera, boxes, scene.nodes, views.clip_from_relative, quality
    )
    camera = move_planes(camera, *beside.steps)
    if any(beside.steps):
        views = reproject_views(views, camera, size)
        boxes = Boxes(
            extents, eye, relative_from_model, views.clip_from_relative,
            overhang=inventory.pixel_overhang(size),
        )  # fmt: skip
    behind = read_background(background)
    seen_behind = None if background is None else behind
    known_facts = None if last is None else last.facts
    facts = collect_facts(
        scene, boxes, views, inventory, quality, outputs, seen_behind, diagnose, cull, known_facts
    )
    _refuse(scene, facts)
    if facts.finds_faces:
        check_near_plane(quality, camera, boxes, scene.nodes, views.clip_from_relative)
    # Decide on each effect.
    answers = last.effects if last is not None and facts is last.facts else None
    effects = decide_effects(facts, Planning(scene, camera, boxes), answers)
    layers = choose_pixel_layers(
        facts.transparency,
        facts.mixes_samples,
        facts.supersamples or quality.samples,
        scene.nodes,
        quality,
    )
    if layers is not None and facts.reference is not None:
        # Far beside a face that is seen from its edge there may be no place to look things up.
        casts_shadows = facts.casts_shadows or bool(facts.reference.maps)
        at_centers = not (facts.needs_textures or casts_shadows)
        layers = layers._replace(in_order=True, at_centers=at_centers)
    plan = RenderPlan(
        size=size,
        camera=camera,
        background=_color_behind(behind, size),
        cull=cull,
        facts=facts,
        effects=effects,
        lighting=_lighting(camera, facts, effects),
        layers=layers,
        depth_format=make_depth_format(quality.depth_format, camera, size),
        pictures=facts.pictures,
        plane_needs=beside,
    )
    if last is not None and answers is not None and effects is answers:
        plan.copy_derived(last)
    return plan


def _color_behind(behind: Backdrop, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return what lies behind all faces, (4,) linear; of a picture, whether it is opaque."""
    if not isinstance(behind, BackgroundImage):
        return behind
    behind.check_size(size)
    return np.array([0.0, 0.0, 0.0, float(behind.is_opaque)], np.float32)


def _refuse(scene: Scene, facts: Facts) -> None:
    """Raise ``ValueError`` if texture coordinates are missing, or alphas cannot be told."""
    contents, quality = facts.counts, facts.quality
    if facts.reference is not None:
        _refuse_imitating(scene, facts.reference)
    if "uv" in facts.outputs and contents.with_uv == 0:
        raise ValueError("outputs has 'uv', but no mesh of the scene has texture coordinates")
    if "scalar" in facts.outputs and not any(node.mesh.field for node in scene.nodes):
        raise ValueError("outputs has 'scalar', but no mesh of the scene has scalars")
    if contents.points:
        _refuse_points(scene, facts)
    if contents.masked_fields:
        check_masked_fields(scene.nodes)
    if facts.colors_faces and contents.without_uv:
        check_textures(scene.nodes, quality)
    if contents.cutouts_without_uv and facts.finds_faces:
        check_textures([node for node in scene.nodes if may_have_holes(node.mesh)], quality)
    if facts.discards_faint and contents.without_uv:
        clear = np.flatnonzero(facts.inventory.is_see_through).tolist()
        check_textures([scene.nodes[number] for number in clear], quality)


def _refuse_imitating(scene: Scene, imitation: ReferenceShading) -> None:
    """Raise ``ValueError`` naming what a scene that is lit as pyrender's cannot have."""
    imitation.check_counts(len(scene.nodes), len(scene.lights))
    for name in EFFECT_FIELDS:
        if getattr(scene, name) is not None:
            raise ValueError(f"{name} must be None where a scene is lit as in pyrender")


def _refuse_points(scene: Scene, facts: Facts) -> None:
    """Raise ``ValueError`` naming the points that are asked for what none have."""
    if facts.diagnose and facts.has_round_points:
        raise ValueError("diagnose must be False where points are discs or spheres, got True")
    for node, is_see_through in zip(scene.nodes, facts.inventory.is_see_through, strict=True):
        shape, material = getattr(node.mesh, "shape", None), node.mesh.material
        if shape is not None and material.alpha_mode == "mask":
            raise ValueError(
                f"the material of {node.name!r} must have another alpha_mode than 'mask', for "
                "points have no holes"
            )
        if shape in ("disc", "sphere") and is_see_through and facts.colors_faces:
            raise ValueError(
                f"the material of {node.name!r} must be opaque, for its points are {shape}s, of "
                "which several in a pixel are not found; got alpha_mode 'blend' and an alpha "
                "below 1. Squares may be blended"
            )


def _lighting(
    camera: Camera, facts: Facts, effects: Sequence[UsedEffect | UnusedEffect]
) -> Lighting | None:
    """
    Return the lights as rows, relative to the eye; ``None`` if nothing depends on where it is.

    No lights in the scene, and no environment, mean a headlight.
    """
    if not facts.is_lit:
        on_samples = any(one.used and "sample" in one.effect.places for one in effects)
        return pack_lights([], camera, 0) if on_samples else None
    own = facts.visible.highlights, int(facts.renormalizes)
    if facts.has_headlight:
        lighting = pack_headlight(camera, *own)
    else:
        lighting = pack_lights(facts.lights.lights, camera, *own)
    if facts.reference is not None:
        return apply_reference_shading(lighting, facts.reference, facts.lights, camera)
    return lighting


class Buffer(NamedTuple):
    """One array of the size of the frame, or of a map."""

    name: str
    channels: int
    kind: str
    """Its dtype."""
    size: tuple[int, int]
    """Width and height, pixels."""

    @property
    def bytes(self) -> int:
        """How much memory it takes."""
        return self.size[0] * self.size[1] * self.channels * BYTES[self.kind]


def list_kernels(plan: RenderPlan) -> tuple[KernelRow, ...]:
    """Return the kernels that a frame calls, in order."""
    geometry = _finding_kernels(plan)
    known = {row[:2] for row in geometry}
    rows = [
        *(deformation.list_skinning_kernels() if plan.facts.counts.skinned else []),
        *clip_planes.kernels_of(plan.camera),
        *geometry,
        *ground_truth.list_depth_kernels(plan),
        *(row for row in plan.kernels_at("prepare") if row[:2] not in known),
        *frame_shading.kernels_of(plan),
        *plan.kernels_at("background"),
        *supersample.kernels_of(plan),
        *plan.kernels_at("overlay"),
        *ground_truth.kernels_of(plan),
    ]
    rows += [row for row in supersample.covering_kernels(plan) if row not in rows]
    if plan.facts.diagnose:
        rows += diagnostics.kernels_of(plan.depth_format.kind)
    if plan.lens:
        rows += lens_kernels(plan.outputs)
    if plan.surfaces is not None:
        rows += list_peeling_kernels(plan.depth_format.kind, plan.facts.tests_alpha)
    if "motion_visible" in plan.outputs and plan.previous is not None:
        rows += _finding_kernels(plan.previous)
    return tuple(dict.fromkeys(rows))


def lens_kernels(outputs: Sequence[str]) -> Rows:
    """Return the kernels that filter pinhole pictures where there is a lens."""
    from rasterjit.pipeline.resampling import filter_rows

    rows = []
    if not set(MIXED_OUTPUTS).isdisjoint(outputs):
        rows.append(KernelRow(filter_rows))
    if "color" in outputs:
        rows.append(KernelRow(srgb_encoding.encode_rows))
    return rows


def list_passes(plan: RenderPlan) -> list[Pass]:
    """
    Return the passes that shade the samples of a frame, in order.

    Those of vertices come first; those that shadows call for run if a map is drawn.
    """
    if not plan.facts.is_colored or plan.mixes_plain_codes:
        return []
    if plan.pictures > 1:
        plan = supersample.plan_picture(plan, {})
    if plan.layers is None and not plan.facts.draws_faces and not plan.effects_at("background"):
        # All pixels are alike.
        return []
    effects = tuple(ActiveEffect(one.effect, one.data) for one in plan.planned if one.effect.places)
    return shading_passes.list_passes(plan.shading, effects, plan.layers, plan.outputs)


def list_tasks(plan: RenderPlan) -> list[Task]:
    """Return tasks that compile what a frame surely calls, the last first."""
    always = [row.kernel for row in list_kernels(plan) if not (row.variant or row.condition)]
    always += [one.stage for one in list_passes(plan)]
    return background_compile.compiling([*dict.fromkeys(always)][::-1], usual=True)


def _finding_kernels(plan: RenderPlan) -> Rows:
    """Return the kernels that find the face at every pixel."""
    wanted = plan.visibility._replace(draws=plan.needs_centers)
    return visibility_pass.list_kernels(
        wanted, plan.facts.tests_alpha, plan.facts.counts.primitives
    )


def list_buffers(plan: RenderPlan) -> tuple[Buffer, ...]:
    """Return the large arrays of a frame, its outputs included."""
    rows = [("faces seen", 1, "int32")]
    if plan.needs_depth:
        rows.append(("stored depth", 1, np.dtype(plan.depth_format.kind).name))
    if plan.reads_depth and not plan.depth_format.is_standard:
        rows.append(("reversed depth", 1, "float32"))
    if plan.pictures > 1:
        rows += [("sums of all pictures", 4, "float64"), ("one of the pictures", 4, "float32")]
    own = [row for planned in plan.planned for row in planned.effect.buffers(plan)]
    rows += [row[:3] for row in own if row[3] == plan.size]
    for name in plan.outputs:
        if name in plan.facts.attributes:
            rows.append((f"output {name}", plan.facts.attributes[name].columns, "float32"))
        elif name != "face_id":
            rows.append((f"output {name}", find_row(name).channels, find_row(name).dtype))
    maps = [Buffer(*row) for row in own if row[3] != plan.size]
    return (*(Buffer(*row, plan.size) for row in rows), *maps)


def describe(plan: RenderPlan) -> str:
    """Return a plan as a table: what is in and out, kernels, stages of shading, and buffers."""
    kernels = [
        (kernel.name, "; ".join(filter(None, (kernel.variant, _where(kernel.condition)))))
        for kernel in list_kernels(plan)
    ]
    buffers = [
        (
            f"{buffer.name}",
            f"{buffer.channels} x {buffer.kind}, {buffer.bytes / 1e6:.1f} MB",
        )
        for buffer in list_buffers(plan)
    ]
    parts = [str(plan)]
    stages = [(one.name, ", ".join(one.stage.names)) for one in list_passes(plan)]
    for title, rows in (("kernels", kernels), ("stages", stages), ("buffers", buffers)):
        if not rows:
            continue
        widest = max(len(name) for name, _ in rows)
        lines = [f"  {name:<{widest}}  {text}".rstrip() for name, text in rows]
        parts.append("\n".join([title, *lines]))
    return "\n\n".join(parts)


def _where(condition: str) -> str:
    return f"where {condition}" if condition else ""


class PlannedFrame(NamedTuple):
    """A planned frame."""

    plan: RenderPlan
    cache: SceneCache
    views: ViewTransforms
    scene: Scene
    """What is drawn."""
    earlier: PlannedFrame | None = None
    """The earlier frame that motion is found against; ``None`` -> none."""


def plan_views(
    request: FrameRequest,
    scene: Scene,
    camera: Camera | None,
    known: SceneCache | None = None,
    last: RenderPlan | None = None,
) -> PlannedFrame:
    """
    Decide what a frame needs, with all that it is drawn from.

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
    cache = update_cache(scene.nodes, known, quality, scene.environment is not None)
    views = object_transforms.transform_to_view(cache.transforms, camera, size)
    plan = plan_frame(request, scene, camera, cache.inventory_and_extents, views, last)
    if any(plan.plane_needs.steps) and _are_moved(camera, plan.camera):
        views = object_transforms.reproject_views(views, plan.camera, size)
    earlier = find_earlier(request.previous, plan, scene, camera)
    if earlier is None:
        return PlannedFrame(plan, cache, views, scene)
    earlier = cut_alike(earlier[0], scene), earlier[1]
    old = update_cache(earlier[0].nodes, cache, quality, earlier[0].environment is not None)
    old_views = object_transforms.transform_to_view(old.transforms, earlier[1], size)
    old_plan = plan_earlier(plan, *earlier, old.inventory_and_extents, old_views)
    if earlier[1] is camera:
        # One camera has its planes in one place.
        if _are_moved(plan.camera, old_plan.camera):
            steps = map(max, count_plane_steps(plan.camera), count_plane_steps(old_plan.camera))
            return plan_views(request, scene, move_planes(camera, *steps), cache, last)
        old_plan = old_plan.for_picture(camera=plan.camera)
    if _are_moved(earlier[1], old_plan.camera):
        old_views = object_transforms.reproject_views(old_views, old_plan.camera, size)
    before = PlannedFrame(old_plan, old, old_views, earlier[0])
    return PlannedFrame(plan.for_picture(previous=old_plan), cache, views, scene, before)


def settle_cameras(
    scene: Scene,
    cameras: Sequence[Camera],
    size: tuple[int, int],
    quality: Quality,
    known: SceneCache | None = None,
) -> list[Camera]:
    """
    Return cameras of one scene, with common near and far planes where they leave them open.

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
    cache = update_cache(scene.nodes, known, quality, scene.environment is not None)
    # Most batches look from outside of all that is there.
    low, high = object_transforms.bound_boxes(cache.shapes.boxes, cache.transforms.world_from_model)
    beyond = find_uneven_spheres(scene.nodes, cache.transforms.world_from_model)
    near_by = [
        camera
        for camera in cameras
        if (beyond and needs_settling(camera)) or not is_box_between(low, high, camera)
    ]
    if near_by and quality.depth_format not in REVERSED_TYPES:
        # How near a plane may come is for all to say.
        near_by = [camera for camera in cameras if needs_settling(camera)]
    looks = [look_from(scene, camera, size, quality, cache) for camera in near_by]
    steps = merge_needs(looks).steps
    return [move_planes(camera, *steps) for camera in cameras]


def cut_open(scene: Scene) -> Scene:
    """Return a scene cut by its section; the scene itself without one."""
    if scene.section is None:
        return scene
    from rasterjit.survey.cross_sections import cut_scene

    return cut_scene(scene)


def cut_alike(earlier: Scene, scene: Scene) -> Scene:
    """Return an earlier scene, cut where a scene that `cut_open` returned is."""
    if scene.section is None:
        return earlier
    from rasterjit.survey import cross_sections

    return cross_sections.cut_earlier(earlier, scene)


def needs_settling(camera: Camera | None) -> bool:
    """Tell whether a camera leaves a plane open."""
    planes = near_far(camera)
    return planes is not None and (planes.is_near_open or planes.is_far_open)


def look_from(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    quality: Quality,
    cache: SceneCache | None = None,
    picture: Camera | None = None,
) -> PlaneNeeds:
    """
    Find the depths in view outside a camera's planes, given the scene's cache.

    ``picture`` has another part of its view, with the same planes.
    """
    shown = camera if picture is None else picture
    if cache is None:
        cache = update_cache(scene.nodes, None, quality, scene.environment is not None)
    views = object_transforms.transform_to_view(cache.transforms, shown, size)
    boxes = Boxes(
        cache.extents, shown.eye_position(), views.relative_from_model,
        views.clip_from_relative, overhang=cache.tables.inventory.pixel_overhang(size),
    )  # fmt: skip
    return find_plane_needs(camera, boxes, scene.nodes, views.clip_from_relative, quality)


def _are_moved(before: Camera, after: Camera) -> bool:
    """Tell whether the planes of a camera are elsewhere than they were."""
    if before is after:
        return False
    one, other = near_far(before), near_far(after)
    return (one and one[:2]) != (other and other[:2])


def choose_camera(scene: Scene, camera: Camera | None, size: tuple[int, int]) -> Camera:
    """Return the camera given, else the scene's own, else one that fits the scene."""
    if camera is None:
        camera = scene.camera
    if camera is None:
        return default_camera(scene, size)
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
        raise ValueError(f"previous must be a PreviousView or None, got {brief(previous)}")
    if set(output_table.MOTION_OUTPUTS).isdisjoint(plan.outputs):
        return None
    if previous is None:
        wanted = next(name for name in plan.outputs if name in output_table.MOTION_OUTPUTS)
        raise ValueError(
            f"previous must be a PreviousView where outputs has {wanted!r}, which tells what has "
            "changed since; got None"
        )
    earlier = scene
    if previous.scene is not None:
        with naming("previous.scene"):
            earlier = pose_input(previous.scene)
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
    plan: RenderPlan, scene: Scene, camera: Camera, known: Known | None = None,
    views: ViewTransforms | None = None,
) -> RenderPlan:  # fmt: skip
    """Return the plan of an earlier view."""
    request = FrameRequest(plan.size, plan.quality, ("face_id",), None, plan.cull)
    return plan_frame(request, scene, camera, known, views)
