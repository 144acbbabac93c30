"""The command ``rasterjit view``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rasterjit.cli_effects import Effects
from rasterjit.cli_files import load_scene
from rasterjit.cli_options import FiniteType, Look, SizeType, View, add_options, gather
from rasterjit.cli_report import compile_notice

BACKENDS = ("auto", "window", "browser", "terminal")


def view_file(file: Path, options: dict[str, Any]) -> None:
    """
    Show a file to who moves the camera, until the window is closed.

    Parameters
    ----------
    file : Path
    options : dict
        Of the command line.
    """
    from rasterjit.viewer_show import show

    view, look, effects = (gather(kind, options) for kind in (View, Look, Effects))
    view.check()
    scene = load_scene(file, look, effects, options["quiet"])
    camera = view.camera(scene, options["size"])
    try:
        with compile_notice(options["quiet"]):
            show(
                scene, camera, backend=options["backend"], size=options["size"],
                background=options["background"], cull=options["cull"],
                up=view.up or (0.0, 1.0, 0.0), time_budget=options["time_budget"], title=file.name,
                host=options["host"], port=options["port"], threads=options["threads"],
            )  # fmt: skip
    except ImportError as error:
        raise click.ClickException(str(error)) from error


def show_options(command: Any) -> Any:
    """Add the options of where and how it is shown."""
    return add_options(
        [
            click.option("--backend", type=click.Choice(BACKENDS), default="auto",
                         show_default=True,
                         help="Where it is shown; auto: a window if there is a display, else a "
                         "page for the browser."),
            click.option("--host", default="127.0.0.1", show_default=True,
                         help="Where the page is served: by default where only this machine "
                         "reaches it."),
            click.option("--port", type=click.IntRange(0, 65535), default=8765, show_default=True,
                         help="Of the page; 0 takes any that is free."),
            click.option("--size", type=SizeType(), default="960x720", show_default=True,
                         metavar="WxH", help="Size of the window, pixels."),
            click.option("--time-budget", type=FiniteType(0.0, min_open=True), default=0.02,
                         show_default=True, metavar="SECONDS",
                         help="For a picture while something moves: the best quality that is "
                         "drawn in it, or the fastest; a draft until that is known."),
        ],
        command,
    )  # fmt: skip
