"""Laws of nodes that hang below others."""

import copy
import gc
import pickle
import weakref

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning
from rasterjit.scene.node import roots_of
from rasterjit.transforms import compose, rotate_x, rotate_z, scale, translate

TRIANGLE = [[0, 0, 0], [2, 0, 0], [0, 2, 0]]
OUTPUTS = ("color", "depth", "object_id", "instance_id", "position", "normal")


def triangle():
    return rj.Mesh(TRIANGLE, [[0, 1, 2]])


def arm():
    """Return a scene with base, upper, elbow (a group) and hand, each below the one before."""
    scene, mesh = rj.Scene(), triangle()
    base = scene.add(mesh, translate((0, 0, -1)), "base")
    upper = scene.add(mesh, compose(translate((2, 0, 0)), rotate_z(30)), "upper", parent=base)
    elbow = rj.Node(name="elbow", transform=rotate_x(20), parent=upper)
    hand = scene.add(mesh, translate((0, 2, 0)), "hand", parent=elbow)
    return scene, base, upper, elbow, hand


def names(scene):
    return [node.name for node in scene.nodes]


def test_a_node_moves_with_all_above_it():
    _, base, upper, elbow, hand = arm()
    assert (hand.parent, elbow.children, base.parent) == (elbow, (hand,), None)
    for turn in (40.0, -110.0):
        upper.transform = compose(translate((2, 0, 0)), rotate_z(turn))
        base.transform = scale((1, 2, -1))
        chain = [node.transform for node in (base, upper, elbow, hand)]
        for k, node in enumerate((base, upper, elbow, hand), 1):
            np.testing.assert_array_equal(node.world_matrix, compose(*chain[:k]))
            assert node.world_from_model is node.world_matrix


def test_a_tree_is_drawn_with_the_bits_of_as_many_nodes_without_one():
    scene, _, upper, _, _ = arm()
    camera = rj.fit_camera(scene)
    with rj.Renderer((48, 32)) as renderer:
        for turn in (0.0, 25.0, 50.0):
            upper.transform = compose(translate((2, 0, 0)), rotate_z(turn))
            flat = rj.Scene()
            for node in scene.nodes:
                flat.add(node.mesh, node.world_matrix)
            found = renderer.render(scene, camera, outputs=OUTPUTS)
            wanted = rj.render(flat, camera, size=(48, 32), outputs=OUTPUTS)
            for name in OUTPUTS:
                np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), name)


def test_numbers_stay_when_nodes_move_and_close_up_when_one_is_removed():
    scene, base, upper, elbow, hand = arm()
    lid = scene.add(triangle(), name="lid")
    assert scene.nodes == [base, upper, hand, lid]
    upper.transform, elbow.transform = rotate_z(3), rotate_z(4)
    assert scene.nodes == [base, upper, hand, lid]
    hand.parent = lid
    assert scene.nodes == [base, upper, hand, lid]
    scene.remove(upper)
    assert (scene.nodes, upper.parent, upper.children) == ([base, hand, lid], None, (elbow,))
    assert scene.add(triangle()).name == "object 4"
    scene.remove(lid)
    assert (names(scene), hand.parent) == (["base", "object 4"], lid)
    with pytest.raises(ValueError, match=r"node must be in the scene, got Node\('lid'"):
        scene.remove(lid)
    scene.add(lid, name="cover")
    assert names(scene) == ["base", "object 4", "cover", "hand"]


def test_a_world_matrix_may_be_asked_for():
    _, base, upper, _, hand = arm()
    wanted = compose(translate((1, 2, 3)), rotate_x(70))
    hand.world_from_model = wanted
    np.testing.assert_allclose(hand.world_matrix, wanted, rtol=0, atol=1e-14)
    placed = rj.Node(triangle(), name="tool", parent=upper, world_from_model=wanted)
    np.testing.assert_allclose(placed.world_matrix, wanted, rtol=0, atol=1e-14)
    base.transform = np.diag([1.0, 0.0, 1.0, 1.0])
    with pytest.raises(ValueError, match="world_from_model of 'hand' must be within reach"):
        hand.world_from_model = wanted


