"""Laws of pictures behind all faces: each pixel is as with the picture's colour there behind it."""

from __future__ import annotations

import numpy as np
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES
from PIL import Image

import rasterjit as rj
from rasterjit.rendering.regions import RegionRenderer
from rasterjit.scene import background
from rasterjit.viewer.viewer import Viewer

SIZE = (90, 70)
CAMERA = rj.PerspectiveCamera((2, 3, 4), (0, 0, 0), near=0.5, far=30.0)
PALETTE = np.array([(10, 200, 77, 255), (255, 255, 255, 255), (90, 3, 160, 51)], np.uint8)
QUALITIES = [
    {},
    {"samples": 4},
    {"samples": "area"},
    {"samples": 64},
    {"blending": "srgb8"},
    {"samples": 4, "blending": "srgb8"},
    {"samples": 64, "blending": "srgb8"},
]
COLORS = ("color", "linear")


def scene_of(is_glass, tone=None):
    scene = rj.Scene()
    material = rj.Material("phong", (0.9, 0.2, 0.1, 0.4 if is_glass else 1.0))
    if is_glass:
        material = rj.Material("phong", (0.9, 0.2, 0.1, 0.4), alpha_mode="blend")
    scene.add(rj.Mesh(CUBE_VERTICES, CUBE_FACES, material=material))
    scene.tone_map = tone
    return scene


def numbers(seed=1):
    """Which colour of the palette each pixel of a picture has."""
    return np.random.default_rng(seed).integers(0, len(PALETTE), SIZE[::-1])


def drawn(scene, picture, outputs=COLORS, **quality):
    options = {"size": SIZE, "outputs": outputs, "background": picture, "threads": 2}
    return rj.render(scene, CAMERA, quality=rj.Quality(**quality), **options)


@pytest.mark.parametrize("tone", [None, rj.ToneMap("aces", 1.0)], ids=["as it is", "toned"])
@pytest.mark.parametrize("is_glass", [False, True], ids=["opaque", "glass"])
@pytest.mark.parametrize("quality", QUALITIES, ids=str)
def test_each_pixel_is_that_of_a_frame_before_its_colour(quality, is_glass, tone):
    if is_glass and quality.get("samples") == "area":
        pytest.skip("areas are of opaque faces")
    which = numbers()
    frame = drawn(scene_of(is_glass, tone), PALETTE[which], **quality)
    for number in (0, 2):
        alone = drawn(scene_of(is_glass, tone), PALETTE[number], **quality)
        for name in COLORS:
            found = getattr(frame, name)[which == number]
            assert found.tobytes() == getattr(alone, name)[which == number].tobytes(), name


@pytest.mark.parametrize("quality", [{}, {"samples": 4}], ids=str)
@pytest.mark.parametrize("tone", [None, rj.ToneMap("aces")], ids=["as it is", "toned"])
def test_light_is_taken_as_light_and_codes_stay_codes(quality, tone):
    codes = np.random.default_rng(2).integers(0, 256, (*SIZE[::-1], 4)).astype(np.uint8)
    codes[..., 3] = 255
    light = np.ones(codes.shape, np.float32)
    light[..., :3] = background.linear_rows("c", codes.reshape(-1, 4)).reshape(codes.shape)[..., :3]
    scene = scene_of(False, tone)
    frames = [drawn(scene, picture, **quality) for picture in (codes, light, codes[..., :3])]
    is_open = drawn(scene, None, outputs=("coverage",), samples=4).coverage == 0.0
    assert is_open.mean() > 0.3
    for frame in frames:
        assert np.array_equal(frame.color[is_open], codes[is_open])
        assert np.array_equal(frame.linear[is_open], light[is_open])
        assert frame.color.tobytes() == frames[0].color.tobytes()


def test_a_picture_of_light_alone_needs_no_codes_and_the_other_way_round():
    which = numbers()
    both = drawn(scene_of(True), PALETTE[which])
    for name in COLORS:
        one = drawn(scene_of(True), PALETTE[which], outputs=(name,))
        assert getattr(one, name).tobytes() == getattr(both, name).tobytes()


def test_nothing_but_colour_changes():
    names = ("depth", "face_id", "object_id", "normal", "coverage")
    plain, photo = (drawn(scene_of(False), one, names) for one in (None, PALETTE[numbers()]))
    for name in names:
        assert getattr(plain, name).tobytes() == getattr(photo, name).tobytes()
    assert not photo.plan.has("background image")
    assert "out (no output shows colour)" in str(photo.plan)


@pytest.mark.parametrize("quality", [{}, {"samples": "area"}, {"samples": 64}], ids=str)
@pytest.mark.parametrize("tone", [None, rj.ToneMap("aces")], ids=["as it is", "toned"])
def test_tiles_show_their_part_of_the_picture(quality, tone):
    scene, picture = scene_of(False, tone), PALETTE[numbers()]
    whole = drawn(scene, picture, **quality)
    options = {"size": SIZE, "outputs": COLORS, "background": picture, "threads": 1}
    with RegionRenderer(scene, CAMERA, quality=rj.Quality(**quality), **options) as renderer:
        for (left, top, width, height), part in renderer.render_regions(64):
            place = np.s_[top : top + height, left : left + width]
            assert part.color.tobytes() == np.ascontiguousarray(whole.color[place]).tobytes()
            assert part.linear.tobytes() == np.ascontiguousarray(whole.linear[place]).tobytes()


