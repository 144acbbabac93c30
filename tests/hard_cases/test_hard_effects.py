"""
What a scene does not call for is left out, and leaving it out changes no bit.

For each gate: the exact condition under which skipping loses nothing, a frame in which the work is
provably not done, and a case a single pixel away in which it must be done. For samples, shadows,
layers and fog this file holds the condition, on the engine's own coverage, depth and texture
coordinates; ``test_hard_drawn_effects`` holds the pictures.
"""

from __future__ import annotations

import importlib
import math
from fractions import Fraction

import naive
import numpy as np
import pytest
import stages

import rasterjit as rj
from rasterjit.effects import wireframe
from rasterjit.inspect import oracle
from rasterjit.outputs import ground_truth, motion, output_table
from rasterjit.pipeline.geometry import clipping
from rasterjit.pipeline.surface import scalar_colors
from rasterjit.pipeline.visibility import visibility_pass as drawing
from rasterjit.rendering import frame_shading, planning, supersample
from rasterjit.scene import transforms as tf
from rasterjit.scene.texture import Pyramid
from rasterjit.survey import packed_scene

rendering = importlib.import_module("rasterjit.rendering.renderer")  # rj.render is the function

SIZE = (16, 16)
SQUARE = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
SQUARE_FACES = [[0, 1, 2], [0, 2, 3]]
FRONT = rj.OrthographicCamera((0, 0, 1), (0, 0, 0), near=0.0, far=2.0)
"""Sees the square from +z, and nothing beside it."""
BITS = ("linear", "color")


def scene_of(*meshes, lights=()):
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh)
    scene.lights = list(lights)
    return scene


def square(shading="phong", normals=None, specular=0.0, **options):
    material = rj.Material(shading, "white", specular=specular, shininess=8.0)
    return rj.Mesh(SQUARE, SQUARE_FACES, normals=normals, material=material, **options)


def draw(what, camera=FRONT, outputs=BITS, **options):
    return rj.render(what, camera, size=SIZE, outputs=outputs, threads=1, **options)


def same(one, other):
    """Tell whether two frames have the same bits."""
    return all(
        array.tobytes() == other.arrays()[name].tobytes() for name, array in one.arrays().items()
    )


def pixels_that_differ(one, other):
    return int((one.linear != other.linear).any(axis=2).sum())


@pytest.fixture
def forbid(monkeypatch):
    """Make a function fail if it is called: its work was not asked for."""

    def forbid_one(module, name):
        def refuse(*arguments, **options):
            raise AssertionError(f"{name} has nothing to do here")

        assert callable(getattr(module, name))
        monkeypatch.setattr(module, name, refuse)

    return forbid_one


@pytest.fixture
def calls(monkeypatch):
    """Count the calls of a function."""

    def watch(module, name):
        original, seen = getattr(module, name), []

        def count(*arguments, **options):
            seen.append(arguments)
            return original(*arguments, **options)

        monkeypatch.setattr(module, name, count)
        return seen

    return watch


# --- perspective ----------------------------------------------------------------------------------


@pytest.mark.case("G01")
@pytest.mark.parametrize("w", [1.0, 3.0, 2.0**-40])
def test_with_equal_w_perspective_weights_are_the_affine_ones(w):
    points = [(1, 0.5), (2.25, 15), (15, 6.75)]
    positions = naive.clip_from_screen(points, SIZE, 0.25, w)
    seen = rj.rasterize(positions, [[0, 1, 2]], SIZE, threads=1)
    corners = oracle.snap_triangle(points)
    rows, columns = np.nonzero(seen.face_id == 0)
    assert len(rows) > 80
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        weights = oracle.affine_weights(corners, (256 * column + 128, 256 * row + 128))
        assert weights == oracle.perspective_weights(
            corners, (w, w, w), (256 * column + 128, 256 * row + 128)
        )
        # From exact integers by one division in float64.
        assert seen.barycentric[row, column].tolist() == [np.float32(float(b)) for b in weights]


