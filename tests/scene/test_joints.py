"""Joints of a program's own: copied, removed, named and moved."""

import copy
import pickle

import numpy as np
import pytest

import rasterjit as rj

TRIANGLE = rj.Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2]])


def row(count):
    """Return a scene with nodes side by side, and joints of which each follows the one before."""
    scene, nodes, leader = rj.Scene(), [], None
    for number in range(count):
        nodes.append(scene.add(rj.Node(TRIANGLE, name=f"n{number}")))
        follows = None if leader is None else (leader, 1.0, 1.0)
        leader = rj.Joint(nodes[-1], "continuous", (0, 0, 1), follows=follows)
        scene.joints.add(f"j{number}", leader)
    return scene, nodes


@pytest.mark.parametrize("removed", [[], [0], [1], [0, 1]])
@pytest.mark.parametrize("count", [1, 3])
def test_copies_have_all_joints_that_move_them_and_none_of_the_first(count, removed):
    scene, nodes = row(count)
    for number in removed[: count - 1]:
        scene.remove(nodes[number])
    stage = rj.Scene()
    stage.add(scene, name="r")
    assert stage.joints.free == ("r/j0",)
    stage.joints["r/j0"].angle = 30
    last = stage.joints[f"r/j{count - 1}"]
    assert (last.angle, stage.nodes[-1].transform[0, 1]) == (29 + count, last.node.transform[0, 1])
    assert all(abs(one.transform[0, 1]) < 0.1 for one in nodes)


def test_joints_go_with_their_nodes_unless_others_follow_them():
    scene, nodes = row(3)
    scene.remove(nodes[1])
    assert list(scene.joints) == ["j0", "j1", "j2"]
    scene.remove(nodes[2])
    assert list(scene.joints) == ["j0"]


def test_a_joint_has_one_name_and_names_are_texts():
    scene, nodes = row(1)
    other = rj.Scene()
    other.nodes.append(nodes[0])
    for stage in (scene, other):
        with pytest.raises(ValueError, match=r"joint must have no name in a scene yet, got .*'j0'"):
            stage.joints.add("again", scene.joints["j0"])
    assert (list(scene.joints), scene.joints["j0"].name) == (["j0"], "j0")
    for name in (0, ["j0"]):
        with pytest.raises(ValueError, match="joint must be one of 'j0', got"):
            scene.joints[name]
        assert name not in scene.joints
        with pytest.raises(ValueError, match="name must be a string"):
            scene.joints.add(name, rj.Joint(nodes[0], "revolute", (0, 0, 1)))


@pytest.mark.parametrize("limits", [(1, 2), (-2, -1), (-1, 2), None])
def test_a_joint_stands_at_the_limit_nearest_to_0_and_what_follows_it_there(limits):
    arm, hand = rj.Node(name="arm"), rj.Node(name="hand")
    first = rj.Joint(arm, "prismatic", (1, 0, 0), limits=limits)
    other = rj.Joint(hand, "prismatic", (0, 1, 0), follows=(first, 10.0, 5.0))
    expected = {1: 1.0, -2: -1.0}.get(limits[0], 0.0) if limits else 0.0
    places = [first.position, arm.transform[0, 3], other.position, hand.transform[1, 3]]
    assert places == [expected, expected, 10 * expected + 5, 10 * expected + 5]
    for wrong in ((np.inf, np.inf), (-np.inf, -np.inf), (2, 1)):
        with pytest.raises(ValueError, match="limits must be the least and the greatest value"):
            rj.Joint(arm, "prismatic", (1, 0, 0), limits=wrong)


def test_joints_that_follow_one_another_in_a_long_row_move_and_are_copied():
    scene, _ = row(1500)
    scene.joints["j0"].angle = 30
    world = [node.world_matrix for node in scene.nodes]
    np.testing.assert_array_equal(scene.joints.transforms([[30]])[0], world)
    assert scene.joints["j1499"].angle == 30 + 1499
    for other in (copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        other.joints["j0"].angle = 60
        assert other.joints["j1499"].node.transform[0, 1] == other.nodes[-1].transform[0, 1]
        assert (other.joints["j1499"].angle, scene.joints["j1499"].angle) == (60 + 1499, 30 + 1499)


def test_nothing_moves_where_a_joint_that_follows_overflows():
    scene, nodes = row(2)
    last = rj.Joint(nodes[1], "prismatic", (1, 0, 0), follows=(scene.joints["j1"], 1e308, 0.0))
    before = [node.transform for node in nodes]
    with pytest.raises(ValueError, match="finite"):
        scene.joints.move([20])
    assert [scene.joints["j0"].angle, last.position] == [0.0, 1e308]
    np.testing.assert_array_equal([node.transform for node in nodes], before)
