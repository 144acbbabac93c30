import pytest
from made_trials import errors

import rasterjit as rj
from rasterjit.accuracy import timing
from rasterjit.accuracy.choice import is_timed
from rasterjit.accuracy.results import CPU, WALL
from rasterjit.accuracy.settings_to_try import Attempt
from rasterjit.accuracy.timing import Contestant, TimeBudget, has_time, round_interval, run_rounds


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


class Painter:
    """Takes as long as each quality is said to, and notes what it drew."""

    def __init__(self, clock, seconds):
        self.clock, self.costs, self.drawn = clock, seconds, []
        self.interrupt_after = None

    def time_stages(self, attempt):
        samples = attempt.quality.samples
        if len(self.drawn) == self.interrupt_after:
            raise KeyboardInterrupt
        self.drawn.append(samples)
        cost = self.costs[samples]
        self.clock.now += cost
        return {"plan": 0.25 * cost, "shade": 0.75 * cost}


def no_notice(text):
    pass


def contestant(samples, cost):
    attempt = Attempt("samples", str(samples), rj.Quality(samples=samples))
    return Contestant(attempt, errors(1.0 / samples), None, None, {"shade": cost}, cost)


def run(seconds, budget):
    clock = Clock()
    painter = Painter(clock, seconds)
    standard, *others = (contestant(samples, cost) for samples, cost in seconds.items())
    told = []
    run_rounds(painter, standard, others, TimeBudget(budget, clock), told.append, clock)
    return painter, standard, others, told


def test_every_round_draws_each_quality_and_the_standard_between_them():
    painter, standard, others, _ = run({1: 0.2, 4: 0.5, 8: 0.7}, 1000.0)
    assert len(painter.drawn) == 8 * timing.MAX_ROUNDS
    for number in range(timing.MAX_ROUNDS):
        a, b = ((4, 8), (8, 4))[number % 2]
        assert painter.drawn[8 * number : 8 * number + 8] == [1, 1, a, a, 1, 1, b, b]
    assert {len(one.frame_stages) for one in others} == {timing.MAX_ROUNDS}
    assert len(standard.frame_stages) == 2 * timing.MAX_ROUNDS


def test_rounds_begin_with_another_quality_each():
    painter, *_ = run({1: 0.2, 2: 0.3, 4: 0.5, 8: 0.7}, 1000.0)
    assert painter.drawn[2:50:12] == [2, 4, 8, 2]


def test_frames_of_one_picture_are_drawn_twice_and_the_second_counts():
    painter, standard, _, _ = run({1: 0.01, 64: 0.05}, 1000.0)
    assert painter.drawn[:3] == [1, 1, 64]
    assert len(standard.frame_stages) == timing.MAX_ROUNDS


def test_no_round_begins_that_would_not_end_in_time():
    painter, standard, _, _ = run({1: 0.2, 4: 0.8}, 7.9)
    assert len(standard.frame_stages) == 3
    assert painter.clock.now <= 100.0 + 7.0


def test_one_round_is_drawn_whatever_the_budget():
    _, standard, others, _ = run({1: 1.0, 4: 2.0}, 0.001)
    assert [len(one.frame_stages) for one in (standard, *others)] == [1, 1]


def test_slow_qualities_take_part_in_fewer_rounds():
    _, standard, (slow,), _ = run({1: 0.2, 256: 0.2 * 3 * timing.MIN_SLOW_RATIO}, 1000.0)
    assert round_interval(slow, standard) == 3
    assert len(slow.frame_stages) == timing.MAX_ROUNDS // 3


def test_the_slowest_are_drawn_often_enough_to_say_how_much_their_times_vary():
    _, standard, (slow,), _ = run({1: 0.2, 256: 0.2 * 300}, 1e6)
    assert len(slow.frame_stages) == timing.MIN_ROUNDS
    assert is_timed(slow.trial(standard))


def test_ratios_are_over_the_standard_of_the_same_round():
    clock = Clock()
    painter = Painter(clock, {1: 0.2, 4: 0.5})
    standard, other = contestant(1, 0.2), contestant(4, 0.5)

    class Slowing(Painter):
        def time_stages(self, attempt):
            for samples in self.costs:
                self.costs[samples] *= 1.0 + 1e-3
            return super().time_stages(attempt)

    painter = Slowing(clock, {1: 0.2, 4: 0.5})
    run_rounds(painter, standard, [other], TimeBudget(1000.0, clock), no_notice, clock)
    trial = other.trial(standard)
    assert trial.ratios == pytest.approx([2.5] * timing.MAX_ROUNDS, rel=4e-3)
    assert trial.seconds[-1] > 1.03 * trial.seconds[0]
    assert trial.median == pytest.approx(sum(trial.stages.values()))


def test_the_ratios_of_the_standard_are_one():
    _, standard, _, _ = run({1: 0.2, 4: 0.5}, 1000.0)
    trial = timing.make_standard_trial(standard)
    assert trial.label == "standard"
    assert set(trial.ratios) == {1.0}
    assert len(trial.ratios) == len(trial.seconds)


def test_an_interrupted_round_is_forgotten():
    clock = Clock()
    painter = Painter(clock, {1: 0.2, 4: 0.5})
    painter.interrupt_after = 9
    standard, other = contestant(1, 0.2), contestant(4, 0.5)
    with pytest.raises(KeyboardInterrupt):
        run_rounds(painter, standard, [other], TimeBudget(1e3, clock), no_notice, clock)
    assert [len(one.frame_stages) for one in (standard, other)] == [2, 2]


