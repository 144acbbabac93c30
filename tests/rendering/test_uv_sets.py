"""Textures of one material that are laid by different texture coordinates of its mesh."""

from __future__ import annotations

import copy
import itertools
import pickle
from dataclasses import replace
from fractions import Fraction

import naive_textures
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.rendering import planning
from rasterjit.scene.material import CORE_TEXTURES
from rasterjit.survey import packed_scene

SIZE = (72, 54)
CAMERA = rj.PerspectiveCamera(eye=(1.6, 1.1, 2.4), target=(0.1, -0.1, 0.0), near=0.2, far=60.0)


def texture(seed, **options):
    """Return a texture of random texels; as a normal map it leans by all angles."""
    texels = np.random.default_rng(seed).integers(40, 256, (16, 16, 4), np.uint8)
    return rj.Texture(texels, **options)


def textures(sets=(0,) * 5, **options):
    """Return a texture of each kind, each laid by one of the sets."""
    spaces = ["srgb", "linear", "linear", "linear", "srgb"]
    return {
        name: texture(n, color_space=space, uv_set=uv_set, **options)
        for n, (name, space, uv_set) in enumerate(zip(CORE_TEXTURES, spaces, sets, strict=True))
    }


def ball_arrays(rows=9, columns=16):
    """Return vertices, faces and two sets of coordinates of a ball, the second mirrored in part."""
    row, column = (part.ravel() for part in np.mgrid[0 : rows + 1, 0 : columns + 1])
    polar, around = row * (np.pi / rows), column * (2.0 * np.pi / columns)
    vertices = np.stack(
        [np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], axis=1
    )
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = corner + columns + 1
    faces = np.concatenate(
        [np.stack([corner, corner + 1, below + 1], 1), np.stack([corner, below + 1, below], 1)]
    )
    first = np.stack([column / 4.0, row / 3.0], axis=1)
    second = np.stack([np.abs(vertices[:, 0]) * 3.0, vertices[:, 1] * 2.0 - column / 8.0], axis=1)
    return vertices, faces, first, second


BALL = ball_arrays()
GROUND = np.array([[-30.0, -1, -30], [30, -1, -30], [30, -1, 30], [-30, -1, 30]])
GROUND_FACES = [[0, 2, 1], [0, 3, 2]]


def scene_of(material, first=None, second=None, gives_tangents=False):
    """
    Return a ball above a ground that is cut, lit and shadowed, and objects without textures.

    ``first`` and ``second`` say which coordinates are ``uv`` and ``uv1``: 0, 1 or None for none.
    """
    scene, flat = rj.Scene(), GROUND[:, [0, 2]]
    for vertices, faces, own in (
        (BALL[0], BALL[1], BALL[2:]),
        (GROUND, GROUND_FACES, (flat, flat[:, ::-1] * (0.4, -0.7))),
    ):
        uv, uv1 = (None if n is None else own[n] for n in (first, second))
        tangents = np.tile([1.0, 0.5, 0.2, 1.0], (len(vertices), 1)) if gives_tangents else None
        mesh = rj.Mesh(vertices, faces, uv=uv, uv1=uv1, tangents=tangents, material=material)
        scene.add(mesh)
    for n, shading in enumerate(("gouraud", "unlit")):
        place = rj.transforms.translate((0.5 + 0.4 * n, 0.7, 0.7))
        scene.add(rj.Mesh(BALL[0] * 0.2, BALL[1], material=rj.Material(shading)), place)
    scene.lights = [
        rj.AmbientLight(intensity=0.3),
        rj.DirectionalLight((-1, -2, -1), shadow=rj.Shadow(size=256)),
        rj.PointLight((1.0, 1.0, 2.0)),
    ]
    return scene


def drawn(scene, quality=None, outputs=("color", "linear")):
    """Return the arrays of a frame."""
    return rj.render(
        scene, CAMERA, size=SIZE, quality=quality, outputs=outputs, background="black", threads=1
    ).arrays()


def assert_same_bits(one, other):
    assert list(one) == list(other)
    for name, array in one.items():
        assert array.tobytes() == other[name].tobytes(), name


QUALITIES = [
    {}, {"texture_filter": "anisotropic8"}, {"texture_filter": "nearest"}, {"samples": 4},
    {"samples": "area"}, {"samples": 64}, {"interpolation": "affine"}, {"shading": "face"},
]  # fmt: skip


@pytest.mark.parametrize("settings", QUALITIES, ids=str)
@pytest.mark.parametrize("sets", [(0, 1, 1, 1, 1), (0, 0, 1, 0, 1), (1, 0, 1, 1, 0)], ids=str)
def test_sets_that_are_equal_are_one(sets, settings):
    quality = rj.Quality(**settings)
    look = {"shading": "pbr", "emissive": "white", "alpha_mode": "mask", "alpha_cutoff": 0.4}
    apart = scene_of(rj.Material(**textures(sets), **look), 0, 0)
    alone = scene_of(rj.Material(**textures(), **look), 0)
    assert_same_bits(drawn(apart, quality), drawn(alone, quality))


