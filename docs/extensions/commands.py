"""The directive ``commands``: every command of ``rasterjit``, as ``--help-all`` describes it."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

import click
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from rasterjit.cli import commands
from rasterjit.cli.help import OPTION_GROUPS, OTHER_GROUP, find_group


class Commands(SphinxDirective):
    """``{commands}``."""

    def run(self) -> list[nodes.Node]:
        """Return a section for each command, the most used one first."""
        top = click.Context(commands.program, info_name="rasterjit")
        listed = commands.program.commands
        first = ["render", *sorted(listed.keys() - {"render"})]
        return [self._section(top, listed[name]) for name in first]

    def _section(self, top: click.Context, command: click.Command) -> nodes.section:
        """Return what a command does, and its options by groups."""
        context = click.Context(command, info_name=command.name, parent=top)
        section = nodes.section(ids=[str(command.name)], names=[str(command.name)])
        section += nodes.title("", str(command.name))
        usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
        section += nodes.literal_block(usage, usage, language="text")
        for text in inspect.cleandoc(command.help or "").split("\n\n"):
            section += _paragraph(" ".join(text.split()))
        options = [
            (find_group(one), one.get_help_record(context))
            for one in command.get_params(context)
            if isinstance(one, click.Option)
        ]
        for title in (*OPTION_GROUPS, OTHER_GROUP):
            records = [record for group, record in options if record and group == title]
            if records:
                section += nodes.rubric("", title)
                section += nodes.definition_list("", *_items(records))
        self.state.document.note_implicit_target(section)
        return section


def _items(records: list[tuple[str, str]]) -> Iterator[nodes.definition_list_item]:
    """Yield the options of a group: how each is spelt, and what it does."""
    for spelling, text in records:
        term = nodes.term("", "", nodes.literal("", spelling))
        yield nodes.definition_list_item("", term, nodes.definition("", _paragraph(text)))


def _paragraph(text: str) -> nodes.paragraph:
    """Return a text in which options are code."""
    parts = re.split(r"(?<![\w-])(--[a-z][a-z-]*)", text)
    return nodes.paragraph(
        "", "",
        *(nodes.literal("", part) if n % 2 else nodes.Text(part) for n, part in enumerate(parts)),
    )  # fmt: skip


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
