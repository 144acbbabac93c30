"""What lies outside the view costs nothing, and the plan says so."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.effects.shadows import maps, visible_cells
from rasterjit.effects.shadows import stage as shadows_stage
from rasterjit.rendering.planning import list_kernels
from rasterjit.scene import transforms as tf
from rasterjit.scene.pixel_projection import clip_from_relative
from rasterjit.survey import facts
from rasterjit.survey import light_culling as planned_lights
from rasterjit.survey.object_transforms import (
    Boxes,
    compute_mesh_boxes,
    transform_boxes,
    transform_objects,
    transform_to_view,
)

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = [[0, 1, 2], [0, 2, 3]]
UV = [[0, 0], [1, 0], [1, 1], [0, 1]]
TEXTURE = rj.Texture(np.full((2, 2, 4), 0.5, np.float32))
AWAY = tf.translate((50.0, 0.0, 0.0))
CAMERA = rj.PerspectiveCamera((0, 0, 6), (0, 0, 0), near=0.5)
SIZE = (24, 16)


def square(**fields):
    return rj.Mesh(SQUARE, FACES, uv=UV, material=rj.Material(**fields))


def scene_of(*placed, lights=(), **fields):
    scene = rj.Scene()
    for mesh, place in placed:
        scene.add(mesh, place)
    scene.lights = list(lights)
    for name, value in fields.items():
        setattr(scene, name, value)
    return scene


def effects(plan):
    return {effect.name: (effect.used, effect.reason) for effect in plan.effects}


PLAIN = (square(shading="flat", specular=0.0), np.eye(4))


@pytest.mark.parametrize(
    ("fields", "name", "reason"),
    [
        ({"base_color_texture": TEXTURE}, "textures",
         "no object in view has a texture that is read"),
        ({"normal_texture": TEXTURE}, "normal maps", "1 object outside the view"),
        ({"occlusion_texture": TEXTURE}, "occlusion maps", "1 object outside the view"),
        ({"shading": "pbr"}, "microfacets", "1 object outside the view"),
        ({"shading": "pbr", "metallic_roughness_texture": TEXTURE}, "metallic-roughness maps",
         "1 object outside the view"),
        ({"emissive": "red"}, "emission", "1 object outside the view"),
        ({"base_color": (1, 1, 1, 0.2), "alpha_mode": "mask"}, "alpha masks",
         "1 object outside the view"),
        ({"shading": "phong"}, "smooth normals", "no object in view is smooth"),
        ({"double_sided": False}, "single-sided objects", "1 object outside the view"),
    ],
)  # fmt: skip
def test_material_out_of_view_calls_for_nothing(fields, name, reason):
    scene = scene_of(PLAIN, (square(**{"shading": "flat", **fields}), AWAY))
    plan = rj.explain(scene, CAMERA, size=SIZE)
    assert effects(plan)[name] == (False, reason)
    alone = rj.explain(scene_of(PLAIN), CAMERA, size=SIZE)
    for need in (
        "needs_textures", "needs_material_maps", "needs_microfacets", "needs_normals",
        "needs_gouraud", "needs_alpha_tests", "needs_diffuse_light",
    ):  # fmt: skip
        assert getattr(plan.facts, need) == getattr(alone.facts, need), need
    assert plan.layers == alone.layers
    assert plan.lighting.highlights is None
    scene.nodes[1].world_from_model = tf.translate((1.0, 0.0, 1.0))
    assert effects(rj.explain(scene, CAMERA, size=SIZE))[name][0]


def test_nothing_is_prepared_for_what_is_out_of_view(monkeypatch):
    def refuse(*_):
        raise AssertionError("nothing in view needs it")

    fields = {"shading": "pbr", "normal_texture": TEXTURE, "base_color_texture": TEXTURE,
              "alpha_mode": "mask"}  # fmt: skip
    scene = scene_of(PLAIN, (square(**fields), AWAY))
    for name in ("join_textures", "join_maps", "join_microfacets", "join_alpha_tests"):
        monkeypatch.setattr(f"rasterjit.survey.packed_scene.{name}", refuse)
    monkeypatch.setattr("rasterjit.survey.packed_scene.join_normals", refuse)
    frame = rj.render(scene, CAMERA, size=SIZE, outputs=("linear",), threads=1)
    alone = rj.render(scene_of(PLAIN), CAMERA, size=SIZE, outputs=("linear",), threads=1)
    assert frame.linear.tobytes() == alone.linear.tobytes()


def test_with_nothing_in_view_nothing_is_shaded():
    scene = scene_of((square(), AWAY), lights=[rj.DirectionalLight()], fog=rj.Fog(density=1.0))
    plan = rj.explain(scene, CAMERA, size=SIZE, quality=rj.Quality(samples=4))
    told = effects(plan)
    assert plan.lighting is None
    assert plan.layers is None
    assert told["shading"] == (False, "no object is in view")
    assert told["lights"] == (False, "no object is in view")
    assert not any(used for used, _ in told.values())
    frame = rj.render(scene, CAMERA, size=SIZE, outputs=("color",), threads=1)
    assert (frame.color == 255).all()


def test_a_mesh_without_uv_is_refused_in_and_out_of_view():
    bare = rj.Mesh(SQUARE, FACES, material=rj.Material(base_color_texture=TEXTURE))
    for place in (np.eye(4), AWAY):
        with pytest.raises(ValueError, match="must have uv"):
            rj.explain(scene_of(PLAIN, (bare, place)), CAMERA)


# --- boxes ----------------------------------------------------------------------------------------


def random_camera(rng):
    eye, target = rng.normal(size=3) * 3.0, rng.normal(size=3)
    if rng.integers(2):
        return rj.PerspectiveCamera(eye, target, near=0.1, far=float(rng.uniform(2, 30)))
    return rj.OrthographicCamera(eye, target, height=2.0, near=-1.0, far=8.0)


def boxes_of(bounds, matrices, camera, size):
    views = transform_to_view(transform_objects(list(matrices)), camera, size)
    return Boxes(bounds, camera.eye_position(), views.relative_from_model, views.clip_from_relative)


def test_boxes_in_view_are_those_with_a_corner_inside_of_every_plane():
    """Slow and obvious: all eight corners, one plane at a time."""
    rng, size, found = np.random.default_rng(8), (64, 48), []
    for _ in range(200):
        camera, matrix = random_camera(rng), np.eye(4)
        matrix[:3] = rng.normal(size=(3, 4)) * 2.0
        mesh = rj.Mesh(rng.normal(size=(4, 3)), [[0, 1, 2], [1, 2, 3]])
        boxes = boxes_of(compute_mesh_boxes([mesh]), matrix[np.newaxis], camera, size)
        low, high = mesh.bounds()
        corners = [[*np.where([n & 1, n & 2, n & 4], high, low), 1.0] for n in range(8)]
        whole = camera.projection_matrix(size) @ camera.view_matrix() @ matrix
        clip = (whole @ np.array(corners).T).T
        beyond = [(sign * clip[:, k] > clip[:, 3]).all() for k in range(3) for sign in (1.0, -1.0)]
        assert boxes.in_view[0] == (not any(beyond))
        found.append(boxes.in_view[0])
    assert 40 < sum(found) < 180


@pytest.mark.parametrize(("near", "far"), [(0.1, 1e4), (0.1, 1e5), (0.001, 1e5)])
def test_what_lies_on_the_far_plane_is_in_view_wherever_it_is_drawn(near, far):
    """Where far / near is large, both sides of the comparison nearly cancel."""
    rng, drawn = np.random.default_rng(3), 0
    for direction in rng.normal(size=(1000, 3)):
        camera = rj.PerspectiveCamera((0, 0, 0), direction, near=near, far=far)
        point = -camera.view_matrix()[2, :3] * far
        clip = clip_from_relative(camera, SIZE) @ [*point, 1.0]
        if clip[2] <= clip[3]:
            drawn += 1
            assert boxes_of(np.array([[point, point]]), [np.eye(4)], camera, SIZE).in_view[0]
    assert drawn > 100


def test_what_no_number_says_is_in_view_unless_there_is_nothing():
    huge = rj.Mesh(SQUARE * 1e308, FACES)
    lost = rj.Mesh(np.full((3, 3), np.nan), [[0, 1, 2]], on_invalid="drop")
    places = np.array([tf.scale(1e10), np.eye(4)])
    boxes = boxes_of(compute_mesh_boxes([huge, lost]), places, CAMERA, SIZE)
    assert boxes.in_view.tolist() == [True, False]


def test_boxes_of_instances_are_those_of_their_mesh():
    meshes = [square(), square(), PLAIN[0]]
    meshes = [meshes[0], meshes[1], meshes[0], meshes[2]]
    assert (compute_mesh_boxes(meshes) == [mesh.bounds() for mesh in meshes]).all()
    corners = transform_boxes(compute_mesh_boxes(meshes), np.array([AWAY] * 4))
    assert (corners.min(axis=1) == SQUARE.min(axis=0) + [50.0, 0, 0]).all()


def test_a_face_that_a_frame_shows_is_in_view():
    """Squares all around a frame's border: whatever shows a pixel is planned for."""
    for bits in (0, 8):
        for shift in np.linspace(0.9, 1.1, 21):
            for axis in (0, 1):
                place = np.zeros(3)
                place[axis] = shift + 1.0
                scene = scene_of((square(shading="unlit"), tf.translate(place)))
                camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=2.0, near=1, far=9)
                frame = rj.render(scene, camera, size=(16, 16), outputs=("face_id",), threads=1,
                                  quality=rj.Quality(subpixel_bits=bits))  # fmt: skip
                assert frame.plan.facts.in_view[0] or not (frame.face_id >= 0).any()
                assert frame.plan.facts.in_view[0] == (shift <= 1.0 + 1e-9)


