"""A folder of small meshes, and of files that are none."""

import hashlib

import numpy as np
import trimesh

GOOD = ("ball.ply", "box.stl", "parts/cone.off", "parts/deeper/ring.glb", "tri angle.obj")
BROKEN = ("cut.glb", "empty.obj", "parts/text.stl")
IGNORED = (".hidden.stl", ".git/box.stl", "notes.txt", "parts/picture.png")


def make_meshes(folder):
    """Write them; return the folder."""
    made = {
        "ball.ply": trimesh.creation.icosphere(subdivisions=1, radius=0.01),
        "box.stl": trimesh.creation.box((200.0, 100.0, 50.0)),
        "parts/cone.off": trimesh.creation.cone(1.0, 2.0, sections=8),
        "parts/deeper/ring.glb": trimesh.creation.torus(1.0, 0.3, 8, 6),
    }
    for name, mesh in made.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        mesh.export(place)
    (folder / "tri angle.obj").write_text("v 0 0 5\nv 1 0 5\nv 0 1 5\nf 1 2 3\n")
    (folder / "empty.obj").write_text("")
    (folder / "cut.glb").write_bytes((folder / "parts/deeper/ring.glb").read_bytes()[:300])
    (folder / "parts/text.stl").write_text("This is no mesh.\n" * 9)
    (folder / ".git").mkdir()
    for name in IGNORED:
        (folder / name).write_text("solid x\nendsolid x\n")
    return folder


def contents(folder):
    """Return a digest of every file below a folder, by name."""
    return {
        file.relative_to(folder).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in folder.rglob("*")
        if file.is_file()
    }


def codes_of(path):
    """Read a 16-bit PNG of RGB as (H, W, 3) uint16, which Pillow cuts to 8 bits."""
    import cv2

    return np.ascontiguousarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[:, :, ::-1])
