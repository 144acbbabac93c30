"""What changes in each program for RasterJIT to draw it."""

from __future__ import annotations

import difflib
from pathlib import Path

FOLDER = Path(__file__).parent / "programs"
PROGRAMS = tuple(sorted(path.stem for path in FOLDER.glob("[!_]*.py")))

Changes = tuple[tuple[str, str], ...]

INSTALLED = """
import rasterjit.compat.{0}

rasterjit.compat.{0}.install()
"""

OF_LIBRARY: dict[str, Changes] = {
    "trimesh": (("import trimesh\n", "import trimesh\n" + INSTALLED.format("trimesh")),),
    "mujoco": (
        ("import mujoco\n", "import mujoco\nimport rasterjit.compat.mujoco\n"),
        ("mujoco.Renderer(", "rasterjit.compat.mujoco.Renderer("),
    ),
    "pybullet": (
        ("import pybullet_data\n", "import pybullet_data\n" + INSTALLED.format("pybullet")),
    ),
}
"""What is replaced by what in the programs of a library."""

OF_PROGRAM: dict[str, Changes] = {
    "trimesh_in_a_container": (
        *OF_LIBRARY["trimesh"],
        ("from pyglet import gl\n", ""),
        ("window_conf = gl.Config(double_buffer=True, depth_size=24)\n", ""),
        (", window_conf=window_conf", ""),
    ),
    "trimesh_camera_rays": (
        ("import trimesh\n", "import trimesh\n\nimport rasterjit as rj\n"),
        ("origins, vectors, pixels = scene.camera_rays()\n", (
            "camera = rj.cameras.from_trimesh(scene.camera, scene.camera_transform)\n"
        )),
        ("points, ray_of_hit, _ = mesh.ray.intersects_location("
         "origins, vectors, multiple_hits=False)\n", (
            'frame = rj.render(rj.load(scene), camera, size=(640, 480), outputs="distance")\n'
        )),
        ("depth = trimesh.util.diagonal_dot(points - origins[0], vectors[ray_of_hit])\n", ""),
        ("picture = np.full(scene.camera.resolution, np.inf)\n", ""),
        ("picture[tuple(pixels[ray_of_hit].T)] = depth\n", ""),
        ("depths = [picture.T[::-1]]", "depths = [frame.distance]"),
    ),
    "mujoco_gymnasium": (
        ("import gymnasium\n", "import gymnasium\nimport rasterjit.compat.mujoco\n"),
        ("environment.action_space.seed", (
            "environment = rasterjit.compat.mujoco.draw_environment(environment)\n"
            "environment.action_space.seed"
        )),
    ),
    "pybullet_panda_gym": (
        ("import panda_gym  # noqa: F401\n", (
            "import panda_gym  # noqa: F401\n" + INSTALLED.format("pybullet")
        )),
    ),
}  # fmt: skip
"""Likewise, of single programs, in place of their library's."""


def read(name: str) -> str:
    """Return the text of a program as it was published, but typed anew."""
    return (FOLDER / f"{name}.py").read_text("utf-8")


def change(name: str) -> str:
    """Return the text of a program that RasterJIT draws."""
    text = read(name)
    for old, new in OF_PROGRAM.get(name) or OF_LIBRARY[name.split("_")[0]]:
        if old not in text:
            raise ValueError(f"{name} must contain {old!r}")
        text = text.replace(old, new)
    return text


def count_changes(name: str) -> int:
    """Return how many lines of a program are new, other or gone; empty ones do not count."""
    old, new = ([line for line in text.splitlines() if line.strip()]
                for text in (read(name), change(name)))  # fmt: skip
    steps = difflib.SequenceMatcher(a=old, b=new, autojunk=False).get_opcodes()
    return sum(max(b - a, d - c) for kind, a, b, c, d in steps if kind != "equal")


def find_source(name: str) -> str:
    """Return where a program was published: the end of its docstring."""
    return read(name).split('"""')[1].strip().split("\n\n")[-1]