# --- lights ---------------------------------------------------------------------------------------


SUN = rj.DirectionalLight((-1, -1, -1), intensity=0.5)


@pytest.mark.parametrize(
    ("light", "reason"),
    [
        (rj.PointLight((0, 0, 3), intensity=0.0), "light 1: its intensity is 0"),
        (rj.DirectionalLight(color="black"), "light 1: it is black"),
        (rj.AmbientLight("black"), "light 1: it is black"),
        (rj.SpotLight((0, 0, 3), (0, 0, 1), outer_angle=60.0),
         "light 1: nothing in view is in its cone"),
        (rj.SpotLight((0, 0, 3), (50, 0, -3), intensity=9.0, outer_angle=3.0),
         "light 1: nothing in view is in its cone"),
    ],
)  # fmt: skip
def test_a_light_that_adds_nothing_is_left_out(light, reason):
    placed = [(square(shading="phong"), np.eye(4)), (square(shading="phong"), AWAY)]
    scene = scene_of(*placed, lights=[SUN, light])
    plan = rj.explain(scene, CAMERA, size=SIZE)
    assert effects(plan)["lights"] == (True, f"1 DirectionalLight; {reason}")
    assert len(plan.lighting.lights) == 1
    frame = rj.render(scene, CAMERA, size=SIZE, outputs=("linear",), threads=1)
    scene.lights = [SUN]
    alone = rj.render(scene, CAMERA, size=SIZE, outputs=("linear",), threads=1)
    assert frame.linear.tobytes() == alone.linear.tobytes()


