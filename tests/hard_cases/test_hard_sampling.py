"""
Hard cases of sampling patterns and of exact areas, M01 to M10.

The engine samples pixel centres. A pattern of samples is held by drawing a triangle once for each
sample, shifted by what takes the sample to the centre, (1/2 - x, 1/2 - y): all standard positions
are multiples of 1/16 pixel, so that no vertex on the grid is rounded.
"""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import screen

import rasterjit as rj
from rasterjit.pipeline.srgb_encoding import encode_rows, make_encoding_table

SIXTEENTHS = {
    1: [(8, 8)],
    2: [(12, 12), (4, 4)],
    4: [(6, 2), (14, 6), (2, 10), (10, 14)],
    8: [(9, 5), (7, 11), (13, 9), (5, 3), (3, 13), (1, 7), (11, 15), (15, 1)],
    16: [
        (9, 9), (7, 5), (5, 10), (12, 7), (3, 6), (10, 13), (13, 11), (11, 3), (6, 14), (8, 1),
        (4, 2), (2, 12), (0, 8), (15, 4), (14, 15), (1, 0),
    ],
}  # fmt: skip
PATTERNS = {
    count: [(Fraction(x, 16), Fraction(y, 16)) for x, y in places]
    for count, places in SIXTEENTHS.items()
}
"""The standard sample positions of Direct3D and Vulkan, from the upper left corner of the pixel."""


def shifted(points, sample):
    """Return points moved so that a sample of each pixel comes to its centre."""
    return [(x + Fraction(1, 2) - sample[0], y + Fraction(1, 2) - sample[1]) for x, y in points]


def masks(points, pattern, size, faces=((0, 1, 2),)):
    """Return which samples of which pixels faces cover; (N, H, W) bool."""
    return np.stack(
        [screen.draw(shifted(points, sample), faces, size).face_id >= 0 for sample in pattern]
    )


