"""Hostile files are refused or named; mutated ones crash nothing and lose nothing in silence."""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import pytest
from corpus import HOSTILE, MAX, write_corpus
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.io.foreign import isolation
from rasterjit.io.load_warnings import LoadWarning
from rasterjit.io.meshes import list_readable_formats

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))
all_samples = importlib.import_module("benchmarks.fuzz_files.all_samples")
command = importlib.import_module("benchmarks.fuzz_files.__main__")
judging = importlib.import_module("benchmarks.fuzz_files.judging")
samples = importlib.import_module("benchmarks.fuzz_files.samples")
strict = importlib.import_module("benchmarks.fuzz_files.strict")
tables = importlib.import_module("benchmarks.fuzz_files.tables")
SAMPLES = all_samples.SAMPLES

needs_special_files = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
SPECIAL = ("pipe", "device", "socket", "link")

packed_samples = importlib.import_module("benchmarks.fuzz_files.packed_samples")
PACKAGES = {
    f"{codec} {kind}": package
    for codec, package in packed_samples.PACKAGES.items()
    for kind in ("glb", "gltf")
} | {"sky exr": "OpenEXR"}
"""What some samples are made or read with."""

FACES = {"off": 20, "glb": 50, "3mf": 36, "dae": 18, "binvox": 28}
"""Triangles of some samples."""


@pytest.fixture(scope="module", autouse=True)
def readers_of_others_are_given_up_soon():
    """Files here are small."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(isolation, "_BASE_CPU_SECONDS", command.READER_SECONDS)
        yield


def read(path):
    """Return what a file holds, or what was said of it, and what came of it."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            if path.suffix == ".hdr":
                rj.Environment.from_file(path, max_bytes=MAX)
            else:
                rj.load(path, max_bytes=MAX)
        except ValueError as error:
            return "refused", str(error)
    assert all(issubclass(one.category, LoadWarning) for one in told)
    return "warned" if told else "loaded", " ".join(str(one.message) for one in told)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=needs_special_files if name in SPECIAL else ()) for name in HOSTILE],
)
def test_a_hostile_file_is_refused_or_named(tmp_path, name):
    hostile = HOSTILE[name]
    path = hostile.make(tmp_path / "model")
    before = time.thread_time()
    outcome, said = read(path)
    assert time.thread_time() - before < 10.0
    assert (outcome, str(path) in said) == (hostile.outcome, hostile.outcome != "loaded"), said
    assert re.search(hostile.said, said), said


@needs_special_files
def test_the_corpus_is_written_by_its_script(tmp_path):
    script = Path(__file__).with_name("corpus.py")
    done = subprocess.run(
        [sys.executable, script, tmp_path / "one"], check=True, capture_output=True, text=True
    )
    written = [Path(line) for line in done.stdout.splitlines()]
    assert len(written) == len(HOSTILE)
    for one, other in zip(written, write_corpus(tmp_path / "two"), strict=True):
        # Some name the folder that they lie in.
        assert one.name == other.name
        assert one.stat().st_size == other.stat().st_size
        assert one.stat().st_size < 3 << 20


# Sound files, and how they are counted


def test_every_extension_that_is_read_has_a_sound_file():
    assert list_readable_formats() - set(all_samples.without_package()) == all_samples.extensions()


@pytest.mark.parametrize("name", SAMPLES)
def test_a_sound_file_is_read_without_a_word(tmp_path, name):
    needs(name)
    found = judging.judge_files(name, SAMPLES[name](), tmp_path, "error")
    assert found["faults"] == []
    assert found["outcome"] == "loaded", found["said"]


def needs(name):
    """Skip a test where a package is missing that a sample is made or read with."""
    if name in PACKAGES:
        pytest.importorskip(PACKAGES[name])


