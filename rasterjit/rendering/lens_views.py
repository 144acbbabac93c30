"""
Compute the ray of each pixel of a lens, and choose the pinhole pictures that cover all rays.

One picture suffices for a narrow field of view; else the needed parts of the faces of a cube around
the eye. Their samples are at most half as long and wide as a pixel's footprint. All have the
camera's near plane, which is rotated for faces of the cube.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.runtime.threads import Workers
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera
from rasterjit.scene.lens import Equirectangular, Lens
from rasterjit.scene.pixel_projection import clip_from_relative
from rasterjit.scene.transforms import Matrix
from rasterjit.scene.validation import MAX_SIZE
from rasterjit.scene.vectors import dot, length

Float64 = NDArray[np.float64]

SAMPLES = 2.0
"""Samples of a pinhole picture along a pixel, at least."""

NOWHERE = 255
"""Picture number of a pixel without a ray."""

MIN_COSINE = 0.2
"""Of the angle between the axis and what a single picture shows: some 78 degrees."""

MAX_AREA = 12.0
"""Of a single picture, in units of the plane at distance 1: three faces of the cube."""

ROWS_AT_ONCE = 16
"""Rows of pixels whose directions are found by one task."""

SLACK = 2
"""Samples beyond what pixels cover, on each side: bilinear filtering reads one."""

PARALLEL = 1e-9
"""Most that the near plane may be turned from the picture's, as a share, if it is to be turned."""

CUBE = np.array(
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    ],
    np.float64,
)
"""(6, 3, 3): right, down and ahead of the faces that lie ahead, to the right, behind, to the left,
below and above, in the axes of the lens (x right, y down, z ahead)."""


class LensSight(NamedTuple):
    """A camera taken apart: which way it looks, and what takes the lens's places to pixels."""

    rows: Float64
    """(3, 4): pixel column, pixel row and w, each times w, of view-space points."""
    axes: Float64
    """(3, 3): right, down and ahead as unit vectors, view space."""
    depth_scale: float
    """w at distance 1 ahead."""
    focal: tuple[float, float, float]
    """Pixels: across and down, and what a place goes across for each unit down (skew)."""
    middle: tuple[float, float]
    """Pixels: principal point."""

    def same(self, other: LensSight) -> bool:
        """Tell whether another camera differs in nothing but its place and its planes."""
        return np.array_equal(self.rows, other.rows)

    def pixels(self, places: Float64) -> Float64:
        """Return the pixel coordinates, (..., 2), of places of the lens, (..., 2)."""
        x, y = places[..., 0], places[..., 1]
        (fx, fy, skew), (cx, cy) = self.focal, self.middle
        return np.stack(((fx * x + skew * y) + cx, fy * y + cy), axis=-1)

    def places(self, columns: Float64, rows: Float64) -> Float64:
        """Return places of the lens, (R, C, 2), at columns (C,) and rows (R,), pixels."""
        (fx, fy, skew), (cx, cy) = self.focal, self.middle
        y = ((rows - cy) / fy)[:, np.newaxis]
        x = ((columns[np.newaxis] - cx) - skew * y) / fx
        return np.stack((x, np.broadcast_to(y, x.shape)), axis=-1)


@dataclass(frozen=True, eq=False)
class PictureCamera:
    """
    A camera that shows what another one sees on a plane of its own, from the same eye.

    Its view space is that of the other camera.
    """

    camera: Camera
    clip_from_view: Matrix
    pixels: float = 1.0
    """How many of its pixels a pixel in the middle of the lens's picture has, along each side."""

    def view_matrix(self) -> Matrix:
        """Return ``view_from_world`` of the camera."""
        return self.camera.view_matrix()

    def projection_matrix(self, size: tuple[int, int]) -> Matrix:
        """Return ``clip_from_view``, whatever the size."""
        return self.clip_from_view.copy()

    def eye_position(self) -> Float64:
        """Return the eye of the camera, world space."""
        return self.camera.eye_position()

    def depth_coefficients(self) -> tuple[float, float, float]:
        """Return those of the camera."""
        return self.camera.depth_coefficients()

    def view_depth(self, stored: ArrayLike) -> Float64:
        """Return depths along its own axis."""
        return self.camera.view_depth(stored)


