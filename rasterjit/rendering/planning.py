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
from rasterjit.pipeline.geometry import scene_placement
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
from rasterjit.survey import clip_planes, deformation, object_counts, object_transforms
from rasterjit.survey.cache import SceneCache, update_cache
from rasterjit.survey.clip_planes import PlaneNeeds
from rasterjit.survey.deformation import pose_input
from rasterjit.survey.depth_format import REVERSED_TYPES, check_near_plane, make_depth_format
from rasterjit.survey.effect import ActiveEffect, Planning, UnusedEffect, UsedEffect
from rasterjit.survey.facts import Facts, collect_facts
from rasterjit.survey.light_culling import apply_reference_shading, pack_headlight, pack_lights
from rasterjit.survey.object_counts import Inventory
from rasterjit.survey.object_transforms import (
    Boxes,
    ViewTransforms,
    reproject_views,
    transform_nodes_to_view,
)
from rasterjit.survey.plan import Cull, RenderPlan
from rasterjit.survey.transparency import choose_pixel_layers

CULL_MODES: tuple[Cull, ...] = get_args(Cull)
"""Which faces are dropped: none; those that show their back; their front."""

BYTES_PER_ELEMENT = {"bool": 1, "uint8": 1, "int32": 4, "float32": 4, "float64": 8}

SceneSummary = tuple[Inventory, NDArray[np.float64]]
"""Properties of a scene's objects, and their boxes, (O, 2, 3), model space."""


class FrameRequest(NamedTuple):
    """The arguments of a frame besides its scene and camera; see `check_request`."""

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
    Return the arguments of a frame besides scene and camera, or raise ``ValueError``.

    The size is already checked; background and previous are checked when the frame is planned.
    """
    one_of("cull", cull, CULL_MODES)
    is_diagnosed, names = boolean("diagnose", diagnose), check_outputs(outputs)
    return FrameRequest(
        size, check_quality(quality), names, background, cull, is_diagnosed, previous
    )


def make_plan(
    request: FrameRequest,
    scene: Scene,
    camera: Camera,
    summary: SceneSummary | None = None,
    views: ViewTransforms | None = None,
    last_plan: RenderPlan | None = None,
) -> RenderPlan:
    """
    Decide what a frame needs.

    ``summary`` and ``views`` are those of the scene's nodes, if known already. ``last_plan`` is
    that of any frame before: decisions whose facts still hold are reused.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    size, quality, outputs, background, cull, diagnose, _ = request
    # Analyse the scene.
    if summary is None:
        summary = object_counts.take_inventory(scene.nodes, quality, scene.environment is not None)
    if views is None:
        views = transform_nodes_to_view(scene.nodes, camera, size)
    inventory, bounds = summary
    eye, overhang = np.asarray(camera.eye_position()), inventory.pixel_overhang(size)

    def make_boxes(views: ViewTransforms) -> Boxes:
        matrices = views.relative_from_model, views.clip_from_relative
        return Boxes(bounds, eye, *matrices, overhang=overhang)

    boxes = make_boxes(views)
    # Place open near and far planes where they clip nothing in view.
    plane_needs = clip_planes.find_plane_needs(
        camera, boxes, scene.nodes, views.clip_from_relative, quality
    )
    camera = move_planes(camera, *plane_needs.steps)
    if any(plane_needs.steps):
        views = reproject_views(views, camera, size)
        boxes = make_boxes(views)
    backdrop = read_background(background)
    given_backdrop = None if background is None else backdrop
    last_facts = None if last_plan is None else last_plan.facts
    facts = collect_facts(
        scene, boxes, views, inventory, quality, outputs, given_backdrop, diagnose, cull, last_facts
    )
    _check_supported(scene, facts)
    if facts.finds_faces:
        check_near_plane(quality, camera, boxes, scene.nodes, views.clip_from_relative)
    # Decide on each effect.
    last_effects = None if last_plan is None or facts is not last_facts else last_plan.effects
    effects = decide_effects(facts, Planning(scene, camera, boxes), last_effects)
    layers = choose_pixel_layers(
        facts.transparency,
        facts.mixes_samples,
        facts.supersamples or quality.samples,
        scene.nodes,
        quality,
    )
    if layers is not None and facts.reference is not None:
        # Far off a face that is seen edge-on there may be no point to look textures up at.
        casts_shadows = facts.casts_shadows or bool(facts.reference.maps)
        at_centers = not (facts.needs_textures or casts_shadows)
        layers = layers._replace(in_order=True, at_centers=at_centers)
    plan = RenderPlan(
        size=size,
        camera=camera,
        background=_background_color(backdrop, size),
        cull=cull,
        facts=facts,
        effects=effects,
        lighting=_pack_lighting(camera, facts, effects),
        layers=layers,
        depth_format=make_depth_format(quality.depth_format, camera, size),
        pictures=facts.pictures,
        plane_needs=plane_needs,
    )
    if last_plan is not None and effects is last_effects:
        plan.copy_derived(last_plan)
    return plan


