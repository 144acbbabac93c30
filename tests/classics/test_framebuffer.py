import itertools
import math

import imageio.v3 as iio
import naive_lines as naive
import numpy as np
import pytest

from rasterjit.classics.framebuffer import MAX_UNBINNED_PIXELS, Framebuffer
from rasterjit.inspect import oracle
from rasterjit.runtime.threads import Workers

RED, GREEN, BLUE = (255, 0, 0), (0, 255, 0), (0, 0, 255)
BLACK = [0, 0, 0, 255]


def lit(framebuffer):
    """Return the set of (x, y) that are not opaque black."""
    return {(int(x), int(y)) for y, x in np.argwhere((framebuffer.color != BLACK).any(axis=2))}


def test_new_framebuffer_is_opaque_black_and_infinitely_deep():
    framebuffer = Framebuffer(5, 3)
    assert (framebuffer.width, framebuffer.height) == (5, 3)
    assert framebuffer.color.shape == (3, 5, 4)
    assert framebuffer.color.dtype == np.uint8
    assert framebuffer.depth.shape == (3, 5)
    assert framebuffer.depth.dtype == np.float32
    assert (framebuffer.color == BLACK).all()
    assert np.isposinf(framebuffer.depth).all()


@pytest.mark.parametrize(
    "size", [(0, 4), (4, 0), (-1, 4), (16385, 4), (4, 2.5), ("a", 4), (4, math.nan)]
)
def test_bad_sizes_are_named(size):
    with pytest.raises(ValueError, match="width, height"):
        Framebuffer(*size)


def test_arrays_are_the_same_ones_all_the_time():
    framebuffer = Framebuffer(8, 8)
    color, depth = framebuffer.color, framebuffer.depth
    framebuffer.clear((1, 2, 3, 4), 7.0)
    framebuffer.fill_triangle((0, 0), (7, 0), (0, 7), RED, depth=(1, 1, 1))
    framebuffer.draw_line((0, 7), (7, 7), GREEN)
    assert framebuffer.color is color
    assert framebuffer.depth is depth
    assert color[0, 0].tolist() == [255, 0, 0, 255]
    assert color[7, 3].tolist() == [0, 255, 0, 255]
    assert color[6, 6].tolist() == [1, 2, 3, 4]
    assert (depth[0, 0], depth[6, 6]) == (1.0, 7.0)
    color[4, 4] = 9
    framebuffer.put_pixel(0, 0, BLUE)
    assert framebuffer.color[4, 4].tolist() == [9] * 4


def test_put_pixel_sets_one_pixel():
    framebuffer = Framebuffer(4, 3)
    framebuffer.put_pixel(3, 2, (1, 2, 3, 4))
    assert lit(framebuffer) == {(3, 2)}
    assert framebuffer.color[2, 3].tolist() == [1, 2, 3, 4]


@pytest.mark.parametrize(
    "pixel",
    [(4, 1), (0, 4), (4, 4), (-1, 0), (0, -1), (-1, -1), (-4, 0), (2**70, 0), (0, -(2**70))],
)
def test_pixel_outside_writes_nothing(pixel):
    framebuffer = Framebuffer(4, 4)
    framebuffer.put_pixel(*pixel, RED)
    assert not lit(framebuffer)


def test_no_primitive_writes_outside_its_array():
    # The framebuffer's arrays become the middle of larger ones, whose margins are watched
    framebuffer = Framebuffer(6, 5)
    guard = np.full(3 * 30, 0x55AA55AA, np.uint32)
    framebuffer._color = guard[30:60].view(np.uint8).reshape(5, 6, 4)
    framebuffer._pixels = guard[30:60].reshape(5, 6)
    places = [(x, y) for x in (-7, -1, 0, 5, 6, 13) for y in (-6, -1, 0, 4, 5, 11)]
    for start, end in itertools.product(places, places):
        framebuffer.draw_line(start, end, RED, BLUE)
        framebuffer.fill_triangle(start, end, (3, 2), RED, edges="inclusive")
        framebuffer.fill_triangle(start, end, (3, 2), RED, edges="inclusive", method="scanline")
        framebuffer.draw_bezier((start, (3, 9), end), GREEN)
    for place in places:
        framebuffer.put_pixel(*place, RED)
        for radius in range(12):
            framebuffer.draw_circle(place, radius, BLUE)
    assert (guard[:30] == 0x55AA55AA).all()
    assert (guard[60:] == 0x55AA55AA).all()
    assert (guard[30:60] != 0x55AA55AA).all()


