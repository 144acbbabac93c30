"""Names that modules have because pyrender's import them there, for programs that look there."""

from __future__ import annotations

import importlib

_DEFAULTS = ("DEFAULT_Z_NEAR", "DEFAULT_Z_FAR")
_VERSIONS = (
    "TARGET_OPEN_GL_MAJOR", "TARGET_OPEN_GL_MINOR", "MIN_OPEN_GL_MAJOR", "MIN_OPEN_GL_MINOR",
)  # fmt: skip
_LIGHTS = ("DirectionalLight", "PointLight", "SpotLight")

SHARED: dict[str, dict[str, tuple[str, ...]]] = {
    "font": {
        "constants": ("FLOAT_SZ", "TextAlign"), "sampler": ("Sampler",), "texture": ("Texture",),
    },
    "light": {
        "camera": ("OrthographicCamera", "PerspectiveCamera"), "constants": ("SHADOW_TEX_SZ",),
        "texture": ("Texture",),
    },
    "offscreen": {"renderer": ("Renderer",)},
    "platforms.pyglet_platform": {"constants": _VERSIONS},
    "primitive": {"constants": ("FLOAT_SZ", "UINT_SZ")},
    "renderer": {
        "constants": (
            "BufFlags", "GLTF", "MAX_N_LIGHTS", "ProgramFlags", "SHADOW_TEX_SZ", "TexFlags",
            *_DEFAULTS,
        ),
        "font": ("FontCache",), "light": _LIGHTS,
        "material": ("MetallicRoughnessMaterial", "SpecularGlossinessMaterial"),
        "shader_program": ("ShaderProgramCache",), "utils": ("format_color_vector",),
    },
    "viewer": {
        "camera": ("IntrinsicsCamera", "OrthographicCamera", "PerspectiveCamera"),
        "constants": ("DEFAULT_SCENE_SCALE", "TEXT_PADDING", "TextAlign", *_DEFAULTS, *_VERSIONS),
        "mesh": ("Mesh",), "node": ("Node",), "trackball": ("Trackball",),
    },
}  # fmt: skip
"""For each module, what it has of which other; no name may mean something else there."""


def share() -> None:
    """Give the modules of this package those names."""
    for module, sources in SHARED.items():
        there = importlib.import_module(f"{__package__}.{module}")
        for source, names in sources.items():
            home = importlib.import_module(f"{__package__}.{source}")
            for name in names:
                setattr(there, name, getattr(home, name))
