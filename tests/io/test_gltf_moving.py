"""Skins, morph targets and animations of glTF files are those of the specification's equations."""

import pickle
import warnings

import naive_posing as naive
import numpy as np
import pytest
from moving_models import JOINTS, STRIP, STRIP_FACES, WEIGHTS, Gltf, animate, arm

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning, SaveWarning
from rasterjit.scene.node import root_of

TOLERANCE = 1e-12


@pytest.fixture(autouse=True)
def no_warnings():
    """Let every warning that is not expected fail."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def load(model, tmp_path):
    return rj.load(model.save(tmp_path / "a.gltf"))


def load_with(model, tmp_path, *said):
    """Load a file that warns once, with all of these."""
    with pytest.warns(LoadWarning) as warned:
        scene = load(model, tmp_path)
    assert len(warned) == 1
    for part in said:
        assert part in str(warned[0].message)
    return scene


def drawn(scene, number=0):
    """Return the vertices of an object as they are drawn, world space."""
    node = scene.posed().nodes[number]
    return rj.transforms.apply(node.world_matrix, node.mesh.vertices)


def worlds(values=None):
    """Return where the arm's joints stand, with parts of nodes 1 to 3 replaced."""
    rest = {
        1: {"translation": (0.25, 0, 0)},
        2: {"translation": (0, 2, 0), "rotation": (0, 0, 0.6, 0.8)},
        3: {"translation": (0, 2, 0), "scale": (1, 1.5, 2)},
    }
    above, found = np.eye(4).tolist(), []
    for number, said in rest.items():
        plain = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}
        trs = {**plain, **said, **(values or {}).get(number, {})}
        above = naive.product(above, naive.trs_matrix(**trs))
        found.append(above)
    return found


def binds():
    """Return the arm's inverse bind matrices."""
    return [[[1, 0, 0, 0], [0, 1, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]] for y in (0.0, -2.0, -4.0)]


def expected(values=None, weights=WEIGHTS, points=STRIP, joints=JOINTS):
    """Return where the arm's vertices are by the specification."""
    placed = worlds(values)
    return np.array(
        [
            naive.moved(naive.blended(j, w, placed, binds()), point)
            for j, w, point in zip(joints, weights, points, strict=True)
        ]
    )


# --- skins ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", [("u1", "f4"), ("u2", "f4"), ("u1", "u1"), ("u2", "u2")])
def test_a_loaded_skin_is_posed_by_its_joints_and_not_by_its_node(tmp_path, kinds):
    scene = load(arm(kinds), tmp_path)
    assert (scene.nodes[0].name, scene.nodes[0].skin.joints[2].name) == ("0", "hand")
    weights = WEIGHTS
    if kinds[1] != "f4":
        most = np.iinfo(kinds[1]).max
        weights = np.round(WEIGHTS * most) / most
        weights /= weights.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(drawn(scene), expected(weights=weights), atol=TOLERANCE)
    # The picture is that of the posed mesh.
    plain = rj.Mesh(drawn(scene), STRIP_FACES, normals=scene.posed().nodes[0].mesh.normals)
    plain.material = scene.nodes[0].mesh.material
    frame, other = (rj.render(one, size=(40, 30)) for one in (scene, plain))
    np.testing.assert_array_equal(frame.color, other.color)


def test_normals_are_moved_by_the_inverse_transpose(tmp_path):
    scene = load(arm(), tmp_path)
    posed, rest = scene.posed().nodes[0].mesh, scene.nodes[0].mesh
    for row in range(10):
        matrix = naive.blended(JOINTS[row], WEIGHTS[row], worlds(), binds())
        wanted = naive.moved_normal(matrix, rest.normals[row])
        np.testing.assert_allclose(posed.normals[row], wanted, atol=2e-7)


