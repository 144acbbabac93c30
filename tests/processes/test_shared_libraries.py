"""Libraries of every system hold kernels as they should, whatever system makes them."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import pytest

from rasterjit.cli import shared_libraries, wheels
from rasterjit.pipeline.srgb_encoding import encode_rows
from rasterjit.runtime import jit, prebuilt_kernels, stage_runner, targets

pytestmark = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="no machine code of ours")

KERNELS = (stage_runner.run_list, encode_rows)
SYMBOLS = [prebuilt_kernels.symbol_name(one, 0) for one in KERNELS]
TARGETS = {
    target.triple: target
    for platform in targets.PLATFORMS.values()
    for target in platform.targets()[-1:]
}


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    """The object files of the kernels, by the triples they are for."""
    files = {}
    for kind in ("x86_64", "aarch64"):
        place = tmp_path_factory.mktemp(kind)
        same = [one for one in TARGETS.values() if targets.split_triple(one.triple)[0] == kind]
        (place / wheels.CPU).write_text(json.dumps(same[0]))
        for target in same:
            folder = place / target.triple
            folder.mkdir()
            files[target.triple] = [folder / f"{one}{shared_libraries.OBJECT}" for one in SYMBOLS]
        folders = [(str(place / one.triple), list(one)) for one in same]
        for kernel in KERNELS:
            wheels.compile_for(kernel.__module__, kernel.__name__, 0, str(place), *folders)
    return files


class Contents(NamedTuple):
    """What a shared library says of itself."""

    memory: set[str]
    """Rights of its parts: of "r", "w" and "x"."""
    needs: set[str]
    """Functions or libraries that it needs from elsewhere."""


def rights(flags, read, write, run):
    """Return the rights that flags give."""
    return "".join(name for name, flag in (("r", read), ("w", write), ("x", run)) if flags & flag)


def text_at(content, first):
    return content[first : content.index(b"\0", first)].decode()


def elf(content):
    """Read a library of Linux; it needs the functions whose addresses the system fills in."""
    parts, sections = struct.unpack_from("<QQ", content, 0x20)
    size, count, length, sections_count = struct.unpack_from("<4H", content, 0x36)
    headers = [struct.unpack_from("<II", content, parts + size * k) for k in range(count)]
    tables = [
        struct.unpack_from("<IIQQQQII", content, sections + length * k)
        for k in range(sections_count)
    ]
    needs = set()
    for _, kind, _, _, offset, length, link, _ in tables:
        if kind == 4:  # Relocations.
            symbols, texts = tables[link][4], tables[tables[link][6]][4]
            for _, about, _ in struct.iter_unpack("<QQq", content[offset : offset + length]):
                (name,) = struct.unpack_from("<I", content, symbols + 24 * (about >> 32))
                needs.add(text_at(content, texts + name))
    return Contents({rights(flags, 4, 2, 1) for kind, flags in headers if kind == 1}, needs)


def pe(content):
    """Read a library of Windows; an empty table of imports or relocations is none."""
    (start,) = struct.unpack_from("<I", content, 0x3C)
    assert content[start : start + 4] == b"PE\0\0"
    count, optional = struct.unpack_from("<H12xH", content, start + 6)
    tables = start + 24 + 112
    sizes = [struct.unpack_from("<I", content, tables + 8 * k + 4)[0] for k in (1, 5)]
    first = start + 24 + optional
    flags = [struct.unpack_from("<I", content, first + 40 * k + 36)[0] for k in range(count)]
    names = {name for name, size in zip(("imports", "relocations"), sizes, strict=True) if size}
    return Contents({rights(one, 1 << 30, 1 << 31, 1 << 29) for one in flags}, names)


def macho(content):
    """Read a library of macOS; it needs others by their paths."""
    assert content.startswith(shared_libraries.MACHO)
    (commands,) = struct.unpack_from("<I", content, 16)
    at, memory, needs = 32, set(), set()
    for _ in range(commands):
        kind, size = struct.unpack_from("<II", content, at)
        if kind == 0x19:  # A part of memory.
            memory.add(rights(struct.unpack_from("<I", content, at + 60)[0], 1, 2, 4))
        if kind == 0xC:  # Another library.
            needs.add(text_at(content, at + struct.unpack_from("<I", content, at + 8)[0]))
        at += size
    return Contents(memory, needs)


SYSTEMS = {
    "linux": (elf, {"memset"}),
    "windows": (pe, set()),
    "macos": (macho, {"/usr/lib/libSystem.B.dylib"}),
}
"""How to read a library of a system, and what it may need."""


@pytest.mark.parametrize("triple", TARGETS)
def test_a_library_exports_its_kernels_and_has_no_memory_to_write_and_run(triple, objects):
    target, system = TARGETS[triple], targets.split_triple(triple)[1]
    made = shared_libraries.link(target, "made", objects[triple])
    assert made == shared_libraries.link(target, "made", objects[triple])
    read, may_need = SYSTEMS[system]
    found = read(made)
    assert found.needs <= may_need
    assert any("x" in one for one in found.memory)
    assert not [one for one in found.memory if "w" in one and "x" in one]
    for symbol in (*SYMBOLS, prebuilt_kernels.CPU_CHECK_FUNCTION):
        assert symbol.encode() + b"\0" in made or symbol.encode() in made


@pytest.mark.parametrize("triple", TARGETS)
def test_object_code_of_every_system_names_what_it_needs(triple):
    target = TARGETS[triple]
    module = shared_libraries.module_for(
        "declare double @sin(double)\ndeclare double @a_function_of_a_long_name(double)\n"
        "define double @made(double %x) {\n%y = call double @sin(double %x)\n"
        "%z = call double @a_function_of_a_long_name(double %y)\nret double %z\n}",
        "made",
        target,
    )
    code = shared_libraries.machine_of(target).emit_object(module)
    found = shared_libraries.needed_symbols(code) - shared_libraries.allowed_in(target)
    assert found == {"sin", "a_function_of_a_long_name"}


@pytest.mark.parametrize("triple", TARGETS)
def test_a_kernel_that_calls_a_math_library_is_refused(triple, monkeypatch):
    target = TARGETS[triple]
    monkeypatch.setattr(shared_libraries, "needed_symbols", lambda code: {"memset", "sin"})
    text = "define i64 @made() {\nret i64 0\n}"
    with pytest.raises(RuntimeError, match=r"\['sin'\]"):
        shared_libraries.object_code(text, "made", target)


@pytest.mark.parametrize("triple", TARGETS)
def test_a_library_is_linked_in_a_folder_whose_name_has_a_space(
    triple, objects, tmp_path, monkeypatch
):
    folder = tmp_path / "of a user"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    copies = [shutil.copy(path, folder) for path in objects[triple]]
    made = shared_libraries.link(TARGETS[triple], "made", [Path(one) for one in copies])
    assert made == shared_libraries.link(TARGETS[triple], "made", objects[triple])


IN_A_FRESH_PROCESS = """
from rasterjit.cli import shared_libraries
from rasterjit.runtime import targets
for platform in targets.PLATFORMS.values():
    for target in platform.targets():
        print(shared_libraries.machine_of(target).triple)
