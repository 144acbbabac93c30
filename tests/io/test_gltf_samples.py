"""
What the Khronos sample models test, on small models of our own, with stated expectations.

AlphaBlendModeTest, TextureSettingsTest, TextureTransformTest, MetalRoughSpheres, NormalTangentTest,
OrientationTest, VertexColorTest, UnlitTest, EmissiveStrengthTest, MultiUVTest.
"""

from __future__ import annotations

import json
import math
import warnings
from dataclasses import replace

import naive
import numpy as np
import pytest
from sample_models import Model, ball_arrays, encode_png, quad

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning

NEAREST, LINEAR = 9728, 9729
REPEAT, CLAMP, MIRROR = 10497, 33071, 33648
SHARP = {"magFilter": NEAREST, "minFilter": NEAREST}


def camera(height=2.0, center=(0.0, 0.0)):
    x, y = center
    return rj.OrthographicCamera(eye=(x, y, 5), target=(x, y, 0), height=height, near=0.5, far=20.0)


def shown(model, path, size, height=2.0, center=(0.0, 0.0), background="black", **options):
    """Return the linear colours of a model as `rasterjit.load` reads it, (H, W, 3)."""
    scene = rj.load(model.save(path / "model.glb"))
    scene.lights = options.pop("lights", [])
    frame = rj.render(
        scene, camera(height, center), size=size, outputs=("linear",), background=background,
        threads=1, **options,
    )  # fmt: skip
    return frame.linear[..., :3]


def test_alpha_modes_and_cutoffs(tmp_path):
    """Opaque ignores alpha, blend mixes, mask keeps alpha at or above the cutoff (default 0.5)."""
    alphas = np.array([0, 63, 64, 127, 128, 191, 192, 255])
    pixels = np.full((1, 8, 4), 255)
    pixels[0, :, 3] = alphas
    model = Model()
    texture = model.texture(pixels, **SHARP)
    modes = [
        {"alphaMode": "OPAQUE"}, {"alphaMode": "BLEND"}, {"alphaMode": "MASK", "alphaCutoff": 0.25},
        {"alphaMode": "MASK"}, {"alphaMode": "MASK", "alphaCutoff": 0.75},
        {"alphaMode": "MASK", "alphaCutoff": 128 / 255},
    ]  # fmt: skip
    model.add(
        quad(0, 0, 8, 6, z=-1), model.material("wall", unlit=True, baseColorFactor=[0, 1, 0, 1])
    )
    for row, mode in enumerate(modes):
        material = model.material(f"row {row}", unlit=True, baseColorTexture=texture, **mode)
        model.add(quad(0, 5 - row, 8, 6 - row), material)
    have = shown(model, tmp_path, (8, 6), 6.0, (4, 3))
    share = alphas / 255.0
    for row, kept in enumerate(
        [np.ones(8), share, share >= 0.25, share >= 0.5, share >= 0.75, alphas >= 128]
    ):
        want = np.stack([kept, np.ones(8), kept], axis=1).astype(float)
        assert have[row] == pytest.approx(want, abs=1e-6), modes[row]


@pytest.mark.parametrize("side", ["wrapS", "wrapT"])
@pytest.mark.parametrize(
    ("wrap", "columns"),
    [(REPEAT, [0, 1, 0, 1, 0, 1]), (CLAMP, [0, 0, 0, 1, 1, 1]), (MIRROR, [1, 0, 0, 1, 1, 0])],
)
def test_wrap_modes(tmp_path, side, wrap, columns):
    """From -1 to 2, in steps of half a picture that is dark on the left, or on top, side."""
    pixels = np.array([[[0, 0, 0], [255, 255, 255]]])
    across = side == "wrapS"
    model = Model()
    texture = model.texture(
        pixels if across else pixels.transpose(1, 0, 2), **SHARP, **{side: wrap}
    )
    uv = (-1, 0, 2, 1) if across else (0, -1, 1, 2)
    model.add(quad(-3, -3, 3, 3, uv=uv), model.material(unlit=True, baseColorTexture=texture))
    have = shown(model, tmp_path, (6, 6), 6.0)[..., 0]
    assert (have[2] if across else have[:, 2]).tolist() == columns


