"""
Compute the ray of each pixel of a lens, and choose the pinhole pictures that cover all rays.

One picture suffices for a narrow field of view; else parts of the faces of a cube around the eye
are drawn. Samples are at most half as long and wide as a pixel's footprint. All pictures have the
camera's near plane, rotated for faces of the cube.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.runtime.threads import Workers, split_range
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera
from rasterjit.scene.lens import Equirectangular, Lens
from rasterjit.scene.pixel_projection import clip_from_relative
from rasterjit.scene.transforms import Matrix
from rasterjit.scene.validation import MAX_SIZE
from rasterjit.scene.vectors import dot, length

Float64 = NDArray[np.float64]

MIN_SAMPLES_PER_PIXEL = 2.0
"""Fewest samples of a pinhole picture along each side of a pixel."""

NOWHERE = 255
"""Picture number of a pixel without a ray."""

MIN_COSINE = 0.2
"""Cosine of the largest angle from the axis that a single picture shows: some 78 degrees."""

MAX_AREA = 12.0
"""Largest area of a single picture on the plane at distance 1: that of three faces of the cube."""

ROWS_PER_TASK = 16
"""Rows of pixels whose rays one task computes."""

MARGIN_SAMPLES = 2
"""Samples beyond the pixels on each side: bilinear filtering reads one."""

MAX_PLANE_TILT = 1e-9
"""Largest relative tilt of a near plane that can be rotated for faces of the cube."""

CUBE_FACES = np.array(
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


class LensIntrinsics(NamedTuple):
    """
    A camera's projection, split into its axes and its intrinsics.

    *Lens coordinates* are what an ideal lens of focal length 1 shows, x right and y down; the
    intrinsics take them to pixels.
    """

    rows: Float64
    """(3, 4): pixel column, pixel row and w, each times w, of view-space points."""
    axes: Float64
    """(3, 3): right, down and ahead as unit vectors, view space."""
    depth_scale: float
    """w at distance 1 ahead."""
    focal: tuple[float, float, float]
    """Pixels: across, down, and skew (across for each unit down)."""
    principal_point: tuple[float, float]
    """Pixels."""

    def has_same_projection(self, other: LensIntrinsics) -> bool:
        """Tell whether another camera differs only in position and clip planes."""
        return np.array_equal(self.rows, other.rows)

    def to_pixels(self, points: Float64) -> Float64:
        """Return the pixel coordinates, (..., 2), of lens coordinates, (..., 2)."""
        x, y = points[..., 0], points[..., 1]
        (fx, fy, skew), (cx, cy) = self.focal, self.principal_point
        return np.stack(((fx * x + skew * y) + cx, fy * y + cy), axis=-1)

    def to_lens_coordinates(self, columns: Float64, rows: Float64) -> Float64:
        """Return lens coordinates, (R, C, 2), at columns (C,) and rows (R,), pixels."""
        (fx, fy, skew), (cx, cy) = self.focal, self.principal_point
        y = ((rows - cy) / fy)[:, np.newaxis]
        x = ((columns[np.newaxis] - cx) - skew * y) / fx
        return np.stack((x, np.broadcast_to(y, x.shape)), axis=-1)


@dataclass(frozen=True, eq=False)
class DerivedCamera:
    """A camera with another projection than a given one, from the same eye."""

    camera: Camera

    def view_matrix(self) -> Matrix:
        """Return ``view_from_world`` of the given camera."""
        return self.camera.view_matrix()

    def eye_position(self) -> Float64:
        """Return the eye of the given camera, world space."""
        return self.camera.eye_position()

    def depth_coefficients(self) -> tuple[float, float, float]:
        """Return the coefficients of the given camera."""
        return self.camera.depth_coefficients()

    def view_depth(self, stored: ArrayLike) -> Float64:
        """Return metric depths along this camera's own axis."""
        return self.camera.view_depth(stored)


