"""
Render the gallery: ``python models/make_gallery.py [FOLDER [NAME ...]]``.

One picture for each effect, or one sheet for the settings of one effect. Needs RasterJIT installed.
Writes all pictures, or those named, into ``models/pictures/gallery`` unless told otherwise.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from gallery_parts import (
    MODELS,
    PLACE,
    Picture,
    Size,
    arrows,
    ball,
    box,
    bricks,
    checks,
    dressed,
    floor,
    grown,
    in_row,
    in_rows,
    leaf,
    model,
    panel,
    part_of,
    shown,
    studio,
)
from PIL import Image
from surfaces import grid_faces

import rasterjit as rj

SIZE = (480, 360)
"""Width and height of a picture, pixels."""

MAX_BYTES = 110_000
"""Largest file in full colour."""

GALLERY: dict[str, Callable[[Size], Picture]] = {}
"""What makes each picture, by name; all take a size."""

MATT = rj.Material(base_color="#d8d3ca", specular=0.0)
SMOOTH = rj.Quality(samples=4, lines="coverage")


def picture(make: Callable[[Size], Picture]) -> Callable[[Size], Picture]:
    """Enter a function in the gallery."""
    GALLERY[make.__name__] = make
    return make


def sun(intensity: float = 0.8, **more: Any) -> rj.DirectionalLight:
    """Return light from the upper left, from behind the viewer."""
    return rj.DirectionalLight((0.55, -1.0, -0.7), intensity=intensity, **more)


def teapot(material: rj.Material, ground: rj.Material = MATT) -> rj.Scene:
    """Return a teapot on the ground."""
    scene = rj.Scene()
    scene.add(floor(40.0, ground), name="ground")
    scene.add(dressed(model("teapot.obj"), material), PLACE.rotate_y(-25), name="teapot")
    scene.lights = [rj.AmbientLight(intensity=0.25), sun()]
    return scene


TEAPOT_VIEW = rj.PerspectiveCamera(eye=(1.0, 5.2, 10.5), target=(0.15, 1.25, 0.0), fov_y=32.0)


@picture
def shading_models(size: Size) -> Picture:
    """Unlit, flat, Gouraud and Phong."""
    part, pictures = part_of(size, 2, 2), []
    coarse = ball(12, 18)
    for shading in ("unlit", "flat", "gouraud", "phong"):
        look = rj.Material(shading=shading, base_color="#3d7ea6", specular=0.7, shininess=60)
        scene = rj.Scene()
        scene.add(dressed(model("torus_knot.obj"), look), PLACE.translate((-1.2, 0, 0)))
        scene.add(dressed(coarse, look), PLACE.translate((3.6, -1.6, 1.5)))
        scene.lights = [rj.AmbientLight(intensity=0.1), sun(0.9)]
        camera = rj.PerspectiveCamera(eye=(0.6, 1.0, 14.0), target=(0.6, -0.1, 0), fov_y=32.0)
        pictures.append(shown(scene, camera, part))
    return in_rows(pictures, 2)


@picture
def texture_filters(size: Size) -> Picture:
    """Nearest, bilinear, trilinear and 8 times anisotropic, on a floor to the horizon."""
    part, pictures = part_of(size, 2, 2), []
    board = checks(8, 256, 40, 235)
    for options in (
        {"filter": "nearest"}, {"filter": "bilinear"}, {"filter": "trilinear"},
        {"filter": "trilinear", "anisotropy": 8},
    ):  # fmt: skip
        look = rj.Material(shading="unlit", base_color_texture=rj.Texture(board, **options))
        scene = rj.Scene()
        scene.add(floor(200.0, look, repeat=50.0))
        camera = rj.PerspectiveCamera(eye=(0.0, 2.0, 6.0), target=(1.2, 0.9, 0.0), fov_y=45.0)
        pictures.append(shown(scene, camera, part, background="#9db8d0"))
    return in_rows(pictures, 2)


@picture
def texture_wrap(size: Size) -> Picture:
    """Repeat, mirror and clamp, with coordinates from -1 to 2."""
    part, pictures = part_of((size[0], size[1] // 2), 3), []
    for wrap in ("repeat", "mirror", "clamp"):
        texture = rj.Texture(arrows(), wrap=wrap)
        square = panel(2.0, 2.0)
        look = rj.Material(shading="unlit", base_color_texture=texture)
        scene = rj.Scene()
        scene.add(dressed(square, look, uv=np.asarray(square.uv) * 3.0 - 1.0))
        camera = rj.PerspectiveCamera(eye=(0.7, -0.5, 3.4), target=(0.03, 0, 0), fov_y=42.0)
        pictures.append(shown(scene, camera, part))
    return in_row(pictures)


@picture
def alpha_mask(size: Size) -> Picture:
    """Leaves cut out of squares by the alpha of a texture; so are their shadows."""
    look = rj.Material(
        base_color_texture=rj.Texture(leaf(), wrap="clamp"), specular=0.1, alpha_mode="mask"
    )
    square = dressed(panel(2.0, 2.0), look)
    scene = rj.Scene()
    scene.add(floor(30.0, replace(MATT, base_color="#e0d6c2")))
    for number in range(9):
        turn = number * 40.0
        scene.add(
            square,
            PLACE.compose(
                PLACE.rotate_y(turn), PLACE.translate((0.0, 1.15 + 0.35 * (number % 3), 0.75)),
                PLACE.rotate_x(-38.0 + 9.0 * (number % 2)), PLACE.rotate_z(180.0),
            ),
        )  # fmt: skip
    scene.lights = [rj.AmbientLight(intensity=0.35), sun(0.8, shadow=rj.Shadow(size=2048))]
    camera = rj.PerspectiveCamera(eye=(1.5, 4.2, 7.2), target=(0.35, 1.0, 0), fov_y=27.0)
    return shown(scene, camera, size, quality=SMOOTH)


@picture
def metallic_roughness(size: Size) -> Picture:
    """Gold and a painted plastic, from smooth to rough, in a studio."""
    scene, globe = rj.Scene(), ball()
    for row, (color, metallic) in enumerate((("#e8b04a", 1.0), ("#a01e28", 0.0))):
        for column in range(5):
            look = rj.Material(
                shading="pbr", base_color=color, metallic=metallic,
                roughness=0.04 + 0.24 * column,
            )  # fmt: skip
            place = PLACE.translate((2.25 * (column - 2), 1.15 - 2.3 * row, 0.0))
            scene.add(dressed(globe, look), place)
    scene.environment = replace(studio(), rotation=-60.0, intensity=1.6, background=False)
    scene.lights = [sun(0.5)]
    scene.tone_map = rj.ToneMap("neutral")
    camera = rj.PerspectiveCamera(eye=(0.0, 0.0, 24.0), target=(0, 0, 0), fov_y=14.5)
    wide = size[0], size[1] * 2 // 3
    return shown(scene, camera, wide, background="#cfd3d8", quality=SMOOTH)


@picture
def layers(size: Size) -> Picture:
    """Varnish over rough paint, sheen of cloth, tinted mirrors, and ior from 1.1 to 2.4."""
    rows: list[list[rj.Material]] = [
        [
            rj.Material("pbr", "#8c1420", roughness=0.75, clearcoat=share, clearcoat_roughness=0.06)
            for share in (0.0, 0.25, 0.5, 0.75, 1.0)
        ],
        [
            rj.Material("pbr", "#262a58", roughness=1.0, sheen_color=color, sheen_roughness=rough)
            for color, rough in (
                ("black", 0.0), ("#8f96e8", 0.2), ("#8f96e8", 0.35), ("#8f96e8", 0.6),
                ("#e8b0a0", 0.35),
            )
        ],
        [
            rj.Material("pbr", "#1c1f22", roughness=0.2, specular_factor=share, specular_color=tint)
            for share, tint in (
                (0.0, "white"), (0.5, "white"), (1.0, "white"), (1.0, (9.0, 4.0, 0.6)),
                (1.0, (0.6, 5.0, 9.0)),
            )
        ],
        [
            rj.Material("pbr", "#1d3a34", roughness=0.08, ior=ior)
            for ior in (1.1, 1.33, 1.5, 1.8, 2.4)
        ],
    ]  # fmt: skip
    scene, globe = rj.Scene(), ball()
    for row, materials in enumerate(rows):
        for column, material in enumerate(materials):
            place = PLACE.translate((2.25 * (column - 2), 2.25 * (1.5 - row), 0.0))
            scene.add(dressed(globe, material), place)
    scene.environment = replace(studio(), rotation=-60.0, intensity=1.3, background=False)
    scene.lights = [sun(0.8)]
    scene.tone_map = rj.ToneMap("neutral")
    camera = rj.PerspectiveCamera(eye=(0.0, 0.0, 40.0), target=(0, 0, 0), fov_y=13.2)
    return shown(scene, camera, size, background="#aeb4ba", quality=SMOOTH)


@picture
def normal_map(size: Size) -> Picture:
    """A wall of two triangles, without and with a map of its normals."""
    part, pictures = part_of((size[0], size[1] * 2 // 3), 2), []
    color, normals = bricks()
    for texture in (None, rj.Texture(normals, color_space="linear", anisotropy=4)):
        look = rj.Material(
            shading="pbr", metallic=0.0, roughness=0.7, normal_texture=texture,
            base_color_texture=rj.Texture(color, anisotropy=4),
        )  # fmt: skip
        scene = rj.Scene()
        scene.add(dressed(panel(6.0, 6.0, 2.0), look))
        scene.lights = [
            rj.AmbientLight(intensity=0.12),
            rj.PointLight((-1.8, 1.6, 0.9), color="#ffe3b8", intensity=5.5),
        ]
        camera = rj.PerspectiveCamera(eye=(1.7, -0.6, 4.6), target=(-0.1, 0.1, 0), fov_y=45.0)
        pictures.append(shown(scene, camera, part))
    return in_row(pictures)


@picture
def emission(size: Size) -> Picture:
    """A knot that shines by itself, and lamps that light the ground."""
    scene = rj.Scene()
    scene.add(floor(30.0, rj.Material(shading="pbr", base_color="#55606e", roughness=0.45)))
    glow = rj.Material(shading="pbr", base_color="#201008", emissive=(2.2, 0.75, 0.12))
    knot = PLACE.compose(PLACE.translate((0, 2.6, 0)), PLACE.rotate_y(20), PLACE.scale(0.7))
    scene.add(dressed(model("torus_knot.obj"), glow), knot)
    dark = rj.Material(shading="pbr", base_color="#8f9db4", roughness=0.3)
    for x, z in ((-3.6, 1.0), (3.4, 1.6), (0.4, 3.6)):
        scene.add(
            dressed(ball(), dark), PLACE.compose(PLACE.translate((x, 0.8, z)), PLACE.scale(0.8))
        )
    scene.lights = [
        rj.AmbientLight(intensity=0.05),
        rj.PointLight((0, 2.6, 0.9), color="#ff9a40", intensity=26.0),
        rj.PointLight((0, 1.4, -0.9), color="#ff9a40", intensity=12.0),
    ]
    scene.tone_map = rj.ToneMap("aces")
    camera = rj.PerspectiveCamera(eye=(0.6, 4.0, 11.5), target=(0, 1.75, 0), fov_y=34.0)
    return shown(scene, camera, size, background="#0b0e13", quality=SMOOTH)


@picture
def lights(size: Size) -> Picture:
    """Three spot lights, a point light with a range and a little light from all around."""
    scene = rj.Scene()
    scene.add(floor(40.0, replace(MATT, base_color="#c8c8c8")))
    white = rj.Material(base_color="#e4e4e4", specular=0.5, shininess=80)
    scene.add(dressed(model("teapot.obj"), white), PLACE.rotate_y(-25))
    scene.lights = [rj.AmbientLight(intensity=0.03)]
    for x, color in ((-4.0, "#ff5040"), (0.0, "#50e070"), (4.0, "#5070ff")):
        at = np.array([x, 7.5, 5.0])
        scene.lights.append(
            rj.SpotLight(
                at, np.array([x * 0.5, 0.3, 0.5]) - at, color=color, intensity=62.0,
                inner_angle=13.0, outer_angle=17.0, shadow=rj.Shadow(size=1024),
            )
        )  # fmt: skip
    scene.lights.append(rj.PointLight((5.2, 0.7, 1.2), color="#ffc060", intensity=2.5, range=4.0))
    return shown(scene, replace(TEAPOT_VIEW, fov_y=38.0), size, background="black", quality=SMOOTH)


@picture
def environment(size: Size) -> Picture:
    """A panorama lights a metal teapot, is mirrored by it, and seen behind it."""
    metal = rj.Material(shading="pbr", base_color="#f2efe8", metallic=1.0, roughness=0.12)
    scene = rj.Scene()
    scene.add(dressed(model("teapot.obj"), metal), PLACE.rotate_y(-25))
    scene.environment = replace(studio(), rotation=75.0)
    scene.tone_map = rj.ToneMap("neutral", exposure=-0.3)
    camera = rj.PerspectiveCamera(eye=(1.2, 2.4, 10.5), target=(0.15, 1.75, 0.0), fov_y=34.0)
    return shown(scene, camera, size, quality=SMOOTH, background=None)


@picture
def shadows(size: Size) -> Picture:
    """Hard, smoothed by percentage-closer filtering, and soft: wider away from contact."""
    part, pictures = part_of((size[0], size[1] * 2 // 3), 3), []
    pole = dressed(box(0.35, 4.0, 0.35), rj.Material(base_color="#c8643c", specular=0.2))
    for shadow in (
        rj.Shadow(size=512, filter="hard"), rj.Shadow(size=512, filter="pcf"),
        rj.Shadow(size=2048, filter="soft", light_size=6.0),
    ):  # fmt: skip
        scene = rj.Scene()
        scene.add(floor(30.0, MATT))
        scene.add(pole, PLACE.translate((-1.4, 0.0, -0.6)))
        globe = dressed(ball(), rj.Material(base_color="#4a7fb0", specular=0.4))
        scene.add(globe, PLACE.compose(PLACE.translate((0.1, 0.6, 2.6)), PLACE.scale(0.6)))
        light = rj.DirectionalLight((0.8, -1.0, 0.25), intensity=0.8, shadow=shadow)
        scene.lights = [rj.AmbientLight(intensity=0.25), light]
        camera = rj.PerspectiveCamera(eye=(0.7, 5.6, 9.0), target=(0.6, 1.25, 0.4), fov_y=46.0)
        pictures.append(shown(scene, camera, part, quality=SMOOTH))
    return in_row(pictures)


@picture
def transparency(size: Size) -> Picture:
    """Panes of glass that pass through each other and a ball, in any order."""
    scene = rj.Scene()
    scene.add(floor(40.0, rj.Material(base_color_texture=rj.Texture(checks(2), anisotropy=4),
                                      specular=0.0), repeat=20.0))  # fmt: skip
    solid = rj.Material(base_color="#f0e4d0", specular=0.3)
    scene.add(dressed(ball(), solid), PLACE.translate((0.0, 1.6, 0.0)))
    for turn, color in ((15.0, "#d02030"), (75.0, "#1c9c48"), (135.0, "#2050d0")):
        glass = rj.Material(base_color=(*rj_linear(color), 0.45), specular=0.6, alpha_mode="blend")
        scene.add(
            dressed(panel(5.2, 3.2), glass),
            PLACE.compose(PLACE.rotate_y(turn), PLACE.translate((0, 1.62, 0))),
        )
    scene.lights = [rj.AmbientLight(intensity=0.4), sun(0.7, shadow=rj.Shadow())]
    camera = rj.PerspectiveCamera(eye=(2.6, 4.6, 8.2), target=(0, 1.25, 0), fov_y=36.0)
    return shown(scene, camera, size, background="#cfd8e0", quality=SMOOTH)


def rj_linear(color: str) -> tuple[float, ...]:
    """Return a colour as linear red, green and blue."""
    return rj.Material(base_color=color).base_color[:3]


@picture
def fog(size: Size) -> Picture:
    """None, linear, exponential squared, and exponential that lies on the ground."""
    part, pictures = part_of(size, 2, 2), []
    stone = rj.Material(base_color="#b08a62", specular=0.1)
    pillar, gray = dressed(box(0.9, 4.2, 0.9), stone), "#b9c4cf"
    for cover in (
        None, rj.Fog(gray, mode="linear", start=6.0, end=42.0), rj.Fog(gray, density=0.045),
        rj.Fog(gray, mode="exp", density=0.55, height=0.0, falloff=1.3),
    ):  # fmt: skip
        scene = rj.Scene()
        scene.add(floor(400.0, replace(MATT, base_color="#8f9a6c")))
        for row in range(8):
            for side in (-2.6, 2.6):
                scene.add(pillar, PLACE.translate((side, 0.0, 1.0 - 5.0 * row)))
        scene.lights = [rj.AmbientLight(intensity=0.3), sun(0.8, shadow=rj.Shadow(size=2048))]
        scene.fog = cover
        camera = rj.PerspectiveCamera(eye=(0.9, 2.4, 9.0), target=(0, 1.9, 0), fov_y=44.0)
        pictures.append(shown(scene, camera, part, background=gray, quality=SMOOTH))
    return in_rows(pictures, 2)


@picture
def anti_aliasing(size: Size) -> Picture:
    """1, 4 and 16 samples and exact areas, every pixel shown as 3 by 3."""
    part, pictures = part_of(size, 2, 2), []
    spoke = dressed(box(0.09, 2.0, 0.09), rj.Material(shading="unlit", base_color="#20242c"))
    ring = dressed(model("torus_knot.obj"), rj.Material(base_color="#d07a2c", specular=0.4))
    for samples in (1, 4, 16, "area"):
        scene = rj.Scene()
        for number in range(24):
            place = PLACE.rotate_z(15.0 * number + 4.0), PLACE.translate((0.0, 0.4, -1.0))
            scene.add(spoke, PLACE.compose(*place))
        scene.add(ring, PLACE.compose(PLACE.translate((0, 0, 0.8)), PLACE.scale(0.22)))
        camera = rj.PerspectiveCamera(eye=(0, 0, 9.0), target=(0, 0, 0), fov_y=28.0)
        small = max(part[0] // 3, 1), max(part[1] // 3, 1)
        found = shown(scene, camera, small, quality=rj.Quality(samples=samples))
        pictures.append(grown(found, 3))
    return in_rows(pictures, 2)


@picture
def ambient_occlusion(size: Size) -> Picture:
    """Light mostly from all around, without and with what keeps it out of corners."""
    part, pictures = part_of(size, 1, 2), []
    for effect in (None, rj.AmbientOcclusion(radius=1.6)):
        white = rj.Material(base_color="#ece9e2", specular=0.0)
        scene = teapot(white, white)
        knot = PLACE.compose(PLACE.translate((-2.2, 1.5, -3.2)), PLACE.scale(0.55))
        scene.add(dressed(model("torus_knot.obj"), white), knot)
        for n in range(3):
            step = dressed(box(2.4, 0.5 * (n + 1), 1.0), white)
            scene.add(step, PLACE.translate((2.4, 0.0, -2.6 - n)))
        scene.lights = [rj.AmbientLight(intensity=0.75), sun(0.2)]
        scene.ambient_occlusion = effect
        camera = rj.PerspectiveCamera(eye=(0.8, 4.2, 10.5), target=(0.3, 1.2, -0.6), fov_y=25.0)
        pictures.append(shown(scene, camera, part, background="#d8d5cf", quality=SMOOTH))
    return in_rows(pictures, 1)


@picture
def eye_dome(size: Size) -> Picture:
    """Colours without any light, and with what depth alone tells."""
    part, pictures = part_of(size, 1, 2), []
    for effect in (None, rj.EyeDome(0.4)):
        white = rj.Material("unlit", "#ece9e2")
        scene = teapot(rj.Material("unlit", "#9cc3d6"), white)
        knot = PLACE.compose(PLACE.translate((-2.2, 1.5, -3.2)), PLACE.scale(0.55))
        scene.add(dressed(model("torus_knot.obj"), rj.Material("unlit", "#e8a15c")), knot)
        for n in range(3):
            step = dressed(box(2.4, 0.5 * (n + 1), 1.0), white)
            scene.add(step, PLACE.translate((2.4, 0.0, -2.6 - n)))
        scene.eye_dome = effect
        camera = rj.PerspectiveCamera(eye=(0.8, 8.5, 10.0), target=(0.3, 1.1, -1.0), fov_y=27.0)
        pictures.append(shown(scene, camera, part, background="#d8d5cf", quality=SMOOTH))
    return in_rows(pictures, 1)


@picture
def outline(size: Size) -> Picture:
    """Silhouettes, the ends of objects and creases, over flat colours."""
    scene = rj.Scene()
    scene.add(floor(9.0, rj.Material(shading="unlit", base_color="#f3ead8")))
    for name, color, place in (
        ("teapot.obj", "#7fb3c8", PLACE.rotate_y(-25)),
        ("torus_knot.obj", "#e8a15c",
         PLACE.compose(PLACE.translate((-4.4, 2.0, -2.4)), PLACE.rotate_y(35), PLACE.scale(0.6))),
    ):  # fmt: skip
        look = rj.Material(shading="unlit", base_color=color)
        scene.add(dressed(model(name), look), place)
    cube = dressed(box(2.2, 2.2, 2.2), rj.Material(shading="unlit", base_color="#a9c48c"))
    scene.add(cube, PLACE.compose(PLACE.translate((4.4, 0.0, -2.6)), PLACE.rotate_y(28)))
    scene.outline = rj.Outline(color="#2a2420", width=2)
    camera = rj.PerspectiveCamera(eye=(1.5, 5.8, 13.0), target=(0.1, 1.4, -0.6), fov_y=36.0)
    return shown(scene, camera, size, background="#fffaf0", quality=SMOOTH)


@picture
def wireframe(size: Size) -> Picture:
    """The edges of all faces over them, hidden ones removed; and all edges alone."""
    part, pictures = part_of((size[0], size[1] * 2 // 3), 2), []
    for mode, color in (("overlay", "#1d2b3a"), ("only", "#1d4a7a")):
        scene = rj.Scene()
        look = rj.Material(base_color="#9fc0d8", specular=0.2)
        scene.add(dressed(ball(16, 24), look), PLACE.translate((-0.75, 0.0, 0.0)))
        cube = PLACE.compose(PLACE.translate((0.9, -1.0, 0.6)), PLACE.rotate_y(30))
        scene.add(dressed(box(1.1, 1.1, 1.1), look), cube)
        scene.wireframe = rj.Wireframe(color, mode)
        camera = rj.PerspectiveCamera(eye=(0.8, 1.8, 6.0), target=(0.1, -0.1, 0), fov_y=37.0)
        pictures.append(shown(scene, camera, part, quality=SMOOTH))
    return in_row(pictures)


@picture
def scalar_fields(size: Size) -> Picture:
    """A wave in a colour map, with iso-lines and its colour bar."""
    count, half = 81, 4.0
    z, x = np.mgrid[-half : half : count * 1j, -half : half : count * 1j]
    height = 2.2 * np.cos(1.9 * np.hypot(x + 0.8, z - 0.4)) * np.exp(-0.11 * (x * x + z * z))
    points = np.stack([x, 0.4 * height, z], axis=2).reshape(-1, 3)
    wave = rj.Mesh(
        points, grid_faces(count, count)[:, ::-1], scalars=height.ravel(), range=(-2.0, 2.0),
        contours=rj.Contours([-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5], color="#20242c"),
        material=rj.Material("phong", specular=0.15),
    )  # fmt: skip
    scene = rj.Scene()
    scene.add(wave)
    scene.lights = [rj.AmbientLight(intensity=0.55), sun(0.6)]
    bar = rj.render(scene, size=(8, size[1])).colorbar("cm")[:, : size[0] // 2, :3]
    part = size[0] - bar.shape[1], size[1]
    camera = rj.fit_camera(scene, (4.5, 7.3, 9.5), 44.0, aspect=part[0] / part[1])
    return np.hstack([shown(scene, camera, part, background="white"), bar])


@picture
def vector_field(size: Size) -> Picture:
    """The field of a magnet: arrows of one length, coloured by strength."""
    x, z = (part.ravel() for part in np.mgrid[-4.4:4.4:17j, -3.0:3.0:11j])
    outside = np.hypot(x, z) > 1.15
    points = np.stack([x, 0.0 * x, z], axis=1)[outside]
    distance = np.sqrt((points * points).sum(axis=1))[:, np.newaxis]
    field = 3.0 * points[:, :1] * points / distance**5 - np.array([1.0, 0.0, 0.0]) / distance**3
    strength = np.sqrt((field * field).sum(axis=1))
    arrows = rj.Arrows(
        points - 0.25 * field / strength[:, np.newaxis], field / strength[:, np.newaxis],
        scale=0.5, shaft_radius=0.07, head_radius=0.18, head_length=0.45,
        scalars=np.log10(strength), colormap="plasma", range=(-2.0, 0.0),
    )  # fmt: skip
    scene = rj.Scene()
    scene.add(arrows)
    globe = ball()
    poles = np.where(globe.vertices[:, :1] > 0.0, (0.75, 0.05, 0.05), (0.1, 0.15, 0.6))
    scene.add(dressed(globe, rj.Material(specular=0.3), colors=poles), PLACE.scale(0.8))
    axis = rj.Arrow((-1.5, 0.0, 0.0), (1.7, 0.0, 0.0), head_length=0.15, color="#404448")
    scene.add(axis)
    scene.lights = [rj.AmbientLight(intensity=0.4), sun(0.7)]
    camera = rj.fit_camera(scene, (0.0, 7.2, 5.35), 41.0, aspect=size[0] / size[1])
    return shown(scene, camera, size, background="white", quality=SMOOTH)


def revolved(profile: list[tuple[float, float]], steps: int = 72) -> rj.Mesh:
    """Return the ring that a closed profile, (radius, height) counter-clockwise, sweeps."""
    count = len(profile)
    radius, height = np.array(profile).T
    turn = 2.0 * np.pi * np.arange(steps)[:, np.newaxis] / steps
    vertices = np.stack([radius * np.cos(turn), height + 0.0 * turn, -radius * np.sin(turn)], 2)
    row, column = (part.ravel() for part in np.mgrid[0:steps, 0:count])
    after, beside = (row + 1) % steps * count, (column + 1) % count
    faces = [
        (row * count + column, after + column, after + beside),
        (row * count + column, after + beside, row * count + beside),
    ]
    rows = np.concatenate([np.stack(part, axis=1) for part in faces])
    return rj.Mesh(vertices.reshape(-1, 3), rows).split_creases(30.0)


def bearing() -> rj.Scene:
    """Return a ball bearing on a hollow shaft."""
    across, deep = 1.3, 0.42
    bend = np.radians(np.linspace(-60.0, 60.0, 13))
    groove = [(float(deep * np.cos(one)), float(deep * np.sin(one))) for one in bend]
    outer = [(2.05, -0.6), (2.05, 0.6), (across + groove[-1][0], 0.6)]
    outer += [(across + x, y) for x, y in reversed(groove)]
    outer.append((across + groove[0][0], -0.6))
    inner = [(0.7, 0.6), (0.7, -0.6), (across - groove[0][0], -0.6)]
    inner += [(across - x, y) for x, y in groove]
    inner.append((across - groove[-1][0], 0.6))
    steel = rj.Material("pbr", "#c3c7cb", metallic=0.9, roughness=0.35)
    brass = rj.Material("pbr", "#d9a441", metallic=0.9, roughness=0.3)
    blue = rj.Material("pbr", "#4f7fae", metallic=0.2, roughness=0.5)
    scene = rj.Scene()
    scene.add(dressed(revolved(outer), steel))
    scene.add(dressed(revolved(inner), steel))
    scene.add(dressed(revolved([(0.3, 1.7), (0.3, -1.4), (0.7, -1.4), (0.7, 1.7)]), blue))
    for number in range(9):
        place = PLACE.rotate_y(40.0 * number) @ PLACE.translate((across, 0.0, 0.0))
        scene.add(dressed(ball(), brass), place @ PLACE.scale(deep - 0.01))
    return scene


@picture
def section(size: Size) -> Picture:
    """A ball bearing on a hollow shaft, cut open along its axis."""
    scene = bearing()
    scene.environment = replace(studio(), background=False)
    scene.section = rj.SectionPlane(
        (0, 0, 0), (0, 0, 1), cap_color="#b5483a", lines=True, line_color="#38110c"
    )
    camera = rj.PerspectiveCamera(eye=(3.2, 3.4, 6.4), target=(0.0, 0.1, -0.4), fov_y=34.0)
    return shown(scene, camera, size, quality=SMOOTH)


@picture
def hatching(size: Size) -> Picture:
    """The bearing's section, as a draughtsman hatches it."""
    scene = bearing()
    scene.section = rj.SectionPlane(
        (0, 0, 0), (0, 0, 1), cap_color="parts", lines=True, line_color="#20242c",
        hatch=max(4.0, size[0] / 64.0), hatch_color="#20242c",
    )  # fmt: skip
    scene.lights = [rj.AmbientLight(intensity=1.0)]
    camera = rj.OrthographicCamera(eye=(0.0, 0.15, 9.0), target=(0.0, 0.15, 0.0), height=3.6)
    return shown(scene, camera, size, quality=SMOOTH)


