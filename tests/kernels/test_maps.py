"""Maps: normals equal naive ones wherever a picture lies; neutral maps change no bit."""

from __future__ import annotations

from dataclasses import replace

import naive_materials
import numpy as np
import pytest
import stages

import rasterjit as rj
from rasterjit.scene.material import Material

SIZE = (16, 12)
CAMERA = rj.OrthographicCamera(eye=(0, 0, 20), target=(0, 0, 0), height=2.0, near=1.0, far=60.0)
AXES = [((-1, 0, 0), (1, 0, 0)), ((0, -1, 0), (0, 1, 0)), ((0, 0, -1), (0, 0, 1))]
"""Directions of light and its colour: what a white, matt surface shows is its normal."""


def texture(*texel, **options):
    """Return a texture of one colour, linear."""
    return rj.Texture(np.full((2, 2, len(texel)), texel, np.float32), **options)


def companions():
    """
    Return objects that have all that materials can have, to be placed outside the picture.

    With them a scene is shaded by the one kernel that knows everything, whatever else is in it.
    """
    full = texture(0.5, 0.5, 1.0)
    everything = Material(
        shading="pbr", base_color_texture=full, normal_texture=full, emissive="white",
        metallic_roughness_texture=full, occlusion_texture=full, emissive_texture=full,
    )  # fmt: skip
    return [square(everything), square(Material(shading="phong"))]


def seen(
    mesh, transform=None, lights=None, threads=1, camera=CAMERA, size=SIZE, alone=False,
    quality=None,
):  # fmt: skip
    """Return the linear colours, (H, W, 3); with companions unless the mesh is to be alone."""
    scene = rj.Scene()
    scene.add(mesh, transform)
    for companion in () if alone else companions():
        scene.add(companion, rj.transforms.translate((1000.0, 0, 0)))
    if lights is None:
        scene.lights = [rj.DirectionalLight(way, color) for way, color in AXES]
    else:
        scene.lights = lights
    frame = rj.render(
        scene, camera, size=size, outputs=("linear", "face_id"), background="black",
        threads=threads, quality=quality,
    )  # fmt: skip
    return np.where(frame.face_id[..., np.newaxis] >= 0, frame.linear[..., :3], np.nan)


EXACT = rj.Quality(interpolation_precision="float64")
"""As objects with textures are found; without them, they would take float32."""

MATT = Material(shading="phong", base_color="white", specular=0.0)

