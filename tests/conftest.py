"""Small things that many tests share."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import subprocess
import sys
import tempfile

import numpy as np
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES
from hypothesis import settings
from own_process import own_process, pytest_pyfunc_call  # noqa: F401  (pytest finds them here)

import rasterjit as rj
from rasterjit.runtime import jit, store

try:
    import resource
except ImportError:  # Windows
    resource = None

LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None
TRIM, TUNE = (getattr(LIBC, name, None) for name in ("malloc_trim", "mallopt"))
"""Give memory back that was freed, and set how it is kept, where the C library is GNU's."""

THRESHOLD = gc.get_threshold()
"""How often Python looks for garbage."""

MAX_ARENAS = -8
"""Name of the setting: most pools of memory for threads. By default each core has eight."""

SPENT = pytest.StashKey[dict]()
"""What each process of the tests took: processor time of its own and of others, most memory."""

settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.load_profile("repeatable")


def pytest_addoption(parser):
    parser.addoption(
        "--cases", type=int, default=None, metavar="N",
        help="run at most N cases of each test, but all of those marked every_case",
    )  # fmt: skip


def pytest_configure(config):
    # A shell lets what it runs in the background ignore Ctrl-C, which some tests send to others.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # What tests run themselves has options of its own.
    os.environ.pop("PYTEST_ADDOPTS", None)
    # Hundreds of processes start here: without compiled modules each reads sources for a second.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    _share_store(config)
    config.stash[SPENT] = {}
    if not (jit.DISABLED or jit.CHECKED):
        jit.Helper.__call__ = _call_helper
    if TUNE is not None:
        TUNE(MAX_ARENAS, 2)
    # What is collected stays: looking for garbage finds little.
    gc.set_threshold(20_000, *THRESHOLD[1:])
    config.addinivalue_line("markers", "needs_jit: too slow or without sense in plain Python")
    config.addinivalue_line("markers", "compiles_first: fills the cache of kernels for other tests")
    config.addinivalue_line("markers", "every_case: keeps all its cases, whatever --cases says")
    config.addinivalue_line("markers", "takes_long: skipped unless EVERY_TEST is set")


def _call_helper(helper, *arguments):
    from helpers import call

    return call(helper, *arguments)


def _share_store(config):
    """Name the folder of compiled kernels for this run, its workers and what tests start."""
    if os.environ.get(store.FOLDER_VARIABLE):
        return
    place = store.kernel_folder()
    if place is None:
        folder = tempfile.TemporaryDirectory(prefix="rasterjit-")
        config.add_cleanup(folder.cleanup)
        place = folder.name
        store.kernel_folder.cache_clear()
    os.environ[store.FOLDER_VARIABLE] = str(place)


def pytest_sessionstart(session):
    """
    Compile all kernels in processes of their own, where all tests are to run.

    What a compiler leaves in memory, several MB a kernel, would stay until the last test.
    """
    config = session.config
    is_whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    is_told = config.option.collectonly or hasattr(config, "workerinput")
    if is_whole and not (is_told or jit.DISABLED or jit.CHECKED):
        warm_up = [sys.executable, "-m", "rasterjit", "warmup", "--quiet"]
        code = subprocess.run(warm_up, check=False).returncode
        config.stash[SPENT]["compilers"] = {**_spent(), "code": code}


def _spent():
    """Return what this process took until now."""
    if resource is None:
        return {}
    own, others = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    size = 1 << 20 if sys.platform == "darwin" else 1 << 10
    return {
        "own": own.ru_utime + own.ru_stime, "others": others.ru_utime + others.ru_stime,
        "most": own.ru_maxrss // size,
    }  # fmt: skip


def pytest_sessionfinish(session):
    if "helpers" in sys.modules:
        sys.modules["helpers"].end()
    if hasattr(session.config, "workerinput"):
        session.config.workeroutput["spent"] = _spent()


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node, error):
    node.config.stash[SPENT][node.gateway.id] = getattr(node, "workeroutput", {}).get("spent", {})


