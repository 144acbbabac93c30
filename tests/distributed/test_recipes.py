"""The recipes of docs/guides/workers.md run as they are printed, and draw the same views."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/guides/workers.md").read_text(encoding="utf-8")
RECIPES = dict(
    re.findall(r"^## ([^\n]*)\n(?:(?!^## ).)*?^```py\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
)
"""Programs of the page by their headings."""
MODULE, ARRAY = "A module for all recipes", "SLURM: an array of jobs"
NEEDED = {"joblib": "joblib", "Ray": "ray", "Dask": "distributed"}

pytestmark = [pytest.mark.takes_long, pytest.mark.needs_jit]


@pytest.fixture
def run(tmp_path):
    """Return a function that runs a command in a folder with the models and the shared module."""
    (tmp_path / "models").symlink_to(ROOT / "models")
    (tmp_path / "views.py").write_text(RECIPES[MODULE], encoding="utf-8")

    def run_there(*command, **variables):
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=300,
            env=os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"} | variables,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout.strip().splitlines()[-1]

    return run_there


@pytest.mark.parametrize("name", sorted(RECIPES.keys() - {MODULE, ARRAY}))
def test_a_recipe_counts_what_one_process_counts(name, run, tmp_path):
    if name in NEEDED:
        pytest.importorskip(NEEDED[name], reason=f"needs {name}: pip install {NEEDED[name]}")
    (tmp_path / "recipe.py").write_text(RECIPES[name], encoding="utf-8")
    lone = "import views; print(views.count_views(views.ANGLES))"
    assert run(sys.executable, "recipe.py") == run(sys.executable, "-c", lone)


def test_jobs_of_an_array_draw_each_view_once_and_go_on(run, tmp_path):
    (job_script,) = re.findall(r"^```bash\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    (tmp_path / "draw_array.py").write_text(RECIPES[ARRAY], encoding="utf-8")
    # What SLURM does on each node.
    stand_in = f'srun() {{ "$@"; }}\npython() {{ {sys.executable} "$@"; }}\n'
    (tmp_path / "array.sh").write_text(stand_in + job_script, encoding="utf-8")

    def run_array():
        jobs = [{"SLURM_ARRAY_TASK_ID": str(job)} for job in range(4)]
        return [run("bash", "array.sh", SLURM_ARRAY_TASK_COUNT="4", **job) for job in jobs]

    assert run_array() == [f"job {job}: 10 views drawn" for job in range(4)]
    made = {path.name: path.read_bytes() for path in tmp_path.glob("view_*.png")}
    assert sorted(made) == [f"view_{angle:03}.png" for angle in range(0, 360, 9)]
    (tmp_path / "view_009.png").unlink()
    assert run_array() == [f"job {job}: {int(job == 1)} views drawn" for job in range(4)]
    assert made == {path.name: path.read_bytes() for path in tmp_path.glob("view_*.png")}
