"""The dial: the best quality that a time allows, or the fastest one for an error."""

from __future__ import annotations

import time
import types
import warnings

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.rendering import budget as dial
from rasterjit.rendering.budget import (
    LADDER,
    Profile,
    Step,
    Times,
    draw_in_time,
    draw_within_error,
    light_of,
    root_mean_square,
)
from rasterjit.rendering.clock import StageClock
from rasterjit.runtime.jit import COMPILE_CLOCK

SIZE = (96, 72)


class Painter:
    """
    Draws frames that take what a table says, times what the machine is busy with.

    The first of a quality compiles.
    """

    def __init__(self, seconds):
        self.seconds, self.load, self.drawn = dict(zip(LADDER, seconds, strict=True)), 1.0, []

    def __call__(self, quality):
        compile_seconds = 0.0 if quality in self.drawn else 9.0
        self.drawn.append(quality)
        stages = {"compile": compile_seconds, "shade": 0.75 * self.load * self.seconds[quality]}
        stages["visibility"] = 0.25 * self.load * self.seconds[quality]
        return types.SimpleNamespace(stats=types.SimpleNamespace(seconds=stages), choice=None)


MILLISECONDS = [1e-3 * time for time in (2, 4, 7, 11, 25, 40, 50, 300, 1200)]


@pytest.fixture(autouse=True)
def without_profile(tmp_path, monkeypatch):
    monkeypatch.setattr(dial, "cache_folder", lambda: tmp_path)
    dial._TIMES.clear()


@pytest.mark.parametrize(("budget", "step"), [(1e-4, 0), (3e-3, 0), (5e-3, 1), (0.02, 3), (9, 8)])
def test_the_best_quality_that_fits_is_drawn(budget, step):
    paint = Painter(MILLISECONDS)
    frame = draw_in_time(budget, Times(LADDER, {}), paint)
    assert frame.choice.quality == LADDER[step] == paint.drawn[-1]
    assert frame.choice.predicted_seconds == pytest.approx(MILLISECONDS[step])
    assert frame.choice.seconds == pytest.approx(MILLISECONDS[step])


def test_calibrating_stops_at_what_takes_too_long():
    paint = Painter(MILLISECONDS)
    draw_in_time(0.008, Times(LADDER, {}), paint)
    assert set(paint.drawn) == set(LADDER[:5])


def test_where_no_quality_fits_the_fastest_is_drawn_whichever_it_is():
    """Vertices may be more than pixels: then lighting them takes longer."""
    paint = Painter([1e-3 * time for time in (9, 4, 7, 11, 25, 40, 50, 300, 1200)])
    assert draw_in_time(1e-3, Times(LADDER, {}), paint).choice.quality == LADDER[1]
    assert set(paint.drawn) == set(LADDER[:2])


def test_one_frame_that_is_disturbed_is_forgotten():
    paint = Painter(MILLISECONDS)
    ratios = {quality: time / MILLISECONDS[1] for quality, time in paint.seconds.items()}
    times = Times(LADDER, ratios)
    assert draw_in_time(0.005, times, paint).choice.quality == LADDER[1]
    paint(LADDER[6])
    paint.load = 4.0
    # The first frame of this quality that is learned from.
    assert draw_in_time(0.06, times, paint).choice.quality == LADDER[6]
    paint.load = 1.0
    frames = [draw_in_time(0.06, times, paint) for _ in range(12)]
    assert frames[-1].choice.quality == LADDER[6]
    assert frames[-1].choice.predicted_seconds == pytest.approx(MILLISECONDS[6], rel=0.1)


def test_what_a_scene_takes_longer_for_than_others_is_learned():
    """Of one quality the profile's ratio is wrong by a third, for this scene."""
    paint = Painter(MILLISECONDS)
    ratios = {quality: time / MILLISECONDS[1] for quality, time in paint.seconds.items()}
    times = Times(LADDER, ratios)
    draw_in_time(0.005, times, paint)
    paint.seconds[LADDER[4]] *= 1.5
    frames = [draw_in_time(0.03, times, paint) for _ in range(20)]
    assert all(frame.choice.seconds <= 0.03 for frame in frames[-5:])


