"""``python -m benchmarks.map``: which cells, who counts in them, what is said of them."""

from __future__ import annotations

import contextlib
import importlib
import itertools
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from opengl import skip_or_fail

sys.path.append(str(Path(__file__).parents[2]))
cells = importlib.import_module("benchmarks.map.cells")
command = importlib.import_module("benchmarks.map.__main__")
contestants = importlib.import_module("benchmarks.contestants")
families = importlib.import_module("benchmarks.map.families")
instructions = importlib.import_module("benchmarks.instructions")
marks = importlib.import_module("benchmarks.map.marks")
pairing = importlib.import_module("benchmarks.pairing")
picture = importlib.import_module("benchmarks.map.picture")
report = importlib.import_module("benchmarks.report")
screen = importlib.import_module("benchmarks.contestants.screen")
turns = importlib.import_module("benchmarks.map.turns")
worker = importlib.import_module("benchmarks.map.worker")

Cell, Measured, Run = cells.Cell, cells.Measured, cells.Run
STAGES = {"plan": 0.2, "transform": 0.1, "visibility": 0.5, "compile": 9.0}


def cell_of(faces=70_000, size=(1280, 720), look="colors", family="knot"):
    return Cell(family, faces, look, size)


def measured(cell, own=1.0, llvmpipe=None, tinydisplay=None, batch=None, **more):
    """Return a cell in which contestants take so many milliseconds with one thread."""
    runs = [Run(cells.OWN, 1, "native", ms=[own] * 3, stages=dict(STAGES), **more)]
    if batch is not None:
        runs[0].batch_ms = [batch] * 3
    for key, ms in ((cells.LLVMPIPE, llvmpipe), (cells.TINYDISPLAY, tinydisplay)):
        missing = "cannot draw" if ms is None else None
        name = "" if key == cells.TINYDISPLAY else "native"
        runs.append(Run(key, 1, name, missing, [] if ms is None else [ms] * 3))
    return Measured(cell, runs)


def found_marks(*each):
    return {mark.name: mark for mark in marks.marks_of(each, "native")}


# Which cells.


def test_the_whole_map_has_every_size_number_of_faces_look_and_family_once():
    found = command.choose((), (), (), ())
    assert len(found) == len(set(found)) == 6 * 7 * 3 * 3 + 1
    assert found[-1] == cells.SLIVERS
    assert {cell.size for cell in found} == set(cells.SIZES)


def test_cells_of_one_mesh_follow_each_other():
    meshes = [cell[:2] for cell in command.choose((), (), (), ())]
    changes = sum(one != other for one, other in itertools.pairwise(meshes))
    assert changes == len(set(meshes)) - 1


def test_a_part_of_the_map_is_what_is_asked_for():
    found = command.choose(("64", "32x16"), (200,), ("phong",), ("boxes",))
    assert found == [Cell("boxes", 200, "phong", size) for size in ((64, 64), (32, 16))]
    assert command.choose(("64",), (200,), ("phong",), ("slivers",)) == [cells.SLIVERS]


def test_tinydisplay_takes_part_once_and_the_others_with_all_threads_and_instructions():
    found = turns.seats((1, 2), ("native", "avx2"))
    assert len(found) == len(set(found)) == 2 * 2 * 2 + 1
    assert [seat for seat in found if seat.contestant == cells.TINYDISPLAY] == [
        turns.Seat(cells.TINYDISPLAY, 1, "")
    ]


# What is drawn.


@pytest.mark.parametrize("family", cells.FAMILIES)
def test_families_hold_about_as_many_faces_as_asked_for(family):
    for count in cells.FACES[1:5]:
        mesh = families.FAMILIES[family](count)
        assert len(mesh.faces) == pytest.approx(count, rel=0.05)
        assert mesh.faces.max() < len(mesh.positions)
        assert len(mesh.colors) == len(mesh.uv) == len(mesh.normals) == len(mesh.positions)
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)


@pytest.mark.parametrize("family", cells.FAMILIES)
def test_faces_are_counter_clockwise_on_the_side_of_their_normals(family):
    """Else a face lit from its front is dark."""
    mesh = families.FAMILIES[family](5_000)
    a, b, c = np.moveaxis(mesh.positions[mesh.faces].astype(float), 1, 0)
    across = np.cross(b - a, c - a)
    turned = np.einsum("fi,fi->f", across, mesh.normals[mesh.faces].mean(axis=1))
    assert (turned > 0.0).mean() > 0.99