def test_filters(tmp_path):
    """NEAREST shows texels, LINEAR mixes them in linear light."""
    pixels = np.array([[[0, 0, 0], [255, 255, 255]]])
    for kind, want in ((NEAREST, [0, 0, 1, 1]), (LINEAR, [0, 0.25, 0.75, 1])):
        model = Model()
        texture = model.texture(pixels, magFilter=kind, minFilter=kind, wrapS=CLAMP)
        model.add(quad(-2, -2, 2, 2), model.material(unlit=True, baseColorTexture=texture))
        have = shown(model, tmp_path, (4, 4), 4.0)[1, :, 0]
        assert have == pytest.approx(want, abs=1e-6)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("double_sided", [False, True])
def test_back_faces_of_single_sided_materials_are_not_drawn(tmp_path, double_sided, mirrored):
    """A front, and a back turned by 180 degrees; mirroring turns neither inside out."""
    model = Model()
    material = model.material(unlit=True, doubleSided=double_sided)
    sign = -1.0 if mirrored else 1.0
    model.add(quad(-1, -1, 1, 1), material, translation=[-1, 0, 0], scale=[sign, 1, 1])
    model.add(
        quad(-1, -1, 1, 1), material, translation=[1, 0, 0], rotation=[0, 1, 0, 0],
        scale=[sign, 1, 1],
    )  # fmt: skip
    have = shown(model, tmp_path, (4, 2), 2.0)[..., 0]
    assert (have[:, :2] == 1.0).all()
    assert (have[:, 2:] == float(double_sided)).all()


@pytest.mark.parametrize("number", range(8))
def test_texture_transforms(tmp_path, number):
    """Every pixel shows the texel that the extension's matrices lead to."""
    rng = np.random.default_rng(number)
    transform = [
        {"offset": [0.5, 0.25]}, {"scale": [2.0, 0.5]}, {"rotation": math.pi / 2}, {},
        {"scale": [-1.0, 1.0]}, {"rotation": 0.7, "offset": [0.3, -0.1]},
        {"rotation": -0.4, "scale": [1.5, 2.5]},
        {"rotation": 2.1, "scale": [-1.5, 0.7], "offset": [-0.3, 0.6]},
    ][number]  # fmt: skip
    pixels = rng.integers(0, 256, (4, 5, 3))
    model = Model()
    texture = model.texture(pixels, **SHARP)
    texture["extensions"] = {"KHR_texture_transform": transform}
    model.glb.use("KHR_texture_transform")
    model.add(quad(-1, -1, 1, 1), model.material(unlit=True, baseColorTexture=texture))
    have = shown(model, tmp_path, (24, 24))
    x, y = transform.get("offset", (0, 0))
    turn = transform.get("rotation", 0.0)
    across, down = transform.get("scale", (1, 1))
    # The matrices of KHR_texture_transform, column by column as it prints them.
    offset = np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])
    rotation = np.array(
        [[math.cos(turn), math.sin(turn), 0], [-math.sin(turn), math.cos(turn), 0], [0, 0, 1]]
    )
    matrix = offset @ rotation @ np.diag([across, down, 1.0])
    compared = 0
    for row in range(24):
        for column in range(24):
            place = matrix @ [(column + 0.5) / 24, (row + 0.5) / 24, 1.0]
            u, v = place[0] * 5, place[1] * 4
            if min(abs(u - round(u)), abs(v - round(v))) < 1e-3:
                continue
            texel = pixels[math.floor(v) % 4, math.floor(u) % 5]
            want = [naive.srgb_decode(c / 255) for c in texel]
            assert have[row, column] == pytest.approx(want, abs=1e-5)
            compared += 1
    assert compared > 300