UPPER, LOWER = [(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]


@pytest.mark.case("M01")
@pytest.mark.parametrize(
    ("count", "upper", "lower"), [(1, 1, 0), (2, 2, 0), (4, 2, 2), (8, 4, 4), (16, 9, 7)]
)
def test_halves_of_a_pixel_share_out_its_samples(count, upper, lower):
    one, other = (masks(points, PATTERNS[count], (1, 1))[:, 0, 0] for points in (UPPER, LOWER))
    assert not (one & other).any()
    assert (one | other).all()
    assert (one.sum(), other.sum()) == (upper, lower)
    for points, mask in ((UPPER, one), (LOWER, other)):
        owned = [rj.oracle.covers(points, sample) for sample in PATTERNS[count]]
        assert mask.tolist() == owned


def jittered(cells, step, steps=256):
    """Return a tiling of the square of ``cells * step`` pixels by triangles on the 1/256 grid."""
    rng = np.random.default_rng(cells)
    points = []
    for j, i in itertools.product(range(cells + 1), repeat=2):
        dx, dy = rng.integers(-steps * step // 3, steps * step // 3 + 1, 2).tolist()
        inside = [0 < k < cells for k in (i, j)]
        points.append(
            (i * step + Fraction(dx * inside[0], steps), j * step + Fraction(dy * inside[1], steps))
        )
    faces = []
    for j, i in itertools.product(range(cells), repeat=2):
        a = j * (cells + 1) + i
        faces += [[a, a + 1, a + cells + 2], [a, a + cells + 2, a + cells + 1]]
    return points, faces


@pytest.mark.case("M02")
@pytest.mark.parametrize("count", [2, 4, 8, 16])
def test_faces_of_a_tiling_share_out_every_sample(count):
    points, faces = jittered(4, 2)
    total = sum(masks(points, PATTERNS[count], (8, 8), [face]).astype(int) for face in faces)
    # Every sample of every pixel belongs to one face, so that each pixel counts N in all.
    assert (total == 1).all()


@pytest.mark.case("M02")
@pytest.mark.parametrize("count", [2, 4, 8, 16])
def test_faces_of_a_fan_share_out_the_samples_of_their_union(count):
    ring = [(1, 1), (9, 0), (14, 2), (15, 9), (12, 15), (4, 14), (0, 8)]
    points = [(Fraction(129, 16), Fraction(119, 16)), *ring]
    faces = [[0, k, k % 7 + 1] for k in range(1, 8)]
    total = sum(masks(points, PATTERNS[count], (16, 16), [face]).astype(int) for face in faces)
    outline = masks(points, PATTERNS[count], (16, 16), [[1, k, k + 1] for k in range(2, 7)])
    assert (total == outline).all()
    assert (total.sum(axis=0) == count).sum() > 100


def resolve(linear):
    """Return the sRGB codes, (H, W, 4), that the engine makes of linear colour."""
    height, width = linear.shape[:2]
    color = np.empty((height, width), np.uint32)
    encode_rows(np.ascontiguousarray(linear, np.float32), make_encoding_table(), color)
    return color[..., None].view(np.uint8)


def sampled(meshes, pattern, size, background="black"):
    """Return the linear colour, (N, H, W, 4) float32, of each sample of a pattern."""
    frames = []
    for x, y in pattern:
        scene = rj.Scene()
        for points, color in meshes:
            mesh = screen.mesh(shifted(points, (x, y)), FAN[: len(points) - 2], size)
            mesh.material = rj.Material(shading="unlit", base_color=color)
            scene.add(mesh)
        frame = rj.render(
            scene, screen.camera(1.0), size=size, outputs=("linear",), background=background,
            threads=1,
        )  # fmt: skip
        frames.append(frame.linear)
    return np.stack(frames)


FAN = [[0, 1, 2], [0, 2, 3]]


def mean(samples):
    """Return the mean of float32 samples: summed exactly, divided by a power of two."""
    return (samples.astype(np.float64).sum(axis=0) / len(samples)).astype(np.float32)


@pytest.mark.case("M03")
@pytest.mark.parametrize("count", [1, 2, 4, 8, 16])
def test_mean_of_equal_samples_is_the_sample_for_every_code(count):
    codes = np.arange(256, dtype=np.uint8)
    rgb = np.repeat(codes[:, None], 3, axis=1)
    # The linear colours that the engine gives to the 256 codes.
    linear = rj.Mesh(np.zeros((256, 3)), [[0, 1, 2]], colors=rgb).vertex_colors[None]
    averaged = mean(np.stack([linear] * count))
    assert averaged.tobytes() == linear.tobytes()
    assert (resolve(averaged)[0, :, :3] == rgb).all()


@pytest.mark.case("M03")
@pytest.mark.parametrize("count", [2, 4, 8, 16])
@pytest.mark.parametrize("color", ["#010203", "#7f80ff", "#fefdfc"])
def test_resolved_interior_is_the_colour_of_one_sample(count, color):
    size = (16, 16)
    points = [(1.25, 0.5), (15.5, 2), (6, 15.75)]
    samples = sampled([(points, color)], PATTERNS[count], size)
    inside = masks(points, PATTERNS[count], size).all(axis=0)
    assert inside.sum() > 40
    shown = rj.render(
        screen.mesh(points, [[0, 1, 2]], size, colors=[rj.Material(base_color=color).base_color]),
        screen.camera(1.0), size=size, outputs=("color",), background="black", threads=1,
    )  # fmt: skip
    assert (resolve(mean(samples))[inside] == shown.color[inside]).all()


# Largest |count / N - area| over all half-planes: a table of four digits, each cut off.
MAX_ERRORS = {1: 0.5, 2: 0.5, 4: 0.3085, 8: 0.2266, 16: 0.1716}
MAX_ERRORS_OF_GRIDS = {2: 0.25, 4: 0.125, 8: 0.0625, 16: 0.03125}
TABLE_DIGITS = 1e-4
REACH = 64
"""How far, in steps of 1/16 pixel, the lines of the half-planes go on to either side."""


def half_planes(pattern, most):
    """
    Yield half-planes as big triangles whose first edge runs through two samples.

    Where a sample changes sides the error jumps, so lines through samples are the worst.
    """
    rng = np.random.default_rng(len(pattern))
    if len(pattern) == 1:
        pairs = [((8, 8), (8 + dx, 8 + dy)) for dx, dy in ((1, 0), (0, 1), (1, 1), (2, -3))]
    else:
        sixteenths = [(int(16 * x), int(16 * y)) for x, y in pattern]
        pairs = list(itertools.combinations(sixteenths, 2))
        pairs = [pairs[n] for n in rng.permutation(len(pairs))[:most]]
    for (px, py), (qx, qy) in pairs:
        dx, dy = qx - px, qy - py
        for side in (-1, 1):
            # The third corner lies far out on one side.
            yield [
                (Fraction(px - REACH * dx, 16), Fraction(py - REACH * dy, 16)),
                (Fraction(px + REACH * dx, 16), Fraction(py + REACH * dy, 16)),
                (Fraction(px - side * REACH * dy, 16), Fraction(py + side * REACH * dx, 16)),
            ]


def counting_errors(pattern, most):
    """Return count / N less the exact area, of each half-plane."""
    errors = []
    for points in half_planes(pattern, most):
        count = int(masks(points, pattern, (1, 1)).sum())
        area = rj.oracle.pixel_area(points, 0, 0)
        assert 0 < area < 1
        errors.append(Fraction(count, len(pattern)) - area)
    return errors


@pytest.mark.case("M04")
@pytest.mark.parametrize(("count", "largest"), MAX_ERRORS.items())
def test_count_of_samples_is_near_the_area_of_a_half_plane(count, largest):
    errors = [abs(error) for error in counting_errors(PATTERNS[count], most=60)]
    assert max(errors) <= largest + TABLE_DIGITS
    # The bound is not a loose one: some line comes close to it.
    assert max(errors) >= 0.8 * largest


@pytest.mark.case("M04")
@pytest.mark.parametrize(("side", "largest"), MAX_ERRORS_OF_GRIDS.items())
def test_count_of_a_regular_grid_is_near_the_area_of_a_half_plane(side, largest):
    # Samples at the centres of the cells of a pixel: one image of side x side draws them all.
    worst = 0
    for k, flip in itertools.product(range(side), (1, -1)):
        at = Fraction(2 * k + 1, 2 * side)
        for direction in (1, Fraction(-1, 3), Fraction(1, 2), 0):
            # Through the k-th sample of the first column, as steep as the direction says.
            rise = [at + direction * (x - Fraction(1, 2 * side)) for x in (-8, 9)]
            points = [(-8, rise[0]), (9, rise[1]), (Fraction(1, 2), flip * 64)]
            points = [(x, Fraction(round(256 * y), 256)) for x, y in points]
            larger = [(side * x, side * y) for x, y in points]
            count = int((screen.draw(larger, [[0, 1, 2]], (side, side)).face_id == 0).sum())
            error = abs(Fraction(count, side * side) - rj.oracle.pixel_area(points, 0, 0))
            worst = max(worst, error)
    # A line along a row of samples errs by half a row.
    assert worst == Fraction(largest)


SAMPLES = 64
"""Samples on a side of a pixel where the engine's coverage stands in for an area."""


def fine_areas(points, size):
    """Return the engine's estimate, (H, W), of the covered share of each pixel, and its bound."""
    pixels = (SAMPLES * size[0], SAMPLES * size[1])
    larger = [(SAMPLES * x, SAMPLES * y) for x, y in points]
    faces = [[0, k, k + 1] for k in range(1, len(points) - 1)]
    hit = screen.draw(larger, faces, pixels).face_id >= 0
    blocks = hit.reshape(size[1], SAMPLES, size[0], SAMPLES)
    # Only cells that an edge crosses can err: at most 2 n - 1 of the n x n for each edge.
    bound = Fraction(len(points) * (2 * SAMPLES - 1), SAMPLES**2)
    return blocks.sum(axis=(1, 3)), bound


def check_areas(points, size, areas, total):
    """Hold exact areas of pixels, their sum, and the engine's counts beside them."""
    for (column, row), area in areas.items():
        assert rj.oracle.pixel_area(points, column, row) == Fraction(area)
    exact = {
        (i, j): rj.oracle.pixel_area(points, i, j) for j in range(size[1]) for i in range(size[0])
    }
    assert sum(exact.values()) == Fraction(total)
    counts, bound = fine_areas(points, size)
    for (column, row), area in exact.items():
        assert abs(Fraction(int(counts[row, column]), SAMPLES**2) - area) <= bound


@pytest.mark.case("M05")
def test_area_of_half_a_pixel():
    check_areas([(0, 0), (1, 0), (0, 1)], (2, 2), {(0, 0): "1/2", (1, 0): 0, (1, 1): 0}, "1/2")


@pytest.mark.case("M06")
def test_areas_below_a_sloping_edge():
    points = [(0, 0.25), (4, 1.25), (4, 4), (0, 4)]
    rows = [["5/8", "3/8", "1/8", "0"], ["1", "1", "1", "7/8"]]
    areas = {(i, j): area for j, row in enumerate(rows) for i, area in enumerate(row)}
    check_areas(points, (4, 4), areas, 13)


@pytest.mark.case("M07")
def test_areas_of_a_triangle():
    points = [(1.25, 1.5), (6.75, 2.25), (3.5, 6.75)]
    areas = {
        (1, 1): "1395/4928", (2, 1): "29/88", (3, 3): "1", (6, 2): "35/88", (3, 6): "939/2912",
        (5, 4): "1225/7488", (2, 3): "197/224",
    }  # fmt: skip
    check_areas(points, (8, 8), areas, "435/32")


@pytest.mark.case("M08")
def test_areas_of_a_tiling_add_up_to_one():
    points, faces = jittered(4, 2)
    triangles = [[points[k] for k in face] for face in faces]
    for row, column in itertools.product(range(8), repeat=2):
        areas = [rj.oracle.pixel_area(triangle, column, row) for triangle in triangles]
        assert sum(areas) == 1
        # In float64, as an engine would keep them.
        assert abs(math.fsum(map(float, areas)) - 1.0) <= 1e-12


@pytest.mark.case("M09")
@pytest.mark.parametrize("count", [2, 4, 8, 16])
@pytest.mark.parametrize("ends", [(7.5, 8.5), (3.25, 12.75), (8, 8)])
def test_common_edge_of_two_quads_shows_no_seam(count, ends):
    size, (top, bottom) = (16, 16), ends
    left = [(0, 0), (top, 0), (bottom, 16), (0, 16)]
    right = [(top, 0), (16, 0), (16, 16), (bottom, 16)]
    quads = [(left, "#7f80ff"), (right, "#7f80ff")]
    averaged = mean(sampled(quads, PATTERNS[count], size, background="#ffff00"))
    assert (averaged == averaged[8, 8]).all()
    assert (resolve(averaged) == [0x7F, 0x80, 0xFF, 0xFF]).all()


@pytest.mark.case("M10")
def test_weights_at_covered_samples_extrapolate_nothing():
    points, size, pattern = [(1.25, 1.5), (14.75, 3.25), (4.5, 13.75)], (16, 16), PATTERNS[16]
    drawn = [screen.draw(shifted(points, sample), [[0, 1, 2]], size) for sample in pattern]
    mask = np.stack([seen.face_id == 0 for seen in drawn])
    corners = screen.corners(points)
    outside = 0
    for row, column in np.argwhere(mask.any(axis=0) & ~mask.all(axis=0)):
        centre = screen.centre(int(column), int(row))
        outside += min(rj.oracle.affine_weights(corners, centre)) < 0
        # The rule for centroids: no sample but those covered, the first of which is taken.
        for n in np.nonzero(mask[:, row, column])[0]:
            weights = drawn[n].barycentric[row, column]
            place = int(column) + pattern[n][0], int(row) + pattern[n][1]
            exact = rj.oracle.affine_weights(corners, place)
            assert weights.tolist() == [np.float32(float(weight)) for weight in exact]
            assert ((weights >= 0.0) & (weights <= 1.0)).all()
    # At the centres of these pixels a weight is below zero, and a colour would leave its range.
    assert outside > 10


@pytest.mark.case("M10")
def test_centre_of_a_wholly_covered_pixel_is_inside_the_triangle():
    points, size, pattern = [(1.25, 1.5), (14.75, 3.25), (4.5, 13.75)], (16, 16), PATTERNS[16]
    whole = masks(points, pattern, size).all(axis=0)
    seen = screen.draw(points, [[0, 1, 2]], size)
    assert whole.sum() > 20
    assert (seen.face_id[whole] == 0).all()