@pytest.mark.parametrize("family", cells.FAMILIES)
def test_cameras_see_a_good_part_of_a_picture_covered_and_differ(family):
    shown = []
    prepared = contestants.contestant("rasterjit").prepare(
        families.make_scene(family, 1_000, "colors", (64, 64)), 1
    )
    for view in range(families.VIEWS):
        prepared.draw_view(view)
        shown.append(prepared.picture()["covered"])
        assert 0.2 < shown[-1].mean() < 0.9
    assert all((one != other).any() for one, other in itertools.pairwise(shown))
    assert prepared.stages()["visibility"] > 0.0
    prepared.close()


def test_the_eye_of_a_camera_is_where_it_was_put():
    views = families.geometry("terrain", 200).views
    for view in views:
        clip = families.perspective(50.0, 1.5, 0.1, 40.0) @ view
        eye = -view[:3, :3].T @ view[:3, 3]
        np.testing.assert_allclose(screen.eye_of(clip), eye, atol=1e-9)
    assert not screen.eye_of(np.eye(4)).any()


def test_only_those_who_say_so_are_given_textures():
    scene = families.make_scene("knot", 200, "texture", (64, 64))
    draws = {key for key in contestants.MODULES if contestants.contestant(key).draws(scene) is None}
    assert draws == {"rasterjit", "opengl", "tinydisplay"}


def test_tinydisplay_is_left_out_of_phong():
    scene = families.make_scene("knot", 200, "phong", (64, 64))
    assert contestants.contestant("tinydisplay").draws(scene) == "no per-pixel lighting"


# What is measured.


class FakeParticipant:
    """Takes so many seconds for a picture, and shows the same each time."""

    def __init__(self, key, seconds, threads=1, shown=None, unable=None):
        self.seat = turns.Seat(key, threads, "native")
        self.asked, self._seconds, self._unable = [], seconds, unable
        self._shown = np.eye(8, dtype=bool) if shown is None else shown

    def tell(self, task, asked):
        pass

    def answer(self, seconds):
        return {"seconds": self._seconds} if self._unable is None else {"unable": self._unable}

    def ask(self, task, asked):
        if self._seconds is None:
            raise pairing.WorkerError("ended with status 1")
        if task == "batch":
            return {"seconds": asked * self._seconds / 4.0}
        self.asked.append(asked[0])
        return {
            "seconds": [self._seconds] * asked[1],
            "processor": 2.0 * self._seconds * asked[1],
            "stages": {"plan": self._seconds * asked[1]},
        }

    def picture(self, view):
        return {"covered": self._shown}


def test_all_draw_the_same_views_in_turns_and_times_are_those_of_a_picture():
    own, peer = FakeParticipant("rasterjit", 0.002), FakeParticipant("opengl", 0.004)
    one, other = turns.measure(cell_of(), [own, peer], 1.0).runs
    assert own.asked == peer.asked
    assert len(set(own.asked)) > 1
    assert len(one.ms) == len(other.ms) == turns.MOST_ROUNDS
    assert one.ms[0] == pytest.approx(2.0)
    assert one.cpu_ms[0] == pytest.approx(4.0)
    assert one.stages["plan"] == pytest.approx(2.0)
    assert one.batch_ms == []


def test_where_the_faster_peer_is_quick_views_are_drawn_together_as_well():
    own, peer = FakeParticipant("rasterjit", 0.002), FakeParticipant("opengl", 0.0005)
    run, _ = turns.measure(cell_of(), [own, peer], 1.0).runs
    assert run.batch_ms == [pytest.approx(0.5)] * turns.BATCH_ROUNDS


@pytest.mark.parametrize("seconds", [1e-5, 1e-2, 10.0])
def test_rounds_are_bounded_below_and_above(seconds):
    rounds, count = turns.plan({0: seconds, 1: seconds / 3.0}, 2.0)
    assert turns.LEAST_ROUNDS <= rounds <= turns.MOST_ROUNDS
    assert 1 <= count <= families.VIEWS
    assert (count > 1) == (seconds < turns.TURN_SECONDS)


