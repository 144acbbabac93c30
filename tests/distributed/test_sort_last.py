"""Parts of a mesh, drawn where they are and merged, are the picture of the whole mesh."""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pieces import blob, joined

import rasterjit as rj
from rasterjit.distributed import sort_last
from rasterjit.rendering.planning import FrameRequest
from rasterjit.scene.scene import EFFECT_FIELDS

SIZE = (48, 36)
PATIENCE = 60.0
OUTPUTS = (
    "color", "linear", "depth", "face_id", "object_id", "barycentric", "geometric_normal",
    "position", "position_camera",
)  # fmt: skip
FLAT = rj.Material(shading="flat")
PAIRS = [blob(seed) for seed in range(5)]
# The same triangles again in another part: all of their depths are equal.
PAIRS.append(PAIRS[1])


def whole(pairs, view, setting=None, material=FLAT, outputs=OUTPUTS, **options):
    scene = rj.Scene()
    for name in ("lights", *EFFECT_FIELDS) if setting is not None else ():
        setattr(scene, name, getattr(setting, name))
    scene.add(rj.Mesh(*joined(pairs), material=material))
    return rj.render(scene, view, size=SIZE, outputs=outputs, **options)


def assert_same_bits(frame, wanted):
    assert list(frame.arrays()) == list(wanted.arrays())
    for name, array in wanted.arrays().items():
        assert array.tobytes() == frame.arrays()[name].tobytes(), name


def merged(parts, view, quality=None, setting=None, order=None, **options):
    """Merge layers in this process, in the order of a tree or in a given one."""
    chosen = FrameRequest(SIZE, quality or rj.Quality.standard(), OUTPUTS, None, "none")
    chosen = chosen._replace(**options)
    drawn = [
        sort_last.draw_part(part, setting or rj.Scene(), None, view, chosen, 1) for part in parts
    ]
    return (order or sort_last.merge_pairwise)(drawn, sort_last.merge_images).frame()


@pytest.mark.parametrize("count", range(1, 7))
def test_merged_layers_are_the_whole(view, count):
    assert_same_bits(merged(PAIRS[:count], view), whole(PAIRS[:count], view))


def test_parts_have_one_near_plane_that_cuts_none_of_them(client):
    eye = np.array((0.0, 0.0, 0.5))
    pairs = [(vertices * 0.01 + eye - (0.0, 0.0, 0.05), faces) for vertices, faces in PAIRS[:1]]
    pairs += PAIRS[1:3]
    camera = rj.PerspectiveCamera(tuple(eye), (0.0, 0.0, 0.0))
    for quality in (rj.Quality.standard(), rj.Quality(depth_format="unorm24")):
        wanted = whole(pairs, camera, quality=quality)
        near = wanted.plan.camera.near
        assert near < 0.1
        assert_same_bits(merged(pairs, replace(camera, near=near), quality), wanted)
        # Parts that are here, and some that only workers see.
        for parts in (pairs, [functools.partial(tuple, pair) for pair in pairs]):
            frame = rj.distributed.render_partitions(
                parts, camera, size=SIZE, outputs=OUTPUTS, quality=quality, client=client
            )
            assert frame.plan.camera.near == near
            assert_same_bits(frame, wanted)


def test_neighbours_may_be_merged_in_any_order(view):
    def from_the_end(drawn, merge):
        return functools.reduce(lambda later, one: merge(one, later), reversed(drawn))

    wanted = whole(PAIRS, view)
    assert_same_bits(merged(PAIRS, view, order=from_the_end), wanted)
    first_to_last = merged(PAIRS, view, order=lambda drawn, merge: functools.reduce(merge, drawn))
    assert_same_bits(first_to_last, wanted)


def test_equal_depths_go_to_the_lower_face(view):
    twice = [PAIRS[0], PAIRS[0]]
    frame = merged(twice, view)
    assert frame.face_id.max() < len(PAIRS[0][1])
    assert (frame.face_id >= 0).any()
    assert_same_bits(frame, whole(twice, view))


@pytest.mark.parametrize(
    "settings",
    [{"depth_format": "unorm16"}, {"depth_format": "float64"}, {"precision": "float32"}],
    ids=str,
)
def test_depths_are_compared_as_they_are_stored(view, settings):
    quality = replace(rj.Quality.standard(), **settings)
    assert_same_bits(merged(PAIRS, view, quality), whole(PAIRS, view, quality=quality))


def test_light_and_fog_hold_for_all_parts(view):
    setting = rj.Scene()
    setting.lights = [rj.PointLight((1.0, 2.0, 2.0)), rj.AmbientLight(intensity=0.1)]
    setting.fog = rj.Fog(mode="linear", start=1.0, end=8.0)
    setting.environment = rj.Environment.gradient()
    setting.tone_map = rj.ToneMap()
    setting.vignette = rj.Vignette(0.9, 0.1)
    assert_same_bits(merged(PAIRS, view, setting=setting), whole(PAIRS, view, setting=setting))


