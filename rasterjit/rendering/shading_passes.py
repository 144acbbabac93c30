"""
The passes that shade a picture, in order.

A pass is listed only if `ShadingNeeds` or an effect need it; its arrays are bound later. See
``pipeline/surface/sample_block.py`` for the block of samples that all work on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.fragments.coverage_resolve import accumulate_layers, encode_samples
from rasterjit.pipeline.lighting import light_stages as lights
from rasterjit.pipeline.lighting.gouraud import gather_vertices, store_lit_vertices
from rasterjit.pipeline.passes import Pass, PyrenderNeeds, ShadingArrays, ShadingNeeds, fixed
from rasterjit.pipeline.records import GOURAUD, MATERIAL_MODEL, Placement
from rasterjit.pipeline.srgb_encoding import make_encoding_table
from rasterjit.pipeline.surface import (
    attributes,
    barycentric_weights,
    float32_colors,
    isolines,
    material_maps,
    point_normals,
    scalar_colors,
    texture_filters,
    texture_lookup,
    uv_derivatives,
    uv_interpolation,
)
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import list_samples
from rasterjit.survey.effect import ActiveEffect, OpaquePassEffect, select_acting
from rasterjit.survey.transparency import PixelLayers

DIFFUSE = rows.OUT_RED
"""First row of the light on vertices without highlights: what is seen is not known yet there."""


def shading_passes(needs: ShadingNeeds, effects: Sequence[ActiveEffect]) -> tuple[list[Pass], int]:
    """Return the passes from listed samples to their colours, and the first row of these."""
    if shows_codes_only(needs, effects):
        return [], rows.RED
    passes = surface_passes(needs, effects)
    if not needs.is_lit:
        return passes + seen_passes(effects, rows.RED), rows.RED
    return passes + light_passes(needs, effects), rows.OUT_RED


def shows_codes_only(needs: ShadingNeeds, effects: Sequence[ActiveEffect]) -> bool:
    """Tell whether codes of textures are written as they are, with no light in between."""
    acting = (select_acting(effects, place) for place in ("seen", "sample", "pixel"))
    return needs.shows_codes_only and not any(acting)


def list_passes(
    needs: ShadingNeeds,
    effects: Sequence[ActiveEffect],
    layers: PixelLayers | None,
    outputs: Sequence[str],
) -> list[Pass]:
    """
    Return all passes that shade a picture before anything is drawn.

    Those of vertices come first; then those of samples, up to those that write or mix colours.
    """
    passes, no_arrays, table = [], np.empty((0, 4), np.float32), make_encoding_table()
    for has_highlights in (True,) * needs.gouraud + (False,) * needs.diffuse_apart:
        own = needs.of_vertices(has_highlights and needs.highlights)
        listed = (0, 0), np.zeros(1, np.int64)
        passes += vertex_passes(own, effects, listed, no_arrays)
    shading, shown = shading_passes(needs, effects)
    passes += [fixed(list_samples), *shading]
    has_linear, has_color = "linear" in outputs, "color" in outputs
    if layers is not None:
        has_linear, has_color = not layers.blends_srgb8, layers.blends_srgb8
        if layers.samples != 1:
            mixed = mixing_passes(needs, shown, table, effects, layers.blends_srgb8, ())
            passes += mixed
            if not layers.has_blended:
                return passes
    linear, color = np.empty((0, int(has_linear), 4)), np.empty((0, int(has_color)))
    return passes + output_passes(needs, shown, table, effects, linear, color)


# Surfaces: weights, colours, normals, points.


def surface_passes(needs: ShadingNeeds, effects: Sequence[ActiveEffect]) -> list[Pass]:
    """Return the passes that compute surface attributes."""
    passes = [*weight_passes(needs), color_pass(needs)]
    if needs.multiplies_vertex_colors:
        passes += set_colors_apart()
    # Gouraud light includes vertex colours; face colours and textures multiply it.
    if needs.gouraud:
        passes.append(
            Pass(
                attributes.interpolate_lit_vertices,
                lambda a: (a.surface.lit_vertices, a.lit_base, rows.RED),
            )
        )
    if needs.diffuse_apart:
        passes.append(
            Pass(
                attributes.interpolate_lit_vertices,
                lambda a: (a.surface.diffuse_vertices, a.lit_base, DIFFUSE),
            )
        )
    if needs.face_colors:
        passes.append(face_color_pass(needs))
    if needs.fields:
        passes += [*field_passes(needs), multiply_pass(needs)]
    has_base_texture = needs.textures and texture_filters.BASE_COLOR in needs.kinds
    if has_base_texture:
        own = texture_filters.BASE_COLOR
        decoding = decoding_passes() if needs.pyrender is not None else ()
        passes += [read_pass(own), *decoding, multiply_pass(needs)]
        if needs.some_coded:
            passes.append(decoding_pass(needs))
    if needs.alphas:
        passes.append(alpha_pass(has_base_texture))
        if needs.fields:
            alphas = Pass(
                scalar_colors.multiply_colormap_alphas, lambda a: (a.surface.alphas.is_blended,)
            )
            passes += [*field_passes(needs), alphas]
    if not needs.is_lit:
        return passes + emission_passes(needs, rows.RED)
    passes.append(Pass(attributes.fill_highlights, lambda a: (a.lit_base,)))
    if needs.microfacets:
        passes.append(
            Pass(attributes.fill_microfacets, lambda a: (a.surface.microfacets.factors, a.lit_base))
        )
    passes += place_passes(needs)
    if needs.points:
        passes.append(Pass(point_normals.find_point_normals, lambda a: (*a.surface.points, a.seen)))
    if needs.gouraud and not select_acting(effects, "sample"):
        passes.append(Pass(attributes.fill_placeholders, lambda a: (_are_gouraud(a),)))
    if needs.coats:
        passes += coat_passes(needs)
    passes += map_passes(needs)
    if needs.layers:
        passes += layer_passes(needs)
    return passes


def _are_gouraud(arrays: ShadingArrays) -> NDArray[np.uint8]:
    """Return which objects are lit at their vertices, (O,)."""
    return (arrays.lit_base[:, MATERIAL_MODEL] == GOURAUD).astype(np.uint8)


def weight_passes(needs: ShadingNeeds) -> list[Pass]:
    """Return the passes that find weights in float64, and texture coordinates."""
    if needs.reads_uv_only:
        return [
            Pass(
                uv_interpolation.interpolate_uv_from_edges,
                lambda a: (a.surface.textures.uv, a.geometry),
            )
        ]
    if not needs.is_lit:
        is_interpolated = needs.vertex_colors or needs.textures or needs.fields
        if not is_interpolated or (needs.vertex_colors and needs.all_in_float32):
            return []
    return [find_weights_pass(), *(coordinate_passes(needs) if needs.textures else ())]


def find_weights_pass() -> Pass:
    """Return the pass that finds weights in float64."""
    return Pass(barycentric_weights.find_weights, lambda a: (a.geometry, a.seen))


def color_pass(needs: ShadingNeeds) -> Pass:
    """Return the pass that shows base colours, of vertices where they have some."""
    if not needs.vertex_colors:
        return Pass(attributes.fill_base_colors, lambda a: (a.lit_base,))
    if not needs.some_in_float32:
        return Pass(
            attributes.interpolate_vertex_colors, lambda a: (a.surface.vertex_colors, a.lit_base)
        )
    return Pass(
        float32_colors.find_float32_colors,
        lambda a: (a.geometry, a.lit_base, a.surface.vertex_colors, a.surface.in_float32),
    )


def set_colors_apart() -> list[Pass]:
    """Return the passes that put colours of vertices aside, and base colours in their place."""
    from rasterjit.pipeline.lighting import pyrender
    from rasterjit.pipeline.surface.layer_rows import copy_rows

    aside = fixed(copy_rows, rows.RED, pyrender.VERTEX_COLOR_RED, 3)
    return [aside, Pass(attributes.fill_base_colors, lambda a: (a.surface.materials,))]


def face_color_pass(needs: ShadingNeeds) -> Pass:
    """Return the pass that multiplies base colours by those of faces."""
    if not needs.diffuse_apart:
        return Pass(attributes.multiply_face_colors, lambda a: (a.surface.face_colors,))
    return Pass(
        attributes.multiply_face_colors_below_highlights,
        lambda a: (a.surface.face_colors, a.lit_base, DIFFUSE),
    )


def field_passes(needs: ShadingNeeds) -> list[Pass]:
    """Return the passes that show the colours of scalars, and the lines between them."""
    passes = [Pass(scalar_colors.apply_colormaps, lambda a: tuple(a.surface.fields[:-1]))]
    if needs.contours:

        def lines(a: ShadingArrays) -> tuple[Any, ...]:
            return a.surface.fields.values, *a.surface.fields.contours, a.geometry

        passes.append(Pass(isolines.draw_isolines, lines))
    return passes


def alpha_pass(has_textures: bool) -> Pass:
    """Return the pass that finds the alpha of each sample, right behind that of textures."""

    def alphas(a: ShadingArrays) -> tuple[Any, ...]:
        none = np.empty((0, 4), np.float32)
        colors = a.surface.face_colors, a.surface.vertex_colors
        own = (none if some is None else some for some in colors)
        return a.surface.alphas.is_blended, a.lit_base, *own, int(has_textures)

    return Pass(attributes.find_alphas, alphas)


def place_passes(needs: ShadingNeeds) -> list[Pass]:
    """Return the passes that find points and normals in float64."""
    passes = [
        Pass(attributes.gather_positions, lambda a: (a.seen.positions,)),
        Pass(attributes.find_points, lambda a: (a.seen, a.lit_base, 0)),
    ]
    if needs.flat:
        passes.append(Pass(attributes.find_centroids, lambda a: (a.seen, a.lit_base)))
    if needs.normals and needs.smooth:
        passes.append(
            Pass(
                attributes.find_smooth_normals,
                lambda a: (a.surface.normals, a.seen.normal_matrices, a.lit_base),
            )
        )
    if not needs.normals or needs.faceted:
        passes.append(
            Pass(attributes.find_face_normals, lambda a: (a.seen, a.lit_base, int(needs.normals)))
        )
    return passes


# Textures: where they are looked up, and what they are read for.


def coordinate_passes(needs: ShadingNeeds, kind: int | None = None) -> list[Pass]:
    """
    Return the passes that find texture coordinates, right after the weights.

    ``kind`` is that of maps with coordinates of their own; None: those of base colours.
    """

    def uv(a: ShadingArrays) -> NDArray[np.float32]:
        return a.surface.textures.uv if kind is None else a.surface.maps.coordinates[kind]

    passes = [Pass(uv_derivatives.interpolate_uv, lambda a: (uv(a),))]
    if needs.mipmapped:
        passes.append(
            Pass(
                uv_derivatives.find_uv_steps,
                lambda a: (uv(a), a.surface.textures.table, a.geometry),
            )
        )
    return passes


def lay_passes(needs: ShadingNeeds, kind: int | None = None) -> list[Pass]:
    """Return the passes that recompute texture coordinates and their steps."""
    # Other stages have overwritten the gathered vertices that steps are found from.
    return [find_weights_pass(), *coordinate_passes(needs, kind)]


def read_pass(kind: int) -> Pass:
    """Return the pass that reads the textures of a kind."""
    return Pass(texture_lookup.read_textures, lambda a: (kind, a.surface.textures))


def map_read_passes(needs: ShadingNeeds, kind: int, *applied: Pass) -> list[Pass]:
    """Return the passes that read maps of a kind, at their coordinates, and apply them."""
    if kind not in needs.separate_uv_kinds:
        return [read_pass(kind), *applied]
    return [*lay_passes(needs, kind), read_pass(kind), *applied, *lay_passes(needs)]


def decoding_passes() -> list[Pass]:
    """Return the pass that decodes texture colours from sRGB codes."""
    from rasterjit.pipeline.lighting import pyrender

    return [fixed(pyrender.decode_textures)]


def decoding_pass(needs: ShadingNeeds) -> Pass:
    """Return the pass that shows textures that are read as codes."""
    from rasterjit.pipeline.surface.texture_codes import decode_texture_codes

    def coded(a: ShadingArrays) -> tuple[Any, ...]:
        surface = a.surface
        curve = surface.textures.curves[texture_filters.SRGB]
        return surface.textures.uv, a.geometry, surface.coded, int(needs.on_faces), curve

    return Pass(decode_texture_codes, coded)


def multiply_pass(needs: ShadingNeeds) -> Pass:
    """Return the pass that multiplies base colours by what a pass before shows."""
    if not needs.diffuse_apart:
        return fixed(texture_lookup.multiply_textures)
    return Pass(texture_lookup.multiply_textures_below_highlights, lambda a: (a.lit_base, DIFFUSE))


def bending_pass(kind: int) -> Pass:
    """Return the pass that applies normal maps: the base layer's, or the clearcoat's."""

    def bent(a: ShadingArrays) -> tuple[Any, ...]:
        own, maps = a.surface.textures, a.surface.maps
        uv = own.uv if maps.coordinates[kind] is None else maps.coordinates[kind]
        if kind == texture_filters.NORMAL:
            return own.table, uv, maps.tangents, maps.factors, a.seen
        table, layers = own.table.copy(), a.surface.layers
        table[:, texture_filters.NORMAL] = table[:, kind]
        return table, uv, layers.coat_tangents, layers.coat_scales, a.seen

    return Pass(material_maps.apply_normal_maps, bent)


def map_passes(needs: ShadingNeeds) -> list[Pass]:
    """Return the passes that apply normal, metallic-roughness and occlusion maps."""
    passes = []
    if needs.has(texture_filters.NORMAL):
        passes += map_read_passes(
            needs, texture_filters.NORMAL, bending_pass(texture_filters.NORMAL)
        )
    if needs.has(texture_filters.METALLIC_ROUGHNESS) and needs.microfacets:
        scaled = fixed(material_maps.apply_metallic_roughness_maps)
        passes += map_read_passes(needs, texture_filters.METALLIC_ROUGHNESS, scaled)
    if needs.has(texture_filters.OCCLUSION):
        dimmed = Pass(material_maps.apply_occlusion_maps, lambda a: (a.surface.maps.factors,))
        passes += map_read_passes(needs, texture_filters.OCCLUSION, dimmed)
    return passes


def scaled_passes(
    needs: ShadingNeeds, scales: Sequence[tuple[int, tuple[int, int, int]]]
) -> list[Pass]:
    """Return the passes that scale rows by textures: of each kind first row, channel, number."""
    from rasterjit.pipeline.surface.layer_rows import multiply_rows_by_textures

    passes = []
    for kind, scaled in scales:
        if needs.has(kind):
            passes += map_read_passes(needs, kind, fixed(multiply_rows_by_textures, *scaled))
    return passes


def through_passes(needs: ShadingNeeds) -> list[Pass]:
    """Return the passes that find transmission and thickness of samples."""
    if not needs.transmission:
        return []
    from rasterjit.pipeline.surface.layer_rows import fill_rows

    scales = (
        (texture_filters.TRANSMISSION, (rows.TRANSMISSION, 0, 1)),
        (texture_filters.THICKNESS, (rows.THICKNESS, 1, 1)),
    )
    return [
        Pass(fill_rows, lambda a: (a.surface.transmission.rows, rows.TRANSMISSION)),
        *scaled_passes(needs, scales),
    ]


def coat_passes(needs: ShadingNeeds) -> list[Pass]:
    """Return the passes that find the clearcoat and its normals, before the base's normal map."""
    from rasterjit.pipeline.surface.layer_rows import copy_rows, fill_rows, swap_rows

    kept = fixed(copy_rows, rows.NORMAL_X, rows.COAT_NORMAL_X, 3)
    filled = Pass(fill_rows, lambda a: (a.surface.layers.coats, rows.COAT))
    kind = texture_filters.CLEARCOAT_NORMAL
    if not needs.has(kind):
        return [filled, kept]
    # The base normals are restored once the clearcoat's map is applied.
    back = fixed(swap_rows, rows.NORMAL_X, rows.COAT_NORMAL_X, 3)
    return [filled, kept, *map_read_passes(needs, kind, bending_pass(kind), back)]