@pytest.mark.parametrize("settings", QUALITIES[:4], ids=str)
@pytest.mark.parametrize("shading", ["pbr", "phong", "flat", "gouraud", "unlit"])
def test_the_numbers_of_sets_may_be_swapped(shading, settings):
    quality, look = rj.Quality(**settings), {"shading": shading, "emissive": "white"}
    sets = np.array([0, 1, 0, 1, 1])
    one = drawn(scene_of(rj.Material(**textures(sets.tolist()), **look), 0, 1), quality)
    other = drawn(scene_of(rj.Material(**textures((1 - sets).tolist()), **look), 1, 0), quality)
    assert_same_bits(one, other)
    alone = drawn(scene_of(rj.Material(**textures(), **look), 0), quality)
    assert not np.array_equal(one["linear"], alone["linear"])


@pytest.mark.parametrize("gives_tangents", [False, True], ids=["", "tangents"])
@pytest.mark.parametrize("filter", ["trilinear", "bilinear"])
@pytest.mark.parametrize("kind", range(1, 5))
def test_a_kind_on_a_second_set_is_that_kind_on_a_first(kind, filter, gives_tangents):
    white = rj.Texture(np.ones((1, 1, 4), np.float32), filter=filter)
    name = CORE_TEXTURES[kind]
    look = {"shading": "pbr", "metallic": 0.7, "roughness": 0.8, "base_color_texture": white}
    found, wanted = (
        drawn(
            scene_of(
                rj.Material(**look, **{name: textures((uv_set,) * 5, filter=filter)[name]}),
                *sets, gives_tangents,
            )
        )
        for uv_set, sets in ((1, (0, 1)), (0, (1, None)))
    )  # fmt: skip
    assert_same_bits(found, wanted)


@pytest.mark.parametrize("kind", range(1, 4))
def test_what_is_read_after_a_second_set_lies_by_the_first(kind):
    look = {"shading": "pbr", "emissive": "white"}
    found, wanted = (
        drawn(
            scene_of(
                rj.Material(
                    **{
                        **textures(),
                        CORE_TEXTURES[kind]: rj.Texture(
                            np.full((1, 1, 3), 0.7, np.float32), uv_set=uv_set
                        ),
                    },
                    **look,
                ),
                0, 1, gives_tangents=True,
            )
        )
        for uv_set in (1, 0)
    )  # fmt: skip
    assert_same_bits(found, wanted)


def test_each_texture_is_laid_by_its_own_set():
    """Base colour and emission of every pixel are what exact arithmetic reads by weights."""
    options = {"filter": "bilinear", "wrap": ("repeat", "mirror")}
    base, shine = (
        texture(n, color_space="linear", uv_set=uv_set, **options) for n, uv_set in ((3, 1), (4, 0))
    )
    material = rj.Material("unlit", base_color_texture=base, emissive_texture=shine)
    scene = scene_of(material, 0, 1)
    del scene.nodes[1:]
    frame = drawn(scene, outputs=("linear", "face_id", "barycentric"))
    images = [
        [naive_textures.exact_image(one.image[:, :, channel]) for channel in range(3)]
        for one in (base, shine)
    ]
    pixels = np.argwhere(frame["face_id"] >= 0)
    assert len(pixels) > 300
    for row, column in pixels[::7]:
        corners = BALL[1][frame["face_id"][row, column]]
        weights = [Fraction(float(w)) for w in frame["barycentric"][row, column]]
        for channel in range(3):
            want = 0.0
            for image, own in zip(images, (BALL[3], BALL[2]), strict=True):
                ends = np.float32(own[corners]).tolist()
                u, v = (
                    sum(w * Fraction(end[k]) for w, end in zip(weights, ends, strict=True))
                    for k in range(2)
                )
                want += float(naive_textures.bilinear(image[channel], u, v, options["wrap"]))
            assert frame["linear"][row, column, channel] == pytest.approx(want, abs=1e-5)


@pytest.mark.parametrize("sets", list(itertools.product((0, 1), repeat=2)), ids=str)
def test_holes_follow_the_set_of_the_base_colour(sets):
    holes, shine = (texture(n, uv_set=uv_set) for n, uv_set in zip((1, 2), sets, strict=True))
    look = {"alpha_mode": "mask", "alpha_cutoff": 0.6, "emissive_texture": shine}
    scene = scene_of(rj.Material("phong", base_color_texture=holes, **look), 0, 1)
    alone = rj.Material("phong", base_color_texture=holes.with_uv_set(0), **look)
    alone = scene_of(replace(alone, emissive_texture=None), sets[0])
    found, wanted = (drawn(one, outputs=("face_id", "depth")) for one in (scene, alone))
    assert_same_bits(found, wanted)


