"""
Variants of materials, as KHR_materials_variants has them: read, switched, saved.

The file is made after the description of Khronos' sample model MaterialsVariantsShoe: one shoe,
whose variants are Midnight, Beach and Street, each with a texture of its own.
"""

import copy
import json
import pickle
import warnings

import numpy as np
import pytest
from click.testing import CliRunner
from sample_models import Model, quad

import rasterjit as rj
from rasterjit.cli.commands import program
from rasterjit.io.gltf.extensions import VARIANTS
from rasterjit.io.load_warnings import LoadWarning, SaveWarning

NAMES = ("Midnight", "Beach", "Street")
COLORS = {None: (255, 255, 0), "Midnight": (0, 0, 255), "Beach": (255, 0, 0), "Street": (0, 255, 0)}
SOLE = (9, 9, 9)
CAMERA = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=2.0, near=0.5, far=20.0)


def shoe(mappings=None, names=NAMES, texcoord=0):
    """Return a model of a shoe beside a sole, which no variant changes."""
    model = Model()
    numbers = {}
    for name, color in COLORS.items():
        texture = model.texture(np.full((2, 2, 3), color))
        if name == "Street":
            texture["texCoord"] = texcoord
        numbers[name] = model.material(str(name), unlit=True, baseColorTexture=texture)
    attributes = {**quad(-1, -1, 0, 1), "TEXCOORD_1": quad(-1, -1, 0, 1)["TEXCOORD_0"]}
    model.add(attributes, numbers[None], name="shoe")
    sole = model.texture(np.full((2, 2, 3), SOLE))
    model.add(quad(0, -1, 1, 1), model.material("sole", unlit=True, baseColorTexture=sole))
    if mappings is None:
        mappings = [
            {"material": numbers[name], "variants": [number]} for number, name in enumerate(NAMES)
        ]
    primitive = model.glb._document["meshes"][0]["primitives"][0]
    primitive["extensions"] = {VARIANTS: {"mappings": mappings}}
    model.glb.use(VARIANTS)
    model.extensions = {VARIANTS: {"variants": [{"name": name} for name in names]}}
    return model


def saved(model, path):
    return model.save(path, extensions=model.extensions)


def color_of(scene):
    """Return the colours of shoe and sole."""
    frame = rj.render(scene, CAMERA, size=(4, 4), threads=1)
    return tuple(frame.color[0, 0, :3].tolist()), tuple(frame.color[0, 3, :3].tolist())


