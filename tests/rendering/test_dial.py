"""The dial: the best quality that a time allows, or the fastest one for an error."""

from __future__ import annotations

import time
import types
import warnings

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.rendering import quality_selection as dial
from rasterjit.rendering.quality_selection import (
    ERROR_LADDER,
    LADDER,
    FrameTimes,
    Profile,
    QualityStep,
    draw_within_error,
    draw_within_time,
    light_of,
    root_mean_square,
)
from rasterjit.runtime.clocks import COMPILE_CLOCK, StageClock

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
    monkeypatch.setattr(dial, "user_cache_folder", lambda: tmp_path)
    dial._TIMES.clear()


@pytest.mark.parametrize(("budget", "step"), [(1e-4, 0), (3e-3, 0), (5e-3, 1), (0.02, 3), (9, 8)])
def test_the_best_quality_that_fits_is_drawn(budget, step):
    paint = Painter(MILLISECONDS)
    frame = draw_within_time(budget, FrameTimes(LADDER, {}), paint)
    assert frame.choice.quality == LADDER[step] == paint.drawn[-1]
    assert frame.choice.predicted_seconds == pytest.approx(MILLISECONDS[step])
    assert frame.choice.seconds == pytest.approx(MILLISECONDS[step])


def test_calibrating_stops_at_what_takes_too_long():
    paint = Painter(MILLISECONDS)
    draw_within_time(0.008, FrameTimes(LADDER, {}), paint)
    assert set(paint.drawn) == set(LADDER[:5])


def test_where_no_quality_fits_the_fastest_is_drawn_whichever_it_is():
    """Vertices may be more than pixels: then lighting them takes longer."""
    paint = Painter([1e-3 * time for time in (9, 4, 7, 11, 25, 40, 50, 300, 1200)])
    assert draw_within_time(1e-3, FrameTimes(LADDER, {}), paint).choice.quality == LADDER[1]
    assert set(paint.drawn) == set(LADDER[:2])


def seconds_and_steps(frames):
    return [(frame.choice.seconds, LADDER.index(frame.choice.quality)) for frame in frames]


def play(times, paint, *acts):
    """Draw frames for acts of a budget, a load and a number of frames; return those of each."""
    played = []
    for budget, load, count in acts:
        paint.load = load
        frames = [draw_within_time(budget, times, paint) for _ in range(count)]
        played.append(seconds_and_steps(frames))
    return played


def test_one_frame_that_is_disturbed_is_forgotten():
    paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})
    _, disturbed, after = play(times, paint, (0.06, 1.0, 9), (0.06, 4.0, 1), (0.06, 1.0, 12))
    assert disturbed[0][0] > 0.06
    assert all(seconds <= 0.06 and step == 6 for seconds, step in after)


@pytest.mark.parametrize("knows_ratios", [False, True])
def test_each_frame_is_as_good_as_its_own_budget_allows(knows_ratios):
    """Whatever the budgets of frames before it were."""
    paint = Painter(MILLISECONDS)
    ratios = {quality: time / MILLISECONDS[1] for quality, time in paint.seconds.items()}
    times = FrameTimes(LADDER, ratios if knows_ratios else {})
    random = np.random.default_rng(3)
    for budget in (
        0.005,
        0.5,
        9.0,
        0.003,
        *10.0 ** random.uniform(-2.5, 0.5, dial.FRAMES_BEFORE_RETRY - 4),
    ):
        seconds, step = seconds_and_steps([draw_within_time(budget, times, paint)])[0]
        fitting = [n for n, time in enumerate(MILLISECONDS) if time <= dial.HEADROOM * budget]
        assert step == max(fitting)
        assert seconds <= budget


@pytest.mark.parametrize("load", [1.7, 2.5, 6.0, 20.0])
def test_load_that_comes_and_goes_is_followed(load):
    """Two frames tell that it changed; the third is as good as the budget then allows."""
    paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})
    for _ in range(3):
        free, busy = play(times, paint, (0.06, 1.0, 16), (0.06, load, 16))
        assert {step for _, step in free[2:]} == {6}
        fitting = [n for n, time in enumerate(MILLISECONDS) if load * time <= 0.9 * 0.06]
        assert {step for _, step in busy[2:]} == {max(fitting, default=0)}


@pytest.mark.parametrize("load", [1.5, 3.0, 8.0])
def test_a_quality_first_drawn_under_load_is_not_thought_slow_for_ever(load):
    """Budgets rise while the machine is busy, which is over before the next frame."""
    paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})
    *_, after = play(times, paint, (0.005, 1.0, 3), (0.06, load, 3), (0.06, 1.0, 12))
    assert {step for _, step in after[2:]} == {6}