def test_a_scene_of_which_nothing_is_seen_shows_the_picture():
    picture = PALETTE[numbers()]
    away = rj.PerspectiveCamera((2, 3, 4), (4, 6, 8))
    frame = rj.render(scene_of(False), away, size=SIZE, background=picture)
    assert np.array_equal(frame.color, picture)


def test_it_takes_the_place_of_an_environment():
    scene = scene_of(False)
    scene.environment = rj.Environment.gradient()
    frame = drawn(scene, PALETTE[numbers()])
    assert np.array_equal(frame.color[0, 0], PALETTE[numbers()[0, 0]])
    assert not frame.plan.has("environment background")


def test_a_file_is_read_and_turned_as_its_camera_was_held(tmp_path):
    picture = PALETTE[numbers()]
    Image.fromarray(picture).save(tmp_path / "a.png")
    exif = Image.Exif()
    exif[0x0112] = 6
    turned = Image.fromarray(np.ascontiguousarray(np.rot90(picture)))
    turned.save(tmp_path / "turned.png", exif=exif)
    expected = drawn(scene_of(False), picture).color.tobytes()
    given = [tmp_path / "a.png", str(tmp_path / "a.png"), tmp_path / "turned.png"]
    for one in (*given, Image.fromarray(picture)):
        assert drawn(scene_of(False), one).color.tobytes() == expected
    changed = PALETTE[numbers(seed=2)]
    Image.fromarray(changed).save(tmp_path / "a.png", compress_level=1)
    again = drawn(scene_of(False), tmp_path / "a.png")
    assert again.color.tobytes() == drawn(scene_of(False), changed).color.tobytes()


def test_grey_pictures_of_8_and_16_bits_are_taken(tmp_path):
    grey = np.arange(SIZE[0] * SIZE[1]).reshape(SIZE[::-1]) % 256
    expected = np.repeat(grey[..., None], 3, axis=2).astype(np.uint8)
    Image.fromarray(grey.astype(np.uint8)).save(tmp_path / "grey.png")
    Image.fromarray((grey * 257).astype(np.uint16)).save(tmp_path / "deep.png")
    for name in ("grey.png", "deep.png"):
        frame = drawn(scene_of(False), tmp_path / name)
        assert frame.color.tobytes() == drawn(scene_of(False), expected).color.tobytes()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.zeros((70, 91, 3), np.uint8), r"got 91 x 70: render with size=\(91, 70\)"),
        (np.zeros((90, 70, 3), np.uint8), r"90 x 70 pixels, got 70 x 90"),
        (np.zeros((70, 90, 2), np.uint8), r"got shape \(70, 90, 2\)"),
        (np.zeros((70, 90), np.uint8), r"got shape \(70, 90\)"),
        (np.full((70, 90, 3), 2.0), r"background must lie in 0\.\.1, got 2\.0"),
        (np.full((70, 90, 3), np.nan), r"background must lie in 0\.\.1"),
        ("nowhere.png", r"background must be a file, but 'nowhere.png' does not exist"),
        (__file__, r"background must be a picture, but .* is not"),
        ("mauve-ish", r"background must be '#rgb'"),
    ],
)
def test_what_is_no_picture_of_this_size_is_named(value, message):
    with pytest.raises(ValueError, match=message):
        drawn(scene_of(False), value)
    with pytest.raises(ValueError, match=message):
        rj.explain(scene_of(False), CAMERA, size=SIZE, background=value)


def test_frames_of_many_cameras_and_chosen_qualities_show_it():
    picture = PALETTE[numbers()]
    (one,) = rj.render_many(scene_of(False), [CAMERA], size=SIZE, background=picture)
    assert one.color.tobytes() == drawn(scene_of(False), picture).color.tobytes()
    with pytest.raises(ValueError, match="background must be a picture of the frame's size"):
        next(iter(rj.render_many(scene_of(False), [CAMERA], size=(9, 9), background=picture)))
    frame = rj.render(scene_of(False), CAMERA, size=SIZE, background=picture, max_error=0.1)
    assert np.array_equal(frame.color[0, 0], picture[0, 0])


def test_a_pixel_is_explained_with_the_share_of_the_picture():
    which = numbers()
    frame = drawn(scene_of(True), PALETTE[which])
    for x, y in ((45, 35), (36, 31), (2, 3)):
        told = rj.explain_pixel(
            scene_of(True), CAMERA, SIZE, x, y, background=PALETTE[which]
        )  # fmt: skip
        assert np.array_equal(told.color, frame.color[y, x])
    told = rj.explain_pixel(scene_of(True), CAMERA, SIZE, 45, 35, background=PALETTE[which])
    assert told.parts[-1].name == "background"
    assert told.parts[-1].alpha == PALETTE[which[35, 45], 3] / 255


def test_a_viewer_whose_size_changes_takes_colours_alone():
    with pytest.raises(ValueError, match="background must be three or four numbers"):
        Viewer(scene_of(False), background=PALETTE[numbers()])