@dataclass(frozen=True, eq=False)
class PictureCamera(DerivedCamera):
    """A camera that projects on another plane than a given one, in the same view space."""

    clip_from_view: Matrix
    samples_per_pixel: float = 1.0
    """Its pixels along each side of a pixel at the centre of the frame with the lens."""

    def projection_matrix(self, size: tuple[int, int]) -> Matrix:
        """Return ``clip_from_view``, whatever the size."""
        return self.clip_from_view.copy()


class PinholePicture(NamedTuple):
    """The part of a plane at distance 1 from the eye that a pinhole picture shows."""

    number: int
    size: tuple[int, int]
    axes: Float64
    """(3, 3): right, down and ahead, in the axes of the lens."""
    density: float
    """Samples per unit of the plane."""
    origin: tuple[float, float]
    """Position of its axis, samples."""

    @property
    def is_ahead(self) -> bool:
        """Whether the picture looks along the camera's axis."""
        return bool(self.axes[2, 2] == 1.0)

    def directions(self, columns: NDArray[np.int64], rows: NDArray[np.int64]) -> list[Float64]:
        """Return the rays of samples: x, y, z in lens axes, 1 along the picture's axis."""
        a = (columns + 0.5 - self.origin[0]) / self.density
        b = (rows + 0.5 - self.origin[1]) / self.density
        right, down, ahead = self.axes.tolist()
        return [(a * right[k] + b * down[k]) + ahead[k] for k in range(3)]


class LensViews(NamedTuple):
    """Where the rays of pixels meet pinhole pictures."""

    picture_number: NDArray[np.uint8]
    """(H, W): which picture shows the pixel; `NOWHERE` where none does."""
    position: NDArray[np.float32]
    """(H, W, 2): where the ray meets that picture's plane at distance 1."""
    footprint: NDArray[np.float32]
    """(H, W, 4): a pixel's extent on it, the vector along its row, then the one along its
    column."""
    pictures: tuple[PinholePicture, ...]
    min_cosine: float
    """Least cosine of the angle between the axis and a corner of a pixel."""

    @property
    def description(self) -> str:
        """The pictures in words."""
        sizes = ", ".join(f"{picture.size[0]} x {picture.size[1]}" for picture in self.pictures)
        count = f"{len(self.pictures)} pinhole picture{'s' * (len(self.pictures) > 1)}"
        return f"{count} ({sizes}), at least {MIN_SAMPLES_PER_PIXEL:g} samples along a pixel"


