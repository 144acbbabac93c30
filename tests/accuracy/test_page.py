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
from made_up_study import SAMPLES, SENTENCES, SUBPIXEL, changed, made_up_study
from PIL import Image

from rasterjit.accuracy.choice import choose, pareto_front
from rasterjit.accuracy.report import picture_crops, plots
from rasterjit.accuracy.report.page import NO_VALUE, PAGE_NAME, render_page, write_page
from rasterjit.accuracy.results import (
    COMBINATIONS,
    CPU,
    STANDARD,
    EffectCost,
    insert_standard,
    list_front_trials,
)
from rasterjit.accuracy.sentences import (
    NOT_MEASURED,
    describe_alternatives,
    describe_certainty,
    describe_choice,
    format_options,
)

pytest.importorskip("matplotlib", reason="the extra accuracy is not installed")

VOID = {"meta", "link", "img", "br", "input"}
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
    found = Read(render_page(study, SENTENCES))
    assert found.open == []
    return found


def decoded(attributes):
    kind, _, data = attributes["src"].partition("base64,")
    assert kind == "data:image/webp;"
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
        *study.impossible, *study.impossible.values(), "No time was left for",
        describe_choice(study), describe_certainty(study), describe_alternatives(study),
    ):  # fmt: skip
        assert " ".join(words.split()) in read.text, words


def test_rows_hold_the_numbers(read):
    rows = {re.sub(r"^\d ", "", row[0]): row[1:] for row in read.rows if row and len(row) == 10}
    assert rows["area"] == [
        "1.6×1.5–1.6", rows["area"][1], "0.0062", "0.124", "44.2", "0.0031", "124", NO_VALUE,
        NO_VALUE,
    ]  # fmt: skip
    assert not any("uv" in row[-1] for row in read.rows if row), "no level has a texture"
    assert rows["256"][2:5] == ["0", "0", "∞"]
    assert rows["float32"][4:8] == ["29.7", NO_VALUE, "658", "3"]
    assert float(rows["area"][1]) == pytest.approx(1.58 * 12.4, rel=0.03)


def test_dominated_levels_are_grey_and_name_what_dominates_them(read):
    rows = [attributes for attributes in read.all("tr") if attributes.get("class") == "dominated"]
    named = [row[0] for row in read.rows if row and "dominated by" in row[0]]
    wanted = [
        f"{level}dominated by {found[2]}"
        for level, found in {**SAMPLES, **SUBPIXEL}.items()
        if found[2]
    ]
    assert sorted(named) == sorted(wanted)
    assert len(rows) == len(named)


def test_levels_stand_in_their_order_with_the_standard_among_them(study, read):
    names = [row[0] for row in read.rows if row and len(row) == 10]
    first = names.index("1 (standard)")
    assert [re.sub("dominated.*|^[0-9] ", "", n) for n in names[first + 1 : first + 8]] == [
        "2", "4", "8", "16", "area", "64", "256",
    ]  # fmt: skip
    assert [t.level for t in insert_standard(study, "subpixel_bits")] == ["0", "4", STANDARD, "12"]


def test_the_answer_comes_first(study, read):
    said = (
        describe_choice(study),
        describe_certainty(study),
        describe_alternatives(study),
        "Error against time",
    )
    places = [read.text.index(text) for text in said]
    assert places == sorted(places)
    assert read.text.index("Error against time") < read.text.index("Worth choosing")


def test_every_trial_has_a_point_that_can_be_chosen(study, read):
    points = [one for one in read.all("input") if one["type"] == "radio"]
    assert {one["data-name"] for one in points} == {
        STANDARD, *(trial.label for trial in study.trials)
    }  # fmt: skip
    assert [one["data-name"] for one in points if "checked" in one] == [STANDARD]
    assert len({one["name"] for one in points}) == 1, "arrow keys go through all of them"
    shown = {one["id"] for one in read.all("figure") if one.get("id", "").startswith("shot-")}
    assert {one["value"] for one in points} == shown
    for one in points:
        assert one["aria-label"] == f"{one['data-name']}: {one['data-found']}"
    places = [float(re.search(r"left: ([\d.]+)%", one["style"]).group(1)) for one in points]
    assert places == sorted(places), "from the fastest on"


def test_options_give_the_quality_that_was_measured(study, read):
    options = {one["data-name"]: one["data-options"] for one in read.all("input")[:-1]}
    assert options["samples=4"] == "--set samples=4"
    assert options["draft"] == "--quality draft"
    assert options["samples=4 shading=vertex"] == "--set samples=4 --set shading=vertex"
    assert format_options(study.standard, study.standard) == "--quality standard"


