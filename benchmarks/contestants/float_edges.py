"""
RasterJIT's own stages without what makes them exact and repeatable, to see what that costs.

Vertices are not snapped, edge functions are floats of the unsnapped positions without a top-left
rule, and triangles are listed in the order in which threads finish, in all tiles of their boxes:
shared edges crack or are drawn twice, and ties fall as they may. Transform, outcodes, culling,
totals, floors, the depth plane and the depth test are those of ``rasterjit``. For scenes that need
no clipping.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import refusal
from benchmarks.contestants.rasterjit_ import NEARER_IS_LESS, Visibility
from benchmarks.scenes import LineScene, Scene, TriangleScene
from rasterjit.kernels import binning, projection, setup, visibility
from rasterjit.kernels.jit import disjoint_stage, stage

NAME = "RasterJIT, float edges"

UNABLE = dict.fromkeys(
    ("lines", "edges", "colors", "lighting", "instances", "views", "culling"),
    "it finds the faces of one mesh only",
)

compiled = numba.njit(nogil=True, error_model="numpy")


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    return None if find_spec("rasterjit") else "the package rasterjit is not installed"


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    return refusal(scene, UNABLE)


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        raise ValueError("lines have no edges to be exact about")
    return FloatTriangles(scene, threads)


@compiled
def project_vertices(clip_positions, depth_coefficients, viewport, first, xy, depth, codes):
    """Divide by w and map to the screen, pixels; return the bits of all outcodes."""
    c0, c1, c2 = depth_coefficients
    seen = 0
    for n in range(clip_positions.shape[0]):
        x, y = clip_positions[n, 0], clip_positions[n, 1]
        z, w = clip_positions[n, 2], clip_positions[n, 3]
        code = projection.outcode(x, y, z, w, viewport)
        seen |= code
        codes[first + n] = code
        if code & (setup.GUARD | setup.INVALID):
            continue
        xy[first + n, 0] = (x / w + 1.0) * (0.5 * viewport.width)
        xy[first + n, 1] = (1.0 - y / w) * (0.5 * viewport.height)
        depth[first + n] = (c0 + c1 * z + c2 * w) / w
    return seen


@stage
def first_centre(coordinate):
    """Return the first pixel whose centre is at or beyond a coordinate."""
    return np.int64(np.ceil(coordinate - np.float32(0.5)))


@stage
def last_centre(coordinate):
    """Return the last pixel whose centre is at or before a coordinate."""
    return np.int64(np.floor(coordinate - np.float32(0.5)))


@stage
def survey_triangle(v0, v1, v2, xy, viewport, culled_turn):
    """Decide whether a triangle can cover a sample; return that and its tile box."""
    x0, y0, x1, y1, x2, y2 = xy[v0, 0], xy[v0, 1], xy[v1, 0], xy[v1, 1], xy[v2, 0], xy[v2, 1]
    left = max(first_centre(min(x0, min(x1, x2))), np.int64(0))
    right = min(last_centre(max(x0, max(x1, x2))), np.int64(viewport.width - 1))
    top = max(first_centre(min(y0, min(y1, y2))), np.int64(0))
    bottom = min(last_centre(max(y0, max(y1, y2))), np.int64(viewport.height - 1))
    area = setup.edge(x0, y0, x1, y1, x2, y2)
    zero = np.float32(0.0)
    outcome = setup.UNSAMPLED if (left > right) | (top > bottom) else setup.SURVIVES
    if ((area > zero) & (culled_turn > 0)) | ((area < zero) & (culled_turn < 0)):
        outcome = setup.CULLED
    if area == zero:
        outcome = setup.DEGENERATE
    bits = setup.TILE_BITS
    return outcome, (left >> bits, top >> bits, right >> bits, bottom >> bits)


@stage
def list_survivor(face, outcome, box, end, survivors, columns, tile_counts):
    """List a face and its box if it survives, and count its tiles; return the end of the list."""
    if outcome != setup.SURVIVES:
        return end
    setup.list_survivor(face, setup.pack_box(box), end, survivors)
    for row in range(box[1], box[3] + 1):
        for column in range(box[0], box[2] + 1):
            tile_counts[np.uintp(row * columns + column)] += 1
    if setup.is_large(box):
        tile_counts[np.uintp(tile_counts.shape[0] - 1)] += 1
    return end + 1


@compiled
def bin_triangles(triangles, boxes, columns, cursors, binned):
    """Write each triangle into the lists of all tiles of its box."""
    for n in range(triangles.shape[0]):
        left, top, right, bottom = setup.box_of(boxes, n)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                binning.list_in_tile(
                    triangles[n], np.uintp(row * columns + column), cursors, binned
                )


@compiled
def set_up_triangles(face_range, faces, objects, codes, xy, viewport, survivors, counts):
    """List the faces of a range that can cover a sample; return the end of the list."""
    columns, tile_counts, totals = counts
    end = face_range[0]
    owner = np.searchsorted(objects.face_starts, face_range[0], side="right") - 1
    for face in range(face_range[0], face_range[1]):
        while face >= objects.face_starts[owner + 1]:
            owner += 1
        a, b, c = setup.corners_of(faces, np.uintp(face))
        if (codes[a] | codes[b] | codes[c]) & setup.INVALID:
            totals[setup.DROPPED] += 1
            continue
        if codes[a] & codes[b] & codes[c] & setup.FRUSTUM:
            totals[setup.OUTSIDE] += 1
            continue
        first = end
        outcome, box = survey_triangle(a, b, c, xy, viewport, objects.culled_turns[owner])
        end = list_survivor(face, outcome, box, end, survivors, columns, tile_counts)
        if end == first:
            totals[outcome] += 1
    return end


@disjoint_stage
def test_row(depths, numbers, values, steps, plane, face):
    """Test one row of samples against the three edges and the depth; without branches."""
    zero = np.float32(0.0)
    for i in range(depths.shape[0]):
        column = np.float32(np.int32(i))
        e0 = values[0] + column * steps[0]
        e1 = values[1] + column * steps[1]
        e2 = values[2] + column * steps[2]
        stored = visibility.held(visibility.depth_from(plane, e0, e1), plane)
        if (e0 >= zero) & (e1 >= zero) & (e2 >= zero) & (stored > depths[i]):
            depths[i] = stored
            numbers[i] = face


@stage
def first_inside(value, slope, first):
    """Return the first column at or after ``first`` with ``value + column * slope >= 0``."""
    if slope <= 0:
        return first
    return max(first, np.int64(np.ceil(-value / slope)))


@stage
def last_inside(value, slope, last):
    """Return the last column at or before ``last`` with ``value + column * slope >= 0``."""
    if slope < 0:
        return min(last, np.int64(np.floor(value / -slope)))
    if slope == 0 and value < 0:
        return np.int64(-1)
    return last


@stage
def worst(value, across, down, columns, rows):
    """Return the least value of an edge over a block of samples."""
    zero = np.float32(0.0)
    last_column, last_row = np.float32(columns - 1), np.float32(rows - 1)
    return value + min(across * last_column, zero) + min(down * last_row, zero)


@stage
def clockwise(corners, xy):
    """Return the vertex numbers clockwise on the screen."""
    a, b, c = corners
    if setup.edge(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]) < 0:
        b, c = c, b
    return a, b, c


@stage
def depth_plane(a, b, c, xy, depth):
    """Return what `visibility.depth_plane` does, from edge functions in pixels."""
    ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
    area = np.float64(setup.edge(ax, ay, bx, by, cx, cy))
    da, db, dc = depth[a], depth[b], depth[c]
    weight_a, weight_b = (da - dc) / area, (db - dc) / area
    step = np.float64(by - cy) * weight_a + np.float64(cy - ay) * weight_b
    return dc, weight_a, weight_b, step, min(da, min(db, dc)), max(da, max(db, dc))


@stage
def lowest_at_corners(plane, a, b, c, box, xy):
    """Return the lowest depth at the corners of a box of samples."""
    half = np.float32(0.5)
    lowest = np.inf
    for row in (box[1], box[3]):
        for column in (box[0], box[2]):
            px, py = np.float32(column) + half, np.float32(row) + half
            depth = visibility.depth_from(
                plane,
                setup.edge(xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1], px, py),
                setup.edge(xy[c, 0], xy[c, 1], xy[a, 0], xy[a, 1], px, py),
            )
            lowest = min(lowest, depth)
    return visibility.held(lowest, plane)


@compiled
def find_floors(triangles, boxes, columns, faces, xy, depth, viewport, floors):
    """Raise the floors of the tiles that large triangles cover."""
    half, size = np.float32(0.5), np.int64(visibility.TILE_SIZE)
    for n in range(triangles.shape[0]):
        left, top = np.int64(boxes[n, 0]), np.int64(boxes[n, 1])
        right, bottom = np.int64(boxes[n, 2]), np.int64(boxes[n, 3])
        if setup.is_large((left, top, right, bottom)):
            a, b, c = clockwise(setup.corners_of(faces, np.int64(triangles[n])), xy)
            plane = depth_plane(a, b, c, xy, depth)
            ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
            for row in range(top, bottom + 1):
                for column in range(left, right + 1):
                    x, y = column << setup.TILE_BITS, row << setup.TILE_BITS
                    width, height = min(size, viewport.width - x), min(size, viewport.height - y)
                    px, py = np.float32(x) + half, np.float32(y) + half
                    e0 = setup.edge(bx, by, cx, cy, px, py)
                    e1 = setup.edge(cx, cy, ax, ay, px, py)
                    e2 = setup.edge(ax, ay, bx, by, px, py)
                    least = min(
                        worst(e0, by - cy, cx - bx, width, height),
                        min(
                            worst(e1, cy - ay, ax - cx, width, height),
                            worst(e2, ay - by, bx - ax, width, height),
                        ),
                    )
                    if least >= np.float32(0.0):
                        box = x, y, x + width - 1, y + height - 1
                        lowest = lowest_at_corners(plane, a, b, c, box, xy)
                        tile = row * columns + column
                        floors[tile] = max(floors[tile], lowest)


@stage
def draw_triangle(corners, face, xy, depth, viewport, origin, floor, tile):
    """Draw one triangle into a tile whose first pixel is ``origin`` (column, row)."""
    depths, numbers = tile
    half = np.float32(0.5)
    a, b, c = clockwise(corners, xy)
    ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
    plane = depth_plane(a, b, c, xy, depth)
    if np.float32(plane[5]) < floor:
        return
    own_left = first_centre(min(ax, min(bx, cx)))
    own_right = last_centre(max(ax, max(bx, cx)))
    size = np.int64(visibility.TILE_SIZE)
    left = max(own_left, origin[0])
    top = max(first_centre(min(ay, min(by, cy))), origin[1])
    right = min(own_right, min(origin[0] + size, np.int64(viewport.width)) - 1)
    bottom = min(
        last_centre(max(ay, max(by, cy))), min(origin[1] + size, np.int64(viewport.height)) - 1
    )
    px, py = np.float32(left) + half, np.float32(top) + half
    e0 = setup.edge(bx, by, cx, cy, px, py)
    e1 = setup.edge(cx, cy, ax, ay, px, py)
    e2 = setup.edge(ax, ay, bx, by, px, py)
    across0, across1, across2 = by - cy, cy - ay, ay - by
    columns, rows = right - left + 1, bottom - top + 1
    least = min(
        worst(e0, across0, cx - bx, columns, rows),
        min(worst(e1, across1, ax - cx, columns, rows), worst(e2, across2, bx - ax, columns, rows)),
    )
    is_small = own_right - own_left < visibility.SMALL_PIXELS
    for row in range(top - origin[1], bottom - origin[1] + 1):
        if is_small:
            begin = left - origin[0]
            end = begin + ((right - left) | 3) + 1
            test_row(
                depths[row, begin:end], numbers[row, begin:end],
                (e0, e1, e2), (across0, across1, across2), plane, face,
            )  # fmt: skip
        else:
            first, last = np.int64(0), columns - 1
            if least < np.float32(0.0):
                first = first_inside(e0, across0, first)
                first = first_inside(e1, across1, first)
                first = first_inside(e2, across2, first)
                last = last_inside(e0, across0, last)
                last = last_inside(e1, across1, last)
                last = last_inside(e2, across2, last)
            if first <= last:
                offset = np.float32(first)
                start = visibility.depth_from(plane, e0 + offset * across0, e1 + offset * across1)
                begin, end = left + first - origin[0], left + last + 1 - origin[0]
                visibility.fill_span(
                    depths[row, begin:end], numbers[row, begin:end],
                    start, np.int32(0), plane, face,
                )  # fmt: skip
        e0 += cx - bx
        e1 += ax - cx
        e2 += bx - ax


@compiled
def draw_tiles(tiles, starts, binned, floors, faces, xy, vertex_depth, viewport, frame, scratch):
    """Draw some of the frame's tiles."""
    depth, face_id = frame
    tile_depth, tile_numbers = scratch
    columns = (np.int64(viewport.width) + visibility.TILE_SIZE - 1) >> setup.TILE_BITS
    for n in range(tiles.shape[0]):
        tile = np.int64(tiles[n])
        origin = ((tile % columns) << setup.TILE_BITS, (tile // columns) << setup.TILE_BITS)
        visibility.clear_tile(tile_depth, tile_numbers)
        for k in range(starts[tile], starts[tile + 1]):
            face = binned[k]
            corners = setup.corners_of(faces, np.int64(face))
            draw_triangle(
                corners, face, xy, vertex_depth, viewport, origin, floors[tile],
                (tile_depth, tile_numbers),
            )  # fmt: skip
        left, top = origin
        width = min(visibility.TILE_SIZE, viewport.width - left)
        for row in range(min(visibility.TILE_SIZE, viewport.height - top)):
            frame_depth = depth[top + row, left : left + width]
            frame_numbers = face_id[top + row, left : left + width]
            for column in range(width):
                frame_depth[column] = tile_depth[row, column]
                frame_numbers[column] = tile_numbers[row, column]


class FloatTriangles(Visibility):
    """Transform, projection, set-up, binning and visibility, in floats and in any order."""

    def __init__(self, scene: TriangleScene, threads: int) -> None:
        super().__init__(scene, threads)
        self._size = scene.size

    def draw(self) -> None:
        """Find a face and its depth at every pixel."""
        stages, workers, viewport = self._stages, self._workers, self._viewport
        clip_positions = stages.transform(
            self._positions, self._vertex_starts, self._relative_from_model,
            self._clip_from_relative, workers,
        )  # fmt: skip
        screen = self._project(clip_positions)
        starts, binned, floors = self._set_up_and_bin(screen)
        # What was drawn lives until the next is done, as it does in the stages it is compared with:
        # memory that is given back has to be fetched from the system again, page by page.
        frame = np.empty(self._size[::-1], np.float32), np.empty(self._size[::-1], np.int32)
        xy, depth, _ = screen
        tiles = np.arange(len(starts) - 1, dtype=np.int32)
        per_task = stages.TILES_PER_TASK if workers.threads > 1 else len(tiles)

        def draw_some(some: NDArray[np.int32]) -> None:
            shape = visibility.SCRATCH_SHAPE
            scratch = np.empty(shape, np.float32), np.empty(shape, np.int32)
            draw_tiles(
                some, starts, binned, floors, self._faces, xy, depth, viewport, frame, scratch
            )

        workers.run(draw_some, [(tiles[n : n + per_task],) for n in range(0, len(tiles), per_task)])
        self._drawn = *frame, screen

    def _project(self, clip_positions: NDArray[np.float64]) -> tuple[NDArray[Any], ...]:
        count, step = len(clip_positions), self._stages.VERTICES_PER_TASK
        packed = np.empty((count, 2), np.float64)
        xy, depth = packed.view(np.float32)[:, :2], packed[:, 1]
        codes = np.zeros(count, np.uint8)
        calls = [
            (clip_positions[first : first + step], NEARER_IS_LESS, self._viewport, first, xy,
             depth, codes)
            for first in range(0, count, step)
        ]  # fmt: skip
        for bits in self._workers.run(project_vertices, calls):
            if bits & setup.CLIPPED:
                raise ValueError("the scene must need no clipping")
        return xy, depth, codes

    def _set_up_and_bin(
        self, screen: tuple[NDArray[Any], ...]
    ) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]:
        xy, depth, codes = screen
        faces, viewport = self._faces, self._viewport
        size = visibility.TILE_SIZE
        columns = -(-viewport.width // size)
        tiles = columns * -(-viewport.height // size)
        triangles = np.empty(len(faces), np.int32)
        boxes = np.empty((len(faces), 4), np.uint8)
        finished: list[tuple[int, int, NDArray[np.int32]]] = []

        def set_up(first: int) -> None:
            last = min(first + self._stages.FACES_PER_TASK, len(faces))
            counts = np.zeros(tiles + 1, np.int32)
            end = set_up_triangles(
                (first, last), faces, self._objects, codes, xy, viewport, (triangles, boxes),
                (columns, counts, np.zeros(5, np.int64)),
            )  # fmt: skip
            finished.append((first, end, counts))

        firsts = range(0, len(faces), self._stages.FACES_PER_TASK)
        self._workers.run(set_up, [(first,) for first in firsts])
        tile_counts = np.array([counts[:-1] for _, _, counts in finished])
        starts = np.concatenate(([0], np.cumsum(tile_counts.sum(axis=0, dtype=np.int64))))
        cursors = starts[:-1] + np.cumsum(tile_counts, axis=0, dtype=np.int64) - tile_counts
        binned = np.empty(starts[-1], np.int32)
        self._workers.run(
            bin_triangles,
            [
                (triangles[first:end], boxes[first:end], columns, cursors[n], binned)
                for n, (first, end, _) in enumerate(finished)
            ],
        )
        floors = np.full((len(finished), tiles), -np.inf, np.float32)
        self._workers.run(
            find_floors,
            [
                (triangles[first:end], boxes[first:end], columns, faces, xy, depth, viewport,
                 floors[n])
                for n, (first, end, counts) in enumerate(finished)
                if counts[-1]
            ],
        )  # fmt: skip
        return starts, binned, floors.max(axis=0)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the face at every pixel; it is a NumPy array already."""
        return {"face_id": self._drawn[1]}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        face_id = self._drawn[1]
        return {"covered": face_id >= 0, "face_id": face_id}
