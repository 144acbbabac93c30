"""Threads that stay awake from step to step: each call is made once, by whoever is free."""

from __future__ import annotations

import ctypes
import re
import threading
import time

import numpy as np
import pytest
from own_threads import own_threads
from small_kernels import count_up, note_scratch

from rasterjit.runtime import jit
from rasterjit.runtime import threads as sharing
from rasterjit.runtime.isolated_numba import compiler
from rasterjit.runtime.spinning_threads import CALLS_MADE, Call, Team, make_calls
from rasterjit.runtime.state_block import LINE, WORD
from rasterjit.runtime.targets import Target
from rasterjit.runtime.threads import Workers

pytestmark = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="no machine code of ours")

SECONDS = 60.0
"""After which a thread that is waited for is lost."""


def wait_until(is_so):
    deadline = time.monotonic() + SECONDS
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(1e-3)


@pytest.fixture(params=[2, 5])
def workers(request):
    made = Workers(request.param)
    yield made
    made.close()


def test_every_call_is_made_once_and_results_are_in_order(workers):
    rows = np.zeros((3000, 1), np.int64)
    for times in (1, 2, 3):
        calls = [(row, n) for n, row in enumerate(rows)]
        assert workers.call(count_up, calls) == [*range(len(rows))]
        assert (rows == times).all()
    few = [(row, -n) for n, row in enumerate(rows[:2])]
    for _ in range(2000):
        assert workers.call(count_up, few) == [0, -1]
    assert (rows[:2] == 2003).all()


def test_frames_of_several_threads_share_a_team(workers):
    rows, wrong = np.zeros((4, 50, 1), np.int64), []

    def draw(own):
        for _ in range(200):
            with workers.frame():
                found = workers.call(count_up, [(row, n) for n, row in enumerate(own)])
                if found != [*range(len(own))]:
                    wrong.append(found)

    drawing = [threading.Thread(target=draw, args=(own,)) for own in rows]
    for one in drawing:
        one.start()
    for one in drawing:
        one.join(SECONDS)
    assert not wrong
    assert (rows == 200).all()


def test_each_thread_has_scratch_memory_of_its_own():
    team, words = Team(2), 11
    helping = [threading.Thread(target=team.help, args=(team.asleep.pop(),)) for _ in range(2)]
    states = np.zeros(4000, np.int64)
    team.begin(len(states), words)
    calls = [Call(note_scratch.address(), states[n:].ctypes.data, states) for n in range(4000)]
    for one in helping:
        one.start()
    for call in calls:
        team.add(call)
    team.finish()
    team.dismiss()
    for one in helping:
        one.join(SECONDS)
    found, counts = np.unique(states, return_counts=True)
    assert 1 <= len(found) <= 3
    assert (found % LINE == 0).all()
    assert (np.diff(found) % (2 * LINE) == 0).all()  # 11 words fill two lines.
    assert [ctypes.c_int64.from_address(place).value for place in found.tolist()] == counts.tolist()


def test_threads_sleep_when_nothing_comes_and_are_woken(workers):
    row = np.zeros((40, 1), np.int64)
    for times in (1, 2, 3):
        workers.call(count_up, [(own, 0) for own in row])
        assert (row == times).all()
        wait_until(lambda: len(workers._team.asleep) == workers.threads - 1)


def test_no_more_threads_are_woken_than_there_are_calls(monkeypatch):
    monkeypatch.setattr(sharing, "available_processors", lambda: 16)
    monkeypatch.setattr(sharing, "SPIN_SECONDS", SECONDS)
    workers, rows = Workers(16), np.zeros((3, 1), np.int64)
    for _ in range(3):
        with workers.frame():
            workers.call(count_up, [(row, 0) for row in rows])
        assert workers._team.awake == 3
    workers._team.dismiss()
    workers.close()


def test_who_waits_for_calls_is_free_for_tasks(monkeypatch):
    monkeypatch.setattr(sharing, "available_processors", lambda: 2)
    monkeypatch.setattr(sharing, "SPIN_SECONDS", SECONDS)
    before = own_threads()
    workers, met = Workers(2), threading.Barrier(2)
    workers.call(count_up, [(np.zeros(1, np.int64), 0)] * 2)
    workers.run(lambda: met.wait(SECONDS / 2), [(), ()])
    workers.call(count_up, [(np.zeros(1, np.int64), 0)] * 2)
    begun = time.monotonic()
    workers.close()
    wait_until(lambda: own_threads() <= before)
    assert time.monotonic() - begun < SECONDS / 2


