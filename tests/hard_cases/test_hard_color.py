"""Colours are exact codes, light is linear, and layers mix in linear light."""

from __future__ import annotations

import math
from fractions import Fraction

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline import srgb_encoding as resolve
from rasterjit.scene.color import linear_to_srgb, srgb_to_linear

CODES = np.arange(256, dtype=np.uint8)
HALF = Fraction(1, 2)
FLAT_VIEW = rj.MatrixCamera(np.eye(4), np.eye(4))
"""World coordinates are normalized device coordinates."""

PRINTED = 5e-5
"""Half a unit of the last of four decimals."""


def unlit(points, faces, size, colors):
    """Return a mesh of screen points that shows its colours as they are."""
    points = np.array(points, float)
    vertices = np.zeros((len(points), 3))
    vertices[:, :2] = (2 * points / size - 1) * [1, -1]
    return rj.Mesh(vertices, faces, colors=colors, material=rj.Material("unlit", "white"))


def strip(count):
    """Return (points, faces) of one triangle a pixel: the first edge runs through its centre."""
    points, faces = [], []
    for i in range(count):
        points += [(i, 0.5), (i + 1, 0.5), (i + 0.5, 1)]
        faces.append((3 * i, 3 * i + 1, 3 * i + 2))
    return points, faces


def show(mesh, size, outputs=("linear", "color"), **options):
    return rj.render(mesh, FLAT_VIEW, size=size, outputs=outputs, threads=1, **options)


def background_codes(value):
    """Return the RGBA codes of a grey linear value that is a background, alpha the same."""
    mesh = rj.Mesh([[5, 5, 0], [6, 5, 0], [5, 6, 0]], [[0, 1, 2]])  # beside the image
    value = float(np.float32(value))
    return show(mesh, (1, 1), "color", background=(value,) * 4).color[0, 0].tolist()


def encode(values):
    """Return (sRGB codes, alpha codes) of linear values that no public path lets through."""
    values = np.asarray(values, np.float32)
    linear = np.repeat(values[np.newaxis, :, np.newaxis], 4, axis=2)
    color = np.zeros((1, len(values)), np.uint32)
    resolve.encode_rows(linear, resolve.make_encoding_table(), color)
    rgba = color.view(np.uint8).reshape(-1, 4)
    return rgba[:, 0].tolist(), rgba[:, 3].tolist()


def neighbours(value):
    """Return the float32 nearest to a value, with the ones below and above."""
    near = np.float32(value)
    return [np.nextafter(near, np.float32(-1)), near, np.nextafter(near, np.float32(2))]


# --- storing --------------------------------------------------------------------------------------


@pytest.mark.case("K01")
def test_every_code_is_stored_exactly():
    assert background_codes(0.0) == [0, 0, 0, 0]
    assert background_codes(1.0) == [255, 255, 255, 255]
    for code in range(256):
        assert background_codes(code / 255)[3] == code  # alpha is linear
    assert encode(CODES / 255)[1] == list(range(256))


@pytest.mark.case("K01")
def test_a_pixel_that_was_put_reads_back():
    framebuffer = rj.Framebuffer(256, 1)
    for code in range(256):
        framebuffer.put_pixel(code, 0, (code, 255 - code, 0, code))
    want = [[code, 255 - code, 0, code] for code in range(256)]
    assert framebuffer.color[0].tolist() == want


HALVES = [(0.5, 1), (1.5, 2), (2.5, 3), (126.5, 127), (127.5, 128), (254.5, 255)]


@pytest.mark.case("K02")
@pytest.mark.parametrize(("half", "code"), HALVES)
def test_half_a_code_is_rounded_up_along_a_line(half, code):
    low = math.floor(half)
    framebuffer = rj.Framebuffer(3, 1)
    framebuffer.draw_line((0, 0), (2, 0), (low,) * 3, end_color=(low + 1,) * 3)
    assert framebuffer.color[0, :, 0].tolist() == [low, code, low + 1]
    assert framebuffer.color[0, 1].tolist() == [code] * 3 + [255]
    mixed = oracle.line_colors((0, 0), (2, 0), (low,), (low + 1,))
    assert mixed == [(low,), (code,), (low + 1,)]


