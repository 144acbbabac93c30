"""
Pages of files that lie outside of ``docs``, and links to them.

GitHub shows those files where they are. On the site each is a page, whose own text says on GitHub
where the file is.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from sphinx.application import Sphinx

FILES = {
    "project/benchmarks": "benchmarks/README.md",
    "project/changelog": "CHANGELOG.md",
    "project/contributing": ".github/CONTRIBUTING.md",
    "project/models": "models/README.md",
    "project/security": ".github/SECURITY.md",
    "project/sources": "rasterjit/README.md",
}
"""Pages of the site, and what each shows."""

FRONT = "index"
"""The page that the top README stands for."""

LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
CODE = re.compile(r"(^ *```.*?^ *```)", re.DOTALL | re.MULTILINE)


def read(app: Sphinx, page: str, source: list[str]) -> None:
    """Take the text of a page from the file that it stands for, and turn links to such files."""
    docs = Path(app.srcdir)
    root = docs.parent
    origin = docs / f"{page}.md"
    if page in FILES:
        origin = root / FILES[page]
        app.env.note_dependency(str(origin))
        source[0] = origin.read_text("utf-8")
    if not origin.exists():  # Not of Markdown.
        return
    pages = {root / name: docs / f"{one}.md" for one, name in FILES.items()}
    pages[root / "README.md"] = docs / f"{FRONT}.md"

    def turned(link: re.Match[str]) -> str:
        mark, text, target = link.groups()
        path, _, anchor = target.partition("#")
        if re.match(r"\w+:", target) or not path:
            return link[0]
        place = Path(os.path.normpath(origin.parent / path))
        if place.is_dir():
            return text
        if place == root / "README.md":
            anchor = ""
        new = os.path.relpath(pages.get(place, place), (docs / page).parent)
        return f"{mark}[{text}]({new}{'#' if anchor else ''}{anchor})"

    parts = CODE.split(source[0])
    source[0] = "".join(part if n % 2 else LINK.sub(turned, part) for n, part in enumerate(parts))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
