"""
Define the commands of ``rasterjit``, one function each.

They are ``render``, ``turntable``, ``dataset``, ``view``, ``info``, ``explain``, ``accuracy``,
``warmup`` and ``doctor``. Modules that are slow to import are imported by the commands that need
them.
"""

from __future__ import annotations

import dataclasses
import gc
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rasterjit.cli import option_types, render_files
from rasterjit.cli.dataset import dataset_options
from rasterjit.cli.options import (
    OUTPUTS_HELP,
    READING_OPTIONS,
    add_options,
    apply_style,
    effect_options,
    find_animation,
    flag,
    gather_options,
    gather_render_options,
    look_options,
    moment_options,
    option,
    orbit_options,
    reading_options,
    refuse_picture,
    refuse_unused,
    style_option,
    unsettled_options,
    view_options,
)
from rasterjit.cli.program import (
    INTERRUPTED,
    OWN_PROCESS,
    Program,
    background_option,
    choose_size,
    color_behind_option,
    cull_option,
    debug_option,
    exit_process,
    file_argument,
    is_opaque,
    load_scene,
    quiet_option,
    size_option,
    threads_option,
)
from rasterjit.cli.report import (
    iterate_with_progress,
    print_profile,
    say,
    show_compile_progress,
    show_progress_bar,
    show_spinner,
)
from rasterjit.scene.quality import LEVELS

if TYPE_CHECKING:
    from rasterjit.scene.background import BackgroundImage
    from rasterjit.scene.lens import Lens

GARBAGE_THRESHOLD = 100_000
"""Allocations between two garbage collections; Python's default is 700."""

TURN_FRAMES = 36
"""Frames of a turntable without an animation."""

STANDARD_OUTPUT = "-"

BACKENDS = ("auto", "window", "browser", "terminal")


@click.group(
    cls=Program,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.option("--version", is_flag=True, help="Show the version.")
@debug_option
@click.pass_context
def program(context: click.Context, version: bool) -> None:
    """
    Render meshes to pictures and exact ground-truth buffers on a CPU.

    "rasterjit FILE" is short for "rasterjit render FILE".
    """
    if version:
        from rasterjit import __version__

        say(f"rasterjit {__version__}")
        context.exit()
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


@program.command(short_help="Render FILE to a picture.")
@click.argument("files", metavar="FILE...", nargs=-1, required=True,
                type=click.Path(path_type=Path))  # fmt: skip
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="OUT",
    help="Picture to write (.png, .jpg, .webp, .tif ...), .svg or .pdf for edges as lines, .npz or "
    ".exr for all outputs; a folder, for several FILEs or a folder of meshes; - for a PNG on "
    "standard output. Default: FILE's name with .png, in the current folder.",
)  # fmt: skip
@click.option("--force", is_flag=True,
              help="Replace files that exist; one that OUT names is replaced anyway. Of a folder, "
              "draw pictures anew that are there.")  # fmt: skip
@click.option("--format", "suffix", type=option_types.format_type, default="png", show_default=True,
              help="Of pictures whose names are not given: png, webp, jpg, tif ...")  # fmt: skip
@size_option("1280x720")
@view_options
@moment_options
@style_option
@background_option
@look_options
@effect_options
@cull_option
@add_options(render_files.PictureOptions)
@threads_option
@quiet_option
@debug_option
def render(
    files: tuple[Path, ...],
    output: Path | None,
    force: bool,
    suffix: str,
    size: tuple[int, int],
    threads: int | None,
    quiet: bool,
    **rest: Any,
) -> None:
    """
    Render FILE, a mesh, a point cloud or a drawing, to a picture.

    "rasterjit FILE" is short for "rasterjit render FILE". Without options for the camera, the
    file's own is used, or one that fits the whole scene into the picture. If FILE is a folder,
    each mesh below it becomes a picture in the folder OUT, of 256x256 pixels unless --size says
    otherwise. Meshes that cannot be drawn are named, and the exit status is 1. OUT may be FILE
    itself: the picture of a.obj is a.obj.png, and replaces a file of that name. Pictures that are
    there, drawn with the same options after their mesh was written, stay as they are; --force
    draws them anew.

    Exit status: 0 if all is done, 1 if something failed, 2 for wrong usage, 130 after Ctrl-C.
    """
    shown = gather_render_options(rest)
    if len(files) == 1 and files[0].is_dir():
        from rasterjit.cli.thumbnails import render_folder

        if output is None:
            raise click.UsageError("Missing option '-o' / '--output', a folder for the pictures.")
        refuse_picture(f"the folder {files[0]}", output)
        refuse_unused(["colorbar"], "FILE is a folder, whose pictures have none")
        refuse_unused(["time", "animation"], "FILE is a folder, each file as it poses itself")
        options = {name: rest[name] for name in ("background", "cull")}
        options |= {"size": size, "threads": threads, "quiet": quiet}
        render_folder(files[0], output, suffix, force, shown, **options)
        return
    asked = gather_options(
        render_files.PictureOptions, {**rest, "size": size, "threads": threads, "quiet": quiet}
    )
    if output is not None and str(output) == STANDARD_OUTPUT:
        render_files.write_to_standard_output(files, asked, shown)
        return
    places = render_files.plan_places(files, output, suffix, force)
    if len(places) == 1:
        render_files.render_file(files[0], places[files[0]], asked, shown)
        return
    render_files.render_files(places, asked, shown)


