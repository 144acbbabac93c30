"""What people do on the page: by mouse, fingers and keys, in Chromium, also as a phone."""

from __future__ import annotations

import math
import os
import re
import signal
import socket
import time

import chromium
import numpy as np
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES
from PIL import Image
from viewing import (
    PATIENCE,
    click,
    command,
    picture_of_window,
    place_of,
    press,
    shown,
    touch,
    viewing,
    wait_for,
    wait_until,
)

import rasterjit as rj
from rasterjit.viewer.overlay import BACKGROUND_GREY
from rasterjit.viewer.viewer import Viewer

pytestmark = [pytest.mark.takes_long, pytest.mark.needs_jit]

WIDTH, HEIGHT = 640, 800
PHONE = {"width": 360, "height": 740, "deviceScaleFactor": 3, "mobile": True}

MIN_CONTRAST = 4.5

MIN_TOUCH = 44
"""Side of what a finger hits, CSS pixels."""

TAP = 0.7
"""Seconds in which a tap has done what it does."""


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "pair.glb"
    scene, cube = rj.Scene(), rj.Mesh(CUBE_VERTICES, CUBE_FACES)
    for name, x in (("left", -1.6), ("right", 1.6)):
        scene.add(cube, rj.transforms.translate((x, 0.0, 0.0)), name=name)
    scene.save(path)
    return path


@pytest.fixture(scope="module")
def server(model):
    with viewing(*command(model)) as found:
        yield found


@pytest.fixture(scope="module")
def browser_page(tmp_path_factory):
    path = chromium.program()
    if path is None and not os.environ.get("CI"):
        pytest.skip("no Chromium")
    assert path is not None
    with chromium.chromium(path, tmp_path_factory.mktemp("profile")) as page:
        yield page


def open_page(page, address, **metrics):
    """Open an address anew, in a window of a size, and wait for a sharp picture of that size."""
    page.call("Page.navigate", url="about:blank")
    wait_until(page, "location.href === 'about:blank'")
    metrics = {"width": WIDTH, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False, **metrics}
    page.call("Emulation.setDeviceMetricsOverride", **metrics)
    page.call("Emulation.setTouchEmulationEnabled", enabled=metrics["mobile"], maxTouchPoints=2)
    page.call("Page.navigate", url=address)
    wait_until(page, "document.readyState === 'complete' && location.href !== 'about:blank'")
    width, height = (metrics[side] * metrics["deviceScaleFactor"] for side in ("width", "height"))
    is_sized = f"picture.width === {width} && picture.height === {height}"
    is_told = f"line.textContent.includes('{width} x {height}')"
    wait_until(page, f"picture.dataset.kind === 'png' && {is_sized} && {is_told}")


def wait_for_rest(page):
    """Wait for the picture that becomes no better."""
    wait_until(page, "picture.dataset.kind === 'png' && picture.dataset.done === 'true'")


@pytest.fixture
def page(browser_page, server):
    open_page(browser_page, server[1])
    return browser_page


@pytest.fixture
def phone(browser_page, server):
    open_page(browser_page, server[1], **PHONE)
    return browser_page


def camera_in(page):
    """Return the camera that the page gives as code."""
    return eval(page.evaluate("code.value"), {"rj": rj})


def wait_for_view(page, wanted):
    """Wait until the page looks from where a camera stands, whatever it will turn around."""
    limit = time.monotonic() + PATIENCE
    while True:
        found = camera_in(page)
        ahead = [np.subtract(one.target, one.eye) for one in (found, wanted)]
        turned = math.dist(*(one / np.linalg.norm(one) for one in ahead))
        if max(math.dist(found.eye, wanted.eye), turned) < 1e-6:
            return
        assert time.monotonic() < limit, (found, wanted)
        time.sleep(0.1)


def viewer_like(page, model):
    """Return a viewer of our own of the page's size."""
    size = page.evaluate("[picture.width, picture.height, devicePixelRatio]")
    viewer = Viewer(rj.load(model), size=tuple(size[:2]))
    viewer.resize(tuple(size[:2]), size[2])
    return viewer


def settle(viewer):
    while viewer.is_moving:
        viewer.advance(0.05)


def press_own(viewer, key):
    for kind in ("key_down", "key_up"):
        viewer.handle({"event_type": kind, "key": key, "modifiers": ()})
    settle(viewer)