@pytest.mark.parametrize("name", FACES)
def test_triangles_are_counted_by_the_letter(name):
    held = strict.triangles_of(name, SAMPLES[name]())
    assert (len(held) // 3 if isinstance(held, list) else held) == FACES[name]


@pytest.mark.parametrize("name", strict.READERS_OF_POINTS)
def test_points_are_counted_by_the_letter(name):
    assert strict.points_of(name, SAMPLES[name]()) == (None if name.startswith("obj") else 16)


def test_what_is_no_point_by_the_letter_is_not_counted():
    assert strict.points_of("xyz", {"a.xyz": b"0 0 0\n1 x 0\n"}) is None
    assert strict.points_of("off", samples.off()) is None
    plain = samples.obj_plain()["a.obj"]
    assert strict.points_of("obj plain", {"a.obj": plain}) is None
    assert strict.points_of("obj plain", {"a.obj": plain.partition(b"\nf")[0]}) == 16


def test_what_is_not_sound_is_not_counted():
    text = samples.off()["a.off"]
    for old, new in ((b"16 19 0", b"16 20 0"), (b"3 0 1 5", b"3 0 1 99"), (b"3 0 1 5", b"3 0 x 5")):
        assert old in text
        assert strict.triangles_of("off", {"a.off": text.replace(old, new, 1)}) is None
    # A control character that some take for a blank, before what is then a comment.
    text = samples.obj()["a.obj"].replace(b"\nf 1/1", b"\n\x14#f 1/1", 1)
    assert strict.triangles_of("obj", {"a.obj": text}) is None


# What must not be is found


def lose_a_face(path, **options):
    scene = rj.Scene()
    mesh = rj.load(path, **options).nodes[0].mesh
    scene.add(rj.Mesh(mesh.vertices, mesh.faces[1:]))
    return scene


def move_a_vertex(path, **options):
    scene = rj.Scene()
    mesh = rj.load(path, **options).nodes[0].mesh
    scene.add(rj.Mesh(mesh.vertices + [[0.0, 0.0, 1.0]], mesh.faces))
    return scene


def lose_a_point(path, **options):
    scene = rj.Scene()
    scene.add(rj.Points(rj.load(path, **options).nodes[0].mesh.vertices[1:]))
    return scene


def raise_key_error(path, **options):
    raise KeyError("POSITION")


def name_no_file(path, **options):
    raise ValueError("it is damaged")


def warn_of_numpy(path, **options):
    warnings.warn("overflow", RuntimeWarning, stacklevel=2)
    return rj.load(path, **options)


class Patched:
    """The package with another ``load``."""

    def __init__(self, load):
        self.load = load

    def __getattr__(self, name):
        return getattr(rj, name)


@pytest.mark.parametrize(
    ("load", "fault"),
    [
        (lose_a_face, "lost without a word: 19 of 20 triangles"),
        (move_a_vertex, "other corners than the file's"),
        (raise_key_error, "a foreign exception, KeyError"),
        (name_no_file, "the error does not name the file"),
        (warn_of_numpy, "a foreign warning, RuntimeWarning"),
    ],
)
def test_what_a_reader_does_wrong_is_found(tmp_path, monkeypatch, load, fault):
    monkeypatch.setattr(judging, "rj", Patched(load))
    found = judging.judge_files("off", samples.off(), tmp_path, "error")
    assert [one for one in found["faults"] if one.startswith(fault)], found["faults"]


@pytest.mark.parametrize("name", ["vtk", "vtu text", "su2", "3dxml", "zip", "tar.bz2", "dxf"])
def test_a_face_that_is_lost_of_a_file_that_others_read_is_found(tmp_path, monkeypatch, name):
    monkeypatch.setattr(judging, "rj", Patched(lose_a_face))
    found = judging.judge_files(name, SAMPLES[name](), tmp_path, "error")
    assert [one for one in found["faults"] if one.startswith("lost without a word")], found


@pytest.mark.parametrize("name", ["las", "laz new", "pcd compressed", "csv"])
def test_a_point_that_is_lost_of_any_cloud_is_found(tmp_path, monkeypatch, name):
    monkeypatch.setattr(judging, "rj", Patched(lose_a_point))
    found = judging.judge_files(name, SAMPLES[name](), tmp_path, "error")
    assert found["faults"] == ["lost without a word: 15 of 16 points"]


def test_a_line_that_is_lost_is_found(tmp_path, monkeypatch):
    def lose_a_line(path, **options):
        scene = rj.Scene()
        lines = rj.load(path, **options).nodes[0].mesh
        scene.add(rj.Lines(lines.vertices, lines.segments[:4]))
        return scene

    monkeypatch.setattr(judging, "rj", Patched(lose_a_line))
    found = judging.judge_files("svg", SAMPLES["svg"](), tmp_path, "error")
    assert found["faults"] == ["lost without a word: 4 of 8 segments"]


TAKES_MEMORY = """
import json, sys
from pathlib import Path
import rasterjit as rj
from benchmarks.fuzz_files import judging, samples

class Takes:
    def __getattr__(self, name):
        return getattr(rj, name)

    def load(self, path, **options):
        bytearray(b"x") * (int(sys.argv[2]) << 20)
        return rj.load(path, **options)

judging.rj = Takes()
found = judging.judge_files("off", samples.off(), Path(sys.argv[1]), "error")
print(json.dumps(found["faults"]))
"""


@pytest.mark.parametrize(("mebibytes", "is_too_much"), [(40, False), (100, True)])
def test_memory_that_a_reader_takes_is_found(tmp_path, mebibytes, is_too_much):
    # A process of its own: how far this one has grown is of no account.
    done = subprocess.run(
        [sys.executable, "-c", TAKES_MEMORY, tmp_path, str(mebibytes)],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )  # fmt: skip
    faults = json.loads(done.stdout)
    assert [one[:9] for one in faults] == ["it took 1"] * is_too_much


def test_a_point_that_is_lost_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(judging, "rj", Patched(lose_a_point))
    found = judging.judge_files("xyz", samples.xyz(), tmp_path, "error")
    assert found["faults"] == ["lost without a word: 15 of 16 points"]


@pytest.mark.skipif(sys.platform != "linux", reason="it limits the process as Linux does")
def test_a_process_that_ends_or_hangs_is_told_and_started_again(monkeypatch):
    # The process answers what stands here, in the place of the one that reads files.
    program = (
        "import os, sys, time\n"
        "print('true', flush=True)\n"
        "for line in sys.stdin:\n"
        "    if line == '1\\n': os.abort()\n"
        "    if line == '2\\n': time.sleep(60)\n"
        '    print(\'{"seconds": 11.0, "faults": []}\', flush=True)\n'
    )
    popen = subprocess.Popen
    monkeypatch.setattr(
        command.subprocess, "Popen",
        lambda _, **options: popen([sys.executable, "-c", program], **options),
    )  # fmt: skip
    monkeypatch.setattr(command, "WAITING_SECONDS", 2.0)
    with tempfile.TemporaryFile("w+") as log:
        reader = command.Reader(1, log)
        try:
            faults = [reader.read(number)["faults"] for number in range(4)]
        finally:
            reader.close()
    assert faults == [
        ["hung: it took 11.0 s"],
        ["crash: the process ended with status -6"],
        ["hung"],
        ["hung: it took 11.0 s"],
    ]


# How it is counted, and written down


def result(number, **more):
    """Return what became of a case: read, if nothing else is said."""
    sample = judging.sample_of(number)
    return {"number": number, "sample": sample, "how": "", "said": "", "outcome": "loaded",
            "faults": [], "seconds": 0.1, "peak": 0, **more}  # fmt: skip


def test_a_run_goes_on_where_its_results_end(tmp_path, monkeypatch):
    read = []

    class Stub:
        """Reads nothing, and stops at the fourth case the first time."""

        def __init__(self, seed, log):
            pass

        def read(self, number):
            if number == 3 and 3 not in read:
                read.append(number)
                raise RuntimeError("it does not start")
            read.append(number)
            return result(number)

        def close(self):
            pass

    monkeypatch.setattr(command, "Reader", Stub)
    words = ["--files", "6", "--workers", "1", "--results", str(tmp_path / "results")]
    with pytest.raises(RuntimeError, match="does not start"):
        command.main(words)
    with pytest.raises(SystemExit) as ended:
        command.main(words)
    assert ended.value.code == 0
    assert read == [0, 1, 2, 3, 3, 4, 5]
    with pytest.raises(SystemExit):
        command.main([*words, "--seed", "5"])
    assert len(read) == 7


def test_several_processes_read_each_case_once(monkeypatch):
    class Stub:
        """Reads nothing."""

        def __init__(self, seed, log):
            self.seed = seed

        def read(self, number):
            return result(number, seed=self.seed)

        def close(self):
            pass

    monkeypatch.setattr(command, "Reader", Stub)
    found = list(command.read_all(list(range(5, 105)), 3, 4))
    assert sorted(one["number"] for one in found) == list(range(5, 105))
    assert {one["seed"] for one in found} == {3}


def test_a_page_gets_a_row_for_each_format(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{tables.BEGIN}\nold\n{tables.END}\nafter\n")
    names = list(SAMPLES)
    results = [
        result(names.index("ply text")),
        result(names.index("ply big"), outcome="refused", said="its reader crashed (SIGABRT)"),
        result(names.index("off"), faults=["lost without a word: 1 of 2 triangles", "odd"]),
        result(names.index("vtk"), outcome="ended", faults=["crash: the process ended"]),
    ]
    tables.write_page(results, page)
    text = page.read_text()
    assert "| PLY | 2 | 1 | 1 | 1 | 0 | 0 | 0 | 0 | 0 |" in text
    assert "| OFF | 1 | 0 | 0 | 1 | 0 | 0 | 0 | 1 | 1 |" in text
    assert "| **all** | 4 | 1 | 1 | 2 | 1 | 0 | 0 | 1 | 1 |" in text
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text


# Mutated files

ELSEWHERE = {"vrm", "stl_ascii", "xyzn", "xyzrgb", "asc", "txt", "nas", "fem", "dat", "dato",
             "node", "xmf", "ex2", "e", "wkt"}  # fmt: skip
"""Read as another one is, under another name; of damaged WKT the reader mostly takes all its time:
a few are among the mutated files."""

EDITS = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.integers(0, 3), st.binary(min_size=1, max_size=6)),
    min_size=1, max_size=4,
)  # fmt: skip
"""Where in a file, whether to write over, insert, remove or cut there, and the bytes."""


