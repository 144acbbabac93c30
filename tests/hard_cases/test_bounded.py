"""
Depth and attributes keep within stated bounds of exact arithmetic, and inside their range.

A float32 output is the rounding of a float64 number. The bounds below are those of that number:
how many float64 operations, each off by at most 2**-53 of its result, lie between it and the exact
value. Beside the half ulp of the last rounding they are next to nothing.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
import screen

import rasterjit as rj

FACE = [[0, 1, 2]]
SIZE = (128, 128)

DEPTH_ROUNDINGS = 28
"""
Roundings of a depth, each at most 2**-53 of the face's depth range or of its largest depth.

Two products of a weight and a difference of depths, neither above the range, with 5 roundings each
(edge function, difference, area, quotient, product), added up in 2 more; for the step along a row
two products and their sum again, times the number of steps, added (13); the depth of the vertex in
the first place (1). That makes 26, not all of which can add up.
"""

WEIGHT_ROUNDINGS = 16
"""
Roundings of an attribute, each at most 2**-53 of its range or of its largest value.

A weight is an edge function times a ratio of w (3), a share of the sum of three of its kind, none
below zero (2 + 1): 9 with those of its own share. Its product with a difference of two values takes
2 more, and adding the two products to the first value 2.
"""


def depth_slack(depths):
    """Return how far from the plane through three depths float64 may end up."""
    exact = [Fraction(float(depth)) for depth in depths]
    return DEPTH_ROUNDINGS * screen.UNIT * (max(exact) - min(exact) + max(map(abs, exact)))


def attribute_slack(values):
    """Return how far from the exact attribute float64 may end up."""
    exact = [Fraction(float(value)) for value in values]
    return WEIGHT_ROUNDINGS * screen.UNIT * (max(exact) - min(exact) + max(map(abs, exact)))


def on_grid(points):
    """Round points to the grid, so that they reach the kernels exactly."""
    return np.round(np.asarray(points, float) * 256) / 256


def some(pixels):
    """Return about eight of some pixels, spread over all of them."""
    return pixels[:: max(1, len(pixels) // 8)]


def thin_triangle(rng):
    """Return a sliver of one grid unit of area or little more, often through pixel centres."""
    start = rng.integers(0, 128, 2) + 0.5
    direction = rng.integers(-9, 10, 2)
    end = start + direction * rng.integers(1, 14)
    return on_grid([start, end, (start + end) / 2 + rng.integers(-2, 3, 2) / 256])


def long_sliver(rng):
    """Return a sliver across the image and far beyond, along rows or at any angle."""
    angle = rng.choice([0.0, rng.uniform(0.0, math.pi)])
    reach = rng.uniform(100, 4000) * np.array([math.cos(angle), math.sin(angle)])
    middle = rng.uniform(20, 108, 2)
    return on_grid([middle - reach, middle + reach, middle + rng.uniform(-3, 3, 2)])


def round_triangle(rng):
    """Return a triangle without small angles, of any size."""
    angles = rng.uniform(0, 7) + np.arange(3) * 2.1 + rng.uniform(-0.5, 0.5, 3)
    reach = rng.choice([3.0, 8.0, 40.0, 400.0])
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1) * reach
    return on_grid(rng.uniform(10, 118, 2) + around)


def some_depths(rng, kind):
    """Return the depths of three vertices."""
    if kind == "any":
        return rng.uniform(-1, 1, 3)
    if kind == "nearly equal":
        return rng.uniform(-0.9, 0.9) + rng.integers(-3, 4, 3) * 2.0**-26
    if kind == "zero and one sign":
        return np.append(0.0, rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.9, 2))
    if kind == "tiny":
        return rng.choice([0.0, 1e-45, -1e-42, 1e-38], 3)
    return rng.permutation([-1.0, 1.0, rng.choice([-1.0, 1.0])])


DEPTHS = ("any", "nearly equal", "zero and one sign", "tiny", "as steep as can be")
SHAPES = (round_triangle, thin_triangle, long_sliver)


# --- depth ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", DEPTHS)
@pytest.mark.parametrize("shape", SHAPES)
def test_depth_is_the_rounding_of_the_exact_plane(shape, kind):
    # Slivers too: the steps of a row go no further than the face, so that even a slope of 10**6 a
    # pixel magnifies no rounding.
    rng = np.random.default_rng(21)
    checked = 0
    for _ in range(30):
        points, depths = shape(rng), some_depths(rng, kind)
        seen = screen.draw(points, FACE, SIZE, z=depths)
        corners, slack = screen.corners(points), depth_slack(depths)
        for column, row in some(screen.covered(seen)):
            exact = rj.oracle.depth_at(corners, depths, screen.centre(column, row))
            assert screen.is_rounded(seen.depth[row, column], exact, slack)
            checked += 1
    assert checked > 30


def test_depth_is_within_half_an_ulp_of_the_exact_plane():
    # The same in units of the output: 0.5 ulp of the largest depth, and 10**-7 more. (The worst
    # found here is 0.4999.)
    rng = np.random.default_rng(22)
    worst = Fraction(0)
    for _ in range(80):
        points, depths = round_triangle(rng), rng.uniform(0.5, 0.99, 3)
        seen = screen.draw(points, FACE, SIZE, z=depths)
        for column, row in some(screen.covered(seen)):
            exact = rj.oracle.depth_at(screen.corners(points), depths, screen.centre(column, row))
            worst = max(worst, abs(Fraction(float(seen.depth[row, column])) - exact))
    ulp = Fraction(float(np.spacing(np.float32(0.5))))
    assert Fraction(2, 5) * ulp < worst <= ulp / 2 + depth_slack([0.5, 0.99, 0.99])
    assert depth_slack([0.5, 0.99, 0.99]) < Fraction(1, 10**7) * ulp


def test_rounding_does_not_step_over_the_depth_of_a_vertex():
    # At a vertex on a pixel's centre with depth 0 the least rounding error has the wrong sign.
    rng = np.random.default_rng(28)
    owned = 0
    for _ in range(800):
        points = rng.integers(0, rng.choice([7, 60]), (3, 2)) + 0.5
        points = points[np.lexsort((points[:, 0], points[:, 1]))]  # the top vertex owns its centre
        depths = some_depths(rng, "zero and one sign")
        seen = screen.draw(points, FACE, SIZE, z=depths)
        drawn = seen.depth[seen.face_id == 0]
        assert (np.sign(depths[1]) * drawn >= 0.0).all()
        column, row = (points[0] - 0.5).astype(int)
        owned += seen.face_id[row, column] == 0
    assert owned > 50


def test_depth_of_a_sliver_across_many_blocks_is_that_of_its_plane():
    # Depth along a row starts anew every 64 columns, with no seam between.
    size, z = (1024, 4), [-1.0, 1.0, 1.0]
    for points in (
        [(0.5, 0.5), (1023.5, 2.5), (1023.5, 2.5078125)],
        [(-8000, 1.5), (8000, 1.49609375), (8000, 1.5078125)],
        [(0, 0), (1024, 0.25), (1024, 4)],
    ):
        seen = screen.draw(points, FACE, size, z=z)
        pixels = screen.covered(seen)
        assert len(pixels) == len(rj.oracle.covered_pixels(points, size)) > 0
        for column, row in pixels:
            point = screen.centre(column, row)
            exact = rj.oracle.depth_at(screen.corners(points), z, point)
            assert screen.is_rounded(seen.depth[row, column], exact, depth_slack(z))


def reaching_far(rng):
    """Return the clip positions of a face before the eye that reaches beyond the guard band."""
    w = rng.uniform(0.5, 4.0, 3)
    ndc = rng.uniform(-1, 1, (3, 2)) * 10.0 ** rng.uniform(0, 5, (3, 1))
    z = rng.uniform(-1, 1, 3) * w
    return np.column_stack([ndc * w[:, None], z, w])


def test_depth_of_a_clipped_face_stays_inside_its_range():
    rng = np.random.default_rng(24)
    drawn = 0
    for _ in range(200):
        positions = reaching_far(rng)
        seen = rj.rasterize(positions, FACE, (16, 16), threads=1)
        if not seen.totals.clipped:
            continue
        depths = positions[:, 2] / positions[:, 3]
        stored = seen.depth[seen.face_id == 0]
        assert (stored >= np.float32(depths.min())).all()
        assert (stored <= np.float32(depths.max())).all()
        drawn += len(stored) > 0
    assert drawn > 30


# --- attributes -----------------------------------------------------------------------------------


CUT_ROUNDINGS = 64
"""
Roundings of the depth of a piece: `DEPTH_ROUNDINGS`, and those of the vertices it was cut at.