def test_no_quality_of_many_pictures_is_drawn_that_must_take_too_long():
    paint = Painter([1e-3 * time for time in (50, 100, 200, 400, 800, 1000, 1400, 25e3, 100e3)])
    draw_in_time(1.0, Times(LADDER, {}), paint)
    assert sum(paint.seconds[quality] for quality in paint.drawn) < 30.0
    assert LADDER[7] not in paint.drawn


def test_the_oldest_scenes_are_forgotten_of_very_many():
    scenes = [rj.Scene() for _ in range(dial.MOST_KNOWN + 3)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rj.CalibrationWarning)
        known = [dial.times_of(scene, None) for scene in scenes]
        assert len(dial._TIMES) == dial.MOST_KNOWN
        assert dial.times_of(scenes[-1], None) is known[-1]


def test_a_scene_is_calibrated_once():
    paint, times = Painter(MILLISECONDS), Times(LADDER, {})
    draw_in_time(0.02, times, paint)
    count = len(paint.drawn)
    for _ in range(3):
        draw_in_time(0.02, times, paint)
    assert len(paint.drawn) == count + 3


def test_what_another_thread_compiles_makes_no_stage_shorter_than_nothing():
    with COMPILE_CLOCK.running():
        time.sleep(0.5)
        clock = StageClock()
    clock("plan")
    assert 0.0 <= clock.seconds["plan"] < 0.5
    assert 0.0 < clock.seconds["compile"] < 0.5


def test_nothing_is_learned_of_frames_while_something_compiles():
    paint, times = Painter(MILLISECONDS), Times(LADDER, {})
    draw_in_time(0.02, times, paint)
    paint.load = 3.0
    for _ in range(9):
        paint.drawn.clear()
        assert draw_in_time(0.02, times, paint).choice.quality == LADDER[3]
    assert draw_in_time(0.02, times, paint).choice.quality == LADDER[3]
    assert draw_in_time(0.02, times, paint).choice.quality != LADDER[3]


def test_calibrating_again_goes_on_where_frames_became_faster():
    paint, times = Painter(MILLISECONDS), Times(LADDER, {})
    paint.load = 10.0
    assert draw_in_time(0.05, times, paint).choice.quality == LADDER[1]
    assert set(paint.drawn) == set(LADDER[:4])
    assert not list(times.calibrate(0.05, paint))
    paint.load = 1.0
    for _ in range(20):
        draw_in_time(0.05, times, paint)
    again = list(times.calibrate(0.05, paint))
    # 64 pictures of 2 ms take too long.
    assert again == list(LADDER[4:7])
    chosen = draw_in_time(0.05, times, paint).choice
    assert chosen.quality == LADDER[5]
    assert chosen.predicted_seconds == pytest.approx(MILLISECONDS[5], rel=0.1)


def test_calibrating_goes_on_where_it_was_interrupted():
    paint, times = Painter(MILLISECONDS), Times(LADDER, {})

    def interrupted(quality):
        if quality == LADDER[2]:
            raise KeyboardInterrupt
        return paint(quality)

    with pytest.raises(KeyboardInterrupt):
        draw_in_time(0.02, times, interrupted)
    assert set(paint.drawn) == set(LADDER[:2])
    paint.drawn.clear()
    assert draw_in_time(0.02, times, paint).choice.quality == LADDER[3]
    assert set(paint.drawn) == set(LADDER[2:6])


def test_with_a_profile_only_the_fastest_and_the_chosen_are_timed():
    paint = Painter(MILLISECONDS)
    ratios = {quality: time / MILLISECONDS[1] for quality, time in paint.seconds.items()}
    frame = draw_in_time(0.02, Times(LADDER, ratios), paint)
    assert frame.choice.quality == LADDER[3]
    assert set(paint.drawn) == {LADDER[0], LADDER[3]}


def test_a_profile_that_errs_is_corrected_before_the_frame():
    """The machine's ratios promise twice the speed that this scene has."""
    paint = Painter(MILLISECONDS)
    ratios = {quality: time for quality, time in paint.seconds.items()}
    ratios[LADDER[0]] *= 2.0
    frame = draw_in_time(0.02, Times(LADDER, ratios), paint)
    assert frame.choice.seconds <= 0.02


