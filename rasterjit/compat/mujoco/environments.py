"""Environments of gymnasium that are drawn without OpenGL."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from rasterjit.compat.mujoco.renderer import Renderer
from rasterjit.scene.validation import brief, one_of

RENDER_MODES = "rgb_array", "depth_array", "rgbd_tuple"
"""What an environment may be asked to render."""

READ_ATTRIBUTES = (
    "model", "data", "camera_id", "default_cam_config", "height", "width", "max_geom", "_vopt",
)  # fmt: skip
"""Attributes of gymnasium's ``MujocoRenderer`` that are read."""


def draw_environment(environment: Any) -> Any:
    """
    Let an environment of gymnasium's MuJoCo ones be rendered here, whatever ``MUJOCO_GL`` says.

    Parameters
    ----------
    environment : gymnasium.Env
        Made with a ``render_mode`` of ``"rgb_array"``, ``"depth_array"`` or ``"rgbd_tuple"``.

    Returns
    -------
    gymnasium.Env
        The same: its ``render`` returns what it did, drawn here.

    Raises
    ------
    ValueError
        If it has no ``mujoco_renderer``, or one older than gymnasium 1.0, or another mode.
    """
    inner = getattr(environment, "unwrapped", environment)
    known = getattr(inner, "mujoco_renderer", None)
    if known is None:
        raise ValueError(
            "environment must be one of gymnasium's for MuJoCo, with a mujoco_renderer, got "
            f"{brief(environment)}"
        )
    if isinstance(known, EnvironmentRenderer):
        return environment
    missing = [name for name in READ_ATTRIBUTES if not hasattr(known, name)]
    if missing:
        raise ValueError(
            "environment must be one of gymnasium 1.0 or later, got one whose mujoco_renderer has "
            f"no {', '.join(missing)}"
        )
    one_of("render_mode", inner.render_mode, RENDER_MODES)
    inner.mujoco_renderer = EnvironmentRenderer(known)
    known.close()
    return environment


class EnvironmentRenderer:
    """
    Renders an environment in place of gymnasium's ``MujocoRenderer``.

    Parameters
    ----------
    known : gymnasium.envs.mujoco.mujoco_rendering.MujocoRenderer
        Whose model, data, size and camera it takes over.
    """

    def __init__(self, known: Any) -> None:
        self.model, self.data = known.model, known.data
        self.camera_id, self.default_cam_config = known.camera_id, known.default_cam_config
        self._renderer = Renderer(known.model, known.height, known.width, known.max_geom)
        self._option = mujoco.MjvOption()
        for flag, value in known._vopt.items():
            self._option.flags[flag] = value
        self._camera: Any = None

    def render(self, render_mode: str | None) -> Any:
        """Return what gymnasium's renderer returns in a mode; depth as OpenGL's buffer has it."""
        mode = one_of("render_mode", render_mode, RENDER_MODES)
        renderer = self._renderer
        renderer.update_scene(self.data, self._choose_camera(), self._option)
        renderer.disable_depth_rendering()
        color = renderer.render() if mode != "depth_array" else None
        if mode == "rgb_array":
            return color
        renderer.enable_depth_rendering()
        depth = self._to_depth_buffer(renderer.render())
        return depth if mode == "depth_array" else (color, depth)

    def close(self) -> None:
        """Let threads and memory go."""
        self._renderer.close()

    def _to_depth_buffer(self, depth: Any) -> Any:
        """Return depth as the share of it, 0 to 1, that a depth buffer holds."""
        camera = self._renderer.scene.camera[0]
        near, far = float(camera.frustum_near), float(camera.frustum_far)
        exact = depth.astype(np.float64)
        share = (exact - near) / (far - near)
        return np.float32(share if camera.orthographic else share * far / exact)

    def _choose_camera(self) -> Any:
        """Return the camera that gymnasium would look through."""
        if self._camera is None:
            camera = self._camera = mujoco.MjvCamera()
            camera.lookat[:] = np.median(self.data.geom_xpos, axis=0)
            camera.distance = self.model.stat.extent
            for name, value in (self.default_cam_config or {}).items():
                if isinstance(value, np.ndarray):
                    getattr(camera, name)[:] = value
                else:
                    setattr(camera, name, value)
            if self.camera_id is not None:
                is_free = self.camera_id == -1
                kinds = mujoco.mjtCamera
                camera.type = kinds.mjCAMERA_FREE if is_free else kinds.mjCAMERA_FIXED
                camera.fixedcamid = self.camera_id
        return self._camera