def test_spheres_of_growing_roughness_and_metal(tmp_path):
    """
    The rougher, the lower the highlight's peak and the wider it is; the more metal, the darker what
    is beside it and the more coloured the highlight.
    """
    model, values = Model(), (0.1, 0.3, 0.5, 0.7, 0.9)
    ball, faces = ball_arrays()
    for row, metallic in enumerate((0.0, 0.5, 1.0)):
        for column, roughness in enumerate(values):
            material = model.material(
                f"{row}{column}", baseColorFactor=[0.9, 0.4, 0.1, 1], metallicFactor=metallic,
                roughnessFactor=roughness,
            )  # fmt: skip
            model.add(ball, material, faces, translation=[2.0 * column, -2.0 * row, 0])
    have = shown(
        model, tmp_path, (200, 120), 6.0, (4, -2), lights=[rj.DirectionalLight((-0.5, -0.5, -1))]
    )
    cells = have.reshape(3, 40, 5, 40, 3).transpose(0, 2, 1, 3, 4)
    peak = cells.max(axis=(2, 3))
    assert (np.diff(peak[2, :, 0]) < 0).all()
    assert (np.diff(peak[0, :, 2]) < 0).all()
    wide = (cells[2, ..., 0] > 0.5 * peak[2, :, 0][:, None, None]).sum(axis=(1, 2))
    assert (np.diff(wide) > 0).all()
    beside = cells[:, 2, 30, 12]
    assert (np.diff(beside[:, 0]) < 0).all()
    tint = peak[:, 1, 2] / peak[:, 1, 0]
    assert (np.diff(tint) < 0).all()
    assert tint[2] == pytest.approx(0.1 / 0.9, rel=0.05)


@pytest.mark.parametrize("with_tangents", [False, True])
def test_a_normal_map_looks_like_the_geometry_it_was_made_of(tmp_path, with_tangents):
    """Waves in geometry beside the same waves in a map, under one light from the side."""
    count, height = 96, 0.004
    grid = (np.arange(count + 1) / count).astype(np.float64)
    x, y = np.meshgrid(grid, grid)
    waves = 2 * math.pi * 3
    slope_x, slope_y = (
        height * waves * np.cos(waves * x) * np.cos(waves * y),
        -height * waves * np.sin(waves * x) * np.sin(waves * y),
    )
    normals = np.stack([-slope_x, -slope_y, np.ones_like(x)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    z = height * np.sin(waves * x) * np.cos(waves * y)
    corner = np.arange(count * (count + 1)).reshape(count, count + 1)[:, :-1].ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + count + 2], axis=1),
            np.stack([corner, corner + count + 2, corner + count + 1], axis=1),
        ]
    )
    model = Model()
    plain = model.material("geometry", roughnessFactor=0.6, metallicFactor=0.3)
    geometry = {
        "POSITION": np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32),
        "NORMAL": normals.reshape(-1, 3).astype(np.float32),
    }
    model.add(geometry, plain, faces.astype(np.uint16))
    at = (np.arange(count) + 0.5) / count
    u, v = np.meshgrid(at, 1.0 - at)
    slopes = np.stack(
        [
            -height * waves * np.cos(waves * u) * np.cos(waves * v),
            height * waves * np.sin(waves * u) * np.sin(waves * v),
            np.ones_like(u),
        ],
        axis=-1,
    )
    slopes /= np.linalg.norm(slopes, axis=-1, keepdims=True)
    pixels = np.floor((slopes * 0.5 + 0.5) * 255 + 0.5)
    bumpy = model.material(
        "map", roughnessFactor=0.6, metallicFactor=0.3,
        normalTexture=model.texture(pixels, magFilter=LINEAR, minFilter=LINEAR),
    )  # fmt: skip
    attributes = quad(0, 0, 1, 1)
    if with_tangents:
        attributes["TANGENT"] = np.tile(np.float32([1, 0, 0, 1]), (4, 1))
    model.add(attributes, bumpy, translation=[1, 0, 0])
    sun = [rj.DirectionalLight((-1, 0.6, -1.2))]
    have = shown(model, tmp_path, (192, 96), 1.0, (1, 0.5), lights=sun)
    made, mapped = have[:, :96], have[:, 96:]
    assert made.std() > 0.02
    assert np.abs(made - mapped).mean() < 0.03 * made.std() + 0.002
    assert np.abs(made - mapped).max() < 0.05


