"""The robot of the example swings, and the loop is written."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from PIL import Image


def test_the_loop_is_written(program):
    pytest.importorskip("yourdfpy")
    program("robot").main(["--frames", "8", "--size", "96", "96"])
    with Image.open("robot.gif") as gif, Image.open("robot.png") as strip:
        assert gif.n_frames == 8
        assert strip.size == (4 * 96, 96)
        poses = np.array(strip.convert("L"), float).reshape(96, 4, 96).transpose(1, 0, 2)
    assert all(np.abs(a - b).mean() > 1.0 for a, b in pairwise(poses))
