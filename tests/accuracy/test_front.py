"""The picture of the Pareto front that the guide shows: made by a script of models/."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from made_up_study import made_up_study
from PIL import Image

from rasterjit.accuracy.report import plots

pytest.importorskip("matplotlib", reason="the extra accuracy is not installed")

MODELS = Path(__file__).parents[2] / "models"


@pytest.fixture
def front(monkeypatch):
    monkeypatch.syspath_prepend(MODELS)
    import accuracy_front

    return accuracy_front


def test_the_front_is_saved_as_a_picture(tmp_path, front):
    study = made_up_study()
    place = front.save_front(study, tmp_path / "front.png")
    with Image.open(place) as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
        assert image.width == round((front.PICTURE_POINTS[0] + front.KEY_POINTS) / 72 * 160)
    for name, least in (("page", 0.6), ("level", 1e-3), ("standard", 1e-4), ("ink", 1e-3)):
        color = [int(plots.LIGHT_COLORS[name][k : k + 2], 16) for k in (1, 3, 5)]
        assert (pixels == color).all(axis=1).mean() > least, name
    assert list(tmp_path.iterdir()) == [place]
    with pytest.raises(ValueError, match=r"must end in one of \.png"):
        front.save_front(study, tmp_path / "front.jpg")
    with pytest.raises(ValueError, match="does not exist"):
        front.save_front(study, tmp_path / "nowhere" / "front.png")


def test_the_same_study_makes_the_same_bytes(tmp_path, front):
    code = (
        "import sys; from accuracy_front import save_front\n"
        "from made_up_study import made_up_study\n"
        "save_front(made_up_study(), sys.argv[1])"
    )
    other = tmp_path / "other.png"
    where = os.pathsep.join([os.path.dirname(__file__), *filter(None, sys.path)])
    subprocess.run(
        [sys.executable, "-W", "error", "-c", code, str(other)],
        check=True, env={**os.environ, "PYTHONPATH": where, "SOURCE_DATE_EPOCH": "1"},
    )  # fmt: skip
    here = front.save_front(made_up_study(), tmp_path / "here.png")
    assert here.read_bytes() == other.read_bytes()


def test_without_matplotlib_it_says_what_to_install(tmp_path, front, monkeypatch):
    monkeypatch.setattr(plots.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r'matplotlib; pip install "rasterjit\[accuracy\]"'):
        front.save_front(made_up_study(), tmp_path / "front.png")
    assert not list(tmp_path.iterdir())
