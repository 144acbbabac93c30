"""
Decide, from the scene, the camera and the outputs, what a frame needs.

The scene is looked at once (`look`), every effect is asked once; a plan prints as a table, with the
kernels and buffers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.table import TABLE, check_outputs
from rasterjit.pipeline.records import Lighting
from rasterjit.rendering.effects import answer_effects
from rasterjit.rendering.sketch import list_stages
from rasterjit.scene.camera import Camera
from rasterjit.scene.color import linear_color
from rasterjit.scene.light import Light
from rasterjit.scene.quality import SUPERSAMPLED, Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import one_of, whole_size
from rasterjit.survey.blending import layers_of
from rasterjit.survey.contents import (
    Inventory,
    check_scene,
    may_have_holes,
    refuse_texture,
    take_inventory,
)
from rasterjit.survey.depth_format import depth_format
from rasterjit.survey.effect import Absent, Planned, Planning, Rows
from rasterjit.survey.facts import Facts, look
from rasterjit.survey.lights import headlight, lighting_of
from rasterjit.survey.placement import Boxes, Views, view_nodes
from rasterjit.survey.plan import RenderPlan

CULL_MODES = ("none", "back", "front")

BYTES = {"bool": 1, "uint8": 1, "int32": 4, "float32": 4, "float64": 8}

Known = tuple[Inventory, NDArray[np.float64]]
"""Inventory of a scene's objects, and their bounding boxes, (O, 2, 3), model space."""


