"""Exact areas of thousands of small random scenes, against clipping of triangles by pixels."""

from __future__ import annotations

import os
import secrets

import numpy as np
import pytest
from naive_layers import CAMERA

import rasterjit as rj

WIDTH = 128
"""Pixels along a side of a picture, which is cut into cells: each cell is a scene of its own."""

FACES = 3
"""Faces of a scene: each has a channel of the colour alone, so that shares are read off."""

GRID = 256
"""Steps of the sub-pixel grid in a pixel."""

PART = 2.0**-24
"""A share is a whole number of these."""

NEAR = 1.5 * PART
"""How far a share may be from the exact one: it is rounded, and then its colour times alpha."""


def random_triangles(rng, count, side):
    """Return triangles that lie in squares of ``side`` pixels, (count, 3, 2), on the grid."""
    steps = side * GRID
    anywhere = rng.integers(0, steps + 1, (count, 3, 2))
    # Corners on those of pixels, or halfway between them; edges along rows and columns.
    on_corners = rng.integers(0, 2 * side + 1, (count, 3, 2)) * (GRID // 2)
    small = rng.integers(0, steps - GRID, (count, 1, 2)) + rng.integers(0, GRID, (count, 3, 2))
    # Slivers: the third corner is close to the edge of the others.
    slivers = anywhere.copy()
    middle = np.round(slivers[:, 0] + (slivers[:, 1] - slivers[:, 0]) * rng.random((count, 1)))
    slivers[:, 2] = middle + rng.integers(-2, 3, (count, 2))
    # An edge passes a corner of a pixel as close as the grid lets it.
    grazing = anywhere.copy()
    corner = rng.integers(1, side, (count, 2)) * GRID
    way = (corner - grazing[:, 0]) * rng.random((count, 1)) * 2.0
    grazing[:, 1] = np.round(corner + way) + rng.integers(-1, 2, (count, 2))
    covering = np.array([[0, 0], [2 * steps, 0], [0, 2 * steps]]) + np.zeros((count, 1, 1), int)
    kinds = np.array([anywhere, on_corners, small, slivers, grazing, covering])
    chosen = rng.choice(len(kinds), count, p=[0.25, 0.15, 0.15, 0.15, 0.25, 0.05])
    return np.clip(kinds[chosen, np.arange(count)], 0, steps) / GRID


def random_scenes(rng, side):
    """
    Return the scenes of a picture.

    Returns
    -------
    points : (C, FACES, 3, 2) float64
        From the upper left corner of the cell, pixels.
    depths : (C, FACES, 3)
        From -1, which is near, to 1; planes of a scene do not meet, or are the same.
    order : (C, FACES)
        The faces, the nearest first; of one plane the lower number.
    """
    count = (WIDTH // side) ** 2
    points = np.stack([random_triangles(rng, count, side) for _ in range(FACES)], axis=1)
    # Some share an edge: the last face has two corners of the first.
    shares_edge = rng.random(count) < 0.3
    points[shares_edge, 2, :2] = points[shares_edge, 0, 1:]
    level = rng.permuted(np.tile(np.arange(FACES), (count, 1)), axis=1)
    level[rng.random(count) < 0.2] = 0
    tilt = rng.integers(0, 2**10, (count, FACES, 3)) * 2.0**-12
    tilt[(level == 0).all(axis=1)] = 0.0
    depths = level[..., np.newaxis] * 0.5 - 0.75 + tilt
    return points, depths, np.argsort(level, axis=1, kind="stable")


def cells_of(side):
    """Return the upper left corner of each cell, (C, 2), pixels."""
    rows, columns = np.mgrid[0:WIDTH:side, 0:WIDTH:side]
    return np.stack([columns.ravel(), rows.ravel()], axis=1)


def scene_of(points, depths, side):
    """Return scenes beside each other as one: a mesh for each face of a cell."""
    scene, at = rj.Scene(), points + cells_of(side)[:, np.newaxis, np.newaxis]
    for k, color in enumerate(np.eye(3)):
        vertices = np.empty((len(at), 3, 3))
        vertices[..., 0] = at[:, k, :, 0] * (2.0 / WIDTH) - 1.0
        vertices[..., 1] = 1.0 - at[:, k, :, 1] * (2.0 / WIDTH)
        vertices[..., 2] = depths[:, k]
        faces = np.arange(3 * len(at)).reshape(-1, 3)
        material = rj.Material("unlit", color.tolist())
        scene.add(rj.Mesh(vertices.reshape(-1, 3), faces, material=material))
    return scene


def cut(polygons, lines):
    """
    Cut convex polygons, (N, M, 2), by a line each, (N, 3): what has a x + b y + c >= 0 is left.

    Polygons with fewer than M corners repeat one; those without any are NaN.
    """
    x, y, (a, b, c) = polygons[..., 0], polygons[..., 1], lines.T[..., np.newaxis]
    here = a * x + b * y + c
    there, following = np.roll(here, -1, axis=1), np.roll(polygons, -1, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = polygons + (here / (here - there))[..., np.newaxis] * (following - polygons)
        crosses = (here > 0) & (there < 0) | (here < 0) & (there > 0)
        stays = here >= 0
    # Of each edge its first corner, if that stays, and the place where it crosses the line.
    listed = np.stack([polygons, crossing], axis=2).reshape(len(x), 2 * x.shape[1], 2)
    is_kept = np.stack([stays, crosses], axis=2).reshape(len(x), 2 * x.shape[1])
    first = np.argsort(~is_kept, axis=1, kind="stable")[:, : x.shape[1] + 1]
    left = np.take_along_axis(listed, first[..., np.newaxis], axis=1)
    has_more = np.take_along_axis(is_kept, first, axis=1)[..., np.newaxis]
    nothing = np.where(is_kept.any(axis=1), 0.0, np.nan)[:, np.newaxis, np.newaxis]
    return np.where(has_more, left, left[:, :1]) + nothing


def inner_lines(corners):
    """Return the lines through the edges of triangles, (N, 3, 3), positive inside."""
    x, y = corners[..., 0], corners[..., 1]
    a, b = y - np.roll(y, -1, axis=1), np.roll(x, -1, axis=1) - x
    lines = np.stack([a, b, -(a * x + b * y)], axis=2)
    (ux, uy), (vx, vy) = ((corners[:, k] - corners[:, 0]).T for k in (1, 2))
    return lines * np.sign(ux * vy - uy * vx)[:, np.newaxis, np.newaxis]


def areas_of(polygons):
    """Return the areas of convex polygons, (N, M, 2)."""
    x, y = (polygons - polygons[:, :1]).transpose(2, 0, 1)
    doubled = (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)
    return np.nan_to_num(np.abs(doubled) / 2)


def shares_of(points, order, side):
    """
    Return the area of each pixel that shows each face, (C, side, side, FACES).

    Of the first face all shows that lies in the pixel; of the second what the first leaves; of the
    third what lies in neither: areas of intersections of triangles, added and taken away.
    """
    cells = len(points)
    rows, columns = np.mgrid[0:side, 0:side].reshape(2, -1)
    corners = np.stack([columns, rows], axis=1)[:, np.newaxis] + [[0, 0], [1, 0], [1, 1], [0, 1]]
    pixels = np.tile(corners.astype(float), (cells, 1, 1))
    sorted_points = np.take_along_axis(points, order[..., np.newaxis, np.newaxis], axis=1)
    lines = [np.repeat(inner_lines(sorted_points[:, k]), side * side, axis=0) for k in range(FACES)]

    def area(*faces):
        """Return the area of each pixel that lies in all of some triangles."""
        found, some = np.zeros(len(pixels)), np.arange(len(pixels))
        inside = pixels
        for face in faces:
            for edge in range(3):
                inside = cut(inside, lines[face][some, edge])
                is_left = ~np.isnan(inside[:, 0, 0])
                inside, some = inside[is_left], some[is_left]
            # A triangle without an area has none to be in.
            is_flat = (lines[face][some] == 0).all(axis=(1, 2))
            inside, some = inside[~is_flat], some[~is_flat]
        found[some] = areas_of(inside)
        return found

    seen = np.stack(
        [
            area(0),
            area(1) - area(0, 1),
            area(2) - area(0, 2) - area(1, 2) + area(0, 1, 2),
        ],
        axis=1,
    ).reshape(cells, side, side, FACES)
    shares = np.empty_like(seen)
    place = np.broadcast_to(order[:, np.newaxis, np.newaxis], seen.shape)
    np.put_along_axis(shares, place, seen, axis=3)
    return shares


def as_picture(cells, side):
    """Return what is known of the pixels of cells, (C, side, side, K), as a picture."""
    across = WIDTH // side
    rows = cells.reshape(across, across, side, side, -1).transpose(0, 2, 1, 3, 4)
    return rows.reshape(WIDTH, WIDTH, -1)


def draw(scene, background=(0.0, 0.0, 0.0, 0.0), outputs=("linear", "coverage", "color")):
    quality = rj.Quality(samples="area", subpixel_bits=8)
    return rj.render(
        scene, CAMERA, size=(WIDTH, WIDTH), quality=quality, background=background, outputs=outputs
    )


def check(seed, side):
    """Hold the shares of random scenes to exact ones; return how many pixels are hardly touched."""
    rng = np.random.default_rng(seed)
    print(f"seed {seed}, cells of {side} pixels")
    points, depths, order = random_scenes(rng, side)
    want = as_picture(shares_of(points, order, side), side)
    scene = scene_of(points, depths, side)
    frame = draw(scene)
    shares = frame.linear[..., :3].astype(float) * frame.linear[..., 3:]
    np.testing.assert_allclose(shares, want, rtol=0, atol=NEAR)
    np.testing.assert_allclose(frame.coverage, want.sum(axis=2), rtol=0, atol=NEAR)
    assert np.array_equal(frame.linear[..., 3], frame.coverage)
    # Before a white background: the rest of the light is that of what shows through.
    behind = draw(scene, "white", ("linear",)).linear[..., :3]
    rest = 1.0 - want.sum(axis=2, keepdims=True)
    np.testing.assert_allclose(behind, want + rest, rtol=0, atol=2 * NEAR)
    total = want.sum(axis=2)
    return int(((total > 0) & (total < PART)).sum())


@pytest.fixture
def seed():
    return int(os.environ.get("RASTERJIT_TEST_SEED") or secrets.randbits(32))


def test_faces_of_random_scenes_have_their_exact_areas(seed):
    # 4096 and 1024 scenes; that some pixels are hardly touched is why there are so many.
    assert sum(check(seed + n, side) for n, side in enumerate((4, 8))) > 0


@pytest.mark.takes_long
def test_faces_of_many_random_scenes_have_their_exact_areas(seed):
    for n in range(40):
        check(seed + n, (4, 8, 16, 32)[n % 4])


def test_face_that_hardly_touches_a_pixel_leaves_its_color():
    # It covers 2e-8 of the pixel in column 13, row 5: less than a share can say.
    points = [(20.98828125, 5.55859375), (16.77734375, 5.57421875), (1.4609375, 7.921875)]
    scene = rj.Scene()
    vertices = [(x * (2 / WIDTH) - 1, 1 - y * (2 / WIDTH), 0) for x, y in points]
    scene.add(rj.Mesh(vertices, [[0, 1, 2]], material=rj.Material("unlit", "red")))
    frame = draw(scene, "white")
    assert frame.color[5, 13].tolist() == [255] * 4
    assert frame.coverage[5, 13] == 0.0


def test_color_of_a_face_does_not_depend_on_how_little_shows_of_it(seed):
    # Before nothing a pixel has the colour of its face, whatever its alpha.
    print(f"seed {seed}")
    points, depths, _ = random_scenes(np.random.default_rng(seed), 4)
    color = (0.9, 0.5, 0.1)
    scene = scene_of(points, depths, 4)
    for node in scene.nodes:
        node.mesh.material = rj.Material("unlit", color)
    frame = draw(scene)
    seen = frame.linear[frame.coverage > 0]
    np.testing.assert_allclose(seen[:, :3], np.tile(color, (len(seen), 1)), rtol=1e-6)


def test_what_is_covered_does_not_depend_on_depths_that_are_nearly_tied(seed):
    # A face tied with two others that are not tied may not let all three hide each other.
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    points, depths, _ = random_scenes(rng, 4)
    apart = draw(scene_of(points, depths, 4)).coverage
    steps = rng.integers(0, 5, (len(points), FACES, 1)) + rng.integers(0, 2, depths.shape)
    tied = draw(scene_of(points, 0.4 + steps * 2.0**-25, 4)).coverage
    np.testing.assert_allclose(tied, apart, rtol=0, atol=NEAR)