@dataclasses.dataclass(frozen=True)
class Turn:
    """
    Motion and output of a turntable.

    Parameters
    ----------
    output : Path
        Animation to write: .gif; .mp4, .webp or .apng (need rasterjit[video]).
    frames : int, optional
        Number of frames; default: 36, or with --animate the length of the animation.
    fps : int
        Frames a second.
    turns : float
        How often the camera goes around; negative for the other way, 0 to keep it still.
    animate : bool
        Play the file's animation while the camera turns.
    animation : str, optional
        Name or number of one of the file's animations; default: 0, the first. rasterjit info lists
        them. Implies --animate.
    """

    output: Path = option(
        option_types.file_type("animation"), "-o", "--output", required=True, metavar="OUT"
    )
    frames: int | None = option(click.IntRange(1, 3600), metavar="COUNT")
    fps: int = option(click.IntRange(1, 120), default=24)
    turns: float = option(option_types.FiniteNumberType(), default=1.0, metavar="NUMBER")
    animate: bool = flag()
    animation: str | None = option(None, metavar="NAME|NUMBER")


@program.command(short_help="Render an animation that goes once around FILE.")
@file_argument
@add_options(Turn)
@size_option("640x480")
@orbit_options
@background_option
@look_options
@effect_options
@cull_option
@threads_option
@quiet_option
@debug_option
def turntable(
    file: Path,
    size: tuple[int, int],
    background: str | BackgroundImage | None,
    cull: str,
    threads: int | None,
    quiet: bool,
    **rest: Any,
) -> None:
    """
    Render an animation in which the camera goes once around FILE.

    With --animate the file's own animation plays, and the turn takes as long as it does. With
    --frames as well, the turn has that many frames, and the animation starts again when it ends.
    """
    from rasterjit.animation import render_animation
    from rasterjit.animation.video import check_animation
    from rasterjit.rendering.renderer import Renderer

    # What is asked for.
    turn, (view, look, effects, _) = gather_options(Turn, rest), gather_render_options(rest)
    output = turn.output
    is_played = turn.animate or turn.animation is not None
    if turn.turns == 0.0 and not is_played:
        raise click.BadOptionUsage("--turns", "--turns: nothing moves without --animate")
    size = choose_size(background, size)
    check_animation(output, size, turn.fps, is_opaque(background))
    # The scene, and how many frames it takes.
    start = time.perf_counter()
    scene = load_scene(file, look, effects, quiet)
    played = find_animation(scene, file, turn.animation, "--animate") if is_played else None
    frames = turn.frames
    if frames is None:
        frames = TURN_FRAMES if played is None else max(1, round(played.duration * turn.fps))
    # The frames, each encoded as it is drawn.
    with (
        show_compile_progress(quiet),
        Renderer(size, quality=effects.quality(), threads=threads) as renderer,
    ):
        renderer.warned = None
        around = view.turn(scene, size, played)
        turning = render_animation.frames(
            renderer, scene, [number / turn.fps for number in range(frames)],
            camera=lambda second: around(turn.turns * round(second * turn.fps) / frames),
            animation=played, loop=True, background=background, cull=cull,
        )  # fmt: skip
        render_animation.save(
            iterate_with_progress(turning, frames, "Rendering", quiet), output, fps=turn.fps
        )
    if not quiet:
        say(f"wrote {output}: {frames} frames in {time.perf_counter() - start:.1f} s")


