"""No kernel and no stage is compiled for other types than it declares, whatever is drawn."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from kernel_files import kernel_modules
from strict import STRICT

from rasterjit.runtime import jit, store
from rasterjit.runtime.state_block import iterate_leaves

TESTS = Path(__file__).parent.parent

DRAW = """
import json, sys, warnings
sys.path[:0] = sys.argv[1:]
import frames
import rasterjit as rj
from rasterjit.runtime import jit, store

warnings.simplefilter("ignore", rj.ViewWarning)
drawn = [name for name, _ in frames.every_digest()]
kernels = {
    store.qualified_name(kernel): (
        len(kernel.forms), len(kernel.declared),
        [str(form.kind) for form in kernel.forms if form.kind not in kernel.declared],
    )
    for kernel in jit.KERNELS
}
print(json.dumps([len(drawn), kernels, [*store.USED_KERNELS.loaded, *store.USED_KERNELS.compiled]]))
"""
"""Draws every recorded frame; prints the forms of each kernel, and all that came into use."""


def short(name):
    """Return the last two parts of a full name."""
    return ".".join(name.split(".")[-2:])


@pytest.fixture(scope="module")
def kernels():
    """The kernels of the package, by their short names."""
    if jit.DISABLED or jit.CHECKED:
        pytest.skip("no machine code of ours")
    for module in kernel_modules():
        importlib.import_module(module)
    own = [kernel for kernel in jit.KERNELS if kernel.__module__.startswith("rasterjit.")]
    return {short(store.qualified_name(kernel)): kernel for kernel in own}


def test_every_kernel_declares_its_forms(kernels):
    assert [name for name, kernel in kernels.items() if not kernel.declared] == []


def test_a_kernel_has_a_form_for_each_type_of_depths_or_positions_alone(kernels):
    for name, kernel in kernels.items():
        dtypes = [{leaf.dtype for leaf in iterate_leaves(kind)} for kind in kernel.declared]
        assert len(kernel.declared) <= 3, name
        # Forms differ in the type of some numbers, and in nothing else.
        assert len({len([*iterate_leaves(kind)]) for kind in kernel.declared}) <= 1, name
        others = set().union(*dtypes) - set.intersection(*dtypes) if dtypes else set()
        assert others <= {"float32", "float64", "int32"}, name


@pytest.fixture(scope="module")
def drawn():
    """What `DRAW` prints."""
    if jit.DISABLED or jit.CHECKED:
        pytest.skip("no machine code of ours")
    done = subprocess.run(
        [sys.executable, *STRICT, "-c", DRAW, str(TESTS / "hard_cases"), str(TESTS)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_no_frame_makes_a_form_that_is_not_declared(drawn):
    count, kernels, _ = drawn
    assert count > 40
    assert sum(forms > 0 for forms, *_ in kernels.values()) > 50
    for name, (forms, most, others) in kernels.items():
        assert others == [], name
        assert forms <= most, name


def test_no_stage_comes_into_use_twice(drawn):
    _, kernels, used = drawn
    times = Counter(used)
    stages = times.keys() - kernels.keys()
    assert len(stages) > 30
    assert {name for name in stages if times[name] > 1} == set()
    assert {name: times[name] for name in times.keys() & kernels.keys()} == {
        name: forms for name, (forms, *_) in kernels.items() if forms
    }
