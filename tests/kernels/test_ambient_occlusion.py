"""Ambient occlusion: nothing on planes, the right share in corners, at any scale, same bits."""

from __future__ import annotations

import math
from dataclasses import replace

import naive_screen
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.effects.ambient_occlusion import stage as ao

WHITE = rj.Material(shading="flat", base_color="white", specular=0.0)
ANGLES = [pytest.param(a, marks=pytest.mark.needs_jit) for a in (45.0, 60.0, 120.0, 150.0)]
MOVE, TURN = rj.transforms.translate, rj.transforms.rotate_x


def square(half=1.0, cells=1):
    """A square in x and z that faces up, of so many cells a side."""
    line = np.linspace(-half, half, cells + 1)
    vertices = [(x, 0.0, z) for z in line for x in line]
    rows = [(r * (cells + 1) + c, cells + 1) for r in range(cells) for c in range(cells)]
    faces = [f for a, n in rows for f in ((a, a + n, a + n + 1), (a, a + n + 1, a + 1))]
    return rj.Mesh(vertices, faces, material=WHITE)


def scene_of(*placed, radius=None):
    scene = rj.Scene()
    for mesh, matrix in placed:
        scene.add(mesh, matrix)
    scene.lights = [rj.AmbientLight(intensity=1.0)]
    scene.ambient_occlusion = rj.AmbientOcclusion(radius=radius)
    return scene


def share(scene, camera, size=(96, 72), bits=8, threads=1):
    """The share of light at each pixel, NaN where nothing is, and the frame."""
    frame = rj.render(
        scene, camera, size=size, quality=rj.Quality(subpixel_bits=bits), threads=threads,
        outputs=("linear", "position", "normal", "face_id"),
    )  # fmt: skip
    return np.where(frame.face_id >= 0, frame.linear[..., 0], np.nan), frame


def seen_from(elevation, distance=3.0, **more):
    """A camera that looks at the origin from so many degrees above the ground."""
    up, along = math.sin(math.radians(elevation)), math.cos(math.radians(elevation))
    eye = (0.3 * distance * along, distance * up, distance * along)
    return rj.PerspectiveCamera(eye=eye, target=(0, 0, 0), fov_y=40.0, near=0.01, **more)


def parallel_from(elevation):
    camera = seen_from(elevation)
    return rj.OrthographicCamera(eye=camera.eye, target=(0, 0, 0), height=2.0, near=0.0, far=20.0)


def by_matrices(camera, size=(96, 72)):
    return rj.MatrixCamera(camera.view_matrix(), camera.projection_matrix(size))


def test_arc_cosine_keeps_its_error():
    for x in np.linspace(-1.0, 1.0, 4001, dtype=np.float32):
        assert abs(float(ao.compute_arc_cosine(x)) - math.acos(float(x))) <= 7e-5
    assert ao.compute_arc_cosine(np.float32(1.0)) == 0.0


@pytest.mark.parametrize("eye", [20.0, 60.0, 90.0, 130.0])
def test_blocked_light_is_its_integral(eye):
    viewer = math.radians(eye)
    full = np.linspace(0.0, viewer, 20001)
    for horizon in np.linspace(0.0, viewer, 9):
        angles = full[full <= horizon + 1e-9]
        values = np.sin(angles) * np.abs(np.sin(viewer - angles))
        exact = np.sum((values[1:] + values[:-1]) / 2.0) * (full[1] - full[0])
        numbers = [math.cos(horizon), math.cos(viewer), math.sin(viewer)]
        got = ao.blocked_light(*map(np.float32, numbers), np.float32(viewer))
        assert abs(float(got) - exact) < 3e-4
    assert ao.blocked_light(np.float32(1.0), np.float32(0.6), np.float32(0.8), np.float32(0.9)) == 0


def test_pattern_holds_every_direction_and_offset_once():
    pattern = ao.make_screen_pattern().astype(np.float64).reshape(16, 3)
    angles = np.degrees(np.arctan2(pattern[:, 1], pattern[:, 0]))
    assert np.allclose(np.sort(angles), (np.arange(16) + 0.5) * 90.0 / 16.0, atol=1e-4)
    assert np.allclose(np.hypot(pattern[:, 0], pattern[:, 1]), 1.0, atol=1e-6)
    assert sorted(pattern[:, 2]) == [(n + 0.5) / 16.0 for n in range(16)]


