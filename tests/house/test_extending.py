"""The effect that ``docs/guides/extending.md`` shows works in a copy of the package."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/guides/extending.md"


def blocks(language):
    """Return the blocks of a language, each with the file that its first line names."""
    text = PAGE.read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n# (\S+)\n(.*?)```", text, re.DOTALL)


def add_lines(text, change):
    """Return a text with each line that begins with + put behind the one before it."""
    before = None
    for line in change.splitlines():
        if line.startswith("+"):
            assert text.count(f"{before}\n") == 1, before
            text = text.replace(f"{before}\n", f"{before}\n{line[1:]}\n")
        before = line[1:]
    return text


def test_the_effect_of_the_page_works(tmp_path):
    shutil.copytree(
        ROOT / "rasterjit", tmp_path / "rasterjit", ignore=shutil.ignore_patterns("__pycache__")
    )
    (tmp_path / "models").symlink_to(ROOT / "models")
    files = dict(blocks("py"))
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    for name, change in blocks("diff"):
        path = tmp_path / name
        path.write_text(add_lines(path.read_text("utf-8"), change), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "use.py"],
        cwd=tmp_path, capture_output=True, text=True, timeout=600,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    reason, codes = done.stdout.splitlines()
    assert "4 levels" in reason
    before, after = (int(word) for word in re.findall(r"\d+", codes))
    assert after <= 6 < before
    assert (tmp_path / "posterize.png").stat().st_size > 300