@program.command(short_help="Render a folder of meshes from all sides.")
@dataset_options
@quiet_option
@debug_option
def dataset(**options: Any) -> None:
    """
    Render every mesh file below FOLDER from all sides, with cameras as NeRF tools read them.

    Each mesh gets a folder of its name in OUT, with pictures and a transforms.json. After an
    interruption, run the same command again: finished meshes stay, an unfinished one begins again.
    Files that cannot be read are left out and listed in failures.json.
    """
    from rasterjit.cli.dataset import make_dataset

    make_dataset(**options)


@dataclasses.dataclass(frozen=True)
class ShowOptions:
    """
    Where and how a scene is shown.

    Parameters
    ----------
    backend : str
        Where to show it; auto: a window if one opens, else a page for the browser, else the
        terminal.
    host : str
        Network address of the page; by default only this machine reaches it. 0.0.0.0 serves all
        networks, unencrypted, whoever has the page's address.
    port : int
        Port of the page; 0 takes any that is free.
    token : str, optional
        Token in the page's address, 16 to 128 letters, digits, - and _; default: a random one. With
        the same token and port, open pages come back when the viewer is started again. Others on
        this machine can read command lines, but not the variable.
    size : (int, int)
        Size of the window, pixels.
    time_budget : float
        Time for a picture while something moves; the best quality that fits is chosen, and a draft
        until that is known.
    """

    backend: str = option(click.Choice(BACKENDS), default="auto")
    host: str = option(None, default="127.0.0.1")
    port: int = option(click.IntRange(0, 65535), default=8765)
    token: str | None = option(None, envvar="RASTERJIT_TOKEN", show_envvar=True, metavar="TEXT")
    size: tuple[int, int] = option(option_types.size_type, default="960x720", metavar="WxH")
    time_budget: float = option(
        option_types.FiniteType(0.0, min_open=True), default=0.012, metavar="SECONDS"
    )


@program.command(short_help="Show FILE, and move the camera by hand.")
@file_argument
@add_options(ShowOptions)
@view_options
@moment_options
@color_behind_option
@look_options
@unsettled_options
@cull_option
@threads_option
@quiet_option
@debug_option
def view(file: Path, **options: Any) -> None:
    """Show FILE, and move the camera with mouse and keys; H lists the keys."""
    from rasterjit.viewer.show import choose_backend, show

    (seen_from, look, effects, moment), quiet = gather_render_options(options), options["quiet"]
    shown = gather_options(ShowOptions, options)
    if shown.backend != "auto":
        _refuse_options_without_effect(shown.backend)
    backend = choose_backend(shown.backend)
    _refuse_options_without_effect(backend)
    scene = moment.apply(load_scene(file, look, effects, quiet), file)
    size = seen_from.find_size(shown.size)
    camera = seen_from.camera(scene, size)
    options = {name: options[name] for name in ("background", "cull", "threads")}
    options |= vars(shown) | {"size": size, "backend": backend, "up": scene.up, "title": file.name}
    try:
        with show_compile_progress(quiet):
            show(scene, camera, **options)
    except ImportError as error:
        raise click.ClickException(str(error)) from error
    if backend == "browser":
        exit_process()


@program.command(short_help="Say what FILE holds.")
@file_argument
@click.option(
    "--json", "as_json", is_flag=True, help="Print JSON, with all nodes, materials and lights."
)
@reading_options
@debug_option
def info(file: Path, as_json: bool, **reading: Any) -> None:
    """
    Say what FILE holds: counts, bounds, nodes, materials, lights, camera, and what is left out.

    Names of nodes are those that Scene.find takes, attributes those that --outputs takes. Counts
    are of what is loaded: a vertex at a crease counts once for each side.
    """
    from rasterjit.cli.info import print_info

    print_info(file, as_json, **reading)


@program.command(short_help="Say what rendering FILE would do, and why.")
@file_argument
@size_option("1280x720")
@view_options
@moment_options
@style_option
@background_option
@look_options
@effect_options
@cull_option
@click.option("--outputs", type=option_types.outputs_type, default="color", show_default=True,
              metavar="NAMES", help=OUTPUTS_HELP)  # fmt: skip
@click.option("--pixel", type=option_types.pixel_type,
              help="Explain the pixel at this column and row instead, step by step.")  # fmt: skip
@click.option("--measure", is_flag=True,
              help="Render it, too, and say what each stage and each effect costs. All that is "
              "tried is compiled first, which takes half a minute the first time.")  # fmt: skip
