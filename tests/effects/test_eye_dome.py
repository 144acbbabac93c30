"""Eye-dome lighting darkens what lies behind a neighbour, and nothing else."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.distributed.frames import render_large
from rasterjit.rendering.regions import Region, RegionRenderer

SIZE = (61, 40)
LOOK = {"eye": (2.0, 3.0, 5.0), "target": (0.0, 0.0, 0.0), "near": 0.5, "far": 30.0}
PERSPECTIVE = rj.PerspectiveCamera(fov_y=40.0, **LOOK)
PARALLEL = rj.OrthographicCamera(height=3.5, **LOOK)
CAMERAS = {"perspective": PERSPECTIVE, "parallel": PARALLEL}
cameras = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)


def rounded(length):
    return math.floor(length + 0.5)


def shares(depth, effect, logarithm):
    """Return the share of light that pixels keep, (H, W), given their depth: the slow twin."""
    height, width = depth.shape
    straight, slant = rounded(effect.radius), rounded(effect.radius / math.sqrt(2.0))
    around = [(slant * x, slant * y) for x in (-1, 1) for y in (-1, 1)]
    around += [(straight * x, straight * y) for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    kept = np.ones(depth.shape)
    for y, x in np.argwhere(np.isfinite(depth)):
        total = 0.0
        for right, down in around:
            i, j = x + right, y + down
            if 0 <= i < width and 0 <= j < height and np.isfinite(depth[j, i]):
                total += max(0.0, logarithm(depth[y, x]) - logarithm(depth[j, i]))
        kept[y, x] = math.exp(-300.0 * effect.strength * total / 8.0)
    return kept


def of_camera(camera):
    """Return what is compared, of a depth."""
    if camera is PERSPECTIVE:
        return math.log2
    distance = camera.height / (2.0 * math.tan(math.radians(45.0) / 2.0))
    return lambda depth: depth / (distance * math.log(2.0))


def scene_of(mesh, effect=None, **fields):
    scene = rj.Scene()
    scene.add(mesh)
    scene.add(mesh, rj.transforms.translate((-0.9, 0.4, -1.5)))
    scene.eye_dome = effect
    for name, value in fields.items():
        setattr(scene, name, value)
    return scene


def shown(mesh, camera, effect=None, fields=None, **options):
    options = {"size": SIZE, "background": (0.9, 0.4, 0.1, 0.5), "threads": 1, **options}
    options.setdefault("outputs", ("color", "linear", "depth", "face_id"))
    return rj.render(scene_of(mesh, effect, **(fields or {})), camera, **options)


def unlit(cube):
    mesh = rj.Mesh(cube.vertices, cube.faces, colors=np.linspace(0.2, 1.0, 24).reshape(8, 3))
    mesh.material = rj.Material(shading="unlit")
    return mesh


@cameras
@pytest.mark.parametrize(("strength", "radius"), [(0.2, 1.4), (0.05, 3.0), (1.0, 1.0), (0.1, 12.0)])
def test_it_is_its_slow_twin(cube, camera, strength, radius):
    effect = rj.EyeDome(strength, radius)
    plain, found = shown(cube, camera), shown(cube, camera, effect)
    wanted = shares(plain.depth.astype(float), effect, of_camera(camera))
    assert (wanted < 0.9).any()
    assert (wanted[plain.face_id >= 0] == 1.0).any()
    light = plain.linear[..., :3] * wanted[..., np.newaxis]
    # Depths, their logarithms and the factor of 300 are rounded to float32.
    assert np.allclose(found.linear[..., :3], light, rtol=2e-3, atol=1e-6)
    for name in ("depth", "face_id"):
        assert np.array_equal(getattr(found, name), getattr(plain, name))
    assert np.array_equal(found.linear[..., 3], plain.linear[..., 3])
    nothing = plain.face_id < 0
    assert np.array_equal(found.color[nothing], plain.color[nothing])


@cameras
def test_what_is_not_lit_is_darkened_alike_and_needs_no_light(cube, camera):
    mesh, effect = unlit(cube), rj.EyeDome(0.2)
    plain, found = shown(mesh, camera), shown(mesh, camera, effect)
    wanted = shares(plain.depth.astype(float), effect, of_camera(camera))
    light = plain.linear[..., :3] * wanted[..., np.newaxis]
    assert np.allclose(found.linear[..., :3], light, rtol=2e-3, atol=1e-6)
    assert found.plan.lighting is None


@pytest.mark.parametrize("fields", [{}, {"fog": rj.Fog("white", density=0.1)}], ids=["", "fog"])
@pytest.mark.parametrize("quality", [{}, {"samples": 4}, {"samples": "area"}])
def test_absent_is_neutral_bit_for_bit(cube, quality, fields):
    quality = rj.Quality(**quality)
    plain = shown(cube, PERSPECTIVE, None, fields, quality=quality)
    assert not shown(cube, PERSPECTIVE, rj.EyeDome(0.0)).plan.has("eye-dome lighting")
    frame = shown(cube, PERSPECTIVE, rj.EyeDome(1e-30), fields, quality=quality)
    assert frame.plan.has("eye-dome lighting")
    for name, array in plain.arrays().items():
        assert np.array_equal(frame.arrays()[name], array), name


def test_a_wall_seen_from_ahead_keeps_all_its_light(cube):
    wall = rj.Mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]])
    camera = rj.PerspectiveCamera(eye=(0, 0, 3), target=(0, 0, 0))
    plain, found = (
        rj.render(scene, camera, size=SIZE).color
        for scene in (one_of(wall, None), one_of(wall, rj.EyeDome(1000.0)))
    )
    assert np.array_equal(plain, found)


def one_of(mesh, effect):
    scene = rj.Scene()
    scene.add(mesh)
    scene.eye_dome = effect
    return scene


def test_fog_lies_over_it(cube):
    fog = rj.Fog("white", mode="linear", start=0.0, end=6.0)
    effect = rj.EyeDome(1000.0)
    clear = shown(cube, PERSPECTIVE, effect).linear[..., :3]
    black = (clear == clear.min()).all(axis=2) & (clear < 1e-6).all(axis=2)
    assert black.any()
    assert (shown(cube, PERSPECTIVE, effect, {"fog": fog}).linear[black][:, :3] > 0.3).all()


def test_neither_the_scale_nor_the_place_of_a_parallel_camera_counts(cube):
    effect = rj.EyeDome(0.2)
    near = rj.OrthographicCamera(eye=(0.0, 0.0, 4.0), target=(0, 0, 0), height=4.0, far=32.0)
    back = dataclasses.replace(near, eye=(0.0, 0.0, 12.0))
    tilted = rj.Mesh(cube.vertices @ rj.transforms.rotate((1, 2, 3), 40.0)[:3, :3].T, cube.faces)
    tilted.material = rj.Material(shading="unlit")
    first, second = (shown(tilted, camera, effect).linear for camera in (near, back))
    assert np.allclose(first, second, rtol=1e-3, atol=1e-6)
    assert len(np.unique(first[..., 0])) > 20
    grown = rj.Mesh(8.0 * tilted.vertices, tilted.faces, material=tilted.material)
    large = rj.OrthographicCamera(eye=(0, 0, 32.0), target=(0, 0, 0), height=32.0, far=256.0)
    one, other = (
        rj.render(one_of(mesh, effect), camera, size=SIZE, outputs="linear").linear
        for mesh, camera in ((tilted, near), (grown, large))
    )
    assert np.allclose(one, other, rtol=1e-4, atol=1e-6)


def test_a_matrix_camera_is_the_camera_of_its_matrices(cube):
    for camera in CAMERAS.values():
        matrices = rj.MatrixCamera(camera.view_matrix(), 3.0 * camera.projection_matrix(SIZE))
        own, given = (shown(cube, one, rj.EyeDome(0.1)).linear for one in (camera, matrices))
        assert np.allclose(own, given, rtol=1e-3, atol=1e-6)


def test_glass_has_the_share_of_the_nearest_surface(cube):
    glass = rj.Mesh(cube.vertices, cube.faces)
    glass.material = rj.Material("unlit", (0.2, 0.8, 0.4, 0.5), alpha_mode="blend")
    effect = rj.EyeDome(0.2)
    options = {"background": "black", "outputs": ("linear", "depth")}
    plain = shown(glass, PERSPECTIVE, **options)
    found = shown(glass, PERSPECTIVE, effect, **options)
    wanted = shares(plain.depth.astype(float), effect, math.log2)[..., np.newaxis]
    assert np.allclose(found.linear[..., :3], plain.linear[..., :3] * wanted, rtol=2e-3, atol=1e-6)


@pytest.mark.parametrize("samples", [4, 16, "area"])
def test_several_samples_of_a_pixel_have_one_share(cube, samples):
    effect, options = (
        rj.EyeDome(0.2),
        {"quality": rj.Quality(samples=samples), "background": "black"},
    )
    plain = shown(cube, PERSPECTIVE, **options)
    found = shown(cube, PERSPECTIVE, effect, **options)
    wanted = shares(plain.depth.astype(float), effect, math.log2)[..., np.newaxis]
    assert np.allclose(found.linear[..., :3], plain.linear[..., :3] * wanted, rtol=2e-3, atol=1e-6)


def test_each_of_many_pictures_has_its_own(cube):
    effect, quality = rj.EyeDome(0.2), rj.Quality(samples=64)
    found = shown(cube, PERSPECTIVE, effect, quality=quality).linear
    once = shown(cube, PERSPECTIVE, effect).linear
    plain = shown(cube, PERSPECTIVE, quality=quality).linear
    inside = np.isfinite(shown(cube, PERSPECTIVE).depth)
    assert (found[..., :3] <= plain[..., :3] + 1e-6).all()
    # Edges are as dark, but soft.
    assert abs(found[inside].mean() - once[inside].mean()) < 0.02
    assert not np.array_equal(found, once)


@cameras
@pytest.mark.parametrize("depth_format", ["unorm24", "float32"])
def test_other_depth_formats_show_the_same(cube, camera, depth_format):
    quality = rj.Quality(depth_format=depth_format)
    own = shown(cube, camera, rj.EyeDome(0.1))
    other = shown(cube, camera, rj.EyeDome(0.1), quality=quality)
    same = own.face_id == other.face_id
    assert np.abs(own.linear - other.linear)[same].max() < 0.02


@cameras
@pytest.mark.parametrize(("samples", "radius"), [(1, 2.0), (1, 64.0), (64, 3.0)])
def test_threads_and_parts_give_the_bits_of_the_whole(cube, camera, samples, radius):
    scene, size = scene_of(cube, rj.EyeDome(0.1, radius)), (200, 150)
    options = {"size": size, "quality": rj.Quality(samples=samples)}
    outputs = ("color", "linear", "depth", "face_id")
    whole = rj.render(scene, camera, **options, outputs=outputs, threads=1)
    other = rj.render(scene, camera, **options, outputs=outputs, threads=3)
    assert np.array_equal(other.linear, whole.linear)
    with RegionRenderer(scene, camera, **options, outputs=outputs, threads=1) as renderer:
        for region in ((128, 64, 72, 86), (64, 0, 64, 64), (0, 0, 200, 150)):
            left, top, width, height = region
            part = renderer.render_region(region)
            for name, array in part.arrays().items():
                rows = whole.arrays()[name][top : top + height, left : left + width]
                assert np.array_equal(array, rows), (region, name)
            assert part.plan.region == region
            own = whole.face_id[top : top + height, left : left + width]
            assert part.stats.pixels_covered == (own >= 0).sum()


def test_pixels_of_a_part_are_counted_without_their_faces(cube):
    scene = scene_of(cube, rj.EyeDome())
    with RegionRenderer(scene, PERSPECTIVE, size=(200, 150)) as renderer:
        part = renderer.render_region(Region(64, 64, 64, 64))
    found = rj.render(scene, PERSPECTIVE, size=(200, 150), outputs="face_id").face_id
    assert part.stats.pixels_covered == (found[64:128, 64:128] >= 0).sum() > 0


def test_too_large_a_part_for_its_neighbours_is_refused(cube):
    scene = scene_of(cube, rj.EyeDome())
    with (
        RegionRenderer(scene, PERSPECTIVE, size=(20000, 20000)) as renderer,
        pytest.raises(ValueError, match=r"region must be 16256 pixels wide and high at most"),
    ):
        renderer.render_region((64, 64, 16384, 64))


def test_shadows_and_shares_meet_in_parts(cube):
    lamp = rj.SpotLight((2, 4, 5), (-2, -4, -5), intensity=30.0, shadow=rj.Shadow(size=64))
    scene = scene_of(cube, rj.EyeDome(0.1), lights=[lamp])
    whole = rj.render(scene, PERSPECTIVE, size=(150, 130), threads=1).color
    with RegionRenderer(scene, PERSPECTIVE, size=(150, 130), threads=1) as renderer:
        for (left, top, width, height), part in renderer.render_regions(64):
            assert np.array_equal(part.color, whole[top : top + height, left : left + width])


def test_large_pictures_show_it(cube, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    scene, size = scene_of(cube, rj.EyeDome(0.2)), (200, 150)
    render_large(scene, PERSPECTIVE, size, tmp_path / "a.tif", tile=64, threads=1)
    whole = rj.render(scene, PERSPECTIVE, size=size, threads=1).color
    assert np.array_equal(tifffile.imread(tmp_path / "a.tif"), whole)


@pytest.mark.parametrize("mesh", ["lit", "unlit"])
def test_a_pixel_tells_what_it_takes_away(cube, mesh):
    mesh = unlit(cube) if mesh == "unlit" else cube
    scene = scene_of(mesh, rj.EyeDome(0.2))
    frame, plain = shown(mesh, PERSPECTIVE, rj.EyeDome(0.2)), shown(mesh, PERSPECTIVE)
    share = frame.linear[..., 0] / np.maximum(plain.linear[..., 0], 1e-9)
    y, x = (int(n) for n in np.argwhere((share < 0.8) & (share > 0.1))[0])
    told = rj.explain_pixel(scene, PERSPECTIVE, SIZE, x, y)
    (term,) = [term for term in told.light.lights if term.name == "eye-dome lighting"]
    taken = frame.linear[y, x, :3] - plain.linear[y, x, :3]
    assert np.allclose(term.diffuse, taken, atol=1e-6)
    assert "eye-dome lighting" in str(told)


@pytest.mark.parametrize(
    ("name", "value"), [("strength", -1.0), ("strength", 1001.0), ("radius", 0.5), ("radius", 65)]
)
def test_numbers_beyond_their_range_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        rj.EyeDome(**{name: value})


def test_reasons_say_why_not(cube):
    for scene, words in (
        (scene_of(cube), "scene.eye_dome is None"),
        (scene_of(cube, rj.EyeDome(0.0)), "its strength is 0"),
        (scene_of(cube, rj.EyeDome(0.5)), "strength 0.5, radius 1.4"),
    ):
        assert words in str(rj.explain(scene, PERSPECTIVE))
