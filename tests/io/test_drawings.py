"""Drawings load as lines, and points and lines go to glTF files and trimesh and come back."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import trimesh
from trimesh.path.entities import Arc, Bezier, Line, Text

import rasterjit as rj
from rasterjit.io.primitives import make_arc
from rasterjit.scene.color import srgb_to_linear

RNG = np.random.default_rng(25)
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def only(path):
    """Load a file, without a warning, and return its lines."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (node,) = rj.load(path).nodes
    assert isinstance(node.mesh, rj.Lines)
    return node.mesh


def write(path, content):
    path.write_text(content)
    return path


def lengths(lines):
    """Return how long each segment is."""
    ends = lines.vertices[lines.segments]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


# DXF and SVG


def dxf(path, *kinds):
    """Write a file with ezdxf."""
    ezdxf = pytest.importorskip("ezdxf")
    document = ezdxf.new()
    space = document.modelspace()
    if "lines" in kinds:
        space.add_lwpolyline([(0, 0), (2, 0), (2, 1)])
    if "circle" in kinds:
        space.add_circle((5, 5), 2)
    if "arc" in kinds:
        space.add_arc((0, 0), 3, 0, 90)
    if "text" in kinds:
        space.add_text("words")
    document.saveas(path)
    return path


def test_a_dxf_drawing_has_its_curves_in_short_segments(tmp_path):
    lines = only(dxf(tmp_path / "a.dxf", "lines", "circle", "arc"))
    assert lines.vertices[:, 2].tolist() == [0.0] * len(lines.vertices)
    assert lengths(lines).sum() == pytest.approx(3 + 4 * np.pi + 1.5 * np.pi, rel=2e-3)
    ends = lines.vertices[lines.segments]
    middle = ends.mean(axis=1)
    of_circle = np.abs(np.linalg.norm(ends[:, 0] - [5, 5, 0], axis=1) - 2) < 1e-6
    assert of_circle.sum() > 16
    assert np.linalg.norm(middle[of_circle] - [5, 5, 0], axis=1) == pytest.approx(2, rel=1e-2)
    # A circle closes: the last segment ends at the point where the first began.
    numbers = lines.segments[of_circle]
    assert numbers[0, 0] == numbers[-1, 1]


def test_what_a_drawing_has_besides_curves_is_left_out_by_name(tmp_path):
    with pytest.warns(rj.LoadWarning, match=r"text of a drawing \(1\)"):
        rj.load(dxf(tmp_path / "a.dxf", "lines", "text"))
    with pytest.raises(rj.MeshFileError, match=r"without faces, lines and points \(text of a"):
        rj.load(dxf(tmp_path / "b.dxf", "text"))


def drawn(path, build):
    """Return the things of a DXF file that a function fills."""
    ezdxf = pytest.importorskip("ezdxf")
    document = ezdxf.new()
    build(document, document.modelspace())
    document.saveas(path)
    return [node.mesh for node in rj.load(path).nodes]


@pytest.mark.parametrize("kind", ["polyface", "mesh"])
def test_meshes_of_a_dxf_file_are_faces(tmp_path, kind):
    forms = pytest.importorskip("ezdxf.render.forms")
    (mesh,) = drawn(
        tmp_path / "a.dxf", lambda _, space: getattr(forms.cube(), f"render_{kind}")(space)
    )
    assert len(mesh.faces) == 12
    assert mesh.is_closed()
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Outside to the front: away from the middle.
    assert ((normals * corners.mean(axis=1)).sum(axis=1) > 0).all()


@pytest.mark.parametrize(
    ("add", "corners", "count"),
    [
        ("add_3dface", [(0, 0), (1, 0), (1, 1), (0, 1)], 2),
        ("add_3dface", [(0, 0), (1, 0), (1, 1), (1, 1)], 1),
        ("add_solid", [(0, 0), (1, 0), (0, 1), (1, 1)], 2),
    ],
)
def test_filled_faces_of_a_dxf_file_are_faces(tmp_path, add, corners, count):
    (mesh,) = drawn(tmp_path / "a.dxf", lambda _, space: getattr(space, add)(corners))
    triangles = mesh.vertices[mesh.faces]
    area = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[:, 2] / 2
    assert area == pytest.approx([0.5] * count)


