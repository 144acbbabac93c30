"""Attributes of one's own are shown where their faces are, and go wherever their mesh goes."""

from __future__ import annotations

import copy
import pickle
from fractions import Fraction

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.distributed import sort_last
from rasterjit.inspect import oracle
from rasterjit.pipeline.visibility.visibility_pass import Region
from rasterjit.rendering.planning import FrameRequest, describe
from rasterjit.rendering.regions import RegionRenderer

T = rj.transforms
SIZE = (48, 36)
NAMES = ("attribute:heat", "face_id", "object_id", "barycentric")
CAMERAS = {
    "perspective": rj.PerspectiveCamera((1.0, 1.2, 4.5), (0, 0, 0), near=0.5, far=30.0),
    "near plane through it": rj.PerspectiveCamera((0.6, 0.8, 2.6), (0, 0, 0), near=1.5),
    "parallel": rj.OrthographicCamera((1.0, 1.2, 4.5), (0, 0, 0), height=3.5, far=20.0),
}


def heat(count, columns, seed=1):
    return np.random.default_rng(seed).normal(size=(count, columns)).astype(np.float32)


def with_heat(mesh, columns, by_face=False, **options):
    """Return a mesh of the same faces with an attribute."""
    values = heat(len(mesh.faces if by_face else mesh.vertices), columns, len(mesh.faces))
    return rj.Mesh(mesh.vertices, mesh.faces, attributes={"heat": values}, **options)


def scene_with(cube, sphere, columns):
    """Return objects with the attribute by vertex, by face, not at all, and an instance."""
    found = rj.Scene()
    ball = with_heat(sphere, columns)
    found.add(ball, T.compose(T.translate((-1.0, 0.2, 0.3)), T.scale((0.8, 0.5, 1.0))), "ball")
    found.add(with_heat(cube, columns, by_face=True), T.scale((0.5, 0.5, 0.5)), "faces")
    found.add(rj.Mesh(cube.vertices, cube.faces, attributes={"cold": cube.vertices}),
              T.compose(T.translate((1.3, -0.5, 0.0)), T.scale((0.4,) * 3)), "none")  # fmt: skip
    found.add(ball, T.compose(T.translate((0.8, 1.0, -1.0)), T.scale((-0.7, 0.7, 0.7))), "again")
    return found


@pytest.mark.parametrize("columns", [1, 3, 17])
@pytest.mark.parametrize("name", list(CAMERAS))
def test_attributes_are_those_of_the_weights(cube, sphere, name, columns):
    scene = scene_with(cube, sphere, columns)
    frame = rj.render(scene, CAMERAS[name], size=SIZE, outputs=NAMES)
    shown = frame.attribute("heat")
    assert shown.dtype == np.float32
    assert shown.shape == (*SIZE[::-1], columns)
    assert shown is frame.arrays()["attribute:heat"]
    starts = np.cumsum([0, *(len(node.mesh.faces) for node in scene.nodes)])
    seen = set()
    for row, column in np.ndindex(*shown.shape[:2]):
        number = frame.object_id[row, column]
        mesh = scene.nodes[number].mesh
        if number < 0 or scene.nodes[number].name == "none":
            assert np.isnan(shown[row, column]).all()
            continue
        face = frame.face_id[row, column] - starts[number]
        if "heat" in mesh.face_attributes:
            want = mesh.face_attributes["heat"][face]
            assert shown[row, column].tobytes() == want.tobytes()
        else:
            corners = mesh.vertex_attributes["heat"][mesh.faces[face]].astype(float)
            weights = frame.barycentric[row, column].astype(float).tolist()
            want = naive.blend(weights, corners.tolist())
            np.testing.assert_allclose(shown[row, column], want, rtol=0, atol=1e-6)
            assert (shown[row, column] >= corners.min(axis=0)).all()
            assert (shown[row, column] <= corners.max(axis=0)).all()
        seen.add(scene.nodes[number].name)
    assert seen == {"ball", "faces", "again"}
    assert (frame.object_id == 2).any()


