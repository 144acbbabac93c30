"""List what a plan will run and hold: kernels with their variants, and buffers of the frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rasterjit.kernels.records import Fog, Lighting, ToneMap
from rasterjit.plan import RenderPlan
from rasterjit.plan_lights import has_cube
from rasterjit.scene.quality import SUPERSAMPLED

BYTES = {"bool": 1, "uint8": 1, "int32": 4, "float32": 4, "float64": 8}


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


Rows = list[tuple[str, str, str]]


def _geometry_rows(plan: RenderPlan) -> Rows:
    """Return the kernels up to visibility."""
    depth = _kind_of_depth(plan)
    holes = ", ".join(filter(None, ("holes" if plan.needs_cutouts else "", depth)))
    crossed = "a face crosses the near or far plane or the guard band"
    single = "float32 vertices" if plan.quality.precision == "float32" else ""
    rows = [("projection.transform_vertices", single, "")]
    keeps_positions = plan.diagnose or plan.wireframe is not None
    rows += [("projection.transform_positions", single, "" if keeps_positions else crossed)]
    rows += [
        (f"clipping.{name}", "", crossed)
        for name in ("find_clipped_faces", "count_clipped_vertices", "clip_faces")
    ]
    rows += [
        ("projection.project_clipped_vertices", "", crossed),
        ("setup.set_up_triangles", "", ""),
        ("binning.start_lists", "", ""),
        ("binning.bin_triangles", "", ""),
        ("occlusion.find_floors", depth, "a face covers whole tiles"),
    ]
    if plan.needs_faces:
        rows.append(("visibility.draw_tiles", holes, ""))
    if plan.casts_shadows:
        # The maps are drawn by the kernels above, with the lights as cameras.
        rows.append(("shadow_receivers.find_depth_ranges", "", ""))
        cast = "something casts a shadow on what is seen"
        rows.append(("projection.transform_vertices", "", cast))
        through = "holes" if plan.grounds.shades_through_holes else ""
        if through != holes or not plan.needs_faces:
            rows.append(("visibility.draw_tiles", through, cast))
    return rows


def _picture_rows(plan: RenderPlan) -> Rows:
    """Return the kernels that follow visibility."""
    rows: Rows = []
    if plan.reads_depth and not plan.depth_format.is_reversed:
        rows.append(("depths.fill_depths", _way_of_weights(plan), ""))
    if plan.ambient_occlusion is not None and plan.lighting is not None:
        rows += [("ambient_occlusion.find_occlusion", "", "")]
        rows += [("ambient_occlusion.smooth_occlusion", "", "")]
    if plan.needs_gouraud and plan.lighting is not None:
        rows.append(("shading.light_vertices", _variant_of_light(plan), ""))
    if plan.environment is not None or plan.backdrop is not None:
        rows += [
            (f"prefiltering.{name}", "", "a panorama is used for the first time")
            for name in ("average_columns", "add_ring", "project_rows")
        ]
    if plan.needs_color:
        if plan.layers is None or plan.layers.samples == 1 or plan.layers.has_blended:
            rows.append(("shading.shade_rows", _variant_of_shading(plan), ""))
        rows += _layer_rows(plan)
    if plan.backdrop is not None:
        rows.append(("backgrounds.show_environment", "", ""))
    if plan.pictures > 1:
        rows += _average_rows(plan)
    if plan.outline is not None:
        rows += [("outlines.find_edges", "", ""), ("outlines.draw_marks", "", "")]
    if plan.wireframe is not None:
        rows += _line_rows(plan)
    fills = {
        "barycentric": "fill_barycentric", "uv": "fill_attribute", "position": "fill_positions",
        "normal": "fill_normals", "geometric_normal": "fill_normals", "distance": "fill_positions",
        "object_position": "fill_positions", "nocs": "fill_positions",
    }  # fmt: skip
    way = _way_of_weights(plan)
    names = dict.fromkeys(fills[name] for name in plan.outputs if name in fills)
    rows += [(f"interpolation.{name}", way, "") for name in names]
    fills = {"motion": "fill_motion", "motion_visible": "fill_visible"}
    rows += [(f"motion.{fills[name]}", way, "") for name in plan.outputs if name in fills]
    if "coverage" in plan.outputs:
        rows += [row for row in _coverage_rows(plan) if row not in rows]
    if plan.diagnose:
        rows += [("diagnosis.find_fates", "", ""), ("diagnosis.count_samples", "", "")]
        rows += [("diagnosis.largest_error", "", "")]
    return rows


def _coverage_rows(plan: RenderPlan) -> Rows:
    """Return the kernels that find what of each pixel is covered."""
    samples = plan.quality.samples
    if samples == 1 or samples in SUPERSAMPLED:
        return []
    finder = ("transparency.find_layers", _kind_of_depth(plan), "")
    if samples == "area":
        finder = ("area.find_areas", "", "")
    return [("transparency.split_lists", "", ""), finder]


def _average_rows(plan: RenderPlan) -> Rows:
    """Return the kernels that average whole pictures."""
    if plan.grounds.mixes_codes:
        rows = [(f"code_blending.{name}", "", "") for name in ("add_codes", "write_mean_codes")]
        rows.append(("resolve.encode_rows", "", ""))
        if plan.layers is None and "linear" in plan.outputs:
            rows.append(("code_blending.decode_rows", "", ""))
        return rows
    rows = [(f"accumulation.{name}", "", "") for name in ("add_picture", "write_mean")]
    if plan.layers is None and plan.encoding.tone is not None:
        rows.append(("backgrounds.show_over", "", ""))
    elif plan.layers is None and "color" in plan.outputs:
        rows.append(("resolve.encode_rows", "", ""))
    return rows


def _line_rows(plan: RenderPlan) -> Rows:
    """Return the kernels that draw the edges of a wireframe."""
    hiding = "hidden lines removed" if plan.draws_faces else ""
    rows = [("wireframe.fill_slack", "", "")] if plan.draws_faces else []
    if plan.quality.lines == "bresenham":
        rows.insert(0, ("wireframe.find_pixels", "", ""))
        return rows + [
            (f"wireframe.{name}", hiding, "") for name in ("project_edges", "draw_edges")
        ]
    mixed = "codes" if plan.quality.blending == "srgb8" else "light"
    return [
        *rows,
        ("line_coverage.project_lines", hiding, ""),
        ("line_coverage.list_lines", "", ""),
        ("line_coverage.cover_lines", hiding, ""),
        ("line_coverage.lay_lines", mixed, ""),
    ]


def _kind_of_depth(plan: RenderPlan) -> str:
    """Return the type that depths are compared in, if it is not float32."""
    kind = np.dtype(plan.depth_format.kind).name
    return "" if kind == "float32" else f"{kind} depth"


def _way_of_weights(plan: RenderPlan) -> str:
    """Return how values are interpolated, if not perspective-correctly."""
    return "affine weights" if plan.is_affine else ""


def _layer_rows(plan: RenderPlan) -> Rows:
    """Return the kernels that put together what a pixel shows besides its nearest face."""
    if plan.layers is None:
        return []
    samples, several = plan.layers.samples, "a pixel shows several faces"
    finder = ("transparency.find_layers", _kind_of_depth(plan), "")
    if samples == "area":
        finder = ("area.find_areas", "", "")
    rows = [("transparency.split_lists", "", ""), finder]
    names: list[str] = []
    if samples != 1:
        opaque = "a row of tiles is opaque" if plan.layers.has_blended else ""
        rows.append(("shares.mix_faces", _variant_of_shading(plan), opaque))
    if plan.layers.mixes_codes:
        return rows + _code_rows(plan, several)
    if plan.layers.has_blended:
        names += ["start_sums", "lay_under", "finish_sums"]
        names += ["list_faces", "mix_samples"] if samples != 1 else []
    rows += [(f"layers.{name}", "", several) for name in names]
    if plan.encoding.tone is not None:
        rows.append(("backgrounds.show_over", "", ""))
    elif "color" in plan.outputs and (samples == 1 or plan.layers.has_blended):
        rows.append(("resolve.encode_rows", "", ""))
    return rows


def _code_rows(plan: RenderPlan, several: str) -> Rows:
    """Return the kernels that mix codes."""
    rows: Rows = []
    samples, has_blended = plan.layers.samples, plan.layers.has_blended
    if has_blended and samples == 1:
        rows += [(f"code_blending.{name}", "", several) for name in ("hide_behind", "lay_codes")]
    elif has_blended:
        rows += [("layers.list_faces", "", several), ("code_blending.mix_codes", "", several)]
    if samples != 1:
        rows.append(("resolve.encode_rows", "", ""))
    if "linear" in plan.outputs:
        rows.append(("code_blending.decode_rows", "", ""))
    return rows


def _variant_of_light(plan: RenderPlan) -> str:
    """Return which parts of the light are there."""
    lighting = plan.lighting
    if lighting is None:
        return ""
    present = {
        "highlights": lighting.highlights is not None,
        "microfacets": plan.needs_microfacets,
        "shadows": plan.casts_shadows,
        "environment": plan.environment is not None,
        "occlusion": plan.ambient_occlusion is not None,
        "fog": lighting.fog is not None,
        "library powers": _calls_library(lighting) or _calls_library(lighting.fog),
    }
    return ", ".join(["light", *(name for name, is_there in present.items() if is_there)])


def _calls_library(record: Lighting | Fog | ToneMap | None) -> bool:
    """Tell whether the math library is called for what a record says."""
    return record is not None and record.library is not None


def _variant_of_shading(plan: RenderPlan) -> str:
    """Return which records the shading kernel is compiled with."""
    shows_tones = plan.pictures == 1 or plan.grounds.mixes_codes
    present = {
        "normals": plan.needs_normals,
        "lit vertices": plan.needs_gouraud,
        "textures": plan.needs_textures,
        "maps": plan.needs_maps,
        "alphas": plan.layers is not None and plan.layers.has_blended,
        "tone curve": shows_tones and plan.encoding.tone is not None,
        "library exposure": shows_tones and _calls_library(plan.encoding.tone),
        _way_of_weights(plan): plan.is_affine,
    }
    light = _variant_of_light(plan)
    names = [name for name, is_there in present.items() if is_there]
    return ", ".join([light, *names] if light else names) or "base colours alone"


def list_buffers(plan: RenderPlan) -> tuple[Buffer, ...]:
    """Return the large arrays of a frame, its outputs included."""
    rows = [("faces seen", 1, "int32")]
    if plan.needs_depth:
        rows.append(("stored depth", 1, np.dtype(plan.depth_format.kind).name))
    if plan.reads_depth and not plan.depth_format.is_standard:
        rows.append(("reversed depth", 1, "float32"))
    if plan.pictures > 1:
        rows += [("sums of all pictures", 4, "float64"), ("one of the pictures", 4, "float32")]
    if plan.ambient_occlusion is not None:
        rows.append(("ambient occlusion, smooth, rough and its range", 3, "float32"))
    if plan.outline is not None:
        rows.append(("marks of outlines", 1, "uint8"))
    if plan.wireframe is not None and plan.draws_faces:
        rows.append(("slack of hidden lines", 1, "float32"))
    shapes = {
        "color": (4, "uint8"), "linear": (4, "float32"), "depth": (1, "float32"),
        "object_id": (1, "int32"), "barycentric": (3, "float32"), "uv": (2, "float32"),
        "normal": (3, "float32"), "position": (3, "float32"), "distance": (1, "float32"),
        "object_position": (3, "float32"), "nocs": (3, "float32"),
        "geometric_normal": (3, "float32"), "material_id": (1, "int32"),
        "instance_id": (1, "int32"), "coverage": (1, "float32"), "motion": (2, "float32"),
        "motion_visible": (1, "bool"),
    }  # fmt: skip
    rows += [(f"output {name}", *shapes[name]) for name in plan.outputs if name in shapes]
    return (*(Buffer(*row, plan.size) for row in rows), *_shadow_maps(plan))


def _shadow_maps(plan: RenderPlan) -> list[Buffer]:
    """Return the shadow maps; that of a point light has up to six sides."""
    found = []
    for light in plan.lights.lights if plan.casts_shadows else ():
        shadow = getattr(light, "shadow", None)
        if shadow is not None:
            sides = 6 if has_cube(light) else 1
            size = shadow.size, shadow.size
            found.append(Buffer(f"shadow map, {shadow.size} texels", sides, "float32", size))
    return found


def describe(plan: RenderPlan) -> str:
    """Return a plan as a table: what is in and out, kernels, and buffers."""
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
    for title, rows in (("kernels", kernels), ("buffers", buffers)):
        widest = max(len(name) for name, _ in rows)
        lines = [f"  {name:<{widest}}  {text}".rstrip() for name, text in rows]
        parts.append("\n".join([title, *lines]))
    return "\n\n".join(parts)


def _where(condition: str) -> str:
    return f"where {condition}" if condition else ""