def test_normals_that_follow_from_faces_do_so_after_posing(tmp_path):
    scene = load(arm(normals=False), tmp_path)
    posed = scene.posed().nodes[0].mesh
    a, b, c = posed.vertices[posed.faces].transpose(1, 0, 2)
    flat = np.cross(b - a, c - a)
    sums = np.zeros((len(posed.vertices), 3))
    for face, normal in zip(posed.faces, flat, strict=True):
        sums[face] += normal
    wanted = sums / np.linalg.norm(sums, axis=1)[:, None]
    # The strip has no crease: its vertices are still ten, with the mean of all faces around them.
    assert len(posed.vertices) == 10
    np.testing.assert_allclose(posed.vertex_normals(), wanted, atol=2e-7)


def test_more_than_four_joints_take_a_second_set(tmp_path):
    model = arm()
    attributes = model.document["meshes"][0]["primitives"][0]["attributes"]
    attributes["WEIGHTS_0"] = model.array(WEIGHTS * 0.5)
    attributes["JOINTS_1"] = model.array(JOINTS[:, ::-1], "u2")
    attributes["WEIGHTS_1"] = model.array(WEIGHTS[:, ::-1] * 0.5)
    scene = load(model, tmp_path)
    assert scene.nodes[0].mesh.joints.shape == (10, 8)
    np.testing.assert_allclose(drawn(scene), expected(), atol=TOLERANCE)


def test_without_inverse_bind_matrices_they_are_the_identity(tmp_path):
    model = arm()
    del model.document["skins"][0]["inverseBindMatrices"]
    placed = worlds()
    wanted = [
        naive.moved(naive.blended(j, w, placed, [np.eye(4).tolist()] * 3), point)
        for j, w, point in zip(JOINTS, WEIGHTS, STRIP, strict=True)
    ]
    np.testing.assert_allclose(drawn(load(model, tmp_path)), wanted, atol=TOLERANCE)


def test_joints_that_no_scene_has_are_there_all_the_same(tmp_path):
    model = arm()
    model.document["scenes"] = [{"nodes": [0]}]
    scene = load(model, tmp_path)
    assert [node.name for node in scene.every_node()] == ["0"]
    np.testing.assert_allclose(drawn(scene), expected(), atol=TOLERANCE)
    # Copies have joints of their own, which hang together.
    copied = pickle.loads(pickle.dumps(scene))
    joints = copied.nodes[0].skin.joints
    assert joints[1].parent is joints[0]
    joints[0].transform = rj.transforms.translate((3, 0, 0))
    shifted = expected({1: {"translation": (3, 0, 0)}})
    np.testing.assert_allclose(drawn(copied), shifted, atol=TOLERANCE)
    np.testing.assert_allclose(drawn(scene), expected(), atol=TOLERANCE)


def test_joints_may_carry_meshes_and_hang_below_the_mesh_that_they_move(tmp_path):
    model = arm()
    nodes = model.document["nodes"]
    # The hand is drawn as well; the root hangs below the node of the mesh itself.
    model.append("meshes", {"primitives": model.document["meshes"][0]["primitives"]})
    nodes[3]["mesh"] = 1
    nodes[0]["children"] = [1]
    nodes[0]["translation"], nodes[0]["rotation"] = [0, 0, 5], [0, 0, 0, 1]
    model.document["scenes"] = [{"nodes": [0]}]
    scene = load(model, tmp_path)
    assert [node.name for node in scene.nodes] == ["0", "hand"]
    np.testing.assert_allclose(drawn(scene), expected() + (0, 0, 5), atol=TOLERANCE)
    hand = np.array(worlds()[2])
    wanted = STRIP @ hand[:3, :3].T + hand[:3, 3] + (0, 0, 5)
    np.testing.assert_allclose(drawn(scene, 1), wanted, atol=TOLERANCE)