def test_an_attribute_has_the_bits_of_uv(sphere):
    uv = heat(len(sphere.vertices), 2)
    mesh = rj.Mesh(sphere.vertices, sphere.faces, uv=uv, attributes={"uv": uv, "u": uv[:, :1]})
    names = ("uv", "attribute:uv", "attribute:u")
    arrays = rj.render(mesh, CAMERAS["perspective"], size=SIZE, outputs=names).arrays()
    assert arrays["attribute:uv"].tobytes() == arrays["uv"].tobytes()
    assert arrays["attribute:u"].tobytes() == arrays["uv"][..., :1].tobytes()


def test_values_are_those_of_exact_arithmetic_on_faces_cut_by_the_near_plane():
    # Places at eighths and values at sixteenths, so that nothing is rounded before.
    rng, size = np.random.default_rng(3), (16, 16)
    positions = rng.integers(-24, 25, (18, 4)) / 8.0
    positions[:, 3] = rng.integers(-4, 25, 18) / 8.0
    faces, values = np.arange(18).reshape(-1, 3), rng.integers(-64, 65, (18, 5)) / 16.0
    seen = rj.rasterize(positions, faces, size, threads=1)
    assert seen.totals.clipped > 0
    shown = seen.interpolate(values)
    checked = 0
    for row, column in np.argwhere(seen.face_id >= 0).tolist():
        corners = faces[seen.face_id[row, column]]
        if (np.abs(positions[corners, 2]) <= positions[corners, 3]).all():
            continue
        centre = Fraction(2 * column + 1, 2), Fraction(2 * row + 1, 2)
        weights = oracle.clip_weights(positions[corners].tolist(), centre, size)
        if min(weights) < 0:
            # Beside the exact edge, inside the snapped one.
            continue
        want = oracle.interpolate(weights, values[corners].tolist())
        np.testing.assert_allclose(shown[row, column], [float(one) for one in want], atol=5e-7)
        checked += 1
    assert checked > 20


def test_perspective_is_right_at_the_centre_of_pixels():
    # A strip from w = 1 at the bottom of the picture to w = 4 at its middle.
    size, w = (8, 8), np.array([1.0, 1.0, 4.0, 4.0])
    points = [(0, 8), (8, 8), (8, 4), (0, 4)]
    faces, values = [[0, 1, 2], [0, 2, 3]], [[0.0, 5.0], [0.0, 5.0], [1.0, 5.0], [1.0, 5.0]]
    clip = naive.clip_from_screen(points, size, 0.0, w)
    seen = rj.rasterize(clip, faces, size)
    shown = seen.interpolate(values)
    for row, column in np.argwhere(seen.face_id >= 0).tolist():
        corners = faces[seen.face_id[row, column]]
        weights = oracle.perspective_weights(
            [points[n] for n in corners], w[corners], (column + 0.5, row + 0.5)
        )
        want = oracle.interpolate(weights, [values[n][0] for n in corners])
        assert shown[row, column, 0] == pytest.approx(float(want), abs=1e-7)
    assert (shown[seen.face_id >= 0][:, 1] == 5.0).all()
    assert np.isnan(shown[seen.face_id < 0]).all()
    # On the screen it is half way between the ends; on the face it is not.
    assert abs(shown[5, 0, 0] - 0.625) > 0.2