def affine_error(ratio):
    """Return how far affine weights are off along an edge whose ends have w = 1 and w = ratio."""
    size = (2048, 1)
    points = [(0, 0.5), (2048, 0.5), (0, 4)]  # the edge runs through the centres of the row

    def along(w):
        positions = naive.clip_from_screen(points, size)
        positions *= np.array([[1.0], [w], [1.0]])
        seen = rj.rasterize(positions, [[0, 1, 2]], size, threads=1)
        assert (seen.face_id == 0).all()
        return seen.barycentric[0, :, 1].astype(float)

    return np.abs(along(ratio) - along(1.0)).max()


@pytest.mark.case("G01")
def test_affine_weights_stay_below_half_a_code_up_to_a_w_ratio_of_1_00787():
    budget = 0.5 / 255
    # (sqrt r - 1) / (sqrt r + 1) < 1/510 if and only if r < (511/509)**2.
    limit = Fraction(511, 509) ** 2
    assert Fraction("1.00787") < limit < Fraction("1.00788")
    assert affine_error(1.00787) < budget
    assert affine_error(1.00788) > budget
    assert affine_error(1.0) == 0


@pytest.mark.case("G01")
def test_unequal_w_matters():
    points = [(0, 0), (0, 32), (32, 0)]
    frames = [
        rj.rasterize(naive.clip_from_screen(points, SIZE, 0, w), [[0, 1, 2]], SIZE, threads=1)
        for w in ([1, 1, 1], [1, 2, 4])
    ]
    assert (frames[0].face_id == frames[1].face_id).all()
    assert (frames[0].barycentric != frames[1].barycentric).any(axis=2).sum() > 1


# --- clipping -------------------------------------------------------------------------------------

GUARD = 1 + 2 * 8192 / 16
"""Largest |x| / w that is not cut, 8192 pixels beyond an image 16 pixels wide."""
INSIDE = [[-1.0, -1, 0, 1], [1, -1, 0, 1], [0, 1, 0, 1]]


@pytest.mark.case("G02")
@pytest.mark.parametrize(
    ("axis", "last"), [(0, GUARD), (0, -GUARD), (1, GUARD), (1, -GUARD), (2, 1.0), (2, -1.0)]
)
def test_the_clipper_runs_only_for_a_vertex_beyond_its_planes(axis, last, calls):
    clip = calls(drawing, "clip_faces")
    for scale in (1.0, 3.0):
        positions = np.array(INSIDE)
        positions[2, axis] = last
        seen = rj.rasterize(positions * scale, [[0, 1, 2]], SIZE, threads=1)
        assert seen.totals.clipped == 0
    assert not clip
    positions[2, axis] = np.nextafter(last, 2 * last)
    seen = rj.rasterize(positions, [[0, 1, 2]], SIZE, threads=1)
    assert len(clip) == 1
    assert seen.totals.clipped == 1


@pytest.mark.case("G02")
@pytest.mark.parametrize("w", [0.0, -1.0])
def test_the_clipper_runs_for_a_vertex_that_is_not_in_front(w, calls):
    clip = calls(drawing, "clip_faces")
    positions = np.array(INSIDE)
    positions[2] = 0, 1, 0, w
    rj.rasterize(positions, [[0, 1, 2]], SIZE, threads=1)
    assert len(clip) == 1


@pytest.mark.case("G02")
def test_clipping_something_hidden_changes_no_bit():
    whole = naive.clip_from_screen([(0, 0), (1, 31), (32, 0)], SIZE, [-0.5, -0.25, 0], [1, 2, 4])
    huge = np.array([[-1e4, -1e4, 0.9, 1], [1e4, -1e4, 0.9, 1], [0, 1e4, 0.9, 1]])
    left_out = rj.rasterize(whole, [[0, 1, 2]], SIZE, threads=1)
    forced = rj.rasterize(np.concatenate([whole, huge]), [[0, 1, 2], [3, 4, 5]], SIZE, threads=1)
    assert (left_out.totals.clipped, forced.totals.clipped) == (0, 1)
    shown = forced.face_id == 0
    assert shown.any()
    assert shown.tolist() == (left_out.face_id == 0).tolist()
    assert forced.depth[shown].tobytes() == left_out.depth[shown].tobytes()
    assert forced.barycentric[shown].tobytes() == left_out.barycentric[shown].tobytes()


