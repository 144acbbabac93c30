"""The viewer in a real JupyterLab: in use, resized, unanswered, saved and opened again."""

from __future__ import annotations

import base64
import importlib.util
import io
import json
import os
import subprocess
import sys
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import chromium
import numpy as np
import pytest
from PIL import Image
from viewing import PATIENCE

import rasterjit as rj

NEEDED = ("jupyterlab", "anywidget", "ipykernel")

pytestmark = pytest.mark.takes_long


CELLS = (
    "import rasterjit as rj\n"
    "mesh = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])\n"
    "scene = rj.Scene(); node = scene.add(mesh)\n"
    "camera = rj.PerspectiveCamera((0.3, 0.4, 2), (0.3, 0.3, 0), fov_y=30)\n"
    "rj.show(scene, camera, size=(300, 200))",
    "import pathlib, time\n"
    "pathlib.Path('begun').touch()\n"
    "while not pathlib.Path('enough').exists(): time.sleep(0.05)",
)

LEAVE = "addEventListener('beforeunload', (event) => event.stopImmediatePropagation(), true)"
VIEW = "document.querySelector('.renderview-view')"
STATUS = "document.querySelector('.rasterjit-status')?.textContent"
SIZES = f"""(() => {{
  const image = {VIEW}, box = image.getBoundingClientRect()
  return [image.naturalWidth, image.naturalHeight, Math.round(box.width), Math.round(box.height)]
}})()"""
STILLS = """[...document.querySelectorAll('.jp-OutputArea img:not(.renderview-view)')]
  .filter((image) => image.offsetParent !== null)
  .map((image) => [image.naturalWidth, image.naturalHeight, image.alt])"""
ALT = "View of Scene(1 objects, 1 faces, 0 lights)"


def until(tell, wanted=bool):
    """Return what a function tells, as soon as it is what is wanted."""
    limit = time.monotonic() + PATIENCE
    while not wanted(found := tell()):
        assert time.monotonic() < limit, found
        time.sleep(0.05)
    return found


@contextmanager
def jupyterlab(folder, without=None):
    """Start JupyterLab in a folder, without one of its extensions, and give its address."""
    settings = folder / "settings"
    (settings / "labconfig").mkdir(parents=True)
    disabled = {} if without is None else {without: True}
    (settings / "labconfig" / "page_config.json").write_text(
        json.dumps({"disabledExtensions": disabled})
    )
    # Where anywidget is; its front end is beside it, also if this environment stands on another.
    found = importlib.util.find_spec("anywidget")
    share = Path(found.origin).parents[4] / "share" / "jupyter"
    environment = {
        **os.environ,
        "JUPYTER_PATH": os.pathsep.join([str(share), os.environ.get("JUPYTER_PATH", "")]),
        "JUPYTER_CONFIG_DIR": str(settings),
        "JUPYTER_DATA_DIR": str(folder / "data"),
        "JUPYTER_RUNTIME_DIR": str(folder / "runtime"),
    }
    process = subprocess.Popen(
        [
            sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", "--port=0",
            "--IdentityProvider.token=", "--ServerApp.disable_check_xsrf=True",
            "--LabApp.expose_app_in_browser=True", "--LabApp.news_url=None",
            f"--ServerApp.root_dir={folder}",
        ],
        cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield until(lambda: address_of(folder / "runtime"))
    finally:
        process.terminate()
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            # It waits for kernels that a busy machine ends late.
            process.kill()
            process.wait()


def address_of(runtime):
    """Return the address of the server that has written about itself, once it answers."""
    for path in runtime.glob("jpserver-*.json"):
        try:
            url = json.loads(path.read_text())["url"]
            urllib.request.urlopen(f"{url}api", timeout=PATIENCE).close()
        except (OSError, ValueError):
            continue
        return url
    return None


@pytest.fixture
def folder(tmp_path):
    nbformat = pytest.importorskip("nbformat")
    book = nbformat.v4.new_notebook()
    book.cells = [nbformat.v4.new_code_cell(text) for text in CELLS]
    book.metadata.kernelspec = {"name": "python3", "display_name": "Python", "language": "python"}
    nbformat.write(book, tmp_path / "view.ipynb")
    return tmp_path


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    """A tab of Chromium that leaves pages without a question."""
    for name in NEEDED:
        if importlib.util.find_spec(name) is None:
            pytest.skip(f"needs {name}")
    path = chromium.program()
    if path is None and not os.environ.get("CI"):
        pytest.skip("no Chromium")
    assert path is not None
    with chromium.chromium(path, tmp_path_factory.mktemp("profile")) as page:
        page.call(
            "Page.addScriptToEvaluateOnNewDocument",
            source=LEAVE,
        )
        yield page


def open_book(tab, url):
    tab.open(f"{url}lab/tree/view.ipynb?reset", 1300)
    tab.call(
        "Emulation.setDeviceMetricsOverride",
        width=1300, height=1200, deviceScaleFactor=1, mobile=False,
    )  # fmt: skip
    ready = "!!document.querySelector('.jp-Notebook .jp-Cell') && !!window.jupyterapp"
    until(lambda: tab.evaluate(ready))


def run_cell(tab, number):
    tab.evaluate(
        f"""(async () => {{
          const panel = window.jupyterapp.shell.currentWidget
          await panel.sessionContext.ready
          panel.content.activeCellIndex = {number}
          void window.jupyterapp.commands.execute('notebook:run-cell')
        }})()"""
    )


def mouse(tab, kind, x, y, buttons=1):
    button = "left" if buttons or kind == "mouseReleased" else "none"
    tab.call(
        "Input.dispatchMouseEvent",
        type=kind, x=x, y=y, button=button, buttons=buttons, clickCount=1,
    )  # fmt: skip


def drag(tab, start, move, steps):
    x, y = start
    mouse(tab, "mouseMoved", x, y, 0)
    mouse(tab, "mousePressed", x, y)
    for step in range(1, steps + 1):
        mouse(tab, "mouseMoved", x + move[0] * step / steps, y + move[1] * step / steps)
    mouse(tab, "mouseReleased", x + move[0], y + move[1], 0)


def middle(tab, what):
    return tab.evaluate(
        f"(() => {{ const box = {what}.getBoundingClientRect()"
        "; return [box.x + box.width / 2, box.y + box.height / 2] })()"
    )


def save(tab, path):
    """Save the notebook and return the outputs of its first cell."""
    tab.evaluate("window.jupyterapp.commands.execute('docmanager:save').then(() => true)")
    return json.loads(path.read_text())["cells"][0]["outputs"]


def picture_of(outputs):
    (data,) = (one["data"]["image/png"] for one in outputs if "image/png" in one["data"])
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))