A cut is ``a + t (b - a)`` in z and in w, 4 roundings each, of numbers up to C; the quotient has
their sum and its own. The depth of a sample is a mean of three such.
"""


def test_depth_of_a_clipped_face_is_that_of_its_snapped_pieces():
    rng = np.random.default_rng(25)
    size, compared = (16, 16), 0
    for _ in range(150):
        positions = reaching_far(rng)
        positions[:, 2] *= 1.5  # beyond near and far as well
        seen = rj.rasterize(positions, FACE, size, threads=1)
        if not seen.totals.clipped:
            continue
        exact = rj.oracle.render_faces(positions.tolist(), FACE, size)
        assert set(screen.covered(seen)) == set(exact)
        depths = positions[:, 2] / positions[:, 3]
        slack = CUT_ROUNDINGS * screen.UNIT * Fraction(np.ptp(depths) + np.abs(depths).max())
        for (column, row), (_, depth) in some(list(exact.items())):
            assert screen.is_rounded(seen.depth[row, column], depth, slack)
            compared += 1
    assert compared > 300


def test_cut_of_a_flat_face_has_the_depth_of_its_vertices():
    # 0.5 + 2**-25 lies halfway between two float32 numbers; a cut rounds z and w by themselves.
    depth = 0.5 + 2.0**-25
    rng = np.random.default_rng(2)
    cut = 0
    for _ in range(500):
        w = rng.uniform(1, 3, 3)
        xy = rng.uniform(-4000, 4000, (3, 2))
        seen = rj.rasterize(np.column_stack([xy, depth * w, w]), FACE, (16, 16), threads=1)
        covered = seen.face_id == 0
        assert (seen.depth[covered] == np.float32(depth)).all()
        cut += int(covered.any()) * seen.totals.clipped
    assert cut > 25


TINY = np.float32(1e-45)
HUGE = np.finfo(np.float32).max
VALUES = {
    "mixed": lambda rng: rng.normal(size=(3, 2)),
    "huge": lambda rng: rng.choice([-HUGE, HUGE, 1.0, 0.0], (3, 2)),
    "denormal": lambda rng: rng.choice([-TINY, TINY, 3 * TINY, 0.0, 1e-40], (3, 2)),
    "nearly equal": lambda rng: 1.0 + rng.integers(0, 3, (3, 2)) * 2.0**-23,
}


def unclipped_vertices(rng):
    """Return model vertices, their places on the screen, and w of extreme ratios."""
    points = SHAPES[rng.integers(3)](rng)
    return points, 2.0 ** rng.integers(-30, 31, 3)


def clipped_vertices(rng):
    """Return three vertices before `screen.camera` of which one or two lie behind the eye."""
    behind = rng.integers(1, 3)
    w = rng.permutation(np.append(-rng.uniform(0, 4, behind), rng.uniform(0.1, 4, 3 - behind)))
    w *= 10.0 ** rng.uniform(-6, 6)
    return np.column_stack([rng.normal(size=(3, 2)) * np.abs(w).max(), -w])


def check_range(frame, values, output):
    """Hold an output inside the range that it has at the vertices; return the pixels checked."""
    drawn = getattr(frame, output)[frame.face_id == 0]
    values = np.asarray(values, np.float32)
    assert (drawn[:, : values.shape[1]] >= values.min(axis=0)).all()
    assert (drawn[:, : values.shape[1]] <= values.max(axis=0)).all()
    return len(drawn)


OUTPUTS = ("uv", "linear", "barycentric", "position", "face_id")


@pytest.mark.parametrize("is_clipped", [False, True])
@pytest.mark.parametrize("kind", VALUES)
def test_attributes_never_leave_the_range_of_the_vertices(kind, is_clipped):
    rng = np.random.default_rng(31)
    checked = 0
    for _ in range(50):
        uv, colors = VALUES[kind](rng), rng.choice([0.0, 1.0, 1e-40, 0.3, rng.uniform()], (3, 3))
        if is_clipped:
            vertices = clipped_vertices(rng)
            near = 1e-3 * np.abs(vertices[:, 2]).max()
            material = rj.Material(shading="unlit", base_color="white")
            mesh = rj.Mesh(vertices, FACE, uv=uv, colors=colors, material=material)
        else:
            points, w = unclipped_vertices(rng)
            mesh, near = screen.mesh(points, FACE, SIZE, w, uv=uv, colors=colors), w.min()
        frame = rj.render(mesh, screen.camera(near), size=SIZE, outputs=OUTPUTS, threads=1)
        assert frame.stats.clipped == is_clipped or not (frame.face_id == 0).any()
        checked += check_range(frame, uv, "uv")
        check_range(frame, colors, "linear")
        check_range(frame, mesh.vertices, "position")
        check_range(frame, np.eye(3), "barycentric")
    assert checked > 500


@pytest.mark.parametrize("distance", [1.0, 1e3, 1e6])
def test_positions_seen_from_afar_stay_inside_the_range_of_the_vertices(distance):
    # Sums with the eye's place cancel: float64 keeps them well within a float32 ulp of the mesh.
    rng = np.random.default_rng(32)
    checked = 0
    for _ in range(40):
        vertices = rng.normal(size=(3, 3))
        eye = distance * rj.transforms.unit_vector("eye", rng.normal(size=3))
        camera = rj.PerspectiveCamera(eye, vertices.mean(axis=0), near=0.01 * distance, fov_y=1e-4)
        if distance == 1.0:
            camera = rj.PerspectiveCamera(eye, vertices.mean(axis=0), near=0.01)
        frame = rj.render(
            rj.Mesh(vertices, FACE), camera, size=(24, 24), outputs=("position", "face_id"),
            threads=1,
        )  # fmt: skip
        checked += check_range(frame, vertices, "position")
    assert checked > 1000


def test_positions_that_are_tiny_beside_the_eye_stay_inside_the_range_of_the_vertices():
    camera = rj.PerspectiveCamera((3.3, 0, 0), (0, 0, -5))
    mesh = rj.Mesh([(1e-12, -1, -4), (1e-12, 1, -4), (1e-12, 0, -6)], FACE)
    frame = rj.render(mesh, camera, size=SIZE, outputs=("position", "face_id"), threads=1)
    covered = frame.face_id == 0
    assert covered.sum() > 100
    assert (frame.position[covered][:, 0] == np.float32(1e-12)).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_attributes_are_the_rounding_of_exact_ones(shape):
    rng = np.random.default_rng(33)
    checked = 0
    for _ in range(60):
        points, w = shape(rng), 2.0 ** rng.integers(-10, 11, 3)
        uv = rng.normal(size=(3, 2)).astype(np.float32)
        frame = rj.render(
            screen.mesh(points, FACE, SIZE, w, uv=uv), screen.camera(w.min()), size=SIZE,
            outputs=("uv", "face_id"), threads=1,
        )  # fmt: skip
        for column, row in some(screen.covered(frame)):
            exact = rj.oracle.perspective_weights(
                screen.corners(points), w, screen.centre(column, row)
            )
            for k in range(2):
                value = rj.oracle.interpolate(exact, uv[:, k])
                slack = attribute_slack(uv[:, k])
                assert screen.is_rounded(frame.uv[row, column, k], value, slack)
            checked += 1
    assert checked > 30


# --- grazing angles -------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [2.0**10, 2.0**20])
def test_ground_to_the_horizon_has_the_uv_of_exact_arithmetic(ratio):
    # A strip from w = 1 at the bottom of the image to the ratio at its middle, not clipped.
    size = (64, 64)
    points, w = [(0, 64), (64, 64), (64, 32), (0, 32)], np.array([1.0, 1.0, ratio, ratio])
    uv = [(0, 0), (1, 0), (1, 1), (0, 1)]
    frame = rj.render(
        screen.mesh(points, [[0, 1, 2], [0, 2, 3]], size, w, uv=uv), screen.camera(1.0), size=size,
        outputs=("uv", "depth", "face_id"), threads=1,
    )  # fmt: skip
    assert frame.stats.clipped == 0
    pixels = screen.covered(frame)
    assert len(pixels) == 64 * 32
    for column, row in pixels:
        numbers = ([0, 1, 2], [0, 2, 3])[frame.face_id[row, column]]
        exact = rj.oracle.perspective_weights(
            [points[k] for k in numbers], w[numbers], screen.centre(column, row)
        )
        for k in range(2):
            value = rj.oracle.interpolate(exact, [uv[n][k] for n in numbers])
            slack = attribute_slack((0.0, 1.0))
            assert screen.is_rounded(frame.uv[row, column, k], value, slack)
        # Depth is float32 of near / w, whose largest is 1, turned into w: two roundings.
        distance = rj.oracle.interpolate(exact, w[numbers])
        stored = depth_slack((1 / ratio, 1.0)) * distance
        rounded = 2 * Fraction(1, 2**24) + stored
        assert abs(Fraction(float(frame.depth[row, column])) - distance) <= rounded * distance


CLIPPED_ROUNDINGS = 256
"""
Roundings of the weights of a clipped face, each 2**-53 of the product of two clip coordinates.

