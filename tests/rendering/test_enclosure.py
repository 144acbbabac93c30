"""What is closed around the camera keeps the light of lamps outside out, all of it."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene import transforms as tf
from rasterjit.survey.blocked_lights import count_crossings

SIZE = (64, 36)
BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
         [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
MIDDLE = np.array([0.5, 0.5, 0.5])
FLAT = rj.Material("flat", "white")
TURNED = tf.compose(tf.translate(MIDDLE), tf.rotate((1, 2, 3), 40.0), tf.translate(-MIDDLE))
VIEWS = [(1, -0.3, 0.2), (-1, -0.4, -0.3), (0.3, -0.8, 1), (-0.2, -0.5, -1), (0.7, 0.2, 0.7)]
WAYS = {"aside": (-0.3, -0.9, -0.2), "through an edge": (1, 1, 1), "at right angles": (0, -1, 0)}


def box(material=FLAT, sides=SIDES, **options):
    return rj.Mesh(BOX, sides, material=material, **options)


def shadow_of(kernel):
    return rj.Shadow(128, kernel, 0.05 if kernel == "soft" else None)


def light_of(kind, way=WAYS["aside"], kernel="pcf"):
    """Return a light that shines on the box from outside."""
    way = np.array(way) / np.linalg.norm(way)
    if kind == "directional":
        return rj.DirectionalLight(way, shadow=shadow_of(kernel))
    place = MIDDLE - 4.0 * way
    if kind == "spot":
        return rj.SpotLight(place, way, intensity=16.0, outer_angle=40.0, shadow=shadow_of(kernel))
    return rj.PointLight(place, intensity=16.0, shadow=shadow_of(kernel))


def scene_of(*meshes, light=None, place=None):
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh, np.eye(4) if place is None else place)
    scene.lights = [light_of("directional") if light is None else light]
    return scene


def inside(view=VIEWS[0], **options):
    return rj.PerspectiveCamera(MIDDLE, MIDDLE + view, near=0.01, fov_y=70.0, **options)


def is_dark(scene, camera=None, **options):
    """Tell whether the light is left out, and check that all is black if it is."""
    camera = inside() if camera is None else camera
    frame = rj.render(scene, camera, size=SIZE, outputs=("linear", "face_id"), **options)
    plan = rj.explain(scene, camera, size=SIZE, **options)
    is_out = "is closed around the camera, and keeps it out" in str(plan)
    assert not is_out or not frame.linear[frame.face_id >= 0][..., :3].any()
    return is_out


@pytest.mark.parametrize("place", [np.eye(4), TURNED], ids=["straight", "turned"])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
def test_a_closed_box_without_thickness_lets_no_light_in(kind, way, place):
    for view in VIEWS:
        scene = scene_of(box(), light=light_of(kind, WAYS[way]), place=place)
        assert is_dark(scene, inside(view))


@pytest.mark.parametrize("kernel", ["hard", "soft"])
def test_no_filter_matters(kernel):
    assert is_dark(scene_of(box(), light=light_of("point", kernel=kernel)))


def unwelded():
    return rj.Mesh(BOX[np.array(SIDES)].reshape(-1, 3), np.arange(36).reshape(-1, 3), material=FLAT)


def turned_at_random():
    rng = np.random.default_rng(3)
    return box(sides=[side[::-1] if rng.random() < 0.5 else side for side in SIDES])


def with_faces_of_no_area():
    return box(sides=[*SIDES, [0, 0, 1], [5, 5, 5], [0, 1, 0]])


def with_a_wall_twice():
    return box(sides=[*SIDES, SIDES[0], SIDES[0]])


@pytest.mark.parametrize(
    "mesh", [unwelded, turned_at_random, with_faces_of_no_area, with_a_wall_twice]
)
def test_however_its_faces_are_given(mesh):
    assert is_dark(scene_of(mesh()))


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_at_any_scale_and_place(scale):
    place = tf.compose(tf.translate((3e6 * scale, 0, -1e6 * scale)), tf.scale(scale))
    eye = tf.transform_points(place, MIDDLE[np.newaxis])[0, :3]
    camera = rj.PerspectiveCamera(eye, eye + np.array(VIEWS[0]), near=0.01 * scale, fov_y=70.0)
    assert is_dark(scene_of(box(), place=place), camera)


def test_what_else_is_inside_is_dark_and_what_is_inside_it_too():
    small = rj.Mesh(0.2 * BOX + [0.7, 0.3, 0.5], SIDES, material=FLAT)
    open_one = rj.Mesh(0.2 * BOX + [0.6, 0.6, 0.5], SIDES[:8], material=FLAT)
    assert is_dark(scene_of(open_one, small, box()))


def test_a_camera_with_parallel_rays():
    camera = rj.OrthographicCamera(MIDDLE, MIDDLE + VIEWS[0], height=0.2, near=0.0, far=10.0)
    assert is_dark(scene_of(box()), camera)


def see_through():
    return box(rj.Material("flat", (1.0, 1.0, 1.0, 0.5), alpha_mode="blend"))


def with_holes():
    colors = np.ones((8, 4))
    colors[3, 3] = 0.1
    return box(rj.Material("flat", "white", alpha_mode="mask"), colors=colors)


def one_sided():
    return box(rj.Material("flat", "white", double_sided=False))


def without_a_face():
    return box(sides=SIDES[:-1])


def with_a_slit():
    corners = BOX[np.array(SIDES)].reshape(-1, 3).copy()
    corners[0, 2] += 1e-9
    return rj.Mesh(corners, np.arange(36).reshape(-1, 3), material=FLAT)


@pytest.mark.parametrize("mesh", [see_through, with_holes, one_sided, without_a_face, with_a_slit])
def test_what_is_not_closed_is_looked_at_by_its_map(mesh):
    assert not is_dark(scene_of(mesh()))


def test_what_is_culled_is_no_wall():
    assert not is_dark(scene_of(box()), cull="back")


def test_a_light_without_shadows_shines_through_walls():
    assert not is_dark(scene_of(box(), light=replace(light_of("point"), shadow=None)))


def test_a_lamp_inside_shines():
    lamp = rj.PointLight((0.4, 0.6, 0.45), shadow=shadow_of("pcf"))
    scene = scene_of(box(), light=lamp)
    assert not is_dark(scene)
    assert rj.render(scene, inside(), size=SIZE, outputs=("linear",)).linear[..., :3].max() > 0.1


def test_a_lamp_in_a_box_inside_is_kept_out():
    small = rj.Mesh(0.2 * BOX + [0.7, 0.3, 0.5], SIDES, material=FLAT)
    lamp = rj.PointLight((0.8, 0.4, 0.6), shadow=shadow_of("pcf"))
    # The camera is outside of that box, and its map tells.
    assert not is_dark(scene_of(box(), small, light=lamp))
    camera = rj.PerspectiveCamera((0.75, 0.35, 0.55), (0.8, 0.4, 0.6), near=0.01, fov_y=70.0)
    assert not is_dark(scene_of(small, light=lamp), camera)


def test_from_outside_light_is_seen():
    camera = rj.PerspectiveCamera((3.0, 2.0, 2.5), MIDDLE, fov_y=40.0)
    assert not is_dark(scene_of(box()), camera)


def test_a_near_plane_that_cuts_a_wall_shows_what_is_lit():
    camera = rj.PerspectiveCamera((0.9, 0.5, 0.5), (2.0, 0.5, 0.5), near=0.2, fov_y=70.0)
    lit = rj.Mesh(BOX + [2.0, -0.5, 0.0], SIDES, material=FLAT)
    scene = scene_of(box(), lit, light=light_of("directional", (1.0, -0.5, 0.2)))
    assert not is_dark(scene, camera)
    # All of it beyond the wall, so that the middle of the near plane is outside, too.
    assert not is_dark(scene, replace_near(camera, 0.101))


def replace_near(camera, near):
    return rj.PerspectiveCamera(camera.eye, camera.target, near=near, fov_y=camera.fov_y)


def test_a_near_plane_that_is_partly_outside_shows_what_is_lit():
    # Its middle is inside, its right end beyond the wall at x = 1.
    camera = rj.PerspectiveCamera((0.9, 0.5, 0.3), (0.6, 0.5, 1.3), near=0.15, fov_y=70.0)
    mirrored = rj.PerspectiveCamera((0.9, 0.5, 0.7), (1.2, 0.5, -0.3), near=0.15, fov_y=70.0)
    for each in (camera, mirrored):
        assert not is_dark(scene_of(box()), each)
    assert is_dark(scene_of(box()), replace_near(camera, 0.01))


@pytest.mark.parametrize("gap", [1e-8, 1e-7])
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_wall_that_just_meets_the_near_plane_is_no_wall(precision, gap):
    # What is clipped in float32 may be cut away there.
    camera = rj.PerspectiveCamera((0.9, 0.5, 0.5), (2.0, 0.5, 0.5), near=0.1 * (1.0 - gap))
    assert not is_dark(scene_of(box()), camera, quality=rj.Quality(precision=precision))


def test_a_near_plane_behind_the_eye_shows_what_is_lit():
    # It reaches into the box, but only what is before the eye is seen.
    matrix = np.zeros((4, 4))
    matrix[0, 0] = matrix[1, 1] = 1.5
    matrix[3, 2], matrix[2, 2], matrix[2, 3] = -1.0, 0.999, 1e-4
    camera = rj.MatrixCamera(tf.look_at((0.5, 0.5, -0.05), (0.5, 0.3, -5.0), (0, 1, 0)), matrix)
    ground = rj.Mesh([[-9, -1, -9], [9, -1, -9], [9, -1, 9], [-9, -1, 9]], [[0, 2, 1], [0, 3, 2]])
    scene = scene_of(box(), ground)
    assert not is_dark(scene, camera)
    frame = rj.render(scene, camera, size=SIZE, outputs=("linear", "object_id"))
    assert frame.linear[frame.object_id == 1][:, :3].min() > 0.0


@pytest.mark.parametrize("make", [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m)),
                                  rj.Mesh.split_creases])  # fmt: skip
def test_what_is_made_of_a_closed_mesh_is_closed(make):
    assert make(box()).is_closed()
    known = box()
    assert known.is_closed()
    assert make(known).is_closed()
    assert not make(without_a_face()).is_closed()
    assert is_dark(scene_of(make(box())))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e-150, 1e20, 4e307])
def test_coordinates_of_any_size_warn_of_nothing(size):
    huge = rj.Mesh((BOX - MIDDLE) * size, SIDES, material=FLAT)
    is_dark(scene_of(box(), huge))


def test_a_vertex_of_no_face_opens_nothing():
    corners = np.concatenate([BOX, [[np.nan, 0.0, 0.0]]])
    assert is_dark(scene_of(rj.Mesh(corners, SIDES, material=FLAT, on_invalid="drop")))


def test_between_two_boxes_of_one_mesh_light_is_seen():
    # The way to the light goes through one of them: in and out again.
    corners = np.concatenate([BOX + [1, 0, 0], BOX - [1, 0, 0]])
    both = rj.Mesh(corners, np.concatenate([SIDES, np.add(SIDES, 8)]), material=FLAT)
    camera = rj.PerspectiveCamera(MIDDLE, MIDDLE + [-1.0, 0.1, 0.2], near=0.01, fov_y=70.0)
    scene = scene_of(both, light=light_of("directional", (-1.0, -0.1, -0.15)))
    assert not is_dark(scene, camera)


def exact_crossings(corners, way, ends):
    """Return the same as `count_crossings` in fractions, or None where the way meets an edge."""

    def volume(a, b, c):
        return (
            (a[1] * b[2] - a[2] * b[1]) * c[0]
            + (a[2] * b[0] - a[0] * b[2]) * c[1]
            + (a[0] * b[1] - a[1] * b[0]) * c[2]
        )

    count = 0
    way = [Fraction(float(x)) for x in way]
    for a, b, c in np.moveaxis(corners, 0, 1):
        if any((p == q).all() for p, q in ((a, b), (b, c), (c, a))):
            continue
        a, b, c = ([Fraction(float(x)) for x in p] for p in (a, b, c))
        over = [volume(p, q, way) for p, q in ((a, b), (b, c), (c, a))]
        if min(over) < 0 < max(over):
            continue
        here = volume(a, b, c)
        there = here - sum(over) if ends else -sum(over)
        if 0 in (*over, here, there):
            return None
        count += (here > 0) != (there > 0)
    return count


@pytest.mark.parametrize("ends", [True, False])
def test_crossings_are_those_of_exact_arithmetic_or_unsure(ends):
    rng = np.random.default_rng(5)
    sure, edges = 0, 0
    for n in range(300):
        corners = rng.normal(size=(3, 12, 3)) * 10.0 ** rng.uniform(-6, 6)
        if n % 3 == 0:
            # Through edges and corners, and along planes.
            corners = rng.integers(-2, 3, (3, 12, 3)).astype(float)
        way = rng.integers(-2, 3, 3) + (0.0 if n % 2 else rng.normal(size=3))
        found, exact = count_crossings(corners, way, ends), exact_crossings(corners, way, ends)
        edges += exact is None
        sure += found is not None
        assert found is None or found == exact
        assert n % 3 == 0 or found is not None or not way.any()
    assert sure > 150
    assert edges > 20


@pytest.mark.parametrize(("reach", "count"), [(1.5, 0), (2.5, 1), (4.0, 2)])
def test_a_way_crosses_what_lies_before_its_end(reach, count):
    corners = BOX[np.array(SIDES).T] + [2.0, 0.3, 0.4]
    way = reach * np.array([1.0, 0.27, 0.3])
    assert count_crossings(corners, way, True) == count
    assert count_crossings(corners, way, False) == 2
    assert count_crossings(corners, -way, False) == 0