@pytest.mark.case("K02")
@pytest.mark.parametrize("method", ["barycentric", "scanline"])
@pytest.mark.parametrize(("half", "code"), HALVES)
def test_half_a_code_is_rounded_up_in_a_triangle(half, code, method):
    low = math.floor(half)
    framebuffer = rj.Framebuffer(3, 3)
    colors = ((low,) * 3, (low + 1,) * 3, (low,) * 3)
    framebuffer.fill_triangle((0, 0), (2, 0), (0, 2), colors, edges="inclusive", method=method)
    assert framebuffer.color[0, 1].tolist() == [code] * 3 + [255]


@pytest.mark.case("K02")
@pytest.mark.parametrize(("half", "code"), HALVES)
def test_half_a_code_is_rounded_up_in_a_frame(half, code):
    # Only 127.5 / 255 is a float: the others are told apart by the exact product.
    for value in neighbours(half / 255):
        reaches = Fraction(float(value)) * 255 >= Fraction(half)
        assert background_codes(value)[3] == (code if reaches else code - 1)
    assert Fraction(float(np.float32(127.5 / 255))) * 255 == Fraction(127.5)


@pytest.mark.case("K02", "P03")
@pytest.mark.parametrize(("half", "code"), HALVES)
def test_numpy_and_the_kernel_round_alike(cube, camera, half, code):
    # The wireframe's colour is encoded by NumPy, the background's by the kernel.
    for value in neighbours(naive.srgb_decode(half / 255)):
        grey = (float(value),) * 3
        scene = rj.Scene()
        scene.add(cube)
        scene.wireframe = rj.Wireframe(grey, "only")
        frame = rj.render(scene, camera, size=(8, 8), background="transparent", threads=1)
        drawn = frame.color[frame.color[..., 3] == 255]
        assert len(drawn)
        assert (drawn[:, :3] == background_codes(value)[0]).all()
        assert drawn[0, 0] in (code - 1, code)


@pytest.mark.case("K03")
def test_a_value_just_below_a_half_is_not_lifted():
    trap = np.float32(0.49999997)
    assert np.floor(trap + np.float32(0.5)) == 1  # what the naive rounding gives
    value = trap / np.float32(255)
    assert Fraction(float(value)) * 255 < HALF
    assert background_codes(value)[3] == 0
    assert encode([value])[1] == [0]
    assert oracle.round_half_up(0.49999999999999994) == 0


@pytest.mark.case("K03")
@pytest.mark.parametrize("code", [1, 2, 10, 11, 128, 255])
def test_one_ulp_decides_between_two_codes(code):
    below, near, above = neighbours(naive.srgb_decode((code - 0.5) / 255))
    assert background_codes(below)[0] == code - 1
    assert background_codes(above)[0] == code
    assert background_codes(near)[0] == naive.srgb_code(float(near))


@pytest.mark.case("K04")
def test_stored_values_are_held_in_range_and_nan_is_black():
    largest, tiny = np.finfo(np.float32).max, np.finfo(np.float32).smallest_subnormal
    values = [1.5, -0.2, np.nan, np.inf, -np.inf, largest, -largest, -0.0, tiny, 256.0, -1.0]
    want = [255, 0, 0, 255, 0, 255, 0, 0, 0, 255, 0]
    assert encode(values) == (want, want)
    # The codes 256, 300 and -1, which a cast would wrap to 0, 44 and 255.
    assert encode([256 / 255, 300 / 255, -1 / 255]) == ([255, 255, 0], [255, 255, 0])
    assert linear_to_srgb([1.5, -0.2, np.nan, np.inf, -1.0, 2.0]).tolist() == [1, 0, 0, 1, 0, 1]


@pytest.mark.case("K04")
@pytest.mark.parametrize("value", [256, 300, -1, 1.5, math.nan, math.inf])
def test_a_framebuffer_refuses_what_is_no_code(value):
    framebuffer = rj.Framebuffer(1, 1)
    with pytest.raises(ValueError, match=r"color must be 3 or 4 whole numbers in 0\.\.255"):
        framebuffer.put_pixel(0, 0, (value, 0, 0))
    assert framebuffer.color[0, 0].tolist() == [0, 0, 0, 255]


