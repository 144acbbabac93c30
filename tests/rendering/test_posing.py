"""Posed meshes are what all sees: the picture, its buffers, cameras, cursors, copies, clusters."""

import copy
import pickle

import naive_posing as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.pipeline.geometry import skinning
from rasterjit.rendering import planning
from rasterjit.survey.cache import update_cache
from rasterjit.survey.deformation import pose_scene
from rasterjit.transforms import compose, rotate, rotate_x, rotate_z, scale, translate

SIZE = (80, 60)
EVERY = (
    "color", "depth", "face_id", "object_id", "normal", "position", "uv", "barycentric", "distance",
    "geometric_normal", "normal_camera", "position_camera", "material_id", "instance_id",
    "coverage",
)  # fmt: skip


def tube(rings=9, sides=12):
    """Return vertices and faces of a tube along y, from 0 to 4."""
    angles = np.arange(sides) * 2 * np.pi / sides
    points = np.array(
        [
            (0.5 * np.cos(a), 4.0 * r / (rings - 1), 0.5 * np.sin(a))
            for r in range(rings)
            for a in angles
        ]
    )
    faces = []
    for ring in range(rings - 1):
        for n in range(sides):
            a, b = ring * sides + n, ring * sides + (n + 1) % sides
            faces += [(a, a + sides, b), (b, a + sides, b + sides)]
    return points, faces


def weights_of(points):
    """Return joints and weights that fade from joint 0 below to joint 1 above."""
    above = np.clip((points[:, 1] - 1.0) / 2.0, 0.0, 1.0)
    return np.tile((0, 1), (len(points), 1)), np.stack([1.0 - above, above], axis=1)


def tube_mesh(**options):
    points, faces = tube()
    joints, weights = weights_of(points)
    normals, angle = points * (1, 0, 1), np.arctan2(points[:, 2], points[:, 0])
    tangents = np.stack([-points[:, 2], 0 * angle, points[:, 0], 1 + 0 * angle], axis=1)
    given = {
        "normals": normals, "uv": np.stack([angle, points[:, 1]], axis=1), "joints": joints,
        "weights": weights, "tangents": tangents,
    }  # fmt: skip
    return rj.Mesh(points, faces, **{**given, **options})


def bending(mesh=None, turn=60.0, at=(0.0, 0.0, 0.0)):
    """Return a scene of a tube on two joints, the upper one turned, and the joints."""
    scene = rj.Scene()
    lower = scene.add(rj.Node(None, translate(at), "lower"))
    upper = scene.add(rj.Node(None, translate((0, 2, 0)), "upper"), parent=lower)
    skin = rj.Skin([lower, upper], [translate(-np.array(p)) for p in ((0, 0, 0), (0, 2, 0))])
    node = rj.Node(tube_mesh() if mesh is None else mesh, translate((9, 9, 9)), "tube", skin=skin)
    scene.add(node)
    upper.transform = compose(translate((0, 2, 0)), rotate_z(turn))
    return scene, lower, upper


def by_hand(scene, number=0):
    """Return the vertices of a skinned object by the specification, world space."""
    node = scene.nodes[number]
    worlds = [joint.world_matrix.tolist() for joint in node.skin.joints]
    binds = node.skin.inverse_binds.tolist()
    mesh = node.mesh
    return np.array(
        [
            naive.moved(naive.blended(j, w, worlds, binds), point)
            for j, w, point in zip(mesh.joints, mesh.weights, mesh.vertices, strict=True)
        ]
    )


def plain(scene):
    """Return a scene of the posed meshes alone, made anew by hand."""
    made = copy.copy(scene)
    made.nodes = []
    posed = scene.posed()
    for number, node in enumerate(scene.nodes):
        shown, mesh = posed.nodes[number].mesh, node.mesh
        baked = rj.Mesh(
            by_hand(scene, number), mesh.faces, normals=shown.normals, uv=mesh.uv,
            tangents=shown.tangents, material=mesh.material,
        )  # fmt: skip
        made.nodes.append(rj.Node(baked, name=node.name))
    return made


