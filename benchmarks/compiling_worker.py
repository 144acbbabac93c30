"""
Draw, step after step, what makes kernels compile, and time every step.

``python benchmarks/compiling_worker.py PART MODELS CACHE`` drives the ``rasterjit`` that Python
finds, through public names alone, and imports nothing else of this folder: so it can drive any
checkout. It prints one line of JSON for each step: its name; its seconds by the wall clock, of the
processor (in this process and those that it started) and of the program's own compile clock; and
the kernels of the files that the step added to the cache of compiled code.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

NOT_CODE = frozenset((".nbi", ".lock", ".part", ".tmp", ".json"))
"""Endings of files in a cache that hold no compiled code."""

SIZE, SMALL = (640, 480), (64, 48)

Step = tuple[str, Callable[[], Any]]


def compiled_forms(cache: Path) -> dict[Path, str]:
    """Return the files of compiled code in a cache, each with the name of its kernel."""
    return {
        path: path.name.rpartition("_")[0] if path.suffix == ".kernel" else path.name.split("-")[0]
        for path in cache.rglob("*")
        if path.is_file() and path.suffix not in NOT_CODE and not path.name.startswith(".")
    }


def processor_seconds() -> float:
    """Return the processor seconds of this process and of those that it waited for."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def teapot(models: Path) -> Any:
    """Return the teapot, lit by the headlight."""
    import rasterjit as rj

    return rj.load(models / "teapot.obj")


def first_teapot(models: Path) -> Iterator[Step]:
    """Import the package, load the teapot and draw it."""

    def draw() -> Any:
        import rasterjit as rj

        return rj.render(teapot(models), size=SIZE)

    yield "first teapot by rj.render", draw


def effects() -> dict[str, tuple[Callable[[Any], None], Callable[[Any], None]]]:
    """Return what switches each effect of a scene on, and what switches it off."""
    import rasterjit as rj

    def put(name: str, value: Any) -> tuple[Callable[[Any], None], Callable[[Any], None]]:
        return (lambda scene: setattr(scene, name, value)), (
            lambda scene: setattr(scene, name, None)
        )

    def lights(*some: Any) -> Callable[[Any], None]:
        return lambda scene: setattr(scene, "lights", list(some))

    def opacity(alpha: float, mode: str) -> Callable[[Any], None]:
        def change(scene: Any) -> None:
            for node in scene.nodes:
                color = (0.8, 0.7, 0.5, alpha)
                node.mesh.material = replace(node.mesh.material, base_color=color, alpha_mode=mode)

        return change

    def look(**values: Any) -> Callable[[Any], None]:
        def change(scene: Any) -> None:
            for node in scene.nodes:
                node.mesh.material = replace(node.mesh.material, **values)

        return change

    def layer(name: str, on: Any, off: Any) -> tuple[Callable[[Any], None], Callable[[Any], None]]:
        return look(shading="pbr", **{name: on}), look(shading="phong", **{name: off})

    def remove(scene: Any, name: str) -> None:
        for node in [node for node in scene.every_node() if node.name == name]:
            scene.remove(node)

    def add_cut_box(scene: Any) -> None:
        corners = np.array(list(np.ndindex(2, 2, 2)), np.float64)
        quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4],
                          [1, 5, 7, 3]])  # fmt: skip
        box = rj.Mesh(corners, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))
        scene.add(box.split_creases(), name="cut box")
        scene.section = rj.SectionPlane((0.5, 0.5, 0.5), (0.0, 0.0, 1.0))

    def remove_cut_box(scene: Any) -> None:
        scene.section = None
        remove(scene, "cut box")

    def show_lines(are_shown: bool) -> Callable[[Any], None]:
        def change(scene: Any) -> None:
            plane = scene.section or rj.SectionPlane((0.5, 0.5, 0.5), (0.0, 0.0, 1.0))
            scene.section = replace(plane, lines=True) if are_shown else None

        return change

    def add_flag(scene: Any) -> None:
        corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
        mesh = rj.Mesh(corners, [(0, 1, 2)], joints=[[0]] * 3, weights=[[1.0]] * 3)
        pole = scene.add(rj.Node(name="pole"))
        scene.add(mesh, name="flag").skin = rj.Skin([pole])

    def remove_flag(scene: Any) -> None:
        remove(scene, "flag")
        remove(scene, "pole")

    sun = rj.DirectionalLight((-1.0, -2.0, -1.5))
    shadowed = replace(sun, shadow=rj.Shadow(512))
    return {
        "fog": put("fog", rj.Fog(density=0.05)),
        "tone curve": put("tone_map", rj.ToneMap()),
        "shadow": (lights(rj.AmbientLight(), shadowed), lights(rj.AmbientLight(), sun)),
        "environment": put("environment", rj.Environment.gradient()),
        "ambient occlusion": put("ambient_occlusion", rj.AmbientOcclusion()),
        "outline": put("outline", rj.Outline()),
        "transparency": (opacity(0.5, "blend"), opacity(1.0, "opaque")),
        "wireframe": put("wireframe", rj.Wireframe()),
        "metallic-roughness": (look(shading="pbr"), look(shading="phong")),
        "clearcoat": layer("clearcoat", 1.0, 0.0),
        "sheen": layer("sheen_color", "white", None),
        "own mirrors": layer("specular_color", "gold", None),
        "glass": layer("transmission", 0.5, 0.0),
        "section": (add_cut_box, remove_cut_box),
        "section lines": (show_lines(True), show_lines(False)),
        "skin": (add_flag, remove_flag),
    }


