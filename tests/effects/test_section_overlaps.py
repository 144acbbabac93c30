"""Where solids overlap in a cutting plane, every view shows the one cap that the rule names."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.survey.cap_outlines import VertexRecipe
from rasterjit.survey.cap_overlaps import Cap
from rasterjit.survey.cap_scalars import spread_scalars

SIZE = (96, 72)


def add(scene, shape, place=(0.0, 0.0, 0.0), **material):
    mesh = rj.Mesh(shape.vertices, shape.faces, material=rj.Material("flat", **material))
    return scene.add(mesh, rj.transforms.translate(place))


def views(count, center, seed):
    """Return cameras on the side that is cut away, of both kinds."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        x, y = rng.uniform(-3.0, 3.0, 2)
        looking = {"eye": np.add(center, (x, y, 5.0)), "target": center, "near": 0.5, "far": 30.0}
        if number % 2:
            yield rj.OrthographicCamera(height=4.0, **looking)
        else:
            yield rj.PerspectiveCamera(fov_y=45.0, **looking)


def cap_points(scene, camera, height):
    """Return the points of the plane that pixel centres see, (H, W, 2)."""
    eyes, ways = camera.rays(SIZE)
    far = (height - eyes[..., 2]) / ways[..., 2]
    return (eyes + far[..., np.newaxis] * ways)[..., :2]


def inside_box(points, place, half):
    """Return how far inside of a square points are, below 0 outside."""
    return half - np.abs(points - np.array(place)[:2]).max(axis=-1)


def inside_ball(points, place, radius, height):
    """Return how far inside of a circle points are."""
    squared = radius**2 - (height - place[2]) ** 2
    return np.sqrt(squared) - np.sqrt(((points - np.array(place)[:2]) ** 2).sum(axis=-1))


@pytest.mark.parametrize("height", [0.0, 0.1, -0.25])
def test_each_pixel_of_an_overlap_shows_the_smaller_cap(height):
    # The ball's circle is smaller than the box's square, the bar's square is the smallest.
    scene, ball = rj.Scene(), trimesh.creation.icosphere(4, radius=0.8)
    places = [(0.0, 0.0, 0.0), (0.9, 0.5, 0.05), (0.45, 0.2, 0.0)]
    add(scene, ball, places[1])
    add(scene, trimesh.creation.box((2.0, 2.0, 2.0)), places[0])
    add(scene, trimesh.creation.box((0.5, 0.5, 3.0)), places[2])
    scene.section = rj.SectionPlane((0, 0, height), (0, 0, 1))
    seen = 0
    for camera in views(20, (0.4, 0.2, height), 7):
        outputs = ("object_id", "face_id", "depth")
        frame = rj.render(scene, camera, size=SIZE, outputs=outputs, threads=1)
        points = cap_points(scene, camera, height)
        # The icosphere is a polyhedron within the ball.
        depths = [
            inside_ball(points, places[1], 0.8, height), inside_box(points, places[0], 1.0),
            inside_box(points, places[2], 0.25),
        ]  # fmt: skip
        is_clear = np.all([np.abs(depth) > 0.01 for depth in depths], axis=0)
        wanted = np.select([depths[2] > 0.0, depths[0] > 0.0, depths[1] > 0.0], [2, 0, 1], -1)
        is_cap = is_clear & (wanted >= 0)
        assert (frame.object_id == wanted)[is_cap].all()
        faces = sum(len(node.mesh.faces) for node in scene.nodes)
        assert (frame.face_id == faces + wanted)[is_cap].all()
        seen += ((depths[0] > 0.0) & (depths[1] > 0.0) & is_clear).sum()
    assert seen > 4000