@pytest.fixture(scope="module")
def bent():
    return bending()[0]


def assert_same(one, other, names=EVERY, tolerance=0.0):
    for name in names:
        first, second = getattr(one, name), getattr(other, name)
        if tolerance and first.dtype.kind == "f":
            np.testing.assert_allclose(first, second, atol=tolerance, err_msg=name)
        else:
            np.testing.assert_array_equal(first, second, err_msg=name)


# --- what is drawn --------------------------------------------------------------------------------


def test_every_output_is_that_of_the_posed_mesh(bent):
    outputs = [name for name in EVERY if name != "instance_id"]
    wanted = rj.render(plain(bent), size=SIZE, outputs=outputs)
    assert_same(rj.render(bent, size=SIZE, outputs=outputs), wanted, outputs)
    assert wanted.stats.pixels_covered > 300


@pytest.mark.parametrize("samples", [4, "area", 64])
def test_several_samples_show_it_too(bent, samples):
    quality = rj.Quality(samples=samples)
    pictures = [rj.render(one, size=SIZE, quality=quality).color for one in (bent, plain(bent))]
    np.testing.assert_array_equal(*pictures)


def test_normals_and_tangents_are_those_of_the_equations(bent):
    node = bent.nodes[0]
    posed = bent.posed().nodes[0].mesh
    worlds = [joint.world_matrix.tolist() for joint in node.skin.joints]
    for row in range(0, len(posed.vertices), 7):
        matrix = naive.blended(
            node.mesh.joints[row], node.mesh.weights[row], worlds, node.skin.inverse_binds.tolist()
        )
        normal = naive.moved_normal(matrix, node.mesh.normals[row])
        tangent = naive.moved_direction(matrix, node.mesh.tangents[row, :3])
        np.testing.assert_allclose(posed.normals[row], normal, atol=3e-7)
        np.testing.assert_allclose(posed.tangents[row], [*tangent, 1.0], atol=3e-7)


def test_bounds_and_cameras_fit_what_is_posed(bent):
    points = by_hand(bent)
    low, high = bent.bounds()
    np.testing.assert_array_equal((low, high), (points.min(axis=0), points.max(axis=0)))
    assert rj.fit_camera(bent) == rj.fit_camera(plain(bent))
    box = rj.BoundingBox(bent.nodes[0])
    np.testing.assert_allclose((box.vertices.min(axis=0), box.vertices.max(axis=0)), (low, high))
    center, radius = bent.bounding_sphere()
    assert np.linalg.norm(points - center, axis=1).max() == pytest.approx(radius)


def test_shadows_fall_from_what_is_posed(bent):
    lit = copy.copy(bent)
    lit.lights = [rj.DirectionalLight((-1, -1, -0.5), shadow=rj.Shadow())]
    floor = rj.Mesh([(-9, -2, -9), (9, -2, -9), (9, -2, 9), (-9, -2, 9)], [(0, 2, 1), (0, 3, 2)])
    flat, posed = plain(lit), copy.copy(lit)
    posed.nodes, flat.nodes = ([*one.nodes, rj.Node(floor)] for one in (lit, flat))
    camera = rj.PerspectiveCamera((4, 7, 14), (0, 1, 0))
    pictures = [rj.render(one, camera, size=SIZE) for one in (posed, flat)]
    np.testing.assert_array_equal(pictures[0].color, pictures[1].color)
    assert len(np.unique(pictures[0].color[..., 0])) > 8


