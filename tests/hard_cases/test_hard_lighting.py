"""
Normals stay perpendicular, light stays finite, and a depth map answers what is in shadow.

Shadows are not drawn yet. What they will rest on is: the depth that the engine writes through a
parallel camera at the light. The look-up is done here.
"""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene import transforms as tf

ROOT_HALF = math.sqrt(0.5)

ROUNDING = 4 * float(np.finfo(np.float64).eps)
"""Of a unit vector made from a product of small matrices in float64."""

STORED = float(np.finfo(np.float32).eps)
"""Of a number of size 1 that is stored as float32."""

PRINTED = 5e-4
"""Half a unit of the last of three decimals."""

POWER_ERROR = 1e-5
"""Of the highlight at exponent 32: float32's rounding of the cosine, 32 times, and of log2."""

SQUARE = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
SQUARE_FACES = [[0, 1, 2], [0, 2, 3]]


def unit(vector):
    return np.asarray(vector, float) / np.linalg.norm(vector)


def parallel(side=1.0, size=5, normals=None, transform=None, lights=(), **material):
    """Return the frame of a square in the plane z = 0 seen along z, from +z (or side = -1)."""
    scene = rj.Scene()
    options = {"shading": "phong", "base_color": "white", "specular": 0.0, **material}
    square = rj.Mesh(SQUARE, SQUARE_FACES, normals=normals, material=rj.Material(**options))
    scene.add(square, transform)
    scene.lights = list(lights)
    camera = rj.OrthographicCamera((0, 0, side), (0, 0, 0), near=0.0, far=2.0)
    outputs = ("color", "linear", "normal", "barycentric", "face_id")
    return rj.render(scene, camera, size=(size, size), outputs=outputs, threads=1)


# --- normals --------------------------------------------------------------------------------------

CARRIED = [
    pytest.param(tf.scale((2, 1, 1)), (1, 1, 0), unit((1, 2, 0)), 1, id="stretched",
                 marks=pytest.mark.case("N01")),
    pytest.param(tf.shear(xy=1), (1, 0, 0), (ROOT_HALF, -ROOT_HALF, 0), 1, id="sheared",
                 marks=pytest.mark.case("N02")),
    pytest.param(np.diag([1.0, 1, 0, 1]), (0, 0, 1), (0, 0, 1), 1, id="flattened",
                 marks=pytest.mark.case("N03")),
    # A mirrored square turns its front to -z.
    pytest.param(tf.scale((1, 1, -1)), (0, 3, 4), (0, 0.6, -0.8), -1, id="mirrored",
                 marks=pytest.mark.case("N04")),
]  # fmt: skip


@pytest.mark.parametrize(("transform", "normal", "want", "side"), CARRIED)
def test_normal_matrix_carries_normals_as_the_surface_turns(transform, normal, want, side):
    carried = tf.normal_matrix(transform) @ unit(normal)
    assert np.isfinite(carried).all()
    assert np.abs(unit(carried) - want).max() <= ROUNDING


@pytest.mark.parametrize(("transform", "normal", "want", "side"), CARRIED)
def test_rendered_normals_are_carried_as_the_surface_turns(transform, normal, want, side):
    frame = parallel(side, normals=[normal] * 4, transform=transform)
    seen = frame.normal[frame.face_id >= 0]
    assert len(seen) >= 15
    assert np.abs(seen - np.asarray(want)).max() <= STORED


@pytest.mark.case("N04")
def test_a_mirror_changes_one_sign_of_a_normal():
    normal = tf.normal_matrix(tf.scale((1, 1, -1))) @ (0, 3, 4)
    assert normal.tolist() == [0, 3, -4]


@pytest.mark.case("N01")
def test_the_model_matrix_itself_does_not_carry_normals():
    wrong = unit(tf.scale((2, 1, 1))[:3, :3] @ unit((1, 1, 0)))
    assert np.abs(wrong - unit((2, 1, 0))).max() <= ROUNDING
    tangent = tf.scale((2, 1, 1))[:3, :3] @ (1, -1, 0)
    assert abs(wrong @ tangent) > 1
    assert abs(tf.normal_matrix(tf.scale((2, 1, 1))) @ (1, 1, 0) @ tangent) <= ROUNDING


@pytest.mark.case("N03")
def test_a_singular_matrix_has_no_inverse_but_carries_normals():
    flat = np.diag([1.0, 1.0, 0.0, 1.0])
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.inv(flat)
    assert (tf.normal_matrix(flat) @ (0, 0, 1)).tolist() == [0, 0, 1]


