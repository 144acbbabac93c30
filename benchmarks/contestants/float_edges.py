"""
RasterJIT itself without what makes it exact, to see what that costs.

The same stages, batches, loops and vectors, but for a few functions that stand here in place of
their namesakes: edge functions, spans and depths are float32, no tie goes to top and left, and
vertices keep the order that they are given in. So shared edges crack or are drawn twice, and the
spelling of a face shows. Transform, snapping, tile lists and tile depths are RasterJIT's own.
"""

from __future__ import annotations

import functools
import inspect
from importlib.util import find_spec
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import refusal
from benchmarks.contestants.rasterjit_ import Visibility
from benchmarks.scenes import LineScene, Scene, TriangleScene
from rasterjit.pipeline.geometry import setup
from rasterjit.pipeline.geometry import triangle_batches as batches
from rasterjit.pipeline.geometry.triangle_batches import flat_index
from rasterjit.pipeline.visibility import tile_rasterizer, visibility_pass
from rasterjit.runtime.intrinsics import draw_box
from rasterjit.runtime.jit import Helper, disjoint_helper, helper
from rasterjit.runtime.state_block import float32, float64

NAME = "RasterJIT, float edges"

UNABLE = dict.fromkeys(
    ("lines", "edges", "colors", "lighting", "instances", "views", "culling"),
    "it finds the faces of one mesh only",
)

FAR_AWAY = np.float32(1e20)
"""An edge along the row crosses it so many columns away for each unit of its value."""


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
    """Return the scene ready to draw, its kernels compiled by a first picture."""
    if isinstance(scene, LineScene):
        raise ValueError("lines have no edges to be exact about")
    ready = FloatTriangles(scene, threads)
    ready.draw()
    return ready


# --- set-up -----------------------------------------------------------------------------------


@helper
def edge(ax, ay, bx, by, px, py):
    """Return the edge function of a -> b at p, rounded."""
    along_x, along_y = np.float32(np.int32(bx - ax)), np.float32(np.int32(by - ay))
    away_x, away_y = np.float32(np.int32(px - ax)), np.float32(np.int32(py - ay))
    return along_x * away_y - along_y * away_x


@helper
def edge_bias(ax, ay, bx, by):
    """Return 0: a tie belongs to both sides."""
    return np.int64(0)


# --- batches ----------------------------------------------------------------------------------


@helper
def is_above(ax, ay, bx, by):
    """Return ``False``: the order of vertices stays, but for the turn."""
    return False


@disjoint_helper
def bound_triangles(ax, ay, bx, by, cx, cy, window, bits, left, top, right, bottom, wide):
    """Write the box of samples of each triangle inside a window; any vertex may be topmost."""
    blocks = batches.COLUMN_BLOCK_BITS
    for n in range(ax.shape[0]):
        first = setup.find_first_pixel(min(ax[n], min(bx[n], cx[n])), bits)
        last = setup.find_last_pixel(max(ax[n], max(bx[n], cx[n])), bits)
        is_wide = last - first >= batches.MAX_SMALL_PIXELS
        wide[n] = is_wide
        left[n] = max(first, (window[0] >> blocks) << blocks if is_wide else window[0])
        top[n] = max(setup.find_first_pixel(min(ay[n], min(by[n], cy[n])), bits), window[1])
        right[n] = min(last, window[2])
        bottom[n] = min(setup.find_last_pixel(max(ay[n], max(by[n], cy[n])), bits), window[3])


@disjoint_helper
def set_up_depth_planes(ax, ay, bx, by, cx, cy, da, db, dc, weight_a, weight_b, lowest, highest):
    """Write the weights of E_bc and E_ca in the depth, and its range."""
    for n in range(ax.shape[0]):
        area = edge(ax[n], ay[n], bx[n], by[n], cx[n], cy[n])
        weight_a[n], weight_b[n] = (da[n] - dc[n]) / area, (db[n] - dc[n]) / area
        lowest[n] = min(da[n], min(db[n], dc[n]))
        highest[n] = max(da[n], max(db[n], dc[n]))


@disjoint_helper
def set_up_edge(ax, ay, bx, by, left, top, bits, value, across, down, side):
    """Write the edge a -> b at the corner of the box, and its steps."""
    unit, half = np.float32(np.int64(1) << bits), np.int64(1) << (bits - 1)
    for n in range(ax.shape[0]):
        px = np.int32((left[n] << bits) + half)
        py = np.int32((top[n] << bits) + half)
        value[n] = edge(ax[n], ay[n], bx[n], by[n], px, py)
        across[n] = np.float32(np.int32(ay[n] - by[n])) * unit
        down[n] = np.float32(np.int32(bx[n] - ax[n])) * unit


