"""glTF files that are odd, incomplete or damaged: read as far as they go, the rest named."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
from moving_models import arm
from PIL import Image
from sample_models import QUAD_FACES, Model, blank_png, encode_png, quad

import rasterjit as rj
from rasterjit.cli.options import SceneOptions
from rasterjit.io.gltf.file import GltfFile
from rasterjit.io.gltf.meshes_materials import FAN, STRIP, TRIANGLES, list_triangles
from rasterjit.io.gltf.scene import parent_from_node
from rasterjit.io.load_warnings import LeftOut, LoadWarning, MeshFileError
from rasterjit.io.resources import Resources

GREY = np.full((2, 2, 3), 128, np.uint8)


def textured(**fields):
    """Return a model of one textured rectangle."""
    model = Model()
    texture = model.texture(GREY)
    model.add(quad(-1, -1, 1, 1), model.material("wall", baseColorTexture=texture, **fields))
    return model


def load_with(path, *said):
    """Load a file that warns once, with all of these."""
    with pytest.warns(LoadWarning) as warned:
        scene = rj.load(path)
    assert len(warned) == 1
    for part in said:
        assert part in str(warned[0].message)
    return scene


def only_material(scene):
    (node,) = scene.nodes
    return node.mesh.material


def document(model):
    return model.glb._document


# --- textures -------------------------------------------------------------------------------------


def empty_png():
    """Return a picture of no pixels."""
    whole = encode_png(np.zeros((1, 1, 3), np.uint8))
    return whole[:16] + b"\0\0\0\0" + whole[20:]


BAD_PICTURES = {
    "damaged": lambda: encode_png(GREY)[:50],
    "no picture": lambda: b"GIF, or not",
    "nothing": bytes,
    "KTX2": lambda: b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(64),
    "empty": empty_png,
    "huge": lambda: blank_png(30_000, 30_000, bits=1),
}


@pytest.mark.parametrize("kind", BAD_PICTURES)
@pytest.mark.parametrize("field", ["baseColorTexture", "normalTexture", "emissiveTexture"])
def test_a_picture_that_cannot_be_used_is_left_out_by_name(tmp_path, kind, field):
    model = Model()
    index = model.glb.add_texture(BAD_PICTURES[kind](), "bad")
    material = model.material("wall", **{field: {"index": index}}, metallicFactor=0.25)
    model.add(quad(-1, -1, 1, 1), material)
    name = {"baseColorTexture": "base_color", "normalTexture": "normal"}.get(field, "emissive")
    scene = load_with(
        model.save(tmp_path / "a.glb"), f"{name}_texture of material 'wall' that cannot be read: "
    )
    with pytest.warns(LoadWarning, match=r"its picture, image 0, 'bad': ") as said:
        rj.load(tmp_path / "a.glb")
    assert " at 0x" not in str(said[0].message)
    assert only_material(scene).metallic == 0.25
    assert not any(only_material(scene).textures_read())


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda d: d["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"].update(index=7),
         "the file has no texture 7 (it has "),
        (lambda d: d["textures"][0].update(source=9), "the file has no image 9 (it has "),
        (lambda d: d["textures"][0].update(sampler=9), "the file has no sampler 9 (it has "),
        (lambda d: d["textures"][0].pop("source"), "no source"),
        (lambda d: d["images"][0].update(bufferView=99), "the file has no buffer view 99 (it has "),
        (lambda d: d.update(images=[{"uri": "gone.png"}]),
         "its picture, image 0, 'gone.png': it is missing"),
        (lambda d: d["images"][0].pop("bufferView"), "its picture, image 0, 'picture': uri is mis"),
        (lambda d: d.update(images=[{"uri": "https://example.com/a.png"}]), "is not a file beside"),
        (lambda d: d["textures"].__setitem__(0, {"extensions": {"KHR_texture_basisu": {}}}),
         "its picture is given by KHR_texture_basisu"),
        (lambda d: d["materials"][0]["pbrMetallicRoughness"].update(baseColorTexture=[1]),
         "baseColorTexture must be an object, got [1]"),
    ],
)  # fmt: skip
def test_a_texture_reference_that_leads_nowhere_is_named(tmp_path, change, reason):
    model = textured()
    change(document(model))
    scene = load_with(
        model.save(tmp_path / "a.glb"), "base_color_texture of material 'wall'", reason
    )
    assert only_material(scene).base_color_texture is None


def test_a_picture_in_a_file_of_its_own_is_read(tmp_path):
    model = textured()
    (tmp_path / "a b.png").write_bytes(encode_png(GREY))
    document(model)["images"] = [{"uri": "a%20b.png"}]
    assert only_material(rj.load(model.save(tmp_path / "a.glb"))).base_color_texture.size == (2, 2)


def test_a_webp_picture_is_read_where_there_is_another_to_fall_back_on(tmp_path):
    stream = io.BytesIO()
    Image.fromarray(np.zeros((5, 7, 3), np.uint8)).save(stream, "WEBP", lossless=True)
    model = textured()
    source = model.glb.add_image(stream.getvalue(), "webp")
    document(model)["textures"][0]["extensions"] = {"EXT_texture_webp": {"source": source}}
    document(model)["extensionsUsed"] = ["EXT_texture_webp"]
    assert only_material(rj.load(model.save(tmp_path / "a.glb"))).base_color_texture.size == (7, 5)


# --- materials ------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [5, -1, "0", 0.5])
def test_a_material_reference_that_leads_nowhere_is_named(tmp_path, number):
    model = textured()
    document(model)["meshes"][0]["primitives"][0]["material"] = number
    scene = load_with(
        model.save(tmp_path / "a.glb"),
        f"reference to material {json.dumps(number)}, which the file has not (1)",
    )
    assert only_material(scene) == rj.Material()


@pytest.mark.parametrize(
    "fields",
    [
        {"roughnessFactor": "rough"}, {"baseColorFactor": [1, 0]}, {"emissiveFactor": [None] * 3},
        {"normalTexture": 3}, {"metallicFactor": float("nan")}, {"baseColorFactor": 1.0},
        {"occlusionTexture": "dark"}, {"alphaCutoff": True},
    ],
)  # fmt: skip
def test_a_damaged_material_is_named_with_the_field(tmp_path, fields):
    model = textured(**fields)
    (field,) = fields
    scene = load_with(
        model.save(tmp_path / "a.glb"), f"material 'wall', which is damaged: {field} must be "
    )
    assert len(scene.nodes) == 1


def test_factors_out_of_range_are_held_in_it(tmp_path):
    model = textured(
        metallicFactor=7, roughnessFactor=-2, baseColorFactor=[2, -1, 0.5, 3],
        emissiveFactor=[9, -1, 0], alphaMode="MASK", alphaCutoff=-3,
    )  # fmt: skip
    material = only_material(rj.load(model.save(tmp_path / "a.glb")))
    assert (material.metallic, material.roughness) == (1.0, 0.0)
    assert material.base_color == (1.0, 0.0, 0.5, 1.0)
    assert material.emissive == (1.0, 0.0, 0.0)
    assert material.alpha_cutoff == 0.0


def test_specular_glossiness_becomes_the_nearest_dielectric_and_says_so(tmp_path):
    model = Model()
    texture = model.texture(GREY)
    glossy = {
        "diffuseFactor": [0.5, 0.25, 1, 1],
        "glossinessFactor": 0.75,
        "diffuseTexture": texture,
    }
    extensions = {"KHR_materials_pbrSpecularGlossiness": glossy}
    model.add(quad(-1, -1, 1, 1), model.material("old", extensions=extensions))
    material = only_material(
        load_with(model.save(tmp_path / "a.glb"), "specular colour of material 'old' (1)")
    )
    assert (material.metallic, material.roughness) == (0.0, 0.25)
    assert material.base_color == (0.5, 0.25, 1.0, 1.0)
    assert material.base_color_texture is not None


def test_what_is_not_read_is_named_once(tmp_path):
    model = textured(extensions={"KHR_materials_iridescence": {"iridescenceFactor": 1}})
    document(model).update(animations=[{}])
    document(model)["extensionsUsed"] += ["KHR_materials_dispersion", "KHR_materials_iridescence"]
    document(model)["meshes"][0]["primitives"][0]["targets"] = [{"COLOR_0": 0}, {}, {}]
    load_with(
        model.save(tmp_path / "a.glb"), "extension KHR_materials_iridescence (1)",
        "extension KHR_materials_dispersion (1)",
        "animation '0', which has no channel of use (1)", "COLOR_0 of morph targets (1)",
    )  # fmt: skip


@pytest.fixture
def bare(tmp_path):
    """Return a scene of a rectangle without a material."""
    model = Model()
    model.add(quad(-1, -1, 1, 1), 0)
    del document(model)["meshes"][0]["primitives"][0]["material"]
    return rj.load(model.save(tmp_path / "a.glb"))


def color_of(scene):
    camera = rj.OrthographicCamera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0))
    return rj.render(scene, camera, size=(3, 3), threads=1).color


@pytest.mark.parametrize("sky", [None, rj.Environment.constant((0.5, 0.3, 0.1))])
def test_a_primitive_without_a_material_is_gltfs_where_there_is_an_environment(bare, sky):
    bare.environment = sky
    found = color_of(bare)
    default = rj.Material()
    if sky is not None:
        default = rj.Material(shading="pbr", base_color="white", metallic=1.0, roughness=1.0)
    bare.nodes[0].mesh.material = default
    np.testing.assert_array_equal(found, color_of(bare))


def test_one_renderer_sees_an_environment_come_and_go(bare):
    camera = rj.OrthographicCamera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0))
    with rj.Renderer((3, 3), threads=1) as renderer:
        plain = renderer.render(bare, camera).color.copy()
        bare.environment = rj.Environment.constant((0.5, 0.3, 0.1))
        around = renderer.render(bare, camera).color.copy()
        bare.environment = None
        np.testing.assert_array_equal(renderer.render(bare, camera).color, plain)
    assert (around != plain).any()


def test_a_material_that_somebody_changed_stays_with_an_environment(bare):
    bare.environment = rj.Environment.constant((0.5, 0.3, 0.1))
    metal, mesh = color_of(bare), bare.nodes[0].mesh
    mesh.material = replace(mesh.material, base_color="red")
    assert (color_of(bare) != metal).any()
    assert mesh.material.shading == "phong"


def test_a_shading_asked_for_stays_with_an_environment(bare):
    SceneOptions(shading="phong").apply(bare)
    bare.environment = rj.Environment.constant((0.5, 0.3, 0.1))
    found = color_of(bare)
    bare.nodes[0].mesh.material = rj.Material()
    np.testing.assert_array_equal(found, color_of(bare))


@pytest.mark.parametrize(
    "names", [["KHR_materials_iridescence"], ["KHR_texture_transform", "ACME_volumes", "X"]]
)
def test_a_file_that_requires_what_is_not_read_is_refused_by_name(tmp_path, names):
    path = textured().save(tmp_path / "a.glb", extensionsRequired=names)
    with pytest.raises(MeshFileError, match=r"a\.glb.*extensionsRequired names ") as said:
        rj.load(path)
    assert all((name in str(said.value)) == ("texture" not in name) for name in names)


def test_a_file_may_require_what_is_read(tmp_path):
    path = textured().save(tmp_path / "a.glb", extensionsRequired=["KHR_texture_transform"])
    assert len(rj.load(path).nodes) == 1


def test_plain_accessors_count_where_compression_is_optional(tmp_path):
    model = second_mesh(lambda mesh, header: compress(mesh["primitives"][0], header, is_plain=True))
    document(model)["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = rj.load(model.save(tmp_path / "a.glb"))
    assert [node.mesh.vertices[:, 0].max() for node in scene.nodes] == [1.0, 3.0]


# --- geometry -------------------------------------------------------------------------------------


def compress(primitive, header, is_plain):
    """Say that a primitive is compressed, with its plain accessors or without."""
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {}}}
    for number in [*primitive["attributes"].values(), primitive["indices"]]:
        if not is_plain:
            del header["accessors"][number]["bufferView"]


def second_mesh(change):
    """Return a model of two rectangles, the second of which is changed."""
    model = Model()
    model.add(quad(-1, -1, 1, 1), model.material())
    model.add(quad(2, -1, 3, 1), 0)
    change(document(model)["meshes"][1], document(model))
    return model


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda m, d: m["primitives"][0].update(mode=9), "mesh 'mesh 1', which cannot be read"),
        (lambda m, d: m["primitives"][0].update(indices=99), "no accessor 99 (it has "),
        (lambda m, d: m["primitives"][0]["attributes"].pop("POSITION"), "POSITION is missing"),
        (lambda m, d: compress(m["primitives"][0], d, is_plain=False),
         "mesh 'mesh 1', which cannot be read: KHR_draco_mesh_compression"),
        (lambda m, d: d["nodes"][1].update(mesh=7), "reference to mesh 7, which the file has not"),
        (lambda m, d: d["accessors"][4].update(count=10**9), "mesh 'mesh 1', which cannot be read"),
        (lambda m, d: d["accessors"][4].update(count=0), "mesh 'mesh 1', which"),
        (lambda m, d: d["accessors"][4].update(byteOffset=10**9), "mesh 'mesh 1', which"),
        (lambda m, d: d["accessors"][4].update(componentType=1), "mesh 'mesh 1', which"),
        (lambda m, d: d["bufferViews"][4].update(buffer=3), "mesh 'mesh 1', which cannot be read"),
    ],
)  # fmt: skip
def test_a_mesh_that_cannot_be_shown_is_left_out_by_name(tmp_path, change, reason):
    scene = load_with(second_mesh(change).save(tmp_path / "a.glb"), reason)
    assert len(scene.nodes) == 1


def test_attributes_that_are_no_use_are_left_out_by_name(tmp_path):
    model = textured()
    attributes = {**quad(-1, -1, 1, 1), "COLOR_0": np.full((4, 4), np.nan, np.float32)}
    attributes["NORMAL"] = attributes["NORMAL"][:3]
    model.add(attributes, 0)
    load_with(
        model.save(tmp_path / "a.glb"), "NORMAL of mesh 'mesh 1', which does not fit the vertices",
        "COLOR_0 of mesh 'mesh 1', which has NaN or infinity",
    )  # fmt: skip


def test_a_texture_without_coordinates_is_left_out_by_name(tmp_path):
    model = Model()
    attributes = quad(-1, -1, 1, 1)
    attributes.pop("TEXCOORD_0")
    model.add(attributes, model.material(baseColorTexture=model.texture(GREY)))
    scene = load_with(
        model.save(tmp_path / "a.glb"), "textures of mesh 'mesh 0', which has no coordinates"
    )
    assert only_material(scene).base_color_texture is None


def test_a_file_without_faces_says_what_it_holds(tmp_path):
    model = Model()
    model.add(quad(-1, -1, 1, 1), model.material())
    document(model)["meshes"][0]["primitives"][0]["mode"] = 9
    said = r"a\.glb holds no faces, lines or points \(mesh 'mesh 0', which cannot be read"
    with pytest.raises(MeshFileError, match=said):
        rj.load(model.save(tmp_path / "a.glb"))
    model = textured()
    document(model)["nodes"] = [{}]
    with pytest.raises(MeshFileError, match="holds no faces"):
        rj.load(model.save(tmp_path / "b.glb"))


@pytest.mark.parametrize("mode", [TRIANGLES, STRIP, FAN])
def test_strips_and_fans_are_the_triangles_that_opengl_makes(mode):
    corners = np.array([7, 3, 9, 4, 8])
    want = {
        TRIANGLES: [[7, 3, 9]],
        STRIP: [[7, 3, 9], [3, 4, 9], [9, 4, 8]],
        FAN: [[3, 9, 7], [9, 4, 7], [4, 8, 7]],
    }[mode]
    assert list_triangles(corners, mode).tolist() == want
    for few in range(3):
        assert len(list_triangles(corners[:few], mode)) == 0


def test_a_mesh_without_indices_is_drawn_in_order(tmp_path):
    model = Model()
    attributes = {name: rows[QUAD_FACES.ravel()] for name, rows in quad(-1, -1, 1, 1).items()}
    model.add(attributes, model.material())
    document(model)["meshes"][0]["primitives"][0].pop("indices")
    (node,) = rj.load(model.save(tmp_path / "a.glb")).nodes
    assert node.mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_sparse_and_normalized_accessors_and_strides_are_decoded(tmp_path):
    places = np.array([1, 3], "<u2").tobytes()
    values = np.array([[9, 9], [-127, -128]], "<i1").tobytes()
    rows = np.arange(4 * 4, dtype="<i1").tobytes()
    content = rows + places + values
    (tmp_path / "data.bin").write_bytes(content)
    header = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "data.bin", "byteLength": len(content)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 16, "byteStride": 4},
            {"buffer": 0, "byteOffset": 16, "byteLength": 4},
            {"buffer": 0, "byteOffset": 20, "byteLength": 4},
        ],
        "accessors": [
            {
                "bufferView": 0, "byteOffset": 1, "componentType": 5120, "type": "VEC2", "count": 4,
                "normalized": normalized,
                "sparse": {
                    "count": 2, "indices": {"bufferView": 1, "componentType": 5123},
                    "values": {"bufferView": 2},
                },
            }
            for normalized in (False, True)
        ],
    }  # fmt: skip
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(header))
    file = GltfFile(path, Resources(path))
    plain = np.array([[1, 2], [9, 9], [9, 10], [-127, -128]])
    assert np.array_equal(file.read_array(0), plain)
    assert file.read_array(1) == pytest.approx(np.maximum(plain / 127, -1.0))


def test_nothing_but_roots_is_shown_where_there_are_no_scenes(tmp_path):
    model = textured()
    path = model.save(tmp_path / "a.glb")
    # The same file, whose scenes are called something else.
    path.write_bytes(path.read_bytes().replace(b'"scenes"', b'"sceneX"'))
    with pytest.warns(LoadWarning, match=r"left out entry 'sceneX' \(1\)"):
        assert len(rj.load(path).nodes) == 1


def test_what_hangs_on_the_node_of_a_camera_is_shown(tmp_path):
    model = textured()
    lens = {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}
    number = model.glb.add("cameras", lens)
    document(model)["nodes"][0]["camera"] = number
    scene = rj.load(model.save(tmp_path / "a.glb"))
    assert len(scene.nodes) == 1
    assert scene.camera is not None


def test_nodes_that_hang_on_themselves_end(tmp_path):
    model = textured()
    document(model)["nodes"][0]["children"] = [0]
    assert len(rj.load(model.save(tmp_path / "a.glb")).nodes) == 1


def test_a_mesh_in_parts_is_one_node_for_each(tmp_path):
    model = textured()
    primitives = document(model)["meshes"][0]["primitives"]
    primitives.append({**primitives[0], "material": model.material("other")})
    document(model)["nodes"][0]["name"] = "house"
    scene = rj.load(model.save(tmp_path / "a.glb"))
    assert [node.name for node in scene.nodes] == ["house", "house part 2"]
    assert [node.mesh.material.name for node in scene.nodes] == ["wall", "other"]


def test_nodes_hang_together_as_in_the_file(tmp_path):
    model = textured()
    nodes = document(model)["nodes"]
    primitives = document(model)["meshes"][0]["primitives"]
    primitives.append({**primitives[0]})
    nodes[0].update(name="hand", rotation=[0.0, 0.0, 0.6, 0.8], scale=[1.0, 2.0, 1.0])
    nodes += [
        {"name": "base", "translation": [1.0, 0.0, -0.0], "children": [2, 4], "mesh": 0},
        {"name": "elbow", "rotation": [0.28, 0.0, 0.0, 0.96], "children": [3]},
        {"children": [0]},
        {"name": "eye"},
    ]
    document(model)["scenes"] = [{"nodes": [1]}]
    with pytest.warns(LoadWarning, match="scene 1 beside the one shown"):
        scene = rj.load(model.save(tmp_path / "a.glb"))
    assert [node.name for node in scene.nodes] == ["base", "base part 2", "hand", "hand part 2"]
    hand, wanted = scene.find("hand"), np.eye(4)
    assert [hand.parent.name, hand.parent.parent.name] == ["3", "elbow"]
    assert hand.parent.parent.parent is scene.find("base")
    for number in (1, 2, 3, 0):
        wanted = rj.transforms.compose(wanted, parent_from_node(nodes[number]))
    for node in (hand, *hand.children):
        np.testing.assert_array_equal(node.world_matrix, wanted)
    scene.find("elbow").transform = rj.transforms.translate((0, 0, 7))
    assert scene.nodes[3].world_matrix[:3, 3].tolist() == [1.0, 0.0, 7.0]
    with pytest.raises(ValueError, match="name must be that of a node of the scene, got 'eye'"):
        scene.find("eye")
    nodes[2]["matrix"] = [2.0] * 16
    with pytest.raises(MeshFileError, match="node 'elbow': transform must be affine"):
        rj.load(model.save(tmp_path / "a.glb"))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"intensity": -3}, "light 0, which cannot be used: intensity must be a number at least 0, "
         "got -3 (1)"),
        ({"intensity": "bright"}, "intensity must be a finite number, got \"bright\""),
        ({"intensity": float("nan")}, "intensity must be a finite number, got NaN"),
        ({"range": -2}, "light 0, which cannot be used: range must be above 0, got -2"),
        ({"color": [1, 2]}, "color must "),
        ({"type": None}, "None light"),
    ],
)  # fmt: skip
def test_a_light_that_cannot_be_used_is_named_with_the_field(tmp_path, change, reason):
    model = textured()
    document(model)["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    light = {"type": "point", **change}
    document(model)["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
    assert load_with(model.save(tmp_path / "a.glb"), reason).lights == []


@pytest.mark.parametrize("number", [1, -1, "sun"])
def test_a_light_that_the_file_has_not_is_named(tmp_path, number):
    model = textured()
    document(model)["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": number}}
    document(model)["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    load_with(model.save(tmp_path / "a.glb"), f"light {json.dumps(number)}, which", "has 1 lights")


def test_a_camera_that_cannot_be_used_is_named_with_the_field(tmp_path):
    model = textured()
    number = model.glb.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0}})
    document(model)["nodes"][0]["camera"] = number
    said = "camera 0, which cannot be used: znear is missing"
    assert load_with(model.save(tmp_path / "a.glb"), said).camera is None


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_a_camera_on_a_mirroring_node_is_named(tmp_path, kind):
    lens = {"yfov": 1.0, "xmag": 2, "ymag": 2, "znear": 0.1, "zfar": 9}
    for scale, is_taken in (([2, 2, 2], True), ([-1, -1, 2], True), ([-1, 1, 1], False)):
        model = textured()
        number = model.glb.add("cameras", {"type": kind, kind: lens})
        nodes = document(model)["nodes"]
        # What mirrors may be a node above.
        nodes.append({"camera": number, "translation": [0, 0, 3]})
        nodes[0] |= {"children": [len(nodes) - 1], "scale": scale}
        path = model.save(tmp_path / "a.glb")
        if is_taken:
            assert rj.load(path).camera is not None
        else:
            said = "camera 0, which cannot be used: its node must not mirror"
            assert load_with(path, said).camera is None


@pytest.mark.parametrize("length", [6, 19, 20, 300, -200])
def test_a_file_that_ends_too_early_is_refused_with_this_reason(tmp_path, length):
    path = textured().save(tmp_path / "a.glb")
    whole = path.read_bytes()
    head = 20 + int.from_bytes(whole[12:16], "little")
    path.write_bytes(whole[: length if length > 0 else head + length])
    with pytest.raises(MeshFileError, match=r"could not be read as \.glb: it ends too early, "):
        rj.load(path)


def test_damaged_json_is_refused_with_this_reason(tmp_path):
    (tmp_path / "a.gltf").write_text('{"asset": {"version": "2.0"}, "nodes": [')
    with pytest.raises(MeshFileError, match="its JSON is damaged or ends too early"):
        rj.load(tmp_path / "a.gltf")


def test_a_glb_that_is_none_and_nodes_that_are_not_there_are_refused_by_name(tmp_path):
    path = textured().save(tmp_path / "a.glb")
    path.write_bytes(b"XXXX" + path.read_bytes()[4:])
    with pytest.raises(MeshFileError, match="it is no GLB, which begins with b'glTF', got b'XXXX'"):
        rj.load(path)
    document = json.loads(arm().save(tmp_path / "a.gltf").read_text())
    del document["nodes"]
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    with pytest.raises(
        MeshFileError, match=r"its scene: nodes names \d, but the file has no nodes"
    ):
        rj.load(tmp_path / "a.gltf")


def test_scenes_that_are_not_shown_are_named(tmp_path):
    document = json.loads(arm().save(tmp_path / "a.gltf").read_text())
    (first,) = document["scenes"]
    document["scenes"] = [{**first, "name": "night"}, first, first]
    for number, said in ((0, "scene 1, scene 2"), (1, "scene 'night', scene 2")):
        document["scene"] = number
        (tmp_path / "a.gltf").write_text(json.dumps(document))
        with pytest.warns(LoadWarning, match=rf"left out {said} beside the one shown \(2\); the"):
            rj.load(tmp_path / "a.gltf")


def test_a_reason_is_said_once_with_the_first_that_have_it(tmp_path):
    left_out = LeftOut()
    for name in "abcde":
        left_out.note(name, reason=": it is missing")
        left_out.note("camera")
    left_out.note("f", 2, reason=": it is damaged")
    assert (
        str(left_out) == "a, b, c and 2 more: it is missing (5), camera (5), f: it is damaged (2)"
    )
    document = json.loads(arm().save(tmp_path / "a.gltf").read_text())
    (mesh,) = document["meshes"]
    document["meshes"] = [{**mesh, "name": f"part {number}"} for number in range(40)]
    document["nodes"] = [{"mesh": number} for number in range(40)]
    document["scenes"] = [{"nodes": list(range(40))}]
    document["buffers"][0]["uri"] = "../x.bin"
    (tmp_path / "sub").mkdir()
    path = tmp_path / "sub" / "a.gltf"
    path.write_text(json.dumps(document))
    with pytest.raises(MeshFileError) as raised:
        rj.load(path)
    said = str(raised.value)
    assert (
        "(mesh 'part 0', mesh 'part 1', mesh 'part 2' and 37 more, which cannot be read: " in said
    )
    for once in ("'../x.bin' lies outside", "resource_root names another folder (40)"):
        assert said.count(once) == 1, said


def test_a_file_error_is_a_value_error():
    assert issubclass(MeshFileError, ValueError)


def test_gltf_1_is_refused_by_name(tmp_path):
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps({"asset": {"version": "1.1"}}))
    with pytest.raises(MeshFileError, match=r"a\.gltf could not be read as \.gltf: .* glTF 1\.1"):
        rj.load(path)


def test_given_tangents_are_kept_where_a_normal_map_needs_them(tmp_path):
    model = Model()
    texture = model.texture(GREY)
    tangents = np.tile(np.float32([0, 1, 0, -1]), (4, 1))
    for fields in ({"normalTexture": texture}, {"baseColorTexture": texture}):
        model.add({**quad(-1, -1, 1, 1), "TANGENT": tangents}, model.material(**fields))
    mapped, plain = rj.load(model.save(tmp_path / "a.glb")).nodes
    assert np.array_equal(mapped.mesh.tangents, tangents)
    assert plain.mesh.tangents is None


def test_gltf_is_read_without_trimesh(tmp_path):
    path = textured().save(tmp_path / "a.glb")
    code = (
        "import sys, rasterjit.io.meshes as m\n"
        f"assert m.load({str(path)!r}).nodes\n"
        "assert 'trimesh' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_avatar_is_a_glb_file(tmp_path):
    path = textured().save(tmp_path / "a.glb").rename(tmp_path / "avatar.vrm")
    assert len(rj.load(path).nodes) == 1


def test_a_file_that_needs_a_later_reader_is_refused(tmp_path):
    model = textured()
    document(model)["asset"]["minVersion"] = "2.5"
    with pytest.raises(rj.MeshFileError, match=r"needs a reader of glTF 2\.5, not 2\.0"):
        rj.load(model.save(tmp_path / "a.glb"))
