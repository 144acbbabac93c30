"""What is saved as glTF is loaded again as it was, or named."""

import json
import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.io.gltf.writing import normalize_as_float32, stabilize_normals
from rasterjit.io.load_warnings import SaveWarning
from rasterjit.styles.small_preview import SIZE
from rasterjit.transforms import compose, rotate, rotate_x, rotate_z, scale, translate

GEOMETRY = (
    "depth", "face_id", "object_id", "instance_id", "material_id", "barycentric", "position",
    "normal", "geometric_normal", "uv", "object_position", "attribute:heat",
)  # fmt: skip
QUAD = [(0, 1, 2), (0, 2, 3)]


def picture(seed, channels=4):
    return np.random.default_rng(seed).integers(0, 256, (8, 4, channels), dtype=np.uint8)


def quad(**options):
    corners = np.float32([(-1, -1, 0), (1, -1, 0.25), (1, 1, 0), (-1, 1, 0)])
    uv = [(0, 0), (1.5, 0.25), (1, 1), (0, 1)]
    return rj.Mesh(corners, QUAD, uv=uv, **options)


def sphere(**options):
    ball = trimesh.creation.icosphere(2)
    return rj.Mesh(np.float32(ball.vertices), ball.faces, **options)


def of(frame, name):
    kind, _, attribute = name.partition(":")
    return frame.attribute(attribute) if attribute else getattr(frame, kind)


