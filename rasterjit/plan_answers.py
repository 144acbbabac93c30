"""Which effects the materials of a scene call for, and why: facets, maps, emission, sides."""

from __future__ import annotations

from typing import NamedTuple

from rasterjit.plan_contents import Contents, in_words
from rasterjit.scene.material import TEXTURE_FIELDS

MAPS = {"normal maps": 1, "metallic-roughness maps": 2, "occlusion maps": 3}
"""Effects that are textures of a kind, numbered as in ``TEXTURE_FIELDS``."""


class Effect(NamedTuple):
    """One thing that a frame may need, and why it does or does not."""

    name: str
    used: bool
    reason: str


def answer_effects(
    seen: Contents, contents: Contents, shades: bool, is_lit: bool
) -> tuple[Effect, ...]:
    """
    Return what is in and what is out, with the reason.

    Parameters
    ----------
    seen, contents : Contents
        Of the objects in view, and of all.
    shades, is_lit : bool
        Whether the colour of faces is asked for, and whether light reaches it.
    """

    def effect(name: str, needed: bool, part: tuple[int, int], none: str) -> Effect:
        if not part[1]:
            return Effect(name, False, none)
        if not part[0]:
            return Effect(name, False, in_words(*part))
        return Effect(name, needed, in_words(*part) if needed else "nothing is shaded")

    return (
        effect("microfacets", is_lit, (seen.pbr, contents.pbr), "no material is shaded pbr"),
        *(
            effect(name, shades, (seen.textured[kind], contents.textured[kind]), _absent(kind))
            for name, kind in MAPS.items()
        ),
        effect("emission", shades, (seen.emitting, contents.emitting), "no material is emissive"),
        effect(
            "single-sided objects", True, (seen.single_sided, contents.single_sided),
            "every material is double_sided",
        ),
    )  # fmt: skip


def _absent(kind: int) -> str:
    """Say that no texture of a kind is read."""
    field = TEXTURE_FIELDS[kind]
    return f"no lit material has {'an' if field[0] in 'aeiou' else 'a'} {field}"
