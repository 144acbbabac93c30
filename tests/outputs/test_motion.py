"""Motion is where a point is now less where it was, and is told apart from what was hidden."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import rasterjit as rj

SIZE = (48, 36)
OUTPUTS = ("motion", "motion_visible", "face_id", "object_id", "barycentric")
T = rj.transforms
NOW = rj.PerspectiveCamera((1.0, 1.2, 4.5), (0, 0, 0), near=0.5, far=30.0)
BEFORE = rj.PerspectiveCamera((0.6, 1.5, 4.4), (0.1, 0, 0), fov_y=50.0, near=0.5, far=30.0)
PARALLEL = rj.OrthographicCamera((1.0, 1.2, 4.5), (0, 0, 0), height=3.5, far=20.0)
INSIDE = rj.PerspectiveCamera((0.6, 0.8, 1.6), (0, 0, 0), near=0.9)


def scene_of(*parts):
    """Return a scene of meshes and the matrices that place them."""
    scene = rj.Scene()
    for mesh, matrix in parts:
        scene.add(mesh, matrix)
    return scene


def square(z=0.0, half=1.0, **material):
    vertices = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]
    return rj.Mesh(vertices, [[0, 1, 2], [0, 2, 3]], material=rj.Material(**material))


def look(scene, camera, previous, **options):
    options = {"size": SIZE, "outputs": OUTPUTS, "threads": 1, **options}
    return rj.render(scene, camera, previous=previous, **options)


def project(points, camera, size=SIZE):
    """Return the places of world points on the screen, pixels, and w."""
    clip = T.apply(camera.view_matrix(), points)
    clip = np.c_[clip, np.ones(len(clip))] @ np.array(camera.projection_matrix(size)).T
    ndc = clip[:, :2] / clip[:, 3:]
    return (ndc * (1, -1) + 1.0) / 2.0 * size, clip[:, 3]


def corners_of(scene):
    """Return where the corners of all faces lie in a scene's world, (F, 3, 3)."""
    nodes = scene.nodes
    return np.concatenate(
        [T.apply(node.world_from_model, node.mesh.vertices)[node.mesh.faces] for node in nodes]
    )


def points_of(frame, scene):
    """Return where the points that are seen lie in a scene's world, (N, 3)."""
    corners = np.concatenate(
        [
            T.apply(node.world_from_model, node.mesh.vertices)[node.mesh.faces]
            for node in scene.nodes
        ]
    )
    hit = frame.face_id >= 0
    weights = frame.barycentric[hit].astype(float)
    return (corners[frame.face_id[hit]] * weights[:, :, np.newaxis]).sum(axis=1)


@pytest.fixture
def pair(cube, sphere):
    """A scene now and before: one object turned, one bent, one as it was."""
    bent = rj.Mesh(sphere.vertices * (1.0, 1.3, 0.8) + (0.1, 0, 0), sphere.faces)
    floor = T.compose(T.translate((0, -1.2, 0)), T.scale((3.0, 0.1, 3.0)))
    now = scene_of((cube, T.rotate_y(20.0)), (sphere, T.translate((1.2, 0.5, 1))), (cube, floor))
    old = scene_of((cube, T.rotate_y(5.0)), (bent, T.translate((0.9, 0.6, 1))), (cube, floor))
    return now, old


@pytest.mark.parametrize(
    ("now", "before"),
    [(NOW, BEFORE), (NOW, NOW), (PARALLEL, PARALLEL), (NOW, PARALLEL), (INSIDE, BEFORE)],
)
def test_motion_is_between_the_projected_points(pair, now, before):
    frame = look(pair[0], now, rj.PreviousView(pair[1], before))
    hit = frame.face_id >= 0
    here, _ = project(points_of(frame, pair[0]), now)
    there, w = project(points_of(frame, pair[1]), before)
    assert (w > 0.0).all()
    np.testing.assert_allclose(frame.motion[hit], here - there, atol=2e-4)
    assert np.isnan(frame.motion[~hit]).all()
    assert np.abs(frame.motion[hit]).max() > 0.5
    # The place now is the pixel itself, but for the snapping of vertices.
    row, column = np.nonzero(hit)
    np.testing.assert_allclose(here, np.c_[column, row] + 0.5, atol=0.02)