def test_line_is_the_exact_one():
    framebuffer = Framebuffer(20, 20)
    framebuffer.draw_line((1, 2), (17, 9), (10, 20, 30, 40), (200, 100, 0, 255))
    pixels = oracle.line_pixels((1, 2), (17, 9))
    colors = oracle.line_colors((1, 2), (17, 9), (10, 20, 30, 40), (200, 100, 0, 255))
    for (x, y), color in zip(pixels, colors, strict=True):
        assert framebuffer.color[y, x].tolist() == list(color)
    assert len(lit(framebuffer)) == 17


def test_line_past_the_right_edge_stays_in_its_row():
    framebuffer = Framebuffer(4, 4)
    framebuffer.draw_line((0, 1), (4, 1), RED)
    assert lit(framebuffer) == {(x, 1) for x in range(4)}


def test_line_takes_end_points_up_to_32_bits():
    framebuffer = Framebuffer(4, 4)
    framebuffer.draw_line((-(2**31), -(2**31)), (2**31 - 1, 2**31 - 1), RED)
    assert lit(framebuffer) == {(k, k) for k in range(4)}
    with pytest.raises(ValueError, match="end"):
        framebuffer.draw_line((0, 0), (2**31, 0), RED)


def test_batch_is_the_lines_one_by_one():
    rng = np.random.default_rng(1)
    ends = rng.integers(-10, 40, (50, 4))
    both = rng.integers(0, 256, (50, 2, 4))
    for colors in (both, both[:, 0], both[0, 0], both[:, :, :3]):
        batch, single = Framebuffer(30, 25), Framebuffer(30, 25)
        batch.draw_lines(ends, colors)
        each = np.broadcast_to(
            colors[:, None] if colors.ndim == 2 else colors, (50, 2, colors.shape[-1])
        )
        for (x0, y0, x1, y1), (first, last) in zip(ends.tolist(), each, strict=True):
            single.draw_line((x0, y0), (x1, y1), first, last)
        np.testing.assert_array_equal(batch.color, single.color)


def crowd(rng, count):
    """Return lines of all kinds and their colours: short, long, far away, points."""
    ends = rng.integers(-20, 90, (count, 4))
    ends[::5, 2:] = ends[::5, :2] + rng.integers(-3, 4, (len(ends[::5]), 2))
    ends[::7] = np.clip(ends[::7] * 2**25, -(2**31), 2**31 - 1)
    ends[::11, 2:] = ends[::11, :2]
    return ends, rng.integers(0, 256, (count, 2, 4)).astype(np.uint8)


@pytest.mark.parametrize("threads", [1, 3, None])
@pytest.mark.parametrize("rows", [1, 6, 16])
@pytest.mark.parametrize("per_task", [7, 1000])
def test_bands_threads_and_batches_change_no_bit(monkeypatch, threads, rows, per_task):
    ends, colors = crowd(np.random.default_rng(2), 200)
    few = Framebuffer(70, 60)
    few.draw_lines(ends, colors)
    monkeypatch.setattr("rasterjit.classics.framebuffer.MAX_UNBINNED_PIXELS", 0)
    monkeypatch.setattr("rasterjit.classics.framebuffer.MIN_BAND_ROWS", rows)
    monkeypatch.setattr("rasterjit.classics.framebuffer.MAX_BAND_BYTES", 70 * 4 * rows)
    monkeypatch.setattr("rasterjit.classics.framebuffer.LINES_PER_TASK", per_task)
    monkeypatch.setattr("rasterjit.classics.framebuffer.RECORDS_PER_BATCH", 60 * 5)
    many = Framebuffer(70, 60, threads=threads)
    many.draw_lines(ends, colors)
    np.testing.assert_array_equal(many.color, few.color)
    assert many.color.any()


def test_many_lines_are_the_lines_one_by_one():
    count = MAX_UNBINNED_PIXELS // 20
    ends, colors = crowd(np.random.default_rng(3), count)
    batch, single = Framebuffer(70, 60, threads=2), Framebuffer(70, 60)
    batch.draw_lines(ends, colors)
    for (x0, y0, x1, y1), (first, last) in zip(ends.tolist(), colors, strict=True):
        single.draw_line((x0, y0), (x1, y1), first, last)
    np.testing.assert_array_equal(batch.color, single.color)


