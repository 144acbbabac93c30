"""Labels stand at nodes, and move, are copied and go with them."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle

import pytest

import rasterjit as rj

MESH = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
LABEL = rj.Label((1, 2, 3), "text")


def texts_of(scene):
    return [node.label.text for node in scene.labelled]


def test_a_label_is_carried_by_a_node_without_mesh():
    scene = rj.Scene()
    scene.add(MESH)
    node = scene.add(LABEL, rj.transforms.translate((1, 0, 0)), "sign")
    assert node.label is LABEL
    assert node.mesh is None
    assert scene.find("sign") is node
    assert len(scene.nodes) == 1
    assert scene.every_node() == [scene.nodes[0], node]
    assert scene.labelled == [node]
    assert repr(node) == "Node('sign', 0 children, label 'text')"
    assert scene.add(LABEL).name == ""


def test_a_label_hangs_below_its_parent():
    scene = rj.Scene()
    arm = scene.add(MESH, rj.transforms.translate((0, 0, 5)), "arm")
    node = scene.add(LABEL, rj.transforms.translate((1, 0, 0)), "hand", parent=arm)
    assert node.parent is arm
    assert node.world_matrix[:3, 3].tolist() == [1.0, 0.0, 5.0]
    arm.transform = rj.transforms.translate((0, 7, 0))
    assert node.world_matrix[:3, 3].tolist() == [1.0, 7.0, 0.0]


def test_removing_takes_labels_below_too_and_they_may_come_again():
    scene = rj.Scene()
    arm = scene.add(MESH, name="arm")
    scene.add(rj.Label((0, 0, 0), "below"), parent=arm)
    alone = scene.add(rj.Label((0, 0, 0), "alone"))
    scene.remove(arm)
    assert texts_of(scene) == ["alone"]
    scene.add(arm)
    assert texts_of(scene) == ["alone", "below"]
    scene.remove(alone)
    assert texts_of(scene) == ["below"]


def test_meshes_may_carry_a_label_and_lose_it():
    scene = rj.Scene()
    node = scene.add(MESH)
    node.label = LABEL
    assert texts_of(scene) == ["text"]
    node.label = rj.Label((0, 0, 0), "other")
    assert texts_of(scene) == ["other"]
    node.label = None
    assert texts_of(scene) == []
    lone = rj.Node(MESH, label=LABEL)
    scene.add(lone)
    assert texts_of(scene) == ["text"]
    assert repr(lone).endswith("label 'text')")


def test_trees_of_nodes_bring_their_labels():
    group = rj.Node(name="group")
    rj.Node(parent=group, label=LABEL)
    rj.Node(MESH, parent=group)
    scene = rj.Scene()
    scene.add(group)
    assert texts_of(scene) == ["text"]
    rj.Node(parent=group, label=rj.Label((0, 0, 0), "later"))
    assert texts_of(scene) == ["text", "later"]


def test_scenes_in_scenes_bring_their_labels():
    inner = rj.Scene()
    inner.add(MESH)
    assert len(rj.Scene().add(inner).children) == 0
    inner.add(LABEL, rj.transforms.translate((0, 0, 1)))
    outer = rj.Scene()
    outer.add(inner, rj.transforms.translate((5, 0, 0)))
    (node,) = outer.labelled
    assert node is not inner.labelled[0]
    assert node.world_matrix[:3, 3].tolist() == [5.0, 0.0, 1.0]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda scene: pickle.loads(pickle.dumps(scene))])
def test_copies_have_labels_of_their_own(copied):
    scene = rj.Scene()
    arm = scene.add(MESH, rj.transforms.translate((0, 0, 5)))
    scene.add(LABEL, rj.transforms.translate((1, 0, 0)), "sign", parent=arm)
    other = copied(scene)
    (node,) = other.labelled
    assert node.label == LABEL
    assert node.parent is other.nodes[0]
    scene.labelled[0].label = None
    assert texts_of(other) == ["text"]
    node.label = None
    assert texts_of(other) == []


def test_labels_are_values():
    assert rj.Label([1, 2, 3], "text") == LABEL
    assert dataclasses.replace(LABEL, text="a\nb").text == "a\nb"
    assert rj.Label((0, 0, 0), "x", color="red").color == (1.0, 0.0, 0.0, 1.0)
    with pytest.raises(AttributeError, match=r"dataclasses\.replace\(old, text=\.\.\.\)"):
        LABEL.text = "other"


def test_files_have_no_place_for_labels(tmp_path):
    scene = rj.Scene()
    scene.add(MESH, name="mesh")
    scene.add(LABEL, name="sign")
    with pytest.warns(rj.SaveWarning, match="labels"):
        scene.save(tmp_path / "scene.glb")
    assert rj.load(tmp_path / "scene.glb").labelled == []
    with pytest.warns(rj.SaveWarning, match="labels"):
        scene.to_trimesh()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": (0, 1)}, r"position must have shape \(3\), got \(2,\)"),
        ({"position": (0, 1, math.nan)}, "position must be finite"),
        ({"text": ""}, "text must have a character that is seen, got ''"),
        ({"text": " \n"}, "text must have a character that is seen"),
        ({"text": 7}, "text must be a string, got 7"),
        ({"text": "x" * 1001}, "text must have at most 1000 characters, got 1001"),
        ({"text": "a\0"}, r"text must have no control characters .*, got '\\x00'"),
        ({"text": "\x1bx"}, r"text must have no control characters .*, got '\\x1b'"),
        ({"text": "x\ud800"}, r"no surrogates, got '\\ud800'"),
        ({"text": "x\uffff"}, r"no surrogates, got '\\uffff'"),
        ({"size": 0}, "size must be above 0, got 0"),
        ({"size": -3.5}, r"size must be above 0, got -3\.5"),
        ({"size": 513}, "size must be at most 512 pixels, got 513"),
        ({"size": math.inf}, "size must be finite"),
        ({"anchor": "middle"}, "anchor must be one of 'center', 'left'"),
        ({"anchor": "centre"}, "did you mean 'center'"),
        ({"color": "reddish"}, "color must be"),
        ({"background": (2, 0, 0)}, "background must lie in"),
        ({"hidden": 1}, "hidden must be True or False, got 1"),
        ({"offset": (1, 2, 3)}, r"offset must have shape \(2\), got \(3,\)"),
        ({"offset": (1e6, 0)}, "offset must be at most 65536 pixels each way"),
    ],
)
def test_what_is_wrong_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        rj.Label(**{"position": (0, 0, 0), "text": "x", **change})


def test_nodes_carry_labels_alone():
    with pytest.raises(ValueError, match="label must be a Label or None, got 'text'"):
        rj.Node(label="text")
    node = rj.Node()
    with pytest.raises(ValueError, match="label must be a Label or None"):
        node.label = MESH
    with pytest.raises(ValueError, match="parent must be a node of the scene"):
        rj.Scene().add(LABEL, parent=node)


def test_a_scene_of_labels_alone_is_empty():
    scene = rj.Scene()
    scene.add(LABEL)
    with pytest.raises(ValueError, match="scene must hold at least one mesh, got labels alone"):
        rj.render(scene)
