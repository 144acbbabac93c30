"""Laws of scenes: places, instances, bounds."""

import copy
import pickle

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene import scene as scene_module
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import Scene
from rasterjit.scene.wireframe import Wireframe

TRIANGLE = [[0, 0, 0], [2, 0, 0], [0, 2, 0]]


def triangle():
    return Mesh(TRIANGLE, [[0, 1, 2]])


def moved(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def test_a_new_scene_is_empty():
    scene = Scene()
    assert (scene.nodes, scene.lights, scene.camera, scene.wireframe) == ([], [], None, None)


def test_a_mistyped_field_is_refused_and_the_right_ones_are_listed():
    scene, mesh = rj.Scene(), rj.Mesh(np.eye(3), [[0, 1, 2]])
    node = scene.add(mesh)
    with pytest.raises(AttributeError, match=r"Scene has no 'tonemap'; .* fog, tone_map, vignette"):
        scene.tonemap = rj.ToneMap()
    with pytest.raises(
        AttributeError,
        match=r"Node has no 'pose'; .* mesh, transform, world_from",
    ):
        node.pose = np.eye(4)
    with pytest.raises(AttributeError, match=r"Mesh has no 'texture'; .* material"):
        mesh.texture = None
    for thing in (scene, node, mesh):
        twin = pickle.loads(pickle.dumps(copy.copy(thing)))
        assert vars(twin).keys() == vars(thing).keys()
        with pytest.raises(AttributeError, match="has no 'colour'"):
            twin.colour = "red"


def test_every_field_of_a_scene_may_be_assigned():
    scene = rj.Scene()
    for name, value in vars(rj.Scene()).items():
        setattr(scene, name, value)
    scene.variant = None
    plain = {name for name in vars(scene) if name[0] != "_"}
    assert plain | {"variant"} == set(rj.Scene._FIELDS)


def test_objects_are_numbered_in_the_order_they_were_added():
    scene = Scene()
    first, second = scene.add(triangle()), scene.add(triangle(), name="lid")
    assert scene.nodes == [first, second]
    assert [node.name for node in scene.nodes] == ["object 0", "lid"]


def test_an_instance_shares_its_mesh():
    scene, mesh = Scene(), triangle()
    scene.add(mesh)
    scene.add(mesh, moved(1, 0, 0))
    assert scene.nodes[0].mesh is scene.nodes[1].mesh
    assert np.array_equal(scene.nodes[0].world_from_model, np.eye(4))
    assert np.array_equal(scene.nodes[1].world_from_model, moved(1, 0, 0))


def test_a_node_keeps_its_own_copy_of_the_transform():
    scene, matrix = Scene(), np.eye(4)
    node = scene.add(triangle(), matrix)
    matrix[0, 3] = 9.0
    assert np.array_equal(node.world_from_model, np.eye(4))


def test_a_node_can_be_moved():
    node = Scene().add(triangle())
    node.world_from_model = moved(1, 2, 3)
    assert node.world_from_model[:3, 3].tolist() == [1, 2, 3]
    with pytest.raises(ValueError, match="world_from_model must have shape"):
        node.world_from_model = np.eye(3)


def test_a_flattening_transform_is_allowed():
    Scene().add(triangle(), np.diag([1.0, 0.0, 1.0, 1.0]))


def test_rounding_in_the_last_row_is_removed():
    matrix = np.eye(4)
    matrix[3] = 1e-17, 0.0, 0.0, 1.0 + 1e-15
    assert Scene().add(triangle(), matrix).world_from_model[3].tolist() == [0, 0, 0, 1]


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(3), "transform must have shape"),
        (np.full((4, 4), np.nan), "transform must be finite"),
        (np.eye(4) * 2.0, "transform must be affine.*0.0, 0.0, 0.0, 2.0"),
        (moved(1, 2, 3).T, "transform must be affine.*column vectors"),
        ("left", "transform must be an array"),
    ],
)
def test_a_bad_transform_is_refused_by_name(matrix, message):
    with pytest.raises(ValueError, match=message):
        Scene().add(triangle(), matrix)


