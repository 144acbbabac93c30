"""
Run every example, and write the pictures of their pages into docs/pictures/examples.

``python docs/examples/make_pictures.py``, from the folder that holds ``models``.
"""

from __future__ import annotations

import base64
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageOps

HERE = Path(__file__).parent
PICTURES = HERE.parent / "pictures" / "examples"
SMALL = 240, 160
"""Of the pictures of the index, pixels."""
COMMANDS = {
    "bop": "--images 3 --seed 2 --size 320 240",
    "bop_check": "-o bop.png",
    "photo_overlay": "-o overlay.jpg",
    "robot": "-o robot.gif --strip robot.png --size 200 200",
    "flight": "--seconds 8 --fps 2 --size 320 180 --samples 16 --stills flight.jpg",
    "thumbnails": "--side 180 --columns 5",
    "environment": "-o environment.gif --steps 1",
    "simulation": "-o simulation.gif",
    "figure": "-o figure.png --dpi 100",
}
MADE = {
    "bop": "bop.png", "photo_overlay": "overlay.jpg", "robot": "robot.gif", "flight": "flight.jpg",
    "thumbnails": "thumbnails/sheet.png", "environment": "environment.gif", "figure": "figure.png",
    "simulation": "simulation.gif",
}  # fmt: skip
"""What each writes."""
CROPS = {
    "bop": (0, 0, 320, 240), "flight": (320, 0, 640, 180), "thumbnails": (0, 0, 540, 390),
    "simulation": (0, 0, 112, 112), "figure": (290, 20, 570, 230),
    "photo_overlay": (80, 60, 620, 420),
}  # fmt: skip
"""The part of a picture that the index shows: left, top, right, bottom."""


def picture_of_the_notebook(path: Path) -> bytes:
    """Return the PNG that is saved in a notebook."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    datas = [output.get("data", {}) for cell in cells for output in cell.get("outputs", [])]
    return base64.b64decode(next(data["image/png"] for data in datas if "image/png" in data))


def main() -> None:
    """Write all pictures."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "models").symlink_to(Path("models").resolve())
        for name, options in COMMANDS.items():
            command = [sys.executable, str(HERE.resolve() / f"{name}.py"), *options.split()]
            subprocess.run(command, cwd=folder, check=True, env=os.environ)
        (Path(folder) / "classroom.png").write_bytes(
            picture_of_the_notebook(HERE / "classroom.ipynb")
        )
        for name, made in {**MADE, "classroom": "classroom.png"}.items():
            source = Path(folder) / made
            (PICTURES / f"{name}{source.suffix}").write_bytes(source.read_bytes())
            with Image.open(source) as picture:
                picture.seek(getattr(picture, "n_frames", 1) // 3)
                part = picture.convert("RGB").crop(CROPS.get(name, (0, 0, *picture.size)))
            ImageOps.fit(part, SMALL).save(PICTURES / f"{name}_small.jpg", quality=88)
        (PICTURES / "robot.png").write_bytes((Path(folder) / "robot.png").read_bytes())


if __name__ == "__main__":
    main()