@pytest.mark.case("G02")
def test_a_face_that_crosses_the_near_plane_by_one_pixel_is_cut(calls):
    size = (8, 1)
    clip = calls(drawing, "clip_faces")
    # z = -1 at the image's left side, or half-way between the first two centres.
    for start, covered in ((0.0, 8), (1.0, 7)):
        points = [(0, -1), (64, -1), (0, 64)]
        depths = [-1 + (x - start) / 128 for x, _ in points]
        positions = naive.clip_from_screen(points, size, depths)
        seen = rj.rasterize(positions, [[0, 1, 2]], size, threads=1)
        assert np.nonzero(seen.face_id[0] == 0)[0].tolist() == list(range(8 - covered, 8))
        assert len(clip) == (start > 0)


# --- depth ----------------------------------------------------------------------------------------


def faces_at_each_pixel(mesh, camera, cull):
    """Return how many faces of a mesh cover each pixel, drawn one by one."""
    clip_from_world = tf.compose(camera.projection_matrix(SIZE), camera.view_matrix())
    positions = tf.transform_points(clip_from_world, mesh.vertices)
    return sum(
        (rj.rasterize(positions, [face], SIZE, cull=cull, threads=1).face_id >= 0).astype(int)
        for face in mesh.faces
    )


@pytest.mark.case("G03")
def test_a_convex_object_without_its_back_needs_no_depth_test(cube, sphere, camera):
    for mesh in (cube, sphere):
        counts = faces_at_each_pixel(mesh, camera, "back")
        assert set(np.unique(counts)) == {0, 1}
        frame = draw(mesh, camera, ("face_id",), cull="back")
        assert ((frame.face_id >= 0) == (counts == 1)).all()
        # So the order of the faces does not matter.
        turned = rj.Mesh(mesh.vertices, mesh.faces[::-1])
        again = draw(turned, camera, ("face_id",), cull="back").face_id
        last = len(mesh.faces) - 1
        assert np.where(again >= 0, last - again, -1).tolist() == frame.face_id.tolist()


@pytest.mark.case("G03")
def test_a_convex_object_with_its_back_or_a_second_object_needs_one(cube, camera):
    assert faces_at_each_pixel(cube, camera, "none").max() == 2
    away = cube.vertices - [2.5, 3, 4]  # one behind the other
    both = rj.Mesh(
        np.concatenate([cube.vertices, away]), np.concatenate([cube.faces, cube.faces + 8])
    )
    assert faces_at_each_pixel(both, camera, "back").max() > 1


@pytest.mark.case("G03")
def test_layers_drawn_back_to_front_need_no_depth_test():
    rng = np.random.default_rng(3)
    layers = [
        (rng.integers(-4, 20, (3, 2)).tolist(), rng.integers(0, 256, 3).tolist()) for _ in range(12)
    ]
    plain, tested = rj.Framebuffer(*SIZE), rj.Framebuffer(*SIZE)
    for points, color in layers:
        plain.fill_triangle(*points, color)
    for depth, (points, color) in reversed(list(enumerate(layers))):
        tested.fill_triangle(*points, color, depth=(-depth,) * 3)
    assert plain.color.tobytes() == tested.color.tobytes()
    # In the wrong order without a test, the picture is another one.
    wrong = rj.Framebuffer(*SIZE)
    for points, color in reversed(layers):
        wrong.fill_triangle(*points, color)
    assert wrong.color.tobytes() != tested.color.tobytes()


