"""Outlines follow what ends, what meets and what bends, and nothing else, at any scale."""

from __future__ import annotations

import math

import naive_screen
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.effects import outline as outline_effect

MOVE, GROW = rj.transforms.translate, rj.transforms.scale
SIZE = (120, 90)
RED = np.array([255, 0, 0, 255], np.uint8)


def plane(half=4.0, cells=1):
    """A square in x and z that faces up, of so many cells a side."""
    line = np.linspace(-half, half, cells + 1)
    vertices = [(x, 0.0, z) for z in line for x in line]
    rows = [(r * (cells + 1) + c, cells + 1) for r in range(cells) for c in range(cells)]
    faces = [f for a, n in rows for f in ((a, a + n, a + n + 1), (a, a + n + 1, a + 1))]
    return rj.Mesh(vertices, faces)


def scene_of(*meshes, **settings):
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh)
    scene.outline = rj.Outline(**{"color": "red", **settings})
    return scene


def lines(scene, camera, size=SIZE, **options):
    """Where outlines are drawn, and the frame."""
    options.setdefault("outputs", ("color", "linear", "face_id", "object_id", "position", "normal"))
    frame = rj.render(scene, camera, size=size, background="#203040", **options)
    outline, scene.outline = scene.outline, None
    without = rj.render(scene, camera, size=size, background="#203040", **options)
    scene.outline = outline
    drawn = (frame.color == RED).all(2)
    # Nothing but the colour is touched, and the colour nowhere else.
    assert np.array_equal(frame.color[~drawn], without.color[~drawn])
    for name, array in without.arrays().items():
        if name != "color":
            assert np.array_equal(frame.arrays()[name], array, equal_nan=True), name
    return drawn, frame


def looking(eye=(2.0, 2.5, 4.0), **more):
    return rj.PerspectiveCamera(eye=eye, target=(0, 0, 0), fov_y=40.0, near=0.05, **more)


def ends(seen):
    """Where what is seen has a neighbour that is not."""
    around = np.pad(seen, 1)
    inside = around[:-2, 1:-1] & around[2:, 1:-1] & around[1:-1, :-2] & around[1:-1, 2:]
    return seen & ~inside


def inner_ends(seen):
    """The same, but for the border of the picture."""
    return ends(np.pad(seen, 1, mode="edge"))[1:-1, 1:-1]


# On whole pixels, many faces to a pixel are not in one plane any more.
@pytest.mark.parametrize(
    ("elevation", "cells", "bits"),
    [
        (60.0, 1, 8),
        (10.0, 1, 8),
        (1.0, 1, 8),
        (1.0, 50, 8),
        (10.0, 50, 8),
        (1.0, 1, 0),
        (60.0, 9, 0),
    ],
)
@pytest.mark.parametrize("is_parallel", [False, True])
def test_plane_has_no_edges_inside(elevation, cells, bits, is_parallel):
    up, along = math.sin(math.radians(elevation)), math.cos(math.radians(elevation))
    eye = np.array([0.3 * along, up, along]) * 3.0
    camera = looking(eye)
    if is_parallel:
        camera = rj.OrthographicCamera(eye=eye, target=(0, 0, 0), height=2.0, near=0.0, far=30.0)
    drawn, frame = lines(scene_of(plane(cells=cells)), camera, quality=rj.Quality(bits))
    seen = frame.face_id >= 0
    assert seen.sum() > 200
    assert not drawn[seen & ~inner_ends(seen)].any()


def test_end_of_everything_belongs_to_what_ends(sphere):
    drawn, frame = lines(scene_of(sphere, edges="silhouette"), looking())
    assert np.array_equal(drawn, inner_ends(frame.face_id >= 0))


def test_silhouettes_are_where_world_positions_jump():
    """A small plate over a large one, both of one object, against distances to planes."""
    low, high = plane(4.0), plane(0.7)
    vertices = np.concatenate([low.vertices, high.vertices + (0.1, 0.8, -0.2)])
    both = rj.Mesh(vertices, np.concatenate([low.faces, high.faces + 4]))
    camera = looking()
    drawn, frame = lines(scene_of(both, edges="silhouette"), camera)
    toward = np.array(camera.eye) - frame.position
    toward = toward / np.linalg.norm(toward, axis=2, keepdims=True)
    expected = inner_ends(frame.face_id >= 0)
    outer = expected.sum()
    distance = np.linalg.norm(np.array(camera.eye) - frame.position, axis=2)
    for axis in (0, 1):
        found = naive_screen.jumps(frame.position, frame.normal, toward, axis, 0.1)
        for row, column in np.argwhere(found):
            other = (row + 1, column) if axis == 0 else (row, column + 1)
            nearer = (row, column) if distance[row, column] < distance[other] else other
            expected[nearer] = True
    assert expected.sum() > outer + 60
    assert np.array_equal(drawn, expected)


