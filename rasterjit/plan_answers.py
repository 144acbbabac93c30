"""Which effects the materials of a scene call for, and why: facets, maps, emission, sides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from rasterjit.scene.material import TEXTURE_FIELDS
from rasterjit.scene.mesh import Mesh

MAPS = {"normal maps": 1, "metallic-roughness maps": 2, "occlusion maps": 3}
"""Effects that are textures of a kind, numbered as in ``TEXTURE_FIELDS``."""


class Effect(NamedTuple):
    """One thing that a frame may need, and why it does or does not."""

    name: str
    used: bool
    reason: str


class Answers(NamedTuple):
    """How many objects of a scene answer light in which way, beyond colours and highlights."""

    faceted: int = 0
    """With metallic-roughness materials."""
    mapped: tuple[int, ...] = (0,) * len(TEXTURE_FIELDS)
    """With a texture of each kind that is read."""
    emitting: int = 0
    """That send out light."""
    single_sided: int = 0
    """Whose back faces are not drawn."""

    @property
    def has_maps(self) -> bool:
        """Whether more lies over any object than a base colour."""
        return any(self.mapped[1:]) or self.emitting > 0


def answers_of(counts: Mapping[Mesh, int]) -> Answers:
    """Look through meshes, each with how many objects show it."""
    faceted = emitting = single_sided = 0
    mapped = [0] * len(TEXTURE_FIELDS)
    for mesh, count in counts.items():
        material = mesh.material
        faceted += count * (material.shading == "pbr")
        emitting += count * material.emits
        single_sided += count * (not material.double_sided)
        for kind, texture in enumerate(material.textures_read()):
            mapped[kind] += count * (texture is not None)
    return Answers(faceted, tuple(mapped), emitting, single_sided)


def answer_effects(answers: Answers, shades: bool, is_lit: bool) -> tuple[Effect, ...]:
    """
    Return what is in and what is out, with the reason.

    Parameters
    ----------
    answers : Answers
    shades, is_lit : bool
        Whether the colour of faces is asked for, and whether light reaches it.
    """
    unshaded = "nothing is shaded"
    facets = _objects(answers.faceted) if answers.faceted else "no material is shaded pbr"
    emission = _objects(answers.emitting) if answers.emitting else "no material is emissive"
    sides = (
        _objects(answers.single_sided) if answers.single_sided else "every material is double_sided"
    )
    return (
        Effect(
            "microfacets",
            is_lit and answers.faceted > 0,
            facets if is_lit or not answers.faceted else unshaded,
        ),
        *(_map_effect(name, kind, answers, shades) for name, kind in MAPS.items()),
        Effect(
            "emission",
            shades and answers.emitting > 0,
            emission if shades or not answers.emitting else unshaded,
        ),
        Effect("single-sided objects", answers.single_sided > 0, sides),
    )


def _map_effect(name: str, kind: int, answers: Answers, shades: bool) -> Effect:
    """Return whether textures of a kind are read, and why."""
    count, field = answers.mapped[kind], TEXTURE_FIELDS[kind]
    if not count:
        article = "an" if field[0] in "aeiou" else "a"
        return Effect(name, False, f"no lit material has {article} {field}")
    return Effect(name, shades, _objects(count) if shades else "nothing is shaded")


def _objects(count: int) -> str:
    """Return a number of objects in words."""
    return f"{count} object{'s' if count != 1 else ''}"
