"""
Draw scenes through RasterJIT's public names alone, so that any version of it can be driven.

``CASES`` is the fixed set that `benchmarks.compare` times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.meshes import torus_normals, torus_size
from benchmarks.scenes import (
    STRETCH,
    LineScene,
    Scene,
    TriangleScene,
    mesh_70k_phong,
    short_lines,
    triangles_of,
)

SMALL_FACES, SMALL_LINES = 1000, 100

CASES: dict[str, str] = {
    "fill_back_to_front": "fill_back_to_front",
    "fill_front_to_back": "fill_front_to_back",
    "mesh_70k": "mesh_70k",
    "mesh_70k_phong": "mesh_70k_phong",
    "mesh_70k_texture": "mesh_70k_texture",
    "mesh_1m": "mesh_1m",
    "visibility_1m": "visibility_1m",
    "slivers": "slivers",
    "culled": "culled",
    "wireframe": "wireframe",
    "short_lines": "short_lines",
    "long_lines": "long_lines",
    "small_images": "small_images_quick",
    "instances_10k": "instances_10k",
}
"""What is compared, and the scene that it draws."""


def small_scenes() -> list[Scene]:
    """Return a small scene of each kind, so that every kernel is compiled."""
    colored = triangles_of(SMALL_FACES)
    rings, sides = torus_size(SMALL_FACES)
    normals = torus_normals(rings, sides, STRETCH)
    phong = mesh_70k_phong()
    return [
        colored,
        replace(colored, cull="back"),
        replace(colored, normals=normals, to_light=phong.to_light, eye=phong.eye),
        replace(colored, colors=None),
        replace(colored, colors=None, mode="edges"),
        short_lines(SMALL_LINES),
    ]


def drawer(scene: Scene, threads: int) -> Callable[[], Any]:
    """Return a function that draws a scene and returns the arrays of its picture."""
    if isinstance(scene, LineScene):
        return line_drawer(scene)
    if scene.colors is None and scene.texture is None and scene.mode == "fill":
        return face_drawer(scene, threads)
    return color_drawer(scene, threads)


def line_drawer(scene: LineScene) -> Callable[[], Any]:
    """Draw lines into one framebuffer."""
    import rasterjit as rj

    framebuffer = rj.Framebuffer(*scene.size)

    def draw() -> Any:
        framebuffer.clear((0, 0, 0, 0))
        framebuffer.draw_lines(scene.ends, scene.colors)
        return [framebuffer.color]

    return draw


def face_drawer(scene: TriangleScene, threads: int) -> Callable[[], Any]:
    """Find the visible faces of vertices in clip space."""
    import rasterjit as rj

    clip_positions, faces = scene.clip_positions(), scene.faces

    def draw() -> Any:
        found = rj.rasterize(clip_positions, faces, scene.size, threads=threads)
        return [found.face_id, found.depth]

    return draw


def color_drawer(scene: TriangleScene, threads: int) -> Callable[[], Any]:
    """Draw colours with one renderer, of every view."""
    import rasterjit as rj

    what = rj.Scene()
    colors = None if scene.colors is None else scene.colors / np.float32(255.0)
    is_lit = scene.normals is not None
    texture = None if scene.texture is None else rj.Texture(scene.texture, filter="bilinear")
    material = rj.Material(
        shading="phong" if is_lit else "unlit", base_color="white", base_color_texture=texture,
        specular=scene.specular, shininess=scene.shininess,
    )  # fmt: skip
    mesh = rj.Mesh(
        scene.positions, scene.faces, colors=colors, normals=scene.normals, uv=scene.uv,
        material=material,
    )  # fmt: skip
    for world_from_model in [np.eye(4)] if scene.instances is None else scene.instances:
        what.add(mesh, transform=world_from_model)
    if scene.to_light is not None:
        what.lights = [
            rj.AmbientLight(intensity=scene.ambient),
            rj.DirectionalLight(-scene.to_light),
        ]
    if scene.mode == "edges":
        what.wireframe = rj.Wireframe(color="white", mode="only")
    renderer = rj.Renderer(scene.size, threads=threads)
    render = partial(renderer.render, what, background="black", cull=scene.cull)
    matrices = [scene.clip_from_model] if scene.views is None else scene.views
    cameras = [rj.MatrixCamera(np.eye(4), matrix) for matrix in matrices]

    def draw() -> Any:
        return [render(camera).color for camera in cameras]

    return draw
