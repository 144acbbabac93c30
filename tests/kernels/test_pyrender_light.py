"""Lights add up as in pyrender's shader, and codes are those of its gamma."""

from __future__ import annotations

import math

import blocks
import naive_pyrender
import numpy as np
import pytest

from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.fragments.drawing_order import drop_hidden
from rasterjit.pipeline.lighting import blinn_phong, light_stages, pyrender
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.jit import stage
from rasterjit.runtime.state_block import int64
from rasterjit.scene.reference_shader import DepthMap
from rasterjit.survey.light_culling import pack_light_view

VIEWER = np.array([0.0, 0.0, 0.0, 1.0], np.float32)
COUNT = 200


@stage
def part_in_two(block: Block, count, middle: int64):
    """Make two segments of a block, of objects 0 and 1."""
    for k in range(2):
        block.segments[k, rows.OWNER] = k
        block.segments[k, rows.START] = 0 if k == 0 else min(middle, count)
        block.segments[k, rows.STOP] = min(middle, count) if k == 0 else count
    block.counts[rows.SEGMENT_COUNT] = 2


def random_samples(rng):
    samples = np.zeros((rows.SAMPLE_ROWS, COUNT), np.float32)
    samples[rows.RED : rows.ALPHA] = rng.uniform(0, 1, (3, COUNT))
    normals = rng.normal(size=(3, COUNT))
    samples[rows.NORMAL_X : rows.NORMAL_Z + 1] = normals / np.linalg.norm(normals, axis=0)
    samples[rows.POINT_X : rows.POINT_Z + 1] = rng.normal(size=(3, COUNT)) + [[0], [0], [-5]]
    samples[rows.METALLIC] = rng.uniform(-0.2, 1.2, COUNT)
    samples[rows.ROUGHNESS] = rng.uniform(0.0, 1.1, COUNT)
    samples[rows.SHADOW] = samples[rows.OCCLUSION] = 1.0
    return samples


def some_lights():
    """Return a light from a direction, a lamp that takes light away, and a spot."""
    lights = np.zeros((3, blinn_phong.LIGHT_COLUMNS), np.float32)
    lights[:, blinn_phong.CONE_OFFSET] = 1.0
    lights[0, :7] = 0.6, 0.0, 0.8, 0.0, 3.0, 2.0, 1.0
    lights[1, :7] = 1.0, 2.0, -3.0, 1.0, -4.0, 20.0, 1e4
    lights[2, :7] = 0.0, 1.0, 0.0, 1.0, 30.0, 30.0, 10.0
    scale = 1.0 / (math.cos(0.2) - math.cos(0.6))
    lights[2, 7:12] = 0.0, 0.0, -1.0, scale, -math.cos(0.6) * scale
    return lights


