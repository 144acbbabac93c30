"""The adapter takes the values that pyrender 0.1.45 takes, and returns what it returns."""

from __future__ import annotations

import copy
import math
import sys

import numpy as np
import pytest
import trimesh
from original_pyrender import ORIGINAL, needs_original, recording_of, said_of

from rasterjit.compat import pyrender
from rasterjit.compat.pyrender.material import SpecularGlossinessMaterial
from rasterjit.scene.transforms import translate

SCRIPT = "pyrender_values.py"
W, H = 48, 36


@pytest.fixture(scope="module")
def recorded():
    return recording_of(SCRIPT)


def test_values_end_in_what_they_end_in_there(recorded):
    found = said_of(sys.executable, "rasterjit.compat.pyrender", SCRIPT)
    assert len(recorded) > 200
    differing = {case: (recorded[case], found.get(case)) for case in recorded
                 if found.get(case) != recorded[case]}  # fmt: skip
    assert differing == {}


@needs_original
def test_recorded_values_are_those_of_the_original(recorded):
    assert said_of(ORIGINAL, "pyrender", SCRIPT) == recorded


@pytest.mark.parametrize(
    "one", [np.array([0.5]), np.array(0.5), np.float32(0.5), np.array([[0.5]])]
)
def test_array_of_one_number_is_that_number(one):
    assert pyrender.PerspectiveCamera(one).yfov == 0.5
    assert pyrender.PointLight(intensity=one).intensity == 0.5
    assert pyrender.MetallicRoughnessMaterial(metallicFactor=one).metallicFactor == 0.5
    assert pyrender.DirectionalLight(color=one).color[0] == 0.5


@pytest.mark.parametrize(
    ("call", "error", "named"),
    [
        (lambda: pyrender.PerspectiveCamera(None), TypeError, "yfov must be a number, got None"),
        (lambda: pyrender.PerspectiveCamera("w"), ValueError, "yfov must be a number, got 'w'"),
        (lambda: pyrender.PerspectiveCamera(-1), ValueError, "yfov must be above 0, got -1"),
        (lambda: pyrender.PerspectiveCamera(1.0, znear=-1), ValueError, "znear must be at least"),
        (lambda: pyrender.DirectionalLight(color="red"), ValueError, "color .* them, got 'red'$"),
        (lambda: pyrender.SpotLight(outerConeAngle=2), ValueError, "outerConeAngle must be in 0"),
        (lambda: pyrender.Material(doubleSided=1), TypeError, "doubleSided must be True or False"),
        (lambda: pyrender.Material(alphaCutoff=2), ValueError, "alphaCutoff must be in 0..1, got"),
        (lambda: pyrender.Material(normalTexture=7), TypeError, "normalTexture must be a picture"),
        (lambda: pyrender.Texture(source=np.zeros((2, 2))), ValueError, "source must have chan"),
        (lambda: pyrender.Primitive([0, 1, 2]), ValueError, r"positions must have shape \(n, 3\)"),
        (lambda: pyrender.Primitive([["a"] * 3]), ValueError, "positions must be an array of num"),
        (lambda: pyrender.Primitive(SQUARE, color_0="red"), ValueError, "color_0 must be col"),
        (lambda: pyrender.Primitive(SQUARE, indices="abc"), ValueError, "indices must be whole"),
        (lambda: pyrender.Node(mesh=3), TypeError, "mesh must be a Mesh or None, got 3"),
        (lambda: pyrender.Node(matrix=[[1], [2, 3]]), ValueError, "matrix must have shape"),
        (lambda: pyrender.Scene(nodes=two_parents()), ValueError, "nodes must have one parent"),
        (lambda: rendered(outputs="colour"), ValueError, "outputs must be one of"),
        (lambda: rendered(seg=[1, 2]), ValueError, "seg_node_map must hold"),
    ],
)
def test_error_names_the_attribute_and_the_value(call, error, named):
    with pytest.raises(error, match=named):
        call()


def scene(mesh=None):
    """A unit box, or a mesh, before a camera at z = 3."""
    made = pyrender.Scene(ambient_light=[1.0, 1.0, 1.0])
    node = made.add(pyrender.Mesh.from_trimesh(trimesh.creation.box()) if mesh is None else mesh)
    made.add(pyrender.PerspectiveCamera(math.pi / 3), pose=translate((0, 0, 3)))
    return made, node