@pytest.mark.parametrize("camera", [NOW, PARALLEL, INSIDE])
def test_what_has_not_moved_has_moved_by_nothing_and_was_seen(pair, camera):
    for previous in (rj.PreviousView(), rj.PreviousView(pair[0], camera), rj.PreviousView(pair[0])):
        frame = look(pair[0], camera, previous)
        hit = frame.face_id >= 0
        assert (frame.motion[hit] == 0.0).all()
        assert (frame.motion_visible == hit).all()


def test_motion_points_right_and_down():
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=6.0)
    now = scene_of((square(), T.translate((0.5, -0.25, 0))))
    frame = look(now, camera, rj.PreviousView(scene_of((square(), T.identity()))), size=(60, 60))
    hit = frame.face_id >= 0
    np.testing.assert_allclose(frame.motion[hit], [[5.0, 2.5]] * hit.sum(), atol=1e-4)


def test_camera_of_the_view_is_enough(cube):
    moved = look(cube, NOW, rj.PreviousView(camera=BEFORE))
    both = look(cube, NOW, rj.PreviousView(cube, BEFORE))
    for name in OUTPUTS:
        assert getattr(moved, name).tobytes() == getattr(both, name).tobytes()
    assert np.nanmax(np.abs(moved.motion)) > 0.5


def test_point_that_was_behind_the_eye_has_no_motion_and_was_not_seen():
    behind = rj.PerspectiveCamera((0, 0, -3), (0, 0, -9))
    frame = look(square(), NOW, rj.PreviousView(camera=behind))
    assert (frame.face_id >= 0).any()
    assert np.isnan(frame.motion).all()
    assert not frame.motion_visible.any()


# What was seen


def test_what_was_behind_something_else_was_not_seen():
    # A wall, and before it a square that moves from left to right: what it uncovers was hidden.
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0)
    wall, card = square(half=3.0), square(z=1.0, half=0.5)
    now = scene_of((wall, T.identity()), (card, T.translate((1.0, 0, 0))))
    old = scene_of((wall, T.identity()), (card, T.translate((-1.0, 0, 0))))
    frame = look(now, camera, rj.PreviousView(old), size=(40, 40))
    x = (np.arange(40) + 0.5) / 10.0 - 2.0
    uncovered = (np.abs(x + 1.0) < 0.5) & (np.abs(x[:, np.newaxis]) < 0.5)
    assert uncovered.any()
    assert (frame.motion_visible == ~uncovered).all()
    assert (frame.motion[frame.object_id == 1] == [20.0, 0.0]).all()
    assert (frame.motion[frame.object_id == 0] == 0.0).all()


def test_what_was_beside_the_picture_was_not_seen():
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0)
    moved = rj.OrthographicCamera((0.5, 0.0, 5), (0.5, 0, 0), height=4.0)
    frame = look(square(half=3.0), camera, rj.PreviousView(camera=moved), size=(40, 40))
    assert not frame.motion_visible[:, :5].any()
    assert frame.motion_visible[:, 5:].all()


def test_what_was_beyond_the_view_volume_was_not_seen():
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0, near=1.0, far=20.0)
    for planes in ({"near": 1.0, "far": 4.5}, {"near": 5.5, "far": 20.0}):
        cut = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0, **planes)
        frame = look(square(), camera, rj.PreviousView(camera=cut))
        assert (frame.face_id >= 0).any()
        assert not frame.motion_visible.any()
        assert (frame.motion[frame.face_id >= 0] == 0.0).all()


