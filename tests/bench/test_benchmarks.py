"""The benchmark suite itself: scenes, arithmetic, and that a wrong picture loses its time."""

from __future__ import annotations

import dataclasses
import importlib
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import rasterjit as rj

sys.path.append(str(Path(__file__).parents[2]))
command = importlib.import_module("benchmarks.__main__")
against_peers = importlib.import_module("benchmarks.against_peers")
memory = importlib.import_module("benchmarks.memory")
pairing = importlib.import_module("benchmarks.pairing")
pictures = importlib.import_module("benchmarks.pictures")
report = importlib.import_module("benchmarks.report")
rows = importlib.import_module("benchmarks.rows")
scenes = importlib.import_module("benchmarks.scenes")
targets = importlib.import_module("benchmarks.targets")

CONTESTANT_OF_EDGES = importlib.import_module("benchmarks.contestants.opengl")
SMALL_NAMES = sorted(scenes.SCENES.keys() - {"mesh_5m", "short_lines"})


def arrays(scene):
    """Return the values of a scene's fields by name."""
    return {field.name: getattr(scene, field.name) for field in dataclasses.fields(scene)}


def run_of(key, seconds, threads=1, picture=None):
    """Return a run with the given times."""
    run = pairing.Run(pairing.Entry(key, "mesh_70k", threads), picture=picture or {})
    run.seconds, run.draw_seconds, run.processor_seconds = [list(seconds) for _ in range(3)]
    return run


@pytest.mark.parametrize("name", SMALL_NAMES)
def test_scenes_are_the_same_each_time(name):
    one, other = arrays(scenes.find_scene(name)), arrays(scenes.find_scene(name))
    for field, value in one.items():
        np.testing.assert_array_equal(value, other[field], err_msg=field)


@pytest.mark.parametrize("name", SMALL_NAMES)
def test_arrays_of_scenes_have_the_documented_types(name):
    scene = scenes.find_scene(name)
    assert scene.work > 0
    if isinstance(scene, scenes.LineScene):
        assert scene.ends.dtype == np.int64
        assert (scene.ends.reshape(-1, 2) >= 0).all()
        assert (scene.ends.reshape(-1, 2) < scene.size).all()
        return
    assert scene.positions.dtype == np.float32
    assert scene.faces.dtype == np.int32
    assert scene.faces.max() < len(scene.positions)
    if scene.colors is not None:
        assert scene.colors.dtype == np.uint8
        assert scene.colors.shape == (len(scene.positions), 4)
    if scene.normals is not None:
        np.testing.assert_allclose(np.linalg.norm(scene.normals, axis=1), 1.0, atol=1e-6)


def test_mesh_of_seventy_thousand_faces_covers_54_percent():
    scene = scenes.mesh_70k()
    seen = rj.rasterize(scene.clip_positions(), scene.faces, scene.size).face_id >= 0
    assert 0.53 < seen.mean() < 0.55


def test_nearly_all_faces_of_the_culled_scene_are_outside_or_face_away():
    scene = scenes.culled()
    mesh, camera = memory.mesh_and_camera(scene)
    with rj.Renderer(scene.size) as renderer:
        stats = renderer.render(mesh, camera, outputs=("face_id",), cull=scene.cull).stats
    assert (stats.outside + stats.culled) / stats.triangles_in > 0.95
    assert stats.drawn > 0


def test_families_hold_about_as_many_faces_as_asked_for():
    for count in (1_000, 3_162, 10_000, 31_623, 100_000):
        assert len(scenes.find_scene(f"triangles:{count}").faces) == pytest.approx(count, rel=0.05)
    assert scenes.find_scene("fill:256").size == (256, 256)


def test_ratio_is_the_median_of_the_rounds_ratios():
    slow, fast = run_of("opengl", [4.0, 9.0, 30.0]), run_of("rasterjit", [2.0, 3.0, 10.0, 99.0])
    assert pairing.paired_ratio(slow, fast) == 3.0


def test_slow_contestants_take_part_in_fewer_rounds():
    effort = pairing.Effort(9, 8.0)
    assert [effort.rounds_of(seconds) for seconds in (0.01, 1.0, 100.0)] == [9, 4, 1]


def test_targets_are_least_and_goal():
    row = rows.Row("scene", "peer")
    for value, met in ((2.9, rows.MISSED), (3.0, rows.MET), (7.0, rows.GOAL)):
        row.aim_above(value, targets.Target(3.0, 7.0))
        assert row.met == met
    for value, met in ((1.4, rows.MISSED), (1.3, rows.MET), (0.9, rows.GOAL)):
        row.aim_below(value, targets.Target(1.3, 0.9), " s")
        assert row.met == met


def test_colours_are_compared_where_both_pictures_have_something():
    covered = np.array([[True, True], [False, True]])
    one = {"covered": covered, "color_linear": np.zeros((2, 2, 3), np.uint8)}
    other = {"covered": covered, "color_linear": np.zeros((2, 2, 3), np.uint8)}
    other["color_linear"][1, 0] = 255
    other["color_linear"][0, 0] = pictures.COLOR_STEPS
    assert pictures.agreement(one, other)["color_linear"] == 1.0
    other["color_linear"][0, 0] = pictures.COLOR_STEPS + 1
    assert pictures.agreement(one, other)["color_linear"] == pytest.approx(2 / 3)


