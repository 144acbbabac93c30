"""Machine code that came with the installation is used, and what is wrong with it is found."""

from __future__ import annotations

import base64
import csv
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

import pytest
from click.testing import CliRunner
from kernel_files import kernel_modules

import rasterjit as rj
from rasterjit.cli import commands, doctor, wheels
from rasterjit.runtime import (
    background_compile,
    jit,
    prebuilt_kernels,
    stage_runner,
    store,
    targets,
)
from rasterjit.runtime.prebuilt_kernels import UnfitError

compiled_only = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="no machine code of ours")

TESTS = Path(__file__).parents[1]
PLATFORM = targets.PLATFORMS["x86_64"]
V4, V3, V2 = PLATFORM.levels
FORMS = {"b_1": ("int", b"second"), "a_2": ("none", b"first")}


def write_pack(place, forms, target=None):
    """Write a file of machine code, of this machine if no target is given; return its path."""
    target = target or store.host()
    path = place / prebuilt_kernels.file_name(target)
    path.write_bytes(prebuilt_kernels.content_of(path.name, target, "something", forms))
    return path


def test_a_file_gives_what_was_written_in_any_order(tmp_path):
    path = write_pack(tmp_path, FORMS, PLATFORM.targets()[0])
    pack = prebuilt_kernels.read(path)
    assert (pack.target, pack.made_with, sorted(pack.forms)) == (
        PLATFORM.targets()[0], "something", sorted(FORMS)
    )  # fmt: skip
    assert {name: pack.code(name) for name in FORMS} == FORMS
    assert pack.damaged() == []
    other = prebuilt_kernels.content_of(
        path.name, pack.target, "something", dict(sorted(FORMS.items()))
    )
    assert other == pack.content
    with pytest.raises(UnfitError, match="other sources"):
        pack.code("c_3")


def is_damaged(path):
    """Tell whether the damage of a file shows, in its table or in a form."""
    try:
        return bool(prebuilt_kernels.read(path).damaged())
    except UnfitError:
        return True


def test_every_damaged_byte_is_found(tmp_path):
    path = write_pack(tmp_path, FORMS, PLATFORM.targets()[0])
    content = path.read_bytes()
    for n in range(len(content)):
        path.write_bytes(content[:n] + bytes([content[n] ^ 16]) + content[n + 1 :])
        assert is_damaged(path), n
        path.write_bytes(content[:n])
        assert is_damaged(path), n
    path.write_bytes(content)
    assert not is_damaged(path)


def test_a_file_under_another_s_name_is_damaged(tmp_path):
    path = write_pack(tmp_path, FORMS, PLATFORM.targets()[0])
    with pytest.raises(UnfitError, match="damaged"):
        prebuilt_kernels.read(path.rename(tmp_path / "x86-64-v2.kernels"))


@pytest.mark.parametrize(
    ("features", "cpu"),
    [
        (targets.X86_64_V4 | {"amx-tile"}, "x86-64-v4"), (targets.X86_64_V3, "x86-64-v3"),
        (targets.X86_64_V4 - {"avx512vl"}, "x86-64-v3"), (targets.X86_64_V2, "x86-64-v2"),
        (targets.X86_64_V4 - {"fma"}, "x86-64-v2"), (targets.X86_64_V2 - {"popcnt"}, None),
    ],
)  # fmt: skip
def test_a_cpu_gets_the_best_level_whose_features_it_has(features, cpu):
    for triple in ("x86_64-unknown-linux-gnu", "x86_64-conda-linux-gnu"):
        found = targets.best_target(triple, frozenset(features))
        assert (found and found.cpu) == cpu
    for triple in ("x86_64-apple-darwin23", "x86_64-pc-windows-msvc", "riscv64-unknown-linux-gnu"):
        assert targets.best_target(triple, frozenset(features)) is None


@pytest.mark.parametrize("level", PLATFORM.levels, ids=lambda level: level.cpu)
def test_a_level_that_the_user_names_is_the_shipped_one(monkeypatch, level):
    from llvmlite import binding

    monkeypatch.setattr(binding, "get_process_triple", lambda: PLATFORM.triple)
    monkeypatch.setattr(targets, "host", targets.host.__wrapped__)
    monkeypatch.setenv("NUMBA_CPU_NAME", level.cpu)
    for features in (None, ""):
        if features is not None:
            monkeypatch.setenv("NUMBA_CPU_FEATURES", features)
        assert targets.shipped_target() == (PLATFORM.triple, level.cpu, level.features)
    monkeypatch.setenv("NUMBA_CPU_FEATURES", "+sse4a")
    assert targets.shipped_target() is None
    assert targets.host() == (PLATFORM.triple, level.cpu, "+sse4a")