def test_address_loses_the_token_and_no_script_sees_it(page, server):
    own, token = place_of(server[1])
    assert page.evaluate("location.href") == f"http://{own}/"
    assert page.evaluate("document.cookie") == ""
    assert token not in page.evaluate("document.documentElement.outerHTML")
    assert token not in page.evaluate("JSON.stringify([history.state, document.referrer])")
    # It comes in again, as long as the browser runs.
    page.evaluate("window.isOld = true")
    page.call("Page.reload")
    wait_until(page, "!window.isOld && document.readyState === 'complete'")
    wait_until(page, "picture.dataset.kind === 'png'")


def test_browser_without_a_decoder_shows_the_same(page, server):
    pixels = """(() => {
      const data = picture.getContext("2d").getImageData(0, 0, picture.width, picture.height).data;
      return [window.ImageDecoder === undefined, data.reduce((sum, one, at) =>
        (sum + one * (at % 9973)) % 2147483647, 0)];
    })()"""
    wait_for_rest(page)
    has_none, with_it = page.evaluate(pixels)
    assert not has_none
    source = "delete window.ImageDecoder"
    script = page.call("Page.addScriptToEvaluateOnNewDocument", source=source)["identifier"]
    try:
        open_page(page, server[1])
        wait_for_rest(page)
        assert page.evaluate(pixels) == [True, with_it]
    finally:
        page.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)


def test_keys_work_as_soon_as_the_page_is_open(page):
    assert page.evaluate("document.activeElement.id") == "picture"
    press(page, "3")
    wait_until(page, "document.querySelector('[value=normal]').checked")
    press(page, "h")
    assert not page.evaluate("help.hidden")
    assert "fit the scene" in page.evaluate("help.innerText")
    press(page, "Escape")
    assert page.evaluate("help.hidden")


def test_a_drag_that_ends_outside_ends(page, model):
    before = camera_in(page)
    held = {"button": "left", "buttons": 1}
    for kind, x, y in (("mousePressed", 300, 600), ("mouseMoved", 400, 700)):
        page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, clickCount=1, **held)
    page.call("Input.dispatchMouseEvent", type="mouseReleased", x=400, y=900, button="left")
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=100, y=100)
    mine = viewer_like(page, model)
    for kind, x, y in (("down", 300, 600), ("move", 400, 700), ("up", 400, 900)):
        event = {"event_type": f"pointer_{kind}", "x": x, "y": y, "button": 1, "modifiers": ()}
        mine.handle(event)
    settle(mine)
    assert math.dist(before.eye, mine.camera.eye) > 1.0
    wait_for_view(page, mine.camera)
    mine.close()


def test_two_fingers_pan_and_pinch(phone, model):
    mine = viewer_like(phone, model)
    touch(phone, "touchStart", (140, 300))
    touch(phone, "touchStart", (140, 300), (220, 300))
    touch(phone, "touchMove", (160, 340), (240, 340))
    touch(phone, "touchEnd")
    for kind, x, y in (("down", 180, 300), ("move", 200, 340), ("up", 200, 340)):
        event = {"event_type": f"pointer_{kind}", "x": x, "y": y, "button": 3, "modifiers": ()}
        mine.handle(event)
    settle(mine)
    wait_for_view(phone, mine.camera)
    panned = mine.camera
    touch(phone, "touchStart", (160, 370))
    touch(phone, "touchStart", (160, 370), (200, 370))
    for spread in (30, 40, 50):
        touch(phone, "touchMove", (180 - spread, 370), (180 + spread, 370))
    touch(phone, "touchEnd")
    wanted = math.dist(panned.eye, panned.target) * 20 / 50
    limit = time.monotonic() + PATIENCE
    while abs(math.dist(camera_in(phone).eye, camera_in(phone).target) - wanted) > 1e-5 * wanted:
        assert time.monotonic() < limit
        time.sleep(0.1)
    mine.close()


def test_one_finger_turns_and_a_double_tap_fits(phone, model):
    mine = viewer_like(phone, model)
    touch(phone, "touchStart", (140, 300))
    touch(phone, "touchMove", (200, 350))
    touch(phone, "touchEnd")
    for kind, x, y in (("down", 140, 300), ("move", 200, 350), ("up", 200, 350)):
        event = {"event_type": f"pointer_{kind}", "x": x, "y": y, "button": 1, "modifiers": ()}
        mine.handle(event)
    settle(mine)
    wait_for_view(phone, mine.camera)
    for _ in range(3):
        press(phone, "+")
        press_own(mine, "+")
    wait_for_view(phone, mine.camera)
    for _ in range(2):
        touch(phone, "touchStart", (150, 320))
        touch(phone, "touchEnd")
    near = mine.camera
    press_own(mine, "f")
    assert math.dist(near.eye, mine.camera.eye) > 1.0
    wait_for_view(phone, mine.camera)
    # It picked nothing.
    time.sleep(TAP)
    assert phone.evaluate("pick.hidden")
    mine.close()