def switching(models: Path) -> Iterator[Step]:
    """Switch effects on, one on top of the other, then off again in the same order."""
    import rasterjit as rj

    yield from first_teapot(models)
    scene, switches = teapot(models), effects()
    several = {"4 samples": (4, 1)}
    order = [
        "fog", "tone curve", "shadow", "environment", "ambient occlusion", "4 samples", "outline",
        "metallic-roughness", "clearcoat", "sheen", "own mirrors", "glass", "section",
        "section lines", "skin", "transparency", "wireframe",
    ]  # fmt: skip
    samples = 1

    def draw() -> Any:
        return rj.render(scene, size=SIZE, quality=rj.Quality(samples=samples))

    for way, label in enumerate(("on", "off")):
        for name in order:
            if name in several:
                samples = several[name][way]
            else:
                switches[name][way](scene)
            yield f"{name} {label}", draw


def scene_after_teapot(models: Path) -> Iterator[Step]:
    """Draw the glTF scene after the teapot."""
    import rasterjit as rj

    rj.render(teapot(models), size=SIZE)
    yield (
        "models/scene.glb after the teapot",
        lambda: rj.render(rj.load(models / "scene.glb"), size=SIZE),
    )


def everything(models: Path) -> Iterator[Step]:
    """Draw all there is, alone and together."""
    yield "shading and colours", draw_surfaces
    yield "textures", draw_textures
    yield "each effect alone", lambda: draw_effects_alone(models)
    yield "shadows of every kind", draw_shadows
    yield "1, 4, 16, 64 samples, areas", draw_samples
    yield "all effects, 1, 4, 16 samples, areas", lambda: draw_effects_together(models)
    yield "glass", draw_glass
    yield "accuracy settings", draw_settings
    yield "all outputs, peeled layers, diagnostics", draw_outputs
    yield "lines, triangles, rasterize", draw_primitives
    yield "compat.pyrender under each flag", draw_as_pyrender


def by_pyrender(models: Path) -> Iterator[Step]:
    """Draw a ball by the adapter for pyrender, then under other flags, in one process."""
    yield "first picture by compat.pyrender", lambda: draw_flags("NONE")
    for name in ("SEG", "FLAT", "ALL_WIREFRAME", "SHADOWS_DIRECTIONAL"):
        yield f"compat.pyrender, {name}", lambda name=name: draw_flags(name)


def draw_flags(*names: str) -> None:
    """Draw a lit ball by the adapter for pyrender, under one flag after the other."""
    import trimesh

    from rasterjit.compat import pyrender

    scene, pose = pyrender.Scene(bg_color=(0.0, 0.0, 0.0, 0.0)), np.eye(4)
    pose[2, 3] = 3.0
    scene.add(pyrender.PerspectiveCamera(yfov=0.9), pose=pose)
    for light in (pyrender.DirectionalLight, pyrender.SpotLight, pyrender.PointLight):
        scene.add(light(intensity=2.0), pose=pose)
    node = scene.add(pyrender.Mesh.from_trimesh(trimesh.creation.icosphere(2)))
    renderer = pyrender.OffscreenRenderer(*SMALL)
    for name in names:
        renderer.render(scene, pyrender.RenderFlags[name], {node: 1})
    renderer.delete()


