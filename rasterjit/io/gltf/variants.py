"""
Read and write which materials a glTF file has for its variants, such as shoes of three colours.

References
----------
.. [1] The Khronos Group, "KHR_materials_variants".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rasterjit.io.gltf.values import list_of, object_of, shown, whole_of
from rasterjit.io.skipped import LeftOut
from rasterjit.scene.validation import in_short

VARIANTS = "KHR_materials_variants"

_EXTENSIONS = "extensions"


def variant_names(header: dict[str, Any], left_out: LeftOut) -> list[str | None]:
    """
    Return the names of a file's variants, in its order.

    Parameters
    ----------
    header : dict
        The JSON of the file.
    left_out : LeftOut
        Notes variants without a name, or with that of an earlier one.

    Returns
    -------
    list of str or None
        ``None`` where a variant has no name of its own.
    """
    names: list[str | None] = []
    try:
        entries = list_of(object_of(object_of(header, _EXTENSIONS), VARIANTS), "variants")
    except ValueError as error:
        left_out.note(f"{VARIANTS}, which cannot be read: {error}")
        return names
    for number, entry in enumerate(entries):
        name = entry.get("name") if isinstance(entry, dict) else None
        if not isinstance(name, str) or not name:
            left_out.note(f"variant {number}, which has no name")
            name = None
        elif name in names:
            left_out.note(f"second variant of the name {in_short(name)}")
            name = None
        names.append(name)
    return names


def mapped_materials(
    primitive: dict[str, Any], names: Sequence[str | None], label: str, left_out: LeftOut
) -> dict[str, int]:
    """
    Return the numbers of a primitive's materials by the names of variants.

    Parameters
    ----------
    primitive : dict
    names : sequence of str or None
        As `variant_names` returns them.
    label : str
        What messages call the mesh.
    left_out : LeftOut
        Notes variants that the file has not, that have two materials, and what is damaged.
    """
    found: dict[str, int] = {}
    try:
        extension = object_of(object_of(primitive, _EXTENSIONS), VARIANTS)
        mappings = list_of(extension, "mappings")
    except ValueError as error:
        left_out.note(f"variants of {label}, which cannot be read: {error}")
        return found
    for number, mapping in enumerate(mappings):
        try:
            entry = object_of({"a mapping": mapping}, "a mapping")
            material = whole_of(entry, "material")
            variants = list_of(entry, "variants")
        except ValueError as error:
            left_out.note(f"mapping {number} of variants of {label}: {error}")
            continue
        for variant in variants:
            is_place = isinstance(variant, int) and not isinstance(variant, bool)
            if not is_place or not 0 <= variant < len(names):
                left_out.note(
                    f"variant {shown(variant)} of {label}, which the file has not "
                    f"(it has {len(names)})"
                )
                continue
            name = names[variant]
            if name is None:
                # Its name was noted, where the list was read.
                continue
            if name in found:
                left_out.note(f"second material of {label} for the variant {in_short(name)}")
                continue
            found[name] = material
    return found


def written_mappings(
    materials: Mapping[str, int], names: Sequence[str]
) -> dict[str, list[dict[str, Any]]]:
    """
    Return what a primitive says of its variants.

    Parameters
    ----------
    materials : mapping of str to int
        The numbers of the materials in the file, by the names of variants.
    names : sequence of str
        Those of the file, in its order.
    """
    variants: dict[int, list[int]] = {}
    for name, material in materials.items():
        variants.setdefault(material, []).append(names.index(name))
    return {
        "mappings": [
            {"material": material, "variants": sorted(numbers)}
            for material, numbers in variants.items()
        ]
    }