def test_a_spline_goes_through_its_fit_points(tmp_path):
    points = [(0, 0), (1, 2), (3, 1), (4, 4)]
    (lines,) = drawn(tmp_path / "a.dxf", lambda _, space: space.add_spline(points))
    for x, y in points:
        gaps = np.linalg.norm(lines.vertices - [x, y, 0], axis=1)
        assert gaps.min() < 0.1


def test_blocks_of_a_dxf_file_are_drawn_wherever_they_are_inserted(tmp_path):
    def build(document, space):
        block = document.blocks.new("B")
        block.add_line((0, 0), (1, 0))
        space.add_blockref("B", (5, 5), dxfattribs={"xscale": 2})
        space.add_blockref("B", (0, 0), dxfattribs={"row_count": 2, "row_spacing": 10})

    (lines,) = drawn(tmp_path / "a.dxf", build)
    ends = sorted(lines.vertices[lines.segments][:, :, :2].reshape(-1, 4).tolist())
    assert ends == [[0, 0, 1, 0], [0, 10, 1, 10], [5, 5, 7, 5]]


@pytest.mark.parametrize("hide", ["off", "freeze"])
@pytest.mark.parametrize("is_inside", [False, True])
def test_what_is_hidden_in_a_dxf_file_is_left_out_and_counted(tmp_path, hide, is_inside):
    def build(document, space):
        getattr(document.layers.add("hidden"), hide)()
        document.layers.add("other")
        block = document.blocks.new("B") if is_inside else space
        block.add_line((0, 0), (1, 0))
        block.add_line((0, 1), (1, 1), dxfattribs={"layer": "hidden"})
        block.add_line((0, 2), (1, 2), dxfattribs={"layer": "other"})
        block.add_circle((9, 9), 1, dxfattribs={"invisible": 1})
        block.add_point((7, 7), dxfattribs={"layer": "HIDDEN"})
        if is_inside:
            space.add_blockref("B", (0, 0), dxfattribs={"layer": "other"})

    with pytest.warns(rj.LoadWarning) as caught:
        (lines,) = drawn(tmp_path / "a.dxf", build)
    assert sorted(set(lines.vertices[:, 1])) == [0.0, 2.0]
    layer = "on a layer that is off" if hide == "off" else "on a frozen layer"
    assert caught[0].message.left_out == {f"entity {layer}": 2, "entity invisible": 1}


@pytest.mark.parametrize(("hide", "seen"), [("off", [1.0]), ("freeze", [])])
def test_a_block_on_a_hidden_layer_hides_what_has_no_layer_of_its_own(tmp_path, hide, seen):
    def build(document, space):
        getattr(document.layers.add("hidden"), hide)()
        document.layers.add("other")
        block = document.blocks.new("B")
        block.add_line((0, 0), (1, 0))
        block.add_line((0, 1), (1, 1), dxfattribs={"layer": "other"})
        space.add_blockref("B", (0, 0), dxfattribs={"layer": "hidden"})
        space.add_line((0, 5), (1, 5))

    with pytest.warns(rj.LoadWarning, match=r"left out entity on a .* \(1\)"):
        (lines,) = drawn(tmp_path / "a.dxf", build)
    assert sorted(set(lines.vertices[:, 1])) == [*seen, 5.0]


def test_a_block_that_a_dxf_file_lacks_is_named(tmp_path):
    def build(_, space):
        space.add_line((0, 0), (1, 0))
        space.add_blockref("NONE", (0, 0))
        space.add_blockref("NONE", (1, 0))

    with pytest.warns(rj.LoadWarning, match=r"undefined block \(2\)"):
        drawn(tmp_path / "a.dxf", build)


