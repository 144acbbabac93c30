"""The ways to draw views of a scene, and that all have the bits of one lone frame of each."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.outputs.output_table import MOTION_OUTPUTS, OUTPUTS
from rasterjit.rendering import recorded_frames
from rasterjit.rendering.batch_scheduler import COUNTED
from rasterjit.rendering.regions import Region, RegionRenderer
from rasterjit.runtime import jit

MODELS = Path(__file__).parents[2] / "models"
SIZE = (40, 28)
CAMERA = rj.PerspectiveCamera(eye=(0.0, 0.5, 4.0), target=(0.0, 0.0, 0.0))
ALL = tuple(name for name in OUTPUTS if name not in MOTION_OUTPUTS)
in_groups = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="needs machine code")
COUNTS = "pixels_covered", *COUNTED
"""What statistics count."""


def around(count, distance=4.0):
    """Return cameras on a ring."""
    return [
        rj.PerspectiveCamera(
            (distance * math.cos(a), 1.0, distance * math.sin(a)), (0.1, 0.0, 0.0), fov_y=50.0
        )
        for a in np.linspace(0.0, 6.0, count).tolist()
    ]


def random_cameras(count, seed):
    """Return cameras of all kinds: near and far, inside of things, looking anywhere."""
    rng, made = np.random.default_rng(seed), []
    for n in range(count):
        eye = rng.normal(0.0, (0.5, 2.0, 4.0)[n % 3], 3)
        target = rng.normal(0.0, 0.7, 3)
        up = rng.normal(0.0, 1.0, 3)
        near = (None, 0.3, 1e-3)[rng.integers(3)]
        far = (math.inf, 50.0, 5.0)[rng.integers(3)]
        kind = n % 5
        if kind in (0, 1):
            made.append(
                rj.PerspectiveCamera(eye, target, up, float(rng.uniform(20, 110)), near, far)
            )
        elif kind == 2:
            far = (None, 50.0)[rng.integers(2)]
            made.append(rj.OrthographicCamera(eye, target, up, float(rng.uniform(1, 5)), far=far))
        else:
            view = rj.transforms.look_at(eye, target, up)
            own = rj.PerspectiveCamera(eye, target, up, near=near or 0.1, far=far)
            clip = own.projection_matrix(SIZE)
            if kind == 3:
                clip = rj.OrthographicCamera(eye, target, up).projection_matrix(SIZE)
            # Sheared, mirrored, off the middle.
            clip[0, 1], clip[0, 2] = rng.normal(0.0, 0.1, 2)
            clip[0] *= rng.choice((-1.0, 1.0))
            is_open = bool(kind == 4 and rng.integers(2) and near is None)
            made.append(rj.MatrixCamera(view, clip, SIZE, is_open))
    return made


def lone(scene, camera, **asked):
    """Draw one view on one thread: the picture that every other way has the bits of."""
    return rj.render(scene, camera, threads=1, **asked)


def by_threads(scene, cameras, **asked):
    """Draw each view with three threads."""
    return [rj.render(scene, camera, threads=3, **asked) for camera in cameras]


def by_one_renderer(scene, cameras, threads=2, times=1, **asked):
    """Draw each view with one renderer, so many times in a row, and return the last frames."""
    size, quality = asked.pop("size"), asked.pop("quality", None)
    with rj.Renderer(size, quality=quality, threads=threads) as renderer:
        return [
            [renderer.render(scene, camera, **asked) for _ in range(times)][-1]
            for camera in cameras
        ]


def by_bound_calls(scene, cameras, **asked):
    """Draw each view with a renderer of one thread, which binds the calls of its third frame."""
    return by_one_renderer(
        scene, cameras, threads=1, times=recorded_frames.MIN_ALIKE_FRAMES + 1, **asked
    )


def as_stream(scene, cameras, **asked):
    """Draw views one after the other with `rasterjit.render_many`."""
    return [*rj.render_many(scene, cameras, threads=2, **asked)]


WAYS = {
    "three threads": by_threads, "a renderer": by_one_renderer, "bound calls": by_bound_calls,
    "a stream": as_stream,
}  # fmt: skip
"""Ways that return frames, by name."""


def arrays_of(frame):
    """Return what can be compared of the outputs of a frame."""
    return {name: (array.dtype, array.tobytes()) for name, array in frame.arrays().items()}


def told(frame):
    """Return all that two frames of the same view share: outputs, plan, counts, share of white."""
    counts = {name: getattr(frame.stats, name) for name in COUNTS}
    rest = counts, frame._white_share, hasattr(frame, "diagnostics")
    return arrays_of(frame), str(frame.plan), *rest


def differing(frame, wanted):
    """Return the names of what differs between two frames."""
    (arrays, *rest), (others, *others_rest) = told(frame), told(wanted)
    names = [name for name in others if arrays.get(name) != others[name]]
    names += [name for name in arrays if name not in others]
    parts = zip(("plan", "counts", "white", "diagnostics"), rest, others_rest, strict=True)
    return names + [name for name, one, other in parts if one != other]


def check_batch(scene, cameras, frames, transforms=None, threads=2, **asked):
    """Hold a batch against the frames of its views, and its counts against their sums."""
    batch = rj.render_batch(scene, cameras, transforms=transforms, threads=threads, **asked)
    for number, frame in enumerate(frames):
        for name, wanted in frame.arrays().items():
            found = batch.arrays()[name][number]
            assert found.dtype == wanted.dtype, name
            assert found.tobytes() == wanted.tobytes(), f"batch, view {number}: {name}"
    for name in COUNTS:
        total = sum(getattr(frame.stats, name) for frame in frames)
        assert getattr(batch.stats, name) == total, f"batch: {name}"
    return batch


def check(scene, cameras, transforms=None, **asked):
    """Hold a batch against one lone frame of each view, its objects where it has them."""
    frames, before = [], [node.world_from_model for node in scene.nodes]
    asked.setdefault("size", SIZE)
    own = {name: value for name, value in asked.items() if name not in ("threads", "out")}
    for camera, places in zip(
        cameras, [()] * len(cameras) if transforms is None else transforms, strict=True
    ):
        for node, matrix in zip(scene.nodes, places, strict=False):
            node.world_from_model = matrix
        frames.append(lone(scene, camera, **own))
    for node, matrix in zip(scene.nodes, before, strict=True):
        node.world_from_model = matrix
    return check_batch(scene, cameras, frames, transforms, **asked)


def check_regions(scene, camera, frame, side=64, **asked):
    """Hold parts of a view, drawn one by one, against the whole; where parts can be drawn."""
    try:
        renderer = RegionRenderer(scene, camera, threads=2, **asked)
    except ValueError:
        return
    width, height = asked["size"]
    with renderer:
        if renderer.plan.has("shadows"):
            # Maps of a part are smaller.
            return
        for left in range(0, width, side):
            part = renderer.render_region(Region(left, 0, min(side, width - left), height))
            for name, whole in frame.arrays().items():
                own, wanted = part.arrays()[name], whole[:, left : left + side]
                assert own.tobytes() == wanted.tobytes(), f"region at {left}: {name}"


def check_every_way(scene, cameras, **asked):
    """Hold all ways to draw some views against one lone frame of each, and return these."""
    with warnings.catch_warnings():
        # Planes cut what is in view, and open objects, on purpose.
        warnings.simplefilter("ignore", UserWarning)
        frames = [lone(scene, camera, **asked) for camera in cameras]
        for way, draw in WAYS.items():
            for number, frame in enumerate(draw(scene, cameras, **asked)):
                assert differing(frame, frames[number]) == [], f"{way}, view {number}"
        check_batch(scene, cameras, frames, **asked)
        check_regions(scene, cameras[-1], frames[-1], **asked)
    return frames


def mixed_scene():
    """Return three objects: smooth, with colours of vertices, and with a texture."""
    made = rj.Scene()
    knot = rj.load(MODELS / "torus_knot.obj").nodes[0].mesh
    made.add(knot, rj.transforms.scale((0.4, 0.4, 0.4)))
    colors = np.random.default_rng(1).random((24, 3))
    cube = rj.load(MODELS / "cube.ply").nodes[0].mesh
    made.add(
        rj.Mesh(
            cube.vertices, cube.faces, colors=colors, material=rj.Material("unlit")
        ),
        rj.transforms.translate((1.4, 0.2, -0.3)),
    )  # fmt: skip
    texture = rj.Texture(np.random.default_rng(2).integers(0, 255, (4, 4, 3), np.uint8))
    quad = rj.Mesh(
        [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)],
        uv=[(0, 0), (1, 0), (1, 1), (0, 1)], material=rj.Material(base_color_texture=texture),
        scalars=[1, 2, 5, np.nan], contours=2, norm="log",
    )  # fmt: skip
    made.add(quad, rj.transforms.translate((-1.2, 0.0, -1.0)))
    return made
