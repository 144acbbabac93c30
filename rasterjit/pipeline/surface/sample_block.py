"""
Define the block of samples that shading stages work on.

A block holds some hundred covered samples of a band of rows, one row of memory for each quantity
(structure of arrays), so that the loops of a stage vectorize. Its samples come in *segments* of one
object: a **span** is a long run of one face in a row, a **mixed** segment has patches of up to 8
samples, each of a face of its own. A patch is a face and its first sample; a span is one patch.

Loops of stages that write every segment run over whole vectors: the next segment overwrites what
they write past the end of one, and the last has room for it. A stage that skips some segments, or
changes values in place, ends where the segment ends.
"""

from __future__ import annotations

from typing import NamedTuple

from rasterjit.runtime.state_block import float32, float64, int32, int64

RED, GREEN, BLUE, ALPHA = 0, 1, 2, 3
"""Rows: base colour, linear."""
NORMAL_X, NORMAL_Y, NORMAL_Z = 4, 5, 6
"""Rows: normal in world axes, any length."""
POINT_X, POINT_Y, POINT_Z = 7, 8, 9
"""Rows: position in world axes, relative to the eye."""
SPECULAR, SHININESS = 10, 11
"""Rows: strength and exponent of the highlight."""
LIT = 12
"""Row: 1 where light falls on the base colour, 0 where it is the final colour."""
OUT_RED, OUT_GREEN, OUT_BLUE = 13, 14, 15
"""Rows: the resulting colour, linear."""
METALLIC, ROUGHNESS, MICROFACET = 16, 17, 18
"""Rows: metallic and roughness, 0..1; 1 where the object is shaded by microfacets, else 0."""
OCCLUSION = 19
"""Row: share of ambient and environment light that reaches the sample, 0..1."""
EMISSIVE_RED, EMISSIVE_GREEN, EMISSIVE_BLUE = 20, 21, 22
"""Rows: emitted light, linear."""
SHADOW = 23
"""Row: visibility of the current light, 0..1."""
TURNED_AWAY = 24
"""Row: 1 where a face turns away from the current light, though its shading normal faces it."""
SHADOW_MAP_U, SHADOW_MAP_V, SHADOW_MAP_DEPTH = 25, 26, 27
"""Rows: position in the current shadow map, texels from its upper left corner; stored depth."""
DEPTH_RIGHT, DEPTH_DOWN, BIAS = 28, 29, 30
"""Rows: change of stored depth per texel right and down; shadow bias, stored depth."""
BLOCKED_SHARE, BLOCKER_DEPTH = 31, 32
"""Rows: the share of the light that blockers hide from a sample; the same times how much nearer to
the light they are, in stored depth."""
COAT_NORMAL_X, COAT = 33, 36
COAT_RED, COAT_LIT, COAT_OUT, COAT_METALLIC, COAT_ROUGHNESS = 37, 40, 41, 44, 45
"""Rows of the clearcoat: normal, three; strength, 0..1; and the rows swapped with the base layer:
RED to BLUE, then LIT to ROUGHNESS."""
SHEEN_RED, SHEEN_ROUGHNESS = 46, 49
"""Rows of the sheen: colour, the first of three; roughness."""
F0_RED, F90, IS_DIELECTRIC = 50, 53, 54
"""Rows of the dielectric: F0, the first of three; specular strength, a factor on all it reflects; 1
where the object overrides the defaults."""
BEFORE_SHEEN_RED, BEFORE_SPECULAR_RED = 55, 58
"""Rows, three each: the colour before the sheen, and before the dielectric specular, is added."""
LAYER_RED, LAYER_LIT, LAYER_OUT, LAYER_METALLIC, LAYER_ROUGHNESS = 61, 64, 65, 68, 69
"""Rows of a layer that is lit in place of the base layer: RED to BLUE, then LIT to ROUGHNESS."""
MIRROR_PROBE_RED = 70
"""Rows, three: the ambient probe, light reflected by a white mirror."""
TINT_RED, TRANSMISSION, THICKNESS = 73, 76, 77
"""Rows of transmission: tint of the transmitted light, three; transmission factor; thickness of the
volume below, in units of the mesh."""
BENT_NORMAL_X = 78
"""Rows, three: the normal bent to the viewer, by which the sheen reads ambient light."""

MAX_SAMPLES = 256
"""Most samples in a block: 16 quantities of them, 32 KiB, stay near the core."""

ROW_STRIDE = MAX_SAMPLES + 32
"""Columns of a row of the block, padded: at a stride of a power of two, rows would evict each other
from L1."""