def test_two_nodes_share_a_mesh_with_a_skin_each(tmp_path):
    model = arm()
    nodes, skins = model.document["nodes"], model.document["skins"]
    nodes += [{"mesh": 0, "skin": 1}, {"name": "other", "translation": [-3, 1, 0]}]
    skins.append({**skins[0], "joints": [5, 5, 5]})
    model.document["scenes"] = [{"nodes": [0, 1, 4, 5]}]
    scene = load(model, tmp_path)
    first, second = scene.nodes
    assert first.mesh is second.mesh
    np.testing.assert_allclose(drawn(scene), expected(), atol=TOLERANCE)
    rows = np.repeat(np.eye(4)[None], 3, 0)
    rows[:, :3, 3] = -3, 1, 0
    wanted = [
        naive.moved(naive.blended(j, w, rows.tolist(), binds()), point)
        for j, w, point in zip(JOINTS, WEIGHTS, STRIP, strict=True)
    ]
    np.testing.assert_allclose(drawn(scene, 1), wanted, atol=TOLERANCE)
    frame = rj.render(scene, size=(80, 60), outputs=("instance_id", "object_id"))
    assert set(np.unique(frame.instance_id)) == {-1, 0, 1}


# --- morph targets --------------------------------------------------------------------------------

MOVES = np.float32([[(0.1 * n, 0.3, -0.2) for n in range(10)], [(0, 0, n) for n in range(10)]])


def morphing(**said):
    """Return the strip with two targets, at a node that is moved."""
    model = arm()
    model.document["skins"] = []
    primitive = model.document["meshes"][0]["primitives"][0]
    for name in ("JOINTS_0", "WEIGHTS_0"):
        del primitive["attributes"][name]
    turned = np.float32([[(0.2, 0, -0.1)] * 10, [(0, 0.5, 0)] * 10])
    primitive["targets"] = [
        {"POSITION": model.array(MOVES[n]), "NORMAL": model.array(turned[n])} for n in (0, 1)
    ]
    model.document["meshes"][0].update(said)
    model.document["nodes"] = [{"mesh": 0, "translation": [7, 0, 0]}]
    model.document["scenes"] = [{"nodes": [0]}]
    return model


@pytest.mark.parametrize(
    ("of_mesh", "of_node", "weights"),
    [
        (None, None, (0, 0)), ([0.5, -1], None, (0.5, -1)), ([0.5, -1], [0.25, 2], (0.25, 2)),
        (None, [1, 1], (1, 1)),
    ],
)  # fmt: skip
def test_weights_of_the_node_come_before_those_of_the_mesh(tmp_path, of_mesh, of_node, weights):
    model = morphing(**({} if of_mesh is None else {"weights": of_mesh}))
    if of_node is not None:
        model.document["nodes"][0]["weights"] = of_node
    scene = load(model, tmp_path)
    wanted = np.array(naive.morphed(STRIP, MOVES, weights)) + (7, 0, 0)
    np.testing.assert_allclose(drawn(scene), wanted, atol=TOLERANCE)
    rest = scene.nodes[0].mesh
    turned = np.float32([[(0.2, 0, -0.1)] * 10, [(0, 0.5, 0)] * 10])
    normals = [naive.unit(one) for one in naive.morphed(rest.normals, turned, weights)]
    np.testing.assert_allclose(scene.posed().nodes[0].mesh.normals, normals, atol=2e-7)


def test_sparse_targets_move_what_they_list(tmp_path):
    model = morphing(weights=[0.5, 0.0], extras={"targetNames": ["smile", "frown"]})
    target = {"POSITION": model.sparse(10, [2, 9], [(1, 2, 3), (0, -4, 0)])}
    model.document["meshes"][0]["primitives"][0]["targets"][0] = target
    scene = load(model, tmp_path)
    assert scene.nodes[0].mesh.morph_targets.names == ("smile", "frown")
    moved = drawn(scene) - (STRIP + np.float32((7, 0, 0)))
    assert np.flatnonzero(np.abs(moved).max(axis=1) > 1e-9).tolist() == [2, 9]
    np.testing.assert_allclose(moved[[2, 9]], [(0.5, 1, 1.5), (0, -2, 0)], atol=1e-6)


