"""Every picture of the gallery is made, and together they take a bounded number of variants."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from rasterjit.runtime import jit

MODELS = Path(__file__).parents[2] / "models"
PICTURES = MODELS / "pictures" / "gallery"
SMALL = (60, 45)

MAX_VARIANTS = 75
"""Compiled forms of all kernels that the whole gallery may take."""

MAX_OF_ONE = 3
"""Compiled forms of any one kernel."""

MAX_BYTES = 120_000

DRAW = """
import collections, json, sys
sys.path.insert(0, sys.argv[1])
import make_gallery
from rasterjit.runtime import jit

pictures = {}
for name, make in make_gallery.GALLERY.items():
    found = make((int(sys.argv[2]), int(sys.argv[3])))
    values = found.reshape(-1, found.shape[2])
    pictures[name] = found.shape, str(found.dtype), len({tuple(row) for row in values.tolist()})
variants = collections.Counter()
for kernel in jit.KERNELS:
    variants[kernel.__name__] += len(kernel.forms)
print(json.dumps([pictures, variants]))
"""


def names():
    """The names in the registry, without importing it: it loads models."""
    lines = (MODELS / "make_gallery.py").read_text().splitlines()
    return [
        lines[n + 1].removeprefix("def ").partition("(")[0]
        for n, line in enumerate(lines)
        if line == "@picture"
    ]


@pytest.fixture(scope="module")
def drawn():
    """Of each picture its shape, type and number of colours; of each kernel its variants."""
    if jit.DISABLED:
        pytest.skip("too slow in plain Python")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", DRAW, str(MODELS), *map(str, SMALL)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


def test_every_picture_is_made(drawn):
    pictures, _ = drawn
    assert list(pictures) == names()
    assert len(pictures) >= 17
    for name, ((height, width, channels), kind, colors) in pictures.items():
        assert SMALL[0] - 6 <= width <= SMALL[0], name
        assert SMALL[1] // 2 - 6 <= height <= SMALL[1], name
        assert (channels, kind) == (3, "uint8"), name
        assert colors > 4, f"{name} shows next to nothing"


def test_variants_of_kernels_are_few(drawn):
    _, variants = drawn
    total = sum(variants.values())
    print(f"{total} variants of {len(variants)} kernels:", variants)
    assert total <= MAX_VARIANTS
    assert max(variants.values()) <= MAX_OF_ONE
    assert variants["draw_tiles"] <= 4
    assert variants["transform_vertices"] == 1


@pytest.mark.parametrize("name", names())
def test_picture_is_there_and_small(name):
    file = PICTURES / f"{name}.png"
    assert file.stat().st_size < MAX_BYTES
    with Image.open(file) as image:
        assert 470 <= image.width <= 480
        assert 175 <= image.height <= 360
    assert sorted(PICTURES.glob("*.png")) == sorted(PICTURES / f"{name}.png" for name in names())