def test_who_cannot_draw_or_fails_leaves_the_others_their_times():
    present = [
        FakeParticipant("rasterjit", 0.01),
        FakeParticipant("opengl", None),
        FakeParticipant("tinydisplay", 0.01, unable="no per-pixel lighting"),
    ]
    runs = turns.measure(cell_of(), present, 0.1).runs
    assert [run.missing for run in runs] == [
        None, "failed: ended with status 1", "no per-pixel lighting",
    ]  # fmt: skip
    assert [bool(run.ms) for run in runs] == [True, False, False]


@pytest.mark.parametrize(
    ("key", "threads", "lost"),
    [
        ("opengl", 1, [True, True, False, True]),
        ("tinydisplay", 1, [False, False, True, False]),
        ("rasterjit", 2, [False, False, False, True]),
    ],
)
def test_a_wrong_picture_costs_its_times_and_if_opengls_those_of_rasterjit(key, threads, lost):
    wrong = np.zeros((8, 8), bool)
    places = [("rasterjit", 1), ("opengl", 1), ("tinydisplay", 1), ("rasterjit", 2)]
    present = [
        FakeParticipant(name, 0.01, count, wrong if (name, count) == (key, threads) else None)
        for name, count in places
    ]
    found = turns.measure(cell_of(), present, 0.1)
    assert [run.missing is not None for run in found.runs] == lost
    assert len(command.pictures_that_differ([found])) == sum(lost)


def test_the_process_draws_scene_after_scene_and_reads_views_back(tmp_path):
    holder = worker.Holder("rasterjit", 1, str(tmp_path / "0.npz"))
    for size in ((32, 32), (48, 16)):
        assert holder.prepare("boxes", 200, "texture", list(size))["seconds"] > 0.0
        done = holder.draw(families.VIEWS - 1, 3, warm=True)
        assert len(done["seconds"]) == 3
        assert 0.0 < sum(done["stages"].values()) < sum(done["seconds"])
        holder.picture(1)
        with np.load(tmp_path / "0.npz") as shown:
            assert shown["covered"].shape == size[::-1]
            assert shown["covered"].any()


@pytest.mark.takes_long
@pytest.mark.parametrize("look", cells.LOOKS)
def test_all_draw_the_same_pictures_in_processes_of_their_own(look):
    for key in ("opengl", "tinydisplay"):
        reason = contestants.contestant(key).available()
        if reason is not None:
            (skip_or_fail if key == "opengl" else pytest.skip)(reason)
    names = [name for name in instructions.SETS if instructions.missing(name) is None]
    missing = []
    with turns.participants(turns.seats((1, 2), names), missing.append) as present:
        for family in cells.FAMILIES:
            found = turns.measure(Cell(family, 1_000, look, (128, 128)), present, 0.1)
            for run in found.runs:
                cannot = run.contestant == cells.TINYDISPLAY and look == "phong"
                assert (run.missing is None) != cannot, (family, run)
                assert len(run.ms) == (0 if cannot else len(found.runs[0].ms))
    assert missing == []


# What is said of it.


def test_the_ratio_is_to_the_faster_peer_that_draws_the_look():
    both = marks.judge(measured(cell_of(), 2.0, 6.0, 3.0), 1, "native")
    assert (both.ratio, both.faster_ms) == (1.5, 3.0)
    alone = marks.judge(measured(cell_of(look="phong"), 2.0, 6.0), 1, "native")
    assert (alone.ratio, alone.faster_ms) == (3.0, 6.0)
    assert cells.TINYDISPLAY not in alone.ratios
    assert marks.judge(measured(cell_of()), 1, "native") is None


def test_tinydisplay_counts_with_any_threads_and_llvmpipe_with_its_own():
    found = measured(cell_of(), 2.0, 6.0, 3.0)
    found.runs.append(Run(cells.OWN, 2, "native", ms=[1.0], stages=dict(STAGES)))
    assert marks.judge(found, 2, "native").ratios == {cells.TINYDISPLAY: 3.0}
    found.runs.append(Run(cells.LLVMPIPE, 2, "native", ms=[2.5]))
    assert marks.judge(found, 2, "native").ratio == 2.5
    assert marks.judge(found, 2, "avx2") is None