@picture
def exploded(size: Size) -> Picture:
    """A bolt, washers, plates and a nut, put together and moved apart along the bolt."""
    steel, brass, blue = (
        rj.Material("phong", color, specular=0.3) for color in ("#9aa3ad", "#c9973a", "#4f7fae")
    )
    scene = rj.Scene()
    # Inner and outer radius, lower and upper end.
    for inner, outer, low, high, material in (
        (0.32, 0.62, -0.95, -0.6, brass), (0.32, 0.8, -0.6, -0.5, steel),
        (0.32, 1.3, -0.5, -0.05, blue), (0.32, 1.3, 0.05, 0.5, blue),
        (0.32, 0.8, 0.5, 0.6, steel), (0.01, 0.62, 0.6, 0.95, brass),
        (0.01, 0.3, -1.2, 0.6, steel),
    ):  # fmt: skip
        rim = [(outer, low), (outer, high), (inner, high), (inner, low)]
        scene.add(dressed(revolved(rim), material))
    scene.lights = [rj.AmbientLight(intensity=0.35), sun(0.8)]
    pictures = []
    for factor in (1.0, 2.4):
        camera = rj.PerspectiveCamera(eye=(3.4, 3.0, 8.2), target=(0.0, 0.0, 0.0), fov_y=32.0)
        apart = rj.explode(scene, factor, axis=(0, 1, 0))
        pictures.append(shown(apart, camera, part_of(size, 2), quality=SMOOTH))
    return in_rows(pictures, 2)


