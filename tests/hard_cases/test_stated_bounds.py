"""
Bounds that the guarantees state in a table: each against integrals, rays or exact arithmetic.

A bound here is at most about twice what is measured, so that what gets worse is found.
"""

from __future__ import annotations

import functools
import math
import re
from pathlib import Path

import naive_environment
import numpy as np
import pytest
import skies

import rasterjit as rj

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "guides" / "guarantees.md"
WHITE = rj.Material("flat", base_color="white", specular=0.0)
GRID = 1.0 / 128.0
"""Places nearer to an edge than this are left to how vertices are rounded, pixels."""


def rows_of_table():
    """Return what the table of bounds says, row by row: its cells."""
    text = PAGE.read_text(encoding="utf-8").split("| quantity | bound | measured against | test |")[
        1
    ]
    lines = text.split("\n\n")[0].strip().splitlines()[1:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_every_stated_bound_names_a_test_that_exists():
    rows, own = rows_of_table(), Path(__file__).read_text(encoding="utf-8")
    assert len(rows) >= 8
    named = [name for row in rows for name in re.findall(r"`(test_\w+)`", row[3])]
    assert all(re.search(r"`test_\w+`", row[3]) for row in rows)
    for name in named:
        assert f"def {name}(" in own
    measured = re.findall(r"^def (test_\w+)\(", own, re.M)
    assert {*measured} - {"test_every_stated_bound_names_a_test_that_exists"} == {*named}


# Light of environments


def units(count, seed=1):
    """Return random directions, (N, 3)."""
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, np.newaxis]


def ball(material, rows=24):
    """Return a ball of radius 1 with its exact normals."""
    v, u = (part.ravel() for part in np.mgrid[0 : rows + 1, 0 : 2 * rows + 1])
    polar, around = v * (np.pi / rows), u * (np.pi / rows)
    points = np.stack(
        [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], axis=1
    )
    a = (np.arange(rows)[:, None] * (2 * rows + 1) + np.arange(2 * rows)).ravel()
    b = a + 2 * rows + 1
    faces = np.concatenate([np.stack([a, b, a + 1], 1), np.stack([a + 1, b, b + 1], 1)])
    return rj.Mesh(points, faces, normals=points, material=material, on_invalid="drop")


def shown(node, camera, size=(64, 64), **scene_fields):
    """Return a frame of a mesh alone in a scene."""
    scene = rj.Scene()
    scene.add(node)
    scene.lights = scene_fields.pop("lights", [])
    for name, value in scene_fields.items():
        setattr(scene, name, value)
    return rj.render(scene, camera, size=size, outputs=("linear", "normal", "face_id"))


