import pytest
from made_trials import study, trial

import rasterjit as rj
from rasterjit.accuracy.choice import choose


def level(samples, ratio, rmse, rounds=9, **found):
    return trial(
        f"samples={samples}", (ratio,) * rounds, rj.Quality(samples=samples), rmse=rmse, **found
    )


def chosen(*trials, **others):
    return choose(study(trials, standard=trial(rmse=0.1), **{"left_out": (), **others}))


def test_what_buys_most_error_for_its_time_is_taken():
    found = chosen(level(2, 1.5, 0.09), level(4, 2.0, 0.02), level(16, 8.0, 0.01))
    assert (found.trial.level, found.holds, found.sureness) == ("4", True, "sure")


def test_the_standard_is_taken_where_nothing_is_worth_its_time():
    found = chosen(level(2, 1.5, 0.09), level(16, 8.0, 0.05), level(4, 0.2, 0.3))
    assert found.trial.label == "standard"


def test_what_asks_for_least_is_taken_of_what_is_as_good():
    both = trial("samples=4 shading=vertex", (1.96,) * 9, rmse=0.02)
    assert chosen(both, level(4, 2.0, 0.02)).trial.label == "samples=4"


@pytest.mark.parametrize("found", [{"wrong_faces": 5}, {"depth_units": 0.3}, {"uv_texels": 1.0}])
def test_nothing_is_taken_that_shows_other_faces_or_depths(found):
    assert chosen(level(4, 1.0, 0.02, **found)).trial.label == "standard"


@pytest.mark.parametrize(("bound", "label"), [(0.05, "samples=4"), (0.015, "samples=16")])
def test_the_fastest_is_taken_that_holds_the_error_asked_for(bound, label):
    found = chosen(level(4, 2.0, 0.02), level(8, 3.0, 0.019), level(16, 8.0, 0.01), max_error=bound)
    assert (found.trial.label, found.holds) == (label, True)


def test_a_rough_error_may_be_had_faster_than_the_standard():
    assert chosen(level(2, 0.5, 0.3), max_error=0.4).trial.label == "samples=2"


def test_the_most_accurate_is_taken_where_nothing_holds_the_error():
    found = chosen(level(4, 2.0, 0.02), level(16, 8.0, 0.01), max_error=0.001)
    assert (found.trial.level, found.holds) == ("16", False)


def test_what_is_not_seen_is_not_paid_for():
    found = chosen(level(4, 2.0, 5e-4), level(16, 8.0, 1e-6))
    assert found.trial.level == "4"
    doubtful = chosen(level(4, 2.0, 0.004), level(16, 2.9, 0.002), reference_error=0.004)
    assert doubtful.trial.level == "4"


def test_what_has_the_same_error_is_taken_only_if_it_is_known_to_be_faster():
    assert chosen(level(2, 0.7, 0.1, rounds=1)).trial.label == "standard"
    assert chosen(level(2, 0.7, 0.1)).trial.level == "2"


def test_it_is_as_sure_as_the_times_of_the_others_are_known():
    best = level(4, 2.0, 0.02)
    far = trial("samples=8", (5.0,) * 9, rmse=0.02)
    assert chosen(best, far).at_most == 0.0
    vague = trial("samples=8", (2.6, 2.1, 3.1), rmse=0.02)
    assert chosen(best, vague).sureness == "fairly sure"
    once = trial("samples=8", (2.2,), rmse=0.02)
    found = chosen(best, once)
    assert (found.trial.level, found.sureness) == ("4", "a guess")
    assert 0.25 < found.at_most < 1.0


@pytest.mark.parametrize(("left", "said"), [(0, "sure"), (1, "fairly sure"), (2, "a guess")])
def test_it_is_as_sure_as_much_was_tried(left, said):
    assert chosen(level(4, 2.0, 0.02), left_out=("samples=8", "samples=16")[:left]).sureness == said


def test_something_is_taken_though_nothing_was_tried():
    assert choose(study()).trial.label == "standard"
