"""Laws of loading: what a file says is in the scene, what is not is said, nothing crashes."""

import json
import math
import os
import re
import struct
import subprocess
import sys
import warnings

import numpy as np
import pytest
import trimesh
from opengl import optional_module
from PIL import Image

import rasterjit as rj
from rasterjit.io.load_warnings import LeftOut, LoadWarning, MeshFileError
from rasterjit.io.meshes import as_scene, from_trimesh, list_readable_formats, load
from rasterjit.io.trimesh.scene import material_from_trimesh
from rasterjit.scene.camera import OrthographicCamera, PerspectiveCamera
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.light import DirectionalLight, PointLight, SpotLight
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import Scene

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
TWO_FACES = np.array([[0, 1, 2], [0, 2, 3]])
OBJ_SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def write(path, text):
    path.write_text(text)
    return path


def only_mesh(scene):
    (node,) = scene.nodes
    return node.mesh


def write_gltf(path, nodes, **header):
    """Write a glTF of one triangle, with the given nodes and further keys."""
    data = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float32).tobytes()
    (path.parent / "data.bin").write_bytes(data)
    primitive = {"attributes": {"POSITION": 0}, **header.pop("primitive", {})}
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": header.pop("roots", list(range(len(nodes))))}],
        "nodes": nodes,
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"uri": "data.bin", "byteLength": len(data)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 3,
                "type": "VEC3",
                "min": [0, 0, 0],
                "max": [1, 1, 0],
            }
        ],
        **header,
    }
    return write(path, json.dumps(content))


# Files


@pytest.mark.parametrize("extension", ["obj", "ply", "stl", "off", "glb", "gltf", "3mf", "dae"])
def test_each_format_gives_the_same_faces(tmp_path, extension):
    source = trimesh.creation.box((1, 2, 3))
    path = tmp_path / f"box.{extension}"
    write_export(path, source) if extension != "gltf" else write_gltf_box(path, source)
    mesh = only_mesh(load(path))
    assert mesh.vertices[mesh.faces] == pytest.approx(source.vertices[source.faces])
    assert type(mesh.vertices) is np.ndarray
    assert mesh.normals is not None


@pytest.mark.parametrize(
    ("name", "said", "up"),
    [
        ("box.obj", "", None),
        ("box.3mf", "", (0.0, 0.0, 1.0)),
        ("box.glb", "", (0.0, 1.0, 0.0)),
        ("box.dae", "Y_UP", (0.0, 1.0, 0.0)),
        ("box.dae", "Z_UP", (0.0, 0.0, 1.0)),
        ("box.dae", "X_UP", (1.0, 0.0, 0.0)),
    ],
)
def test_scene_knows_which_way_its_file_says_is_up(tmp_path, name, said, up):
    path = tmp_path / name
    write_export(path, trimesh.creation.box((1, 2, 3)))
    if said:
        text = re.sub("<up_axis>.*</up_axis>", "", path.read_text())
        path.write_text(text.replace("</asset>", f"<up_axis>{said}</up_axis></asset>"))
    assert load(path).up == up


def write_export(path, source):
    if path.suffix == ".dae":
        optional_module("collada")
    # trimesh leaves the file of some formats open, so take the bytes.
    content = source.export(file_type=path.suffix[1:])
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def write_gltf_box(path, source):
    for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(source)).items():
        (path.parent / name.replace("model.gltf", path.name)).write_bytes(content)


def test_a_path_can_be_a_string(tmp_path):
    assert len(load(str(write(tmp_path / "a.obj", OBJ_SQUARE + "f 1 2 3\n"))).nodes) == 1


def test_upper_case_extensions_are_known(tmp_path):
    assert len(load(write(tmp_path / "A.OBJ", OBJ_SQUARE + "f 1 2 3\n")).nodes) == 1


def test_polygons_are_triangulated(tmp_path):
    mesh = only_mesh(load(write(tmp_path / "quad.obj", OBJ_SQUARE + "f 1 2 3 4\n")))
    assert len(mesh.faces) == 2
    assert mesh.normals.tolist() == [[0, 0, 1]] * 4


