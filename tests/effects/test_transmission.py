"""
Glass against a slow version in NumPy: what is behind, refracted, blurred, tinted by Beer's law.

What a surface mirrors, and the share of the light that goes into it, are taken from pictures of the
same surface without transmission: a black one shows the first, a white one both.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.effects.transmission import build_mip_levels, make_level_table
from rasterjit.rendering.regions import RegionRenderer
from rasterjit.runtime.threads import Workers
from rasterjit.scene.pixel_projection import clip_from_relative

SIZE = WIDTH, HEIGHT = (60, 44)
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = [[0, 1, 2], [0, 2, 3]]
UP = np.tile([0.0, 0.0, 1.0], (4, 1))
BOARD = np.random.default_rng(3).random((12, 12, 3), dtype=np.float32)
CAMERA = rj.PerspectiveCamera(eye=(0.3, 0.4, 4.0), target=(0.0, 0.1, 0.0), fov_y=40.0)
PLACE = rj.transforms.translate


def pane(side=0.8, **options):
    """Return a rectangle that faces the viewer."""
    options = {"roughness": 0.0, "base_color": "white", **options}
    uv = SQUARE[:, :2] / 2.0 + 0.5
    material = rj.Material("pbr", **options)
    return rj.Mesh(SQUARE * side, FACES, uv=uv, normals=UP, material=material)


def wall(colors=BOARD, filter="nearest"):
    texture = rj.Texture(colors, color_space="linear", filter=filter)
    material = rj.Material("unlit", base_color_texture=texture)
    return rj.Mesh(SQUARE * 2.5, FACES, uv=SQUARE[:, :2] / 2.0 + 0.5, material=material)


def scene_of(*meshes, ambient=(0.3, 0.5, 0.7), behind=None):
    """Return a scene of some meshes at z = 0, each a little nearer, before a wall at z = -1."""
    scene = rj.Scene()
    scene.add(wall() if behind is None else behind, PLACE((0, 0, -1)), "wall")
    for number, mesh in enumerate(meshes):
        scene.add(mesh, PLACE((0, 0, 0.3 * number)), f"pane {number}")
    scene.lights = [rj.AmbientLight(ambient, 1.0)]
    return scene


def drawn(scene, camera=CAMERA, outputs=("linear",), **options):
    return rj.render(scene, camera, size=SIZE, outputs=outputs, threads=1, **options)


def linear(scene, **options):
    return drawn(scene, **options).linear[..., :3].astype(np.float64)


def covered(scene, number=1):
    return drawn(scene, outputs=("object_id",)).object_id == number


def shares(**options):
    """Return what a pane like this mirrors of ambient light, and what goes into it, per pixel."""
    black = linear(scene_of(pane(**options | {"base_color": "black"}), ambient="white"))
    white = linear(scene_of(pane(**options | {"base_color": "white"}), ambient="white"))
    return black, white - black


def without_panes():
    return linear(scene_of())


@pytest.mark.parametrize("share", [1.0, 0.375])
def test_a_pane_shows_what_is_behind_times_its_colour_and_mirrors_the_rest(share):
    color, ambient = np.array([0.9, 0.5, 0.25]), np.array([0.3, 0.5, 0.7])
    scene = scene_of(pane(base_color=color, transmission=share))
    mirrored, inside = shares()
    seen = share * without_panes() + (1.0 - share) * ambient
    want = mirrored * ambient + inside * color * seen
    is_glass = covered(scene)
    assert is_glass.sum() > 400
    have = linear(scene)
    assert have[is_glass] == pytest.approx(want[is_glass], abs=2e-6)
    assert (have[~is_glass] == without_panes()[~is_glass]).all()


def test_lights_are_mirrored_on_top():
    """A light adds to a pane of glass what it adds to a black one, which shows no more of it."""
    lamp = rj.DirectionalLight((-0.1, -0.1, -1.0), intensity=3.0)

    def lit(*lights, **options):
        scene = scene_of(pane(roughness=0.4, **options))
        scene.lights = list(lights)
        return linear(scene)

    dark = rj.AmbientLight(intensity=0.0)
    added = lit(lamp, transmission=1.0) - lit(dark, transmission=1.0)
    shine = lit(lamp, base_color="black")
    is_glass = covered(scene_of(pane()))
    assert shine[is_glass].max() > 0.1
    assert added[is_glass] == pytest.approx(shine[is_glass], abs=1e-6)


def test_metal_lets_nothing_through():
    metal = {"metallic": 1.0, "base_color": "#c0a060"}
    scenes = [scene_of(pane(transmission=share, **metal)) for share in (0.0, 1.0)]
    assert (linear(scenes[0]) == linear(scenes[1])).all()


def test_no_transmission_is_not_planned_and_changes_no_bit():
    plain, told = (scene_of(pane(roughness=0.3, **more)) for more in (
        {}, {"thickness": 2.0, "attenuation_distance": 0.1, "attenuation_color": "red"},
    ))  # fmt: skip
    assert (linear(plain) == linear(told)).all()
    frame = drawn(told)
    assert not frame.plan.has("transmission")
    assert "transmission             out (no pbr material has a transmission" in str(frame.plan)
    far = scene_of(pane(), pane(transmission=1.0))
    far.nodes[-1].transform = PLACE((0, 0, 50))
    frame = drawn(far)
    assert "transmission             out (1 transmitting object outside the view)" in str(
        frame.plan
    )
    assert (frame.linear == drawn(scene_of(pane())).linear).all()


def test_shading_that_is_not_pbr_transmits_nothing():
    mesh = pane(transmission=1.0)
    mesh.material = replace(mesh.material, shading="phong")
    assert not drawn(scene_of(mesh)).plan.has("transmission")


def bilinear(picture, x, y):
    """Return a picture, (H, W, 3), at places in pixels, the first one's centre at 0.5."""
    height, width = picture.shape[:2]
    x, y = np.clip(x - 0.5, 0, width - 1), np.clip(y - 0.5, 0, height - 1)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    right, below = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    across, down = (x - left)[..., None], (y - top)[..., None]
    upper = picture[top, left] * (1 - across) + picture[top, right] * across
    lower = picture[below, left] * (1 - across) + picture[below, right] * across
    return upper * (1 - down) + lower * down


