"""What ``rasterjit info`` says of a file is what the library loads."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import rasterjit as rj
from rasterjit.cli import commands, info

MODELS = Path(__file__).parents[2] / "models"


def run(*arguments):
    return CliRunner().invoke(commands.program, ["info", *map(str, arguments)])


def told(file, *options):
    result = run(file, "--json", *options)
    assert (result.exit_code, result.stderr) == (0, "")
    return json.loads(result.stdout)


def printed(file):
    result = run(file)
    assert (result.exit_code, result.stderr) == (0, "")
    rows = [line.partition("  ") for line in result.stdout.splitlines()]
    return {name.strip(): text.strip() for name, _, text in rows}


def test_counts_and_bounds_are_those_of_the_scene():
    file = MODELS / "scene.glb"
    scene, held = rj.load(file), told(file)
    meshes = {id(node.mesh): node.mesh for node in scene.nodes}.values()
    assert held["objects"] == len(scene.nodes) == 6
    assert held["meshes"] == len(meshes) < held["objects"]
    assert held["faces"] == sum(len(mesh.faces) for mesh in meshes) < held["faces_drawn"]
    assert held["vertices"] == sum(len(mesh.vertices) for mesh in meshes)
    low, high = scene.bounds()
    assert (held["bounds"]["min"], held["bounds"]["max"]) == (low.tolist(), high.tolist())
    assert held["radius"] == scene.bounding_sphere()[1]
    assert sum(one["objects"] for one in held["materials"]) == 6
    assert held["textures"] == {"count": 1, "texels": 64 * 64}
    assert [one["kind"] for one in held["lights"]] == [type(one).__name__ for one in scene.lights]
    assert held["lights"][0]["direction"] == list(scene.lights[0].direction)
    assert held["camera"]["eye"] == list(scene.camera.eye)
    assert held["warnings"] == []


def test_what_is_printed_is_what_json_holds():
    rows = printed(MODELS / "scene.glb")
    assert rows["objects"] == "6 of 4 meshes"
    assert rows["faces"] == "2,234, 2,258 in all objects"
    assert rows["attributes"] == "normals 4 of 4, uv 1 of 4, vertex colors 1 of 4"
    assert "blend" in rows["material 2"]
    assert "base color texture 64x64 (3 objects)" in rows["material 1"]
    assert rows["light 1"].startswith("PointLight: position (2.5, 3, 2.5)")
    assert rows["camera"].startswith("PerspectiveCamera: eye (3.5, 3.2, 7)")
    rows = printed(MODELS / "cube.ply")
    assert rows["size"] == "2 x 2 x 2 units"
    assert rows["bounds"] == "(-1, -1, -1) to (1, 1, 1)"
    assert (rows["lights"], rows["camera"], rows["textures"]) == ("none",) * 3
    assert rows["attributes"] == "normals, vertex colors"


def test_nodes_have_the_names_that_find_takes_and_hang_below_their_parents():
    file = MODELS / "scene.glb"
    scene, nodes = rj.load(file), told(file)["nodes"]
    assert len(nodes) == 7
    for one in nodes:
        found = scene.find(one["name"])
        above = None if one["parent"] is None else nodes[one["parent"]]["name"]
        assert above == (found.parent and found.parent.name)
        if one["object"] is None:
            assert (found.mesh, one["faces"]) == (None, 0)
        else:
            assert scene.nodes[one["object"]] is found
            assert one["faces"] == len(found.mesh.faces)
    rows = run(file).stdout.splitlines()
    start = rows.index("node 0           'ground': object 0, 2 faces")
    assert [row[17:] for row in rows[start + 1 : start + 4]] == [
        "'tower': group",
        "  'crate_base': object 1, 12 faces",
        "    'crate_top': object 2, 12 faces",
    ]


def test_own_attributes_have_the_names_that_outputs_take(tmp_path):
    corners, face = np.eye(3), [[0, 1, 2]]
    material = rj.Material(shading="pbr")
    scene = rj.Scene()
    for columns in (1, 1, 3):
        values = {"heat\x1b": np.ones((3, columns)), "a": np.ones((3, 2))}
        scene.add(rj.Mesh(corners, face, material=material, attributes=values))
    scene.add(rj.Mesh(corners, face, material=material))
    held = info.describe_scene(scene)
    assert [list(one.values()) for one in held["attribute_outputs"]] == [
        ["attribute:a", 2, "vertices", 3],
        ["attribute:heat\x1b", 1, "vertices", 2],
        ["attribute:heat\x1b", 3, "vertices", 1],
    ]
    rows = [*info._format_rows({"file": "a", "bytes": 1, "left_out": [], "warnings": [], **held})]
    assert [text for name, text in rows if name.startswith("own attribute")] == [
        "'attribute:a': 2 columns of vertices, 3 of 4 meshes",
        "'attribute:heat\\x1b': 1 column of vertices, 2 of 4 meshes",
        "'attribute:heat\\x1b': 3 columns of vertices, 1 of 4 meshes",
    ]
    alone = rj.Scene()
    alone.add(rj.Mesh(corners, face, material=material, attributes={"load": [[0.5]]}))
    (one,) = info.describe_scene(alone)["attribute_outputs"]
    assert (one["output"], one["of"]) == ("attribute:load", "faces")
    alone.nodes[0].mesh = rj.Mesh(corners, face, material=material, attributes={"heat": corners})
    alone.save(tmp_path / "h.glb")
    (one,) = told(tmp_path / "h.glb")["attribute_outputs"]
    frame = rj.render(rj.load(tmp_path / "h.glb"), size=(8, 8), outputs=one["output"])
    assert frame.attribute("heat").shape == (8, 8, one["columns"])
    rows = printed(tmp_path / "h.glb")
    assert rows["own attribute 0"] == "'attribute:heat': 3 columns of vertices"


def test_of_many_nodes_the_first_are_printed_and_deep_trees_are_no_burden():
    scene = rj.Scene()
    node = scene.add(rj.Node(name="joint 0"))
    for number in range(1, 3000):
        node = rj.Node(name=f"joint {number}", parent=node)
    rj.Node(rj.load(MODELS / "cube.ply").nodes[0].mesh, name="hand", parent=node)
    held = info.describe_scene(scene)
    assert len(held["nodes"]) == 3001
    assert [one["parent"] for one in held["nodes"]] == [None, *range(3000)]
    assert held["nodes"][-1]["object"] == 0
    rows = dict(
        info._format_rows({"file": "a", "bytes": 1, "left_out": [], "warnings": [], **held})
    )
    assert rows["nodes"] == "2,981 more: see --json"
    assert rows["node 19"].strip() == "'joint 19': group"


def test_joints_are_told_with_their_limits():
    pytest.importorskip("yourdfpy")
    arm = MODELS.parent / "docs" / "examples" / "arm.urdf"
    scene, held = rj.load(arm), told(arm)["joints"]
    assert [one["name"] for one in held] == list(scene.joints)
    assert held[0]["limits"] == [None, None]
    assert held[3]["limits"] == list(scene.joints["reach"].limits)
    rows = printed(arm)
    assert rows["joint 0"] == "'turn': continuous of 'shoulder'"
    assert rows["joint 3"] == "'reach': prismatic of 'piston', 0..0.15"


def test_cameras_of_every_kind_can_be_told_as_json():
    scene = rj.load(MODELS / "cube.ply")
    scene.lights = [rj.SpotLight((0, 1, 2), shadow=rj.Shadow()), rj.AmbientLight()]
    for camera in (
        rj.PerspectiveCamera((0, 0, 5), (0, 0, 0)),
        rj.OrthographicCamera((0, 0, 5), (0, 0, 0)),
        rj.MatrixCamera.from_intrinsics(50, 50, 24, 18, (48, 36)),
    ):
        scene.camera = camera
        held = json.loads(json.dumps(info.describe_scene(scene), allow_nan=False))
        assert held["camera"]["kind"] == type(camera).__name__
        rows = dict(
            info._format_rows({"file": "a", "bytes": 1, "left_out": [], "warnings": [], **held})
        )
        assert rows["camera"].startswith(f"{type(camera).__name__}: ")
        assert "shadow" in rows["light 0"]


def test_what_is_left_out_and_invalid_is_told(tmp_path):
    mesh = tmp_path / "lost.obj"
    lines = ("v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 nan 0", "surf 0", "f 1 2 3", "f 1 2 4", "")
    mesh.write_text("\n".join(lines))
    result = run(mesh)
    assert result.exit_code == 1
    assert "--on-invalid drop" in result.stderr
    held = told(mesh, "--on-invalid", "drop")
    (said,) = held["warnings"]
    assert said == "left out surface (1); the rest is there"
    assert held["invalid_vertices"] == 1
    assert held["left_out"] == [{"what": "surface", "count": 1}]
    printed = run(mesh, "--on-invalid", "drop").stdout.splitlines()
    (row,) = (line for line in printed if "left out" in line)
    assert row.split() == ["left", "out", "surface", "(1)"]


def test_a_file_that_is_read_whole_leaves_out_nothing(tmp_path):
    mesh = tmp_path / "whole.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert told(mesh)["left_out"] == []
    (row,) = (line for line in run(mesh).stdout.splitlines() if "left out" in line)
    assert row.split() == ["left", "out", "nothing"]


def test_points_and_segments_are_counted_apart_from_faces(tmp_path):
    mesh = tmp_path / "mixed.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nl 1 2 3 1\np 1 2\n")
    held = told(mesh)
    assert [held[name] for name in ("faces", "segments", "points")] == [1, 3, 2]
    assert [node["segments"] for node in held["nodes"]] == [0, 3, 0]
    printed = run(mesh).stdout.splitlines()
    assert [line.split()[1] for line in printed if line.split()[0] in ("segments", "points")] == [
        "3",
        "2",
    ]
    assert any("'lines': object 1, 3 segments" in line for line in printed)


def test_many_materials_are_counted_and_all_in_json(tmp_path):
    names = [f"m{n}" for n in range(30)]
    lines = ["mtllib a.mtl"]
    rng = np.random.default_rng(1)
    for number, name in enumerate(names):
        lines += [f"v {x} {y} {z}" for x, y, z in rng.random((3, 3)).round(3).tolist()]
        lines += [f"usemtl {name}", f"f {3 * number + 1} {3 * number + 2} {3 * number + 3}"]
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    parts = [f"newmtl {name}\nKd 0.{n:02d} 0.5 0.5\n" for n, name in enumerate(names)]
    (tmp_path / "a.mtl").write_text("".join(parts))
    assert len(told(tmp_path / "a.obj")["materials"]) == 30
    assert printed(tmp_path / "a.obj")["materials"] == "10 more: see --json"


@pytest.mark.parametrize("name", ["nowhere.obj", "text.txt"])
def test_what_is_no_mesh_is_one_line(tmp_path, name):
    (tmp_path / "text.txt").write_text("hello")
    result = run(tmp_path / name)
    assert result.exit_code == 1
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert name in result.stderr
