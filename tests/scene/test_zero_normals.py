"""Normals of length 0 are made from the faces around, whatever way they come in."""

import warnings

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning

BALL = trimesh.creation.icosphere(2)
PLACES, FACES = np.array(BALL.vertices), np.array(BALL.faces)
IS_ZERO = np.linalg.norm(PLACES - (0, 0, 1), axis=1) < 0.5
NORMALS = np.where(IS_ZERO[:, None], 0.0, PLACES)
ZEROS = int(IS_ZERO.sum())
CLOSE = 1e-6
"""A few units in the last place of float32."""


def rows(name, values):
    """Return lines of an OBJ file."""
    return "".join(f"{name} {x} {y} {z}\n" for x, y, z in values)


def obj(folder, normals):
    path = folder / "ball.obj"
    corners = "".join("f " + " ".join(f"{n}//{n}" for n in face) + "\n" for face in FACES + 1)
    path.write_text(rows("v", PLACES) + rows("vn", normals) + corners)
    return path


def ply(folder, normals):
    path = folder / "ball.ply"
    columns = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex {len(PLACES)}\n{columns}element face {len(FACES)}\n"
        "property list uchar int vertex_indices\nend_header\n"
        + "".join(" ".join(map(str, row)) + "\n" for row in np.c_[PLACES, normals].tolist())
        + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)
    )
    return path


def glb(folder, normals):
    path = folder / "ball.glb"
    trimesh.Trimesh(PLACES, FACES, vertex_normals=normals, process=False).export(path)
    return path


def as_trimesh(folder, normals):
    return trimesh.Trimesh(PLACES, FACES, vertex_normals=normals, process=False)


@pytest.mark.parametrize("way", [obj, ply, glb, as_trimesh])
def test_files_and_objects_of_trimesh_say_once_how_many_normals_were_made(tmp_path, way):
    with pytest.warns(LoadWarning, match="normals of length 0 of") as caught:
        (node,) = rj.load(way(tmp_path, NORMALS)).nodes
    (one,) = caught
    assert f"({ZEROS})" in str(one.message)
    assert list(one.message.left_out.values()) == [ZEROS]
    radial = node.mesh.vertices / np.linalg.norm(node.mesh.vertices, axis=1, keepdims=True)
    assert (node.mesh.normals * radial).sum(axis=1).min() > 0.98


@pytest.mark.parametrize("way", [obj, ply, glb, as_trimesh])
def test_a_file_whose_normals_are_all_zero_has_none(tmp_path, way):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LoadWarning)
        (node,) = rj.load(way(tmp_path, 0.0 * NORMALS), crease_angle=0.0).nodes
    faced = node.mesh.normals[node.mesh.faces]
    assert (faced == faced[:, :1]).all()


def test_normals_of_a_mesh_are_averages_of_faces_and_others_keep_their_bits():
    with pytest.warns(UserWarning, match=rf"^{ZEROS} normals of length 0 of Mesh\(162 vertices"):
        mesh = rj.Mesh(PLACES, FACES, normals=NORMALS)
    plain = rj.Mesh(PLACES, FACES)
    assert np.array_equal(mesh.normals[IS_ZERO], plain.vertex_normals()[IS_ZERO])
    assert np.array_equal(mesh.normals[~IS_ZERO], PLACES[~IS_ZERO].astype(np.float32))


def test_vertices_of_no_face_and_of_faces_without_area_are_left_alone():
    places = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (5, 5, 5), (2, 0, 0)]
    normals = [(0, 0, 1)] * 3 + [(0, 0, 0)] * 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = rj.Mesh(places, [(0, 1, 2), (0, 1, 4)], normals=normals)
    assert not mesh.normals[3:].any()


def turned(order, normals=None):
    """Return a ball of faces that are there both ways round, in an order."""
    faces = np.stack([FACES, FACES[:, ::-1]])
    if order == "in turn":
        faces = faces.transpose(1, 0, 2)
    return rj.Mesh(PLACES, faces.reshape(-1, 3), normals=normals)