def camera_of(outputs):
    text = "".join(outputs[-1]["data"]["text/plain"])
    return eval(text, {"rj": rj})


def test_view_is_moved_resized_waits_and_is_kept(tab, folder):
    with jupyterlab(folder) as url:
        open_book(tab, url)
        # Somebody else's picture, which is none, is passed over.
        tab.evaluate(
            "void (document.body.appendChild(new Image()).src = 'data:image/png;base64,%')"
        )
        run_cell(tab, 0)
        until(lambda: tab.evaluate(f"{VIEW}?.naturalWidth"), lambda width: width == 300)
        # The picture that is saved is hidden, and described where it is shown.
        until(lambda: tab.evaluate(STILLS), lambda found: found == [])
        assert tab.evaluate(f"{VIEW}.alt") == ALT
        # The camera's code is broken between words.
        code = "document.querySelector('.rasterjit-camera > code')"
        breaks = "[code, code.parentElement].map((one) => getComputedStyle(one).wordBreak)"
        assert tab.evaluate(f"((code) => {breaks})({code})") == ["normal", "normal"]

        # Two drags one after the other leave no picture of a size that was passed.
        for moves in ([(160, 90)], [(-90, -60), (50, 120)], [(30, -70), (-120, 40)]):
            for move in moves:
                drag(tab, middle(tab, "document.querySelector('.renderview-resizer')"), move, 15)
            until(lambda: tab.evaluate(SIZES), lambda found: found[:2] == found[2:])
        width, height = tab.evaluate(SIZES)[:2]
        assert (width, height) == (330, 320)

        # The kernel is busy: the view says so, and follows afterwards.
        run_cell(tab, 1)
        until((folder / "begun").exists)
        drag(tab, middle(tab, VIEW), (60, 10), 4)
        until(lambda: tab.evaluate(STATUS), lambda text: "kernel is busy" in text)
        (folder / "enough").touch()
        until(lambda: tab.evaluate(STATUS), lambda text: text == "")

        # What is kept is the last view: turned, and of the last size.
        def turned():
            outputs = save(tab, folder / "view.ipynb")
            return abs(camera_of(outputs).eye[0] - 0.3) > 0.2 and outputs

        outputs = until(turned)
        assert picture_of(outputs).shape == (height, width, 3)
        mesh = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        expected = rj.render(
            mesh, camera_of(outputs), size=(width, height), background="white",
            quality=rj.Quality.reference(),
        ).color[:, :, :3]  # fmt: skip
        difference = np.abs(picture_of(outputs).astype(int) - expected)
        assert difference.mean() < 2.0

        # A kernel that begins anew knows the view no more.
        kernel = "window.jupyterapp.shell.currentWidget.sessionContext.session.kernel"
        tab.evaluate(f"{kernel}.restart().then(() => true)")
        until(lambda: tab.evaluate(STATUS), lambda text: "kernel of this view is gone" in text)
        tab.evaluate(f"{kernel}.shutdown().then(() => true)")

        open_book(tab, url)
        until(lambda: tab.evaluate(STILLS), lambda found: [width, height, ALT] in found)
        text = "document.querySelector('.jp-OutputArea').innerText"
        until(lambda: tab.evaluate(text), lambda text: "rj.PerspectiveCamera(eye" in text)
        # JupyterLab looks for the widget for two seconds.
        time.sleep(3.0)
        assert "Error" not in tab.evaluate(text)


@pytest.mark.parametrize("without", ["@jupyter-widgets/jupyterlab-manager", "anywidget"])
def test_without_its_front_end_there_is_a_picture_and_what_to_install(tab, folder, without):
    with jupyterlab(folder, without) as url:
        open_book(tab, url)
        run_cell(tab, 0)
        until(lambda: tab.evaluate(STILLS), lambda found: found == [[300, 200, ALT]])
        text = "document.querySelector('.jp-OutputArea').innerText"
        told = until(lambda: tab.evaluate(text), lambda text: "rj.PerspectiveCamera(eye" in text)
        if without == "anywidget":
            error = "document.querySelector('.jupyter-widgets-error-widget')"
            until(lambda: tab.evaluate(f"!!{error}"))
            told = tab.evaluate(f"getComputedStyle({error}, '::before').content")
        packages = "anywidget" if without == "anywidget" else "ipywidgets anywidget"
        assert f"pip install {packages}" in told
        assert "environment of the Jupyter server" in told
