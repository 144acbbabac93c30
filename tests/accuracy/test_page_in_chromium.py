"""The page as a browser shows it: at any width, with a mouse, a finger or keys, and printed."""

import base64
import functools
import io
import re
import sys

import numpy as np
import pytest
from made_up_study import SENTENCES, made_up_study
from opengl import optional_module, skip_or_fail
from PIL import Image

from rasterjit.accuracy.report import plots
from rasterjit.accuracy.report.page import write_page

pytestmark = pytest.mark.takes_long

DESKTOP, PHONE = 1280, 390
WIDTHS = pytest.mark.parametrize(("width", "zoom"), [(DESKTOP, 3), (PHONE, 2)])

SCREEN = 844
"""Rows of a phone."""

MAX_SCREENS = 6

A4 = 8.27, 11.69
"""Width and height of paper, inches."""
SCHEMES = pytest.mark.parametrize(
    ("scheme", "colors"), [("light", plots.LIGHT_COLORS), ("dark", plots.DARK_COLORS)]
)

FIND = """
[...document.querySelectorAll("img, svg[role=img], table, h2, .answer")].map(e => {
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
def test_the_plot_is_visible(seen, width, zoom, scheme, colors):
    picture, elements, _, _ = seen(width, scheme)
    (element,) = [e for e in elements if e["kind"] == "plot"]
    pixels = shown(picture, element)
    assert pixels.shape[1] >= min(0.85 * width, 500)
    assert 0.5 < pixels.shape[0] / pixels.shape[1] < 1.0
    assert share(pixels, colors["page"]) > 0.6
    for name, least in (("standard", 1e-4), ("ink", 1e-4), ("level", 5e-4), ("muted", 5e-4)):
        assert share(pixels, colors[name]) > least, name


@WIDTHS
def test_one_half_is_the_quality_and_the_other_the_reference(seen, width, zoom):
    picture, elements, _, _ = seen(width, "light")
    reference, chosen, error = (e for e in elements if e["kind"] == "pixels")
    assert 150 <= error["width"] <= 160
    wanted = [
        decoded(e["src"]).repeat(zoom, axis=0).repeat(zoom, axis=1) for e in (chosen, reference)
    ]
    pixels = shown(picture, reference)
    assert pixels.shape == wanted[0].shape == wanted[1].shape, "enlarged by whole pixels"
    half, grip = pixels.shape[1] // 2, 20
    assert (wanted[0] != wanted[1]).any()
    for columns, half_wanted in (
        (slice(1, half - grip), wanted[0]),
        (slice(half + grip, -1), wanted[1]),
    ):
        assert (pixels[:, columns] == half_wanted[:, columns])[1:-1].mean() > 0.99
    assert share(pixels[:, half - grip : half + grip], "#ffffff") > 0.05, "the divider"


@WIDTHS
def test_where_the_part_lies_is_visible(seen, width, zoom):
    picture, elements, _, _ = seen(width, "light")
    (element,) = [e for e in elements if e["kind"] == "where"]
    pixels = shown(picture, element)
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50
    assert share(pixels, plots.LIGHT_COLORS["standard"]) > 0.002, "its frame"


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


def test_the_program_makes_nothing_global(tab, report):
    tab.open(report.as_uri(), DESKTOP)
    assert tab.evaluate("document.getElementById('viewer').hidden") is False
    names = ("element", "word", "show", "divide", "opened")
    kinds = tab.evaluate(f"[{', '.join(f'typeof {name}' for name in names)}]")
    assert kinds == ["undefined"] * len(names)


@WIDTHS
def test_nothing_lies_on_something_else(seen, width, zoom):
    _, elements, _, _ = seen(width, "light")
    reference, chosen, *_ = (e for e in elements if e["kind"] == "pixels")
    assert all(chosen[side] == reference[side] for side in ("left", "top", "width", "height"))
    boxes = [(e["left"], e["top"], e["left"] + e["width"], e["top"] + e["height"])
             for e in elements if e["tag"] != "table" and e is not chosen]  # fmt: skip
    for n, (left, top, right, bottom) in enumerate(boxes):
        for other in boxes[:n]:
            apart = left >= other[2] - 0.5 or other[0] >= right - 0.5
            assert apart or top >= other[3] - 0.5 or other[1] >= bottom - 0.5


def test_it_takes_few_screens_of_a_phone(seen):
    picture, elements, _, _ = seen(PHONE, "light")
    assert len(picture) <= MAX_SCREENS * SCREEN
    tops = {e["tag"] if e["kind"] is None else e["kind"]: e["top"] for e in reversed(elements)}
    assert tops["answer"] < tops["plot"] < SCREEN, "seen without scrolling"
    assert tops["plot"] < tops["pixels"] < tops["table"]


def test_beside_the_plot_is_the_picture_on_a_wide_screen(seen):
    _, elements, _, _ = seen(DESKTOP, "light")
    plot = next(e for e in elements if e["kind"] == "plot")
    chosen = next(e for e in elements if e["kind"] == "pixels")
    assert chosen["left"] >= plot["left"] + plot["width"]
    assert abs(chosen["top"] - plot["top"]) < 20
    assert chosen["top"] + chosen["height"] < 800, "both are seen without scrolling"


# What is chosen


def state(tab):
    """What is chosen and what is shown of it."""
    return tab.evaluate("""({
      chosen: document.querySelector("input[name=point]:checked").dataset.name,
      name: document.getElementById("name").textContent,
      said: document.getElementById("chosen").alt,
      found: document.getElementById("found").textContent,
      options: document.getElementById("options").textContent,
      color: document.getElementById("chosen").src,
      reference: document.getElementById("reference").src,
      share: getComputedStyle(document.getElementById("chosen")).clipPath,
      spoken: document.getElementById("share").getAttribute("aria-valuetext"),
      focus: document.activeElement.id || document.activeElement.dataset.name || "",
    })""")


def centre(tab, selector):
    """The middle of an element in the window."""
    return tab.evaluate(
        f"(box => [box.left + box.width / 2, box.top + box.height / 2])"
        f"(document.querySelector({selector!r}).getBoundingClientRect())"
    )


def mouse(tab, kind, x, y):
    """Move, press or release the mouse."""
    button = {} if kind == "mouseMoved" else {"button": "left", "clickCount": 1}
    tab.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **button)


def press(tab, key, code):
    """Press and release a key."""
    for kind in ("keyDown", "keyUp"):
        tab.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)


def rest(tab, milliseconds):
    """Let the page have some time."""
    tab.evaluate(f"new Promise(done => setTimeout(done, {milliseconds}))")


LEVEL = 'input[data-name="samples=area"]'


@pytest.fixture
def opened(tab, report):
    """The tab with the page on a wide screen, nothing touched yet."""
    tab.open(report.as_uri(), DESKTOP)
    mouse(tab, "mouseMoved", 1, 1)
    assert state(tab)["chosen"] == "standard"
    return tab


def check_level(tab, before):
    now = state(tab)
    assert now["chosen"] == now["name"] == now["said"] == "samples=area"
    assert "1.6× the time" in now["found"]
    assert "5.3× less error" in now["found"]
    assert now["options"] == "--set samples=area"
    assert now["color"] != before["color"]
    assert now["color"].startswith("data:image/webp")


def test_a_mouse_that_rests_on_a_point_shows_its_picture(opened):
    before = state(opened)
    place = centre(opened, LEVEL)
    mouse(opened, "mouseMoved", *place)
    rest(opened, 300)
    check_level(opened, before)
    mouse(opened, "mouseMoved", 1, 1)
    rest(opened, 300)
    assert state(opened)["chosen"] == "samples=area", "it stays, for the slider"


def test_a_mouse_on_its_way_across_points_changes_nothing(opened):
    mouse(opened, "mouseMoved", *centre(opened, LEVEL))
    mouse(opened, "mouseMoved", 1, 1)
    rest(opened, 300)
    assert state(opened)["chosen"] == "standard"


def test_a_finger_chooses_a_point_and_moves_the_divider(tab, report):
    tab.open(report.as_uri(), PHONE)
    tab.call("Emulation.setTouchEmulationEnabled", enabled=True)
    try:
        tab.evaluate("document.querySelector('.points').scrollIntoView({block: 'center'})")
        before = state(tab)
        (x, y) = centre(tab, LEVEL)
        points = [{"x": x, "y": y}]
        tab.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=points)
        tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        rest(tab, 300)
        check_level(tab, before)
        tab.evaluate("document.querySelector('.split').scrollIntoView({block: 'center'})")
        x, y = centre(tab, ".split")
        for kind, at in (("touchStart", x), ("touchMove", x + 40), ("touchMove", x + 80)):
            points = [{"x": at, "y": y}]
            tab.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        rest(tab, 100)
        assert 65 <= share_of(tab) <= 85
    finally:
        tab.call("Emulation.setTouchEmulationEnabled", enabled=False)


def share_of(tab):
    """Percent of the picture that shows the quality."""
    return int(tab.evaluate("document.getElementById('share').value"))


def test_keys_go_from_point_to_point_and_move_the_divider(opened):
    names = opened.evaluate(
        "[...document.querySelectorAll('input[name=point]')].map(p => p.dataset.name)"
    )
    press(opened, "Tab", 9)
    assert state(opened)["focus"] == "standard", "the plot is one stop"
    at = names.index("standard")
    for key, code, step in (("ArrowRight", 39, 1), ("ArrowRight", 39, 1), ("ArrowLeft", 37, -1)):
        press(opened, key, code)
        at += step
        now = state(opened)
        assert now["chosen"] == now["name"] == names[at]
    press(opened, "Tab", 9)
    assert state(opened)["focus"] == "share"
    press(opened, "ArrowRight", 39)
    assert share_of(opened) == 51
    press(opened, "Home", 36)
    now = state(opened)
    assert share_of(opened) == 0
    assert now["share"] == "inset(0px 100% 0px 0px)", "all of the reference"
    assert now["spoken"] == f"0 % {names[at]}"


def test_the_mouse_moves_the_divider(opened):
    x, y = centre(opened, ".split")
    mouse(opened, "mousePressed", x - 100, y)
    mouse(opened, "mouseReleased", x - 100, y)
    assert 20 <= share_of(opened) <= 40


def test_a_name_in_the_table_shows_its_picture_and_goes_there(tab, report):
    tab.open(report.as_uri(), PHONE)
    before = state(tab)
    tab.evaluate("document.querySelector('.pick[data-name=\"samples=area\"]').scrollIntoView()")
    x, y = centre(tab, '.pick[data-name="samples=area"]')
    mouse(tab, "mousePressed", x, y)
    mouse(tab, "mouseReleased", x, y)
    check_level(tab, before)
    top, bottom = tab.evaluate(
        "(b => [b.top, b.bottom])(document.querySelector('.split').getBoundingClientRect())"
    )
    assert top >= -1
    assert bottom <= 801


def test_what_has_the_focus_is_seen(opened, tmp_path):
    place = opened.evaluate(
        "(b => [b.left, b.top])(document.querySelector('.points').getBoundingClientRect())"
    )
    press(opened, "Tab", 9)
    x, y = centre(opened, "input[name=point]:checked")
    picture = opened.screenshot(tmp_path / "focus.png")
    around = picture[round(y) - 20 : round(y) + 20, round(x) - 20 : round(x) + 20]
    assert share(around, plots.LIGHT_COLORS["level"]) > 0.05
    assert place[0] > 0


def test_everything_has_a_name_for_those_who_hear_it(opened):
    opened.call("Accessibility.enable")
    nodes = opened.call("Accessibility.getFullAXTree")["nodes"]
    named = {}
    for node in nodes:
        if not node.get("ignored"):
            named.setdefault(node["role"]["value"], []).append(
                node.get("name", {}).get("value", "")
            )
    assert len(named["radio"]) == 18
    assert any(name.startswith("samples=area: 1.6× the time") for name in named["radio"])
    assert all(
        name.strip() for role in ("radio", "slider", "image", "radiogroup") for name in named[role]
    )
    assert "standard" in named["image"]
    assert named["heading"][0].startswith("What accuracy costs")


def test_nothing_moves_by_itself(report):
    style = report.read_text().partition("<style>")[2].partition("</style>")[0]
    assert not re.search("transition|animation|scroll-behavior", style)


# What does not need the program


def test_without_the_program_everything_is_still_there(tab, report, tmp_path):
    tab.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        tab.open(report.as_uri(), DESKTOP)
        place = tmp_path / "plain.png"
        picture = tab.screenshot(place)
        assert len(picture) > 800
    finally:
        tab.call("Emulation.setScriptExecutionDisabled", value=False)
    assert tab.evaluate("document.getElementById('viewer').hidden")
    assert tab.evaluate("document.querySelectorAll('.pick:enabled').length") == 0
    assert tab.evaluate("document.querySelectorAll('.group img').length") > 30


PRINTED = """
(() => {
  const held = [...document.querySelectorAll("table, .crops img, .crops svg, .answer, svg.plot")];
  const width = document.documentElement.clientWidth;
  return held.filter(e => {
    const box = e.getBoundingClientRect();
    return box.width === 0 || box.height === 0 || box.right > width + 1;
  }).map(e => e.outerHTML.slice(0, 80));
})()
"""


@pytest.mark.parametrize("runs_programs", [True, False])
def test_all_of_it_is_printed_on_a4(tab, report, runs_programs):
    tab.call("Emulation.setScriptExecutionDisabled", value=not runs_programs)
    try:
        tab.open(report.as_uri(), DESKTOP, scheme="dark")
        found = tab.call("Page.printToPDF", preferCSSPageSize=True)
    finally:
        tab.call("Emulation.setScriptExecutionDisabled", value=False)
    data = base64.b64decode(found["data"])
    pages = [float(x) for box in re.findall(rb"/MediaBox\s*\[([^]]*)\]", data) for x in box.split()]
    assert pages
    assert np.allclose(np.reshape(pages, (-1, 4)) / 72.0, [[0.0, 0.0, *A4]], atol=0.02)
    pictures = len(re.findall(rb"/Subtype\s*/Image", data))
    assert pictures >= 20, "folded ones too"
    assert 3 <= len(pages) // 4 <= 8


def test_nothing_is_wider_than_paper(tab, report):
    tab.open(report.as_uri(), round(96 * (A4[0] - 2 * 12 / 25.4)))
    tab.call("Emulation.setEmulatedMedia", media="print", features=[
        {"name": "prefers-color-scheme", "value": "dark"}])  # fmt: skip
    try:
        tab.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
        assert tab.evaluate(PRINTED) == []
        color = tab.evaluate("getComputedStyle(document.body).backgroundColor")
        assert color == "rgb(255, 255, 255)", "paper is white in a dark scheme too"
    finally:
        tab.call("Emulation.setEmulatedMedia", media="")
