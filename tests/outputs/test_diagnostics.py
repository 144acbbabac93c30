"""Diagnostics count every face once, agree with the frame, and cost nothing unless asked for."""

from __future__ import annotations

import dataclasses
import math

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.outputs import diagnostics_stage
from rasterjit.outputs.output_table import OUTPUTS
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.runtime import threads as sharing
from rasterjit.survey import object_transforms, packed_scene

SIZE = (128, 64)
CLIP = rj.MatrixCamera(np.eye(4), np.eye(4))
"""Takes world positions for clip positions: a parallel view along -z."""


def look(mesh, camera=CLIP, size=SIZE, outputs=("face_id", "depth"), **options):
    options.setdefault("threads", 1)
    return rj.render(mesh, camera, size=size, outputs=outputs, diagnose=True, **options)


def fates(d):
    return d.visible, d.hidden, d.sub_pixel, d.culled, d.degenerate, d.outside, d.invalid


def on_screen(points, z=0.0):
    """Return a mesh of separate triangles at exact screen points."""
    points = np.round(np.asarray(points, float).reshape(-1, 2) * 1024) / 1024
    clip = naive.clip_from_screen(points, SIZE, z)
    return rj.Mesh(clip[:, :3], np.arange(len(points)).reshape(-1, 3))


@pytest.fixture
def soup():
    """Triangles of every size around the eye, some without area, some invalid."""
    rng = np.random.default_rng(5)
    middles = rng.uniform(-4, 4, (400, 1, 3))
    sizes = 10.0 ** rng.uniform(-3, 0.5, (400, 1, 1))
    vertices = (middles + sizes * rng.normal(size=(400, 3, 3))).reshape(-1, 3)
    vertices[30:36] = vertices[30]
    vertices[60:63, 1] = math.nan, math.inf, -math.inf
    vertices[64] = 1e200
    return rj.Mesh(vertices, np.arange(1200).reshape(-1, 3), on_invalid="drop")


@pytest.fixture
def eye():
    return rj.PerspectiveCamera((0.1, 0.2, 0.3), (1, 0.5, -2), fov_y=70.0, near=0.2, far=6.0)


# --- only when asked ------------------------------------------------------------------------------


def test_diagnostics_that_were_not_asked_for_are_named(cube, camera):
    frame = rj.render(cube, camera, size=(16, 8), threads=1)
    with pytest.raises(rj.OutputNotRequestedError, match="diagnose=True"):
        _ = frame.diagnostics
    assert not hasattr(frame, "diagnostics")


def test_without_diagnose_no_kernel_runs_and_no_list_is_kept(cube, camera, monkeypatch):
    def forbidden(*arguments):
        raise AssertionError

    for name in ("count_samples", "find_fates", "find_largest_error"):
        monkeypatch.setattr(diagnostics_stage, name, forbidden)
    kept = []
    run_visibility = visibility_pass.run_visibility

    def watched(*arguments, **options):
        kept.append(run_visibility(*arguments, **options))
        return kept[-1]

    monkeypatch.setattr(visibility_pass, "run_visibility", watched)
    frame = rj.render(cube, camera, size=(16, 8), threads=1)
    assert kept[0].lists is None
    assert "diagnostics" not in frame.stats.seconds
    with pytest.raises(AssertionError):
        rj.render(cube, camera, size=(16, 8), threads=1, diagnose=True)
    assert kept[1].lists is not None


def test_plan_tells_whether_they_are_made(cube, camera):
    for asked, mark in ((False, "out (diagnose=False)"), (np.True_, "in  (diagnose=True)")):
        decided = rj.explain(cube, camera, diagnose=asked)
        assert decided.facts.diagnose is bool(asked)
        line = next(line for line in str(decided).splitlines() if line.startswith("diagnostics"))
        assert line.split(None, 1)[1] == mark


@pytest.mark.parametrize("wrong", ["yes", 1, None])
def test_diagnose_is_true_or_false(cube, camera, wrong):
    for call in (rj.render, rj.explain):
        with pytest.raises(ValueError, match="diagnose"):
            call(cube, camera, size=(8, 8), diagnose=wrong)


