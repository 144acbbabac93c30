"""What is handed to trimesh comes back as it was, or is named."""

import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.io.load_warnings import SaveWarning
from rasterjit.transforms import compose, rotate_x, rotate_z, scale, translate

MODELS = Path(__file__).parents[2] / "models"

GEOMETRY = (
    "depth", "face_id", "object_id", "instance_id", "material_id", "barycentric", "position",
    "normal", "geometric_normal", "uv",
)  # fmt: skip


def picture(seed, channels=3):
    return np.random.default_rng(seed).integers(0, 256, (8, 4, channels), dtype=np.uint8)


def colors(rows, seed=3):
    return np.random.default_rng(seed).integers(0, 256, (rows, 4), dtype=np.uint8)


def sphere(**options):
    ball = trimesh.creation.icosphere(2)
    return rj.Mesh(ball.vertices * 0.1, ball.faces, **options)


def quad(**options):
    corners = [(-0.1, -0.1, 0), (0.1, -0.1, 0.03), (0.1, 0.1, 0), (-0.1, 0.1, 0)]
    return rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], uv=[(0, 0), (1.5, 0.1), (1, 1), (0, 1)],
                   **options)  # fmt: skip


def rich_scene():
    """Return a scene with all that trimesh has a place for, in 8 bits where that has no more."""
    scene = rj.Scene()
    byte = 1 / 255.0
    maps = {
        "base_color_texture": rj.Texture(picture(0, 4)),
        "normal_texture": rj.Texture(picture(1), color_space="linear"),
        "metallic_roughness_texture": rj.Texture(picture(2), color_space="linear"),
        "emissive_texture": rj.Texture(picture(4)),
    }
    shiny = rj.Material(
        "pbr", (51 * byte, 102 * byte, 1.0, 0.4), metallic=0.75, roughness=0.3, name="mapped",
        emissive=(2.0, 1.0, 0.5), double_sided=False, alpha_mode="blend", **maps,
    )  # fmt: skip
    wall = scene.add(quad(material=shiny), compose(translate((0.1, 0, 0)), rotate_x(20)), "wall")
    elbow = rj.Node(None, translate((0.3, 0, 0)), "elbow", parent=wall)
    heat = np.random.default_rng(8).random((162, 3), dtype=np.float32)
    ball = sphere(colors=colors(162), attributes={"heat": heat, "label": np.arange(320)[:, None]})
    scene.add(ball, compose(scale((1, 1.5, 1)), rotate_z(10)), "ball", parent=elbow)
    scene.add(ball, translate((-0.3, 0, 0)), "other ball", parent=wall)
    scene.add(sphere(colors=colors(320)), translate((0, 0.3, 0)), "patchwork")
    wood = rj.Material("phong", "#804020", specular=float(rj.Mesh(
        np.eye(3), [(0, 1, 2)], colors=np.full((3, 3), 90, np.uint8)).vertex_colors[0, 0]),
        shininess=30.0, base_color_texture=rj.Texture(picture(5)), name="wood")  # fmt: skip
    scene.add(quad(material=wood, colors=colors(4)), translate((0, -0.3, 0)), "board")
    scene.add(sphere(), translate((-0.3, -0.3, 0)), "plain")
    gold = rj.Material("pbr", metallic=0.5, name="gold")
    scene.add(sphere(colors=colors(162), material=gold), translate((0.5, 0, 0)), "dyed")
    scene.lights += [
        rj.DirectionalLight((0.3, -0.4, -0.8), (1.0, 51 * byte, 0.0), 0.75),
        rj.PointLight((2, 2, 3), "white", 4.0),
        rj.SpotLight((-1, 1, 2), (0.3, -0.4, -0.7), intensity=5.0, inner_angle=10, outer_angle=35),
    ]
    scene.camera = rj.PerspectiveCamera((0.1, 0.2, 2), (0, 0, 0), (0.1, 1, 0), 40.0, 0.5, 50.0)
    return scene