def test_targets_act_before_joints(tmp_path):
    model = arm()
    model.document["meshes"][0]["weights"] = [0.75]
    primitive = model.document["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": model.array(MOVES[0])}]
    points = naive.morphed(STRIP, MOVES[:1], [0.75])
    np.testing.assert_allclose(
        drawn(load(model, tmp_path)), expected(points=points), atol=TOLERANCE
    )


# --- animations -----------------------------------------------------------------------------------

TIMES = np.float32([0.5, 1.0, 2.5])
TURNS = np.float32([(0, 0, 0, 1), (0, 0, 0.6, -0.8), (0.5, 0.5, 0.5, 0.5)])
SHIFTS = np.float32([(0, 0, 0), (1, -2, 3), (0.5, 0.25, 8)])


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
@pytest.mark.parametrize("time", [-1.0, 0.0, 0.5, 0.6, 0.99, 1.0, 1.7, 2.5, 99.0])
def test_channels_are_those_of_the_specification(tmp_path, interpolation, time):
    random = np.random.default_rng(3)
    sizes = np.float32([(1, 1, 1), (2, 0.5, 1), (1, 3, 0.25)])

    def keys(values):
        if interpolation != "CUBICSPLINE":
            return values
        sides = np.float32(random.normal(size=(2, *values.shape)))
        return np.stack([sides[0], values, sides[1]], axis=1)

    given = {
        (2, "rotation"): keys(TURNS), (1, "translation"): keys(SHIFTS), (3, "scale"): keys(sizes),
    }  # fmt: skip
    model = arm()
    for (target, path), values in given.items():
        animate(model, target, path, TIMES, values, interpolation)
    scene = load(model, tmp_path)
    assert (scene.animations[0].name, scene.animations[0].duration) == ("move 0", 2.5)
    values = {}
    for (target, path), rows in given.items():
        value = naive.value_at(path, TIMES, rows.tolist(), interpolation, time)
        values.setdefault(target, {})[path] = value
    np.testing.assert_allclose(drawn(scene.at(time)), expected(values), atol=1e-11)
    np.testing.assert_allclose(drawn(scene), expected(), atol=TOLERANCE)


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2"])
def test_rotations_may_be_whole_numbers(tmp_path, kind):
    most = np.iinfo(kind).max
    stored = np.round(np.float64([(0, 0, 0, 1), (0.5, 0.5, 0.5, 0.5)]) * most)
    scene = load(animate(arm(), 2, "rotation", [0, 1], stored, kind=kind), tmp_path)
    value = naive.value_at("rotation", [0, 1], (stored / most).tolist(), "LINEAR", 0.25)
    wanted = expected({2: {"rotation": value}})
    np.testing.assert_allclose(drawn(scene.at(0.25)), wanted, atol=1e-11)


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_weights_are_animated(tmp_path, interpolation):
    rows = np.float32([(0, 1), (1, 0.5), (-1, 2)])
    if interpolation == "CUBICSPLINE":
        rows = np.stack([rows * 0.3, rows, rows * -0.2], axis=1)
    model = animate(morphing(), 0, "weights", TIMES, rows, interpolation)
    scene = load(model, tmp_path)
    for time in (0.0, 0.75, 1.3, 7.0):
        weights = naive.value_at("weights", TIMES, rows.tolist(), interpolation, time)
        wanted = np.array(naive.morphed(STRIP, MOVES, weights)) + (7, 0, 0)
        np.testing.assert_allclose(drawn(scene.at(time)), wanted, atol=1e-11)


def test_all_parts_of_a_mesh_get_weights_and_skin(tmp_path):
    model = morphing()
    mesh = model.document["meshes"][0]
    mesh["primitives"] = [mesh["primitives"][0]] * 3
    scene = load(animate(model, 0, "weights", [0, 1], [(0, 0), (1, 0)]), tmp_path)
    assert len(scene.nodes) == 3
    for number in range(3):
        wanted = STRIP + MOVES[0] + (7, 0, 0)
        np.testing.assert_allclose(drawn(scene.at(1.0), number), wanted, atol=1e-6)


