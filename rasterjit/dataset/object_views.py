"""
What views of a scene show of each object: silhouettes, what hides them, boxes and poses.

A silhouette is what an object would show if it were alone. It is drawn on a canvas three times as
wide and high as the picture, as the BOP toolkit does, because objects may reach beyond the picture;
but only in a window around the object, and many views at once.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.io.cameras import from_opencv, to_opencv
from rasterjit.outputs.save import encode_output
from rasterjit.rendering.batch import (
    check_arguments,
    check_cameras,
    check_transforms,
    compose_with_posed,
    render_batch,
)
from rasterjit.rendering.planning import naming
from rasterjit.scene import transforms
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera, MatrixCamera
from rasterjit.scene.node import Node
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.transforms import Matrix
from rasterjit.scene.validation import brief, finite_number, positive_number
from rasterjit.scene.warning import REPEATED, gather_warnings, silence_warnings, warn_caller

Box = tuple[int, int, int, int]
"""Left column, top row, width and height, pixels."""

CANVAS = 3
"""Sides of the canvas of silhouettes, in sides of the picture, which is in its middle."""

MAX_PIXELS = 1 << 22
"""Most pixels that are drawn at once, of all views of a group."""

MIN_WINDOW = 32
"""Least side of a window, pixels; others are this times a power of two."""

BORDER = 2
"""Pixels around the projected box of an object, for rounding."""

MAX_CANVAS_SIDE = 16384
"""Longest side of a picture, and so of the canvas, pixels."""


class ObjectView(NamedTuple):
    """
    An object in a view.

    ``area`` and ``box`` are those of the whole silhouette, beside the picture too, as far as a
    canvas three times as wide and high goes that has the picture in its middle. Boxes of nothing
    are 0, 0, 0, 0.
    """

    id: int
    """What the data set calls the object; several may share an id."""
    camera_from_model: Matrix
    """(4, 4): its pose; OpenCV's camera: x right, y down, z ahead."""
    mask: NDArray[np.bool_] | None
    """(H, W): its silhouette, hidden or not; ``None`` if a file has none."""
    visible: NDArray[np.bool_] | None
    """(H, W): what is seen of it."""
    box: Box
    """Around the silhouette."""
    visible_box: Box
    """Around what is seen."""
    area: int
    """Pixels of the silhouette."""
    measured_area: int
    """Pixels of ``mask`` that have a depth, of the object or of what hides it."""
    visible_area: int
    """Pixels that are seen."""

    @property
    def visible_share(self) -> float:
        """``visible_area / area``, 0 if there is no silhouette."""
        return self.visible_area / self.area if self.area else 0.0


class LabelledView(NamedTuple):
    """A view with its camera and its objects."""

    number: int
    """Of the view in its scene."""
    intrinsics: NDArray[np.float64]
    """(3, 3): OpenCV's K, pixels; the centre of the first pixel is at (0, 0)."""
    camera_from_world: Matrix | None
    """(4, 4): its pose; OpenCV's camera. ``None`` if a file has none."""
    color: NDArray[np.uint8] | None
    """(H, W, 3), sRGB, or (H, W); ``None`` if a file has none."""
    depth: NDArray[np.float32] | None
    """(H, W), scene units along the viewing axis, in steps of ``depth_scale``; inf: nothing."""
    depth_scale: float
    """Scene units a code of depth in 16 bits."""
    objects: tuple[ObjectView, ...]

    def camera(self, size: tuple[int, int]) -> MatrixCamera:
        """Return the camera of a picture of (width, height) pixels; of no pose: at the origin."""
        return from_opencv(self.intrinsics, size, camera_from_world=self.camera_from_world)


Ids = Sequence[int | None] | Mapping[int, int | None]


