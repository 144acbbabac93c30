"""Whole frames: the same bits for any threads, order, process or compiler; hard scenes survive."""

from __future__ import annotations

import copy
import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from strict import STRICT

import rasterjit as rj
from rasterjit.outputs.output_table import MOTION_OUTPUTS, OUTPUTS
from rasterjit.pipeline.visibility import tile_rasterizer, visibility_pass
from rasterjit.runtime import threads as sharing

ROOT = Path(rj.__file__).parent.parent
SIZE = (75, 70)
FORK_SECONDS = 60.0
"""Far more than a frame takes."""
PLAIN = tuple(output for output in OUTPUTS if output not in ("uv", "scalar", *MOTION_OUTPUTS))


def bits(frame):
    return {name: array.tobytes() for name, array in frame.arrays().items()}


@pytest.fixture
def busy(cube, sphere):
    """Four objects with every shading model, lights of every kind, one of them behind the eye."""
    rng = np.random.default_rng(1)
    scene = rj.Scene()
    place = rj.transforms.translate
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, material=rj.Material("phong", "red")))
    scene.add(
        rj.Mesh(cube.vertices, cube.faces, colors=rng.uniform(0, 1, (8, 3)),
                material=rj.Material("gouraud", "white")),
        place((1.2, -0.4, 0.7)),
    )  # fmt: skip
    scene.add(
        rj.Mesh(cube.vertices, cube.faces, colors=rng.uniform(0, 1, (12, 3)),
                material=rj.Material("flat", "white")),
        rj.transforms.scale((-0.8, 0.8, 0.8)),
    )  # fmt: skip
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, material=rj.Material("unlit", "blue")),
              place((2.5, 3.0, 4.0)))  # fmt: skip
    scene.lights = [
        rj.AmbientLight(), rj.DirectionalLight((-1, -1, -1)), rj.PointLight((2, 2, 2), intensity=3),
    ]  # fmt: skip
    return scene


def test_threads_and_repeats_change_no_bit(busy, camera):
    expected = bits(rj.render(busy, camera, size=SIZE, outputs=PLAIN, threads=1))
    for threads in (1, 2, 3, 8):
        with rj.Renderer(SIZE, threads=threads) as renderer:
            for _ in range(2):
                assert bits(renderer.render(busy, camera, outputs=PLAIN)) == expected


def test_size_of_tasks_changes_no_bit(busy, camera, monkeypatch):
    expected = bits(rj.render(busy, camera, size=SIZE, outputs=PLAIN, threads=1))
    for name, value in (("FACES_PER_TASK", 17), ("VERTICES_PER_TASK", 5), ("TILES_PER_TASK", 1)):
        monkeypatch.setattr(visibility_pass, name, value)
    monkeypatch.setattr(sharing, "MIN_PIXELS_PER_TASK", 3)
    assert bits(rj.render(busy, camera, size=SIZE, outputs=PLAIN, threads=2)) == expected


def wavy_grid(side):
    """Return a square of 2 side**2 small faces."""
    u, v = np.meshgrid(np.linspace(-1, 1, side + 1), np.linspace(-1, 1, side + 1))
    height = 0.2 * np.sin(7 * u) * np.cos(5 * v)
    vertices = np.stack([2 * u, 2 * v, height], axis=-1).reshape(-1, 3)
    a = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    b, c, d = a + 1, a + side + 2, a + side + 1
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return rj.Mesh(vertices, faces)


def test_many_faces_in_several_tasks_change_no_bit():
    mesh = wavy_grid(190)
    assert len(mesh.faces) > visibility_pass.FACES_PER_TASK
    camera = rj.PerspectiveCamera((0.5, -2.0, 1.2), (0, 0, 0), near=1.7)
    outputs = ("color", "depth", "face_id", "normal")
    frames = [rj.render(mesh, camera, size=SIZE, outputs=outputs, threads=n) for n in (1, 2, 3, 8)]
    assert frames[0].stats.clipped > 0
    assert frames[0].face_id.max() > visibility_pass.FACES_PER_TASK
    for frame in frames[1:]:
        assert bits(frame) == bits(frames[0])


