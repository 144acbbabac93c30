"""Frames from draft to reference: each is whole, the last is the reference, none is done twice."""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace

import numpy as np
import pytest
from test_supersampling import CAMERAS, GROUND, ROOF, SUN, averaged, rich_scene, scene_of

import rasterjit as rj
from rasterjit.effects.shadows import maps as shadow_maps
from rasterjit.rendering import frame_shading as shade_passes
from rasterjit.rendering import renderer as rendering

SIZE = (20, 14)
CAMERA = CAMERAS["perspective"]
OUTPUTS = ("color", "linear", "depth", "face_id", "position")
STEPS = [1, 1, 4, 16, 64, 256]


FEW = 4
"""Steps of up to 16 of 256 pictures: enough where only ways to them are compared."""


def refined(scene, camera=CAMERA, size=SIZE, threads=None, steps=None, **options):
    with rj.Renderer(size, threads=threads) as renderer:
        return list(itertools.islice(renderer.refine(scene, camera, **options), steps))


def assert_same_bits(frame, other):
    assert frame.arrays().keys() == other.arrays().keys()
    for name, array in frame.arrays().items():
        assert array.tobytes() == other.arrays()[name].tobytes(), name


@functools.cache
def whole():
    """Return all steps of the rich scene; no test writes to them."""
    return refined(rich_scene(), outputs=OUTPUTS)


def test_steps_go_from_draft_to_reference():
    scene, frames = rich_scene(), whole()
    draft, standard, reference = rj.Quality.draft(), rj.Quality.standard(), rj.Quality.reference()
    assert [frame.plan.quality for frame in frames] == [draft, standard, *[reference] * 4]
    assert [frame.plan.pictures for frame in frames] == STEPS
    for frame, quality in zip((frames[0], frames[1], frames[-1]), (draft, standard, reference),
                              strict=True):  # fmt: skip
        assert_same_bits(frame, rj.render(scene, CAMERA, size=SIZE, quality=quality,
                                          outputs=OUTPUTS))  # fmt: skip
    assert "16 of 256" in str(frames[3].plan)
    assert all(frame.stats.seconds["average"] > 0.0 for frame in frames[2:])


def test_every_step_is_the_mean_of_the_pictures_so_far():
    scene, frames = rich_scene(), whole()
    quality = replace(rj.Quality.reference(), samples=1)
    for frame in frames[2:4]:
        expected = averaged(scene, CAMERA, SIZE, 256, frame.plan.pictures, quality=quality)
        assert frame.linear.tobytes() == expected.astype(np.float32).tobytes()


def test_error_falls_from_step_to_step():
    frames = whole()
    last = frames[-1].linear.astype(float)
    errors = [float(np.sqrt(((frame.linear - last) ** 2).mean())) for frame in frames[1:-1]]
    assert all(after < before / 1.5 for before, after in itertools.pairwise(errors))
    assert errors[-1] < errors[0] / 10.0


def test_no_picture_and_no_shadow_map_is_drawn_twice(monkeypatch):
    pictures, maps = [], []
    shade, draw = shade_passes.shade_faces, shadow_maps.draw_shadows

    def watch(context, *kept):
        pictures.append(getattr(context.plan.camera, "offset", None))
        return shade(context, *kept)

    def watch_maps(*arguments):
        maps.append(arguments)
        return draw(*arguments)

    monkeypatch.setattr(shade_passes, "shade_faces", watch)
    monkeypatch.setattr(shadow_maps, "draw_shadows", watch_maps)
    counts = []
    with rj.Renderer(SIZE) as renderer:
        for _ in renderer.refine(scene_of(GROUND, ROOF, lights=[SUN]), CAMERA):
            counts.append((len(pictures), len(maps)))
    assert counts == [(1, 1), (2, 2), (6, 3), (18, 4), (66, 5), (258, 6)]
    assert len(set(pictures[2:])) == 256


def test_frames_are_their_owners():
    """Nobody writes to a frame that was handed out, and what its owner writes is seen by nobody."""
    with rj.Renderer(SIZE) as renderer:
        frames = renderer.refine(rich_scene(), CAMERA, outputs=OUTPUTS)
        for same, frame in zip(whole()[:FEW], frames, strict=False):
            assert_same_bits(frame, same)
            for array in frame.arrays().values():
                array.fill(7)


@pytest.mark.parametrize("taken", range(6))
def test_renderer_goes_on_when_steps_are_left_out(taken):
    scene, other = rich_scene(), scene_of(GROUND, ROOF, lights=[SUN])
    with rj.Renderer(SIZE, threads=2) as renderer:
        steps = renderer.refine(scene, CAMERA)
        for _ in range(taken):
            next(steps)
        steps.close()
        frame = renderer.render(other, CAMERA)
        with pytest.raises(StopIteration):
            next(steps)
    assert_same_bits(frame, rj.render(other, CAMERA, size=SIZE))


def test_other_frames_may_be_rendered_in_between():
    scene, other = rich_scene(), scene_of(GROUND, ROOF, lights=[SUN])
    with rj.Renderer(SIZE) as renderer:
        both = zip(
            renderer.refine(scene, CAMERA), renderer.refine(other, CAMERA, cull="back"),
            strict=True,
        )  # fmt: skip
        for frames in itertools.islice(both, FEW):
            renderer.render(other, CAMERAS["parallel"])
            renderer.close()
            one, two = frames
    assert one.color.tobytes() == whole()[FEW - 1].color.tobytes()
    assert_same_bits(two, refined(other, steps=FEW, cull="back")[-1])


def test_arguments_are_those_of_render():
    scene = rich_scene()
    options = {"background": (0.1, 0.2, 0.3, 0.5), "cull": "back", "diagnose": True}
    frames = refined(scene, CAMERAS["parallel"], outputs=OUTPUTS, **options)
    last = rj.render(scene, CAMERAS["parallel"], size=SIZE, quality=rj.Quality.reference(),
                     outputs=OUTPUTS, **options)  # fmt: skip
    assert_same_bits(frames[-1], last)
    assert all(frame.diagnostics.samples > 0 for frame in frames)
    # A mesh alone, and a camera that fits it.
    mesh = scene.nodes[0].mesh
    _, standard = refined(mesh, None, steps=2)
    assert_same_bits(standard, rj.render(mesh, size=SIZE))


def test_what_has_no_colour_takes_three_steps():
    frames = refined(rich_scene(), outputs=("depth",))
    assert [frame.plan.pictures for frame in frames] == [1, 1, 1]
    assert frames[-1].plan.quality == rj.Quality.reference()


def test_steps_of_any_number_of_threads_have_the_same_bits():
    scene, size = scene_of(GROUND, ROOF, lights=[SUN]), (70, 66)
    for one, two in zip(
        refined(scene, size=size, threads=1, steps=FEW),
        refined(scene, size=size, threads=3, steps=FEW),
        strict=True,
    ):
        assert_same_bits(one, two)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"outputs": ("beauty",)}, "outputs has 'beauty'"), ({"cull": "left"}, "cull must be"),
     ({"background": "no colour"}, "background"), ({"camera": "here"}, "camera must be"),
     ({"diagnose": 3}, "diagnose must be")],
)  # fmt: skip
def test_wrong_arguments_are_errors_before_the_first_step(options, message, monkeypatch):
    monkeypatch.setattr(rendering, "find_visible", None)
    with rj.Renderer(SIZE) as renderer:
        with pytest.raises(ValueError, match=message):
            renderer.refine(rich_scene(), **{"camera": CAMERA, **options})
        with pytest.raises(ValueError, match="at least one mesh"):
            renderer.refine(rj.Scene())
