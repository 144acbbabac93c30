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
schedule = importlib.import_module("benchmarks.map.schedule")
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
    assert found[0] == cells.SLIVERS
    assert {cell.size for cell in found} == set(cells.SIZES)


def test_cells_of_one_mesh_follow_each_other():
    meshes = [cell[:2] for cell in command.choose((), (), (), ())]
    changes = sum(one != other for one, other in itertools.pairwise(meshes))
    assert changes == len(set(meshes)) - 1


def test_a_part_of_the_map_is_what_is_asked_for():
    found = command.choose(((64, 64), (32, 16), (64, 64)), (200,), ("phong",), ("boxes",))
    assert found == [Cell("boxes", 200, "phong", size) for size in ((64, 64), (32, 16))]
    assert command.choose(((64, 64),), (200,), ("phong",), ("slivers",)) == [cells.SLIVERS]


@pytest.mark.parametrize(("text", "size"), [("64", (64, 64)), (" 1280X720", (1280, 720))])
def test_a_size_is_a_side_or_two(text, size):
    assert command.Size().convert(text, None, None) == size


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--sizes", "large"], ["--sizes", "'large' is no size", "1280x720"]),
        (["--sizes", "1x2x3"], ["--sizes", "'1x2x3' is no size"]),
        (["--sizes", "64.5"], ["--sizes", "'64.5' is no size"]),
        (["--sizes", "-64"], ["--sizes", "'-64' is no size"]),
        (["--sizes", "0x64"], ["--sizes", "'0x64' is out of range", "1 to 8192"]),
        (["--sizes", "64x8193"], ["--sizes", "'64x8193' is out of range", "1 to 8192"]),
        (["--faces", "11"], ["--faces", "11", "12<=x<="]),
        (["--faces", "100000000000"], ["--faces", "12<=x<="]),
        (["--looks", "pbr"], ["--looks", "'pbr'", "phong"]),
        (["--families", "cubes"], ["--families", "'cubes'", "slivers"]),
        (["--threads", "0"], ["--threads", "0"]),
        (["--instructions", "sse"], ["--instructions", "'sse'", "avx2"]),
        (["--seconds", "0"], ["--seconds", "0"]),
        (["--seconds", "nan"], ["--seconds", "nan"]),
        (["--minutes", "-1"], ["--minutes", "-1"]),
        (["--draw", "--sizes", "64"], ["--draw measures nothing", "--sizes"]),
        (["--draw", "--resume"], ["--draw measures nothing", "--resume"]),
        (["--results", "."], ["--results", "directory"]),
        (["64"], ["64"]),
    ],
)
def test_wrong_options_are_refused_by_name_before_anything_is_measured(
    monkeypatch, arguments, words
):
    monkeypatch.setattr(command, "measure_all", lambda *given: pytest.fail("it measured"))
    done = CliRunner().invoke(command.main, arguments)
    assert done.exit_code == 2, done.output
    assert all(word in done.output for word in words), done.output


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"cells": [{"family": "knot"}]}', "{", "\x00"])
def test_a_file_that_is_no_file_of_results_is_named(tmp_path, text):
    path = tmp_path / "map.json"
    path.write_text(text)
    done = CliRunner().invoke(command.main, ["--draw", "--results", str(path)])
    assert done.exit_code == 1
    assert "map.json is no file of results" in done.output.replace("\n", "")


def test_options_reach_what_is_measured(monkeypatch, tmp_path):
    given = []
    monkeypatch.setattr(command, "measure_all", lambda *all_: given.extend(all_) or {"cells": []})
    monkeypatch.setattr(command, "show", lambda content, folder: None)
    path = str(tmp_path / "map.json")
    arguments = ["--sizes", "64", "--faces", "200", "--looks", "phong", "--families", "boxes"]
    arguments += ["--threads", "2", "--threads", "1", "--instructions", "avx2", "--seconds", "3"]
    done = CliRunner().invoke(
        command.main, [*arguments, "--minutes", "0.5", "--results", path, "--resume"]
    )
    assert done.exit_code == 0, done.output
    cell = Cell("boxes", 200, "phong", (64, 64))
    assert given == [[cell], [1, 2], ["avx2"], 3.0, 30.0, Path(path), True]


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
    # Small frames run as one call from the third on.
    assert prepared.stages()["all stages"] > 0.0
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
        self._shown = {"covered": np.eye(8, dtype=bool)} if shown is None else shown

    def tell(self, task, asked):
        pass

    def answer(self, seconds):
        return (
            {"seconds": self._seconds or 0.0} if self._unable is None else {"unable": self._unable}
        )

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

    def picture(self):
        return self._shown

    def close(self):
        pass