def rich_scene():
    """Return a scene with all that glTF has a word for and no digits that it has not."""
    colors = np.random.default_rng(5).random((162, 4), dtype=np.float32)
    maps = {
        "base_color_texture": rj.Texture(
            picture(0), wrap=("mirror", "clamp"), filter="nearest", offset=(0.25, -0.5),
            rotation=30.0, scale=(2.0, -1.5),
        ),
        "normal_texture": rj.Texture(picture(1, 3), color_space="linear", uv_set=1),
        "metallic_roughness_texture": rj.Texture(
            picture(2, 3), color_space="linear", filter="bilinear"
        ),
        "occlusion_texture": rj.Texture(picture(3, 3), color_space="linear", rotation=-20.0),
        "emissive_texture": rj.Texture(picture(4, 3), wrap="clamp"),
    }  # fmt: skip
    shiny = rj.Material(
        "pbr", "#c08040", metallic=0.75, roughness=0.3, name="mapped", normal_scale=0.5,
        occlusion_strength=0.25, emissive=(2.0, 1.0, 0.5), double_sided=False, **maps,
        clearcoat=0.75, clearcoat_roughness=0.25, clearcoat_texture=maps["occlusion_texture"],
        clearcoat_normal_texture=maps["normal_texture"], clearcoat_normal_scale=0.25,
        sheen_color=(0.5, 0.25, 0.125), sheen_roughness=0.5,
        sheen_color_texture=maps["emissive_texture"],
    )  # fmt: skip
    tangents = [(1, 0, 0.1, 1), (1, 0.2, 0, -1), (0.5, 0.5, 0, 1), (1, 0, 0, 1)]
    wall = quad(material=shiny, uv1=[(0, 0), (1, 0), (1, 1), (0, 1)], tangents=tangents)
    scene = rj.Scene()
    base = scene.add(wall, rotate((1, 2, 0), 25), "base")
    elbow = rj.Node(None, translate((1.5, 0, 0.5)), "elbow", parent=base)
    glass = rj.Material(
        "pbr", (0.2, 0.9, 0.4, 0.5), alpha_mode="blend", name="glass", ior=1.75,
        specular_factor=0.5, specular_color=(2.0, 1.0, 0.5),
    )  # fmt: skip
    heat = np.random.default_rng(8).random((162, 3), dtype=np.float32)
    ball = sphere(colors=colors, material=glass, attributes={"heat": heat})
    scene.add(ball, scale((0.5, 0.75, -0.5)), "ball", parent=elbow)
    scene.add(ball, compose(translate((-1, 1, 0)), rotate_z(40), scale(0.4)), "ball", parent=base)
    leaf = rj.Texture(picture(6), filter="trilinear")
    cut = rj.Material("unlit", base_color_texture=leaf, alpha_mode="mask", alpha_cutoff=0.25)
    scene.add(quad(material=cut), compose(translate((0, -1.5, 1)), rotate_x(-50)), "leaf")
    plain = rj.Material("pbr", metallic=1.0, roughness=0.5)
    sides = np.random.default_rng(7).random((320, 3), dtype=np.float32)
    scene.add(sphere(colors=sides, material=plain), translate((-1.5, -1, 0.5)), "patchwork")
    metal = rj.Material("pbr", "grey", metallic=1.0, roughness=0.5)
    place = compose(translate((2, -1, 0)), scale(0.5))
    scene.add(sphere(material=metal), place, "grey")
    scene.add(sphere(material=metal, colors=colors), compose(place, translate((0, 1, 0))), "hue")
    scene.lights += [
        rj.DirectionalLight((0.3, -0.4, -0.8), (1.0, 0.9, 0.8), 0.75),
        rj.PointLight((2, 2, 3), "#8080ff", 4.0, range=9.0),
        rj.SpotLight((-2, 3, 3), (0.3, -0.6, -0.7), intensity=5.0, inner_angle=10, outer_angle=35),
    ]
    scene.camera = rj.PerspectiveCamera((0.5, 1, 7), (0, 0, 0), (0.1, 1, 0), 40.0, 0.5, 50.0)
    return scene


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_what_gltf_has_words_for_is_drawn_as_it_was(tmp_path, kind):
    scene, path = rich_scene(), tmp_path / f"a.{kind}"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.save(path)
    again = rj.load(path)
    assert [node.name for node in again.nodes] == [node.name for node in scene.nodes]
    assert again.find("elbow").parent is again.find("base")
    assert again.nodes[1].mesh is again.nodes[2].mesh
    for one, other in zip(again.nodes, scene.nodes, strict=True):
        np.testing.assert_array_equal(one.world_matrix, other.world_matrix)
        np.testing.assert_array_equal(
            one.mesh.vertices[one.mesh.faces], other.mesh.vertices[other.mesh.faces]
        )
    options = {"size": (96, 72), "outputs": (*GEOMETRY, "color", "linear")}
    wanted = rj.render(scene, **options)
    found = rj.render(again, scene.camera, **options)
    assert set(np.unique(wanted.object_id)) == {-1, *range(len(scene.nodes))}
    for name in GEOMETRY:
        np.testing.assert_array_equal(of(found, name), of(wanted, name), name)
    np.testing.assert_allclose(found.linear, wanted.linear, rtol=0, atol=2e-6)
    np.testing.assert_array_equal(found.color, wanted.color)
    by_its_camera = rj.render(again, size=(96, 72))
    assert (by_its_camera.color != wanted.color).any(axis=2).mean() < 0.01


@pytest.mark.parametrize("shading", ["pbr", "unlit"])
def test_a_base_color_that_is_not_given_is_written_as_it_is_drawn(tmp_path, shading):
    bare = rj.Material(shading)
    painted = replace(bare, base_color_texture=rj.Texture(picture(3, 3)))
    colors = np.random.default_rng(4).integers(0, 256, (4, 3), np.uint8)
    scene = rj.Scene()
    for n, options in enumerate(
        ({"material": bare}, {"material": bare, "colors": colors},
         {"material": bare, "colors": colors[:2]}, {"material": painted}),
    ):  # fmt: skip
        scene.add(quad(**options), translate((2.5 * n, 0, 0)))
    with pytest.warns(SaveWarning, match="with and without colours: it becomes two"):
        scene.save(tmp_path / "a.gltf")
    header = json.loads((tmp_path / "a.gltf").read_text())
    numbers = [mesh["primitives"][0]["material"] for mesh in header["meshes"]]
    grey = list(bare.base_color_over(False))
    factors = [header["materials"][n]["pbrMetallicRoughness"]["baseColorFactor"] for n in numbers]
    assert factors == [grey, [1.0] * 4, [1.0] * 4, [1.0] * 4]
    again, camera = rj.load(tmp_path / "a.gltf"), rj.fit_camera(scene, (0, 0, 1))
    assert [node.mesh.material.base_color for node in again.nodes] == [
        tuple(values) for values in factors
    ]
    wanted, found = (rj.render(one, camera, size=(96, 48)) for one in (scene, again))
    assert len(np.unique(wanted.color.reshape(-1, 4), axis=0)) > 8
    np.testing.assert_array_equal(found.color, wanted.color)


