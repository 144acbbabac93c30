"""Read the file that a command is given, and write those that it makes."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rasterjit.cli_effects import Effects
from rasterjit.cli_options import Look

if TYPE_CHECKING:
    from rasterjit.frame import Frame
    from rasterjit.scene.scene import Scene

OWN_PROCESS = "own process"
"""The object of click's context where the process runs one command and ends."""

GRAPHLESS_FORMATS = (".obj", ".ply", ".stl", ".off")
"""Files that hold no scene graph."""


def warn(message: str, quiet: bool) -> None:
    """Print a warning as one line on standard error."""
    if not quiet:
        click.echo("warning: " + " ".join(message.split()), err=True)


def is_opaque(background: str | None) -> bool:
    """Tell whether a background covers what is behind it."""
    if background is None:
        return True
    from rasterjit.scene.color import linear_color

    return bool(linear_color("background", background)[3] == 1.0)


Places = dict[Path, tuple[str, ...] | str]
"""What each file gets: outputs by name, or ``"picture"`` or ``"depth"``."""


def plan_files(
    output: Path, outputs: tuple[str, ...], depth_file: Path | None
) -> tuple[tuple[str, ...], Places]:
    """Return the outputs to render and the files to write, or raise click's usage error."""
    wanted = dict.fromkeys(outputs)
    places: Places = {}
    suffix = output.suffix.lower()
    if suffix == ".exr":
        # It holds light, not codes.
        wanted = dict.fromkeys("linear" if name == "color" else name for name in outputs)
    if suffix in (".npz", ".exr") or (suffix == ".png" and _is_buffer(outputs)):
        places[output] = tuple(wanted)
    else:
        wanted["color"] = None
        places[output] = "picture"
        others = tuple(name for name in wanted if name != "color")
        if others:
            places[output.with_suffix(".npz")] = others
    if depth_file is not None:
        if any(depth_file.absolute() == place.absolute() for place in places):
            raise click.BadOptionUsage(
                "--depth", f"--depth: {depth_file} is the file of another output"
            )
        wanted["depth"] = None
        places[depth_file] = "depth"
    return tuple(wanted), places


def _is_buffer(outputs: tuple[str, ...]) -> bool:
    """Tell whether one output is asked for that a 16-bit PNG can hold."""
    return len(outputs) == 1 and outputs[0] not in ("color", "linear")


def write_files(frame: Frame, places: Places, depth_scale: float) -> None:
    """Write each file, whole or not at all."""
    from rasterjit.io import images

    for place, content in places.items():
        if content == "picture":
            images.save_image(place, frame.color)
        elif content == "depth":
            images.save_depth(place, frame.depth, scale=depth_scale)
        else:
            frame.save(place, content)


def load_scene(file: Path, look: Look, effects: Effects, quiet: bool) -> Scene:
    """Read a scene, apply look and effects, and print what reading warns of as lines."""
    from rasterjit.io.meshes import load

    if click.get_current_context().find_root().obj == OWN_PROCESS:
        _import_trimesh_for(file)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        scene = load(file, on_invalid=look.on_invalid)
    for warning in caught:
        warn(str(warning.message), quiet)
    look.apply(scene)
    effects.apply(scene)
    return scene


def _import_trimesh_for(file: Path) -> None:
    """
    Import trimesh; without networkx, half of the time it takes, if the file needs none.

    It stays without, so this is for a process that reads one file and ends.
    """
    if file.suffix.lower() not in GRAPHLESS_FORMATS or "networkx" in sys.modules:
        return
    sys.modules["networkx"] = None
    try:
        import trimesh  # noqa: F401
    finally:
        del sys.modules["networkx"]