def plan_frame(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    quality: Quality,
    outputs: Sequence[str],
    background: Any,
    cull: str,
    diagnose: bool = False,
    known: Known | None = None,
    views: Views | None = None,
) -> RenderPlan:
    """
    Check the arguments of a frame and decide what it needs.

    ``known`` and ``views`` are those of the scene's nodes, where they are known already.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    size = whole_size("size", size, quality.subpixel_bits)
    outputs = check_outputs(outputs)
    one_of("cull", cull, CULL_MODES)
    if not isinstance(diagnose, bool):
        raise ValueError(f"diagnose must be True or False, got {diagnose!r}")
    # Look at the scene.
    if known is None:
        check_scene(scene)
        known = take_inventory(scene.nodes, quality)
    if views is None:
        views = view_nodes(scene.nodes, camera, size)
    inventory, bounds = known
    eye, relative_from_model = camera.eye_position(), views.relative_from_model
    boxes = Boxes(bounds, eye, relative_from_model, views.clip_from_relative)
    facts = look(scene, boxes, views, inventory, quality, outputs, background, diagnose)
    _refuse(scene, facts)
    # Ask each effect.
    effects = answer_effects(facts, Planning(scene, camera, boxes, {}))
    return RenderPlan(
        size=size,
        camera=camera,
        quality=quality,
        outputs=outputs,
        background=linear_color("background", "white" if background is None else background),
        cull=cull,
        facts=facts,
        effects=effects,
        lighting=_lighting(camera, facts, effects),
        layers=layers_of(
            facts.transparency, facts.mixes_samples, quality.samples, scene.nodes, quality
        ),
        depth_format=depth_format(quality.depth_format, camera, size),
        diagnose=diagnose,
        pictures=facts.pictures,
    )


def _refuse(scene: Scene, facts: Facts) -> None:
    """Raise ``ValueError`` if texture coordinates are needed and missing."""
    contents, quality = facts.contents, facts.quality
    if "uv" in facts.outputs and contents.laid == 0:
        raise ValueError("outputs has 'uv', but no mesh of the scene has texture coordinates")
    if facts.colors_faces and contents.unlaid:
        refuse_texture(scene.nodes, quality)
    if contents.unlaid_holes and facts.finds_faces:
        refuse_texture([node for node in scene.nodes if may_have_holes(node.mesh)], quality)


def _lighting(camera: Camera, facts: Facts, effects: Sequence[Planned | Absent]) -> Lighting | None:
    """
    Return the lights as rows, relative to the eye; ``None`` if nothing depends on where it is.

    No lights in the scene, and no environment, mean a headlight.
    """
    if not facts.is_lit:
        on_samples = any(one.used and "sample" in one.effect.places for one in effects)
        return lighting_of([], camera, 0) if on_samples else None
    lights: Sequence[Light] = facts.lights.lights
    if facts.has_headlight:
        lights = headlight(camera)
    return lighting_of(lights, camera, facts.seen.highlights, int(facts.renormalizes))


class Kernel(NamedTuple):
    """One compiled entry point that a frame calls."""

    name: str
    """Module and function."""
    variant: str
    """What is compiled into it because the frame has it; empty if it has one form."""
    condition: str
    """What must happen for it to be called; empty if it always is."""


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


def list_kernels(plan: RenderPlan) -> tuple[Kernel, ...]:
    """Return the kernels that a frame calls, in order."""
    return tuple(Kernel(*row) for row in (*_geometry_rows(plan), *_picture_rows(plan)))


def _geometry_rows(plan: RenderPlan) -> Rows:
    """Return the kernels up to visibility."""
    depth = _kind_of_depth(plan)
    crossed = "a face crosses the near or far plane or the guard band"
    single = "float32 vertices" if plan.quality.precision == "float32" else ""
    rows = [("projection.transform_vertices", single, "")]
    positions = "" if plan.keeps_clip_positions else crossed
    rows += [("projection.transform_positions", single, positions)]
    rows += [
        (f"clipping.{name}", "", crossed)
        for name in ("find_clipped_faces", "count_clipped_vertices", "clip_faces")
    ]
    rows += [
        ("projection.project_clipped_vertices", "", crossed),
        ("setup.set_up_triangles", "", ""),
        ("binning.start_lists", "", ""),
        ("binning.bin_triangles", "", ""),
        ("tile_depths.find_floors", depth, "a face covers whole tiles"),
    ]
    if plan.needs_faces:
        rows.append(("nearest.draw_tiles", depth, ""))
        if plan.needs_cutouts:
            rows += [("alpha_test.keep_shown", depth, ""), ("alpha_test.find_alphas", "", "")]
    return rows


def _effect_rows(plan: RenderPlan, place: str, known: Rows = ()) -> Rows:
    """Return the kernels that effects call at a place, without those already listed."""
    told = [row for planned in plan.planned for row in planned.effect.kernels(plan).get(place, ())]
    names = {row[:2] for row in known if not row[2]}
    return [row for row in dict.fromkeys(told) if row[:2] not in names]


def _picture_rows(plan: RenderPlan) -> Rows:
    """Return the kernels that follow visibility."""
    rows: Rows = []
    if plan.reads_depth and not plan.depth_format.is_reversed:
        rows.append(("depth.fill_depths", _way_of_weights(plan), ""))
    rows += _effect_rows(plan, "prepare", _geometry_rows(plan))
    if plan.needs_color:
        rows += _layer_rows(plan)
    rows += _effect_rows(plan, "background")
    if plan.pictures > 1:
        rows += _average_rows(plan)
    rows += _effect_rows(plan, "overlay")
    fills = dict.fromkeys(TABLE[name].kernel for name in plan.outputs if TABLE[name].kernel)
    rows += [(kernel, _way_of_weights(plan), "") for kernel in fills]
    if "coverage" in plan.outputs:
        rows += [row for row in _coverage_rows(plan) if row not in rows]
    if plan.diagnose:
        rows += [
            (f"diagnostics_stage.{name}", "", "")
            for name in ("find_fates", "count_samples", "largest_error")
        ]
    return rows


def _coverage_rows(plan: RenderPlan) -> Rows:
    """Return the kernels that find how much of each pixel is covered."""
    samples = plan.quality.samples
    if samples == 1 or samples in SUPERSAMPLED:
        return []
    finder = ("fragments.find_layers", _kind_of_depth(plan), "")
    if samples == "area":
        finder = ("areas.find_areas", "", "")
    return [("fragments.split_lists", "", ""), finder]


def _average_rows(plan: RenderPlan) -> Rows:
    """Return the kernels that average whole pictures."""
    if plan.facts.mixes_codes:
        rows = [(f"encoded.{name}", "", "") for name in ("add_codes", "write_mean_codes")]
        rows.append(("encode.encode_rows", "", ""))
        if plan.layers is None and "linear" in plan.outputs:
            rows.append(("encoded.decode_rows", "", ""))
        return rows
    rows = [(f"weights.{name}", "", "") for name in ("add_picture", "write_mean")]
    if plan.layers is None and plan.at("mixed"):
        rows += _effect_rows(plan, "mixed")
    elif plan.layers is None and "color" in plan.outputs:
        rows.append(("encode.encode_rows", "", ""))
    return rows


def _kind_of_depth(plan: RenderPlan) -> str:
    """Return the type that depths are compared in, if it is not float32."""
    kind = np.dtype(plan.depth_format.kind).name
    return "" if kind == "float32" else f"{kind} depth"


def _way_of_weights(plan: RenderPlan) -> str:
    """Return how values are interpolated, if not perspective-correctly."""
    return "affine weights" if plan.is_affine else ""


def _layer_rows(plan: RenderPlan) -> Rows:
    """Return the kernels that composite or mix the faces of a pixel."""
    if plan.layers is None:
        return []
    samples, several = plan.layers.samples, "a pixel shows several faces"
    finder = ("fragments.find_layers", _kind_of_depth(plan), "")
    if samples == "area":
        finder = ("areas.find_areas", "", "")
    rows = [("fragments.split_lists", "", ""), finder]
    if samples != 1:
        opaque = "a row of tiles is opaque" if plan.layers.has_blended else ""
        finish = "finish_codes" if plan.layers.mixes_codes else "finish_mix"
        shared = [] if samples == "area" else ["share_samples"]
        rows += [(f"weights.{name}", "", opaque) for name in (*shared, finish)]
    if plan.layers.mixes_codes:
        return rows + _code_rows(plan, several)
    names: list[str] = []
    if plan.layers.has_blended:
        names += ["start_sums", "lay_under", "finish_sums"]
        names += ["list_faces", "mix_samples"] if samples != 1 else []
    rows += [(f"compositing.{name}", "", several) for name in names]
    if plan.at("mixed"):
        rows += _effect_rows(plan, "mixed")
    elif "color" in plan.outputs and (samples == 1 or plan.layers.has_blended):
        rows.append(("encode.encode_rows", "", ""))
    return rows


def _code_rows(plan: RenderPlan, several: str) -> Rows:
    """Return the kernels that mix codes."""
    rows: Rows = []
    samples, has_blended = plan.layers.samples, plan.layers.has_blended
    if has_blended and samples == 1:
        rows += [(f"encoded.{name}", "", several) for name in ("hide_behind", "lay_codes")]
    elif has_blended:
        rows += [("compositing.list_faces", "", several), ("encoded.mix_codes", "", several)]
    if samples != 1:
        rows.append(("encode.encode_rows", "", ""))
    if "linear" in plan.outputs:
        rows.append(("encoded.decode_rows", "", ""))
    return rows


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
    made = ((name, TABLE[name]) for name in plan.outputs if name != "face_id")
    rows += [(f"output {name}", row.channels, row.dtype) for name, row in made]
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
    stages = [(stage.name, ", ".join(stage.reads)) for stage in list_stages(plan)]
    for title, rows in (("kernels", kernels), ("stages", stages), ("buffers", buffers)):
        if not rows:
            continue
        widest = max(len(name) for name, _ in rows)
        lines = [f"  {name:<{widest}}  {text}".rstrip() for name, text in rows]
        parts.append("\n".join([title, *lines]))
    return "\n\n".join(parts)


def _where(condition: str) -> str:
    return f"where {condition}" if condition else ""