def test_faces_keep_the_order_of_the_file(tmp_path):
    rng = np.random.default_rng(2)
    source = trimesh.creation.icosphere(2)
    faces = rng.permutation(source.faces)
    path = tmp_path / "sphere.ply"
    trimesh.Trimesh(source.vertices, faces, process=False).export(path)
    mesh = only_mesh(load(path))
    assert mesh.vertices[mesh.faces] == pytest.approx(source.vertices[faces], abs=1e-6)


def test_an_stl_box_is_sharp_and_its_vertices_are_shared(tmp_path):
    path = tmp_path / "box.stl"
    trimesh.creation.box().export(path)
    assert len(only_mesh(load(path)).vertices) == 24
    assert len(only_mesh(load(path, crease_angle=180.0)).vertices) == 8


def test_normals_of_the_file_are_used(tmp_path):
    text = OBJ_SQUARE + "vn 1 0 0\nvn 0 0 2\nf 1//1 2//1 3//2\n"
    mesh = only_mesh(load(write(tmp_path / "a.obj", text)))
    assert mesh.normals[mesh.faces[0]].tolist() == [[1, 0, 0], [1, 0, 0], [0, 0, 1]]


def test_normals_with_nan_are_replaced_and_named(tmp_path):
    text = OBJ_SQUARE + "vn nan 0 0\nf 1//1 2//1 3//1\n"
    with pytest.warns(LoadWarning, match="normals with NaN or infinity"):
        mesh = only_mesh(load(write(tmp_path / "a.obj", text)))
    assert mesh.normals.tolist() == [[0, 0, 1]] * 3


def test_vertex_colours_are_srgb_bytes(tmp_path):
    colors = np.array([[255, 0, 0, 255], [0, 128, 0, 255], [0, 0, 64, 255], [9, 9, 9, 255]])
    path = tmp_path / "colored.ply"
    trimesh.Trimesh(SQUARE, TWO_FACES, vertex_colors=colors, process=False).export(path)
    mesh = only_mesh(load(path))
    assert np.array_equal(mesh.vertex_colors[:, :3], srgb_to_linear(colors[:, :3].astype(np.uint8)))
    assert mesh.material.base_color is None


def test_face_colours_stay_with_their_faces(tmp_path):
    colors = np.array([[255, 0, 0, 255], [0, 0, 255, 255]])
    path = tmp_path / "colored.ply"
    trimesh.Trimesh(SQUARE, TWO_FACES, face_colors=colors, process=False).export(path)
    assert only_mesh(load(path)).face_colors.tolist() == [[1, 0, 0, 1], [0, 0, 1, 1]]


def test_an_mtl_gives_colour_highlight_and_names(tmp_path):
    write(tmp_path / "a.mtl", "newmtl tin\nKd 1 0 0\nKs 1 1 1\nNs 20\nnewmtl felt\nKd 0 1 0\n")
    text = f"mtllib a.mtl\n{OBJ_SQUARE}usemtl tin\nf 1 2 3\nusemtl felt\nf 1 3 4\n"
    scene = load(write(tmp_path / "a.obj", text))
    materials = {node.mesh.material.name: node.mesh.material for node in scene.nodes}
    assert materials["tin"] == Material(base_color="red", specular=1.0, shininess=20.0, name="tin")
    assert materials["felt"] == Material(base_color="#00ff00", name="felt")


def test_a_transparent_mtl_is_blended(tmp_path):
    write(tmp_path / "a.mtl", "newmtl glass\nKd 1 1 1\nd 0.25\n")
    text = f"mtllib a.mtl\n{OBJ_SQUARE}usemtl glass\nf 1 2 3\n"
    material = only_mesh(load(write(tmp_path / "a.obj", text))).material
    assert material.base_color == (1.0, 1.0, 1.0, 0.25)
    assert material.alpha_mode == "blend"


