"""
The seven objects of the sheet of default pictures, as mesh files that all programs read.

The bunny and the dragon are scans. They come with Debian's package ``libcgal-demo``, in
``/usr/share/doc/libcgal-dev/data.tar.gz``, as ``meshes/bunny00.off`` and
``meshes/ChineseDragon-10kv.off``.
"""

from __future__ import annotations

import math
import tarfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

ROOT = Path(__file__).resolve().parents[2]

SCANS = {"bunny": "data/meshes/bunny00.off", "dragon": "data/meshes/ChineseDragon-10kv.off"}
"""Where the archive of scans has them."""


def make_objects(folder: Path, archive: Path) -> dict[str, Path]:
    """
    Write the seven objects into a folder; return the files by the names of the objects.

    Parameters
    ----------
    folder : Path
    archive : Path
        ``data.tar.gz`` of libcgal-demo.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = {"teapot": ROOT / "models/teapot.obj"}
    with tarfile.open(archive) as scans:
        for name, member in SCANS.items():
            content = scans.extractfile(member)
            assert content is not None, member
            files[name] = folder / f"{name}.ply"
            mesh = trimesh.load(content, file_type="off")
            mesh.export(files[name])
    made: dict[str, Callable[[], trimesh.Trimesh]] = {
        "textured": vase, "thin": enclosure, "white": knot, "black": knot,
    }  # fmt: skip
    for name, make in made.items():
        mesh = make()
        if name in ("white", "black"):
            tone = {"white": 0.98, "black": 0.02}[name]
            mesh.visual = trimesh.visual.TextureVisuals(
                material=trimesh.visual.material.PBRMaterial(
                    baseColorFactor=[tone] * 3 + [1.0], metallicFactor=0.0, roughnessFactor=0.5
                )
            )
        files[name] = folder / f"{name}.{'ply' if name == 'thin' else 'glb'}"
        normals = {"include_normals": True} if files[name].suffix == ".glb" else {}
        mesh.export(files[name], **normals)
    return files


def enclosure() -> trimesh.Trimesh:
    """Return the lower half of a case with thin walls, ribs, posts and a hole, y up."""
    box = trimesh.creation.box
    parts = [_at(box((120, 2, 80)), (0, 1, 0))]
    parts += [_at(box((120, 30, 1.6)), (0, 15, z)) for z in (-39.2, 39.2)]
    parts += [_at(box((1.6, 30, 80)), (x, 15, 0)) for x in (-59.2, 59.2)]
    parts += [_at(box((0.8, 12, 76.8)), (x, 8, 0)) for x in (-30, 0, 30)]
    parts += [_at(box((116.8, 8, 0.8)), (0, 6, z)) for z in (-14, 14)]
    turn = trimesh.transformations.rotation_matrix(-math.pi / 2, (1, 0, 0))
    for x in (-52, 52):
        for z in (-32, 32):
            post = trimesh.creation.annulus(1.6, 3.6, 26)
            parts.append(_at(post.apply_transform(turn), (x, 14, z)))
    return trimesh.util.concatenate(parts)


def _at(mesh: trimesh.Trimesh, place: tuple[float, float, float]) -> trimesh.Trimesh:
    """Return a mesh that was moved."""
    return mesh.apply_translation(place)


def vase() -> trimesh.Trimesh:
    """Return a glazed vase with a painted texture."""
    from PIL import Image

    heights = np.linspace(0.0, 1.0, 97)
    radii = 0.30 + 0.17 * np.sin(heights * 5.2 - 0.5) - 0.10 * heights
    outer = np.stack([radii, 2.2 * heights], axis=1)
    inner = np.stack([radii[::-1] - 0.02, 2.2 * heights[::-1]], axis=1)[:-1]
    profile = np.concatenate([outer, inner[:70]])
    turns = 97
    angles = np.linspace(0.0, 2.0 * math.pi, turns)
    r, y = profile.T
    vertices = np.stack(
        [r[:, None] * np.cos(angles), np.repeat(y[:, None], turns, 1), r[:, None] * np.sin(angles)],
        axis=2,
    )
    v = np.concatenate([heights, heights[::-1][1:71]])
    uv = np.stack(np.broadcast_arrays(np.linspace(0, 1, turns)[None], v[:, None]), axis=2)
    n = np.arange((len(profile) - 1) * turns).reshape(-1, turns)[:, :-1].reshape(-1)
    faces = np.concatenate(
        [np.stack([n, n + turns, n + 1], 1), np.stack([n + 1, n + turns, n + turns + 1], 1)]
    )
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Image.fromarray(glaze()), metallicFactor=0.0, roughnessFactor=0.35,
        doubleSided=True,
    )  # fmt: skip
    visual = trimesh.visual.TextureVisuals(uv=uv.reshape(-1, 2), material=material)
    return trimesh.Trimesh(vertices.reshape(-1, 3), faces, visual=visual, process=False)


def glaze() -> np.ndarray:
    """Return the painted texture, (512, 1024, 3) uint8: bands and leaves on a cream glaze."""
    y, x = np.mgrid[0:512, 0:1024] / np.array([512.0, 1024.0])[:, None, None]
    image = np.empty((512, 1024, 3))
    image[:] = (236, 226, 204)
    leaf = np.abs(np.sin(x * 16 * math.pi)) * 0.16
    image[np.abs(y - 0.45) < leaf] = (38, 92, 120)
    image[np.abs(y - 0.45) < leaf * 0.35] = (214, 150, 62)
    blue, red = (38, 92, 120), (168, 60, 44)
    bands = [(0.22, 0.02, blue), (0.68, 0.02, blue), (0.26, 0.006, red), (0.64, 0.006, red)]
    for middle, half, color in [*bands, (0.86, 0.05, red), (0.06, 0.03, blue)]:
        image[np.abs(y - middle) < half] = color
    return image.astype(np.uint8)


def knot() -> trimesh.Trimesh:
    """Return a torus knot."""
    mesh = trimesh.load(ROOT / "models/torus_knot.obj", force="mesh")
    # Its seam has vertices twice, for the sake of uv.
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return mesh