def refracted_places(camera, ior, thickness, z=0.0):
    """Return where rays through a pane at z leave a body so thick, (H, W) pixels each."""
    clip = np.asarray(clip_from_relative(camera, SIZE))
    inverse, eye = np.linalg.inv(clip), np.asarray(camera.eye_position())
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    x, y = 2 * columns / WIDTH - 1, 1 - 2 * rows / HEIGHT
    ends = []
    for depth in (0.1, 0.9):
        point = np.stack([x, y, np.full_like(x, depth), np.ones_like(x)], -1) @ inverse.T
        ends.append(point[..., :3] / point[..., 3:])
    way = ends[1] - ends[0]
    way *= np.sign(-way[..., 2:])
    start = ends[0] + way * ((z - eye[2] - ends[0][..., 2]) / way[..., 2])[..., None]
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    # Snell's law: the sine falls by the index.
    bent = way / ior
    bent[..., 2] = -np.sqrt(1 - bent[..., 0] ** 2 - bent[..., 1] ** 2)
    leaves = start + thickness * bent
    seen = np.concatenate([leaves, np.ones((*x.shape, 1))], -1) @ clip.T
    return (
        (seen[..., 0] / seen[..., 3] + 1) / 2 * WIDTH,
        (1 - seen[..., 1] / seen[..., 3]) / 2 * HEIGHT,
    )


@pytest.mark.parametrize("camera", [
    CAMERA, rj.OrthographicCamera(eye=(1.0, 1.5, 4.0), target=(0, 0, 0), height=2.6),
])  # fmt: skip
def test_a_body_refracts_by_snells_law(camera):
    own = {"transmission": 1.0, "thickness": 0.7, "ior": 1.8}
    scene, behind = scene_of(pane(**own)), linear(scene_of(), camera=camera)
    if camera is CAMERA:
        places = refracted_places(camera, 1.8, 0.7)
    else:
        places = parallel_places(camera, 1.8, 0.7)
    seen = bilinear(behind, *places)
    black, white = (
        linear(scene_of(pane(base_color=color, ior=1.8), ambient="white"), camera=camera)
        for color in ("black", "white")
    )
    want = black * [0.3, 0.5, 0.7] + (white - black) * seen
    is_glass = drawn(scene, camera, ("object_id",)).object_id == 1
    moved = np.hypot(
        places[0] - np.arange(WIDTH) - 0.5, places[1].T.T - np.arange(HEIGHT)[:, None] - 0.5
    )
    assert moved[is_glass].max() > 1.0
    have = linear(scene, camera=camera)
    assert have[is_glass] == pytest.approx(want[is_glass], abs=2e-4)


