"""Scripts that were written for pyrender run with the import changed, and mean the same."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
import trimesh

import rasterjit
from rasterjit.compat.pyrender import camera as cameras
from rasterjit.compat.pyrender import light as lights
from rasterjit.compat.pyrender import material as materials
from rasterjit.compat.pyrender import mesh as meshes
from rasterjit.compat.pyrender import node as node_module
from rasterjit.compat.pyrender import offscreen
from rasterjit.compat.pyrender import scene as pyrender
from rasterjit.compat.pyrender.constants import RenderFlags
from rasterjit.compat.pyrender.conversion import convert_scene

W, H = 48, 36

SCRIPT = """
import os
import numpy as np
import trimesh

from {module} import (
    DirectionalLight, GLTF, Mesh, MetallicRoughnessMaterial, Node, OffscreenRenderer,
    PerspectiveCamera, PointLight, Primitive, RenderFlags, Scene, SpotLight, Viewer,
)

# A mesh from a file, moved up to stand on the floor.
solid = trimesh.load("models/torus_knot.obj", process=False)
solid.apply_scale(0.04 / solid.scale)
solid_mesh = Mesh.from_trimesh(solid)
# Colours of vertices and of faces.
corners = trimesh.creation.box(extents=0.1 * np.ones(3))
corners.visual.vertex_colors = np.random.uniform(size=corners.vertices.shape)
corners_mesh = Mesh.from_trimesh(corners, smooth=False)
sides = trimesh.creation.box(extents=0.1 * np.ones(3))
sides.visual.face_colors = np.random.uniform(size=sides.faces.shape)
sides_mesh = Mesh.from_trimesh(sides, smooth=False)
# A cloud of points.
cloud = trimesh.creation.icosphere(radius=0.05).vertices
cloud_mesh = Mesh.from_points(cloud, colors=np.random.uniform(size=cloud.shape))

sun = DirectionalLight(color=np.ones(3), intensity=1.0)
spot = SpotLight(color=np.ones(3), intensity=10.0, innerConeAngle=np.pi / 16,
                 outerConeAngle=np.pi / 6)
bulb = PointLight(color=np.ones(3), intensity=10.0)
camera = PerspectiveCamera(yfov=np.pi / 3.0)
half = np.sqrt(2) / 2
camera_pose = np.array([
    [0.0, -half, half, 0.5], [1.0, 0.0, 0.0, 0.0], [0.0, half, half, 0.4], [0.0, 0.0, 0.0, 1.0],
])

scene = Scene(ambient_light=np.array([0.02, 0.02, 0.02]))
solid_node = Node(mesh=solid_mesh, translation=np.array([0.1, 0.15, -np.min(solid.vertices[:, 2])]))
scene.add_node(solid_node)
scene.add_node(Node(mesh=corners_mesh, translation=np.array([-0.1, 0.10, 0.05])))
scene.add_node(Node(mesh=sides_mesh, translation=np.array([-0.1, -0.10, 0.05])))
cloud_node = scene.add(cloud_mesh, pose=np.eye(4))
sun_node = scene.add(sun, pose=camera_pose)
spot_node = scene.add(spot, pose=camera_pose)
camera_node = scene.add(camera, pose=camera_pose)