def test_rasterize_interpolates_the_numbers_of_the_output(sphere):
    mesh, camera = with_heat(sphere, 4), CAMERAS["perspective"]
    frame = rj.render(mesh, camera, size=SIZE, outputs=NAMES)
    clip = T.compose(camera.projection_matrix(SIZE), camera.view_matrix())
    positions = np.column_stack([mesh.vertices, np.ones(len(mesh.vertices))])
    seen = rj.rasterize(np.einsum("ij,nj->ni", clip, positions), mesh.faces, SIZE)
    same = seen.face_id == frame.face_id
    assert same.mean() > 0.99
    shown = seen.interpolate(mesh.vertex_attributes["heat"])
    np.testing.assert_allclose(shown[same], frame.attribute("heat")[same], rtol=0, atol=2e-6)
    affine = rj.Quality(interpolation="affine")
    other = rj.rasterize(np.einsum("ij,nj->ni", clip, positions), mesh.faces, SIZE, quality=affine)
    weights = (
        other.barycentric[12, 20]
        @ mesh.vertex_attributes["heat"][mesh.faces[other.face_id[12, 20]]]
    )
    np.testing.assert_allclose(other.interpolate(mesh.vertex_attributes["heat"])[12, 20], weights,
                               atol=1e-6)  # fmt: skip


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.zeros((3, 2)), r"one row per vertex \(4\), got 3"),
        (np.zeros(4), r"shape \(n, D\), D >= 1, got \(4,\); reshape"),
        (np.zeros((4, 0)), r"shape \(n, D\)"),
        ([[0.0], [np.nan], [0.0], [0.0]], "finite, got 1 rows"),
        ([[0.0], [1e39], [0.0], [0.0]], "fit float32"),
        ([["a"]] * 4, "numbers, got an array of dtype"),
        ([[1], [1, 2], [1], [1]], "array of numbers"),
    ],
)
def test_values_that_cannot_be_interpolated_are_refused(values, said):
    seen = rj.rasterize(np.ones((4, 4)), [[0, 1, 2], [0, 2, 3]], (4, 4))
    with pytest.raises(ValueError, match=f"^values must .*{said}"):
        seen.interpolate(values)


def test_a_scene_may_have_it_by_face_alone(cube):
    mesh = with_heat(cube, 2, by_face=True)
    frame = rj.render(mesh, CAMERAS["perspective"], size=SIZE, outputs=NAMES)
    want = np.vstack([mesh.face_attributes["heat"], np.full((1, 2), np.nan, np.float32)])
    assert frame.attribute("heat").tobytes() == want[frame.face_id].tobytes()
    told = describe(rj.explain(mesh, CAMERAS["perspective"], outputs="attribute:heat", size=SIZE))
    assert "fill_attribute" not in told
    assert "output attribute:heat  2 x float32" in told


def test_explain_tells_of_it_if_it_is_asked_for(cube):
    mesh, camera = with_heat(cube, 5), CAMERAS["perspective"]
    told = describe(rj.explain(mesh, camera, outputs=("attribute:heat", "depth"), size=SIZE))
    assert "attribute:heat, depth" in told
    assert "barycentric.fill_attribute" in told
    assert "output attribute:heat  5 x float32" in told
    assert "attribute" not in describe(rj.explain(mesh, camera, outputs="depth", size=SIZE))


def test_an_attribute_is_found_by_the_name_of_its_output_too(cube):
    frame = rj.render(with_heat(cube, 2), outputs=("attribute:heat", "depth"), size=SIZE)
    heat_there = frame.attribute("heat")
    assert frame.attribute("attribute:heat") is heat_there
    for spelling in ("cold", "attribute:cold"):
        with pytest.raises(rj.OutputNotRequestedError, match=r"^attribute:cold was not rendered: "):
            frame.attribute(spelling)
    with pytest.raises(rj.OutputNotRequestedError, match=r"depth; did you mean 'heat'\?"):
        frame.attribute("heatt")


def test_misspelt_outputs_are_not_said_to_be_asked_for(cube):
    frame = rj.render(cube, outputs=("object_id", "depth"), size=SIZE)
    with pytest.raises(rj.OutputNotRequestedError) as caught:
        frame.masks("objectid")
    assert str(caught.value) == (
        "'objectid' is the name of no output; this frame has object_id, depth; "
        "did you mean 'object_id'?"
    )
    with pytest.raises(ValueError, match=r"outputs has 'dept', .*; did you mean 'depth'\?"):
        rj.render(cube, outputs="dept", size=SIZE)


# What is wrong


