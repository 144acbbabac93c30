"""The laws of the cameras that a person moves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.scene.camera_fitting import BoundingSphere
from rasterjit.viewer.controls import Fly, Orbit

SIZE = (64, 48)
ALL = settings(max_examples=60)

angles = st.floats(-720.0, 720.0)
shares = st.floats(0.0, 1.0)
ups = st.sampled_from([(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 2.0, -0.5)])
keys = st.sets(st.sampled_from(["w", "a", "s", "d", "q", "e", "Shift", "ArrowUp", "ArrowLeft"]))
scene = BoundingSphere((1.0, -2.0, 3.0), 2.5)


def orbit(azimuth=30.0, elevation=10.0, up=(0.0, 1.0, 0.0)):
    start = Orbit.from_camera(rj.fit_camera(scene, aspect=4 / 3), scene, up)
    return start.turn(azimuth, elevation).at_rest()


def flight(up=(0.0, 1.0, 0.0)):
    return Fly.from_camera(rj.fit_camera(scene, aspect=4 / 3), scene, up)


def key(state, name, kind="key_down"):
    return state.handle({"event_type": kind, "key": name}, SIZE)


def pointer(state, kind, x, y, button=1, modifiers=()):
    event = {
        "event_type": f"pointer_{kind}", "x": x, "y": y, "button": button, "modifiers": modifiers,
    }  # fmt: skip
    return state.handle(event, SIZE)


def drag(state, start, end, **how):
    state = pointer(state, "down", *start, **how)
    return pointer(pointer(state, "move", *end), "up", *end)


def pixel_of(camera, point, size=SIZE):
    clip = camera.projection_matrix(size) @ camera.view_matrix() @ [*point, 1.0]
    x, y = clip[:2] / clip[3]
    return (0.5 + 0.5 * x) * size[0], (0.5 - 0.5 * y) * size[1]


@pytest.mark.parametrize("start", ["orbit", "flight"])
def test_release_counts_as_a_move(start):
    state = pointer({"orbit": orbit, "flight": flight}[start](), "down", 3, 4)
    released = pointer(state, "up", 20, 9)
    assert released == pointer(pointer(state, "move", 20, 9), "up", 20, 9)
    assert pointer(released, "up", 40, 40).camera() == released.camera()


def distance_of(camera):
    return math.dist(camera.eye, camera.target)


@ALL
@given(azimuth=angles, elevation=angles, up=ups)
def test_orbit_keeps_the_distance_and_the_target(azimuth, elevation, up):
    before = orbit(up=up)
    after = before.turn(azimuth, elevation)
    for state in (after.advance(0.03), after.at_rest()):
        assert distance_of(state.camera()) == pytest.approx(distance_of(before.camera()))
        assert state.camera().target == before.camera().target


@ALL
@given(moves=st.lists(st.tuples(angles, angles), max_size=6), up=ups)
def test_pole_is_never_flipped(moves, up):
    state = orbit(up=up)
    for azimuth, elevation in moves:
        state = state.turn(azimuth, elevation).advance(0.04)
        assert np.dot(state.camera().up, up) >= -1e-12
        view = state.camera().view_matrix()
        assert np.dot(view[1, :3], up) >= -1e-9


@ALL
@given(
    factor=st.floats(0.2, 5.0), x=shares, y=shares, depth=st.none() | st.floats(0.5, 12.0),
    seconds=st.floats(0.0, 0.3), elevation=st.floats(-90.0, 90.0),
)  # fmt: skip
def test_zoom_keeps_what_is_under_the_cursor(factor, x, y, depth, seconds, elevation):
    start = orbit(0.0, elevation)
    cursor = x * SIZE[0], y * SIZE[1]
    camera = start.camera()
    away = distance_of(camera) if depth is None else depth
    inverse = np.linalg.inv(camera.projection_matrix(SIZE) @ camera.view_matrix())
    ndc = 2.0 * cursor[0] / SIZE[0] - 1.0, 1.0 - 2.0 * cursor[1] / SIZE[1]
    ahead = inverse @ [*ndc, 0.0, 1.0]
    ray = ahead[:3] / ahead[3] - camera.eye
    forward = -camera.view_matrix()[2, :3]
    point = camera.eye + ray * (away / np.dot(ray, forward))
    sent = start.zoom(factor, cursor, SIZE, depth)
    for state in (sent.advance(seconds), sent.at_rest()):
        assert pixel_of(state.camera(), point) == pytest.approx(cursor, abs=1e-6)
    assert distance_of(sent.at_rest().camera()) == pytest.approx(factor * distance_of(camera))


@ALL
@given(dx=st.floats(-40.0, 40.0), dy=st.floats(-40.0, 40.0), elevation=st.floats(-90.0, 90.0))
def test_pan_moves_the_target_with_the_pointer(dx, dy, elevation):
    start = orbit(0.0, elevation)
    point = start.camera().target
    after = drag(start, (10, 10), (10 + dx, 10 + dy), button=2).at_rest()
    assert pixel_of(after.camera(), point) == pytest.approx((32 + dx, 24 + dy), abs=1e-6)
    assert after == drag(start, (10, 10), (10 + dx, 10 + dy), modifiers=("Shift",)).at_rest()


@pytest.mark.parametrize("start", [orbit(), orbit(up=(0, 0, 1)), flight()])
def test_reset_returns_the_first_state(start):
    first = key(start, "r").at_rest()
    state = drag(first, (3, 4), (40, 30))
    state = key(state, "ArrowLeft").advance(0.2)
    state = key(state, "ArrowLeft", "key_up")
    state = state.handle({"event_type": "wheel", "dx": 0, "dy": -300, "x": 9, "y": 9}, SIZE)
    assert state.at_rest() != first
    back = key(state, "r").at_rest()
    assert back.camera() == first.camera()
    assert back == pointer(first, "up", 40, 30).at_rest()


@ALL
@given(azimuth=angles, elevation=angles, aspect=st.floats(0.3, 3.0), up=ups)
def test_fit_shows_all_of_the_scene(azimuth, elevation, aspect, up):
    size = (round(60 * aspect), 60)
    generator = np.random.default_rng(1)
    points = generator.normal(size=(200, 3))
    points = scene.center + scene.radius * points / np.linalg.norm(points, axis=1)[:, None]
    strayed = orbit(azimuth, elevation, up).pan(500.0, 30.0, SIZE).zoom(0.1, (0, 0), SIZE)
    flown = flight(up).look(azimuth, elevation)
    for state in (strayed.fit(size).at_rest(), flown.fit(size)):
        camera = state.camera()
        clip = (
            np.c_[points, np.ones(200)] @ (camera.projection_matrix(size) @ camera.view_matrix()).T
        )
        assert (np.abs(clip[:, :3]) < clip[:, 3:]).all()


@ALL
@given(held=keys, before=st.floats(0.0, 0.2), azimuth=angles, elevation=angles)
def test_time_passes_alike_at_any_rate_of_frames(held, before, azimuth, elevation):
    turning = orbit().turn(azimuth, elevation).zoom(0.5, (3, 5), SIZE)
    flying = flight().look(20.0, -10.0)
    for start in (turning, flying):
        for name in held:
            start = key(start, name)
        start = start.advance(before)
        once, often = start.advance(0.1), start
        for _ in range(10):
            often = often.advance(0.01)
        assert once.camera().eye == pytest.approx(often.camera().eye, rel=1e-9, abs=1e-9)
        assert once.camera().target == pytest.approx(often.camera().target, rel=1e-9, abs=1e-9)


@ALL
@given(held=keys)
def test_flight_is_speed_times_time(held):
    start = flight()
    state = start
    for name in held:
        state = key(state, name)
    # Accelerated, then as long to a stop: what the one lacks the other adds.
    gone = state.advance(2.0)
    for name in held:
        gone = key(gone, name, "key_up")
    gone = gone.at_rest()
    assert gone.is_resting
    way = {"w": 2, "s": 2, "ArrowUp": 2, "a": 0, "d": 0, "ArrowLeft": 0, "q": 1, "e": 1}
    signs = {"w": 1, "s": -1, "ArrowUp": 1, "a": -1, "d": 1, "ArrowLeft": -1, "q": -1, "e": 1}
    total = np.zeros(3)
    for name in held - {"Shift"}:
        total[way[name]] += signs[name]
    speed = 4.0 * start.speed if "Shift" in held else start.speed
    expected = 2.0 * speed if total.any() else 0.0
    assert math.dist(gone.eye, start.eye) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_flying_forward_goes_where_it_looks():
    start = flight().look(70.0, 25.0)
    gone = key(start, "W").advance(1.0)
    forward = -start.camera().view_matrix()[2, :3]
    step = np.subtract(gone.eye, start.eye)
    np.testing.assert_allclose(step / np.linalg.norm(step), forward, atol=1e-12)


def test_dragging_looks_by_the_angle_that_is_seen():
    start = flight()
    turned = drag(start, (0, 0), (0, SIZE[1]))
    assert turned.elevation - start.elevation == pytest.approx(start.fov_y)
    assert drag(start, (0, 0), (5, 0)).azimuth < start.azimuth
    assert pointer(start, "move", 30, 30).camera() == start.camera()


@ALL
@given(azimuth=angles, elevation=st.floats(-90.0, 90.0), up=ups)
def test_start_is_where_the_camera_is(azimuth, elevation, up):
    given_camera = orbit(azimuth, elevation, up).camera()
    state = Orbit.from_camera(given_camera, scene, up)
    np.testing.assert_allclose(state.camera().eye, given_camera.eye, atol=1e-9)
    np.testing.assert_allclose(state.camera().view_matrix(), given_camera.view_matrix(), atol=1e-6)
    assert state.fov_y == pytest.approx(given_camera.fov_y)
    if abs(state.goal.elevation) < 88.0:
        flown = Fly.from_camera(given_camera, scene, up).camera()
        np.testing.assert_allclose(flown.view_matrix(), given_camera.view_matrix(), atol=1e-6)


@pytest.mark.parametrize("kind", [Orbit, Fly])
def test_parallel_camera_becomes_one_that_shows_as_much(kind):
    camera = rj.fit_camera(scene, projection="orthographic")
    seen = kind.from_camera(camera, scene).camera()
    right = camera.view_matrix()[0, :3]
    edge = np.add(scene.center, 0.5 * camera.height * right)
    assert pixel_of(seen, edge, (60, 60)) == pytest.approx((60.0, 30.0), abs=1e-6)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_fitted_camera_shows_the_whole_scene_in_an_upright_window_too(projection):
    size = 30, 90
    seen = Orbit.from_camera(rj.fit_camera(scene, projection=projection), scene, size=size).camera()
    right = np.multiply(scene.radius, seen.view_matrix()[0, :3])
    for edge in (scene.center - right, scene.center + right):
        assert 0.0 < pixel_of(seen, edge, size)[0] < size[0]


def test_matrix_camera_is_taken():
    placed = orbit().camera()
    matrices = rj.MatrixCamera(placed.view_matrix(), placed.projection_matrix((1, 1)))
    state = Orbit.from_camera(matrices, scene)
    np.testing.assert_allclose(state.camera().view_matrix(), placed.view_matrix(), atol=1e-6)
    # One that is made for a size starts with what is up and down there, in any window.
    calibrated = replace(matrices, size=(640, 480))
    assert Orbit.from_camera(calibrated, scene, size=(30, 90)).fov_y == state.fov_y


def test_eye_may_be_inside_the_scene_or_behind_it():
    inside = rj.PerspectiveCamera(eye=scene.center, target=(9.0, -2.0, 3.0))
    behind = rj.PerspectiveCamera(eye=(50.0, -2.0, 3.0), target=(60.0, -2.0, 3.0))
    for camera in (inside, behind):
        state = Orbit.from_camera(camera, scene)
        np.testing.assert_allclose(state.camera().eye, camera.eye, atol=1e-9)
        assert 0.0 < state.camera().near < scene.radius * 20


@ALL
@given(dy=st.floats(allow_nan=False, allow_infinity=False), count=st.integers(1, 30))
def test_wheel_never_leaves_what_a_camera_can_be(dy, count):
    state, fast = orbit(), flight()
    for _ in range(count):
        wheel = {"event_type": "wheel", "dx": 0.0, "dy": dy, "x": 3.0, "y": 40.0}
        state = state.handle(wheel, SIZE).at_rest()
        fast = fast.handle(wheel, SIZE)
    assert state.camera().near > 0.0
    assert 0.0 < fast.speed < math.inf


@pytest.mark.parametrize("name", ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"])
def test_held_arrow_turns_and_stops(name):
    start = orbit()
    turned = key(start, name).advance(0.5)
    assert not turned.is_resting
    stopped = key(turned, name, "key_up").advance(2.0)
    assert stopped.is_resting
    moved = abs(stopped.goal.azimuth - start.goal.azimuth)
    moved += abs(stopped.goal.elevation - start.goal.elevation)
    assert moved == pytest.approx(45.0)


def test_unknown_events_change_nothing():
    for state in (orbit(), flight()):
        for kind in ("pointer_enter", "resize", "close", "char", "double_click"):
            assert state.handle({"event_type": kind}, SIZE) is state
        assert key(state, "x") is state


def test_wrong_numbers_are_refused():
    with pytest.raises(ValueError, match="factor must be above 0, got 0"):
        orbit().zoom(0.0, (0, 0), SIZE)
    with pytest.raises(ValueError, match="azimuth must be finite"):
        orbit().turn(math.nan, 0.0)
    with pytest.raises(ValueError, match="up"):
        Orbit.from_camera(orbit().camera(), scene, (0, 0, 0))


def test_key_that_stays_down_flies_on_when_its_opposite_is_let_go():
    state = key(key(flight(), "w"), "s").advance(0.1)
    assert state.is_resting
    state = key(state.at_rest(), "s", "key_up")
    assert not state.is_resting
    assert state == key(flight(), "w").at_rest()
    assert state.advance(0.5).eye != state.eye


@pytest.mark.parametrize("kind", [Orbit, Fly])
@pytest.mark.parametrize("size", [(90, 40), (40, 90)])
def test_f_shows_a_scene_as_large_as_it_fits(kind, size):
    drawn = rj.Scene()
    drawn.add(rj.Mesh([(0, 0, 0), (6, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 1, 2), (0, 2, 3)]))
    far_away = rj.PerspectiveCamera((40.0, 30.0, 50.0), (0.0, 0.0, 0.0))
    start = kind.from_camera(far_away, BoundingSphere.around(drawn))
    assert start == kind.from_camera(far_away, drawn)
    fitted = start.fit(size)
    camera = (fitted.at_rest() if kind is Orbit else fitted).camera()
    pixels = np.array([pixel_of(camera, one, size) for one in drawn.nodes[0].mesh.vertices])
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    np.testing.assert_allclose(low + high, size, atol=1e-6)
    shares = (high - low) / size
    # An upright window is filled from side to side, others at their tighter sides.
    assert shares.max() == pytest.approx(1.0 / 1.06, abs=1e-6)