def test_marks_hold_where_every_cell_reaches_them():
    held = found_marks(
        measured(cell_of(), 2.0, 6.0, 3.0), measured(cell_of(look="phong"), 2.0, 5.0)
    )
    assert held["70 k faces, 1280×720, to llvmpipe"].verdict == marks.HELD
    assert held["70 k faces, 1280×720, to llvmpipe"].found == "2.50"
    assert held["70 k faces, 1280×720, to tinydisplay"].verdict == marks.HELD
    assert held["median, to llvmpipe"].found == "2.75"
    assert held["every cell, to the faster"].verdict == marks.HELD
    assert held["1 M faces, to llvmpipe"].verdict == marks.NOTHING


def test_marks_fall_short_by_their_worst_cell_and_name_it():
    slow = cell_of(family="terrain")
    short = found_marks(measured(cell_of(), 2.0, 6.0, 3.0), measured(slow, 2.0, 4.0, 1.8))
    mark = short["70 k faces, 1280×720, to llvmpipe"]
    assert (mark.verdict, mark.found) == (marks.SHORT, "2.00")
    assert mark.where == f"{slow}; below in 1 of 2"
    assert short["every cell, to the faster"].found == "0.90"
    assert short["every cell, to the faster"].verdict == marks.SHORT


@pytest.mark.parametrize(("batch", "verdict"), [(0.2, marks.HELD), (0.6, marks.SHORT)])
def test_cells_that_take_the_faster_peer_under_a_millisecond_are_judged_apart(batch, verdict):
    small = cell_of(5_000, (128, 128))
    found = found_marks(measured(small, 0.7, 0.9, 0.5, batch), measured(cell_of(), 2.0, 6.0, 3.0))
    assert found["every cell, to the faster"].verdict == marks.HELD
    assert found["median, to tinydisplay"].found == "1.50"
    assert found["under 1 ms: render_batch, to the faster"].verdict == verdict
    assert found["5 k faces, 128², to tinydisplay"].verdict == verdict
    # 0.7 ms less 0.1 and 0.5 in stages; planning is overhead, compiling is no part of a picture.
    assert found["under 1 ms: overhead, ms"].found == "0.10"
    assert found["under 1 ms: overhead, ms"].verdict == marks.HELD


def test_overhead_falls_short_above_015_ms():
    small = measured(cell_of(200, (64, 64)), 0.8, 0.9, 0.5)
    assert found_marks(small)["under 1 ms: overhead, ms"].verdict == marks.SHORT
    assert found_marks(small)["under 1 ms: render_batch, to the faster"].verdict == marks.NOTHING


@pytest.mark.parametrize(
    ("faces", "size", "two", "verdict"),
    [
        (20_000, (512, 512), 0.5, marks.HELD),
        (20_000, (512, 512), 0.9, marks.SHORT),
        (5_000, (512, 512), 0.9, marks.NOTHING),
        (20_000, (256, 256), 0.9, marks.NOTHING),
    ],
)
def test_two_threads_are_judged_from_512_and_20_k_faces_on(faces, size, two, verdict):
    found = measured(cell_of(faces, size), 1.0, 6.0)
    found.runs.append(Run(cells.OWN, 2, "native", ms=[two] * 3))
    assert marks.scaling([found], 2, "native").verdict == verdict


def test_the_worst_cells_are_the_lowest_ratios_of_the_map():
    found = [measured(cell_of(count), 1.0, 1.0 + count) for count in (9, 3, 7, 5, 1, 8)]
    found.append(measured(cell_of(2), 1.0, 0.9))
    found.append(measured(cells.SLIVERS, 9.0, 1.1))
    lowest = marks.worst(marks.verdicts(found, 1, "native"))
    assert [verdict.cell.faces for verdict in lowest] == [1, 3, 5, 7, 8]
    row = command.worst_row(lowest[0])
    assert row[:3] == ["1 knot colors 1280×720", "2.00", "1.00"]
    assert row[-1] == "visibility 0.50, transform 0.10, the rest 0.40 (plan 0.20)"


def test_rounds_of_a_cell_measured_again_count_with_those_before():
    found, again = measured(cell_of(), 2.0, 6.0), measured(cell_of(), 1.0, 9.0)
    for run in again.runs:
        run.ms *= 2
        run.stages = {name: 2.5 * ms for name, ms in run.stages.items()}
    found.add(again)
    verdict = marks.judge(found, 1, "native")
    assert verdict.own.ms == [2.0] * 3 + [1.0] * 6
    assert verdict.ratio == 9.0
    assert verdict.own.stages["visibility"] == pytest.approx(0.5 / 3 + 1.25 * 2 / 3)
    again.runs[1].missing = "the picture differs"
    found.add(again)
    assert marks.judge(found, 1, "native") is None