# --- visibility -------------------------------------------------------------------------------


@helper
def edge_at(ax, ay, bx, by, column, row, grid_bits):
    """Return the edge function of a -> b at a pixel's centre."""
    half = np.int64(1) << (grid_bits - 1)
    return edge(ax, ay, bx, by, (column << grid_bits) + half, (row << grid_bits) + half)


@helper
def line_at(a, b, column, row, grid_bits):
    """Return an edge as (value at a pixel, step to the next column, to the next row)."""
    value = edge_at(a[0], a[1], b[0], b[1], column, row, grid_bits)
    return (
        value / np.float32(np.int64(1) << grid_bits),
        np.float32(a[1] - b[1]),
        np.float32(b[0] - a[0]),
    )


@helper
def edges_at(a, b, c, column, row, grid_bits):
    """Return the three edges of a triangle, as `line_at` does."""
    return (
        line_at(b, c, column, row, grid_bits),
        line_at(c, a, column, row, grid_bits),
        line_at(a, b, column, row, grid_bits),
    )


@helper
def prepare_inside(ax, ay, bx, by, left, top, grid_bits):
    """Return an edge as (value at a pixel, step to the next column, to the next row)."""
    unit = np.float32(np.int64(1) << grid_bits)
    return (
        edge_at(ax, ay, bx, by, left, top, grid_bits), np.float32(ay - by) * unit,
        np.float32(bx - ax) * unit,
    )  # fmt: skip


@helper
def prepare_crossing(edge):
    """Return an edge as (value, step down, columns for each unit of them, side)."""
    value, across, down = edge
    if across == 0:
        return value, down, FAR_AWAY, np.int64(0)
    return value, down, np.float32(1.0) / abs(across), np.int64(across > 0)


@helper
def bound_span(first, last, line, row):
    """Return the first and the last column that one edge leaves of a row."""
    value, down, columns, begins = line
    crossing = np.floor((value + row * down) * columns)
    return (
        max(first, -crossing) if begins else first,
        last if begins else min(last, crossing),
    )


@disjoint_helper
def find_spans(begins, ends, depths, lanes, lines, columns, inside_bc, inside_ca, plane):
    """
    Write, row by row, the first covered column, one past the last, and the depth at the first.

    Returns the number of columns that the longest row covers.
    """
    width, longest = np.float32(columns), np.int32(0)
    (e0, across0, down0), (e1, across1, down1) = inside_bc, inside_ca
    for i in range(lanes):
        row = np.float32(np.int32(i))
        first, last = np.float32(0.0), width - np.float32(1.0)
        first, last = bound_span(first, last, lines[0], row)
        first, last = bound_span(first, last, lines[1], row)
        first, last = bound_span(first, last, lines[2], row)
        first = min(first, width)
        begin, end = np.int32(first), np.int32(max(last, np.float32(-1.0))) + np.int32(1)
        begins[i], ends[i] = begin, end
        longest = max(longest, np.int32(end - begin))
        depths[i] = evaluate_depth(
            plane, e0 + first * across0 + row * down0, e1 + first * across1 + row * down1
        )
    return np.int64(longest)


@helper
def evaluate_depth(plane, edge_bc, edge_ca):
    """Return the depth where two edge functions have the given values."""
    return plane[0] + (edge_bc * plane[1] + edge_ca * plane[2])


@helper
def draw_small(n, whole, real, plane, origin, tile, is_unordered):
    """Test the samples in the box of a triangle against edges in float32, row by row."""
    left, top = (
        np.int64(whole[flat_index(batches.LEFT, n)]),
        np.int64(whole[flat_index(batches.TOP, n)]),
    )
    first = (top - origin[1]) * tile_rasterizer.SCRATCH_SHAPE[1] + left - origin[0]
    rows = np.int64(whole[flat_index(batches.BOTTOM, n)]) - top + 1
    columns = np.int32(whole[flat_index(batches.RIGHT, n)] - left + 1)
    e0, e1 = real[flat_index(batches.EDGE, n)], real[flat_index(batches.EDGE + 1, n)]
    across0, across1 = real[flat_index(batches.ACROSS, n)], real[flat_index(batches.ACROSS + 1, n)]
    down0, down1 = real[flat_index(batches.DOWN, n)], real[flat_index(batches.DOWN + 1, n)]
    edges = (
        e0, e1, real[flat_index(batches.EDGE + 2, n)], across0, across1,
        real[flat_index(batches.ACROSS + 2, n)], down0, down1,
        real[flat_index(batches.DOWN + 2, n)],
    )  # fmt: skip
    depth = (
        e0, e1, across0, across1, down0, down1, plane[0], plane[1], plane[2], plane[4], plane[5],
    )  # fmt: skip
    draw_box(
        tile[0], tile[1], first, np.int64(tile_rasterizer.SCRATCH_SHAPE[1]), rows, columns, edges,
        depth, np.int32(whole[flat_index(batches.FACE, n)]), is_unordered,
    )  # fmt: skip


