"""Decide whether pixels show several faces laid over each other or mixed, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit import transforms
from rasterjit.scene.mesh import Mesh

BOX_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], bool)

BOX_MARGIN = 2.0**-20
"""What a box must lie beyond a plane of the view volume by, of its own clip coordinates: far more
than rounding and snapping move a vertex by."""


class Layers(NamedTuple):
    """What a pixel shows besides its nearest face."""

    is_blended: NDArray[np.uint8]
    """(O,): 1 for each object that what lies behind it is seen through."""
    has_blended: bool
    samples: int | str
    """Samples of each pixel, or ``"area"``."""


class Transparency(NamedTuple):
    """Which objects are seen through."""

    is_blended: NDArray[np.uint8]
    """(O,): 1 for each that is, and that can reach the picture."""
    used: bool
    reason: str


def is_see_through(mesh: Mesh) -> bool:
    """Tell whether anything is seen through a mesh: blended, with an alpha below 1 somewhere."""
    material = mesh.material
    texture = material.base_color_texture
    return material.alpha_mode == "blend" and not (
        material.base_color[3] >= 1.0
        and (mesh.vertex_colors is None or bool((mesh.vertex_colors[:, 3] >= 1.0).all()))
        and (mesh.face_colors is None or bool((mesh.face_colors[:, 3] >= 1.0).all()))
        and (texture is None or texture.is_opaque)
    )


def is_outside(
    mesh: Mesh, relative_from_model: NDArray[np.float64], clip_from_relative: NDArray[np.float64]
) -> bool:
    """Tell whether all of a mesh surely lies outside the view volume."""
    try:
        low, high = mesh.bounds()
    except ValueError:
        # No face has a finite vertex.
        return True
    matrix = transforms.compose(clip_from_relative, relative_from_model)
    x, y, z = np.where(BOX_CORNERS, high, low).T
    clip = [a * x + b * y + c * z + d for a, b, c, d in matrix.tolist()]
    margin = BOX_MARGIN * (abs(clip[0]) + abs(clip[1]) + abs(clip[2]) + abs(clip[3]))
    return any(
        bool((sign * axis > clip[3] + margin).all()) for axis in clip[:3] for sign in (1.0, -1.0)
    )


def find_transparency(
    count: int,
    shades: bool,
    is_any_blended: bool,
    see_through: Sequence[int],
    outside: Sequence[int],
    names: Sequence[str],
) -> Transparency:
    """
    Decide which objects are laid over what lies behind them.

    Parameters
    ----------
    count : int
        Number of objects.
    shades : bool
        Whether the colour of faces is asked for.
    is_any_blended : bool
        Whether any material is.
    see_through : sequence of int
        The objects that anything is seen through, wherever they are.
    outside : sequence of int
        Those of them that lie outside the view.
    names : sequence of str
        Of those outside.
    """
    is_blended = np.zeros(count, np.uint8)
    if not is_any_blended:
        return Transparency(is_blended, False, "no material is blended")
    if not shades:
        return Transparency(is_blended, False, "nothing is shaded")
    if not see_through:
        return Transparency(is_blended, False, "every blended surface has alpha 1")
    is_blended[list(see_through)] = 1
    is_blended[list(outside)] = 0
    seen = len(see_through) - len(outside)
    if seen == 0:
        others = f" and {len(outside) - 1} others lie" if len(outside) > 1 else " lies"
        return Transparency(is_blended, False, f"object {names[0]!r}{others} outside the view")
    objects = "1 blended object" if seen == 1 else f"{seen} blended objects"
    if outside:
        objects += f", {len(outside)} more outside the view"
    return Transparency(is_blended, True, objects)


def antialiasing_reason(samples: int | str, shades: bool) -> str:
    """Say why edges are smoothed or not."""
    if samples == 1:
        return "quality.samples is 1"
    if not shades:
        return "nothing is shaded"
    if samples == "area":
        return "exact areas, shaded once per face and pixel"
    return f"{samples} samples a pixel, shaded once per face and pixel"