def _background_color(backdrop: Backdrop, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return the background colour, (4,) linear; of an image, black with its alpha, 0 or 1."""
    if not isinstance(backdrop, BackgroundImage):
        return backdrop
    backdrop.check_size(size)
    return np.array([0.0, 0.0, 0.0, float(backdrop.is_opaque)], np.float32)


def _check_supported(scene: Scene, facts: Facts) -> None:
    """Raise ``ValueError`` if the scene lacks data that is needed, or mixes what cannot be."""
    contents, quality = facts.counts, facts.quality
    if facts.reference is not None:
        _check_reference_shading(scene, facts.reference)
    if "uv" in facts.outputs and contents.with_uv == 0:
        raise ValueError("outputs has 'uv', but no mesh of the scene has texture coordinates")
    if "scalar" in facts.outputs and not any(node.mesh.field for node in scene.nodes):
        raise ValueError("outputs has 'scalar', but no mesh of the scene has scalars")
    if contents.points:
        _check_points(scene, facts)
    if contents.masked_fields:
        object_counts.check_masked_fields(scene.nodes)
    if facts.colors_faces and contents.without_uv:
        object_counts.check_textures(scene.nodes, quality)
    if contents.cutouts_without_uv and facts.finds_faces:
        object_counts.check_textures(
            [node for node in scene.nodes if object_counts.may_have_holes(node.mesh)], quality
        )
    if facts.discards_faint_fragments and contents.without_uv:
        clear = np.flatnonzero(facts.inventory.is_see_through).tolist()
        object_counts.check_textures([scene.nodes[number] for number in clear], quality)


def _check_reference_shading(scene: Scene, reference: ReferenceShading) -> None:
    """Raise ``ValueError`` naming an effect that pyrender's shading does not have."""
    reference.check_counts(len(scene.nodes), len(scene.lights))
    for name in EFFECT_FIELDS:
        if getattr(scene, name) is not None:
            raise ValueError(f"{name} must be None where a scene is lit as in pyrender")


def _check_points(scene: Scene, facts: Facts) -> None:
    """Raise ``ValueError`` naming points with a material or an output that points cannot have."""
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


def _pack_lighting(
    camera: Camera, facts: Facts, effects: Sequence[UsedEffect | UnusedEffect]
) -> Lighting | None:
    """
    Return the lights as rows, relative to the eye; ``None`` if nothing is lit.

    Without lights and environment a scene has a headlight.
    """
    if not facts.is_lit:
        reads_eye = any(each.used and "sample" in each.effect.places for each in effects)
        return pack_lights([], camera, 0) if reads_eye else None
    options = facts.visible.highlights, int(facts.renormalizes)
    if facts.has_headlight:
        lighting = pack_headlight(camera, *options)
    else:
        lighting = pack_lights(facts.lights.lights, camera, *options)
    if facts.reference is not None:
        return apply_reference_shading(lighting, facts.reference, facts.lights, camera)
    return lighting


class Buffer(NamedTuple):
    """One array of the size of the frame, or of a map."""

    name: str
    channels: int
    dtype: str
    size: tuple[int, int]
    """Width and height, pixels."""

    @property
    def bytes(self) -> int:
        """Memory of the array."""
        return self.size[0] * self.size[1] * self.channels * BYTES_PER_ELEMENT[self.dtype]


def list_kernels(plan: RenderPlan) -> tuple[KernelRow, ...]:
    """Return the kernels that a frame calls, in order."""
    visibility = _list_visibility_kernels(plan)
    listed = {row[:2] for row in visibility}
    rows = [
        *(deformation.list_skinning_kernels() if plan.facts.counts.skinned else []),
        KernelRow(scene_placement.transform_normals, "", "an object was rotated or scaled"),
        KernelRow(scene_placement.place_views),
        KernelRow(scene_placement.measure_boxes),
        *clip_planes.kernels_of(plan.camera),
        *visibility,
        *ground_truth.list_depth_kernels(plan),
        *(row for row in plan.kernels_at("prepare") if row[:2] not in listed),
        *frame_shading.kernels_of(plan),
        *plan.kernels_at("background"),
        *supersample.kernels_of(plan),
        *plan.kernels_at("overlay"),
        *ground_truth.kernels_of(plan),
    ]
    rows += [row for row in supersample.coverage_kernels(plan) if row not in rows]
    if plan.facts.diagnose:
        rows += diagnostics.kernels_of(plan.depth_format.kind)
    if plan.lens:
        rows += list_lens_kernels(plan.outputs)
    if plan.surfaces is not None:
        rows += list_peeling_kernels(plan.depth_format.kind, plan.facts.tests_alpha)
    if "motion_visible" in plan.outputs and plan.previous is not None:
        rows += _list_visibility_kernels(plan.previous)
    return tuple(dict.fromkeys(rows))


def list_lens_kernels(outputs: Sequence[str]) -> Rows:
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

    Passes over vertices come first. Those of shadows run only if a map is drawn.
    """
    if not plan.facts.is_colored or plan.mixes_plain_codes:
        return []
    if plan.pictures > 1:
        plan = supersample.plan_picture(plan, {})
    if plan.layers is None and not plan.facts.draws_faces and not plan.effects_at("background"):
        # All pixels have one colour.
        return []
    effects = tuple(ActiveEffect(one.effect, one.data) for one in plan.planned if one.effect.places)
    return shading_passes.list_passes(plan.shading, effects, plan.layers, plan.outputs)


def list_compile_tasks(plan: RenderPlan) -> list[Task]:
    """Return tasks that compile what a frame surely calls, last stage first."""
    functions = [row.kernel for row in list_kernels(plan) if not (row.variant or row.condition)]
    functions += [shading_pass.stage for shading_pass in list_passes(plan)]
    return background_compile.make_compile_tasks(
        [*dict.fromkeys(functions)][::-1], first_form_only=True
    )


def _list_visibility_kernels(plan: RenderPlan) -> Rows:
    """Return the kernels that find the face at every pixel."""
    options = plan.visibility._replace(draws=plan.needs_centers)
    return visibility_pass.list_kernels(
        options, plan.facts.tests_alpha, plan.facts.counts.primitives
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
    of_effects = [row for planned in plan.planned for row in planned.effect.buffers(plan)]
    rows += [row[:3] for row in of_effects if row[3] == plan.size]
    for name in plan.outputs:
        if name in plan.facts.attributes:
            rows.append((f"output {name}", plan.facts.attributes[name].columns, "float32"))
        elif name != "face_id":
            rows.append((f"output {name}", find_row(name).channels, find_row(name).dtype))
    maps = [Buffer(*row) for row in of_effects if row[3] != plan.size]
    return (*(Buffer(*row, plan.size) for row in rows), *maps)


def describe(plan: RenderPlan) -> str:
    """Return a plan as a table: its decisions, kernels, stages of shading, and buffers."""
    kernels = [
        (
            row.name,
            "; ".join(filter(None, (row.variant, row.condition and f"where {row.condition}"))),
        )
        for row in list_kernels(plan)
    ]
    buffers = [
        (
            buffer.name,
            f"{buffer.channels} x {buffer.dtype}, {buffer.bytes / 1e6:.1f} MB",
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


class PlannedFrame(NamedTuple):
    """A frame's plan, with the data that it is drawn from."""

    plan: RenderPlan
    cache: SceneCache
    views: ViewTransforms
    scene: Scene
    previous: PlannedFrame | None = None
    """The previous view that motion is measured from, if any."""


def plan_frame(
    request: FrameRequest,
    scene: Scene,
    camera: Camera | None,
    last_cache: SceneCache | None = None,
    last_plan: RenderPlan | None = None,
) -> PlannedFrame:
    """
    Decide what a frame needs, and collect the data that it is drawn from.

    Parameters
    ----------
    request : FrameRequest
    scene, camera
        As `rasterjit.render` takes them.
    last_cache : SceneCache, optional
        Of a frame before: data of objects that have not changed is reused.
    last_plan : RenderPlan, optional
        Of a frame before, even of another scene: decisions whose facts still hold are reused.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    size, quality = request.size, request.quality
    camera, scene = choose_camera(scene, camera, size), cut_by_section(scene)
    cache = update_cache(scene.nodes, last_cache, quality, scene.environment is not None)
    views = object_transforms.transform_to_view(cache.transforms, camera, size)
    plan = make_plan(request, scene, camera, cache.inventory_and_boxes, views, last_plan)
    if any(plan.plane_needs.steps) and _have_planes_moved(camera, plan.camera):
        views = object_transforms.reproject_views(views, plan.camera, size)
    previous = resolve_previous_view(request.previous, plan, scene, camera)
    if previous is None:
        return PlannedFrame(plan, cache, views, scene)
    # Plan the previous view, for motion.
    old_scene, old_camera = cut_previous_scene(previous[0], scene), previous[1]
    old_cache = update_cache(old_scene.nodes, cache, quality, old_scene.environment is not None)
    old_views = object_transforms.transform_to_view(old_cache.transforms, old_camera, size)
    old_plan = plan_previous_view(
        plan, old_scene, old_camera, old_cache.inventory_and_boxes, old_views
    )
    if old_camera is camera:
        # One camera has the same planes in both views.
        if _have_planes_moved(plan.camera, old_plan.camera):
            steps = map(max, count_plane_steps(plan.camera), count_plane_steps(old_plan.camera))
            return plan_frame(request, scene, move_planes(camera, *steps), cache, last_plan)
        old_plan = old_plan.for_picture(camera=plan.camera)
    if _have_planes_moved(old_camera, old_plan.camera):
        old_views = object_transforms.reproject_views(old_views, old_plan.camera, size)
    old_frame = PlannedFrame(old_plan, old_cache, old_views, old_scene)
    return PlannedFrame(plan.for_picture(previous=old_plan), cache, views, scene, old_frame)


def share_clip_planes(
    scene: Scene,
    cameras: Sequence[Camera],
    size: tuple[int, int],
    quality: Quality,
    cache: SceneCache | None = None,
) -> list[Camera]:
    """
    Give cameras of one scene common near and far planes, where they leave these open.

    Parameters
    ----------
    scene : Scene
    cameras : sequence of Camera
    size, quality
        As `rasterjit.render` takes them.
    cache : SceneCache, optional
        Of the scene.
    """
    if not any(map(has_open_plane, cameras)):
        return list(cameras)
    cache = update_cache(scene.nodes, cache, quality, scene.environment is not None)
    # In most batches, all cameras stand outside of the whole scene.
    low, high = object_transforms.bound_boxes(cache.shapes.boxes, cache.transforms.world_from_model)
    beyond = clip_planes.find_uneven_spheres(scene.nodes, cache.transforms.world_from_model)
    to_check = [
        camera
        for camera in cameras
        if (beyond and has_open_plane(camera)) or not clip_planes.is_box_between(low, high, camera)
    ]
    if to_check and quality.depth_format not in REVERSED_TYPES:
        # All cameras limit how near a near plane may come.
        to_check = [camera for camera in cameras if has_open_plane(camera)]
    needs = [find_scene_plane_needs(scene, camera, size, quality, cache) for camera in to_check]
    steps = clip_planes.merge_needs(needs).steps
    return [move_planes(camera, *steps) for camera in cameras]


def cut_by_section(scene: Scene) -> Scene:
    """Cut a scene by its section; return the scene itself without one."""
    if scene.section is None:
        return scene
    from rasterjit.survey.cross_sections import cut_scene

    return cut_scene(scene)


def cut_previous_scene(previous: Scene, scene: Scene) -> Scene:
    """Cut a previous scene where one that `cut_by_section` returned is cut."""
    if scene.section is None:
        return previous
    from rasterjit.survey import cross_sections

    return cross_sections.cut_earlier(previous, scene)


def has_open_plane(camera: Camera | None) -> bool:
    """Tell whether a camera leaves its near or far plane open."""
    planes = near_far(camera)
    return planes is not None and (planes.is_near_open or planes.is_far_open)


def find_scene_plane_needs(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    quality: Quality,
    cache: SceneCache | None = None,
    view_camera: Camera | None = None,
) -> PlaneNeeds:
    """
    Find how far a camera's open planes must move, and what its fixed planes clip.

    ``view_camera`` shows another part of the view with the same planes; default: ``camera``.
    """
    view_camera = camera if view_camera is None else view_camera
    if cache is None:
        cache = update_cache(scene.nodes, None, quality, scene.environment is not None)
    views = object_transforms.transform_to_view(cache.transforms, view_camera, size)
    boxes = Boxes(
        cache.shapes.boxes, view_camera.eye_position(), views.relative_from_model,
        views.clip_from_relative, overhang=cache.tables.inventory.pixel_overhang(size),
    )  # fmt: skip
    return clip_planes.find_plane_needs(
        camera, boxes, scene.nodes, views.clip_from_relative, quality
    )


def _have_planes_moved(before: Camera, after: Camera) -> bool:
    """Tell whether the near or far plane of a camera differs."""
    if before is after:
        return False
    old, new = near_far(before), near_far(after)
    return (old and old[:2]) != (new and new[:2])


def choose_camera(scene: Scene, camera: Camera | None, size: tuple[int, int]) -> Camera:
    """Return the camera given, else the scene's own, else one that fits the scene."""
    if camera is None:
        camera = scene.camera
    if camera is None:
        return default_camera(scene, size)
    return check_camera("camera", camera)


def resolve_previous_view(
    previous: PreviousView | None, plan: RenderPlan, scene: Scene, camera: Camera
) -> tuple[Scene, Camera] | None:
    """
    Return the previous scene and camera, as far as given, or ``None`` if no output needs them.

    ``camera`` is the given one, before its planes were moved.

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
        output = next(name for name in plan.outputs if name in output_table.MOTION_OUTPUTS)
        raise ValueError(
            f"previous must be a PreviousView where outputs has {output!r}, which tells what has "
            "changed since; got None"
        )
    previous_scene = scene
    if previous.scene is not None:
        with naming("previous.scene"):
            previous_scene = pose_input(previous.scene)
        motion.check_same_objects(_uncut_nodes(scene), previous_scene.nodes)
    if previous.camera is not None:
        with naming("previous.camera"):
            camera = choose_camera(previous_scene, previous.camera, plan.size)
            camera.projection_matrix(plan.size)
    return previous_scene, camera


def _uncut_nodes(scene: Scene) -> Sequence[Node]:
    """Return the nodes of a scene from before a section cut them."""
    cut = getattr(scene.nodes, "cut", None)
    return scene.nodes if cut is None else cut.nodes


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Prefix errors in a ``with`` block by the name of an argument."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def plan_previous_view(
    plan: RenderPlan, scene: Scene, camera: Camera, summary: SceneSummary, views: ViewTransforms
) -> RenderPlan:
    """Plan the visibility of a previous view."""
    request = FrameRequest(plan.size, plan.quality, ("face_id",), None, plan.cull)
    return make_plan(request, scene, camera, summary, views)
