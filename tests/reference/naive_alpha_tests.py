"""
The slow, obvious twin of alpha masks: draw every face alone without holes, then drop samples.

Alpha is exact: coordinates and weights are ``fractions.Fraction``.
"""

from __future__ import annotations

from fractions import Fraction

import naive_textures as naive
import numpy as np

from rasterjit.inspect import oracle
from rasterjit.io.meshes import as_scene
from rasterjit.rendering.renderer import draw_frame
from rasterjit.rendering.views import plan_views
from rasterjit.runtime.threads import Workers
from rasterjit.scene.quality import check_quality


def visibility(what, camera, size, threads=1, **options):
    """Return the stored depth (-inf where nothing is) and the face at every pixel."""
    arguments = {"background": None, "cull": "none", **options}
    planned = plan_views(
        size, check_quality(arguments.pop("quality", None)), as_scene(what), camera,
        ("depth", "face_id"), diagnose=False, previous=None, **arguments,
    )  # fmt: skip
    workers = Workers(threads)
    _, seen = draw_frame(planned, workers)
    workers.close()
    depth, face_id = seen.coverage.depth, seen.coverage.face_id
    return np.where(face_id >= 0, depth, -np.inf).astype(np.float32), face_id.copy()


def alpha_levels(texture):
    """Return the exact alpha of a texture, and of its mip levels where they are read."""
    image = naive.exact_image(texture.image[..., 3])
    return naive.mip_chain(image) if texture.filter == "trilinear" else [image]


def texture_alpha(texture, levels, uv, footprint):
    """Return what the alpha of a texture is at exact coordinates."""
    if texture.filter == "nearest":
        return naive.nearest(levels[0], *uv, texture.wrap)
    if texture.filter == "bilinear":
        return naive.bilinear(levels[0], *uv, texture.wrap)
    return naive.trilinear(levels, *uv, texture.wrap, naive.level_of_detail(*footprint))


def cut(faces, camera, size, points, ws, texture, uvs, cutoff):
    """
    Return stored depth and face at every pixel of triangles with holes.

    Parameters
    ----------
    faces : list of Mesh
        One opaque triangle each.
    camera : Camera
    size : (int, int)
    points : (N, 3, 2)
        Where their vertices lie on the screen, pixels.
    ws : (N, 3)
    texture : Texture
        Its alpha decides.
    uvs : (N, 3, 2)
    cutoff : float
    """
    depth = np.full(size[::-1], -np.inf, np.float32)
    shown = np.full(size[::-1], -1, np.int32)
    closest, levels = np.inf, alpha_levels(texture)
    for n, mesh in enumerate(faces):
        alone, covered = visibility(mesh, camera, size)
        corners = [tuple(Fraction(c, 256) for c in p) for p in oracle.snap_triangle(points[n])]
        exact_ws = [Fraction(w) for w in ws[n]]
        exact_uv = [tuple(map(Fraction, place)) for place in uvs[n]]
        planes = naive.planes_of(corners, exact_ws, exact_uv)
        for row, column in np.argwhere(covered >= 0).tolist():
            if alone[row, column] <= depth[row, column]:
                continue
            point = (column + naive.HALF, row + naive.HALF)
            place = naive.coordinates_at(point, planes)
            footprint = point, planes, texture.size
            alpha = texture_alpha(texture, levels, place, footprint)
            closest = min(closest, abs(float(alpha) - cutoff))
            if alpha >= Fraction(float(np.float32(cutoff))):
                depth[row, column] = alone[row, column]
                shown[row, column] = n
    return depth, shown, closest
