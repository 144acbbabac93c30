"""Pictures of files: ``rasterjit render`` for one or several."""

from __future__ import annotations

import dataclasses
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rasterjit.cli import program, report
from rasterjit.cli.option_types import FiniteType, file_type, lens_type, outputs_type
from rasterjit.cli.options import (
    OUTPUTS_HELP,
    PAINT_OPTIONS,
    QUALITY_OPTIONS,
    RenderOptions,
    apply_style,
    check_place,
    flag,
    is_drawing,
    is_given,
    is_picture,
    option,
    refuse_picture,
    refuse_unused,
    refuse_without_color,
)
from rasterjit.interrupts import raise_if_interrupted

if TYPE_CHECKING:
    from rasterjit.scene.background import BackgroundImage
    from rasterjit.scene.lens import Lens
    from rasterjit.scene.outline import Outline

PNG = ".png"

LINE_STYLES = ("technical", "wireframe")
"""Styles of line drawings, the default first."""

NOT_OF_LINES = (
    "lens", "outputs", "depth_file", "scale", "mask_file", "mask_of", "colorbar", "diagnose",
    "stats", "cull", "light", "shadows", "environment", "ambient_occlusion", "eye_dome", "tone_map",
    "exposure", "vignette", "wireframe", "wireframe_color", "section_lines", *PAINT_OPTIONS,
)  # fmt: skip
"""Options that have no effect on line drawings."""


@dataclasses.dataclass(frozen=True)
class PictureOptions:
    """
    Requested outputs of a file's picture, by the names of the options.

    Parameters
    ----------
    lens : Lens, optional
        opencv:K1,K2,P1,P2,K3,... or fisheye:K1,K2,K3,K4, OpenCV's coefficients of a calibrated
        camera's lens; or panorama, of a --size twice as wide as high.
    outputs : tuple of str
    depth_file : Path, optional
        Write the depth as well: .exr (float32), .png (16 bits), .npy or .npz.
    scale : float, optional
    mask_file : Path, optional
        Write a mask of the objects as .png: 255 where they cover the whole pixel, less where they
        cover a part of its --samples.
    mask_of : str
        What --mask holds; numbers are stored plus one, in 16 bits, and 0 is nothing.
    colorbar : bool
        Put a colour bar of --scalars to the right of the picture.
    diagnose : bool
        Print exactly what happened to every face, and how precise the numbers are.
    stats : bool
        Print what happened to the triangles, and where the time went.
    size, background, cull, threads, quiet
        As all commands have them.
    """

    size: tuple[int, int]
    background: str | BackgroundImage | None
    cull: str
    threads: int | None
    quiet: bool
    lens: Lens | None = option(lens_type, metavar="LENS")
    outputs: tuple[str, ...] = option(
        outputs_type, default="color", metavar="NAMES",
        help=f"{OUTPUTS_HELP} Beside a picture, other outputs go to OUT with the suffix .npz. A "
        "single one that is not the colour becomes a 16-bit .png if OUT is a .png.",
    )  # fmt: skip
    depth_file: Path | None = option(file_type("depth"), "--depth", metavar="FILE")
    scale: float | None = option(
        FiniteType(0.0, min_open=True), metavar="UNITS",
        help="Scene units that a code of a 16-bit .png stands for, as in Frame.save. Default: for "
        f"--depth, {program.DEFAULT_DEPTH_SCALE} if that fits and keeps {program.MIN_DEPTH_CODES} "
        "codes, else the smallest power of ten that fits; for other outputs, what fits the values "
        "best.",
    )  # fmt: skip
    mask_file: Path | None = option(file_type("mask"), "--mask", metavar="FILE")
    mask_of: str = option(click.Choice(program.MASK_OUTPUTS), default="coverage")
    colorbar: bool = flag()
    diagnose: bool = flag()
    stats: bool = flag()


