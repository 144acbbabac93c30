"""Near and far planes that are not given cut nothing in view; given ones that do are warned of."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
import re
import warnings

import naive_planes
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene.camera import near_far

SIZE = (48, 36)
ALL = ("color", "depth", "face_id", "position")
LOOK = {"eye": (0.0, 0.0, 0.0), "target": (0.0, 0.0, -1.0)}


def ball(radius=1.0, center=(0.0, 0.0, 0.0), count=24):
    """Return a sphere of triangles."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, count + 1), np.linspace(0, np.pi, count // 2 + 1))
    points = np.stack([np.cos(u) * np.sin(v), np.cos(v), np.sin(u) * np.sin(v)], axis=-1)
    first = (np.arange(count // 2)[:, None] * (count + 1) + np.arange(count)).ravel()
    over = first + count + 1
    faces = np.concatenate(
        [np.stack([first, first + 1, over], 1), np.stack([first + 1, over + 1, over], 1)]
    )
    return rj.Mesh(points.reshape(-1, 3) * radius + center, faces)


def draw(scene, camera, outputs=ALL, size=SIZE, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return rj.render(scene, camera, size=size, outputs=outputs, threads=1, **options)


def same(one, other, outputs=ALL):
    for name in outputs:
        a, b = getattr(one, name), getattr(other, name)
        assert a.dtype == b.dtype
        assert a.tobytes() == b.tobytes(), name


CAMERAS = {
    "perspective": lambda eye, target, near=None: rj.PerspectiveCamera(eye, target, near=near),
    "intrinsics": lambda eye, target, near=None: rj.MatrixCamera.from_intrinsics(
        50, 50, 24, 18, SIZE, near=near,
        view_from_world=rj.PerspectiveCamera(eye, target).view_matrix(),
    ),
    "opencv": lambda eye, target, near=None: rj.cameras.from_opencv(
        [[50, 0, 23.5], [0, 50, 17.5], [0, 0, 1]], SIZE, near=near,
        camera_from_world=np.diag([1, -1, -1, 1]) @ rj.PerspectiveCamera(eye, target).view_matrix(),
    ),
}  # fmt: skip


@pytest.mark.parametrize("make", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize(("radius", "distance", "steps"), [(0.03, 0.11, 1), (5e-4, 1.5e-3, 7)])
def test_a_small_mesh_close_by_is_whole(make, radius, distance, steps):
    mesh = ball(radius)
    frame = draw(mesh, make((0, 0, distance), (0, 0, 0)))
    near = 0.1 / 2**steps
    assert near_far(frame.plan.camera)[:2] == (near, math.inf)
    # The same from as many times as far, where nothing is cut.
    large = draw(ball(radius * 2**10), make((0, 0, distance * 2**10), (0, 0, 0)))
    assert near_far(large.plan.camera).near == 0.1
    assert large.face_id.tobytes() == frame.face_id.tobytes()
    np.testing.assert_allclose(frame.depth * 2**10, large.depth, rtol=1e-6)
    given = draw(mesh, make((0, 0, distance), (0, 0, 0), near))
    same(frame, given)
    assert f"{near:.6g} (chosen: 0.1 / 2^k, k = {steps})" in str(frame.plan)
    assert f"{near:.6g} (given)" in str(given.plan)


def test_what_nothing_is_cut_of_has_the_bits_of_a_near_plane_at_a_tenth():
    frame = draw(ball(), rj.PerspectiveCamera((0, 0, 3), (0, 0, 0)))
    same(frame, draw(ball(), rj.PerspectiveCamera((0, 0, 3), (0, 0, 0), near=0.1)))
    assert near_far(frame.plan.camera) == (0.1, math.inf, False, False, 0, None)


def test_bits_do_not_depend_on_how_often_the_near_plane_is_halved():
    scene = rj.Scene()
    scene.ambient_occlusion, scene.outline = rj.AmbientOcclusion(), rj.Outline()
    scene.add(ball())
    scene.add(ball(9.0, (0, -10, 0)))
    light = rj.DirectionalLight((-1, -2, -1), shadow=rj.Shadow())
    scene.lights = [light]
    quality = rj.Quality(samples=4)
    frames = [
        draw(scene, rj.PerspectiveCamera((0, 0, 3), (0, 0, 0), near=0.1 / 2**k), quality=quality)
        for k in (0, 5, 30)
    ]
    for other in frames[1:]:
        same(frames[0], other)


def room():
    """Return a scene: a room of 4 x 3 x 4 around the origin, an eye's height above the floor."""
    corners = np.array([[x, y, z] for x in (-2, 2) for y in (-1.5, 1.5) for z in (-2, 2)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[q[a], q[b], q[c]] for q in quads for a, b, c in ((0, 1, 2), (0, 2, 3))]
    scene = rj.Scene()
    scene.add(rj.Mesh(corners, faces, material=rj.Material("flat")))
    return scene


def test_in_a_room_only_what_is_in_view_counts():
    scene = room()
    # Walls go on behind the eye; what is seen of them begins in front of it.
    assert near_far(draw(scene, rj.PerspectiveCamera(**LOOK)).plan.camera).near == 0.1
    # Beside and behind the eye something is near, which is not seen.
    scene.add(ball(0.01, (0.5, 0.0, -0.05)))
    scene.add(ball(0.01, (0.0, 0.0, 0.05)))
    assert near_far(draw(scene, rj.PerspectiveCamera(**LOOK)).plan.camera).near == 0.1
    # In front of it.
    scene.add(ball(0.01, (0.0, 0.0, -0.05)))
    assert near_far(draw(scene, rj.PerspectiveCamera(**LOOK)).plan.camera).near == 0.1 / 4
    # At the wall.
    close = rj.PerspectiveCamera((0, 0, -1.999), (0, 0, -3))
    frame = draw(scene, close, ("depth",))
    np.testing.assert_allclose(frame.depth, 0.001, rtol=1e-4)
    assert near_far(frame.plan.camera).near == 0.1 / 2**7


def test_an_eye_in_a_face_is_bounded():
    rng = np.random.default_rng(3)
    around = rj.Mesh(rng.normal(size=(90, 3)) * 1e-20, rng.integers(0, 90, (60, 3)))
    frame = rj.render(around, rj.PerspectiveCamera(**LOOK), size=SIZE, threads=1)
    assert near_far(frame.plan.camera).near == 0.1 / 2**40
    # Seen edge on, a face shows nothing and calls for nothing.
    edge = rj.Mesh([[-1, 0, 1], [1, 0, 1], [0, 0, -9]], [[0, 1, 2]])
    frame = rj.render(edge, rj.PerspectiveCamera(**LOOK), size=SIZE, threads=1)
    assert near_far(frame.plan.camera).near == 0.1


@pytest.mark.parametrize(("name", "least"), [("unorm16", 2.0**-16), ("unorm24", 2.0**-24)])
def test_formats_of_fixed_range_keep_what_is_far(name, least):
    scene = room()
    quality = rj.Quality(depth_format=name)
    close = rj.PerspectiveCamera((1e-9, 0, -2 + 1e-8), (1, 0, -2 + 1e-8))
    near = near_far(draw(scene, close, quality=quality).plan.camera).near
    assert near == 0.1 or least * 2 <= near < least * 40


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_what_is_found_is_what_all_faces_say(kind):
    """Against faces that are cut one by one."""
    rng = np.random.default_rng(11)
    counts = np.zeros(3, int)
    for _ in range(60):
        place = {"eye": rng.normal(size=3) * 0.2, "target": rng.normal(size=3)}
        if kind == "perspective":
            camera = rj.PerspectiveCamera(**place, fov_y=rng.uniform(10, 140))
            given = dataclasses.replace(camera, near=0.25, far=0.7)
        else:
            camera = rj.OrthographicCamera(**place, height=rng.uniform(0.1, 2))
            given = dataclasses.replace(camera, near=0.25, far=0.7)
        scene, seen = rj.Scene(), []
        for _ in range(3):
            size = 10.0 ** rng.uniform(-2, 1.5)
            mesh = rj.Mesh(rng.normal(size=(30, 3)) * size, rng.integers(0, 30, (8, 3)))
            turn = rj.transforms.rotate(rng.normal(size=3), rng.uniform(0, 360))
            scene.add(mesh, turn)
            points = mesh.vertices @ turn[:3, :3].T
            for face in mesh.faces:
                if len(set(face)) == 3:
                    seen.append(naive_planes.seen_depths(points[face], camera, SIZE))
        seen = [one for one in seen if one is not None]
        planes = near_far(rj.explain(scene, camera, size=SIZE).camera)
        if kind == "perspective":
            least = min((low for low, _ in seen), default=math.inf)
            assert planes.near <= least or planes.near_steps == 40
            assert planes.near_steps == 0 or planes.near * 2 > 0.99 * least
            counts[2] += planes.near_steps > 0
        else:
            most = max((high for _, high in seen), default=0.0)
            assert planes.far >= most
        cut = {one.name: one for one in rj.explain(scene, given, size=SIZE).plane_needs.cut}
        for name, found in (
            ("near", [one for one in seen if one[0] < 0.25]),
            ("far", [one for one in seen if one[1] > 0.7]),
        ):
            # The view is taken a thousandth wider: a face may touch it there.
            told = cut[name].faces if name in cut else 0
            assert len(found) <= told <= len(found) + 2
            counts[0] += len(found)
            counts[1] += told
    assert counts[0] > 200
    assert counts[1] < 1.02 * counts[0]
    assert kind == "orthographic" or counts[2] > 10


def test_a_large_mesh_is_looked_at_in_boxes():
    mesh = ball(1.0, count=100)
    assert len(mesh.faces) > 2**13
    for eye, target, steps in (
        ((0, 0, 0.0), (0, 0, -1), 0),
        ((0, 0, -0.96), (0, 0, -2), 2),
        ((0.1, 0.02, 1.001), (0, 0, 0), 4),
    ):
        camera = rj.PerspectiveCamera(eye, target)
        planes = near_far(draw(mesh, camera).plan.camera)
        least = min(
            one[0]
            for corners in mesh.vertices[mesh.faces]
            if (one := naive_planes.seen_depths(corners, camera, SIZE)) is not None
        )
        assert planes.near_steps == steps
        assert planes.near <= least
        assert steps == 0 or planes.near * 2 > 0.99 * least


def test_a_parallel_view_shows_what_is_far():
    mesh = ball(500.0, (0, 0, -2000.0))
    frame = draw(mesh, rj.OrthographicCamera(**LOOK, height=1200.0))
    assert near_far(frame.plan.camera) == (0.0, 4000.0, False, False, None, 2)
    assert float(frame.depth.min()) == pytest.approx(1500.0, rel=1e-2)
    assert "4000 (chosen: 1000 * 2^k, k = 2)" in str(frame.plan)
    near = ball(100.0, (0, 0, -500.0))
    plain = draw(near, rj.OrthographicCamera(**LOOK, height=1200.0))
    same(plain, draw(near, rj.OrthographicCamera(**LOOK, height=1200.0, far=1000.0)))
    assert near_far(rj.explain(near, rj.OrthographicCamera(**LOOK, near=3000.0)).camera).far == 4e3


def test_a_far_plane_before_a_tenth_leaves_room_for_a_near_one():
    camera = rj.PerspectiveCamera(**LOOK, far=0.03)
    assert near_far(rj.explain(ball(), camera).camera)[:2] == (0.025, 0.03)
    for far in (math.nan, 0.0, -1.0, "far"):
        with pytest.raises(ValueError, match="far"):
            rj.PerspectiveCamera(**LOOK, far=far)


# What else frames are made of


def scene_with_a_close_ball():
    scene = rj.Scene()
    scene.add(ball(0.02, (0.0, 0.0, -0.06)))
    scene.add(ball(2.0, (0.0, 0.0, -9.0)))
    return scene


@pytest.mark.parametrize("format", ["float32-reversed", "unorm24"])
def test_views_of_a_batch_have_one_near_plane(format):
    scene, quality = scene_with_a_close_ball(), rj.Quality(depth_format=format)
    cameras = [
        rj.PerspectiveCamera((0, 0, -4), (0, 0, -9)),
        rj.PerspectiveCamera(**LOOK),
        rj.PerspectiveCamera((0, 0, 3), (0, 0, 0)),
    ]
    frames = list(rj.render_many(scene, cameras, size=SIZE, outputs=ALL, quality=quality))
    assert {near_far(frame.plan.camera).near for frame in frames} == {0.025}
    for camera, frame in zip(cameras, frames, strict=True):
        given = dataclasses.replace(camera, near=0.025)
        same(frame, draw(scene, given, quality=quality))
    # Those that come one by one have their own.
    alone = list(rj.render_many(scene, iter(cameras), size=SIZE))
    assert [near_far(frame.plan.camera).near for frame in alone] == [0.1, 0.025, 0.1]


def test_frames_of_an_animation_have_one_near_plane():
    scene = scene_with_a_close_ball()
    node = scene.nodes[0]
    before = node.world_from_model.copy()
    camera = rj.PerspectiveCamera(**LOOK)

    def away(time):
        return rj.transforms.translate((0.0, 0.0, -time))

    with rj.Renderer(SIZE, threads=1) as renderer:
        for times, expected in (
            ([1.0, 0.0], [0.025, 0.025]),
            (iter([1.0, 0.0, 1.0]), [0.1, 0.025, 0.025]),
        ):
            frames = rj.animation.frames(
                renderer, scene, times, camera=camera, transforms={node: away}
            )
            assert [near_far(frame.plan.camera).near for frame in frames] == expected
        assert (node.world_from_model == before).all()
        track = rj.animation.CameraTrack(
            [0, 1], [camera, rj.PerspectiveCamera((0, 0, 2), (0, 0, -1))]
        )
        assert track(0.5).near is None
        frames = rj.animation.frames(renderer, scene, np.array([0.0, 0.9]), camera=track)
        assert [near_far(frame.plan.camera).near for frame in frames] == [0.025, 0.025]
    with pytest.raises(ValueError, match="cameras must all have a near, or none"):
        rj.animation.CameraTrack([0, 1], [camera, dataclasses.replace(camera, near=1.0)])


def test_tiles_have_the_bits_of_the_whole_picture():
    from rasterjit.rendering.regions import RegionRenderer

    scene, camera, size = scene_with_a_close_ball(), rj.PerspectiveCamera(**LOOK), (192, 128)
    whole = draw(scene, camera, size=size)
    assert near_far(whole.plan.camera).near == 0.025
    with RegionRenderer(scene, camera, size=size, outputs=ALL, threads=1) as renderer:
        for (left, top, width, height), part in renderer.render_regions(64):
            rows, columns = slice(top, top + height), slice(left, left + width)
            for name in ALL:
                there = getattr(whole, name)[rows, columns]
                assert getattr(part, name).tobytes() == there.tobytes(), name


def test_supersamples_layers_and_pixels_have_the_near_plane_of_the_picture():
    scene, camera = scene_with_a_close_ball(), rj.PerspectiveCamera(**LOOK)
    given = dataclasses.replace(camera, near=0.025)
    for samples in (4, 64):
        quality = rj.Quality(samples=samples)
        same(draw(scene, camera, quality=quality), draw(scene, given, quality=quality))
    layers = [rj.render_layers(scene, one, k=3, size=SIZE).depth for one in (camera, given)]
    assert layers[0].tobytes() == layers[1].tobytes()
    told = [str(rj.explain_pixel(scene, one, size=SIZE, x=24, y=18)) for one in (camera, given)]
    assert told[0] == told[1]
    assert "visible" in told[0]


def test_the_previous_view_of_one_camera_has_its_near_plane():
    now, before = rj.Scene(), rj.Scene()
    now.add(ball(0.02, (0.0, 0.0, -0.5)))
    before.add(ball(0.02, (0.0, 0.0, -0.06)))
    camera, outputs = rj.PerspectiveCamera(**LOOK), ("motion", "motion_visible")
    frame = draw(now, camera, outputs, previous=rj.PreviousView(scene=before))
    assert near_far(frame.plan.camera).near == 0.025
    assert near_far(frame.plan.previous.camera).near == 0.025
    assert "the same camera" in str(frame.plan)
    given = dataclasses.replace(camera, near=0.025)
    same(frame, draw(now, given, outputs, previous=rj.PreviousView(scene=before)), outputs)
    other = rj.PreviousView(scene=before, camera=rj.PerspectiveCamera((0, 0, 0.001), (0, 0, -1)))
    frame = draw(now, camera, outputs, previous=other)
    assert near_far(frame.plan.camera).near == 0.1
    assert near_far(frame.plan.previous.camera).near == 0.025


def test_the_nearest_quality_for_an_error_has_one_near_plane():
    scene, camera = scene_with_a_close_ball(), rj.PerspectiveCamera(**LOOK)
    frame = rj.render(scene, camera, size=SIZE, max_error=0.5, threads=1)
    assert near_far(frame.plan.camera).near == 0.025


# Descriptions


@pytest.mark.parametrize("make", CAMERAS.values(), ids=CAMERAS)
def test_open_cameras_are_copied_and_converted(make):
    camera = make((0, 0, 3), (0, 0, 0))
    for other in (pickle.loads(pickle.dumps(camera)), copy.deepcopy(camera)):
        assert near_far(other) == near_far(camera) == (0.1, math.inf, True, False, None, None)
    if isinstance(camera, rj.PerspectiveCamera):
        assert camera == rj.PerspectiveCamera((0, 0, 3), (0, 0, 0))
        assert camera != dataclasses.replace(camera, near=0.1)
        assert "near=None" in repr(camera)
    else:
        moved = dataclasses.replace(camera, view_from_world=np.eye(4))
        assert near_far(moved).is_near_open
    for size in (SIZE,):
        assert rj.cameras.to_opencv(camera, size).intrinsics[2, 2] == 1.0
        assert rj.cameras.to_blender(camera, size).clip_start == pytest.approx(0.1)
        given = make((0, 0, 3), (0, 0, 0), 0.1)
        gl = [rj.cameras.to_opengl(one, size).projection for one in (camera, given)]
        assert gl[0].tobytes() == gl[1].tobytes()
    frame = draw(ball(0.05, (0, 0, 2.9)), camera)
    settled = pickle.loads(pickle.dumps(frame.plan.camera))
    assert near_far(settled) == near_far(frame.plan.camera)
    assert near_far(settled).near == 0.025
    assert rj.cameras.to_blender(settled, SIZE).clip_start == pytest.approx(0.025)
    # What was drawn is not looked at again.
    same(frame, draw(ball(0.05, (0, 0, 2.9)), settled))


def test_only_a_pinhole_may_be_open():
    with pytest.raises(ValueError, match="is_near_open must be False"):
        rj.MatrixCamera(np.eye(4), np.diag([1.0, 1, -1, 1]), is_near_open=True)


# Warnings


def told_by(draw, *arguments, **options):
    """Return what a call warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        draw(*arguments, **options)
    assert all(one.category is rj.ViewWarning for one in caught)
    assert all(one.filename == __file__ for one in caught), [one.filename for one in caught]
    return [str(one.message) for one in caught]


def test_faces_that_given_planes_cut_are_named():
    mesh = ball(0.03)
    camera = rj.PerspectiveCamera((0, 0, 0.11), (0, 0, 0), near=0.1)
    (told,) = told_by(rj.render, mesh, camera, size=SIZE, threads=1)
    faces, enough = re.fullmatch(
        r"camera\.near = 0\.1 cuts (\d+) faces in view, whole or in part; at most (\S+) cuts "
        r"nothing",
        told,
    ).groups()
    expected = [naive_planes.seen_depths(c, camera, SIZE) for c in mesh.vertices[mesh.faces]]
    assert int(faces) == sum(one is not None and one[0] < 0.1 for one in expected) > 10
    mended = dataclasses.replace(camera, near=float(enough))
    assert told_by(rj.render, mesh, mended, size=SIZE, threads=1) == []
    # Once for each that draws many, and by all that draw.
    with rj.Renderer(SIZE, threads=1) as renderer:
        assert told_by(renderer.render, mesh, camera) == [told]
        assert told_by(renderer.render, mesh, camera) == []
    assert told_by(rj.render_layers, mesh, camera, k=2, size=SIZE, threads=1) == [told]

    def draw_many():
        for _ in rj.render_many(mesh, [camera] * 3, size=SIZE, threads=2):
            pass

    assert told_by(draw_many) == [told]
    # explain says so, and does not warn.
    assert "cuts" in str(rj.explain(mesh, camera, size=SIZE))
    assert told_by(rj.explain, mesh, camera, size=SIZE) == []


def test_a_mesh_gone_whole_is_named():
    told = told_by(
        rj.render, ball(5e-4), rj.PerspectiveCamera((0, 0, 2e-3), (0, 0, 0), near=0.1), size=SIZE
    )
    assert len(told) == 1
    assert told[0].startswith("camera.near = 0.1 cuts ")


def test_faces_behind_a_given_far_plane_are_named():
    camera = rj.PerspectiveCamera((0, 0, 3), (0, 0, 0), far=3.0)
    (told,) = told_by(rj.render, ball(), camera, size=SIZE)
    assert told.startswith("camera.far = 3 cuts ")
    enough = float(re.search("at least ([^ ]+)", told)[1])
    assert told_by(rj.render, ball(), dataclasses.replace(camera, far=enough), size=SIZE) == []
    flat = rj.OrthographicCamera((0, 0, 3), (0, 0, 0), near=2.5, far=4.0)
    assert [one.split(" cuts")[0] for one in told_by(rj.render, ball(), flat, size=SIZE)] == [
        "camera.near = 2.5"
    ]
    # What is behind the eye is in nobody's view.
    assert (
        told_by(rj.render, ball(), rj.OrthographicCamera((0, 0, 0.5), (0, 0, 0)), size=SIZE) == []
    )


def test_an_empty_view_is_warned_of():
    away = rj.PerspectiveCamera((0, 0, 9), (0, 0, 99))
    nothing = ["nothing is in view: the picture shows only the background"]
    assert told_by(rj.render, ball(), away, size=SIZE) == nothing
    assert told_by(rj.render, ball(), None, size=SIZE) == []

    def draw_many():
        for _ in rj.render_many(ball(), [away, away], size=SIZE, threads=2):
            pass

    assert told_by(draw_many) == nothing
    # Too small for any sample, and all holes.
    assert told_by(rj.render, ball(1e-9), rj.PerspectiveCamera((0, 0, 9), (0, 0, 0)), size=SIZE)
    holes = rj.Mesh(
        [[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]],
        material=rj.Material(alpha_mode="mask", base_color=(1.0, 1.0, 1.0, 0.0)),
    )  # fmt: skip
    assert told_by(rj.render, holes, size=SIZE) == nothing


@pytest.mark.parametrize("shape", ["square", "disc", "sphere"])
@pytest.mark.parametrize("unit", ["pixel", "world"])
def test_points_close_by_are_whole(shape, unit):
    if (shape, unit) == ("sphere", "pixel"):
        pytest.skip("no such points")
    size = 9.0 if unit == "pixel" else 0.004
    # Beside the view by less than half of what it is large.
    places = np.array([[0.0, 0.0, -0.02], [0.00625 * 4 / 3, 0.0, -0.01], [0.3, 0.2, -1.0]])
    cloud = rj.Points(places, size=size, unit=unit, shape=shape)
    frame = draw(cloud, rj.PerspectiveCamera(**LOOK, fov_y=60.0))
    near = near_far(frame.plan.camera).near
    assert near <= 0.01
    same(frame, draw(cloud, rj.PerspectiveCamera(**LOOK, fov_y=60.0, near=near / 64)))
    assert 0 in frame.face_id
    size = 9.0 if unit == "pixel" else 0.2
    far = rj.Points(places[2:], size=size, unit=unit, shape=shape)
    assert near_far(draw(far, rj.PerspectiveCamera(**LOOK)).plan.camera).near == 0.1
    # Those behind the eye, and beside the view, call for nothing.
    beside = np.array([[0.0, 0.0, 0.5], [0.5, 0.0, -0.05], [0.0, 0.0, -2.0], [np.nan, 0.0, -0.01]])
    unseen = rj.Points(beside, size=size, unit=unit, shape=shape, on_invalid="drop")
    assert near_far(draw(unseen, rj.PerspectiveCamera(**LOOK)).plan.camera).near == 0.1


def test_a_sphere_is_whole_though_its_middle_is_behind_the_plane():
    cloud = rj.Points([[0.0, 0.0, -0.16]], size=0.2, unit="world", shape="sphere")
    frame = draw(cloud, rj.PerspectiveCamera(**LOOK))
    assert near_far(frame.plan.camera).near == 0.05
    np.testing.assert_allclose(frame.depth.min(), 0.06, rtol=1e-2)
    # As large by way of its transform.
    scene = rj.Scene()
    scene.add(rj.Points([[0.0, 0.0, 0.0]], size=0.1, unit="world", shape="sphere"),
              np.array([[0, 2, 0, 0], [2, 0, 0, 0], [0, 0, 2, -0.16], [0, 0, 0, 1.0]]))  # fmt: skip
    assert near_far(draw(scene, rj.PerspectiveCamera(**LOOK)).plan.camera).near == 0.05


@pytest.mark.parametrize("unit", ["pixel", "world"])
def test_lines_close_by_are_whole(unit):
    width = 3.0 if unit == "pixel" else 0.002
    # It goes across the view from one side to the other; its ends are out of view.
    line = rj.Lines([[-0.5, 0.001, -0.03], [0.5, 0.001, -0.03]], width=width, unit=unit)
    frame = draw(line, rj.PerspectiveCamera(**LOOK))
    near = near_far(frame.plan.camera).near
    assert near == 0.1 / 4
    same(frame, draw(line, rj.PerspectiveCamera(**LOOK, near=near / 64)))
    assert (frame.face_id == 0).any(axis=0).all()
    away = rj.Lines(
        [[-0.5, 0.2, -0.03], [0.5, 0.2, -0.03], [0.5, 0.2, -3.0]], width=width, unit=unit
    )
    assert near_far(draw(away, rj.PerspectiveCamera(**LOOK)).plan.camera).near == 0.1


@pytest.mark.parametrize("scales", [(1, 1, 1), (1, -1.5, 0.7)])
@pytest.mark.parametrize("count", [1, 400])
def test_spheres_are_whole_just_before_the_eye(scales, count):
    """Also those whose middle is beside the view or behind the eye."""
    nearer, empty, reach = 0, 0, 0.259 * np.abs(scales).max()
    for seed in range(60):
        rng = np.random.default_rng(seed)
        places, toward = rng.normal(size=(count, 3)), rng.normal(size=3)
        scene = rj.Scene()
        scene.add(
            rj.Points(places, size=0.5, unit="world", shape="sphere"), rj.transforms.scale(scales)
        )
        eye = places[0] * scales + toward / np.linalg.norm(toward) * reach
        look = {"eye": eye, "target": eye + rng.normal(size=3)}
        outputs = ("face_id", "depth")
        kept = rj.render(scene, rj.PerspectiveCamera(**look), size=SIZE, outputs=outputs)
        given = rj.PerspectiveCamera(**look, near=1e-6)
        whole = rj.render(scene, given, size=SIZE, outputs=outputs)
        assert (kept.face_id == whole.face_id).all()
        np.testing.assert_allclose(kept.depth, whole.depth, rtol=1e-4)
        nearer += near_far(kept.plan.camera).near < 0.1
        empty += (whole.face_id < 0).all()
        # Nothing in view asks for nothing.
        if (whole.face_id < 0).all() and count == 1 and scales == (1, 1, 1):
            assert near_far(kept.plan.camera).near > 1e-3
    assert nearer > 5
    assert empty > 5 or count > 1


def test_a_sphere_around_the_eye_is_seen_from_inside():
    cloud = rj.Points([[0.0, 0.0, 0.03]], size=0.14, unit="world", shape="sphere")
    frame = draw(cloud, rj.PerspectiveCamera(**LOOK))
    assert (frame.face_id == 0).all()
    assert 1e-3 < near_far(frame.plan.camera).near <= 0.04


def test_spheres_that_reach_beyond_their_boxes_are_whole_in_batches():
    turn = rj.transforms.rotate((1, 2, 3), 40)
    scene = rj.Scene()
    scene.add(
        rj.Points([[0.0, 0.0, 0.0]], size=0.5, unit="world", shape="sphere"),
        turn @ rj.transforms.scale((1, 0.1, 0.1)),
    )
    across = turn[:3, 1]
    cameras = [rj.PerspectiveCamera(across * way, (0, 0, 0)) for way in (0.29, 0.3, 0.31)]
    outputs = ("face_id", "depth")
    alone = [draw(scene, camera, outputs) for camera in cameras]
    for frame, way in zip(alone, (0.04, 0.05, 0.06), strict=True):
        assert near_far(frame.plan.camera).near <= way
        np.testing.assert_allclose(frame.depth.min(), way, rtol=1e-2)
    several = rj.render_many(scene, cameras, size=SIZE, outputs=outputs)
    for frame, single in zip(several, alone, strict=True):
        same(frame, single, outputs)