def test_of_equal_caps_the_later_object_is_seen():
    scene = rj.Scene()
    for x in (0.0, 0.3, 0.6):
        add(scene, trimesh.creation.box((1.0, 1.0, 1.0)), (x, 0.1 * x, 0.0))
    scene.section = rj.SectionPlane((0, 0, 0.13), (0, 0, 1))
    for camera in views(6, (0.3, 0.0, 0.13), 3):
        frame = rj.render(scene, camera, size=SIZE, outputs=("object_id",), threads=1)
        points = cap_points(scene, camera, 0.13)
        depths = [inside_box(points, (x, 0.1 * x), 0.5) for x in (0.6, 0.3, 0.0)]
        wanted = np.select([depth > 0.0 for depth in depths], [2, 1, 0], -1)
        clear = (wanted >= 0) & np.all([np.abs(depth) > 0.01 for depth in depths], axis=0)
        assert (frame.object_id == wanted)[clear].all()


def test_a_face_in_the_plane_hides_the_caps_of_others():
    scene = rj.Scene()
    add(scene, trimesh.creation.icosphere(3))
    add(scene, trimesh.creation.box((3.0, 1.0, 1.0)), (0.0, 0.0, -0.5))
    scene.section = rj.SectionPlane((0, 0, 0), (0, 0, 1))
    for camera in views(6, (0, 0, 0), 5):
        frame = rj.render(scene, camera, size=SIZE, outputs=("object_id",), threads=1)
        points = cap_points(scene, camera, 0.0)
        is_top = np.minimum(1.5 - np.abs(points[..., 0]), 0.5 - np.abs(points[..., 1])) > 0.01
        assert (frame.object_id[is_top] == 1).all()
        assert (frame.object_id == 0).any()


@pytest.mark.parametrize("seed", range(8))
def test_caps_share_the_area_of_the_union(seed):
    # Random solids, mirrored ones too: each point of the plane belongs to one cap, none to two.
    rng, scene = np.random.default_rng(seed), rj.Scene()
    normal = rng.normal(size=3)
    for number in range(8):
        shape = (trimesh.creation.icosphere(2), trimesh.creation.torus(1.0, 0.3, 16, 9))[number % 2]
        matrix = trimesh.transformations.random_rotation_matrix(rng.random(3))
        matrix[:3, :3] *= rng.uniform(0.3, 1.0) * (-1.0) ** (number // 2)
        matrix[:3, 3] = rng.normal(size=3) * 0.3
        scene.add(rj.Mesh(shape.vertices, shape.faces, material=rj.Material("flat")), matrix)
    plane = scene.section = rj.SectionPlane((0, 0, 0), normal)
    cut = rj.cross_section(scene, plane)
    direction = np.array(plane.normal)
    camera = rj.OrthographicCamera(5.0 * direction, (0, 0, 0), up=(0.3, 1, 0.2), height=4.4)
    size, faces = (300, 300), sum(len(node.mesh.faces) for node in scene.nodes)
    frame = rj.render(scene, camera, size=size, outputs=("face_id", "object_id"), threads=1)
    found = np.where(frame.face_id >= faces, frame.object_id, -1)
    # The oracle: of the solids that a point lies in, the one with the smallest area.
    eyes, ways = (part.reshape(-1, 3) for part in camera.rays(size))
    points = eyes - ((eyes @ direction) / (ways @ direction))[:, np.newaxis] * ways
    is_in = np.array([
        lies_within(lines, points, direction) for lines in cut.outlines
    ])  # fmt: skip
    order = np.argsort(cut.areas)[np.isin(np.argsort(cut.areas), np.flatnonzero(cut.areas > 0.0))]
    wanted = np.select(list(is_in[order]), order.tolist(), -1).reshape(size)
    assert (found == wanted).mean() > 0.995
    padded = np.pad(wanted, 1, mode="edge")
    around = np.stack([padded[y : y + 300, x : x + 300] for y in range(3) for x in range(3)])
    assert (around == found).any(axis=0).all()
    assert (found >= 0).mean() > 0.05


def lies_within(lines, points, normal):
    """Tell which points of a plane closed lines enclose: rays to the right cross an odd number."""
    axis = np.cross(normal, (0.0, 0.0, 1.0) if abs(normal[2]) < 0.9 else (1.0, 0.0, 0.0))
    axes = np.stack([axis, np.cross(normal, axis)], axis=1)
    is_in, (x, y) = np.zeros(len(points), bool), (points @ axes).T
    for line in lines:
        flat = line @ axes
        for (ax, ay), (bx, by) in itertools.pairwise(flat):
            side = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
            is_in ^= (ay <= y) & (by > y) & (side > 0.0) | (by <= y) & (ay > y) & (side < 0.0)
    return is_in


def test_areas_that_are_measured_count_overlaps_for_each():
    scene = rj.Scene()
    add(scene, trimesh.creation.box((2.0, 2.0, 2.0)))
    add(scene, trimesh.creation.box((1.0, 1.0, 1.0)), (1.0, 0.0, 0.0))
    assert rj.cross_section(scene, rj.SectionPlane((0, 0, 0.1), (0, 0, 1))).areas.tolist() == [4, 1]


def test_parts_that_only_touch_keep_their_caps_as_they_are():
    scene, alone = rj.Scene(), rj.Scene()
    for one in (scene, alone):
        add(one, trimesh.creation.box((1.0, 1.0, 1.0)))
        one.section = rj.SectionPlane((0, 0, 0.1), (0.1, 0, 1))
    add(scene, trimesh.creation.box((1.0, 0.8, 1.0)), (1.0, 0.0, 0.0))
    from rasterjit.survey.cross_sections import cut_scene

    caps = [cut_scene(one).nodes[-2 if one is scene else -1].mesh for one in (scene, alone)]
    assert caps[0].faces.tolist() == caps[1].faces.tolist()


def test_motion_of_a_cap_with_a_hole_is_that_of_its_object():
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0)

    def at(x):
        scene = rj.Scene()
        add(scene, trimesh.creation.box((2.0, 2.0, 2.0)), (x, 0.0, 0.0))
        add(scene, trimesh.creation.icosphere(2, radius=0.6))
        scene.section = rj.SectionPlane((0, 0, 0.1), (0, 0, 1))
        return scene

    frame = rj.render(
        at(0.0), camera, size=SIZE, outputs=("motion", "object_id"), threads=1,
        previous=rj.PreviousView(at(0.25), camera),
    )  # fmt: skip
    box = frame.object_id == 0
    np.testing.assert_allclose(
        frame.motion[box], [[-0.25 * SIZE[1] / 4.0, 0.0]] * box.sum(), atol=1e-4
    )
    assert (frame.object_id == 1).sum() > 100


