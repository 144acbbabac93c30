"""Options of commands that say at which time of a file's animation it is shown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from rasterjit.cli.options import FiniteType, add_options
from rasterjit.scene.validation import question

if TYPE_CHECKING:
    from rasterjit.scene.keyframes import Animation
    from rasterjit.scene.scene import Scene

ANIMATION_HELP = (
    "Name or number of one of the file's animations; default: 0, the first. rasterjit info lists "
    "them."
)


class TimeOptions(NamedTuple):
    """Options that choose a time of an animation."""

    time: float | None = None
    animation: str | None = None

    def apply(self, scene: Scene, file: Path) -> Scene:
        """Return the scene as it is then; itself if no option was given."""
        if self.time is None and self.animation is None:
            return scene
        option = "--animation" if self.time is None else "--time"
        chosen = chosen_animation(scene, file, self.animation, option)
        return scene.at(0.0 if self.time is None else self.time, chosen)


def chosen_animation(scene: Scene, file: Path, asked: str | None, option: str) -> Animation:
    """
    Return an animation by its name or, if none has that name, its number.

    Raises
    ------
    click.BadOptionUsage
        If there is none, or not this one.
    """
    names = [one.name for one in scene.animations]
    if not names:
        raise click.BadOptionUsage(option, f"{option}: {file.name} has no animation")
    if asked is None:
        return scene.animations[0]
    if asked in names:
        return scene.animations[names.index(asked)]
    if asked.isdecimal() and int(asked) < len(names):
        return scene.animations[int(asked)]
    listed = ", ".join(f"{number}: {name!r}" for number, name in enumerate(names))
    raise click.BadOptionUsage(
        "--animation",
        f"--animation: {file.name} has no {asked!r}, but {listed}{question(asked, names)}",
    )


def moment_options(command: Callable) -> Callable:
    """Add `TimeOptions` to a command."""
    return add_options(
        [
            click.option("--time", type=FiniteType(0.0), metavar="SECONDS",
                         help="Time of the animation that is shown; after its end, as at the end. "
                              "Default: as the file poses itself, or 0 with --animation."),
            click.option("--animation", metavar="NAME|NUMBER", help=ANIMATION_HELP),
        ],
        command,
    )  # fmt: skip
