"""
Hooks: what scenes and meshes are asked for and leave to levels above them.

Scenes know nothing of how they are rendered, read and written. `set_hooks` registers the functions
that do so; importing the package does it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

HOOKS: dict[str, Callable[..., Any]] = {}
"""
By name: ``picture`` takes a scene or mesh and returns a small frame or None, for notebooks;
``show`` takes a frame, its colour and a title, and shows it;
``scene_of_others`` returns another program's object, or another scene, as a scene to be added;
``as_scene`` returns what can be drawn as a scene, and takes what errors call it;
``posed`` returns a scene with all skins and morph weights applied;
``save`` writes a scene to a path; ``to_trimesh`` returns a scene or mesh as trimesh's.
"""


def set_hooks(**functions: Callable[..., Any]) -> None:
    """Let functions do from now on what their names in `HOOKS` say."""
    HOOKS.update(functions)