def test_output_uv_is_the_first_set():
    material = rj.Material(base_color_texture=texture(1, uv_set=1))
    found, wanted = (
        drawn(scene_of(one, *sets), outputs=("uv",))
        for one, sets in ((material, (0, 1)), (rj.Material(), (0,)))
    )
    assert_same_bits(found, wanted)


def test_scenes_of_one_set_join_and_run_nothing_more(monkeypatch):
    joined, original = [], packed_scene.join_uv

    def join(meshes, kind=None):
        joined.append(kind)
        return original(meshes, kind)

    monkeypatch.setattr(packed_scene, "join_uv", join)
    stages = {}
    for sets in ((0,) * 5, (1,) * 5, (0, 0, 0, 1, 0)):
        joined.clear()
        material = rj.Material("pbr", **textures(sets))
        frame = rj.render(scene_of(material, 0, 1), CAMERA, size=SIZE, threads=1)
        stages[sets] = [stage.name for stage in planning.list_passes(frame.plan)]
        assert joined == ([0] if len(set(sets)) == 1 else [0, 3])
    one, other, apart = stages.values()
    assert one == other
    again = ["barycentric_weights.find_weights", "uv_derivatives.interpolate_uv"]
    again.append("uv_derivatives.find_uv_steps")
    place = apart.index("material_maps.apply_occlusion_maps")
    assert apart[place - 4 : place] == [*again, "texture_lookup.read_textures"]
    assert apart[place + 1 : place + 4] == again
    assert apart[: place - 4] + apart[place - 1 : place + 1] + apart[place + 4 :] == one


@pytest.mark.parametrize(
    ("sets", "wanted", "field"),
    [((0, None), "uv1", "occlusion_texture"), ((None, 1), "uv", "base_color_texture")],
)
def test_a_texture_without_its_coordinates_is_refused(sets, wanted, field):
    own = {"base_color_texture": texture(0), "occlusion_texture": texture(1, uv_set=1)}
    scene = scene_of(rj.Material("phong", **own), *sets)
    with pytest.raises(ValueError, match=rf"must have {wanted}, for its material has a {field}"):
        rj.explain(scene, CAMERA)


def test_sets_are_checked_by_name():
    vertices, faces, first, second = BALL
    with pytest.raises(ValueError, match=r"uv1 must have shape"):
        rj.Mesh(vertices, faces, uv=first, uv1=second[1:])
    with pytest.raises(ValueError, match="uv1 must be finite"):
        rj.Mesh(vertices, faces, uv1=np.full_like(second, np.nan))
    for wrong in (2, -1, True, 0.5, "uv1"):
        with pytest.raises(ValueError, match="uv_set must be one of 0, 1"):
            texture(0, uv_set=wrong)
        with pytest.raises(ValueError, match="uv_set must be one of 0, 1"):
            texture(0).with_uv_set(wrong)
    with pytest.raises(ValueError, match="must have uv1 or tangents"):
        rj.Mesh(vertices, faces, uv=first).vertex_tangents(None, 1)


def test_sets_stay_with_copies_of_mesh_and_texture():
    vertices, faces, first, second = BALL
    mesh = rj.Mesh(vertices, faces, uv=first, uv1=second)
    assert mesh.uv1.dtype == np.float32
    assert not mesh.uv1.flags.writeable
    split = mesh.split_creases(10.0)
    assert len(split.vertices) > len(vertices)
    for one in (split, pickle.loads(pickle.dumps(mesh)), copy.deepcopy(mesh)):
        for name in ("uv", "uv1"):
            own, wanted = getattr(one, name)[one.faces], getattr(mesh, name)[faces]
            assert own.tobytes() == wanted.tobytes()
    # Coordinates keep vertices apart that positions alone would merge.
    loose = rj.Mesh(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3),
                    uv1=second[faces].reshape(-1, 2))  # fmt: skip
    assert len(loose.split_creases(180.0).vertices) == faces.size
    other = texture(0, uv_set=1)
    for one in (other.with_filter("nearest"), other.with_transform((0.5, 0.0)),
                pickle.loads(pickle.dumps(other))):  # fmt: skip
        assert one.uv_set == 1
    assert other.with_uv_set(0).pyramid is other.pyramid
    morphing = rj.animation.MorphTrack([0.0, 1.0], mesh, [vertices, vertices * 2.0])
    assert morphing(0.5).uv1.tobytes() == mesh.uv1.tobytes()