def test_the_shoe_is_shown_in_each_variant_and_as_it_was(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = rj.load(saved(shoe(), tmp_path / "shoe.glb"))
    assert scene.variants == NAMES
    assert scene.variant is None
    for name in (None, *NAMES, None, "Beach", "Midnight", None):
        scene.variant = name
        assert scene.variant == name
        assert color_of(scene) == (COLORS[name], SOLE)


def test_a_mesh_without_the_variant_is_shown_as_it_is(tmp_path):
    mappings = [{"material": 1, "variants": [0]}, {"material": 3, "variants": [2]}]
    scene = rj.load(saved(shoe(mappings), tmp_path / "shoe.glb"))
    shown = []
    for name in NAMES:
        scene.variant = name
        shown.append(color_of(scene)[0])
    assert shown == [COLORS["Midnight"], COLORS[None], COLORS["Street"]]


def test_one_material_serves_several_variants(tmp_path):
    mappings = [{"material": 2, "variants": [0, 1]}]
    scene = rj.load(saved(shoe(mappings), tmp_path / "shoe.glb"))
    materials = scene.nodes[0].mesh.variants
    assert materials["Midnight"] is materials["Beach"]
    assert list(materials) == ["Midnight", "Beach"]


def test_a_variant_may_read_another_set_of_coordinates(tmp_path):
    """The mesh has the default's set first; the textures of the variant count from it."""
    scene = rj.load(saved(shoe(texcoord=1), tmp_path / "shoe.glb"))
    mesh = scene.nodes[0].mesh
    assert mesh.uv1 is not None
    assert mesh.variants["Street"].base_color_texture.uv_set == 1
    assert mesh.variants["Beach"].base_color_texture.uv_set == 0
    scene.variant = "Street"
    assert color_of(scene)[0] == COLORS["Street"]


@pytest.mark.parametrize("given", ["beach", "Beech", "Snow", 3])
def test_unknown_names_are_refused_with_those_there_are(tmp_path, given):
    scene = rj.load(saved(shoe(), tmp_path / "shoe.glb"))
    scene.variant = "Street"
    with pytest.raises(
        ValueError, match="variant must be one of 'Midnight', 'Beach', 'Street'"
    ) as e:
        scene.variant = given
    assert ("did you mean 'Beach'?" in str(e.value)) == (str(given)[:1] in "bB")
    assert scene.variant == "Street"
    assert color_of(scene)[0] == COLORS["Street"]


def test_scenes_without_variants_have_none():
    scene = rj.Scene()
    scene.add(rj.Mesh(np.eye(3), [[0, 1, 2]]))
    assert scene.variants == ()
    scene.variant = None
    with pytest.raises(ValueError, match="variant must be None, as the scene has no variants"):
        scene.variant = "Beach"


BAD = {
    "index": ([{"material": 1, "variants": [7]}], NAMES, "variant 7 of mesh .*has not .it has 3"),
    "negative": ([{"material": 1, "variants": [-1]}], NAMES, "variant -1 of mesh"),
    "text": ([{"material": 1, "variants": ["0"]}], NAMES, 'variant "0" of mesh'),
    "twice": (
        [{"material": 1, "variants": [0]}, {"material": 2, "variants": [0]}], NAMES,
        "second material of mesh 'mesh 0' for the variant 'Midnight'",
    ),
    "material": (
        [{"material": 99, "variants": [0]}], NAMES, "reference to material 99, which the file",
    ),
    "no material": ([{"variants": [0]}], NAMES, "mapping 0 of variants of .*material is missing"),
    "no list": ([{"material": 1, "variants": 0}], NAMES, "variants must be a list, got 0"),
    "no object": ([5], NAMES, "a mapping must be an object, got 5"),
    "mappings": ({"a": 1}, NAMES, "variants of mesh 'mesh 0', which cannot be read: mappings must"),
    "same name": ([], ("a", "b", "a"), "second variant of the name 'a'"),
    "no name": ([], ("a", None), "variant 1, which has no name"),
    "number": ([], ("a", 7), "variant 1, which has no name"),
}  # fmt: skip


@pytest.mark.parametrize("case", list(BAD))
def test_damage_is_named_and_the_rest_is_there(tmp_path, case):
    mappings, names, said = BAD[case]
    model = shoe(mappings, names)
    with pytest.warns(LoadWarning, match=said):
        scene = rj.load(saved(model, tmp_path / "shoe.glb"))
    assert color_of(scene) == (COLORS[None], SOLE)
    for name in scene.variants:
        scene.variant = name
        assert color_of(scene)[0] in (COLORS[None], COLORS["Midnight"])


def test_a_list_of_variants_that_is_none_is_named(tmp_path):
    model = shoe()
    model.extensions[VARIANTS]["variants"] = 5
    with pytest.warns(LoadWarning, match="variants must be a list, got 5"):
        scene = rj.load(saved(model, tmp_path / "shoe.glb"))
    assert scene.variants == ()


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_saved_scenes_have_their_variants_again(tmp_path, suffix):
    scene = rj.load(saved(shoe(), tmp_path / "shoe.glb"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.save(tmp_path / f"again{suffix}")
        again = rj.load(tmp_path / f"again{suffix}")
    assert again.variants == NAMES
    for name in (None, *NAMES):
        again.variant = name
        assert color_of(again) == (COLORS[name], SOLE)


def test_what_is_saved_while_a_variant_is_shown_is_the_same_file(tmp_path):
    scene = rj.load(saved(shoe(), tmp_path / "shoe.glb"))
    scene.save(tmp_path / "plain.glb")
    scene.variant = "Beach"
    with pytest.warns(SaveWarning, match="the choice of the variant 'Beach'"):
        scene.save(tmp_path / "beach.glb")
    assert (tmp_path / "beach.glb").read_bytes() == (tmp_path / "plain.glb").read_bytes()


def test_names_that_no_mesh_uses_are_kept(tmp_path):
    scene = rj.load(saved(shoe([], ("Snow",)), tmp_path / "shoe.glb"))
    assert scene.variants == ("Snow",)
    scene.save(tmp_path / "again.glb")
    assert rj.load(tmp_path / "again.glb").variants == ("Snow",)


def test_variants_can_be_made_without_a_file(tmp_path):
    mesh = rj.Mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [[0, 1, 2]])
    mesh.material = rj.Material("unlit", "black")
    mesh.variants = {"red": rj.Material("unlit", "red")}
    scene = rj.Scene()
    scene.add(mesh)
    scene.variant = "red"
    assert mesh.material == rj.Material("unlit", "red")
    assert mesh.default_material == rj.Material("unlit", "black")
    scene.variant = None
    scene.save(tmp_path / "made.glb")
    again = rj.load(tmp_path / "made.glb")
    again.variant = "red"
    assert again.nodes[0].mesh.material.base_color == (1.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("given", [5, {"a": 5}, {3: rj.Material()}, {"": rj.Material()}])
def test_what_are_no_variants_is_refused(given):
    with pytest.raises(ValueError, match=r"^variants"):
        rj.Mesh(np.eye(3), [[0, 1, 2]]).variants = given


def test_lines_and_points_have_variants_of_materials_that_they_can_have():
    lines, points = rj.Lines([(0, 0, 0), (1, 1, 0)], [(0, 1)]), rj.Points([(0, 0, 0)])
    with pytest.raises(ValueError, match=r"^variants\['a'\] must be unlit, for lines have no norm"):
        lines.variants = {"a": rj.Material("pbr")}
    with pytest.raises(ValueError, match=r"^variants\['a'\] must be shaded 'unlit', 'phong'"):
        points.variants = {"a": rj.Material("gouraud")}
    lines.variants = points.variants = {"a": rj.Material("unlit", "red")}
    scene = rj.Scene()
    scene.add(lines)
    scene.add(points)
    scene.variant = "a"
    assert lines.material == points.material == rj.Material("unlit", "red")


@pytest.mark.parametrize("made", [copy.deepcopy, lambda scene: pickle.loads(pickle.dumps(scene))])
def test_copies_have_variants_of_their_own(tmp_path, made):
    scene = rj.load(saved(shoe(), tmp_path / "shoe.glb"))
    scene.variant = "Beach"
    other = made(scene)
    assert (other.variants, other.variant) == (NAMES, "Beach")
    other.variant = None
    assert color_of(other)[0] == COLORS[None]
    assert color_of(scene)[0] == COLORS["Beach"]


def test_variants_come_along_with_what_is_added(tmp_path):
    shoes = rj.load(saved(shoe(), tmp_path / "shoe.glb"))
    room = rj.Scene()
    room.add(shoes)
    assert room.variants == NAMES
    room.variant = "Street"
    assert color_of(room)[0] == COLORS["Street"]


def test_a_material_that_is_assigned_is_the_meshs_own(tmp_path):
    """Whatever variant was shown: it comes back with none, and is what is saved."""
    scene = rj.load(saved(shoe(), tmp_path / "a.glb"))
    mesh, first = scene.nodes[0].mesh, scene.variants[0]
    own = rj.Material("unlit", "white")
    scene.variant = first
    mesh.material = own
    assert mesh.material is mesh.default_material is own
    scene.variant = first
    assert mesh.material is mesh.variants[first]
    scene.variant = None
    assert mesh.material is own
    scene.save(tmp_path / "b.glb")
    assert rj.load(tmp_path / "b.glb").nodes[0].mesh.material.shading == "unlit"


def test_split_meshes_keep_their_variants():
    mesh = rj.Mesh(np.eye(3), [[0, 1, 2]])
    mesh.variants = {"red": rj.Material("unlit", "red")}
    mesh.show_variant("red")
    for other in (mesh.split_creases(), mesh.without_colors()):
        assert dict(other.variants) == dict(mesh.variants)
        other.show_variant(None)
        assert other.material == rj.Material()
    assert mesh.material == rj.Material("unlit", "red")


def test_the_command_line_shows_and_lists_variants(tmp_path):
    file = saved(shoe(), tmp_path / "shoe.glb")
    picture = tmp_path / "shoe.png"
    run = CliRunner().invoke
    said = run(program, ["info", str(file)])
    assert "variants         'Midnight', 'Beach', 'Street'" in said.output
    assert json.loads(run(program, ["info", "--json", str(file)]).output)["variants"] == [*NAMES]
    options = ["render", str(file), "-o", str(picture), "--size", "40x20", "--style", "plain"]
    assert run(program, [*options, "--variant", "Beach"]).exit_code == 0
    pixels = rj.Texture.from_file(picture).image
    assert (pixels == [1, 0, 0, 1]).all(axis=-1).any()
    wrong = run(program, [*options, "--variant", "Beech"])
    assert wrong.exit_code != 0
    assert "--variant must be one of 'Midnight', 'Beach', 'Street'" in wrong.output
    assert "did you mean 'Beach'?" in wrong.output
    assert run(program, ["explain", str(file), "--variant", "Beach"]).exit_code == 0
