"""Exploded views move parts by their boxes; clipping boxes keep what is inside, and measure it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import rasterjit as rj

SIZE = (64, 48)


def assembly(seed=0):
    """Return a scene of boxes, some below others, turned and moved."""
    rng, scene, above = np.random.default_rng(seed), rj.Scene(), None
    for number in range(6):
        shape = trimesh.creation.box(rng.uniform(0.3, 1.0, 3))
        shape.apply_translation(rng.normal(size=3))
        matrix = trimesh.transformations.random_rotation_matrix(rng.random(3))
        matrix[:3, 3] = rng.normal(size=3)
        node = scene.add(
            rj.Mesh(shape.vertices, shape.faces), matrix, f"part {number}", parent=above
        )
        above = node if number % 2 else None
    scene.add(rj.Label((0, 0, 0), "first"), parent=scene.nodes[0], name="label")
    return scene


def middles(scene):
    """Return the middles of the parts' own boxes in the world, (O, 3)."""
    found = []
    for node in scene.nodes:
        low, high = node.mesh.vertices.min(axis=0), node.mesh.vertices.max(axis=0)
        found.append(node.world_matrix[:3, :3] @ ((low + high) / 2) + node.world_matrix[:3, 3])
    return np.array(found)


@pytest.mark.parametrize("factor", [0.0, 1.0, 1.6, 3.0])
@pytest.mark.parametrize("axis", [None, (0.0, 0.0, 2.0), (1.0, -2.0, 0.5)])
def test_parts_move_away_from_the_middle_by_the_factor(factor, axis):
    scene = assembly()
    before, matrices = middles(scene), [node.world_matrix.copy() for node in scene.nodes]
    center = np.add(*scene.bounds()) / 2.0
    apart = rj.explode(scene, factor, axis=axis)
    moves = (factor - 1.0) * (before - center)
    if axis is not None:
        direction = np.array(axis) / np.linalg.norm(axis)
        moves = np.outer(moves @ direction, direction)
    np.testing.assert_allclose(middles(apart), before + moves, atol=1e-12)
    for node, old, matrix in zip(apart.nodes, scene.nodes, matrices, strict=True):
        assert node is not old
        assert node.mesh is old.mesh
        assert node.name == old.name
        np.testing.assert_allclose(node.world_matrix[:3, :3], matrix[:3, :3], atol=1e-12)
        assert (old.world_matrix == matrix).all()
    # A label moves with what it hangs below.
    np.testing.assert_allclose(
        apart.find("label").world_matrix, apart.nodes[0].world_matrix, atol=1e-12
    )


def test_a_center_may_be_given_and_skins_are_applied():
    scene = assembly(1)
    apart = rj.explode(scene, 2.0, center=(5.0, 0.0, 0.0))
    np.testing.assert_allclose(middles(apart), 2.0 * middles(scene) - (5.0, 0, 0), atol=1e-12)
    bone, shape = rj.Node(), trimesh.creation.box()
    mesh = rj.Mesh(shape.vertices, shape.faces, joints=[[0]] * 8, weights=[[1.0]] * 8)
    skinned = rj.Scene()
    skinned.add(bone)
    skinned.add(mesh).skin = rj.Skin([bone])
    skinned.add(shape)
    bone.transform = rj.transforms.translate((4.0, 0.0, 0.0))
    moved = rj.explode(skinned, 2.0)
    lows = [(node.mesh.vertices + node.world_matrix[:3, 3]).min(axis=0) for node in moved.nodes]
    np.testing.assert_allclose(lows, [(5.5, -0.5, -0.5), (-2.5, -0.5, -0.5)], atol=1e-12)


def test_exploded_parts_are_cut_and_seen_apart():
    scene = rj.Scene()
    for radius in (1.0, 0.6):
        ball = trimesh.creation.icosphere(3, radius=radius)
        scene.add(rj.Mesh(ball.vertices, ball.faces), rj.transforms.translate((radius, 0, 0)))
    plane = rj.SectionPlane((0, 0, 0), (0, 0, 1))
    whole, apart = (rj.cross_section(one, plane) for one in (scene, rj.explode(scene, 9.0)))
    np.testing.assert_allclose(whole.areas, apart.areas, rtol=1e-9)
    far = rj.explode(scene, 9.0)
    camera = rj.OrthographicCamera(
        np.add(*far.bounds()) / 2 + (0, 0, 9), np.add(*far.bounds()) / 2, height=5.0
    )
    frame = rj.render(far, camera, size=SIZE, outputs=("object_id",), threads=1)
    columns = [np.flatnonzero((frame.object_id == n).any(axis=0)) for n in (0, 1)]
    assert columns[1].max() < columns[0].min()