@picture
def dimensions(size: Size) -> Picture:
    """A flange from above, with what a drawing says of it."""
    scene = rj.Scene()
    rim = [(2.0, -0.2), (2.0, 0.2), (0.7, 0.2), (0.7, -0.2)]
    upright = PLACE.rotate_x(90.0)
    scene.add(dressed(revolved(rim), rj.Material("flat", "#c3ccd6")), upright)
    em = max(6.0, size[0] / 32.0)
    written = {"size": em, "color": "#20242c", "background": "#e9e6df"}
    middle, top = (0.0, 0.0, 0.3), (0.0, 2.0, 0.3)
    scene.add(
        rj.length_dimension(
            (-2.0, 0, 0.3), (2.0, 0, 0.3), offset=(0, -2.4, 0), units="mm", scale=10, decimals=0,
            **written,
        )
    )  # fmt: skip
    corner = (2.0 * np.cos(0.6), 2.0 * np.sin(0.6), 0.3)
    scene.add(
        rj.radius_dimension(middle, (-1.6, 1.2, 0.3), units="mm", scale=10, decimals=1, **written)
    )
    scene.add(rj.angle_dimension(top, middle, corner, radius=1.4, **written))
    camera = rj.OrthographicCamera(eye=(0, -0.3, 9), target=(0, -0.3, 0), height=5.4)
    scene.lights = [rj.AmbientLight(intensity=1.0)]
    return shown(scene, camera, size, quality=SMOOTH)


