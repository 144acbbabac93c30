import csv
import json
import math
import os

import pytest
from made_trials import study, trial

import rasterjit as rj
from rasterjit.accuracy.report import files
from rasterjit.accuracy.report.files import CSV_COLUMNS, prepare_folder, write_files


@pytest.fixture
def found():
    one = trial("samples=4", (1.4, 1.5, 1.6), rj.Quality(samples=4), rmse=0.0, psnr=math.inf)
    return study([one], ("standard", "samples=4"))


def test_json_holds_machine_versions_and_raw_samples(found, tmp_path):
    write_files(found, tmp_path)
    text = (tmp_path / "accuracy.json").read_text()
    held = json.loads(text, parse_constant=lambda name: pytest.fail(name))
    assert held["machine"] == found.machine
    assert held["versions"] == found.versions
    assert held["front"] == ["standard", "samples=4"]
    assert held["left_out"] == ["samples=256"]
    (one,) = held["trials"]
    assert one["ratios"] == [1.4, 1.5, 1.6]
    assert one["seconds"] == list(found.trials[0].seconds)
    assert rj.Quality(**one["quality"]) == found.trials[0].quality
    assert one["errors"]["psnr"] is None
    assert held["sentences"]["samples"].startswith("4 samples instead of 1 sample")


def test_csv_has_a_row_for_each_trial(found, tmp_path):
    write_files(found, tmp_path)
    with (tmp_path / "accuracy.csv").open(newline="") as file:
        table = csv.DictReader(file)
        assert tuple(table.fieldnames) == CSV_COLUMNS
        standard, one = table
    assert (standard["setting"], one["setting"], one["level"]) == ("standard", "samples", "4")
    seconds = [float(text) for text in one["seconds"].split()]
    assert seconds == pytest.approx(found.trials[0].seconds)
    assert float(one["ratio"]) == 1.5
    assert float(one["psnr"]) == math.inf


def test_a_folder_is_made(found, tmp_path):
    places = write_files(found, tmp_path / "a" / "report")
    assert all(place.is_file() for place in places)
    assert sorted(tmp_path.rglob("*.*")) == sorted(places)


def test_a_file_that_cannot_be_finished_leaves_the_old_one(found, tmp_path, monkeypatch):
    write_files(found, tmp_path)
    before = (tmp_path / "accuracy.csv").read_bytes()

    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(csv.DictWriter, "writerows", fail)
    with pytest.raises(KeyboardInterrupt):
        write_files(found, tmp_path)
    assert (tmp_path / "accuracy.csv").read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 2


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "report").write_text("mine")
    with pytest.raises(ValueError, match=r"output must be a folder, but '.*report' is a file"):
        prepare_folder(tmp_path / "report")
    with pytest.raises(ValueError, match="output must be a folder"):
        prepare_folder(tmp_path / "report" / "more")
    with pytest.raises(ValueError, match="got 7"):
        prepare_folder(7)


def test_a_folder_that_cannot_be_written_to_is_refused(tmp_path, monkeypatch):
    def refuse(source, target):
        raise PermissionError(13, os.strerror(13), str(target))

    monkeypatch.setattr("rasterjit.io.images.os.replace", refuse)
    with pytest.raises(ValueError, match=f"{tmp_path.name}.*not: Permission denied"):
        prepare_folder(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_checked_folder_is_left_empty(tmp_path):
    prepare_folder(tmp_path / "report")
    assert list((tmp_path / "report").iterdir()) == []


def test_without_matplotlib_there_is_no_page(found, tmp_path, monkeypatch):
    monkeypatch.setattr(files, "can_make_page", lambda: False)
    assert [place.name for place in files.write_report(found, tmp_path)] == [
        "accuracy.json", "accuracy.csv",
    ]  # fmt: skip