def test_the_lowest_cells_of_each_panel_are_measured_again(monkeypatch):
    monkeypatch.setattr(command, "AGAIN", 2)
    found = [measured(cell_of(count), 1.0, 1.0 + count) for count in (5, 1, 4, 2, 3)]
    panels = [("AVX-512, 1 thread", 1, "native"), ("AVX2, 1 thread", 1, "avx2")]
    assert [each.cell.faces for each in command.lowest(found, panels)] == [1, 2]


def test_a_cell_of_the_picture_shows_its_worst_and_median_family():
    pytest.importorskip("matplotlib")
    hues = lambda share: (share,) * 4  # noqa: E731
    here = [
        marks.judge(measured(cell_of(family=family), 2.0, ms), 1, "native")
        for family, ms in (("knot", 5.0), ("boxes", 1.999), ("terrain", 8.0))
    ]
    number, middle, color = picture.describe(here, hues)
    assert (number, middle) == ("0.99", "2.5")
    assert color[0] < 0.5
    small = [marks.judge(measured(cell_of(), 0.8, 0.9), 1, "native")]
    assert picture.describe(small, hues)[:2] == ("+0.20", "ms")
    many = [marks.judge(measured(cell_of(), 0.8, 0.9, batch=0.3), 1, "native"), *small]
    assert picture.describe(many, hues)[:2] == ("+0.20", "together 3.0")
    assert picture.describe([], hues) == ("", "", None)


def test_maps_are_drawn_and_marks_printed_from_a_file(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(picture, "DOTS_PER_INCH", 10)
    content = {
        "machine": {"processor": "a processor", "processors": "2"},
        "instructions": {"native": "AVX2"},
        "left_out": {"avx2": "this CPU has no AVX-512"},
        "threads": [1],
        "cells": [
            command.written(measured(cell_of(), 2.0, 6.0, 3.0)),
            command.written(measured(cell_of(look="phong"), 2.0, 6.0)),
        ],
    }
    path = tmp_path / "map.json"
    path.write_text(json.dumps(content))
    arguments = ["--draw", "--results", str(path), "--to", str(tmp_path)]
    done = CliRunner().invoke(command.main, arguments)
    assert done.exit_code == 0, done.output
    assert "this CPU has no AVX-512" in done.output
    assert "median, to llvmpipe" in done.output
    assert sorted(found.name for found in tmp_path.glob("*.png")) == [
        "map_colors.png", "map_phong.png",
    ]  # fmt: skip
    content["cells"][0]["runs"][0]["missing"] = "the picture differs: covered 1.000%"
    path.write_text(json.dumps(content))
    done = CliRunner().invoke(command.main, arguments)
    assert done.exit_code == 1
    assert "70 k knot colors 1280×720, rasterjit, 1 thread, native" in done.output
    path.unlink()
    assert CliRunner().invoke(command.main, arguments).exit_code == 1


@pytest.mark.parametrize("has_avx512", [True, False])
def test_a_machine_without_avx512_leaves_the_other_map_out_and_says_so(
    monkeypatch, tmp_path, has_avx512
):
    features = {"avx2": True, "avx512f": has_avx512}
    monkeypatch.setattr(instructions, "features", lambda: features)
    monkeypatch.setattr(command, "participants", lambda seats, say: contextlib.nullcontext(seats))
    monkeypatch.setattr(command, "measure", lambda cell, present, seconds: measured(cell, 2.0, 6.0))
    monkeypatch.setattr(report, "machine", dict)
    monkeypatch.setattr(command, "AGAIN", 0)
    path = tmp_path / "map.json"
    content = command.measure_all([cell_of()], [1], instructions.SETS, 1.0, path)
    assert json.loads(path.read_text()) == content
    if has_avx512:
        assert content["instructions"] == {"native": "AVX-512", "avx2": "AVX2"}
        assert content["left_out"] == {}
    else:
        assert content["instructions"] == {"native": "AVX2"}
        assert "no AVX-512" in content["left_out"]["avx2"]
    assert command.read(content)[0].cell == cell_of()