SCRIPT = """
import hashlib, json, sys
import numpy as np
import rasterjit as rj

def digest(frame):
    return {n: hashlib.sha256(a.tobytes()).hexdigest() for n, a in frame.arrays().items()}

def frames(root):
    outputs = ("color", "depth", "face_id", "normal", "barycentric", "position", "linear")
    scene = rj.load(root + "/models/cube.ply")
    yield rj.render(scene, size=(48, 32), outputs=outputs, threads=1)
    # Inside the cube: clipped faces, seen from behind, by every way of shading.
    scene = rj.Scene()
    rng = np.random.default_rng(1)
    vertices = np.array([[x, y, z] for z in (-1., 1.) for y in (-1., 1.) for x in (-1., 1.)])
    faces = [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 4, 6], [0, 6, 2], [1, 3, 7],
             [1, 7, 5], [0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3]]
    for n, shading in enumerate(("flat", "gouraud", "phong", "unlit")):
        mesh = rj.Mesh(vertices, faces, colors=rng.uniform(0, 1, (8, 4)),
                       material=rj.Material(shading, "white"))
        turn = rj.transforms.rotate((1, 2, 3), 37.0 * n)
        place = rj.transforms.translate((n - 1.5, 0.3 * n, -1.5 * n))
        scene.add(mesh, rj.transforms.compose(place, turn, rj.transforms.scale(0.9)))
    scene.lights = [rj.AmbientLight(), rj.PointLight((0, 1, 2), intensity=2.0)]
    scene.wireframe = rj.Wireframe("red", "overlay")
    camera = rj.PerspectiveCamera((-1.4, 0.1, 0.2), (1, 0.3, -3), fov_y=80.0)
    yield rj.render(scene, camera, size=(32, 24), outputs=outputs, threads=1)

if __name__ == "__main__":
    print(json.dumps([digest(frame) for frame in frames(sys.argv[1])]))
"""