def facing_white(lights):
    """Return the frame of a white matt square under lights that shine straight at it."""
    square = rj.Mesh(
        [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]],
        material=rj.Material("flat", "white", specular=0.0),
    )  # fmt: skip
    scene = rj.Scene()
    scene.add(square)
    scene.lights = [rj.DirectionalLight((0, 0, -1), intensity=i) for i in lights]
    camera = rj.OrthographicCamera((0, 0, 1), (0, 0, 0))
    return rj.render(scene, camera, size=(2, 2), outputs=("linear", "color"), threads=1)


@pytest.mark.case("K04")
@pytest.mark.parametrize(("intensity", "code"), [(0.0, 0), (1.0, 255), (1.5, 255), (1e9, 255)])
def test_light_above_white_is_white(intensity, code):
    assert facing_white([intensity]).color[0, 0].tolist() == [code, code, code, 255]


# --- the sRGB curve -------------------------------------------------------------------------------


@pytest.mark.case("K05")
@pytest.mark.parametrize(
    ("code", "linear"),
    [
        (0, 0.0), (1, 3.03526983549e-4), (10, 0.00303526983549), (11, 0.0033465357639),
        (64, 0.051269458374), (128, 0.215860500114), (188, 0.502886458033), (255, 1.0),
    ],
)  # fmt: skip
def test_codes_decode_to_the_values_of_the_standard(code, linear):
    assert srgb_to_linear(np.array([code], np.uint8))[0] == np.float32(linear)
    points, faces = strip(1)
    mesh = unlit(points, faces, (1, 1), np.full((3, 3), code, np.uint8))
    frame = show(mesh, (1, 1), background=f"#{code:02x}{code:02x}{code:02x}")
    assert frame.linear[0, 0].tolist() == [np.float32(linear)] * 3 + [1.0]
    beside = rj.Mesh(mesh.vertices + [9, 0, 0], mesh.faces)
    frame = show(beside, (1, 1), background=f"#{code:02x}{code:02x}{code:02x}")
    assert frame.linear[0, 0].tolist() == [np.float32(linear)] * 3 + [1.0]


@pytest.mark.case("K06")
@pytest.mark.parametrize(
    ("linear", "encoded", "code"),
    [
        (0.0031308, 10.3147, 10), (0.18, 117.6458, 118), (0.2, 123.5549, 124),
        (0.5, 187.5160, 188), (0.25, 136.9602, 137),
    ],
)  # fmt: skip
def test_linear_light_encodes_to_the_values_of_the_standard(linear, encoded, code):
    assert abs(255 * linear_to_srgb(linear) - encoded) <= PRINTED
    assert abs(255 * naive.srgb_encode(linear) - encoded) <= PRINTED
    assert background_codes(linear)[:3] == [code] * 3


@pytest.mark.case("K01", "K07")
def test_every_code_survives_a_render():
    points, faces = strip(256)
    colors = np.stack([CODES, CODES[::-1], np.roll(CODES, 77)], axis=1)
    mesh = unlit(points, faces, (256, 1), colors)
    assert mesh.face_colors is not None
    frame = show(mesh, (256, 1))
    assert frame.color[0, :, :3].tolist() == colors.tolist()
    by_vertex = unlit(points, faces, (256, 1), np.repeat(colors, 3, axis=0))
    assert show(by_vertex, (256, 1)).color.tobytes() == frame.color.tobytes()


@pytest.mark.case("K07")
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_round_trip_stays_close_to_the_code(dtype):
    # One step of the type at code 255 (1.5e-5, 2.9e-14), and one for the math library's pow.
    deviation = {np.float32: 1.5e-5, np.float64: 2 * np.spacing(255.0)}[dtype]
    decoded = np.array([naive.srgb_decode(code / 255) for code in range(256)], dtype)
    codes = 255 * linear_to_srgb(decoded)
    assert np.abs(codes - CODES).max() <= deviation
    assert np.floor(codes + 0.5).tolist() == CODES.tolist()
    assert encode(decoded)[0] == CODES.tolist()
    table = srgb_to_linear(CODES)
    assert encode(table)[0] == CODES.tolist()
    assert np.floor(255 * linear_to_srgb(table) + 0.5).tolist() == CODES.tolist()