def test_nodes_turn_stretch_and_move_in_this_order(tmp_path):
    """Three levels of nodes; a quad's corner lands where matrices made of axes and angles say."""
    rng = np.random.default_rng(3)
    model = Model()
    expected, parents = np.eye(4), []
    for _ in range(3):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        angle, scale, move = rng.uniform(-3, 3), rng.uniform(0.5, 2, 3), rng.normal(size=3)
        cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turn = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn @ np.diag(scale), move
        expected = expected @ matrix
        rotation = [*(math.sin(angle / 2) * axis), math.cos(angle / 2)]
        parents.append(
            {"translation": move.tolist(), "rotation": rotation, "scale": scale.tolist()}
        )
    model.add(quad(-1, -1, 1, 1), model.material(), **parents[2])
    (leaf,) = model.nodes
    middle = model.glb.add("nodes", {"name": "middle", "children": [leaf], **parents[1]})
    model.nodes = [model.glb.add("nodes", {"children": [middle], **parents[0]})]
    (node,) = rj.load(model.save(tmp_path / "a.glb")).nodes
    assert node.world_from_model == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("kind", [np.float32, np.uint8])
def test_vertex_colours_are_linear_and_multiply(tmp_path, kind):
    model = Model()
    most = 1.0 if kind is np.float32 else 255
    colors = np.array([[1, 0, 0, 1], [1, 0, 0, 1], [0, 0, 1, 1], [0, 0, 1, 1]]) * most
    attributes = {**quad(-1, -1, 1, 1), "COLOR_0": colors.astype(kind)}
    texture = model.texture(np.full((1, 1, 3), 188))
    material = model.material(unlit=True, baseColorFactor=[0.5, 1, 1, 1], baseColorTexture=texture)
    model.add(attributes, material)
    have = shown(model, tmp_path, (4, 4))
    up = (np.arange(4)[::-1] + 0.5) / 4
    texel = naive.srgb_decode(188 / 255)
    assert have[:, 1, 0] == pytest.approx(0.5 * texel * (1 - up), abs=1e-5)
    assert have[:, 1, 2] == pytest.approx(texel * up, abs=1e-5)


def test_vertex_alpha_blends(tmp_path):
    model = Model()
    colors = np.tile(np.float32([1, 1, 1, 0.25]), (4, 1))
    material = model.material(unlit=True, alphaMode="BLEND", baseColorFactor=[1, 0, 0, 0.5])
    model.add({**quad(-1, -1, 1, 1), "COLOR_0": colors}, material)
    have = shown(model, tmp_path, (2, 2), background=(0.0, 1.0, 0.0))
    assert have[0, 0] == pytest.approx([0.125, 0.875, 0.0], abs=1e-6)


def test_unlit_shows_its_colour_whatever_else_the_material_says(tmp_path):
    model = Model()
    material = model.material(
        unlit=True, baseColorFactor=[0.25, 0.5, 0.75, 1], metallicFactor=1.0,
        emissiveFactor=[1, 1, 1], occlusionTexture=model.texture(np.zeros((1, 1, 3))),
    )  # fmt: skip
    model.add(quad(-1, -1, 1, 1), material)
    have = shown(model, tmp_path, (2, 2), lights=[rj.DirectionalLight((0, 0, -1), intensity=9)])
    assert np.array_equal(have, np.broadcast_to(np.float32([0.25, 0.5, 0.75]), (2, 2, 3)))