def run_script(**environment):
    done = subprocess.run(
        [sys.executable, *STRICT, "-c", SCRIPT, str(ROOT)],
        cwd=ROOT, env={**os.environ, **environment}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_another_process_gives_the_same_bits():
    space = {"__name__": "not main"}
    exec(compile(SCRIPT, "script", "exec"), space)
    here = [space["digest"](frame) for frame in space["frames"](str(ROOT))]
    assert json.loads(run_script()) == here


def test_depth_of_the_frame_is_kept_where_something_asks_for_it(busy, camera, monkeypatch):
    kept = []
    run_visibility = visibility_pass.run_visibility

    def watched(*arguments, **options):
        kept.append(run_visibility(*arguments, **options).depth.shape)
        return run_visibility(*arguments, **options)

    monkeypatch.setattr(visibility_pass, "run_visibility", watched)
    ways = ({}, {"diagnose": True}, {"outputs": ("color", "depth")})
    frames = [
        rj.render(busy, camera, size=(24, 16), **{"outputs": ("color",), **way}) for way in ways
    ]
    busy.wireframe = rj.Wireframe()
    rj.render(busy, camera, size=(24, 16), outputs=("color",))
    assert kept == [(16, 0), (16, 24), (16, 24), (16, 24)]
    for frame in frames[1:]:
        assert frame.color.tobytes() == frames[0].color.tobytes()


def test_renderer_sees_that_objects_moved(cube, camera):
    scene = rj.Scene()
    node = scene.add(cube)
    with rj.Renderer(SIZE, threads=1) as renderer:
        first = renderer.render(scene, camera)
        node.world_from_model = rj.transforms.translate((0.5, 0, 0))
        second = renderer.render(scene, camera)
    assert first.color.tobytes() != second.color.tobytes()
    assert second.color.tobytes() == rj.render(scene, camera, size=SIZE, threads=1).color.tobytes()


def test_renderer_sees_another_mesh(cube, sphere, camera):
    with rj.Renderer(SIZE, threads=1) as renderer:
        for mesh in (cube, sphere, cube):
            alone = rj.render(mesh, camera, size=SIZE, threads=1)
            assert renderer.render(mesh, camera).color.tobytes() == alone.color.tobytes()


def test_renderer_works_after_close(cube, camera):
    renderer = rj.Renderer(SIZE, threads=2)
    first = renderer.render(cube, camera)
    renderer.close()
    renderer.close()
    assert renderer.render(cube, camera).color.tobytes() == first.color.tobytes()
    renderer.close()


def test_the_thread_that_draws_does_tasks_itself():
    workers, met = sharing.Workers(2), threading.Barrier(2)

    def meet(number):
        met.wait(timeout=60)
        return number, threading.current_thread()

    # Two at a time, so both threads are at work.
    results = workers.run(meet, [(n,) for n in range(6)])
    workers.close()
    assert [number for number, _ in results] == [*range(6)]
    by = [thread for _, thread in results]
    assert by.count(threading.current_thread()) == 3
    assert len({*by}) == 2


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_error_of_the_first_task_that_fails_is_raised_and_no_other_is_begun(threads):
    workers, begun = sharing.Workers(threads), []

    def fail(number):
        begun.append(number)
        if number >= 5:
            # The later ones fail sooner.
            time.sleep(0.02 * max(8 - number, 0))
            raise IndexError(f"task {number}")
        return number

    for _ in range(3):
        begun.clear()
        with pytest.raises(IndexError, match=r"^task 5$"):
            workers.run(fail, [(n,) for n in range(1000)])
        assert len(begun) < 5 + 2 * threads
    assert workers.run(fail, [(n,) for n in range(4)]) == [*range(4)]
    workers.close()


def test_what_tiles_are_drawn_with_is_made_once_for_each_thread(cube, camera, monkeypatch):
    real, made = tile_rasterizer.make_tile_drawer, []

    def make(*arguments):
        made.append(arguments)
        return real(*arguments)

    monkeypatch.setattr(tile_rasterizer, "make_tile_drawer", make)
    size = (900, 900)
    with rj.Renderer(size, threads=2) as renderer:
        for _ in range(3):
            renderer.render(cube, camera)
            assert 1 <= len(made) <= 2


def test_a_few_thousand_faces_are_set_up_by_all_threads(monkeypatch):
    real, tasks = sharing.Workers.call, {}

    def call(workers, kernel, arguments):
        calls = list(arguments)
        tasks[kernel.__name__] = len(calls)
        return real(workers, kernel, calls)

    monkeypatch.setattr(sharing.Workers, "call", call)
    mesh, camera = wavy_grid(80), rj.PerspectiveCamera((0.5, -2.0, 1.2), (0, 0, 0))
    rj.render(mesh, camera, size=SIZE, threads=1)
    assert tasks["set_up_triangles"] == tasks["transform_vertices"] == 1
    rj.render(mesh, camera, size=SIZE, threads=2)
    assert tasks["set_up_triangles"] >= 4
    assert tasks["transform_vertices"] >= 2


def test_close_by_another_thread_as_a_frame_is_drawn_is_said(monkeypatch):
    workers = sharing.Workers(2)
    submit = ThreadPoolExecutor.submit

    def submit_late(pool, *call):
        workers.close()
        return submit(pool, *call)

    monkeypatch.setattr(ThreadPoolExecutor, "submit", submit_late)
    with pytest.raises(RuntimeError, match=r"^close\(\) was called while a frame was being drawn$"):
        workers.run(abs, [(-1,), (-2,)])
    monkeypatch.undo()
    assert workers.run(abs, [(-1,), (-2,)]) == [1, 2]
    workers.close()


@pytest.mark.parametrize("threads", [1, 2])
def test_close_by_another_thread_between_two_steps_of_a_frame_is_said(cube, camera, threads):
    renderer = rj.Renderer(SIZE, threads=threads)
    first = renderer.render(cube, camera)

    def close():
        closing = threading.Thread(target=renderer.close)
        closing.start()
        closing.join()

    renderer.on_picture = close
    with pytest.raises(RuntimeError, match=r"^close\(\) was called while a frame was being drawn$"):
        renderer.render(cube, camera)
    # No pool that nobody closes.
    assert renderer._workers._pool is None
    renderer.on_picture = None
    assert renderer.render(cube, camera).color.tobytes() == first.color.tobytes()
    renderer.close()


def test_split_into_objects_is_the_same_picture(cube, camera):
    halves = rj.Scene()
    for part in (slice(0, 6), slice(6, 12)):
        halves.add(rj.Mesh(cube.vertices, cube.faces[part]))
    outputs = ("face_id", "depth")
    one = rj.render(cube, camera, size=SIZE, outputs=outputs, threads=1)
    assert bits(rj.render(halves, camera, size=SIZE, outputs=outputs, threads=1)) == bits(one)


def test_instances_share_their_mesh(cube, camera):
    twice, copies = rj.Scene(), rj.Scene()
    for n in (0, 1):
        place = rj.transforms.translate((n, n, -n))
        twice.add(cube, place)
        copies.add(rj.Mesh(cube.vertices.copy(), cube.faces.copy()), place)
    one, other = (
        rj.render(s, camera, size=SIZE, outputs=PLAIN, threads=1) for s in (twice, copies)
    )
    # What is an instance and what a copy is all that tells them apart.
    assert one.instance_id.max() == 1
    assert other.instance_id.max() == 0
    one, other = bits(one), bits(other)
    assert one.pop("instance_id") != other.pop("instance_id")
    assert one == other


def test_invalid_vertices_can_be_dropped(cube, camera):
    vertices = np.concatenate([cube.vertices, [[np.nan, 0, 0], [np.inf, 1, 1]]])
    faces = np.concatenate([cube.faces, [[0, 1, 8], [1, 2, 9]]])
    with pytest.raises(ValueError, match="vertices"):
        rj.Mesh(vertices, faces)
    mesh = rj.Mesh(vertices, faces, on_invalid="drop")
    frame = rj.render(mesh, camera, size=SIZE, outputs=("face_id", "depth", "color"), threads=1)
    whole = rj.render(cube, camera, size=SIZE, outputs=("face_id", "depth", "color"), threads=1)
    assert frame.stats.invalid == 2
    assert bits(frame) == bits(whole)


def test_camera_inside_closed_mesh_sees_no_background(sphere):
    for target in ((1, 0, 0), (0, 1, 0.1), (-1, -2, 3)):
        camera = rj.PerspectiveCamera((0.1, 0.05, -0.1), target, fov_y=100.0, near=0.01)
        frame = rj.render(sphere, camera, size=(65, 33), outputs=("face_id", "depth"), threads=1)
        assert (frame.face_id >= 0).all()
        assert (frame.depth < 1.5).all()


def test_object_behind_the_camera_is_outside(cube):
    camera = rj.PerspectiveCamera((0, 0, 5), (0, 0, 9))
    frame = rj.render(cube, camera, size=SIZE, outputs=("color", "face_id"), threads=1)
    assert frame.stats.outside == 12
    assert (frame.face_id == -1).all()
    assert (frame.color == 255).all()


def test_flattened_object_is_harmless(sphere, camera):
    scene = rj.Scene()
    scene.add(sphere, np.diag([1.0, 1.0, 0.0, 1.0]))
    scene.add(sphere, np.diag([0.0, 0.0, 0.0, 1.0]))
    frame = rj.render(scene, camera, size=SIZE, outputs=PLAIN, threads=1)
    assert not np.isnan(frame.linear).any()
    assert not np.isnan(frame.normal).any()
    assert (frame.object_id == 0).any()


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (129, 65), (1000, 2)])
def test_any_size_renders(cube, camera, size):
    frame = rj.render(cube, camera, size=size, outputs=PLAIN, threads=2)
    assert frame.color.shape == (size[1], size[0], 4)


