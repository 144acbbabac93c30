"""A scene at map coordinates, 1e7 units from the origin, has the picture it has at the origin."""

from __future__ import annotations

from fractions import Fraction

import frames
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle

tf = rj.transforms
SIZE = (64, 64)
HERE = np.zeros(3)

FAR = {
    "1e7": np.array([1e7, -1e7, 1e7]),
    "2**20": np.array([2.0**20, -(2.0**20), 2.0**20]),
    "a map": np.array([500000.125, 5400000.25, -312.5]),
}
"""Offsets to which every coordinate of the scene, a multiple of 1/256, can be added exactly."""

EXACT = ("color", "depth", "face_id", "object_id", "normal", "barycentric", "uv")
"""Outputs that keep every bit; positions are float32, which rounds far coordinates to a unit."""

# Seventy-two loose corners and a floor that passes the eye and leaves the view on every side.
CORNERS = np.round(np.random.default_rng(1).uniform(-2, 2, (72, 3)) * 256) / 256
FACES = np.arange(72).reshape(-1, 3)
FLOOR = np.array([(-64, -2, 64), (64, -2, 64), (64, -2, -64), (-64, -2, -64)], float)
EYE, TARGET = np.array([2.5, 3.0, 5.0]), np.array([0.25, -0.5, 0.0])


def by_vertices(points, offset):
    """Return vertices that are far away themselves, and where they stand."""
    return points + offset, np.eye(4)


def by_node(points, offset):
    """Return vertices near the origin of their model, which stands far away."""
    return points, tf.translate(offset)


def by_turned_node(points, offset):
    """Return the same for a model that is turned, stretched and mirrored."""
    return points, tf.compose(
        tf.translate(offset), tf.rotate((1, 2, 3), 30), tf.scale((1, 0.5, -2))
    )


PLACEMENTS = [by_vertices, by_node, by_turned_node]


def scene_at(offset, place=by_vertices, shading="phong", wireframe=None, change=lambda v: v):
    """Return the scene, moved by an offset; ``change`` spoils its vertices."""
    scene = rj.Scene()
    material = rj.Material(shading, "#c08040", specular=0.5, shininess=20)
    for points, faces in ((CORNERS, FACES), (FLOOR, [[0, 1, 2], [0, 2, 3]])):
        vertices, transform = place(points, offset)
        scene.add(rj.Mesh(change(vertices), faces, uv=points[:, :2], material=material), transform)
    lamp = np.array([1.5, 2.25, 3.0]) + offset
    scene.lights += [rj.AmbientLight(intensity=0.1), rj.DirectionalLight(direction=(-1, -2, -1)),
                     rj.PointLight(position=lamp, intensity=8)]  # fmt: skip
    scene.wireframe = wireframe
    return scene


def perspective(offset):
    return rj.PerspectiveCamera(EYE + offset, TARGET + offset, fov_y=50, near=0.5)


def orthographic(offset):
    return rj.OrthographicCamera(EYE + offset, TARGET + offset, height=6, near=-3, far=40)


def matrices(offset):
    # A quarter turn: nothing in the given matrices is rounded.
    view = tf.compose(tf.translate((0, 0, -6)), tf.rotate_y(90), tf.translate(-offset))
    return rj.MatrixCamera(view, tf.perspective(60, 1, 0.5, 100))


CAMERAS = [perspective, orthographic, matrices]


def render(offset, camera, outputs=EXACT, **how):
    return rj.render(scene_at(offset, **how), camera(offset), size=SIZE, outputs=outputs, threads=1)


def assert_same_bits(one, other):
    for name, array in one.arrays().items():
        assert array.tobytes() == other.arrays()[name].tobytes(), name


# --- what floats hold exactly ---------------------------------------------------------------------


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("place", PLACEMENTS)
@pytest.mark.parametrize("offset", FAR.values(), ids=FAR)
def test_moving_scene_camera_and_lights_changes_no_bit(offset, place, camera):
    here, there = render(HERE, camera, place=place), render(offset, camera, place=place)
    assert here.stats.pixels_covered > 500
    assert here.stats.clipped > 0
    assert_same_bits(here, there)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("shading", ["unlit", "flat", "gouraud", "phong"])
@pytest.mark.parametrize("offset", FAR.values(), ids=FAR)
def test_light_keeps_every_bit_before_it_is_rounded_to_8_bits(offset, shading, camera):
    for place in PLACEMENTS:
        assert_same_bits(
            render(HERE, camera, ("linear",), place=place, shading=shading),
            render(offset, camera, ("linear",), place=place, shading=shading),
        )