def test_a_quality_measured_when_disturbed_is_tried_again():
    paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})
    play(times, paint, (0.06, 1.0, 5))
    times._seconds[LADDER[6]] *= 2.5
    (frames,) = play(times, paint, (0.06, 1.0, dial.FRAMES_BEFORE_RETRY + 5))
    assert frames[0][1] == 5
    assert frames[-1][1] == 6


def test_nine_of_ten_frames_stay_in_the_budget_where_times_vary():
    random, kept = np.random.default_rng(1), []
    for budget in (0.012, 0.03, 0.06, 0.4):
        paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})
        for _ in range(300):
            paint.load = np.exp(random.normal(0.0, 0.25))
            kept.append(draw_within_time(budget, times, paint).choice.seconds <= budget)
    assert np.mean(kept) >= dial.ON_TIME_SHARE


def test_trials_of_better_qualities_take_few_frames_out_of_the_budget():
    paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})
    (frames,) = play(times, paint, (0.015, 1.0, 1000))
    assert sum(seconds > 0.015 for seconds, _ in frames) <= 6


def test_scenes_and_sizes_are_remembered_apart():
    scenes = {name: (Painter([s * time for time in MILLISECONDS]), FrameTimes(LADDER, {}))
              for name, s in (("small", 0.2), ("usual", 1.0), ("large", 4.0))}  # fmt: skip
    for turn in range(20):
        for name, step in (("small", 6), ("usual", 3), ("large", 1)):
            paint, times = scenes[name]
            frame = draw_within_time(0.02, times, paint)
            assert (turn, name, LADDER.index(frame.choice.quality)) == (turn, name, step)


def test_what_a_scene_takes_longer_for_than_others_is_learned():
    """Of one quality the profile's ratio is wrong by a third, for this scene."""
    paint = Painter(MILLISECONDS)
    ratios = {quality: time / MILLISECONDS[1] for quality, time in paint.seconds.items()}
    times = FrameTimes(LADDER, ratios)
    draw_within_time(0.005, times, paint)
    paint.seconds[LADDER[4]] *= 1.5
    frames = [draw_within_time(0.03, times, paint) for _ in range(20)]
    assert all(frame.choice.seconds <= 0.03 for frame in frames[-5:])


def test_no_quality_of_many_pictures_is_drawn_that_must_take_too_long():
    paint = Painter([1e-3 * time for time in (50, 100, 200, 400, 800, 1000, 1400, 25e3, 100e3)])
    draw_within_time(1.0, FrameTimes(LADDER, {}), paint)
    assert sum(paint.seconds[quality] for quality in paint.drawn) < 30.0
    assert LADDER[7] not in paint.drawn


def test_the_oldest_scenes_are_forgotten_of_very_many():
    scenes = [rj.Scene() for _ in range(dial.MAX_TIMED_SCENES + 3)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rj.CalibrationWarning)
        known = [dial.get_frame_times(scene, None) for scene in scenes]
        assert len(dial._TIMES) == dial.MAX_TIMED_SCENES
        assert dial.get_frame_times(scenes[-1], None) is known[-1]


def test_a_scene_is_calibrated_once():
    paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})
    draw_within_time(0.02, times, paint)
    count = len(paint.drawn)
    for _ in range(3):
        draw_within_time(0.02, times, paint)
    assert len(paint.drawn) == count + 3


def test_what_another_thread_compiles_makes_no_stage_shorter_than_nothing():
    with COMPILE_CLOCK.running():
        time.sleep(0.5)
        clock = StageClock()
    clock("plan")
    assert 0.0 <= clock.seconds["plan"] < 0.5
    assert 0.0 < clock.seconds["compile"] < 0.5


def test_nothing_is_learned_of_frames_while_something_compiles():
    paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})
    draw_within_time(0.02, times, paint)
    paint.load = 3.0
    for _ in range(9):
        paint.drawn.clear()
        assert draw_within_time(0.02, times, paint).choice.quality == LADDER[3]
    for _ in range(2):
        assert draw_within_time(0.02, times, paint).choice.quality == LADDER[3]
    assert draw_within_time(0.02, times, paint).choice.quality != LADDER[3]


