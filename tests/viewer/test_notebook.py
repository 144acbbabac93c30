"""Notebooks show frames, scenes and meshes as pictures, and a viewer as a widget."""

from __future__ import annotations

import asyncio
import base64
import copy
import html
import io
import os
import re
import threading
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image, ImageShow

import rasterjit as rj
from rasterjit.runtime import progress
from rasterjit.styles.small_preview import SIZE
from rasterjit.viewer.viewer import Viewer

pytestmark = pytest.mark.takes_long

PATIENCE = 240
"""Seconds for a cell, on a loaded machine."""


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGBA"))


def test_mesh_and_scene_show_themselves_fitted(cube):
    scene = rj.Scene()
    scene.add(cube)
    frame = rj.styles.studio(cube).render(size=SIZE)
    for thing in (cube, scene):
        np.testing.assert_array_equal(pixels(thing._repr_png_()), frame.color)
    np.testing.assert_array_equal(pixels(frame._repr_png_()), frame.color)


class Images(HTMLParser):
    """The attributes of each picture of a page."""

    def __init__(self, text):
        super().__init__()
        self.found = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.found.append(dict(attrs))


def test_pictures_say_what_they_show(cube):
    scene = rj.Scene()
    scene.add(cube)
    frame = rj.render(cube, size=(8, 6))
    for thing in (cube, scene, frame):
        data, metadata = thing._repr_mimebundle_()
        assert data["image/png"] == thing._repr_png_()
        (image,) = Images(data["text/html"]).found
        assert base64.b64decode(image["src"].partition(",")[2]) == data["image/png"]
        assert image["alt"] == metadata["image/png"]["alt"] == f"Picture of {thing!r}"
        shown = Image.open(io.BytesIO(data["image/png"]))
        told = rf"{shown.width} × {shown.height}, 12 triangles, \d+ ms</div>"
        assert re.search(told, data["text/html"])


def test_frame_shows_itself_in_a_cell(cube, monkeypatch):
    display = pytest.importorskip("IPython.display")
    frame = rj.render(cube, size=(8, 6), threads=1)
    shown = []
    monkeypatch.setattr(progress, "in_notebook", lambda: True)
    monkeypatch.setattr(display, "display", shown.append)
    frame.show()
    assert shown == [frame]


def test_frame_opens_the_picture_viewer_where_there_is_a_display(cube, monkeypatch):
    opened = []

    class Viewer(ImageShow.Viewer):
        def show_image(self, image, **options):
            opened.append((image, options["title"]))
            return True

    frame = rj.render(cube, size=(8, 6), threads=1)
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.setattr(ImageShow, "_viewers", [Viewer()])
    frame.show("A cube")
    ((image, title),) = opened
    np.testing.assert_array_equal(np.asarray(image), frame.color)
    assert title == "A cube"
    with pytest.raises(ValueError, match="title must be a string, got 7"):
        frame.show(7)
    with pytest.raises(rj.OutputNotRequestedError):
        rj.render(cube, size=(8, 6), outputs="depth").show()


def test_nothing_to_see_shows_no_picture():
    empty = rj.Scene()
    assert empty._repr_png_() is None
    assert empty._repr_mimebundle_() == ({}, {})
    line = rj.Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    assert line._repr_png_() is None


RESIZE = {
    "type": "resize", "width": 50.0, "height": 40.0, "pwidth": 50, "pheight": 40, "ratio": 1.0,
    "timestamp": 0.0,
}  # fmt: skip


def test_widget_draws_in_the_thread_of_the_cells_whatever_thread_messages_come_in(cube):
    widgets = pytest.importorskip("rasterjit.viewer.widget")
    viewer = Viewer(cube, size=(64, 48))
    threads, sent = [], []
    draw = viewer.draw
    viewer.draw = lambda: threads.append(threading.current_thread()) or draw()

    async def use():
        widget = widgets.ViewWidget(viewer)
        widget.send = lambda message, buffers=None: sent.append((message, buffers))

        async def answered(kind, count):
            for _ in range(2000):
                if [message["type"] for message, _ in sent].count(kind) >= count:
                    return
                await asyncio.sleep(0.01)
            raise AssertionError(sent)

        def take(*messages):
            """Take messages, as JupyterLab lets a thread of the kernel do."""
            for message in messages:
                widget._handle_custom_msg(dict(message), [])

        await asyncio.to_thread(setattr, widget, "_has_visible_views", True)
        await asyncio.to_thread(take, RESIZE, {"type": "rasterjit-ask", "number": 3})
        await answered("rasterjit-answer", 1)
        await answered("framebufferdata", 1)
        # Nobody says that a picture has arrived; one that is asked for comes all the same.
        for _ in range(5):
            count = [message["type"] for message, _ in sent].count("framebufferdata")
            await asyncio.to_thread(take, {"type": "rasterjit-again"})
            await answered("framebufferdata", count + 1)
        widget.close()

    asyncio.run(use())
    assert set(threads) == {threading.main_thread()}
    assert {"type": "rasterjit-answer", "number": 3} in [message for message, _ in sent]
    last = [buffers[0] for message, buffers in sent if message["type"] == "framebufferdata"][-1]
    assert Image.open(io.BytesIO(last)).size == (50, 40)