SEGMENT_COUNT, PATCH_COUNT, INTERVAL_COUNT = 0, 1, 2
"""Elements of ``counts``: number of each."""
NEXT_ROW, NEXT_COLUMN, LAST_OWNER = 3, 4, 5
"""Elements of ``counts``: where the next block begins; the object that was listed last."""
NEXT_SIDE, NEXT_VERTEX = NEXT_ROW, NEXT_COLUMN
"""The same elements while vertices are lit: side, 0 for the front; vertex, from the first."""
IS_LIT = 6
"""Element of ``counts``: not 0 if light falls on any sample; set by the shadows' ``receivers``."""
COUNT_ELEMENTS = 7

KIND, OWNER, START, STOP, FIRST_PATCH, END_PATCH, SPAN_COLUMN, SPAN_ROW = range(8)
"""Columns of ``segments``: `SPAN` or `MIXED`, the object, samples and patches; a span's pixel."""
SPAN, MIXED = 0, 1

INTERVAL_ROW, INTERVAL_COLUMN, INTERVAL_START, INTERVAL_STOP, INTERVAL_FRAME_ROW = range(5)
"""Columns of ``intervals``: runs of pixels contiguous in a row of the picture and in the block."""

A, B, C, FIRST_SAMPLE, FACE = 0, 1, 2, 3, 4
"""Rows of ``ints``, for each patch: vertices; its first sample; its face."""
AX, AY, BX, BY, CX, CY = 5, 6, 7, 8, 9, 10
"""Rows of ``ints``: where the vertices lie on the sub-pixel grid; of mixed segments."""
INEXACT, BACKFACE = 11, 12
"""Rows of ``ints``: not 0 if weights need the exact path; 1 if the sample's face is back-facing."""
COLUMN, ROW = 13, 14
"""Rows of ``ints``: the pixel of each sample of a mixed segment."""
INT_ROWS = 15

VERTEX_ROWS = 9
"""Rows of ``doubles`` and ``floats``: three for each vertex."""

MAX_VECTOR_SAMPLES = 16
"""Samples in the longest vector of a CPU."""

SAMPLE_ROWS = 81
UV_ROWS, LOOKUP_INT_ROWS, LOOKUP_WEIGHT_ROWS, TEXTURE_COLOR_ROWS = 14, 11, 3, 12
"""Numbers of rows for texture lookups: see ``texture_lookup``."""

RECEIVER_POINT, RECEIVER_NORMAL = 0, 3
"""Rows of ``receivers``, three each: the point of a sample and the normal of its face, any length,
world axes, relative to the eye."""
OFFSET_POINT, OFFSET_NORMAL = 6, 9
"""Rows of ``receivers``: the same, offset for one light, see ``effects.shadows.receivers``."""
RECEIVER_ROWS = 12


class Block(NamedTuple):
    """Some hundred samples, a row for each quantity and a column for each sample."""

    counts: int64[COUNT_ELEMENTS]
    """Counts, by the element names above; 0 before the first block of a picture."""
    segments: int32[ROW_STRIDE, 8]
    intervals: int32[ROW_STRIDE, 5]
    ints: int32[INT_ROWS, ROW_STRIDE]
    """Patches, and integers of samples."""
    weights: float64[2, ROW_STRIDE]
    """Barycentric weights of the second and the third vertex of each sample's face."""
    float32_weights: float32[3, ROW_STRIDE]
    """Barycentric weights of all three vertices: see ``float32_weights``."""
    samples: float32[SAMPLE_ROWS, ROW_STRIDE]
    """Colours, normals ...: the rows named above."""
    doubles: float64[VERTEX_ROWS, ROW_STRIDE]
    floats: float32[VERTEX_ROWS, ROW_STRIDE]
    """Vertex attributes of a mixed segment's faces, as a stage gathers them."""
    uv_rows: float64[UV_ROWS, ROW_STRIDE]
    """Texture coordinates ...: see ``texture_lookup``."""
    lookup_ints: int32[LOOKUP_INT_ROWS, ROW_STRIDE]
    lookup_weights: float32[LOOKUP_WEIGHT_ROWS, ROW_STRIDE]
    """Scratch memory for texture lookups."""
    colors: float32[TEXTURE_COLOR_ROWS, ROW_STRIDE]
    """Texture colours, and scratch memory for lookups."""
    receivers: float64[RECEIVER_ROWS, ROW_STRIDE]
    """Points and normals for shadows."""