def test_a_point_cloud_beside_meshes_is_there():
    cloud = trimesh.PointCloud(np.random.default_rng(1).random((7, 3)))
    scene = from_trimesh(trimesh.Scene([trimesh.creation.box(), cloud]))
    assert [node.mesh.primitive for node in scene.nodes] == ["triangles", "points"]
    assert np.array_equal(scene.nodes[1].mesh.vertices, cloud.vertices)


# glTF


def test_nodes_and_instances_of_a_gltf_keep_their_places(tmp_path):
    nodes = [
        {"name": "root", "children": [1, 2], "translation": [0, 0, 5]},
        {"name": "left", "mesh": 0, "scale": [2, 2, 2]},
        {"name": "right", "mesh": 0, "translation": [3, 0, 0]},
    ]
    scene = load(write_gltf(tmp_path / "a.gltf", nodes, roots=[0]))
    places = {node.name: node.world_from_model for node in scene.nodes}
    assert places["left"] == pytest.approx(np.array(np.diag([2.0, 2, 2, 1])) + lift(0, 0, 5))
    assert places["right"] == pytest.approx(np.eye(4) + lift(3, 0, 5))
    assert scene.nodes[0].mesh is scene.nodes[1].mesh


def lift(x, y, z):
    matrix = np.zeros((4, 4))
    matrix[:3, 3] = x, y, z
    return matrix


def test_gltf_factors_are_linear_and_opaque_unless_said(tmp_path):
    factor = {"baseColorFactor": [1, 0.2, 0, 0.4], "metallicFactor": 0, "roughnessFactor": 0.5}
    materials = [{"name": "m", "pbrMetallicRoughness": factor}]
    path = write_gltf(
        tmp_path / "a.gltf", [{"mesh": 0}], materials=materials, primitive={"material": 0}
    )
    material = only_mesh(load(path)).material
    assert material == Material(
        shading="pbr", base_color=(1, 0.2, 0), metallic=0.0, roughness=0.5, name="m",
        double_sided=False,
    )  # fmt: skip
    materials[0]["alphaMode"] = "BLEND"
    path = write_gltf(
        tmp_path / "b.gltf", [{"mesh": 0}], materials=materials, primitive={"material": 0}
    )
    blended = only_mesh(load(path)).material
    assert (blended.alpha_mode, blended.base_color[3]) == ("blend", np.float32(0.4))


@pytest.mark.parametrize(("is_gltf", "value"), [(True, 128 / 255), (False, 0.215860500114)])
def test_factors_are_linear_in_gltf_and_srgb_elsewhere(is_gltf, value):
    source = trimesh.visual.material.PBRMaterial(baseColorFactor=[128, 128, 128, 255])
    material = material_from_trimesh(source, is_gltf, LeftOut())
    assert material.base_color[0] == np.float32(value)
    assert material.shading == ("pbr" if is_gltf else "phong")


def test_a_trimesh_material_made_in_memory_is_gltfs():
    source = trimesh.creation.box()
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[128, 128, 128, 255])
    source.visual = trimesh.visual.TextureVisuals(material=material)
    have = only_mesh(from_trimesh(source)).material
    assert have == Material(
        shading="pbr", base_color=(128 / 255,) * 3, metallic=1.0, roughness=1.0, double_sided=False
    )


def test_outside_gltf_a_smooth_metal_shines_more_than_a_rough_one():
    def shine(**factors):
        source = trimesh.visual.material.PBRMaterial(baseColorFactor=[255] * 4, **factors)
        return material_from_trimesh(source, False, LeftOut())

    rough, smooth = shine(), shine(metallicFactor=1.0, roughnessFactor=0.0)
    assert (rough.specular, rough.shininess) == (pytest.approx(0.04 * 9 / 8), 1.0)
    assert (smooth.specular, smooth.shininess) == (1.0, 1000.0)


