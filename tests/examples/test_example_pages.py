"""Every example has a page, every page is linked, and what pages name is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
MAX = 150_000
"""Bytes of a picture."""
PAGES = sorted(EXAMPLES.glob("*.md"))
WITHOUT_PAGE = {"make_pictures"}


def test_every_program_has_a_page_that_the_index_links():
    index = (EXAMPLES / "index.md").read_text(encoding="utf-8")
    linked = set(re.findall(r"\]\((\w+)\.md\)", index))
    assert linked == {page.stem for page in PAGES} - {"index"}
    on_pages = " ".join(page.read_text(encoding="utf-8") for page in PAGES)
    for program in [*EXAMPLES.glob("*.py"), *EXAMPLES.glob("*.ipynb")]:
        if program.stem not in WITHOUT_PAGE:
            assert f"]({program.name})" in on_pages


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere_and_pictures_are_small(page):
    text = page.read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)]+)\)", text)
    assert links
    for link in links:
        if not link.startswith("https://"):
            target = page.parent / link
            assert target.is_file(), link
            if target.suffix in (".png", ".jpg", ".gif"):
                assert target.stat().st_size <= MAX, link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_name_options_that_programs_have(page):
    commands = re.findall(r"^python docs/examples/(\w+\.py)(.*)$", page.read_text(), re.MULTILINE)
    assert commands or page.stem in ("index", "classroom")
    for name, options in commands:
        source = (EXAMPLES / name).read_text(encoding="utf-8")
        for option in re.findall(r"\s(--?[a-z]+)", options):
            assert f'"{option}"' in source, (name, option)


def test_every_picture_is_on_a_page():
    text = " ".join(page.read_text(encoding="utf-8") for page in PAGES)
    for picture in (EXAMPLES.parent / "pictures" / "examples").iterdir():
        assert f"pictures/examples/{picture.name})" in text