def shaded(samples, lights, taken, ambient, middle=COUNT // 3):
    blocks.run(
        samples, (part_in_two, middle), (pyrender.write_ambient_on_base, ambient),
        (light_stages.normalize_normals,),
        (pyrender.add_lights_as_pyrender, lights, 0, len(lights), taken, VIEWER),
    )  # fmt: skip
    return samples[rows.OUT_RED : rows.OUT_BLUE + 1].T.astype(np.float64)


def test_light_is_that_of_the_slow_twin():
    samples, lights = random_samples(np.random.default_rng(5)), some_lights()
    ambient = np.array([0.3, 0.2, 0.1], np.float32)
    columns = samples.astype(np.float64).T
    have = shaded(samples, lights, np.ones((2, 3), np.uint8), ambient)
    for n, column in enumerate(columns):
        want = naive_pyrender.lit(
            column[rows.RED : rows.ALPHA], column[rows.METALLIC], column[rows.ROUGHNESS],
            column[rows.NORMAL_X : rows.NORMAL_Z + 1], column[rows.POINT_X : rows.POINT_Z + 1],
            lights.astype(np.float64), ambient.astype(np.float64),
        )  # fmt: skip
        # Where light is taken away, what is left is a difference.
        assert have[n] == pytest.approx(want, rel=2e-3, abs=2e-4)


def test_objects_take_their_own_lights():
    rng, lights = np.random.default_rng(6), some_lights()
    dark, middle = np.zeros(3, np.float32), 70
    samples = random_samples(rng)
    taken = np.array([[1, 0, 1], [0, 1, 0]], np.uint8)
    have = shaded(samples.copy(), lights, taken, dark, middle)
    first = shaded(samples.copy(), lights[[0, 2]], np.ones((2, 2), np.uint8), dark)
    second = shaded(samples.copy(), lights[[1]], np.ones((2, 1), np.uint8), dark)
    np.testing.assert_array_equal(have[:middle], first[:middle])
    np.testing.assert_array_equal(have[middle:], second[middle:])


def test_nothing_that_faces_away_is_black_and_both_sides_look_alike():
    samples = random_samples(np.random.default_rng(7))
    samples[rows.RED : rows.ALPHA] = 1.0
    light = some_lights()[:1]
    have = shaded(samples, light, np.ones((2, 1), np.uint8), np.zeros(3, np.float32))
    assert (have > 0.0).all()


@pytest.mark.parametrize("is_spot", [False, True])
def test_shadows_are_those_of_the_slow_twin(is_spot):
    rng = np.random.default_rng(11)
    samples, eye, size = random_samples(rng), np.array([1.0, -2.0, 3.0]), 16
    near, far = 0.5, 12.0
    clip = np.diag([0.2, 0.2, -2.0 / (far - near), 1.0])
    clip[2, 3] = -(far + near) / (far - near)
    if is_spot:
        clip = np.diag([1.2, 1.2, -(far + near) / (far - near), 0.0])
        clip[2, 3], clip[3, 2] = -2.0 * far * near / (far - near), -1.0
    world_from_eye = np.eye(4)
    world_from_eye[:3, 3] = eye
    # The light stands where the eye is, for depths to be easy to tell.
    clip_from_world = clip @ np.linalg.inv(world_from_eye)
    depths = rng.uniform(2.0, 8.0, (size, size)).astype(np.float32)
    depths[0, 0] = np.inf
    away = np.where(np.isfinite(depths), depths, 1.0).astype(np.float64)
    ndc = (clip[2, 3] - clip[2, 2] * away) / (clip[3, 3] - clip[3, 2] * away)
    window = np.where(np.isfinite(depths), ndc * 0.5 + 0.5, 1.0)
    light = some_lights()[0]
    view = pack_light_view(DepthMap(0, clip_from_world, clip, depths), eye.tolist())
    columns = samples.astype(np.float64).T
    blocks.run(samples, (pyrender.read_shadow_map, light, view, depths))
    toward, found = light[:3] / np.linalg.norm(light[:3]), []
    for n, column in enumerate(columns):
        normal = column[rows.NORMAL_X : rows.NORMAL_Z + 1]
        point = column[rows.POINT_X : rows.POINT_Z + 1] + eye
        want = naive_pyrender.shadow(point, normal @ toward, clip_from_world, window)
        assert 1.0 - samples[rows.SHADOW, n] == pytest.approx(want, abs=1e-3)
        found.append(want)
    assert min(found) < 0.1
    assert max(found) > 0.9
    assert ((np.array(found) > 0.2) & (np.array(found) < 0.8)).sum() > 10


@pytest.mark.parametrize("encoding", ["gamma 2.2", "as is"])
def test_codes_are_rounded_half_up(encoding):
    thresholds = srgb_encoding.find_code_thresholds(encoding).astype(np.float64)
    power = 2.2 if encoding == "gamma 2.2" else 1.0
    np.testing.assert_allclose(thresholds, ((np.arange(255) + 0.5) / 255.0) ** power, rtol=1e-6)
    rng = np.random.default_rng(8)
    light = np.concatenate([rng.random(3000), thresholds, [0.0, 1.0, 7.0, -1.0, np.nan]])
    light = np.float32(np.tile(light[:, None], (1, 4)))[None]
    codes = np.empty(light.shape[1:2], np.uint32)[None]
    srgb_encoding.encode_rows(light, srgb_encoding.make_encoding_table(encoding), codes)
    want = [srgb_encoding.encode_color(pixel, encoding) for pixel in light[0]]
    np.testing.assert_array_equal(codes[0], np.array(want, np.uint32))
    reds = [naive_pyrender.code(red) for red in light[0, :3000, 0].astype(float)]
    if encoding == "gamma 2.2":
        np.testing.assert_array_equal(codes[0, :3000] & 255, reds)


def test_a_face_behind_one_that_was_drawn_before_is_left_out():
    rng = np.random.default_rng(9)
    faces = np.full((2, 5, 4, 6), -1, np.int32)
    for sample, row, column in np.ndindex(2, 4, 6):
        count = rng.integers(0, 6)
        faces[sample, :count, row, column] = rng.permutation(9)[:count]
    have = faces.copy()
    drop_hidden(have)
    for sample, row, column in np.ndindex(2, 4, 6):
        # Draw in order, with a depth test.
        nearest, drawn = 99, []
        own = faces[sample, :, row, column].tolist()
        for face in sorted(face for face in own if face >= 0):
            if own.index(face) < nearest:
                nearest = own.index(face)
                drawn.append(face)
        want = drawn[::-1] + [-1] * (5 - len(drawn))
        assert have[sample, :, row, column].tolist() == want
