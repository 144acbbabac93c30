"""Areas and outlines of cuts, against exact ones and trimesh's."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import rasterjit as rj


@pytest.mark.parametrize("seed", range(4))
def test_areas_and_outlines_are_those_of_trimesh(seed):
    random = np.random.default_rng(seed)
    shapes = [
        trimesh.creation.icosphere(2), trimesh.creation.box((1.0, 1.4, 0.6)),
        trimesh.creation.torus(1.0, 0.3, 24, 12), trimesh.creation.annulus(0.4, 0.9, 1.2),
    ]  # fmt: skip
    scene, point, normal = rj.Scene(), random.normal(0.0, 0.2, 3), random.normal(size=3)
    for shape in shapes:
        matrix = trimesh.transformations.random_rotation_matrix(random.random(3))
        scene.add(rj.Mesh(shape.vertices, shape.faces), matrix)
        shape.apply_transform(matrix)
    found = rj.cross_section(scene, rj.SectionPlane(point, normal))
    total = 0.0
    for shape, area, lines in zip(shapes, found.areas, found.outlines, strict=True):
        section = shape.section(normal, point)
        flat, _ = section.to_2D()
        assert area == pytest.approx(flat.area, rel=1e-9)
        assert sum(len(line) - 1 for line in lines) >= len(section.discrete)
        assert len(lines) == len(section.discrete)
        assert all((line[0] == line[-1]).all() for line in lines)
        points = np.concatenate(lines)
        assert np.abs((points - point) @ (normal / np.linalg.norm(normal))).max() < 1e-12
        total += section.length
    assert found.length == pytest.approx(total, rel=1e-9)
    assert found.area == pytest.approx(found.areas.sum())


def test_what_is_missed_open_or_left_whole_is_told_apart():
    scene, box = rj.Scene(), trimesh.creation.box()
    lid = trimesh.Trimesh(box.vertices, box.faces[2:], process=False)
    scene.add(rj.Mesh(box.vertices, box.faces), name="cut")
    scene.add(rj.Mesh(box.vertices, box.faces), rj.transforms.translate((0, 3, 0)), "missed")
    scene.add(rj.Mesh(lid.vertices, lid.faces), rj.transforms.translate((2, 0, 0)), "open")
    scene.add(rj.Node(rj.Mesh(box.vertices, box.faces), section=False))
    scene.add(rj.Mesh(box.vertices, box.faces), rj.transforms.translate((0, -3, 0)), "in front")
    scene.section = rj.SectionPlane((9, 9, 9), (1, 0, 0))
    with pytest.warns(UserWarning, match="without a cap"):
        found = rj.cross_section(scene, rj.SectionPlane((0, 0, 0.1), (0, -1, 0)))
    assert found.areas.tolist()[:2] == [1.0, 0.0]
    assert np.isnan(found.areas[2])
    assert np.isnan(found.area)
    assert found.areas.tolist()[3:] == [0.0, 0.0]
    assert [len(lines) for lines in found.outlines] == [1, 0, 1, 0, 0]
    assert found.length > 4.0
    assert scene.section.point == (9.0, 9.0, 9.0)


def test_what_is_no_plane_or_empty_is_named():
    plane, empty = rj.SectionPlane((0, 0, 0), (0, 0, 1)), rj.Scene()
    for _ in range(2):
        with pytest.raises(ValueError, match="scene must hold at least one mesh, got an empty"):
            rj.cross_section(empty, plane)
        empty.add(rj.Label((0, 0, 0), "alone"))
    with pytest.raises(ValueError, match=r"plane\[0\] must be a SectionPlane, got 0"):
        rj.cross_section(trimesh.creation.box(), (0, 0, 1))
