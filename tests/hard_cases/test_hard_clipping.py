"""Hard cases C01 to C24: clipping and cameras."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import catalogue
import naive
import numpy as np
import pytest
from clipped import clip_all

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.scene.camera import MatrixCamera, OrthographicCamera, PerspectiveCamera

tf = rj.transforms
SIZE = (64, 64)

STEP = 1.0 / 256.0
"""Sub-pixel step, pixels. Snapping moves an edge by less: half a step in x and in y, 0.71 steps."""

ULP32 = 2.0**-23
"""Relative distance of neighbouring float32 numbers, at most."""

NAN, INF = math.nan, math.inf


# --- what the cases share -------------------------------------------------------------------------


def from_d3d(positions):
    """Turn clip depth 0..w into clip depth -w..w."""
    positions = np.array(positions, float)
    positions[:, 2] = 2.0 * positions[:, 2] - positions[:, 3]
    return positions


def seen_by(points, near, far, aspect=1.0):
    """Return the clip positions of view-space points; the field of view is 90 degrees."""
    return tf.transform_points(tf.perspective(90.0, aspect, near, far), points)


def seen_exactly(points, near, far):
    """Return the same in fractions, for an aspect of 1."""
    near, far = Fraction(near), Fraction(far)
    scale, offset = -(far + near) / (far - near), -2 * far * near / (far - near)
    return [(Fraction(x), Fraction(y), scale * z + offset, -Fraction(z)) for x, y, z in points]


def hits(positions, faces=((0, 1, 2),), size=SIZE):
    """Return how often the faces, each drawn alone, hit each pixel; (H, W) int."""
    total = np.zeros((size[1], size[0]), int)
    for face in faces:
        total += rj.rasterize(positions, [face], size, threads=1).face_id == 0
    return total


def spans(drawn):
    """Return {row: (first column, last column)} of the rows that are hit, without gaps."""
    found = {}
    for row in np.nonzero(drawn.any(axis=1))[0].tolist():
        columns = np.nonzero(drawn[row])[0].tolist()
        assert columns == list(range(columns[0], columns[-1] + 1))
        found[row] = columns[0], columns[-1]
    return found


def ndc(polygon, depth_range="gl"):
    """Return the vertices of a clipped polygon after the divide: exact (x, y, z)."""
    points = {(x / w, y / w, z / w) for x, y, z, w in polygon}
    return points if depth_range == "gl" else {(x, y, (z + 1) / 2) for x, y, z in points}


def inside_and_distance(polygon, size=SIZE):
    """
    Return where pixel centres are inside an exact polygon, and their distance to its outline.

    In float64: only to be trusted where the distance is far above its rounding.
    """
    corners = np.array([oracle.screen_position(v, size) for v in polygon], float)
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    turns, distance = [], np.full(x.shape, INF)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        dx, dy = bx - ax, by - ay
        turns.append(dx * (y - ay) - dy * (x - ax))
        along = ((x - ax) * dx + (y - ay) * dy) / max(dx * dx + dy * dy, 1e-300)
        t = np.clip(along, 0.0, 1.0)
        distance = np.minimum(distance, np.hypot(x - ax - t * dx, y - ay - t * dy))
    inside = np.all(np.array(turns) >= 0, axis=0) | np.all(np.array(turns) <= 0, axis=0)
    return inside, distance


def assert_sure(positions, count, margin, size=SIZE, exact=None):
    """
    Assert that a face covers ``count`` pixels, those whose centre exact clipping leaves inside.

    The outline must stay at least ``margin`` pixels, more than a sub-pixel step, off every centre,
    so that no rounding of vertices can change a pixel.
    """
    polygon = oracle.clip_polygon(positions if exact is None else exact)
    inside, distance = inside_and_distance(polygon, size)
    assert distance.min() > max(STEP, margin)
    drawn = hits(positions, size=size)
    assert (drawn == inside).all()
    assert drawn.sum() == count
    assert_as_oracle(positions, [[0, 1, 2]], size)
    return drawn


def assert_as_oracle(positions, faces, size=SIZE):
    """Assert that the engine shows the faces that exact arithmetic shows; return their number."""
    want = np.full((size[1], size[0]), -1)
    for (column, row), (face, _) in oracle.render_faces(positions, faces, size).items():
        want[row, column] = face
    seen = rj.rasterize(positions, faces, size, threads=1)
    assert (seen.face_id == want).all()
    assert not np.isnan(seen.depth).any()
    return int((want >= 0).sum())


# --- what is left of a face -----------------------------------------------------------------------


@pytest.mark.case("C01")
def test_vertex_at_infinity_leaves_a_square():
    positions = from_d3d([[0, 0, 0.5, 1], [1, 0, 0, 0], [0, 1, 0.5, 1]])
    # Its two outlines at infinity meet the sides of the view volume: NDC [0, 1]^2.
    polygon = oracle.clip_polygon(positions)
    assert {(x, y) for x, y, _ in ndc(polygon)} == {(0, 0), (1, 0), (1, 1), (0, 1)}
    drawn = assert_sure(positions, 1024, margin=0.49)
    assert (drawn[:32, 32:] == 1).all()


@pytest.mark.case("C02")
def test_vertex_behind_the_eye_leaves_a_trapezoid():
    positions = from_d3d([[-0.5, 0, 0.5, 1], [0.5, 0, 0.5, 1], [0, -1, -0.5, -1]])
    half = Fraction(1, 2)
    polygon = oracle.clip_polygon(positions)
    assert {(x, y) for x, y, _ in ndc(polygon)} == {(-half, 0), (half, 0), (1, -1), (-1, -1)}
    drawn = assert_sure(positions, 1536, margin=0.22)
    assert spans(drawn)[32] == (16, 47)
    assert spans(drawn)[63] == (0, 63)
    assert min(spans(drawn)) == 32  # a naive divide draws above row 32


@pytest.mark.case("C03")
def test_vertex_behind_the_near_plane_leaves_a_quad():
    points = [(-1, -1, -3), (1, -1, -3), (0, -1, 1)]
    exact = seen_exactly(points, 1, 10)
    third, half, deep = Fraction(1, 3), Fraction(1, 2), Fraction(20, 27)
    assert ndc(oracle.clip_polygon(exact), "d3d") == {
        (-third, -third, deep), (third, -third, deep), (half, -1, 0), (-half, -1, 0)
    }  # fmt: skip
    drawn = assert_sure(seen_by(points, 1.0, 10.0), 562, margin=STEP, exact=exact)
    assert list(spans(drawn)) == list(range(43, 64))
    assert spans(drawn)[43] == (21, 42)
    assert spans(drawn)[63] == (16, 47)


@pytest.mark.case("C04")
def test_near_plane_and_sides_leave_a_hexagon():
    points = [(-3, -1, -4), (3, -1, -4), (0, -1, 4)]
    exact = seen_exactly(points, 1, 10)
    x, upper, lower = Fraction(3, 4), Fraction(-1, 4), Fraction(-5, 12)
    assert {(x, y) for x, y, _ in ndc(oracle.clip_polygon(exact))} == {
        (-x, upper), (x, upper), (1, lower), (1, -1), (-1, -1), (-1, lower)
    }  # fmt: skip
    drawn = assert_sure(seen_by(points, 1.0, 10.0), 1494, margin=STEP, exact=exact)
    literal = {40: (7, 56), 41: (6, 57), 42: (4, 59), 43: (3, 60), 44: (1, 62)}
    assert spans(drawn) == literal | {row: (0, 63) for row in range(45, 64)}


@pytest.mark.case("C05")
def test_all_six_planes_leave_a_nonagon():
    positions = from_d3d([[1.5, -1.5, 0.5, 1], [0, 1.5, -0.25, 1], [-1.5, 0, 1.25, 1]])
    want = {
        (1, -0.5, 0.25), (0.5, 0.5, 0), (0, 1, 0), (-0.5, 1, 0.25), (-1, 0.5, 0.75), (-1, 0, 1),
        (-0.5, -0.5, 1), (0.5, -1, 0.75), (1, -1, 0.5),
    }  # fmt: skip
    assert ndc(oracle.clip_polygon(positions), "d3d") == want
    counts, vertices, _, _ = clip_all(positions)
    assert counts == [9]
    assert {(x, y, (z + 1) / 2) for x, y, z, _ in vertices.tolist()} == want
    assert_sure(positions, 2016, margin=0.058, size=(64, 48))


EDGE_ON = {
    "C06": [(-1, -1, -2), (1, -1, -2), (0, 0, 0)],
    "C07": [(-1, -1, -2), (1, -1, -2), (0, 1, 2)],
    "all at the eye": [(0, 0, 0), (0, 0, 0), (0, 0, 0)],
}


@pytest.mark.parametrize("near", [1e-9, 0.1, 1.0])
@pytest.mark.parametrize("far", [10.0, INF])
@pytest.mark.parametrize("name", catalogue.cases(EDGE_ON))
def test_face_whose_plane_holds_the_eye_draws_nothing(name, near, far):
    points = EDGE_ON[name]
    seen = rj.rasterize(seen_by(points, near, far), [[0, 1, 2]], SIZE, threads=1)
    assert (seen.face_id == -1).all()
    assert (seen.depth == INF).all()
    assert not seen.barycentric.any()
    camera = PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=90, near=near, far=far)
    outputs = ("color", "depth", "face_id", "normal", "position")
    frame = rj.render(
        rj.Mesh(points, [[0, 1, 2]]), camera, size=SIZE, outputs=outputs, background="black",
        threads=1,
    )  # fmt: skip
    assert (frame.face_id == -1).all()
    assert not frame.color[..., :3].any()
    assert (frame.depth == INF).all()
    assert not frame.normal.any()


@pytest.mark.case("C08")
def test_ground_plane_of_two_faces_fills_the_lower_half():
    corners = [(-1e6, -1, 1e6), (1e6, -1, 1e6), (1e6, -1, -1e6), (-1e6, -1, -1e6)]
    positions = seen_by(corners, 0.1, 1e9)
    assert not hits(positions, [[0, 1, 2]]).any()
    total = hits(positions, [[0, 1, 2], [0, 2, 3]])
    assert (total[32:] == 1).all()
    assert total.sum() == 2048
    assert assert_as_oracle(positions, [[0, 1, 2], [0, 2, 3]]) == 2048


# --- every pixel once -----------------------------------------------------------------------------


@pytest.mark.case("C09")
@pytest.mark.parametrize(("size", "pixels"), [((64, 64), 4096), ((65, 33), 2145)])
@pytest.mark.parametrize("eye", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.61)])
def test_from_inside_a_cube_every_pixel_is_covered_once(cube, size, pixels, eye):
    for aspect in {1.0, size[0] / size[1]}:
        positions = seen_by(cube.vertices - eye, 0.1, 10.0, aspect)
        total = hits(positions, cube.faces, size)
        assert (total == 1).all()
        assert total.sum() == pixels


@pytest.mark.case("C09")
@pytest.mark.parametrize("size", [(64, 64), (65, 33)])
def test_from_inside_a_cube_no_order_of_the_faces_shows(cube, size):
    # The lower face wins where two hit a sample at one depth: a sample that is hit once shows the
    # same face when the faces are numbered from the other end.
    camera = PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=90, near=0.1, far=10)
    backward = rj.Mesh(cube.vertices, cube.faces[::-1])
    one, other = (
        rj.render(mesh, camera, size=size, outputs=("face_id", "depth"), threads=1)
        for mesh in (cube, backward)
    )
    assert (one.face_id >= 0).all()
    assert (one.face_id == len(cube.faces) - 1 - other.face_id).all()
    assert one.depth.tobytes() == other.depth.tobytes()


SIGNS = [signs for signs in itertools.product((-1, 0, 1), repeat=3) if any(signs)]


@pytest.mark.case("C10")
@pytest.mark.parametrize("side", [-1, 1], ids=["near", "far"])
def test_vertex_on_the_near_or_far_plane_belongs_to_both_sides(side):
    points = [(3.25, 5.5), (60.5, 12.25), (20.75, 61.5)]
    whole = hits(naive.clip_from_screen(points, SIZE))
    assert whole.sum() > 1000
    for signs in SIGNS:
        # Edges are cut halfway, on the grid: snapping the cuts does not bend the outline.
        distances = 0.5 * np.array(signs)
        kept, rest = (
            naive.clip_from_screen(points, SIZE, z=side * (1.0 - d))
            for d in (distances, -distances)
        )
        assert (hits(kept) + hits(rest) == whole).all()
        if min(signs) >= 0:
            assert (hits(kept) == whole).all()


@pytest.mark.case("C10")
@pytest.mark.parametrize("plane", range(6))
def test_vertex_on_a_plane_is_kept_once(plane):
    axis, side = (2, 2, 0, 0, 1, 1)[plane], (-1, 1, -1, 1, -1, 1)[plane]
    for signs in SIGNS:
        triangle = np.zeros((3, 4))
        triangle[:, 3] = 1.0
        triangle[:, axis] = side * (1.0 - 0.5 * np.array(signs))
        triangle[:, (axis + 1) % 3] = 0.0, 0.5, -0.25
        triangle[:, (axis + 2) % 3] = 0.0, 0.25, 0.5
        exact = oracle.clip_polygon(triangle)
        counts, vertices, _, _ = clip_all(triangle)
        assert counts == [len(exact)]
        assert vertices.tolist() == [[float(c) for c in vertex] for vertex in exact]
        assert len(set(map(tuple, vertices.tolist()))) == len(vertices)


@pytest.mark.case("C10")
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1, 1])
def test_vertex_on_the_guard_band_is_not_cut(axis, side):
    edge = side * make_viewport(SIZE, 8)[2 + axis]
    for place, clipped in ((edge, 0), (np.nextafter(edge, side * INF), 1)):
        positions = naive.clip_from_screen([(10, 10), (50, 20), (30, 60)], SIZE)
        positions[1, axis] = place
        seen = rj.rasterize(positions, [[0, 1, 2]], SIZE, threads=1)
        assert seen.totals.clipped == clipped
        assert assert_as_oracle(positions, [[0, 1, 2]]) > 100


@pytest.mark.case("C11")
@pytest.mark.parametrize("side", [-1, 1], ids=["near", "far"])
@pytest.mark.parametrize("seed", range(4))
def test_a_cut_and_its_complement_cover_every_pixel_once(seed, side):
    # 16 quads with random distances to a plane, drawn with d and again with -d.
    rng = np.random.default_rng(seed)
    grid = [(16.0 * i, 16.0 * j) for j in range(5) for i in range(5)]
    corners = [5 * j + i for j in range(4) for i in range(4)]
    faces = [f for a in corners for f in ([a, a + 1, a + 6], [a, a + 6, a + 5])]
    w = 2.0 ** rng.integers(-2, 3, 25)
    d = np.round(rng.uniform(-1, 1, 25) * 2**20) / 2**20 * w
    total = np.zeros(SIZE, int)
    for distance in (d, -d):
        positions = naive.clip_from_screen(grid, SIZE, w=w)
        positions[:, 2] = side * (w - distance)
        total += hits(positions, faces)
    assert (total == 1).all()


def random_corner(rng):
    return rng.normal(size=4) * [1.5, 1.5, 1.2, 1.0] + [0.0, 0.0, 0.0, 0.6]


@pytest.mark.case("C12")
def test_shared_edge_gets_the_same_new_vertices_in_both_faces():
    rng = np.random.default_rng(6)
    viewport, planes = make_viewport(SIZE, 8), oracle.guard_band(SIZE)
    found = 0
    for _ in range(300):
        a, b, c, d = (random_corner(rng) * [200, 200, 1, 1] for _ in range(4))
        # The edge as a face without area: what is left of it are its two new ends.
        ends = {tuple(map(float, v)) for v in oracle.clip_polygon([a, b, b], planes)}
        new = ends - {tuple(a.tolist()), tuple(b.tolist())}
        faces = [(a, b, c), (b, a, d), (a, b, d), (c, b, a)]
        vertices = [clip_all(face, viewport)[1] for face in faces]
        for end in new:
            nearest = [v[np.abs(v - end).sum(axis=1).argmin()] for v in vertices]
            np.testing.assert_allclose(nearest[0], end, rtol=1e-12, atol=1e-9)
            assert len({vertex.tobytes() for vertex in nearest}) == 1
            found += 1
    assert found > 100


@pytest.mark.case("C12")
@pytest.mark.parametrize("seed", range(4))
def test_shared_edge_through_the_near_plane_is_drawn_once(seed):
    rng = np.random.default_rng(seed)
    drawn = 0
    for _ in range(12):
        a, b = random_corner(rng) * 0.4, random_corner(rng)
        a[3], b[3] = 1.0, -abs(b[3])  # the edge crosses the plane of the eye
        middle, across = (a + b) / 2, rng.normal(size=4) * [2, 2, 0.3, 0.3]
        positions = np.array([a, b, middle + across, middle - across])
        # The two faces make a parallelogram in clip space, cut as one polygon here.
        union = oracle.clip_polygon(positions[[0, 2, 1, 3]])
        for faces in ([[0, 1, 2], [1, 0, 3]], [[0, 1, 2], [0, 1, 3]]):
            total = hits(positions, faces)
            assert total.max() <= 1
            if union:
                inside, distance = inside_and_distance(union)
                sure = distance > STEP
                assert (total[sure] == inside[sure]).all()
            drawn += total.sum()
    assert drawn > 1000


@pytest.mark.case("C13")
def test_attribute_is_halfway_where_the_edge_is_cut_halfway():
    # From w = 1, u = 0 to w = 3, u = 1; the near plane cuts at t = 1/2, where w = 2.
    right, left = 60.5, 20.5
    (xa, ya), (xb, yb), (xc, yc), (xd, yd) = (
        naive.clip_from_screen([(x, y)], SIZE)[0, :2]
        for x, y in ((right, 8), (left, 8), (right, 56), (left, 56))
    )
    positions = np.array(
        [[xa, ya, 0, 1], [3 * xb, 3 * yb, -4, 3], [xc, yc, 0, 1], [3 * xd, 3 * yd, -4, 3]]
    )
    faces, u = [[0, 1, 2], [2, 1, 3]], np.array([0.0, 1.0, 0.0, 1.0])
    seen = rj.rasterize(positions, faces, SIZE, threads=1)
    assert seen.totals.clipped == 2
    # The cut: (60.5 + 3 * 20.5) / 4 = 30.5, the centre of column 30, on a left edge.
    assert spans(seen.face_id >= 0) == {row: (30, 59) for row in range(8, 56)}
    for row, column in np.argwhere(seen.face_id >= 0).tolist():
        corners = faces[seen.face_id[row, column]]
        point = (column + Fraction(1, 2), row + Fraction(1, 2))
        weights = oracle.clip_weights(positions[corners], point, SIZE)
        exact = oracle.interpolate(weights, u[corners])
        # On the screen u = (60.5 - x) / (60.5 - x + 3 (x - 20.5)), whatever the row.
        assert exact == (Fraction(right) - point[0]) / (2 * point[0] - 1)
        assert column != 30 or exact == Fraction(1, 2)
        # Each weight is rounded to float32.
        have = (seen.barycentric[row, column].astype(float) * u[corners]).sum()
        assert abs(Fraction(float(have)) - exact) <= ULP32 / 2 * exact


R09 = [(2.3, 1.7), (9.1, 3.2), (4.4, 10.6)]


@pytest.mark.case("C14")
@pytest.mark.parametrize("x", [3000.0, 30000.0, 3e6, 3e9, -3000.0, -30000.0, -3e6, -3e9])
@pytest.mark.parametrize("vertex", range(3))
@pytest.mark.parametrize("axis", [0, 1])
def test_guard_band_does_not_change_pixels(x, vertex, axis):
    size = (16, 16)
    points = np.array(R09)
    points[vertex, axis] = x
    positions = np.ones((3, 4)) * [1, 1, 0, 1]
    positions[:, 0], positions[:, 1] = points[:, 0] / 8 - 1, 1 - points[:, 1] / 8
    pixels = assert_as_oracle(positions, [[0, 1, 2]], size)
    assert 0 < pixels < 256
    # The polygon that was never snapped covers the same centres, but for those at its outline.
    inside, distance = inside_and_distance(oracle.clip_polygon(positions), size)
    sure = distance > STEP
    assert (hits(positions, size=size)[sure] == inside[sure]).all()
    assert sure.sum() > 240


# --- cameras that must be refused -----------------------------------------------------------------


def lens(**changes):
    return PerspectiveCamera(**{"eye": (2, 3, 5), "target": (0, 0, 0), **changes})


@pytest.mark.case("C15")
@pytest.mark.parametrize(
    ("call", "name"),
    [
        *[
            (lambda fov=fov, make=make: make(fov), "fov_y")
            for fov in (0, 180, -1, NAN, 5e-324, 360, INF)
            for make in (lambda fov: tf.perspective(fov, 1, 1, 10), lambda fov: lens(fov_y=fov))
        ],
        *[
            (lambda near=near, make=make: make(near), "near")
            for near in (0, -0.0, -1, NAN, INF)
            for make in (
                lambda near: tf.perspective(45, 1, near, INF),
                lambda near: lens(near=near),
                lambda near: MatrixCamera.from_intrinsics(1, 1, 1, 1, SIZE, near=near),
            )
        ],
        *[
            (lambda far=far, make=make: make(far), "far")
            for far in (2.0, 1.0, -1.0, -INF, NAN)
            for make in (
                lambda far: tf.perspective(45, 1, 2, far),
                lambda far: lens(near=2, far=far),
                lambda far: MatrixCamera.from_intrinsics(1, 1, 1, 1, SIZE, near=2, far=far),
            )
        ],
        *[(lambda a=a: tf.perspective(45, a, 1, 10), "aspect") for a in (0, -1, NAN, INF)],
        *[
            (lambda side=side, make=make: make(side), name)
            for side in ((0, 5), (5, 0), (-1, 5), (0.5, 5), (NAN, 5))
            for make, name in (
                (lambda side: lens().projection_matrix(side), "size"),
                (lambda side: MatrixCamera.from_intrinsics(1, 1, 1, 1, side), "size"),
                (lambda side: tf.viewport(*side), "width, height"),
                (lambda side: rj.rasterize(np.eye(4), [[0, 1, 2]], side), "size"),
            )
        ],
    ],
)  # fmt: skip
def test_lens_without_a_picture_is_refused_by_name(call, name):
    with pytest.raises(ValueError, match=rf"^{name} must "):
        call()


@pytest.mark.case("C16")
def test_near_of_zero_would_give_every_point_one_depth():
    # What Direct3D's matrix does with near = 0: z = w far / far, so z / w = 1 everywhere.
    near, far = 0, 10
    depths = {(far * (Fraction(w) - near) / (far - near)) / Fraction(w) for w in (1, 2, 9)}
    assert depths == {1}
    for refused in (
        lambda: tf.perspective(45, 1, 0, 10),
        lambda: lens(near=0),
        lambda: rj.ClassicPipeline().perspective(45, 64, 64, 0, 10),
    ):
        with pytest.raises(ValueError, match=r"^near must be "):
            refused()


@pytest.mark.case("C17")
@pytest.mark.parametrize(("near", "far"), [(1e-3, 1e6), (1.0, 1e9), (1e-3, INF), (1e-6, INF)])
def test_far_plane_far_away_keeps_depths_apart(near, far):
    camera = PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=90, near=near, far=far)
    assert np.isfinite(camera.projection_matrix(SIZE)).all()
    assert camera.depth_coefficients() == (near, 0, 0)
    vertices = [(x * z, y * z, -z) for z in (1e3, 1e3 + 1) for x, y in ((-3, -3), (3, -3), (0, 3))]
    for faces, front in (([[0, 1, 2], [3, 4, 5]], 0), ([[3, 4, 5], [0, 1, 2]], 1)):
        seen = rj.render(
            rj.Mesh(vertices, faces), camera, size=SIZE, outputs=("face_id", "depth"), threads=1
        )
        assert (seen.face_id == front).all()
        # Once rounded as near / w, once as w.
        assert np.abs(seen.depth.astype(float) / 1e3 - 1).max() <= ULP32
    behind = rj.render(
        rj.Mesh(vertices, [[3, 4, 5]]), camera, size=SIZE, outputs=("depth",), threads=1
    )
    assert (behind.depth > seen.depth).all()


@pytest.mark.case("C18")
@pytest.mark.parametrize(
    ("place", "name"),
    [
        ({"eye": (1, 2, 3), "target": (1, 2, 3)}, "target"),
        ({"up": (0, 0, 0)}, "up"),
        ({"eye": (NAN, 0, 0)}, "eye"),
        ({"eye": (INF, 0, 0)}, "eye"),
        ({"target": (0, NAN, 0)}, "target"),
        ({"target": (0, INF, 0)}, "target"),
        ({"up": (NAN, 1, 0)}, "up"),
        ({"up": (0, -INF, 0)}, "up"),
    ],
)
def test_camera_without_a_direction_is_refused_by_name(place, name):
    whole = {"eye": (0, 0, 0), "target": (0, 0, -1), "up": (0, 1, 0), **place}
    for make in (tf.look_at, PerspectiveCamera, OrthographicCamera):
        with pytest.raises(ValueError, match=rf"^{name} must "):
            make(**whole)
    with pytest.raises(ValueError, match=r" must "):
        rj.ClassicPipeline().camera(whole["eye"], whole["target"], whole["up"])


@pytest.mark.case("C19")
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("eye", "target"), [((0, 0, 0), (0, 0.3, 0)), ((0.1, 0.2, 0.3), (1.1, 2.2, 3.3))]
)
def test_up_along_the_line_of_sight_is_refused(eye, target, sign):
    forward = np.subtract(target, eye)
    for length in (1.0, 1e-160, 1e160):
        for make in (tf.look_at, PerspectiveCamera, OrthographicCamera):
            with pytest.raises(ValueError, match=r"^up must not be parallel"):
                make(eye, target, sign * length * forward)


@pytest.mark.case("C19")
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 3), (1, 2, 3)])
def test_fitted_camera_along_up_takes_another_up(cube, up, sign):
    scene = rj.Scene()
    scene.add(cube)
    view = rj.fit_camera(scene, sign * np.array(up), up=up).view_matrix()[:3, :3]
    assert np.abs(view @ view.T - np.eye(3)).max() < 1e-12
    assert np.linalg.det(view) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(view[2], sign * np.array(up) / np.linalg.norm(up), atol=1e-15)


@pytest.mark.case("C19")
@pytest.mark.parametrize("lean", [1.0, 1e-3, 1e-6, 1e-8])
def test_look_at_is_a_rigid_motion_also_for_up_close_to_the_view(lean):
    rng = np.random.default_rng(4)
    for sign in (-1, 1):
        for _ in range(25):
            eye, target = rng.normal(size=(2, 3))
            up = sign * (target - eye) + lean * rng.normal(size=3)
            linear = tf.look_at(eye, target, up)[:3, :3]
            assert np.abs(linear @ linear.T - np.eye(3)).max() < 1e-12
            assert np.linalg.det(linear) == pytest.approx(1.0, abs=1e-12)
            forward = (target - eye) / np.linalg.norm(target - eye)
            np.testing.assert_allclose(-linear[2], forward, atol=1e-15)


@pytest.mark.case("C20")
@pytest.mark.parametrize("up", [(1e-160, 1e-160, 0), (0, 1e-160, 0), (1e160, 1e160, 0)])
def test_look_at_far_from_the_origin_with_an_extreme_up_is_exact(up):
    view = tf.look_at((1e7, 0, 0), (1e7 + 1, 0, 0), up)
    assert view.tolist() == [[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 1e7], [0, 0, 0, 1]]


# --- what cameras show ----------------------------------------------------------------------------


@pytest.mark.case("C21")
def test_moving_camera_and_scene_by_a_dyadic_offset_changes_no_bit():
    offset = np.array([2.0**20, -(2.0**20), 2.0**20])
    points = np.random.default_rng(5).integers(-4096, 4096, (90, 3)) / 2048.0
    eye, target, up = np.array([0.5, 1.25, 8.0]), np.array([0.5, 1.25, 0.0]), (0, 1, 0)
    here = tf.transform_points(tf.look_at(eye, target, up), points)
    there = tf.transform_points(tf.look_at(eye + offset, target + offset, up), points + offset)
    assert np.array_equal(here, there)
    faces = np.arange(90).reshape(30, 3)
    frames = [
        rj.render(
            rj.Mesh(points + move, faces), lens(eye=(3, 2, 5) + move, target=move), size=SIZE,
            outputs=("color", "depth", "face_id", "normal", "barycentric"), threads=1,
        )
        for move in (np.zeros(3), offset)
    ]  # fmt: skip
    assert frames[0].stats.pixels_covered > 1000
    for one, other in zip(*(frame.arrays().values() for frame in frames), strict=True):
        assert one.tobytes() == other.tobytes()
    # What a float32 world would lose there, in pixels: 10 m away, focal length 1000 pixels.
    assert np.spacing(np.float32(1e6)) == 0.0625
    assert 0.0625 / 2 / 10 * 1000 == 3.125


@pytest.mark.case("C22")
def test_point_of_the_reference_lands_on_its_pixel():
    clip_from_view = tf.perspective(90, 1, 1, 10)
    assert tf.apply(clip_from_view, (1, 2, -4))[:2].tolist() == [0.25, 0.5]
    screen = tf.apply(tf.compose(tf.viewport(64, 64), clip_from_view), (1, 2, -4))
    assert screen[:2].tolist() == [40, 16]
    assert oracle.screen_position(seen_exactly([(1, 2, -4)], 1, 10)[0], SIZE) == (40, 16)
    chain = rj.ClassicPipeline().perspective(90, 64, 64, 1, 10)
    assert chain.project([(1, 2, -4)]).pixels.tolist() == [[40, 16]]
    # Two pixels wide at that depth are 1/4 unit: a square around the point has four pixels.
    square = rj.Mesh(
        [(x, y, -4) for x, y in ((0.875, 1.875), (1.125, 1.875), (1.125, 2.125), (0.875, 2.125))],
        [[0, 1, 2], [0, 2, 3]],
    )
    camera = PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=90, near=1, far=10)
    seen = rj.render(square, camera, size=SIZE, outputs=("face_id",), threads=1)
    assert spans(seen.face_id >= 0) == {15: (39, 40), 16: (39, 40)}


@pytest.mark.case("C23")
@pytest.mark.parametrize("reach", [4096, 10**6])
def test_ground_plane_has_its_exact_depth_and_place_at_every_pixel(reach):
    x, z = np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)]).T * float(reach)
    ground = rj.Mesh(
        np.column_stack([x, -np.ones(4), z]), [[0, 1, 2], [0, 2, 3]], uv=np.column_stack([x, z])
    )
    camera = PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=90, near=0.125)
    outputs = ("depth", "position", "uv", "face_id")
    seen = rj.render(ground, camera, size=SIZE, outputs=outputs, threads=1)
    assert (seen.face_id[:32] == -1).all()
    assert (seen.depth[:32] == INF).all()
    rounding = reach * 2.0**-50  # of float64, in a few operations on coordinates of that size
    # The plane ends 32 / reach pixels below the horizon: on the sub-pixel grid, or moved to it.
    end = 32 + Fraction(32, reach)
    moved = abs(Fraction(oracle.snap(end), 256) - end)
    assert (moved == 0) == (reach == 4096)
    literal = {32: Fraction(64), 33: Fraction(64, 3), 40: Fraction(64, 17), 48: Fraction(64, 33),
               63: Fraction(64, 63)}  # fmt: skip
    for row in range(32, 64):
        depth = Fraction(64, 2 * row - 63)
        assert depth == literal.get(row, depth)
        # near / depth has seven bits, so it is stored exactly.
        if moved == 0:
            assert (seen.depth[row] == np.float32(float(depth))).all()
        else:
            low, high = (Fraction(64, 1) / (2 * row - 63 + 2 * sign * moved) for sign in (1, -1))
            assert (seen.depth[row] >= float(low) * (1 - ULP32)).all()
            assert (seen.depth[row] <= float(high) * (1 + ULP32)).all()
        for column in range(64):
            place = Fraction(2 * column - 63, 64) * depth, -depth
            parity = sum(map(math.floor, place)) % 2
            position = seen.position[row, column].tolist()
            assert position[1] == -1.0
            for have in ((position[0], position[2]), seen.uv[row, column].tolist()):
                assert sum(map(math.floor, have)) % 2 == parity
                for value, exact in zip(have, place, strict=True):
                    assert abs(Fraction(value) - exact) <= ULP32 / 2 * abs(exact) + rounding


def flipped(frame):
    """Return the outputs of a frame, left and right exchanged, and the normals with them."""
    arrays = {name: array[:, ::-1].copy() for name, array in frame.arrays().items()}
    if "normal" in arrays:
        arrays["normal"][..., 0] *= -1
    return arrays


@pytest.mark.case("C24")
@pytest.mark.parametrize("cull", ["none", "back", "front"])
def test_mirrored_model_is_the_mirrored_picture(sphere, cull):
    # No pixel centre is on an edge, so the fill rule, which is not symmetric, decides nothing.
    camera = PerspectiveCamera((0, 0.625, 4), (0, 0, 0), fov_y=40)
    turned = tf.rotate((1, 2, 3), 25)
    frames = []
    for world_from_model in (turned, tf.compose(tf.scale((-1, 1, 1)), turned)):
        scene = rj.Scene()
        scene.add(sphere, world_from_model)
        outputs = ("face_id", "depth", "normal", "barycentric")
        frames.append(rj.render(scene, camera, size=SIZE, outputs=outputs, cull=cull, threads=1))
    plain, mirrored = frames[0].arrays(), flipped(frames[1])
    assert frames[0].stats.pixels_covered > 800
    assert (plain["face_id"] == mirrored["face_id"]).all()
    seen = plain["face_id"] >= 0
    # Vertices are taken from the other side, so sums are rounded in another order.
    close = {"rtol": 4 * ULP32, "atol": 4 * ULP32}
    np.testing.assert_allclose(mirrored["depth"][seen], plain["depth"][seen], **close)
    np.testing.assert_allclose(mirrored["normal"], plain["normal"], **close)
    np.testing.assert_allclose(mirrored["barycentric"], plain["barycentric"], **close)


@pytest.mark.case("C24")
def test_front_of_a_mirrored_model_stays_its_front(sphere):
    # From outside a closed surface, dropping its back shows what dropping nothing shows.
    camera = PerspectiveCamera((0, 0.625, 4), (0, 0, 0), fov_y=40)
    scene = rj.Scene()
    scene.add(sphere, tf.scale((-1, 1, 1)))
    faces = {
        cull: rj.render(scene, camera, size=SIZE, outputs=("face_id",), cull=cull, threads=1)
        for cull in ("none", "back", "front")
    }
    assert (faces["none"].face_id == faces["back"].face_id).all()
    assert faces["back"].stats.culled > 0
    both = (faces["front"].face_id == faces["none"].face_id) & (faces["none"].face_id >= 0)
    assert not both.any()


# --- cameras at the edge of what floats hold ------------------------------------------------------


def card(depth, half):
    """Return a square that faces a camera at the origin."""
    corners = [(x * half, y * half, -depth) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return rj.Mesh(corners, [[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("fov", [1e-100, 1e-12, 1e-6, 90.0, 179.999, 179.99999999999997])
@pytest.mark.parametrize(
    ("near", "far", "depth"),
    [
        (1e-30, 1e30, 1.0),
        (1e-30, 1e30, 2e-30),
        (1e-30, INF, 1e-20),
        (1.0, 1e308, 1e20),
        (1e30, 1e31, 2e30),
        (1e-30, 1e-29, 2e-30),
    ],
)
def test_extreme_lens_shows_half_its_view_at_its_depth(fov, near, far, depth):
    camera = PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=fov, near=near, far=far)
    mesh = card(depth, depth / tf.focal_length(fov) / 2)
    outputs = ("face_id", "depth", "normal")
    seen = rj.render(mesh, camera, size=SIZE, outputs=outputs, threads=1)
    assert spans(seen.face_id >= 0) == {row: (16, 47) for row in range(16, 48)}
    shown = seen.face_id >= 0
    # Rounded twice to float32; the corners' w and the eye's lens in float64.
    assert np.abs(seen.depth[shown].astype(float) / depth - 1).max() <= ULP32
    assert (seen.normal[shown] == (0, 0, 1)).all()


@pytest.mark.parametrize(
    ("focal", "center"),
    [
        (40.0, (24.0, 16.0)),
        (40.0, (-1e3, 16.0)),
        (40.0, (1e5, -1e5)),
        (1e6, (24.0, 16.0)),
        (1e-3, (24.0, 16.0)),
        (1e9, (1e9, -1e9)),
    ],
)
def test_calibrated_camera_off_its_centre_shows_what_exact_arithmetic_shows(focal, center):
    size, (cx, cy) = (48, 32), center
    camera = MatrixCamera.from_intrinsics(focal, focal, cx, cy, size, near=0.125)
    rng = np.random.default_rng(3)
    depth = rng.uniform(-0.5, 8, 60)
    x, y = rng.uniform(-40, 90, 60), rng.uniform(-40, 70, 60)
    points = np.column_stack([(x - cx) * depth / focal, (cy - y) * depth / focal, -depth])
    faces = np.arange(60).reshape(20, 3)
    seen = rj.render(rj.Mesh(points, faces), camera, size=size, outputs="face_id", threads=1)
    positions = tf.transform_points(camera.projection_matrix(size), points)
    want = np.full((32, 48), -1)
    for (column, row), (face, _) in oracle.render_faces(positions, faces.tolist(), size).items():
        want[row, column] = face
    assert seen.stats.clipped > 0
    assert (want >= 0).sum() > 1000
    assert (seen.face_id == want).all()


@pytest.mark.parametrize("cull", ["none", "back", "front"])
@pytest.mark.parametrize("lens", ["perspective", "orthographic"])
def test_mirroring_projection_shows_the_mirrored_picture(sphere, lens, cull):
    # No pixel centre is on an edge. World space is not mirrored, so normals are the same.
    view = tf.look_at((0.5, 0.625, 4), (0, 0, 0), (0, 1, 0))
    clip = (
        tf.perspective(40, 1, 0.5, INF)
        if lens == "perspective"
        else tf.orthographic(-1.5, 1.5, -1.5, 1.5, 0.5, 9)
    )
    mirror = tf.scale((-1, 1, 1))
    cameras = MatrixCamera(view, clip), MatrixCamera(view, tf.compose(mirror, clip))
    plain, mirrored = (
        rj.render(sphere, camera, size=SIZE, outputs=("face_id", "normal"), cull=cull, threads=1)
        for camera in cameras
    )
    assert plain.stats.pixels_covered > 800
    assert (mirrored.face_id[:, ::-1] == plain.face_id).all()
    np.testing.assert_allclose(
        mirrored.normal[:, ::-1], plain.normal, rtol=4 * ULP32, atol=4 * ULP32
    )
    assert mirrored.stats.culled == plain.stats.culled
    assert (plain.stats.culled > 0) == (cull != "none")