def layer_passes(needs: ShadingNeeds) -> list[Pass]:
    """Return the passes that find material layers, by factors and textures."""
    from rasterjit.pipeline.surface.layer_rows import fill_rows

    passes, scales = [], []
    if needs.coats:
        scales += [
            (texture_filters.CLEARCOAT, (rows.COAT, 0, 1)),
            (texture_filters.CLEARCOAT_ROUGHNESS, (rows.COAT_ROUGHNESS, 1, 1)),
        ]
    if needs.sheens:
        passes.append(Pass(fill_rows, lambda a: (a.surface.layers.sheens, rows.SHEEN_RED)))
        scales += [
            (texture_filters.SHEEN_COLOR, (rows.SHEEN_RED, 0, 3)),
            (texture_filters.SHEEN_ROUGHNESS, (rows.SHEEN_ROUGHNESS, 3, 1)),
        ]
    if needs.dielectrics:
        passes.append(Pass(fill_rows, lambda a: (a.surface.layers.dielectrics, rows.F0_RED)))
        scales += [
            (texture_filters.SPECULAR_FACTOR, (rows.F90, 3, 1)),
            (texture_filters.SPECULAR_COLOR, (rows.F0_RED, 0, 3)),
        ]
    return passes + scaled_passes(needs, scales)