def test_few_lines_wake_no_thread(monkeypatch):
    calls = []
    monkeypatch.setattr(Workers, "run", lambda *arguments: calls.append(arguments))
    ends, colors = crowd(np.random.default_rng(4), MAX_UNBINNED_PIXELS // 70)
    framebuffer = Framebuffer(70, 60, threads=2)
    framebuffer.draw_lines(ends, colors)
    assert framebuffer.color[..., :3].any()
    assert not calls


@pytest.mark.parametrize("threads", [0, 1.5, "2", True, 1025])
def test_bad_number_of_threads_is_named(threads):
    with pytest.raises(ValueError, match="threads"):
        Framebuffer(4, 4, threads=threads)


def test_lines_colored_by_the_picture_itself_take_its_colors_from_before():
    own = Framebuffer(8, 1)
    own.color[:] = np.arange(32).reshape(1, 8, 4)
    before = own.color.copy()
    ends = [(7 - k, 0, 7 - k, 0) for k in range(8)]
    own.draw_lines(ends, own.color[0])
    np.testing.assert_array_equal(own.color, before[:, ::-1])


def test_arrays_of_whole_numbers_are_checked_like_any_other():
    framebuffer = Framebuffer(4, 4)
    for wrong in ([(0, 0, 2**31, 0)], [(0, 0, 1, -(2**31) - 1)], [(0, 0, 1)]):
        with pytest.raises(ValueError, match="ends"):
            framebuffer.draw_lines(np.array(wrong, np.int64), RED)
    with pytest.raises(ValueError, match="ends"):
        framebuffer.draw_lines(np.array([(0, 0, 1, 2**63)], np.uint64), RED)
    frozen = np.array([(0, 0, 3, 0)], np.int64)
    frozen.flags.writeable = False
    framebuffer.draw_lines(frozen, RED)
    assert lit(framebuffer) == {(x, 0) for x in range(4)}


def test_triangle_outline_is_three_lines():
    outline, three = Framebuffer(20, 20), Framebuffer(20, 20)
    a, b, c = (2, 1), (18, 6), (7, 17)
    outline.draw_triangle(a, b, c, (RED, GREEN, BLUE))
    three.draw_line(a, b, RED, GREEN)
    three.draw_line(b, c, GREEN, BLUE)
    three.draw_line(c, a, BLUE, RED)
    np.testing.assert_array_equal(outline.color, three.color)


@pytest.mark.parametrize("method", ["barycentric", "scanline"])
@pytest.mark.parametrize("edges", ["top-left", "inclusive"])
def test_filled_triangle_is_the_exact_one(method, edges):
    framebuffer = Framebuffer(16, 16)
    vertices = [(1, 1), (13, 3), (5, 14)]
    colors = [(255, 0, 0, 255), (0, 255, 0, 128), (0, 0, 255, 3)]
    framebuffer.fill_triangle(*vertices, colors, edges=edges, method=method)
    expected = naive.triangle_pixels(vertices, colors, (16, 16), edges)
    assert lit(framebuffer) == set(expected)
    for (x, y), color in expected.items():
        assert framebuffer.color[y, x].tolist() == list(color)
    assert np.isinf(framebuffer.depth).all()


def test_top_left_is_the_default_rule():
    named, plain = Framebuffer(9, 9), Framebuffer(9, 9)
    named.fill_triangle((0, 0), (8, 0), (0, 8), RED, edges="top-left", method="barycentric")
    plain.fill_triangle((0, 0), (8, 0), (0, 8), RED)
    np.testing.assert_array_equal(named.color, plain.color)
    assert len(lit(plain)) == 36


def test_depth_tested_triangles_hide_one_another():
    framebuffer = Framebuffer(9, 9)
    framebuffer.fill_triangle((0, 0), (9, 0), (0, 9), RED, depth=(1, 1, 1))
    framebuffer.fill_triangle((0, 0), (9, 0), (0, 9), BLUE, depth=(2, 2, 2))
    assert framebuffer.color[2, 2].tolist() == [255, 0, 0, 255]
    framebuffer.fill_triangle((0, 0), (9, 0), (0, 9), GREEN, depth=(0.5, 0.5, 0.5))
    assert framebuffer.color[2, 2].tolist() == [0, 255, 0, 255]
    assert framebuffer.depth[2, 2] == 0.5


def test_circle_and_curve_are_drawn():
    framebuffer = Framebuffer(21, 21)
    framebuffer.draw_circle((10, 10), 7, RED)
    assert lit(framebuffer) == naive.circle_pixels((10, 10), 7)
    assert framebuffer.color[3, 10].tolist() == [255, 0, 0, 255]
    framebuffer.clear()
    framebuffer.draw_bezier([(1, 19), (10, 1), (19, 19)], RED, BLUE)
    assert framebuffer.color[19, 1].tolist() == [255, 0, 0, 255]
    assert framebuffer.color[19, 19].tolist() == [0, 0, 255, 255]
    assert (10, 10) in lit(framebuffer)


BAD_COLORS = [(1, 2), (1, 2, 3, 4, 5), (0, 0, 256), (-1, 0, 0), (0.5, 0, 0), "red", 7, None]
BAD_COLORS += [(math.nan, 0, 0), ((0, 0, 0), (1, 1, 1))]


@pytest.mark.parametrize("color", BAD_COLORS)
def test_bad_colors_are_named(color):
    framebuffer = Framebuffer(4, 4)
    calls = [
        lambda: framebuffer.clear(color),
        lambda: framebuffer.put_pixel(0, 0, color),
        lambda: framebuffer.put_pixel(9, 9, color),
        lambda: framebuffer.draw_line((0, 0), (1, 1), color),
        lambda: framebuffer.draw_triangle((0, 0), (1, 1), (0, 1), color),
        lambda: framebuffer.fill_triangle((0, 0), (1, 1), (0, 1), color),
        lambda: framebuffer.draw_circle((0, 0), 1, color),
        lambda: framebuffer.draw_bezier([(0, 0), (1, 1), (2, 2)], color),
        lambda: framebuffer.draw_lines([(0, 0, 1, 1)], color),
    ]
    for call in calls:
        with pytest.raises(ValueError, match="color"):
            call()
    if color is not None:
        with pytest.raises(ValueError, match="end_color"):
            framebuffer.draw_line((0, 0), (1, 1), RED, color)
    assert not lit(framebuffer)


TRIANGLE = ((0, 0), (1, 1), (0, 1), RED)


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("x", lambda f: f.put_pixel(0.5, 0, RED)),
        ("y", lambda f: f.put_pixel(0, "1", RED)),
        ("x", lambda f: f.put_pixel(math.inf, 0, RED)),
        ("depth", lambda f: f.clear(depth=math.nan)),
        ("depth", lambda f: f.clear(depth="far")),
        ("start", lambda f: f.draw_line((0, 0, 0), (1, 1), RED)),
        ("end", lambda f: f.draw_line((0, 0), (0.5, 1), RED)),
        ("ends", lambda f: f.draw_lines([(0, 0, 1)], RED)),
        ("ends", lambda f: f.draw_lines([(0, 0, 1, -(2**31) - 1)], RED)),
        ("colors", lambda f: f.draw_lines([(0, 0, 1, 1)], np.zeros((2, 2, 4)))),
        ("b", lambda f: f.draw_triangle((0, 0), (1, math.nan), (0, 1), RED)),
        ("c", lambda f: f.fill_triangle((0, 0), (1, 1), (0, 2**20 + 1), RED)),
        ("edges", lambda f: f.fill_triangle(*TRIANGLE, edges="left")),
        ("method", lambda f: f.fill_triangle(*TRIANGLE, method="magic")),
        ("depth", lambda f: f.fill_triangle(*TRIANGLE, depth=(1, 2))),
        ("depth", lambda f: f.fill_triangle(*TRIANGLE, depth=(1, 2, math.nan))),
        ("depth", lambda f: f.fill_triangle(*TRIANGLE, depth=(1, 2, 1e39))),
        ("center", lambda f: f.draw_circle((0.5, 0), 1, RED)),
        ("radius", lambda f: f.draw_circle((0, 0), -1, RED)),
        ("radius", lambda f: f.draw_circle((0, 0), 1.5, RED)),
        ("points", lambda f: f.draw_bezier([(0, 0), (1, 1)], RED)),
        ("points", lambda f: f.draw_bezier([(0, 0), (1, 1), (2, 2**20 + 1)], RED)),
        ("points", lambda f: f.draw_bezier([(0, 0), (1, 1), (2,)], RED)),
    ],
)
def test_bad_arguments_are_named(name, call):
    framebuffer = Framebuffer(4, 4)
    with pytest.raises(ValueError, match=rf"^{name}\b"):
        call(framebuffer)
    assert not lit(framebuffer)


def test_saved_picture_is_the_array(tmp_path):
    framebuffer = Framebuffer(16, 12)
    framebuffer.fill_triangle((0, 0), (15, 2), (3, 11), (RED, GREEN, (*BLUE, 100)))
    framebuffer.save(tmp_path / "picture.png")
    np.testing.assert_array_equal(iio.imread(tmp_path / "picture.png"), framebuffer.color)


def test_saving_into_a_missing_folder_is_a_clear_error(tmp_path):
    with pytest.raises(ValueError, match="missing"):
        Framebuffer(2, 2).save(tmp_path / "missing" / "picture.png")
