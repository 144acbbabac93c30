"""What a renderer keeps between frames is never out of date, and is kept."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.outputs.output_table import OUTPUTS
from rasterjit.survey import cache, object_transforms, packed_scene
from rasterjit.survey.object_counts import Inventory

SIZE = (48, 40)

SAME = rj.PreviousView()
"""An earlier view in which everything is as it is: outputs of motion need one."""


def everything(frame):
    return {name: array.tobytes() for name, array in frame.arrays().items()}


def painted(mesh, shading="phong", texels=((0.9, 0.1), (0.2, 0.6)), **options):
    """Return a mesh with scalars under a texture."""
    texture = rj.Texture(np.array(texels), filter="nearest")
    material = rj.Material(shading, base_color_texture=texture, **options)
    uv = mesh.vertices[:, :2] * 0.5 + 0.5
    scalars = mesh.vertices[:, 2]
    return rj.Mesh(mesh.vertices, mesh.faces, uv=uv, scalars=scalars, material=material)


@pytest.fixture
def scene(cube, sphere):
    """Two instances of a cube, a textured ball and a coloured cube, with a lamp."""
    scene = rj.Scene()
    scene.add(cube)
    scene.add(cube, rj.transforms.translate((1.5, 0.3, -1.0)))
    scene.add(painted(sphere), rj.transforms.translate((-0.6, 0.8, 1.4)))
    colors = np.linspace(0.1, 0.9, 24).reshape(8, 3)
    coloured = rj.Mesh(cube.vertices, cube.faces, colors=colors)
    scene.add(coloured, rj.transforms.translate((0.5, -1.0, 1.0)))
    scene.lights = [rj.PointLight((4.0, 5.0, 6.0), intensity=30.0)]
    return scene


def set_color(scene):
    scene.nodes[0].mesh.material = rj.Material("phong", "red")


def move(scene):
    scene.nodes[1].world_from_model = rj.transforms.translate((-1.0, 1.0, 0.5))


def test_wireframe_is_that_of_the_mesh_shown(cube, sphere, camera):
    scene = rj.Scene()
    node = scene.add(cube)
    scene.wireframe = rj.Wireframe("red", "only")
    with rj.Renderer(SIZE, threads=1) as renderer:
        renderer.render(scene, camera)
        node.mesh = sphere
        frame = renderer.render(scene, camera)
    assert everything(frame) == everything(rj.render(scene, camera, size=SIZE, threads=1))


def test_what_has_not_changed_is_made_once(scene, camera, monkeypatch):
    modules = dict.fromkeys(
        ["join_geometry", "join_surface", "join_normals", "join_uv"], packed_scene
    )
    modules["transform_objects"] = modules["move_objects"] = object_transforms
    counts = dict.fromkeys(modules, 0)

    def counted(name):
        original = getattr(modules[name], name)

        def count(*arguments):
            counts[name] += 1
            return original(*arguments)

        return count

    for name, module in modules.items():
        monkeypatch.setattr(module, name, counted(name))
    with rj.Renderer(SIZE, threads=1) as renderer:
        renderer.render(scene, camera, outputs=OUTPUTS, previous=SAME)
        first = dict(counts)
        for _ in range(3):
            renderer.render(scene, camera, outputs=OUTPUTS, previous=SAME)
        assert counts == first
        move(scene)
        renderer.render(scene, camera, outputs=OUTPUTS, previous=SAME)
        assert counts == {**first, "move_objects": first["move_objects"] + 1}
        set_color(scene)
        renderer.render(scene, camera, outputs=OUTPUTS, previous=SAME)
        assert counts["join_geometry"] == first["join_geometry"]
        assert counts["join_surface"] == first["join_surface"] + 1


def test_a_scene_that_failed_leaves_nothing_behind(scene, cube, camera):
    with rj.Renderer(SIZE, threads=1) as renderer:
        before = renderer.render(scene, camera)
        bad = rj.Mesh(cube.vertices, cube.faces, material=scene.nodes[2].mesh.material)
        for _ in range(2):
            with pytest.raises(ValueError, match="must have uv"):
                renderer.render(bad, camera)
        assert everything(renderer.render(scene, camera)) == everything(before)


# --- instances are joined at once -----------------------------------------------------------------


@pytest.mark.parametrize("order", ["000111222", "012012012", "001220110", "0", "1", "2222"])
def test_instances_are_joined_like_copies(cube, sphere, order):
    colored = rj.Mesh(sphere.vertices, sphere.faces,
                      colors=np.linspace(0, 1, len(sphere.faces) * 3).reshape(-1, 3))  # fmt: skip
    kinds = [cube, painted(sphere, "gouraud"), colored]
    instances = [kinds[int(digit)] for digit in order]
    copies = [copy.copy(mesh) for mesh in instances]
    for join in (
        packed_scene.join_geometry, packed_scene.join_normals, packed_scene.join_uv,
        packed_scene.join_textures,
        lambda meshes: packed_scene.join_surface(meshes, None),
    ):  # fmt: skip
        if join is packed_scene.join_textures and "1" not in order:
            continue
        one, other = join(instances), join(copies)
        for a, b in zip(one, other, strict=True):
            if isinstance(a, np.ndarray):
                assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
            else:
                assert a is b
    assert Inventory(instances).contents == Inventory(copies).contents


def test_joined_arrays_are_the_meshes_one_after_another(cube, sphere):
    meshes = [cube, cube, sphere, cube]
    arrays = packed_scene.join_geometry(meshes)
    assert arrays.positions.tobytes() == b"".join(mesh.vertices.tobytes() for mesh in meshes)
    for number, mesh in enumerate(meshes):
        first = arrays.vertex_starts[number]
        faces = arrays.faces[arrays.face_starts[number] : arrays.face_starts[number + 1]]
        assert np.array_equal(faces, mesh._faces_to_draw() + first)
    assert arrays.faces.dtype == np.int32


def test_object_numbers_find_the_object_of_a_face(cube, sphere):
    meshes = [cube, sphere, cube]
    numbers = cache.Shapes(meshes).object_numbers
    assert numbers.dtype == np.int32
    expected = np.repeat([0, 1, 2], [len(mesh.faces) for mesh in meshes])
    assert numbers[:-1].tolist() == expected.tolist()
    assert numbers[-1] == -1


# --- nothing that is kept can be written to -------------------------------------------------------


@pytest.mark.parametrize("copied", [lambda x: x, copy.copy, copy.deepcopy,
                                    lambda x: pickle.loads(pickle.dumps(x))])  # fmt: skip
def test_arrays_of_meshes_textures_and_nodes_cannot_be_written_to(cube, copied):
    mesh = rj.Mesh(
        cube.vertices, cube.faces, colors=np.ones((8, 3)), uv=np.zeros((8, 2)),
        material=rj.Material(base_color_texture=rj.Texture(np.ones((2, 2)))),
    )  # fmt: skip
    mesh.vertex_normals()
    mesh.material.base_color_texture.pyramid.levels()
    node = copied(rj.Node(mesh, np.eye(4), "box"))
    mesh = copied(node.mesh)
    texture = copied(mesh.material.base_color_texture)
    for array in (
        node.world_from_model, mesh.vertices, mesh.faces, mesh.vertex_colors, mesh.uv,
        mesh.vertex_normals(), texture.image, texture.levels[1],
    ):  # fmt: skip
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.flags.writeable = True
    with rj.Renderer(SIZE, threads=1) as renderer:
        assert renderer.render(mesh).color.any()


def test_edges_are_found_once_a_mesh(cube, camera, monkeypatch):
    found = []
    original = cache.find_unique_edges
    monkeypatch.setattr(cache, "find_unique_edges", lambda *a: found.append(1) or original(*a))
    scene = rj.Scene()
    scene.add(cube)
    scene.wireframe = rj.Wireframe()
    with rj.Renderer(SIZE, threads=1) as renderer:
        for _ in range(3):
            renderer.render(scene, camera)
    assert len(found) == 1


def test_frames_that_are_kept_are_not_looked_through_for_memory(cube, camera):
    size = (128, 128)
    with rj.Renderer(size, threads=1) as renderer:
        kept = [renderer.render(cube, camera, background="red") for _ in range(6)]
        blocks = renderer._workers.memory._blocks_by_size
        few = sum(map(len, blocks.values()))
        kept += [renderer.render(cube, camera, background="blue") for _ in range(20)]
        assert sum(map(len, blocks.values())) <= few
        # What is let go is what frames of before hold, and never written to again.
        alone = rj.render(cube, camera, size=size, background="red", threads=1)
        assert all(np.array_equal(frame.color, alone.color) for frame in kept[:6])
        del kept
        # A block that the last frame held is the next but one's.
        places = [renderer.render(cube, camera).color.ctypes.data for _ in range(6)]
        assert len(set(places)) < 4
