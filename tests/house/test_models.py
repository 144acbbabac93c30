"""Laws of the files in models/: closed, outward, smooth, small, and made again byte for byte."""

import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import trimesh
from naive_animation import NaiveGltf

MODELS = Path(__file__).parents[2] / "models"
TEAPOT_HEIGHT = 3.15
"""Largest height in the table of control points, reached by the lid's tip."""
FLOAT32_ROUNDING = 1e-6
"""Relative error of a few float32 roundings, for numbers read back from the GLB."""


class Obj(NamedTuple):
    positions: np.ndarray  # (V,3)
    normals: np.ndarray  # (V,3), numbered like the positions
    uvs: np.ndarray  # (N,2)
    faces: np.ndarray  # (F,3) of position and normal
    uv_faces: np.ndarray  # (F,3) of uv

    @property
    def corners(self):
        return self.positions[self.faces]

    @property
    def face_normals(self):
        normals = np.cross(
            self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        )
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def read_obj(name):
    """Read the file's own numbers: trimesh may compute its own normals instead."""
    lines = [line.split() for line in (MODELS / name).read_text().splitlines()]
    table = {
        kind: np.array([line[1:] for line in lines if line[0] == kind], float)
        for kind in ("v", "vt", "vn")
    }
    corners = [[part.split("/") for part in line[1:]] for line in lines if line[0] == "f"]
    faces = np.array(corners, int) - 1
    assert np.array_equal(faces[..., 0], faces[..., 2])
    return Obj(table["v"], table["vn"], table["vt"], faces[..., 0], faces[..., 1])


def read_glb(name="scene.glb"):
    data = (MODELS / name).read_bytes()
    magic, version, length, json_length, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    return json.loads(data[20 : 20 + json_length])


def signed_volume(corners):
    return np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6


@pytest.fixture(scope="module")
def teapot():
    return read_obj("teapot.obj")


@pytest.fixture(scope="module")
def knot():
    return read_obj("torus_knot.obj")


@pytest.fixture(scope="module")
def scene():
    return trimesh.load_scene(MODELS / "scene.glb")


def test_script_makes_the_same_bytes_again(tmp_path):
    command = [sys.executable, "-B", str(MODELS / "make_models.py"), str(tmp_path)]
    subprocess.run(command, check=True)
    kept = {path.name for path in MODELS.iterdir() if path.suffix not in ("", ".py", ".md")}
    assert {path.name for path in tmp_path.iterdir()} == kept
    for name in sorted(kept):
        assert (tmp_path / name).read_bytes() == (MODELS / name).read_bytes(), name


def test_models_together_are_under_three_megabytes():
    sizes = {path.name: path.stat().st_size for path in MODELS.iterdir() if path.is_file()}
    assert sum(sizes.values()) < 3_000_000
    assert sizes["teapot.obj"] < 900_000
    assert sizes["torus_knot.obj"] < 1_200_000


@pytest.mark.parametrize(
    ("name", "volume", "faces"),
    [("cube.ply", 8.0, 12), ("pyramid.off", 2 / 3, 4), ("torus_knot.obj", 19.98, 12288)],
)
def test_closed_models_are_watertight_and_face_outwards(name, volume, faces):
    mesh = trimesh.load_mesh(MODELS / name)
    assert len(mesh.faces) == faces
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volume, abs=0.005)


def test_cube_corner_colors_are_its_positions():
    cube = trimesh.load_mesh(MODELS / "cube.ply", process=False)
    assert len(cube.vertices) == 8
    assert np.array_equal(cube.visual.vertex_colors[:, :3], np.where(cube.vertices > 0, 255, 0))


def test_pyramid_has_the_vertices_of_the_indexed_draw_example():
    pyramid = trimesh.load_mesh(MODELS / "pyramid.off", process=False)
    assert pyramid.vertices.tolist() == [[-1, -1, 0], [0, -1, 1], [1, -1, 0], [0, 1, 0]]
    classic = [(0, 3, 1), (1, 3, 2), (2, 3, 0), (0, 1, 2)]
    assert {frozenset(face) for face in pyramid.faces.tolist()} == set(map(frozenset, classic))


@pytest.mark.parametrize("name", ["teapot", "knot"])
def test_vertex_normals_are_units_on_the_front_side_of_their_faces(name, request):
    model = request.getfixturevalue(name)
    lengths = np.linalg.norm(model.normals, axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-4)  # four decimals in the file
    cosines = np.einsum("fj,fkj->fk", model.face_normals, model.normals[model.faces])
    assert cosines.min() > 0.4  # the sharp turn at the teapot's foot
    assert np.quantile(cosines, 0.01) > 0.85