r = OffscreenRenderer(viewport_width=64, viewport_height=48)
color, depth = r.render(scene)
r.delete()
assert color.shape == (48, 64, 3) and color.dtype == np.uint8
assert depth.shape == (48, 64) and depth.dtype == np.float32
assert 0.05 < (depth > 0).mean() < 0.9
assert len(np.unique(color[depth > 0], axis=0)) > 50
assert (color[depth == 0] == 255).all(axis=1).mean() > 0.8
print("drawn")
"""


def test_the_calls_of_its_readme_run_with_the_import_changed():
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SCRIPT.format(module="rasterjit.compat.pyrender")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout.strip()) == (0, "drawn"), done.stderr


def at(x=0.0, y=0.0, z=0.0):
    return rasterjit.transforms.translate((x, y, z))


def box_scene(**options):
    """A unit box before a camera at z = 3."""
    scene = pyrender.Scene(**options)
    node = scene.add(meshes.Mesh.from_trimesh(trimesh.creation.box()), name="box")
    scene.add(cameras.PerspectiveCamera(yfov=math.pi / 3, aspectRatio=W / H), pose=at(z=3))
    return scene, node


@pytest.fixture
def renderer():
    made = offscreen.OffscreenRenderer(W, H)
    yield made
    made.delete()


def test_depth_is_along_the_axis_and_zero_where_nothing_is(renderer):
    scene, _ = box_scene()
    _, depth = renderer.render(scene)
    assert depth[H // 2, W // 2] == pytest.approx(2.5)
    assert depth[0, 0] == 0.0
    # The front face alone: half its side over the tangent, of the height.
    side = 0.5 / 2.5 / math.tan(math.pi / 6) * H
    assert (depth > 0).sum() == pytest.approx(side * side, rel=0.1)
    alone = renderer.render(scene, flags=RenderFlags.DEPTH_ONLY)
    np.testing.assert_array_equal(alone, depth)


def test_a_matt_white_surface_that_faces_a_light_of_pi_is_nearly_white(renderer):
    white = materials.MetallicRoughnessMaterial(metallicFactor=0.0, roughnessFactor=1.0)
    scene = pyrender.Scene()
    scene.add(meshes.Mesh.from_trimesh(trimesh.creation.box(), material=white))
    scene.add(cameras.OrthographicCamera(0.4, 0.4), pose=at(z=3))
    light = scene.add(lights.DirectionalLight(intensity=math.pi), pose=at(z=3))
    color, _ = renderer.render(scene)
    assert color[H // 2, W // 2].min() > 240
    light.light.intensity = math.pi / 4
    # A quarter of the light: its sRGB code is 137.
    assert abs(int(renderer.render(scene)[0][H // 2, W // 2, 0]) - 137) < 10


def test_without_any_light_all_is_black(renderer):
    scene, _ = box_scene()
    color, depth = renderer.render(scene)
    assert not color[H // 2, W // 2].any()
    assert (color[depth == 0][:5] == 255).all()


def test_background_is_shown_as_given(renderer):
    scene, _ = box_scene(bg_color=[51, 102, 0, 0])
    color, _ = renderer.render(scene, RenderFlags.RGBA)
    assert color.shape == (H, W, 4)
    assert color[0, 0, 3] == 0
    assert color[H // 2, W // 2, 3] == 255
    color, _ = renderer.render(scene)
    assert color[0, 0].tolist() == [51, 102, 0]
    scene.bg_color = [0.2, 0.4, 0.0]
    assert renderer.render(scene)[0][0, 0].tolist() == [51, 102, 0]


def test_flat_shows_colours_as_they_are(renderer):
    scene = pyrender.Scene()
    # What glows does so under lights alone.
    material = materials.MetallicRoughnessMaterial(
        baseColorFactor=[0.2, 0.4, 0.6, 1.0], emissiveFactor=[0.5, 0.5, 0.5]
    )
    scene.add(meshes.Mesh.from_trimesh(trimesh.creation.box(), material=material))
    scene.add(cameras.PerspectiveCamera(1.0), pose=at(z=3))
    color, _ = renderer.render(scene, RenderFlags.FLAT)
    assert color[H // 2, W // 2].tolist() == [51, 102, 153]


def test_segmentation_has_the_colours_of_the_map_and_no_others(renderer):
    scene, box = box_scene()
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    first = scene.add(meshes.Mesh.from_trimesh(ball), pose=at(-1.0))
    scene.add(meshes.Mesh.from_trimesh(ball), pose=at(1.0))
    color, depth = renderer.render(scene, RenderFlags.SEG, {box: (255, 10, 0), first: 7})
    found = {tuple(row) for row in color.reshape(-1, 3).tolist()}
    assert found == {(0, 0, 0), (255, 10, 0), (7, 7, 7)}
    assert color[H // 2, W // 2].tolist() == [255, 10, 0]
    assert ((depth > 0) == color.any(axis=2)).all()
    assert color[:, W // 2 :].reshape(-1, 3)[:, 0].tolist().count(7) == 0


def test_back_faces_are_left_out_unless_somebody_asks(renderer):
    quad = trimesh.Trimesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 2, 1], [0, 3, 2]])
    scene = pyrender.Scene(ambient_light=[1.0, 1.0, 1.0])
    mesh = meshes.Mesh.from_trimesh(quad)
    scene.add(mesh)
    scene.add(cameras.PerspectiveCamera(1.0), pose=at(z=3))
    assert not renderer.render(scene)[1].any()
    assert renderer.render(scene, RenderFlags.SKIP_CULL_FACES)[1].any()
    mesh.primitives[0].material.doubleSided = True
    assert renderer.render(scene)[1].any()


def test_points_are_squares_of_their_size(renderer):
    scene = pyrender.Scene()
    # Two points that project onto the middles of pixels.
    camera = cameras.IntrinsicsCamera(40.0, 40.0, W / 2, H / 2)
    places = np.array([[0.5, 0.5, -40.0], [10.5, -3.5, -40.0], [0.0, 0.0, 5.0]])
    points = scene.add(
        meshes.Mesh.from_points(places, colors=[[1.0, 0, 0], [0, 1.0, 0], [1, 1, 1]])
    )
    scene.add(camera)
    color, depth = renderer.render(scene, RenderFlags.FLAT)
    assert np.argwhere(depth > 0).tolist() == [[H // 2 - 1, W // 2], [H // 2 + 3, W // 2 + 10]]
    assert depth.max() == pytest.approx(40.0)
    renderer.point_size = 3.0
    _, depth = renderer.render(scene, RenderFlags.FLAT)
    assert (depth > 0).sum() == 18
    assert (depth[H // 2 - 2 : H // 2 + 1, W // 2 - 1 : W // 2 + 2] > 0).all()
    color, _ = renderer.render(scene, RenderFlags.SEG, {points: 9})
    assert (color == 9).all(axis=2).sum() == 18


def test_transparent_surfaces_have_a_depth(renderer):
    scene, _ = box_scene(ambient_light=[1.0, 1.0, 1.0])
    glass = materials.MetallicRoughnessMaterial(
        baseColorFactor=[1.0, 0.0, 0.0, 0.5], alphaMode="BLEND", metallicFactor=0.0
    )
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.2)
    scene.add(meshes.Mesh.from_trimesh(ball, material=glass), pose=at(z=1.0))
    color, depth = renderer.render(scene)
    assert depth[H // 2, W // 2] < 2.0
    red, green, _ = color[H // 2, W // 2].tolist()
    assert red > green > 0


def test_wireframes_leave_the_background_between_edges(renderer):
    scene, box = box_scene(ambient_light=[1.0, 1.0, 1.0])
    scene.set_pose(box, at(z=1.4))
    solid, _ = renderer.render(scene)
    lines, _ = renderer.render(scene, RenderFlags.ALL_WIREFRAME)
    drawn = (lines != 255).any(axis=2)
    assert 0 < drawn.sum() < (solid != 255).any(axis=2).sum() / 2
    again, _ = renderer.render(scene, RenderFlags.FLIP_WIREFRAME)
    np.testing.assert_array_equal(again, lines)
    np.testing.assert_array_equal(renderer.render(scene, RenderFlags.ALL_SOLID)[0], solid)


def test_nodes_stand_below_their_parents(renderer):
    scene = pyrender.Scene()
    parent = scene.add_node(node_module.Node(name="arm", translation=[1.0, 0.0, 0.0]))
    assert parent is None
    (arm,) = scene.get_nodes(name="arm")
    hand = scene.add(
        meshes.Mesh.from_trimesh(trimesh.creation.box()), pose=at(y=2.0), parent_name="arm"
    )
    assert hand in arm.children
    np.testing.assert_array_equal(scene.get_pose(hand), at(1.0, 2.0))
    scene.set_pose(arm, at(z=-4.0))
    np.testing.assert_array_equal(scene.get_pose(hand), at(0.0, 2.0, -4.0))
    np.testing.assert_allclose(scene.bounds, [[-0.5, 1.5, -4.5], [0.5, 2.5, -3.5]])
    np.testing.assert_allclose(scene.centroid, [0.0, 2.0, -4.0])
    assert scene.scale == pytest.approx(math.sqrt(3.0))
    scene.remove_node(arm)
    assert not scene.has_node(hand)
    assert scene.nodes == set()


def test_a_refused_rotation_moves_nothing():
    pose = np.array([[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], float)
    node = node_module.Node(matrix=pose)
    for wrong in ([0, 0, 0, 2], [0, 0, 1], "x"):
        with pytest.raises(ValueError, match="rotation"):
            node.rotation = wrong
    assert (node.matrix == pose).all()


def test_rotation_scale_and_translation_make_the_matrix():
    half = math.sqrt(0.5)
    node = node_module.Node(rotation=[0, 0, half, half], scale=[2, 3, 4], translation=[1, 2, 3])
    expected = at(1, 2, 3) @ rasterjit.transforms.rotate_z(90.0) @ np.diag([2, 3, 4, 1])
    np.testing.assert_allclose(node.matrix, expected, atol=1e-12)


def test_instances_stand_at_their_poses():
    scene, _ = box_scene()
    poses = np.stack([at(1.0), at(-1.0)])
    mesh = meshes.Mesh.from_trimesh(trimesh.creation.box(), poses=poses)
    scene.add(mesh, pose=at(y=2.0))
    drawing = convert_scene(scene, RenderFlags.NONE)
    places = [node.world_from_model[:3, 3].tolist() for node in drawing.scene.nodes]
    assert places == [[0, 0, 0], [1, 2, 0], [-1, 2, 0]]
    mesh.is_visible = False
    assert len(convert_scene(scene, RenderFlags.NONE).owners) == 1


def test_cameras_have_the_projections_of_their_arguments():
    perspective = cameras.PerspectiveCamera(yfov=math.pi / 2, znear=1.0, zfar=3.0)
    np.testing.assert_allclose(
        perspective.get_projection_matrix(200, 100),
        [[0.5, 0, 0, 0], [0, 1, 0, 0], [0, 0, -2, -3], [0, 0, -1, 0]],
        atol=1e-12,
    )
    parallel = cameras.OrthographicCamera(xmag=9.0, ymag=2.0, znear=1.0, zfar=3.0)
    np.testing.assert_allclose(
        parallel.get_projection_matrix(200, 100),
        [[0.25, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, -1, -2], [0, 0, 0, 1]],
    )
    pinhole = cameras.IntrinsicsCamera(50.0, 60.0, 30.0, 20.0, znear=1.0, zfar=3.0)
    np.testing.assert_allclose(
        pinhole.get_projection_matrix(80, 60),
        [[1.25, 0, 0.25, 0], [0, 2, -1 / 3, 0], [0, 0, -2, -3], [0, 0, -1, 0]],
    )


def test_shadows_darken_what_lies_behind(renderer):
    scene = pyrender.Scene()
    floor = trimesh.creation.box((6, 0.1, 6))
    scene.add(meshes.Mesh.from_trimesh(floor))
    scene.add(meshes.Mesh.from_trimesh(trimesh.creation.box()), pose=at(y=1.5))
    turn = rasterjit.transforms.rotate_x(-90.0)
    scene.add(lights.DirectionalLight(intensity=3.0), pose=turn)
    scene.add(
        cameras.OrthographicCamera(3.0, 3.0), pose=at(y=3) @ rasterjit.transforms.rotate_x(-70.0)
    )
    plain = renderer.render(scene)[0].astype(int)
    shadowed = renderer.render(scene, RenderFlags.SHADOWS_DIRECTIONAL)[0].astype(int)
    darker = (plain - shadowed).max(axis=2) > 30
    assert 5 < darker.sum() < plain.shape[0] * plain.shape[1] / 3


def test_textures_are_laid_over_a_trimesh(renderer):
    from PIL import Image

    picture = Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]]] * 2, np.uint8))
    quad = trimesh.Trimesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    for material in (
        trimesh.visual.material.SimpleMaterial(image=picture, diffuse=[255, 255, 255, 255]),
        trimesh.visual.material.PBRMaterial(baseColorTexture=picture, metallicFactor=0.0),
    ):
        quad.visual = trimesh.visual.TextureVisuals(
            uv=[[0, 0], [1, 0], [1, 1], [0, 1]], material=material
        )
        scene = pyrender.Scene()
        scene.add(meshes.Mesh.from_trimesh(quad))
        scene.add(cameras.PerspectiveCamera(1.0), pose=at(z=2.5))
        color, _ = renderer.render(scene, RenderFlags.FLAT)
        left, right = color[H // 2, W // 2 - 6].tolist(), color[H // 2, W // 2 + 6].tolist()
        assert left[0] > 200 > 100 > left[1]
        assert right[1] > 200 > 100 > right[0]


def test_smooth_normals_are_those_of_trimesh_and_need_no_scipy(monkeypatch):
    given = trimesh.load("models/torus_knot.obj", process=False)
    knot = trimesh.Trimesh(given.vertices, given.faces, process=False)
    loose = trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [9, 9, 9]], [[0, 1, 2], [0, 1, 3], [2, 3, 1]],
        process=False,
    )  # fmt: skip
    meant = [np.array(mesh.copy(True).vertex_normals) for mesh in (knot, given, loose)]

    def refuse(*args, **options):
        raise AssertionError("trimesh averages normals by SciPy, which may be missing")

    monkeypatch.setattr("trimesh.geometry.weighted_vertex_normals", refuse)
    for mesh, normals in zip((knot, given, loose), meant, strict=True):
        made = meshes.Mesh.from_trimesh(mesh).primitives[0].normals
        np.testing.assert_allclose(made, normals, rtol=0.0, atol=1e-7)
    assert not meshes.Mesh.from_trimesh(loose).primitives[0].normals[4].any()
    assert not len(meshes.Mesh.from_trimesh(trimesh.Trimesh()).primitives[0].positions)


def test_a_trimesh_scene_is_taken():
    given = trimesh.Scene()
    given.add_geometry(trimesh.creation.box(), transform=at(1.0))
    given.add_geometry(trimesh.creation.icosphere(), transform=at(-1.0))
    scene = pyrender.Scene.from_trimesh_scene(given, bg_color=[0, 0, 0])
    assert len(scene.mesh_nodes) == 2
    np.testing.assert_allclose(scene.bounds, given.bounds)
    assert scene.bg_color.tolist() == [0, 0, 0, 1]


def test_second_drawing_leaves_the_first_as_it_is():
    scene, box = box_scene()
    first = convert_scene(scene, RenderFlags.NONE).scene.nodes[0].mesh
    look = first.material
    assert convert_scene(scene, RenderFlags.NONE).scene.nodes[0].mesh is first
    box.mesh.primitives[0].material.baseColorFactor = [1.0, 0.0, 0.0, 1.0]
    second = convert_scene(scene, RenderFlags.NONE).scene.nodes[0].mesh
    assert first.material is look
    assert second.material.base_color[:3] == (1.0, 0.0, 0.0)
    assert np.shares_memory(second.vertices, first.vertices)


def test_objects_of_one_look_share_it_and_one_that_cannot_be_placed_is_left_out():
    scene, box = box_scene()
    twin = scene.add(meshes.Mesh.from_trimesh(trimesh.creation.box(), smooth=False))
    twin.mesh.primitives[0].material = box.mesh.primitives[0].material
    lost = scene.add(meshes.Mesh.from_trimesh(trimesh.creation.box()))
    scene.set_pose(lost, np.full((4, 4), np.nan))
    first, second = (
        node.mesh.material for node in convert_scene(scene, RenderFlags.NONE).scene.nodes
    )
    assert first is second


@pytest.mark.parametrize(
    ("call", "error", "named"),
    [
        (lambda: cameras.PerspectiveCamera(0.0), ValueError, "yfov"),
        (lambda: cameras.PerspectiveCamera(1.0, znear=1.0, zfar=0.5), ValueError, "zfar"),
        (lambda: cameras.OrthographicCamera(1.0, -1.0), ValueError, "ymag"),
        (lambda: lights.SpotLight(outerConeAngle=2.0), ValueError, "outerConeAngle"),
        (lambda: lights.SpotLight(innerConeAngle=1.0), ValueError, "innerConeAngle"),
        (lambda: materials.MetallicRoughnessMaterial(metallicFactor=2.0), ValueError, "metallic"),
        (lambda: materials.MetallicRoughnessMaterial(alphaMode="x"), ValueError, "alphaMode"),
        (lambda: meshes.Mesh.from_trimesh("a"), TypeError, "mesh"),
        (lambda: node_module.Node(matrix=np.zeros((4, 4))), ValueError, "matrix"),
        (lambda: pyrender.Scene().add("a"), TypeError, "obj"),
        (lambda: pyrender.Scene().get_pose(node_module.Node()), ValueError, "node"),
        (lambda: offscreen.OffscreenRenderer(0, 4).render(box_scene()[0]), ValueError,
         "viewport_width"),
        (lambda: offscreen.OffscreenRenderer(4, 4).render(pyrender.Scene()), ValueError, "camera"),
        (lambda: offscreen.OffscreenRenderer(4, 4).render(7), ValueError, "scene"),
        (lambda: offscreen.OffscreenRenderer(4, 4).render(box_scene()[0], "x"), ValueError, "flag"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_named(call, error, named):
    with pytest.raises(error, match=named):
        call()


def test_an_empty_scene_is_its_background(renderer):
    scene = pyrender.Scene(bg_color=[255, 0, 0])
    scene.add(cameras.PerspectiveCamera(1.0))
    color, depth = renderer.render(scene)
    assert (color == (255, 0, 0)).all()
    assert not depth.any()
    assert not renderer.render(scene, RenderFlags.SEG)[0].any()