def test_damage_that_ezdxf_mends_is_named(tmp_path):
    def build(_, space):
        space.add_line((0, 0), (1, 0), dxfattribs={"linetype": "NONE"})

    with pytest.warns(rj.LoadWarning, match=r"damage that ezdxf names undefined linetype \(1\)"):
        drawn(tmp_path / "a.dxf", build)


def test_colours_of_a_dxf_file_are_those_of_entities_or_layers(tmp_path):
    def build(document, space):
        document.layers.add("blue", color=5)
        space.add_line((0, 0), (1, 0), dxfattribs={"color": 1})
        space.add_line((0, 1), (1, 1), dxfattribs={"layer": "blue"})
        space.add_line((0, 2), (1, 2))

    (lines,) = drawn(tmp_path / "a.dxf", build)
    assert lines.face_colors[:, :3].tolist() == [[1, 0, 0], [0, 0, 1], [0, 0, 0]]


def test_entities_that_are_not_drawn_are_named(tmp_path):
    def build(_, space):
        space.add_hatch()
        space.add_mtext("words")
        space.add_line((0, 0), (1, 1))
        space.add_line((0, 0), (0, 0))

    with pytest.warns(rj.LoadWarning) as said:
        drawn(tmp_path / "a.dxf", build)
    assert said[0].message.left_out["HATCH entity"] == 1
    assert said[0].message.left_out["text of a drawing"] == 1


def test_without_ezdxf_what_trimesh_passes_over_is_named(tmp_path, monkeypatch):
    dxf(tmp_path / "a.dxf", "lines", "circle")
    text = (tmp_path / "a.dxf").read_text()
    face = "  0\n3DFACE\n  8\n0\n 10\n0\n 20\n0\n 30\n0\n"
    at = text.index("ENTITIES\n") + len("ENTITIES\n")
    (tmp_path / "a.dxf").write_text(text[:at] + face + text[at:])
    monkeypatch.setattr("rasterjit.io.foreign.readers.find_spec", lambda name: None)
    with pytest.warns(rj.LoadWarning, match=r"3DFACE entity, which ezdxf would read \(1\)"):
        rj.load(tmp_path / "a.dxf", isolate=False)


def test_elements_of_an_svg_file_that_are_not_drawn_are_named(tmp_path):
    pytest.importorskip("svg.path")
    text = (
        '<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 L4 0 L4 3 Z"/><text>a</text>'
        '<ellipse rx="1" ry="2"/><image href="a.png"/><title>b</title></svg>'
    )
    with pytest.warns(rj.LoadWarning) as said:
        rj.load(write(tmp_path / "a.svg", text))
    names = ("text", "ellipse", "image")
    assert said[0].message.left_out == {f"{name} element": 1 for name in names}


def test_an_svg_drawing_stands_upright(tmp_path):
    pytest.importorskip("svg.path")
    text = (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 10 10">'
        '<path d="M0 0 L4 0 L4 3 Z"/><line x1="7" y1="1" x2="7" y2="9"/></svg>'
    )
    (node,) = rj.load(write(tmp_path / "a.svg", text)).nodes
    assert node.mesh.primitive == "lines"
    assert lengths(node.mesh).sum() == pytest.approx(12 + 8)
    low, high = rj.load(tmp_path / "a.svg").bounds()
    assert low.tolist() == [0, -9, 0]
    assert high.tolist() == [7, 0, 0]


def test_an_svg_file_without_its_package_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "svg.path", None)
    with pytest.raises(rj.MeshFileError, match=r"pip install 'rasterjit\[formats\]'"):
        rj.load(write(tmp_path / "a.svg", "<svg/>"))


# trimesh