def test_what_trimesh_has_a_place_for_is_drawn_as_it_was():
    scene = rich_scene()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = scene.to_trimesh()
    assert made.graph.transforms.parents["ball"] == "elbow"
    assert len(made.geometry) == 6
    again = rj.load(made)
    assert [node.name for node in again.nodes] == [node.name for node in scene.nodes]
    for one, other in zip(again.nodes, scene.nodes, strict=True):
        np.testing.assert_array_equal(one.world_matrix, other.world_matrix)
        np.testing.assert_array_equal(one.mesh.vertices, other.mesh.vertices)
        np.testing.assert_array_equal(one.mesh.faces, other.mesh.faces)
        for kind in ("vertex_attributes", "face_attributes"):
            found, wanted = getattr(one.mesh, kind), getattr(other.mesh, kind)
            assert found.keys() == wanted.keys()
            for name in found:
                np.testing.assert_array_equal(found[name], wanted[name])
    options = {"size": (96, 72), "outputs": (*GEOMETRY, "color", "linear")}
    wanted = rj.render(scene, **options)
    found = rj.render(again, scene.camera, **options)
    assert set(np.unique(wanted.object_id)) == {-1, *range(len(scene.nodes))}
    for name in GEOMETRY:
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), name)
    np.testing.assert_allclose(found.linear, wanted.linear, rtol=0, atol=2e-6)
    by_its_camera = rj.render(again, size=(96, 72))
    assert (by_its_camera.color != wanted.color).any(axis=2).mean() < 0.01


def tree(scene):
    """Return what each node hangs below, and where."""
    return {
        node.name: (node.parent and node.parent.name, node.transform.round(6).tolist())
        for node in scene.every_node()
    }


def test_what_hangs_below_what_comes_back():
    scene = rich_scene()
    again = rj.load(scene.to_trimesh())
    assert [node.name for node in again.nodes] == [node.name for node in scene.nodes]
    assert tree(again) == tree(scene)
    assert tree(again)["ball"][0] == "elbow"
    elbow = again.find("elbow")
    before = again.find("ball").world_matrix
    elbow.transform = compose(elbow.transform, rotate_z(90))
    assert not np.allclose(again.find("ball").world_matrix, before)


def test_trimesh_scenes_of_a_file_hang_together_as_the_file_does():
    path = MODELS / "scene.glb"
    loaded, wanted = trimesh.load_scene(path), rj.load(path)
    found = rj.load(loaded)
    assert tree(found) == tree(wanted)
    assert [node.name for node in found.nodes] == list(loaded.graph.nodes_geometry)
    for node in found.nodes:
        np.testing.assert_allclose(node.world_matrix, loaded.graph[node.name][0], atol=1e-6)
    joined = rj.Scene()
    with pytest.warns(rj.LoadWarning, match="DirectionalLight|camera"):
        group = joined.add(loaded, name="crates")
    assert joined.find("crate_top").parent is joined.find("crate_base")
    assert joined.find("crate_base").parent.parent is group
    assert [node.name for node in joined.nodes] == [node.name for node in found.nodes]


def test_objects_of_trimesh_keep_their_numbers_whatever_they_hang_below():
    made = trimesh.Scene()
    made.geometry["box"] = trimesh.creation.box()
    # trimesh lists nodes in the order in which it first hears of them.
    made.graph.transforms.node_data["tip"]["geometry"] = "box"
    made.graph.update("arm", "world", matrix=translate((0, 2, 0)), geometry="box")
    made.graph.update("tip", "arm", matrix=translate((1, 0, 0)), geometry="box")
    made.graph.update("lid", "world", matrix=np.eye(4), geometry="box")
    made.graph.update("base of none", "world", matrix=np.eye(4))
    assert list(made.graph.nodes_geometry) == ["tip", "arm", "lid"]
    scene = rj.load(made)
    assert [node.name for node in scene.nodes] == ["tip", "arm", "lid"]
    assert scene.find("tip").parent is scene.find("arm")
    assert scene.find("arm").parent is None
    assert scene.find("tip").world_matrix[:3, 3].tolist() == [1, 2, 0]
    assert set(tree(scene)) == {"tip", "arm", "lid"}
    joined = rj.Scene()
    joined.add(made, name="all")
    assert [node.name for node in joined.nodes] == ["tip", "arm", "lid"]


