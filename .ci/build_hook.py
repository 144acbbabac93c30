"""
Put LLVM's text of kernels into the source distribution, and platform wheels beside the pure one.

``RASTERJIT_PLATFORMS`` names the platforms (``rasterjit/runtime/targets.py``), with commas between
them; ``none`` makes no text, and the pure wheel alone. If it is not set, a source distribution gets
the text for all platforms, and ``python -m build``, which builds wheels from that, makes those of
all. pip gets the pure wheel, whatever is set; other installers are not told from builders.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

VARIABLE = "RASTERJIT_PLATFORMS"

STANDARD, SOURCES = "standard", "sdist"
"""hatchling's names for a wheel that is no editable installation, and for source distributions."""

PIP = "PIP_BUILD_TRACKER"
"""Set while pip builds, which would throw all but the pure wheel away."""


class MachineCode(BuildHookInterface):
    """Makes what is compiled: text before the archive is written, wheels after the pure one."""

    PLUGIN_NAME = "custom"

    def platforms(self) -> list[str]:
        """Return the names of the platforms to make wheels for."""
        if PIP in os.environ:
            return []
        chosen = os.environ.get(VARIABLE)
        if chosen is not None:
            return [name for name in chosen.replace(",", " ").split() if name != "none"]
        if self.target_name != SOURCES and not (Path(self.root) / "PKG-INFO").is_file():
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

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the text of a source distribution."""
        names = self.platforms() if self.target_name == SOURCES else []
        if names:
            self._folder = tempfile.TemporaryDirectory()
            self._run("texts", self._folder.name, *names)
            for path in Path(self._folder.name).iterdir():
                build_data["force_include"][str(path)] = f"rasterjit/machine_code/{path.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Make the wheels."""
        names = self.platforms() if version == STANDARD and self.target_name != SOURCES else []
        if names:
            self._run(artifact_path, *names)

    def _run(self, *arguments: str) -> None:
        """Run `rasterjit.cli.wheels` in a process that nobody's settings of Numba reach."""
        kept = {key: text for key, text in os.environ.items() if not key.startswith("NUMBA_")}
        subprocess.run(
            [sys.executable, "-m", "rasterjit.cli.wheels", *arguments],
            env={**kept, "PYTHONPATH": self.root, "PYTHONDONTWRITEBYTECODE": "1"},
            cwd=self.root, check=True,
        )  # fmt: skip
