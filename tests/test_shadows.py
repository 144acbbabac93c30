"""Shadows equal rays against every triangle, but for some texels at their edges, at any scale."""

from __future__ import annotations

import math

import naive_shadows
import numpy as np
import pytest

import rasterjit as rj
from rasterjit import shadow_maps
from rasterjit import transforms as tf
from rasterjit.kernels import shadowing

SIZE = (96, 72)
BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
         [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
MATT = rj.Material("phong", "white")
FLAT = rj.Material("flat", "white")


def ground(half=6.0):
    corners = [[-half, 0, -half], [half, 0, -half], [half, 0, half], [-half, 0, half]]
    return rj.Mesh(corners, [[0, 2, 1], [0, 3, 2]], material=MATT)


def box():
    return rj.Mesh(BOX, SIDES, material=FLAT)


def box_on_ground(light, scale=1.0, offset=(0.0, 0.0, 0.0)):
    """Return a unit box that stands on a plane, and a camera that sees most of it."""
    place = tf.compose(tf.translate(offset), tf.scale(scale))
    scene = rj.Scene()
    scene.add(ground(), place)
    scene.add(box(), tf.compose(place, tf.translate((-0.5, 0.0, -0.5))))
    scene.lights = [light]
    eye = np.array([2.0, 3.5, 5.0]) * scale + offset
    camera = rj.PerspectiveCamera(eye, np.array(offset, float), near=0.1 * scale, fov_y=50.0)
    return scene, camera


@pytest.fixture
def drawn(monkeypatch):
    """Catch the shadow maps that are drawn."""
    caught = []
    draw = shadow_maps.draw_shadows

    def catch(*arguments):
        caught.append(draw(*arguments))
        return caught[-1]

    monkeypatch.setattr(shadow_maps, "draw_shadows", catch)
    return caught


def without_shadow(scene):
    plain = rj.Scene()
    plain.nodes = scene.nodes
    plain.lights = [
        light if isinstance(light, rj.AmbientLight) else unshadowed(light) for light in scene.lights
    ]
    return plain


def unshadowed(light):
    from dataclasses import replace

    return replace(light, shadow=None)


def shares(scene, camera, size=SIZE):
    """Return the share of light that reaches each pixel, NaN where there is none, and buffers."""
    outputs = ("linear", "face_id", "position")
    shown = rj.render(scene, camera, size=size, outputs=outputs, threads=1)
    bright = rj.render(without_shadow(scene), camera, size=size, outputs=outputs, threads=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = shown.linear[..., 0].astype(float) / bright.linear[..., 0]
    return np.where(shown.face_id >= 0, share, np.nan), shown


def texel_of(shadows, light, points):
    """Return how large a texel is at some points, scene units."""
    focal = shadows.maps[0, shadowing.FOCAL : shadowing.FOCAL + 2].min()
    if isinstance(light, rj.DirectionalLight):
        return np.full(len(points), 1.0 / focal)
    # On the sides of a cube as well, the depth is at most the distance.
    return np.linalg.norm(naive_shadows.toward(light, points), axis=1) / focal


def judge(scene, camera, light, shadows, reach, size=SIZE):
    """Compare a picture with rays: all of the plane's light where they say so, and none."""
    share, frame = shares(scene, camera, size)
    triangles = naive_shadows.world_triangles(scene)
    seen = np.isfinite(share)
    own = frame.face_id[seen]
    # The point on the plane of the face: positions are rounded to float32.
    points = frame.position[seen].astype(float)
    a, b, c = np.moveaxis(triangles[own], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    points -= ((points - a) * normal).sum(axis=1, keepdims=True) * normal
    aside = reach * texel_of(shadows, light, points)
    dark, bright = naive_shadows.clear_shadow(points, own, triangles, light, aside)
    return share[seen], dark, bright, own


def sun(elevation, around=30.0, **shadow):
    height, flat = math.sin(math.radians(elevation)), math.cos(math.radians(elevation))
    turn = math.radians(around)
    way = (-flat * math.cos(turn), -height, -flat * math.sin(turn))
    return rj.DirectionalLight(way, shadow=rj.Shadow(**shadow))


def lamp(kind, elevation, scale=1.0, offset=(0.0, 0.0, 0.0), around=30.0, **shadow):
    way = np.array(sun(elevation, around).direction)
    place = -5.0 * scale * way + offset
    shadow = rj.Shadow(**shadow)
    if kind == "spot":
        return rj.SpotLight(
            place, way, intensity=min(scale**2, 1e9), outer_angle=40.0, shadow=shadow
        )
    return rj.PointLight(place, intensity=min(scale**2, 1e9), shadow=shadow)


def light_of(kind, elevation, scale=1.0, offset=(0.0, 0.0, 0.0), **shadow):
    if kind == "directional":
        return sun(elevation, **shadow)
    return lamp(kind, elevation, scale, offset, **shadow)


REACHES = {"hard": 1.5, "pcf": 3.5}
"""Texels from an edge of a shadow beyond which there is no sign of it."""


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("elevation", [80.0, 40.0, 12.0, 3.0])
@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
@pytest.mark.parametrize("kernel", ["hard", "pcf"])
def test_no_acne_and_no_gap(kernel, kind, elevation, scale, drawn):
    light = light_of(kind, elevation, scale, filter=kernel, size=512)
    scene, camera = box_on_ground(light, scale)
    share, dark, bright, _ = judge(scene, camera, light, _First(drawn), REACHES[kernel])
    assert bright.sum() > 1000
    assert (share[bright] == 1.0).all()
    assert (share[dark] == 0.0).all()
    assert dark.sum() > (20 if elevation < 60.0 else 0)


class _First:
    """The maps of the first picture that was drawn with shadows."""

    def __init__(self, caught):
        self.caught = caught

    @property
    def maps(self):
        return next(shadows for shadows in self.caught if shadows is not None).maps