def test_what_was_begun_is_done_when_arguments_fail(workers):
    rows = np.zeros((100, 1), np.int64)

    def calls():
        for n, row in enumerate(rows):
            if n == 60:
                raise KeyboardInterrupt
            form, block = count_up.bind((row, n))
            yield Call(form.address, ctypes.addressof(block), block)

    with pytest.raises(KeyboardInterrupt):
        workers.call_machine(calls(), len(rows))
    assert (rows[:60] == 1).all()
    assert not rows[60:].any()
    workers.call(count_up, [(row, 0) for row in rows])
    assert (rows[:, 0] == [2] * 60 + [1] * 40).all()


def test_an_interrupt_drops_what_is_not_begun_and_keeps_what_is(workers, monkeypatch):
    rows = np.zeros((100, 1), np.int64)
    calls = [(row, n) for n, row in enumerate(rows)]
    workers.call(count_up, calls)
    real, team = Team._make_calls, workers._team

    def interrupted(self):
        monkeypatch.setattr(Team, "_make_calls", real)
        raise KeyboardInterrupt

    monkeypatch.setattr(Team, "_make_calls", interrupted)
    with pytest.raises(KeyboardInterrupt):
        workers.call(count_up, calls)
    assert not team._owners
    before = rows.copy()
    assert ((before == 1) | (before == 2)).all()
    assert workers.call(count_up, calls) == [*range(100)]
    assert (rows == before + 1).all()


def test_an_interrupt_as_a_step_begins_holds_up_no_other(workers, monkeypatch):
    rows = np.zeros((9, 1), np.int64)
    calls = [(row, n) for n, row in enumerate(rows)]
    workers.call(count_up, calls)
    real = Team._finish_interrupted_step

    def interrupted(self):
        real(self)
        self._words[CALLS_MADE // WORD] = 0
        raise KeyboardInterrupt

    monkeypatch.setattr(Team, "_finish_interrupted_step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        workers.call(count_up, calls)
    monkeypatch.undo()
    assert workers.call(count_up, calls) == [*range(9)]
    assert (rows == 2).all()


def test_arguments_are_kept_until_the_step_ends(workers, monkeypatch):
    real, kept = Team.add, []

    def add(self, call):
        kept.append(call.owner)
        return real(self, call)

    monkeypatch.setattr(Team, "add", add)
    calls = [(np.zeros(1, np.int64), n) for n in range(5)]
    workers.call(count_up, calls)
    assert all(any(part is own for part in one) for one, own in zip(kept, calls, strict=True))


@pytest.mark.parametrize(
    ("triple", "word"),
    [
        ("arm64-apple-darwin", "yield"), ("aarch64-unknown-linux-gnu", "yield"),
        ("x86_64-unknown-linux-gnu", "pause"),
    ],
)  # fmt: skip
def test_who_waits_rests_on_every_processor(triple, word):
    target = Target(triple, "x86-64" if word == "pause" else "generic", "")
    assert re.search(
        rf"\b{word}\b", compiler().emit_assembly_text(make_calls, make_calls.kind, target)
    )


def test_a_call_after_close_is_refused_within_a_frame_only(workers):
    calls = [(np.zeros(1, np.int64), n) for n in range(9)]
    with workers.frame():
        workers.call(count_up, calls)
        workers.close()
        with pytest.raises(RuntimeError, match=r"^close\(\) was called while a frame was being"):
            workers.call(count_up, calls)
    assert workers.call(count_up, calls) == [*range(9)]


def test_words_of_scratch_memory_start_as_zero_whenever_it_grows():
    team = Team(1)
    for words in (1, 64, 5000):
        state = np.zeros(1, np.int64)
        team.begin(1, words)
        team.add(Call(note_scratch.address(), state.ctypes.data, state))
        team.finish()
        place = int(state[0])
        assert place % LINE == 0
        first, *others = np.ctypeslib.as_array((ctypes.c_int64 * words).from_address(place))
        assert first >= 1
        assert not any(others)
        assert team._scratch.nbytes >= 2 * words * WORD