def test_curves_of_trimesh_are_joined_at_the_points_that_they_share():
    entities = [Line([0, 1]), Arc([1, 2, 3]), Bezier([3, 1, 2, 0])]
    path = trimesh.path.Path3D(entities=entities, vertices=CORNERS, process=False)
    (node,) = rj.load(path).nodes
    segments = node.mesh.segments
    assert segments[0].tolist() == [0, 1]
    assert (segments[1:, 0] == segments[:-1, 1]).all()
    assert segments[-1, 1] == 0


def test_colours_of_curves_are_those_of_their_segments():
    entities = [Line([0, 1, 2], color=[255, 0, 0, 255]), Line([2, 3], color=[0, 128, 0, 255])]
    path = trimesh.path.Path3D(entities=entities, vertices=CORNERS, process=False)
    scene = rj.Scene()
    lines = scene.add(path).mesh
    green = float(srgb_to_linear(np.array([128], np.uint8))[0])
    assert lines.face_colors[:, :2].tolist() == [[1, 0], [1, 0], [0, pytest.approx(green)]]
    assert lines.material.base_color is None


def test_a_drawing_of_texts_alone_is_refused():
    path = trimesh.path.Path2D(entities=[Text(0, "a")], vertices=[[0.0, 0.0]], process=False)
    with pytest.raises(rj.MeshFileError, match="trimesh Path2D holds a 2-D drawing of 1 curves, "):
        rj.load(path)


ARC_RNG = np.random.default_rng(46)


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("is_closed", [False, True])
def test_an_arc_goes_through_its_points_and_reaches_as_far_as_its_bounds(axes, is_closed):
    for _ in range(50):
        through = ARC_RNG.normal(size=(3, axes)) * 10.0 ** ARC_RNG.integers(-9, 9)
        arc = make_arc(through, is_closed)
        dense = arc.sample(4_000, through, is_closed)
        gaps = np.linalg.norm(dense[:, None] - through, axis=2).min(axis=0)
        assert (gaps <= 1e-3 * arc.radius).all()
        assert np.linalg.norm(dense - arc.center, axis=1) == pytest.approx(arc.radius, rel=1e-6)
        assert dense[0].tolist() == through[0].tolist()
        assert dense[-1].tolist() == through[0 if is_closed else 2].tolist()
        if not is_closed:
            # From the first by way of the second.
            nearest = np.linalg.norm(dense[:, None] - through, axis=2).argmin(axis=0)
            assert nearest[0] < nearest[1] < nearest[2]
        assert arc.bounds() == pytest.approx(
            np.array([dense.min(axis=0), dense.max(axis=0)]), rel=0.0, abs=1e-6 * arc.radius
        )


@pytest.mark.parametrize("sagitta", [1e-6, 1e-3, 0.1, 1.0])
def test_segments_of_an_arc_lie_beside_it_by_less_than_is_seen(sagitta):
    through = np.array([[-1.0, 0.0], [0.0, sagitta], [1.0, 0.0]])
    path = trimesh.path.Path2D(entities=[Arc([0, 1, 2])], vertices=through, process=False)
    lines = rj.load(path).nodes[0].mesh
    assert len(lines.segments) < 200
    middles = lines.vertices[lines.segments].mean(axis=1)[:, :2]
    radius = (1.0 + sagitta**2) / (2.0 * sagitta)
    beside = radius - np.linalg.norm(middles - [0.0, sagitta - radius], axis=1)
    assert beside.max() <= 2.1e-4 * max(1.0, np.hypot(1.0, 0.5 * sagitta))


def test_points_on_a_line_are_an_arc_without_a_bend():
    through = np.array([[0.0, 0.0], [1.0, 0.0], [5.0, 0.0]])
    assert make_arc(through, False) is None
    path = trimesh.path.Path2D(entities=[Arc([0, 1, 2])], vertices=through, process=False)
    assert lengths(rj.load(path).nodes[0].mesh).sum() == 5.0
    with pytest.raises(ValueError, match="a circle's points must not lie on a line"):
        make_arc(through, True)


