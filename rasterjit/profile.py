"""What qualities cost and buy on this machine, as measured once and kept in the cache folder."""

from __future__ import annotations

import json
import math
import os
import platform
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from rasterjit.io.images import replacing
from rasterjit.kernels.jit import cpu_features
from rasterjit.scene.quality import Quality, differences
from rasterjit.workers import available_processors

Item = TypeVar("Item")

FORMAT = 1
"""Of the file; one of another format is as good as none."""

DECIDING = ("cpu", "architecture", "processors")
"""What of the machine decides how qualities compare: with another one there is no profile."""

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


def front_of(items: Iterable[Item], cost: Callable[[Item], tuple[float, float]]) -> list[Item]:
    """Return the items that no other is both faster and more accurate than, the fastest first."""
    front: list[Item] = []
    for item in sorted(items, key=cost):
        if not front or cost(item)[1] < cost(front[-1])[1]:
            front.append(item)
    return front


def front_of_steps(steps: Iterable[Step]) -> tuple[Step, ...]:
    """Return the steps that no other is both faster and more accurate than, the fastest first."""
    return tuple(front_of(steps, lambda step: (step.time, step.error)))


def machine() -> dict[str, str]:
    """Return what times depend on."""
    return {
        "cpu": cpu_features()[0],
        "architecture": platform.machine(),
        "processors": str(available_processors()),
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
    }


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


def save_profile(profile: Profile) -> Path:
    """
    Keep the profile of this machine; the file is there whole or not at all.

    Raises
    ------
    ValueError
        Naming the folder, if it cannot be written to.
    """
    content = {
        "format": FORMAT,
        "machine": machine(),
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
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(content, indent=1))
    except OSError as error:
        raise ValueError(
            f"the cache folder must be one to write to, but {str(path.parent)!r} is not: {error}"
        ) from None
    return path


def load_profile() -> Profile | None:
    """Return the profile of this machine; ``None`` if there is none, or none that can be read."""
    try:
        content = json.loads(profile_file().read_text())
        here = machine()
        is_of_here = all(content["machine"][name] == here[name] for name in DECIDING)
        steps = front_of_steps([_step(entry) for entry in content["steps"]])
        if content["format"] != FORMAT or not is_of_here or not steps:
            return None
        return Profile(steps, int(content["threads"]))
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


def _step(entry: Any) -> Step:
    """Return a step as it was kept; raise ``ValueError`` for times and errors that cannot be."""
    time, error = float(entry["time"]), float(entry["error"])
    if not (0.0 < time < math.inf and 0.0 <= error < math.inf):
        raise ValueError(f"a step must take time and have an error, got {entry!r}")
    return Step(Quality(**entry["settings"]), time, error)
