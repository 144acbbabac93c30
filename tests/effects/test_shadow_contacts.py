"""Where surfaces touch, a shadow begins within a texel, and nothing closed lets light in."""

from __future__ import annotations

import math
from dataclasses import replace

import naive_contacts
import naive_shadows
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.effects.shadows import light_leaks
from rasterjit.effects.shadows import stage as shadows_stage

FLAT = rj.Material("flat", "white")


def way_of(elevation, around):
    """Return the direction of light that comes from a height and a side, degrees."""
    rise, turn = math.radians(elevation), math.radians(around)
    flat = math.cos(rise)
    return np.array([-flat * math.cos(turn), -math.sin(rise), -flat * math.sin(turn)])


def shadow_of(kernel, size):
    return rj.Shadow(size, kernel, 1.0 if kernel == "soft" else None)


def wall_on_ground(light, gap=0.0):
    """Return a wall without thickness at x = 0 that stands on a plane, or ends above it."""
    scene = rj.Scene()
    corners = [[-6, 0, -6], [6, 0, -6], [6, 0, 6], [-6, 0, 6]]
    scene.add(rj.Mesh(corners, [[0, 2, 1], [0, 3, 2]], material=FLAT))
    corners = [[0, gap, -3], [0, gap, 3], [0, 1.5, 3], [0, 1.5, -3]]
    scene.add(rj.Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=rj.Material("unlit", "white")))
    scene.lights = [light]
    return scene


def shares(scene, camera):
    """Return the share of light that reaches each pixel of the ground, and where they are."""
    plain = rj.Scene()
    plain.nodes = scene.nodes
    plain.lights = [replace(light, shadow=None) for light in scene.lights]
    outputs = ("linear", "face_id", "position")
    shown, bright = (
        rj.render(each, camera, size=(320, 180), outputs=outputs, threads=1)
        for each in (scene, plain)
    )
    ground = (shown.face_id >= 0) & (shown.face_id < 2)
    share = shown.linear[ground][:, 0].astype(float) / bright.linear[ground][:, 0]
    return share, shown.position[ground].astype(float), shown.face_id[ground]


def texels_from_wall(points, row):
    """Return how far points lie from the foot of the wall in a parallel light's map."""
    across = row[:9].reshape(3, 3)[:2] * row[shadows_stage.FOCAL : shadows_stage.FOCAL + 2, None]
    foot = across @ np.array([0.0, 0.0, 1.0])
    aside = np.array([-foot[1], foot[0]]) / np.linalg.norm(foot)
    # What is left of the way from the foot, at right angles to it: the wall stands at x = 0.
    return np.abs((points * [1.0, 0.0, 0.0]) @ across.T @ aside)


@pytest.mark.parametrize("size", [64, 512])
@pytest.mark.parametrize("kernel", ["hard", "pcf", "soft"])
@pytest.mark.parametrize(("elevation", "around"), [(60.0, 10.0), (45.0, 35.0), (20.0, -30.0)])
def test_behind_a_wall_its_shadow_begins_within_a_texel(kernel, size, elevation, around, drawn):
    light = rj.DirectionalLight(way_of(elevation, around), shadow=shadow_of(kernel, size))
    camera = rj.PerspectiveCamera((-1.5, 1.2, 0.1), (0.0, 0.0, 0.0), near=0.01, fov_y=40.0)
    share, point, _ = shares(wall_on_ground(light), camera)
    behind = (point[:, 0] < 0.0) & (point[:, 0] > -0.5) & (np.abs(point[:, 2]) < 0.8)
    away = texels_from_wall(point[behind], drawn[0].maps[0])
    assert (away > 1.0).sum() > 1000
    assert (share[behind][away > 1.0] == 0.0).all()


@pytest.mark.parametrize(("kernel", "most"), [("hard", 0.0), ("pcf", 0.08), ("soft", 0.12)])
def test_in_front_of_a_wall_no_shadow_is_added(kernel, most, drawn):
    light = rj.DirectionalLight(way_of(60.0, 10.0), shadow=shadow_of(kernel, 512))
    camera = rj.PerspectiveCamera((1.5, 1.2, 0.1), (0.0, 0.0, 0.0), near=0.01, fov_y=40.0)
    share, point, _ = shares(wall_on_ground(light), camera)
    front = (point[:, 0] > 0.0) & (point[:, 0] < 0.5) & (np.abs(point[:, 2]) < 0.8)
    away = texels_from_wall(point[front], drawn[0].maps[0])
    assert (share[front] > 0.0).all()
    assert (share[front][away > 1.0] >= 1.0 - most).all()


@pytest.mark.parametrize("kernel", ["hard", "pcf"])
def test_light_still_passes_below_a_wall_that_ends_above_the_ground(kernel, drawn):
    light = rj.DirectionalLight(way_of(45.0, 10.0), shadow=shadow_of(kernel, 512))
    scene = wall_on_ground(light, gap=0.1)
    camera = rj.PerspectiveCamera((-1.5, 1.2, 0.1), (0.0, 0.0, 0.0), near=0.01, fov_y=40.0)
    share, point, own = shares(scene, camera)
    near = (np.abs(point[:, 0]) < 0.5) & (np.abs(point[:, 2]) < 0.8)
    triangles = naive_shadows.world_triangles(scene)
    focal = drawn[0].maps[0, shadows_stage.FOCAL : shadows_stage.FOCAL + 2].min()
    aside = np.full(near.sum(), 3.5 / focal)
    dark, bright = naive_shadows.clear_shadow(point[near], own[near], triangles, light, aside)
    below = bright & (point[near, 0] < 0.0)
    assert min(dark.sum(), below.sum()) > 100
    assert (share[near][bright] == 1.0).all()
    assert (share[near][dark] == 0.0).all()