@pytest.mark.parametrize("elevation", [89.0, 45.0, 10.0, 2.0, 0.3])
@pytest.mark.parametrize("cells", [1, 40])
@pytest.mark.parametrize("kind", ["perspective", "parallel", "matrices"])
def test_plane_gets_all_light(elevation, cells, kind):
    camera = parallel_from(elevation) if kind == "parallel" else seen_from(elevation)
    if kind == "matrices":
        camera = by_matrices(camera)
    found, _ = share(scene_of((square(4.0, cells), None), radius=0.5), camera)
    assert np.isfinite(found).sum() > 150
    assert np.nanmin(found) == 1.0


@pytest.mark.needs_jit
@pytest.mark.parametrize("bits", [0, 4, 8, 12])
@pytest.mark.parametrize("elevation", [60.0, 8.0])
def test_plane_gets_all_light_on_any_grid(bits, elevation):
    found, _ = share(scene_of((square(4.0, 60), None), radius=0.5), seen_from(elevation), bits=bits)
    assert np.nanmin(found) == 1.0


def test_what_bends_away_gets_all_light(sphere, cube):
    for mesh in (sphere, cube):
        mesh.material = WHITE
        scene = scene_of((mesh, None), radius=1.0)
        found, _ = share(scene, seen_from(30.0, 4.0))
        assert np.isfinite(found).sum() > 1000
        assert np.nanmin(found) == 1.0


@pytest.mark.needs_jit
@pytest.mark.parametrize("angle", [90.0, *ANGLES])
@pytest.mark.parametrize("kind", ["perspective", "parallel"])
def test_corner_gets_the_analytic_share(angle, kind):
    """Two planes that meet at an angle leave (1 - cos angle) / 2 at the crease."""
    half = square(20.0, 1)
    floor, radius = MOVE((0, 0, 20.0)), 1.0
    wall = rj.transforms.compose(TURN(-angle), floor)
    scene = scene_of((half, floor), (half, wall), radius=radius)
    # Along the line that halves the angle.
    up, along = math.sin(math.radians(angle / 2)), math.cos(math.radians(angle / 2))
    eye = np.array([0.4, up, along]) * 4.0
    camera = rj.PerspectiveCamera(eye=eye, target=(0, 0, 0), fov_y=30.0)
    if kind == "parallel":
        camera = rj.OrthographicCamera(eye=eye, target=(0, 0, 0), height=2.0, near=0.1, far=30.0)
    found, frame = share(scene, camera, size=(240, 180))
    away = np.linalg.norm(frame.position[..., 1:], axis=2)
    crease = away < 0.05 * radius
    assert crease.sum() > 300
    exact = (1.0 - math.cos(math.radians(angle))) / 2.0
    assert abs(found[crease].mean() - exact) < 0.06
    nearest = away * math.sin(math.radians(min(angle, 90.0)))
    assert found[nearest > 1.05 * radius].min() > 0.995


@pytest.mark.needs_jit
def test_shares_are_those_of_rays(cube):
    """A low box on a floor, seen from above: what occludes is in view, or its upper edge is."""
    cube.material = WHITE
    scene = scene_of(
        (square(6.0), None),
        (cube, rj.transforms.compose(MOVE((0, 0.2, 0)), rj.transforms.scale((0.5, 0.2, 0.5)))),
        radius=0.9,
    )
    camera = rj.PerspectiveCamera(eye=(0.6, 6.0, 3.0), target=(0, 0, 0.2), fov_y=30.0)
    found, frame = share(scene, camera, size=(160, 120))
    triangles = np.concatenate(
        [
            (node.mesh.vertices @ node.world_from_model[:3, :3].T + node.world_from_model[:3, 3])[
                node.mesh.faces
            ]
            for node in scene.nodes
        ]
    )
    rows, columns = np.mgrid[6:120:9, 6:160:9]
    exact = np.array(
        [
            naive_screen.open_share(
                frame.position[r, c].astype(float), frame.normal[r, c].astype(float), triangles, 0.9
            )
            for r, c in zip(rows.ravel(), columns.ravel(), strict=True)
        ]
    )
    got = found[rows, columns].ravel()
    assert exact.min() < 0.75
    assert np.abs(got - exact).mean() < 0.015
    assert np.quantile(np.abs(got - exact), 0.95) < 0.08


