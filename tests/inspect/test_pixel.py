"""What is said of a pixel is what the frame shows there, and every number on the way is right."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene import transforms

SIZE = (96, 80)
"""Four tiles."""
CLIP = rj.MatrixCamera(np.eye(4), np.eye(4))
"""Takes world positions for clip positions: a parallel view along -z."""

STORED = 2.0**-23
"""Relative error of a stored value: half an ulp of float32, twice for the interpolation."""
SUMMED = 2.0**-20
"""Relative error of a colour added up in another order: sixteen float32 roundings."""


def pixels_of(face_id, count, seed=0):
    """Choose pixels (column, row): all kinds of face, and the background."""
    rng = np.random.default_rng(seed)
    chosen = [tuple(place) for place in rng.integers(0, face_id.shape[::-1], (count, 2)).tolist()]
    for face in np.unique(face_id)[:: max(1, len(np.unique(face_id)) // count)]:
        rows, columns = np.nonzero(face_id == face)
        n = rng.integers(len(rows))
        chosen.append((int(columns[n]), int(rows[n])))
    return chosen


@pytest.fixture
def busy(cube, sphere):
    """Every shading model, face and vertex colours, lights of every kind, a mirrored object."""
    rng = np.random.default_rng(1)
    scene = rj.Scene()
    place = transforms.translate
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, material=rj.Material("phong", "red")))
    scene.add(
        rj.Mesh(cube.vertices, cube.faces, colors=rng.uniform(0, 1, (8, 3)),
                material=rj.Material("gouraud", "white")),
        place((1.2, -0.4, 0.7)), "gouraud cube",
    )  # fmt: skip
    scene.add(
        rj.Mesh(cube.vertices, cube.faces, colors=rng.uniform(0, 1, (12, 3)),
                material=rj.Material("flat", "white")),
        transforms.scale((-0.8, 0.8, 0.8)),
    )  # fmt: skip
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, material=rj.Material("unlit", "blue")),
              place((-1.5, 0.5, 1.0)))  # fmt: skip
    scene.lights = [
        rj.PointLight((2, 2, 2), intensity=3), rj.AmbientLight(), rj.DirectionalLight((-1, -1, -1)),
    ]  # fmt: skip
    return scene


INSIDE = rj.PerspectiveCamera((0.9, 0.3, 1.2), (-0.5, 0, -1), fov_y=90.0, near=0.3, far=3.0)
"""Stands among the objects: faces are cut at the near and the far plane."""
PARALLEL = rj.OrthographicCamera((2.5, 3.0, 4.0), (0, 0, 0), height=5.0, near=0.5, far=20.0)


def assert_says_what_the_frame_shows(scene, camera, size, pixels, **options):
    outputs = ("color", "linear", "depth", "face_id", "object_id", "barycentric")
    frame = rj.render(scene, camera, size=size, outputs=outputs, threads=1, **options)
    for x, y in pixels or pixels_of(frame.face_id, 5):
        told = rj.explain_pixel(scene, camera, size, x, y, **options)
        assert told.color.tolist() == frame.color[y, x].tolist()
        assert told.linear.tobytes() == frame.linear[y, x].tobytes()
        seen = told.winner
        assert (seen is None) == (frame.face_id[y, x] < 0) == bool(told.reasons)
        if seen is None:
            continue
        assert seen.face == frame.face_id[y, x]
        assert seen.object_number == frame.object_id[y, x]
        assert seen.depth == frame.depth[y, x]
        stored = np.array([float(weight) for weight in seen.weights])
        assert np.abs(stored - frame.barycentric[y, x]).max() <= STORED
        assert str(told)
    return frame


@pytest.mark.parametrize("cull", ["none", "back", "front"])
@pytest.mark.parametrize("view", ["around", "inside", "parallel"])
def test_the_pixel_is_the_frames(busy, camera, view, cull):
    chosen = {"around": camera, "inside": INSIDE, "parallel": PARALLEL}[view]
    frame = assert_says_what_the_frame_shows(busy, chosen, SIZE, None, cull=cull)
    assert (frame.stats.clipped > 0) == (view == "inside")


@pytest.mark.parametrize("bits", [0, 4, 12])
def test_the_pixel_is_the_frames_on_any_grid(busy, camera, bits):
    assert_says_what_the_frame_shows(
        busy, camera, (33, 21), None, quality=rj.Quality(subpixel_bits=bits)
    )


def test_no_camera_and_no_lights_mean_what_they_mean_to_render(cube):
    frame = assert_says_what_the_frame_shows(cube, None, SIZE, None, background="transparent")
    y, x = np.argwhere(frame.face_id >= 0)[100]
    told = rj.explain_pixel(cube, None, SIZE, x, y)
    assert [light.name for light in told.light.lights] == ["headlight"]


def test_behind_a_wireframe_alone_the_environment_is_seen(cube, camera):
    scene = rj.Scene()
    scene.add(cube)
    scene.environment = rj.Environment.constant("blue")
    scene.wireframe = rj.Wireframe("red", "only")
    frame = rj.render(scene, camera, size=SIZE, outputs=("color", "linear"), threads=1)
    red = (frame.color == (255, 0, 0, 255)).all(axis=2)
    x, y = 44, 36
    assert not red[y, x]
    told = rj.explain_pixel(scene, camera, SIZE, x, y)
    assert told.winner is not None
    assert told.color.tolist() == frame.color[y, x].tolist()
    assert told.linear.tobytes() == frame.linear[y, x].tobytes()
    assert not told.under_wireframe


@pytest.mark.parametrize("mode", ["overlay", "only"])
def test_a_wireframe_over_the_pixel_is_told(cube, camera, mode):
    scene = rj.Scene()
    scene.add(cube)
    scene.wireframe = rj.Wireframe("red", mode)
    frame = rj.render(scene, camera, size=SIZE, threads=1)
    red = (frame.color == (255, 0, 0, 255)).all(axis=2)
    for over, (y, x) in ((True, np.argwhere(red)[40]), (False, np.argwhere(~red)[2000])):
        told = rj.explain_pixel(scene, camera, SIZE, x, y)
        assert told.color.tolist() == frame.color[y, x].tolist()
        assert told.under_wireframe == over
        assert ("line of the wireframe" in str(told)) == over
        assert (told.light is None) == (mode == "only" or told.winner is None)
        if told.winner is not None:
            what = "one of its lines is here" if over else "the background is seen here"
            assert (what in str(told)) == ("not drawn" in str(told)) == (mode == "only")


# --- which faces ----------------------------------------------------------------------------------


def layers(depths, points=((0, 0), (128, 0), (0, 128))):
    """Return a mesh of one screen triangle at several depths, in NDC."""
    clip = np.concatenate([naive.clip_from_screen(points, (128, 128), z) for z in depths])
    return rj.Mesh(clip[:, :3], np.arange(3 * len(depths)).reshape(-1, 3))


def test_faces_are_listed_from_near_to_far_and_ties_by_number():
    told = rj.explain_pixel(layers([0.5, -0.25, 0.0, -0.25]), CLIP, (128, 128), 70, 20)
    assert [face.face for face in told.faces] == [1, 3, 2, 0]
    assert [face.standing for face in told.faces] == ["visible", "tied", "hidden", "hidden"]
    assert told.winner is told.faces[0]
    assert told.faces[0].stored_depth == told.faces[1].stored_depth
    assert told.faces[1].depth < told.faces[2].depth < told.faces[3].depth


def test_culled_faces_come_last_and_explain_a_hole():
    both = layers([0.0, 0.5])
    mesh = rj.Mesh(both.vertices, [[0, 1, 2], [5, 4, 3]])
    turned = [
        rj.explain_pixel(mesh, CLIP, (128, 128), 10, 10, cull=cull) for cull in ("back", "front")
    ]
    assert sorted([face.face for face in told.faces] for told in turned) == [[0, 1], [1, 0]]
    for told in turned:
        assert [face.standing for face in told.faces] == ["visible", "culled"]
    alone = rj.Mesh(mesh.vertices[:3], mesh.faces[:1])
    holes = [
        told
        for cull in ("back", "front")
        if (told := rj.explain_pixel(alone, CLIP, (128, 128), 10, 10, cull=cull)).winner is None
    ]
    assert len(holes) == 1
    assert holes[0].faces[0].standing == "culled"
    assert "culled faces cover it: 0" in holes[0].reasons


def test_faces_are_all_that_cover_the_centre_exactly():
    rng = np.random.default_rng(4)
    points = np.round(rng.uniform(-20, 84, (30, 3, 2)) * 1024) / 1024
    depths = np.repeat(rng.uniform(-0.9, 0.9, 30), 3)
    clip = naive.clip_from_screen(points.reshape(-1, 2), (64, 64), depths)
    mesh = rj.Mesh(clip[:, :3], np.arange(90).reshape(-1, 3))
    snapped = [rj.oracle.snap_triangle(triangle) for triangle in points.tolist()]
    for x, y in rng.integers(0, 64, (25, 2)).tolist():
        told = rj.explain_pixel(mesh, CLIP, (64, 64), x, y)
        point = 256 * x + 128, 256 * y + 128
        exact = {n for n, triangle in enumerate(snapped) if rj.oracle.covers(triangle, point)}
        assert {face.face for face in told.faces} == exact
        for face in told.faces:
            assert face.snapped.tolist() == [list(corner) for corner in snapped[face.face]]
            biased = [e + b for e, b in zip(face.edges, face.biases, strict=True)]
            assert min(biased) >= 0
            area = abs(rj.oracle.edge(*snapped[face.face]))
            assert sum(face.edges) == area
            assert face.affine_weights == tuple(Fraction(e, area) for e in face.edges)


def test_a_shared_edge_through_the_centre_belongs_to_the_face_with_bias_zero():
    points = [(0, 0), (64, 0), (64, 64), (0, 64)]
    clip = naive.clip_from_screen(points, (64, 64))
    mesh = rj.Mesh(clip[:, :3], [[0, 1, 2], [0, 2, 3]])
    told = rj.explain_pixel(mesh, CLIP, (64, 64), 20, 20)
    assert len(told.faces) == 1
    on_edge = told.faces[0].edges.index(0)
    assert told.faces[0].biases[on_edge] == 0
    assert "on it, a top or left edge" in str(told)


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2)])
def test_a_level_edge_is_biased_below_a_face_and_not_above(order):
    points = [(0, 20.5), (64, 20.5), (32, 0), (32, 60)]
    clip = naive.clip_from_screen(points, (64, 64))
    a, b, c = order
    mesh = rj.Mesh(clip[:, :3], [[a, b, c], [a, b, 3]])
    (above,) = rj.explain_pixel(mesh, CLIP, (64, 64), 32, 10).faces
    (on_it,) = rj.explain_pixel(mesh, CLIP, (64, 64), 32, 20).faces
    assert (above.face, above.biases[2]) == (0, -1)
    assert (on_it.face, on_it.biases[2], on_it.edges[2]) == (1, 0, 0)


# --- the numbers of a face ------------------------------------------------------------------------


def test_every_space_follows_from_the_one_before(busy, camera):
    frame = rj.render(busy, camera, size=SIZE, outputs="face_id", threads=1)
    clip_from_view = camera.projection_matrix(SIZE)
    for x, y in pixels_of(frame.face_id, 6):
        for face in rj.explain_pixel(busy, camera, SIZE, x, y).faces:
            node = busy.nodes[face.object_number]
            assert face.mesh_vertices == tuple(node.mesh.faces[face.mesh_face].tolist())
            assert face.object_name == node.name
            assert (face.model == node.mesh.vertices[list(face.mesh_vertices)]).all()
            world = face.model @ node.world_from_model[:3, :3].T + node.world_from_model[:3, 3]
            view = face.world @ camera.view_matrix()[:3, :3].T + camera.view_matrix()[:3, 3]
            clip = np.column_stack([face.view, np.ones(3)]) @ clip_from_view.T
            np.testing.assert_allclose(face.world, world, atol=1e-12)
            np.testing.assert_allclose(face.view, view, atol=1e-12)
            np.testing.assert_allclose(face.clip, clip, atol=1e-12)
            np.testing.assert_array_equal(face.ndc, face.clip[:, :3] / face.clip[:, 3:])
            for corner, screen, snapped in zip(face.clip, face.screen, face.snapped, strict=True):
                exact = rj.oracle.screen_position(corner.tolist(), SIZE)
                np.testing.assert_allclose(screen, [float(c) for c in exact], rtol=1e-12)
                assert snapped.tolist() == [rj.oracle.snap(coordinate) for coordinate in exact]


def test_a_clipped_face_has_words_for_its_vertices_and_weights_of_its_own(busy):
    frame = rj.render(busy, INSIDE, size=SIZE, outputs="face_id", threads=1)
    cut = []
    for x, y in pixels_of(frame.face_id, 40):
        cut += [
            (x, y, face)
            for face in rj.explain_pixel(busy, INSIDE, SIZE, x, y).faces
            if face.clipped
        ]
    assert len(cut) > 5
    for x, y, face in cut:
        words = {word for codes in face.outcodes for word in codes}
        assert words & {"near", "far", "guard band"}
        for codes, corner, ndc in zip(face.outcodes, face.clip, face.ndc, strict=True):
            assert ("near" in codes) == (corner[2] < -corner[3])
            assert ("far" in codes) == (corner[2] > corner[3])
            assert np.isnan(ndc).all() == (corner[3] <= 0.0)
        exact = rj.oracle.clip_weights(face.clip.tolist(), (x + 0.5, y + 0.5), SIZE)
        if min(exact) >= 0:
            assert face.weights == exact
        assert sum(face.weights) == 1
        assert min(face.weights) >= 0


def test_a_sample_that_snapping_brought_onto_a_clipped_face_has_no_negative_weight():
    # The left edge lies a quarter of a step to the right of the centres that it snaps to.
    points = [(20.5 + 2.0**-10, 10), (20.5 + 2.0**-10, 50), (60, 30)]
    clip = naive.clip_from_screen(points, (64, 64), [0.0, 0.0, -1.5])
    (face,) = rj.explain_pixel(rj.Mesh(clip[:, :3], [[0, 1, 2]]), CLIP, (64, 64), 20, 30).faces
    assert face.clipped
    assert rj.oracle.clip_weights(clip.tolist(), (20.5, 30.5), (64, 64))[2] < 0
    assert face.weights[2] == 0
    assert sum(face.weights) == 1


# --- light ----------------------------------------------------------------------------------------


def stripes(kind="nearest"):
    """Return a texture of two colours, seen in rows of a 16th."""
    rows = np.tile([[[1.0, 0.5, 0.25]], [[0.125, 0.5, 1.0]]], (8, 1, 1))
    return rj.Texture(rows, filter=kind)


@pytest.mark.parametrize("texture", [None, stripes()], ids=["plain", "textured"])
@pytest.mark.parametrize("shading", ["flat", "gouraud", "phong"])
@pytest.mark.parametrize("owner", ["vertices", "faces"])
def test_the_terms_of_light_add_up_to_the_colour(sphere, camera, shading, texture, owner):
    scene = rj.Scene()
    count = len(getattr(sphere, owner))
    colors = np.random.default_rng(2).uniform(0.2, 1, (count, 3))
    material = rj.Material(shading, "white", specular=0.7, shininess=5, base_color_texture=texture)
    uv = sphere.vertices[:, :2]
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, colors=colors, uv=uv, material=material))
    scene.lights = [
        rj.AmbientLight(intensity=0.2), rj.PointLight((2, 3, 2), color="red", intensity=2),
        rj.DirectionalLight((-1, 0, -1), color="green", intensity=0.4),
    ]  # fmt: skip
    frame = rj.render(scene, camera, size=SIZE, outputs=("face_id", "linear"), threads=1)
    shone = np.zeros(2)
    for y, x in np.argwhere(frame.face_id >= 0)[::97]:
        told = rj.explain_pixel(scene, camera, SIZE, x, y)
        light = told.light
        assert told.linear.tobytes() == frame.linear[y, x].tobytes()
        assert light.shading == shading
        assert (light.texture is None) == (texture is None)
        assert [term.name for term in light.lights] == ["PointLight 1", "DirectionalLight 2"]
        total = light.ambient + sum(term.diffuse + term.specular for term in light.lights)
        # What faces and texels leave of the light on vertices is a difference of numbers below 1.
        np.testing.assert_allclose(total, frame.linear[y, x, :3], rtol=SUMMED, atol=2.0**-24)
        np.testing.assert_allclose(light.ambient, 0.2 * light.base_color, rtol=SUMMED)
        for n, dark in enumerate(([1, 2], [0, 2])):
            term = light.lights[n]
            assert (term.diffuse[dark] == 0).all()
            assert (term.specular[dark] == 0).all()
            shone[n] += term.specular.max()
    assert (shone > 0.0).all()


def test_the_terms_of_light_on_microfacets_and_of_emission_add_up_to_the_colour(sphere, camera):
    texel = np.full((1, 1, 3), [0.6, 0.4, 0.9], np.float32)
    material = rj.Material(
        "pbr", (0.9, 0.6, 0.3), metallic=0.6, roughness=1.0, emissive=(0.2, 0.1, 0.4),
        normal_texture=rj.Texture(texel), metallic_roughness_texture=rj.Texture(texel),
        emissive_texture=rj.Texture(texel), base_color_texture=rj.Texture(texel),
    )  # fmt: skip
    scene = rj.Scene()
    uv = sphere.vertices[:, :2]
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, uv=uv, material=material))
    scene.lights = [
        rj.AmbientLight(intensity=0.2), rj.DirectionalLight((-1, 0, -1), intensity=0.4)
    ]  # fmt: skip
    frame = rj.render(scene, camera, size=SIZE, outputs=("face_id", "linear"), threads=1)
    shone = 0
    for y, x in np.argwhere(frame.face_id >= 0)[::97]:
        told = rj.explain_pixel(scene, camera, SIZE, x, y)
        light = told.light
        assert told.linear.tobytes() == frame.linear[y, x].tobytes()
        (sun,) = light.lights
        total = light.ambient + sun.diffuse + sun.specular + light.emission
        np.testing.assert_allclose(total, frame.linear[y, x, :3], rtol=SUMMED)
        np.testing.assert_allclose(light.emission, [0.12, 0.04, 0.36], rtol=SUMMED)
        np.testing.assert_allclose(light.base_color, [0.54, 0.24, 0.27], rtol=SUMMED)
        shone += sun.specular.max() > 1e-3 and sun.diffuse.max() > 1e-3
        assert "emission" in str(told)
    assert shone > 5


@pytest.mark.parametrize("material", [rj.Material("unlit"), rj.Material("pbr", clearcoat=1.0)])
def test_emission_is_what_the_picture_lacks_without_it(sphere, camera, material):
    scenes, pictures = [], []
    for emissive in ((0.0, 0.0, 0.0), (0.2, 0.1, 0.4)):
        scenes.append(rj.Scene())
        scenes[-1].lights = [rj.DirectionalLight((-1, 0, -1), intensity=0.4)]
        own = replace(material, emissive=emissive)
        scenes[-1].add(rj.Mesh(sphere.vertices, sphere.faces, material=own))
        frame = rj.render(scenes[-1], camera, size=SIZE, outputs=("face_id", "linear"), threads=1)
        pictures.append(frame.linear[..., :3])
    dark, bright = pictures
    for y, x in np.argwhere(frame.face_id >= 0)[::97]:
        # What was shaded before it does not matter.
        rj.explain_pixel(scenes[0], camera, SIZE, x, y)
        found = rj.explain_pixel(scenes[1], camera, SIZE, x, y).light.emission
        np.testing.assert_allclose(found, bright[y, x] - dark[y, x], atol=1e-6)
        assert found.any()


@pytest.mark.parametrize("shading", ["unlit", "phong"])
@pytest.mark.parametrize("kind", ["nearest", "trilinear"])
def test_the_texture_is_told_apart(sphere, camera, shading, kind):
    scene = rj.Scene()
    material = rj.Material(shading, (0.5, 0.5, 1.0), base_color_texture=stripes(kind))
    uv = sphere.vertices[:, :2]
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, uv=uv, material=material))
    scene.add(rj.Mesh(sphere.vertices, sphere.faces), transforms.translate((1.5, 0, 0)))
    frame = rj.render(scene, camera, size=SIZE, outputs=("object_id", "linear", "uv"), threads=1)
    seen = set()
    for y, x in np.argwhere(frame.object_id == 0)[::61]:
        told = rj.explain_pixel(scene, camera, SIZE, x, y)
        shown = told.light.texture.tolist()
        assert told.linear.tobytes() == frame.linear[y, x].tobytes()
        assert told.light.base_color.tolist() == [shown[0] / 2, shown[1] / 2, shown[2]]
        assert told.light.uv.tolist() == frame.uv[y, x].tolist()
        assert "texture at uv (" in str(told)
        if kind == "nearest":
            upper = int(np.floor(frame.uv[y, x, 1] * 16)) % 2 == 1
            assert shown == ([1.0, 0.5, 0.25] if upper else [0.125, 0.5, 1.0])
        seen.add(tuple(shown))
    assert len(seen) > (1 if kind == "nearest" else 2)
    y, x = np.argwhere(frame.object_id == 1)[0]
    assert rj.explain_pixel(scene, camera, SIZE, x, y).light.texture is None


@pytest.mark.parametrize("shading", ["unlit", "phong", "gouraud"])
@pytest.mark.parametrize("of_faces", [False, True])
def test_the_scalar_and_its_colour_are_told(sphere, camera, shading, of_faces):
    scene, uv = rj.Scene(), sphere.vertices[:, :2]
    scalars = np.arange(len(sphere.faces)) if of_faces else 3.0 * sphere.vertices[:, 1]
    material = rj.Material(shading, (0.5, 0.5, 1.0), base_color_texture=stripes("nearest"))
    field = {"scalars": scalars, "contours": None if of_faces else 5}
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, uv=uv, material=material, **field))
    scene.add(rj.Mesh(sphere.vertices, sphere.faces), transforms.translate((1.5, 0, 0)))
    frame = rj.render(
        scene, camera, size=SIZE, outputs=("object_id", "linear", "scalar"), threads=1
    )
    own, lines = scene.nodes[0].mesh.field, 0
    for y, x in np.argwhere(frame.object_id == 0)[::149]:
        told = rj.explain_pixel(scene, camera, SIZE, x, y)
        assert told.linear.tobytes() == frame.linear[y, x].tobytes()
        assert told.light.scalar == frame.scalar[y, x]
        (entry,) = own.colormap.entries([told.light.scalar], *own.range)
        if not told.light.scalar_color.any():
            lines += 1
        else:
            assert told.light.scalar_color.tolist() == own.colormap.colors[entry, :3].tolist()
        assert f"scalar {told.light.scalar:.7g}" in str(told)
        shown = told.light.scalar_color * told.light.texture * (0.5, 0.5, 1.0)
        if shading != "gouraud":
            np.testing.assert_allclose(told.light.base_color, shown, rtol=SUMMED, atol=1e-7)
    assert (lines > 0) != of_faces
    y, x = np.argwhere(frame.object_id == 1)[0]
    told = rj.explain_pixel(scene, camera, SIZE, x, y)
    assert told.light.scalar is told.light.scalar_color is None
    assert "scalar" not in str(told)


def test_an_unlit_face_shows_its_base_colour(cube, camera):
    scene = rj.Scene()
    scene.add(rj.Mesh(cube.vertices, cube.faces, material=rj.Material("unlit", (0.5, 0.25, 1.0))))
    told = rj.explain_pixel(scene, camera, SIZE, 48, 40)
    assert told.light.base_color.tolist() == told.linear[:3].tolist() == [0.5, 0.25, 1.0]
    assert told.light.lights == ()
    assert not told.light.ambient.any()


# --- more faces than one --------------------------------------------------------------------------


def glazed(*panes, floor=True):
    """Return a scene of panes, given by alpha and z, in front of a floor that they stick out of."""
    scene = rj.Scene()
    square = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    faces = [[0, 1, 2], [0, 2, 3]]
    if floor:
        scene.add(rj.Mesh(0.7 * square, faces, material=rj.Material("phong", "red")), name="floor")
    for n, (alpha, z) in enumerate(panes):
        material = rj.Material(
            "phong", (0.2, 0.9, 0.05 * n, alpha), emissive=(0.0, 0.0, 0.1), alpha_mode="blend"
        )
        place = transforms.translate((0.1, 0.05, z)) @ transforms.rotate_z(20.0)
        scene.add(rj.Mesh(square, faces, material=material), place, f"pane {n}")
    scene.lights = [rj.AmbientLight(intensity=0.3), rj.DirectionalLight((-0.2, -0.3, -1))]
    scene.fog = rj.Fog("white", density=0.05)
    return scene


FEW = (14, 11)
AHEAD = rj.PerspectiveCamera((0.1, 0.2, 4.0), (0, 0, 0), fov_y=38.0)


def color_behind(environment, background):
    """Return what is seen where nothing is, (H, W, 3), linear: all is behind the eye."""
    scene = rj.Scene()
    scene.add(rj.Mesh([(0, 0, 9), (1, 0, 9), (0, 1, 9)], [[0, 1, 2]]))
    scene.environment = environment
    frame = rj.render(scene, AHEAD, size=FEW, outputs=("linear",), background=background)
    return frame.linear[:, :, :3]


@pytest.mark.parametrize("background", [None, "transparent", (0.3, 0.2, 0.8, 0.5)])
@pytest.mark.parametrize(
    ("panes", "samples"),
    [(((0.25, 0.5), (0.5, 0.2)), 1), (((0.25, 0.5), (0.5, 0.2)), 4), ((), 4), ((), "area")],
    ids=["panes", "panes, 4 samples", "4 samples", "area"],
)  # fmt: skip
def test_the_parts_of_a_mixed_pixel_add_up_to_its_colour(panes, samples, background):
    scene, quality = glazed(*panes), rj.Quality(samples=samples)
    if background is None:
        scene.environment = rj.Environment.gradient(background=True)
    options = {"quality": quality, "background": background}
    frame = rj.render(
        scene, AHEAD, size=FEW, outputs=("linear", "color", "face_id"), threads=1, **options
    )
    behind = color_behind(scene.environment, background)
    names = set()
    beside = 0
    for y, x in (*np.argwhere(frame.face_id >= 0)[::9], *np.argwhere(frame.face_id < 0)[::13]):
        told = rj.explain_pixel(scene, AHEAD, FEW, int(x), int(y), **options)
        assert told.linear.tobytes() == frame.linear[y, x].tobytes()
        assert told.color.tolist() == frame.color[y, x].tolist()
        for part in told.parts:
            if part.face is None:
                np.testing.assert_allclose(part.color, part.share * behind[y, x], atol=2e-6)
        if told.winner is None:
            total = sum(part.color for part in told.parts) if told.parts else told.linear[:3]
            np.testing.assert_allclose(total, told.linear[:3], rtol=SUMMED, atol=1e-6)
            assert ("beside the centre, face" in str(told)) == bool(told.parts)
            beside += bool(told.parts)
            continue
        own = told.light.ambient + told.light.emission
        own = own + sum(term.diffuse + term.specular for term in told.light.lights)
        if not told.parts:
            np.testing.assert_allclose(own, told.linear[:3], rtol=SUMMED)
            continue
        total = sum(part.color for part in told.parts)
        np.testing.assert_allclose(total, told.linear[:3], rtol=SUMMED, atol=1e-6)
        assert sum(part.share for part in told.parts) == pytest.approx(1.0, abs=1e-6)
        assert told.parts[0].face == told.winner.face
        np.testing.assert_allclose(told.parts[0].color, told.parts[0].share * own, rtol=1e-5)
        for part in told.parts:
            assert (part.color >= -1e-7).all()
            names.add(part.name.split(" of ")[-1])
        assert str(told).isascii()
        assert "other faces" not in str(told)
    backdrops = {None: {"environment"}, "transparent": set()}.get(background, {"background"})
    owners = {"object 0 floor", *(f"object {n + 1} pane {n}" for n in range(len(panes)))}
    assert names == owners | backdrops
    assert (beside > 0) == (samples != 1)


def test_what_is_seen_through_glass_is_marked_and_its_shares_are_those_of_the_alphas():
    scene = glazed((0.25, 0.5), (0.5, 0.2))
    scene.add(rj.Mesh([(-9, -9, -1), (9, -9, -1), (0, 9, -1)], [[0, 1, 2]]), name="wall")
    told = rj.explain_pixel(scene, AHEAD, FEW, 7, 5)
    standings = {face.object_name: (face.standing, face.alpha) for face in told.faces}
    assert standings == {
        "pane 0": ("visible", 0.25), "pane 1": ("seen through the above", 0.5),
        "floor": ("seen through the above", 1.0), "wall": ("hidden", None),
    }  # fmt: skip
    assert [part.share for part in told.parts] == pytest.approx([0.25, 0.375, 0.375])
    assert [part.alpha for part in told.parts] == pytest.approx([0.25, 0.5, 1.0])
    shown = str(told)
    assert "seen through the above, alpha 0.5\n" in shown
    assert f"all of this, face {told.winner.face}, alpha 0.25: x 0.2500" in shown
    assert "through it, face 0 of object 0 floor: x 0.3750" in shown


def test_faces_that_only_other_samples_show_are_marked_so():
    scene = rj.Scene()
    for z, x in ((0.0, -0.8), (-0.5, -9.0)):
        scene.add(rj.Mesh([(x, -9, z), (9, -9, z), (9, 9, z), (x, 9, z)], [[0, 1, 2], [0, 2, 3]]))
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=8.5, far=9.0)
    quality = rj.Quality(samples=16)
    found = set()
    for x in range(6):
        told = rj.explain_pixel(scene, camera, (8, 8), x, 2, quality=quality)
        found |= {face.standing for face in told.faces}
        for part in told.parts[1:]:
            assert 0.0 < part.share < 1.0
            assert f"beside it, {part.name}: x " in str(told)
    assert found == {"visible", "hidden", "seen beside the above"}


def test_many_parts_print_as_their_sum():
    scene = glazed(*((0.1, 0.02 * n) for n in range(1, 20)), floor=False)
    told = rj.explain_pixel(scene, AHEAD, FEW, 7, 5)
    assert len(told.parts) == 20
    rest = sum(part.share for part in told.parts[12:])
    assert f"and 8 more: x {rest:.4f}" in str(told)


# --- many samples ---------------------------------------------------------------------------------


def card(image, mode="opaque"):
    """Return a square 2 scene units wide with a picture on it."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    texture = rj.Texture(image.astype(np.float32), color_space="linear")
    material = rj.Material("unlit", base_color_texture=texture, alpha_mode=mode)
    return rj.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=corners[:, :2] / 2 + 0.5, material=material)