def places_of(model, viewer):
    """Return what a picture shows where, without light: numbers of objects, and positions."""
    scene, outputs = rj.load(model), ("object_id", "position")
    frame = rj.render(scene, viewer.camera, size=viewer.size, outputs=outputs)
    found = []
    for number, node in enumerate(list(scene.nodes)):
        # Where nothing lies behind it.
        others = rj.Scene()
        for other in scene.nodes:
            if other is not node:
                others.add(other.mesh, other.world_from_model)
        free = rj.render(others, viewer.camera, size=viewer.size, outputs="coverage",
                         quality=rj.Quality(samples=16)).coverage == 0.0  # fmt: skip
        rows, columns = np.nonzero((frame.object_id == number) & free)
        middle = np.argmin(np.hypot(rows - rows.mean(), columns - columns.mean()))
        row, column = rows[middle], columns[middle]
        found.append(((int(column), int(row)), frame.position[row, column]))
    return found


def wait_for_pixels(page, wanted):
    """Wait until the page shows colours, by column and row, as they are and in its whole size."""
    limit, found = time.monotonic() + PATIENCE, None
    while found != wanted:
        assert time.monotonic() < limit, (found, wanted)
        picture, kind = shown(page)
        if kind == "png" and picture.shape == (HEIGHT, WIDTH, 3):
            found = {(column, row): picture[row, column].tolist() for column, row in wanted}


def position_in(page):
    text = page.evaluate("picked.innerText")
    return [float(part) for part in re.search(r"position\s+(.*)", text)[1].split()]


def test_a_click_picks_and_a_second_one_measures(page, model):
    mine = viewer_like(page, model)
    (first, there), (second, other) = places_of(model, mine)
    click(page, first[0] + 0.5, first[1] + 0.5)
    wait_until(page, "!pick.hidden && document.getElementById('pick-name').innerText === 'left'")
    assert position_in(page) == pytest.approx(there, abs=1e-4)
    assert "distance" not in page.evaluate("picked.innerText")
    assert page.evaluate("why.open") is False
    click(page, second[0] + 0.5, second[1] + 0.5)
    wait_until(page, "document.getElementById('pick-name').innerText === 'right'")
    assert position_in(page) == pytest.approx(other, abs=1e-4)
    measured = float(re.search(r"distance\s+(\S+)", page.evaluate("picked.innerText"))[1])
    assert measured == pytest.approx(math.dist(there, other), rel=1e-4)
    assert "right" in page.evaluate("heard.innerText")
    assert str(measured)[:6] in page.evaluate("heard.innerText")
    # The next one begins anew.
    press(page, "Escape")
    wait_until(page, "pick.hidden")
    click(page, first[0] + 0.5, first[1] + 0.5)
    wait_until(page, "!pick.hidden")
    assert "distance" not in page.evaluate("picked.innerText")
    mine.close()


def test_a_tap_picks_and_a_long_one_explains(phone, model):
    mine = viewer_like(phone, model)
    (first, _), _ = places_of(model, mine)
    place = [(part + 0.5) / 3 for part in first]
    touch(phone, "touchStart", place)
    touch(phone, "touchEnd")
    wait_until(phone, "!pick.hidden && document.getElementById('pick-name').innerText === 'left'")
    assert not phone.evaluate("why.open")
    press(phone, "Escape")
    wait_until(phone, "pick.hidden")
    touch(phone, "touchStart", place)
    wait_until(phone, "!pick.hidden && why.open")
    touch(phone, "touchEnd")
    assert f"pixel ({first[0]}, {first[1]})" in phone.evaluate("reasons.innerText").replace(
        "\t", " "
    )
    mine.close()