"""


def test_machines_of_all_platforms_are_known_before_anything_is_compiled():
    done = subprocess.run(
        [sys.executable, "-c", IN_A_FRESH_PROCESS], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert {*done.stdout.split()} == {*TARGETS}


def test_a_linker_that_fails_says_why(tmp_path):
    damaged = tmp_path / "damaged.o"
    damaged.write_bytes(b"no object code")
    with pytest.raises(RuntimeError, match=r"damaged\.o"):
        shared_libraries.link(next(iter(TARGETS.values())), "made", [damaged])


@pytest.mark.parametrize(
    ("triple", "size", "leaves"),
    [("x86_64-pc-windows-msvc", 12, ()), ("aarch64-pc-windows-msvc", 8, SYMBOLS[1:])],
)
def test_windows_unwinds_every_function(objects, triple, size, leaves):
    """
    Of each there is an entry in the table that the system reads.

    ARM's Windows needs none of functions that call none and have nothing on the stack.
    """
    for path in objects[triple]:
        code = path.read_bytes()
        count, symbols, symbols_count = struct.unpack_from("<2xH4xII", code)
        sections = [struct.unpack_from("<8s8xI", code, 20 + 40 * k) for k in range(count)]
        entries = sum(length // size for name, length in sections if name.startswith(b".pdata"))
        at, functions = symbols, 0
        while at < symbols + 18 * symbols_count:
            _, _, section, kind, _, more = struct.unpack_from("<8sIhHBB", code, at)
            functions += section > 0 and kind == 0x20
            at += 18 * (1 + more)
        assert (entries, functions) == (path.stem not in leaves, 1)
