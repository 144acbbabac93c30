"""
List the stages that light varnish, fibres and own mirrors, around those that light all surfaces.

Only what is in view has stages; where nothing is, nobody imports this.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.lighting import clearcoat, dielectrics, sheen
from rasterjit.pipeline.records import Layers, Through
from rasterjit.pipeline.surface import layers as moves
from rasterjit.pipeline.surface import samples as rows
from rasterjit.runtime.driver import Step

BASE, LIT_TO_ROUGHNESS, COLOR, NORMAL = 3, 6, 3, 3
"""How many rows go together."""


def kept(source: int, target: int, number: int = COLOR) -> Step:
    """Return the stage that copies rows."""
    return Step(moves.copy_rows, (source, target, number))


def exchanged(base: int, lit: int, steps: list[Step]) -> list[Step]:
    """Return stages with the rows of a layer in place of those of the surface."""
    change = [
        Step(moves.exchange_rows, (rows.RED, base, BASE)),
        Step(moves.exchange_rows, (rows.LIT, lit, LIT_TO_ROUGHNESS)),
    ]
    return [*change, *steps, *change]


def on_varnish(steps: list[Step]) -> list[Step]:
    """Return stages that light the varnish instead of the surface."""
    turned = Step(moves.exchange_rows, (rows.NORMAL_X, rows.COAT_NORMAL_X, NORMAL))
    return [turned, *exchanged(rows.COAT_RED, rows.COAT_LIT, steps), turned]


def on_stand_ins(layers: Layers, steps: list[Step]) -> list[Step]:
    """Return stages that light a white surface as rough as the sample's, and no other."""
    return [
        Step(moves.fill_rows, (layers.stand_ins, rows.LAYER_RED)),
        kept(rows.ROUGHNESS, rows.LAYER_ROUGHNESS, 1),
        *exchanged(rows.LAYER_RED, rows.LAYER_LIT, steps),
    ]


def starting_steps(layers: Layers, normalize: Step) -> list[Step]:
    """Return the stages before any light."""
    if layers.coats is None:
        return []
    turned = Step(moves.exchange_rows, (rows.NORMAL_X, rows.COAT_NORMAL_X, NORMAL))
    return [turned, normalize, turned]


def light_steps(
    layers: Layers,
    shiny: list[Step],
    facets: Step,
    lit_by: tuple[NDArray[Any], int, NDArray[Any]],
) -> list[Step]:
    """
    Return the stages that add one light.

    Parameters
    ----------
    layers : Layers
    shiny : list of Step
        Those of Blinn-Phong materials.
    facets : Step
        That of microfacets.
    lit_by : ((L, 13) float32, int, (2,) float32)
        All lights, the number of this one, and ``Microfacets.parts``.
    """
    steps = [*shiny]
    if layers.sheens is not None:
        steps.append(kept(rows.OUT_RED, rows.BELOW_RED))
    if layers.dielectrics is not None:
        steps.append(kept(rows.OUT_RED, rows.BEFORE_RED))
    steps.append(facets)
    if layers.dielectrics is not None:
        steps.append(Step(dielectrics.light_own_mirrors, lit_by))
    if layers.sheens is not None:
        steps.append(Step(sheen.light_fibres, (*lit_by, layers.albedo)))
    if layers.coats is not None:
        steps += on_varnish([facets])
    return steps


def around_steps(
    layers: Layers, viewer: NDArray[Any], facets: Step, matt: Step, is_first: bool = False
) -> list[Step]:
    """
    Return the stages that show light from all sides.

    Parameters
    ----------
    layers : Layers
    viewer : (4,) float32
    facets, matt : Step
        Those that show it on microfacets, and on what LIT tells.
    is_first : bool
        Whether nothing was shown before: what is seen is written, not added to.
    """
    steps: list[Step] = []
    fibres, mirrors = layers.sheens is not None, layers.dielectrics is not None
    dark = np.zeros((len(layers.stand_ins), COLOR), np.float32)
    for is_there, target in ((fibres, rows.BELOW_RED), (mirrors, rows.BEFORE_RED)):
        if is_there and is_first:
            steps.append(Step(moves.fill_rows, (dark, target)))
        elif is_there:
            steps.append(kept(rows.OUT_RED, target))
    steps.append(facets)
    if mirrors:
        steps += on_stand_ins(layers, [facets])
        steps.append(kept(rows.LAYER_OUT, rows.WHITE_RED))
    if mirrors or (fibres and is_first):
        steps += on_stand_ins(layers, [matt])
    if mirrors:
        steps.append(Step(dielectrics.show_around_on_own_mirrors, (viewer,)))
    if fibres and not is_first:
        # Ambient light is the same whatever leans.
        leaning = Step(moves.exchange_rows, (rows.NORMAL_X, rows.LEANING_X, NORMAL))
        steps += [Step(sheen.lean_normals, (viewer,)), leaning]
        steps += [*on_stand_ins(layers, [matt]), leaning]
    if fibres:
        steps.append(Step(sheen.show_around_on_fibres, (viewer, layers.albedo)))
    if layers.coats is not None:
        steps += on_varnish([facets])
    return steps


def finishing_steps(
    layers: Layers, viewer: NDArray[Any], through: Through | None = None
) -> list[Step]:
    """
    Return the stages behind all light, and behind what surfaces send out.

    Parameters
    ----------
    layers : Layers
    viewer : (4,) float32
    through : Through or None
        If light goes through the objects, it goes through what lies over them as well.
    """
    steps: list[Step] = []
    if through is not None:
        dark = np.zeros((len(layers.stand_ins), COLOR), np.float32)
        steps.append(Step(moves.fill_rows, (dark, rows.BELOW_RED)))
        if layers.sheens is not None:
            turned = Step(moves.exchange_rows, (rows.OUT_RED, rows.TINT_RED, COLOR))
            under = Step(sheen.show_around_on_fibres, (viewer, layers.albedo))
            steps += [Step(moves.fill_rows, (dark, rows.LAYER_OUT)), turned, under, turned]
    if layers.coats is not None:
        steps.append(Step(clearcoat.lay_coats, (viewer, rows.COAT_OUT, rows.OUT_RED)))
        if through is not None:
            steps.append(Step(clearcoat.lay_coats, (viewer, rows.BELOW_RED, rows.TINT_RED)))
    return steps