def test_all_draw_the_same_views_in_turns_and_times_are_those_of_a_picture():
    own, peer = FakeParticipant("rasterjit", 0.002), FakeParticipant("opengl", 0.004)
    one, other = turns.measure(cell_of(), [own, peer], 1.0).runs
    assert own.asked == peer.asked
    assert len(set(own.asked)) > 1
    assert len(one.ms) == len(other.ms) == turns.MAX_ROUNDS
    assert one.ms[0] == pytest.approx(2.0)
    assert one.cpu_ms[0] == pytest.approx(4.0)
    assert one.stages["plan"] == pytest.approx(2.0)
    assert one.batch_ms == []


def test_where_the_faster_peer_is_quick_views_are_drawn_together_as_well():
    own, peer = FakeParticipant("rasterjit", 0.002), FakeParticipant("opengl", 0.0005)
    run, _ = turns.measure(cell_of(), [own, peer], 1.0).runs
    assert run.batch_ms == [pytest.approx(0.5)] * len(run.ms)


@pytest.mark.parametrize(
    ("size", "views"),
    [((64, 64), 128), ((256, 256), 128), ((512, 512), 32), ((1280, 720), 9), ((8192, 8192), 8)],
)
def test_views_drawn_together_are_fewer_where_their_pictures_take_much_memory(size, views):
    assert turns.batch_views(size) == views


def test_views_drawn_together_are_written_to_the_arrays_of_those_before():
    scene = families.make_scene("boxes", 200, "colors", (32, 16))
    prepared = contestants.contestant("rasterjit").prepare(scene, 1)
    prepared.draw_batch([0, 1])
    first = prepared._together["color"]
    kept = first.copy()
    prepared.draw_batch([1, 0])
    assert prepared._together["color"] is first
    np.testing.assert_array_equal(first, kept[::-1])
    assert (kept[0] != kept[1]).any()
    prepared.draw_batch([0, 1, 0])
    np.testing.assert_array_equal(prepared._together["color"], kept[[0, 1, 0]])
    prepared.close()


