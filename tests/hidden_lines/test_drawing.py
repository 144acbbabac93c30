"""Line drawings: kinds of edges, sections, labels, what is refused, and their files."""

from __future__ import annotations

import dataclasses
import re
import warnings
import xml.etree.ElementTree as ET
import zlib

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.hidden_lines import graphics, helvetica

SVG = "{http://www.w3.org/2000/svg}"


def box_scene():
    box, scene = trimesh.creation.box((2.0, 2.0, 2.0)), rj.Scene()
    scene.add(rj.Mesh(box.vertices, box.faces))
    return scene


@pytest.fixture(scope="module")
def drawing():
    scene = box_scene()
    scene.add(rj.Label((0, 0, 0), "size <1 (2)\nΩ", color="red", background="yellow"))
    scene.add(rj.Label((0, 0, 0), "inside", hidden=True))
    scene.add(rj.Label((1, 1, 1), "corner", hidden=True, size=20.0, anchor="bottom-left"))
    return rj.line_drawing(scene, rj.fit_camera(scene), (200, 160))


def test_a_box_has_twelve_edges_of_which_three_are_hidden(drawing):
    assert len(drawing.segments) == 12
    assert drawing.visible.sum() == 9
    assert (drawing.kinds[drawing.visible] == "silhouette").sum() == 6
    assert set(drawing.kinds) == {"silhouette", "crease"}
    assert not drawing.segments.flags.writeable
    assert repr(drawing) == "LineDrawing(200 x 160, 9 visible and 3 hidden lines)"


def test_lines_are_joined_where_they_continue(drawing):
    (outline,) = drawing.paths("silhouette")
    assert outline.shape == (7, 2)
    assert (outline[0] == outline[-1]).all()
    assert sum(len(path) - 1 for path in drawing.paths()) == 9
    assert sum(len(path) - 1 for path in drawing.paths(visible=False)) == 3
    assert drawing.paths("boundary") == []


def test_vertices_at_one_place_are_one_and_faces_with_the_same_corners_too():
    box = trimesh.creation.box((2.0, 2.0, 2.0))
    faces = np.concatenate([box.faces, box.faces[:, [1, 0, 2]]])
    soup = rj.Mesh(box.vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3))
    found = rj.line_drawing(soup, rj.fit_camera(soup), (200, 160))
    assert len(found.segments) == 12
    assert found.visible.sum() == 9


def test_creases_are_those_of_the_outline_or_of_an_angle():
    roof = rj.Mesh([(-1, 0, 1), (-1, 0, -1), (0, 0.5, -1), (0, 0.5, 1), (1, 0, -1), (1, 0, 1)],
                   [(0, 2, 1), (0, 3, 2), (3, 4, 2), (3, 5, 4)])  # fmt: skip
    camera = rj.PerspectiveCamera(eye=(0, 5, 0.1), target=(0, 0, 0), fov_y=50.0)
    # Its ridge turns by 53 degrees.
    for angle, count in ((None, 1), (53.0, 1), (53.2, 0)):
        kinds = rj.line_drawing(roof, camera, crease_angle=angle).kinds
        assert (kinds == "crease").sum() == count
        assert (kinds == "boundary").sum() == 6
    scene = rj.Scene()
    scene.add(roof)
    scene.outline = rj.Outline(color="red", crease_angle=60.0)
    found = rj.line_drawing(scene, camera)
    assert set(found.kinds) == {"boundary"}
    assert found.color == (1.0, 0.0, 0.0, 1.0)


def test_three_faces_at_an_edge_make_a_crease_and_the_wireframe_is_asked_for():
    fins = rj.Mesh([(0, 0, -1), (0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0)],
                   [(0, 1, 2), (1, 0, 3), (0, 1, 4)])  # fmt: skip
    assert set(rj.line_drawing(fins).kinds) == {"boundary", "crease"}
    ball = trimesh.creation.icosphere(2)
    mesh = rj.Mesh(ball.vertices, ball.faces)
    assert set(rj.line_drawing(mesh).kinds) == {"silhouette"}
    found = rj.line_drawing(mesh, edges=("wireframe",))
    assert len(found.segments) >= len(ball.edges_unique)


@pytest.mark.parametrize("lines", [True, False])
def test_sections_have_their_outline_once_and_no_other_boundary(lines):
    scene = box_scene()
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=4.0)
    scene.section = rj.SectionPlane((0, 0, 0.5), (0, 0, 1), lines=lines)
    found = rj.line_drawing(scene, camera, (64, 64))
    is_cut = found.kinds == "section"
    # Four sides, each of two faces.
    assert is_cut.sum() == 8
    assert found.visible[is_cut].all()
    assert set(found.object_ids) == {0}
    assert "boundary" not in found.kinds
    assert len(found.paths("section")) == 1
    # Where planes meet, their caps do.
    scene.section = [scene.section, rj.SectionPlane((0.5, 0, 0), (1, 0, 0))]
    found = rj.line_drawing(scene, camera, (64, 64))
    seen = found.segments[(found.kinds == "section") & found.visible]
    corner = seen[(seen[:, :, 0] == 40.0).all(axis=1)]
    assert np.ptp(corner[:, :, 1], axis=1).sum() == 32.0
    assert (rj.line_drawing(scene, camera, (64, 64), edges=("crease",)).kinds == "crease").all()


