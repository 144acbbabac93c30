"""Helper lines: axes, bounding boxes, grids and camera frusta."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene import transforms
from rasterjit.scene import validation as check
from rasterjit.scene.camera import Camera
from rasterjit.scene.color import ColorLike, linear_color
from rasterjit.scene.lines import AXIS_COLORS, DEFAULT_COLOR, Lines
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node, subtree
from rasterjit.scene.points import Unit
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import VectorLike

GRID_GRAY = 0.3, 0.3, 0.3
"""Colour of grids, linear light."""

Plane: TypeAlias = Literal["xy", "xz", "yz"]
PLANES: tuple[Plane, ...] = get_args(Plane)
"""Planes of a grid."""

MAX_CELLS = 4096
"""Largest number of cells along a side of a grid."""

BOX_CORNERS = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
"""(8, 3): corners of a unit box, around the bottom, then the top."""

BOX_EDGE_STRIPS = [0, 1, 2, 3, 0], [4, 5, 6, 7, 4], [0, 4], [1, 5], [2, 6], [3, 7]
"""Edges of the box, as strips of corners."""


class Axes(Lines):
    """
    Segments from the origin along x, y and z, in red, green and blue.

    Parameters
    ----------
    size : float
        Length of each, scene units.
    width : float
        As `Lines` takes it.
    unit : {"pixel", "world"}
        What the width is in.

    Raises
    ------
    ValueError
        If the size or the width is not above 0.

    Examples
    --------
    >>> import rasterjit as rj
    >>> rj.Axes(0.5)
    Axes(3 segments)
    """

    def __init__(self, size: float = 1.0, *, width: float = 3.0, unit: Unit = "pixel") -> None:
        points = np.vstack([np.zeros(3), check.positive_number("size", size) * np.eye(3)])
        segments = [(0, 1), (0, 2), (0, 3)]
        super().__init__(points, segments, colors=AXIS_COLORS, width=width, unit=unit)


class BoundingBox(Lines):
    """
    The edges of the smallest axis-parallel box around something.

    Parameters
    ----------
    of : Mesh, Node or Scene
        The box of a mesh is in its own axes, model space; that of a node, with all below it, and of
        a scene in those of the world.
    color : colour
    width, unit
        As `Lines` takes them.

    Raises
    ------
    ValueError
        If it is none of these, or has no face with a finite vertex.
    """

    def __init__(
        self,
        of: Mesh | Node | Scene,
        *,
        color: ColorLike = DEFAULT_COLOR,
        width: float = 1.5,
        unit: Unit = "pixel",
    ) -> None:
        if isinstance(of, Node):
            low, high = _subtree_bounds(of)
        elif isinstance(of, (Mesh, Scene)):
            low, high = of.bounds()
        else:
            raise ValueError(f"of must be a Mesh, a Node or a Scene, got {check.brief(of)}")
        super().__init__(
            np.where(BOX_CORNERS, high, low), strips=BOX_EDGE_STRIPS,
            colors=_repeat_color(color, 8), width=width, unit=unit,
        )  # fmt: skip


class Grid(Lines):
    """
    A square of cells, to show where the ground is and how large things are.

    Parameters
    ----------
    size : float
        Its side, scene units.
    cells : int
        Cells along each side, at most 4096.
    plane : {"xy", "xz", "yz"}
        The plane that it lies in.
    center : (3,) array_like
        Its middle.
    color : colour
    width, unit
        As `Lines` takes them.

    Raises
    ------
    ValueError
        If the size or the width is not above 0, there are no cells or too many, or the plane is not
        known.
    """

    def __init__(
        self,
        size: float = 10.0,
        cells: int = 10,
        *,
        plane: Plane = "xz",
        center: VectorLike = (0.0, 0.0, 0.0),
        color: ColorLike = GRID_GRAY,
        width: float = 1.0,
        unit: Unit = "pixel",
    ) -> None:
        side, middle = check.positive_number("size", size), check.vector("center", center)
        count = check.whole_number("cells", cells, 1, MAX_CELLS)
        across, along = ("xyz".index(axis) for axis in check.one_of("plane", plane, PLANES))
        steps = np.linspace(-0.5 * side, 0.5 * side, count + 1)
        points = np.zeros((2, len(steps), 2, 3))
        points[0, :, :, across] = points[1, :, :, along] = steps[:, np.newaxis]
        points[0, :, :, along] = points[1, :, :, across] = steps[[0, -1]]
        points = points.reshape(-1, 3) + middle
        super().__init__(
            points, np.arange(len(points)).reshape(-1, 2), colors=_repeat_color(color, len(points)),
            width=width, unit=unit, caps="butt",
        )  # fmt: skip


class Frustum(Lines):
    """
    The frustum of a camera up to a distance, in world space, with a mark on its upper side.

    Parameters
    ----------
    camera : Camera
    far, near : float
        Distances along the viewing axis where it ends and where it begins, scene units; at 0 a
        perspective camera's begins at its eye.
    size : (int, int)
        Width and height of its picture, pixels, which decide on the shape.
    color : colour
    width, unit
        As `Lines` takes them.

    Raises
    ------
    ValueError
        If it is not a camera, or the distances do not ascend from 0.
    """

    def __init__(
        self,
        camera: Camera,
        far: float = 1.0,
        near: float = 0.0,
        *,
        size: tuple[int, int] = (1280, 720),
        color: ColorLike = DEFAULT_COLOR,
        width: float = 1.5,
        unit: Unit = "pixel",
    ) -> None:
        if not isinstance(camera, Camera):
            raise ValueError(f"camera must be a camera, got {check.brief(camera)}")
        first, last = check.finite_number("near", near), check.finite_number("far", far)
        if not 0.0 <= first < last:
            raise ValueError(f"near must be in 0..far, {far!r}, and below it, got {near!r}")
        clip = np.asarray(camera.projection_matrix(check.image_size("size", size)))
        corners = [
            _unproject_at(clip, x, y, -distance)
            for distance in (first, last)
            for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        right, left = corners[6], corners[7]
        rise = 0.25 * (corners[6] - corners[5])
        corners += [left + 0.3 * (right - left), 0.5 * (left + right) + rise,
                    right - 0.3 * (right - left)]  # fmt: skip
        world_from_view = transforms.inverse(camera.view_matrix())
        points = transforms.transform_points(world_from_view, np.array(corners))[:, :3]
        super().__init__(
            points, strips=[*BOX_EDGE_STRIPS, [8, 9, 10]], colors=_repeat_color(color, len(points)),
            width=width, unit=unit,
        )  # fmt: skip


def _repeat_color(color: ColorLike, count: int) -> NDArray[np.float32]:
    """Return a colour for each of some points, (count, 4)."""
    return np.tile(linear_color("color", color), (count, 1))


def _subtree_bounds(node: Node) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the box around a node and all below it, world space."""
    scene = Scene()
    for one in subtree(node):
        if one.mesh is not None:
            added = scene.add(one.mesh, one.world_from_model)
            added.skin, added.weights = one.skin, one.weights
    if not scene.nodes:
        raise ValueError(f"of must have a mesh, or a node below it must, got {node!r}")
    return scene.bounds()


def _unproject_at(clip: NDArray[np.float64], x: int, y: int, z: float) -> NDArray[np.float64]:
    """Return the view-space point at a depth z that projects to a point of the picture."""
    # (clip[0] - x clip[3]) p = 0 and (clip[1] - y clip[3]) p = 0, of which z is known.
    (a, b, c, d), (e, f, g, h) = clip[0] - x * clip[3], clip[1] - y * clip[3]
    determinant = a * f - b * e
    right, up = -(c * z + d), -(g * z + h)
    return np.array([(right * f - b * up) / determinant, (a * up - right * e) / determinant, z])