def emission_passes(needs: ShadingNeeds, shown: int, decoding: Sequence[Pass] = ()) -> list[Pass]:
    """Return the passes that add emission to three rows from ``shown`` on."""
    if not needs.maps:
        return []
    passes = [Pass(material_maps.fill_emission, lambda a: (a.surface.maps.factors,))]
    kind = texture_filters.EMISSIVE
    if needs.has(kind):
        passes += lay_passes(needs, kind) if kind in needs.separate_uv_kinds else []
        passes += [read_pass(kind), *decoding, fixed(material_maps.apply_emission_maps)]
    return [*passes, fixed(material_maps.add_emission, shown)]


# Light.


def light_passes(needs: ShadingNeeds, effects: Sequence[ActiveEffect]) -> list[Pass]:
    """Return the passes that light base colours."""
    if needs.pyrender is not None:
        return imitating_passes(needs, needs.pyrender, effects)
    passes = through_passes(needs)
    passes += effect_passes(effects, "rows", needs)
    passes.append(ambient_pass())
    if needs.renormalizes:
        passes.append(fixed(lights.normalize_normals))
    if needs.microfacets:
        shown = Pass(lights.write_microfacet_ambient, lambda a: (a.lighting.ambient, a.viewer))
        passes += layered_ambient_passes(needs, shown) if needs.layers else [shown]
    passes += passes_of_lights(needs, effects)
    passes += emission_passes(needs, rows.OUT_RED)
    if needs.layers:
        from rasterjit.pipeline.lighting import layered_materials

        passes += layered_materials.list_finishing_passes(needs)
    passes += seen_passes(effects, rows.OUT_RED)
    return passes + covering_passes(needs, effects)


