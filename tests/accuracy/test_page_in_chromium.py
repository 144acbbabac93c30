"""The page as a browser shows it: every plot and picture is really visible, at any width."""

import base64
import functools
import io
import sys

import numpy as np
import pytest
from made_up_study import SENTENCES, made_up_study
from opengl import optional_module, skip_or_fail
from PIL import Image

from rasterjit.accuracy.report import plots
from rasterjit.accuracy.report.page import write_page

pytestmark = pytest.mark.takes_long

DESKTOP, PHONE = 1280, 375
WIDTHS = pytest.mark.parametrize(("width", "zoom"), [(DESKTOP, 5), (PHONE, 3)])
SCHEMES = pytest.mark.parametrize(
    ("scheme", "colors"), [("light", plots.LIGHT), ("dark", plots.DARK)]
)

FIND = """
[...document.querySelectorAll("img, svg[role=img], table, h2")].map(e => {
  const box = e.getBoundingClientRect();
  return {tag: e.tagName.toLowerCase(), kind: e.getAttribute("class"), src: e.src || "",
          loaded: e.tagName != "IMG" || (e.complete && e.naturalWidth > 0),
          left: box.left + scrollX, top: box.top + scrollY, width: box.width, height: box.height,
          folded: !!e.closest("details:not([open])")};
})
"""


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    """A tab of headless Chromium."""
    if sys.platform == "win32":
        pytest.skip("Chromium is driven over pipes as Unix has them")
    import chromium

    path = chromium.program()
    if path is None:
        skip_or_fail("Chromium is not installed (apt-get install chromium)")
    with chromium.chromium(path, tmp_path_factory.mktemp("profile")) as page:
        yield page


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The page of the study that was made up."""
    optional_module("matplotlib")
    return write_page(made_up_study(), tmp_path_factory.mktemp("report"), SENTENCES)


def shown(picture, element):
    """The pixels of an element on a screenshot."""
    left, top = round(element["left"]), round(element["top"])
    return picture[top : top + round(element["height"]), left : left + round(element["width"])]


def share(pixels, color):
    """How many of the pixels nearly have a colour, ``"#rrggbb"``: thin lines are smoothed."""
    wanted = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)])
    return float((abs(pixels.astype(int) - wanted) <= 24).all(axis=-1).mean())


def decoded(address):
    data = base64.b64decode(address.partition("base64,")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


@pytest.fixture(scope="module")
def seen(tab, report, tmp_path_factory):
    """Return a function from width and colour scheme to a screenshot and what is on it."""

    @functools.cache
    def look(width, scheme):
        tab.open(report.as_uri(), width, scheme=scheme)
        elements = [e for e in tab.evaluate(FIND) if not e["folded"]]
        sizes = tab.evaluate(
            "[innerWidth, document.documentElement.scrollWidth, document.fonts.size]"
        )
        place = tmp_path_factory.mktemp("seen") / f"{width}-{scheme}.png"
        picture = tab.screenshot(place)
        print(place)
        return picture, elements, sizes, list(tab.requested)

    return look


@WIDTHS
@SCHEMES
def test_every_plot_is_visible(seen, width, zoom, scheme, colors):
    picture, elements, _, _ = seen(width, scheme)
    found = [e for e in elements if e["kind"] == "plot"]
    assert len(found) == 5, "four settings and the front"
    for element in found:
        pixels = shown(picture, element)
        assert pixels.shape[1] >= min(0.85 * width, 500)
        assert 0.5 < pixels.shape[0] / pixels.shape[1] < 1.0
        assert share(pixels, colors["page"]) > 0.6
        for name, least in (("standard", 2e-4), ("ink", 1e-4)):
            assert share(pixels, colors[name]) > least, name
    for name in ("level", "muted"):
        assert any(share(shown(picture, e), colors[name]) > 5e-4 for e in found), name


@WIDTHS
def test_every_crop_is_visible_and_enlarged_by_whole_pixels(seen, width, zoom):
    picture, elements, _, _ = seen(width, "light")
    found = [e for e in elements if e["kind"] == "pixels"]
    assert len(found) == 4 + 2 * (12 + 4), "of each setting the reference, and twice each level"
    for element in found:
        wanted = decoded(element["src"]).repeat(zoom, axis=0).repeat(zoom, axis=1)
        pixels = shown(picture, element)
        assert pixels.shape == wanted.shape
        # All but the borders, which may lie between two pixels of the screen.
        assert (pixels == wanted)[1:-1, 1:-1].mean() > 0.85
        assert pixels.std() > 0 or wanted.std() == 0


@WIDTHS
def test_pictures_and_where_crops_lie_are_visible(seen, width, zoom):
    picture, elements, _, _ = seen(width, "light")
    whole = [e for e in elements if e["tag"] == "img" and e["kind"] is None]
    where = [e for e in elements if e["kind"] == "where"]
    assert (len(whole), len(where)) == (2, 4)
    for element in whole:
        assert element["width"] == 160, "no larger than it is"
        assert share(shown(picture, element), "#e17828") > 0.05, "the disc"
    for element in where:
        pixels = shown(picture, element)
        assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50
        assert share(pixels, plots.LIGHT["standard"]) > 0.002, "the frame of the crop"
    for element in (e for e in elements if e["kind"] == "scale"):
        assert len(np.unique(shown(picture, element).reshape(-1, 3), axis=0)) > 50


@WIDTHS
@SCHEMES
def test_the_page_fits_its_window_and_loads_nothing(seen, width, zoom, scheme, colors, report):
    picture, elements, (window, content, _), requested = seen(width, scheme)
    assert window == content == picture.shape[1] == width
    assert all(e["loaded"] for e in elements)
    assert all(e["width"] > 0 and e["height"] > 0 for e in elements)
    assert all(url == report.as_uri() or url.startswith("data:") for url in requested)
    assert requested[0] == report.as_uri()
    for element in elements:
        if element["tag"] != "table":
            assert element["left"] >= 0
            assert element["left"] + element["width"] <= width
            assert element["top"] + element["height"] <= len(picture)
    assert share(picture, colors["page"]) > 0.3


@WIDTHS
def test_nothing_lies_on_something_else(seen, width, zoom):
    _, elements, _, _ = seen(width, "light")
    boxes = [(e["left"], e["top"], e["left"] + e["width"], e["top"] + e["height"])
             for e in elements if e["tag"] != "table"]  # fmt: skip
    for n, (left, top, right, bottom) in enumerate(boxes):
        for other in boxes[:n]:
            apart = left >= other[2] - 0.5 or other[0] >= right - 0.5
            assert apart or top >= other[3] - 0.5 or other[1] >= bottom - 0.5