def test_gltf_colours_are_linear_bytes(tmp_path):
    colors = np.array([[128, 0, 0, 255]] * 4, dtype=np.uint8)
    path = tmp_path / "a.glb"
    trimesh.Trimesh(SQUARE, TWO_FACES, vertex_colors=colors, process=False).export(path)
    assert only_mesh(load(path)).vertex_colors[0, 0] == np.float32(128 / 255)


def test_unlit_materials_stay_unlit(tmp_path):
    path = write_gltf(
        tmp_path / "a.gltf",
        [{"mesh": 0}],
        materials=[{"name": "sign", "extensions": {"KHR_materials_unlit": {}}}],
        primitive={"material": 0},
        extensionsUsed=["KHR_materials_unlit"],
    )
    assert only_mesh(load(path)).material.shading == "unlit"


def test_a_gltf_brings_its_camera_and_lights(tmp_path):
    lights = [
        {"type": "directional", "color": [1, 0, 0]},
        {"type": "point", "intensity": 7, "range": 3},
        {"type": "spot", "spot": {"innerConeAngle": 0.25, "outerConeAngle": 0.5}, "range": 9},
    ]
    quarter = math.sqrt(0.5)
    nodes = [
        {"mesh": 0},
        {"children": [2, 3, 4, 5], "translation": [0, 0, 4]},
        {"camera": 0, "translation": [1, 0, 0]},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}, "rotation": [quarter, 0, 0, quarter]},
        {"extensions": {"KHR_lights_punctual": {"light": 1}}},
        {"extensions": {"KHR_lights_punctual": {"light": 2}}},
    ]
    path = write_gltf(
        tmp_path / "a.gltf",
        nodes,
        roots=[0, 1],
        cameras=[{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.5}}],
        extensions={"KHR_lights_punctual": {"lights": lights}},
        extensionsUsed=["KHR_lights_punctual"],
    )
    scene = load(path)
    assert isinstance(scene.camera, PerspectiveCamera)
    assert scene.camera.eye_position() == pytest.approx([1, 0, 4])
    assert (scene.camera.fov_y, scene.camera.near) == (math.degrees(1.0), 0.5)
    assert scene.camera.far == math.inf
    sun, lamp, spot = scene.lights
    assert sun.direction == pytest.approx((0, 1, 0))
    assert sun.color == (1, 0, 0)
    assert lamp == PointLight((0, 0, 4), intensity=7 / math.pi, range=3)
    assert spot == SpotLight(
        (0, 0, 4), (0, 0, -1), intensity=1 / math.pi, inner_angle=math.degrees(0.25),
        outer_angle=math.degrees(0.5), range=9,
    )  # fmt: skip


def test_a_gltf_camera_can_be_orthographic(tmp_path):
    flat = {"xmag": 2, "ymag": 3, "znear": 0.5, "zfar": 9}
    path = write_gltf(
        tmp_path / "a.gltf",
        [{"mesh": 0}, {"camera": 0}],
        cameras=[{"type": "orthographic", "orthographic": flat}],
    )
    camera = load(path).camera
    assert isinstance(camera, OrthographicCamera)
    assert (camera.height, camera.near, camera.far) == (6, 0.5, 9)


def test_a_glb_header_is_read_as_well(tmp_path):
    path = tmp_path / "a.glb"
    scene = trimesh.Scene(trimesh.creation.box())
    scene.set_camera(fov=(60, 40))
    scene.camera_transform = np.eye(4) + lift(0, 0, 9)
    scene.export(path)
    camera = load(path).camera
    assert camera.fov_y == pytest.approx(40)
    assert camera.eye_position() == pytest.approx([0, 0, 9])


# Bad files


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_called_one(tmp_path):
    os.mkfifo(tmp_path / "pipe.obj")
    with pytest.raises(MeshFileError, match=r"pipe\.obj' is a pipe or a device"):
        rj.load(tmp_path / "pipe.obj")


