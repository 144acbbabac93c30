"""Textures that are moved, turned and scaled, and the taps along the footprint of a pixel."""

from __future__ import annotations

import math
from fractions import Fraction

import naive_textures as naive
import numpy as np
import pytest
from naive_textures import (
    DETAIL_ERROR,
    MIX_ROUNDINGS,
    NOISE,
    TRIANGLES,
    box,
    draw,
    draw_triangle,
    square,
)

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.surface import texture_filters as texturing
from rasterjit.scene.material import TEXTURE_FIELDS
from rasterjit.scene.texture import ANISOTROPIES, FILTERS, flip_v
from rasterjit.survey.packed_scene import join_textures

UV = np.array([(0.0, 0.25), (3.0, 0.5), (1.0, 4.0)])


def shown(uv, texture, name="near and far"):
    points, ws, repeats = TRIANGLES[name]
    return draw_triangle(points, ws, (np.array(uv) * repeats).tolist(), texture).linear


# Transforms


@pytest.mark.parametrize("kind", FILTERS)
@pytest.mark.parametrize("name", ["near and far", "cut by the near plane"])
def test_a_transform_is_a_change_of_the_coordinates(kind, name):
    # Powers of two and quarter turns are exact: every bit is the same, levels of detail included.
    texture = rj.Texture(NOISE, filter=kind, wrap=("mirror", "repeat"))
    for offset, rotation, scale, moved in (
        ((0, 0), 0, (2, 0.5), UV * (2, 0.5)),
        ((0.5, -3), 0, (1, 1), UV + (0.5, -3)),
        ((0, 0), 90, (1, 1), UV[:, ::-1] * (-1, 1)),
        ((0.25, 1), -90, (4, 8), (UV * (4, 8))[:, ::-1] * (1, -1) + (0.25, 1)),
        ((0, 0), 180, (1, 1), -UV),
        ((0, 0), 0, (-1, 0), UV * (-1, 0)),
    ):
        other = texture.with_transform(offset, rotation, scale)
        # The triangle's own repeats are another scale before this one.
        repeats = TRIANGLES[name][2]
        expected = shown((moved - offset) + np.divide(offset, repeats), texture, name)
        assert (shown(UV, other, name) == expected).all()


@pytest.mark.parametrize("kind", FILTERS)
def test_an_object_beside_a_moved_texture_keeps_its_bits(kind):
    texture = rj.Texture(NOISE, filter=kind)
    assert texture.with_transform().transform is None
    still, moved = (
        square(one, box((0, 0), (3, 3))) for one in (texture, texture.with_transform((0.5, 0)))
    )
    scene = rj.Scene()
    scene.add(still)
    scene.add(moved, rj.transforms.translate((0, 0, -1)))
    # The transform of the first is computed, and changes nothing.
    assert join_textures([still, moved]).transforms[0, 0].tolist() == [1, 0, 0, 0, 1, 0]
    frame = rj.render(scene, naive.FRONT, size=(9, 9), outputs="linear", threads=1)
    assert (frame.linear == draw(still, (9, 9))).all()
    assert (frame.linear != draw(moved, (9, 9))).any()


def test_any_angle_turns_the_coordinates_counter_clockwise():
    texture = rj.Texture(NOISE, filter="bilinear")
    for degrees in (30.0, -17.5, 400.0):
        angle = math.radians(degrees)
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        other = texture.with_transform((0.125, 0.75), degrees, (1.5, 0.75))
        expected = (UV * (1.5, 0.75)) @ turn.T + (0.125, 0.75)
        # uv are float32; a texel is 1/16 wide.
        assert np.abs(shown(UV, other) - shown(expected, texture)).max() < 1e-4


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.25, -0.5), (3.0, 0.125)])
@pytest.mark.parametrize("degrees", [0.0, 90.0, 22.5, -200.0])
@pytest.mark.parametrize("scale", [(1.0, 1.0), (1.5, -0.5)])
def test_transforms_of_gltf_are_turned_over(offset, degrees, scale):
    texture = rj.Texture([[0.5]]).with_transform(*flip_v(offset, degrees, scale))
    a, b, c, d, e, f = texture.transform or (1, 0, 0, 0, 1, 0)
    for u, down in ((0.0, 0.0), (1.0, 0.0), (0.25, 0.75), (-2.0, 1.5)):
        # As glTF's engines read it: counter-clockwise as seen, with v running down.
        x, y = scale[0] * u, scale[1] * down
        sine, cosine = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
        there = cosine * x + sine * y + offset[0], -sine * x + cosine * y + offset[1]
        up = 1.0 - down
        found = a * u + b * up + c, 1.0 - (d * u + e * up + f)
        assert found == pytest.approx(there, abs=1e-12)


# Anisotropy