def test_a_curve_of_no_number_is_refused_by_name_or_left_out():
    vertices = np.array([[0.0, 0.0], [1.0, 0.0], [np.nan, 0.0], [1.0, 1.0]])
    entities = [Line([0, 1]), Bezier([1, 2, 3])]
    path = trimesh.path.Path2D(entities=entities, vertices=vertices, process=False)
    with pytest.raises(rj.MeshFileError, match=r"Bezier 1 of the drawing .*: its points must be f"):
        rj.load(path)
    with pytest.warns(rj.LoadWarning, match=r"Bezier of a drawing that cannot be followed"):
        scene = rj.load(path, on_invalid="drop")
    assert len(scene.nodes[0].mesh.segments) == 1


# OBJ


def test_lines_of_an_obj_file_are_strips_between_its_vertices(tmp_path):
    vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 9 9 9\n"
    lines = only(write(tmp_path / "a.obj", f"{vertices}l 1 2 3\nl -2/1 1/1\n"))
    assert lines.segments.tolist() == [[0, 1], [1, 2], [3, 0]]
    assert np.array_equal(lines.vertices, CORNERS)
    text = f"{vertices}f 1 2 3\nl 4 5\np 1\n"
    scene = rj.load(write(tmp_path / "b.obj", text))
    assert [node.mesh.primitive for node in scene.nodes] == ["triangles", "lines", "points"]
    for bad, said in (("l 1", "a line of 2 vertices or more"), ("l 1 9", "vertices among 5 v")):
        with pytest.raises(rj.MeshFileError, match=f"line 6: expected {said}.*, got '{bad}'"):
            rj.load(write(tmp_path / "c.obj", f"{vertices}{bad}\n"))


def test_lines_of_an_obj_file_have_the_colour_of_their_material(tmp_path):
    write(tmp_path / "a.mtl", "newmtl red\nKd 1 0 0\n")
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nusemtl red\nl 1 2\n"
    lines = only(write(tmp_path / "a.obj", text))
    assert lines.material.shading == "unlit"
    assert lines.material.base_color == (1, 0, 0, 1)


# glTF


def things():
    """Return a scene of points and lines."""
    scene = rj.Scene()
    xyz, colors = RNG.random((30, 3)), RNG.random((30, 4))
    normals = RNG.normal(size=(30, 3))
    heat = {"heat": RNG.random((30, 1))}
    scene.add(rj.Points(xyz, colors=colors, normals=normals, attributes=heat), name="lit")
    scene.add(rj.Points(xyz), name="plain")
    scene.add(rj.Lines(xyz, colors=colors), name="along")
    scene.add(rj.Lines(xyz, [[0, 1], [1, 2], [5, 4]], colors=colors[:3]), name="each")
    scene.add(rj.Lines(xyz, strips=[[0, 1, 2, 0]]), np.diag([2.0, 1, 1, 1]), name="ink")
    return scene


@pytest.mark.parametrize("extension", ["glb", "gltf"])
def test_points_and_lines_come_back_from_gltf(tmp_path, extension):
    scene = things()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.save(tmp_path / f"a.{extension}")
        loaded = rj.load(tmp_path / f"a.{extension}")
    assert [node.name for node in loaded.nodes] == [node.name for node in scene.nodes]
    for node, other in zip(scene.nodes, loaded.nodes, strict=True):
        mesh, found = node.mesh, other.mesh
        assert type(found) is type(mesh)
        assert np.array_equal(node.world_matrix, other.world_matrix)
        corners, others = mesh.vertices[mesh.faces], found.vertices[found.faces]
        assert np.array_equal(corners.astype(np.float32), others)
        assert (mesh.normals is None) == (found.normals is None)
        colors = None if isinstance(mesh, rj.Points) else mesh.face_colors
        if isinstance(mesh, rj.Points):
            assert (mesh.colors is None) == (found.colors is None)
            assert mesh.colors is None or np.array_equal(found.colors, mesh.colors)
        elif colors is not None:
            assert np.array_equal(found.vertex_colors[found.segments[:, 0]], colors)
        elif mesh.vertex_colors is not None:
            assert np.array_equal(found.vertex_colors, mesh.vertex_colors)
        is_colored = mesh.vertex_colors is not None or mesh.face_colors is not None
        ours = mesh.material.base_color_over(is_colored)
        assert found.material.base_color_over(True) == pytest.approx(
            (1, 1, 1, 1) if colors is not None else ours
        )
    assert np.array_equal(loaded.nodes[4].mesh.segments, scene.nodes[4].mesh.segments)
    assert np.array_equal(
        loaded.nodes[0].mesh.attributes["heat"], scene.nodes[0].mesh.attributes["heat"]
    )


