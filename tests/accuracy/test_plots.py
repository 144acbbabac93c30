"""Plots of error against time: readable, with zero on a logarithmic axis, always the same."""

import dataclasses
import re
import xml.etree.ElementTree

import numpy as np
import pytest
from made_up_study import SAMPLES, changed, made_up_study

from rasterjit.accuracy.choice import pareto_front
from rasterjit.accuracy.report import plots
from rasterjit.accuracy.sentences import format_duration, format_number

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
        found.append((plots.PlotBox(*axes.bbox.extents), boxes, centres, named))
        return boxes

    monkeypatch.setattr(plots, "place_labels", recorded)
    return found


def check_labels(placed):
    (frame, boxes, centres, named) = placed.pop()
    assert len(boxes) == len(named)
    for n, box in enumerate(boxes):
        assert box.lies_within(frame)
        assert not any(box.overlaps(other) for other in boxes[:n])
        assert not any(box.left < x < box.right and box.bottom < y < box.top
                       for x, y in centres.values())  # fmt: skip
    return frame, centres


def test_labels_cover_neither_each_other_nor_a_point(placed):
    plots.plot_front(made_up_study(), "p-")
    _, centres = check_labels(placed)
    assert set(centres) == {*"1234567", "standard"}


def test_many_in_one_place_are_all_numbered(placed):
    study = made_up_study(settings=["samples"])
    for n, level in enumerate(SAMPLES):
        found = next(trial for trial in study.trials if trial.level == level)
        errors = found.errors._replace(rmse=0.0329 - 1e-4 * n)
        study = changed(study, "samples", level, {"errors": errors, "ratios": (1.0, 1.001)})
    study = dataclasses.replace(study, front=tuple(trial.label for trial in study.trials))
    plots.plot_front(study, "p-")
    _, centres = check_labels(placed)
    assert len(centres) == len(SAMPLES) + 1


def test_an_error_of_zero_lies_below_the_logarithmic_axis(placed):
    study = made_up_study(settings=["samples"])
    plots.plot_front(study, "p-")
    frame, centres = check_labels(placed)
    heights = {name: y for name, (_, y) in centres.items()}
    ordered = sorted(heights, key=heights.get)
    last = str(len(study.front))
    assert ordered[0] == last
    assert ordered[-1] == "1 standard"
    assert frame.bottom < heights[last] < heights[ordered[1]] - 10.0


@pytest.mark.parametrize(("rmse", "rounds"), [(0.0, 2), (1e-9, 9), (0.3, 1)])
def test_one_trial_is_enough(rmse, rounds):
    study = made_up_study(settings=["blending"], rounds=rounds)
    errors = study.trials[0].errors._replace(rmse=rmse)
    study = changed(study, "blending", "srgb8", {"errors": errors})
    for one in (study, made_up_study(settings=[], rounds=rounds)):
        plot = plots.plot_front(one, "p-")
        parsed(plot.svg)
        assert set(plot.positions) == {"standard", *(trial.label for trial in one.trials)}


def test_places_are_where_points_are_drawn(placed):
    study = made_up_study()
    places = plots.plot_front(study, "p-").positions
    _, _, centres, _ = placed.pop()
    width, height = plots.PLOT_SIZE
    for n, label in enumerate(study.front, 1):
        x, y = places[label]
        assert (x * width, (1.0 - y) * height) == pytest.approx(centres[str(n)])
    assert all(0.0 < share < 1.0 for place in places.values() for share in place)


def test_what_is_not_measured_well_enough_is_marked_otherwise():
    study = made_up_study(settings=["samples"])
    study = changed(study, "samples", "64", {"ratios": (61.0,), "seconds": (0.7,)})
    study = dataclasses.replace(study, front=pareto_front([study.standard, *study.trials]))
    kinds = {
        trial.label: point.kind
        for trial, point in zip(
            (*study.trials, study.standard), plots.make_plot_points(study), strict=True
        )
    }
    assert kinds["samples=64"] == "rough"
    assert kinds["samples=16"] == "other"
    assert kinds["samples=4"] == "level"


def test_the_plot_follows_the_colours_of_the_page():
    text = plots.plot_front(made_up_study(), "own-").svg
    root = parsed(text)
    assert root.get("role") == "img"
    assert "18 qualities" in root.get("aria-label")
    assert not re.search("#[0-9a-f]{6}", text), "a colour that is no variable"
    for name in plots.LIGHT_COLORS:
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

    for colors, least in ((plots.LIGHT_COLORS, 3.5), (plots.DARK_COLORS, 5.0)):
        for name in ("ink", "muted", "level", "standard"):
            low, high = sorted((luminance(colors[name]), luminance(colors["page"])))
            text = 3.0 if name == "standard" else 4.5
            assert (high + 0.05) / (low + 0.05) > max(least, text), name
        assert len(set(colors.values())) == len(colors)
    assert list(plots.LIGHT_COLORS) == list(plots.DARK_COLORS)


def test_the_users_own_matplotlib_settings_neither_matter_nor_change():
    study = made_up_study()
    plain = plots.plot_front(study, "p-")
    with matplotlib.rc_context({"font.size": 30.0, "axes.facecolor": "red", "text.usetex": False}):
        before = dict(matplotlib.rcParams)
        assert plots.plot_front(study, "p-") == plain
        assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("low", [1e-12, 3.3e-4, 0.97, 42.0])
@pytest.mark.parametrize("ratio", [1.2, 1.25, 1.9, 3.0, 3.1, 7.0, 40.0, 1e3, 1e12])
def test_axes_have_a_few_round_ticks(low, ratio):
    ticks = plots.find_log_ticks(low, low * ratio)
    shares = np.log(np.divide(ticks, low)) / np.log(ratio)
    assert 2 <= len(ticks) <= 8
    assert shares[0] > 0.02
    assert shares[-1] < 0.98
    assert (np.diff(shares) > 0.13).all(), "labels touch"
    assert len({format_number(tick) for tick in ticks}) == len(ticks)
    shown = [float(format_number(tick).replace(",", "")) for tick in ticks]
    assert shown == pytest.approx(ticks, rel=6e-3)


def test_limits_hold_all_values_and_are_not_too_narrow():
    for values in ([0.5], [1.0, 1.001], [1e-9, 3.0], [2.0, 2.0, 8.0]):
        low, high = plots.find_log_limits(values, 1.25, 0.1)
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
    assert {value: format_number(value) for value in shown} == shown


def test_times_have_their_unit():
    shown = {
        0.0124: "12.4 ms",
        3e-5: "0.03 ms",
        0.9994: "999 ms",
        3.0412: "3.04 s",
        1234.4: "1,234 s",
    }
    assert {seconds: format_duration(seconds) for seconds in shown} == shown