@pytest.mark.parametrize(("cull", "turned"), [("back", 180.0), ("front", 0.0)])
def test_face_that_was_turned_away_and_dropped_was_not_seen(cull, turned):
    # Before a wall, so that its plane is nearer than what was seen in its place.
    camera = rj.PerspectiveCamera((0, 0, 5), (0, 0, 0))
    wall = rj.Mesh([[-9, -9, -2], [9, -9, -2], [0, 9, -2]],
                   [[0, 1, 2]] if cull == "back" else [[0, 2, 1]])  # fmt: skip
    place = T.rotate_y(180.0 - turned)
    now = scene_of((wall, T.identity()), (square(), place))
    old = scene_of((wall, T.identity()), (square(), T.rotate_y(turned)))
    for mode, is_seen in ((cull, False), ("none", True)):
        frame = look(now, camera, rj.PreviousView(old), cull=mode)
        own = frame.object_id == 1
        assert own.any()
        assert (frame.motion_visible[own] == is_seen).all()


def test_single_sided_face_that_was_turned_away_was_not_seen():
    camera = rj.PerspectiveCamera((0, 0, 5), (0, 0, 0))
    card = square(double_sided=False)
    old = scene_of((card, T.rotate_y(180.0)))
    frame = look(scene_of((card, T.identity())), camera, rj.PreviousView(old))
    assert (frame.face_id >= 0).any()
    assert not frame.motion_visible.any()


def first_hits(eye, points, corners):
    """Return the distance along each way from the eye, as a share, to the first triangle."""
    a, b, c = corners.transpose(1, 0, 2)
    shares = np.full(len(points), np.inf)
    for n, point in enumerate(points):
        way = point - eye
        p, ab, ac, to = np.cross(way, c - a), b - a, c - a, eye - a
        det = (ab * p).sum(axis=1)
        with np.errstate(all="ignore"):
            u = (to * p).sum(axis=1) / det
            q = np.cross(to, ab)
            v, t = (way * q).sum(axis=1) / det, (ac * q).sum(axis=1) / det
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        shares[n] = t[hit].min(initial=np.inf)
    return shares


def test_what_was_seen_is_what_rays_reach_but_at_edges(pair):
    now, old = pair
    frame = look(now, NOW, rj.PreviousView(old, BEFORE), size=(96, 72))
    corners = corners_of(old)
    points, hit = points_of(frame, old), frame.face_id >= 0
    there, _ = project(points, BEFORE, (96, 72))
    inside = ((there >= 0) & (there < (96, 72))).all(axis=1)
    want = np.zeros(hit.shape, bool)
    want[hit] = inside & (first_hits(BEFORE.eye_position(), points, corners) > 1.0 - 1e-5)
    assert np.count_nonzero(hit & ~want) > 50
    differ = want != frame.motion_visible
    assert differ.sum() < 0.01 * hit.sum()
    # Where all is alike around the point, both before and now, there is no doubt.
    before = rj.render(old, BEFORE, size=(96, 72), outputs="object_id").object_id
    column, row = np.floor(there[inside]).astype(int).T
    around = [
        before[np.clip(row + j, 0, 71), np.clip(column + i, 0, 95)]
        for i, j in itertools.product((-1, 0, 1), repeat=2)
    ]
    alike = np.zeros(hit.shape, bool)
    places = np.argwhere(hit)[inside]
    alike[tuple(places.T)] = (np.array(around) == around[4]).all(axis=0)
    assert alike.sum() > 0.7 * hit.sum()
    assert not differ[alike].any()


# How it is asked for


def test_any_number_of_threads_gives_the_same_bits(pair):
    found = [
        look(
            pair[0], NOW, rj.PreviousView(pair[1], BEFORE), size=(150, 130), threads=threads
        ).arrays()
        for threads in (1, 3)
    ]
    for name in OUTPUTS:
        assert found[0][name].tobytes() == found[1][name].tobytes()


def test_one_output_does_not_change_another(pair):
    previous = rj.PreviousView(pair[1], BEFORE)
    both = look(pair[0], NOW, previous)
    for name in ("motion", "motion_visible"):
        alone = look(pair[0], NOW, previous, outputs=name)
        assert getattr(alone, name).tobytes() == getattr(both, name).tobytes()


def test_previous_view_does_not_change_the_picture(pair):
    plain = rj.render(pair[0], NOW, size=SIZE)
    asked = look(pair[0], NOW, rj.PreviousView(pair[1], BEFORE), outputs=("color", "motion"))
    unused = look(pair[0], NOW, rj.PreviousView(pair[1], BEFORE), outputs=("color",))
    assert plain.color.tobytes() == asked.color.tobytes() == unused.color.tobytes()
    assert unused.plan.previous is None