@pytest.mark.parametrize("name", ["object_position", "nocs"])
def test_points_of_the_object_are_the_same_in_any_pose(name):
    thick = rj.MorphTargets([tube()[0] * (0.5, 0, 0.5)], weights=[1.0])
    scene = bending(tube_mesh(morph_targets=thick))[0]
    outputs = ("face_id", "barycentric", name)
    frame = rj.render(scene, size=SIZE, outputs=outputs)
    rest = scene.nodes[0].mesh
    seen = frame.face_id >= 0
    corners = rest.vertices[rest.faces[frame.face_id[seen]]]
    wanted = (corners * frame.barycentric[seen][:, :, None]).sum(axis=1)
    if name == "nocs":
        low, high = rest.bounds()
        wanted = (wanted - (low + high) / 2) / np.linalg.norm(high - low) + 0.5
    np.testing.assert_allclose(getattr(frame, name)[seen], wanted, atol=1e-5)
    camera = rj.fit_camera(scene)
    batch = rj.render_batch(scene, [camera], size=SIZE, outputs=(name,))
    np.testing.assert_array_equal(getattr(batch, name)[0], getattr(frame, name))


def test_a_picked_point_lies_on_the_posed_face(bent):
    frame = rj.render(bent, size=SIZE, outputs=("face_id", "barycentric", "position"))
    y, x = np.argwhere(frame.face_id >= 0)[40]
    pick = frame.pick(int(x), int(y))
    points = by_hand(bent)[bent.nodes[pick.node].mesh.faces[pick.face]]
    np.testing.assert_allclose(frame.barycentric[y, x] @ points, frame.position[y, x], atol=1e-5)


def test_a_pixel_is_explained_as_it_is_drawn(bent):
    frame = rj.render(bent, size=SIZE, outputs=("color", "face_id"))
    y, x = (int(n) for n in np.argwhere(frame.face_id >= 0)[60])
    said = str(rj.explain_pixel(bent, None, SIZE, x, y))
    assert said == str(rj.explain_pixel(plain(bent), None, SIZE, x, y))
    assert 'object 0 "tube"' in said


def test_plans_lenses_layers_and_measurements_see_the_pose(bent):
    flat = plain(bent)
    assert str(rj.explain(bent, size=SIZE)) == str(rj.explain(flat, size=SIZE))
    layers = [rj.render_layers(one, size=SIZE, k=2) for one in (bent, flat)]
    np.testing.assert_array_equal(layers[0].depth, layers[1].depth)
    lens = rj.PinholeDistortion(-0.2, 0.05)
    pictures = [rj.render(one, size=SIZE, lens=lens).color for one in (bent, flat)]
    np.testing.assert_array_equal(*pictures)
    assert rj.profile(bent, size=SIZE, rounds=1) is not None


def test_the_plan_tells_what_poses_it(bent):
    plans = [rj.explain(one, size=SIZE) for one in (bent, plain(bent))]
    kernels = [[row.name for row in planning.list_kernels(plan)] for plan in plans]
    assert kernels[0] == ["skinning.skin_vertices", *kernels[1]]


def test_faces_are_counted_as_they_are_posed(bent):
    counted = [rj.render(one, size=SIZE, diagnose=True).diagnostics for one in (bent, plain(bent))]
    assert str(counted[0]) == str(counted[1])


def test_threads_change_no_bit(bent):
    frames = [rj.render(bent, size=SIZE, outputs=EVERY, threads=n) for n in (1, 2)]
    assert_same(*frames)


def test_regions_have_the_bits_of_the_whole(bent):
    from rasterjit.pipeline.visibility.visibility_pass import Region
    from rasterjit.rendering.regions import RegionRenderer

    whole = rj.render(bent, size=SIZE).color
    with RegionRenderer(bent, size=SIZE) as renderer:
        part = renderer.render_region(Region(0, 0, 64, 48)).color
    np.testing.assert_array_equal(part, whole[:48, :64])


# --- poses that change ----------------------------------------------------------------------------