def test_no_camera_fits_the_scene(cube):
    frame = rj.render(cube, size=SIZE, outputs="face_id", threads=1)
    hit = frame.face_id >= 0
    assert hit.mean() > 0.15
    assert not hit[0].any()
    assert not hit[-1].any()
    assert not hit[:, 0].any()
    assert not hit[:, -1].any()


def test_back_faces_of_a_closed_mesh_change_nothing(cube, camera):
    outputs = ("color", "depth", "face_id")
    frames = [
        rj.render(cube, camera, size=SIZE, outputs=outputs, cull=cull, threads=1)
        for cull in ("none", "back")
    ]
    assert bits(frames[0]) == bits(frames[1])
    inner = rj.render(cube, camera, size=SIZE, outputs=outputs, cull="front", threads=1)
    assert (inner.depth[inner.face_id >= 0] > frames[0].depth[inner.face_id >= 0]).mean() > 0.95


@pytest.mark.parametrize("threads", [0, -1, 2000, True, 1.5])
def test_wrong_number_of_threads_is_named(cube, camera, threads):
    with pytest.raises(ValueError, match="threads"):
        rj.render(cube, camera, size=(8, 8), threads=threads)


def test_sub_pixel_bits_move_edges_by_less_than_a_pixel(sphere, camera):
    masks = {
        n: rj.render(
            sphere, camera, size=SIZE, outputs="face_id", threads=1,
            quality=rj.Quality(subpixel_bits=n),
        ).face_id >= 0
        for n in (0, 4, 8, 12)
    }  # fmt: skip
    wrong = {n: int((masks[n] != masks[12]).sum()) for n in masks}
    assert wrong[8] <= wrong[4] <= wrong[0]
    assert wrong[0] > 0