def edited(content, edits):
    """Return a file with bytes changed."""
    data = bytearray(content)
    for share, kind, new in edits:
        at = int(share * len(data))
        if kind == 3:
            del data[at:]
        else:
            data[at : at + (0 if kind == 1 else len(new))] = b"" if kind == 2 else new
    return bytes(data)


@pytest.mark.parametrize("name", [name for name in SAMPLES if name not in ELSEWHERE])
@settings(max_examples=4)
@given(edits=EDITS)
def test_files_of_changed_bytes_do_no_harm(name, edits):
    needs(name)
    files = SAMPLES[name]()
    main = samples.opened(files)
    first = next(iter(files))
    files = {main: files[main]} | files | {first: edited(files[first], edits)}
    with tempfile.TemporaryDirectory() as folder:
        assert judging.judge_files(name, files, Path(folder), "error")["faults"] == []


def test_mutations_are_the_same_each_time():
    for number in range(2 * len(SAMPLES)):
        assert judging.files_of(4, number) == judging.files_of(4, number)
    several = {str(judging.files_of(seed, 0)) for seed in range(20)}
    assert len(several) > 15


@pytest.mark.skipif(sys.platform != "linux", reason="it limits the process as Linux does")
def test_mutated_files_do_no_harm(tmp_path):
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.fuzz_files", "--files", "90", "--workers", "1",
         "--seed", "5", "--results", str(tmp_path / "results")],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    for kind in ("crash", "hung", "a foreign exception", "lost without a word"):
        assert f"{kind}: 0" in run.stdout
    assert len((tmp_path / "results").read_text().splitlines()) == 91
