import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_trials import trial

from rasterjit.accuracy.ranking import dominates, is_slower, mark_dominated, noise, pareto_front

SAME = (1.0,) * 5


def ratios(ratio):
    return (ratio,) * 5


numbers = st.sampled_from([0.25, 0.5, 1.0, 2.0, 4.0])


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=12))
def test_the_front_holds_nothing_dominated_and_all_that_is_not(places):
    trials = [
        trial(f"samples={n}", ratios(ratio), rmse=rmse) for n, (ratio, rmse) in enumerate(places)
    ]
    front = pareto_front(trials)
    held = [one for one in trials if one.label in front]
    for one in trials:
        beaten = [
            (other.ratio, other.errors.rmse) != (one.ratio, one.errors.rmse)
            and other.ratio <= one.ratio
            and other.errors.rmse <= one.errors.rmse
            for other in trials
        ]
        places_held = {(other.ratio, other.errors.rmse) for other in held}
        assert ((one.ratio, one.errors.rmse) in places_held) == (not any(beaten))
    assert [one.ratio for one in sorted(held, key=lambda one: front.index(one.label))] == sorted(
        one.ratio for one in held
    )


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
    assert noise(many) < noise(few)
    assert is_slower(many, trial())
    assert not is_slower(few, trial())


def test_times_of_too_few_rounds_are_told_apart_only_if_they_are_far_apart():
    once, standard = trial("samples=2", (1.2,), rmse=0.2), trial(rmse=0.1)
    assert not is_slower(once, standard)
    assert not dominates(standard, once)
    assert dominates(standard, trial("samples=2", (1.2,) * 3, rmse=0.2))
    slow = trial("samples=256", (300.0,), rmse=0.2)
    assert is_slower(slow, standard)
    assert dominates(standard, slow)