def test_animations_are_asked_for_by_name_and_number(tmp_path):
    model = animate(arm(), 1, "translation", [0, 1], [(0, 0, 0), (1, 0, 0)])
    animate(model, 2, "translation", [0, 2], [(0, 2, 0), (0, 2, 5)], number=1)
    scene = load(model, tmp_path)
    one, other = {"translation": (1, 0, 0)}, {"translation": (0, 2, 2.5)}
    for asked, moved in (
        (None, {1: one}), (0, {1: one}), ("move 1", {2: other}), (1, {2: other}),
        (scene.animations[1], {2: other}), (["move 0", 1], {1: one, 2: other}), ([], {}),
    ):  # fmt: skip
        posed = drawn(scene.at(1.0, asked))
        np.testing.assert_allclose(posed, expected(moved), atol=TOLERANCE)
    with pytest.raises(
        ValueError, match="animation must be one of 'move 0', 'move 1', got 'mov 1'"
    ):
        scene.at(0.0, "mov 1")
    with pytest.raises(ValueError, match="animation"):
        scene.at(0.0, 2)
    with pytest.raises(ValueError, match="time must be"):
        scene.at(float("nan"))


def test_what_has_no_mesh_is_animated_with_what_hangs_below_it(tmp_path):
    model = morphing()
    model.document["nodes"] += [{"name": "cart", "children": [0], "scale": [2, 2, 2]}]
    model.document["scenes"] = [{"nodes": [1]}]
    scene = load(animate(model, 1, "translation", [0, 1], [(0, 0, 0), (0, 0, 4)]), tmp_path)
    wanted = (STRIP + np.float32((7, 0, 0))) * 2 + (0, 0, 2)
    np.testing.assert_allclose(drawn(scene.at(0.5)), wanted, atol=1e-5)


# --- saved again ----------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_what_moves_is_saved_and_loaded_again(tmp_path, suffix):
    model = arm()
    model.document["meshes"][0].update(weights=[0.75], extras={"targetNames": ["bulge"]})
    primitive = model.document["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": model.array(MOVES[0])}]
    animate(model, 2, "rotation", TIMES, TURNS)
    animate(model, 1, "translation", TIMES, np.stack([SHIFTS * 0.1] * 3, 1), "CUBICSPLINE")
    animate(model, 0, "weights", TIMES, [(0.0,), (1.0,), (0.5,)], "STEP")
    animate(model, 3, "scale", TIMES, [(1, 2, 3), (2, 2, 2), (1, 1, 1)], number=1)
    scene = load(model, tmp_path)
    scene.save(tmp_path / f"b{suffix}")
    again = rj.load(tmp_path / f"b{suffix}")
    assert [one.name for one in again.animations] == ["move 0", "move 1"]
    assert again.nodes[0].mesh.morph_targets.names == ("bulge",)
    np.testing.assert_array_equal(drawn(again), drawn(scene))
    for time, which in ((0.1, 0), (0.8, 0), (1.9, 1), (1.9, [0, 1])):
        np.testing.assert_array_equal(drawn(again.at(time, which)), drawn(scene.at(time, which)))
    frames = [rj.render(one.at(1.2), size=(40, 30)) for one in (scene, again)]
    np.testing.assert_array_equal(frames[0].color, frames[1].color)


def test_normals_of_faces_are_saved_as_at_rest_and_named(tmp_path):
    scene = load(arm(normals=False), tmp_path)
    with pytest.warns(SaveWarning, match="normals that are made anew for each pose"):
        scene.save(tmp_path / "b.glb")
    np.testing.assert_array_equal(drawn(rj.load(tmp_path / "b.glb")), drawn(scene))


# --- damaged --------------------------------------------------------------------------------------

REST = STRIP @ np.diag([1.0, -1.0, -1.0]) + (7, 0, 0)
"""The strip where its own node is: without a skin."""


