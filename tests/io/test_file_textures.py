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
from rasterjit.io.left_out import LoadWarning
from rasterjit.io.meshes import from_trimesh, load
from rasterjit.scene.material import Material

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
    assert mesh.material == Material(name="skin", base_color="white", base_color_texture=texture)
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


@pytest.mark.parametrize(
    ("texture", "message"),
    [
        ({"texCoord": 1}, "second set of texture coordinates"),
        ({"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}, "transform of a texture"),
    ],
)
def test_what_a_gltf_says_beyond_is_left_out_by_name(tmp_path, texture, message):
    with pytest.warns(LoadWarning, match=message):
        load(write_gltf(tmp_path, picture(), **texture))


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
    with pytest.warns(LoadWarning, match=r"texture image that cannot be read \(1\)"):
        mesh = only_mesh(load(path))
    assert mesh.material.base_color_texture is None


def test_a_transparent_texture_says_that_it_is_drawn_opaque(tmp_path):
    path = write_obj(tmp_path, picture(np.full((4, 4, 4), 128, np.uint8)))
    with pytest.warns(LoadWarning, match=r"transparency of a texture image \(1\)"):
        load(path)


def test_a_normal_map_is_left_out_by_name():
    image = Image.fromarray(CORNERS)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, normalTexture=image)
    visual = trimesh.visual.TextureVisuals(uv=UPRIGHT, material=material)
    mesh = trimesh.Trimesh(SQUARE, TWO_FACES, visual=visual, process=False)
    with pytest.warns(LoadWarning, match=r"left out texture image \(1\)"):
        assert only_mesh(from_trimesh(mesh)).material.base_color_texture is not None
