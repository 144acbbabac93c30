"""A sample has the same bits in a span and in a mixed segment, and wherever blocks begin."""

from __future__ import annotations

import numpy as np
import pytest
import stages

import rasterjit as rj
from rasterjit.pipeline.surface.gather_samples import MIN_SPAN_SAMPLES
from rasterjit.pipeline.surface.sample_block import (
    MAX_SAMPLES,
    MAX_VECTOR_SAMPLES,
    MIXED,
    ROW_STRIDE,
    SPAN,
    START,
    STOP,
    Block,
)
from rasterjit.rendering.pass_runner import BLOCK, THREAD_BLOCK
from rasterjit.runtime import intrinsics, jit

SIZE = (200, 12)
WIDTHS = [1, 2, 3, 1, 40, 1, 1, 16, 5, 17, 1, 64, 2, 31, 7, 8, 1]
"""Columns of neighbouring strips: 201, about one pixel each."""

ACROSS_SAMPLES = [name for name, kind in zip(Block._fields, BLOCK.fields, strict=True)
                  if kind.shape[-1] % ROW_STRIDE == 0]  # fmt: skip
"""The arrays of a block that have columns for every sample."""


def strips(model, texture=None, **options):
    """Return a wall of strips, two faces each, whose vertices differ in depth."""
    rng = np.random.default_rng(5)
    x = np.concatenate([[0.0], np.cumsum(WIDTHS)]) / sum(WIDTHS) * 2 - 1
    flat = np.column_stack([np.repeat(x, 2), np.tile([1.0, -1.0], len(x))])
    vertices = np.column_stack([flat * [5.6, 0.3], rng.uniform(-0.5, 0.5, len(flat))])
    first = 2 * np.arange(len(WIDTHS))[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [2, 1, 3]])
    return rj.Mesh(
        vertices, rng.permutation(faces), uv=rng.uniform(-1, 2, (len(flat), 2)),
        material=rj.Material(model, "white", specular=0.4, base_color_texture=texture), **options,
    )  # fmt: skip


def camera(near=0.1):
    return rj.PerspectiveCamera(eye=(0.4, 0.1, 4.0), target=(0, 0, 0), fov_y=10.0, near=near)


def shaded(scene, camera):
    """Render; return the bands that were shaded."""
    with stages.bands_shaded() as bands:
        rj.render(scene, camera, size=SIZE, outputs=("linear", "color"), threads=1)
    assert bands
    if not jit.DISABLED:
        return bands
    # Two rows take long enough in plain Python.
    some = slice(5, 7)
    return [
        (shading, faces[some], first_row + 5, linear[some], color[some])
        for shading, faces, first_row, linear, color in bands
    ]


def scene_of(*meshes):
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh)
    scene.lights = [
        rj.AmbientLight("white", 0.15),
        rj.DirectionalLight((-1, -2, -1.5), intensity=0.6),
        rj.PointLight((2.0, 1.0, 3.0), color=(0.4, 0.5, 1.0), intensity=4.0),
    ]
    return scene


def texture(side=16):
    return rj.Texture(np.random.default_rng(7).uniform(0, 1, (side, side, 3)))


def again(shading, faces, first_row):
    """Shade some rows; return linear light and codes."""
    linear = np.empty((*faces.shape, 4), np.float32)
    color = np.empty(faces.shape, np.uint32)
    shading.shade(np.ascontiguousarray(faces), first_row, linear, color)
    return linear, color


def assert_same_bits(one, other, shown):
    """Two pictures of some rows, linear and in codes, show the same where told."""
    for a, b in zip(one, other, strict=True):
        assert a[:, shown].tobytes() == b[:, shown].tobytes()


def assert_neighbours_do_not_matter(bands):
    """Shade once more, with some columns left out: what is left keeps its bits."""
    for shading, faces, first_row, *pictures in bands:
        columns = np.arange(faces.shape[1])
        for period, kept in ((2, 1), (3, 2), (7, 5), (50, 33)):
            for shift in (0, 1):
                shown = (columns + shift) % period < kept
                some = np.where(shown, faces, np.int32(-1))
                assert_same_bits(again(shading, some, first_row), pictures, shown)
                # Where runs are shorter than a span must be, none is left.
                assert kept >= MIN_SPAN_SAMPLES or stages.samples_listed(some)[SPAN] == 0


