import pytest
from made_trials import study, trial

import rasterjit as rj
from rasterjit.accuracy.sentences import most_telling, sentences


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
    assert most_telling(levels, trial()).level == "8"


def test_where_nothing_is_more_accurate_the_fastest_worthwhile_level_is_told():
    fast = trial("shading=face", (0.7,) * 5, rj.Quality(shading="face"), "standard", rmse=0.9)
    worth = trial("shading=vertex", (0.8,) * 5, rj.Quality(shading="vertex"), rmse=0.3)
    assert most_telling([fast, worth], trial()) is worth
    assert said(fast).endswith("; not worth it here.")


def test_every_level_of_every_setting_has_words():
    for setting, levels in rj.accuracy.knobs.LEVELS.items():
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
    assert most_telling(levels, trial(rmse=0.1)).level == "8"


def test_a_time_of_one_round_is_no_claim():
    once = study([trial("samples=2", (1.3,), rmse=0.05)])
    assert "few rounds" in sentences(once)["samples"]
