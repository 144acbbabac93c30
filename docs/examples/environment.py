"""
An environment for reinforcement learning in the manner of gymnasium, with pictures to observe.

A puck slides on a table; pushes in x and y shall bring it to the marked place. ``python
environment.py -o episode.gif`` plays one episode and prints how many steps it makes in a second.
Needs ``pip install gymnasium``.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any, SupportsFloat

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

import rasterjit as rj
from rasterjit import animation

Pixels = NDArray[np.uint8]
HALF = 1.0
"""Half the side of the table."""
PUSH, FRICTION, REACHED, LONGEST = 0.015, 0.15, 0.15, 200
"""Speed that a push of 1 adds, share that friction takes, distance that is enough, steps."""


def disc(radius: float, height: float, color: str) -> rj.Mesh:
    """Return a round plate, z up."""
    turn = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
    rim = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    low, high = (np.column_stack([rim, np.full(32, z)]) for z in (0.0, height))
    i = np.arange(32)
    j = (i + 1) % 32
    side = np.concatenate([np.stack([i, j, j + 32], 1), np.stack([i, j + 32, i + 32], 1)])
    top = np.stack([np.full(32, 64), i + 32, j + 32], 1)
    vertices = np.concatenate([low, high, [[0.0, 0.0, height]]])
    material = rj.Material("flat", color)
    return rj.Mesh(vertices, np.concatenate([side, top]), material=material)


class PushPuck(gymnasium.Env[Pixels, NDArray[np.float32]]):
    """Observe a picture of the table, (side, side, 3) uint8; push by two numbers in -1..1."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012 (gymnasium's name)

    def __init__(self, side: int = 64, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.observation_space = spaces.Box(0, 255, (side, side, 3), np.uint8)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.scene = rj.Scene()
        a = 1.25 * HALF
        table = rj.Mesh([(-a, -a, 0), (a, -a, 0), (a, a, 0), (-a, a, 0)], [(0, 1, 2), (0, 2, 3)])
        table.material = rj.Material("flat", "#c8b393")
        self.scene.add(table)
        self.goal_node = self.scene.add(disc(REACHED, 0.01, "#3f9b52"))
        self.puck_node = self.scene.add(disc(0.1, 0.08, "#c2352b"))
        self.scene.lights = [
            rj.AmbientLight(intensity=0.4),
            rj.DirectionalLight((-1, 1, -3), intensity=0.8),
        ]
        self.camera = rj.PerspectiveCamera(
            (0.0, -2.2, 2.6), (0.0, -0.1, 0.0), (0, 0, 1), fov_y=53.0
        )
        self.small = rj.Renderer((side, side), threads=1)  # many environments run side by side
        self.large = rj.Renderer((240, 240), quality=rj.Quality(samples=8))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Pixels, dict[str, Any]]:
        """Place puck and mark anew; the same seed gives the same places and the same pixels."""
        super().reset(seed=seed)
        self.puck, self.goal = self.np_random.uniform(-0.85 * HALF, 0.85 * HALF, (2, 2))
        self.speed, self.steps = np.zeros(2), 0
        return self._observe(), self._info()

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Pixels, SupportsFloat, bool, bool, dict[str, Any]]:
        """Push, slide, and bounce off the rim; the reward is the way that the puck came nearer."""
        before = self._info()["distance"]
        push = np.clip(np.asarray(action, float), -1.0, 1.0)
        self.speed = (1.0 - FRICTION) * self.speed + PUSH * push
        self.puck = self.puck + self.speed
        is_beyond = np.abs(self.puck) > HALF
        self.speed = np.where(is_beyond, -0.5 * self.speed, self.speed)
        self.puck = np.clip(self.puck, -HALF, HALF)
        self.steps += 1
        info = self._info()
        done = info["distance"] < REACHED
        reward = before - info["distance"] + (1.0 if done else 0.0)
        return self._observe(), float(reward), bool(done), self.steps >= LONGEST, info

    def render(self) -> Pixels | None:
        """Return a larger, smoother picture if ``render_mode`` is "rgb_array"."""
        return self._draw(self.large) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Give threads and memory back."""
        self.small.close()
        self.large.close()

    def _observe(self) -> Pixels:
        return self._draw(self.small)

    def _draw(self, renderer: rj.Renderer) -> Pixels:
        self.puck_node.transform = rj.transforms.translate((*self.puck, 0.0))
        self.goal_node.transform = rj.transforms.translate((*self.goal, 0.0))
        return renderer.render(self.scene, self.camera, background="#59636e").color[..., :3].copy()

    def _info(self) -> dict[str, Any]:
        return {"distance": float(np.linalg.norm(self.puck - self.goal))}


gymnasium.register("PushPuck-v0", entry_point=lambda **options: PushPuck(**options))


def pilot(environment: PushPuck) -> NDArray[np.float32]:
    """Return the push of one who sees the numbers: towards the mark, against the speed."""
    push = 2.0 * (environment.goal - environment.puck) - 8.0 * environment.speed
    return np.clip(push, -1.0, 1.0).astype(np.float32)


def main(arguments: list[str] | None = None) -> None:
    """Play an episode, and time steps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("episode.gif"))
    parser.add_argument("--seed", type=int, default=4)
    parser.add_argument("--steps", type=int, default=1000, help="that are timed")
    chosen = parser.parse_args(arguments)
    environment = PushPuck(render_mode="rgb_array")  # or gymnasium.make("PushPuck-v0", ...)
    environment.reset(seed=chosen.seed)
    pictures, total, over = [environment.render()], 0.0, False
    while not over:
        _, reward, done, too_long, _ = environment.step(pilot(environment))
        pictures.append(environment.render())
        total, over = total + float(reward), done or too_long
    animation.save([p for p in pictures if p is not None], chosen.output, fps=20)
    print(f"{environment.steps} steps, reward {total:.2f}")
    since = time.perf_counter()
    for _ in range(chosen.steps):
        environment.step(environment.action_space.sample())
    print(f"{chosen.steps / (time.perf_counter() - since):.0f} steps a second")
    environment.close()


if __name__ == "__main__":
    main()
