"""
Call functions of higher levels for scenes and meshes, without importing them.

Scenes know nothing of how they are rendered, read and written: they find who does it by name, when
it is first needed.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

HOOKS = {
    "as_scene": "rasterjit.io.meshes",
    "pose_scene": "rasterjit.survey.deformation",
    "preview": "rasterjit.styles.small_preview",
    "save_gltf": "rasterjit.io.gltf.writing",
    "scene_to_add": "rasterjit.io.meshes",
    "show_picture": "rasterjit.viewer.show_picture",
    "to_trimesh": "rasterjit.io.trimesh.writing",
}
"""The module of each function that a scene, a mesh or a frame calls above its own level."""


def call_above(name: str, *arguments: Any) -> Any:
    """Call a function of `HOOKS`."""
    return getattr(import_module(HOOKS[name]), name)(*arguments)