def corner(scale=1.0, radius=0.5):
    """A floor with a box on it, at any scale, and a camera."""
    mesh = square(4.0)
    box = rj.Mesh(square(0.5).vertices, square(0.5).faces, material=WHITE)
    grow = rj.transforms.scale(scale)
    scene = scene_of(
        (mesh, grow),
        (box, rj.transforms.compose(grow, MOVE((0, 0.5, 0)), TURN(90.0))),
        (box, rj.transforms.compose(grow, MOVE((0.4, 0.1, 0.3)))),
        radius=None if radius is None else radius * scale,
    )
    return scene, rj.PerspectiveCamera(
        eye=np.array([1.0, 2.0, 3.0]) * scale, target=(0, 0, 0), fov_y=40.0, near=0.1 * scale
    )


@pytest.mark.needs_jit
@pytest.mark.parametrize("scale", [1e-3, 1e3, 1e6, 2.0**-40, 2.0**40])
@pytest.mark.parametrize("radius", [0.5, None])
def test_scale_changes_nothing(scale, radius):
    once, _ = share(*corner(1.0, radius))
    again, _ = share(*corner(scale, radius))
    assert np.nanmin(once) < 0.8
    assert np.nanmean(np.abs(once - again)) < 1e-4


@pytest.mark.needs_jit
@pytest.mark.parametrize("threads", [2, 5])
def test_threads_change_no_bit(threads):
    once, _ = share(*corner(), size=(300, 250))
    again, _ = share(*corner(), size=(300, 250), threads=threads)
    assert np.array_equal(once, again, equal_nan=True)


@pytest.mark.needs_jit
def test_strength_is_a_share_of_the_effect():
    scene, camera = corner()
    full, _ = share(scene, camera)
    scene.ambient_occlusion = replace(scene.ambient_occlusion, strength=0.25)
    quarter, _ = share(scene, camera)
    assert np.allclose(1.0 - quarter, 0.25 * (1.0 - full), atol=1e-6, equal_nan=True)


@pytest.mark.needs_jit
def test_light_with_a_direction_is_not_dimmed():
    scene, camera = corner()
    sun = rj.DirectionalLight((-0.3, -1.0, -0.4), intensity=0.7)
    ambient, _ = share(scene, camera)
    scene.lights.append(sun)
    both, _ = share(scene, camera)
    scene.lights = [sun]
    alone, _ = share(scene, camera)
    assert np.allclose(both, ambient + alone, atol=1e-6, equal_nan=True)
    assert np.nanmin(ambient) < 0.8


@pytest.mark.parametrize("shading", ["flat", "phong", "gouraud", "unlit"])
def test_absent_equals_all_light_bit_for_bit(shading, cube):
    """On what bends away the effect is computed and takes nothing."""
    cube.material = rj.Material(shading=shading, base_color="#4080c0", specular=0.4)
    scene, camera = scene_of((cube, None), radius=1.0), seen_from(25.0, 4.0)
    # Another kind of material is in view, though hidden inside.
    flat = rj.Mesh(cube.vertices, cube.faces, material=replace(WHITE, base_color="red"))
    scene.add(flat, rj.transforms.scale(0.5))
    frame = rj.render(scene, camera, size=(90, 70), outputs=("color", "linear"))
    assert frame.plan.has("ambient occlusion")
    scene.ambient_occlusion = None
    without = rj.render(scene, camera, size=(90, 70), outputs=("color", "linear"))
    assert not without.plan.has("ambient occlusion")
    assert np.array_equal(frame.color, without.color)
    assert np.array_equal(frame.linear, without.linear)


