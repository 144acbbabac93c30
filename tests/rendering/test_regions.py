"""A region of a picture has the bits that the whole picture has there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.pipeline.visibility.visibility_pass import Region
from rasterjit.rendering.regions import RegionRenderer, check_region, regions_of
from rasterjit.scene.validation import MAX_GRID_UNITS, MAX_SIZE, tiled_size

SIZE = (150, 100)
"""Tiles of 64 pixels, and smaller ones at the right and at the bottom."""

OUTPUTS = (
    "color", "linear", "depth", "face_id", "object_id", "barycentric", "uv", "normal", "position",
)  # fmt: skip
STANDARD = rj.Quality.standard()


def ball(at=(0.0, 0.0, 0.0), radius=1.0, **material):
    rows, columns = np.mgrid[0:13, 0:25]
    polar, around = rows * (np.pi / 12), columns * (np.pi / 12)
    points = [np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)]
    vertices = radius * np.stack(points, axis=-1).reshape(-1, 3) + at
    uv = np.stack([columns / 6.0, rows / 3.0], axis=-1).reshape(-1, 2)
    a = (rows[:-1, :-1] * 25 + columns[:-1, :-1]).ravel()
    faces = np.concatenate([np.stack(f, 1) for f in ((a, a + 1, a + 26), (a, a + 26, a + 25))])
    return rj.Mesh(vertices, faces, uv=uv, material=rj.Material(**material))


def ground(**material):
    """Return two large triangles that reach behind the eye: they are cut."""
    corners = np.array([[-60.0, -1, -60], [60, -1, -60], [60, -1, 60], [-60, -1, 60]])
    return rj.Mesh(
        corners, [[0, 2, 1], [0, 3, 2]], uv=corners[:, [0, 2]], material=rj.Material(**material)
    )


def texture():
    texels = np.random.default_rng(3).integers(0, 256, (32, 32, 4), np.uint8)
    texels[..., 3] = 255
    return rj.Texture(texels)


def scene_with(*parts):
    scene = rj.Scene()
    look = {"shading": "phong", "base_color": (0.8, 0.4, 0.2, 1.0)}
    if "texture" in parts:
        look = {"shading": "phong", "base_color_texture": texture()}
    scene.add(ball(**look))
    scene.add(ground(**look))
    if "glass" in parts:
        glass = {"base_color": (0.2, 0.4, 0.9, 0.4), "alpha_mode": "blend"}
        scene.add(ball((1.0, 0.2, 1.2), 0.6, shading="phong", **glass))
    if "shadow" in parts:
        shadow = rj.Shadow(size=256)
        scene.lights = [
            rj.AmbientLight(intensity=0.2), rj.DirectionalLight((-1, -2, -1), shadow=shadow),
        ]  # fmt: skip
    if "fog" in parts:
        scene.fog = rj.Fog(mode="linear", start=1.0, end=20.0)
    if "environment" in parts:
        scene.environment = rj.Environment.gradient()
    if "wireframe" in parts:
        scene.wireframe = rj.Wireframe(width=3.5 if "wide" in parts else 1.0)
    return scene


CAMERA = rj.PerspectiveCamera(eye=(2.5, 1.5, 4.0), target=(0.3, 0.0, 0.0), near=0.1, far=100.0)


def drawn_in_tiles(scene, quality, size=SIZE, camera=CAMERA, threads=2, outputs=OUTPUTS):
    """Return the outputs of the whole, put together from tiles."""
    whole = {}
    with RegionRenderer(
        scene, camera, size=size, quality=quality, outputs=outputs, threads=threads
    ) as renderer:
        for region, frame in renderer.render_regions(64):
            left, top, width, height = region
            for name, array in frame.arrays().items():
                if name not in whole:
                    whole[name] = np.empty((size[1], size[0], *array.shape[2:]), array.dtype)
                whole[name][top : top + height, left : left + width] = array
    return whole


def assert_same_bits(scene, quality, **options):
    wanted = rj.render(scene, CAMERA, size=SIZE, quality=quality, outputs=OUTPUTS).arrays()
    found = drawn_in_tiles(scene, quality, **options)
    for name, array in wanted.items():
        assert array.tobytes() == found[name].tobytes(), name
    # Faces and what is behind them are both seen, and the cut ground among them.
    assert {0, 1} <= set(np.unique(wanted["object_id"]).tolist())


@pytest.mark.needs_jit
@pytest.mark.parametrize(
    ("parts", "settings"),
    [
        ("", {}),
        ("", {"samples": 4}),
        ("", {"samples": "area"}),
        ("", {"depth_format": "unorm24"}),
        ("", {"precision": "float32", "interpolation": "affine"}),
        ("", {"subpixel_bits": 0}),
        ("texture", {"texture_filter": "anisotropic8"}),
        ("fog environment", {}),
        ("glass environment", {"blending": "srgb8"}),
        ("shadow", {}),
        ("shadow", {"samples": 4}),
        ("texture glass shadow fog environment", {}),
        ("glass shadow", {"samples": 64}),
        ("wireframe", {"lines": "bresenham"}),
        ("wireframe", {"lines": "coverage"}),
        ("wide wireframe", {}),
    ],
    ids=str,
)
def test_tiles_have_the_bits_of_the_whole(parts, settings):
    assert_same_bits(scene_with(*parts.split()), replace(STANDARD, **settings))


@pytest.mark.parametrize("threads", [1, 3])
def test_tiles_have_the_same_bits_for_any_number_of_threads(threads):
    assert_same_bits(scene_with(), STANDARD, threads=threads)


def test_orthographic_tiles_have_the_bits_of_the_whole():
    camera = rj.OrthographicCamera(eye=(2.5, 1.5, 4.0), target=(0.3, 0.0, 0.0), height=5.0)
    scene = scene_with()
    wanted = rj.render(scene, camera, size=SIZE, outputs=("color", "depth")).arrays()
    found = drawn_in_tiles(scene, STANDARD, camera=camera, outputs=("color", "depth"))
    assert all(wanted[name].tobytes() == found[name].tobytes() for name in wanted)


def test_region_alone_is_that_part_of_the_whole():
    scene, region = scene_with(), Region(64, 0, 50, 37)
    wanted = rj.render(scene, CAMERA, size=SIZE).color[:37, 64:114]
    with RegionRenderer(scene, CAMERA, size=SIZE) as renderer:
        frame = renderer.render_region(region)
    assert frame.color.tobytes() == wanted.tobytes()


@pytest.mark.parametrize("corner", [(0, 0), (65536, 65536), (131008, 131008)])
def test_region_of_a_picture_beyond_one_frame_is_exact(corner):
    # Corners of a triangle on pixels of the whole, so far out that float32 could not tell them.
    side, (left, top) = 131072, corner
    places = np.array([[3, 2], [60, 9], [21, 55]], np.float64)
    ndc = (places + corner) * (2.0 / side) - 1.0
    vertices = np.column_stack([ndc[:, 0], -ndc[:, 1], np.zeros(3)])
    camera = rj.MatrixCamera(np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0]))
    with RegionRenderer(
        rj.Mesh(vertices, [(0, 1, 2)]), camera, size=(side, side), outputs=("face_id",)
    ) as renderer:
        shown = renderer.render_region(Region(left, top, 64, 64)).face_id >= 0
    covered = rj.oracle.covered_pixels(places.tolist(), (64, 64))
    assert {(int(x), int(y)) for y, x in np.argwhere(shown)} == set(covered)


def test_shadows_wait_for_the_survey():
    with (
        RegionRenderer(scene_with("shadow"), CAMERA, size=SIZE) as renderer,
        pytest.raises(RuntimeError, match="surveyed first, for shadows"),
    ):
        renderer.render_region(Region(0, 0, 64, 64))


@pytest.mark.parametrize(
    ("name", "effect"),
    [("ambient_occlusion", rj.AmbientOcclusion()), ("outline", rj.Outline())],
)
def test_what_looks_at_neighbours_is_refused(name, effect):
    scene = scene_with()
    setattr(scene, name, effect)
    with pytest.raises(ValueError, match=rf"scene\.{name} must be None where a picture is drawn"):
        RegionRenderer(scene, CAMERA, size=SIZE)


@pytest.mark.parametrize("blending", ["linear", "srgb8"])
def test_glass_of_several_samples_is_refused(blending):
    quality = rj.Quality(samples=4, blending=blending)
    with pytest.raises(ValueError, match=r"quality\.samples must be 1, 64 or 256 where a picture"):
        RegionRenderer(scene_with("glass"), CAMERA, size=SIZE, quality=quality)


@pytest.mark.parametrize(
    ("region", "message"),
    [
        ((0, 0, 64), r"region must be \(left, top, width, height\)"),
        ((0.5, 0, 4, 4), r"region must be \(left, top, width, height\)"),
        ((64.0, 0, 4, 4), r"region must be \(left, top, width, height\)"),
        ((0, 0, True, 4), r"region must be \(left, top, width, height\)"),
        (3, r"region must be \(left, top, width, height\)"),
        ((1, 0, 64, 64), "region must begin at multiples of 64"),
        ((0, 0, 0, 64), "region must be 1..16384 pixels wide"),
        ((64, 64, 64, 64), "region must lie in the picture"),
        ((-64, 0, 64, 64), "region must lie in the picture"),
    ],
)
def test_wrong_region_is_refused(region, message):
    with (
        RegionRenderer(scene_with(), CAMERA, size=SIZE) as renderer,
        pytest.raises(ValueError, match=message),
    ):
        renderer.render_region(region)


def test_tiles_are_the_whole_without_overlap():
    count = np.zeros((300, 200), int)
    for left, top, width, height in regions_of((200, 300), 128):
        count[top : top + height, left : left + width] += 1
    assert (count == 1).all()


@pytest.mark.parametrize("tile", [0, 63, 100, MAX_SIZE + 64, 64.0, True, np.True_, None])
def test_wrong_tile_is_refused(tile):
    with pytest.raises(ValueError, match="tile must be a multiple of 64"):
        regions_of((100, 100), tile)


@pytest.mark.parametrize("kind", [np.int64, np.uint16])
def test_whole_numbers_of_numpy_are_taken(kind):
    regions = regions_of((200, 300), kind(128))
    assert regions == regions_of((200, 300), 128)
    assert {type(value) for region in regions for value in region} == {int}
    region = check_region(np.array([64, 0, 100, 30], kind), (200, 300))
    assert region == (64, 0, 100, 30)
    assert {type(value) for value in region} == {int}


@pytest.mark.parametrize("bits", [0, 4, 8, 12])
def test_largest_picture_stays_inside_the_proved_units(bits):
    largest = min(131072, MAX_GRID_UNITS // (1 << bits) - MAX_SIZE)
    assert tiled_size("size", (largest, 1), bits) == (largest, 1)
    assert (largest + MAX_SIZE) << max(bits, 1) <= MAX_GRID_UNITS
    with pytest.raises(ValueError, match=r"size must be two whole numbers in 1\.\."):
        tiled_size("size", (1, largest + 1), bits)