def ambient_pass() -> Pass:
    """Return the pass that shows ambient light."""
    return Pass(lights.start_with_ambient, lambda a: (a.lighting.ambient,))


def layered_ambient_passes(needs: ShadingNeeds, shown: Pass) -> list[Pass]:
    """Return the passes that add ambient light to microfacet materials and their layers."""
    from rasterjit.pipeline.lighting import layered_materials

    passes = layered_materials.list_starting_passes(needs, fixed(lights.normalize_normals))
    return passes + layered_materials.list_ambient_passes(
        needs, shown, ambient_pass(), is_first=True
    )


def seen_passes(effects: Sequence[ActiveEffect], shown: int) -> list[Pass]:
    """Return the passes that effects bring where samples show three rows of colours, lit or not."""
    return [
        one for active in select_acting(effects, "seen") for one in active.call_at("seen", shown)
    ]


def effect_passes(
    effects: Sequence[ActiveEffect], place: str, needs: ShadingNeeds, *arguments: Any
) -> list[Pass]:
    """Return the passes that effects bring at a place, in the order of the effects."""
    return [
        one
        for active in select_acting(effects, place)
        for one in active.call_at(place, needs, *arguments)
    ]


def passes_of_lights(
    needs: ShadingNeeds, effects: Sequence[ActiveEffect], of_vertices: bool = False
) -> list[Pass]:
    """
    Return the passes that add all lights, each dimmed by effects, and light from all sides.

    Lights run together from one that is dimmed to the next, whose dimming falls on it.
    """
    passes: list[Pass] = []
    first, count, dimming = 0, needs.lights or 0, select_acting(effects, "light")
    mapped = () if needs.pyrender is None else needs.pyrender.mapped
    for n in range(count) if dimming or mapped else ():
        if n in mapped:
            passes += [*add_passes(needs, first, n), *mapped_light_passes(needs, n)]
            first = n + 1
            continue
        dimmed = effect_passes(dimming, "light", needs, n, of_vertices)
        if dimmed:
            passes += add_passes(needs, first, n) + dimmed
            first = n
    passes += add_passes(needs, first, count)
    return passes + effect_passes(effects, "around", needs)