def test_no_factor_is_given_of_one_round():
    study = made_up_study()
    study = changed(study, "samples", "16", {"ratios": (5.83,), "seconds": (0.0723,)})
    study = changed(study, "samples", "64", {"ratios": (61.0, 88.0, 31.0), "seconds": (0.7,) * 3})
    study = dataclasses.replace(study, front=pareto_front([study.standard, *study.trials]))
    text = render_page(study, {})
    read = Read(text)
    told = read.text + " ".join(one.get("data-found", "") for one in read.all("input"))
    assert not re.search(r"5\.8|61\.0×", told)
    rows = {row[0]: row for row in read.rows if row}
    assert rows["16dominated by samples=area"][1:3] == [NOT_MEASURED, "≈ 72.3"]
    assert rows["64"][1] == NOT_MEASURED
    point = next(
        one for one in read.all("input") if one.get("data-name") == "samples=16"
    )  # fmt: skip
    assert f"about 72.3 ms ({NOT_MEASURED}, 1 round)" in point["data-found"]


def test_pictures_that_look_alike_are_kept_once(study):
    study = changed(study, "subpixel_bits", "0", {"color": study.standard.color,
                    "error_map": study.standard.error_map})  # fmt: skip
    study = changed(study, "subpixel_bits", "12", {"color": study.standard.color,
                    "error_map": study.standard.error_map})  # fmt: skip
    album = picture_crops.make_album(study)
    assert album.ids["subpixel_bits=0"] == album.ids["subpixel_bits=12"]
    captions = [shot.caption for group in album.groups for shot in group.shots]
    assert "subpixel_bits=0; subpixel_bits=12" in captions
    names = [shot.name for group in album.groups for shot in group.shots]
    assert len(set(names)) == len(names)
    assert set(album.ids.values()) == set(names)


def test_pictures_are_smaller_where_there_are_many_count_bytes_them(monkeypatch):
    rng = np.random.default_rng(5)
    study = made_up_study()
    for one in study.trials:
        noise = rng.integers(0, 256, (200, 300, 3), np.uint8)
        errors = rng.random((200, 300), np.float32)
        fields = {"color": noise, "error_map": errors}
        study = changed(study, one.setting, one.level, fields)
    standard = dataclasses.replace(study.standard, color=noise, error_map=errors)
    study = dataclasses.replace(study, standard=standard, reference_color=noise, size=(300, 200))
    album = picture_crops.make_album(study)
    assert album.size in picture_crops.CROP_SIZES[1:], "too much for the largest"
    assert picture_crops.count_bytes(album) <= picture_crops.MAX_ALBUM_BYTES
    assert len(render_page(study, {}).encode()) < 2_000_000
    monkeypatch.setattr(picture_crops, "MAX_ALBUM_BYTES", 0)
    assert picture_crops.make_album(study).size == picture_crops.CROP_SIZES[-1]


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
    images = [one for one in read.all("img") if one["src"] != "data:,"]
    assert len(images) > 2 * 15
    for attributes in images:
        picture = decoded(attributes)
        assert attributes["alt"].strip()
        assert picture.shape == (100, 160, 3)
    for attributes in read.all("svg"):
        assert attributes.get("aria-hidden") == "true" or attributes["aria-label"].strip()


def test_nothing_is_loaded(study):
    text = render_page(study, SENTENCES)
    read = Read(text)
    assert read.all("script") == [{"type": "module"}]
    assert not re.search(r"^import\b|\bfrom [\"']", text, re.MULTILINE)
    assert not read.all("iframe")
    policy = next(one["content"] for one in read.all("meta") if "http-equiv" in one)
    assert policy.startswith("default-src 'none'; img-src data:;")
    assert not re.search(r"fetch|XMLHttp|import\(|WebSocket", text)
    for tag, attributes in read.tags:
        for name in LOADING & set(attributes):
            assert attributes[name].startswith(("data:", "#")), (tag, name)
        assert not any(name.startswith("on") for name in attributes)
    assert not re.search(r"@import|url\((?!#)", text)


def test_what_has_special_characters_is_escaped(study):
    text = render_page(study, SENTENCES)
    for words in (study.scene, SENTENCES["samples"], study.machine["cpu"], study.left_out[1]):
        assert words not in text
        assert words in html.unescape(text)


@pytest.mark.parametrize("name", ["<b>&\"'", "$x^2$ $", "\N{CJK UNIFIED IDEOGRAPH-4E2D} {0} %s"])
def test_any_level_scene_or_reason_can_be_shown(name):
    study = made_up_study(settings=["subpixel_bits"], scene=name)
    study = changed(study, "subpixel_bits", "12", {"level": name})
    study = dataclasses.replace(study, without_effect={name: name}, left_out=(name,))
    read = Read(render_page(study, {"subpixel_bits": name}))
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
    read = Read(render_page(study, {}))
    assert read.open == []
    assert "The study was interrupted before: samples=2" in read.text
    assert "no other quality was tried." in read.text


def test_a_single_round_has_no_spread():
    read = Read(render_page(made_up_study(rounds=1), {}))
    assert "timed once" in read.text
    assert any(row[:2] == ["area", NOT_MEASURED] for row in read.rows if row)
    assert "about 1.9×" in describe_alternatives(made_up_study(rounds=1))