@pytest.mark.parametrize("name", ["teapot", "knot"])
def test_uv_triangles_are_neither_mirrored_nor_flat(name, request):
    model = request.getfixturevalue(name)
    a, b, c = model.uvs[model.uv_faces].transpose(1, 0, 2)
    doubled_areas = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert doubled_areas.min() > 0
    assert model.uvs.min() == 0
    assert model.uvs.max() == 1


@pytest.mark.parametrize("name", ["teapot", "knot"])
def test_no_triangle_is_degenerate(name, request):
    corners = request.getfixturevalue(name).corners
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert areas.min() > 1e-4


def test_teapot_stands_on_the_ground_with_its_spout_along_x(teapot):
    low, high = teapot.positions.min(axis=0), teapot.positions.max(axis=0)
    assert low[1] == 0
    assert high[1] == TEAPOT_HEIGHT
    np.testing.assert_allclose([low[2], high[2]], [-2, 2])
    assert low[0] == -3  # the handle
    assert 3.4 < high[0] < 3.45  # the spout
    assert 6000 <= len(teapot.faces) <= 9000


def test_teapot_normals_at_the_poles_point_along_y(teapot):
    lid_tip = teapot.normals[(teapot.positions == [0, TEAPOT_HEIGHT, 0]).all(axis=1)]
    bottom = teapot.normals[(teapot.positions == [0, 0, 0]).all(axis=1)]
    assert lid_tip.tolist() == [[0, 1, 0]]
    assert bottom.tolist() == [[0, -1, 0]]


def test_teapot_borders_are_shared_and_only_rims_are_open(teapot):
    mesh = trimesh.Trimesh(teapot.positions, teapot.faces, process=False)
    parts = mesh.split(only_watertight=False)
    assert len(parts) == 4  # body with rim and bottom, lid, handle, spout
    edges, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    assert counts.max() == 2
    # Open: the body's rim, the lid's, both ends of the handle and of the spout.
    segments = 11
    assert np.count_nonzero(counts == 1) == (4 + 4 + 2 * 2 + 2 * 2) * segments
    assert mesh.is_winding_consistent
    assert signed_volume(teapot.corners) > 0
    assert len(edges) + len(counts[counts == 2]) == 3 * len(teapot.faces)


def test_teapot_is_symmetric_from_front_to_back(teapot):
    points = {tuple(point) for point in teapot.positions.tolist()}
    assert {(x, y, -z + 0.0) for x, y, z in points} == points


def test_knot_tube_does_not_touch_itself(knot):
    centers = knot.positions.reshape(256, 24, 3).mean(axis=1)
    gaps = np.linalg.norm(centers[:, None] - centers, axis=2)
    steps = np.abs(np.arange(256)[:, None] - np.arange(256))
    apart = np.minimum(steps, 256 - steps) > 32
    assert gaps[apart].min() > 2 * 0.45


def test_scene_has_what_a_renderer_must_cope_with():
    document = read_glb()
    assert len(document["nodes"]) >= 4
    used = [node["mesh"] for node in document["nodes"] if "mesh" in node]
    assert max(used.count(mesh) for mesh in used) == 3
    assert document["textures"]
    assert document["images"][0]["mimeType"] == "image/png"
    blended = [m for m in document["materials"] if m.get("alphaMode") == "BLEND"]
    assert [m["pbrMetallicRoughness"]["baseColorFactor"][3] for m in blended] == [0.4]
    attributes = [mesh["primitives"][0]["attributes"] for mesh in document["meshes"]]
    assert sum("COLOR_0" in names for names in attributes) == 1
    assert document["cameras"][0]["type"] == "perspective"
    lights = document["extensions"]["KHR_lights_punctual"]["lights"]
    assert {light["type"] for light in lights} == {"directional", "point"}