def test_what_hangs_in_a_scene_is_in_it():
    scene, base, _, elbow, _ = arm()
    tool = rj.Node(triangle(), name="tool")
    tip = rj.Node(triangle(), name="tip", parent=tool)
    assert (tool.parent, tip.parent) == (None, tool)
    tool.parent = elbow
    assert names(scene) == ["base", "upper", "hand", "tool", "tip"]
    elbow.mesh = triangle()
    assert names(scene)[-1] == "elbow"
    elbow.mesh = None
    rig = rj.Node(triangle(), name="rig")
    base.parent = rig
    assert names(scene) == ["base", "upper", "hand", "tool", "tip", "rig"]
    tool.parent = None
    assert names(scene) == ["base", "upper", "hand", "tool", "tip", "rig"]
    scene.remove(rig)
    assert names(scene) == ["tool", "tip"]


def test_nodes_are_found_by_name():
    scene, _, _, elbow, hand = arm()
    assert (scene.find("elbow"), scene.find("hand")) == (elbow, hand)
    empty = scene.add(rj.Node(name="rack"))
    assert scene.find("rack") is empty
    with pytest.raises(ValueError, match="of the scene, got 'elbwo'; near it are 'elbow'"):
        scene.find("elbwo")
    scene.add(triangle(), name="hand", parent=empty)
    with pytest.raises(ValueError, match="name must be that of one node, got 'hand' of 2"):
        scene.find("hand")
    inner = scene.add(rj.Node(name="drawer"))
    inner.parent = empty
    assert scene.find("drawer") is inner
    scene.remove(empty)
    assert scene.find("hand") is hand
    with pytest.raises(ValueError, match="got 'drawer'"):
        scene.find("drawer")
    with pytest.raises(ValueError, match="got 'rack'"):
        scene.find("rack")


@pytest.mark.parametrize("depth", [0, 1, 2])
def test_a_node_hangs_below_no_node_that_hangs_below_it(depth):
    scene, base, *below = arm()
    before = [node.world_matrix for node in scene.nodes]
    with pytest.raises(ValueError, match="parent must not lie below the node"):
        base.parent = (base, *below)[depth]
    assert base.parent is None
    assert all(node.world_matrix is place for node, place in zip(scene.nodes, before, strict=True))


def test_a_node_is_in_one_scene_and_below_one_node():
    scene, base, _, _, hand = arm()
    other = rj.Scene()
    with pytest.raises(ValueError, match=r"in no scene, got Node\('base'.* of another scene"):
        other.add(base)
    with pytest.raises(ValueError, match=r"in no scene, got Node\('base'.* of this scene"):
        scene.add(base)
    with pytest.raises(ValueError, match=r"below no other, got Node\('hand'"):
        other.add(hand)
    lid = other.add(triangle(), name="lid")
    with pytest.raises(ValueError, match=r"'lid' is in one and .*hand.* in another"):
        lid.parent = hand
    with pytest.raises(ValueError, match=r"parent must be a node of the scene, got Node\('lid'"):
        scene.add(triangle(), parent=lid)
    with pytest.raises(ValueError, match="parent must be a Node or None, got 'base'"):
        scene.add(triangle(), parent="base")
    with pytest.raises(ValueError, match="parent must be a Node or None, got Mesh"):
        lid.parent = triangle()
    assert (names(scene), names(other)) == (["base", "upper", "hand"], ["lid"])
    hand.parent = None
    scene.remove(hand)
    other.add(hand, translate((1, 0, 0)), parent=lid)
    assert (names(other), hand.transform[0, 3]) == (["lid", "hand"], 1.0)


def test_a_product_that_overflows_moves_nothing():
    scene, base, upper, _, hand = arm()
    upper.transform = scale(1e200)
    before = [node.world_matrix for node in scene.nodes]
    for wrong in (scale(1e200), np.full((4, 4), np.nan), np.eye(3)):
        with pytest.raises(ValueError, match=r"transform (of 'upper' )?must"):
            base.transform = wrong
        assert all(a.world_matrix is b for a, b in zip(scene.nodes, before, strict=True))
    far = rj.Node(triangle(), scale(1e200))
    with pytest.raises(ValueError, match="must have a finite product"):
        far.parent = hand
    with pytest.raises(ValueError, match="must have a finite product"):
        scene.add(triangle(), scale(1e200), parent=hand)
    with pytest.raises(ValueError, match="must have a finite product"):
        scene.add(far, parent=hand)
    assert (far.parent, hand.children, len(scene.nodes)) == (None, (), 3)


