"""
Render the README's pictures: ``python models/make_pictures.py [FOLDER]``.

Needs RasterJIT installed. Writes into ``models/pictures`` unless told otherwise.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rasterjit as rj

MODELS = Path(__file__).parent
PANEL = (400, 300)
"""Width and height of one picture of the strip, pixels."""
SMALL_PANEL = (256, 160)
"""The same of what mistaken cameras show."""


def still_life() -> rj.Scene:
    """Return a teapot, a torus knot, a cube and a pyramid on a floor, with two lights."""
    parts = {
        name: rj.load(MODELS / name).nodes[0].mesh
        for name in ("teapot.obj", "torus_knot.obj", "cube.ply", "pyramid.off")
    }
    parts["teapot.obj"].material = rj.Material(base_color="#3d7ea6", specular=0.6, shininess=90)
    parts["torus_knot.obj"].material = rj.Material(base_color="#d9822b", specular=0.5)
    parts["cube.ply"].material = rj.Material(shading="unlit", base_color="white")
    parts["pyramid.off"].material = rj.Material(shading="flat", base_color="#8aa84a")
    floor = rj.Mesh(
        [(-14, 0, -10), (-14, 0, 10), (14, 0, 10), (14, 0, -10)],
        [(0, 1, 2), (0, 2, 3)],
        material=rj.Material(base_color="#c9c4bb", specular=0.0),
    )
    place = rj.transforms
    scene = rj.Scene()
    scene.add(floor, name="floor")
    scene.add(parts["teapot.obj"], name="teapot")
    scene.add(
        parts["torus_knot.obj"],
        place.compose(place.translate((-4.6, 1.9, -2.2)), place.rotate_y(35), place.scale(0.62)),
        name="knot",
    )
    scene.add(
        parts["cube.ply"],
        place.compose(place.translate((4.6, 1.0, -2.4)), place.rotate_y(28)),
        name="cube",
    )
    scene.add(
        parts["pyramid.off"],
        place.compose(place.translate((2.9, 0.9, 2.9)), place.rotate_y(-30), place.scale(0.9)),
        name="pyramid",
    )
    scene.lights += [
        rj.AmbientLight(intensity=0.12),
        rj.DirectionalLight(direction=(-0.5, -1.0, -0.6), intensity=0.75),
        rj.PointLight(position=(-6, 6, 5), color="#ffd9a8", intensity=22),
    ]
    return scene


def shade_depth(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return depth as grey, near bright, the background black."""
    seen = np.isfinite(depth)
    near, far = depth[seen].min(), depth[seen].max()
    grey = np.where(seen, 1.0 - 0.85 * (depth - near) / (far - near), 0.0)
    return np.repeat((255.0 * grey)[..., None], 3, axis=2).astype(np.uint8)