def with_discs(places, degrees, levels, size=256):
    """Return a dim panorama with bright discs, each so many degrees across."""
    d = skies.directions(size, size // 2)
    image = np.full((*d.shape[:2], 3), 0.02, np.float32)
    for place, wide, level in zip(places, degrees, levels, strict=True):
        image[d @ (place / np.linalg.norm(place)) > np.cos(np.radians(wide / 2.0))] = level
    return image


@functools.cache
def panoramas():
    """Return panoramas by name, and how far off the light on a matt surface may be."""
    sun = np.array([0.5, 0.6, 0.3])
    small = {
        f"sun of {wide} degrees": (with_discs([sun], [wide], [300.0]), 0.015)
        for wide in (3, 6, 12, 25)
    }
    places = units(40, seed=4)
    return small | {
        "sun in a sky": (skies.sunny(256, 128, brightness=400.0, degrees=3.0), 0.015),
        "sky": (skies.sunny(256, 128, brightness=0.0, degrees=0.1), 0.01),
        "forty lamps": (with_discs(places, [6.0] * 40, np.linspace(5.0, 100.0, 40)), 0.03),
        "windows": (with_discs(places[:3], [30.0, 20.0, 50.0], [20.0, 40.0, 8.0]), 0.03),
    }  # fmt: skip


@pytest.mark.parametrize("name", panoramas())
def test_light_of_a_panorama_on_a_matt_surface(name):
    image, bound = panoramas()[name]
    camera = rj.PerspectiveCamera((2.0, 3.0, 2.0), (0.0, 0.0, 0.0))
    frame = shown(
        ball(rj.Material("phong", base_color="white", specular=0.0)), camera,
        environment=rj.Environment(image, background=False),
    )  # fmt: skip
    pick = np.argwhere(frame.face_id >= 0)[::17]
    normals, seen = frame.normal[tuple(pick.T)], frame.linear[tuple(pick.T)][:, :3]
    want = np.array([naive_environment.irradiance(image, n.astype(float)) for n in normals])
    most = naive_environment.irradiance(image, brightest_side(image)).max()
    assert np.abs(seen - want).max() <= bound * most


def brightest_side(image):
    """Return the direction that most of the light comes from."""
    height, width = image.shape[:2]
    flux = image.sum(axis=2)[..., None] * skies.solid_angles(width, height)[..., None]
    toward = (skies.directions(width, height) * flux).sum(axis=(0, 1))
    return toward / np.linalg.norm(toward)


@pytest.mark.parametrize(
    "colors",
    [((0, 0, 0), (1, 1, 1), (0, 0, 0)), ((0.1, 0.2, 0.9), (0.9, 0.8, 0.7), (0.3, 0.2, 0.1))],
)
def test_light_of_a_gradient_on_a_matt_surface(colors):
    environment = rj.Environment.gradient(*colors, background=False)
    white = rj.Material("phong", base_color="white", specular=0.0)
    frame = shown(
        ball(white), rj.PerspectiveCamera((2.0, 3.0, 2.0), (0.0, 0.0, 0.0)), environment=environment
    )
    column = [
        naive_environment.gradient(environment.sky, d) for d in skies.directions(4, 512)[:, 0]
    ]
    image = np.array(column)[:, None].repeat(64, axis=1)
    pick = np.argwhere(frame.face_id >= 0)[::17]
    for row, column in pick:
        want = naive_environment.irradiance(image, frame.normal[row, column].astype(float))
        assert frame.linear[row, column, :3] == pytest.approx(want, rel=0.006)


@pytest.mark.parametrize("metallic", [0.0, 1.0])
@pytest.mark.parametrize("roughness", [0.6, 1.0])
def test_a_dome_of_lights_shows_what_a_sky_of_the_same_light_does(metallic, roughness):
    environment = rj.Environment.gradient(
        (0.3, 0.5, 0.9), (0.8, 0.8, 0.7), (0.1, 0.08, 0.05), background=False
    )
    count, sky = 400, environment.sky
    # Points of a spiral stand for equal areas of the sphere.
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn, level = np.arange(count) * math.pi * (3.0 - 5.0**0.5), np.sqrt(1.0 - height * height)
    toward = np.stack([level * np.cos(turn), height, level * np.sin(turn)], axis=1)
    lights = [
        rj.DirectionalLight(-d, tuple(naive_environment.gradient(sky, d)), 4.0 / count)
        for d in toward
    ]
    material = rj.Material(
        "pbr", base_color=(0.9, 0.6, 0.3), metallic=metallic, roughness=roughness
    )
    camera = rj.PerspectiveCamera((0.0, 0.3, 4.0), (0.0, 0.0, 0.0))
    by_sky = shown(ball(material), camera, (40, 40), environment=environment)
    by_lights = shown(ball(material), camera, (40, 40), lights=lights)
    on = by_sky.face_id >= 0
    one, other = by_lights.linear[on][:, :3], by_sky.linear[on][:, :3]
    assert one.mean() == pytest.approx(other.mean(), rel=0.04)
    assert (np.abs(one / other - 1.0) < 0.12).mean() > 0.95


# Shade


@functools.cache
def ray_tracer(name):
    """Return a scene's triangles and a function that finds how far rays go, infinite for none."""
    pytest.importorskip("embreex")
    trimesh = pytest.importorskip("trimesh")
    ray = pytest.importorskip("trimesh.ray.ray_pyembree")
    corners = triangles_of(scene_named(name))
    mesh = trimesh.Trimesh(
        corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False
    )
    tracer = ray.RayMeshIntersector(mesh)

    def trace(origins, directions):
        far = np.full(len(origins), np.inf)
        _, hit, places = tracer.intersects_id(
            origins, directions, multiple_hits=False, return_locations=True
        )
        far[hit] = np.linalg.norm(places - origins[hit], axis=1)
        return far

    return corners, trace


def triangles_of(scene):
    """Return the corners of all faces in world space, (F, 3, 3)."""
    parts = []
    for node in scene.nodes:
        points = rj.transforms.apply(node.world_from_model, node.mesh.vertices)
        parts.append(points[node.mesh.faces])
    return np.concatenate(parts)


def scene_named(name):
    """Return a model of size 1, without normals, on a floor."""
    mesh = rj.load(ROOT / "models" / name).nodes[0].mesh
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    fitted = (mesh.vertices - (low + high) / 2.0) / (high - low).max()
    scene = rj.Scene()
    scene.add(rj.Mesh(fitted.astype(np.float32), mesh.faces, material=WHITE))
    floor = [(-2, -0.5, -2), (2, -0.5, -2), (2, -0.5, 2), (-2, -0.5, 2)]
    scene.add(rj.Mesh(floor, [(0, 2, 1), (0, 3, 2)], material=WHITE))
    scene.lights = [rj.AmbientLight(intensity=1.0)]
    return scene


@pytest.mark.parametrize("name", ["teapot.obj", "torus_knot.obj"])
@pytest.mark.parametrize("radius", [0.15, 0.4])
def test_ambient_occlusion_is_near_that_of_rays(name, radius):
    corners, trace = ray_tracer(name)
    scene, camera = scene_named(name), rj.PerspectiveCamera((0.8, 0.9, 1.6), (0.0, -0.1, 0.0))
    scene.ambient_occlusion = rj.AmbientOcclusion(radius=radius)
    frame = rj.render(scene, camera, size=(160, 120), outputs=("linear", "position", "face_id"))
    pick = np.argwhere(frame.face_id >= 0)[::23]
    points = frame.position[tuple(pick.T)].astype(float)
    faces = corners[frame.face_id[tuple(pick.T)]]
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals *= np.sign(((camera.eye - points) * normals).sum(axis=1))[:, None]
    # Rays spread by the cosine: equal steps of the squared sine.
    across = np.where(np.abs(normals[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(normals, across)
    first /= np.linalg.norm(first, axis=1)[:, None]
    second, blocked = np.cross(normals, first), np.zeros(len(points))
    for squared in (np.arange(12) + 0.5) / 12.0:
        for turn in (np.arange(12) + 0.5) * (np.pi / 6.0):
            aslant = math.cos(turn) * first + math.sin(turn) * second
            toward = math.sqrt(squared) * aslant + math.sqrt(1.0 - squared) * normals
            blocked += trace(points + 1e-4 * normals, toward) < radius
    error = frame.linear[tuple(pick.T)][:, 0] - (1.0 - blocked / 144.0)
    assert -0.01 <= error.mean() <= 0.05
    assert (np.abs(error) <= 0.25).mean() >= 0.94


@pytest.mark.parametrize("degrees", [1.0, 3.0, 8.0])
def test_a_soft_shadow_of_a_straight_edge_is_the_share_of_the_disc(degrees):
    def strip(left, right, height, half):
        corners = [(left, height, -half), (right, height, -half), (right, height, half),
                   (left, height, half)]  # fmt: skip
        return rj.Mesh(corners, [(0, 2, 1), (0, 3, 2)], material=WHITE)

    scene, radius = rj.Scene(), math.tan(math.radians(degrees / 2.0))
    scene.add(strip(-4.0, 4.0, 0.0, 4.0))
    scene.add(strip(-3.0, 0.0, 1.0, 2.0))
    shadow = rj.Shadow(2048, "soft", light_size=degrees)
    scene.lights = [rj.DirectionalLight((0.0, -1.0, 0.0), intensity=1.0, shadow=shadow)]
    # Aslant, past the strip that casts it.
    camera = rj.OrthographicCamera(
        (6.0, 3.0, 0.0), (0.0, 0.0, 0.0), height=8.0 * radius, near=0.1, far=40.0
    )
    frame = rj.render(scene, camera, size=(120, 120), outputs=("linear", "position", "object_id"))
    floor = frame.object_id == 0
    x = frame.position[floor][:, 0] / radius
    u = np.clip(x, -1.0, 1.0)
    want = (np.arccos(-u) + u * np.sqrt(1.0 - u * u)) / np.pi
    error = (frame.linear[floor][:, 0] - want)[np.abs(x) < 1.2]
    assert len(error) > 1000
    assert np.abs(error).max() <= 0.06
    assert np.abs(error).mean() <= 0.02
    assert abs(error.mean()) <= 0.01


# Buffers


def test_depths_of_steep_lines_are_those_a_fiftieth_of_a_pixel_away_along_the_line():
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=60.0, near=0.1, far=1000.0)
    size, rng = (320, 240), np.random.default_rng(1)
    matrix = camera.projection_matrix(size) @ camera.view_matrix()

    def place(point):
        x, y, _, w = matrix @ [*point, 1.0]
        return np.array([(x / w + 1.0) * size[0] / 2.0, (1.0 - y / w) * size[1] / 2.0]), w

    compared = 0
    for n in range(60):
        far = 10.0 ** rng.uniform(0.5, 2.5)
        ends = np.array([
            [*rng.uniform(-0.8, 0.8, 2), -2.0], [*rng.uniform(-0.4 * far, 0.4 * far, 2), -far],
        ])  # fmt: skip
        scene = rj.Scene()
        scene.add(rj.Lines(ends, width=(1.0, 3.0, 8.0)[n % 3], caps="butt"))
        depth = rj.render(scene, camera, size=size, outputs=("depth",)).depth
        row, column = np.nonzero(np.isfinite(depth))
        (start, w0), (end, w1) = map(place, ends)
        way = end - start
        length = math.hypot(*way)
        if length < 4.0:
            continue
        at = (np.stack([column + 0.5, row + 0.5], axis=1) - start) @ way / length**2
        bounds = [
            1.0 / ((1.0 - t) / w0 + t / w1)
            for t in (np.clip(at + step / length, 0.0, 1.0) for step in (-0.02, 0.02))
        ]
        have = depth[row, column]
        assert (have >= np.minimum(*bounds) * (1.0 - 1e-5)).all()
        assert (have <= np.maximum(*bounds) * (1.0 + 1e-5)).all()
        compared += len(have)
    assert compared > 5000


@pytest.mark.parametrize("name", ["teapot.obj", "torus_knot.obj"])
def test_what_was_seen_before_is_what_rays_find_away_from_silhouettes(name):
    _, trace = ray_tracer(name)
    scene, size = scene_named(name), (400, 300)
    now = rj.PerspectiveCamera((0.8, 0.9, 1.6), (0.0, 0.0, 0.0))
    before = rj.PerspectiveCamera((1.2, 0.5, 1.4), (0.0, 0.0, 0.0))
    frame = rj.render(
        scene, now, size=size, outputs=("motion", "motion_visible", "position", "face_id"),
        previous=rj.PreviousView(scene, before),
    )  # fmt: skip
    earlier = rj.render(scene, before, size=size, outputs=("distance",)).distance
    rows, columns = np.nonzero(frame.face_id >= 0)
    places = np.stack([columns + 0.5, rows + 0.5], axis=1) - frame.motion[rows, columns]
    inside = ((places >= 1.0) & (places < np.array(size) - 1.0)).all(axis=1)
    rows, columns, places = rows[inside], columns[inside], places[inside].astype(int)
    points = frame.position[rows, columns].astype(float)
    away = points - before.eye
    far = np.linalg.norm(away, axis=1)
    want = trace(np.broadcast_to(before.eye, away.shape), away / far[:, None]) >= far - 2e-4
    wrong = want != frame.motion_visible[rows, columns]
    around = np.array([
        np.where(np.isfinite(earlier), earlier, 9.0)[places[:, 1] + i, places[:, 0] + j]
        for i in (-1, 0, 1) for j in (-1, 0, 1)
    ])  # fmt: skip
    at_silhouette = np.ptp(around, axis=0) > 0.03
    assert len(wrong) > 30000
    assert (wrong & ~at_silhouette).sum() <= 4
    assert wrong.mean() <= 0.01


@pytest.mark.parametrize("name", ["teapot.obj", "torus_knot.obj"])
def test_layers_are_as_many_as_faces_cover_the_centre(name):
    scene, size = rj.Scene(), (240, 180)
    scene.add(scene_named(name).nodes[0].mesh)
    camera = rj.PerspectiveCamera((0.8, 0.9, 1.6), (0.0, 0.0, 0.0))
    layers = rj.render_layers(scene, camera, k=32, size=size, outputs=("face_id",))
    have = (layers.face_id >= 0).sum(axis=0)
    matrix = camera.projection_matrix(size) @ camera.view_matrix()
    clip = triangles_of(scene) @ matrix[:, :3].T + matrix[:, 3]
    places = (clip[..., :2] / clip[..., 3:] * (1.0, -1.0) + 1.0) / 2.0 * size
    want, unsure = np.zeros(have.shape, int), np.zeros(have.shape, bool)
    for corners in places:
        left, top = np.maximum(np.floor(corners.min(axis=0) - 1.0).astype(int), 0)
        right, bottom = np.minimum(np.ceil(corners.max(axis=0) + 1.0).astype(int), size)
        x, y = np.meshgrid(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5)
        inside = np.full(x.shape, np.inf)
        (ax, ay), (bx, by) = corners[1] - corners[0], corners[2] - corners[0]
        turn = math.copysign(1.0, ax * by - ay * bx)
        for k in range(3):
            start, (dx, dy) = corners[k], corners[(k + 1) % 3] - corners[k]
            across = (y - start[1]) * dx - (x - start[0]) * dy
            inside = np.minimum(inside, turn * across / max(math.hypot(dx, dy), 1e-12))
        want[top:bottom, left:right] += inside >= 0.0
        unsure[top:bottom, left:right] |= np.abs(inside) < GRID
    assert (want > 0).sum() > 3000
    assert (have == want)[~unsure].all()
    assert (have != want).mean() < 1e-3


def test_grey_maps_have_the_codes_of_float64():
    for name, level in (("gray", lambda n: n * (1 / 255)), ("gray_r", lambda n: 1 - n * (1 / 255))):
        want = [[*[int(level(n) * 255)] * 3, 255] for n in range(256)]
        assert rj.Colormap(name).codes.tolist() == want