def test_without_a_light_that_adds_anything_there_is_no_headlight():
    scene = scene_of((square(), np.eye(4)), lights=[rj.AmbientLight(intensity=0.0)])
    plan = rj.explain(scene, CAMERA, size=SIZE)
    assert effects(plan)["lights"] == (False, "light 0: its intensity is 0")
    frame = rj.render(scene, CAMERA, size=SIZE, outputs=("linear",), background="white", threads=1)
    assert (frame.linear[8, 12, :3] == 0.0).all()


def test_a_cone_is_left_out_only_where_it_changes_no_bit(monkeypatch):
    """Cones that sweep past an object: with the plan's decision and without, the same picture."""
    kept, dropped = 0, 0
    for angle in np.linspace(0.0, 60.0, 31):
        way = (np.sin(np.radians(angle)), 0.0, -np.cos(np.radians(angle)))
        for outer in (0.01, 5.0, 30.0, 90.0):
            light = rj.SpotLight((0, 0, 3), way, intensity=5.0, inner_angle=0.0, outer_angle=outer)
            scene = scene_of((square(shading="flat"), np.eye(4)), lights=[light])
            plan = rj.explain(scene, CAMERA, size=SIZE)
            if plan.facts.lights.lights:
                kept += 1
                continue
            dropped += 1
            with monkeypatch.context() as patch:
                patch.setattr(planned_lights._LightScene, "in_cone", lambda one, _: ~one.is_unsure)
                frame = rj.render(scene, CAMERA, size=SIZE, outputs=("linear", "face_id"),
                                  threads=1)  # fmt: skip
                assert len(frame.plan.lighting.lights) == 1
            assert (frame.linear[frame.face_id >= 0, :3] == 0.0).all()
    assert kept > 30
    assert dropped > 20