@pytest.mark.filterwarnings("ignore::rasterjit.CalibrationWarning")
def test_renderer_takes_a_view_and_keeps_nothing_of_it(pair):
    with rj.Renderer(SIZE, threads=1) as renderer:
        options = {"outputs": OUTPUTS, "previous": rj.PreviousView(pair[1], BEFORE)}
        first = renderer.render(pair[0], NOW, **options)
        renderer.render(pair[1], BEFORE)
        again = renderer.render(pair[0], NOW, **options)
        last = list(renderer.refine(pair[0], NOW, **options))[-1]
        timed = renderer.render(pair[0], NOW, time_budget=60.0, **options)
        within = renderer.render(pair[0], NOW, max_error=0.5, **options)
    want = look(pair[0], NOW, rj.PreviousView(pair[1], BEFORE))
    for name in OUTPUTS:
        for frame in (first, again):
            assert getattr(frame, name).tobytes() == getattr(want, name).tobytes()
        for frame in (last, timed, within):
            assert getattr(frame, name).shape == getattr(want, name).shape


def test_faces_before_are_found_only_for_who_asks(pair):
    previous = rj.PreviousView(pair[1], BEFORE)
    plan = rj.explain(pair[0], NOW, size=SIZE, outputs="motion", previous=previous)
    assert "another camera; its faces are not looked at" in str(plan)
    plan = rj.explain(pair[0], size=SIZE, outputs="motion_visible", previous=rj.PreviousView())
    assert "the same camera; its faces are found" in str(plan)
    assert "previous view" not in str(rj.explain(pair[0], size=SIZE))


@pytest.mark.parametrize("ask", [rj.render, rj.explain, rj.Renderer(SIZE).render])
def test_bad_views_are_refused_by_name(cube, sphere, ask):
    size = {} if getattr(ask, "__self__", None) else {"size": SIZE}
    two = scene_of((cube, T.identity()), (cube, T.identity()))
    for previous, message in (
        (None, "previous must be a PreviousView where outputs has 'motion'"),
        (NOW, "previous must be a PreviousView or None"),
        ((cube, NOW), "previous must be a PreviousView or None"),
        (
            rj.PreviousView(scene=two),
            r"previous.scene must have the same objects as the scene, 1; got 2",
        ),
        (
            rj.PreviousView(scene=sphere),
            r"previous.scene must have the same faces .* 12 of object 0",
        ),
        (rj.PreviousView(scene=rj.Scene()), "previous.scene: scene must hold at least one mesh"),
        (rj.PreviousView(scene="teapot.obj"), "previous.scene: what must be a Scene"),
        (rj.PreviousView(scene=NOW), "previous.scene: what must be a Scene"),
        (rj.PreviousView(camera=cube), "previous.camera: camera must be a PerspectiveCamera"),
        (rj.PreviousView(camera=rj.PerspectiveCamera), "previous.camera: camera must be a Persp"),
    ):
        with pytest.raises(ValueError, match=message):
            ask(cube, NOW, outputs="motion", previous=previous, **size)


def test_corners_are_compared_as_meshes_list_them(cube):
    # Faces begin with their least corners: those of a mesh that is turned itself are others.
    turn = T.rotate((1.0, 2.0, 3.0), 130.0)
    turned = rj.Mesh(T.apply(turn, cube.vertices), cube.faces, material=cube.material)
    assert (turned._faces_to_draw() != cube._faces_to_draw()).any()
    now = scene_of((cube, np.eye(4)))
    places = [scene_of((cube, turn)), scene_of((turned, np.eye(4)))]
    for lens in ({}, {"lens": rj.Equirectangular()}):
        by_matrix, by_mesh = (
            rj.render(
                now,
                NOW,
                size=(64, 32),
                outputs=("motion",),
                previous=rj.PreviousView(scene, NOW),
                **lens,
            ).motion
            for scene in places
        )
        assert np.isfinite(by_matrix).any()
        np.testing.assert_allclose(by_mesh, by_matrix, atol=1e-3)
