"""Machine code that came with the installation is used, and what is wrong with it is found."""

from __future__ import annotations

import base64
import csv
import ctypes
import hashlib
import importlib
import io
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from kernel_files import kernel_modules
from llvmlite import binding

import rasterjit as rj
from rasterjit.cli import commands, doctor, shared_libraries, wheels
from rasterjit.runtime import (
    background_compile,
    code_generation,
    isolated_numba,
    jit,
    prebuilt_kernels,
    stage_runner,
    store,
    targets,
)
from rasterjit.runtime.prebuilt_kernels import Index, UnusableError
from rasterjit.runtime.targets import Target

compiled_only = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="no machine code of ours")

TESTS = Path(__file__).parents[1]
PLATFORM = targets.PLATFORMS["x86_64"]
HERE = targets.find_platform(store.host().triple)
needs_library = pytest.mark.skipif(
    jit.DISABLED or jit.CHECKED or HERE is None, reason="no library is made for this system"
)

NO_SOURCES = {"files": [], "hash": hashlib.sha256().hexdigest()}
SYMBOL = prebuilt_kernels.symbol_name(stage_runner.run_list, 0)
LLVM = binding.llvm_version_info[0]
NO_CPU = "x86-64-v9"
"""A level that no CPU reaches."""


def write(path, content):
    """Write a file anew: processes that have opened the old one keep it."""
    path.unlink(missing_ok=True)
    path.write_bytes(content)


def write_index(place, libraries, forms, sources=NO_SOURCES, texts=()):
    """Write what says what is in a folder, given the bytes of libraries by their targets."""
    listed = []
    for target, content in libraries.items():
        name = f"{target.cpu}.so"
        write(place / name, content)
        listed.append([name, hashlib.sha256(content).hexdigest(), *target])
    index = Index("something", sources, listed, forms, [*texts])
    write(place / prebuilt_kernels.INDEX_FILE, prebuilt_kernels.encode_index(index))
    return index


def test_an_index_is_read_as_it_was_written_in_any_order(tmp_path):
    path, forms = tmp_path / prebuilt_kernels.INDEX_FILE, {"b_1": "int", "a_2": "none"}
    index = write_index(tmp_path, {PLATFORM.targets()[0]: b"code"}, forms)
    assert prebuilt_kernels.read_index(path) == index
    other = index._replace(forms=dict(sorted(forms.items())))
    assert prebuilt_kernels.encode_index(other) == path.read_bytes()


def test_every_damaged_byte_is_found(tmp_path):
    write_index(tmp_path, {PLATFORM.targets()[0]: b"code"}, {"a": "int"})
    index, library = tmp_path / prebuilt_kernels.INDEX_FILE, tmp_path / "x86-64-v4.so"
    checksum = hashlib.sha256(b"code").hexdigest()
    for path, look in (
        (index, prebuilt_kernels.read_index),
        (library, lambda path: prebuilt_kernels.open_library(path, checksum)),
    ):
        content = path.read_bytes()
        for n in range(len(content)):
            for damaged in (content[:n] + bytes([content[n] ^ 16]) + content[n + 1 :], content[:n]):
                path.write_bytes(damaged)
                with pytest.raises(UnusableError, match="is damaged"):
                    look(path)
        path.write_bytes(content)
    prebuilt_kernels.read_index(index)
    with pytest.raises(OSError, match="x86-64-v4"):
        prebuilt_kernels.open_library(library, checksum)


# Levels of CPUs.

V2 = {"cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3"}
V3 = V2 | {"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"}
V4 = V3 | {"avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"}
LEVELS = {2: V2, 3: V3, 4: V4}
"""Features of the levels of x86-64, as LLVM calls them."""

EMULATED = {
    "core2duo": 1, "Nehalem": 2, "Nehalem,-popcnt": 1, "IvyBridge": 2, "Haswell": 3,
    "Haswell,-movbe": 2, "Haswell,-bmi2": 2, "Haswell,-abm": 2, "Haswell,-xsave": 2, "EPYC": 3,
}  # fmt: skip
"""Levels of CPUs that QEMU knows."""

ASK = """
import ctypes, sys
print([getattr(ctypes.CDLL(path), "rasterjit_runs")() for path in sys.argv[1:]])
"""


