"""
The directive ``autoalias``: a type of ``rasterjit.types``, as its source has it.

autodoc would show all that it stands for, private types of NumPy included.
"""

from __future__ import annotations

import ast
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class Autoalias(SphinxDirective):
    """``.. autoalias:: rasterjit.types.NAME``."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return an entry: the name, what it stands for, and the string that follows it."""
        module, name = self.arguments[0].rsplit(".", 1)
        value, text = _described(*_origin(module, name))
        lines = [f"``{value}``", "", *text.splitlines()]
        head = [f".. py:type:: {name}", f"   :module: {module}", ""]
        entry = [*head, *(f"   {line}" for line in lines)]
        return self.parse_text_to_nodes("\n".join(entry))


@cache
def _source_of(module: str) -> ast.Module:
    """Return the syntax tree of a module."""
    place = find_spec(module)
    assert place
    assert place.origin
    return ast.parse(Path(place.origin).read_text("utf-8"))


def _origin(module: str, name: str) -> tuple[str, str]:
    """Return the module that a name was imported from, and what it is called there."""
    for statement in _source_of(module).body:
        if isinstance(statement, ast.ImportFrom):
            for one in statement.names:
                if name == (one.asname or one.name):
                    return str(statement.module), one.name
    raise ValueError(f"autoalias must name what {module} imports, got {name!r}")


def _described(module: str, name: str) -> tuple[str, str]:
    """Return the source of an alias, and the string that describes it, '' without one."""
    statements = _source_of(module).body
    values = {target: value for one in statements for target, value in _assigned(one)}
    at = next(n for n, one in enumerate(statements) if name in dict(_assigned(one)))
    following = statements[at + 1 :]
    if following and "get_args" in ast.unparse(following[0]):  # The tuple of a type's values.
        following = following[1:]
    text = ""
    if following and isinstance(following[0], ast.Expr):
        text = str(ast.literal_eval(following[0].value)).strip()
    return ast.unparse(_Written(values).visit(values[name])), text


def _assigned(statement: ast.stmt) -> list[tuple[str, ast.expr]]:
    """Return the name and the value that a statement assigns, if it does."""
    if isinstance(statement, ast.AnnAssign) and statement.value:
        return [(ast.unparse(statement.target), statement.value)]
    if isinstance(statement, ast.Assign):
        return [(ast.unparse(statement.targets[0]), statement.value)]
    return []


class _Written(ast.NodeTransformer):
    """Replaces the module's own aliases by what they stand for."""

    def __init__(self, values: dict[str, ast.expr]) -> None:
        self.values = values

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Return what a name stands for."""
        value = self.values.get(node.id)
        return self.visit(value) if isinstance(value, ast.BinOp) else node


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_directive("autoalias", Autoalias)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
