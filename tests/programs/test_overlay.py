"""A program of twenty lines: an overlay on a photograph, its error in pixels."""

import numpy as np
from PIL import Image

import rasterjit as rj

SIZE = (320, 240)
K = np.array([[300.0, 0.0, 155.3], [0.0, 305.0, 121.8], [0.0, 0.0, 1.0]])
MARKS = np.array([(-0.8, -0.5, 0.1), (0.9, -0.4, -0.3), (0.1, 0.7, 0.5), (-0.6, 0.4, -0.6)])
RADIUS = 0.08


def pose():
    """OpenCV's camera from world: y down, z forward, turned about all axes."""
    back = rj.transforms.look_at((1.0, 1.3, 4.0), (0.1, 0.0, 0.0), (0.1, 1.0, 0.0))
    return np.diag([1.0, -1.0, -1.0, 1.0]) @ back


def projected():
    """Where OpenCV's formula puts the marks: column and row, the first pixel's centre at 0, 0."""
    x, y, z = K @ (pose()[:3, :3] @ MARKS.T + pose()[:3, 3:])
    return np.stack([x / z, y / z], axis=1)


def take_photograph(path):
    """Write a picture of noise, darker around the marks."""
    noise = np.random.default_rng(1).integers(90, 200, (SIZE[1], SIZE[0], 3))
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    for x, y in projected():
        noise[np.hypot(columns - x, rows - y) < 12.0] //= 2
    Image.fromarray(noise.astype(np.uint8)).save(path)


def test_an_overlay_lies_where_the_photograph_shows_the_marks(tmp_path):
    take_photograph(tmp_path / "photo.png")
    # The program.
    camera = rj.cameras.from_opencv(K, SIZE, camera_from_world=pose())
    side = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]  # fmt: skip
    scene = rj.Scene()
    lime = rj.Material("unlit", (0.0, 1.0, 0.0, 0.5), alpha_mode="blend", double_sided=False)
    for mark in MARKS:
        place = rj.transforms.translate(mark)
        scene.add(rj.Mesh(RADIUS / 2 * side, faces, material=lime), place)
    frame = rj.render(
        scene, camera, size=SIZE, quality=rj.Quality(samples=16), cull="back",
        background=tmp_path / "photo.png", outputs=("color", "linear", "coverage", "object_id"),
    )  # fmt: skip
    frame.save(tmp_path / "overlay.jpg")
    # Each mark is found where OpenCV's formula puts it.
    photo = np.array(Image.open(tmp_path / "photo.png"))
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    for number, (x, y) in enumerate(projected()):
        is_near = np.hypot(columns - x, rows - y) < 12.0
        weights = frame.coverage * is_near
        assert set(np.unique(frame.object_id[is_near])) == {-1, number}
        found = np.array([(columns * weights).sum(), (rows * weights).sum()]) / weights.sum()
        assert np.abs(found - (x, y)).max() < 0.15, (number, found - (x, y))
    # What no face covers is the photograph; what one covers is half of it, half lime, in light.
    light = np.where(photo <= 10, photo / 255 / 12.92, ((photo / 255 + 0.055) / 1.055) ** 2.4)
    share = 0.5 * frame.coverage[..., None]
    mixed = share * (0.0, 1.0, 0.0) + (1.0 - share) * light
    assert np.abs(frame.linear[..., :3] - mixed).max() < 1e-5
    is_open = frame.coverage == 0.0
    assert 0.9 < is_open.mean() < 1.0
    assert np.array_equal(frame.color[is_open][:, :3], photo[is_open])
    assert (frame.color[..., 3] == 255).all()
