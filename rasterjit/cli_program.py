"""The program that the commands belong to: how it ends, and how it says what went wrong."""

from __future__ import annotations

import sys
from typing import Any

import click

INTERRUPTED = 130
"""Exit status after Ctrl-C; the others are click's: 1 failed, 2 wrong usage."""

DEBUG = "rasterjit.debug"
"""Key of the flag in click's context."""


class Program(click.Group):
    """A group of commands whose errors are one line."""

    def main(self, *arguments: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run; print an error as one line and end with its status."""
        if not standalone_mode:
            return super().main(*arguments, standalone_mode=False, **extra)
        try:
            code = super().main(*arguments, standalone_mode=False, **extra)
        except click.ClickException as error:
            _say_error(error.format_message())
            code = error.exit_code
        except click.Abort:
            _say_error("interrupted")
            code = INTERRUPTED
        sys.exit(code or 0)

    def invoke(self, context: click.Context) -> Any:
        """Run the command; what it raises becomes a `click.ClickException`, save for --debug."""
        try:
            return super().invoke(context)
        except (click.ClickException, click.exceptions.Exit, click.Abort, BrokenPipeError):
            raise
        except Exception as error:
            if context.meta.get(DEBUG):
                raise
            raise click.ClickException(describe(error)) from error


def describe(error: Exception) -> str:
    """Return what went wrong, without a traceback."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    if isinstance(error, (ValueError, OSError)) and str(error):
        return str(error)
    if isinstance(error, ImportError) and "pip install" in str(error):
        return str(error)
    if isinstance(error, MemoryError):
        return f"not enough memory: {error}" if str(error) else "not enough memory"
    return f"{type(error).__name__}: {error} (--debug shows where)"


def _say_error(message: str) -> None:
    click.echo("error: " + " ".join(message.split()), err=True)


def _set_debug(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Note the flag, wherever it stands on the line."""
    if value:
        context.meta[DEBUG] = True


debug_option = click.option(
    "--debug", is_flag=True, expose_value=False, callback=_set_debug,
    help="Show the traceback of an error.",
)  # fmt: skip
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