def test_a_missing_file_a_folder_and_an_empty_file_are_named(tmp_path):
    with pytest.raises(MeshFileError, match=r"none\.obj' does not exist"):
        load(tmp_path / "none.obj")
    with pytest.raises(MeshFileError, match="is a folder"):
        load(tmp_path)
    with pytest.raises(MeshFileError, match=r"a\.stl' is empty"):
        load(write(tmp_path / "a.stl", ""))
    with pytest.raises(MeshFileError, match="path must be a file name, got 3"):
        load(3)


@pytest.mark.parametrize(
    ("name", "said"), [("a.xyzzy", r"the extension \.xyzzy"), ("mesh", "no extension")]
)
def test_an_unknown_extension_names_known_ones(tmp_path, name, said):
    with pytest.raises(MeshFileError, match=rf"has {said}; readable formats are \.obj, \.ply"):
        load(write(tmp_path / name, "?"))


@pytest.mark.parametrize("extension", ["obj", "ply", "stl", "off", "glb", "gltf", "3mf", "dae"])
@pytest.mark.parametrize("content", [b"\0\1\2\3" * 99, b"rubbish\n" * 50, b"ply\nformat", b"\xff"])
def test_rubbish_is_an_error_that_names_the_file(tmp_path, extension, content):
    path = tmp_path / f"rubbish.{extension}"
    path.write_bytes(content)
    with pytest.raises(MeshFileError, match=r"rubbish\."):
        load(path)