def test_diagnosing_changes_no_bit_of_the_frame(soup, eye):
    outputs = [output for output in OUTPUTS if output not in ("uv", "scalar")]
    options = {"outputs": outputs, "previous": rj.PreviousView()}
    plain = rj.render(soup, eye, size=SIZE, threads=1, **options).arrays()
    frame = look(soup, eye, **options)
    for name, array in frame.arrays().items():
        assert array.tobytes() == plain[name].tobytes()
    assert frame.stats.seconds["diagnostics"] > 0.0


def test_a_renderer_makes_them_for_the_frames_that_ask(cube, camera):
    with rj.Renderer((32, 16), threads=1) as renderer:
        asked = renderer.render(cube, camera, diagnose=True)
        assert not hasattr(renderer.render(cube, camera), "diagnostics")
    assert asked.diagnostics == look(cube, camera, size=(32, 16)).diagnostics


# --- what is counted ------------------------------------------------------------------------------


@pytest.mark.parametrize("cull", ["none", "back", "front"])
def test_every_face_has_one_fate(soup, eye, cull):
    frame = look(soup, eye, cull=cull)
    found, stats = frame.diagnostics, frame.stats
    assert sum(fates(found)) == found.faces == 400
    assert found.visible == len(np.unique(frame.face_id[frame.face_id >= 0]))
    assert found.visible + found.hidden <= stats.drawn
    assert found.clipped == stats.clipped > 10
    assert found.pixels_covered == stats.pixels_covered > 1000
    # What the eye cannot see at all is found by whole faces, so the statistics have it as well.
    assert found.invalid == stats.invalid == 2
    assert found.invalid_vertices == 4
    assert found.outside >= stats.outside
    assert found.sub_pixel > 10
    assert (found.culled > 10) == (cull != "none")


def test_samples_and_overdraw_are_those_of_exact_coverage():
    rng = np.random.default_rng(1)
    points = rng.uniform((0, 0), SIZE, (40, 1, 2)) + rng.uniform(-30, 30, (40, 3, 2))
    points = np.round(points * 1024) / 1024
    frame = look(on_screen(points, np.repeat(rng.uniform(-0.9, 0.9, 40), 3)))
    exact = [rj.oracle.covered_pixels(triangle, SIZE) for triangle in points.tolist()]
    found = frame.diagnostics
    assert found.samples == sum(map(len, exact))
    assert found.pixels_covered == len(set.union(*exact))
    assert found.overdraw == found.samples / found.pixels_covered
    assert found.visible + found.hidden == sum(map(bool, exact))


def test_a_sliver_beside_all_centres_is_sub_pixel_though_it_was_drawn():
    between = [(2.6, 2.6), (3.4, 2.6), (2.6, 3.4)]
    sliver = [(2.25, 2), (12.25, 12), (12.375, 12)]
    frame = look(on_screen([between, sliver, [(40, 2), (60, 20), (30, 30)]]))
    assert (frame.stats.unsampled, frame.stats.drawn) == (1, 2)
    assert fates(frame.diagnostics) == (1, 0, 2, 0, 0, 0, 0)


def test_a_face_past_a_corner_is_outside_though_it_was_drawn():
    frame = look(on_screen([(-8, 4), (4, -8), (-8, -8)]))
    assert frame.stats.drawn == 1
    assert fates(frame.diagnostics) == (0, 0, 0, 0, 0, 1, 0)


def test_pixels_where_two_faces_are_equally_near_are_tied():
    points = [(1, 1), (90, 5), (20, 60)]
    frame = look(on_screen([points, points], 0.25))
    found = frame.diagnostics
    assert (frame.face_id != 1).all()
    assert found.tied_pixels == found.pixels_covered == len(rj.oracle.covered_pixels(points, SIZE))
    assert (found.visible, found.hidden) == (1, 1)
    # Faces of one plane that only share an edge have no pixel in common.
    square = on_screen([[(0, 0), (64, 0), (64, 64)], [(0, 0), (64, 64), (0, 64)]])
    assert look(square).diagnostics.tied_pixels == 0