@pytest.mark.parametrize("without_scipy", [False, True])
def test_normals_that_trimesh_averaged_are_told_from_given_ones_without_scipy(without_scipy):
    blocked = "sys.modules['scipy'] = sys.modules['scipy.sparse'] = None\n" * without_scipy
    code = f"""if True:
        import sys
        {blocked.replace(chr(10), "; ")}
        import numpy as np, trimesh
        import rasterjit as rj
        read = trimesh.load({str(MODELS / "scene.glb")!r})
        wanted = rj.load({str(MODELS / "scene.glb")!r})
        assert any("vertex_normals" in one._cache for one in read.geometry.values())
        found = rj.load(read)
        for node in found.nodes:
            other = wanted.find(node.name).mesh
            np.testing.assert_allclose(node.mesh.normals, other.normals, atol=1e-6)
    """
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")


def test_averaged_normals_are_not_a_meshs_own():
    box = trimesh.creation.box()
    assert len(box.vertex_normals) == 8
    assert len(rj.load(box).nodes[0].mesh.vertices) == 24
    given = trimesh.Trimesh(box.vertices, box.faces, process=False,
                            vertex_normals=box.vertex_normals.astype(np.float32))  # fmt: skip
    assert len(rj.load(given).nodes[0].mesh.vertices) == 8


def test_a_mesh_becomes_a_trimesh_of_the_same_vertices_and_faces():
    given = colors(320)
    made = sphere(colors=given).to_trimesh()
    assert type(made) is trimesh.Trimesh
    np.testing.assert_array_equal(made.visual.face_colors, given)
    np.testing.assert_array_equal(made.vertices, sphere().vertices)
    np.testing.assert_allclose(made.vertex_normals, sphere().vertex_normals(), atol=0.001)
    assert made.volume == pytest.approx(trimesh.creation.icosphere(2).volume * 0.001)
    cube = rj.load(trimesh.creation.box()).nodes[0].mesh
    again = rj.load(cube.to_trimesh()).nodes[0].mesh
    np.testing.assert_array_equal(again.normals, cube.normals)


def test_large_meshes_are_handed_over():
    ball = trimesh.creation.icosphere(7)
    mesh = rj.Mesh(ball.vertices, ball.faces, colors=colors(len(ball.vertices)))
    assert len(mesh.vertices) > 65536
    np.testing.assert_array_equal(mesh.to_trimesh().visual.vertex_colors, colors(163842))


def test_what_trimesh_has_no_place_for_is_named_in_one_warning():
    scene = rich_scene()
    sampled = rj.Texture(picture(6), filter="nearest", uv_set=1)
    scene.add(quad(material=rj.Material("unlit", base_color_texture=sampled, emissive="red",
                                        double_sided=False), uv1=np.eye(4)[:, :2]))  # fmt: skip
    scene.add(sphere(material=rj.Material("pbr", "red"), colors=np.full((320, 3), 0.3)), name="red")
    bumps = rj.Texture(picture(7), color_space="linear")
    bumpy = rj.Material(
        "pbr", "#405060", normal_texture=bumps, normal_scale=2.0, clearcoat=0.5,
        sheen_color="white", ior=1.4,
    )  # fmt: skip
    scene.add(quad(material=bumpy), name="board")
    scene.lights[1] = rj.PointLight((0, 0, 1), range=3.0, shadow=rj.Shadow())
    scene.lights.append(rj.AmbientLight())
    scene.tone_map = rj.ToneMap()
    scene.camera = rj.OrthographicCamera((0, 0, 1), (0, 0, 0))
    with pytest.warns(SaveWarning) as caught:
        made = scene.to_trimesh()
    (said,) = caught
    assert said.filename == __file__
    for words in (
        "unlit shading", "emission", "single-sidedness", "uv1",
        "how a base_color_texture is sampled", "uv_set of a base_color_texture",
        "colours, to 8 bits", "material beside colours of faces",
        "normal_scale", "clearcoat", "sheen", "specular and ior", "base colours, to 8 bits",
        "name of a node that another has", "range of a PointLight",
        "shadow of a PointLight", "AmbientLight", "OrthographicCamera",
        "tone_map",
    ):  # fmt: skip
        assert words in str(said.message), words
    assert {"board", "board 2"} <= set(made.graph.nodes_geometry)
    with pytest.warns(SaveWarning) as caught:
        scene.nodes[-1].mesh.to_trimesh()
    assert (len(caught), caught[0].filename) == (1, __file__)


def test_a_camera_that_fits_any_picture_is_one_of_its_angle():
    scene = rich_scene()
    scene.camera = replace(scene.camera, min_aspect=1.5)
    with pytest.warns(SaveWarning, match="for min_aspect of the camera; all else"):
        scene.to_trimesh()
