"""The environment keeps gymnasium's rules, and its pictures are the same bits for a seed."""

from __future__ import annotations

import os

import numpy as np
import pytest
from PIL import Image

if not os.environ.get("CI"):
    pytest.importorskip("gymnasium")
import gymnasium
from gymnasium.utils.env_checker import check_env


def episode(environment, seed, steps=12):
    """The pictures and rewards of pushes that the seed chooses."""
    pixels, _ = environment.reset(seed=seed)
    pictures, rewards = [pixels], []
    pushes = np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, 2)).astype(np.float32)
    for push in pushes:
        pixels, reward, *_ = environment.step(push)
        pictures.append(pixels)
        rewards.append(reward)
    return np.stack(pictures), rewards


def test_gymnasium_finds_no_fault(program):
    program("environment")
    made = gymnasium.make("PushPuck-v0", render_mode="rgb_array")
    check_env(made.unwrapped)
    made.close()


def test_a_seed_gives_the_same_bits(program):
    module = program("environment")
    first, second = module.PushPuck(side=48), module.PushPuck(side=48)
    pictures, rewards = episode(first, 5)
    again, rewards_again = episode(second, 5)
    assert np.array_equal(pictures, again)
    assert rewards == rewards_again
    assert np.array_equal(episode(first, 5)[0], pictures)  # after an episode, too
    assert not np.array_equal(episode(first, 6)[0], pictures)
    first.close()
    second.close()


def test_the_picture_shows_puck_and_mark_where_they_are(program):
    module = program("environment")
    environment = module.PushPuck(side=96)
    for seed in range(4):
        pixels, _ = environment.reset(seed=seed)
        red, green = (pixels[..., k].astype(int) for k in range(2))
        for place, seen in (
            (environment.puck, (red > 90) & (red > 2 * green)),
            (environment.goal, (green > 90) & (green > red + 40)),
        ):
            rows, columns = seen.nonzero()
            pixels_of, _ = environment.camera.project([(*place, 0.04)], (96, 96))
            x, y = pixels_of[0]
            assert abs(columns.mean() - x) < 4
            assert abs(rows.mean() - y) < 4
    environment.close()


def test_the_pilot_reaches_the_mark(program):
    module = program("environment")
    module.main(["--steps", "3"])
    with Image.open("episode.gif") as picture:
        assert 5 < picture.n_frames < 100
    environment = module.PushPuck(side=16)
    environment.reset(seed=1)
    rewards, done = [], False
    while not done and environment.steps < module.LONGEST:
        _, reward, done, _, info = environment.step(module.pilot(environment))
        rewards.append(reward)
    assert done
    assert info["distance"] < module.REACHED
    assert sum(rewards) > 1.0
    environment.close()