@pytest.mark.case("N05")
@pytest.mark.parametrize(
    "flat", [(0, 0, 1), (1, 1, 1), (0, 4, 2)], ids=["edge twice", "point", "line"]
)
def test_a_face_without_area_adds_nothing_to_its_vertices(flat):
    vertices = [*SQUARE, [0, 0, 0]]  # the last is the middle of vertices 0 and 2
    whole = rj.Mesh(vertices, SQUARE_FACES)
    with_flat = rj.Mesh(vertices, [*SQUARE_FACES, flat])
    assert with_flat.vertex_normals().tobytes() == whole.vertex_normals().tobytes()
    assert whole.vertex_normals()[:4].tolist() == [[0, 0, 1]] * 4
    alone = rj.Mesh(vertices, [flat])
    assert (alone.vertex_normals() == 0).all()
    assert (alone.split_creases().vertex_normals() == 0).all()


@pytest.mark.case("N05")
@pytest.mark.parametrize("shading", ["gouraud", "phong"])
@pytest.mark.filterwarnings("ignore::rasterjit.ViewWarning")
def test_a_zero_normal_is_that_of_its_faces(shading):
    lights = [rj.AmbientLight(intensity=0.25), rj.DirectionalLight((0, 0, -1)),
              rj.PointLight((0, 0, 1))]  # fmt: skip
    given = {"shading": shading, "specular": 1.0, "lights": lights}
    usual = parallel(normals=[[0, 0, 1]] * 4, **given)
    for zeros in (4, 1):
        with pytest.warns(UserWarning, match=f"^{zeros} normals? of length 0 of Mesh"):
            frame = parallel(normals=[[0, 0, 0]] * zeros + [[0, 0, 1]] * (4 - zeros), **given)
        assert (frame.normal == [0, 0, 1]).all()
        assert frame.linear.tobytes() == usual.linear.tobytes()


def tilted(theta):
    """Return vertex normals of the square that lean outwards, to the left and to the right."""
    sine, cosine = tf.sine_cosine(theta)
    return [[-sine, 0, cosine], [sine, 0, cosine], [sine, 0, cosine], [-sine, 0, cosine]]


@pytest.mark.case("N06")
@pytest.mark.parametrize(
    ("theta", "want"), [(0, 1.0), (5, 0.885), (10, 0.613), (15, 0.330), (20, 0.137), (30, 0.010)]
)
def test_a_highlight_between_the_vertices_is_seen_per_pixel_only(theta, want):
    lights = [rj.DirectionalLight((0, 0, -1))]
    centres = {
        shading: parallel(
            normals=tilted(theta), shading=shading, lights=lights,
            base_color="black", specular=1.0, shininess=32.0,
        ).linear[2, 2, 0]
        for shading in ("phong", "gouraud")
    }  # fmt: skip
    assert abs(centres["phong"] - 1.0) <= POWER_ERROR
    assert abs(centres["gouraud"] - want) <= PRINTED
    assert abs(centres["gouraud"] - math.cos(math.radians(theta)) ** 32) <= POWER_ERROR


@pytest.mark.case("N07")
@pytest.mark.parametrize(("theta", "low"), [(10, 0.015), (30, 0.134)])
def test_interpolated_normals_are_brought_to_length_one(theta, low):
    normals = np.array(tilted(theta))
    frame = parallel(normals=normals, lights=[rj.DirectionalLight((0, 0, -1))])
    # What the middle of the square has before: the normals of its face by its weights.
    corners = np.array(SQUARE_FACES)[frame.face_id[2, 2]]
    between = frame.barycentric[2, 2].astype(float) @ normals[corners]
    length = np.linalg.norm(between)
    assert abs(length - math.cos(math.radians(theta))) <= STORED
    assert abs(1 - length - low) <= PRINTED
    assert np.abs(frame.normal[2, 2] - (0, 0, 1)).max() <= STORED
    assert abs(frame.linear[2, 2, 0] - 1.0) <= 2 * STORED


# --- light without a direction --------------------------------------------------------------------

HERE = rj.PointLight((0, 0, 0))
"""At the very point that the middle pixel shows, and in the plane of all others."""


