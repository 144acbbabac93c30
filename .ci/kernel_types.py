"""Tell mypy what annotations of kernels stand for: ``float32[:, ::1]`` is an array of floats."""

from __future__ import annotations

from collections.abc import Callable

from mypy.plugin import AnalyzeTypeContext, Plugin, TypeAnalyzerPluginInterface
from mypy.types import AnyType, Instance, Type, TypeOfAny

ELEMENTS = "rasterjit.runtime.state_block."
"""Where the names of element types are: a number, and with axes an array of such numbers."""
SEVERAL = ("stored", "real")
"""Those that stand for one of several types."""
KINDS = {"i": "signedinteger", "u": "unsignedinteger", "f": "floating"}
"""NumPy's classes of numbers."""


class KernelTypes(Plugin):
    """Reads names of element types, and constants of kernels that list several types."""

    def get_type_analyze_hook(self, fullname: str) -> Callable[[AnalyzeTypeContext], Type] | None:
        """Return what reads an annotation, or None for what are types to mypy as well."""
        name = fullname.rpartition(".")[2]
        if fullname.startswith(ELEMENTS) and (name in SEVERAL or name[-1].isdigit()):
            return lambda context: number_or_array(context, name)
        if fullname.startswith("rasterjit.pipeline.") and name.isupper():
            return lambda context: context.api.named_type("builtins.tuple", [anything()])
        return None


def anything() -> AnyType:
    """Return the type of what is not said."""
    return AnyType(TypeOfAny.explicit)


def number_or_array(context: AnalyzeTypeContext, name: str) -> Type:
    """Return the type of an annotation that begins with the name of an element type."""
    api = context.api
    if not context.type.args:
        return api.named_type("builtins.int" if "int" in name else "builtins.float", [])
    # The number of axes is the compiler's matter, which checks it.
    shape = api.named_type("builtins.tuple", [anything()])
    numbers = anything() if name in SEVERAL else element(api, name)
    return api.named_type("numpy.ndarray", [shape, api.named_type("numpy.dtype", [numbers])])


def element(api: TypeAnalyzerPluginInterface, name: str) -> Instance:
    """Return NumPy's class of a number."""
    if name == "float64":
        return api.named_type("numpy.float64", [])
    bits = "".join(filter(str.isdigit, name))
    width = api.named_type(f"numpy._typing._nbit_base._{bits}Bit", [])
    return api.named_type(f"numpy.{KINDS[name[0]]}", [width])


def plugin(version: str) -> type[Plugin]:
    """Return the plugin, for mypy."""
    return KernelTypes