def make_lens_intrinsics(lens: Lens, camera: Camera, size: tuple[int, int]) -> LensIntrinsics:
    """
    Split the projection of a perspective camera, for a frame of a size in pixels.

    Raises
    ------
    ValueError
        If the camera is no perspective, or the frame's shape does not suit the lens.
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
    axes, triangle = _split_projection(rows[:, :3])
    if isinstance(lens, Equirectangular):
        focal = width / (2.0 * math.pi), height / math.pi, 0.0
        return LensIntrinsics(rows, axes, triangle[2][2], focal, (0.5 * width, 0.5 * height))
    (fx, skew, cx), (_, fy, cy), (_, _, scale) = triangle
    focal = fx / scale, fy / scale, skew / scale
    return LensIntrinsics(rows, axes, scale, focal, (cx / scale, cy / scale))


def world_axes(camera: Camera, size: tuple[int, int]) -> Float64:
    """Return right, down and ahead of a perspective, (3, 3), world space."""
    clip = clip_from_relative(camera, size)[:, :3]
    return _split_projection(np.array([clip[3] + clip[0], clip[3] - clip[1], clip[3]]))[0]


def _split_projection(rows: Float64) -> tuple[Float64, list[list[float]]]:
    """Split three rows into an upper triangle, diagonal > 0, times orthonormal axes (RQ)."""
    x, y, w = rows.tolist()
    length_of_w = length(w)
    ahead = [c / length_of_w for c in w]
    cy = dot(y, ahead)
    y = [a - cy * b for a, b in zip(y, ahead, strict=True)]
    fy = length(y)
    down = [c / fy for c in y]
    cx, skew = dot(x, ahead), dot(x, down)
    x = [(a - cx * b) - skew * c for a, b, c in zip(x, ahead, down, strict=True)]
    fx = length(x)
    right = [c / fx for c in x]
    return np.array([right, down, ahead]), [[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, length_of_w]]


class _ViewArrays(NamedTuple):
    """The arrays of `LensViews`, or some rows of them."""

    picture_number: NDArray[np.uint8]
    position: NDArray[np.float32]
    footprint: NDArray[np.float32]

    def rows(self, first: int, last: int) -> _ViewArrays:
        """Return views of the rows ``first .. last - 1``."""
        part = slice(first, last)
        return _ViewArrays(self.picture_number[part], self.position[part], self.footprint[part])


def find_lens_views(
    lens: Lens, size: tuple[int, int], intrinsics: LensIntrinsics, workers: Workers
) -> LensViews:
    """
    Find the rays of all pixels, and the pictures that show them.

    Raises
    ------
    ValueError
        If the lens folds before the border of the picture, shows nothing of it, or takes pictures
        that are too large.
    """
    width, height = size
    views = _ViewArrays(
        np.empty((height, width), np.uint8),
        np.zeros((height, width, 2), np.float32),
        np.zeros((height, width, 4), np.float32),
    )
    faces = CUBE_FACES[:1] if _fits_one_picture(lens, size, intrinsics) else CUBE_FACES
    to_lens_coordinates = intrinsics.to_lens_coordinates

    def find_views_of_rows(first: int, last: int) -> tuple[Float64, float, float]:
        columns, rows = np.arange(width + 1.0), np.arange(first, last + 1.0)
        centers = lens.unproject(to_lens_coordinates(columns[:-1] + 0.5, rows[:-1] + 0.5))
        corners = lens.unproject(to_lens_coordinates(columns, rows))
        _check_folds(lens, centers)
        return _find_views_of_rows(faces, centers, corners, views.rows(first, last))

    # Rays.
    found = workers.run(find_views_of_rows, split_range(height, ROWS_PER_TASK))
    face_extents, widths, cosines = zip(*found, strict=True)
    # Density of samples, by the narrowest pixel.
    min_width = min(widths)
    if isinstance(lens, Equirectangular):
        # All pixels are equally high; their width falls to 0 at the poles.
        min_width = 1.0 / intrinsics.focal[1]
    if not 0.0 < min_width < math.inf:
        raise ValueError(f"lens must show something of the picture: {lens.visible_range}")
    density = MIN_SAMPLES_PER_PIXEL / min_width
    # Pictures of the faces that any ray meets.
    extents = np.array(face_extents)
    low, high = extents[:, :, :2].min(axis=0), extents[:, :, 2:].max(axis=0)
    pictures = [
        _make_picture(n, axes, low[n], high[n], density, _find_alignment(views, n), size)
        for n, axes in enumerate(faces)
        if low[n, 0] <= high[n, 0]
    ]
    return LensViews(*views, tuple(pictures), min(cosines))


def _fits_one_picture(lens: Lens, size: tuple[int, int], intrinsics: LensIntrinsics) -> bool:
    """Tell whether one picture covers all rays; those at the border decide."""
    width, height = size
    columns, rows = np.arange(width + 1.0), np.arange(height + 1.0)
    top_and_bottom = intrinsics.to_lens_coordinates(columns, np.array([0.0, height]))
    left_and_right = intrinsics.to_lens_coordinates(np.array([0.0, width]), rows)
    sides = top_and_bottom.reshape(-1, 2), left_and_right.reshape(-1, 2)
    border = lens.unproject(np.concatenate(sides))
    _check_folds(lens, border)
    x, y, z = border.T
    if not (z > MIN_COSINE * np.sqrt(x * x + y * y + z * z)).all():
        return False
    x, y = x / z, y / z
    return bool((x.max() - x.min()) * (y.max() - y.min()) <= MAX_AREA)


def _check_folds(lens: Lens, directions: Float64) -> None:
    """Raise ``ValueError`` if any ray is NaN: beyond the field of view, where the lens folds."""
    if np.isnan(directions).any():
        raise ValueError(
            f"lens must show all of the picture up to its corners: {lens.visible_range}"
        )


def _find_views_of_rows(
    faces: Float64, centers: Float64, corners: Float64, views: _ViewArrays
) -> tuple[Float64, float, float]:
    """
    Write the views of R rows of W pixels.

    Parameters
    ----------
    faces : (F, 3, 3) float64
        `CUBE_FACES`, or the first alone.
    centers, corners : (R, W, 3), (R + 1, W + 1, 3) float64
        Rays of the centres and corners of pixels, lens axes; 0 where there is none.
    views : _ViewArrays
        These rows, written.

    Returns
    -------
    (F, 4) float64
        Least and greatest position on each face, across and down.
    float
        Least width of a pixel, on the plane at distance 1.
    float
        Least cosine of the angle from the axis.
    """
    picture_number, position, footprint = views
    # The face that each ray meets.
    x, y, z = (centers[..., k] for k in range(3))
    if len(faces) == 1:
        picture_number[...] = 0
    else:
        picture_number[...] = np.argmax(np.stack((z, x, -z, -x, y, -y)), axis=0)
    picture_number[(x == 0.0) & (y == 0.0) & (z == 0.0)] = NOWHERE
    # Position and footprint on it.
    extents = np.tile([math.inf, math.inf, -math.inf, -math.inf], (len(faces), 1))
    min_width = math.inf
    for n, axes in enumerate(faces):
        is_here = picture_number == n
        if not is_here.any():
            continue
        points = _project(axes, centers)[is_here]
        footprints = _find_footprints(_project(axes, corners))[is_here]
        # Where the field of view ends, or a corner lies behind, a pixel is only its centre.
        is_known = np.isfinite(footprints).all(axis=-1)
        position[is_here] = points
        footprint[is_here] = np.where(is_known[:, np.newaxis], footprints, 0.0)
        # Extents enclose what is stored, rounded to float32.
        points, rounded = position[is_here], np.abs(footprint[is_here])
        margin = 0.5 * (rounded[:, :2] + rounded[:, 2:])
        extents[n] = *(points - margin).min(axis=0), *(points + margin).max(axis=0)
        min_width = min(min_width, _min_width(footprints[is_known]))
    # The angle from the axis.
    x, y, z = (corners[..., k] for k in range(3))
    length = np.sqrt(x * x + y * y + z * z)
    is_seen = length > 0.0
    cosine = float((z[is_seen] / length[is_seen]).min()) if is_seen.any() else 1.0
    return extents, min_width, cosine


def _find_footprints(corners: Float64) -> Float64:
    """Return the extents of pixels along row and column, (R, W, 4), by their projected corners."""
    a, b, c, d = corners[:-1, :-1], corners[:-1, 1:], corners[1:, :-1], corners[1:, 1:]
    with np.errstate(all="ignore"):
        along_row, along_column = 0.5 * ((b + d) - (a + c)), 0.5 * ((c + d) - (a + b))
    return np.concatenate((along_row, along_column), axis=-1)


def _project(axes: Float64, directions: Float64) -> Float64:
    """Return where rays, (..., 3), meet the plane of a face, (..., 2); NaN if they do not."""
    x, y, z = (directions[..., k] for k in range(3))
    with np.errstate(all="ignore"):
        across, down, ahead = ((x * a[0] + y * a[1]) + z * a[2] for a in axes.tolist())
        ahead = np.where(ahead > 0.0, ahead, np.nan)
        return np.stack((across / ahead, down / ahead), axis=-1)


def _min_width(footprints: Float64) -> float:
    """Return the least width of pixels' footprints, (N, 4), in any direction."""
    if len(footprints) == 0:
        return math.inf
    xx, xy, yx, yy = footprints.T
    squares, area = xx * xx + xy * xy + yx * yx + yy * yy, np.abs(xx * yy - xy * yx)
    # The longer axis of the ellipse that a pixel's circle becomes.
    longest = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares * squares - 4 * area * area, 0))))
    return float((area / longest).min())