@picture
def labels(size: Size) -> Picture:
    """Parts of a teapot by their names; what is behind it is not told."""
    scene = teapot(rj.Material("phong", "#5d8aa8", specular=0.4))
    pot = scene.find("teapot")
    paper, em = "#fffffff0", max(6.0, size[0] / 30.0)
    for text, place, anchor, offset in (
        ("spout", (3.4, 2.5, 0.0), "bottom", (0.0, -0.6)),
        ("lid", (0.0, 3.15, 0.0), "bottom", (0.0, -0.6)),
        ("handle", (-3.05, 2.0, 0.0), "right", (-0.6, 0.0)),
        ("body\nglazed", (0.6, 1.2, 1.95), "center", (0.0, 0.0)),
        ("behind", (0.0, 1.0, -2.1), "center", (0.0, 0.0)),
    ):
        moved = offset[0] * em, offset[1] * em
        sign = rj.Label(
            place, text, em, anchor, "#20242c", background=paper, hidden=True, offset=moved
        )
        scene.add(sign, parent=pot)
    scene.add(rj.Label((0.0, 0.0, 2.7), "Utah, 1975", 1.3 * em, "center", "#803010"))
    return shown(scene, TEAPOT_VIEW, size, quality=SMOOTH)


@picture
def points(size: Size) -> Picture:
    """A scan of a teapot as points of a pixel, as discs with normals, and as spheres."""
    pot, random = model("teapot.obj"), np.random.default_rng(3)
    corners = pot.vertices[pot.faces]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )

    def scan(count: int) -> tuple[Picture, Picture]:
        """Return points spread evenly over the teapot, and their normals."""
        faces = random.choice(len(areas), count, p=areas / areas.sum())
        weights = random.dirichlet((1.0, 1.0, 1.0), count)[:, :, np.newaxis]
        normals = pot.vertex_normals()[pot.faces[faces]]
        return (corners[faces] * weights).sum(axis=1), (normals * weights).sum(axis=1)

    part, pictures = part_of(size, 2, 2), []
    fine, coarse = scan(60_000), scan(1500)
    look = rj.Material(base_color="#c98a4b", specular=0.4)
    for cloud in (
        rj.Points(fine[0], scalars=fine[0][:, 1], colormap="turbo", size=1.0),
        rj.Points(fine[0], normals=fine[1], size=0.09, unit="world", shape="disc", material=look),
        rj.Points(coarse[0], scalars=coarse[0][:, 1], colormap="turbo", size=0.2, unit="world",
                  shape="sphere", material=rj.Material(specular=0.4)),
        rj.Points(random.uniform((-3, 0.4, -2), (3, 3.6, 2), (60, 3)),
                  colors=random.uniform(0.1, 0.9, (60, 3)), size=random.uniform(0.3, 1.2, 60),
                  unit="world", shape="sphere", material=rj.Material("pbr", roughness=0.25)),
    ):  # fmt: skip
        scene = rj.Scene()
        scene.add(cloud)
        if cloud.shape != "square":
            scene.add(floor(40.0, MATT))
        scene.lights = [
            rj.AmbientLight(intensity=0.3), sun(0.9, shadow=rj.Shadow(size=1024, filter="pcf"))
        ]  # fmt: skip
        quality = rj.Quality() if cloud.shape == "square" else SMOOTH
        pictures.append(shown(scene, TEAPOT_VIEW, part, quality=quality))
    return in_rows(pictures, 2)


