"""
Measure what accuracy costs: ``python models/make_accuracy.py [FOLDER]``.

Studies one scene to which nearly all settings matter, with ``rasterjit[accuracy]`` installed, for
about five minutes; then ``interpolation_precision`` alone, for a minute, in four scenes of one
kind of colour each, for which the precision is chosen one by one. Writes the Pareto front into
``models/pictures/accuracy.png`` and the sentences into ``docs/guides/accuracy.md``, between its
marks, or both, as ``accuracy.png`` and ``accuracy.md``, into a folder.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from accuracy_front import save_front

import rasterjit as rj

MODELS = Path(__file__).parent
PAGE = MODELS.parent / "docs" / "guides" / "accuracy.md"
BEGIN, END = "<!-- accuracy: models/make_accuracy.py -->\n", "<!-- end of accuracy -->\n"
"""What the sentences stand between in the page."""

SIZE = (640, 480)
SECONDS, PRECISION_SECONDS = 300.0, 15.0
PRECISION = "interpolation_precision"


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


def precision_scenes() -> dict[str, rj.Scene]:
    """Return a knot in each kind of colour whose precision is chosen, by what to call it."""
    knot = rj.load(MODELS / "torus_knot.obj").nodes[0].mesh
    shares = (knot.vertices - knot.vertices.min(axis=0)) / np.ptp(knot.vertices, axis=0)
    tiles = np.full((64, 64, 3), (225, 220, 210), np.uint8)
    tiles[:32, :32] = tiles[32:, 32:] = (90, 100, 120)
    picture = rj.Texture(tiles, filter="bilinear")
    looks = {
        "unlit colours of vertices": (rj.Material("unlit"), {"colors": shares}),
        "lit, Phong": (rj.Material("phong", "#3d7ea6", specular=0.0), {}),
        "unlit, a bilinear texture": (
            rj.Material("unlit", base_color_texture=picture), {"uv": 4.0 * shares[:, :2]},
        ),
    }  # fmt: skip
    scenes = {}
    for name, (material, more) in looks.items():
        scenes[name] = rj.Scene()
        mesh = rj.Mesh(knot.vertices, knot.faces, material=material, **more)
        scenes[name].add(mesh, name="knot")
    return scenes


def precision_sentence(name: str, scene: rj.Scene, size: tuple[int, int], seconds: float) -> str:
    """Return what ``interpolation_precision`` costs in a scene, and how far it moves the colour."""
    camera = rj.fit_camera(scene, rj.orbit_direction(30.0, 20.0), aspect=size[0] / size[1])
    found = rj.accuracy.study(
        scene, camera, size=size, budget=seconds, knobs=(PRECISION,), name=name
    )
    text = rj.accuracy.sentences(found).get(PRECISION, "There was no time to measure it.")
    sentence = f"{name[0].upper()}{name[1:]}: {text[0].lower()}{text[1:]}"
    if PRECISION in found.without_effect:
        return sentence
    usual, exact = (
        rj.render(
            scene, camera, size=size, quality=rj.Quality(interpolation_precision=level),
            outputs=("color", "linear"),
        )
        for level in ("adaptive", "float64")
    )  # fmt: skip
    codes = np.abs(usual.color.astype(np.int16) - exact.color)[:, :, :3]
    light = np.abs(usual.linear - exact.linear)[:, :, :3].max()
    moved = (
        f"{np.count_nonzero(codes):,} of {codes.size:,} codes move, by {codes.max()} at most"
        if codes.any()
        else "no code moves"
    )
    return f"{sentence} From one to the other {moved}, and linear light by {light:.1g}."


def main(folder: Path | None) -> None:
    """Measure and write."""
    found = rj.accuracy.study(*make_scene(), size=SIZE, budget=SECONDS, name="a teapot in the sun")
    said = [
        *rj.accuracy.sentences(found).values(),
        *(
            precision_sentence(name, scene, SIZE, PRECISION_SECONDS)
            for name, scene in precision_scenes().items()
        ),
    ]
    text = "".join(f"- {sentence}\n" for sentence in said)
    if folder is not None:
        save_front(found, folder / "accuracy.png")
        (folder / "accuracy.md").write_text(text)
        return
    save_front(found, MODELS / "pictures" / "accuracy.png")
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}{text}{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