def change_skin(**values):
    def change(model):
        model.document["skins"][0].update(values)

    return change


def short_binds(model):
    model.document["skins"][0]["inverseBindMatrices"] = model.array(np.tile(np.eye(4), (2, 1, 1)))


def flat_binds(model):
    binds = np.tile(np.eye(4), (3, 1, 1))
    binds[1, 2] = 0.0
    model.document["skins"][0]["inverseBindMatrices"] = model.array(binds.transpose(0, 2, 1))


def nan_binds(model):
    binds = np.tile(np.eye(4), (3, 1, 1))
    binds[1, 2, 3] = np.nan
    model.document["skins"][0]["inverseBindMatrices"] = model.array(binds.transpose(0, 2, 1))


def other_skin(model):
    model.document["nodes"][0]["skin"] = 5


def without_joints(model):
    for name in ("JOINTS_0", "WEIGHTS_0"):
        del model.document["meshes"][0]["primitives"][0]["attributes"][name]


def nan_weights(model):
    weights = WEIGHTS.copy()
    weights[3, 0] = np.nan
    model.document["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = model.array(weights)


def short_joints(model):
    attributes = model.document["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = model.array(JOINTS[:7], "u1")


def cut_joints(model):
    attributes = model.document["meshes"][0]["primitives"][0]["attributes"]
    model.document["accessors"][attributes["JOINTS_0"]]["count"] = 10**6


def no_weights(model):
    del model.document["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"]


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (change_skin(joints=[1, 2, 99]), "joints must be below 4, got 99"),
        (change_skin(joints=[1, 2]), "skin must have a joint 2"),
        (change_skin(joints=[]), "it has no joints"),
        (change_skin(joints=[1, 2, "x"]), "joints must be a whole number"),
        (change_skin(joints=None), "it has no joints"),
        (change_skin(inverseBindMatrices=0), "inverseBindMatrices must be 3 matrices"),
        (change_skin(inverseBindMatrices=99), "no accessor 99"),
        (short_binds, "inverseBindMatrices must be 3 matrices of 16 numbers, got 2"),
        (flat_binds, "inverse_binds[1] must have an inverse"),
        (nan_binds, "inverse_binds must be finite"),
        (other_skin, "no skin 5 (it has 1)"),
        (without_joints, "skin must be None for a mesh without joints"),
        (nan_weights, "WEIGHTS_0 of mesh 0, which has NaN"),
        (short_joints, "JOINTS_0 of mesh 0, which does not fit the vertices"),
        (cut_joints, "JOINTS_0 of mesh 0, which cannot be read"),
        (no_weights, "JOINTS_0 of mesh 0, which has no WEIGHTS_0"),
    ],
)
def test_a_damaged_skin_is_left_out_by_name(tmp_path, damage, said):
    model = arm()
    damage(model)
    np.testing.assert_allclose(drawn(load_with(model, tmp_path, said)), REST, atol=1e-6)


def test_weights_that_are_all_zero_follow_the_first_joint(tmp_path):
    weights = WEIGHTS.copy()
    weights[4:6] = 0
    scene = load_with(arm(weights=weights), tmp_path, "weights of mesh 0 that are all 0", "(2)")
    weights[4:6, 0] = 1
    np.testing.assert_allclose(drawn(scene), expected(weights=weights), atol=TOLERANCE)


def test_weights_that_do_not_sum_to_one_are_scaled(tmp_path):
    scene = load_with(arm(weights=WEIGHTS * 0.5), tmp_path, "sums of weights of mesh 0")
    np.testing.assert_allclose(drawn(scene), expected(), atol=TOLERANCE)


def test_joints_that_hang_in_a_circle_are_named(tmp_path):
    model = arm()
    model.document["nodes"][3]["children"] = [1]
    scene = load_with(model, tmp_path, "node 1 below itself (1)")
    np.testing.assert_allclose(drawn(scene), expected(), atol=TOLERANCE)
    # Joints in a circle that no scene has.
    model.document["scenes"] = [{"nodes": [0]}]
    load_with(model, tmp_path, "below itself")