def test_lights_are_not_looked_at_where_nothing_is_lit(monkeypatch):
    monkeypatch.setattr(facts, "plan_lights", None)
    lights = [rj.PointLight((0, 0, 3), range=2.0, shadow=rj.Shadow(64))]
    lit = scene_of((square(), np.eye(4)), lights=lights)
    assert rj.explain(lit, CAMERA, outputs=("depth",)).lighting is None
    unlit = scene_of((square(shading="unlit"), np.eye(4)), (square(), AWAY), lights=lights)
    assert effects(rj.explain(unlit, CAMERA))["lights"] == (
        False, "every material in view is unlit",
    )  # fmt: skip


def test_too_many_texels_of_shadow_maps_are_refused_by_the_names_of_their_lights():
    box = rj.Mesh([*SQUARE, *(SQUARE + [0, 0, 1])], [[0, 1, 2], [4, 5, 6]])
    lamp = rj.PointLight((0, 0, 4), shadow=rj.Shadow(8192))
    lights = [rj.AmbientLight(), lamp, lamp, lamp]
    scene = scene_of((box, np.eye(4)), lights=lights[:3])
    assert rj.explain(scene, CAMERA).has("shadows")
    scene.lights = lights
    for call in (rj.explain, rj.render):
        with pytest.raises(ValueError, match=r"1,073,741,824 texels together \(4\.3 GB\)") as error:
            call(scene, CAMERA, size=SIZE)
        assert "light 1 (6 of 8192 x 8192), light 2 (6 of" in str(error.value)
    assert rj.explain(scene, CAMERA, outputs=("depth",)).lighting is None


# --- shadows --------------------------------------------------------------------------------------


def shaded_ground(*others, light=None, quality=None, size=(96, 72)):
    """Return the shadow maps, and the frame, of a ground with a box on it and more."""
    ground = rj.Mesh(SQUARE @ tf.rotate_x(-90)[:3, :3].T * 4.0, FACES, uv=UV,
                     material=rj.Material("flat", "white", specular=0.0))  # fmt: skip
    light = rj.DirectionalLight((1, -2, 0), shadow=rj.Shadow(256)) if light is None else light
    scene = scene_of((ground, np.eye(4)), *others, lights=[light])
    camera = rj.PerspectiveCamera((0, 5, 7), (0, 0, 0), fov_y=50.0, near=0.5)
    return rj.render(scene, camera, size=size, outputs=("linear", "face_id"), threads=1,
                     quality=quality)  # fmt: skip


@pytest.mark.parametrize("textured", [False, True])
def test_an_object_out_of_view_casts_shadows_with_the_holes_of_its_mask(textured):
    """It hangs high above the picture; half of it is cut out."""
    fields = {"alpha_mode": "mask", "shading": "flat"}
    if textured:
        alpha = np.ones((1, 2, 4), np.float32)
        alpha[0, 1, 3] = 0.0
        texture = rj.Texture(alpha, filter="nearest")
        cover = square(base_color_texture=texture, **fields)
    else:
        corners = SQUARE[[0, 1, 2, 3, 0, 2]]
        rgba = np.ones((6, 4), np.float32)
        rgba[:3, 3] = 0.0
        cover = rj.Mesh(corners, [[0, 1, 2], [4, 5, 3]], colors=rgba,
                        material=rj.Material(**fields))  # fmt: skip
    solid = square(shading="flat")
    place = tf.compose(tf.translate((-5.0, 10.0, 0.0)), tf.rotate_x(-90))
    bright, half, full = (
        shaded_ground(*([(mesh, place)] if mesh is not None else []))
        for mesh in (None, cover, solid)
    )
    assert half.plan.facts.in_view.tolist() == full.plan.facts.in_view.tolist() == [True, False]
    told = effects(half.plan)
    assert told["alpha masks"] == (True, "1 object outside the view, in shadows alone")
    assert told["textures"][0] is False
    assert not half.plan.facts.needs_alpha_tests
    told = [k for k in list_kernels(half.plan) if k.name.startswith("alpha_test.")]
    assert [(k.name, k.condition) for k in told] == [
        (f"alpha_test.{name}", "something casts a shadow on what is seen")
        for name in ("queue_triangle", "find_alphas")
    ]
    darkened = [bright.linear.sum() - frame.linear.sum() for frame in (half, full)]
    assert darkened[1] > 10.0
    assert darkened[0] == pytest.approx(darkened[1] / 2.0, rel=0.1)


