"""
Laws of coverage, depth, lines and interpolation against real OpenGL (Mesa's llvmpipe).

Both are given the same float32 clip positions. Where they may differ follows from how Mesa works:

- It computes window coordinates in float32, so a vertex that lies within that error of the middle
  between two points of the sub-pixel grid may be rounded to the other one.
- It cuts faces that leave the view volume, at all of its planes, and rounds the new vertices to
  the grid; RasterJIT does so at the near and far plane only.
- It interpolates depth in float32 from vertices that were *not* rounded to the grid, and keeps it
  with 24 bits.

Each differing pixel must be explained by one of these, by name and amount.
"""

from __future__ import annotations

import functools
import itertools
from collections import Counter
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from opengl import Drawn, draw_faces, draw_lines

import rasterjit as rj
from rasterjit.survey.cache import find_unique_edges

pytestmark = pytest.mark.usefixtures("own_process")

MODELS = Path(__file__).parents[2] / "models"
SIZES = [(512, 512), (640, 480)]

GRID = 256
"""Sub-pixel positions in a pixel, of Mesa and of ``Quality.standard()``."""
SNAP = 0.5 / GRID
"""How far rounding to the grid moves a coordinate at most, pixels."""
UNIT = 2.0**-24
"""Largest relative error of one float32 operation."""
DEPTH_STEP = 2.0**-24
"""Step of Mesa's depth buffer, window z."""
FLOAT64_LOSS = 1e-13
"""What float64 interpolation of depths up to 1 may lose before the rounding to float32."""
NEAR_EDGE = 1.0 / 128.0
"""
How near the edge of a cut face Mesa and exact arithmetic may disagree, pixels.

Rounding a new vertex to the grid moves it by up to sqrt(2) / 512 = 0.0028 pixel; what is left is
for computing it in float32 in clip space, where it may lie far outside the picture.
"""


class Case(NamedTuple):
    """The same triangles for both, with what the laws need to know of them."""

    clip: NDArray[np.float64]  # (V, 4), float32 numbers
    faces: NDArray[np.int64]  # (F, 3)
    size: tuple[int, int]
    xy: NDArray[np.float64]  # (V, 2), exact screen position to 1e-12 pixel, y down
    z: NDArray[np.float64]  # (V,), window z, 0..1
    error: NDArray[np.float64]  # (V, 2), bound for Mesa's error of xy, pixels
    is_cut: NDArray[np.bool_]  # (F,), whether Mesa clips the face


def make_case(clip, faces, size) -> Case:
    """
    Measure a set of triangles.

    Mesa takes ``x * (1 / w) * scale + scale - 0.5``: the first three operations and the division
    round by UNIT relative to the product, the last two relative to their results.
    """
    clip = np.asarray(clip, np.float32).astype(np.float64)
    half = np.array(size) / 2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        ndc = clip[:, :3] / clip[:, 3:]
        centred = ndc[:, :2] * [1.0, -1.0] * half
        xy = centred + half
        error = UNIT * (3.0 * np.abs(centred) + np.abs(xy) + np.abs(xy - 0.5))
    is_outside = ~(np.abs(clip[:, :3]) <= clip[:, 3:]).all(axis=1)
    z = 0.5 * ndc[:, 2] + 0.5
    return Case(clip, np.asarray(faces), size, xy, z, error, is_outside[faces].any(axis=1))


def draw_both(case: Case) -> tuple[Drawn, rj.RasterizedFaces]:
    return (
        draw_faces(case.clip, case.faces, case.size),
        rj.rasterize(case.clip, case.faces, case.size, threads=2),
    )


# The scenes


