"""The light on a block's samples, and the colours that come of it."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.encode import encode_channels, encode_span
from rasterjit.pipeline.lighting import blinn_phong
from rasterjit.pipeline.lighting.pbr import add_facet_light, largest, start_facets
from rasterjit.pipeline.surface import samples as rows
from rasterjit.pipeline.surface.samples import (
    INTERVAL_COLUMN,
    INTERVAL_ROW,
    INTERVAL_START,
    INTERVAL_STOP,
    INTERVALS,
    Block,
)
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import helper, stage
from rasterjit.runtime.state import float32, int32, int64, uint32

VIEW, TOLD, TOWARD_LIGHT, FALLOFF = 0, 3, 4, 7
"""Rows of ``single``: directions toward the viewer, and whether they are known; the same toward a
light, and the share of it that arrives."""


@stage
def normalize_normals(block: Block, count):
    """Scale the normals to length one."""
    blinn_phong.scale_normals(block.samples, count)


@stage
def show_ambient(block: Block, count, ambient: float32[::1]):
    """Write the unlit colour, or the share of it that ambient light shows."""
    s = block.samples
    blinn_phong.start_colors(
        part(s, rows.RED, 0, count), part(s, rows.GREEN, 0, count), part(s, rows.BLUE, 0, count),
        part(s, rows.LIT, 0, count), ambient, part(s, rows.OCCLUSION, 0, count),
        part(s, rows.OUT_RED, 0, count), part(s, rows.OUT_GREEN, 0, count),
        part(s, rows.OUT_BLUE, 0, count),
    )  # fmt: skip


@stage
def add_shiny_lights(
    block: Block, count, lights: float32[:, ::1], first: int64, end: int64,
    toward_viewer: float32[::1],
):  # fmt: skip
    """Add lights ``first`` to ``end``: Lambert's diffuse part and Blinn's highlight."""
    s, r = block.samples, block.single
    if not largest(part(s, rows.LIT, 0, count)) > np.float32(0.0):
        return
    nx, ny, nz = (
        part(s, rows.NORMAL_X, 0, count), part(s, rows.NORMAL_Y, 0, count),
        part(s, rows.NORMAL_Z, 0, count),
    )  # fmt: skip
    px, py, pz = (
        part(s, rows.POINT_X, 0, count), part(s, rows.POINT_Y, 0, count),
        part(s, rows.POINT_Z, 0, count),
    )  # fmt: skip
    vx, vy, vz, told = (
        part(r, VIEW, 0, count), part(r, VIEW + 1, 0, count), part(r, VIEW + 2, 0, count),
        part(r, TOLD, 0, count),
    )  # fmt: skip
    lx, ly, lz, falloff = (
        part(r, TOWARD_LIGHT, 0, count), part(r, TOWARD_LIGHT + 1, 0, count),
        part(r, TOWARD_LIGHT + 2, 0, count), part(r, FALLOFF, 0, count),
    )  # fmt: skip
    blinn_phong.find_viewer(toward_viewer, px, py, pz, vx, vy, vz, told)
    for n in range(first, end):
        blinn_phong.find_light(lights[n], px, py, pz, lx, ly, lz, falloff)
        blinn_phong.find_angles(
            nx, ny, nz, part(s, rows.SPECULAR, 0, count), vx, vy, vz, told, lx, ly, lz
        )
        blinn_phong.add_light(
            lights[n], lx, ly, lz, falloff, part(s, rows.SHININESS, 0, count),
            part(s, rows.LIT, 0, count), part(s, rows.SHADOW, 0, count),
            part(s, rows.RED, 0, count), part(s, rows.GREEN, 0, count),
            part(s, rows.BLUE, 0, count), part(s, rows.OUT_RED, 0, count),
            part(s, rows.OUT_GREEN, 0, count), part(s, rows.OUT_BLUE, 0, count),
        )  # fmt: skip


@stage
def add_diffuse_lights(block: Block, count, lights: float32[:, ::1], first: int64, end: int64):
    """Add lights ``first`` to ``end`` where no object has a highlight: Lambert's diffuse part."""
    s = block.samples
    if largest(part(s, rows.LIT, 0, count)) > np.float32(0.0):
        for n in range(first, end):
            blinn_phong.add_diffuse_light(
                lights[n], part(s, rows.NORMAL_X, 0, count), part(s, rows.NORMAL_Y, 0, count),
                part(s, rows.NORMAL_Z, 0, count), part(s, rows.POINT_X, 0, count),
                part(s, rows.POINT_Y, 0, count), part(s, rows.POINT_Z, 0, count),
                part(s, rows.LIT, 0, count), part(s, rows.SHADOW, 0, count),
                part(s, rows.RED, 0, count), part(s, rows.GREEN, 0, count),
                part(s, rows.BLUE, 0, count), part(s, rows.OUT_RED, 0, count),
                part(s, rows.OUT_GREEN, 0, count), part(s, rows.OUT_BLUE, 0, count),
            )  # fmt: skip