def test_objects_are_parted_even_where_they_touch(cube):
    other = rj.Mesh(cube.vertices + (2.0, 0.0, 0.0), cube.faces)
    drawn, frame = lines(scene_of(cube, other, edges="object"), looking((3.0, 2.0, 7.0)))
    numbers = frame.object_id
    joint = np.argwhere((numbers[:, :-1] == 0) & (numbers[:, 1:] == 1))
    assert len(joint) > 10
    assert drawn[joint[:, 0], joint[:, 1] + 1].all()
    together, _ = lines(scene_of(cube, other, edges="silhouette"), looking((3.0, 2.0, 7.0)))
    assert not together[joint[3:-3, 0], joint[3:-3, 1] + 1].any()


@pytest.mark.parametrize(("angle", "count"), [(89.0, 3), (91.0, 0)])
def test_creases_are_those_that_turn_enough(cube, angle, count):
    drawn, frame = lines(
        scene_of(cube, edges="crease", crease_angle=angle), looking(), size=(240, 180)
    )
    sides = np.where(frame.face_id >= 0, frame.face_id // 2, -1)
    joints = [
        (first, second)
        for first in range(6)
        for second in range(6)
        if first != second and ((sides[:, :-1] == first) & (sides[:, 1:] == second)).sum() > 5
    ]
    assert joints
    assert (drawn.sum() > 0) == (count > 0)
    for first, second in joints:
        at = (sides[:, :-1] == first) & (sides[:, 1:] == second)
        assert (drawn[:, :-1][at]).all() == (count > 0)
    inside = np.pad(sides, 1, constant_values=-2)
    same = [inside[1:-1, 1:-1] == inside[1 + r : 181 + r, 1 + c : 241 + c]
            for r, c in ((0, 1), (1, 0), (0, -1), (-1, 0))]  # fmt: skip
    assert not drawn[np.all(same, axis=0)].any()


def test_parts_that_intersect_have_a_crease():
    """A wall through a floor, one object, no corner in common."""
    floor = plane(3.0)
    wall = np.array([(-2.0, -1.0, 0.0), (2.0, -1.0, 0.0), (2.0, 1.0, 0.0), (-2.0, 1.0, 0.0)])
    mesh = rj.Mesh(
        np.concatenate([floor.vertices, wall]),
        np.concatenate([floor.faces, [(4, 5, 6), (4, 6, 7)]]),
    )
    drawn, frame = lines(scene_of(mesh, edges="crease"), looking((0.5, 3.0, 5.0)))
    walls = frame.face_id >= 2
    x, _, z = np.moveaxis(frame.position[1:], 2, 0)
    meeting = walls[:-1] & ~walls[1:] & (np.abs(z) < 0.1) & (np.abs(x) < 1.9)
    assert meeting.sum() > 20
    assert drawn[:-1][meeting].all()


@pytest.mark.parametrize("lines_by", ["bresenham", "coverage"])
def test_slivers_narrower_than_a_pixel_hide_no_crease(lines_by):
    """A wedge, and one whose ridge is a strip: its sides have no corner in common."""
    pictures = []
    for half in (0.0, 2e-4):
        ridge = [(-half, 0.0, -1.0), (-half, 0.0, 1.0), (half, 0.0, -1.0), (half, 0.0, 1.0)]
        ends = [(-1.0, -1.0, -1.0), (-1.0, -1.0, 1.0), (1.0, -1.0, -1.0), (1.0, -1.0, 1.0)]
        faces = [(0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 1, 3), (0, 3, 2)]
        mesh = rj.Mesh(ridge + ends, faces if half else faces[:4])
        scene = scene_of(mesh, edges="crease")
        frame = rj.render(
            scene, looking((0.4, 3.0, 4.0)), size=(200, 150), quality=rj.Quality(lines=lines_by)
        )
        scene.outline = None
        bare = rj.render(scene, looking((0.4, 3.0, 4.0)), size=(200, 150))
        pictures.append((frame.color != bare.color).any(axis=2))
    plain, sliver = pictures
    assert plain.sum() > 40
    assert (plain != sliver).sum() <= 4


def test_round_shapes_have_no_creases(sphere):
    rows, columns = 60, 90
    polar, around = np.mgrid[1:rows, 0:columns]
    polar, around = polar * np.pi / rows, around * 2.0 * np.pi / columns
    ball = np.stack(
        [np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], axis=2
    ).reshape(-1, 3)
    a, b = np.mgrid[0 : rows - 2, 0:columns]
    p, q = a * columns + b, a * columns + (b + 1) % columns
    faces = np.stack([p, q, q + columns, p, q + columns, p + columns], axis=2).reshape(-1, 3)
    for distance in (3.0, 12.0):
        camera = looking((0.0, 0.5, distance))
        drawn, frame = lines(scene_of(rj.Mesh(ball, faces)), camera)
        seen = frame.face_id >= 0
        rim = ends(seen)
        # The last faces of a round shape are as good as edge-on.
        inside = seen & ~rim & ~ends(seen & ~rim)
        assert inside.sum() > 50
        assert not drawn[inside].any()


@pytest.mark.parametrize("scale", [1e-3, 1e6, 2.0**-40, 2.0**40])
def test_scale_changes_nothing(scale, cube):
    def picture(factor):
        scene = rj.Scene()
        scene.add(plane(), GROW(factor))
        scene.add(cube, rj.transforms.compose(GROW(factor), MOVE((0, 0.5, 0)), GROW(0.5)))
        scene.outline = rj.Outline(color="red")
        eye = np.array([1.0, 2.0, 4.0]) * factor
        camera = rj.PerspectiveCamera(eye=eye, target=(0, 0, 0), fov_y=40.0, near=0.1 * factor)
        return lines(scene, camera, outputs=("color",))[0]

    assert (picture(1.0) != picture(scale)).mean() < 1e-3


@pytest.mark.needs_jit
@pytest.mark.parametrize("threads", [2, 5])
def test_threads_change_no_bit(threads, sphere, cube):
    scene = scene_of(sphere, cube, plane(), width=3)
    once = rj.render(scene, looking(), size=(300, 250), threads=1).color
    again = rj.render(scene, looking(), size=(300, 250), threads=threads).color
    assert np.array_equal(once, again)


@pytest.mark.parametrize("width", [1, 2, 3, 4, 5, 8, 17, 64])
def test_line_is_a_disc_around_every_marked_pixel(width):
    rows = outline_effect.make_disc_rows(width)
    disc = np.zeros((width, width), bool)
    first = -(width // 2) + (1 - width % 2)
    for down, begin, end in rows.tolist():
        disc[down - first, begin - first : end - first] = True
    assert np.array_equal(disc, naive_screen.disc(width))
    assert np.array_equal(disc, disc[::-1, ::-1])


def test_width_grows_the_lines(cube):
    thin, _ = lines(scene_of(cube), looking())
    thick, _ = lines(scene_of(cube, width=5), looking())
    grown = np.zeros_like(thin)
    for down, begin, end in outline_effect.make_disc_rows(5).tolist():
        for across in range(begin, end):
            moved = np.zeros_like(thin)
            here = [
                slice(max(0, n), thin.shape[k] + min(0, n)) for k, n in ((0, down), (1, across))
            ]
            there = [
                slice(max(0, -n), thin.shape[k] - max(0, n)) for k, n in ((0, down), (1, across))
            ]
            moved[tuple(here)] = thin[tuple(there)]
            grown |= moved
    assert np.array_equal(thick, grown)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1)])