def test_only_meshes_can_be_added():
    with pytest.raises(ValueError, match=r"rasterjit Mesh, Label, Node or Scene, .* got list"):
        Scene().add([1, 2, 3])


def test_bounds_are_those_of_the_vertices_in_world_space():
    scene, mesh = Scene(), triangle()
    scene.add(mesh)
    scene.add(mesh, moved(10, 0, -1) @ np.diag([-1.0, 1.0, 1.0, 1.0]))
    low, high = scene.bounds()
    assert (low.tolist(), high.tolist()) == ([0, 0, -1], [10, 2, 0])


def test_the_sphere_is_centred_on_the_box_and_reaches_the_farthest_vertex():
    scene = Scene()
    scene.add(triangle())
    center, radius = scene.bounding_sphere()
    assert center.tolist() == [1.0, 1.0, 0.0]
    assert radius == pytest.approx(np.sqrt(2.0), rel=1e-15)


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_the_sphere_holds_scenes_of_any_size(scale):
    scene = Scene()
    scene.add(Mesh(np.array(TRIANGLE) * scale, [[0, 1, 2]]))
    center, radius = scene.bounding_sphere()
    assert center[0] == pytest.approx(scale)
    assert radius == pytest.approx(np.sqrt(2.0) * scale)


def test_a_single_point_has_a_sphere_of_radius_zero():
    scene = Scene()
    scene.add(Mesh([[1, 2, 3]], [[0, 0, 0]]))
    center, radius = scene.bounding_sphere()
    assert (center.tolist(), radius) == ([1, 2, 3], 0.0)


def test_vertices_that_are_unused_or_not_finite_do_not_count():
    vertices = [*TRIANGLE, [99, 99, 99], [np.inf, 0, 0]]
    scene = Scene()
    scene.add(Mesh(vertices, [[0, 1, 2], [0, 1, 4]], on_invalid="drop"))
    low, high = scene.bounds()
    assert (low.tolist(), high.tolist()) == ([0, 0, 0], [2, 2, 0])


def test_an_empty_scene_has_no_bounds():
    with pytest.raises(ValueError, match="scene has no face"):
        Scene().bounding_sphere()


def test_a_wireframe_has_a_linear_colour_and_a_mode():
    assert Wireframe() == Wireframe(color=(0.0, 0.0, 0.0), mode="overlay")
    assert Wireframe("white", "only").color == (1.0, 1.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="mode must be one of 'overlay', 'only'"):
        Wireframe(mode="dashed")


def test_a_node_refuses_what_is_no_mesh_and_keeps_its_matrix_from_changes():
    node = Scene().add(triangle())
    with pytest.raises(ValueError, match="mesh must be a rasterjit Mesh, got int"):
        node.mesh = 5
    with pytest.raises(ValueError, match="read-only"):
        node.world_from_model[0, 0] = np.nan
    other = triangle()
    node.mesh = other
    assert node.mesh is other


def test_many_instances_have_the_bounds_of_as_many_meshes(monkeypatch):
    rng = np.random.default_rng(6)
    instances, copies = Scene(), Scene()
    mesh = Mesh(rng.normal(size=(40, 3)), rng.integers(0, 40, (20, 3)))
    for _ in range(30):
        matrix = np.eye(4)
        matrix[:3] = rng.normal(size=(3, 4))
        instances.add(mesh, matrix)
        copies.add(Mesh(mesh.vertices, mesh.faces), matrix)
    expected = copies.bounding_sphere()
    for chunk in (1 << 18, 100, 7):
        monkeypatch.setattr(scene_module, "_VERTICES_PER_CHUNK", chunk)
        for scene in (instances, copies):
            center, radius = scene.bounding_sphere()
            assert center.tolist() == expected[0].tolist()
            assert radius == expected[1]
