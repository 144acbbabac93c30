"""
Links from names of ``rasterjit`` to the reference.

Docstrings put names between single backticks, `Mesh`; pages write code, ``rj.Mesh(vertices)``.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.domains.python import PythonDomain
from sphinx.environment import BuildEnvironment
from sphinx.transforms.post_transforms import SphinxPostTransform

PLACES = ("rasterjit", "rasterjit.types", "rasterjit.scene.environment")
"""Modules whose names docstrings use without naming the module."""

CODE = re.compile(r"rj\.((?:\w+\.)*\w+)")
"""What code that names something public begins with."""

NO_LINKS = (nodes.reference, nodes.title, pending_xref)
"""Parents of code that stays as it is."""


def find_name(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.TextElement
) -> nodes.Element | None:
    """
    Return a link to what a docstring names, or None if there is no such thing: a warning.

    Sphinx has looked for it in the class and in the module of the docstring.
    """
    if node.get("refdomain") != "py":
        return None
    domain = env.domains.python_domain
    name = node["reftarget"].removeprefix("rj.")  # As conf.py has numpydoc name types.
    names = (f"{place}.{name}" for place in (node.get("py:module"), *PLACES))
    found = next((name for name in names if name in domain.objects), None)
    return found and _link(app, env, domain, node["refdoc"], found, content)


class CodeLinks(SphinxPostTransform):
    """Makes links of code that names something public: ``rj.render(scene)``."""

    default_priority = 5  # Before links are resolved, so that code inside of them is known.

    def run(self, **kwargs: Any) -> None:
        """Wrap each piece of code in a link, where the reference has its name."""
        domain = self.env.domains.python_domain
        for code in list(self.document.findall(nodes.literal)):
            start = CODE.match(code.astext())
            if not start or any(isinstance(above, NO_LINKS) for above in _above(code)):
                continue
            name = f"rasterjit.{start[1]}"
            if name in domain.objects:
                page = self.env.current_document.docname
                link = _link(self.app, self.env, domain, page, name, code.deepcopy())
                code.replace_self(link or code)


def _link(
    app: Sphinx, env: BuildEnvironment, domain: PythonDomain, page: str, name: str,
    content: nodes.TextElement,
) -> nodes.Element | None:  # fmt: skip
    """Return a link from a page to a name."""
    role = pending_xref("", refdomain="py", reftype="obj", reftarget=name, refdoc=page)
    return domain.resolve_xref(env, page, app.builder, "obj", name, role, content)


def _above(node: nodes.Node) -> list[nodes.Node]:
    """Return the parents of a node, the nearest first."""
    parents = []
    while node.parent is not None:
        node = node.parent
        parents.append(node)
    return parents


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("missing-reference", find_name)
    app.add_post_transform(CodeLinks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