@picture
def lines(size: Size) -> Picture:
    """A teapot in its box, a grid, the way of a camera around it, and what one of them sees."""
    scene = rj.Scene()
    scene.add(floor(40.0, MATT))
    pot = scene.add(dressed(model("teapot.obj"), rj.Material(base_color="#c98a4b")))
    scene.lights = [rj.AmbientLight(intensity=0.3), sun(shadow=rj.Shadow(size=2048))]
    scene.add(rj.Grid(24.0, 24, center=(0.0, 0.01, 0.0), color="#8d877c"))
    scene.add(rj.BoundingBox(pot, color="#1d4a7a", width=2.0))
    scene.add(rj.Axes(2.6, width=0.09, unit="world"), PLACE.translate((-3.0, 0.1, 3.4)))
    angles = np.linspace(-0.6, 1.45, 12)
    eyes = [(5.2 * np.sin(a), 2.0 + 0.3 * np.sin(n), 5.2 * np.cos(a)) for n, a in enumerate(angles)]
    poses = [
        rj.transforms.inverse(rj.PerspectiveCamera(eye, (0.0, 1.4, 0.0)).view_matrix())
        for eye in eyes
    ]
    scene.add(rj.Lines.from_poses(poses, axes=0.45, color="#5b2a86", width=2.5))
    seen = rj.PerspectiveCamera(eyes[-1], (0.0, 1.4, 0.0), fov_y=32.0)
    scene.add(rj.Frustum(seen, 2.6, color="#a3201b", width=2.0))
    around = np.linspace(0.0, 2.0 * np.pi, 97)
    ring = np.stack([4.4 * np.sin(around), np.full(97, 0.06), 4.4 * np.cos(around)], axis=1)
    scene.add(rj.Lines(ring, width=0.1, unit="world", dashes=[0.5, 0.25], scalars=around,
                       colormap="turbo"))  # fmt: skip
    camera = rj.PerspectiveCamera(eye=(4.5, 6.2, 11.5), target=(0.3, 0.9, 0.4), fov_y=40.0)
    return shown(scene, camera, size, quality=SMOOTH)


