"""
Put wheels with machine code beside the pure wheel that hatchling makes.

``RASTERJIT_PLATFORMS`` names the platforms (``rasterjit/runtime/targets.py``), with commas between
them; ``none`` makes the pure wheel alone. If it is not set, ``python -m build`` makes those of all
platforms, since it builds wheels from the source distribution. pip gets the pure wheel, whatever is
set; other installers are not told from builders.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

VARIABLE = "RASTERJIT_PLATFORMS"

STANDARD = "standard"
"""hatchling's name for a wheel that is no editable installation."""

PIP = "PIP_BUILD_TRACKER"
"""Set while pip builds, which would throw all but the pure wheel away."""


class MachineCode(BuildHookInterface):
    """Makes them when the pure wheel is done."""

    PLUGIN_NAME = "custom"

    def platforms(self) -> list[str]:
        """Return the names of the platforms to make wheels for."""
        if PIP in os.environ:
            return []
        chosen = os.environ.get(VARIABLE)
        if chosen is not None:
            return [name for name in chosen.replace(",", " ").split() if name != "none"]
        if not (Path(self.root) / "PKG-INFO").is_file():
            return []
        sys.path.insert(0, str(Path(self.root) / "rasterjit" / "runtime"))
        try:
            from targets import PLATFORMS
        finally:
            del sys.path[0]
        return list(PLATFORMS)

    def dependencies(self) -> list[str]:
        """Return what compiling and linking need."""
        known = self.metadata.core
        needed = [*known.dependencies, *known.optional_dependencies["wheels"]]
        return needed if self.platforms() else []

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Make the wheels, in a process that nobody's settings of Numba reach."""
        names = self.platforms() if version == STANDARD else []
        if names:
            kept = {key: text for key, text in os.environ.items() if not key.startswith("NUMBA_")}
            subprocess.run(
                [sys.executable, "-m", "rasterjit.cli.wheels", artifact_path, *names],
                env={**kept, "PYTHONPATH": self.root, "PYTHONDONTWRITEBYTECODE": "1"},
                cwd=self.root, check=True,
            )  # fmt: skip