def test_what_was_not_timed_in_rounds_has_the_time_of_its_first_frame():
    standard, other = contestant(1, 0.2), contestant(4, 0.5)
    assert other.trial(standard).ratios == (2.5,)
    assert timing.make_standard_trial(standard).seconds == (0.2,)


def test_what_would_leave_no_time_for_the_rounds_is_not_prepared():
    clock = Clock()
    standard, prepared = contestant(1, 0.1), [contestant(4, 0.4)]
    attempt = Attempt("samples", "64", rj.Quality(samples=64))
    # 2 drawings of 64 pictures, and 2 rounds of 2 (0.1 + 0.4 + 6.4).
    wanted = 2 * 6.4 + 2 * 2 * 6.9
    assert has_time(attempt, standard, prepared, TimeBudget(wanted + 0.01, clock))
    assert not has_time(attempt, standard, prepared, TimeBudget(wanted - 0.01, clock))


def test_an_allowance_keeps_what_was_promised_and_no_more():
    clock = Clock()
    budget = TimeBudget(10.0, clock)
    clock.now += 3.0
    budget.ensure(5.0)
    assert budget.left() == pytest.approx(7.0)
    clock.now += 30.0
    budget.ensure(5.0)
    assert budget.left() == pytest.approx(5.0)


@pytest.mark.parametrize(("others", "times"), [(0, 1), (1, 1), (2, 2), (3, 3), (9, 3), (40, 3)])
def test_the_standard_is_drawn_up_to_three_times_in_a_round(others, times):
    standard, turn = contestant(1, 0.1), [contestant(4, 0.1) for _ in range(others)]
    order = timing.order_round(turn, standard)
    assert [one for one in order if one is not standard] == turn
    assert sum(one is standard for one in order) == times
    assert order[0] is standard


def test_one_disturbed_frame_of_the_standard_changes_no_ratio():
    clock = Clock()

    class Disturbed(Painter):
        def time_stages(self, attempt):
            stages = super().time_stages(attempt)
            is_late = attempt.quality.samples == 1 and len(self.drawn) == 2
            return {name: seconds * (9.0 if is_late else 1.0) for name, seconds in stages.items()}

    painter = Disturbed(clock, {1: 0.2, 2: 0.3, 4: 0.5, 8: 0.7})
    standard, *others = (contestant(samples, cost) for samples, cost in painter.costs.items())
    run_rounds(painter, standard, others, TimeBudget(1000.0, clock), no_notice, clock)
    assert max(standard.frame_stages[0].values()) > 1.0
    assert others[0].trial(standard).ratios == pytest.approx([1.5] * timing.MAX_ROUNDS)


def test_after_three_rounds_only_contenders_are_drawn():
    clock = Clock()
    painter = Painter(clock, {1: 0.2, 4: 0.5, 8: 0.9, 16: 0.4})
    standard, *others = (contestant(samples, cost) for samples, cost in painter.costs.items())
    assert [one.attempt.level for one in timing.find_contenders(standard, others)] == ["4", "16"]
    run_rounds(painter, standard, others, TimeBudget(1000.0, clock), no_notice, clock)
    assert [len(one.frame_stages) for one in others] == [21, timing.MIN_ROUNDS, 21]


def test_a_scene_without_an_effect_is_no_contender():
    standard, other = contestant(1, 0.2), contestant(4, 0.1)
    other.attempt = other.attempt._replace(scene=rj.Scene())
    assert timing.find_contenders(standard, [other]) == []


def timed(samples, walls, worked):
    one = contestant(samples, worked[0])
    one.frame_stages = [{"shade": wall} for wall in walls]
    one.cpu_seconds, one.standard_seconds = list(worked), [0.1] * len(walls)
    return one


def test_on_a_quiet_machine_the_clock_on_the_wall_counts():
    standard = timed(1, [0.1] * 6, [0.2] * 6)
    other = timed(4, [0.2, 0.201, 0.2, 0.199, 0.2, 0.2], [0.4] * 6)
    assert timing.choose_clock(standard, [other]) == WALL


def test_on_a_busy_machine_processor_times_count():
    standard = timed(1, [0.1] * 6, [0.2] * 6)
    other = timed(4, [0.2, 0.9, 0.3, 0.5, 0.2, 0.7], [0.4, 0.6, 0.4, 0.41, 0.5, 0.4])
    assert timing.choose_clock(standard, [other]) == CPU
    assert other.trial(standard, CPU).ratio == pytest.approx(2.0)
    assert other.trial(standard, WALL).ratio == pytest.approx(4.0)


def test_where_processor_times_are_unknown_the_clock_on_the_wall_counts():
    standard = timed(1, [0.1] * 6, [0.0] * 6)
    other = timed(4, [0.2, 0.9, 0.3, 0.5, 0.2, 0.7], [0.0] * 6)
    assert timing.choose_clock(standard, [other]) == WALL


@pytest.mark.parametrize(("worked", "kept"), [([3.0], 1), ([3.0, 1.0, 2.0], 3), (range(8), 4)])
def test_the_least_half_of_processor_times_is_undisturbed(worked, kept):
    one = contestant(1, worked[0])
    one.cpu_seconds = list(worked[1:])
    assert one.least_cpu_seconds() == tuple(sorted(worked)[:kept])