def soup(size, seed, count=10_000) -> Case:
    """
    Scatter triangles of 0.5 to 150 pixels in front of, behind and around a perspective camera.

    Depths span the near plane, which a tenth of the triangles straddle or miss; an eighth of the
    triangles is larger than the rest, so that they cross the picture's border and each other.
    """
    random = np.random.default_rng(seed)
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=60.0, near=1.0, far=100.0)
    distance = np.exp(random.uniform(np.log(0.8), np.log(110.0), count))
    extent = np.tan(np.radians(30.0)) * distance
    middle = np.stack(
        [
            random.uniform(-1.1, 1.1, count) * extent * size[0] / size[1],
            random.uniform(-1.1, 1.1, count) * extent,
            -distance,
        ],
        axis=-1,
    )
    scale = extent * np.exp(random.uniform(np.log(0.002), np.log(0.03), count))
    scale[:: count // 100] *= 20.0
    corners = middle[:, None] + random.normal(size=(count, 3, 3)) * scale[:, None, None]
    points = np.concatenate([corners.reshape(-1, 3), np.ones((3 * count, 1))], axis=1)
    clip = points @ camera.projection_matrix(size).T
    return make_case(clip, np.arange(3 * count).reshape(-1, 3), size)


def model(name, camera, size) -> Case:
    """Take a model of one mesh to clip space."""
    node = rj.load(MODELS / name).nodes[0]
    matrix = rj.transforms.compose(
        camera.projection_matrix(size), camera.view_matrix(), node.world_from_model
    )
    points = np.concatenate([node.mesh.vertices, np.ones((len(node.mesh.vertices), 1))], axis=1)
    return make_case(points @ matrix.T, node.mesh.faces, size)


def lattice(step, seed, offset=0, count=4000) -> Case:
    """
    Scatter triangles whose corners lie ``step`` sub-pixels apart on the grid, inside the picture.

    512 pixels and powers of two for w make all of the arithmetic exact in float32: nothing is
    rounded by either side. Large steps put many edges through pixel centres; an ``offset`` of half
    a pixel puts the corners there, and so horizontal and vertical edges.
    """
    random = np.random.default_rng(seed)
    side, reach = 512 * GRID // step, 24 * GRID // step
    middle = random.integers(reach, side - reach, (count, 1, 2))
    grid = (middle + random.integers(-reach, reach + 1, (count, 3, 2))) * step + offset
    w = 2.0 ** random.integers(-2, 3, (count, 3, 1))
    z = random.integers(-(2**20), 2**20, (count, 3, 1)) / 2.0**20
    ndc = np.concatenate([grid / (256 * GRID) - 1.0, z, np.ones_like(z)], axis=-1)
    clip = (ndc * w).reshape(-1, 4)
    assert (clip.astype(np.float32) == clip).all()
    return make_case(clip, np.arange(3 * count).reshape(-1, 3), (512, 512))


def huge_faces(size, seed, count=100) -> Case:
    """Scatter triangles up to a hundred times larger than the view volume, the eye among them."""
    random = np.random.default_rng(seed)
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=60.0, near=1.0, far=100.0)
    middle = random.normal(size=(count, 1, 3)) * [20.0, 20.0, 30.0]
    scale = np.exp(random.uniform(np.log(2.0), np.log(60.0), (count, 1, 1)))
    corners = middle + random.normal(size=(count, 3, 3)) * scale
    points = np.concatenate([corners.reshape(-1, 3), np.ones((3 * count, 1))], axis=1)
    clip = points @ camera.projection_matrix(size).T
    return make_case(clip, np.arange(3 * count).reshape(-1, 3), size)


# What exact arithmetic says


