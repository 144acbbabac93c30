"""
The stages that shade a picture, in order, with what each of them reads.

A stage stands in the list only if something calls for it; see ``pipeline/surface/samples.py`` for
the block of samples that they work on, and ``runtime/driver.py`` for what runs them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.encode import Encoding, code_of, encoding_table
from rasterjit.pipeline.fragments.weights import code_samples, mix_shares
from rasterjit.pipeline.lighting import light_stages as lights
from rasterjit.pipeline.lighting.vertices import list_vertices, write_vertices
from rasterjit.pipeline.records import (
    FLAT,
    GOURAUD,
    MATERIAL_MODEL,
    PBR,
    PHONG,
    Fields,
    Geometry,
    Lighting,
    Maps,
    Placement,
    Surface,
    Textures,
)
from rasterjit.pipeline.surface import (
    attributes,
    contours,
    fields,
    float32_colors,
    maps,
    point_shapes,
    texture_gradients,
    texture_lookup,
    texture_places,
    textures,
    weights,
)
from rasterjit.pipeline.surface import samples as rows
from rasterjit.pipeline.surface.listing import list_samples
from rasterjit.pipeline.surface.samples import Block
from rasterjit.runtime.driver import BlockMemory, StageList, Step
from rasterjit.runtime.state import size_of, type_named
from rasterjit.runtime.team import Call
from rasterjit.runtime.threads import Workers
from rasterjit.survey.effect import Active, Look, acting

BLOCK = type_named(Block)
"""The types of the arrays of a block of samples."""

BLOCKS = BlockMemory(BLOCK)
"""The block of each thread."""

DIFFUSE = rows.OUT_RED
"""First row of the light on vertices without highlights: what is seen is not known yet there."""


def surface_steps(
    geometry: Geometry,
    placement: Placement,
    surface: Surface,
    lighting: Lighting | None,
    effects: Sequence[Active],
) -> list[Step]:
    """Return the stages that find what the surfaces are like: weights, colours, normals, points."""
    # What they are multiplied by comes last: until then they stand alone.
    are_apart = shows_colors_apart(surface, lighting)
    own_materials = surface.materials
    if are_apart:
        surface = surface._replace(materials=whitened(surface.materials))
    materials = surface.materials
    steps = [
        *weight_steps(geometry, placement, surface, lighting),
        color_step(geometry, surface),
    ]
    if are_apart:
        steps += set_colors_apart(own_materials)
    # Vertices are lit with their own colours; what faces and textures show multiplies that.
    if surface.lit_vertices is not None:
        lit = surface.lit_vertices, materials, rows.RED
        steps.append(Step(attributes.show_lit_vertices, lit))
    if surface.diffuse_vertices is not None:
        diffuse = surface.diffuse_vertices, materials, DIFFUSE
        steps.append(Step(attributes.show_lit_vertices, diffuse))
    if surface.face_colors is not None and surface.diffuse_vertices is None:
        steps.append(Step(attributes.multiply_face_colors, (surface.face_colors,)))
    elif surface.face_colors is not None:
        below = surface.face_colors, materials, DIFFUSE
        steps.append(Step(attributes.multiply_face_colors_below_highlights, below))
    if surface.fields is not None:
        steps += [*field_steps(surface.fields, geometry), multiply_step(surface)]
    has_textures = surface.textures is not None and shows(surface.textures, textures.BASE_COLOR)
    if has_textures:
        is_imitated = lighting is not None and lighting.imitated is not None
        steps += texture_steps(surface, decoding_steps() if is_imitated else ())
    if surface.alphas is not None:
        steps.append(alpha_step(surface, has_textures))
        if surface.fields is not None:
            steps += [
                *field_steps(surface.fields, geometry),
                Step(fields.multiply_alphas, (surface.alphas.is_blended,)),
            ]
    if lighting is None:
        return steps + emission_steps(surface, rows.RED, geometry, placement)
    steps.append(Step(attributes.find_reflectance, (materials,)))
    if surface.microfacets is not None:
        facets = surface.microfacets.factors, materials
        steps.append(Step(attributes.find_facets, facets))
    steps += place_steps(placement, surface)
    if surface.points is not None:
        steps.append(Step(point_shapes.find_point_shapes, (*surface.points, placement)))
    if surface.lit_vertices is not None and not acting(effects, "sample"):
        stands_in = (materials[:, MATERIAL_MODEL] == GOURAUD).astype(np.uint8)
        steps.append(Step(attributes.stand_in, (stands_in,)))
    if surface.layers is not None and surface.layers.coats is not None:
        steps += coat_steps(surface, geometry, placement)
    if surface.maps is not None and surface.textures is not None:
        steps += map_steps(surface.textures, surface.maps, surface, geometry, placement)
    if surface.layers is not None:
        steps += layer_steps(surface, geometry, placement)
    return steps


def place_steps(placement: Placement, surface: Surface) -> list[Step]:
    """Return the stages that find points and normals in float64."""
    materials, normals = surface.materials, surface.normals
    count_of = np.bincount(materials[:, MATERIAL_MODEL].astype(np.intp), minlength=PBR + 1)
    smooth = count_of[PHONG] + count_of[PBR]
    steps = [
        Step(attributes.gather_positions, (placement.positions,)),
        Step(attributes.find_points, (placement, materials, 0)),
    ]
    if count_of[FLAT]:
        steps.append(Step(attributes.find_middles, (placement, materials)))
    if normals is not None and smooth:
        turned = normals, placement.normal_matrices, materials
        steps.append(Step(attributes.find_smooth_normals, turned))
    if normals is None or smooth < len(materials):
        own = placement, materials, int(normals is not None)
        steps.append(Step(attributes.find_face_normals, own))
    return steps


def weight_steps(
    geometry: Geometry, placement: Placement, surface: Surface, lighting: Lighting | None
) -> list[Step]:
    """Return the stages that find weights in float64, and what textures are looked up by."""
    own = surface.textures
    if lighting is None:
        if own is not None and reads_places_alone(surface, own, geometry):
            return [Step(texture_places.find_places, (own.uv, geometry))]
        bare = surface.in_float32 if surface.vertex_colors is not None else None
        if not is_interpolated(surface) or (bare is not None and bool(bare.all())):
            return []
    steps = [] if own is None else coordinate_steps(own, geometry)
    return [Step(weights.find_weights, (geometry, placement)), *steps]


def color_step(geometry: Geometry, surface: Surface) -> Step:
    """Return the stage that shows base colours, of vertices where they have some."""
    if surface.vertex_colors is None:
        return Step(attributes.tint_samples, (surface.materials,))
    if surface.in_float32 is None:
        return Step(attributes.show_vertex_colors, (surface.vertex_colors, surface.materials))
    blended = geometry, surface.materials, surface.vertex_colors, surface.in_float32
    return Step(float32_colors.find_float32_colors, blended)


def without_sides(placement: Placement, surface: Surface) -> Placement:
    """Return a placement of which no face's back is seen: its normals are left as they are."""
    placement = placement._replace(front_turns=np.zeros_like(placement.front_turns))
    if surface.maps is not None and surface.maps.counts[textures.NORMAL]:
        # Which way round a normal map lies is read there.
        return placement
    return placement._replace(mirrored=np.zeros_like(placement.mirrored))


