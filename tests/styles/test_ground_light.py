"""The light of the ground equals that of slow twins, bit for bit."""

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.pipeline import srgb_encoding
from rasterjit.scene.color import decoding_table
from rasterjit.styles import ground_light, shadow_catcher


@pytest.mark.parametrize(("shape", "radius"), [((1, 1), 2), ((3, 40), 5), ((50, 7), 10)])
def test_blurred_counts_are_sums_over_squares_of_sums_over_squares(shape, radius):
    counts = np.random.default_rng(radius).integers(0, 64, shape).astype(np.int32)
    wanted = counts.astype(np.int64)
    for _ in range(2):
        padded = np.pad(wanted, radius, mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * radius + 1,) * 2)
        wanted = windows.sum(axis=(2, 3))
    sums, scratch = np.empty_like(counts), np.empty_like(counts)
    ground_light.blur(counts, radius, sums, scratch, scratch[0].copy())
    assert np.array_equal(sums, wanted)


def test_a_part_is_blurred_as_the_whole():
    whole = np.zeros((shadow_catcher.MAP_SIDE, shadow_catcher.MAP_SIDE), np.int32)
    whole[3:9, 200:380] = np.random.default_rng(0).integers(0, 32, (6, 180))
    everywhere = whole.copy()
    everywhere[-1, 0] = 1
    parts = [shadow_catcher._blur(one, 5, np.float32(0.5)) for one in (whole, everywhere)]
    assert np.array_equal(parts[0][:300, 150:], parts[1][:300, 150:])
    assert parts[0][:30, 150:].any()
    assert not shadow_catcher._blur(np.zeros_like(whole), 5, np.float32(1.0)).any()


def shaded_slowly(placed, camera, palette, codes):
    """The twin: each pixel by itself, in plain Python and scalars of NumPy."""
    height, width = codes.shape
    shown = codes.copy()
    clip = camera.projection_matrix((width, height)) @ camera.view_matrix()
    origin = placed.frame.T @ (*placed.corner, placed.height)
    columns = [placed.frame[0] * placed.extent, placed.frame[1] * placed.extent]
    to_screen = np.stack([*(clip[:, :3] @ one for one in columns), clip @ (*origin, 1.0)], axis=1)
    to_map = np.linalg.inv(to_screen[[0, 1, 3]])
    for row in range(height):
        for column in range(width):
            x, y = 2.0 * (column + 0.5) / width - 1.0, 1.0 - 2.0 * (row + 0.5) / height
            u, v, w = to_map @ (x, y, 1.0)
            if w <= 0.0 or not (0.0 < u / w < 1.0 and 0.0 < v / w < 1.0):
                continue
            side = shadow_catcher.MAP_SIDE
            at = np.clip(np.array([v / w, u / w]) * side - 0.5, 0.0, side - 1.0)
            top, left = np.minimum(at.astype(int), side - 2)
            down, right = at - (top, left)
            near = placed.shade[top : top + 2, left : left + 2]
            missing = [1.0 - down, down] @ near @ [1.0 - right, right]
            light = palette[codes[row, column] & 255].copy()
            light[:3] *= 1.0 - missing
            code = np.empty((1, 1), np.uint32)
            srgb_encoding.encode_rows(
                light[None, None].astype(np.float32), srgb_encoding.make_encoding_table(), code
            )
            shown[row, column] = code[0, 0]
    return shown


@pytest.mark.parametrize("is_parallel", [False, True])
def test_pixels_lack_the_light_of_their_place_on_the_map(is_parallel):
    scene = rj.Scene()
    scene.add(rj.Mesh([[0, 0, 0], [2, 1, 0], [0, 2, 1]], [[0, 1, 2]]))
    placed = shadow_catcher.find_ground(scene, (0.5, 0.7, 0.5))
    placed = shadow_catcher.cast_shadow(placed, scene, (0.45, 0.5), 1)
    eye, target = (4.0, 3.0, 5.0), (0.5, 0.0, 0.0)
    camera = rj.PerspectiveCamera(eye, target)
    if is_parallel:
        camera = rj.OrthographicCamera(eye, target, height=6.0)
    palette = np.ones((256, 4), np.float32)
    palette[:, :3] = decoding_table()[:, None]
    greys = rj.styles.GREY_BACKGROUND.picture((40, 30)).image.view(np.uint32)[..., 0]
    found = shadow_catcher.darken_background(placed, camera, palette, greys)
    wanted = shaded_slowly(placed, camera, palette, greys)
    difference = np.abs(found.view(np.uint8).astype(int) - wanted.view(np.uint8))
    # The twin's matrix is another's inverse: a code may be one off.
    assert difference.max() <= 1
    assert (difference > 0).mean() < 0.01
    assert (found != greys).mean() > 0.05


def test_colours_are_the_same_after_a_way_through_light():
    """What lacks no light keeps its code, whether it is encoded anew or not."""
    palette = np.ones((1, 256, 4), np.float32)
    palette[..., :3] = decoding_table()[:, None]
    codes = np.empty((1, 256), np.uint32)
    srgb_encoding.encode_rows(palette, srgb_encoding.make_encoding_table(), codes)
    assert np.array_equal(codes[0] & 255, np.arange(256))
