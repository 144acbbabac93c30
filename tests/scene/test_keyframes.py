"""Channels give the values of the glTF specification; animations refuse what cannot be."""

import math
import pickle

import naive_posing as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.scene.keyframes import slerp_rotation

NODE = rj.Node(name="one")


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    path=st.sampled_from(["translation", "rotation", "scale", "weights"]),
    interpolation=st.sampled_from(["LINEAR", "STEP", "CUBICSPLINE"]),
    share=st.floats(-0.2, 1.2),
)
def test_values_are_those_of_the_specification(seed, path, interpolation, share):
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 6))
    times = np.cumsum(random.random(count) + 0.01)
    width = {"rotation": 4, "weights": 5}.get(path, 3)
    parts = (3,) if interpolation == "CUBICSPLINE" else ()
    values = random.normal(size=(count, *parts, width))
    channel = rj.Channel(NODE, path, times, values, interpolation)
    for time in (*times, times[0] + share * (times[-1] - times[0])):
        wanted = naive.value_at(path, times, values.tolist(), interpolation, float(time))
        np.testing.assert_allclose(channel.at(time), wanted, atol=1e-12)


@pytest.mark.parametrize("degrees", [0, 1e-9, 1e-6, 0.01, 30, 179, 180, 181, 359.9, 360])
@pytest.mark.parametrize("t", [0.0, 0.3, 0.5, 1.0])
def test_rotations_take_the_shorter_way_at_even_speed(degrees, t):
    half = math.radians(degrees) / 2.0
    first = np.array([0.0, 0.0, 0.0, 1.0])
    second = np.array([0.0, 0.0, math.sin(half), math.cos(half)])
    shorter = degrees if degrees <= 180.0 else degrees - 360.0
    angle = math.radians(shorter) * t / 2.0
    found = slerp_rotation(first, second, t)
    wanted = np.array([0.0, 0.0, math.sin(angle), math.cos(angle)])
    sign = 1.0 if found @ wanted >= 0.0 else -1.0
    np.testing.assert_allclose(sign * found, wanted, atol=1e-14)
    # A quaternion and its opposite are one rotation.
    np.testing.assert_allclose(np.abs(slerp_rotation(first, -second, t) @ wanted), 1.0, atol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((None, "scale", [0], [(1, 1, 1)]), "node must be a Node, got None"),
        ((NODE, "size", [0], [(1, 1, 1)]), "path must be one of"),
        ((NODE, "scale", [0], [(1, 1, 1)], "CUBIC"), "interpolation must be one of"),
        ((NODE, "scale", [], np.ones((0, 3))), "times must have a key, got none"),
        ((NODE, "scale", [0, np.nan], np.ones((2, 3))), "times must be finite"),
        ((NODE, "scale", [0, 2, 1], np.ones((3, 3))), "times must ascend, got 2.0 before 1.0"),
        ((NODE, "scale", [0, 1, 1], np.ones((3, 3))), "times must ascend, got 1.0 before 1.0"),
        (
            (NODE, "scale", [0, 1], np.ones((3, 3))),
            r"values must have shape \(2, 3\)",
        ),
        (
            (NODE, "rotation", [0], np.ones((1, 3))),
            r"values must have shape \(1, 4\), got \(1, 3\)",
        ),
        ((NODE, "rotation", [0, 1], [(0, 0, 0, 1), (0, 0, 0, 0)]), "that are not 0, got one at 1"),
        ((NODE, "scale", [0], [(1, np.inf, 1)]), "values must be finite"),
        (
            (NODE, "scale", [0], np.ones((1, 3)), "CUBICSPLINE"),
            r"must have shape \(1, 3, 3\)",
        ),
        ((NODE, "weights", [0], np.ones((1, 0))), "values must have a number for each key"),
    ],
)
def test_a_channel_refuses_what_cannot_be(arguments, said):
    with pytest.raises(ValueError, match=said):
        rj.Channel(*arguments)


def test_weights_are_as_many_as_targets():
    mesh = rj.Mesh(np.eye(3), [(0, 1, 2)], morph_targets=rj.MorphTargets(np.ones((2, 3, 3))))
    node = rj.Node(mesh)
    assert rj.Channel(node, "weights", [0], [(1, 0)]).at(3).tolist() == [1.0, 0.0]
    with pytest.raises(ValueError, match=r"values must have shape \(1, 2\), got \(1, 3\)"):
        rj.Channel(node, "weights", [0], [(1, 0, 1)])


def test_times_before_and_after_are_held_and_steps_are_sharp():
    channel = rj.Channel(NODE, "scale", [1, 2], [(1, 1, 1), (3, 3, 3)], "STEP")
    found = [channel.at(time)[0] for time in (-5, 1, math.nextafter(2, 0), 2, 9)]
    assert found == [1, 1, 1, 3, 3]
    with pytest.raises(ValueError, match="time must be"):
        channel.at(math.inf)


def test_an_animation_refuses_what_is_no_channel_and_two_for_the_same():
    shift = rj.Channel(NODE, "translation", [0, 2], [(0, 0, 0), (1, 0, 0)])
    turn = rj.Channel(NODE, "rotation", [0, 3], [(0, 0, 0, 1), (0, 0, 1, 0)])
    animation = rj.Animation("both", [shift, turn])
    assert (animation.duration, animation.channels) == (3.0, (shift, turn))
    assert repr(animation) == "Animation('both', 2 channels, 3 s)"
    assert repr(shift) == "Channel('one', 'translation', 2 keys)"
    for wrong, said in (
        ([], "channels must have a Channel, got none"),
        ("ab", "channels must be a sequence of Channel, got 'ab'"),
        ([shift, 3], r"channels\[1\] must be a Channel, got 3"),
        ([shift, turn, shift], "channels must each move something else, got two for the trans"),
    ):
        with pytest.raises(ValueError, match=said):
            rj.Animation("wrong", wrong)
    again = pickle.loads(pickle.dumps(animation))
    np.testing.assert_array_equal(again.channels[1].at(1.0), turn.at(1.0))
    assert again.channels[0].node is again.channels[1].node


def test_a_scene_without_animations_has_no_times():
    scene = rj.Scene()
    scene.add(rj.Mesh(np.eye(3), [(0, 1, 2)]))
    assert scene.animations == []
    with pytest.raises(ValueError, match="animation must be one of the scene's, which has none"):
        scene.at(0.0)
    for wrong, said in (
        (3, "scene.animations must be a list, got 3"),
        ([3], r"animations\[0\] must"),
    ):
        scene.animations = wrong
        with pytest.raises(ValueError, match=said):
            scene.at(0.0)