def edge(a, b, p):
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def covers(triangle, pixel) -> bool:
    """Tell whether a triangle on the grid covers a pixel (column, row), by the top-left rule."""
    a, b, c = triangle
    if edge(a, b, c) < 0:
        b, c = c, b
    if edge(a, b, c) == 0:
        return False
    p = (pixel[0] * GRID + GRID // 2, pixel[1] * GRID + GRID // 2)
    for u, v in ((a, b), (b, c), (c, a)):
        value, dx, dy = edge(u, v, p), v[0] - u[0], v[1] - u[1]
        if value < 0 or (value == 0 and not (dy < 0 or (dy == 0 and dx > 0))):
            return False
    return True


def roundings(case: Case, face) -> list:
    """Return the triangles on the grid that Mesa may make of a face; first the right one."""
    choices = []
    for vertex in case.faces[face]:
        for axis in range(2):
            exact = case.xy[vertex, axis] * GRID
            right, low = int(np.rint(exact)), int(np.floor(exact))
            is_open = abs(exact - low - 0.5) <= case.error[vertex, axis] * GRID
            choices.append([right, 2 * low + 1 - right] if is_open else [right])
    return [[k[0:2], k[2:4], k[4:6]] for k in itertools.product(*choices)]


def visible_outline(case: Case, face) -> NDArray[np.float64]:
    """Return the screen polygon of a face between the near and far plane, (N, 2) pixels."""
    polygon = list(case.clip[case.faces[face]])
    for sign in (1.0, -1.0):
        kept = []
        for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            here, there = a[3] + sign * a[2], b[3] + sign * b[2]
            if here >= 0.0:
                kept.append(a)
            if (here >= 0.0) != (there >= 0.0):
                kept.append(a + here / (here - there) * (b - a))
        polygon = kept
    outline = np.array(polygon).reshape(-1, 4)
    half = np.array(case.size) / 2.0
    return outline[:, :2] / outline[:, 3:] * [1.0, -1.0] * half + half


def distance_to_outline(outline, pixel) -> float:
    """Return how far a pixel's centre is inside a convex polygon, pixels; outside is negative."""
    if len(outline) == 0:
        return -np.inf
    along = np.roll(outline, -1, axis=0) - outline
    offset = np.array(pixel) + 0.5 - outline
    squares = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
    share = np.clip((offset * along).sum(axis=1) / squares, 0.0, 1.0)
    distance = float(np.linalg.norm(offset - share[:, None] * along, axis=1).min())
    sides = along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0]
    return distance if (sides >= 0.0).all() or (sides <= 0.0).all() else -distance


def depth_plane(case: Case, face, columns, rows):
    """
    Return window z of a face's plane at pixels, and a bound for Mesa's error there.

    Mesa's vertices are not on the grid and off by their float32 error, which moves the plane by its
    slope times that. Its float32 arithmetic is, for z0 at vertex 0 and gradient g:
    ``g = da01 * (dy20 / area) - da20 * (dy01 / area)`` (at most 6 roundings of each product, and of
    the area 3 in each of its two products), ``c = z0 - (g.x x0 + g.y y0)``, ``z = c + g.x x + g.y
    y`` (5 roundings of terms no larger than ``|g| * position``), and 4 of z itself.
    """
    a, b, c = case.faces[face]
    (x0, y0), (x1, y1), (x2, y2) = case.xy[a], case.xy[b], case.xy[c]
    z0, z1, z2 = case.z[a], case.z[b], case.z[c]
    products = (x0 - x1) * (y2 - y0), (x2 - x0) * (y0 - y1)
    area = products[0] - products[1]
    terms_x = (z0 - z1) * (y2 - y0) / area, (z2 - z0) * (y0 - y1) / area
    terms_y = (z2 - z0) * (x0 - x1) / area, (z0 - z1) * (x2 - x0) / area
    gx, gy = terms_x[0] - terms_x[1], terms_y[0] - terms_y[1]
    dx, dy = columns + 0.5 - x0, rows + 0.5 - y0
    moved = SNAP + case.error[[a, b, c]].max()
    condition = (abs(products[0]) + abs(products[1])) / abs(area)
    spread = max(z0, z1, z2) - min(z0, z1, z2)
    bound = (abs(gx) + abs(gy)) * moved + UNIT * (
        4.0
        + 3.0 * condition * spread
        + 6.0 * (abs(terms_x[0]) + abs(terms_x[1])) * np.abs(dx)
        + 6.0 * (abs(terms_y[0]) + abs(terms_y[1])) * np.abs(dy)
        + 5.0 * (abs(gx) * np.maximum(columns + 0.5, x0) + abs(gy) * np.maximum(rows + 0.5, y0))
    )
    return z0 + gx * dx + gy * dy, bound