def test_moving_a_joint_changes_the_next_picture():
    scene, lower, upper = bending()
    camera = rj.fit_camera(scene)
    with rj.Renderer(SIZE) as renderer:
        for turn in (0.0, 30.0, -50.0):
            upper.transform = compose(translate((0, 2, 0)), rotate_z(turn))
            lower.transform = translate((0.1 * turn / 30.0, 0, 0))
            wanted = rj.render(plain(scene), camera, size=SIZE, outputs=EVERY[:6])
            frame = renderer.render(scene, camera, outputs=EVERY[:6])
            assert_same(frame, wanted, EVERY[:6])


def test_an_unchanged_pose_is_kept():
    scene, _lower, upper = bending()
    first, second = pose_scene(scene), pose_scene(scene)
    assert first.nodes[0] is second.nodes[0]
    cache = update_cache(first.nodes, None, rj.Quality.standard())
    assert update_cache(second.nodes, cache, rj.Quality.standard()).shapes is cache.shapes
    # The same place by another matrix is the same pose.
    upper.transform = upper.transform.copy()
    assert pose_scene(scene).nodes[0].mesh is first.nodes[0].mesh
    upper.transform = rotate_x(10)
    assert pose_scene(scene).nodes[0].mesh is not first.nodes[0].mesh


def test_a_material_that_is_assigned_is_seen():
    scene, *_ = bending()
    camera = rj.fit_camera(scene)
    with rj.Renderer(SIZE) as renderer:
        before = renderer.render(scene, camera).color
        scene.nodes[0].mesh.material = rj.Material("unlit", "red")
        after = renderer.render(scene, camera).color
    assert (after[after[..., 1] < 255] == (255, 0, 0, 255)).all()
    assert not np.array_equal(before, after)


def test_a_scene_at_a_time_is_a_copy():
    scene, _lower, upper = bending(turn=0.0)
    label = rj.Label((0, 0, 0), "top")
    upper.label = label
    swing = rj.Channel(upper, "rotation", [0, 1], [(0, 0, 0, 1), (0, 0, 1, 0)])
    scene.animations.append(rj.Animation("swing", [swing]))
    scene.fog = rj.Fog(density=0.1)
    scene.lights.append(rj.AmbientLight())
    before = by_hand(scene)
    later = scene.at(0.5)
    assert later.nodes[0].mesh is scene.nodes[0].mesh
    assert later.fog is scene.fog
    assert later.lights == scene.lights
    assert later.lights is not scene.lights
    assert later.find("upper") is not upper
    assert later.find("upper").label is label
    assert [one.label for one in later.labelled] == [label]
    assert later.nodes[0].skin.joints == (later.find("lower"), later.find("upper"))
    assert later.animations[0].channels[0].node is later.find("upper")
    np.testing.assert_array_equal(by_hand(scene), before)
    # A copy may be moved on, by its own animation and its own joints.
    np.testing.assert_allclose(by_hand(later.at(0.0)), before, atol=1e-15)
    later.find("lower").transform = translate((5, 0, 0))
    np.testing.assert_array_equal(by_hand(scene), before)
    assert later.remove(later.find("lower")) is None


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_copies_and_pickles_are_posed_alike(copied):
    scene, _lower, upper = bending()
    rj.render(scene, size=SIZE)
    upper.set_trs(scale=(1, 2, 1))
    swing = rj.Channel(upper, "translation", [0, 1], [(0, 2, 0), (0, 3, 0)])
    scene.animations.append(rj.Animation("swing", [swing]))
    other = copied(scene)
    np.testing.assert_array_equal(other.bounds(), scene.bounds())
    np.testing.assert_array_equal(by_hand(other), by_hand(scene))
    assert other.find("upper").trs == upper.trs
    np.testing.assert_array_equal(other.at(0.7).bounds(), scene.at(0.7).bounds())
    other.find("lower").transform = translate((4, 0, 0))
    np.testing.assert_allclose(other.bounds()[0] - scene.bounds()[0], (4, 0, 0), atol=1e-12)


