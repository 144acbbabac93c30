"""
Pictures of a MuJoCo model while it moves, without OpenGL.

A ball falls on a floor that mirrors it; ``python simulation.py -o ball.gif`` writes its colours,
depth and numbers side by side. Needs ``pip install "rasterjit[mujoco]"``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mujoco  # type: ignore[import-not-found,unused-ignore]
import numpy as np

import rasterjit as rj
from rasterjit.compat.mujoco import Renderer

MODEL = """
<mujoco>
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".2 .3 .4" rgb2=".3 .4 .5"
             width="100" height="100"/>
    <material name="floor" texture="tiles" texrepeat="6 6" reflectance=".3"/>
  </asset>
  <worldbody>
    <light pos="0 -1 3" dir="0 .3 -1" diffuse=".6 .6 .6"/>
    <camera name="front" pos="0 -2.6 1.3" xyaxes="1 0 0 0 .4 1"/>
    <geom type="plane" size="2 2 1" material="floor"/>
    <body pos="0 0 1.2">
      <freejoint/>
      <geom type="sphere" size=".25" rgba=".9 .4 .2 1" solref=".02 .2"/>
    </body>
  </worldbody>
</mujoco>
"""


def main() -> None:
    """Simulate a second, and write what it looks like."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("ball.gif"))
    parser.add_argument("--frames", type=int, default=16)
    asked = parser.parse_args()
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pictures = []
    with Renderer(model, height=112, width=112) as renderer:
        for number in range(asked.frames):
            while data.time < number * 0.05:
                mujoco.mj_step(model, data)
            renderer.update_scene(data, camera="front")
            color = renderer.render()
            renderer.enable_depth_rendering()
            near = (255.0 * np.clip(1.0 - renderer.render() / 5.0, 0.0, 1.0)).astype(np.uint8)
            renderer.enable_segmentation_rendering()
            numbers = (100 * (renderer.render()[..., 0] + 1)).astype(np.uint8)
            renderer.disable_segmentation_rendering()
            grey = [np.repeat(part[..., None], 3, axis=2) for part in (near, numbers)]
            pictures.append(np.concatenate([color, *grey], axis=1))
    rj.animation.save(pictures, asked.output, fps=20)
    print(f"{asked.output}: {len(pictures)} pictures")


if __name__ == "__main__":
    main()