@pytest.fixture(scope="module")
def levels(tmp_path_factory):
    """Libraries without kernels that tell whether a CPU has a level, by its number."""
    place = tmp_path_factory.mktemp("levels")
    found = {}
    for level in LEVELS:
        target = Target(PLATFORM.triple, f"x86-64-v{level}", "")
        found[level] = place / f"{level}.so"
        found[level].write_bytes(shared_libraries.link(target, found[level].name, []))
    return found


@needs_library
@pytest.mark.skipif(HERE is not PLATFORM, reason="levels of x86-64")
def test_a_library_runs_where_the_cpu_has_the_features_of_its_level(levels):
    from llvmlite import binding

    here = {name for name, has in binding.get_host_cpu_features().items() if has}
    for level, path in levels.items():
        assert ctypes.CDLL(str(path)).rasterjit_runs() == (LEVELS[level] <= here)


@needs_library
@pytest.mark.takes_long
@pytest.mark.skipif(HERE is not PLATFORM, reason="levels of x86-64")
@pytest.mark.skipif(not shutil.which("qemu-x86_64-static"), reason="QEMU is not installed")
@pytest.mark.parametrize("cpu", EMULATED)
def test_a_library_runs_on_no_cpu_that_lacks_a_feature(levels, cpu):
    words = ["qemu-x86_64-static", "-cpu", cpu, sys.executable, "-S", "-c", ASK]
    done = subprocess.run(
        [*words, *map(str, levels.values())], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == str([int(level <= EMULATED[cpu]) for level in levels])


def test_triples_of_a_system_have_its_platform_whatever_else_they_say():
    for triple, name in {
        "x86_64-conda-linux-gnu": "x86_64", "aarch64-unknown-linux-gnu": "aarch64",
        "x86_64-pc-windows-msvc": "win_amd64", "aarch64-pc-windows-msvc": "win_arm64",
        "arm64-apple-darwin": "macos_arm64",
        "aarch64-apple-macosx14.1": "macos_arm64", "x86_64-apple-darwin23.1.0": "macos_x86_64",
    }.items():  # fmt: skip
        assert targets.find_platform(triple) is targets.PLATFORMS[name]
        assert targets.needs_far_addresses(triple) == ("linux" in triple or name == "win_amd64")
    for triple in ("riscv64-unknown-linux-gnu", "x86_64-unknown-freebsd"):
        assert targets.find_platform(triple) is None
        assert not targets.needs_far_addresses(triple)


@pytest.mark.parametrize("level", PLATFORM.levels, ids=lambda level: level.cpu)
def test_a_level_that_the_user_names_is_the_shipped_one(monkeypatch, level):
    from llvmlite import binding

    monkeypatch.setattr(binding, "get_process_triple", lambda: PLATFORM.triple)
    monkeypatch.setattr(targets, "host", targets.host.__wrapped__)
    monkeypatch.setenv("NUMBA_CPU_NAME", level.cpu)
    for features in (None, ""):
        if features is not None:
            monkeypatch.setenv("NUMBA_CPU_FEATURES", features)
        assert targets.requested_cpu_name() == level.cpu
        assert targets.host() == (PLATFORM.triple, level.cpu, level.features)
    monkeypatch.setenv("NUMBA_CPU_FEATURES", "+sse4a")
    assert targets.requested_cpu_name() is None
    assert targets.host() == (PLATFORM.triple, level.cpu, "+sse4a")


def test_an_empty_name_of_a_cpu_asks_for_none(monkeypatch):
    monkeypatch.delenv("NUMBA_CPU_FEATURES", raising=False)
    monkeypatch.setenv("NUMBA_CPU_NAME", "")
    assert targets.requested_cpu_name() == ""
    monkeypatch.setenv("NUMBA_CPU_FEATURES", "")
    assert targets.requested_cpu_name() is None


# What came.


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """Given a CPU, a target of this system and a library of a raw kernel for it."""
    place = tmp_path_factory.mktemp("library")

    def make(cpu=HERE.levels[-1].cpu):
        target = Target(HERE.triple, cpu, "")
        compiled_for = target._replace(cpu=HERE.levels[-1].cpu)
        kernel, path = stage_runner.run_list, place / f"{cpu}.o"
        _, text = shared_libraries.optimized_text(kernel, kernel.declared[0], SYMBOL, compiled_for)
        path.write_bytes(shared_libraries.object_code(text, SYMBOL, compiled_for))
        return target, shared_libraries.link(target, f"{cpu}.so", [path])

    return make


@pytest.fixture
def come(tmp_path, monkeypatch, library):
    """A function that lets code come with the installation; there is a store, and it is empty."""
    monkeypatch.setattr(store, "PRINTED_SUBJECTS", set())
    monkeypatch.setattr(store, "UNUSABLE_REASONS", [])
    monkeypatch.setattr(prebuilt_kernels, "FOLDER", tmp_path)
    for name in ("_try_read_index", "find_library", "find_texts"):
        monkeypatch.setattr(prebuilt_kernels, name, getattr(prebuilt_kernels, name).__wrapped__)
    for name in targets.CPU_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    place = tmp_path / "store"
    place.mkdir(mode=0o700)
    monkeypatch.setattr(store, "kernel_folder", lambda: place)

    def let_come(*cpus, forms=(SYMBOL,), sources=NO_SOURCES):
        libraries = dict(map(library, cpus)) if cpus else dict([library()])
        write_index(tmp_path, libraries, dict.fromkeys(forms, "int"), sources)
        return tmp_path / f"{next(iter(libraries)).cpu}.so"

    return let_come


def load():
    return store.load(stage_runner.run_list, stage_runner.run_list.declared[0]).is_loaded


@needs_library
@pytest.mark.skipif(HERE is not PLATFORM, reason="levels of x86-64")
def test_the_best_level_that_the_cpu_has_is_taken_or_the_one_asked_for(come, monkeypatch):
    come(NO_CPU, "x86-64-v2", "x86-64-v1")
    assert prebuilt_kernels.find_library().library.target.cpu == "x86-64-v2"
    monkeypatch.setenv("NUMBA_CPU_NAME", "x86-64-v1")
    assert prebuilt_kernels.find_library().library.target.cpu == "x86-64-v1"
    for name, value in (("NUMBA_CPU_NAME", "another"), ("NUMBA_CPU_FEATURES", "+avx")):
        monkeypatch.setenv(name, value)
        assert prebuilt_kernels.find_library() == (None, None)
    monkeypatch.delenv("NUMBA_CPU_NAME")
    monkeypatch.delenv("NUMBA_CPU_FEATURES")
    come(NO_CPU)
    assert prebuilt_kernels.find_library() == (None, None)


@needs_library
def test_what_came_is_loaded_and_no_folder_is_looked_for(come, monkeypatch, capfd):
    come()
    monkeypatch.setattr(store, "has_linker", lambda: pytest.fail("it is not needed"))
    monkeypatch.setattr(store, "kernel_folder", lambda: pytest.fail("it is not needed"))
    assert load()
    assert store.is_stored(stage_runner.run_list, stage_runner.run_list.declared[0])
    assert background_compile.make_compile_tasks([stage_runner.run_list]) == []
    assert capfd.readouterr().err == ""
    (finding,) = doctor._check_prebuilt_kernels()
    assert finding.passed
    assert "1 forms" in finding.text


def code_of(path):
    """Return the index and the bytes of a library that was written."""
    return prebuilt_kernels.read_index(
        path.with_name(prebuilt_kernels.INDEX_FILE)
    ), path.read_bytes()


def let_be(path, content=None, **changes):
    """Write a library with other content or another index, both in good order by themselves."""
    index, old = code_of(path)
    index = index._replace(**changes)
    target = Target(*index.libraries[0][2:])
    content = old if content is None else content
    write_index(path.parent, {target: content}, index.forms, index.sources)


STRANGE = next(one for one in targets.PLATFORMS.values() if one is not HERE).targets()[-1]

EDITED = {"files": ["__init__.py"], "hash": "of another text"}

DAMAGES = {
    "code": lambda path: write(path, path.read_bytes()[:-9] + b"?" + path.read_bytes()[-8:]),
    "cut off": lambda path: write(path, path.read_bytes()[:500]),
    "empty": lambda path: write(path, b""),
    "missing": Path.unlink,
    "no library": lambda path: let_be(path, b"no machine code"),
    "another machine's": lambda path: let_be(path, shared_libraries.link(STRANGE, path.name, [])),
    "index": lambda path: write(path.with_name("index"), b"?"),
    "no index": lambda path: path.with_name("index").unlink(),
    "other sources": lambda path: let_be(path, sources=EDITED),
    "no source": lambda path: let_be(path, sources={**EDITED, "files": ["no_such_file.py"]}),
    "no form": lambda path: let_be(path, forms={}),
}


REFUSED = ("no library", "another machine's")
"""Damages that the system finds; to install again is no remedy."""


def names(line, path):
    """Tell whether a line names a library, its index or the source that is missing."""
    return any(text in line for text in (str(path), str(path.with_name("index")), "no_such_file"))


@needs_library
@pytest.mark.parametrize("damage", DAMAGES)
def test_what_is_of_no_use_is_named_and_compiled_anew(come, damage, capfd):
    path = come()
    DAMAGES[damage](path)
    assert not store.is_stored(stage_runner.run_list, stage_runner.run_list.declared[0])
    assert [load(), load()] == [False, True]
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("rasterjit: compiling instead of loading: ")
    assert names(line, path)
    assert (prebuilt_kernels.REINSTALL in line) == (damage not in REFUSED)
    if damage != "no form":
        assert any(finding.passed is False for finding in doctor._check_prebuilt_kernels())


@needs_library
@pytest.mark.parametrize("lacking", ["numba", "llvmlite"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_without_a_compiler_an_error_names_what_is_of_no_use(
    come, damage, lacking, capfd, monkeypatch
):
    monkeypatch.setattr(store, "compiler_versions", lambda: None)
    if lacking == "llvmlite":
        monkeypatch.setattr(store, "has_linker", lambda: False)
        monkeypatch.setattr(store, "host", lambda: pytest.fail("it imports llvmlite"))
    path = come()
    DAMAGES[damage](path)
    kind = stage_runner.run_list.declared[0]
    assert not store.is_stored(stage_runner.run_list, kind)
    with pytest.raises(store.NoCompilerError, match="pip install numba") as caught:
        load()
    assert names(str(caught.value), path)
    assert (prebuilt_kernels.REINSTALL in str(caught.value)) == (damage not in REFUSED)
    assert capfd.readouterr().err == ""


# LLVM's text, where no library came.


@pytest.fixture
def let_text_come(come):
    """A function that lets a kernel's text come alone, for levels; it returns the files."""
    path, (kind, (best, *_)) = come(), targets.find_host_levels()
    kernel, target = stage_runner.run_list, Target(store.host().triple, best.cpu, best.features)
    returns, lowered = shared_libraries.optimized_text(kernel, kernel.declared[0], SYMBOL, target)

    def let_come(*cpus, text=lowered, llvm=LLVM):
        files, rows = [], []
        for cpu in cpus or (best.cpu,):
            files.append(path.with_name(f"{cpu}.ll.xz"))
            files[-1].write_bytes(prebuilt_kernels.pack_texts({SYMBOL: text}))
            checksum = hashlib.sha256(files[-1].read_bytes()).hexdigest()
            rows.append([files[-1].name, checksum, kind, cpu, str(llvm)])
        write_index(path.parent, {}, {SYMBOL: returns}, texts=rows)
        return files

    return let_come


@pytest.fixture
def text(let_text_come):
    """The file of a kernel's text for this CPU, which came alone."""
    (file,) = let_text_come()
    return file


@needs_library
@pytest.mark.parametrize("is_numba_here", [True, False])
def test_text_that_came_becomes_code_without_numba_and_is_stored(
    text, monkeypatch, capfd, is_numba_here
):
    monkeypatch.setattr(isolated_numba, "compiler", lambda: pytest.fail("it imports Numba"))
    if not is_numba_here:
        monkeypatch.setattr(store, "compiler_versions", lambda: None)
    assert [load(), load()] == [False, True]
    assert capfd.readouterr().err == ""
    (finding,) = doctor._check_prebuilt_kernels()
    assert finding.passed
    assert f"{targets.find_host_levels()[1][0].cpu}, 1 forms" in finding.text


@needs_library
def test_text_gives_the_code_that_python_gives(text):
    kernel, name, target = stage_runner.run_list, "made", store.host()
    compiler, index = isolated_numba.compiler(), prebuilt_kernels.find_texts().lowered
    _, (level, *_) = targets.find_host_levels()
    asked = Target(target.triple, level.cpu, level.features)
    from_python = compiler.compile_form(kernel, kernel.declared[0], name, asked)[1]
    made = code_generation.generate_from_text(index.texts[SYMBOL], SYMBOL, name, asked)
    assert made == from_python


@needs_library
@pytest.mark.parametrize("damage", ["damaged", "cut off", "missing", "no lzma"])
def test_text_of_no_use_is_named_and_python_compiled(text, monkeypatch, capfd, damage):
    content = text.read_bytes()
    if damage == "missing":
        text.unlink()
    elif damage == "no lzma":
        monkeypatch.setitem(sys.modules, "lzma", None)
    else:
        write(text, content[:40] if damage == "cut off" else content[:-1] + b"?")
    assert [load(), load()] == [False, True]
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"rasterjit: compiling instead of loading: {text}")
    assert [one.passed for one in doctor._check_prebuilt_kernels()] == [False]


@needs_library
@pytest.mark.parametrize("has_numba", [True, False])
@pytest.mark.parametrize(
    ("options", "words"),
    [({"llvm": LLVM + 1}, f"LLVM {LLVM + 1}, and here is"), ({"text": "define what"}, SYMBOL)],
    ids=["newer", "unknown"],
)
def test_text_that_this_llvm_cannot_read_is_named_and_python_compiled(
    let_text_come, monkeypatch, capfd, options, words, has_numba
):
    let_text_come(**options)
    if has_numba:
        assert [load(), load()] == [False, True]
        (line,) = capfd.readouterr().err.splitlines()
        assert line.startswith("rasterjit: compiling instead of loading: ")
        assert words in line
    else:
        monkeypatch.setattr(store, "compiler_versions", lambda: None)
        with pytest.raises(store.NoCompilerError, match=words):
            load()


@needs_library
@pytest.mark.skipif(HERE is not PLATFORM, reason="levels of x86-64")
def test_past_damaged_text_that_of_the_next_level_is_used(let_text_come, monkeypatch, capfd):
    monkeypatch.setattr(isolated_numba, "compiler", lambda: pytest.fail("it imports Numba"))
    _, levels = targets.find_host_levels()
    if len(levels) < 2:
        pytest.skip("this CPU has one level alone")
    monkeypatch.setattr(store, "compiler_versions", lambda: None)
    first, second = let_text_come(levels[0].cpu, levels[1].cpu)
    write(first, b"?")
    assert [load(), load()] == [False, True]
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"rasterjit: compiling LLVM's text for {levels[1].cpu}: {first}")
    assert prebuilt_kernels.find_texts().lowered.path == second


@needs_library
def test_text_of_another_kind_of_cpu_is_left_alone(text, monkeypatch):
    monkeypatch.setattr(targets, "process_triple", lambda: "riscv64-unknown-linux-gnu")
    assert prebuilt_kernels.find_texts() == (None, None)


def test_a_check_of_text_makes_what_a_build_makes(tmp_path, monkeypatch, capsys):
    """Stand-ins of compiled text show that a build and a check write the same index."""

    def compile_all(platforms, place, is_text_alone):
        kinds = [(targets.split_triple(one.triple)[0], one) for one in platforms]
        return {
            (kind, level.cpu): SimpleNamespace(
                forms=lambda: {"a": "int"}, texts=lambda cpu=level.cpu: {"a": cpu}
            )
            for kind, platform in kinds
            for level in platform.levels
        }

    monkeypatch.setattr(wheels, "compile_all", compile_all)
    monkeypatch.setattr(wheels, "made_with", lambda: "something")
    monkeypatch.setattr(wheels, "sources", lambda: NO_SOURCES)
    monkeypatch.setattr(prebuilt_kernels, "FOLDER", tmp_path)
    names = ("macos_x86_64", "aarch64"), tuple(targets.PLATFORMS)
    for count, chosen in zip((3, 4), names, strict=True):
        files = wheels.text_files_of([targets.PLATFORMS[name] for name in chosen])
        assert len(files) == count + 1
        for name, content in files.items():
            write(tmp_path / name, content)
        assert wheels.check(), capsys.readouterr().out


@needs_library
@pytest.mark.skipif(HERE is not PLATFORM, reason="levels of x86-64")
@pytest.mark.parametrize("damage", ["damaged", "missing", "refused"])
def test_past_a_library_of_no_use_the_next_level_is_loaded(come, damage, capfd):
    path = come("x86-64-v2", "x86-64-v1")
    if damage == "damaged":
        write(path, b"?")
    elif damage == "missing":
        path.unlink()
    else:
        index, _ = code_of(path)
        first, second = (Target(*target) for _, _, *target in index.libraries)
        good = path.with_name("x86-64-v1.so").read_bytes()
        write_index(path.parent, {first: b"no code", second: good}, index.forms)
    assert [load(), load()] == [True, True]
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"rasterjit: loading code for x86-64-v1: {path}")
    assert (prebuilt_kernels.REINSTALL in line) == (damage != "refused")
    assert [one.passed for one in doctor._check_prebuilt_kernels()] == [False, True]


