"""
Compile ahead: stages from a list, in as many processes as there are processors; then tiny scenes
that need every other kernel in its usual forms.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rasterjit.classics.framebuffer import FEW_PIXELS, Framebuffer
from rasterjit.inspect.pixel import explain_pixel
from rasterjit.outputs.table import OUTPUTS
from rasterjit.rendering.peel import render_layers
from rasterjit.rendering.rasterize import rasterize
from rasterjit.rendering.renderer import render
from rasterjit.runtime import ahead, jit
from rasterjit.runtime.ahead import Task
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.environment import Environment
from rasterjit.scene.framing import fit_camera
from rasterjit.scene.light import DirectionalLight, Shadow
from rasterjit.scene.material import SHADINGS, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene, Wireframe
from rasterjit.scene.texture import Texture
from rasterjit.scene.transforms import translate
from rasterjit.scene.view import View

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


USUAL = ("rasterjit.pipeline.surface.", "rasterjit.pipeline.lighting.")
"""How the names of the modules begin whose stages nearly every scene needs."""


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


def usual_stages() -> list[Task]:
    """Return tasks that compile the stages that nearly every scene needs, and the store lacks."""
    return ahead.compiling([one for one in jit.STAGES if one.__module__.startswith(USUAL)])


def run_step(name: str) -> None:
    """Run the step of some name."""
    next(step for step in steps() if step.name == name).run()


def compile_all(tell: Callable[[str, int, int], None], processes: int | None = None) -> None:
    """
    Fill the store.

    Parameters
    ----------
    tell : callable
        Called with what is under way, how much of it is done, and how much there is.
    processes : int or None
        How many at most; ``None`` takes the processors this process may run on.

    Raises
    ------
    Exception
        What could not be compiled.
    """
    stages = ahead.compiling(jit.STAGES)
    drawn = [Task(__name__, "run_step", (step.name,)) for step in steps()]
    for what, tasks in (("stages", stages), ("scenes", drawn)):
        done, total = itertools.count(1), len(tasks)
        tell(what, 0, total)
        failed = tasks
        if ahead.is_possible():
            count = partial(_count, tell, what, done, total)
            failed = ahead.do_all(tasks, count, processes)
        # Here, what went wrong shows.
        for task in failed:
            function = run_step if task.function == "run_step" else ahead.compile_one
            function(*task.arguments)


def _count(tell: Callable[[str, int, int], None], what: str, done: Any, total: int) -> None:
    tell(what, next(done), total)