@pytest.fixture
def fitted(monkeypatch):
    """Catch the scenery that shadow maps are fitted to."""
    caught, original = [], maps.collect_scenery

    def catch(*arguments):
        caught.append(original(*arguments))
        return caught[-1]

    monkeypatch.setattr(maps, "collect_scenery", catch)
    return caught


BOX = rj.Mesh([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)],
              [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
               [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]],
              material=rj.Material("flat"))  # fmt: skip


def test_glass_out_of_view_does_not_widen_shadow_maps(fitted):
    glass = square(base_color=(1, 1, 1, 0.5), alpha_mode="blend", shading="flat")
    far = tf.translate((200.0, 0.0, 0.0))
    plain = shaded_ground((BOX, np.eye(4)))
    behind = shaded_ground((BOX, np.eye(4)), (glass, far))
    assert plain.linear.tobytes() == behind.linear.tobytes()
    assert fitted[0].cells.tobytes() == fitted[1].cells.tobytes()
    near = tf.translate((0.0, 1.5, 0.0))
    shaded_ground((BOX, np.eye(4)), (glass, near))
    shaded_ground((BOX, np.eye(4)), (glass, near), (BOX, far))
    assert fitted[2].cells.tobytes() == fitted[3].cells.tobytes()
    assert np.abs(fitted[3].cells).max() < 100.0


LOOKING_DOWN = rj.PerspectiveCamera((0, 3, 0), (0, 0, 0), up=(0, 0, -1), fov_y=25.0)
DOWN = tf.rotate_x(-90.0)


@pytest.mark.parametrize(
    ("light", "edge", "height"),
    [
        # The roof hides a part of the light as it is seen from the floor, though not its middle.
        (rj.SpotLight((0, 10, 0), (0, -1, 0), shadow=rj.Shadow(256, "soft", 4.0)), 0.55, 2.0),
        (rj.PointLight((0, 10, 0), shadow=rj.Shadow(256, "soft", 4.0)), 0.55, 2.0),
        (rj.DirectionalLight((1e-3, -1, 0), shadow=rj.Shadow(256, "soft", 60.0)), 1.6, 6.0),
        # Comparisons beside a surface's own texel find the roof.
        (rj.DirectionalLight((1e-3, -1, 0), shadow=rj.Shadow(16, "pcf")), 0.52, 2.0),
    ],
)
def test_filters_find_what_casts_a_shadow_from_aside(light, edge, height):
    floor = square(shading="flat"), tf.compose(DOWN, tf.scale(0.5))
    lit = scene_of(floor, lights=[light])
    assert not rj.explain(lit, LOOKING_DOWN, size=SIZE).has("shadows")
    for x, casts in ((edge, True), (100.0, False)):
        place = tf.compose(tf.translate((x + 2.0, height, 0.0)), DOWN, tf.scale(2.0))
        scene = scene_of(floor, (square(shading="flat"), place), lights=[light])
        assert rj.explain(scene, LOOKING_DOWN, size=SIZE).has("shadows") == casts


SLIVER_LIGHTS = [
    rj.DirectionalLight((0, 0, -1), shadow=rj.Shadow(256, "hard")),
    rj.SpotLight((21, 0, 40), (0, 0, -1), intensity=1e3, outer_angle=60.0,
                 shadow=rj.Shadow(256, "hard")),
    rj.PointLight((21, 0, 40), intensity=1e3, shadow=rj.Shadow(256, "hard")),
]  # fmt: skip


