"""A near plane too small for a far plane or for a depth format is refused, and only where it is."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene import transforms

FAR = 7.0


def square(*distances):
    """Return a scene of squares across the view; the farther ones are the larger."""
    corners = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]], float)
    scene = rj.Scene()
    for distance in distances:
        scene.add(rj.Mesh(corners * distance, [[0, 1, 2], [0, 2, 3]]))
    return scene


def draw(scene, near, far=math.inf, name="float32-reversed", camera=None, precision="float64"):
    """Return depth and object in the middle of the picture."""
    camera = camera or rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), near=near, far=far)
    quality = rj.Quality(depth_format=name, precision=precision)
    outputs = ("depth", "object_id")
    frame = rj.render(scene, camera, size=(2, 2), quality=quality, outputs=outputs, threads=1)
    return float(frame.depth[0, 0]), int(frame.object_id[0, 0])


def least_of(error):
    """Return the least value that a message names."""
    return float(re.search("at least ([^ ,]+)", str(error.value))[1])


MATRICES = {
    "perspective": lambda near, far: transforms.perspective(45.0, 1.0, near, far),
    "intrinsics": lambda near, far: rj.MatrixCamera.from_intrinsics(
        9, 9, 4, 4, (8, 8), near=near, far=far
    ),
    "classic pipeline": lambda near, far: rj.ClassicPipeline().perspective(45.0, 8, 8, near, far),
}


@pytest.mark.parametrize("make", MATRICES.values(), ids=MATRICES)
def test_matrices_refuse_a_far_plane_that_they_do_not_hold(make):
    with pytest.raises(ValueError, match=r"^near must be .* far = 7\.0 with near = 6e-13$") as said:
        make(6e-13, FAR)
    make(least_of(said), FAR)
    make(6e-13, math.inf)
    make(6e-300, math.inf)


def test_the_least_near_plane_still_finds_the_far_one():
    near = transforms.MIN_NEAR * FAR
    for distance in (0.1, 0.998 * FAR):
        assert draw(square(distance), near, FAR)[1] == 0
    for distance in (1.002 * FAR, 100.0 * FAR):
        assert draw(square(distance), near, FAR)[1] == -1


@pytest.mark.parametrize("near", [6e-13, 1e-15, 1e-20, 1e-30])
@pytest.mark.parametrize("beyond", [1.001 * FAR, 1e6])
def test_what_lies_beyond_a_far_plane_that_is_lost_is_refused_with_the_least(near, beyond):
    scene = square(1.0, beyond)
    with pytest.raises(ValueError, match=rf"^camera\.near .* = 7\.0, .* got {near!r}$") as said:
        draw(scene, near, FAR)
    assert draw(scene, least_of(said), FAR) == (pytest.approx(1.0), 0)
    assert draw(scene, near, math.inf) == (pytest.approx(1.0), 0)


@pytest.mark.parametrize(("near", "far"), [(1e-30, 1e30), (1e-37, 1e300), (1e-15, 1.0 + 1e-12)])
def test_a_far_plane_that_nothing_lies_beyond_may_be_any(near, far):
    scene = square(1.0)
    # Not of any face; beside and behind the view.
    mesh = rj.Mesh([[0, 0, -2 * far], *scene.nodes[0].mesh.vertices], [[1, 2, 3], [1, 3, 4]])
    scene.add(mesh)
    scene.add(mesh, rj.transforms.translate((0, 0, 9.0)))
    assert draw(scene, near, far) == (pytest.approx(1.0), 0)


MIN_HELD = {
    "float32-reversed": 2.0**-126,
    "float64": 2.0**-1022,
    "float32": 2.0**-25,
    "unorm24": 0.5 / (2**24 - 1),
    "unorm16": 0.5 / (2**16 - 1),
}


@pytest.mark.parametrize("name", MIN_HELD)
@pytest.mark.parametrize("distance", [1e-3, 1.0, 1000.0])
def test_a_near_plane_that_a_format_cannot_hold_is_refused_with_the_least(name, distance):
    least, scene = MIN_HELD[name] * distance, square(2.0 * distance, distance)
    if name in ("float32-reversed", "float64"):
        # They hold all that is in view; the others lose what is far.
        least *= 2.0
    for share in (0.99, 1e-3, 1e-9):
        near = max(least * share, 5e-324)
        with pytest.raises(ValueError, match=rf"^camera\.near .*'{name}'.* got {near!r}$") as said:
            draw(scene, near, name=name)
        assert least_of(said) == pytest.approx(least, rel=0.02)
    depth, seen = draw(scene, least_of(said), name=name)
    assert seen == 1
    assert math.isfinite(depth)
    if name in ("float32-reversed", "float64"):
        assert depth == pytest.approx(distance, rel=2.0**-22)


def test_float32_arithmetic_holds_no_more_in_float64():
    with pytest.raises(ValueError, match=r"^camera\.near .*'float64'.* got 1e-38$") as said:
        draw(square(1.0), 1e-38, name="float64", precision="float32")
    for near, precision in ((1e-38, "float64"), (least_of(said), "float32")):
        depth, seen = draw(square(1.0), near, name="float64", precision=precision)
        assert (depth, seen) == (pytest.approx(1.0, rel=1e-6), 0)


def test_vast_scenes_need_a_near_plane_that_is_not_tiny_for_them():
    with pytest.raises(
        ValueError, match=r"^camera\.near must be at least 1\.19e\+22, .* got 0\.1$"
    ):
        draw(square(1e60), 0.1)
    assert draw(square(1e60), 1.19e22) == (pytest.approx(math.inf), 0)


@pytest.mark.parametrize("near", [1e-40, 1e-46])
def test_matrix_cameras_are_refused_by_w(near):
    with pytest.raises(
        ValueError, match=rf"^w on the near plane of camera .* got {near!r}$"
    ) as said:
        draw(square(1.0), near, camera=matrix_camera(near))
    assert draw(square(1.0), 0, camera=matrix_camera(least_of(said))) == (pytest.approx(1.0), 0)


def matrix_camera(near):
    return rj.MatrixCamera(np.eye(4), transforms.perspective(45.0, 1.0, near, math.inf))


def test_pictures_that_find_no_face_take_any_near_plane():
    scene = square(1.0)
    scene.wireframe = rj.Wireframe("red", mode="only")
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=100.0, near=1e-300)
    assert (rj.render(scene, camera, size=(32, 32)).color != 255).any()


def test_what_is_out_of_view_asks_for_nothing():
    scene = square(1.0)
    far_aside = rj.transforms.translate((1e30, 0.0, 0.0))
    scene.add(square(1e3).nodes[0].mesh, far_aside)
    assert draw(scene, 1e-37) == (pytest.approx(1.0), 0)


@pytest.mark.parametrize("name", ["float32-reversed", "float32", "float64", "unorm16", "unorm24"])
def test_what_is_too_far_to_be_drawn_asks_for_no_near_plane(name):
    assert draw(square(1e300), 0.1, name=name) == (math.inf, -1)


def test_vertices_of_no_face_hide_no_loss():
    scene, lost = square(1e6), r"^camera\.near must be at least 7\.71, .* 1e\+06 away; got 0\.1$"
    corners = scene.nodes[0].mesh.vertices
    # Before the eye, behind it, and where nothing is drawn.
    scene.add(rj.Mesh([*corners, (0, 0, -1), (0, 0, 1), (0, 0, -1e300)], [[0, 1, 2], [0, 2, 3]]))
    with pytest.raises(ValueError, match=lost):
        draw(scene, 0.1, name="unorm16")


class Watched(rj.Mesh):
    """Counts how often somebody asks for its vertices."""

    looks = 0

    @property
    def vertices(self):
        Watched.looks += 1
        return super().vertices


def ball(rng, loose=9):
    """Return loose triangles, their corners 1 from the origin, and some vertices of none."""
    points = rng.normal(size=(300 + loose, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points[300:] *= rng.uniform(0.5, 1.5, (loose, 1))
    return Watched(points, np.arange(300).reshape(-1, 3))


def looks_of(renderer, scene, eye, near, far):
    """Draw a scene; return how often its vertices were asked for."""
    before = Watched.looks
    camera = rj.PerspectiveCamera(eye, (0, 0, 0), near=near, far=far)
    renderer.render(scene, camera, outputs=("depth",))
    return Watched.looks - before


# From the first eye, vertices lie from 2.00 to 4.00 away and the box from 1.36 to 4.66.
@pytest.mark.parametrize(
    ("name", "near", "far", "is_open"),
    [
        ("float32-reversed", 1e-13, 4.7, False),
        ("float32-reversed", 1e-13, 4.2, True),
        ("unorm16", 3e-5, 100.0, False),
        ("unorm16", 1.6e-5, 100.0, True),
        ("float32", 1.2e-7, 1000.0, False),
        ("float32", 6.1e-8, 1000.0, True),
    ],
)
def test_vertices_are_looked_at_once_and_only_if_the_boxes_leave_it_open(name, near, far, is_open):
    scene = rj.Scene()
    scene.add(ball(np.random.default_rng(0)))
    renderer = rj.Renderer((4, 3), quality=rj.Quality(depth_format=name))
    looks_of(renderer, scene, (9, 9, 9), 0.1, 100.0)
    assert (looks_of(renderer, scene, (2, 2, 1), near, far) > 0) == is_open
    assert looks_of(renderer, scene, (2, 2, 1), near, far) == 0
    if name != "float32-reversed":
        # What was nearest before shows that something still is near enough.
        assert looks_of(renderer, scene, (1.99, 2, 1), near, far) == 0


@pytest.mark.parametrize("name", ["float32-reversed", "float32", "unorm16"])
def test_refused_is_what_all_vertices_of_faces_say(name):
    """The least near plane is that of the nearest or the farthest of them, of any object."""
    rng, refused = np.random.default_rng(7), []
    held = 2.0**-126 if name == "float32-reversed" else MIN_HELD[name]
    for _ in range(40):
        scene = rj.Scene()
        for _ in range(rng.integers(1, 5)):
            turn = rj.transforms.rotate(rng.normal(size=3), rng.uniform(0, 360))
            place = rj.transforms.translate((*rng.uniform(-1, 1, 2), rng.uniform(-9, -6)))
            scene.add(ball(rng), place @ turn @ np.diag((*rng.uniform(0.1, 2.0, 3), 1.0)))
        depths = np.concatenate([
            -node.mesh.vertices[:300] @ node.world_from_model[2, :3] - node.world_from_model[2, 3]
            for node in scene.nodes
        ])  # fmt: skip
        # All vertices are in view, or beyond no plane but the near and the far one.
        least = held * (depths.max() if name == "float32-reversed" else depths.min())
        for share in (1.0 - 1e-9, 1.0 + 1e-9, rng.uniform(0.5, 2.0)):
            if share < 1.0:
                with pytest.raises(ValueError, match=r"^camera\.near must be at least") as said:
                    draw(scene, least * share, name=name)
                assert least_of(said) == pytest.approx(1.01 * least, rel=0.005)
            else:
                draw(scene, least * share, name=name)
            refused.append(share < 1.0)
    assert 50 < sum(refused) < 70
