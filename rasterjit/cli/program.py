"""
Define what all commands share: exit status, errors, common options, reading and writing files.

The exit status is 0 if all is done, 1 if it failed, 2 for wrong usage, 130 if interrupted. Errors
are one line on standard error. The options here are those that most commands have.

`load_scene` reads the file that a command is given; `write_files` writes those that it makes.
"""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import click.shell_completion
import numpy as np
from numpy.typing import NDArray

from rasterjit.cli.help import Command, add_advice
from rasterjit.cli.option_types import background_type, color_type, size_type
from rasterjit.cli.options import Effects, SceneOptions, is_given, refuse_unused
from rasterjit.cli.report import collect_warnings, let_streams_escape, say_error, warn
from rasterjit.interrupts import INTERRUPTED, raise_if_interrupted
from rasterjit.outputs.output_table import find_row
from rasterjit.rendering.planning import CULL_MODES

if TYPE_CHECKING:
    from rasterjit.outputs.frame import Frame
    from rasterjit.scene.background import BackgroundImage
    from rasterjit.scene.scene import Scene

DEFAULT_COMMAND = "render"
"""The command to run if a file stands in place of a command."""

DEBUG_KEY = "rasterjit.debug"
"""Key of the flag in click's context."""

FILE_KEY = "rasterjit.file"
"""Key of the file that was read in click's context."""

WARNS_BY_LINES_KEY = "rasterjit.warns_by_lines"
"""Key in click's context: whether warnings are printed as lines."""

SCENE_ERROR = re.compile(r"scene\b")
"""Start of errors about the contents of a file."""

DEFAULT_DEPTH_SCALE = 0.001
"""Default scene units per code of a 16-bit depth PNG: millimetres, if a unit is a metre."""

MIN_DEPTH_CODES = 256
"""Least codes between the nearest and farthest depth with that scale: those of 8 bits."""

MASK_OUTPUTS = ("coverage", "object_id", "instance_id", "material_id", "face_id")
"""Outputs that can be written as masks."""

ARGUMENT_NAMES = re.compile(
    r"\b(on_damage|on_invalid|max_bytes|resource_root|isolate)\b(?: ?= ?'?([^\s';]+)'?)?"
)
"""Options by the library's arguments (or ``argument=value``) in its messages."""

MESSAGE_SUBJECT = re.compile(r"(quality\.)?(\w+)(?= (?:must|has|and)\b)")
"""Start of the library's messages about an argument."""

OWN_PROCESS = "own process"
"""The object of click's context if the process runs a single command and ends."""


