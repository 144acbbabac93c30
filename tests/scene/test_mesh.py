"""Laws of meshes: what is stored, what is refused, which way the normals point."""

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene import distinct_rows as rows_module
from rasterjit.scene import normals as normals_module
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
TWO_FACES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
NAN_CORNER = np.where(np.arange(4)[:, None] == 3, np.nan, SQUARE)


def cube():
    """Return a cube of 8 vertices and 12 outward faces."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return corners, np.array(faces)


def soup(vertices, faces):
    """Return the same triangles with vertices of their own, as an STL file has them."""
    return vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


# What is stored


def test_a_mesh_owns_its_arrays():
    vertices, faces = SQUARE.copy(), TWO_FACES.astype(np.int32)
    colors, normals, uv = np.ones((4, 4), np.float32), np.ones((4, 3)), np.zeros((4, 2), np.float32)
    mesh = Mesh(vertices, faces, colors=colors, normals=normals, uv=uv)
    faces[:] = 1 << 30
    vertices[:] = np.nan
    np.testing.assert_array_equal(mesh.faces, TWO_FACES)
    np.testing.assert_array_equal(mesh.vertices, SQUARE)
    for given, name in ((colors, "vertex_colors"), (normals, "normals"), (uv, "uv")):
        assert not np.shares_memory(given, getattr(mesh, name))
        with pytest.raises(ValueError, match="read-only"):
            getattr(mesh, name)[:] = 2.0
        with pytest.raises(AttributeError):
            setattr(mesh, name, given)
    with pytest.raises(AttributeError):
        mesh.faces = faces
    with pytest.raises(ValueError, match="material"):
        mesh.material = "red"


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32])
@pytest.mark.parametrize("face_dtype", [np.int8, np.int32, np.uint32, np.int64, np.float64])
def test_any_numeric_type_gives_the_stored_type(dtype, face_dtype):
    mesh = Mesh(SQUARE.astype(dtype), TWO_FACES.astype(face_dtype))
    assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float64, np.int32)
    assert np.array_equal(mesh.vertices, SQUARE)
    assert np.array_equal(mesh.faces, TWO_FACES)


@pytest.mark.parametrize(
    "layout",
    [
        np.asfortranarray,
        lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: a[::-1].copy()[::-1],
        lambda a: a[:, ::-1].copy()[:, ::-1],
        lambda a: a.tolist(),
    ],
)
def test_any_memory_layout_gives_the_same_mesh(layout):
    mesh = Mesh(layout(SQUARE), layout(TWO_FACES))
    assert mesh.vertices.flags.c_contiguous
    assert mesh.faces.flags.c_contiguous
    assert np.array_equal(mesh.vertices, SQUARE)
    assert np.array_equal(mesh.faces, TWO_FACES)


def test_read_only_arrays_are_taken():
    vertices, faces = SQUARE.copy(), TWO_FACES.copy()
    vertices.flags.writeable = faces.flags.writeable = False
    assert np.array_equal(Mesh(vertices, faces).vertices, SQUARE)


def test_without_extras_there_are_none():
    mesh = Mesh(SQUARE, TWO_FACES)
    assert (mesh.vertex_colors, mesh.face_colors, mesh.normals, mesh.uv) == (None,) * 4
    assert (mesh.material, mesh.invalid_vertices) == (Material(), 0)


def test_colours_by_vertex_and_by_face_are_told_apart_by_their_number():
    by_vertex = Mesh(SQUARE, TWO_FACES, colors=np.eye(4)[:, :3])
    assert by_vertex.vertex_colors.shape == (4, 4)
    assert by_vertex.face_colors is None
    by_face = Mesh(SQUARE, TWO_FACES, colors=np.array([[255, 0, 0], [0, 0, 255]], dtype=np.uint8))
    assert by_face.face_colors.tolist() == [[1, 0, 0, 1], [0, 0, 1, 1]]
    assert by_face.vertex_colors is None


def test_as_many_vertices_as_faces_means_colours_by_vertex():
    mesh = Mesh(SQUARE[:3], [[0, 1, 2]] * 3, colors=np.ones((3, 3)))
    assert mesh.vertex_colors is not None


def test_meshes_with_and_without_colours_have_the_same_material_unless_told():
    for colors in (None, np.ones((4, 3))):
        mesh = Mesh(SQUARE, TWO_FACES, colors=colors)
        assert mesh.material == Material()
        assert mesh.material.base_color is None


def test_given_normals_are_scaled_to_unit_length():
    given = [[0, 0, 5], [3e-200, 4e-200, 0], [-2, 0, 0], [0, -1e300, 0]]
    mesh = Mesh(SQUARE, TWO_FACES, normals=given)
    assert mesh.normals.dtype == np.float32
    expected = np.float32([[0, 0, 1], [0.6, 0.8, 0], [-1, 0, 0], [0, -1, 0]])
    assert np.array_equal(mesh.normals, expected)
    assert mesh.vertex_normals() is mesh.normals


def test_uv_is_stored_as_float32():
    mesh = Mesh(SQUARE, TWO_FACES, uv=SQUARE[:, :2] * 3)
    assert mesh.uv.dtype == np.float32
    assert np.array_equal(mesh.uv, SQUARE[:, :2] * 3)


# What is refused


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ([[0, 1, 4], [0, 7, 1], [0, 1, 2]], "2 of 3 faces past the end, the largest index being 7"),
        ([[0, 1, -1]], "faces must hold vertex numbers from 0, got 1 below, down to -1"),
        ([[0, 1, 1.5]], "faces must hold whole vertex numbers, got 1.5"),
        ([[0, 1, np.nan]], "faces must hold whole vertex numbers, got nan"),
        ([[0, 1, np.inf]], "faces must hold whole vertex numbers, got inf"),
        ([[0, 1, 2, 3]], r"faces must have shape \(n, 3\), got \(1, 4\)"),
        ([0, 1, 2], r"faces must have shape \(n, 3\), got \(3,\)"),
        ([], "there are no faces"),
        (np.zeros((0, 3), dtype=int), "there are no faces"),
        ([[True, False, True]], "faces must hold numbers, got an array of dtype bool"),
        ([["0", "1", "2"]], "faces must hold numbers"),
        ([[None, 1, 2]], "faces must hold numbers, got an array of dtype object"),
        ([[0, 1, 2], [0, 1]], "faces must be an array of numbers"),
        (np.array([[0, 1, 2**32]], dtype=np.uint64), "largest index being 4294967296"),
    ],
)
def test_bad_faces_are_refused_by_name(faces, message):
    with pytest.raises(ValueError, match=message):
        Mesh(SQUARE, faces)


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (SQUARE[:, :2], r"vertices must have shape \(n, 3\), got \(4, 2\)"),
        ([], "there are no vertices"),
        (SQUARE.astype(complex), "vertices must hold numbers, got an array of dtype complex"),
        (SQUARE > 0, "vertices must hold numbers, got an array of dtype bool"),
        (NAN_CORNER, "1 of 4 with NaN or infinity, the first being vertex 3.*on_invalid='drop'"),
        (SQUARE + [0, np.inf, 0], "4 of 4 with NaN or infinity, the first being vertex 0"),
    ],
)
def test_bad_vertices_are_refused_by_name(vertices, message):
    with pytest.raises(ValueError, match=message):
        Mesh(vertices, TWO_FACES)


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ({"colors": np.ones((3, 3))}, r"one row per vertex \(4\) or per face \(2\), got 3"),
        ({"colors": np.ones((4, 2))}, r"colors must have shape \(n, 3\) or \(n, 4\)"),
        ({"colors": np.full((4, 3), 255)}, "colors must lie in 0..1"),
        ({"normals": np.ones((3, 3))}, r"normals must have shape \(4, 3\), got \(3, 3\)"),
        ({"normals": np.full((4, 3), np.nan)}, "normals must be finite, got 4 rows"),
        ({"uv": np.ones((4, 3))}, r"uv must have shape \(4, 2\), got \(4, 3\)"),
        ({"uv": np.full((4, 2), np.inf)}, "uv must be finite"),
        ({"uv": np.full((4, 2), -4e38)}, r"uv must fit float32, got 4e\+38"),
        ({"material": "red"}, "material must be a Material, got 'red'"),
        ({"on_invalid": "fix"}, "on_invalid must be one of 'raise', 'drop'"),
    ],
)
def test_bad_extras_are_refused_by_name(extra, message):
    with pytest.raises(ValueError, match=message):
        Mesh(SQUARE, TWO_FACES, **extra)


def test_dropping_keeps_the_arrays_and_counts():
    mesh = Mesh(NAN_CORNER, TWO_FACES, on_invalid="drop")
    assert mesh.invalid_vertices == 1
    assert np.array_equal(mesh.faces, TWO_FACES)
    assert mesh.bounds()[1].tolist() == [1, 1, 0]
    assert np.isfinite(mesh.vertex_normals()).all()
    split = mesh.split_creases()
    assert (len(split.faces), split.invalid_vertices) == (2, 1)
    assert np.isfinite(split.normals).all()


def test_a_mesh_without_a_finite_vertex_has_no_bounds():
    mesh = Mesh(SQUARE * np.nan, TWO_FACES, on_invalid="drop")
    with pytest.raises(ValueError, match="mesh has no face with a finite vertex"):
        mesh.bounds()
    assert not mesh.vertex_normals().any()
    assert not mesh.split_creases().normals.any()


# Normals


def test_bounds_leave_out_vertices_of_no_face():
    mesh = Mesh(np.vstack([SQUARE, [[50, 50, 50]]]), TWO_FACES)
    assert [corner.tolist() for corner in mesh.bounds()] == [[0, 0, 0], [1, 1, 0]]


def test_counter_clockwise_faces_point_at_the_viewer():
    assert Mesh(SQUARE, TWO_FACES).vertex_normals().tolist() == [[0, 0, 1]] * 4
    assert Mesh(SQUARE, TWO_FACES[:, ::-1]).vertex_normals().tolist() == [[0, 0, -1]] * 4


def test_vertices_of_no_face_have_a_zero_normal():
    mesh = Mesh(np.vstack([SQUARE, [[5, 5, 5]]]), TWO_FACES)
    assert mesh.vertex_normals()[4].tolist() == [0, 0, 0]


def test_normals_are_averaged_by_area():
    # Around the origin: a face of area 2 facing z and one of area 1/2 facing x.
    vertices = [[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 1, 0], [0, 0, 1]]
    normals = Mesh(vertices, [[0, 1, 2], [0, 3, 4]]).vertex_normals()
    assert normals[0] == pytest.approx(np.array([1, 0, 4]) / np.sqrt(17), abs=1e-7)


@pytest.mark.parametrize("scale", [1e-160, 1e160, 1e308])
def test_normals_do_not_depend_on_units(scale):
    vertices, faces = cube()
    assert np.array_equal(
        Mesh(vertices * scale, faces).vertex_normals(), Mesh(vertices, faces).vertex_normals()
    )
    assert len(Mesh(vertices * scale, faces).split_creases().vertices) == 24


def test_normals_do_not_depend_on_the_chunk(monkeypatch):
    vertices, faces = cube()
    whole, split = Mesh(vertices, faces).vertex_normals(), Mesh(vertices, faces).split_creases()
    monkeypatch.setattr(normals_module, "_FACES_PER_CHUNK", 5)
    assert np.array_equal(Mesh(vertices, faces).vertex_normals(), whole)
    assert np.array_equal(Mesh(vertices, faces).split_creases().normals, split.normals)


# Creases


@pytest.mark.parametrize("arrange", [lambda v, f: (v, f), soup])
def test_a_cube_has_sharp_edges(arrange):
    vertices, faces = cube()
    mesh = Mesh(*arrange(vertices, faces)).split_creases(40.0)
    assert len(mesh.vertices) == 24
    assert np.array_equal(mesh.vertices[mesh.faces], vertices[faces])
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    assert np.array_equal(mesh.normals[mesh.faces], np.repeat(flat[:, None], 3, axis=1))


def test_a_wide_angle_smooths_a_cube():
    vertices, faces = cube()
    mesh = Mesh(vertices, faces).split_creases(180.0)
    assert np.array_equal(mesh.vertices, vertices)
    assert np.array_equal(mesh.normals, Mesh(vertices, faces).vertex_normals())


def test_an_angle_of_zero_keeps_faces_flat_and_planes_whole():
    assert len(Mesh(*soup(SQUARE, TWO_FACES)).split_creases(0.0).vertices) == 4
    vertices, faces = cube()
    assert len(Mesh(vertices, faces).split_creases(0.0).vertices) == 24


@pytest.mark.parametrize(("angle", "count"), [(29.0, 6), (31.0, 4)])
def test_the_angle_between_two_faces_decides(angle, count):
    fold = np.radians(30.0)
    vertices = [[0, 0, 0], [0, 1, 0], [-1, 0, 0], [np.cos(fold), 0, np.sin(fold)]]
    mesh = Mesh(vertices, [[0, 1, 2], [0, 3, 1]]).split_creases(angle)
    assert len(mesh.vertices) == count


def test_each_corner_averages_the_faces_near_its_own_only():
    # A fan around the z axis: faces turned by 0, 30 and 60 degrees, crease angle 40.
    turns = np.radians([0.0, 30.0, 60.0, 90.0])
    rim = np.column_stack([np.zeros(4), np.cos(turns), np.sin(turns)])
    vertices = np.vstack([[[0, 0, 0], [1, 0, 0]], rim])
    faces = [[0, 1, 2], [0, 1, 3], [0, 1, 4]]
    mesh = Mesh(vertices, faces).split_creases(40.0)
    at_origin = mesh.normals[mesh.faces[:, 0]]
    flat = np.column_stack([np.zeros(3), -np.sin(turns[:3]), np.cos(turns[:3])])
    expected = np.array([flat[0] + flat[1], flat.sum(axis=0), flat[1] + flat[2]])
    expected /= np.linalg.norm(expected, axis=1)[:, None]
    assert at_origin == pytest.approx(expected, abs=1e-7)


def test_smooth_surfaces_keep_their_vertices():
    u, v = np.meshgrid(np.linspace(0, 1, 20), np.linspace(0, 1, 20))
    vertices = np.column_stack([u.ravel(), v.ravel(), 0.1 * np.sin(3 * u).ravel()])
    a = (np.arange(19)[:, None] * 20 + np.arange(19)).ravel()
    faces = np.vstack([np.column_stack([a, a + 1, a + 21]), np.column_stack([a, a + 21, a + 20])])
    smooth = Mesh(vertices, faces).split_creases(40.0)
    assert np.array_equal(smooth.vertices, vertices)
    assert np.array_equal(smooth.faces, faces)
    assert np.array_equal(smooth.normals, Mesh(vertices, faces).vertex_normals())


def test_seams_of_colour_and_uv_are_no_creases():
    vertices, faces = soup(SQUARE, TWO_FACES)
    uv = np.arange(12).reshape(6, 2)
    mesh = Mesh(vertices, faces, uv=uv, colors=np.ones((6, 4))).split_creases()
    assert np.array_equal(mesh.uv, uv)
    assert mesh.vertex_colors.shape == (6, 4)
    assert mesh.normals.tolist() == [[0, 0, 1]] * 6


def test_split_vertices_carry_their_colours_and_uv_along():
    vertices, faces = cube()
    colors = np.linspace(0, 1, 24).reshape(8, 3)
    mesh = Mesh(vertices, faces, colors=colors, uv=vertices[:, :2]).split_creases()
    old = Mesh(vertices, faces, colors=colors, uv=vertices[:, :2])
    assert len(mesh.vertices) == 24
    assert np.array_equal(mesh.vertex_colors[mesh.faces], old.vertex_colors[old.faces])
    assert np.array_equal(mesh.uv[mesh.faces], old.uv[old.faces])


def test_splitting_keeps_face_colours_and_material():
    vertices, faces = cube()
    colors, material = np.linspace(0, 1, 36).reshape(12, 3), Material(shading="flat")
    mesh = Mesh(vertices, faces, colors=colors, material=material)
    split = mesh.split_creases()
    assert np.array_equal(split.face_colors, mesh.face_colors)
    assert split.material is material


def test_both_sides_of_a_sheet_keep_their_own_normal():
    mesh = Mesh(SQUARE, np.vstack([TWO_FACES, TWO_FACES[:, ::-1]])).split_creases()
    assert mesh.normals[mesh.faces[:, 0]].tolist() == [[0, 0, 1]] * 2 + [[0, 0, -1]] * 2


def test_faces_without_area_make_no_creases():
    faces = np.vstack([TWO_FACES, [[0, 2, 2], [1, 1, 1]]])
    mesh = Mesh(SQUARE, faces).split_creases()
    assert np.array_equal(mesh.faces, faces)
    assert mesh.normals.tolist() == [[0, 0, 1]] * 4


def test_the_tip_of_a_fine_cone_keeps_the_normals_of_its_faces():
    count = normals_module._MAX_NEIGHBOURS + 1
    turns = np.linspace(0, 2 * np.pi, count, endpoint=False)
    vertices = np.vstack([[[0, 0, 1]], np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])])
    rim = np.arange(1, count + 1)
    faces = np.column_stack([np.zeros(count, int), rim, np.roll(rim, -1)])
    mesh = Mesh(vertices, faces).split_creases()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1)[:, None]
    assert mesh.normals[mesh.faces[:, 0]] == pytest.approx(flat, abs=1e-7)


@pytest.mark.parametrize("angle", [-1.0, 181.0, np.nan])
def test_an_angle_outside_0_to_180_is_refused(angle):
    with pytest.raises(ValueError, match="angle must"):
        Mesh(SQUARE, TWO_FACES).split_creases(angle)


def test_positions_are_numbered_by_first_appearance_with_both_zeros_as_one():
    positions = np.array([[5, 0, 0], [1, 2, 3], [5, -0.0, 0], [1, 2, 3], [0, 0, 0]], dtype=float)
    number, first = distinct_rows(*positions.T)
    assert number.tolist() == [0, 1, 0, 1, 2]
    assert first.tolist() == [0, 1, 4]


def test_colliding_hashes_do_not_merge_positions(monkeypatch):
    # Half of the rows share one hash, the other half another.
    monkeypatch.setattr(
        rows_module, "_hash_rows", lambda words: (words[0] % 2).astype(np.uint64) << 63
    )
    number, first = distinct_rows(np.array([4, 2, 1, 4, 3, 2, 1]), np.array([0, 0, 0, 0, 0, 1, 0]))
    assert number.tolist() == [0, 1, 2, 0, 3, 4, 2]
    assert first.tolist() == [0, 1, 2, 4, 5]


def test_warped_vertices_move_by_vectors_or_along_normals(cube):
    rng = np.random.default_rng(2)
    moves = rng.normal(size=cube.vertices.shape)
    mesh = Mesh(
        cube.vertices, cube.faces, scalars=rng.random(len(cube.faces)), attributes={"u": moves},
        uv=cube.vertices[:, :2], material=Material("flat"),
    )  # fmt: skip
    warped = mesh.warp(moves, 0.5)
    assert np.allclose(warped.vertices, cube.vertices + 0.5 * moves, rtol=1e-15)
    assert np.allclose(warped.vertices, mesh.warp("u", 0.5).vertices, atol=1e-6)
    assert warped.field is mesh.field
    assert np.array_equal(warped.face_colors, mesh.face_colors)
    assert np.array_equal(warped.uv, mesh.uv)
    assert warped.material is mesh.material
    along = mesh.warp(np.full(len(cube.vertices), 2.0))
    assert np.allclose(along.vertices, cube.vertices + 2.0 * mesh.vertex_normals())
    for wrong, words in (
        (np.ones((2, 3)), "displacements must have shape"),
        ([np.nan] * len(cube.vertices), "displacements must be finite"),
        ("v", "displacements must be one of 'u'"),
    ):
        with pytest.raises(ValueError, match=words):
            mesh.warp(wrong)
    with pytest.raises(ValueError, match=r"displacements must be one of .* none; got 'v'"):
        cube.warp("v")


@pytest.mark.parametrize(
    "mesh",
    [
        rj.Points(
            np.eye(3), size=[7, 8, 9], colors=np.eye(3), normals=np.eye(3),
            attributes={"u": np.eye(3)},
        ),
        rj.Lines(
            np.eye(3), width=9.0, dashes=(3, 2), scalars=[1, 2, 3], attributes={"u": np.eye(3)}
        ),
        rj.Arrows(np.zeros((2, 3)), np.eye(3)[:2], sides=5, scalars=[1, 2]),
        rj.Arrow((0, 0, 0), (1, 1, 0), color="red"),
    ],
)  # fmt: skip
def test_what_is_warped_keeps_its_class_and_looks_as_if_made_there(mesh):
    shift = np.broadcast_to((0.5, -0.25, 0.0), mesh.vertices.shape)
    moved = mesh.warp(shift)
    assert type(moved) is type(mesh)
    assert set(vars(moved)) == set(vars(mesh))
    assert repr(moved) == repr(mesh)
    assert np.array_equal(moved.vertices, mesh.vertices + shift)
    assert np.allclose(moved.bounds(), np.array(mesh.bounds()) + shift[0])
    scene = rj.Scene()
    scene.add(mesh, transform=rj.transforms.translate(shift[0]))
    camera = rj.OrthographicCamera((0.5, 0, 5), (0.5, 0, 0), height=4.0)
    options = {"size": (40, 40), "outputs": ("color", "face_id"), "threads": 1}
    wanted, found = (rj.render(one, camera, **options) for one in (scene, moved))
    assert (found.face_id >= 0).sum() > 10
    assert np.array_equal(found.face_id, wanted.face_id)
    if mesh.primitive != "triangles":
        assert np.array_equal(found.color, wanted.color)
        with pytest.raises(ValueError, match=r"displacements must have three|one of .u"):
            mesh.warp(np.ones(len(mesh.vertices)) if mesh.normals is None else "none")
        assert np.array_equal(mesh.warp("u").vertices, mesh.vertices + np.eye(3))