def test_parts_without_faces_count_nothing(view):
    empty = np.empty((0, 3)), np.empty((0, 3), int)
    parts = [empty, PAIRS[0], lambda: empty, PAIRS[1], empty]
    assert_same_bits(merged(parts, view), whole(PAIRS[:2], view))


def test_statistics_are_those_of_the_whole(view):
    found, wanted = merged(PAIRS, view).stats, whole(PAIRS, view).stats
    for name in (*sort_last.SUMMED_STATS, "pixels_covered"):
        assert getattr(found, name) == getattr(wanted, name), name


def test_more_faces_than_numbers_are_refused(view):
    options = FrameRequest(SIZE, rj.Quality.standard(), ("color",), None, "none")
    one = sort_last.draw_part(PAIRS[0], rj.Scene(), None, view, options, 1)
    with pytest.raises(ValueError, match="partitions must have at most 2147483647 faces"):
        sort_last.merge_images(one, replace(one, face_count=2**31 - 60))


def load_slowly(pair, marker):
    """Return a part, and leave a mark that a worker has begun with it."""
    Path(marker).touch()
    time.sleep(0.5)
    return pair


@pytest.mark.needs_jit
def test_parts_of_all_kinds_are_the_whole_on_a_cluster(client, view):
    import dask

    parts = [
        PAIRS[0],
        rj.Mesh(*PAIRS[1], material=FLAT),
        [PAIRS[2], PAIRS[3]],
        functools.partial(blob, 4),
        dask.delayed(blob)(1),
    ]
    frame = rj.distributed.render_partitions(parts, view, size=SIZE, outputs=OUTPUTS, client=client)
    assert_same_bits(frame, whole(PAIRS, view))


@pytest.mark.needs_jit
def test_bag_is_the_whole(client, view):
    import dask.bag

    bag = dask.bag.from_sequence(range(5), npartitions=3).map(blob)
    frame = rj.distributed.render_partitions(bag, view, size=SIZE, outputs=OUTPUTS, client=client)
    assert_same_bits(frame, whole(PAIRS[:5], view))


@pytest.mark.takes_long
@pytest.mark.needs_jit
@pytest.mark.parametrize("are_here", [False, True], ids=["loaded there", "sent from here"])
def test_worker_killed_in_the_middle_changes_no_bit(doomed, view, tmp_path, are_here):
    slow = [
        functools.partial(load_slowly, pair, str(tmp_path / str(n))) for n, pair in enumerate(PAIRS)
    ]
    parts = [*PAIRS[:3], *slow[3:]] if are_here else slow
    found = {}

    def render():
        found["frame"] = rj.distributed.render_partitions(
            parts, view, size=SIZE, outputs=OUTPUTS, client=doomed
        )

    victim = next(iter(doomed.run(os.getpid).values()))
    taker = threading.Thread(target=render, daemon=True)
    taker.start()
    deadline = time.monotonic() + PATIENCE
    while not any(tmp_path.iterdir()) and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.7)
    assert taker.is_alive()
    os.kill(victim, signal.SIGKILL)
    taker.join(PATIENCE)
    assert not taker.is_alive()
    assert_same_bits(found["frame"], whole(PAIRS, view))
    assert victim not in doomed.run(os.getpid).values()


@pytest.mark.needs_jit
def test_error_of_a_loader_comes_through(client, view):
    def failing():
        raise OSError("no such part")

    with pytest.raises(OSError, match="no such part"):
        rj.distributed.render_partitions([PAIRS[0], failing], view, size=SIZE, client=client)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (rj.Mesh(*PAIRS[0], material=rj.Material(shading="phong")), "must have normals where"),
        (
            rj.Mesh(
                *PAIRS[0],
                material=rj.Material(
                    shading="flat", base_color=(1.0, 1.0, 1.0, 0.5), alpha_mode="blend"
                ),
            ),
            "partitions must be opaque",
        ),
        (lambda: "a file", "partitions must give a Mesh"),
    ],
    ids=["smooth", "glass", "text"],
)
def test_part_that_cannot_be_merged_is_refused(view, part, message):
    with pytest.raises(ValueError, match=message):
        merged([part], view)


@pytest.mark.parametrize("shading", ["phong", "flat", "unlit"])
def test_part_with_normals_is_the_whole(view, shading):
    vertices, faces = joined(PAIRS[:2])
    normals = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    material, half = rj.Material(shading=shading), len(PAIRS[0][0])
    outputs = (*OUTPUTS, "normal", "normal_camera")
    parts = [
        rj.Mesh(pair[0], pair[1], normals=own, material=material)
        for pair, own in zip(PAIRS[:2], (normals[:half], normals[half:]), strict=True)
    ]
    mesh = rj.Mesh(vertices, faces, normals=normals, material=material)
    wanted = rj.render(mesh, view, size=SIZE, outputs=outputs)
    assert_same_bits(merged(parts, view, outputs=outputs), wanted)


def shadowed():
    setting = rj.Scene()
    setting.lights = [rj.DirectionalLight((0, -1, 0), shadow=rj.Shadow())]
    return setting


def domed():
    setting = rj.Scene()
    setting.eye_dome = rj.EyeDome()
    return setting


