"""Skins, joints, weights and morph targets: what they hold, and what they refuse."""

import copy
import pickle

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.transforms import rotate_z, translate

POINTS = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
FACES = [(0, 1, 2)]


def mesh(**options):
    given = {"joints": [(0, 1)] * 3, "weights": [(0.5, 0.5)] * 3}
    return rj.Mesh(POINTS, FACES, **{**given, **options})


def targets(**options):
    return rj.MorphTargets([np.ones((3, 3)), np.zeros((3, 3))], **options)


# --- meshes ---------------------------------------------------------------------------------------


def test_a_mesh_keeps_joints_and_weights():
    made = mesh(weights=[(0.25, 0.75), (3.0, 1.0), (0.0, 2.0)], joints=[(0, 1), (2, 1), (99, 1)])
    np.testing.assert_array_equal(made.weights, [(0.25, 0.75), (0.75, 0.25), (0.0, 1.0)])
    # A joint of no weight is none.
    np.testing.assert_array_equal(made.joints, [(0, 1), (2, 1), (0, 1)])
    assert (made.joints.dtype, made.weights.dtype) == (np.int32, np.float64)
    with pytest.raises(ValueError, match="read-only"):
        made.weights[0] = 0
    assert rj.Mesh(POINTS, FACES).joints is None
    assert rj.Mesh(POINTS, FACES).weights is None
    assert rj.Mesh(POINTS, FACES).morph_targets is None
    with pytest.raises(AttributeError, match="make another Mesh"):
        made.joints = None


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"weights": None}, "weights must be given where joints are, got None"),
        ({"joints": None}, "joints must be given where weights are, got None"),
        ({"weights": [(1.0, 0.0)]}, r"weights must have shape \(3, K\), got \(1, 2\)"),
        ({"weights": [1.0, 1.0, 1.0]}, r"weights must have shape \(3, K\), got \(3,\)"),
        ({"joints": [(0, 1, 2)] * 3}, r"joints must have the shape of weights, \(3, 2\)"),
        ({"weights": [(1.0, np.nan)] * 3}, "weights must be finite and at least 0, got nan"),
        ({"weights": [(1.0, np.inf)] * 3}, "weights must be finite and at least 0, got inf"),
        ({"weights": [(1.5, -0.5)] * 3}, "weights must be finite and at least 0, got -0.5"),
        (
            {"weights": [(1, 0), (0, 0), (1, 0)]},
            "weights must not all be 0 for a vertex, got so for vertex 1",
        ),
        ({"joints": [(0, -1)] * 3}, "joints must be whole numbers from 0, got -1.0"),
        ({"joints": [(0, 0.5)] * 3}, "joints must be whole numbers from 0, got 0.5"),
        ({"joints": [(0, np.nan)] * 3}, "joints must be whole numbers from 0, got nan"),
        ({"joints": [(0, 1e12)] * 3}, "joints must be whole numbers from 0"),
        ({"joints": "ab"}, "joints must be an array of numbers"),
        ({"morph_targets": np.ones((1, 3, 3))}, "morph_targets must be a MorphTargets, got"),
        (
            {"morph_targets": rj.MorphTargets(np.ones((1, 4, 3)))},
            "morph_targets must be for 3 vertices, got targets for 4",
        ),
    ],
)
def test_a_mesh_refuses_what_does_not_fit(options, said):
    with pytest.raises(ValueError, match=said):
        mesh(**options)


def test_split_creases_take_joints_and_targets_along():
    box = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
    numbers = np.arange(8)[:, None]
    made = rj.Mesh(
        box, faces, joints=numbers, weights=np.ones((8, 1)),
        morph_targets=rj.MorphTargets(normals=box[None], weights=[1.0]),
    )  # fmt: skip
    split = made.split_creases(30.0)
    assert len(split.vertices) > 8
    np.testing.assert_array_equal(box[split.joints[:, 0]], split.vertices)
    np.testing.assert_array_equal(split.morph_targets.normals[0], split.vertices)
    assert split.morph_targets.weights.tolist() == [1.0]


def test_flat_faces_stay_flat_after_posing():
    box = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
    sheared = rj.MorphTargets((box[:, [1, 2, 0]] * (0.7, 0, 0))[None], weights=[1.0])
    scene = rj.Scene()
    scene.add(rj.Mesh(box, faces, morph_targets=sheared).split_creases(30.0))
    posed = scene.posed().nodes[0].mesh
    a, b, c = posed.vertices[posed.faces].transpose(1, 0, 2)
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1)[:, None]
    for k in range(3):
        np.testing.assert_allclose(posed.vertex_normals()[posed.faces[:, k]], flat, atol=1e-6)


# --- morph targets --------------------------------------------------------------------------------