@pytest.mark.parametrize("strength", [None, 0.0, 1.0, 4.0, 1e9])
def test_emissive_strength_multiplies_factor_and_texture(tmp_path, strength):
    model = Model()
    extensions = (
        {}
        if strength is None
        else {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    )
    material = model.material(
        baseColorFactor=[0, 0, 0, 1], metallicFactor=1.0, emissiveFactor=[1, 0.5, 0.25],
        emissiveTexture=model.texture(np.full((1, 1, 3), 188)), extensions=extensions,
    )  # fmt: skip
    model.add(quad(-1, -1, 1, 1), material)
    have = shown(model, tmp_path, (2, 2), lights=[rj.DirectionalLight((0, 0, 1))])
    factor = 1.0 if strength is None else strength
    want = factor * naive.srgb_decode(188 / 255) * np.array([1, 0.5, 0.25])
    assert have[0, 0] == pytest.approx(want, rel=1e-5)


def test_data_is_linear_and_channels_are_where_they_belong(tmp_path):
    """Occlusion in red, roughness in green, metallic in blue of one picture."""
    model = Model()
    texture = model.texture(np.array([[[51, 102, 204]]]))
    model.add(
        quad(-1, -1, 1, 1),
        model.material(
            metallicRoughnessTexture=texture, roughnessFactor=0.5,
            occlusionTexture={**texture, "strength": 0.5},
        ),
    )  # fmt: skip
    (node,) = rj.load(model.save(tmp_path / "a.glb")).nodes
    material = node.mesh.material
    texel = material.metallic_roughness_texture.image[0, 0, :3]
    assert texel == pytest.approx([0.2, 0.4, 0.8], abs=1e-7)
    assert (material.roughness, material.metallic, material.occlusion_strength) == (0.5, 1.0, 0.5)
    # One picture, decoded once for all its uses.
    assert material.occlusion_texture is material.metallic_roughness_texture


def test_the_second_set_of_coordinates_is_used_where_it_is_the_only_one(tmp_path):
    model = Model()
    texture = model.texture(np.array([[[0, 0, 0], [255, 255, 255]]]), **SHARP)
    material = model.material(unlit=True, baseColorTexture={**texture, "texCoord": 1})
    attributes = quad(-2, -1, 2, 1, uv=(1, 0, 0, 1), name="TEXCOORD_1")
    attributes["TEXCOORD_0"] = np.zeros((4, 2), np.float32)
    model.add(attributes, material)
    have = shown(model, tmp_path, (4, 2))
    assert have[0, :, 0].tolist() == [1, 1, 0, 0]


def test_textures_of_one_material_on_two_sets(tmp_path):
    """
    Base colour by TEXCOORD_0, occlusion by TEXCOORD_1, emission by what its transform names.

    A .gltf with its pictures and numbers beside it; ambient light alone, so that a pixel shows
    base colour x (1 + strength (occlusion - 1)) / 2 + emission.
    """
    rng = np.random.default_rng(5)
    pictures = {"base": rng.integers(0, 256, (4, 4, 3)), "ao": rng.integers(0, 256, (2, 8, 3)),
                "glow": rng.integers(0, 256, (8, 2, 3))}  # fmt: skip
    for name, pixels in pictures.items():
        (tmp_path / f"{name}.png").write_bytes(encode_png(pixels.astype(np.uint8)))
    first, second = quad(-1, -1, 1, 1), quad(-1, -1, 1, 1, uv=(1, -1, 0, 2), name="TEXCOORD_1")
    blocks = [first["POSITION"], first["NORMAL"], first["TEXCOORD_0"], second["TEXCOORD_1"],
              np.array([0, 1, 2, 0, 2, 3], np.uint16)]  # fmt: skip
    (tmp_path / "numbers.bin").write_bytes(b"".join(block.tobytes() for block in blocks))
    starts = np.cumsum([0, *(block.nbytes for block in blocks)]).tolist()
    kinds = ["VEC3", "VEC3", "VEC2", "VEC2", "SCALAR"]
    moved = {"texCoord": 1, "offset": [0.5, 0.0]}
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_texture_transform"],
        "extensionsRequired": ["KHR_texture_transform"],
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "buffers": [{"uri": "numbers.bin", "byteLength": starts[-1]}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": block.nbytes}
            for start, block in zip(starts[:-1], blocks, strict=True)
        ],
        "accessors": [
            {"bufferView": n, "componentType": 5123 if kind == "SCALAR" else 5126, "type": kind,
             "count": len(block)}
            for n, (kind, block) in enumerate(zip(kinds, blocks, strict=True))
        ],
        "images": [{"uri": f"{name}.png"} for name in pictures],
        "samplers": [SHARP],
        "textures": [{"source": n, "sampler": 0} for n in range(3)],
        "materials": [{
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0,
            },
            "occlusionTexture": {"index": 1, "texCoord": 1, "strength": 0.8},
            "emissiveTexture": {
                "index": 2, "texCoord": 0, "extensions": {"KHR_texture_transform": moved},
            },
            "emissiveFactor": [1.0, 0.5, 0.25],
        }],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "TEXCOORD_1": 3},
            "indices": 4, "material": 0,
        }]}],
    }  # fmt: skip
    (tmp_path / "two.gltf").write_text(json.dumps(document))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = rj.load(tmp_path / "two.gltf")
    scene.lights = [rj.AmbientLight(intensity=0.5)]
    # Without what a rough surface mirrors of it.
    mesh = scene.nodes[0].mesh
    mesh.material = replace(mesh.material, shading="phong", specular=0.0)
    frame = rj.render(scene, camera(), size=(24, 24), outputs=("linear",), threads=1)

    def texels(name, u, v):
        height, width, _ = pictures[name].shape
        columns, rows = np.floor(u * width).astype(int), np.floor(v * height).astype(int)
        return pictures[name][rows % height, columns % width] / 255.0

    # Coordinates of glTF, v down, at the pixels' centres.
    x, y = np.meshgrid((np.arange(24) + 0.5) / 24, (np.arange(24) + 0.5) / 24)
    u1, v1 = 1.0 - x, 3.0 * y - 1.0
    occlusion = 1.0 + 0.8 * (texels("ao", u1, v1)[..., :1] - 1.0)
    decode = np.vectorize(naive.srgb_decode)
    want = 0.5 * occlusion * decode(texels("base", x, y))
    want += decode(texels("glow", u1 + 0.5, v1)) * (1.0, 0.5, 0.25)
    np.testing.assert_allclose(frame.linear[..., :3], want, atol=2e-5)