@pytest.mark.parametrize("extension", ["obj", "ply", "stl", "off", "glb", "3mf", "dae"])
def test_a_file_cut_short_is_an_error_or_a_scene(tmp_path, extension):
    whole = tmp_path / f"whole.{extension}"
    write_export(whole, trimesh.creation.icosphere(1))
    content = whole.read_bytes()
    for tenths in range(1, 10):
        path = tmp_path / f"cut{tenths}.{extension}"
        path.write_bytes(content[: len(content) * tenths // 10])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LoadWarning)
            outcome = scene_or_error(path)
        assert isinstance(outcome, Scene) or path.name in str(outcome)


def scene_or_error(path):
    try:
        return load(path)
    except MeshFileError as error:
        return error


def test_a_file_without_faces_is_a_point_cloud(tmp_path):
    trimesh.PointCloud(np.random.rand(35, 3)).export(tmp_path / "points.ply")
    assert len(load(tmp_path / "points.ply").nodes[0].mesh) == 35
    scene = load(write(tmp_path / "lone.obj", OBJ_SQUARE))
    assert scene.nodes[0].mesh.primitive == "points"
    assert len(scene.nodes[0].mesh) == 4


def test_a_format_whose_reader_is_not_installed_names_the_way_out(tmp_path, monkeypatch):
    missing = trimesh.exceptions.ExceptionWrapper(ImportError("missing `pip install pycollada`"))
    monkeypatch.setitem(trimesh.exchange.load.mesh_loaders, "dae", missing)
    with pytest.raises(MeshFileError, match=r"needs a package.*pycollada.*rasterjit\[formats\]"):
        load(write(tmp_path / "a.dae", "<COLLADA/>"), isolate=False)


def test_what_trimesh_reads_by_a_program_on_path_is_not_read(tmp_path, monkeypatch):
    loaders = trimesh.exchange.load.mesh_loaders
    monkeypatch.setitem(loaders, "drc", loaders["ply"])
    assert "drc" not in list_readable_formats()
    with pytest.raises(MeshFileError, match=r"has the extension \.drc; readable formats are"):
        load(write(tmp_path / "a.drc", "ply"), isolate=False)


@pytest.mark.parametrize("extension", ["stl", "obj", "off"])
def test_a_damaged_file_is_not_taken_for_a_missing_package(tmp_path, monkeypatch, extension):
    monkeypatch.setitem(sys.modules, "charset_normalizer", None)
    path = tmp_path / f"a.{extension}"
    path.write_bytes(bytes(range(128, 256)) * 20)
    with pytest.raises(MeshFileError) as error:
        load(path)
    assert "rasterjit[formats]" not in str(error.value)
    assert path.name in str(error.value)


def test_crease_angle_is_checked_whatever_the_file_holds(tmp_path):
    path = write(tmp_path / "a.obj", OBJ_SQUARE + "f 1 2 3\n")
    with pytest.raises(ValueError, match="crease_angle"):
        load(path, crease_angle=500)


def test_matt_obj_material_has_no_highlight(tmp_path):
    write(tmp_path / "a.mtl", "newmtl m\nKd 0.1 0.1 0.4\nKs 0.9 0.9 0.9\nNs 0\n")
    path = write(tmp_path / "a.obj", "mtllib a.mtl\nusemtl m\n" + OBJ_SQUARE + "f 1 2 3\n")
    assert only_mesh(load(path)).material.specular == 0.0


def test_nan_vertices_are_refused_or_dropped(tmp_path):
    path = write(tmp_path / "a.obj", OBJ_SQUARE + "v nan 0 0\nf 1 2 3\nf 1 2 5\n")
    with pytest.raises(MeshFileError, match=r"a\.obj: mesh .*vertices must be finite, got 1 of"):
        load(path)
    mesh = only_mesh(load(path, on_invalid="drop"))
    assert (mesh.invalid_vertices, len(mesh.faces)) == (1, 2)


# trimesh objects


def test_a_trimesh_becomes_a_scene():
    source = trimesh.creation.box()
    mesh = only_mesh(from_trimesh(source))
    assert np.array_equal(mesh.vertices[mesh.faces], source.vertices[source.faces])
    assert mesh.material == Material()


def test_averages_that_trimesh_has_cached_are_no_normals_of_its_own():
    touched = trimesh.creation.box()
    assert touched.vertex_normals.shape == (8, 3)
    untouched = only_mesh(from_trimesh(trimesh.creation.box()))
    assert np.array_equal(only_mesh(from_trimesh(touched)).normals, untouched.normals)


def test_normals_given_to_a_trimesh_are_its_own():
    up = np.tile([0.0, 1.0, 0.0], (4, 1))
    source = trimesh.Trimesh(SQUARE, TWO_FACES, vertex_normals=up, process=False)
    assert np.array_equal(only_mesh(from_trimesh(source)).normals, up)


def test_a_camera_of_trimesh_whose_pose_mirrors_is_named():
    source = trimesh.Scene(trimesh.creation.box())
    source.camera = trimesh.scene.Camera(fov=(60, 30))
    source.camera_transform = np.diag([1.0, -1.0, 1.0, 1.0])
    with pytest.warns(UserWarning, match="camera whose pose mirrors"):
        assert from_trimesh(source).camera is None


def test_a_trimesh_scene_brings_its_camera_and_lights():
    source = trimesh.Scene(trimesh.creation.box())
    source.camera = trimesh.scene.Camera(fov=(60, 30), z_near=0.25)
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0], [0, 0, 0])
    source.camera_transform = turn + lift(5, 0, 0)
    source.lights = [
        trimesh.scene.lighting.DirectionalLight(name="sun", color=[255, 0, 0, 255], intensity=2),
        trimesh.scene.lighting.PointLight(name="lamp", color=[0, 51, 0, 255]),
    ]
    source.graph["sun"] = turn
    source.graph["lamp"] = np.eye(4) + lift(1, 2, 3)
    scene = from_trimesh(source)
    assert scene.camera.eye_position() == pytest.approx([5, 0, 0])
    assert scene.camera.target == pytest.approx((4, 0, 0))
    assert (scene.camera.fov_y, scene.camera.near, scene.camera.far) == (30, 0.25, math.inf)
    sun, lamp = scene.lights
    assert sun == DirectionalLight(sun.direction, "red", 2)
    assert sun.direction == pytest.approx((-1, 0, 0))
    assert lamp == PointLight((1, 2, 3), (0, 51 / 255, 0))


