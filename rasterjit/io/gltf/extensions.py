"""
Name the extensions of glTF that are read, and the libraries that some of them need.

``docs/guides/gltf.md`` has the table of all extensions; ``tests/io/test_gltf_extensions.py`` goes
through it.
"""

from __future__ import annotations

import importlib.util
import sys

from rasterjit.io.gltf.layers import LAYERS
from rasterjit.io.gltf.variants import VARIANTS

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
BASIS = "KHR_texture_basisu"
INSTANCING = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"
LIGHTS = "KHR_lights_punctual"

PICTURES = (BASIS, "EXT_texture_avif", "EXT_texture_webp", "MSFT_texture_dds")
"""Extensions that name another picture of a texture; the first one that can be read is taken."""

FURTHER_FORMATS = {"EXT_texture_avif": ("AVIF",), "MSFT_texture_dds": ("DDS",)}
"""Pillow's names of the formats that only an extension allows."""

LIBRARIES = {DRACO: "DracoPy", **dict.fromkeys(MESHOPT, "meshopt"), BASIS: "opengl_basisu"}
"""Modules that decode what an extension compresses; the extra ``gltf`` installs them."""

_OLDEST = {"meshopt": (3, 11)}
"""Versions of Python that a library needs, where they are newer than ours."""

DRAWN = frozenset(
    (
        DRACO, *MESHOPT, *PICTURES, INSTANCING, VISIBILITY, LIGHTS,
        "KHR_materials_unlit", "KHR_materials_emissive_strength", "KHR_texture_transform",
        "KHR_mesh_quantization", "KHR_materials_pbrSpecularGlossiness", VARIANTS, *LAYERS,
    )
)  # fmt: skip

NOTHING_TO_SHOW = frozenset(
    (
        "KHR_collision_shapes", "KHR_node_hoverability", "KHR_node_selectability",
        "KHR_physics_rigid_bodies", "KHR_xmp", "KHR_xmp_json_ld", "EXT_instance_features",
        "EXT_mesh_features", "EXT_mesh_manifold", "EXT_structural_metadata", "AGI_stk_metadata",
        "FB_geometry_metadata", "GODOT_single_root", "MSFT_lod",
    )
)  # fmt: skip
"""Extensions without which a picture is the same: a finest level of detail is shown as it is."""

UNDERSTOOD = DRAWN | NOTHING_TO_SHOW
"""Extensions that a file may require."""


class MissingLibraryError(ValueError):
    """A library that an extension needs is not installed."""


def check_library(extension: str) -> None:
    """Raise `MissingLibraryError` if an extension needs a library that is not installed."""
    name = LIBRARIES.get(extension)
    if name is None or importlib.util.find_spec(name) is not None:
        return
    oldest = _OLDEST.get(name, (0, 0))
    on = f" on Python {'.'.join(map(str, oldest))} or newer" if sys.version_info < oldest else ""
    raise MissingLibraryError(f'{extension} needs {name}{on}; pip install "rasterjit[gltf]"')