def plan_places(
    files: tuple[Path, ...], output: Path | None, suffix: str, force: bool
) -> dict[Path, Path]:
    """
    Return the path of each file's picture, or raise click's usage error.

    Parameters
    ----------
    files : tuple of Path
    output : Path or None
        Of one file the name of the picture or a folder, of several a folder, which is made.
    suffix : str
        Of pictures whose names are not given, ``".png"``.
    force : bool
        Whether pictures whose names are not given replace files.
    """
    folders = [file for file in files if file.is_dir()]
    if folders:
        raise click.UsageError(f"{folders[0]} is a folder: give it alone")
    pictures = [file for file in files if is_picture(file)]
    if pictures:
        raise click.UsageError(
            f"{pictures[0]} is the name of a picture, not of a mesh file: -o {pictures[0]} names "
            "what is written"
        )
    if len(files) == 1 and output is not None and not output.is_dir():
        kind = "drawing" if is_drawing(output) else "image"
        return {files[0]: check_place("output", output, kind)}
    if output is not None and output.exists() and not output.is_dir():
        raise click.BadOptionUsage(
            "--output", f"--output: {output} is a file, and the pictures of several go to a folder"
        )
    if output is not None:
        refuse_picture("several files", output)
    folder = Path() if output is None else output
    places = {file: folder / name for file, name in choose_names(files, suffix).items()}
    if output is None and any(place.parent != folder for place in places.values()):
        names = [file.with_suffix(suffix).name for file in files]
        name = next(one for one in names if names.count(one) > 1)
        raise click.UsageError(
            f"several pictures would have the same name, {name}: -o DIR keeps the files' folders"
        )
    for place in places.values():
        if place.exists() and not force:
            raise click.UsageError(f"{place} exists: --force replaces it, -o OUT names another")
    if output is not None:
        output.mkdir(exist_ok=True)
    return places


def choose_names(files: tuple[Path, ...], suffix: str) -> dict[Path, Path]:
    """
    Return distinct names for the pictures of several files.

    ``a/b.obj`` becomes ``b.png``; where that would be two pictures, files keep the folders in which
    they differ, and where that is not enough, their suffix: ``a/b.obj.png``.
    """
    places = {file: Path(os.path.abspath(file)) for file in files}
    known: set[Path] = set()
    for file, place in places.items():
        if place in known:
            raise click.UsageError(f"{file} is given twice")
        known.add(place)
    root = Path(os.path.commonpath([place.parent for place in places.values()]))
    below = {file: place.relative_to(root) for file, place in places.items()}
    choices = (
        lambda file: Path(file.with_suffix(suffix).name),
        lambda file: below[file].with_suffix(suffix),
        lambda file: below[file].with_name(file.name + suffix),
    )
    for choose in choices:
        named = {file: choose(file) for file in files}
        if len({_as_system_sees(name) for name in named.values()}) == len(files):
            break
    return named


def _as_system_sees(name: Path) -> str:
    """Return what two names have in common that are one file: on macOS and Windows, in any case."""
    return str(name).casefold() if sys.platform in ("darwin", "win32") else str(name)


def write_to_standard_output(
    files: tuple[Path, ...],
    asked: PictureOptions,
    shown: RenderOptions,
) -> None:
    """Write only the picture of a file to standard output."""
    if len(files) > 1:
        raise click.UsageError("--output - takes the picture of one FILE")
    if asked.stats or asked.diagnose:
        raise click.UsageError("--output - is the picture alone: leave --stats, --diagnose out")
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / f"picture{PNG}"
        if len(program.plan_files(place, asked.outputs, {})[1]) > 1:
            raise click.UsageError("--output - is one picture: name one of --outputs")
        render_file(files[0], place, dataclasses.replace(asked, quiet=True), shown)
        content = place.read_bytes()
    sys.stdout.buffer.write(content)
    sys.stdout.buffer.flush()


def render_files(
    places: dict[Path, Path],
    asked: PictureOptions,
    shown: RenderOptions,
) -> None:
    """Draw several files; name those that fail, and fail at the end."""
    failed = 0
    for file, place in places.items():
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            render_file(file, place, asked, shown)
        except (click.UsageError, click.Abort, BrokenPipeError):
            raise
        except Exception as error:
            raise_if_interrupted()
            failed += 1
            report.warn(f"left out {file}: {program.get_reason(error)}", asked.quiet)
    if failed:
        raise click.ClickException(f"{failed} of {len(places)} files could not be drawn")


