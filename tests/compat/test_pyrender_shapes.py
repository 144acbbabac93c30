"""What covers a pixel, at which depth: edges, lines, points and turned faces lie as in pyrender."""

from __future__ import annotations

import math

import numpy as np
import pyrender_shapes
import pytest
import trimesh

import rasterjit.compat.pyrender as pyrender
from rasterjit.compat.pyrender import conversion
from rasterjit.compat.pyrender.constants import GLTF, RenderFlags
from rasterjit.compat.pyrender.conversion import convert_scene

W, H = 40, 30
SAMPLES = ((0.375, 0.875), (0.875, 0.625), (0.125, 0.375), (0.625, 0.125))
"""Where Mesa's four samples lie in a pixel, from its upper left corner."""


@pytest.fixture
def renderer():
    made = pyrender.OffscreenRenderer(W, H)
    yield made
    made.delete()


def test_shapes_are_those_that_pyrender_draws():
    record = pyrender_shapes.recorded()
    drawn = {f"{name}: {words}": arrays for name, words, arrays in
             pyrender_shapes.pictures(pyrender)}  # fmt: skip
    assert drawn.keys() == record.keys()
    for key, (*colors, depth) in record.items():
        *own_colors, own = drawn[key]
        assert [one.shape for one in (*colors, depth)] == [one.shape for one in drawn[key]], key
        # Without several samples lines are steps of whole pixels there.
        is_line = key.partition(":")[0] in ("lines", "loop", "strip")
        is_aliased = is_line and "SEG" in key
        assert ((depth > 0) != (own > 0)).sum() <= 2, key
        seen = (depth > 0) & (own > 0)
        error = np.abs(depth - own)[seen] / depth[seen]
        assert np.median(error) < (5e-3 if is_aliased else 7e-6), key
        assert is_aliased or (error > 2e-5).sum() <= 7, key
        for there, here in zip(colors, own_colors, strict=True):
            steps = np.abs(there.astype(int) - here)
            assert (steps[..., 3:] > 3).sum() <= 2, key
            # Colours that change along a line are those half a pixel on there.
            has_lines = is_line or "WIREFRAME" in key or key.startswith("mixed")
            assert np.quantile(steps, 0.98) <= (16 if has_lines else 1), key


def plane_scene(camera=None, **options):
    """A triangle that is not upright, and its plane: depth is 4 + x / 2 - y / 3 in camera space."""
    scene = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 0.0])
    places = np.array([[-1.4, -1.0], [1.5, -0.7], [0.1, 1.3]])
    places = np.column_stack([places, -(4.0 + places[:, 0] / 2.0 - places[:, 1] / 3.0)])
    material = pyrender.MetallicRoughnessMaterial(baseColorFactor=[1.0, 1.0, 1.0, 1.0], **options)
    scene.add(pyrender.Mesh([pyrender.Primitive(places, material=material)]))
    scene.add(camera or pyrender.IntrinsicsCamera(30.0, 30.0, W / 2, H / 2))
    return scene, places


def sampled(places, at):
    """Return whether a triangle covers a place of each pixel, and its depth there."""
    columns, rows = np.meshgrid(np.arange(W) + at[0], np.arange(H) + at[1])
    right, up = (columns - W / 2) / 30.0, (H / 2 - rows) / 30.0
    depth = 4.0 / (1.0 - right / 2.0 + up / 3.0)
    corners = places[:, :2] / -places[:, 2:]
    inside = np.ones((H, W), bool)
    for k in range(3):
        (ax, ay), (bx, by) = corners[k], corners[(k + 1) % 3]
        inside &= (bx - ax) * (up - ay) - (by - ay) * (right - ax) > 0.0
    return inside, depth


def test_alpha_counts_the_samples_that_are_covered(renderer):
    scene, places = plane_scene()
    color, _ = renderer.render(scene, RenderFlags.FLAT | RenderFlags.RGBA)
    count = sum(sampled(places, at)[0].astype(int) for at in SAMPLES)
    assert {1, 2, 3} <= set(np.unique(count))
    np.testing.assert_array_equal(color[..., 3], np.floor(count * 255 / 4 + 0.5))
    np.testing.assert_array_equal(color[..., 0], color[..., 3])
    np.testing.assert_array_equal(renderer.render(scene, RenderFlags.FLAT)[0], color[..., :3])


@pytest.mark.parametrize("flags", [RenderFlags.NONE, RenderFlags.FLAT, RenderFlags.DEPTH_ONLY])
def test_depth_is_that_of_the_first_sample(renderer, flags):
    scene, places = plane_scene()
    depth = renderer.render(scene, flags)
    depth = depth if flags == RenderFlags.DEPTH_ONLY else depth[1]
    inside, expected = sampled(places, SAMPLES[0])
    np.testing.assert_allclose(depth, np.where(inside, expected, 0.0), rtol=2e-6)