def test_calibrating_again_goes_on_where_frames_became_faster():
    paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})
    paint.load = 10.0
    assert draw_within_time(0.05, times, paint).choice.quality == LADDER[1]
    assert set(paint.drawn) == set(LADDER[:4])
    assert not list(times.calibrate(0.05, paint))
    paint.load = 1.0
    for _ in range(3):
        chosen = draw_within_time(0.05, times, paint).choice
    # 64 pictures of 2 ms take too long.
    assert set(paint.drawn) == set(LADDER[:7])
    assert chosen.quality == LADDER[5]
    assert chosen.predicted_seconds == pytest.approx(MILLISECONDS[5], rel=0.1)


def test_calibrating_goes_on_where_it_was_interrupted():
    paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})

    def interrupted(quality):
        if quality == LADDER[2]:
            raise KeyboardInterrupt
        return paint(quality)

    with pytest.raises(KeyboardInterrupt):
        draw_within_time(0.02, times, interrupted)
    assert set(paint.drawn) == set(LADDER[:2])
    paint.drawn.clear()
    assert draw_within_time(0.02, times, paint).choice.quality == LADDER[3]
    assert set(paint.drawn) == set(LADDER[2:6])


def test_with_a_profile_only_the_fastest_and_the_chosen_are_timed():
    paint = Painter(MILLISECONDS)
    ratios = {quality: time / MILLISECONDS[1] for quality, time in paint.seconds.items()}
    frame = draw_within_time(0.02, FrameTimes(LADDER, ratios), paint)
    assert frame.choice.quality == LADDER[3]
    assert set(paint.drawn) == {LADDER[0], LADDER[3]}


def test_a_profile_that_errs_is_corrected_before_the_frame():
    """The machine's ratios promise twice the speed that this scene has."""
    paint = Painter(MILLISECONDS)
    ratios = {quality: time for quality, time in paint.seconds.items()}
    ratios[LADDER[0]] *= 2.0
    frame = draw_within_time(0.02, FrameTimes(LADDER, ratios), paint)
    assert frame.choice.seconds <= 0.02


def test_the_dial_follows_a_machine_that_slows_down_and_recovers():
    paint, times = Painter(MILLISECONDS), FrameTimes(LADDER, {})
    assert draw_within_time(0.02, times, paint).choice.quality == LADDER[3]
    paint.load = 2.5
    frames = [draw_within_time(0.02, times, paint) for _ in range(6)]
    assert frames[-1].choice.quality == LADDER[2]
    assert frames[-1].choice.seconds <= 0.02
    paint.load = 1.0
    frames = [draw_within_time(0.02, times, paint) for _ in range(8)]
    assert frames[-1].choice.quality == LADDER[3]


def flat(value, pictures=1, quality=None, blends=False):
    """Return a frame of a light that is told."""
    light = np.full((64, 64, 4), value, np.float32)
    facts = types.SimpleNamespace(transparency=types.SimpleNamespace(used=blends))
    plan = types.SimpleNamespace(
        effects_at=lambda place: [], background=(1.0, 1.0, 1.0, 1.0), size=(64, 64),
        pictures=pictures, facts=facts, quality=quality,
    )  # fmt: skip
    stats = types.SimpleNamespace(seconds={"shade": 0.5, "compile": 3.0})
    return types.SimpleNamespace(linear=light, plan=plan, stats=stats, choice=None)


ERRORS = dict(
    zip(ERROR_LADDER, (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.003, 0.001), strict=True)
)


def chosen_within(bound, means=(0.0, 0.0, 0.0, 0.0), errors=ERRORS, **options):
    """Return the frame for a bound, what was drawn for it, and of the reference how much."""
    drawn, pictures = [], []

    def draw(quality):
        drawn.append(quality)
        return flat(errors[quality], quality=quality, **options)

    def refined():
        for count, value in zip((4, 16, 64, 256), means, strict=True):
            pictures.append(count)
            yield flat(value, count)

    swept = [flat(means[-1])] * 2
    return draw_within_error(bound, draw, refined(), lambda: swept), drawn, pictures


@pytest.mark.parametrize(
    ("bound", "step", "pictures"),
    [(0.9, 0, 4), (0.51, 0, 16), (0.3, 1, 16), (0.15, 2, 16), (0.04, 4, 16), (0.0051, 6, 16),
     (0.004, 7, 16), (0.002, 8, 64), (1e-4, 9, 256)],
)  # fmt: skip
def test_the_fastest_quality_that_is_near_enough_is_drawn(bound, step, pictures):
    frame, drawn, counts = chosen_within(bound)
    ladder = (*ERROR_LADDER, LADDER[-1])
    assert frame.choice.quality == ladder[step]
    assert frame.choice.predicted_error <= bound
    # Each faster one was drawn, once, and no better one.
    assert drawn == list(ladder[: step + 1])[: len(ERROR_LADDER)]
    assert counts[-1] == pictures