def test_lights_and_cameras_come_back_as_they_were(tmp_path):
    scene = rich_scene()
    scene.camera = rj.OrthographicCamera((1, 2, 3), (0, 0.5, 0), (0, 0, 1), 5.0, 0.5, 20.0)
    scene.save(tmp_path / "a.glb")
    again = rj.load(tmp_path / "a.glb")
    for one, other in zip(again.lights, scene.lights, strict=True):
        assert type(one) is type(other)
        for name, value in vars(other).items():
            wanted = value if value is None else pytest.approx(value, rel=1e-15, abs=1e-16)
            assert getattr(one, name) == wanted, name
    size = (60, 40)
    for of in (lambda c: c.view_matrix(), lambda c: c.projection_matrix(size)):
        np.testing.assert_allclose(of(again.camera), of(scene.camera), rtol=0, atol=1e-14)


def test_what_gltf_has_no_word_for_is_named_in_one_warning(tmp_path):
    scene = rich_scene()
    scene.add(quad(material=rj.Material(specular=0.0, name="chalk")), name="chalk")
    scene.add(quad(material=rj.Material("flat", shininess=30)), name="gloss")
    bright = rj.Texture(np.full((2, 2), 3.0), anisotropy=4)
    scene.add(quad(material=rj.Material("unlit", base_color_texture=bright, emissive="red")))
    scene.add(quad(material=rj.Material("pbr"), attributes={"wide": np.eye(5)[:4],
                                                            "label": [[1], [2]]}))  # fmt: skip
    scene.add(rj.Mesh(np.array([(0, 0, 0), (0.1, 0, 0), (0, 1, 0)]), [(0, 1, 2)],
                      uv=[(0, 0.1), (0, 0), (1, 1)]))  # fmt: skip
    scene.add(sphere(material=scene.find("patchwork").mesh.material), name="alike")
    scene.add(quad(), name="late", parent=scene.nodes[0])
    scene.lights[0] = rj.DirectionalLight(shadow=rj.Shadow())
    scene.lights.append(rj.AmbientLight())
    scene.fog, scene.vignette = rj.Fog("white", density=0.1), rj.Vignette()
    scene.camera = rj.MatrixCamera(np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0]))
    with pytest.warns(SaveWarning) as caught:
        scene.save(tmp_path / "a.glb")
    (said,) = caught
    assert said.filename == __file__
    for words in (
        "phong shading, which becomes metallic-roughness as wide",
        "flat shading, which becomes metallic-roughness as wide",
        "emission of unlit materials", "; rounded: texels, to 8 bits from 0 to 1; all",
        "anisotropy of a base_color_texture",
        "order of the objects",
        "shadow of a DirectionalLight", "AmbientLight", "fog", "vignette",
        "attribute 'wide' of more than 4 numbers", "attribute 'label' of faces",
        "MatrixCamera", "one material of meshes with and without colours",
    ):  # fmt: skip
        assert words in str(said.message), words
    again = rj.load(tmp_path / "a.glb")
    assert again.find("chalk").mesh.material.roughness == 1.0
    assert again.find("gloss").mesh.material.roughness == pytest.approx((2 / 32) ** 0.25)
    assert sorted(node.name for node in again.nodes) == sorted(node.name for node in scene.nodes)


def test_saving_warns_of_no_rounding_that_float32_means_and_of_no_shading_unasked(tmp_path):
    scene = rj.Scene()
    scene.add(rj.Mesh(np.eye(3) / 3.0, [(0, 1, 2)], material=rj.Material(base_color="red")))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.save(tmp_path / "a.glb")
    scene.add(rj.Mesh(np.eye(3) / 3.0 + 1e6, [(0, 1, 2)]), name="far")
    with pytest.warns(SaveWarning, match=r"rounded: positions of 'far', by 0.0.*all else is kept"):
        scene.save(tmp_path / "a.glb")


