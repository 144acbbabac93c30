"""A robot's arm is turned joint by joint, and its hand is seen where kinematics says."""

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.transforms import compose, rotate_y, rotate_z, translate

COLUMN, UPPER, LOWER = 0.5, 1.5, 1.0
"""Lengths of the links, scene units."""

SNAPPED = 0.01
"""Pixels by which a vertex may be off on the grid of 1/256 pixel, and what that does to a face."""


def points_of_hand(points, turn, shoulder, elbow):
    """Return where points (N, 3) of the hand are, by the formula: in a plane, angles add up."""
    turn, shoulder, bend = np.radians((turn, shoulder, shoulder + elbow))
    x, y, z = points.T
    reach = UPPER * np.cos(shoulder) + (LOWER + x) * np.cos(bend) - y * np.sin(bend)
    height = COLUMN + UPPER * np.sin(shoulder) + (LOWER + x) * np.sin(bend) + y * np.cos(bend)
    across = (reach * np.cos(turn) + z * np.sin(turn), z * np.cos(turn) - reach * np.sin(turn))
    return np.stack([across[0], height, across[1]], axis=1)


def pixels_of(camera, points, size):
    """Return where points (N, 3) in the world are seen, (N, 2) pixels."""
    rows = np.column_stack([points, np.ones(len(points))])
    x, y, _, w = camera.projection_matrix(size) @ camera.view_matrix() @ rows.T
    return np.stack([(1 + x / w) * size[0] / 2, (1 - y / w) * size[1] / 2], axis=1)


def test_the_hand_of_a_turned_arm_is_seen_where_kinematics_says():
    bar, ball = (trimesh.creation.box((1.0, 0.1, 0.1)), trimesh.creation.icosphere(2, 0.2))
    scene, size, angles, errors = rj.Scene(), (320, 240), [0.0, 0.0, 0.0], []
    robot = scene.add(rj.Node(name="robot"))
    turn = rj.Node(name="turn", parent=robot)
    shoulder = rj.Node(None, translate((0, COLUMN, 0)), "shoulder", parent=turn)
    elbow = rj.Node(None, translate((UPPER, 0, 0)), "elbow", parent=shoulder)
    for joint, length in ((shoulder, UPPER), (elbow, LOWER)):
        stretched = np.diag([length, 1.0, 1.0, 1.0])
        scene.add(bar, compose(translate((length / 2, 0, 0)), stretched), parent=joint)
    hand = scene.add(ball, translate((LOWER, 0, 0)), "hand", parent=elbow)
    camera = rj.PerspectiveCamera(eye=(3, 3, 8), target=(0, 1, 0))
    with rj.Renderer(size) as renderer:
        for joint, angle in [(0, 50), (1, 60), (2, -80), (0, -70), (1, 20), (2, 35), (1, 80)]:
            angles[joint] = angle
            turn.transform = rotate_y(angles[0])
            shoulder.transform = compose(translate((0, COLUMN, 0)), rotate_z(angles[1]))
            scene.find("elbow").transform = compose(translate((UPPER, 0, 0)), rotate_z(angles[2]))
            frame = renderer.render(scene, camera, outputs=("object_id", "object_position"))
            seen = frame.object_id == scene.nodes.index(hand)
            wanted = pixels_of(camera, points_of_hand(frame.object_position[seen], *angles), size)
            errors.append(np.abs(wanted - np.argwhere(seen)[:, ::-1] - 0.5).max())
            assert seen.sum() > 50
            origin = points_of_hand(np.zeros((1, 3)), *angles)[0]
            assert hand.world_matrix[:3, 3] == pytest.approx(origin, abs=1e-14)
    assert max(errors) < SNAPPED, errors