@pytest.mark.case("K08")
def test_half_black_over_white_is_188_in_linear_light_and_128_in_codes():
    points, faces = strip(1)
    mesh = unlit(points, faces, (1, 1), [[0, 0, 0], [1, 1, 1], [0, 0, 0]])
    frame = show(mesh, (1, 1))
    assert frame.linear[0, 0, 0] == 0.5
    assert frame.color[0, 0].tolist() == [188, 188, 188, 255]
    assert oracle.composite([((0,), HALF)], (1,)) == (HALF,)
    # The classic framebuffer mixes codes, as the first graphics course does.
    framebuffer = rj.Framebuffer(3, 1)
    framebuffer.draw_line((0, 0), (2, 0), (255,) * 3, end_color=(0,) * 3)
    assert framebuffer.color[0, 1, 0] == 128


@pytest.mark.case("K08")
def test_mixing_codes_is_off_by_12_codes_on_the_mean():
    first, second = (pairs.ravel() for pairs in np.meshgrid(CODES, CODES))
    # In linear light: one triangle a pixel, the pixel's centre half-way along its first edge.
    points, faces = strip(256)
    points = [(x, y + row) for row in range(256) for x, y in points]
    faces = (np.array(faces) + 768 * np.arange(256)[:, None, None]).reshape(-1, 3)
    colors = np.zeros((3 * 65536, 3), np.uint8)
    colors[0::3], colors[1::3] = first[:, None], second[:, None]
    frame = show(unlit(points, faces, (256, 256), colors), (256, 256))
    mean = (srgb_to_linear(first).astype(float) + srgb_to_linear(second)) / 2
    # The difference of two float32 colours is rounded, and so is the sum: one step in all.
    step = np.spacing(mean.astype(np.float32))
    assert (np.abs(frame.linear[..., 0].ravel() - mean) <= step).all()
    # In codes: the middle of a line of three pixels.
    columns, rows = np.meshgrid(3 * np.arange(256), np.arange(256))
    columns, rows = columns.ravel(), rows.ravel()
    framebuffer = rj.Framebuffer(768, 256)
    framebuffer.draw_lines(
        np.stack([columns, rows, columns + 2, rows], axis=1),
        np.repeat(np.stack([first, second], axis=1)[..., None], 3, axis=2),
    )
    off = frame.color[..., 0].astype(float) - framebuffer.color[:, 1::3, 0]
    assert round(off.mean(), 1) == 12.2
    assert round(math.sqrt((off**2).mean()), 1) == 18.1
    assert np.abs(off).max() == 60


@pytest.mark.case("K09")
def test_a_power_of_2_2_is_off_by_eight_codes():
    linear = srgb_to_linear(CODES).astype(float)
    off = np.abs(255 * linear ** (1 / 2.2) - CODES)
    assert round(off.max(), 2) == 8.55
    assert off.argmax() == 7
    assert background_codes(linear[7])[0] == 7


@pytest.mark.case("K10")
@pytest.mark.parametrize(("bits", "kept"), [(8, 183), (10, 238), (12, 256)])
def test_whole_number_linear_light_needs_12_bits(bits, kept):
    points, faces = strip(256)
    colors = np.repeat(CODES[:, None], 3, axis=1)
    linear = show(unlit(points, faces, (256, 1), colors), (256, 1)).linear[0, :, 0]
    steps = 2**bits - 1
    stored = np.floor(linear.astype(float) * steps + 0.5) / steps
    assert sum(have == code for code, have in enumerate(encode(stored)[0])) == kept


@pytest.mark.case("K10")
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_float_linear_light_keeps_every_code(dtype):
    points, faces = strip(256)
    colors = np.repeat(CODES[:, None], 3, axis=1)
    linear = show(unlit(points, faces, (256, 1), colors), (256, 1)).linear[0, :, 0]
    assert encode(linear.astype(dtype))[0] == CODES.tolist()


# --- layers ---------------------------------------------------------------------------------------
# Frames hold opaque faces only. What mixes colours in them is interpolation, so a pixel whose
# weights are the shares of the layers must show exactly what the layers show.