def channel(**values):
    def change(model):
        model.document["animations"][0]["channels"][0].update(values)

    return change


def sampler(**values):
    def change(model):
        model.document["animations"][0]["samplers"][0].update(values)

    return change


def times(*values):
    def change(model):
        model.document["animations"][0]["samplers"][0]["input"] = model.array(np.float32(values))

    return change


def nan_values(model):
    rows = model.array([(0, 0, 0, 1), (np.nan, 0, 0, 1), (0, 0, 0, 1)])
    model.document["animations"][0]["samplers"][0]["output"] = rows


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (channel(target={"node": 99, "path": "rotation"}), "no node 99"),
        (channel(target={"path": "rotation"}), "node is missing"),
        (channel(target={"node": 2, "path": "colour"}), "path must be one of"),
        (channel(target={"node": 2, "path": "weights"}), "has no morph targets"),
        (
            channel(
                target={"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": ""}}}
            ),
            "KHR_animation_pointer is not read",
        ),
        (channel(sampler=4), "sampler must be below 1, got 4"),
        (channel(target=3), "target must be an object"),
        (sampler(interpolation="BEZIER"), "interpolation must be one of"),
        (sampler(interpolation="BEZIER", output=0), "interpolation must be one of"),
        (sampler(interpolation=["LINEAR"]), "interpolation must be one of"),
        (sampler(output=0), "output must be 3 rows of 4"),
        (sampler(input=0), "input must be numbers"),
        (sampler(input=77), "no accessor 77"),
        (times(0, 1), "output must be 2 rows of 4 for 2 keys, got 3"),
        (times(0, 1, 1), "times must ascend, got 1.0 before 1.0"),
        (times(0, 2, 1), "times must ascend, got 2.0 before 1.0"),
        (times(0, np.nan, 1), "times must be finite"),
        (nan_values, "values must be finite"),
    ],
)
def test_a_damaged_channel_is_left_out_by_name(tmp_path, damage, said):
    model = animate(arm(), 2, "rotation", TIMES, TURNS)
    damage(model)
    scene = load_with(model, tmp_path, said, "animation 'move 0', which has no channel of use")
    assert scene.animations == []
    np.testing.assert_allclose(drawn(scene), expected(), atol=TOLERANCE)


def test_a_channel_too_many_is_left_out_and_the_others_stay(tmp_path):
    model = animate(arm(), 2, "rotation", TIMES, TURNS)
    animate(model, 2, "rotation", TIMES, TURNS[::-1])
    scene = load_with(model, tmp_path, "channel 1 of animation 'move 0': it moves the rotation")
    assert len(scene.animations[0].channels) == 1


def test_damaged_targets_are_left_out_by_name(tmp_path):
    model = morphing(weights=[1.0, 1.0])
    targets = model.document["meshes"][0]["primitives"][0]["targets"]
    targets[0]["POSITION"] = model.array(MOVES[0][:4])
    targets[1] = 7
    scene = load_with(
        model, tmp_path, "POSITION of morph target 0 of mesh 0, which does not fit the vertices",
        "morph target 1 of mesh 0, which is no object",
    )  # fmt: skip
    np.testing.assert_allclose(drawn(scene), STRIP + np.float32((7, 0, 0)), atol=1e-6)


@pytest.mark.parametrize(
    ("weights", "said"),
    [([1.0], "which has 2 morph targets, not 1"), ([1.0, "x"], "weights must be 2 finite numbers")],
)
def test_weights_that_do_not_fit_are_left_out(tmp_path, weights, said):
    scene = load_with(morphing(weights=weights), tmp_path, "weights of mesh 0", said)
    np.testing.assert_allclose(drawn(scene), STRIP + np.float32((7, 0, 0)), atol=1e-6)
    model = morphing()
    model.document["nodes"][0]["weights"] = weights
    load_with(model, tmp_path, "weights of node '0'")


