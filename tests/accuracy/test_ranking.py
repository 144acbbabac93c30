import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_trials import trial

from rasterjit.accuracy.choice import (
    MAX_FRONT_POINTS,
    SAME_ERROR,
    dominates,
    find_uncertainty,
    is_measured,
    is_slower,
    mark_dominated,
    pareto_front,
    thin_front,
)

SAME = (1.0,) * 5


def ratios(ratio):
    return (ratio,) * 5


numbers = st.sampled_from([0.25, 0.5, 1.0, 2.0, 4.0])


def front_of(trials):
    named = {one.label: one for one in trials}
    return [named[label] for label in pareto_front(trials)]


rounds = st.lists(st.sampled_from([0.9, 0.98, 1.0, 1.01, 1.3]), min_size=1, max_size=9)


@settings(deadline=None)
@given(st.lists(st.tuples(numbers, numbers, rounds), min_size=1, max_size=12))
def test_each_on_the_front_is_told_faster_than_all_that_are_more_accurate(places):
    trials = [
        trial(f"samples={n}", tuple(ratio * share for share in shares), rmse=rmse)
        for n, (ratio, rmse, shares) in enumerate(places)
    ]
    front = front_of(trials)
    assert len(front) <= MAX_FRONT_POINTS
    for before, after in itertools.pairwise(front):
        assert is_slower(after, before)
        assert before.errors.rmse > SAME_ERROR * after.errors.rmse
    for one in trials:
        stands_for_it = [
            other
            for other in front
            if not is_slower(other, one) and other.errors.rmse <= SAME_ERROR * one.errors.rmse
        ]
        if is_measured(one):
            assert stands_for_it, "something as good is on the front"


def test_levels_whose_times_cannot_be_told_apart_count_as_one():
    alike = [
        trial(f"samples={n}", (1.9, 1.95, 2.0, 2.05, 2.1), rmse=0.05 - 0.01 * n) for n in range(4)
    ]
    assert pareto_front([trial(), *alike]) == ("standard", "samples=3")
    apart = [trial(f"samples={n}", ratios(2.0 + n), rmse=0.05 - 0.01 * n) for n in range(4)]
    assert len(pareto_front([trial(), *apart])) == 5


def test_where_all_levels_are_equal_the_standard_is_the_front():
    levels = [trial("lines=coverage", ratios(0.995)), trial("samples=2 lines=coverage")]
    assert pareto_front([*levels, trial()]) == ("standard",)
    assert pareto_front(levels) == ("lines=coverage",), "the one that changes less"


@pytest.mark.parametrize("samples", [(0.2,), (0.2, 0.2), (0.1, 0.2, 0.3), (0.1, 0.2, 0.2, 0.6)])
def test_what_is_not_measured_well_enough_is_not_on_the_front(samples):
    doubtful = trial("shading=face", samples, rmse=0.01)
    assert not is_measured(doubtful)
    assert pareto_front([trial(), doubtful]) == ("standard",)
    assert pareto_front([trial(), trial("shading=face", (0.2,) * 3, rmse=0.01)]) == (
        "shading=face",
    )


def test_a_front_of_many_keeps_its_ends_the_standard_and_its_corners():
    steps = [
        trial(f"samples={n}", ratios(1.2**n), rmse=0.5 * 0.9 ** (n if n < 9 else 3 * n))
        for n in range(1, 15)
    ]
    kept = thin_front([trial(ratios=ratios(1.0), rmse=0.5), *steps])
    labels = [one.label for one in kept]
    assert len(kept) == MAX_FRONT_POINTS
    assert labels[0] == "standard"
    assert labels[-1] == "samples=14"
    assert {"samples=8", "samples=9"} <= set(labels), "where it bends"
    middle = thin_front([steps[0], steps[1], trial(ratios=ratios(1.5), rmse=0.41), *steps[2:]])
    assert "standard" in [one.label for one in middle]
    assert thin_front(steps[:5]) == steps[:5]


def test_a_level_that_is_slower_and_less_accurate_is_dominated():
    bad, good = trial("shading=face", ratios(1.5), rmse=0.2), trial("shading=vertex", ratios(1.2))
    marked = mark_dominated([bad, good], trial(rmse=0.01))
    assert [one.dominated_by for one in marked] == ["standard", "standard"]
    marked = mark_dominated([bad, good], trial(ratios=SAME, rmse=0.5))
    assert [one.dominated_by for one in marked] == ["shading=vertex", None]


def test_a_level_that_is_faster_or_more_accurate_is_not_dominated():
    levels = [trial("samples=1", ratios(0.5), rmse=0.4), trial("samples=8", ratios(2.0), rmse=0.01)]
    assert [one.dominated_by for one in mark_dominated(levels, trial())] == [None, None]


def test_levels_of_other_settings_dominate_nothing():
    fast, slow = trial("samples=2", ratios(0.5), rmse=0.01), trial("shading=face", rmse=0.05)
    assert mark_dominated([fast, slow], trial(rmse=0.1))[1].dominated_by is None


def test_combinations_are_left_to_the_front():
    bad = trial("samples=2 shading=face", ratios(3.0), rmse=0.9)
    assert mark_dominated([bad], trial())[0].dominated_by is None


def test_equal_levels_do_not_dominate_each_other():
    same = [trial("lines=coverage"), trial("lines=bresenham")]
    assert [one.dominated_by for one in mark_dominated(same, trial())] == [None, None]


def test_a_level_that_gains_no_time_beyond_the_noise_is_dominated_by_a_more_accurate_one():
    noisy = trial("precision=float32", (0.9, 0.95, 0.97, 1.05, 1.1), rmse=0.2)
    clear = trial("precision=float32", (0.79, 0.795, 0.8, 0.805, 0.81), rmse=0.2)
    assert mark_dominated([noisy], trial())[0].dominated_by == "standard"
    assert mark_dominated([clear], trial())[0].dominated_by is None


@pytest.mark.parametrize("measure", ["wrong_faces", "depth_units", "uv_texels"])
def test_a_level_that_is_better_in_another_measure_is_not_dominated(measure):
    better, worse = trial("precision=float64", ratios(1.2), **{measure: 1}), trial(**{measure: 2})
    assert not dominates(worse, better)
    assert dominates(trial(**{measure: 1}), trial("precision=float32", **{measure: 2}))


def test_more_rounds_tell_smaller_differences():
    few = trial("samples=2", (0.98, 1.0, 1.02, 1.04, 1.06))
    many = trial("samples=2", few.ratios * 30)
    assert find_uncertainty(many) < find_uncertainty(few)
    assert is_slower(many, trial())
    assert not is_slower(few, trial())


def test_of_few_rounds_all_samples_say_how_far_a_time_is_known():
    assert find_uncertainty(trial("samples=2", (1.9, 2.0, 2.4))) == pytest.approx(0.5)
    assert find_uncertainty(trial("samples=2", (1.9, 1.9, 1.9, 1.9, 2.4))) == pytest.approx(0.5)
    assert find_uncertainty(trial("samples=2", (1.9,) * 5 + (2.4,))) < 0.05


def test_times_of_too_few_rounds_are_told_apart_only_if_they_are_far_apart():
    once, standard = trial("samples=2", (1.2,), rmse=0.2), trial(rmse=0.1)
    assert not is_slower(once, standard)
    assert not dominates(standard, once)
    assert dominates(standard, trial("samples=2", (1.2,) * 3, rmse=0.2))
    slow = trial("samples=256", (300.0,), rmse=0.2)
    assert is_slower(slow, standard)
    assert dominates(standard, slow)
