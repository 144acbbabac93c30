"""
Pictures of MuJoCo's models without OpenGL: `Renderer` has the methods of ``mujoco.Renderer``.

MuJoCo itself lists what is to be drawn, which takes no OpenGL: geoms, lights and cameras, with
groups, tendons, skins and contacts resolved. Each frame moves the nodes of a kept scene to where
that list has them.
"""

from __future__ import annotations

try:
    import mujoco as _mujoco
except ImportError as error:
    raise ImportError(
        f'pictures of models need MuJoCo: pip install "rasterjit[mujoco]" ({error})'
    ) from error
if tuple(map(int, _mujoco.__version__.split(".")[:2])) < (3, 17):
    raise ImportError(
        'pictures of models need MuJoCo 3.17 or later: pip install "rasterjit[mujoco]" '
        f"(found {_mujoco.__version__})"
    )

from rasterjit.compat.mujoco.environments import draw_environment
from rasterjit.compat.mujoco.model_scene import ModelScene
from rasterjit.compat.mujoco.renderer import Renderer, from_model

__all__ = ["ModelScene", "Renderer", "draw_environment", "from_model"]
