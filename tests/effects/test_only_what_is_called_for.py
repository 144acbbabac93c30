"""
A scene that uses no effect compiles, loads and runs nothing of any effect, in a process that starts
anew; and one that uses all but one calls for all the others as before, and for nothing of that one.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import switched_off

import rasterjit as rj
from rasterjit.runtime import jit

HERE = Path(__file__).parents[1]

PLAIN = """
import json, sys
import rasterjit as rj
from rasterjit.runtime import store

sys.path.append(sys.argv[1])
from rasterjit.pipeline.passes import shorten_module_name

mesh = rj.Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]])
scene = rj.Scene()
scene.add(mesh)
rj.render(scene, size=(96, 80))
used = *store.USED_KERNELS.loaded, *store.USED_KERNELS.compiled
names = (name.rpartition(".") for name in used)
print(json.dumps(sorted((shorten_module_name(module), name) for module, _, name in names)))
"""

OF_EVERY_SCENE = {
    "attributes", "barycentric_weights", "binning", "gather_samples", "hierarchical_z",
    "light_stages", "pack_arguments", "projection", "scene_placement", "setup", "srgb_encoding",
    "stage_runner", "tile_rasterizer", "triangle_batches",
}  # fmt: skip
"""Kernel files that a lit mesh needs; all others belong to effects, buffers or edges."""


@pytest.fixture(scope="module")
def used():
    """(file, kernel or stage) of all that a plain scene compiled or loaded."""
    if jit.DISABLED or jit.CHECKED:
        pytest.skip("no machine code of ours")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PLAIN, str(HERE)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return [tuple(row) for row in json.loads(done.stdout)]


def test_plain_scene_compiles_and_loads_nothing_of_an_effect(used):
    assert {("tile_rasterizer", "draw_tiles"), ("gather_samples", "list_samples")} <= {*used}
    assert [row for row in used if row[0] not in OF_EVERY_SCENE] == []


def test_plain_scene_has_each_kernel_in_one_form(used):
    assert len(used) == len({*used})


THROUGH = {"transmission.downsample", "transmission.remove_transmitted", "transmission.transmit"}
MAPS = {
    "material_maps.apply_normal_maps", "material_maps.apply_emission_maps",
    "material_maps.apply_metallic_roughness_maps", "material_maps.apply_occlusion_maps",
}  # fmt: skip
FILTERED = {
    "prefilter_stage.add_ring", "prefilter_stage.average_columns", "prefilter_stage.project_rows",
}  # fmt: skip
TESTED = {"alpha_test.find_alphas", "alpha_test.queue_triangle"}
BELOW = "texture_lookup.multiply_textures_below_highlights"
FACES_BELOW = "attributes.multiply_face_colors_below_highlights"
DULL = "light_stages.add_diffuse_lights"
"""Lights vertices once more, for the part of their colour that textures multiply."""
LEANING = "sheen.bend_normals"
"""For light of an environment alone."""
VARNISH = {"clearcoat.blend_clearcoats"}
FIBRES = {"sheen.add_sheen_light", "sheen.add_ambient_sheen", LEANING}
MIRRORS = {"dielectrics.add_dielectric_light", "dielectrics.add_dielectric_ambient"}
SCALED = "layer_rows.multiply_rows_by_textures"

GONE = {
    "textures": {
        *MAPS, "uv_derivatives.interpolate_uv", "uv_derivatives.find_uv_steps", BELOW,
        FACES_BELOW, "texture_lookup.read_textures", DULL, SCALED,
    },
    # Numbers of the textures, not code.
    "texture transforms": set(),
    "anisotropic filter": set(),
    "maps and emission": {
        *MAPS, "material_maps.fill_emission", "material_maps.add_emission", SCALED,
    },
    "normal maps": {"material_maps.apply_normal_maps"},
    "alpha masks": TESTED,
    # Holes are where the colours of vertices say so.
    "vertex colors": {"attributes.interpolate_vertex_colors", *TESTED},
    "face colors": {FACES_BELOW},
    "scalar fields": {
        "isolines.draw_isolines", "scalar_colors.multiply_colormap_alphas",
        "scalar_colors.apply_colormaps",
    },
    "highlights": {"light_stages.add_blinn_phong_lights", BELOW, FACES_BELOW},
    # Facets alone mirror what is around.
    "microfacets": {
        "attributes.fill_microfacets", "environment.add_reflections",
        "light_stages.add_microfacet_lights", "light_stages.write_microfacet_ambient",
        "material_maps.apply_metallic_roughness_maps", *VARNISH, *FIBRES, *MIRRORS, SCALED,
        *THROUGH,
        "layer_rows.copy_rows", "layer_rows.swap_rows", "layer_rows.fill_rows",
    },
    "clearcoat": VARNISH,
    "sheen": FIBRES,
    "specular and ior": MIRRORS,
    "Gouraud": {
        "attributes.interpolate_lit_vertices", BELOW, FACES_BELOW, DULL, "gouraud.gather_vertices",
        "gouraud.store_lit_vertices",
    },
    "flat": {"attributes.find_centroids"},
    "shadows": {
        "receivers.find_depth_ranges", "receivers.find_receivers", "receivers.offset_turned_away",
        "shadows.filter_pcf", "shadows.project_to_map",
    },
    # What is only seen is not filtered.
    "environment light": {
        "environment.add_reflections", "environment.add_sky", LEANING, *FILTERED,
    },
    "environment background": {"environment.show_environment"},
    "environment": {
        "environment.add_reflections", "environment.add_sky",
        "environment.show_environment", LEANING, *FILTERED,
    },
    "eye-dome lighting": {
        "eye_dome.darken_samples", "eye_dome.compute_shading", "eye_dome.compute_nearness",
    },
    "fog": {"fog.apply_exp_fog"},
    "transmission": THROUGH,
    "tone mapping": {"tone_map.map_over_color"},
    "ambient occlusion": {
        "ambient_occlusion.find_occlusion", "ambient_occlusion.trace_horizons",
        "ambient_occlusion.occlude_samples", "ambient_occlusion.smooth_occlusion",
    },
    "vignette": {"vignette.darken_rows"},
    "outline": {"outline.find_edges", "outline.dilate_marks"},
    "section": {"cap_triangulation.fill_outlines", "cap_triangulation.find_contacts"},
    "wireframe": {
        "wireframe.draw_edges", "wireframe.fill_slack", "wireframe.find_pixels",
        "wireframe.project_edges",
    },
    # Texts are laid over the picture in NumPy.
    "labels": set(),
    "transparency": {
        "attributes.find_alphas", "compositing.finish_sums", "compositing.composite_under",
        "compositing.start_sums", "srgb_encoding.encode_rows",
        "scalar_colors.multiply_colormap_alphas", "a_buffer.find_layers",
        "a_buffer.split_lists", "tone_map.map_over_color",
    },
    "anti-aliasing": {
        "compositing.list_faces", "compositing.mix_samples", "coverage_resolve.finish_light",
        "coverage_resolve.accumulate_layers", "coverage_resolve.list_coverage",
    },
}  # fmt: skip
"""Kernels and stages that a scene of all effects calls for, and does not without each."""

INSTEAD = {
    "textures": {"attributes.multiply_face_colors", "texture_lookup.multiply_textures"},
    "highlights": {"attributes.multiply_face_colors", "texture_lookup.multiply_textures"},
    "Gouraud": {"attributes.multiply_face_colors", "texture_lookup.multiply_textures"},
    "transparency": {"light_stages.write_opaque_codes", "tone_map.map_samples"},
    "vertex colors": {"attributes.fill_base_colors"},
}
"""Simpler ones that do in their place."""


@pytest.fixture(scope="module")
def told():
    """What frames call for, by the effect that is absent."""
    return switched_off.told_with_and_without()


def test_every_effect_is_in_the_full_scene(told):
    plan = rj.explain(
        switched_off.full_scene(), switched_off.CAMERA, rj.Quality(samples=4),
        size=switched_off.SIZE, outputs=("color", "linear"),
    )  # fmt: skip
    absent = {effect.name for effect in plan.effects if not effect.used}
    # An image is no part of a scene; hatchings and section lines have the kernels of outlines and
    # wireframes. Those of hidden lines are tested beside them.
    assert absent == {
        "single-sided objects", "background image", "diagnostics", "section hatching",
        "section lines", "hidden lines",
    }  # fmt: skip
    assert told.keys() - {""} == GONE.keys() == {*switched_off.WITHOUT, "anti-aliasing"}, (
        "add a row to GONE, and one to WITHOUT in tests/support/switched_off.py"
    )


@pytest.mark.parametrize("name", GONE)
def test_without_an_effect_its_kernels_and_stages_alone_are_gone(told, name):
    # Where faces blend, what is without is looked at with one sample.
    before, after = told["anti-aliasing" if name == "transparency" else ""], told[name]
    assert before - after == GONE[name]
    assert after - before == INSTEAD.get(name, set())