# --- textures -------------------------------------------------------------------------------------
# The footprint of a pixel is rho texels, and lambda = log2 rho.

TEXELS = 16
PICTURE = np.random.default_rng(4).uniform(0, 1, (TEXELS, TEXELS, 3))


def draw_picture(filter, pixels):
    """Draw the picture over the whole image; return its linear light."""
    texture = rj.Texture(PICTURE, filter=filter)
    material = rj.Material("unlit", base_color_texture=texture)
    uv = [[0, 0], [1, 0], [1, 1], [0, 1]]
    mesh = rj.Mesh(SQUARE, SQUARE_FACES, uv=uv, material=material)
    size = (pixels, pixels)
    return rj.render(mesh, FRONT, size=size, outputs="linear", threads=1).linear


@pytest.fixture
def poisoned(monkeypatch):
    """Make every texel of the coarser mip levels NaN, so that reading one is seen."""
    prepared_by = Pyramid.prepare_chain

    def with_poison(pyramid, alpha, has_levels):
        texels = np.array(prepared_by(pyramid, alpha, has_levels))
        width, height = pyramid.size
        texels[0 if pyramid.codes is not None else width * height :] = np.nan
        return texels

    monkeypatch.setattr(Pyramid, "prepare_chain", with_poison)


@pytest.mark.case("G04")
@pytest.mark.parametrize("pixels", [16, 17, 32, 64])
def test_at_lambda_0_or_below_the_base_level_alone_is_read(pixels, poisoned):
    del poisoned
    assert math.log2(TEXELS / pixels) <= 0
    mixed = draw_picture("trilinear", pixels)
    assert np.isfinite(mixed).all()
    assert mixed.tobytes() == draw_picture("bilinear", pixels).tobytes()


@pytest.mark.case("G04")
def test_one_pixel_fewer_than_texels_reads_the_next_level(poisoned):
    del poisoned
    assert math.log2(TEXELS / 15) > 0
    assert np.isnan(draw_picture("trilinear", 15)[..., :3]).all()


# --- samples --------------------------------------------------------------------------------------
# One sample a pixel is drawn. Coverage of a sample elsewhere in the pixel is coverage of the
# triangle moved the other way.

FOUR_SAMPLES = [(6, 2), (14, 6), (2, 10), (10, 14)]
"""The standard places, sixteenths of a pixel."""


def sample_masks(points, size):
    """Return how many of the four samples of each pixel a triangle covers."""
    masks = np.zeros((size[1], size[0]), int)
    for x, y in FOUR_SAMPLES:
        moved = [(px + (8 - x) / 16, py + (8 - y) / 16) for px, py in points]
        seen = rj.rasterize(naive.clip_from_screen(moved, size), [[0, 1, 2]], size, threads=1)
        covered = oracle.covered_pixels(points, size, sample=(Fraction(x, 16), Fraction(y, 16)))
        rows, columns = np.nonzero(seen.face_id == 0)
        assert set(zip(columns.tolist(), rows.tolist(), strict=True)) == covered
        masks += seen.face_id == 0
    return masks


@pytest.mark.case("G05")
def test_a_tile_inside_one_triangle_needs_one_sample_a_pixel():
    size = (64, 64)
    # Its right angle is the tile's corner; its longest side passes through the opposite one.
    assert (sample_masks([(0, 0), (0, 128), (128, 0)], size) == 4).all()


@pytest.mark.case("G05")
def test_a_tile_whose_centres_alone_are_inside_needs_all_samples():
    size = (64, 64)
    # x + y = 127.125 leaves out two samples of the last pixel, 127.25 and 127.5, not its centre.
    points = [(0, 0), (0, 127.125), (127.125, 0)]
    seen = rj.rasterize(naive.clip_from_screen(points, size), [[0, 1, 2]], size, threads=1)
    assert (seen.face_id == 0).all()
    masks = sample_masks(points, size)
    assert masks[63, 63] == 2
    assert (masks == 4).sum() == 64 * 64 - 1


