"""Whole pictures, each moved by a part of a pixel, are averaged; all else is done once."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
from test_plan_view import effects

import rasterjit as rj
from rasterjit.effects.shadows import maps
from rasterjit.effects.shadows import stage as shadows_stage
from rasterjit.pipeline.visibility import visibility_pass as drawing
from rasterjit.rendering import frame_shading as shade_passes
from rasterjit.rendering import planning as plan_resources
from rasterjit.rendering import supersample
from rasterjit.rendering.supersample import MovedCamera, sample_offsets, sample_spacing
from rasterjit.runtime import threads as sharing
from rasterjit.scene import transforms as tf

SIZE = (20, 14)
MANY = rj.Quality(samples=64)
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = [[0, 1, 2], [0, 2, 3]]
LOOKING = {"eye": (0.8, 1.2, 5.0), "target": (0.1, 0.0, 0.0), "near": 0.5}
CAMERAS = {
    "perspective": rj.PerspectiveCamera(**LOOKING, far=30.0),
    "no far plane": rj.PerspectiveCamera(**LOOKING, far=math.inf),
    "parallel": rj.OrthographicCamera(**LOOKING, height=3.0, far=30.0),
    "intrinsics": rj.MatrixCamera.from_intrinsics(
        16.0, 19.0, 9.0, 7.5, SIZE, view_from_world=rj.PerspectiveCamera(**LOOKING).view_matrix()
    ),
    "oblique": rj.MatrixCamera(
        rj.PerspectiveCamera(**LOOKING).view_matrix(),
        tf.orthographic(-2.5, 2.0, -1.5, 2.0, 0.0, 9.0) @ (np.eye(4) + 0.1 * np.eye(4, k=2)),
    ),
}
every_camera = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)


def square(*, uv=None, **material):
    return rj.Mesh(SQUARE, FACES, uv=uv, material=rj.Material(**material))


def scene_of(*placed, lights=(), **fields):
    scene = rj.Scene()
    for mesh, place in placed:
        scene.add(mesh, place)
    scene.lights = list(lights)
    for name, value in fields.items():
        setattr(scene, name, value)
    return scene


def rich_scene(**fields):
    """Glass before textured, shiny and holey faces, in fog by height, under a sky."""
    image = np.random.default_rng(5).random((8, 8, 4)).astype(np.float32)
    texture = rj.Texture(image, filter="trilinear")
    uv = SQUARE[:, :2] + 1.0
    return scene_of(
        (square(shading="phong", specular=0.5), tf.translate((0, 0, -0.6))),
        (square(shading="phong", base_color_texture=texture, alpha_mode="mask", uv=uv),
         tf.rotate((1, 2, 3), 50.0)),
        (square(shading="pbr", metallic=1.0, roughness=0.3), tf.translate((-1.2, 0.5, 0.1))),
        (square(shading="flat", base_color=(0.2, 0.8, 0.4, 0.5), alpha_mode="blend"),
         tf.translate((0.6, -0.4, 0.9))),
        environment=rj.Environment.gradient("blue", "white", "green"),
        fog=rj.Fog("#8090a0", mode="exp", density=0.2, height=0.5, falloff=0.7),
        ambient_occlusion=rj.AmbientOcclusion(0.8),
        **fields,
    )  # fmt: skip


def averaged(scene, camera, size=SIZE, samples=64, first=None, spacing=None, **options):
    """Return the mean of the first pictures as `render` makes each, (H, W, 4) float64."""
    spacing = sample_spacing(samples) if spacing is None else spacing
    offsets = sample_offsets(samples)[:first]
    total = np.zeros((size[1], size[0], 4))
    for offset in offsets:
        moved = MovedCamera(camera, offset, spacing)
        linear = rj.render(scene, moved, size=size, outputs=("linear",), **options).linear.astype(
            float
        )
        total[..., :3] += linear[..., :3] * linear[..., 3:]
        total[..., 3] += linear[..., 3]
    alpha = total[..., 3:]
    return np.append(
        total[..., :3] / np.where(alpha > 0.0, alpha, 1.0), alpha / len(offsets), axis=2
    )


def draw(scene, camera=CAMERAS["perspective"], quality=MANY, size=SIZE, **options):
    return rj.render(scene, camera, size=size, quality=quality, **options)


# Where the samples lie


@pytest.mark.parametrize("samples", [4, 16, 64, 256])
def test_samples_are_the_centres_of_a_grid_over_the_pixel(samples):
    side = math.isqrt(samples)
    centres = [(k + 0.5) / side - 0.5 for k in range(side)]
    offsets = sample_offsets(samples)
    assert sorted(offsets) == [(x, y) for x in centres for y in centres]


@pytest.mark.parametrize("samples", [16, 64, 256])
def test_the_first_samples_lie_one_in_each_cell_of_a_coarser_grid(samples):
    offsets = np.array(sample_offsets(samples)) + 0.5
    for side in [side for side in (2, 4, 8) if side * side < samples]:
        first = offsets[: side * side]
        cells = np.floor(first * side).astype(int)
        assert len({*map(tuple, cells.tolist())}) == side * side
        # Neither picture nor edges wander while samples are added.
        assert first.mean(axis=0).tolist() == [0.5, 0.5]
        # No two are as near as they could be.
        apart = np.abs(first[:, np.newaxis] - first)
        distances = np.linalg.norm(np.minimum(apart, 1.0 - apart), axis=2)
        distances[np.diag_indices(len(first))] = 1.0
        assert distances.min() >= 1.4 / math.isqrt(samples)


@every_camera
def test_moved_camera_sees_at_centres_what_the_camera_sees_beside_them(camera):
    rng, (width, height) = np.random.default_rng(1), SIZE
    for offset in [(0.5, -0.25), (-0.03125, 0.46875)]:
        moved = MovedCamera(camera, offset)
        for point in rng.uniform(-1.0, 1.0, (20, 3)):
            places = []
            for one in (camera, moved):
                x, y, z, w = one.projection_matrix(SIZE) @ one.view_matrix() @ [*point, 1.0]
                places.append(((x / w + 1) * width / 2, (1 - y / w) * height / 2, z / w, w))
            (x, y, *deep), (at_x, at_y, *moved_deep) = places
            assert (at_x, at_y) == pytest.approx((x - offset[0], y - offset[1]), abs=1e-12)
            # Depth and the eye are no others.
            assert moved_deep == deep
        assert (moved.eye_position() == camera.eye_position()).all()
        assert moved.depth_coefficients() == camera.depth_coefficients()
        assert moved.view_depth([0.25, -0.5]).tolist() == camera.view_depth([0.25, -0.5]).tolist()


# What is averaged


@pytest.mark.parametrize("camera", [CAMERAS[name] for name in ("no far plane", "oblique")])
def test_frame_is_the_mean_of_pictures_that_are_each_drawn_and_shaded(camera):
    scene = rich_scene()
    many = draw(scene, camera, outputs=("linear",), threads=1)
    expected = averaged(scene, camera, threads=1)
    assert many.linear.tobytes() == expected.astype(np.float32).tobytes()
    one = draw(scene, camera, rj.Quality(), outputs=("linear",), threads=1)
    assert np.abs(many.linear - one.linear).max() > 0.1


def textured_scene():
    """A ground behind the near plane, a ball of small faces, holes and glass: all with texels."""
    rng = np.random.default_rng(8)
    texels = rng.random((8, 8, 4)).round().repeat(8, axis=0).repeat(8, axis=1)
    texture = rj.Texture(texels, rotation=15.0, scale=(2.0, 3.0))
    turn, height = np.meshgrid(np.linspace(0.0, 6.0, 24), np.linspace(-1.0, 1.0, 24))
    round_off = np.sqrt(1.0 - 0.9 * height**2)
    ball = np.stack([round_off * np.cos(turn), height, round_off * np.sin(turn)], axis=-1)
    first = (24 * np.arange(23)[:, np.newaxis] + np.arange(23)).ravel()
    faces = np.concatenate([np.stack([first, first + 1, first + 25], axis=1),
                            np.stack([first, first + 25, first + 24], axis=1)])  # fmt: skip
    look = {"base_color_texture": texture, "shading": "unlit"}
    ground = square(uv=20.0 * SQUARE[:, :2], **look)
    return scene_of(
        (ground, tf.compose(tf.translate((0, -1.2, 0)), tf.rotate_x(-90.0), tf.scale(20.0))),
        (rj.Mesh(ball.reshape(-1, 3), faces, uv=np.stack([turn, height], axis=-1).reshape(-1, 2),
                 material=rj.Material(**look)), tf.scale(0.8)),
        (square(uv=SQUARE[:, :2], alpha_mode="mask", **look), tf.rotate((1, 2, 3), 70.0)),
        (square(uv=SQUARE[:, :2], alpha_mode="blend", base_color=(1, 1, 1, 0.5), **look),
         tf.translate((0.9, 0.3, 0.5))),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("filter", "interpolation"), [("trilinear", "affine"), ("anisotropic4", "perspective")]
)
def test_the_mean_of_pictures_is_that_of_the_cells_of_a_larger_picture(filter, interpolation):
    """Each sample shows what a pixel shows that is as large as its share: so do its textures."""
    scene, camera = textured_scene(), CAMERAS["perspective"]
    own = {"interpolation": interpolation, "texture_filter": filter}
    many = draw(scene, camera, rj.Quality(samples=256, **own), outputs=("linear",))
    # Vertices lie on the same grid: 16 times as large, 16 times as coarse.
    large = draw(
        scene, camera, rj.Quality(subpixel_bits=4, **own), (16 * SIZE[0], 16 * SIZE[1]),
        outputs=("linear",),
    ).linear  # fmt: skip
    cells = large.reshape(SIZE[1], 16, SIZE[0], 16, 4).astype(float).mean(axis=(1, 3))
    assert cells.std() > 0.1
    np.testing.assert_allclose(many.linear, cells, atol=2e-5)
    # Filtered for whole pixels, textures look otherwise.
    blurred = averaged(scene, camera, quality=rj.Quality(**own), spacing=1.0)
    assert np.abs(blurred - cells).max() > 0.1
    assert np.abs(blurred - cells).mean() > 0.01


@pytest.mark.parametrize("background", [(0.3, 0.2, 0.1, 0.25), (0, 0, 0, 0), (0.5, 0.4, 0.3, 0.0)])
def test_backgrounds_that_are_seen_through_are_mixed_by_alpha(background):
    scene = scene_of((square(base_color="red", shading="unlit"), tf.rotate_z(20.0)))
    many = draw(scene, background=background, outputs=("linear", "face_id"), threads=1)
    expected = averaged(scene, CAMERAS["perspective"], background=background, threads=1)
    seen = expected[..., 3] > 0.0
    np.testing.assert_allclose(many.linear[seen], expected[seen], rtol=1e-6)
    outside = many.linear[0, 0]
    assert outside.tolist() == np.float32(background).tolist()
    edges = (many.linear[..., 3] > background[3]) & (many.linear[..., 3] < 1.0)
    assert edges.sum() > 15
    # What is not seen lends its colour to nothing.
    assert background[3] > 0.0 or (many.linear[edges][:, :3] == [1.0, 0.0, 0.0]).all()


@pytest.mark.parametrize("tone_map", [rj.ToneMap("aces", 1.0), rj.ToneMap("none", 2.0)])
@pytest.mark.parametrize("background", [None, (0.1, 0.2, 0.3, 1.0), (0.1, 0.2, 0.3, 0.4)])
def test_tones_are_mapped_after_the_light_is_averaged(tone_map, background):
    scene = scene_of((square(base_color="#c08040", shading="unlit"), tf.rotate_z(20.0)),
                     tone_map=tone_map)  # fmt: skip
    both = draw(scene, background=background, outputs=("color", "linear"), threads=1)
    plain = draw(scene_of(*[(node.mesh, node.world_from_model) for node in scene.nodes]),
                 background=background, outputs=("linear",), threads=1)  # fmt: skip
    np.testing.assert_allclose(both.linear, plain.linear, rtol=1e-6)
    one = draw(scene, quality=rj.Quality(), background=background, outputs=("color", "object_id"),
               threads=1)  # fmt: skip
    # Where one surface is all that a pixel shows, or none, it looks as with one sample.
    shifts = [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]
    near = [np.roll(one.object_id, shift, (0, 1)) for shift in shifts]
    flat = (np.array(near) == one.object_id).all(axis=0)
    assert 60 < flat.sum() < 250
    assert (both.color[flat] == one.color[flat]).all()
    assert (both.color[~flat] != one.color[~flat]).any()
    assert draw(scene, background=background, threads=1).color.tobytes() == both.color.tobytes()


def test_sky_is_averaged_where_nothing_else_is_in_view():
    image = np.random.default_rng(3).random((16, 32, 3)).astype(np.float32)
    sky = rj.Environment(image)
    scene = scene_of((square(), tf.translate((500.0, 0, 0))), environment=sky)
    many = draw(scene, outputs=("linear",), threads=1)
    assert many.plan.pictures == 64
    assert many.linear.tobytes() == averaged(
        scene, CAMERAS["perspective"], threads=1
    ).astype(np.float32).tobytes()  # fmt: skip
    behind_a_wall = draw(scene, background="red", outputs=("linear",), threads=1)
    assert behind_a_wall.plan.pictures == 1


def test_edges_drawn_over_the_colour_are_drawn_once():
    scene = scene_of((square(shading="flat"), tf.rotate_z(20.0)), (square(), tf.rotate_x(60.0)))
    bare = draw(scene, outputs=("color", "linear"), threads=1)
    for name, value in (("outline", rj.Outline("red")), ("wireframe", rj.Wireframe("red"))):
        marked = replace_field(scene, name, value)
        many = draw(marked, outputs=("color", "linear"), threads=1)
        one = draw(marked, quality=rj.Quality(), threads=1)
        red = [255, 0, 0, 255]
        drawn = (one.color == red).all(axis=2)
        assert 20 < drawn.sum() < 150
        assert ((many.color == red).all(axis=2) == drawn).all()
        assert (many.color[~drawn] == bare.color[~drawn]).all()
        assert many.linear.tobytes() == bare.linear.tobytes()


def replace_field(scene, name, value):
    changed = scene_of(*[(node.mesh, node.world_from_model) for node in scene.nodes],
                       lights=scene.lights)  # fmt: skip
    setattr(changed, name, value)
    return changed


def test_a_picture_needs_what_it_shows_and_keeps_the_answers_of_its_frame():
    sky = rj.Environment.gradient("blue", "white", "green")
    scene = scene_of((square(), np.eye(4)), wireframe=rj.Wireframe("red", "only"), environment=sky)
    outputs = "color", "depth"
    plan = rj.explain(scene, CAMERAS["parallel"], MANY, outputs=outputs, diagnose=True)
    assert plan.facts.finds_faces
    assert (plan.outputs, plan.facts.diagnose) == (outputs, True)
    picture = supersample.plan_picture(plan, {})
    assert picture.outputs == picture.facts.outputs == ("linear",)
    assert not picture.facts.diagnose
    assert not picture.facts.finds_faces
    covering = plan.for_picture(outputs=("face_id",))
    assert covering.facts.finds_faces
    assert not covering.facts.is_colored
    assert effects(covering) == effects(plan)


def test_wireframe_alone_is_drawn_once_over_the_background():
    scene = scene_of((square(), tf.rotate_z(20.0)), wireframe=rj.Wireframe("red", "only"))
    many, one = draw(scene, threads=1), draw(scene, quality=rj.Quality(), threads=1)
    assert many.plan.pictures == 1
    assert many.color.tobytes() == one.color.tobytes()


def test_buffers_and_counts_are_those_of_one_sample():
    scene = rich_scene()
    outputs = ("depth", "face_id", "object_id", "barycentric", "uv", "normal", "position")
    one = draw(scene, quality=rj.Quality(), outputs=outputs, diagnose=True)
    many = draw(scene, outputs=("color", *outputs), diagnose=True)
    assert (one.plan.pictures, many.plan.pictures) == (1, 64)
    for name in outputs:
        assert many.arrays()[name].tobytes() == one.arrays()[name].tobytes(), name
    counts = [field.name for field in dataclasses.fields(rj.FrameStats) if field.name != "seconds"]
    assert [getattr(many.stats, n) for n in counts] == [getattr(one.stats, n) for n in counts]
    assert many.stats.pixels_covered == one.stats.pixels_covered
    assert many.diagnostics.samples == one.diagnostics.samples
    alone = draw(scene, outputs=outputs)
    assert alone.plan.pictures == 1


def test_threads_change_no_bit(monkeypatch):
    size = (70, 66)
    # Small frames are one task otherwise.
    monkeypatch.setattr(sharing, "MIN_PIXELS_PER_TASK", 256)
    monkeypatch.setattr(drawing, "TILES_PER_TASK", 1)
    for scene in (rich_scene(), scene_of(GROUND, ROOF, lights=[SUN])):
        one, other = (
            draw(scene, size=size, outputs=("color", "linear"), threads=threads)
            for threads in (1, 3)
        )
        assert other.color.tobytes() == one.color.tobytes()
        assert other.linear.tobytes() == one.linear.tobytes()


# Shadow maps


SUN = rj.DirectionalLight((-0.4, -1.0, -0.5), shadow=rj.Shadow(512, "hard"))
GROUND = square(shading="flat", specular=0.0), tf.compose(tf.rotate_x(-90.0), tf.scale(8.0))
ROOF = (
    square(shading="flat", specular=0.0),
    tf.compose(tf.translate((0.3, 1.0, 0.0)), tf.rotate_x(-80.0)),
)


@pytest.fixture
def drawn(monkeypatch):
    """Note of each shadow map that is asked for whether it is drawn."""
    caught, draw_shadows = [], maps.draw_shadows

    def catch(*arguments):
        found = draw_shadows(*arguments)
        caught.append(found is not None)
        return found

    monkeypatch.setattr(maps, "draw_shadows", catch)
    return caught


@pytest.mark.parametrize(
    "light",
    [SUN, rj.PointLight((1.0, 3.0, 1.0), intensity=9.0, shadow=rj.Shadow(512, "hard")),
     rj.SpotLight((1, 4, 1), (-0.2, -1, -0.3), intensity=16.0, shadow=rj.Shadow(512, "hard"))],
    ids=lambda light: type(light).__name__,
)  # fmt: skip
def test_shadow_maps_are_drawn_for_many_pictures_at_once(light, drawn):
    scene = scene_of(GROUND, ROOF, lights=[light])
    camera = rj.PerspectiveCamera((1.5, 2.5, 5.0), (0, 0, 0), near=0.1)
    many = draw(scene, camera, size=(40, 30), outputs=("linear",), background="black")
    assert len(drawn) == 3
    expected = averaged(scene, camera, (40, 30), background="black")
    assert len(drawn) == 3 + 64
    # Maps that are fitted to each picture anew differ by parts of a texel along their edges.
    lit = expected[..., 0].max()
    apart = np.abs(many.linear - expected)[..., 0] / lit
    assert (apart > 0.003).mean() < 0.2
    assert apart.max() < 0.1
    assert apart.mean() < 0.002
    one = draw(scene, camera, rj.Quality(), size=(40, 30), outputs=("linear",), background="black")
    assert np.abs(one.linear - expected)[..., 0].max() > 0.3 * lit


def test_no_map_is_drawn_where_nothing_casts_a_shadow_on_what_is_seen(drawn):
    # The boxes meet, but nothing lies between the light and the ground that is seen.
    aside = square(), tf.compose(tf.translate((90.0, 1.0, 0.0)), tf.rotate_x(-80.0))
    scene = scene_of(GROUND, aside, lights=[SUN])
    assert draw(scene, outputs=("linear",)).linear[..., :3].max() > 0.3
    assert not any(drawn)
    assert len(drawn) <= 3


def test_shadow_maps_reach_around_what_any_picture_shows(monkeypatch):
    """Ground whose nearest and farthest points lie between the centres of pixels and the border."""
    fitted, fit = [], maps._fit_parallel

    def watch(light, scenery, row):
        fitted.append(None)
        matrix = fit(light, scenery, row)
        fitted[-1] = row.copy()
        return matrix

    monkeypatch.setattr(maps, "_fit_parallel", watch)
    sun = rj.DirectionalLight((0.0, -1.0, 0.0), shadow=rj.Shadow(1024, "hard"))
    scene = scene_of(GROUND, ROOF, lights=[sun])
    camera = rj.PerspectiveCamera((0.0, 1.5, 3.0), (0, 0.4, 0), near=0.1)
    many = rj.Quality(samples=256)
    draw(scene, camera, rj.Quality(), size=(12, 9), outputs=("linear",))
    frame = draw(scene, camera, many, size=(12, 9), outputs=("linear",))
    centres, *steps = fitted
    outside = 0
    for n, offset in enumerate(sample_offsets(256)):
        everywhere = steps[(n >= 4) + (n >= 16) + (n >= 64)]
        moved = MovedCamera(camera, offset)
        seen = rj.render(scene, moved, size=(12, 9), outputs=("position", "face_id"))
        points = seen.position[seen.face_id >= 0].astype(float) - camera.eye_position()
        for row in (everywhere, centres):
            places = [
                points @ row[3 * k : 3 * k + 3] * row[shadows_stage.FOCAL + k]
                + row[shadows_stage.CENTER + k]
                for k in (0, 1)
            ]
            inside = [(place > 0.0) & (place < 1024.0) for place in places]
            if row is everywhere:
                assert np.all(inside)
            else:
                outside += np.count_nonzero(~np.all(inside, axis=0))
    # Fitted to the centres alone, it would not.
    assert outside > 0
    assert frame.plan.pictures == 256


# What is told


def test_plan_tells_of_pictures(cube, camera):
    plan = rj.explain(cube, camera, MANY)
    assert plan.pictures == 64
    assert plan.layers is None
    assert effects(plan)["anti-aliasing"] == (
        True, "64 pictures, moved by fractions of a pixel, each shaded by itself",
    )  # fmt: skip
    assert "64 of 64" in str(plan)
    assert rj.explain(cube, camera).pictures == 1
    assert "pictures" not in str(rj.explain(cube, camera))
    labels = rj.explain(cube, camera, MANY, outputs=("depth",))
    assert labels.pictures == 1
    assert effects(labels)["anti-aliasing"] == (False, "nothing is shaded")


def test_buffers_of_pictures_are_told(cube, camera):
    plan = rj.explain(cube, camera, MANY, size=SIZE)
    told = {buffer.name: buffer.bytes for buffer in plan_resources.list_buffers(plan)}
    pixels = SIZE[0] * SIZE[1]
    assert told["sums of all pictures"] == 32 * pixels
    assert told["one of the pictures"] == 16 * pixels
    one = rj.explain(cube, camera, size=SIZE)
    assert "sums of all pictures" not in {b.name for b in plan_resources.list_buffers(one)}


def test_memory_does_not_grow_with_the_number_of_pictures(monkeypatch, cube, camera):
    held = []
    add = supersample._add_picture

    def watch(linear, sums, workers):
        blocks = workers.memory._blocks_by_size.values()
        held.append(sum(block.bytes.nbytes for of_size in blocks for block in of_size))
        add(linear, sums, workers)

    monkeypatch.setattr(supersample, "_add_picture", watch)
    draw(cube, camera, size=(120, 80), threads=1)
    assert len(held) == 64
    assert held[0] == held[-1]


def test_measurement_switches_pictures_off(cube, camera):
    measured = rj.profile(cube, camera, MANY, size=SIZE, rounds=1)
    assert ("anti-aliasing", "off") in [(change.name, change.what) for change in measured.changes]
    assert measured.stages["average"] > 0.0
    assert "coverage_resolve.add_picture" in str(measured)


def test_pixel_is_explained_by_its_centre_and_what_else_it_shows(cube, camera):
    frame = draw(cube, camera, outputs=("color", "linear", "face_id"), threads=1)
    one = draw(cube, camera, rj.Quality(), outputs=("linear",), threads=1)
    apart = np.abs(frame.linear - one.linear).max(axis=2)
    row, column = np.unravel_index(np.where(frame.face_id >= 0, apart, 0.0).argmax(), apart.shape)
    told = rj.explain_pixel(cube, camera, SIZE, int(column), int(row), quality=MANY)
    assert told.linear.tobytes() == frame.linear[row, column].tobytes()
    assert told.color.tobytes() == frame.color[row, column].tobytes()
    own, others = told.parts
    np.testing.assert_array_equal(own.color, one.linear[row, column, :3])
    assert "64 samples" in others.name
    np.testing.assert_array_equal(others.color, frame.linear[row, column, :3] - own.color)


def test_one_sample_draws_no_picture_twice(monkeypatch, cube, camera):
    calls, shade = [], shade_passes.shade_faces

    def watch(*arguments):
        calls.append(arguments)
        return shade(*arguments)

    monkeypatch.setattr(shade_passes, "shade_faces", watch)
    for samples, count in ((1, 1), (16, 1), (64, 64), (256, 256)):
        calls.clear()
        draw(cube, camera, replace(MANY, samples=samples))
        assert len(calls) == count
