import dataclasses

import pytest
from made_trials import study, trial

import rasterjit as rj
from rasterjit.accuracy.choice import pareto_front
from rasterjit.accuracy.results import CPU
from rasterjit.accuracy.sentences import (
    NOT_MEASURED,
    answer,
    describe_alternatives,
    describe_certainty,
    describe_choice,
    describe_factor,
    find_key_level,
    format_options,
    sentences,
)


def samples(count, ratio, **found):
    ratios = (ratio,) * 5
    return trial(f"samples={count}", ratios, rj.Quality(samples=count), **found)


def said(one, standard=None):
    return sentences(study([one], without_effect={}, standard=standard or trial()))[one.setting]


def test_the_sentence_of_the_issue():
    assert said(samples(8, 1.41, rmse=0.1 / 2.1)) == (
        "8 samples instead of 1 sample: +41 % time, error 2.1× lower."
    )


@pytest.mark.parametrize(
    ("one", "text"),
    [
        (samples(8, 0.9, rmse=0.1), "−10 % time, the same error"),
        (samples(8, 3.0, rmse=0.0), "3.0× the time, no error left"),
        (samples(8, 1.001, rmse=0.3), "the same time within the noise, error 3.0× higher"),
        (samples(8, 0.5, rmse=0.1001), "−50 % time, nearly the same error"),
        (samples(8, 0.5, rmse=0.104), "−50 % time, error 1.04× higher"),
        (samples(8, 0.5, depth_units=0.03), "depth wrong by up to 0.03 units instead of 0"),
        (samples(8, 0.5, wrong_faces=1234), "the same error, 1,234 wrong pixels instead of 0"),
    ],
)
def test_time_and_error_are_in_words(one, text):
    assert text in said(one)


def test_an_error_where_there_was_none_is_told_as_it_is():
    assert "error 0.2 instead of none" in said(samples(8, 1.5, rmse=0.2), trial(rmse=0.0))


def test_a_setting_without_effect_says_why():
    found = sentences(study())
    assert found == {"shadow_size": "shadow_size changes nothing here: no light casts them."}


def test_the_level_that_buys_most_for_its_time_is_told():
    levels = [
        samples(2, 1.3, rmse=0.07), samples(8, 1.6, rmse=0.02), samples(16, 9.0, rmse=0.019),
        samples(256, 9.0, rmse=0.0),
    ]  # fmt: skip
    assert find_key_level(levels, trial()).level == "8"


def test_where_nothing_is_more_accurate_the_fastest_worthwhile_level_is_told():
    fast = trial("shading=face", (0.7,) * 5, rj.Quality(shading="face"), "standard", rmse=0.9)
    worth = trial("shading=vertex", (0.8,) * 5, rj.Quality(shading="vertex"), rmse=0.3)
    assert find_key_level([fast, worth], trial()) is worth
    assert said(fast).endswith("; not worth it here.")


def test_every_level_of_every_setting_has_words():
    for setting, levels in rj.accuracy.settings_to_try.LEVELS.items():
        for level in levels:
            one = trial(f"{setting}={level}", quality=rj.Quality(**{setting: level}))
            text = said(one)
            assert text[0].isupper() or text[0].isdigit()
            assert "{" not in text


def test_where_nothing_is_more_accurate_the_best_bargain_is_told():
    levels = [
        trial("transparency_layers=1", (0.37,) * 5, rmse=1.3),
        trial("transparency_layers=4", (0.54,) * 5, rmse=0.16),
        trial("transparency_layers=8", (0.76,) * 5, rmse=0.1001),
    ]
    assert find_key_level(levels, trial(rmse=0.1)).level == "8"


def test_a_time_of_one_round_is_no_claim():
    once = study([trial("samples=2", (1.3,), rmse=0.05)])
    assert f"a time {NOT_MEASURED}" in sentences(once)["samples"]
    slow = sentences(study([trial("samples=256", (300.0,), rmse=0.0)]))["samples"]
    assert f"more time, how much is {NOT_MEASURED}" in slow
    assert "300" not in slow


@pytest.mark.parametrize(
    ("ratios", "text"),
    [
        ((5.8,), NOT_MEASURED),
        ((5.8, 2.5), NOT_MEASURED),
        ((1.2, 2.5, 5.8), NOT_MEASURED),
        ((2.5, 2.5, 2.5), "2.5×"),
        ((2.4, 2.5, 2.7), "2.5× (2.2 to 2.8)"),
        ((2.4, 2.5, 2.6) * 30, "2.5×"),
        ((0.54,) * 5, "0.54×"),
        ((120.0,) * 5, "120×"),
    ],
)
def test_a_factor_is_claimed_only_where_the_rounds_give_it(ratios, text):
    assert describe_factor(trial("samples=4", ratios)) == text


def answered(*trials, standard=None):
    standard = standard or trial(rmse=0.1)
    return describe_alternatives(
        study(trials, pareto_front([standard, *trials]), standard=standard)
    )


def test_what_else_there_is_is_the_standard_twice_its_time_and_half():
    assert answered(
        samples(2, 1.3, rmse=0.07), samples(4, 2.2, rmse=0.04), samples(8, 5.0, rmse=0.02),
        trial("shading=face", (0.45,) * 5, rj.Quality(shading="face"), rmse=0.13),
    ) == (
        "On this scene standard is 10 ms with error 0.1; for 2.2× the time you get 2.5× less error "
        "with 4 samples, for 0.45× the time you get 1.3× the error with light by the face."
    )  # fmt: skip