@pytest.mark.parametrize("far", [10.0, 1e3, 1e6, 1e9])
def test_a_far_plane_far_away_costs_a_parallel_view_no_depth(far):
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    scene = rj.Scene()
    scene.add(rj.Mesh(corners - [0.0, 0.0, 0.001], [[0, 1, 2]]))
    scene.add(rj.Mesh(corners, [[0, 1, 2]]))
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4, far=far)
    frame = rj.render(scene, camera, size=(32, 32), outputs=("depth", "object_id"), threads=1)
    seen = frame.object_id >= 0
    assert seen.sum() > 50
    assert (frame.object_id[seen] == 1).all()
    np.testing.assert_allclose(frame.depth[seen], 5.0, rtol=1e-6)


@pytest.mark.parametrize("size", [(1, 16384), (64, 48), (640, 480)])
@pytest.mark.parametrize("near", [1e-300, 1e-100, 1e-12, 0.1])
def test_wireframe_of_edges_through_the_eye_stays_in_its_picture(near, size):
    rng = np.random.default_rng(7)
    vertices = rng.normal(size=(600, 3)) * 10.0 ** rng.integers(-12, 7, (600, 1))
    scene = rj.Scene()
    scene.add(rj.Mesh(vertices, np.arange(600).reshape(-1, 3)))
    scene.wireframe = rj.Wireframe("red", mode="only")
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=90.0, near=near)
    frame = rj.render(scene, camera, size=size, threads=1)
    red = (frame.color == (255, 0, 0, 255)).all(axis=2)
    white = (frame.color == 255).all(axis=2)
    assert (red | white).all()
    assert red.any()


@pytest.mark.parametrize(
    ("attribute", "value"),
    [
        ("lights", ["sun"]),
        ("lights", None),
        ("lights", rj.AmbientLight()),
        ("nodes", ["cube"]),
    ],
)
def test_what_does_not_belong_in_a_scene_is_named(cube, attribute, value):
    scene = rj.Scene()
    scene.add(cube)
    setattr(scene, attribute, value)
    with pytest.raises(ValueError, match=rf"scene\.{attribute}"):
        rj.render(scene, size=(8, 8), threads=1)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"outputs": 5}, "outputs"),
        ({"outputs": np.array(["color"])}, "outputs"),
        ({"cull": np.array(["back"])}, "cull"),
        ({"camera": rj.PerspectiveCamera}, "camera"),
    ],
)
def test_an_argument_of_the_wrong_kind_is_named(cube, options, name):
    with pytest.raises(ValueError, match=name):
        rj.render(cube, size=(8, 8), threads=1, **options)


@pytest.mark.needs_jit
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_renderer_draws_on_in_a_forked_process(busy, camera):
    with rj.Renderer(SIZE, threads=2) as renderer:
        before = renderer.render(busy, camera).color.tobytes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # Python warns of threads.
            child = os.fork()
        if child == 0:
            os._exit(0 if renderer.render(busy, camera).color.tobytes() == before else 1)
        deadline = time.monotonic() + FORK_SECONDS
        while (done := os.waitpid(child, os.WNOHANG))[0] == 0:
            if time.monotonic() > deadline:
                os.kill(child, signal.SIGKILL)
                pytest.fail("the forked process hangs")
            time.sleep(0.01)
        assert done[1] == 0
        assert renderer.render(busy, camera).color.tobytes() == before


@pytest.mark.parametrize("count", [1, 3, 12])
def test_a_scene_without_a_finite_face_shows_the_background(camera, count):
    scene = rj.Scene()
    for _ in range(count):
        scene.add(rj.Mesh(np.full((3, 3), np.nan), [[0, 1, 2]], on_invalid="drop"))
    with pytest.warns(rj.ViewWarning):
        frame = rj.render(scene, camera, size=SIZE, background=(1.0, 0.0, 0.0))
    assert (frame.color == (255, 0, 0, 255)).all()
    with pytest.warns(rj.ViewWarning):
        batch = rj.render_batch(scene, [camera], size=SIZE, background=(1.0, 0.0, 0.0))
    assert (batch.color == frame.color).all()


def pickled(what):
    return pickle.loads(pickle.dumps(what))


@pytest.mark.parametrize("clone", [copy.copy, copy.deepcopy, pickled])
def test_a_copied_renderer_has_the_settings_and_draws_alone(cube, camera, clone):
    with rj.Renderer(SIZE, quality=rj.Quality(samples=4), threads=1) as renderer:
        first = renderer.render(cube, camera)
        with clone(renderer) as other:
            assert (other.size, other.quality) == (renderer.size, renderer.quality)
            assert np.array_equal(other.render(cube, camera).color, first.color)
        assert np.array_equal(renderer.render(cube, camera).color, first.color)