@pytest.mark.parametrize("samples", [4, 16, "area"])
@pytest.mark.parametrize("light", SLIVER_LIGHTS, ids=lambda light: type(light).__name__)
def test_a_sliver_that_no_centre_of_a_pixel_sees_lies_in_shadow(samples, light):
    """A block on the left, and far on the right a bar that passes between the centres of pixels."""
    white = rj.Material("flat", "white", specular=0.0)
    camera = rj.OrthographicCamera((0, 0, 10), (0, 0, 0), height=16.0, near=1, far=60)
    # Pixels are 1 wide, their centres at halves.
    block, bar, roof = (
        rj.Mesh(SQUARE * [half, 7.0, 1.0] + [x, 0.0, z], FACES, material=white)
        for half, x, z in ((4.0, -20.0, 0.0), (0.4, 21.0, -5.0), (2.0, 21.0, 20.0))
    )
    scene = scene_of((block, np.eye(4)), (bar, np.eye(4)), lights=[light])

    def draw():
        return rj.render(scene, camera, size=(64, 16), outputs=("linear", "object_id"), threads=1,
                         quality=rj.Quality(samples=samples), background="black")  # fmt: skip

    bright = draw()
    assert not (bright.object_id == 1).any()
    assert (bright.linear[4:12, 52:54, 0] > 0.03).all()
    # Behind the camera, and between the bar and the light.
    scene.add(roof)
    dark = draw()
    assert dark.plan.facts.in_view.tolist() == [True, True, False]
    assert (dark.linear[:, 40:, :3] == 0.0).all()
    assert (dark.linear[:, :40] == bright.linear[:, :40]).all()


@pytest.mark.parametrize("z", [-504.0, 0.0])
@pytest.mark.parametrize("samples", [4, "area"])
def test_what_is_hidden_at_every_sample_does_not_widen_shadow_maps(samples, z, monkeypatch):
    """Ground that goes far behind a wall that fills the picture, or under the camera as well."""
    fitted, fit = [], maps._fit_parallel

    def watch(light, scenery, row):
        matrix = fit(light, scenery, row)
        fitted.append(row.copy())
        return matrix

    monkeypatch.setattr(maps, "_fit_parallel", watch)
    wall = square(shading="flat"), tf.scale(6.0)
    pane = square(shading="flat"), tf.compose(tf.translate((0.3, 0.2, 0.5)), tf.scale(0.3))
    ground = square(shading="flat"), tf.compose(tf.translate((0, -5, z)), DOWN, tf.scale(500.0))
    light = rj.DirectionalLight((-0.3, -1, -1), shadow=rj.Shadow(64))
    for placed in ((wall, pane), (wall, pane, ground)):
        for count in (1, samples):
            rj.render(
                scene_of(*placed, lights=[light]), CAMERA, size=SIZE, outputs=("linear",),
                quality=rj.Quality(samples=count), threads=1,
            )  # fmt: skip
    assert len(fitted) == 4
    assert (fitted[3] == fitted[2]).all()
    assert fitted[3][shadows_stage.FOCAL] == pytest.approx(fitted[0][shadows_stage.FOCAL], rel=0.01)


def test_least_values_of_rectangles_are_not_above_those_of_a_loop():
    rng = np.random.default_rng(12)
    for height, width in ((1, 1), (1, 7), (9, 5), (23, 40)):
        values = rng.normal(size=(height, width)).astype(np.float32)
        rows, columns = (np.sort(rng.integers(0, n, (2, 300)), axis=0) for n in (height, width))
        found = visible_cells._find_rectangle_minima(values, *rows, *columns)
        want = [
            values[top : bottom + 1, left : right + 1].min()
            for top, bottom, left, right in zip(*rows, *columns, strict=True)
        ]
        assert (found <= want).all()
        single = np.maximum(rows[1] - rows[0], columns[1] - columns[0]) <= 1
        assert (found == want)[single].all()
        assert (found == want).mean() > 0.2


