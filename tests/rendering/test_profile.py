"""What was measured of a machine is kept whole, and what cannot be read is as good as none."""

from __future__ import annotations

import json
import sys

import pytest

import rasterjit as rj
from rasterjit.rendering import quality_selection as profiles
from rasterjit.rendering.quality_selection import (
    LADDER,
    Profile,
    QualityStep,
    load_profile,
    pareto_front_of_steps,
    save_profile,
)
from rasterjit.scene.quality import Quality

STEPS = (
    QualityStep(Quality.draft(), 0.5, 3.0),
    QualityStep(Quality.standard(), 1.0, 1.0),
    QualityStep(Quality.high(), 6.5, 0.125),
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(profiles, "user_cache_folder", lambda: tmp_path / "cache")
    return tmp_path / "cache"


def test_a_profile_is_read_as_it_was_kept(folder):
    assert load_profile() is None
    path = save_profile(Profile(STEPS, 2))
    assert path.parent == folder
    assert load_profile() == Profile(STEPS, 2)
    assert [file.name for file in folder.iterdir()] == ["profile.json"]


def test_what_others_dominate_is_not_chosen_from():
    slow = QualityStep(rj.Quality(samples=2), 7.0, 0.5)
    alike = QualityStep(rj.Quality(samples=4), 6.5, 0.125)
    assert pareto_front_of_steps((*STEPS[::-1], slow, alike)) in (STEPS, (*STEPS[:2], alike))
    front = pareto_front_of_steps((*STEPS, slow))
    assert [step.time for step in front] == sorted(step.time for step in front)
    assert [step.error for step in front] == sorted((s.error for s in front), reverse=True)
    assert slow not in front


@pytest.mark.parametrize(
    "content",
    [
        "", "[]", "{", '{"format": 1}', '{"format": 1, "steps": [], "threads": 1}',
        '{"format": 1, "steps": [{"settings": {"samples": 3}, "time": 1, "error": 1}], '
        '"threads": 1}',
        '{"format": 1, "steps": [{"settings": {"color": 3}, "time": 1, "error": 1}], "threads": 1}',
    ],
)  # fmt: skip
def test_a_broken_profile_is_none(folder, content):
    save_profile(Profile(STEPS, 2))
    profiles.profile_path().write_text(content)
    assert load_profile() is None


@pytest.mark.parametrize("value", ["Infinity", "[" * 100_000, "0", "-1.0", "NaN", "1e999"])
def test_numbers_that_no_time_can_be_make_it_none(folder, value):
    path = save_profile(Profile(STEPS, 2))
    path.write_text(path.read_text().replace('"time": 0.5', f'"time": {value}'))
    assert load_profile() is None


def test_an_infinite_number_of_threads_makes_it_none(folder):
    edited(save_profile(Profile(STEPS, 2)), lambda content: content.update(threads=float("inf")))
    assert load_profile() is None


def edited(path, change):
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def test_a_profile_of_another_format_is_none(folder):
    edited(save_profile(Profile(STEPS, 2)), lambda content: content.update(format=2))
    assert load_profile() is None


@pytest.mark.parametrize("name", ["cpu", "architecture", "processors"])
def test_a_profile_of_another_machine_is_none(folder, name):
    edited(
        save_profile(Profile(STEPS, 2)), lambda content: content["machine"].update({name: "other"})
    )
    assert load_profile() is None


def test_a_folder_that_cannot_be_written_is_named(folder):
    folder.write_text("a file, not a folder")
    with pytest.raises(ValueError, match=r"cache folder must be one to write to, but '.*cache'"):
        save_profile(Profile(STEPS, 2))
    assert load_profile() is None


def test_the_folder_is_the_users_own(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert profiles.user_cache_folder() == tmp_path / "rasterjit"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert profiles.user_cache_folder().name == "rasterjit"
    assert profiles.user_cache_folder().parent.name == ".cache"


def test_the_ladder_begins_with_the_draft_and_ends_with_the_reference():
    assert LADDER[0] == Quality.draft()
    assert LADDER[-1] == Quality.reference()
    assert len(set(LADDER)) == len(LADDER)