def test_objects_are_hidden_singled_out_and_coloured(page, model):
    scene = rj.load(model)
    mine = viewer_like(page, model)

    def reference(*numbers):
        some = rj.Scene()
        for number in numbers:
            some.add(scene.nodes[number].mesh, scene.nodes[number].world_from_model)
        return rj.render(some, mine.camera, size=mine.size, quality=rj.Quality.reference()).color[
            :, :, :3
        ]

    page.evaluate("document.querySelector('[data-opens=objects]').click()")
    assert page.evaluate("[...nodes.querySelectorAll('span')].map(one => one.innerText)") == [
        "left", "right",
    ]  # fmt: skip
    page.evaluate("document.querySelector('[data-number=\"0\"]').click()")
    wait_for(page, reference(1))
    assert page.evaluate("document.querySelector('[data-number=\"0\"]').checked") is False
    page.evaluate("document.querySelector('[aria-label=\"Show only left\"]').click()")
    wait_for(page, reference(0))
    page.evaluate("document.getElementById('show-all').click()")
    wait_for(page, reference(0, 1))
    page.evaluate("document.getElementById('color-by-object').click()")
    (first, _), (second, _) = places_of(model, mine)
    swatches = page.evaluate(
        "[...nodes.querySelectorAll('i')].map(one => getComputedStyle(one).backgroundColor)"
    )
    colors = [list(map(int, re.findall(r"\d+", one))) for one in swatches]
    wait_for_pixels(page, {first: colors[0], second: colors[1]})
    assert colors[0] != colors[1]
    # An object keeps its colour when others are hidden.
    page.evaluate("document.querySelector('[data-number=\"0\"]').click()")
    wait_for_pixels(page, {first: [BACKGROUND_GREY] * 3, second: colors[1]})
    mine.close()


def test_view_is_copied_as_code_and_as_an_address(page, server, model):
    page.call("Browser.grantPermissions", permissions=["clipboardReadWrite"])
    press(page, "ArrowLeft")
    press(page, "+")
    # It is written when nothing moves any more.
    wait_until(page, "location.hash.startsWith('#eye=')")
    page.evaluate("document.querySelector('[data-opens=view]').click()")
    wait_until(page, "said.innerText === 'copied the view as code'")
    code = page.evaluate("navigator.clipboard.readText()")
    assert code == page.evaluate("code.value")
    assert re.fullmatch(
        r"rj\.PerspectiveCamera\(eye=\(.*\), target=\(.*\), up=\(.*\), fov_y=28\)", code
    )
    camera = eval(code, {"rj": rj})
    picture = rj.render(
        rj.load(model), camera, size=(WIDTH, HEIGHT), quality=rj.Quality.reference()
    ).color[:, :, :3]
    # Numbers have nine digits.
    few = picture.size // 1000
    wait_for(page, picture, few)
    page.evaluate("document.querySelector('[data-copies=address]').click()")
    wait_until(page, "said.innerText === 'copied the address of the view'")
    address = page.evaluate("navigator.clipboard.readText()")
    assert place_of(server[1])[1] not in address
    open_page(page, address)
    wait_for_view(page, camera)
    wait_for(page, picture, few)
    # Elsewhere it stands behind the address that was printed.
    page.call("Network.clearBrowserCookies")
    open_page(page, server[1] + address[address.index("#") :])
    wait_for_view(page, camera)


def test_address_holds_the_look_and_what_is_hidden(page, server):
    view = "#eye=4,3,12&target=0,0,0&up=0,1,0&fov_y=30&look=depth&switched=vignette&hidden=1"
    open_page(page, server[1] + view)
    wait_until(page, "document.querySelector('[value=depth]').checked")
    wait_until(page, "document.querySelector('[data-effect=vignette]').checked")
    wait_until(page, "!document.querySelector('[data-number=\"1\"]').checked")
    assert camera_in(page).eye == (4.0, 3.0, 12.0)
    wait_until(page, "location.hash.includes('look=depth') && location.hash.includes('hidden=1')")


def test_switches_in_quick_succession_all_count(page):
    page.evaluate(
        "for (const one of ['[data-effect=vignette]', '[value=normal]', '[data-effect=outline]',"
        " '[value=color]']) document.querySelector(one).click()"
    )
    wait_until(page, "picture.dataset.done === 'true' && location.hash.includes('switched')")
    for one in ("[data-effect=vignette]", "[data-effect=outline]", "[value=color]"):
        assert page.evaluate(f"document.querySelector('{one}').checked"), one


def test_picture_is_saved(page, tmp_path):
    page.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    wait_for_rest(page)
    picture, _ = shown(page)
    page.evaluate("screenshot.click()")
    path, limit = tmp_path / "pair.glb.png", time.monotonic() + PATIENCE
    while not path.exists():
        assert time.monotonic() < limit
        time.sleep(0.1)
    np.testing.assert_array_equal(np.asarray(Image.open(path).convert("RGB")), picture)


