"""Forked children never wait for what another thread of their parent was doing."""

import faulthandler
import importlib
import importlib.abc
import os
import subprocess
import sys
import textwrap
import threading
import time

import pytest

from rasterjit import forks

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning"),
    pytest.mark.needs_jit,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here"),
]

PROGRAM = """
    import faulthandler, os, sys, threading, time, warnings
    warnings.simplefilter("ignore")  # Of threads beside a fork; of times that are not known.
    import numpy as np
    import rasterjit as rj

    CAMERA = rj.PerspectiveCamera(eye=(0, 0, 6), target=(0, 0, 0))
    SHARED = rj.Renderer((32, 24), threads=2)
    FORKS, SECONDS = {forks}, 400  # Seconds: with an empty store, threads compile.

    def scene(number):
        places = np.random.default_rng(number).normal(size=(30, 3))
        shading = ("flat", "phong", "pbr", "unlit")[number % 4]
        material = rj.Material(shading, base_color=(1, 0.5, 0.2, (1, 0.5)[number // 4 % 2]))
        made = rj.Scene()
        made.add(rj.Mesh(places, np.arange(30).reshape(-1, 3), material=material))
        made.lights = [rj.DirectionalLight((1, -2, -1)), rj.PointLight((2, 2, 2))]
        return made

    WAYS = (
        lambda what: rj.render(what, CAMERA, size=(32, 24), outputs=("color", "depth", "normal")),
        lambda what: SHARED.render(what, CAMERA),
        lambda what: rj.render_batch(what, [CAMERA, CAMERA], size=(32, 24)),
        lambda what: rj.render(what, CAMERA, size=(32, 24), time_budget=0.05),
    )

    def draw_on(way):
        number = 0
        while True:
            number += 1
            WAYS[way](scene(number))

    for way in range(len(WAYS)):
        threading.Thread(target=draw_on, args=(way,), daemon=True).start()
    # The first forks meet imports and machine code that is being loaded.
    for fork in range(FORKS):
        time.sleep(0.02 * fork)
        child = os.fork()
        if child == 0:
            faulthandler.dump_traceback_later(SECONDS, exit=True)
            try:
                for way in WAYS:
                    way(scene(fork))
            except BaseException as error:
                print(type(error), error, file=sys.stderr, flush=True)
                os._exit(1)
            os._exit(0)
        if os.waitpid(child, 0)[1]:
            os._exit(1)
    os._exit(0)
"""


def fork_while_threads_draw(count):
    program = textwrap.dedent(PROGRAM).format(forks=count)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr


def test_a_forked_child_draws_while_threads_of_its_parent_draw():
    fork_while_threads_draw(4)


@pytest.mark.takes_long
def test_many_forked_children_draw_while_threads_of_their_parent_draw():
    fork_while_threads_draw(40)


def test_locks_that_another_thread_holds_are_free_in_a_child():
    locks = [forks.lock(), forks.reentrant_lock()]
    for held in locks:
        assert held.acquire()
    child = os.fork()
    if child == 0:
        os._exit(0 if all(held.acquire(timeout=5) for held in locks) else 1)
    assert os.waitpid(child, 0)[1] == 0
    for held in locks:
        held.release()


def test_a_child_imports_what_another_thread_was_looking_for(tmp_path, monkeypatch):
    looked_for = "a_module_of_this_test"

    class Slow(importlib.abc.MetaPathFinder):
        def find_spec(self, name, path, target=None):
            """Take a while over the module of this test; find nothing."""
            if name == looked_for:
                begun.set()
                time.sleep(0.3)

    begun = threading.Event()
    (tmp_path / f"{looked_for}.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "meta_path", [Slow(), *sys.meta_path])
    other = threading.Thread(target=importlib.import_module, args=(looked_for,))
    other.start()
    assert begun.wait(5)
    child = os.fork()
    if child == 0:
        faulthandler.dump_traceback_later(20, exit=True)
        importlib.import_module(looked_for)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    other.join()


def test_a_cached_property_is_worked_out_once():
    class Counted:
        calls = 0

        @forks.cached_property
        def value(self):
            """What it is."""
            self.calls += 1
            return object()

    counted = Counted()
    assert counted.value is counted.value
    assert counted.calls == 1
    assert Counted.value.__doc__ == "What it is."