@pytest.mark.parametrize("mode", ["overlay", "only"])
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("offset", FAR.values(), ids=FAR)
def test_wireframe_far_away_has_the_same_pixels(offset, camera, mode):
    lines = rj.Wireframe("red", mode)
    for place in PLACEMENTS:
        here = render(HERE, camera, ("color",), place=place, wireframe=lines)
        red = (here.color[..., :3] == (255, 0, 0)).all(axis=2)
        assert 100 < red.sum() < red.size
        assert_same_bits(here, render(offset, camera, ("color",), place=place, wireframe=lines))


@pytest.mark.parametrize("place", PLACEMENTS)
@pytest.mark.parametrize("offset", FAR.values(), ids=FAR)
def test_positions_move_by_the_offset(offset, place):
    here, there = (
        render(move, perspective, ("position",), place=place).position for move in (HERE, offset)
    )
    # Both are float32: each is off by half the distance to its neighbour.
    rounding = np.spacing(np.abs(here)) / 2.0 + np.spacing(np.abs(there)) / 2.0
    moved = there.astype(float) - offset - here
    assert (np.isnan(here) == np.isnan(there)).all()
    known = ~np.isnan(here)
    assert known.sum() > 6000
    assert (np.abs(moved) <= rounding.astype(float))[known].all()


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("offset", FAR.values(), ids=FAR)
def test_fitted_camera_moves_by_the_offset(offset, projection):
    # Its place is measured from the scene and rounded to the nearest that floats hold there.
    here, there = (rj.fit_camera(scene_at(move), projection=projection) for move in (HERE, offset))
    for name in ("eye", "target"):
        moved = np.subtract(getattr(there, name), getattr(here, name)) - offset
        assert (np.abs(moved) <= np.spacing(np.abs(offset).max())).all()
    assert (there.near, there.far) == (here.near, here.far)
    assert np.array_equal(there.projection_matrix(SIZE), here.projection_matrix(SIZE))


@pytest.mark.parametrize("camera", CAMERAS)
def test_pictures_keep_every_bit_as_long_as_coordinates_do(camera):
    # 2**40 + 1/256 has 48 bits.
    offset = np.array([2.0**40, 3 * 2.0**39, -(2.0**40)])
    outputs = (*EXACT, "linear")
    for place in PLACEMENTS:
        assert_same_bits(
            render(HERE, camera, outputs, place=place), render(offset, camera, outputs, place=place)
        )


# --- what floats round ----------------------------------------------------------------------------

SAFE = Fraction(1, 2**20)
"""Steps of the sub-pixel grid. Float64 finds where a corner is seen, at most 2**21 steps away in
the guard band, in a few roundings of 2**-53 each: one that is farther than this from the middle
between two steps is snapped as exact arithmetic snaps it."""


def by_thirds(points, offset):
    """Return vertices whose coordinates float64 rounds, near the origin and again far from it."""
    return points / 3 + offset, np.eye(4)


def clip_positions(points, camera):
    """Return the exact clip positions, in fractions, of the world points that floats hold."""
    lens = camera.projection_matrix(SIZE)
    # The camera's axes alone; its place is taken exactly.
    linear = [[Fraction(c) for c in row[:3]] for row in camera.view_matrix()[:3].tolist()]
    eye = [Fraction(c) for c in camera.eye_position().tolist()]
    positions = []
    for point in points.tolist():
        seen = [Fraction(p) - e for p, e in zip(point, eye, strict=True)]
        view = [sum(a * c for a, c in zip(row, seen, strict=True)) for row in linear]
        positions.append(
            tuple(
                sum(Fraction(a) * c for a, c in zip(row, (*view, 1), strict=True))
                for row in lens.tolist()
            )
        )
    return positions


