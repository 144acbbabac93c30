"""Depths are compared as each format rounds them: against exact arithmetic, effect by effect."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.pipeline.geometry import projection
from rasterjit.pipeline.records import Faces, Objects
from rasterjit.pipeline.visibility import tile_rasterizer as visibility
from rasterjit.pipeline.visibility import visibility_pass as stages
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.rendering.planning import list_buffers, list_kernels
from rasterjit.runtime import threads
from rasterjit.scene import transforms
from rasterjit.scene.quality import LEVELS
from rasterjit.survey.depth_format import make_depth_format

FORMATS = LEVELS["depth_format"]
OTHERS = [name for name in FORMATS if name != "float32-reversed"]
BITS = {"unorm16": 16, "unorm24": 24}
MANTISSA = {"float32": 24, "float32-reversed": 24, "float64": 53}

SURE = Fraction(1, 2**48)
"""Share of a value by which float64 arithmetic may move it before it is rounded to a format."""


def quality(name, **others):
    return rj.Quality(depth_format=name, **others)


# --- the twin: exact depths -----------------------------------------------------------------------


def share_of_range(distance, near, far):
    """Return the exact depth of a distance, 0 at the near plane and 1 at the far one."""
    if far == math.inf:
        return 1 - near / distance
    return far * (distance - near) / (distance * (far - near))


def rounded(value, digits):
    """Round an exact value to so many binary digits, half to even."""
    if value == 0:
        return value
    exponent = math.frexp(float(value))[1] - digits
    unit = Fraction(2) ** exponent
    return round(value / unit) * unit


def exact_depth(name, distance, near, far, error=0):
    """Return what a format makes of a distance, greater is nearer; moved by a relative error."""
    if name in BITS:
        value = (1 - share_of_range(distance, near, far)) * (2 ** BITS[name] - 1)
        return math.floor(value * (1 + error) + Fraction(1, 2) * (1 + error))
    if name == "float32":
        return -rounded(share_of_range(distance, near, far) * (1 + error), MANTISSA[name])
    return rounded(near / distance * (1 + error), MANTISSA[name])


def is_certain(name, distance, near, far):
    """Tell whether no rounding in float64 changes what a format makes of a distance."""
    if name == "float64":
        return True
    ends = {exact_depth(name, distance, near, far, error) for error in (-SURE, 0, SURE)}
    return len(ends) == 1


def card(distance):
    """Return a square all over the view of an eye at the origin that looks down -z."""
    x, z = 2.0 * float(distance), -float(distance)
    return rj.Mesh([[-x, -x, z], [x, -x, z], [x, x, z], [-x, x, z]], [[0, 1, 2], [0, 2, 3]])


def looking(near=0.125, far=math.inf, **options):
    return rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=60.0, near=near, far=far, **options)


def seen(cards, camera, name, outputs=("object_id",), size=(3, 2), **others):
    scene = rj.Scene()
    for mesh in cards:
        scene.add(mesh)
    return rj.render(
        scene, camera, size=size, outputs=outputs, quality=quality(name, **others), threads=1
    )


@pytest.mark.parametrize("far", [Fraction(1024), math.inf])
@pytest.mark.parametrize("name", FORMATS)
def test_planes_are_ordered_as_exact_arithmetic_orders_their_rounded_depths(name, far):
    """Where a format makes the same of two distances, the lower object is seen: the farther one."""
    rng = np.random.default_rng(5)
    near, found = Fraction(1, 8), []
    camera = looking(float(near), float(far))
    for _ in range(30):
        nearer = Fraction(float(np.round(2.0 ** rng.uniform(-2, 9.5) * 2**20) / 2**20))
        step = Fraction(float(2.0 ** rng.integers(-19, 1)))
        pair = nearer, nearer + step * Fraction(int(rng.integers(1, 9)))
        if not all(is_certain(name, distance, near, far) for distance in pair):
            continue
        depths = [exact_depth(name, distance, near, far) for distance in pair]
        assert depths[0] >= depths[1]
        frame = seen([card(pair[1]), card(pair[0])], camera, name)
        assert (frame.object_id == (1 if depths[0] > depths[1] else 0)).all(), pair
        found.append(depths[0] > depths[1])
    assert len(found) > 20
    if name in ("unorm16", "unorm24", "float32"):
        assert 0 < sum(found) < len(found)


@pytest.mark.parametrize("far", [Fraction(4096), math.inf])
@pytest.mark.parametrize("name", FORMATS)
def test_the_depth_of_a_frame_is_that_of_the_step_it_was_rounded_to(name, far):
    near, differing = Fraction(1, 8), 0
    for distance in (Fraction(1, 4), Fraction(3), Fraction(177, 4), Fraction(901, 2)):
        frame = seen([card(distance)], looking(float(near), float(far)), name, ("depth",))
        step = exact_depth(name, distance, near, far)
        if name in BITS or name == "float32":
            nearness = Fraction(step, 2 ** BITS[name] - 1) if name in BITS else 1 + step
            per_w = nearness / near
            if far != math.inf:
                per_w += (1 - nearness) / far
            told = 1 / per_w if per_w else math.inf
        else:
            told = near / step
        assert frame.depth == pytest.approx(float(told), rel=1e-6)
        differing += abs(float(told) - distance) > 1e-3 * distance
    assert (differing > 0) == (name == "unorm16")


def test_depths_beyond_the_last_step_before_an_infinite_far_plane_are_infinite():
    # A format that holds the depth of nothing in view is refused.
    with pytest.raises(
        ValueError, match=r"^camera\.near must be at least 7\.71, .* 1e\+06 away; got"
    ):
        seen([card(1e6)], looking(), "unorm16", ("depth",))
    scrap = rj.Mesh([[-1, -1, -1], [-0.3, -1, -1], [-1, -0.3, -1]], [[0, 1, 2]])
    frame = seen([card(1e6), scrap], looking(), "unorm16", ("depth", "object_id"))
    assert (frame.object_id == 0).sum() >= 4
    assert (np.isinf(frame.depth) == (frame.object_id == 0)).all()


@pytest.mark.parametrize("name", FORMATS)
def test_of_equal_depths_the_lower_face_is_seen(name):
    frame = seen([card(7.3), card(7.3), card(7.3)], looking(), name)
    assert (frame.object_id == 0).all()


def strips(gap):
    """
    Return two rows of strips that lean a little, the second a gap nearer, and a camera.

    From left to right 1.5 to 400 units away. The farther row is the lower object: where a format
    can not tell them apart it is seen.
    """
    meshes, count = [], 24
    for shift in (0.0, gap):
        corners = []
        for n in range(count):
            distance = 1.5 * (400.0 / 1.5) ** (n / (count - 1))
            left, right = (0.7 * ((n + k) / count - 0.5) for k in range(2))
            for x, y, lean in (
                (left, -0.5, 1),
                (right, -0.5, 1),
                (right, 0.5, 1.2),
                (left, 0.5, 1.2),
            ):
                far = distance * lean
                corners.append([x * far, y * far, shift - far])
        first = 4 * np.arange(count)[:, None]
        faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
        meshes.append(rj.Mesh(corners, faces))
    return meshes, looking(0.1, 1000.0)


def wrong_pixels(name, gap=1e-3, **others):
    meshes, camera = strips(gap)
    frame = seen(meshes, camera, name, size=(64, 96), **others)
    assert (frame.object_id >= 0).sum() > 3000
    return int((frame.object_id == 0).sum())


def test_a_millimetre_is_lost_at_fewer_pixels_the_more_accurate_the_format():
    counts = {name: wrong_pixels(name) for name in FORMATS}
    assert counts["unorm16"] > 2 * counts["unorm24"] > 0
    # From half the range on float32 has the steps of 24 bits, but for where each begins.
    assert 0 < counts["float32"] <= 1.02 * counts["unorm24"]
    assert counts["float32-reversed"] == counts["float64"] == 0


def test_float64_tells_apart_what_float32_does_not():
    pair = [card(10000.0001), card(10000.0)]
    assert (seen(pair, looking(), "float32-reversed").object_id == 0).all()
    assert (seen(pair, looking(), "float64").object_id == 1).all()


@pytest.mark.parametrize("name", FORMATS)
def test_several_samples_compare_depths_in_the_same_format(name):
    meshes, camera = strips(1e-3)
    for mesh, color in zip(meshes, ("red", "blue"), strict=True):
        mesh.material = rj.Material("unlit", color)
    one, four = (
        seen(meshes, camera, name, ("linear", "object_id"), (64, 96), samples=samples)
        for samples in (1, 4)
    )
    # Alike but for the pixels where neighbouring samples differ.
    red = [frame.linear[..., 0][one.object_id >= 0].mean() for frame in (one, four)]
    assert red[1] == pytest.approx(red[0], abs=0.03)
    assert (red[0] > 0.0) == (name in ("unorm16", "unorm24", "float32"))


@pytest.mark.parametrize(("name", "standing"), [("unorm16", "tied"), ("float64", "hidden")])
def test_a_pixel_is_explained_by_the_depths_of_the_format(name, standing):
    scene = rj.Scene()
    for distance in (100.0, 100.001):
        scene.add(card(distance))
    camera = looking(0.1, 1000.0)
    told = rj.explain_pixel(scene, camera, (4, 3), 2, 1, quality=quality(name)).faces
    assert [face.standing for face in told] == ["visible", standing]
    for face, distance in zip(told, (Fraction(100), Fraction("100.001")), strict=True):
        exact = exact_depth(name, distance, Fraction(1, 10), Fraction(1000))
        assert face.stored_depth == pytest.approx(float(exact), rel=1e-12)
        assert face.depth == pytest.approx(100.0, rel=0.01 if name == "unorm16" else 2e-5)


# --- cameras --------------------------------------------------------------------------------------


def tilted_card():
    corners = [[-8.0, -6.0, -5.0], [9.0, -6.0, -11.0], [9.0, 7.0, -17.0], [-8.0, 7.0, -8.0]]
    return rj.Mesh(corners, [[0, 1, 2], [0, 2, 3]])


def cameras():
    plain = looking(0.5, 60.0)
    clip = plain.projection_matrix((40, 30))
    tilted = clip.copy()
    # A near plane that is not at a right angle to the line of sight.
    tilted[2, :2] = 0.05, -0.03
    return {
        "perspective": plain,
        "infinite": looking(0.5),
        "parallel": rj.OrthographicCamera((0, 0, 0), (0, 0, -1), height=9.0, near=0.5, far=60.0),
        "matrices": rj.MatrixCamera(np.eye(4), clip),
        "tilted near plane": rj.MatrixCamera(np.eye(4), tilted),
        "parallel matrices": rj.MatrixCamera(
            np.eye(4), transforms.orthographic(-6, 6, -4.5, 4.5, 0.5, 60.0)
        ),
    }


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("which", cameras())
def test_every_camera_tells_its_depth_in_every_format(which, name):
    camera, step = cameras()[which], {"unorm16": 2e-3, "unorm24": 1e-5}.get(name, 3e-6)
    if which == "tilted near plane":
        # z changes across the picture: by as much as vertices are moved to the grid.
        step = max(step, 2e-4)
    frames = [
        seen([tilted_card()], camera, one, ("depth", "face_id"), (40, 30))
        for one in ("float32-reversed", name)
    ]
    is_seen = frames[0].face_id >= 0
    assert is_seen.sum() > 600
    assert (frames[0].face_id == frames[1].face_id).all()
    assert frames[1].depth[is_seen] == pytest.approx(frames[0].depth[is_seen], rel=step)
    assert np.isinf(frames[1].depth[~is_seen]).all()


@pytest.mark.parametrize("name", ["unorm16", "unorm24", "float32"])
def test_a_camera_whose_z_tells_no_depth_is_refused(name):
    clip = looking(0.5, 60.0).projection_matrix((4, 3))
    backward, flat = clip.copy(), clip.copy()
    backward[2] *= -1.0
    flat[2] = 0.5 * flat[3]
    for matrix in (backward, flat):
        camera = rj.MatrixCamera(np.eye(4), matrix)
        with pytest.raises(ValueError, match=f"quality.depth_format .* got '{name}'"):
            rj.explain(tilted_card(), camera, quality(name), size=(4, 3))
        for other in ("float32-reversed", "float64"):
            assert rj.explain(tilted_card(), camera, quality(other), size=(4, 3))


@pytest.mark.parametrize("depth", ["standard", "reversed"])
@pytest.mark.parametrize("name", FORMATS)
def test_rasterize_compares_the_z_it_is_given_in_every_format(name, depth):
    one = np.array([[-1.0, -1.0], [3.0, -1.0], [-1.0, 3.0]])
    for gap in (2.0**-10, 2.0**-20, 2.0**-30):
        zs = 0.5, 0.5 + gap
        positions = [[*point, z, 1.0] for z in zs for point in one]
        found = rj.rasterize(
            positions, [[0, 1, 2], [3, 4, 5]], (2, 2), depth=depth, quality=quality(name),
            threads=1,
        )  # fmt: skip
        # Half of the range: a step is 2**-15 or 2**-23; float32 has 2**-24 or finer.
        least = {"unorm16": 2.0**-15, "unorm24": 2.0**-23, "float64": 0.0}.get(name, 2.0**-26)
        nearer = 0 if depth == "standard" else 1
        assert (found.face_id == (nearer if gap > least else 0)).all(), gap
        shown = zs[found.face_id[0, 0]]
        assert found.depth == pytest.approx(shown, abs=max(least, 2.0**-24))


# --- what is passed over --------------------------------------------------------------------------


def large_triangles(rng, count):
    """Return screen points and z, near each other in depth, of triangles around many tiles."""
    middles = np.repeat(rng.uniform(0, 192, (count, 2)), 3, axis=0)
    points = np.round((middles + rng.uniform(-1, 1, (3 * count, 2)) * 900) * 256) / 256
    tilt = np.repeat(rng.choice([0.0, 1e-6, 1e-3, 0.2], count), 3)
    return points, np.repeat(rng.uniform(-0.3, 0.3, count), 3) + tilt * rng.uniform(
        -1, 1, 3 * count
    )


@pytest.mark.parametrize("name", FORMATS)
def test_leaving_out_what_a_floor_hides_changes_no_bit(name):
    rng, size, passed = np.random.default_rng(8), (192, 192), 0
    form = make_depth_format(name, rj.OrthographicCamera((0, 0, 0), (0, 0, -1)), size)
    viewport, workers = make_viewport(size, 8), threads.Workers(1)
    for _ in range(6):
        points, z = large_triangles(rng, 25)
        positions = np.ones((len(points), 4))
        positions[:, 0] = 2.0 * points[:, 0] / size[0] - 1.0
        positions[:, 1] = 1.0 - 2.0 * points[:, 1] / size[1]
        positions[:, 2] = z
        screen, _ = stages.project_to_screen(positions, form.coefficients, viewport, workers)
        numbers = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
        faces = Faces(numbers, np.empty((0, 3), np.int32), np.empty(0, np.int32))
        objects = Objects(np.array([0, len(numbers)], np.int64), np.zeros(1, np.int8))
        starts, binned, tile_depths, _ = stages.set_up_and_bin(
            faces, objects, screen, viewport, workers, depth_type=form.kind
        )
        empty = visibility.get_empty_depth(form.kind)
        frames = []
        for bound in (tile_depths, np.full_like(tile_depths, empty)):
            frame = np.empty(size[::-1], form.kind), np.empty(size[::-1], np.int32)
            stages.draw_tiles(starts, binned, bound, faces, screen, viewport, frame, workers)
            frames.append(frame)
        for one, other in zip(*frames, strict=True):
            assert one.tobytes() == other.tobytes()
        passed += int((tile_depths > empty).sum())
    assert passed > 10


# --- with every effect ----------------------------------------------------------------------------


def rich_scene():
    """Return a scene with holes, glass, edges, outlines, occlusion and shadows, and a camera."""
    colors = np.ones((4, 4), np.float32)
    colors[0, 3] = 0.0
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    faces = [[0, 1, 2], [0, 2, 3]]
    scene = rj.Scene()
    ground = rj.Mesh(square * 4, faces, material=rj.Material("phong", (0.7, 0.7, 0.6, 1.0)))
    scene.add(
        ground, transforms.compose(transforms.translate((0, -1, 0)), transforms.rotate_x(-90))
    )
    scene.add(rj.Mesh(square, faces, material=rj.Material("flat", "red")), transforms.rotate_y(35))
    masked = rj.Material("phong", "green", alpha_mode="mask")
    scene.add(rj.Mesh(square, faces, colors=colors, material=masked), transforms.rotate_y(-50))
    glass = rj.Material("phong", (0.2, 0.3, 0.9, 0.5), alpha_mode="blend")
    scene.add(rj.Mesh(square * 0.7, faces, material=glass), transforms.translate((0.3, 0.1, 0.9)))
    scene.lights = [
        rj.AmbientLight(intensity=0.4), rj.DirectionalLight((-1, -2, -1), shadow=rj.Shadow(128)),
    ]  # fmt: skip
    scene.ambient_occlusion = rj.AmbientOcclusion(radius=0.8)
    scene.outline = rj.Outline()
    scene.wireframe = rj.Wireframe("black")
    return scene, rj.PerspectiveCamera((1.2, 1.0, 4.0), (0, 0, 0), near=0.5, far=50.0)


@pytest.fixture(scope="module")
def standard_pictures():
    scene, camera = rich_scene()
    return {
        samples: rj.render(scene, camera, size=(64, 48), quality=rj.Quality(samples=samples))
        for samples in (1, 4)
    }


@pytest.mark.needs_jit
@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("name", OTHERS)
def test_every_effect_looks_as_in_the_standard_format(name, samples, standard_pictures):
    scene, camera = rich_scene()
    frame = rj.render(
        scene, camera, size=(64, 48), quality=quality(name, samples=samples), diagnose=True
    )
    have, want = (one.color.astype(int) for one in (frame, standard_pictures[samples]))
    differing = np.abs(have - want).max(axis=2) > 8
    # Surfaces cross: 16 bits move the lines where they do by a pixel here and there.
    assert differing.mean() < (0.01 if name == "unorm16" else 0.001)
    assert frame.diagnostics.visible >= 7
    nearest, farthest = frame.diagnostics.depth_range
    assert 1.0 < nearest < farthest < 10.0


@pytest.mark.needs_jit
@pytest.mark.parametrize("name", FORMATS)
def test_passes_that_follow_are_given_the_depth_of_the_faces_not_that_of_the_format(name):
    """The reversed depth of what is seen has the same bits or nearly, whatever it was found by."""
    caught, scene = [], rich_scene()
    original = rj.render.__globals__["add_reversed_depth"]

    def catch(*arguments):
        caught.append(original(*arguments))
        return caught[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(rj.render.__globals__, "add_reversed_depth", catch)
        for one in ("float32-reversed", name):
            rj.render(*scene, size=(64, 48), quality=quality(one), threads=1)
    want, have = caught
    same = want.face_id == have.face_id
    assert same.mean() > 0.99
    assert have.reversed_depth.dtype == np.float32
    assert (have.reversed_depth[have.face_id < 0] == -np.inf).all()
    # The ground is cut at the near plane: its pieces are moved to the grid, the face is not.
    for some, error in ((same & (have.face_id >= 2), 2e-7), (same & (have.face_id >= 0), 2e-4)):
        assert have.reversed_depth[some] == pytest.approx(want.reversed_depth[some], rel=error)


# --- the plan -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FORMATS)
def test_the_plan_names_a_format_that_is_not_standard(name):
    scene, camera = rich_scene()
    plan = rj.explain(scene, camera, quality(name), outputs=("color", "depth"))
    assert (f"depth format             {name}" in str(plan)) == (name != "float32-reversed")
    kinds = {"float64": "float64", "unorm16": "int32", "unorm24": "int32"}
    buffers = {buffer.name: buffer.dtype for buffer in list_buffers(plan)}
    assert buffers["stored depth"] == kinds.get(name, "float32")
    assert ("reversed depth" in buffers) == (name != "float32-reversed")
    drawing = next(
        one for one in list_kernels(plan) if one.name.startswith("tile_rasterizer.draw_tiles")
    )
    assert ("depth" in drawing.variant) == (name in kinds)


def test_standard_settings_give_the_kernels_what_they_always_were_given(monkeypatch):
    """Float32 depths, float64 vertices, w: no other form of any kernel is compiled."""
    kinds = []
    kernels = visibility.draw_tiles, projection.transform_vertices

    def draw(*arguments):
        tile_depths, _, frame, scratch, _, holes = arguments[3:]
        kinds.append((tile_depths.dtype, frame[0].dtype, scratch[0].dtype, holes.depth.dtype))
        return kernels[0](*arguments)

    def transform(vertices, positions, *others):
        kinds.append((positions.dtype, others[0][1].dtype, others[1].dtype, others[-1][0].dtype))
        return kernels[1](vertices, positions, *others)

    monkeypatch.setattr(visibility, "draw_tiles", draw)
    monkeypatch.setattr(projection, "transform_vertices", transform)
    scene, camera = rich_scene()
    scene.lights = []
    rj.render(scene, camera, size=(16, 12), threads=1)
    single, double = np.dtype(np.float32), np.dtype(np.float64)
    assert kinds == [(double, double, double, double), (single, single, single, single)]