@pytest.mark.parametrize("make", [copy.deepcopy, lambda scene: pickle.loads(pickle.dumps(scene))])
def test_a_copy_of_a_scene_has_a_tree_of_its_own(make):
    scene, _, _, _, hand = arm()
    scene.add(rj.Node(name="rack"))
    twin = make(scene)
    assert [node.world_matrix.tolist() for node in twin.nodes] == [
        node.world_matrix.tolist() for node in scene.nodes
    ]
    place = hand.world_matrix
    twin.find("elbow").transform = rotate_z(90)
    assert hand.world_matrix is place
    assert twin.find("hand").world_matrix.tolist() != place.tolist()
    twin.add(triangle(), name="tool", parent=twin.find("elbow"))
    twin.add(triangle(), name="book", parent=twin.find("rack"))
    assert (names(scene), names(twin)[3:]) == (["base", "upper", "hand"], ["tool", "book"])
    first, second = copy.deepcopy((scene, copy.copy(scene)))
    assert first.nodes[2] is second.nodes[2]
    assert [len(node.children) for node in first.every_node()] == [1, 1, 1, 0, 0]
    with pytest.raises(ValueError, match="read-only"):
        twin.find("elbow").transform[0, 0] = 2.0


@pytest.mark.parametrize(
    "make", [copy.copy, copy.deepcopy, lambda node: pickle.loads(pickle.dumps(node))]
)
def test_a_copy_of_a_node_stands_alone_where_it_stood(make):
    scene, _, upper, elbow, hand = arm()
    twin, joint = make(hand), make(elbow)
    assert (twin.parent, joint.children, elbow.children) == (None, (), (hand,))
    assert twin.world_matrix.tolist() == hand.world_matrix.tolist()
    twin.transform = translate((1, 0, 0))
    assert twin.world_matrix.tolist() == translate((1, 0, 0)).tolist()
    scene.add(twin)
    twin.parent = upper
    assert (len(scene.nodes), elbow.children) == (4, (hand,))


class Labelled(rj.Node):
    """A node with something of its own."""

    _facts = None


@pytest.mark.parametrize(
    "make", [copy.copy, copy.deepcopy, lambda node: pickle.loads(pickle.dumps(node))]
)
def test_copies_keep_arrays_read_only_and_what_else_is_theirs(make):
    mesh = rj.Mesh(np.eye(3), [(0, 1, 2)], attributes={"heat": np.eye(3)})
    node = Labelled(mesh)
    node._facts = {"age": 1}
    other = make(node)
    assert other._facts == {"age": 1}
    twin = make(mesh)
    for array in (other.world_from_model, twin.vertices, twin.vertex_attributes["heat"]):
        assert not array.flags.writeable


def test_a_shallow_copy_of_a_scene_shares_its_nodes_and_leaves_them_as_they_are():
    scene, base, upper, elbow, hand = arm()
    twin = copy.copy(scene)
    assert twin.nodes is scene.nodes
    assert [node.children for node in (base, upper, elbow)] == [(upper,), (elbow,), (hand,)]
    twin.fog = rj.Fog("white", density=0.1)
    assert scene.fog is None