@pytest.mark.parametrize("order", ["side by side", "in turn"])
def test_faces_that_cancel_have_the_normals_of_the_side_that_comes_first(order):
    plain = rj.Mesh(PLACES, FACES).vertex_normals()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.allclose(turned(order).vertex_normals(), plain, atol=CLOSE)
    with pytest.warns(UserWarning, match=rf"^{ZEROS} normals of length 0 of Mesh\("):
        mesh = turned(order, NORMALS)
    assert np.allclose(mesh.normals[IS_ZERO], plain[IS_ZERO], atol=CLOSE)


@pytest.mark.parametrize("size", [1e-30, 1.0, 1e30])
@pytest.mark.parametrize("normals", [None, np.zeros((8, 3))])
@pytest.mark.filterwarnings("ignore:.* of length 0:UserWarning")
def test_a_sheet_of_both_sides_is_lit_beside_faces_of_any_size(size, normals):
    square = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    places = np.concatenate([square, size * square - (0, 0, 3 * size)])
    both = np.concatenate([faces, faces[:, ::-1], faces + 4])
    mesh = rj.Mesh(places, both, normals=normals, material=rj.Material("phong"))
    assert np.array_equal(mesh.vertex_normals(), [(0, 0, 1)] * 8)
    for side in (1, -1):
        camera = rj.OrthographicCamera((0, 0, 2 * side), (0, 0, 0), height=1.0, near=0.1, far=3.0)
        frame = rj.render(
            rj.Mesh(square, both[:4], material=rj.Material("phong")), camera, size=(8, 8),
            outputs=("color", "normal"),
        )  # fmt: skip
        assert frame.color[..., :3].min() > 100
        assert np.abs(frame.normal[..., 2]).min() == 1.0


def test_normals_are_means_of_the_faces_around_by_area():
    random = np.random.default_rng(5)
    places, faces = random.normal(size=(40, 3)), random.integers(0, 40, (300, 3))
    sums = np.zeros((40, 3))
    for face in faces:
        a, b, c = places[np.roll(face, -np.lexsort(places[face].T[::-1])[0])]
        for corner in face:
            sums[corner] += np.cross(b - a, c - a)
    sums /= np.linalg.norm(sums, axis=1, keepdims=True)
    assert np.abs(rj.Mesh(places, faces).vertex_normals() - sums).max() < CLOSE


def test_normals_that_are_not_finite_are_refused_as_ever():
    with pytest.raises(ValueError, match="normals must be finite"):
        rj.Mesh(PLACES, FACES, normals=np.where(IS_ZERO[:, None], np.nan, PLACES))


def test_points_and_lines_keep_normals_of_length_0():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        points = rj.Points(PLACES, normals=NORMALS)
    assert not points.normals[IS_ZERO].any()


CAMERA = rj.PerspectiveCamera((0, 0, 4), (0, 0, 0))


def drawn(scene):
    """Return the lengths of the normals that are seen, and what was said of them."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        frame = rj.render(scene, CAMERA, size=(40, 40), outputs=("normal", "object_id"))
    lengths = np.linalg.norm(frame.normal[frame.object_id >= 0], axis=-1)
    return lengths, [str(one.message) for one in caught if "length 0" in str(one.message)]


def test_made_normals_follow_a_skin():
    with pytest.warns(UserWarning, match="normals of length 0"):
        mesh = rj.Mesh(
            PLACES, FACES, normals=NORMALS, joints=np.zeros((len(PLACES), 1), int),
            weights=np.ones((len(PLACES), 1)),
        )  # fmt: skip
    scene, joint = rj.Scene(), rj.Node()
    scene.add(rj.Node(mesh, skin=rj.Skin([joint])))
    joint.transform = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.diag([1.0, 1.0, -1.0, 1.0])
    lengths, said = drawn(scene)
    assert lengths.min() > 0.99
    assert not said


def test_normals_that_a_morph_target_takes_away_are_made_and_told_of_once():
    away = np.where(IS_ZERO[:, None], -PLACES, 0.0)[None]
    targets = rj.MorphTargets(np.zeros((1, *PLACES.shape)), normals=away, weights=[1.0])
    scene = rj.Scene()
    scene.add(rj.Mesh(PLACES, FACES, normals=PLACES, morph_targets=targets))
    lengths, said = drawn(scene)
    assert lengths.min() > 0.99
    assert len(said) == 1
    assert said[0].startswith(f"{ZEROS} normals of length 0 of Mesh(162 vertices")
    scene.nodes[0].weights = [1.0 + 2.0**-52]
    assert drawn(scene)[1] == []