def test_lines_are_drawn_and_points_are_named():
    scene = box_scene()
    scene.add(rj.Lines([(-3, 0, 0), (3, 0, 0), (3, 1, 0)]))
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=8.0)
    found = rj.line_drawing(scene, camera, (64, 64))
    is_line = found.kinds == "line"
    assert is_line.sum() == 4
    assert (is_line & ~found.visible).sum() == 1
    scene.add(rj.Points([(0, 0, 0)]))
    with pytest.warns(UserWarning, match="scene has 1 object of points, which"):
        assert (rj.line_drawing(scene, camera).kinds == "line").sum() == 4


def test_hatchings_that_are_left_out_are_named():
    scene = box_scene()
    plane = rj.SectionPlane((0, 0, 0), (0, 0, 1), hatch=8)
    scene.section = [rj.SectionPlane((0.5, 0, 0), (1, 0, 0)), plane]
    with pytest.warns(UserWarning, match="has a hatch in plane 1, which a line drawing leaves out"):
        rj.line_drawing(scene)
    scene.section = dataclasses.replace(plane, cap=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rj.line_drawing(scene)


def test_dimensions_are_lines_and_texts_of_a_drawing():
    scene = box_scene()
    scene.add(rj.length_dimension((-1, -1, 1), (1, -1, 1), offset=(0, -0.5, 0), units="mm"))
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=4.0)
    found = rj.line_drawing(scene, camera, (64, 64))
    assert found.visible[found.kinds == "line"].all()
    ((label, place),) = found.labels
    assert (label.text, place) == ("2.00 mm", (32.0, 56.0))


def test_labels_are_where_the_camera_sees_them_unless_hidden(drawing):
    assert [label.text for label, _ in drawing.labels] == ["size <1 (2)\nΩ", "corner"]
    camera = rj.fit_camera(box_scene())
    pixels = camera.project([(0, 0, 0), (1, 1, 1)], (200, 160)).pixels
    np.testing.assert_allclose([place for _, place in drawing.labels], pixels, rtol=1e-12)


def test_svg_holds_paths_in_points_and_texts(drawing, tmp_path):
    drawing.save(tmp_path / "a.svg", dpi=144, hidden="dashed", width={"crease": 0.7, "hidden": 0.2},
                 color={"hidden": "gray"}, background="white")  # fmt: skip
    root = ET.parse(tmp_path / "a.svg").getroot()
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == (
        "100pt", "80pt", "0 0 100 80"
    )  # fmt: skip
    groups = {group.get("class"): group for group in root.iter(f"{SVG}g")}
    assert list(groups) == ["hidden", "crease", "silhouette"]
    assert groups["hidden"].get("stroke-dasharray") == "3 2"
    assert groups["hidden"].get("stroke") == "#808080"
    widths = [float(group.get("stroke-width")) for group in groups.values()]
    assert widths == [0.2, 0.7, 1.0]
    (outline,) = groups["silhouette"]
    assert outline.get("d").endswith("Z")
    points = np.array([point.split() for point in outline.get("d")[1:-1].split("L")], float)
    np.testing.assert_allclose(points, drawing.paths("silhouette")[0][:-1] / 2, atol=0.00051)
    texts = {text.text: text for text in root.iter(f"{SVG}text")}
    assert list(texts) == ["size <1 (2)", "Ω", "corner"]
    assert texts["Ω"].get("text-anchor") == "middle"
    assert texts["corner"].get("font-size") == "10"
    assert len(list(root.iter(f"{SVG}rect"))) == 2


def test_lines_are_opaque_whatever_the_alpha_of_outlines(tmp_path):
    scene = box_scene()
    scene.outline = rj.Outline((1.0, 0.0, 0.0, 0.5))
    rj.line_drawing(scene).save(tmp_path / "a.svg")
    text = (tmp_path / "a.svg").read_text()
    assert 'stroke="#ff0000"' in text
    assert "opacity" not in text


def page_of(path):
    """Return the operators of a PDF's page, after a look at its table of objects."""
    content = path.read_bytes()
    assert content.startswith(b"%PDF-1.4")
    start = int(content.rsplit(b"startxref\n", 1)[1].split()[0])
    for number, row in enumerate(re.findall(rb"(\d{10}) 00000 n", content[start:]), 1):
        assert content[int(row) :].startswith(b"%d 0 obj" % number)
    return zlib.decompress(content.split(b"stream\n")[1].split(b"\nendstream")[0]).decode("cp1252")


