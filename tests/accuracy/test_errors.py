import math

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.accuracy import results as errors_module
from rasterjit.accuracy.results import (
    PICTURE_OUTPUTS,
    list_compared_buffers,
    make_reference,
    measure_errors,
)
from rasterjit.rendering import quality_selection as measures

SIZE = (40, 30)
TEXELS = (16, 8)


def scene(texture_scale=(1.0, 1.0), wireframe=False):
    made = rj.Scene()
    texture = rj.Texture(np.full((TEXELS[1], TEXELS[0], 3), 0.5), scale=texture_scale)
    corners = np.array([(-1.0, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    faces = [(0, 1, 2), (0, 2, 3)]
    plain = rj.Material(shading="unlit", base_color=(0.25, 0.5, 0.75))
    made.add(rj.Mesh(corners, faces, material=plain), rj.transforms.translate((0, 0, -1)))
    laid = rj.Material(shading="unlit", base_color_texture=texture)
    uv = 0.5 + 0.5 * corners[:, :2]
    made.add(rj.Mesh(0.5 * corners, faces, uv=uv, material=laid))
    made.wireframe = rj.Wireframe() if wireframe else None
    return made


CAMERA = rj.PerspectiveCamera((0, 0, 3), (0, 0, 0))


def draw(made, camera=CAMERA, **quality):
    return rj.render(
        made, camera, size=SIZE, quality=rj.Quality(**quality), threads=1,
        outputs=(*PICTURE_OUTPUTS, *list_compared_buffers(made)),
    )  # fmt: skip


@pytest.fixture(scope="module")
def frame():
    return draw(scene())


def changed(frame, **arrays):
    return rj.Frame({**frame.arrays(), **arrays}, frame.plan, frame.stats)


def reference(frame, made=None):
    return make_reference(made or scene(), frame, frame)


def test_the_errors_of_a_picture_against_itself_are_zero(frame):
    errors, error_map = measure_errors(frame, reference(frame))
    assert errors[:2] == (0.0, 0.0)
    assert errors.psnr == math.inf
    assert errors.flip in (None, 0.0)
    assert errors[4:] == (0, 0.0, 0.0, 0.0)
    assert error_map.shape == SIZE[::-1]
    assert not error_map.any()


def test_colour_errors_are_those_of_a_plain_loop(frame):
    rng = np.random.default_rng(5)
    light = rng.random((*SIZE[::-1], 4), np.float32) * np.float32(3.0)
    errors, error_map = measure_errors(changed(frame, linear=light), reference(frame))
    total, largest = 0.0, 0.0
    for y in range(SIZE[1]):
        for x in range(SIZE[0]):
            here = 0.0
            for channel in range(3):
                difference = float(light[y, x, channel]) - float(frame.linear[y, x, channel])
                total += difference**2
                here = max(here, abs(difference))
            assert error_map[y, x] == np.float32(here)
            largest = max(largest, here)
    assert errors.rmse == pytest.approx(math.sqrt(total / (SIZE[0] * SIZE[1] * 3)), rel=1e-12)
    assert errors.largest == largest
    assert errors.psnr == pytest.approx(10.0 * math.log10(1.0 / errors.rmse**2), rel=1e-12)


def test_alpha_is_no_light(frame):
    light = frame.linear.copy()
    light[:, :, 3] = 0.0
    assert measure_errors(changed(frame, linear=light), reference(frame))[0].rmse == 0.0


def test_every_pixel_that_shows_another_face_is_counted(frame):
    faces = frame.face_id.copy()
    faces[15, 20], faces[10, 15:18] = -1, 17
    errors, _ = measure_errors(changed(frame, face_id=faces), reference(frame))
    assert errors.wrong_faces == 4


def test_depth_counts_in_units_in_the_last_place_where_the_face_is_the_same(frame):
    depth, faces = frame.depth.copy(), frame.face_id.copy()
    for _ in range(5):
        depth[15, 20] = np.nextafter(depth[15, 20], np.float32(np.inf))
    depth[0, 0], faces[0, 0] = 99.0, 17
    errors, _ = measure_errors(changed(frame, depth=depth, face_id=faces), reference(frame))
    assert errors.depth_ulp == 5.0
    assert errors.depth_units == float(depth[15, 20]) - float(frame.depth[15, 20])


@pytest.mark.parametrize("scale", [(1.0, 1.0), (3.0, -2.0)])
def test_texture_coordinates_count_in_texels_of_the_texture(scale):
    made = scene(scale)
    frame = draw(made)
    uv = frame.uv.copy()
    uv[15, 20] += (0.01, -0.03)
    errors, _ = measure_errors(changed(frame, uv=uv), reference(frame, made))
    expected = max(0.01 * TEXELS[0] * scale[0], 0.03 * TEXELS[1] * abs(scale[1]))
    assert errors.uv_texels == pytest.approx(expected, rel=1e-5)


def test_what_nothing_shows_has_no_error(frame):
    empty = {
        "face_id": np.full_like(frame.face_id, -1),
        "depth": np.full_like(frame.depth, np.inf),
        "uv": np.full_like(frame.uv, np.nan),
    }
    errors, _ = measure_errors(changed(frame, **empty), reference(frame))
    assert errors[5:] == (None, None, None)
    assert errors.wrong_faces == np.count_nonzero(frame.face_id >= 0)


def test_a_scene_without_texture_coordinates_has_no_error_of_them():
    made = scene()
    del made.nodes[1]
    frame = draw(made)
    assert list_compared_buffers(made) == ("depth", "face_id")
    assert measure_errors(frame, reference(frame, made))[0].uv_texels is None


def test_lines_over_the_colour_are_light_that_is_seen():
    made = scene(wireframe=True)
    frame, bare = draw(made), draw(scene())
    errors, _ = measure_errors(frame, reference(bare, made))
    light = measures.light_of(frame)
    assert (light[(frame.color[:, :, :3] == 0).all(axis=2)] == 0.0).all()
    assert errors.rmse > 0.1
    assert np.array_equal(frame.linear, bare.linear)


def test_outlines_over_the_colour_are_light_that_is_seen():
    made = scene()
    made.outline = rj.Outline("black")
    frame, bare = draw(made), draw(scene())
    is_line = (frame.color[:, :, :3] == 0).all(axis=2)
    assert is_line.any()
    assert (measures.light_of(frame)[is_line] == 0.0).all()
    assert measure_errors(frame, reference(bare, made))[0].rmse > 0.1
    assert np.array_equal(frame.linear, bare.linear)


def test_a_vignette_takes_no_light_for_any_quality_has_it_alike():
    made = scene()
    made.vignette = rj.Vignette(1.0, 0.0)
    frame, bare = draw(made), draw(scene())
    assert not np.array_equal(frame.color, bare.color)
    assert np.array_equal(measures.light_of(frame), measures.light_of(bare))


def test_more_samples_are_nearer_to_more_samples():
    made = scene()
    turned = rj.PerspectiveCamera((0.1, 0.2, 3), (0, 0, 0), (0.3, 1.0, 0.0))
    best = reference(draw(made, turned, samples=16), made)
    found = [
        measure_errors(draw(made, turned, samples=count), best)[0] for count in (1, 2, 4, 8, 16)
    ]
    rmse = [errors.rmse for errors in found]
    assert rmse == sorted(rmse, reverse=True)
    assert rmse[-1] == 0.0 < rmse[-2]
    assert {errors.wrong_faces for errors in found} == {0}


def test_flip_is_zero_for_the_same_and_grows_with_the_difference():
    pytest.importorskip("flip_evaluator")
    rng = np.random.default_rng(3)
    picture = rng.integers(60, 200, (24, 32, 4), dtype=np.uint8)
    found = [
        errors_module.measure_flip(picture, (picture + np.uint8(step)).astype(np.uint8))
        for step in (0, 5, 20, 50)
    ]
    assert found[0] == 0.0
    assert found == sorted(found)
    assert 0.0 < found[1] < found[-1] <= 1.0


def test_without_flip_there_is_none(monkeypatch):
    monkeypatch.setattr(errors_module, "has_flip", lambda: False)
    picture = np.zeros((4, 4, 3), np.uint8)
    assert errors_module.measure_flip(picture, picture) is None