def _find_alignment(views: _ViewArrays, n: int) -> tuple[float, float]:
    """Return the position to put at the centre of a sample: the middle pixel's, if on face n."""
    row, column = (side // 2 for side in views.picture_number.shape)
    if views.picture_number[row, column] != n:
        return 0.0, 0.0
    x, y = views.position[row, column].tolist()
    return x, y


def _make_picture(
    number: int,
    axes: Float64,
    low: Float64,
    high: Float64,
    density: float,
    aligned: tuple[float, float],
    size: tuple[int, int],
) -> PinholePicture:
    """Return the pinhole picture that covers a part of a plane."""
    sides, origin = [], []
    for start, end, position in zip(low.tolist(), high.tolist(), aligned, strict=True):
        first = math.floor(start * density) - MARGIN_SAMPLES
        # Move the position to the centre of its sample.
        shift = 0.5 - (position * density - math.floor(position * density))
        sides.append(math.ceil(end * density) + MARGIN_SAMPLES - first)
        origin.append(shift - first)
    if max(sides) > MAX_SIZE:
        raise ValueError(
            f"lens takes a pinhole picture of {sides[0]} x {sides[1]} samples for a picture of "
            f"{size[0]} x {size[1]} pixels; each side must be at most {MAX_SIZE}: draw it smaller"
        )
    return PinholePicture(number, (sides[0], sides[1]), axes, density, (origin[0], origin[1]))


def make_picture_camera(
    picture: PinholePicture, camera: Camera, size: tuple[int, int], intrinsics: LensIntrinsics
) -> PictureCamera:
    """
    Return the camera of a pinhole picture.

    Raises
    ------
    ValueError
        If the near plane must be rotated, and does not face the line of sight.
    """
    (width, height), (left, top), density = picture.size, picture.origin, picture.density
    right, down, ahead = (picture.axes[k] for k in range(3))
    columns = (2.0 * density / width) * right + (2.0 * left / width - 1.0) * ahead
    rows = (2.0 * density / height) * down + (2.0 * top / height - 1.0) * ahead
    parts = np.array([columns, -rows, ahead]) * intrinsics.depth_scale
    clip, clip_from_view = camera.projection_matrix(size), np.zeros((4, 4))
    clip_from_view[[0, 1, 3], :3] = _multiply_in_order(parts, intrinsics.axes)
    if intrinsics.rows[:, 3].any():
        # The eye is not at the origin of view space.
        inverse = transforms.normal_matrix(_as_affine(intrinsics.rows[:, :3])).T
        offset = _multiply_in_order(inverse, intrinsics.rows[:, 3:])
        clip_from_view[[0, 1, 3], 3] = _multiply_in_order(clip_from_view[[0, 1, 3], :3], offset)[
            :, 0
        ]
    if picture.is_ahead:
        clip_from_view[2:] = clip[2:]
    else:
        clip_from_view[2] = _rotate_depth_row(clip, clip_from_view[3])
    across, down, _ = intrinsics.focal
    return PictureCamera(camera, clip_from_view, density / math.sqrt(abs(across * down)))


def _rotate_depth_row(clip: Matrix, w_row: Float64) -> Float64:
    """Return the z row, (4,), of a rotated camera's projection, with the same clip planes."""
    z, w = clip[2, :3], clip[3, :3]
    ratio = dot(z.tolist(), w.tolist()) / dot(w.tolist(), w.tolist())
    if np.abs(z - ratio * w).max() > MAX_PLANE_TILT * np.abs(w).max():
        raise ValueError(
            "camera must have a near plane that faces its line of sight where a lens sees so much "
            "that it takes several pictures"
        )
    row = ratio * w_row
    row[3] += clip[2, 3] - ratio * clip[3, 3]
    return row


def _as_affine(rows: Float64) -> Matrix:
    """Return a linear map, (3, 3), as an affine matrix, (4, 4)."""
    matrix = transforms.identity()
    matrix[:3, :3] = rows
    return matrix


def _multiply_in_order(left: Float64, right: Float64) -> Float64:
    """Multiply matrices, (N, 3) and (3, M), summed in one order on every CPU."""
    a = left[:, :, np.newaxis]
    return (a[:, 0] * right[0] + a[:, 1] * right[1]) + a[:, 2] * right[2]