@pytest.mark.case("N08")
@pytest.mark.parametrize("shininess", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("shading", ["flat", "gouraud", "phong"])
@pytest.mark.parametrize(
    "light",
    [HERE, rj.PointLight((0, 0, -1)), rj.DirectionalLight((0, 0, 1)),
     rj.DirectionalLight((1, 0, 0))],
    ids=["at the point", "point behind", "opposite the viewer", "grazing"],
)  # fmt: skip
def test_light_that_does_not_reach_the_side_that_is_seen_adds_nothing(light, shading, shininess):
    frame = parallel(shading=shading, lights=[light], specular=1.0, shininess=shininess)
    assert (frame.linear == [0, 0, 0, 1]).all()
    assert (frame.color == [0, 0, 0, 255]).all()


@pytest.mark.case("N08")
@pytest.mark.parametrize("shininess", [1e-6, 1.0, 32.0, 1e6])
@pytest.mark.parametrize("shading", ["gouraud", "phong"])
def test_highlight_without_a_half_vector_is_between_none_and_full(shading, shininess):
    # Normals that face away make the light opposite the viewer shine on what is seen.
    frame = parallel(
        normals=[(0, 0, -1)] * 4, shading=shading, lights=[rj.DirectionalLight((0, 0, 1))],
        base_color="black", specular=1.0, shininess=shininess,
    )  # fmt: skip
    assert ((frame.linear >= 0) & (frame.linear <= 1)).all()


@pytest.mark.case("N08")
@pytest.mark.parametrize("distance", [1e-3, 1e-10, 1e-20])
def test_light_close_to_its_point_is_finite(distance):
    frame = parallel(lights=[rj.PointLight((0, 0, distance))], specular=1.0)
    assert np.isfinite(frame.linear).all()
    assert (frame.linear >= 0).all()


# --- the edge of what a light reaches -------------------------------------------------------------
# There is no spot light yet. The boundary that there is, N . L = 0, is the same choice: exclusive,
# and reached without a jump. A cone's own cosine test has nothing of the engine in it to hold.


@pytest.mark.case("N09")
@pytest.mark.parametrize("shading", ["flat", "gouraud", "phong"])
@pytest.mark.parametrize("around", [0, 90, 180, 270])
def test_the_boundary_of_light_belongs_to_the_dark(shading, around):
    sine, cosine = tf.sine_cosine(around)
    step = 2.0**-20

    def seen(z):
        light = rj.DirectionalLight((cosine, sine, z))
        return parallel(shading=shading, lights=[light], specular=1.0).linear[..., :3]

    assert (seen(0.0) == 0).all()
    assert (seen(step) == 0).all()
    last = seen(-step)
    assert (last > 0).all()
    for z in (-2 * step, -0.25, -1.0):
        brighter = seen(z)
        assert (brighter > last).all()
        last = brighter
    only_light = parallel(shading=shading, lights=[rj.DirectionalLight((cosine, sine, -step))])
    assert (np.abs(only_light.linear[..., :3] - step) <= STORED * step).all()


# --- shadows --------------------------------------------------------------------------------------

SIDE = 2.0
"""What the depth map shows of x and y, scene units, its middle at the origin."""
EYE = 8.0
"""Height of the light above the plane z = 0; a power of two keeps every depth here exact."""


def plane(zx, zy, height=0.0, low=(-2, -2), high=(2, 2)):
    """Return the part of the plane z = height + zx x + zy y between two corners."""
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    return rj.Mesh([[x, y, height + zx * x + zy * y] for x, y in corners], SQUARE_FACES)


def depth_map(*meshes, texels=16, near=0.0):
    """Return the depth below a light at z = EYE that shines along -z, (texels, texels)."""
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh)
    camera = rj.OrthographicCamera((0, 0, EYE), (0, 0, 0), height=SIDE, near=near, far=2 * EYE)
    return rj.render(scene, camera, size=(texels, texels), outputs="depth", threads=1).depth


def is_lit(depths, x, y, z, bias, shift=(0, 0)):
    """Look a point up in the nearest texel; beyond the map everything is lit."""
    texels = len(depths)
    column = math.floor((x + SIDE / 2) * texels / SIDE) + shift[0]
    row = math.floor((SIDE / 2 - y) * texels / SIDE) + shift[1]
    if not (0 <= column < texels and 0 <= row < texels):
        return True
    return EYE - z <= float(depths[row, column]) + bias