@pytest.mark.parametrize("seed", range(4))
def test_clipping_boxes_keep_what_is_inside_of_them(seed):
    # A box cut by a box: volume and areas are those of the overlap.
    rng = np.random.default_rng(seed)
    low, high = -rng.uniform(0.2, 0.9, 3), rng.uniform(0.2, 0.9, 3)
    shape = trimesh.creation.box((1.0, 1.4, 3.0))
    scene = rj.Scene()
    scene.add(rj.Mesh(shape.vertices, shape.faces, material=rj.Material("flat")))
    planes = scene.section = rj.SectionPlane.box(low, high)
    half = np.array([0.5, 0.7, 1.5])
    clipped = np.minimum(high, half) - np.maximum(low, -half)
    cuts = rj.cross_section(scene, planes)
    assert [cut.plane for cut in cuts] == list(planes)
    for number, cut in enumerate(cuts):
        axis = number % 3
        is_cut = (high, -low)[number < 3][axis] < half[axis]
        others = np.delete(clipped, axis)
        assert cut.area == pytest.approx(others.prod() if is_cut else 0.0, abs=1e-12)
        assert cut.length == pytest.approx(2.0 * others.sum() if is_cut else 0.0, abs=1e-12)
    frame = rj.render(
        scene, rj.fit_camera(scene), size=SIZE, outputs=("position", "object_id"), threads=1
    )
    seen = frame.position[frame.object_id >= 0]
    assert (seen >= low - 1e-5).all()
    assert (seen <= high + 1e-5).all()
    assert len(seen) > 20


def test_boxes_take_fields_of_their_planes():
    planes = rj.SectionPlane.box((0, 0, 0), (1, 2, 3), lines=True, cap_color="red")
    assert [plane.normal for plane in planes] == [
        (-1, 0, 0), (0, -1, 0), (0, 0, -1), (1, 0, 0), (0, 1, 0), (0, 0, 1),
    ]  # fmt: skip
    assert {plane.point for plane in planes} == {(0.0, 0.0, 0.0), (1.0, 2.0, 3.0)}
    assert all(plane.lines for plane in planes)


def test_what_is_wrong_is_named():
    scene = assembly()
    for arguments, match in (
        ({"factor": -1}, "factor must be at least 0, got -1"),
        ({"factor": np.inf}, "factor must be"), ({"factor": "far"}, "factor must be"),
        ({"factor": 2, "axis": (0, 0, 0)}, "axis must not be zero"),
        ({"factor": 2, "axis": "x"}, "axis must be"), ({"factor": 2, "center": 3}, "center must"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=match):
            rj.explode(scene, **arguments)
    for low, high, match in (
        ((0, 0, 0), (1, 0, 1), "low must be below high"), ((0, 0), (1, 1, 1), "low must have"),
        ((0, 0, 0), (1, 1, np.nan), "high must be"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=match):
            rj.SectionPlane.box(low, high)
    with pytest.raises(ValueError, match=r"plane must be a SectionPlane or several, got \[\]"):
        rj.cross_section(scene, [])


def test_lines_are_drawn_where_caps_alone_are_left():
    scene, shape = rj.Scene(), trimesh.creation.box((4.0, 4.0, 4.0))
    scene.add(rj.Mesh(shape.vertices, shape.faces, material=rj.Material("unlit", "white")))
    scene.section = rj.SectionPlane.box(
        (-1, -1, -1), (1, 1, 1), lines=True, line_color="red", cap_color="white"
    )
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=3.0)
    frame = rj.render(scene, camera, size=SIZE, threads=1, outputs=("color", "face_id"))
    red = (frame.color[..., :3] == (255, 0, 0)).all(axis=2)
    # Around a square of 32 pixels.
    assert 4 * 32 <= red.sum() <= 4 * 2 * 34
    assert (frame.face_id >= len(shape.faces)).sum() == 32 * 32


def test_nested_parts_stay_together_with_a_warning(recwarn):
    scene = rj.Scene()
    for size in (1.0, 0.6):
        shape = trimesh.creation.box((size, size, 2 * size))
        scene.add(rj.Mesh(shape.vertices + (0.1, 0.7, 0.3), shape.faces))
    rj.explode(scene, 1.0)
    rj.explode(scene, 2.0, center=(1.0, 0.0, 0.0))
    assert not recwarn.list
    with pytest.warns(UserWarning, match="explode moved nothing"):
        apart = rj.explode(scene, 2.0)
    np.testing.assert_allclose(middles(apart), middles(scene), atol=1e-12)
