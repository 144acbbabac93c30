"""
A small glTF file for each extension in the table of docs/guides/gltf.md, and what it must load as.

``python tests/io/gltf_extension_files.py FOLDER`` writes them, each under its extension's name.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import ktx2_samples
import numpy as np
from gltf_drafts import CORNERS, NORMAL, POSITION, Draft, quad
from PIL import Image

import rasterjit as rj


class File(NamedTuple):
    """How a file is made, and what its scene must be."""

    make: Callable[[], Draft]
    check: Callable[[rj.Scene], bool] = lambda scene: len(scene.nodes) == 1


def material_of(scene):
    """Return the material of the first node."""
    return scene.nodes[0].mesh.material


def texture_of(scene):
    """Return the texture of the first node."""
    return material_of(scene).base_color_texture


def has(scene, **fields):
    """Tell whether the material of the first node has these fields, as one that is lit."""
    material = material_of(scene)
    found = {name: getattr(material, name) for name in fields}
    return material.shading == "pbr" and found == fields


def plain(**root):
    """Return a file that shows a square, with something at the top of its header."""
    draft = Draft()
    draft.show(draft.mesh(quad(), material=draft.add("materials")))
    draft.header.update(root)
    return draft


def in_material(name, values, **material):
    """Return a file whose material, no metal, has an extension."""
    material.setdefault("pbrMetallicRoughness", {"metallicFactor": 0.0})
    draft = Draft().use(name)
    number = draft.add("materials", **material, extensions={name: values})
    draft.show(draft.mesh(quad(), material=number))
    return draft


def in_node(name, values, **node):
    """Return a file whose node has an extension."""
    draft = Draft().use(name)
    draft.show(draft.mesh(quad()), **node, extensions={name: values})
    return draft


def in_primitive(name, values, **primitive):
    """Return a file whose primitive has an extension."""
    draft = Draft().use(name)
    draft.show(draft.mesh(quad(), **primitive, extensions={name: values}))
    return draft


def at_the_top(name, values):
    """Return a file that has an extension for the whole."""
    return plain(extensions={name: values}).use(name)


def picture(kind, **options):
    """Return a file of the four colours."""
    stream = io.BytesIO()
    Image.fromarray(ktx2_samples.COLORS).save(stream, kind, **options)
    return stream.getvalue()


def in_texture(name, content):
    """Return a file whose texture has another picture, and none else."""
    draft = Draft().use(name, required=True)
    source = draft.picture(content, "image/any")
    return draft.textured(extensions={name: {"source": source}})


def shows_the_picture(scene):
    """Tell whether the texture has the four colours."""
    wanted = rj.Texture(ktx2_samples.COLORS).levels[0]
    return bool(np.abs(texture_of(scene).levels[0] - wanted).max() < 0.03)


def draco():
    """Return a file of a packed square."""
    import DracoPy

    stream = DracoPy.encode(POSITION, CORNERS.reshape(-1, 3).astype(np.uint32), quantization_bits=8)
    (one,) = DracoPy.decode(stream).attributes
    draft = Draft().use("KHR_draco_mesh_compression", required=True)
    packed = {"bufferView": draft.view(stream), "attributes": {"POSITION": one["unique_id"]}}
    draft.show(
        draft.add(
            "meshes",
            primitives=[
                {
                    "attributes": {"POSITION": draft.say(POSITION)},
                    "indices": draft.say(CORNERS),
                    "extensions": {"KHR_draco_mesh_compression": packed},
                }
            ],
        )
    )
    return draft


def meshopt(name):
    """Return a file of a packed square."""
    import meshopt

    draft = Draft().use(name, required=True)
    draft.header["buffers"] = [{}, {"byteLength": 48, "extensions": {name: {"fallback": True}}}]
    stored = draft.store(meshopt.encode_gltf_buffer(POSITION, "ATTRIBUTES", name.startswith("KHR")))
    packed = {**stored, "count": 4, "byteStride": 12, "mode": "ATTRIBUTES"}
    view = draft.add("bufferViews", buffer=1, byteLength=48, extensions={name: packed})
    draft.show(draft.mesh({"POSITION": draft.say(POSITION, bufferView=view), "NORMAL": NORMAL}))
    return draft


def quantised():
    """Return a file of a square whose positions are bytes."""
    draft = Draft().use("KHR_mesh_quantization", required=True)
    points = draft.accessor(np.round(POSITION * 127).astype(np.int8), normalized=True)
    draft.show(draft.mesh({"POSITION": points}))
    return draft


def instanced():
    """Return a file of three squares."""
    draft = Draft()
    places = draft.accessor(np.float32([[0, 0, 0], [3, 0, 0], [6, 0, 0]]))
    name = "EXT_mesh_gpu_instancing"
    draft.show(draft.mesh(quad()), extensions={name: {"attributes": {"TRANSLATION": places}}})
    return draft.use(name, required=True)


def lit():
    """Return a file with a light."""
    draft = at_the_top("KHR_lights_punctual", {"lights": [{"type": "point", "intensity": 9.0}]})
    draft.header["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    return draft


def transformed():
    """Return a file whose texture is laid twice."""
    draft = Draft().use("KHR_texture_transform")
    draft.textured(source=draft.picture(picture("PNG")))
    use = draft.header["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    use["extensions"] = {"KHR_texture_transform": {"scale": [2.0, 2.0]}}
    return draft


def hidden():
    """Return a file of two squares, one of which is not shown."""
    draft = in_node("KHR_node_visibility", {"visible": False})
    draft.show(0)
    return draft


def glass():
    """Return a file of a body of coloured glass."""
    name = "KHR_materials_volume"
    draft = in_material(name, {"thicknessFactor": 0.5, "attenuationDistance": 0.25,
                               "attenuationColor": [1.0, 0.5, 0.25]})  # fmt: skip
    extensions = draft.header["materials"][0]["extensions"]
    extensions["KHR_materials_transmission"] = {"transmissionFactor": 1.0}
    return draft.use("KHR_materials_transmission")


def with_variants():
    """Return a file of a square that is red or, as a variant, blue."""
    name = "KHR_materials_variants"
    draft = at_the_top(name, {"variants": [{"name": "blue"}]})
    draft.header["materials"][0]["pbrMetallicRoughness"] = {"baseColorFactor": [1, 0, 0, 1]}
    blue = draft.add("materials", pbrMetallicRoughness={"baseColorFactor": [0, 0, 1, 1]})
    (primitive,) = draft.header["meshes"][0]["primitives"]
    primitive["extensions"] = {name: {"mappings": [{"material": blue, "variants": [0]}]}}
    return draft


def shows_its_variant(scene):
    """Tell whether the square is red without a variant, and blue in the one that there is."""
    shown = []
    for name in (None, *scene.variants):
        scene.variant = name
        shown.append(material_of(scene).base_color)
    scene.variant = None
    return shown == [(1, 0, 0, 1), (0, 0, 1, 1)]


def splats():
    """Return a file of splats."""
    name = "KHR_gaussian_splatting"
    draft = Draft().use(name)
    attributes = {"POSITION": POSITION, f"{name}:SCALE": np.ones((4, 3), np.float32)}
    draft.show(draft.mesh(attributes, None, mode=0, extensions={name: {"kernel": "ellipse"}}))
    return draft


def moved_by_pointer():
    """Return a file with an animation of a colour."""
    draft = plain()
    name = "KHR_animation_pointer"
    where = {"pointer": "/materials/0/pbrMetallicRoughness/baseColorFactor"}
    times = draft.accessor(np.float32([0, 1]))
    values = draft.accessor(np.float32([[1, 0, 0, 1], [0, 0, 1, 1]]))
    target = {"path": "pointer", "extensions": {name: where}}
    channels = [{"sampler": 0, "target": target}]
    draft.add("animations", channels=channels, samplers=[{"input": times, "output": values}])
    return draft.use(name)


SPECULAR_GLOSSINESS = {"diffuseFactor": [0.5, 0.25, 0.125, 1.0], "glossinessFactor": 0.25}

FILES = {
    # Drawn.
    "KHR_draco_mesh_compression": File(draco),
    "KHR_lights_punctual": File(lit, lambda scene: len(scene.lights) == 1),
    "KHR_materials_clearcoat": File(
        lambda: in_material("KHR_materials_clearcoat",
                            {"clearcoatFactor": 0.75, "clearcoatRoughnessFactor": 0.25}),
        lambda scene: has(scene, clearcoat=0.75, clearcoat_roughness=0.25)),
    "KHR_materials_emissive_strength": File(
        lambda: in_material("KHR_materials_emissive_strength", {"emissiveStrength": 4.0},
                            emissiveFactor=[1.0, 0.5, 0.0]),
        lambda scene: tuple(material_of(scene).emissive) == (4.0, 2.0, 0.0)),
    "KHR_materials_ior": File(
        lambda: in_material("KHR_materials_ior", {"ior": 1.25}),
        lambda scene: has(scene, ior=1.25)),
    "KHR_materials_sheen": File(
        lambda: in_material("KHR_materials_sheen", {"sheenColorFactor": [1.0, 0.5, 0.25],
                                                    "sheenRoughnessFactor": 0.5}),
        lambda scene: has(scene, sheen_color=(1.0, 0.5, 0.25), sheen_roughness=0.5)),
    "KHR_materials_specular": File(
        lambda: in_material("KHR_materials_specular", {"specularFactor": 0.5,
                                                       "specularColorFactor": [2.0, 1.0, 0.5]}),
        lambda scene: has(scene, specular_factor=0.5, specular_color=(2.0, 1.0, 0.5))),
    "KHR_materials_transmission": File(
        lambda: in_material("KHR_materials_transmission", {"transmissionFactor": 0.5}),
        lambda scene: has(scene, transmission=0.5)),
    "KHR_materials_variants": File(with_variants, shows_its_variant),
    "KHR_materials_volume": File(
        glass,
        lambda scene: has(scene, thickness=0.5, attenuation_distance=0.25,
                          attenuation_color=(1.0, 0.5, 0.25))),
    "KHR_materials_unlit": File(
        lambda: in_material("KHR_materials_unlit", {}),
        lambda scene: material_of(scene).shading == "unlit"),
    "KHR_mesh_quantization": File(
        quantised, lambda scene: float(np.abs(scene.nodes[0].mesh.vertices).max()) == 1.0),
    "KHR_meshopt_compression": File(lambda: meshopt("KHR_meshopt_compression")),
    "KHR_node_visibility": File(hidden),
    "KHR_texture_basisu": File(
        lambda: in_texture("KHR_texture_basisu", ktx2_samples.UASTC), shows_the_picture),
    "KHR_texture_transform": File(
        transformed, lambda scene: texture_of(scene).scale == (2.0, 2.0)),
    "EXT_mesh_gpu_instancing": File(instanced, lambda scene: len(scene.nodes) == 3),
    "EXT_meshopt_compression": File(lambda: meshopt("EXT_meshopt_compression")),
    "EXT_texture_avif": File(
        lambda: in_texture("EXT_texture_avif", picture("AVIF", quality=100, subsampling="4:4:4")),
        shows_the_picture),
    "EXT_texture_webp": File(
        lambda: in_texture("EXT_texture_webp", picture("WEBP", lossless=True)), shows_the_picture),
    "MSFT_texture_dds": File(
        lambda: in_texture("MSFT_texture_dds", picture("DDS")), shows_the_picture),
    # Drawn in part.
    "KHR_materials_pbrSpecularGlossiness": File(
        lambda: in_material("KHR_materials_pbrSpecularGlossiness", SPECULAR_GLOSSINESS),
        lambda scene: material_of(scene).roughness == 0.75),
    # Nothing to show.
    "KHR_collision_shapes": File(lambda: at_the_top("KHR_collision_shapes", {"shapes": []})),
    "KHR_node_hoverability": File(lambda: in_node("KHR_node_hoverability", {"hoverable": True})),
    "KHR_node_selectability": File(lambda: in_node("KHR_node_selectability", {})),
    "KHR_physics_rigid_bodies": File(lambda: in_node("KHR_physics_rigid_bodies", {"motion": {}})),
    "KHR_xmp": File(lambda: at_the_top("KHR_xmp", {"packets": []})),
    "KHR_xmp_json_ld": File(lambda: at_the_top("KHR_xmp_json_ld", {"packets": []})),
    "EXT_instance_features": File(lambda: in_node("EXT_instance_features", {"featureIds": []})),
    "EXT_mesh_features": File(lambda: in_primitive("EXT_mesh_features", {"featureIds": []})),
    "EXT_mesh_manifold": File(lambda: in_primitive("EXT_mesh_manifold", {"manifoldPrimitive": {}})),
    "EXT_structural_metadata": File(lambda: at_the_top("EXT_structural_metadata", {"schema": {}})),
    "AGI_stk_metadata": File(lambda: at_the_top("AGI_stk_metadata", {})),
    "FB_geometry_metadata": File(lambda: at_the_top("FB_geometry_metadata", {})),
    "GODOT_single_root": File(lambda: plain().use("GODOT_single_root")),
    "MSFT_lod": File(lambda: in_node("MSFT_lod", {"ids": []})),
    # Left out.
    "KHR_accessor_float64": File(lambda: plain().use("KHR_accessor_float64")),
    "KHR_animation_pointer": File(moved_by_pointer),
    "KHR_audio_emitter": File(lambda: at_the_top("KHR_audio_emitter", {"emitters": []})),
    "KHR_gaussian_splatting": File(
        splats, lambda scene: isinstance(scene.nodes[0].mesh, rj.Points)),
    "KHR_interactivity": File(lambda: at_the_top("KHR_interactivity", {"graphs": []})),
    "KHR_materials_anisotropy": File(
        lambda: in_material("KHR_materials_anisotropy", {"anisotropyStrength": 0.6})),
    "KHR_materials_diffuse_transmission": File(
        lambda: in_material("KHR_materials_diffuse_transmission",
                            {"diffuseTransmissionFactor": 0.5})),
    "KHR_materials_dispersion": File(
        lambda: in_material("KHR_materials_dispersion", {"dispersion": 0.1})),
    "KHR_materials_iridescence": File(
        lambda: in_material("KHR_materials_iridescence", {"iridescenceFactor": 1.0})),
    "KHR_materials_volume_scatter": File(
        lambda: in_material("KHR_materials_volume_scatter", {"multiscatterColor": [1, 0, 0]})),
    "KHR_techniques_webgl": File(
        lambda: in_material("KHR_techniques_webgl", {"technique": 0})),
    "EXT_lights_ies": File(lambda: at_the_top("EXT_lights_ies", {"lights": []})),
    "EXT_lights_image_based": File(lambda: at_the_top("EXT_lights_image_based", {"lights": []})),
    "EXT_mesh_primitive_restart": File(lambda: plain().use("EXT_mesh_primitive_restart")),
    "ADOBE_materials_clearcoat_specular": File(
        lambda: in_material("ADOBE_materials_clearcoat_specular", {"clearcoatIor": 1.6})),
    "ADOBE_materials_clearcoat_tint": File(
        lambda: in_material("ADOBE_materials_clearcoat_tint", {})),
    "ADOBE_materials_thin_transparency": File(
        lambda: in_material("ADOBE_materials_thin_transparency", {"transmissionFactor": 1.0})),
    "AGI_articulations": File(lambda: at_the_top("AGI_articulations", {"articulations": []})),
    "CESIUM_RTC": File(lambda: at_the_top("CESIUM_RTC", {"center": [6378137.0, 0.0, 0.0]})),
    "CESIUM_primitive_outline": File(
        lambda: in_primitive("CESIUM_primitive_outline", {"indices": 0})),
    "MPEG_media": File(lambda: at_the_top("MPEG_media", {"media": []})),
    "MSFT_packing_normalRoughnessMetallic": File(
        lambda: in_material("MSFT_packing_normalRoughnessMetallic", {})),
    "MSFT_packing_occlusionRoughnessMetallic": File(
        lambda: in_material("MSFT_packing_occlusionRoughnessMetallic", {})),
    "NV_materials_mdl": File(lambda: at_the_top("NV_materials_mdl", {})),
    "VRMC_vrm": File(lambda: at_the_top("VRMC_vrm", {"specVersion": "1.0"})),
}  # fmt: skip
"""A file for each extension: a further one is one line here, and a row in docs/guides/gltf.md."""


if __name__ == "__main__":
    for name, file in FILES.items():
        file.make().save(Path(sys.argv[1]) / f"{name}.glb")
