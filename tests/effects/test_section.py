"""Sections: what planes cut away, what caps fill, and what all outputs say of it."""

from __future__ import annotations

import copy
import itertools
import pickle
import subprocess
import sys
import warnings
from fractions import Fraction

import naive_lines
import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.effects.section import SECTION, SECTION_LINES
from rasterjit.scene.color import decoding_table
from rasterjit.survey import cross_sections
from rasterjit.survey.cross_sections import cut_scene

SIZE = (64, 48)
NEAR = 1e-9
"""Rounding of areas and places."""


def solid(name):
    """Return vertices and faces of a closed shape."""
    make = trimesh.creation
    if name == "sphere":
        shape = make.icosphere(1)
    elif name == "torus":
        shape = make.torus(1.0, 0.35, 14, 8)
    elif name == "box":
        shape = make.box((1.0, 2.0, 1.5))
    elif name == "pipe":
        shape = make.annulus(0.5, 1.0, 1.0, sections=12)
    elif name == "cavity":
        inner = make.box((1.0, 1.0, 1.0))
        inner.invert()
        shape = trimesh.util.concatenate([make.box((2.0, 2.0, 2.0)), inner])
    elif name == "nested":
        core = make.icosphere(1, radius=0.4)
        inner = make.box((1.0, 1.0, 1.0))
        inner.invert()
        shape = trimesh.util.concatenate([make.box((2.0, 2.0, 2.0)), inner, core])
    else:
        parts = [make.box((1.0, 1.0, 1.0)), make.box((1.0, 1.0, 1.0)), make.icosphere(1)]
        parts[1].apply_translation((0.4, 0.3, 0.2))
        parts[2].apply_translation((-0.5, -0.4, 0.1))
        shape = trimesh.util.concatenate(parts)
    return np.array(shape.vertices), np.array(shape.faces)


SOLIDS = ("sphere", "torus", "box", "pipe", "cavity", "nested", "crossing")


def turned(seed, mirrored=False):
    """Return a transform that turns, moves and scales unevenly."""
    rng = np.random.default_rng(seed)
    matrix = trimesh.transformations.random_rotation_matrix(rng.random(3))
    matrix = matrix @ np.diag([1.2, 0.7, -0.9 if mirrored else 0.9, 1.0])
    matrix[:3, 3] = rng.normal(size=3) * 0.1
    return matrix


def world_of(node):
    """Return the corners of a node's faces in the world, (F, 3, 3)."""
    mesh = node.mesh
    return rj.transforms.transform_points(node.world_from_model, mesh.vertices)[mesh.faces, :3]


