"""Textures of files: read, sampled as the file says, upright, or named as left out."""

from __future__ import annotations

import base64
import io
import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning
from rasterjit.io.meshes import from_trimesh, load
from rasterjit.scene.material import CORE_TEXTURES, Material

CORNERS = np.array(
    [[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], np.uint8
)  # red, green over blue, yellow
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
UPRIGHT = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
"""Texture coordinates of the square with v up."""
TWO_FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint16)

NEAREST, LINEAR, MIPPED = 9728, 9729, 9987
REPEAT, CLAMP, MIRROR = 10497, 33071, 33648


def only_mesh(scene):
    (node,) = scene.nodes
    return node.mesh


def picture(pixels=CORNERS, mode="PNG"):
    """Return a picture's file as bytes."""
    stream = io.BytesIO()
    (pixels if isinstance(pixels, Image.Image) else Image.fromarray(pixels)).save(stream, mode)
    return stream.getvalue()


def write_obj(folder, image, *, more="", uv=True):
    """Write an OBJ of a square with a material that shows a picture."""
    (folder / "skin.png").write_bytes(image)
    (folder / "a.mtl").write_text(f"newmtl skin\n{more}map_Kd skin.png\n")
    lines = ["mtllib a.mtl", *(f"v {x} {y} {z}" for x, y, z in SQUARE)]
    lines += [f"vt {u} {v}" for u, v in UPRIGHT]
    corner = "{0}/{0}" if uv else "{0}"
    lines += ["usemtl skin", "f " + " ".join(corner.format(n) for n in (1, 2, 3, 4))]
    path = folder / "a.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def data_uri(content, kind="application/octet-stream"):
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def write_gltf(folder, image, samplers=({},), **texture):
    """Write a glTF of a square; one material for each sampler, all of them used by one face."""
    # glTF counts v from the top of the picture.
    flipped = np.column_stack([UPRIGHT[:, 0], 1 - UPRIGHT[:, 1]]).astype(np.float32)
    parts = [SQUARE.tobytes(), flipped.tobytes(), TWO_FACES.tobytes()]
    starts = np.cumsum([0] + [len(part) for part in parts])
    kinds = [(5126, 4, "VEC3"), (5126, 4, "VEC2"), (5123, 6, "SCALAR")]
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(samplers)))}],
        "nodes": [{"mesh": n} for n in range(len(samplers))],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2,
                             "material": n}]}
            for n in range(len(samplers))
        ],
        "materials": [
            {"name": f"m{n}", "pbrMetallicRoughness": {"baseColorTexture": {"index": n, **texture}}}
            for n in range(len(samplers))
        ],
        "textures": [{"source": 0, "sampler": n} for n in range(len(samplers))],
        "samplers": list(samplers),
        "images": [{"uri": data_uri(image, "image/png")}],
        "buffers": [{"uri": data_uri(b"".join(parts)), "byteLength": int(starts[-1])}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": int(starts[n]), "byteLength": len(part)}
            for n, part in enumerate(parts)
        ],
        "accessors": [
            {"bufferView": n, "componentType": component, "count": count, "type": kind,
             **({"min": [-1, -1, 0], "max": [1, 1, 0]} if n == 0 else {})}
            for n, (component, count, kind) in enumerate(kinds)
        ],
    }  # fmt: skip
    path = folder / "a.gltf"
    path.write_text(json.dumps(document))
    return path


def seen(scene, size=(2, 2)):
    """Return what a square shows without light, from the front, (H, W, 3) uint8."""
    for node in scene.nodes:
        node.mesh.material = replace(node.mesh.material, shading="unlit")
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=2.0, near=1.0, far=9.0)
    return rj.render(scene, camera, size=size, threads=1).color[:, :, :3]


def test_the_texture_of_an_obj_is_upright(tmp_path):
    assert (seen(load(write_obj(tmp_path, picture()))) == CORNERS).all()


def test_the_texture_of_a_gltf_is_upright(tmp_path):
    assert (seen(load(write_gltf(tmp_path, picture()))) == CORNERS).all()


def test_the_texture_of_a_glb_is_upright(tmp_path):
    path = tmp_path / "a.glb"
    trimesh.load_scene(write_gltf(tmp_path, picture())).export(path)
    assert (seen(load(path)) == CORNERS).all()


def test_the_texture_of_a_trimesh_is_upright():
    visual = trimesh.visual.TextureVisuals(uv=UPRIGHT, image=Image.fromarray(CORNERS))
    mesh = trimesh.Trimesh(SQUARE, TWO_FACES, visual=visual, process=False)
    assert (seen(from_trimesh(mesh)) == CORNERS).all()