def test_targets_keep_what_they_are_given():
    made = rj.MorphTargets(
        np.ones((2, 3, 3)), np.zeros((2, 3, 3)), weights=[0.5, 2], names=["one", "two"]
    )
    assert (len(made), made.vertex_count, made.names) == (2, 3, ("one", "two"))
    assert made.positions.dtype == np.float64
    assert made.normals.dtype == np.float32
    assert made.tangents is None
    assert made.weights.tolist() == [0.5, 2.0]
    assert rj.MorphTargets(np.ones((1, 3, 3), np.float32)).positions.dtype == np.float32
    assert repr(made) == "MorphTargets(2 targets, 3 vertices)"
    again = pickle.loads(pickle.dumps(made))
    np.testing.assert_array_equal(again.positions, made.positions)
    with pytest.raises(ValueError, match="read-only"):
        again.positions[0] = 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "positions, normals or tangents must be given, got none of them"),
        ((np.ones((3, 3)),), r"positions must have shape \(n, n, 3\), got \(3, 3\)"),
        ((np.ones((0, 3, 3)),), "positions must have a target and a vertex"),
        ((np.full((1, 3, 3), np.nan),), "positions must be finite"),
        ((np.ones((1, 3, 3)), np.ones((2, 3, 3))), r"normals must have shape \(1, 3, 3\)"),
    ],
)
def test_targets_refuse_what_does_not_fit(arguments, said):
    with pytest.raises(ValueError, match=said):
        rj.MorphTargets(*arguments)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"weights": [1.0]}, r"weights must have shape \(2\), got \(1,\)"),
        ({"weights": [1.0, np.nan]}, "weights must be finite"),
        ({"names": ["one"]}, "names must have one for each of 2 targets"),
        ({"names": "ab"}, "names must be a sequence, got 'ab'"),
    ],
)
def test_targets_refuse_weights_and_names_that_do_not_fit(options, said):
    with pytest.raises(ValueError, match=said):
        targets(**options)


# --- skins ----------------------------------------------------------------------------------------


def test_a_skin_binds_joints_where_they_stand():
    joints = [rj.Node(transform=rotate_z(30)), rj.Node(transform=translate((0, 3, 0)))]
    skin = rj.Skin(joints, name="arm")
    assert (repr(skin), skin.joints) == ("Skin(2 joints, 'arm')", tuple(joints))
    np.testing.assert_allclose(skin.joint_matrices(), [np.eye(4)] * 2, atol=1e-15)
    assert skin.joint_matrices() is skin.joint_matrices()
    joints[0].transform = translate((1, 0, 0))
    np.testing.assert_allclose(
        skin.joint_matrices()[0], translate((1, 0, 0)) @ rotate_z(-30), atol=1e-15
    )
    other = copy.deepcopy(skin)
    assert other.joints[0] is not joints[0]
    np.testing.assert_array_equal(other.joint_matrices(), skin.joint_matrices())
    with pytest.raises(AttributeError, match="make another Skin"):
        skin.joints = ()


