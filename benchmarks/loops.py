"""
``python -m benchmarks.loops [--against COMMIT] [--only LOOP]``: what a step of users' loops costs.

Each loop is a small piece of work, done again and again: a frame of a kept renderer, a world of
moving objects, a single line, a written picture. Prints processor time of a step, and of some loops
its ratio to another's. With ``--against``, two versions take turns, and the ratio of the later to
the earlier one is the median of all turns.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from benchmarks import report
from benchmarks.checkouts import RevisionError, checkouts
from benchmarks.compare import Tree
from benchmarks.judging import judge_times
from benchmarks.meshes import torus, torus_size
from benchmarks.pairing import PREPARE_SECONDS, Worker
from benchmarks.scenes import TEAPOT

SIDE = 64
"""Columns and rows of the small pictures."""
BATCH = 60
FILES = (
    "stl", "stl text", "obj", "obj bare", "ply", "ply text", "ply bare", "glb", "gltf of instances",
)  # fmt: skip
"""Kinds of files that are read."""
FACES_OF_FILE, INSTANCES = 60_000, 10_000
TURN_SECONDS = 0.1
"""Processor time that a loop runs in a turn."""
TURNS = 11
EYES = [
    (3.0 * float(np.cos(angle)), 1.5, 3.0 * float(np.sin(angle)))
    for angle in np.linspace(0.0, 2.0 * np.pi, BATCH, endpoint=False)
]


def cameras() -> list[Any]:
    """Return cameras around the origin."""
    import rasterjit as rj

    return [rj.PerspectiveCamera(eye=eye, target=(0.0, 0.0, 0.0), fov_y=40.0) for eye in EYES]


def cube() -> Any:
    """Return a cube around the origin."""
    import trimesh

    import rasterjit as rj

    box = trimesh.creation.box()
    return rj.Mesh(box.vertices, box.faces, material=rj.Material(shading="flat"))


def again(values: list[Any]) -> Callable[[], Any]:
    """Return a function that gives one value after another, for ever."""

    def turns() -> Iterator[Any]:
        while True:
            yield from values

    return turns().__next__


def kept_cube() -> Callable[[], Any]:
    """Frames of a kept renderer, each from elsewhere."""
    import rasterjit as rj

    renderer, camera = rj.Renderer(size=(SIDE, SIDE), threads=1), again(cameras())
    scene = cube()
    return lambda: renderer.render(scene, camera())


def lone_cube() -> Callable[[], Any]:
    """Frames by themselves."""
    import rasterjit as rj

    scene, camera = cube(), again(cameras())
    return lambda: rj.render(scene, camera(), size=(SIDE, SIDE), threads=1)


def batch_of(count: int, is_mesh: bool = False) -> Callable[[], Any]:
    """Batches of some views of a scene, or of a lone mesh, a step for all of them."""
    import rasterjit as rj

    scene, views, mesh = rj.Scene(), cameras(), cube()
    scene.add(mesh)
    what = mesh if is_mesh else scene
    groups = again([views[k : k + count] for k in range(0, BATCH, count)])
    return lambda: rj.render_batch(what, groups(), size=(SIDE, SIDE), threads=1)


def moving(count: int) -> Callable[[], Any]:
    """Depth and ids of moving objects, by a kept renderer."""
    import rasterjit as rj

    scene, mesh = rj.Scene(), cube()
    nodes = [scene.add(mesh) for _ in range(count)]
    renderer = rj.Renderer(size=(SIDE, SIDE), threads=1)
    camera, random = cameras()[0], np.random.default_rng(0)
    places = np.tile(np.eye(4), (BATCH, count, 1, 1))
    places[..., :3, 3] = random.uniform(-1.0, 1.0, (BATCH, count, 3))
    place = again(list(places))

    def step() -> Any:
        for node, matrix in zip(nodes, place(), strict=True):
            node.world_from_model = matrix
        return renderer.render(scene, camera, outputs=("depth", "object_id"))

    return step


def faces(samples: Any) -> Callable[[], Any]:
    """Frames of 5,000 faces by a kept renderer, of some samples or of exact areas."""
    import rasterjit as rj

    mesh = rj.Mesh(*torus(*torus_size(5000)))
    quality, camera = rj.Quality(samples=samples), again(cameras())
    renderer = rj.Renderer(size=(SIDE, SIDE), threads=1, quality=quality)
    return lambda: renderer.render(mesh, camera())


def line() -> Callable[[], Any]:
    """A line of 50 pixels in a framebuffer."""
    import rasterjit as rj

    framebuffer = rj.Framebuffer(SIDE, SIDE)
    return lambda: framebuffer.draw_line((3, 5), (52, 30), (255, 0, 0), (0, 0, 255))


def triangle() -> Callable[[], Any]:
    """A triangle of 10 by 10 pixels in a framebuffer."""
    import rasterjit as rj

    framebuffer = rj.Framebuffer(SIDE, SIDE)
    colors = [(255, 0, 0), (0, 255, 0), (0, 0, 255)]
    return lambda: framebuffer.fill_triangle((3, 5), (13, 5), (3, 15), colors)


def saved(output: str) -> Callable[[], Any]:
    """An output of 640 by 480 pixels, written as a file."""
    import rasterjit as rj

    frame = rj.render(rj.load(TEAPOT), size=(640, 480), outputs=("color", "depth"), threads=1)
    folder = tempfile.TemporaryDirectory()
    return lambda: frame.save(Path(folder.name) / "saved.png", output)


def thumbnail(look: str) -> Callable[[], Any]:
    """The first picture of a new mesh, 160 by 120 pixels."""
    import rasterjit as rj

    vertices, faces = torus(*torus_size(2000))
    style = getattr(rj.styles, look)
    return lambda: style(rj.Mesh(vertices, faces)).render(size=(160, 120), threads=1)


def further(look: str) -> Callable[[], Any]:
    """Further pictures of a kept scene in a style, 1280 by 720 pixels, from all around."""
    import rasterjit as rj

    style = getattr(rj.styles, look)(rj.load(TEAPOT))
    eyes = [(2.0 * x, 4.0 + y, 2.0 * z) for x, y, z in EYES[::7]]
    camera = again([rj.PerspectiveCamera(eye, (0.0, 1.5, 0.0)) for eye in eyes])
    return lambda: style.render(camera(), size=(1280, 720), threads=1)


def lit(effect: str) -> Callable[[], Any]:
    """The same of one lamp and light from all around, alone or with an effect."""
    import rasterjit as rj

    scene = rj.load(TEAPOT)
    shadow = rj.Shadow(1024, "soft", 8.0) if effect == "soft shadow" else None
    scene.lights = [rj.DirectionalLight((-1.0, -1.0, -1.0), shadow=shadow), rj.AmbientLight()]
    if effect == "ambient occlusion":
        scene.ambient_occlusion = rj.AmbientOcclusion()
    renderer = rj.Renderer(size=(1280, 720), threads=1)
    return lambda: renderer.render(scene)


def written_file(folder: Path, kind: str) -> Path:
    """
    Write a torus as a file of a kind, or many instances of a cube; return where it is.

    An OBJ file has texture coordinates and normals, PLY and GLB files normals, but for those that
    are bare.
    """
    import trimesh

    import rasterjit as rj

    words = kind.split()
    path = folder / f"written.{words[0]}"
    if kind == "gltf of instances":
        scene, mesh = rj.Scene(), cube()
        for place in np.random.default_rng(0).uniform(-9.0, 9.0, (INSTANCES, 3)):
            scene.add(mesh, rj.transforms.translate(place))
        scene.save(path)
        return path
    vertices, faces = torus(*torus_size(FACES_OF_FILE))
    shape = trimesh.Trimesh(vertices, faces, process=False)
    if words[0] == "stl":
        shape.export(path, file_type="stl_ascii" if "text" in words else "stl")
    elif words[0] == "ply":
        encoding = "ascii" if "text" in words else "binary"
        shape.export(path, encoding=encoding, vertex_normal="bare" not in words)
    elif words[0] == "glb":
        shape.export(path, include_normals=True)
    else:
        lines = ["v {:.6f} {:.6f} {:.6f}".format(*row) for row in vertices]
        corner = "{0}"
        if "bare" not in words:
            lines += ["vt {:.6f} {:.6f}".format(*row) for row in vertices[:, :2]]
            lines += ["vn {:.6f} {:.6f} {:.6f}".format(*row) for row in shape.vertex_normals]
            corner = "{0}/{0}/{0}"
        lines += ["f " + " ".join(corner.format(n) for n in face) for face in faces + 1]
        path.write_text("\n".join(lines) + "\n")
    return path


def loaded(kind: str, by: str) -> Callable[[], Any]:
    """A file, read by RasterJIT or trimesh; the latter makes normals as well if there are none."""
    import trimesh

    import rasterjit as rj

    folder = tempfile.TemporaryDirectory()
    path = written_file(Path(folder.name), kind)

    def step() -> Any:
        if by == "rasterjit":
            # The folder is kept.
            return folder and rj.load(path)
        found: Any = trimesh.load(path)
        if kind == "gltf of instances":
            return found
        return next(iter(getattr(found, "geometry", {"": found}).values())).vertex_normals

    return step


def around(effect: str, is_batch: bool = False) -> Callable[[], Any]:
    """Small views of a ball on a ground with an effect, 60 in a step: as a batch, or one by one."""
    import trimesh

    import rasterjit as rj

    scene, size = rj.Scene(), (2 * SIDE, 2 * SIDE)
    ball, ground = trimesh.creation.icosphere(3), trimesh.creation.box((6.0, 0.1, 6.0))
    for mesh, down in ((ball, 0.0), (ground, 1.2)):
        own = rj.Mesh(mesh.vertices, mesh.faces, normals=mesh.vertex_normals)
        scene.add(own, rj.transforms.translate((0.0, -down, 0.0)))
    shadow = rj.Shadow() if effect == "shadow" else None
    scene.lights = [rj.DirectionalLight((-1.0, -1.0, -1.0), shadow=shadow), rj.AmbientLight()]
    scene.outline = rj.Outline() if effect == "outline" else None
    scene.ambient_occlusion = rj.AmbientOcclusion() if effect == "ambient occlusion" else None
    renderer, views = rj.Renderer(size, threads=1), cameras()
    if is_batch:
        return lambda: rj.render_batch(scene, views, size=size, threads=1)
    return lambda: [renderer.render(scene, camera) for camera in views]


class Loop(NamedTuple):
    """A loop, and what its steps are compared with."""

    prepare: Callable[[], Callable[[], Any]]
    """Takes the package that is on the path; returns a step."""
    beside: str = ""
    """The loop whose step is 1.0."""


LOOPS: dict[str, Loop] = {
    "kept cube": Loop(kept_cube),
    "lone cube": Loop(lone_cube, "kept cube"),
    "batch of one": Loop(lambda: batch_of(1), "kept cube"),
    "batch of one, a mesh": Loop(lambda: batch_of(1, is_mesh=True), "kept cube"),
    f"batch of {BATCH}": Loop(lambda: batch_of(BATCH), "kept cube"),
    "1 moving": Loop(lambda: moving(1)),
    "2 moving": Loop(lambda: moving(2), "1 moving"),
    "8 moving": Loop(lambda: moving(8), "1 moving"),
    "20 moving": Loop(lambda: moving(20), "1 moving"),
    "faces": Loop(lambda: faces(1)),
    "faces, areas": Loop(lambda: faces("area"), "faces"),
    "line": Loop(line),
    "triangle": Loop(triangle),
    "save color": Loop(lambda: saved("color")),
    "save depth": Loop(lambda: saved("depth")),
    "new mesh, plain": Loop(lambda: thumbnail("plain")),
    "new mesh, studio": Loop(lambda: thumbnail("studio"), "new mesh, plain"),
    "further, plain": Loop(lambda: further("plain")),
    "further, studio": Loop(lambda: further("studio"), "further, plain"),
    "lamp": Loop(lambda: lit("")),
    "lamp, soft shadow": Loop(lambda: lit("soft shadow"), "lamp"),
    "lamp, ambient occlusion": Loop(lambda: lit("ambient occlusion"), "lamp"),
    **{f"trimesh's {kind}": Loop(partial(loaded, kind, "trimesh")) for kind in FILES},
    **{
        f"load {kind}": Loop(partial(loaded, kind, "rasterjit"), f"trimesh's {kind}")
        for kind in FILES
    },
}
for _effect in ("no effect", "shadow", "outline", "ambient occlusion"):
    _views = f"{BATCH} views, {_effect}"
    LOOPS[_views] = Loop(partial(around, _effect))
    LOOPS[f"batch of {_views}"] = Loop(partial(around, _effect, True), _views)


class Turns:
    """The loops of one version, in its process."""

    def __init__(self) -> None:
        self._steps: dict[str, Callable[[], Any]] = {}

    def measure(self, name: str) -> float:
        """Return the milliseconds of processor time that a step takes."""
        if name not in self._steps:
            self._steps[name] = LOOPS[name].prepare()
            for _ in range(3):
                self._steps[name]()
        step, count, started = self._steps[name], 0, time.process_time()
        while (taken := time.process_time() - started) < TURN_SECONDS:
            step()
            count += 1
        return 1e3 * taken / count


def measure(trees: list[Tree], names: list[str]) -> dict[str, list[list[float]]]:
    """Return the milliseconds of each turn, by loop and by version."""
    found: dict[str, list[list[float]]] = {name: [[] for _ in trees] for name in names}
    with ExitStack() as stack:
        workers: list[Worker] = []
        for tree in trees:
            workers.append(tree.worker("loops"))
            stack.callback(workers[-1].close)
            workers[-1].answer(PREPARE_SECONDS)
        for turn in range(TURNS):
            for name in names:
                # The version that begins changes from turn to turn.
                for number in range(len(trees))[:: 1 if turn % 2 else -1]:
                    workers[number].tell(name)
                    # The first of a loop compiles.
                    found[name][number].append(workers[number].answer(PREPARE_SECONDS)["ms"])
    return found


@click.command()
@click.option("--against", default=None, help="Commit to measure as well.")
@click.option("--only", multiple=True, type=click.Choice(list(LOOPS)), metavar="LOOP")
def main(against: str | None, only: tuple[str, ...]) -> None:
    """Measure the steps of loops."""
    names = list(only or LOOPS)
    names += [LOOPS[name].beside for name in names if LOOPS[name].beside]
    names = [name for name in LOOPS if name in names]
    with tempfile.TemporaryDirectory() as folder:
        try:
            with checkouts([".", *([against] if against else [])], Path(folder)) as versions:
                trees = [Tree(n, p, Path(folder) / f"cache-{n}") for n, p in versions]
                found = measure(trees, names)
        except RevisionError as error:
            raise click.ClickException(str(error)) from None
    rows = []
    for name in names:
        now, beside = found[name], LOOPS[name].beside
        row = [name, f"{statistics.median(now[0]):.3g}"]
        row.append(
            f"{judge_times('', found[beside][0], now[0]).ratio:.2f} {beside}" if beside else ""
        )
        if against:
            judged = judge_times("", now[1], now[0])
            row += [f"{judged.ratio:.3f}", f"{judged.low:.3f} .. {judged.high:.3f}"]
        rows.append(row)
    columns = ["a step", "ms", "ratio to"] + (["to before", "quartiles"] if against else [])
    report.print_table("processor time of a step", columns, rows)


if __name__ == "__main__":
    main()