def test_cells_of_what_is_open_hold_all_of_it_that_is_in_view():
    """Points of boxes that are in view lie in the hull of the cell, as seen along many axes."""
    rng, size, clipped = np.random.default_rng(5), (64, 48), 0
    for _ in range(100):
        camera, matrix = random_camera(rng), np.eye(4)
        matrix[:3] = rng.normal(size=(3, 4)) * 2.0
        boxes = transform_boxes(np.array([[[-1.0] * 3, [1.0] * 3]]), matrix[np.newaxis])
        (cell,) = visible_cells.make_view_cells(camera, size, boxes - camera.eye_position())
        clipped += not np.array_equal(cell, boxes[0] - camera.eye_position())
        points = rng.uniform(-1.0, 1.0, (2000, 3)) @ matrix[:3, :3].T + matrix[:3, 3]
        clip = (
            np.c_[points, np.ones(2000)] @ (camera.projection_matrix(size) @ camera.view_matrix()).T
        )
        inside = (np.abs(clip[:, :3]) <= clip[:, 3:]).all(axis=1)
        seen = (points - camera.eye_position())[inside]
        for axis in rng.normal(size=(20, 3)):
            ends = cell @ axis
            slack = 1e-6 * np.abs(ends).max()
            assert (seen @ axis >= ends.min() - slack).all()
            assert (seen @ axis <= ends.max() + slack).all()
    assert clipped > 20


# --- ambient occlusion ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "used"),
    [
        ({}, True),
        ({"lights": [SUN]}, False),
        ({"lights": [SUN, rj.AmbientLight(intensity=0.0)]}, False),
        ({"lights": [SUN, rj.AmbientLight()]}, True),
        ({"environment": rj.Environment.constant("black")}, False),
        ({"environment": rj.Environment.constant("grey", intensity=0.0)}, False),
        ({"environment": rj.Environment(np.zeros((2, 4, 3)))}, False),
        ({"environment": rj.Environment.constant("grey")}, True),
        ({"environment": rj.Environment.constant("black"), "lights": [rj.AmbientLight()]}, True),
    ],
)
def test_ambient_occlusion_needs_light_from_all_around(fields, used):
    scene = scene_of((square(), np.eye(4)), ambient_occlusion=rj.AmbientOcclusion(1.0), **fields)
    plan = rj.explain(scene, CAMERA, size=SIZE)
    assert plan.has("ambient occlusion") == used
    told = effects(plan)["ambient occlusion"]
    assert told == ((True, "radius 1, strength 1") if used else
                    (False, "no light comes from all around"))  # fmt: skip


def test_ambient_occlusion_of_what_is_out_of_view_is_left_out():
    lit = (square(), AWAY)
    scene = scene_of((square(shading="unlit"), np.eye(4)), lit,
                     ambient_occlusion=rj.AmbientOcclusion(1.0))  # fmt: skip
    plan = rj.explain(scene, CAMERA, size=SIZE)
    assert effects(plan)["ambient occlusion"] == (False, "every material in view is unlit")


# --- fog, and areas of glass ----------------------------------------------------------------------


def test_fog_that_begins_beyond_all_in_view_is_left_out():
    fog = rj.Fog(mode="linear", start=20.0, end=30.0)
    scene = scene_of((square(), np.eye(4)), (square(), AWAY), fog=fog)
    assert effects(rj.explain(scene, CAMERA, size=SIZE))["fog"][0] is False
    scene.nodes[1].world_from_model = tf.translate((0.0, 0.0, -20.0))
    assert effects(rj.explain(scene, CAMERA, size=SIZE))["fog"][0] is True


def test_areas_of_blended_objects_are_refused_by_name():
    glass = square(base_color=(1, 1, 1, 0.5), alpha_mode="blend")
    scene = scene_of(PLAIN)
    scene.add(glass, AWAY, name="far pane")
    scene.add(glass, tf.translate((0, 0, 1)), name="near pane")
    quality = rj.Quality(samples="area")
    with pytest.raises(ValueError, match=r"got 'area' and 'near pane' \(object 2\)"):
        rj.render(scene, CAMERA, size=SIZE, quality=quality)
    scene.nodes.pop()
    assert rj.explain(scene, CAMERA, size=SIZE, quality=quality).layers is not None


def test_fog_asks_for_no_positions_of_flat_objects_out_of_view():
    scene = scene_of((square(shading="phong"), np.eye(4)), (PLAIN[0], AWAY), fog=rj.Fog(density=1))
    assert not rj.explain(scene, CAMERA, size=SIZE).data("fog").finds_points
    scene.nodes[1].world_from_model = np.eye(4)
    assert rj.explain(scene, CAMERA, size=SIZE).data("fog").finds_points
