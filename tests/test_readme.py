"""The programs of the README run as they are printed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

README = Path(__file__).parent.parent / "README.md"
PROGRAMS = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


# The machine may not be calibrated yet.
@pytest.mark.filterwarnings("ignore::rasterjit.CalibrationWarning")
@pytest.mark.parametrize("program", PROGRAMS, ids=range(1, len(PROGRAMS) + 1))
def test_program_runs(program, tmp_path, monkeypatch, capsys):
    (tmp_path / "models").symlink_to(README.parent / "models")
    monkeypatch.chdir(tmp_path)
    exec(compile(program, "README.md", "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out.strip()
    for name in re.findall(r'save\("(.*?)"\)', program):
        assert (tmp_path / name).stat().st_size > 1000