def allocate_scratch(depth_type: Any = np.float32) -> tuple[NDArray[Any], ...]:
    """Return the memory that a thread needs to draw, its real numbers in float32."""
    return tuple(
        np.empty(array.shape, np.float32) if array.dtype == np.float64 else array
        for array in tile_rasterizer.allocate_scratch(depth_type)
    )


def in_float32(kinds: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return types of arrays, with float32 in place of float64."""
    return tuple(
        kind._replace(dtype=float32.dtype) if kind.dtype == float64.dtype else kind
        for kind in kinds
    )


# --- putting them in place --------------------------------------------------------------------


def twin(module: ModuleType, **others: Any) -> SimpleNamespace:
    """
    Return a module once more, with others in place of some of its functions.

    Every function of the module is made again from its own code, so that it calls the others, and
    compiled in its own way. Kernels are this file's then: the store keeps them beside the others.
    """
    strangers = others.keys() - vars(module).keys()
    if strangers:
        raise ValueError(f"{module.__name__} has no {', '.join(sorted(strangers))} to stand in for")
    names = {**vars(module), **others}
    for name in vars(module).keys() - others.keys():
        compiled = names[name]
        function = inspect.unwrap(getattr(compiled, "function", compiled))
        if not isinstance(function, FunctionType) or function.__module__ != module.__name__:
            continue
        again = FunctionType(function.__code__, names, name, function.__defaults__)
        again.__kwdefaults__, again.__annotations__ = (
            function.__kwdefaults__, function.__annotations__,
        )  # fmt: skip
        again.__module__ = __name__
        if isinstance(compiled, Helper):
            again = Helper(again, compiled.is_disjoint)
        elif hasattr(compiled, "cache_parameters"):
            again = functools.cache(again)
        elif not isinstance(compiled, FunctionType):
            again = type(compiled)(again)
        names[name] = again
    return SimpleNamespace(**names)


def careless_stages() -> SimpleNamespace:
    """Return ``visibility_pass`` with the functions above in place of the exact ones."""
    exact = ModuleType(setup.__name__)
    exact.__dict__.update(vars(setup), narrow_edge=edge)
    planning = twin(
        batches, setup=exact, is_above=is_above, bound_triangles=bound_triangles,
        set_up_depth_planes=set_up_depth_planes, set_up_edge=set_up_edge,
        FLOAT_ROWS_TYPE=float32[:, ::1],
    )  # fmt: skip
    covering = twin(
        tile_rasterizer, set_up_batch=planning.set_up_batch,
        order_triangles=planning.order_triangles, edge_at=edge_at, edges_at=edges_at,
        prepare_crossing=prepare_crossing, find_spans=find_spans, evaluate_depth=evaluate_depth,
        draw_small=draw_small, prepare_inside=prepare_inside, allocate_scratch=allocate_scratch,
        FLOAT_ROWS_TYPE=planning.FLOAT_ROWS_TYPE,
        SPAN_MEMORY=in_float32(tile_rasterizer.SPAN_MEMORY),
        SCRATCH=in_float32(tile_rasterizer.SCRATCH),
    )  # fmt: skip
    # Which tiles a triangle reaches is asked of few, and in whole numbers.
    listing = twin(setup, edge=edge, edge_bias=edge_bias, tile_edges=setup.tile_edges)
    return twin(visibility_pass, setup=listing, tile_rasterizer=covering)


class FloatTriangles(Visibility):
    """Transform, projection, set-up, binning and visibility, carelessly."""

    def __init__(self, scene: TriangleScene, threads: int) -> None:
        super().__init__(scene, threads)
        self._stages = careless_stages()