@pytest.mark.case("K11")
@pytest.mark.parametrize(
    ("near", "far", "seen", "codes"),
    [
        ((1, 0, 0), (0, 1, 0), (0.5, 0.25, 0), [188, 137, 0]),
        ((0, 1, 0), (1, 0, 0), (0.25, 0.5, 0), [137, 188, 0]),
    ],
)
def test_half_a_layer_over_half_a_layer_depends_on_their_order(near, far, seen, codes):
    mixed = oracle.composite([(near, HALF), (far, HALF)], (0, 0, 0))
    assert mixed == seen
    # Shares 1/2, 1/4, 1/4: half-way from the first vertex to the middle of the other two.
    points = [(0.5, 0), (0, 1), (1, 1)]
    mesh = unlit(points, [[0, 1, 2]], (1, 1), [near, far, (0, 0, 0)])
    frame = show(mesh, (1, 1))
    assert frame.linear[0, 0].tolist() == [*mixed, 1]
    assert frame.color[0, 0].tolist() == [*codes, 255]


@pytest.mark.case("K12")
@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("apart", [False, True])
def test_at_equal_depth_the_first_layer_stays(threads, apart):
    # The order of opaque faces; layers will be ordered by the same two keys.
    size = (70, 70)
    layers = [(1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)]
    for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        points = [(0, 0), (0, 140), (140, 0)]
        scene = rj.Scene()
        if apart:
            for n in order:
                scene.add(unlit(points, [[0, 1, 2]], size, [layers[n]] * 3))
        else:
            colors = np.array(layers)[order]
            mesh = unlit(points * 3, np.arange(9).reshape(3, 3), size, np.repeat(colors, 3, 0))
            scene.add(mesh)
        for _ in range(3):
            frame = rj.render(
                scene, FLAT_VIEW, size=size, outputs=("linear", "face_id"), threads=threads
            )
            assert (frame.face_id == 0).all()
            assert (frame.linear == [*layers[order[0]], 1]).all()


@pytest.mark.case("K12")
def test_at_equal_depth_a_framebuffer_keeps_the_first():
    framebuffer = rj.Framebuffer(4, 4)
    for color in ((9, 0, 0), (0, 9, 0)):
        framebuffer.fill_triangle((0, 0), (0, 9), (9, 0), color, depth=(1, 1, 1), edges="inclusive")
    assert (framebuffer.color == [9, 0, 0, 255]).all()


@pytest.mark.case("K13")
def test_a_layer_of_alpha_0_is_nothing_and_of_alpha_1_is_everything():
    under = tuple(Fraction(code, 255) for code in (12, 200, 77))
    over = tuple(Fraction(code, 255) for code in (255, 1, 128))
    assert oracle.composite([(over, 0)], under) == under
    assert oracle.composite([(over, 1)], under) == over


@pytest.mark.case("K13")
@pytest.mark.parametrize("kind", ["straight", "premultiplied"])
def test_an_opaque_picture_on_nothing_laid_over_a_colour_is_the_picture_on_that_colour(
    sphere, camera, kind
):
    clear = rj.render(sphere, camera, size=(24, 18), background="transparent", threads=1).color
    alpha = clear[..., 3:]
    assert set(np.unique(alpha)) == {0, 255}
    assert (clear[alpha[..., 0] == 0] == 0).all()
    shares = alpha.astype(float) / 255
    colors = clear[..., :3].astype(float)
    own = colors * shares if kind == "straight" else colors
    laid = own + (1 - shares) * [255, 0, 255]
    whole = rj.render(sphere, camera, size=(24, 18), background="magenta", threads=1).color
    assert laid.tolist() == whole[..., :3].tolist()
    assert (whole[..., 3] == 255).all()


@pytest.mark.case("K13")
@pytest.mark.parametrize("alpha", [0.0, 1.0])
def test_alpha_of_the_background_leaves_its_colour_alone(alpha):
    mesh = rj.Mesh([[5, 5, 0], [6, 5, 0], [5, 6, 0]], [[0, 1, 2]])
    frame = show(mesh, (1, 1), background=(0.25, 0.5, 1.0, alpha))
    assert frame.linear[0, 0].tolist() == [0.25, 0.5, 1.0, alpha]
    assert frame.color[0, 0].tolist() == [137, 188, 255, 255 * alpha]


@pytest.mark.case("K14")
@pytest.mark.parametrize("codes", [(200, 100), (100, 200), (255, 1), (255, 255, 255)])
def test_light_added_beyond_the_largest_code_does_not_wrap(codes):
    frame = facing_white([code / 255 for code in codes])
    assert frame.linear[0, 0, 0] > 1.0
    assert frame.color[0, 0].tolist() == [255, 255, 255, 255]