@pytest.mark.parametrize(
    "change",
    [
        {"forms": None}, {"another": 1}, {"forms": ["a"]}, {"sources": {"files": []}},
        {"sources": {"files": 3, "hash": ""}}, {"sources": None}, {"libraries": [["a.so", "0"]]},
        {"libraries": 3}, {"libraries": [[3, "0", "triple", "cpu", ""]]}, {"texts": [["a", "0"]]},
        {"texts": None}, "no JSON", "[]",
    ],
    ids=str,
)  # fmt: skip
def test_an_index_of_other_fields_is_of_no_use(tmp_path, monkeypatch, change):
    index = write_index(tmp_path, {PLATFORM.targets()[0]: b"code"}, {"a": "int"})
    text = change if isinstance(change, str) else json.dumps({**index._asdict(), **change})
    checksum = hashlib.sha256(text.encode()).hexdigest()
    write(tmp_path / prebuilt_kernels.INDEX_FILE, f"{checksum}\n{text}".encode())
    monkeypatch.setattr(prebuilt_kernels, "FOLDER", tmp_path)
    monkeypatch.setattr(
        prebuilt_kernels, "_try_read_index", prebuilt_kernels._try_read_index.__wrapped__
    )
    library, problem = prebuilt_kernels.find_library.__wrapped__()
    assert library is None
    assert f"{tmp_path / prebuilt_kernels.INDEX_FILE} has other fields" in problem
    assert prebuilt_kernels.REINSTALL in problem


