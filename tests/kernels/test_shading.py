"""Each shading model equals its naive twin; what is absent equals neutral data, bit for bit."""

from __future__ import annotations

from dataclasses import replace

import naive
import numpy as np
import pytest

import rasterjit as rj

SIZE = (40, 32)
BITS = ("linear", "color")

INSIDE = rj.transforms.scale(0.5)
"""Where the sphere is in view and hidden by itself."""


def scene_of(mesh, lights="some", transform=None):
    scene = rj.Scene()
    scene.add(mesh, transform)
    if lights == "some":
        scene.lights = [
            rj.AmbientLight("white", 0.15),
            rj.DirectionalLight((-1, -2, -1.5), color=(1.0, 0.9, 0.7), intensity=0.6),
            rj.PointLight((2.0, 1.0, 3.0), color=(0.4, 0.5, 1.0), intensity=4.0),
        ]
    return scene


def remake(mesh, **changes):
    """Return a copy of a mesh with other options."""
    options = {"material": mesh.material, "normals": mesh.normals, **changes}
    return rj.Mesh(mesh.vertices, options.pop("faces", mesh.faces), **options)


def shade(what, camera, **options):
    return rj.render(what, camera, size=SIZE, outputs=BITS, threads=1, **options)


def same(one, other):
    """Tell whether two frames have the same bits."""
    return all(
        a.tobytes() == b.tobytes()
        for a, b in ((one.linear, other.linear), (one.color, other.color))
    )


def naive_linear(mesh, scene, camera, face_id, weights):
    """Shade the covered pixels one by one."""
    eye = np.array(camera.eye)
    ambient, lights = np.zeros(3), []
    for light in scene.lights:
        color = np.array(light.color) * light.intensity
        if isinstance(light, rj.AmbientLight):
            ambient += color
        elif isinstance(light, rj.PointLight):
            lights.append([*(np.array(light.position) - eye), 1.0, *color])
        else:
            lights.append([*(-np.array(light.direction)), 0.0, *color])
    material = mesh.material
    base = np.array(material.base_color[:3])
    normals = mesh.vertex_normals().astype(float)
    colors = np.tile(base, (len(mesh.vertices), 1))
    if mesh.vertex_colors is not None:
        colors = colors * mesh.vertex_colors[:, :3]
    linear = np.full((*face_id.shape, 3), np.nan)
    for row, column in np.argwhere(face_id >= 0):
        face = mesh.faces[face_id[row, column]]
        tint = colors[face]
        if mesh.face_colors is not None:
            tint = tint * mesh.face_colors[face_id[row, column], :3]
        linear[row, column] = naive.shade_sample(
            material.shading, weights[row, column].astype(float),
            (mesh.vertices[face] - eye).tolist(), normals[face].tolist(),
            tint.tolist(), (material.specular, material.shininess), lights,
            ambient.tolist(),
        )  # fmt: skip
    return linear


@pytest.mark.parametrize("model", ["unlit", "flat", "gouraud", "phong"])
@pytest.mark.parametrize("colors", [None, "vertex", "face"])
def test_shading_equals_naive(sphere, camera, model, colors):
    rng = np.random.default_rng(1)
    count = {None: 0, "vertex": len(sphere.vertices), "face": len(sphere.faces)}[colors]
    material = rj.Material(model, (0.8, 0.5, 0.3, 1.0), specular=0.4, shininess=20.0)
    mesh = rj.Mesh(
        sphere.vertices, sphere.faces, material=material,
        colors=rng.uniform(0.2, 1.0, (count, 4)) if count else None,
    )  # fmt: skip
    scene = scene_of(mesh)
    frame = rj.render(
        scene, camera, size=SIZE, outputs=("linear", "face_id", "barycentric"), threads=1
    )
    want = naive_linear(mesh, scene, camera, frame.face_id, frame.barycentric)
    hit = frame.face_id >= 0
    assert hit.sum() > 80
    assert np.abs(frame.linear[hit][:, :3] - want[hit]).max() < 2e-5
    assert (frame.linear[hit][:, 3] == 1.0).all()
    assert (frame.linear[~hit] == 1.0).all()  # the white background


@pytest.mark.parametrize("model", ["unlit", "flat", "gouraud", "phong"])
@pytest.mark.parametrize("colors", ["vertex", "face"])
@pytest.mark.parametrize("forced", ["pixel", "vertex", "face"])
@pytest.mark.parametrize("specular", [0.0, 0.4])
def test_colours_are_those_of_the_mesh_under_any_quality(
    sphere, camera, model, colors, forced, specular
):
    # Without highlights the light is white light times the colour; with them it is that, and more.
    rng = np.random.default_rng(2)
    count = len(sphere.vertices if colors == "vertex" else sphere.faces)
    material = rj.Material(model, "white", specular=specular)
    options = {"quality": rj.Quality(shading=forced), "outputs": ("linear", "face_id")}
    own = remake(sphere, material=material, colors=rng.uniform(0.2, 1.0, (count, 3)))
    frame = rj.render(scene_of(own), camera, size=SIZE, threads=1, **options)
    white, dull = (
        rj.render(
            scene_of(remake(sphere, material=replace(material, specular=share))),
            camera, size=SIZE, threads=1, **options,
        )
        for share in (specular, 0.0)
    )  # fmt: skip
    hit = frame.face_id >= 0
    if colors == "face":
        tint = own.face_colors[frame.face_id[hit], :3]
        want = dull.linear[hit][:, :3] * tint + (white.linear - dull.linear)[hit][:, :3]
        assert np.abs(frame.linear[hit][:, :3] - want).max() < 2e-5
    else:
        assert np.abs(frame.linear[hit][:, :3] - white.linear[hit][:, :3]).max() > 0.1


