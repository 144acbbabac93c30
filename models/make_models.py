"""
Make every file of this folder from formulas and one public table.

    python models/make_models.py [FOLDER]

rewrites them byte for byte the same: coordinates are computed with operations whose rounding IEEE
754 fixes (and `math.sin`, `math.cos`, far more exact than the digits written), and nothing is
compressed. The teapot is in `teapot.py` (its table in `teapot_patches.py`), the glTF scene in
`gltf_scene.py` (its container in `glb.py`), what is animated in `tentacle.py`, `figure.py` and
`face.py`. All models are right-handed, y up, and their
faces counter-clockwise from outside.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from face import make_face
from figure import make_figure
from gltf_scene import make_scene
from surfaces import CUBE_CORNERS, CUBE_SIDES, QUAD, grid_faces, unit, write_obj
from teapot import make_teapot
from tentacle import make_tentacle


def make_cube(folder: Path) -> None:
    """Write a cube of side 2 whose corner colours are the corners of the RGB cube."""
    faces = CUBE_SIDES[:, QUAD].reshape(-1, 3)
    colors = (CUBE_CORNERS + 1) // 2 * 255
    lines = ["ply", "format ascii 1.0", "comment made by models/make_models.py"]
    lines += [f"element vertex {len(CUBE_CORNERS)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"property uchar {channel}" for channel in ("red", "green", "blue")]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, row)) for row in np.hstack([CUBE_CORNERS, colors]).tolist()]
    lines += [" ".join(map(str, [3, *face])) for face in faces.tolist()]
    (folder / "cube.ply").write_bytes(("\n".join(lines) + "\n").encode("ascii"))


def make_pyramid(folder: Path) -> None:
    """
    Write the four-vertex pyramid of the classic indexed-draw example.

    The tutorial's indices are 0 3 1, 1 3 2, 2 3 0, 0 1 2: clockwise from outside, because its
    space is left-handed. Two corners of each face change places here.

    References
    ----------
    E. Meiri, "OGLdev: Modern OpenGL Tutorials", tutorial 10, "Indexed Draws".
    """
    vertices = [(-1, -1, 0), (0, -1, 1), (1, -1, 0), (0, 1, 0)]
    faces = [(0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)]
    lines = ["OFF", "# made by models/make_models.py", "4 4 6"]
    lines += [" ".join(map(str, vertex)) for vertex in vertices]
    lines += [" ".join(map(str, (3, *face))) for face in faces]
    (folder / "pyramid.off").write_bytes(("\n".join(lines) + "\n").encode("ascii"))


KNOT_SEGMENTS, KNOT_SIDES = 256, 24
KNOT_WINDS, KNOT_WAVES = 2, 3
KNOT_MAJOR_RADIUS, KNOT_MINOR_RADIUS, KNOT_TUBE_RADIUS = 2.0, 1.0, 0.45


def make_torus_knot(folder: Path) -> None:
    """
    Write a tube around the (2,3) torus knot, u along it and v around it.

    The centre line C(t) lies on a torus around the z axis, whose unit normal N is perpendicular to
    the tangent T: with B = N × T the frame (N, B) closes after one turn, so no twist needs
    correcting. The tube's point C + r n, n = N cos a + B sin a, has exactly the normal n.
    """
    rows = [_knot_ring(2.0 * math.pi * i / KNOT_SEGMENTS) for i in range(KNOT_SEGMENTS)]
    rings = np.array([*rows, rows[0]])
    positions, normals = rings[..., :3], rings[..., 3:]
    u, v = np.meshgrid(
        np.arange(KNOT_SEGMENTS + 1) / KNOT_SEGMENTS,
        np.arange(KNOT_SIDES + 1) / KNOT_SIDES,
        indexing="ij",
    )
    write_obj(
        folder / "torus_knot.obj",
        "torus knot (2,3)",
        positions.reshape(-1, 3),
        normals.reshape(-1, 3),
        np.stack([u, v], axis=-1).reshape(-1, 2),
        grid_faces(KNOT_SEGMENTS + 1, KNOT_SIDES + 1),
    )


def _knot_ring(t: float) -> list[list[float]]:
    """Return the tube's ring at parameter t (radians): KNOT_SIDES+1 rows of x y z nx ny nz."""
    around, wave = KNOT_WINDS * t, KNOT_WAVES * t
    outward = np.array([math.cos(around), math.sin(around), 0.0])
    onward = np.array([-math.sin(around), math.cos(around), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    radius = KNOT_MAJOR_RADIUS + KNOT_MINOR_RADIUS * math.cos(wave)
    center = outward * radius + up * (KNOT_MINOR_RADIUS * math.sin(wave))
    torus_normal = outward * math.cos(wave) + up * math.sin(wave)
    torus_tangent = up * math.cos(wave) - outward * math.sin(wave)
    speed = onward * (radius * KNOT_WINDS) + torus_tangent * (KNOT_MINOR_RADIUS * KNOT_WAVES)
    binormal = np.cross(torus_normal, unit(speed))
    ring = []
    for j in range(KNOT_SIDES):
        angle = 2.0 * math.pi * j / KNOT_SIDES
        normal = torus_normal * math.cos(angle) + binormal * math.sin(angle)
        ring.append([*(center + KNOT_TUBE_RADIUS * normal).tolist(), *normal.tolist()])
    return [*ring, ring[0]]


MAKERS: tuple[Callable[[Path], None], ...] = (
    make_teapot,
    make_cube,
    make_pyramid,
    make_torus_knot,
    make_scene,
    make_tentacle,
    make_figure,
    make_face,
)


def main(arguments: Sequence[str]) -> None:
    """Write every model into the folder named, or into this script's."""
    folder = Path(arguments[0]) if arguments else Path(__file__).parent
    for make in MAKERS:
        make(folder)


if __name__ == "__main__":
    main(sys.argv[1:])
