"""RasterJIT drawing scenes that call for effects, by its public names."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import effects_scenes as fx
from benchmarks.contestants import Prepared
from benchmarks.contestants.rasterjit_ import available, decode_srgb, environment
from benchmarks.effects_scenes import EffectScene, Part

__all__ = ["NAME", "available", "draws", "environment", "prepare"]

NAME = "RasterJIT"


def draws(scene: EffectScene) -> str | None:
    """Return ``None``: it draws every scene."""
    return None


def prepare(scene: EffectScene, threads: int) -> Prepared:
    """Return the scene ready to draw, its kernels compiled or loaded by a first picture."""
    ready = Frames(scene, threads)
    ready.draw()
    return ready


class Frames:
    """``Renderer.render``, from a scene to sRGB."""

    def __init__(self, scene: EffectScene, threads: int) -> None:
        import rasterjit as rj

        self._scene = make_scene(scene)
        self._camera = make_camera(scene)
        self._background = background_of(scene)
        self._renderer = rj.Renderer(scene.size, quality=make_quality(scene), threads=threads)

    def draw(self) -> None:
        """Render; a frame's arrays are NumPy's, so that it is read back as well."""
        self._frame = self._renderer.render(
            self._scene, self._camera, outputs=("color",), background=self._background
        )

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture."""
        return {"color": self._frame.color}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared; colours decoded from sRGB, and mixed with black behind them."""
        color = self._frame.color
        alpha = color[:, :, 3]
        linear = decode_srgb(color[:, :, :3]) * (alpha[:, :, np.newaxis] / 255.0)
        return {"covered": alpha > 0, "color_linear": np.rint(linear).astype(np.uint8)}


def make_camera(scene: EffectScene) -> Any:
    """Return the ``rasterjit.MatrixCamera``."""
    import rasterjit as rj

    return rj.MatrixCamera(np.eye(4), scene.clip_from_world)


def make_quality(scene: EffectScene) -> Any:
    """Return the ``rasterjit.Quality``."""
    import rasterjit as rj

    return dataclasses.replace(rj.Quality.standard(), samples=scene.samples)


def background_of(scene: EffectScene) -> str | None:
    """Return what is asked for behind everything; ``None`` for the environment."""
    return None if scene.backdrop else "transparent"


def make_scene(scene: EffectScene) -> Any:
    """Return the ``rasterjit.Scene``."""
    import rasterjit as rj

    made, material = rj.Scene(), make_material(scene)
    for part in scene.parts:
        made.add(make_mesh(part, scene, material))
    if scene.shading != "unlit":
        made.lights = [make_light(scene)]
        if scene.shading != "pbr":
            made.lights.append(rj.AmbientLight(intensity=fx.AMBIENT))
    if scene.fog is not None:
        made.fog = make_fog(scene.fog)
    if scene.tone_map is not None:
        made.tone_map = rj.ToneMap(scene.tone_map, fx.EXPOSURE)
    if scene.environment:
        made.environment = rj.Environment.gradient(
            fx.SKY, fx.SKY, fx.GROUND, background=scene.backdrop
        )
    if scene.occlusion:
        made.ambient_occlusion = rj.AmbientOcclusion()
    if scene.eye_dome:
        made.eye_dome = rj.EyeDome()
    if scene.outline:
        made.outline = rj.Outline(edges=scene.outline)
    if scene.wireframe:
        made.wireframe = rj.Wireframe()
    return made


def make_light(scene: EffectScene) -> Any:
    """Return the one light that has a direction, with its shadow."""
    import rasterjit as rj

    sides = {"point": fx.CUBE_SIDE}
    shadow = None
    if scene.shadow is not None:
        angle = fx.SUN_ANGLE if scene.shadow == "soft" else None
        size = sides.get(scene.light, fx.SHADOW_SIDE)
        shadow = rj.Shadow(size=size, filter=scene.shadow, light_size=angle)
    if scene.light == "sun":
        return rj.DirectionalLight(tuple(np.negative(fx.TO_LIGHT)), shadow=shadow)
    options = {"intensity": fx.LAMP_INTENSITY, "shadow": shadow}
    if scene.light == "point":
        return rj.PointLight(fx.LAMP, **options)
    inner, outer = fx.LAMP_ANGLES
    toward = tuple(np.negative(fx.LAMP))
    return rj.SpotLight(fx.LAMP, toward, inner_angle=inner, outer_angle=outer, **options)


def make_fog(kind: str) -> Any:
    """Return the ``rasterjit.Fog``."""
    import rasterjit as rj

    if kind == "height":
        return rj.Fog(
            fx.FOG_COLOR, mode="exp", density=fx.FOG_DENSITY, height=fx.FOG_HEIGHT,
            falloff=fx.FOG_FALLOFF,
        )  # fmt: skip
    return rj.Fog(fx.FOG_COLOR, mode=kind, density=fx.FOG_DENSITY)


def make_mesh(part: Part, scene: EffectScene, material: Any) -> Any:
    """Return a ``rasterjit.Mesh`` with what the scene reads of it."""
    import rasterjit as rj

    return rj.Mesh(
        part.positions, part.faces, material=material,
        colors=part.colors,
        normals=part.normals if scene.shading not in ("unlit", "flat") else None,
        uv=part.uv if scene.filter is not None else None,
    )  # fmt: skip


def make_material(scene: EffectScene) -> Any:
    """Return the ``rasterjit.Material``."""
    import rasterjit as rj

    options: dict[str, Any] = {}
    if scene.filter is not None:
        options["base_color_texture"] = make_texture(scene.filter)
    if scene.maps:
        for name, image in fx.map_pictures().items():
            space = "srgb" if name == "emissive_texture" else "linear"
            options[name] = rj.Texture(image, filter=scene.filter, color_space=space)
    if scene.shading in ("flat", "gouraud", "phong"):
        options |= {"specular": fx.SPECULAR, "shininess": fx.SHININESS}
    if scene.shading == "pbr":
        options |= {"metallic": fx.METALLIC, "roughness": fx.ROUGHNESS}
    if scene.alpha != "opaque":
        options["alpha_mode"] = scene.alpha
    if scene.alpha == "mask":
        options["alpha_cutoff"] = fx.ALPHA_CUTOFF
    return rj.Material(scene.shading, base_color="white", **options)


def make_texture(filter: str) -> Any:
    """Return the ``rasterjit.Texture``, its mip levels made when they are first read."""
    import rasterjit as rj

    if filter == "anisotropic":
        return rj.Texture(fx.picture(), filter="trilinear", anisotropy=fx.ANISOTROPY)
    return rj.Texture(fx.picture(), filter=filter)
