"""Derive the requirements of shading from a picture's materials, lights and layers."""

from __future__ import annotations

from rasterjit.pipeline.passes import PyrenderNeeds, ShadingNeeds
from rasterjit.pipeline.records import Lighting, PyrenderObjects
from rasterjit.survey.facts import Facts
from rasterjit.survey.transparency import PixelLayers

SMOOTH_AT_PIXELS = frozenset(("phong", "pbr"))


def derive_shading_needs(
    facts: Facts, layers: PixelLayers | None, lighting: Lighting | None
) -> ShadingNeeds:
    """Return the requirements that select the shading passes of a picture."""
    contents, seen, in_float32 = facts.counts, facts.visible, facts.float32_objects
    samples_beside = layers is not None and layers.samples != 1 and not layers.at_centers
    return ShadingNeeds(
        lights=None if lighting is None else len(lighting.lights),
        highlights=lighting is not None and lighting.highlights is not None,
        renormalizes=lighting is not None and bool(lighting.renormalizes),
        pyrender=None if lighting is None else _derive_pyrender_needs(lighting.pyrender),
        flat="flat" in contents.shadings,
        smooth=not SMOOTH_AT_PIXELS.isdisjoint(contents.shadings),
        faceted=not SMOOTH_AT_PIXELS.issuperset(contents.shadings),
        normals=facts.shades_smoothly,
        gouraud=facts.needs_gouraud,
        diffuse_apart=facts.needs_diffuse_light,
        vertex_colors=contents.vertex_colored > 0,
        face_colors=contents.face_colored > 0,
        some_in_float32=in_float32 is not None,
        all_in_float32=in_float32 is not None and bool(in_float32.all()),
        some_coded=facts.reads_srgb8_textures,
        all_coded=facts.reads_srgb8_textures
        and seen.coded == seen.objects
        and "linear" not in facts.outputs,
        fields=facts.needs_scalar_fields,
        contours=contents.contoured > 0,
        textures=facts.needs_textures,
        mipmapped=contents.mipped > 0,
        kinds=tuple(n for n, count in enumerate(contents.textured.values()) if count),
        separate_uv_kinds=tuple(n for n, own in enumerate(facts.inventory.kinds_apart) if own),
        maps=facts.needs_material_maps,
        alphas=layers is not None and layers.has_blended,
        # `Shading` asks the viewport that it is given.
        on_faces=not samples_beside,
        microfacets=facts.needs_microfacets,
        points=facts.shades_points,
        transmission=facts.transmits,
        layers=facts.needs_material_layers,
        coats=facts.needs_material_layers and seen.coated > 0,
        sheens=facts.needs_material_layers and seen.with_sheen > 0,
        dielectrics=facts.needs_material_layers and seen.custom_specular > 0,
    )


def _derive_pyrender_needs(objects: PyrenderObjects | None) -> PyrenderNeeds | None:
    """Return the requirements of pyrender's shader."""
    if objects is None:
        return None
    return PyrenderNeeds(
        faces_viewer=objects.faces_viewer is not None,
        has_squares=objects.are_squares is not None,
        has_gains=objects.gains is not None,
        mapped=tuple(row for row, *_ in objects.maps),
    )