def test_how_much_times_varied_is_said(study, read):
    trial = max(study.trials, key=lambda t: (t.spread[1] - t.spread[0]) / t.ratio)
    most = 100.0 * (trial.spread[1] - trial.spread[0]) / trial.ratio
    assert 1.0 < most < 6.0
    assert f"{most:.3g} % for {trial.label} , which varied most" in read.text


def test_the_front_is_listed_from_the_fastest_on(study, read):
    rows = [row for row in read.rows if row and len(row) == 5][1:]
    trials = list_front_trials(study)
    assert len(trials) == 7
    wanted = [f"{n} {trial.label}" for n, trial in enumerate(trials, 1)]
    listed = [re.sub("--.*", "", row[0]) for row in rows]
    assert [name for name in listed if name != STANDARD] == wanted
    assert listed.index(STANDARD) == 2, "among those of its time, without a number"
    assert rows[0][1:] == ["0.41×", "2.5× the error", "5.08 ms", "0.081"]
    assert rows[2][1:] == ["1×", "", "12.4 ms", "0.0329"]
    assert [t.errors.rmse for t in trials] == sorted((t.errors.rmse for t in trials), reverse=True)


def test_a_crop_shows_where_levels_differ_rather_than_where_all_are_wrong():
    wrong, right = np.zeros((2, 90, 120), np.float32)
    wrong[10:20, 10:20] = right[10:20, 10:20] = 0.9
    wrong[60, 80] = 0.1
    crop = picture_crops.choose_crop([wrong, right], (48, 36))
    assert (crop.width, crop.height) == (48, 36)
    assert crop.of(wrong).max() == np.float32(0.1)
    assert crop.column < 80 < crop.column + crop.width - 1
    assert crop.row < 60 < crop.row + crop.height - 1
    assert picture_crops.choose_crop([right, right], (48, 36)).of(right).sum() == right.sum()


@pytest.mark.parametrize("shape", [(1, 1), (5, 200), (200, 7), (36, 48)])
def test_a_crop_lies_in_the_picture(shape):
    for at in ((0, 0), (shape[0] - 1, shape[1] - 1)):
        error = np.zeros(shape, np.float32)
        error[at] = 1.0
        crop = picture_crops.choose_crop([error], (48, 36))
        assert crop.of(error).shape == (min(36, shape[0]), min(48, shape[1]))
        assert crop.of(error).max() == 1.0
    assert picture_crops.choose_crop([np.zeros(shape, np.float32)])[:2] == (0, 0)


def test_brighter_is_more_wrong_up_to_the_stated_top():
    for largest, top in ((0.03, 0.05), (1.0, 1.0), (0.0051, 0.01), (2e-7, 2e-7), (0.0, 1.0)):
        error = np.linspace(0.0, largest, 50, dtype=np.float32)[None]
        assert picture_crops.round_up_largest_error([error[:, :3], error]) == pytest.approx(
            top, rel=1e-6
        )
    colors = picture_crops.heat_map(np.linspace(0.0, 1.0, 30, dtype=np.float32)[None], 1.0).astype(
        float
    )
    brightness = colors[0] @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(brightness) > 0.0).all()
    assert (colors[0, 0] == picture_crops.heat_map(np.float32([[0.0]]), 0.3)[0, 0]).all()
    assert (colors[0, -1] == picture_crops.heat_map(np.float32([[0.7]]), 0.5)[0, 0]).all()


def test_what_has_no_effect_is_said_once(study):
    read = Read(render_page(study, {**SENTENCES, "shadow_taps": "said elsewhere"}))
    assert "said elsewhere" not in read.text
    assert read.text.count(study.without_effect["shadow_taps"]) == 1


def test_what_to_ask_for_is_on_the_page(study, read):
    taken = choose(study).trial
    assert taken.setting != STANDARD
    assert format_options(taken, study.standard) in read.text


def test_processor_times_and_a_smaller_picture_are_said():
    busy = dataclasses.replace(
        made_up_study(), clock=CPU, asked_size=(640, 400), reference_samples=16
    )
    read = Read(render_page(busy, {}))
    assert "all threads together worked" in read.text
    assert "not at 640 × 400" in read.text
    assert "a reference of 16 samples a pixel" in read.text


def test_effects_have_a_table_of_their_own(study, read):
    assert "What each effect costs" not in read.text
    cost = EffectCost("fog & <mist>", study.trials[:2], 0.0123, "a <slow> way")
    plain = EffectCost("glow", study.trials[2:3], None, "none")
    text = render_page(dataclasses.replace(study, effects=(cost, plain)), {})
    read = Read(text)
    assert read.open == []
    assert "reference: a <slow> way" in read.text
    rows = [row for row in read.rows if row and row[0] == "as the scene says (standard)"]
    assert [row[1] for row in rows] == ["1×", "1×"]
    assert [row[3] for row in rows] == ["0.0123", NO_VALUE]
