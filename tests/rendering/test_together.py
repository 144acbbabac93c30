"""What views that are drawn in groups have room for, and what is found out for all at once."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from ways import around, check, in_groups, mixed_scene, random_cameras

import rasterjit as rj
from rasterjit.rendering import batch, batch_scheduler, command_buffer
from rasterjit.scene import transforms
from rasterjit.survey import object_transforms
from rasterjit.survey.batched_views import transform_batched_objects, transform_to_views


@pytest.fixture
def scene():
    """Return three objects: smooth, with colours of vertices, and with a texture."""
    return mixed_scene()


@pytest.fixture
def alone(monkeypatch):
    """Return the numbers of the views that are drawn one by one."""
    numbers, draw = [], batch.SingleViewDrawer.__call__

    def noted(self, group):
        numbers.extend(group)
        return draw(self, group)

    monkeypatch.setattr(batch.SingleViewDrawer, "__call__", noted)
    return numbers


@in_groups
def test_cameras_that_look_away_from_some_objects_are(scene, alone):
    # Objects behind the eye have vertices that would have to be cut, if they were in view.
    for n in range(12):
        turn = transforms.rotate_y(30.0 * n)
        scene.add(
            scene.nodes[0].mesh,
            transforms.compose(turn, transforms.translate((9, 0, 0)), transforms.scale((0.3,) * 3)),
        )
    cameras = [
        rj.PerspectiveCamera((0.0, 4.0, 0.0), (9 * math.cos(a), 3.0, 9 * math.sin(a)), fov_y=30.0)
        for a in np.linspace(0.0, 6.0, 8).tolist()
    ]
    check(scene, cameras, outputs=("color", "depth"))
    assert len(alone) < 3


@in_groups
@pytest.mark.filterwarnings("ignore::rasterjit.ViewWarning")
def test_more_faces_to_cut_than_there_is_room_for_are_drawn_one_by_one(alone, monkeypatch):
    monkeypatch.setattr(command_buffer, "clip_capacity", lambda faces: (1, 28))
    cameras = [
        replace(camera, near=near) for camera, near in zip(around(4), (0.1, 3.9) * 2, strict=True)
    ]
    check(mixed_scene(), cameras, outputs=("color",))
    assert sorted(alone) == [1, 3]


def test_planes_that_cut_name_the_first_view(scene):
    cameras = [
        replace(camera, near=near)
        for camera, near in zip(around(4), (0.1, 0.1, 3.5, 3.6), strict=True)
    ]
    with pytest.warns(rj.ViewWarning, match=r"camera\.near = 3\.5 cuts .* \(cameras\[2\]\)"):
        rj.render_batch(scene, cameras, size=(40, 28), threads=2)


@in_groups
def test_more_layers_than_there_is_room_for_are_drawn_one_by_one(alone):
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    glass = rj.Material("unlit", (0.9, 0.5, 0.2, 0.2), alpha_mode="blend")
    scene = rj.Scene()
    for n in range(command_buffer.MAX_LAYERS):
        pane = rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=glass)
        scene.add(pane, rj.transforms.translate((0.1 * n, 0.0, -0.1 * n)))
    camera = rj.PerspectiveCamera((0.4, 0.1, 4.0), (0.4, 0.0, 0.0))
    check(scene, [camera] * 2, outputs=("color", "linear"), size=(80, 70))
    assert alone == []
    scene.add(rj.Mesh(corners - (0, 0, 3), [(0, 1, 2), (0, 2, 3)], material=glass))
    check(scene, [camera] * 2, outputs=("color", "linear"), size=(80, 70))
    assert sorted(alone) == [0, 1]


@in_groups
def test_longer_lists_than_there_is_room_for_are_drawn_one_by_one(alone):
    rng = np.random.default_rng(5)
    # Every face reaches all tiles of the picture, and there are more tiles than lists have room.
    corners = rng.uniform(-1.0, 1.0, (9000, 3, 3)) * (0.1, 0.1, 0.5)
    corners += [(-9, -6, 0), (9, -6, 0), (0, 12, 0)]
    scene = rj.Scene()
    scene.add(rj.Mesh(corners.reshape(-1, 3), np.arange(27000).reshape(-1, 3)))
    camera = rj.PerspectiveCamera((0, 0, 4), (0, 0, 0))
    check(scene, [camera] * 2, outputs=("face_id",), size=(64, 64))
    assert alone == []
    check(scene, [camera] * 2, outputs=("face_id",), size=(384, 384))
    assert sorted(alone) == [0, 1]


@in_groups
def test_longer_lists_of_samples_than_there_is_room_for_are_drawn_one_by_one(alone):
    # All end below the border of two rows of tiles, before the next centres of pixels.
    corners = np.tile([(-2000, -0.3, 0), (2000, -0.3, 0), (0, 4000, 0)], (9000, 1, 1)).astype(float)
    corners[..., 2] = np.linspace(-9.0, 0.0, 9000)[:, np.newaxis]
    scene, quality = rj.Scene(), rj.Quality(samples=4)
    scene.add(rj.Mesh(corners.reshape(-1, 3), np.arange(27000).reshape(-1, 3)))
    camera = rj.OrthographicCamera((0, 0, 100), (0, 0, 0), height=128.0)
    check(scene, [camera] * 2, outputs=("color",), size=(768, 128))
    check(scene, [camera] * 2, outputs=("color",), size=(192, 128), quality=quality)
    assert alone == []
    check(scene, [camera] * 2, outputs=("color",), size=(768, 128), quality=quality)
    assert sorted(alone) == [0, 1]


@in_groups
def test_kinds_of_views_beyond_those_kept_are_drawn_one_by_one(scene, alone, monkeypatch):
    monkeypatch.setattr(batch_scheduler, "MAX_KINDS", 1)
    cameras = [
        rj.PerspectiveCamera((1.4, 0.2, 4.0), (1.4, 0.2, 0.0), fov_y=3.0),
        rj.PerspectiveCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0)),
    ]
    check(scene, cameras, outputs=("color",), threads=1)
    assert alone == [1]


def test_matrices_of_many_views_have_the_bits_of_each(scene):
    cameras = random_cameras(100, 4)
    rng = np.random.default_rng(6)
    moved = np.tile(np.eye(4), (100, 3, 1, 1))
    moved[..., :3, :] += rng.normal(0.0, 0.5, (100, 3, 3, 4))
    places = transform_batched_objects(moved)
    views = transform_to_views(
        moved, np.array([camera.eye_position() for camera in cameras]),
        np.array([camera.view_matrix() for camera in cameras]),
        np.array([camera.projection_matrix((40, 28)) for camera in cameras]),
    )  # fmt: skip
    bounds = object_transforms.compute_mesh_boxes([node.mesh for node in scene.nodes])
    measures = object_transforms.measure_boxes(
        bounds, views.relative_from_model, views.clip_from_relative
    )
    largest = measures.compute_max_w()
    near, far = rng.normal(0.0, 2.0, (2, 100, 1))
    crosses = measures.may_cross(near, far)
    for n, camera in enumerate(cameras):
        own = object_transforms.transform_objects(list(moved[n]))
        wanted = object_transforms.transform_to_view(own, camera, (40, 28))
        for name in ("relative_from_model", "clip_from_relative", "toward_viewer"):
            assert getattr(views, name)[n].tobytes() == getattr(wanted, name).tobytes(), name
        assert views.screen_winding[n] == wanted.screen_winding
        assert places.normal_matrices[n].tobytes() == wanted.normal_matrices.tobytes()
        assert places.mirrored[n].tobytes() == wanted.mirrored.tobytes()
        boxes = object_transforms.Boxes(bounds, camera.eye_position(), *wanted[:2])
        assert measures.in_view[n].tolist() == boxes.in_view.tolist()
        assert largest[n] == boxes.compute_max_w()
        assert crosses[n].tolist() == boxes.may_cross(near[n, 0], far[n, 0]).tolist()
        for cull in ("none", "back", "front"):
            single = np.array([False, True, False])
            turns = object_transforms.find_culled_windings(
                cull,
                views.screen_winding[n : n + 1, np.newaxis],
                places.mirrored[n : n + 1],
                single,
            )
            turned = wanted.screen_winding, wanted.mirrored
            one = object_transforms.cull_objects(cull, *turned, np.arange(4), single)
            assert turns[0].tolist() == one.culled_windings.tolist()
    assert 0 < measures.in_view.sum() < measures.in_view.size
    assert 0 < crosses.sum() < crosses.size
