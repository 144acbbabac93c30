"""A flight through a room has its frames and its length, and goes through nothing."""

from __future__ import annotations

import imageio_ffmpeg
import numpy as np
import pytest
import trimesh

import rasterjit as rj


@pytest.fixture
def module(program):
    return program("flight")


def solid(scene):
    """The room and all that stands in it, as one mesh of trimesh."""
    parts = []
    for node in scene.nodes:
        places = rj.transforms.apply(node.world_matrix, node.mesh.vertices)
        parts.append(trimesh.Trimesh(places, node.mesh.faces, process=False))
    return trimesh.util.concatenate(parts)


def models(module):
    return module.Path("models/teapot.obj"), module.Path("models/torus_knot.obj")


def test_the_eye_goes_through_no_wall(module):
    mesh = solid(module.furnish(*models(module)))
    camera = module.spline_camera(module.ROUTE, 8.0)
    eyes = np.array([camera(t).eye for t in np.linspace(0.0, 8.0, 400)])
    steps = np.diff(eyes, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    moving = lengths > 0.0
    ahead = mesh.ray.intersects_location(
        eyes[:-1][moving], steps[moving] / lengths[moving, None], multiple_hits=False
    )
    free = np.full(moving.sum(), np.inf)
    free[ahead[1]] = np.linalg.norm(ahead[0] - eyes[:-1][moving][ahead[1]], axis=1)
    assert (free > lengths[moving] + 0.2).all()
    assert (np.abs(eyes) < (4.0, 2.8, 2.5)).all()
    assert np.abs(eyes[[0, -1]] - np.array(module.ROUTE)[[0, -1]]).max() < 1e-12


def test_the_clearance_is_the_distance_to_the_nearest_surface(module):
    scene = module.furnish(*models(module))

    def standing(time):
        return rj.PerspectiveCamera((3.2, 1.2, 1.0 + time), (0.0, 1.0, 0.0))

    # The wall at x = 4 is the nearest, then that at z = 2.5.
    assert module.clearance(scene, standing, [0.0]) == pytest.approx(0.8, abs=0.01)
    assert module.clearance(scene, standing, [0.0, 1.0]) == pytest.approx(0.5, abs=0.01)


def test_a_route_into_a_wall_is_refused(module, monkeypatch):
    monkeypatch.setattr(module, "ROUTE", [(-3, 1.5, 1), (3.9, 1.5, 1), (-3, 1.5, 1.5)])
    with pytest.raises(SystemExit, match="too near"):
        module.main(["--seconds", "1", "--fps", "8", "--size", "64", "36"])


# imageio-ffmpeg leaves a pipe to a process that has ended to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_the_film_has_its_frames_and_its_length(module):
    module.main(["--seconds", "1.5", "--fps", "8", "--size", "96", "54", "--samples", "1"])
    assert imageio_ffmpeg.count_frames_and_secs("flight.mp4") == (12, 1.5)


def test_blur_is_the_mean_of_the_light(module):
    scene = module.furnish(*models(module))
    camera = module.spline_camera(module.ROUTE, 8.0)
    frames = [
        rj.render(scene, camera(2.0 + 0.02 * k), size=(96, 54), outputs=("color", "linear"))
        for k in range(4)
    ]
    (alone,) = module.blurred(iter(frames[:1]), 1)
    assert np.array_equal(alone, frames[0].color[..., :3])
    (mixed,) = module.blurred(iter(frames), 4)
    colors = np.stack([frame.color[..., :3] for frame in frames]).astype(int)
    assert (mixed >= colors.min(axis=0)).all()
    assert (mixed <= colors.max(axis=0)).all()
    assert (mixed != colors[0]).any()
