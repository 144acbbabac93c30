"""Plots of error against time: readable, with zero on a logarithmic axis, always the same."""

import re
import xml.etree.ElementTree

import numpy as np
import pytest
from made_up_study import SAMPLES, changed, made_up_study

from rasterjit.accuracy.report import plots, scales

matplotlib = pytest.importorskip("matplotlib", reason="the extra accuracy is not installed")


def parsed(text):
    """An SVG element of a page, read as the XML that it is."""
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    return xml.etree.ElementTree.fromstring(text.replace("<svg", f"<svg {spaces}", 1))


@pytest.fixture
def placed(monkeypatch):
    """What the labels of plots take, gathered while they are drawn."""
    found = []

    place_labels = plots.place_labels

    def recorded(axes, points, **options):
        boxes = place_labels(axes, points, **options)
        to_points = axes.transData.transform
        named = [point for point in points if point[2]]
        centres = {point[2]: to_points(point[:2]) for point in named}
        found.append((plots.Box(*axes.bbox.extents), boxes, centres, named))
        return boxes

    monkeypatch.setattr(plots, "place_labels", recorded)
    return found


def check_labels(placed):
    (frame, boxes, centres, named) = placed.pop()
    assert len(boxes) == len(named)
    for n, box in enumerate(boxes):
        assert box.within(frame)
        assert not any(box.common(other) for other in boxes[:n])
        assert not any(box.left < x < box.right and box.bottom < y < box.top
                       for x, y in centres.values())  # fmt: skip
    return frame, centres


def test_labels_cover_neither_each_other_nor_a_point(placed):
    study = made_up_study()
    for setting in ("samples", "subpixel_bits", "precision", "blending"):
        plots.plot_setting(study, setting, "p-")
        check_labels(placed)
    plots.plot_front(study, "p-")
    check_labels(placed)


def test_levels_in_one_place_are_all_named(placed):
    study = made_up_study(settings=["samples"])
    for level in SAMPLES:
        found = next(trial for trial in study.trials if trial.level == level)
        errors = found.errors._replace(rmse=0.0329)
        study = changed(study, "samples", level, {"errors": errors, "ratios": (1.0, 1.001)})
    plots.plot_setting(study, "samples", "p-")
    _, centres = check_labels(placed)
    assert set(centres) == {*SAMPLES, "1 (standard)"}


def test_an_error_of_zero_lies_below_the_logarithmic_axis(placed):
    study = made_up_study(settings=["samples"])
    plots.plot_setting(study, "samples", "p-")
    frame, centres = check_labels(placed)
    heights = {name: y for name, (_, y) in centres.items()}
    ordered = sorted(heights, key=heights.get)
    assert ordered[0] == "256"
    assert ordered[-1] == "1 (standard)"
    assert frame.bottom < heights["256"] < heights["64"] - 10.0


@pytest.mark.parametrize("rmse", [0.0, 1e-9, 0.3])
@pytest.mark.parametrize("rounds", [1, 2, 9])
def test_one_trial_is_enough(rmse, rounds):
    study = made_up_study(settings=["blending"], rounds=rounds)
    errors = study.trials[0].errors._replace(rmse=rmse)
    study = changed(study, "blending", "srgb8", {"errors": errors})
    parsed(plots.plot_setting(study, "blending", "p-"))
    parsed(plots.plot_front(study, "p-"))
    parsed(plots.plot_front(made_up_study(settings=[], rounds=rounds), "p-"))


def test_plots_follow_the_colours_of_the_page():
    text = plots.plot_setting(made_up_study(), "samples", "own-")
    root = parsed(text)
    assert root.get("role") == "img"
    for level in SAMPLES:
        assert level in root.get("aria-label")
    assert not re.search("#[0-9a-f]{6}", text), "a colour that is no variable"
    for name in plots.LIGHT:
        assert f"var(--{name})" in text
    ids = [element.get("id") for element in root.iter() if element.get("id")]
    assert ids
    assert all(name.startswith("own-") for name in ids)
    assert "<text" not in text
    assert not re.search("http|<!--|<style|<metadata", text)


def test_colours_are_told_apart_on_light_and_dark_pages():
    def luminance(color):
        parts = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return linear @ [0.2126, 0.7152, 0.0722]

    for colors, least in ((plots.LIGHT, 3.5), (plots.DARK, 5.0)):
        for name in ("ink", "muted", "level", "standard"):
            low, high = sorted((luminance(colors[name]), luminance(colors["page"])))
            assert (high + 0.05) / (low + 0.05) > least, name
        assert len(set(colors.values())) == len(colors)
    assert list(plots.LIGHT) == list(plots.DARK)


def test_the_users_own_matplotlib_settings_neither_matter_nor_change():
    study = made_up_study()
    plain = plots.plot_setting(study, "samples", "p-")
    with matplotlib.rc_context({"font.size": 30.0, "axes.facecolor": "red", "text.usetex": False}):
        before = dict(matplotlib.rcParams)
        assert plots.plot_setting(study, "samples", "p-") == plain
        assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("low", [1e-12, 3.3e-4, 0.97, 42.0])
@pytest.mark.parametrize("ratio", [1.2, 1.25, 1.9, 3.0, 3.1, 7.0, 40.0, 1e3, 1e12])
def test_axes_have_a_few_round_ticks(low, ratio):
    ticks = scales.log_ticks(low, low * ratio)
    shares = np.log(np.divide(ticks, low)) / np.log(ratio)
    assert 2 <= len(ticks) <= 8
    assert shares[0] > 0.02
    assert shares[-1] < 0.98
    assert (np.diff(shares) > 0.13).all(), "labels touch"
    assert len({scales.number(tick) for tick in ticks}) == len(ticks)
    shown = [float(scales.number(tick).replace(",", "")) for tick in ticks]
    assert shown == pytest.approx(ticks, rel=6e-3)


def test_limits_hold_all_values_and_are_not_too_narrow():
    for values in ([0.5], [1.0, 1.001], [1e-9, 3.0], [2.0, 2.0, 8.0]):
        low, high = scales.log_limits(values, 1.25, 0.1)
        assert low < min(values) <= max(values) < high
        assert high / low >= 1.25
        assert low * high == pytest.approx(min(values) * max(values)), "in the middle"


def test_numbers_are_short():
    shown = {
        0.0: "0",
        1e-7: "1e-7",
        0.021349: "0.0213",
        2.0: "2",
        1234.4: "1,234",
        1.5e12: "1.5e12",
    }
    assert {value: scales.number(value) for value in shown} == shown


def test_times_have_their_unit():
    shown = {
        0.0124: "12.4 ms",
        3e-5: "0.03 ms",
        0.9994: "999 ms",
        3.0412: "3.04 s",
        1234.4: "1,234 s",
    }
    assert {seconds: scales.duration(seconds) for seconds in shown} == shown