SQUARE = np.array([[-1.5, -1.5, 0], [1.5, -1.5, 0], [1.5, 1.5, 0], [-1.5, 1.5, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UPRIGHT = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)


def square(material, **options):
    return rj.Mesh(SQUARE, FACES, uv=UPRIGHT, material=material, **options)


def random_turn(rng, mirrored):
    """Return a matrix that turns, stretches and perhaps mirrors."""
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    if (np.linalg.det(axes) < 0) != mirrored:
        axes[:, 0] = -axes[:, 0]
    matrix = np.eye(4)
    matrix[:3, :3] = axes @ np.diag(rng.uniform(0.5, 2.0, 3)) * 10.0
    return matrix


@pytest.mark.parametrize("shading_model", ["phong", "flat"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_normals_equal_naive_however_the_picture_lies(shading_model, mirrored):
    """Random triangles, placements, mirrored or not, seen from either side, and coordinates."""
    rng = np.random.default_rng(1 + mirrored)
    sides = set()
    for _ in range(40):
        corners, uv = rng.uniform(-1, 1, (3, 3)), rng.uniform(-2, 2, (3, 2))
        corners -= corners.mean(axis=0)
        face = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        smooth = face / np.linalg.norm(face) + rng.normal(size=3) * 0.2
        texel = np.append(rng.uniform(0.2, 0.8, 2), rng.uniform(0.6, 1.0)).astype(np.float32)
        scale = rng.uniform(0.2, 2.0)
        material = replace(
            MATT, shading=shading_model, normal_texture=texture(*texel), normal_scale=scale
        )
        mesh = rj.Mesh(corners, [[0, 1, 2]], normals=[smooth] * 3, uv=uv, material=material)
        matrix = random_turn(rng, mirrored)
        turn, inverse = matrix[:3, :3], np.linalg.inv(matrix[:3, :3]).T
        normal = inverse @ (face if shading_model == "flat" else smooth)
        have = seen(mesh, matrix)[6, 8]
        if np.isnan(have).any():
            continue
        along_u, along_v = naive_materials.tangent_frame(
            (corners @ turn.T).tolist(), mesh.uv.astype(float).tolist()
        )
        want = np.array(
            naive_materials.bent(normal.tolist(), along_u, along_v, texel.tolist(), scale)
        )
        is_behind = (inverse @ face)[2] < 0.0
        sides.add(is_behind)
        want = -want if is_behind else want
        assert have == pytest.approx(np.maximum(want, 0.0), abs=1e-4)
    assert sides == {False, True}


def test_a_normal_map_tilts_to_where_u_and_v_grow():
    for texel, way in (((1.0, 0.5, 0.5), 0), ((0.5, 1.0, 0.5), 1), ((0.5, 0.5, 1.0), 2)):
        have = seen(square(replace(MATT, normal_texture=texture(*texel))))
        assert have[5, 5] == pytest.approx(np.eye(3)[way], abs=1e-6)


def test_a_turned_picture_turns_its_normals():
    """A texture turned by 90 degrees: its x runs where the picture's columns now run."""
    turned = texture(1.0, 0.5, 0.5).with_transform(rotation=90.0)
    a, b, _, d, e, _ = turned.transform
    along_u = np.linalg.inv(np.array([[a, b], [d, e]]))[:, 0]
    have = seen(square(replace(MATT, normal_texture=turned)))
    assert have[5, 5] == pytest.approx([*np.maximum(along_u, 0.0), 0.0], abs=1e-6)


def test_given_tangents_rule_and_their_side_turns_y():
    normals = np.tile([0.0, 0, 1], (4, 1))
    material = replace(MATT, normal_texture=texture(0.5, 1.0, 0.5))
    for way, sign, want in (
        ((1, 0, 0), 1, (0, 1, 0)), ((-1, 0, 0), -1, (0, 1, 0)), ((0, -1, 0), 1, (1, 0, 0)),
    ):  # fmt: skip
        mesh = square(material, normals=normals, tangents=np.tile([*way, sign], (4, 1)))
        assert seen(mesh)[5, 5] == pytest.approx(want, abs=1e-6)


def test_given_tangents_that_are_those_of_the_picture_show_the_same():
    rng = np.random.default_rng(3)
    normals = np.tile([0.1, 0.2, 1], (4, 1))
    image = np.clip(rng.normal(size=(8, 8, 3)) * 0.1 + [0.5, 0.5, 0.9], 0, 1).astype(np.float32)
    material = replace(MATT, normal_texture=rj.Texture(image))
    own = seen(square(material, normals=normals))
    given = seen(square(material, normals=normals, tangents=np.tile([1, 0, 0, 1], (4, 1))))
    assert given == pytest.approx(own, abs=1e-5)


def test_normals_are_mirrored_at_a_mirrored_seam():
    """Two halves that share the vertices of the seam and show one picture, mirrored."""
    vertices = [[-1, -1, 0], [0, -1, 0], [1, -1, 0], [-1, 1, 0], [0, 1, 0], [1, 1, 0]]
    faces = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]
    uv = [[0, 0], [1, 0], [0, 0], [0, 1], [1, 1], [0, 1]]
    material = replace(MATT, normal_texture=texture(0.75, 0.625, 1.0))
    mesh = rj.Mesh(vertices, faces, normals=[[0, 0, 1]] * 6, uv=uv, material=material)
    lights = [rj.DirectionalLight((-1, 0, 0), (1, 0, 0)), rj.DirectionalLight((1, 0, 0), (0, 1, 0))]
    have = seen(mesh, lights=lights, size=(16, 16))
    left, right = have[:, :8], have[:, 8:]
    assert (left[..., 0] > 0.3).all()
    assert (left[..., 1] == 0.0).all()
    assert np.array_equal(right[:, ::-1, 1], left[..., 0])


@pytest.mark.parametrize("uv", [[[0.5, 0.5]] * 4, [[0, 0], [1, 1], [2, 2], [3, 3]]])
def test_a_picture_without_area_leaves_the_normal_as_it_is(uv):
    normals = np.tile([0.3, 0.2, 1], (4, 1))
    bumpy = replace(MATT, normal_texture=texture(0.9, 0.2, 0.6))
    mesh = rj.Mesh(SQUARE, FACES, uv=uv, normals=normals, material=bumpy)
    plain = rj.Mesh(SQUARE, FACES, uv=uv, normals=normals, material=MATT)
    assert seen(mesh).tobytes() == seen(plain).tobytes()


@pytest.mark.parametrize("tangent", [(0, 0, 0, 1), (0.3, 0.2, 1, 1)])
def test_a_tangent_of_no_length_or_along_the_normal_leaves_the_normal_as_it_is(tangent):
    normals = np.tile([0.3, 0.2, 1], (4, 1))
    bumpy = replace(MATT, normal_texture=texture(0.9, 0.2, 0.6))
    mesh = square(bumpy, normals=normals, tangents=np.tile(tangent, (4, 1)))
    assert seen(mesh) == pytest.approx(seen(square(MATT, normals=normals)), abs=1e-6)


@pytest.mark.parametrize("texel", [(0.5, 0.5, 0.5), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
def test_no_texel_makes_a_normal_nan(texel):
    have = seen(square(replace(MATT, normal_texture=texture(*texel))))
    assert np.isfinite(have).all()


PBR = Material(
    shading="pbr", base_color=(0.8, 0.5, 0.2), metallic=0.3, roughness=0.4, emissive=(0.1, 0.2, 0.3)
)
LIGHTS = [
    rj.DirectionalLight((-0.3, -0.5, -1), (1, 0.9, 0.8)), rj.PointLight((1, 1, 2), intensity=2),
    rj.AmbientLight(intensity=0.2),
]  # fmt: skip


NEUTRAL = {
    "normal_texture": (0.5, 0.5, 1.0), "metallic_roughness_texture": (1.0, 1.0, 1.0),
    "occlusion_texture": (1.0, 1.0, 1.0), "emissive_texture": (1.0, 1.0, 1.0),
}  # fmt: skip


@pytest.mark.parametrize("model", ["pbr", "phong", "flat"])
@pytest.mark.parametrize("field", NEUTRAL)
def test_a_neutral_map_equals_none_bit_for_bit(model, field):
    plain = replace(PBR, shading=model)
    normals = np.tile([0.3, 0.2, 1], (4, 1))
    mapped = square(replace(plain, **{field: texture(*NEUTRAL[field])}), normals=normals)
    bare = square(plain, normals=normals)
    have, want = (seen(mesh, lights=LIGHTS, quality=EXACT) for mesh in (mapped, bare))
    assert have.tobytes() == want.tobytes()


@pytest.mark.parametrize("model", ["pbr", "phong", "flat"])
def test_neutral_maps_equal_a_kernel_that_knows_no_maps_bit_for_bit(model):
    plain = replace(PBR, shading=model, emissive="black")
    maps = {field: texture(*texel) for field, texel in NEUTRAL.items()}
    normals = np.tile([0.3, 0.2, 1], (4, 1))
    mapped = square(replace(plain, **maps, emissive="black"), normals=normals)
    bare = square(plain, normals=normals)
    have = seen(mapped, lights=LIGHTS, quality=EXACT)
    want = seen(bare, lights=LIGHTS, alone=True, quality=EXACT)
    assert have.tobytes() == want.tobytes()


@pytest.mark.parametrize("model", ["pbr", "phong", "flat", "gouraud", "unlit"])
def test_black_emission_equals_none_bit_for_bit(model):
    plain = replace(PBR, shading=model, emissive="black")
    black = replace(plain, emissive="white", emissive_texture=texture(0.0, 0.0, 0.0))
    have, want = (seen(square(m), lights=LIGHTS, quality=EXACT) for m in (black, plain))
    assert have.tobytes() == want.tobytes()


def test_roughness_is_green_and_metallic_is_blue():
    metallic, roughness = np.float32(0.3), np.float32(0.6)
    mapped = replace(
        PBR, metallic=1.0, roughness=1.0,
        metallic_roughness_texture=texture(0.123, roughness, metallic),
    )  # fmt: skip
    plain = replace(PBR, metallic=float(metallic), roughness=float(roughness))
    have, want = (seen(square(m), lights=LIGHTS, quality=EXACT) for m in (mapped, plain))
    assert have.tobytes() == want.tobytes()


@pytest.mark.parametrize("model", ["pbr", "phong", "flat"])
@pytest.mark.parametrize("strength", [0.0, 0.25, 1.0])
def test_occlusion_is_red_and_holds_back_ambient_light_alone(model, strength):
    plain = replace(PBR, shading=model, emissive="black")
    mapped = replace(plain, occlusion_texture=texture(0.5, 0.9, 0.1), occlusion_strength=strength)
    ambient, sun = [rj.AmbientLight(intensity=0.5)], [rj.DirectionalLight((0, 0, -1))]
    share = 1.0 + strength * (0.5 - 1.0)
    dimmed, full = (seen(square(m), lights=ambient) for m in (mapped, plain))
    assert dimmed == pytest.approx(share * full, rel=1e-6)
    assert seen(square(mapped), lights=sun).tobytes() == seen(square(plain), lights=sun).tobytes()


@pytest.mark.parametrize("model", ["pbr", "phong", "flat", "gouraud", "unlit"])
def test_emission_is_added_to_what_light_shows(model):
    plain = replace(PBR, shading=model, emissive="black")
    glowing = replace(plain, emissive=(2.0, 0.5, 0.0), emissive_texture=texture(0.5, 1.0, 1.0))
    have, bare = (seen(square(m), lights=LIGHTS) for m in (glowing, plain))
    assert have == pytest.approx(bare + [1.0, 0.5, 0.0], abs=1e-6)


def test_emission_needs_no_texture_and_no_light():
    mesh = rj.Mesh(SQUARE, FACES, material=replace(MATT, base_color="black", emissive=(3, 2, 1)))
    have = seen(mesh, lights=[rj.DirectionalLight((0, 0, 1))], alone=True)
    assert np.array_equal(have, np.broadcast_to([3.0, 2.0, 1.0], have.shape))


def test_emission_is_added_where_nothing_is_lit():
    glowing = Material(shading="unlit", base_color=(0.5, 0.25, 0.0), emissive=(0.25, 0.0, 2.0))
    have = seen(square(glowing), alone=True)
    assert np.array_equal(have, np.broadcast_to([0.75, 0.25, 2.0], have.shape))


def test_each_object_has_its_own_maps():
    """Objects with and without maps in one row of pixels show what they show alone."""
    rng = np.random.default_rng(5)
    bumpy = rng.uniform(0.3, 1.0, (4, 4, 3)).astype(np.float32)
    materials = [
        PBR,
        replace(PBR, normal_texture=rj.Texture(bumpy), normal_scale=0.5),
        replace(MATT, occlusion_texture=texture(0.3)),
        replace(PBR, metallic_roughness_texture=rj.Texture(bumpy), emissive="black"),
        Material(shading="unlit", base_color="red"),
    ]
    scene, alone = rj.Scene(), []
    for n, material in enumerate(materials):
        narrow = rj.transforms.compose(
            rj.transforms.translate((0.6 * n - 1.2, 0, 0)), rj.transforms.scale((0.19, 1, 1))
        )
        scene.add(square(material), narrow)
        single = rj.Scene()
        single.add(square(material), narrow)
        for companion in companions():
            single.add(companion, rj.transforms.translate((1000.0, 0, 0)))
        alone.append(single)
    frames = []
    for each in (scene, *alone):
        each.lights = LIGHTS
        frames.append(
            rj.render(each, CAMERA, size=(60, 36), outputs=("linear", "object_id"), threads=1)
        )
    for n, single in enumerate(frames[1:]):
        shown = frames[0].object_id == n
        assert shown.sum() > 50
        assert np.array_equal(frames[0].linear[shown], single.linear[shown])


def test_a_scene_without_maps_that_are_read_has_no_stages_nor_records(monkeypatch):
    from rasterjit.rendering import frame_shading

    surfaces, ran = [], []
    whole = frame_shading.find_surface
    monkeypatch.setattr(
        frame_shading, "find_surface", lambda *given: surfaces.append(whole(*given)) or surfaces[-1]
    )
    plain = square(MATT)
    unread = square(replace(MATT, metallic_roughness_texture=texture(0.5, 0.5, 0.5)))
    read = square(replace(MATT, occlusion_texture=texture(0.5, 0.5, 0.5)))
    for mesh in (plain, unread, read):
        with stages.lists_run() as lists:
            seen(mesh, alone=True)
        ran.append(set().union(*lists))
    assert [surface.maps is None for surface in surfaces] == [True, True, False]
    assert [surface.textures is None for surface in surfaces] == [True, True, False]
    assert ran[0] == ran[1]
    of_maps = {"interpolate_uv", "read_textures", "apply_occlusion_maps"}
    assert ran[2] - ran[0] >= of_maps
    assert ran[0] < ran[2]


@pytest.mark.needs_jit
def test_threads_change_no_bit():
    rng = np.random.default_rng(6)
    bumpy = rj.Texture(rng.uniform(0.3, 1.0, (8, 8, 3)).astype(np.float32))
    mesh = square(replace(PBR, normal_texture=bumpy, occlusion_texture=bumpy))
    size = (300, 200)
    one, many = (seen(mesh, lights=LIGHTS, threads=n, size=size) for n in (1, 5))
    assert one.tobytes() == many.tobytes()
