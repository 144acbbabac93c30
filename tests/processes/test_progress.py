"""How far compiling is said to be, and where."""

from __future__ import annotations

import asyncio
import io
import sys
import threading
import time
from types import SimpleNamespace

import pytest

from rasterjit.runtime import clocks, progress, store
from rasterjit.runtime.progress import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_what_counts_was_wanted_or_compiled_since(monkeypatch, tmp_path):
    used = store.UsedKernels(["a.b"], ["c.d"])
    monkeypatch.setattr(store, "USED_KERNELS", used)
    files = {f"a.{name}": tmp_path / name for name in "befg"}
    shown = Progress({**files, "a.h": None})
    assert " 0 of 5, " in str(shown)
    # Wanted; not wanted.
    used.compiled.extend(["a.b", "i.k"])
    assert " 2 of 6, " in str(shown)
    # Compiled elsewhere and loaded here; loaded, and never missing.
    used.loaded.extend(["a.e", "l.m"])
    assert " 3 of 6, " in str(shown)
    # Compiled elsewhere.
    files["a.f"].touch()
    files["a.e"].touch()
    assert " 4 of 6, " in str(shown)


def test_the_rest_takes_as_long_as_what_was_compiled(monkeypatch):
    clock, used = [100.0], store.UsedKernels([], [])
    monkeypatch.setattr(store, "USED_KERNELS", used)
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    shown = Progress(dict.fromkeys(("a.b", "a.c", "a.d", "a.e")))
    for name, seconds, told in (
        ("a.b", 3.0, "##........ 1 of 4, 3 s ("),
        ("a.c", 2.0, "#####..... 2 of 4, 5 s, 5 s left ("),
        ("a.d", 2.5, "#######... 3 of 4, 8 s, 3 s left ("),
        ("a.e", 0.5, "########## 4 of 4, 8 s ("),
    ):
        used.compiled.append(name)
        clock[0] += seconds
        assert str(shown).startswith(f"compiling kernels {told}")


def test_a_line_is_written_on_terminals_alone(monkeypatch):
    shown = Terminal()
    for stream in (shown, io.StringIO(), None, object()):
        monkeypatch.setattr(sys, "stderr", stream)
        progress.write_line("1 of 2")
        progress.write_line("")
        if stream is not shown and isinstance(stream, io.StringIO):
            assert stream.getvalue() == ""
    assert shown.getvalue() == f"\rrasterjit: 1 of 2\r{17 * ' '}\r"
    monkeypatch.setattr(sys, "stderr", shown)
    progress.write_line("10 of 12")
    progress.write_line("1 of 2")
    assert shown.getvalue().endswith("\rrasterjit: 10 of 12\rrasterjit: 1 of 2  ")
    shown.close()
    monkeypatch.setattr(sys, "stderr", shown)
    progress.write_line("1 of 2")


def test_a_cell_of_a_notebook_has_one_line_that_changes(monkeypatch):
    shown = []

    class Handle:
        def __init__(self):
            shown.append([])

        def update(self, data, raw):
            assert raw
            shown[-1].append(data["text/plain"])

    def display(data, raw, display_id):
        assert display_id
        handle = Handle()
        handle.update(data, raw)
        return handle

    shell = SimpleNamespace(kernel=object(), execution_count=1)
    modules = {
        "IPython": SimpleNamespace(get_ipython=lambda: shell),
        "IPython.display": SimpleNamespace(display=display),
    }
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(progress, "_LAST_CELL_LINE", [])
    for text in ("1 of 2", "2 of 2", "", "1 of 1"):
        progress.write_line(text)
    shell.execution_count = 2
    progress.write_line("3 of 4")
    done = f"rasterjit: kernels are compiled ({progress.describe_storage()})"
    first = ["rasterjit: 1 of 2", "rasterjit: 2 of 2", done, "rasterjit: 1 of 1"]
    assert shown == [first, ["rasterjit: 3 of 4"]]

    # What is drawn beside the cells, and in other threads, writes into none.
    async def beside():
        asyncio.get_running_loop().call_soon(progress.write_line, "4 of 4")
        await asyncio.sleep(0)

    asyncio.run(beside())
    thread = threading.Thread(target=progress.write_line, args=("4 of 4",))
    thread.start()
    thread.join()
    assert shown[1:] == [["rasterjit: 3 of 4"]]


@pytest.mark.parametrize("seconds", [1.9, 2.1])
def test_what_is_soon_done_is_not_told(monkeypatch, seconds):
    class Clock:
        times = [7.0, 7.0 + seconds, 7.0]  # noqa: RUF012 - one instance

        def read(self):
            return self.times.pop(0)

    told = []
    monkeypatch.setattr(clocks, "COMPILER_CLOCK", Clock())
    shown = Progress({})
    with progress.show_progress_by(told.append):
        shown.report()
        shown.end()
    assert told[1:] == ([""] if seconds > 2.0 else [])
    assert len(told) == (2 if seconds > 2.0 else 0)


def test_time_that_passes_shows_that_there_is_life(monkeypatch):
    times = iter([5.0, 5.2, 5.3, 8.2])
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(times)))
    monkeypatch.setattr(progress, "MIN_SECONDS", 0.0)
    told = []
    with progress.show_progress_by(told.append):
        shown = Progress({})
        for _ in range(3):
            shown.report()
    assert [text.partition(". ")[2].partition(" (")[0] for text in told] == [
        "0 of 0, 0 s",
        "0 of 0, 3 s",
    ]


def test_processes_that_share_a_job_say_nothing(monkeypatch):
    import multiprocessing.process

    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr(multiprocessing.process, "parent_process", lambda: object())
    progress.write_line("1 of 2")
    assert shown.getvalue() == ""
