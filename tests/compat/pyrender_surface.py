"""
Print the public names of pyrender as JSON, or those of a package with its interface.

    python tests/compat/pyrender_surface.py pyrender > tests/compat/pyrender_surface.json

The Python that runs it must have the package; nothing else is imported.
"""

from __future__ import annotations

import importlib
import inspect
import json
import os
import sys

MODULES = (
    "", "camera", "constants", "font", "light", "material", "mesh", "node", "offscreen",
    "platforms.base", "platforms.egl", "platforms.osmesa", "platforms.pyglet_platform",
    "primitive", "renderer", "sampler", "scene", "shader_program", "texture", "trackball",
    "utils", "version", "viewer",
)  # fmt: skip


def surface(package):
    """Return {module: {name: what it is}} of what a package defines."""
    numbers = vars(importlib.import_module(f"{package}.constants"))
    found = {}
    for short in MODULES:
        module = importlib.import_module(f"{package}.{short}" if short else package)
        found[short] = {
            name: described(value, package)
            for name, value in sorted(vars(module).items())
            if is_public(name, value, package, numbers)
        }
    return found


def is_public(name, value, package, numbers):
    """Tell names of the package from those of OpenGL, which some modules have, too."""
    if inspect.isclass(value) or inspect.isfunction(value):
        return not name.startswith("_") and value.__module__.startswith(f"{package}.")
    return name == "__version__" or (
        name in numbers and not name.startswith("_") and isinstance(value, (int, float))
    )


def described(value, package):
    """Return the names of a class, the parameters of a function, or a value."""
    if inspect.isclass(value):
        bases = [one for one in value.__mro__ if one.__module__.startswith(f"{package}.")]
        names = {}
        for one in reversed(bases):
            for name, member in vars(one).items():
                if not name.startswith("_") or name == "__init__":
                    names[name] = member_of(member)
        return {
            "bases": [one.__name__ for one in bases[1:]],
            "names": dict(sorted(names.items())),
        }
    if inspect.isfunction(value):
        return parameters(value)
    return number(value)


def member_of(member):
    """Return what a name of a class is."""
    if isinstance(member, (staticmethod, classmethod)):
        return [type(member).__name__, *parameters(member.__func__)]
    if inspect.isfunction(member):
        return parameters(member)
    if isinstance(member, (int, float, str)):
        return number(member)
    if hasattr(type(member), "__get__"):
        has_setter = getattr(member, "fset", member) is not None and hasattr(
            type(member), "__set__"
        )
        return "attribute" if has_setter else "attribute that cannot be set"
    return "value"


def parameters(function):
    """Return the parameters of a function with their defaults, as text."""
    listed = []
    for one in inspect.signature(function).parameters.values():
        star = {one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "")
        is_extra = one.kind is one.KEYWORD_ONLY
        default = "" if one.default is one.empty else f"={number(one.default)}"
        listed.append(f"{'* ' if is_extra else star}{one.name}{default}")
    return listed


def number(value):
    """Return a value as text that does not tell an enumeration, or an array, from numbers."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, bool) or value is None or isinstance(value, (str, list)):
        return repr(value)
    return repr(float(value)) if isinstance(value, float) else repr(int(value))


if __name__ == "__main__":
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    print(json.dumps(surface(sys.argv[1]), indent=1))
