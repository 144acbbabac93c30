"""The programs that draw for long, and that interrupt: they see what is planted."""

from __future__ import annotations

import importlib
import itertools
import os
import random
import signal
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

sys.path.append(str(Path(__file__).parents[2]))
soak = importlib.import_module("benchmarks.soak")
interrupts = importlib.import_module("benchmarks.interrupts")

pytestmark = [
    pytest.mark.takes_long,
    pytest.mark.skipif(sys.platform != "linux", reason="both look into /proc"),
]


@pytest.fixture(autouse=True)
def no_threads_of_other_tests(monkeypatch):
    monkeypatch.setattr(soak, "QUIET", 0.0)


HELD = {"memory, MB": 100.0, "descriptors": 6.0, "threads": 2.0, "processes": 0.0}


def samples(**changes):
    """Return nine samples; changes name a kind and its values."""
    values = {kind.partition(",")[0]: kind for kind in soak.KINDS}
    return [
        soak.Sample(n, HELD | {values[kind]: some[n] for kind, some in changes.items()})
        for n in range(9)
    ]


@pytest.mark.parametrize(
    ("changes", "grown"),
    [
        ({}, []),
        ({"memory": [100 + 10 * n for n in range(9)]}, ["memory, MB"]),
        # It comes and goes.
        ({"memory": [100, 160, 110, 150, 100, 170, 120, 150, 160]}, []),
        ({"memory": [10, 100, 100, 100, 100, 100, 100, 100, 110]}, []),
        ({"descriptors": [6, 6, 6, 7, 7, 7, 8, 8, 8]}, ["descriptors"]),
        ({"descriptors": [6, 7, 6, 7, 6, 7, 6, 7, 6]}, []),
        ({"threads": [2, 2, 2, 2, 2, 2, 3, 3, 3], "processes": [0] * 6 + [1] * 3},
         ["threads", "processes"]),
    ],
)  # fmt: skip
def test_growth_is_what_is_always_more_late_than_early(changes, grown):
    found = soak.growth(samples(**changes), 0)
    assert [kind for kind, one in found.items() if one.is_fault] == grown


def test_what_comes_with_the_first_pictures_is_no_growth():
    steps = samples(threads=[1, 2, 3, 4, 4, 4, 4, 4, 4])
    assert soak.growth(steps, 0)["threads"].is_fault
    assert not soak.growth(steps, 3)["threads"].is_fault
    # With too few left, the last three count.
    assert not soak.growth(steps, 100)["threads"].is_fault


def run(draw, pictures=40):
    made = soak.Soak(draw, lambda: None, cases=4, seed=1)
    made.run(pictures, pictures / 9, itertools.count().__next__)
    return made


def test_bits_that_change_are_told_by_their_case():
    drawn = dict.fromkeys(range(4), 0)

    def draw(number, chance):
        drawn[number] += 1
        return f"{number} {number == 2 and drawn[2] > 5}"

    made = run(draw, 80)
    assert set(made.changed) == {2}
    assert made.is_fault
    assert len(made.changed) == drawn[2] - 5
    assert made.compared == made.pictures - 4


def test_each_case_is_drawn_twice_in_any_time():
    drawn = []
    made = run(lambda number, chance: drawn.append(number) or str(number), 0)
    assert sorted(drawn) == [0, 0, 1, 1, 2, 2, 3, 3]
    assert not made.changed


def test_descriptors_that_stay_open_are_a_fault():
    opened = []

    def leak(number, chance):
        opened.append(os.open(os.devnull, os.O_RDONLY))
        return "same"

    try:
        made = run(leak)
        assert soak.growth(made.samples, made.settled)["descriptors"].is_fault
        assert made.is_fault
    finally:
        for one in opened:
            os.close(one)
    assert not run(lambda number, chance: "same").is_fault


def test_cases_follow_from_their_numbers(tmp_path):
    one, same, other = (soak.make_case(3, n) for n in (5, 5, 6))
    assert (one.size, one.quality) == (same.size, same.quality)
    assert one.options["outputs"] == same.options["outputs"]
    assert one.options["camera"] == same.options["camera"] != other.options["camera"]
    drawer = soak.Drawer(3, tmp_path)
    try:
        found = {drawer.draw(0, random.Random(n)) for n in range(6)}
    finally:
        drawer.close()
    assert len(found) == 1