def test_spot_lights_of_a_trimesh_scene_shine_along_their_axis():
    source = trimesh.Scene(trimesh.creation.box())
    spot = trimesh.scene.lighting.SpotLight(
        name="spot", color=[255, 0, 0, 255], intensity=3, innerConeAngle=np.pi / 12,
        outerConeAngle=np.pi / 6,
    )  # fmt: skip
    source.lights = [spot]
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0], [0, 0, 0])
    source.graph["spot"] = turn + lift(5, 1, 0)
    (found,) = from_trimesh(source).lights
    assert found.position == pytest.approx((5, 1, 0))
    assert found.direction == pytest.approx((-1, 0, 0))
    assert (found.inner_angle, found.outer_angle) == pytest.approx((15, 30))
    assert (found.color, found.intensity) == ((1.0, 0.0, 0.0), 3)


def test_a_trimesh_scene_is_drawn_in_one_call_with_all_it_has():
    quad = trimesh.Trimesh(SQUARE, TWO_FACES, process=False)
    picture = Image.fromarray(np.repeat([[[255, 0, 0], [0, 0, 255]]], 2, axis=1).astype(np.uint8))
    quad.visual = trimesh.visual.TextureVisuals(
        uv=np.asarray(SQUARE)[:, :2], image=picture,
        material=trimesh.visual.material.SimpleMaterial(
            image=picture, diffuse=[255] * 4, specular=[0, 0, 0, 255], ks=[0, 0, 0]
        ),
    )  # fmt: skip
    low, high = quad.bounds
    source = trimesh.Scene(quad)
    source.camera = trimesh.scene.Camera(resolution=(40, 30), fov=(60, 46.8))
    eye = (low + high) / 2 + (0.3, 0, 1.5)
    source.camera_transform = np.eye(4) + lift(*eye)
    sun = trimesh.scene.lighting.DirectionalLight(name="sun", color=[255] * 4, intensity=0.5)
    source.lights = [sun]
    source.graph["sun"] = np.eye(4)
    frame = rj.render(source, size=(40, 30), outputs=("color", "depth"), threads=1)
    seen = np.isfinite(frame.depth)
    # The camera is the scene's: 1.5 away, and to the right of the square.
    assert frame.depth[seen] == pytest.approx(1.5)
    columns = np.nonzero(seen)[1]
    focal = 15 / math.tan(math.radians(23.4))
    assert columns.mean() + 0.5 == pytest.approx(20 - 0.3 / 1.5 * focal, abs=0.6)
    # So are texture and light: half of red, half of blue, whose sRGB code is 188.
    quarter = round(focal / 1.5 / 4)
    left, right = frame.color[15, [columns.min() + quarter, columns.max() - quarter]]
    assert left[:3].tolist() == [188, 0, 0]
    assert right[:3].tolist() == [0, 0, 188]


def test_lights_and_cameras_that_trimesh_makes_up_are_not_the_scenes():
    source = trimesh.Scene(trimesh.creation.box())
    assert len(source.lights) == 2
    scene = from_trimesh(source)
    assert (scene.lights, scene.camera) == ([], None)
    assert not source.has_camera


def test_an_empty_trimesh_says_what_it_holds():
    with pytest.raises(MeshFileError, match="trimesh Scene holds no faces, lines or points"):
        from_trimesh(trimesh.Scene())
    with pytest.raises(MeshFileError, match="a mesh of 0 vertices, no faces, lines or points"):
        from_trimesh(trimesh.Scene(trimesh.Trimesh()))


def test_bad_faces_of_a_trimesh_are_named():
    source = trimesh.Trimesh(SQUARE, TWO_FACES + 2, process=False)
    with pytest.raises(MeshFileError, match=r"trimesh Trimesh: mesh .*the largest index being 5"):
        from_trimesh(source)


# Anything


def test_anything_drawable_is_a_scene():
    scene, mesh = Scene(), Mesh(SQUARE, TWO_FACES)
    assert as_scene(scene) is scene
    assert only_mesh(as_scene(mesh)) is mesh
    assert len(as_scene(trimesh.creation.box()).nodes) == 1
    assert len(as_scene(trimesh.Scene(trimesh.creation.box())).nodes) == 1