def add_passes(needs: ShadingNeeds, first: int, end: int) -> list[Pass]:
    """Return the passes that add lights ``first`` to ``end``; none if these are none."""
    if first == end:
        return []
    if needs.pyrender is not None:
        from rasterjit.pipeline.lighting import pyrender

        def lit_by(a: ShadingArrays) -> tuple[Any, ...]:
            return a.lighting.lights, first, end, a.lighting.pyrender.falls_on, a.viewer

        return [Pass(pyrender.add_lights_as_pyrender, lit_by)]
    if needs.layers:
        from rasterjit.pipeline.lighting import layered_materials

        return [
            one
            for n in range(first, end)
            for one in layered_materials.list_light_passes(
                needs, n, shiny_pass(needs, n, n + 1), facet_pass(n, n + 1)
            )
        ]
    facets = [facet_pass(first, end)] if needs.microfacets else []
    return [shiny_pass(needs, first, end), *facets]


def shiny_pass(needs: ShadingNeeds, first: int, end: int) -> Pass:
    """Return the pass that adds lights to what microfacets do not shade."""
    if not needs.highlights:
        return Pass(lights.add_diffuse_lights, lambda a: (a.lighting.lights, first, end))
    return Pass(lights.add_blinn_phong_lights, lambda a: (a.lighting.lights, first, end, a.viewer))