def parallel_places(camera, ior, thickness):
    """The same where all rays are parallel: all are moved alike."""
    clip = np.asarray(clip_from_relative(camera, SIZE))
    way = np.asarray(camera.target, float) - np.asarray(camera.eye, float)
    way /= np.linalg.norm(way)
    bent = way / ior
    bent[2] = -math.sqrt(1 - bent[0] ** 2 - bent[1] ** 2)
    across, up = (clip[:2, :3] @ bent) * thickness
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    return columns + across / 2 * WIDTH, rows - up / 2 * HEIGHT


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_body_tints_by_beers_law(scale):
    """What goes a way through it is of the attenuation colour to the power of ways it goes."""
    color, distance, thickness = np.array([0.8, 0.4, 0.1]), 0.5, 0.3
    own = {"transmission": 1.0, "thickness": thickness}
    inside = {"attenuation_distance": distance, "attenuation_color": color}
    behind = wall(np.full((2, 2, 3), 0.75, np.float32))
    pictures = []
    for more in ({}, inside):
        scene = scene_of(pane(0.8 / scale, **own, **more), behind=behind, ambient="black")
        scene.nodes[1].transform = PLACE((0, 0, 0)) @ rj.transforms.scale(scale)
        pictures.append(linear(scene))
    is_glass = covered(scene)
    ratio = pictures[1][is_glass] / pictures[0][is_glass]
    want = np.broadcast_to(color ** (thickness * scale / distance), ratio.shape)
    assert ratio == pytest.approx(want, rel=1e-5)


@pytest.mark.parametrize("cut", [False, True])
def test_joints_scale_how_thick_a_body_is(cut):
    """Glass that a joint makes larger is as thick as glass whose node does."""
    own = {"transmission": 1.0, "thickness": 0.4, "ior": 1.8, "attenuation_color": "#80ff80",
           "attenuation_distance": 0.5}  # fmt: skip
    plain = pane(0.5, **own)
    follows = np.tile((0, 1), (4, 1)), np.tile((1.0, 0.0), (4, 1))
    skinned = rj.Mesh(
        plain.vertices, FACES, uv=plain.uv, normals=UP, material=plain.material,
        joints=follows[0], weights=follows[1],
    )  # fmt: skip
    larger, pictures = rj.transforms.scale(1.6), []
    for mesh, place in ((plain, larger), (skinned, np.eye(4))):
        scene = scene_of()
        node = scene.add(mesh, place, "pane")
        if mesh is skinned:
            joints = [rj.Node(None, larger), rj.Node(None, rj.transforms.scale(90.0))]
            node.skin = rj.Skin(joints, np.tile(np.eye(4), (2, 1, 1)))
        if cut:
            scene.section = rj.SectionPlane((0.1, 0, 0), (1, 0, 0), cap=False)
        pictures.append(linear(scene))
    thin = scene_of()
    thin.add(pane(0.5, **own | {"thickness": 0.25}), larger, "pane")
    assert pictures[1] == pytest.approx(pictures[0], abs=1e-5)
    assert np.abs(linear(thin) - pictures[0])[covered(thin)].max() > 0.05


@pytest.mark.parametrize(("color", "want"), [("white", 1.0), ("black", 0.0)])
def test_clear_and_black_bodies(color, want):
    own = {"transmission": 1.0, "thickness": 1.0, "attenuation_distance": 1e-3}
    scene = scene_of(pane(attenuation_color=color, **own), ambient="black")
    clear = scene_of(pane(transmission=1.0, thickness=1.0), ambient="black")
    assert linear(scene)[covered(scene)] == pytest.approx(want * linear(clear)[covered(scene)])


def test_an_index_of_one_looks_straight_through():
    thin, thick = (scene_of(pane(transmission=1.0, ior=1.0, thickness=t)) for t in (0.0, 0.9))
    assert (linear(thin) == linear(thick)).all()
    assert linear(thin)[covered(thin)].std() > 0.1