WITHOUT_LLVM = """
import sys
sys.modules.update(dict.fromkeys(("llvmlite", "numba")))
from click.testing import CliRunner
from rasterjit.cli import commands
for words in sys.argv[1:]:
    done = CliRunner().invoke(commands.program, words.split())
    print(done.exit_code, done.output)
"""


@compiled_only
def test_without_llvmlite_and_shipped_code_commands_say_what_is_missing(tmp_path):
    picture = tmp_path / "picture.png"
    words = ["doctor", f"render {TESTS.parent / 'models' / 'teapot.obj'} -o {picture}"]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_LLVM, *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("must be compiled, which needs Numba: pip install numba") >= 3
    assert "ModuleNotFoundError" not in done.stdout + done.stderr
    assert not picture.exists()


@needs_library
def test_where_all_came_warmup_compiles_nothing_and_needs_no_folder(come, monkeypatch):
    come()
    monkeypatch.setattr(background_compile, "find_every_kernel", lambda: [stage_runner.run_list])
    monkeypatch.setattr(store, "kernel_folder", lambda: pytest.fail("it is not needed"))
    done = CliRunner().invoke(commands.program, ["warmup"])
    assert (done.exit_code, done.output.partition(":")[0]) == (0, "nothing to compile")


@needs_library
@pytest.mark.parametrize("has_come", [True, False])
def test_doctor_asks_for_a_folder_only_where_something_is_compiled(come, monkeypatch, has_come):
    if has_come:
        come()
    else:
        monkeypatch.setattr(
            prebuilt_kernels, "find_library", lambda: prebuilt_kernels.LibrarySearch(None, None)
        )
    monkeypatch.setattr(store, "kernel_folder", lambda: None)
    monkeypatch.setattr(store, "USED_KERNELS", store.UsedKernels([], []))
    (finding,) = doctor._check_store()
    assert finding.passed is (None if has_come else False)