def test_the_dial_follows_a_machine_that_slows_down_and_recovers():
    paint, times = Painter(MILLISECONDS), Times(LADDER, {})
    assert draw_in_time(0.02, times, paint).choice.quality == LADDER[3]
    paint.load = 2.5
    frames = [draw_in_time(0.02, times, paint) for _ in range(6)]
    assert frames[-1].choice.quality == LADDER[2]
    assert frames[-1].choice.seconds <= 0.02
    paint.load = 1.0
    frames = [draw_in_time(0.02, times, paint) for _ in range(8)]
    assert frames[-1].choice.quality == LADDER[3]


def flat(value):
    light = np.full((4, 4, 4), value, np.float32)
    plan = types.SimpleNamespace(
        has=lambda name: False, at=lambda place: [], background=(1.0, 1.0, 1.0, 1.0)
    )
    stats = types.SimpleNamespace(seconds={"shade": 0.5, "compile": 3.0})
    return types.SimpleNamespace(linear=light, plan=plan, stats=stats, choice=None)


def test_the_fastest_quality_that_is_near_enough_is_drawn():
    lights = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.0, 0.0)
    errors = dict(zip(LADDER, lights, strict=True))
    for bound, step in ((0.9, 0), (0.36, 1), (0.18, 2), (0.04, 4), (1e-3, 8)):
        drawn = []
        frame = draw_within_error(
            bound,
            lambda quality, drawn=drawn: drawn.append(quality) or flat(0.0),
            [lambda quality: flat(0.0), lambda quality: flat(errors[quality])],
        )
        assert drawn == [LADDER[step]]
        assert frame.choice.quality == LADDER[step]
        assert dial.MARGIN * frame.choice.predicted_error <= bound


def test_what_is_better_than_its_betters_is_not_trusted():
    """Edges on the borders of small pixels need no samples; those of the picture lie elsewhere."""
    lights = dict(zip(LADDER, (0.5, 0.2, 0.1, 0.001, 0.05, 0.01, 0.005, 0.0, 0.0), strict=True))
    drawn = []
    draw_within_error(
        0.04, lambda quality: drawn.append(quality) or flat(0.0), [lambda q: flat(lights[q])]
    )
    assert drawn == [LADDER[5]]


def cube_and_floor():
    scene = rj.Scene()
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6),
        (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]  # fmt: skip
    scene.add(rj.Mesh(corners, faces, material=rj.Material("flat", "orange")))
    floor = [(-5, -1, -5), (-5, -1, 5), (5, -1, 5), (5, -1, -5)]
    scene.add(rj.Mesh(floor, [(0, 1, 2), (0, 2, 3)], material=rj.Material("unlit", "#204080")))
    return scene


CAMERA = rj.PerspectiveCamera((3, 2.5, 6), (0, 0, 0))


@pytest.mark.parametrize("bound", [0.02, 0.012])
def test_the_error_stays_within_its_bound(bound):
    scene = cube_and_floor()
    frame = rj.render(scene, CAMERA, size=SIZE, max_error=bound, outputs=("linear",))
    exact = rj.render(scene, CAMERA, size=SIZE, quality=rj.Quality.reference(), outputs=("linear",))
    error = root_mean_square(light_of(frame) - light_of(exact))
    assert error <= bound
    assert frame.plan.quality == frame.choice.quality
    standard = rj.render(scene, CAMERA, size=SIZE, outputs=("linear",))
    assert root_mean_square(light_of(standard) - light_of(exact)) > bound
    assert frame.choice.quality not in LADDER[:2]


@pytest.mark.parametrize("name", ["floor", "highlights", "shadows", "glass", "slivers"])
def test_errors_stay_within_their_bounds(name):
    made, size = rj.accuracy.make(name), (160, 120)
    exact, standard = (
        light_of(
            rj.render(made.scene, made.camera, size=size, quality=quality, outputs=("linear",))
        )
        for quality in (rj.Quality.reference(), rj.Quality())
    )
    usual, chosen = root_mean_square(standard - exact), set()
    for factor in (20.0, 3.0, 1.0, 0.3):
        frame = rj.render(
            made.scene, made.camera, size=size, max_error=factor * usual, outputs=("linear",)
        )
        assert root_mean_square(light_of(frame) - exact) <= factor * usual
        chosen.add(frame.choice.quality)
    assert len(chosen) >= 2