def test_a_scene_that_is_added_to_another_brings_its_joints():
    scene, *_ = bending()
    swing = rj.Channel(scene.find("upper"), "translation", [0, 1], [(0, 2, 0), (0, 3, 0)])
    scene.animations.append(rj.Animation("swing", [swing]))
    both = rj.Scene()
    group = both.add(scene, translate((3, 0, 0)), "one")
    both.add(scene, translate((-3, 0, 0)), "two")
    np.testing.assert_allclose(by_hand(both, 0), by_hand(scene) + (3, 0, 0), atol=1e-12)
    np.testing.assert_allclose(by_hand(both, 1), by_hand(scene) - (3, 0, 0), atol=1e-12)
    assert len(both.animations) == 2
    later = both.at(1.0, 1)
    np.testing.assert_array_equal(by_hand(later, 0), by_hand(both, 0))
    assert not np.allclose(by_hand(later, 1), by_hand(both, 1))
    assert group.name == "one"


# --- motion ---------------------------------------------------------------------------------------


def test_motion_is_the_difference_of_the_vertices_on_the_screen():
    scene, lower, upper = bending(turn=0.0)
    swing = rj.Channel(upper, "rotation", [0, 1], [(0, 0, 0, 1), (0, 0, 0.6, 0.8)])
    shift = rj.Channel(lower, "translation", [0, 1], [(0, 0, 0), (0.5, 0.2, -1)])
    scene.animations.append(rj.Animation("swing", [swing, shift]))
    before, now = scene.at(0.55), scene.at(0.6)
    camera = rj.PerspectiveCamera((1, 3, 9), (0, 2, 0))
    frame = rj.render(
        now, camera, size=SIZE, outputs=("motion", "face_id", "barycentric", "motion_visible"),
        previous=rj.PreviousView(before),
    )  # fmt: skip
    seen = np.argwhere(frame.face_id >= 0)
    assert len(seen) > 200
    placed = [by_hand(one) for one in (now, before)]
    for y, x in seen[::9]:
        face = now.nodes[0].mesh.faces[frame.face_id[y, x]]
        weights = frame.barycentric[y, x].astype(np.float64)
        here, there = (camera.project(weights @ points[face], SIZE)[0] for points in placed)
        np.testing.assert_allclose(frame.motion[y, x], here - there, atol=2e-3)
    still = rj.render(
        now, camera, size=SIZE, outputs="motion", previous=rj.PreviousView(scene.at(0.6))
    )
    assert (still.motion[frame.face_id >= 0] == 0.0).all()


# --- many of them ---------------------------------------------------------------------------------


def test_instances_differ_by_skin_and_by_weights():
    points, _faces = tube()
    deltas = np.stack([points * (1, 0, 1), np.zeros_like(points)])
    mesh = tube_mesh(morph_targets=rj.MorphTargets(deltas, weights=[0.5, 0.0]))
    scene, *_ = bending(mesh)
    scene.add(rj.Node(mesh, translate((-4, 0, 0)), "thick", weights=[1.0, 0.0]))
    scene.add(rj.Node(mesh, translate((4, 0, 0)), "thin", weights=[-0.5, 0.0]))
    scene.add(rj.Node(mesh, translate((8, 0, 0)), "as it says"))
    posed = scene.posed()
    radii = [np.hypot(*one.mesh.vertices[:, [0, 2]].T).max() for one in posed.nodes[1:]]
    np.testing.assert_allclose(radii, (1.0, 0.25, 0.75))
    np.testing.assert_array_equal(posed.nodes[2].world_matrix, translate((4, 0, 0)))
    frame = rj.render(scene, size=(160, 60), outputs=("instance_id", "object_id"))
    assert set(np.unique(frame.instance_id)) == {-1, 0, 1, 2, 3}
    np.testing.assert_array_equal(frame.instance_id, frame.object_id)