@pytest.mark.parametrize("what", [None, 3, SQUARE, [SQUARE, TWO_FACES]])
def test_anything_else_is_refused_by_type(what):
    with pytest.raises(ValueError, match=f"what must be a Scene.*got {type(what).__name__}"):
        as_scene(what)
    with pytest.raises(ValueError, match="what must be a trimesh"):
        from_trimesh(what)


def test_a_file_name_is_sent_to_load():
    with pytest.raises(ValueError, match=r"got str; rasterjit\.load reads files"):
        as_scene("teapot.obj")


def test_trimesh_is_not_imported_before_a_file_is_loaded():
    code = (
        "import sys, rasterjit.io.meshes as m; from rasterjit.scene.mesh import Mesh\n"
        "m.as_scene(Mesh([[0,0,0],[1,0,0],[0,1,0]], [[0,1,2]]))\n"
        "assert 'trimesh' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_glb_of_a_wrong_first_chunk_still_ends_in_a_clear_error(tmp_path):
    path = tmp_path / "a.glb"
    path.write_bytes(b"glTF" + struct.pack("<IIII", 2, 24, 4, 0x004E4942) + b"\0\0\0\0")
    with pytest.raises(MeshFileError, match=r"a\.glb"):
        load(path)


def test_what_loading_raises_and_warns_of_is_caught_by_public_names(tmp_path):
    with pytest.raises(rj.MeshFileError, match="does not exist"):
        rj.load(tmp_path / "none.obj")
    damaged = tmp_path / "damaged.obj"
    damaged.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 9\n")
    with pytest.warns(rj.LoadWarning, match="damaged"):
        assert len(rj.load(damaged, on_damage="warn").nodes[0].mesh.faces) == 1
    assert issubclass(rj.MeshFileError, ValueError)
    assert issubclass(rj.LoadWarning, UserWarning)


@pytest.mark.parametrize("extension", ["obj", "stl", "off", "ply", "glb", "gltf"])
@pytest.mark.parametrize(
    ("name", "kind"), [("picture.png", "a PNG picture"), ("picture.jpg", "a JPEG picture")]
)
def test_a_picture_with_the_name_of_a_mesh_is_said_to_be_one(tmp_path, name, kind, extension):
    picture = tmp_path / name
    Image.new("RGB", (8, 8)).save(picture)
    file = picture.rename(tmp_path / f"mesh.{extension}")
    with pytest.raises(MeshFileError, match=rf"mesh\.{extension} is {kind}; .* \.{extension}$"):
        rj.load(file)


def test_a_mesh_with_the_name_of_another_kind_is_said_to_be_it(tmp_path):
    file = tmp_path / "cube.obj"
    content = trimesh.creation.box().export(file_type="ply")
    file.write_bytes(content)
    with pytest.raises(MeshFileError, match=r"cube\.obj is a PLY file; its name says \.obj"):
        rj.load(file)
    damaged = tmp_path / "cube.ply"
    damaged.write_bytes(content[:-20])
    with pytest.raises(MeshFileError, match="damaged"):
        rj.load(damaged)


@pytest.mark.parametrize("way", ["load", "render", "renderer", "explain", "add", "file"])
def test_what_is_left_out_is_told_at_the_line_that_asks(tmp_path, way):
    ball = trimesh.creation.icosphere(1)
    ball.vertex_attributes["word"] = np.full(len(ball.vertices), "odd")
    given = trimesh.Scene(ball)
    path = tmp_path / "given.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\nsurf 0 1 0 1 1\n")
    ways = {
        "load": lambda: rj.load(given),
        "render": lambda: rj.render(given, size=(8, 8), threads=1),
        "renderer": lambda: rj.Renderer((8, 8), threads=1).render(given),
        "explain": lambda: rj.explain(given),
        "add": lambda: rj.Scene().add(given),
        "file": lambda: rj.load(path),
    }
    with pytest.warns(LoadWarning) as said:
        ways[way]()
    assert {warning.filename for warning in said} == {__file__}
