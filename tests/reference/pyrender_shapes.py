"""
Small scenes of edges, lines, points and turned faces, drawn by pyrender or by the adapter.

Run by a Python that has pyrender 0.1.45, it writes what pyrender draws, on Mesa, beside itself:
``PYOPENGL_PLATFORM=egl python tests/reference/pyrender_shapes.py``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

RECORD = Path(__file__).with_suffix(".npz")
SIZE = 28, 20
FLAGS = (
    "FLAT RGBA", "FLAT RGBA ALL_WIREFRAME", "FLAT RGBA ALL_SOLID", "FLAT FLIP_WIREFRAME",
    "FLAT RGBA ALL_WIREFRAME SKIP_CULL_FACES", "DEPTH_ONLY",
    "DEPTH_ONLY SKIP_CULL_FACES ALL_WIREFRAME", "SEG", "SEG RGBA", "FLAT VERTEX_NORMALS",
)  # fmt: skip


def turned(angle, axis, x=0.0, y=0.0, z=0.0):
    pose = trimesh.transformations.rotation_matrix(angle, axis)
    pose[:3, 3] = x, y, z
    return pose


def scenes(pyrender):
    """Return the scenes by name, of a module that is pyrender or like it."""

    class WeakPerspective(pyrender.Camera):
        def get_projection_matrix(self, width=None, height=None):
            return np.array([[0.9, 0, 0, 0.1], [0, 1.2, 0, -0.1], [0, 0, -1, 0], [0, 0, 0, 1]])

    def begin(camera, z=3.0):
        scene = pyrender.Scene(bg_color=[0.2, 0.4, 0.6, 0.25], ambient_light=[1.0, 1.0, 1.0])
        scene.add(camera, pose=turned(0.0, [1, 0, 0], z=z))
        return scene

    def look(color, **options):
        return pyrender.MetallicRoughnessMaterial(baseColorFactor=(*color, 1.0), **options)

    box, ball = trimesh.creation.box(), trimesh.creation.icosphere(subdivisions=1)
    bowl = trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 2] < 0.3])
    numbers = np.random.RandomState(3)
    places = numbers.uniform(-1.0, 1.0, (8, 3))
    colors = np.append(numbers.uniform(size=(8, 3)), np.ones((8, 1)), 1)
    box.visual.vertex_colors = np.uint8(colors * 255.0)

    mixed = begin(pyrender.PerspectiveCamera(yfov=1.0))
    mixed.add(pyrender.Mesh.from_trimesh(box, wireframe=True), pose=turned(0.6, [1, 1, 0]))
    mixed.add(
        pyrender.Mesh.from_trimesh(ball, material=look((0.2, 0.9, 0.3))),
        pose=turned(0.0, [1, 0, 0], 0.9, 0.2, -0.3),
    )
    open_side = begin(pyrender.PerspectiveCamera(yfov=1.0, znear=0.5, zfar=20.0))
    open_side.add(
        pyrender.Mesh.from_trimesh(bowl, material=look((1.0, 0.5, 0.2), doubleSided=True)),
        pose=turned(-0.5, [1, 0, 0], -0.6),
    )
    mirror = pyrender.Node(
        mesh=pyrender.Mesh.from_trimesh(bowl, material=look((0.9, 0.1, 0.4))),
        scale=[0.8, -0.8, 0.8], translation=[0.8, 0.1, -0.2],
    )  # fmt: skip
    open_side.add_node(mirror)
    weak = begin(WeakPerspective(znear=0.05, zfar=1000.0), z=0.0)
    weak.add(pyrender.Mesh.from_trimesh(ball, material=look((0.8, 0.8, 0.1))),
             pose=np.diag([0.7, 0.7, 0.7, 1.0]))  # fmt: skip
    flat = begin(pyrender.OrthographicCamera(xmag=1.3, ymag=1.3))
    flat.add(pyrender.Mesh.from_trimesh(box, smooth=False), pose=turned(0.6, [1, 1, 0]))
    made = {"mixed": mixed, "open": open_side, "weak perspective": weak, "parallel": flat}
    for mode, name in enumerate(("points", "lines", "loop", "strip")):
        scene = made[name] = begin(pyrender.PerspectiveCamera(yfov=1.0))
        primitive = pyrender.Primitive(
            positions=places, color_0=colors, mode=mode, material=look((1.0, 1.0, 1.0))
        )
        scene.add(pyrender.Mesh([primitive]))
    return made


def pictures(pyrender):
    """Yield name, flags and what is drawn: a list of arrays."""
    renderer = pyrender.OffscreenRenderer(*SIZE, point_size=3.0)
    for name, scene in scenes(pyrender).items():
        nodes = sorted(scene.mesh_nodes, key=lambda node: scene.get_pose(node)[0, 3])
        colors = {node: (40 * n + 30, 7, 200 - n) for n, node in enumerate(nodes)}
        for words in FLAGS:
            flags = sum(int(getattr(pyrender.RenderFlags, word)) for word in words.split())
            drawn = renderer.render(scene, flags, colors if "SEG" in words else None)
            yield name, words, list(drawn) if isinstance(drawn, tuple) else [drawn]
    renderer.delete()


def recorded():
    """Return what pyrender drew, by name and flags: a list of arrays each."""
    with np.load(RECORD) as record:
        keys = dict.fromkeys(key.rpartition("/")[0] for key in record)
        return {key: [record[f"{key}/{n}"] for n in range(2) if f"{key}/{n}" in record]
                for key in keys}  # fmt: skip


if __name__ == "__main__":
    import pyrender

    np.savez_compressed(
        RECORD,
        **{
            f"{name}: {words}/{n}": array
            for name, words, arrays in pictures(pyrender)
            for n, array in enumerate(arrays)
        },
    )