``x - X w`` of two numbers up to C is off by 4 roundings of C, and no larger than 2 C. A product of
two such is off by 20 of C**2, a weight, the difference of two products, by 48, and its share of
their sum by as much again for each of three, over that sum: 192 in all, and few more to
interpolate.
"""


def test_ground_beyond_the_eye_has_the_uv_of_exact_arithmetic():
    # The plane y = -1 from behind the eye to a million times its height, cut at the near plane.
    size, far = (64, 64), 1e6
    vertices = np.array([(-far, -1, far), (far, -1, far), (far, -1, -far), (-far, -1, -far)])
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    faces = [[0, 1, 2], [0, 2, 3]]
    frame = rj.render(
        rj.Mesh(vertices, faces, uv=uv), screen.camera(2.0**-10), size=size,
        outputs=("uv", "face_id"), threads=1,
    )  # fmt: skip
    assert frame.stats.clipped == 2
    pixels = screen.covered(frame)
    assert len(pixels) == 64 * 32
    clip = [(x, y, -z, -z) for x, y, z in vertices.tolist()]
    worst = Fraction(0)
    for column, row in pixels[::7]:
        numbers = faces[frame.face_id[row, column]]
        corners = [clip[k] for k in numbers]
        weights = rj.oracle.clip_weights(corners, screen.centre(column, row), size)
        # The sum that the weights are shares of, for the pixel's place (X, Y).
        x, y = Fraction(2 * column + 1, 64) - 1, 1 - Fraction(2 * row + 1, 64)
        u = [Fraction(p[0]) - x * Fraction(p[3]) for p in corners]
        v = [Fraction(p[1]) - y * Fraction(p[3]) for p in corners]
        total = abs(sum(u[k - 2] * v[k - 1] - u[k - 1] * v[k - 2] for k in range(3)))
        slack = CLIPPED_ROUNDINGS * screen.UNIT * Fraction(far) ** 2 / total
        worst = max(worst, slack)
        for k in range(2):
            value = rj.oracle.interpolate(weights, uv[numbers, k].tolist())
            assert screen.is_rounded(frame.uv[row, column, k], value, slack)
    # At the horizon that is still a hundred thousandth of the whole plane's uv.
    assert worst < 1e-5


# --- planes far away ------------------------------------------------------------------------------

NEAR, FAR = Fraction(1, 10), Fraction(10**5)
AWAY, APART = 10**4, Fraction(1, 100)


def d24(distance):
    """Return the standard 24-bit depth of a distance: 0 at the near plane, 2**24 - 1 at the far."""
    depth = FAR * (distance - NEAR) / (distance * (FAR - NEAR))
    return math.floor(depth * (2**24 - 1) + Fraction(1, 2))


def test_steps_of_depth_ten_kilometres_away():
    stored = np.float32(float(NEAR / AWAY))
    step = Fraction(float(np.spacing(stored))) * AWAY**2 / NEAR
    assert round(float(step), 5) == 0.00091
    slope = FAR * NEAR / (FAR - NEAR) / Fraction(AWAY) ** 2
    assert round(float(1 / slope / (2**24 - 1)), 1) == 59.6
    # The engine: a millimetre is a step of its depth, a fifth of one is none.
    for further, is_another in ((Fraction(1, 1000), True), (Fraction(1, 5000), False)):
        z = [float(NEAR / (AWAY + further)), float(NEAR / AWAY)]
        positions = [[x, y, d, 1] for d in z for x, y in ((-1, -1), (3, -1), (-1, 3))]
        seen = rj.rasterize(positions, [[0, 1, 2], [3, 4, 5]], (2, 2), depth="reversed", threads=1)
        assert (seen.face_id == int(is_another)).all()


def plane(tilt, offset):
    """
    Return a square of four kilometres, tilted (degrees), about ten kilometres before the eye.

    Offset along its normal it moves sideways on the screen by less than the sub-pixel grid can
    tell, and away from the eye by cos(tilt) of the offset. That is all that is left of it once its
    vertices are snapped, and for a centimetre it is one step of float32, 2**-23 of the distance,
    up to 83 degrees.
    """
    corners = np.array([(-2e3, -2e3, 0), (2e3, -2e3, 0), (2e3, 2e3, 0), (-2e3, 2e3, 0)])
    turn = rj.transforms.rotate_y(tilt)[:3, :3]
    return rj.Mesh(corners @ turn.T - [0, 0, AWAY] - offset * turn[:, 2], [[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("tilt", [0.0, 30.0, 60.0, 80.0])
def test_reversed_depth_orders_planes_that_24_bits_do_not(tilt):
    size = (64, 64)
    camera = rj.PerspectiveCamera(
        (0, 0, 0), (0, 0, -1), fov_y=20.0, near=float(NEAR), far=float(FAR)
    )
    meshes = [plane(tilt, 0.0), plane(tilt, float(APART))]
    alone = [
        rj.render(mesh, camera, size=size, outputs=("face_id",), threads=1).face_id >= 0
        for mesh in meshes
    ]
    both = alone[0] & alone[1]
    assert both.sum() > 200
    # The engine shows the nearer plane at every pixel, whichever was added first.
    for order in ((0, 1), (1, 0)):
        scene = rj.Scene()
        for n in order:
            scene.add(meshes[n])
        frame = rj.render(scene, camera, size=size, outputs=("object_id", "depth"), threads=1)
        assert (frame.object_id[both] == order.index(0)).all()
    # A 24-bit depth ties nearly everywhere: then whichever was added first is seen.
    tangent = math.tan(math.radians(10.0))
    turn = rj.transforms.rotate_y(tilt)[:3, 2]
    ties = 0
    for row, column in np.argwhere(both).tolist():
        ray = (
            Fraction((2 * column + 1 - 64) / 64 * tangent),
            Fraction((64 - 2 * row - 1) / 64 * tangent),
        )
        facing = Fraction(turn[0]) * ray[0] + Fraction(turn[1]) * ray[1] - Fraction(turn[2])
        through = -Fraction(turn[2]) * AWAY
        near, far = through / facing, (through - APART) / facing
        assert near < far
        ties += d24(near) == d24(far)
    assert ties == both.sum() if tilt == 0.0 else ties > 0.99 * both.sum()
