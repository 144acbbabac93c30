"""Colours are written over the faces of a picture, where nothing looks at these again."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.rendering.planning import FrameRequest, plan_frame

SIZE = 300, 240
"""Large enough for several bands of rows."""
CAMERA = rj.PerspectiveCamera((0.0, 1.0, 6.0), (0.0, 0.2, 0.0))


@pytest.fixture
def scene(cube, sphere):
    """Faces with gaps between them in most rows: long spans, and small ones."""
    scene = rj.Scene()
    colors = np.linspace(0.0, 1.0, 3 * len(sphere.vertices)).reshape(-1, 3)
    ball = rj.Mesh(sphere.vertices, sphere.faces, colors=colors, material=rj.Material("unlit"))
    for x in (-2.0, 0.0, 2.0):
        scene.add(ball, rj.transforms.translate((x, 0.3 * x, 0.0)))
    box = rj.Mesh(cube.vertices, cube.faces, material=rj.Material("unlit", "orange"))
    scene.add(box, rj.transforms.translate((1.0, -1.0, 1.0)))
    holed = rj.Mesh(cube.vertices, cube.faces, colors=np.linspace(0, 1, 32).reshape(8, 4))
    holed.material = rj.Material("unlit", alpha_mode="mask")
    scene.add(holed, rj.transforms.translate((-1.0, -1.2, 1.0)))
    return scene


def lit(scene):
    scene.nodes[3].mesh.material = rj.Material("phong", "orange")
    scene.lights = [rj.DirectionalLight((-1, -2, -1), shadow=rj.Shadow(64))]


def cut(scene):
    scene.section = rj.SectionPlane((0.2, 0.0, 0.0), (1.0, 0.1, 0.0))


def with_points(scene):
    scene.add(rj.Points(np.random.default_rng(5).uniform(-1.5, 1.5, (300, 3))))


def outlined(scene):
    scene.outline = rj.Outline()


def foggy(scene):
    scene.fog = rj.Fog(density=0.1)


@pytest.mark.parametrize("background", ["transparent", "white", (0.0, 0.3, 0.1, 0.4)])
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("change", [None, lit, cut, with_points, outlined, foggy])
def test_the_same_bits_and_counts_as_where_faces_are_kept(scene, change, threads, background):
    if change is not None:
        change(scene)
    with rj.Renderer(SIZE, threads=threads) as renderer:
        for _ in range(3):
            options = {"background": background}
            alone = renderer.render(scene, CAMERA, outputs=("color",), **options)
            both = renderer.render(scene, CAMERA, outputs=("color", "face_id"), **options)
            assert alone.color.tobytes() == both.color.tobytes()
            assert alone.stats.pixels_covered == np.count_nonzero(both.face_id >= 0) > 1000


@pytest.mark.parametrize(
    ("outputs", "change", "is_kept"),
    [
        (("color",), None, False), (("color",), foggy, False), (("color",), lit, False),
        (("color",), outlined, True), (("color", "depth"), None, True), (("linear",), None, True),
    ],
)  # fmt: skip
def test_faces_are_kept_where_something_looks_at_them_later(scene, outputs, change, is_kept):
    if change is not None:
        change(scene)
    quality = rj.Quality.standard()
    planned = plan_frame(FrameRequest(SIZE, quality, outputs), scene, CAMERA)
    assert planned.plan.keeps_faces == is_kept


def test_what_is_seen_is_counted_after_the_next_frame(scene):
    with rj.Renderer(SIZE, threads=1) as renderer:
        first = renderer.render(scene, CAMERA)
        color = first.color.copy()
        renderer.render(scene, rj.PerspectiveCamera((0.0, 0.0, 30.0), (0.0, 0.0, 0.0)))
        assert first.color.tobytes() == color.tobytes()
        assert (
            first.stats.pixels_covered == rj.render(scene, CAMERA, size=SIZE).stats.pixels_covered
        )