def test_vertices_lit_by_gouraud_keep_their_light():
    scene, camera = corner()
    for node in scene.nodes[1:]:
        node.mesh.material = replace(WHITE, shading="gouraud")
    found, frame = share(scene, camera)
    boxes = frame.face_id >= 2
    assert (found[boxes] == 1.0).all()
    assert np.nanmin(found[~boxes]) < 0.9


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (5, 1), (130, 2)])
def test_small_pictures(size):
    found, _ = share(*corner(), size=size)
    assert ((found >= 0.0) & (found <= 1.0) | np.isnan(found)).all()


def planned(change, outputs=("color",)):
    scene, camera = corner()
    change(scene)
    plan = rj.explain(scene, camera, size=(64, 48), outputs=outputs)
    (effect,) = [effect for effect in plan.effects if effect.name == "ambient occlusion"]
    assert effect.used == plan.has("ambient occlusion")
    return effect


def set_strength(scene):
    scene.ambient_occlusion = rj.AmbientOcclusion(strength=0.0)


def unlit(scene):
    for node in scene.nodes:
        node.mesh.material = rj.Material(shading="unlit")


def at_vertices(scene):
    for node in scene.nodes:
        node.mesh.material = rj.Material(shading="gouraud")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda scene: setattr(scene, "ambient_occlusion", None), "is None"),
        (set_strength, "strength is 0"),
        (unlit, "unlit"),
        (at_vertices, "at its vertices"),
        (lambda scene: setattr(scene, "lights", [rj.DirectionalLight()]), "no light comes from"),
        (lambda scene: setattr(scene, "lights", [rj.AmbientLight("black")]), "no light comes from"),
    ],
)  # fmt: skip
def test_plan_leaves_it_out(change, reason):
    effect = planned(change)
    assert not effect.used
    assert reason in effect.reason


def test_plan_takes_it_in():
    assert planned(lambda scene: None).used
    assert "radius 0.5" in planned(lambda scene: None).reason
    assert planned(lambda scene: scene.lights.clear()).used, "the headlight has an ambient part"
    assert not planned(lambda scene: None, outputs=("depth",)).used


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"radius": 0.0}, "radius must be above 0"),
        ({"radius": math.nan}, "radius must be finite"),
        ({"radius": "far"}, "radius must be a number"),
        ({"strength": -0.1}, r"strength must be in 0..1, got -0.1"),
        ({"strength": 1.5}, r"strength must be in 0..1"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match=message):
        rj.AmbientOcclusion(**arguments)


def smoothed_slowly(occlusion, first, depth, tolerance, strength):
    """The twin: each pixel by itself, its neighbours in the same order."""
    smooth, one = np.empty_like(occlusion), np.float32(1.0)
    height, width = occlusion.shape
    for row, column in np.ndindex(height, width):
        total = number = np.float32(0.0)
        for y in range(max(row + first, 0), min(row + first + 4, height)):
            for x in range(max(column + first, 0), min(column + first + 4, width)):
                if abs(depth[y, x] - depth[row, column]) <= tolerance[row, column]:
                    total, number = total + occlusion[y, x], number + one
        mean = total / number if number else one
        smooth[row, column] = one - np.float32(strength) * (one - mean)
    return smooth


@pytest.mark.parametrize("first", [-2, -1])
@pytest.mark.parametrize("width", [1, 3, 4, 5, 8, 40])
def test_occlusion_is_smoothed_like_its_twin(width, first):
    rng = np.random.default_rng(width)
    shape = 9, width
    occlusion, depth, tolerance = rng.random((3, *shape)).astype(np.float32)
    is_empty = rng.random(shape) < 0.4
    is_empty[[2, 5]] = True
    depth[is_empty], tolerance[is_empty] = -np.inf, 0.0
    smooth, scratch = np.empty(shape, np.float32), np.empty((2, width), np.float32)
    given = first, depth, tolerance, 0.7
    ao.smooth_occlusion(occlusion, (0, 9), *given, smooth, scratch)
    with np.errstate(invalid="ignore"):
        assert np.array_equal(smooth, smoothed_slowly(occlusion, *given))