def facet_pass(first: int, end: int) -> Pass:
    """Return the pass that adds lights to what microfacets shade."""

    def parts(a: ShadingArrays) -> tuple[Any, ...]:
        return a.lighting.lights, first, end, a.viewer, a.surface.microfacets.lobes

    return Pass(lights.add_microfacet_lights, parts)


def covering_passes(needs: ShadingNeeds, effects: Sequence[ActiveEffect]) -> list[Pass]:
    """Return the passes of effects over lit samples, and of transmission."""
    if not needs.transmission:
        return effect_passes(effects, "sample", needs)
    from rasterjit.pipeline.surface.layer_rows import FOG_RED, fill_rows, swap_rows

    acts = select_acting(effects, "sample")
    seen = [one for one in acts if isinstance(one.effect, OpaquePassEffect)]
    over = effect_passes([one for one in acts if one not in seen], "sample", needs)

    def dark(a: ShadingArrays) -> tuple[Any, ...]:
        return np.zeros((len(a.surface.transmission.rows), 3), np.float32), FOG_RED

    passes = [Pass(fill_rows, dark)]
    if over:
        # Over black, they give their own contribution.
        turned = fixed(swap_rows, rows.OUT_RED, FOG_RED, 3)
        passes += [turned, *over, turned, *over]
    return passes + effect_passes(seen, "sample", needs)


# Light as in pyrender's shader.


def without_sides(placement: Placement, needs: ShadingNeeds) -> Placement:
    """Return a placement of which no face's back is seen: its normals are left as they are."""
    placement = placement._replace(front_windings=np.zeros_like(placement.front_windings))
    if needs.maps and texture_filters.NORMAL in needs.kinds:
        # Which way round a normal map lies is read there.
        return placement
    return placement._replace(mirrored=np.zeros_like(placement.mirrored))