def draw_as_pyrender() -> None:
    """Draw by the adapter for pyrender under each of its flags."""
    from rasterjit.compat import pyrender

    draw_flags(*(flag.name for flag in pyrender.RenderFlags if flag.name))


def square(color_rows: int | None = None, **material: Any) -> Any:
    """Return a scene with two triangles, coloured at vertices (4 rows), faces (2) or not."""
    import rasterjit as rj

    vertices = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float64)
    colors = None if color_rows is None else np.full((color_rows, 4), 0.7, np.float32)
    scene = rj.Scene()
    scene.add(
        rj.Mesh(
            vertices, [(0, 1, 2), (0, 2, 3)], colors=colors, uv=vertices[:, :2] / 2.0 + 0.5,
            material=rj.Material(**material),
        )
    )  # fmt: skip
    return scene


def draw(scene: Any, camera: Any = None, outputs: tuple[str, ...] = ("color",), **quality: Any):
    """Draw a small picture."""
    import rasterjit as rj

    return rj.render(scene, camera, size=SMALL, outputs=outputs, quality=rj.Quality(**quality))


def checks() -> Any:
    """Return a texture with holes."""
    import rasterjit as rj

    texels = np.ones((8, 8, 4))
    texels[::2, ::2] = 0.2
    return rj.Texture(texels)


def draw_surfaces() -> None:
    """Draw every shading with every colouring, diffuse and shiny."""
    for shading in ("unlit", "flat", "gouraud", "phong", "pbr"):
        for rows in (None, 4, 2):
            for specular in (0.0, 0.25):
                draw(square(rows, shading=shading, specular=specular))


def draw_textures() -> None:
    """Draw textures of every kind with every filter."""
    texture = checks()
    for shading in ("unlit", "flat", "gouraud", "phong", "pbr"):
        draw(square(shading=shading, base_color_texture=texture))
    for name in ("nearest", "bilinear", "trilinear", "anisotropic8"):
        draw(square(base_color_texture=texture), texture_filter=name)
    for mode in ("mask", "blend"):
        draw(square(base_color_texture=texture, alpha_mode=mode))
        draw(square(base_color_texture=texture, alpha_mode=mode), samples=4)
    maps = dict.fromkeys(
        ("normal_texture", "metallic_roughness_texture", "occlusion_texture", "emissive_texture"),
        texture,
    )
    for name, one in maps.items():
        draw(square(shading="pbr", emissive="white", **{name: one}))
    draw(square(shading="pbr", emissive="white", base_color_texture=texture, **maps))


def draw_effects_alone(models: Path) -> None:
    """Switch each effect on, draw, and switch it off again."""
    scene = teapot(models)
    for on, off in effects().values():
        on(scene)
        draw(scene)
        off(scene)


def draw_effects_together(models: Path) -> None:
    """Draw all effects at once with every number of samples."""
    scene, switches = teapot(models), effects()
    for on, _ in switches.values():
        on(scene)
    for samples in (1, 4, 16):
        draw(scene, samples=samples)
    # Areas are not for what blends.
    switches["transparency"][1](scene)
    draw(scene, samples="area")


def draw_shadows() -> None:
    """Draw every filter of every light that may cast a shadow."""
    import rasterjit as rj

    for name in ("hard", "pcf", "soft"):
        size = 0.1 if name == "soft" else None
        shadow = rj.Shadow(64, name, light_size=size)
        for light in (
            rj.DirectionalLight(shadow=shadow),
            rj.SpotLight((0.0, 0.0, 3.0), shadow=shadow),
            rj.PointLight((0.0, 0.0, 3.0), shadow=shadow),
        ):
            scene = square()
            scene.add(scene.nodes[0].mesh, rj.transforms.translate((0.5, 0.5, 1.0)))
            scene.lights = [light]
            draw(scene)


def draw_samples() -> None:
    """Draw every number of samples."""
    for samples in (1, 4, 16, 64, "area"):
        draw(square(), samples=samples)


