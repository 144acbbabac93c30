"""Make ``import pyrender``, and that of its fork pyribbit, mean this package."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

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


def share_names() -> None:
    """Give the modules of this package those names."""
    for module, sources in SHARED.items():
        there = importlib.import_module(f"{__package__}.{module}")
        for source, names in sources.items():
            home = importlib.import_module(f"{__package__}.{source}")
            for name in names:
                setattr(there, name, getattr(home, name))


_OURS, _THEIRS = __package__, ("pyrender", "pyribbit")
"""Names of this package, and of pyrender and its fork of the same modules, which urchin uses."""


def install() -> None:
    """
    Make ``import pyrender``, and that of its modules, mean this package in this process.

    So does ``import pyribbit``, a fork that has the same names. Call it before the first such
    import. Calling it again changes nothing, and until a program imports pyrender nothing of that
    name is loaded.

    Raises
    ------
    RuntimeError
        If pyrender itself, or pyribbit, was imported before.
    """
    for name in _THEIRS:
        there = sys.modules.get(name)
        if there not in (None, sys.modules[_OURS]) and not getattr(there, "is_stand_in", False):
            place = getattr(there, "__file__", None)
            raise RuntimeError(
                f"install must come before the first import of {name}, got one imported from "
                f"{place}"
            )
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


class _Finder(MetaPathFinder):
    """Finds pyrender and its modules in this package."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where a module of pyrender's is; None for others, and for those there are not."""
        top, _, rest = fullname.partition(".")
        if top not in _THEIRS:
            return None
        name = f"{_OURS}.{rest}" if rest else _OURS
        found = importlib.util.find_spec(name)
        if found is None:
            return None
        is_package = found.submodule_search_locations is not None
        return ModuleSpec(fullname, _Loader(name), origin=found.origin, is_package=is_package)


class _Loader(Loader):
    """Loads a module of this package in the place of another."""

    def __init__(self, name: str) -> None:
        self._name = name

    def exec_module(self, module: ModuleType) -> None:
        """Put this package's module in the place of a new, empty one."""
        # What stands there when this returns is what the program imports.
        sys.modules[module.__name__] = importlib.import_module(self._name)
