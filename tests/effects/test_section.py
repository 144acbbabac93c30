"""Sections: what planes cut away, what caps fill, and what all outputs say of it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.survey import sections
from rasterjit.survey.sections import cut

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
    nodes = cut(scene).nodes
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
    plane = rj.Plane(rng.normal(size=3) * 0.1, rng.normal(size=3))
    scene = scene_with((vertices, faces, place), planes=plane)
    left = areas(world_of(cut(scene).nodes[0])).sum(axis=0) * np.sign(np.linalg.det(place[:3, :3]))
    ((cap,),) = caps_of(scene).values()
    found = areas(world_of(cap))
    assert np.linalg.norm(found, axis=1).sum() == pytest.approx(-left @ plane.normal, abs=NEAR)
    np.testing.assert_allclose(
        found.sum(axis=0) * np.sign(np.linalg.det(place[:3, :3])), -left, atol=NEAR
    )
    distances = (world_of(cap) - plane.point) @ plane.normal
    assert np.abs(distances).max() < 1e-14


@pytest.mark.parametrize(
    ("name", "height", "area"),
    [
        ("box", 0.0, 2.0), ("box", 0.75, 0.0), ("box", -0.75, 0.0), ("cavity", 0.0, 3.0),
        ("cavity", 0.5, 3.0), ("cavity", 0.75, 4.0), ("cavity", -0.5, 3.0), ("cavity", 1.0, 0.0),
    ],
)  # fmt: skip
def test_planes_through_faces_are_exact(name, height, area):
    # What lies in the plane stays where the solid is behind it: the ceiling of a cavity does not.
    scene = scene_with((*solid(name), np.eye(4)), planes=rj.Plane((0, 0, height), (0, 0, 1)))
    caps = caps_of(scene).get(0, [])
    assert sum(np.linalg.norm(areas(world_of(cap)), axis=1).sum() for cap in caps) == area


def test_a_plane_that_touches_a_top_leaves_it_as_it_is():
    vertices, faces = solid("box")
    for height, normal in ((0.75, 1.0), (-0.75, -1.0)):
        scene = scene_with(
            (vertices, faces, np.eye(4)), planes=rj.Plane((0, 0, height), (0, 0, normal))
        )
        assert cut(scene).nodes[0] is scene.nodes[0]


def test_nothing_is_left_of_what_only_touches_from_before():
    scene = scene_with((*solid("box"), np.eye(4)), planes=rj.Plane((0, 0, 0.75), (0, 0, -1)))
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
    planes = rj.Plane((0, 0, 0.1), (0, 0, 1))
    scene = scene_with((shape.vertices, shape.faces, np.eye(4)), planes=planes)
    ((cap,),) = caps_of(scene).values()
    area = np.linalg.norm(areas(world_of(cap)), axis=1).sum()
    assert area == pytest.approx(4.0 + 0.75 + 0.25, abs=1e-7)


@pytest.mark.parametrize("name", SOLIDS)
def test_several_planes_leave_a_closed_solid(name):
    # Caps are cut by the other planes: each side of what is left has one that goes back.
    planes = [
        rj.Plane((0.1, 0, 0), (1, 0.2, 0)), rj.Plane((0, 0.1, 0), (0, 1, 0.3)),
        rj.Plane((0, 0, 0.05), (-0.3, 0, 1)),
    ]  # fmt: skip
    scene = scene_with((*solid(name), turned(3)), planes=planes)
    nodes = cut(scene).nodes
    assert len(nodes) == 4 - (name == "torus")
    total = sum(areas(world_of(node)).sum(axis=0) for node in nodes)
    if name != "crossing":
        np.testing.assert_allclose(total, 0.0, atol=NEAR)
    for node, plane in itertools.product(nodes, planes):
        assert ((world_of(node) - plane.point) @ plane.normal).max() < 1e-14


def winding(corners, points):
    """Return how often surfaces, (F, 3, 3), go around points, (N,): by solid angles."""
    a, b, c = (corners[np.newaxis, :, k] - points[:, np.newaxis] for k in range(3))
    la, lb, lc = (np.linalg.norm(one, axis=2) for one in (a, b, c))
    numerator = np.einsum("nfk,nfk->nf", a, np.cross(b, c))
    denominator = (
        la * lb * lc + np.einsum("nfk,nfk->nf", a, b) * lc
        + np.einsum("nfk,nfk->nf", b, c) * la + np.einsum("nfk,nfk->nf", c, a) * lb
    )  # fmt: skip
    return np.rint(2.0 * np.arctan2(numerator, denominator).sum(axis=1) / (4.0 * np.pi))


def seen_through(scene, eyes, ways):
    """
    Return what rays see, slowly: object, face (-1 - plane of caps), and how far, (N,) each.

    A cap is seen where a ray meets a plane inside of a solid.
    """
    planes = sections.planes_of(scene.section)
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


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("name", SOLIDS)
def test_what_is_seen_through_the_cut_is_what_rays_find(name, parallel):
    seed = SOLIDS.index(name)
    planes = [rj.Plane((0, 0, 0.1), (0.2, 0.3, 1.0)), rj.Plane((0.1, 0, 0), (1.0, 0.1, 0.4))]
    place = rj.transforms.translate((2.6, 0.4, -0.3)) @ turned(seed + 7, mirrored=True)
    scene = scene_with(
        (*solid(name), turned(seed)), (*solid("torus"), place), planes=planes[: 1 + seed % 2]
    )
    looking = {"eye": (2.2, 1.8, 6.0), "target": (1.2, 0, 0)}
    if parallel:
        camera = rj.OrthographicCamera(height=4.4, near=0.5, far=20.0, **looking)
    else:
        camera = rj.PerspectiveCamera(fov_y=40.0, near=0.5, far=20.0, **looking)
    outputs = ("object_id", "face_id", "position", "geometric_normal", "barycentric", "depth")
    frame = rj.render(scene, camera, size=SIZE, outputs=outputs, threads=1)
    eyes, ways = (part.reshape(-1, 3) for part in camera.rays(SIZE))
    owners, faces, far = seen_through(scene, eyes, ways)
    starts = np.cumsum([0, *(len(node.mesh.faces) for node in scene.nodes)])
    count = len(sections.planes_of(scene.section))
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
    for number, plane in enumerate(sections.planes_of(scene.section)):
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
