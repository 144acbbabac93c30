"""
Take the pictures of the viewer's page: ``python docs/make_screenshots.py [FOLDER]``.

Needs RasterJIT with the extra ``test``, and Chromium. Writes into ``models/pictures/viewer`` unless
told otherwise.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

import chromium  # noqa: E402
from viewing import click, picture_of_window, press, viewing, wait_until  # noqa: E402

WIDTH, HEIGHT = 900, 560
"""Of the window, CSS pixels."""

PICK_OUTPUTS = (300, 300)
"""Where the pointer clicks on the teapot."""

MAX_COLORS = 256
"""Of the files, so that they stay small."""


def main(folder: Path) -> None:
    """Write ``page.png``: the page with what a click says."""
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    view = (
        "-m", "rasterjit", "view", str(ROOT / "models" / "teapot.obj"), "--quiet", "--shadows",
        "--backend", "browser", "--port", "0", "--color", "#3d7ea6", "--zoom", "0.75",
    )  # fmt: skip
    with (
        tempfile.TemporaryDirectory() as profile,
        chromium.chromium(chromium.program(), profile) as page,
        viewing(*view) as (_, address),
    ):
        page.call(
            "Emulation.setDeviceMetricsOverride",
            width=WIDTH, height=HEIGHT, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        page.call("Page.navigate", url=address)
        wait_until(page, "document.readyState === 'complete'")
        wait_until(page, f"picture.dataset.kind === 'png' && picture.width === {WIDTH}")
        wait_until(page, "picture.dataset.done === 'true'")
        press(page, "i")  # Hides the line below, whose time is this machine's.
        click(page, *PICK_OUTPUTS)
        time.sleep(2.0)
        picture_of_window(page, folder / "page.png")
    with Image.open(folder / "page.png") as image:
        image.convert("RGB").quantize(MAX_COLORS).save(folder / "page.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "models" / "pictures" / "viewer")
