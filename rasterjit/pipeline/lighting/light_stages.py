"""Define the stages that light a block of samples, and write the resulting colours."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.lighting import blinn_phong, pbr
from rasterjit.pipeline.srgb_encoding import encode_channels, encode_span
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import four_parts
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import part, three_parts
from rasterjit.runtime.jit import helper, stage
from rasterjit.runtime.state_block import float32, int32, int64, uint32

ENV_BRDF, AMBIENT = 0, 2
"""Rows of ``floats``, two and three: what `find_env_brdf` and `find_ambient` write."""
VIEW_DIR, LIGHT_DIR = 0, 4
"""Rows of ``floats``, four each: direction to the viewer, and whether float32 holds its length;
direction to the light, and its attenuation."""
MULTIPLE_SCATTERING = 0
"""Rows of ``lookup_weights``, three: what `find_multiple_scattering` writes."""


@stage
def normalize_normals(block: Block, count):
    """Scale the normals to length one."""
    blinn_phong.normalize_normals(block.samples, count)


@stage
def start_with_ambient(block: Block, count, ambient: float32[::1]):
    """Write the colour of unlit samples, and ambient light on the others."""
    s = block.samples
    blinn_phong.write_ambient(
        *three_parts(s, rows.RED, 0, count), part(s, rows.LIT, 0, count), ambient,
        part(s, rows.OCCLUSION, 0, count), *three_parts(s, rows.OUT_RED, 0, count),
    )  # fmt: skip


@stage
def reset_visibility(block: Block, count):
    """Set the visibility of the next light to 1."""
    for n in range(np.uintp(count)):
        block.samples[rows.SHADOW, n] = np.float32(1.0)


@stage
def add_blinn_phong_lights(
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
    normals = three_parts(s, rows.NORMAL_X, 0, count)
    points = three_parts(s, rows.POINT_X, 0, count)
    viewer, light = (
        four_parts(block.floats, VIEW_DIR, 0, count), four_parts(block.floats, LIGHT_DIR, 0, count)
    )  # fmt: skip
    blinn_phong.find_view_directions(toward_viewer, *points, *viewer)
    for n in range(first, end):
        blinn_phong.find_light_directions(lights[n], *points, *light)
        n_l, n_h, highlight, falloff = light
        blinn_phong.find_cosines(
            *normals, part(s, rows.SPECULAR, 0, count), *viewer, n_l, n_h, highlight
        )
        blinn_phong.scale_highlights(part(s, rows.SHININESS, 0, count), n_h, highlight)
        blinn_phong.add_blinn_phong_light(
            lights[n], n_l, highlight, falloff, part(s, rows.LIT, 0, count),
            part(s, rows.SHADOW, 0, count), *three_parts(s, rows.RED, 0, count),
            *three_parts(s, rows.OUT_RED, 0, count),
        )  # fmt: skip


@stage
def add_diffuse_lights(block: Block, count, lights: float32[:, ::1], first: int64, end: int64):
    """Add lights ``first`` to ``end`` where no object has a highlight: Lambert's diffuse part."""
    s = block.samples
    if not pbr.is_any_above_zero(part(s, rows.LIT, 0, count)):
        return
    light = four_parts(block.floats, LIGHT_DIR, 0, count)
    for n in range(first, end):
        blinn_phong.find_light_directions(
            lights[n], *three_parts(s, rows.POINT_X, 0, count), *light
        )
        blinn_phong.add_diffuse_light(
            lights[n], *three_parts(s, rows.NORMAL_X, 0, count), *light,
            part(s, rows.LIT, 0, count), part(s, rows.SHADOW, 0, count),
            *three_parts(s, rows.RED, 0, count), *three_parts(s, rows.OUT_RED, 0, count),
        )  # fmt: skip


@stage
def write_microfacet_ambient(
    block: Block, count, ambient: float32[::1], toward_viewer: float32[::1]
):
    """Write the ambient light that metallic-roughness samples reflect."""
    s, floats = block.samples, block.floats
    microfacet = part(s, rows.MICROFACET, 0, count)
    if not pbr.is_any_above_zero(microfacet):
        return
    scale, offset = part(floats, ENV_BRDF, 0, count), part(floats, ENV_BRDF + 1, 0, count)
    reflected = three_parts(floats, AMBIENT, 0, count)
    pbr.find_env_brdf(
        toward_viewer, *three_parts(s, rows.NORMAL_X, 0, count),
        *three_parts(s, rows.POINT_X, 0, count), part(s, rows.ROUGHNESS, 0, count), scale, offset,
    )  # fmt: skip
    pbr.find_ambient(
        ambient, part(s, rows.OCCLUSION, 0, count), part(s, rows.METALLIC, 0, count), scale, offset,
        *three_parts(s, rows.RED, 0, count), *reflected,
    )  # fmt: skip
    red, green, blue = three_parts(s, rows.OUT_RED, 0, count)
    pbr.write_microfacets(reflected[0], microfacet, red)
    pbr.write_microfacets(reflected[1], microfacet, green)
    pbr.write_microfacets(reflected[2], microfacet, blue)


