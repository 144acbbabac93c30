"""
Measure what accuracy costs, for the README: ``python models/make_accuracy.py [FOLDER]``.

Studies one scene to which nearly all settings matter, with ``rasterjit[accuracy]`` installed, for
about five minutes. Writes the Pareto front into ``models/pictures/accuracy.png`` and the sentences
into the README, between its marks, or both, as ``accuracy.png`` and ``accuracy.md``, into a folder.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from accuracy_front import save_front

import rasterjit as rj

MODELS = Path(__file__).parent
README = MODELS.parent / "README.md"
BEGIN, END = "<!-- accuracy: models/make_accuracy.py -->\n", "<!-- end of accuracy -->\n"
"""What the sentences stand between in the README."""

SIZE = (640, 480)
SECONDS = 300.0


def make_scene() -> tuple[rj.Scene, rj.PerspectiveCamera]:
    """Return a teapot with a highlight on a tiled floor, in the sun, behind panes of glass."""
    scene = rj.load(MODELS / "teapot.obj")
    scene.nodes[0].mesh.material = rj.Material(base_color="#3d7ea6", specular=0.7, shininess=90)
    tiles = np.full((64, 64, 3), (225, 220, 210), np.uint8)
    tiles[:32, :32] = tiles[32:, 32:] = (90, 100, 120)
    corners, faces = (
        [(-40, 0, 12), (40, 0, 12), (40, 0, -90), (-40, 0, -90)],
        [(0, 1, 2), (0, 2, 3)],
    )
    uv = [(0, 0), (40, 0), (40, 51), (0, 51)]
    material = rj.Material(base_color_texture=rj.Texture(tiles), specular=0.0)
    scene.add(rj.Mesh(corners, faces, uv=uv, material=material), name="floor")
    for number in range(6):
        x, z = -4.2 + 0.5 * number, 2.8 - 0.9 * number
        pane = [(x, 0.1, z), (x + 2, 0.1, z), (x + 2, 3.4, z), (x, 3.4, z)]
        color = (0.9, 0.55 - 0.06 * number, 0.2 + 0.1 * number, 0.35)
        glass = rj.Material("unlit", color, alpha_mode="blend")
        scene.add(rj.Mesh(pane, faces, material=glass), name="pane")
    sun = rj.DirectionalLight((-1, -1.6, -0.9), intensity=0.85, shadow=rj.Shadow(1024))
    scene.lights += [rj.AmbientLight(intensity=0.15), sun]
    camera = rj.PerspectiveCamera(eye=(3.5, 3.2, 9.5), target=(-0.3, 1.3, 0), fov_y=40.0)
    return scene, camera


def main(folder: Path | None) -> None:
    """Measure and write."""
    found = rj.accuracy.study(*make_scene(), size=SIZE, budget=SECONDS, name="a teapot in the sun")
    text = "".join(f"- {sentence}\n" for sentence in rj.accuracy.sentences(found).values())
    if folder is not None:
        save_front(found, folder / "accuracy.png")
        (folder / "accuracy.md").write_text(text)
        return
    save_front(found, MODELS / "pictures" / "accuracy.png")
    before, _, rest = README.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    README.write_text(f"{before}{BEGIN}{text}{END}{after}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