@pytest.mark.parametrize(
    ("joints", "binds", "said"),
    [
        ([], None, "joints must have a node, got none"),
        ("ab", None, "joints must be a sequence of nodes, got 'ab'"),
        (None, None, "joints must be a sequence of nodes, got None"),
        ([rj.Node(), np.eye(4)], None, r"joints\[1\] must be a Node, got"),
        ([rj.Node()], np.eye(4), r"inverse_binds must have shape \(1, 4, 4\), got \(4, 4\)"),
        ([rj.Node()], [np.eye(4)] * 2, r"inverse_binds must have shape \(1, 4, 4\)"),
        ([rj.Node()], [np.full((4, 4), np.nan)], "inverse_binds must be finite"),
        ([rj.Node()], [np.ones((4, 4))], r"inverse_binds\[0\] must be affine"),
        ([rj.Node()], [np.diag([1.0, 0.0, 1.0, 1.0])], r"inverse_binds\[0\] must have an inv"),
        ([rj.Node()], [[[1, 1, 0, 0], [1, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]], "an inverse"),
        (
            [rj.Node(transform=np.diag([1.0, 0.0, 1.0, 1.0]))], None,
            r"joints\[0\] must have a world_matrix with an inverse",
        ),
    ],
)  # fmt: skip
def test_a_skin_refuses_what_cannot_be(joints, binds, said):
    with pytest.raises(ValueError, match=said):
        rj.Skin(joints, binds)


def test_a_node_refuses_a_skin_and_weights_that_do_not_fit():
    joints = [rj.Node(), rj.Node()]
    skin = rj.Skin(joints)
    node = rj.Node(mesh(morph_targets=targets()), skin=skin, weights=[1, 0])
    assert node.skin is skin
    assert node.weights.tolist() == [1.0, 0.0]
    for wrong, said in (
        (joints, "skin must be a Skin or None, got"),
        (rj.Skin(joints[:1]), "skin must have a joint 1, which the mesh follows, got 1 joints"),
    ):
        with pytest.raises(ValueError, match=said):
            node.skin = wrong
    for wrong, said in (
        ([1.0], r"weights must have shape \(2\), got \(1,\)"),
        ([1.0, np.inf], "weights must be finite"),
        ("ab", "weights must be an array of numbers"),
    ):
        with pytest.raises(ValueError, match=said):
            node.weights = wrong
    bare = rj.Mesh(POINTS, FACES)
    with pytest.raises(ValueError, match="skin must be None for a mesh without joints"):
        node.mesh = bare
    with pytest.raises(ValueError, match="skin must be None for a mesh without joints"):
        rj.Node(rj.Points(POINTS), skin=skin)
    with pytest.raises(ValueError, match="weights must be None for a mesh without morph targets"):
        rj.Node(bare, weights=[1.0])
    assert node.skin is skin
    node.skin = node.weights = None
    node.mesh = bare
    assert (node.skin, node.weights, node.mesh) == (None, None, bare)


# --- parts of transforms --------------------------------------------------------------------------


def test_a_node_moves_by_parts_of_its_transform():
    node = rj.Node()
    assert node.trs == ((0, 0, 0), (0, 0, 0, 1), (1, 1, 1))
    node.set_trs((1, 2, 3), (0, 0, 0.6, 0.8), (2, 3, 4))
    node.set_trs(scale=(2, 3, -4))
    assert node.trs == ((1, 2, 3), (0, 0, 0.6, 0.8), (2, 3, -4))
    wanted = translate((1, 2, 3)) @ np.diag([1.0, 1, 1, 1])
    turned = np.array([(0.28, -0.96, 0), (0.96, 0.28, 0), (0, 0, 1)])
    wanted[:3, :3] = turned * (2, 3, -4)
    np.testing.assert_allclose(node.transform, wanted, atol=1e-15)
    # A child keeps its own parts where its parent moves; a matrix takes their place.
    child = rj.Node(parent=node)
    child.set_trs(translation=(0, 1, 0))
    node.set_trs(translation=(0, 0, 0))
    assert child.trs.translation == (0, 1, 0)
    np.testing.assert_allclose(child.world_matrix[:3, 3], turned @ (0, 3, 0), atol=1e-15)
    child.transform = np.eye(4)
    assert child.trs.translation == (0, 0, 0)


@pytest.mark.parametrize("seed", range(20))
def test_a_matrix_is_taken_apart_into_what_it_was_made_of(seed):
    random = np.random.default_rng(seed)
    rotation = random.normal(size=4)
    rotation /= np.linalg.norm(rotation)
    sizes = random.random(3) * 3 + 0.1
    sizes[0] *= random.choice([-1, 1])
    node, other = rj.Node(), rj.Node()
    node.set_trs(random.normal(size=3), rotation, sizes)
    other.transform = node.transform
    again = rj.Node()
    again.set_trs(*other.trs)
    np.testing.assert_allclose(again.transform, node.transform, atol=1e-14)
    np.testing.assert_allclose(other.trs.scale, sizes, atol=1e-14)


@pytest.mark.parametrize(
    "axes", [(0, 1, 1), (1, 0, 1), (1, 1, 0), (0, 0, 2), (0, 2, 0), (2, 0, 0), (0, 0, 0)]
)
def test_what_is_flat_is_taken_apart_too(axes):
    node = rj.Node(transform=rotate_z(30) @ np.diag([*axes, 1.0]))
    again = rj.Node()
    again.set_trs(*node.trs)
    np.testing.assert_allclose(again.transform, node.transform, atol=1e-15)


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"translation": (1, 2)}, "translation must have shape"),
        ({"scale": (1, np.nan, 1)}, "scale must be finite"),
        ({"rotation": (0, 0, 1)}, "rotation must have shape"),
        ({"rotation": (0, 0, 0, 0)}, "rotation must be a quaternion of any length but 0"),
    ],
)
def test_parts_that_are_none_are_refused(parts, said):
    node = rj.Node()
    with pytest.raises(ValueError, match=said):
        node.set_trs(**parts)
    assert np.array_equal(node.transform, np.eye(4))


def test_weights_whose_sum_overflows_are_scaled_too():
    mesh = rj.Mesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]],
        joints=[[0, 1]] * 3, weights=[[1e308, 1e308], [3.0, 1.0], [1.0, 0.0]],
    )  # fmt: skip
    assert mesh.weights.tolist() == [[0.5, 0.5], [0.75, 0.25], [1.0, 0.0]]