def test_the_answer_claims_no_factor_of_one_round():
    said = answered(samples(4, 2.2, rmse=0.04), trial("samples=16", (5.8,), rmse=0.01))
    assert "5.8" not in said
    assert "2.2× the time" in said


def test_where_nothing_is_measured_well_rough_factors_are_given_as_such():
    said = answered(
        trial("samples=16", (5.8,), rj.Quality(samples=16), rmse=0.01),
        trial("samples=8", (5.9,), rj.Quality(samples=8), rmse=0.02),
        trial("shading=face", (0.4,), rj.Quality(shading="face"), rmse=0.2),
    )
    assert said == (
        "On this scene standard is 10 ms with error 0.1; for about 5.8× the time you get 10.0× "
        "less error with 16 samples, for about 0.40× the time you get 2.0× the error with light by "
        "the face."
    )
    assert NOT_MEASURED in answered(trial("samples=2", (1.3,), rmse=0.05))


def test_the_answer_says_what_to_take_what_it_costs_and_buys_and_how_sure_it_is():
    four = samples(4, 2.2, rmse=0.04)
    found = study([four, samples(8, 5.0, rmse=0.02)], ("samples=4",), left_out=())
    assert answer(dataclasses.replace(found, standard=trial(rmse=0.1))).startswith(
        "Take 4 samples: 2.2× the time of standard (22 ms a frame instead of 10 ms) for 2.5× less "
        "error (error 0.04 instead of 0.1). Sure: errors are exact, against a reference of 256 "
        "samples; and nothing else that was tried can be better in time × error. On this scene "
    )


def test_a_quality_is_named_however_badly_it_was_timed():
    once = study(
        [samples(16, 5.0, rmse=0.01), samples(8, 5.0, rmse=0.011)], standard=trial(rmse=0.1)
    )
    once = dataclasses.replace(
        once, trials=tuple(dataclasses.replace(one, ratios=(5.0,)) for one in once.trials)
    )
    assert describe_choice(once).startswith("Take 16 samples: about 5.0× the time of standard")
    assert describe_certainty(once).startswith("A guess: ")


def test_processor_times_are_called_so():
    found = study([samples(4, 2.2, rmse=0.04)], clock=CPU, standard=trial(rmse=0.1))
    assert "22 ms of processor time a frame" in describe_choice(found)
    assert "the machine is busy" in describe_certainty(found)


def test_what_was_cut_is_said():
    small = study(
        [samples(4, 2.2, rmse=0.04)], asked_size=(60, 40), reference_samples=64,
        reference_error=0.0012,
    )  # fmt: skip
    said = describe_certainty(small)
    assert "a reference of 64 samples, for which there was time and which errs by 0.0012" in said
    assert "1 quality was not tried: there was no time." in said
    assert "It was measured at 6 × 4 pixels, not at 60 × 40" in said


def test_an_error_that_nothing_holds_is_said():
    found = study([samples(4, 2.2, rmse=0.04)], max_error=0.01, standard=trial(rmse=0.1))
    said = describe_choice(found)
    assert said.startswith("Nothing that was tried has an error of 0.01. Take 4 samples: ")


def test_options_are_what_the_command_line_takes():
    assert format_options(samples(4, 2.2), trial()) == "--set samples=4"
    assert format_options(trial("high", (3.0,), rj.Quality.high()), trial()) == "--quality high"
    assert format_options(trial(), trial()) == "--quality standard"


def test_the_answer_names_what_is_better_in_the_same_time_or_as_good_in_less():
    finer = trial("subpixel_bits=12", (1.001,) * 5, rj.Quality(subpixel_bits=12), rmse=0.05)
    assert "for the same time you get 2.0× less error with 12 sub-pixel bits" in answered(finer)
    faster = trial("precision=float32", (0.8,) * 5, rj.Quality(precision="float32"), rmse=0.1)
    assert "for 0.80× the time you get the same error with float32 vertices." in answered(faster)


def test_the_answer_does_not_pass_over_wrong_pixels():
    coarse = trial(
        "subpixel_bits=4", (0.8,) * 5, rj.Quality(subpixel_bits=4), rmse=0.1, wrong_faces=1391
    )
    assert "the same error with 4 sub-pixel bits (1,391 wrong pixels instead of 0)" in answered(
        coarse
    )


def test_the_answer_says_where_there_is_nothing_to_choose():
    equal = trial("lines=coverage", rmse=0.1)
    assert answered(equal).endswith("faster or more accurate, as far as can be told.")
    assert answered().endswith("; no other quality was tried.")
    doubtful = trial("samples=2", (1.3,), rmse=0.05)
    assert "nothing else is better by more than the noise, or it is not" in answered(
        equal, doubtful
    )
    assert "1.3" not in answered(equal, doubtful)


def test_a_preset_is_called_by_its_name():
    high = trial("high", (3.0,) * 5, rj.Quality.high(), rmse=0.01)
    assert "10.0× less error with quality high." in answered(high)