def test_segments_are_seen_at_the_centres_of_pixels(renderer):
    scene, places = plane_scene()
    (node,) = scene.mesh_nodes
    color, depth = renderer.render(scene, RenderFlags.SEG, {node: (1, 2, 3)})
    inside, expected = sampled(places, (0.5, 0.5))
    np.testing.assert_array_equal((color == (1, 2, 3)).all(axis=2), inside)
    np.testing.assert_allclose(depth, np.where(inside, expected, 0.0), rtol=2e-6)
    color, _ = renderer.render(scene, RenderFlags.SEG | RenderFlags.RGBA, {node: (1, 2, 3)})
    assert color.shape == (H, W, 4)
    assert (color[..., 3] == 255).all()


def test_transparent_surfaces_are_seen_in_the_depth(renderer):
    scene, places = plane_scene(alphaMode="BLEND")
    (node,) = scene.mesh_nodes
    node.mesh.primitives[0].material.baseColorFactor = [1.0, 1.0, 1.0, 0.5]
    _, depth = renderer.render(scene)
    inside, expected = sampled(places, SAMPLES[0])
    np.testing.assert_allclose(depth, np.where(inside, expected, 0.0), rtol=2e-6)


@pytest.mark.parametrize("flags", [RenderFlags.SEG, RenderFlags.DEPTH_ONLY])
def test_depth_and_segments_are_culled_whatever_materials_say(renderer, flags):
    scene, _ = plane_scene(doubleSided=True)
    (node,) = scene.mesh_nodes
    node.mesh.primitives[0].indices = [0, 2, 1]
    flags |= RenderFlags.SKIP_CULL_FACES
    drawn = renderer.render(scene, flags, {node: 9})
    assert not np.any(drawn[0] if flags & RenderFlags.SEG else drawn)
    assert renderer.render(scene)[1].any()


class Weak(pyrender.Camera):
    def get_projection_matrix(self, width=None, height=None):
        return np.diag([0.5, 0.5, -1.0, 1.0])


def test_depth_of_other_projections_is_that_of_pinholes_of_their_planes(renderer):
    near, far = 0.5, 40.0
    for camera, ndc in (
        (Weak(near, far), lambda z: -z),
        (pyrender.OrthographicCamera(2.0, 2.0, near, far),
         lambda z: (-2.0 * z - far - near) / (far - near)),
    ):  # fmt: skip
        for z in (-0.9, -0.6):
            scene = pyrender.Scene()
            quad = trimesh.creation.box((4.0, 4.0, 0.0001))
            pose = np.eye(4)
            pose[2, 3] = z
            scene.add(pyrender.Mesh.from_trimesh(quad), pose=pose)
            scene.add(camera)
            _, depth = renderer.render(scene)
            expected = 2.0 * near * far / (far + near - ndc(z + 0.00005) * (far - near))
            assert expected > 0.0
            assert depth[H // 2, W // 2] == pytest.approx(expected, rel=1e-4)
    pinhole = pyrender.PerspectiveCamera(1.0, near, far)
    pinhole.znear = 0.2
    scene = plane_scene(pinhole)[0]
    assert renderer.render(scene)[1].max() > 3.0


def box_scene(wireframe, pose=None):
    scene = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 0.0], ambient_light=[1.0, 1.0, 1.0])
    material = pyrender.MetallicRoughnessMaterial(baseColorFactor=[1.0, 0.5, 0.2, 1.0])
    mesh = pyrender.Mesh.from_trimesh(
        trimesh.creation.box(), material=material, wireframe=wireframe
    )
    node = scene.add(mesh, pose=np.eye(4) if pose is None else pose)
    eye = np.eye(4)
    eye[2, 3] = 2.4
    scene.add(pyrender.PerspectiveCamera(yfov=0.9), pose=eye)
    return scene, node


