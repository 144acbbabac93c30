"""Warnings point at the line of the program that called, once for each line."""

from __future__ import annotations

import inspect
import threading
import warnings

import pytest

from rasterjit.scene.warning import (
    REPAIRED_NORMALS,
    REPEATED,
    gather_warnings,
    silence_warnings,
    warn_caller,
)


def call_through(depth):
    """Return a function that warns below so many calls within the package."""
    space = {"__name__": "rasterjit.somewhere.inside", "warn_caller": warn_caller}
    exec("def call_0(): warn_caller('it is so', FutureWarning)", space)
    for n in range(1, depth + 1):
        exec(f"def call_{n}(): call_{n - 1}()", space)
    return space[f"call_{depth}"]


@pytest.mark.parametrize("depth", [0, 1, 5])
def test_the_warning_names_the_line_that_called(depth):
    with pytest.warns(FutureWarning, match="^it is so$") as caught:
        call_through(depth)()
    line = inspect.currentframe().f_lineno - 1
    (warning,) = caught
    assert (warning.filename, warning.lineno) == (__file__, line)


def test_a_line_is_warned_about_once_unless_programs_ask_for_more():
    inside = call_through(2)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for _ in range(3):
            inside()
        inside()
    assert len(caught) == 2


def test_only_the_kind_that_is_told_elsewhere_is_kept_back():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with silence_warnings(REPAIRED_NORMALS):
            for kind in (REPAIRED_NORMALS, REPEATED, ""):
                warn_caller(f"of kind {kind!r}", kind=kind)
            with silence_warnings(REPEATED):
                warn_caller("neither", kind=REPAIRED_NORMALS)
                warn_caller("nor", kind=REPEATED)
            with silence_warnings(FutureWarning):
                warn_caller("of a category", FutureWarning)
        warn_caller("afterwards", kind=REPAIRED_NORMALS)
    texts = [str(one.message) for one in caught]
    assert texts == [f"of kind {REPEATED!r}", "of kind ''", "afterwards"]


def test_warnings_are_gathered_of_one_thread_alone():
    # Two blocks that overlap, as those of threads do, leave nothing behind.
    def work():
        with gather_warnings() as own:
            is_inside.set()
            is_over.wait(60.0)
            warn_caller("of the thread", FutureWarning)
        gathered.extend(own)

    gathered: list[Warning] = []
    is_inside, is_over = threading.Event(), threading.Event()
    thread = threading.Thread(target=work)
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        with gather_warnings() as mine:
            thread.start()
            is_inside.wait(60.0)
            warn_caller("mine")
        is_over.set()
        thread.join()
        warn_caller("afterwards")
    assert [repr(one) for one in (*mine, *gathered)] == [
        "UserWarning('mine')", "FutureWarning('of the thread')"
    ]  # fmt: skip
    assert [str(one.message) for one in issued] == ["afterwards"]


def test_a_package_of_a_like_name_is_no_part_of_this_one():
    space = {"__name__": "rasterjit_plots", "warn_caller": warn_caller}
    with pytest.warns(UserWarning, match="^it is so$") as caught:
        exec(compile("warn_caller('it is so')", "plots.py", "exec"), space)
    assert caught[0].filename == "plots.py"