def test_where_nothing_lacks_no_process_starts(monkeypatch):
    monkeypatch.setattr(background_compile, "available_processors", lambda: 2)
    monkeypatch.setattr(
        background_compile, "can_start_process", lambda: pytest.fail("nobody need know")
    )
    with background_compile.compile_in_background(list, at_once=True):
        pass


IN_A_FRESH_PROCESS = """
import json
from rasterjit.runtime import background_compile
kernels = background_compile.find_every_kernel()
print(json.dumps([(one.__module__, one.__name__) for one in kernels]))
"""


@compiled_only
def test_the_list_of_every_kernel_has_those_that_nobody_imported():
    done = subprocess.run(
        [sys.executable, "-c", IN_A_FRESH_PROCESS], capture_output=True, text=True, check=True
    )
    kinds = (jit.Kernel, jit.Stage, jit.RawKernel)
    wanted = {
        (module, name)
        for module in kernel_modules()
        for name, one in vars(importlib.import_module(module)).items()
        if isinstance(one, kinds) and one.__module__ == module
    }
    found = [tuple(one) for one in json.loads(done.stdout)]
    assert len(found) == len({*found}) > 100
    assert {*found} == wanted
    own = [one for one in (*jit.KERNELS, *jit.STAGES) if one.__module__.startswith("rasterjit.")]
    assert wanted >= {(one.__module__, one.__name__) for one in own}


