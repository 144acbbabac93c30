"""Joints of a program's own: copied, removed, named and moved."""

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