def areas(corners):
    """Return areas as vectors, (F, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    return 0.5 * np.cross(b - a, c - a)


def scene_with(*shapes, planes, **material):
    scene = rj.Scene()
    for number, (vertices, faces, place) in enumerate(shapes):
        mesh = rj.Mesh(vertices, faces, material=rj.Material("flat", **material))
        scene.add(mesh, place, f"solid {number}")
    scene.section = planes
    return scene


def caps_of(scene):
    """Return the caps of a scene by object."""
    nodes = cut_scene(scene).nodes
    owners = nodes.cut.owners[:-1]
    numbers = nodes.cut.face_numbers
    starts = np.cumsum([0, *(len(node.mesh.faces) for node in nodes)])
    caps = {}
    for node, owner, start in zip(nodes, owners, starts, strict=False):
        if numbers[start] >= nodes.cut.face_starts[-1]:
            caps.setdefault(int(owner), []).append(node)
    return caps


@pytest.mark.parametrize("name", [name for name in SOLIDS if name != "crossing"])
@pytest.mark.parametrize("seed", range(4))
def test_caps_have_the_area_that_closes_what_is_left(name, seed):
    # The areas of a closed surface add up to nothing, as vectors: so the rest tells the cap's.
    rng = np.random.default_rng(seed)
    vertices, faces = solid(name)
    place = turned(seed, mirrored=seed % 2 == 1)
    plane = rj.SectionPlane(rng.normal(size=3) * 0.1, rng.normal(size=3))
    scene = scene_with((vertices, faces, place), planes=plane)
    kept = world_of(cut_scene(scene).nodes[0])
    left = areas(kept).sum(axis=0) * np.sign(np.linalg.det(place[:3, :3]))
    ((cap,),) = caps_of(scene).values()
    found = areas(world_of(cap))
    assert np.linalg.norm(found, axis=1).sum() == pytest.approx(-left @ plane.normal, abs=NEAR)
    np.testing.assert_allclose(
        found.sum(axis=0) * np.sign(np.linalg.det(place[:3, :3])), -left, atol=NEAR
    )
    distances = (world_of(cap) - plane.point) @ plane.normal
    assert np.abs(distances).max() < 1e-14


@pytest.mark.parametrize("name", [name for name in SOLIDS if name != "crossing"])
@pytest.mark.parametrize("height", [0.0, 0.1, 0.3125, -0.4375])
def test_caps_have_the_exact_area_of_the_section(name, height):
    # Vertices are fractions, so the points where edges cross the plane are, and the area is.
    vertices, faces = solid(name)
    rows = [[Fraction(x) for x in row] for row in vertices.tolist()]
    area, plane = Fraction(0), Fraction(height)
    for face in faces.tolist():
        # Nothing has a vertex in the plane, or it counts as below.
        corners = [rows[n] for n in face]
        above = [corner[2] - plane > 0 for corner in corners]
        ends = []
        for n in range(3):
            a, b = corners[n], corners[(n + 1) % 3]
            if above[n] != above[(n + 1) % 3]:
                share = (plane - a[2]) / (b[2] - a[2])
                point = [a[k] + share * (b[k] - a[k]) for k in range(2)]
                ends.append((above[n], point))
        if ends:
            # What is below goes from where the face comes up to where it goes down.
            (down,), (up,) = ([p for is_down, p in ends if is_down == one] for one in (True, False))
            area += (down[0] * up[1] - down[1] * up[0]) / 2
    scene = scene_with(
        (vertices, faces, np.eye(4)), planes=rj.SectionPlane((0, 0, height), (0, 0, 1))
    )
    found = sum(
        np.linalg.norm(areas(world_of(cap)), axis=1).sum() for cap in caps_of(scene).get(0, [])
    )
    assert found == pytest.approx(abs(float(area)), abs=1e-13)


@pytest.mark.parametrize(
    ("name", "height", "area"),
    [
        ("box", 0.0, 2.0), ("box", 0.75, 0.0), ("box", -0.75, 0.0), ("cavity", 0.0, 3.0),
        ("cavity", 0.5, 3.0), ("cavity", 0.75, 4.0), ("cavity", -0.5, 3.0), ("cavity", 1.0, 0.0),
    ],
)  # fmt: skip
def test_planes_through_faces_are_exact(name, height, area):
    # What lies in the plane stays where the solid is behind it: the ceiling of a cavity does not.
    scene = scene_with((*solid(name), np.eye(4)), planes=rj.SectionPlane((0, 0, height), (0, 0, 1)))
    caps = caps_of(scene).get(0, [])
    assert sum(np.linalg.norm(areas(world_of(cap)), axis=1).sum() for cap in caps) == area


def test_a_plane_that_touches_a_top_leaves_it_as_it_is():
    vertices, faces = solid("box")
    for height, normal in ((0.75, 1.0), (-0.75, -1.0)):
        scene = scene_with(
            (vertices, faces, np.eye(4)), planes=rj.SectionPlane((0, 0, height), (0, 0, normal))
        )
        assert cut_scene(scene).nodes[0] is scene.nodes[0]


def test_nothing_is_left_of_what_only_touches_from_before():
    scene = scene_with((*solid("box"), np.eye(4)), planes=rj.SectionPlane((0, 0, 0.75), (0, 0, -1)))
    frame = rj.render(scene, rj.fit_camera(scene), size=SIZE, outputs=("face_id", "object_id"))
    assert (frame.face_id == -1).all()
    assert (frame.object_id == -1).all()


def test_crossing_shells_have_one_cap_of_the_area_of_their_union():
    # Two squares of side 2 and 1, one over the corner of the other, and a third apart.
    boxes = [trimesh.creation.box((2.0, 2.0, 2.0)), trimesh.creation.box((1.0, 1.0, 1.0))]
    boxes[1].apply_translation((1.0, 1.0, 0.0))
    boxes.append(trimesh.creation.box((0.5, 0.5, 0.5)))
    boxes[2].apply_translation((-3.0, 0.0, 0.0))
    shape = trimesh.util.concatenate(boxes)
    planes = rj.SectionPlane((0, 0, 0.1), (0, 0, 1))
    scene = scene_with((shape.vertices, shape.faces, np.eye(4)), planes=planes)
    ((cap,),) = caps_of(scene).values()
    area = np.linalg.norm(areas(world_of(cap)), axis=1).sum()
    assert area == pytest.approx(4.0 + 0.75 + 0.25, abs=1e-7)


@pytest.mark.parametrize("name", SOLIDS)
def test_several_planes_leave_a_closed_solid(name):
    # Caps are cut by the other planes: each side of what is left has one that goes back.
    planes = [
        rj.SectionPlane((0.1, 0, 0), (1, 0.2, 0)), rj.SectionPlane((0, 0.1, 0), (0, 1, 0.3)),
        rj.SectionPlane((0, 0, 0.05), (-0.3, 0, 1)),
    ]  # fmt: skip
    scene = scene_with((*solid(name), turned(3)), planes=planes)
    nodes = cut_scene(scene).nodes
    assert len(nodes) == 4 - (name == "torus")
    total = sum(areas(world_of(node)).sum(axis=0) for node in nodes)
    if name != "crossing":
        np.testing.assert_allclose(total, 0.0, atol=NEAR)
    for node, plane in itertools.product(nodes, planes):
        assert ((world_of(node) - plane.point) @ plane.normal).max() < 1e-14


AT_ONCE = 256
"""Points: what is computed of each and of each triangle takes much memory."""


def winding(corners, points):
    """Return how often surfaces, (F, 3, 3), go around points, (N,): by solid angles."""
    if len(points) > AT_ONCE:
        parts = np.array_split(points, len(points) // AT_ONCE + 1)
        return np.concatenate([winding(corners, part) for part in parts])
    a, b, c = (corners[np.newaxis, :, k] - points[:, np.newaxis] for k in range(3))
    la, lb, lc = (np.linalg.norm(one, axis=2) for one in (a, b, c))
    numerator = np.einsum("nfk,nfk->nf", a, np.cross(b, c))
    denominator = (
        la * lb * lc + np.einsum("nfk,nfk->nf", a, b) * lc
        + np.einsum("nfk,nfk->nf", b, c) * la + np.einsum("nfk,nfk->nf", c, a) * lb
    )  # fmt: skip
    return np.rint(2.0 * np.arctan2(numerator, denominator).sum(axis=1) / (4.0 * np.pi))


def are_covered(corners, points):
    """Tell which points, (N, 2), lie in a triangle, (T, 3, 2), of either side."""
    a, b, c = (corners[np.newaxis, :, k] - points[:, np.newaxis] for k in range(3))
    sides = [one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
             for one, other in ((a, b), (b, c), (c, a))]  # fmt: skip
    return (np.all(np.array(sides) > 0.0, axis=0) | np.all(np.array(sides) < 0.0, axis=0)).any(1)


@pytest.mark.parametrize("seed", [0, 3, 8, 9, 15, 16])
def test_caps_of_crumpled_solids_fill_what_is_inside(seed, recwarn):
    # A third of the faces runs through others, and the second plane cuts a cap of many parts.
    rng = np.random.default_rng(seed)
    shape = trimesh.creation.icosphere(3)
    vertices = shape.vertices + 0.5 * rng.normal(size=shape.vertices.shape)
    planes = [
        rj.SectionPlane((0, 0, 0.1), (0, 0, 1)),
        rj.SectionPlane(rng.normal(size=3) * 0.1, rng.normal(size=3)),
    ]
    scene = scene_with((vertices, np.array(shape.faces), np.eye(4)), planes=planes)
    caps = caps_of(scene)[0]
    assert len(caps) == 2
    assert not recwarn.list
    points = np.c_[rng.uniform(-2.0, 2.0, (200, 2)), np.full(200, 0.1)]
    is_left = (points - planes[1].point) @ planes[1].normal < 0.0
    count = 0
    # A few at a time: what is computed of each point and each triangle takes much memory.
    for some in np.split(np.arange(200), 10):
        is_inside = is_left[some] & (winding(vertices[shape.faces], points[some]) != 0)
        found = are_covered(world_of(caps[0])[:, :, :2], points[some, :2])
        np.testing.assert_array_equal(found, is_inside)
        count += np.count_nonzero(is_inside)
    assert 20 < count < 180


def seen_through(scene, eyes, ways):
    """
    Return what rays see, slowly: object, face (-1 - plane of caps), and how far, (N,) each.

    A cap is seen where a ray meets a plane inside of a solid.
    """
    planes = cross_sections.planes_in(scene.section)
    nearest = np.full(len(eyes), np.inf)
    owners, faces = np.full(len(eyes), -1), np.full(len(eyes), -99)

    def look(far, owner, face):
        # Rays start before all things, so far may be anything.
        left = np.isfinite(far) & (far > 0.0)
        points = eyes + np.where(left, far, 0.0)[:, np.newaxis] * ways
        for number, plane in enumerate(planes):
            own = (points - plane.point) @ plane.normal <= 0.0
            left &= own | (number == -1 - face)
        nearer = left & (far < nearest)
        nearest[nearer], owners[nearer], faces[nearer] = far[nearer], owner, face

    for owner, node in enumerate(scene.nodes):
        corners = world_of(node)
        for face, (a, b, c) in enumerate(corners):
            normal = np.cross(b - a, c - a)
            with np.errstate(all="ignore"):
                far = ((a - eyes) @ normal) / (ways @ normal)
                points = eyes + far[:, np.newaxis] * ways
                sides = [np.cross(q - p, points - p) @ normal for p, q in ((a, b), (b, c), (c, a))]
                far[~(np.array(sides) >= 0.0).all(axis=0)] = np.inf
            look(far, owner, face)
        for number, plane in enumerate(planes):
            normal = np.array(plane.normal)
            with np.errstate(all="ignore"):
                far = ((np.array(plane.point) - eyes) @ normal) / (ways @ normal)
            far[~np.isfinite(far)] = np.inf
            points = eyes + np.where(np.isfinite(far), far, 0.0)[:, np.newaxis] * ways
            far[winding(corners, points) == 0.0] = np.inf
            look(far, owner, -1 - number)
    return owners, faces, nearest


@pytest.mark.parametrize("name", SOLIDS)
def test_what_is_seen_through_the_cut_is_what_rays_find(name):
    seed = SOLIDS.index(name)
    planes = [
        rj.SectionPlane((0, 0, 0.1), (0.2, 0.3, 1.0)),
        rj.SectionPlane((0.1, 0, 0), (1.0, 0.1, 0.4)),
    ]
    place = rj.transforms.translate((2.6, 0.4, -0.3)) @ turned(seed + 7, mirrored=True)
    scene = scene_with(
        (*solid(name), turned(seed)), (*solid("torus"), place), planes=planes[: 1 + seed % 2]
    )
    looking = {"eye": (2.2, 1.8, 6.0), "target": (1.2, 0, 0)}
    # One plane and two, each seen by rays that are parallel and by rays from a point.
    if seed // 2 % 2:
        camera = rj.OrthographicCamera(height=4.4, near=0.5, far=20.0, **looking)
    else:
        camera = rj.PerspectiveCamera(fov_y=40.0, near=0.5, far=20.0, **looking)
    outputs = ("object_id", "face_id", "position", "geometric_normal", "barycentric", "depth")
    frame = rj.render(scene, camera, size=SIZE, outputs=outputs, threads=1)
    eyes, ways = (part.reshape(-1, 3) for part in camera.rays(SIZE))
    owners, faces, far = seen_through(scene, eyes, ways)
    starts = np.cumsum([0, *(len(node.mesh.faces) for node in scene.nodes)])
    count = len(cross_sections.planes_in(scene.section))
    numbers = np.where(owners < 0, -1, np.where(faces >= 0, starts[owners] + faces, 0))
    is_cap = (owners >= 0) & (faces < 0)
    numbers[is_cap] = starts[-1] + count * owners[is_cap] - 1 - faces[is_cap]
    wanted = numbers.reshape(SIZE[::-1])
    found = frame.face_id
    assert (found >= starts[-1]).mean() > 0.01
    # Corners lie on a grid of sub-pixels: what is beside an edge may differ, no more.
    padded = np.pad(wanted, 1, mode="edge")
    around = np.stack(
        [padded[y : y + SIZE[1], x : x + SIZE[0]] for y in range(3) for x in range(3)]
    )
    is_other = found != wanted
    assert (around == found)[:, is_other].any(axis=0).all()
    assert is_other.mean() < 0.01
    same = ~is_other & (wanted >= 0)
    assert (frame.object_id.ravel() == owners)[same.ravel()].all()
    points = (eyes + far[:, np.newaxis] * ways).reshape(*SIZE[::-1], 3)
    np.testing.assert_allclose(frame.position[same], points[same], atol=5e-3)
    for number, plane in enumerate(cross_sections.planes_in(scene.section)):
        cap = same & ((wanted - starts[-1]) % count == number) & (wanted >= starts[-1])
        facing = np.sign(-(ways.reshape(*SIZE[::-1], 3)[cap] @ plane.normal))
        np.testing.assert_allclose(
            frame.geometric_normal[cap], facing[:, np.newaxis] * plane.normal, atol=1e-5
        )
        away = (frame.position[cap] - plane.point) @ plane.normal
        assert np.abs(away).max(initial=0.0) < 1e-5
        assert (frame.barycentric[cap] == 0.0).all()
    # The weights are those of the whole faces.
    whole = same & (wanted < starts[-1])
    corners = np.concatenate([world_of(node) for node in scene.nodes])[wanted[whole]]
    mixed = np.einsum("nk,nkd->nd", frame.barycentric[whole], corners)
    np.testing.assert_allclose(mixed, frame.position[whole], atol=2e-5)
    np.testing.assert_allclose(frame.barycentric[whole].sum(axis=1), 1.0, atol=1e-5)


def ball(**options):
    """Return a lit ball of radius 1 with normals, uv, colours and scalars."""
    shape = trimesh.creation.icosphere(2)
    vertices = np.array(shape.vertices)
    return rj.Mesh(
        vertices, shape.faces, normals=vertices, uv=vertices[:, :2] * 0.5 + 0.5,
        attributes={"height": vertices[:, 1:2]}, **options,
    )  # fmt: skip


def looking(**options):
    return rj.PerspectiveCamera((0.6, 0.8, 4.0), (0.0, 0.0, 0.0), near=0.5, far=20.0, **options)


def shown(scene, camera=None, **options):
    options = {"size": SIZE, "threads": 1, **options}
    return rj.render(scene, looking() if camera is None else camera, **options)


CHECKS = np.indices((8, 8)).sum(axis=0) % 2 * 0.8 + 0.1
CHECKS = rj.Texture(np.repeat(CHECKS[..., None], 3, axis=2).astype(np.float32), filter="nearest")


@pytest.mark.parametrize(
    "material",
    [
        rj.Material("phong", base_color_texture=CHECKS),
        rj.Material("pbr", base_color_texture=CHECKS, roughness=0.4),
        rj.Material("gouraud", "orange"),
        rj.Material("unlit", base_color_texture=CHECKS),
    ],
    ids=lambda material: material.shading,
)
def test_what_is_left_looks_as_it_did(material):
    scene = rj.Scene()
    scene.add(ball(material=material))
    outputs = ("linear", "face_id", "uv", "normal", "depth", "attribute:height")
    whole = shown(scene, outputs=outputs)
    # The half that is turned away: what is seen of the rest is what was seen before.
    scene.section = rj.SectionPlane((0.0, 0.1, 0.0), (0.1, 1.0, 0.05))
    frame = shown(scene, outputs=outputs)
    same = (frame.face_id == whole.face_id) & (frame.face_id >= 0)
    faces = len(scene.nodes[0].mesh.faces)
    assert same.mean() > 0.05
    for name in ("linear", "uv", "normal", "depth", "attribute:height"):
        found, wanted = frame.arrays()[name], whole.arrays()[name]
        # New vertices are lit by themselves.
        slack = 0.03 if material.shading == "gouraud" else 2e-3
        close = np.isclose(found[same], wanted[same], atol=slack)
        # Nearest texels at an edge of the checks may be others.
        assert close.mean() > 0.99, name
    cap = frame.face_id >= faces
    assert cap.mean() > 0.02
    assert np.isnan(frame.uv[cap]).all()
    assert np.isnan(frame.attribute("height")[cap]).all()
    np.testing.assert_allclose(frame.normal[cap], [scene.section.normal] * cap.sum(), atol=1e-6)


def test_faces_that_no_plane_crosses_have_the_bits_they_had():
    scene = rj.Scene()
    scene.add(ball(material=rj.Material("phong", base_color_texture=CHECKS)))
    scene.add(ball(), rj.transforms.translate((0.0, 0.0, -2.5)))
    outputs = ("linear", "face_id", "uv", "normal", "depth", "barycentric", "position")
    before = shown(scene, outputs=outputs)
    scene.section = rj.SectionPlane((0.0, 0.0, 0.9), (0.0, 0.0, 1.0))
    frame = shown(scene, outputs=outputs)
    numbers = cut_scene(scene).nodes.cut
    pieces = np.unique(numbers.face_numbers[numbers.is_piece])
    same = (frame.face_id == before.face_id) & ~np.isin(frame.face_id, pieces)
    assert (frame.face_id != before.face_id).any()
    for name in outputs:
        assert frame.arrays()[name][same].tobytes() == before.arrays()[name][same].tobytes(), name


def test_glass_is_cut_and_shows_what_is_behind():
    scene = rj.Scene()
    glass = rj.Material("phong", (0.2, 0.4, 0.9, 0.4), alpha_mode="blend")
    scene.add(ball(material=glass), name="glass")
    scene.add(ball(material=rj.Material("unlit", "red")), np.diag([0.4, 0.4, 0.4, 1.0]), "core")
    scene.section = rj.SectionPlane((0, 0, 0.6), (0, 0, 1), cap_color=(0.1, 0.9, 0.1, 0.5))
    frame = shown(scene, outputs=("linear", "object_id"), background="white")
    glass_only = rj.Scene()
    glass_only.add(scene.nodes[0].mesh)
    glass_only.section = scene.section
    alone = shown(glass_only, outputs=("linear", "object_id"), background="white")
    middle = SIZE[1] // 2, SIZE[0] // 2
    # Through the cap, half seen through, the core: its red is there, its green and blue are not.
    assert frame.object_id[middle] == 0
    red, green, _, _ = frame.linear[middle]
    assert red > 0.3 * 0.6
    assert green < alone.linear[middle][1]
    # An opaque cap hides the core.
    scene.section = rj.SectionPlane((0, 0, 0.6), (0, 0, 1))
    hidden = shown(scene, outputs=("linear", "object_id"))
    glass_only.section = scene.section
    alone = shown(glass_only, outputs=("linear", "object_id"))
    assert (hidden.linear[middle] == alone.linear[middle]).all()


def test_holes_of_masks_stay_where_they_are():
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    holes = np.ones((8, 8, 4), np.float32)
    holes[::2, ::2, 3] = 0.0
    texture = rj.Texture(holes, filter="nearest", color_space="linear")
    mesh = rj.Mesh(
        vertices, [[0, 1, 2], [0, 2, 3]], uv=vertices[:, :2] * 0.5 + 0.5,
        material=rj.Material("unlit", base_color_texture=texture, alpha_mode="mask"),
    )  # fmt: skip
    scene = rj.Scene()
    scene.add(mesh)
    camera = rj.OrthographicCamera((0.013, 0.017, 3.0), (0.013, 0.017, 0.0), height=2.2)
    whole = shown(scene, camera, outputs=("face_id", "position"))
    plane = scene.section = rj.SectionPlane((0.103, 0.0, 0.0), (1.0, 0.31, 0.0), cap=False)
    frame = shown(scene, camera, outputs=("face_id", "position"))
    before = (whole.position - plane.point) @ plane.normal
    np.testing.assert_array_equal(frame.face_id[before < -0.02], whole.face_id[before < -0.02])
    assert (frame.face_id[before > 0.02] == -1).all()


@pytest.mark.parametrize("samples", [4, 16, 64, "area"])
def test_the_colour_of_a_cap_is_mixed_by_its_share_of_a_pixel(samples):
    # A unit square of a cap, seen along its normal: the light adds up to its area.
    scene = rj.Scene()
    shape = trimesh.creation.box((1.0, 1.0, 1.0))
    place = trimesh.transformations.rotation_matrix(0.4, (0, 0, 1))
    scene.add(rj.Mesh(shape.vertices, shape.faces, material=rj.Material("unlit", "black")), place)
    scene.section = rj.SectionPlane((0, 0, 0.123), (0, 0, 1), cap_color="white")
    camera = rj.OrthographicCamera((0.01, 0.02, 3.0), (0.01, 0.02, 0.0), height=2.0)
    quality = rj.Quality(samples=samples)
    frame = shown(scene, camera, quality=quality, outputs=("linear",), background="black")
    area = frame.linear[..., 0].sum() * (2.0 / SIZE[1]) ** 2
    assert area == pytest.approx(1.0, abs=2e-3 if samples == "area" else 2e-2)


def test_pixels_of_a_cap_along_its_normal_are_its_area():
    vertices, faces = solid("pipe")
    rng = np.random.default_rng(5)
    plane = rj.SectionPlane((0.0, 0.1, 0.1), rng.normal(size=3))
    scene = scene_with((vertices, faces, turned(5)), planes=plane)
    ((cap,),) = caps_of(scene).values()
    area = np.linalg.norm(areas(world_of(cap)), axis=1).sum()
    point, normal = np.array(plane.point), np.array(plane.normal)
    size = (400, 400)
    camera = rj.OrthographicCamera(point + 5.0 * normal, point, up=(0.3, 1, 0.2), height=3.6)
    frame = shown(scene, camera, size=size, outputs=("face_id", "depth"))
    is_cap = frame.face_id >= len(faces)
    assert is_cap.sum() * (3.6 / 400) ** 2 == pytest.approx(area, rel=5e-3)
    np.testing.assert_allclose(frame.depth[is_cap], 5.0, rtol=1e-6)
    # Nothing is seen but the cap: no face of the inside through a gap.
    assert is_cap.sum() > 10_000


def test_no_gap_shows_between_caps_and_what_they_close():
    # Seen from the side that is cut away, a closed solid shows its outside and its caps, never the
    # inside of a face.
    for seed, name in enumerate(SOLIDS):
        planes = [
            rj.SectionPlane((0, 0, 0.1), (0.2, 0.3, 1.0)),
            rj.SectionPlane((0.1, 0, 0), (1.0, 0.1, 0.4)),
        ]
        scene = scene_with((*solid(name), turned(seed)), planes=planes)
        for eye in ((2.0, 1.0, 4.0), (4.0, 1.0, 2.0), (-3.0, 2.0, 3.0)):
            camera = rj.PerspectiveCamera(eye, (0, 0, 0), fov_y=35.0, near=0.5, far=20.0)
            outputs = ("face_id", "object_id")
            frame = shown(scene, camera, size=(480, 360), outputs=outputs, cull="none")
            front = shown(scene, camera, size=(480, 360), outputs=outputs, cull="back")
            # Shells that cross each other have walls inside, seen from nowhere.
            np.testing.assert_array_equal(frame.face_id, front.face_id)


def test_instances_are_cut_each_at_its_place():
    mesh = ball()
    scene = rj.Scene()
    for x in (-1.2, 1.2):
        scene.add(mesh, rj.transforms.translate((x, 0.0, 0.0)))
    scene.section = rj.SectionPlane((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    camera = rj.PerspectiveCamera((6.0, 1.0, 4.0), (0.0, 0.0, 0.0), near=0.5, far=20.0)
    outputs = ("face_id", "object_id", "instance_id", "material_id")
    frame = shown(scene, camera, outputs=outputs)
    cap = frame.face_id >= 2 * len(mesh.faces)
    assert set(frame.face_id[cap]) == {2 * len(mesh.faces) + 1}
    assert set(frame.object_id[cap]) == {1}
    assert set(frame.instance_id[cap]) == {1}
    assert set(frame.material_id.ravel()) == {-1, 0}
    picked = shown(scene, camera, outputs=("face_id", "barycentric", "position"))
    y, x = np.argwhere(cap)[cap.sum() // 2]
    found = picked.pick(x, y)
    assert (found.node, found.face) == (1, -1)
    assert found.position[0] == pytest.approx(1.0, abs=1e-6)


def test_nodes_that_are_left_whole_are_not_cut():
    scene, bolt = rj.Scene(), ball()
    scene.add(ball())
    shaft = scene.add(rj.Node(None, section=False))
    scene.add(
        bolt,
        rj.transforms.compose(rj.transforms.translate((0.3, 0, 0.5)), rj.transforms.scale(0.6)),
        "bolt",
        parent=shaft,
    )
    scene.add(rj.Label((0, 0, 0.9), "bolt"), parent=shaft)
    scene.section = rj.SectionPlane((0, 0, 0), (0, 0, 1))
    camera = rj.PerspectiveCamera((1.0, 0.8, 4.0), (0.0, 0.0, 0.0), fov_y=40.0)
    wanted = {"size": (64, 48), "outputs": ("color", "depth", "object_id")}
    apart = []
    for node in scene.nodes:
        alone = rj.Scene()
        alone.add(node.mesh, node.world_matrix)
        alone.section = scene.section if node.name != "bolt" else None
        apart.append(rj.render(alone, camera, **wanted).depth)
    frame = rj.render(scene, camera, **wanted)
    assert (frame.depth == np.minimum(*apart)).all()
    assert {0, 1} <= set(np.unique(frame.object_id))
    assert (
        rj.render(pickle.loads(pickle.dumps(scene)), camera, **wanted).color == frame.color
    ).all()
    places = np.array([[node.world_matrix for node in scene.nodes]])
    batch = rj.render_batch(scene, [camera], transforms=places, **wanted)
    assert (batch.color[0] == frame.color).all()
    twin, other = copy.copy(scene), rj.Scene()
    twin.section = None
    other.add(twin, name="all")
    other.section = scene.section
    assert (rj.render(other, camera, **wanted).depth == frame.depth).all()
    styled = rj.styles.plain(scene, camera).render(**wanted)
    assert (styled.object_id == frame.object_id).all()
    shaft.section = True
    assert (rj.render(scene, camera, **wanted).depth > frame.depth).any()


def test_cut_away_parts_cast_no_shadow():
    scene = rj.Scene()
    floor = [[-4, -1.2, -4], [4, -1.2, -4], [4, -1.2, 4], [-4, -1.2, 4]]
    scene.add(rj.Mesh(floor, [[0, 2, 1], [0, 3, 2]], material=rj.Material("flat")), name="floor")
    scene.add(ball(), name="ball")
    scene.lights = [rj.DirectionalLight((0.0, -1.0, 0.0), shadow=rj.Shadow(size=256))]
    camera = rj.PerspectiveCamera((0.0, 9.0, 0.1), (0.0, 0.0, 0.0), near=0.5, far=30.0)
    scene.section = rj.SectionPlane((0.0, -0.5, 0.0), (0.0, 1.0, 0.0), cap_color="red")
    small = shown(scene, camera, outputs=("linear", "object_id"))
    scene.section = rj.SectionPlane((0.0, -1.1, 0.0), (0.0, 1.0, 0.0))
    none = shown(scene, camera, outputs=("linear", "object_id"))
    floors = (small.object_id == 0) & (none.object_id == 0)
    dark = [(one.linear[..., 0] < 0.2)[floors].sum() for one in (small, none)]
    assert dark[0] == dark[1] == 0 or dark[0] > dark[1]
    scene.section = rj.SectionPlane((0.0, 3.0, 0.0), (0.0, 1.0, 0.0))
    whole = shown(scene, camera, outputs=("linear", "object_id"))
    assert (whole.object_id == 1).sum() > (small.object_id == 1).sum()


def test_motion_is_that_of_points_of_the_surface():
    def at(x):
        scene = rj.Scene()
        place = rj.transforms.compose(rj.transforms.translate((x, 0, 0)), turned(1))
        vertices, faces = solid("torus")
        scene.add(rj.Mesh(vertices, faces, material=rj.Material("flat")), place)
        scene.section = rj.SectionPlane((0.0, 0.0, 0.1), (0.1, 0.2, 1.0))
        return scene

    camera = rj.OrthographicCamera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), height=4.0)
    previous = rj.PreviousView(at(0.25), camera)
    frame = shown(at(0.0), camera, outputs=("motion", "face_id"), previous=previous)
    seen = frame.face_id >= 0
    pixels = -0.25 * SIZE[1] / 4.0
    np.testing.assert_allclose(frame.motion[seen], [[pixels, 0.0]] * seen.sum(), atol=1e-4)


def test_motion_follows_shapes_that_change_and_what_is_gone():
    vertices, faces = solid("torus")

    def of(vertices, height):
        scene = rj.Scene()
        scene.add(rj.Mesh(vertices, faces, material=rj.Material("flat")), turned(1))
        scene.section = rj.SectionPlane((0.0, 0.0, height), (0.1, 0.2, 1.0))
        return scene

    camera = rj.OrthographicCamera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), height=4.0)
    way = np.linalg.solve(turned(1)[:3, :3], (0.2, 0.0, 0.0))
    previous = rj.PreviousView(of(vertices + way, 0.1), camera)
    frame = shown(of(vertices, 0.1), camera, outputs=("motion", "face_id"), previous=previous)
    seen = frame.face_id >= 0
    pixels = -0.2 * SIZE[1] / 4.0
    np.testing.assert_allclose(frame.motion[seen], [[pixels, 0.0]] * seen.sum(), atol=1e-4)
    # Nothing is left of it.
    with pytest.warns(rj.ViewWarning):
        gone = shown(of(vertices, -9.0), camera, outputs=("motion", "face_id"), previous=previous)
    assert (gone.face_id == -1).all()


def test_batches_streams_and_layers_are_cut_too():
    scene = scene_with(
        (*solid("cavity"), turned(2)), planes=[rj.SectionPlane((0, 0, 0), (0, 0.2, 1))]
    )
    cameras = [looking(), rj.PerspectiveCamera((2.0, 1.0, 4.0), (0.0, 0.0, 0.0), near=0.5, far=20)]
    outputs = ("color", "face_id", "object_id")
    frames = [shown(scene, camera, outputs=outputs) for camera in cameras]
    batch = rj.render_batch(scene, cameras, size=SIZE, outputs=outputs)
    moved = rj.transforms.compose(
        rj.transforms.translate((0.0, 0.1, 0.2)), scene.nodes[0].world_from_model
    )
    places = np.array([[scene.nodes[0].world_from_model], [moved]])
    other = rj.render_batch(scene, cameras[:1] * 2, size=SIZE, outputs=outputs, transforms=places)
    stream = list(rj.render_many(scene, cameras, size=SIZE, outputs=outputs))
    for name in outputs:
        for number, frame in enumerate(frames):
            wanted = frame.arrays()[name]
            np.testing.assert_array_equal(batch.arrays()[name][number], wanted)
            np.testing.assert_array_equal(stream[number].arrays()[name], wanted)
        np.testing.assert_array_equal(other.arrays()[name][0], frames[0].arrays()[name])
    scene.nodes[0].transform = moved
    again = shown(scene, cameras[0], outputs=outputs)
    np.testing.assert_array_equal(other.arrays()["color"][1], again.color)
    layers = rj.render_layers(scene, cameras[0], k=2, size=SIZE, outputs=("face_id",))
    np.testing.assert_array_equal(layers.face_id[0], again.face_id)


def test_points_and_lines_are_cut():
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3))
    ways = rj.Lines([[-1, 0, 0], [1, 0, 0], [1, 1, 0]], width=3.0, colors=np.eye(3), dashes=None)
    scene = rj.Scene()
    scene.add(rj.Points(points, size=np.arange(1.0, 201.0) * 0.02, scalars=np.arange(200.0)))
    scene.add(ways)
    scene.section = rj.SectionPlane((0.25, 0.0, 0.0), (1.0, 0.0, 0.0))
    left, line = cut_scene(scene).nodes
    kept = points[:, 0] <= 0.25
    np.testing.assert_array_equal(left.mesh.positions, points[kept])
    np.testing.assert_array_equal(left.mesh.sizes, (np.arange(1.0, 201.0) * 0.02)[kept])
    np.testing.assert_array_equal(left.mesh.field.values, np.arange(200.0)[kept])
    np.testing.assert_array_equal(line.mesh.points, [[-1, 0, 0], [0.25, 0, 0]])
    np.testing.assert_allclose(line.mesh.colors[1, :3], [0.375, 0.625, 0.0])
    frame = shown(scene, outputs=("face_id", "position", "color"))
    seen = frame.face_id >= 0
    assert set(frame.face_id[seen]) <= {*np.flatnonzero(kept), 200}


def test_open_meshes_have_no_cap_and_are_named_once():
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    scene = rj.Scene()
    scene.add(rj.Mesh(box.vertices, box.faces[:-1], material=rj.Material("flat")), name="lidless")
    scene.section = rj.SectionPlane((0.0, 0.1, 0.0), (0.1, 1.0, 0.2))
    with pytest.warns(UserWarning, match="'lidless' is cut by a section, .* not closed"):
        frame = shown(scene, outputs=("face_id",))
    # Warnings are errors here.
    shown(scene, outputs=("face_id",))
    scene.section = rj.SectionPlane((0.0, 0.2, 0.0), (0.1, 1.0, 0.2))
    shown(scene, outputs=("face_id",))
    assert frame.face_id.max() < 11
    assert (frame.face_id >= 0).any()


def test_open_meshes_cut_along_their_edges_are_named_too(recwarn):
    # Two walls of two floors, without a top or a bottom; the plane lies between the floors.
    steps = np.array([[x, y, z] for z in (-1, 0, 1) for x, y in ((-1, 0), (1, 0), (1, 1))], float)
    faces = [
        [3 * floor + corner for corner in triple]
        for floor in (0, 1)
        for triple in ((0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4))
    ]
    plane = rj.SectionPlane((0, 0, 0), (0, 0, 1))
    scene = scene_with((steps, faces, np.eye(4)), planes=plane)
    assert len(cut_scene(scene).nodes[0].mesh.faces) == 4
    assert "its mesh is not closed" in str(recwarn.pop(UserWarning).message)
    # Nothing is cut where what goes does not touch what stays.
    apart = np.concatenate([steps[:6], steps[3:]])
    faces = [*faces[:4], *(np.array(faces[4:]) + 3).tolist()]
    apart[6:, 1] += 5.0
    scene = scene_with((apart, faces, np.eye(4)), planes=plane)
    assert len(cut_scene(scene).nodes[0].mesh.faces) == 4
    assert not recwarn.list


@pytest.mark.parametrize("mirrored", [False, True])
def test_caps_of_meshes_wound_inside_out_have_the_normal_and_light_of_others(mirrored):
    vertices, faces = solid("torus")
    plane = rj.SectionPlane((0.1, 0, 0), (0.2, 0.1, 1.0), cap_color="red")
    camera = rj.PerspectiveCamera((0.5, 1.0, 4.0), (0.0, 0.0, 0.0))
    frames = []
    for order in (1, -1):
        scene = scene_with((vertices, faces[:, ::order], turned(2, mirrored)), planes=plane)
        frames.append(shown(scene, camera, outputs=("color", "normal", "face_id")))
    right, inside_out = frames
    is_cap = right.face_id == len(faces)
    assert is_cap.sum() > 50
    np.testing.assert_array_equal(is_cap, inside_out.face_id == len(faces))
    np.testing.assert_allclose(inside_out.normal[is_cap], right.normal[is_cap], atol=1e-6)
    np.testing.assert_array_equal(inside_out.color[is_cap], right.color[is_cap])
    assert (right.normal[is_cap] @ plane.normal > 0.99).all()


def test_faces_that_turn_another_way_make_a_mesh_open(recwarn):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    faces = np.array(box.faces)
    faces[3] = faces[3, ::-1]
    scene = rj.Scene()
    scene.add(rj.Mesh(box.vertices, faces, material=rj.Material("flat")), name="twisted")
    scene.section = rj.SectionPlane((0.0, 0.1, 0.0), (0.1, 1.0, 0.2))
    assert len(cut_scene(scene).nodes) == 1
    message = str(recwarn.pop(UserWarning).message)
    assert message.startswith(
        "'twisted' is cut by a section, but its mesh's faces are not all wound"
    )
    # All of them inside out are closed.
    scene = scene_with((box.vertices, box.faces[:, ::-1], np.eye(4)), planes=scene.section)
    assert len(cut_scene(scene).nodes) == 2


def test_seams_of_textures_are_closed():
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    vertices = box.vertices[box.faces].reshape(-1, 3)
    faces = np.arange(36).reshape(-1, 3)
    scene = scene_with(
        (vertices, faces, turned(4)), planes=rj.SectionPlane((0, 0, 0), (0.3, 0.2, 1.0))
    )
    assert len(cut_scene(scene).nodes) == 2


def test_seams_that_are_rounded_are_closed():
    # Once around, the sine is not 0.
    turn = np.linspace(0.0, 2.0 * np.pi, 13)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    low, high = (np.column_stack([ring, np.full(13, z)]) for z in (-1.0, 1.0))
    ends = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    faces = []
    for n in range(12):
        faces += [[n, n + 1, n + 14], [n, n + 14, n + 13], [26, n + 1, n], [27, n + 13, n + 14]]
    assert (low[0] != low[12]).any()
    scene = scene_with(
        (np.concatenate([low, high, ends]), faces, np.eye(4)),
        planes=rj.SectionPlane((0, 0, 0.2), (0.1, 0.2, 1.0)),
    )
    ((cap,),) = caps_of(scene).values()
    area = np.linalg.norm(areas(world_of(cap)), axis=1).sum()
    assert area == pytest.approx(3.0 / scene.section.normal[2], abs=1e-9)


def test_section_lines_are_drawn_around_the_cut():
    scene = rj.Scene()
    shape = trimesh.creation.box((1.0, 1.0, 1.0))
    scene.add(rj.Mesh(shape.vertices, shape.faces, material=rj.Material("unlit", "white")))
    camera = rj.OrthographicCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), height=2.0)
    plain = rj.SectionPlane((0, 0, 0.1), (0, 0, 1), cap_color="white")
    for width in (1, 3, 8):
        scene.section = rj.SectionPlane(
            (0, 0, 0.1), (0, 0, 1), cap_color="white", lines=True, line_color="red",
            line_width=width,
        )  # fmt: skip
        frame = shown(scene, camera, size=(100, 100), background="white")
        red = (frame.color[..., :3] == (255, 0, 0)).all(axis=2)
        # The outline of a square of 50 pixels, round at its corners.
        assert abs(red.sum() - 4 * 50 * width) <= 8 * width * width / 2 + 8
        assert not red[40:60, 40:60].any()
        assert frame.plan.has("section lines")
    scene.section = plain
    frame = shown(scene, camera, size=(100, 100), background="white")
    assert not frame.plan.has("section lines")
    assert (frame.color == 255).all()


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("width", [0.7, 1.0, 3.0])
def test_smooth_section_lines_have_the_area_that_samples_find(width, samples):
    scene = rj.Scene()
    shape = trimesh.creation.box((1.0, 1.0, 1.0))
    turned = rj.transforms.rotate_z(20.0)
    scene.add(rj.Mesh(shape.vertices, shape.faces, material=rj.Material("unlit", "white")), turned)
    scene.section = rj.SectionPlane(
        (0, 0, 0.1), (0, 0, 1), cap_color="white", lines=True, line_color="red", line_width=width
    )
    camera = rj.OrthographicCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), height=2.0)
    quality = rj.Quality(lines="coverage", samples=samples)
    frame = rj.render(scene, camera, size=(60, 60), quality=quality, background="white")
    assert f"{width:g} wide, by coverage" in str(frame.plan)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.5 @ turned[:2, :2].T
    corners = corners * (30, -30) + 30
    want = naive_lines.stroke_shares(
        np.concatenate([corners, np.roll(corners, 1, axis=0)], axis=1), width / 2, (60, 60)
    )
    found = 1.0 - decoding_table()[frame.color[..., 1]]
    rows, columns = np.mgrid[:60, :60] + 0.5
    away = np.hypot(columns[None] - corners[:, 0, None, None], rows - corners[:, 1, None, None])
    assert np.abs(found - want)[(away > 1.5 + width).all(axis=0)].max() < 0.07
    assert found.sum() == pytest.approx(want.sum(), rel=0.02)


def test_lines_are_hidden_by_what_is_nearer():
    scene = rj.Scene()
    scene.add(ball(material=rj.Material("unlit", "white")))
    wall = np.array([[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]], float)
    scene.add(
        rj.Mesh(wall, [[0, 1, 2], [0, 2, 3]], material=rj.Material("unlit", "blue")),
        rj.transforms.translate((0, 0, 2.0)),
    )
    scene.section = rj.SectionPlane((0, 0.2, 0), (0, 1, 0), cap=False, lines=True, line_color="red")
    # The wall is cut as well, far below the view.
    camera = rj.PerspectiveCamera((0.0, -1.4, 4.0), (0.0, -1.6, 0.0), fov_y=20.0, near=0.5, far=20)
    frame = shown(scene, camera, background="white")
    assert not (frame.color[..., :3] == (255, 0, 0)).all(axis=2).any()


def red_pixels(frame):
    return (frame.color[..., :3] == (255, 0, 0)).all(axis=2)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("order", [1, -1])
def test_lines_behind_the_silhouette_of_their_solid_are_hidden(side, order):
    # Cut at its widest place and seen from behind, a bit from above: its lower rim is hidden.
    scene = rj.Scene()
    shape = trimesh.creation.torus(1.0, 0.4, 48, 24)
    mesh = rj.Mesh(shape.vertices, shape.faces[:, ::order], material=rj.Material("unlit", "white"))
    scene.add(mesh, np.diag([side, 1.0, 1.0, 1.0]))
    scene.section = rj.SectionPlane(
        (0, 0, 0), (0, 0, 1), lines=True, line_color="red", line_width=1
    )
    camera = rj.OrthographicCamera((0.0, 1.0, -5.0), (0.0, 0.0, 0.0), height=3.2)
    for quality in (rj.Quality(), rj.Quality(lines="coverage")):
        frame = rj.render(scene, camera, size=(160, 160), background="white", quality=quality)
        red = frame.color[..., 1] < 200
        assert red[:30].sum() > 50
        # The rim around the hole ends at row 110.
        assert not red[131:].any()


def test_lines_are_seen_from_inside_of_their_solid():
    scene = rj.Scene()
    shape = trimesh.creation.box((2.0, 2.0, 2.0))
    scene.add(rj.Mesh(shape.vertices, shape.faces, material=rj.Material("unlit", "white")))
    scene.section = rj.SectionPlane((0, 0, 0.5), (0, 0, 1), cap=False, lines=True, line_color="red")
    camera = rj.PerspectiveCamera((0.0, 0.0, -0.8), (0.0, 0.0, 1.0), fov_y=100.0, near=0.01, far=9)
    red = red_pixels(shown(scene, camera, size=(100, 100), background="white"))
    assert red.sum() > 300


def test_wireframes_show_no_edge_inside_of_a_cap():
    scene = rj.Scene()
    shape = trimesh.creation.box((1.0, 1.0, 1.0))
    scene.add(rj.Mesh(shape.vertices, shape.faces, material=rj.Material("unlit", "white")))
    scene.section = rj.SectionPlane((0, 0, 0.1), (0, 0, 1), cap_color="white")
    scene.wireframe = rj.Wireframe("red")
    camera = rj.OrthographicCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), height=2.0)
    frame = shown(scene, camera, size=(100, 100), background="white")
    red = (frame.color[..., :3] == (255, 0, 0)).all(axis=2)
    assert not red[30:70, 30:70].any()
    assert red.sum() >= 4 * 49


def test_bounds_and_cameras_are_those_of_the_whole():
    scene = scene_with((*solid("box"), turned(2)), planes=None)
    low, high = scene.bounds()
    before = rj.render(scene, size=SIZE).plan.camera
    scene.section = rj.SectionPlane((0, 0, 0), (1, 0, 0))
    for one, other in zip(scene.bounds(), (low, high), strict=True):
        np.testing.assert_array_equal(one, other)
    after = rj.render(scene, size=SIZE).plan.camera
    assert (after.eye, after.target) == (before.eye, before.target)


def test_labels_in_front_are_left_out():
    scene = rj.Scene()
    scene.add(ball())
    scene.add(rj.Label((0.0, 0.0, 1.5), "gone"))
    scene.section = rj.SectionPlane((0, 0, 0.2), (0, 0, 1))
    assert not shown(scene).plan.has("labels")
    scene.section = rj.SectionPlane((0, 0, 1.6), (0, 0, 1))
    assert shown(scene).plan.has("labels")


def test_a_plane_that_moves_or_goes_is_followed():
    scene = rj.Scene()
    node = scene.add(ball())
    with rj.Renderer(SIZE, threads=1) as renderer:
        whole = renderer.render(scene, looking(), outputs=("color", "face_id"))
        for height in (0.5, 0.0, -0.5):
            scene.section = rj.SectionPlane((0, 0, height), (0, 0, 1))
            frame = renderer.render(scene, looking(), outputs=("color", "face_id"))
            alone = shown(scene, outputs=("color", "face_id"))
            np.testing.assert_array_equal(frame.color, alone.color)
        node.mesh.material = rj.Material("unlit", "red")
        frame = renderer.render(scene, looking(), outputs=("color", "face_id"))
        np.testing.assert_array_equal(frame.color, shown(scene).color)
        node.mesh.material = rj.Material()
        scene.section = None
        frame = renderer.render(scene, looking(), outputs=("color", "face_id"))
    np.testing.assert_array_equal(frame.color, whole.color)
    np.testing.assert_array_equal(frame.face_id, whole.face_id)


def told(kind, output, given, rows):
    """Return a mesh, points or lines with what an output asks for."""
    if kind == "points":
        shape = rj.Points(np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 2.5]]), **given(2))
    elif kind == "lines":
        shape = rj.Lines(np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 2.5]]), [[0, 1]], **given(2))
    else:
        shape = rj.Mesh([[0, 0, 2], [1, 0, 2], [0, 1, 2], [1, 1, 3]], FLAP, **given(rows))
    return output, shape


FLAP = [[0, 1, 2], [1, 3, 2]]


@pytest.mark.parametrize(
    ("output", "shape"),
    [
        told("mesh", "uv", lambda n: {"uv": np.full((n, 2), 0.5)}, 4),
        told("mesh", "scalar", lambda n: {"scalars": np.arange(float(n))}, 4),
        told("mesh", "scalar", lambda n: {"scalars": np.arange(float(n))}, 2),
        told("mesh", "attribute:heat", lambda n: {"attributes": {"heat": np.ones((n, 3))}}, 4),
        told("mesh", "attribute:heat", lambda n: {"attributes": {"heat": np.ones((n, 3))}}, 2),
        told("points", "attribute:heat", lambda n: {"attributes": {"heat": np.ones((n, 1))}}, 2),
        told("lines", "scalar", lambda n: {"scalars": np.arange(float(n))}, 2),
    ],
)
@pytest.mark.parametrize("is_alone", [True, False])
def test_outputs_of_what_a_plane_takes_away_remain(output, shape, is_alone):
    # As a plane moves through a scene, each frame has the outputs of the one before.
    scene = rj.Scene()
    if not is_alone:
        scene.add(ball())
    node = scene.add(shape)
    outputs = ("color", "object_id", "face_id", output)
    before = shown(scene, outputs=outputs)
    assert (before.object_id == scene.nodes.index(node)).any()
    scene.section = rj.SectionPlane((0, 0, 1.9), (0, 0, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rj.ViewWarning)
        frame = shown(scene, outputs=outputs)
    assert (frame.object_id != scene.nodes.index(node)).all()
    name = {"uv": "uv", "scalar": "scalar"}.get(output, output)
    was, now = before.arrays()[name], frame.arrays()[name]
    assert (now.shape, now.dtype) == (was.shape, was.dtype)
    nothing = now[frame.face_id == -1]
    assert np.array_equal(nothing, np.broadcast_to(was[0, 0], nothing.shape), equal_nan=True)


def test_keys_go_through_planes_across_the_axes():
    scene = rj.Scene()
    scene.add(ball())
    assert SECTION.mode_of(scene) is None
    for mode, normal in (("own", (0, 0, 1)), ("x", (1, 0, 0)), ("y", (0, 1, 0))):
        changed = SECTION.with_mode(scene, mode)
        assert changed.section.normal == normal
        assert scene.section is None
    scene.section = rj.SectionPlane((0, 0, 0), (1, 2, 3), lines=True)
    assert SECTION.with_mode(scene, "own").section is scene.section
    assert SECTION.with_mode(scene, None).section is None
    assert [plane.lines for plane in SECTION_LINES.without(scene).section] == [False]


def test_copies_and_pickles_are_cut_anew():
    scene = scene_with(
        (*solid("torus"), turned(2)), planes=[rj.SectionPlane((0, 0, 0), (0.1, 0, 1))]
    )
    found = shown(scene).color
    for other in (copy.deepcopy(scene), pickle.loads(pickle.dumps(scene)), copy.copy(scene)):
        np.testing.assert_array_equal(shown(other).color, found)
    assert len(pickle.dumps(scene)) < 2 * len(pickle.dumps(rj.Mesh(*solid("torus"))))


def test_a_scene_without_section_imports_nothing_of_it():
    program = (
        "import sys, numpy as np, rasterjit as rj\n"
        "rj.render(rj.Mesh(np.eye(3), [[0, 1, 2]]), size=(8, 8), threads=1)\n"
        "own = 'rasterjit.survey.cross_sections', 'rasterjit.pipeline.geometry.cap_triangulation'\n"
        "print([name for name in own if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"


def test_parts_of_a_picture_are_those_of_the_whole():
    from rasterjit.rendering.regions import RegionRenderer

    scene = scene_with(
        (*solid("nested"), turned(3)), planes=rj.SectionPlane((0, 0, 0), (0.1, 0, 1))
    )
    outputs = ("color", "face_id", "barycentric")
    whole = shown(scene, size=(128, 128), outputs=outputs)
    with RegionRenderer(scene, looking(), size=(128, 128), outputs=outputs, threads=1) as tiles:
        for (x, y, width, height), frame in tiles.render_regions(64):
            for name, array in frame.arrays().items():
                part = whole.arrays()[name][y : y + height, x : x + width]
                np.testing.assert_array_equal(array, part)


@pytest.mark.parametrize(
    ("fields", "match"),
    [
        ({"normal": (0, 0, 0)}, "normal must not be zero"),
        ({"normal": (0, np.nan, 1)}, "normal"),
        ({"normal": (0, 1)}, "normal"),
        ({"normal": "up"}, "normal"),
        ({"point": (0, 0, np.inf)}, "point"),
        ({"point": None}, "point"),
        ({"cap": "red"}, "cap must be True or False"),
        ({"cap_color": "no colour"}, "cap_color"),
        ({"lines": 2}, "lines must be True or False"),
        ({"line_color": "no colour"}, "line_color"),
        ({"line_width": 0}, "line_width"),
        ({"line_width": 64.5}, "line_width must be in 0.1..64, got 64.5"),
        ({"line_width": "wide"}, "line_width must be a number"),
    ],
)
def test_bad_planes_are_named(fields, match):
    with pytest.raises(ValueError, match=match):
        rj.SectionPlane(**{"point": (0, 0, 0), "normal": (0, 0, 1), **fields})


def test_bad_sections_are_named():
    plane, scene = rj.SectionPlane((0, 0, 0), (0, 0, 1)), rj.Scene()
    for value, match in (
        ("x", "section must be a SectionPlane"), (3, "section must be a SectionPlane"),
        ([plane, None], r"section\[1\] must be a SectionPlane"),
        ([plane] * 17, "at most 16 planes"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=match):
            scene.section = value
    scene.section = [plane]
    assert scene.section == (plane,)
    scene.section = []
    assert scene.section is None


def test_tiny_and_huge_normals_are_directions():
    for scale in (1e-300, 1e300):
        assert rj.SectionPlane((0, 0, 0), (0, 3 * scale, 4 * scale)).normal == pytest.approx(
            (0, 0.6, 0.8)
        )


def hostile_shapes():
    """Return vertices and faces that are damaged, of no size, or out of all proportion."""
    vertices, faces = solid("sphere")
    nan, infinite = vertices.copy(), vertices.copy()
    nan[3], infinite[3] = np.nan, np.inf
    return {
        "NaN": (nan, faces), "infinite": (infinite, faces), "huge": (vertices * 1e300, faces),
        "tiny": (vertices * 1e-300, faces), "far": (vertices + 1e15, faces),
        "flat": (vertices * (1, 1, 0), faces), "a point": (0.0 * vertices, faces),
        "without area": (vertices, np.concatenate([faces, [[0, 0, 1], [2, 2, 2]]])),
        "twice": (vertices, np.concatenate([faces, faces])),
        "both ways": (vertices, np.concatenate([faces, faces[:, ::-1]])),
    }  # fmt: skip


@pytest.mark.filterwarnings("ignore:.*is cut by a section", "ignore::rasterjit.ViewWarning")
@pytest.mark.parametrize("name", hostile_shapes())
def test_hostile_shapes_are_cut_without_an_error(name):
    vertices, faces = hostile_shapes()[name]
    planes = [
        rj.SectionPlane((0, 0, 0), (0, 0, 1)), rj.SectionPlane((0, 0, 0), (1, 1, 1)),
        rj.SectionPlane((1e15, 1e15, 1e15), (1, 2, 3)), rj.SectionPlane((0, 0, 1e-320), (0, 0, 1)),
    ]  # fmt: skip
    for place in (np.eye(4), np.diag([1.0, 1.0, 0.0, 1.0]), np.diag([-1.0, 1.0, 1.0, 1.0])):
        for section in (*planes, planes):
            scene = rj.Scene()
            mesh = rj.Mesh(vertices, faces, material=rj.Material("flat"), on_invalid="drop")
            scene.add(mesh, place)
            scene.section = section
            frame = shown(scene, size=(16, 12), outputs=("color", "face_id", "normal"))
            assert frame.face_id.max() < len(faces) + 4
