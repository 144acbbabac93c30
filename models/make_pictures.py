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
from gallery_parts import PLACE, ball, box, checks, dressed, model
from numpy.typing import NDArray
from PIL import Image
from surfaces import grid_faces

import rasterjit as rj

MODELS = Path(__file__).parent
PANEL = (400, 300)
"""Width and height of one picture of the strip, pixels."""
STRIPS = (
    "colour", "depth", "normals", "face IDs", "object IDs", "normalized object coordinates",
    "motion", "normals of the second surface",
)  # fmt: skip
"""What the pictures of the strip show."""
SMALL_PANEL = (256, 160)
"""The same of what mistaken cameras show."""


def four_shapes() -> rj.Scene:
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


def backdrop() -> rj.Mesh:
    """Return a floor that bends up into a wall far behind, smooth as in a photographer's studio."""
    bend = np.linspace(0.0, np.pi / 2.0, 40)
    outline = np.vstack(
        [(0.0, 40.0), np.column_stack([8 - 8 * np.cos(bend), -8 - 8 * np.sin(bend)]), (60.0, -16.0)]
    )
    points = [(x, y, z) for y, z in outline for x in (-80.0, 80.0)]
    look = rj.Material("pbr", "#76828b", roughness=0.9)
    return rj.Mesh(points, grid_faces(len(outline), 2), material=look)


def window_light() -> rj.Environment:
    """Return a bright room with a window, a strip light and a warm lamp, as a panorama."""
    up = np.cos(np.pi * (np.mgrid[0:128, 0:256][0] + 0.5) / 128)
    image = np.empty((128, 256, 3), np.float32)
    image[:] = (0.30, 0.31, 0.33) + np.clip(up, 0, 1)[..., None] * np.array([0.35, 0.38, 0.42])
    image[up < 0.0] = (0.55, 0.57, 0.60)
    image[30:62, 28:58] = (9.0, 9.6, 10.5)
    image[45:47, 28:58] = image[30:62, 42:44] = 0.3
    image[22:34, 120:196] = (7.0, 6.6, 6.2)
    image[44:60, 216:230] = (14.0, 8.5, 4.0)
    return rj.Environment(image, rotation=-60.0, intensity=0.7, background=False)


def still_life() -> tuple[rj.Scene, rj.PerspectiveCamera]:
    """Return a glazed teapot among gold, glass, lacquer, chalk and wood, in soft light."""
    scene, globe = rj.Scene(), ball(96, 144)
    board = rj.Texture(checks(5, 320, 70, 225), filter="trilinear", anisotropy=8)
    glass = rj.Material(
        "pbr", "white", roughness=0.0, transmission=1.0, thickness=1.9, ior=1.5,
        attenuation_distance=3.0, attenuation_color="#bfe6dc",
    )  # fmt: skip
    varnish = {"clearcoat": 1.0, "clearcoat_roughness": 0.03}
    scene.add(backdrop(), name="backdrop")
    for name, shape, look, turn, size, place in (
        ("teapot", model("teapot.obj"),
         rj.Material("pbr", "#123f63", roughness=0.35, **varnish), -20, 1.0, (0, 0, 0)),
        ("knot", model("torus_knot.obj"),
         rj.Material("pbr", "#e3a857", metallic=1.0, roughness=0.18), 25, 0.62, (-4.9, 1.93, -2)),
        ("glass", globe, glass, 0, 0.95, (3.15, 0.95, 2.1)),
        ("lacquer", globe,
         rj.Material("pbr", "#b3271e", roughness=0.5, clearcoat=0.6, clearcoat_roughness=0.1),
         0, 0.5, (-2.6, 0.5, 2.9)),
        ("chalk", globe, rj.Material("pbr", "#e9e4da", roughness=0.95), 0, 0.36, (-3.6, 0.36, 3.6)),
        ("cube", box(2.3, 2.3, 2.3),
         rj.Material("pbr", "#e9b48c", base_color_texture=board, roughness=0.3), 32, 1.0,
         (5.3, 0, -1.6)),
    ):  # fmt: skip
        where = PLACE.compose(PLACE.translate(place), PLACE.rotate_y(turn), PLACE.scale(size))
        scene.add(dressed(shape, look), where, name=name)
    scene.environment = window_light()
    soft = rj.Shadow(size=2048, filter="soft", light_size=9.0)
    scene.lights.append(
        rj.DirectionalLight((0.75, -1.0, -0.75), intensity=2.6, color="#fff1df", shadow=soft)
    )
    scene.tone_map = rj.ToneMap("neutral")
    return scene, rj.PerspectiveCamera(eye=(0.6, 4.6, 14.5), target=(0.25, 1.25, 0.0), fov_y=26.0)


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


def strips(scene: rj.Scene, camera: rj.PerspectiveCamera) -> Image.Image:
    """
    Return ground truth side by side.

    Colour, depth, normals and face numbers; below them object numbers, normalized object
    coordinates, motion since the camera stood further to the left, and the normals of the second
    surface of each pixel.
    """
    outputs = "color", "depth", "normal", "face_id", "object_id", "nocs", "motion"
    x, y, z = camera.eye
    before = rj.PreviousView(camera=replace(camera, eye=(x - 1.0, y, z)))
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
    return rj.grid([*above, *below], columns=4, gap=4, labels=STRIPS)


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
    scene = four_shapes()
    smooth = rj.Quality(samples=16)
    rj.render(*still_life(), size=(1200, 560), quality=smooth).save(folder / "still_life.png")
    strips(scene, camera).save(folder / "buffers.png")
    from rasterjit.io.images import save_image

    save_image(folder / "camera_mistakes.png", mistakes(four_shapes(), camera))
    teapot = rj.load(MODELS / "teapot.obj")
    rj.render(teapot, size=(640, 480)).save(folder / "teapot.png")
    cube = rj.load(MODELS / "cube.ply")
    cube.wireframe = rj.Wireframe(color="#c03020", mode="only")
    course = rj.PerspectiveCamera(eye=(2, 3, 5), target=(0, 0, 0))
    rj.render(cube, course, size=(320, 320)).save(folder / "wireframe.png")
    root = MODELS.resolve().parent
    for page in (root / "README.md", *sorted((root / "docs" / "guides").glob("*.md"))):
        if f"pictures/{page.stem}/" in page.read_text(encoding="utf-8"):
            make_page(page, folder / page.stem)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else MODELS / "pictures")
