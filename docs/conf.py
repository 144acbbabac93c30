"""
Settings of the site: ``python -m sphinx -W --keep-going -n -b html docs build/site``.

Links to pages outside are tried by ``-b linkcheck`` in place of ``-b html``, which needs a network.
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import rasterjit  # noqa: E402

project = "RasterJIT"
author = "The RasterJIT developers"
copyright = author  # noqa: A001
version = release = rasterjit.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
exclude_patterns = ["_build"]
nitpicky = True
templates_path: list[str] = []

myst_heading_anchors = 4
"""Headings down to this level are anchors, named as GitHub names them."""
myst_enable_extensions = ["dollarmath", "deflist"]

autodoc_typehints = "none"
autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}

numpydoc_show_class_members = False

html_theme = "furo"
html_title = f"RasterJIT {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
