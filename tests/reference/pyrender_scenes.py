"""
Small scenes for pyrender 0.1.45 and for the adapter alike, and what the original shows of them.

``python tests/reference/pyrender_scenes.py pyrender`` records that anew, beside this file, where
pyrender 0.1.45, trimesh and a way to draw without a display (``PYOPENGL_PLATFORM=egl`` or
``osmesa``) are.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import trimesh

SIZE = 48, 36
RECORDED = Path(__file__).with_name("pyrender_pictures.json")
SCENES = {}
"""By name: a function that takes the module and returns a scene and flags."""


def scene_of(build):
    SCENES[build.__name__] = build
    return build


def at(x=0.0, y=0.0, z=0.0, down=0.0, around=0.0):
    """Return a pose at a place, turned down and then around, radians."""
    c, s = np.cos(down), np.sin(down)
    tilt = np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    c, s = np.cos(around), np.sin(around)
    pose = np.eye(4)
    pose[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ tilt
    pose[:3, 3] = x, y, z
    return pose


def empty(pr, ambient=(0.1, 0.1, 0.1), background=(1.0, 1.0, 1.0, 1.0), sun=3.0):
    scene = pr.Scene(ambient_light=np.array(ambient), bg_color=np.array(background))
    scene.add(pr.PerspectiveCamera(yfov=1.0, znear=0.1, zfar=50.0), pose=at(z=3.0))
    if sun:
        scene.add(pr.DirectionalLight(color=np.ones(3), intensity=sun), pose=at(z=3.0))
    return scene


def material(pr, *color, metallic=0.2, roughness=0.8, **options):
    return pr.MetallicRoughnessMaterial(
        baseColorFactor=color, metallicFactor=metallic, roughnessFactor=roughness, **options
    )


def ball(pr, look=None, subdivisions=3):
    return pr.Mesh.from_trimesh(
        trimesh.creation.icosphere(subdivisions=subdivisions), material=look
    )


def square(pr, look, half=1.0, normals=True, colors=None):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64) * half
    primitive = pr.Primitive(
        corners, normals=np.tile([0.0, 0.0, 1.0], (4, 1)) if normals else None,
        texcoord_0=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64), color_0=colors,
        indices=np.array([[0, 1, 2], [0, 2, 3]]), material=look,
    )  # fmt: skip
    return pr.Mesh([primitive])


def checks(seed):
    """Return a picture of 4 x 4 random colours, (64, 64, 3) uint8."""
    colors = np.random.default_rng(seed).integers(0, 256, (4, 4, 3))
    return np.kron(colors, np.ones((16, 16, 1), np.int64)).astype(np.uint8)


@scene_of
def white_square(pr):
    scene = empty(pr, ambient=(0, 0, 0.0), sun=1.0)
    scene.add(square(pr, material(pr, 1.0, 1.0, 1.0, 1.0)))
    return scene, 0


@scene_of
def six_suns(pr):
    scene = empty(pr, ambient=(0, 0, 0.0), sun=0.0)
    scene.add(square(pr, material(pr, 0.3, 0.3, 0.3, 1.0, metallic=0.0, roughness=1.0)))
    for n in range(6):
        scene.add(pr.DirectionalLight(color=np.ones(3), intensity=1.0 + n), pose=at(z=3.0 + n))
    return scene, 0


@scene_of
def glossy(pr):
    scene = empty(pr, ambient=(0.05, 0.03, 0.02), sun=0.0)
    scene.add(ball(pr, material(pr, 0.8, 0.5, 0.2, 1.0, metallic=0.9, roughness=0.3)))
    lamp = pr.PointLight(color=np.array([1.0, 0.8, 0.6]), intensity=20.0)
    scene.add(lamp, pose=at(2.0, 2.0, 2.0))
    spot = pr.SpotLight(
        color=np.array([0.2, 0.5, 1.0]), intensity=30.0, innerConeAngle=0.2, outerConeAngle=0.5
    )
    scene.add(spot, pose=at(-1.0, 0.0, 3.0, around=-0.3))
    return scene, 0


@scene_of
def light_taken_away(pr):
    scene = empty(pr, ambient=(0.6, 0.6, 0.6))
    scene.add(ball(pr, material(pr, 0.8, 0.5, 0.2, 1.0)))
    scene.add(pr.DirectionalLight(color=np.ones(3), intensity=-2.0), pose=at(around=1.0))
    return scene, 0


@scene_of
def lamp_far_away(pr):
    scene = empty(pr, ambient=(0, 0, 0.0), sun=0.0)
    scene.add(ball(pr, material(pr, 0.8, 0.5, 0.2, 1.0)))
    scene.add(pr.PointLight(color=np.ones(3), intensity=1e8), pose=at(0.0, 6000.0, 6000.0))
    return scene, 0


@scene_of
def without_material(pr):
    scene = empty(pr)
    scene.add(ball(pr))
    return scene, 0


@scene_of
def colors_of_vertices(pr):
    scene = empty(pr)
    colors = np.array([[1, 1, 1, 1], [1, 0.5, 0.5, 1], [0.2, 0.9, 1, 1], [1, 1, 0, 1]], np.float64)
    look = material(pr, 0.9, 0.8, 0.7, 1.0, emissiveFactor=(0.3, 0.0, 0.2))
    scene.add(square(pr, look, colors=colors), pose=at(around=0.4))
    return scene, 0


@scene_of
def all_maps(pr):
    normals = np.full((64, 64, 3), (148, 98, 255), np.uint8)

    def shown(pixels):
        return pr.Texture(source=pixels, source_channels="RGB")

    look = material(
        pr, 1.0, 1.0, 0.9, 1.0, metallic=0.8, roughness=0.9, baseColorTexture=shown(checks(1)),
        normalTexture=shown(normals), occlusionTexture=shown(checks(2)),
        emissiveTexture=shown(checks(3)), emissiveFactor=(0.5, 0.3, 0.2),
        metallicRoughnessTexture=shown(checks(4)),
    )  # fmt: skip
    scene = empty(pr, ambient=(0.2, 0.2, 0.2))
    scene.add(square(pr, look, half=1.2))
    return scene, 0


@scene_of
def facets_from_an_array(pr):
    scene = empty(pr)
    look = material(pr, 1.0, 1.0, 0.9, 1.0, metallicRoughnessTexture=checks(4))
    scene.add(square(pr, look, half=1.2))
    return scene, 0


@scene_of
def texture_without_light(pr):
    look = material(
        pr, 1.0, 0.9, 0.8, 1.0,
        baseColorTexture=pr.Texture(source=checks(1), source_channels="RGB"),
    )  # fmt: skip
    scene = empty(pr)
    scene.add(square(pr, look, half=1.2))
    return scene, pr.RenderFlags.FLAT


@scene_of
def back(pr):
    scene = empty(pr)
    look = material(pr, 1.0, 0.6, 0.4, 1.0, roughness=0.5, doubleSided=True)
    scene.add(square(pr, look), pose=at(around=np.pi - 0.4))
    return scene, 0


@scene_of
def no_normals(pr):
    scene = empty(pr, sun=2.0)
    scene.add(square(pr, material(pr, 0.9, 0.6, 0.4, 1.0), normals=False), pose=at(around=0.6))
    return scene, 0


@scene_of
def glass(pr):
    scene = empty(pr)
    red = material(pr, 1.0, 0.2, 0.2, 0.5, alphaMode="BLEND")
    green = material(pr, 0.2, 1.0, 0.2, 0.6, alphaMode="BLEND")
    scene.add(square(pr, red, 0.6), pose=at(z=0.5))
    scene.add(square(pr, green, 0.8))
    scene.add(square(pr, material(pr, 0.2, 0.2, 1.0, 1.0)), pose=at(z=-1.0))
    return scene, 0


@scene_of
def glass_ball(pr):
    scene = empty(pr)
    scene.add(ball(pr, material(pr, 1.0, 0.2, 0.2, 0.5, alphaMode="BLEND"), 2))
    return scene, pr.RenderFlags.SKIP_CULL_FACES


@scene_of
def alphas(pr):
    scene = empty(pr, background=(0.0, 0.2, 1.0, 0.1))
    scene.add(square(pr, material(pr, 1.0, 0.2, 0.5, 0.4), 0.5), pose=at(-0.6))
    blended = material(pr, 1.0, 0.2, 0.5, 0.4, alphaMode="BLEND")
    scene.add(square(pr, blended, 0.5), pose=at(0.6))
    return scene, pr.RenderFlags.RGBA


@scene_of
def mask(pr):
    scene = empty(pr)
    scene.add(square(pr, material(pr, 1.0, 0.2, 0.5, 0.4, alphaMode="MASK", alphaCutoff=0.5)))
    return scene, 0


def over_a_floor(pr, light):
    """Return a ball over a floor under a light: both shade themselves there, where it grazes."""
    scene = empty(pr, sun=0.0)
    scene.add(ball(pr, material(pr, 0.8, 0.5, 0.2, 1.0)))
    floor = square(pr, material(pr, 0.9, 0.9, 0.9, 1.0, metallic=0.0, roughness=1.0), 2.5)
    scene.add(floor, pose=at(0.0, -1.2, 0.0, down=np.pi / 2.0))
    scene.add(light, pose=at(1.5, 3.0, 1.5, down=1.0, around=0.6))
    return scene


@scene_of
def shadow_of_a_sun(pr):
    sun = pr.DirectionalLight(color=np.ones(3), intensity=3.0)
    return over_a_floor(pr, sun), pr.RenderFlags.SHADOWS_DIRECTIONAL


@scene_of
def shadow_of_a_spot(pr):
    spot = pr.SpotLight(color=np.ones(3), intensity=40.0, innerConeAngle=0.5, outerConeAngle=0.7)
    return over_a_floor(pr, spot), pr.RenderFlags.SHADOWS_SPOT


@scene_of
def points_under_a_sun(pr):
    scene = empty(pr, sun=0.0)
    rng = np.random.default_rng(5)
    spread = rng.uniform(-1.2, 1.2, (400, 3))
    scene.add(pr.Mesh.from_points(spread, colors=rng.integers(0, 256, (400, 3)).astype(np.uint8)))
    scene.add(pr.DirectionalLight(color=np.ones(3), intensity=5.0), pose=at(down=1.0, around=0.6))
    return scene, pr.RenderFlags.SHADOWS_DIRECTIONAL


def drawn(pr):
    """Return what each scene looks like: (color, depth) by name."""
    renderer = pr.OffscreenRenderer(*SIZE, point_size=4.0)
    pictures = {}
    for name, build in SCENES.items():
        scene, flags = build(pr)
        pictures[name] = renderer.render(scene, flags=flags)
    renderer.delete()
    return pictures


def record(module):
    # pyrender 0.1.45 asks NumPy for a name that it has no more.
    np.infty = np.inf
    rows = {
        name: {"color": color[::3, ::3].tolist(), "depth": depth[::3, ::3].tolist()}
        for name, (color, depth) in drawn(importlib.import_module(module)).items()
    }
    RECORDED.write_text(json.dumps(rows, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    record(sys.argv[1])