class Picture(NamedTuple):
    """The part of a plane at distance 1 before the eye that a pinhole picture shows."""

    number: int
    size: tuple[int, int]
    axes: Float64
    """(3, 3): right, down and ahead, in the axes of the lens."""
    density: float
    """Samples a unit of the plane."""
    origin: tuple[float, float]
    """Where its axis lies, samples."""

    @property
    def is_ahead(self) -> bool:
        """Whether it looks where the camera looks."""
        return bool(self.axes[2, 2] == 1.0)

    def directions(self, columns: NDArray[np.int64], rows: NDArray[np.int64]) -> list[Float64]:
        """Return where the centres of samples look: x, y, z in the axes of the lens, z' = 1."""
        a = (columns + 0.5 - self.origin[0]) / self.density
        b = (rows + 0.5 - self.origin[1]) / self.density
        right, down, ahead = self.axes.tolist()
        return [(a * right[k] + b * down[k]) + ahead[k] for k in range(3)]


class LensViews(NamedTuple):
    """Where the pixels of a picture look."""

    number: NDArray[np.uint8]
    """(H, W): which picture shows it; `NOWHERE` where none does."""
    place: NDArray[np.float32]
    """(H, W, 2): where, on the plane at distance 1."""
    spread: NDArray[np.float32]
    """(H, W, 4): how far a pixel goes there: along its row, then along its column."""
    pictures: tuple[Picture, ...]
    least_cosine: float
    """Of the angle from the axis, of all corners of pixels."""

    @property
    def described(self) -> str:
        """The pictures in words."""
        sizes = ", ".join(f"{one.size[0]} x {one.size[1]}" for one in self.pictures)
        many = f"{len(self.pictures)} pinhole picture{'s' * (len(self.pictures) > 1)}"
        return f"{many} ({sizes}), at least {SAMPLES:g} samples along a pixel"


def see(lens: Lens, camera: Camera, size: tuple[int, int]) -> LensSight:
    """
    Take a camera apart.

    Raises
    ------
    ValueError
        If it has no focal length, as its lines of sight are parallel.
    """
    width, height = size
    clip = camera.projection_matrix(size)
    if not clip[3, :3].any():
        raise ValueError(
            "camera must be a perspective where a lens is given, got "
            f"{type(camera).__name__}, whose lines of sight are parallel"
        )
    if isinstance(lens, Equirectangular) and width != 2 * height:
        raise ValueError(
            f"size must be twice as wide as high where lens is Equirectangular, got {size}"
        )
    rows = np.array(
        [(clip[0] + clip[3]) * (0.5 * width), (clip[3] - clip[1]) * (0.5 * height), clip[3]]
    )
    axes, triangle = _take_apart(rows[:, :3])
    if isinstance(lens, Equirectangular):
        focal = width / (2.0 * math.pi), height / math.pi, 0.0
        return LensSight(rows, axes, triangle[2][2], focal, (0.5 * width, 0.5 * height))
    (fx, skew, cx), (_, fy, cy), (_, _, scale) = triangle
    focal = fx / scale, fy / scale, skew / scale
    return LensSight(rows, axes, scale, focal, (cx / scale, cy / scale))


def world_axes(camera: Camera, size: tuple[int, int]) -> Float64:
    """Return right, down and ahead of a perspective, (3, 3), world space."""
    clip = clip_from_relative(camera, size)[:, :3]
    return _take_apart(np.array([clip[3] + clip[0], clip[3] - clip[1], clip[3]]))[0]


def _take_apart(rows: Float64) -> tuple[Float64, list[list[float]]]:
    """Return axes, (3, 3), and an upper triangle whose product are three rows; diagonal > 0."""
    x, y, w = rows.tolist()
    far = length(w)
    ahead = [c / far for c in w]
    cy = dot(y, ahead)
    y = [a - cy * b for a, b in zip(y, ahead, strict=True)]
    fy = length(y)
    down = [c / fy for c in y]
    cx, skew = dot(x, ahead), dot(x, down)
    x = [(a - cx * b) - skew * c for a, b, c in zip(x, ahead, down, strict=True)]
    fx = length(x)
    right = [c / fx for c in x]
    return np.array([right, down, ahead]), [[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, far]]