def test_areas_are_not_found_of_blended_faces():
    frame, drawn, _ = chosen_within(0.004, blends=True)
    assert frame.choice.quality == ERROR_LADDER[-1]
    assert "area" not in {quality.samples for quality in drawn}


def test_as_many_pictures_of_the_reference_are_drawn_as_it_takes_to_tell():
    """The first ones err nearly as much as the quality does."""
    frame, _, counts = chosen_within(0.23, means=(-0.1, -0.05, 0.0, 0.0))
    assert frame.choice.quality == ERROR_LADDER[1]
    assert counts == [4, 16, 64]


def test_what_could_not_be_told_apart_is_settled_before_a_much_slower_quality():
    """A fast quality is near enough, which only all pictures of the reference tell."""
    errors = (0.4, 0.4, 0.21, 0.4, 0.4, 0.4, 0.4, 0.4, 0.1)
    frame, drawn, counts = chosen_within(
        0.23, means=(-0.1, -0.05, -0.02, 0.0), errors=dict(zip(ERROR_LADDER, errors, strict=True))
    )
    assert frame.choice.quality == ERROR_LADDER[2]
    assert counts == [4, 16, 64, 256]
    assert ERROR_LADDER[-1] not in drawn


def test_where_all_must_be_drawn_the_frame_tells_the_time_of_all():
    frame, _, _ = chosen_within(1e-4)
    assert frame.choice.seconds == pytest.approx(4 * 0.5)
    assert frame.choice.predicted_error == 0.0


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


@pytest.mark.parametrize("bound", [0.2, 0.02, 0.003, 1e-5])
def test_a_frame_within_an_error_is_that_of_its_quality_bit_for_bit(bound):
    scene = cube_and_floor()
    outputs = ("depth", "color")
    frame = rj.render(scene, CAMERA, size=SIZE, max_error=bound, outputs=outputs, diagnose=True)
    quality = frame.choice.quality
    same = rj.render(scene, CAMERA, size=SIZE, quality=quality, outputs=outputs, diagnose=True)
    assert frame.plan.quality == quality
    assert frame.plan.outputs == same.plan.outputs == outputs
    assert frame.diagnostics.faces == same.diagnostics.faces == 14
    for name in outputs:
        np.testing.assert_array_equal(frame.arrays()[name], same.arrays()[name])
    with pytest.raises(AttributeError, match="linear"):
        _ = frame.linear


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
    dial.save_profile(Profile((QualityStep(rj.Quality(samples=4), 1.0, 1.0),), 1))
    scene = cube_and_floor()
    with rj.Renderer(SIZE) as renderer:
        frame = renderer.render(scene, CAMERA, time_budget=5.0)
    assert frame.choice.quality == rj.Quality(samples=4)
    same = rj.render(scene, CAMERA, size=SIZE, quality=rj.Quality(samples=4))
    assert (frame.color == same.color).all()
    assert same.choice is None


def test_what_is_known_of_a_scene_goes_with_it():
    dial.save_profile(Profile((QualityStep(rj.Quality(), 1.0, 1.0),), 1))
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
    monkeypatch.setattr(rj.Renderer, "_draw_step_by_step", None)
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


@pytest.mark.needs_jit
@pytest.mark.parametrize(
    ("start", "width", "slanted"),
    [(0.47, 0.1, False), (0.1, 0.2, False), (0.1, 0.2, True), (0.01, 0.05, False)],
)
def test_bars_between_the_samples_of_all_pixels_are_not_missed(start, width, slanted):
    corners, faces, (columns, rows) = [], [], (64, 48)
    for left in np.arange(columns) + start:
        first = len(corners)
        lean = 0.3 if slanted else 0.0
        corners += [(left, 0, 0), (left + width, 0, 0)]
        corners += [(left + width + lean, rows, 0), (left + lean, rows, 0)]
        faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    bars = rj.Mesh(corners, faces, material=rj.Material("unlit", "white"))
    middle = columns / 2, rows / 2
    camera = rj.OrthographicCamera((*middle, 3), (*middle, 0), height=rows)
    asked = {"size": (columns, rows), "outputs": ("linear",), "background": "black"}
    best = rj.render(bars, camera, quality=rj.Quality.reference(), **asked)
    found = rj.render(bars, camera, max_error=0.02, **asked)
    error = np.sqrt(np.mean(np.square(found.linear - best.linear, dtype=np.float64)[:, :, :3]))
    assert error <= 0.02
