"""The page of a study holds all that was found, loads nothing, and is whole or not there."""

import base64
import dataclasses
import html
import html.parser
import io
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from made_up_study import MIXED, SAMPLES, SENTENCES, SUBPIXEL, changed, made_up_study
from PIL import Image

from rasterjit.accuracy.report import crops, plots
from rasterjit.accuracy.report.page import NOTHING, PAGE_NAME, page, write_page
from rasterjit.accuracy.results import (
    COMBINATIONS,
    STANDARD,
    front_trials,
    settings_of,
    with_standard,
)

pytest.importorskip("matplotlib", reason="the extra accuracy is not installed")

VOID = {"meta", "link", "img", "br"}
LOADING = {"src", "href", "xlink:href", "srcset", "data", "action", "poster"}


class Read(html.parser.HTMLParser):
    """What is in a page: tags with their attributes, text, and whether every tag is closed."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.tags, self.words, self.open, self.rows = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th") and self.rows:
            self.rows[-1].append("")

    def handle_startendtag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script"):
            self.words.append(data)
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data

    def all(self, tag):
        return [attributes for found, attributes in self.tags if found == tag]

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def study():
    return made_up_study()


@pytest.fixture(scope="module")
def read(study):
    found = Read(page(study, SENTENCES))
    assert found.open == []
    return found


def decoded(attributes):
    kind, _, data = attributes["src"].partition("base64,")
    assert kind == "data:image/png;"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data, validate=True))))


def test_everything_that_was_found_is_on_the_page(study, read):
    assert read.tags[0][0] == "html"
    for trial in study.trials:
        name = trial.label if trial.setting == COMBINATIONS else trial.level
        assert any(name in row[0] for row in read.rows if row), trial.label
    for words in (
        study.scene, "160 × 100 pixels", "2 threads", "9 rounds", *study.left_out,
        *study.machine, *study.machine.values(), *study.versions, *study.versions.values(),
        *study.without_effect, *study.without_effect.values(), *SENTENCES.values(), "3.21 s",
        *study.impossible, *study.impossible.values(), "There was no time left for",
    ):  # fmt: skip
        assert " ".join(words.split()) in read.text, words


def test_rows_hold_the_numbers(read):
    rows = {row[0]: row[1:] for row in read.rows if row and len(row) == 10}
    assert rows["area"] == [
        "1.58×1.54–1.62", rows["area"][1], "0.0062", "0.124", "44.2", "0.0031", "124", NOTHING,
        NOTHING,
    ]  # fmt: skip
    assert not any("uv" in row[-1] for row in read.rows if row), "no level has a texture"
    assert rows["256"][2:5] == ["0", "0", "∞"]
    assert rows["float32"][4:8] == ["29.7", NOTHING, "658", "3"]
    assert float(rows["area"][1]) == pytest.approx(1.58 * 12.4, rel=0.03)


def test_dominated_levels_are_grey_and_name_what_dominates_them(read):
    rows = [attributes for attributes in read.all("tr") if attributes.get("class") == "dominated"]
    named = [row[0] for row in read.rows if row and "dominated by" in row[0]]
    single, mixed = (
        [f"{level}dominated by {found[2]}" for level, found in levels.items() if found[2]]
        for levels in ({**SAMPLES, **SUBPIXEL}, MIXED)
    )
    assert sorted(named) == sorted([*single, *single, *mixed]), "in results and in stages"
    assert len(rows) == len(named)
    others = [attributes for attributes in read.all("tr") if attributes.get("class") == "other"]
    assert len(others) == 1, "the combination that is not on the front"


def test_levels_stand_in_their_order_with_the_standard_among_them(study, read):
    names = [row[0] for row in read.rows if row and len(row) == 10]
    first = names.index("1 (standard)")
    assert [re.sub("dominated.*", "", n) for n in names[first : first + 8]] == [
        "1 (standard)", "2", "4", "8", "16", "area", "64", "256",
    ]  # fmt: skip
    assert [t.level for t in with_standard(study, "subpixel_bits")] == ["0", "4", STANDARD, "12"]


def test_sections_are_linked(study, read):
    anchors = {attributes["id"] for attributes in read.all("section")}
    links = {attributes["href"].removeprefix("#") for attributes in read.all("a")}
    assert links == anchors
    assert set(settings_of(study)) | {"front", "machine", "left-out"} <= anchors


def test_ids_are_given_once_and_what_is_referred_to_is_there(read):
    ids = [attributes["id"] for _, attributes in read.tags if "id" in attributes]
    assert len(set(ids)) == len(ids)
    for _, attributes in read.tags:
        for name in ("href", "xlink:href"):
            if attributes.get(name, "").startswith("#"):
                assert attributes[name][1:] in ids
        for used in re.findall(r"url\(#(.*?)\)", attributes.get("clip-path", "")):
            assert used in ids


def test_every_image_decodes_and_is_described(read):
    images = read.all("img")
    assert len(images) > 2 * 15
    for attributes in images:
        picture = decoded(attributes)
        assert attributes["alt"].strip()
        assert picture.ndim == 3
        if attributes.get("class") != "scale":
            assert picture.shape[:2] == (int(attributes["height"]), int(attributes["width"]))
    for attributes in read.all("svg"):
        assert attributes.get("aria-hidden") == "true" or attributes["aria-label"].strip()


def test_nothing_is_loaded(study):
    text = page(study, SENTENCES)
    read = Read(text)
    assert not read.all("script")
    assert not read.all("iframe")
    for tag, attributes in read.tags:
        for name in LOADING & set(attributes):
            assert attributes[name].startswith(("data:", "#")), (tag, name)
        assert not any(name.startswith("on") for name in attributes)
    assert not re.search(r"@import|url\((?!#)", text)


def test_what_has_special_characters_is_escaped(study):
    text = page(study, SENTENCES)
    for words in (study.scene, SENTENCES["samples"], study.machine["cpu"], study.left_out[1]):
        assert words not in text
        assert html.escape(words) in text


@pytest.mark.parametrize("name", ["<b>&\"'", "$x^2$ $", "\N{CJK UNIFIED IDEOGRAPH-4E2D} {0} %s"])
def test_any_level_scene_or_reason_can_be_shown(name):
    study = made_up_study(settings=["subpixel_bits"], scene=name)
    study = changed(study, "subpixel_bits", "12", {"level": name})
    study = dataclasses.replace(study, without_effect={name: name}, left_out=(name,))
    read = Read(page(study, {"subpixel_bits": name}))
    assert read.open == []
    assert any(row and row[0] == name for row in read.rows)
    assert " ".join(read.words).count(name) >= 6


def test_the_same_study_makes_the_same_bytes(study, tmp_path):
    code = (
        "import sys; from made_up_study import SENTENCES, made_up_study\n"
        "from rasterjit.accuracy.report.page import write_page\n"
        "write_page(made_up_study(), sys.argv[1], SENTENCES)"
    )
    where = os.pathsep.join([os.path.dirname(__file__), *filter(None, sys.path)])
    other = tmp_path / "other"
    subprocess.run(
        [sys.executable, "-W", "error", "-c", code, str(other)],
        check=True, env={**os.environ, "PYTHONPATH": where, "SOURCE_DATE_EPOCH": "1"},
    )  # fmt: skip
    here = write_page(study, tmp_path / "here", SENTENCES)
    assert here.read_bytes() == (other / PAGE_NAME).read_bytes()


def test_a_page_is_written_whole_or_not_at_all(study, tmp_path, monkeypatch):
    place = write_page(study, tmp_path / "new" / "report", {})
    assert place == tmp_path / "new" / "report" / PAGE_NAME
    before = place.read_bytes()
    assert before.endswith(b"</html>\n")

    def failing(*_):
        raise OSError("no space left")

    monkeypatch.setattr("rasterjit.io.images.os.replace", failing)
    with pytest.raises(OSError, match="no space left"):
        write_page(made_up_study(rounds=1), place.parent, SENTENCES)
    assert place.read_bytes() == before
    assert list(place.parent.iterdir()) == [place]


@pytest.mark.parametrize("folder", [None, 3, b"x\0"[:0] or 0.5])
def test_what_is_no_folder_name_is_refused(study, folder):
    with pytest.raises(ValueError, match=f"folder must be .*{folder!r}"):
        write_page(study, folder, {})


def test_a_file_in_place_of_the_folder_is_refused_and_kept(study, tmp_path):
    place = tmp_path / "report"
    place.write_text("kept")
    with pytest.raises(ValueError, match=r"folder must be a folder, got '.*report', which is a"):
        write_page(study, place, {})
    assert place.read_text() == "kept"


def test_without_matplotlib_it_says_what_to_install(study, tmp_path, monkeypatch):
    monkeypatch.setattr(plots.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r'matplotlib; pip install "rasterjit\[accuracy\]"'):
        write_page(study, tmp_path, {})
    assert not list(tmp_path.iterdir())


def test_an_interrupted_study_makes_a_page_too():
    study = made_up_study(settings=[])
    study = dataclasses.replace(study, left_out=("samples=2",), interrupted=True)
    read = Read(page(study, {}))
    assert read.open == []
    assert "The study was interrupted before: samples=2" in read.text
    assert len(read.all("svg")) == 2, "the front and the hidden thumbnail"


def test_a_single_round_has_no_spread():
    read = Read(page(made_up_study(rounds=1), {}))
    assert "timed once" in read.text
    assert any(row[:2] == ["area", "1.58×"] for row in read.rows if row)


def test_how_much_times_varied_is_said(study, read):
    trial = max(study.trials, key=lambda t: (t.spread[1] - t.spread[0]) / t.ratio)
    most = 100.0 * (trial.spread[1] - trial.spread[0]) / trial.ratio
    assert 1.0 < most < 6.0
    assert f"{most:.3g} % for {trial.label} , which varied most" in read.text


def test_the_front_is_listed_from_the_fastest_on(study, read):
    listed = [row[0] for row in read.rows if row and re.match(r"\d+ [a-z]", row[0])]
    trials = front_trials(study)
    wanted = [f"{n} {trial.label}" for n, trial in enumerate(trials, 1)]
    assert wanted[0] == "1 draft"
    assert listed[0].startswith("1 draftshading=vertex texture_filter=nearest")
    assert listed[1 : len(wanted)] == wanted[1:]
    assert STANDARD not in study.front
    rows = [row for row in read.rows if row]
    first = next(n for n, row in enumerate(rows) if row[0] == listed[0])
    assert rows[first - 1][0] == "standard"
    # Then those of them that are combinations, once more.
    assert {name.partition("=")[0] for name in listed[len(wanted) :]} < {
        name.partition("=")[0] for name in listed[: len(wanted)]
    }
    assert [t.ratio for t in trials] == sorted(t.ratio for t in trials)
    assert [t.errors.rmse for t in trials] == sorted((t.errors.rmse for t in trials), reverse=True)


def test_a_crop_shows_where_levels_differ_rather_than_where_all_are_wrong():
    wrong, right = np.zeros((2, 90, 120), np.float32)
    wrong[10:20, 10:20] = right[10:20, 10:20] = 0.9
    wrong[60, 80] = 0.1
    crop = crops.choose_crop([wrong, right])
    assert (crop.width, crop.height) == crops.CROP_SIZE
    assert crop.of(wrong).max() == np.float32(0.1)
    assert crop.column < 80 < crop.column + crop.width - 1
    assert crop.row < 60 < crop.row + crop.height - 1
    assert crops.choose_crop([right, right]).of(right).sum() == right.sum()


@pytest.mark.parametrize("shape", [(1, 1), (5, 200), (200, 7), (36, 48)])
def test_a_crop_lies_in_the_picture(shape):
    for at in ((0, 0), (shape[0] - 1, shape[1] - 1)):
        error = np.zeros(shape, np.float32)
        error[at] = 1.0
        crop = crops.choose_crop([error])
        assert crop.of(error).shape == (min(36, shape[0]), min(48, shape[1]))
        assert crop.of(error).max() == 1.0
    assert crops.choose_crop([np.zeros(shape, np.float32)])[:2] == (0, 0)


def test_brighter_is_more_wrong_up_to_the_stated_top():
    for largest, top in ((0.03, 0.05), (1.0, 1.0), (0.0051, 0.01), (2e-7, 2e-7), (0.0, 1.0)):
        error = np.linspace(0.0, largest, 50, dtype=np.float32)[None]
        assert crops.heat_top([error[:, :3], error]) == pytest.approx(top, rel=1e-6)
    colors = crops.heat(np.linspace(0.0, 1.0, 30, dtype=np.float32)[None], 1.0).astype(float)
    brightness = colors[0] @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(brightness) > 0.0).all()
    assert (colors[0, 0] == crops.heat(np.float32([[0.0]]), 0.3)[0, 0]).all()
    assert (colors[0, -1] == crops.heat(np.float32([[0.7]]), 0.5)[0, 0]).all()


def test_levels_with_the_same_errors_are_said_to_have_them(read):
    study = made_up_study(settings=["precision"])
    study = changed(study, "precision", "float32", {"error_map": study.standard.error_map})
    said = "All levels have the same errors, most of them here: columns"
    assert said in Read(page(study, {})).text
    assert said in read.text, "of blending"
    assert "Where the levels differ most: columns" in read.text


def test_what_has_no_effect_is_said_once(study):
    read = Read(page(study, {**SENTENCES, "shadow_taps": "changes nothing"}))
    assert "changes nothing" not in read.text
    assert read.text.count(study.without_effect["shadow_taps"]) == 1
