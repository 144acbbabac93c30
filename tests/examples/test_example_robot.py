"""A robot's links stand where its joints put them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

ANGLES = {"turn": 2.5, "lift": 0.4, "elbow": 1.1, "reach": 0.12, "bend": -0.7, "left": 0.05}


def step(offset, rotation=None):
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    if rotation is not None:
        matrix[:3, :3] = rotation.as_matrix()
    return matrix


def around(axis, radians):
    return Rotation.from_rotvec(radians * np.eye(3)["xyz".index(axis)])


def expected(turn, lift, elbow, reach, bend, left):
    """The chain of arm.urdf, written out by hand."""
    hand = (
        step((0, 0, 0.08), around("z", turn))
        @ step((0, 0, 0.20), around("y", lift))
        @ step((0, 0, 0.44), around("y", elbow))
        @ step((0, 0, 0.30 + reach))
        @ step((0, 0, 0.20), around("y", bend))
        @ step((0, 0, 0.03), around("z", 0.7853982))
    )
    return hand, hand @ step((0, left, 0.06))


def test_links_stand_where_the_matrices_say(program):
    module = program("robot")
    robot = module.load_urdf(module.Path(module.__file__).with_name("arm.urdf"))
    robot.move(**ANGLES)
    hand, finger = expected(**ANGLES)
    np.testing.assert_allclose(robot.links["hand"].world_matrix, hand, atol=1e-12)
    np.testing.assert_allclose(robot.links["left_finger"].world_matrix, finger, atol=1e-12)
    # What is drawn moves with it: the box of the finger, 0.05 above the link's origin.
    drawn = next(node for node in robot.scene.nodes if node.parent is robot.links["left_finger"])
    middle = (drawn.world_matrix @ [*drawn.mesh.vertices.mean(axis=0), 1.0])[:3]
    np.testing.assert_allclose(middle, (finger @ (0, 0, 0.05, 1))[:3], atol=1e-12)


def test_limits_hold_and_joints_begin_within_them(program):
    module = program("robot")
    robot = module.load_urdf(module.Path(module.__file__).with_name("arm.urdf"))
    assert robot.links["left_finger"].transform[1, 3] == 0.01
    robot.move(turn=100.0)
    for wrong in ({"lift": 2.0}, {"reach": -0.01}, {"hold": 0.1}):
        with pytest.raises(ValueError, match="must lie in"):
            robot.move(**wrong)


def test_meshes_colors_and_turned_origins_are_read(program, tmp_path):
    (tmp_path / "one.urdf").write_text(
        """<robot name="one"><link name="a">
        <visual><origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>
        <geometry><mesh filename="models/cube.ply" scale="1 2 3"/></geometry>
        <material name="red"><color rgba="1 0.5 0 1"/></material></visual></link></robot>"""
    )
    (node,) = program("robot").load_urdf(tmp_path / "one.urdf").scene.nodes
    turn = Rotation.from_euler("xyz", [0.1, 0.2, 0.3])  # about fixed axes
    np.testing.assert_allclose(node.world_matrix, step((1, 2, 3), turn), atol=1e-12)
    np.testing.assert_allclose(np.ptp(node.mesh.vertices, axis=0), (2, 4, 6), atol=1e-12)
    assert node.mesh.material.base_color == pytest.approx((1.0, 0.212, 0.0, 1.0), abs=1e-3)


def test_the_loop_is_written(program):
    module = program("robot")
    module.main(["--frames", "8", "--size", "96", "96"])
    with Image.open("robot.gif") as gif, Image.open("robot.png") as strip:
        assert gif.n_frames == 8
        assert strip.size == (4 * 96, 96)
        poses = np.array(strip.convert("L"), float).reshape(96, 4, 96).transpose(1, 0, 2)
    assert all(np.abs(a - b).mean() > 1.0 for a, b in pairwise(poses))
