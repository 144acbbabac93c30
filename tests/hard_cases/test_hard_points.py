"""Hard cases O01 to O16: squares, discs and spheres."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.rendering.regions import RegionRenderer

SIDE = 32
SIZE = SIDE, SIDE
UNLIT = rj.Material("unlit")
FACES = [[0, 1, 2], [0, 2, 3]]


def flat_camera(side=SIDE, near=0.0, far=100.0):
    """Return a camera that shows world x and y as pixels, y up, and z from -near to -far."""
    clip = np.diag([2.0 / side, 2.0 / side, -2.0 / (far - near), 1.0])
    clip[0, 3] = clip[1, 3] = -1.0
    clip[2, 3] = -(far + near) / (far - near)
    return rj.MatrixCamera(np.eye(4), clip)


def deep_camera(near=1.0, far=math.inf):
    """Return a camera at the origin whose picture is the square |x|, |y| <= -z."""
    return rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), (0, 1, 0), 90.0, near, far)


def at(places, depth=50.0):
    """Return positions that the flat camera shows at places in pixels, y down."""
    places = np.atleast_2d(np.array(places, float))
    if places.shape[1] == 2:
        places = np.column_stack([places, np.full(len(places), depth)])
    return places * (1.0, -1.0, -1.0) + (0.0, SIDE, 0.0)


def draw(what, camera=None, outputs="face_id", size=SIZE, **options):
    """Render one output, or several."""
    frame = rj.render(
        what, camera or flat_camera(), size=size, outputs=outputs, threads=1, **options
    )
    return getattr(frame, outputs) if isinstance(outputs, str) else frame


def pixels(face_id, face=0):
    """Return the pixels (column, row) that show a face."""
    rows, columns = np.nonzero(face_id == face)
    return set(zip(columns.tolist(), rows.tolist(), strict=True))


def in_world(**options):
    """Return what makes points as large as world units say, unlit."""
    return {"unit": "world", "material": UNLIT, **options}


@pytest.mark.case("O01")
@pytest.mark.parametrize(
    ("place", "pixel"),
    [
        ((7.5, 9.5), (7, 9)), ((8.0, 9.5), (7, 9)), ((8.0, 10.0), (7, 9)),
        ((8.0 + 1 / 256, 10.0 + 1 / 256), (8, 10)), ((8.0 - 1 / 256, 10.0), (7, 9)),
    ],
)  # fmt: skip
def test_a_point_of_one_pixel_covers_one_by_the_top_left_rule(place, pixel):
    assert pixels(draw(rj.Points(at(place), size=1.0))) == {pixel}
    # The same as two triangles of that square.
    x, y = place
    corners = [(x - 0.5, y - 0.5), (x - 0.5, y + 0.5), (x + 0.5, y + 0.5), (x + 0.5, y - 0.5)]
    square = rj.Mesh(at(corners), FACES, material=UNLIT)
    assert pixels(np.minimum(draw(square), 0)) == {pixel}


@pytest.mark.case("O02")
@pytest.mark.parametrize("size", [1.0, 2.0, 3.5, 5 / 256 + 1.0, 7.0])
@pytest.mark.parametrize("offset", [0.0, 0.5, 1 / 256, 0.3125])
def test_squares_side_by_side_cover_each_pixel_once(size, offset):
    count = math.ceil((SIDE + 8) / size)
    rows, columns = np.divmod(np.arange(count * count), count)
    places = np.stack([columns, rows], axis=1) * size + offset - 4.0
    drawn = draw(rj.Points(at(places), size=size))
    assert (drawn >= 0).all()
    alone = [draw(rj.Points(at(place), size=size)) >= 0 for place in places[:: count + 2]]
    for n, one in zip(range(0, len(places), count + 2), alone, strict=True):
        # Nothing of a square is lost to its neighbours, so that no two share a pixel.
        assert pixels(drawn, n) == pixels(one, 1)


@pytest.mark.case("O03")
def test_a_disc_holds_the_centres_on_its_rim():
    # Points of a lattice in circles of radius 5 and 13, which pass through some.
    for radius, count in ((1, 5), (5, 81), (13, 529)):
        drawn = draw(rj.Points(at((15.5, 15.5)), size=2.0 * radius, shape="disc"))
        assert (drawn == 0).sum() == count
        less = draw(rj.Points(at((15.5, 15.5)), size=2.0 * radius - 1 / 128, shape="disc"))
        rim = sum(
            x * x + y * y == radius * radius
            for x in range(-radius, radius + 1)
            for y in range(-radius, radius + 1)
        )
        assert (less == 0).sum() == count - rim


@pytest.mark.case("O04")
@pytest.mark.parametrize("size", [1.0, 1.25, 1.41])
def test_a_disc_between_four_centres_covers_one_pixel(size):
    assert pixels(draw(rj.Points(at((8.0, 10.0)), size=size, shape="disc"))) == {(7, 9)}
    assert len(pixels(draw(rj.Points(at((8.0, 10.0)), size=1.42, shape="disc")))) == 4
    assert not pixels(draw(rj.Points(at((8.0, 10.0)), size=0.99, shape="disc")))


@pytest.mark.case("O05")
@pytest.mark.parametrize("shape", ["square", "disc"])
@pytest.mark.parametrize("is_first", [True, False])
def test_a_tie_with_a_face_goes_to_the_lower_number(shape, is_first):
    wall = rj.Mesh(
        at([(0, 0, 50), (0, SIDE, 50), (SIDE, SIDE, 50), (SIDE, 0, 50)]), FACES, material=UNLIT
    )
    point = rj.Points(at((9.5, 9.5)), size=3.0, shape=shape)
    scene = rj.Scene()
    for mesh in (point, wall) if is_first else (wall, point):
        scene.add(mesh)
    drawn = draw(scene, outputs="object_id")
    assert drawn[9, 9] == 0
    # Nearer or farther by the least step of depth it is one or the other.
    for step, shown in ((-1, "point"), (1, "wall")):
        depth = float(np.nextafter(np.float32(0.5), np.float32(step > 0))) * 100.0
        scene.nodes[0 if is_first else 1].mesh = rj.Points(
            at((9.5, 9.5, depth)), size=3.0, shape=shape
        )
        number = (0 if is_first else 1) if shown == "point" else (1 if is_first else 0)
        assert draw(scene, outputs="object_id", quality=rj.Quality(depth_format="float64"))[
            9, 9
        ] == number  # fmt: skip


@pytest.mark.case("O06")
def test_points_at_one_place_show_the_lower_number_whatever_their_size():
    sizes = [3.0, 9.0, 5.0, 9.0]
    drawn = draw(rj.Points(at([(10.5, 10.5)] * 4), size=sizes))
    assert [(drawn == n).sum() for n in range(4)] == [9, 81 - 9, 0, 0]


@pytest.mark.case("O07")
@pytest.mark.parametrize("shape", ["square", "disc", "sphere"])
def test_points_that_are_not_finite_are_left_out_and_counted(shape):
    places = at([(5.5, 5.5), (0, 0), (9.5, 5.5), (0, 0), (13.5, 5.5)])
    places[1], places[3] = np.nan, (np.inf, 0, 0)
    options = in_world(shape=shape, size=3.0)
    with pytest.raises(ValueError, match="positions must be finite, got 2 of 5"):
        rj.Points(places, **options)
    frame = draw(rj.Points(places, on_invalid="drop", **options), outputs=("face_id",))
    kept = draw(rj.Points(places[[0, 2, 4]], **options))
    numbers = np.array([0, 2, 4, -1])
    np.testing.assert_array_equal(frame.face_id, numbers[kept])
    assert (frame.stats.invalid, frame.stats.drawn) == (2, 3)


@pytest.mark.case("O08")
def test_the_near_plane_cuts_points_at_their_centre_and_spheres_where_it_is():
    camera = deep_camera(near=1.0)
    for shape in ("square", "disc"):
        on = rj.Points([(0, 0, -1.0)], size=5.0, shape=shape)
        before = rj.Points([(0, 0, -np.nextafter(1.0, 0.0))], size=5.0, shape=shape)
        assert (draw(on, camera) >= 0).any()
        assert not (draw(before, camera) >= 0).any()
    # A ball of radius 1 at the plane: of the half in front of it the inside is seen.
    ball = rj.Points([(0, 0, -1.0)], size=2.0, **in_world(shape="sphere"))
    seen = draw(ball, camera, ("depth", "normal"))
    assert (seen.depth[np.isfinite(seen.depth)] >= 1.0).all()
    middle = seen.depth[SIDE // 2, SIDE // 2]
    way = 1.0 / math.sqrt(1.0 + 2.0 / SIDE**2)
    # Through the eye at distance 1 from the centre: a chord of 2 cos.
    assert middle == pytest.approx(2.0 * way * way, rel=1e-6)
    assert seen.normal[SIDE // 2, SIDE // 2, 2] > 0.99


@pytest.mark.case("O09")
def test_a_sphere_around_the_eye_shows_its_inside_everywhere():
    ball = rj.Points([(0, 0, 0.0)], size=20.0, **in_world(shape="sphere"))
    for target in ((0, 0, -1), (1, 0, 0), (0.3, -0.5, 0.8)):
        camera = rj.PerspectiveCamera((0, 0, 0), target, (0, 1, 0.1), 90.0, 0.5, 100.0)
        seen = draw(ball, camera, ("face_id", "distance", "normal", "position"))
        assert (seen.face_id == 0).all()
        np.testing.assert_allclose(seen.distance, 10.0, rtol=2e-7)
        np.testing.assert_allclose(seen.normal, -seen.position / 10.0, atol=1e-6)


@pytest.mark.case("O10")
@pytest.mark.parametrize(
    ("centre", "radius"), [((3, 2, -4), 1), ((-5, 4, -6), 2), ((0, 0, -3), 2), ((7, 7, -9), 3)]
)
def test_the_rim_of_a_sphere_in_perspective_is_exact(centre, radius):
    drawn = draw(
        rj.Points([centre], size=2.0 * radius, **in_world(shape="sphere")), deep_camera(0.125)
    )
    inside = outside = 0
    for row in range(SIDE):
        for column in range(SIDE):
            # The line of sight, and four times the discriminant of where it meets the sphere.
            way = Fraction(2 * column + 1, SIDE) - 1, 1 - Fraction(2 * row + 1, SIDE), Fraction(-1)
            along = sum(a * b for a, b in zip(way, centre, strict=True))
            square = sum(a * a for a in way)
            left = along**2 - square * (sum(c * c for c in centre) - radius**2)
            if abs(left) < Fraction(1, 10**12):
                continue
            assert (drawn[row, column] == 0) == (left > 0)
            inside, outside = inside + (left > 0), outside + (left < 0)
    assert inside > 10
    assert outside > 10


@pytest.mark.case("O11")
@pytest.mark.parametrize("shape", ["square", "disc"])
def test_huge_points_and_those_beside_the_picture_cover_what_they_reach(shape):
    whole = draw(rj.Points(at((16.0, 16.0)), size=4096.0, shape=shape))
    assert (whole == 0).all()
    # From 1000 pixels beside it, through the guard band, to the middle column.
    part = draw(rj.Points(at((-1000.0, 16.0)), size=2032.5, shape=shape))
    rows, columns = np.nonzero(part == 0)
    assert columns.max() == 15
    assert (part[15] == 0).sum() == 16
    assert rows.min() <= 15
    world = draw(rj.Points(at((-9000.0, 16.0)), size=18032.5, **in_world(shape=shape)))
    assert not (world == 0).any()


@pytest.mark.case("O12")
@pytest.mark.parametrize("shape", ["square", "disc", "sphere"])
def test_specks_are_seen_where_they_hold_a_centre(shape):
    options = in_world(shape=shape, size=0.25)
    assert pixels(draw(rj.Points(at((8.5, 10.5)), **options))) == {(8, 10)}
    assert not pixels(draw(rj.Points(at((8.0, 10.0)), **options)))
    shown = draw(rj.Points(at((8.0, 10.0)), **options), outputs=("face_id",))
    assert (shown.stats.unsampled, shown.stats.drawn) == (1, 0)
    # In the cell of 1/256 of a pixel of the smallest size nothing is.
    assert not pixels(draw(rj.Points(at((8.5, 10.5)), **in_world(shape="disc", size=1e-9))))


@pytest.mark.case("O13")
@pytest.mark.parametrize("shape", ["square", "disc", "sphere"])
def test_parts_and_threads_change_no_bit(shape):
    rng = np.random.default_rng(4)
    size = 150, 130
    places = rng.uniform((-3, -3, -9), (3, 3, 1), (400, 3))
    points = rj.Points(
        places, colors=rng.random((400, 3)), size=rng.uniform(0.1, 1.5, 400), unit="world",
        shape=shape, material=None if shape == "sphere" else UNLIT,
    )  # fmt: skip
    scene = rj.Scene()
    scene.add(points)
    scene.add(rj.Mesh([(-4, -4, -6), (4, -4, -6), (0, 4, -5)], [[0, 1, 2]], material=UNLIT))
    outputs = ("color", "depth", "face_id", "normal", "position")
    whole = draw(scene, deep_camera(), outputs, size)
    many = rj.render(scene, deep_camera(), size=size, outputs=outputs, threads=3)
    for name in outputs:
        np.testing.assert_array_equal(getattr(many, name), getattr(whole, name))
    with RegionRenderer(scene, deep_camera(), size=size, outputs=outputs, threads=2) as parts:
        for region in ((0, 0, 64, 64), (64, 0, 86, 64), (0, 64, 150, 66), (64, 64, 3, 2)):
            left, top, width, height = region
            part = parts.render_region(region)
            for name in outputs:
                expected = getattr(whole, name)[top : top + height, left : left + width]
                np.testing.assert_array_equal(getattr(part, name), expected)


@pytest.mark.case("O14")
def test_far_from_the_origin_points_are_where_they_are_near_it():
    rng = np.random.default_rng(6)
    # Multiples of 1/1024, which stay exact far away.
    places = np.round(rng.uniform(-2, 2, (200, 3)) * 1024) / 1024
    far = np.array([2.0**30, -(2.0**31), 2.0**29])
    for shape in ("square", "disc", "sphere"):
        options = in_world(shape=shape, size=0.25)
        frames = [
            draw(
                rj.Points(places + moved, **options),
                rj.PerspectiveCamera(moved + (1, 2, 5), moved, (0, 1, 0), 60.0, 0.5, 50.0),
                ("face_id", "depth"),
            )
            for moved in (np.zeros(3), far)
        ]
        np.testing.assert_array_equal(frames[0].face_id, frames[1].face_id)
        np.testing.assert_array_equal(frames[0].depth, frames[1].depth)


@pytest.mark.case("O15")
def test_a_sphere_stays_one_under_any_transform():
    ball = rj.Points([(0, 0, 0)], size=2.0, **in_world(shape="sphere"))
    plain = rj.Points([(16, 16, -50)], size=12.0, **in_world(shape="sphere"))
    outputs = ("face_id", "depth", "normal", "position", "object_position")
    expected = draw(plain, outputs=outputs)
    for matrix in (
        np.diag([6.0, 6, 6, 1]), np.diag([-6.0, 6, 6, 1]), np.diag([6.0, 2, 3, 1]),
        np.diag([1.0, -6, 0.5, 1]),
    ):  # fmt: skip
        matrix[:3, 3] = 16, 16, -50
        scene = rj.Scene()
        scene.add(ball, transform=matrix)
        seen = draw(scene, outputs=outputs)
        for name in outputs[:4]:
            np.testing.assert_array_equal(getattr(seen, name), getattr(expected, name))
        # What the transform takes to the position that is seen.
        own = seen.object_position @ matrix[:3, :3].T + matrix[:3, 3]
        np.testing.assert_allclose(own, seen.position, atol=1e-5)


@pytest.mark.case("O16")
@pytest.mark.parametrize("samples", [4, 16, "area"])
def test_squares_in_several_samples_cover_their_exact_share(samples):
    quality = rj.Quality(samples=samples)
    square = rj.Points(at((8.125, 10.25)), size=4.5)
    shares = draw(square, outputs="coverage", quality=quality)
    columns = np.clip(np.minimum(np.arange(SIDE) + 1, 10.375) - np.maximum(np.arange(SIDE), 5.875),
                      0, 1)  # fmt: skip
    rows = np.clip(np.minimum(np.arange(SIDE) + 1, 12.5) - np.maximum(np.arange(SIDE), 8.0), 0, 1)
    exact = rows[:, None] * columns
    if samples == "area":
        np.testing.assert_array_equal(shares, exact.astype(np.float32))
    else:
        assert np.abs(shares - exact).max() <= 0.25
        assert (shares[exact == 1.0] == 1.0).all()
        assert (shares[exact == 0.0] == 0.0).all()
    # The face at centres, and its depth, are those of one sample.
    for name in ("face_id", "depth"):
        alone = draw(square, outputs=name)
        np.testing.assert_array_equal(draw(square, outputs=name, quality=quality), alone)