def test_pdf_is_one_page_with_the_same_lines(drawing, tmp_path):
    drawing.save(tmp_path / "a.pdf", hidden="dashed")
    assert b"/MediaBox [0 0 200 160]" in (tmp_path / "a.pdf").read_bytes()
    page = page_of(tmp_path / "a.pdf")
    assert "(corner) Tj" in page
    assert "[3 2] 0 d" in page
    (outline,) = (line for line in page.splitlines() if line.endswith(" s"))
    points = np.array(re.findall(r"([\d.]+) ([\d.]+) [ml]", outline), float)
    want = drawing.paths("silhouette")[0][:-1] * (1, -1) + (0, 160)
    np.testing.assert_allclose(points, want, atol=0.00051)
    drawing.save(tmp_path / "b.pdf", hidden="dashed")
    assert (tmp_path / "b.pdf").read_bytes() == (tmp_path / "a.pdf").read_bytes()


def test_pdf_has_outlines_of_texts_that_helvetica_lacks(tmp_path):
    def save(text):
        scene = box_scene()
        scene.add(rj.Label((0, 0, 0), text, size=20.0))
        rj.line_drawing(scene, rj.fit_camera(scene), (200, 160)).save(tmp_path / "a.pdf")
        return page_of(tmp_path / "a.pdf")

    assert r"(a \(b\) \\ ±2°) Tj" in save("a (b) \\ ±2°")
    page = save("Ω")
    assert "Tj" not in page
    curves = re.findall(r"^([\d. ]+) c$", page, re.MULTILINE)
    points = np.array([row.split()[4:] for row in curves], float)
    # Around the label's place, as wide and high as the letter.
    x, y = rj.fit_camera(box_scene()).project((0, 0, 0), (200, 160)).pixels
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    assert np.abs(middle - (x, 160.0 - y)).max() < 3.0
    assert 10.0 < np.ptp(points, axis=0).max() < 16.0
    with pytest.warns(UserWarning, match="no font has"):
        save("\ue123\ufdd0")


def test_a_file_is_as_it_was_where_a_new_one_is_refused(drawing, tmp_path):
    place = tmp_path / "a.svg"
    drawing.save(place)
    before = place.read_bytes()
    for arguments, words in (
        ({"dpi": 0.0}, "dpi"), ({"dpi": 0.1}, "dpi must leave a page"), ({"width": -1.0}, "width"),
        ({"width": {"edge": 1.0}}, "width's kinds"), ({"width": {"crease": 0.0}}, "width.'crease'"),
        ({"color": "blu"}, "color"), ({"hidden": "dotted"}, "hidden"), ({"dash": (1.0,)}, "dash"),
        ({"dash": (1.0, -1.0)}, r"dash\[1\]"), ({"width": 1e-4}, r"width must be in 0\.001\.\."),
        ({"dash": (1e-4, 1.0)}, r"dash\[0\] must be in 0\.001"),
        ({"background": "rd"}, "background"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            drawing.save(place, **arguments)
    assert place.read_bytes() == before
    for name in ("a.png", "a", "no/a.svg"):
        with pytest.raises(ValueError, match="path"):
            drawing.save(tmp_path / name)
    assert [one.name for one in tmp_path.iterdir()] == ["a.svg"]


def test_bad_input_is_named():
    box = box_scene()
    for arguments, words in (
        ({"edges": ()}, "edges must name"), ({"edges": ("outline",)}, "edges"),
        ({"edges": 3}, "edges"), ({"crease_angle": 181.0}, "crease_angle"),
        ({"size": (0, 4)}, "size"), ({"camera": 3}, "camera"), ({"threads": 0}, "threads"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            rj.line_drawing(box, **arguments)
    with pytest.raises(ValueError, match="scene"):
        rj.line_drawing(3)
    with pytest.raises(ValueError, match="kind"):
        rj.line_drawing(box).paths("outline")


def test_nothing_in_view_is_an_empty_drawing(tmp_path):
    camera = rj.PerspectiveCamera(eye=(0, 0, 5), target=(0, 0, 9), fov_y=40.0)
    found = rj.line_drawing(box_scene(), camera)
    assert found.segments.shape == (0, 2, 2)
    assert found.paths() == []
    found.save(tmp_path / "a.pdf")
    found.save(tmp_path / "a.svg")


def test_widths_of_helvetica_are_adobes():
    afm = pytest.importorskip("matplotlib._afm")
    cbook = pytest.importorskip("matplotlib.cbook")
    with open(cbook._get_data_path("fonts/pdfcorefonts/Helvetica.afm"), "rb") as file:
        names = {name: row.width for name, row in afm.AFM(file)._metrics_by_name.items()}
    glyphs = pytest.importorskip("fontTools.agl").UV2AGL
    for code in range(32, 256):
        character = bytes([code]).decode("cp1252", "ignore")
        if character and glyphs.get(ord(character)) in names:
            width = names[glyphs[ord(character)]]
            assert helvetica.measure_width(character) == width / 1000.0, character


def test_numbers_have_three_places_and_no_more_than_they_need():
    values, want = (-0.0001, 2.0, 10.5, 0.12345, -3.1), ["0", "2", "10.5", "0.123", "-3.1"]
    assert [graphics.format_number(value) for value in values] == want