def draw_glass() -> None:
    """Draw several transparent layers, by both ways of mixing."""
    import rasterjit as rj

    scene = square(base_color=(1.0, 1.0, 1.0, 0.5), alpha_mode="blend")
    for height in (0.5, 1.0):
        scene.add(scene.nodes[0].mesh, rj.transforms.translate((0.0, 0.0, height)))
    for blending in ("linear", "srgb8"):
        for samples in (1, 4, 16):
            draw(scene, samples=samples, blending=blending)
    for layers in (1, 2):
        draw(scene, transparency_layers=layers)


def draw_settings() -> None:
    """Draw with every other setting of accuracy that has code of its own."""
    import rasterjit as rj

    for shading in ("face", "vertex", "pixel"):
        draw(square(), shading=shading)
        draw(square(), shading=shading, samples=4)
    for depth in ("unorm16", "unorm24", "float32", "float64"):
        draw(square(), depth_format=depth)
    draw(square(), precision="float32")
    draw(square(base_color_texture=checks()), interpolation="affine")
    draw(square(), renormalize=False)
    scene = square()
    for mode in ("overlay", "only"):
        for lines in ("bresenham", "coverage"):
            scene.wireframe = rj.Wireframe(mode=mode)
            draw(scene, lines=lines)


def draw_outputs() -> None:
    """Fill every output, peel layers, count what became of the faces, explain a pixel."""
    import rasterjit as rj

    outputs = (
        "color", "depth", "face_id", "object_id", "barycentric", "uv", "normal", "position",
        "linear", "distance", "object_position", "nocs", "geometric_normal", "material_id",
        "instance_id", "coverage", "motion", "motion_visible",
    )  # fmt: skip
    for size in (SMALL, (256, 192)):
        for what in (square(), square(shading="flat")):
            rj.render(what, size=size, outputs=outputs, previous=rj.PreviousView())
    rj.render_layers(square(), k=2, size=SMALL)
    rj.render(square(), size=SMALL, diagnose=True)
    rj.explain_pixel(square(), None, SMALL, 9, 9)
    inside = rj.PerspectiveCamera(eye=(0.0, 0.1, 0.0), target=(1.0, 0.1, 0.1), near=0.1)
    draw(square(), inside)


def draw_primitives() -> None:
    """Draw by the classic primitives, and rasterize vertices in clip space."""
    import rasterjit as rj

    clip = np.array([(-1, -1, 0, 1), (1, -1, 0, 1), (1, 1, 0, 1)], np.float64)
    for depth in ("standard", "reversed"):
        rj.rasterize(clip, [(0, 1, 2)], SMALL, depth=depth).barycentric.sum()
    target = rj.Framebuffer(*SMALL)
    target.put_pixel(3, 3, (255, 0, 0))
    target.draw_line((0, 0), (9, 5), (255, 0, 0), (0, 0, 255))
    target.draw_lines(np.full((64, 4), (0, 0, 30, 5)), (255, 0, 0))
    target.draw_triangle((0, 0), (9, 0), (0, 9), (255, 0, 0))
    target.draw_circle((8, 8), 5, (255, 0, 0))
    target.draw_bezier([(0, 0), (8, 0), (8, 8)], (255, 0, 0))
    for method in ("barycentric", "scanline"):
        for depth in (None, (0.5, 0.5, 0.5)):
            target.fill_triangle((0, 0), (9, 0), (0, 9), (255, 0, 0), method=method, depth=depth)


PARTS: dict[str, Callable[[Path], Iterator[Step]]] = {
    "first": first_teapot,
    "switching": switching,
    "scene": scene_after_teapot,
    "pyrender": by_pyrender,
    "everything": everything,
}


def run(step: Step, cache: Path) -> dict[str, Any]:
    """Take a step and return what it took."""
    name, act = step
    before, started, processor = compiled_forms(cache), time.perf_counter(), processor_seconds()
    result = act()
    wall, processor = time.perf_counter() - started, processor_seconds() - processor
    added = [form for path, form in compiled_forms(cache).items() if path not in before]
    seconds = getattr(getattr(result, "stats", None), "seconds", {})
    return {
        "what": name,
        "wall": wall,
        "processor": processor,
        "clock": seconds.get("compile"),
        "compiled": sorted(added),
    }


def main(part: str, models: str, cache: str) -> None:
    """Take all steps of a part."""
    for step in PARTS[part](Path(models)):
        print(json.dumps(run(step, Path(cache))), flush=True)


if __name__ == "__main__":
    # The modules beside this one are not for import: their names are common words.
    del sys.path[0]
    main(*sys.argv[1:])