def test_what_gltf_lacks_of_points_and_lines_is_named(tmp_path):
    scene = rj.Scene()
    xyz = CORNERS.copy()
    xyz[1] = np.nan
    scene.add(rj.Points(xyz, size=0.5, unit="world", shape="disc", on_invalid="drop"))
    scene.add(rj.Lines(CORNERS, width=4.0, dashes=[2, 2]))
    said = "points that are NaN or infinite, sizes and shapes of points, widths and dashes of lines"
    with pytest.warns(rj.SaveWarning, match=said):
        scene.save(tmp_path / "a.glb")
    assert len(rj.load(tmp_path / "a.glb").nodes[0].mesh) == 3


@pytest.mark.parametrize(
    ("mode", "segments"),
    [(1, [[0, 1], [2, 3]]), (3, [[0, 1], [1, 2], [2, 3]]), (2, [[0, 1], [1, 2], [2, 3], [3, 0]])],
)
def test_lines_of_gltf_are_joined_as_their_mode_says(tmp_path, mode, segments):
    import json

    scene = rj.Scene()
    scene.add(rj.Lines(CORNERS[[0, 1, 2, 3]], [[0, 1], [2, 3]]))
    scene.save(tmp_path / "a.gltf")
    header = json.loads((tmp_path / "a.gltf").read_text())
    header["meshes"][0]["primitives"][0]["mode"] = mode
    (tmp_path / "a.gltf").write_text(json.dumps(header))
    assert only(tmp_path / "a.gltf").segments.tolist() == segments


def test_points_and_lines_of_gltf_without_normals_are_unlit_and_show_what_they_emit(tmp_path):
    import json

    scene = rj.Scene()
    scene.add(rj.Points(CORNERS))
    scene.save(tmp_path / "a.gltf")
    header = json.loads((tmp_path / "a.gltf").read_text())
    header["materials"] = [
        {"pbrMetallicRoughness": {"baseColorFactor": [0.25, 0, 0, 1]}, "emissiveFactor": [0, 1, 0]}
    ]
    (tmp_path / "a.gltf").write_text(json.dumps(header))
    material = rj.load(tmp_path / "a.gltf").nodes[0].mesh.material
    assert material.shading == "unlit"
    assert material.base_color == (0.25, 1, 0, 1)


# to trimesh


def test_points_and_lines_come_back_from_trimesh():
    scene = things()
    with pytest.warns(rj.SaveWarning, match="sizes of points, .*widths of lines"):
        made = scene.to_trimesh()
    kinds = [type(geometry).__name__ for geometry in made.geometry.values()]
    assert kinds == ["PointCloud", "PointCloud", "Path3D", "Path3D", "Path3D"]
    loaded = rj.load(made)
    for node, other in zip(scene.nodes, loaded.nodes, strict=True):
        mesh, found = node.mesh, other.mesh
        assert type(found) is type(mesh)
        assert np.array_equal(mesh.vertices[mesh.faces], found.vertices[found.faces])
    assert len(made.geometry["ink"].entities) == 1
    assert made.geometry["ink"].entities[0].closed
    each = loaded.nodes[3].mesh
    assert each.face_colors == pytest.approx(scene.nodes[3].mesh.face_colors, abs=0.01)