# --- normals --------------------------------------------------------------------------------------

SUN = rj.DirectionalLight((-1, -2, -3), color=(1.0, 0.9, 0.7), intensity=0.6)


@pytest.mark.case("G06")
def test_equal_vertex_normals_are_the_normal_of_every_pixel():
    for normal in ((0, 0, 1), (1, 2, 3), (-0.3, 0.1, 0.7)):
        frame = draw(square(normals=[normal] * 4), outputs=("normal",))
        assert len(np.unique(frame.normal.reshape(-1, 3), axis=0)) == 1


@pytest.mark.case("G06")
def test_flat_shading_asks_for_no_vertex_normals_and_shows_the_same(forbid):
    up = [(0, 0, 1)] * 4
    smooth = draw(scene_of(square("phong", up, specular=0.5), lights=[SUN]))
    assert smooth.plan.facts.needs_normals
    forbid(packed_scene, "join_normals")
    flat = draw(scene_of(square("flat", up, specular=0.5), lights=[SUN]))
    assert not flat.plan.facts.needs_normals
    assert same(flat, smooth)


@pytest.mark.case("G06")
def test_one_normal_that_leans_is_seen(calls):
    joined = calls(packed_scene, "join_normals")
    up = [(0, 0, 1)] * 3
    frames = [
        draw(scene_of(square("phong", [*up, last]), lights=[SUN]))
        for last in ((0, 0, 1), (0.01, 0, 1))
    ]
    assert len(joined) == 2
    assert pixels_that_differ(*frames) > 0


# --- lights ---------------------------------------------------------------------------------------


@pytest.mark.case("G07")
@pytest.mark.parametrize("shading", ["flat", "gouraud", "phong"])
@pytest.mark.parametrize(
    "light",
    [rj.DirectionalLight((0, 0, 1)), rj.DirectionalLight((1, 0, 0)), rj.PointLight((0.3, 0, -1)),
     rj.DirectionalLight((0, 0, -1), intensity=0.0), rj.PointLight((0, 0, 1), intensity=0.0)],
    ids=["behind", "grazing", "point behind", "disabled", "point disabled"],
)  # fmt: skip
def test_a_light_that_reaches_nothing_can_be_dropped(light, shading):
    mesh = square(shading, [(0, 0, 1)] * 4, specular=0.5)
    without = draw(scene_of(mesh, lights=[SUN]))
    assert same(draw(scene_of(mesh, lights=[SUN, light])), without)
    assert same(draw(scene_of(mesh, lights=[light, SUN])), without)


@pytest.mark.case("G07")
@pytest.mark.parametrize("shading", ["gouraud", "phong"])
def test_a_light_that_reaches_one_vertex_can_not_be_dropped(shading):
    light = rj.DirectionalLight((1, 0, 0))
    normals = [(0, 0, 1)] * 3 + [(-1, 0, 1)]
    mesh = square(shading, normals)
    frames = [draw(scene_of(mesh, lights=lights)) for lights in ([SUN], [SUN, light])]
    # Vertex 3 belongs to the second face only.
    second = draw(mesh, outputs=("face_id",)).face_id == 1
    differ = (frames[0].linear != frames[1].linear).any(axis=2)
    assert differ[second].any()
    assert not differ[~second].any()


@pytest.mark.case("G07")
def test_a_caster_beside_the_view_of_the_light_changes_no_depth():
    # The depth map that a shadow reads: exactly the texels that a caster's bounds reach.
    receiver = rj.Mesh(SQUARE, SQUARE_FACES)
    texel = 2 / SIZE[0]

    def depths(left):
        corners = [[left, -9, 0.5], [left, 9, 0.5], [9, 0, 0.5]]
        return draw(scene_of(receiver, rj.Mesh(corners, [[0, 1, 2]])), outputs="depth").depth

    alone = draw(receiver, outputs="depth").depth
    assert depths(1.0).tobytes() == alone.tobytes()
    changed = depths(1.0 - texel) != alone
    assert changed[:, -1].all()
    assert not changed[:, :-1].any()


