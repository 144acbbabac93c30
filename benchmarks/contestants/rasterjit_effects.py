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
        self._camera = rj.MatrixCamera(np.eye(4), scene.clip_from_world)
        quality = rj.Quality.standard()
        if scene.samples > 1:
            quality = dataclasses.replace(quality, samples=scene.samples)
        self._renderer = rj.Renderer(scene.size, quality=quality, threads=threads)

    def draw(self) -> None:
        """Render; a frame's arrays are NumPy's, so that it is read back as well."""
        self._frame = self._renderer.render(
            self._scene, self._camera, outputs=("color",), background="transparent"
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


def make_scene(scene: EffectScene) -> Any:
    """Return the ``rasterjit.Scene``."""
    import rasterjit as rj

    made, material = rj.Scene(), make_material(scene)
    for part in scene.parts:
        made.add(make_mesh(part, scene, material))
    if scene.shading != "unlit":
        shadow = rj.Shadow(size=fx.SHADOW_SIDE, filter="pcf") if scene.shadow else None
        options = {} if shadow is None else {"shadow": shadow}
        made.lights = [rj.DirectionalLight(tuple(np.negative(fx.TO_LIGHT)), **options)]
        if scene.shading == "phong":
            made.lights.append(rj.AmbientLight(intensity=fx.AMBIENT))
    if scene.fog:
        made.fog = rj.Fog(fx.FOG_COLOR, mode="exp2", density=fx.FOG_DENSITY)
    if scene.tone_map:
        made.tone_map = rj.ToneMap("reinhard", fx.EXPOSURE)
    if scene.environment:
        made.environment = rj.Environment.gradient(fx.SKY, fx.SKY, fx.GROUND, background=False)
    if scene.occlusion:
        made.ambient_occlusion = rj.AmbientOcclusion()
    return made


def make_mesh(part: Part, scene: EffectScene, material: Any) -> Any:
    """Return a ``rasterjit.Mesh`` with what the scene reads of it."""
    import rasterjit as rj

    return rj.Mesh(
        part.positions, part.faces, material=material,
        colors=part.colors,
        normals=part.normals if scene.shading != "unlit" else None,
        uv=part.uv if scene.filter is not None else None,
    )  # fmt: skip


def make_material(scene: EffectScene) -> Any:
    """Return the ``rasterjit.Material``."""
    import rasterjit as rj

    options: dict[str, Any] = {}
    if scene.filter is not None:
        options["base_color_texture"] = make_texture(scene.filter)
    if scene.shading == "phong":
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