def test_a_map_kd_is_the_base_colour_texture_and_uv_stays(tmp_path):
    mesh = only_mesh(load(write_obj(tmp_path, picture(np.full((3, 4, 3), 188, np.uint8)))))
    assert np.unique(mesh.uv, axis=0).tolist() == [[0, 0], [0, 1], [1, 0], [1, 1]]
    texture = mesh.material.base_color_texture
    assert mesh.material == Material(name="skin", base_color_texture=texture)
    assert texture.size == (4, 3)
    assert (texture.image == np.float32([0.502886458033] * 3 + [1.0])).all()
    assert (texture.wrap, texture.filter) == (("repeat", "repeat"), "trilinear")


def test_a_kd_multiplies_the_texture(tmp_path):
    path = write_obj(tmp_path, picture(), more="Kd 1 0 0\n")
    material = only_mesh(load(path)).material
    assert material.base_color == (1.0, 0.0, 0.0, 1.0)
    assert material.base_color_texture is not None


@pytest.mark.parametrize(
    ("sampler", "wrap", "kind"),
    [
        ({}, ("repeat", "repeat"), "trilinear"),
        ({"wrapS": CLAMP, "wrapT": MIRROR}, ("clamp", "mirror"), "trilinear"),
        ({"wrapS": REPEAT, "wrapT": CLAMP}, ("repeat", "clamp"), "trilinear"),
        ({"magFilter": NEAREST, "minFilter": MIPPED}, ("repeat", "repeat"), "nearest"),
        ({"magFilter": LINEAR, "minFilter": LINEAR}, ("repeat", "repeat"), "bilinear"),
        ({"magFilter": LINEAR, "minFilter": NEAREST}, ("repeat", "repeat"), "bilinear"),
        ({"magFilter": LINEAR, "minFilter": MIPPED}, ("repeat", "repeat"), "trilinear"),
    ],
)
def test_a_gltf_sampler_says_how_to_wrap_and_filter(tmp_path, sampler, wrap, kind):
    texture = only_mesh(
        load(write_gltf(tmp_path, picture(), [sampler]))
    ).material.base_color_texture
    assert (texture.wrap, texture.filter) == (wrap, kind)


def test_a_picture_is_read_once_for_each_way_to_sample_it(tmp_path):
    path = write_gltf(tmp_path, picture(), [{}, {"wrapS": CLAMP}, {}])
    textures = [node.mesh.material.base_color_texture for node in load(path).nodes]
    assert textures[0] is textures[2]
    assert textures[0] is not textures[1]
    assert [texture.wrap[0] for texture in textures] == ["repeat", "clamp", "repeat"]


def test_a_set_of_coordinates_that_the_mesh_has_not_is_left_out_by_name(tmp_path):
    path = write_gltf(tmp_path, picture(), texCoord=1)
    with pytest.warns(LoadWarning, match=r"textures of mesh 0, which has no coordinates for them"):
        assert only_mesh(load(path)).material.base_color_texture is None


def test_the_transform_of_a_texture_is_that_of_the_file(tmp_path):
    transform = {"offset": [0.5, 0.0], "scale": [2, 1], "rotation": 0.0}
    path = write_gltf(tmp_path, picture(), extensions={"KHR_texture_transform": transform})
    texture = only_mesh(load(path)).material.base_color_texture
    assert texture.transform == (2.0, 0.0, 0.5, 0.0, 1.0, 0.0)


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "CMYK", "I;16"])
def test_every_kind_of_picture_becomes_a_texture(mode):
    if mode == "I;16":
        image = Image.fromarray(np.full((3, 3), 257 * 255, np.uint16))
    else:
        image = Image.new("RGB", (3, 3), "white").convert(mode)
    visual = trimesh.visual.TextureVisuals(uv=UPRIGHT, image=image)
    mesh = trimesh.Trimesh(SQUARE, TWO_FACES, visual=visual, process=False)
    texture = only_mesh(from_trimesh(mesh)).material.base_color_texture
    assert (texture.image == 1.0).all()


def test_the_stand_in_of_trimesh_is_no_texture():
    mesh = trimesh.Trimesh(SQUARE, TWO_FACES, process=False)
    mesh.visual = trimesh.visual.TextureVisuals(uv=UPRIGHT)
    assert only_mesh(from_trimesh(mesh)).material.base_color_texture is None


def test_a_texture_without_uv_is_left_out_by_name_once(tmp_path):
    path = write_obj(tmp_path, picture(), uv=False)
    with pytest.warns(LoadWarning, match=r"a\.obj: left out texture image without") as said:
        mesh = only_mesh(load(path))
    assert len(said) == 1
    assert said[0].filename == __file__
    assert mesh.material.base_color_texture is None