def color_numbers(numbers: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Return a colour of its own for each face number, the background black."""
    mixed = (numbers.astype(np.int64)[..., None] + 1) * np.array([7919, 104729, 1299709])
    return np.where(numbers[..., None] < 0, 0, 60 + mixed % 196).astype(np.uint8)


def color_coordinates(coordinates: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return 0..1 along three axes as red, green and blue, the background black."""
    return (255.0 * np.nan_to_num(coordinates)).astype(np.uint8)


def color_normals(normals: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return -1..1 along three axes as red, green and blue, the background grey."""
    return np.floor(127.5 * normals + 128.0).astype(np.uint8)


def color_motion(motion: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return motion to the right as red, down as green; grey where none, the background black."""
    seen = np.isfinite(motion).all(axis=2)
    largest = np.abs(motion[seen]).max()
    colors = np.zeros((*seen.shape, 3))
    colors[seen, :2] = 0.5 + 0.5 * motion[seen] / largest
    colors[seen, 2] = 0.5
    return (255.0 * colors).astype(np.uint8)


def strips(scene: rj.Scene, camera: rj.PerspectiveCamera) -> NDArray[np.uint8]:
    """
    Return ground truth side by side.

    Colour, depth, normals and face numbers; below them object numbers, normalized object
    coordinates, motion since the camera stood further to the left, and the normals of the second
    surface of each pixel.
    """
    outputs = "color", "depth", "normal", "face_id", "object_id", "nocs", "motion"
    x, y, z = camera.eye
    before = rj.View(camera=replace(camera, eye=(x - 1.0, y, z)))
    frame = rj.render(scene, camera, size=PANEL, outputs=outputs, previous=before)
    layers = rj.render_layers(scene, camera, k=2, size=PANEL, outputs=("normal",))
    above = [
        frame.color[..., :3],
        shade_depth(frame.depth),
        color_normals(frame.normal),
        color_numbers(frame.face_id),
    ]
    below = [
        color_numbers(frame.object_id),
        color_coordinates(frame.nocs),
        color_motion(frame.motion),
        color_normals(layers.normal[1]),
    ]
    return np.vstack([np.hstack(above), np.hstack(below)])


def mistaken_cameras(camera: rj.PerspectiveCamera) -> dict[str, rj.MatrixCamera]:
    """Return what becomes of a camera by mistakes that nobody can refuse, by what was done."""
    k, turn, shift = rj.cameras.to_opencv(camera, SMALL_PANEL)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, shift
    made = rj.cameras.from_opencv
    return {
        "as it is meant": made(k, SMALL_PANEL, rotation=turn, translation=shift),
        "OpenGL's pose as OpenCV's": made(k, SMALL_PANEL, camera_from_world=camera.view_matrix()),
        "radians for degrees": replace(camera, fov_y=float(np.radians(camera.fov_y))),
        "a transposed rotation": made(k, SMALL_PANEL, rotation=turn.T, translation=shift),
        "the eye as translation": made(k, SMALL_PANEL, rotation=turn, translation=camera.eye),
        "y up where z is": replace(camera, eye=(2.5, -12.5, 6.0), target=(0.2, 0.0, 1.1)),
    }


def mistakes(scene: rj.Scene, camera: rj.PerspectiveCamera) -> NDArray[np.uint8]:
    """Return what the cameras show, three beside each other, and print what explain says."""
    panels = []
    for name, mistaken in mistaken_cameras(camera).items():
        if name == "y up where z is":
            for node in scene.nodes:
                node.world_from_model = rj.transforms.rotate_x(90.0) @ node.world_from_model
        color = rj.render(scene, mistaken, size=SMALL_PANEL).color[1:-1, 1:-1, :3]
        panels.append(np.pad(color, ((1, 1), (1, 1), (0, 0)), constant_values=128))
        said = rj.explain(scene, mistaken, size=SMALL_PANEL).view.rows()
        print(name, *(f"  {row}: {text}" for row, text in said), sep="\n")
    return np.vstack([np.hstack(panels[:3]), np.hstack(panels[3:])])


def make_page(page: Path, folder: Path) -> None:
    """Run the programs of a page for readers; copy what they draw of its pictures."""
    text = page.read_text(encoding="utf-8")
    program = "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "models").symlink_to(MODELS.resolve())
        subprocess.run([sys.executable, "-c", program], cwd=place, check=True)
        for name in sorted(set(re.findall(rf"pictures/{page.stem}/([\w.-]+)", text))):
            for picture in Path(place).rglob(name):
                shutil.copy(picture, folder)


def main(folder: Path) -> None:
    """Write every picture."""
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    camera = rj.PerspectiveCamera(eye=(2.5, 6.0, 12.5), target=(0.2, 1.1, 0.0), fov_y=34.0)
    scene = still_life()
    rj.render(scene, camera, size=(1200, 560)).save(folder / "still_life.png")
    from rasterjit.io.images import save_image

    save_image(folder / "buffers.png", strips(scene, camera))
    save_image(folder / "camera_mistakes.png", mistakes(still_life(), camera))
    teapot = rj.load(MODELS / "teapot.obj")
    rj.render(teapot, size=(640, 480)).save(folder / "teapot.png")
    cube = rj.load(MODELS / "cube.ply")
    cube.wireframe = rj.Wireframe(color="#c03020", mode="only")
    course = rj.PerspectiveCamera(eye=(2, 3, 5), target=(0, 0, 0))
    rj.render(cube, course, size=(320, 320)).save(folder / "wireframe.png")
    guides = MODELS.resolve().parent / "docs" / "guides"
    for page in sorted(guides.glob("*.md")):
        if f"pictures/{page.stem}/" in page.read_text(encoding="utf-8"):
            make_page(page, folder / page.stem)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else MODELS / "pictures")
