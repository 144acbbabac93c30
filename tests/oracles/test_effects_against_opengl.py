"""
Effects against real OpenGL: shaders written for the test, drawn by Mesa's llvmpipe.

Both draw the same triangles and light them in linear light. Colours are compared in steps of 8-bit
sRGB, before they are rounded, at the pixels where both show the same face: at silhouettes a vertex
that is rounded to the other point of the sub-pixel grid (see ``test_against_opengl``) shows another
face, and these pixels are counted. What else is left out of a comparison is a mask computed from
data, said at the test, and counted as well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from opengl_effects import (
    BLINN_PHONG,
    FOG,
    LIGHTS,
    MATT_UNDER_SKY,
    MICROFACET_PARTS,
    PHONG_PARTS,
    SHADOW,
    SKY,
    TO_UNIT,
    TONE_CURVES,
    WHITE_METAL_UNDER_SKY,
    Difference,
    Seen,
    Shape,
    Sheet,
    clip_from_world,
    compiled,
    difference,
    draw_scene,
    light_uniforms,
    material_uniforms,
    plane,
    sample_positions,
    shadow_map,
    sphere,
    to_clip,
    torus,
    upload,
)

import rasterjit as rj
from rasterjit.scene import transforms as tf

pytestmark = pytest.mark.usefixtures("own_process")

SIZE = (320, 240)

OTHER_FACES = 2e-3
"""Most of the covered pixels that may show another face than OpenGL's."""

OUTPUTS = ("linear", "face_id")


def scene_of(shapes, materials, lights=()):
    scene = rj.Scene()
    for shape, material in zip(shapes, materials, strict=True):
        scene.add(shape.mesh(material))
    scene.lights = list(lights)
    return scene


def colored(shape: Shape, color) -> Shape:
    """Return a shape of one colour, linear RGBA."""
    return replace(shape, colors=np.tile(np.float32(color), (len(shape.positions), 1)))


def same_faces(frame, seen: Seen) -> NDArray[np.bool_]:
    """Return where both show the same face, having asserted that nearly all pixels do."""
    either = (frame.face_id >= 0) | (seen.face_id >= 0)
    same = either & (frame.face_id == seen.face_id)
    left_out = int(either.sum() - same.sum())
    print(f"{left_out} of {either.sum()} covered pixels show another face")
    assert left_out <= OTHER_FACES * either.sum()
    return same


def check(found: Difference, *, mean: float, beyond: float, pixels: int = 10_000) -> None:
    """Assert that two pictures are as near as they are known to be."""
    assert found.pixels >= pixels
    assert found.mean <= mean, found
    assert found.beyond <= beyond, found


# Textures