def test_a_damaged_texture_is_left_out_by_name(tmp_path):
    whole = picture(Image.effect_noise((64, 64), 50))
    path = write_obj(tmp_path, whole[: len(whole) // 2])
    with pytest.warns(
        LoadWarning, match=r"map_Kd of material 'skin', 'skin.png', that cannot be read: "
    ):
        mesh = only_mesh(load(path))
    assert mesh.material.base_color_texture is None


def test_what_is_no_picture_is_named_without_its_place_in_memory(tmp_path):
    path = write_obj(tmp_path, b"no picture")
    with pytest.warns(LoadWarning, match=r"'skin.png', .* read: it is no known picture"):
        load(path)


def test_a_texture_that_is_missing_is_left_out_by_name(tmp_path):
    path = write_obj(tmp_path, picture())
    (tmp_path / "skin.png").unlink()
    with pytest.warns(
        LoadWarning, match=r"map_Kd of material 'skin', 'skin.png', .* it is missing"
    ):
        assert only_mesh(load(path)).material.base_color_texture is None


def test_alpha_of_a_map_kd_counts_for_nothing_without_a_map_d_and_says_so(tmp_path):
    path = write_obj(tmp_path, picture(np.full((4, 4, 4), 128, np.uint8)))
    with pytest.warns(
        LoadWarning, match=r"alpha of the map_Kd of material 'skin'.* no map_d \(1\)"
    ):
        assert only_mesh(load(path)).material.alpha_mode == "opaque"


@pytest.mark.parametrize("has_color", [True, False])
@pytest.mark.parametrize("size", [(2, 2), (6, 4)])
def test_a_map_d_is_the_alpha_of_the_texture(tmp_path, has_color, size):
    path = write_obj(tmp_path, picture(), more="map_d -imfchan m holes in it.png\n")
    if not has_color:
        text = (tmp_path / "a.mtl").read_text()
        (tmp_path / "a.mtl").write_text(text.replace("map_Kd skin.png\n", ""))
    holes = Image.fromarray(np.array([[0, 255], [255, 51]], np.uint8)).resize(size, Image.NEAREST)
    (tmp_path / "holes in it.png").write_bytes(picture(holes))
    material = only_mesh(load(path)).material
    assert material.alpha_mode == "blend"
    image = material.base_color_texture.image
    corners = image[[0, 0, -1, -1], [0, -1, 0, -1]]
    if size == (2, 2) or not has_color:
        assert corners[:, 3] == pytest.approx([0.0, 1.0, 1.0, 0.2])
    else:
        assert image.shape == (2, 2, 4)
    assert (corners[0, :3] == [1.0, 0.0 if has_color else 1.0, 0.0 if has_color else 1.0]).all()


@pytest.mark.parametrize(
    ("options", "laid"),
    [
        ("-s 1 1 1 -clamp off -o 0 0 0 ", {}),
        ("-bm 1 -mm 0 1 -blendu on -t 0 0 0 ", {}),
        ("-s 2 3 ", {"scale": (2.0, 3.0)}),
        ("-s 4 -o 0.5 .25 0 ", {"scale": (4.0, 1.0), "offset": (0.5, 0.25)}),
        ("-clamp on -o -1.5e-1 ", {"wrap": ("clamp", "clamp"), "offset": (-0.15, 0.0)}),
    ],
)
def test_a_texture_is_laid_as_the_options_of_an_mtl_file_say(tmp_path, options, laid):
    path = write_obj(tmp_path, picture())
    text = (tmp_path / "a.mtl").read_text()
    (tmp_path / "a.mtl").write_text(text.replace("map_Kd ", "map_Kd " + options))
    texture = only_mesh(load(path)).material.base_color_texture
    usual = {"scale": (1.0, 1.0), "offset": (0.0, 0.0), "wrap": ("repeat", "repeat")}
    assert {key: getattr(texture, key) for key in usual} == usual | laid


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ("-mm 0.1 2", ["-mm"]), ("-t 1 1 1", ["-t"]), ("-bm 0.5", ["-bm"]), ("-cc on", ["-cc"]),
        ("-blendu off -blendv off", ["-blendu", "-blendv"]), ("-texres 512", ["-texres"]),
        ("-imfchan r", ["-imfchan"]), ("-boost 2", ["-boost"]), ("-s 1e9 1", ["-s"]),
    ],
)  # fmt: skip
def test_options_that_a_texture_cannot_keep_are_named(tmp_path, options, named):
    path = write_obj(tmp_path, picture())
    text = (tmp_path / "a.mtl").read_text()
    (tmp_path / "a.mtl").write_text(text.replace("map_Kd ", f"map_Kd {options} "))
    with pytest.warns(LoadWarning) as said:
        assert only_mesh(load(path)).material.base_color_texture.size == (2, 2)
    left_out = {f"option {one} of map_Kd of material 'skin'": 1 for one in named}
    assert said[0].message.left_out == left_out