def lit_share(depths, x, y, z, bias, radius):
    """Filter the answers of (2 radius + 1)**2 texels."""
    reach = range(-radius, radius + 1)
    answers = [is_lit(depths, x, y, z, bias, shift) for shift in itertools.product(reach, reach)]
    return Fraction(sum(answers), len(answers))


def points_of_the_map(texels=16, margin=0):
    """Yield points at the corners of every texel (as near as the texel has them) and inside."""
    size = SIDE / texels
    inner = range(margin, texels - margin)
    for column, row in itertools.product(inner, inner):
        for across, down in itertools.product((0.0, 0.5, 1 - 2.0**-10), repeat=2):
            # A row holds its upper border: y is measured downwards from the top.
            yield (column + across) * size - SIDE / 2, SIDE / 2 - (row + down) * size


def acne(zx, zy, bias, radius=0):
    """Count the points of a slope that lie in their own shadow."""
    depths = depth_map(plane(zx, zy))
    return sum(
        lit_share(depths, x, y, zx * x + zy * y, bias, radius) < 1
        for x, y in points_of_the_map(margin=radius)
    )


SLOPES = [(1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (0.5, 0.25), (-0.25, -1)]
TEXEL = SIDE / 16


@pytest.mark.case("S01")
@pytest.mark.parametrize(("zx", "zy"), SLOPES)
def test_bias_of_half_a_texel_along_the_slope_is_needed_and_enough(zx, zy):
    required = TEXEL / 2 * (abs(zx) + abs(zy))
    assert acne(zx, zy, required) == 0
    assert acne(zx, zy, 0.98 * required) > 0


@pytest.mark.case("S01")
def test_bias_at_45_degrees_and_an_eighth_is_a_sixteenth():
    assert TEXEL == 1 / 8
    assert acne(1, 0, 0.0625) == 0
    assert acne(1, 0, 0.98 * 0.0625) > 0
    assert acne(0, 0, 0.0) == 0  # a level plane needs none


@pytest.mark.case("S02")
@pytest.mark.parametrize("radius", [1, 2])
@pytest.mark.parametrize(("zx", "zy"), [(1, 0), (-1, 1), (0.5, 0.25)])
def test_a_filter_needs_the_bias_of_its_width(zx, zy, radius):
    required = (radius + 0.5) * TEXEL * (abs(zx) + abs(zy))
    assert acne(zx, zy, required, radius) == 0  # every share is exactly 1
    assert acne(zx, zy, 0.98 * required, radius) > 0


@pytest.mark.case("S02")
@pytest.mark.parametrize("radius", [0, 1, 2])
def test_the_edge_of_a_filtered_shadow_falls_in_whole_shares(radius):
    # The blocker covers the left half of the map.
    depths = depth_map(plane(0, 0), plane(0, 0, 1.0, high=(0, 2)))
    columns = range(8 - radius - 1, 8 + radius + 1)
    shares = [lit_share(depths, (c - 7.5) * TEXEL, 0.01, 0, 0.0, radius) for c in columns]
    width = 2 * radius + 1
    assert shares == [Fraction(k, width) for k in range(width + 1)]


@pytest.mark.case("S03")
@pytest.mark.parametrize(("zx", "zy"), [(1, 1), (1, -1), (-0.5, -0.5)])
def test_the_larger_slope_alone_is_too_little_on_the_diagonal(zx, zy):
    steeper = max(abs(zx), abs(zy))
    assert TEXEL / 2 * (abs(zx) + abs(zy)) == 2 * (TEXEL / 2 * steeper)
    assert acne(zx, zy, TEXEL / 2 * steeper) > 0
    assert acne(zx, zy, TEXEL * steeper) == 0


@pytest.mark.case("S04")
@pytest.mark.parametrize(("heights", "casts"), [(2.0, True), (0.5, False), (1.0, False)])
def test_a_blocker_closer_than_the_bias_casts_no_shadow(heights, casts):
    bias = 1 / 16
    blocker = plane(0, 0, heights * bias, (-0.5, -0.5), (0.5, 0.5))
    depths = depth_map(plane(0, 0), blocker)
    assert is_lit(depths, 0.1, 0.1, 0, bias) == (not casts)
    assert is_lit(depths, 0.9, 0.1, 0, bias)
    assert not is_lit(depths, 0.1, 0.1, 0, 0.0)  # without a bias all of them do


@pytest.mark.case("S05")
@pytest.mark.parametrize("side", ["left", "right", "bottom", "top"])
def test_a_shadow_at_the_border_of_the_map_does_not_come_out_on_the_other_side(side):
    inner, outer = SIDE / 2 - TEXEL, SIDE / 2
    blocked = {
        "left": ((-outer, -2), (-inner, 2)), "right": ((inner, -2), (outer, 2)),
        "bottom": ((-2, -outer), (2, -inner)), "top": ((-2, inner), (2, outer)),
    }[side]  # fmt: skip
    depths = depth_map(plane(0, 0), plane(0, 0, 1.0, *blocked))
    border = outer - TEXEL / 2
    away = {"left": (-1, 0), "right": (1, 0), "bottom": (0, -1), "top": (0, 1)}[side]
    assert not is_lit(depths, away[0] * border, away[1] * border, 0, 0.0)
    assert is_lit(depths, -away[0] * border, -away[1] * border, 0, 0.0)
    beyond = outer + TEXEL / 2
    assert is_lit(depths, away[0] * beyond, away[1] * beyond, 0, 0.0)
    assert is_lit(depths, -away[0] * beyond, -away[1] * beyond, 0, 0.0)
    # The whole border line is in shadow, and nothing else.
    dark = [(x, y) for x, y in points_of_the_map() if not is_lit(depths, x, y, 0, 0.0)]
    assert len(dark) == 16 * 9
    assert all(x * away[0] + y * away[1] >= inner - TEXEL * 2.0**-9 for x, y in dark)


@pytest.mark.case("S05")
def test_what_is_behind_the_light_casts_no_shadow_and_gets_none():
    behind = plane(0, 0, EYE + 1)
    depths = depth_map(plane(0, 0), behind)
    assert (depths == EYE).all()
    assert is_lit(depths, 0, 0, 0, 0.0)
    assert is_lit(depths, 0, 0, EYE + 1, 0.0)
    # At the light's own plane it is in the map: the near plane is inclusive.
    assert (depth_map(plane(0, 0), plane(0, 0, EYE)) == 0).all()


def silhouette_error(depths, a, b, c):
    """
    Return the square of how far a texel's answer reaches across the edge a x + b y = c.

    The blocker is where a x + b y > c, one unit above the plane z = 0.
    """
    texels = len(depths)
    size = Fraction(SIDE) / texels
    worst = Fraction(0)
    for row, column in itertools.product(range(texels), repeat=2):
        is_dark = depths[row, column] < EYE
        for down, across in itertools.product((0, 1), repeat=2):
            x, y = (column + across) * size - 1, 1 - (row + down) * size
            beyond = a * x + b * y - c
            if (beyond < 0) if is_dark else (beyond > 0):
                worst = max(worst, beyond**2 / (a * a + b * b))
    return worst


def half_plane(a, b, c):
    """Return a triangle, one unit above z = 0, that shows a x + b y > c within the map."""
    foot = np.array([a, b]) * c / (a * a + b * b)
    along, across = np.array([-b, a]), np.array([a, b])
    corners = [foot - 16 * along, foot + 16 * along, foot + 16 * across]
    return rj.Mesh([[*corner, 1.0] for corner in corners], [[0, 1, 2]])


@pytest.mark.case("S06")
def test_a_diagonal_silhouette_is_off_by_half_a_texels_diagonal_and_half_that_when_doubled():
    # The edge runs through the centres of texels: the worst there is.
    errors = [
        silhouette_error(depth_map(plane(0, 0), half_plane(1, 1, 0), texels=n), 1, 1, Fraction(0))
        for n in (8, 16, 32)
    ]
    assert errors == [Fraction(SIDE / n) ** 2 / 2 for n in (8, 16, 32)]
    assert errors[0] == 4 * errors[1] == 16 * errors[2]


@pytest.mark.case("S06")
@pytest.mark.parametrize(("a", "b", "c"), [(1, 0, 0.25), (1, 2, 0.3), (-3, 1, 0.1), (2, -5, -0.7)])
def test_no_silhouette_is_off_by_more_than_half_a_texels_diagonal(a, b, c):
    for texels in (8, 16, 32):
        depths = depth_map(plane(0, 0), half_plane(a, b, c), texels=texels)
        error = silhouette_error(depths, a, b, Fraction(c))
        # A texel's centre decides, and the edge is snapped by up to half a step in x and in y.
        bound = (Fraction(1, 2) + Fraction(1, 512)) * Fraction(SIDE) / texels
        assert error <= 2 * bound**2
        assert (depths < EYE).any()
        assert (depths == EYE).any()
