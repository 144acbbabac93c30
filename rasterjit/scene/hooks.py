"""Call functions of higher levels for scenes and meshes, importing their modules on first use."""

from __future__ import annotations

from importlib import import_module
from typing import Any

HOOKS = {
    "as_scene": "rasterjit.io.meshes",
    "pose_scene": "rasterjit.survey.deformation",
    "preview": "rasterjit.styles.small_preview",
    "save_gltf": "rasterjit.io.gltf.writing",
    "get_scene_to_add": "rasterjit.io.meshes",
    "show_picture": "rasterjit.viewer.show_picture",
    "to_trimesh": "rasterjit.io.trimesh.writing",
}
"""Module of each function of a higher level that scenes, meshes and frames call."""


def call_higher_level(name: str, *arguments: Any) -> Any:
    """Call a function of `HOOKS`."""
    return getattr(import_module(HOOKS[name]), name)(*arguments)