def pattern(side: int = 256) -> NDArray[np.uint8]:
    """Return a picture of fields, ramps and noise, sRGB, with something to see at every size."""
    random = np.random.default_rng(5)
    y, x = np.mgrid[0:side, 0:side]
    fields = ((x // 16 + y // 16) % 2 * 120).astype(np.int64)
    image = np.stack([60 + fields, 255 * x // side, 255 * y // side], axis=2)
    image += random.integers(-40, 41, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def decoded(codes: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return sRGB codes as linear RGBA (IEC 61966-2-1)."""
    value = codes / 255.0
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return np.concatenate([linear, np.ones((*codes.shape[:2], 1))], axis=2)


TEXTURED = (
    """
uniform sampler2D picture;
vec4 shade() { return texture(picture, place); }
""",
)

FLOOR = plane((-4.0, -1.0, 6.0), (8.0, 0.0, 0.0), (0.0, 0.0, -14.0), steps=4, repeats=5.0)
FLOOR_CAMERA = rj.PerspectiveCamera((0.3, 0.6, 4.0), (0.0, -0.4, 0.0), fov_y=50.0)
TORUS_CAMERA = rj.PerspectiveCamera((0.4, 1.9, 2.2), (0.0, 0.0, 0.0), fov_y=45.0)


def draw_textured(shape: Shape, camera, filter: str, wrap: str = "repeat", **options):
    """Return our frame and OpenGL's picture of a shape that shows the pattern, unlit."""
    image = pattern()
    texture = rj.Texture(image, filter=filter, wrap=wrap, **options)
    material = rj.Material("unlit", base_color_texture=texture)
    frame = rj.render(scene_of([shape], [material]), camera, size=SIZE, outputs=OUTPUTS)
    uploaded = upload(decoded(image), filter, wrap, options.get("anisotropy", 1))
    seen = draw_scene([shape], camera, SIZE, TEXTURED, textures={"picture": uploaded})
    uploaded.release()
    return frame, seen


@pytest.mark.parametrize(
    ("what", "wrap"), [("floor", "repeat"), ("floor", "clamp"), ("torus", "repeat")]
)
@pytest.mark.parametrize("filter", ["nearest", "bilinear", "trilinear"])
def test_textures_are_opengl_s(what, filter, wrap):
    """
    All pixels are compared; some stand on other texels.

    On a border between two texels float32 coordinates decide, and OpenGL's level of detail is one
    for two by two pixels, from differences between them.
    """
    mean, beyond = {"nearest": (0.3, 0.01), "bilinear": (0.2, 0.05), "trilinear": (0.4, 0.2)}[
        filter
    ]
    shape, camera = (FLOOR, FLOOR_CAMERA) if what == "floor" else (torus(), TORUS_CAMERA)
    frame, seen = draw_textured(shape, camera, filter, wrap)
    check(difference(frame.linear, seen.linear, same_faces(frame, seen)), mean=mean, beyond=beyond)


ALONG_FOOTPRINT = (
    """
uniform sampler2D picture;
uniform float most;
vec4 shade() {
    vec2 right = dFdx(place) * textureSize(picture, 0);
    vec2 down = dFdy(place) * textureSize(picture, 0);
    float longer = max(length(right), length(down));
    float shorter = max(min(length(right), length(down)), 1.0);
    float parts = clamp(longer / shorter, 1.0, most);
    int taps = int(ceil(parts - 1e-4));
    vec2 way = length(right) > length(down) ? dFdx(place) : dFdy(place);
    vec4 sum = vec4(0.0);
    for (int n = 0; n < taps; ++n) {
        float at = (n + 1.0) / (taps + 1.0) - 0.5;
        sum += textureLod(picture, place + at * way, log2(longer / parts));
    }
    return sum / taps;
}
""",
)

LARGE = 8
"""Rows and columns of points in a pixel that tell what it ought to show."""
STRIPS = 4
"""Parts of such a picture, one below the other: all of it at once takes a gigabyte."""


@pytest.mark.parametrize("most", [1, 2, 8])
@pytest.mark.parametrize("what", ["floor", "torus"])
def test_anisotropic_filtering_takes_trilinear_samples_along_the_footprint(what, most):
    """
    Vulkan's number, level and places of them (section 16.5.8), for footprints above a texel wide.

    OpenGL takes derivatives over two by two pixels, so that some have one sample more or less.
    """
    shape, camera = (FLOOR, FLOOR_CAMERA) if what == "floor" else (torus(), TORUS_CAMERA)
    frame, _ = draw_textured(shape, camera, "trilinear", anisotropy=most)
    uploaded = upload(decoded(pattern()), "trilinear")
    textures = {"picture": uploaded}
    seen = draw_scene([shape], camera, SIZE, ALONG_FOOTPRINT, {"most": most}, textures)
    uploaded.release()
    check(difference(frame.linear, seen.linear, same_faces(frame, seen)), mean=0.15, beyond=0.05)


def true_picture(shape, camera):
    """Return the light at the points of each pixel, averaged, and whether all show the shape."""
    uploaded = upload(decoded(pattern()), "bilinear")
    width, height = SIZE[0], SIZE[1] // STRIPS
    large = LARGE * width, LARGE * height
    projection = camera.projection_matrix((large[0], large[1] * STRIPS))
    light, is_whole = [], []
    for strip in range(STRIPS):
        # Its rows fill the picture.
        part = np.diag([1.0, STRIPS, 1.0, 1.0])
        part[1, 3] = 2 * strip + 1 - STRIPS
        own = rj.MatrixCamera(camera.view_matrix(), part @ projection)
        seen = draw_scene([shape], own, large, TEXTURED, textures={"picture": uploaded})
        points = height, LARGE, width, LARGE
        light.append(seen.linear.reshape(*points, 4).mean(axis=(1, 3)))
        is_whole.append((seen.face_id >= 0).reshape(points).all(axis=(1, 3)))
    uploaded.release()
    return np.concatenate(light), np.concatenate(is_whole)


@pytest.mark.parametrize("what", ["floor", "torus"])
def test_anisotropic_filtering_is_nearer_to_the_truth_than_mesa_s(what):
    """
    OpenGL leaves the filter to the driver; Mesa's is an elliptical Gaussian, wider than a pixel.

    So the two differ by more than a step, and the truth decides: the mean over a pixel of a
    picture of eight times the width and height.
    """
    shape, camera = (FLOOR, FLOOR_CAMERA) if what == "floor" else (torus(), TORUS_CAMERA)
    frame, seen = draw_textured(shape, camera, "trilinear", anisotropy=8)
    truth, is_whole = true_picture(shape, camera)
    where = same_faces(frame, seen) & is_whole
    ours, theirs = difference(frame.linear, truth, where), difference(seen.linear, truth, where)
    assert ours.mean < theirs.mean


# Light


def test_phong_is_opengl_s():
    lights = [
        rj.AmbientLight(intensity=0.15),
        rj.DirectionalLight((-0.5, -1.0, -0.3), (1.0, 0.9, 0.8), 0.7),
        rj.PointLight((1.0, 2.0, 2.0), (0.5, 0.7, 1.0), 2.5),
    ]
    material = rj.Material("phong", base_color=(0.7, 0.5, 0.3), specular=0.4, shininess=30.0)
    shapes = [torus(), plane((-3.0, -0.6, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0))]
    scene = scene_of(shapes, [material] * 2, lights)
    frame = rj.render(scene, TORUS_CAMERA, size=SIZE, outputs=OUTPUTS)
    uniforms = {**light_uniforms(lights), **material_uniforms(material)}
    seen = draw_scene(shapes, TORUS_CAMERA, SIZE, PHONG_PARTS, uniforms)
    check(difference(frame.linear, seen.linear, same_faces(frame, seen)), mean=0.01, beyond=1e-3)


def lit_pair(shapes, material, lights, camera=TORUS_CAMERA, parts=PHONG_PARTS, **uniforms):
    """Return our frame and OpenGL's picture of shapes of one material."""
    scene = scene_of(shapes, [material] * len(shapes), lights)
    frame = rj.render(scene, camera, size=SIZE, outputs=OUTPUTS)
    everything = {**light_uniforms(lights), **material_uniforms(material), **uniforms}
    return frame, draw_scene(shapes, camera, SIZE, parts, everything)


STAGE = plane((-3.0, -0.6, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0))
"""A floor under the torus."""


@pytest.mark.parametrize("inner", [0.0, 18.0, 25.0])
def test_spot_lights_are_those_of_gltf(inner):
    """An inner angle equal to the outer one gives a step, full light up to there."""
    lights = [
        rj.SpotLight(
            (1.0, 3.0, 1.0), (-0.3, -1.0, -0.2), (1.0, 0.8, 0.6), 9.0,
            inner_angle=inner, outer_angle=25.0,
        ),
        rj.SpotLight((-1.0, 2.0, 2.0), (0.2, -1.0, -0.6), "white", 4.0, range=3.5),
    ]  # fmt: skip
    material = rj.Material("phong", base_color=(0.7, 0.5, 0.3), specular=0.4, shininess=30.0)
    frame, seen = lit_pair([torus(), STAGE], material, lights)
    check(difference(frame.linear, seen.linear, same_faces(frame, seen)), mean=0.01, beyond=1e-3)
    assert (frame.linear[:, :, :3].max(axis=2) == 0.0).any()


def test_a_point_light_ends_at_its_range():
    lights = [rj.PointLight((0.5, 1.2, 0.5), (0.9, 1.0, 0.8), 2.0, range=2.5)]
    material = rj.Material("phong", base_color="white", specular=0.4, shininess=30.0)
    frame, seen = lit_pair([torus(), STAGE], material, lights)
    where = same_faces(frame, seen)
    check(difference(frame.linear, seen.linear, where), mean=0.01, beyond=1e-3)
    assert ((frame.linear[:, :, :3].max(axis=2) == 0.0) & where).sum() > 1000


@pytest.mark.parametrize(
    ("metallic", "roughness"), [(0, 0.2), (0, 1), (1, 0.3), (0.5, 0.6), (1, 1)]
)
def test_microfacets_are_those_of_gltf(metallic, roughness):
    lights = [
        rj.DirectionalLight((-0.5, -1.0, -0.3), (1.0, 0.9, 0.8), 0.7),
        rj.PointLight((1.0, 2.0, 2.0), (0.5, 0.7, 1.0), 1.5),
    ]
    material = rj.Material(
        "pbr", base_color=(0.8, 0.5, 0.2), metallic=metallic, roughness=roughness
    )
    frame, seen = lit_pair([torus(), STAGE], material, lights, parts=MICROFACET_PARTS)
    check(difference(frame.linear, seen.linear, same_faces(frame, seen)), mean=0.02, beyond=2e-3)


# Fog

FOGGY = (FOG, """
vec4 shade() {
    float share = fog_share(distance(eye, world));
    return vec4(mix(fog_color, tint.rgb, share), 1.0);
}
""")  # fmt: skip


@pytest.mark.parametrize(
    ("mode", "settings"),
    [
        ("linear", {"start": 3.0, "end": 9.0}),
        ("exp", {"density": 0.25}),
        ("exp2", {"density": 0.15}),
    ],
)
def test_fog_is_opengl_s(mode, settings):
    """Distances are measured from the eye straight to the surface, as ``GL_EYE_RADIAL_NV`` does."""
    fog = rj.Fog((0.4, 0.5, 0.7), mode=mode, **settings)
    shape = colored(FLOOR, (0.6, 0.3, 0.1, 1.0))
    scene = scene_of([shape], [rj.Material("unlit", base_color="white")])
    scene.fog = fog
    frame = rj.render(scene, FLOOR_CAMERA, size=SIZE, outputs=OUTPUTS)
    uniforms = {
        "fog_color": fog.color,
        "fog_mode": ("linear", "exp", "exp2").index(mode),
        **{f"fog_{name}": value for name, value in settings.items()},
    }
    seen = draw_scene([shape], FLOOR_CAMERA, SIZE, FOGGY, uniforms)
    where = same_faces(frame, seen)
    check(difference(frame.linear, seen.linear, where), mean=0.01, beyond=0)
    assert np.ptp(frame.linear[where][:, 0]) > 0.05


# Transparency

PLAIN = ("vec4 shade() { return tint; }",)


def pane(z: float, random: np.random.Generator) -> Shape:
    """Return a tilted rectangle about a depth, with its own colours and alpha at each corner."""
    corner = np.array([*random.uniform(-1.6, -0.4, 2), z + random.uniform(-0.1, 0.1)])
    right, up = (np.append(random.uniform(0.0, 0.2, 2), random.uniform(-0.1, 0.1)) for _ in "ab")
    right[0] += 1.6
    up[1] += 1.4
    shape = plane(corner, right, up)
    shape.colors = random.uniform(0.1, 1.0, (len(shape.positions), 4)).astype(np.float32)
    return shape


@pytest.mark.parametrize("background", [(0.0, 0.0, 0.0), (0.2, 0.5, 0.9)])
def test_layers_are_those_blended_back_to_front(background):
    """Eight panes that do not cross, in front of and behind one that is opaque."""
    random = np.random.default_rng(3)
    panes = [pane(z, random) for z in np.linspace(-2.0, 1.5, 8)]
    solid = plane((-0.8, -0.8, -0.75), (1.6, 0.3, 0.0), (0.0, 1.6, 0.1))
    solid = colored(solid, (0.8, 0.7, 0.2, 1.0))
    camera = rj.PerspectiveCamera((0.2, 0.1, 5.0), (0.0, 0.0, 0.0), fov_y=40.0)
    order = random.permutation(len(panes))
    glass = rj.Material("unlit", base_color="white", alpha_mode="blend")
    scene = scene_of(
        [solid, *(panes[n] for n in order)],
        [rj.Material("unlit", base_color="white"), *[glass] * len(panes)],
    )
    frame = rj.render(scene, camera, size=SIZE, outputs=("linear",), background=background)
    sheet, program = Sheet(SIZE), compiled(PLAIN)
    sheet.begin((*background, 1.0))
    matrix = clip_from_world(camera, SIZE)
    sheet.draw(program, solid, matrix, {})
    sheet.blend()
    for shape in panes:
        sheet.draw(program, shape, matrix, {})
    seen = sheet.read()
    sheet.release()
    # What lies on a border may be a layer more or less.
    counts = coverage_counts([solid, *panes], camera)
    where = counts.min(axis=0) == counts.max(axis=0)
    print(f"{(~where).sum()} pixels within a hundredth of a pixel of a border are left out")
    assert (~where).sum() < 0.005 * where.size
    check(difference(frame.linear, seen.linear, where), mean=0.002, beyond=0)
    assert counts[0].max() >= 6


def coverage_counts(shapes, camera) -> NDArray[np.int64]:
    """Return how many shapes cover each pixel, (5, H, W), drawn straight and moved a little."""
    moved = []
    for right, down in ((0, 0), (1, 1), (-1, 1), (1, -1), (-1, -1)):
        matrix = np.eye(4)
        matrix[0, 3], matrix[1, 3] = 0.02 * right / SIZE[0], 0.02 * down / SIZE[1]
        counts = np.zeros(SIZE[::-1], np.int64)
        for shape in shapes:
            clip = to_clip(matrix @ clip_from_world(camera, SIZE), shape.positions)
            counts += rj.rasterize(clip, shape.faces, SIZE).face_id >= 0
        moved.append(counts)
    return np.stack(moved)


CUT = (
    """
uniform sampler2D picture;
uniform float cutoff;
vec4 shade() {
    vec4 texel = texture(picture, place);
    if (texel.a < cutoff) discard;
    return texel;
}
""",
)


@pytest.mark.parametrize("filter", ["nearest", "bilinear", "trilinear"])
def test_a_mask_cuts_what_discard_cuts(filter):
    """
    The share of pixels that one side cuts and the other does not is bounded, all others compared.

    Where alpha crosses the cutoff the last bits of a filter decide. There we show nothing of the
    colours of holes, which OpenGL mixes in, so colours are compared away from it. Far away we keep
    the share of texels that are there: mip levels cut about as many pixels, not the same.
    """
    y, x = np.mgrid[0:256, 0:256]
    image = np.dstack([pattern(), np.zeros((256, 256), np.uint8)])
    image[:, :, 3] = np.clip(127.5 + 6.0 * (26.0 - np.hypot(x % 64 - 32, y % 64 - 32)), 0, 255)
    texture = rj.Texture(image, filter=filter)
    material = rj.Material("unlit", base_color_texture=texture, alpha_mode="mask", alpha_cutoff=0.4)
    back = plane((-4.0, -3.0, -3.0), (8.0, 0.0, 0.0), (0.0, 6.0, 0.0))
    back = colored(back, (0.1, 0.3, 0.6, 1.0))
    front = torus()
    scene = scene_of([front, back], [material, rj.Material("unlit", base_color="white")])
    frame = rj.render(scene, TORUS_CAMERA, size=SIZE, outputs=OUTPUTS)
    linear = decoded(image[:, :, :3])
    linear[:, :, 3] = image[:, :, 3] / 255.0
    uploaded = upload(linear, filter)
    sheet, matrix = Sheet(SIZE), clip_from_world(TORUS_CAMERA, SIZE)
    sheet.begin()
    uploaded.use(0)
    sheet.draw(compiled(CUT), front, matrix, {"picture": 0, "cutoff": 0.4})
    sheet.draw(compiled(PLAIN), back, matrix, {})
    seen = sheet.read()
    sheet.release()
    uploaded.release()
    same = frame.face_id == seen.face_id
    print(f"{(~same).sum()} pixels are cut by one side only")
    count, wanted = (
        np.count_nonzero((faces >= 0) & (faces < len(front.faces)))
        for faces in (frame.face_id, seen.face_id)
    )
    assert abs(count - wanted) <= 0.01 * wanted
    assert (~same).mean() <= {"nearest": 0.001, "bilinear": 0.001, "trilinear": 0.03}[filter]
    shows_torus = same & (frame.face_id >= 0) & (frame.face_id < len(front.faces))
    is_cut = same & (frame.face_id >= len(front.faces)) & drawn_uncut(front, TORUS_CAMERA)
    assert min(shows_torus.sum(), is_cut.sum()) > 1000
    beyond = {"nearest": 0.005, "bilinear": 0.005, "trilinear": 0.1}[filter]
    covered = same & (frame.face_id >= 0) & (seen.linear[:, :, 3] > 0.45)
    check(difference(frame.linear, seen.linear, covered), mean=0.3, beyond=beyond)


def drawn_uncut(shape, camera) -> NDArray[np.bool_]:
    """Return the pixels that a shape covers by itself."""
    clip = to_clip(clip_from_world(camera, SIZE), shape.positions)
    return rj.rasterize(clip, shape.faces, SIZE).face_id >= 0


# Multisampling


def test_samples_lie_where_opengl_has_them():
    """The coverage of one small square, moved over a pixel, tells where the samples are."""
    places = sample_positions(4)
    standard = np.array([(6, 2), (14, 6), (2, 10), (10, 14)]) / 16.0
    np.testing.assert_array_equal(places, standard)


@pytest.mark.parametrize("what", ["soup", "torus"])
def test_four_samples_cover_what_opengl_s_cover(what):
    """Both take the same four positions of a pixel, so the shares are equal, but for the grid."""
    camera = rj.OrthographicCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), height=2.0)
    if what == "soup":
        random = np.random.default_rng(8)
        middle = random.uniform((-1.2, -0.9, -1.0), (1.2, 0.9, 1.0), (400, 3))
        corners = middle[:, None] + random.normal(size=(400, 3, 3)) * (0.05, 0.05, 0.0)
        shape = Shape(corners.reshape(-1, 3), np.arange(1200, dtype=np.int32).reshape(-1, 3))
    else:
        shape, camera = torus(), TORUS_CAMERA
    shape = colored(shape, (1.0, 1.0, 1.0, 1.0))
    scene = scene_of([shape], [rj.Material("unlit", base_color="white")])
    frame = rj.render(
        scene, camera, size=SIZE, outputs=("linear",), background="black",
        quality=rj.Quality(samples=4),
    )  # fmt: skip
    seen = draw_scene([shape], camera, SIZE, PLAIN, samples=4)
    ours, theirs = frame.linear[:, :, 0], np.round(4.0 * seen.linear[:, :, 0]) / 4.0
    np.testing.assert_allclose(theirs, seen.linear[:, :, 0], atol=1e-6)
    np.testing.assert_array_equal(4.0 * ours, np.round(4.0 * ours))
    partly = ((theirs > 0.0) & (theirs < 1.0)).sum()
    print(f"{partly} pixels partly covered, {(ours != theirs).sum()} covered otherwise")
    assert partly > 500
    assert (ours != theirs).sum() <= OTHER_FACES * (theirs > 0.0).sum()


def test_four_samples_of_lit_faces_are_opengl_s():
    """
    Where a silhouette runs through a pixel, OpenGL shades a face at the pixel's centre, outside it.

    So a colour there may be another's; all pixels are compared.
    """
    lights = [
        rj.AmbientLight(intensity=0.15),
        rj.DirectionalLight((-0.5, -1.0, -0.3), (1.0, 0.9, 0.8), 0.7),
    ]
    material = rj.Material("phong", base_color=(0.7, 0.5, 0.3), specular=0.4, shininess=30.0)
    shapes = [torus(), STAGE]
    scene = scene_of(shapes, [material] * 2, lights)
    quality = rj.Quality(samples=4)
    frame = rj.render(
        scene, TORUS_CAMERA, size=SIZE, outputs=("linear",), background="black", quality=quality
    )
    uniforms = {**light_uniforms(lights), **material_uniforms(material)}
    seen = draw_scene(
        shapes, TORUS_CAMERA, SIZE, PHONG_PARTS, uniforms, samples=4,
        background=(0.0, 0.0, 0.0, 1.0),
    )  # fmt: skip
    everywhere = np.ones(SIZE[::-1], bool)
    check(difference(frame.linear, seen.linear, everywhere), mean=0.05, beyond=0.01)


# Environments


def panorama() -> NDArray[np.float32]:
    """Return a bright and a dim side, a warm ground and broad clouds, (64, 128, 3), linear."""
    latitude = np.pi * (0.5 - (np.arange(64) + 0.5) / 64)[:, np.newaxis, np.newaxis]
    longitude = 2.0 * np.pi * ((np.arange(128) + 0.5) / 128 - 0.5)[np.newaxis, :, np.newaxis]
    up, side = np.sin(latitude), np.cos(latitude) * np.cos(longitude - 0.7)
    clouds = 0.15 * np.cos(latitude) ** 2 * np.sin(3.0 * longitude)
    image = 0.4 + [0.1, 0.15, 0.25] * up + [0.2, 0.15, 0.1] * side + clouds
    return image.astype(np.float32)


SKY_SIZE = (160, 120)
"""Of pictures that take a thousand directions a pixel."""

BALL_PIXELS = 4000
"""Fewest that show the ball."""

BALL_CAMERA = rj.PerspectiveCamera((0.6, 0.8, 2.8), (0.0, 0.0, 0.0), fov_y=45.0)


def draw_under_sky(material, fragment):
    """Return our frame and OpenGL's picture of a ball that nothing but the sky lights."""
    shape, image = sphere(1.0, bands=48), panorama()
    scene = scene_of([shape], [material])
    scene.environment = rj.Environment(image, background=False)
    outputs = (*OUTPUTS, "normal", "position")
    frame = rj.render(scene, BALL_CAMERA, size=SKY_SIZE, outputs=outputs)
    uploaded = upload(np.dstack([image, np.ones(image.shape[:2])]), "bilinear")
    uploaded.repeat_y = False
    uniforms = material_uniforms(material)
    textures = {"panorama": uploaded}
    seen = draw_scene([shape], BALL_CAMERA, SKY_SIZE, (SKY, fragment), uniforms, textures)
    uploaded.release()
    return frame, seen


def test_a_matt_surface_under_a_sky_shows_the_mean_of_what_it_faces():
    """Nine harmonics stand for the sky; OpenGL takes the mean over 1152 directions a pixel."""
    material = rj.Material("phong", base_color=(0.9, 0.7, 0.5), specular=0.0)
    frame, seen = draw_under_sky(material, MATT_UNDER_SKY)
    where = same_faces(frame, seen)
    found = difference(frame.linear, seen.linear, where)
    check(found, mean=1.0, beyond=0.2, pixels=BALL_PIXELS)
    assert np.ptp(frame.linear[where][:, 0]) > 0.1


FACING = 0.7
"""Cosine of the viewer above which a lobe is nearly round."""


@pytest.mark.parametrize("roughness", [0.0, 0.3, 0.6])
def test_a_white_metal_under_a_sky_mirrors_what_its_facets_face(roughness):
    """
    One look into a filtered picture stands for the mean over 1024 facets at each pixel.

    The picture is filtered for a viewer in the mirrored direction (split sum): seen at an angle a
    rough surface has a longer lobe, so half a step more is allowed towards the ball's border.
    """
    material = rj.Material("pbr", base_color="white", metallic=1.0, roughness=roughness)
    frame, seen = draw_under_sky(material, WHITE_METAL_UNDER_SKY)
    where = same_faces(frame, seen)
    toward = BALL_CAMERA.eye_position() - frame.position
    cosine = (frame.normal * toward).sum(axis=2) / np.linalg.norm(toward, axis=2)
    facing = where & (cosine > FACING)
    print(f"{(where & ~facing).sum()} pixels are seen at an angle")
    for some, mean, beyond in ((facing, 1.0, 0.5), (where, 1.5, 0.7)):
        found = difference(frame.linear, seen.linear, some)
        check(found, mean=mean, beyond=beyond, pixels=BALL_PIXELS // 2)
    assert np.ptp(frame.linear[where][:, 0]) > 0.1


# Tone mapping


@pytest.mark.parametrize(
    ("curve", "options"),
    [
        ("none", {"exposure": -1.0}),
        ("reinhard", {"exposure": 1.0}),
        ("reinhard", {"white": 4.0}),
        ("aces", {"exposure": 0.5}),
        ("neutral", {"exposure": 1.0}),
    ],
)
def test_tone_curves_are_those_of_the_shader(curve, options):
    """Compare 8-bit codes, which may differ by one where the value lies between two of them."""
    lights = [rj.PointLight((0.4, 1.0, 0.6), (1.0, 0.6, 0.3), 6.0), rj.AmbientLight(intensity=0.1)]
    material = rj.Material("phong", base_color=(0.9, 0.8, 0.7), specular=1.0, shininess=30.0)
    shapes = [torus(), STAGE]
    scene = scene_of(shapes, [material] * 2, lights)
    scene.tone_map = rj.ToneMap(curve, **options)
    frame = rj.render(scene, TORUS_CAMERA, size=SIZE, outputs=("color", *OUTPUTS))
    lit = PHONG_PARTS[-1].replace("vec4 shade()", "vec4 lit()")
    parts = (*PHONG_PARTS[:-1], lit, TONE_CURVES,
             "vec4 shade() { return vec4(shown(lit().rgb), 1.0); }")  # fmt: skip
    uniforms = {
        **light_uniforms(lights), **material_uniforms(material),
        "curve": ("none", "reinhard", "aces", "neutral").index(curve),
        "exposure": options.get("exposure", 0.0), "white": options.get("white", 1e18),
    }  # fmt: skip
    seen = draw_scene(shapes, TORUS_CAMERA, SIZE, parts, uniforms)
    where = same_faces(frame, seen)
    theirs = np.floor(255.0 * seen.linear[where][:, :3].astype(np.float64) + 0.5)
    apart = np.abs(frame.color[where][:, :3] - theirs)
    print(f"{where.sum()} pixels, largest {apart.max()}, {(apart > 0).mean():.4%} differ")
    assert frame.linear[where].max() > 2.0
    assert apart.max() <= 1.0
    assert (apart > 0.0).mean() <= 0.003


# Shadows

SHADOWED = (
    LIGHTS,
    BLINN_PHONG,
    SHADOW,
    """
uniform vec4 base_color;
vec4 shade() {
    vec3 normal = turned_normal();
    vec3 viewer = normalize(eye - world);
    vec3 base = base_color.rgb * tint.rgb;
    vec3 arriving;
    vec3 light = toward_light(0, arriving);
    vec3 lit = blinn_phong(base, normal, viewer, light, arriving * lit_share(1));
    return vec4(ambient * base + lit, 1.0);
}
""",
)
NEAR_BORDER = (
    SHADOW,
    "uniform int reach; vec4 shade() { return vec4(vec3(lit_share(reach)), 1.0); }",
)

MAP_SIDE = 2048
BIAS = 5e-4
"""Of OpenGL's comparison, a share of the depths that its map spans."""
BORDER_TEXELS = 4
"""How many texels of OpenGL's map from the border of a shadow both must agree."""
BORDER_BIAS = 4e-3
"""So far in front of a surface is what darkens it, or texels on a slope would find each other."""
GRAZING = 0.25
"""Cosine between a face and the light below which OpenGL's map is too coarse for the face."""
STAGE_CAMERA = rj.PerspectiveCamera((0.8, 3.0, 4.4), (0.0, -0.3, 0.2), fov_y=45.0)


def looking(eye, target, projection) -> NDArray[np.float64]:
    """Return the matrix of a light that looks from a point at another, light clip from world."""
    return projection @ tf.look_at(eye, target, (0.0, 0.0, -1.0))


def face_cosines(shapes, place) -> NDArray[np.float64]:
    """Return the cosine between each face, of all shapes, and the way to a light at x, y, z, w."""
    found = []
    for shape in shapes:
        a, b, c = (shape.positions[shape.faces[:, n]] for n in range(3))
        normal, toward = np.cross(b - a, c - a), place[:3] - place[3] * (a + b + c) / 3.0
        lengths = np.linalg.norm(normal, axis=1) * np.linalg.norm(toward, axis=-1)
        found.append((normal * toward).sum(axis=1) / np.maximum(lengths, 1e-30))
    return np.concatenate(found)


@pytest.mark.parametrize("kind", ["directional", "spot"])
def test_shadows_are_those_of_a_map_that_opengl_drew(kind):
    """
    Our map is fitted in another way, so texels lie elsewhere: the borders of shadows are left out.

    A pixel is near a border if OpenGL's map is neither all light nor all dark within four texels
    around it, or if the light grazes its face: there the faces of a round mesh shadow themselves
    while their normals are lit, and a map read without the face's own plane shows its texels. The
    mean over all pixels, these included, is held to one step as well.
    """
    shadow = rj.Shadow(size=MAP_SIDE, filter="pcf")
    if kind == "directional":
        light = rj.DirectionalLight((-0.4, -1.0, -0.3), "white", 0.9, shadow=shadow)
        away = np.multiply(light.direction, -10.0)
        matrix = looking(away, (0, 0, 0), tf.orthographic(-4.5, 4.5, -4.5, 4.5, 4.0, 16.0))
    else:
        light = rj.SpotLight(
            (1.0, 4.0, 1.0), (-0.25, -1.0, -0.25), "white", 12.0, 25.0, 35.0, shadow=shadow
        )
        target = np.add(light.position, light.direction)
        matrix = looking(light.position, target, tf.perspective(72.0, 1.0, 1.0, 12.0))
    lights = [rj.AmbientLight(intensity=0.1), light]
    box = sphere(0.35, (-1.4, 0.1, 0.9))
    shapes = [torus(), STAGE, box]
    material = rj.Material("phong", base_color=(0.7, 0.6, 0.5), specular=0.3, shininess=30.0)
    scene = scene_of(shapes, [material] * len(shapes), lights)
    frame = rj.render(scene, STAGE_CAMERA, size=SIZE, outputs=OUTPUTS)
    uploaded = shadow_map(shapes, matrix, MAP_SIDE)
    uniforms = {
        **light_uniforms(lights), **material_uniforms(material), "shadow_bias": BIAS,
        "shadow_from_world": (TO_UNIT @ matrix).T, "reach": BORDER_TEXELS,
    }  # fmt: skip
    textures = {"shadow_map": uploaded}
    seen = draw_scene(shapes, STAGE_CAMERA, SIZE, SHADOWED, uniforms, textures)
    uniforms["shadow_bias"] = BORDER_BIAS
    near = draw_scene(shapes, STAGE_CAMERA, SIZE, NEAR_BORDER, uniforms, textures).linear[:, :, 0]
    uploaded.release()
    place = (*np.negative(light.direction), 0.0)
    if kind == "spot":
        place = (*light.position, 1.0)
    cosines = face_cosines(shapes, np.array(place))[frame.face_id]
    same, border = same_faces(frame, seen), (near > 0.0) & (near < 1.0)
    grazed = ~border & (np.abs(cosines) < GRAZING)
    print(f"{(same & border).sum()} pixels near a shadow's border are left out,")
    print(f"{(same & grazed).sum()} pixels of faces that the light grazes")
    assert (same & border).sum() < 0.1 * same.sum()
    assert (same & grazed).sum() < 0.1 * same.sum()
    assert (same & (near == 0.0)).sum() > 1000
    compared = same & ~border & ~grazed
    check(difference(frame.linear, seen.linear, compared), mean=0.01, beyond=0.002)
    check(difference(frame.linear, seen.linear, same), mean=0.5, beyond=0.1)