def test_statements_of_an_mtl_file_that_show_something_else_are_named(tmp_path):
    more = "# a skin\n#Kd 0 0 0\nKa 1 1 1\nillum 2\nKe 0 0 0\nNi 1.5\n"
    more += "Ke 1 0 0 # red\nmap_Bump -bm 1 a.png\nfoo 1\n"
    path = write_obj(tmp_path, picture(), more=more)
    with pytest.warns(LoadWarning) as said:
        load(path)
    names = ("Ke", "map_Bump", "foo")
    assert said[0].message.left_out == {f"{one} of material 'skin'": 1 for one in names}


@pytest.mark.parametrize(
    "line", ["b.mtl a.mtl", "a.mtl b.mtl # the second is red", "a.mtl  # all", "'a.mtl' \"b.mtl\""]
)
def test_all_mtl_files_of_a_line_are_read(tmp_path, line):
    path = write_obj(tmp_path, picture())
    (tmp_path / "b.mtl").write_text("newmtl red\nKd 1 0 0 # red\n")
    text = path.read_text().replace("mtllib a.mtl", f"mtllib {line}")
    text += "usemtl red # the second\nf 1/1 2/2 3/3\n" if "b.mtl" in line else ""
    path.write_text(text)
    materials = {one.mesh.material.name: one.mesh.material for one in load(path).nodes}
    assert materials["skin"].base_color_texture.size == (2, 2)
    assert "b.mtl" not in line or materials["red"].base_color == (1.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("name", ["my own.mtl", "a #1.mtl", "two.mtl of them.mtl"])
def test_the_name_of_an_mtl_file_may_have_blanks_and_more(tmp_path, name):
    path = write_obj(tmp_path, picture())
    (tmp_path / "a.mtl").rename(tmp_path / name)
    path.write_text(path.read_text().replace("mtllib a.mtl", f"mtllib {name}"))
    assert only_mesh(load(path)).material.base_color_texture.size == (2, 2)


def test_a_missing_mtl_file_is_named_beside_one_that_is_there(tmp_path):
    path = write_obj(tmp_path, picture())
    path.write_text(path.read_text().replace("mtllib a.mtl", "mtllib a.mtl gone.mtl"))
    with pytest.warns(LoadWarning, match=r"left out MTL file 'gone\.mtl': it is missing \(1\);"):
        assert only_mesh(load(path)).material.base_color_texture.size == (2, 2)


def test_names_of_materials_with_a_number_sign_are_not_cut(tmp_path):
    path = write_obj(tmp_path, picture())
    names = ["Material #1", "Material #2"]
    (tmp_path / "a.mtl").write_text(
        "".join(f"newmtl {name}\nKd {at} 1 0\n" for at, name in enumerate(names))
    )
    lines = [line for line in path.read_text().splitlines() if line[:6] != "usemtl"]
    text = "\n".join(lines[:-1])
    path.write_text(text + "".join(f"\nusemtl {one}\n{lines[-1]}" for one in names) + "\n")
    colors = {one.mesh.material.name: one.mesh.material.base_color for one in load(path).nodes}
    assert colors == {names[0]: (0.0, 1.0, 0.0, 1.0), names[1]: (1.0, 1.0, 0.0, 1.0)}


def test_a_material_that_no_mtl_has_is_named(tmp_path):
    path = write_obj(tmp_path, picture())
    path.write_text(path.read_text().replace("usemtl skin", "usemtl fur"))
    with pytest.warns(LoadWarning, match=r"reference to material 'fur', which no MTL file of it"):
        assert only_mesh(load(path)).material.base_color_texture is None


def test_the_pictures_of_a_trimesh_pbr_material_are_maps():
    image = Image.fromarray(CORNERS)
    names = ("baseColor", "normal", "metallicRoughness", "occlusion", "emissive")
    material = trimesh.visual.material.PBRMaterial(
        **{f"{name}Texture": image for name in names}, emissiveFactor=[1.0, 0.5, 0.0],
        alphaMode="MASK", alphaCutoff=0.25, doubleSided=True, metallicFactor=0.5,
    )  # fmt: skip
    visual = trimesh.visual.TextureVisuals(uv=UPRIGHT, material=material)
    mesh = trimesh.Trimesh(SQUARE, TWO_FACES, visual=visual, process=False)
    have = only_mesh(from_trimesh(mesh)).material
    assert (have.shading, have.metallic, have.roughness) == ("pbr", 0.5, 1.0)
    assert (have.alpha_mode, have.alpha_cutoff, have.double_sided) == ("mask", 0.25, True)
    assert have.emissive == (1.0, 0.5, 0.0)
    spaces = [getattr(have, name).color_space for name in CORE_TEXTURES]
    assert spaces == ["srgb", "linear", "linear", "linear", "srgb"]
