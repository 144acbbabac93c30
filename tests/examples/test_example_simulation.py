"""The simulation of MuJoCo moves, and its picture is written."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'rasterjit[mujoco]'")


def test_the_ball_falls(program, tmp_path, monkeypatch, capsys):
    target = tmp_path / "ball.gif"
    monkeypatch.setattr("sys.argv", ["simulation.py", "-o", str(target), "--frames", "8"])
    program("simulation").main()
    assert "8 pictures" in capsys.readouterr().out
    middles = []
    with Image.open(target) as picture:
        for number in (0, 7):
            picture.seek(number)
            numbers = np.asarray(picture.convert("L"))[:, -112:]
            middles.append(np.nonzero(numbers > 150)[0].mean())
    assert middles[1] > middles[0] + 5.0