def shows_colors_apart(surface: Surface, lighting: Lighting | None) -> bool:
    """Return whether colours of vertices multiply what is seen, not what light falls on."""
    is_imitated = lighting is not None and lighting.imitated is not None
    return is_imitated and surface.vertex_colors is not None


def whitened(materials: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return materials with white base colours."""
    white = materials.copy()
    white[:, :3] = 1.0
    return white


def set_colors_apart(materials: NDArray[np.float32]) -> list[Step]:
    """Return the stages that put colours of vertices aside, and base colours in their place."""
    from rasterjit.pipeline.lighting import pyrender
    from rasterjit.pipeline.surface import layers as moves

    aside = Step(moves.copy_rows, (rows.RED, pyrender.COLOR_RED, 3))
    return [aside, Step(attributes.tint_samples, (materials,))]


def alpha_step(surface: Surface, has_textures: bool) -> Step:
    """Return the stage that finds the alpha of each sample, right behind that of textures."""
    none = np.empty((0, 4), np.float32)
    colors = surface.face_colors, surface.vertex_colors
    own = (none if some is None else some for some in colors)
    alphas = surface.alphas.is_blended, surface.materials, *own, int(has_textures)
    return Step(attributes.find_alphas, alphas)


def field_steps(own: Fields, geometry: Geometry) -> list[Step]:
    """Return the stages that show the colours of scalars, and the lines between them."""
    *shown, lines = own
    steps = [Step(fields.show_scalars, tuple(shown))]
    if lines is not None:
        steps.append(Step(contours.draw_contours, (own.values, *lines, geometry)))
    return steps


def is_interpolated(surface: Surface) -> bool:
    """Return whether anything is interpolated between vertices, without light."""
    kinds = surface.vertex_colors, surface.textures, surface.fields
    return any(kind is not None for kind in kinds)


def shows(own: Textures, kind: int) -> bool:
    """Return whether any object has a texture of a kind."""
    return bool((own.table[:, kind, textures.FIRST_LEVEL] >= 0).any())


def has_levels(own: Textures) -> bool:
    """Return whether any object has a texture with levels to choose from."""
    is_mipped = own.table[:, :, textures.FILTER] == textures.TRILINEAR
    return bool((is_mipped & (own.table[:, :, textures.FIRST_LEVEL] >= 0)).any())


def reads_places_alone(surface: Surface, own: Textures, geometry: Geometry) -> bool:
    """Return whether samples lie on their faces, and weights are read for coordinates alone."""
    is_on_face = geometry.viewport.reach == 0
    is_alone = surface.vertex_colors is None and surface.fields is None
    return is_on_face and is_alone and not has_levels(own)


def coordinate_steps(own: Textures, geometry: Geometry) -> list[Step]:
    """Return the stages that find where on their textures samples lie, right after the weights."""
    steps = [Step(texture_gradients.find_coordinates, (own.uv,))]
    if has_levels(own):
        steps.append(Step(texture_gradients.find_steps, (own.uv, own.table, geometry)))
    return steps


def texture_steps(surface: Surface, decoding: Sequence[Step]) -> list[Step]:
    """Return the stages that multiply base colours by what textures show, when that is decoded."""
    read = textures.BASE_COLOR, surface.textures
    return [Step(texture_lookup.read_textures, read), *decoding, multiply_step(surface)]


def decoding_steps() -> list[Step]:
    """Return the stage that decodes what textures show as codes."""
    from rasterjit.pipeline.lighting import pyrender

    return [Step(pyrender.decode_textures, ())]


def multiply_step(surface: Surface) -> Step:
    """Return the stage that multiplies base colours by what a stage before shows."""
    if surface.diffuse_vertices is None:
        return Step(texture_lookup.multiply_textures, ())
    below = surface.materials, DIFFUSE
    return Step(texture_lookup.multiply_textures_below_highlights, below)


def read_steps(
    kind: int, own: Textures, laid: Maps, geometry: Geometry, placement: Placement
) -> list[Step]:
    """Return the stages that read the textures of a kind, where these are laid."""
    apart = laid.coordinates[kind]
    there = [] if apart is None else lay_steps(own._replace(uv=apart), geometry, placement)
    return [*there, Step(texture_lookup.read_textures, (kind, own))]


def lay_steps(own: Textures, geometry: Geometry, placement: Placement) -> list[Step]:
    """Return the stages that find coordinates and their steps anew."""
    # Other stages have used the memory of the weights since, from which steps are found.
    return [Step(weights.find_weights, (geometry, placement)), *coordinate_steps(own, geometry)]


def map_steps(
    own: Textures, laid: Maps, surface: Surface, geometry: Geometry, placement: Placement
) -> list[Step]:
    """Return the stages that read what lies over normals, facets and occlusion, and apply it."""
    apart = laid.coordinates[textures.NORMAL]
    uv = own.uv if apart is None else apart
    bent = own.table, uv, laid.tangents, laid.factors, placement
    steps = []
    for kind, applied in (
        (textures.NORMAL, Step(maps.bend_normals_by_maps, bent)),
        (textures.METALLIC_ROUGHNESS, Step(maps.scale_facets_by_maps, ())),
        (textures.OCCLUSION, Step(maps.scale_occlusion_by_maps, (laid.factors,))),
    ):
        if kind == textures.METALLIC_ROUGHNESS and surface.microfacets is None:
            continue
        if laid.counts[kind]:
            steps += [*read_steps(kind, own, laid, geometry, placement), applied]
            if laid.coordinates[kind] is not None:
                steps += lay_steps(own, geometry, placement)
    return steps


def through_steps(surface: Surface, geometry: Geometry, placement: Placement) -> list[Step]:
    """Return the stages that find how much light goes through samples, and how thick they are."""
    laid, own = surface.maps, surface.textures
    if surface.through is None:
        return []
    from rasterjit.pipeline.surface import layers as moves

    steps = [Step(moves.fill_rows, (surface.through.rows, rows.TRANSMITTED))]
    for kind, scaled in (
        (textures.TRANSMISSION, (rows.TRANSMITTED, 0, 1)),
        (textures.THICKNESS, (rows.THICKNESS, 1, 1)),
    ):
        if own is None or laid is None or not laid.counts[kind]:
            continue
        steps += read_steps(kind, own, laid, geometry, placement)
        steps.append(Step(moves.scale_rows_by_textures, scaled))
        if laid.coordinates[kind] is not None:
            steps += lay_steps(own, geometry, placement)
    return steps


def coat_steps(surface: Surface, geometry: Geometry, placement: Placement) -> list[Step]:
    """Return the stages that find varnish and its normals, before maps bend those below it."""
    from rasterjit.pipeline.surface import layers as moves

    own, laid, layers = surface.textures, surface.maps, surface.layers
    kept = [Step(moves.copy_rows, (rows.NORMAL_X, rows.COAT_NORMAL_X, 3))]
    kind, steps = textures.CLEARCOAT_NORMAL, [Step(moves.fill_rows, (layers.coats, rows.COAT))]
    if own is None or laid is None or not laid.counts[kind]:
        return steps + kept
    apart = laid.coordinates[kind]
    table = own.table.copy()
    table[:, textures.NORMAL] = table[:, kind]
    uv = own.uv if apart is None else apart
    bent = table, uv, layers.coat_tangents, layers.coat_scales, placement
    steps += [*kept, *read_steps(kind, own, laid, geometry, placement)]
    # The normals of the surface come back when those of its varnish are bent.
    steps += [
        Step(maps.bend_normals_by_maps, bent),
        Step(moves.exchange_rows, (rows.NORMAL_X, rows.COAT_NORMAL_X, 3)),
    ]
    return steps if apart is None else steps + lay_steps(own, geometry, placement)


def layer_steps(surface: Surface, geometry: Geometry, placement: Placement) -> list[Step]:
    """Return the stages that find what lies over surfaces, as factors and textures say."""
    from rasterjit.pipeline.surface import layers as moves

    own, laid, layers = surface.textures, surface.maps, surface.layers
    steps = []
    if layers.sheens is not None:
        steps.append(Step(moves.fill_rows, (layers.sheens, rows.SHEEN_RED)))
    if layers.dielectrics is not None:
        steps.append(Step(moves.fill_rows, (layers.dielectrics, rows.HEAD_ON_RED)))
    for part, kind, scaled in (
        (layers.coats, textures.CLEARCOAT, (rows.COAT, 0, 1)),
        (layers.coats, textures.CLEARCOAT_ROUGHNESS, (rows.COAT_ROUGHNESS, 1, 1)),
        (layers.sheens, textures.SHEEN_COLOR, (rows.SHEEN_RED, 0, 3)),
        (layers.sheens, textures.SHEEN_ROUGHNESS, (rows.SHEEN_ROUGHNESS, 3, 1)),
        (layers.dielectrics, textures.SPECULAR_FACTOR, (rows.EDGE, 3, 1)),
        (layers.dielectrics, textures.SPECULAR_COLOR, (rows.HEAD_ON_RED, 0, 3)),
    ):
        if part is None or own is None or laid is None or not laid.counts[kind]:
            continue
        steps += read_steps(kind, own, laid, geometry, placement)
        steps.append(Step(moves.scale_rows_by_textures, scaled))
        if laid.coordinates[kind] is not None:
            steps += lay_steps(own, geometry, placement)
    return steps


def emission_steps(
    surface: Surface, shown: int, geometry: Geometry, placement: Placement,
    decoding: Sequence[Step] = (),
) -> list[Step]:  # fmt: skip
    """Return the stages that add what surfaces send out to three rows from ``shown`` on."""
    laid, own = surface.maps, surface.textures
    if laid is None:
        return []
    steps = [Step(maps.find_emission, (laid.factors,))]
    if own is not None and laid.counts[textures.EMISSIVE]:
        steps += read_steps(textures.EMISSIVE, own, laid, geometry, placement)
        steps += [*decoding, Step(maps.scale_emission_by_maps, ())]
    return [*steps, Step(maps.show_emission, (shown,))]


def light_steps(look: Look, effects: Sequence[Active], geometry: Geometry) -> list[Step]:
    """Return the stages that turn base colours into seen colours."""
    lighting, viewer = look.lighting, look.viewer
    if lighting.imitated is not None:
        return imitating_steps(look, effects, geometry)
    steps = through_steps(look.surface, geometry, look.placement)
    steps += effect_steps(effects, "rows", look)
    steps.append(Step(lights.show_ambient, (lighting.ambient,)))
    if lighting.renormalizes:
        steps.append(Step(lights.normalize_normals, ()))
    layers = look.surface.layers
    if look.surface.microfacets is not None:
        shown = Step(lights.show_ambient_on_facets, (lighting.ambient, viewer))
        steps += [shown] if layers is None else layered_ambient_steps(look, shown)
    steps += steps_of_lights(look, effects)
    steps += emission_steps(look.surface, rows.OUT_RED, geometry, look.placement)
    if layers is not None:
        from rasterjit.pipeline.lighting import layered

        steps += layered.finishing_steps(layers, viewer, look.surface.through)
    steps += seen_steps(effects, rows.OUT_RED)
    return steps + covering_steps(look, effects)


def imitating_steps(look: Look, effects: Sequence[Active], geometry: Geometry) -> list[Step]:
    """Return the stages that turn base colours into seen colours as pyrender's shader does."""
    from rasterjit.pipeline.lighting import pyrender

    lighting, surface = look.lighting, look.surface
    steps = []
    if lighting.imitated.are_squares is not None:
        squares = lighting.imitated.are_squares, geometry.faces, look.placement
        steps.append(Step(pyrender.place_in_squares, squares))
    if lighting.imitated.faces_viewer is not None:
        turned = lighting.imitated.faces_viewer, look.viewer
        steps.append(Step(pyrender.face_viewer, turned))
    if lighting.imitated.gains is not None:
        steps.append(Step(pyrender.brighten, (lighting.imitated.gains, 0, rows.RED)))
    steps += effect_steps(effects, "rows", look)
    steps += [
        Step(pyrender.show_ambient_on_base, (lighting.ambient,)),
        Step(lights.normalize_normals, ()),
        *imitated_light_steps(look, effects),
    ]
    if surface.maps is not None and surface.maps.counts[textures.OCCLUSION]:
        steps.append(Step(pyrender.dim_by_occlusion, ()))
    emitted = surface, rows.OUT_RED, geometry, look.placement
    steps += emission_steps(*emitted, decoding_steps())
    if surface.vertex_colors is not None:
        steps.append(Step(pyrender.multiply_by_vertex_colors, ()))
    if lighting.imitated.gains is not None:
        steps.append(Step(pyrender.brighten, (lighting.imitated.gains, 3, rows.OUT_RED)))
    return steps + seen_steps(effects, rows.OUT_RED) + effect_steps(effects, "sample", look)


def imitated_light_steps(look: Look, effects: Sequence[Active]) -> list[Step]:
    """Return the stages that add all lights, each dimmed by its map or by effects."""
    from rasterjit.pipeline.lighting import pyrender

    steps, first, dimming = [], 0, acting(effects, "light")
    maps = {row: (view, depths) for row, view, depths in look.lighting.imitated.maps}
    for n in range(len(look.lighting.lights)):
        dimmed = effect_steps(dimming, "light", look, n) if dimming else []
        if n in maps:
            found = look.lighting.lights[n], *maps[n]
            steps += [*add_steps(look, first, n), Step(pyrender.find_shadow, found)]
            steps += [*add_steps(look, n, n + 1), Step(pyrender.let_all_through, ())]
            first = n + 1
        elif dimmed:
            steps += add_steps(look, first, n) + dimmed
            first = n
    return steps + add_steps(look, first, len(look.lighting.lights))


def covering_steps(look: Look, effects: Sequence[Active]) -> list[Step]:
    """Return the stages that lie over lit samples, and what is seen through samples of glass."""
    through = look.surface.through
    if through is None:
        return effect_steps(effects, "sample", look)
    from rasterjit.pipeline.surface import layers as moves

    acts = acting(effects, "sample")
    seen = [one for one in acts if one.effect.sees_through]
    over = effect_steps([one for one in acts if not one.effect.sees_through], "sample", look)
    dark = np.zeros((len(through.rows), 3), np.float32)
    steps = [Step(moves.fill_rows, (dark, moves.MIST_RED))]
    if over:
        # What they show over black is what they show by themselves.
        turned = Step(moves.exchange_rows, (rows.OUT_RED, moves.MIST_RED, 3))
        steps += [turned, *over, turned, *over]
    return steps + effect_steps(seen, "sample", look)


def layered_ambient_steps(look: Look, shown: Step) -> list[Step]:
    """Return the stages that show ambient light on microfacets and what lies over them."""
    from rasterjit.pipeline.lighting import layered

    layers, matt = look.surface.layers, Step(lights.show_ambient, (look.lighting.ambient,))
    steps = layered.starting_steps(layers, Step(lights.normalize_normals, ()))
    return steps + layered.around_steps(layers, look.viewer, shown, matt, is_first=True)


def seen_steps(effects: Sequence[Active], shown: int) -> list[Step]:
    """Return the stages that effects bring where samples show three rows of colours, lit or not."""
    return [step for one in acting(effects, "seen") for step in one.at("seen", shown)]


def effect_steps(effects: Sequence[Active], place: str, look: Look, *arguments: Any) -> list[Step]:
    """Return the stages that effects bring at a place, in the order of the effects."""
    return [step for one in acting(effects, place) for step in one.at(place, look, *arguments)]


def steps_of_lights(look: Look, effects: Sequence[Active]) -> list[Step]:
    """Return the stages that add all lights, each dimmed by effects, and light from all sides."""
    steps, first, dimming = [], 0, acting(effects, "light")
    for n in range(len(look.lighting.lights)) if dimming else ():
        dimmed = effect_steps(dimming, "light", look, n)
        if dimmed:
            # What comes before is dimmed as the light before.
            steps += add_steps(look, first, n) + dimmed
            first = n
    steps += add_steps(look, first, len(look.lighting.lights))
    return steps + effect_steps(effects, "around", look)


def add_steps(look: Look, first: int, end: int) -> list[Step]:
    """Return the stages that add lights ``first`` to ``end``; none if these are none."""
    if first == end:
        return []
    lighting = look.lighting
    if lighting.imitated is not None:
        from rasterjit.pipeline.lighting import pyrender

        own = lighting.lights, first, end, lighting.imitated.taken, look.viewer
        return [Step(pyrender.add_lights_as_pyrender, own)]
    if look.surface.layers is not None:
        return [step for n in range(first, end) for step in layered_light_steps(look, n)]
    return [*shiny_steps(look, first, end), *facet_steps(look, first, end)]


def layered_light_steps(look: Look, n: int) -> list[Step]:
    """Return the stages that add light ``n`` where something lies over microfacets."""
    from rasterjit.pipeline.lighting import layered

    lit_by = look.lighting.lights, n, look.surface.microfacets.parts
    shiny, (facets,) = shiny_steps(look, n, n + 1), facet_steps(look, n, n + 1)
    return layered.light_steps(look.surface.layers, shiny, facets, lit_by)


def shiny_steps(look: Look, first: int, end: int) -> list[Step]:
    """Return the stage that adds lights to what microfacets do not shade."""
    lighting, viewer = look.lighting, look.viewer
    if lighting.highlights is None:
        return [Step(lights.add_diffuse_lights, (lighting.lights, first, end))]
    return [Step(lights.add_shiny_lights, (lighting.lights, first, end, viewer))]


def facet_steps(look: Look, first: int, end: int) -> list[Step]:
    """Return the stage that adds lights to what microfacets shade, if any are there."""
    if look.surface.microfacets is None:
        return []
    parts = look.lighting.lights, first, end, look.viewer, look.surface.microfacets.parts
    return [Step(lights.add_lights_on_facets, parts)]


def shading_steps(
    geometry: Geometry,
    placement: Placement,
    surface: Surface,
    lighting: Lighting | None,
    effects: Sequence[Active],
    viewer: NDArray[np.float32] | None = None,
) -> tuple[list[Step], int]:
    """Return the stages from listed samples to their colours, and the first row of these."""
    seen = placement
    if lighting is not None and lighting.imitated is not None:
        seen = without_sides(placement, surface)
    steps = surface_steps(geometry, seen, surface, lighting, effects)
    if lighting is None:
        return steps + seen_steps(effects, rows.RED), rows.RED
    look = Look(placement, surface, lighting, viewer_of(placement, viewer))
    return steps + light_steps(look, effects, geometry), rows.OUT_RED


def viewer_of(
    placement: Placement, given: NDArray[np.float32] | None = None
) -> NDArray[np.float32]:
    """Return ``placement.toward_viewer`` in float32, in the array given, if one is."""
    return np.float32(placement.toward_viewer) if given is None else given


def light_vertices(
    vertices: tuple[int, int],
    vertex_starts: NDArray[np.int64],
    placement: Placement,
    surface: Surface,
    lighting: Lighting,
    effects: Sequence[Active],
    lit_vertices: NDArray[np.float32],
) -> None:
    """
    Light the vertices of the objects shaded by Gouraud.

    Parameters
    ----------
    vertices : (int, int)
        The first, and one past the last; they may belong to several objects.
    vertex_starts : (O+1,) int64
        Object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``.
    placement, surface, lighting : records
        ``surface.normals`` is present, ``surface.microfacets`` is None; ``surface.face_colors`` has
        no part in it.
    effects : sequence of Active
        Those that act on lights and on light from all sides count, not those that act on pixels.
    lit_vertices : (V, 2, 3) float32
        Written for those vertices: linear colour, for a viewer in front and one behind.
    """
    listed = vertices, vertex_starts
    steps = vertex_steps(listed, placement, surface, lighting, effects, lit_vertices)
    BLOCKS.block[: rows.COUNTS] = 0
    StageList(steps).run(BLOCKS.block, BLOCK)


def vertex_steps(
    listed: tuple[tuple[int, int], NDArray[np.int64]],
    placement: Placement,
    surface: Surface,
    lighting: Lighting,
    effects: Sequence[Active],
    lit_vertices: NDArray[np.float32],
    viewer: NDArray[np.float32] | None = None,
) -> list[Step]:
    """Return the stages that light some vertices, of those that begin with each object."""
    colors = surface.vertex_colors
    if colors is None:
        colors = np.empty((0, 4), np.float32)
    (first, end), vertex_starts = listed
    own = first, end, vertex_starts, placement, surface.materials, colors, surface.normals
    look = Look(placement, surface, lighting, viewer_of(placement, viewer), is_of_vertices=True)
    return [
        Step(list_vertices, own),
        Step(lights.show_ambient, (lighting.ambient,)),
        Step(lights.normalize_normals, ()),
        *steps_of_lights(look, effects),
        Step(write_vertices, (lit_vertices,)),
    ]


def mixing_steps(
    surface: Surface,
    shown: int,
    table: NDArray[np.int32],
    effects: Sequence[Active],
    has_codes: bool,
    target: tuple[NDArray[np.float32], ...],
) -> list[Step]:
    """Return the stages that lay shares of colours, or of their codes, over what is behind."""
    steps: list[Step] = []
    if has_codes:
        steps, shown = pixel_steps(shown, effects)
        steps.append(Step(code_samples, (shown, table)))
    has_alpha = int(surface.alphas is not None)
    return [*steps, Step(mix_shares, (shown, has_alpha, *target))]


def output_steps(
    surface: Surface,
    shown: int,
    table: NDArray[np.int32],
    effects: Sequence[Active],
    linear: NDArray[Any],
    color: NDArray[Any],
) -> list[Step]:
    """Return the stages that write the colours, which begin at row ``shown``, of a band of rows."""
    steps, has_alpha = [], surface.alphas is not None
    if linear.shape[1]:
        steps.append(Step(lights.write_linear, (shown, int(has_alpha), linear)))
    if color.shape[1]:
        mapped, shown = pixel_steps(shown, effects)
        steps += mapped
        write = lights.write_blended_codes if has_alpha else lights.write_opaque_codes
        steps.append(Step(write, (shown, table, color)))
    return steps


def pixel_steps(shown: int, effects: Sequence[Active]) -> tuple[list[Step], int]:
    """Return the stages between the light of three rows and its codes, and where they write it."""
    steps: list[Step] = []
    for one in acting(effects, "pixel"):
        own, shown = one.at("pixel", shown)
        steps += own
    return steps, shown


class Shading:
    """
    The stages that shade the faces of a frame, with all that they read.

    It shades any image of face numbers, in several threads at once.

    Parameters
    ----------
    geometry, placement, surface, lighting : records
        ``lighting`` None: every object shows its own colour.
    effects : sequence of Active
    encoding : str
        What codes show: see ``encode.Encoding``.
    background : (4,) float32, linear
        What `shade` paints where no face is.
    viewer : (4,) float32, optional
        ``placement.toward_viewer``, where both are filled later.
    """

    def __init__(
        self,
        geometry: Geometry,
        placement: Placement,
        surface: Surface,
        lighting: Lighting | None,
        effects: Sequence[Active],
        encoding: Encoding,
        background: NDArray[np.float32],
        viewer: NDArray[np.float32] | None = None,
    ) -> None:
        steps, self._shown = shading_steps(geometry, placement, surface, lighting, effects, viewer)
        self._stages = StageList(steps)
        self._faces, self._face_starts = geometry.faces, placement.face_starts
        self._surface, self._effects, self._table = (
            surface,
            tuple(effects),
            encoding_table(encoding),
        )
        self._painted = background, code_of(background, encoding)
        self._spare: defaultdict[tuple[bool, bool], list[StageList]] = defaultdict(list)

    def shade(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
        background: tuple[NDArray[np.float32], int] | None = None,
    ) -> None:
        """
        Write the colour of some rows of a frame; or of several images of these rows.

        Parameters
        ----------
        faces : (R, W) int32, or (J, R, W)
            The visible faces of these rows, -1 where none is.
        first_row : int
            Where they lie in the frame.
        linear : (R, W, 4) float32, or (R, 0, 4); or (J, R, W, 4), (J, R, 0, 4)
            Written: red, green, blue in linear light, and alpha.
        color : (R, W) uint32, or (R, 0); or (J, R, W), (J, R, 0)
            Written: what is to be shown of it in sRGB codes, RGBA bytes from the lowest up.
        background : ((4,) float32, int), optional
            Where no face is: linear, and as it is shown. Default: that of the frame.
        """
        height = faces.shape[-2]
        if faces.ndim == 3:
            count = height * len(faces)
            faces, color = faces.reshape(count, -1), color.reshape(count, color.shape[2])
            linear = linear.reshape(count, linear.shape[2], 4)
        painted = self._painted if background is None else background
        stages = self._take(faces, first_row, height, painted, linear, color)
        stages.run(BLOCKS.block, BLOCK)
        self._put_back(stages, linear, color)

    def shade_bands(
        self,
        face_id: NDArray[np.int32],
        rows_of_band: int,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
        workers: Workers,
    ) -> None:
        """
        Write the colour of a frame in bands of rows, shared among threads.

        Parameters
        ----------
        face_id : (H, W) int32
        rows_of_band : int
        linear, color : arrays
            As `shade` takes them.
        workers : Workers
        """
        listed = []

        def calls() -> Iterator[Call]:
            for first in range(0, len(face_id), rows_of_band):
                band = slice(first, first + rows_of_band)
                faces, parts = face_id[band], (linear[band], color[band])
                stages = self._take(faces, first, len(faces), self._painted, *parts)
                listed.append(stages)
                yield stages.call()

        count = -(-len(face_id) // rows_of_band)
        workers.call_machine(calls(), count, size_of(BLOCK))
        for stages in listed:
            self._put_back(stages, linear, color)

    def _take(self, *own: Any) -> StageList:
        """Return a list of stages that is not in use, for what `listed` takes."""
        *_, linear, color = own
        try:
            stages = self._spare[bool(linear.shape[1]), bool(color.shape[1])].pop()
        except IndexError:
            return self.listed(*own)
        stages.renew(self._output(*own))
        return stages

    def _put_back(
        self, stages: StageList, linear: NDArray[np.float32], color: NDArray[np.uint32]
    ) -> None:
        # The pictures are not for it to keep.
        stages.let_go()
        self._spare[bool(linear.shape[1]), bool(color.shape[1])].append(stages)

    def listed(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        height: int,
        painted: tuple[NDArray[np.float32], int] | None,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> StageList:
        """Return the stages that `shade` runs, of images one below the other, each so high."""
        painted = painted or self._painted
        return StageList(self._output(faces, first_row, height, painted, linear, color))

    def _output(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        height: int,
        painted: tuple[NDArray[np.float32], int],
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> list[Step | StageList]:
        """Return the stages from listing samples to writing colours, an empty block at hand."""
        steps = self._list(faces, first_row, height, painted, linear, color)
        own = self._surface, self._shown, self._table, self._effects
        return steps + output_steps(*own, linear, color)

    def mix(self, *arguments: Any) -> None:
        """Lay shares of the faces of some rows over what is behind; takes what `mixing` does."""
        self.mixing(*arguments).run(BLOCKS.block, BLOCK)

    def mixing(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        shares: NDArray[np.float32],
        rest: NDArray[np.float32],
        mixed: NDArray[np.float32],
        has_codes: bool,
    ) -> StageList:
        """
        Return the stages that lay shares of the faces of some rows over what is behind.

        Parameters
        ----------
        faces : (J, R, W) int32
            The faces of each pixel, -1 behind the last.
        first_row : int
        shares : (J, R, W) float32
            The share that a face has in its pixel.
        rest : (R, W) float32
            The share that shows no face.
        mixed : (R, 4, W) float32
            Changed: linear colour with straight alpha, or codes of it.
        has_codes : bool
            Whether codes are mixed: the tones of each colour are mapped, it is rounded to codes.
        """
        layers, height, width = faces.shape
        faces = faces.reshape(layers * height, width)
        no_linear = np.empty((len(faces), 0, 4), np.float32)
        no_color = np.empty((len(faces), 0), np.uint32)
        steps = self._list(faces, first_row, height, self._painted, no_linear, no_color)
        own = self._surface, self._shown, self._table, self._effects
        steps += mixing_steps(*own, has_codes, (shares, rest, mixed))
        return StageList(steps)

    def _list(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        height: int,
        painted: tuple[NDArray[np.float32], int],
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> list[Step | StageList]:
        """Return the stages from listing samples to their colours, with an empty block at hand."""
        BLOCKS.block[: rows.COUNTS] = 0
        listed = (
            faces, first_row, height, self._faces, self._face_starts, *painted, linear, color,
        )  # fmt: skip
        return [Step(list_samples, listed), self._stages]