def test_an_empty_name_of_a_cpu_asks_for_none(monkeypatch):
    from llvmlite import binding

    monkeypatch.setattr(binding, "get_process_triple", lambda: PLATFORM.triple)
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: dict.fromkeys(V3.needs, True))
    monkeypatch.delenv("NUMBA_CPU_FEATURES", raising=False)
    monkeypatch.setenv("NUMBA_CPU_NAME", "")
    assert targets.shipped_target() == PLATFORM.targets()[1]


@pytest.fixture
def code():
    """The name and the object code of a raw kernel, for this machine."""
    target, (kind,) = store.host(), stage_runner.run_list.declared
    name = store.name_of(stage_runner.run_list, kind, target)
    from rasterjit.runtime import compiler

    return name, compiler.compile_form(stage_runner.run_list, kind, name, target)


@pytest.fixture
def come(tmp_path, monkeypatch):
    """A function that lets forms come with the installation; there is a store, and it is empty."""
    monkeypatch.setattr(store, "SAID", set())
    monkeypatch.setattr(store, "UNFIT", [])
    monkeypatch.setattr(prebuilt_kernels, "FOLDER", tmp_path)
    monkeypatch.setattr(prebuilt_kernels, "shipped_target", store.host)
    monkeypatch.setattr(prebuilt_kernels, "found", prebuilt_kernels.found.__wrapped__)
    place = tmp_path / "store"
    place.mkdir(mode=0o700)
    monkeypatch.setattr(store, "folder", lambda: place)
    return lambda forms: write_pack(tmp_path, forms)


def load():
    return store.load(stage_runner.run_list, stage_runner.run_list.declared[0]).is_loaded


@compiled_only
def test_what_came_is_loaded_and_no_folder_is_looked_for(come, code, monkeypatch, capfd):
    come(dict([code]))
    monkeypatch.setattr(store, "folder", lambda: pytest.fail("it is not needed"))
    assert load()
    assert store.is_kept(stage_runner.run_list, stage_runner.run_list.declared[0])
    assert background_compile.compiling([stage_runner.run_list]) == []
    assert capfd.readouterr().err == ""
    (finding,) = doctor._check_prebuilt_kernels()
    assert finding.passed
    assert "1 forms" in finding.text


def damage_code(path):
    content = path.read_bytes()
    path.write_bytes(content[:-9] + b"?" + content[-8:])


def damage_table(path):
    path.write_bytes(path.read_bytes().replace(b"something", b"anything!"))


DAMAGES = {
    "code": damage_code,
    "table": damage_table,
    "empty": lambda path: path.write_bytes(b""),
    "missing": Path.unlink,
    "other sources": lambda path: write_pack(path.parent, FORMS),
}


@compiled_only
@pytest.mark.parametrize("damage", DAMAGES)
def test_what_is_of_no_use_is_named_and_compiled_anew(come, code, damage, capfd):
    path = come(dict([code]))
    DAMAGES[damage](path)
    assert not store.is_kept(stage_runner.run_list, stage_runner.run_list.declared[0])
    assert [load(), load()] == [False, True]
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("rasterjit: compiling instead of loading: ")
    assert str(path) in line
    assert prebuilt_kernels.REINSTALL in line
    if damage != "other sources":
        assert any(finding.passed is False for finding in doctor._check_prebuilt_kernels())


@compiled_only
@pytest.mark.parametrize("damage", DAMAGES)
def test_without_numba_an_error_names_what_is_of_no_use(come, code, damage, capfd, monkeypatch):
    monkeypatch.setattr(store, "versions", lambda: None)
    path = come(dict([code]))
    assert load()
    DAMAGES[damage](path)
    with pytest.raises(store.NoCompilerError, match="pip install numba") as caught:
        load()
    assert str(path) in str(caught.value)
    assert prebuilt_kernels.REINSTALL in str(caught.value)
    assert capfd.readouterr().err == ""


@compiled_only
def test_code_that_cannot_be_linked_is_compiled_anew(come, code, capfd):
    name, (returns, content) = code
    come({name: (returns, content[:64])})
    assert not load()
    assert "is no machine code" in capfd.readouterr().err


@compiled_only
def test_llvmlite_that_cannot_link_is_named(come, code, monkeypatch):
    come(dict([code]))
    monkeypatch.setattr(prebuilt_kernels, "LINKING", ("no_such_function",))
    pack, problem = prebuilt_kernels.found()
    assert pack is None
    assert "llvmlite" in problem
    assert "no_such_function" in problem


@compiled_only
def test_where_all_came_warmup_compiles_nothing_and_needs_no_folder(come, code, monkeypatch):
    come(dict([code]))
    monkeypatch.setattr(background_compile, "every_kernel", lambda: [stage_runner.run_list])
    monkeypatch.setattr(store, "folder", lambda: pytest.fail("it is not needed"))
    done = CliRunner().invoke(commands.program, ["warmup"])
    assert (done.exit_code, done.output.partition(":")[0]) == (0, "nothing to compile")