def pure_wheel(place, source="", **others):
    """Write the smallest wheel there is, with a source and others in `cli`; return its path."""
    path = place / "rasterjit-9-py3-none-any.whl"
    about = "Wheel-Version: 1.0\nGenerator: x\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in {
            "rasterjit/__init__.py": source, "rasterjit-9.dist-info/WHEEL": about,
            "rasterjit-9.dist-info/RECORD": "rasterjit/__init__.py,,\n",
            **{f"rasterjit/cli/{name}.c": text for name, text in others.items()},
        }.items():  # fmt: skip
            archive.writestr(zipfile.ZipInfo(name, (2020, 2, 2, 0, 0, 0)), text)
    return path


def test_a_platform_s_wheel_is_the_pure_one_with_machine_code(tmp_path):
    packs = {"b.so": b"2", "a.so": b"1"}
    pure = pure_wheel(tmp_path)
    made = wheels.make_wheel(pure, PLATFORM, packs)
    assert made.name == f"rasterjit-9-py3-none-{PLATFORM.tag}.whl"
    content = made.read_bytes()
    assert wheels.make_wheel(pure, PLATFORM, dict(sorted(packs.items()))) == made
    assert made.read_bytes() == content
    with zipfile.ZipFile(made) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    assert files["rasterjit/machine_code/b.so"] == b"2"
    assert files["rasterjit/__init__.py"] == b""
    about = files["rasterjit-9.dist-info/WHEEL"].decode()
    assert about.count("Tag: py3-none-manylinux") == 2
    assert "Root-Is-Purelib: false\n" in about
    assert "any" not in about.replace("manylinux", "")
    rows = list(csv.reader(io.StringIO(files["rasterjit-9.dist-info/RECORD"].decode())))
    assert [name for name, *_ in rows] == list(files)
    for name, checksum, size in rows[:-1]:
        digest = base64.urlsafe_b64encode(hashlib.sha256(files[name]).digest()).decode()
        assert (checksum, int(size)) == ("sha256=" + digest.rstrip("="), len(files[name]))
    with pytest.raises(ValueError, match="py3-none-any"):
        wheels.make_wheel(made, PLATFORM, packs)