def test_a_line_beside_another_is_near_it():
    one, beside, far = (np.zeros((9, 9), bool) for _ in range(3))
    one[:, 3], beside[:, 4], far[:, 5] = True, True, True
    assert pictures.nearness(one, beside) == 1.0
    assert pictures.nearness(one, far) == 0.0


@pytest.mark.parametrize(("column", "is_lost"), [(4, False), (5, True)])
def test_edges_may_run_beside_the_reference_and_no_further(column, is_lost):
    covered, moved = np.zeros((2, 30, 30), bool)
    covered[:, 3], moved[:, column] = True, True
    reference = run_of("rasterjit", [0.1], picture={"covered": covered})
    run = run_of("opengl", [0.1], picture={"covered": moved})
    rows.check_picture(run, reference, pictures.needed(scenes.wireframe(), CONTESTANT_OF_EDGES))
    assert (run.missing is not None) == is_lost


def test_a_picture_of_another_size_differs():
    shares = pictures.agreement({"covered": np.ones((2, 2))}, {"covered": np.ones((3, 2))})
    assert pictures.differs(shares, pictures.USUAL)


class FakeWorker:
    """Answers with given seconds and a given picture."""

    def __init__(self, seconds, picture=None):
        self._seconds, self._picture = seconds, picture or {}

    def ask(self, command):
        return dict.fromkeys(("draw", "total", "processor"), self._seconds)

    def picture(self):
        return self._picture

    def close(self):
        pass


@pytest.fixture
def faked(monkeypatch, tmp_path):
    """The command with workers that draw nothing: seconds and picture by contestant."""
    picture = {"covered": np.eye(50, dtype=bool)}
    known = {"rasterjit": (0.01, picture), "opengl": (0.05, picture)}

    def start(entry, folder, number):
        seconds, drawn = known[entry.contestant]
        return FakeWorker(seconds, drawn), seconds

    monkeypatch.setattr(pairing, "start", start)
    names = {name: name for name in ("rasterjit", "opengl", "tinydisplay")}
    monkeypatch.setattr(against_peers, "MODULES", names)
    absent = {"tinydisplay": f"{rows.MISSING}: not installed here"}
    monkeypatch.setattr(against_peers, "unavailable", absent.get)
    monkeypatch.setattr(report, "RESULTS", tmp_path)
    monkeypatch.setattr(report, "machine", dict)
    return known


def run_table(*more):
    return CliRunner().invoke(
        command.main, ["--only", "mesh_70k", "--threads", "1", "--quick", *more]
    )


def written():
    """Return the rows of the table that was written."""
    return json.loads((report.RESULTS / "table.json").read_text())["rows"]


@pytest.mark.usefixtures("faked")
def test_the_table_holds_ratios_and_targets():
    done = run_table()
    assert done.exit_code == 0, done.output
    own, opengl, missing = written()
    assert own["ms"] == pytest.approx(10.0)
    assert opengl["ratio"] == pytest.approx(5.0)
    assert (opengl["met"], opengl["target"], opengl["goal"]) == (rows.GOAL, ">= 3x", "5x")
    assert missing["ms"] is None
    assert missing["check"] == "missing: not installed here"


@pytest.mark.usefixtures("faked")
def test_a_missing_peer_is_listed_in_print():
    text = run_table().output + (report.RESULTS / "table.md").read_text()
    assert text.count("not installed here") >= 2


@pytest.mark.usefixtures("faked")
def test_peers_without_targets_are_left_out_of_quick_runs(monkeypatch):
    names = ("rasterjit", "opengl", "pillow")
    monkeypatch.setattr(against_peers, "MODULES", {name: name for name in names})
    scene = scenes.mesh_70k()
    for quick, left in ((True, rows.LEFT_OUT), (False, None)):
        options = against_peers.Options(pairing.Effort(3, 1.0), (1,), quick)
        runs = against_peers.entrants("mesh_70k", scene, options)
        assert [run.missing for run in runs] == [None, None, left]
        assert runs[2].patience < runs[0].patience


def test_a_contestant_that_cannot_even_be_asked_is_missing():
    assert against_peers.unavailable("rasterjit") is None
    assert against_peers.unavailable("nobody").startswith(f"{rows.MISSING}: ")


@pytest.mark.usefixtures("faked")
def test_a_part_that_fails_leaves_the_others_their_rows(monkeypatch):
    def fail(rounds):
        raise RuntimeError("rasterjit render wrote no picture")

    monkeypatch.setattr(importlib.import_module("benchmarks.costs"), "measure_commands", fail)
    done = run_table("--only", "startup")
    assert done.exit_code == 1
    assert written()[0]["ms"] is not None
    assert written()[-1]["check"] == "failed: rasterjit render wrote no picture"