def render_file(file: Path, output: Path, asked: PictureOptions, shown: RenderOptions) -> None:
    """Draw a file, write its outputs, and print a line."""
    from rasterjit.io.images import OPAQUE_FORMATS

    if is_drawing(output):
        draw_lines(file, output, asked, shown)
        return
    view, look, effects, moment = shown
    background, calibrated = asked.background, view.calibrated()
    size = program.choose_size(background, view.find_size(asked.size))
    lens = asked.lens if calibrated is None else calibrated.lens
    if output.suffix.lower() in OPAQUE_FORMATS and not program.is_opaque(background):
        raise click.BadOptionUsage(
            "--background", f"--background: {output.suffix} cannot be transparent; choose .png"
        )
    if asked.mask_file is None:
        refuse_unused(["mask_of"], "it is for --mask")
    besides = {"--depth": (asked.depth_file, "depth"), "--mask": (asked.mask_file, asked.mask_of)}
    wanted, places = program.plan_files(output, asked.outputs, besides)
    program.refuse_unused_scale(places)
    if "picture" not in places.values():
        refuse_unused(["colorbar"], f"{output} is no picture of the colour")
    title = look.scalars if asked.colorbar else None
    refuse_without_color(wanted)
    from rasterjit.cli.warmup import list_first_tasks
    from rasterjit.rendering.view_warnings import ViewWarning, warnings_of_frame
    from rasterjit.runtime.background_compile import compile_in_background
    from rasterjit.scene.warning import silence_warnings

    quiet, start = asked.quiet, time.perf_counter()
    options: dict[str, Any] = {
        "outputs": wanted, "background": background, "cull": asked.cull, "lens": lens,
    }  # fmt: skip
    effects.quality()
    with (
        report.show_spinner(f"Rendering {file.name}", quiet) as line,
        report.show_compile_progress(quiet, line),
        compile_in_background(list_first_tasks, asked.threads, at_once=True),
        # Said below, as lines.
        silence_warnings(ViewWarning),
    ):
        scene = moment.apply(program.load_scene(file, look, effects, quiet), file)
        camera = view.camera(scene, size)
        loaded = time.perf_counter()
        style = apply_style(scene, camera, look, effects)
        exposure = report.format_exposure(scene, style)
        frame = style.render(size=size, diagnose=asked.diagnose, threads=asked.threads, **options)
        rendered = time.perf_counter()
        chosen = program.write_files(frame, places, asked.scale, title)
    saved = time.perf_counter()
    for notice in warnings_of_frame(frame).values():
        report.warn(notice, quiet)
    if quiet:
        return
    if exposure:
        report.say(exposure)
    if asked.stats:
        seconds = {"load": loaded - start, **frame.stats.seconds, "save": saved - rendered}
        report.print_stats(frame, seconds, saved - start)
    if asked.diagnose:
        report.print_diagnostics(frame.diagnostics)
    for number, place in enumerate(places):
        told = report.format_frame(frame, saved - start) if number == 0 else ""
        told += program.format_codes_line(place, places[place], chosen.get(place))
        report.say(f"wrote {place}{told}")


def draw_lines(file: Path, output: Path, asked: PictureOptions, shown: RenderOptions) -> None:
    """Write the visible edges of a file as vector graphics, a point to the pixel."""
    view, look, effects, moment = shown
    style = effects.style if is_given("style") else LINE_STYLES[0]
    if style not in LINE_STYLES:
        raise click.BadOptionUsage(
            "--style",
            f"--style: {output} holds lines, {' or '.join(LINE_STYLES)}, not {style}",
        )
    refuse_unused((*NOT_OF_LINES, *QUALITY_OPTIONS), f"{output} holds lines alone")
    if not (asked.background is None or isinstance(asked.background, str)):
        raise click.BadOptionUsage("--background", f"--background: {output} holds no picture")
    calibrated, size = view.calibrated(), view.find_size(asked.size)
    if calibrated is not None and calibrated.lens is not None:
        raise click.BadOptionUsage("--camera", f"--camera: {output} cannot be bent by a lens")
    from rasterjit.hidden_lines.drawing import line_drawing
    from rasterjit.hidden_lines.edges import DEFAULT_KINDS, KINDS

    start = time.perf_counter()
    with (
        report.show_spinner(f"Drawing {file.name}", asked.quiet) as line,
        report.show_compile_progress(asked.quiet, line),
    ):
        scene = moment.apply(program.load_scene(file, look, effects, asked.quiet), file)
        effects = dataclasses.replace(effects, style=style)
        styled = apply_style(scene, view.camera(scene, size), look, effects)
        kinds = DEFAULT_KINDS if style == LINE_STYLES[0] else KINDS
        drawing = line_drawing(
            styled.scene, styled.camera, size, edges=kinds, threads=asked.threads
        )
        drawing.save(output, background=asked.background, **_choose_pens(styled.scene.outline))
    if not asked.quiet:
        seconds = time.perf_counter() - start
        lines = drawing.visible.tolist().count(True)
        report.say(f"wrote {output}  {size[0]}x{size[1]} points  {lines:,} lines  {seconds:.2f} s")


def _choose_pens(outline: Outline | None) -> dict[str, Any]:
    """Return how options say that lines are drawn; without them, as `LineDrawing.save` does."""
    if outline is None:
        return {}
    pens: dict[str, Any] = {"hidden": outline.hidden, "dash": outline.dash}
    if is_given("outline_width"):
        pens["width"] = outline.width
    return pens