@pytest.mark.parametrize("first", [0, 1, 7, 15, 16, 23])
def test_long_runs_are_spans_from_any_column_on(first):
    for length in (MIN_SPAN_SAMPLES - 1, MIN_SPAN_SAMPLES, MIN_SPAN_SAMPLES + 9, 100):
        faces = np.full((2, first + length + 3), -1, np.int32)
        faces[1, first : first + length] = 1
        listed = stages.samples_listed(faces)
        assert listed[SPAN if length >= MIN_SPAN_SAMPLES else MIXED] == length
        assert sum(listed) == length


@pytest.mark.parametrize("model", ["unlit", "flat", "gouraud", "phong"])
@pytest.mark.parametrize("near", [0.1, 3.9])
def test_neighbours_change_no_bit_of_a_sample(model, near):
    rng = np.random.default_rng(6)
    mesh = strips(model, colors=rng.uniform(0, 1, (2 * len(WIDTHS) + 2, 3)))
    bands = shaded(scene_of(mesh), camera(near))
    face_id = np.concatenate([faces for _, faces, *_ in bands])
    assert (face_id >= 0).any()
    changes = (np.diff(face_id) != 0).sum(axis=1)
    assert near > 1 or changes.max() >= 10
    assert_neighbours_do_not_matter(bands)


@pytest.mark.parametrize("model", ["gouraud", "phong"])
def test_neighbours_change_no_bit_of_a_textured_sample(model):
    bands = shaded(scene_of(strips(model, texture())), camera(3.9))
    assert any((faces >= 0).any() for _, faces, *_ in bands)
    assert_neighbours_do_not_matter(bands)


def test_neighbours_change_no_bit_of_a_face_colour():
    colors = np.random.default_rng(8).uniform(0, 1, (2 * len(WIDTHS), 3))
    assert_neighbours_do_not_matter(shaded(scene_of(strips("phong", colors=colors)), camera()))


@pytest.mark.parametrize("near", [0.1, 3.9])
@pytest.mark.parametrize("name", ["plain", "textured", "normal map"])
def test_a_face_in_a_span_has_the_bits_of_one_among_other_faces(name, near):
    # One face all over, then the same with a neighbour in every 8th column.
    material = {
        "plain": rj.Material("phong", "orange", specular=0.4),
        "textured": rj.Material("phong", specular=0.4, base_color_texture=texture()),
        "normal map": rj.Material("pbr", normal_texture=texture(), base_color_texture=texture()),
    }[name]
    corners = np.array([(-60, -30, -1), (60, -30, 2), (0, 90, 0.5)])
    mesh = rj.Mesh(
        np.concatenate([corners, corners - (0, 0, 0.5)]), [[0, 1, 2], [3, 4, 5]],
        uv=np.tile([(0, 0), (30, 1), (3, 40)], (2, 1)), material=material,
    )  # fmt: skip
    pictures = []
    for shading, faces, first_row, *_ in shaded(scene_of(mesh), camera(near)):
        own = np.zeros_like(faces)
        alone = again(shading, own, first_row)
        shown = np.arange(own.shape[1]) % 8 != 7
        others = np.where(shown, own, np.int32(1))
        assert stages.samples_listed(own)[SPAN] >= 0.9 * own.size
        assert stages.samples_listed(others)[MIXED] == own.size
        among = again(shading, others, first_row)
        assert_same_bits(alone, among, shown)
        pictures.append(alone[0])
    assert len(np.unique(np.concatenate(pictures).reshape(-1, 4), axis=0)) > 100


def full_scene():
    """A scene whose samples take most rows of the block."""
    metal = rj.Material("pbr", normal_texture=texture(), base_color_texture=texture(4))
    wall = strips("phong", texture())
    scene = scene_of(wall, rj.Mesh(wall.vertices + (0, 0.2, 0.1), wall.faces, uv=wall.uv,
                                   material=metal))  # fmt: skip
    if not jit.DISABLED:
        # Plain Python takes minutes to blur it.
        scene.environment = rj.Environment.gradient(background=False)
    scene.fog = rj.Fog(density=0.05)
    return scene


