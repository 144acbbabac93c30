"""What qualities cost and buy on this machine, as measured once and kept in the cache folder."""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from rasterjit.scene.quality import Quality, differences

FORMAT = 1
"""Of the file; one of another format is as good as none."""

LADDER = (
    Quality.draft(),
    Quality.standard(),
    Quality(samples=2),
    Quality(samples=4),
    Quality.high(),
    replace(Quality.high(), samples=16),
    replace(Quality.reference(), samples=16, shadow_taps=9, math="polynomial"),
    replace(Quality.reference(), samples=64),
    Quality.reference(),
)
"""The qualities to choose from where nothing was measured, from the fastest on."""


class Step(NamedTuple):
    """A quality to choose from."""

    quality: Quality
    time: float
    """Of a frame, over that of a standard one."""
    error: float
    """Root mean square in linear light, over that of a standard frame."""


@dataclass(frozen=True)
class Profile:
    """
    What qualities cost and buy on a machine.

    Attributes
    ----------
    steps : tuple of Step
        From the fastest on, each more accurate than those before.
    threads : int
        That frames were drawn with.
    """

    steps: tuple[Step, ...]
    threads: int

    @property
    def ladder(self) -> tuple[Quality, ...]:
        """The qualities to choose from, from the fastest on."""
        return tuple(step.quality for step in self.steps)

    def times(self) -> dict[Quality, float]:
        """Return the time of each quality, over that of a standard frame."""
        return {step.quality: step.time for step in self.steps}


def front_of(steps: Sequence[Step]) -> tuple[Step, ...]:
    """Return the steps that no other is both faster and more accurate than, the fastest first."""
    front: list[Step] = []
    for step in sorted(steps, key=lambda step: (step.time, step.error)):
        if not front or step.error < front[-1].error:
            front.append(step)
    return tuple(front)


def cache_folder() -> Path:
    """Return the user's folder for what programs may forget, and RasterJIT's own in it."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "rasterjit"


def profile_file() -> Path:
    """Return where the profile of this machine is kept."""
    return cache_folder() / "profile.json"


def save_profile(profile: Profile, machine: Mapping[str, str]) -> Path:
    """
    Keep the profile of this machine; the file is there whole or not at all.

    Raises
    ------
    ValueError
        Naming the folder, if it cannot be written to.
    """
    content = {
        "format": FORMAT,
        "machine": dict(machine),
        "threads": profile.threads,
        "steps": [
            {
                "settings": differences(step.quality, Quality.standard()),
                "time": step.time,
                "error": step.error,
            }
            for step in profile.steps
        ],
    }
    path = profile_file()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False) as file:
            json.dump(content, file, indent=1)
        os.replace(file.name, path)
    except OSError as error:
        raise ValueError(
            f"the cache folder must be one to write to, but {str(path.parent)!r} is not: {error}"
        ) from None
    return path


def load_profile() -> Profile | None:
    """Return the profile of this machine; ``None`` if there is none that can be read."""
    try:
        content = json.loads(profile_file().read_text())
        steps = front_of([_step(entry) for entry in content["steps"]])
        if content["format"] != FORMAT or not steps:
            return None
        return Profile(steps, int(content["threads"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _step(entry: Any) -> Step:
    """Return a step as it was kept."""
    return Step(Quality(**entry["settings"]), float(entry["time"]), float(entry["error"]))