@picture
def glass(size: Size) -> Picture:
    """Clear, tinted and frosted glass on a chess board: what is behind is refracted."""
    scene, globe = rj.Scene(), ball(96, 144)
    board = rj.Texture(checks(8, 512, 60, 235), filter="trilinear", anisotropy=8)
    ground = rj.Material("pbr", base_color_texture=board, roughness=0.7)
    scene.add(floor(24.0, ground, repeat=4.0))
    clear = {"base_color": "white", "roughness": 0.0, "transmission": 1.0}
    pot = rj.Material(
        "pbr", **clear, thickness=1.2, ior=1.33, attenuation_distance=1.2,
        attenuation_color="#9fd8e8",
    )  # fmt: skip
    scene.add(dressed(model("teapot.obj"), pot), PLACE.rotate_y(-25))
    for place, more in (
        ((-3.1, 1.0, 2.6), {"ior": 1.5}),
        ((0.2, 0.9, 4.4), {"ior": 1.5, "roughness": 0.25}),
        ((3.5, 1.0, 2.4), {"attenuation_distance": 1.5, "attenuation_color": "#f0b840"}),
    ):
        look = rj.Material("pbr", **clear | {"thickness": 2.0 * place[1]} | more)
        stands = PLACE.compose(PLACE.translate(place), PLACE.scale(place[1]))
        scene.add(dressed(globe, look), stands)
    for place, color in (((-3.4, 0.0, -4.2), "#b03020"), ((4.4, 0.0, -3.6), "#2f5fa8")):
        scene.add(
            dressed(box(1.4, 3.2, 1.4), rj.Material(base_color=color)), PLACE.translate(place)
        )
    scene.environment = rj.Environment.gradient()
    scene.lights = [sun(0.9, shadow=rj.Shadow(size=2048, filter="pcf"))]
    camera = rj.PerspectiveCamera(eye=(0.6, 5.0, 13.5), target=(0.1, 1.2, 0.0), fov_y=34.0)
    return shown(scene, camera, size, quality=SMOOTH, background=None)