def outlined():
    setting = rj.Scene()
    setting.outline = rj.Outline()
    return setting


def full():
    setting = rj.Scene()
    setting.add(rj.Mesh(*PAIRS[0]))
    return setting


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"partitions": "meshes"}, "partitions must be a sequence of parts or a dask Bag, got"),
        ({"partitions": []}, "partitions must hold at least one part"),
        ({"partitions": [3]}, r"partitions\[0\] must be a Mesh"),
        ({"partitions": [(1, 2, 3)]}, "partitions must give a Mesh"),
        ({"camera": None}, "camera must be a PerspectiveCamera"),
        ({"setting": shadowed()}, r"setting\.lights\[0\] must cast no shadow"),
        ({"setting": outlined()}, r"setting\.outline must be None"),
        ({"setting": domed()}, r"setting\.eye_dome must be None"),
        ({"setting": full()}, "setting must be a scene without meshes, got 1"),
        ({"setting": "sunny"}, "setting must be a Scene or None"),
        ({"material": "red"}, "material must be a Material or None"),
        ({"quality": rj.Quality(samples=4)}, "quality.samples must be 1 where parts are merged"),
        ({"outputs": ("uv",)}, "have none"),
        ({"outputs": ("nocs",)}, "needs the box of the whole mesh"),
        ({"size": (0, 1)}, "size must be"),
        ({"client": 3}, "client must be a distributed.Client, got int"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_is_drawn(view, wrong, message):
    given = {"partitions": PAIRS, "camera": view, "size": SIZE, **wrong}
    with pytest.raises(ValueError, match=message):
        rj.distributed.render_partitions(given.pop("partitions"), given.pop("camera"), **given)


@pytest.mark.parametrize(
    ("part", "options", "message"),
    [
        (rj.Mesh(*PAIRS[0], material=rj.Material(shading="phong")), {}, "must have normals where"),
        (PAIRS[0], {"material": rj.Material(shading="phong")}, "must have normals where"),
        (
            rj.Mesh(
                *PAIRS[0],
                material=rj.Material(
                    shading="flat", normal_texture=rj.Texture(np.zeros((2, 2, 4), np.uint8))
                ),
            ),
            {},
            "partitions must have no normal_texture",
        ),
        (
            PAIRS[0],
            {
                "material": rj.Material(
                    shading="flat", base_color=(1.0, 1.0, 1.0, 0.5), alpha_mode="blend"
                )
            },
            "partitions must be opaque",
        ),
        ([PAIRS[0], PAIRS[1]], {"outputs": ("uv",)}, "have none"),
        (PAIRS[0], {"outputs": ("normal",)}, "normals for the output 'normal', .*geometric_normal"),
        (PAIRS[0], {"outputs": ("normal_camera",)}, "normals for the output 'normal_camera', "),
        (rj.Mesh(*PAIRS[0], material=FLAT), {"outputs": ("uv",)}, "no mesh of the scene has"),
    ],
    ids=[
        "smooth",
        "smooth pair",
        "normal texture",
        "glass",
        "uv of a list",
        "normals of a pair",
        "normals of a pair in camera space",
        "uv of a mesh",
    ],
)
def test_part_that_is_here_is_refused_before_others_are_drawn(view, client, part, options, message):
    def forbidden():
        raise AssertionError("another part was loaded")

    parts = iter([forbidden, part])
    with pytest.raises(ValueError, match=message):
        rj.distributed.render_partitions(parts, view, size=SIZE, client=client, **options)
    assert not any(client.has_what().values())


def test_uv_of_a_bag_is_refused(view, client):
    import dask.bag

    bag = dask.bag.from_sequence(range(2), npartitions=2).map(blob)
    with pytest.raises(ValueError, match="outputs has 'uv'"):
        rj.distributed.render_partitions(bag, view, size=SIZE, outputs=("uv",), client=client)


ALONE = """
import logging, multiprocessing, sys
import numpy as np
import rasterjit as rj

if __name__ == "__main__":
    logging.getLogger("rasterjit.distributed").addHandler(logging.StreamHandler(sys.stdout))
    logging.getLogger("rasterjit.distributed").setLevel(logging.INFO)
    camera = rj.PerspectiveCamera(eye=(2, 2, 2), target=(0, 0, 0))
    frame = rj.distributed.render_partitions([(np.eye(3), [(0, 1, 2)])], camera, size=(24, 16))
    one = rj.render(rj.Mesh(np.eye(3), [(0, 1, 2)], material=rj.Material(shading="flat")), camera,
                    size=(24, 16))
    print(np.array_equal(frame.color, one.color), multiprocessing.active_children())
"""


@pytest.mark.takes_long
@pytest.mark.needs_jit
def test_local_cluster_is_made_and_closed(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(ALONE)
    done = subprocess.run(
        [sys.executable, str(program)], capture_output=True, text=True, timeout=2 * PATIENCE,
        check=True,
    )  # fmt: skip
    first, last = done.stdout.splitlines()
    assert first.startswith("dashboard: http")
    assert last == "True []"