def test_the_models_are_drawn_with_their_rounded_positions(tmp_path):
    scene = rj.load("models/teapot.obj")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.save(tmp_path / "a.glb")
    rounded = rj.Scene()
    for node in scene.nodes:
        mesh = node.mesh
        rounded.add(rj.Mesh(np.float32(mesh.vertices), mesh.faces, normals=mesh.vertex_normals()))
    camera, outputs = rj.fit_camera(rounded), ("depth", "face_id", "position", "barycentric")
    wanted = rj.render(rounded, camera, size=SIZE, outputs=outputs)
    found = rj.render(rj.load(tmp_path / "a.glb"), camera, size=SIZE, outputs=outputs)
    for name in outputs:
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), name)
    exact = rj.render(scene, camera, size=SIZE, outputs=outputs)
    assert (found.face_id != exact.face_id).sum() < 10


def test_normals_stay_when_they_are_brought_to_unit_length_again():
    rng = np.random.default_rng(0)
    normals = normalize_as_float32(rng.normal(size=(100_000, 3)).astype(np.float32))
    normals[0] = 0.0
    assert (normalize_as_float32(normals) != normals).any(axis=1).mean() > 0.005
    lasting, lost = stabilize_normals(normals)
    assert (normalize_as_float32(lasting) != normals).any(axis=1).sum() == lost < 5
    assert np.abs(lasting - normals).max() < 0.0005


def test_a_scene_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.glb"
    path.write_bytes(b"before")
    scene = rj.Scene()
    with pytest.raises(ValueError, match="must hold at least one mesh to be saved"):
        scene.save(path)
    scene.add(sphere(material=rj.Material("pbr")), name="ball")
    holes = rj.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, math.nan)], [(0, 1, 2)], on_invalid="drop")
    far = rj.Mesh([(0, 0, 0), (1e39, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    for mesh, words in ((holes, "'bad' must have finite vertices"), (far, "that fit float32")):
        bad = scene.add(mesh, name="bad")
        with pytest.raises(ValueError, match=words):
            scene.save(path)
        scene.remove(bad)
    for name, words in (("a.obj", "must end in one of .glb, .gltf"), ("no/a.glb", "does not ex")):
        with pytest.raises(ValueError, match=words):
            scene.save(tmp_path / name)
    assert (path.read_bytes(), [one.name for one in tmp_path.iterdir()]) == (b"before", ["a.glb"])
    scene.save(str(path))
    assert len(rj.load(path).nodes) == 1


def test_a_file_is_as_other_programs_read_it(tmp_path):
    scene = rich_scene()
    scene.save(tmp_path / "a.glb")
    scene.save(tmp_path / "a.gltf")
    header = json.loads((tmp_path / "a.gltf").read_text())
    for view in header["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
    for accessor in header["accessors"]:
        assert header["bufferViews"][accessor["bufferView"]]["byteLength"] >= 4 * accessor["count"]
    assert len(header["images"]) == 6
    assert header["extensionsUsed"] == [
        "KHR_materials_emissive_strength", "KHR_texture_transform", "KHR_materials_clearcoat",
        "KHR_materials_sheen", "KHR_materials_specular", "KHR_materials_ior",
        "KHR_materials_unlit", "KHR_lights_punctual",
    ]  # fmt: skip
    other = trimesh.load_scene(tmp_path / "a.glb")
    low, high = scene.bounds()
    np.testing.assert_allclose(other.bounds, [low, high], atol=1e-6)
    assert sum(len(one.faces) for one in other.dump()) == sum(
        len(node.mesh.faces) for node in scene.nodes
    )


def test_a_camera_that_fits_any_picture_is_one_of_its_angle(tmp_path):
    scene = rich_scene()
    scene.camera = replace(scene.camera, min_aspect=1.5)
    with pytest.warns(SaveWarning, match="for min_aspect of the camera; all else"):
        scene.save(tmp_path / "a.glb")