@pytest.mark.parametrize("samples", [64, 256])
def test_a_texture_is_told_as_samples_that_lie_so_close_see_it(samples):
    # One of 8 x 8 pixels sees the light square alone, each sample a texel. In the level for one
    # sample a pixel the square is a quarter of each of the four texels around.
    side = math.isqrt(samples)
    image = np.full((8 * side, 8 * side, 3), 0.125)
    image[5 * side // 2 : 7 * side // 2, 9 * side // 2 : 11 * side // 2] = 0.75
    camera = rj.OrthographicCamera((0.125, 0.125, 3), (0.125, 0.125, 0), height=2.0, far=9.0)
    quality = rj.Quality(samples=samples)
    frame = rj.render(card(image), camera, size=(8, 8), quality=quality, outputs=("linear",))
    assert frame.linear[3, 4, :3].tolist() == [0.75] * 3
    told = rj.explain_pixel(card(image), camera, (8, 8), 4, 3, quality=quality)
    assert told.linear.tobytes() == frame.linear[3, 4].tobytes()
    assert told.light.texture.tolist() == told.parts[0].color.tolist() == [0.75] * 3
    one = rj.explain_pixel(card(image), camera, (8, 8), 4, 3)
    assert one.light.texture == pytest.approx([0.28125] * 3)


def test_what_is_seen_through_holes_at_the_centre_is_that_of_one_sample():
    image = np.random.default_rng(3).random((128, 128, 4))
    scene = rj.Scene()
    tilt = transforms.rotate((1, 0, 0), -50)
    scene.add(card(image, "mask"), tilt)
    scene.add(card(image), transforms.translate((0, 0, -3)) @ np.diag((4.0, 4.0, 1.0, 1.0)))
    camera = rj.PerspectiveCamera((0, 0, 4), (0, 0, 0), near=0.5, far=20.0)
    pixels = [(x, y) for x in range(7, 18, 2) for y in range(6, 12, 2)]
    frame = assert_says_what_the_frame_shows(
        scene, camera, (24, 18), pixels, quality=rj.Quality(samples=64)
    )
    owners = {int(frame.object_id[y, x]) for x, y in pixels}
    assert owners == {0, 1}


# --- nothing there, and wrong arguments -----------------------------------------------------------


def test_the_background_names_the_nearest_face_and_how_far_it_is():
    points = [(10.5, 10.5), (30.5, 10.5), (10.5, 40.5)]
    clip = naive.clip_from_screen([*points, (100, 100), (101, 101), (99, 120)], (128, 128))
    mesh = rj.Mesh(clip[:, :3], [[3, 4, 5], [0, 1, 2]])
    told = rj.explain_pixel(mesh, CLIP, (128, 128), 20, 4, background="#ff0000")
    assert told.winner is None
    assert told.faces == ()
    assert told.light is None
    assert told.color.tolist() == [255, 0, 0, 255]
    assert "the nearest face drawn is 1, 6 pixels away" in told.reasons
    assert "of 2 faces: 2 drawn elsewhere" in told.reasons
    assert "shows the background" in str(told)


def test_an_empty_view_says_where_the_faces_are(cube):
    behind = rj.PerspectiveCamera((0, 0, 5), (0, 0, 9))
    told = rj.explain_pixel(cube, behind, SIZE, 0, 0)
    assert told.reasons == ("no face covers the pixel's centre", "of 12 faces: 12 outside the view")


@pytest.mark.parametrize(
    ("x", "y", "name"),
    [(-1, 0, "x"), (96, 0, "x"), (0, -1, "y"), (0, 80, "y"), (1.0, 0, "x"), (0, "3", "y"),
     (True, 0, "x"), (0, None, "y")],
)  # fmt: skip
def test_a_place_outside_the_picture_is_named(cube, camera, x, y, name):
    with pytest.raises(ValueError, match=rf"^{name} must be a whole number in 0\.\."):
        rj.explain_pixel(cube, camera, SIZE, x, y)


def test_a_place_is_of_any_kind_of_whole_number_as_for_picking(cube, camera):
    plain = rj.explain_pixel(cube, camera, SIZE, 48, 40)
    assert str(rj.explain_pixel(cube, camera, SIZE, np.array(48), np.uint8(40))) == str(plain)


@pytest.mark.parametrize(
    ("options", "name"),
    [({"cull": "both"}, "cull"), ({"quality": 8}, "quality"), ({"background": "no"}, "background")],
)
def test_wrong_options_are_named(cube, camera, options, name):
    with pytest.raises(ValueError, match=name):
        rj.explain_pixel(cube, camera, SIZE, 0, 0, **options)
    with pytest.raises(ValueError, match="camera"):
        rj.explain_pixel(cube, "here", SIZE, 0, 0)
    with pytest.raises(ValueError, match="size"):
        rj.explain_pixel(cube, camera, (0, 1), 0, 0)


# --- how it prints --------------------------------------------------------------------------------


def test_it_prints_as_plain_aligned_tables(busy, camera):
    told = rj.explain_pixel(busy, camera, SIZE, 48, 40)
    text = str(told)
    assert text.isascii()
    lines = text.splitlines()
    assert max(map(len, lines)) <= 100
    assert not any(line != line.rstrip() for line in lines)
    assert lines[0] == "pixel (48, 40) of 96 x 80, sampled at its centre (48.5, 40.5)"
    assert f'object {told.winner.object_number} "{told.winner.object_name}"' in lines[1]
    for part in ("model", "world", "view", "clip", "NDC", "screen, pixels", "snapped, 1/256 pixel"):
        assert sum(line.startswith(part + "  ") for line in lines) == 1
    first = next(n for n, line in enumerate(lines) if line.startswith("screen, pixels"))
    assert len({line.rindex(".") for line in lines[first : first + 3]}) == 1
    assert lines[-1].split()[-3:] == [str(code) for code in told.color[:3].tolist()]


def test_a_tall_stack_of_faces_prints_its_top():
    told = rj.explain_pixel(layers(np.linspace(0.9, -0.9, 50)), CLIP, (128, 128), 10, 10)
    assert [face.face for face in told.faces] == list(range(49, -1, -1))
    assert "and 38 more" in str(told)
    assert str(told).count("  hidden\n") == 11


def test_coordinates_of_any_size_print(cube):
    for scale in (1e-9, 1e9):
        scene = rj.Scene()
        scene.add(cube, transforms.scale(scale))
        camera = rj.PerspectiveCamera(
            (2.5 * scale, 3 * scale, 4 * scale), (0, 0, 0), near=0.1 * scale
        )
        text = str(rj.explain_pixel(scene, camera, SIZE, 48, 40))
        assert "e+" in text or "e-" in text
        assert max(map(len, text.splitlines())) <= 120


ALONG = rj.OrthographicCamera((0, 0, 6), (0, 0, 0), (0, 1, 0), 8.0, 0.5, 50.0)
"""Ten pixels of a picture of `SIZE` are a scene unit."""


@pytest.mark.parametrize(
    ("options", "size"),
    [
        ({"size": 9.0}, "9 x 9 pixels"),
        ({"size": [5.0, 7.0], "shape": "disc"}, "5 pixels across"),
        ({"size": 0.8, "unit": "world", "shape": "disc"}, "8 pixels across"),
        ({"size": 0.8, "unit": "world", "shape": "sphere"}, "8 pixels across at that depth"),
        ({"size": 0.8, "unit": "world"}, "8 x 8 pixels"),
    ],
)
def test_of_a_point_it_says_what_it_is_where_and_how_large(options, size):
    points = rj.Points([(0.1, -0.2, 0), (3, 0, 0)], **options)
    told = rj.explain_pixel(points, ALONG, SIZE, 48, 40)
    text, kind = str(told), points.shape
    assert f"face 0 ({kind} 0 of object 0" in text
    assert f"a {kind} with its centre at (49.0000, 42.0000) on the screen, {size}\n" in text
    assert "lies 0.5000 pixels left of that and 1.5000 above it\n" in text
    assert ("of discs and spheres the nearest alone is known" in text) == (kind != "square")
    assert f"the centre of {kind} 0" in text
    for word in ("clipped", "cut", "edge", "weight", "snapped"):
        assert word not in text
    primitive = told.winner.primitive
    assert primitive.kind == told.winner.kind == kind
    np.testing.assert_allclose(primitive.place, (49, 42), rtol=1e-12)
    np.testing.assert_allclose(primitive.offset, (-0.5, -1.5), rtol=1e-12)


@pytest.mark.parametrize("options", [{"width": 6.0}, {"width": 0.6, "unit": "world"}])
def test_of_a_segment_it_says_its_ends_its_width_and_where_on_it_the_pixel_lies(options):
    lines = rj.Lines([(-2, 0, 0), (2, 0, 0), (2, 2, 0)], **options)
    text = str(rj.explain_pixel(lines, ALONG, SIZE, 38, 41))
    assert "face 0 (segment 0 of object 0" in text
    assert "a segment from (28.0000, 40.0000) to (68.0000, 40.0000) on the screen, 6 pixels" in text
    assert (
        "lies 1.5000 pixels from its middle line,\nat 0.737500 of vertex 0 and 0.262500 of" in text
    )
    assert "the ends of segment 0" in text
    for word in ("clipped", "cut", "edge", "with perspective", "snapped", "nearest alone"):
        assert word not in text


def test_a_segment_that_passes_the_eye_has_an_end_that_is_nowhere():
    camera = rj.PerspectiveCamera((0, 0, 6), (0, 0, 0), (0, 1, 0), 45.0, 0.5, 50.0)
    lines = rj.Lines([(0, 0, 0), (0.5, 0, 9)], width=6.0)
    text = str(rj.explain_pixel(lines, camera, SIZE, 50, 40))
    assert "a segment from (48.0000, 40.0000) to behind the eye on the screen, 6 pixels" in text


def test_a_pixel_beside_discs_and_spheres_names_the_nearest():
    places = [(-3.0, 0, 0), (3.0, 0, 0)]
    for shape in ("disc", "sphere", "square"):
        points = rj.Points(places, shape=shape, unit="world", size=0.6)
        told = rj.explain_pixel(points, ALONG, SIZE, 90, 40)
        assert told.winner is None
        (said,) = [one for one in told.reasons if "nearest" in one]
        face, distance = said.removeprefix("the nearest face drawn is ").split(", ")
        assert face == "1"
        assert 9.0 <= float(distance.split()[0]) <= 10.0


def test_triangles_say_nothing_of_points(cube):
    told = rj.explain_pixel(cube, None, SIZE, 48, 40)
    assert told.winner.primitive is None
    assert told.winner.kind == "face"
    assert "edge opposite it" in str(told)