def look(lens: Lens, size: tuple[int, int], sight: LensSight, workers: Workers) -> LensViews:
    """
    Find where all pixels look, and the pictures that show it.

    Raises
    ------
    ValueError
        If the lens folds before the border of the picture, shows nothing of it, or takes pictures
        that are too large.
    """
    width, height = size
    number = np.empty((height, width), np.uint8)
    place = np.zeros((height, width, 2), np.float32)
    spread = np.zeros((height, width, 4), np.float32)
    faces = CUBE[:1] if _fits_one(lens, size, sight) else CUBE

    def look_some(first: int) -> tuple[Float64, float, float]:
        last = min(first + ROWS_AT_ONCE, height)
        columns = np.arange(width + 1.0)
        centers = lens.unproject(
            sight.places(columns[:-1] + 0.5, np.arange(first, last, dtype=np.float64) + 0.5)
        )
        corners = lens.unproject(sight.places(columns, np.arange(first, last + 1.0)))
        _refuse_folds(lens, centers)
        some = slice(first, last)
        return _look_some(faces, centers, corners, (number[some], place[some], spread[some]))

    found = workers.run(look_some, [(first,) for first in range(0, height, ROWS_AT_ONCE)])
    extents = np.array([one[0] for one in found])
    least, cosine = min(one[1] for one in found), min(one[2] for one in found)
    if isinstance(lens, Equirectangular):
        # Pixels are as high everywhere; at the poles they are as narrow as they like.
        least = 1.0 / sight.focal[1]
    if not 0.0 < least < math.inf:
        raise ValueError(f"lens must show something of the picture: {lens.visible_range}")
    density = SAMPLES / least
    low, high = extents[:, :, :2].min(axis=0), extents[:, :, 2:].max(axis=0)
    pictures = [
        _picture(n, axes, low[n], high[n], density, _aligned(number, place, n), size)
        for n, axes in enumerate(faces)
        if low[n, 0] <= high[n, 0]
    ]
    return LensViews(number, place, spread, tuple(pictures), cosine)


def _fits_one(lens: Lens, size: tuple[int, int], sight: LensSight) -> bool:
    """Tell whether one picture shows all, by what is seen at the border."""
    (width, height), columns = size, np.arange(size[0] + 1.0)
    rows = np.arange(height + 1.0)
    sides = [
        sight.places(columns, np.array([0.0, height])).reshape(-1, 2),
        sight.places(np.array([0.0, width]), rows).reshape(-1, 2),
    ]
    border = lens.unproject(np.concatenate(sides))
    _refuse_folds(lens, border)
    x, y, z = border.T
    if not (z > MIN_COSINE * np.sqrt(x * x + y * y + z * z)).all():
        return False
    x, y = x / z, y / z
    return bool((x.max() - x.min()) * (y.max() - y.min()) <= MAX_AREA)


def _refuse_folds(lens: Lens, directions: Float64) -> None:
    """Raise ``ValueError`` where nothing is seen as the lens folds before."""
    if np.isnan(directions).any():
        raise ValueError(
            f"lens must show all of the picture up to its corners: {lens.visible_range}"
        )


def _look_some(
    faces: Float64,
    centers: Float64,
    corners: Float64,
    written: tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float32]],
) -> tuple[Float64, float, float]:
    """
    Write where some rows look.

    Returns
    -------
    (F, 4) float64
        Least and greatest place of what is seen on each face, across and down.
    float
        Least length of a pixel, on the plane at distance 1.
    float
        Least cosine of the angle from the axis.
    """
    number, place, spread = written
    x, y, z = (centers[..., k] for k in range(3))
    if len(faces) == 1:
        number[...] = 0
    else:
        number[...] = np.argmax(np.stack((z, x, -z, -x, y, -y)), axis=0)
    number[(x == 0.0) & (y == 0.0) & (z == 0.0)] = NOWHERE
    extents = np.tile([math.inf, math.inf, -math.inf, -math.inf], (len(faces), 1))
    least, cosine = math.inf, 1.0
    for n, axes in enumerate(faces):
        is_here = number == n
        if not is_here.any():
            continue
        at = _project(axes, centers)
        place[is_here] = at[is_here]
        with np.errstate(all="ignore"):
            end = _project(axes, corners)
            a, b, c, d = end[:-1, :-1], end[:-1, 1:], end[1:, :-1], end[1:, 1:]
            along = np.concatenate((0.5 * ((b + d) - (a + c)), 0.5 * ((c + d) - (a + b))), axis=-1)
        # Where the field ends, or a corner lies behind, a pixel is what is seen at its centre.
        covers = along[is_here]
        is_known = np.isfinite(covers).all(axis=-1)
        spread[is_here] = np.where(is_known[:, np.newaxis], covers, 0.0)
        reach = 0.5 * (np.abs(spread[is_here][:, :2]) + np.abs(spread[is_here][:, 2:]))
        points = place[is_here]
        extents[n] = *(points - reach).min(axis=0), *(points + reach).max(axis=0)
        least = min(least, _shortest(covers[is_known]))
    x, y, z = (corners[..., k] for k in range(3))
    length = np.sqrt(x * x + y * y + z * z)
    is_seen = length > 0.0
    if is_seen.any():
        cosine = float((z[is_seen] / length[is_seen]).min())
    return extents, least, cosine


