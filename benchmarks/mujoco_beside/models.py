"""Models that come with MuJoCo's users: gymnasium's and those of dm_control's suite."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

MODELS = (
    "gymnasium humanoid", "gymnasium ant", "gymnasium half_cheetah", "gymnasium hopper",
    "gymnasium reacher", "suite cartpole", "suite humanoid", "suite cheetah", "suite walker",
    "suite fish", "suite manipulator", "suite quadruped",
)  # fmt: skip

MODES = "color", "depth", "segmentation"

STEPS = 60
"""Of the simulation, from its start."""

SIZES = ((84, 84), (256, 256), (640, 480))
"""Widths and heights that are timed."""


def model_of(name: str) -> Any:
    """Return a model by its name."""
    import mujoco

    home, word = name.split()
    if home == "gymnasium":
        place = importlib.import_module("gymnasium.envs.mujoco").__file__
        model = mujoco.MjModel.from_xml_path(str(Path(place).parent / f"assets/{word}.xml"))
    else:
        module = importlib.import_module(f"dm_control.suite.{word}")
        if word == "quadruped":
            source, assets = module.make_model(floor_size=10), module.common.ASSETS
        elif word == "manipulator":
            source, assets = module.make_model(use_peg=False, insert=False)
        else:
            source, assets = module.get_model_and_assets()
        text = source if isinstance(source, str) else source.decode()
        model = mujoco.MjModel.from_xml_string(text, assets)
    model.vis.global_.offwidth, model.vis.global_.offheight = 640, 480
    return model


def state_of(model: Any) -> Any:
    """Return a state of a model: some steps after its start, with controls from a seed."""
    import mujoco
    import numpy as np

    data, numbers = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(STEPS):
        data.ctrl[:] = numbers.uniform(-1.0, 1.0, model.nu)
        mujoco.mj_step(model, data)
    return data


def cameras_of(model: Any) -> list[int]:
    """Return the numbers of the cameras that are drawn: the free one, and the first."""
    return [-1, 0][: 1 + bool(model.ncam)]