@pytest.mark.parametrize("name", TRIANGLES)
@pytest.mark.parametrize("limit", ANISOTROPIES[1:])
def test_taps_along_a_footprint_equal_exact_ones(name, limit):
    points, ws, repeats = TRIANGLES[name]
    uv = (UV * (4, 1) * repeats).tolist()
    frame = draw_triangle(points, ws, uv, rj.Texture(NOISE, wrap="mirror", anisotropy=limit))
    levels = naive.mip_chain(naive.exact_image(NOISE[..., 0]))
    triangle = [tuple(Fraction(n, 256) for n in p) for p in oracle.snap_triangle(points)]
    if frame.stats.clipped:
        triangle = [tuple(map(Fraction, point)) for point in points]
    exact_ws, exact_uv = [Fraction(w) for w in ws], [tuple(map(Fraction, p)) for p in uv]
    planes = naive.planes_of(triangle, exact_ws, exact_uv)
    counts = []
    pixels = np.argwhere(frame.face_id >= 0)
    for row, column in pixels[:: max(1, len(pixels) // 25)].tolist():
        point = (column + naive.HALF, row + naive.HALF)
        footprint = point, planes, (16, 16)
        exact, count, margin = naive.anisotropic(levels, ("mirror", "mirror"), footprint, limit)
        if margin < 1e-9 and 1 < count < limit:
            continue
        counts.append(count)
        error = (count + 1) * MIX_ROUNDINGS + DETAIL_ERROR
        assert abs(frame.linear[row, column, 0] - float(exact)) <= error
    assert max(counts) > 1


def test_a_round_or_small_footprint_has_one_tap():
    for limit in ANISOTROPIES[1:]:
        plain, many = (rj.Texture(NOISE, anisotropy=n) for n in (1, limit))
        for uv in (box((0, 0), (8, 8)), box((0, 0), (0.5, 0.01)), box((0, 0), (0, 0))):
            frames = [draw(square(texture, uv), (16, 16)) for texture in (plain, many)]
            assert (frames[0] == frames[1]).all()


def test_a_constant_stays_itself_under_any_number_of_taps():
    texture = rj.Texture(np.full((16, 16), 0.3), anisotropy=16)
    for across in (2.0, 5.0, 13.0, 100.0):
        assert (draw(square(texture, box((0, 0), (across, 1))), (16, 16))[..., 0]
                == np.float32(0.3)).all()  # fmt: skip


def test_fine_stripes_stay_apart_along_the_short_step():
    # A pixel is as wide as a texel and 64 texels high: one tap sees the mean of the picture.
    stripes = np.zeros((64, 64))
    stripes[:, 32:] = 1.0
    uv = box((0, 0), (1, 64))
    contrast = {}
    for limit in (1, 4, 16):
        rows = draw(square(rj.Texture(stripes, anisotropy=limit), uv), (64, 64))[..., 0]
        contrast[limit] = rows.std(axis=1).mean()
    assert contrast[1] < 0.001
    assert contrast[4] > 0.3
    assert contrast[16] > contrast[4] + 0.05


@pytest.mark.needs_jit
def test_the_mean_light_of_a_floor_does_not_depend_on_the_taps():
    camera = rj.PerspectiveCamera(eye=(0, 1, 0), target=(0, 0.6, -2), fov_y=60.0, near=0.1)
    corners = [(-40, 0, -0.25), (40, 0, -0.25), (40, 0, -60), (-40, 0, -60)]
    means = []
    for limit in ANISOTROPIES:
        material = rj.Material(
            "unlit", "white", base_color_texture=rj.Texture(NOISE, anisotropy=limit)
        )
        mesh = rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], uv=np.array(corners)[:, ::2] / 4,
                       material=material)  # fmt: skip
        frame = rj.render(mesh, camera, size=(160, 120), outputs=("linear", "face_id"), threads=1)
        means.append(frame.linear[frame.face_id >= 0][:, 0].mean())
    assert np.ptp(means) < 0.01


@pytest.mark.parametrize("value", [0.0, 1e-300, 1.0, 1e300, math.inf, -math.inf, math.nan])
def test_any_steps_give_a_number_of_taps_within_the_limit(value):
    for other in (0.0, 1.0, 1e300, math.inf, math.nan):
        squared, taps, _ = texturing.make_anisotropic_footprint(
            value, other, (1.0, 0.0), (0.0, 1.0), 16
        )
        assert 1 <= taps <= 16
        assert 0.0 <= texturing.level_of_detail(squared) < 64.0


# Kinds


def test_an_object_has_a_texture_of_each_kind():
    shades = np.linspace(0.1, 0.9, texturing.KINDS).astype(np.float32)
    textures = {
        name: rj.Texture([[shade]]) for name, shade in zip(TEXTURE_FIELDS, shades, strict=True)
    }
    on = {"clearcoat": 1.0}
    quad = square(None, box((0, 0), (1, 1)))
    full = rj.Mesh(
        quad.vertices, quad.faces, uv=quad.uv, material=rj.Material("pbr", **textures, **on)
    )
    record = join_textures([quad, full, quad])
    for kind in range(texturing.TRANSMISSION):
        first = record.table[:, kind, texturing.FIRST_LEVEL]
        assert first[[0, 2]].tolist() == [-1, -1]
        assert record.texels[record.levels[first[1], texturing.FIRST_TEXEL], 0] == shades[kind]
    kinds = (
        texturing.BASE_COLOR, texturing.NORMAL, texturing.METALLIC_ROUGHNESS, texturing.OCCLUSION,
        texturing.EMISSIVE, texturing.CLEARCOAT, texturing.CLEARCOAT_ROUGHNESS,
        texturing.CLEARCOAT_NORMAL, texturing.SHEEN_COLOR, texturing.SHEEN_ROUGHNESS,
        texturing.SPECULAR_FACTOR, texturing.SPECULAR_COLOR, texturing.TRANSMISSION,
        texturing.THICKNESS,
    )  # fmt: skip
    assert kinds == tuple(range(texturing.KINDS))


def test_textures_that_share_a_picture_share_its_texels():
    picture = rj.Texture(NOISE, filter="nearest")
    moved = picture.with_transform((0.5, 0.0))
    assert np.shares_memory(picture.image, moved.image)
    meshes = [square(texture, box((0, 0), (1, 1))) for texture in (picture, moved, picture)]
    record = join_textures(meshes)
    assert len(record.texels) == NOISE.shape[0] * NOISE.shape[1]
    assert record.table[:, 0, texturing.FIRST_LEVEL].tolist() == [0, 0, 0]
    assert record.transforms[:, 0, 2].tolist() == [0.0, 0.5, 0.0]
    assert record.table[:, 0, texturing.ANISOTROPY].tolist() == [1, 1, 1]
