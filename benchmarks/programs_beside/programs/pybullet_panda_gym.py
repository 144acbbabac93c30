"""
Random actions of a robot's arm that pushes a block, each drawn.

https://github.com/qgallouedec/panda-gym#usage
"""

import gymnasium
import panda_gym  # noqa: F401

environment = gymnasium.make("PandaPush-v3", render_mode="rgb_array", renderer="Tiny")
environment.action_space.seed(1)
environment.reset(seed=1)
frames = []
for _ in range(10):
    environment.step(environment.action_space.sample())
    frames.append(environment.render())
environment.close()