@threads_option
@debug_option
def explain(
    file: Path,
    size: tuple[int, int],
    background: str | BackgroundImage | None,
    cull: str,
    outputs: tuple[str, ...],
    pixel: tuple[int, int] | None,
    measure: bool,
    threads: int | None,
    **rest: Any,
) -> None:
    """Say what rendering FILE would do, and why; or explain one pixel."""
    # What is asked for, before anything is read.
    view, look, effects, moment = gather_render_options(rest)
    size = choose_size(background, view.find_size(size))
    if pixel is not None and not (pixel[0] < size[0] and pixel[1] < size[1]):
        raise click.BadOptionUsage(
            "--pixel", f"--pixel: {pixel[0]},{pixel[1]} is not in the picture"
        )
    if pixel is not None:
        refuse_unused(["measure"], "one pixel has no cost of its own")
        refuse_unused(["outputs"], "--pixel tells of the colour")
    if not measure:
        refuse_unused(["threads"], "nothing is drawn without --measure")
    from rasterjit.inspect.pixel import explain_pixel
    from rasterjit.rendering.planning import describe as describe_plan

    # The scene, as it would be drawn.
    effects.quality()
    scene = moment.apply(load_scene(file, look, effects, quiet=False), file)
    styled = apply_style(scene, view.camera(scene, size), look, effects)
    # One pixel alone.
    if pixel is not None:
        with show_compile_progress(quiet=False):
            drawn = styled.options(size, background=background, cull=cull)
            camera = drawn.pop("camera")
            told = explain_pixel(styled.scene, camera, size, *pixel, **drawn)
        say(*str(told).split("\n"))
        return
    # The whole frame.
    options: dict[str, Any] = {"outputs": outputs, "background": background, "cull": cull}
    say(*describe_plan(styled.explain(size=size, **options)).split("\n"))
    if measure:
        from rasterjit.inspect.profile import profile

        with (
            show_spinner(f"Measuring {file.name} (what is new is compiled first)", quiet=False),
            show_compile_progress(quiet=False),
        ):
            drawn = styled.options(size, threads=threads, **options)
            measured = profile(styled.scene, size=size, **drawn)
        print_profile(measured)


@dataclasses.dataclass(frozen=True)
class AccuracyOptions:
    """
    Qualities that a study tries, and its output files.

    Parameters
    ----------
    made : str, optional
        A scene made for some of the settings, in place of FILE: floor, wires, slivers,
        near-and-far, far-from-origin, coplanar, highlights, shadows, glass, wireframe, gradients,
        poster.
    knobs : tuple of str, optional
    budget : float, optional
        How long it may take; default: 75. What there is no time for is left out and named.
    max_error : float, optional
        The error that is wanted, root mean square of linear light: the fastest quality that holds
        it is recommended. Default: what buys most error for its time.
    lens : Lens, optional
        As render takes it.
    calibrate : bool
        Measure this machine once, for time_budget; takes a minute, or three if kernels have to be
        compiled.
    output : Path, optional
        Folder of the report; made if it does not exist.
    size : (int, int), optional
        Size of the picture, pixels; default 640x480.
    """

    made: str | None = option(option_types.made_scene_type, "--scene", metavar="NAME")
    knobs: tuple[str, ...] | None = option(
        option_types.knobs_type, metavar="NAMES",
        help=f"Settings to try, separated by commas; default: all: {', '.join(LEVELS)}.",
    )  # fmt: skip
    budget: float | None = option(option_types.FiniteType(0.0, min_open=True), metavar="SECONDS")
    max_error: float | None = option(option_types.FiniteType(0.0, min_open=True), metavar="ERROR")
    lens: Lens | None = option(option_types.lens_type, metavar="LENS")
    calibrate: bool = flag()
    output: Path | None = option(click.Path(path_type=Path), "-o", "--output", metavar="FOLDER")
    size: tuple[int, int] | None = option(option_types.size_type, metavar="WxH")


