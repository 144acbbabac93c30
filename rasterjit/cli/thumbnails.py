"""Pictures of all meshes of a folder: what ``rasterjit render`` does with a folder."""

from __future__ import annotations

import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rasterjit.cli import raise_if_interrupted
from rasterjit.cli.options import Effects, Look, View, in_style, is_given, refuse_idle
from rasterjit.cli.program import load_scene, reason, size_behind, warn
from rasterjit.cli.report import progress_bar, progress_notice

if TYPE_CHECKING:
    from rasterjit.rendering.renderer import Renderer

SIZE = (256, 256)
"""Of a picture, pixels, if no size is given."""

SUFFIX = ".png"
"""What is added to the name of a mesh file."""

ALONE = (
    "lens", "outputs", "depth_file", "scale", "codes_per_unit", "mask_file", "mask_of", "diagnose",
)  # fmt: skip
"""Options of one file's picture alone."""


def render_folder(
    folder: Path, output: Path, size: tuple[int, int], threads: int | None, quiet: bool,
    view: View, look: Look, effects: Effects, **options: Any,
) -> None:  # fmt: skip
    """
    Draw every mesh file below a folder; those that fail are named, and at the end the command.

    Parameters
    ----------
    folder, output : Path
        The picture of ``folder/a/b.obj`` is ``output/a/b.obj.png``.
    size, threads, quiet
        Of the command.
    view, look, effects : View, Look, Effects
    **options
        ``style``, the name of one; ``background`` and ``cull``, as `rasterjit.render` takes them.

    Raises
    ------
    click.ClickException
        If there is no mesh file, or some could not be drawn.
    """
    from rasterjit.io.folders import mesh_files
    from rasterjit.rendering.renderer import Renderer

    refuse_idle(ALONE, f"{folder} is a folder, of whose meshes pictures are drawn")
    size = size_behind(options["background"], size if is_given("size") else SIZE)
    root = folder.resolve()
    names = [file.relative_to(root) for file in mesh_files(root)]
    if not names:
        raise click.ClickException(f"{folder} holds no mesh files")
    _make_folder(output)
    start, failed = time.perf_counter(), 0
    with (
        progress_bar("Rendering", quiet) as show,
        progress_notice(quiet),
        Renderer(size, quality=effects.quality(), threads=threads) as renderer,
    ):
        show(0, len(names))
        for done, name in enumerate(names, 1):
            place = output / name.with_name(name.name + SUFFIX)
            try:
                file = folder / name
                for notice in _draw(file, place, renderer, view, look, effects, quiet, **options):
                    warn(f"{name}: {notice}", quiet)
            except (click.Abort, BrokenPipeError):
                raise
            except Exception as error:
                raise_if_interrupted()
                failed += 1
                warn(f"left out {name}: {reason(error)}", quiet)
            show(done, len(names))
    if not quiet:
        seconds = time.perf_counter() - start
        click.echo(f"wrote {output}: {len(names) - failed} pictures in {seconds:.1f} s")
    if failed:
        raise click.ClickException(f"{failed} of {len(names)} mesh files could not be drawn")


def _make_folder(output: Path) -> None:
    """Make the folder of the pictures if there is none, or raise click's usage error."""
    try:
        output.mkdir(exist_ok=True)
    except OSError as error:
        raise click.BadOptionUsage(
            "--output", f"--output: {output} must be a folder for the pictures: {error.strerror}"
        ) from None


def _draw(
    file: Path, place: Path, renderer: Renderer, view: View, look: Look, effects: Effects,
    quiet: bool, style: str, **options: Any,
) -> list[str]:  # fmt: skip
    """Draw a file; return what there is to warn of."""
    from rasterjit.io import images
    from rasterjit.rendering.notices import ViewWarning, notices_of

    scene = load_scene(file, look, effects, quiet)
    with warnings.catch_warnings():
        # Said of each file, as lines.
        warnings.simplefilter("ignore", ViewWarning)
        made = in_style(style, scene, view.camera(scene, renderer.size), look, effects)
        drawn = made.options(renderer.size, **options)
        renderer.quality = drawn.pop("quality")
        frame = renderer.render(made.scene, **drawn)
    place.parent.mkdir(parents=True, exist_ok=True)
    images.save_image(place, frame.color)
    return list(notices_of(frame.plan, frame.stats).values())