def test_depth_ranges_are_those_of_the_frame(cube, camera):
    frame = look(cube, camera)
    found, seen = frame.diagnostics, frame.depth[frame.face_id >= 0]
    assert found.depth_range == (float(seen.min()), float(seen.max()))
    low, high = found.stored_depth_range
    assert 0.0 < low < high
    ends = np.float32(camera.view_depth(np.float32([high, low])))
    assert tuple(ends.tolist()) == found.depth_range


def test_a_frame_that_shows_nothing_has_no_range(cube):
    found = look(cube, rj.PerspectiveCamera((0, 0, 5), (0, 0, 9))).diagnostics
    assert found.outside == found.faces == 12
    assert found.depth_range is None
    assert found.stored_depth_range is None
    assert found.overdraw == found.interpolation_error == found.attribute_error == 0.0
    assert "none" in str(found)


def test_clipping_costs_precision_and_storing_costs_most(cube, camera):
    whole = look(cube, camera).diagnostics
    near = look(cube, rj.PerspectiveCamera((1.4, 0.2, 1.3), (0, 0, 0), near=0.5)).diagnostics
    assert whole.clipped == 0
    assert whole.interpolation_error == diagnostics_stage.UNCLIPPED_ERROR
    assert near.clipped > 0
    assert near.interpolation_error > whole.interpolation_error
    for found in (whole, near):
        assert found.interpolation_error + 2.0**-24 <= found.attribute_error < 2.0**-23


def test_stored_weights_are_within_the_bound(cube):
    camera = rj.PerspectiveCamera((1.4, 0.2, 1.3), (0, 0, 0), near=0.5)
    size = (24, 16)
    frame = look(cube, camera, size, ("barycentric", "face_id"))
    arrays = packed_scene.join_geometry([cube])
    views = object_transforms.transform_nodes_to_view(
        [rj.Node(cube, np.eye(4), "cube")], camera, size
    )
    clip = visibility_pass.transform_to_clip(
        arrays.positions, arrays.vertex_starts, views.relative_from_model,
        views.clip_from_relative, sharing.Workers(1),
    )  # fmt: skip
    rows, columns = np.nonzero(frame.face_id >= 0)
    worst = 0.0
    for y, x in list(zip(rows.tolist(), columns.tolist(), strict=True))[::3]:
        corners = clip[cube.faces[frame.face_id[y, x]]]
        if (corners[:, 2] >= -corners[:, 3]).all():
            continue
        exact = rj.oracle.clip_weights(corners.tolist(), (x + 0.5, y + 0.5), size)
        for k in range(3):
            worst = max(worst, abs(float(frame.barycentric[y, x, k]) - float(max(exact[k], 0))))
    assert 0.0 < worst <= frame.diagnostics.attribute_error


# --- the same for any threads; how it prints ------------------------------------------------------


def test_threads_and_tasks_change_no_number(soup, eye, monkeypatch):
    expected = look(soup, eye, (200, 150)).diagnostics
    for threads in (2, 8):
        assert look(soup, eye, (200, 150), threads=threads).diagnostics == expected
    monkeypatch.setattr(visibility_pass, "TILES_PER_TASK", 1)
    monkeypatch.setattr(sharing, "MIN_PIXELS_PER_TASK", 3)
    assert look(soup, eye, (200, 150), threads=2).diagnostics == expected


def test_diagnostics_print_as_a_table(soup, eye):
    found = look(soup, eye).diagnostics
    lines = str(found).splitlines()
    assert lines[0].split() == ["faces", "400"]
    assert len({len(line) for line in lines}) == 1
    shown = [int(line.split()[-1].replace(",", "")) for line in lines[1:8]]
    assert shown == list(fates(found))
    assert [name for name, _ in found.rows()] == [
        line[: len(name)] for line, (name, _) in zip(lines, found.rows(), strict=True)
    ]


def test_diagnostics_cannot_be_changed(cube, camera):
    found = look(cube, camera).diagnostics
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.visible = 3
    assert isinstance(found, rj.Diagnostics)