def whitened(materials: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return materials with white base colours."""
    white = materials.copy()
    white[:, :3] = 1.0
    return white


def imitating_passes(
    needs: ShadingNeeds, imitated: PyrenderNeeds, effects: Sequence[ActiveEffect]
) -> list[Pass]:
    """Return the passes that light base colours as pyrender's shader does."""
    from rasterjit.pipeline.lighting import pyrender

    passes = []
    if imitated.has_squares:
        passes.append(
            Pass(
                pyrender.move_to_square_centers,
                lambda a: (a.lighting.pyrender.are_squares, a.geometry.faces, a.placement),
            )
        )
    if imitated.faces_viewer:
        passes.append(
            Pass(
                pyrender.point_normals_at_viewer,
                lambda a: (a.lighting.pyrender.faces_viewer, a.viewer),
            )
        )
    if imitated.has_gains:
        passes.append(
            Pass(pyrender.multiply_by_gains, lambda a: (a.lighting.pyrender.gains, 0, rows.RED))
        )
    passes += effect_passes(effects, "rows", needs)
    passes += [
        Pass(pyrender.write_ambient_on_base, lambda a: (a.lighting.ambient,)),
        fixed(lights.normalize_normals),
        *passes_of_lights(needs, effects),
    ]
    if needs.maps and texture_filters.OCCLUSION in needs.kinds:
        passes.append(fixed(pyrender.multiply_by_occlusion))
    passes += emission_passes(needs, rows.OUT_RED, decoding_passes())
    if needs.vertex_colors:
        passes.append(fixed(pyrender.multiply_by_vertex_colors))
    if imitated.has_gains:
        passes.append(
            Pass(pyrender.multiply_by_gains, lambda a: (a.lighting.pyrender.gains, 3, rows.OUT_RED))
        )
    return passes + seen_passes(effects, rows.OUT_RED) + effect_passes(effects, "sample", needs)


def mapped_light_passes(needs: ShadingNeeds, n: int) -> list[Pass]:
    """Return the passes that add a light with a shadow map as pyrender has them."""
    from rasterjit.pipeline.lighting import pyrender

    def found(a: ShadingArrays) -> tuple[Any, ...]:
        view, depths = next(rest for row, *rest in a.lighting.pyrender.maps if row == n)
        return a.lighting.lights[n], view, depths

    shadow = Pass(pyrender.read_shadow_map, found)
    return [shadow, *add_passes(needs, n, n + 1), fixed(lights.reset_visibility)]


# Vertices, and what becomes of colours.


def vertex_passes(
    needs: ShadingNeeds,
    effects: Sequence[ActiveEffect],
    listed: tuple[tuple[int, int], NDArray[np.int64]],
    lit_vertices: NDArray[np.float32],
) -> list[Pass]:
    """Return the passes that light some vertices, of those that begin with each object."""
    (first, end), vertex_starts = listed

    def own(a: ShadingArrays) -> tuple[Any, ...]:
        colors = a.surface.vertex_colors
        if colors is None:
            colors = np.empty((0, 4), np.float32)
        materials, normals = a.surface.materials, a.surface.normals
        return first, end, vertex_starts, a.placement, materials, colors, normals

    return [
        Pass(gather_vertices, own), ambient_pass(), fixed(lights.normalize_normals),
        *passes_of_lights(needs, effects, of_vertices=True),
        fixed(store_lit_vertices, lit_vertices),
    ]  # fmt: skip


def mixing_passes(
    needs: ShadingNeeds,
    shown: int,
    table: NDArray[np.int32],
    effects: Sequence[ActiveEffect],
    has_codes: bool,
    target: tuple[NDArray[np.float32], ...],
) -> list[Pass]:
    """Return the passes that resolve colours, or their codes, over the background."""
    passes: list[Pass] = []
    if has_codes:
        passes, shown = pixel_passes(shown, effects)
        passes.append(fixed(encode_samples, shown, table))
    return [*passes, fixed(accumulate_layers, shown, int(needs.alphas), *target)]


def output_passes(
    needs: ShadingNeeds,
    shown: int,
    table: NDArray[np.int32],
    effects: Sequence[ActiveEffect],
    linear: NDArray[Any],
    color: NDArray[Any],
) -> list[Pass]:
    """Return the passes that write the colours, which begin at row ``shown``, of a band of rows."""
    passes: list[Pass] = []
    if shows_codes_only(needs, effects):
        from rasterjit.pipeline.surface.texture_codes import write_texture_codes

        def coded(a: ShadingArrays) -> tuple[Any, ...]:
            return a.surface.textures.uv, a.geometry, a.surface.coded, color

        return [Pass(write_texture_codes, coded)]
    if linear.shape[1]:
        passes.append(fixed(lights.write_linear, shown, int(needs.alphas), linear))
    if color.shape[1]:
        mapped, shown = pixel_passes(shown, effects)
        passes += mapped
        write = lights.write_blended_codes if needs.alphas else lights.write_opaque_codes
        passes.append(fixed(write, shown, table, color))
    return passes


def pixel_passes(shown: int, effects: Sequence[ActiveEffect]) -> tuple[list[Pass], int]:
    """Return the passes between the light of three rows and its codes, and where they write it."""
    passes: list[Pass] = []
    for one in select_acting(effects, "pixel"):
        own, shown = one.call_at("pixel", shown)
        passes += own
    return passes, shown
