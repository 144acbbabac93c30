"""
Record an environment that random actions move.

https://gymnasium.farama.org/introduction/record_agent/
"""

import gymnasium

environment = gymnasium.make("Ant-v5", render_mode="rgb_array", width=320, height=240)
environment.action_space.seed(0)
environment.reset(seed=0)
frames = []
for _ in range(40):
    frames.append(environment.render())
    _, _, terminated, truncated, _ = environment.step(environment.action_space.sample())
    if terminated or truncated:
        environment.reset()
environment.close()
