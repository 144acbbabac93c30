"""
Settings of the site: ``python -m sphinx -W --keep-going -n -b html docs build/site``.

``-b linkcheck`` in place of ``-b html`` tries the links to other sites, too: it needs a network.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

from numpydoc.xref import DEFAULT_LINKS
from sphinx.ext.autodoc.mock import _MockModule

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / "extensions")]

import rasterjit  # noqa: E402

project = "RasterJIT"
author = "The RasterJIT developers"
copyright = author
version = release = rasterjit.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "aliases",
    "commands",
    "names",
    "outside",
]
nitpicky = True
default_role = "py:obj"  # What docstrings put between single backticks.

myst_heading_anchors = 4
"""Headings down to this level are anchors, named as GitHub names them."""

_MockModule.__version__ = "999.0"  # Later than any version that is asked for.
autodoc_mock_imports = [name for name in ("mujoco", "pybullet") if find_spec(name) is None]
autodoc_typehints = "none"  # Docstrings tell the types, with shapes and units.
autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
autodoc_default_options = {
    "members": True,
    "inherited-members": "object,tuple,BaseException,OSError,Artist,int,Enum",  # But of these.
}

numpydoc_show_class_members = False
numpydoc_xref_param_type = True
DEFAULT_LINKS.clear()  # To the sites of Python and NumPy, whose lists of names take a network.
numpydoc_xref_ignore = "all"  # But these.
numpydoc_xref_aliases = {
    name: f"rj.{name}"
    for module in (rasterjit, rasterjit.types)
    for name in module.__all__
    if name[0].isupper()
}
suppress_warnings = ["ref.citation"]  # References that the text does not number.

html_theme = "furo"
html_title = f"RasterJIT {version}"
html_favicon = "_static/favicon.svg"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