def test_a_wheel_that_cannot_be_written_leaves_nothing(tmp_path, monkeypatch):
    pure = pure_wheel(tmp_path)
    made = wheels.make_wheel(pure, PLATFORM, {})
    before = made.read_bytes()
    entries = iter("ab")
    monkeypatch.setattr(zipfile.ZipFile, "writestr", lambda *_: next(entries))
    with pytest.raises(StopIteration):
        wheels.make_wheel(pure, PLATFORM, {"a.so": b"1"})
    assert {*tmp_path.iterdir()} == {pure, made}
    assert made.read_bytes() == before


def test_a_wheel_of_other_sources_gets_no_machine_code(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(jit, "DISABLED", False)
    monkeypatch.setattr(jit, "CHECKED", False)
    monkeypatch.setattr(wheels, "files_of", lambda platforms: [{"a.so": b"code"}])
    ours, own_code = Path(rj.__file__).read_text(), shared_libraries.OWN_CODE.read_text()
    for source, library, differs in (
        ("edited", own_code, "rasterjit/__init__.py"),
        (ours, "edited", "rasterjit/cli/library.c"),
        (ours, own_code, None),
    ):
        wheel = pure_wheel(tmp_path, source, library=library)
        assert wheels.main([str(wheel), "x86_64"]) == (2 if differs else 0)
        said = capsys.readouterr().err
        assert f"1 files differ, {differs} first" in said if differs else not said
        assert len(list(tmp_path.iterdir())) == (1 if differs else 2)


@compiled_only
def test_without_a_linker_nothing_is_compiled(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ziglang", None)
    monkeypatch.setattr(wheels, "files_of", lambda platforms: pytest.fail("it takes minutes"))
    for words in (["check"], [str(pure_wheel(tmp_path)), "x86_64"]):
        assert wheels.main(words) == 2
        assert 'ziglang: pip install "rasterjit[wheels]"' in capsys.readouterr().err


@pytest.mark.parametrize("triples", [[], ["riscv64-unknown-linux-gnu"]])
def test_a_check_of_an_unknown_platform_says_which_are_known(
    tmp_path, monkeypatch, capsys, triples
):
    write_index(tmp_path, {Target(one, "a", ""): b"" for one in triples}, {})
    monkeypatch.setattr(prebuilt_kernels, "FOLDER", tmp_path)
    assert not wheels.check()
    said = capsys.readouterr().out
    assert f"is for {triples}, but must be for one of" in said
    assert PLATFORM.triple in said


@needs_library
def test_a_check_tells_the_same_bytes_from_others_and_from_none(come, monkeypatch, capsys):
    path = come()
    files = {one.name: one.read_bytes() for one in path.parent.iterdir() if one.is_file()}
    for name, installed, words in (
        (path.name, files[path.name], "the same bytes"), (path.name, b"others", "other bytes"),
        (path.name, None, "other bytes"), ("index", files["index"] + b" ", "damaged"),
        ("index", None, "no machine code"),
    ):  # fmt: skip
        for one, content in {**files, name: installed}.items():
            (path.parent / one).unlink(missing_ok=True)
            if content is not None:
                write(path.parent / one, content)
        monkeypatch.setattr(wheels, "files_of", lambda platforms: [files])
        assert wheels.check() == (words == "the same bytes")
        assert words in capsys.readouterr().out


def test_the_sources_of_the_kernels_are_hashed_as_one_and_an_edit_is_seen(tmp_path, monkeypatch):
    monkeypatch.setattr(background_compile, "find_every_kernel", lambda: [stage_runner.run_list])
    found = wheels.sources()
    assert {"runtime/stage_runner.py", "runtime/compiler.py"} <= {*found["files"]}
    assert "runtime/store.py" not in found["files"]
    for name in found["files"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(store.ROOT / name, tmp_path / name)
    monkeypatch.setattr(prebuilt_kernels, "ROOT", tmp_path)
    assert prebuilt_kernels.hash_sources(found["files"]) == found["hash"]
    with (tmp_path / "runtime" / "stage_runner.py").open("a") as file:
        file.write("\n")
    assert prebuilt_kernels.hash_sources(found["files"]) != found["hash"]


@needs_library
@pytest.mark.takes_long
@pytest.mark.skipif(HERE is not PLATFORM, reason="a wheel of another platform")
@pytest.mark.parametrize("make", [wheels.files_of, wheels.text_files_of])
def test_all_frames_are_drawn_from_what_came_without_a_compiler(tmp_path, make):
    copy = tmp_path / "rasterjit"
    shutil.copytree(Path(rj.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    target = PLATFORM.targets()[-1]
    (copy / "machine_code").mkdir()
    files = make([PLATFORM._replace(levels=PLATFORM.levels[-1:])])
    files = files if isinstance(files, dict) else files[0]
    assert len(files) == 2
    for name, content in files.items():
        (copy / "machine_code" / name).write_bytes(content)
        assert len(content) < 2 << 20
    program = TESTS / "hard_cases" / "shipped_frames.py"
    # A library needs no folder.
    folder = str(tmp_path / "kernels") if make is wheels.text_files_of else "/dev/null/x"
    done = subprocess.run(
        [sys.executable, str(program), str(tmp_path)], capture_output=True, text=True, check=False,
        env={**os.environ, "NUMBA_CPU_NAME": target.cpu, store.FOLDER_VARIABLE: folder},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert done.stdout.endswith(f"{target.cpu}; threads: 1\n")