def test_an_attribute_that_no_mesh_has_is_named(cube):
    scene = rj.Scene()
    scene.add(with_heat(cube, 2))
    scene.add(rj.Mesh(cube.vertices, cube.faces, attributes={"age": np.zeros((12, 1))}))
    with pytest.raises(ValueError, match=r"outputs has 'attribute:cold'.*meshes have age, heat"):
        rj.render(scene, outputs="attribute:cold")
    with pytest.raises(ValueError, match=r"outputs has 'attribute:cold'.*meshes have none"):
        rj.explain(rj.Mesh(cube.vertices, cube.faces), outputs="attribute:cold")
    for name in ("attribute:", "attribute", "Attribute:heat"):
        with pytest.raises(ValueError, match=f"outputs has '{name}', which is unknown"):
            rj.render(scene, outputs=name)


def test_other_numbers_of_columns_are_refused_where_both_are_shown(cube):
    scene = rj.Scene()
    scene.add(with_heat(cube, 2), name="one")
    scene.add(with_heat(cube, 3, by_face=True), name="other")
    with pytest.raises(
        ValueError,
        match=r"mesh of 'other' must have 2 columns in attributes\['heat'\].*'one'.*got 3",
    ):
        rj.render(scene, outputs="attribute:heat")
    # Nobody asks for it here.
    rj.render(scene, CAMERAS["perspective"], size=(8, 6), outputs="depth")


@pytest.mark.parametrize(
    ("attributes", "said"),
    [
        ({"heat": np.zeros((5, 2))}, r"attributes\['heat'\].* per vertex \(8\) or per face \(12\)"),
        ({"heat": np.zeros(8)}, r"attributes\['heat'\] must have shape \(n, D\).*reshape"),
        ({"heat": np.full((8, 1), np.inf)}, r"attributes\['heat'\] must be finite, got 8 rows"),
        ({"heat": np.full((8, 1), 1j)}, r"attributes\['heat'\] must hold numbers"),
        ({"": np.zeros((8, 1))}, "texts as names, got ''"),
        ({7: np.zeros((8, 1))}, "texts as names, got 7"),
        (np.zeros((8, 1)), "attributes must be a mapping"),
        ({"heat": np.ma.masked_equal(np.eye(8), 1.0)}, r"attributes\['heat'\] must have no masked"),
    ],
)  # fmt: skip
def test_attributes_that_do_not_fit_are_refused(cube, attributes, said):
    with pytest.raises(ValueError, match=said):
        rj.Mesh(cube.vertices, cube.faces, attributes=attributes)


def test_one_that_was_not_asked_for_is_named(cube):
    frame = rj.render(with_heat(cube, 2), size=(8, 6), outputs=("attribute:heat", "depth"))
    with pytest.raises(
        rj.OutputNotRequestedError, match=r"'attribute:cold'.*has attribute:heat, dep"
    ):
        frame.attribute("cold")


# Meshes that are made of it


def test_a_mesh_owns_its_attributes(cube):
    values = heat(8, 2)
    mesh = rj.Mesh(cube.vertices, cube.faces, attributes={"heat": values})
    values[:] = 0.0
    assert mesh.vertex_attributes["heat"].any()
    assert mesh.vertex_attributes["heat"].flags.c_contiguous
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertex_attributes["heat"][0] = 1.0
    with pytest.raises(TypeError):
        mesh.vertex_attributes["cold"] = values
    assert not mesh.face_attributes


@pytest.mark.parametrize(
    "make", [copy.copy, copy.deepcopy, lambda mesh: pickle.loads(pickle.dumps(mesh))],
    ids=["copy", "deep copy", "pickle"],
)  # fmt: skip
def test_copies_have_it(cube, make):
    for mesh in (with_heat(cube, 2), with_heat(cube, 3, by_face=True)):
        made = make(mesh)
        for kind in ("vertex_attributes", "face_attributes"):
            ours, theirs = getattr(made, kind), getattr(mesh, kind)
            assert ours.keys() == theirs.keys()
            for name in ours:
                assert ours[name].tobytes() == theirs[name].tobytes()
                assert not ours[name].flags.writeable


