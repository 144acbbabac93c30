"""What of a blended surface is too faint is not hit, and changes no colour."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene.quality import parse_setting

CORNERS = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
FACES = [(0, 1, 2), (0, 2, 3)]
CAMERA = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=2.0)
HITS = "depth", "object_id", "normal", "position", "coverage"
PANE, LABEL, WALL = 0, 1, 2
"""The objects from front to back."""


def rooms():
    """Return a pane of alpha .3 before a label whose left half has .2, before a wall below it."""
    image = np.full((2, 2, 4), 255, np.uint8)
    image[:, 0, 3] = 51
    label = rj.Texture(image, filter="nearest")
    scene = rj.Scene()
    for depth, options in (
        (1, {"base_color": (0, 0, 1, 0.3), "alpha_mode": "blend"}),
        (0, {"base_color_texture": label, "alpha_mode": "blend"}),
        (-1, {"base_color": "green"}),
    ):
        mesh = rj.Mesh(
            CORNERS, FACES, uv=CORNERS[:, :2] / 2 + 0.5, material=rj.Material("unlit", **options)
        )
        down = -1.0 if depth == -1 else 0.0
        scene.add(mesh, rj.transforms.translate((0, down, depth)))
    return scene


def drawn(least, outputs=("color", *HITS), **options):
    quality = rj.Quality(visible_alpha=least, **options)
    return rj.render(rooms(), CAMERA, size=(8, 8), outputs=outputs, quality=quality, threads=1)


@pytest.mark.parametrize("samples", [1, 4, 64])
def test_what_is_fainter_is_not_hit_and_colours_stay(samples):
    # Quarters: left and right of the label, above the wall and before it.
    for least, found in (
        (0.0, (PANE, PANE, PANE, PANE)), (0.3, (PANE, PANE, PANE, PANE)),
        (0.31, (-1, LABEL, WALL, LABEL)), (1.0, (-1, LABEL, WALL, LABEL)),
    ):  # fmt: skip
        frame, plain = drawn(least, samples=samples), drawn(0.0, samples=samples)
        quarters = [frame.object_id[row, column] for row in (1, 6) for column in (1, 6)]
        assert quarters == list(found)
        assert frame.color.tobytes() == plain.color.tobytes()
        depths = {PANE: 4.0, LABEL: 5.0, WALL: 6.0, -1: np.inf}
        assert (frame.depth == np.vectorize(depths.get)(frame.object_id)).all()
        assert (np.isnan(frame.position[..., 0]) == (frame.object_id < 0)).all()
        assert (frame.coverage[1, 1] > 0) == (found[0] >= 0)


def test_an_alpha_at_the_threshold_is_hit_and_outputs_without_colour_are_the_same():
    for least in (0.0, 0.2, 0.5):
        frame, alone = drawn(least), drawn(least, HITS)
        for name in HITS:
            assert getattr(frame, name).tobytes() == getattr(alone, name).tobytes()


FAINT = {"material": rj.Material("unlit", (0, 0, 1, 0.2), alpha_mode="blend")}
PALE = {"material": rj.Material("unlit", "blue", alpha_mode="blend"),
        "colors": np.full((4, 4), (0, 0, 1, 0.2))}  # fmt: skip
SHOWN = {
    "mesh": lambda **look: rj.Mesh(CORNERS, FACES, **look),
    "lines": lambda **look: rj.Lines(CORNERS / 2, [(0, 1), (1, 2)], width=6, **look),
    "points": lambda **look: rj.Points(CORNERS / 2, size=1.5, unit="world", **look),
    "points of pixels": lambda **look: rj.Points(CORNERS / 2, size=7, **look),
    "points of sizes": lambda **look: rj.Points(CORNERS / 2, size=[3, 5, 7, 9], **look),
}
"""What shows a surface, by how it looks."""


@pytest.mark.parametrize("kind", SHOWN)
@pytest.mark.parametrize("look", [FAINT, PALE], ids=["material", "colors"])
@pytest.mark.parametrize("least", [0.0, 0.5])
def test_whatever_is_too_faint_is_not_hit_whatever_is_asked_for(kind, look, least):
    scene = rj.Scene()
    scene.add(SHOWN[kind](**look))
    scene.add(rj.Points([(0, 0, -1)], size=3, shape="disc", material=rj.Material("unlit", "red")))
    scene.add(rj.Mesh(CORNERS - (0, 0, 2), FACES, material=rj.Material("unlit", "green")))
    hits = [one for one in HITS if one != "normal"]
    options = {"size": (16, 16), "quality": rj.Quality(visible_alpha=least)}
    with_color = rj.render(scene, CAMERA, outputs=("color", *hits), **options)
    assert (0 in with_color.object_id) == (least == 0.0)
    alone = rj.render(scene, CAMERA, outputs=hits, **options)
    one_by_one = {name: rj.render(scene, CAMERA, outputs=(name,), **options) for name in hits}
    for name in hits:
        wanted = getattr(with_color, name).tobytes()
        assert getattr(alone, name).tobytes() == wanted
        assert getattr(one_by_one[name], name).tobytes() == wanted
    # Layers have no discs.
    scene.nodes.pop(1)
    nearest = rj.render(scene, CAMERA, outputs=("object_id",), **options).object_id
    layers = rj.render_layers(scene, CAMERA, k=2, **options).object_id
    assert layers[0].tobytes() == nearest.tobytes()


def test_batches_pixels_and_layers_hit_the_same():
    scene, quality = rooms(), rj.Quality(visible_alpha=0.5)
    frame = drawn(0.5)
    batch = rj.render_batch(
        scene, [CAMERA] * 2, size=(8, 8), outputs=("color", "depth", "object_id"), quality=quality
    )
    for name in ("color", "depth", "object_id"):
        assert np.asarray(getattr(batch, name))[1].tobytes() == getattr(frame, name).tobytes()
    pixel = rj.explain_pixel(scene, CAMERA, (8, 8), 6, 6, quality=quality)
    assert pixel.winner.face in (2, 3)
    assert "quality.visible_alpha is 0.5" in str(rj.explain(scene, CAMERA, quality))
    layers = rj.render_layers(scene, CAMERA, k=2, size=(8, 8), quality=quality).object_id
    assert layers[0].tobytes() == frame.object_id.tobytes()
    assert (layers[1, 6, 6], layers[1, 1, 6]) == (WALL, -1)


def test_the_default_plans_no_alpha_test():
    assert not drawn(0.0).plan.facts.tests_alpha
    assert drawn(0.1).plan.facts.tests_alpha


def test_thresholds_are_shares():
    assert parse_setting("visible_alpha=0.25") == {"visible_alpha": 0.25}
    for value in (-0.1, 1.5, np.nan, "half"):
        with pytest.raises(ValueError, match="visible_alpha must be"):
            rj.Quality(visible_alpha=value)
    with pytest.raises(ValueError, match=r"visible_alpha must be .* got '2'"):
        parse_setting("visible_alpha=2")