def snapped_and_doubt(positions, faces):
    """Return all vertices on the grid, and how near the nearest is to the middle of two steps."""
    grid, doubt = [], Fraction(1)
    for face in faces:
        polygon = [positions[n] for n in face]
        if any(oracle.plane_distance(p, v) < 0 for p in oracle.guard_band(SIZE) for v in polygon):
            polygon = oracle.clip_polygon(polygon, oracle.guard_band(SIZE))
        for vertex in polygon:
            for coordinate in oracle.screen_position(vertex, SIZE):
                steps = coordinate * 256
                grid.append(oracle.snap(coordinate))
                doubt = min(doubt, abs(steps - (steps // 1) - Fraction(1, 2)))
    return grid, doubt


@pytest.mark.parametrize(
    "offset",
    [
        FAR["1e7"],
        np.full(3, 1e7 / 3),
        np.array([1e7 / 7, -1e7 / 3, 1e7 / 9]),
        np.array([0.1, 1e6 / 3, -1e7]),
    ],
)
def test_offsets_that_floats_round_move_no_pixel(offset):
    # Where the rounded coordinates are seen is computed exactly. All snap as at the origin, and
    # none lies so near the middle of two steps that float64 could snap it otherwise: then no rule
    # allows another pixel.
    points = np.concatenate([CORNERS, FLOOR])
    faces = [*FACES.tolist(), [72, 73, 74], [72, 74, 75]]
    places = [
        clip_positions(by_thirds(points, move)[0], perspective(move)) for move in (HERE, offset)
    ]
    (near_grid, near_doubt), (far_grid, far_doubt) = (
        snapped_and_doubt(positions, faces) for positions in places
    )
    assert places[0] != places[1]
    assert min(near_doubt, far_doubt) > SAFE
    assert near_grid == far_grid
    here, there = (
        render(move, perspective, ("face_id", "depth"), place=by_thirds) for move in (HERE, offset)
    )
    assert here.stats.pixels_covered > 500
    assert (here.face_id == there.face_id).all()
    # float32 rounds what is stored and what is returned, of both pictures.
    np.testing.assert_allclose(there.depth, here.depth, rtol=2 * 2.0**-23, atol=0)
    # And the far picture is the exact one of its own coordinates.
    exact = np.full(SIZE[::-1], -1)
    for (column, row), (face, _) in oracle.render_faces(places[1], faces, SIZE).items():
        exact[row, column] = face
    assert (there.face_id == exact).all()


# --- that these tests can fail --------------------------------------------------------------------


@pytest.mark.parametrize("offset", FAR.values(), ids=FAR)
def test_float32_coordinates_do_not_survive_the_move(offset):
    def to_float32(vertices):
        return vertices.astype(np.float32).astype(np.float64)

    assert_same_bits(render(HERE, perspective), render(HERE, perspective, change=to_float32))
    there = render(offset, perspective)
    spoilt = render(offset, perspective, change=to_float32)
    wrong = int((there.face_id != spoilt.face_id).sum())
    # Float32 has a step of 1/16 to 1 unit there, and a unit is some ten pixels.
    assert wrong > 100


def test_clip_positions_that_do_not_go_by_way_of_the_eye_do_not_survive_the_move():
    offset = np.array([2.0**40, 3 * 2.0**39, -(2.0**40)])
    wrong = []
    for move in (HERE, offset):
        camera = perspective(move)
        clip_from_world = tf.compose(camera.projection_matrix(SIZE), camera.view_matrix())
        positions = tf.transform_points(clip_from_world, CORNERS + move)
        seen = rj.rasterize(positions, FACES, SIZE, threads=1).barycentric
        scene = rj.Scene()
        scene.add(rj.Mesh(CORNERS + move, FACES))
        shown = rj.render(scene, camera, size=SIZE, outputs=("barycentric",), threads=1).barycentric
        wrong.append(int((seen != shown).sum()))
    assert wrong[1] > 1000 > wrong[0]


# --- how large ------------------------------------------------------------------------------------


def scaled_shot(scale):
    """Return the colour and the depth of a ball with a highlight, all lengths times a scale."""
    scene = rj.Scene()
    scene.add(frames.ball(4), rj.transforms.scale(scale))
    scene.lights = [rj.AmbientLight(intensity=0.1), rj.DirectionalLight((-1.0, -2.0, -1.5))]
    camera = rj.PerspectiveCamera((2 * scale, 1.5 * scale, 4 * scale), (0, 0, 0), near=0.1 * scale)
    frame = rj.render(scene, camera, size=(48, 32), outputs=("linear", "depth"), threads=1)
    return frame.linear, frame.depth


@pytest.mark.parametrize("power", [-40, -20, 30, 59])
def test_a_scene_of_any_size_from_1e_12_to_1e18_units_looks_the_same(power):
    linear, depth = scaled_shot(1.0)
    large, far = scaled_shot(2.0**power)
    assert large.tobytes() == linear.tobytes()
    assert (far == np.ldexp(depth, power)).all()


LAMPS = {
    "point": lambda at, size: rj.PointLight(at, intensity=9.0),
    "with a range": lambda at, size: rj.PointLight(at, intensity=9.0, range=9.0 * size),
    "spot": lambda at, size: rj.SpotLight(at, (-1, -2, -1.5), intensity=9.0, outer_angle=50.0),
    "with a shadow": lambda at, size: rj.PointLight(at, shadow=rj.Shadow(size=32)),
    "sun": lambda at, size: rj.DirectionalLight((-1, -2, -1.5), shadow=rj.Shadow(32, "soft", 2.0)),
}
EFFECTS = {
    "light": {},
    "occlusion": {"ambient_occlusion": rj.AmbientOcclusion()},
    "fog": {"fog": rj.Fog("red", "exp", density=1e-9, height=0.5, falloff=0.5)},
    "picture": {"environment": rj.Environment(np.full((2, 4, 3), 0.5, np.float32))},
    "gradient": {"environment": rj.Environment.gradient("red", "green", "blue")},
}


def vast_shot(size, shading, lamp=None, effect="light", **material):
    """Return the light on a ball and a floor of a size, (N, 3), and where they are seen."""
    scene = rj.Scene()
    for name, own in EFFECTS[effect].items():
        setattr(scene, name, own)
    look = rj.Material(shading=shading, **material)
    ball, floor = frames.ball(4), frames.plane(2, 2.0)
    for mesh, height in ((ball, 0.0), (floor, -1.0)):
        mesh = rj.Mesh(mesh.vertices, mesh.faces, normals=mesh.normals, material=look)
        scene.add(mesh, tf.compose(tf.translate((0, height * size, 0)), tf.scale(size)))
    scene.lights = [rj.AmbientLight(intensity=0.1)]
    if lamp is not None:
        scene.lights.append(LAMPS[lamp]((1.2 * size, 2.4 * size, 1.8 * size), size))
    camera = rj.PerspectiveCamera((2 * size, 1.5 * size, 4 * size), (0, 0, 0), near=0.1 * size)
    frame = rj.render(scene, camera, size=(24, 16), outputs=("linear", "face_id"), threads=1)
    return frame.linear[frame.face_id >= 0][:, :3], frame.face_id


@pytest.mark.needs_jit
@pytest.mark.parametrize("size", [1e18, 4e18, 1e19, 1e30, 1e60])
@pytest.mark.parametrize("shading", ["flat", "gouraud", "phong", "pbr"])
def test_lamps_of_scenes_too_vast_for_float32_are_black(shading, size):
    _, near = vast_shot(1.0, shading)
    dark, seen = vast_shot(size, shading)
    assert (seen == near).all()
    for lamp in LAMPS:
        lit, _ = vast_shot(size, shading, lamp)
        assert np.isfinite(lit).all()
        if lamp != "sun":
            assert lit.tobytes() == dark.tobytes()


@pytest.mark.parametrize("size", [4e18, 1e19, 1e30])
def test_the_sun_is_the_same_on_a_vast_scene_but_for_its_highlights(size):
    for shading in ("flat", "gouraud", "phong"):
        near, _ = vast_shot(1.0, shading, "sun", specular=0.0)
        far, _ = vast_shot(size, shading, "sun")
        if size < 1e19:
            near, _ = vast_shot(1.0, shading, "sun")
        assert np.abs(far - near).max() < 1e-5
        assert near.max() > 0.5


@pytest.mark.needs_jit
@pytest.mark.parametrize("size", [4e18, 1e19, 1e30, 1e60])
@pytest.mark.parametrize("effect", EFFECTS)
def test_effects_on_vast_scenes_give_numbers(effect, size):
    for shading in ("phong", "pbr"):
        lit, _ = vast_shot(size, shading, "sun", effect)
        assert np.isfinite(lit).all()
        assert (lit >= 0.0).all()


@pytest.mark.parametrize("near", [1e-33, 1e-10, 1.0])
def test_a_centimetre_at_ten_kilometres_is_kept_with_any_near_plane(near):
    # The distance is at most 1e37 times that of the near plane.
    scene = rj.Scene()
    for z in (10000.01, 10000.0):
        corners = [[-3e4, -3e4, -z], [3e4, -3e4, -z], [0, 6e4, -z]]
        scene.add(rj.Mesh(corners, [[0, 1, 2]]))
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), near=near)
    frame = rj.render(scene, camera, size=(24, 16), outputs=("object_id", "depth"), threads=1)
    assert (frame.object_id == 1).all()
    assert (np.abs(frame.depth - 10000.0) <= 2 * np.spacing(np.float32(10000.0))).all()