@pytest.mark.needs_jit
def test_where_a_block_begins_changes_no_bit():
    for shading, faces, first_row, *pictures in shaded(full_scene(), camera()):
        assert (faces >= 0).sum() > 3 * MAX_SAMPLES
        # Each left out pixel of the first row lets all later blocks begin one sample later.
        for count in (1, 7, 16, 100, 151):
            some = faces.copy()
            some[0, :count] = -1
            linear, color = again(shading, some, first_row)
            assert linear[0, count:].tobytes() == pictures[0][0, count:].tobytes()
            assert linear[1:].tobytes() == pictures[0][1:].tobytes()
            assert color[1:].tobytes() == pictures[1][1:].tobytes()
        # Rows by themselves, and in bands.
        for rows in (1, 2, 5):
            for first in range(0, len(faces), rows):
                cut = slice(first, first + rows)
                linear, color = again(shading, faces[cut], first_row + first)
                assert linear.tobytes() == pictures[0][cut].tobytes()
                assert color.tobytes() == pictures[1][cut].tobytes()


@pytest.mark.parametrize("garbage", [0, -1, 0x7FF0_0000_7F80_0000, 0x7FFF_FFFF_7FFF_FFFF])
def test_what_a_block_held_before_changes_no_bit(garbage):
    # 0, NaN or -1, infinities, NaN or the largest whole number; indices among them.
    for shading, faces, first_row, *pictures in shaded(full_scene(), camera()):
        for kept in (3, 40):
            some = np.where(np.arange(faces.shape[1]) % 50 < kept, faces, np.int32(-1))
            shown = some[0] >= 0 if kept == 40 else np.arange(faces.shape[1]) % 50 < kept
            THREAD_BLOCK.block[:] = garbage
            assert_same_bits(again(shading, some, first_row), pictures, shown)


def test_rows_have_room_for_what_is_written_behind_the_last_sample():
    assert {*Block._fields} - {*ACROSS_SAMPLES} == {"counts", "segments", "intervals"}
    for name, kind in zip(Block._fields, BLOCK.fields, strict=True):
        if name in ACROSS_SAMPLES:
            room = kind.shape[-1] if kind.shape[-1] < 4 * ROW_STRIDE else kind.shape[-1] // 4
            # A segment in whole vectors may begin with the last sample, and so may a patch.
            assert room >= MAX_SAMPLES + MAX_VECTOR_SAMPLES - 1
            assert room >= MAX_SAMPLES - 1 + intrinsics.LANES
    lists = {"segments": MAX_SAMPLES, "intervals": MAX_SAMPLES}
    for name, most in lists.items():
        assert BLOCK.fields[Block._fields.index(name)].shape[0] >= most
    # The first samples of patches, and one past the last sample.
    assert BLOCK.fields[Block._fields.index("ints")].shape[1] > MAX_SAMPLES


@pytest.mark.parametrize("split", [MAX_SAMPLES - 1, 120, 113, 1])
def test_nothing_is_written_beyond_the_rows(split):
    scene = scene_of(strips("phong", texture(4)), strips("phong", texture(4)))
    shading = shaded(scene, camera())[0][0]
    # No two neighbours show one face, and from ``split`` on they show the other object.
    faces = np.arange(MAX_SAMPLES, dtype=np.int32)[np.newaxis] % 5
    faces[0, split:] += 2 * len(WIDTHS)
    mark = 0x4D4D_4D4D_4D4D_4D4D
    THREAD_BLOCK.block[:] = mark
    linear, _ = again(shading, faces, 0)
    assert np.isfinite(linear).all()
    block = stages.block_at_hand()

    def is_marked(part):
        return (np.ascontiguousarray(part).view(np.uint8) == 0x4D).all(axis=-1)

    assert block.segments[:2, [START, STOP]].tolist() == [
        [0, split], [split, MAX_SAMPLES],
    ]  # fmt: skip
    for name in ACROSS_SAMPLES:
        part = getattr(block, name)
        assert is_marked(
            part[..., part.shape[-1] // ROW_STRIDE * (MAX_SAMPLES + MAX_VECTOR_SAMPLES) :]
        ).all()
    # Between the arrays lies what fills their last cache line.
    end = split + -(-(MAX_SAMPLES - split) // MAX_VECTOR_SAMPLES) * MAX_VECTOR_SAMPLES
    weights = block.weights.view(np.int64)
    assert (weights[:, end - 1] != mark).all()
    assert (weights[:, end:] == mark).all()