def test_a_morphed_mesh_moves_without_being_morphed_anew():
    mesh = rj.Mesh(
        np.eye(3), [(0, 1, 2)], morph_targets=rj.MorphTargets([np.ones((3, 3))], weights=[2.0])
    )
    scene = rj.Scene()
    node = scene.add(mesh)
    first = scene.posed().nodes[0]
    node.transform = translate((1, 0, 0))
    second = scene.posed().nodes[0]
    assert second.mesh is first.mesh
    np.testing.assert_array_equal(scene.bounds(), ((3, 2, 2), (4, 3, 3)))
    np.testing.assert_array_equal(first.world_matrix, np.eye(4))
    np.testing.assert_array_equal(
        rj.render(mesh, size=SIZE).color, rj.render(scene, size=SIZE).color
    )


@pytest.mark.parametrize("at", [(0, 0, 0), (1e6, -2e6, 5e5)])
def test_batches_pose_once_and_move_what_is_posed(at):
    scene, *_ = bending(at=at)
    cameras = [rj.fit_camera(scene, rj.orbit_direction(a, 20)) for a in (0, 120)]
    batch = rj.render_batch(scene, cameras, size=SIZE, outputs=("color", "depth"))
    for number, camera in enumerate(cameras):
        frame = rj.render(scene, camera, size=SIZE, outputs=("color", "depth"))
        np.testing.assert_array_equal(batch.color[number], frame.color)
        np.testing.assert_array_equal(batch.depth[number], frame.depth)
    still = np.tile(np.eye(4), (2, 1, 1, 1))
    again = rj.render_batch(scene, cameras, size=SIZE, outputs=("color",), transforms=still)
    np.testing.assert_array_equal(again.color, batch.color)
    away = np.array([[np.eye(4)], [translate((1e9, 0, 0))]])
    gone = rj.render_batch(scene, cameras, size=SIZE, outputs=("face_id",), transforms=away)
    assert (gone.face_id[0] >= 0).any()
    assert not (gone.face_id[1] >= 0).any()


def test_streams_show_the_pose(bent):
    cameras = [rj.fit_camera(bent, rj.orbit_direction(a, 20)) for a in (0, 120)]
    for camera, frame in zip(cameras, rj.render_many(bent, cameras, size=SIZE), strict=True):
        np.testing.assert_array_equal(frame.color, rj.render(bent, camera, size=SIZE).color)


def test_far_from_the_origin_no_digit_is_lost():
    near, far = bending()[0], bending(at=(1 << 22, -(1 << 21), 1 << 20))[0]
    shift = np.array((1 << 22, -(1 << 21), 1 << 20), float)
    one = rj.PerspectiveCamera((1, 3, 9), (0, 2, 0))
    other = rj.PerspectiveCamera(np.add((1, 3, 9), shift), np.add((0, 2, 0), shift))
    frames = [
        rj.render(scene, camera, size=SIZE, outputs=("face_id", "depth"))
        for scene, camera in ((near, one), (far, other))
    ]
    assert np.mean(frames[0].face_id != frames[1].face_id) < 0.002
    seen = (frames[0].face_id >= 0) & (frames[0].face_id == frames[1].face_id)
    np.testing.assert_allclose(frames[0].depth[seen], frames[1].depth[seen], atol=1e-5)


@pytest.mark.parametrize(
    "mirrored", [scale((-1, 1, 1)), compose(rotate((1, 2, 3), 40), scale(-1.0))]
)
def test_what_its_joints_mirror_keeps_its_front(mirrored):
    mesh = tube_mesh(material=rj.Material("phong", double_sided=False))
    scene, lower, _upper = bending(mesh)
    lower.transform = mirrored
    flat = rj.Scene()
    flat.add(
        rj.Mesh(
            bending()[0].posed().nodes[0].mesh.vertices,
            mesh.faces,
            normals=bending()[0].posed().nodes[0].mesh.normals,
            material=mesh.material,
        ),
        mirrored,
    )
    camera = rj.fit_camera(flat)
    one, other = (
        rj.render(s, camera, size=SIZE, outputs=("face_id", "normal", "color"))
        for s in (scene, flat)
    )
    assert np.mean(one.face_id != other.face_id) < 0.002
    np.testing.assert_allclose(one.normal, other.normal, atol=1e-4)
    assert (one.face_id >= 0).sum() > 300


