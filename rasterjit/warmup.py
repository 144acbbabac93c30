"""
Compile ahead: draw tiny scenes that need every kernel in its usual forms.

A kernel has one compiled form for each combination of effects that are present or absent, so each
step below renders a few pixels of a scene with one such combination.

Compilers hold Python's lock, so two threads are no faster than one. Two processes are: the kernels
up to visibility have one form whatever the scene, so another process can compile them while this
one does those that shade, with a frame in which nothing is visible. They meet in the disk cache.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit import stages
from rasterjit.framebuffer import FEW_PIXELS, Framebuffer
from rasterjit.kernels.jit import cache_folder, is_cached
from rasterjit.kernels.records import Faces, Objects, Viewport
from rasterjit.kernels.setup import INVALID, TILE_SIZE
from rasterjit.kernels.shading import shade_rows
from rasterjit.kernels.visibility import draw_tiles
from rasterjit.peeling import render_layers
from rasterjit.pixel import explain_pixel
from rasterjit.plan import OUTPUTS
from rasterjit.rasterize import rasterize
from rasterjit.render import Renderer, render
from rasterjit.scene.camera import PerspectiveCamera, fit_camera
from rasterjit.scene.environment import Environment
from rasterjit.scene.light import DirectionalLight, Shadow
from rasterjit.scene.material import SHADINGS, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene, Wireframe
from rasterjit.scene.texture import Texture
from rasterjit.scene.view import View
from rasterjit.transforms import translate
from rasterjit.workers import Workers, available_processors

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


OTHER_PROCESS = """
import os, sys, threading
sys.path[:] = sys.argv[1:]
threading.Thread(target=lambda: sys.stdin.read() or os._exit(1), daemon=True).start()
from rasterjit import warmup
warmup.compile_visibility()
"""
"""
What the other process runs: it finds the modules where this one does, and nowhere else.

It ends with this one, however that ends: nobody else holds the other end of its standard input.
"""

PATIENCE = 120.0
"""Seconds after which the other process has failed, and this one compiles everything."""


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
        Step("shadows", _draw_shadows),
        Step("environment", _draw_environment),
        Step("transparency", partial(_draw_layers, "blend", 1)),
        Step("anti-aliasing", partial(_draw_layers, "opaque", 4)),
        Step("whole pictures averaged", partial(_draw_layers, "opaque", 64)),
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
    render(_square(), size=SEVERAL_TILES, outputs=OUTPUTS, previous=View(), threads=1)
    render_layers(_square(), k=2, size=SIZE, threads=1)
    # Without smooth normals the normals kernel is the same: it is given an empty table.
    render(_square("flat"), size=SIZE, outputs=("normal",), threads=1)


def _draw_clipped() -> None:
    camera = PerspectiveCamera(eye=(0.0, 0.1, 0.0), target=(1.0, 0.1, 0.1), near=0.1)
    render(_square(), camera, size=SIZE, threads=1)


def _draw_wireframe(mode: str) -> None:
    scene = _square()
    scene.wireframe = Wireframe(mode=mode)
    render(scene, fit_camera(scene), size=SIZE, threads=1)


def _draw_shadows() -> None:
    scene = _square()
    scene.lights.append(DirectionalLight(shadow=Shadow(32)))
    # Something that may cast shadows must lie between the light and what is seen.
    scene.add(scene.nodes[0].mesh, translate((0.0, 0.0, 1.0)))
    render(scene, size=SIZE, threads=1)


def _draw_environment() -> None:
    scene = _square("pbr")
    scene.environment = Environment.gradient()
    render(scene, size=SIZE, threads=1)


def _draw_layers(alpha_mode: str, samples: int) -> None:
    material = Material(base_color=(1.0, 1.0, 1.0, 0.5), alpha_mode=alpha_mode)
    scene = Scene()
    scene.add(Mesh(VERTICES, FACES, material=material))
    render(scene, size=SIZE, quality=Quality(samples=samples), threads=1)


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


class BlankRenderer(Renderer):
    """Renders frames in which nothing is visible: calls all kernels but those before shading."""

    def _find_visible(
        self,
        vertices: stages.ModelVertices,
        faces: NDArray[np.int32],
        objects: Objects,
        depth_coefficients: tuple[float, float, float],
        viewport: Viewport,
        workers: Workers,
        clock: Callable[[str], None],
        *,
        keep_lists: bool,
        keep_clip_positions: bool,
        **_: Any,
    ) -> stages.Coverage:
        """Return what the stages would, were nothing in view; it calls none of their kernels."""
        shape = viewport.height, viewport.width
        clip_positions = np.empty((0, 4), np.float64)
        if keep_clip_positions:
            clip_positions = stages.transform(*vertices, workers)
        # Neither is any edge.
        screen = stages.screen_arrays(len(vertices.positions), workers.memory)
        screen.codes[:] = INVALID
        return stages.Coverage(
            np.full(shape, -np.inf, np.float32),
            np.full(shape, -1, np.int32),
            screen,
            clip_positions,
            stages.Totals(len(faces), len(faces), 0, 0, 0, 0, 0, 0),
            _no_lists(faces, viewport, objects) if keep_lists else None,
        )


def _no_lists(faces: NDArray[np.int32], viewport: Viewport, objects: Objects) -> stages.TileLists:
    """Return lists of tiles that draw nothing."""
    tiles = -(-viewport.width // TILE_SIZE) * -(-viewport.height // TILE_SIZE)
    no_pieces = Faces(faces, np.empty((0, 3), np.int32), np.empty(0, np.int32))
    starts, nothing = np.zeros(tiles + 1, np.int64), np.empty(0, np.int32)
    return stages.TileLists(starts, nothing, no_pieces, objects)


def compile_visibility() -> None:
    """Compile or load the kernels from the vertices to the visible faces."""
    render(_square(), size=SIZE, outputs=("face_id",), threads=1)


@contextmanager
def two_processes(threads: int | None) -> Iterator[Callable[..., None] | None]:
    """
    Compile the kernels of a first frame in two processes.

    Parameters
    ----------
    threads : int or None
        What the user allows; with 1 everything is left to this process.

    Yields
    ------
    callable or None
        To be called with what ``Renderer.render`` is going to be given. On return the kernels are
        in the disk cache. ``None`` if they were before, if there is no other processor or no cache,
        or if another Python would not be like this one: then rendering compiles as it goes.
    """
    kernels = draw_tiles, shade_rows
    if (
        threads == 1
        or available_processors() == 1
        or not sys.executable
        or getattr(sys, "frozen", False)
        or sys.flags.isolated
        or cache_folder() is None
        or any(is_cached(one) for one in kernels)
    ):
        yield None
        return
    other = subprocess.Popen(
        [sys.executable, "-c", OTHER_PROCESS, *sys.path],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip

    def compile_all(what: Any, camera: Any, quality: Quality | None = None, **options: Any) -> None:
        BlankRenderer(SIZE, quality=quality, threads=1).render(what, camera, **options)
        with suppress(subprocess.TimeoutExpired):
            other.wait(PATIENCE)

    try:
        yield compile_all
    finally:
        other.kill()
        other.communicate()