@pytest.mark.parametrize("quality", [rj.Quality(samples=4), rj.Quality(samples=64)])
@pytest.mark.parametrize("alpha", [1.0, 0.5])
def test_face_colours_under_textures_samples_and_glass(sphere, camera, quality, alpha):
    # One colour for all faces is that colour as the texture, and as the base colour.
    colors = np.tile(np.float32((0.2, 0.6, 0.9, alpha)), (len(sphere.faces), 1))
    uv = np.zeros((len(sphere.vertices), 2))
    textured = rj.Material(
        "gouraud", "white", specular=0.4, alpha_mode="blend",
        base_color_texture=rj.Texture(np.float32([[[1.0, 0.5, 0.25]]])),
    )  # fmt: skip
    mesh = remake(sphere, uv=uv, material=textured, colors=colors)
    tinted = np.array((0.2, 0.3, 0.225, alpha))
    plain = rj.Material("gouraud", tuple(tinted), specular=0.4, alpha_mode="blend")
    other = remake(sphere, material=plain)
    frames = [
        rj.render(
            scene_of(one), camera, size=SIZE, outputs="linear", quality=quality, threads=1,
            background="black",
        )
        for one in (mesh, other)
    ]  # fmt: skip
    assert frames[1].linear[..., :3].max() > 0.2
    assert np.abs(frames[0].linear - frames[1].linear).max() < 1e-5


@pytest.mark.parametrize("model", ["flat", "gouraud", "phong"])
def test_back_faces_are_lit_from_their_own_side(cube, model):
    # From inside the cube all faces are seen from behind: same as the cube turned inside out.
    camera = rj.PerspectiveCamera(eye=(0.2, 0.1, -0.3), target=(0, 0, -1), fov_y=80.0)
    material = rj.Material(model, "white", specular=0.5)
    there = cube.split_creases()
    inside = rj.Mesh(there.vertices, there.faces, normals=there.normals, material=material)
    turned = rj.Mesh(
        there.vertices, there.faces[:, ::-1], normals=-there.normals, material=material
    )
    scenes = [scene_of(inside), scene_of(turned)]
    frames = [rj.render(s, camera, size=SIZE, outputs="linear", threads=1) for s in scenes]
    np.testing.assert_allclose(frames[0].linear, frames[1].linear, atol=2e-6)
    scene = scenes[0]
    assert frames[0].linear[..., :3].max() > 0.2
    truth = rj.render(scene, camera, size=SIZE, outputs=("face_id", "barycentric"), threads=1)
    want = naive_linear(inside, scene, camera, truth.face_id, truth.barycentric)
    assert np.abs(frames[0].linear[..., :3] - want).max() < 2e-5


@pytest.mark.parametrize("model", ["flat", "gouraud", "phong"])
def test_mirrored_object_is_lit_like_the_mirrored_mesh(sphere, camera, model):
    material = rj.Material(model, "white")
    mirrored = scene_of(
        remake(sphere, material=material), transform=rj.transforms.scale((-1, 1, 1))
    )
    flipped = rj.Mesh(sphere.vertices * [-1, 1, 1], sphere.faces[:, ::-1], material=material)
    frames = [
        rj.render(what, camera, size=SIZE, outputs=("linear", "face_id"), threads=1)
        for what in (mirrored, scene_of(flipped))
    ]
    assert frames[0].face_id.tobytes() == frames[1].face_id.tobytes()
    np.testing.assert_allclose(frames[0].linear, frames[1].linear, atol=2e-6)


@pytest.mark.parametrize("model", ["unlit", "flat", "gouraud", "phong"])
def test_white_vertex_colours_equal_none(sphere, camera, model):
    material = rj.Material(model, (0.3, 0.6, 0.9, 1.0))
    plain = remake(sphere, material=material)
    white = remake(sphere, material=material, colors=np.ones((len(sphere.vertices), 3)))
    assert white.vertex_colors is not None
    assert same(shade(scene_of(plain), camera), shade(scene_of(white), camera))


@pytest.mark.parametrize("model", ["unlit", "flat", "gouraud", "phong"])
def test_white_face_colours_equal_none(sphere, camera, model):
    material = rj.Material(model, (0.3, 0.6, 0.9, 1.0))
    plain = remake(sphere, material=material)
    white = remake(sphere, material=material, colors=np.ones((len(sphere.faces), 3)))
    assert white.face_colors is not None
    assert same(shade(scene_of(plain), camera), shade(scene_of(white), camera))