@program.command(short_help="Measure what accuracy costs and buys.")
@click.argument("file", type=click.Path(path_type=Path), required=False)
@add_options(AccuracyOptions)
@view_options
@look_options
@unsettled_options
@threads_option
@quiet_option
@debug_option
@click.pass_context
def accuracy(context: click.Context, file: Path | None, **rest: Any) -> None:
    """
    Measure what each accuracy setting costs in time and buys in error.

    Draws FILE with every level of every setting that matters to it, from the standard quality on,
    and compares time and picture with those of the reference. Names the quality to take. If FILE is
    a folder, studies each scene in it, and names one quality for all. Scenes that cannot be studied
    are named, and the exit status is 1.
    """
    from rasterjit.cli.accuracy import calibrate_machine, study_files, study_scene

    asked = gather_options(AccuracyOptions, rest)
    if asked.calibrate:
        if file is not None:
            raise click.UsageError("--calibrate draws scenes of its own and writes no report")
        kept = ("calibrate", "threads", "quiet", "debug")
        refuse_unused(
            [one.name for one in context.command.params if one.name not in kept],
            "--calibrate draws scenes of its own and writes no report",
        )
        calibrate_machine(rest["threads"], rest["quiet"])
        return
    if (file is None) == (asked.made is None):
        raise click.UsageError("give either a FILE or --scene NAME")
    if asked.output is None:
        raise click.UsageError("Missing option '-o' / '--output'.")
    if asked.made is not None:
        refuse_unused(READING_OPTIONS, "--scene reads no file")
    shown = gather_render_options(rest)
    if file is not None and file.is_dir():
        together = study_files(file, shown, rest)
        if any(one.interrupted for one in together.studies.values()):
            context.exit(INTERRUPTED)
        if together.failures:
            count = len(together.failures) + len(together.studies)
            raise click.ClickException(
                f"{len(together.failures)} of {count} mesh files could not be studied"
            )
        return
    found = study_scene(asked.made or file, shown, rest)
    if found.interrupted:
        context.exit(INTERRUPTED)


@program.command(short_help="Compile all kernels now.")
@quiet_option
@debug_option
def warmup(quiet: bool) -> None:
    """Compile all kernels now (about a minute), so that no later run has to."""
    from rasterjit.cli.warmup import compile_all, list_missing
    from rasterjit.runtime import jit, prebuilt_kernels, store

    if jit.DISABLED or jit.CHECKED:
        variable = "NUMBA_DISABLE_JIT" if jit.DISABLED else "NUMBA_BOUNDSCHECK"
        raise click.ClickException(f"nothing to compile: {variable} is set")
    library = prebuilt_kernels.find_library().library
    if library is not None and not list_missing():
        if not quiet:
            say(f"nothing to compile: code for {library.target.cpu} came with the installation")
        return
    folder = store.kernel_folder()
    if folder is None:
        raise click.ClickException(f"no folder can keep kernels: set {store.FOLDER_VARIABLE}")
    started = time.perf_counter()
    with show_progress_bar("Compiling kernels", quiet, is_told=True) as tell:
        compile_all(tell)
    if not quiet:
        count = store.inspect_folder(folder).entries
        say(f"compiled or found all kernels in {time.perf_counter() - started:.1f} s")
        say(f"{count} entries in {folder}")


@program.command(short_help="Check versions, CPU, cache and rendering.")
@debug_option
def doctor() -> None:
    """Show versions, CPU and cache, and check that rendering works."""
    from rasterjit.cli.doctor import examine

    healthy = True
    with show_compile_progress(quiet=False):
        for finding in examine():
            mark = {True: "ok      ", False: "FAILED  ", None: "        "}[finding.passed]
            say(f"{mark}{finding.name:<22}{finding.text}")
            healthy = healthy and finding.passed is not False
    if not healthy:
        raise click.ClickException("the self-check failed; see the lines marked FAILED")


@program.command(short_help="Print a script that completes commands in a shell.")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """
    Print a script that completes commands, options and files in SHELL.

    In ~/.bashrc: eval "$(rasterjit completion bash)". In ~/.zshrc the same with zsh. In fish:
    rasterjit completion fish | source.
    """
    from click.shell_completion import get_completion_class

    script = get_completion_class(shell)
    if script is None:
        raise click.ClickException(f"click completes nothing in {shell}")
    click.echo(script(program, {}, "rasterjit", "_RASTERJIT_COMPLETE").source())


def _refuse_options_without_effect(backend: str) -> None:
    """Refuse options that have no effect with a backend."""
    if backend != "browser":
        refuse_unused(
            ["host", "port", "token"], f"nothing is served: it is shown by the backend {backend}"
        )
    if backend == "terminal":
        refuse_unused(["size"], "a terminal has its own")


def main() -> None:
    """Run the command line, in a process of its own."""
    # Modules stay, so looking for garbage among them is in vain: a sixth of a short run.
    gc.freeze()
    gc.set_threshold(GARBAGE_THRESHOLD)
    program.main(prog_name="rasterjit", obj=OWN_PROCESS)
