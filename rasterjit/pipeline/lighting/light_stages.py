"""Run lighting on a block of samples, and write the resulting colours."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.lighting import blinn_phong, pbr
from rasterjit.pipeline.srgb_encoding import encode_channels, encode_span
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import part, three_parts
from rasterjit.runtime.jit import helper, stage
from rasterjit.runtime.state_block import float32, int32, int64, uint32

SHARES, SHOWN = 0, 2
"""Rows of ``single``, two and three: what `find_shares` and `find_ambient` write."""
VIEWER, LIGHT = 0, 4
"""Rows of ``single``, four each: what `blinn_phong.find_viewer` and `blinn_phong.find_light` write.
"""
BOUNCED = 0
"""Rows of ``shares``, three: what `find_bounced` writes."""


@stage
def normalize_normals(block: Block, count):
    """Scale the normals to length one."""
    blinn_phong.scale_normals(block.samples, count)


@stage
def show_ambient(block: Block, count, ambient: float32[::1]):
    """Write the unlit colour, or the share of it that ambient light shows."""
    s = block.samples
    blinn_phong.start_colors(
        *three_parts(s, rows.RED, 0, count), part(s, rows.LIT, 0, count), ambient,
        part(s, rows.OCCLUSION, 0, count), *three_parts(s, rows.OUT_RED, 0, count),
    )  # fmt: skip


@helper
def three_rows(samples, first, count):
    """Return three rows that follow each other: of normals, points or colours."""
    return three_parts(samples, first, 0, count)


@helper
def directions_of(scratch, first, count):
    """Return four rows of scratch memory: a direction, and a number."""
    return (
        part(scratch, first, 0, count), part(scratch, first + 1, 0, count),
        part(scratch, first + 2, 0, count), part(scratch, first + 3, 0, count),
    )  # fmt: skip


@stage
def add_shiny_lights(
    block: Block, count, lights: float32[:, ::1], first: int64, end: int64,
    toward_viewer: float32[::1],
):  # fmt: skip
    """
    Add lights ``first`` to ``end``: Lambert's diffuse part and Blinn's highlight.

    In several loops: in one long loop, the core's out-of-order window is too small to overlap the
    latency of roots and divisions with the next vectors.
    """
    s = block.samples
    if not pbr.is_any_above_zero(part(s, rows.LIT, 0, count)):
        return
    normals, points = three_rows(s, rows.NORMAL_X, count), three_rows(s, rows.POINT_X, count)
    viewer, toward = (
        directions_of(block.single, VIEWER, count), directions_of(block.single, LIGHT, count)
    )  # fmt: skip
    blinn_phong.find_viewer(toward_viewer, *points, *viewer)
    for n in range(first, end):
        blinn_phong.find_light(lights[n], *points, *toward)
        facing, cosine, shine, falloff = toward
        blinn_phong.find_angles(
            *normals, part(s, rows.SPECULAR, 0, count), *viewer, facing, cosine, shine
        )
        blinn_phong.find_shine(part(s, rows.SHININESS, 0, count), cosine, shine)
        blinn_phong.add_shiny_light(
            lights[n], facing, shine, falloff, part(s, rows.LIT, 0, count),
            part(s, rows.SHADOW, 0, count), *three_rows(s, rows.RED, count),
            *three_rows(s, rows.OUT_RED, count),
        )  # fmt: skip


@stage
def add_diffuse_lights(block: Block, count, lights: float32[:, ::1], first: int64, end: int64):
    """Add lights ``first`` to ``end`` where no object has a highlight: Lambert's diffuse part."""
    s = block.samples
    if not pbr.is_any_above_zero(part(s, rows.LIT, 0, count)):
        return
    toward = directions_of(block.single, LIGHT, count)
    for n in range(first, end):
        blinn_phong.find_light(lights[n], *three_rows(s, rows.POINT_X, count), *toward)
        blinn_phong.add_diffuse_light(
            lights[n], *three_rows(s, rows.NORMAL_X, count), *toward, part(s, rows.LIT, 0, count),
            part(s, rows.SHADOW, 0, count), *three_rows(s, rows.RED, count),
            *three_rows(s, rows.OUT_RED, count),
        )  # fmt: skip