@pytest.mark.parametrize(
    ("took", "seconds", "end", "rounds"),
    [
        (0.125, 0.625, 9.0, 5),
        (0.125, 9.0, 0.625, 5),
        (0.125, 9.0, 9.0, turns.MAX_ROUNDS),
        (2.0, 0.5, 99.0, turns.MIN_ROUNDS),
        (2.0, 0.5, 3.0, 2),
        (2.0, 9.0, 0.0, turns.FEWEST_ROUNDS),
    ],
)
def test_there_are_as_many_rounds_as_fit_three_unless_the_cells_time_is_up(
    monkeypatch, took, seconds, end, rounds
):
    now = [0.0]
    present = [FakeParticipant("rasterjit", 1.0), FakeParticipant("opengl", 1.0)]
    draw = FakeParticipant.ask

    def ask(who, task, asked):
        now[0] += took / 2.0
        return draw(who, task, asked)

    monkeypatch.setattr(turns.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(FakeParticipant, "ask", ask)
    found = turns.measure(cell_of(), present, seconds, end)
    assert [len(run.ms) for run in found.runs] == [rounds, rounds]


def test_who_ends_in_a_cell_is_started_anew_for_the_next(tmp_path):
    """Each process stays from cell to cell, so that what ends one must not cost all that follow."""
    who = turns.Participant(turns.Seat("rasterjit", 1, "native"), tmp_path, 0)
    small = Cell("boxes", 200, "colors", (32, 32))
    try:
        lost = turns.measure(Cell("nothing", 200, "colors", (32, 32)), [who], 0.01)
        assert "nothing" in lost.runs[0].missing
        assert turns.measure(small, [who], 0.01).runs[0].ms
        who.tell("draw", ["no number", 1, False])
        with pytest.raises(pairing.WorkerError):
            who.answer()
        assert turns.measure(small, [who], 0.01).runs[0].ms
    finally:
        who.close()


def test_who_ends_again_and_again_is_left_out(monkeypatch, tmp_path):
    started = []

    class Ends:
        is_alive = False

        def __init__(self, *given):
            started.append(given)

        def tell(self, line):
            pass

        def answer(self, seconds):
            raise pairing.WorkerError("ended with status 1")

        def close(self):
            pass

    monkeypatch.setattr(turns, "Worker", Ends)
    who = turns.Participant(turns.Seat("opengl", 1, "native"), tmp_path, 0)
    found = [turns.measure(cell_of(), [who], 1.0).runs[0] for _ in range(turns.MAX_STARTS + 5)]
    assert len(started) == turns.MAX_STARTS
    assert found[0].missing == "failed: ended with status 1"
    assert found[-1].missing == f"failed: ended {turns.MAX_STARTS} times"


def test_what_goes_wrong_in_a_cell_costs_that_cell_alone(monkeypatch):
    present, closed = [FakeParticipant("rasterjit", 0.01), FakeParticipant("opengl", 0.01)], []
    monkeypatch.setattr(FakeParticipant, "close", lambda who: closed.append(who))
    monkeypatch.setattr(FakeParticipant, "picture", lambda who: 1 // 0)
    found = turns.measure_safely(cell_of(), present, 0.01)
    assert {run.missing for run in found.runs} == {
        "failed: ZeroDivisionError: integer division or modulo by zero"
    }
    assert [run.seat for run in found.runs] == [("rasterjit", 1, "native"), ("opengl", 1, "native")]
    assert closed == present


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
    wrong = {"covered": np.zeros((8, 8), bool)}
    places = [("rasterjit", 1), ("opengl", 1), ("tinydisplay", 1), ("rasterjit", 2)]
    present = [
        FakeParticipant(name, 0.01, count, wrong if (name, count) == (key, threads) else None)
        for name, count in places
    ]
    found = turns.measure(cell_of(), present, 0.1)
    assert [run.missing is not None for run in found.runs] == lost
    assert len(command.pictures_that_differ([found])) == sum(lost)


def test_rasterjits_pictures_must_have_the_same_bits_and_others_nearly_the_same_colours():
    pictures = []
    for code in (100, 100, 101):
        codes = np.full((8, 8, 4), code, np.uint8)
        pictures.append({"covered": np.ones((8, 8), bool), "color": codes})
        pictures[-1]["color_linear"] = codes[:, :, :3]
    present = [
        FakeParticipant("rasterjit", 0.01, 1, pictures[0]),
        FakeParticipant("rasterjit", 0.01, 2, pictures[1]),
        FakeParticipant("rasterjit", 0.01, 3, pictures[2]),
        FakeParticipant("opengl", 0.01, 1, dict(list(pictures[2].items())[::2])),
    ]
    runs = turns.measure(cell_of(), present, 0.01).runs
    assert [run.missing is None for run in runs] == [True, True, False, True]
    assert "bits 0.000%" in runs[2].missing


def test_bits_of_pictures_are_compared_between_threads(tmp_path):
    prepared = contestants.contestant("rasterjit").prepare(
        families.make_scene("boxes", 200, "colors", (32, 32)), 1
    )
    shown = prepared.picture()
    assert shown["color"].shape == (32, 32, 4)
    prepared.close()


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
@pytest.mark.parametrize("look", cells.TITLES)
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


def test_who_is_not_there_when_a_cell_is_measured_again_keeps_its_rounds():
    found, again = measured(cell_of(), 2.0, 6.0, 3.0), measured(cell_of(), 1.0, 9.0, 3.0)
    del again.runs[1]
    found.add(again)
    assert [len(run.ms) for run in found.runs] == [6, 3, 6]


def test_the_lowest_cells_of_each_panel_are_measured_again(monkeypatch):
    monkeypatch.setattr(command, "AGAIN", 2)
    found = [measured(cell_of(count), 1.0, 1.0 + count) for count in (5, 1, 4, 2, 3)]
    panels = [("AVX-512, 1 thread", 1, "native"), ("AVX2, 1 thread", 1, "avx2")]
    assert [each.cell.faces for each in command.lowest(found, panels)] == [1, 2]


class Clock:
    """Seconds that pass when told to."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def test_time_is_shared_out_by_what_cells_need_and_what_one_leaves_goes_to_the_others():
    small, large = cell_of(200, (64, 64)), cell_of(1_000_000, (1920, 1080))
    clock = Clock()
    plan = schedule.Schedule([small, large, small], 100.0, clock)
    ends = []
    for cell in (small, large, small):
        ends.append(plan.next_end(cell) - clock.now)
        clock.now += ends[-1]
    first = 100.0 * (1.0 - schedule.AGAIN_SHARE)
    assert sum(ends) == pytest.approx(first)
    assert ends[0] == pytest.approx(ends[2])
    assert ends[1] > 5.0 * ends[0]
    assert plan.is_over
    assert plan.has(100.0 - first)
    assert not plan.has(101.0 - first)

    clock = Clock()
    plan = schedule.Schedule([small, small], 100.0, clock)
    plan.next_end(small)
    assert plan.next_end(small) == pytest.approx(clock.now + first)
    clock.now += 200.0
    assert plan.is_over
    assert plan.passed == 200.0


def test_the_whole_map_gets_what_it_needs_of_its_minutes():
    """The smallest cell can be drawn some rounds, the largest one three, on two quiet cores."""
    wanted = command.choose((), (), (), ())
    plan = schedule.Schedule(wanted, 60.0 * command.MINUTES, Clock())
    first = 60.0 * command.MINUTES * (1.0 - schedule.AGAIN_SHARE)
    unit = first / sum(map(schedule.weight, wanted))
    assert plan.next_end(wanted[0]) - 100.0 == pytest.approx(unit * schedule.weight(wanted[0]))
    assert unit > 0.9
    assert unit * schedule.weight(cell_of(1_000_000, (1920, 1080))) > 6.0


@pytest.fixture
def quick(monkeypatch):
    """Measure nothing, in no time; return the cells that were asked for."""
    asked = []

    def measure(cell, present, seconds, end):
        asked.append(cell)
        return measured(cell, 2.0, 6.0)

    monkeypatch.setattr(command, "participants", lambda seats, say: contextlib.nullcontext(seats))
    monkeypatch.setattr(command, "measure_safely", measure)
    monkeypatch.setattr(command, "warm_up", lambda names: None)
    monkeypatch.setattr(report, "machine", lambda: {"processor": "a processor"})
    monkeypatch.setattr(command, "commit", lambda: "1234567890")
    monkeypatch.setattr(command, "AGAIN", 0)
    return asked


def test_cells_that_no_time_is_left_for_are_named_and_a_resumed_run_measures_them(
    monkeypatch, quick, tmp_path
):
    wanted = [cell_of(count) for count in (200, 1_000, 5_000)]
    path = tmp_path / "map.json"
    overs = iter([False, True])
    monkeypatch.setattr(
        schedule.Schedule, "is_over", property(lambda plan: next(overs, False)), raising=True
    )
    content = command.measure_all(wanted, [1], ["native"], 1.0, 60.0, path)
    assert quick == wanted[:1]
    assert content["not_reached"] == list(map(str, wanted[1:]))
    assert json.loads(path.read_text()) == content
    content = command.measure_all(wanted, [1], ["native"], 1.0, 60.0, path, resume=True)
    assert quick == wanted
    assert content["not_reached"] == []
    assert [each.cell for each in command.read(content)] == wanted


def test_a_run_that_is_cut_off_leaves_what_it_measured(monkeypatch, quick, tmp_path):
    wanted, path = [cell_of(count) for count in (200, 1_000)], tmp_path / "map.json"
    done = command.measure_safely

    def cut_off(cell, *given):
        if quick:
            raise KeyboardInterrupt
        return done(cell, *given)

    monkeypatch.setattr(command, "measure_safely", cut_off)
    with pytest.raises(KeyboardInterrupt):
        command.measure_all(wanted, [1], ["native"], 1.0, 60.0, path)
    assert [each.cell for each in command.read(json.loads(path.read_text()))] == wanted[:1]


def test_cells_in_which_something_failed_are_measured_by_a_resumed_run(
    monkeypatch, quick, tmp_path
):
    path = tmp_path / "map.json"
    wanted = [cell_of(200), cell_of(1_000)]
    content = command.measure_all(wanted, [1], ["native"], 1.0, 60.0, path)
    content["cells"][0]["runs"][1]["missing"] = "failed: ended with status 1"
    path.write_text(json.dumps(content))
    command.measure_all(wanted, [1], ["native"], 1.0, 60.0, path, resume=True)
    assert quick == [*wanted, wanted[0]]


@pytest.mark.parametrize(
    ("name", "value"), [("commit", "0987654321"), ("threads", [1, 2]), ("processor", "another")]
)
def test_a_run_does_not_go_on_with_what_is_of_another_commit_or_machine(
    quick, tmp_path, name, value
):
    path = tmp_path / "map.json"
    content = command.measure_all([cell_of()], [1], ["native"], 1.0, 60.0, path)
    content["machine" if name == "processor" else name] = (
        {"processor": value} if name == "processor" else value
    )
    path.write_text(json.dumps(content))
    with pytest.raises(command.click.ClickException, match=f"--resume.*{name}"):
        command.measure_all([cell_of()], [1], ["native"], 1.0, 60.0, path, resume=True)


def test_kernels_are_compiled_for_each_set_of_instructions_before_the_clock(monkeypatch):
    ran = []

    class Done:
        returncode, stderr = 1, "no folder can keep kernels"

    monkeypatch.setattr(
        command.subprocess, "run", lambda line, env, **more: ran.append((line, env)) or Done
    )
    said = []
    monkeypatch.setattr(command, "say", said.append)
    monkeypatch.setattr(instructions, "environment", lambda name: {"NUMBA_CPU_NAME": name})
    command.warm_up(["native", "avx2"])
    assert [env["NUMBA_CPU_NAME"] for _, env in ran] == ["native", "avx2"]
    assert all("warmup" in line for line, _ in ran)
    assert "no folder can keep kernels" in said[0]


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
    number, lowest, color = picture.describe(here, hues, by_median=True)
    assert (number, lowest) == ("2.5", "0.99")
    assert color[0] > 0.5
    small = [marks.judge(measured(cell_of(), 0.8, 0.9), 1, "native")]
    assert picture.describe(small, hues)[:2] == ("+0.20", "ms")
    many = [marks.judge(measured(cell_of(), 0.8, 0.9, batch=0.3), 1, "native"), *small]
    assert picture.describe(many, hues)[:2] == ("+0.20", "together 3.0")
    assert picture.describe(many, hues, by_median=True)[:2] == ("+0.20", "ms")
    assert picture.describe([], hues) == ("", "", None)


def test_maps_are_drawn_and_marks_printed_from_a_file(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(picture, "DOTS_PER_INCH", 10)
    content = {
        "machine": {"processor": "a processor", "processors": "2"},
        "instructions": {"native": "AVX2"},
        "left_out": {"avx2": "this CPU has no AVX-512"},
        "commit": "1234567890",
        "threads": [1],
        "minutes": 20.0,
        "not_reached": ["5 k knot colors 64²", "5 k knot colors 128²"],
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
    assert "2 cells were not reached in 20 minutes, from 5 k knot colors 64²" in done.output
    assert "median, to llvmpipe" in done.output
    assert sorted(found.name for found in tmp_path.glob("*.png")) == [
        "map.png", "map_colors.png", "map_phong.png",
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
    monkeypatch, quick, tmp_path, has_avx512
):
    features = {"avx2": True, "avx512f": has_avx512}
    monkeypatch.setattr(instructions, "features", lambda: features)
    path = tmp_path / "map.json"
    content = command.measure_all([cell_of()], [1], instructions.SETS, 1.0, 60.0, path)
    assert json.loads(path.read_text()) == content
    if has_avx512:
        assert content["instructions"] == {"native": "AVX-512", "avx2": "AVX2"}
        assert content["left_out"] == {}
    else:
        assert content["instructions"] == {"native": "AVX2"}
        assert "no AVX-512" in content["left_out"]["avx2"]
    assert command.read(content)[0].cell == cell_of()
