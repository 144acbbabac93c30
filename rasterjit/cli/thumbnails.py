"""Pictures of all meshes of a folder: ``rasterjit render FOLDER``."""

from __future__ import annotations

import hashlib
import pickle
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rasterjit.cli.options import RenderOptions, apply_style, is_given, refuse_unused
from rasterjit.cli.program import choose_size, get_reason, is_opaque, load_scene
from rasterjit.cli.report import say, show_compile_progress, show_progress_bar, warn
from rasterjit.interrupts import raise_if_interrupted

if TYPE_CHECKING:
    from rasterjit.rendering.renderer import Renderer

DEFAULT_SIZE = (256, 256)
"""Default width and height, pixels."""

SETTINGS_FILE = ".rasterjit-render"
"""File in the output folder with a hash of the pictures' settings."""

SINGLE_FILE_OPTIONS = (
    "camera_file", "lens", "outputs", "depth_file", "scale", "mask_file", "mask_of", "diagnose",
)  # fmt: skip
"""Options that need a single file."""


def render_folder(
    folder: Path, output: Path, suffix: str, force: bool, shown: RenderOptions, *,
    size: tuple[int, int], threads: int | None, quiet: bool, **options: Any,
) -> None:  # fmt: skip
    """
    Draw every mesh file below a folder; name those that fail, and fail at the end.

    Parameters
    ----------
    folder, output : Path
        The picture of ``folder/a/b.obj`` is ``output/a/b.obj.png``.
    suffix : str
        What is added to the name of a mesh file, ``".png"``: the format.
    force : bool
        Whether pictures are drawn anew that are there, drawn with the same settings and version
        after their mesh was written.
    shown : RenderOptions
    size, threads, quiet
        Of the command.
    **options
        ``background`` and ``cull``, as `rasterjit.render` takes them.

    Raises
    ------
    click.ClickException
        If there is no mesh file, or some could not be drawn.
    """
    from rasterjit import __version__
    from rasterjit.io.images import OPAQUE_FORMATS
    from rasterjit.io.meshes import mesh_files
    from rasterjit.rendering.renderer import Renderer

    # What is asked for, before anything is made.
    refuse_unused(SINGLE_FILE_OPTIONS, f"{folder} is a folder, of whose meshes pictures are drawn")
    size = choose_size(options["background"], size if is_given("size") else DEFAULT_SIZE)
    root = folder.resolve()
    names = [file.relative_to(root) for file in mesh_files(root)]
    if not names:
        raise click.ClickException(f"{folder} holds no mesh files")
    if suffix in OPAQUE_FORMATS and not is_opaque(options["background"]):
        raise click.BadOptionUsage(
            "--background", f"--background: {suffix} cannot be transparent; choose --format png"
        )
    # Which pictures are there already, drawn with these settings.
    _make_folder(output)
    settings = pickle.dumps((__version__, size, suffix, shown, options))
    since = _find_settings_time(output / SETTINGS_FILE, hashlib.sha256(settings).hexdigest(), force)
    # One renderer draws all that are not.
    start, failed, present = time.perf_counter(), 0, 0
    with (
        show_progress_bar("Rendering", quiet) as show,
        show_compile_progress(quiet),
        Renderer(size, quality=shown.effects.quality(), threads=threads) as renderer,
    ):
        show(0, len(names))
        for done, name in enumerate(names, 1):
            file, place = folder / name, output / name.with_name(name.name + suffix)
            if _is_done(file, place, since):
                present += 1
                show(done, len(names))
                continue
            try:
                for notice in _draw_file(file, place, renderer, shown, quiet, **options):
                    warn(f"{name}: {notice}", quiet)
            except (click.Abort, BrokenPipeError):
                raise
            except Exception as error:
                raise_if_interrupted()
                failed += 1
                warn(f"left out {name}: {get_reason(error)}", quiet)
            show(done, len(names))
    if not quiet:
        seconds = time.perf_counter() - start
        told = f"; {present} were there, which --force draws anew" if present else ""
        count = len(names) - failed - present
        say(f"wrote {output}: {count} pictures in {seconds:.1f} s{told}")
    if failed:
        raise click.ClickException(f"{failed} of {len(names)} mesh files could not be drawn")


def _find_settings_time(place: Path, settings: str, force: bool) -> int:
    """Return when pictures were first drawn with these settings, ns; with ``force``, now."""
    from rasterjit.io.atomic_write import atomic_file

    try:
        known = place.read_text()
    except (OSError, UnicodeDecodeError):
        known = ""
    if force or known != settings:
        with atomic_file(place) as temporary:
            temporary.write_text(settings)
    return place.stat().st_mtime_ns


def _is_done(file: Path, place: Path, since: int) -> bool:
    """Tell whether a picture is newer than its mesh file and the settings."""
    try:
        return place.stat().st_mtime_ns > max(file.stat().st_mtime_ns, since)
    except OSError:
        return False


def _make_folder(output: Path) -> None:
    """Make the output folder if it is missing, or raise click's usage error."""
    try:
        output.mkdir(exist_ok=True)
    except OSError as error:
        raise click.BadOptionUsage(
            "--output", f"--output: {output} must be a folder for the pictures: {error.strerror}"
        ) from None


def _draw_file(
    file: Path, place: Path, renderer: Renderer, shown: RenderOptions, quiet: bool, **options: Any
) -> list[str]:
    """Draw a file; return its warnings."""
    from rasterjit.io import images
    from rasterjit.rendering.view_warnings import ViewWarning, warnings_of_frame
    from rasterjit.scene.warning import silence_warnings

    view, look, effects, _ = shown
    scene = load_scene(file, look.of_folder(), effects, quiet)
    # Said of each file, as lines.
    with silence_warnings(ViewWarning):
        made = apply_style(scene, view.camera(scene, renderer.size), look, effects)
        drawn = made.options(renderer.size, **options)
        renderer.quality = drawn.pop("quality")
        frame = renderer.render(made.scene, **drawn)
    place.parent.mkdir(parents=True, exist_ok=True)
    images.save_image(place, frame.color)
    return list(warnings_of_frame(frame).values())