@picture
def characters(size: Size) -> Picture:
    """Two skins, one in two animations, and a face between two morph targets."""
    part, pictures = part_of(size, 2, 2), []
    for name, animation, time, eye, height, fov_y in (
        ("figure", "walk", 0.42, (2.2, 1.5, 2.6), 0.92, 36.0),
        ("figure", "wave", 0.2, (0.9, 1.5, 3.2), 1.0, 36.0),
        ("face", "feelings", 2.6, (1.7, 1.7, 4.6), 1.2, 32.0),
        ("tentacle", "curl", 0.8, (8.6, 3.2, 3.2), 1.5, 30.0),
    ):
        scene = rj.load(MODELS / f"{name}.glb").at(time, animation)
        scene.lights = [
            rj.AmbientLight(intensity=0.35), sun(1.0, shadow=rj.Shadow(size=1024, filter="pcf"))
        ]  # fmt: skip
        camera = rj.PerspectiveCamera(eye, (0.0, height, 0.0), fov_y=fov_y)
        pictures.append(shown(scene, camera, part, quality=SMOOTH))
    return in_rows(pictures, 2)


@picture
def tone_curves(size: Size) -> Picture:
    """Cut off, Reinhard, ACES and Khronos neutral, on colours much too bright for a screen."""
    part, pictures = part_of(size, 2, 2), []
    for curve in ("none", "reinhard", "aces", "neutral"):
        scene, globe = rj.Scene(), ball()
        scene.add(floor(40.0, rj.Material(shading="pbr", base_color="#b0aca4", roughness=0.6)))
        for number, color in enumerate(("#d02818", "#e0a010", "#289838", "#2048c8")):
            look = rj.Material(shading="pbr", base_color=color, roughness=0.25)
            scene.add(dressed(globe, look), PLACE.translate((2.3 * number - 3.45, 1.0, 0.0)))
        scene.lights = [
            rj.AmbientLight(intensity=0.25), sun(2.2, shadow=rj.Shadow(size=1024)),
            rj.PointLight((4.5, 4.0, 3.0), intensity=60.0),
        ]  # fmt: skip
        scene.tone_map = rj.ToneMap(curve)
        camera = rj.PerspectiveCamera(eye=(0.0, 4.2, 13.0), target=(0, 0.9, 0), fov_y=30.0)
        pictures.append(shown(scene, camera, part, background="#cfd8e0", quality=SMOOTH))
    return in_rows(pictures, 2)


def save(found: Picture, path: Path) -> None:
    """Write a picture as a PNG; in 256 colours of its own, dithered, if it would be large."""
    image = Image.fromarray(found)
    image.save(path, optimize=True)
    if path.stat().st_size > MAX_BYTES:
        palette = image.quantize(256, method=Image.Quantize.MEDIANCUT)
        few = image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
        few.save(path, optimize=True)


def main(folder: Path, names: list[str]) -> None:
    """Write all pictures, or those named."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names or GALLERY:
        save(GALLERY[name](SIZE), folder / f"{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else MODELS / "pictures" / "gallery", sys.argv[2:])