@stage
def show_ambient_on_facets(block: Block, count, ambient: float32[::1], toward_viewer: float32[::1]):
    """Write the ambient light reflected by metallic-roughness samples."""
    s, r = block.samples, block.single
    microfacet = part(s, rows.MICROFACET, 0, count)
    if not pbr.is_any_above_zero(microfacet):
        return
    scale, offset = part(r, SHARES, 0, count), part(r, SHARES + 1, 0, count)
    shown = three_parts(r, SHOWN, 0, count)
    pbr.find_shares(
        toward_viewer, *three_rows(s, rows.NORMAL_X, count), *three_rows(s, rows.POINT_X, count),
        part(s, rows.ROUGHNESS, 0, count), scale, offset,
    )  # fmt: skip
    pbr.find_ambient(
        ambient, part(s, rows.OCCLUSION, 0, count), part(s, rows.METALLIC, 0, count), scale, offset,
        *three_rows(s, rows.RED, count), *shown,
    )  # fmt: skip
    red, green, blue = three_rows(s, rows.OUT_RED, count)
    pbr.show_on_facets(shown[0], microfacet, red)
    pbr.show_on_facets(shown[1], microfacet, green)
    pbr.show_on_facets(shown[2], microfacet, blue)


@stage
def add_lights_on_facets(
    block: Block, count, lights: float32[:, ::1], first: int64, end: int64,
    toward_viewer: float32[::1], parts: float32[::1],
):  # fmt: skip
    """Add lights ``first`` to ``end`` to metallic-roughness samples, times their visibility."""
    s = block.samples
    if not pbr.is_any_above_zero(part(s, rows.MICROFACET, 0, count)):
        return
    normals, points = three_rows(s, rows.NORMAL_X, count), three_rows(s, rows.POINT_X, count)
    viewer, toward = (
        directions_of(block.single, VIEWER, count), directions_of(block.single, LIGHT, count)
    )  # fmt: skip
    blinn_phong.find_viewer(toward_viewer, *points, *viewer)
    bounced = three_rows(block.shares, BOUNCED, count)
    if pbr.is_any_above_zero(part(s, rows.METALLIC, 0, count)):
        pbr.find_bounced(
            viewer[0], viewer[1], viewer[2], *normals, part(s, rows.ROUGHNESS, 0, count),
            part(s, rows.METALLIC, 0, count), *three_rows(s, rows.RED, count), *bounced,
        )  # fmt: skip
    else:
        pbr.show_nothing(*bounced)
    for n in range(first, end):
        blinn_phong.find_light(lights[n], *points, *toward)
        facing, shine, grazed, falloff = toward
        pbr.find_facet_angles(
            parts, *normals, part(s, rows.ROUGHNESS, 0, count), *viewer, facing, shine, grazed
        )
        pbr.add_facet_light(
            lights[n], parts, facing, shine, grazed, falloff, part(s, rows.METALLIC, 0, count),
            part(s, rows.MICROFACET, 0, count), part(s, rows.SHADOW, 0, count),
            *three_rows(s, rows.RED, count), *bounced, *three_rows(s, rows.OUT_RED, count),
        )  # fmt: skip


@helper
def interval_of(block, k):
    """Return row, first column, first sample and one past the last of an interval."""
    interval = block.intervals[k]
    return (
        np.int64(interval[rows.INTERVAL_ROW]), np.int64(interval[rows.INTERVAL_COLUMN]),
        np.int64(interval[rows.INTERVAL_START]), np.int64(interval[rows.INTERVAL_STOP]),
    )  # fmt: skip


@stage
def write_opaque_codes(block: Block, count, shown: int64, table: int32[::1], color: uint32[:, ::1]):
    """Write what the three rows of samples from ``shown`` on show in sRGB codes, opaque."""
    s = block.samples
    for k in range(block.counts[rows.INTERVALS]):
        row, column, start, stop = interval_of(block, k)
        encode_span(
            *three_parts(s, shown, start, stop), table, color[row, column : column + stop - start]
        )


@stage
def write_blended_codes(
    block: Block, count, shown: int64, table: int32[::1], color: uint32[:, ::1]
):
    """Write the same with the alpha of each sample."""
    s = block.samples
    for k in range(block.counts[rows.INTERVALS]):
        row, column, start, stop = interval_of(block, k)
        encode_channels(
            *three_parts(s, shown, start, stop), part(s, rows.ALPHA, start, stop), table,
            color[row, column : column + stop - start],
        )  # fmt: skip


@stage
def write_linear(block: Block, count, shown: int64, has_alpha: int64, linear: float32[:, :, ::1]):
    """Write the three rows of samples from ``shown`` on in linear light, and alpha, 1 without."""
    s = block.samples
    for k in range(block.counts[rows.INTERVALS]):
        row, column, start, stop = interval_of(block, k)
        out = linear[row, column : column + stop - start]
        for i in range(out.shape[0]):
            out[i, 0], out[i, 1] = s[shown, start + i], s[shown + 1, start + i]
            out[i, 2] = s[shown + 2, start + i]
            out[i, 3] = s[rows.ALPHA, start + i] if has_alpha != 0 else np.float32(1.0)
