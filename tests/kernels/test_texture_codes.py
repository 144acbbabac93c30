"""Textures that are mixed in 8-bit codes, against exact coordinates and mixes."""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import naive_textures as naive
import numpy as np
import pytest
from naive_textures import SIZE, TRIANGLES

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.scene import texture as texture_module
from rasterjit.survey import packed_scene

IN_CODES = rj.Quality(texture_mixing="srgb8")
OUTPUTS = "color", "face_id"
CODES = np.random.default_rng(3).integers(0, 256, (13, 10, 3), np.uint8)
CHANNELS = [CODES[:, :, channel].tolist() for channel in range(3)]
UV = np.array([(-0.25, 0.5), (1.5, 0.125), (0.75, 1.25)])

PLACE_ERROR = 1e-4
"""Texels: float32 weights and coordinates some periods from 0."""
MIX_ERROR = 0.5 + 0.5 + 2 * 255 * (0.5 / 256 + PLACE_ERROR)
"""Codes: two roundings, and weights of 8 bits, across and up."""


@pytest.mark.parametrize("name", TRIANGLES)
@pytest.mark.parametrize("wraps", [("repeat", "mirror"), ("clamp", "repeat"), ("mirror", "clamp")])
@pytest.mark.parametrize("kind", ["nearest", "bilinear"])
def test_codes_are_those_of_the_exact_place(name, wraps, kind):
    points, ws, repeats = TRIANGLES[name]
    texture, uvs = rj.Texture(CODES, filter=kind, wrap=wraps), (UV * repeats).tolist()
    frame = naive.draw_triangle(points, ws, uvs, texture, OUTPUTS, quality=IN_CODES)
    triangle = [tuple(Fraction(n, 256) for n in p) for p in oracle.snap_triangle(points)]
    exact_ws, exact_uv = [Fraction(w) for w in ws], [tuple(map(Fraction, p)) for p in uvs]
    planes, reach = naive.planes_of(triangle, exact_ws, exact_uv), Fraction(PLACE_ERROR) / 13
    pixels = np.argwhere(frame.face_id >= 0)
    assert len(pixels) > 50
    for y, x in pixels.tolist():
        center = Fraction(2 * x + 1, 2), Fraction(2 * y + 1, 2)
        u, v = naive.coordinates_at(center, planes)
        shown = frame.color[y, x, :3].tolist()
        if kind == "bilinear":
            wanted = [naive.bilinear(channel, u, v, wraps) for channel in CHANNELS]
            assert max(abs(a - b) for a, b in zip(shown, wanted, strict=True)) <= MIX_ERROR
        else:
            around = product((u - reach, u, u + reach), (v - reach, v, v + reach))
            assert shown in [
                [naive.nearest(channel, *place, wraps) for channel in CHANNELS] for place in around
            ]


@pytest.mark.parametrize("kind", ["nearest", "bilinear"])
def test_light_and_codes_are_the_same_picture_in_any_company(kind):
    texture = rj.Texture(CODES, filter=kind).with_transform((0.3, -1.25), 30.0, (2.0, 0.5))
    poster = naive.square(texture, naive.box((-3, 0), (5, 2)))
    poster.material = rj.Material("unlit", (0.25, 1.0, 0.5), base_color_texture=texture)
    camera = rj.PerspectiveCamera((0.4, 0.3, 2.0), (0.0, 0.0, 0.0), fov_y=60.0)
    lone = rj.render(poster, camera, size=SIZE, quality=IN_CODES).color
    scene = rj.Scene()
    scene.add(poster)
    scene.add(naive.square(texture, naive.box((0, 0), (1, 1))), rj.transforms.translate((1, 1, -1)))
    scene.nodes[1].mesh.material = rj.Material("phong", "red")
    scene.fog = rj.Fog("gray", density=0.0)
    outputs = "color", "linear", "object_id"
    beside = rj.render(scene, camera, size=SIZE, quality=IN_CODES, outputs=outputs)
    own = beside.object_id == 0
    assert own.sum() > 400
    assert (beside.object_id == 1).any()
    assert (beside.color[own] == lone[own]).all()
    assert (rj.render(poster, camera, size=SIZE).color != lone)[own].any()


def test_a_base_colour_multiplies_codes():
    white = rj.Texture(np.full((2, 2, 3), (255, 128, 3), np.uint8), filter="nearest")
    mesh = naive.square(white, naive.box((0, 0), (1, 1)))
    for factor in range(0, 256, 15):
        code = np.full((1, 1, 3), factor, np.uint8)
        light = rj.Texture(code, filter="nearest").image[0, 0, :3]
        mesh.material = rj.Material("unlit", tuple(light), base_color_texture=white)
        shown = rj.render(mesh, naive.FRONT, size=(4, 4), quality=IN_CODES).color[2, 2, :3]
        assert shown.tolist() == [round(factor * one / 255) for one in (255, 128, 3)]


@pytest.mark.parametrize("mode", ["mask", "blend"])
def test_what_is_not_opaque_takes_light(mode):
    leaf = np.random.default_rng(1).integers(0, 256, (9, 9, 4), np.uint8)
    mesh = naive.square(rj.Texture(leaf, filter="bilinear"), naive.box((0, 0), (1, 1)))
    mesh.material = rj.Material(
        "unlit", "white", alpha_mode=mode, base_color_texture=rj.Texture(leaf, filter="bilinear")
    )
    light, codes = (
        rj.render(mesh, naive.FRONT, size=SIZE, quality=quality).color
        for quality in (None, IN_CODES)
    )
    assert (light == codes).all()
    solid = leaf.copy()
    solid[..., 3] = 255
    mesh.material = rj.Material(
        "unlit", "white", alpha_mode=mode, base_color_texture=rj.Texture(solid, filter="bilinear")
    )
    light, codes = (
        rj.render(mesh, naive.FRONT, size=SIZE, quality=quality).color
        for quality in (None, IN_CODES)
    )
    assert (light != codes).any()


def test_large_pictures_are_read_as_the_codes_that_they_are(monkeypatch):
    monkeypatch.setattr(packed_scene, "encode_rows", None)
    monkeypatch.setattr(texture_module, "MAX_FLOAT_TEXELS", 16)
    for channels in (1, 2, 3, 4):
        codes = np.random.default_rng(channels).integers(0, 256, (9, 9, channels), np.uint8)
        codes[..., -1 if channels in (2, 4) else 0] = 255
        mesh = naive.square(rj.Texture(codes, filter="nearest"), naive.box((0, 0), (1, 1)))
        shown = rj.render(mesh, naive.FRONT, size=(9, 9), quality=IN_CODES).color
        wanted = rj.render(mesh, naive.FRONT, size=(9, 9)).color
        assert (shown == wanted).all()