# --- layers ---------------------------------------------------------------------------------------


def layered_scene(size):
    """Return (frame, {pixel: layers nearest first}) of unlit triangles on a black background."""
    rng = np.random.default_rng(8)
    triangles = rng.integers(-256, 5000, (9, 3, 2)) / 256
    depths = rng.integers(-200, 200, (9, 3)) / 256
    colors = rng.integers(0, 257, (9, 3)) / 256
    points = triangles.reshape(-1, 2).tolist()
    positions = naive.clip_from_screen(points, size, depths.ravel())
    mesh = rj.Mesh(
        positions[:, :3], np.arange(27).reshape(9, 3), colors=colors,
        material=rj.Material("unlit", "white"),
    )  # fmt: skip
    camera = rj.MatrixCamera(np.eye(4), np.eye(4))
    frame = rj.render(
        mesh, camera, size=size, outputs=("linear", "face_id"), background="black", threads=1
    )
    layers = {}
    for face, (corners, zs) in enumerate(zip(triangles.tolist(), depths.tolist(), strict=True)):
        snapped = oracle.snap_triangle(corners)
        for column, row in oracle.covered_pixels(corners, size):
            z = oracle.depth_at(snapped, zs, (256 * column + 128, 256 * row + 128))
            layers.setdefault((column, row), []).append((z, face, tuple(colors[face])))
    return frame, {pixel: sorted(found) for pixel, found in layers.items()}


@pytest.mark.case("G08")
def test_opaque_layers_are_the_nearest_one():
    frame, layers = layered_scene(SIZE)
    assert max(len(found) for found in layers.values()) > 3
    for row in range(SIZE[1]):
        for column in range(SIZE[0]):
            found = layers.get((column, row), [])
            seen = oracle.composite([(color, 1) for _, _, color in found], (0, 0, 0))
            assert frame.linear[row, column, :3].tolist() == list(seen)
            assert frame.face_id[row, column] == (found[0][1] if found else -1)


@pytest.mark.case("G08")
def test_one_layer_that_is_almost_opaque_matters_where_it_is_seen_and_nowhere_else():
    # The frame stands for what skipping the layers would show.
    frame, layers = layered_scene(SIZE)
    shown = frame.face_id[frame.face_id >= 0]
    thin = int(np.bincount(shown).argmax())
    for (column, row), found in layers.items():
        shares = [(color, Fraction(255, 256) if n == thin else 1) for _, n, color in found]
        seen = oracle.composite(shares, (0, 0, 0))
        is_same = frame.linear[row, column, :3].tolist() == list(seen)
        assert is_same == (frame.face_id[row, column] != thin)


# --- highlights -----------------------------------------------------------------------------------


@pytest.mark.case("G09")
@pytest.mark.parametrize("model", ["flat", "gouraud", "phong"])
def test_no_highlight_equals_a_highlight_elsewhere(sphere, camera, model):
    # A second object inside of the first has a highlight, so the highlight code runs.
    def ball(specular):
        material = rj.Material(model, "white", specular=specular)
        return rj.Mesh(sphere.vertices, sphere.faces, material=material)

    lights = [rj.AmbientLight(intensity=0.15), SUN, rj.PointLight((2, 1, 3), intensity=4.0)]
    alone, company = scene_of(ball(0.0), lights=lights), scene_of(ball(0.0), lights=lights)
    company.add(ball(1.0), tf.scale(0.5))
    frames = draw(alone, camera), draw(company, camera)
    assert frames[0].plan.lighting.highlights is None
    assert frames[1].plan.lighting.highlights == 1
    assert same(*frames)