def test_what_is_not_finite_is_left_out():
    scene, lower, upper = bending(turn=0.0)
    lower.transform = scale(1e200)
    scene.nodes[0].skin = rj.Skin([lower, upper], [np.diag([1e300, 1e300, 1e300, 1.0])] * 2)
    posed = scene.posed().nodes[0].mesh
    assert posed.invalid_vertices > 0
    camera = rj.PerspectiveCamera((0, 0, 9), (0, 0, 0))
    with pytest.warns(rj.ViewWarning):
        frame = rj.render(scene, camera, size=SIZE, outputs=("face_id", "normal"))
    assert (frame.face_id == -1).all()


# --- the kernel -----------------------------------------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 5))
def test_the_kernel_has_the_bits_of_numpy(seed, columns, joints):
    random = np.random.default_rng(seed)
    count = 17
    matrices = np.tile(np.eye(4), (joints, 1, 1))
    matrices[:, :3] = random.normal(size=(joints, 3, 4)) * 10.0 ** random.integers(-3, 3)
    numbers = random.integers(0, joints, (count, columns)).astype(np.int32)
    shares = random.random((count, columns)) * (random.random((count, columns)) > 0.3)
    points = random.normal(size=(count, 3))
    moved = points.copy()
    none = np.empty((0, 3), np.float32), np.empty((0, 4), np.float32)
    # In two calls, as two threads would.
    for rows in ((0, 5), (5, count)):
        skinning.skin_vertices(rows, matrices, numbers, shares, moved, *none)
    total = np.zeros((count, 3, 4))
    for k in range(columns):
        total = total + shares[:, k, None, None] * matrices[numbers[:, k], :3]
    x, y, z = points.T
    wanted = ((total[..., 0].T * x + total[..., 1].T * y) + total[..., 2].T * z) + total[..., 3].T
    np.testing.assert_array_equal(moved, wanted.T)


def test_scenes_that_nothing_poses_are_not_touched():
    mesh = rj.Mesh(np.eye(3), [(0, 1, 2)])
    scene = rj.Scene()
    scene.add(mesh)
    assert pose_scene(scene) is scene
    assert scene.posed() is scene
    # A skin's mesh without a skin, targets of no weight.
    scene.add(tube_mesh(morph_targets=rj.MorphTargets(np.ones((1, 108, 3)))))
    assert pose_scene(scene) is scene


def test_what_a_mesh_carries_stays(bent):
    points, faces = tube()
    random = np.random.default_rng(2)
    heat = random.random(len(points))
    mesh = tube_mesh(
        colors=random.random((len(points), 3)),
        attributes={"heat": heat[:, None], "f": random.random((len(faces), 2))},
    )
    for one in (mesh, mesh.with_scalars("heat", contours=3), mesh.split_creases(30.0)):
        scene, *_ = bending(one)
        posed = scene.posed().nodes[0].mesh
        assert posed.material is one.material
        assert posed.field is one.field
        assert posed.vertex_attributes["heat"] is one.vertex_attributes["heat"] or np.array_equal(
            posed.vertex_attributes["heat"], one.vertex_attributes["heat"]
        )
        np.testing.assert_array_equal(posed.uv, one.uv)
        np.testing.assert_array_equal(posed.face_attributes["f"], one.face_attributes["f"])
        np.testing.assert_array_equal(posed.faces, one.faces)
        np.testing.assert_allclose(posed.vertices, by_hand(scene), atol=1e-13)