def test_trees_of_a_thousand_nodes_in_a_row_are_copied():
    scene = rj.Scene()
    node = None
    for _ in range(1000):
        node = scene.add(triangle(), translate((1, 0, 0)), parent=node)
    for twin in (copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        assert twin.nodes[-1].world_matrix[0, 3] == 1000.0


def test_the_topmost_of_nodes_are_in_the_order_in_which_they_are_met():
    tops = [rj.Node(name=name) for name in "ab"]
    first, other = ([top, rj.Node(parent=top)] for top in tops)
    for chain in (first, other):
        chain.append(rj.Node(parent=chain[-1]))
    assert roots_of([other[2], first[1], other[0], first[2], first[0]]) == tops[::-1]
    assert roots_of([first[0], first[2], other[1]]) == tops
    assert roots_of([]) == []


def test_all_below_a_node_are_in_its_scene_until_it_is_removed():
    scene, base, upper, *_ = arm()
    loose = rj.Node(name="loose")
    tip = rj.Node(triangle(), name="tip", parent=loose)
    loose.parent = upper
    assert tip in scene.nodes
    scene.remove(upper)
    assert tip not in scene.nodes
    with pytest.raises(ValueError, match="must be in the scene"):
        scene.remove(tip)
    other = rj.Scene()
    other.add(upper)
    assert tip in other.nodes
    with pytest.raises(ValueError, match="must be in the node's scene"):
        tip.parent = base


def test_a_scene_without_a_tree_goes_when_nobody_holds_it():
    scene = rj.Scene()
    node = scene.add(triangle())
    gone = weakref.ref(scene)
    gc.disable()
    try:
        del scene
        assert gone() is None
    finally:
        gc.enable()
    rj.Scene().add(node)


def test_a_group_in_the_list_of_objects_is_refused_by_name():
    scene = rj.Scene()
    scene.add(triangle())
    scene.nodes.append(rj.Node(name="joint"))
    for draw in (rj.render, rj.explain):
        with pytest.raises(ValueError, match=r"nodes\[1\] must have a mesh, got Node\('joint', 0"):
            draw(scene, size=(8, 8))
    assert repr(scene) == "Scene(2 objects, 1 faces, 0 lights)"


def test_nodes_of_a_list_made_by_hand_can_be_hung_from_and_removed():
    scene, node = rj.Scene(), rj.Node(triangle(), np.eye(4), "by hand")
    scene.nodes.append(node)
    hand = scene.add(triangle(), parent=node)
    assert scene.nodes == [node, hand]
    twin = copy.copy(scene)
    twin.nodes = [node]
    with pytest.raises(ValueError, match="which is another's as well"):
        twin.add(triangle(), parent=node)
    with pytest.raises(ValueError, match="node must be the scene's own"):
        twin.remove(node)
    scene.remove(node)
    assert scene.nodes == []


def test_trimesh_objects_are_added_as_their_files_are_read():
    box = trimesh.creation.box()
    box.visual.face_colors = np.random.default_rng(3).integers(0, 255, (12, 4), np.uint8)
    scene = rj.Scene()
    node = scene.add(box, translate((1, 0, 0)), "box")
    (wanted,) = rj.load(box).nodes
    np.testing.assert_array_equal(node.mesh.face_colors, wanted.mesh.face_colors)
    assert (scene.nodes, node.name, node.world_matrix[0, 3]) == ([node], "box", 1.0)
    assert scene.add(box).name == "object 1"
    many = trimesh.Scene()
    many.add_geometry(box, "a", transform=translate((0, 1, 0)))
    many.add_geometry(trimesh.creation.icosphere(1), "b", transform=translate((0, 2, 0)))
    group = scene.add(many, rotate_z(90), "pair", parent=node)
    assert (group.mesh, len(group.children), len(scene.nodes)) == (None, 2, 4)
    for child, one in zip(group.children, rj.load(many).nodes, strict=True):
        place = compose(node.transform, rotate_z(90), one.transform)
        np.testing.assert_array_equal(child.world_matrix, place)
        np.testing.assert_array_equal(child.mesh.vertices, one.mesh.vertices)


def test_a_scene_is_added_as_a_group_of_copies_and_says_what_stays_behind():
    scene, *_ = arm()
    room = rj.Scene()
    first = room.add(scene, translate((5, 0, 0)))
    second = room.add(scene)
    assert names(room) == names(scene) * 2
    assert room.nodes[5].mesh is scene.nodes[2].mesh
    np.testing.assert_array_equal(room.nodes[4].world_matrix, scene.nodes[1].world_matrix)
    assert [child.name for child in first.children] == ["base"]
    room.remove(second)
    assert len(room.nodes) == 3
    scene.lights.append(rj.PointLight((0, 0, 1)))
    scene.fog = rj.Fog(color="white", density=0.1)
    with pytest.warns(LoadWarning, match=r"left out PointLight \(1\), fog \(1\); the rest") as said:
        room.add(scene)
    assert (len(said), said[0].filename) == (1, __file__)
    with pytest.raises(ValueError, match="with at least one mesh, got an empty one"):
        room.add(rj.Scene())


def test_load_takes_trimesh_objects_and_refuses_what_they_have_no_use_for():
    box = trimesh.creation.box()
    smooth = rj.load(box, crease_angle=180.0).nodes[0].mesh
    assert len(smooth.vertices) == 8
    assert len(rj.load(box).nodes[0].mesh.vertices) == 24
    for options in ({"max_bytes": 5}, {"on_damage": "warn"}, {"resource_root": "."}):
        with pytest.raises(
            ValueError, match=f"{next(iter(options))} must not be given for an object of tri"
        ):
            rj.load(box, **options)
