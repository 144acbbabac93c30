"""What a page says goes further only as the list has it."""

from __future__ import annotations

import json

import pytest

from rasterjit.viewer import protocol

POINTER = {"x": 3, "y": 4.5, "button": 1, "buttons": [1], "modifiers": ["Shift"]}
ALLOWED = {
    "pointer_down": POINTER,
    "pointer_move": {**POINTER, "button": 0, "buttons": [], "modifiers": []},
    "pointer_up": POINTER,
    "wheel": {"x": 1, "y": 2, "dx": 0, "dy": -400.5, "modifiers": []},
    "key_down": {"key": "ArrowLeft", "modifiers": []},
    "key_up": {"key": "a", "modifiers": ["Alt", "Control", "Meta", "Shift"]},
    "pick": {"x": 12, "y": 7.5},
    "view": {"eye": [1, 2.5, -3e7], "target": [0, 0, 0], "up": [0, 1, 0], "fov_y": 45},
    "look": {
        "kind": "depth",
        "switched": ["fog", "shadows"],
        "modes": {"g": None, "p": "x"},
    },
    "visibility": {"hidden": [0, 5, 999], "only": 3},
}
ALSO = {"only": (None,), "modes": ({},)}
"""What a field may be besides."""


def read(sent=5, **message):
    return protocol.read_message(json.dumps(message), sent)


@pytest.mark.parametrize("kind", ALLOWED)
def test_events_pass_with_the_fields_that_are_listed(kind):
    fields = ALLOWED[kind]
    found = read(type=kind, **fields, timestamp=8.5, touches={"1": {}}, stop_propagation=True)
    assert found == {"type": kind, **fields}


@pytest.mark.parametrize("kind", ALLOWED)
def test_events_with_a_field_missing_or_of_another_kind_do_not(kind):
    fields = ALLOWED[kind]
    for name in fields:
        rest = {key: value for key, value in fields.items() if key != name}
        assert read(type=kind, **rest) is None, name
        wrongs = (
            None,
            True,
            {},
            [[]],
            "x" * 33,
            "",
            float("nan"),
            1e16,
            -1e16,
            10**400,
            [None] * 3,
        )
        for wrong in wrongs:
            if wrong in ALSO.get(name, ()):
                continue
            assert read(type=kind, **rest, **{name: wrong}) is None, (name, wrong)


@pytest.mark.parametrize(
    "kind",
    ["_clients_change", "show", "close", "char", "double_click", "state", "title", "", None, 3],
)
def test_what_is_not_listed_does_not_pass(kind):
    assert read(type=kind, ids=[2, 1], **POINTER) is None


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "3",
        "[]",
        "{}",
        "{",
        "[" * 4000,
        "9" * 4096,
        "[" * 16384,
        b"{}",
        None,
        "x" * 100_000,
    ],
)
def test_what_is_no_message_does_not_pass(text):
    assert protocol.read_message(text, 5) is None


@pytest.mark.parametrize("far", [1e7, -1e7])
@pytest.mark.parametrize(("kind", "name"), [("pick", "x"), ("wheel", "dy"), ("pointer_down", "y")])
def test_places_lie_near_the_page(kind, name, far):
    assert read(type=kind, **{**ALLOWED[kind], name: far}) is None


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        ("view", {"eye": [0, 0]}), ("view", {"eye": [0, 0, 1e16]}), ("view", {"up": [0, 1, 0, 0]}),
        ("view", {"target": ["1", 0, 0]}), ("view", {"target": [float("nan"), 0, 0]}),
        ("view", {"fov_y": 0}), ("view", {"fov_y": 180}), ("view", {"fov_y": "45"}),
        ("look", {"kind": "color; x"}), ("look", {"kind": ["color"]}), ("look", {"kind": ""}),
        ("look", {"switched": "fog"}), ("look", {"switched": ["fog"] * 65}),
        ("look", {"switched": ["x"]}),
        ("look", {"switched": [["fog"]]}), ("look", {"modes": {"g": "x"}}),
        ("look", {"modes": {"x": None}}), ("look", {"modes": {"g": ["alone"]}}),
        ("look", {"modes": []}),
        ("visibility", {"hidden": [-1]}), ("visibility", {"hidden": [0.5]}),
        ("visibility", {"hidden": [True]}), ("visibility", {"hidden": [2**31]}),
        ("visibility", {"hidden": [0] * 1001}), ("visibility", {"hidden": {"0": 1}}),
        ("visibility", {"only": -1}), ("visibility", {"only": [1]}),
    ],
)  # fmt: skip
def test_views_looks_and_objects_that_are_none_do_not_pass(kind, wrong):
    assert read(type=kind, **ALLOWED[kind]) is not None
    assert read(type=kind, **{**ALLOWED[kind], **wrong}) is None


def test_usual_sizes_pass_as_they_are():
    for width, height, ratio in ((320, 800, 1), (3840, 2160, 2.0), (1, 1, 0.5)):
        found = read(type="resize", pwidth=width, pheight=height, ratio=ratio, width=1, height=1)
        assert (found["pwidth"], found["pheight"], found["ratio"]) == (width, height, ratio)


@pytest.mark.parametrize("size", [(16384, 16384), (1_000_000, 1), (7680, 4320), (1, 1_000_000)])
def test_large_sizes_become_smaller_ones_of_the_same_shape(size):
    found = read(type="resize", pwidth=size[0], pheight=size[1], ratio=2)
    width, height = found["pwidth"], found["pheight"]
    assert width * height <= protocol.MAX_PIXELS
    assert max(width, height) <= protocol.MAX_SIDE
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
    assert read(sent=5, type="shown", number=5, timestamp=3) == {"type": "shown", "number": 5}
    assert read(sent=4, type="shown", number=5) is None
    for wrong in (0, -1, 1.0, "1", None, True):
        assert read(type="shown", number=wrong) is None