@pytest.mark.case("G09")
def test_the_least_highlight_is_seen(sphere, camera):
    frames = []
    for specular in (0.0, 2.0**-20):
        material = rj.Material("phong", "gray", specular=specular)
        mesh = rj.Mesh(sphere.vertices, sphere.faces, material=material)
        frames.append(draw(scene_of(mesh, lights=[SUN]), camera))
    assert [frame.plan.lighting.highlights for frame in frames] == [None, 1]
    assert pixels_that_differ(*frames) > 0


@pytest.mark.case("G09")
def test_the_highlight_of_an_unlit_object_asks_for_nothing(sphere, camera):
    shiny = rj.Mesh(sphere.vertices, sphere.faces, material=rj.Material("unlit", specular=1.0))
    assert draw(shiny, camera).plan.lighting is None


# --- sRGB -----------------------------------------------------------------------------------------


@pytest.mark.case("G10")
def test_codes_that_nothing_touches_pass_through():
    codes = np.random.default_rng(10).integers(0, 256, (2, 3)).astype(np.uint8)
    frame = draw(square("unlit", colors=codes), outputs=("color", "face_id"))
    assert frame.color[..., :3].tolist() == codes[frame.face_id].tolist()


@pytest.mark.case("G10")
def test_codes_that_are_mixed_do_not():
    black, white = np.zeros(3, np.uint8), np.full(3, 255, np.uint8)
    mesh = square("unlit", colors=np.stack([black, white, white, black]))
    color = rj.render(mesh, FRONT, size=(1, 1), threads=1).color
    assert color[0, 0].tolist() == [188, 188, 188, 255]  # 128 if the codes were mixed


@pytest.mark.case("G10")
def test_linear_output_alone_is_not_encoded():
    lit = scene_of(square(), lights=[SUN])
    with stages.lists_run() as lists:
        both = draw(lit)
    assert lists
    assert all({"write_linear", "write_opaque_codes"} < {*names} for names in lists)
    with stages.lists_run() as lists:
        alone = draw(lit, outputs="linear")
    assert lists
    assert not any("codes" in name for names in lists for name in names)
    with stages.bands_shaded() as bands:
        draw(lit, outputs="linear")
    assert not any(color.size for *_, color in bands)
    assert alone.linear.tobytes() == both.linear.tobytes()
    with stages.lists_run() as lists:
        color = draw(lit, outputs="color")
    assert not any("write_linear" in names for names in lists)
    assert color.color.tobytes() == both.color.tobytes()


# --- coefficients of zero -------------------------------------------------------------------------
# Of ambient light and the wireframe; fog, environments and tone curves are in
# ``test_hard_drawn_effects``.


@pytest.mark.case("G11")
@pytest.mark.parametrize("shading", ["unlit", "flat", "gouraud", "phong"])
def test_a_coefficient_of_zero_is_an_effect_that_is_absent(shading):
    mesh = square(shading, [(0.1, 0, 1)] * 4)
    without = draw(scene_of(mesh, lights=[SUN]))
    zero = rj.AmbientLight(intensity=0.0), rj.AmbientLight("black", 5.0)
    assert same(draw(scene_of(mesh, lights=[SUN, *zero])), without)
    least = draw(scene_of(mesh, lights=[SUN, rj.AmbientLight(intensity=2.0**-20)]))
    assert same(least, without) == (shading == "unlit")


@pytest.mark.case("G11")
def test_no_wireframe_draws_no_edge(forbid, calls):
    scene = scene_of(square(), lights=[SUN])
    drawn = calls(wireframe, "draw_edges")
    scene.wireframe = rj.Wireframe("red")
    with_edges = draw(scene)
    assert len(drawn) == 1
    assert with_edges.plan.data("wireframe") is scene.wireframe
    forbid(wireframe, "draw_edges")
    # Edges are drawn in 8 bits only, so linear light alone has none.
    linear = draw(scene, outputs="linear")
    assert linear.plan.data("wireframe") is None
    scene.wireframe = None
    without = draw(scene)
    assert without.plan.data("wireframe") is None
    assert linear.linear.tobytes() == without.linear.tobytes() == with_edges.linear.tobytes()
    assert with_edges.color.tobytes() != without.color.tobytes()