def cut_depth_plane(case: Case, face, column, row):
    """
    Return window z of the plane of a face that Mesa cuts at a pixel, and a bound for its error.

    Vertices may be behind the eye, so the plane is solved for before the division. Mesa's new
    vertices are as far off as ``NEAR_EDGE`` says, its plane starts at the picture's corner.
    """
    x, y, z, w = case.clip[case.faces[face]].T
    width, height = case.size
    screen = np.stack([(w + x) * width / 2.0, (w - y) * height / 2.0, w], axis=-1)
    try:
        gx, gy, constant = np.linalg.solve(screen, (z + w) / 2.0)
    except np.linalg.LinAlgError:
        return 0.5, np.inf
    bound = (abs(gx) + abs(gy)) * NEAR_EDGE
    bound += 16.0 * UNIT * (1.0 + abs(gx) * width + abs(gy) * height)
    return gx * (column + 0.5) + gy * (row + 0.5) + constant, bound


# Explaining a difference


class Claim(NamedTuple):
    """What is known of one face at one pixel."""

    right: set[bool]  # whether it covers the pixel; both if exact arithmetic leaves it open
    possible: set[bool]  # whether it may cover the pixel in Mesa's arithmetic
    depth: float  # window z
    depth_error: float


NO_FACE = Claim({True}, {True}, 1.0, 0.0)
"""The background."""


def claim(case: Case, face, pixel) -> Claim:
    if face < 0:
        return NO_FACE
    if not case.is_cut[face]:
        options = [covers(triangle, pixel) for triangle in roundings(case, face)]
        return Claim({options[0]}, set(options), *depth_plane(case, face, *pixel))
    inside = distance_to_outline(visible_outline(case, face), pixel)
    open_or_not = {True, False} if abs(inside) <= NEAR_EDGE else {inside > 0.0}
    return Claim(open_or_not, open_or_not, *cut_depth_plane(case, face, *pixel))


def explain(case: Case, pixel, ours, theirs) -> str:
    """
    Return why OpenGL may show another face at a pixel.

    A picture holds if the face it shows covers the pixel, and the other one does not or is not
    nearer. Ours must hold on the exact grid; theirs for one of the roundings and depths that
    float32 may give Mesa.
    """
    us, them = claim(case, ours, pixel), claim(case, theirs, pixel)
    resolved = us.depth_error + them.depth_error + DEPTH_STEP
    ours_holds = True in us.right and (
        (theirs >= 0 and False in them.right) or us.depth <= them.depth + resolved
    )
    theirs_holds = True in them.possible and (
        (ours >= 0 and False in us.possible) or them.depth <= us.depth + resolved
    )
    if not ours_holds or not theirs_holds:
        return "unexplained"
    for face, known in ((ours, us), (theirs, them)):
        if len(known.possible) == 2:
            return "edge of a cut face" if case.is_cut[face] else "vertex at a snapping boundary"
    return "depths closer than OpenGL resolves"


def count_reasons(case: Case, theirs, ours) -> Counter:
    """Return how many pixels differ for which reason."""
    rows, columns = np.nonzero(theirs != ours)
    return Counter(
        explain(case, (int(column), int(row)), int(ours[row, column]), int(theirs[row, column]))
        for row, column in zip(rows, columns, strict=True)
    )


def assert_same_faces(case: Case, name) -> None:
    """Check that at least 99.99 % of the pixels show the same face, the others with a reason."""
    drawn, visibility = draw_both(case)
    assert (visibility.face_id >= 0).mean() > 0.1, "the picture is empty"
    reasons = count_reasons(case, drawn.face_id, visibility.face_id)
    coverage = int(((drawn.face_id >= 0) != (visibility.face_id >= 0)).sum())
    pixels, differing = drawn.face_id.size, sum(reasons.values())
    report = f"{name}: {pixels} pixels, {differing} differ ({coverage} in coverage): {reasons}"
    print(report)
    assert reasons["unexplained"] == 0, report
    assert differing <= 1e-4 * pixels, report


# Faces


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", SIZES)
def test_soup_shows_the_faces_that_opengl_shows(size, seed):
    assert_same_faces(soup(size, seed), f"soup {seed}, {size}")