@stage
def show_ambient_on_facets(block: Block, count, ambient: float32[::1], toward_viewer: float32[::1]):
    """Write what ambient light shows of metallic-roughness samples."""
    s = block.samples
    start_facets(
        ambient, toward_viewer, part(s, rows.OCCLUSION, 0, count), part(s, rows.NORMAL_X, 0, count),
        part(s, rows.NORMAL_Y, 0, count), part(s, rows.NORMAL_Z, 0, count),
        part(s, rows.POINT_X, 0, count), part(s, rows.POINT_Y, 0, count),
        part(s, rows.POINT_Z, 0, count), part(s, rows.METALLIC, 0, count),
        part(s, rows.ROUGHNESS, 0, count), part(s, rows.MICROFACET, 0, count),
        part(s, rows.RED, 0, count), part(s, rows.GREEN, 0, count), part(s, rows.BLUE, 0, count),
        part(s, rows.OUT_RED, 0, count), part(s, rows.OUT_GREEN, 0, count),
        part(s, rows.OUT_BLUE, 0, count),
    )  # fmt: skip


@stage
def add_lights_on_facets(
    block: Block, count, lights: float32[:, ::1], first: int64, end: int64,
    toward_viewer: float32[::1], parts: float32[::1],
):  # fmt: skip
    """Add lights ``first`` to ``end`` to metallic-roughness samples, as far as they are reached."""
    s = block.samples
    if largest(part(s, rows.MICROFACET, 0, count)) > np.float32(0.0):
        for n in range(first, end):
            add_facet_light(
                lights[n], toward_viewer, parts, part(s, rows.NORMAL_X, 0, count),
                part(s, rows.NORMAL_Y, 0, count), part(s, rows.NORMAL_Z, 0, count),
                part(s, rows.POINT_X, 0, count), part(s, rows.POINT_Y, 0, count),
                part(s, rows.POINT_Z, 0, count), part(s, rows.METALLIC, 0, count),
                part(s, rows.ROUGHNESS, 0, count), part(s, rows.MICROFACET, 0, count),
                part(s, rows.SHADOW, 0, count), part(s, rows.RED, 0, count),
                part(s, rows.GREEN, 0, count), part(s, rows.BLUE, 0, count),
                part(s, rows.OUT_RED, 0, count), part(s, rows.OUT_GREEN, 0, count),
                part(s, rows.OUT_BLUE, 0, count),
            )  # fmt: skip


@helper
def interval_of(block, k):
    """Return row, first column, first sample and one past the last of an interval."""
    interval = block.intervals[k]
    return (
        np.int64(interval[INTERVAL_ROW]), np.int64(interval[INTERVAL_COLUMN]),
        np.int64(interval[INTERVAL_START]), np.int64(interval[INTERVAL_STOP]),
    )  # fmt: skip


@stage
def write_opaque_codes(block: Block, count, shown: int64, table: int32[::1], color: uint32[:, ::1]):
    """Write what the three rows of samples from ``shown`` on show in sRGB codes, opaque."""
    s = block.samples
    for k in range(block.counts[INTERVALS]):
        row, column, start, stop = interval_of(block, k)
        encode_span(
            part(s, shown, start, stop), part(s, shown + 1, start, stop),
            part(s, shown + 2, start, stop), table, color[row, column : column + stop - start],
        )  # fmt: skip


@stage
def write_blended_codes(
    block: Block, count, shown: int64, table: int32[::1], color: uint32[:, ::1]
):
    """Write the same with the alpha of each sample."""
    s = block.samples
    for k in range(block.counts[INTERVALS]):
        row, column, start, stop = interval_of(block, k)
        encode_channels(
            part(s, shown, start, stop), part(s, shown + 1, start, stop),
            part(s, shown + 2, start, stop), part(s, rows.ALPHA, start, stop), table,
            color[row, column : column + stop - start],
        )  # fmt: skip


@stage
def write_linear(block: Block, count, shown: int64, has_alpha: int64, linear: float32[:, :, ::1]):
    """Write the three rows of samples from ``shown`` on in linear light, and alpha, 1 without."""
    s = block.samples
    for k in range(block.counts[INTERVALS]):
        row, column, start, stop = interval_of(block, k)
        out = linear[row, column : column + stop - start]
        for i in range(out.shape[0]):
            out[i, 0], out[i, 1] = s[shown, start + i], s[shown + 1, start + i]
            out[i, 2] = s[shown + 2, start + i]
            out[i, 3] = s[rows.ALPHA, start + i] if has_alpha != 0 else np.float32(1.0)