# --- effects that nobody sees ---------------------------------------------------------------------


@pytest.mark.case("G12")
def test_an_object_behind_the_camera_is_neither_cut_nor_drawn(sphere, camera, calls):
    material = rj.Material("phong", "orange", specular=0.5)
    visible = rj.Mesh(sphere.vertices, sphere.faces, material=material)
    outputs = (*BITS, "depth", "face_id", "normal", "barycentric")
    alone = draw(scene_of(visible, lights=[SUN]), camera, outputs)
    both = scene_of(visible, lights=[SUN])
    both.add(visible, tf.translate(3 * np.array(camera.eye)))
    set_up = calls(drawing, "draw_tiles")
    cut = calls(clipping, "clip_faces")
    frame = draw(both, camera, outputs)
    assert same(frame, alone)
    assert frame.stats.outside == alone.stats.outside + len(sphere.faces)
    assert frame.stats.drawn == alone.stats.drawn
    assert frame.stats.clipped == 0
    assert sum(len(arguments[0]) for arguments in cut) == 0
    # The tiles were given the visible faces alone.
    starts, binned = set_up[0][:2]
    assert binned[: starts[-1]].max() < len(sphere.faces)


@pytest.mark.case("G12")
def test_a_light_in_a_frame_without_colour_asks_for_nothing(sphere, camera, forbid):
    scene = scene_of(sphere, lights=[SUN, rj.AmbientLight()])
    scene.wireframe = rj.Wireframe()
    wanted = draw(scene, camera, ("color", "depth", "face_id"))
    for name in ("shade_in_bands", "light_vertices"):
        forbid(frame_shading, name)
    forbid(wireframe, "draw_edges")
    for name in ("join_normals", "join_surface"):
        forbid(packed_scene, name)
    frame = draw(scene, camera, ("depth", "face_id"))
    assert frame.plan.lighting is None
    assert not any(effect.used for effect in frame.plan.effects)
    assert frame.depth.tobytes() == wanted.depth.tobytes()
    assert frame.face_id.tobytes() == wanted.face_id.tobytes()


@pytest.mark.case("G12")
def test_a_scene_of_unlit_objects_is_not_lit_by_its_lights(sphere, camera, forbid):
    unlit = rj.Mesh(sphere.vertices, sphere.faces, material=rj.Material("unlit", "orange"))
    dark = draw(unlit, camera)
    forbid(planning, "pack_lights")
    forbid(packed_scene, "join_normals")
    forbid(frame_shading, "light_vertices")
    frame = draw(scene_of(unlit, lights=[SUN, rj.PointLight((0, 0, 3))]), camera)
    assert frame.plan.lighting is None
    assert same(frame, dark)


@pytest.mark.case("G12")
def test_an_output_that_nobody_asked_for_is_not_made(sphere, camera, forbid):
    uv = np.zeros((len(sphere.vertices), 2))
    mesh = rj.Mesh(
        sphere.vertices, sphere.faces, uv=uv, scalars=uv[:, 0], material=rj.Material("flat")
    )
    wanted = tuple(name for name in output_table.OUTPUTS if name not in output_table.MOTION_OUTPUTS)
    everything = draw(mesh, camera, wanted)
    for module, name in (
        (ground_truth, "fill_rows"), (ground_truth, "list_fills"), (packed_scene, "join_uv"),
        (packed_scene, "join_normals"), (ground_truth, "find_metric_depth"),
        (ground_truth, "map_boxes"), (ground_truth, "_number_materials"),
        (supersample, "measure_coverage"), (motion, "make_moment"), (scalar_colors, "fill_scalars"),
    ):  # fmt: skip
        forbid(module, name)
    frame = draw(mesh, camera, ("color",))
    assert frame.color.tobytes() == everything.color.tobytes()
    assert set(frame.arrays()) == {"color"}
