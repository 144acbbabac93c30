"""What differs on macOS, imitated: its ``sysctl``, and names of files that differ in case."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from rasterjit.cli.render_files import choose_names
from rasterjit.runtime import locks, sysctl, threads

KNOWN = {b"hw.perflevel0.logicalcpu": (6).to_bytes(4, sys.byteorder)}


@pytest.fixture
def macos(monkeypatch):
    """What `sysctl` knows on a Mac that has six fast processors of ten, to be changed."""
    known = dict(KNOWN)

    def sysctlbyname(name, answer, size, new, new_size):
        if name not in known:
            return -1
        ctypes.memmove(answer, known[name], len(known[name]))
        size._obj.value = len(known[name])
        return 0

    library = SimpleNamespace(sysctlbyname=sysctlbyname)
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(ctypes, "CDLL", lambda name: library)
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 10)
    return known


def test_threads_are_for_the_fast_processors(macos):
    assert threads.available_processors() == 6
    macos.clear()  # A Mac of Intel's.
    assert threads.available_processors() == 10


def test_a_mac_is_the_same_in_another_network(macos, monkeypatch, tmp_path):
    monkeypatch.setattr(locks, "BOOT_ID_FILE", tmp_path / "missing")
    names = []
    for boot, host in ((b"A-1\0", "home"), (b"A-1\0", "work"), (b"B-2\0", "work")):
        macos[locks.APPLE_BOOT_ID.encode()] = boot
        monkeypatch.setattr(locks.platform, "node", lambda host=host: host)
        names.append(locks.machine_names.__wrapped__()[1])
    assert names[0] == names[1] != names[2]


def test_elsewhere_sysctl_is_not_called(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", lambda name: pytest.fail("it is not there"))
    assert sysctl.read_sysctl("kern.bootsessionuuid") is None


@pytest.mark.parametrize("platform", ["darwin", "win32", "linux"])
def test_pictures_whose_names_differ_in_case_are_two_files(monkeypatch, platform):
    monkeypatch.setattr(sys, "platform", platform)
    files = (Path("one/Cube.obj"), Path("two/cube.obj"))
    names = [str(name) for name in choose_names(files, ".png").values()]
    is_same = platform != "linux"
    assert len({name.casefold() for name in names}) == (2 if is_same else 1)
    assert len({*names}) == 2
