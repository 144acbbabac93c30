"""Laws of lines, and of those that are made for you."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import rasterjit as rj
from rasterjit import transforms

POINTS = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def test_one_strip_goes_through_all_points():
    lines = rj.Lines(POINTS)
    assert lines.segments.tolist() == [[0, 1], [1, 2], [2, 3]]
    assert lines.links.tolist() == [[-1, 1], [0, 2], [1, -1]]
    assert (len(lines), lines.unit, lines.caps) == (3, "pixel", "round")
    assert lines.widths.tolist() == [1.5]
    assert repr(lines) == "Lines(3 segments)"


def test_strips_are_joined_and_closed():
    lines = rj.Lines(POINTS, strips=[[0, 1, 2, 0], [3, 0, 1]])
    assert lines.segments.tolist() == [[0, 1], [1, 2], [2, 0], [3, 0], [0, 1]]
    assert lines.links.tolist() == [[2, 1], [0, 2], [1, 0], [-1, 4], [3, -1]]


def test_segments_that_follow_each_other_are_of_one_strip():
    lines = rj.Lines(POINTS, [(0, 1), (1, 2), (3, 0)])
    assert lines.links.tolist() == [[-1, 1], [0, -1], [-1, -1]]


def test_lines_are_black_unless_they_have_colours():
    assert rj.Lines(POINTS).material.base_color == (0.0, 0.0, 0.0, 1.0)
    assert rj.Lines(POINTS, colors=np.ones((4, 3))).material.base_color is None
    assert rj.Lines(POINTS, scalars=np.arange(3.0)).material.base_color is None


def test_scalars_are_not_drawn_in_ink():
    lines = rj.Lines(np.eye(3))
    shown = lines.with_scalars([0.0, 1.0, 2.0])
    assert isinstance(shown, rj.Lines)
    assert shown.material == rj.Lines(np.eye(3), scalars=[0.0, 1.0, 2.0]).material
    assert lines.material.base_color == (0, 0, 0, 1)


def test_material_must_be_unlit():
    lines = rj.Lines(POINTS)
    lines.material = rj.Material("unlit", base_color="red")
    with pytest.raises(ValueError, match="material must be unlit, for lines have no normals"):
        lines.material = rj.Material("phong")
    with pytest.raises(ValueError, match="material must be a Material, got 'red'"):
        lines.material = "red"
    assert lines.material.base_color == (1.0, 0.0, 0.0, 1.0)
    with pytest.raises(ValueError, match="material must be unlit"):
        rj.Lines(POINTS, material=rj.Material())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width": 0.0}, "width must be finite and above 0, got 0.0"),
        ({"width": -1}, "width must be finite and above 0"),
        ({"width": np.nan}, "width must be finite and above 0"),
        ({"width": 5000.0}, "width must be at most 4096 pixels, got 5000.0"),
        ({"width": [1.0, 2.0]}, r"width must be one number or have shape \(3,\), got \(2,\)"),
        ({"width": "thin"}, "width must be a number or an array of numbers, got 'thin'"),
        ({"unit": "metre"}, "unit must be one of 'pixel', 'world'; got 'metre'"),
        ({"caps": "square"}, "caps must be one of 'round', 'butt'; got 'square'"),
        ({"dashes": [3.0]}, "dashes must be an even number of lengths"),
        ({"dashes": [3.0, 0.0]}, "dashes must be finite and above 0"),
        ({"dashes": 3.0}, "dashes must be an even number of lengths"),
        ({"strips": [[0]]}, r"strips\[0\] must have two or more points, got 1"),
        ({"strips": []}, "strips must hold one strip or more, got none"),
        ({"strips": [[0, 9]]}, r"strips\[0\]"),
        ({"strips": 5}, "strips must be a sequence of sequences of point numbers, got 5"),
        ({"strips": [0, 1, 2]}, "strips must be a sequence of sequences of point numbers, as"),
        ({"strips": [np.eye(3)]}, r"strips\[0\] must be point numbers.*join .*np.concatenate"),
        ({"strips": [[[0, 1]]]}, r"strips\[0\] must be point numbers, \(N,\), got shape \(1, 2\)"),
        ({"strips": [[[0], [1, 2]]]}, r"strips\[0\] must be point numbers, \(N,\), got"),
        ({"segments": [[0, 1]], "strips": [[0, 1]]}, "strips must be None where segments"),
        ({"segments": [[0, 4]]}, "segments"),
        ({"segments": [[0, 1, 2]]}, "segments"),
        ({"colors": np.ones((2, 3))}, "colors must have one row per"),
        ({"scalars": np.ones(7)}, "scalars"),
    ],
)
def test_bad_input_is_refused_by_name(options, message):
    with pytest.raises(ValueError, match=message):
        rj.Lines(POINTS, **options)


def test_lines_have_no_contours():
    lines = rj.Lines(POINTS, scalars=np.arange(4.0))
    with pytest.raises(
        ValueError, match="contours must be None for lines, which have no slopes; got 3"
    ):
        lines.with_scalars(np.arange(4.0), contours=3)
    assert isinstance(lines.with_scalars(np.arange(4.0), "plasma"), rj.Lines)


def test_a_single_point_is_no_line():
    with pytest.raises(ValueError, match="points must be two or more without segments, got 1"):
        rj.Lines(POINTS[:1])
    with pytest.raises(ValueError, match="points"):
        rj.Lines([[0.0, 0, np.nan], [1, 0, 0]])


def test_several_arrays_of_points_are_to_be_joined():
    ways = [np.zeros((5, 3)), np.ones((3, 3))]
    with pytest.raises(ValueError, match=r"one array, \(V, 3\), got 2 arrays.*np.concatenate"):
        rj.Lines(ways)
    joined = rj.Lines(np.concatenate(ways), strips=[range(5), range(5, 8)])
    assert joined.segments[3:5].tolist() == [[3, 4], [5, 6]]


def test_lines_tell_what_they_were_given():
    colors, values = np.ones((4, 4)) * [[0.5], [0.25], [0.75], [1.0]], np.ones((3, 2))
    lines = rj.Lines(POINTS, colors=colors, attributes={"speed": values, "time": np.ones((4, 1))})
    assert lines.points is lines.vertices
    np.testing.assert_array_equal(lines.colors, np.float32(colors))
    np.testing.assert_array_equal(rj.Lines(POINTS, colors=colors[:3]).colors, lines.colors[:3])
    assert rj.Lines(POINTS).colors is None
    assert {name: held.shape for name, held in lines.attributes.items()} == {
        "time": (4, 1), "speed": (3, 2),
    }  # fmt: skip
    with pytest.raises(TypeError):
        lines.attributes["speed"] = values


def test_lines_are_never_closed_surfaces():
    assert not rj.Lines(POINTS, strips=[[0, 1, 2, 0]]).is_closed()


def test_copies_are_the_same_lines():
    lines = rj.Lines(POINTS, width=[1.0, 2.0, 3.0], dashes=[2, 1])
    for other in (copy.deepcopy(lines), pickle.loads(pickle.dumps(lines))):
        assert other.widths.tolist() == [1.0, 2.0, 3.0]
        assert other.dashes.tolist() == [2.0, 1.0]
        assert other.links.tolist() == lines.links.tolist()


def test_axes_are_red_green_and_blue():
    axes = rj.Axes(2.0)
    ends = axes.vertices[axes.segments[:, 1]] - axes.vertices[axes.segments[:, 0]]
    np.testing.assert_array_equal(ends, 2.0 * np.eye(3))
    assert axes.face_colors[:, :3].argmax(axis=1).tolist() == [0, 1, 2]
    with pytest.raises(ValueError, match="size must be"):
        rj.Axes(0.0)


def test_a_box_is_that_of_a_mesh_a_node_or_a_scene():
    mesh = rj.Mesh([[0.0, 0, 0], [1, 0, 0], [0, 2, 3]], [[0, 1, 2]])
    scene = rj.Scene()
    group = rj.Node(None, name="group", transform=transforms.translate((0, 0, 5)))
    scene.add(group)
    scene.add(mesh, transform=transforms.translate((10, 0, 0)), parent=group)
    box = rj.BoundingBox(mesh)
    assert len(box) == 12
    for made, low, high in (
        (box, (0, 0, 0), (1, 2, 3)), (rj.BoundingBox(group), (10, 0, 5), (11, 2, 8)),
        (rj.BoundingBox(scene), (10, 0, 5), (11, 2, 8)),
    ):  # fmt: skip
        np.testing.assert_array_equal(np.stack(made.bounds()), (low, high))
    lengths = np.linalg.norm(np.diff(box.vertices[box.segments], axis=1)[:, 0], axis=1)
    assert sorted(lengths.tolist()) == [1.0] * 4 + [2.0] * 4 + [3.0] * 4
    with pytest.raises(ValueError, match="of must be a Mesh, a Node or a Scene, got 3"):
        rj.BoundingBox(3)
    with pytest.raises(ValueError, match="of must have a mesh, or a node below it must"):
        rj.BoundingBox(rj.Node(None, name="nothing"))


def test_a_grid_lies_in_its_plane():
    grid = rj.Grid(6.0, 3, center=(1, 2, 3))
    assert len(grid) == 8
    np.testing.assert_array_equal(np.stack(grid.bounds()), [(-2, 2, 0), (4, 2, 6)])
    ways = np.diff(grid.vertices[grid.segments], axis=1)[:, 0]
    assert sorted(map(tuple, ways.tolist())) == [(0.0, 0.0, 6.0)] * 4 + [(6.0, 0.0, 0.0)] * 4
    assert np.ptp(rj.Grid(plane="yz").vertices[:, 0]) == 0.0
    with pytest.raises(ValueError, match=r"cells must be a whole number in 1..4096, got 0"):
        rj.Grid(cells=0)
    with pytest.raises(ValueError, match="plane must be one of"):
        rj.Grid(plane="zx")


@pytest.mark.parametrize(
    "camera",
    [
        rj.PerspectiveCamera((1, 2, 3), (4, 0, 1), fov_y=40.0),
        rj.OrthographicCamera((1, 2, 3), (4, 0, 1), height=3.0),
    ],
)
def test_a_frustum_ends_where_the_picture_does(camera):
    frustum = rj.Frustum(camera, 4.0, 2.0, size=(640, 480))
    shown, _ = camera.project(frustum.vertices, (640, 480))
    wanted = [(0, 480), (640, 480), (640, 0), (0, 0)] * 2
    np.testing.assert_allclose(shown[:8], wanted, atol=1e-9)
    ahead = -(frustum.vertices @ camera.view_matrix()[2, :3] + camera.view_matrix()[2, 3])
    np.testing.assert_allclose(ahead[:8], [2.0] * 4 + [4.0] * 4)
    assert shown[9, 1] < 0.0
    with pytest.raises(ValueError, match=r"near must be in 0..far"):
        rj.Frustum(camera, 1.0, 2.0)
    with pytest.raises(ValueError, match="camera must be a camera"):
        rj.Frustum("camera")


def test_poses_are_a_way_and_axes():
    poses = [transforms.translate((n, 0, 0)) @ transforms.rotate_z(90.0) for n in range(3)]
    lines = rj.Lines.from_poses(poses, axes=0.5)
    assert len(lines) == 2 + 9
    first = lines.vertices[lines.segments[2]]
    np.testing.assert_allclose(first, [(0, 0, 0), (0, 0.5, 0)], atol=1e-15)
    assert lines.face_colors[2:5, :3].argmax(axis=1).tolist() == [0, 1, 2]
    assert len(rj.Lines.from_poses(poses, axes=0)) == 2
    with pytest.raises(ValueError, match="poses must be two or more, got 1"):
        rj.Lines.from_poses(poses[:1])
    with pytest.raises(ValueError, match="poses must have shape"):
        rj.Lines.from_poses(np.eye(4))