@compiled_only
@pytest.mark.parametrize("has_come", [True, False])
def test_doctor_asks_for_a_folder_only_where_something_is_compiled(come, monkeypatch, has_come):
    if has_come:
        come(FORMS)
    else:
        monkeypatch.setattr(prebuilt_kernels, "found", lambda: prebuilt_kernels.Found(None, None))
    monkeypatch.setattr(store, "folder", lambda: None)
    monkeypatch.setattr(store, "USED", store.Used([], []))
    (finding,) = doctor._check_store()
    assert finding.passed is (None if has_come else False)


def test_where_nothing_lacks_no_process_starts(monkeypatch):
    monkeypatch.setattr(background_compile, "available_processors", lambda: 2)
    monkeypatch.setattr(background_compile, "is_possible", lambda: pytest.fail("nobody need know"))
    with background_compile.beside(list, at_once=True):
        pass


IN_A_FRESH_PROCESS = """
import json
from rasterjit.runtime import background_compile
print(json.dumps([(one.__module__, one.__name__) for one in background_compile.every_kernel()]))
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


def pure_wheel(place, source=""):
    """Write the smallest wheel there is, with a source; return its path."""
    path = place / "rasterjit-9-py3-none-any.whl"
    about = "Wheel-Version: 1.0\nGenerator: x\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in {
            "rasterjit/__init__.py": source, "rasterjit-9.dist-info/WHEEL": about,
            "rasterjit-9.dist-info/RECORD": "rasterjit/__init__.py,,\n",
        }.items():  # fmt: skip
            archive.writestr(zipfile.ZipInfo(name, (2020, 2, 2, 0, 0, 0)), text)
    return path


def test_a_platform_s_wheel_is_the_pure_one_with_machine_code(tmp_path):
    packs = {"b.kernels": b"2", "a.kernels": b"1"}
    pure = pure_wheel(tmp_path)
    made = wheels.make_wheel(pure, PLATFORM, packs)
    assert made.name == f"rasterjit-9-py3-none-{PLATFORM.tag}.whl"
    content = made.read_bytes()
    assert wheels.make_wheel(pure, PLATFORM, dict(sorted(packs.items()))) == made
    assert made.read_bytes() == content
    with zipfile.ZipFile(made) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    assert files["rasterjit/machine_code/b.kernels"] == b"2"
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


def test_a_wheel_of_other_sources_gets_no_machine_code(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(jit, "DISABLED", False)
    monkeypatch.setattr(jit, "CHECKED", False)
    monkeypatch.setattr(wheels, "pack_of", lambda target: b"code")
    for source, status in (("edited", 2), (Path(rj.__file__).read_text(), 0)):
        wheel = pure_wheel(tmp_path, source)
        assert wheels.main([str(wheel), "x86_64"]) == status
        assert ("rasterjit/__init__.py" in capsys.readouterr().err) == (status == 2)
        assert len(list(tmp_path.iterdir())) == (1 if status else 2)


def test_a_check_tells_the_same_bytes_from_others_and_from_none(come, monkeypatch, capsys):
    path = come(FORMS)
    content = path.read_bytes()
    for installed, made, words in (
        (content, content, "the same bytes"), (content, b"others", "other bytes"),
        (content[:-1], content, "other bytes"), (b"", content, "damaged"),
        (None, content, "no machine code"),
    ):  # fmt: skip
        path.unlink(missing_ok=True)
        if installed is not None:
            path.write_bytes(installed)
        monkeypatch.setattr(wheels, "pack_of", lambda target, made=made: made)
        assert wheels.check() == (words == "the same bytes")
        assert words in capsys.readouterr().out


@compiled_only
@pytest.mark.takes_long
@pytest.mark.skipif(
    targets.platform_of(store.host().triple) is not PLATFORM, reason="a wheel of another platform"
)
def test_all_frames_are_drawn_from_what_came_without_numba(tmp_path):
    copy = tmp_path / "rasterjit"
    shutil.copytree(Path(rj.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    target = PLATFORM.targets()[-1]
    (copy / "machine_code").mkdir()
    content = wheels.pack_of(target)
    (copy / "machine_code" / prebuilt_kernels.file_name(target)).write_bytes(content)
    assert len(content) < 2 << 20
    program = TESTS / "hard_cases" / "shipped_frames.py"
    done = subprocess.run(
        [sys.executable, str(program), str(tmp_path)], capture_output=True, text=True, check=False,
        env={**os.environ, "NUMBA_CPU_NAME": target.cpu, store.FOLDER_VARIABLE: "/dev/null/x"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert done.stdout.endswith(f"{target.cpu}\n")