def test_a_time_budget_is_asked_for_the_first_time_with_a_warning_and_then_without():
    scene = cube_and_floor()
    with pytest.warns(rj.CalibrationWarning, match="rasterjit accuracy --calibrate"):
        first = rj.render(scene, CAMERA, size=SIZE, time_budget=1e-5)
    assert first.choice.quality == first.plan.quality
    assert first.choice.quality in LADDER[:2]
    assert first.choice.seconds > 1e-5
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = rj.render(scene, CAMERA, size=SIZE, time_budget=1e-5)
    assert (again.color == first.color).all()


def test_a_frame_is_that_of_its_quality_bit_for_bit():
    dial.save_profile(Profile((Step(rj.Quality(samples=4), 1.0, 1.0),), 1))
    scene = cube_and_floor()
    with rj.Renderer(SIZE) as renderer:
        frame = renderer.render(scene, CAMERA, time_budget=5.0)
    assert frame.choice.quality == rj.Quality(samples=4)
    same = rj.render(scene, CAMERA, size=SIZE, quality=rj.Quality(samples=4))
    assert (frame.color == same.color).all()
    assert same.choice is None


def test_what_is_known_of_a_scene_goes_with_it():
    dial.save_profile(Profile((Step(rj.Quality(), 1.0, 1.0),), 1))
    scene = cube_and_floor()
    rj.render(scene, CAMERA, size=SIZE, time_budget=5.0)
    assert len(dial._TIMES) == 1
    del scene
    assert not dial._TIMES


@pytest.mark.parametrize("value", [0, -1.0, float("nan"), float("inf"), "fast"])
@pytest.mark.parametrize("name", ["time_budget", "max_error"])
def test_a_goal_is_a_number_above_zero(name, value):
    with pytest.raises(ValueError, match=name):
        rj.render(cube_and_floor(), CAMERA, size=SIZE, **{name: value})


def test_there_is_one_goal():
    scene = cube_and_floor()
    with pytest.raises(ValueError, match="time_budget must be None where max_error is given"):
        rj.render(scene, CAMERA, size=SIZE, max_error=0.1, time_budget=0.1)
    with pytest.raises(ValueError, match="quality must be None where time_budget is given"):
        rj.render(scene, CAMERA, size=SIZE, quality=rj.Quality(), time_budget=0.1)


@pytest.mark.filterwarnings("ignore::rasterjit.CalibrationWarning")
@pytest.mark.parametrize("goal", ["time_budget", "max_error"])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"outputs": ("colour",)}, "outputs has 'colour'"), ({"outputs": ("uv",)}, "uv"),
        ({"diagnose": 3}, "diagnose"), ({"cull": "left"}, "cull"), ({"background": "blau"}, "blau"),
    ],
)  # fmt: skip
def test_other_arguments_are_checked_before_anything_is_drawn(
    goal, arguments, message, monkeypatch
):
    monkeypatch.setattr(rj.Renderer, "_draw", None)
    with pytest.raises(ValueError, match=message):
        rj.render(cube_and_floor(), CAMERA, size=SIZE, **{goal: 0.1}, **arguments)
    with pytest.raises(ValueError, match="must be a"):
        rj.render(3, **{goal: 0.1})


@pytest.mark.parametrize("color", ["black", "white"])
def test_what_is_missing_of_an_edge_counts_before_a_background_that_is_seen_through(color):
    scene = rj.Scene()
    corners = [(-1, -1, 0), (1, -0.8, 0), (0.1, 1, 0)]
    scene.add(rj.Mesh(corners, [(0, 1, 2)], material=rj.Material("unlit", color)))
    options = {"size": SIZE, "outputs": ("linear",), "background": "transparent"}
    exact = rj.render(scene, CAMERA, quality=rj.Quality.reference(), **options)
    frame = rj.render(scene, CAMERA, max_error=0.01, **options)
    difference = light_of(frame) - light_of(exact)
    assert difference.shape == (*SIZE[::-1], 4)
    assert root_mean_square(difference) <= 0.01
    assert frame.choice.quality.samples != 1
    true = exact.linear[:, :, :3] * exact.linear[:, :, 3:]
    np.testing.assert_array_equal(light_of(exact)[:, :, :3], true)
