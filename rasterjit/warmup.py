"""
Compile ahead: draw tiny scenes that need every kernel in its usual forms.

A kernel has one compiled form for each combination of effects that are present or absent, so each
step below renders a few pixels of a scene with one such combination.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from rasterjit.framebuffer import FEW_PIXELS, Framebuffer
from rasterjit.pixel import explain_pixel
from rasterjit.plan import OUTPUTS
from rasterjit.rasterize import rasterize
from rasterjit.render import render
from rasterjit.scene.camera import PerspectiveCamera, fit_camera
from rasterjit.scene.material import SHADINGS, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import Scene, Wireframe
from rasterjit.scene.texture import Texture

SIZE = (16, 16)
SEVERAL_TILES = (256, 192)
"""Triangles of the square are large here: they cover whole tiles."""

VERTICES = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float64)
FACES = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
"""A square of two triangles."""

COLORINGS = {"plain": None, "vertex colours": len(VERTICES), "face colours": len(FACES)}
"""How a mesh may be coloured, by the rows of its colours."""

TEXTURED = "textured"
"""Coloured by a texture alone."""

MATT, SHINY = 0.0, 0.25
"""Strengths of the highlight: without one, its code is compiled out."""


class Step(NamedTuple):
    """One scene that makes kernels compile."""

    name: str
    run: Callable[[], object]


def steps() -> list[Step]:
    """Return what has to run for every usual kernel to be compiled."""
    found = [Step("all buffers", _draw_buffers), Step("clipping", _draw_clipped)]
    for shading, coloring in itertools.product(SHADINGS, (*COLORINGS, TEXTURED)):
        strengths = (SHINY,) if shading == "unlit" else (SHINY, MATT)
        for specular in strengths:
            gloss = "" if shading == "unlit" else (", shiny" if specular else ", matt")
            name = f"{shading}{gloss}, {coloring}"
            found.append(Step(name, partial(_draw_shaded, shading, coloring, specular)))
    found += [
        Step(f"wireframe, {mode}", partial(_draw_wireframe, mode)) for mode in ("overlay", "only")
    ]
    found += [
        Step("diagnostics", _diagnose),
        Step("rasterize", _rasterize),
        Step("framebuffer lines and curves", _draw_lines),
        Step("framebuffer triangles", _fill_triangles),
    ]
    return found


def _square(shading: str = "phong", coloring: str = "plain", specular: float = SHINY) -> Scene:
    """Return a scene with the square alone."""
    rows = COLORINGS.get(coloring)
    colors = None if rows is None else np.ones((rows, 4), np.float32)
    texture = Texture(np.ones((2, 2))) if coloring == TEXTURED else None
    material = Material(shading=shading, specular=specular, base_color_texture=texture)
    scene = Scene()
    scene.add(Mesh(VERTICES, FACES, colors=colors, uv=VERTICES[:, :2], material=material))
    return scene


def _draw_shaded(shading: str, coloring: str, specular: float) -> None:
    render(_square(shading, coloring, specular), size=SIZE, threads=1)


def _draw_buffers() -> None:
    render(_square(), size=SEVERAL_TILES, outputs=OUTPUTS, threads=1)
    # Without smooth normals the normals kernel is the same: it is given an empty table.
    render(_square("flat"), size=SIZE, outputs=("normal",), threads=1)


def _draw_clipped() -> None:
    camera = PerspectiveCamera(eye=(0.0, 0.1, 0.0), target=(1.0, 0.1, 0.1), near=0.1)
    render(_square(), camera, size=SIZE, threads=1)


def _draw_wireframe(mode: str) -> None:
    scene = _square()
    scene.wireframe = Wireframe(mode=mode)
    render(scene, fit_camera(scene), size=SIZE, threads=1)


def _diagnose() -> None:
    render(_square(), size=SIZE, threads=1, diagnose=True)
    explain_pixel(_square(), None, SIZE, 0, 0)


def _rasterize() -> None:
    clip_positions = np.hstack([VERTICES, np.ones((len(VERTICES), 1))])
    rasterize(clip_positions, FACES, SIZE, threads=1).barycentric.sum()


def _draw_lines() -> None:
    target = Framebuffer(*SIZE)
    target.draw_line((0, 0), (9, 5), (255, 0, 0), (0, 0, 255))
    many = np.full((FEW_PIXELS // min(SIZE) + 2, 4), (0, 0, 2**10, 5))
    many[-1, 2] = 2**20
    target.draw_lines(many, (255, 0, 0))
    target.draw_circle((8, 8), 5, (255, 0, 0))
    target.draw_bezier([(0, 0), (8, 0), (8, 8)], (255, 0, 0))


def _fill_triangles() -> None:
    target = Framebuffer(*SIZE)
    for method, depth in itertools.product(("barycentric", "scanline"), (None, (0.5, 0.5, 0.5))):
        target.fill_triangle((0, 0), (9, 0), (0, 9), (255, 0, 0), method=method, depth=depth)