def test_blur_grows_with_roughness_and_index():
    """What is seen varies the less the rougher the pane; an index of 1 blurs nothing."""

    def spread(**options):
        scene = scene_of(pane(transmission=1.0, **options), ambient="black")
        _, inside = shares(**options)
        is_glass = covered(scene)
        return (linear(scene)[is_glass] / inside[is_glass]).std(axis=0).mean()

    by_roughness = [spread(roughness=r) for r in (0.0, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)]
    assert by_roughness == sorted(by_roughness, reverse=True)
    assert by_roughness[0] > 3.0 * by_roughness[-1]
    by_index = [spread(roughness=0.5, ior=n) for n in (1.0, 1.1, 1.2, 1.33, 1.5)]
    assert by_index == sorted(by_index, reverse=True)
    assert by_index[0] == pytest.approx(by_roughness[0], rel=0.02)


def test_levels_are_halves_by_weights_1_3_3_1():
    picture = np.random.default_rng(1).random((13, 22, 4), dtype=np.float32)
    texels, levels = build_mip_levels(picture, True, Workers(2))
    assert levels.tolist() == make_level_table((22, 13), 9).tolist()
    assert [row[1:] for row in levels.tolist()] == [
        [22, 13],
        [11, 7],
        [6, 4],
        [3, 2],
        [2, 1],
        [1, 1],
    ]
    want = picture[..., :3].astype(np.float64) * picture[..., 3:]
    for first, width, height in levels.tolist():
        own = texels[first : first + width * height].reshape(height, width, 3)
        assert own == pytest.approx(want, abs=2e-6)
        for axis in (0, 1):
            count = want.shape[axis]
            at = 2 * np.arange(-(-count // 2))
            parts = [
                want.take(np.clip(at + step, 0, count - 1), axis) * weight
                for step, weight in ((-1, 0.125), (0, 0.375), (1, 0.375), (2, 0.125))
            ]
            want = sum(parts)
    assert len(build_mip_levels(picture, False, Workers(1))[1]) == 1


def test_light_beyond_float32_is_no_nan():
    picture = np.ones((4, 4, 4), np.float32)
    picture[1, 1, :3] = np.inf, np.nan, 3e38
    texels, _ = build_mip_levels(picture, True, Workers(1))
    assert np.isfinite(texels).all()


def test_textures_multiply_transmission_and_thickness():
    """Red of one, green of the other; the left half lets nothing through, or is thin."""
    halves = np.zeros((1, 2, 3), np.float32)
    halves[:, 1] = 1.0
    texture = rj.Texture(halves, color_space="linear", filter="nearest")
    where = drawn(scene_of(pane()), outputs=("object_position",)).object_position[..., 0]
    left, right = where < -0.02, where > 0.02
    own = {"transmission": 1.0, "thickness": 0.7, "ior": 1.8}
    masked = linear(scene_of(pane(transmission_texture=texture, **own)))
    assert masked[left] == pytest.approx(linear(scene_of(pane(ior=1.8)))[left], abs=1e-6)
    assert masked[right] == pytest.approx(linear(scene_of(pane(**own)))[right], abs=1e-6)
    thinned = linear(scene_of(pane(thickness_texture=texture, **own)))
    thin = linear(scene_of(pane(**own | {"thickness": 0.0})))
    assert thinned[left] == pytest.approx(thin[left], abs=1e-6)
    assert thinned[right] == pytest.approx(linear(scene_of(pane(**own)))[right], abs=1e-6)


GLASS = {"transmission": 0.9, "thickness": 0.6, "roughness": 0.3, "base_color": "#c0e0ff"}


def busy_scene():
    """Return glass before a wall, with a lamp, a shadow, fog, a sky, and something blended."""
    blended = rj.Material("phong", (0.9, 0.3, 0.2, 0.5), alpha_mode="blend")
    scene = scene_of(pane(**GLASS), rj.Mesh(SQUARE * 0.3, FACES, normals=UP, material=blended))
    lit = rj.Material("phong", "#a0c060")
    scene.add(rj.Mesh(SQUARE * 0.5, FACES, normals=UP, material=lit), PLACE((0.4, 0.3, -0.5)))
    shadow = rj.Shadow(size=64)
    scene.lights = [rj.AmbientLight(intensity=0.3),
                    rj.DirectionalLight((-0.3, -0.2, -1.0), shadow=shadow)]  # fmt: skip
    scene.environment = rj.Environment.gradient()
    scene.fog = rj.Fog("#8090a0", density=0.05)
    return scene


@pytest.mark.parametrize("quality", [
    rj.Quality(samples="area"), rj.Quality(samples=4, blending="srgb8"),
    rj.Quality(blending="srgb8"),
])  # fmt: skip
def test_all_that_lies_over_a_picture_lies_over_glass(quality):
    """Tones, edges and corners, with glass and without, for any threads."""
    scene = busy_scene()
    scene.remove(scene.find("pane 1"))
    scene.tone_map, scene.outline = rj.ToneMap("aces"), rj.Outline()
    scene.ambient_occlusion, scene.eye_dome = rj.AmbientOcclusion(0.8), rj.EyeDome()
    scene.vignette, scene.wireframe = rj.Vignette(), rj.Wireframe()
    frames = [
        rj.render(scene, CAMERA, size=(160, 130), quality=quality, threads=n).color for n in (1, 3)
    ]
    assert frames[0].tobytes() == frames[1].tobytes()
    scene.nodes[1].mesh = pane(**GLASS | {"transmission": 0.0})
    solid = rj.render(scene, CAMERA, size=(160, 130), quality=quality, threads=1).color
    beside = rj.render(scene, CAMERA, size=(160, 130), outputs=("object_id",)).object_id == -1
    assert (solid[~beside] != frames[0][~beside]).any()


def test_regions_show_what_the_whole_does():
    """What is seen through glass lies in other regions."""
    scene, outputs = busy_scene(), ("color", "linear", "depth")
    scene.remove(scene.find("pane 1"))
    scene.lights = [rj.AmbientLight(intensity=0.3), rj.DirectionalLight((-0.3, -0.2, -1.0))]
    scene.eye_dome = rj.EyeDome(0.5)
    whole = rj.render(scene, CAMERA, size=(200, 150), outputs=outputs, threads=1)
    with RegionRenderer(scene, CAMERA, size=(200, 150), outputs=outputs, threads=2) as renderer:
        for region, frame in renderer.render_regions(64):
            left, top, width, height = region
            part = np.s_[top : top + height, left : left + width]
            for name in outputs:
                assert getattr(frame, name).tobytes() == getattr(whole, name)[part].tobytes(), name


@pytest.mark.parametrize("samples", [1, 64])
def test_regions_with_shadows_or_many_pictures_are_refused_by_name(samples):
    scene = busy_scene()
    scene.lights = scene.lights if samples == 1 else scene.lights[:1]
    with pytest.raises(ValueError, match="the transmission of materials in view must be 0 where a"):
        RegionRenderer(scene, CAMERA, size=(200, 150), quality=rj.Quality(samples=samples))


def test_many_samples_average_pictures_that_see_through_each():
    """Beside edges of the wall's colours, 64 samples show what one does."""
    scene = scene_of(pane(transmission=1.0), behind=wall(filter="bilinear"))
    one, many = (linear(scene, quality=rj.Quality(samples=n)) for n in (1, 64))
    is_glass = covered(scene)
    is_glass[1:-1, 1:-1] &= is_glass[:-2, 1:-1] & is_glass[2:, 1:-1]
    is_glass[:, 1:-1] &= is_glass[:, :-2] & is_glass[:, 2:]
    assert np.abs(one - many)[is_glass].max() < 0.04


def test_glass_and_what_is_blended_are_not_seen_through_glass():
    own, red = pane(transmission=1.0), rj.Material("unlit", (1, 0, 0, 0.5), alpha_mode="blend")
    blended = rj.Mesh(SQUARE * 0.4, FACES, normals=UP, material=red)
    for other in (pane(0.4, transmission=1.0, base_color="red"), blended):
        scene = scene_of(own)
        scene.add(other, PLACE((0, 0, -0.3)))
        assert (linear(scene) == linear(scene_of(own)))[covered(scene)].all()
    over = linear(scene_of(own, blended))
    assert (over != linear(scene_of(own))).any()


def test_a_picture_knows_glass_as_a_surface():
    names = ("depth", "object_id", "face_id", "normal")
    solid, glass = (drawn(scene_of(pane(transmission=t)), outputs=names) for t in (0.0, 1.0))
    for name in names:
        assert getattr(solid, name).tobytes() == getattr(glass, name).tobytes()


def test_before_a_transparent_background_glass_is_black_and_opaque():
    scene = rj.Scene()
    scene.add(pane(transmission=1.0))
    scene.lights = [rj.AmbientLight("black")]
    frame = drawn(scene, background="transparent")
    is_glass = covered(scene, 0)
    assert (frame.linear[is_glass] == [0, 0, 0, 1]).all()
    assert (frame.linear[~is_glass] == 0).all()
    red = drawn(scene, background="red").linear[is_glass]
    assert (red[:, 0] > 0.9).all()
    assert (red[:, 1:3] == 0).all()


def test_the_sky_is_seen_through_glass():
    scene = rj.Scene()
    scene.add(pane(transmission=1.0, specular_factor=0.0))
    scene.environment = rj.Environment.gradient()
    is_glass, sky = covered(scene, 0), rj.Scene()
    sky.add(pane(), PLACE((0, 0, 90)))
    sky.environment = scene.environment
    behind = linear(sky)
    assert linear(scene)[is_glass] == pytest.approx(behind[is_glass], abs=1e-6)


@pytest.mark.parametrize("fog", [
    rj.Fog("#8090a0", density=0.2), rj.Fog("#8090a0", mode="linear", start=1.0, end=9.0),
])  # fmt: skip
def test_fog_covers_what_is_behind_once(fog):
    """A pane that mirrors nothing changes nothing, wherever it stands in the fog."""
    scene, bare = scene_of(pane(transmission=1.0, specular_factor=0.0, ior=1.0)), scene_of()
    for one in (scene, bare):
        one.fog = fog
        one.lights = [rj.AmbientLight("black")]
    is_glass = covered(scene)
    clear = linear(scene_of())
    assert np.abs(linear(bare) - clear)[is_glass].mean() > 0.03
    assert linear(scene)[is_glass] == pytest.approx(linear(bare)[is_glass], abs=1e-6)


def test_fog_covers_what_a_pane_mirrors_by_its_own_distance():
    """A pane of nothing but a mirror is covered as what is opaque, but for its own fog."""
    scene, solid = scene_of(pane(transmission=1.0)), scene_of(pane(base_color="black"))
    bare = scene_of()
    for one in (scene, solid, bare):
        one.fog = rj.Fog("#8090a0", mode="exp", density=0.2)
    is_glass = covered(scene)
    _, inside = shares()
    mist = np.float64(scene.fog.color) * (1.0 - np.exp(-0.2 * distances(scene)))[..., None]
    want = linear(solid) + inside * (linear(bare) - mist)
    assert linear(scene)[is_glass] == pytest.approx(want[is_glass], abs=2e-6)


def distances(scene):
    """Return how far what is seen is, (H, W)."""
    return drawn(scene, outputs=("distance",)).distance.astype(np.float64)


@pytest.mark.parametrize("laid", [
    {"clearcoat": 1.0}, {"sheen_color": "white", "sheen_roughness": 0.5},
    {"clearcoat": 0.6, "clearcoat_roughness": 0.4, "sheen_color": "white", "ior": 1.8},
    {"transmission": 0.6, "clearcoat": 1.0, "sheen_color": "white", "sheen_roughness": 0.9},
])  # fmt: skip
def test_what_lies_over_white_glass_leaves_white_light_as_it_is(laid):
    """Of light from all sides varnish and fibres show what they keep from the glass below."""
    scene = rj.Scene()
    scene.add(pane(**{"transmission": 1.0, "roughness": 0.3, **laid}))
    scene.environment = rj.Environment(np.ones((8, 16, 3), np.float32))
    scene.lights = [rj.AmbientLight(intensity=0.0)]
    tilted = replace(CAMERA, eye=(3.6, 0.4, 1.2))
    for camera in (CAMERA, tilted):
        is_glass = drawn(scene, camera, ("object_id",)).object_id == 0
        assert is_glass.sum() > 100
        assert linear(scene, camera=camera)[is_glass] == pytest.approx(1.0, abs=2e-3)


def test_varnish_hides_what_is_behind_where_it_is_grazed():
    """At a grazing view varnish mirrors most, and lets little through."""
    low = rj.PerspectiveCamera(eye=(0, -4.0, 0.15), target=(0, 0, 0), up=(0, 0, 1), fov_y=30.0)
    board = rj.Mesh(SQUARE * 20.0, FACES, normals=UP, material=rj.Material("unlit", "white"))
    shown = []
    for coat in (0.0, 1.0):
        scene = rj.Scene()
        glass = {"transmission": 1.0, "ior": 1.0, "specular_factor": 0.0, "clearcoat": coat}
        scene.add(pane(**glass))
        scene.add(board, PLACE((0, 5, 0)) @ rj.transforms.rotate_x(90))
        scene.lights = [rj.AmbientLight("black")]
        is_glass = drawn(scene, low, ("object_id",)).object_id == 0
        shown.append(linear(scene, camera=low)[is_glass])
    cosine = 0.15 / math.hypot(4.0, 0.15)
    left = 1.0 - (0.04 + 0.96 * (1.0 - cosine) ** 5)
    assert shown[0] == pytest.approx(1.0, abs=1e-5)
    assert np.median(shown[1]) == pytest.approx(left, abs=0.03)


def test_metal_in_glass_mirrors_as_much_as_metal():
    """What is half metal and half glass sends nothing back diffusely."""

    def lit(**options):
        scene = rj.Scene()
        scene.add(pane(roughness=0.2, **{"base_color": (0.5, 0.5, 0.5), **options}))
        scene.lights = [rj.AmbientLight("black"), rj.DirectionalLight((-0.1, -0.1, -1.0))]
        return linear(scene, background="black")[covered(scene, 0)]

    metal, glass = lit(metallic=1.0), lit(base_color="black")
    half = lit(metallic=0.5, transmission=1.0)
    # Of what the glass mirrors, 4 %, a part may be missing.
    assert (half >= 0.499 * metal).all()
    assert (half <= 0.501 * (metal + glass)).all()


@pytest.mark.parametrize(("more", "darkens"), [
    ({"transmission": 1.0}, False), ({"transmission": 0.4}, True),
    ({"transmission": 1.0, "thickness": 0.1}, True),
])  # fmt: skip
def test_clear_panes_cast_no_shadow(more, darkens):
    scene = scene_of(pane(0.3, **more), behind=lit_wall())
    scene.lights = [rj.DirectionalLight((-0.8, 0.0, -1.0), shadow=rj.Shadow(size=256))]
    bare = scene_of(behind=lit_wall())
    bare.lights = scene.lights
    beside = ~covered(scene)
    assert (linear(scene)[beside] < 0.5 * linear(bare)[beside]).any() == darkens


def lit_wall():
    return rj.Mesh(SQUARE * 2.5, FACES, normals=UP, material=rj.Material("phong", specular=0.0))


def test_what_is_seen_through_a_pane_has_its_shadow():
    """The shadow of a ball on the wall is seen through a pane as it is without it."""

    def shaded(*meshes):
        scene = scene_of(*meshes, behind=lit_wall())
        scene.add(rj.Points([(0.3, 0.0, -0.6)], size=0.4, unit="world"))
        scene.lights = [rj.DirectionalLight((-0.5, 0.0, -1.0), shadow=rj.Shadow(size=512))]
        return scene

    scene = shaded(pane(transmission=1.0, specular_factor=0.0))
    is_glass = covered(scene)
    have, want = linear(scene)[is_glass], linear(shaded())[is_glass]
    assert (want < 0.1).any()
    # Maps are fitted to each picture: their edges may lie a texel apart.
    assert (np.abs(have - want) > 1e-5).mean() < 0.02


def test_a_lens_that_takes_several_pictures_is_refused():
    with pytest.raises(ValueError, match="the transmission of materials in view must be 0"):
        rj.render(
            busy_scene(),
            CAMERA,
            size=(64, 32),
            lens=rj.Equirectangular(),
            outputs=("distance", "linear"),
        )


def test_explain_pixel_tells_what_is_seen_through_glass():
    scene = scene_of(pane(**GLASS))
    told = rj.explain_pixel(scene, CAMERA, SIZE, 30, 22)
    frame = drawn(scene)
    assert told.linear[:3] == pytest.approx(frame.linear[22, 30, :3], abs=1e-6)
    (through,) = [term for term in told.light.lights if term.name == "what is seen through it"]
    assert "what is seen through it" in str(told)
    assert np.abs(through.diffuse).max() > 0.01


def test_plans_tell_what_is_drawn_before():
    plan = rj.explain(scene_of(pane(transmission=1.0)), CAMERA, size=SIZE)
    assert "transmission             in  (1 transmitting object)" in str(plan)