@stage
def add_microfacet_lights(
    block: Block, count, lights: float32[:, ::1], first: int64, end: int64,
    toward_viewer: float32[::1], lobes: float32[::1],
):  # fmt: skip
    """Add lights ``first`` to ``end`` to metallic-roughness samples, times their visibility."""
    s = block.samples
    if not pbr.is_any_above_zero(part(s, rows.MICROFACET, 0, count)):
        return
    normals = three_parts(s, rows.NORMAL_X, 0, count)
    points = three_parts(s, rows.POINT_X, 0, count)
    viewer, light = (
        four_parts(block.floats, VIEW_DIR, 0, count), four_parts(block.floats, LIGHT_DIR, 0, count)
    )  # fmt: skip
    blinn_phong.find_view_directions(toward_viewer, *points, *viewer)
    multiple = three_parts(block.lookup_weights, MULTIPLE_SCATTERING, 0, count)
    if pbr.is_any_above_zero(part(s, rows.METALLIC, 0, count)):
        pbr.find_multiple_scattering(
            viewer[0], viewer[1], viewer[2], *normals, part(s, rows.ROUGHNESS, 0, count),
            part(s, rows.METALLIC, 0, count), *three_parts(s, rows.RED, 0, count), *multiple,
        )  # fmt: skip
    else:
        pbr.write_zeros(*multiple)
    for n in range(first, end):
        blinn_phong.find_light_directions(lights[n], *points, *light)
        n_l, specular, schlick, falloff = light
        pbr.find_specular_terms(
            lobes, *normals, part(s, rows.ROUGHNESS, 0, count), *viewer, n_l, specular, schlick
        )
        pbr.add_microfacet_light(
            lights[n], lobes, n_l, specular, schlick, falloff, part(s, rows.METALLIC, 0, count),
            part(s, rows.MICROFACET, 0, count), part(s, rows.SHADOW, 0, count),
            *three_parts(s, rows.RED, 0, count), *multiple, *three_parts(s, rows.OUT_RED, 0, count),
        )  # fmt: skip


@helper
def read_interval(block, k):
    """Return row, first column, first sample and one past the last of an interval."""
    interval = block.intervals[k]
    return (
        np.int64(interval[rows.INTERVAL_ROW]), np.int64(interval[rows.INTERVAL_COLUMN]),
        np.int64(interval[rows.INTERVAL_START]), np.int64(interval[rows.INTERVAL_STOP]),
    )  # fmt: skip


@stage
def write_opaque_codes(block: Block, count, first: int64, table: int32[::1], color: uint32[:, ::1]):
    """Write three rows of samples, from ``first`` on, as opaque sRGB codes."""
    s = block.samples
    for k in range(block.counts[rows.INTERVAL_COUNT]):
        row, column, start, stop = read_interval(block, k)
        encode_span(
            *three_parts(s, first, start, stop), table, color[row, column : column + stop - start]
        )


@stage
def write_blended_codes(
    block: Block, count, first: int64, table: int32[::1], color: uint32[:, ::1]
):
    """Write three rows of samples, from ``first`` on, as sRGB codes with alpha."""
    s = block.samples
    for k in range(block.counts[rows.INTERVAL_COUNT]):
        row, column, start, stop = read_interval(block, k)
        encode_channels(
            *three_parts(s, first, start, stop), part(s, rows.ALPHA, start, stop), table,
            color[row, column : column + stop - start],
        )  # fmt: skip


@stage
def write_linear(block: Block, count, first: int64, has_alpha: int64, linear: float32[:, :, ::1]):
    """Write three rows of samples, from ``first`` on, as linear RGBA."""
    s = block.samples
    for k in range(block.counts[rows.INTERVAL_COUNT]):
        row, column, start, stop = read_interval(block, k)
        out = linear[row, column : column + stop - start]
        for i in range(out.shape[0]):
            out[i, 0], out[i, 1] = s[first, start + i], s[first + 1, start + i]
            out[i, 2] = s[first + 2, start + i]
            out[i, 3] = s[rows.ALPHA, start + i] if has_alpha != 0 else np.float32(1.0)
