"""What a page says goes further only as the list has it."""

from __future__ import annotations

import json

import pytest

from rasterjit.viewer import messages

POINTER = {"x": 3, "y": 4.5, "button": 1, "buttons": [1], "modifiers": ["Shift"]}
ALLOWED = {
    "pointer_down": POINTER,
    "pointer_move": {**POINTER, "button": 0, "buttons": [], "modifiers": []},
    "pointer_up": POINTER,
    "wheel": {"x": 1, "y": 2, "dx": 0, "dy": -400.5, "modifiers": []},
    "key_down": {"key": "ArrowLeft", "modifiers": []},
    "key_up": {"key": "a", "modifiers": ["Alt", "Control", "Meta", "Shift"]},
}


def read(sent=5, **message):
    return messages.read_message(json.dumps(message), sent)


@pytest.mark.parametrize("kind", ALLOWED)
def test_events_pass_with_the_fields_that_are_listed(kind):
    fields = ALLOWED[kind]
    found = read(type=kind, **fields, timestamp=8.5, touches={"1": {}}, stop_propagation=True)
    assert found == {"type": kind, **fields, "timestamp": 0.0}


@pytest.mark.parametrize("kind", ALLOWED)
def test_events_with_a_field_missing_or_of_another_kind_do_not(kind):
    fields = ALLOWED[kind]
    for name in fields:
        rest = {key: value for key, value in fields.items() if key != name}
        assert read(type=kind, **rest) is None
        for wrong in (None, True, {}, [[]], "x" * 33, "", float("nan"), 1e7, -1e7, 10**400):
            assert read(type=kind, **rest, **{name: wrong}) is None, (name, wrong)


@pytest.mark.parametrize(
    "kind",
    ["_clients_change", "show", "hide", "char", "double_click", "focus_in", "title", "", None, 3],
)
def test_what_is_not_listed_does_not_pass(kind):
    assert read(type=kind, ids=[2, 1], **POINTER) is None


@pytest.mark.parametrize(
    "text", ["", "null", "3", "[]", "{}", "{", "[" * 4000, "9" * 4096, b"{}", None, "x" * 100_000]
)
def test_what_is_no_message_does_not_pass(text):
    assert messages.read_message(text, 5) is None


def test_closing_says_nothing_else():
    assert read(type="close", event_type="x") == {"type": "close"}


def test_usual_sizes_pass_as_they_are():
    for width, height, ratio in ((320, 800, 1), (3840, 2160, 2.0), (1, 1, 0.5)):
        found = read(type="resize", pwidth=width, pheight=height, ratio=ratio, width=1, height=1)
        assert (found["pwidth"], found["pheight"], found["ratio"]) == (width, height, ratio)


@pytest.mark.parametrize("size", [(16384, 16384), (1_000_000, 1), (7680, 4320), (1, 1_000_000)])
def test_large_sizes_become_smaller_ones_of_the_same_shape(size):
    found = read(type="resize", pwidth=size[0], pheight=size[1], ratio=2)
    width, height = found["pwidth"], found["pheight"]
    assert width * height <= messages.MOST_PIXELS
    assert max(width, height) <= messages.LONGEST_SIDE
    # A place in the page is the same place of the picture.
    assert width / found["ratio"] == pytest.approx(size[0] / 2, rel=1e-3) or width == 1
    assert height / found["ratio"] == pytest.approx(size[1] / 2, rel=1e-3) or height == 1


@pytest.mark.parametrize(
    "wrong",
    [{"pwidth": 0}, {"pheight": -1}, {"pwidth": 1e3}, {"pwidth": "8"}, {"pheight": 10**400},
     {"pheight": True}, {"ratio": 0}, {"ratio": float("nan")}, {"ratio": 1e-9}, {"ratio": None}],
)  # fmt: skip
def test_sizes_that_are_none_do_not_pass(wrong):
    assert read(**{"type": "resize", "pwidth": 320, "pheight": 200, "ratio": 1, **wrong}) is None


def test_page_has_shown_only_what_was_sent_to_it():
    told = {"type": "_framefeedback", "index": 5, "timestamp": 1.7e9}
    assert read(sent=5, **told, localtime=3) == told
    assert read(sent=4, **told) is None
    for wrong in (-1, 1.0, "1", None, True):
        assert read(**{**told, "index": wrong}) is None
    assert read(**{**told, "timestamp": "soon"}) is None