@pytest.mark.parametrize("seed", range(3))
def test_a_face_cut_by_any_planes_covers_what_it_covers_in_opengl(seed):
    """Draw faces one by one, as behind each other their mistakes would not be seen."""
    size = (320, 240)
    everything = huge_faces(size, seed)
    pixels, reasons, depth_error = 0, Counter(), 0.0
    for number in range(len(everything.faces)):
        case = everything._replace(
            faces=everything.faces[[number]], is_cut=everything.is_cut[[number]]
        )
        drawn, visibility = draw_both(case)
        reasons += count_reasons(case, drawn.face_id, visibility.face_id)
        rows, columns = np.nonzero((drawn.face_id == 0) & (visibility.face_id == 0))
        pixels += len(rows)
        if len(rows) and case.is_cut[0]:
            depth, bound = cut_depth_plane(case, 0, columns, rows)
            error = np.abs(0.5 * visibility.depth[rows, columns] + 0.5 - depth)
            depth_error = max(depth_error, float((error / bound).max()))
    report = f"huge faces {seed}: {pixels} pixels covered by both, {dict(reasons)}"
    report += f", depth at most {depth_error:.2f} of the bound"
    print(report)
    assert pixels > 100_000
    assert reasons["unexplained"] == 0, report
    assert sum(reasons.values()) <= 1e-4 * pixels, report
    assert depth_error <= 1.0, report


@pytest.mark.parametrize("eye", [(0, 3, 9), (4, 5, 9), (1, 9, 3), (2, 3, 5)])
@pytest.mark.parametrize("size", SIZES)
def test_teapot_shows_the_faces_that_opengl_shows(size, eye):
    camera = rj.PerspectiveCamera(eye, (0.0, 1.5, 0.0), fov_y=40.0)
    assert_same_faces(model("teapot.obj", camera, size), f"teapot from {eye}, {size}")


@pytest.mark.parametrize("size", SIZES)
def test_torus_knot_by_parallel_rays_shows_the_faces_that_opengl_shows(size):
    scene = rj.load(MODELS / "torus_knot.obj")
    camera = rj.fit_camera(scene, projection="orthographic")
    assert_same_faces(model("torus_knot.obj", camera, size), f"torus knot, {size}")


@pytest.mark.parametrize(
    ("step", "offset"), [(1, 0), (64, 0), (128, 0), (256, 0), (256, 128), (1024, 128)]
)
def test_exact_vertices_leave_no_pixel_of_coverage_different_even_on_ties(step, offset):
    case = lattice(step, seed=step, offset=offset)
    constant = case.clip.copy()
    # Constant, distinct depths: which face is in front is beyond doubt.
    constant[:, 2] = np.repeat(np.arange(len(case.faces)) / 4096.0, 3) * constant[:, 3]
    case = make_case(constant, case.faces, case.size)
    drawn, visibility = draw_both(case)
    assert (visibility.face_id >= 0).sum() > 100_000
    np.testing.assert_array_equal(visibility.face_id, drawn.face_id)


@pytest.mark.parametrize("cause", ["shift", "scale"])
def test_a_hundredth_of_a_pixel_cannot_be_explained(cause):
    case = soup((512, 512), seed=0)
    moved = case.clip.copy()
    if cause == "shift":
        moved[:, 0] += 0.01 / 256.0 * moved[:, 3]
    else:
        moved[:, 1] *= 1.0 + 0.02 / 512.0
    drawn = draw_faces(case.clip, case.faces, case.size)
    visibility = rj.rasterize(moved, case.faces, case.size)
    reasons = count_reasons(case, drawn.face_id, visibility.face_id)
    assert reasons["unexplained"] > 100, reasons


# Depth