def test_a_wrong_picture_loses_its_time_and_ends_with_status_1(faked):
    faked["rasterjit"] = (0.01, {"covered": np.zeros((50, 50), bool)})
    done = run_table()
    assert done.exit_code == 1
    own, opengl, _ = written()
    assert own["check"].startswith("the picture differs")
    assert own["ms"] is None
    assert own["rounds"] is None
    assert opengl["ms"] is not None
    assert opengl["ratio"] is None


@pytest.mark.parametrize("is_same", [True, False])
def test_whoever_differs_from_rasterjit_loses_his_time(faked, is_same):
    """Beside two that agree, a third is wrong; several threads must give the very same bits."""
    picture = faked["rasterjit"][1]
    other = {"covered": picture["covered"].copy()}
    other["covered"][0, 0] = False  # 0.04 % of the pixels: alike, but not the same
    runs = [
        run_of("rasterjit", [0.1], 1, picture),
        run_of("opengl", [0.1], 1, picture),
        run_of("rasterjit", [0.1], 2, picture if is_same else other),
        run_of("pillow", [0.1], 1, {"covered": ~picture["covered"]}),
        run_of("opengl", [0.1], 2, other),
    ]
    against_peers.check_pictures(runs, scenes.mesh_70k())
    lost = [run.missing is not None for run in runs]
    assert lost == [False, False, not is_same, True, False]


def test_files_are_written_whole_or_not_at_all(tmp_path, monkeypatch):
    monkeypatch.setattr(report, "machine", dict)
    report.write([rows.Row("scene", "peer", ms=1.5)], 3, folder=tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["table.json", "table.md"]
    before = (tmp_path / "table.json").read_text()
    assert json.loads(before)["rows"][0]["ms"] == 1.5
    with pytest.raises(TypeError):
        report.write([rows.Row("scene", "peer", ms=object())], 3, folder=tmp_path)
    assert (tmp_path / "table.json").read_text() == before


@pytest.mark.parametrize(
    ("code", "seconds", "message"),
    [
        ("import time; time.sleep(600)", 0.5, "took longer than 0.5 s"),
        ("raise ValueError('no such scene')", 60.0, "ValueError: no such scene"),
    ],
)
def test_a_worker_that_gives_no_answer_is_ended(tmp_path, code, seconds, message):
    worker = pairing.Worker(("-c", code), dict(os.environ), tmp_path / "errors.log")
    with pytest.raises(pairing.WorkerError, match=message):
        worker.answer(seconds)
    worker.close()


COUNTING_WORKER = """
import sys
from types import SimpleNamespace
import numpy as np
from benchmarks import worker

class Counting:
    count = 0

    def draw(self):
        self.count += 1

    def read(self):
        return {}

    def picture(self):
        return {"draws": np.array(self.count)}

worker.contestant = lambda key: SimpleNamespace(prepare=lambda scene, threads: Counting())
worker.find_scene = lambda name: None
worker.main(*sys.argv[1:])
"""
"""`benchmarks.worker` with a contestant whose picture says how often it was drawn."""


@pytest.mark.parametrize("rounds", [1, 3])
def test_the_picture_of_a_run_is_the_last_that_was_timed(monkeypatch, rounds):
    start = pairing.Worker.__init__

    def start_counting(worker, arguments, environment, errors):
        assert arguments[:2] == ("-m", "benchmarks.worker")
        start(worker, ("-c", COUNTING_WORKER, *arguments[2:]), environment, errors)

    monkeypatch.setattr(pairing.Worker, "__init__", start_counting)
    (run,) = pairing.measure([run_of("rasterjit", [])], pairing.Effort(rounds, 60.0))
    assert run.missing is None
    assert len(run.seconds) == rounds
    # Each round and the warm-up draw twice; nothing is drawn for the picture.
    assert run.picture["draws"] == 2 + 2 * rounds


def test_a_worker_draws_and_answers_with_seconds_and_its_picture(tmp_path):
    entry = pairing.Entry("rasterjit", "fill_sample")
    worker, seconds = pairing.start(entry, tmp_path, 0)
    try:
        assert seconds > 0.0
        (tmp_path / "0.npz").unlink()
        answer = worker.ask("draw")
        picture = worker.picture()
    finally:
        worker.close()
    assert answer.keys() == {"draw", "total", "processor"}
    assert 0.0 < answer["draw"] < answer["total"]
    assert (picture["covered"] == (picture["face_id"] >= 0)).all()
    assert picture["covered"].any()


def test_a_failed_worker_leaves_the_others_their_times(monkeypatch):
    class Failing(FakeWorker):
        def ask(self, command):
            raise pairing.WorkerError("took longer than 60 s")

    workers = {"opengl": Failing(1.0), "rasterjit": FakeWorker(0.01)}
    monkeypatch.setattr(
        pairing, "start", lambda entry, folder, number: (workers[entry.contestant], 0.01)
    )
    runs = [run_of("opengl", []), run_of("rasterjit", [])]
    slow, own = pairing.measure(runs, pairing.Effort(3, 1.0))
    assert slow.missing == "failed: took longer than 60 s"
    assert own.seconds == [0.01] * 3