def test_bar_works_by_keyboard(page):
    press(page, "Tab")
    assert page.evaluate("document.activeElement.id") == "fit"
    press(page, "ArrowRight")
    assert page.evaluate("document.activeElement.dataset.opens") == "look"
    press(page, "Enter")
    assert page.evaluate("document.activeElement.name") == "kind"
    assert page.evaluate("document.querySelector('[data-opens=look]').ariaExpanded") == "true"
    press(page, "Escape")
    assert page.evaluate("[look.hidden, document.activeElement.id]") == [True, "picture"]
    assert page.evaluate("document.querySelector('[data-opens=look]').ariaExpanded") == "false"


NAMED = {"button", "checkbox", "radio", "radiogroup", "combobox", "textbox", "toolbar", "image"}


def test_everything_has_a_name_for_screen_readers(page):
    # What is told of a new picture would close what is opened here.
    wait_for_rest(page)
    page.evaluate("document.querySelectorAll('.panel').forEach(one => one.hidden = false)")
    nodes = page.call("Accessibility.getFullAXTree")["nodes"]
    named = [
        (node["role"]["value"], node["name"]["value"])
        for node in nodes
        if not node["ignored"] and node["role"]["value"] in NAMED
    ]
    assert {role for role, _ in named} == NAMED
    assert all(name.strip() for _, name in named), named
    names = {name for role, name in named if role == "button"}
    assert {"Fit", "Look", "Effects", "Objects", "Save", "Copy", "Help", "Close"} <= names
    roles = {node["role"]["value"] for node in nodes}
    assert "status" in roles
    assert page.evaluate("gone.getAttribute('role')") == "alert"


CONTRASTS = """
(() => {
  const parts = (text) => text.match(/[\\d.]+/g).map(Number);
  const light = (color) => {
    const [r, g, b] = color.map((one) => one / 255)
      .map((one) => one <= 0.04045 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const found = [];
  document.querySelectorAll(".panel, #gone").forEach((one) => (one.hidden = false));
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim() || element.closest(".heard, #waiting, option")) continue;
    const text = parts(getComputedStyle(element).color);
    const layers = [];
    for (let one = element; one; one = one.parentElement) {
      layers.push(parts(getComputedStyle(one).backgroundColor));
      if (one.matches(".panel, #bar, #line, #said, #gone")) break;
    }
    for (const under of [[0, 0, 0], [255, 255, 255]]) {
      let back = under;
      for (const [r, g, b, alpha = 1] of layers.reverse()) {
        back = [r, g, b].map((part, axis) => part * alpha + back[axis] * (1 - alpha));
      }
      layers.reverse();
      const [dark, bright] = [light(text), light(back)].sort((a, b) => a - b);
      found.push([walker.currentNode.data.trim(), (bright + 0.05) / (dark + 0.05)]);
    }
  }
  return found;
})()
"""


def test_text_stands_out_before_any_picture(page):
    found = page.evaluate(CONTRASTS)
    assert len(found) > 100
    assert min(found, key=lambda one: one[1])[1] >= MIN_CONTRAST


BOXES = """
[...document.querySelectorAll(%r)].map((one) => {
  const {left, top, right, bottom} = one.getBoundingClientRect();
  return [one.textContent.trim(), left, top, right, bottom];
})
"""


def test_phone_has_room_for_all_and_every_pixel(phone, tmp_path):
    width, height = PHONE["width"], PHONE["height"]
    assert phone.evaluate("document.documentElement.scrollWidth") <= width
    assert phone.evaluate("[picture.width, picture.height]") == [3 * width, 3 * height]
    boxes = phone.evaluate(BOXES % "#bar button")
    assert len(boxes) == 7
    for name, left, top, right, bottom in boxes:
        assert 0 <= left < right <= width, name
        assert 0 <= top < bottom <= height, name
        assert right - left >= MIN_TOUCH, name
        assert bottom - top >= MIN_TOUCH, name
    for panel in ("look", "effects", "objects", "view", "help"):
        phone.evaluate(f"document.querySelector('[data-opens={panel}]').click()")
        ((_, left, top, right, bottom),) = phone.evaluate(BOXES % f"#{panel}")
        assert (left, right) == (0, width), panel
        assert 0 <= top < bottom <= boxes[0][2] + 1, panel
        inside = f"{panel}.scrollWidth <= {panel}.clientWidth"
        assert phone.evaluate(f"document.getElementById('{panel}') && {inside}"), panel
    press(phone, "Escape")
    # Nothing is said, and nothing drawn any more.
    wait_until(phone, "said.innerText === ''")
    wait_for_rest(phone)
    window = picture_of_window(phone, tmp_path / "phone.png")
    picture, _ = shown(phone)
    # Above the lines of text each pixel of the picture is one of the screen.
    above = slice(0, 1800)
    np.testing.assert_array_equal(window[above], picture[above])


