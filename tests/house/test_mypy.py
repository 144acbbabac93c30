"""Type checkers pass the programs of the documentation, and find a misspelt name at its line."""

from __future__ import annotations

import ast
import doctest
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from test_readme import PAGES, steps

ROOT = Path(__file__).parents[2]

NOT_TYPED = {
    "docs/coming_from/pyrender.md",
    "docs/guides/animation.md",
    "docs/guides/cameras.md",
    "docs/guides/data_sets.md",
    "docs/guides/extending.md",
    "docs/guides/golden.md",
    "docs/guides/ground_truth.md",
    "docs/guides/guarantees.md",
    "docs/guides/point_clouds.md",
}
"""Pages in whose programs a checker needs annotations: of options in dicts, of names in tuples."""

pytestmark = [
    pytest.mark.takes_long,
    pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="mypy is not installed"),
]

BEGINNING = """\
import dataclasses
import numpy as np
import rasterjit as rj
from rasterjit import animation

vertices, faces = np.eye(3), [[0, 1, 2]]
mesh = rj.Mesh(vertices, faces)
scene = rj.Scene()
node = scene.add(mesh)
camera = rj.PerspectiveCamera((0, 0, 5), (0, 0, 0))
frame = rj.render(scene, camera, size=(64, 48), outputs=("color", "depth", "normal"))
renderer = rj.Renderer((64, 48))
"""
"""What the lines below find."""

RIGHT = """\
rj.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.array([[0, 1, 2]], np.uint8), colors=vertices)
rj.Mesh(vertices.tolist(), faces, normals=np.float32(vertices), uv=[(0, 0)] * 3, on_invalid="drop")
rj.PerspectiveCamera(eye=[0, 0, 5], target=np.zeros(3), up=(0, 1.5, 0), fov_y=40)
x, y, z = camera.eye
print(camera.eye[0] + x, rj.PointLight(np.ones(3)).position[1], camera.fov_y.hex())
rj.MatrixCamera(np.eye(4).tolist(), np.eye(4, dtype=np.float32)).view_from_world[0].sum()
dataclasses.replace(camera, fov_y=30.0, eye=np.ones(3))
rj.render(scene, camera, outputs="depth", cull="back", background="#102030")
rj.render(scene, camera, outputs={"depth", "normal"}, background=(0.1, 0.2, 0.3))
rj.render(mesh, outputs=["color", "face_id"], background=np.zeros(3, np.uint8)).face_id.max()
rj.render(mesh, time_budget=0.1).choice.quality.samples
arrays: dict[str, np.ndarray] = frame.arrays()
frame.save("all.npz", arrays)
np.savez("arrays.npz", allow_pickle=False, **arrays)
frame.save("depth.png", "depth", scale=0.001)
frame.save("some.npz", ("depth", "normal"))
scene.section = [rj.SectionPlane((0, 0, 0), np.ones(3), cap_color="red", lines=True)]
scene.section = rj.SectionPlane(np.zeros(3), [0, 0, 1])
print(rj.SectionPlane((0, 0, 0), (0, 0, 1)).normal[0])
rj.Quality(samples="area", texture_filter="anisotropic8", transparency_layers=4)
rj.Texture(vertices, wrap=("repeat", "mirror"), filter="nearest", anisotropy=1, uv_set=1)
node.world_from_model = [[1, 0, 0, 2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
node.world_from_model[0, 3].item()
mesh.material = rj.Material("pbr", "orange", alpha_mode="blend", double_sided=False)
scene.lights += [rj.AmbientLight(), rj.PointLight((0, 1, 0), shadow=rj.Shadow(filter="hard"))]
scene.fog, scene.tone_map = rj.Fog(mode="exp", density=0.1), None
scene.outline = rj.Outline(edges=["object"])
renderer.quality = rj.Quality.draft()
kept: list[rj.types.OutputName] = ["depth"]
shading: rj.types.Shading = "flat"
rj.render_layers(scene, k=2, outputs=kept)
rj.Material(shading)
kept_too: tuple[rj.types.Outputs, ...] = (rj.types.AttributeName("attribute:heat"), "depth")
try:
    rj.load("none.obj", on_damage="warn")
except rj.MeshFileError as error:
    print(error)
rj.fit_camera(scene, projection="orthographic")
rj.dataset.Recipe(outputs=("color", "mask"), layout="ring", up=[0, 0, 1])
rj.transforms.viewport(4, 3, "centers") @ np.ones(4)
animation.TransformTrack([0.0, 1.0], [np.eye(4), np.eye(4)], "smooth")
canvas = rj.Framebuffer(8, 8)
canvas.fill_triangle((0, 0), (7, 0), (0, 7), (255, 0, 0), edges="inclusive", method="scanline")
"""