def test_the_program_prints_a_table(monkeypatch):
    # What three samples of an instant hold differs by what their worker did before.
    monkeypatch.setattr(soak, "SLACK", dict.fromkeys(soak.KINDS, 1e6))
    monkeypatch.setattr(soak, "use_one_heap", lambda: None)
    done = CliRunner().invoke(soak.main, ["--minutes", "0.01", "--cases", "2", "--samples", "3"])
    assert done.exit_code == 0, done.output
    assert "compared with the first; changed: 0" in " ".join(done.output.split())
    assert all(kind in done.output for kind in soak.KINDS)


PROGRAM = """
import os, signal, subprocess, sys, time
way, out = sys.argv[1], sys.argv[2]
def come(*_):
    if way == "hangs":
        return
    if way == "raises":
        raise KeyboardInterrupt
    if way == "leaves a process":
        subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"],
                         stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    if way == "leaves a file":
        open(os.path.join(out, ".half.png"), "w").close()
    os._exit(0 if way == "says nothing" else 130)
signal.signal(signal.SIGINT, come)
print("rasterjit", file=sys.stderr, flush=True)
if way == "is done":
    print("wrote it", flush=True)
    sys.exit(0)
if way == "half a file" and not os.path.exists(os.path.join(out, "again")):
    open(os.path.join(out, ".half"), "w").close()
    open(os.path.join(out, "again"), "w").close()
    time.sleep(60)
if way == "half a file":
    os.unlink(os.path.join(out, ".half"))
    sys.exit(0)
while True:
    time.sleep(0.01)
"""


@pytest.fixture
def bench(tmp_path, monkeypatch):
    monkeypatch.setattr(interrupts.store, "kernel_folder", lambda: None)
    monkeypatch.setattr(interrupts, "PATIENCE", 3.0)
    (tmp_path / "program.py").write_text(PROGRAM)
    place = tmp_path / "runs"
    place.mkdir()
    return interrupts.Bench(place, (sys.executable, str(tmp_path / "program.py")))


@pytest.mark.parametrize(
    ("way", "faults"),
    [
        ("ends", []),
        ("is done", []),
        ("says nothing", ["status 0"]),
        ("hangs", ["did not end"]),
        ("raises", ["status -2", "traceback"]),
        ("leaves a file", ["files .half.png"]),
        ("leaves a process", ["processes 1"]),
    ],
)
def test_what_an_interrupt_leaves_is_seen(bench, way, faults):
    command = interrupts.Command(way, (way, "{out}"))
    done = bench.disturb(command, interrupts.Run(way, "SIGINT", False, False, 1.5))
    if way == "raises":
        # Python ends itself by the signal, after the traceback.
        assert done.status in (-signal.SIGINT, 1, 130)
        assert "Traceback" in done.errors
        return
    assert done.faults() == faults


def test_a_traceback_of_ours_is_a_fault_and_one_of_python_is_none():
    told = {"status": 1, "errors": 'Traceback ...\n File "rasterjit/cli/__init__.py"'}
    ours = interrupts.Run("render", "SIGINT", False, False, 0.5, **told)
    assert ours.faults() == ["status 1", "traceback"]
    ours.status = -signal.SIGINT
    assert ours.faults() == ["status -2", "traceback"]
    before = interrupts.Run("render", "SIGINT", False, False, 0.02, status=-signal.SIGINT)
    assert before.is_before_ours
    assert before.faults() == []


def test_what_a_kill_leaves_goes_with_the_next_run(bench):
    command = interrupts.Command("half a file", ("half a file", "{out}"))
    done = bench.disturb(command, interrupts.Run("half", "SIGKILL", False, False, 1.5))
    assert (done.status, done.left, done.again, done.files) == (-9, [".half"], 0, [])
    assert done.faults() == []


def test_files_are_whole_or_named(tmp_path):
    (tmp_path / "a.png").write_bytes(b"\x89PNG half")
    (tmp_path / "a.json").write_text("{}")
    (tmp_path / ".lock").touch()
    assert [name.partition(" ")[0] for name in interrupts.not_whole(tmp_path)] == [".lock", "a.png"]


def test_moments_begin_early_and_are_the_seeds():
    lengths = {one.name: interrupts.Length(3.0, 9.0) for one in interrupts.COMMANDS}
    plans = [interrupts.planned(list(interrupts.COMMANDS), lengths, 120, 48, 7) for _ in range(2)]
    runs = [run for _, run in plans[0]]
    assert runs == [run for _, run in plans[1]]
    assert [run.signal for run in runs].count("SIGKILL") == 48
    assert {run.command for run in runs} == set(lengths)
    assert min(run.moment for run in runs) >= interrupts.FIRST
    assert sum(run.moment < interrupts.IMPORTS for run in runs) > len(runs) / 2
    assert any(run.is_cold for run in runs)