def pytest_terminal_summary(terminalreporter, config):
    """Tell the processor time of all processes, and how much memory each held at most."""
    workers, last = config.stash[SPENT], _spent()
    if not last:
        return
    compilers = workers.pop("compilers", {"others": 0.0, "code": 0})
    before = compilers["others"]
    if compilers["code"]:
        terminalreporter.write_line(
            f"rasterjit warmup failed with exit status {compilers['code']}: tests compiled kernels",
            red=True,
        )
    # The workers of a main process are its children, too.
    last["others"] = 0.0 if workers else last["others"] - before
    spent = [one for one in [*workers.values(), last] if one]
    own, others = (sum(one[kind] for one in spent) for kind in ("own", "others"))
    most = ", ".join(f"{name} {one['most']} MB" for name, one in workers.items() if one)
    terminalreporter.write_line(
        f"processor time: {own + others + before:.0f} s, of which {before:.0f} s to compile and "
        f"{others:.0f} s in processes of tests; most memory: {most or last['most']}"
    )


def _leave_out_cases(config, items, most):
    """Keep at most some cases of each test: the first, the last, and others in even steps."""
    cases = {}
    for item in items:
        cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    kept = set()
    for of_one in cases.values():
        end, steps = len(of_one) - 1, most - 1
        if end > steps and not of_one[0].get_closest_marker("every_case"):
            of_one = [of_one[k * end // max(steps, 1)] for k in range(most)]
        kept.update(of_one)
    config.hook.pytest_deselected(items=[item for item in items if item not in kept])
    items[:] = [item for item in items if item in kept]


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """Begin with what compiles most kernels, also in random order; skip what takes long."""
    if config.getoption("--cases"):
        _leave_out_cases(config, items, config.getoption("--cases"))
    items.sort(key=lambda item: item.get_closest_marker("compiles_first") is None)
    if not os.environ.get("EVERY_TEST"):
        skip = pytest.mark.skip(reason="takes long: set EVERY_TEST=true to run it")
        for item in items:
            if item.get_closest_marker("takes_long"):
                item.add_marker(skip)


def pytest_collection_finish():
    # The tests stay until the end: Python need not look again and again whether they can go.
    gc.freeze()
    gc.set_threshold(*THRESHOLD)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item, nextitem):
    """Forget what a module, and benchmarks, remember for its tests when the last has run."""
    module = getattr(item, "module", None)
    if module is None or module is getattr(nextitem, "module", None):
        return
    benchmarks = [one for name, one in sys.modules.items() if name.startswith("benchmarks.")]
    for owner in (module, *benchmarks):
        for value in list(vars(owner).values()):
            if hasattr(value, "cache_clear") and value.__module__ == owner.__name__:
                value.cache_clear()
    if TRIM is not None:
        TRIM(0)


@pytest.fixture
def cube():
    """A unit-less grey cube, [-1, 1]**3, counter-clockwise from outside."""
    return rj.Mesh(CUBE_VERTICES, CUBE_FACES)


@pytest.fixture
def camera():
    """A camera that sees three sides of the cube."""
    return rj.PerspectiveCamera(eye=(2.5, 3.0, 4.0), target=(0.0, 0.0, 0.0), near=0.5, far=20.0)


@pytest.fixture
def sphere():
    """A coarse ball of radius 1 with shared vertices."""
    rows, columns = 6, 10
    polar = np.linspace(0.0, np.pi, rows + 1)[1:-1]
    around = np.arange(columns) * (2.0 * np.pi / columns)
    ring = np.stack(
        [
            np.outer(np.sin(polar), np.cos(around)),
            np.outer(np.cos(polar), np.ones(columns)),
            -np.outer(np.sin(polar), np.sin(around)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    vertices = np.concatenate([ring, [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    top, bottom = len(ring), len(ring) + 1
    faces = []
    for k in range(columns):
        following = (k + 1) % columns
        faces.append([top, k, following])
        last = (rows - 2) * columns
        faces.append([bottom, last + following, last + k])
        for row in range(rows - 2):
            a, b = row * columns + k, row * columns + following
            faces += [[a, a + columns, b + columns], [a, b + columns, b]]
    return rj.Mesh(vertices, faces)
