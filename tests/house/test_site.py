"""The site of docs/ has every public name on one page; it builds, and needs no network."""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import re
import subprocess
import sys
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

import rasterjit as rj

ROOT = Path(__file__).parents[2]
MODULES = (
    *(name for name in rj.__all__ if inspect.ismodule(getattr(rj, name))),
    "mpl", "types", "compat.bop", "compat.pyrender", "compat.trimesh",
    "dataset.bop",
)  # fmt: skip
"""Public modules, below ``rasterjit``."""
NEED_OTHERS = "compat/mujoco", "compat/pybullet"
"""Folders of public modules that cannot be imported where another package is missing."""
OF_THEIR_OWN = {
    "rasterjit.scene.environment.Panorama",
    "rasterjit.scene.environment.SkyGradient",
    "rasterjit.compat.golden.Golden",
    "rasterjit.compat.pyrender.NoOpenGLError",
    "rasterjit.compat.pyrender.install",
}
"""What the reference describes besides: what descriptions of public names name."""


def public_names(module):
    """Yield what is public in a module: what it lists, or else what it defines."""
    listed = getattr(module, "__all__", None)
    for name in vars(module) if listed is None else listed:
        value = getattr(module, name)
        is_own = getattr(value, "__module__", None) == module.__name__
        if name[0] != "_" and not inspect.ismodule(value) and (listed is not None or is_own):
            yield name


def test_every_public_name_is_on_one_page_of_the_reference():
    expected = {f"rasterjit.{name}" for name in public_names(rj)}
    for name in MODULES:
        module = importlib.import_module(f"rasterjit.{name}")
        expected |= {f"rasterjit.{name}.{one}" for one in public_names(module)}
    for folder in NEED_OTHERS:
        text = (ROOT / f"rasterjit/{folder}/__init__.py").read_text("utf-8")
        (listed,) = re.findall(r"^__all__ = (\[.*?\])$", text, re.M | re.S)
        place = folder.replace("/", ".")
        expected |= {f"rasterjit.{place}.{one}" for one in ast.literal_eval(listed)}
    entries = Counter()
    for page in (ROOT / "docs/reference").glob("*.rst"):
        names = re.findall(r"^\.\. auto(?!module)\w+:: ([\w.]+)", page.read_text("utf-8"), re.M)
        entries.update(f"rasterjit.{name.removeprefix('rasterjit.')}" for name in names)
    assert entries == Counter(expected | OF_THEIR_OWN)


class Page(HTMLParser):
    """What a page of the site links to, loads, and can be linked to."""

    def __init__(self, path):
        super().__init__()
        self.links, self.loaded, self.anchors = [], [], {""}
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.anchors.add(given.get("id"))
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") in ("stylesheet", "icon", "preload"):
            self.loaded.append(given["href"])
        elif "src" in given:
            self.loaded.append(given["src"])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the folder of the site, which is built without a warning."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-n", "-q", "-b", "html",
         "docs", str(folder)],
        cwd=ROOT, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
        timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.takes_long
def test_the_site_loads_nothing_from_elsewhere_and_its_links_lead_somewhere(site):
    pages = {path: Page(path) for path in site.rglob("*.html")}
    assert len(pages) > 40
    for path, page in pages.items():
        for target in page.loaded:
            assert not re.match(r"(\w+:)?//", target), (path, target)
            assert (path.parent / unquote(target).partition("?")[0]).is_file(), (path, target)
        for target in page.links:
            if not re.match(r"\w+:", target):
                place, _, anchor = unquote(target).partition("#")
                other = (path.parent / place).resolve() if place else path
                assert other.is_file(), (path, target)
                # Pages of sources name the places of objects in two modules by the first of them.
                if other.suffix == ".html" and "_modules" not in path.parts:
                    assert anchor in pages[other].anchors, (path, target)
    styles = [one.read_text("utf-8") for one in site.rglob("*.css")]
    assert styles
    assert not any(re.search(r"(url\(|@import )[\"']?(\w+:)?//", text) for text in styles)
