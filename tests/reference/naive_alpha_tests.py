"""
The slow, obvious twin of alpha masks: draw every face alone without holes, then drop samples.

Alpha is exact: coordinates and weights are ``fractions.Fraction``.
"""

from __future__ import annotations

import math
from fractions import Fraction

import naive_textures as naive
import numpy as np

from rasterjit.inspect import oracle
from rasterjit.io.meshes import as_scene
from rasterjit.rendering.planning import FrameRequest, plan_frame
from rasterjit.rendering.renderer import draw_frame
from rasterjit.runtime.threads import Workers
from rasterjit.scene.quality import check_quality


def visibility(what, camera, size, threads=1, **options):
    """Return the stored depth (-inf where nothing is) and the face at every pixel."""
    quality, outputs = check_quality(options.pop("quality", None)), ("depth", "face_id")
    planned = plan_frame(FrameRequest(size, quality, outputs, **options), as_scene(what), camera)
    workers = Workers(threads)
    _, seen = draw_frame(planned, workers)
    workers.close()
    depth, face_id = seen.coverage.depth, seen.coverage.face_id
    return np.where(face_id >= 0, depth, -np.inf).astype(np.float32), face_id.copy()


def alpha_levels(texture, cutoff):
    """Return the exact alpha of a mask; of its mip levels, the shares of texels that are there."""
    image = naive.exact_image(texture.image[..., 3])
    if texture.filter != "trilinear":
        return [image]
    return [image, *naive.mip_chain(naive.exact_image(texture.image[..., 3] >= cutoff))[1:]]


def cutoff_of_cell(column, row):
    """Return the cutoff of a cell of the lattice: 2 x 2 texels, or cells, have all quarters."""
    quarters = {(0, 0): 0, (1, 1): 1, (1, 0): 2, (0, 1): 3}
    strata = []
    for n in (1, 2, 3):
        block = hashed(column >> n + 1, row >> n + 1, n) // 256
        strata.append(quarters[column >> n & 1, row >> n & 1] ^ block % 4)
    strata[0] ^= quarters[column & 1, row & 1]
    rest = Fraction(hashed(column, row, 0) // 2**15, 2**16)
    share = (16 * strata[0] + 4 * strata[1] + strata[2] + rest) / 64
    return Fraction(1, 256) + Fraction(254, 256) * share


def hashed(column, row, salt):
    """Return 31 bits that look random."""
    mixed = (column * 0x2545F491 + row * 0x1B873593 + salt * 0x3C6EF372) % 2**31
    mixed = (mixed ^ mixed >> 15) * 0x2C1B3C6D % 2**31
    mixed = (mixed ^ mixed >> 12) * 0x297A2D39 % 2**31
    return mixed ^ mixed >> 15


def cutoff_at(texture, uv, detail, cutoff):
    """Return the cutoff at a place of a mask: from level 0 to 1 it goes over to that of a cell."""
    detail = min(max(detail, 0.0), len(texture.levels) - 1.0)
    height, width = texture.levels[math.floor(detail)].shape[:2]
    cell = cutoff_of_cell(math.floor(2 * uv[0] * width), math.floor(2 * uv[1] * height))
    return cutoff + Fraction(min(detail, 1.0)) ** 2 * (cell - cutoff)


def texture_alpha(texture, levels, uv, footprint, cutoff):
    """Return what the alpha of a mask is at exact coordinates, and what it is compared with."""
    cutoff = Fraction(float(np.float32(cutoff)))
    if texture.filter == "nearest":
        return naive.nearest(levels[0], *uv, texture.wrap), cutoff
    if texture.filter == "bilinear":
        return naive.bilinear(levels[0], *uv, texture.wrap), cutoff
    detail = naive.level_of_detail(*footprint)
    alpha = naive.trilinear(levels, *uv, texture.wrap, detail)
    return alpha, cutoff_at(texture, uv, detail, cutoff)


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
    closest, levels = np.inf, alpha_levels(texture, cutoff)
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
            alpha, bound = texture_alpha(texture, levels, place, footprint, cutoff)
            closest = min(closest, abs(float(alpha - bound)))
            if alpha >= bound:
                depth[row, column] = alone[row, column]
                shown[row, column] = n
    return depth, shown, closest