def test_a_mesh_that_is_split_has_it_at_every_corner(cube):
    mesh = rj.Mesh(cube.vertices, cube.faces,
                   attributes={"heat": heat(8, 2), "faces": heat(12, 1)})  # fmt: skip
    split = mesh.split_creases(30.0)
    assert len(split.vertices) > 8
    ours, theirs = split.vertex_attributes["heat"], mesh.vertex_attributes["heat"]
    assert ours[split.faces].tobytes() == theirs[mesh.faces].tobytes()
    assert split.face_attributes["faces"].tobytes() == mesh.face_attributes["faces"].tobytes()
    # Two vertices at one place differ in what they carry, so they are not merged.
    loose = rj.Mesh(cube.vertices[cube.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3),
                    attributes={"heat": heat(36, 1)})  # fmt: skip
    smooth = loose.split_creases(180.0)
    assert smooth.vertex_attributes["heat"][smooth.faces].tobytes() == heat(36, 1).tobytes()


def test_a_mesh_of_as_many_vertices_as_faces_keeps_what_is_of_faces(cube):
    # A tetrahedron of loose faces, whose vertices are merged: then there are four of both.
    places = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    corners = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
    values, colors = heat(4, 1), np.eye(4)[:, :3]
    loose = rj.Mesh(places[corners].reshape(-1, 3), np.arange(12).reshape(4, 3), colors=colors,
                    attributes={"heat": values})  # fmt: skip
    smooth = loose.split_creases(180.0)
    assert len(smooth.vertices) == len(smooth.faces) == 4
    moved = rj.animation.MorphTrack([0.0], smooth, smooth.vertices[np.newaxis])(0.0)
    for made in (loose, smooth, moved, copy.copy(smooth)):
        assert made.face_attributes["heat"].tobytes() == values.tobytes()
        assert not made.vertex_attributes
        assert made.vertex_colors is None
        assert made.face_colors.tobytes() == loose.face_colors.tobytes()
    # Where nothing else tells, rows are those of vertices.
    tied = rj.Mesh(places, corners, attributes={"heat": values})
    assert list(tied.vertex_attributes) == ["heat"]


def test_a_morphed_mesh_has_it(cube):
    mesh = with_heat(cube, 2)
    track = rj.animation.MorphTrack([0.0, 1.0], mesh, [cube.vertices, cube.vertices * 2.0])
    made = track(0.5)
    assert made.vertex_attributes["heat"].tobytes() == mesh.vertex_attributes["heat"].tobytes()


def test_partitions_show_what_one_mesh_of_all_shows(cube, sphere):
    flat = rj.Material("flat")
    parts = [with_heat(sphere, 2, material=flat), with_heat(cube, 2, material=flat)]
    whole = rj.Mesh(
        np.vstack([part.vertices for part in parts]),
        np.vstack([parts[0].faces, parts[1].faces + len(sphere.vertices)]),
        attributes={"heat": np.vstack([part.vertex_attributes["heat"] for part in parts])},
        material=flat,
    )
    camera, names = CAMERAS["perspective"], ("attribute:heat", "face_id")
    want = rj.render(whole, camera, size=SIZE, outputs=names).arrays()
    options = FrameRequest(SIZE, rj.Quality.standard(), names, None, "none")
    drawn = [sort_last.draw_part(part, rj.Scene(), None, camera, options, 1) for part in parts]
    merged = sort_last.merge_images(*drawn).frame().arrays()
    for name in names:
        assert merged[name].tobytes() == want[name].tobytes()
    drawn[1].outputs["attribute:heat"] = drawn[1].outputs["attribute:heat"][..., :1]
    with pytest.raises(ValueError, match=r"as many columns .*'attribute:heat', got 2 and 1"):
        sort_last.merge_images(*drawn)
    with pytest.raises(
        ValueError, match=r"'attribute:heat', but partitions of .vertices, faces. have"
    ):
        rj.distributed.render_partitions(
            [(cube.vertices, cube.faces)], camera, size=SIZE, outputs="attribute:heat"
        )


# Pictures that a frame is made of