def two_parents():
    """Two nodes and a third that is below both."""
    leaf = pyrender.Node()
    return [pyrender.Node(children=[leaf]), pyrender.Node(children=[leaf]), leaf]


def rendered(outputs=None, seg=None):
    made, node = scene()
    flags = pyrender.RenderFlags.NONE if seg is None else pyrender.RenderFlags.SEG
    return pyrender.OffscreenRenderer(4, 3).render(made, flags, {node: seg}, outputs=outputs)


def depth_of(mesh, flags=pyrender.RenderFlags.DEPTH_ONLY):
    renderer = pyrender.OffscreenRenderer(W, H)
    depth = renderer.render(scene(mesh)[0], flags)
    renderer.delete()
    return depth


SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]], float)


@pytest.mark.parametrize(
    ("mode", "positions", "indices"),
    [
        ("TRIANGLES", SQUARE, [[0, 1, 2], [2, 1, 3]]),
        ("TRIANGLES", SQUARE, [0, 1, 2, 2, 1, 3, 0]),
        ("TRIANGLES", SQUARE[[0, 1, 2, 2, 1, 3, 0]], None),
        ("TRIANGLE_STRIP", SQUARE, None),
        ("TRIANGLE_STRIP", SQUARE[::-1], [3, 2, 1, 0]),
        ("TRIANGLE_FAN", SQUARE, [0, 1, 3, 2]),
        ("TRIANGLE_FAN", SQUARE[[0, 1, 3, 2]], None),
    ],
)
def test_strips_and_fans_cover_what_their_triangles_do(mode, positions, indices):
    mesh = pyrender.Mesh([
        pyrender.Primitive(positions, indices=indices, mode=getattr(pyrender.GLTF, mode))
    ])  # fmt: skip
    depth = depth_of(mesh)
    # Two faces, of which neither is a back face.
    wanted = depth_of(pyrender.Mesh([pyrender.Primitive(SQUARE, indices=[[0, 1, 2], [2, 1, 3]])]))
    np.testing.assert_array_equal(depth, wanted)
    assert (depth > 0).mean() > 0.2


def test_meshes_of_nothing_are_drawn_as_nothing():
    assert not depth_of(pyrender.Mesh([])).any()
    for mode in pyrender.GLTF.TRIANGLES, pyrender.GLTF.TRIANGLE_STRIP, pyrender.GLTF.POINTS:
        assert not depth_of(pyrender.Mesh([pyrender.Primitive(np.zeros((0, 3)), mode=mode)])).any()
        few = pyrender.Primitive(np.zeros((2, 3)), mode=mode)
        assert few.list_faces().shape == (0, 3)
    assert not depth_of(pyrender.Mesh([pyrender.Primitive(np.zeros((2, 3)))])).any()


def test_arrays_that_are_set_are_drawn():
    box = trimesh.creation.box()
    mesh = pyrender.Mesh.from_trimesh(box)
    made, _ = scene(mesh)
    renderer = pyrender.OffscreenRenderer(W, H)
    first = renderer.render(made, pyrender.RenderFlags.DEPTH_ONLY)
    mesh.primitives[0].positions = box.vertices * 0.5
    second = renderer.render(made, pyrender.RenderFlags.DEPTH_ONLY)
    mesh.primitives.append(pyrender.Primitive(SQUARE, indices=[0, 1, 2, 2, 1, 3]))
    third = renderer.render(made, pyrender.RenderFlags.DEPTH_ONLY)
    renderer.delete()
    assert (second > 0).sum() < (first > 0).sum() < (third > 0).sum()
    assert mesh.bounds.tolist() == [[-1.0, -1.0, -0.25], [1.0, 1.0, 0.25]]