WRONG = """\
rj.render(scene, camera, outputs=("color", "detph"))
rj.render(scene, camera, outputs="dept")
rj.render(scene, camera, outputs=["color", "normals"])
rj.render(scene, camera, outputs={"face_ids"})
rj.render(scene, camera, cull="backs")
rj.render(scene, camera, background=scene)
rj.render(scene, camera, ouputs=("color",))
rj.rendr(scene)
renderer.render(scene, camera, outputs=("colour",))
rj.explain(scene, outputs=("detph",))
rj.profile(scene, outputs=("detph",))
rj.render_layers(scene, k=2, outputs=("detph",))
rj.render_many(scene, [camera], outputs=("detph",))
rj.render_many(scene, [camera], progress="bars")
next(rj.render_many(scene, [camera], then=lambda frame: 3)).color
next(rj.render_many(scene, [camera])).colour
list(animation.frames(renderer, scene, [0.0], camera=camera, outputs=("detph",)))
frame.dpeth
frame.choice.qualty
frame.save("all.npz", "detph")
frame.save("all.npz", ["color", "detph"])
frame.masks("object")
rj.Material(shading="phongg")
rj.Material(metalic=1.0)
rj.Material(alpha_mode="transparent")
rj.Quality(samples=3)
rj.Quality(depth_format="float16")
rj.Quality(blending="srgb")
rj.Quality(interpolation="linear")
rj.Quality(texture_filter="anisotropic3")
rj.Quality(lines="smooth")
rj.Texture(vertices, wrap="tile")
rj.Texture(vertices, wrap=("repeat", "tile"))
rj.Texture(vertices, filter="linear")
rj.Texture(vertices, color_space="rgb")
rj.Texture(vertices, anisotropy=3)
rj.Texture(vertices, uv_set=2)
rj.Fog(mode="exp3")
rj.ToneMap("filmic")
rj.Shadow(filter="pcss")
rj.Outline(edges=("creases",))
rj.Wireframe(mode="lines")
rj.Mesh(vertices, faces, on_invalid="ignore")
rj.Mesh(rj, faces)
rj.Mesh(vertices, faces, colours=vertices)
rj.load("a.obj", on_damage="ignore")
rj.fit_camera(scene, projection="ortho")
rj.rasterize(np.eye(4), faces, (8, 8), depth="reverse")
rj.show(scene, backend="qt")
rj.cameras.from_opencvv
rj.cameras.from_blender(np.eye(4), size=(4, 3), sensor_fit="VERT")
rj.transforms.viewport(4, 3, "corners")
rj.dataset.Recipe(outputs=("masks",))
rj.dataset.Recipe(layout="spiral")
rj.Framebuffer(8, 8).fill_triangle((0, 0), (7, 0), (0, 7), (255, 0, 0), edges="topleft")
animation.TransformTrack([0.0, 1.0], [np.eye(4), np.eye(4)], "cubic")
scene.fogg = rj.Fog()
scene.fog = rj.ToneMap()
node.transfrom = np.eye(4)
renderer.qualtiy = rj.Quality()
mesh.vertices = vertices
camera.fov = 30.0
camera.fov_y = 30.0
shading: rj.types.Shading = "phongg"
"""


def programs_of_pages():
    """Yield the name and the text of each program of the pages for readers."""
    for page in set(PAGES) - NOT_TYPED:
        name = re.sub(r"\W", "_", page.removesuffix(".md"))
        for n, (language, program) in enumerate(steps(page), 1):
            if language == "python":
                yield f"{name}_{n}", program


def programs_of_docstrings():
    """Yield the name and the text of each docstring with examples, with what is around it."""
    for path in sorted((ROOT / "rasterjit").rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
            text = ast.get_docstring(node) if isinstance(node, kinds) else None
            examples = doctest.DocTestParser().get_examples(text or "")
            if examples:
                name = f"{module}.{getattr(node, 'name', 'itself')}".replace(".", "_")
                around = f"import numpy as np\nimport rasterjit as rj\nfrom {module} import *\n"
                yield name, around + "".join(one.source for one in examples)


def check(folder):
    """Return what mypy says of the programs in a folder: (file, line, message) of each error."""
    done = subprocess.run(
        [
            sys.executable, "-m", "mypy", "--check-untyped-defs", "--follow-imports=silent",
            "--hide-error-context", "--no-error-summary", "--config-file=", "--cache-dir", ".cache",
            *sorted(path.name for path in folder.glob("*.py")),
        ],
        cwd=folder, capture_output=True, text=True, env=os.environ | {"MYPYPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stdout + done.stderr
    found = re.findall(r"^(\w+)\.py:(\d+): error: (.*)$", done.stdout, re.MULTILINE)
    assert len(found) == len(done.stdout.splitlines()) - done.stdout.count(": note: "), done.stdout
    return [(name, int(line), message) for name, line, message in found]


@pytest.fixture(scope="module")
def errors(tmp_path_factory):
    """Return what mypy says of all programs, those with planted errors among them."""
    folder = tmp_path_factory.mktemp("programs")
    programs = {
        **dict(programs_of_pages()),
        **dict(programs_of_docstrings()),
        "right": BEGINNING + RIGHT,
        "wrong": BEGINNING + WRONG,
    }
    assert len(programs) > 20
    for name, text in programs.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    return check(folder)


def test_programs_of_the_documentation_and_right_ones_pass(errors):
    assert [error for error in errors if error[0] != "wrong"] == []


def test_each_planted_error_is_found_at_its_line_and_nowhere_else(errors):
    first = BEGINNING.count("\n") + 1
    planted = dict(enumerate(WRONG.splitlines(), first))
    found = {line for name, line, _ in errors if name == "wrong"}
    assert {planted.get(line, line) for line in planted.keys() ^ found} == set()


def test_the_right_program_runs(tmp_path):
    done = subprocess.run(
        [sys.executable, "-W", "ignore::UserWarning:rasterjit", "-c", BEGINNING + RIGHT],
        cwd=tmp_path, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "does not exist" in done.stdout