CELLS = (
    "import rasterjit as rj\n"
    "mesh = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])\n"
    "scene = rj.Scene(); node = scene.add(mesh)",
    "rj.render(mesh, size=(8, 6))",
    "mesh",
    "scene",
    "rj.Scene()",
    "camera = rj.PerspectiveCamera((0.3, 0.4, 2), (0.3, 0.3, 0), fov_y=30)\n"
    "rj.show(scene, camera, size=(64, 48))",
    "import sys; sys.modules['rasterjit.viewer.widget'] = None\nrj.show(scene, size=(64, 48))",
    "rj.show(scene, size=(64, 48), backend='notebook')",
)
WIDGET = "application/vnd.jupyter.widget-view+json"


@pytest.fixture(scope="module")
def book():
    """A notebook with one output of each kind, as it is saved."""
    if not os.environ.get("CI"):
        pytest.importorskip("nbclient")
        pytest.importorskip("anywidget")
    import nbclient
    import nbformat

    made = nbformat.v4.new_notebook()
    made.cells = [nbformat.v4.new_code_cell(text) for text in CELLS]
    made.cells[-1].metadata.tags = ["raises-exception"]
    nbclient.NotebookClient(made, timeout=PATIENCE, kernel_name="python3").execute()
    return made


@pytest.fixture
def mesh():
    return rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])


def shown(cell):
    # While kernels compile, another output says so.
    return [one for one in cell.outputs if "rasterjit:" not in str(one.get("data"))]


def test_notebook_shows_frames_scenes_and_meshes(book, mesh):
    preview = rj.styles.studio(mesh).render(size=SIZE).color
    for number, expected in ((1, rj.render(mesh, size=(8, 6)).color), (2, preview), (3, preview)):
        (output,) = shown(book.cells[number])
        data = output.data["image/png"]
        np.testing.assert_array_equal(pixels(base64.b64decode(data)), expected)
        assert output.data["text/html"].startswith("<img")
    (empty,) = shown(book.cells[4])
    assert empty.data == {"text/plain": repr(rj.Scene())}


def eye_direction(camera):
    ahead = np.subtract(camera.target, camera.eye)
    return ahead / np.linalg.norm(ahead)


def test_viewer_leaves_its_view_its_widget_and_its_camera(book, mesh):
    picture, widget, camera = shown(book.cells[5])
    eye = rj.PerspectiveCamera((0.3, 0.4, 2), (0.3, 0.3, 0), fov_y=30)
    # The second of the pictures that become the reference.
    with rj.Renderer((64, 48)) as renderer:
        better = renderer.refine(mesh, eye, first=(rj.Quality(samples=4),), background="white")
        next(better)
        expected = next(better).color
    np.testing.assert_array_equal(pixels(base64.b64decode(picture.data["image/png"])), expected)
    alt = "View of Scene(1 objects, 1 faces, 0 lights)"
    assert picture.metadata["image/png"] == {"alt": alt, "width": 64, "height": 48}
    (image,) = Images(picture.data["text/html"]).found
    assert {"alt": alt, "width": "64", "height": "48"}.items() <= image.items()
    # Where nothing shows the widget, it says what does.
    assert set(widget.data) == {WIDGET, "text/plain"}
    assert "pip install ipywidgets anywidget" in widget.data["text/plain"]
    assert "environment of the Jupyter server" in widget.data["text/plain"]
    made = eval(camera.data["text/plain"], {"rj": rj})
    assert made.fov_y == eye.fov_y
    np.testing.assert_allclose(made.eye, eye.eye, atol=1e-7)
    # The point it looks at is where the camera turns about, on the same line of sight.
    np.testing.assert_allclose(eye_direction(made), eye_direction(eye), atol=1e-7)
    assert html.escape(camera.data["text/plain"]) in camera.data["text/html"]


def test_missing_packages_leave_a_picture_and_are_named(book):
    picture, text, camera = shown(book.cells[6])
    assert pixels(base64.b64decode(picture.data["image/png"])).shape == (48, 64, 4)
    assert (
        'pip install "rasterjit[notebook]" in the environment of this kernel'
        in (text.data["text/plain"])
    )
    assert camera.data["text/plain"].startswith("rj.PerspectiveCamera(")
    (error,) = shown(book.cells[7])
    assert error.ename == "ImportError"
    assert 'pip install "rasterjit[notebook]"' in error.evalue


def test_exported_notebook_has_the_pictures(book):
    if not os.environ.get("CI"):
        pytest.importorskip("nbconvert")
    import nbconvert

    without_state = copy.deepcopy(book)
    del without_state.metadata["widgets"]
    # JupyterLab saves the state of a widget only if it is told to; nbclient does.
    for saved in (book, without_state):
        page, _ = nbconvert.HTMLExporter().from_notebook_node(saved)
        kinds = [image["alt"].split()[0] for image in Images(page).found]
        assert kinds == ["Picture", "Picture", "Picture", "View", "View"]
        assert page.count("rj.PerspectiveCamera(eye") == 2