def render_objects(
    what: Any,
    cameras: Iterable[Camera],
    *,
    size: tuple[int, int],
    ids: Ids | None = None,
    transforms: ArrayLike | None = None,
    delta: float | None = 15.0,
    depth_scale: float = 0.1,
    quality: Quality | None = None,
    background: Background = None,
    threads: int | None = None,
) -> Iterator[LabelledView]:
    """
    Render views with the whole and the visible mask, box, area and pose of each object.

    Views are drawn in groups, as `rasterjit.render_batch` draws them; memory does not grow with
    their number.

    Parameters
    ----------
    what : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene
    cameras : iterable of Camera
        Pinholes, one for each view.
    size : (int, int)
        Width and height of every view, pixels, each in 1..5461.
    ids : sequence or mapping of int, optional
        What the data set calls each object, by its place among the scene's nodes. None, or no entry
        in a mapping, leaves an object out: the floor, say. It still hides others. Default: 1, 2 ...
    transforms : (N, O, 4, 4) array_like, optional
        Where the objects stand in each view, as `rasterjit.render_batch` takes them.
    delta : float, optional, scene units
        How far a surface may lie behind the depth of the picture, along the ray, and still count as
        visible, as in the BOP benchmark: 15 or 5 mm. ``None``: what the picture shows, exactly.
    depth_scale : float, scene units
        Steps in which depth is rounded, as 16-bit files hold it: 65535 of them are the farthest.
    quality, background, threads
        As `rasterjit.render_batch` takes them.

    Yields
    ------
    LabelledView
        With the numbers 0, 1, 2 ...; ``objects`` in the order of the scene's nodes.

    Raises
    ------
    ValueError
        Naming the argument that is wrong, at once; a depth of more than 65535 steps, when its view
        is drawn.

    Warns
    -----
    ViewWarning
        As `rasterjit.render_batch` does, once of each kind.

    Notes
    -----
    With ``delta``, a pixel of the silhouette is visible where the picture has no depth, or where
    the object alone is at most ``delta`` farther from the eye, along the ray through the pixel's
    centre, than what the picture shows.

    References
    ----------
    .. [1] T. Hodan et al., "On Evaluation of 6D Object Pose Estimation", ECCV Workshops 2016.
    .. [2] BOP toolkit, ``scripts/calc_gt_info.py``, ``calc_gt_masks.py`` and ``visibility.py``.
    """
    scene, options = check_arguments(
        what, size, quality, ("color", "depth", "object_id"), background, "none"
    )
    eyes = [*check_cameras(cameras)]
    if max(options.size) * CANVAS > MAX_CANVAS_SIDE:
        raise ValueError(
            f"size must have sides of at most {MAX_CANVAS_SIDE // CANVAS}, got {options.size}"
        )
    names = _check_ids(ids, scene)
    given = check_transforms(transforms, len(eyes), scene)
    if delta is not None and finite_number("delta", delta) < 0.0:
        raise ValueError(f"delta must be at least 0, or None for what is seen, got {delta!r}")
    step = positive_number("depth_scale", depth_scale)
    pinholes = []
    for number, eye in enumerate(eyes):
        with naming(f"cameras[{number}]"):
            pinholes.append(to_opencv(eye, options.size))
    drawer = _Drawer(scene, names, options.size, options.quality, background, delta, step, threads)
    count = _views_at_once(options.size)

    def draw() -> Iterator[LabelledView]:
        for start in range(0, len(eyes), count):
            group = slice(start, start + count)
            places = None if given is None else given[group]
            yield from drawer.draw(start, eyes[group], pinholes[group], places)

    return draw()


def _check_ids(ids: Any, scene: Scene) -> dict[int, int]:
    """Return the ids of objects by their places in the scene, or raise ``ValueError``."""
    count = len(scene.nodes)
    if ids is None:
        ids = range(1, count + 1)
    if isinstance(ids, Mapping):
        entries = dict(ids)
    elif isinstance(ids, Sequence) and not isinstance(ids, (str, bytes)) and len(ids) == count:
        entries = dict(enumerate(ids))
    else:
        raise ValueError(
            f"ids must have a number or None for each of the {count} objects of the scene, or be a "
            f"mapping from their places, got {brief(ids)}"
        )
    for place, name in entries.items():
        is_place = isinstance(place, (int, np.integer)) and 0 <= place < count
        if not is_place or not (name is None or isinstance(name, (int, np.integer))):
            raise ValueError(
                f"ids must map places of objects, 0 to {count - 1}, to whole numbers or None, got "
                f"{place!r}: {name!r}"
            )
        if name is not None and scene.nodes[place].mesh.primitive != "triangles":
            raise ValueError(
                f"ids must name meshes of triangles, got {place}: {scene.nodes[place].mesh!r}"
            )
    return {int(k): int(name) for k, name in sorted(entries.items()) if name is not None}


