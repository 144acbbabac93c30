"""Scalar fields are drawn with all else there is, and go wherever their mesh goes."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.pipeline.visibility.visibility_pass import Region
from rasterjit.rendering.planning import describe
from rasterjit.rendering.regions import RegionRenderer
from rasterjit.scene.mesh import set_face_values

T = rj.transforms
SIZE = (48, 36)
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = [[0, 1, 2], [0, 2, 3]]
BANDS = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0]], np.uint8)
CAMERA = rj.PerspectiveCamera((1.0, 1.2, 4.5), (0, 0, 0), near=0.5, far=30.0)


def grid(n=9, **options):
    """Return a bent square of n by n vertices."""
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n)))
    first = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([first, first + 1, first + n + 1], 1),
            np.stack([first, first + n + 1, first + n], 1),
        ]
    )
    return rj.Mesh(np.stack([x, y, 0.3 * np.sin(3.0 * x)], 1), faces, **options)


def waves(count):
    return np.sin(np.arange(count) * 0.7) * 3.0


def colored(mesh, mapped):
    """Return a mesh with the one colour that a constant field would show, by faces or vertices."""
    code = rj.Colormap(BANDS).codes[0]
    rows = len(mesh.faces) if mapped else len(mesh.vertices)
    return rj.Mesh(
        mesh.vertices, mesh.faces, colors=np.tile(code, (rows, 1)), material=mesh.material
    )


@pytest.mark.parametrize("samples", [1, 4, "area"])
@pytest.mark.parametrize(
    "material",
    [
        rj.Material("unlit"), rj.Material("flat"), rj.Material("phong", (0.5, 0.8, 1.0)),
        rj.Material("gouraud", specular=0.6), rj.Material("pbr", roughness=0.4),
        rj.Material("phong", (1.0, 1.0, 1.0, 0.5), alpha_mode="blend"),
    ],
)  # fmt: skip
def test_one_value_everywhere_is_one_color_bit_for_bit(material, samples):
    plain = grid(material=material)
    field = grid(material=material, scalars=np.full(81, 2.0), colormap=BANDS, contours=[1.0, 2.0])
    pictures = []
    for mesh in (colored(plain, mapped=True), field):
        scene = rj.Scene()
        scene.add(mesh)
        scene.add(mesh, T.translate((0.2, 0.1, -1.0)))
        scene.lights = [rj.AmbientLight(), rj.DirectionalLight((-0.3, -0.5, -1.0))]
        # Areas are of opaque faces.
        is_blended = material.alpha_mode == "blend" and samples == "area"
        # Lit meshes without scalars else take float32.
        quality = rj.Quality(
            samples=16 if is_blended else samples, interpolation_precision="float64"
        )
        frame = rj.render(
            scene, CAMERA, size=SIZE, quality=quality, outputs=("color", "linear"), threads=1
        )
        pictures.append(frame)
    assert (pictures[0].linear[..., :3].std(axis=(0, 1)) > 0.0).any()
    assert pictures[0].linear.tobytes() == pictures[1].linear.tobytes()
    assert pictures[0].color.tobytes() == pictures[1].color.tobytes()


def test_alpha_of_the_map_is_seen_through_where_it_is_blended():
    half = np.array([[255, 0, 0, 51], [255, 0, 0, 255]], np.uint8)
    for mode, alphas in (("blend", {51, 255}), ("opaque", {255})):
        material = rj.Material("unlit", alpha_mode=mode)
        mesh = rj.Mesh(SQUARE, FACES, scalars=[0, 1, 1, 0], colormap=half, material=material)
        frame = rj.render(mesh, CAMERA, size=SIZE, background="transparent", threads=1)
        assert set(np.unique(frame.color[..., 3])) == {0, *alphas}
    for options in ({"colormap": half}, {"nan_color": "transparent"}):
        mesh = rj.Mesh(SQUARE, FACES, scalars=[0, np.nan, 1, 0], **options,
                       material=rj.Material("unlit", alpha_mode="mask"))  # fmt: skip
        with pytest.raises(ValueError, match="alpha_mode than 'mask'"):
            rj.render(mesh, CAMERA, size=SIZE)
    # Faces have colours of their own, which masks read.
    mesh = rj.Mesh(SQUARE, FACES, scalars=[0, 1], colormap=half,
                   material=rj.Material("unlit", alpha_mode="mask"))  # fmt: skip
    drawn = rj.render(mesh, CAMERA, size=SIZE, outputs="face_id").face_id
    assert set(np.unique(drawn)) == {-1, 1}


def full_scene():
    """Return fields of vertices and faces, an instance, colours, a texture, and what has none."""
    made = rj.Scene()
    values = waves(81)
    values[7] = np.nan
    field = grid(scalars=values, colormap="plasma", contours=6, material=rj.Material("phong"))
    made.add(field, T.translate((-0.6, 0.0, 0.0)))
    made.add(field, T.compose(T.translate((1.0, 0.4, -0.5)), T.scale((-0.5, 0.5, 0.5))))
    made.add(grid(scalars=waves(128), material=rj.Material("flat")), T.translate((0.9, -0.6, 0.4)))
    made.add(rj.Mesh(SQUARE, FACES, colors=np.eye(4)[:, :3]), T.translate((0.0, 0.5, -1.5)))
    made.add(rj.Mesh(SQUARE, FACES), T.translate((-0.5, -0.8, 0.9)))
    return made


CAMERAS = {
    "perspective": CAMERA,
    "near plane through it": rj.PerspectiveCamera((0.6, 0.8, 2.0), (0, 0, 0), near=1.6),
    "parallel": rj.OrthographicCamera((1.0, 1.2, 4.5), (0, 0, 0), height=3.5, far=20.0),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_scalars_are_those_of_the_weights(name):
    scene = full_scene()
    frame = rj.render(
        scene, CAMERAS[name], size=SIZE, threads=1,
        outputs=("scalar", "face_id", "object_id", "barycentric"),
    )  # fmt: skip
    starts = np.cumsum([0, *(len(node.mesh.faces) for node in scene.nodes)])
    wanted = np.full(SIZE[::-1], np.nan)
    for row, column in np.argwhere(frame.face_id >= 0):
        owner = frame.object_id[row, column]
        mesh, face = scene.nodes[owner].mesh, frame.face_id[row, column] - starts[owner]
        if mesh.field is None:
            continue
        values = mesh.field.values
        if mesh.field.of_faces:
            wanted[row, column] = values[face]
        else:
            wanted[row, column] = frame.barycentric[row, column] @ values[mesh.faces[face]]
    assert {0, 1, 2, 3, 4} <= set(np.unique(frame.object_id)) or name != "perspective"
    assert np.isfinite(wanted).sum() > 200
    np.testing.assert_allclose(frame.scalar, wanted, rtol=0, atol=2e-6)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("quality", [rj.Quality(), rj.Quality(interpolation="affine")])
def test_colors_are_those_of_the_scalars(name, quality):
    mesh = grid(scalars=waves(81), colormap="turbo", material=rj.Material("unlit"))
    frame = rj.render(mesh, CAMERAS[name], size=SIZE, outputs=("color", "scalar"), threads=1,
                      quality=quality)  # fmt: skip
    hit, own = np.isfinite(frame.scalar), mesh.field
    entries = own.colormap.entries(frame.scalar[hit], *own.range)
    shown = frame.color[hit].astype(int)
    near = [own.colormap.codes[np.clip(entries + step, 0, 255)] for step in (-1, 0, 1)]
    same = [(codes == shown).all(axis=1) for codes in near]
    # The scalar is rounded to float32, the colour is that of the value before.
    assert np.any(same, axis=0).all()
    assert same[1].mean() > 0.99


def test_bits_are_the_same_in_tiles_threads_batches_and_layers():
    scene, names, size = full_scene(), ("color", "linear", "scalar", "face_id"), (150, 90)
    for camera in CAMERAS.values():
        wanted = rj.render(scene, camera, size=size, outputs=names, threads=1).arrays()
        many = rj.render(scene, camera, size=size, outputs=names, threads=3).arrays()
        batch = rj.render_batch(scene, [camera, CAMERA], size=size, outputs=names)
        with RegionRenderer(scene, camera, size=size, outputs=names) as renderer:
            part = renderer.render_region(Region(64, 0, 64, 64)).arrays()
        for name in names:
            assert many[name].tobytes() == wanted[name].tobytes(), name
            assert getattr(batch, name)[0].tobytes() == wanted[name].tobytes(), name
            assert part[name].tobytes() == wanted[name][:64, 64:128].tobytes(), name
    layered = rj.render_layers(scene, CAMERA, k=2, size=size, outputs=("scalar", "face_id"))
    whole = rj.render(scene, CAMERA, size=size, outputs="scalar", threads=1).scalar
    assert layered.scalar[0].tobytes() == whole.tobytes()
    assert np.isfinite(layered.scalar[1]).any()


def test_fields_go_wherever_their_mesh_goes(tmp_path):
    mesh = grid(
        scalars=waves(81), colormap="plasma", range=(-1, 2), nan_color="red", contours=[0.5]
    )
    wanted = rj.render(mesh, CAMERA, size=SIZE, threads=1)
    scene = rj.Scene()
    scene.add(mesh)
    for one in (pickle.loads(pickle.dumps(mesh)), copy.deepcopy(mesh), copy.deepcopy(scene), scene):
        assert (
            rj.render(one, CAMERA, size=SIZE, threads=1).color.tobytes() == wanted.color.tobytes()
        )
    kept = pickle.loads(pickle.dumps(mesh)).field
    assert (kept.range, kept.colormap.name) == ((-1.0, 2.0), "plasma")
    with pytest.raises(ValueError, match="read-only"):
        kept.values[0] = 1.0
    split = mesh.split_creases(1.0)
    assert len(split.vertices) > 81
    assert np.array_equal(split.field.values[split.faces], mesh.field.values[mesh.faces])
    bare = mesh.without_colors()
    assert (bare.field, mesh.field is None) == (None, False)
    faces = grid(scalars=waves(128)).split_creases(1.0)
    assert faces.field.of_faces
    # Others have colours alone.
    with pytest.warns(rj.SaveWarning, match="scalars, but for their colours"):
        other = mesh.to_trimesh()
    assert np.array_equal(
        other.visual.vertex_colors, kept.colormap.codes[kept.colormap.entries(waves(81), -1, 2)]
    )
    with pytest.warns(rj.SaveWarning, match="scalars, but for their colours"):
        scene.save(tmp_path / "field.glb")
    saved = rj.load(tmp_path / "field.glb").nodes[0].mesh
    assert np.array_equal(saved.vertex_colors, mesh.shown_vertex_colors())


def test_what_follows_from_scalars_is_told_and_explained():
    mesh = grid(scalars=waves(81))
    plan = rj.explain(mesh, CAMERA, size=SIZE, outputs=("color", "scalar"))
    text = describe(plan)
    assert "scalar fields            in  (1 object)" in text
    for name in ("scalar_colors.apply_colormaps", "scalar_colors.fill_scalars", "output scalar"):
        assert name in text
    assert "in float32, others in float64: an object has scalars of its vertices" in describe(
        rj.explain(full_scene_unlit(), CAMERA, size=SIZE)
    )
    plain = describe(rj.explain(rj.Mesh(SQUARE, FACES), CAMERA, size=SIZE))
    assert "scalar fields            out (no mesh has scalars of its vertices)" in plain
    assert "fields." not in plain
    # Nothing but scalars of faces: their colours are all that is drawn.
    assert "fields.show" not in describe(rj.explain(grid(scalars=waves(128)), CAMERA, size=SIZE))
    told = rj.explain_pixel(mesh, CAMERA, SIZE, 24, 18)
    drawn = rj.render(mesh, CAMERA, size=SIZE, threads=1).color[18, 24]
    assert told.color.tolist() == drawn.tolist()


def full_scene_unlit():
    scene = full_scene()
    for node in scene.nodes:
        node.mesh.material = rj.Material("unlit")
    return scene


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"scalars": [1, 2, 3]}, ["scalars", "per vertex (4) or per face (2)", "(3,)"]),
        ({"scalars": np.ones((4, 2))}, ["scalars", "(4, 2)"]),
        ({"scalars": []}, ["scalars", "(0,)"]),
        ({"scalars": 3.0}, ["scalars", "()"]),
        ({"scalars": "abcd"}, ["scalars", "numbers"]),
        ({"scalars": [1, 2, None, 4]}, ["scalars", "numbers"]),
        ({"scalars": [1j, 2, 3, 4]}, ["scalars", "complex"]),
        ({"scalars": [1, [2], 3, 4]}, ["scalars", "array of numbers"]),
        ({"scalars": [1, 2, 3, -1e39]}, ["scalars", "float32", "1e+39"]),
        ({"scalars": np.ma.masked_array([1j] * 4, [0, 1, 0, 0])}, ["scalars", "mask"]),
        ({"range": (2, 1)}, ["range", "low to high", "(2.0, 1.0)", "'_r'"]),
        ({"range": (0, np.nan)}, ["range", "finite", "nan"]),
        ({"range": (0, np.inf)}, ["range", "finite"]),
        ({"range": (-1e300, 1e300)}, ["range", "1e+300"]),
        ({"range": 3}, ["range", "two finite numbers", "3"]),
        ({"range": "ab"}, ["range", "'ab'"]),
        ({"range": (0, 1, 2)}, ["range", "(0, 1, 2)"]),
        ({"colormap": "virdis"}, ["colormap", "'viridis'"]),
        ({"nan_color": "grayish"}, ["nan_color", "grayish"]),
        ({"colors": np.ones((4, 3))}, ["colors must be None where scalars"]),
    ],
)
def test_bad_input_is_refused_by_name(options, words):
    with pytest.raises(ValueError, match=words[0]) as error:
        rj.Mesh(SQUARE, FACES, **{"scalars": [1, 2, 3, 4], **options})
    for word in words:
        assert word in str(error.value)


def test_a_column_of_scalars_is_one():
    mesh = rj.Mesh(SQUARE, FACES, scalars=[[1], [2], [3], [4]])
    assert mesh.field.values.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert mesh.field.range == (1.0, 4.0)
    assert not mesh.field.values.flags.writeable


def test_lines_are_opaque_and_lit_as_surfaces_are():
    clear = np.array([[255, 0, 0, 51]], np.uint8)
    material = rj.Material("unlit", (0.5, 1.0, 1.0), alpha_mode="blend")
    contours = rj.Contours(4, 2.0, "white")
    mesh = grid(scalars=waves(81), colormap=clear, contours=contours, material=material)
    frame = rj.render(mesh, CAMERA, size=SIZE, background="transparent", threads=1)
    alphas = frame.color[..., 3]
    assert set(np.unique(alphas)) == {0, 51, 255}
    # White lines times the base colour.
    assert (frame.color[alphas == 255] == [188, 255, 255, 255]).all()
    lit = rj.Scene()
    lit.add(grid(scalars=waves(81), contours=contours, material=rj.Material("flat")))
    lit.lights = [rj.AmbientLight("white", 0.5)]
    shown = rj.render(lit, CAMERA, size=SIZE, threads=1).color
    assert (shown == [188, 188, 188, 255]).all(axis=2).any()


# --- where scalars come from ----------------------------------------------------------------------


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int16, bool])
@pytest.mark.parametrize("of_faces", [False, True])
def test_what_is_masked_is_nan(kind, of_faces):
    plain = grid()
    count = len(plain.faces) if of_faces else len(plain.vertices)
    values = (10.0 * waves(count)).astype(kind)
    hidden = np.arange(count) % 7 == 2
    holes = np.where(hidden, np.nan, values.astype(float))
    masked = grid(scalars=np.ma.array(values, mask=hidden), nan_color="#ff00ff")
    wanted = grid(scalars=holes, nan_color="#ff00ff")
    assert np.array_equal(masked.field.values, holes, equal_nan=True)
    assert masked.field.range == wanted.field.range
    options = {"size": SIZE, "outputs": ("color", "scalar"), "threads": 1}
    one, other = (rj.render(mesh, CAMERA, **options) for mesh in (masked, wanted))
    assert np.array_equal(one.color, other.color)
    assert np.array_equal(one.scalar, other.scalar, equal_nan=True)
    assert np.isnan(one.scalar[one.color[..., 3] > 0]).any()


def test_nothing_masked_and_all_masked():
    values = waves(81)
    assert np.array_equal(grid(scalars=np.ma.array(values)).field.values, values)
    every = grid(scalars=np.ma.array(values, mask=True)).field
    assert np.isnan(every.values).all()
    assert every.range == (0.0, 1.0)
    # Behind a mask may be anything.
    spoiled = np.ma.masked_invalid(np.where(np.arange(81) == 5, 1e300, values))
    spoiled[5] = np.ma.masked
    assert np.isnan(grid(scalars=spoiled).field.values[5])


def test_scalars_are_shown_by_the_name_of_an_attribute():
    heat, load = waves(81)[:, None], np.arange(128.0)[:, None]
    mesh = grid(
        attributes={"heat": heat, "load": load, "flow": np.zeros((81, 3))}, colors=np.ones((81, 3)),
        material=rj.Material("unlit"),
    )  # fmt: skip
    assert mesh.scalar_attributes == ("heat", "load")
    for name, values in (("heat", heat), ("load", load)):
        shown = mesh.with_scalars(name, "plasma", range=(-2, 90), nan_color="red")
        wanted = grid(
            scalars=np.float32(values), colormap="plasma", range=(-2, 90), nan_color="red",
            material=mesh.material,
        )  # fmt: skip
        pictures = [rj.render(one, CAMERA, size=SIZE, threads=1).color for one in (shown, wanted)]
        assert np.array_equal(*pictures)
        assert np.shares_memory(shown.vertices, mesh.vertices)
        assert shown.vertex_colors is None
        assert shown.scalar_attributes == ("heat", "load")
    assert mesh.field is None
    again = mesh.with_scalars("heat").with_scalars(waves(128))
    assert again.field.of_faces
    assert again.face_colors is not None
    assert mesh.with_scalars("heat", contours=3).field.levels.size == 3


def test_an_attribute_of_faces_is_one_where_there_are_as_many_vertices():
    tetrahedron = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    mesh = rj.Mesh(tetrahedron, faces, attributes={"of vertices": np.arange(4.0)[:, None]})
    mesh = set_face_values(mesh, None, {"of faces": np.arange(4, dtype=np.float32)[:, None]})
    assert not mesh.with_scalars("of vertices").field.of_faces
    assert mesh.with_scalars("of faces").field.of_faces


@pytest.mark.parametrize(
    ("scalars", "words"),
    [
        ("heet", "it has 'heat'; got 'heet'; did you mean 'heat'"),
        ("flow", "name of an attribute of one column: it has 'heat'; got 'flow'"),
        (np.zeros(5), r"scalars must have one number per vertex \(81\) or per face \(128\)"),
    ],
)
def test_other_scalars_are_refused(scalars, words):
    mesh = grid(attributes={"heat": waves(81)[:, None], "flow": np.zeros((81, 3))})
    with pytest.raises(ValueError, match=words):
        mesh.with_scalars(scalars)
    with pytest.raises(ValueError, match="it has none"):
        grid().with_scalars("heat")