def test_cameras_and_lights_that_would_move_are_named(tmp_path):
    model = arm()
    model.document["cameras"] = [
        {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}
    ]
    model.document["nodes"].append({"camera": 0})
    model.document["nodes"][2]["children"] = [3, 4]
    animate(model, 1, "translation", [0, 1], [(0, 0, 0), (1, 0, 0)])
    load_with(model, tmp_path, "movement of a camera (1)")


def test_skins_of_points_are_named(tmp_path):
    model = arm()
    model.document["meshes"][0]["primitives"][0]["mode"] = 0
    load_with(model, tmp_path, "joints of points (1)", "skin of node '0'")


def test_lists_of_another_kind_are_named(tmp_path):
    model = arm()
    model.document["skins"], model.document["animations"] = {}, "none"
    scene = load_with(model, tmp_path, "skins must be a list", "animations must be a list")
    np.testing.assert_allclose(drawn(scene), REST, atol=1e-6)


def test_a_file_of_joints_alone_shows_nothing(tmp_path):
    model = Gltf()
    model.document["nodes"] = [{"name": "bone"}]
    model.document["skins"] = [{"joints": [0]}]
    with pytest.raises(rj.MeshFileError, match="holds no faces"):
        load(model, tmp_path)


def test_animations_of_what_was_removed_are_neither_played_nor_saved(tmp_path):
    scene = rj.Scene()
    figure = scene.add(rj.load("models/figure.glb"))
    other = scene.add(rj.load("models/figure.glb"))
    names = [one.name for one in scene.animations]
    count = len(names) // 2
    assert names[:count] == names[count:]
    scene.remove(figure)
    left = len(scene.every_node())
    # What is asked for by name, or not at all, is that of the one that is there.
    for asked in (None, "walk", count, ["walk"]):
        found, still = scene.at(0.3, asked), scene.at(0.0, asked)
        assert len(found.every_node()) == left
        pairs = zip(found.every_node(), still.every_node(), strict=True)
        assert any((one.transform != two.transform).any() for one, two in pairs), asked
    for asked in (0, scene.animations[0], ["walk", 0]):
        with pytest.raises(ValueError, match=r"animation must move a node of the scene.*'walk'"):
            scene.at(0.3, asked)
    scene.save(tmp_path / "a.glb")
    again = rj.load(tmp_path / "a.glb")
    assert len(again.every_node()) == left
    assert [(one.name, len(one.channels)) for one in again.animations] == [
        (one.name, len(one.channels)) for one in scene.animations[count:]
    ]
    whole = rj.Scene()
    whole.add(scene)
    assert [one.name for one in whole.animations] == names[count:]
    # Added again, it moves again, in copies too.
    copied = pickle.loads(pickle.dumps(scene))
    for one, top in ((scene, figure), (copied, root_of(copied.animations[0].channels[0].node))):
        one.add(top)
        assert len(one.every_node()) == len(one.at(0.3, 0).every_node()) == 2 * left
    scene.remove(other)
    assert scene.at(0.3, "walk").every_node()[0].name == figure.name


def test_an_animation_keeps_what_is_left_of_it_when_a_node_is_removed(tmp_path):
    scene = rj.Scene()
    nodes = [scene.add(rj.Mesh(np.eye(3), [(0, 1, 2)]), name=name) for name in ("one", "two")]
    keys = [(0, 0, 0), (1, 0, 0)]
    both = [rj.Channel(node, "translation", [0, 1], keys) for node in nodes]
    scene.animations.append(rj.Animation("both", both))
    scene.remove(nodes[0])
    assert scene.at(1.0).find("two").transform[0, 3] == 1.0
    scene.save(tmp_path / "a.glb")
    (animation,) = rj.load(tmp_path / "a.glb").animations
    assert [one.node.name for one in animation.channels] == ["two"]
    assert len(scene.animations[0].channels) == 2