class Program(click.Group):
    """A group of commands whose errors are one line; a file in place of a command is rendered."""

    command_class = Command

    def resolve_command(
        self, context: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the named command, or `DEFAULT_COMMAND` for the name of a file."""
        first = args[0]
        if first not in self.commands and (Path(first).name != first or Path(first).suffix
                                           or Path(first).exists()):  # fmt: skip
            return super().resolve_command(context, [DEFAULT_COMMAND, *args])
        return super().resolve_command(context, args)

    def shell_complete(
        self, context: click.Context, incomplete: str
    ) -> list[click.shell_completion.CompletionItem]:
        """Complete commands, and files."""
        found = super().shell_complete(context, incomplete)
        return [*found, click.shell_completion.CompletionItem(incomplete, type="file")]

    def main(self, *arguments: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run a command; print an error as one line and exit with its status."""
        if not standalone_mode:
            return super().main(*arguments, standalone_mode=False, **extra)
        let_streams_escape()
        try:
            code = super().main(*arguments, standalone_mode=False, **extra)
        except click.ClickException as error:
            say_error(add_advice(error))
            code = error.exit_code
        except click.Abort:
            say_error("interrupted")
            code = INTERRUPTED
        sys.exit(code or 0)

    def invoke(self, context: click.Context) -> Any:
        """Run the command; turn errors into `click.ClickException`, unless --debug is given."""
        try:
            return super().invoke(context)
        except (click.ClickException, click.exceptions.Exit, click.Abort, BrokenPipeError):
            raise
        except Exception as error:
            raise_if_interrupted()
            if context.meta.get(DEBUG_KEY):
                raise
            command = self.commands.get(context.invoked_subcommand or "")
            message = name_option(describe_error(error), command)
            if (
                FILE_KEY in context.meta
                and isinstance(error, ValueError)
                and SCENE_ERROR.match(message)
            ):
                message = f"{context.meta[FILE_KEY]}: {message}"
            raise click.ClickException(message) from error


def exit_process() -> None:
    """End the process at once, if it is the command's own, without waiting for drawing threads."""
    if click.get_current_context().find_root().obj == OWN_PROCESS:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def spell_options(message: str) -> str:
    """Return a message of the library with options in place of arguments."""

    def spell(found: re.Match[str]) -> str:
        if found[1] == "isolate":
            return "--no-isolate" if found[2] == "False" else "--isolate"
        option = "--" + found[1].replace("_", "-")
        return option if found[2] is None else f"{option} {found[2]}"

    return ARGUMENT_NAMES.sub(spell, message)


def name_option(message: str, command: click.Command | None) -> str:
    """Return a message about an argument as one about the command's option, if there is one."""
    found = MESSAGE_SUBJECT.match(message)
    if found is None or command is None:
        return message
    name = {"eye": "position", "fov_y": "fov"}.get(found[2], found[2])
    for option in command.params:
        if option.name == name and isinstance(option, click.Option):
            return max(option.opts, key=len) + message[found.end() :]
    if found[1] and any(option.name == "changes" for option in command.params):
        return f"--set {name}" + message[found.end() :]
    return message


def describe_error(error: Exception) -> str:
    """Return an error as a line, without a traceback."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    if isinstance(error, (ValueError, OSError)) and str(error):
        return spell_options(str(error))
    if isinstance(error, ImportError) and "pip install" in str(error):
        return str(error)
    if isinstance(error, MemoryError):
        return f"not enough memory: {error}" if str(error) else "not enough memory"
    return f"{type(error).__name__}: {error} (--debug shows where)"


def get_reason(error: Exception) -> str:
    """Return the reason why a file could not be drawn."""
    return (
        error.format_message() if isinstance(error, click.ClickException) else describe_error(error)
    )


def _set_debug(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Store the flag, wherever it stands on the line."""
    if value:
        context.meta[DEBUG_KEY] = True


debug_option = click.option(
    "--debug", is_flag=True, expose_value=False, callback=_set_debug,
    help="Show the traceback of an error.",
)  # fmt: skip
quiet_option = click.option(
    "-q", "--quiet", is_flag=True,
    help="Print only errors.",
)  # fmt: skip
threads_option = click.option(
    "--threads", type=click.IntRange(1, 1024),
    help="Number of threads; default: all processors. Any number draws the same picture.",
)  # fmt: skip
color_behind_option = click.option(
    "--background", type=color_type,
    help="A CSS colour name, #rrggbb, #rrggbbaa or transparent; default: the environment if there "
    "is one, else white.",
)  # fmt: skip
background_option = click.option(
    "--background", type=background_type, metavar="COLOR|FILE",
    help="A CSS colour name, #rrggbb, #rrggbbaa or transparent; or a picture file (a name with a "
    "dot or slash), which sets the size. Default: the environment if there is one, else that of "
    "the style, else white.",
)  # fmt: skip
cull_option = click.option(
    "--cull", type=click.Choice(CULL_MODES), default="none", show_default=True,
    help="Faces to leave out. Counter-clockwise is the front.",
)  # fmt: skip
file_argument = click.argument("file", type=click.Path(path_type=Path))


def size_option(default: str) -> Callable:
    """Return the option ``--size``."""
    return click.option(
        "--size", type=size_type, default=default, show_default=True, metavar="WxH",
        help="Size of the picture, pixels.",
    )  # fmt: skip


def choose_size(background: str | BackgroundImage | None, size: tuple[int, int]) -> tuple[int, int]:
    """Return the given size of the picture, or else that of the background picture."""
    if background is None or isinstance(background, str):
        return size
    if not is_given("size"):
        return background.size
    try:
        background.check_size(size)
    except ValueError:
        (width, height), (wide, high) = background.size, size
        raise click.BadOptionUsage(
            "--size",
            f"--size: {wide}x{high} is not the size of the picture behind, {width}x{height}: leave "
            "--size out, or scale the picture",
        ) from None
    return size


def is_opaque(background: str | BackgroundImage | None) -> bool:
    """Tell whether a background is opaque."""
    if background is None:
        return True
    if not isinstance(background, str):
        return background.is_opaque
    from rasterjit.scene.color import linear_color

    return bool(linear_color("background", background)[3] == 1.0)


FileContents = dict[Path, tuple[str, ...] | str]
"""Contents of each output file: outputs by name, ``"picture"``, or the name of its option."""


def plan_files(
    output: Path, outputs: tuple[str, ...], besides: dict[str, tuple[Path | None, str]]
) -> tuple[tuple[str, ...], FileContents]:
    """
    Return the outputs to render and the files to write, or raise click's usage error.

    Parameters
    ----------
    output : Path
    outputs : tuple of str
    besides : dict of (Path or None, str)
        By option, a file of its own for one output.

    Returns
    -------
    outputs : tuple of str
    places : dict
        One output alone, but the colour, and all in a file of several go to ``output``; otherwise
        that is the picture, and the others go to an ``.npz`` beside it.
    """
    wanted = dict.fromkeys(outputs)
    places: FileContents = {}
    suffix = output.suffix.lower()
    if suffix == ".exr":
        # It holds light, not codes.
        wanted = dict.fromkeys("linear" if name == "color" else name for name in outputs)
    formats = _list_single_formats(outputs)
    if formats and suffix not in formats:
        raise click.BadOptionUsage(
            "--outputs",
            f"--outputs: {output} cannot hold {outputs[0]} alone: end it in one of "
            f"{', '.join(formats)}; or ask for color,{outputs[0]}: it goes to an .npz beside",
        )
    if suffix in (".npz", ".exr") or formats:
        places[output] = tuple(wanted)
    else:
        wanted["color"] = None
        places[output] = "picture"
        others = tuple(name for name in wanted if name != "color")
        if others:
            places[output.with_suffix(".npz")] = others
    for option, (file, name) in besides.items():
        if file is None:
            continue
        if any(file.absolute() == place.absolute() for place in places):
            raise click.BadOptionUsage(option, f"{option}: {file} is the file of another output")
        wanted[name] = None
        places[file] = name
    return tuple(wanted), places


def _list_single_formats(outputs: tuple[str, ...]) -> tuple[str, ...]:
    """Return the formats for the only output; () for colour, or several outputs."""
    if len(outputs) > 1 or outputs[0] == "color":
        return ()
    return (".npz", ".exr") if outputs[0] == "linear" else (".png", ".npz", ".exr")


def refuse_unused_scale(places: FileContents) -> None:
    """Raise click's usage error for a ``--scale`` that no file uses."""
    if not any(_takes_scale(place, content) for place, content in places.items()):
        refuse_unused(["scale"], "no output is written to a 16-bit .png")


def write_files(
    frame: Frame, places: FileContents, scale: float | None, colorbar: str | None = None
) -> dict[Path, float]:
    """
    Write each file, whole or not at all; none if one of 16-bit codes cannot hold its values.

    Parameters
    ----------
    frame : Frame
    places : dict
        As `plan_files` returns them.
    scale : float or None
        As ``--scale``.
    colorbar : str, optional
        The title of the colour bar that a picture of the colour has.

    Returns
    -------
    dict of float
        The scales that were chosen, by file.
    """
    arrays = frame.arrays()
    chosen = {
        place: choose_depth_scale(place, arrays["depth"])
        for place, content in places.items()
        if content == "depth" and scale is None and _takes_scale(place, content)
    }
    scales = {
        place: chosen.get(place, scale) if _takes_scale(place, content) else None
        for place, content in places.items()
    }
    try:
        if len(places) > 1:
            _check_codes(arrays, places, scales)
        for place, content in places.items():
            _write_file(frame, place, content, scales[place], colorbar)
    except ValueError as error:
        said = str(error).replace("scale must be None for", "scale must not be given for")
        raise ValueError(re.sub(r"\bscale(=| must)", _spell_scale, said)) from error
    return chosen


def choose_depth_scale(place: Path, depth: NDArray[np.float32]) -> float:
    """Return scene units per code for a frame's depth, or raise ``ValueError``."""
    from rasterjit.outputs.save import MAX_CODE, find_decimal_scale, find_nearest_code

    seen = depth[np.isfinite(depth)]
    if not seen.size:
        return DEFAULT_DEPTH_SCALE
    nearest, farthest = float(seen.min()), float(seen.max())
    low, high = (find_nearest_code(end, DEFAULT_DEPTH_SCALE) for end in (nearest, farthest))
    if low >= 1 and high <= MAX_CODE and high - low >= MIN_DEPTH_CODES - 1:
        return DEFAULT_DEPTH_SCALE
    scale = find_decimal_scale(seen)
    if scale is None:
        raise ValueError(
            f"--depth: no scale takes depths from {nearest:g} to {farthest:g} to the 16-bit codes "
            f"of {place}: choose .exr or .npy"
        )
    return scale


def _check_codes(
    arrays: dict[str, NDArray[Any]], places: FileContents, scales: dict[Path, float | None]
) -> None:
    """Raise ``ValueError`` if a PNG of 16-bit codes cannot hold its values."""
    from rasterjit.outputs.save import encode_output

    for place, content in places.items():
        if place.suffix.lower() == ".png" and content not in ("picture", "coverage"):
            (name,) = (content,) if isinstance(content, str) else content
            encode_output(name, arrays[name], scales[place])


def _write_file(
    frame: Frame,
    place: Path,
    content: tuple[str, ...] | str,
    scale: float | None,
    colorbar: str | None,
) -> None:
    """Write a file; ``scale`` of those of floats in codes, ``colorbar`` of those of the colour."""
    from rasterjit.io import images

    if content == "picture" and colorbar is not None:
        frame.save(place, colorbar=colorbar)
    elif content == "picture":
        images.save_image(place, frame.color)
    elif content == "coverage":
        shares = np.floor(255.0 * frame.coverage + 0.5)
        images.save_image(place, shares.astype(np.uint8))
    else:
        frame.save(place, content, scale=scale)


def format_codes_line(place: Path, content: tuple[str, ...] | str, scale: float | None) -> str:
    """Return a note on a file of 16-bit codes with its ``scale``."""
    if scale is not None:
        return f"  16 bits, a code is {scale:g} units (--scale {scale:g}), 0 is nothing"
    names = (content,) if isinstance(content, str) else content
    is_numbers = content != "picture" and all(find_row(name).dtype == "int32" for name in names)
    if place.suffix.lower() == ".png" and is_numbers:
        return "  16 bits, numbers plus one, 0 is nothing"
    return ""


def _takes_scale(place: Path, content: tuple[str, ...] | str) -> bool:
    """Tell whether a file holds floats in 16-bit codes."""
    if place.suffix.lower() != ".png" or content in ("picture", "coverage"):
        return False
    names = (content,) if isinstance(content, str) else content
    return any(find_row(name).dtype == "float32" for name in names)


def _spell_scale(found: re.Match[str]) -> str:
    """Return the option for an argument of ``Frame.save``."""
    return f"--scale{found[1].replace('=', ' ')}"


def load_scene(file: Path, look: SceneOptions, effects: Effects, quiet: bool) -> Scene:
    """Read a scene, apply look and effects, and print the reader's warnings as lines."""
    from rasterjit.io.meshes import load

    with collect_warnings() as caught:
        scene = load(
            file,
            on_invalid=look.on_invalid,
            on_damage=look.on_damage,
            resource_root=look.resource_root,
            max_bytes=look.max_bytes,
            isolate=look.isolate,
        )
    raise_if_interrupted()
    click.get_current_context().meta[FILE_KEY] = file
    for warning in caught:
        warn(spell_options(str(warning.message)), quiet)
    look.apply(scene)
    effects.apply(scene)
    _warn_by_lines(quiet)
    return scene


def _warn_by_lines(quiet: bool) -> None:
    """Print warnings of drawing as lines, until the command ends."""
    context, known = click.get_current_context(), warnings.showwarning
    if context.meta.get(WARNS_BY_LINES_KEY):
        return

    def show(message: Warning | str, category: type[Warning], *rest: Any) -> None:
        if issubclass(category, UserWarning):
            warn(spell_options(str(message)), quiet)
        else:
            known(message, category, *rest)

    def restore() -> None:
        warnings.showwarning = known

    context.meta[WARNS_BY_LINES_KEY] = True
    warnings.showwarning = show
    context.call_on_close(restore)