def test_a_texture_whose_set_of_coordinates_is_missing_is_left_out_by_name(tmp_path):
    model = Model()
    texture = model.texture(np.full((1, 1, 3), 255))
    material = model.material(
        "wall", baseColorTexture=texture, occlusionTexture={**texture, "texCoord": 1}
    )
    model.add(quad(-1, -1, 1, 1), material)
    model.add(quad(-1, -1, 1, 1, name="TEXCOORD_1"), material)
    with pytest.warns(LoadWarning) as warned:
        scene = rj.load(model.save(tmp_path / "a.glb"))
    (message,) = (str(one.message) for one in warned)
    assert "occlusion_texture of mesh 'mesh 0', which has no coordinates for them" in message
    assert "base_color_texture of mesh 'mesh 1', which has no coordinates for them" in message
    for node, kept in zip(scene.nodes, (True, False), strict=True):
        own = node.mesh.material
        assert (own.base_color_texture is not None) == kept
        assert (own.occlusion_texture is None) == kept
    # What is left is drawn.
    assert (rj.render(scene, camera(), size=(4, 4), threads=1).color[..., 3] == 255).all()


def test_a_texture_on_a_third_set_of_coordinates_is_left_out_by_name(tmp_path):
    model = Model()
    texture = model.texture(np.full((1, 1, 3), 255))
    material = model.material(
        "wall", baseColorTexture={**texture, "texCoord": 2}, normalTexture=texture,
        occlusionTexture={**texture, "texCoord": 2}, emissiveTexture={**texture, "texCoord": 1},
    )  # fmt: skip
    attributes = quad(-1, -1, 1, 1)
    for n in (1, 2):
        attributes[f"TEXCOORD_{n}"] = attributes["TEXCOORD_0"] * (n + 1)
    model.add(attributes, material)
    with pytest.warns(
        LoadWarning,
        match=r"emissive_texture of material 'wall': third set of texture coordinates \(1\)",
    ):
        (node,) = rj.load(model.save(tmp_path / "a.glb")).nodes
    mesh = node.mesh
    assert mesh.material.emissive_texture is None
    assert mesh.material.base_color_texture.uv_set == mesh.material.occlusion_texture.uv_set == 0
    assert mesh.material.normal_texture.uv_set == 1
    assert mesh.uv[:, 0].tolist() == [0, 3, 3, 0]
    assert mesh.uv1[:, 0].tolist() == [0, 1, 1, 0]