def random_map(rng, size):
    """Return a map of planes that cross each other and end anywhere, and the planes."""
    rows, columns = np.mgrid[:size, :size] + 0.5
    texels, planes = np.full((size, size), -np.inf), []
    for _ in range(rng.integers(2, 6)):
        across, down = rng.normal(size=2) * 10.0 ** rng.uniform(-2, 1)
        depth = 5.0 + rng.normal() - across * size / 2 - down * size / 2
        planes.append((depth, across, down))
        turn = rng.uniform(0.0, 2.0 * np.pi)
        is_there = np.cos(turn) * (columns - size / 2) + np.sin(turn) * (rows - size / 2)
        plane = depth + across * columns + down * rows
        texels = np.where(is_there > rng.uniform(-size, 3), np.maximum(texels, plane), texels)
    return texels.astype(np.float32), planes


def test_contacts_are_those_of_the_slow_twin():
    rng, size = np.random.default_rng(7), 24
    counts = {True: 0, False: 0, None: 0}
    for _ in range(40):
        texels, planes = random_map(rng, size)
        for depth, across, down in planes:
            u, v = rng.uniform(-2.0, size + 2.0, (2, 64)).astype(np.float32)
            here = (depth + across * u + down * v).astype(np.float32)
            right, below = np.full((2, 64), [[across], [down]], np.float32)
            share, unsure = np.full((2, 64), np.float32(0.5))
            light_leaks.remove_contact_leaks(
                u, v, here, right, below, texels.ravel(), size, np.float32(1.0), unsure, share
            )
            for n in range(64):
                told = naive_contacts.is_dark(texels, u[n], v[n], (here[n], right[n], below[n]))
                counts[told] += 1
                assert told is None or told == (share[n] == 0.0), (texels, n)
    print(counts)
    assert counts[True] > 100
    assert counts[False] > 1000
    assert counts[None] < 0.2 * (counts[True] + counts[False])


def terrain():
    """Return a smooth surface of hills and hollows."""
    x, z = np.meshgrid(np.linspace(-1, 1, 101), np.linspace(-1, 1, 101), indexing="ij")
    y = 0.06 * (np.sin(9.0 * x) * np.cos(7.0 * z) + 0.5 * np.sin(23.0 * x + 11.0 * z))
    at = np.arange(101 * 101).reshape(101, 101)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.stack([x, y, z], -1).reshape(-1, 3), faces


def stairs(count):
    """Return steps along x, from -1 to 1."""
    x, y = np.repeat(np.linspace(-1, 1, count + 1), 2), np.repeat(np.arange(count + 1), 2)
    profile = np.stack([x[1:-1], 1.2 / count * y[:-2]], -1)
    corners = np.array([(u, h, z) for u, h in profile for z in (-1.0, 1.0)])
    first = 2 * np.arange(len(profile) - 1)[:, np.newaxis]
    return corners, np.concatenate([first + [0, 1, 3], first + [0, 3, 2]])


ROUGH = {"terrain": terrain(), "wide stairs": stairs(32), "narrow stairs": stairs(128)}


LEFT_BLACK = {"terrain": 0.0015, "wide stairs": 0.001, "narrow stairs": 0.015}
"""Share of what is lit that may be black all the same; steps of about a texel look like walls."""


@pytest.mark.parametrize("way", [(0.0, -1.0, 0.0), (0.3, -1.0, 0.1), (-0.5, -0.6, 0.2)])
@pytest.mark.parametrize("shape", ROUGH)
def test_what_a_fine_map_finds_lit_is_not_black(shape, way):
    scene = rj.Scene()
    scene.add(rj.Mesh(*ROUGH[shape], material=FLAT))
    camera = rj.OrthographicCamera((0, 5, 0.01), (0, 0, 0), (0, 0, -1), height=2.2, far=20)

    def light_by(shadow):
        scene.lights = [rj.DirectionalLight(way, shadow=shadow)]
        frame = rj.render(scene, camera, size=(256, 256), outputs=("linear", "face_id"))
        return np.where(frame.face_id >= 0, frame.linear[..., 0].astype(float), 0.0)

    bright, fine = light_by(None), light_by(rj.Shadow(4096, "hard"))
    coarse = light_by(rj.Shadow(128, "pcf"))
    lit = (fine > 0.99 * bright) & (bright > 0.1)
    assert lit.sum() > 10_000
    assert (coarse[lit] == 0.0).mean() <= LEFT_BLACK[shape]


@pytest.mark.parametrize("way", [(0.0, -1.0, 0.0), (0.3, -1.0, 0.1)])
def test_vertices_are_not_looked_at_for_contacts(way):
    # Their planes face the light, whatever their faces do; one dark vertex darkens all its faces.
    scene = rj.Scene()
    scene.add(rj.Mesh(*terrain(), material=rj.Material("gouraud", "white", specular=0.0)))
    camera = rj.OrthographicCamera((0, 5, 0.01), (0, 0, 0), (0, 0, -1), height=2.0, far=20)
    shares = []
    for shadow in (rj.Shadow(128, "pcf"), None):
        scene.lights = [rj.DirectionalLight(way, shadow=shadow)]
        frame = rj.render(scene, camera, size=(256, 256), outputs=("linear",))
        shares.append(frame.linear[..., 0].astype(float))
    assert shares[1].min() > 0.0
    assert (shares[0] > 0.5 * shares[1]).all()