def test_the_smallest_of_caps_is_cut_out_of_a_large_one():
    scene = rj.Scene()
    add(scene, trimesh.creation.icosphere(3, radius=1.0))
    add(scene, trimesh.creation.icosphere(3, radius=3e-4))
    scene.section = rj.SectionPlane((0, 0, 0), (0, 0, 1))
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=1.2e-3)
    found = rj.render(scene, camera, size=SIZE, outputs="object_id").object_id
    column, row = np.meshgrid(np.arange(SIZE[0]) - 47.5, np.arange(SIZE[1]) - 35.5)
    steps = np.sqrt(column**2 + row**2) * 1.2e-3 / SIZE[1] / 3e-4
    assert (found[steps < 0.95] == 1).all()
    assert (found[steps > 1.05] == 0).all()


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_cap_of_no_width_has_no_scalars_inside():
    plane = rj.SectionPlane((0, 0, 0), (0, 0, 1), cap_color="scalars")
    world = np.array([[0, 0, 0], [1, 0, 0], [1, 1e-12, 0], [0, 1e-12, 0]])
    faces, recipe = np.array([[0, 1, 2], [0, 2, 3]]), VertexRecipe((), np.arange(4))
    cap = Cap(world, faces, recipe, 4, 1e-12)
    assert spread_scalars(plane, cap, cap, world[:, 0]) is None
    wide = cap._replace(world=world * (1, 1e12, 1), area=1.0)
    assert spread_scalars(plane, wide, wide, world[:, 0]) is not None