def test_one_mesh_of_edges_stands_among_solid_ones(renderer):
    scene, _ = box_scene(True)
    wires_alone, edges = renderer.render(scene)
    assert 0 < (edges > 0).sum() < 150
    behind = np.eye(4)
    behind[2, 3] = -2.0
    solid = box_scene(False)[0].mesh_nodes.pop().mesh
    scene.add(solid, pose=behind @ np.diag([3.0, 3.0, 1.0, 1.0]))
    color, depth = renderer.render(scene)
    # Between its edges, and at them, where they are nearer.
    assert depth[H // 2, W // 2 + 3] == pytest.approx(3.9)
    np.testing.assert_array_equal(depth[edges > 0], edges[edges > 0])
    np.testing.assert_array_equal(renderer.render(scene, RenderFlags.ALL_SOLID)[0], color)
    flipped, _ = renderer.render(scene, RenderFlags.FLIP_WIREFRAME)
    assert (flipped != color).any()
    # Numbers and depth alone are those of faces.
    faces = renderer.render(scene, RenderFlags.DEPTH_ONLY)
    assert faces[H // 2, W // 2 + 3] == pytest.approx(1.9)
    assert wires_alone[H // 2, W // 2 + 3].tolist() == [0, 0, 0]


def test_edges_of_back_faces_are_drawn_unless_faces_are_culled(renderer):
    scene, _ = box_scene(True)
    _, front = renderer.render(scene)
    _, all_edges = renderer.render(scene, RenderFlags.SKIP_CULL_FACES)
    assert 0 < front.max() < 2.0
    assert all_edges.max() > 2.5


def test_edges_are_lit_by_the_normals_of_vertices(renderer):
    scene, _ = box_scene(True)
    scene.ambient_light = [0.0, 0.0, 0.0]
    black, depth = renderer.render(scene)
    assert not black.any()
    light = pyrender.DirectionalLight(color=np.ones(3), intensity=5.0)
    scene.add(light, pose=np.eye(4))
    lit, _ = renderer.render(scene)
    assert lit[depth > 0].max() > 100


def test_same_edges_are_the_same_object_from_frame_to_frame(renderer):
    _, node = box_scene(True)
    primitive, look = node.mesh.primitives[0], node.mesh.primitives[0].material.convert(
        has_uv=False, is_lit=False, is_culled=True, least_alpha=1.0
    )  # fmt: skip
    first = conversion.make_edges(primitive, np.eye(4), look, None)
    assert conversion.make_edges(primitive, np.eye(4), look, None) is first
    # Twelve edges, and a diagonal on each side; all are apart.
    assert len(first) == 18
    assert (first.links == -1).all()
    primitive.positions = primitive.positions * 2.0
    assert conversion.make_edges(primitive, np.eye(4), look, None) is not first


def test_mirrored_faces_turn_their_backs(renderer):
    ball = trimesh.creation.icosphere(radius=0.5)
    for scale, nearest in (([1.0, 1.0, 1.0], 1.5), ([-1.0, 1.0, 1.0], 2.5)):
        scene = pyrender.Scene()
        scene.add_node(pyrender.Node(mesh=pyrender.Mesh.from_trimesh(ball), scale=scale))
        eye = np.eye(4)
        eye[2, 3] = 2.0
        scene.add(pyrender.PerspectiveCamera(yfov=0.9), pose=eye)
        _, depth = renderer.render(scene)
        assert depth[H // 2, W // 2] == pytest.approx(nearest, abs=0.01)


def test_normals_are_lines_of_a_twentieth_of_the_box():
    primitive = pyrender.Mesh.from_trimesh(trimesh.creation.box()).primitives[0]
    length = 0.05 * math.sqrt(3.0)
    blue = np.array([0.1, 0.1, 1.0, 1.0], np.float32)
    lines = conversion.make_normal_lines(primitive, True, False, blue)
    assert len(lines) == len(primitive.positions)
    both = conversion.make_normal_lines(primitive, True, True, blue)
    assert len(both) == len(primitive.positions) + 12
    ways = np.diff(both.points[both.segments], axis=1)[:, 0]
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), length, rtol=1e-6)
    # Those of faces leave their middles outwards.
    middles, outwards = both.points[both.segments[-12:, 0]], ways[-12:]
    assert np.allclose(np.abs(middles).max(axis=1), 0.5)
    assert ((middles * outwards).sum(axis=1) > 0.0).all()
    primitive.normals = None
    assert conversion.make_normal_lines(primitive, True, True, blue) is None


@pytest.mark.parametrize("flags", [RenderFlags.NONE, RenderFlags.FLAT])
def test_normals_are_blue_lines_where_a_viewer_shows_them(flags):
    scene, node = box_scene(False)
    flags |= RenderFlags.FACE_NORMALS
    drawn = convert_scene(scene, flags).scene
    assert [len(one.mesh.faces) for one in drawn.nodes] == [12, 12]
    lines = drawn.nodes[1].mesh
    shown = lines.colors[0] ** (1.0 if flags & RenderFlags.FLAT else 1.0 / 2.2)
    np.testing.assert_allclose(shown, [26 / 255, 26 / 255, 1.0, 1.0], rtol=1e-5)
    assert lines.widths.tolist() == [1.0]
    node.mesh.primitives[0].normals = None
    assert len(convert_scene(scene, flags).scene.nodes) == 1


def test_lines_end_where_their_mode_says():
    places = np.zeros((5, 3)) + np.arange(5)[:, None]
    expected = {
        GLTF.LINES: [[0, 1], [2, 3]],
        GLTF.LINE_STRIP: [[0, 1], [1, 2], [2, 3], [3, 4]],
        GLTF.LINE_LOOP: [[0, 1], [1, 2], [2, 3], [3, 4], [4, 0]],
    }
    material = pyrender.MetallicRoughnessMaterial()
    look = material.convert(has_uv=False, is_lit=False, is_culled=True, least_alpha=1.0)
    for mode, segments in expected.items():
        primitive = pyrender.Primitive(places, mode=mode, material=material)
        assert conversion.make_lines(primitive, look).segments.tolist() == segments
    assert conversion.make_lines(pyrender.Primitive(places[:1], mode=1), look) is None