def test_a_channel_of_a_colour_can_be_set():
    mesh = pyrender.Mesh.from_trimesh(trimesh.creation.box())
    made, _ = scene(mesh)
    mesh.primitives[0].material.baseColorFactor[:3] = 1.0, 0.0, 0.0
    mesh.primitives[0].material.baseColorFactor[3] = 0.5
    renderer = pyrender.OffscreenRenderer(W, H)
    red, green, _ = renderer.render(made, pyrender.RenderFlags.FLAT)[0][H // 2, W // 2].tolist()
    renderer.delete()
    assert mesh.is_transparent
    assert red == 255
    # The white background is seen through it.
    assert 100 < green < 200


def test_pose_that_was_set_is_kept_as_it_is():
    made, node = scene()
    pose = np.diag([-1.0, 1.0, 1.0, 1.0])
    made.set_pose(node, pose)
    assert made.get_pose(node).tolist() == pose.tolist()
    assert node.translation.tolist() == [0.0, 0.0, 0.0]
    pose[0, 3] = 2.0
    # The array is the program's, and counts as it is when a scene is drawn.
    assert made.get_pose(node)[0, 3] == 2.0
    node.matrix[0, 3] = 7.0
    assert made.get_pose(node)[0, 3] == 2.0
    with pytest.raises(ValueError, match="pose must be numbers of shape"):
        made.set_pose(node, np.eye(3))


def test_poses_with_rounding_errors_are_taken():
    generator = np.random.default_rng(5)
    for _ in range(50):
        turn = trimesh.transformations.random_rotation_matrix(generator.random(3))
        turn[:3, 3] = generator.normal(size=3)
        pose = np.linalg.pinv(turn)
        np.testing.assert_allclose(pyrender.Node(matrix=pose).matrix, pose, atol=1e-12)


def test_flat_matrices_are_taken():
    flat = pyrender.Node(matrix=np.diag([1.0, 0.0, 1.0, 1.0]))
    assert flat.scale.tolist() == [1.0, 0.0, 1.0]


def test_copies_share_no_drawing():
    mesh = pyrender.Mesh.from_trimesh(trimesh.creation.box())
    depth_of(mesh)
    for other in (copy.deepcopy(mesh), copy.copy(mesh.primitives[0])):
        first = other.primitives[0] if isinstance(other, pyrender.Mesh) else other
        assert first._drawn == {}
        first.positions = first.positions * 2.0
    assert mesh.bounds.tolist() == [[-0.5] * 3, [0.5] * 3]


def test_glossy_materials_are_drawn_as_rough_ones():
    look = SpecularGlossinessMaterial(diffuseFactor=[0.2, 0.4, 0.6, 1.0], glossinessFactor=0.25)
    assert look.glossinessFactor == 0.25
    made, _ = scene(pyrender.Mesh.from_trimesh(trimesh.creation.box(), material=look))
    renderer = pyrender.OffscreenRenderer(W, H)
    color, _ = renderer.render(made, pyrender.RenderFlags.FLAT)
    renderer.delete()
    assert color[H // 2, W // 2].tolist() == [51, 102, 153]


def test_large_indices_stay_exact():
    kept = pyrender.Primitive([[0, 0, 0]], indices=[[0, 1, (1 << 24) + 1]]).indices
    assert kept.dtype == np.float64
    assert kept.tolist() == [[0, 1, (1 << 24) + 1]]


class Affine(pyrender.Camera):
    """A camera of a program's own."""

    def get_projection_matrix(self, width=None, height=None):
        return pyrender.PerspectiveCamera(1.0).get_projection_matrix(width, height)


def test_cameras_of_programs_are_cameras():
    camera = Affine(znear=0.5, name="own")
    made = pyrender.Scene()
    made.add(pyrender.Mesh.from_trimesh(trimesh.creation.box()))
    node = made.add(camera, pose=translate((0, 0, 3)))
    assert made.main_camera_node is node
    assert made.cameras == {camera}
    renderer = pyrender.OffscreenRenderer(W, H)
    assert (renderer.render(made)[1] > 0).any()
    renderer.delete()


UPRIGHT = [[0.0, 0.0, 1.0]] * 4
QUAD = {"normals": UPRIGHT, "indices": [[0, 1, 2], [2, 1, 3]]}


def spoilt(array, rows=slice(0, 1)):
    """Return an array with rows that are no numbers."""
    array = np.array(array, float)
    array[rows] = np.nan
    return array


@pytest.mark.parametrize("flags", ["NONE", "DEPTH_ONLY", "ALL_WIREFRAME"])
@pytest.mark.parametrize("mode", ["POINTS", "LINES", "LINE_STRIP", "TRIANGLES", "TRIANGLE_STRIP"])
def test_vertices_that_are_no_numbers_are_left_out(mode, flags):
    """As a graphics card does; clouds of depth cameras are full of them."""
    places = np.random.default_rng(3).uniform(-0.8, 0.8, (60, 3))
    flags, mode = getattr(pyrender.RenderFlags, flags), getattr(pyrender.GLTF, mode)
    renderer = pyrender.OffscreenRenderer(W, H)
    counts = []
    for cloud in (spoilt(places, slice(0, 30)), places[30:], places, spoilt(places, slice(None))):
        found = renderer.render(
            scene(pyrender.Mesh([pyrender.Primitive(cloud, mode=mode)]))[0], flags
        )
        depth = found if flags == pyrender.RenderFlags.DEPTH_ONLY else found[1]
        counts.append(int((depth > 0).sum()))
    renderer.delete()
    assert 0 == counts[3] < counts[0] == counts[1] < counts[2]


@pytest.mark.filterwarnings("ignore:4 normals of length 0 of:UserWarning")
@pytest.mark.parametrize(
    ("numbers", "alike"),
    [
        ({"normals": spoilt(UPRIGHT, slice(None))}, {"normals": np.zeros((4, 3))}),
        ({"color_0": spoilt(np.ones((4, 3)), slice(None))}, {"color_0": np.zeros((4, 4))}),
        ({"texcoord_0": spoilt(np.ones((4, 2)), slice(None))}, {"texcoord_0": np.zeros((4, 2))}),
    ],
)
def test_attributes_that_are_no_numbers_are_0(numbers, alike):
    renderer = pyrender.OffscreenRenderer(W, H)
    look = pyrender.MetallicRoughnessMaterial(baseColorTexture=np.full((2, 2, 3), 0.5))
    pictures = [
        renderer.render(scene(pyrender.Mesh([
            pyrender.Primitive(SQUARE, material=look, **{**QUAD, **given})
        ]))[0])[0]
        for given in (numbers, alike)
    ]  # fmt: skip
    renderer.delete()
    np.testing.assert_array_equal(*pictures)


def test_poses_that_are_no_numbers_are_left_out():
    mesh = pyrender.Mesh.from_trimesh(trimesh.creation.box(), poses=[np.eye(4), np.eye(4) * np.nan])
    assert (depth_of(mesh) == depth_of(None)).all()
    made, node = scene()
    made.set_pose(node, np.full((4, 4), np.inf))
    renderer = pyrender.OffscreenRenderer(W, H)
    assert not renderer.render(made)[1].any()
    renderer.delete()


def test_a_program_that_sees_nothing_is_not_warned(recwarn):
    box = trimesh.creation.box()
    mesh = pyrender.Mesh([pyrender.Primitive(box.vertices, indices=box.faces)])
    made, node = scene(mesh)
    renderer = pyrender.OffscreenRenderer(W, H)
    assert renderer.render(made)[1].any()
    made.set_pose(node, translate((0.0, 0.0, 99.0)))
    assert not renderer.render(made)[1].any()
    renderer.delete()
    assert not recwarn.list


def test_sheared_and_mirrored_poses_turn_by_the_nearest_rotation():
    """As trimesh finds it, which pyrender asks; of mirrors along an axis three are as near."""
    generator = np.random.default_rng(3)
    for n in range(40):
        pose = trimesh.transformations.random_rotation_matrix(generator.random(3))
        pose[:3, :3] += 0.2 * generator.normal(size=(3, 3)) * (n % 2)
        node = pyrender.Node(matrix=pose)
        turn = np.eye(4)
        turn[:3, :3] = pose[:3, :3] / node.scale
        w, x, y, z = trimesh.transformations.quaternion_from_matrix(turn)
        np.testing.assert_allclose(np.abs(node.rotation @ (x, y, z, w)), 1.0, atol=1e-12)
    for mirror in np.eye(4)[:3]:
        turn = np.eye(4) - 2.0 * np.diag(mirror)
        w, x, y, z = trimesh.transformations.quaternion_from_matrix(turn)
        assert pyrender.Node(matrix=turn).rotation.tolist() == [x, y, z, w]


def test_fields_of_view_are_those_of_their_tangent():
    for yfov in (1e-3, 0.7, np.pi / 2.0, 3.0, np.pi, 4.0):
        clip = pyrender.PerspectiveCamera(yfov, aspectRatio=2.0).get_projection_matrix()
        np.testing.assert_allclose(clip[1, 1], 1.0 / np.tan(yfov / 2.0), rtol=1e-12)
        assert clip[0, 0] == clip[1, 1] / 2.0
    with pytest.raises(ValueError, match="yfov must be finite"):
        pyrender.PerspectiveCamera(np.inf).get_projection_matrix(4, 3)
