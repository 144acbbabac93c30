"""
Print the help of commands: options in groups, the common ones alone with ``--help``.

``--help-all`` prints all. A command with few options prints all in any case.
"""

from __future__ import annotations

import inspect
from typing import Any

import click

GROUPS = {
    "Camera": (
        "views", "layout", "seed", "azimuth", "elevation", "zoom", "fov", "fov_y", "projection",
        "up", "position", "target", "pose", "convention", "intrinsics", "lens", "time",
        "animation", "animate", "turns",
    ),
    "Look": (
        "style", "background", "color", "light", "shading", "wireframe", "wireframe_color", "cull",
        "scalars", "colormap", "scalar_range", "contours", "colorbar", "variant",
    ),
    "Effects": (
        "shadows", "environment", "ambient_occlusion", "eye_dome", "outline", "tone_map",
        "exposure", "vignette", "section", "section_lines",
    ),
    "Outputs": (
        "output", "force", "size", "outputs", "depth_file", "scale", "mask_file", "mask_of",
        "frames", "fps", "as_json", "pixel", "diagnose", "measure",
    ),
    "Accuracy": (
        "preset", "samples", "changes", "time_budget", "knobs", "budget", "max_error",
    ),
    "Files": ("on_invalid", "on_damage", "resource_root", "max_bytes", "isolate"),
}  # fmt: skip
"""Options by their names in Python; others are miscellaneous."""

OTHERS = "Misc"

COMMON = (
    "output", "force", "size", "outputs", "depth_file", "mask_file", "frames", "fps",
    "views", "layout", "azimuth", "elevation", "zoom", "up", "style", "background", "color",
    "light", "wireframe", "shadows", "environment", "ambient_occlusion", "outline", "tone_map",
    "section", "samples", "preset", "backend", "pixel", "measure", "knobs", "budget", "max_error",
    "workers", "stats", "quiet",
)  # fmt: skip
"""What ``--help`` shows of a command with many options."""

MANY = 16
"""Options; more do not fit on a screen."""


class Command(click.Command):
    """A command whose help has groups."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.params.append(
            click.Option(
                ["--help-all"], is_flag=True, is_eager=True, expose_value=False,
                hidden=len(self.params) <= MANY, callback=_show_all,
                help="Show all options and exit.",
            )
        )  # fmt: skip

    def format_help_text(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what the command does; in short its first paragraph."""
        text = inspect.cleandoc(self.help or "")
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(text.split("\n\n")[0] if is_short(context) else text)

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, group by group."""
        listed = [one for one in self.get_params(context) if isinstance(one, click.Option)]
        records = [(one, one.get_help_record(context)) for one in listed]
        options = [(one, record) for one, record in records if record is not None]
        if is_short(context):
            shown = [(one, in_short(record)) for one, record in options if is_common(one)]
        else:
            shown = options
        for title in (*GROUPS, OTHERS):
            rows = [record for one, record in shown if group_of(one) == title]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)
        if len(shown) < len(options):
            formatter.write_paragraph()
            formatter.write_text(
                f"{context.command_path} --help-all says more, and shows "
                f"{len(options) - len(shown)} more options."
            )


def is_short(context: click.Context) -> bool:
    """Tell whether the help of a command shows the common options alone."""
    options = (one for one in context.command.params if isinstance(one, click.Option))
    has_more = any(one.name == "help_all" and not one.hidden for one in options)
    return has_more and not context.meta.get(ALL, False)


def is_common(option: click.Parameter) -> bool:
    """Tell whether the short help of a command shows an option."""
    return option.name in COMMON or "--help" in option.opts


def in_short(record: tuple[str, str]) -> tuple[str, str]:
    """Return the names of an option, and of its help the first clause."""
    names, text = record
    text, mark, default = text.partition("  [")
    depth = 0
    for place, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and (letter in ";:" or text[place : place + 2] == ". "):
            text = text[:place]
            break
    return names, f"{text.rstrip('.')}.{mark}{default}"


def group_of(option: click.Parameter) -> str:
    """Return the title of the group that an option belongs to."""
    return next((title for title, names in GROUPS.items() if option.name in names), OTHERS)


ALL = "rasterjit.help_all"
"""Key in click's context: whether the help shows all options."""


def _show_all(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Print the help with all options, and end."""
    if value and not context.resilient_parsing:
        context.meta[ALL] = True
        click.echo(context.get_help(), color=context.color)
        context.exit()