def _project(axes: Float64, directions: Float64) -> Float64:
    """Return where directions, (..., 3), meet the plane of a face, (..., 2); NaN if they do not."""
    x, y, z = (directions[..., k] for k in range(3))
    across, down, deep = ((x * a[0] + y * a[1]) + z * a[2] for a in axes.tolist())
    with np.errstate(all="ignore"):
        deep = np.where(deep > 0.0, deep, np.nan)
        return np.stack((across / deep, down / deep), axis=-1)


def _shortest(covers: Float64) -> float:
    """Return the least width of what pixels cover, (N, 4), in any direction."""
    if len(covers) == 0:
        return math.inf
    xx, xy, yx, yy = covers.T
    squares, area = xx * xx + xy * xy + yx * yx + yy * yy, np.abs(xx * yy - xy * yx)
    # The axes of the ellipse that the pixel's circle becomes.
    longest = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares * squares - 4 * area * area, 0))))
    return float((area / longest).min())


def _aligned(number: NDArray[np.uint8], place: NDArray[np.float32], n: int) -> tuple[float, float]:
    """Return a place that is to be at the centre of a sample: the middle pixel, if seen there."""
    row, column = number.shape[0] // 2, number.shape[1] // 2
    if number[row, column] != n:
        return 0.0, 0.0
    x, y = place[row, column].tolist()
    return x, y


def _picture(
    number: int,
    axes: Float64,
    low: Float64,
    high: Float64,
    density: float,
    aligned: tuple[float, float],
    size: tuple[int, int],
) -> Picture:
    """Return the picture that shows a part of a plane."""
    sides, origin = [], []
    for least, most, at in zip(low.tolist(), high.tolist(), aligned, strict=True):
        first = math.floor(least * density) - SLACK
        # The place is moved to the centre of the sample that it is in.
        shift = 0.5 - (at * density - math.floor(at * density))
        sides.append(math.ceil(most * density) + SLACK - first)
        origin.append(shift - first)
    if max(sides) > MAX_SIZE:
        raise ValueError(
            f"lens takes a pinhole picture of {sides[0]} x {sides[1]} samples for a picture of "
            f"{size[0]} x {size[1]} pixels; each side must be at most {MAX_SIZE}: draw it smaller"
        )
    return Picture(number, (sides[0], sides[1]), axes, density, (origin[0], origin[1]))


def camera_of(
    picture: Picture, camera: Camera, size: tuple[int, int], sight: LensSight
) -> PictureCamera:
    """
    Return the camera of a pinhole picture.

    Raises
    ------
    ValueError
        If the near plane is to be turned, and does not face the line of sight.
    """
    (width, height), (left, top), density = picture.size, picture.origin, picture.density
    right, down, ahead = (picture.axes[k] for k in range(3))
    columns = (2.0 * density / width) * right + (2.0 * left / width - 1.0) * ahead
    rows = (2.0 * density / height) * down + (2.0 * top / height - 1.0) * ahead
    parts = np.array([columns, -rows, ahead]) * sight.depth_scale
    clip, found = camera.projection_matrix(size), np.zeros((4, 4))
    found[[0, 1, 3], :3] = _times(parts, sight.axes)
    if sight.rows[:, 3].any():
        # The eye is not at the origin of view space.
        inverse = transforms.normal_matrix(_square(sight.rows[:, :3])).T
        offset = _times(inverse, sight.rows[:, 3:])
        found[[0, 1, 3], 3] = _times(found[[0, 1, 3], :3], offset)[:, 0]
    if picture.is_ahead:
        found[2:] = clip[2:]
    else:
        found[2] = _turned_depth(clip, found[3])
    across, down, _ = sight.focal
    return PictureCamera(camera, found, density / math.sqrt(abs(across * down)))


def _turned_depth(clip: Matrix, w_row: Float64) -> Float64:
    """Return the row of clip-space z of a camera that looks elsewhere, with the same planes."""
    z, w = clip[2, :3], clip[3, :3]
    share = dot(z.tolist(), w.tolist()) / dot(w.tolist(), w.tolist())
    if np.abs(z - share * w).max() > PARALLEL * np.abs(w).max():
        raise ValueError(
            "camera must have a near plane that faces its line of sight where a lens sees so much "
            "that it takes several pictures"
        )
    row = share * w_row
    row[3] += clip[2, 3] - share * clip[3, 3]
    return row


def _square(rows: Float64) -> Matrix:
    """Return three rows as an affine matrix, (4, 4)."""
    square = transforms.identity()
    square[:3, :3] = rows
    return square


def _times(one: Float64, other: Float64) -> Float64:
    """Return a product of matrices, (N, 3) and (3, M), summed in one order on every CPU."""
    a = one[:, :, np.newaxis]
    return (a[:, 0] * other[0] + a[:, 1] * other[1]) + a[:, 2] * other[2]