def test_unlit_object_equals_an_unlit_scene(sphere, camera):
    # A lit object inside of what is seen switches the light on for the frame.
    rng = np.random.default_rng(2)
    unlit = remake(
        sphere,
        material=rj.Material("unlit", "white"),
        colors=rng.uniform(0, 1, (len(sphere.vertices), 3)),
    )
    alone, company = scene_of(unlit), scene_of(unlit)
    company.add(remake(sphere), INSIDE)
    exact = rj.Quality(interpolation_precision="float64")
    frames = shade(alone, camera, quality=exact), shade(company, camera, quality=exact)
    assert frames[0].plan.lighting is None
    assert frames[1].plan.lighting is not None
    assert same(*frames)
    # Only the scene without light takes float32, to a millionth of each colour.
    quick = shade(alone, camera)
    assert np.array_equal(quick.color, frames[0].color)
    np.testing.assert_allclose(quick.linear, frames[0].linear, rtol=1e-6)


@pytest.mark.parametrize("model", ["flat", "phong"])
def test_gouraud_elsewhere_changes_no_bit(sphere, camera, model):
    mesh = remake(sphere, material=rj.Material(model, "orange"))
    alone, company = scene_of(mesh), scene_of(mesh)
    company.add(remake(sphere, material=rj.Material("gouraud")), INSIDE)
    assert same(shade(alone, camera), shade(company, camera))


def test_smooth_objects_elsewhere_change_no_bit_of_a_flat_one(sphere, camera):
    mesh = remake(sphere, material=rj.Material("flat", "orange"))
    alone, company = scene_of(mesh), scene_of(mesh)
    company.add(remake(sphere), INSIDE)
    assert same(shade(alone, camera), shade(company, camera))


def test_unlit_scene_ignores_its_lights(sphere, camera):
    unlit = remake(sphere, material=rj.Material("unlit", "orange"))
    frames = shade(scene_of(unlit), camera), shade(scene_of(unlit, lights=None), camera)
    assert same(*frames)
    # CSS orange, exactly.
    assert frames[0].color[SIZE[1] // 2, SIZE[0] // 2].tolist() == [255, 165, 0, 255]


def test_face_colours_are_the_colours_of_their_faces(cube, camera):
    codes = np.random.default_rng(3).integers(0, 256, (12, 3)).astype(np.uint8)
    mesh = remake(cube, material=rj.Material("unlit", "white"), colors=codes)
    frame = rj.render(mesh, camera, size=SIZE, outputs=("color", "face_id"), threads=1)
    hit = frame.face_id >= 0
    assert (frame.color[hit][:, :3] == codes[frame.face_id[hit]]).all()


def test_one_colour_at_all_vertices_is_exact(cube, camera):
    codes = np.tile(np.array([[12, 200, 77]], np.uint8), (8, 1))
    mesh = remake(cube, material=rj.Material("unlit", "white"), colors=codes)
    frame = rj.render(mesh, camera, size=SIZE, outputs=("color", "face_id"), threads=1)
    assert (frame.color[frame.face_id >= 0] == [12, 200, 77, 255]).all()


def test_flat_faces_have_one_colour_under_a_directional_light(cube, camera):
    mesh = remake(cube, material=rj.Material("flat", "white", specular=0.0))
    scene = scene_of(mesh)
    scene.lights = scene.lights[:2]
    frame = rj.render(scene, camera, size=SIZE, outputs=("linear", "face_id"), threads=1)
    sides = frame.face_id // 2
    shown = [side for side in range(6) if (sides[frame.face_id >= 0] == side).any()]
    assert len(shown) == 3
    colors = set()
    for side in shown:
        rows = frame.linear[(sides == side) & (frame.face_id >= 0)]
        np.testing.assert_allclose(rows, np.tile(rows[0], (len(rows), 1)), atol=1e-6)
        colors.add(round(float(rows[0, 0]), 4))
    assert len(colors) == 3


def test_white_surface_facing_a_white_light_is_white():
    square = rj.Mesh(
        [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]],
        material=rj.Material("phong", "white", specular=0.0),
    )  # fmt: skip
    scene = scene_of(square, lights=None)
    scene.lights = [rj.DirectionalLight((0, 0, -1), intensity=1.0)]
    camera = rj.PerspectiveCamera(eye=(0, 0, 3), target=(0, 0, 0))
    frame = rj.render(scene, camera, size=SIZE, background="black", threads=1)
    assert frame.color[SIZE[1] // 2, SIZE[0] // 2].tolist() == [255, 255, 255, 255]
    behind = replace(camera, eye=(0, 0, -3))
    frame = rj.render(scene, behind, size=SIZE, background="white", threads=1)
    assert frame.color[SIZE[1] // 2, SIZE[0] // 2].tolist() == [0, 0, 0, 255]


def test_background_is_kept_where_nothing_is(cube, camera):
    for background, code in (("transparent", [0, 0, 0, 0]), ("#102030", [16, 32, 48, 255])):
        frame = rj.render(cube, camera, size=SIZE, background=background, threads=1)
        assert frame.color[0, 0].tolist() == code