def test_scene_offsets_are_aligned_and_inside_the_buffer():
    document = read_glb()
    size = document["buffers"][0]["byteLength"]
    for view in document["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= size


def test_scene_nodes_multiply_their_parents_transforms(scene):
    def turn(degrees):
        return trimesh.transformations.rotation_matrix(np.radians(degrees), [0, 1, 0])

    def move(*offset):
        return trimesh.transformations.translation_matrix(offset)

    base = move(-1.5, 0, 0) @ turn(30) @ move(0, 0.75, 0) @ np.diag([0.75, 0.75, 0.75, 1])
    top = base @ move(0, 1.6, 0) @ turn(25) @ np.diag([0.6, 0.6, 0.6, 1])
    flat = move(2.6, 0.3, -1.6) @ turn(-20) @ np.diag([0.9, 0.3, 0.5, 1])
    for name, expected in (("crate_base", base), ("crate_top", top), ("crate_flat", flat)):
        transform, geometry = scene.graph[name]
        assert geometry == "crate"
        np.testing.assert_allclose(transform, expected, atol=FLOAT32_ROUNDING)


def test_scene_camera_looks_at_the_scene(scene):
    transform = scene.graph["camera"][0]
    forward = np.array([0.3, 0.8, 0.0]) - [3.5, 3.2, 7.0]
    np.testing.assert_allclose(transform[:3, 3], [3.5, 3.2, 7.0])
    expected = -forward / np.linalg.norm(forward)
    np.testing.assert_allclose(transform[:3, 2], expected, atol=FLOAT32_ROUNDING)
    assert np.linalg.det(transform) == pytest.approx(1)
    assert scene.camera.fov[1] == pytest.approx(40)


@pytest.mark.parametrize("name", ["crate", "ball", "color_cube"])
def test_scene_solids_face_outwards_with_their_normals(scene, name):
    mesh = scene.geometry[name]
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.einsum("fj,fkj->fk", normals, mesh.vertex_normals[mesh.faces]).min() > 0
    assert signed_volume(corners) == pytest.approx(4.18879 if name == "ball" else 8, rel=0.02)


def test_scene_texture_is_upright(scene):
    crate = scene.geometry["crate"]
    pixels = np.asarray(crate.visual.material.baseColorTexture.convert("RGB"))
    assert pixels.shape == (64, 64, 3)
    assert pixels[-1, 0, 1] > pixels[8, 0, 1]  # green grows downwards
    front = np.isclose(crate.vertices[:, 2], 1) & (crate.vertex_normals[:, 2] > 0.5)
    # trimesh turns glTF's v over: up in space is up in v, right is right in u.
    np.testing.assert_allclose(crate.visual.uv[front], (crate.vertices[front, :2] + 1) / 2)


ANIMATED = {"tentacle.glb": ([8], 0), "figure.glb": ([18], 0), "face.glb": ([], 2)}
"""Joints of the skins of each animated model, and its morph targets."""


@pytest.mark.parametrize("name", ANIMATED)
def test_animated_models_are_small_and_have_two_animations(name):
    data = (MODELS / name).read_bytes()
    document = read_glb(name)
    joints, targets = ANIMATED[name]
    assert len(data) < 300_000
    assert [len(skin["joints"]) for skin in document.get("skins", [])] == joints
    assert len(document["meshes"][0]["primitives"][0].get("targets", [])) == targets
    assert len(document["animations"]) == 2


@pytest.mark.parametrize("name", ANIMATED)
def test_animated_models_are_closed_in_every_pose(name):
    """What is open is the ground alone; faces keep their sides when the figure moves."""
    file = NaiveGltf(MODELS / name)
    for animation, (_, duration) in enumerate(file.animations):
        for time in (0.0, 0.3 * duration, 0.7 * duration):
            body = next(one for one in file.pose(time, animation) if one.node in name)
            edges = np.sort(body.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
            _, counts = np.unique(edges, axis=0, return_counts=True)
            # The dark of the mouth has a rim, under the lips.
            assert counts.max() == 2
            assert np.count_nonzero(counts == 1) == (36 if name == "face.glb" else 0)
            corners = body.positions[body.faces]
            assert signed_volume(corners) > 0
            a, b, c = corners.transpose(1, 0, 2)
            across = np.cross(b - a, c - a)
            cosines = np.einsum("fj,fkj->fk", across, body.normals[body.faces])
            assert (cosines > 0).mean() > 0.99


def test_weights_of_the_figure_sum_to_one_and_no_joint_stands_twice():
    file = NaiveGltf(MODELS / "figure.glb")
    primitive = file.document["meshes"][0]["primitives"][0]["attributes"]
    weights = np.array(file._numbers(primitive["WEIGHTS_0"]))
    joints = np.array(file._numbers(primitive["JOINTS_0"]))
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    for row, shares in zip(joints, weights, strict=True):
        used = row[shares > 0].tolist()
        assert len(set(used)) == len(used)