OVERLAPS = """
(() => {
  const all = [...document.querySelectorAll("#bar, #line, #said, #gone, .panel")]
    .filter((one) => one.checkVisibility({visibilityProperty: true}))
    .map((one) => [one.id, one.getBoundingClientRect()]);
  return all.flatMap(([a, one], index) => all.slice(index + 1)
    .filter(([, two]) => one.left < two.right && two.left < one.right
      && one.top < two.bottom && two.top < one.bottom)
    .map(([b]) => [a, b]));
})()
"""


@pytest.mark.parametrize(
    ("width", "height", "mobile"),
    [(1280, 800, False), (850, 600, False), (610, 740, False), (740, 360, True), (360, 740, True)],
)
def test_nothing_lies_on_something_else(browser_page, server, width, height, mobile):
    open_page(browser_page, server[1], width=width, height=height, mobile=mobile)
    browser_page.evaluate("document.querySelector('#screenshot').click()")
    wait_until(browser_page, "said.innerText.startsWith('saved')")
    assert browser_page.evaluate(OVERLAPS) == []
    (middle_x, middle_y) = width / 2, height / 2
    if mobile:
        touch(browser_page, "touchStart", (middle_x, middle_y + 20))
        time.sleep(TAP)
        touch(browser_page, "touchEnd")
    else:
        click(browser_page, middle_x, middle_y + 20)
        browser_page.evaluate("why.open = true")
    wait_until(browser_page, "!pick.hidden && reasons.rows.length > 5")
    assert browser_page.evaluate(OVERLAPS) == []
    if width < 600:
        ((_, _, _, _, bottom),) = browser_page.evaluate(BOXES % "#pick")
        assert bottom < middle_y, "what is told covers the pixel"
    for panel in ("look", "effects", "objects", "view", "help"):
        browser_page.evaluate(f"document.querySelector('[data-opens={panel}]').click()")
        wait_until(browser_page, f"!document.getElementById('{panel}').hidden")
        assert browser_page.evaluate(OVERLAPS) == [], panel
        if mobile:
            least = f"#{panel} :is(button, label:has(input), select, summary)"
            for name, _, top, _, bottom in browser_page.evaluate(BOXES % least):
                assert bottom - top >= MIN_TOUCH, name
    press(browser_page, "Escape")


def test_what_is_shown_alone_and_what_the_scene_lacks_are_told_apart(page):
    page.evaluate("document.querySelector('[data-opens=objects]').click()")
    page.evaluate("document.querySelector('[data-only=\"1\"]').click()")
    pressed = "[...document.querySelectorAll('[data-only]')].map((one) => one.ariaPressed).join()"
    wait_until(page, f"{pressed} === 'false,true'")
    page.evaluate("document.querySelector('#show-all').click()")
    wait_until(page, f"{pressed} === 'false,false'")
    page.evaluate("document.querySelector('[data-opens=effects]').click()")
    colors = """[true, false].map((is) => getComputedStyle([...document.querySelectorAll(
      '[data-effect]')].find((one) => one.disabled === is).parentElement).color)"""
    lacking, possible = page.evaluate(colors)
    assert lacking != possible


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]


GONE = "!gone.hidden && gone.innerText"


def test_page_comes_back_with_its_server(browser_page, model):
    port, token = str(free_port()), "a-token-that-is-kept"
    same = command(model, "--port", port, "--token", token)
    with viewing(*same) as (process, address):
        assert place_of(address)[1] == token
        open_page(browser_page, address)
        press(browser_page, "+")
        press(browser_page, "2")
        still = "picture.dataset.done === 'true'"
        wait_until(browser_page, f"document.querySelector('[value=depth]').checked && {still}")
        view = camera_in(browser_page)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert "does not answer" in wait_until(browser_page, GONE)
    # Another viewer has moved in, which does not know it.
    with viewing(*command(model, "--port", port)):
        wait_until(browser_page, f"{GONE} && gone.innerText.includes('another token')")
    browser_page.evaluate("picture.dataset.kind = ''")
    with viewing(*same):
        wait_until(browser_page, "gone.hidden && picture.dataset.kind === 'png'")
        wait_until(browser_page, "document.querySelector('[value=depth]').checked")
        wait_for_view(browser_page, view)