def test_all_ways_to_draw_show_the_same_bits(cube, sphere):
    scene, camera, size = scene_with(cube, sphere, 3), CAMERAS["perspective"], (96, 72)
    names = ("attribute:heat", "color")
    whole = rj.render(scene, camera, size=size, outputs=names, threads=1).attribute("heat")
    for quality in (rj.Quality(samples=4), rj.Quality(samples=64), rj.Quality(shading="face")):
        for threads in (1, 3):
            fine = rj.render(scene, camera, size=size, outputs=names, quality=quality,
                             threads=threads)  # fmt: skip
            assert fine.attribute("heat").tobytes() == whole.tobytes()
    with RegionRenderer(scene, camera, size=size, outputs=names) as renderer:
        part = renderer.render_region(Region(64, 0, 32, 64)).attribute("heat")
    assert part.tobytes() == whole[:64, 64:].tobytes()
    layered = rj.render_layers(scene, camera, k=3, size=size, outputs=("attribute:heat", "face_id"))
    assert layered.attribute("heat").shape == (3, 72, 96, 3)
    assert layered.attribute("heat")[0].tobytes() == whole.tobytes()
    assert np.isfinite(layered.attribute("heat")[1]).any()
    (many,) = rj.render_many(scene, [camera], size=size, outputs=("attribute:heat",), threads=1)
    assert many.attribute("heat").tobytes() == whole.tobytes()


def test_a_renderer_shows_those_of_the_meshes_of_now(cube):
    camera = CAMERAS["perspective"]
    first, second = with_heat(cube, 2), with_heat(cube, 3, by_face=True)
    with rj.Renderer(SIZE) as renderer:
        for mesh in (first, second, first):
            shown = renderer.render(mesh, camera, outputs="attribute:heat").attribute("heat")
            alone = rj.render(mesh, camera, size=SIZE, outputs="attribute:heat").attribute("heat")
            assert shown.tobytes() == alone.tobytes()


def test_out_of_view_all_is_empty(cube):
    away = rj.PerspectiveCamera((0, 0, 9), (0, 0, 20))
    frame = rj.render(with_heat(cube, 2), away, size=(8, 6), outputs="attribute:heat")
    assert np.isnan(frame.attribute("heat")).all()


# Files


@pytest.mark.parametrize("columns", [1, 2, 3, 4, 5])
def test_frames_with_it_are_saved(cube, tmp_path, columns):
    frame = rj.render(with_heat(cube, columns), size=(12, 9), outputs=("attribute:heat", "depth"))
    shown = frame.attribute("heat")
    frame.save(tmp_path / "all.npz")
    with np.load(tmp_path / "all.npz") as saved:
        assert saved["attribute:heat"].tobytes() == shown.tobytes()
    frame.save(tmp_path / "heat.npy", "attribute:heat")
    assert np.load(tmp_path / "heat.npy").tobytes() == shown.tobytes()
    if columns > 3:
        with pytest.raises(ValueError, match="1 to 3 channels"):
            frame.save(tmp_path / "heat.png", "attribute:heat")
    else:
        frame.save(tmp_path / "heat.png", "attribute:heat")
        assert (tmp_path / "heat.png").stat().st_size > 100


@pytest.mark.parametrize("columns", [1, 3, 5])
def test_exr_files_hold_its_columns(cube, tmp_path, columns):
    openexr = pytest.importorskip("OpenEXR")
    mesh, names = with_heat(cube, columns), ("attribute:heat", "depth")
    frame = rj.render(mesh, size=(12, 9), outputs=names)
    frame.save(tmp_path / "all.exr")
    parts = {1: [""], 3: [".X", ".Y", ".Z"], 5: [f".{n}" for n in range(5)]}[columns]
    with openexr.File(str(tmp_path / "all.exr"), separate_channels=True) as file:
        channels = file.channels()
        for n, part in enumerate(parts):
            found = channels[f"attribute:heat{part}"].pixels
            assert found.tobytes() == frame.attribute("heat")[..., n].tobytes()
    rj.render_layers(mesh, k=2, size=(12, 9), outputs=names).save(tmp_path / "layers.exr")
    with openexr.File(str(tmp_path / "layers.exr"), separate_channels=True) as file:
        assert f"layer1.attribute:heat{parts[-1]}" in file.channels()