def _views_at_once(size: tuple[int, int]) -> int:
    """Return how many views of a size are drawn at once."""
    return max(1, MAX_PIXELS // (size[0] * size[1]))


class _Silhouette(NamedTuple):
    """The depth of an object alone, in a window of the canvas."""

    origin: tuple[int, int]
    """Column and row of the window's first pixel, counted from the picture's first."""
    depth: NDArray[np.float32]
    """(H, W), inf where it is not."""


class _Drawer:
    """Draws groups of views of one scene, and what each shows of every object."""

    def __init__(
        self, scene: Scene, names: dict[int, int], size: tuple[int, int], quality: Quality,
        background: Background, delta: float | None, step: float, threads: int | None,
    ) -> None:  # fmt: skip
        self.scene = scene.posed()
        self.names, self.size, self.delta, self.step = names, size, delta, step
        self.quality, self.background, self.threads = quality, background, threads
        self.alone = [self._isolate(place) for place in names]
        self.told: set[str] = set()

    def _isolate(self, place: int) -> Scene:
        """Return the scene with one of its objects alone."""
        alone, node = copy.copy(self.scene), self.scene.nodes[place]
        alone.nodes = [Node(node.mesh, world_from_model=node.world_matrix)]
        return alone

    def draw(
        self, start: int, cameras: list[Camera], pinholes: list[Any],
        given: NDArray[np.float64] | None,
    ) -> Iterator[LabelledView]:  # fmt: skip
        """Yield a group of views, the first of which has the number ``start``."""
        with gather_warnings() as gathered:
            batch = render_batch(
                self.scene, cameras, size=self.size, outputs=("color", "depth", "object_id"),
                quality=self.quality, background=self.background, transforms=given,
                threads=self.threads,
            )  # fmt: skip
        self._warn(gathered, start)
        places = compose_with_posed(given, self.scene)
        if places is None:
            standing = np.stack([node.world_matrix for node in self.scene.nodes])
            places = np.broadcast_to(standing, (len(cameras), *standing.shape))
        silhouettes = [
            self._draw_alone(alone, cameras, places[:, place], given, place)
            for place, alone in zip(self.names, self.alone, strict=True)
        ]
        for k, (pinhole, *parts) in enumerate(zip(pinholes, *silhouettes, strict=True)):
            codes = encode_output("depth", batch.depth[k], self.step).pixels
            depth = codes.astype(np.float32) * np.float32(self.step)
            yield LabelledView(
                start + k, pinhole.intrinsics, pinhole.camera_from_world,
                batch.color[k, ..., :3].copy(),
                np.where(codes == 0, np.float32(np.inf), depth), self.step,
                tuple(
                    self._describe(
                        place, transforms.compose(pinhole.camera_from_world, places[k, place]),
                        part, depth,
                        batch.object_id[k], pinhole.intrinsics,
                    )
                    for place, part in zip(self.names, parts, strict=True)
                ),
            )  # fmt: skip

    def _warn(self, gathered: list[Warning], start: int) -> None:
        """Issue warnings of a group once, with the numbers of its cameras among all."""
        for warning in gathered:
            text, camera, number = str(warning).partition("(cameras[")
            if text not in self.told:
                self.told.add(text)
                if camera:
                    text += f"{camera}{start + int(number.rstrip('])'))}])"
                warn_caller(text, type(warning))

    # Silhouettes.

    def _draw_alone(
        self, alone: Scene, cameras: list[Camera], places: NDArray[np.float64],
        given: NDArray[np.float64] | None, place: int,
    ) -> list[_Silhouette]:  # fmt: skip
        """Return the silhouette of an object in each view, by windows of like sizes together."""
        boxes = _find_canvas_boxes(alone.nodes[0].mesh, cameras, places, self.size)
        needed = np.maximum((boxes[:, 1] - boxes[:, 0]).max(axis=1), 1)
        mantissas, exponents = np.frexp(np.maximum(needed / MIN_WINDOW, 1.0))
        sides = MIN_WINDOW << (exponents - (mantissas == 0.5))
        result: list[_Silhouette] = [_Silhouette((0, 0), np.empty((0, 0), np.float32))] * len(
            cameras
        )
        for side in np.unique(sides).tolist():
            width, height = window = tuple(min(side, CANVAS * one) for one in self.size)
            numbers = np.flatnonzero(sides == side)
            # The window stays on the canvas.
            origins = np.minimum(boxes[numbers, 0], 2 * np.array(self.size) - window).tolist()
            for first in range(0, len(numbers), _views_at_once(window)):
                some = slice(first, first + _views_at_once(window))
                # The whole scene's views have warned of what they do not show.
                with silence_warnings(REPEATED):
                    depth = render_batch(
                        alone,
                        [
                            _crop_camera(cameras[k], self.size, origin, window)
                            for k, origin in zip(numbers[some], origins[some], strict=True)
                        ],
                        size=(width, height), outputs=("depth",),
                        quality=replace(self.quality, samples=1),
                        transforms=None if given is None else given[numbers[some], place, None],
                        threads=self.threads,
                    ).depth  # fmt: skip
                for k, origin, one in zip(numbers[some], origins[some], depth, strict=True):
                    result[k] = _Silhouette(tuple(origin), one)
        return result

    def _describe(
        self, place: int, pose: Matrix, silhouette: _Silhouette, depth: NDArray[np.float32],
        object_id: NDArray[np.int32], intrinsics: NDArray[np.float64],
    ) -> ObjectView:  # fmt: skip
        """Return what a view shows of an object; ``depth`` is 0 where nothing is."""
        is_covered = np.isfinite(silhouette.depth)
        # The part of the window that is in the picture.
        columns, rows = (
            slice(max(first, 0), max(first, 0, min(first + count, side)))
            for first, count, side in zip(
                silhouette.origin, is_covered.shape[::-1], self.size, strict=True
            )
        )
        own_columns, own_rows = (
            slice(part.start - first, part.stop - first)
            for part, first in zip((columns, rows), silhouette.origin, strict=True)
        )
        inside = np.s_[own_rows, own_columns]
        mask, visible = np.zeros(depth.shape, bool), np.zeros(depth.shape, bool)
        if rows.start < rows.stop and columns.start < columns.stop:
            part, seen_depth = is_covered[inside], depth[rows, columns]
            mask[rows, columns] = part
            if self.delta is None:
                is_seen = object_id[rows, columns] == place
            else:
                own = np.where(part, silhouette.depth[inside], np.float32(0.0))
                corner = columns.start, rows.start
                behind = _measure_distances(own, intrinsics, corner)
                behind -= _measure_distances(seen_depth, intrinsics, corner)
                is_seen = (behind <= self.delta) | (seen_depth == 0.0)
            visible[rows, columns] = part & is_seen
        return ObjectView(
            self.names[place], pose, mask, visible, find_box(is_covered, silhouette.origin),
            find_box(visible), int(is_covered.sum()), int((mask & (depth > 0.0)).sum()),
            int(visible.sum()),
        )  # fmt: skip


def find_box(mask: NDArray[np.bool_], origin: tuple[int, int] = (0, 0)) -> Box:
    """Return the box around a mask, (H, W), whose first pixel is at ``origin``."""
    columns, rows = (np.flatnonzero(mask.any(axis=axis)) for axis in (0, 1))
    if not len(columns):
        return 0, 0, 0, 0
    left, top = int(columns[0]), int(rows[0])
    width, height = int(columns[-1]) - left + 1, int(rows[-1]) - top + 1
    return left + origin[0], top + origin[1], width, height


def _measure_distances(
    depth: NDArray[np.float32], intrinsics: NDArray[np.float64], corner: tuple[int, int]
) -> NDArray[np.float32]:
    """Return the distance from the eye to what has a depth, (H, W), from pixel ``corner`` on."""
    height, width = depth.shape
    x = (np.arange(width) + corner[0] - intrinsics[0, 2]) / intrinsics[0, 0]
    y = (np.arange(height) + corner[1] - intrinsics[1, 2]) / intrinsics[1, 1]
    squares = (x * depth) ** 2 + (y[:, None] * depth) ** 2 + depth.astype(np.float64) ** 2
    return np.sqrt(squares).astype(np.float32)


# Windows.


def _find_canvas_boxes(
    mesh: Any, cameras: list[Camera], places: NDArray[np.float64], size: tuple[int, int]
) -> NDArray[np.int64]:
    """
    Return the part of the canvas that holds an object in each view, (N, 2, 2).

    First and end, each a column and a row counted from the picture's first pixel. Of an object that
    is not all in front of the camera it is the whole canvas.
    """
    low, high = mesh.bounds()
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
    points = np.stack(
        [
            transforms.transform_points(
                transforms.compose(camera.projection_matrix(size), camera.view_matrix(), place),
                corners,
            )
            for camera, place in zip(cameras, places, strict=True)
        ]
    )
    w = points[..., 3:]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = (points[..., :2] / w * (1.0, -1.0) + 1.0) * 0.5 * size
    canvas = np.array([[-1.0], [2.0]]) * size
    is_in_front = np.all(w > 0.0, axis=1)
    ends = np.stack([pixels.min(axis=1) - BORDER, pixels.max(axis=1) + BORDER], axis=1)
    ends = np.where(is_in_front[:, None], ends, canvas)
    ends = np.stack([np.floor(ends[:, 0]), np.ceil(ends[:, 1])], axis=1)
    return np.clip(np.nan_to_num(ends), canvas[0], canvas[1]).astype(np.int64)


def _crop_camera(
    camera: Camera, size: tuple[int, int], origin: Sequence[int], window: tuple[int, int]
) -> MatrixCamera:
    """Return the camera of a window of a picture, which begins at the pixel ``origin``."""
    clip = camera.projection_matrix(size)
    (width, height), (column, row) = size, origin
    across, down = width / window[0], height / window[1]
    clip[0] = across * clip[0] + (across - 1.0 - 2.0 * column / window[0]) * clip[3]
    clip[1] = down * clip[1] + (1.0 - down + 2.0 * row / window[1]) * clip[3]
    is_open = getattr(camera, "is_near_open", getattr(camera, "near", 0.0) is None)
    return MatrixCamera(camera.view_matrix(), clip, window, is_open)