def exact_depth(case: Case, face, column, row) -> Fraction:
    """Return NDC z of a face on the grid at a pixel's centre, in rational arithmetic."""
    corners = roundings(case, face)[0]
    p = (column * GRID + GRID // 2, row * GRID + GRID // 2)
    depths = [Fraction(z) / Fraction(w) for z, w in case.clip[case.faces[face], 2:].tolist()]
    weights = [edge(corners[(k + 1) % 3], corners[(k + 2) % 3], p) for k in range(3)]
    return sum(Fraction(k) * z for k, z in zip(weights, depths, strict=True)) / sum(weights)


def agreeing_pixels(case: Case, drawn: Drawn, visibility: rj.RasterizedFaces):
    """Yield each face with the pixels that both show it at; faces cut by Mesa are left out."""
    agree = (drawn.face_id == visibility.face_id) & (visibility.face_id >= 0)
    rows, columns = np.nonzero(agree)
    faces = visibility.face_id[rows, columns]
    order = np.argsort(faces, kind="stable")
    for group in np.split(order, np.nonzero(np.diff(faces[order]))[0] + 1):
        face = int(faces[group[0]])
        if not case.is_cut[face]:
            yield face, columns[group], rows[group]


@functools.cache
def depth_case(name):
    """Return a case with both of its drawings."""
    if name == "soup":
        case = soup((640, 480), seed=1)
    elif name == "teapot":
        camera = rj.PerspectiveCamera((4, 5, 9), (0, 1.5, 0), fov_y=40.0)
        case = model("teapot.obj", camera, (512, 512))
    else:
        case = lattice(1, seed=5)
    return case, *draw_both(case)


@pytest.mark.parametrize("name", ["soup", "teapot", "lattice"])
def test_depth_is_opengl_s_to_within_what_its_arithmetic_loses(name):
    case, drawn, visibility = depth_case(name)
    pixels, worst, largest = 0, 0.0, 0.0
    for face, columns, rows in agreeing_pixels(case, drawn, visibility):
        ours = 0.5 * visibility.depth[rows, columns].astype(np.float64) + 0.5
        _, bound = depth_plane(case, face, columns, rows)
        for theirs in (drawn.depth, drawn.stored_depth):
            difference = np.abs(ours - theirs[rows, columns])
            worst = max(worst, float((difference / (bound + DEPTH_STEP)).max()))
            largest = max(largest, float(difference.max()))
        pixels += len(rows)
    report = f"{pixels} pixels, largest difference {largest / DEPTH_STEP:.1f} steps of 24 bits, "
    report += f"at most {worst:.2f} of the bound"
    print(report)
    assert pixels > 50_000
    assert worst <= 1.0, report


def test_depth_of_exact_vertices_is_opengl_s_to_one_step_and_one_rounding():
    """
    Nothing is rounded to the grid here, so only float32 interpolation is left.

    Mesa's plane starts at the picture's corner: ``|gradient| * 512`` is what its roundings are
    relative to. Faces whose window z changes by less than 1/4 over the picture's width are held to
    2**-23 relative plus one step of 24 bits.
    """
    case = lattice(1, seed=7)
    flat = case.clip.copy()
    # Keep a hundredth of the depths' range: the slopes become moderate.
    flat[:, 2] = (np.round(case.z * 2**14) / 2**20 + 0.5) * flat[:, 3]
    case = make_case(flat, case.faces, case.size)
    drawn, visibility = draw_both(case)
    pixels, worst = 0, 0.0
    for face, columns, rows in agreeing_pixels(case, drawn, visibility):
        a, b, c = case.faces[face]
        matrix = np.array([case.xy[b] - case.xy[a], case.xy[c] - case.xy[a]])
        slope = np.linalg.solve(matrix, [case.z[b] - case.z[a], case.z[c] - case.z[a]])
        if np.abs(slope).sum() * 512.0 > 0.25:
            continue
        ours = 0.5 * visibility.depth[rows, columns].astype(np.float64) + 0.5
        difference = np.abs(ours - drawn.stored_depth[rows, columns])
        worst = max(worst, float((difference / (2.0**-23 * ours + DEPTH_STEP)).max()))
        pixels += len(rows)
    print(f"{pixels} pixels, at most {worst:.2f} of the bound")
    assert pixels > 50_000
    assert worst <= 1.0


@pytest.mark.parametrize("name", ["soup", "teapot", "lattice"])
def test_depth_is_the_float32_next_to_the_exact_one(name):
    """Show who is right where the two differ: ours is the correctly rounded value, nearly."""
    case, drawn, visibility = depth_case(name)
    groups = list(agreeing_pixels(case, drawn, visibility))
    random = np.random.default_rng(11)
    ours_off, theirs_off = [], []
    for n in random.choice(len(groups), min(1000, len(groups)), replace=False):
        face, columns, rows = groups[n]
        k = random.integers(len(rows))
        column, row = int(columns[k]), int(rows[k])
        exact = exact_depth(case, face, column, row)
        depth = float(visibility.depth[row, column])
        half_step = 0.5 * float(np.spacing(np.abs(np.float32(exact))))
        ours_off.append(abs(Fraction(depth) - exact) - Fraction(half_step))
        theirs_off.append(abs(Fraction(2.0 * drawn.depth[row, column] - 1.0) - exact))
    print(
        f"{len(ours_off)} pixels: ours at most {float(max(ours_off)):.1e} beyond float32's own "
        f"rounding, OpenGL's off by up to {float(max(theirs_off)):.1e}"
    )
    assert len(ours_off) >= 700
    assert max(ours_off) <= FLOAT64_LOSS


# Lines: the classic exercise


def neighbourhood(mask):
    """Return the pixels that touch a set of pixels or belong to it."""
    padded = np.pad(mask, 1)
    height, width = mask.shape
    near = np.zeros_like(mask)
    for down, across in itertools.product(range(3), repeat=2):
        near |= padded[down : down + height, across : across + width]
    return near


@pytest.mark.parametrize("eye", [(2, 3, 5), (0, 0, 4)])
@pytest.mark.parametrize(
    ("name", "least_equal"),
    [("pyramid.off", 0.6), ("cube.ply", 0.8), ("teapot.obj", 0.8)],
)
def test_wireframe_lies_on_opengl_s(name, least_equal, eye):
    """
    Compare pixel sets; every pixel has one of the other within one pixel.

    They are not the same: OpenGL's lines keep their ends' fractions of a pixel, the classic line
    runs between whole pixels, which moves it by up to half a pixel. Long lines at a small angle,
    as the pyramid's few are, then change rows elsewhere. So the share of equal pixels is a
    property of the scene, measured: 0.63 and 0.79, 0.97 and 0.80, 0.85 and 0.86.
    """
    size = (512, 512)
    scene = rj.load(MODELS / name)
    scene.wireframe = rj.Wireframe("red", mode="only")
    camera = rj.PerspectiveCamera(eye, (0.0, 0.0, 0.0))
    case = model(name, camera, size)
    edges = find_unique_edges(case.faces.astype(np.int32))
    ours = rj.render(scene, camera, size=size, background="white").color[:, :, 1] == 0
    theirs = draw_lines(case.clip, edges, size)
    # At the picture's border the pixel beside may lie outside.
    inside = np.zeros_like(ours)
    inside[1:-1, 1:-1] = True
    equal = (ours & theirs).sum() / max(ours.sum(), theirs.sum())
    print(f"{name} from {eye}: {ours.sum()} and {theirs.sum()} pixels, {equal:.3f} equal")
    assert min(ours.sum(), theirs.sum()) > 900
    assert not (ours & inside & ~neighbourhood(theirs)).any()
    assert not (theirs & inside & ~neighbourhood(ours)).any()
    assert equal >= least_equal


# Colours


@pytest.mark.parametrize("eye", [(2, 3, 5), (0, 0, 4), (1.2, 1.3, 1.4)])
@pytest.mark.parametrize("size", SIZES)
def test_vertex_colors_are_interpolated_as_opengl_does(size, eye):
    """Hold linear light to one 8-bit code; a coarse bound, perspective errors are 50 times it."""
    mesh = rj.load(MODELS / "cube.ply").nodes[0].mesh
    unlit = rj.Mesh(
        mesh.vertices,
        mesh.faces,
        colors=mesh.vertex_colors,
        material=rj.Material("unlit", base_color="white"),
    )
    camera = rj.PerspectiveCamera(eye, (0.0, 0.0, 0.0), near=0.05)
    case = model("cube.ply", camera, size)
    frame = rj.render(unlit, camera, size=size, outputs=("linear", "face_id"))
    drawn = draw_faces(case.clip, case.faces, size, colors=mesh.vertex_colors)
    agree = (frame.face_id == drawn.face_id) & (frame.face_id >= 0)
    difference = np.abs(frame.linear - drawn.color)[agree].max()
    print(f"{agree.sum()} pixels, largest difference {difference * 255.0:.4f} / 255")
    assert agree.sum() > 50_000
    assert difference <= 1.0 / 255.0