def test_small_pictures(size, cube):
    drawn, _ = lines(scene_of(cube, width=9), looking(), size=size)
    assert drawn.shape == size[::-1]


def test_plan_says_why():
    scene = scene_of(plane())
    for change, outputs, reason in (
        (lambda: None, ("color",), "silhouette, object, crease, 1 wide"),
        (lambda: None, ("linear", "depth"), "8 bits"),
        (lambda: setattr(scene, "wireframe", rj.Wireframe(mode="only")), ("color",), "only the"),
        (lambda: setattr(scene, "outline", None), ("color",), "is None"),
    ):  # fmt: skip
        change()
        plan = rj.explain(scene, looking(), outputs=outputs)
        (effect,) = [effect for effect in plan.effects if effect.name == "outline"]
        assert reason in effect.reason
        assert effect.used == plan.has("outline") == reason.startswith("silhouette")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"color": "no colour"}, "color"),
        ({"width": 0}, "width must be in 0.1..64, got 0"),
        ({"width": 64.5}, "width must be in 0.1..64, got 64.5"),
        ({"width": "thin"}, "width must be a number"),
        ({"edges": ()}, "edges must name at least one of silhouette, object, crease"),
        ({"edges": ("object", "bend")}, "edges has 'bend', which is unknown"),
        ({"edges": 5}, "edges must name"),
        ({"crease_angle": 181.0}, "crease_angle must be in 0..180"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match=message):
        rj.Outline(**arguments)


def test_settings_are_kept_in_one_form():
    outline = rj.Outline(color="white", width=np.int64(3), edges=["crease", "object", "crease"])
    assert outline.color == (1.0, 1.0, 1.0, 1.0)
    assert (outline.width, outline.edges) == (3, ("object", "crease"))
    assert rj.Outline(edges="crease").edges == ("crease",)
